/* unit_vector.h: directions for tests of light, evenly over the sphere. */
#ifndef LW_TESTS_UNIT_VECTOR_H
#define LW_TESTS_UNIT_VECTOR_H

#include "common/base/random.h"
#include "common/base/vec.h"

static inline struct lw_vec3 lw_support_unit_vector(uint32_t seed) {
    float u[2];
    lw_random_sobol2(seed, 9, u);
    const float z = 1 - 2 * u[0], radius = sqrtf(fmaxf(1 - z * z, 0)), angle = 2 * LW_PI * u[1];
    return lw_vec3(radius * cosf(angle), radius * sinf(angle), z);
}

#endif
