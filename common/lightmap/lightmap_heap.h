/* lightmap_heap.h: edges in order of cost; equal costs in order of number, so that results are deterministic.
 * Threads: pure functions on the caller's memory. */
#ifndef LW_COMMON_LIGHTMAP_HEAP_H
#define LW_COMMON_LIGHTMAP_HEAP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct lw_lightmap_step {
    float cost;
    uint32_t edge;
};

struct lw_lightmap_heap {
    struct lw_lightmap_step *step; /* the caller's, large enough for all that is pushed */
    size_t count;
};

static inline bool lw_lightmap_heap_before(struct lw_lightmap_step a, struct lw_lightmap_step b) {
    return a.cost != b.cost ? a.cost < b.cost : a.edge < b.edge;
}

static inline void lw_lightmap_heap_push(struct lw_lightmap_heap *heap, float cost, uint32_t edge) {
    struct lw_lightmap_step step = {cost, edge};
    size_t at = heap->count++;
    for (; at > 0 && lw_lightmap_heap_before(step, heap->step[(at - 1) / 2]); at = (at - 1) / 2)
        heap->step[at] = heap->step[(at - 1) / 2];
    heap->step[at] = step;
}

/** The cheapest edge; the heap must not be empty. */
static inline uint32_t lw_lightmap_heap_pop(struct lw_lightmap_heap *heap) {
    uint32_t top = heap->step[0].edge;
    struct lw_lightmap_step last = heap->step[--heap->count];
    size_t at = 0;
    for (size_t child; (child = at * 2 + 1) < heap->count; at = child) {
        if (child + 1 < heap->count && lw_lightmap_heap_before(heap->step[child + 1], heap->step[child]))
            child++;
        if (!lw_lightmap_heap_before(heap->step[child], last)) break;
        heap->step[at] = heap->step[child];
    }
    heap->step[at] = last;
    return top;
}

#endif
