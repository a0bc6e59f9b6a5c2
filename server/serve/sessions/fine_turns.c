#include "server/serve/sessions/fine_turns.h"

#include "common/base/invariant.h"
#include "server/serve/sessions/session_private.h"

#include <stdlib.h>

#define RESERVE_SHARE 4u /* one id in as many is for the first tiles of lists */
#define TILES_A_TURN  4u /* turns of LW_SESSION_FINE_MAX tiles fit into a byte */

_Static_assert(LW_SESSION_FINE_MAX / TILES_A_TURN <= UINT8_MAX + 1, "a turn is a byte");

/* A tile with its turn in the upper half. */
static int compare(const void *left, const void *right) {
    const uint64_t a = *(const uint64_t *)left, b = *(const uint64_t *)right;
    return (a > b) - (a < b);
}

/* Coarser levels first: lists themselves are in no order of importance. */
static void count_list(const struct lw_atlas_map *map, const uint32_t *tile, size_t count, uint32_t *turn) {
    uint32_t at = 0;
    for (uint32_t k = 1; k <= map->finer_count; k++)
        for (size_t i = 0; i < count; i++) {
            if (lw_atlas_finer(map->place[tile[i]].level) != k) continue;
            uint32_t *of = &turn[tile[i] - map->plain_count];
            if (at < *of) *of = at;
            at++;
        }
}

/* turn: per id of a finer level, its first place among those in any list; UINT32_MAX: in none */
static void count_turns(const struct lw_session_shared *shared, uint32_t *turn) {
    for (uint32_t i = 0; i < lw_atlas_map_room(shared->atlas_map); i++) turn[i] = UINT32_MAX;
    for (const struct lw_session *s = shared->first; s; s = s->next)
        count_list(shared->atlas_map, s->interest.tile, s->interest.tile_count, turn);
}

bool lw_fine_turns_may_claim(const struct lw_atlas_map *map, uint32_t count) {
    const uint32_t reserve = lw_atlas_map_room(map) / RESERVE_SHARE, left = lw_fine_ids_free_count(map->fine);
    if (count < LW_SESSION_FINE_SHARE) return left > 0;
    return left > reserve && count < (left - reserve) / 2 + LW_SESSION_FINE_SHARE;
}

bool lw_fine_turns_weigh(const struct lw_session_shared *shared, const uint32_t *outside,
                         size_t outside_count, uint8_t *levels) {
    const uint32_t plain = shared->atlas_map->plain_count, room = lw_atlas_map_room(shared->atlas_map);
    if (!room) return true;
    uint32_t *turn = malloc(room * sizeof *turn);
    if (!turn) return false;
    count_turns(shared, turn);
    count_list(shared->atlas_map, outside, outside_count, turn);
    for (uint32_t i = 0; i < room; i++) {
        if (!levels[plain + i] || turn[i] == UINT32_MAX) continue;
        const uint32_t later = turn[i] / TILES_A_TURN;
        levels[plain + i] = (uint8_t)(1 + (later < UINT8_MAX ? later : UINT8_MAX - 1));
    }
    free(turn);
    return true;
}

bool lw_fine_turns_order(const struct lw_session_shared *shared, uint32_t *tile, uint32_t count) {
    const uint32_t plain = shared->atlas_map->plain_count;
    uint32_t first = count;
    while (first && tile[first - 1] >= plain) first--;
    const uint32_t fine = count - first;
    if (fine <= LW_SESSION_FINE_MAX && count <= LW_MESSAGE_INTEREST_MAX) return true;
    uint32_t *turn = malloc(lw_atlas_map_room(shared->atlas_map) * sizeof *turn);
    uint64_t *order = malloc(fine * sizeof *order);
    if (turn && order) {
        count_turns(shared, turn);
        for (uint32_t i = 0; i < fine; i++)
            order[i] = (uint64_t)turn[tile[first + i] - plain] << 32 | tile[first + i];
        qsort(order, fine, sizeof *order, compare);
        for (uint32_t i = 0; i < fine; i++) tile[first + i] = (uint32_t)order[i];
    }
    const bool done = turn && order;
    free(turn);
    free(order);
    return done;
}
