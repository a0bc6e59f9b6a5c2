/* guide.h: from where light comes, learned place by place, and directions of bounce rays that follow it.
 * Flow:    [aim_at] -> sample, density -> paths -> [note]. Between passes of paths: [learn]
 * Threads: create, learn and destroy by one thread while nobody else is here; the rest [any] in between.
 * After:   Dahm and Keller 2017 (learning light transport the reinforced way, expected Sarsa); Veach 1997
 *          (one-sample mixtures).
 *
 * A grid of 32^3 cells over the scene. Each cell divides the sphere of world directions into 128 sectors of
 * equal solid angle, 8 bands of height times 16 slices of azimuth, and keeps Q, the luminance that arrives
 * from each. A direction is drawn with the density
 *
 *     p = (1 - beta) cos / pi + beta p_Q,   p_Q ~ Q cos(normal, middle of the sector), even within a sector
 *
 * so that the radiance of paths is unbiased for any Q, and no weight exceeds 1 / (1 - beta). In a cell
 * that has taken n notes beta stands for beta n / (n + trust): from a few notes Q is noise, and the weights
 * of many bounces multiply. Notes of a pass are integers, whose sum does not depend on their order. Q
 * stands still until [learn] takes them: bytes do not depend on the number of threads. */
#ifndef LW_CLIENT_PATHS_GUIDE_H
#define LW_CLIENT_PATHS_GUIDE_H

#include "common/base/status.h"
#include "common/base/vec.h"

#include <stdint.h>

#define LW_GUIDE_SIDE    32u /* cells along each axis */
#define LW_GUIDE_BANDS   8u
#define LW_GUIDE_SLICES  16u
#define LW_GUIDE_SECTORS (LW_GUIDE_BANDS * LW_GUIDE_SLICES)
#define LW_GUIDE_NOWHERE UINT32_MAX

/* docs/lab/guiding.md has the sweeps. */
#define LW_GUIDE_ALPHA 0.05f
#define LW_GUIDE_BETA  0.5f
#define LW_GUIDE_TRUST 1024.0f

struct lw_guide_desc {
    struct lw_vec3 minimum_ws, maximum_ws; /* points outside count as of the nearest cell */
    float alpha; /* weight of one note, in (0, 1]; a sector's first notes are averaged. 0: LW_GUIDE_ALPHA */
    float beta;  /* share of directions drawn by Q, in (0, 1). 0: LW_GUIDE_BETA */
    float trust; /* notes after which a cell has half of that share. 0: LW_GUIDE_TRUST */
};

struct lw_guide;

/** Errors: LW_NO_MEMORY. Takes 20 bytes for each sector of cells that have surfaces. */
LW_MUST_CHECK enum lw_status lw_guide_create(const struct lw_guide_desc *desc, struct lw_guide **out_guide,
                                             struct lw_error *err);
void lw_guide_destroy(struct lw_guide *guide);

/** The distribution at one point of a surface. */
struct lw_guide_aim {
    const float *q; /* the cell's; NULL: nothing is known there */
    struct lw_vec3 normal;
    uint32_t cell;
    float beta;
    float band[LW_GUIDE_BANDS], total; /* sums of Q cos over sectors */
};

struct lw_guide_sample {
    struct lw_vec3 direction; /* unit; may lie below the surface, where it brings no light */
    float density;            /* per steradian; positive above the surface */
    uint32_t place;           /* cell and sector, for lw_guide_note() */
};

/** Sets *out_aim for a point and its unit shading normal. It holds until the next learn. */
void lw_guide_aim_at(const struct lw_guide *guide, struct lw_vec3 point_ws, struct lw_vec3 normal_ws,
                     struct lw_guide_aim *out_aim);

/** Draws a direction by two even numbers in [0, 1). From equal aims and normals, equal numbers give equal
 * directions. normal_ws: that of the surface the ray leaves, unit; surfaces may share the aim of one of
 * them. */
struct lw_guide_sample lw_guide_sample(const struct lw_guide_aim *aim, struct lw_vec3 normal_ws,
                                       const float point[2]);

/** The density by which lw_guide_sample() draws a unit direction, per steradian. */
float lw_guide_density(const struct lw_guide_aim *aim, struct lw_vec3 normal_ws, struct lw_vec3 direction_ws);

/** Luminance that a white surface there reflects, by Q: its integral with cos / pi. 0 where nothing is
 * known. */
float lw_guide_reflected(const struct lw_guide_aim *aim);

/** Notes the luminance that a ray has found, W/(m^2 sr). A luminance below 0, or not finite, counts as 0. Any
 * thread, in any order. place: of the sample that the ray was drawn by. */
void lw_guide_note(struct lw_guide *guide, uint32_t place, float luminance);

/** Takes all notes into Q: Q <- (1 - w) Q + w mean of a sector's n notes, w = 1 - (1 - alpha)^n, or n over
 * all notes the sector ever had if that is more. threads: 0: all. */
void lw_guide_learn(struct lw_guide *guide, unsigned threads);

#endif
