/* bilinear.h: the texels that a bilinear look-up of a lightmap reads, and how it weighs them. Viewers read
 * light so, and seams are welded for such look-ups: both take it from here.
 * Threads: pure functions, [any]. */
#ifndef LW_COMMON_BILINEAR_H
#define LW_COMMON_BILINEAR_H

#include <stdint.h>

/** Along one axis of a level. */
struct lw_bilinear {
    /* Texels; the same one at the last texel of the level. */
    uint32_t low, high;
    /* Weight of `high`; `low` has the rest. */
    float share;
};

/** at: texels from the level's edge, so that texel i has its centre at i + 0.5; beyond the first and the last
 * centre, or NaN, it is that texel's (NaN: the first's). size: texels of the level, at least 1. */
static inline struct lw_bilinear lw_bilinear_at(float at, uint32_t size) {
    const float last = (float)(size - 1);
    float from_first = at - 0.5f;
    from_first = from_first > 0 ? from_first : 0; /* NaN, too */
    from_first = from_first < last ? from_first : last;
    const uint32_t low = (uint32_t)(int32_t)from_first;
    return (struct lw_bilinear){
        .low = low, .high = low + 1 < size ? low + 1 : low, .share = from_first - (float)low};
}

#endif
