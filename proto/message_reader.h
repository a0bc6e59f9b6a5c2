/* message_reader.h: whole messages out of a byte stream that comes in pieces of any size.
 * Flow:    link -> bytes -> [message_reader] -> header and body -> lw_message_decode()
 * Threads: one thread at a time.
 *
 * A message that lies in one piece is not copied. Bytes of a piece that were not taken are kept. */
#ifndef LW_PROTO_MESSAGE_READER_H
#define LW_PROTO_MESSAGE_READER_H

#include "proto/framing.h"

#include <stddef.h>

/** Zero but for body_max is a reader without a byte. */
struct lw_message_reader {
    uint32_t body_max; /* LW_FRAMING_BODY_MAX, or LW_FRAMING_CLIENT_BODY_MAX */
    uint8_t *kept;     /* bytes [begin, end) were not taken yet; the lent bytes come after them */
    size_t begin, end, capacity;
    const uint8_t *lent; /* the caller's */
    size_t lent_size;
};

/** Lends the bytes that come next, until lw_message_reader_keep(). None may be lent already. */
void lw_message_reader_lend(struct lw_message_reader *reader, const uint8_t *bytes, size_t size);

/** Takes the next whole message. *out_body is NULL if there is none; it is valid until the next call.
 * Errors: LW_PROTOCOL as lw_framing_read_header(), on each further call too; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_message_reader_take(struct lw_message_reader *reader,
                                                    struct lw_framing_header *out_header,
                                                    const uint8_t **out_body, struct lw_error *err);

/** Copies the rest of the lent bytes, which are the caller's again. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_message_reader_keep(struct lw_message_reader *reader);

/** Forgets all bytes and frees its memory; the reader can be used again. */
void lw_message_reader_clear(struct lw_message_reader *reader);

#endif
