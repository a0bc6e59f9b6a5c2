#include "server/import/foreign/foreign_text.h"

#include "common/base/log.h"
#include "server/import/text/collada_text.h"
#include "server/import/text/ply_header.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

/* Takes over bytes in the place of the scene's. */
static void replace(struct lw_foreign_files *files, uint8_t *bytes, size_t size) {
    free(files->bytes);
    files->bytes = bytes;
    files->size = size;
}

/* ---- OBJ ---- */

static enum lw_status mend_obj(struct lw_foreign_files *files, struct lw_error *err) {
    const struct lw_obj_materials_desc desc = {
        .path = files->path, .folder = files->folder, .name = files->name};
    enum lw_status status = lw_obj_text_read(&files->obj, files->bytes, files->size, err);
    lw_skipped_report(&files->obj.skipped, files->path);
    if (!status) status = lw_obj_materials_load(&files->materials, &files->obj, &desc, err);
    if (status) return status;
    replace(files, (uint8_t *)files->obj.text, files->obj.size);
    files->obj.text = NULL;
    return LW_OK;
}

/* ---- PLY ---- */

/* Copies the rows of an ASCII body without those that are empty or comments. */
static size_t copy_rows(uint8_t *to, const uint8_t *from, size_t size) {
    const uint8_t *end = from + size;
    uint8_t *start = to;
    while (from < end) {
        while (from < end && isspace(*from)) from++;
        const uint8_t *row_end = from;
        while (row_end < end && *row_end != '\n' && *row_end != '\r') row_end++;
        const size_t length = (size_t)(row_end - from);
        const bool is_comment = length && (*from == '#' || (length >= 7 && memcmp(from, "comment", 7) == 0));
        if (length && !is_comment) {
            memcpy(to, from, length);
            to += length;
            if (row_end < end) *to++ = '\n';
        }
        from = row_end;
    }
    return (size_t)(to - start);
}

static enum lw_status mend_ply(struct lw_foreign_files *files, struct lw_error *err) {
    struct lw_ply_header header;
    uint8_t *bytes = NULL;
    if (!lw_ply_header_read(&header, files->bytes, files->size, err)) {
        size_t rest = files->size - header.body;
        const uint8_t *body = files->bytes + header.body;
        bytes = malloc(header.size + rest);
        if (bytes) {
            memcpy(bytes, header.text, header.size);
            if (header.is_binary)
                memcpy(bytes + header.size, body, rest);
            else
                rest = copy_rows(bytes + header.size, body, rest);
            replace(files, bytes, header.size + rest);
            files->has_material = header.has_material;
        } else {
            lw_status_fail(err, LW_NO_MEMORY, "out of memory");
        }
    }
    lw_skipped_report(&header.skipped, files->path);
    lw_ply_header_finish(&header);
    return err->status;
}

/* ---- STL ---- */

#define STL_HEADER 80
#define STL_FACET  50
#define STL_COLOUR 0x8000u /* Assimp reads the colour of a facet with this bit */

static unsigned facet_attribute(const struct lw_foreign_files *files, size_t facet) {
    const uint8_t *at = files->bytes + STL_HEADER + 4 + STL_FACET * facet + 48;
    return (unsigned)at[0] | (unsigned)at[1] << 8;
}

/* There are two ways to colour facets. The one with a colour of all in the header has the bit the other way
 * round. */
static void check_binary_stl(struct lw_foreign_files *files) {
    files->has_material = memmem(files->bytes, STL_HEADER, "COLOR=", 6) != NULL;
    if (!files->has_material) return;
    for (size_t i = 0; STL_HEADER + 4 + STL_FACET * (i + 1) <= files->size; i++) {
        const unsigned attribute = facet_attribute(files, i);
        if (attribute == 0 || attribute & STL_COLOUR) continue;
        lw_log(LW_LOG_WARNING, "%s: facet %zu has a colour of its own: it is not read, all have the header's",
               files->path, i);
        return;
    }
}

static bool begins_name(const char *word, const char *end) {
    return (end - word == 5 && memcmp(word, "solid", 5) == 0) ||
           (end - word == 8 && memcmp(word, "endsolid", 8) == 0);
}

/* In place: nothing before "solid", and in lower case but for the names behind it. */
static void mend_ascii_stl(struct lw_foreign_files *files, size_t start) {
    char *text = (char *)files->bytes;
    memmove(text, text + start, files->size - start);
    files->size -= start;
    const char *word = text;
    bool is_name = false;
    for (char *at = text, *end = text + files->size; at < end; at++) {
        const bool ends_line = *at == '\n' || *at == '\r';
        if (isspace((unsigned char)*at)) {
            is_name = !ends_line && (is_name || begins_name(word, at));
            word = at + 1;
        } else if (!is_name) {
            *at = (char)tolower((unsigned char)*at);
        }
    }
}

static enum lw_status mend_stl(struct lw_foreign_files *files) {
    size_t start = files->size >= 3 && memcmp(files->bytes, "\xEF\xBB\xBF", 3) == 0 ? 3 : 0;
    while (start < files->size && isspace(files->bytes[start])) start++;
    const bool is_solid =
        files->size - start >= 5 && strncasecmp((char *)files->bytes + start, "solid", 5) == 0;
    if (is_solid && !memchr(files->bytes, 0, files->size))
        mend_ascii_stl(files, start);
    else if (files->size >= STL_HEADER + 4)
        check_binary_stl(files);
    return LW_OK;
}

/* ---- all ---- */

static enum lw_status mend_collada(struct lw_foreign_files *files, struct lw_error *err) {
    uint8_t *text;
    size_t size;
    if (!lw_collada_text_mend(files->bytes, files->size, &text, &size, err)) replace(files, text, size);
    return err->status;
}

/* FBX has orthographic cameras, of which Assimp says nothing: in text and in binary files this property is
 * followed by its type, two empty texts and a number. */
static void look_for_orthographic(const struct lw_foreign_files *files) {
    static const char name[] = "CameraProjectionType", text[] = "\", \"enum\", \"\", \"\",",
                      binary[] = "S\4\0\0\0enumS\0\0\0\0S\0\0\0\0I";
    const uint8_t *at = files->bytes, *end = at + files->size;
    while ((at = memmem(at, (size_t)(end - at), name, sizeof name - 1))) {
        at += sizeof name - 1;
        const size_t left = (size_t)(end - at);
        const uint8_t *value = NULL;
        if (left >= sizeof text && memcmp(at, text, sizeof text - 1) == 0) value = at + sizeof text - 1;
        const bool in_text = value != NULL;
        if (left >= sizeof binary && memcmp(at, binary, sizeof binary - 1) == 0)
            value = at + sizeof binary - 1;
        if (!value || *value != (in_text ? '1' : 1)) continue;
        lw_log(LW_LOG_WARNING, "%s: orthographic cameras are read as perspective ones", files->path);
        return;
    }
}

enum lw_status lw_foreign_text_mend(struct lw_foreign_files *files, struct lw_error *err) {
    switch (files->format) {
    case LW_SCENE_FORMAT_OBJ:
        return mend_obj(files, err);
    case LW_SCENE_FORMAT_PLY:
        return mend_ply(files, err);
    case LW_SCENE_FORMAT_STL:
        return mend_stl(files);
    case LW_SCENE_FORMAT_COLLADA:
        return mend_collada(files, err);
    case LW_SCENE_FORMAT_FBX:
        look_for_orthographic(files);
        return LW_OK;
    default:
        return LW_OK;
    }
}
