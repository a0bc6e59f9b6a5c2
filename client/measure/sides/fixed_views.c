#include "client/measure/sides/fixed_views.h"

#include "client/measure/sides/path_world.h"
#include "client/measure/sides/views.h"
#include "common/base/random.h"
#include "common/scene/scene_motion.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SEED        20u
#define FOV_DEG     60.0f
#define EYE_M       1.6f
#define EYE_SHARE   0.4f  /* eye height over the box's, where the box is lower than a room */
#define NEAR_WAY_M  4.0f  /* candidates stand at most as far from a point of interest, level */
#define LOOK_WAY_M  12.0f /* as far off are points at which they look */
#define LOOK_ASIDE  (25.0f * LW_PI / 180)
#define ALL_OVER    6u  /* one of as many stands anywhere */
#define POINTS      16u /* on the lamp's way, and on each mover's */
#define POINTS_MAX  512u
#define FIRST_S     2.0 /* when the scene's movers count */
#define LAST_S      6.0
#define WAY_M       1.0f /* no view is nearer: the lamp would fill it */
#define SIGHT_M     1.5f
#define NEAR_M      0.7f
#define NEAR_SHARE  0.1f
#define SKY_SHARE   0.34f
#define PITCH       (14.0f * LW_PI / 180)
#define CLEARANCE_M 0.35f
#define DRIFT_M     0.3f
#define DRIFT_SHARE 0.02f /* over the box's longest side */
#define DRIFT_S     4.0f
#define BIN         8u
#define CANDIDATES  (BIN * LW_FIXED_VIEWS_COUNT)
#define TRIES       200000u
#define WIDTH       96u
#define HEIGHT      54u
#define SAMPLES     16u
#define BOUNCES     2u
#define DARK_SHARE  0.01f /* over the median's luminance: as good as black */
#define BOX_SLACK   0.1f  /* a mover may stand elsewhere */
#define PACKETS     9u    /* rays of a first look, by sixteen */

struct candidate {
    struct lw_vec3 position, target;
    float luminance; /* mean over all pixels */
};

struct search {
    const struct lw_scene *scene;
    struct lw_path_world world;
    struct lw_vec3 low, high;
    /* Points of interest: the lamp's way, then where the scene's own movers are. */
    struct lw_vec3 point[POINTS_MAX];
    float radius[POINTS_MAX]; /* m, level; the mover's; 0 on the lamp's way */
    uint32_t points, of_way;
    float eye_m, unit; /* what a metre is worth in a scene that is smaller than a room */
    float drift_m;
};

/* ---- tables ---- */

struct table {
    const char *scene;
    float box_m[3]; /* of all objects that stand: another scene of that name has another */
    struct lw_fixed_view view[LW_FIXED_VIEWS_COUNT];
};

static const struct table tables[] = {
    {"atrium",
     {31.2f, 11.29f, 19.2f},
     {
         {{10.37f, 1.60f, 8.38f}, {14.60f, 2.64f, 5.93f}, "the dark end of the lamp's gallery"},
         {{-10.60f, 1.60f, 6.83f}, {-5.69f, 0.78f, 7.29f}, "along the lamp's gallery, the court to the left"},
         {{-2.15f, 1.60f, -7.69f}, {-7.10f, 0.90f, -7.83f}, "the opposite gallery, patches of sun"},
         {{-9.50f, 1.60f, 3.00f}, {-5.00f, 1.30f, 7.50f}, "from the court into the lamp's gallery"},
         {{-2.60f, 1.60f, 6.90f}, {-6.90f, 1.50f, 8.10f}, "along the lamp's gallery, towards the lamp"},
         {{4.20f, 1.45f, -1.71f}, {2.64f, 0.68f, 2.98f}, "the court's floor and the lamp's arches"},
         {{13.76f, 6.45f, -0.58f}, {12.42f, 5.73f, -5.34f}, "the upper gallery, the balustrade's shadow"},
         {{-1.13f, 1.45f, 3.62f}, {2.93f, 2.25f, 0.81f}, "the court, armillary and sunlit arches"},
         {{-1.43f, 2.02f, -0.88f}, {2.41f, 1.37f, 2.25f}, "under the armillary: basin and its shadows"},
         {{6.17f, 1.60f, 8.16f}, {1.19f, 2.05f, 8.22f}, "along the lamp's gallery, both lamps"},
         {{1.46f, 1.60f, 6.09f}, {-2.97f, 2.45f, 8.25f}, "beside the lamp's way: vault and wall"},
         {{1.71f, 1.45f, 3.85f}, {3.15f, 1.67f, 5.77f}, "columns before the lit wall"},
     }},
    {"city",
     {576, 88.6f, 576},
     {
         {{-36.38f, 1.45f, -2.24f},
          {-37.09f, 0.45f, 2.61f},
          "the roadway by which car and tram come, shady fronts"},
         {{-27.74f, 2.06f, -4.75f}, {-29.62f, 3.26f, -0.27f}, "shady fronts from the other pavement"},
         {{-18.71f, 1.45f, -2.68f}, {-19.17f, 1.08f, 2.29f}, "awnings across the roadway"},
         {{-22.70f, 1.60f, -4.56f}, {-26.69f, 0.83f, -1.65f}, "up the street, over the roadway"},
         {{-25.46f, 1.60f, -4.26f}, {-21.97f, 1.71f, -0.68f}, "down the street, the crossing"},
         {{-32.06f, 1.45f, -3.62f}, {-36.96f, 0.50f, -3.49f}, "roadway and pavement with the lantern"},
         {{-34.93f, 1.45f, -0.75f}, {-30.39f, 1.24f, -2.84f}, "the middle of the roadway, down the street"},
         {{-13.62f, 1.45f, -0.82f}, {-18.35f, 2.33f, -2.18f}, "the whole street, which the car comes along"},
         {{-26.66f, 1.45f, -1.09f}, {-30.08f, 2.66f, -4.53f}, "sunny fronts and the lantern's pavement"},
         {{-36.34f, 1.45f, -3.78f}, {-32.34f, 2.42f, -6.61f}, "a lamp post before sunny fronts"},
         {{-39.58f, 1.45f, -4.30f}, {-34.60f, 1.36f, -5.00f}, "along the pavement"},
         {{53.97f, 1.45f, 62.99f}, {57.49f, 0.68f, 59.53f}, "a sunny crossing far from the traffic"},
     }},
    {"Sponza",
     {37.19f, 15.55f, 22.88f},
     {
         {{-7.14f, 1.57f, 3.32f}, {-2.21f, 0.74f, 3.49f}, "the lamp's aisle from its one end"},
         {{9.48f, 1.57f, 4.36f}, {4.61f, 0.43f, 4.47f}, "the lamp's aisle from its other end"},
         {{-9.75f, 1.57f, 3.57f}, {-4.78f, 1.67f, 3.05f}, "the aisle's arches, a curtain"},
         {{0.89f, 1.57f, 4.96f}, {-3.60f, 0.64f, 2.96f}, "curtains from behind, low"},
         {{4.94f, 1.57f, 4.92f}, {-0.04f, 1.69f, 4.50f}, "along the wall of the lamp's aisle"},
         {{-3.75f, 1.57f, 4.99f}, {-8.51f, 2.73f, 3.98f}, "vault and curtain at the lamp's turning point"},
         {{3.05f, 1.57f, 5.04f}, {-1.40f, 1.12f, 2.80f}, "curtains from behind, one end of the nave lit"},
         {{-1.50f, 1.57f, -1.21f}, {-1.79f, 1.63f, 2.03f}, "curtains of the shady side from the nave"},
         {{4.30f, 1.57f, -1.47f}, {-0.42f, 2.60f, -0.19f}, "along the nave, a little sun on its floor"},
         {{-7.18f, 1.57f, -0.54f}, {-2.58f, 2.27f, -2.37f}, "sunlit curtains and a brazier"},
         {{-11.07f, 1.57f, 0.77f}, {-6.22f, 0.71f, -0.09f}, "the edge of the sun along the nave"},
         {{3.57f, 1.45f, -1.02f}, {1.47f, 0.90f, -2.69f}, "floor and curtains in the sun"},
     }},
    {"cornell",
     {2.00f, 1.98f, 2.01f},
     {
         {{-0.43f, 0.79f, 0.67f}, {-1.00f, 0.73f, 0.05f}, "the red wall from near"},
         {{0.67f, 0.79f, -0.73f}, {-0.93f, 0.55f, 1.14f}, "from behind the blocks, out of the box"},
         {{-0.01f, 1.38f, 0.23f}, {1.00f, 1.48f, 0.28f}, "the green wall from beneath the lamp"},
         {{0.53f, 0.79f, 0.70f}, {-1.00f, 0.93f, 0.14f}, "across the box to the red wall"},
         {{0.39f, 0.79f, -0.04f}, {1.00f, 0.69f, 0.43f}, "the green wall from near"},
         {{0.58f, 1.38f, 0.30f}, {-1.00f, 1.24f, -0.09f}, "above the blocks to the red wall"},
         {{0.08f, 0.79f, 0.63f}, {0.55f, 1.20f, -1.01f}, "the back wall from the opening"},
         {{0.02f, 0.79f, -0.71f}, {0.96f, 0.69f, -1.01f}, "the corner of back and green wall"},
         {{0.71f, 0.79f, 0.34f}, {0.44f, 0.66f, -1.01f}, "along the green wall"},
         {{0.48f, 0.79f, -0.35f}, {0.09f, 0.79f, -1.01f}, "the back wall from near"},
         {{0.44f, 1.38f, 0.64f}, {0.87f, 1.00f, -1.01f}, "the back wall from the opening, above"},
         {{0.29f, 1.38f, 0.25f}, {-0.91f, 1.24f, -1.01f}, "the corner of back and red wall"},
     }},
};

static const struct table *find_table(const struct lw_scene *scene, struct lw_vec3 low, struct lw_vec3 high) {
    const float box_m[3] = {high.x - low.x, high.y - low.y, high.z - low.z};
    for (size_t i = 0; i < sizeof tables / sizeof *tables; i++) {
        bool fits = strcmp(tables[i].scene, scene->name) == 0;
        for (int c = 0; c < 3; c++) fits &= fabsf(box_m[c] - tables[i].box_m[c]) <= BOX_SLACK * box_m[c];
        if (fits) return &tables[i];
    }
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

/* Distance to the first surface; INFINITY: the sky. Sets whether that surface is a floor. */
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

/* Whether the lamp or a mover would stand in the way. */
static bool is_in_way(const struct search *s, struct lw_vec3 p) {
    for (uint32_t i = 0; i < s->points; i++)
        if (lw_vec3_length(lw_vec3_sub(p, s->point[i])) < WAY_M * s->unit + s->radius[i]) return true;
    return false;
}

/* Half of them on the lamp's way, the others at movers. */
static struct lw_vec3 random_point(const struct search *s, uint32_t try, uint32_t dimension) {
    const bool way = s->of_way && (s->of_way == s->points || uniform(try, dimension) < 0.5f);
    const uint32_t first = way ? 0 : s->of_way, count = way ? s->of_way : s->points - s->of_way;
    return s->point[first + (uint32_t)(uniform(try, dimension + 1) * (float)count) % count];
}

/* A place over a floor. */
static bool find_place(const struct search *s, uint32_t try, bool all_over, struct lw_vec3 *out) {
    const struct lw_vec3 size = lw_vec3_sub(s->high, s->low);
    struct lw_vec3 at = lw_vec3(s->low.x + size.x * uniform(try, 0), s->low.y + size.y * uniform(try, 1),
                                s->low.z + size.z * uniform(try, 2));
    if (!all_over) {
        const float r = NEAR_WAY_M * s->unit;
        at = lw_vec3_add(random_point(s, try, 6),
                         lw_vec3(r * (2 * uniform(try, 1) - 1), s->eye_m * uniform(try, 3),
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
    return lw_views_is_free(s->world.trace, at, CLEARANCE_M * s->unit, seed) && !is_in_way(s, at);
}

/* Towards a point of interest that is near and not hidden, more or less; or anywhere. */
static bool find_direction(const struct search *s, uint32_t try, bool all_over, struct lw_vec3 from,
                           struct lw_vec3 *out) {
    float yaw = 2 * LW_PI * uniform(try, 4);
    const float pitch = PITCH * (2 * uniform(try, 5) - 1);
    if (!all_over) {
        const struct lw_vec3 there = lw_vec3_sub(random_point(s, try, 8), from);
        const float far_m = lw_vec3_length(there);
        bool floor;
        if (far_m > LOOK_WAY_M * s->unit ||
            distance(s, from, lw_vec3_scale(there, 1 / far_m), &floor) < far_m - 0.8f * s->unit)
            return false;
        yaw = atan2f(there.z, there.x) + LOOK_ASIDE * (2 * uniform(try, 4) - 1);
    }
    *out = lw_vec3(cosf(yaw) * cosf(pitch), sinf(pitch), sinf(yaw) * cosf(pitch));
    return true;
}

static bool find_candidate(const struct search *s, uint32_t try, struct candidate *out) {
    struct candidate c = {.luminance = 0};
    struct lw_vec3 d;
    bool floor;
    const bool all_over = s->points == 0 || try % ALL_OVER == 0;
    if (!find_place(s, try, all_over, &c.position) || !is_free(s, c.position, try) ||
        !find_direction(s, try, all_over, c.position, &d))
        return false;
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

/* Finds points on the lamp's way, and at objects that the scene's own animation moves. */
static enum lw_status find_points(struct search *s) {
    struct lw_scene_motion_way way;
    if (lw_scene_motion_find_way(s->scene, LW_SCENE_MOTION_LAMP_WALK, &way, NULL) == LW_OK)
        for (; s->of_way < POINTS; s->of_way++)
            s->point[s->of_way] = lw_vec3_mad(way.from_ws, lw_vec3_sub(way.to_ws, way.from_ws),
                                              (float)s->of_way / (float)(POINTS - 1));
    s->points = s->of_way;
    struct lw_pose pose;
    enum lw_status status = lw_pose_init(&pose, s->scene);
    for (uint32_t k = 0; status == LW_OK && k < POINTS; k++) {
        lw_pose_evaluate(&pose, s->scene, FIRST_S + (LAST_S - FIRST_S) * k / (POINTS - 1));
        for (uint32_t o = 0; o < s->scene->object_count && s->points < POINTS_MAX; o++) {
            if (lw_scene_is_spare(s->scene, o) || !lw_pose_object_moves(&pose, s->scene, o)) continue;
            struct lw_vec3 low = lw_vec3(INFINITY, INFINITY, INFINITY), high = lw_vec3_scale(low, -1);
            lw_pose_object_bounds(&pose, s->scene, o, &low, &high);
            s->radius[s->points] = 0.5f * fmaxf(high.x - low.x, high.z - low.z);
            s->point[s->points++] = lw_vec3_scale(lw_vec3_add(low, high), 0.5f);
        }
    }
    lw_pose_finish(&pose);
    return status;
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

/* Takes the middle candidate of the first bin, then of each bin the farthest from all taken before. */
static void choose_spread(struct lw_fixed_views *views, const struct candidate *c, uint32_t count) {
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
        views->view[k] =
            (struct lw_fixed_view){.position = c[best].position, .target = c[best].target, .shows = ""};
    }
}

/* Leaves out candidates as good as black; c is sorted. Returns how many are left, which then come first. */
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
    if (status == LW_OK) choose_spread(views, c, count);
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
        status = lw_status_fail(err, LW_BAD_DATA, "%s: there is nothing to see", scene->name);
    } else {
        s.eye_m = fminf(EYE_M, EYE_SHARE * (s.high.y - s.low.y));
        s.unit = s.eye_m / EYE_M;
        s.drift_m = found.drift_m = drift_of(s.low, s.high);
        status = find_points(&s);
        status = status == LW_OK ? pick(&s, &found, err) : lw_status_fail(err, status, "no memory for views");
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
    struct lw_camera_view camera = lw_camera_look_at(v->position, v->target, FOV_DEG * LW_PI / 180);
    if (!lw_fixed_views_drifts(view)) return camera;
    const double turns = time_s / (double)DRIFT_S;
    const float phase = 2 * LW_PI * (float)(turns - floor(turns));
    camera.position = lw_vec3_mad(camera.position, camera.right, views->drift_m * sinf(phase));
    return camera;
}
