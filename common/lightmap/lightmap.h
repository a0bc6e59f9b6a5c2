/* lightmap.h: gives every mesh its lightmap UVs and every atlas its size.
 * Flow:    scene (imported or built in) -> [lightmap] -> package
 * Threads: one call per scene; meshes are worked on in parallel inside.
 *
 * A chart is a connected piece of surface, unfolded with bounded stretch. Charts own blocks: two charts never
 * touch one block of 4 x 4 texels, and a chart stays LW_LIGHTMAP_GUTTER texels away from every block of
 * another. So bilinear look-ups at mip levels 0, 1 and 2 never mix two charts.
 * Exception: neighbouring slivers, charts no wider than 8 texels and small hollow ones (rings, arcs), share a
 * rectangle of blocks. At level 0 no texel is read by two of them; levels 1 and 2 mix them
 * (lw_lightmap_coarsest). Parts of one chart that are far apart in space keep apart in the same way.
 * No chart runs across a hard edge, where light may change from one texel to the next. A file's own UV set is
 * free of overlaps, but gives no such promise about blocks or lookups.
 */
#ifndef LW_COMMON_LIGHTMAP_H
#define LW_COMMON_LIGHTMAP_H

#include "common/scene/scene.h"

#define LW_LIGHTMAP_BLOCK     4u /* texels; chart rectangles are aligned to it */
#define LW_LIGHTMAP_GUTTER    2u /* texels */
#define LW_LIGHTMAP_LEVEL_MAX 2u /* its texels are as large as a block */

/* Limits for a command line. Scenes of any unit, from micrometres to kilometres, need the whole range. */
#define LW_LIGHTMAP_DENSITY_MIN 1e-6 /* texels per metre */
#define LW_LIGHTMAP_DENSITY_MAX 1e6
#define LW_LIGHTMAP_SIDE_MIN    16u /* for atlas_side_max, texels */

/* Defaults; plain numbers, so that help texts print them. Reasons: docs/lab/density.md. */
#define LW_LIGHTMAP_DENSITY_DEFAULT 5       /* texels per metre */
#define LW_LIGHTMAP_ACROSS          16      /* texels across a thing, if they are no more in all than ... */
#define LW_LIGHTMAP_TEXELS_FINE     100000  /* ... this: a limit of the cost of finer light */
#define LW_LIGHTMAP_TEXELS_MIN      20000   /* a scene of a few square metres has a higher density */
#define LW_LIGHTMAP_TEXELS_MAX      1000000 /* or half the triangles of all objects, if that is more */
#define LW_LIGHTMAP_SIDE_DEFAULT    4096    /* texels */

/* For --help of every program that has the options. */
/* clang-format off */
#define LW_LIGHTMAP_NUMBER_(value) #value
#define LW_LIGHTMAP_NUMBER(value)  LW_LIGHTMAP_NUMBER_(value)
#define LW_LIGHTMAP_DENSITY_HELP                                                                            \
    "texels per metre of the lightmaps (default: " LW_LIGHTMAP_NUMBER(LW_LIGHTMAP_DENSITY_DEFAULT)          \
    "; more where a scene would have under " LW_LIGHTMAP_NUMBER(LW_LIGHTMAP_TEXELS_MIN)                     \
    " texels, and " LW_LIGHTMAP_NUMBER(LW_LIGHTMAP_ACROSS) " across a thing of mean size while the scene "  \
    "has under " LW_LIGHTMAP_NUMBER(LW_LIGHTMAP_TEXELS_FINE) ")"
#define LW_LIGHTMAP_TEXELS_HELP                                                                             \
    "texels of all lightmaps at most, about; a scene that needs more gets fewer per metre (default: none "  \
    "with --texels-per-metre, else " LW_LIGHTMAP_NUMBER(LW_LIGHTMAP_TEXELS_MAX)                             \
    " or half the triangles, whichever is more)"
#define LW_LIGHTMAP_DENSITY_OF_HELP                                                                         \
    "texels per metre of the objects of these names, as multiples of the others' (floor=2,street=0.5; from " \
    "1/64 to 8)"
/* clang-format on */

struct lw_lightmap_desc {
    /* 0: LW_LIGHTMAP_DENSITY_DEFAULT; what gives LW_LIGHTMAP_TEXELS_MIN, if that is more; what gives
     * LW_LIGHTMAP_ACROSS texels to the mean size of things (lightmap_things.h), if that is more, or
     * LW_LIGHTMAP_TEXELS_FINE, if that is less. */
    float texels_per_metre;
    /* Covered texels of all objects, about. A scene that would have more gets a lower density, the same for
     * all objects; only an object that would take over half of the texels, such as a ground to the horizon,
     * gets less than the others. 0: no bound with texels_per_metre; else LW_LIGHTMAP_TEXELS_MAX, or half the
     * triangles of all objects if that is more. */
    uint32_t texels_max;
    /* texels; 0: LW_LIGHTMAP_SIDE_DEFAULT. A mesh that needs more gets a lower density. */
    uint32_t atlas_side_max;
    unsigned threads; /* 0: all */
    /* Objects that are to have more or fewer texels per metre (lightmap_density.h); NULL: none. Counts within
     * texels_max. */
    const char *density_of;
};

/** Result for one mesh. */
struct lw_lightmap_report {
    uint32_t mesh;
    uint32_t atlas_width, atlas_height;
    uint32_t chart_count;
    uint32_t texels_covered;        /* texels whose square overlaps a chart, backs included */
    float coverage;                 /* texels_covered / (atlas_width * atlas_height) */
    float stretch_rms, stretch_max; /* texture stretch (Sander et al. 2001), 1 = isometric up to scale */
    float texels_per_metre;         /* reached */
    bool from_file;                 /* the file's second UV set was in [0,1], free of overlaps, and used */
    bool capped;                    /* atlas_side_max lowered its density */
    bool bounded;                   /* the number of texels did, to under density_wanted */
    float density_wanted;           /* texels per metre */
    uint32_t texels_max;            /* the scene's; 0: no bound */
};

/** Builds lightmap UVs for every mesh that an object uses: from UV set 1 where it is fit, else by unwrapping.
 * Vertices on chart borders are duplicated, so the meshes' arrays are replaced.
 * out_report   mesh_count entries, or NULL
 * Errors: LW_NO_MEMORY; LW_BAD_DATA naming a mesh whose charts cannot fit atlas_side_max at any density;
 * LW_USAGE for density_of. */
LW_MUST_CHECK enum lw_status lw_lightmap_build(struct lw_scene *scene, const struct lw_lightmap_desc *desc,
                                               struct lw_lightmap_report *out_report, struct lw_error *err);

/** The coarsest level, up to LW_LIGHTMAP_LEVEL_MAX, on which bilinear look-ups of a triangle read light of
 * its own chart alone: slivers share texels of levels 1 and 2, so that those show light of elsewhere. Every
 * triangle has level 0. out_level: per triangle of a mesh with lightmap UVs. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_coarsest(const struct lw_mesh *mesh, uint8_t *out_level);

/** Counts texels that two different chart pieces both cover by area (0 for a correct layout). For tests. */
uint64_t lw_lightmap_overlaps(const struct lw_mesh *mesh);

/** Counts texels that bilinear lookups of two places read which lie more than four texels apart in space (0,
 * or nearly, for a correct layout): light of either place would show at both. For tests. */
uint64_t lw_lightmap_mixed(const struct lw_mesh *mesh);

#endif
