/* The view of a scene that brings no camera. Candidates around its box and inside it are judged by small
 * pictures.
 *
 * The value of a picture follows viewpoint entropy (Vazquez et al. 2001): a part of the scene that takes the
 * share p of the picture adds p (1 - ln p). Many parts are better than few, and large ones better than
 * small ones. A part is the surface of an object that faces about one way: how finely it is divided into
 * triangles does not count. Its share is the less, the less light it has and the nearer it is to the eye. */
#include "client/paths/camera_default.h"

#include "client/paths/path_trace.h"
#include "common/base/box.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#define FILL        0.94f /* share of the picture that a box fills, framed from outside */
#define FOV_OUTSIDE (35.0f / 180.0f * LW_PI)
#define FOV_INSIDE  (50.0f / 180.0f * LW_PI)

#define PIXELS  512u /* a judged picture's, at most */
#define PATHS   2u   /* per pixel */
#define BOUNCES 2u
#define UNLIT   0.1f  /* what counts of a part without light */
#define DIM     0.25f /* over the picture's typical luminance: a part as dark as this is half lit */
#define NEAR    0.05f /* over the box's diagonal: a surface as near as this counts half */

#define TURNS        12u /* directions around the box, at each height */
#define HEIGHTS      5u
#define EYE_HEIGHT_M 1.6f
#define PLACES       5u  /* inside, along x and along z */
#define LOOKS        16u /* level directions from a place inside */
#define DIRECTIONS   (3 * LOOKS)

#define CANDIDATES_MAX (2 * HEIGHTS * TURNS + LOOKS)

#define SAMPLES 1024u /* triangles that stand for all */
#define STRAY   0.02f /* share of their corners that is left out at each end of an axis */
#define MARGIN  0.1f  /* added at each end for that */

struct candidate {
    struct lw_camera_view view;
    const struct lw_box *box; /* the box that it is to show */
    float prior, merit;
};

struct judge {
    const struct lw_scene *scene;
    const struct lw_pose *pose;
    const struct lw_trace *trace;
    float aspect;
    uint32_t width, height; /* the judged pictures' */
    struct lw_lights lights;
    struct lw_path_trace *tracer;
    struct lw_path_film film;
    float rgb[3 * PIXELS];
    struct candidate candidate[CANDIDATES_MAX];
    uint32_t candidate_count;
};

/* ---- what a picture is worth ---- */

/* A pixel that shows something. */
struct seen {
    uint32_t part, pixel;
    float weight; /* less if it is near */
};

static int by_part(const void *a, const void *b) {
    uint32_t x = ((const struct seen *)a)->part, y = ((const struct seen *)b)->part;
    return (x > y) - (x < y);
}

static bool meets_box(const struct lw_box *box, struct lw_vec3 from, struct lw_vec3 dir) {
    float near = 0, far = INFINITY;
    for (int i = 0; i < 3; i++) {
        float d = (&dir.x)[i], a = ((&box->low.x)[i] - (&from.x)[i]) / d,
              b = ((&box->high.x)[i] - (&from.x)[i]) / d;
        near = fmaxf(near, fminf(a, b)); /* fmaxf() and fminf() leave out NaN */
        far = fminf(far, fmaxf(a, b));
    }
    return near <= far;
}

/* Whether a hit shows something: backs of single-sided surfaces are in the way of light, and not to be
 * seen. */
static bool shows(const struct judge *j, const struct lw_hit16 *hits, unsigned lane) {
    if (hits->object[lane] == LW_TRACE_MISS) return false;
    return !hits->back[lane] || lw_trace_material(j->scene, hits, lane)->double_sided;
}

/* Part of a hit: the surface of its object that faces one of 26 directions. */
static uint32_t surface_part(const struct judge *j, uint32_t object, uint32_t triangle) {
    const struct lw_mesh *mesh = &j->scene->mesh[j->scene->object[object].mesh];
    const uint32_t *vertex = mesh->triangle[triangle];
    const struct lw_vec3 *p = mesh->position;
    struct lw_vec3 n =
        lw_vec3_cross(lw_vec3_sub(p[vertex[1]], p[vertex[0]]), lw_vec3_sub(p[vertex[2]], p[vertex[0]]));
    n = lw_affine_normal(&j->pose->object_to_world[object], n);
    return (uint32_t)(lrintf(n.x) + 1 + 3 * (lrintf(n.y) + 1) + 9 * (lrintf(n.z) + 1)) + 27 * object;
}

static float luminance(const float *rgb) { return 0.2126f * rgb[0] + 0.7152f * rgb[1] + 0.0722f * rgb[2]; }

/* Finds the pixels that show something, in order of their parts. out_used: pixels that do, or look into the
 * box. */
static uint32_t find_seen(const struct judge *j, const struct candidate *c, struct seen *out,
                          uint32_t *out_used) {
    const struct lw_camera_plane plane = lw_camera_plane(&c->view, j->width, j->height);
    const uint32_t count = j->width * j->height;
    const float near_m = NEAR * lw_vec3_length(lw_box_size(c->box));
    uint32_t seen_count = 0, used = 0;
    for (uint32_t first = 0; first < count; first += LW_TRACE_WIDTH) {
        struct lw_ray16 rays = {.salt = 0};
        struct lw_hit16 hits;
        struct lw_vec3 dir[LW_TRACE_WIDTH];
        for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) {
            uint32_t x = (first + i) % j->width, y = (first + i) / j->width;
            dir[i] = lw_camera_direction(&plane, (float)x + 0.5f, (float)y + 0.5f);
            lw_trace_set_ray(&rays, i, c->view.position, dir[i], INFINITY);
        }
        lw_trace_closest16(j->trace, LW_TRACE_LIGHT, 0xffff, &rays, &hits);
        for (uint32_t i = 0; i < LW_TRACE_WIDTH && first + i < count; i++) {
            bool shown = shows(j, &hits, i);
            used += shown || meets_box(c->box, c->view.position, dir[i]);
            if (!shown) continue;
            out[seen_count++] = (struct seen){.part = surface_part(j, hits.object[i], hits.triangle[i]),
                                              .pixel = first + i,
                                              .weight = hits.t[i] / (hits.t[i] + near_m)};
        }
    }
    qsort(out, seen_count, sizeof *out, by_part);
    *out_used = used;
    return seen_count;
}

/* The merit of a candidate's picture. Without light everything counts as lit: no light makes it more. */
static float merit_of(struct judge *j, const struct candidate *c, bool light) {
    struct seen seen[PIXELS];
    uint32_t used, count = find_seen(j, c, seen, &used);
    if (count == 0) return 0;
    float dim = 0;
    if (light) {
        lw_path_film_clear(&j->film);
        lw_path_trace_render(j->tracer,
                             &(struct lw_path_view){.camera = c->view,
                                                    .bounces = BOUNCES,
                                                    .pixel = LW_PATH_PIXEL_CENTRE,
                                                    .pattern = LW_PATH_PATTERN_INTERLEAVED},
                             PATHS, &j->film, NULL);
        lw_path_film_resolve(&j->film, j->rgb);
        for (uint32_t i = 0; i < count; i++) /* mean of roots: a lamp in the picture must not rule it */
            dim += sqrtf(luminance(j->rgb + 3 * seen[i].pixel)) / (float)count;
        dim *= DIM * dim;
    }
    float merit = 0;
    for (uint32_t i = 0, end; i < count; i = end) {
        float sum = 0, share = 0;
        for (end = i; end < count && seen[end].part == seen[i].part; end++) {
            share += seen[end].weight / (float)used;
            if (light) sum += luminance(j->rgb + 3 * seen[end].pixel);
        }
        float mean = sum / (float)(end - i);
        if (light) share *= UNLIT + (1 - UNLIT) * mean / (mean + dim + 1e-30f);
        if (share > 0) merit += share * (1 - logf(share));
    }
    return c->prior * merit * powf((float)used / (float)(j->width * j->height), 0.25f);
}

static void consider(struct judge *j, struct lw_camera_view view, const struct lw_box *box, float prior) {
    assert(j->candidate_count < CANDIDATES_MAX);
    struct candidate *c = &j->candidate[j->candidate_count++];
    *c = (struct candidate){.view = view, .box = box, .prior = prior};
    c->merit = merit_of(j, c, false);
}

/* ---- from outside ---- */

/* The view in a direction from as near as a box fits into the picture. A corner at x to the right and z
 * towards the eye is in it if |x - x0| <= slope (distance - z): that bounds distance + x0 / slope and
 * distance - x0 / slope from below. */
static struct lw_camera_view frame(const struct lw_box *box, struct lw_vec3 forward, float aspect) {
    struct lw_camera_view view = lw_camera_look_at(lw_vec3(0, 0, 0), forward, FOV_OUTSIDE);
    struct lw_vec3 size = lw_box_size(box), centre = lw_vec3_mad(box->low, size, 0.5f);
    const float up = FILL * tanf(0.5f * FOV_OUTSIDE), right = up * aspect;
    float bound[4] = {0, 0, 0, 0}; /* the centre's */
    for (int i = 0; i < 8; i++) {
        struct lw_vec3 corner = lw_vec3((i & 1 ? 0.5f : -0.5f) * size.x, (i & 2 ? 0.5f : -0.5f) * size.y,
                                        (i & 4 ? 0.5f : -0.5f) * size.z);
        float x = lw_vec3_dot(corner, view.right) / right, y = lw_vec3_dot(corner, view.up) / up,
              z = -lw_vec3_dot(corner, view.forward);
        bound[0] = fmaxf(bound[0], z + x);
        bound[1] = fmaxf(bound[1], z - x);
        bound[2] = fmaxf(bound[2], z + y);
        bound[3] = fmaxf(bound[3], z - y);
    }
    float distance = 0.5f * fmaxf(bound[0] + bound[1], bound[2] + bound[3]);
    view.position = lw_vec3_mad(centre, view.right, 0.5f * right * (bound[0] - bound[1]));
    view.position = lw_vec3_mad(view.position, view.up, 0.5f * up * (bound[2] - bound[3]));
    view.position = lw_vec3_mad(view.position, view.forward, -fmaxf(distance, 1e-6f));
    return view;
}

static void consider_outside(struct judge *j, const struct lw_box *box) {
    /* People look at things from the front, level or from a little above. */
    static const struct {
        float degrees, prior;
    } height[HEIGHTS] = {{25, 1}, {0, 1}, {50, 0.9f}, {85, 0.7f}, {-40, 0.5f}};
    for (unsigned h = 0; h < HEIGHTS; h++)
        for (unsigned turn = 0; turn < TURNS; turn++) {
            float up = height[h].degrees / 180 * LW_PI, about = 2 * LW_PI * (float)turn / TURNS;
            struct lw_vec3 forward = lw_vec3(-cosf(up) * sinf(about), -sinf(up), -cosf(up) * cosf(about));
            consider(j, frame(box, forward, j->aspect), box, height[h].prior * (1 + 0.05f * cosf(about)));
        }
}

/* ---- from inside ---- */

/* Distances to the surfaces around a point, at most far_m; 0 where a surface does not show. Returns the share
 * of directions in which something is seen. */
static float free_distances(const struct judge *j, struct lw_vec3 from, const struct lw_vec3 *dir,
                            float far_m, float *out) {
    unsigned seen = 0;
    for (unsigned first = 0; first < DIRECTIONS; first += LW_TRACE_WIDTH) {
        struct lw_ray16 rays = {.salt = 0};
        struct lw_hit16 hits;
        for (unsigned i = 0; i < LW_TRACE_WIDTH; i++)
            lw_trace_set_ray(&rays, i, from, dir[first + i], INFINITY);
        lw_trace_closest16(j->trace, LW_TRACE_LIGHT, 0xffff, &rays, &hits);
        for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
            bool shown = shows(j, &hits, i);
            out[first + i] = hits.object[i] == LW_TRACE_MISS ? far_m : shown ? fminf(hits.t[i], far_m) : 0;
            seen += shown;
        }
    }
    return (float)seen / DIRECTIONS;
}

static void consider_inside(struct judge *j, const struct lw_box *box) {
    struct lw_vec3 size = lw_box_size(box), dir[DIRECTIONS];
    const float far_m = lw_vec3_length(size);
    /* Files in centimetres make people of two storeys' height: the eye then goes by the scene, not by the
     * metre. */
    const float eye_m = fminf(fmaxf(EYE_HEIGHT_M, 0.15f * size.y), 0.5f * size.y);
    /* Level ones, then as many up and as many down by 30 degrees. */
    static const float rise[3] = {0, 0.5f, -0.5f};
    for (unsigned i = 0; i < DIRECTIONS; i++) {
        float angle = 2 * LW_PI * (float)i / LOOKS, y = rise[i / LOOKS], r = sqrtf(1 - y * y);
        dir[i] = lw_vec3(r * sinf(angle), y, r * cosf(angle));
    }
    /* The middle may be inside a column: of places around it the one with most room and fewest ways out is
     * taken. */
    struct lw_vec3 best = box->low;
    float best_free_m[DIRECTIONS], best_sum_m = 0, prior = 0;
    for (unsigned place = 0; place < PLACES * PLACES; place++) {
        struct lw_vec3 at =
            lw_vec3(box->low.x + size.x * (0.3f + 0.1f * (float)(place % PLACES)), box->low.y + eye_m,
                    box->low.z + size.z * (0.3f + 0.1f * (float)(place / PLACES)));
        float free_m[DIRECTIONS], closed = free_distances(j, at, dir, far_m, free_m), sum_m = 0;
        for (unsigned i = 0; i < DIRECTIONS; i++) sum_m += closed * closed * free_m[i];
        if (sum_m <= best_sum_m) continue;
        best_sum_m = sum_m, best = at, prior = closed;
        memcpy(best_free_m, free_m, sizeof free_m);
    }
    if (best_sum_m == 0) return;
    for (unsigned i = 0; i < LOOKS; i++) {
        /* Step back towards the wall behind: more of the room comes into the picture. */
        float behind_m = best_free_m[(i + LOOKS / 2) % LOOKS];
        if (behind_m >= far_m) behind_m = 0;
        struct lw_camera_view view = lw_camera_look_at(lw_vec3(0, 0, 0), dir[i], FOV_INSIDE);
        view.position = lw_vec3_mad(best, dir[i], -0.8f * behind_m);
        consider(j, view, box, prior * powf((best_free_m[i] + 0.8f * behind_m) / far_m, 0.25f));
    }
}

/* ---- the whole ---- */

static int by_merit(const void *a, const void *b) {
    float x = ((const struct candidate *)a)->merit, y = ((const struct candidate *)b)->merit;
    return (x < y) - (x > y);
}

static int by_value(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* The box of nearly all triangles: without the ground that goes on to the horizon. False if there is no
 * triangle. */
static bool find_body(const struct lw_scene *scene, const struct lw_pose *pose, const struct lw_box *whole,
                      struct lw_box *out) {
    uint64_t total = 0, passed = 0;
    for (uint32_t o = 0; o < scene->object_count; o++)
        if (!pose->object_dynamic[o]) total += scene->mesh[scene->object[o].mesh].triangle_count;
    if (total == 0) return false;
    const uint64_t step = (total + SAMPLES - 1) / SAMPLES;
    float at[3][3 * SAMPLES];
    uint32_t count = 0;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (pose->object_dynamic[o]) continue;
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        for (uint64_t t = (step - passed % step) % step; t < mesh->triangle_count; t += step)
            for (int corner = 0; corner < 3; corner++, count++) {
                struct lw_vec3 p =
                    lw_affine_point(&pose->object_to_world[o], mesh->position[mesh->triangle[t][corner]]);
                at[0][count] = p.x, at[1][count] = p.y, at[2][count] = p.z;
            }
        passed += mesh->triangle_count;
    }
    for (int i = 0; i < 3; i++) {
        qsort(at[i], count, sizeof **at, by_value);
        uint32_t stray = (uint32_t)(STRAY * (float)count);
        const float low = at[i][stray], high = at[i][count - 1 - stray], margin = MARGIN * (high - low);
        (&out->low.x)[i] = fmaxf((&whole->low.x)[i], low - margin);
        (&out->high.x)[i] = fminf((&whole->high.x)[i], high + margin);
    }
    return true;
}

/* Gets ready to light pictures. Errors: LW_NO_MEMORY. */
static enum lw_status light_up(struct judge *j) {
    enum lw_status status = lw_lights_init(&j->lights, j->scene, j->pose);
    const struct lw_path_trace_desc desc = {
        .scene = j->scene, .trace = j->trace, .lights = &j->lights, .pose = j->pose, .threads = 1};
    if (status == LW_OK) status = lw_path_trace_create(&desc, &j->tracer, NULL);
    if (status == LW_OK) status = lw_path_film_init(&j->film, j->width, j->height, NULL);
    return status;
}

struct lw_camera_view lw_camera_default(const struct lw_scene *scene, const struct lw_pose *pose,
                                        const struct lw_trace *trace, float aspect) {
    struct lw_box whole, body;
    if (!lw_pose_bounds(pose, scene, &whole.low, &whole.high) || !find_body(scene, pose, &whole, &body))
        return lw_camera_look_at(lw_vec3(0, 0, 1), lw_vec3(0, 0, 0), FOV_INSIDE);
    struct lw_camera_view best = frame(&whole, lw_vec3(-0.45f, -0.4f, -0.8f), aspect);
    struct judge *j = calloc(1, sizeof *j);
    if (j == NULL) return best;
    *j = (struct judge){.scene = scene, .pose = pose, .trace = trace, .aspect = aspect};
    j->height = (uint32_t)fminf(fmaxf(sqrtf(PIXELS / aspect), 1), PIXELS);
    j->width = PIXELS / j->height;
    consider_outside(j, &whole);
    if (memcmp(&body, &whole, sizeof body) != 0) consider_outside(j, &body);
    consider_inside(j, &body);
    /* Light only takes from a merit: once the best lit one beats those to come unlit, it stays the best. */
    qsort(j->candidate, j->candidate_count, sizeof *j->candidate, by_merit);
    const bool light = light_up(j) == LW_OK;
    float best_merit = 0;
    for (uint32_t i = 0; i < j->candidate_count && j->candidate[i].merit > best_merit; i++) {
        const struct candidate *c = &j->candidate[i];
        float merit = light ? merit_of(j, c, true) : c->merit;
        if (merit > best_merit) best_merit = merit, best = c->view;
    }
    lw_path_film_finish(&j->film);
    lw_path_trace_destroy(j->tracer);
    lw_lights_finish(&j->lights);
    free(j);
    return best;
}
