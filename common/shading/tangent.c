#include "common/shading/tangent.h"

#define STEPS 32768.0f

uint16_t lw_tangent_encode(struct lw_vec3 normal, struct lw_vec3 tangent, bool mirrored) {
    struct lw_vec3 t, b;
    lw_vec3_frame(normal, &t, &b);
    const float angle = atan2f(lw_vec3_dot(tangent, b), lw_vec3_dot(tangent, t)); /* 0 for none */
    const int step = (int)lrintf(angle * (STEPS / (2 * LW_PI)));
    return (uint16_t)(((unsigned)step & 0x7fffu) | (mirrored ? LW_TANGENT_MIRRORED : 0));
}

struct lw_vec4 lw_tangent_decode(uint16_t code, struct lw_vec3 normal) {
    struct lw_vec3 t, b;
    lw_vec3_frame(normal, &t, &b);
    const float angle = (float)(code & 0x7fffu) * (2 * LW_PI / STEPS);
    const struct lw_vec3 tangent = lw_vec3_mad(lw_vec3_scale(t, cosf(angle)), b, sinf(angle));
    return (struct lw_vec4){tangent.x, tangent.y, tangent.z, code & LW_TANGENT_MIRRORED ? -1.0f : 1.0f};
}
