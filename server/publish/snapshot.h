/* snapshot.h: the immutable result of one frame, which sessions send.
 * Flow:    solver tiles -> publisher -> [snapshot] -> sessions
 * Threads: built by the solver's thread; after that immutable and reference-counted, [any]. */
#ifndef LW_PUBLISH_SNAPSHOT_H
#define LW_PUBLISH_SNAPSHOT_H

#include "common/tile/atlas.h"
#include "proto/message.h"

#include <stdatomic.h>

/** Bytes of one or more whole framed messages, encoded once and shared by all sessions. */
struct lw_blob {
    _Atomic uint32_t references;
    size_t size;
    uint8_t bytes[];
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_blob_create(size_t size, struct lw_blob **out_blob);
/** A blob that holds a framed message. */
LW_MUST_CHECK enum lw_status lw_blob_from_message(const struct lw_message *message,
                                                  struct lw_blob **out_blob);
struct lw_blob *lw_blob_ref(struct lw_blob *blob); /* returns blob */
void lw_blob_unref(struct lw_blob *blob);          /* NULL is fine */

/** Each frame has two version numbers of a tile. The second is the light as it was encoded. The first has
 * wider steps; it is made only for slow links (server/serve/tiles/transcoder.h). [any] */
static inline uint64_t lw_snapshot_version(uint64_t frame) { return 2 * frame; }
static inline uint64_t lw_snapshot_frame_of(uint64_t version) { return (version + 1) / 2; }
static inline uint64_t lw_snapshot_coarse_version(uint64_t version) { return version - 1; }
static inline bool lw_snapshot_is_coarse(uint64_t version) { return version % 2; }

struct lw_snapshot_tile {
    uint64_t version;     /* 0: never published */
    struct lw_blob *blob; /* a LW_MESSAGE_TILE; NULL if version is 0 */
    uint64_t base;
    struct lw_blob *delta; /* the same for a client that has version `base`; NULL: there is none */
    float change;          /* relative, root mean square, against the version before; 0: not known */
};

struct lw_snapshot {
    _Atomic uint32_t references;
    uint64_t frame; /* a later snapshot may be of the same one, with more tiles of it */
    double time_s;
    /* LW_MESSAGE_FRAME with what moved since previous_frame; NULL: send frame_full */
    struct lw_blob *frame_delta;
    /* LW_MESSAGE_FRAME with every transform and light, for a session that joins or has skipped frames */
    struct lw_blob *frame_full;
    struct lw_blob *settled; /* LW_MESSAGE_SETTLED; NULL: sessions get none */
    uint64_t previous_frame; /* the frame that frame_delta builds on */
    uint32_t channels;       /* bit per channel (tile_channels.h): those of which it has the tiles */
    uint32_t unsettled;      /* channels with tiles of this frame still to come: SETTLED is not for them */
    uint32_t tile_count;
    struct lw_snapshot_tile *tile[LW_TILE_CHANNELS_MAX]; /* by channel, by lw_tile_id; NULL: not of it */
    /* The number of the newest list of interest that the solver knew (lw_server_interest); 0: none. */
    uint64_t interest;
    bool *holds_fine; /* by the ids of finer levels: the solver has the tile, lit or not; NULL: it has none */
};

/** An empty snapshot with one reference: frame 0, no frame messages, tiles of version 0. The caller fills it
 * in before it shares it; the snapshot takes over the references of its blobs. channels: bit for each.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_snapshot_create(uint32_t tile_count, uint32_t channels,
                                                struct lw_snapshot **out_snapshot);
/** Whether it has the tiles of a channel. */
static inline bool lw_snapshot_has(const struct lw_snapshot *snapshot, uint32_t channel) {
    return snapshot->channels >> channel & 1;
}
/** fine: the id of a tile of a finer level, counted from the first of these */
static inline bool lw_snapshot_holds_fine(const struct lw_snapshot *snapshot, uint32_t fine) {
    return snapshot->holds_fine && snapshot->holds_fine[fine];
}
struct lw_snapshot *lw_snapshot_ref(struct lw_snapshot *snapshot); /* returns snapshot */
void lw_snapshot_unref(struct lw_snapshot *snapshot);              /* NULL is fine */

#endif
