/* vec.h: small vectors and affine transforms.
 * Threads: pure functions, [any]. */
#ifndef LW_COMMON_BASE_VEC_H
#define LW_COMMON_BASE_VEC_H

#include <math.h>
#include <stdbool.h>

#define LW_PI 3.14159265358979323846f

struct lw_vec2 {
    float x, y;
};
struct lw_vec3 {
    float x, y, z;
};
struct lw_vec4 {
    float x, y, z, w;
};

/** Affine transform, row-major 3x4: p' = m[.][0..2] p + m[.][3]. */
struct lw_affine {
    float m[3][4];
};

#ifdef __cplusplus
#define LW_AFFINE_IDENTITY (lw_affine{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}})
#else
#define LW_AFFINE_IDENTITY ((struct lw_affine){{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}})
#endif

/** Twice the area of a triangle; negative where its corners run clockwise, with y upwards. */
static inline float lw_vec2_twice_area(struct lw_vec2 a, struct lw_vec2 b, struct lw_vec2 c) {
    return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

static inline struct lw_vec3 lw_vec3(float x, float y, float z) {
    const struct lw_vec3 v = {x, y, z};
    return v;
}
static inline struct lw_vec3 lw_vec3_add(struct lw_vec3 a, struct lw_vec3 b) {
    return lw_vec3(a.x + b.x, a.y + b.y, a.z + b.z);
}
static inline struct lw_vec3 lw_vec3_sub(struct lw_vec3 a, struct lw_vec3 b) {
    return lw_vec3(a.x - b.x, a.y - b.y, a.z - b.z);
}
static inline struct lw_vec3 lw_vec3_mul(struct lw_vec3 a, struct lw_vec3 b) {
    return lw_vec3(a.x * b.x, a.y * b.y, a.z * b.z);
}
static inline struct lw_vec3 lw_vec3_scale(struct lw_vec3 a, float s) {
    return lw_vec3(a.x * s, a.y * s, a.z * s);
}
/** a + b * s */
static inline struct lw_vec3 lw_vec3_mad(struct lw_vec3 a, struct lw_vec3 b, float s) {
    return lw_vec3(a.x + b.x * s, a.y + b.y * s, a.z + b.z * s);
}
static inline float lw_vec3_dot(struct lw_vec3 a, struct lw_vec3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
static inline struct lw_vec3 lw_vec3_cross(struct lw_vec3 a, struct lw_vec3 b) {
    return lw_vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static inline float lw_vec3_length(struct lw_vec3 a) { return sqrtf(lw_vec3_dot(a, a)); }
/** Unit vector; a vector too short to have a direction becomes +z. */
static inline struct lw_vec3 lw_vec3_normalize(struct lw_vec3 a) {
    float length = lw_vec3_length(a);
    return length > 1e-30f ? lw_vec3_scale(a, 1.0f / length) : lw_vec3(0, 0, 1);
}
/** The smaller, and the larger, of each component. */
static inline struct lw_vec3 lw_vec3_min(struct lw_vec3 a, struct lw_vec3 b) {
    return lw_vec3(fminf(a.x, b.x), fminf(a.y, b.y), fminf(a.z, b.z));
}
static inline struct lw_vec3 lw_vec3_max(struct lw_vec3 a, struct lw_vec3 b) {
    return lw_vec3(fmaxf(a.x, b.x), fmaxf(a.y, b.y), fmaxf(a.z, b.z));
}
/** The length of the component that is longest. */
static inline float lw_vec3_max_abs(struct lw_vec3 a) {
    return fmaxf(fabsf(a.x), fmaxf(fabsf(a.y), fabsf(a.z)));
}
static inline bool lw_vec3_is_finite(struct lw_vec3 a) {
    return isfinite(a.x) && isfinite(a.y) && isfinite(a.z);
}

static inline struct lw_vec3 lw_affine_point(const struct lw_affine *t, struct lw_vec3 p) {
    return lw_vec3(t->m[0][0] * p.x + t->m[0][1] * p.y + t->m[0][2] * p.z + t->m[0][3],
                   t->m[1][0] * p.x + t->m[1][1] * p.y + t->m[1][2] * p.z + t->m[1][3],
                   t->m[2][0] * p.x + t->m[2][1] * p.y + t->m[2][2] * p.z + t->m[2][3]);
}
static inline struct lw_vec3 lw_affine_vector(const struct lw_affine *t, struct lw_vec3 v) {
    return lw_vec3(t->m[0][0] * v.x + t->m[0][1] * v.y + t->m[0][2] * v.z,
                   t->m[1][0] * v.x + t->m[1][1] * v.y + t->m[1][2] * v.z,
                   t->m[2][0] * v.x + t->m[2][1] * v.y + t->m[2][2] * v.z);
}
/** A bound of how much longer it makes a vector. */
static inline float lw_affine_stretch(const struct lw_affine *t) {
    float most = 0;
    for (int r = 0; r < 3; r++) most = fmaxf(most, fabsf(t->m[r][0]) + fabsf(t->m[r][1]) + fabsf(t->m[r][2]));
    return most;
}
static inline float lw_affine_determinant(const struct lw_affine *t) {
    struct lw_vec3 x = lw_vec3(t->m[0][0], t->m[1][0], t->m[2][0]),
                   y = lw_vec3(t->m[0][1], t->m[1][1], t->m[2][1]),
                   z = lw_vec3(t->m[0][2], t->m[1][2], t->m[2][2]);
    return lw_vec3_dot(lw_vec3_cross(x, y), z);
}
/** Transforms a normal (inverse transpose, by cofactors), keeping it outward under mirroring. Its length is
 * that of n times the growth of area of a surface that n stands on. */
static inline struct lw_vec3 lw_affine_cofactor_normal(const struct lw_affine *t, struct lw_vec3 n) {
    struct lw_vec3 x = lw_vec3(t->m[0][0], t->m[1][0], t->m[2][0]),
                   y = lw_vec3(t->m[0][1], t->m[1][1], t->m[2][1]),
                   z = lw_vec3(t->m[0][2], t->m[1][2], t->m[2][2]);
    struct lw_vec3 yz = lw_vec3_cross(y, z), zx = lw_vec3_cross(z, x), xy = lw_vec3_cross(x, y);
    float sign = lw_vec3_dot(yz, x) < 0 ? -1.0f : 1.0f;
    return lw_vec3(sign * (yz.x * n.x + zx.x * n.y + xy.x * n.z),
                   sign * (yz.y * n.x + zx.y * n.y + xy.y * n.z),
                   sign * (yz.z * n.x + zx.z * n.y + xy.z * n.z));
}
/** The same, of unit length. */
static inline struct lw_vec3 lw_affine_normal(const struct lw_affine *t, struct lw_vec3 n) {
    return lw_vec3_normalize(lw_affine_cofactor_normal(t, n));
}
/** a after b: point(a*b, p) = point(a, point(b, p)). */
static inline struct lw_affine lw_affine_multiply(const struct lw_affine *a, const struct lw_affine *b) {
    struct lw_affine r;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 4; j++)
            r.m[i][j] = a->m[i][0] * b->m[0][j] + a->m[i][1] * b->m[1][j] + a->m[i][2] * b->m[2][j] +
                        (j == 3 ? a->m[i][3] : 0.0f);
    return r;
}

/** Two unit vectors that make a right-handed frame with unit n (Duff et al. 2017). */
static inline void lw_vec3_frame(struct lw_vec3 n, struct lw_vec3 *out_t, struct lw_vec3 *out_b) {
    float sign = copysignf(1.0f, n.z), a = -1.0f / (sign + n.z), b = n.x * n.y * a;
    *out_t = lw_vec3(1.0f + sign * n.x * n.x * a, sign * b, -sign * n.x);
    *out_b = lw_vec3(b, sign + n.y * n.y * a, -n.y);
}

#endif
