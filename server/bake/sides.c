#include "server/bake/sides.h"

#include "common/base/union_find.h"
#include "common/trace/trace.h"

#include <stdlib.h>

/* ---- what cameras see ---- */

static bool has_back(const struct lw_scene *scene, uint32_t object) {
    return !lw_scene_is_spare(scene, object) && scene->mesh[scene->object[object].mesh].back_offset > 0;
}

/* Where each object's counters begin. Returns their number; 0: there is nothing to count. */
static uint64_t place_counters(struct lw_sides *sides) {
    uint64_t count = 0;
    for (uint32_t o = 0; o < sides->scene->object_count; o++) {
        sides->first[o] = count;
        if (has_back(sides->scene, o))
            count += sides->scene->mesh[sides->scene->object[o].mesh].triangle_count;
    }
    return count <= LW_SIDES_COUNTED_MAX ? count : 0;
}

static void count_hits(struct lw_sides *sides, const struct lw_trace *trace, const struct lw_ray16 *rays,
                       uint16_t active) {
    struct lw_hit16 hits;
    lw_trace_closest16(trace, LW_TRACE_VIEW, active, rays, &hits);
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++)
        if (active >> i & 1 && hits.object[i] != LW_TRACE_MISS && has_back(sides->scene, hits.object[i]))
            sides->seen[sides->first[hits.object[i]] + hits.triangle[i]][hits.back[i] != 0]++;
}

/* Directions all around: a spiral of equal areas, after Vogel 1979. */
static struct lw_vec3 direction(uint32_t i, uint32_t count) {
    const double golden = 2.399963229728653, y = 1 - (2.0 * i + 1) / count, r = sqrt(1 - y * y);
    return lw_vec3((float)(r * cos(golden * i)), (float)y, (float)(r * sin(golden * i)));
}

static void trace_from(struct lw_sides *sides, const struct lw_trace *trace, struct lw_vec3 eye,
                       uint32_t count) {
    struct lw_ray16 rays = {0};
    for (uint32_t i = 0; i < count; i += LW_TRACE_WIDTH) {
        uint16_t active = 0;
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH && i + lane < count; lane++) {
            lw_trace_set_ray(&rays, lane, eye, direction(i + lane, count), INFINITY);
            active |= (uint16_t)(1u << lane);
        }
        count_hits(sides, trace, &rays, active);
    }
}

enum lw_status lw_sides_init(struct lw_sides *sides, const struct lw_scene *scene, const struct lw_pose *pose,
                             enum lw_sides_choice choice, struct lw_error *err) {
    struct lw_trace *trace;
    *sides = (struct lw_sides){.scene = scene, .choice = choice};
    const uint32_t cameras =
        scene->camera_count < LW_SIDES_CAMERAS_MAX ? scene->camera_count : LW_SIDES_CAMERAS_MAX;
    if (choice != LW_SIDES_AUTO || cameras == 0) return LW_OK;
    sides->first = calloc((size_t)scene->object_count + 1, sizeof *sides->first);
    if (!sides->first) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    const uint64_t count = place_counters(sides);
    if (!count) return LW_OK;
    sides->seen = calloc(count, sizeof *sides->seen);
    if (!sides->seen) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    enum lw_status status = lw_trace_create(scene, pose, &trace, err);
    if (status) return status;
    for (uint32_t c = 0; c < cameras; c++) {
        const struct lw_affine *place = &pose->node_to_world[scene->camera[c].node];
        trace_from(sides, trace, lw_vec3(place->m[0][3], place->m[1][3], place->m[2][3]),
                   LW_SIDES_RAYS / cameras);
    }
    lw_trace_destroy(trace);
    return LW_OK;
}

void lw_sides_finish(struct lw_sides *sides) {
    free(sides->first);
    free(sides->seen);
    *sides = (struct lw_sides){0};
}

/* ---- one object ---- */

struct chart {
    double area, light[2], hits[2];
    bool no_back; /* a triangle of it is single-sided */
};

static double luminance_at(const struct lw_map *map, float x, float y) {
    const float last_x = (float)map->width - 1, last_y = (float)map->height - 1;
    const uint32_t i = (uint32_t)fminf(fmaxf(x, 0), last_x), j = (uint32_t)fminf(fmaxf(y, 0), last_y);
    const float *p = map->rgba + ((size_t)j * map->width + i) * 4;
    return 0.2126 * (double)p[0] + 0.7152 * (double)p[1] + 0.0722 * (double)p[2];
}

static double area_of(const struct lw_mesh *mesh, const uint32_t v[3]) {
    const struct lw_vec3 a = mesh->position[v[0]];
    return 0.5 * (double)lw_vec3_length(lw_vec3_cross(lw_vec3_sub(mesh->position[v[1]], a),
                                                      lw_vec3_sub(mesh->position[v[2]], a)));
}

/* The mean light over a triangle, on one side, from points in a grid of barycentrics. */
static double mean_light(const struct lw_map *map, const struct lw_mesh *mesh, const uint32_t v[3],
                         uint32_t rows_down) {
    enum { STEPS = 4 };
    const struct lw_vec2 *uv = mesh->lightmap_uv;
    double sum = 0;
    unsigned count = 0;
    for (int i = 0; i < STEPS; i++)
        for (int j = 0; i + j < STEPS; j++, count++) {
            const float a = ((float)i + 1.0f / 3) / STEPS, b = ((float)j + 1.0f / 3) / STEPS, c = 1 - a - b;
            sum += luminance_at(map, c * uv[v[0]].x + a * uv[v[1]].x + b * uv[v[2]].x,
                                c * uv[v[0]].y + a * uv[v[1]].y + b * uv[v[2]].y + (float)rows_down);
        }
    return sum / count;
}

static void measure(const struct lw_sides *sides, const struct lw_map *map, const struct lw_mesh *mesh,
                    uint32_t *set, struct chart *chart) {
    for (uint32_t i = 0; i < mesh->vertex_count; i++) set[i] = i;
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        for (int k = 1; k < 3; k++) lw_union_find_join(set, mesh->triangle[t][0], mesh->triangle[t][k]);
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t *v = mesh->triangle[t];
        struct chart *c = &chart[lw_union_find_root(set, v[0])];
        const double area = area_of(mesh, v);
        c->no_back |= !sides->scene->material[mesh->material[t]].double_sided;
        c->area += area;
        for (uint32_t side = 0; side < 2; side++) {
            c->light[side] += area * mean_light(map, mesh, v, side ? map->back_offset : 0);
            if (sides->seen) c->hits[side] += sides->seen[sides->first[map->object] + t][side];
        }
    }
}

/* Whether a chart shows its back. *out_both: the other side matters too. */
static bool shows_back(const struct lw_sides *sides, const struct chart *c, bool *out_both) {
    *out_both = false;
    if (c->no_back) return false;
    const bool seen = c->hits[0] + c->hits[1] >= LW_SIDES_HITS_MIN;
    const double *by = seen ? c->hits : c->light;
    const bool back = sides->choice == LW_SIDES_AUTO ? by[1] > by[0] : sides->choice == LW_SIDES_BACK;
    *out_both = by[!back] > 0 && by[!back] >= LW_SIDES_SHARE_MIN * by[back];
    return back;
}

enum lw_status lw_sides_choose(const struct lw_sides *sides, const struct lw_map *map,
                               struct lw_sides_shown *out, struct lw_error *err) {
    const struct lw_mesh *mesh = &sides->scene->mesh[sides->scene->object[map->object].mesh];
    *out = (struct lw_sides_shown){0};
    if (!map->back_offset) return LW_OK;
    uint32_t *set = malloc((size_t)mesh->vertex_count * sizeof *set);
    struct chart *chart = calloc(mesh->vertex_count, sizeof *chart);
    out->back = calloc(mesh->vertex_count, 1);
    if (!set || !chart || !out->back) {
        free(set);
        free(chart);
        lw_sides_release(out);
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    }
    measure(sides, map, mesh, set, chart);
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        bool both;
        const struct chart *c = &chart[lw_union_find_root(set, i)];
        out->back[i] = shows_back(sides, c, &both);
        if (set[i] != i || c->no_back) continue; /* each chart once */
        out->total_m2 += c->area;
        if (out->back[i]) out->back_m2 += c->area;
        if (both) out->both_m2 += c->area;
    }
    free(set);
    free(chart);
    if (out->back_m2 > 0) return LW_OK;
    free(out->back);
    out->back = NULL;
    return LW_OK;
}

void lw_sides_release(struct lw_sides_shown *shown) {
    free(shown->back);
    *shown = (struct lw_sides_shown){0};
}

const char *lw_sides_name(const struct lw_sides_shown *shown) {
    if (!shown->back) return "front";
    return shown->back_m2 < shown->total_m2 ? "mixed" : "back";
}
