#include "common/base/histogram.h"

#include <math.h>

/* log2(LW_HISTOGRAM_PARTS) */
#define PARTS_BITS 6u

_Static_assert(1u << PARTS_BITS == LW_HISTOGRAM_PARTS, "the parts of a power of two are a power of two");
_Static_assert(LW_HISTOGRAM_BUCKETS == LW_HISTOGRAM_PARTS * (64 - PARTS_BITS + 1), "64 bits have a bucket");

/* With s the shift that leaves 6 bits below the leading one: parts [64 s + 64, 64 s + 128) belong to it.
 * Values below 128 are their own bucket. */
static uint32_t bucket_of(uint64_t value) {
    if (value < 2 * LW_HISTOGRAM_PARTS) return (uint32_t)value;
    uint32_t shift = 63u - PARTS_BITS - (uint32_t)__builtin_clzll(value);
    return LW_HISTOGRAM_PARTS * shift + (uint32_t)(value >> shift);
}

/* The middle of a bucket. */
static uint64_t value_of(uint32_t bucket) {
    if (bucket < 2 * LW_HISTOGRAM_PARTS) return bucket;
    uint32_t shift = bucket / LW_HISTOGRAM_PARTS - 1;
    uint64_t part = bucket - LW_HISTOGRAM_PARTS * shift;
    return (part << shift) + ((1ull << shift) >> 1);
}

void lw_histogram_add(struct lw_histogram *h, uint64_t value) {
    if (h->count == 0 || value < h->min) h->min = value;
    if (value > h->max) h->max = value;
    h->count++;
    h->sum += (double)value;
    h->bucket[bucket_of(value)]++;
}

uint64_t lw_histogram_quantile(const struct lw_histogram *h, double q) {
    if (h->count == 0) return 0;
    if (!(q > 0)) return h->min;
    if (q >= 1) return h->max;
    /* 0.07 of 100 values are 7, though the product is a little more */
    uint64_t rank = (uint64_t)ceil(q * (double)h->count * (1 - 1e-12)), seen = 0;
    for (uint32_t b = 0; b < LW_HISTOGRAM_BUCKETS; b++) {
        seen += h->bucket[b];
        if (seen < rank) continue;
        uint64_t value = value_of(b);
        return value < h->min ? h->min : value > h->max ? h->max : value;
    }
    return h->max;
}

double lw_histogram_mean(const struct lw_histogram *h) { return h->count ? h->sum / (double)h->count : 0; }
