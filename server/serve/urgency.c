#include "server/serve/urgency.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define FIRST_EXPONENT (-64) /* values under 2^-64 are all the same; so are those from 2^64 on */

enum lw_status lw_urgency_init(struct lw_urgency *urgency, const struct lw_atlas_map *atlas_map) {
    const size_t count = (size_t)atlas_map->tile_count + 1;
    *urgency = (struct lw_urgency){.atlas_map = atlas_map,
                                   .tile = calloc(count, sizeof *urgency->tile),
                                   .listed = calloc(count, sizeof *urgency->listed),
                                   .bin = calloc(count, sizeof *urgency->bin)};
    if (urgency->tile && urgency->listed && urgency->bin) return LW_OK;
    lw_urgency_finish(urgency);
    return LW_NO_MEMORY;
}

void lw_urgency_finish(struct lw_urgency *urgency) {
    free(urgency->bin);
    free(urgency->listed);
    free(urgency->tile);
    *urgency = (struct lw_urgency){0};
}

void lw_urgency_note(struct lw_urgency *urgency, uint32_t tile, uint64_t version, float change) {
    struct lw_urgency_tile *of = &urgency->tile[tile];
    of->version[of->count % LW_URGENCY_KEPT] = version;
    of->square[of->count % LW_URGENCY_KEPT] = change > 0 ? change * change : 1;
    of->count++;
}

/* Sum of the squares of the changes since a version, of which out_since is the first. */
static float square_since(const struct lw_urgency_tile *of, uint64_t has, uint64_t *out_since) {
    const uint32_t kept = of->count < LW_URGENCY_KEPT ? of->count : LW_URGENCY_KEPT;
    float square = 0;
    for (uint32_t back = 1; back <= kept; back++) {
        const uint32_t at = (of->count - back) % LW_URGENCY_KEPT;
        if (of->version[at] <= has) break;
        square += of->square[at];
        *out_since = of->version[at];
    }
    return square;
}

bool lw_urgency_is_due_to_stand_in(const struct lw_urgency *urgency, uint32_t tile, uint64_t has,
                                   uint64_t version) {
    uint64_t since;
    return !has || version - has >= LW_URGENCY_STAND_IN_FRAMES ||
           square_since(&urgency->tile[tile], has, &since) >=
               LW_URGENCY_STAND_IN_OFF * LW_URGENCY_STAND_IN_OFF;
}

float lw_urgency_of(const struct lw_urgency *urgency, uint32_t tile, uint64_t has, uint64_t frame) {
    const struct lw_tile_place *place = &urgency->atlas_map->place[tile];
    const float area = ldexpf((float)(place->width * place->height), 2 * (int)place->level);
    if (!has) {
        if (place->level + 1 == urgency->atlas_map->atlas[place->object].level_count) return INFINITY;
        return ldexpf(LW_URGENCY_LACKING * LW_URGENCY_LACKING * LW_TILE_TEXELS_MAX, 2 * (int)place->level);
    }
    uint64_t since = frame;
    const float square = square_since(&urgency->tile[tile], has, &since);
    const float wrong = frame > since ? (float)(frame - since) + 1 : 1; /* frames */
    return square * area * wrong * wrong;
}

/* Exponent and the first two bits behind the point, the largest first. */
static uint32_t bin_of(float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    const int32_t rank = (int32_t)(bits >> 21) - 4 * (FIRST_EXPONENT + 127);
    const int32_t bounded = rank < 0 || value < 0             ? 0
                            : rank < (int32_t)LW_URGENCY_BINS ? rank
                                                              : (int32_t)LW_URGENCY_BINS - 1;
    return LW_URGENCY_BINS - 1 - (uint32_t)bounded;
}

void lw_urgency_list_begin(struct lw_urgency *urgency) { urgency->listed_count = 0; }

void lw_urgency_list(struct lw_urgency *urgency, uint32_t tile, float value) {
    assert(urgency->listed_count < urgency->atlas_map->tile_count);
    urgency->bin[urgency->listed_count] = (uint16_t)bin_of(value);
    urgency->listed[urgency->listed_count++] = tile;
}

void lw_urgency_list_end(const struct lw_urgency *urgency, uint32_t *out_tile) {
    uint32_t first[LW_URGENCY_BINS + 1] = {0};
    for (uint32_t i = 0; i < urgency->listed_count; i++) first[urgency->bin[i] + 1]++;
    for (uint32_t b = 0; b < LW_URGENCY_BINS; b++) first[b + 1] += first[b];
    for (uint32_t i = 0; i < urgency->listed_count; i++)
        out_tile[first[urgency->bin[i]]++] = urgency->listed[i];
}
