/* seams.h: makes the light on both sides of a lightmap's seams agree.
 * Flow:    seam_edges -> [seams: rows, components]; each frame: tiles' light -> [weld] -> tiles' light -> publish
 * Threads: init by one; weld by one caller, workers inside; same bytes at any number of them.
 *
 * Charts sample a surface at places of their own, and what a bilinear look-up reads on a border is half gutter. So the
 * two sides of a seam read differently by what the light varies over half a texel. At points along each seam, some three a texel,
 * we ask that both look-ups read the same: a row of a linear system over the texels that they touch. Of all corrections
 * that fulfil the rows the smallest is taken, in the least squares sense, a gutter's counting less than a covered texel's;
 * Kaczmarz's projections (1937), row by row, tend to it; conjugate gradients hasten them (Bjorck and Elfving 1979). A
 * correction moves both sides by the same amount towards each other, so that the mean of the light stays; a tenth of it is
 * let go each frame. (Iwanicki 2013 solves the like for a baker, by conjugate gradients.) */
#ifndef LW_SOLVE_SEAMS_H
#define LW_SOLVE_SEAMS_H

#include "server/solve/seam_gutters.h"

#define LW_SEAMS_ROWS_MAX (1u << 22) /* 64 bytes each; what is beyond stays unwelded */

struct lw_seams {
    uint32_t row_count, member_count, component_count;
    struct lw_seams_row *row;           /* component by component */
    struct lw_seams_member *member;     /* likewise: the texels that rows or guesses read */
    struct lw_seams_guess *guess;       /* per member: what fills it if it is a gutter */
    uint32_t *first_row, *first_member; /* per component, and one more */
    uint8_t *active;                    /* per component: the frame has changed its light */
    float *light;                       /* 3 per member: the tiles' own, not welded; W/m^2 */
    float *welded;                      /* 3 per member */
    float *correction; /* likewise: what the last frame's welding added; the next one goes on from there */
    float *scratch[3]; /* likewise */
    struct lw_seam_gutters gutters; /* that no row reads */
    uint8_t
        *filled; /* per texel of the global numbering: a gutter whose light is welded, or one of `gutters` */
    bool fresh;  /* light[] holds nothing yet: tiles at rest read as their direct and indirect light */
    uint64_t rows_left_out;
};

/** Finds the seams of a scene. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_seams_init(struct lw_seams *seams, const struct lw_scene *scene,
                                           const struct lw_pose *pose, const struct lw_atlas_map *map,
                                           const struct lw_texels *texels);
void lw_seams_finish(struct lw_seams *seams);

/** Bytes held, but for the plane `filled`. */
size_t lw_seams_memory_bytes(const struct lw_seams *seams);

/** Welds tiles->light around what frame `frame` has solved; writes covered texels, and gutters beyond seams. */
void lw_seams_weld(struct lw_seams *seams, struct lw_tiles *tiles, uint64_t frame, int threads);

#endif
