#include "proto/framing.h"

static void write_le(uint8_t *dst, uint32_t value, unsigned bytes) {
    for (unsigned i = 0; i < bytes; i++) dst[i] = (uint8_t)(value >> (8 * i));
}

static uint32_t read_le(const uint8_t *src, unsigned bytes) {
    uint32_t value = 0;
    for (unsigned i = 0; i < bytes; i++) value |= (uint32_t)src[i] << (8 * i);
    return value;
}

void lw_framing_write_header(uint8_t dst[LW_FRAMING_HEADER_SIZE], struct lw_framing_header header) {
    write_le(dst, header.body_size, 4);
    write_le(dst + 4, header.type, 2);
    write_le(dst + 6, header.flags, 2);
}

enum lw_status lw_framing_read_header(const uint8_t src[LW_FRAMING_HEADER_SIZE], uint32_t body_max,
                                      struct lw_framing_header *out_header, struct lw_error *err) {
    struct lw_framing_header header = {.body_size = read_le(src, 4),
                                       .type = (uint16_t)read_le(src + 4, 2),
                                       .flags = (uint16_t)read_le(src + 6, 2)};
    if (header.body_size > body_max)
        return lw_status_fail(err, LW_PROTOCOL, "message header: a body of %u bytes is over the limit of %u",
                              header.body_size, body_max);
    if (header.flags)
        return lw_status_fail(err, LW_PROTOCOL, "message header: flags are 0x%04x, version %u knows none",
                              (unsigned)header.flags, LW_WIRE_VERSION);
    *out_header = header;
    return LW_OK;
}
