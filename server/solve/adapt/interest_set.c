#include "server/solve/adapt/interest_set.h"

#include "common/base/invariant.h"
#include "server/solve/transport/ray_hit.h"

#include <stdlib.h>
#include <string.h>

/* One texel in this many has its rays counted. Odd: it goes through all columns of a tile. */
#define COUNT_ONE_IN 9u
/* Frames that the running mean of importance stands for, about. */
#define IMPORTANCE_FRAMES 8.0f
/* A tile of less importance lights nothing that can be seen: a thousandth of what a tile has in a scene all
 * in view. */
#define IMPORTANCE_MIN 0.001f

void lw_interest_set_init(struct lw_interest_set *interest, uint32_t ids) {
    *interest = (struct lw_interest_set){.scope = LW_INTEREST_EVERYTHING, .ids = ids};
}

static void free_planes(struct lw_interest_set *interest) {
    free(interest->level);
    free(interest->hits);
    free(interest->importance);
    interest->level = NULL;
    interest->hits = NULL;
    interest->importance = NULL;
}

void lw_interest_set_finish(struct lw_interest_set *interest) { free_planes(interest); }

size_t lw_interest_set_memory_bytes(const struct lw_interest_set *interest) {
    if (!interest->level) return 0;
    return interest->ids * (sizeof *interest->level + sizeof *interest->hits + sizeof *interest->importance);
}

static bool allocate(struct lw_interest_set *interest) {
    interest->level = calloc((size_t)interest->ids + 1, sizeof *interest->level);
    interest->hits = calloc((size_t)interest->ids + 1, sizeof *interest->hits);
    interest->importance = calloc((size_t)interest->ids + 1, sizeof *interest->importance);
    return interest->level && interest->hits && interest->importance;
}

enum lw_status lw_interest_set_replace(struct lw_interest_set *interest, const uint8_t *level,
                                       uint32_t plain) {
    if (!level) {
        interest->scope = LW_INTEREST_EVERYTHING;
        return LW_OK;
    }
    if (!interest->level && !allocate(interest)) {
        free_planes(interest);
        return LW_NO_MEMORY;
    }
    memcpy(interest->level, level, interest->ids);
    for (uint32_t id = plain; id < interest->ids; id++) interest->level[id] = level[id] != 0;
    interest->scope = LW_INTEREST_NOTHING;
    for (uint32_t id = 0; id < interest->ids; id++)
        if (level[id]) interest->scope = LW_INTEREST_TILES;
    LW_INVARIANT(interest->level && interest->hits && interest->importance);
    return LW_OK;
}

void lw_interest_set_forget(struct lw_interest_set *interest, lw_tile_id id) {
    if (!interest->level) return;
    interest->hits[id.v] = 0;
    interest->importance[id.v] = 0;
}

bool lw_interest_set_contributes(const struct lw_interest_set *interest, const struct lw_solve_tile *tile,
                                 bool all_contribute) {
    if (!tile->covered_count || tile->hidden) return false;
    return lw_interest_set_level(interest, tile->id) ||
           (interest->scope == LW_INTEREST_TILES &&
            (all_contribute || interest->importance[tile->id.v] >= IMPORTANCE_MIN));
}

static void note_hit(struct lw_interest_set *interest, const struct lw_tiles *tiles, uint32_t texel,
                     uint32_t weight) {
    LW_INVARIANT_DEAR(texel < tiles->texel_count);
    __atomic_fetch_add(&interest->hits[tiles->block[tiles->block_of_texel[texel]].tile_id], weight,
                       __ATOMIC_RELAXED);
}

void lw_interest_set_note_hits(struct lw_interest_set *interest, const struct lw_transport *passes,
                               const struct lw_solve_tile *tile, uint32_t turn, uint32_t weight) {
    const struct lw_tiles *tiles = passes->tiles;
    const uint32_t samples = passes->indirect_samples;
    if (!weight) return;
    LW_INVARIANT(interest->ids == tiles->id_count && weight <= UINT16_MAX);
    for (uint32_t i = turn % COUNT_ONE_IN; i < tile->width * tile->height; i += COUNT_ONE_IN) {
        const uint32_t texel = tile->first + i;
        if (!tiles->covered[texel]) continue;
        for (uint32_t s = 0; s < samples; s++) {
            const uint32_t hit = passes->ray_hit[(size_t)texel * samples + s];
            if (!(hit & LW_RAY_HIT_PROBE)) note_hit(interest, tiles, hit, weight); /* or nothing */
        }
        if (passes->reflected[texel].weight > 0)
            note_hit(interest, tiles, passes->reflected[texel].texel, weight);
    }
}

void lw_interest_set_take_importance(struct lw_interest_set *interest, const struct lw_tiles *tiles,
                                     uint32_t samples) {
    LW_INVARIANT(interest->ids == tiles->id_count);
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        const float own =
            (float)tile->covered_count * (float)samples * ((float)LW_INTEREST_WEIGHT / (float)COUNT_ONE_IN);
        float *importance = &interest->importance[tile->id.v];
        if (own > 0)
            *importance += ((float)interest->hits[tile->id.v] / own - *importance) * (1 / IMPORTANCE_FRAMES);
        LW_INVARIANT_DEAR(*importance >= 0 && *importance < INFINITY);
    }
    memset(interest->hits, 0, interest->ids * sizeof *interest->hits);
}
