#include "server/solve/burial.h"

#include "common/progress.h"
#include "server/solve/sampling.h"

#include <stdlib.h>

/* A texel is buried when what it sees is backs, all but one ray of these, and near ones: a roof that is only modelled
 * from outside shows its back to the floor below, but a lamp may hang in between. */
#define RAYS        8
#define BURIED_RAYS 7
#define NEAR        0.1f /* of the scene's longest side */

static struct lw_vec3 load(float *const src[3], uint32_t i) {
    return lw_vec3(src[0][i], src[1][i], src[2][i]);
}

/* Sixteen texels in a row, one direction after the other. Returns the mask of the buried ones. */
static uint16_t find_in_row(const struct lw_mesh_texels *mesh, const struct lw_affine *to_world,
                            const struct lw_trace *trace, const bool *moves, const struct lw_scene *scene,
                            float near_m, uint32_t first, uint16_t active) {
    int backs[LW_TRACE_WIDTH] = {0};
    struct lw_ray16 rays = {.salt = 0};
    for (uint32_t r = 0; r < RAYS; r++) {
        float point[2];
        lw_random_sobol2(r, 0, point);
        struct lw_vec3 local = lw_sampling_cosine(point);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
            rays.t_near[lane] = 0;
            rays.t_far[lane] = near_m;
            if (!(active >> lane & 1)) continue;
            struct lw_vec3 normal = lw_affine_normal(to_world, load(mesh->geometric, first + lane));
            struct lw_vec3 p =
                lw_sampling_lift(lw_affine_point(to_world, load(mesh->position, first + lane)), normal);
            struct lw_vec3 d = lw_sampling_to_frame(normal, local);
            rays.org_x[lane] = p.x;
            rays.org_y[lane] = p.y;
            rays.org_z[lane] = p.z;
            rays.dir_x[lane] = d.x;
            rays.dir_y[lane] = d.y;
            rays.dir_z[lane] = d.z;
        }
        struct lw_hit16 hits;
        lw_trace_closest16(trace, LW_TRACE_COHERENT, active, &rays, &hits);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
            if (!(active >> lane & 1) || hits.object[lane] == LW_TRACE_MISS || !hits.back[lane]) continue;
            const struct lw_mesh *hit = &scene->mesh[scene->object[hits.object[lane]].mesh];
            backs[lane] += !moves[hits.object[lane]] &&
                           !scene->material[hit->material[hits.triangle[lane]]].double_sided;
        }
    }
    uint16_t buried = 0;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (active >> lane & 1 && backs[lane] >= BURIED_RAYS) buried |= (uint16_t)(1u << lane);
    return buried;
}

static uint64_t find_in_object(struct lw_texels *texels, uint32_t object, const struct lw_pose *pose,
                               const struct lw_trace *trace, const bool *moves, float near_m) {
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[object].mesh];
    uint8_t *covered = texels->covered + texels->first[object];
    uint64_t count = 0;
    for (uint32_t first = 0; first < mesh->texel_count; first += LW_TRACE_WIDTH) {
        uint16_t active = 0;
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH && first + lane < mesh->texel_count; lane++)
            if (covered[first + lane]) active |= (uint16_t)(1u << lane);
        if (!active) continue;
        uint16_t buried = find_in_row(mesh, &pose->object_to_world[object], trace, moves, texels->scene,
                                      near_m, first, active);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
            if (buried >> lane & 1) covered[first + lane] = 0;
        count += (uint64_t)__builtin_popcount(buried);
    }
    return count;
}

uint64_t lw_burial_find(struct lw_texels *texels, const struct lw_pose *pose, const struct lw_trace *trace,
                        int threads) {
    const uint32_t objects = texels->scene->object_count;
    bool *moves = calloc((size_t)objects + 1, sizeof *moves);
    uint64_t count = 0;
    struct lw_vec3 low = {0}, high = {0};
    lw_pose_bounds(pose, texels->scene, &low, &high);
    struct lw_vec3 size = lw_vec3_sub(high, low);
    const float near_m = NEAR * fmaxf(size.x, fmaxf(size.y, size.z));
    if (!moves) return 0; /* a refinement: without it the light is right but for dark rims */
    for (uint32_t o = 0; o < objects; o++) moves[o] = lw_pose_object_moves(pose, texels->scene, o);
    struct lw_progress progress;
    lw_progress_init(&progress, "looking inside objects", objects);
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads) reduction(+ : count)
    for (uint32_t o = 0; o < objects; o++) {
        if (!moves[o]) count += find_in_object(texels, o, pose, trace, moves, near_m);
        lw_progress_step(&progress, 1);
    }
    lw_progress_finish(&progress);
    free(moves);
    if (count) lw_texels_link(texels, threads);
    return count;
}
