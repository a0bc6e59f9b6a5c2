/* transcoder.h: what sessions on narrow links need: deltas over several versions
 * of a tile, tiles in wider steps.
 * Flow:    deltas: two versions of a tile -> [transcoder] -> a delta from one to
 *          the other -> deltas -> sessions
 *          deltas: a tile -> [transcoder] -> the same in wider steps, whole and
 *          as a delta -> deltas -> sessions
 * Threads: [loop]; a thread of its own does the work, since some 100 us a tile
 *          are too much for the network's.
 *
 * It is made when the first session needs it, and shared by all. */
#ifndef LW_SERVE_TILES_TRANSCODER_H
#define LW_SERVE_TILES_TRANSCODER_H

#include "common/tile/tile_codec.h"
#include "server/publish/snapshot.h"

#define LW_TRANSCODER_JOBS_MAX 256u /* asked for and not collected */

/* Steps of coarse tiles are 2^(LW_TRANSCODER_COARSER_Q / 8) times those of the tile: two fifths of the bytes,
 * and a view that is off by 4 to 6 % (docs/lab/streaming.md). */
#define LW_TRANSCODER_COARSER_Q 16u

/** A request: how version `version` of a tile differs from version `base`, or the coarse form of a tile, to
 * be called `version`. The coarse forms of a tile are asked for in the order of their versions. */
struct lw_transcoder_job {
    uint32_t tile;              /* lw_tile_id */
    struct lw_tile_place place; /* the tile's, by lw_transcoder_ask(): its id may go to another tile later */
    bool coarse;                /* it is a coarse form, or between two of these */
    uint32_t life;              /* another one for the same id: nothing builds on earlier results */
    uint64_t base, version;
    /* LW_MESSAGE_TILE of version base, no delta; NULL: `to` is a tile of which a coarse form is wanted. */
    struct lw_blob *from;
    struct lw_blob *to; /* the same of version `version` */
};

/** Result. Its blobs are LW_MESSAGE_TILE, the collector's to unref; NULL where one would be no
 * smaller than `to`, or cannot be made. */
struct lw_transcoder_result {
    uint32_t tile;
    bool coarse;
    uint32_t life;
    uint64_t base, version; /* base: 0 of a coarse form */
    struct lw_blob *blob;
    /* For a coarse form: its difference from version delta_base, the coarse form before. */
    struct lw_blob *delta;
    uint64_t delta_base;
};

struct lw_transcoder;

/** channel: of the tiles. It and atlas_map outlive it. wake is called by its thread whenever something is
 * there to be collected.
 * Errors: LW_NO_MEMORY, LW_OS. */
LW_MUST_CHECK enum lw_status lw_transcoder_create(const struct lw_tile_channel *channel,
                                                  const struct lw_atlas_map *atlas_map,
                                                  void (*wake)(void *context), void *context,
                                                  struct lw_transcoder **out_transcoder);
/** Ends its thread; open requests are dropped. */
void lw_transcoder_destroy(struct lw_transcoder *transcoder);

/** Delta of the tile `to` over `from`, its version `base`: LW_MESSAGE_TILE, the caller's to unref.
 * from, to: LW_MESSAGE_TILE, no deltas. buffer: lw_tile_codec_bound() bytes, for the work. NULL where a delta
 * would be no smaller than `to`, or cannot be made: there are other ways to the version.
 * [any thread, with a codec of its own] */
struct lw_blob *lw_transcoder_encode_delta(struct lw_tile_codec *codec, const struct lw_tile_channel *channel,
                                           const struct lw_tile_place *place, const struct lw_blob *from,
                                           uint64_t base, const struct lw_blob *to, uint8_t *buffer);

/** Takes references of its own. False if there are LW_TRANSCODER_JOBS_MAX. */
bool lw_transcoder_ask(struct lw_transcoder *transcoder, const struct lw_transcoder_job *job);

/** Takes the next finished tile, in the order of requests. Returns false if none is finished. */
bool lw_transcoder_collect(struct lw_transcoder *transcoder, struct lw_transcoder_result *out_result);

#endif
