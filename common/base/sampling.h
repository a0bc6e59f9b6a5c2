/* sampling.h: the sample points of rays, for the solve's packets and for the path tracer's first hits. A
 * direction set is a packet of texels (packets.h), or of pixels within 16 x 16: its texels take nearly the
 * same direction, each about its own normal. A block of 16 x 16 texels has at most 16 sets. All sets walk the
 * same scrambled (0,2)-sequence, each with its own shift. So the samples of one texel are stratified over
 * time, and one sample of all sets is stratified over the block, which helps the filter. (Dealing one
 * sequence out among the sets was tried: then each texel's samples are as good as random.) The sequence goes
 * on from frame to frame.
 * Threads: pure functions, [any]. */
#ifndef LW_COMMON_BASE_SAMPLING_H
#define LW_COMMON_BASE_SAMPLING_H

#include "common/base/random.h"

/* Uses of random numbers; a pair of dimensions each. */
enum lw_sampling_use {
    LW_SAMPLING_BOUNCE = 1,
    LW_SAMPLING_SKY,
    LW_SAMPLING_EMITTER,
    LW_SAMPLING_EMITTER_PICK,
    LW_SAMPLING_PROBE,
    LW_SAMPLING_FOOTPRINT, /* the order of a texel's places */
    LW_SAMPLING_REFLECTOR,
    LW_SAMPLING_REFLECTOR_PICK,
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

/* Binary digits of a cell: rays of a set, towards the sky or for bounces, keep to one of 8 x 8. */
#define LW_SAMPLING_CELL_BITS 3u

/** The point of one of a set's 16 texels, out of lw_sampling_point(): in the same of 8 x 8 cells, in which
 * the texels' points are a net. Rays then still run close to one another, but a block tries 16 times as many
 * directions: a small bright thing (a window) is no more met by all of a block or by none. The samples of
 * one texel stay a (0,2)-sequence. lane: 0..15; 0 keeps the point. */
static inline void lw_sampling_spread(const float point[2], uint32_t lane, float out[2]) {
    const uint32_t net[2] = {lw_random_reverse_bits(lane), lw_random_reverse_bits(lw_random_pascal(lane))};
    for (uint32_t k = 0; k < 2; k++) {
        const uint32_t shift = net[k] >> (8 + LW_SAMPLING_CELL_BITS);
        out[k] = (float)((uint32_t)(point[k] * 0x1p24f) ^ shift) * 0x1p-24f;
    }
}

#endif
