#include "server/import/foreign/foreign_import.h"

#include "common/base/log.h"

#include <string.h>

static const char *const warning_text[LW_FOREIGN_WARNING_COUNT] = {
#define X(name, text) [LW_FOREIGN_WARN_##name] = text,
    LW_FOREIGN_WARNING_MAP(X)
#undef X
};

void lw_foreign_import_warn(struct lw_foreign_import *import, enum lw_foreign_warning warning) {
    if (import->warned & 1u << warning) return;
    import->warned |= 1u << warning;
    lw_log(LW_LOG_WARNING, "%s: %s", import->desc->path, warning_text[warning]);
}

/* RFC 3629, as the scene's validation has it: shortest form, no surrogates. */
static bool is_utf8(const unsigned char *p) {
    while (*p) {
        size_t length = *p < 0x80 ? 1 : *p >= 0xC2 && *p <= 0xDF ? 2 : (*p & 0xF0) == 0xE0 ? 3 : 0;
        if (*p >= 0xF0 && *p <= 0xF4) length = 4;
        if (length == 0) return false;
        for (size_t i = 1; i < length; i++)
            if ((p[i] & 0xC0) != 0x80) return false;
        if ((p[0] == 0xE0 && p[1] < 0xA0) || (p[0] == 0xED && p[1] > 0x9F) || (p[0] == 0xF0 && p[1] < 0x90) ||
            (p[0] == 0xF4 && p[1] > 0x8F))
            return false;
        p += length;
    }
    return true;
}

const char *lw_foreign_import_text(struct lw_foreign_import *import, const struct aiString *text) {
    char latin[2 * sizeof text->data + 1];
    size_t size = 0;
    if (is_utf8((const unsigned char *)text->data)) return lw_scene_string(import->scene, text->data);
    for (const unsigned char *p = (const unsigned char *)text->data; *p; p++) {
        if (*p >= 0x80) latin[size++] = (char)(0xC0 | *p >> 6);
        latin[size++] = (char)(*p < 0x80 ? *p : 0x80 | (*p & 0x3F));
    }
    latin[size] = 0;
    return lw_scene_string(import->scene, latin);
}
