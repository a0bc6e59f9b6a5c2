#include "server/import/text/mtl_file.h"

#include "common/scene/scene.h"
#include "server/import/mesh/mesh_builder.h"
#include "server/import/text_lines.h"

#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

struct reader {
    struct lw_mtl_file *mtl;
    struct lw_text_lines lines;
    struct lw_mtl_material *material; /* the lines' material; NULL: none, or one that does not count */
    bool opacity_is_d;                /* d was there: Tr does not count */
};

struct statement {
    const char *keyword;
    void (*read)(struct reader *, const struct statement *);
    int which;
};

static void skip(struct reader *reader, const char *what, const char *why) {
    lw_skipped_add(&reader->mtl->skipped, what, why, reader->lines.line);
}

static void skip_statement(struct reader *reader, const struct statement *statement, const char *why) {
    skip(reader, statement->keyword, why);
}

/* ---- colours ---- */

/* Reads the numbers of the line: -1 if there is another word among them. */
static int read_numbers(struct reader *reader, float *out, int most) {
    char *at = reader->lines.rest, *word;
    int count = 0;
    for (; (word = lw_text_lines_word(&at)); count++) {
        double number;
        if (!lw_text_lines_number(word, &number)) return -1;
        if (count < most) out[count] = (float)number;
    }
    return count;
}

/* Three numbers, or one for all. */
static bool read_colour(struct reader *reader, const struct statement *statement, float out[3]) {
    char kind[9];
    float c[3];
    memcpy(kind, reader->lines.rest, strnlen(reader->lines.rest, sizeof kind - 1));
    kind[strnlen(reader->lines.rest, sizeof kind - 1)] = 0;
    if (strncasecmp(kind, "spectral", 8) == 0) {
        skip_statement(reader, statement, "spectral curves are not read");
        return false;
    }
    if (strncasecmp(kind, "xyz", 3) == 0) {
        skip_statement(reader, statement, "CIE XYZ colours are not read");
        return false;
    }
    const int count = read_numbers(reader, c, 3);
    if (count != 1 && count < 3) {
        skip_statement(reader, statement, "has not three numbers: is not read");
        return false;
    }
    if (count > 3) skip_statement(reader, statement, "numbers behind the third are not read");
    for (int i = 0; i < 3; i++) out[i] = count == 1 ? c[0] : c[i];
    return true;
}

static void read_material_colour(struct reader *reader, const struct statement *statement) {
    if (read_colour(reader, statement, reader->material->colour[statement->which]))
        reader->material->has_colour[statement->which] = true;
}

/* White changes nothing: light that passes keeps its colour here. */
static void read_filter(struct reader *reader, const struct statement *statement) {
    float c[3];
    if (read_colour(reader, statement, c) && (c[0] != 1 || c[1] != 1 || c[2] != 1))
        skip_statement(reader, statement, "coloured glass is not read: light that passes keeps its colour");
}

static void read_opacity(struct reader *reader, const struct statement *statement) {
    const bool turned = statement->which;
    float value;
    if (strncasecmp(reader->lines.rest, "-halo", 5) == 0) {
        skip_statement(reader, statement, "-halo is not read: the surface stays opaque");
        return;
    }
    if (read_numbers(reader, &value, 1) != 1) {
        skip_statement(reader, statement, "has not one number: is not read");
        return;
    }
    if (turned && reader->opacity_is_d) return;
    reader->opacity_is_d |= !turned;
    reader->material->opacity = turned ? 1 - value : value;
    reader->material->has_opacity = true;
}

/* ---- maps ---- */

/* The options of a map line that are left, and the one that is read. */
struct options {
    struct reader *reader;
    struct lw_mtl_map *map;
    char *at; /* the first word that is not read */
    const char *name;
};

/* The word at `at`, without cutting it off: options are words, but a path may hold blanks. */
static size_t word_length(const char *at) { return strcspn(at, " \t\v\f"); }

static char *after_word(char *at) {
    at += word_length(at);
    return at + strspn(at, " \t\v\f");
}

static bool is_word(const char *at, const char *word) {
    const size_t length = word_length(at);
    return length == strlen(word) && strncasecmp(at, word, length) == 0;
}

/* At most `most` numbers. A path follows, or the next option. */
static int option_numbers(struct options *options, float *out, int most) {
    int count = 0;
    for (; count < most && *options->at; count++) {
        char word[64];
        double number;
        const size_t length = word_length(options->at);
        if (length >= sizeof word) break;
        memcpy(word, options->at, length);
        word[length] = 0;
        /* the last word is the path, whatever it looks like */
        if (!lw_text_lines_number(word, &number) || !*after_word(options->at)) break;
        out[count] = (float)number;
        options->at = after_word(options->at);
    }
    return count;
}

static void skip_option(struct options *options, const char *why) {
    skip(options->reader, options->name, why);
}

static bool are_finite(const float *x, int count) {
    for (int i = 0; i < count; i++)
        if (!isfinite(x[i])) return false;
    return true;
}

static void read_transform(struct options *options, float out[2], bool is_scale) {
    float uvw[3] = {out[0], out[1], 0};
    const int count = option_numbers(options, uvw, 3);
    if (count == 0 || !are_finite(uvw, count)) {
        skip_option(options, "has no number: is not read");
        return;
    }
    if (is_scale && (uvw[0] == 0 || uvw[1] == 0))
        skip_option(options, "a scale of 0 is read: the texture is one colour there");
    memcpy(out, uvw, 2 * sizeof *out);
}

static void read_scale(struct options *options) { read_transform(options, options->map->scale, true); }
static void read_offset(struct options *options) { read_transform(options, options->map->offset, false); }

static void read_turbulence(struct options *options) {
    float uvw[3] = {0};
    (void)option_numbers(options, uvw, 3);
    if (uvw[0] != 0 || uvw[1] != 0 || uvw[2] != 0) skip_option(options, "turbulence is not read");
}

static void read_range(struct options *options) {
    float range[2] = {0, 1};
    const int count = option_numbers(options, range, 2);
    if (count == 0 || !are_finite(range, count)) {
        skip_option(options, "has no number: is not read");
        return;
    }
    options->map->base = range[0];
    options->map->gain = range[1];
}

/* -1: neither on nor off. */
static int read_switch(struct options *options) {
    const int on = is_word(options->at, "on") ? 1 : is_word(options->at, "off") ? 0 : -1;
    if (on >= 0) options->at = after_word(options->at);
    if (on < 0) skip_option(options, "is neither on nor off: is not read");
    return on;
}

static void read_clamp(struct options *options) { options->map->clamp = read_switch(options) == 1; }

static void read_correction(struct options *options) {
    if (read_switch(options) == 1) skip_option(options, "colour correction is not read");
}

static void read_blending(struct options *options) {
    if (read_switch(options) == 0) skip_option(options, "is not read: pictures are always filtered");
}

static void read_channel(struct options *options) {
    const char channel = (char)tolower((unsigned char)*options->at);
    const bool is_letter = word_length(options->at) == 1;
    if (is_letter) options->at = after_word(options->at);
    if (is_letter && strchr("rgbml", channel))
        options->map->channel = channel;
    else
        skip_option(options, "is none of r, g, b, m and l: is not read");
}

static void skip_number(struct options *options, const char *why) {
    float ignored;
    (void)option_numbers(options, &ignored, 1);
    skip_option(options, why);
}

static void read_bump_factor(struct options *options) {
    float factor = 1;
    if (option_numbers(options, &factor, 1) == 0 || !isfinite(factor))
        skip_option(options, "has no number: is not read");
    else
        options->map->bump = factor;
}
static void read_boost(struct options *options) {
    skip_number(options, "is not read: pictures keep their sharpness");
}
static void read_resolution(struct options *options) {
    skip_number(options, "is not read: pictures keep their size");
}

static void read_type(struct options *options) {
    if (*after_word(options->at)) options->at = after_word(options->at);
    skip_option(options, "is not read: the texture lies by its texture coordinates");
}

static void read_colour_space(struct options *options) {
    const bool is_srgb = is_word(options->at, "srgb");
    if (*after_word(options->at)) options->at = after_word(options->at);
    if (!is_srgb) skip_option(options, "is not read: colours of pictures are sRGB");
}

static const struct {
    const char *name;
    void (*read)(struct options *);
} map_options[] = {
    {"-s", read_scale},           {"-o", read_offset},
    {"-t", read_turbulence},      {"-mm", read_range},
    {"-clamp", read_clamp},       {"-cc", read_correction},
    {"-imfchan", read_channel},   {"-type", read_type},
    {"-bm", read_bump_factor},    {"-blendu", read_blending},
    {"-blendv", read_blending},   {"-boost", read_boost},
    {"-texres", read_resolution}, {"-colorspace", read_colour_space},
};

/* A word like -frob that is no option that we know; "-1.png" and "-a/b" are paths. */
static bool looks_like_option(const char *at) {
    const size_t length = word_length(at);
    size_t i = 1;
    while (i < length && isalpha((unsigned char)at[i])) i++;
    return *at == '-' && length > 1 && i == length && *after_word((char *)at);
}

static void read_unknown_option(struct options *options) {
    char word[LW_TEXT_LINES_KEYWORD_SIZE];
    float ignored[8];
    const size_t length = word_length(options->at);
    memcpy(word, options->at, length < sizeof word ? length : sizeof word - 1);
    word[length < sizeof word ? length : sizeof word - 1] = 0;
    options->name = word;
    options->at = after_word(options->at);
    if (is_word(options->at, "on") || is_word(options->at, "off")) options->at = after_word(options->at);
    (void)option_numbers(options, ignored, 8);
    skip_option(options, "is no option of a map that is known: is not read");
}

static bool read_option(struct options *options) {
    for (size_t i = 0; i < sizeof map_options / sizeof *map_options; i++)
        if (is_word(options->at, map_options[i].name)) {
            options->name = map_options[i].name;
            options->at = after_word(options->at);
            map_options[i].read(options);
            return true;
        }
    if (!looks_like_option(options->at)) return false;
    read_unknown_option(options);
    return true;
}

static void cut_quotes(char *path) {
    const size_t length = strlen(path);
    if (length < 2 || path[0] != '"' || path[length - 1] != '"') return;
    memmove(path, path + 1, length - 2);
    path[length - 2] = 0;
}

static void read_map(struct reader *reader, const struct statement *statement) {
    struct lw_mtl_map *map = &reader->material->map[statement->which];
    free(map->path);
    *map = (struct lw_mtl_map){.scale = {1, 1}, .gain = 1, .bump = 1};
    struct options options = {.reader = reader, .map = map, .at = reader->lines.rest};
    lw_text_lines_cut_comment(reader->lines.rest);
    while (read_option(&options)) {
    }
    cut_quotes(options.at);
    if (!*options.at) {
        skip_statement(reader, statement, "names no picture");
        return;
    }
    const bool is_colour = statement->which == LW_MTL_MAP_DIFFUSE || statement->which == LW_MTL_MAP_EMISSION;
    const bool is_relief = statement->which == LW_MTL_MAP_BUMP || statement->which == LW_MTL_MAP_NORMAL;
    if (map->channel && (is_colour || is_relief))
        skip(reader, "-imfchan", "is read of map_d, map_Pr and map_Pm alone");
    if (map->bump != 1 && !is_relief) skip(reader, "-bm", "is read of bump and norm alone");
    map->path = strdup(options.at);
    if (!map->path) reader->lines.out_of_memory = true;
}

static void read_number(struct reader *reader, const struct statement *statement) {
    float value;
    if (read_numbers(reader, &value, 1) < 1) {
        skip_statement(reader, statement, "has no number: is not read");
        return;
    }
    reader->material->number[statement->which] = value;
    reader->material->has_number[statement->which] = true;
}

/* ---- the rest ---- */

/* Statements without use here, which every exporter writes. */
static void read_unused(struct reader *reader, const struct statement *statement) {
    float ignored;
    if (read_numbers(reader, &ignored, 1) < 1)
        skip_statement(reader, statement, "has no number: is not read");
}

/* Sheen, a clear coat, anisotropy: 0 says that there is none. */
static void read_unshown(struct reader *reader, const struct statement *statement) {
    float share = 0;
    if (read_numbers(reader, &share, 1) < 1)
        skip_statement(reader, statement, "has no number: is not read");
    else if (share != 0)
        skip_statement(reader, statement, "is not shown");
}

static void read_ambient(struct reader *reader, const struct statement *statement) {
    float ignored[3];
    (void)read_colour(reader, statement, ignored);
}

static void read_nothing(struct reader *reader, const struct statement *statement) {
    (void)reader, (void)statement;
}

static const struct statement statements[] = {
    {"Kd", read_material_colour, LW_MTL_DIFFUSE},
    {"Ks", read_material_colour, LW_MTL_SPECULAR},
    {"Ke", read_material_colour, LW_MTL_EMISSION},
    {"d", read_opacity, 0},
    {"Tr", read_opacity, 1},
    {"Tf", read_filter, 0},
    {"map_Kd", read_map, LW_MTL_MAP_DIFFUSE},
    {"map_Ke", read_map, LW_MTL_MAP_EMISSION},
    {"map_emissive", read_map, LW_MTL_MAP_EMISSION},
    {"map_d", read_map, LW_MTL_MAP_OPACITY},
    {"map_opacity", read_map, LW_MTL_MAP_OPACITY},
    {"bump", read_map, LW_MTL_MAP_BUMP},
    {"map_bump", read_map, LW_MTL_MAP_BUMP},
    {"norm", read_map, LW_MTL_MAP_NORMAL},
    {"map_Kn", read_map, LW_MTL_MAP_NORMAL},
    {"map_Pr", read_map, LW_MTL_MAP_ROUGHNESS},
    {"map_Pm", read_map, LW_MTL_MAP_METALNESS},
    {"Ka", read_ambient, 0},
    {"Ns", read_number, LW_MTL_EXPONENT},
    {"Pr", read_number, LW_MTL_ROUGHNESS},
    {"Pm", read_number, LW_MTL_METALNESS},
    {"Ni", read_unused, 0},
    {"illum", read_unused, 0},
    {"Ps", read_unshown, 0},
    {"Pc", read_unshown, 0},
    {"Pcr", read_unused, 0},
    {"aniso", read_unshown, 0},
    {"anisor", read_unused, 0},
    {"map_Ka", read_nothing, 0},
    {"map_Ks", read_nothing, 0},
    {"map_Ns", read_nothing, 0},
    {"map_Ps", read_nothing, 0},
};

static void read_statement(struct reader *reader) {
    const struct statement *statement = NULL;
    for (size_t i = 0; i < sizeof statements / sizeof *statements && !statement; i++)
        if (strcasecmp(statements[i].keyword, reader->lines.keyword) == 0) statement = &statements[i];
    if (!statement)
        skip(reader, reader->lines.keyword, "is not read");
    else if (reader->material)
        statement->read(reader, statement);
    else if (reader->mtl->name.count == 0)
        skip(reader, statement->keyword, "stands before the first newmtl");
}

/* The first of a name counts, here and among libraries. */
static enum lw_status begin_material(struct reader *reader, struct lw_error *err) {
    struct lw_mtl_file *mtl = reader->mtl;
    uint32_t number, before = mtl->name.count;
    lw_text_lines_cut_comment(reader->lines.rest);
    if (before == LW_SCENE_MATERIALS_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has more than %u materials", LW_SCENE_MATERIALS_MAX);
    if (!lw_mesh_builder_reserve((void **)&mtl->material, &mtl->capacity, before + 1ul,
                                 sizeof *mtl->material))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for materials");
    if (lw_name_table_add(&mtl->name, reader->lines.rest, &number, err)) return err->status;
    reader->material = NULL;
    reader->opacity_is_d = false;
    if (number < before) {
        skip(reader, "newmtl", "a name that was there before: the first one counts");
        return LW_OK;
    }
    reader->material = &mtl->material[number];
    *reader->material = (struct lw_mtl_material){.opacity = 1};
    return LW_OK;
}

enum lw_status lw_mtl_file_read(struct lw_mtl_file *mtl, const uint8_t *bytes, size_t size,
                                struct lw_error *err) {
    struct reader reader = {.mtl = mtl};
    *mtl = (struct lw_mtl_file){0};
    if (lw_text_lines_is_wide(bytes, size))
        return lw_status_fail(err, LW_BAD_DATA, "is UTF-16: save it as UTF-8");
    lw_text_lines_init(&reader.lines, bytes, size);
    while (!err->status && lw_text_lines_next(&reader.lines)) {
        if (strcmp(reader.lines.keyword, "newmtl") == 0)
            (void)begin_material(&reader, err);
        else
            read_statement(&reader);
    }
    if (!err->status && reader.lines.out_of_memory)
        lw_status_fail(err, LW_NO_MEMORY, "out of memory for materials");
    lw_text_lines_finish(&reader.lines);
    return err->status;
}

void lw_mtl_file_finish(struct lw_mtl_file *mtl) {
    for (uint32_t i = 0; i < mtl->name.count; i++)
        for (int m = 0; m < LW_MTL_MAPS; m++) free(mtl->material[i].map[m].path);
    free(mtl->material);
    lw_name_table_finish(&mtl->name);
    *mtl = (struct lw_mtl_file){0};
}
