/* Reports of relays, from anyone: an accepted one is written and read again as it was. */
#include "server/serve/metrics/relay_tree.h"

#include <stdlib.h>
#include <string.h>

static void require(bool condition) {
    if (!condition) abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static struct lw_relay_tree_node node[LW_RELAY_TREE_MAX], again[LW_RELAY_TREE_MAX];
    static char text[LW_RELAY_TREE_TEXT_MAX], name[LW_MESSAGE_NAME_MAX + 1];
    struct lw_error err = {0};
    uint32_t count, count_again;
    if (lw_relay_tree_read(data, size, node, LW_RELAY_TREE_MAX, &count, &err) != LW_OK) {
        require(err.status == LW_PROTOCOL && *err.text);
        return 0;
    }
    const size_t written = lw_relay_tree_write(node, count, text, sizeof text);
    require(written <= size || !count); /* leading zeros are left out */
    require(lw_relay_tree_read((const uint8_t *)text, written, again, LW_RELAY_TREE_MAX, &count_again,
                               &err) == LW_OK);
    require(count == count_again);
    for (uint32_t i = 0; i < count; i++) {
        const struct lw_relay_tree_node *a = &node[i], *b = &again[i];
        require(a->relay == b->relay && a->above == b->above && a->sessions == b->sessions &&
                a->light_age_ms == b->light_age_ms && a->sent_bytes_hz == b->sent_bytes_hz &&
                !strcmp(a->name, b->name));
        lw_relay_tree_name(name, a->name);
        require(!strcmp(name, a->name));
    }
    return 0;
}
