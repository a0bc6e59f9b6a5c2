/* trace_context.h: the context that a packet carries through Embree to the filters. For this folder alone. */
#ifndef LW_COMMON_TRACE_CONTEXT_H
#define LW_COMMON_TRACE_CONTEXT_H

#include <embree3/rtcore.h>
#include <stdbool.h>

struct found; /* trace.c has it */

struct lw_trace_context {
    struct RTCIntersectContext rtc; /* first: filters get a pointer to it */
    unsigned flags;                 /* enum lw_trace_flags */
    const bool *left;               /* per object: rays do not meet it; NULL: they meet all */
    float (*tint)[16];   /* three rows of what passes, times what BLEND surfaces do to it; or NULL */
    struct found *found; /* 16, which note all hits: rays go on; or NULL */
};

#endif
