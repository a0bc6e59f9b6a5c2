#include "server/solve/surface/invalid_texels.h"

#include "common/base/box.h"
#include "common/base/invariant.h"
#include "common/base/progress.h"
#include "common/light/direction.h"
#include "server/solve/surface/crossings.h"
#include "server/solve/surface/hidden_points.h"

#include <stdlib.h>
#include <string.h>

#define NEAR 0.1f /* how far backs hide points not beside a wall, over the scene's longest side */
/* Texels of an object that one thread searches: an object may have half of the scene. */
#define PART (8 * LW_HIDDEN_POINTS_TEXELS)

struct boxes {
    struct lw_box *box, all; /* each, and what holds them */
    uint32_t count;
};

struct search {
    struct lw_texels *texels;
    struct lw_hidden_points_search points;
    /* Boxes of objects that stand no longer, and of objects that stand now; in a first look none. first:
     * boxes in left of objects that stood from the first look: they may have hidden points far away. */
    struct boxes left, come, first;
};

static bool has_lost_places(const struct lw_mesh_texels *mesh, uint32_t i, uint8_t usable) {
    return usable != lw_sample_points_all(&mesh->sample_points, i);
}

static void unbury(const struct lw_mesh_texels *mesh, uint32_t i, uint8_t *covered, uint8_t *usable) {
    *covered = 1;
    *usable = lw_sample_points_all(&mesh->sample_points, i);
}

/* Whether the straight line from p by d comes within a margin of the box. */
static bool meets(const struct lw_box *box, float margin, struct lw_vec3 p, struct lw_vec3 d) {
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

/* Whether two boxes are that close. */
static bool touches(const struct lw_box *a, const struct lw_box *b, float margin) {
    return a->low.x - margin <= b->high.x && a->low.y - margin <= b->high.y &&
           a->low.z - margin <= b->high.z && a->high.x + margin >= b->low.x &&
           a->high.y + margin >= b->low.y && a->high.z + margin >= b->low.z;
}

static bool is_near(const struct boxes *boxes, float margin, const struct lw_box *what) {
    if (!boxes->count || !touches(&boxes->all, what, margin)) return false;
    for (uint32_t k = 0; k < boxes->count; k++)
        if (touches(&boxes->box[k], what, margin)) return true;
    return false;
}

/* An object that comes or goes may hide points, and part texels, within this distance. */
static float reach_of(float size_m) {
    return 2 * LW_HIDDEN_POINTS_CLEAR * size_m + LW_HIDDEN_POINTS_RIM * size_m;
}

/* Whether rays from one of the texel's sample points may have met an object that is gone: rays from its
 * middle stand for theirs. */
static bool may_be_freed(const struct search *s, uint32_t object, float size_m, uint32_t i) {
    const struct lw_mesh_texels *mesh = &s->texels->mesh[s->texels->scene->object[object].mesh];
    const struct lw_affine *to_world = &s->points.pose->object_to_world[object];
    const struct lw_vec3 p = lw_affine_point(to_world, lw_texels_vector(mesh->position, i)),
                         n = lw_affine_normal(to_world, lw_packed_normal_unpack(mesh->geometric[i]));
    const float margin = 2 * size_m;
    for (uint32_t k = 0; k < s->first.count; k++) {
        const struct lw_box *box = &s->first.box[k];
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
        LW_INVARIANT_DEAR(!(left[k] & ~usable[texel[k]])); /* points are lost alone */
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
    LW_INVARIANT(first < end && end <= s->texels->mesh[s->texels->scene->object[object].mesh].texel_count);
    for (uint32_t i = first; i < end; i++) {
        if (covered[i]) texel[count++] = i;
        if (count < LW_HIDDEN_POINTS_TEXELS && i + 1 < end) continue;
        gone += find_in(s, object, texel, count);
        count = 0;
    }
    return gone;
}

/* The texels of an object that are tested again: in some blocks, and some of them from the beginning. */
struct again {
    bool *block;      /* per block of level 0, row by row */
    uint8_t *texel;   /* per texel */
    uint8_t *covered; /* per texel, before */
    bool any;
};

static void again_finish(struct again *again) {
    free(again->block);
    free(again->texel);
    free(again->covered);
}

static bool again_init(struct again *again, const struct lw_mesh_texels *mesh, const uint8_t *covered) {
    *again = (struct again){
        .block =
            calloc((size_t)lw_texels_blocks_along(mesh->width) * lw_texels_blocks_along(mesh->height) + 1,
                   sizeof *again->block),
        .texel = calloc(mesh->texel_count + 1ul, 1),
        .covered = malloc(mesh->texel_count + 1ul)};
    if (again->covered) memcpy(again->covered, covered, mesh->texel_count);
    if (again->block && again->texel && again->covered) return true;
    again_finish(again);
    return false;
}

/* Chooses the texels near objects that have come or gone, and texels that these may have hidden. */
static void choose_again(const struct search *s, uint32_t object, struct again *again) {
    const struct lw_mesh_texels *mesh = &s->texels->mesh[s->texels->scene->object[object].mesh];
    const uint8_t *usable = s->texels->usable + s->texels->first[object];
    const struct lw_affine *to_world = &s->points.pose->object_to_world[object];
    const float size_m = texel_size(s, object), reach = reach_of(size_m);
    struct lw_box own = LW_BOX_EMPTY;
    lw_pose_object_bounds(s->points.pose, s->texels->scene, object, &own.low, &own.high);
    const bool near = is_near(&s->left, reach, &own) || is_near(&s->come, reach, &own);
    for (uint32_t y = 0; y < mesh->height; y++)
        for (uint32_t x = 0; x < mesh->width; x++) {
            const uint32_t i = lw_texels_index(mesh, x, y);
            if (!mesh->covered[i]) continue;
            const struct lw_vec3 p = lw_affine_point(to_world, lw_texels_vector(mesh->position, i));
            const struct lw_box point = {p, p};
            const bool came = near && is_near(&s->come, reach, &point),
                       left = near && is_near(&s->left, reach, &point),
                       lost = has_lost_places(mesh, i, usable[i]);
            again->texel[i] = came || (lost && (left || may_be_freed(s, object, size_m, i)));
            if (!again->texel[i] && !left) continue;
            again->block[y / LW_TILE_BLOCK * lw_texels_blocks_along(mesh->width) + x / LW_TILE_BLOCK] =
                again->any = true;
        }
}

/* Tests texels of an object from the beginning. which: 1: this texel; NULL: all. */
static void find_again(const struct search *s, uint32_t object, const uint8_t *which) {
    const struct lw_mesh_texels *mesh = &s->texels->mesh[s->texels->scene->object[object].mesh];
    uint8_t *covered = s->texels->covered + s->texels->first[object],
            *usable = s->texels->usable + s->texels->first[object];
    uint32_t texel[LW_HIDDEN_POINTS_TEXELS], count = 0;
    for (uint32_t i = 0; i < mesh->texel_count; i++) {
        if (mesh->covered[i] && (!which || which[i])) {
            unbury(mesh, i, &covered[i], &usable[i]);
            texel[count++] = i;
        }
        if (count < LW_HIDDEN_POINTS_TEXELS && i + 1 < mesh->texel_count) continue;
        find_in(s, object, texel, count);
        count = 0;
    }
}

struct lw_hidden_points_search lw_invalid_texels_points(const struct lw_texels *texels,
                                                        const struct lw_pose *pose,
                                                        const struct lw_trace *trace) {
    struct lw_vec3 low = {0}, high = {0};
    lw_pose_bounds(pose, texels->scene, &low, &high);
    const struct lw_vec3 size = lw_vec3_sub(high, low);
    const float longest = fmaxf(size.x, fmaxf(size.y, size.z));
    return (struct lw_hidden_points_search){
        .texels = texels, .pose = pose, .trace = trace, .near_m = NEAR * longest, .far_m = 2 * longest};
}

static struct search begin(struct lw_texels *texels, const struct lw_pose *pose,
                           const struct lw_trace *trace) {
    return (struct search){.texels = texels, .points = lw_invalid_texels_points(texels, pose, trace)};
}

struct part {
    uint32_t object, first, end;
};

/* out_part: NULL, to count them. */
static uint32_t list_parts(const struct search *s, struct part *out_part) {
    uint32_t count = 0;
    for (uint32_t o = 0; o < s->texels->scene->object_count; o++) {
        const uint32_t texels = s->texels->mesh[s->texels->scene->object[o].mesh].texel_count;
        if (!s->texels->stands[o]) continue;
        for (uint32_t first = 0; first < texels; first += PART, count++)
            if (out_part)
                out_part[count] = (struct part){o, first, texels - first < PART ? texels : first + PART};
    }
    return count;
}

/* Covered texels have surface, and points that light can reach. */
static bool are_lit(const struct lw_texels *texels) {
    for (uint32_t o = 0; o < texels->scene->object_count; o++) {
        const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[o].mesh];
        for (uint32_t i = 0; i < mesh->texel_count; i++)
            if (texels->covered[texels->first[o] + i] &&
                !(mesh->covered[i] && texels->usable[texels->first[o] + i]))
                return false;
    }
    return true;
}

enum lw_status lw_invalid_texels_find(struct lw_texels *texels, const struct lw_pose *pose,
                                      const bool *stands, const struct lw_trace *trace, int threads,
                                      const _Atomic bool *cancel, struct lw_waiting *waiting,
                                      uint64_t *out_count) {
    texels->stands = stands;
    const uint32_t objects = texels->scene->object_count;
    const struct search search = begin(texels, pose, trace);
    const uint32_t parts = list_parts(&search, NULL);
    struct part *part = malloc((parts + 1ul) * sizeof *part);
    if (!part) return LW_NO_MEMORY;
    const uint32_t listed = list_parts(&search, part);
    LW_INVARIANT(listed == parts);
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
            if (stands[o]) failures += lw_crossings_find(texels, pose, trace, o, NULL, &count) != LW_OK;
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
    LW_INVARIANT(count <= texels->count);
    LW_INVARIANT_DEAR(are_lit(texels));
    *out_count = count;
    return LW_OK;
}

static void unbury_all(struct lw_texels *texels, uint32_t object) {
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[object].mesh];
    const uint32_t first = texels->first[object];
    for (uint32_t i = 0; i < mesh->texel_count; i++)
        if (mesh->covered[i]) unbury(mesh, i, &texels->covered[first + i], &texels->usable[first + i]);
}

static void add_box(struct boxes *boxes, const struct lw_pose *pose, const struct lw_scene *scene,
                    uint32_t object) {
    LW_INVARIANT(boxes->count < scene->object_count); /* each once */
    struct lw_box *box = &boxes->box[boxes->count++];
    *box = LW_BOX_EMPTY;
    lw_pose_object_bounds(pose, scene, object, &box->low, &box->high);
    lw_pose_object_bounds(pose, scene, object, &boxes->all.low, &boxes->all.high);
}

static bool boxes_init(struct boxes *boxes, uint32_t count) {
    *boxes = (struct boxes){.box = malloc((count + 1ul) * sizeof *boxes->box), .all = LW_BOX_EMPTY};
    return boxes->box != NULL;
}

/* What an object has that has come to stand, or stands elsewhere. */
static enum lw_status look_at_all(const struct search *s, uint32_t object) {
    uint64_t yielding = 0;
    find_again(s, object, NULL);
    return lw_crossings_find(s->texels, s->points.pose, s->points.trace, object, NULL, &yielding);
}

static void free_all(struct lw_texels *texels, uint32_t object) {
    unbury_all(texels, object);
    lw_texels_forget_walls(texels, object);
    lw_texels_link_object(texels, object);
}

/* Looks again at the near texels of an object that has not moved. */
static enum lw_status look_nearby(const struct search *s, uint32_t object, bool *out_any, bool *out_others) {
    const struct lw_mesh_texels *mesh = &s->texels->mesh[s->texels->scene->object[object].mesh];
    const uint8_t *covered = s->texels->covered + s->texels->first[object];
    struct again again;
    uint64_t yielding = 0;
    if (!again_init(&again, mesh, covered)) return LW_NO_MEMORY;
    choose_again(s, object, &again);
    enum lw_status status = LW_OK;
    *out_any = again.any;
    if (again.any) {
        find_again(s, object, again.texel);
        status =
            lw_crossings_find(s->texels, s->points.pose, s->points.trace, object, again.block, &yielding);
        *out_others = memcmp(again.covered, covered, mesh->texel_count) != 0;
    }
    again_finish(&again);
    return status;
}

/* An object's part of a review. */
static enum lw_status review(const struct search *s, const bool *stood, const struct lw_pose *before,
                             uint32_t object, bool *out_others) {
    const bool stands = s->texels->stands[object],
               elsewhere = stands != stood[object] || lw_pose_object_differs(before, s->points.pose, object);
    bool any = elsewhere && (stands || stood[object]);
    enum lw_status status = LW_OK;
    *out_others = any;
    if (any && stands)
        status = look_at_all(s, object);
    else if (any)
        free_all(s->texels, object);
    else if (stands)
        status = look_nearby(s, object, &any, out_others);
    s->texels->changes[object] += any;
    return status;
}

enum lw_status lw_invalid_texels_review(struct lw_texels *texels, const struct lw_pose *before,
                                        const bool *stood, const struct lw_pose *pose,
                                        const struct lw_trace *trace, int threads, bool *out_others) {
    const struct lw_scene *scene = texels->scene;
    struct search search = begin(texels, pose, trace);
    /* what an object inside it may have inside by rays as long as then */
    const struct search then = begin(texels, before, trace);
    search.points.near_m = fmaxf(search.points.near_m, then.points.near_m);
    search.points.far_m = fmaxf(search.points.far_m, then.points.far_m);
    int failures = !boxes_init(&search.left, scene->object_count);
    failures += !boxes_init(&search.come, scene->object_count);
    failures += !boxes_init(&search.first, scene->object_count);
    for (uint32_t o = 0; o < scene->object_count && !failures; o++) {
        const bool stands = texels->stands[o];
        if (stands == stood[o] && !lw_pose_object_differs(before, pose, o)) continue;
        if (stood[o]) add_box(&search.left, before, scene, o);
        if (stood[o] && !lw_pose_object_moves(before, scene, o)) add_box(&search.first, before, scene, o);
        if (stands) add_box(&search.come, pose, scene, o);
    }
    bool others = false;
    if (!failures && search.left.count + search.come.count) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads) reduction(+ : failures) \
    reduction(|| : others)
        for (uint32_t o = 0; o < scene->object_count; o++) {
            bool of_object = false;
            failures += review(&search, stood, before, o, &of_object) != LW_OK;
            others |= of_object;
        }
    }
    free(search.left.box);
    free(search.come.box);
    free(search.first.box);
    LW_INVARIANT_DEAR(failures || are_lit(texels));
    *out_others = others;
    return failures ? LW_NO_MEMORY : LW_OK;
}
