#include "common/scene/lightmap_sliver.h"

#include <math.h>
#include <stdlib.h>

/* Texels of one rectangle: its own gutters should cost little, and its slivers should be near each other. */
#define GROUP_AREA 1024u

#define ROWS_TRIED 4

static uint32_t whole(float texels) { return texels > 1 ? (uint32_t)ceilf(texels - 1e-4f) : 1; }

uint32_t lw_lightmap_sliver_group(const struct lw_lightmap_slot *slot, const uint32_t *member, uint32_t count,
                                  float scale) {
    uint64_t area = 0, limit = GROUP_AREA;
    uint32_t n = 0;
    for (; n < count && area < limit; n++) {
        const struct lw_lightmap_box *box = &slot[member[n]].box;
        uint64_t width = whole(box->size.x * scale) + LW_LIGHTMAP_SLIVER_GAP,
                 height = whole(box->size.y * scale) + LW_LIGHTMAP_SLIVER_GAP;
        area += width * height;
        uint64_t longest = width > height ? width : height;
        if (longest * 16 > limit) limit = longest * 16; /* long ones need company as well */
    }
    return n;
}

struct order {
    uint32_t width, height, slot;
};

static int compare_orders(const void *left, const void *right) {
    const struct order *a = left, *b = right;
    if (a->height != b->height) return a->height > b->height ? -1 : 1;
    if (a->width != b->width) return a->width > b->width ? -1 : 1;
    return a->slot < b->slot ? -1 : a->slot > b->slot;
}

/* Shelves no wider than width; places only if slot is given. Slivers of one rectangle are few and alike. */
static uint32_t shelve(const struct order *order, uint32_t count, uint32_t width,
                       struct lw_lightmap_slot *slot) {
    uint32_t x = 0, y = 0, shelf = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (x + order[i].width > width) y += shelf, x = 0, shelf = 0;
        if (!shelf) shelf = order[i].height;
        if (slot) slot[order[i].slot].x = x, slot[order[i].slot].y = y;
        x += order[i].width;
    }
    return y + shelf;
}

static void settle(struct lw_lightmap_slot *slot, float scale) {
    float width = slot->box.size.x * scale, height = slot->box.size.y * scale;
    slot->width = whole(width), slot->height = whole(height);
    slot->scale = (struct lw_vec2){scale, scale};
    slot->origin.x = (float)slot->x + fmaxf(((float)slot->width - width) / 2, 0);
    slot->origin.y = (float)slot->y + fmaxf(((float)slot->height - height) / 2, 0);
    slot->gutter = 0;
}

enum lw_status lw_lightmap_sliver_fit(struct lw_lightmap_slot *slot, const uint32_t *member, uint32_t count,
                                      float scale, uint32_t *out_width, uint32_t *out_height) {
    struct order *order = malloc(((size_t)count + 1) * sizeof *order);
    if (!order) return LW_NO_MEMORY;
    uint64_t area = 0;
    uint32_t widest = 1;
    for (uint32_t i = 0; i < count; i++) {
        const struct lw_lightmap_box *box = &slot[member[i]].box;
        order[i] = (struct order){whole(box->size.x * scale) + LW_LIGHTMAP_SLIVER_GAP,
                                  whole(box->size.y * scale) + LW_LIGHTMAP_SLIVER_GAP, member[i]};
        area += (uint64_t)order[i].width * order[i].height;
        if (order[i].width > widest) widest = order[i].width;
    }
    qsort(order, count, sizeof *order, compare_orders);
    uint32_t best_width = widest, best_height = 0;
    uint64_t best = UINT64_MAX;
    for (int i = 0; i < ROWS_TRIED; i++) {
        uint32_t width = (uint32_t)(sqrt((double)area) * (0.9 + 0.3 * i));
        if (width < widest) width = widest;
        uint32_t height = shelve(order, count, width, NULL);
        if ((uint64_t)width * height < best)
            best = (uint64_t)width * height, best_width = width, best_height = height;
    }
    shelve(order, count, best_width, slot);
    for (uint32_t i = 0; i < count; i++) settle(&slot[member[i]], scale);
    free(order);
    *out_width = best_width - LW_LIGHTMAP_SLIVER_GAP; /* none is needed after the last */
    *out_height = best_height - LW_LIGHTMAP_SLIVER_GAP;
    return LW_OK;
}
