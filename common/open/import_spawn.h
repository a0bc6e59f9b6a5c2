/* import_spawn.h: gets a scene without outside files in this process. lightwell-import reads the files in a
 * process of its own, and the strict package reader reads its output.
 * Flow:    SCENE -> [lightwell-import] -> temporary .lwscene -> scene
 * Threads: one call at a time per process is meant, any thread; it waits for the importer. */
#ifndef LW_IMPORT_SPAWN_H
#define LW_IMPORT_SPAWN_H

#include "common/scene/scene.h"

#include <signal.h>
#include <stdint.h>

#define LW_IMPORT_SPAWN_MEMORY_MAX (16ull << 30) /* bytes of address space of the importer */

/* Processor time of the importer. */
#define LW_IMPORT_SPAWN_SECONDS     3600
#define LW_IMPORT_SPAWN_SECONDS_MAX 1e6
#define LW_IMPORT_SPAWN_SECONDS_HELP                                                                         \
    "processor time, s, that reading a scene and laying out its lightmaps may take, of all threads "         \
    "together "                                                                                              \
    "(default " LW_LIGHTMAP_NUMBER(LW_IMPORT_SPAWN_SECONDS) ")"
/* Texels of all pictures of a scene. They take 4 bytes each, and as much again while the package is
 * written. */
#define LW_IMPORT_SPAWN_PICTURES_HELP                                                                        \
    "texels of all pictures of the scene together; those past it have a stand-in, and a line says so "       \
    "(default 268435456, of 16384 x 16384)"

/* Whether what a scene says of gloss and relief is kept. */
#define LW_IMPORT_SPAWN_MATERIALS "full|matt"
#define LW_IMPORT_SPAWN_MATERIALS_HELP                                                                       \
    "full: surfaces have the gloss and normal maps of the file; matt: none of them "                         \
    "(default {})"
enum lw_import_spawn_materials { LW_IMPORT_SPAWN_FULL, LW_IMPORT_SPAWN_MATT };

struct lw_import_spawn_desc {
    const char *scene;       /* a .lwscene, any file that lightwell-import reads, or "builtin:NAME" */
    const char *environment; /* an equirectangular EXR for the scene; NULL: the scene's own, or none */
    double texels_per_metre; /* 0: the importer's default */
    const char *density_of;  /* for some objects, as multiples (lightmap_density.h); NULL: none */
    uint32_t texels_max;     /* 0: the importer's default */
    uint32_t atlas_side_max; /* texels; 0: the importer's default */
    unsigned threads;        /* 0: all */
    double import_seconds;   /* processor time; 0: LW_IMPORT_SPAWN_SECONDS */
    uint32_t picture_texels; /* 0: the importer's default */
    enum lw_import_spawn_materials materials;
    bool lightmap_unused; /* nothing is said about how coarse it is */
    uint64_t memory_max; /* bytes; 0: LW_IMPORT_SPAWN_MEMORY_MAX. Not imposed where a sanitizer needs more. */
    const char *program; /* NULL: lightwell-import beside this program, else in PATH */
    /* may be NULL; becomes non-zero, e.g. in a signal handler: stop everything */
    const _Atomic bool *cancel;
};

/** Loads a scene package directly, if it is to have no other environment, or has lightwell-import make one in
 * a temporary folder that is gone afterwards. The importer's warnings and progress go to our stderr; its
 * failure is returned, not shown, so that it is reported once.
 * Errors: the importer's own (LW_BAD_DATA, LW_NO_INPUT, LW_NO_MEMORY, ...); LW_CLOSED if it was cancelled,
 * or stopped by SIGINT or SIGTERM; LW_OS if it cannot be started; LW_INTERNAL if it crashed. */
LW_MUST_CHECK enum lw_status lw_import_spawn(const struct lw_import_spawn_desc *desc,
                                             struct lw_scene **out_scene, struct lw_error *err);

#endif
