#include "client/paths/instant_radiosity.h"

#include "client/paths/reprojection.h"
#include "client/paths/shot_lights.h"
#include "common/light/form16.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

#define LANES  LW_TRACE_WIDTH
#define SIDE   4u            /* pixels that share the lights of a set, each way */
#define KINDS  (SIDE * SIDE) /* kinds of pixels: each has lights of its own */
#define SQUARE (4u * SIDE)   /* pixels; the side of what has a packet of each kind */

_Static_assert(SQUARE / SIDE * (SQUARE / SIDE) == LANES, "a packet is all pixels of a kind in a square");

/* Pixels are of one surface where they are so near to each other: pixels' breadth off the tangent plane;
 * cosine of normals. */
#define APART_MAX  1.0f
#define COSINE_MIN 0.9f

struct lw_instant_radiosity {
    struct lw_instant_radiosity_desc desc;
    uint32_t sets;
    int threads;
    float near_m; /* 0: not known yet */
    struct lw_shot_lights lights;
    uint32_t set;  /* this frame's */
    float *raw[3]; /* E of a pixel by its lights of the set, times KINDS */
    float *memory; /* holds raw */
    /* History of pixels: the previous frame's, and this one's. */
    struct kept {
        struct lw_reprojection_surface *surface;
        uint32_t *has; /* a bit for each set whose light is there */
        float *e;      /* three per set, per pixel */
    } past, next;
    struct lw_reprojection before;
    bool started;
};

static enum lw_status init_kept(struct kept *kept, size_t pixels, uint32_t sets) {
    kept->surface = malloc((pixels + 1) * sizeof *kept->surface);
    kept->has = calloc(pixels + 1, sizeof *kept->has);
    kept->e = calloc(pixels * sets * 3 + 1, sizeof *kept->e);
    return kept->surface && kept->has && kept->e ? LW_OK : LW_NO_MEMORY;
}

static void finish_kept(struct kept *kept) {
    free(kept->e);
    free(kept->has);
    free(kept->surface);
}

static enum lw_status check(const struct lw_instant_radiosity_desc *desc, struct lw_error *err) {
    const struct lw_instant_radiosity_terms *t = &desc->terms;
    if (t->lights > LW_INSTANT_RADIOSITY_LIGHTS_MAX)
        return lw_status_fail(err, LW_USAGE, "%u virtual point lights; there are at most %u", t->lights,
                              LW_INSTANT_RADIOSITY_LIGHTS_MAX);
    if (t->sets > LW_INSTANT_RADIOSITY_SETS_MAX)
        return lw_status_fail(err, LW_USAGE, "%u sets of virtual point lights; there are at most %u", t->sets,
                              LW_INSTANT_RADIOSITY_SETS_MAX);
    if ((uint64_t)t->sets * desc->bounces > t->lights)
        return lw_status_fail(err, LW_USAGE, "%u virtual point lights are too few for %u sets of %u bounces",
                              t->lights, t->sets, desc->bounces);
    if (!(t->near_m >= 0 && isfinite(t->near_m)))
        return lw_status_fail(err, LW_USAGE, "virtual point lights: d0 is %g m", (double)t->near_m);
    return LW_OK;
}

enum lw_status lw_instant_radiosity_create(const struct lw_instant_radiosity_desc *desc,
                                           struct lw_instant_radiosity **out, struct lw_error *err) {
    struct lw_instant_radiosity *r = calloc(1, sizeof *r);
    if (!r) return lw_status_fail(err, LW_NO_MEMORY, "no memory for virtual point lights");
    r->desc = *desc;
    struct lw_instant_radiosity_terms *t = &r->desc.terms;
    if (!t->lights) t->lights = LW_INSTANT_RADIOSITY_LIGHTS_DEFAULT;
    if (!t->sets) t->sets = LW_INSTANT_RADIOSITY_SETS_DEFAULT;
    enum lw_status status = check(&r->desc, err);
    if (status != LW_OK) {
        free(r);
        return status;
    }
    const size_t pixels = (size_t)desc->width * desc->height;
    r->sets = t->sets;
    r->near_m = t->near_m;
    r->threads = desc->threads ? (int)desc->threads : omp_get_max_threads();
    r->memory = calloc(3 * pixels + 1, sizeof *r->memory);
    for (int c = 0; c < 3; c++) r->raw[c] = r->memory + (size_t)c * pixels;
    status = r->memory ? init_kept(&r->past, pixels, r->sets) : LW_NO_MEMORY;
    if (status == LW_OK) status = init_kept(&r->next, pixels, r->sets);
    if (status == LW_OK)
        status = lw_shot_lights_init(&r->lights, &(struct lw_shot_lights_desc){.scene = desc->scene,
                                                                               .trace = desc->trace,
                                                                               .lights = desc->lights,
                                                                               .lights_max = t->lights,
                                                                               .bounces = desc->bounces,
                                                                               .sets = t->sets});
    if (status == LW_OK) {
        *out = r;
        return LW_OK;
    }
    lw_instant_radiosity_destroy(r);
    return lw_status_fail(err, status, "no memory for virtual point lights on pictures of %ux%u pixels",
                          desc->width, desc->height);
}

void lw_instant_radiosity_destroy(struct lw_instant_radiosity *r) {
    if (!r) return;
    lw_shot_lights_finish(&r->lights);
    finish_kept(&r->next);
    finish_kept(&r->past);
    free(r->memory);
    free(r);
}

float lw_instant_radiosity_near_m(const struct lw_instant_radiosity *r) { return r->near_m; }

/* ---- shade ---- */

static bool reflects(const struct lw_gbuffer_planes *g, size_t at) {
    return g->object[at] != LW_TRACE_MISS && g->albedo[0][at] + g->albedo[1][at] + g->albedo[2][at] > 0;
}

/* The pixels of a kind in a square, those beyond the picture or without a surface as the last that has one.
 * Returns which have. */
static uint16_t gather(const struct lw_gbuffer *g, uint32_t left, uint32_t top, uint32_t kind,
                       struct lw_points16 *points, size_t at[LANES]) {
    uint16_t active = 0;
    uint32_t any = LANES;
    for (uint32_t i = 0; i < LANES; i++) {
        const uint32_t x = left + kind % SIDE + i % SIDE * SIDE, y = top + kind / SIDE + i / SIDE * SIDE;
        at[i] = (size_t)y * g->width + x;
        if (x >= g->width || y >= g->height || !reflects(&g->plane, at[i])) continue;
        active |= (uint16_t)(1u << i);
        any = i;
    }
    for (uint32_t i = 0; i < LANES && any < LANES; i++) {
        const size_t from = active >> i & 1u ? at[i] : at[any];
        points->x[i] = g->plane.origin[0][from];
        points->y[i] = g->plane.origin[1][from];
        points->z[i] = g->plane.origin[2][from];
        points->nx[i] = g->plane.normal[0][from];
        points->ny[i] = g->plane.normal[1][from];
        points->nz[i] = g->plane.normal[2][from];
    }
    return active;
}

struct sum {
    _Alignas(64) float e[3][LANES];
};

/* One light, for one packet. Returns rays. */
static unsigned shine(const struct lw_instant_radiosity *r, const struct lw_shot_light *light,
                      const struct lw_points16 *points, uint16_t active, struct lw_ray16 *rays,
                      struct sum *sum) {
    _Alignas(64) float weight[LANES];
    float tint[3][LANES];
    if (!(light->flux_w[0] + light->flux_w[1] + light->flux_w[2] > 0)) return 0;
    lw_form16_weigh(points, light->position, light->normal, 0, r->near_m * r->near_m, weight);
    active &= lw_form16_lit(weight);
    if (!active) return 0;
    lw_form16_aim(points, light->position, rays);
    const bool tints = lw_trace_tints(r->desc.trace);
    const uint16_t hidden = tints ? lw_trace_tinted16(r->desc.trace, LW_TRACE_COHERENT, active, rays, tint)
                                  : lw_trace_occluded16(r->desc.trace, LW_TRACE_COHERENT, active, rays);
    for (int i = 0; i < LANES; i++)
        if (!((active & ~hidden) >> i & 1)) weight[i] = 0;
    lw_form16_add(weight, light->flux_w, sum->e);
    for (int c = 0; tints && c < 3; c++) /* what the tints add to 1 */
        for (int i = 0; i < LANES; i++)
            if (weight[i] > 0) sum->e[c][i] += weight[i] * light->flux_w[c] * (tint[c][i] - 1);
    return (unsigned)__builtin_popcount(active);
}

/* Lights of a set are dealt to the kinds bounce by bounce, so that each kind has all bounces. */
static uint64_t shade_kind(const struct lw_instant_radiosity *r, const struct lw_gbuffer *g, uint32_t left,
                           uint32_t top, uint32_t kind) {
    const struct lw_virtual_paths *paths = &r->lights.paths;
    const uint32_t per_set = paths->paths / paths->sets, first = r->set * per_set;
    struct lw_points16 points;
    size_t at[LANES];
    struct sum sum = {.e = {{0}}};
    uint64_t count = 0;
    const uint16_t active = gather(g, left, top, kind, &points, at);
    if (!active) return 0;
    struct lw_ray16 rays = {.salt = r->lights.salt};
    lw_form16_start(&points, &rays);
    for (uint32_t k = kind; k < per_set * paths->bounces; k += KINDS) {
        const uint32_t light = lw_virtual_paths_light(paths, first + k % per_set, k / per_set);
        count += shine(r, &r->lights.light[light], &points, active, &rays, &sum);
    }
    for (uint32_t i = 0; i < LANES; i++)
        for (int c = 0; active >> i & 1u && c < 3; c++) r->raw[c][at[i]] = (float)KINDS * sum.e[c][i];
    return count;
}

uint64_t lw_instant_radiosity_shade(struct lw_instant_radiosity *r, const struct lw_gbuffer *g,
                                    const struct lw_pose *pose, uint32_t seed, uint32_t number) {
    uint64_t rays = lw_shot_lights_step(&r->lights, pose, seed);
    r->set = number % r->sets;
    if (!r->lights.paths.paths) return rays;
    if (!(r->near_m > 0))
        r->near_m = lw_virtual_paths_near_m(&r->lights.paths, lw_shot_lights_area_m2(r->desc.scene, pose));
    const uint32_t columns = (g->width + SQUARE - 1) / SQUARE, rows = (g->height + SQUARE - 1) / SQUARE;
#pragma omp parallel for schedule(dynamic) num_threads(r->threads) reduction(+ : rays)
    for (uint32_t t = 0; t < columns * rows; t++)
        for (uint32_t kind = 0; kind < KINDS; kind++)
            rays += shade_kind(r, g, t % columns * SQUARE, t / columns * SQUARE, kind);
    return rays;
}

/* ---- filter, and sum of sets ---- */

/* The mean over 4 x 4 pixels around one, each kind once, of those on its surface. */
static void filter(const struct lw_instant_radiosity *r, const struct lw_gbuffer *g, uint32_t x, uint32_t y,
                   float out[3]) {
    const struct lw_gbuffer_planes *p = &g->plane;
    const size_t at = (size_t)y * g->width + x;
    const float depth = p->depth[at], slope_x = p->slope[0][at], slope_y = p->slope[1][at],
                apart = p->apart[at];
    const struct lw_vec3 normal = lw_gbuffer_load3(p->normal, at);
    float sum[3] = {0};
    int count = 0;
    /* The further two are on the side of the middle of the pixel's own square. */
    const int left = x % SIDE < SIDE / 2 ? -1 : -2, top = y % SIDE < SIDE / 2 ? -1 : -2;
    for (int dy = top; dy < top + (int)SIDE; dy++)
        for (int dx = left; dx < left + (int)SIDE; dx++) {
            const uint32_t px = x + (uint32_t)dx, py = y + (uint32_t)dy; /* below 0: beyond it as well */
            if (px >= g->width || py >= g->height) continue;
            const size_t q = (size_t)py * g->width + px;
            if (!reflects(p, q)) continue;
            const float off = p->depth[q] - depth - slope_x * (float)dx - slope_y * (float)dy;
            if (!(fabsf(off) * apart <= APART_MAX)) continue;
            if (!(lw_vec3_dot(normal, lw_gbuffer_load3(p->normal, q)) >= COSINE_MIN)) continue;
            for (int c = 0; c < 3; c++) sum[c] += r->raw[c][q];
            count++;
        }
    for (int c = 0; c < 3; c++) out[c] = count ? sum[c] / (float)count : 0;
}

/* The pixel of the picture before that shows a pixel's point: the nearest that serves. */
static bool find_past(const struct lw_instant_radiosity *r, const struct lw_gbuffer *g, size_t at,
                      size_t *out_past) {
    float x, y, depth, nearest = INFINITY;
    if (!r->started ||
        !lw_reprojection_find(&r->before, lw_gbuffer_load3(g->plane.before, at), &x, &y, &depth))
        return false;
    const struct lw_vec3 normal = lw_gbuffer_load3(g->plane.normal, at);
    const int left = (int)floorf(x), top = (int)floorf(y);
    for (int i = 0; i < 4; i++) {
        const int px = left + (i & 1), py = top + (i >> 1);
        const float dx = x - (float)px, dy = y - (float)py, distance = dx * dx + dy * dy;
        if (px < 0 || py < 0 || px >= (int)g->width || py >= (int)g->height || distance >= nearest) continue;
        const size_t past = (size_t)py * g->width + (size_t)px;
        if (!r->past.has[past] ||
            !lw_reprojection_serves(&r->past.surface[past], dx, dy, depth, g->plane.object[at], normal))
            continue;
        nearest = distance;
        *out_past = past;
    }
    return nearest < INFINITY;
}

static void add_row(struct lw_instant_radiosity *r, const struct lw_gbuffer *g, uint32_t y, float *rgb) {
    const uint32_t sets = r->sets;
    for (uint32_t x = 0; x < g->width; x++) {
        const size_t at = (size_t)y * g->width + x, floats = 3ul * sets;
        float *e = r->next.e + at * floats, sum[3] = {0};
        size_t past = 0;
        uint32_t has = 0;
        r->next.has[at] = 0;
        if (!reflects(&g->plane, at)) continue;
        r->next.surface[at] = lw_reprojection_surface_of(&g->plane, at);
        if (sets > 1 && find_past(r, g, at, &past)) {
            memcpy(e, r->past.e + past * floats, floats * sizeof *e);
            has = r->past.has[past];
        }
        filter(r, g, x, y, e + 3ul * r->set);
        r->next.has[at] = has |= 1u << r->set;
        for (uint32_t s = 0; s < sets; s++)
            for (int c = 0; has >> s & 1u && c < 3; c++) sum[c] += e[3 * s + (uint32_t)c];
        /* Sets that are missing count as the mean of those that are there. */
        const float scale = (float)sets / ((float)__builtin_popcount(has) * LW_PI);
        for (int c = 0; c < 3; c++) rgb[3 * at + (size_t)c] += scale * sum[c] * g->plane.albedo[c][at];
    }
}

void lw_instant_radiosity_add(struct lw_instant_radiosity *r, const struct lw_gbuffer *g, float *rgb) {
    if (!r->lights.paths.paths) return;
#pragma omp parallel for schedule(dynamic, 8) num_threads(r->threads)
    for (uint32_t y = 0; y < g->height; y++) add_row(r, g, y, rgb);
    const struct kept past = r->past;
    r->past = r->next;
    r->next = past;
    r->before = lw_reprojection_of(g);
    r->started = true;
}
