#include "common/scene/lightmap_pack.h"

#include "common/scene/lightmap.h"

#include <stdlib.h>
#include <string.h>

#define STB_RECT_PACK_IMPLEMENTATION
#define STBRP_STATIC
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#include <stb_rect_pack.h>
#pragma GCC diagnostic pop

/* A chart's content is a whole number of blocks: what a chart lacks to the next block would be an empty margin, so it
 * is widened by up to this factor, or narrowed by up to this share if it barely touches a block. */
#define WIDEN       1.12f
#define NARROW      0.05f
#define NARROW_FROM 16.0f /* texels; smaller charts are never narrowed */

/* Past this many rectangles the skyline's quadratic search takes too long; rows of like height do as well then. */
#define SKYLINE_MAX 12000

static const float WIDTHS[] = {0.62f, 0.75f, 0.87f, 1.0f, 1.15f, 1.33f, 1.6f}; /* of the square's side */

static float snapped(float texels) {
    float block = (float)LW_LIGHTMAP_BLOCK, below = floorf(texels / block) * block;
    if (texels >= NARROW_FROM && texels - below <= NARROW * texels) return below;
    return fmaxf(ceilf(texels / block - 1e-5f) * block, block);
}

/* One axis of a slot: how far the content is scaled, and where it starts inside its rectangle. */
static void fit_axis(float size, float scale, uint32_t *out_rectangle, float *out_scale, float *out_start) {
    float content = size * scale, room = snapped(content);
    float factor = content > 0 ? fminf(room / content, WIDEN) : 1.0f;
    content *= factor;
    *out_scale = scale * factor;
    /* centred on the fewest texels that can hold it */
    *out_start = (float)LW_LIGHTMAP_GUTTER + fmaxf((ceilf(content - 1e-4f) - content) / 2, 0);
    *out_rectangle = (uint32_t)room + 2 * LW_LIGHTMAP_GUTTER;
}

static void fit(struct lw_lightmap_slot *slot, float scale) {
    fit_axis(slot->box.size.x, scale, &slot->width, &slot->scale.x, &slot->origin.x);
    fit_axis(slot->box.size.y, scale, &slot->height, &slot->scale.y, &slot->origin.y);
}

struct packer {
    struct lw_lightmap_layout *layout;
    stbrp_rect *rect, *best; /* in blocks */
    stbrp_node *node;
    uint32_t width_max, height_max; /* blocks */
    uint32_t best_width, best_height;
    bool best_turned, found;
};

static void load(struct packer *p, bool turned) {
    for (uint32_t i = 0; i < p->layout->chart_count; i++) {
        const struct lw_lightmap_slot *slot = &p->layout->slot[i];
        int w = (int)(slot->width / LW_LIGHTMAP_BLOCK), h = (int)(slot->height / LW_LIGHTMAP_BLOCK);
        p->rect[i] = (stbrp_rect){.id = (int)i, .w = turned ? h : w, .h = turned ? w : h};
    }
}

static int by_height(const void *left, const void *right) {
    const stbrp_rect *a = left, *b = right;
    if (a->h != b->h) return a->h > b->h ? -1 : 1;
    if (a->w != b->w) return a->w > b->w ? -1 : 1;
    return a->id < b->id ? -1 : a->id > b->id;
}

static bool pack_rows(struct packer *p, uint32_t width) {
    uint32_t count = p->layout->chart_count, x = 0, y = 0, row = 0;
    qsort(p->rect, count, sizeof *p->rect, by_height);
    for (uint32_t i = 0; i < count; i++) {
        stbrp_rect *r = &p->rect[i];
        if (x + (uint32_t)r->w > width) y += row, x = 0, row = 0;
        if (!row) row = (uint32_t)r->h;
        if ((uint32_t)r->w > width || y + (uint32_t)r->h > p->height_max) return false;
        r->x = (int)x, r->y = (int)y;
        x += (uint32_t)r->w;
    }
    return true;
}

static void try_width(struct packer *p, uint32_t width, bool turned, int heuristic) {
    uint32_t count = p->layout->chart_count;
    load(p, turned);
    if (count > SKYLINE_MAX) {
        if (!pack_rows(p, width)) return;
    } else {
        stbrp_context context;
        stbrp_init_target(&context, (int)width, (int)p->height_max, p->node, (int)p->width_max);
        stbrp_setup_heuristic(&context, heuristic);
        if (!stbrp_pack_rects(&context, p->rect, (int)count)) return;
    }
    uint32_t used_width = 0, used_height = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t right = (uint32_t)(p->rect[i].x + p->rect[i].w),
                 top = (uint32_t)(p->rect[i].y + p->rect[i].h);
        if (right > used_width) used_width = right;
        if (top > used_height) used_height = top;
    }
    if (p->found && (uint64_t)used_width * used_height >= (uint64_t)p->best_width * p->best_height) return;
    memcpy(p->best, p->rect, count * sizeof *p->rect);
    p->best_width = used_width, p->best_height = used_height;
    p->best_turned = turned, p->found = true;
}

static void search(struct packer *p) {
    uint64_t area = 0;
    uint32_t longest = 1;
    for (uint32_t i = 0; i < p->layout->chart_count; i++) {
        const struct lw_lightmap_slot *slot = &p->layout->slot[i];
        area += (uint64_t)(slot->width / LW_LIGHTMAP_BLOCK) * (slot->height / LW_LIGHTMAP_BLOCK);
        uint32_t side = (slot->width > slot->height ? slot->width : slot->height) / LW_LIGHTMAP_BLOCK;
        if (side > longest) longest = side;
    }
    if (area > (uint64_t)p->width_max * p->height_max) return;
    double side = ceil(sqrt((double)area));
    int heuristics = p->layout->chart_count > SKYLINE_MAX / 4 ? 1 : 2;
    /* the side of the square, wider and narrower ones, the longest chart's, and the widest there may be */
    int widths = (int)(sizeof WIDTHS / sizeof *WIDTHS);
    for (int turned = 0; turned < 2; turned++)
        for (int i = 0; i < widths + 2; i++) {
            double wanted = i < widths ? side * (double)WIDTHS[i] : (double)longest;
            if (i == widths + 1) {
                if (p->found) break; /* the last resort */
                wanted = (double)p->width_max;
            }
            uint32_t width = wanted < 2 ? 2 : wanted > (double)p->width_max ? p->width_max : (uint32_t)wanted;
            for (int h = 0; h < heuristics; h++)
                try_width(p, width, turned,
                          h ? STBRP_HEURISTIC_Skyline_BF_sortHeight : STBRP_HEURISTIC_Skyline_BL_sortHeight);
        }
}

static void settle(struct packer *p, float scale) {
    for (uint32_t i = 0; i < p->layout->chart_count; i++) {
        const stbrp_rect *r = &p->best[i];
        struct lw_lightmap_slot *slot = &p->layout->slot[r->id];
        if (p->best_turned) {
            slot->box = lw_lightmap_shape_turned(&slot->box);
            fit(slot, scale);
        }
        slot->x = (uint32_t)r->x * LW_LIGHTMAP_BLOCK;
        slot->y = (uint32_t)r->y * LW_LIGHTMAP_BLOCK;
        slot->origin.x += (float)slot->x;
        slot->origin.y += (float)slot->y;
    }
    p->layout->width = p->best_width * LW_LIGHTMAP_BLOCK;
    p->layout->height = p->best_height * LW_LIGHTMAP_BLOCK;
}

enum lw_status lw_lightmap_pack(struct lw_lightmap_layout *layout, float scale, uint32_t width_max,
                                uint32_t height_max, bool *out_fits) {
    size_t count = layout->chart_count;
    struct packer p = {.layout = layout,
                       .width_max = width_max / LW_LIGHTMAP_BLOCK,
                       .height_max = height_max / LW_LIGHTMAP_BLOCK};
    if (!count) { /* nothing but triangles without area: they share one texel */
        layout->width = layout->height = 2 * LW_LIGHTMAP_BLOCK;
        *out_fits = true;
        return LW_OK;
    }
    /* a box may be too long for any atlas; it must not overflow the integers below */
    for (uint32_t i = 0; i < count; i++) {
        struct lw_vec2 size = layout->slot[i].box.size;
        if (!(fmaxf(size.x, size.y) * scale <= (float)(width_max > height_max ? width_max : height_max))) {
            *out_fits = false;
            return LW_OK;
        }
        fit(&layout->slot[i], scale);
    }
    p.rect = malloc(count * sizeof *p.rect);
    p.best = malloc(count * sizeof *p.best);
    p.node = malloc(((size_t)p.width_max + 1) * sizeof *p.node);
    bool ready = p.rect && p.best && p.node;
    if (ready) search(&p);
    if (ready && p.found) settle(&p, scale);
    free(p.node);
    free(p.best);
    free(p.rect);
    if (ready) *out_fits = p.found;
    return ready ? LW_OK : LW_NO_MEMORY;
}

static float clamp(float x, float low, float high) { return fminf(fmaxf(x, low), high); }

struct lw_vec2 lw_lightmap_pack_place(const struct lw_lightmap_slot *slot, struct lw_vec2 point) {
    struct lw_vec2 local = lw_lightmap_shape_local(&slot->box, point);
    float gutter = (float)LW_LIGHTMAP_GUTTER;
    return (struct lw_vec2){clamp(slot->origin.x + slot->scale.x * local.x, (float)slot->x + gutter,
                                  (float)(slot->x + slot->width) - gutter),
                            clamp(slot->origin.y + slot->scale.y * local.y, (float)slot->y + gutter,
                                  (float)(slot->y + slot->height) - gutter)};
}

/* Points of one chart, gathered by its triangles; a point of several triangles comes several times. */
static uint32_t gather(const struct lw_lightmap_charts *charts, const uint32_t *triangle, uint32_t count,
                       struct lw_vec2 *out_point) {
    uint32_t n = 0;
    for (uint32_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) out_point[n++] = charts->point[charts->corner[triangle[i]][k]];
    return n;
}

enum lw_status lw_lightmap_pack_init(struct lw_lightmap_layout *layout,
                                     const struct lw_lightmap_charts *charts) {
    size_t triangles = charts->triangle_count, count = charts->chart_count;
    uint32_t *start = calloc(count + 2, sizeof *start), *order = malloc((triangles + 1) * sizeof *order);
    struct lw_vec2 *point = malloc((triangles * 3 + 1) * sizeof *point);
    struct lw_vec2 *hull = malloc((triangles * 3 + 2) * sizeof *hull);
    struct lw_lightmap_slot *slot = calloc(count + 1, sizeof *slot);
    bool ready = start && order && point && hull && slot;
    if (ready) { /* sort the triangles by chart */
        for (uint32_t t = 0; t < triangles; t++)
            if (charts->chart[t] != LW_SCENE_NONE) start[charts->chart[t] + 2]++;
        for (uint32_t c = 0; c < count; c++) start[c + 2] += start[c + 1];
        for (uint32_t t = 0; t < triangles; t++)
            if (charts->chart[t] != LW_SCENE_NONE) order[start[charts->chart[t] + 1]++] = t;
        for (uint32_t c = 0; c < count; c++) {
            uint32_t n = gather(charts, order + start[c], start[c + 1] - start[c], point);
            n = lw_lightmap_shape_hull(point, n, hull);
            slot[c].box = lw_lightmap_shape_box(hull, n, LW_LIGHTMAP_GUTTER * 2 + LW_LIGHTMAP_BLOCK / 2.0f);
        }
        *layout = (struct lw_lightmap_layout){.chart_count = charts->chart_count, .slot = slot};
    } else {
        free(slot);
    }
    free(hull);
    free(point);
    free(order);
    free(start);
    return ready ? LW_OK : LW_NO_MEMORY;
}

void lw_lightmap_pack_finish(struct lw_lightmap_layout *layout) {
    free(layout->slot);
    *layout = (struct lw_lightmap_layout){0};
}
