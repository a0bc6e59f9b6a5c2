#include "common/lightmap/lightmap_sliver.h"

#include "common/lightmap/lightmap_mosaic.h"

#include <math.h>
#include <stdlib.h>

/* A chart is a sliver if its narrower side has no more texels than this ... */
#define WIDTH 8.0f
/* ... or if it is a ring or an arc: of moderate size, and mostly holes. */
#define SIDE 128.0f
#define FILL 0.4f

/* Texels of one rectangle. Large ones nest rings in rings, small ones hold neighbours in space. */
#define GROUP_AREA 4096.0f

static const float WIDTHS[] = {0.8f, 1.0f, 1.3f}; /* shares of the square's side */

bool lw_lightmap_sliver_is(const struct lw_lightmap_slot *slot, float scale) {
    float width = slot->box.size.x * scale, height = slot->box.size.y * scale;
    if (fminf(width, height) <= WIDTH) return true;
    return fmaxf(width, height) <= SIDE && slot->area * scale * scale < FILL * (width + 4) * (height + 4);
}

static uint32_t whole(float texels) { return texels > 1 ? (uint32_t)ceilf(texels - 1e-4f) : 1; }

uint32_t lw_lightmap_sliver_group(const struct lw_lightmap_slot *slot, const uint32_t *member, uint32_t count,
                                  float scale) {
    float area = 0, limit = GROUP_AREA;
    uint32_t n = 0;
    for (; n < count && area < limit; n++) {
        const struct lw_lightmap_slot *s = &slot[member[n]];
        float width = s->box.size.x * scale + 2, height = s->box.size.y * scale + 2;
        /* a ring of thickness t covers about t + 2 times its length, gap included */
        area += fminf(width * height, s->area * scale * scale + 4 * (width + height));
        limit = fmaxf(limit, 16 * fmaxf(width, height)); /* long ones need company as well */
    }
    return n;
}

/* The texels that bilinear lookups of a sliver read: those whose centre it comes nearer to than a texel.
 * Slivers whose shapes are disjoint share none. */
static void shape(const struct lw_lightmap_layout *layout, const struct lw_lightmap_slot *slot,
                  uint32_t chart, struct lw_lightmap_stone *stone) {
    const struct lw_lightmap_charts *charts = layout->charts;
    for (uint32_t i = layout->start[chart]; i < layout->start[chart + 1]; i++) {
        struct lw_vec2 c[3];
        for (int k = 0; k < 3; k++)
            c[k] = lw_lightmap_slot_place(slot, charts->point[charts->corner[layout->order[i]][k]]);
        lw_lightmap_mosaic_mark(stone, c, 1, 0.5f);
    }
}

/* Start of the content in its rectangle, chosen so that lookups read the fewest texels (one more than the
 * content has), and the content touches the fewest. */
static float start_of(float content, uint32_t texels) {
    float rest = content - floorf(content);
    return rest > 1e-3f && rest < 0.5f ? 1 + (0.5f - rest) / 2 : ((float)texels - content) / 2;
}

static void scale_slot(struct lw_lightmap_slot *slot, float scale) {
    float width = slot->box.size.x * scale, height = slot->box.size.y * scale;
    slot->x = slot->y = 0;
    slot->width = whole(width) + 1, slot->height = whole(height) + 1;
    slot->scale = (struct lw_vec2){scale, scale};
    slot->origin.x = start_of(width, slot->width);
    slot->origin.y = start_of(height, slot->height);
    slot->gutter = 0;
}

static enum lw_status search(struct lw_lightmap_stone **order, const struct lw_lightmap_stone *stone,
                             struct lw_lightmap_slot *slot, const uint32_t *member, uint32_t count,
                             uint32_t *out_width, uint32_t *out_height) {
    uint64_t area = 0, best = UINT64_MAX;
    uint32_t widest = 1, highest = 0;
    uint64_t looks = UINT64_MAX; /* a group is small: GROUP_AREA */
    for (uint32_t i = 0; i < count; i++) {
        area += lw_lightmap_mosaic_area(&stone[i]);
        if (stone[i].width > widest) widest = stone[i].width;
        highest += stone[i].height;
    }
    for (size_t i = 0; i < sizeof WIDTHS / sizeof *WIDTHS; i++) {
        uint32_t width = (uint32_t)ceil(sqrt((double)area) * (double)WIDTHS[i]), right, top;
        bool fits; /* always: highest is room enough for a column of all */
        enum lw_status status = lw_lightmap_mosaic_pack(order, count, width > widest ? width : widest,
                                                        highest, &looks, &right, &top, &fits);
        if (status != LW_OK) return status;
        uint64_t blocks = (uint64_t)((right + 7) / 4) * ((top + 7) / 4); /* with both gutters, rounded up */
        if (!fits || blocks >= best) continue;
        best = blocks, *out_width = right, *out_height = top;
        for (uint32_t k = 0; k < count; k++) slot[member[k]].x = stone[k].x, slot[member[k]].y = stone[k].y;
    }
    return LW_OK;
}

enum lw_status lw_lightmap_sliver_fit(const struct lw_lightmap_layout *layout, struct lw_lightmap_slot *slot,
                                      const uint32_t *member, uint32_t count, float scale,
                                      uint32_t *out_width, uint32_t *out_height) {
    struct lw_lightmap_stone *stone = calloc((size_t)count + 1, sizeof *stone);
    struct lw_lightmap_stone **order = calloc((size_t)count + 1, sizeof *order);
    enum lw_status status = stone && order ? LW_OK : LW_NO_MEMORY;
    for (uint32_t i = 0; i < count && status == LW_OK; i++) {
        struct lw_lightmap_slot *s = &slot[member[i]];
        scale_slot(s, scale);
        stone[i].width = s->width, stone[i].height = s->height;
        stone[i].row =
            calloc((size_t)stone[i].height * lw_lightmap_mosaic_words(stone[i].width), sizeof(uint64_t));
        order[i] = &stone[i];
        if (stone[i].row)
            shape(layout, s, member[i], &stone[i]);
        else
            status = LW_NO_MEMORY;
    }
    if (status == LW_OK) {
        qsort(order, count, sizeof *order, lw_lightmap_mosaic_by_size);
        status = search(order, stone, slot, member, count, out_width, out_height);
    }
    for (uint32_t i = 0; i < count && status == LW_OK; i++) {
        struct lw_lightmap_slot *s = &slot[member[i]];
        s->origin.x += (float)s->x;
        s->origin.y += (float)s->y;
    }
    for (uint32_t i = 0; stone && i < count; i++) free(stone[i].row);
    free(order);
    free(stone);
    return status;
}
