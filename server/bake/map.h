/* map.h: the lightmap of one object, as it goes to disk.
 * Flow:    solver tiles -> [map: convention, gutters] -> EXR, PNG
 * Threads: one lw_map belongs to one thread; the solver must not run meanwhile. */
#ifndef LW_BAKE_MAP_H
#define LW_BAKE_MAP_H

#include "common/image/image.h"
#include "common/scene/pose.h"
#include "server/bake/convention.h"
#include "server/solve/solver.h"

/* A map whose light 16-bit floats would change by more than this, in the mean, is written with 32 bits. */
#define LW_MAP_HALF_LOSS_MAX 0.001

struct lw_map {
    uint32_t object;
    uint32_t width, height;
    uint32_t back_offset; /* rows from a texel to the one of its surface's back; 0: no backs */
    float *rgba;          /* width * height * 4, row 0 on top (v = 0); A: 1 surface, 0 continued beyond it */
    uint32_t covered;     /* texels with A = 1 */
    uint32_t samples;     /* least number of samples of each kind, over covered texels */
    float error;          /* relative standard error: root mean square over the tiles, by covered texels */
    float error_worst;    /* the noisiest tile's */
    float largest;        /* of all channels */
    bool fits_half;       /* see LW_MAP_HALF_LOSS_MAX; also: nothing beyond 65504 */
};

/** Builds the map of an object from the solver's tiles. channel: one that the solver shows.
 * Errors: LW_NO_MEMORY; LW_INTERNAL: light that is not finite. */
LW_MUST_CHECK enum lw_status lw_map_build(struct lw_map *map, const struct lw_scene *scene,
                                          const struct lw_atlas_map *atlas_map,
                                          const struct lw_solver *solver, uint32_t channel, uint32_t object,
                                          const struct lw_convention *convention, struct lw_error *err);
void lw_map_finish(struct lw_map *map);

/** Builds the map of where the light of an object comes from: x, y and z of lw_direction_of(), world space
 * (common/light/direction_form.h). The solver shows the channel's moment, too. Alpha is the light's.
 * irradiance: the object's, of this channel. Errors: as lw_map_build(). */
LW_MUST_CHECK enum lw_status lw_map_build_directions(struct lw_map *map, const struct lw_scene *scene,
                                                     const struct lw_atlas_map *atlas_map,
                                                     const struct lw_solver *solver, uint32_t channel,
                                                     const struct lw_map *irradiance, struct lw_error *err);

/** Builds the map of plain normals of an object's texels, world space: shading normals, without normal maps.
 * They are unit on the surface. Beyond it they are means of near ones. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_map_build_normals(struct lw_map *map, const struct lw_scene *scene,
                                                  const struct lw_atlas_map *atlas_map,
                                                  const struct lw_pose *pose, const struct lw_solver *solver,
                                                  uint32_t object, struct lw_error *err);

/** A map in 8 bits a channel: texel / 255 * scale is the light, linear. Largest values are cut off: 0.1 % of
 * the surface at most is brighter than `scale`. Rounding is dithered, so that dark gradients do not turn
 * into steps. *out_rgb is malloc'ed, width * height * 3. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_map_to_8_bit(const struct lw_map *map, uint8_t **out_rgb, float *out_scale);

/** The largest relative change of the light by rounding to 16-bit floats, in the mean over `count` values;
 * INFINITY where one does not fit. */
double lw_map_half_loss(const float *value, size_t count);

#endif
