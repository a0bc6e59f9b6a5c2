/* tls_stream.h: one end of a TLS 1.3 connection, in memory: it knows no socket.
 * Flow:    bytes of the link -> [tls_stream] -> what the peer says
 *          what we say -> [tls_stream] -> bytes for the link
 * Threads: a stream belongs to one thread at a time, as does an output.
 *
 * The owner of the link lends what came in, reads until nothing is left, and sends what each call has added
 * to the output. Bytes from a peer yield a status. */
#ifndef LW_COMMON_TLS_STREAM_H
#define LW_COMMON_TLS_STREAM_H

#include "common/base/status.h"

#include <stdint.h>

#define LW_TLS_STREAM_RECORD (16u << 10) /* bytes in one record at most: RFC 8446, 5.1 */

#define LW_TLS_STREAM_TAKEN (60u << 10) /* bytes: 64 KiB, which a system sends in one go, less a record's */

struct ssl_ctx_st; /* OpenSSL's SSL_CTX */
struct lw_tls_stream;

/** Bytes for a link. Zero-initialise; the owner empties it by size = 0. */
struct lw_tls_output {
    uint8_t *bytes;
    size_t size, capacity;
    /* Takes what there is once it is LW_TLS_STREAM_TAKEN, and returns how much: so it is still in the
     * processor's cache when the system reads it. NULL: all stays in `bytes`. */
    size_t (*take)(void *link, const void *bytes, size_t size);
    void *link;
    size_t taken; /* so far */
    bool is_full; /* it did not take all: the rest stays */
};

void lw_tls_output_finish(struct lw_tls_output *output);

/** Makes a context TLS 1.3 alone, sparing of memory, with the fastest cipher that both ends have. [any] */
LW_MUST_CHECK enum lw_status lw_tls_stream_set_up(struct ssl_ctx_st *context);

/** One end of a connection.
 * context certificates that it trusts and its own; set up as above. The stream keeps a reference
 * server_name  whom a client calls, a name or an address. The server's certificate must be for it, unless the
 *              context trusts everybody; NULL: this end is the server
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_tls_stream_create(struct ssl_ctx_st *context, const char *server_name,
                                                  struct lw_tls_stream **out_stream);
/** NULL is fine. */
void lw_tls_stream_destroy(struct lw_tls_stream *stream);

/** Whether the handshake is done: before that nothing may be written. */
bool lw_tls_stream_is_ready(const struct lw_tls_stream *stream);

/** Lends bytes that came by the link. The calls that follow read them. They must stay until a call has said
 * that nothing is left. */
void lw_tls_stream_lend(struct lw_tls_stream *stream, const uint8_t *bytes, size_t size);

/** Shakes hands, then reads what the peer says. A client begins with a call before anything came.
 * *out_size  0: nothing is left.
 * Errors: LW_CLOSED: the peer has ended its stream; LW_NOT_ALLOWED: one end does not trust its peer;
 *         LW_PROTOCOL: the bytes are no TLS 1.3; LW_NO_MEMORY. The output may still tell the peer why. */
LW_MUST_CHECK enum lw_status lw_tls_stream_read(struct lw_tls_stream *stream, uint8_t *dst,
                                                size_t dst_capacity, size_t *out_size,
                                                struct lw_tls_output *output, struct lw_error *err);

/** Says something: all of it is in the output then. Errors: LW_PROTOCOL after a failure; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_tls_stream_write(struct lw_tls_stream *stream, const uint8_t *src,
                                                 size_t src_size, struct lw_tls_output *output);

/** Says that nothing more follows. */
void lw_tls_stream_end(struct lw_tls_stream *stream, struct lw_tls_output *output);

#endif
