/* tangent.h: the tangent of a triangle's corner in 16 bits: where a normal map's u points.
 * Threads: pure functions, [any].
 *
 * A tangent is unit and at right angles to its corner's normal n, so that an angle says it. Bits 0 to 14:
 * 2^15 steps of the angle from t to b of lw_vec3_frame(n); bit 15: glTF's w is -1, not 1. */
#ifndef LW_COMMON_TANGENT_H
#define LW_COMMON_TANGENT_H

#include "common/base/vec.h"

#include <stdint.h>

#define LW_TANGENT_MIRRORED 0x8000u

/** normal: unit. tangent: any length; its part along the normal does not count. mirrored: w < 0. */
uint16_t lw_tangent_encode(struct lw_vec3 normal, struct lw_vec3 tangent, bool mirrored);

/** The tangent, unit, and glTF's w: the map's y is along w n x tangent. */
struct lw_vec4 lw_tangent_decode(uint16_t code, struct lw_vec3 normal);

#endif
