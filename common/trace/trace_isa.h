/* trace_isa.h: which instruction set the rays' kernels use. For this folder and lw_trace_isa() (trace.h).
 * Threads: [any]. */
#ifndef LW_COMMON_TRACE_ISA_H
#define LW_COMMON_TRACE_ISA_H

#include "common/base/status.h"

#include <embree3/rtcore.h>

/** Opens Embree's device with the instruction set that LW_TRACE_ISA in the environment names (sse4.2, avx2 or
 * avx512); without it, with the best that the processor has. Checks that Embree took the set that was asked
 * for. Uses one build thread, so that structure and results do not depend on timing.
 * Errors: LW_USAGE for a name that is none of the three; LW_UNAVAILABLE for a set that the processor lacks;
 * LW_NO_MEMORY; LW_INTERNAL where Embree takes another set. All name LW_TRACE_ISA where it is set. */
LW_MUST_CHECK enum lw_status lw_trace_isa_open(RTCDevice *out_device, struct lw_error *err);

/** The set that a device uses: "sse2", "sse4.2", "avx", "avx2", "avx512"; on other processors than x86-64
 * "native". */
const char *lw_trace_isa_of(RTCDevice device);

#endif
