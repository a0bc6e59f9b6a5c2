/* bench_jxl.h: JPEG XL through libjxl, for comparison alone; built where libjxl is installed.
 * Threads: one bench_jxl per thread. */
#ifndef LW_TESTS_BENCH_JXL_H
#define LW_TESTS_BENCH_JXL_H

#include "common/status.h"

#include <stdint.h>

struct bench_jxl;

LW_MUST_CHECK enum lw_status bench_jxl_create(struct bench_jxl **out_jxl);
void bench_jxl_destroy(struct bench_jxl *jxl);

/** width * height * 3 floats, 0 to 1 for the most part, as an sRGB picture. effort 1 (fast) to 9; distance: 0
 * lossless, 1 hardly seen. Errors: LW_INTERNAL, also if dst is too small. */
LW_MUST_CHECK enum lw_status bench_jxl_encode(struct bench_jxl *jxl, const float *rgb, uint32_t width,
                                              uint32_t height, int effort, float distance, uint8_t *dst,
                                              size_t dst_capacity, size_t *out_size);

/** The way back. Errors: LW_BAD_DATA. */
LW_MUST_CHECK enum lw_status bench_jxl_decode(struct bench_jxl *jxl, const uint8_t *src, size_t src_size,
                                              uint32_t width, uint32_t height, float *rgb);

#endif
