/* mtl_file.h: reads a material library of OBJ. docs/importing_other.md says which statements are read or
 * reported.
 * Flow:    bytes of the library -> [mtl_file] -> obj_materials
 * Threads: a library belongs to one import. */
#ifndef LW_IMPORT_TEXT_MTL_FILE_H
#define LW_IMPORT_TEXT_MTL_FILE_H

#include "server/import/text/name_table.h"
#include "server/import/text/skipped.h"

enum lw_mtl_colour { LW_MTL_DIFFUSE, LW_MTL_SPECULAR, LW_MTL_EMISSION, LW_MTL_COLOURS };
enum lw_mtl_map_kind {
    LW_MTL_MAP_DIFFUSE,
    LW_MTL_MAP_EMISSION,
    LW_MTL_MAP_OPACITY,
    LW_MTL_MAP_ROUGHNESS,
    LW_MTL_MAP_METALNESS,
    LW_MTL_MAP_BUMP,   /* heights, or as some write it normals */
    LW_MTL_MAP_NORMAL, /* normals */
    LW_MTL_MAPS
};
enum lw_mtl_number { LW_MTL_ROUGHNESS, LW_MTL_METALNESS, LW_MTL_EXPONENT, LW_MTL_NUMBERS };

struct lw_mtl_map {
    char *path;                /* as it stands there; NULL: no map */
    float scale[2], offset[2]; /* texture coordinates, v up: scale x + offset */
    float base, gain;          /* values: base + gain x */
    float bump;                /* -bm: of heights, or of the slopes of normals */
    bool clamp;
    char channel; /* r, g, b, m (the alpha), l (the brightness); 0: not said */
};

struct lw_mtl_material {
    bool has_colour[LW_MTL_COLOURS], has_opacity, has_number[LW_MTL_NUMBERS];
    float number[LW_MTL_NUMBERS];    /* as they stand there */
    float colour[LW_MTL_COLOURS][3]; /* the file's values, of which only the syntax is checked */
    float opacity;
    struct lw_mtl_map map[LW_MTL_MAPS];
};

struct lw_mtl_file {
    struct lw_name_table name; /* the materials' */
    struct lw_mtl_material *material;
    size_t capacity;
    struct lw_skipped skipped;
};

/** finish() also after failure. Errors: LW_BAD_DATA (UTF-16, too many materials); LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_mtl_file_read(struct lw_mtl_file *mtl, const uint8_t *bytes, size_t size,
                                              struct lw_error *err);
void lw_mtl_file_finish(struct lw_mtl_file *mtl);

#endif
