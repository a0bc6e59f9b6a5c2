#include "server/import/text/ply_header.h"

#include "server/import/mesh/mesh_builder.h"
#include "server/import/text_lines.h"

#include <ctype.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#define LINE_SIZE 4096 /* characters of a line; longer ones are cut */

/* In a binary file Assimp steps over elements that it knows and ignores. Others it leaves where they are,
 * and reads their bytes as those of the next. */
#define SKIPPED_ELEMENT "edge"

enum element { VERTEX, FACE, MATERIAL, OTHER };

enum colour { RED, GREEN, BLUE, ALPHA, COLOURS };
static const char *const colour_names[COLOURS] = {"red", "green", "blue", "alpha"};

struct reader {
    struct lw_ply_header *header;
    const uint8_t *bytes;
    size_t size, at;
    bool ends_with_two; /* characters: the file's lines end with CR LF */
    unsigned line;
    char text[LINE_SIZE];
    enum element element;
    bool has_colour[COLOURS];
};

static bool is_end(uint8_t c) { return c == '\n' || c == '\r'; }

static size_t skip_mark(const uint8_t *bytes, size_t size) {
    return size >= 3 && memcmp(bytes, "\xEF\xBB\xBF", 3) == 0 ? 3 : 0;
}

/* The next line without blanks at its ends. All lines of a header end like the first: what follows the last
 * one may be binary. */
static bool read_line(struct reader *reader) {
    size_t from = reader->at, to = from;
    while (to < reader->size && !is_end(reader->bytes[to])) to++;
    if (to == reader->size) return false;
    const bool two = reader->bytes[to] == '\r' && to + 1 < reader->size && reader->bytes[to + 1] == '\n';
    if (reader->line++ == 0) reader->ends_with_two = two;
    reader->at = to + 1 + (two && reader->ends_with_two);
    while (from < to && reader->bytes[from] <= ' ') from++;
    size_t length = to - from < LINE_SIZE ? to - from : LINE_SIZE - 1;
    for (size_t i = 0; i < length; i++)
        reader->text[i] = reader->bytes[from + i] > ' ' ? (char)reader->bytes[from + i] : ' ';
    while (length > 0 && reader->text[length - 1] == ' ') length--;
    reader->text[length] = 0;
    return true;
}

static enum lw_status write(struct reader *reader, struct lw_error *err, const char *format, ...)
    LW_PRINTF(3, 4);

static enum lw_status write(struct reader *reader, struct lw_error *err, const char *format, ...) {
    struct lw_ply_header *header = reader->header;
    char text[LINE_SIZE + 64];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    const size_t length = strlen(text);
    if (!lw_mesh_builder_reserve((void **)&header->text, &header->capacity, header->size + length, 1))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for its header");
    memcpy(header->text + header->size, text, length);
    header->size += length;
    return LW_OK;
}

static void skip(struct reader *reader, const char *what, const char *why) {
    lw_skipped_add(&reader->header->skipped, what, why, reader->line);
}

/* ---- properties ---- */

/* red, r and diffuse_red are the same. */
static int colour_of(const char *name) {
    if (strncmp(name, "diffuse_", 8) == 0) name += 8;
    for (int c = 0; c < COLOURS; c++)
        if (strcmp(name, colour_names[c]) == 0 || (name[0] == *colour_names[c] && !name[1])) return c;
    return -1;
}

static bool is_one_of(const char *name, const char *const *names) {
    for (; *names; names++)
        if (strcmp(name, *names) == 0) return true;
    return false;
}

/* Assimp adds a half to colours of signed numbers, and has its own mind of 32 bits. */
static bool is_colour_type(const char *type) {
    static const char *const types[] = {"uchar",   "uint8",  "ushort",  "uint16", "float",
                                        "float32", "double", "float64", NULL};
    return is_one_of(type, types);
}

static enum lw_status read_vertex_property(struct reader *reader, const char *type, const char *name,
                                           struct lw_error *err) {
    static const char *const read[] = {"x", "y", "z", "nx",        "ny",        "nz", "u",
                                       "v", "s", "t", "texture_u", "texture_v", NULL};
    const int colour = colour_of(name);
    const char *why = NULL;
    if (colour >= 0 && reader->has_colour[colour])
        why = "a second colour of vertices is not read";
    else if (colour >= 0 && !is_colour_type(type))
        why = "colours are read as uchar, ushort, float and double alone";
    else if (colour < 0 && !is_one_of(name, read))
        why = "is no property of vertices that is read";
    if (why) {
        skip(reader, name, why);
        return write(reader, err, "property %s unread\n", type);
    }
    if (colour >= 0) reader->has_colour[colour] = true;
    return write(reader, err, "property %s %s\n", type, colour >= 0 ? colour_names[colour] : name);
}

static enum lw_status read_face_property(struct reader *reader, const char *types, const char *name,
                                         struct lw_error *err) {
    static const char *const read[] = {"vertex_indices", "vertex_index",   "texcoord",
                                       "texnumber",      "material_index", NULL};
    if (colour_of(name) >= 0)
        skip(reader, name, "colours of faces are not read: give them to vertices");
    else if (!is_one_of(name, read))
        skip(reader, name, "is no property of faces that is read");
    return write(reader, err, "property %s %s\n", types, name);
}

/* "property TYPE NAME" or "property list TYPE TYPE NAME", in lower case. */
static enum lw_status read_property(struct reader *reader, struct lw_error *err) {
    char *at = reader->text, *word[5] = {0};
    char types[LINE_SIZE];
    int count = 0;
    for (char *c = at; *c; c++) *c = (char)tolower((unsigned char)*c);
    while (count < 5 && (word[count] = lw_text_lines_word(&at))) count++;
    const bool is_list = count == 5 && strcmp(word[1], "list") == 0;
    if (count != 3 && !is_list)
        return lw_status_fail(err, LW_BAD_DATA, "line %u of its header is no property", reader->line);
    snprintf(types, sizeof types, is_list ? "%.40s %.40s %.40s" : "%.40s", word[1], word[2], word[3]);
    switch (reader->element) {
    case VERTEX:
        if (!is_list) return read_vertex_property(reader, types, word[2], err);
        break;
    case FACE:
        return read_face_property(reader, types, word[count - 1], err);
    default:
        break;
    }
    return write(reader, err, "property %s %s\n", types, word[count - 1]);
}

/* ---- lines ---- */

static enum lw_status read_element(struct reader *reader, struct lw_error *err) {
    char *at = reader->text, *name, *count;
    (void)lw_text_lines_word(&at);
    name = lw_text_lines_word(&at);
    count = lw_text_lines_word(&at);
    if (!name || !count)
        return lw_status_fail(err, LW_BAD_DATA, "line %u of its header is no element", reader->line);
    for (char *c = name; *c; c++) *c = (char)tolower((unsigned char)*c);
    reader->element = strcmp(name, "vertex") == 0     ? VERTEX
                      : strcmp(name, "face") == 0     ? FACE
                      : strcmp(name, "material") == 0 ? MATERIAL
                                                      : OTHER;
    if (reader->element == MATERIAL) reader->header->has_material = true;
    if (reader->element != OTHER) return write(reader, err, "element %s %s\n", name, count);
    /* Assimp keeps the last triangle of a strip */
    skip(reader, name, strcmp(name, "tristrips") == 0 ? "strips are not read: export faces" : "is not read");
    return write(reader, err, "element " SKIPPED_ELEMENT " %s\n", count);
}

/* The one comment that means something: "comment TextureFile wood.png". */
static enum lw_status read_comment(struct reader *reader, struct lw_error *err) {
    static const char key[] = "TextureFile";
    const char *at = reader->text + strlen("comment");
    while (*at == ' ' || *at == '\t') at++;
    if (strncasecmp(at, key, sizeof key - 1) != 0 || !isspace((unsigned char)at[sizeof key - 1]))
        return LW_OK;
    at += sizeof key - 1;
    while (*at == ' ' || *at == '\t') at++;
    return write(reader, err, "comment %s %s\n", key, at);
}

static bool has_keyword(const struct reader *reader, const char *keyword) {
    const size_t length = strlen(keyword);
    return strncasecmp(reader->text, keyword, length) == 0 &&
           (!reader->text[length] || isspace((unsigned char)reader->text[length]));
}

static enum lw_status read_format(struct reader *reader, struct lw_error *err) {
    for (char *c = reader->text; *c; c++) *c = (char)tolower((unsigned char)*c);
    reader->header->is_binary = strstr(reader->text, "binary") != NULL;
    return write(reader, err, "%s\n", reader->text);
}

static enum lw_status read_statement(struct reader *reader, struct lw_error *err) {
    if (!*reader->text || has_keyword(reader, "obj_info")) return LW_OK;
    if (has_keyword(reader, "comment")) return read_comment(reader, err);
    if (has_keyword(reader, "format")) return read_format(reader, err);
    if (has_keyword(reader, "element")) return read_element(reader, err);
    if (has_keyword(reader, "property")) return read_property(reader, err);
    return lw_status_fail(err, LW_BAD_DATA, "line %u of its header, \"%.40s\", is not known", reader->line,
                          reader->text);
}

enum lw_status lw_ply_header_read(struct lw_ply_header *header, const uint8_t *bytes, size_t size,
                                  struct lw_error *err) {
    struct reader reader = {
        .header = header, .bytes = bytes, .size = size, .at = skip_mark(bytes, size), .element = OTHER};
    *header = (struct lw_ply_header){0};
    if (!read_line(&reader) || !has_keyword(&reader, "ply"))
        return lw_status_fail(err, LW_BAD_DATA, "is no PLY file");
    if (write(&reader, err, "ply\n")) return err->status;
    while (read_line(&reader)) {
        if (has_keyword(&reader, "end_header")) {
            header->body = reader.at;
            /* Assimp skips one line's end more, which may be the body's first byte: it gets one of ours */
            return write(&reader, err, "end_header\n%s", header->is_binary ? "\n" : "");
        }
        if (read_statement(&reader, err)) return err->status;
    }
    return lw_status_fail(err, LW_BAD_DATA, "is cut short: its header has no end");
}

void lw_ply_header_finish(struct lw_ply_header *header) {
    free(header->text);
    *header = (struct lw_ply_header){0};
}
