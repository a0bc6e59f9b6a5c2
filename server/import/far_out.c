#include "server/import/far_out.h"

#include "common/base/box.h"
#include "common/base/log.h"
#include "common/scene/pose.h"
#include "common/trace/trace.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define TEXELS_MAX 0.25f /* by which a ray may start off its surface */
#define ERROR_MAX  0.05f /* relative, of irradiance: some 2 lift / distance */

#define NEAR_MIN_M 1e-3f /* nothing is expected to be right nearer to a lamp */

/* Triangles and objects that are looked at for all places together: a warning is not worth more time. */
#define LOOKS_MAX 200000000ull

/* A place and the distance to the nearest surface. */
struct place {
    struct lw_vec3 at;
    uint32_t own; /* object that the place belongs to, and that does not count; LW_SCENE_NONE: none */
    float distance_m;
};

struct search {
    const struct lw_scene *scene;
    const char *file;
    struct lw_pose pose;
    struct lw_box *box; /* per object */
    uint64_t looks;
};

/* ---- geometry ---- */

static float farthest_of(const struct lw_box *box) {
    return fmaxf(lw_vec3_max_abs(box->low), lw_vec3_max_abs(box->high));
}

static float distance_to_segment(struct lw_vec3 a, struct lw_vec3 b) { /* from (0, 0, 0) */
    const struct lw_vec3 ab = lw_vec3_sub(b, a);
    const float square = lw_vec3_dot(ab, ab), t = square > 0 ? -lw_vec3_dot(a, ab) / square : 0;
    return lw_vec3_length(lw_vec3_mad(a, ab, fminf(fmaxf(t, 0), 1)));
}

/* From (0, 0, 0): to the plane if its foot lies within, else to the nearest edge. */
static float distance_to_triangle(const struct lw_vec3 c[3]) {
    const struct lw_vec3 n = lw_vec3_cross(lw_vec3_sub(c[1], c[0]), lw_vec3_sub(c[2], c[0]));
    const float square = lw_vec3_dot(n, n);
    bool within = square > 0;
    float nearest = INFINITY;
    for (int k = 0; k < 3; k++) {
        const struct lw_vec3 a = c[k], b = c[(k + 1) % 3];
        within &= lw_vec3_dot(n, lw_vec3_cross(lw_vec3_sub(b, a), lw_vec3_scale(a, -1))) >= 0;
        nearest = fminf(nearest, distance_to_segment(a, b));
    }
    return within ? fabsf(lw_vec3_dot(n, c[0])) / sqrtf(square) : nearest;
}

/* ---- the nearest surface ---- */

static void look_at_object(struct search *search, uint32_t object, struct place *place) {
    const struct lw_mesh *mesh = &search->scene->mesh[search->scene->object[object].mesh];
    const struct lw_affine *to_world = &search->pose.object_to_world[object];
    search->looks += mesh->triangle_count;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        struct lw_vec3 corner[3];
        for (int k = 0; k < 3; k++)
            corner[k] =
                lw_vec3_sub(lw_affine_point(to_world, mesh->position[mesh->triangle[t][k]]), place->at);
        place->distance_m = fminf(place->distance_m, distance_to_triangle(corner));
    }
}

/* The distance below which light is off by more than ERROR_MAX. */
static float near_m_of(float coordinate_m) { return 2 * LW_TRACE_LIFT * coordinate_m / ERROR_MAX; }

/* Whether something is nearer than that. distance_m: how near. */
static bool is_inexact(struct search *search, struct place *place) {
    const float near_m = near_m_of(lw_vec3_max_abs(place->at));
    place->distance_m = INFINITY;
    if (near_m < NEAR_MIN_M) return false;
    for (uint32_t o = 0; o < search->scene->object_count && search->looks < LOOKS_MAX; o++) {
        search->looks++;
        if (o != place->own && lw_box_distance(&search->box[o], place->at) < fminf(near_m, place->distance_m))
            look_at_object(search, o, place);
    }
    return place->distance_m < near_m;
}

/* ---- lamps, cameras, objects ---- */

/* Findings of one kind. */
struct finding {
    const char *first; /* its name */
    struct place place;
    unsigned count;
};

static void add(struct finding *finding, const char *name, const struct place *place) {
    if (finding->count++ == 0) {
        finding->first = name;
        finding->place = *place;
    }
}

/* Relative error of irradiance below a lamp, by where rays start: (d / (d - lift))^2 - 1. */
static float error_of(const struct place *place) {
    const float d = place->distance_m, lift_m = LW_TRACE_LIFT * lw_vec3_max_abs(place->at);
    const float ratio = d / fmaxf(d - lift_m, 0.1f * d + 1e-9f);
    return ratio * ratio - 1;
}

static void warn(const struct search *search, const struct finding *finding, const char *what,
                 const char *effect) {
    if (finding->count == 0) return;
    lw_log(LW_LOG_WARNING,
           "%s: %s \"%s\" and %u more lie so far out (%g m) that floats are coarse against their distance to "
           "the "
           "nearest surface (%.2g m): %s; bring the scene nearer to the origin",
           search->file, what, finding->first, finding->count - 1, (double)lw_vec3_max_abs(finding->place.at),
           (double)finding->place.distance_m, effect);
}

static bool shines(const struct lw_scene *scene, const struct lw_mesh *mesh) {
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        const float *emission = scene->material[mesh->material[t]].emission;
        if (emission[0] > 0 || emission[1] > 0 || emission[2] > 0) return true;
    }
    return false;
}

static void look_at_lamps(struct search *search) {
    const struct lw_scene *scene = search->scene;
    struct finding finding = {0};
    for (uint32_t i = 0; i < scene->light_count; i++) {
        struct place place = {.at = search->pose.light[i].position_ws, .own = LW_SCENE_NONE};
        if (scene->light[i].kind != LW_LIGHT_DIRECTIONAL && is_inexact(search, &place))
            add(&finding, scene->light[i].name, &place);
    }
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_box *box = &search->box[o];
        struct place place = {.at = lw_box_middle(box), .own = o};
        if (near_m_of(farthest_of(box)) < NEAR_MIN_M) continue;
        search->looks += scene->mesh[scene->object[o].mesh].triangle_count;
        if (search->looks < LOOKS_MAX && shines(scene, &scene->mesh[scene->object[o].mesh]) &&
            is_inexact(search, &place))
            add(&finding, scene->object[o].name, &place);
    }
    char effect[64];
    snprintf(effect, sizeof effect, "light is up to %.0f %% off there",
             (double)(100 * error_of(&finding.place)));
    warn(search, &finding, "lamp", effect);
}

static void look_at_cameras(struct search *search) {
    const struct lw_scene *scene = search->scene;
    struct finding finding = {0};
    for (uint32_t i = 0; i < scene->camera_count; i++) {
        const struct lw_affine *eye = &search->pose.node_to_world[scene->camera[i].node];
        struct place place = {.at = lw_affine_point(eye, lw_vec3(0, 0, 0)), .own = LW_SCENE_NONE};
        if (is_inexact(search, &place)) add(&finding, scene->camera[i].name, &place);
    }
    warn(search, &finding, "camera", "pictures are inexact there");
}

static void look_at_objects(const struct search *search, const struct lw_lightmap_report *report) {
    uint32_t count = 0, first = 0;
    for (uint32_t o = 0; o < search->scene->object_count; o++) {
        const float texels_per_metre = report[search->scene->object[o].mesh].texels_per_metre;
        if (LW_TRACE_LIFT * farthest_of(&search->box[o]) * texels_per_metre <= TEXELS_MAX) continue;
        if (!count++) first = o;
    }
    if (count)
        lw_log(LW_LOG_WARNING,
               "%s: object \"%s\" and %u more lie so far out (%g m) that floats are coarse against their "
               "texels: "
               "light is inexact there; bring the scene nearer to the origin",
               search->file, search->scene->object[first].name, count - 1,
               (double)farthest_of(&search->box[first]));
}

/* ---- all ---- */

enum lw_status lw_far_out_warn(const struct lw_scene *scene, const struct lw_lightmap_report *report,
                               const char *file, struct lw_error *err) {
    struct search search = {.scene = scene, .file = file};
    search.box = calloc(scene->object_count + 1ul, sizeof *search.box);
    if (!search.box || lw_pose_init(&search.pose, scene)) {
        free(search.box);
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    }
    for (uint32_t o = 0; o < scene->object_count; o++) {
        struct lw_box *box = &search.box[o];
        *box = LW_BOX_EMPTY;
        lw_pose_object_bounds(&search.pose, scene, o, &box->low, &box->high);
    }
    look_at_objects(&search, report);
    look_at_lamps(&search);
    look_at_cameras(&search);
    lw_pose_finish(&search.pose);
    free(search.box);
    return LW_OK;
}
