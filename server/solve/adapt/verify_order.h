/* change_order.h: in which order tiles are asked what has changed, where a frame has no time to ask all.
 * Flow:    pose before, pose now -> [note what moved] -> [order] -> the tiles as they are asked (follow.h)
 * Threads: [solver].
 *
 * What is looked at is asked before what lights it, what has moved itself first, and what is near to it before what is far: there a
 * change is most likely found, and most to be seen. */
#ifndef LW_ADAPT_VERIFY_ORDER_H
#define LW_ADAPT_VERIFY_ORDER_H

#include "server/solve/adapt/schedule.h"

/* Of places on what has moved; more would only order better. */
#define LW_VERIFY_ORDER_PLACES_MAX 32u

struct lw_verify_order {
    struct lw_vec3 place_ws[LW_VERIFY_ORDER_PLACES_MAX]; /* where something last moved from, and to */
    uint32_t place_count;
    struct lw_verify_order_turn {
        float rank;
        uint32_t tile; /* index into the tiles */
    } * turn;          /* one of each tile, the first to be asked first */
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_verify_order_init(struct lw_verify_order *order, uint32_t tile_count);
void lw_verify_order_finish(struct lw_verify_order *order);

/** Notes what has moved, or come or gone, and that all tiles are to be asked about it. The tiles are still at pose `was`. */
void lw_verify_order_note(struct lw_verify_order *order, struct lw_tiles *tiles, const struct lw_scene *scene,
                          const struct lw_pose *was, const struct lw_pose *is);

/** Sets `turn`: by rank if not all may be asked (limited) and there are tiles that serve and were not asked yet, else as the tiles
 * stand. */
void lw_verify_order_sort(struct lw_verify_order *order, const struct lw_tiles *tiles,
                          const struct lw_schedule *schedule, bool limited);

#endif
