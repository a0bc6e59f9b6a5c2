/* interest.h: which tiles a user needs for what they see, and where users are: a model of an viewers, without
 * rendering.
 * Flow:    scene, tiles -> boxes in the world -> [interest: eye -> tiles] -> INTEREST
 * Threads: immutable once created; then [any].
 *
 * A user sees a tile if the ball around its box meets the cone around a 60 degree picture; what stands in
 * front of it is not considered, so a real renderer needs less. The level is the coarsest one whose texels
 * are no larger than a pixel of a picture 720 pixels high. What stands in for these tiles is not among them:
 * INTEREST asks for it by its flag. Objects are where they are at time 0. */
#ifndef LW_CLIENT_LOAD_INTEREST_H
#define LW_CLIENT_LOAD_INTEREST_H

#include "common/tile/atlas.h"

struct lw_interest;

/** Where somebody is and looks. */
struct lw_interest_eye {
    struct lw_vec3 position, forward; /* m; unit */
};

/** scene   may go afterwards
 * map     of that scene; outlives the interest
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_interest_create(const struct lw_scene *scene, const struct lw_atlas_map *map,
                                                struct lw_interest **out_interest);
void lw_interest_destroy(struct lw_interest *interest);

/** Chooses tiles, each once; where there are more than fit, pixels are taken to be larger until they do.
 * ids     room for `capacity`; returns how many there are */
uint32_t lw_interest_choose(const struct lw_interest *interest, const struct lw_interest_eye *eye,
                            lw_tile_id *ids, uint32_t capacity);

/** A place at standing height within the bounds of the scene, walls or not, and a direction, by chance: the
 * same for the same three numbers. */
struct lw_interest_eye lw_interest_place(const struct lw_interest *interest, uint32_t seed, uint32_t user,
                                         uint32_t stay);

/** The eye after so many seconds of a walk, in straight lines from place to place, looking ahead. */
struct lw_interest_eye lw_interest_walk(const struct lw_interest *interest, uint32_t seed, uint32_t user,
                                        double seconds);

#endif
