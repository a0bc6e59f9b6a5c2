/* seams.h: makes the light on both sides of a lightmap's seams agree.
 * Flow:    seam_edges -> [seams: rows, components]
 *          each frame: tiles' light ->
 *          [weld] -> tiles' light -> publish
 * Threads: init by one, weld by one caller with workers inside; same bytes at any number of them.
 *
 * Charts sample a surface at points of their own, and what a bilinear look-up reads on a border is
 * half gutter. So the two sides of a seam differ by what the light varies over half a texel. At some
 * three points a texel along each seam both look-ups are to read the same: a row of a linear system
 * over the texels that they touch.
 *
 * Of all corrections that fulfil the rows the smallest is taken, in the least squares sense; a gutter
 * counts less than a covered texel. Kaczmarz's projections (1937), row by row, tend to it. Conjugate
 * gradients hasten them (Bjorck and Elfving 1979; Iwanicki 2013 solves the like for a baker). A
 * correction moves both sides towards each other by the same amount, so that the mean of the light stays.
 * A tenth of it is let go each time.
 *
 * Rows that share texels, directly or through others, make a component. A frame welds components
 * that hold a block which it shows. Rows and gutters are geometry, and serve any number of
 * solves over the same texels. */
#ifndef LW_FILTER_SEAMS_H
#define LW_FILTER_SEAMS_H

#include "server/solve/filter/seam_gutters.h"
#include "server/solve/state/checkpoint.h"

#define LW_SEAMS_ROWS_MAX (1u << 22) /* 64 bytes each; rows beyond stay unwelded */

/** The linear system of a scene's seams: rows, and the texels (members) that they read. */
struct lw_seams {
    uint32_t row_count, member_count, component_count, block_count;
    struct lw_seams_row *row;       /* by component */
    struct lw_seams_member *member; /* by component */
    struct lw_seams_guess *guess;   /* per member: start value of a gutter, from its neighbours */
    uint32_t *block;                /* by component: indices of the blocks that hold its members */
    uint32_t *first_row, *first_member, *first_block; /* per component, and the end */
    struct lw_seam_gutters gutters;                   /* gutters that no row reads */
    uint64_t rows_left_out;
};

/* The welds of one channel of one solve. */
struct lw_seams_light {
    uint32_t channel, planes;
    uint32_t member_count, component_count;
    uint8_t *active;   /* per component: the frame shows one of its blocks */
    float (*light)[4]; /* per member: unwelded values of the planes; 0 beyond them */
    float (*welded)[4], (*scratch[3])[4];
    float *correction; /* `planes` per member: what the last weld added; the next weld starts there */
    bool fresh; /* light[] is not filled yet: blocks that the frame does not show are read from their sums */
};

/** The welds of all channels of a solve. */
struct lw_seams_welds {
    struct lw_seams_light of[LW_TILE_CHANNELS_MAX];
};

/** Makes the seams of a scene.
 * edges  of the scene (seam_edges.h)
 * tiles  any over these texels
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_seams_init(struct lw_seams *seams, const struct lw_scene *scene,
                                           const struct lw_seam_edges *edges, const struct lw_texels *texels,
                                           const struct lw_tiles *tiles);
void lw_seams_finish(struct lw_seams *seams);

/** Bytes held. */
size_t lw_seams_memory_bytes(const struct lw_seams *seams);

/** Allocates welds of the given channels (tile_channels.h) and frees those of before. Start with zeroed ones.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_seams_welds_init(struct lw_seams_welds *welds, const struct lw_seams *seams,
                                                 uint32_t channels);
void lw_seams_welds_finish(struct lw_seams_welds *welds);

/** Bytes held. */
size_t lw_seams_welds_memory_bytes(const struct lw_seams_welds *welds);

/** Lists the corrections, for a checkpoint. Returns the number of parts. */
uint32_t lw_seams_welds_list_parts(const struct lw_seams_welds *welds,
                                   struct lw_checkpoint_part out_part[LW_TILE_CHANNELS_MAX]);

/** After the tiles were replaced: resume keeps the corrections, which came from the same checkpoint; forget
 * clears them. */
void lw_seams_welds_resume(struct lw_seams_welds *welds);
void lw_seams_welds_forget(struct lw_seams_welds *welds);

/** Welds tiles->shown, in the given channels, around the blocks shown in frame `frame`: covered texels, and
 * gutters beyond seams. shown_frame of all blocks that it writes becomes `frame`, as does their tiles'
 * solved_frame. Gutters are filled after it (lw_seam_gutters_fill). */
void lw_seams_weld(const struct lw_seams *seams, struct lw_seams_welds *welds, uint32_t channels,
                   struct lw_tiles *tiles, uint64_t frame, int threads);

#endif
