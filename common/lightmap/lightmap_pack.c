#include "common/lightmap/lightmap_pack.h"

#include "common/lightmap/lightmap.h"
#include "common/lightmap/lightmap_mosaic.h"
#include "common/lightmap/lightmap_order.h"
#include "common/lightmap/lightmap_sliver.h"

#include <stdlib.h>
#include <string.h>

#define STB_RECT_PACK_IMPLEMENTATION
#define STBRP_STATIC
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#include <stb_rect_pack.h>
#pragma GCC diagnostic pop

/* A chart's content is a whole number of blocks, and the remainder to the next block would be an empty
 * margin. So a chart is widened by up to this factor, or narrowed by up to this share if it barely touches a
 * block. */
#define WIDEN       1.12f
#define NARROW      0.05f
#define NARROW_FROM 16.0f /* texels; smaller charts are never narrowed */

/* Largest bend of a surface within a texel, radians: 16 texels around a column. Beyond, texels are narrower,
 * by this much at most: a chair's leg stays coarse. (docs/lab/density.md) */
#define BEND    0.4f
#define REFINED 2.0f

/* Past this many rectangles the skyline's quadratic search takes too long; rows of like height do as well
 * then. */
#define SKYLINE_MAX 12000

/* Positions that the mosaic may look at, charts times blocks; beyond, the skyline's result has to do. */
#define MOSAIC_MAX 4e8

/* Limits of the searches for one layout, per item and in all. Without them, triangular shapes of many sizes
 * would take the square of their number. Scenes that people make need a tenth of it. */
#define LOOKS_EACH 4096u
#define LOOKS_MORE (1u << 26)

static const float SKYLINE_WIDTHS[] = {0.62f, 0.75f, 0.87f, 1.0f,
                                       1.15f, 1.33f, 1.6f}; /* shares of the square's side */
static const float MOSAIC_WIDTHS[] = {0.7f, 0.85f, 1.0f, 1.1f, 1.2f, 1.35f};

/* Blocks of a tile of the atlas. Charts that fill more than one together, and are small beside it in the
 * mean, are packed by where they are in space; others into the smallest atlas. */
#define TILE_BLOCKS 256u

/* One thing to pack: a chart, or a rectangle of slivers. */
struct item {
    struct lw_lightmap_stone stone; /* first: sorted by pointers to it */
    uint32_t first, count;          /* in member */
    uint32_t rank;                  /* in the order of charts */
};

/* One try at a layout: all charts lying, or all standing. */
struct packer {
    const struct lw_lightmap_layout *layout;
    float scale;
    uint32_t width_max, height_max; /* blocks */
    const uint32_t *order;          /* charts, those near one another together */
    struct lw_lightmap_slot *slot;  /* relative to their items */
    uint32_t *member;               /* charts by item */
    struct item *item;
    struct lw_lightmap_stone **stone; /* in the mosaic's order */
    uint32_t item_count;
    stbrp_rect *rect;
    stbrp_node *node;
    struct place *best; /* per item, in blocks */
    uint32_t best_width, best_height;
    bool found;
    uint64_t looks; /* how many are left */
};

struct place {
    uint32_t x, y;
};

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
    slot->x = slot->y = 0;
    slot->gutter = LW_LIGHTMAP_GUTTER;
}

/* The blocks of an item: those its chart touches, or all of a rectangle of slivers. */
static enum lw_status shape(struct packer *p, struct item *item) {
    struct lw_lightmap_stone *stone = &item->stone;
    uint32_t words = lw_lightmap_mosaic_words(stone->width);
    stone->row = calloc((size_t)stone->height * words, sizeof *stone->row);
    if (!stone->row) return LW_NO_MEMORY;
    const struct lw_lightmap_charts *charts = p->layout->charts;
    for (uint32_t m = item->first; m < item->first + item->count; m++) {
        const uint32_t chart = p->member[m];
        for (uint32_t i = p->layout->start[chart]; i < p->layout->start[chart + 1]; i++) {
            struct lw_vec2 c[3];
            for (int k = 0; k < 3; k++)
                c[k] = lw_lightmap_slot_place(&p->slot[chart],
                                              charts->point[charts->corner[p->layout->order[i]][k]]);
            lw_lightmap_mosaic_mark(stone, c, (float)LW_LIGHTMAP_BLOCK, (float)LW_LIGHTMAP_GUTTER);
        }
    }
    return LW_OK;
}

static uint32_t blocks_of(uint32_t texels) { return (texels + LW_LIGHTMAP_BLOCK - 1) / LW_LIGHTMAP_BLOCK; }

static void add_chart(struct packer *p, uint32_t first) {
    struct lw_lightmap_slot *slot = &p->slot[p->member[first]];
    fit(slot, p->scale);
    p->item[p->item_count++] =
        (struct item){.first = first,
                      .count = 1,
                      .stone = {.width = blocks_of(slot->width), .height = blocks_of(slot->height)}};
}

static enum lw_status add_slivers(struct packer *p, uint32_t first, uint32_t count) {
    uint32_t width, height;
    enum lw_status status =
        lw_lightmap_sliver_fit(p->layout, p->slot, p->member + first, count, p->scale, &width, &height);
    if (status != LW_OK) return status;
    for (uint32_t i = first; i < first + count; i++) { /* into the rectangle's gutter */
        struct lw_lightmap_slot *slot = &p->slot[p->member[i]];
        slot->x += LW_LIGHTMAP_GUTTER, slot->origin.x += (float)LW_LIGHTMAP_GUTTER;
        slot->y += LW_LIGHTMAP_GUTTER, slot->origin.y += (float)LW_LIGHTMAP_GUTTER;
    }
    p->item[p->item_count++] = (struct item){.first = first,
                                             .count = count,
                                             .stone = {.width = blocks_of(width + 2 * LW_LIGHTMAP_GUTTER),
                                                       .height = blocks_of(height + 2 * LW_LIGHTMAP_GUTTER)}};
    return LW_OK;
}

/* Charts of their own first, then slivers in groups. */
static enum lw_status make_items(struct packer *p) {
    const uint32_t count = p->layout->chart_count;
    uint32_t charts = 0, slivers = 0;
    uint32_t *rank = malloc(((size_t)count + 1) * sizeof *rank),
             *sliver = malloc(((size_t)count + 1) * sizeof *sliver);
    enum lw_status status = rank && sliver ? LW_OK : LW_NO_MEMORY;
    p->item_count = 0;
    for (uint32_t i = 0; i < count && status == LW_OK; i++) {
        rank[p->order[i]] = i;
        if (lw_lightmap_sliver_is(&p->slot[p->order[i]], p->scale)) {
            sliver[slivers++] = p->order[i];
        } else {
            p->member[charts] = p->order[i];
            add_chart(p, charts++);
        }
    }
    if (status == LW_OK) memcpy(p->member + charts, sliver, slivers * sizeof *sliver);
    for (uint32_t i = charts; i < count && status == LW_OK;) {
        uint32_t n = lw_lightmap_sliver_group(p->slot, p->member + i, count - i, p->scale);
        if (n == 1)
            add_chart(p, i);
        else
            status = add_slivers(p, i, n);
        i += n;
    }
    for (uint32_t i = 0; i < p->item_count && status == LW_OK; i++) {
        struct item *item = &p->item[i];
        item->rank = rank[p->member[item->first + item->count / 2]];
        status = shape(p, item);
    }
    free(sliver);
    free(rank);
    return status;
}

static bool is_better(const struct packer *p, uint32_t width, uint32_t height) {
    return !p->found || (uint64_t)width * height < (uint64_t)p->best_width * p->best_height;
}

static void note_best(struct packer *p, uint32_t width, uint32_t height) {
    p->best_width = width, p->best_height = height;
    p->found = true;
}

static int by_height(const void *left, const void *right) {
    const stbrp_rect *a = left, *b = right;
    if (a->h != b->h) return a->h > b->h ? -1 : 1;
    if (a->w != b->w) return a->w > b->w ? -1 : 1;
    return a->id < b->id ? -1 : a->id > b->id;
}

static bool pack_rows(struct packer *p, uint32_t width) {
    uint32_t x = 0, y = 0, row = 0;
    qsort(p->rect, p->item_count, sizeof *p->rect, by_height);
    for (uint32_t i = 0; i < p->item_count; i++) {
        stbrp_rect *r = &p->rect[i];
        if (x + (uint32_t)r->w > width) y += row, x = 0, row = 0;
        if (!row) row = (uint32_t)r->h;
        if ((uint32_t)r->w > width || y + (uint32_t)r->h > p->height_max) return false;
        r->x = (int)x, r->y = (int)y;
        x += (uint32_t)r->w;
    }
    return true;
}

static void try_skyline(struct packer *p, uint32_t width, int heuristic) {
    for (uint32_t i = 0; i < p->item_count; i++)
        p->rect[i] =
            (stbrp_rect){.id = (int)i, .w = (int)p->item[i].stone.width, .h = (int)p->item[i].stone.height};
    if (p->item_count > SKYLINE_MAX) {
        if (!pack_rows(p, width)) return;
    } else {
        stbrp_context context;
        stbrp_init_target(&context, (int)width, (int)p->height_max, p->node, (int)p->width_max);
        stbrp_setup_heuristic(&context, heuristic);
        if (!stbrp_pack_rects(&context, p->rect, (int)p->item_count)) return;
    }
    uint32_t right = 0, top = 0;
    for (uint32_t i = 0; i < p->item_count; i++) {
        const stbrp_rect *r = &p->rect[i];
        if ((uint32_t)(r->x + r->w) > right) right = (uint32_t)(r->x + r->w);
        if ((uint32_t)(r->y + r->h) > top) top = (uint32_t)(r->y + r->h);
    }
    if (!is_better(p, right, top)) return;
    for (uint32_t i = 0; i < p->item_count; i++)
        p->best[p->rect[i].id] = (struct place){(uint32_t)p->rect[i].x, (uint32_t)p->rect[i].y};
    note_best(p, right, top);
}

static uint32_t width_between(const struct packer *p, double wanted, uint32_t least) {
    if (wanted < (double)least) wanted = (double)least;
    return wanted > (double)p->width_max ? p->width_max : (uint32_t)wanted;
}

static void search_skyline(struct packer *p) {
    uint64_t area = 0;
    uint32_t widest = 1;
    for (uint32_t i = 0; i < p->item_count; i++) {
        area += (uint64_t)p->item[i].stone.width * p->item[i].stone.height;
        if (p->item[i].stone.width > widest) widest = p->item[i].stone.width;
    }
    double side = ceil(sqrt((double)area));
    bool both = p->item_count <= SKYLINE_MAX / 4;
    for (size_t i = 0; i < sizeof SKYLINE_WIDTHS / sizeof *SKYLINE_WIDTHS; i++) {
        uint32_t width = width_between(p, side * (double)SKYLINE_WIDTHS[i], widest);
        try_skyline(p, width, STBRP_HEURISTIC_Skyline_BL_sortHeight);
        if (both) try_skyline(p, width, STBRP_HEURISTIC_Skyline_BF_sortHeight);
    }
    if (!p->found) try_skyline(p, p->width_max, STBRP_HEURISTIC_Skyline_BL_sortHeight);
}

static int by_rank(const void *left, const void *right) {
    const uint32_t a = ((const struct item *)*(void *const *)left)->rank,
                   b = ((const struct item *)*(void *const *)right)->rank;
    return a < b ? -1 : a > b;
}

static void keep_mosaic(struct packer *p, uint32_t width, uint32_t height) {
    for (uint32_t k = 0; k < p->item_count; k++)
        p->best[k] = (struct place){p->item[k].stone.x, p->item[k].stone.y};
    note_best(p, width, height);
}

/* The smallest atlas, wherever that puts the charts: for what hardly fills a tile. */
static enum lw_status search_mosaic(struct packer *p, uint64_t area, uint32_t widest) {
    if ((double)p->item_count * (double)area > MOSAIC_MAX) return LW_OK;
    qsort(p->stone, p->item_count, sizeof *p->stone, lw_lightmap_mosaic_by_size);
    for (size_t i = 0; i < sizeof MOSAIC_WIDTHS / sizeof *MOSAIC_WIDTHS; i++) {
        uint32_t width = width_between(p, sqrt((double)area) * (double)MOSAIC_WIDTHS[i], widest), right, top;
        /* higher than the best so far is of no use */
        uint64_t most = p->found ? (uint64_t)p->best_width * p->best_height / width + 1 : p->height_max;
        bool fits;
        enum lw_status status = lw_lightmap_mosaic_pack(p->stone, p->item_count, width,
                                                        most < p->height_max ? (uint32_t)most : p->height_max,
                                                        &p->looks, &right, &top, &fits);
        if (status != LW_OK) return status;
        if (fits && is_better(p, right, top)) keep_mosaic(p, right, top);
    }
    return LW_OK;
}

/* Every chart near those that are near it in space. */
static enum lw_status search_near(struct packer *p, uint64_t area) {
    uint64_t before = 0;
    uint32_t right, top;
    bool fits;
    qsort(p->stone, p->item_count, sizeof *p->stone, by_rank);
    for (uint32_t i = 0; i < p->item_count; i++) {
        const uint64_t blocks = lw_lightmap_mosaic_area(p->stone[i]);
        p->stone[i]->wanted = ((float)before + 0.5f * (float)blocks) / (float)area;
        before += blocks;
    }
    enum lw_status status = lw_lightmap_mosaic_pack_near(p->stone, p->item_count, p->width_max, p->height_max,
                                                         &p->looks, &right, &top, &fits);
    if (status == LW_OK && fits) keep_mosaic(p, right, top);
    return status;
}

static enum lw_status search(struct packer *p) {
    uint64_t area = 0;
    uint32_t widest = 1;
    for (uint32_t i = 0; i < p->item_count; i++) {
        const struct lw_lightmap_stone *s = p->stone[i] = &p->item[i].stone;
        area += lw_lightmap_mosaic_area(s);
        if (s->width > widest) widest = s->width;
    }
    enum lw_status status = LW_OK;
    p->looks = (uint64_t)LOOKS_EACH * p->item_count + LOOKS_MORE;
    if (area > TILE_BLOCKS && area < (uint64_t)p->item_count * (TILE_BLOCKS / 4))
        status = search_near(p, area);
    if (status != LW_OK || p->found) return status;
    search_skyline(p);
    return search_mosaic(p, area, widest);
}

/* Moves the slots from their items to the atlas. */
static void move_slots(struct packer *p) {
    for (uint32_t i = 0; i < p->item_count; i++)
        for (uint32_t k = p->item[i].first; k < p->item[i].first + p->item[i].count; k++) {
            struct lw_lightmap_slot *slot = &p->slot[p->member[k]];
            uint32_t x = p->best[i].x * LW_LIGHTMAP_BLOCK, y = p->best[i].y * LW_LIGHTMAP_BLOCK;
            slot->x += x, slot->origin.x += (float)x;
            slot->y += y, slot->origin.y += (float)y;
        }
}

static void packer_finish(struct packer *p) {
    for (uint32_t i = 0; p->item && i < p->item_count; i++) free(p->item[i].stone.row);
    free(p->slot);
    free(p->member);
    free(p->item);
    free(p->stone);
    free(p->rect);
    free(p->node);
    free(p->best);
}

static enum lw_status packer_run(struct packer *p, bool turned) {
    size_t count = p->layout->chart_count;
    p->slot = malloc(count * sizeof *p->slot);
    p->member = malloc(count * sizeof *p->member);
    p->item = calloc(count, sizeof *p->item);
    p->stone = malloc(count * sizeof *p->stone);
    p->rect = malloc(count * sizeof *p->rect);
    p->node = malloc(((size_t)p->width_max + 1) * sizeof *p->node);
    p->best = malloc(count * sizeof *p->best);
    if (!p->slot || !p->member || !p->item || !p->stone || !p->rect || !p->node || !p->best)
        return LW_NO_MEMORY;
    for (uint32_t i = 0; i < count; i++) {
        p->slot[i] = p->layout->slot[i];
        if (turned) p->slot[i].box = lw_lightmap_shape_turned(&p->slot[i].box);
    }
    enum lw_status status = make_items(p);
    if (status == LW_OK) status = search(p);
    if (status == LW_OK && p->found) move_slots(p);
    return status;
}

/* A box may be too long for any atlas: that must be known before its texels overflow an integer. */
static bool is_hopeless(const struct lw_lightmap_layout *layout, float scale, uint32_t width_max,
                        uint32_t height_max) {
    float most = (float)(width_max > height_max ? width_max : height_max), area = 0;
    for (uint32_t i = 0; i < layout->chart_count; i++) {
        struct lw_vec2 size = layout->slot[i].box.size;
        if (!(fmaxf(size.x, size.y) * scale <= most)) return true;
        area +=
            size.x * scale * size.y * scale / 8; /* a mosaic may fill what boxes leave, but not eightfold */
    }
    return area > (float)width_max * (float)height_max;
}

/* All charts in the order of lightmap_order.h, whichever way they are turned. The caller frees *out_chart. */
static enum lw_status order_charts(const struct lw_lightmap_layout *layout, float scale,
                                   uint32_t **out_chart) {
    const uint32_t count = layout->chart_count;
    struct lw_lightmap_spot *spot = malloc(((size_t)count + 1) * sizeof *spot);
    *out_chart = malloc(((size_t)count + 1) * sizeof **out_chart);
    if (!spot || !*out_chart) {
        free(spot);
        return LW_NO_MEMORY;
    }
    for (uint32_t c = 0; c < count; c++) {
        const struct lw_lightmap_slot *slot = &layout->slot[c];
        spot[c] =
            (struct lw_lightmap_spot){lw_vec3_scale(slot->centre, scale), slot->normal,
                                      (slot->box.size.x * scale + 4) * (slot->box.size.y * scale + 4), c};
    }
    lw_lightmap_order(spot, count);
    for (uint32_t c = 0; c < count; c++) (*out_chart)[c] = spot[c].id;
    free(spot);
    return LW_OK;
}

enum lw_status lw_lightmap_pack(struct lw_lightmap_layout *layout, float scale, uint32_t width_max,
                                uint32_t height_max, bool *out_fits) {
    if (!layout->chart_count) { /* nothing but triangles without area: they share one texel */
        layout->width = layout->height = 2 * LW_LIGHTMAP_BLOCK;
        *out_fits = true;
        return LW_OK;
    }
    *out_fits = false;
    if (is_hopeless(layout, scale, width_max, height_max)) return LW_OK;
    uint32_t *order = NULL;
    enum lw_status status = order_charts(layout, scale, &order);
    for (int turned = 0; turned < 2 && status == LW_OK; turned++) {
        struct packer p = {.layout = layout,
                           .order = order,
                           .scale = scale,
                           .width_max = width_max / LW_LIGHTMAP_BLOCK,
                           .height_max = height_max / LW_LIGHTMAP_BLOCK};
        status = packer_run(&p, turned);
        uint64_t area = (uint64_t)p.best_width * p.best_height * LW_LIGHTMAP_BLOCK * LW_LIGHTMAP_BLOCK;
        if (status == LW_OK && p.found && (!*out_fits || area < (uint64_t)layout->width * layout->height)) {
            memcpy(layout->slot, p.slot, layout->chart_count * sizeof *p.slot);
            layout->width = p.best_width * LW_LIGHTMAP_BLOCK;
            layout->height = p.best_height * LW_LIGHTMAP_BLOCK;
            *out_fits = true;
        }
        packer_finish(&p);
    }
    free(order);
    return status;
}

/* Points of one chart, gathered by its triangles; a point of several triangles comes several times. */
static uint32_t gather(const struct lw_lightmap_charts *charts, const uint32_t *triangle, uint32_t count,
                       struct lw_vec2 *out_point) {
    uint32_t n = 0;
    for (uint32_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) out_point[n++] = charts->point[charts->corner[triangle[i]][k]];
    return n;
}

static float area_of(const struct lw_lightmap_charts *charts, uint32_t t) {
    const uint32_t *corner = charts->corner[t];
    struct lw_vec2 a = charts->point[corner[0]], b = charts->point[corner[1]], c = charts->point[corner[2]];
    return lw_vec2_twice_area(a, b, c) / 2;
}

static void sort_by_chart(const struct lw_lightmap_charts *charts, uint32_t *start, uint32_t *order) {
    for (uint32_t t = 0; t < charts->triangle_count; t++)
        if (charts->chart[t] != LW_SCENE_NONE) start[charts->chart[t] + 2]++;
    for (uint32_t c = 0; c < charts->chart_count; c++) start[c + 2] += start[c + 1];
    for (uint32_t t = 0; t < charts->triangle_count; t++)
        if (charts->chart[t] != LW_SCENE_NONE) order[start[charts->chart[t] + 1]++] = t;
}

/* Centre and normal of a chart, weighted by area; returns its area. In units of the mesh. */
static float place_in_space(struct lw_lightmap_slot *slot, const struct lw_mesh *mesh,
                            const uint32_t *triangle, uint32_t count) {
    struct lw_vec3 centre = {0}, normal = {0};
    float area = 0;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t *v = mesh->triangle[triangle[i]];
        const struct lw_vec3 a = mesh->position[v[0]], b = mesh->position[v[1]], c = mesh->position[v[2]];
        const struct lw_vec3 across = lw_vec3_cross(lw_vec3_sub(b, a), lw_vec3_sub(c, a));
        const float twice = fmaxf(lw_vec3_length(across), 1e-30f);
        centre = lw_vec3_add(centre, lw_vec3_scale(lw_vec3_add(a, lw_vec3_add(b, c)), twice / 3));
        normal = lw_vec3_add(normal, across);
        area += twice;
    }
    slot->centre = lw_vec3_scale(centre, 1 / area);
    slot->normal = lw_vec3_scale(normal, 1 / area);
    return area / 2;
}

static float finer(float bend_per_texel) { return fminf(fmaxf(bend_per_texel / BEND, 1), REFINED); }

/* A column that is lit from one side has its light on few texels around it, and the mean of lit and unlit
 * at its rim: what bends gets texels that are narrower across. */
static void refine(struct lw_lightmap_slot *slot, const struct lw_lightmap_bend *bend) {
    struct lw_lightmap_box *box = &slot->box;
    if (!(slot->area > 0)) return;
    const float x = box->axis.x, y = box->axis.y,
                along = x * x * bend->xx + 2 * x * y * bend->xy + y * y * bend->yy,
                across = bend->xx + bend->yy - along;
    box->stretch = (struct lw_vec2){finer(along / slot->area), finer(across / slot->area)};
    box->low.x *= box->stretch.x, box->size.x *= box->stretch.x;
    box->low.y *= box->stretch.y, box->size.y *= box->stretch.y;
    slot->area *= box->stretch.x * box->stretch.y;
    if (box->size.x < box->size.y) *box = lw_lightmap_shape_turned(box);
}

enum lw_status lw_lightmap_pack_init(struct lw_lightmap_layout *layout,
                                     const struct lw_lightmap_charts *charts, const struct lw_mesh *mesh) {
    size_t triangles = charts->triangle_count, count = charts->chart_count;
    uint32_t *start = calloc(count + 2, sizeof *start), *order = malloc((triangles + 1) * sizeof *order);
    struct lw_vec2 *point = malloc((triangles * 3 + 1) * sizeof *point);
    struct lw_vec2 *hull = malloc((triangles * 3 + 2) * sizeof *hull);
    struct lw_lightmap_slot *slot = calloc(count + 1, sizeof *slot);
    bool ready = start && order && point && hull && slot;
    if (ready) {
        sort_by_chart(charts, start, order);
        double area = 0, own_area = 0;
        for (uint32_t c = 0; c < count; c++) {
            uint32_t n = gather(charts, order + start[c], start[c + 1] - start[c], point);
            n = lw_lightmap_shape_hull(point, n, hull);
            slot[c].box = lw_lightmap_shape_box(hull, n, LW_LIGHTMAP_SHAPE_MARGIN);
            for (uint32_t i = start[c]; i < start[c + 1]; i++) slot[c].area += area_of(charts, order[i]);
            area += (double)place_in_space(&slot[c], mesh, order + start[c], start[c + 1] - start[c]);
            own_area += (double)slot[c].area;
            refine(&slot[c], &charts->bend[c]);
        }
        for (uint32_t c = 0; c < count; c++)
            slot[c].centre = lw_vec3_scale(slot[c].centre, (float)sqrt(own_area / area));
        *layout = (struct lw_lightmap_layout){.charts = charts,
                                              .chart_count = charts->chart_count,
                                              .slot = slot,
                                              .start = start,
                                              .order = order};
    } else {
        free(slot);
        free(order);
        free(start);
    }
    free(hull);
    free(point);
    return ready ? LW_OK : LW_NO_MEMORY;
}

void lw_lightmap_pack_finish(struct lw_lightmap_layout *layout) {
    free(layout->slot);
    free(layout->start);
    free(layout->order);
    *layout = (struct lw_lightmap_layout){0};
}
