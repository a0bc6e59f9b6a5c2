#include "client/view/compose/attention.h"

#include <stdlib.h>

enum lw_status lw_attention_init(struct lw_attention *attention, uint32_t tile_count) {
    *attention = (struct lw_attention){.tile_count = tile_count};
    attention->seen_ns = calloc((size_t)tile_count + 1, sizeof *attention->seen_ns);
    attention->list = calloc((size_t)tile_count + 1, sizeof *attention->list);
    if (attention->seen_ns && attention->list) return LW_OK;
    lw_attention_finish(attention);
    return LW_NO_MEMORY;
}

void lw_attention_finish(struct lw_attention *attention) {
    free(attention->seen_ns);
    free(attention->list);
    *attention = (struct lw_attention){0};
}

enum circle { IN_PICTURE, AROUND, SEEN_BEFORE, CIRCLES };

static bool is_within(const struct lw_attention *a, uint32_t tile, const uint8_t *around, uint64_t now_ns,
                      enum circle circle) {
    const uint64_t seen_ns = a->seen_ns[tile];
    return seen_ns == now_ns || (circle >= AROUND && around[tile]) ||
           (circle >= SEEN_BEFORE && seen_ns && now_ns - seen_ns <= LW_ATTENTION_KEEP_NS);
}

void lw_attention_list(struct lw_attention *a, const uint8_t *needed, const uint8_t *around,
                       uint64_t now_ns) {
    for (uint32_t t = 0; t < a->tile_count; t++)
        if (needed[t]) a->seen_ns[t] = now_ns;
    for (int circle = CIRCLES - 1; circle >= 0; circle--) {
        a->list_count = 0;
        for (uint32_t t = 0; t < a->tile_count; t++)
            if (is_within(a, t, around, now_ns, (enum circle)circle))
                a->list[a->list_count++] = (lw_tile_id){t};
        if (a->list_count <= LW_CLIENT_INTEREST_MAX) return;
    }
}
