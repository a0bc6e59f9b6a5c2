/* points16.h: sixteen points of surfaces, structure of arrays.
 * Threads: values, [any]. */
#ifndef LW_COMMON_BASE_POINTS16_H
#define LW_COMMON_BASE_POINTS16_H

#include "common/base/vec.h"

struct lw_points16 {
    _Alignas(64) float x[16];
    float y[16], z[16];
    float nx[16], ny[16], nz[16]; /* shading normals, unit */
};

#endif
