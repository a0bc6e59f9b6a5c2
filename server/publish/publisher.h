/* publisher.h: turns what a frame changed into encoded tiles and an immutable snapshot.
 * Flow:    solver tiles -> [per form of light: levels, changed tiles, encoded once] -> snapshot -> sessions
 * Threads: one thread calls (the solver's); workers inside. */
#ifndef LW_PUBLISH_PUBLISHER_H
#define LW_PUBLISH_PUBLISHER_H

#include "server/publish/snapshot.h"
#include "server/solve/solver.h"

#include <math.h>

/* A tile is sent again when it has moved by this much (root mean square, relative) from what was last sent:
 * under one step of an 8-bit display at middle grey. */
#define LW_PUBLISHER_VISIBLE_CHANGE 0.004f
/* But what moves by less than this share of the tile's own error tells nothing. Small, since holding levels
 * (LW_TILE_DCT_HOLD) makes a version of little news cheap: with a quarter, what waited was off by 5 % of a
 * view, for 3 % of the bits. */
#define LW_PUBLISHER_NOISE_SHARE 0.05f

/* The lossy codec's step, in units of log2, of a tile with error e. Of light at rest it follows the noise: a
 * texel of level l is the mean of 4^l, and level 0, where seams are welded, has half as wide a step, which
 * keeps the two sides of a seam together. What views read has no wider steps than `widest`, the same
 * everywhere, which costs least for an error of the whole. The default keeps a view within 2 % of the uncoded
 * light (docs/results/streaming.md). Of level 0 that is noisier than views bear they read slivers alone
 * (client/view/compose.c): that has steps twice as wide. */
#define LW_PUBLISHER_STEP_MIN    0x1p-5f /* 1 % or so: under what is seen, and under the error at rest */
#define LW_PUBLISHER_STEP_WIDEST 0.1f
/* Of LW_LIGHT_FORM_SPLIT they are so many times as wide: what clients draw has no error of its own, so that
 * the picture is as far off as with tiles of all light, or less (tests/bench/bench_split.c). Steps that
 * follow each block's share of what is drawn were tried: 1.5 % fewer bits, for 1 dB. */
#define LW_PUBLISHER_SPLIT_WIDER 1.25f

static inline float lw_publisher_step(float error, float noise_shown, uint32_t level, float widest) {
    if (level == 0 && lw_atlas_noise_level_min(error, noise_shown) > 0) return 2 * widest;
    const float step = level == 0 ? error : 2 * ldexpf(error, -(int)level);
    return fminf(fmaxf(step, LW_PUBLISHER_STEP_MIN), widest);
}

/* White is the E that 99 % of the values of coarse texels are under; what has under this share of it looks
 * black beside it, and the lossy codec keeps its difference, not its ratio. It is a fifth of the hundredth
 * that losses are measured against. White is that of all light in either form: what is drawn over a tile is
 * as bright as what is in it. */
#define LW_PUBLISHER_WHITE_QUANTILE 0.99
#define LW_PUBLISHER_DARK_SHARE     (1 / 512.0f)

struct lw_publisher_desc {
    const struct lw_scene *scene; /* these three outlive the publisher */
    const struct lw_atlas_map *atlas_map;
    struct lw_solver *solver;
    float target_error;
    /* share of a tile's error that the solver's filter leaves in what is shown; 0: it has none, as 1 */
    float noise_shown;
    uint32_t codec;    /* LW_TILE_CODEC_HALF_ZSTD or LW_TILE_CODEC_DCT */
    float step_widest; /* the latter's; 0: LW_PUBLISHER_STEP_WIDEST */
    unsigned threads;  /* 0: all */
};

struct lw_publisher_stats {
    uint64_t tiles_encoded;
    uint64_t bytes_encoded; /* of this frame, for a client that has the tiles of the one before */
    uint64_t split_tiles_encoded, split_bytes_encoded; /* of these: those of LW_LIGHT_FORM_SPLIT */
    uint64_t levels_ns, encode_ns;
    uint64_t saturated; /* channels that did not fit the tile codec's range, so far */
};

struct lw_publisher;

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_publisher_create(const struct lw_publisher_desc *desc,
                                                 struct lw_publisher **out_publisher);
void lw_publisher_destroy(struct lw_publisher *publisher);

/** Which forms are published from the next frame on: bit per enum lw_light_form, LW_LIGHT_FORM_FULL alone
 * at first. The solver must show them (solver.h). Of a form that was not published before the next snapshot
 * has every tile in a new version; what is known of one that no longer is, is freed. Errors: LW_NO_MEMORY;
 * then nothing has changed. */
LW_MUST_CHECK enum lw_status lw_publisher_set_forms(struct lw_publisher *publisher, uint32_t forms);

/** Error of a tile of any level, as it is sent: of the level-0 tiles below it the worst. out_bounces:
 * likewise, the least; may be NULL. [any] while no frame is solved. */
float lw_publisher_error(const struct lw_atlas_map *map, const struct lw_solver *solver, lw_tile_id id,
                         uint32_t *out_bounces);

/** Publishes a solved frame. rays_total: traced since the start. *out_snapshot: a new reference.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_publisher_publish(struct lw_publisher *publisher, const struct lw_pose *pose,
                                                  uint64_t frame, uint64_t solve_ns, uint64_t rays_total,
                                                  uint64_t tiles_solved, struct lw_snapshot **out_snapshot,
                                                  struct lw_publisher_stats *out_stats);

/** Bytes held. */
size_t lw_publisher_memory_bytes(const struct lw_publisher *publisher);

#endif
