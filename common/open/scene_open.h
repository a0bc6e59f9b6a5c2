/* scene_open.h: the one way in which programs open a scene, with the options that they share for it.
 * Flow:    command line, SCENE -> [scene_open: import in a process of its own, overrides] -> scene
 * Threads: main() only. */
#ifndef LW_COMMON_SCENE_OPEN_H
#define LW_COMMON_SCENE_OPEN_H

#include "common/base/options.h"
#include "common/lightmap/lightmap.h"
#include "common/open/import_spawn.h"

/* The default angular diameter of directional lights: the sun's. */
#define LW_SCENE_OPEN_SUN_DIAMETER_DEG 0.53

/* Radiance of the even sky of scenes without a light, where that is asked for, W/(m^2 sr). */
#define LW_SCENE_OPEN_PLAIN_SKY 1.0f

/** Values of the shared options. {0} with sun_angle_deg set to the constant above is all defaults. */
struct lw_scene_open {
    const char *path;        /* .lwscene, any format that lightwell-import reads, or "builtin:NAME" */
    double texels_per_metre; /* 0: the importer's default */
    const char *density_of;  /* for some objects, as multiples (lightmap_density.h); or NULL */
    int64_t texels_max;      /* 0: the importer's default */
    int64_t atlas_side_max;  /* texels; 0: the importer's default */
    int64_t threads;         /* 0: all */
    double import_seconds;   /* processor time of the importer; 0: its default */
    int64_t picture_texels;  /* 0: the importer's default */
    int materials;           /* enum lw_import_spawn_materials */
    bool lightmap_unused;    /* nothing is said about how coarse it is */
    bool sky_given, sun_angle_given;
    float sky[3];            /* W/(m^2 sr) */
    const char *environment; /* an equirectangular EXR, in place of the scene's; or NULL */
    double sun_angle_deg;
    bool plain_sky;             /* where nothing shines: a sky of LW_SCENE_OPEN_PLAIN_SKY */
    const _Atomic bool *cancel; /* may be NULL */
};

/** The rows of an option table (common/base/options.h) that fill these settings. open: a pointer to a
 * struct lw_scene_open. */
/* clang-format off */
#define LW_SCENE_OPEN_OPTIONS(open)                                                                         \
    {"texels-per-metre", "D", LW_LIGHTMAP_DENSITY_HELP, LW_OPTION_REAL, &(open)->texels_per_metre,          \
     LW_LIGHTMAP_DENSITY_MIN, LW_LIGHTMAP_DENSITY_MAX, NULL},                                               \
    {"density-of", "NAME=FACTOR,...", LW_LIGHTMAP_DENSITY_OF_HELP, LW_OPTION_STRING, &(open)->density_of,   \
     0, 0, NULL},                                                                                           \
    {"max-texels", "N", LW_LIGHTMAP_TEXELS_HELP, LW_OPTION_INT, &(open)->texels_max, 1, LW_SCENE_TEXELS_MAX,\
     NULL},                                                                                                 \
    {"atlas-max", "N", "longest side of an atlas, texels (default "                                         \
     LW_LIGHTMAP_NUMBER(LW_LIGHTMAP_SIDE_DEFAULT) ")", LW_OPTION_INT,                                       \
     &(open)->atlas_side_max, LW_LIGHTMAP_SIDE_MIN, LW_SCENE_ATLAS_SIDE_MAX, NULL},                         \
    {"threads", "N", "worker threads (default: all processors)", LW_OPTION_INT, &(open)->threads, 1, 1024,  \
     NULL},                                                                                                 \
    {"import-seconds", "S", LW_IMPORT_SPAWN_SECONDS_HELP, LW_OPTION_REAL, &(open)->import_seconds, 1,       \
     LW_IMPORT_SPAWN_SECONDS_MAX, NULL},                                                                    \
    {"picture-texels", "N", LW_IMPORT_SPAWN_PICTURES_HELP, LW_OPTION_INT, &(open)->picture_texels, 1,       \
     1e9, NULL},                                                                                            \
    {"materials", LW_IMPORT_SPAWN_MATERIALS, LW_IMPORT_SPAWN_MATERIALS_HELP, LW_OPTION_CHOICE,              \
     &(open)->materials, 0, 0, NULL},                                                                       \
    {"sky", "R,G,B", "radiance of the sky, W/(m^2 sr), instead of the scene's", LW_OPTION_RGB,              \
     (open)->sky, 0, 1e9, &(open)->sky_given},                                                              \
    {"environment", "FILE.exr", "equirectangular radiance around the scene, W/(m^2 sr), on top of the sky", \
     LW_OPTION_STRING, &(open)->environment, 0, 0, NULL},                                                   \
    {"sun-angle", "DEG", "angular diameter of directional lights (default: the file's, else "               \
     LW_LIGHTMAP_NUMBER(LW_SCENE_OPEN_SUN_DIAMETER_DEG) ")",                                                \
     LW_OPTION_REAL, &(open)->sun_angle_deg, 0, 90, &(open)->sun_angle_given}
/* clang-format on */

/** Whether text is meant as a scene where a server's address is expected: it is an existing file, is called
 * like a file of a scene, or begins with "builtin:". */
bool lw_scene_open_is_scene(const char *text);

/** Opens a scene. Overrides become part of the scene, and of the package that clients get.
 * Errors: as lw_import_spawn(); LW_BAD_DATA where nothing shines. */
LW_MUST_CHECK enum lw_status lw_scene_open(const struct lw_scene_open *open, struct lw_scene **out_scene,
                                           struct lw_error *err);

#endif
