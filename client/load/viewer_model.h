/* viewer_model.h: a model of viewers without rendering: where users are, and which tiles they need.
 * Flow:    scene, tiles -> boxes in the world -> [viewer_model: eye -> tiles] -> INTEREST
 * Threads: immutable once created; then [any].
 *
 * A user sees a tile if the ball around the tile's box meets the cone around a 60 degree picture.
 * Occlusion is ignored, so a real renderer needs less. The mip level is the coarsest one with texels no
 * larger than a pixel of a picture 720 pixels high. Stand-ins for these tiles are not listed: INTEREST
 * asks for them by its flag.
 * Objects are where they are at time 0. */
#ifndef LW_CLIENT_LOAD_VIEWER_MODEL_H
#define LW_CLIENT_LOAD_VIEWER_MODEL_H

#include "common/tile/atlas.h"

struct lw_viewer_model;

/** A user's place and direction. */
struct lw_viewer_model_eye {
    struct lw_vec3 position, forward; /* m; unit */
};

/** scene   may go afterwards
 * map     of that scene; outlives the model
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_viewer_model_create(const struct lw_scene *scene,
                                                    const struct lw_atlas_map *map,
                                                    struct lw_viewer_model **out_model);
void lw_viewer_model_destroy(struct lw_viewer_model *model);

/** Chooses tiles, each once. If a view needs more than fit, pixels count as larger until its tiles fit.
 * ids     room for `capacity`; returns how many are set */
uint32_t lw_viewer_model_choose(const struct lw_viewer_model *model, const struct lw_viewer_model_eye *eye,
                                lw_tile_id *ids, uint32_t capacity);

/** A random place at standing height within the bounds of the scene, walls ignored, and a direction.
 * The same three numbers give the same place. */
struct lw_viewer_model_eye lw_viewer_model_place(const struct lw_viewer_model *model, uint32_t seed,
                                                 uint32_t user, uint32_t stay);

/** The eye `seconds` into a walk. It goes in straight lines from place to place and looks ahead. */
struct lw_viewer_model_eye lw_viewer_model_walk(const struct lw_viewer_model *model, uint32_t seed,
                                                uint32_t user, double seconds);

#endif
