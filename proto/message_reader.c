#include "proto/message_reader.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

void lw_message_reader_lend(struct lw_message_reader *reader, const uint8_t *bytes, size_t size) {
    assert(!reader->lent_size);
    reader->lent = bytes;
    reader->lent_size = size;
}

/* Doubling, so that a message that comes byte by byte is not copied as often. */
static bool reserve(struct lw_message_reader *r, size_t more) {
    if (more <= r->capacity - r->end) return true;
    const size_t kept = r->end - r->begin;
    if (r->begin) memmove(r->kept, r->kept + r->begin, kept);
    r->begin = 0;
    r->end = kept;
    if (more <= r->capacity - kept) return true;
    const size_t needed = kept + more, capacity = needed > 2 * r->capacity ? needed : 2 * r->capacity;
    uint8_t *grown = realloc(r->kept, capacity);
    if (!grown) return false;
    r->kept = grown;
    r->capacity = capacity;
    return true;
}

/* Moves lent bytes to the kept ones until these are `size`, as far as there are any. */
static bool top_up(struct lw_message_reader *r, size_t size) {
    const size_t kept = r->end - r->begin, lacking = size > kept ? size - kept : 0,
                 more = lacking < r->lent_size ? lacking : r->lent_size;
    if (!more) return true;
    if (!reserve(r, more)) return false;
    memcpy(r->kept + r->end, r->lent, more);
    r->end += more;
    r->lent += more;
    r->lent_size -= more;
    return true;
}

/* At the front of `size` bytes. */
static enum lw_status read_front(const struct lw_message_reader *r, const uint8_t *bytes, size_t size,
                                 struct lw_framing_header *out_header, const uint8_t **out_body,
                                 struct lw_error *err) {
    *out_body = NULL;
    if (size < LW_FRAMING_HEADER_SIZE) return LW_OK;
    const enum lw_status status = lw_framing_read_header(bytes, r->body_max, out_header, err);
    if (status == LW_OK && size - LW_FRAMING_HEADER_SIZE >= out_header->body_size)
        *out_body = bytes + LW_FRAMING_HEADER_SIZE;
    return status;
}

static enum lw_status take_kept(struct lw_message_reader *r, struct lw_framing_header *header,
                                const uint8_t **body, struct lw_error *err) {
    if (!top_up(r, LW_FRAMING_HEADER_SIZE)) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    enum lw_status status = read_front(r, r->kept + r->begin, r->end - r->begin, header, body, err);
    if (status != LW_OK || *body || r->end - r->begin < LW_FRAMING_HEADER_SIZE) return status;
    if (!top_up(r, LW_FRAMING_HEADER_SIZE + (size_t)header->body_size))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for a message");
    return read_front(r, r->kept + r->begin, r->end - r->begin, header, body, err);
}

enum lw_status lw_message_reader_take(struct lw_message_reader *r, struct lw_framing_header *out_header,
                                      const uint8_t **out_body, struct lw_error *err) {
    const bool is_kept = r->begin < r->end;
    *out_body = NULL;
    if (!is_kept && !r->lent_size) return LW_OK;
    const enum lw_status status = is_kept ? take_kept(r, out_header, out_body, err)
                                          : read_front(r, r->lent, r->lent_size, out_header, out_body, err);
    if (status != LW_OK || !*out_body) return status;
    const size_t size = LW_FRAMING_HEADER_SIZE + (size_t)out_header->body_size;
    if (is_kept) {
        r->begin += size;
    } else {
        r->lent += size;
        r->lent_size -= size;
    }
    return LW_OK;
}

enum lw_status lw_message_reader_keep(struct lw_message_reader *r) {
    if (r->begin == r->end && !r->lent_size) {
        lw_message_reader_clear(r);
        return LW_OK;
    }
    return top_up(r, r->end - r->begin + r->lent_size) ? LW_OK : LW_NO_MEMORY;
}

void lw_message_reader_clear(struct lw_message_reader *r) {
    free(r->kept);
    *r = (struct lw_message_reader){.body_max = r->body_max};
}
