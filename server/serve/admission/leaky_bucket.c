#include "server/serve/admission/leaky_bucket.h"

#include "common/base/invariant.h"

#include <math.h>

bool lw_leaky_bucket_take(struct lw_leaky_bucket *bucket, double rate_hz, double burst, uint64_t now_ns) {
    const double elapsed_s = now_ns > bucket->as_of_ns ? 1e-9 * (double)(now_ns - bucket->as_of_ns) : 0;
    LW_INVARIANT(rate_hz > 0 && bucket->filled >= 0 && isfinite(bucket->filled));
    bucket->filled = fmax(bucket->filled - elapsed_s * rate_hz, 0);
    bucket->as_of_ns = now_ns;
    if (bucket->filled + 1 > burst) return false;
    bucket->filled += 1;
    return true;
}
