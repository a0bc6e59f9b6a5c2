/* manifest.h: DIR/index.json: the map of each object, and the quantity and units of its values.
 * Threads: main() only. Format: docs/baking.md. */
#ifndef LW_BAKE_MANIFEST_H
#define LW_BAKE_MANIFEST_H

#include "server/bake/bake.h"
#include "server/bake/map.h"
#include "server/bake/sides.h"

#include <jansson.h>

#define LW_MANIFEST_FORMAT 1

/** Properties of the whole bake. */
struct lw_manifest_desc {
    const struct lw_scene *scene;
    const char *scene_path; /* as the user gave it */
    const struct lw_convention *convention;
    const struct lw_bake_result *result;
    double time_s, tracing_range_m;
    uint32_t samples, bounces, seed; /* samples 0: `error` was the aim */
    float error;
    bool denoised;
    const char *direction_form;              /* NULL: there are no maps of directions */
    const struct lw_client_lights *left_out; /* lights whose direct light the maps lack; NULL: none */
};

struct lw_manifest {
    json_t *root, *maps;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_manifest_init(struct lw_manifest *manifest,
                                              const struct lw_manifest_desc *desc);
void lw_manifest_finish(struct lw_manifest *manifest);

/** Adds a map. file: its name in the folder; shown: the sides that the .glb shows, or would.
 * directions: name of the map of directions; NULL: there is none. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_manifest_add(struct lw_manifest *manifest, const struct lw_scene *scene,
                                             const struct lw_map *map, const struct lw_sides_shown *shown,
                                             const char *file, const char *directions, bool half);

/** Errors: LW_CANNOT_CREATE, LW_IO naming the path; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_manifest_write(const struct lw_manifest *manifest, const char *path,
                                               struct lw_error *err);

/** A JSON string of text that may not be UTF-8 (paths): then what is not ASCII becomes '?'. NULL when out of
 * memory. */
json_t *lw_manifest_text(const char *text);

#endif
