/* bench_light.h: solves to compare, the light that a solver has found, and how far it is off
 * another's. */
#ifndef LW_TESTS_BENCH_LIGHT_H
#define LW_TESTS_BENCH_LIGHT_H

#include "server/solve/solver.h"

/** A solve as lightwelld's by default, but for its filter, until tiles have that relative error; < 0: it
 * never converges. */
struct lw_solver_desc bench_light_desc(const struct lw_scene *scene, const struct lw_atlas_map *map,
                                       double error, uint32_t seed);

/** Writes the values of texel i of a tile. */
typedef void bench_light_texel(const struct lw_solver_tile *tile, uint32_t i, float *out);

/** `values` of each covered texel of level 0, in the order of tiles; the caller frees. *out_count: values in
 * all. NULL: no memory. */
float *bench_light_gather(const struct lw_solver *solver, const struct lw_atlas_map *map, size_t values,
                          bench_light_texel *texel, size_t *out_count);

/** The same of three values each: all light, unfiltered. */
float *bench_read_light(const struct lw_solver *solver, const struct lw_atlas_map *map, size_t *out_count);

/** The epsilon of relMSE: 1 % of the mean of the reference's squares. */
double bench_light_epsilon(const float *reference, size_t count);

/** relMSE of one texel's three values, but at most 1: beside a lamp a single texel may be off by thousands,
 * in the reference as well. */
double bench_light_error(const float x[3], const float reference[3], double epsilon);

/** Mean of the above over all texels. */
double bench_light_relmse(const float *x, const float *reference, size_t count);

#endif
