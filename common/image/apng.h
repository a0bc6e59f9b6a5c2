/* apng.h: animated pictures for browsers: PNG with frames (APNG 1.0).
 * Flow:    8-bit pixels of frames -> [apng] -> file
 * Threads: [any]. */
#ifndef LW_COMMON_APNG_H
#define LW_COMMON_APNG_H

#include "common/base/status.h"

#include <stdint.h>

/** Writes frames of width x height 8-bit sRGB pixels, 3 bytes each, that repeat for ever; a viewer without
 * APNG shows the first.
 *
 * frame        frame_count pointers
 * frame_ms     how long each is shown; 1 to 65535
 * Errors       LW_USAGE: no frame, a side or time out of range; LW_CANNOT_CREATE or LW_IO naming the path;
 *              LW_NO_MEMORY.
 *              The file appears whole or not at all. */
LW_MUST_CHECK enum lw_status lw_apng_write(const char *path, const uint8_t *const *frame,
                                           uint32_t frame_count, uint32_t width, uint32_t height,
                                           uint32_t frame_ms, struct lw_error *err);

#endif
