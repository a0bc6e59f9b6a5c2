#include "server/solve/surface/sample_points.h"

#include "common/base/invariant.h"
#include "common/base/wide.h"

#define LANES 16
/* An even number of steps, so that the six axes, which most walls face, are exact. */
#define NORMAL_STEPS    65534.0f
#define GEOMETRIC_STEPS 254.0f

/* An octahedral coordinate in [-1, 1] as an integer of 0..steps. */
static float quantise(float x, float steps) { return floorf((x * 0.5f + 0.5f) * steps + 0.5f); }

static struct lw_vec2 fold(struct lw_vec3 d) {
    float norm = fabsf(d.x) + fabsf(d.y) + fabsf(d.z), u = d.x / norm, v = d.y / norm;
    if (d.z >= 0) return (struct lw_vec2){u, v};
    return (struct lw_vec2){(1 - fabsf(v)) * copysignf(1, u), (1 - fabsf(u)) * copysignf(1, v)};
}

static struct lw_sample_points_packed pack(const struct lw_sample_points_point *point,
                                           struct lw_vec3 position, float reach) {
    const struct lw_vec2 n = fold(point->normal), g = fold(point->geometric);
    const struct lw_vec3 offset =
        lw_vec3_scale(lw_vec3_sub(point->origin, position), reach > 0 ? 32767 / reach : 0);
    const uint32_t x = (uint16_t)lrintf(offset.x), y = (uint16_t)lrintf(offset.y),
                   z = (uint16_t)lrintf(offset.z);
    return (struct lw_sample_points_packed){{x | y << 16, z | (uint32_t)quantise(n.x, NORMAL_STEPS) << 16,
                                             (uint32_t)quantise(n.y, NORMAL_STEPS) |
                                                 (uint32_t)quantise(g.x, GEOMETRIC_STEPS) << 16 |
                                                 (uint32_t)quantise(g.y, GEOMETRIC_STEPS) << 24}};
}

void lw_sample_points_pack(struct lw_sample_points *points, uint32_t texel, struct lw_vec3 position,
                           float largest, const struct lw_sample_points_point *point, uint32_t count) {
    float reach = 0;
    LW_INVARIANT(count > 0 && points->first[texel] + count == points->first[texel + 1]);
    for (uint32_t k = 0; k < count; k++) {
        struct lw_vec3 offset = lw_vec3_sub(point[k].origin, position);
        reach = fmaxf(reach, fmaxf(fabsf(offset.x), fmaxf(fabsf(offset.y), fabsf(offset.z))));
    }
    /* so small an offset has no inverse, and so large a one is no mesh's */
    if (!(reach > 1e-30f && reach < 1e30f)) reach = 0;
    for (uint32_t k = 0; k < count; k++)
        points->point[points->first[texel] + k] = pack(&point[k], position, reach);
    points->reach[texel] = reach;
    /* Each axis is rounded by half a step of reach / 32767: together by less than one. */
    points->lift[texel] = LW_TRACE_LIFT * largest + reach / 32767;
    LW_INVARIANT_DEAR(points->lift[texel] >= 0 && reach >= 0);
}

void lw_sample_points_frame_init(struct lw_sample_points_frame *frame, const struct lw_affine *t) {
    frame->to_world = *t;
    for (int c = 0; c < 3; c++) {
        const struct lw_vec3 axis = lw_vec3(c == 0, c == 1, c == 2), n = lw_affine_cofactor_normal(t, axis);
        frame->normal[0][c] = n.x;
        frame->normal[1][c] = n.y;
        frame->normal[2][c] = n.z;
    }
    /* Brought to a size whose squares floats hold, whatever the scale. */
    float size = 0;
    for (int i = 0; i < 9; i++) size = fmaxf(size, fabsf(frame->normal[i / 3][i % 3]));
    for (int i = 0; i < 9; i++)
        frame->normal[i / 3][i % 3] = size > 0 ? frame->normal[i / 3][i % 3] / size : (float)(i % 4 == 0);
    frame->stretch = lw_affine_stretch(t);
    frame->offset_m = fmaxf(fabsf(t->m[0][3]), fmaxf(fabsf(t->m[1][3]), fabsf(t->m[2][3])));
}

LW_WIDE void lw_sample_points_load(const struct lw_sample_points *points, float *const position[3],
                                   const uint32_t texel[restrict 16], const uint32_t point[restrict 16],
                                   struct lw_sample_points_lanes *restrict lanes) {
    const uint32_t *word = points->point->word;
    const float *reach = points->reach, *lift = points->lift;
    const float *x = position[0], *y = position[1], *z = position[2];
    for (int i = 0; i < LANES; i++) {
        const uint32_t a = word[point[i] * 3], b = word[point[i] * 3 + 1], c = word[point[i] * 3 + 2];
        const float step = reach[texel[i]] * (1.0f / 32767);
        lanes->at.x[i] = x[texel[i]] + step * (float)((int32_t)(a << 16) >> 16);
        lanes->at.y[i] = y[texel[i]] + step * (float)((int32_t)a >> 16);
        lanes->at.z[i] = z[texel[i]] + step * (float)((int32_t)(b << 16) >> 16);
        lanes->at.nx[i] = (float)(int32_t)(b >> 16);
        lanes->at.ny[i] = (float)(int32_t)(c & 0xffffu);
        lanes->gx[i] = (float)(int32_t)(c >> 16 & 0xffu);
        lanes->gy[i] = (float)(int32_t)(c >> 24);
        lanes->lift[i] = lift[texel[i]];
    }
}

/* Unfolds sixteen octahedral normals, turns them and makes them unit. */
LW_WIDE_INLINE void turn(const float m[3][3], float steps, float x[LANES], float y[LANES], float z[LANES]) {
    const float scale = 2 / steps;
    for (int i = 0; i < LANES; i++) {
        float u = x[i] * scale - 1, v = y[i] * scale - 1;
        float w = 1 - fabsf(u) - fabsf(v), over = w < 0 ? -w : 0;
        u -= copysignf(over, u);
        v -= copysignf(over, v);
        float a = m[0][0] * u + m[0][1] * v + m[0][2] * w;
        float b = m[1][0] * u + m[1][1] * v + m[1][2] * w;
        float c = m[2][0] * u + m[2][1] * v + m[2][2] * w;
        float inverse = 1.0f / sqrtf(a * a + b * b + c * c + 1e-37f);
        x[i] = a * inverse, y[i] = b * inverse, z[i] = c * inverse;
    }
}

LW_WIDE void lw_sample_points_to_world(const struct lw_sample_points_frame *frame,
                                       struct lw_sample_points_lanes *l) {
    const float(*m)[4] = frame->to_world.m;
    turn(frame->normal, NORMAL_STEPS, l->at.nx, l->at.ny, l->at.nz);
    turn(frame->normal, GEOMETRIC_STEPS, l->gx, l->gy, l->gz);
    for (int i = 0; i < LANES; i++) {
        float x = l->at.x[i], y = l->at.y[i], z = l->at.z[i],
              lift = lw_sample_points_lift_m(frame, l->lift[i]);
        l->at.x[i] = m[0][0] * x + m[0][1] * y + m[0][2] * z + m[0][3] + lift * l->gx[i];
        l->at.y[i] = m[1][0] * x + m[1][1] * y + m[1][2] * z + m[1][3] + lift * l->gy[i];
        l->at.z[i] = m[2][0] * x + m[2][1] * y + m[2][2] * z + m[2][3] + lift * l->gz[i];
    }
}
