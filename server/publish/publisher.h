/* publisher.h: encodes the changed tiles of a frame and builds an immutable snapshot.
 * Flow:    solver tiles -> [per channel: levels, changed tiles, encoded once] -> snapshot -> sessions
 * Threads: one thread calls (the solver's); workers inside. */
#ifndef LW_PUBLISH_PUBLISHER_H
#define LW_PUBLISH_PUBLISHER_H

#include "server/publish/snapshot.h"
#include "server/solve/solver.h"

#include <math.h>

/* A tile is sent again when it differs from the last sent version by this much (root mean square, relative):
 * less than one step of an 8-bit display at middle grey. */
#define LW_PUBLISHER_VISIBLE_CHANGE 0.004f
/* But not if it differs by less than this share of its own error, which is noise. The share is small, since
 * held coefficients (LW_TILE_DCT_HOLD) make a version with few changes cheap: a share of a quarter saved 3 %
 * of the bits, and unsent changes were 5 % of a view. */
#define LW_PUBLISHER_NOISE_SHARE 0.05f

/* The lossy codec's step, in units of log2, for a tile of relative error e:
 *     level 0             e: half of the other levels' step, so that the sides of a welded seam stay close
 *     level l             2 e / 2^l: a texel is the mean of 4^l texels of level 0
 *     noisy level 0       2 widest: views read only slivers of it (client/view/compose/compose_look.c)
 * From LW_PUBLISHER_STEP_MIN to `widest`, times the step of the channel. One widest step for all tiles
 * costs the fewest bits for an error of the whole view. By its default a view in moving light differs from
 * the uncoded light by 1.5 % in Sponza, by 2.7 % in the atrium (docs/lab/streaming.md). */
/* about 1 % error: invisible, and below the error of converged tiles */
#define LW_PUBLISHER_STEP_MIN    0x1p-5f
#define LW_PUBLISHER_STEP_WIDEST 0.12f
static inline float lw_publisher_step(float error, float noise_shown, uint32_t level, float widest) {
    if (level == 0 && lw_atlas_noise_level_min(error, noise_shown) > 0) return 2 * widest;
    const float step = level == 0 ? error : 2 * ldexpf(error, -(int)level);
    return fminf(fmaxf(step, LW_PUBLISHER_STEP_MIN), widest);
}

/* Light below LW_PUBLISHER_DARK_SHARE of white (white.h) looks black beside it: in a brighter tile the lossy
 * codec keeps its difference, not its ratio (`dark` of tile_dct.h). A tile that is darker in the mean keeps
 * ratios. docs/lab/codec.md has the bits that other shares take. White is of all light in every channel of
 * light, since clients add client-drawn light to a tile's light. */
#define LW_PUBLISHER_DARK_SHARE (1 / 64.0f)

/* State of the encoder, which is kept from one version of a tile to the next, is some 40 bytes a texel and
 * channel. Where that of all tiles is more than this, only objects that somebody looks at keep theirs. */
#define LW_PUBLISHER_STATE_MAX 256000000u

struct lw_publisher_desc {
    const struct lw_scene *scene; /* these three outlive the publisher */
    const struct lw_atlas_map *atlas_map;
    struct lw_solver *solver;
    float target_error;
    /* share of a tile's error that the solver's filter leaves in the shown light; 0: no filter, as 1 */
    float noise_shown;
    uint32_t codec;    /* LW_TILE_CODEC_HALF_ZSTD or LW_TILE_CODEC_DCT */
    float step_widest; /* for LW_TILE_CODEC_DCT; 0: LW_PUBLISHER_STEP_WIDEST */
    /* Per object: its tiles have the channels with `moment`; outlives the publisher. NULL: all do. */
    const bool *directional;
    uint64_t state_max; /* 0: LW_PUBLISHER_STATE_MAX */
    unsigned threads;   /* 0: all */
};

struct lw_publisher_stats {
    uint64_t tiles_encoded;
    uint64_t bytes_encoded; /* in this frame, for a client that has the previous tiles */
    uint64_t split_tiles_encoded, split_bytes_encoded; /* the part of LW_TILE_CHANNEL_SPLIT */
    uint64_t levels_ns, encode_ns;
    uint64_t saturated; /* values that did not fit the tile codec's range, so far */
};

struct lw_publisher;

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_publisher_create(const struct lw_publisher_desc *desc,
                                                 struct lw_publisher **out_publisher);
void lw_publisher_destroy(struct lw_publisher *publisher);

/** Sets the channels that are published from the next frame on: bit for each, LW_TILE_CHANNEL_FULL alone at
 * first. The solver must show them (solver.h). The next snapshot has a new version of every tile of a newly
 * published channel. The state of a channel that is no longer published is freed. Errors: LW_NO_MEMORY; then
 * nothing has changed. */
LW_MUST_CHECK enum lw_status lw_publisher_set_channels(struct lw_publisher *publisher, uint32_t channels);

/** Says who keeps encoder state, where there is not room for all: objects with a tile that is wanted. Others
 * get whole tiles alone. levels: as lw_solver_ops.set_interest(); NULL: all. At first none do. */
void lw_publisher_want(struct lw_publisher *publisher, const uint8_t *levels);

/** Error of a tile of any level, as it is sent: the largest of the level-0 tiles below it. out_bounces: the
 * least number of bounces of these tiles; may be NULL. [any] while no frame is solved. */
float lw_publisher_error(const struct lw_atlas_map *map, const struct lw_solver *solver, lw_tile_id id,
                         uint32_t *out_bounces);

/** Publishes a solved frame. rays_total: traced since the start. *out_snapshot: a new reference.
 * Errors: LW_NO_MEMORY; then the next frame's snapshot has the changes of both frames. */
LW_MUST_CHECK enum lw_status lw_publisher_publish(struct lw_publisher *publisher, const struct lw_pose *pose,
                                                  uint64_t frame, uint64_t solve_ns, uint64_t rays_total,
                                                  uint64_t tiles_solved, struct lw_snapshot **out_snapshot,
                                                  struct lw_publisher_stats *out_stats);

/** Bytes held. */
size_t lw_publisher_memory_bytes(const struct lw_publisher *publisher);

#endif
