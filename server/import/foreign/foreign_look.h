/* foreign_look.h: how a material of a file looks, in one shape for all formats: from Assimp, or for OBJ from
 * its libraries.
 * Threads: values only. */
#ifndef LW_IMPORT_FOREIGN_FOREIGN_LOOK_H
#define LW_IMPORT_FOREIGN_FOREIGN_LOOK_H

#include "server/import/foreign/foreign_import.h"

enum lw_foreign_colour { LW_FOREIGN_DIFFUSE, LW_FOREIGN_SPECULAR, LW_FOREIGN_EMISSION, LW_FOREIGN_COLOURS };

/** A texture of a material, before its picture is read. */
struct lw_foreign_map {
    bool there;
    struct aiString path;
    const char *folder; /* the path's base, from the scene's folder on; "": that folder */
    unsigned uv_set;
    uint8_t wrap_s, wrap_t;
    float transform[6];
    float base, gain; /* values of the picture are base + gain x */
    char channel;     /* an opacity map's: r, g, b, m (the alpha), l (the brightness); 0: not said */
};

struct lw_foreign_look {
    struct aiString name;
    bool is_default; /* for surfaces without a material */
    bool stated_two_sided;
    bool has_colour[LW_FOREIGN_COLOURS];
    float colour[LW_FOREIGN_COLOURS][3]; /* as the file has them */
    float opacity;
    struct lw_foreign_map colour_map, emission_map, opacity_map;

    bool has_metalness, has_roughness;
    float metalness, roughness; /* as the file has them */
    float exponent;             /* for Phong's highlight; below 0: not said */
    struct lw_foreign_map metalness_map, roughness_map, relief_map;
    float relief;   /* factor of the heights, or of the slopes of normals */
    bool is_normal; /* the relief map is of normals; else the picture decides */
};

/** The look of a material of Assimp's. Errors: LW_BAD_DATA: a texture's transform is not finite. */
LW_MUST_CHECK enum lw_status lw_foreign_look_read(const struct lw_foreign_import *import, unsigned index,
                                                  struct lw_foreign_look *out, struct lw_error *err);

#endif
