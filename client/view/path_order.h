/* path_order.h: which paths to trace together: those that stand on surfaces of like direction, near each other.
 * Flow:    where a bundle's paths have arrived -> [path_order] -> packets of rays that run nearly parallel
 * Threads: pure functions, [any]. */
#ifndef LW_CLIENT_VIEW_PATH_ORDER_H
#define LW_CLIENT_VIEW_PATH_ORDER_H

#include "common/vec.h"

#include <stdint.h>

#define LW_PATH_ORDER_MAX 1024u

struct lw_path_order_item {
    struct lw_vec3 position;
    struct lw_vec3 normal; /* unit */
};

/** Puts numbers into the order of their items: first by normal, in 49 classes, then along a Z-curve of 8 x 8 x 8 boxes
 * over all positions.
 *
 * item   count items, finite
 * order  count numbers, of any meaning, order[i] belongs to item[i]; put into order in place. Equal items keep theirs. */
void lw_path_order(const struct lw_path_order_item *item, unsigned count, uint16_t *order);

#endif
