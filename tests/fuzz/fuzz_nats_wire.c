/* Payloads and addresses of NATS, from anyone: each message of a payload lies within it, behind the previous
 * one, and an accepted address makes subjects. The first byte says which. */
#include "proto/nats_wire.h"

#include <stdlib.h>
#include <string.h>

static void require(bool condition) {
    if (!condition) abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void read_address(const uint8_t *data, size_t size) {
    char *text = malloc(size + 1), subject[LW_NATS_WIRE_SUBJECT_SIZE];
    struct lw_nats_wire_address address;
    require(text != NULL);
    memcpy(text, data, size);
    text[size] = '\0';
    if (lw_nats_wire_address(text, &address, NULL) == LW_OK) {
        require(lw_nats_wire_is_address(text) && lw_nats_wire_is_address(address.url));
        require(*address.host && strstr(text, address.host) && !strpbrk(address.host, "/ ]"));
        require(strlen(address.scene) - 1 < LW_NATS_WIRE_SCENE_MAX && !strpbrk(address.scene, ".*> /"));
        require(!strchr(address.name, '@') || strchr(strchr(text, '@') + 1, '@'));
        lw_nats_wire_subject(subject, address.scene, "kept.%u.%u.%u.%u", 1u, UINT32_MAX, UINT32_MAX,
                             UINT32_MAX);
    }
    free(text);
}

/* What the byte of a `want` says. */
static void read_channels(uint8_t channels) {
    const uint32_t channel = lw_nats_wire_irradiance(channels);
    require(channel == UINT32_MAX || (channel < LW_TILE_CHANNEL_IRRADIANCES && channels >> channel & 1));
}

static void read_payload(const uint8_t *data, size_t size) {
    struct lw_nats_wire_prefix prefix;
    struct lw_nats_wire_reader reader;
    if (lw_nats_wire_read_prefix(data, size, &prefix, &reader) != LW_OK) return;
    uint8_t again[LW_NATS_WIRE_PREFIX_SIZE];
    lw_nats_wire_write_prefix(again, prefix);
    require(memcmp(again, data, sizeof again) == 0);
    const uint8_t *at = data + sizeof again;
    for (;;) {
        struct lw_message message;
        const uint8_t *raw;
        size_t raw_size;
        const enum lw_status status = lw_nats_wire_read(&reader, &message, &raw, &raw_size);
        require(status == LW_OK || status == LW_PROTOCOL);
        require(reader.at >= at && reader.at + reader.left == data + size);
        if (status != LW_OK || !raw) return;
        require(raw == at && raw + raw_size == reader.at);
        at = reader.at;
        lw_message_finish(&message);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (!size) return 0;
    read_channels(*data);
    (*data & 1 ? read_address : read_payload)(data + 1, size - 1);
    return 0;
}
