#include "server/serve/sessions/fine_turns.h"

#include "common/base/invariant.h"
#include "server/serve/sessions/session_private.h"

#include <stdlib.h>

/* A tile with its turn in the upper half. */
static int compare(const void *left, const void *right) {
    const uint64_t a = *(const uint64_t *)left, b = *(const uint64_t *)right;
    return (a > b) - (a < b);
}

/* turn: per id of a finer level, its first place among those in any list; UINT32_MAX: in none */
static void count_turns(const struct lw_session_shared *shared, uint32_t *turn) {
    const uint32_t plain = shared->atlas_map->plain_count;
    for (uint32_t i = 0; i < lw_atlas_map_room(shared->atlas_map); i++) turn[i] = UINT32_MAX;
    for (const struct lw_session *s = shared->first; s; s = s->next) {
        uint32_t at = 0;
        for (uint32_t i = 0; i < s->interest.tile_count; i++) {
            if (s->interest.tile[i] < plain) continue;
            uint32_t *of = &turn[s->interest.tile[i] - plain];
            if (at < *of) *of = at;
            at++;
        }
    }
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
