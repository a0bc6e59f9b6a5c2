#include "proto/message.h"

#include "lightwell.pb-c.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

/* type, name, descriptor of the generated code */
#define MESSAGE_MAP(X)                                                                                       \
    X(HELLO, "HELLO", lightwell__wire__hello__descriptor)                                                    \
    X(WELCOME, "WELCOME", lightwell__wire__welcome__descriptor)                                              \
    X(REFUSAL, "REFUSAL", lightwell__wire__refusal__descriptor)                                              \
    X(PACKAGE_REQUEST, "PACKAGE_REQUEST", lightwell__wire__package_request__descriptor)                      \
    X(PACKAGE_CHUNK, "PACKAGE_CHUNK", lightwell__wire__package_chunk__descriptor)                            \
    X(INTEREST, "INTEREST", lightwell__wire__interest__descriptor)                                           \
    X(FRAME, "FRAME", lightwell__wire__frame__descriptor)                                                    \
    X(TILE, "TILE", lightwell__wire__tile__descriptor)                                                       \
    X(ACK, "ACK", lightwell__wire__ack__descriptor)                                                          \
    X(PING, "PING", lightwell__wire__ping__descriptor)                                                       \
    X(PONG, "PONG", lightwell__wire__ping__descriptor)                                                       \
    X(SETTLED, "SETTLED", lightwell__wire__settled__descriptor)                                              \
    X(UPDATE, "UPDATE", lightwell__wire__update__descriptor)                                                 \
    X(UPDATED, "UPDATED", lightwell__wire__updated__descriptor)                                              \
    X(HOLDS, "HOLDS", lightwell__wire__holds__descriptor)                                                    \
    X(ASK, "ASK", lightwell__wire__ask__descriptor)                                                          \
    X(REPORT, "REPORT", lightwell__wire__report__descriptor)                                                 \
    X(WAITING, "WAITING", lightwell__wire__waiting__descriptor)                                              \
    X(FINISH_REQUEST, "FINISH_REQUEST", lightwell__wire__package_request__descriptor)                        \
    X(FINISH_CHUNK, "FINISH_CHUNK", lightwell__wire__package_chunk__descriptor)

#define TRANSFORM_FLOATS 12u
#define VECTOR_FLOATS    3u
#define LIGHT_FLOATS     (3u * VECTOR_FLOATS) /* position, direction, intensity */

const char *lw_message_name(uint16_t type) {
    switch (type) {
#define X(tag, name, descriptor)                                                                             \
    case LW_MESSAGE_##tag:                                                                                   \
        return name;
        MESSAGE_MAP(X)
#undef X
    default:
        return NULL;
    }
}

struct lw_message_package lw_message_welcome_package(const struct lw_message_welcome *w) {
    return (struct lw_message_package){.hash = w->package_hash,
                                       .size = w->package_size,
                                       .compressed_size = w->package_compressed_size,
                                       .part_size = w->part_size,
                                       .part_compressed_size = w->part_compressed_size,
                                       .part_hash = w->part_hash,
                                       .part_count = w->part_count};
}

/* ---- validation ---- */

static enum lw_status invalid(struct lw_error *err, const char *field, const char *must) {
    return lw_status_fail(err, LW_PROTOCOL, "%s %s", field, must);
}

/* The text takes the limit from its constant. verb, unit: "has" 4096 " entries", "is" 64 " bytes" */
static enum lw_status over(struct lw_error *err, const char *field, const char *verb, unsigned limit,
                           const char *unit) {
    return lw_status_fail(err, LW_PROTOCOL, "%s %s over %u%s", field, verb, limit, unit);
}

/* Characters without a shape that change how others read, or hide (Unicode 15, categories Cf,
 * Zl and Zp): first and last. */
static const uint32_t format_characters[][2] = {
    {0xad, 0xad},       {0x600, 0x605},     {0x61c, 0x61c},     {0x6dd, 0x6dd},     {0x70f, 0x70f},
    {0x890, 0x891},     {0x8e2, 0x8e2},     {0x180e, 0x180e},   {0x200b, 0x200f},   {0x2028, 0x202e},
    {0x2060, 0x206f},   {0xfeff, 0xfeff},   {0xfff9, 0xfffb},   {0x110bd, 0x110bd}, {0x110cd, 0x110cd},
    {0x13430, 0x1343f}, {0x1bca0, 0x1bca3}, {0x1d173, 0x1d17a}, {0xe0000, 0xe007f}};

/* For a well-formed character. */
static bool is_format(const unsigned char *s, size_t length) {
    uint32_t point = length == 1 ? s[0] : s[0] & (0x7fu >> length);
    for (size_t i = 1; i < length; i++) point = point << 6 | (s[i] & 0x3f);
    for (size_t i = 0; i < sizeof format_characters / sizeof *format_characters; i++)
        if (point >= format_characters[i][0] && point <= format_characters[i][1]) return true;
    return false;
}

/* Length of the UTF-8 character at s (Unicode 15, table 3-7); 0 if it is malformed or a control character. */
static size_t utf8_length(const unsigned char *s) {
    if (s[0] < 0x80) return s[0] >= 0x20 && s[0] != 0x7f;
    size_t length = s[0] >= 0xf0 ? 4 : s[0] >= 0xe0 ? 3 : 2;
    if (s[0] < 0xc2 || s[0] > 0xf4) return 0;
    for (size_t i = 1; i < length; i++)
        if ((s[i] & 0xc0) != 0x80) return 0;   /* also stops at the final zero */
    if (s[0] == 0xc2 && s[1] < 0xa0) return 0; /* C1 controls move a terminal's cursor */
    if ((s[0] == 0xe0 && s[1] < 0xa0) || (s[0] == 0xed && s[1] > 0x9f)) return 0;
    if ((s[0] == 0xf0 && s[1] < 0x90) || (s[0] == 0xf4 && s[1] > 0x8f)) return 0;
    return length;
}

static enum lw_status check_text(const char *text, size_t size_max, const char *field, struct lw_error *err) {
    if (!text) return LW_OK;
    if (strnlen(text, size_max + 1) > size_max)
        return lw_status_fail(err, LW_PROTOCOL, "%s is over %zu bytes", field, size_max);
    for (const unsigned char *s = (const unsigned char *)text; *s;) {
        size_t length = utf8_length(s);
        if (!length || is_format(s, length))
            return invalid(err, field, "is not UTF-8 without control and format characters");
        s += length;
    }
    return LW_OK;
}

static bool all_finite(const float *value, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (!isfinite(value[i])) return false;
    return true;
}

/* Whether sizes of parts, at least 1 each, add up to that of the whole. */
static bool add_up(const uint64_t *size, size_t count, uint64_t whole) {
    for (size_t i = 0; i < count; i++) {
        if (size[i] < 1 || size[i] > whole) return false;
        whole -= size[i];
    }
    return whole == 0;
}

static enum lw_status check_finish(const struct lw_message_package *f, struct lw_error *err) {
    if (!f->size && !f->compressed_size && !f->part_count) return LW_OK;
    if (f->size < 1 || f->size > LW_FINISH_PACKAGE_SIZE_MAX)
        return invalid(err, "finish_size", "is 0 or over 4294967295 bytes");
    if (f->compressed_size < 1 || f->compressed_size > LW_MESSAGE_COMPRESSED_MAX)
        return invalid(err, "finish_compressed_size", "is 0 or over the limit");
    if (f->part_count > LW_MESSAGE_FINISH_PARTS_MAX)
        return over(err, "finish_part_size", "has", LW_MESSAGE_FINISH_PARTS_MAX, " entries");
    if (!add_up(f->part_size, f->part_count, f->size))
        return invalid(err, "finish_part_size", "has a 0, or is not finish_size in all");
    if (!add_up(f->part_compressed_size, f->part_count, f->compressed_size))
        return invalid(err, "finish_part_compressed_size",
                       "has a 0, or is not finish_compressed_size in all");
    return LW_OK;
}

static enum lw_status check_parts(const struct lw_message_welcome *w, struct lw_error *err) {
    if (!w->part_count) return LW_OK;
    if (w->part_count > LW_MESSAGE_PARTS_MAX)
        return over(err, "part_size", "has", LW_MESSAGE_PARTS_MAX, " entries");
    if (!add_up(w->part_size, w->part_count, w->package_size))
        return invalid(err, "part_size", "has a 0, or is not package_size in all");
    if (!add_up(w->part_compressed_size, w->part_count, w->package_compressed_size))
        return invalid(err, "part_compressed_size", "has a 0, or is not package_compressed_size in all");
    return LW_OK;
}

static enum lw_status check_welcome(const struct lw_message_welcome *w, struct lw_error *err) {
    if (w->package_size < 1 || w->package_size > LW_PACKAGE_SIZE_MAX)
        return lw_status_fail(err, LW_PROTOCOL, "package_size is 0 or over %llu bytes",
                              (unsigned long long)LW_PACKAGE_SIZE_MAX);
    if (w->package_compressed_size < 1 || w->package_compressed_size > LW_MESSAGE_COMPRESSED_MAX)
        return invalid(err, "package_compressed_size", "is 0 or over the limit");
    if (w->bounces > LW_MESSAGE_BOUNCES_MAX) return over(err, "bounces", "is", LW_MESSAGE_BOUNCES_MAX, "");
    if (!isfinite(w->target_error) || w->target_error < 0)
        return invalid(err, "target_error", "is not a finite number >= 0");
    if (!(w->noise_shown >= 0 && w->noise_shown <= 1))
        return invalid(err, "noise_shown", "is not from 0 to 1");
    if (w->finer > LW_ATLAS_FINER_MAX) return over(err, "finer", "is", LW_ATLAS_FINER_MAX, "");
    if (w->client_lights_size > LW_MESSAGE_CLIENT_LIGHTS_MAX)
        return over(err, "client_lights", "is", LW_MESSAGE_CLIENT_LIGHTS_MAX, " bytes");
    if (w->client_materials_size > LW_MESSAGE_CLIENT_MATERIALS_MAX)
        return over(err, "client_materials", "is", LW_MESSAGE_CLIENT_MATERIALS_MAX, " bytes");
    if (w->relay_count > LW_MESSAGE_RELAYS_MAX)
        return over(err, "relays", "has", LW_MESSAGE_RELAYS_MAX, " entries");
    enum lw_status status = check_parts(w, err);
    if (status == LW_OK) status = check_finish(&w->finish, err);
    if (status == LW_OK) status = check_text(w->servers, LW_MESSAGE_SERVERS_MAX, "servers", err);
    return status != LW_OK ? status : check_text(w->name, LW_MESSAGE_NAME_MAX, "name", err);
}

static enum lw_status check_refusal(const struct lw_message_refusal *r, struct lw_error *err) {
    if ((unsigned)r->code < 1 || (unsigned)r->code > LW_MESSAGE_REFUSAL_MAX)
        return invalid(err, "code", "is not in 1..65535");
    if (r->retry_after_ms > LW_MESSAGE_RETRY_AFTER_MAX)
        return over(err, "retry_after_ms", "is", LW_MESSAGE_RETRY_AFTER_MAX, "");
    return check_text(r->text, LW_MESSAGE_TEXT_MAX, "text", err);
}

static enum lw_status check_chunk(const struct lw_message_package_chunk *c, struct lw_error *err) {
    if (c->size < 1 || c->size > LW_MESSAGE_CHUNK_MAX) return invalid(err, "data", "is not 1..262144 bytes");
    if (c->offset > LW_MESSAGE_COMPRESSED_MAX - c->size) return invalid(err, "offset", "is past the limit");
    return LW_OK;
}

static enum lw_status check_interest(const struct lw_message_interest *i, struct lw_error *err) {
    if (i->tile_count > LW_MESSAGE_INTEREST_MAX)
        return over(err, "tile", "has", LW_MESSAGE_INTEREST_MAX, " entries");
    if (i->everything && i->tile_count)
        return invalid(err, "tile", "is not empty though everything is wanted");
    return LW_OK;
}

static enum lw_status check_frame_state(const struct lw_message_frame *f, struct lw_error *err) {
    if (f->hidden_count > LW_MESSAGE_VISIBLE_MAX)
        return over(err, "hidden_object", "has", LW_MESSAGE_VISIBLE_MAX, " entries");
    if (f->shown_count > LW_MESSAGE_VISIBLE_MAX)
        return over(err, "shown_object", "has", LW_MESSAGE_VISIBLE_MAX, " entries");
    if (f->spare_count > f->hidden_count)
        return invalid(err, "spares", "is over the length of hidden_object");
    if (f->material_count > LW_MESSAGE_MATERIALS_MAX)
        return over(err, "material", "has", LW_MESSAGE_MATERIALS_MAX, " entries");
    for (size_t i = 0; i < f->material_count; i++)
        for (int c = 0; c < 3; c++) {
            const struct lw_message_material *m = &f->material[i];
            if (!isfinite(m->base_colour[c]) || m->base_colour[c] < 0)
                return invalid(err, "base_colour", "is not finite and >= 0");
            if (!isfinite(m->emission[c]) || m->emission[c] < 0)
                return invalid(err, "emission", "is not finite and >= 0");
        }
    return LW_OK;
}

static enum lw_status check_frame(const struct lw_message_frame *f, struct lw_error *err) {
    if (f->frame < 1) return invalid(err, "frame", "is 0");
    if (!isfinite(f->time_s)) return invalid(err, "time_s", "is not finite");
    for (int c = 0; c < 3; c++)
        if (!isfinite(f->sky[c]) || f->sky[c] < 0) return invalid(err, "sky", "is not finite and >= 0");
    if (f->transform_count > LW_MESSAGE_TRANSFORMS_MAX)
        return over(err, "transform_object", "has", LW_MESSAGE_TRANSFORMS_MAX, " entries");
    if (f->light_count > LW_MESSAGE_LIGHTS_MAX)
        return over(err, "light", "has", LW_MESSAGE_LIGHTS_MAX, " entries");
    for (size_t i = 0; i < f->transform_count; i++)
        if (!all_finite(&f->transform[i].object_to_world.m[0][0], TRANSFORM_FLOATS))
            return invalid(err, "transform", "is not finite");
    for (size_t i = 0; i < f->light_count; i++) {
        const struct lw_message_light *l = &f->light[i];
        if (!lw_vec3_is_finite(l->position_ws)) return invalid(err, "light_position", "is not finite");
        if (!lw_vec3_is_finite(l->direction_ws)) return invalid(err, "light_direction", "is not finite");
        if (!lw_vec3_is_finite(l->intensity)) return invalid(err, "light_intensity", "is not finite");
    }
    return check_frame_state(f, err);
}

static enum lw_status check_tile(const struct lw_message_tile *t, struct lw_error *err) {
    if (t->version < 1) return invalid(err, "version", "is 0");
    if (t->base >= t->version) return invalid(err, "base_version", "is not under the version");
    if (!isfinite(t->scale) || t->scale <= 0) return invalid(err, "scale", "is not a finite number > 0");
    if (t->bounces > LW_MESSAGE_BOUNCES_MAX) return over(err, "bounces", "is", LW_MESSAGE_BOUNCES_MAX, "");
    if (!isfinite(t->error) || t->error < 0) return invalid(err, "error", "is not a finite number >= 0");
    if (t->payload_size < 1 || t->payload_size > LW_MESSAGE_PAYLOAD_MAX)
        return invalid(err, "payload", "is not 1..262144 bytes");
    return LW_OK;
}

/* What the changes say is for the server to answer; here they must only fit. */
static enum lw_status check_update(const struct lw_message_update *u, struct lw_error *err) {
    if (u->change_count > LW_MESSAGE_CHANGES_MAX)
        return over(err, "kind", "has", LW_MESSAGE_CHANGES_MAX, " entries");
    for (size_t i = 0; i < u->change_count; i++)
        if (u->change[i].value_count > LW_SCENE_CHANGE_VALUES_MAX)
            return over(err, "value_count", "is", LW_SCENE_CHANGE_VALUES_MAX, "");
    return LW_OK;
}

static enum lw_status check_values(const struct lw_message *m, struct lw_error *err) {
    switch (m->type) {
    case LW_MESSAGE_HELLO:
        return check_text(m->hello.name, LW_MESSAGE_NAME_MAX, "name", err);
    case LW_MESSAGE_WELCOME:
        return check_welcome(&m->welcome, err);
    case LW_MESSAGE_REFUSAL:
        return check_refusal(&m->refusal, err);
    case LW_MESSAGE_PACKAGE_REQUEST:
    case LW_MESSAGE_FINISH_REQUEST:
        if (m->package_request.offset > LW_MESSAGE_COMPRESSED_MAX)
            return invalid(err, "offset", "is past the limit");
        if (m->package_request.held_size > LW_MESSAGE_PARTS_MAX / 8 + 1)
            return over(err, "held", "is", LW_MESSAGE_PARTS_MAX / 8 + 1, " bytes");
        return LW_OK;
    case LW_MESSAGE_PACKAGE_CHUNK:
    case LW_MESSAGE_FINISH_CHUNK:
        return check_chunk(&m->package_chunk, err);
    case LW_MESSAGE_INTEREST:
        return check_interest(&m->interest, err);
    case LW_MESSAGE_FRAME:
        return check_frame(&m->frame, err);
    case LW_MESSAGE_TILE:
        return check_tile(&m->tile, err);
    case LW_MESSAGE_SETTLED:
        return m->settled.frame < 1 ? invalid(err, "frame", "is 0") : LW_OK;
    case LW_MESSAGE_UPDATE:
        return check_update(&m->update, err);
    case LW_MESSAGE_UPDATED:
        if (m->updated.added_count > LW_MESSAGE_CHANGES_MAX)
            return over(err, "added", "has", LW_MESSAGE_CHANGES_MAX, " entries");
        if (m->updated.added_count && m->updated.code)
            return invalid(err, "added", "has entries though it is refused");
        return check_text(m->updated.text, LW_MESSAGE_TEXT_MAX, "text", err);
    case LW_MESSAGE_HOLDS:
        return m->holds.tile_count > LW_MESSAGE_HOLDS_MAX
                   ? over(err, "tile", "has", LW_MESSAGE_HOLDS_MAX, " entries")
                   : LW_OK;
    case LW_MESSAGE_ASK:
        return m->ask.return_after_ms > LW_MESSAGE_RETRY_AFTER_MAX
                   ? over(err, "return_after_ms", "is", LW_MESSAGE_RETRY_AFTER_MAX, "")
                   : LW_OK;
    case LW_MESSAGE_REPORT:
        if (m->report.size > LW_MESSAGE_REPORT_MAX)
            return over(err, "data", "is", LW_MESSAGE_REPORT_MAX, " bytes");
        return m->report.code && m->report.size ? invalid(err, "data", "is there though it is refused")
                                                : LW_OK;
    case LW_MESSAGE_WAITING:
        if (m->waiting.stage < 1 || m->waiting.stage > LW_MESSAGE_WAITING_STAGE_MAX)
            return invalid(err, "stage", "is not in 1..65535");
        return m->waiting.share >= 0 && m->waiting.share <= 1 ? LW_OK
                                                              : invalid(err, "share", "is not from 0 to 1");
    case LW_MESSAGE_ACK:
    case LW_MESSAGE_PING:
    case LW_MESSAGE_PONG:
        return LW_OK;
    }
    return lw_status_fail(err, LW_PROTOCOL, "type %u is unknown", (unsigned)m->type);
}

enum lw_status lw_message_validate(const struct lw_message *message, struct lw_error *err) {
    enum lw_status status = check_values(message, err);
    const char *name = lw_message_name((uint16_t)message->type);
    if (status != LW_OK) lw_status_context(err, "message %s", name ? name : "of unknown type");
    return status;
}

/* ---- encoding ---- */

union wire {
    ProtobufCMessage base;
    Lightwell__Wire__Hello hello;
    Lightwell__Wire__Welcome welcome;
    Lightwell__Wire__Refusal refusal;
    Lightwell__Wire__PackageRequest package_request;
    Lightwell__Wire__PackageChunk package_chunk;
    Lightwell__Wire__Interest interest;
    Lightwell__Wire__Frame frame;
    Lightwell__Wire__Tile tile;
    Lightwell__Wire__Ack ack;
    Lightwell__Wire__Ping ping;
    Lightwell__Wire__Settled settled;
    Lightwell__Wire__Update update;
    Lightwell__Wire__Updated updated;
    Lightwell__Wire__Holds holds;
    Lightwell__Wire__Ask ask;
    Lightwell__Wire__Report report;
    Lightwell__Wire__Waiting waiting;
};

static const ProtobufCMessageDescriptor *descriptor_of(unsigned type) {
    switch (type) {
#define X(tag, name, descriptor)                                                                             \
    case LW_MESSAGE_##tag:                                                                                   \
        return &descriptor;
        MESSAGE_MAP(X)
#undef X
    default:
        return NULL;
    }
}

/* protobuf-c's structs are not const, but packing only reads. */
static char *text_of(const char *text) { return (char *)(text ? text : ""); }

static void fill_finish(Lightwell__Wire__Welcome *w, const struct lw_message_package *f) {
    if (!f->size) return;
    w->finish_hash = (ProtobufCBinaryData){sizeof f->hash.bytes, (uint8_t *)f->hash.bytes};
    w->finish_size = f->size;
    w->finish_compressed_size = f->compressed_size;
    w->n_finish_part_size = w->n_finish_part_compressed_size = f->part_count;
    w->finish_part_size = (uint64_t *)f->part_size;
    w->finish_part_compressed_size = (uint64_t *)f->part_compressed_size;
    w->finish_part_hash =
        (ProtobufCBinaryData){f->part_count * sizeof *f->part_hash, (uint8_t *)f->part_hash};
}

/* Everything but the lists that differ in layout. */
static void fill_scalars(union wire *wire, const struct lw_message *m) {
    protobuf_c_message_init(descriptor_of(m->type), wire);
    switch (m->type) {
    case LW_MESSAGE_HELLO:
        wire->hello.version = m->hello.version;
        wire->hello.features = m->hello.features;
        wire->hello.name = text_of(m->hello.name);
        wire->hello.rate_limit = m->hello.rate_limit_bytes_hz;
        wire->hello.token.data = (uint8_t *)m->hello.token;
        wire->hello.token.len = m->hello.token ? LW_TOKEN_SIZE : 0;
        wire->hello.relay = m->hello.relay;
        break;
    case LW_MESSAGE_WELCOME:
        wire->welcome.version = m->welcome.version;
        wire->welcome.features = m->welcome.features;
        wire->welcome.session = m->welcome.session;
        wire->welcome.name = text_of(m->welcome.name);
        wire->welcome.package_hash = (ProtobufCBinaryData){sizeof m->welcome.package_hash.bytes,
                                                           (uint8_t *)m->welcome.package_hash.bytes};
        wire->welcome.package_size = m->welcome.package_size;
        wire->welcome.package_compressed_size = m->welcome.package_compressed_size;
        wire->welcome.bounces = m->welcome.bounces;
        wire->welcome.target_error = m->welcome.target_error;
        wire->welcome.noise_shown = m->welcome.noise_shown;
        wire->welcome.run = m->welcome.run;
        wire->welcome.finer = m->welcome.finer;
        wire->welcome.n_part_size = wire->welcome.n_part_compressed_size = m->welcome.part_count;
        wire->welcome.part_size = (uint64_t *)m->welcome.part_size;
        wire->welcome.part_compressed_size = (uint64_t *)m->welcome.part_compressed_size;
        wire->welcome.part_hash = (ProtobufCBinaryData){m->welcome.part_count * sizeof *m->welcome.part_hash,
                                                        (uint8_t *)m->welcome.part_hash};
        wire->welcome.client_lights =
            (ProtobufCBinaryData){m->welcome.client_lights_size, (uint8_t *)m->welcome.client_lights};
        wire->welcome.client_materials =
            (ProtobufCBinaryData){m->welcome.client_materials_size, (uint8_t *)m->welcome.client_materials};
        wire->welcome.n_relays = m->welcome.relay_count;
        wire->welcome.relays = (uint64_t *)m->welcome.relays;
        wire->welcome.servers = text_of(m->welcome.servers);
        fill_finish(&wire->welcome, &m->welcome.finish);
        break;
    case LW_MESSAGE_REFUSAL:
        wire->refusal.code = (uint32_t)m->refusal.code;
        wire->refusal.text = text_of(m->refusal.text);
        wire->refusal.retry_after_ms = m->refusal.retry_after_ms;
        break;
    case LW_MESSAGE_PACKAGE_REQUEST:
    case LW_MESSAGE_FINISH_REQUEST:
        wire->package_request.offset = m->package_request.offset;
        wire->package_request.held =
            (ProtobufCBinaryData){m->package_request.held_size, (uint8_t *)m->package_request.held};
        break;
    case LW_MESSAGE_PACKAGE_CHUNK:
    case LW_MESSAGE_FINISH_CHUNK:
        wire->package_chunk.offset = m->package_chunk.offset;
        wire->package_chunk.data =
            (ProtobufCBinaryData){m->package_chunk.size, (uint8_t *)m->package_chunk.data};
        break;
    case LW_MESSAGE_INTEREST:
        wire->interest.everything = m->interest.everything;
        wire->interest.stand_ins = m->interest.stand_ins;
        break;
    case LW_MESSAGE_FRAME:
        wire->frame.frame = m->frame.frame;
        wire->frame.time_s = m->frame.time_s;
        wire->frame.solve_ns = m->frame.solve_ns;
        wire->frame.rays_total = m->frame.rays_total;
        wire->frame.tiles_solved = m->frame.tiles_solved;
        wire->frame.server_cpu_ns = m->frame.server_cpu_ns;
        wire->frame.n_sky = 3;
        wire->frame.sky = (float *)m->frame.sky;
        wire->frame.n_hidden_object = m->frame.hidden_count;
        wire->frame.hidden_object = (uint32_t *)m->frame.hidden;
        wire->frame.n_shown_object = m->frame.shown_count;
        wire->frame.shown_object = (uint32_t *)m->frame.shown;
        wire->frame.spares = (uint32_t)m->frame.spare_count;
        wire->frame.run = m->frame.run;
        wire->frame.base_frame = m->frame.base;
        break;
    case LW_MESSAGE_TILE:
        wire->tile.object = m->tile.object;
        wire->tile.level = m->tile.level;
        wire->tile.tile = m->tile.tile;
        wire->tile.version = m->tile.version;
        wire->tile.layer = m->tile.layer;
        wire->tile.codec = m->tile.codec;
        wire->tile.scale = m->tile.scale;
        wire->tile.bounces = m->tile.bounces;
        wire->tile.error = m->tile.error;
        wire->tile.payload = (ProtobufCBinaryData){m->tile.payload_size, (uint8_t *)m->tile.payload};
        wire->tile.base_version = m->tile.base;
        break;
    case LW_MESSAGE_ACK:
        wire->ack.frame = m->ack.frame;
        break;
    case LW_MESSAGE_SETTLED:
        wire->settled.frame = m->settled.frame;
        break;
    case LW_MESSAGE_UPDATE:
        wire->update.request = m->update.request;
        break;
    case LW_MESSAGE_UPDATED:
        wire->updated.request = m->updated.request;
        wire->updated.code = m->updated.code;
        wire->updated.change = m->updated.change;
        wire->updated.text = text_of(m->updated.text);
        wire->updated.frame = m->updated.frame;
        wire->updated.n_added = m->updated.added_count;
        wire->updated.added = (uint32_t *)m->updated.added;
        break;
    case LW_MESSAGE_PING:
    case LW_MESSAGE_PONG:
        wire->ping.token = m->ping.token;
        break; /* one layout for both */
    case LW_MESSAGE_HOLDS:
        wire->holds.frame = m->holds.frame;
        break;
    case LW_MESSAGE_ASK:
        wire->ask.request = m->ask.request;
        wire->ask.what = m->ask.what;
        wire->ask.return_after_ms = m->ask.return_after_ms;
        break;
    case LW_MESSAGE_REPORT:
        wire->report.request = m->report.request;
        wire->report.code = m->report.code;
        wire->report.data.data = (uint8_t *)m->report.data;
        wire->report.data.len = m->report.size;
        break;
    case LW_MESSAGE_WAITING:
        wire->waiting.stage = m->waiting.stage;
        wire->waiting.share = m->waiting.share;
        break;
    }
}

static size_t value_total(const struct lw_message_update *u) {
    size_t total = 0;
    for (size_t i = 0; i < u->change_count; i++) total += u->change[i].value_count;
    return total;
}

#define HELD_WORDS 5u /* object, level, tile, and two of the version */

/* The lists of INTEREST, FRAME, UPDATE and HOLDS in memory: words of 4 bytes, as on the wire. */
static size_t list_words(const struct lw_message *m) {
    const struct lw_message_frame *f = &m->frame;
    if (m->type == LW_MESSAGE_INTEREST) return 3 * m->interest.tile_count;
    if (m->type == LW_MESSAGE_FRAME)
        return (1 + TRANSFORM_FLOATS) * f->transform_count + (1 + LIGHT_FLOATS) * f->light_count +
               (1 + 2 * VECTOR_FLOATS) * f->material_count;
    if (m->type == LW_MESSAGE_UPDATE) return 3 * m->update.change_count + value_total(&m->update);
    if (m->type == LW_MESSAGE_HOLDS) return HELD_WORDS * m->holds.tile_count;
    return 0;
}

static void fill_interest(Lightwell__Wire__Interest *wire, const struct lw_message_interest *m, void *words) {
    size_t count = m->tile_count;
    uint32_t *object = words, *level = object + count, *tile = level + count;
    for (size_t i = 0; i < count; i++) {
        object[i] = m->tile[i].object;
        level[i] = m->tile[i].level;
        tile[i] = m->tile[i].tile;
    }
    wire->n_object = wire->n_level = wire->n_tile = count;
    wire->object = object;
    wire->level = level;
    wire->tile = tile;
}

static void fill_frame(Lightwell__Wire__Frame *wire, const struct lw_message_frame *m, void *words) {
    size_t transforms = m->transform_count, lights = m->light_count, materials = m->material_count;
    uint32_t *object = words, *light = object + transforms, *material = light + lights;
    float *transform = (float *)(material + materials), *position = transform + TRANSFORM_FLOATS * transforms,
          *direction = position + VECTOR_FLOATS * lights, *intensity = direction + VECTOR_FLOATS * lights,
          *base_colour = intensity + VECTOR_FLOATS * lights,
          *emission = base_colour + VECTOR_FLOATS * materials;
    for (size_t i = 0; i < transforms; i++) {
        object[i] = m->transform[i].object;
        memcpy(transform + TRANSFORM_FLOATS * i, m->transform[i].object_to_world.m,
               TRANSFORM_FLOATS * sizeof *transform);
    }
    for (size_t i = 0; i < lights; i++) {
        const struct lw_message_light *l = &m->light[i];
        light[i] = l->light;
        memcpy(position + VECTOR_FLOATS * i, &l->position_ws, VECTOR_FLOATS * sizeof *position);
        memcpy(direction + VECTOR_FLOATS * i, &l->direction_ws, VECTOR_FLOATS * sizeof *direction);
        memcpy(intensity + VECTOR_FLOATS * i, &l->intensity, VECTOR_FLOATS * sizeof *intensity);
    }
    for (size_t i = 0; i < materials; i++) {
        material[i] = m->material[i].material;
        memcpy(base_colour + VECTOR_FLOATS * i, m->material[i].base_colour,
               VECTOR_FLOATS * sizeof *base_colour);
        memcpy(emission + VECTOR_FLOATS * i, m->material[i].emission, VECTOR_FLOATS * sizeof *emission);
    }
    wire->n_transform_object = transforms;
    wire->transform_object = object;
    wire->n_transform = TRANSFORM_FLOATS * transforms;
    wire->transform = transform;
    wire->n_light = lights;
    wire->light = light;
    wire->n_light_position = wire->n_light_direction = wire->n_light_intensity = VECTOR_FLOATS * lights;
    wire->light_position = position;
    wire->light_direction = direction;
    wire->light_intensity = intensity;
    wire->n_material = materials;
    wire->material = material;
    wire->n_base_colour = wire->n_emission = VECTOR_FLOATS * materials;
    wire->base_colour = base_colour;
    wire->emission = emission;
}

static void fill_update(Lightwell__Wire__Update *wire, const struct lw_message_update *m, void *words) {
    size_t count = m->change_count, values = 0;
    uint32_t *kind = words, *target = kind + count, *value_count = target + count;
    float *value = (float *)(value_count + count);
    for (size_t i = 0; i < count; i++) {
        kind[i] = m->change[i].kind;
        target[i] = m->change[i].target;
        value_count[i] = m->change[i].value_count;
        memcpy(value + values, m->change[i].value, value_count[i] * sizeof *value);
        values += value_count[i];
    }
    wire->n_kind = wire->n_target = wire->n_value_count = count;
    wire->kind = kind;
    wire->target = target;
    wire->value_count = value_count;
    wire->n_value = values;
    wire->value = value;
}

static void fill_holds(Lightwell__Wire__Holds *wire, const struct lw_message_holds *m, void *words) {
    size_t count = m->tile_count;
    uint64_t *version = words;
    uint32_t *object = (uint32_t *)(version + count), *level = object + count, *tile = level + count;
    for (size_t i = 0; i < count; i++) {
        object[i] = m->tile[i].object;
        level[i] = m->tile[i].level;
        tile[i] = m->tile[i].tile;
        version[i] = m->tile[i].version;
    }
    wire->n_object = wire->n_level = wire->n_tile = wire->n_version = count;
    wire->object = object;
    wire->level = level;
    wire->tile = tile;
    wire->version = version;
}

/* words: list_words() of them; they back the lists of wire, but those that have the wire's layout already. */
static void fill_lists(union wire *wire, const struct lw_message *m, void *words) {
    if (m->type == LW_MESSAGE_INTEREST) fill_interest(&wire->interest, &m->interest, words);
    if (m->type == LW_MESSAGE_FRAME) fill_frame(&wire->frame, &m->frame, words);
    if (m->type == LW_MESSAGE_UPDATE) fill_update(&wire->update, &m->update, words);
    if (m->type == LW_MESSAGE_HOLDS) fill_holds(&wire->holds, &m->holds, words);
}

/* Bytes on the wire of a packed list of 4-byte words: tag, length, data. */
static size_t packed_size(unsigned field, size_t words) {
    if (!words) return 0;
    size_t bytes = 4 * words, length_bytes = 1;
    for (size_t v = bytes; v >= 0x80; v >>= 7) length_bytes++;
    return (field < 16 ? 1 : 2) + length_bytes + bytes;
}

static size_t lists_size(const struct lw_message *m) {
    const struct lw_message_frame *f = &m->frame;
    const struct lw_message_update *u = &m->update;
    if (m->type == LW_MESSAGE_INTEREST) return 3 * packed_size(2, m->interest.tile_count);
    if (m->type == LW_MESSAGE_FRAME)
        return packed_size(7, f->transform_count) + packed_size(8, TRANSFORM_FLOATS * f->transform_count) +
               packed_size(9, f->light_count) + 3 * packed_size(10, VECTOR_FLOATS * f->light_count) +
               packed_size(16, f->material_count) + 2 * packed_size(17, VECTOR_FLOATS * f->material_count);
    if (m->type == LW_MESSAGE_UPDATE)
        return 3 * packed_size(2, u->change_count) + packed_size(5, value_total(u));
    if (m->type == LW_MESSAGE_HOLDS)
        return 3 * packed_size(1, m->holds.tile_count) + packed_size(4, 2 * m->holds.tile_count);
    return 0;
}

size_t lw_message_size(const struct lw_message *message) {
    union wire wire;
    fill_scalars(&wire, message);
    return LW_FRAMING_HEADER_SIZE + protobuf_c_message_get_packed_size(&wire.base) + lists_size(message);
}

static uint32_t body_max(unsigned type) {
    switch (type) {
    case LW_MESSAGE_HELLO:
    case LW_MESSAGE_PACKAGE_REQUEST:
    case LW_MESSAGE_FINISH_REQUEST:
    case LW_MESSAGE_INTEREST:
    case LW_MESSAGE_ACK:
    case LW_MESSAGE_PING:
    case LW_MESSAGE_PONG:
    case LW_MESSAGE_UPDATE:
    case LW_MESSAGE_HOLDS:
    case LW_MESSAGE_ASK:
        return LW_FRAMING_CLIENT_BODY_MAX;
    default:
        return LW_FRAMING_BODY_MAX;
    }
}

enum lw_status lw_message_encode(const struct lw_message *message, uint8_t *dst, size_t dst_capacity,
                                 size_t *out_size) {
    if (lw_message_validate(message, NULL) != LW_OK) return LW_INTERNAL;
    size_t size = lw_message_size(message), words = list_words(message);
    if (dst_capacity < size || size - LW_FRAMING_HEADER_SIZE > body_max(message->type)) return LW_INTERNAL;
    void *lists = message->scratch && message->scratch_size >= words * 4 ? message->scratch : NULL,
         *own = NULL;
    if (words && !lists && !(lists = own = malloc(words * 4))) return LW_NO_MEMORY;
    union wire wire;
    fill_scalars(&wire, message);
    if (words) fill_lists(&wire, message, lists);
    size_t body_size = protobuf_c_message_pack(&wire.base, dst + LW_FRAMING_HEADER_SIZE);
    free(own);
    assert(body_size == size - LW_FRAMING_HEADER_SIZE);
    lw_framing_write_header(
        dst, (struct lw_framing_header){.body_size = (uint32_t)body_size, .type = (uint16_t)message->type});
    *out_size = size;
    return LW_OK;
}

enum lw_status lw_message_encode_alloc(const struct lw_message *message, uint8_t **out_bytes,
                                       size_t *out_size) {
    size_t capacity = lw_message_size(message);
    uint8_t *bytes = malloc(capacity);
    if (!bytes) return LW_NO_MEMORY;
    enum lw_status status = lw_message_encode(message, bytes, capacity, out_size);
    if (status == LW_OK)
        *out_bytes = bytes;
    else
        free(bytes);
    return status;
}

/* ---- decoding ---- */

/* What a decoded message owns. */
struct storage {
    struct lw_message_memory *memory; /* NULL: all comes from malloc() */
    bool out_of_memory; /* protobuf-c answers NULL to a body without memory and to one without sense */
    bool over_budget;   /* then it is that */
    ProtobufCMessage *proto;
    void *list[3];
};

/* From the block while there is room; what there is no room for makes the block
 * grow before the next message. */
static void *allocate(struct lw_message_memory *memory, size_t size) {
    const size_t bytes = (size + _Alignof(max_align_t) - 1) / _Alignof(max_align_t) * _Alignof(max_align_t);
    if (!memory) return malloc(size ? size : 1);
    if (bytes < size) return NULL;
    memory->asked += bytes;
    if (!memory->block || bytes > memory->size - memory->used) return malloc(size ? size : 1);
    memory->used += bytes;
    return memory->block + memory->used - bytes;
}

static void give_back(struct lw_message_memory *memory, void *bytes) {
    const uint8_t *at = bytes;
    if (!memory || !memory->block || at < memory->block || at >= memory->block + memory->size) free(bytes);
}

static void *storage_alloc(void *context, size_t size) {
    struct storage *storage = context;
    const struct lw_message_memory *memory = storage->memory;
    if (memory && memory->budget && (memory->asked > memory->budget || size > memory->budget - memory->asked))
        storage->over_budget = true;
    void *bytes = storage->over_budget ? NULL : allocate(storage->memory, size);
    if (!bytes) storage->out_of_memory = true;
    return bytes;
}
static void storage_free(void *context, void *bytes) {
    give_back(((const struct storage *)context)->memory, bytes);
}

/* No message is alive: the block may go elsewhere. Without memory for a larger one it stays. */
static void begin_memory(struct lw_message_memory *memory) {
    const size_t wanted = memory->asked < LW_MESSAGE_MEMORY_MAX ? memory->asked : LW_MESSAGE_MEMORY_MAX;
    memory->used = memory->asked = 0;
    if (wanted <= memory->size) return;
    uint8_t *larger = malloc(2 * wanted);
    if (!larger) return;
    free(memory->block);
    memory->block = larger;
    memory->size = 2 * wanted;
}

void lw_message_memory_finish(struct lw_message_memory *memory) {
    free(memory->block);
    *memory = (struct lw_message_memory){0};
}

static bool skip_varint(const uint8_t *body, size_t size, size_t *at, uint64_t *out_value) {
    uint64_t value = 0;
    for (unsigned shift = 0; shift < 70 && *at < size; shift += 7) {
        uint8_t byte = body[(*at)++];
        if (shift < 64) value |= (uint64_t)(byte & 0x7f) << shift;
        if (!(byte & 0x80)) {
            *out_value = value;
            return true;
        }
    }
    return false;
}

/* Walks the fields before protobuf-c does: it keeps some 40 bytes for every field, so a body of two-byte
 * fields would cost twenty times its size. */
static enum lw_status check_fields(const uint8_t *body, size_t size, struct lw_error *err) {
    uint64_t key, length;
    size_t at = 0;
    for (unsigned fields = 0; at < size; fields++) {
        if (fields == LW_MESSAGE_FIELDS_MAX)
            return lw_status_fail(err, LW_PROTOCOL, "has over %u fields", LW_MESSAGE_FIELDS_MAX);
        if (!skip_varint(body, size, &at, &key)) goto cut_off;
        switch (key & 7) {
        case 0:
            if (!skip_varint(body, size, &at, &length)) goto cut_off;
            continue;
        case 1:
            length = 8;
            break;
        case 2:
            if (!skip_varint(body, size, &at, &length)) goto cut_off;
            break;
        case 5:
            length = 4;
            break;
        default:
            return lw_status_fail(err, LW_PROTOCOL, "is no protobuf: wire type %u", (unsigned)(key & 7));
        }
        if (length > size - at) goto cut_off;
        at += (size_t)length;
    }
    return LW_OK;
cut_off:
    return lw_status_fail(err, LW_PROTOCOL, "is no protobuf: cut off in byte %zu of %zu", at, size);
}

static enum lw_status read_finish(const Lightwell__Wire__Welcome *w, struct lw_message_package *f,
                                  struct lw_error *err) {
    if (w->finish_hash.len != (w->finish_size ? sizeof f->hash.bytes : 0))
        return invalid(err, "finish_hash", "is not 16 bytes, or there without finish_size");
    if (w->n_finish_part_compressed_size != w->n_finish_part_size ||
        w->finish_part_hash.len != w->n_finish_part_size * sizeof *f->part_hash)
        return invalid(err, "finish_part_size, finish_part_compressed_size and finish_part_hash",
                       "differ in length");
    *f = (struct lw_message_package){.size = w->finish_size,
                                     .compressed_size = w->finish_compressed_size,
                                     .part_size = w->finish_part_size,
                                     .part_compressed_size = w->finish_part_compressed_size,
                                     .part_hash = (const void *)w->finish_part_hash.data,
                                     .part_count = w->n_finish_part_size};
    if (w->finish_hash.len) memcpy(f->hash.bytes, w->finish_hash.data, sizeof f->hash.bytes);
    return LW_OK;
}

static enum lw_status read_welcome(const Lightwell__Wire__Welcome *w, struct lw_message *m,
                                   struct lw_error *err) {
    if (w->package_hash.len != sizeof m->welcome.package_hash.bytes)
        return invalid(err, "package_hash", "is not 16 bytes");
    if (w->n_part_compressed_size != w->n_part_size ||
        w->part_hash.len != w->n_part_size * sizeof *m->welcome.part_hash)
        return invalid(err, "part_size, part_compressed_size and part_hash", "differ in length");
    m->welcome = (struct lw_message_welcome){.version = w->version,
                                             .features = w->features,
                                             .session = w->session,
                                             .name = w->name,
                                             .package_size = w->package_size,
                                             .package_compressed_size = w->package_compressed_size,
                                             .bounces = w->bounces,
                                             .target_error = w->target_error,
                                             .noise_shown = w->noise_shown,
                                             .finer = w->finer,
                                             .run = w->run,
                                             .part_size = w->part_size,
                                             .part_compressed_size = w->part_compressed_size,
                                             .part_hash = (const void *)w->part_hash.data,
                                             .part_count = w->n_part_size,
                                             .client_lights = w->client_lights.data,
                                             .client_lights_size = w->client_lights.len,
                                             .client_materials = w->client_materials.data,
                                             .client_materials_size = w->client_materials.len,
                                             .relays = w->relays,
                                             .relay_count = w->n_relays,
                                             .servers = w->servers};
    memcpy(m->welcome.package_hash.bytes, w->package_hash.data, sizeof m->welcome.package_hash.bytes);
    return read_finish(w, &m->welcome.finish, err);
}

static enum lw_status read_interest(const Lightwell__Wire__Interest *w, struct lw_message *m,
                                    struct storage *storage, struct lw_error *err) {
    size_t count = w->n_object;
    if (w->n_level != count || w->n_tile != count)
        return invalid(err, "object, level and tile", "differ in length");
    if (count > LW_MESSAGE_INTEREST_MAX) return over(err, "tile", "has", LW_MESSAGE_INTEREST_MAX, " entries");
    m->interest = (struct lw_message_interest){
        .everything = w->everything, .stand_ins = w->stand_ins, .tile_count = count};
    if (!count) return LW_OK;
    struct lw_message_interest_tile *tile = storage->list[0] = storage_alloc(storage, count * sizeof *tile);
    if (!tile) return LW_NO_MEMORY;
    for (size_t i = 0; i < count; i++)
        tile[i] = (struct lw_message_interest_tile){w->object[i], w->level[i], w->tile[i]};
    m->interest.tile = tile;
    return LW_OK;
}

static enum lw_status read_holds(const Lightwell__Wire__Holds *w, struct lw_message *m,
                                 struct storage *storage, struct lw_error *err) {
    size_t count = w->n_object;
    if (w->n_level != count || w->n_tile != count || w->n_version != count)
        return invalid(err, "object, level, tile and version", "differ in length");
    if (count > LW_MESSAGE_HOLDS_MAX) return over(err, "tile", "has", LW_MESSAGE_HOLDS_MAX, " entries");
    m->holds = (struct lw_message_holds){.tile_count = count, .frame = w->frame};
    if (!count) return LW_OK;
    struct lw_message_held *tile = storage->list[0] = storage_alloc(storage, count * sizeof *tile);
    if (!tile) return LW_NO_MEMORY;
    for (size_t i = 0; i < count; i++)
        tile[i] = (struct lw_message_held){w->object[i], w->level[i], w->tile[i], w->version[i]};
    m->holds.tile = tile;
    return LW_OK;
}

static struct lw_vec3 vector_at(const float *list, size_t i) {
    return lw_vec3(list[3 * i], list[3 * i + 1], list[3 * i + 2]);
}

static enum lw_status read_frame_state(const Lightwell__Wire__Frame *w, struct lw_message *m,
                                       struct storage *storage, struct lw_error *err) {
    const size_t materials = w->n_material;
    if (materials > LW_MESSAGE_MATERIALS_MAX)
        return over(err, "material", "has", LW_MESSAGE_MATERIALS_MAX, " entries");
    if (w->n_base_colour != VECTOR_FLOATS * materials || w->n_emission != VECTOR_FLOATS * materials)
        return invalid(err, "base_colour or emission", "is not 3 values for each material");
    m->frame.hidden = w->hidden_object;
    m->frame.hidden_count = w->n_hidden_object;
    m->frame.shown = w->shown_object;
    m->frame.shown_count = w->n_shown_object;
    m->frame.spare_count = w->spares;
    m->frame.material_count = materials;
    if (!materials) return LW_OK;
    struct lw_message_material *material = storage->list[2] =
        storage_alloc(storage, materials * sizeof *material);
    if (!material) return LW_NO_MEMORY;
    for (size_t i = 0; i < materials; i++) {
        material[i].material = w->material[i];
        memcpy(material[i].base_colour, w->base_colour + VECTOR_FLOATS * i, sizeof material[i].base_colour);
        memcpy(material[i].emission, w->emission + VECTOR_FLOATS * i, sizeof material[i].emission);
    }
    m->frame.material = material;
    return LW_OK;
}

static enum lw_status read_frame(const Lightwell__Wire__Frame *w, struct lw_message *m,
                                 struct storage *storage, struct lw_error *err) {
    size_t transforms = w->n_transform_object, lights = w->n_light;
    if (w->n_sky != 3) return invalid(err, "sky", "is not 3 values");
    if (transforms > LW_MESSAGE_TRANSFORMS_MAX)
        return over(err, "transform_object", "has", LW_MESSAGE_TRANSFORMS_MAX, " entries");
    if (w->n_transform != TRANSFORM_FLOATS * transforms)
        return invalid(err, "transform", "is not 12 values for each of transform_object");
    if (lights > LW_MESSAGE_LIGHTS_MAX) return over(err, "light", "has", LW_MESSAGE_LIGHTS_MAX, " entries");
    if (w->n_light_position != VECTOR_FLOATS * lights || w->n_light_direction != VECTOR_FLOATS * lights ||
        w->n_light_intensity != VECTOR_FLOATS * lights)
        return invalid(err, "light_position, light_direction or light_intensity",
                       "is not 3 values for each light");
    m->frame = (struct lw_message_frame){.frame = w->frame,
                                         .time_s = w->time_s,
                                         .solve_ns = w->solve_ns,
                                         .rays_total = w->rays_total,
                                         .tiles_solved = w->tiles_solved,
                                         .server_cpu_ns = w->server_cpu_ns,
                                         .run = w->run,
                                         .base = w->base_frame,
                                         .sky = {w->sky[0], w->sky[1], w->sky[2]},
                                         .transform_count = transforms,
                                         .light_count = lights};
    if (transforms) {
        struct lw_message_transform *transform = storage->list[0] =
            storage_alloc(storage, transforms * sizeof *transform);
        if (!transform) return LW_NO_MEMORY;
        for (size_t i = 0; i < transforms; i++) {
            transform[i].object = w->transform_object[i];
            memcpy(transform[i].object_to_world.m, w->transform + TRANSFORM_FLOATS * i,
                   sizeof transform[i].object_to_world.m);
        }
        m->frame.transform = transform;
    }
    if (lights) {
        struct lw_message_light *light = storage->list[1] = storage_alloc(storage, lights * sizeof *light);
        if (!light) return LW_NO_MEMORY;
        for (size_t i = 0; i < lights; i++)
            light[i] =
                (struct lw_message_light){w->light[i], vector_at(w->light_position, i),
                                          vector_at(w->light_direction, i), vector_at(w->light_intensity, i)};
        m->frame.light = light;
    }
    return read_frame_state(w, m, storage, err);
}

static enum lw_status read_update(const Lightwell__Wire__Update *w, struct lw_message *m,
                                  struct storage *storage, struct lw_error *err) {
    const size_t count = w->n_kind;
    if (w->n_target != count || w->n_value_count != count)
        return invalid(err, "kind, target and value_count", "differ in length");
    if (count > LW_MESSAGE_CHANGES_MAX) return over(err, "kind", "has", LW_MESSAGE_CHANGES_MAX, " entries");
    m->update = (struct lw_message_update){.request = w->request, .change_count = count};
    struct lw_scene_change *change = storage->list[0] = storage_alloc(storage, count * sizeof *change);
    if (!change) return LW_NO_MEMORY;
    memset(change, 0, count * sizeof *change);
    size_t values = 0;
    for (size_t i = 0; i < count; i++) {
        const uint32_t value_count = w->value_count[i];
        if (value_count > LW_SCENE_CHANGE_VALUES_MAX)
            return over(err, "value_count", "is", LW_SCENE_CHANGE_VALUES_MAX, "");
        if (value_count > w->n_value - values)
            return invalid(err, "value", "is shorter than value_count says");
        change[i].kind = w->kind[i];
        change[i].target = w->target[i];
        change[i].value_count = value_count;
        if (value_count) memcpy(change[i].value, w->value + values, value_count * sizeof *w->value);
        values += value_count;
    }
    if (values != w->n_value) return invalid(err, "value", "is longer than value_count says");
    m->update.change = change;
    return LW_OK;
}

static void read_tile(const Lightwell__Wire__Tile *w, struct lw_message *m) {
    m->tile = (struct lw_message_tile){.object = w->object,
                                       .level = w->level,
                                       .tile = w->tile,
                                       .version = w->version,
                                       .layer = w->layer,
                                       .codec = w->codec,
                                       .scale = w->scale,
                                       .bounces = w->bounces,
                                       .error = w->error,
                                       .payload = w->payload.data,
                                       .payload_size = w->payload.len,
                                       .base = w->base_version};
}

static enum lw_status read_wire(const union wire *w, struct lw_message *m, struct storage *storage,
                                struct lw_error *err) {
    switch (m->type) {
    case LW_MESSAGE_HELLO:
        if (w->hello.token.len && w->hello.token.len != LW_TOKEN_SIZE)
            return invalid(err, "token", "is not 32 bytes");
        m->hello = (struct lw_message_hello){.version = w->hello.version,
                                             .features = w->hello.features,
                                             .name = w->hello.name,
                                             .rate_limit_bytes_hz = w->hello.rate_limit,
                                             .token = w->hello.token.len ? w->hello.token.data : NULL,
                                             .relay = w->hello.relay};
        return LW_OK;
    case LW_MESSAGE_WELCOME:
        return read_welcome(&w->welcome, m, err);
    case LW_MESSAGE_REFUSAL:
        if (w->refusal.code > LW_MESSAGE_REFUSAL_MAX) return invalid(err, "code", "is not in 1..65535");
        m->refusal = (struct lw_message_refusal){(enum lw_refusal)w->refusal.code, w->refusal.text,
                                                 w->refusal.retry_after_ms};
        return LW_OK;
    case LW_MESSAGE_PACKAGE_REQUEST:
    case LW_MESSAGE_FINISH_REQUEST:
        m->package_request = (struct lw_message_package_request){
            w->package_request.offset, w->package_request.held.data, w->package_request.held.len};
        return LW_OK;
    case LW_MESSAGE_PACKAGE_CHUNK:
    case LW_MESSAGE_FINISH_CHUNK:
        m->package_chunk = (struct lw_message_package_chunk){
            w->package_chunk.offset, w->package_chunk.data.data, w->package_chunk.data.len};
        return LW_OK;
    case LW_MESSAGE_INTEREST:
        return read_interest(&w->interest, m, storage, err);
    case LW_MESSAGE_FRAME:
        return read_frame(&w->frame, m, storage, err);
    case LW_MESSAGE_TILE:
        read_tile(&w->tile, m);
        return LW_OK;
    case LW_MESSAGE_ACK:
        m->ack.frame = w->ack.frame;
        return LW_OK;
    case LW_MESSAGE_SETTLED:
        m->settled.frame = w->settled.frame;
        return LW_OK;
    case LW_MESSAGE_UPDATE:
        return read_update(&w->update, m, storage, err);
    case LW_MESSAGE_UPDATED:
        m->updated = (struct lw_message_updated){w->updated.request, w->updated.code,  w->updated.change,
                                                 w->updated.text,    w->updated.frame, w->updated.added,
                                                 w->updated.n_added};
        return LW_OK;
    case LW_MESSAGE_PING:
    case LW_MESSAGE_PONG:
        m->ping.token = w->ping.token;
        return LW_OK; /* one layout for both */
    case LW_MESSAGE_HOLDS:
        return read_holds(&w->holds, m, storage, err);
    case LW_MESSAGE_ASK:
        m->ask = (struct lw_message_ask){w->ask.request, w->ask.what, w->ask.return_after_ms};
        return LW_OK;
    case LW_MESSAGE_REPORT:
        m->report = (struct lw_message_report){w->report.request, w->report.code, w->report.data.data,
                                               w->report.data.len};
        return LW_OK;
    case LW_MESSAGE_WAITING:
        m->waiting = (struct lw_message_waiting){w->waiting.stage, w->waiting.share};
        return LW_OK;
    }
    return LW_INTERNAL;
}

static enum lw_status over_budget(const struct lw_message_memory *memory, struct lw_error *err) {
    return lw_status_fail(err, LW_PROTOCOL, "takes over %zu bytes of memory to read", memory->budget);
}

static enum lw_status decode_body(struct lw_framing_header header, const uint8_t *body,
                                  struct lw_message_memory *memory, struct lw_message *m,
                                  struct lw_error *err) {
    enum lw_status status = check_fields(body, header.body_size, err);
    if (status != LW_OK) return status;
    struct storage *storage = m->storage = allocate(memory, sizeof *storage);
    if (!storage) return LW_NO_MEMORY;
    *storage = (struct storage){.memory = memory};
    ProtobufCAllocator allocator = {storage_alloc, storage_free, storage};
    storage->proto =
        protobuf_c_message_unpack(descriptor_of(header.type), &allocator, header.body_size, body);
    if (storage->over_budget) return over_budget(memory, err);
    if (!storage->proto && storage->out_of_memory) return LW_NO_MEMORY;
    if (!storage->proto)
        return lw_status_fail(err, LW_PROTOCOL, "does not decode: a field has the wrong type");
    status = read_wire((const union wire *)storage->proto, m, storage, err);
    if (storage->over_budget) return over_budget(memory, err);
    return status == LW_OK ? check_values(m, err) : status;
}

enum lw_status lw_message_decode(struct lw_framing_header header, const uint8_t *body,
                                 struct lw_message *out_message, struct lw_error *err) {
    return lw_message_decode_with(header, body, NULL, out_message, err);
}

enum lw_status lw_message_decode_whole(const uint8_t *bytes, size_t size, struct lw_message *out_message) {
    struct lw_framing_header header;
    if (size < LW_FRAMING_HEADER_SIZE) return LW_PROTOCOL;
    enum lw_status status = lw_framing_read_header(bytes, LW_FRAMING_BODY_MAX, &header, NULL);
    if (status == LW_OK && header.body_size != size - LW_FRAMING_HEADER_SIZE) status = LW_PROTOCOL;
    return status == LW_OK ? lw_message_decode(header, bytes + LW_FRAMING_HEADER_SIZE, out_message, NULL)
                           : status;
}

enum lw_status lw_message_decode_with(struct lw_framing_header header, const uint8_t *body,
                                      struct lw_message_memory *memory, struct lw_message *out_message,
                                      struct lw_error *err) {
    const char *name = lw_message_name(header.type);
    if (!name) return lw_status_fail(err, LW_PROTOCOL, "message type %u is unknown", (unsigned)header.type);
    struct lw_message message = {.type = (enum lw_message_type)header.type};
    if (memory) begin_memory(memory);
    enum lw_status status = decode_body(header, body, memory, &message, err);
    if (status != LW_OK) {
        if (status == LW_NO_MEMORY) lw_status_fail(err, status, "out of memory");
        lw_status_context(err, "message %s", name);
        lw_message_finish(&message);
        return status;
    }
    *out_message = message;
    return LW_OK;
}

void lw_message_finish(struct lw_message *message) {
    struct storage *storage = message->storage;
    if (!storage) return;
    struct lw_message_memory *memory = storage->memory;
    ProtobufCAllocator allocator = {storage_alloc, storage_free, storage};
    if (storage->proto) protobuf_c_message_free_unpacked(storage->proto, &allocator);
    for (size_t i = 0; i < sizeof storage->list / sizeof *storage->list; i++)
        give_back(memory, storage->list[i]);
    give_back(memory, storage);
    message->storage = NULL;
}
