#include "server/solve/burial.h"

#include "common/progress.h"
#include "server/solve/sampling.h"

/* A texel is buried when what it sees is backs, all but one ray of these, and near ones: a roof that is only modelled
 * from outside shows its back to the floor below, but a lamp may hang in between. */
#define RAYS        8
#define BURIED_RAYS 7
#define NEAR        0.1f /* of the scene's longest side */

struct search {
    struct lw_texels *texels;
    const struct lw_pose *pose;
    const struct lw_trace *trace;
    float near_m;
};

static bool buries(const struct search *s, const struct lw_hit16 *hits, uint32_t lane) {
    const uint32_t object = hits->object[lane];
    if (object == LW_TRACE_MISS || !hits->back[lane]) return false;
    const struct lw_scene *scene = s->texels->scene;
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    return !lw_pose_object_moves(s->pose, scene, object) &&
           !scene->material[mesh->material[hits->triangle[lane]]].double_sided;
}

/* Sixteen texels in a row, one direction after the other. Returns the mask of the buried ones. */
static uint16_t find_in_row(const struct search *s, const struct lw_mesh_texels *mesh,
                            const struct lw_affine *to_world, uint32_t first, uint16_t active) {
    int backs[LW_TRACE_WIDTH] = {0};
    struct lw_ray16 rays = {.salt = 0};
    for (uint32_t r = 0; r < RAYS; r++) {
        float point[2];
        lw_random_sobol2(r, 0, point);
        struct lw_vec3 local = lw_sampling_cosine(point);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
            if (!(active >> lane & 1)) continue;
            struct lw_vec3 normal =
                lw_affine_normal(to_world, lw_texels_vector(mesh->geometric, first + lane));
            struct lw_vec3 p = lw_affine_point(to_world, lw_texels_vector(mesh->position, first + lane));
            lw_trace_set_ray(&rays, lane, lw_sampling_lift(p, normal), lw_sampling_to_frame(normal, local),
                             s->near_m);
        }
        struct lw_hit16 hits;
        lw_trace_closest16(s->trace, LW_TRACE_COHERENT, active, &rays, &hits);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
            if (active >> lane & 1) backs[lane] += buries(s, &hits, lane);
    }
    uint16_t buried = 0;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (active >> lane & 1 && backs[lane] >= BURIED_RAYS) buried |= (uint16_t)(1u << lane);
    return buried;
}

static uint64_t find_in_object(const struct search *s, uint32_t object) {
    const struct lw_mesh_texels *mesh = &s->texels->mesh[s->texels->scene->object[object].mesh];
    uint8_t *covered = s->texels->covered + s->texels->first[object];
    uint64_t count = 0;
    for (uint32_t first = 0; first < mesh->texel_count; first += LW_TRACE_WIDTH) {
        uint16_t active = 0;
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH && first + lane < mesh->texel_count; lane++)
            if (covered[first + lane]) active |= (uint16_t)(1u << lane);
        if (!active) continue;
        uint16_t buried = find_in_row(s, mesh, &s->pose->object_to_world[object], first, active);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
            if (buried >> lane & 1) covered[first + lane] = 0;
        count += (uint64_t)__builtin_popcount(buried);
    }
    return count;
}

uint64_t lw_burial_find(struct lw_texels *texels, const struct lw_pose *pose, const struct lw_trace *trace,
                        int threads) {
    const uint32_t objects = texels->scene->object_count;
    uint64_t count = 0;
    struct lw_vec3 low = {0}, high = {0};
    lw_pose_bounds(pose, texels->scene, &low, &high);
    struct lw_vec3 size = lw_vec3_sub(high, low);
    const struct search search = {.texels = texels,
                                  .pose = pose,
                                  .trace = trace,
                                  .near_m = NEAR * fmaxf(size.x, fmaxf(size.y, size.z))};
    struct lw_progress progress;
    lw_progress_init(&progress, "looking inside objects", objects);
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads) reduction(+ : count)
    for (uint32_t o = 0; o < objects; o++) {
        if (!lw_pose_object_moves(pose, texels->scene, o)) count += find_in_object(&search, o);
        lw_progress_step(&progress, 1);
    }
    lw_progress_finish(&progress);
    if (count) lw_texels_link(texels, threads);
    return count;
}
