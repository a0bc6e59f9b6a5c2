#include "common/light/spherical_triangle.h"

/* Unit, or as it is where it has no length. */
static struct lw_vec3 unit(struct lw_vec3 p) {
    float square = lw_vec3_dot(p, p);
    return square > 0 ? lw_vec3_scale(p, 1 / sqrtf(square)) : p;
}

struct lw_spherical_triangle lw_spherical_triangle(struct lw_vec3 a, struct lw_vec3 b, struct lw_vec3 c) {
    struct lw_spherical_triangle t = {.a = unit(a), .b = unit(b), .c = unit(c)};
    /* a . (b x c) of neighbouring unit vectors: their differences have more digits */
    float sine = fabsf(lw_vec3_dot(t.a, lw_vec3_cross(lw_vec3_sub(t.b, t.a), lw_vec3_sub(t.c, t.a))));
    float cosine = 1 + lw_vec3_dot(t.a, t.b) + lw_vec3_dot(t.b, t.c) + lw_vec3_dot(t.c, t.a);
    t.sr = sine > 0 ? 2 * atan2f(sine, cosine) : 0;
    return t;
}

/* The point on the arc from p to q whose scalar product with p is `cosine`; `sine2` is 1 - cosine^2. */
static struct lw_vec3 on_arc(struct lw_vec3 p, struct lw_vec3 q, float cosine, float sine2) {
    /* what of q is perpendicular to p, from their difference */
    struct lw_vec3 d = lw_vec3_sub(q, p), aside = unit(lw_vec3_mad(d, p, -lw_vec3_dot(d, p)));
    return lw_vec3_mad(lw_vec3_scale(p, cosine), aside, sqrtf(fmaxf(0, sine2)));
}

struct lw_vec3 lw_spherical_triangle_sample(const struct lw_spherical_triangle *triangle, float u, float v) {
    const struct lw_vec3 a = triangle->a, b = triangle->b, c = triangle->c;
    /* The angle at a, between the planes of ab and ac. */
    struct lw_vec3 ab = unit(lw_vec3_cross(a, lw_vec3_sub(b, a))),
                   ac = unit(lw_vec3_cross(a, lw_vec3_sub(c, a)));
    float cos_a = lw_vec3_dot(ab, ac), sin_a = lw_vec3_length(lw_vec3_cross(ab, ac));

    /* A point c' of the side ac such that the triangle a, b, c' has u of the area. */
    float part = u * triangle->sr, sin_part = sinf(part), cos_part = cosf(part);
    float s = sin_part * cos_a - cos_part * sin_a, t = cos_part * cos_a + sin_part * sin_a;
    float k = t - cos_a, l = s + sin_a * lw_vec3_dot(a, b);
    float over = (l * t - k * s) * cos_a - l, under = (l * s + k * t) * sin_a;
    float q = under != 0 ? fminf(fmaxf(over / under, -1), 1) : 1; /* cosine of the arc from a to c' */
    struct lw_vec3 c_part = on_arc(a, c, q, (1 - q) * (1 + q));

    /* Along the arc from b to c', even in area: z = 1 - v (1 - c' . b), and 1 - c' . b is half their distance
     * squared. */
    struct lw_vec3 chord = lw_vec3_sub(c_part, b);
    float below = 0.5f * v * lw_vec3_dot(chord, chord);
    return unit(on_arc(b, c_part, 1 - below, below * (2 - below)));
}
