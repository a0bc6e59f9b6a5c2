/* download.h: a package as it comes in chunks: decompressed as it arrives, checked at the end. Parts
 * that the client already has, by their hashes, are put in their places.
 * Threads: one thread at a time. */
#ifndef LIGHTWELL_DOWNLOAD_H
#define LIGHTWELL_DOWNLOAD_H

#include "proto/message.h"

struct lw_download {
    void *zstd;
    uint8_t *bytes;        /* the package's, so far */
    size_t size, capacity; /* capacity grows with bytes that came, not with a size that was announced */
    uint64_t received;     /* compressed bytes, of parts that are held too */
    uint64_t package_size, compressed_size;
    struct lw_package_hash hash;
    const char *what; /* it is, for messages */
    struct lw_download_part {
        uint64_t end, compressed_end; /* where it ends in the package */
        struct lw_package_hash hash;
        uint8_t *held; /* its bytes, before they are in the package; NULL: it has to come */
        bool was_held;
    } * part;
    size_t part_count, parts_done;
};

/** Where parts may be found: its bytes, malloc'ed, or NULL. */
typedef uint8_t *lw_download_find(void *where, const struct lw_package_hash *hash, uint64_t size);

/** what: of text that outlives it. find: NULL: nothing is held. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_download_init(struct lw_download *download, const char *what,
                                              const struct lw_message_package *package,
                                              lw_download_find *find, void *where);
/** Looks for parts that are not there yet; what lw_download_init() does with a `find`. Before the request. */
void lw_download_find_held(struct lw_download *download, lw_download_find *find, void *where);
void lw_download_finish(struct lw_download *download);

/** The request for the rest of the package. *out_held: .held of the request points to it; malloc'ed, the
 * caller's. NULL: no part is held. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_download_request(const struct lw_download *download,
                                                 struct lw_message_package_request *out_request,
                                                 uint8_t **out_held);

/** Takes the next chunk. Errors: LW_PROTOCOL for data that is out of order, longer than announced or no zstd,
 * and after the last chunk for a package whose hash is not the promised one; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_download_add(struct lw_download *download,
                                             const struct lw_message_package_chunk *chunk,
                                             struct lw_error *err);

/** Takes held parts without a chunk: to be called before the first chunk. Errors: as of lw_download_add(). */
LW_MUST_CHECK enum lw_status lw_download_begin(struct lw_download *download, struct lw_error *err);

/** Whether `bytes` is the whole package, checked. */
bool lw_download_is_complete(const struct lw_download *download);

#endif
