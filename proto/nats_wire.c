#include "proto/nats_wire.h"

#include "common/base/invariant.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

static const uint8_t magic[4] = {'L', 'W', 'N', '1'};

/* ---- addresses and subjects ---- */

static const char *const schemes[] = {"nats://", "tls://"};

static const char *after_scheme(const char *text) {
    for (size_t i = 0; i < sizeof schemes / sizeof *schemes; i++)
        if (strncmp(text, schemes[i], strlen(schemes[i])) == 0) return text + strlen(schemes[i]);
    return NULL;
}

bool lw_nats_wire_is_address(const char *text) { return after_scheme(text) != NULL; }

static bool is_scene(const char *name) {
    static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-";
    const size_t length = strlen(name);
    return length && length <= LW_NATS_WIRE_SCENE_MAX && strspn(name, letters) == length;
}

/* at: behind a user and a password. Returns whether there is a host that fits. */
static bool read_host(const char *at, char *dst, size_t size) {
    const bool is_number = *at == '['; /* an address of IPv6 */
    if (is_number) at++;
    const size_t length = strcspn(at, is_number ? "]" : ":/");
    if (!length || length >= size || (is_number && at[length] != ']')) return false;
    memcpy(dst, at, length);
    dst[length] = '\0';
    return true;
}

enum lw_status lw_nats_wire_address(const char *text, struct lw_nats_wire_address *out_address,
                                    struct lw_error *err) {
    struct lw_nats_wire_address address = {.tls = strncmp(text, "tls:", 4) == 0};
    const char *host = after_scheme(text);
    if (!host || !*host || *host == '/' || strlen(text) >= sizeof address.url || strpbrk(text, " ,\t\n"))
        return lw_status_fail(err, LW_USAGE, "address is not nats://HOST:PORT or nats://HOST:PORT/SCENE");
    const char *slash = strchr(host, '/'), *at = strchr(host, '@');
    if (at && slash && at > slash)
        return lw_status_fail(err, LW_USAGE, "address has a \"/\" before its \"@\": write it as %%2F");
    const char *scene = slash && slash[1] ? slash + 1 : "scene";
    if (!is_scene(scene))
        return lw_status_fail(
            err, LW_USAGE, "the scene of an address of NATS is 1 to %u of A-Z a-z 0-9 _ - behind the \"/\"",
            LW_NATS_WIRE_SCENE_MAX);
    const int length = slash ? (int)(slash - text) : (int)strlen(text);
    snprintf(address.url, sizeof address.url, "%.*s", length, text);
    strcpy(address.scene, scene);
    const char *shown = at ? at + 1 : host;
    if (!read_host(shown, address.host, sizeof address.host))
        return lw_status_fail(err, LW_USAGE, "address has no host: it is not nats://HOST:PORT");
    snprintf(address.name, sizeof address.name, "%.*s%.*s/%s", (int)(host - text), text,
             length - (int)(shown - text), shown, scene);
    *out_address = address;
    return LW_OK;
}

void lw_nats_wire_subject(char dst[LW_NATS_WIRE_SUBJECT_SIZE], const char *scene, const char *rest, ...) {
    const int length = snprintf(dst, LW_NATS_WIRE_SUBJECT_SIZE, "lightwell.%s.", scene);
    va_list arguments;
    va_start(arguments, rest);
    const int more = vsnprintf(dst + length, LW_NATS_WIRE_SUBJECT_SIZE - (size_t)length, rest, arguments);
    va_end(arguments);
    LW_INVARIANT(length > 0 && more > 0 && (unsigned)(length + more) < LW_NATS_WIRE_SUBJECT_SIZE);
}

uint32_t lw_nats_wire_irradiance(uint32_t channels) {
    uint32_t irradiance = UINT32_MAX;
    if (!channels || channels >> lw_tile_channels()->count) return UINT32_MAX;
    LW_TILE_CHANNELS_EACH (c, channels) {
        const uint32_t follows = lw_tile_channel_at(c)->follows;
        if (irradiance != UINT32_MAX && follows != irradiance) return UINT32_MAX;
        irradiance = follows;
    }
    return channels & lw_tile_channel_bit(irradiance) ? irradiance : UINT32_MAX;
}

/* ---- payloads ---- */

static void write_number(uint8_t *dst, uint64_t number, size_t bytes) {
    for (size_t i = 0; i < bytes; i++) dst[i] = (uint8_t)(number >> 8 * i);
}

static uint64_t read_number(const uint8_t *src, size_t bytes) {
    uint64_t number = 0;
    for (size_t i = bytes; i-- > 0;) number = number << 8 | src[i];
    return number;
}

void lw_nats_wire_write_prefix(uint8_t dst[LW_NATS_WIRE_PREFIX_SIZE], struct lw_nats_wire_prefix prefix) {
    memcpy(dst, magic, sizeof magic);
    write_number(dst + 4, prefix.epoch, 4);
    write_number(dst + 8, prefix.run, 8);
}

enum lw_status lw_nats_wire_read_prefix(const void *bytes, size_t size,
                                        struct lw_nats_wire_prefix *out_prefix,
                                        struct lw_nats_wire_reader *out_reader) {
    const uint8_t *at = bytes;
    if (size < LW_NATS_WIRE_PREFIX_SIZE || memcmp(at, magic, sizeof magic) != 0) return LW_PROTOCOL;
    *out_prefix = (struct lw_nats_wire_prefix){(uint32_t)read_number(at + 4, 4), read_number(at + 8, 8)};
    *out_reader =
        (struct lw_nats_wire_reader){at + LW_NATS_WIRE_PREFIX_SIZE, size - LW_NATS_WIRE_PREFIX_SIZE};
    return LW_OK;
}

const uint8_t *lw_nats_wire_read_bytes(struct lw_nats_wire_reader *reader, size_t size) {
    const uint8_t *bytes = reader->at;
    if (size > reader->left) return NULL;
    reader->at += size;
    reader->left -= size;
    return bytes;
}

enum lw_status lw_nats_wire_read(struct lw_nats_wire_reader *reader, struct lw_message *out_message,
                                 const uint8_t **out_raw, size_t *out_raw_size) {
    struct lw_framing_header header;
    *out_raw = NULL;
    *out_raw_size = 0;
    if (!reader->left) return LW_OK;
    const uint8_t *raw = lw_nats_wire_read_bytes(reader, LW_FRAMING_HEADER_SIZE);
    if (!raw || lw_framing_read_header(raw, LW_FRAMING_BODY_MAX, &header, NULL) != LW_OK) return LW_PROTOCOL;
    const uint8_t *body = lw_nats_wire_read_bytes(reader, header.body_size);
    if (!body) return LW_PROTOCOL;
    const enum lw_status status = lw_message_decode(header, body, out_message, NULL);
    if (status != LW_OK) return status;
    *out_raw = raw;
    *out_raw_size = LW_FRAMING_HEADER_SIZE + header.body_size;
    return LW_OK;
}
