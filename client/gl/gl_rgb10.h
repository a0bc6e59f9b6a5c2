/* gl_rgb10.h: directions of light as textures of GL_RGB10_A2 hold them.
 * Threads: pure functions, [any]. */
#ifndef LW_CLIENT_GL_RGB10_H
#define LW_CLIENT_GL_RGB10_H

#include <math.h>
#include <stdint.h>

static inline uint32_t lw_gl_rgb10_of(float x) {
    const float inside = fminf(fmaxf(x, -1), 1); /* NaN is -1 */
    return (uint32_t)(inside * 511.5f + 512.0f);
}

/** Three numbers in [-1, 1] to GL_UNSIGNED_INT_2_10_10_10_REV, nearest; larger ones are cut off. A shader
 * reads x as 2 t - 1. */
static inline uint32_t lw_gl_rgb10_pack(const float xyz[3]) {
    return lw_gl_rgb10_of(xyz[0]) | lw_gl_rgb10_of(xyz[1]) << 10 | lw_gl_rgb10_of(xyz[2]) << 20;
}

#endif
