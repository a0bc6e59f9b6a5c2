/* A stream of framed messages from anyone. First byte: even, from a client; odd, from a server (their limits
 * differ). What decodes must be valid, and must survive being encoded and decoded again. */
#include "proto/message.h"

#include <stdlib.h>
#include <string.h>

/* Memory that a body may ask for: a server's budget for one is far above that of the longest. */
#define MEMORY_PER_BYTE 16u
#define MEMORY_MORE     (64u << 10)

static void require(bool condition) {
    if (!condition) abort();
}

static void encode_again(const struct lw_message *message) {
    uint8_t *bytes;
    size_t size;
    struct lw_framing_header header;
    struct lw_message again;
    require(lw_message_validate(message, NULL) == LW_OK);
    /* a list that came unpacked or twice can be a little larger when it is written as it should be */
    enum lw_status status = lw_message_encode_alloc(message, &bytes, &size);
    require(status == LW_OK);
    require(size == lw_message_size(message));
    require(lw_framing_read_header(bytes, LW_FRAMING_BODY_MAX, &header, NULL) == LW_OK);
    require(lw_message_decode(header, bytes + LW_FRAMING_HEADER_SIZE, &again, NULL) == LW_OK);
    require(again.type == message->type && lw_message_size(&again) == size);
    lw_message_finish(&again);
    free(bytes);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    if (!size) return 0;
    uint32_t body_max = bytes[0] & 1 ? LW_FRAMING_BODY_MAX : LW_FRAMING_CLIENT_BODY_MAX;
    for (size_t at = 1; size - at >= LW_FRAMING_HEADER_SIZE;) {
        struct lw_framing_header header;
        struct lw_message message;
        struct lw_error err = {0};
        enum lw_status status = lw_framing_read_header(bytes + at, body_max, &header, &err);
        require(status == LW_OK || (status == LW_PROTOCOL && err.text[0]));
        at += LW_FRAMING_HEADER_SIZE;
        if (status != LW_OK || header.body_size > size - at) return 0;
        uint8_t *body = malloc(header.body_size ? header.body_size : 1); /* exact, for ASan */
        require(body != NULL);
        memcpy(body, bytes + at, header.body_size);
        at += header.body_size;
        struct lw_message_memory memory = {0};
        status = lw_message_decode_with(header, body, &memory, &message, &err);
        free(body);
        require(status == LW_OK || (status == LW_PROTOCOL && err.text[0]));
        require(memory.asked <= (size_t)MEMORY_PER_BYTE * header.body_size + MEMORY_MORE);
        if (status == LW_OK) {
            encode_again(&message);
            lw_message_finish(&message);
        }
        lw_message_memory_finish(&memory);
    }
    return 0;
}
