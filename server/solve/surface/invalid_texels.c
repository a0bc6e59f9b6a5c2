#include "server/solve/surface/invalid_texels.h"

#include "common/light/direction.h"
#include "common/progress.h"
#include "server/solve/surface/crossings.h"
#include "server/solve/surface/hidden_points.h"

#include <stdlib.h>

#define NEAR 0.1f /* of the scene's longest side: how far backs hide what is not beside a wall */
/* Texels of an object that one thread searches: an object may have half of the scene. */
#define PART (8 * LW_HIDDEN_POINTS_TEXELS)

struct box {
    struct lw_vec3 low, high;
};

struct search {
    struct lw_texels *texels;
    struct lw_hidden_points_search points;
    /* where objects that have become movers stood; of a first look none */
    struct box *left;
    uint32_t left_count;
};

static bool has_lost_places(const struct lw_mesh_texels *mesh, uint32_t i, uint8_t usable) {
    return mesh->covered[i] && usable != lw_sample_points_all(&mesh->sample_points, i);
}

static void unbury(const struct lw_mesh_texels *mesh, uint32_t i, uint8_t *covered, uint8_t *usable) {
    *covered = 1;
    *usable = lw_sample_points_all(&mesh->sample_points, i);
}

/* Whether the straight line from p by d comes within a margin of the box. */
static bool meets(const struct box *box, float margin, struct lw_vec3 p, struct lw_vec3 d) {
    const float at[3] = {p.x, p.y, p.z}, by[3] = {d.x, d.y, d.z},
                low[3] = {box->low.x, box->low.y, box->low.z},
                high[3] = {box->high.x, box->high.y, box->high.z};
    float enter = 0, leave = 1;
    for (int c = 0; c < 3; c++) {
        const float inverse = 1 / (fabsf(by[c]) > 1e-30f ? by[c] : 1e-30f);
        const float a = (low[c] - margin - at[c]) * inverse, b = (high[c] + margin - at[c]) * inverse;
        enter = fmaxf(enter, fminf(a, b));
        leave = fminf(leave, fmaxf(a, b));
    }
    return enter <= leave;
}

/* Whether what is no longer there may have cut one of the object's charts. */
static bool may_be_joined(const struct search *s, uint32_t object, float size_m) {
    struct box own = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    const float margin = 2 * LW_HIDDEN_POINTS_CLEAR * size_m;
    lw_pose_object_bounds(s->points.pose, s->texels->scene, object, &own.low, &own.high);
    for (uint32_t k = 0; k < s->left_count; k++) {
        const struct box *left = &s->left[k];
        if (left->low.x - margin <= own.high.x && left->low.y - margin <= own.high.y &&
            left->low.z - margin <= own.high.z && left->high.x + margin >= own.low.x &&
            left->high.y + margin >= own.low.y && left->high.z + margin >= own.low.z)
            return true;
    }
    return false;
}

/* Whether what is no longer there may have been met from one of the texel's sample points: rays from
 * its middle stand for theirs. */
static bool may_be_freed(const struct search *s, uint32_t object, float size_m, uint32_t i) {
    const struct lw_mesh_texels *mesh = &s->texels->mesh[s->texels->scene->object[object].mesh];
    const struct lw_affine *to_world = &s->points.pose->object_to_world[object];
    const struct lw_vec3 p = lw_affine_point(to_world, lw_texels_vector(mesh->position, i)),
                         n = lw_affine_normal(to_world, lw_texels_vector(mesh->geometric, i));
    const float margin = 2 * size_m;
    for (uint32_t k = 0; k < s->left_count; k++) {
        const struct box *box = &s->left[k];
        if (meets(box, margin + LW_HIDDEN_POINTS_RIM * size_m, p, lw_vec3(0, 0, 0)) ||
            meets(box, margin, p, lw_vec3_scale(n, -s->points.near_m)))
            return true;
        for (uint32_t r = 0; r < LW_HIDDEN_POINTS_RAYS; r++) {
            const struct lw_vec3 d = lw_direction_about(n, lw_hidden_points_direction(r));
            if (meets(box, margin, p, lw_vec3_scale(d, s->points.far_m))) return true;
        }
    }
    return false;
}

static float texel_size(const struct search *s, uint32_t object) {
    struct lw_sample_points_frame frame;
    lw_sample_points_frame_init(&frame, &s->points.pose->object_to_world[object]);
    return s->texels->mesh[s->texels->scene->object[object].mesh].texel_m * frame.stretch;
}

/* Looks at some of an object's texels; returns how many of them are gone. */
static uint64_t find_in(const struct search *s, uint32_t object, const uint32_t *texel, uint32_t count) {
    uint8_t *covered = s->texels->covered + s->texels->first[object],
            *usable = s->texels->usable + s->texels->first[object], left[LW_HIDDEN_POINTS_TEXELS];
    uint64_t gone = 0;
    for (uint32_t k = 0; k < count; k++) left[k] = usable[texel[k]];
    lw_hidden_points_find(&s->points, object, texel, count, left);
    for (uint32_t k = 0; k < count; k++) {
        usable[texel[k]] = left[k];
        if (left[k]) continue;
        covered[texel[k]] = 0;
        gone++;
    }
    return gone;
}

/* Returns how many texels of an object, from `first` to before `end`, are gone. */
static uint64_t find_in_part(const struct search *s, uint32_t object, uint32_t first, uint32_t end) {
    const uint8_t *covered = s->texels->covered + s->texels->first[object];
    uint32_t texel[LW_HIDDEN_POINTS_TEXELS], count = 0;
    uint64_t gone = 0;
    for (uint32_t i = first; i < end; i++) {
        if (covered[i]) texel[count++] = i;
        if (count < LW_HIDDEN_POINTS_TEXELS && i + 1 < end) continue;
        gone += find_in(s, object, texel, count);
        count = 0;
    }
    return gone;
}

/* Tests those of an object's texels again that have lost a sample point; returns how many these are. */
static uint64_t find_again(const struct search *s, uint32_t object) {
    const struct lw_mesh_texels *mesh = &s->texels->mesh[s->texels->scene->object[object].mesh];
    uint8_t *covered = s->texels->covered + s->texels->first[object],
            *usable = s->texels->usable + s->texels->first[object];
    const float size_m = texel_size(s, object);
    uint32_t texel[LW_HIDDEN_POINTS_TEXELS], count = 0;
    uint64_t all = 0;
    for (uint32_t i = 0; i < mesh->texel_count; i++) {
        if (has_lost_places(mesh, i, usable[i]) && may_be_freed(s, object, size_m, i)) {
            unbury(mesh, i, &covered[i], &usable[i]);
            texel[count++] = i;
            all++;
        }
        if (count < LW_HIDDEN_POINTS_TEXELS && i + 1 < mesh->texel_count) continue;
        find_in(s, object, texel, count);
        count = 0;
    }
    return all;
}

static struct search begin(struct lw_texels *texels, const struct lw_pose *pose,
                           const struct lw_trace *trace) {
    struct lw_vec3 low = {0}, high = {0};
    lw_pose_bounds(pose, texels->scene, &low, &high);
    const struct lw_vec3 size = lw_vec3_sub(high, low);
    const float longest = fmaxf(size.x, fmaxf(size.y, size.z));
    return (struct search){
        .texels = texels,
        .points =
            {.texels = texels, .pose = pose, .trace = trace, .near_m = NEAR * longest, .far_m = 2 * longest},
    };
}

struct part {
    uint32_t object, first, end;
};

/* out_part: NULL, to count them. */
static uint32_t list_parts(const struct search *s, struct part *out_part) {
    uint32_t count = 0;
    for (uint32_t o = 0; o < s->texels->scene->object_count; o++) {
        const uint32_t texels = s->texels->mesh[s->texels->scene->object[o].mesh].texel_count;
        if (lw_pose_object_moves(s->points.pose, s->texels->scene, o)) continue;
        for (uint32_t first = 0; first < texels; first += PART, count++)
            if (out_part)
                out_part[count] = (struct part){o, first, texels - first < PART ? texels : first + PART};
    }
    return count;
}

enum lw_status lw_invalid_texels_find(struct lw_texels *texels, const struct lw_pose *pose,
                                      const struct lw_trace *trace, int threads, const _Atomic bool *cancel,
                                      struct lw_waiting *waiting, uint64_t *out_count) {
    const uint32_t objects = texels->scene->object_count;
    const struct search search = begin(texels, pose, trace);
    const uint32_t parts = list_parts(&search, NULL);
    struct part *part = malloc((parts + 1ul) * sizeof *part);
    if (!part) return LW_NO_MEMORY;
    list_parts(&search, part);
    uint64_t count = 0;
    int failures = 0;
    struct lw_progress progress;
    lw_progress_init_waiting(&progress, "looking inside objects", (uint64_t)parts + objects, waiting,
                             LW_WAITING_LOOKING_INSIDE);
#pragma omp parallel num_threads(threads) reduction(+ : count, failures)
    {
#pragma omp for schedule(dynamic, 1)
        for (uint32_t i = 0; i < parts; i++) {
            if (cancel && *cancel) continue;
            count += find_in_part(&search, part[i].object, part[i].first, part[i].end);
            lw_progress_step(&progress, 1);
        }
#pragma omp for schedule(dynamic, 1)
        for (uint32_t o = 0; o < objects; o++) {
            if (cancel && *cancel) continue;
            if (!lw_pose_object_moves(pose, texels->scene, o))
                failures += lw_crossings_find(texels, pose, trace, o, &count) != LW_OK;
            lw_progress_step(&progress, 1);
        }
    }
    free(part);
    if (cancel && *cancel) {
        lw_progress_stop(&progress);
        return LW_CLOSED;
    }
    lw_progress_finish(&progress);
    if (failures) return LW_NO_MEMORY;
    *out_count = count;
    return LW_OK;
}

static void unbury_all(struct lw_texels *texels, uint32_t object) {
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[object].mesh];
    const uint32_t first = texels->first[object];
    for (uint32_t i = 0; i < mesh->texel_count; i++)
        if (mesh->covered[i]) unbury(mesh, i, &texels->covered[first + i], &texels->usable[first + i]);
}

enum lw_status lw_invalid_texels_review(struct lw_texels *texels, const struct lw_pose *before,
                                        const struct lw_pose *pose, const struct lw_trace *trace,
                                        int threads) {
    const struct lw_scene *scene = texels->scene;
    struct search search = begin(texels, pose, trace);
    /* what an object inside it may have inside by rays as long as then */
    const struct search then = begin(texels, before, trace);
    search.points.near_m = fmaxf(search.points.near_m, then.points.near_m);
    search.points.far_m = fmaxf(search.points.far_m, then.points.far_m);
    search.left = malloc((scene->object_count + 1ul) * sizeof *search.left);
    if (!search.left) return LW_NO_MEMORY;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (!lw_pose_object_moves(pose, scene, o) || lw_pose_object_moves(before, scene, o)) continue;
        struct box *box = &search.left[search.left_count++];
        *box = (struct box){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
        lw_pose_object_bounds(before, scene, o, &box->low, &box->high);
        unbury_all(texels, o);
        lw_texels_forget_walls(texels, o);
        lw_texels_link_object(texels, o);
    }
    int failures = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads) reduction(+ : failures)
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (!search.left_count || lw_pose_object_moves(pose, scene, o)) continue;
        uint64_t yielding = 0;
        if (!find_again(&search, o) && !may_be_joined(&search, o, texel_size(&search, o))) continue;
        failures += lw_crossings_find(texels, pose, trace, o, &yielding) != LW_OK;
    }
    free(search.left);
    return failures ? LW_NO_MEMORY : LW_OK;
}
