#include "client/load/fixed_views.h"

#include "client/load/path_world.h"
#include "client/load/views.h"
#include "common/random.h"
#include "common/scene/scene_motion.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SEED        20u
#define FOV_DEG     60.0f
#define EYE_M       1.6f
#define EYE_SHARE   0.4f /* of a box that is lower than a room */
#define NEAR_WAY_M  5.0f /* of the lamp's way: where two of three candidates stand */
#define WAY_M       1.0f /* nearer to it nobody stands: the lamp would fill the view */
#define SIGHT_M     1.5f
#define NEAR_M      0.7f
#define NEAR_SHARE  0.1f
#define SKY_SHARE   0.34f
#define PITCH       (14.0f * LW_PI / 180)
#define CLEARANCE_M 0.35f
#define DRIFT_M     0.3f
#define DRIFT_SHARE 0.02f /* of the box's longest side */
#define DRIFT_S     4.0f
#define BIN         8u
#define CANDIDATES  (BIN * LW_FIXED_VIEWS_COUNT)
#define TRIES       200000u
#define WIDTH       96u
#define HEIGHT      54u
#define SAMPLES     16u
#define BOUNCES     2u
#define DARK_SHARE  0.01f /* of the median's luminance: as good as black */
#define PACKETS     9u    /* rays of a first look, by sixteen */

struct candidate {
    struct lw_vec3 position, target;
    float luminance; /* mean over all pixels */
};

struct search {
    const struct lw_scene *scene;
    struct lw_path_world world;
    struct lw_vec3 low, high;
    struct lw_scene_motion_way way;
    bool has_way;
    float eye_m, unit; /* what a metre is worth in a scene that is smaller than a room */
    float drift_m;
};

/* ---- tables ---- */

struct table {
    const char *scene;
    float box_m[3]; /* of all objects that stand: another scene of that name has another */
    struct lw_fixed_view view[LW_FIXED_VIEWS_COUNT];
};

static const struct table *find_table(const struct lw_scene *scene, struct lw_vec3 low, struct lw_vec3 high) {
    (void)scene, (void)low, (void)high;
    return NULL;
}

/* ---- the rule ---- */

static float uniform(uint32_t try, uint32_t dimension) {
    return lw_random_unit(lw_random_hash3(SEED, try, dimension));
}

/* Rays of one view's first look: sixteen at a time, over the whole picture. */
struct look {
    float sky_share, near_share;
};

static struct look look_around(const struct search *s, const struct lw_camera_view *camera) {
    const struct lw_camera_plane plane = lw_camera_plane(camera, 16, PACKETS);
    uint32_t sky = 0, close = 0;
    for (uint32_t row = 0; row < PACKETS; row++) {
        struct lw_ray16 rays = {.salt = 0};
        struct lw_hit16 hits;
        for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) {
            const struct lw_vec3 d = lw_camera_direction(&plane, (float)i + 0.5f, (float)row + 0.5f);
            lw_trace_set_ray(&rays, i, camera->position, lw_vec3_normalize(d), INFINITY);
        }
        lw_trace_closest16(s->world.trace, LW_TRACE_VIEW, 0xffff, &rays, &hits);
        for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) {
            sky += hits.object[i] == LW_TRACE_MISS;
            close += hits.object[i] != LW_TRACE_MISS && hits.t[i] < NEAR_M * s->unit;
        }
    }
    const float count = 16.0f * PACKETS;
    return (struct look){(float)sky / count, (float)close / count};
}

/* How far one sees; INFINITY: into the sky. Sets whether what is met is a floor. */
static float distance(const struct search *s, struct lw_vec3 from, struct lw_vec3 direction,
                      bool *out_floor) {
    struct lw_ray16 rays = {.salt = 0};
    struct lw_hit16 hits;
    lw_trace_set_ray(&rays, 0, from, direction, INFINITY);
    lw_trace_closest16(s->world.trace, LW_TRACE_LIGHT, 1, &rays, &hits);
    *out_floor = false;
    if (hits.object[0] == LW_TRACE_MISS) return INFINITY;
    const struct lw_mesh *mesh = &s->scene->mesh[s->scene->object[hits.object[0]].mesh];
    struct lw_vec3 geometric;
    lw_scene_normal(mesh, hits.triangle[0], hits.u[0], hits.v[0], &geometric);
    geometric = lw_affine_vector(&s->world.pose.object_to_world[hits.object[0]], geometric);
    *out_floor = !hits.back[0] && fabsf(geometric.y) > 0.9f * lw_vec3_length(geometric);
    return hits.t[0];
}

static float distance_to_way(const struct lw_scene_motion_way *way, struct lw_vec3 p) {
    const struct lw_vec3 ab = lw_vec3_sub(way->to_ws, way->from_ws);
    const float length2 = lw_vec3_dot(ab, ab);
    const float t =
        length2 > 0 ? fminf(1, fmaxf(0, lw_vec3_dot(lw_vec3_sub(p, way->from_ws), ab) / length2)) : 0;
    return lw_vec3_length(lw_vec3_sub(p, lw_vec3_mad(way->from_ws, ab, t)));
}

/* A place over a floor, two of three near the lamp's way. */
static bool find_place(const struct search *s, uint32_t try, struct lw_vec3 *out) {
    const struct lw_vec3 size = lw_vec3_sub(s->high, s->low);
    struct lw_vec3 at = lw_vec3(s->low.x + size.x * uniform(try, 0), s->low.y + size.y * uniform(try, 1),
                                s->low.z + size.z * uniform(try, 2));
    if (s->has_way && try % 3) {
        const struct lw_vec3 ab = lw_vec3_sub(s->way.to_ws, s->way.from_ws);
        const float r = NEAR_WAY_M * s->unit;
        at = lw_vec3_mad(s->way.from_ws, ab, uniform(try, 0));
        at = lw_vec3_add(at, lw_vec3(r * (2 * uniform(try, 1) - 1), s->eye_m * uniform(try, 3),
                                     r * (2 * uniform(try, 2) - 1)));
    }
    bool floor;
    const float above = distance(s, at, lw_vec3(0, -1, 0), &floor);
    if (!floor || above > 2 * s->eye_m) return false;
    at.y += s->eye_m - above;
    *out = at;
    return true;
}

static bool is_free(const struct search *s, struct lw_vec3 at, uint32_t seed) {
    return lw_views_is_free(s->world.trace, at, CLEARANCE_M * s->unit, seed) &&
           !(s->has_way && distance_to_way(&s->way, at) < WAY_M * s->unit);
}

static bool find_candidate(const struct search *s, uint32_t try, struct candidate *out) {
    struct candidate c = {.luminance = 0};
    if (!find_place(s, try, &c.position) || !is_free(s, c.position, try)) return false;
    const float yaw = 2 * LW_PI * uniform(try, 4), pitch = PITCH * (2 * uniform(try, 5) - 1);
    const struct lw_vec3 d = lw_vec3(cosf(yaw) * cosf(pitch), sinf(pitch), sinf(yaw) * cosf(pitch));
    bool floor;
    const float sight = distance(s, c.position, d, &floor);
    if (!(sight >= SIGHT_M * s->unit)) return false;
    c.target = lw_vec3_mad(c.position, d, fminf(sight, 5 * s->unit));
    const struct lw_camera_view view = lw_camera_look_at(c.position, c.target, FOV_DEG * LW_PI / 180);
    for (int side = -1; side <= 1; side += 2)
        if (!is_free(s, lw_vec3_mad(c.position, view.right, (float)side * s->drift_m), try)) return false;
    const struct look look = look_around(s, &view);
    if (look.sky_share > SKY_SHARE || look.near_share > NEAR_SHARE) return false;
    *out = c;
    return true;
}

static enum lw_status light_up(const struct search *s, struct candidate *c, struct lw_error *err) {
    struct lw_path_film film;
    enum lw_status status = lw_path_film_init(&film, WIDTH, HEIGHT, err);
    if (status != LW_OK) return status;
    const struct lw_path_view view = {
        .camera = lw_camera_look_at(c->position, c->target, FOV_DEG * LW_PI / 180), .seed = SEED};
    lw_path_world_render(&s->world, &view, SAMPLES, &film);
    double sum = 0;
    const size_t pixels = (size_t)WIDTH * HEIGHT;
    static const double weight[3] = {0.2126, 0.7152, 0.0722};
    for (size_t i = 0; i < 3 * pixels; i++)
        sum += weight[i % 3] * ((double)film.half[0][i] + (double)film.half[1][i]);
    c->luminance = (float)(sum / ((double)pixels * SAMPLES));
    lw_path_film_finish(&film);
    return LW_OK;
}

static int by_luminance(const void *a, const void *b) {
    const float x = ((const struct candidate *)a)->luminance, y = ((const struct candidate *)b)->luminance;
    return (x > y) - (x < y);
}

/* Of each bin the one that stands the farthest from those taken before; of the first the middle one. */
static void take(struct lw_fixed_views *views, const struct candidate *c, uint32_t count) {
    for (uint32_t k = 0; k < LW_FIXED_VIEWS_COUNT; k++) {
        const uint32_t first = k * count / LW_FIXED_VIEWS_COUNT,
                       last = (k + 1) * count / LW_FIXED_VIEWS_COUNT;
        uint32_t best = (first + last) / 2;
        float farthest = -1;
        for (uint32_t i = first; k > 0 && i < last; i++) {
            float nearest = INFINITY;
            for (uint32_t j = 0; j < k; j++) {
                const struct lw_vec3 apart = lw_vec3_sub(c[i].position, views->view[j].position);
                nearest = fminf(nearest, lw_vec3_dot(apart, apart));
            }
            if (!(nearest > farthest)) continue;
            farthest = nearest;
            best = i;
        }
        views->view[k] = (struct lw_fixed_view){
            .position = c[best].position, .target = c[best].target, .fov_deg = FOV_DEG, .shows = ""};
    }
}

/* Leaves out what is as good as black; c is sorted. Returns how many are left, which then come first. */
static uint32_t drop_black(struct candidate *c, uint32_t count) {
    uint32_t black = 0;
    while (black < count && !(c[black].luminance > DARK_SHARE * c[count / 2].luminance)) black++;
    memmove(c, c + black, (count - black) * sizeof *c);
    return count - black;
}

static enum lw_status pick(struct search *s, struct lw_fixed_views *views, struct lw_error *err) {
    struct candidate *c = calloc(CANDIDATES, sizeof *c);
    enum lw_status status = c ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "no memory for views");
    uint32_t count = 0;
    for (uint32_t try = 0; status == LW_OK && count < CANDIDATES && try < TRIES; try++)
        if (find_candidate(s, try, &c[count])) status = light_up(s, &c[count++], err);
    if (status == LW_OK) {
        qsort(c, count, sizeof *c, by_luminance);
        count = drop_black(c, count);
        if (count < LW_FIXED_VIEWS_COUNT)
            status = lw_status_fail(err, LW_BAD_DATA,
                                    "%s: %u of %u views found: too few free places from which something "
                                    "that is lit is seen",
                                    s->scene->name, count, LW_FIXED_VIEWS_COUNT);
    }
    if (status == LW_OK) take(views, c, count);
    free(c);
    return status;
}

/* ---- the whole ---- */

static float longest_of(struct lw_vec3 low, struct lw_vec3 high) {
    return fmaxf(high.x - low.x, fmaxf(high.y - low.y, high.z - low.z));
}

static float drift_of(struct lw_vec3 low, struct lw_vec3 high) {
    return fminf(DRIFT_M, DRIFT_SHARE * longest_of(low, high));
}

enum lw_status lw_fixed_views_pick(struct lw_fixed_views *views, const struct lw_scene *scene,
                                   unsigned threads, struct lw_error *err) {
    struct search s = {.scene = scene};
    enum lw_status status = lw_path_world_init(&s.world, scene, BOUNCES, threads, err);
    if (status != LW_OK) return status;
    struct lw_fixed_views found = {.from_table = false};
    if (!lw_pose_bounds(&s.world.pose, scene, &s.low, &s.high)) {
        status = lw_status_fail(err, LW_BAD_DATA, "%s: there is nothing to look at", scene->name);
    } else {
        s.eye_m = fminf(EYE_M, EYE_SHARE * (s.high.y - s.low.y));
        s.unit = s.eye_m / EYE_M;
        s.drift_m = found.drift_m = drift_of(s.low, s.high);
        s.has_way = lw_scene_motion_find_way(scene, LW_SCENE_MOTION_LAMP_WALK, &s.way, NULL) == LW_OK;
        status = pick(&s, &found, err);
    }
    lw_path_world_finish(&s.world);
    if (status == LW_OK) *views = found;
    return status;
}

enum lw_status lw_fixed_views_init(struct lw_fixed_views *views, const struct lw_scene *scene,
                                   unsigned threads, struct lw_error *err) {
    struct lw_pose pose;
    struct lw_vec3 low, high;
    if (lw_pose_init(&pose, scene) != LW_OK) return lw_status_fail(err, LW_NO_MEMORY, "no memory for views");
    const struct table *table =
        lw_pose_bounds(&pose, scene, &low, &high) ? find_table(scene, low, high) : NULL;
    lw_pose_finish(&pose);
    if (!table) return lw_fixed_views_pick(views, scene, threads, err);
    *views = (struct lw_fixed_views){.drift_m = drift_of(low, high), .from_table = true};
    memcpy(views->view, table->view, sizeof views->view);
    return LW_OK;
}

bool lw_fixed_views_drifts(uint32_t view) { return view % 2; }

struct lw_camera_view lw_fixed_views_at(const struct lw_fixed_views *views, uint32_t view, double time_s) {
    const struct lw_fixed_view *v = &views->view[view];
    struct lw_camera_view camera = lw_camera_look_at(v->position, v->target, v->fov_deg * LW_PI / 180);
    if (!lw_fixed_views_drifts(view)) return camera;
    const double turns = time_s / (double)DRIFT_S;
    const float phase = 2 * LW_PI * (float)(turns - floor(turns));
    camera.position = lw_vec3_mad(camera.position, camera.right, views->drift_m * sinf(phase));
    return camera;
}
