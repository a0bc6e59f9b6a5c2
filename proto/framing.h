/* framing.h: messages on a byte stream: 8 bytes of header, then a body. Normative: proto/wire_format.md.
 * Threads: pure functions, [any].
 *
 *   offset 0  u32 LE  body length in bytes
 *   offset 4  u16 LE  message type (enum lw_message_type)
 *   offset 6  u16 LE  flags, 0 in version 1 */
#ifndef LW_PROTO_FRAMING_H
#define LW_PROTO_FRAMING_H

#include "common/base/status.h"

#include <stdint.h>

#define LW_WIRE_VERSION            1u
#define LW_FRAMING_HEADER_SIZE     8u
#define LW_FRAMING_BODY_MAX        (1u << 20) /* bytes, server to client */
#define LW_FRAMING_CLIENT_BODY_MAX (1u << 16) /* bytes, client to server */

/* Values are forever. */
enum lw_message_type {
    LW_MESSAGE_HELLO = 1,           /* client -> server, first */
    LW_MESSAGE_WELCOME = 2,         /* server -> client, answer to hello */
    LW_MESSAGE_REFUSAL = 3,         /* server -> client, then closed */
    LW_MESSAGE_PACKAGE_REQUEST = 4, /* client -> server */
    LW_MESSAGE_PACKAGE_CHUNK = 5,   /* server -> client */
    LW_MESSAGE_INTEREST = 6,        /* client -> server */
    LW_MESSAGE_FRAME = 7,           /* server -> client: a frame's transforms, lights, counters */
    LW_MESSAGE_TILE = 8,            /* server -> client */
    LW_MESSAGE_ACK = 9,             /* client -> server */
    LW_MESSAGE_PING = 10,           /* either way */
    LW_MESSAGE_PONG = 11,
    LW_MESSAGE_SETTLED = 12,        /* server -> client: no tile of the last frame is left to send */
    LW_MESSAGE_UPDATE = 13,         /* client -> server: changes of the scene */
    LW_MESSAGE_UPDATED = 14,        /* server -> client, answer to update */
    LW_MESSAGE_HOLDS = 15,          /* client -> server: tiles of an earlier session */
    LW_MESSAGE_ASK = 16,            /* client -> server: as an operator, for figures or an end */
    LW_MESSAGE_REPORT = 17,         /* server -> client: answer to it */
    LW_MESSAGE_WAITING = 18,        /* server -> client: why there is no light yet */
    LW_MESSAGE_FINISH_REQUEST = 19, /* client -> server: as PACKAGE_REQUEST, of the finish package */
    LW_MESSAGE_FINISH_CHUNK = 20    /* server -> client */
};

struct lw_framing_header {
    uint32_t body_size;
    uint16_t type, flags;
};

void lw_framing_write_header(uint8_t dst[LW_FRAMING_HEADER_SIZE], struct lw_framing_header header);

/** Reads a header. Errors: LW_PROTOCOL for a length above body_max or flags that are not 0; an unknown type
 * is for the caller to judge. */
LW_MUST_CHECK enum lw_status lw_framing_read_header(const uint8_t src[LW_FRAMING_HEADER_SIZE],
                                                    uint32_t body_max, struct lw_framing_header *out_header,
                                                    struct lw_error *err);

#endif
