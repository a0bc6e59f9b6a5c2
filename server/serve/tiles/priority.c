#include "server/serve/tiles/priority.h"

#include "common/base/invariant.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define FIRST_EXPONENT (-64) /* values under 2^-64 are all the same; so are those from 2^64 on */

enum lw_status lw_priority_init(struct lw_priority *priority, const struct lw_atlas_map *atlas_map) {
    const size_t count = (size_t)atlas_map->tile_count + 1;
    *priority = (struct lw_priority){.atlas_map = atlas_map,
                                     .tile = calloc(count, sizeof *priority->tile),
                                     .listed = calloc(count, sizeof *priority->listed),
                                     .bin = calloc(count, sizeof *priority->bin)};
    if (priority->tile && priority->listed && priority->bin) return LW_OK;
    lw_priority_finish(priority);
    return LW_NO_MEMORY;
}

void lw_priority_finish(struct lw_priority *priority) {
    free(priority->bin);
    free(priority->listed);
    free(priority->tile);
    *priority = (struct lw_priority){0};
}

void lw_priority_note(struct lw_priority *priority, uint32_t tile, uint64_t version, float change) {
    struct lw_priority_tile *of = &priority->tile[tile];
    LW_INVARIANT(tile < priority->atlas_map->tile_count);
    LW_INVARIANT_DEAR(change >= 0);
    LW_INVARIANT(!of->count || version >= of->version[(of->count - 1) % LW_PRIORITY_KEPT]);
    of->version[of->count % LW_PRIORITY_KEPT] = version;
    of->square[of->count % LW_PRIORITY_KEPT] = change > 0 ? change * change : 1;
    of->count++;
}

void lw_priority_forget(struct lw_priority *priority, uint32_t tile) {
    LW_INVARIANT(tile < priority->atlas_map->tile_count);
    priority->tile[tile].count = 0;
}

/* Sum of the squares of the changes since a version, of which out_since is the first. */
static float square_since(const struct lw_priority_tile *of, uint64_t has, uint64_t *out_since) {
    const uint32_t kept = of->count < LW_PRIORITY_KEPT ? of->count : LW_PRIORITY_KEPT;
    float square = 0;
    for (uint32_t back = 1; back <= kept; back++) {
        const uint32_t at = (of->count - back) % LW_PRIORITY_KEPT;
        if (of->version[at] <= has) break;
        square += of->square[at];
        *out_since = of->version[at];
    }
    return square;
}

bool lw_priority_is_due_to_stand_in(const struct lw_priority *priority, uint32_t tile, uint64_t has,
                                    uint64_t version) {
    uint64_t since;
    return !has || version - has >= LW_PRIORITY_STAND_IN_FRAMES ||
           square_since(&priority->tile[tile], has, &since) >=
               LW_PRIORITY_STAND_IN_OFF * LW_PRIORITY_STAND_IN_OFF;
}

float lw_priority_of(const struct lw_priority *priority, uint32_t tile, uint64_t has, uint64_t frame) {
    const struct lw_tile_place *place = &priority->atlas_map->place[tile];
    const int scale = lw_atlas_scale(place->level);
    const float area = ldexpf((float)(place->width * place->height), 2 * scale);
    if (!has) {
        if (place->level + 1 == priority->atlas_map->atlas[place->object]->level_count) return INFINITY;
        return ldexpf(LW_PRIORITY_LACKING * LW_PRIORITY_LACKING * LW_TILE_TEXELS_MAX, 2 * scale);
    }
    uint64_t since = frame;
    const float square = square_since(&priority->tile[tile], has, &since);
    const float wrong = frame > since ? (float)(frame - since) + 1 : 1; /* frames */
    LW_INVARIANT(square >= 0 && area > 0);
    return square * area * wrong * wrong;
}

/* Exponent and the first two bits behind the point, the largest first. */
static uint32_t bin_of(float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    const int32_t rank = (int32_t)(bits >> 21) - 4 * (FIRST_EXPONENT + 127);
    const int32_t bounded = rank < 0 || value < 0              ? 0
                            : rank < (int32_t)LW_PRIORITY_BINS ? rank
                                                               : (int32_t)LW_PRIORITY_BINS - 1;
    return LW_PRIORITY_BINS - 1 - (uint32_t)bounded;
}

void lw_priority_list_begin(struct lw_priority *priority) { priority->listed_count = 0; }

void lw_priority_list(struct lw_priority *priority, uint32_t tile, float value) {
    LW_INVARIANT(priority->listed_count < priority->atlas_map->tile_count);
    priority->bin[priority->listed_count] = (uint16_t)bin_of(value);
    priority->listed[priority->listed_count++] = tile;
}

void lw_priority_list_end(const struct lw_priority *priority, uint32_t *out_tile) {
    uint32_t first[LW_PRIORITY_BINS + 1] = {0};
    for (uint32_t i = 0; i < priority->listed_count; i++) first[priority->bin[i] + 1]++;
    for (uint32_t b = 0; b < LW_PRIORITY_BINS; b++) first[b + 1] += first[b];
    LW_INVARIANT(first[LW_PRIORITY_BINS] == priority->listed_count);
    for (uint32_t i = 0; i < priority->listed_count; i++)
        out_tile[first[priority->bin[i]]++] = priority->listed[i];
    LW_INVARIANT(first[LW_PRIORITY_BINS - 1] == priority->listed_count); /* a permutation: no place is left */
}
