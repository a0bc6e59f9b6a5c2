/* random.h: random numbers as pure functions of their arguments. A sample is a function of (seed, object,
 * direction set, bounce, index, dimension): never of frame, thread or time.
 * Threads: pure functions, [any].
 * After:   the pcg output mix (O'Neill 2014; Jarzynski and Olano 2020); Owen-scrambled Sobol by hashing
 *          (Burley 2020). */
#ifndef LW_COMMON_BASE_RANDOM_H
#define LW_COMMON_BASE_RANDOM_H

#include <stdint.h>

/** Mixes one word. */
static inline uint32_t lw_random_hash(uint32_t v) {
    uint32_t state = v * 747796405u + 2891336453u;
    uint32_t word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}
static inline uint32_t lw_random_hash2(uint32_t a, uint32_t b) {
    return lw_random_hash(a ^ lw_random_hash(b));
}
static inline uint32_t lw_random_hash3(uint32_t a, uint32_t b, uint32_t c) {
    return lw_random_hash2(a, lw_random_hash2(b, c));
}
static inline uint32_t lw_random_hash4(uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
    return lw_random_hash2(a, lw_random_hash3(b, c, d));
}

/** [0, 1) from the top 24 bits; never 1. */
static inline float lw_random_unit(uint32_t bits) { return (float)(bits >> 8) * 0x1p-24f; }

static inline uint32_t lw_random_reverse_bits(uint32_t x) {
    x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
    x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
    x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
    return __builtin_bswap32(x);
}

/* Each bit by those below it, and by the seed: in the order of a radical inverse's digits, a nested uniform
 * permutation. */
static inline uint32_t lw_random_mix_up(uint32_t x, uint32_t seed) {
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

/** Owen scrambling of a radical inverse: a nested uniform permutation of its bits, chosen by seed. */
static inline uint32_t lw_random_owen(uint32_t x, uint32_t seed) {
    return lw_random_reverse_bits(lw_random_mix_up(lw_random_reverse_bits(x), seed));
}

/* Sobol's second dimension, of which the highest digit is the lowest bit: digit k is the sum, mod 2, of the
 * index's bits j with C(j, k) odd, that is (Lucas) of those whose number has every bit that k has. */
static inline uint32_t lw_random_pascal(uint32_t index) {
    index ^= index >> 1 & 0x55555555u;
    index ^= index >> 2 & 0x33333333u;
    index ^= index >> 4 & 0x0f0f0f0fu;
    index ^= index >> 8 & 0x00ff00ffu;
    return index ^ (index >> 16 & 0x0000ffffu);
}

/** Point `index` of the (0,2)-sequence (Sobol's first two dimensions), Owen-scrambled and shuffled by seed.
 * Any 2^k aligned run of indices is stratified in both dimensions. out: 2 floats in [0, 1). */
static inline void lw_random_sobol2(uint32_t index, uint32_t seed, float out[2]) {
    /* shuffle: the order differs per seed, the set does not */
    index = lw_random_owen(index, lw_random_hash(seed));
    /* the radical inverse of the index, and that of its second dimension, scrambled */
    const uint32_t x = lw_random_mix_up(index, lw_random_hash(seed ^ 0x9e3779b9u)),
                   y = lw_random_mix_up(lw_random_pascal(index), lw_random_hash(seed ^ 0x85ebca6bu));
    out[0] = lw_random_unit(lw_random_reverse_bits(x));
    out[1] = lw_random_unit(lw_random_reverse_bits(y));
}

#endif
