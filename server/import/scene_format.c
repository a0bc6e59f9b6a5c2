#include "server/import/scene_format.h"

#include "common/base/file_read.h"
#include "server/import/text_lines.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#define START_SIZE 4096 /* bytes read to recognise a format */

static const struct {
    const char *name, *ending, *other;
} formats[LW_SCENE_FORMAT_COUNT] = {
#define X(name, text, ending, other) [LW_SCENE_FORMAT_##name] = {text, ending, other},
    LW_SCENE_FORMAT_MAP(X)
#undef X
};

struct start {
    const char *path;
    const uint8_t *bytes;
    size_t size;
};

const char *lw_scene_format_name(enum lw_scene_format format) { return formats[format].name; }
const char *lw_scene_format_ending(enum lw_scene_format format) { return formats[format].ending; }

static bool begins_with(const struct start *start, const char *text) {
    size_t length = strlen(text);
    return start->size >= length && memcmp(start->bytes, text, length) == 0;
}

static bool contains(const struct start *start, const char *text) {
    return memmem(start->bytes, start->size, text, strlen(text)) != NULL;
}

static bool is_text(const struct start *start) { return !memchr(start->bytes, 0, start->size); }

/* Past white space and a byte order mark. */
static struct start skip_blanks(struct start start) {
    size_t at = begins_with(&start, "\xEF\xBB\xBF") ? 3 : 0;
    while (at < start.size && strchr(" \t\r\n", start.bytes[at]) && start.bytes[at]) at++;
    return (struct start){start.path, start.bytes + at, start.size - at};
}

/* "ply" or "solid", in any case: a word of its own. */
static bool begins_with_word(const struct start *start, const char *word) {
    const size_t length = strlen(word);
    return start->size > length && strncasecmp((const char *)start->bytes, word, length) == 0 &&
           strchr(" \t\r\n", start->bytes[length]) && start->bytes[length];
}

/* 84 bytes of header, then 50 for each of the triangles that it counts. */
static bool is_binary_stl(const struct start *start) {
    struct stat info;
    if (start->size < 84 || stat(start->path, &info) < 0) return false;
    const uint8_t *count = start->bytes + 80;
    uint64_t triangles =
        (uint64_t)count[0] | (uint64_t)count[1] << 8 | (uint64_t)count[2] << 16 | (uint64_t)count[3] << 24;
    return (uint64_t)info.st_size >= 84 + 50 * triangles;
}

/* Whether the bytes can be of a format; OBJ and ASCII STL have no mark of their own. */
static bool fits(const struct start *start, enum lw_scene_format format) {
    const struct start first = skip_blanks(*start);
    switch (format) {
    case LW_SCENE_FORMAT_GLTF:
        return begins_with(start, "glTF") || begins_with(&first, "{");
    case LW_SCENE_FORMAT_PLY:
        return begins_with_word(&first, "ply");
    case LW_SCENE_FORMAT_FBX:
        return begins_with(start, "Kaydara FBX Binary") ||
               (is_text(start) && (begins_with(&first, "; FBX") || contains(start, "FBXHeaderExtension")));
    case LW_SCENE_FORMAT_COLLADA:
        return begins_with(&first, "<") && contains(start, "<COLLADA");
    case LW_SCENE_FORMAT_STL:
        return (begins_with_word(&first, "solid") && is_text(start)) || is_binary_stl(start);
    case LW_SCENE_FORMAT_OBJ:
        return is_text(start);
    case LW_SCENE_FORMAT_COUNT:
        break;
    }
    return false;
}

/* Whether its first bytes alone tell the format. */
static bool has_mark(enum lw_scene_format format) {
    return format != LW_SCENE_FORMAT_OBJ && format != LW_SCENE_FORMAT_STL;
}

static bool ends_with(const char *path, const char *ending) {
    size_t length = strlen(path), ending_length = strlen(ending);
    return length >= ending_length && strcasecmp(path + length - ending_length, ending) == 0;
}

static enum lw_status recognise(const struct start *start, enum lw_scene_format *out, struct lw_error *err) {
    if (start->size == 0) return lw_status_fail(err, LW_BAD_DATA, "is empty");
    if (lw_text_lines_is_wide(start->bytes, start->size))
        return lw_status_fail(err, LW_BAD_DATA, "is UTF-16 text, which is not read: save it as UTF-8");
    for (int f = 0; f < LW_SCENE_FORMAT_COUNT; f++) {
        *out = (enum lw_scene_format)f;
        if (has_mark(*out) && fits(start, *out)) return LW_OK;
    }
    for (int f = 0; f < LW_SCENE_FORMAT_COUNT; f++) {
        *out = (enum lw_scene_format)f;
        if (!ends_with(start->path, formats[f].ending) && !ends_with(start->path, formats[f].other)) continue;
        if (*out == LW_SCENE_FORMAT_GLTF || fits(start, *out))
            return LW_OK; /* its reader reports the mistake */
        return lw_status_fail(err, LW_BAD_DATA, "has the name of a %s file but does not begin like one",
                              formats[f].name);
    }
    return lw_status_fail(err, LW_BAD_DATA,
                          "is in no format that is read: " LW_SCENE_FORMAT_ENDINGS
                          "; export it as one of these, best as .glb");
}

enum lw_status lw_scene_format_of(const char *path, enum lw_scene_format *out, struct lw_error *err) {
    struct lw_error own = {0};
    uint8_t *bytes = NULL;
    struct start start = {.path = path};
    enum lw_scene_format format = LW_SCENE_FORMAT_GLTF;
    enum lw_status status = lw_file_read(path, START_SIZE, false, &bytes, &start.size, &own);
    start.bytes = bytes;
    if (status == LW_OK) status = recognise(&start, &format, &own);
    free(bytes);
    if (status) return lw_status_fail(err, status, "%s: %s", path, own.text);
    *out = format;
    return LW_OK;
}
