/* trace_context.h: the context that a packet carries through Embree to the filters. For this folder alone. */
#ifndef LW_COMMON_TRACE_CONTEXT_H
#define LW_COMMON_TRACE_CONTEXT_H

#include "common/trace/trace.h"

#include <embree3/rtcore.h>
#include <stdbool.h>

/* All hits of one ray, the closest first. */
#define LW_TRACE_FOUND_MAX 32u
struct lw_trace_found {
    uint32_t count; /* more than LW_TRACE_FOUND_MAX: there are more */
    struct lw_trace_met met[LW_TRACE_FOUND_MAX];
};

struct lw_trace_context {
    struct RTCIntersectContext rtc; /* first: filters get a pointer to it */
    unsigned flags;                 /* enum lw_trace_flags */
    const bool *left;               /* per object: rays do not meet it; NULL: they meet all */
    float (*tint)[16];            /* three rows of what passes, times what BLEND surfaces do to it; or NULL */
    struct lw_trace_found *found; /* 16, which note all hits: rays go on; or NULL */
};

#endif
