/* A scene package from any server: first how many parts it says there are, then two bytes for each: its size,
 * and its compressed size with a high bit for one that is held; the rest as chunks, each after a byte that
 * says how long it is. */
#include "client/lib/download.h"

#include <stdlib.h>
#include <string.h>

#define PARTS 8u

static void require(bool condition) {
    if (!condition) abort();
}

/* The client has the parts whose hash does not begin with 0: zeros of their size. */
static uint8_t *find(void *where, const struct lw_package_hash *hash, uint64_t size) {
    (void)where;
    return hash->bytes[0] ? calloc(1, (size_t)size) : NULL;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    uint64_t part_size[PARTS], compressed_size[PARTS];
    struct lw_package_hash hash[PARTS] = {{{0}}};
    struct lw_message m = {
        .type = LW_MESSAGE_WELCOME,
        .welcome = {.part_size = part_size, .part_compressed_size = compressed_size, .part_hash = hash}};
    const size_t count = size ? bytes[0] % (PARTS + 1) : 0;
    if (size < 3 + 2 * count) return 0;
    const uint8_t *at = bytes + 1, *const end = bytes + size;
    for (size_t i = 0; i < count; i++, at += 2) {
        m.welcome.package_size += part_size[i] = at[0];
        m.welcome.package_compressed_size += compressed_size[i] = at[1] & 127;
        hash[i].bytes[0] = at[1] >> 7;
    }
    m.welcome.part_count = count;
    if (!count) {
        m.welcome.package_size = *at++;
        m.welcome.package_compressed_size = *at++;
    }
    if (lw_message_validate(&m, NULL) != LW_OK) return 0;
    struct lw_download download;
    struct lw_message_package_request request;
    uint8_t *held;
    const struct lw_message_package package = lw_message_welcome_package(&m.welcome);
    require(lw_download_init(&download, "scene package", &package, find, NULL) == LW_OK);
    enum lw_status status = lw_download_begin(&download, NULL);
    require(lw_download_request(&download, &request, &held) == LW_OK);
    free(held);
    while (status == LW_OK && at < end && !lw_download_is_complete(&download)) {
        size_t length = *at++;
        if (length > (size_t)(end - at)) length = (size_t)(end - at);
        const struct lw_message_package_chunk chunk = {download.received, at, length};
        if (!length) break;
        status = lw_download_add(&download, &chunk, NULL);
        require(status == LW_OK || status == LW_PROTOCOL);
        require(download.size <= download.capacity && download.capacity <= download.package_size);
        at += length;
    }
    lw_download_finish(&download);
    return 0;
}
