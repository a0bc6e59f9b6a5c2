/* nats_wire.h: light through NATS: addresses, subjects, and what a message holds. Normative: wire_format.md,
 * "Light through NATS".
 * Flow:    messages of the protocol -> [subjects, payloads] -> NATS -> [payloads] -> messages
 * Threads: pure functions, [any]. Every byte may come from anyone: it gives a status. */
#ifndef LW_PROTO_NATS_WIRE_H
#define LW_PROTO_NATS_WIRE_H

#include "proto/message.h"

#define LW_NATS_WIRE_SCENE_MAX    64u /* bytes of a scene's name */
#define LW_NATS_WIRE_SUBJECT_SIZE 160u
#define LW_NATS_WIRE_PREFIX_SIZE  16u
/* Subjects are kept for each tile of each channel (tile_channels.h), and a FRAME is one message of NATS: what
 * scenes may have. */
#define LW_NATS_WIRE_TILES_MAX   16384u
#define LW_NATS_WIRE_OBJECTS_MAX LW_MESSAGE_TRANSFORMS_MAX /* and lights */
#define LW_NATS_WIRE_FINE_MAX    1024u                     /* tiles of finer levels in a `want` */
#define LW_NATS_WIRE_CHUNKS_MAX  65536u                    /* in a package */
#define LW_NATS_WIRE_ALIVE_MS    1000u                     /* a publisher says so often that it is there */
#define LW_NATS_WIRE_WANT_MS     1500u                     /* a relay says so often what it wants */
#define LW_NATS_WIRE_SILENCE_MS  5000u                     /* after so long it is gone; either of them */

/** nats://[USER:PASSWORD@]HOST:PORT[/SCENE], or tls:// in its place. */
struct lw_nats_wire_address {
    char url[300];  /* for libnats: without the scene */
    char host[256]; /* name or number of its machine: that of a certificate */
    bool tls;
    char name[400]; /* for people: without the password */
    char scene[LW_NATS_WIRE_SCENE_MAX + 1];
};

bool lw_nats_wire_is_address(const char *text);
/** The scene is "scene" unless it is named. Errors: LW_USAGE. */
LW_MUST_CHECK enum lw_status lw_nats_wire_address(const char *text, struct lw_nats_wire_address *out_address,
                                                  struct lw_error *err);

/** "lightwell.SCENE." and the rest, as a format says. */
void lw_nats_wire_subject(char dst[LW_NATS_WIRE_SUBJECT_SIZE], const char *scene, const char *rest, ...)
    __attribute__((format(printf, 3, 4)));

/** The irradiance of a set of channels, a bit for each, as `want` has it: one irradiance, and channels that
 * follow it. UINT32_MAX: it is no such set. */
uint32_t lw_nats_wire_irradiance(uint32_t channels);

/** What a payload begins with. */
struct lw_nats_wire_prefix {
    uint32_t epoch; /* how often the publisher has lost NATS */
    uint64_t run;   /* run of the light */
};
void lw_nats_wire_write_prefix(uint8_t dst[LW_NATS_WIRE_PREFIX_SIZE], struct lw_nats_wire_prefix prefix);

/** A payload that is read: messages follow the prefix. */
struct lw_nats_wire_reader {
    const uint8_t *at;
    size_t left;
};
/** Errors: LW_PROTOCOL: it is none of ours. */
LW_MUST_CHECK enum lw_status lw_nats_wire_read_prefix(const void *bytes, size_t size,
                                                      struct lw_nats_wire_prefix *out_prefix,
                                                      struct lw_nats_wire_reader *out_reader);
/** The next message of a payload, which lw_message_finish() frees. *out_raw: its bytes, of the payload; NULL:
 * there is none, and no message. Errors: LW_PROTOCOL, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_nats_wire_read(struct lw_nats_wire_reader *reader,
                                               struct lw_message *out_message, const uint8_t **out_raw,
                                               size_t *out_raw_size);
/** Takes `size` bytes that are no message; NULL: there are fewer. */
const uint8_t *lw_nats_wire_read_bytes(struct lw_nats_wire_reader *reader, size_t size);

#endif
