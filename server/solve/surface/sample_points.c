#include "server/solve/surface/sample_points.h"

#include "common/base/invariant.h"
#include "common/base/wide.h"
#include "server/solve/surface/packed_normal.h"

#include <stdlib.h>
#include <string.h>

#define LANES           16
#define NORMAL_STEPS    LW_PACKED_NORMAL_STEPS
#define GEOMETRIC_STEPS 254.0f /* even, as well */

/* A flat texel's points may lie beside their plane's by this share of its reach, and its normals differ from
 * the plane's by this much. */
#define FLAT_OFFSET 1e-3f
#define FLAT_NORMAL 1e-4f

/* Spots in 128ths of the square: x | y << 8. */
static const uint16_t spot_at[LW_SAMPLE_POINTS_SPOTS] = {
    0x0808, 0x4848, 0x6828, 0x2868, 0x5818, 0x1858, 0x3838, 0x7878, 0x7909, 0x3949, 0x1929, 0x5969, 0x2919,
    0x6959, 0x4939, 0x0979, 0x4505, 0x0545, 0x2525, 0x6565, 0x1515, 0x5555, 0x7535, 0x3575, 0x3d0d, 0x7d4d,
    0x5d2d, 0x1d6d, 0x6d1d, 0x2d5d, 0x0d3d, 0x4d7d, 0x6703, 0x2743, 0x0723, 0x4763, 0x3713, 0x7753, 0x5733,
    0x1773, 0x1f0b, 0x5f4b, 0x7f2b, 0x3f6b, 0x4f1b, 0x0f5b, 0x2f3b, 0x6f7b, 0x2307, 0x6347, 0x4327, 0x0367,
    0x7317, 0x3357, 0x1337, 0x5377, 0x5b0f, 0x1b4f, 0x3b2f, 0x7b6f, 0x0b1f, 0x4b5f, 0x6b3f, 0x2b7f};

struct lw_vec2 lw_sample_points_spot(uint32_t k) {
    return (struct lw_vec2){(float)(spot_at[k] & 0xffu) * (1.0f / 128),
                            (float)(spot_at[k] >> 8) * (1.0f / 128)};
}

/* An octahedral coordinate in [-1, 1] in 0..steps, and the integer next to it. */
static float in_steps(float x, float steps) { return (x * 0.5f + 0.5f) * steps; }
static float quantise(float x, float steps) { return floorf(in_steps(x, steps) + 0.5f); }

static struct lw_sample_points_packed pack(const struct lw_sample_points_point *point,
                                           struct lw_vec3 position, float reach) {
    const struct lw_vec2 n = lw_octahedron_fold(point->normal), g = lw_octahedron_fold(point->geometric);
    const struct lw_vec3 offset =
        lw_vec3_scale(lw_vec3_sub(point->origin, position), reach > 0 ? 32767 / reach : 0);
    const uint32_t x = (uint16_t)lrintf(offset.x), y = (uint16_t)lrintf(offset.y),
                   z = (uint16_t)lrintf(offset.z);
    return (struct lw_sample_points_packed){{x | y << 16, z | (uint32_t)quantise(n.x, NORMAL_STEPS) << 16,
                                             (uint32_t)quantise(n.y, NORMAL_STEPS) |
                                                 (uint32_t)quantise(g.x, GEOMETRIC_STEPS) << 16 |
                                                 (uint32_t)quantise(g.y, GEOMETRIC_STEPS) << 24}};
}

bool lw_sample_points_init(struct lw_sample_points *points, uint32_t texels) {
    *points = (struct lw_sample_points){.first = calloc(texels + 1ul, sizeof *points->first),
                                        .form = calloc(texels + 1ul, sizeof *points->form),
                                        .reach = calloc(texels + 1ul, sizeof *points->reach),
                                        .lift = calloc(texels + 1ul, sizeof *points->lift)};
    return points->first && points->form && points->reach && points->lift;
}

bool lw_sample_points_reserve(struct lw_sample_points *points, uint32_t texels) {
    return (points->spot = calloc(points->first[texels] + 1ul, sizeof *points->spot)) != NULL;
}

void lw_sample_points_finish(struct lw_sample_points *points) {
    free(points->first);
    free(points->form);
    free(points->spot);
    free(points->packed);
    free(points->plane);
    free(points->reach);
    free(points->lift);
    *points = (struct lw_sample_points){0};
}

size_t lw_sample_points_memory_bytes(const struct lw_sample_points *points, uint32_t texels) {
    if (!points->first) return 0;
    return texels *
               (sizeof *points->first + sizeof *points->form + sizeof *points->reach + sizeof *points->lift) +
           points->first[texels] * sizeof *points->spot + points->packed_count * sizeof *points->packed +
           points->plane_count * sizeof *points->plane;
}

/* Room for more elements: it doubles where it is full, at powers of two. */
static bool make_room(void *array, uint32_t count, uint32_t more, size_t size) {
    uint32_t capacity = 8;
    while (capacity < count) capacity *= 2;
    if (count && count + more <= capacity) return true;
    while (capacity < count + more) capacity *= 2;
    void *grown = realloc(*(void **)array, capacity * size);
    if (grown) *(void **)array = grown;
    return grown != NULL;
}

static void trim(void *array, size_t bytes) {
    void *trimmed = bytes ? realloc(*(void **)array, bytes) : NULL;
    if (trimmed) *(void **)array = trimmed;
}

void lw_sample_points_trim(struct lw_sample_points *points) {
    trim(&points->packed, points->packed_count * sizeof *points->packed);
    trim(&points->plane, points->plane_count * sizeof *points->plane);
}

/* Where a plane has a spot, from the middle of the square. */
static struct lw_vec3 place_spot(const struct lw_sample_points_plane *plane, uint32_t spot) {
    const struct lw_vec2 at = lw_sample_points_spot(spot);
    return lw_vec3_mad(lw_vec3_scale(plane->right, at.x - 0.5f), plane->down, at.y - 0.5f);
}

/* How far the points of a texel lie beside where a plane has them; INFINITY: it is not theirs. */
static float measure_offset(const struct lw_sample_points_plane *plane,
                            const struct lw_sample_points_texel *texel, float reach) {
    float most = 0;
    for (uint32_t k = 0; k < texel->count; k++) {
        const struct lw_sample_points_point *point = &texel->point[k];
        const struct lw_vec2 n = lw_octahedron_fold(point->normal), g = lw_octahedron_fold(point->geometric);
        if (!(fabsf(in_steps(n.x, NORMAL_STEPS) - plane->normal.x) <= FLAT_NORMAL * NORMAL_STEPS &&
              fabsf(in_steps(n.y, NORMAL_STEPS) - plane->normal.y) <= FLAT_NORMAL * NORMAL_STEPS &&
              fabsf(in_steps(g.x, GEOMETRIC_STEPS) - plane->geometric.x) <= FLAT_NORMAL * GEOMETRIC_STEPS &&
              fabsf(in_steps(g.y, GEOMETRIC_STEPS) - plane->geometric.y) <= FLAT_NORMAL * GEOMETRIC_STEPS))
            return INFINITY;
        const struct lw_vec3 at = lw_vec3_add(texel->position, place_spot(plane, point->spot));
        most = fmaxf(most, lw_vec3_max_abs(lw_vec3_sub(at, point->origin)));
    }
    return most <= FLAT_OFFSET * reach ? most : INFINITY;
}

/* Finds the plane of a texel's points, or makes one. Returns false without memory; *out_offset INFINITY: it
 * is not flat. */
static bool find_plane(struct lw_sample_points *points, const struct lw_sample_points_texel *texel,
                       float reach, uint32_t *out_plane, float *out_offset) {
    *out_offset = INFINITY;
    if (!texel->has_spots || !(reach > 0)) return true;
    for (int i = 0; i < 2; i++) {
        const uint32_t form = points->form[texel->near[i]];
        if (!(form & LW_SAMPLE_POINTS_FLAT)) continue;
        *out_plane = form & ~LW_SAMPLE_POINTS_FLAT;
        *out_offset = measure_offset(&points->plane[*out_plane], texel, reach);
        if (*out_offset < INFINITY) return true;
    }
    const struct lw_vec2 n = lw_octahedron_fold(texel->point[0].normal),
                         g = lw_octahedron_fold(texel->point[0].geometric);
    const struct lw_sample_points_plane plane = {
        .right = texel->right,
        .down = texel->down,
        .normal = {in_steps(n.x, NORMAL_STEPS), in_steps(n.y, NORMAL_STEPS)},
        .geometric = {in_steps(g.x, GEOMETRIC_STEPS), in_steps(g.y, GEOMETRIC_STEPS)}};
    *out_offset = measure_offset(&plane, texel, reach);
    if (!(*out_offset < INFINITY)) return true;
    if (!make_room(&points->plane, points->plane_count, 1, sizeof plane)) return false;
    *out_plane = points->plane_count;
    points->plane[points->plane_count++] = plane;
    return true;
}

static float find_reach(const struct lw_sample_points_texel *texel) {
    float reach = 0;
    for (uint32_t k = 0; k < texel->count; k++)
        reach = fmaxf(reach, lw_vec3_max_abs(lw_vec3_sub(texel->point[k].origin, texel->position)));
    /* so small an offset has no inverse, and so large a one is no mesh's */
    return reach > 1e-30f && reach < 1e30f ? reach : 0;
}

bool lw_sample_points_pack(struct lw_sample_points *points, uint32_t texel,
                           const struct lw_sample_points_texel *from) {
    const uint32_t first = points->first[texel];
    const uint16_t packed_reach = lw_packed_length(find_reach(from));
    const float reach = lw_packed_length_unpack(packed_reach);
    float lift = LW_TRACE_LIFT * from->largest;
    uint32_t plane = 0;
    float offset;
    LW_INVARIANT(from->count > 0 && first + from->count == points->first[texel + 1] &&
                 first >= points->packed_count);
    if (!find_plane(points, from, reach, &plane, &offset)) return false;
    LW_INVARIANT_DEAR(lift >= 0 && reach >= 0);
    /* Packing rounds each axis of an offset by half a step of reach / 32767: together by less than one. */
    lift += offset < INFINITY ? offset : reach / 32767;
    points->reach[texel] = packed_reach;
    points->lift[texel] = lw_packed_length(lift);
    if (offset < INFINITY) {
        points->form[texel] = LW_SAMPLE_POINTS_FLAT | plane;
        for (uint32_t k = 0; k < from->count; k++) points->spot[first + k] = from->point[k].spot;
        return true;
    }
    if (!make_room(&points->packed, points->packed_count, from->count, sizeof *points->packed)) return false;
    points->form[texel] = first - points->packed_count;
    for (uint32_t k = 0; k < from->count; k++)
        points->packed[points->packed_count++] = pack(&from->point[k], from->position, reach);
    return true;
}

bool lw_sample_points_take_planes(struct lw_sample_points *points, const struct lw_sample_points *from) {
    if (!make_room(&points->plane, 0, from->plane_count, sizeof *points->plane)) return false;
    if (from->plane_count) memcpy(points->plane, from->plane, from->plane_count * sizeof *points->plane);
    points->plane_count = from->plane_count;
    return true;
}

bool lw_sample_points_copy(struct lw_sample_points *points, uint32_t to, const struct lw_sample_points *from,
                           uint32_t i) {
    const uint32_t first = points->first[to], from_first = from->first[i],
                   count = from->first[i + 1] - from_first, form = from->form[i];
    points->first[to + 1] = first + count;
    points->reach[to] = from->reach[i];
    points->lift[to] = from->lift[i];
    memcpy(points->spot + first, from->spot + from_first, count);
    points->form[to] = form & LW_SAMPLE_POINTS_FLAT ? form : first - points->packed_count;
    if (form & LW_SAMPLE_POINTS_FLAT || !count) return true;
    if (!make_room(&points->packed, points->packed_count, count, sizeof *points->packed)) return false;
    memcpy(points->packed + points->packed_count, from->packed + (from_first - form),
           count * sizeof *points->packed);
    points->packed_count += count;
    return true;
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

/* Sixteen points of one plane. */
LW_WIDE static void load_flat(const struct lw_sample_points_plane *plane, const float *restrict x,
                              const float *restrict y, const float *restrict z,
                              const uint32_t texel[restrict LANES], const uint32_t spot[restrict LANES],
                              struct lw_sample_points_lanes *restrict lanes) {
    const struct lw_vec3 right = lw_vec3_scale(plane->right, 1.0f / 128),
                         down = lw_vec3_scale(plane->down, 1.0f / 128);
    for (int i = 0; i < LANES; i++) {
        const float u = (float)((int32_t)(spot[i] & 0xffu) - 64), v = (float)((int32_t)(spot[i] >> 8) - 64);
        lanes->at.x[i] = x[texel[i]] + (right.x * u + down.x * v);
        lanes->at.y[i] = y[texel[i]] + (right.y * u + down.y * v);
        lanes->at.z[i] = z[texel[i]] + (right.z * u + down.z * v);
        lanes->at.nx[i] = plane->normal.x;
        lanes->at.ny[i] = plane->normal.y;
        lanes->gx[i] = plane->geometric.x;
        lanes->gy[i] = plane->geometric.y;
    }
}

/* One point of any form. */
static void load_one(const struct lw_sample_points *points, struct lw_vec3 position, uint32_t texel,
                     uint32_t point, uint32_t i, struct lw_sample_points_lanes *lanes) {
    const uint32_t form = points->form[texel];
    struct lw_vec3 offset;
    if (form & LW_SAMPLE_POINTS_FLAT) {
        const struct lw_sample_points_plane *plane = &points->plane[form & ~LW_SAMPLE_POINTS_FLAT];
        offset = place_spot(plane, points->spot[point]);
        lanes->at.nx[i] = plane->normal.x;
        lanes->at.ny[i] = plane->normal.y;
        lanes->gx[i] = plane->geometric.x;
        lanes->gy[i] = plane->geometric.y;
    } else {
        const uint32_t *word = points->packed[point - form].word;
        const float step = lw_packed_length_unpack(points->reach[texel]) * (1.0f / 32767);
        offset =
            lw_vec3(step * (float)((int32_t)(word[0] << 16) >> 16), step * (float)((int32_t)word[0] >> 16),
                    step * (float)((int32_t)(word[1] << 16) >> 16));
        lanes->at.nx[i] = (float)(int32_t)(word[1] >> 16);
        lanes->at.ny[i] = (float)(int32_t)(word[2] & 0xffffu);
        lanes->gx[i] = (float)(int32_t)(word[2] >> 16 & 0xffu);
        lanes->gy[i] = (float)(int32_t)(word[2] >> 24);
    }
    lanes->at.x[i] = position.x + offset.x;
    lanes->at.y[i] = position.y + offset.y;
    lanes->at.z[i] = position.z + offset.z;
}

void lw_sample_points_load(const struct lw_sample_points *points, float *const position[3],
                           const uint32_t texel[16], const uint32_t point[16],
                           struct lw_sample_points_lanes *lanes) {
    const uint32_t form = points->form[texel[0]];
    uint32_t spot[LANES], differ = 0;
    for (int i = 0; i < LANES; i++) {
        differ |= points->form[texel[i]] ^ form;
        lanes->lift[i] = lw_packed_length_unpack(points->lift[texel[i]]);
    }
    if (differ || !(form & LW_SAMPLE_POINTS_FLAT)) {
        for (uint32_t i = 0; i < LANES; i++)
            load_one(points, lw_vec3(position[0][texel[i]], position[1][texel[i]], position[2][texel[i]]),
                     texel[i], point[i], i, lanes);
        return;
    }
    for (int i = 0; i < LANES; i++) spot[i] = spot_at[points->spot[point[i]]];
    load_flat(&points->plane[form & ~LW_SAMPLE_POINTS_FLAT], position[0], position[1], position[2], texel,
              spot, lanes);
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
