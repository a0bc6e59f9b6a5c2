/* gl_rgb9e5.h: light as textures of GL_RGB9_E5 hold it.
 * Threads: pure functions, [any]. */
#ifndef LW_CLIENT_GL_RGB9E5_H
#define LW_CLIENT_GL_RGB9E5_H

#include <stdint.h>

/** Linear RGB times `scale` to GL_UNSIGNED_INT_5_9_9_9_REV, nearest. Negative values and NaN become 0,
 * too large ones the largest. */
uint32_t lw_gl_rgb9e5_pack(const float rgb[3], float scale);

#endif
