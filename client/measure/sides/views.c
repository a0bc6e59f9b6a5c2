#include "client/measure/sides/views.h"

#include "client/paths/camera_default.h"
#include "common/base/random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WALK_M_S     1.4f
#define EYE_HEIGHT_M 1.7f
#define WALK_S_MAX   120u /* longest path that is kept */
#define LOOK_ASIDE   (35.0f * LW_PI / 180)
#define LOOK_S       6.0f
#define GROUP_FRAMES 60.0f /* from the first to the last of walkers who go together */
#define FOV_Y        (60.0f * LW_PI / 180)
#define PROBES       32u
#define TRIES        4096u
#define CLEARANCE    0.01f /* over the box's diagonal: nearer to a surface is no place to look from */
#define GROUP_SHARE  0.1f  /* share of the box where all stand together */

struct lw_views {
    struct lw_views_desc desc;
    struct lw_camera_view *path; /* walkers: a loop, by frame */
    uint32_t path_frames;
    struct lw_camera_view *place; /* standing: by user */
    char about[160];
};

/* ---- walking ---- */

static enum lw_status follow_camera(struct lw_views *v, struct lw_pose *pose, uint32_t camera) {
    const struct lw_scene *scene = v->desc.scene;
    uint32_t frames = (uint32_t)fmaxf(1, roundf(scene->duration_s * LW_VIEWS_HZ));
    if (frames > WALK_S_MAX * LW_VIEWS_HZ) frames = WALK_S_MAX * LW_VIEWS_HZ;
    v->path = calloc(frames, sizeof *v->path);
    if (!v->path) return LW_NO_MEMORY;
    for (uint32_t f = 0; f < frames; f++) {
        lw_pose_evaluate(pose, scene, (double)f / LW_VIEWS_HZ);
        v->path[f] = lw_camera_of_scene(scene, pose, camera);
    }
    v->path_frames = frames;
    snprintf(v->about, sizeof v->about, "a walk along camera \"%.80s\" (%.1f s)", scene->camera[camera].name,
             (double)frames / LW_VIEWS_HZ);
    return LW_OK;
}

static float free_distance(const struct lw_trace *trace, struct lw_vec3 from, struct lw_vec3 direction) {
    struct lw_ray16 rays = {.salt = 0};
    struct lw_hit16 hits;
    for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) lw_trace_set_ray(&rays, i, from, direction, INFINITY);
    lw_trace_closest16(trace, LW_TRACE_VIEW, 1, &rays, &hits);
    return hits.object[0] == LW_TRACE_MISS ? INFINITY : hits.t[0];
}

/* To and fro within the free half of what lies ahead. */
static enum lw_status stroll(struct lw_views *v, const struct lw_pose *pose) {
    struct lw_camera_view start = lw_camera_default(v->desc.scene, pose, v->desc.trace, v->desc.aspect);
    struct lw_vec3 low, high, ahead = lw_vec3(start.forward.x, 0, start.forward.z);
    if (!lw_pose_bounds(pose, v->desc.scene, &low, &high)) low = high = start.position;
    float diagonal_m = lw_vec3_length(lw_vec3_sub(high, low));
    const float level = lw_vec3_length(ahead), slope = start.forward.y / fmaxf(level, 1e-3f);
    ahead = level > 1e-3f ? lw_vec3_normalize(ahead) : lw_vec3(0, 0, -1);
    /* neither past the surface in sight nor into one that stands in the way */
    const float sight_m = level * free_distance(v->desc.trace, start.position, start.forward),
                way_m = free_distance(v->desc.trace, start.position, ahead);
    float length_m = 0.5f * fminf(fminf(sight_m, way_m), diagonal_m);
    /* files in centimetres: a walker's pace by his height, as the eye's height by the scene's */
    float pace_m_s = WALK_M_S * fmaxf(1, 0.15f * (high.y - low.y) / EYE_HEIGHT_M);
    float period_s = fminf(fmaxf(2 * length_m / pace_m_s, 2.0f), (float)WALK_S_MAX);
    uint32_t frames = (uint32_t)(period_s * LW_VIEWS_HZ);
    uint32_t looks = (uint32_t)fmaxf(1, roundf(period_s / LOOK_S));
    v->path = calloc(frames, sizeof *v->path);
    if (!v->path) return LW_NO_MEMORY;
    for (uint32_t f = 0; f < frames; f++) {
        float phase = 2 * LW_PI * (float)f / (float)frames;
        struct lw_vec3 at = lw_vec3_mad(start.position, ahead, 0.5f * length_m * (1 - cosf(phase)));
        float yaw = LOOK_ASIDE * sinf((float)looks * phase);
        struct lw_vec3 aside = lw_vec3_cross(ahead, lw_vec3(0, 1, 0));
        struct lw_vec3 look = lw_vec3_mad(lw_vec3_scale(ahead, cosf(yaw)), aside, sinf(yaw));
        look.y = slope; /* a view from outside and above keeps its slope */
        v->path[f] = lw_camera_look_at(at, lw_vec3_add(at, look), start.fov_y);
    }
    v->path_frames = frames;
    snprintf(v->about, sizeof v->about, "a walk to and fro along %.1f m from the default view (%.1f s)",
             (double)length_m, (double)frames / LW_VIEWS_HZ);
    return LW_OK;
}

static enum lw_status walk(struct lw_views *v, struct lw_pose *pose) {
    const struct lw_scene *scene = v->desc.scene;
    for (uint32_t c = 0; c < scene->camera_count; c++)
        if (scene->duration_s > 0 && pose->node_moves[scene->camera[c].node])
            return follow_camera(v, pose, c);
    return stroll(v, pose);
}

/* ---- standing ---- */

/* Whether nothing is nearer than clearance_m, and few of the rays that meet a surface meet its back. */
bool lw_views_is_free(const struct lw_trace *trace, struct lw_vec3 at, float clearance_m, uint32_t seed) {
    uint32_t met = 0, backs = 0;
    for (uint32_t first = 0; first < PROBES; first += LW_TRACE_WIDTH) {
        struct lw_ray16 rays = {.salt = 0};
        struct lw_hit16 hits;
        for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) {
            float y = 1 - (2 * (float)(first + i) + 1) / (float)PROBES, r = sqrtf(1 - y * y);
            float phi = 2.39996323f * (float)(first + i) + (float)seed;
            lw_trace_set_ray(&rays, i, at, lw_vec3(r * cosf(phi), y, r * sinf(phi)), INFINITY);
        }
        lw_trace_closest16(trace, LW_TRACE_LIGHT, 0xffff, &rays, &hits);
        for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) {
            if (hits.object[i] == LW_TRACE_MISS) continue;
            if (hits.t[i] < clearance_m) return false;
            met++;
            backs += hits.back[i];
        }
    }
    return backs * 3 <= met;
}

static float uniform(uint32_t seed, uint32_t index, uint32_t dimension) {
    return lw_random_unit(lw_random_hash3(seed, index, dimension));
}

static enum lw_status stand(struct lw_views *v, const struct lw_pose *pose, struct lw_error *err) {
    struct lw_vec3 low, high;
    v->place = calloc(v->desc.users, sizeof *v->place);
    if (!v->place) return LW_NO_MEMORY;
    if (!lw_pose_bounds(pose, v->desc.scene, &low, &high))
        return lw_status_fail(err, LW_BAD_DATA, "%s: there is nothing to see", v->desc.scene->name);
    struct lw_vec3 size = lw_vec3_sub(high, low), centre = lw_vec3_mad(low, size, 0.5f), group = centre;
    float clearance_m = CLEARANCE * lw_vec3_length(size), share = 1;
    for (uint32_t user = 0, try = 0; user < v->desc.users;) {
        if (++try > TRIES + 64 * v->desc.users)
            return lw_status_fail(err, LW_BAD_DATA, "%s: no free place found to look from",
                                  v->desc.scene->name);
        struct lw_vec3 at;
        float *to = &at.x;
        for (uint32_t c = 0; c < 3; c++) {
            float from = (&low.x)[c] + (1 - share) * ((&group.x)[c] - (&low.x)[c]);
            to[c] = from + share * (&size.x)[c] * (0.02f + 0.96f * uniform(v->desc.seed, try, c));
        }
        if (!lw_views_is_free(v->desc.trace, at, clearance_m, try)) continue;
        v->place[user] = lw_camera_look_at(at, centre, FOV_Y);
        if (user++ == 0) { /* the others are about the first */
            group = at;
            share = GROUP_SHARE + (1 - GROUP_SHARE) * v->desc.spread;
        }
    }
    snprintf(v->about, sizeof v->about,
             "standing at places spread over the scene's box, looking at its centre");
    return LW_OK;
}

/* ---- the whole ---- */

enum lw_status lw_views_create(const struct lw_views_desc *desc, struct lw_views **out_views,
                               struct lw_error *err) {
    struct lw_pose pose = {0};
    struct lw_views *v = calloc(1, sizeof *v);
    enum lw_status status = v ? lw_pose_init(&pose, desc->scene) : LW_NO_MEMORY;
    if (status == LW_OK) {
        v->desc = *desc;
        status = desc->kind == LW_VIEWS_WALK ? walk(v, &pose) : stand(v, &pose, err);
        lw_pose_finish(&pose);
    }
    if (status == LW_OK) {
        *out_views = v;
        return LW_OK;
    }
    if (status == LW_NO_MEMORY) lw_status_fail(err, status, "no memory for the users' views");
    lw_views_destroy(v);
    return status;
}

void lw_views_destroy(struct lw_views *v) {
    if (!v) return;
    free(v->path);
    free(v->place);
    free(v);
}

struct lw_camera_view lw_views_at(const struct lw_views *v, uint32_t user, uint64_t frame) {
    if (v->place) return v->place[user % v->desc.users];
    float range = fmaxf(v->desc.spread * (float)v->path_frames, GROUP_FRAMES);
    uint64_t offset = (uint64_t)(range * lw_random_unit(lw_random_reverse_bits(user)));
    return v->path[(frame - 1 + offset) % v->path_frames];
}

static struct lw_camera_view look_up(const void *context, uint32_t user, uint64_t frame) {
    return lw_views_at(context, user, frame);
}

struct lw_renderer_cameras lw_views_cameras(const struct lw_views *v) {
    return (struct lw_renderer_cameras){.context = v, .at = look_up};
}

bool lw_views_rest(const struct lw_views *v) { return v->place != NULL || v->path_frames == 1; }

const char *lw_views_about(const struct lw_views *v) { return v->about; }
