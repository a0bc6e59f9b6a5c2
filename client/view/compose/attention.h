/* attention.h: a viewer's interest set: the tiles of its picture, of its surroundings, and of its last
 * moments.
 * Flow:    compose (needed, around) -> [attention] -> lw_client_want() -> server
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_VIEW_COMPOSE_ATTENTION_H
#define LW_CLIENT_VIEW_COMPOSE_ATTENTION_H

#include "client/lib/client.h"

#define LW_ATTENTION_KEEP_NS 2000000000u /* a tile stays in the set for so long after it left the picture */

struct lw_attention {
    uint32_t tile_count, list_count;
    uint64_t *seen_ns; /* per lw_tile_id: when it was last in the picture; 0: never */
    lw_tile_id *list;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_attention_init(struct lw_attention *attention, uint32_t tile_count);
/** A zeroed one is fine. */
void lw_attention_finish(struct lw_attention *attention);

/** Lists the interest set. Where it has more than LW_CLIENT_INTEREST_MAX tiles, those seen a moment ago are
 * left out first, then those around the picture. If the picture alone has more, the list is too long, which
 * means everything (lw_client_want()).
 *
 * needed, around  per lw_tile_id: in the picture, around it
 * now_ns          growing, > 0 */
void lw_attention_list(struct lw_attention *attention, const uint8_t *needed, const uint8_t *around,
                       uint64_t now_ns);

#endif
