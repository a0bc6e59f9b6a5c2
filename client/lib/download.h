/* download.h: the scene package as it comes in chunks: decompressed as it arrives, checked at the end.
 * Threads: one thread at a time. */
#ifndef LIGHTWELL_DOWNLOAD_H
#define LIGHTWELL_DOWNLOAD_H

#include "proto/message.h"

struct lw_download {
    void *zstd;
    uint8_t *bytes;        /* of the package, so far */
    size_t size, capacity; /* capacity follows what arrived, not what was promised */
    uint64_t received;     /* compressed bytes */
    bool stream_ended;
    uint64_t package_size, compressed_size;
    struct lw_package_hash hash;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_download_init(struct lw_download *download,
                                              const struct lw_message_welcome *welcome);
void lw_download_finish(struct lw_download *download);

/** Takes the next chunk. Errors: LW_PROTOCOL for data that is out of order, more than promised, no zstd, or, with the last
 * chunk, not what the welcome named; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_download_add(struct lw_download *download,
                                             const struct lw_message_package_chunk *chunk,
                                             struct lw_error *err);

/** Whether `bytes` is the whole package, checked. */
bool lw_download_is_complete(const struct lw_download *download);

#endif
