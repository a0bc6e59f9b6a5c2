#include "tests/bench/bench_voxels.h"

#include "common/wide.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LANES 16
#define ROOM  1e-3f /* about the scene, of its longest side */
#define TOUCH 1e-3f /* of a cell: what is nearer than this overlaps it, so that rounding opens no hole */

LW_WIDE_INLINE int32_t clamp(float cell, int32_t side) {
    const int32_t whole = (int32_t)cell;
    return whole < 0 ? 0 : whole < side ? whole : side - 1;
}

/* ---- solid cells ---- */

/* Whether the axis has all corners on one side of a cube about 0. */
static bool separates(struct lw_vec3 axis, const struct lw_vec3 corner[3], float half) {
    const float a = lw_vec3_dot(axis, corner[0]), b = lw_vec3_dot(axis, corner[1]),
                c = lw_vec3_dot(axis, corner[2]);
    const float reach = half * (fabsf(axis.x) + fabsf(axis.y) + fabsf(axis.z));
    return fminf(a, fminf(b, c)) > reach || fmaxf(a, fmaxf(b, c)) < -reach;
}

static bool overlaps(const struct lw_vec3 triangle[3], struct lw_vec3 middle, float half) {
    const struct lw_vec3 unit[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    struct lw_vec3 corner[3], edge[3];
    for (int k = 0; k < 3; k++) corner[k] = lw_vec3_sub(triangle[k], middle);
    for (int k = 0; k < 3; k++) edge[k] = lw_vec3_sub(corner[(k + 1) % 3], corner[k]);
    if (separates(lw_vec3_cross(edge[0], edge[1]), corner, half)) return false;
    for (int c = 0; c < 3; c++) {
        if (separates(unit[c], corner, half)) return false;
        for (int k = 0; k < 3; k++)
            if (separates(lw_vec3_cross(unit[c], edge[k]), corner, half)) return false;
    }
    return true;
}

/* Cubes of 1, 2, 4... cells; what a triangle does not overlap is not divided. */
static void fill_cube(struct bench_voxels *v, const struct lw_vec3 triangle[3], const int32_t cube[3],
                      int32_t side) {
    const float half = (float)side / 2;
    const struct lw_vec3 middle =
        lw_vec3((float)cube[0] + half, (float)cube[1] + half, (float)cube[2] + half);
    for (int c = 0; c < 3; c++)
        if (cube[c] >= v->side[c]) return;
    if (!overlaps(triangle, middle, half + TOUCH)) return;
    if (side == 1) {
        const int32_t cell = cube[0] + cube[1] * v->stride[1] + cube[2] * v->stride[2];
        v->solid[cell >> 5] |= 1u << (cell & 31);
        return;
    }
    for (int k = 0; k < 8; k++) {
        const int32_t part[3] = {cube[0] + (k & 1) * side / 2, cube[1] + (k >> 1 & 1) * side / 2,
                                 cube[2] + (k >> 2) * side / 2};
        fill_cube(v, triangle, part, side / 2);
    }
}

/* From the smallest of these cubes that holds it. */
static void fill_triangle(struct bench_voxels *v, const struct lw_vec3 t[3]) {
    const float corner[3][3] = {{t[0].x, t[1].x, t[2].x}, {t[0].y, t[1].y, t[2].y}, {t[0].z, t[1].z, t[2].z}};
    int32_t first[3], last[3], level = 0;
    for (int c = 0; c < 3; c++) {
        const float *x = corner[c];
        first[c] = clamp(fminf(x[0], fminf(x[1], x[2])) - TOUCH, v->side[c]);
        last[c] = clamp(fmaxf(x[0], fmaxf(x[1], x[2])) + TOUCH, v->side[c]);
        while (first[c] >> level != last[c] >> level) level++;
    }
    for (int c = 0; c < 3; c++) first[c] = first[c] >> level << level;
    fill_cube(v, t, first, 1 << level);
}

static void fill(struct bench_voxels *v, const struct lw_scene *scene, const struct lw_pose *pose) {
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        for (uint32_t t = 0; t < mesh->triangle_count && !pose->object_hidden[o]; t++) {
            struct lw_vec3 corner[3];
            for (int k = 0; k < 3; k++) {
                const struct lw_vec3 at =
                    lw_affine_point(&pose->object_to_world[o], mesh->position[mesh->triangle[t][k]]);
                corner[k] = lw_vec3_scale(lw_vec3_sub(at, v->low), v->per_m);
            }
            fill_triangle(v, corner);
        }
    }
}

enum lw_status bench_voxels_init(struct bench_voxels *voxels, const struct bench_voxels_desc *desc,
                                 const struct lw_scene *scene, const struct lw_pose *pose,
                                 struct lw_error *err) {
    struct bench_voxels *v = voxels;
    struct lw_vec3 low = lw_vec3(INFINITY, INFINITY, INFINITY), high = lw_vec3_scale(low, -1);
    for (uint32_t o = 0; o < scene->object_count; o++)
        if (!pose->object_hidden[o]) lw_pose_object_bounds(pose, scene, o, &low, &high);
    if (!(high.x >= low.x)) return lw_status_fail(err, LW_BAD_DATA, "the scene is empty");
    const struct lw_vec3 size = lw_vec3_sub(high, low);
    const float longest = lw_vec3_max_abs(size), room = ROOM * longest + 1e-20f,
                size_of[3] = {size.x, size.y, size.z};
    *v = (struct bench_voxels){.desc = *desc,
                               .low = lw_vec3_sub(low, lw_vec3(room, room, room)),
                               .per_m = (float)desc->side / (longest + 2 * room)};
    size_t cells = 1;
    for (int c = 0; c < 3; c++) {
        v->stride[c] = (int32_t)cells;
        v->side[c] = 1 + clamp((size_of[c] + 2 * room) * v->per_m, desc->side);
        cells *= (size_t)v->side[c];
    }
    v->words = cells / 32 + 1;
    v->solid = calloc(v->words, sizeof *v->solid);
    if (!v->solid) return lw_status_fail(err, LW_NO_MEMORY, "a grid of %zu cells", cells);
    fill(v, scene, pose);
    return LW_OK;
}

void bench_voxels_finish(struct bench_voxels *voxels) {
    free(voxels->solid);
    *voxels = (struct bench_voxels){0};
}

/* ---- the march ---- */

/* Sixteen segments under way. */
struct walk {
    _Alignas(64) float next[3][LANES];                        /* share of a segment: up to the next border */
    float step[3][LANES];                                     /* from border to border */
    int32_t left[3][LANES], gone[3][LANES], stride[3][LANES]; /* borders; cells a border */
    int32_t cell[LANES], open[LANES];                         /* open: -1 while nothing has been in the way */
};

LW_WIDE_INLINE void start_axis(struct walk *restrict w, const struct bench_voxels *v, int c, float low,
                               const float at_ws[restrict LANES], const float normal[restrict LANES],
                               float to_ws, float to_normal) {
    const int32_t side = v->side[c], stride = v->stride[c];
    const float lift = v->desc.lift, per_m = v->per_m, to = (to_ws - low) * per_m + lift * to_normal;
    const int32_t last = clamp(to, side);
    for (int i = 0; i < LANES; i++) {
        const float from = (at_ws[i] - low) * per_m + lift * normal[i], way = to - from;
        const int32_t first = clamp(from, side), borders = last - first, ahead = borders > 0;
        const float next = ((float)(first + ahead) - from) / way;
        w->left[c][i] = borders > 0 ? borders : -borders;
        w->gone[c][i] = 0;
        w->stride[c][i] = borders > 0 ? stride : -stride;
        w->step[c][i] = fabsf(1 / way);
        w->next[c][i] = borders ? next : INFINITY;
        w->cell[i] += first * stride;
    }
}

/* A border of an axis, of the lanes of `by` (-1); far_end, far_start: -1 once or while an end is not near. */
LW_WIDE_INLINE void cross(struct walk *restrict w, int c, int i, int32_t by, int32_t skip, int32_t *far_end,
                          int32_t *far_start) {
    const float step = w->step[c][i], next = w->next[c][i] + (by ? step : 0);
    const int32_t left = w->left[c][i] + by, gone = w->gone[c][i] - by;
    w->next[c][i] = left > 0 ? next : INFINITY;
    w->left[c][i] = left;
    w->gone[c][i] = gone;
    w->cell[i] += by & w->stride[c][i];
    *far_end |= left > skip ? -1 : 0;
    *far_start |= gone > skip ? -1 : 0;
}

/* Over the nearest border of each segment that is open and not at its end. Returns 0 where there was none.
 * Without a branch, so that the compiler takes sixteen lanes at once. */
LW_WIDE_INLINE int32_t advance(struct walk *restrict w, const uint32_t *restrict solid, int32_t skip) {
    int32_t any = 0;
    for (int i = 0; i < LANES; i++) {
        const float x = w->next[0][i], y = w->next[1][i], z = w->next[2][i];
        const float xy = x < y ? x : y, least = xy < z ? xy : z;
        const int32_t left = w->left[0][i] + w->left[1][i] + w->left[2][i];
        const int32_t open = w->open[i], go = left > 0 ? open : 0;
        const int32_t by_x = x <= least ? go : 0, by_y = y <= least ? go & ~by_x : 0,
                      by_z = go & ~by_x & ~by_y;
        int32_t far_end = 0, far_start = 0;
        cross(w, 0, i, by_x, skip, &far_end, &far_start);
        cross(w, 1, i, by_y, skip, &far_end, &far_start);
        cross(w, 2, i, by_z, skip, &far_end, &far_start);
        const int32_t cell = w->cell[i], bit = (int32_t)(solid[cell >> 5] >> (cell & 31) & 1);
        w->open[i] = open & ~(-bit & far_end & far_start);
        any |= go;
    }
    return any;
}

LW_WIDE uint16_t bench_voxels_see(const struct bench_voxels *voxels, const struct lw_points16 *points,
                                  const float position[3], const float normal[3], uint16_t active) {
    const struct bench_voxels *v = voxels;
    struct walk w;
    uint16_t sees = 0;
    for (int i = 0; i < LANES; i++) w.cell[i] = 0, w.open[i] = -(active >> i & 1);
    start_axis(&w, v, 0, v->low.x, points->x, points->nx, position[0], normal[0]);
    start_axis(&w, v, 1, v->low.y, points->y, points->ny, position[1], normal[1]);
    start_axis(&w, v, 2, v->low.z, points->z, points->nz, position[2], normal[2]);
    while (advance(&w, v->solid, v->desc.skip)) {
    }
    for (int i = 0; i < LANES; i++) sees |= (uint16_t)((w.open[i] & 1) << i);
    return sees;
}
