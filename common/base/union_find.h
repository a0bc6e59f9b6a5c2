/* union_find.h: disjoint sets of the numbers 0..n-1, as a forest of parents.
 * Threads: one at a time.
 *
 * parent[i] = i makes i a set of its own. The root of a set is its smallest number, in any order of joins. */
#ifndef LW_COMMON_BASE_UNION_FIND_H
#define LW_COMMON_BASE_UNION_FIND_H

#include <stdint.h>

/** Root of the set that holds i; shortens the way there (path halving, Tarjan and van Leeuwen 1984). */
static inline uint32_t lw_union_find_root(uint32_t *parent, uint32_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

/** Makes one set of those that hold a and b. */
static inline void lw_union_find_join(uint32_t *parent, uint32_t a, uint32_t b) {
    a = lw_union_find_root(parent, a), b = lw_union_find_root(parent, b);
    if (a < b)
        parent[b] = a;
    else
        parent[a] = b;
}

#endif
