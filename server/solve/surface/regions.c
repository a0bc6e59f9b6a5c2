#include "server/solve/surface/regions.h"

#include <stdlib.h>

#define TEXELS_MAX (LW_TILE_BLOCK * LW_TILE_BLOCK)
/* What is not cut by walls is together, whatever its charts: they are told apart by how they lie. */
#define UNCUT UINT32_MAX

struct member {
    uint32_t chart, side;
    uint32_t x, y;
};

/* Texels of one side. */
struct group {
    uint32_t side, count;
    uint32_t left, above; /* of its texels, in the first half of the block's columns, rows */
    uint32_t first, regions;
    bool by_rows; /* how two regions share it */
};

static uint8_t quarter_of(uint32_t x, uint32_t y) {
    return (uint8_t)((y >= LW_TILE_BLOCK / 2) * 2 + (x >= LW_TILE_BLOCK / 2));
}

static int compare_sides(const void *left, const void *right) {
    const struct member *a = left, *b = right;
    if (a->chart != b->chart) return a->chart < b->chart ? -1 : 1;
    return a->side != b->side ? (a->side < b->side ? -1 : 1) : 0;
}

static int compare_sizes(const void *left, const void *right) {
    const struct group *a = left, *b = right;
    if (a->count != b->count) return a->count > b->count ? -1 : 1;
    return a->side < b->side ? -1 : a->side > b->side;
}

/* Charts of one side within the block are not cut. Returns whether any is. */
static bool mark_uncut(struct member *member, uint32_t count) {
    bool cut = false;
    for (uint32_t i = 0, end; i < count; i = end) {
        for (end = i + 1; end < count && member[end].chart == member[i].chart;) end++;
        if (member[i].side != member[end - 1].side) {
            cut = true;
            continue;
        }
        for (uint32_t k = i; k < end; k++) member[k].side = UNCUT;
    }
    return cut;
}

static struct group *group_of(struct group *group, uint32_t *count, uint32_t side) {
    for (uint32_t g = 0; g < *count; g++)
        if (group[g].side == side) return &group[g];
    group[*count] = (struct group){.side = side};
    return &group[(*count)++];
}

static uint32_t group_sides(const struct member *member, uint32_t count, struct group *group) {
    uint32_t groups = 0;
    struct group *last = NULL;
    for (uint32_t i = 0; i < count; i++) {
        if (!last || last->side != member[i].side) last = group_of(group, &groups, member[i].side);
        last->count++;
        last->left += member[i].x < LW_TILE_BLOCK / 2;
        last->above += member[i].y < LW_TILE_BLOCK / 2;
    }
    qsort(group, groups, sizeof *group, compare_sizes);
    return groups;
}

static uint32_t smaller_half(uint32_t part, uint32_t whole) {
    return part < whole - part ? part : whole - part;
}

/* The largest sides have a region each, those left over the last one together. */
static struct lw_region_parts share_out(struct group *group, uint32_t groups) {
    struct lw_region_parts parts = {.count = (uint8_t)(groups < LW_REGIONS ? groups : LW_REGIONS)};
    uint32_t left = LW_REGIONS - parts.count, next = 0;
    for (uint32_t g = 0; g < groups; g++) {
        struct group *own = &group[g];
        const uint32_t by_columns = smaller_half(own->left, own->count),
                       by_rows = smaller_half(own->above, own->count);
        if (g >= parts.count) {
            own->first = LW_REGIONS - 1;
            own->regions = 1;
            continue;
        }
        own->by_rows = by_rows > by_columns;
        own->regions = left && by_rows + by_columns > 0 ? 2 : 1;
        left -= own->regions - 1;
        own->first = next;
        next += own->regions;
        parts.end[g] = (uint8_t)next;
    }
    return parts;
}

static uint8_t region_of(const struct group *group, uint32_t x, uint32_t y) {
    const bool second = (group->by_rows ? y : x) >= LW_TILE_BLOCK / 2;
    return (uint8_t)(group->first + (group->regions > 1 && second));
}

struct lw_region_parts lw_regions_deal(const struct lw_mesh_texels *mesh, uint32_t first, uint32_t stride,
                                       uint32_t width, uint32_t height, const uint8_t *covered,
                                       const uint32_t *side, uint8_t *region) {
    struct member member[TEXELS_MAX];
    struct group group[TEXELS_MAX];
    uint32_t count = 0;
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            const uint32_t i = y * stride + x;
            region[i] = quarter_of(x, y);
            if (covered[i])
                member[count++] =
                    (struct member){.chart = mesh->chart[first + i], .side = side[i], .x = x, .y = y};
        }
    qsort(member, count, sizeof *member, compare_sides);
    if (!mark_uncut(member, count)) return (struct lw_region_parts){.count = 1, .end = {LW_REGIONS}};
    uint32_t groups = group_sides(member, count, group);
    const struct lw_region_parts parts = share_out(group, groups);
    for (uint32_t i = 0; i < count; i++)
        region[member[i].y * stride + member[i].x] =
            region_of(group_of(group, &groups, member[i].side), member[i].x, member[i].y);
    return parts;
}
