/* message.h: the protocol's messages as plain structs, and their bytes. The only
 * user of generated protobuf code.
 * Flow:    structs -> [framed bytes] -> link -> [structs]
 * Threads: pure functions, [any].
 *
 * Encoding gives one whole framed message (header and body), so that its bytes can be shared among sessions.
 * Decoding takes bytes from anyone: LW_PROTOCOL names message and field. Decoded numbers are finite, and
 * counts are within the limits below. Pointers in a decoded struct point into the lw_message, which
 * lw_message_finish() frees. */
#ifndef LW_PROTO_MESSAGE_H
#define LW_PROTO_MESSAGE_H

#include "common/base/token.h"
#include "common/base/vec.h"
#include "common/scene/finish_package.h"
#include "common/scene/package.h"
#include "common/scene/scene_change.h"
#include "common/tile/atlas.h"
#include "common/tile/tile_channels.h"
#include "proto/framing.h"

#define LW_MESSAGE_NAME_MAX             64u   /* bytes of a client's or server's name */
#define LW_MESSAGE_TEXT_MAX             256u  /* bytes of a refusal's text */
#define LW_MESSAGE_TRANSFORMS_MAX       8192u /* in one frame message; a frame with more sends several */
#define LW_MESSAGE_LIGHTS_MAX           8192u
#define LW_MESSAGE_VISIBLE_MAX          8192u /* objects hidden, and as many shown */
#define LW_MESSAGE_MATERIALS_MAX        4096u
#define LW_MESSAGE_CHANGES_MAX          1024u /* in an update */
#define LW_MESSAGE_INTEREST_MAX         4096u
#define LW_MESSAGE_HOLDS_MAX            2048u
#define LW_MESSAGE_PARTS_MAX            (LW_SCENE_TEXTURES_MAX + 2u) /* in a package */
#define LW_MESSAGE_FINISH_PARTS_MAX     8192u      /* in a finish package: both lists fit into a welcome */
#define LW_MESSAGE_CHUNK_MAX            (1u << 18) /* bytes of package data */
#define LW_MESSAGE_PAYLOAD_MAX          (1u << 18) /* bytes of a tile */
#define LW_MESSAGE_REPORT_MAX           (1u << 18) /* bytes of a report */
#define LW_MESSAGE_BOUNCES_MAX          64u
#define LW_MESSAGE_RELAYS_MAX           16u                          /* between a server and a client */
#define LW_MESSAGE_SERVERS_MAX          1024u                        /* bytes of a list of servers */
#define LW_MESSAGE_CLIENT_LIGHTS_MAX    (LW_SCENE_LIGHTS_MAX / 8)    /* bytes: a bit for each */
#define LW_MESSAGE_CLIENT_MATERIALS_MAX (LW_SCENE_MATERIALS_MAX / 8) /* bytes */
/* largest code; those not named below are refusals all the same */
#define LW_MESSAGE_REFUSAL_MAX       65535u
#define LW_MESSAGE_RETRY_AFTER_MAX   3600000u /* ms */
#define LW_MESSAGE_WAITING_STAGE_MAX 65535u   /* stages without a name are stages all the same */
#define LW_MESSAGE_FIELDS_MAX        64u      /* protobuf fields of a body, a packed list counting as one */
/* Zstd's bound for a package. */
#define LW_MESSAGE_COMPRESSED_MAX (LW_PACKAGE_SIZE_MAX + (LW_PACKAGE_SIZE_MAX >> 8))

/* Values are forever. */
#define LW_FEATURE_CONTROL 2u  /* sends updates of the scene */
#define LW_FEATURE_RESUME  4u  /* says what it has */
#define LW_FEATURE_PARTS   16u /* reads packages of several parts */
#define LW_FEATURE_DCT     32u /* reads tiles of LW_TILE_CODEC_DCT; 1 and 8 were earlier forms of them */
#define LW_FEATURE_DRAWS                                                                                     \
    LW_TILE_CHANNELS_DRAWS         /* draws the direct light of client lights: tiles come without it */
#define LW_FEATURE_OPERATE   128u  /* asks as an operator: over the server's own Unix socket alone */
#define LW_FEATURE_MATERIALS 256u  /* may ask for the finish package */
#define LW_FEATURE_FINER     512u  /* may ask for tiles of finer levels */
#define LW_FEATURE_RUNS      1024u /* reads the run of a FRAME */
#define LW_FEATURE_DIRECTION LW_TILE_CHANNELS_DIRECTION /* gets tiles of where light comes from, too */
#define LW_FEATURE_TREE      4096u                      /* a relay that reports which relays are below it */
#define LW_FEATURES_READ                                                                                     \
    (LW_FEATURE_DCT | LW_FEATURE_RESUME | LW_FEATURE_PARTS |                                                 \
     LW_FEATURE_RUNS) /* all that our clients know and need not ask for */

struct lw_message_hello {
    uint32_t version;             /* LW_WIRE_VERSION */
    uint64_t features;            /* LW_FEATURE_* */
    const char *name;             /* the client program's, for the operator's log */
    uint64_t rate_limit_bytes_hz; /* it wants no more; 0: no limit */
    const uint8_t *token;         /* LW_TOKEN_SIZE bytes; NULL: none */
    uint64_t relay;               /* number of the relay that says it; 0: it is none */
};

/** A package as a welcome tells it. */
struct lw_message_package {
    struct lw_package_hash hash;
    uint64_t size;                                    /* bytes of the package */
    uint64_t compressed_size;                         /* bytes of its zstd form, which the chunks carry */
    const uint64_t *part_size, *part_compressed_size; /* per part; they add up to the package's */
    const struct lw_package_hash *part_hash;
    size_t part_count; /* 0: the package is one part, as above */
};

struct lw_message_welcome {
    uint32_t version;
    uint64_t features, session;
    const char *name; /* the server program's, and its version */
    struct lw_package_hash package_hash;
    uint64_t package_size;            /* bytes of the package */
    uint64_t package_compressed_size; /* bytes of its zstd form, which the chunks carry */
    uint32_t bounces;                 /* indirect bounces that a complete tile has */
    float target_error;               /* relative standard error below which a tile counts as converged */
    float noise_shown; /* share of a tile's error that a filter leaves in its texels; 0: not known */
    uint64_t run;      /* the server's: versions and frames compare within it; 0: not known */
    const uint64_t *part_size, *part_compressed_size; /* per part; they add up to the package's */
    const struct lw_package_hash *part_hash;
    size_t part_count; /* 0: the package is one part, as above */
    /* The client draws the direct light of these: a bit for each light and material, the low ones of each
     * byte first; missing bytes count as 0. */
    const uint8_t *client_lights, *client_materials;
    size_t client_lights_size, client_materials_size;
    uint32_t finer;                   /* levels finer than level 0 (atlas.h); 0: none, or not asked for */
    struct lw_message_package finish; /* with parts; size 0: there is none, or it was not asked for */
    const uint64_t *relays; /* for relays: numbers of those that the light comes through, the nearest first */
    size_t relay_count;
    const char *servers; /* where else the light is: addresses, apart by commas; NULL: not known */
};

/* Values are forever. */
enum lw_refusal {
    LW_REFUSAL_VERSION = 1,
    LW_REFUSAL_FULL = 2,
    LW_REFUSAL_PROTOCOL = 3, /* the peer's bytes make no sense */
    LW_REFUSAL_SHUTDOWN = 4,
    LW_REFUSAL_TIMEOUT = 5,
    LW_REFUSAL_FEATURES = 6,    /* the peer lacks one that is needed */
    LW_REFUSAL_RATE = 7,        /* it says too much */
    LW_REFUSAL_NOT_ALLOWED = 8, /* it may not do what it asked for */
    LW_REFUSAL_TOKEN = 9,       /* it has no token, or one that the server does not know */
    LW_REFUSAL_LOOP = 10        /* it is a relay that its own light would come back to */
};

struct lw_message_refusal {
    enum lw_refusal code;
    const char *text;        /* one line for people */
    uint32_t retry_after_ms; /* when to come back; 0: not known */
};

struct lw_message_package_request {
    uint64_t offset;     /* into the compressed package; chunks follow from there to the end */
    const uint8_t *held; /* parts that are not sent: a bit for each, the low ones of each byte first */
    size_t held_size;    /* bytes; those that are missing count as 0 */
};

struct lw_message_package_chunk {
    uint64_t offset;
    const uint8_t *data;
    size_t size;
};

struct lw_message_interest {
    bool everything; /* coarse first; what a client has if it never says otherwise */
    bool stand_ins;  /* also the coarser levels of these tiles, and of every object the coarsest */
    const struct lw_message_interest_tile {
        uint32_t object, level, tile; /* tile: row * tiles_x + column within the level */
    } * tile;
    size_t tile_count;
};

struct lw_message_transform {
    uint32_t object;
    struct lw_affine object_to_world;
};

struct lw_message_light {
    uint32_t light;
    struct lw_vec3 position_ws, direction_ws, intensity;
};

struct lw_message_material {
    uint32_t material;
    float base_colour[3], emission[3]; /* factors */
};

struct lw_message_frame {
    uint64_t frame;        /* from 1; grows */
    double time_s;         /* scene time */
    uint64_t solve_ns;     /* from the moment simulated to the moment published */
    uint64_t rays_total;   /* traced since the daemon started */
    uint64_t tiles_solved; /* in this frame */
    float sky[3];
    /* Transforms and lights that changed since the frame before; all, in the first. */
    const struct lw_message_transform *transform;
    size_t transform_count;
    const struct lw_message_light *light;
    size_t light_count;
    uint64_t server_cpu_ns; /* CPU time of the server's process since it started; 0: not known */
    const uint32_t *hidden; /* objects that are now */
    const uint32_t *shown;  /* objects that are now not hidden */
    size_t hidden_count, shown_count;
    size_t spare_count;                         /* the first ones of `hidden` are spares (scene.h) */
    const struct lw_message_material *material; /* as with transforms */
    size_t material_count;
    uint64_t run;  /* name of the run of versions and frames, as in a welcome; 0: unchanged */
    uint64_t base; /* the frame that changes are listed since; 0: all is listed, or not known */
};

struct lw_message_tile {
    uint32_t object, level, tile;
    uint64_t version; /* the frame that encoded it; grows per tile */
    uint32_t layer;   /* a number of lw_tile_channels(); others are reserved */
    uint32_t codec;   /* LW_TILE_CODEC_* */
    float scale;
    uint32_t bounces; /* indirect bounces that it holds */
    float error;      /* relative standard error of its mean luminance-weighted texels; >= 0 */
    const uint8_t *payload;
    size_t payload_size;
    uint64_t base; /* the version that the payload builds on, < version; 0: none */
};

struct lw_message_ack {
    uint64_t frame; /* newest frame shown */
};

struct lw_message_settled {
    uint64_t frame; /* the last one sent, >= 1 */
};

struct lw_message_update {
    uint64_t request; /* the client's number for it */
    /* Values may be anything: the answer names the wrong one. */
    const struct lw_scene_change *change;
    size_t change_count;
};

struct lw_message_updated {
    uint64_t request;
    uint32_t code;         /* enum lw_scene_change_code, or one of a newer server */
    uint32_t change;       /* which of the update is wrong; 0 for LW_SCENE_CHANGE_BUSY and OK */
    const char *text;      /* one line for people; empty for LW_SCENE_CHANGE_OK */
    uint64_t frame;        /* the first one with the changes; 0: none were made */
    const uint32_t *added; /* the object of each LW_SCENE_CHANGE_OBJECT_ADD, in their order */
    size_t added_count;    /* at most LW_MESSAGE_CHANGES_MAX */
};

struct lw_message_holds {
    const struct lw_message_held {
        uint32_t object, level, tile; /* as in an interest */
        uint64_t version;
    } * tile;
    size_t tile_count;
    uint64_t frame; /* the last one that the client was sent in this run; 0: none */
};

struct lw_message_ping {
    uint64_t token; /* comes back in the pong */
};

/* Values are forever. */
enum lw_ask {
    LW_ASK_STATS = 1, /* figures, as Prometheus gets them */
    LW_ASK_DRAIN = 2  /* to end as at SIGTERM */
};

struct lw_message_ask {
    uint64_t request;         /* comes back in the report */
    uint32_t what;            /* enum lw_ask; others are answered by a code */
    uint32_t return_after_ms; /* DRAIN: what clients get; 0: the server's own */
};

enum lw_report_code { LW_REPORT_DONE = 0, LW_REPORT_UNKNOWN = 1 };

struct lw_message_report {
    uint64_t request;
    uint32_t code; /* enum lw_report_code; others mean no, too */
    const uint8_t *data;
    size_t size; /* bytes; 0 with a code */
};

struct lw_message_waiting {
    uint32_t stage; /* enum lw_waiting_stage, not UNKNOWN, or one of a newer server; at most
                       LW_MESSAGE_WAITING_STAGE_MAX */
    float share;    /* how much of it is done, 0 to 1 */
};

struct lw_message {
    enum lw_message_type type;
    union {
        struct lw_message_hello hello;
        struct lw_message_welcome welcome;
        struct lw_message_refusal refusal;
        struct lw_message_package_request package_request, finish_request;
        struct lw_message_package_chunk package_chunk, finish_chunk;
        struct lw_message_interest interest;
        struct lw_message_frame frame;
        struct lw_message_tile tile;
        struct lw_message_ack ack;
        struct lw_message_ping ping, pong;
        struct lw_message_settled settled;
        struct lw_message_update update;
        struct lw_message_updated updated;
        struct lw_message_holds holds;
        struct lw_message_ask ask;
        struct lw_message_report report;
        struct lw_message_waiting waiting;
    };
    void *storage;       /* what decoding allocated */
    void *scratch;       /* for encoding lists: 4 bytes for each of their numbers; NULL: malloc() */
    size_t scratch_size; /* bytes */
};

#define LW_MESSAGE_MEMORY_MAX (4u << 20) /* bytes of a message; of larger ones not all is kept */

/** Memory for decoding that one message leaves to the next; zeroed to begin with. It grows to what messages
 * need: then decoding allocates nothing. */
struct lw_message_memory {
    uint8_t *block;
    size_t size, used, asked; /* bytes; asked: by the present message */
    size_t budget;            /* a message may ask for no more; 0: any */
};
void lw_message_memory_finish(struct lw_message_memory *memory);

/** The scene package of a welcome. */
struct lw_message_package lw_message_welcome_package(const struct lw_message_welcome *welcome);

/** The type's name as in wire_format.md, e.g. "TILE"; NULL for a type that this version does not know. */
const char *lw_message_name(uint16_t type);

/** Bytes of the framed message. */
size_t lw_message_size(const struct lw_message *message);

/** Writes the framed message. What decoding would refuse is not written.
 * Errors: LW_INTERNAL if dst_capacity is under lw_message_size() or the message
 *         breaks a limit; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_message_encode(const struct lw_message *message, uint8_t *dst,
                                               size_t dst_capacity, size_t *out_size);

/** The same into malloc'ed memory. */
LW_MUST_CHECK enum lw_status lw_message_encode_alloc(const struct lw_message *message, uint8_t **out_bytes,
                                                     size_t *out_size);

/** Checks what wire_format.md asks of a message's values. Errors: LW_PROTOCOL naming message and field. */
LW_MUST_CHECK enum lw_status lw_message_validate(const struct lw_message *message, struct lw_error *err);

/** Decodes one body whose header was read. Errors: LW_PROTOCOL naming message and field; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_message_decode(struct lw_framing_header header, const uint8_t *body,
                                               struct lw_message *out_message, struct lw_error *err);
/** Decodes a message that lies whole in memory, header first, as one of ours does. size: bytes there.
 * Errors: LW_PROTOCOL, also where size is not the message's; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_message_decode_whole(const uint8_t *bytes, size_t size,
                                                     struct lw_message *out_message);
/** The same with memory that is used again; NULL: as lw_message_decode(). A memory has one message at a time:
 * finish it before the next is decoded. A message that asks for more than the budget is LW_PROTOCOL. */
LW_MUST_CHECK enum lw_status lw_message_decode_with(struct lw_framing_header header, const uint8_t *body,
                                                    struct lw_message_memory *memory,
                                                    struct lw_message *out_message, struct lw_error *err);
void lw_message_finish(struct lw_message *message);

#endif
