/* sampling.h: which point of which sequence a ray takes: of the solve's packets, and of the path tracer's
 * first hits, whose direction sets are the bundles of 16 x 16 pixels. A packet (packets.h) is a direction
 * set: its texels take the same direction, about normals of their own. The sets of a block of 16 x 16 texels,
 * 16 at most, walk one scrambled (0,2)-sequence, each shifted by an amount of its own: what a texel sees is
 * stratified over the samples, and what the sets see of one sample is stratified over the block, for a filter
 * or the eye. (One sequence that the sets deal out among themselves is stratified as a whole only: a texel's
 * share of it is as good as random.) The sequence goes on from frame to frame.
 * Threads: pure functions, [any]. */
#ifndef LW_COMMON_SAMPLING_H
#define LW_COMMON_SAMPLING_H

#include "common/random.h"

/* What a number is for; a dimension pair each. */
enum lw_sampling_use {
    LW_SAMPLING_BOUNCE = 1,
    LW_SAMPLING_SKY,
    LW_SAMPLING_EMITTER,
    LW_SAMPLING_EMITTER_PICK,
    LW_SAMPLING_PROBE,
    LW_SAMPLING_FOOTPRINT, /* the order of a texel's places */
    LW_SAMPLING_PUNCTUAL = 64
};

/** Seed of one block's sequence for one use. block: any number that tells blocks of an object apart. */
static inline uint32_t lw_sampling_seed(uint32_t seed, uint32_t object, uint32_t block, uint32_t use) {
    return lw_random_hash4(seed, object, block, use);
}

/** Point of sample `sample` (counted over all frames) of direction set `set` (0..15). out: 2 floats in [0,
 * 1). Shifts are exclusive ors, which keep a (0,2)-sequence one: of the first four binary digits by 16 points
 * of a net, one for each set; of those behind them by chance, so that the sets share no detail. */
static inline void lw_sampling_point(uint32_t block_seed, uint32_t sample, uint32_t set, float out[2]) {
    float net[2];
    lw_random_sobol2(sample, block_seed, out);
    lw_random_sobol2(set, ~block_seed, net);
    for (uint32_t k = 0; k < 2; k++) {
        const uint32_t shift = (uint32_t)(net[k] * 16) << 20 | lw_random_hash3(block_seed, set, k) >> 12;
        out[k] = (float)((uint32_t)(out[k] * 0x1p24f) ^ shift) * 0x1p-24f;
    }
}

#endif
