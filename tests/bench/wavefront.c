#include "tests/bench/wavefront.h"

#include "client/view/path_trace.h"
#include "client/view/place.h"
#include "common/clock.h"
#include "common/light/direction.h"
#include "common/random.h"

#include <assert.h>
#include <stdlib.h>

#define LANES     ((uint32_t)LW_TRACE_WIDTH)
#define TILE      32u /* pixels; wavefronts take tile by tile, and there square by square */
#define PATH_BITS 24  /* of a key; those above are what it sorts by */
#define CELLS     1024
_Static_assert(WAVEFRONT_SIDE_MAX *WAVEFRONT_SIDE_MAX <= 1u << PATH_BITS, "a key has room for any path");

/* What a pair of random numbers is for. */
enum { USE_PIXEL, USE_LAYER, USE_PICK, USE_LAMP, USE_BOUNCE, USE_COUNT };

/* First of the three planes of a vector. DIRECTION: of the ray that is traced next, or was last. */
enum { ORIGIN = 0, NORMAL = 3, DIRECTION = 6, THROUGHPUT = 9, RADIANCE = 12, PLANES = 15 };

/* Paths in a structure of arrays. Of 128 bytes a path in one piece, against this: 0.95 of the time for queues
 * of 1,024, 1.2 of it for sorted ones of 57,600 (Cornell). */
struct wavefront {
    struct wavefront_desc desc;
    struct lw_place *place; /* per object */
    struct lw_camera_plane camera;
    struct lw_vec3 minimum_ws;
    float cells_per_m;             /* of the grid whose cells are in Morton order */
    bool rays_may_shine;           /* a bounce ray may meet light */
    uint32_t pixel_count, *pixels; /* y << 16 | x, in the order that paths take them */
    /* Of the paths under way. A path's hit is lane path % 16 of hit[path / 16]. */
    enum wavefront_order by;
    uint32_t seed, sample, going; /* queue[0 .. going - 1] */
    uint64_t sort_ns, *key, *spare;
    const uint32_t *pixel;
    uint32_t *queue;
    float *state, *plane[PLANES];
    struct lw_hit16 *hit;
};

static struct lw_vec3 get(const struct wavefront *w, int what, uint32_t path) {
    return lw_vec3(w->plane[what][path], w->plane[what + 1][path], w->plane[what + 2][path]);
}

static void put(struct wavefront *w, int what, uint32_t path, struct lw_vec3 v) {
    w->plane[what][path] = v.x;
    w->plane[what + 1][path] = v.y;
    w->plane[what + 2][path] = v.z;
}

static void add_radiance(struct wavefront *w, uint32_t path, struct lw_vec3 arriving) {
    put(w, RADIANCE, path, lw_vec3_add(get(w, RADIANCE, path), arriving));
}

static void draw(const struct wavefront *w, uint32_t path, uint32_t use, uint32_t depth, float out[2]) {
    lw_random_sobol2(w->sample, lw_random_hash3(w->seed, w->pixel[path], depth * USE_COUNT + use), out);
}

static const struct lw_mesh *mesh_of(const struct wavefront *w, uint32_t object) {
    return &w->desc.scene->mesh[w->desc.scene->object[object].mesh];
}

/* ---- sorting ---- */

/* The low 10 bits, each two places from the next. */
static uint64_t spread(uint32_t v) {
    v = (v | v << 16) & 0x030000ffu;
    v = (v | v << 8) & 0x0300f00fu;
    v = (v | v << 4) & 0x030c30c3u;
    return (v | v << 2) & 0x09249249u;
}

static uint64_t place_key(const struct wavefront *w, uint32_t path) {
    const struct lw_vec3 at = lw_vec3_sub(get(w, ORIGIN, path), w->minimum_ws);
    const float along[3] = {at.x, at.y, at.z};
    uint64_t key = 0;
    for (int axis = 0; axis < 3; axis++)
        key |= spread((uint32_t)fminf(fmaxf(along[axis] * w->cells_per_m, 0), CELLS - 1)) << axis;
    return key;
}

static uint64_t key_of(const struct wavefront *w, uint32_t path) {
    if (w->by == WAVEFRONT_BY_MATERIAL) {
        const struct lw_hit16 *hits = &w->hit[path / LANES];
        const uint32_t i = path % LANES, object = hits->object[i];
        return object == LW_TRACE_MISS ? 0 : 1 + (uint64_t)mesh_of(w, object)->material[hits->triangle[i]];
    }
    const struct lw_vec3 n = get(w, NORMAL, path), d = get(w, DIRECTION, path);
    const uint64_t octant = (d.x < 0) | (d.y < 0) << 1 | (d.z < 0) << 2;
    const uint64_t side = (uint64_t)(3.5f + 3 * n.x) << 6 | (uint64_t)(3.5f + 3 * n.y) << 3 |
                          (uint64_t)(3.5f + 3 * n.z); /* 0 falls into the middle of a bin */
    return (w->by == WAVEFRONT_BY_NORMAL ? side : octant) << 30 | place_key(w, path);
}

/* By radix, from the lowest byte on. A byte that all keys share is counted and left. */
static void sort_keys(struct wavefront *w) {
    for (int shift = PATH_BITS; shift < 64; shift += 8) {
        uint32_t end[256] = {0};
        for (uint32_t i = 0; i < w->going; i++) end[w->key[i] >> shift & 255u]++;
        if (end[w->key[0] >> shift & 255u] == w->going) continue;
        for (int value = 1; value < 256; value++) end[value] += end[value - 1];
        for (uint32_t i = w->going; i-- > 0;) w->spare[--end[w->key[i] >> shift & 255u]] = w->key[i];
        uint64_t *sorted = w->spare;
        w->spare = w->key;
        w->key = sorted;
    }
}

static void sort_queue(struct wavefront *w) {
    const uint64_t began_ns = lw_clock_thread_cpu_ns();
    for (uint32_t i = 0; i < w->going; i++) w->key[i] = key_of(w, w->queue[i]) << PATH_BITS | w->queue[i];
    sort_keys(w);
    for (uint32_t i = 0; i < w->going; i++) w->queue[i] = (uint32_t)w->key[i] & ((1u << PATH_BITS) - 1u);
    w->sort_ns += lw_clock_thread_cpu_ns() - began_ns;
}

/* ---- stages ---- */

static void keep_hit(struct wavefront *w, uint32_t path, const struct lw_hit16 *hits, uint32_t i) {
    struct lw_hit16 *kept = &w->hit[path / LANES];
    const uint32_t lane = path % LANES;
    kept->t[lane] = hits->t[i], kept->u[lane] = hits->u[i], kept->v[lane] = hits->v[i];
    kept->object[lane] = hits->object[i], kept->triangle[lane] = hits->triangle[i];
    kept->back[lane] = hits->back[i];
}

static void surface_at(const struct wavefront *w, const struct lw_hit16 *hits, uint32_t i,
                       struct lw_surface *out) {
    lw_scene_surface(w->desc.scene, mesh_of(w, hits->object[i]), hits->triangle[i], hits->u[i], hits->v[i],
                     out);
}

/* Whether a path from the eye goes on behind the surface that it has met: by chance, of BLEND surfaces. */
static bool passes(struct wavefront *w, uint32_t path, const struct lw_hit16 *hits, uint32_t i,
                   unsigned layer, float *transmittance) {
    if (hits->object[i] == LW_TRACE_MISS || layer == LW_PATH_TRACE_LAYERS_MAX ||
        lw_trace_material(w->desc.scene, hits, i)->alpha_mode != LW_ALPHA_BLEND)
        return false;
    struct lw_surface surface;
    float choice[2];
    surface_at(w, hits, i, &surface);
    draw(w, path, USE_LAYER, 0, choice);
    *transmittance *= 1 - surface.alpha;
    if (choice[0] >= *transmittance) return false;
    put(w, THROUGHPUT, path, lw_material_tint(surface.material, get(w, THROUGHPUT, path)));
    return true;
}

static void set_eye_ray(struct wavefront *w, uint32_t path, struct lw_ray16 *rays, uint32_t i) {
    float jitter[2];
    draw(w, path, USE_PIXEL, 0, jitter);
    const float x = (float)(w->pixel[path] & 0xffffu) + jitter[0];
    const float y = (float)(w->pixel[path] >> 16) + jitter[1];
    const struct lw_vec3 direction = lw_camera_direction(&w->camera, x, y);
    lw_trace_set_ray(rays, i, lw_camera_origin(&w->camera, x, y), direction, INFINITY);
    put(w, DIRECTION, path, lw_vec3_normalize(direction));
    put(w, THROUGHPUT, path, lw_vec3(1, 1, 1));
    put(w, RADIANCE, path, lw_vec3(0, 0, 0));
}

static void look16(struct wavefront *w, const uint32_t *path, uint32_t lanes) {
    struct lw_ray16 rays = {.salt = w->sample};
    struct lw_hit16 hits;
    float transmittance[LW_TRACE_WIDTH];
    uint16_t looking = (uint16_t)((1u << lanes) - 1u);
    for (uint32_t i = 0; i < lanes; i++) {
        set_eye_ray(w, path[i], &rays, i);
        transmittance[i] = 1;
    }
    for (unsigned layer = 1; looking; layer++) {
        uint16_t go_on = 0;
        lw_trace_closest16(w->desc.trace, LW_TRACE_VIEW | LW_TRACE_COHERENT, looking, &rays, &hits);
        for (uint32_t i = 0; i < lanes; i++) {
            if (!(looking >> i & 1u)) continue;
            keep_hit(w, path[i], &hits, i);
            if (!passes(w, path[i], &hits, i, layer, &transmittance[i])) continue;
            rays.t_near[i] = hits.t[i] * (1.0f + 4e-6f) + 1e-7f;
            go_on |= (uint16_t)(1u << i);
        }
        looking = go_on;
    }
}

/* The power heuristic. */
static float weight_of(float own, float other) {
    const float ratio = other / own;
    return 1 / (1 + ratio * ratio);
}

/* What shines by itself where a ray ends. surface: NULL for the sky. */
static struct lw_vec3 shine(const struct wavefront *w, uint32_t path, uint32_t depth,
                            const struct lw_surface *surface) {
    const struct lw_lights *lights = w->desc.lights;
    const struct lw_hit16 *hits = &w->hit[path / LANES];
    const uint32_t i = path % LANES;
    const struct lw_vec3 direction = get(w, DIRECTION, path);
    const struct lw_vec3 radiance = surface ? surface->emission : lw_scene_sky(w->desc.scene, direction);
    if (depth == 0 || !(radiance.x + radiance.y + radiance.z > 0)) return radiance;
    if (surface && surface->material->unlit) return lw_vec3(0, 0, 0);
    const struct lw_vec3 origin = get(w, ORIGIN, path), normal = get(w, NORMAL, path);
    const float pdf = surface
                          ? lw_lights_pdf_emitter(lights, origin, normal, hits->object[i], hits->triangle[i],
                                                  hits->u[i], hits->v[i], direction, hits->t[i])
                          : lw_lights_pdf_sky(lights, origin, normal, direction);
    return lw_vec3_scale(radiance, weight_of(lw_vec3_dot(normal, direction) / LW_PI, pdf));
}

/* Takes a path to where its ray ends, after `depth` bounces, and draws its next ray. Whether it goes on. */
static bool arrive(struct wavefront *w, uint32_t path, uint32_t depth) {
    const struct lw_hit16 *hits = &w->hit[path / LANES];
    const uint32_t i = path % LANES, object = hits->object[i];
    const bool miss = object == LW_TRACE_MISS, last = depth > w->desc.bounces;
    struct lw_vec3 throughput = get(w, THROUGHPUT, path);
    struct lw_surface surface;
    if (!miss) {
        const struct lw_material *m = lw_trace_material(w->desc.scene, hits, i);
        if (depth > 0 && hits->back[i] && !m->double_sided) return false; /* a black wall */
        if (last && !(m->emission[0] + m->emission[1] + m->emission[2] > 0)) return false;
        surface_at(w, hits, i, &surface);
    }
    add_radiance(w, path, lw_vec3_mul(throughput, shine(w, path, depth, miss ? NULL : &surface)));
    if (miss || last) return false;
    throughput = lw_vec3_mul(throughput, surface.albedo);
    if (!(throughput.x + throughput.y + throughput.z > 0)) return false;

    float bounce[2];
    const struct lw_place_point point =
        lw_place_point(&w->place[object], mesh_of(w, object), hits, i, &surface);
    draw(w, path, USE_BOUNCE, depth, bounce);
    put(w, THROUGHPUT, path, throughput);
    put(w, ORIGIN, path, point.origin);
    put(w, NORMAL, path, point.normal);
    put(w, DIRECTION, path, lw_direction_about(point.normal, lw_direction_cosine(bounce)));
    return true;
}

/* Leaves in the queue those that go on. */
static void arrive_all(struct wavefront *w, uint32_t depth) {
    uint32_t going = 0;
    for (uint32_t i = 0; i < w->going; i++) {
        const uint32_t path = w->queue[i];
        if (arrive(w, path, depth)) w->queue[going++] = path;
    }
    w->going = going;
}

/* A sample of all lights, before visibility: what the path would bring by it. */
static struct lw_vec3 ask_lamps(const struct wavefront *w, uint32_t path, uint32_t depth,
                                struct lw_light_sample *out) {
    const struct lw_vec3 normal = get(w, NORMAL, path);
    float pick[2], lamp[2];
    draw(w, path, USE_PICK, depth, pick);
    draw(w, path, USE_LAMP, depth, lamp);
    *out = lw_lights_sample(w->desc.lights, get(w, ORIGIN, path), normal, pick[0], lamp[0], lamp[1]);
    const float cosine = lw_vec3_dot(normal, out->direction);
    const float weight = out->pdf > 0 ? weight_of(out->pdf, cosine / LW_PI) : 1;
    return lw_vec3_scale(lw_vec3_mul(out->irradiance_normal, get(w, THROUGHPUT, path)),
                         cosine * weight / LW_PI);
}

static void light16(struct wavefront *w, uint32_t depth, const uint32_t *path, uint32_t lanes) {
    struct lw_ray16 rays = {.salt = w->sample};
    struct lw_vec3 arriving[LW_TRACE_WIDTH];
    float tint[3][LW_TRACE_WIDTH];
    uint16_t active = 0;
    for (uint32_t i = 0; i < lanes; i++) {
        struct lw_light_sample sample;
        arriving[i] = ask_lamps(w, path[i], depth, &sample);
        if (!(arriving[i].x + arriving[i].y + arriving[i].z > 0)) continue;
        lw_trace_set_ray(&rays, i, get(w, ORIGIN, path[i]), sample.direction,
                         sample.distance_m * LW_TRACE_SHORT);
        active |= (uint16_t)(1u << i);
    }
    if (!active) return;
    const unsigned flags = w->desc.coherent == WAVEFRONT_COHERENT_EYE ? 0 : LW_TRACE_COHERENT;
    const unsigned dark = lw_trace_tinted16(w->desc.trace, flags, active, &rays, tint);
    for (uint32_t i = 0; i < lanes; i++)
        if ((active & ~dark) >> i & 1u)
            add_radiance(w, path[i], lw_vec3_mul(arriving[i], lw_vec3(tint[0][i], tint[1][i], tint[2][i])));
}

static void bounce16(struct wavefront *w, const uint32_t *path, uint32_t lanes) {
    struct lw_ray16 rays = {.salt = w->sample};
    struct lw_hit16 hits;
    for (uint32_t i = 0; i < lanes; i++)
        lw_trace_set_ray(&rays, i, get(w, ORIGIN, path[i]), get(w, DIRECTION, path[i]), INFINITY);
    const unsigned flags = w->desc.coherent == WAVEFRONT_COHERENT_ALL ? LW_TRACE_COHERENT : 0;
    lw_trace_closest16(w->desc.trace, flags, (uint16_t)((1u << lanes) - 1u), &rays, &hits);
    for (uint32_t i = 0; i < lanes; i++) keep_hit(w, path[i], &hits, i);
}

static uint32_t lanes_from(uint32_t first, uint32_t count) {
    return count - first < LANES ? count - first : LANES;
}

static void trace_paths(struct wavefront *w, uint32_t paths) {
    const bool by_hit = w->by == WAVEFRONT_BY_MATERIAL, by_place = w->by > WAVEFRONT_BY_MATERIAL;
    w->going = paths;
    for (uint32_t i = 0; i < paths; i++) w->queue[i] = i;
    for (uint32_t i = 0; i < paths; i += LANES) look16(w, w->queue + i, lanes_from(i, paths));
    for (uint32_t depth = 0;; depth++) {
        if (by_hit && depth <= w->desc.bounces) sort_queue(w);
        arrive_all(w, depth);
        if (!w->going) return;
        if (by_place) sort_queue(w);
        for (uint32_t i = 0; i < w->going; i += LANES)
            light16(w, depth, w->queue + i, lanes_from(i, w->going));
        if (depth == w->desc.bounces && !w->rays_may_shine) return;
        for (uint32_t i = 0; i < w->going; i += LANES) bounce16(w, w->queue + i, lanes_from(i, w->going));
    }
}

static void add_to_picture(const struct wavefront *w, uint32_t paths, float *picture) {
    for (uint32_t path = 0; path < paths; path++) {
        const struct lw_vec3 radiance = get(w, RADIANCE, path);
        if (!lw_vec3_is_finite(radiance)) continue;
        float *sum =
            picture + 3 * ((size_t)(w->pixel[path] >> 16) * w->desc.width + (w->pixel[path] & 0xffffu));
        sum[0] += radiance.x, sum[1] += radiance.y, sum[2] += radiance.z;
    }
}

void wavefront_render(struct wavefront *w, uint32_t paths, enum wavefront_order by, uint32_t seed,
                      uint32_t samples, float *picture, uint64_t *out_sort_ns) {
    assert(paths % LANES == 0);
    if (paths > w->pixel_count) paths = w->pixel_count;
    for (int p = 0; p < PLANES; p++) w->plane[p] = w->state + (size_t)p * paths;
    w->by = by;
    w->seed = seed;
    w->sort_ns = 0;
    for (uint32_t first = 0; first < w->pixel_count; first += paths) {
        const uint32_t left = w->pixel_count - first, count = left < paths ? left : paths;
        w->pixel = w->pixels + first;
        for (w->sample = 0; w->sample < samples; w->sample++) {
            trace_paths(w, count);
            add_to_picture(w, count, picture);
        }
    }
    *out_sort_ns = w->sort_ns;
}

/* ---- set-up ---- */

/* Tile by tile, in a tile square by square. */
static void list_pixels(struct wavefront *w) {
    const uint32_t width = w->desc.width, height = w->desc.height, squares = TILE / WAVEFRONT_SQUARE;
    for (uint32_t top = 0; top < height; top += TILE)
        for (uint32_t left = 0; left < width; left += TILE)
            for (uint32_t n = 0; n < TILE * TILE; n++) {
                const uint32_t square = n / LANES, i = n % LANES;
                const uint32_t x = left + square % squares * WAVEFRONT_SQUARE + i % WAVEFRONT_SQUARE;
                const uint32_t y = top + square / squares * WAVEFRONT_SQUARE + i / WAVEFRONT_SQUARE;
                if (x < width && y < height) w->pixels[w->pixel_count++] = y << 16 | x;
            }
}

static bool allocate(struct wavefront *w, size_t pixels) {
    w->place = calloc((size_t)w->desc.scene->object_count + 1, sizeof *w->place);
    w->pixels = malloc(pixels * sizeof *w->pixels);
    w->queue = malloc(pixels * sizeof *w->queue);
    w->key = malloc(pixels * sizeof *w->key);
    w->spare = malloc(pixels * sizeof *w->spare);
    w->state = malloc(pixels * PLANES * sizeof *w->state);
    w->hit = aligned_alloc(64, pixels / LANES * sizeof *w->hit);
    return w->place && w->pixels && w->queue && w->key && w->spare && w->state && w->hit;
}

enum lw_status wavefront_create(const struct wavefront_desc *desc, struct wavefront **out,
                                struct lw_error *err) {
    assert(desc->width % WAVEFRONT_SQUARE == 0 && desc->height % WAVEFRONT_SQUARE == 0);
    struct lw_vec3 maximum_ws;
    struct wavefront *w = calloc(1, sizeof *w);
    if (w) w->desc = *desc;
    if (!w || !allocate(w, (size_t)desc->width * desc->height)) {
        wavefront_destroy(w);
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for paths of %ux%u pixels", desc->width,
                              desc->height);
    }
    if (!lw_pose_bounds(desc->pose, desc->scene, &w->minimum_ws, &maximum_ws)) {
        wavefront_destroy(w);
        return lw_status_fail(err, LW_BAD_DATA, "the scene is empty");
    }
    w->cells_per_m = CELLS / fmaxf(lw_vec3_max_abs(lw_vec3_sub(maximum_ws, w->minimum_ws)), 1e-6f);
    w->rays_may_shine = desc->lights->shining_count || desc->lights->sky_luminance > 0;
    w->camera = lw_camera_plane(&desc->camera, desc->width, desc->height);
    for (uint32_t o = 0; o < desc->scene->object_count; o++)
        w->place[o] = lw_place_of(&desc->pose->object_to_world[o]);
    list_pixels(w);
    *out = w;
    return LW_OK;
}

void wavefront_destroy(struct wavefront *w) {
    if (!w) return;
    free(w->place);
    free(w->pixels);
    free(w->queue);
    free(w->key);
    free(w->spare);
    free(w->state);
    free(w->hit);
    free(w);
}
