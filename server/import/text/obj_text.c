#include "server/import/text/obj_text.h"

#include "common/scene/scene.h"
#include "server/import/mesh/mesh_builder.h"
#include "server/import/text_lines.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#define LIBRARIES_MAX 1000u /* statements */

enum { POSITION, UV, NORMAL, KINDS }; /* kinds of vertices, in the order in which a corner names them */
static const char *const kind_names[KINDS] = {"v", "vt", "vn"};

struct reader {
    struct lw_obj_text *obj;
    struct lw_text_lines lines;
    uint64_t count[KINDS]; /* vertices so far */
    /* the highest vertex that a corner names, and where: it may come later */
    uint64_t highest[KINDS];
    unsigned highest_line[KINDS];
    uint64_t face_count;
    unsigned unknown_line; /* the first statement's, if it is none of OBJ's */
    char unknown[LW_TEXT_LINES_KEYWORD_SIZE];
    bool smooth, known;
    uint64_t coloured_count; /* vertices with a colour */
    bool is_coloured;        /* some have one: the others get white, where Assimp makes them black */
};

static enum lw_status no_memory(struct lw_error *err) {
    return lw_status_fail(err, LW_NO_MEMORY, "out of memory for its text");
}

static enum lw_status write(struct lw_obj_text *obj, const char *text, struct lw_error *err) {
    const size_t length = strlen(text);
    if (!lw_mesh_builder_reserve((void **)&obj->text, &obj->capacity, obj->size + length, 1))
        return no_memory(err);
    memcpy(obj->text + obj->size, text, length);
    obj->size += length;
    return LW_OK;
}

static enum lw_status write_line(struct lw_obj_text *obj, const char *keyword, const char *rest,
                                 struct lw_error *err) {
    if (write(obj, keyword, err) || (*rest && (write(obj, " ", err) || write(obj, rest, err))) ||
        write(obj, "\n", err))
        return err->status;
    return LW_OK;
}

static void skip(struct reader *reader, const char *what, const char *why) {
    lw_skipped_add(&reader->obj->skipped, what, why, reader->lines.line);
}

/* ---- vertices ---- */

/* Cuts the line into at most `most` numbers, which stay words. *out_count: how many the line has.
 * Errors: a word that is no number. */
static enum lw_status read_numbers(struct reader *reader, int most, char *word[], double number[],
                                   int *out_count, struct lw_error *err) {
    char *at = reader->lines.rest, *next;
    *out_count = 0;
    while ((next = lw_text_lines_word(&at))) {
        double value;
        if (!lw_text_lines_number(next, &value))
            return lw_status_fail(err, LW_BAD_DATA, "line %u: %s: \"%.40s\" is no number", reader->lines.line,
                                  reader->lines.keyword, next);
        if (*out_count < most) {
            word[*out_count] = next;
            number[*out_count] = value;
        }
        ++*out_count;
    }
    return LW_OK;
}

/* Assimp takes nothing for a number that begins with a plus or a point. */
static enum lw_status write_number(struct lw_obj_text *obj, const char *word, struct lw_error *err) {
    if (*word == '+') word++;
    if (write(obj, *word == '.' || *word == ',' ? " 0" : " ", err)) return err->status;
    return write(obj, word, err);
}

static enum lw_status write_numbers(struct reader *reader, char *const word[], int count,
                                    struct lw_error *err) {
    if (write(reader->obj, reader->lines.keyword, err)) return err->status;
    for (int i = 0; i < count; i++)
        if (write_number(reader->obj, word[i], err)) return err->status;
    return write(reader->obj, "\n", err);
}

static void name_extra_numbers(struct reader *reader, int count, double fourth) {
    if (count > 6) skip(reader, "v", "numbers behind the colour are not read");
    if (count == 5) skip(reader, "v", "its two numbers behind the place are not read");
    if (count == 4 && fourth == 0) skip(reader, "v", "its weight is 0 and not read");
}

/* Three numbers. A fourth alone is a weight, which divides. Three more are a colour. */
static enum lw_status read_position(struct reader *reader, struct lw_error *err) {
    static char white[] = "1";
    char *word[6] = {0};
    double number[6] = {0};
    int count;
    if (read_numbers(reader, 6, word, number, &count, err)) return err->status;
    if (count < 3)
        return lw_status_fail(err, LW_BAD_DATA, "line %u: v has %d numbers, not three", reader->lines.line,
                              count);
    name_extra_numbers(reader, count, number[3]);
    reader->count[POSITION]++;
    reader->coloured_count += count >= 6;
    const bool is_weighted = count == 4 && number[3] != 0 && number[3] != 1;
    if (count < 6 && reader->is_coloured && !is_weighted) word[3] = word[4] = word[5] = white;
    return write_numbers(reader, word, word[5] ? 6 : is_weighted ? 4 : 3, err);
}

static enum lw_status read_uv(struct reader *reader, struct lw_error *err) {
    static char zero[] = "0";
    char *word[2] = {zero, zero};
    double number[2];
    int count;
    if (read_numbers(reader, 2, word, number, &count, err)) return err->status;
    if (count < 1) return lw_status_fail(err, LW_BAD_DATA, "line %u: vt has no number", reader->lines.line);
    if (count > 3) skip(reader, "vt", "its fourth number is not read");
    reader->count[UV]++;
    return write_numbers(reader, word, 2, err);
}

static enum lw_status read_normal(struct reader *reader, struct lw_error *err) {
    char *word[3];
    double number[3];
    int count;
    if (read_numbers(reader, 3, word, number, &count, err)) return err->status;
    if (count != 3)
        return lw_status_fail(err, LW_BAD_DATA, "line %u: vn has %d numbers, not three", reader->lines.line,
                              count);
    reader->count[NORMAL]++;
    return write_numbers(reader, word, 3, err);
}

/* ---- faces ---- */

/* An index counts from 1, or back from the last vertex so far. */
static enum lw_status check_index(struct reader *reader, int kind, long long index, struct lw_error *err) {
    if (index == 0)
        return lw_status_fail(err, LW_BAD_DATA, "line %u: a corner names %s 0; they count from 1",
                              reader->lines.line, kind_names[kind]);
    if (index < 0 && (uint64_t)-index > reader->count[kind])
        return lw_status_fail(err, LW_BAD_DATA, "line %u: %s %lld is out of range: there are %llu before it",
                              reader->lines.line, kind_names[kind], index,
                              (unsigned long long)reader->count[kind]);
    if (index > 0 && (uint64_t)index > reader->highest[kind]) {
        reader->highest[kind] = (uint64_t)index;
        reader->highest_line[kind] = reader->lines.line;
    }
    return LW_OK;
}

/* A corner is v, v/vt, v//vn or v/vt/vn; slashes without a number behind them are removed. */
static enum lw_status check_corner(struct reader *reader, char *corner, struct lw_error *err) {
    size_t length = strlen(corner);
    while (length > 1 && corner[length - 1] == '/') corner[--length] = 0;
    char *at = corner;
    for (int kind = 0; kind < KINDS; kind++) {
        char *end = at;
        long long index = 0;
        if (kind == POSITION || *at != '/') {
            index = strtoll(at, &end, 10);
            if (end == at) break;
            if (check_index(reader, kind, index, err)) return err->status;
        }
        if (!*end) return LW_OK;
        if (*end != '/') break;
        at = end + 1;
    }
    return lw_status_fail(err, LW_BAD_DATA, "line %u: \"%.40s\" is no corner of a face", reader->lines.line,
                          corner);
}

static enum lw_status read_face(struct reader *reader, struct lw_error *err) {
    struct lw_obj_text *obj = reader->obj;
    char *at = reader->lines.rest, *corner;
    const size_t start = obj->size;
    unsigned count = 0;
    if (write(obj, "f", err)) return err->status;
    for (; (corner = lw_text_lines_word(&at)); count++)
        if (check_corner(reader, corner, err) || write(obj, " ", err) || write(obj, corner, err))
            return err->status;
    if (count < 3) {
        obj->size = start;
        skip(reader, reader->lines.keyword, "a face of less than three corners has no area");
        return LW_OK;
    }
    reader->face_count++;
    return write(obj, "\n", err);
}

/* ---- materials, groups ---- */

static enum lw_status read_material(struct reader *reader, struct lw_error *err) {
    char text[32];
    uint32_t number;
    lw_text_lines_cut_comment(reader->lines.rest);
    if (reader->obj->material.count > LW_SCENE_MATERIALS_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "line %u: uses more than %u materials", reader->lines.line,
                              LW_SCENE_MATERIALS_MAX);
    if (lw_name_table_add(&reader->obj->material, reader->lines.rest, &number, err)) return err->status;
    snprintf(text, sizeof text, "%u", number);
    return write_line(reader->obj, "usemtl", text, err);
}

static enum lw_status read_library(struct reader *reader, struct lw_error *err) {
    struct lw_obj_text *obj = reader->obj;
    lw_text_lines_cut_comment(reader->lines.rest);
    for (uint32_t i = 0; i < obj->library_count; i++)
        if (strcmp(obj->library[i].names, reader->lines.rest) == 0) return LW_OK;
    if (obj->library_count == LIBRARIES_MAX || !*reader->lines.rest) {
        skip(reader, "mtllib", *reader->lines.rest ? "one too many" : "names no library");
        return LW_OK;
    }
    if (!lw_mesh_builder_reserve((void **)&obj->library, &obj->library_capacity, obj->library_count + 1ul,
                                 sizeof *obj->library))
        return no_memory(err);
    char *names = strdup(reader->lines.rest);
    if (!names) return no_memory(err);
    obj->library[obj->library_count++] =
        (struct lw_obj_text_library){.names = names, .line = reader->lines.line};
    return LW_OK;
}

static enum lw_status read_group(struct reader *reader, struct lw_error *err) {
    lw_text_lines_cut_comment(reader->lines.rest);
    size_t length = strlen(reader->lines.rest);
    while (length > 0 && reader->lines.rest[length - 1] == '\\')
        reader->lines.rest[--length] = 0; /* goes on */
    return write_line(reader->obj, reader->lines.keyword, reader->lines.rest, err);
}

static enum lw_status read_smoothing(struct reader *reader, struct lw_error *err) {
    (void)err;
    char *at = reader->lines.rest, *word = lw_text_lines_word(&at);
    double number = 0;
    if (word && (strcasecmp(word, "off") == 0 || strcasecmp(word, "on") == 0))
        number = strcasecmp(word, "on") == 0;
    else if (!word || !lw_text_lines_number(word, &number))
        skip(reader, "s", "is no smoothing group");
    reader->smooth |= number != 0;
    return LW_OK;
}

/* ---- unread statements ---- */

static const struct {
    const char *keyword, *why;
} unread[] = {
    {"p", "points are ignored: only triangles are lit"},
    {"l", "lines are ignored: only triangles are lit"},
#define FREE_FORM "free-form curves and surfaces are not read: export polygons"
    {"vp", FREE_FORM},
    {"cstype", FREE_FORM},
    {"deg", FREE_FORM},
    {"bmat", FREE_FORM},
    {"step", FREE_FORM},
    {"curv", FREE_FORM},
    {"curv2", FREE_FORM},
    {"surf", FREE_FORM},
    {"parm", FREE_FORM},
    {"trim", FREE_FORM},
    {"hole", FREE_FORM},
    {"scrv", FREE_FORM},
    {"sp", FREE_FORM},
    {"end", FREE_FORM},
    {"con", FREE_FORM},
    {"bzp", FREE_FORM},
    {"bsp", FREE_FORM},
    {"cdc", FREE_FORM},
    {"cdp", FREE_FORM},
    {"res", FREE_FORM},
    {"mg", FREE_FORM},
    {"ctech", FREE_FORM},
    {"stech", FREE_FORM},
#define ANOTHER "other files are not read by this statement"
    {"call", ANOTHER},
    {"csh", ANOTHER},
    {"shadow_obj", ANOTHER},
    {"trace_obj", ANOTHER},
    {"maplib", ANOTHER},
    {"usemap", ANOTHER},
#define DISPLAY "is for display and not read"
    {"bevel", DISPLAY},
    {"c_interp", DISPLAY},
    {"d_interp", DISPLAY},
    {"lod", DISPLAY},
};

static enum lw_status read_other(struct reader *reader, struct lw_error *err) {
    (void)err;
    for (size_t i = 0; i < sizeof unread / sizeof *unread; i++)
        if (strcmp(unread[i].keyword, reader->lines.keyword) == 0) {
            reader->known = true;
            skip(reader, reader->lines.keyword, unread[i].why);
            return LW_OK;
        }
    if (!reader->unknown_line) {
        reader->unknown_line = reader->lines.line;
        memcpy(reader->unknown, reader->lines.keyword, sizeof reader->unknown);
    }
    skip(reader, reader->lines.keyword, "is no statement of OBJ");
    return LW_OK;
}

/* ---- all ---- */

static const struct {
    const char *keyword;
    enum lw_status (*read)(struct reader *, struct lw_error *);
} statements[] = {
    {"v", read_position}, {"vt", read_uv},           {"vn", read_normal},      {"f", read_face},
    {"fo", read_face},    {"usemtl", read_material}, {"mtllib", read_library}, {"g", read_group},
    {"o", read_group},    {"s", read_smoothing},
};

static enum lw_status read_statement(struct reader *reader, struct lw_error *err) {
    for (size_t i = 0; i < sizeof statements / sizeof *statements; i++)
        if (strcmp(statements[i].keyword, reader->lines.keyword) == 0) {
            reader->known = true;
            return statements[i].read(reader, err);
        }
    return read_other(reader, err);
}

static enum lw_status check_all(const struct reader *reader, struct lw_error *err) {
    if (!reader->known)
        return lw_status_fail(err, LW_BAD_DATA, "is no OBJ file that can be read: line %u begins with \"%s\"",
                              reader->unknown_line, reader->unknown);
    if (!reader->face_count)
        return lw_status_fail(err, LW_BAD_DATA, "has no triangles: there is nothing to light");
    for (int kind = 0; kind < KINDS; kind++)
        if (reader->highest[kind] > reader->count[kind])
            return lw_status_fail(err, LW_BAD_DATA, "line %u: %s %llu is out of range: there are %llu",
                                  reader->highest_line[kind], kind_names[kind],
                                  (unsigned long long)reader->highest[kind],
                                  (unsigned long long)reader->count[kind]);
    return LW_OK;
}

static enum lw_status read_all(struct reader *reader, const uint8_t *bytes, size_t size,
                               struct lw_error *err) {
    lw_text_lines_init(&reader->lines, bytes, size);
    while (!err->status && lw_text_lines_next(&reader->lines)) (void)read_statement(reader, err);
    if (!err->status && reader->lines.out_of_memory) (void)no_memory(err);
    lw_text_lines_finish(&reader->lines);
    return err->status;
}

enum lw_status lw_obj_text_read(struct lw_obj_text *obj, const uint8_t *bytes, size_t size,
                                struct lw_error *err) {
    struct reader reader = {.obj = obj};
    *obj = (struct lw_obj_text){0};
    if (read_all(&reader, bytes, size, err)) return err->status;
    if (reader.coloured_count > 0 && reader.coloured_count < reader.count[POSITION]) {
        lw_obj_text_finish(obj);
        reader = (struct reader){.obj = obj, .is_coloured = true};
        if (read_all(&reader, bytes, size, err)) return err->status;
        lw_skipped_add(&obj->skipped, "v", "vertices without a colour beside some that have one are white",
                       1);
    }
    obj->smooth = reader.smooth && reader.count[NORMAL] == 0;
    return check_all(&reader, err);
}

void lw_obj_text_finish(struct lw_obj_text *obj) {
    for (uint32_t i = 0; i < obj->library_count; i++) free(obj->library[i].names);
    free(obj->library);
    free(obj->text);
    lw_name_table_finish(&obj->material);
    *obj = (struct lw_obj_text){0};
}
