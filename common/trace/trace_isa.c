#include "common/trace/trace_isa.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define VARIABLE "LW_TRACE_ISA"

/* Embree takes more names, and takes one that it does not know for SSE2, without a word. */
static const char *const choice[] = {"sse4.2", "avx2", "avx512"};

static bool is_choice(const char *name) {
    for (size_t i = 0; i < sizeof choice / sizeof *choice; i++)
        if (strcmp(name, choice[i]) == 0) return true;
    return false;
}

/* Embree tells the widest packet that it traces at once; sets of equal width differ by what the processor
 * has. */
const char *lw_trace_isa_of(RTCDevice device) {
#ifdef __x86_64__
    if (rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED)) return "avx512";
    if (rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED))
        return __builtin_cpu_supports("avx2") ? "avx2" : "avx";
    return __builtin_cpu_supports("sse4.2") ? "sse4.2" : "sse2";
#else
    (void)device;
    return "native";
#endif
}

enum lw_status lw_trace_isa_open(RTCDevice *out_device, struct lw_error *err) {
    const char *name = getenv(VARIABLE);
    char config[64];
    if (name && !*name) name = NULL;
    if (name && !is_choice(name))
        return lw_status_fail(err, LW_USAGE, VARIABLE ": \"%.40s\" is none of sse4.2, avx2, avx512", name);
    snprintf(config, sizeof config, "threads=1%s%s", name ? ",isa=" : "", name ? name : "");
    RTCDevice device = rtcNewDevice(config);
    if (!device) {
        if (rtcGetDeviceError(NULL) == RTC_ERROR_UNSUPPORTED_CPU)
            return lw_status_fail(err, LW_UNAVAILABLE,
                                  name ? VARIABLE ": this processor lacks %s"
                                       : "this processor lacks SSE2, which %s needs",
                                  name ? name : "Embree");
        return lw_status_fail(err, LW_NO_MEMORY, "starting Embree");
    }
    const char *taken = lw_trace_isa_of(device);
    if (name && strcmp(name, taken) != 0) {
        rtcReleaseDevice(device);
        return lw_status_fail(err, LW_INTERNAL, VARIABLE ": Embree took %s in place of %s", taken, name);
    }
    *out_device = device;
    return LW_OK;
}
