#include "server/solve/surface/regions.h"

#include "common/base/invariant.h"

#include <stdlib.h>

/* ---- rooms ---- */

struct member {
    uint32_t chart, side, texel;
};

/* Texels of one side, from `first` on. */
struct side {
    uint32_t first, count;
};

static int compare_members(const void *left, const void *right) {
    const struct member *a = left, *b = right;
    if (a->chart != b->chart) return a->chart < b->chart ? -1 : 1;
    if (a->side != b->side) return a->side < b->side ? -1 : 1;
    return a->texel < b->texel ? -1 : a->texel > b->texel;
}

static int compare_sides(const void *left, const void *right) {
    const struct side *a = left, *b = right;
    if (a->count != b->count) return a->count > b->count ? -1 : 1;
    return a->first < b->first ? -1 : a->first > b->first;
}

static uint32_t end_of_chart(const struct member *member, uint32_t count, uint32_t i) {
    uint32_t end = i + 1;
    while (end < count && member[end].chart == member[i].chart) end++;
    return end;
}

static uint32_t end_of_side(const struct member *member, uint32_t end_of_chart, uint32_t i) {
    uint32_t end = i + 1;
    while (end < end_of_chart && member[end].side == member[i].side) end++;
    return end;
}

/* Lists the sides of charts that are cut or wide; members are sorted. */
static uint32_t list_sides(const struct member *member, uint32_t count, struct side *out) {
    uint32_t sides = 0;
    for (uint32_t i = 0, end; i < count; i = end) {
        end = end_of_chart(member, count, i);
        const bool cut = member[i].side != member[end - 1].side;
        if (!cut && end - i < LW_ROOM_WIDE) continue;
        for (uint32_t k = i, next; k < end; k = next) {
            next = end_of_side(member, end, k);
            out[sides++] = (struct side){k, next - k};
        }
    }
    return sides;
}

uint32_t lw_rooms_find(const struct lw_mesh_texels *mesh, uint32_t first, uint32_t width, uint32_t height,
                       const uint8_t *covered, const uint32_t *side, uint8_t *room) {
    struct member member[LW_TILE_SIDE * LW_TILE_SIDE];
    struct side sides[LW_TILE_SIDE * LW_TILE_SIDE];
    uint32_t count = 0, wide = 0;
    for (uint32_t i = 0; i < width * height; i++) {
        room[i] = 0;
        if (covered[i]) member[count++] = (struct member){mesh->chart[first + i], side[i], i};
    }
    qsort(member, count, sizeof *member, compare_members);
    const uint32_t side_count = list_sides(member, count, sides);
    LW_INVARIANT(side_count <= count);
    qsort(sides, side_count, sizeof *sides, compare_sides);
    for (uint32_t s = 0; s < side_count; s++) {
        const uint32_t number = s + 1 < LW_ROOMS_MAX ? s + 1 : LW_ROOMS_MAX - 1;
        for (uint32_t k = 0; k < sides[s].count; k++)
            room[member[sides[s].first + k].texel] = (uint8_t)number;
        if (number == s + 1 && sides[s].count >= LW_ROOM_WIDE) wide = number;
    }
    LW_INVARIANT(wide <= side_count && wide < LW_ROOMS_MAX);
    return wide;
}

/* ---- regions ---- */

/* Texels of one room in a block. */
struct group {
    uint32_t room, count;
    uint32_t left, above; /* its texels in the first half of the block's columns, rows */
    uint32_t first, regions;
    bool by_rows; /* how two regions share it */
};

static uint8_t quarter_of(uint32_t x, uint32_t y) {
    return (uint8_t)((y >= LW_TILE_BLOCK / 2) * 2 + (x >= LW_TILE_BLOCK / 2));
}

static int compare_groups(const void *left, const void *right) {
    const struct group *a = left, *b = right;
    return a->count != b->count ? (a->count > b->count ? -1 : 1) : (int)a->room - (int)b->room;
}

static struct group *group_of(struct group *group, uint32_t *count, uint32_t room) {
    for (uint32_t g = 0; g < *count; g++)
        if (group[g].room == room) return &group[g];
    group[*count] = (struct group){.room = room};
    return &group[(*count)++];
}

static uint32_t smaller_half(uint32_t part, uint32_t whole) {
    return part < whole - part ? part : whole - part;
}

/* The largest rooms have a region each; those left over share the last one. Regions without texels belong to
 * the last part. */
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
        parts.room[g] = (uint8_t)own->room;
    }
    LW_INVARIANT(groups > 1 && next <= LW_REGIONS);
    parts.end[parts.count - 1] = LW_REGIONS;
    return parts;
}

static uint8_t region_of(const struct group *group, uint32_t x, uint32_t y) {
    const bool second = (group->by_rows ? y : x) >= LW_TILE_BLOCK / 2;
    return (uint8_t)(group->first + (group->regions > 1 && second));
}

struct lw_region_parts lw_regions_deal(uint32_t stride, uint32_t width, uint32_t height,
                                       const uint8_t *covered, const uint8_t *room, uint8_t *region) {
    struct group group[LW_TILE_BLOCK * LW_TILE_BLOCK];
    uint32_t groups = 0;
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            const uint32_t i = y * stride + x;
            region[i] = quarter_of(x, y);
            if (!covered[i]) continue;
            struct group *own = group_of(group, &groups, room[i]);
            own->count++;
            own->left += x < LW_TILE_BLOCK / 2;
            own->above += y < LW_TILE_BLOCK / 2;
        }
    if (groups < 2)
        return (struct lw_region_parts){
            .count = 1, .end = {LW_REGIONS}, .room = {(uint8_t)(groups ? group[0].room : 0)}};
    qsort(group, groups, sizeof *group, compare_groups);
    const struct lw_region_parts parts = share_out(group, groups);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            const uint32_t i = y * stride + x;
            if (covered[i]) region[i] = region_of(group_of(group, &groups, room[i]), x, y);
            LW_INVARIANT_DEAR(region[i] < LW_REGIONS);
        }
    return parts;
}
