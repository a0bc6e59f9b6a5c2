#include "client/paths/path_trace.h"

#include "client/paths/guide.h"
#include "common/base/colour.h"
#include "common/base/random.h"
#include "common/light/direct16.h"
#include "common/light/direction.h"

#include <assert.h>
#include <omp.h>
#include <stdlib.h>

#define LANES  LW_TRACE_WIDTH
#define TILE   32u /* pixels; the side of what a thread takes */
#define SQUARE 4u  /* pixels; the side of a bundle */
#define BUNDLE (SQUARE * SQUARE)

_Static_assert(SQUARE *SQUARE == LANES, "a bundle starts as one packet");

/* What a pair of random numbers is for. */
enum use { USE_PIXEL, USE_LAYER, USE_PICK, USE_LAMP, USE_BOUNCE, USE_COUNT };

struct lw_path_trace {
    const struct lw_scene *scene;
    const struct lw_trace *trace;
    const struct lw_lights *lights;
    struct lw_place *place; /* per object */
    int threads;
};

/* One render, as its bundles see it. */
struct job {
    const struct lw_path_trace *tracer;
    const struct lw_path_view *view;
    struct lw_camera_plane plane;
    struct lw_path_film *film;
    struct {
        uint32_t left, top, right, bottom;
    } part; /* the film's part of the whole picture. Paths know their pixels by the whole picture */
};

/* The paths of a square of 4 x 4 pixels. They share all random numbers: from equal normals they bounce in
 * parallel, and all look for the same lamp, so that packets of them run through the same boxes. That
 * correlates the noise of these pixels, and does not change the error of any one.
 *
 * Paths per CPU second, as multiples of the first line. One thread; 640 x 360, direct light and 2 bounces,
 * but Cornell 320 x 320 and 3 bounces. The coherent flag is set where it helps:
 *                                                              Cornell  atrium  Sponza
 *   every path its own numbers, packets of 4 x 4 pixels           1       1       1
 *   the same, 1,024 paths sorted by normal and place              0.96    1.05    0.98
 *   shared by every 4th pixel of 64 x 64, as sets in the solve    1.85    1.40    1.28
 *   shared by every 2nd pixel of 32 x 32                          1.90    1.73    1.58
 *   shared by every 2nd square of 32 x 32                         2.04    1.91    1.72
 *   the same, sorted by normal and place before each bounce       1.91    1.87    1.72
 *   shared by all of 32 x 32, sorted                              1.97    2.07    1.92
 *   shared by one square: this                                    1.92    1.73    1.71
 * The wider numbers are shared, the less the noise of a region averages out over it.
 * docs/lab/guiding.md has the first two lines and the last, with 320 x 180 pixels, 2 bounces and no coherent
 * flag on rays to lamps of paths with own numbers, which is faster for them: 0.96, 0.91 and 0.97 for sorted
 * paths, 1.71, 1.28 and 1.32 for one square. */
struct bundle {
    uint32_t seed, index; /* for the sequences that the paths share */
    uint32_t set, sample; /* for the sequences of sampling.h */
    uint32_t salt;
    unsigned going; /* paths that go on from a surface: order[0 .. going - 1] */
    bool guided;    /* the next bounce rays are drawn by aims */
    uint16_t order[BUNDLE + LANES];
    struct lw_guide_aim aim[BUNDLE]; /* for paths that go on, where the view has a guide */
    struct path {
        struct lw_vec3 origin;     /* on that surface, lifted off it */
        struct lw_vec3 normal;     /* shading normal, on the side that the path came from */
        struct lw_vec3 throughput; /* the albedo of an even surface included */
        struct lw_vec3 radiance;   /* gathered so far */
        struct lw_vec3 near;       /* the part of it from its first hit; with a clamp */
        /* For the guide: the surface's albedo towards the eye, luminance that it shines, and that it reflects
         * of lamps. */
        struct lw_vec3 albedo;
        float shone, reflected;
        uint32_t place; /* the guide's place that the ray to here was drawn by; LW_GUIDE_NOWHERE: none */
        uint32_t x, y;  /* pixel */
        bool glossy; /* the surface reflects as `gloss` has it; else evenly, its albedo in the throughput */
    } path[BUNDLE];
    struct lw_place_gloss gloss[BUNDLE];
};

enum lw_status lw_path_trace_create(const struct lw_path_trace_desc *desc, struct lw_path_trace **out_tracer,
                                    struct lw_error *err) {
    struct lw_path_trace *tracer = calloc(1, sizeof *tracer);
    if (tracer == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the path tracer");
    tracer->scene = desc->scene;
    tracer->trace = desc->trace;
    tracer->lights = desc->lights;
    tracer->threads = desc->threads ? (int)desc->threads : omp_get_max_threads();
    tracer->place = calloc((size_t)desc->scene->object_count + 1, sizeof *tracer->place);
    if (tracer->place == NULL) {
        lw_path_trace_destroy(tracer);
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for the path tracer");
    }
    lw_path_trace_set_pose(tracer, desc->pose);
    *out_tracer = tracer;
    return LW_OK;
}

void lw_path_trace_destroy(struct lw_path_trace *tracer) {
    if (tracer == NULL) return;
    free(tracer->place);
    free(tracer);
}

void lw_path_trace_set_pose(struct lw_path_trace *tracer, const struct lw_pose *pose) {
    for (uint32_t o = 0; o < tracer->scene->object_count; o++)
        tracer->place[o] = lw_place_of(&pose->object_to_world[o]);
}

static void draw(const struct bundle *b, enum use use, uint32_t depth, float out[2]) {
    lw_random_sobol2(b->index, lw_random_hash2(b->seed, depth * USE_COUNT + use), out);
}

static const struct lw_mesh *mesh_of(const struct job *job, uint32_t object) {
    const struct lw_scene *scene = job->tracer->scene;
    return &scene->mesh[scene->object[object].mesh];
}

static struct lw_vec3 direction_of(const struct lw_ray16 *rays, unsigned i) {
    return lw_vec3(rays->dir_x[i], rays->dir_y[i], rays->dir_z[i]);
}

static bool is_black(struct lw_vec3 v) { return !(v.x + v.y + v.z > 0); }

/* Puts path number `which` onto the surface that lane `i` has met, from where it goes on unless all light is
 * swallowed. */
static void continue_from_hit(const struct job *job, struct bundle *b, uint16_t which,
                              const struct lw_ray16 *rays, const struct lw_hit16 *hits, unsigned i,
                              const struct lw_surface *surface) {
    struct path *path = &b->path[which];
    const struct lw_material *material = surface->material;
    path->glossy = false;
    if (!material->finish) path->throughput = lw_vec3_mul(path->throughput, surface->albedo);
    path->albedo = surface->albedo;
    if (is_black(path->throughput)) return;

    const struct lw_place *place = &job->tracer->place[hits->object[i]];
    const struct lw_mesh *mesh = mesh_of(job, hits->object[i]);
    const struct lw_place_point point = lw_place_point(place, mesh, hits, i, surface);
    path->normal = point.normal;
    path->origin = point.origin;
    if (material->finish) {
        struct lw_place_gloss *gloss = &b->gloss[which];
        const struct lw_vec3 to_eye = lw_vec3_scale(lw_vec3_normalize(direction_of(rays, i)), -1);
        path->glossy =
            lw_place_gloss(place, job->tracer->scene, mesh, hits, i, surface, &point, to_eye, gloss);
        if (path->glossy) {
            path->albedo = lw_lobes_seen_albedo(&gloss->seen);
            path->normal = gloss->normal;
        } else {
            path->throughput = lw_vec3_mul(path->throughput, surface->albedo);
        }
        if (is_black(lw_vec3_mul(path->throughput, path->albedo))) return;
    }
    b->order[b->going++] = which;
}

static void surface_at(const struct job *job, const struct lw_hit16 *hits, unsigned i,
                       struct lw_surface *out) {
    lw_scene_surface(job->tracer->scene, mesh_of(job, hits->object[i]), hits->triangle[i], hits->u[i],
                     hits->v[i], out);
}

/* Traces rays from the eye. The path chooses one of the BLEND surfaces along its ray, or what lies behind
 * them all, by how much each gives to the colour that compose.h blends front to back. */
static void look16(const struct job *job, struct bundle *b, uint16_t first, unsigned lanes,
                   struct lw_path_count *count) {
    const struct lw_path_view *view = job->view;
    struct lw_ray16 rays = {.salt = b->salt};
    float jitter[2], choice[2], transmittance[LANES];
    draw(b, USE_PIXEL, 0, jitter);
    draw(b, USE_LAYER, 0, choice);
    if (view->pixel == LW_PATH_PIXEL_CENTRE || view->first_hits) jitter[0] = jitter[1] = 0.5f;
    for (unsigned i = 0; i < lanes; i++) {
        struct path *path = &b->path[first + i];
        const float x = (float)path->x + jitter[0], y = (float)path->y + jitter[1];
        lw_trace_set_ray(&rays, i, lw_camera_origin(&job->plane, x, y),
                         lw_camera_direction(&job->plane, x, y), INFINITY);
        path->radiance = lw_vec3(0, 0, 0);
        path->throughput = lw_vec3(1, 1, 1);
        transmittance[i] = 1;
    }
    uint16_t going = (uint16_t)((1u << lanes) - 1u);
    count->paths += lanes;
    for (unsigned layer = 1; going; layer++) {
        struct lw_hit16 hits;
        uint16_t go_on = 0;
        lw_trace_closest16(job->tracer->trace, LW_TRACE_VIEW | LW_TRACE_COHERENT, going, &rays, &hits);
        count->rays_primary += (unsigned)__builtin_popcount(going);
        for (unsigned i = 0; i < lanes; i++) {
            if (!(going >> i & 1u)) continue;
            struct path *path = &b->path[first + i];
            if (hits.object[i] == LW_TRACE_MISS) {
                const struct lw_vec3 direction = lw_vec3_normalize(direction_of(&rays, i));
                path->radiance = lw_vec3_mul(lw_scene_sky(job->tracer->scene, direction), path->throughput);
                continue;
            }
            struct lw_surface surface;
            surface_at(job, &hits, i, &surface);
            transmittance[i] *= 1 - surface.alpha;
            if (surface.material->alpha_mode == LW_ALPHA_BLEND && layer < LW_PATH_TRACE_LAYERS_MAX &&
                choice[0] < transmittance[i]) {
                /* Past the hit by more than its rounding in any packet. */
                rays.t_near[i] = hits.t[i] * (1.0f + 4e-6f) + 1e-7f;
                go_on |= (uint16_t)(1u << i);
                path->throughput = lw_material_tint(surface.material, path->throughput);
                continue;
            }
            path->radiance = lw_vec3_mul(surface.emission, path->throughput);
            continue_from_hit(job, b, (uint16_t)(first + i), &rays, &hits, i, &surface);
        }
        going = go_on;
    }
}

/* Takes the first hits of a bundle that has none but single, even surfaces; whether it is one. */
static bool take_first_hits(const struct job *job, struct bundle *b, unsigned paths) {
    const struct lw_gbuffer *g = job->view->first_hits;
    if (!g) return false;
    for (unsigned i = 0; i < paths; i++)
        if (g->from_eye[(size_t)b->path[i].y * g->width + b->path[i].x]) return false;
    for (unsigned i = 0; i < paths; i++) {
        struct path *path = &b->path[i];
        const size_t at = (size_t)path->y * g->width + path->x;
        path->radiance = lw_gbuffer_load3(g->plane.emission, at);
        path->throughput = lw_gbuffer_load3(g->plane.albedo, at);
        if (!(path->throughput.x + path->throughput.y + path->throughput.z > 0)) continue;
        path->normal = lw_gbuffer_load3(g->plane.normal, at);
        path->origin = lw_gbuffer_load3(g->plane.origin, at);
        path->glossy = false;
        b->order[b->going++] = (uint16_t)i;
    }
    return true;
}

/* Power heuristic (Veach 1997, 9.2.4): the weight of a sample that was drawn with density `own` where `other`
 * could have drawn it too. */
static float weight_of(float own, float other) {
    float ratio = other / own;
    return 1 / (1 + ratio * ratio);
}

/* Density by which a bounce ray from a path's surface would be drawn. */
static float bounce_density(const struct bundle *b, uint16_t which, struct lw_vec3 direction) {
    const struct path *path = &b->path[which];
    const float spread = b->guided ? lw_guide_density(&b->aim[which], path->normal, direction)
                                   : lw_vec3_dot(path->normal, direction) / LW_PI;
    if (!path->glossy) return spread;
    const struct lw_place_gloss *gloss = &b->gloss[which];
    return lw_lobes_pdf_with(&gloss->seen, lw_place_gloss_to_local(gloss, direction), spread);
}

/* Share of a sample of lamps that counts; bounce rays bring the rest. */
static float lamp_share(const struct job *job, const struct bundle *b, uint16_t which,
                        const struct lw_light_sample *sample) {
    if (!(sample->pdf > 0) || job->view->method == LW_PATH_METHOD_LAMPS) return 1;
    if (job->view->method == LW_PATH_METHOD_BOUNCE) return 0;
    return weight_of(sample->pdf, bounce_density(b, which, sample->direction));
}

static void light16(const struct job *job, struct bundle *b, const uint16_t *which, unsigned lanes,
                    float pick, const float point[2], struct lw_path_count *count) {
    struct lw_ray16 rays = {.salt = b->salt};
    struct lw_vec3 arriving[LANES];
    float reflected[LANES]; /* luminance; for the guide */
    uint16_t active = 0;
    for (unsigned i = 0; i < lanes; i++) {
        struct path *path = &b->path[which[i]];
        const struct lw_light_sample sample =
            lw_lights_sample(job->tracer->lights, path->origin, path->normal, pick, point[0], point[1]);
        const float cosine = lw_vec3_dot(path->normal, sample.direction),
                    weight = lamp_share(job, b, which[i], &sample);
        if (path->glossy) {
            const struct lw_vec3 light =
                lw_vec3_mul(lw_vec3_scale(sample.irradiance_normal, weight),
                            lw_place_gloss_reflect(&b->gloss[which[i]], sample.direction));
            arriving[i] = lw_vec3_mul(light, path->throughput);
            reflected[i] = lw_colour_luminance(light);
        } else {
            const float scale = cosine * (1 / LW_PI * weight);
            arriving[i] = lw_vec3_scale(lw_vec3_mul(sample.irradiance_normal, path->throughput), scale);
            if (job->view->guide)
                reflected[i] =
                    scale * lw_colour_luminance(lw_vec3_mul(sample.irradiance_normal, path->albedo));
        }
        if (is_black(arriving[i])) continue;
        lw_trace_set_ray(&rays, i, path->origin, sample.direction, sample.distance_m * LW_TRACE_SHORT);
        active |= (uint16_t)(1u << i);
    }
    if (!active) return;
    float tint[3][LANES];
    uint16_t occluded = lw_trace_tinted16(job->tracer->trace, LW_TRACE_COHERENT, active, &rays, tint);
    count->rays_shadow += (unsigned)__builtin_popcount(active);
    for (unsigned i = 0; i < lanes; i++)
        if ((active & ~occluded) >> i & 1u) {
            struct path *path = &b->path[which[i]];
            const struct lw_vec3 passed = lw_vec3(tint[0][i], tint[1][i], tint[2][i]);
            path->radiance = lw_vec3_add(path->radiance, lw_vec3_mul(arriving[i], passed));
            if (job->view->guide) path->reflected += reflected[i] * lw_colour_luminance(passed);
        }
}

/* A sample of each light or group of lights, for the surfaces that packets of the bundle have met first. */
static void light16_by_all(const struct job *job, struct bundle *b, const uint16_t *which, unsigned lanes,
                           struct lw_path_count *count) {
    struct lw_points16 points;
    float e[3][LANES] = {{0}};
    for (unsigned i = 0; i < LANES; i++) {
        const struct path *path = &b->path[which[i < lanes ? i : 0]];
        points.x[i] = path->origin.x, points.y[i] = path->origin.y, points.z[i] = path->origin.z;
        points.nx[i] = path->normal.x, points.ny[i] = path->normal.y, points.nz[i] = path->normal.z;
    }
    struct lw_direct16 direct = {.lights = job->tracer->lights,
                                 .trace = job->tracer->trace,
                                 .points = &points,
                                 .active = (uint16_t)((1u << lanes) - 1u),
                                 .coherent = true,
                                 .seed = b->seed,
                                 .set = b->set,
                                 .salt = b->salt,
                                 .e = e};
    lw_direct16_punctual(&direct, b->sample, 1);
    lw_direct16_groups(&direct, b->sample, 1);
    lw_direct16_sky(&direct, b->sample, 1);
    count->rays_shadow += direct.rays;
    for (unsigned i = 0; i < lanes; i++) {
        struct path *path = &b->path[which[i]];
        const struct lw_vec3 reflected = lw_vec3_mul(path->throughput, lw_vec3(e[0][i], e[1][i], e[2][i]));
        path->radiance = lw_vec3_mad(path->radiance, reflected, 1 / LW_PI);
    }
}

/* Scales down what paths bring from beyond their first hits. */
static void clamp_far(struct bundle *b, unsigned paths, float limit) {
    for (unsigned i = 0; i < paths; i++) {
        struct path *path = &b->path[i];
        const struct lw_vec3 far = lw_vec3_sub(path->radiance, path->near);
        const float luminance = lw_colour_luminance(far);
        if (luminance > limit) path->radiance = lw_vec3_mad(path->near, far, limit / luminance);
    }
}

/* Emission that a bounce ray meets. Rays towards lamps may have counted it too. own: the density
 * that the ray was drawn by. */
static struct lw_vec3 shine(const struct job *job, enum lw_path_method method, const struct path *path,
                            float own, const struct lw_ray16 *rays, const struct lw_hit16 *hits, unsigned i,
                            const struct lw_surface *surface) {
    if (method == LW_PATH_METHOD_LAMPS) return lw_vec3(0, 0, 0);
    const struct lw_lights *lights = job->tracer->lights;
    const struct lw_vec3 direction = direction_of(rays, i);
    if (surface && surface->material->unlit) return lw_vec3(0, 0, 0); /* seen, and no light */
    struct lw_vec3 radiance = surface ? surface->emission : lw_scene_sky(job->tracer->scene, direction);
    if (method == LW_PATH_METHOD_BOUNCE || !(radiance.x + radiance.y + radiance.z > 0)) return radiance;
    float pdf = surface
                    ? lw_lights_pdf_emitter(lights, path->origin, path->normal, hits->object[i],
                                            hits->triangle[i], hits->u[i], hits->v[i], direction, hits->t[i])
                    : lw_lights_pdf_sky(lights, path->origin, path->normal, direction);
    return lw_vec3_scale(radiance, weight_of(own, pdf));
}

/* Random numbers of a bounce: two of the direction, one that chooses the lobe. */
struct bounce_draw {
    float point[2], lobe;
    struct lw_vec3 cosine; /* lw_direction_cosine(point) */
};

/* Draws a direction of a surface that mirrors: as a mirror's, or, by the guide or the cosine, any. */
static bool draw_glossy(struct bundle *b, uint16_t which, const struct bounce_draw *draw,
                        struct lw_vec3 *out_direction) {
    struct path *path = &b->path[which];
    const struct lw_place_gloss *gloss = &b->gloss[which];
    if (b->guided && draw->lobe >= gloss->seen.mirror_share) {
        const struct lw_guide_sample sample = lw_guide_sample(&b->aim[which], path->normal, draw->point);
        path->place = sample.place;
        *out_direction = sample.direction;
        return true;
    }
    struct lw_vec3 local;
    if (!lw_lobes_sample(&gloss->seen, draw->point, draw->lobe, &local)) return false;
    *out_direction = lw_place_gloss_to_world(gloss, local);
    return true;
}

static bool aim_glossy(struct bundle *b, uint16_t which, const struct bounce_draw *draw,
                       struct lw_vec3 *out_direction, float *out_density) {
    struct path *path = &b->path[which];
    if (!draw_glossy(b, which, draw, out_direction)) return false;
    const struct lw_vec3 f = lw_place_gloss_reflect(&b->gloss[which], *out_direction);
    *out_density = bounce_density(b, which, *out_direction);
    if (is_black(f) || !(*out_density > 0)) {
        path->place = LW_GUIDE_NOWHERE;
        return false;
    }
    path->throughput = lw_vec3_mul(path->throughput, lw_vec3_scale(f, 1 / *out_density));
    return true;
}

/* Aims a path's ray; *out_density: that it was drawn by. Returns whether there is one: it may lie below the
 * surface. */
static bool aim(struct bundle *b, uint16_t which, const struct bounce_draw *draw,
                struct lw_vec3 *out_direction, float *out_density) {
    struct path *path = &b->path[which];
    path->place = LW_GUIDE_NOWHERE;
    if (path->glossy) return aim_glossy(b, which, draw, out_direction, out_density);
    if (!b->guided) {
        *out_direction = lw_direction_about(path->normal, draw->cosine);
        *out_density = lw_vec3_dot(path->normal, *out_direction) / LW_PI;
        return true;
    }
    const struct lw_guide_sample sample = lw_guide_sample(&b->aim[which], path->normal, draw->point);
    const float cosine = lw_vec3_dot(path->normal, sample.direction);
    if (!(cosine > 0)) return false;
    path->throughput = lw_vec3_scale(path->throughput, cosine / (LW_PI * sample.density));
    path->place = sample.place;
    *out_direction = sample.direction;
    *out_density = sample.density;
    return true;
}

/* Tells the guide what a path's ray has found. */
static void note_in_guide(const struct job *job, struct path *path, float luminance) {
    if (path->place == LW_GUIDE_NOWHERE) return;
    lw_guide_note(job->view->guide, path->place, luminance);
    path->place = LW_GUIDE_NOWHERE;
}

/* Estimators of lamps' light on surfaces of one depth. */
struct lit {
    enum lw_path_method even, glossy;
};

/* lit: of the surfaces that rays leave. */
static void bounce16(const struct job *job, struct bundle *b, const uint16_t *which, unsigned lanes,
                     const struct bounce_draw *draw, unsigned flags, const struct lit *lit, bool last,
                     struct lw_path_count *count) {
    const struct lw_scene *scene = job->tracer->scene;
    struct lw_ray16 rays = {.salt = b->salt};
    struct lw_hit16 hits;
    enum lw_path_method method[LANES];
    uint16_t lane_path[LANES]; /* `which` is what continue_from_hit() writes over */
    float density[LANES];
    uint16_t active = 0;
    for (unsigned i = 0; i < lanes; i++) {
        struct lw_vec3 direction;
        lane_path[i] = which[i];
        method[i] = b->path[which[i]].glossy ? lit->glossy : lit->even;
        if (last && method[i] == LW_PATH_METHOD_LAMPS) continue;
        if (!aim(b, which[i], draw, &direction, &density[i])) continue;
        lw_trace_set_ray(&rays, i, b->path[which[i]].origin, direction, INFINITY);
        active |= (uint16_t)(1u << i);
    }
    if (!active) return;
    lw_trace_closest16(job->tracer->trace, flags, active, &rays, &hits);
    count->rays_bounce += (unsigned)__builtin_popcount(active);
    for (unsigned i = 0; i < lanes; i++) {
        if (!(active >> i & 1u)) continue;
        struct path *path = &b->path[lane_path[i]];
        struct lw_surface surface;
        const bool miss = hits.object[i] == LW_TRACE_MISS;
        if (!miss) {
            const uint32_t *material = mesh_of(job, hits.object[i])->material;
            const struct lw_material *m = &scene->material[material[hits.triangle[i]]];
            if (hits.back[i] && !m->double_sided) { /* a black wall */
                note_in_guide(job, path, 0);
                continue;
            }
            if (last && !(m->emission[0] + m->emission[1] + m->emission[2] > 0)) continue;
            surface_at(job, &hits, i, &surface);
        }
        const unsigned going = b->going;
        struct lw_vec3 seen =
            shine(job, method[i], path, density[i], &rays, &hits, i, miss ? NULL : &surface);
        const struct lw_vec3 brought = lw_vec3_mul(seen, path->throughput);
        path->radiance = lw_vec3_add(path->radiance, brought);
        /* A lamp in a mirror belongs to the light of lamps there. */
        if (flags == LW_TRACE_COHERENT && path->glossy) path->near = lw_vec3_add(path->near, brought);
        path->shone = lw_colour_luminance(seen);
        path->reflected = 0;
        if (!miss && !last) continue_from_hit(job, b, lane_path[i], &rays, &hits, i, &surface);
        if (b->going == going) note_in_guide(job, path, path->shone);
    }
}

/* Aims from where paths have arrived. */
static void take_aim(const struct job *job, struct bundle *b) {
    for (unsigned i = 0; i < b->going; i++) {
        const struct path *path = &b->path[b->order[i]];
        lw_guide_aim_at(job->view->guide, path->origin, path->normal, &b->aim[b->order[i]]);
    }
}

/* Tells the guide what brought them there: what shines, what lamps give, and by Q what else arrives. */
static void note_all_in_guide(const struct job *job, struct bundle *b) {
    for (unsigned i = 0; i < b->going; i++) {
        struct path *path = &b->path[b->order[i]];
        note_in_guide(job, path,
                      path->shone + path->reflected +
                          lw_colour_luminance(path->albedo) * lw_guide_reflected(&b->aim[b->order[i]]));
    }
}

static unsigned lanes_from(unsigned first, unsigned count) {
    return count - first < LANES ? count - first : LANES;
}

/* Light of lamps, on all surfaces that paths have arrived at. by_all: with a sample of each, where surfaces
 * are even. A mirror shows lamps to bounce rays as well, which one sample of all is weighed against. */
static void light(const struct job *job, struct bundle *b, uint32_t depth, bool by_all,
                  struct lw_path_count *count) {
    const enum lw_path_method method = job->view->method;
    const bool ask = method != LW_PATH_METHOD_BOUNCE || job->tracer->scene->light_count > 0;
    float pick[2], lamp[2];
    uint16_t even[BUNDLE + LANES], one[BUNDLE + LANES];
    unsigned evens = 0, ones = 0;
    draw(b, USE_PICK, depth, pick);
    draw(b, USE_LAMP, depth, lamp);
    for (unsigned i = 0; i < b->going; i++)
        if (by_all && !b->path[b->order[i]].glossy)
            even[evens++] = b->order[i];
        else if (ask)
            one[ones++] = b->order[i];
    for (unsigned first = 0; first < evens; first += LANES)
        light16_by_all(job, b, even + first, lanes_from(first, evens), count);
    for (unsigned first = 0; first < ones; first += LANES)
        light16(job, b, one + first, lanes_from(first, ones), pick[0], lamp, count);
}

/* Whether bounce rays may bring light of lamps. */
static bool rays_bring_lamps(const struct bundle *b, const struct lit *lit) {
    for (unsigned i = 0; i < b->going; i++)
        if ((b->path[b->order[i]].glossy ? lit->glossy : lit->even) != LW_PATH_METHOD_LAMPS) return true;
    return false;
}

static void trace_bundle(const struct job *job, struct bundle *b, unsigned paths,
                         struct lw_path_count *count) {
    const struct lw_path_view *view = job->view;
    b->going = 0;
    if (!take_first_hits(job, b, paths))
        for (unsigned first = 0; first < paths; first += LANES)
            look16(job, b, (uint16_t)first, lanes_from(first, paths), count);
    else
        count->paths += paths;
    const bool indirect = view->part == LW_PATH_PART_INDIRECT, arrived = b->going > 0;
    const uint32_t bounces = view->part == LW_PATH_PART_DIRECT ? 0 : view->bounces;
    for (unsigned i = 0; indirect && i < paths; i++) b->path[i].radiance = lw_vec3(0, 0, 0);
    for (unsigned i = 0; i < paths; i++) b->path[i].place = LW_GUIDE_NOWHERE;
    /* Rays of the last surface bring light only where they may meet what shines. */
    const bool rays_may_shine = job->tracer->lights->shining_count || job->tracer->lights->sky_luminance > 0;
    for (uint32_t depth = 0; b->going; depth++) {
        const bool first_hit = depth == 0, last = depth == bounces;
        const bool by_all = first_hit && view->all_lights, unlit = first_hit && indirect;
        const struct lit lit = {.even = by_all || unlit ? LW_PATH_METHOD_LAMPS : view->method,
                                .glossy = unlit ? LW_PATH_METHOD_LAMPS : view->method};
        const unsigned flags = first_hit ? LW_TRACE_COHERENT : 0;
        const unsigned going = b->going;
        float pick[2];
        struct bounce_draw bounce;
        draw(b, USE_PICK, depth, pick);
        draw(b, USE_BOUNCE, depth, bounce.point);
        bounce.lobe = pick[1];
        bounce.cosine = lw_direction_cosine(bounce.point);
        b->guided = view->guide && !last; /* the last rays meet nothing but what shines */
        if (view->guide) take_aim(job, b);
        if (!unlit) light(job, b, depth, by_all, count);
        for (unsigned i = 0; first_hit && i < paths; i++) b->path[i].near = b->path[i].radiance;
        if (view->guide) note_all_in_guide(job, b);
        if (last && (!rays_may_shine || !rays_bring_lamps(b, &lit))) break;
        b->going = 0;
        for (unsigned first = 0; first < going; first += LANES)
            bounce16(job, b, b->order + first, lanes_from(first, going), &bounce, flags, &lit, last, count);
    }
    if (arrived && view->clamp > 0) clamp_far(b, paths, view->clamp);
}

/* The pixels of a bundle: first + step * (0..3), both ways. `members` bundles of one seed walk one sequence
 * together. */
struct layout {
    uint32_t first_x, first_y, step;
    uint32_t seed_x, seed_y;
    uint32_t member, members;
};

/* Bundle n of a tile. */
static struct layout lay_out(enum lw_path_pattern pattern, uint32_t left, uint32_t top, uint32_t n) {
    if (pattern == LW_PATH_PATTERN_SQUARE) {
        const uint32_t x = left + n % (TILE / SQUARE) * SQUARE, y = top + n / (TILE / SQUARE) * SQUARE;
        return (struct layout){x, y, 1, x, y, 0, 1};
    }
    const uint32_t block = n / BUNDLE, x = left + block % 2 * BUNDLE, y = top + block / 2 * BUNDLE;
    /* Along a Z-curve: aligned runs of 4 points of the sequence, which are stratified, are 2 x 2
     * neighbours. */
    const uint32_t z = n % BUNDLE, i = (z & 1u) | (z >> 1 & 2u), j = (z >> 1 & 1u) | (z >> 2 & 2u);
    return (struct layout){x + i, y + j, SQUARE, x, y, z, BUNDLE};
}
_Static_assert(TILE == 2 * BUNDLE, "a tile is 2 x 2 blocks of interleaved bundles");

/* Where the film keeps a path's pixel. */
static size_t film_value(const struct job *job, const struct path *path) {
    return 3 * ((size_t)(path->y - job->part.top) * job->film->width + (path->x - job->part.left));
}

static void trace_tile(const struct job *job, uint32_t left, uint32_t top, uint32_t samples,
                       struct lw_path_count *count) {
    const struct lw_path_film *film = job->film;
    struct bundle b;
    for (uint32_t n = 0; n < TILE / SQUARE * (TILE / SQUARE); n++) {
        const struct layout at = lay_out(job->view->pattern, left, top, n);
        unsigned paths = 0;
        for (uint32_t i = 0; i < BUNDLE; i++) {
            uint32_t x = at.first_x + i % SQUARE * at.step, y = at.first_y + i / SQUARE * at.step;
            if (x < job->part.left || x >= job->part.right || y < job->part.top || y >= job->part.bottom)
                continue;
            b.path[paths].x = x;
            b.path[paths++].y = y;
        }
        if (!paths) continue;
        for (uint32_t s = film->samples; s < film->samples + samples; s++) {
            const uint32_t sample = job->view->first_sample + s;
            b.seed = lw_random_hash4(job->view->seed, sample & 1u, at.seed_x, at.seed_y);
            b.index = (sample >> 1) * at.members + at.member;
            b.set = at.member;
            b.sample = sample >> 1;
            b.salt = sample;
            trace_bundle(job, &b, paths, count);
            for (unsigned i = 0; i < paths; i++) {
                const struct path *path = &b.path[i];
                float *sum = film->half[s & 1u] + film_value(job, path);
                if (!lw_vec3_is_finite(path->radiance)) continue;
                sum[0] += path->radiance.x, sum[1] += path->radiance.y, sum[2] += path->radiance.z;
            }
        }
    }
}

bool lw_path_trace_render(const struct lw_path_trace *tracer, const struct lw_path_view *view,
                          uint32_t samples, struct lw_path_film *film, struct lw_path_count *count) {
    const struct lw_path_crop *crop = &view->crop;
    const uint32_t width = crop->width ? crop->width : film->width;
    const uint32_t height = crop->height ? crop->height : film->height;
    assert(film->width <= width && crop->x <= width - film->width);
    assert(film->height <= height && crop->y <= height - film->height);
    const struct job job = {.tracer = tracer,
                            .view = view,
                            .plane = view->first_hits ? lw_gbuffer_aim(view->first_hits)
                                                      : lw_camera_plane(&view->camera, width, height),
                            .film = film,
                            .part = {crop->x, crop->y, crop->x + film->width, crop->y + film->height}};
    assert(!view->first_hits || (view->first_hits->width == width && view->first_hits->height == height));
    /* Tiles of the whole picture that the film has pixels of. */
    const uint32_t left = job.part.left / TILE, top = job.part.top / TILE;
    const uint32_t columns = (job.part.right + TILE - 1) / TILE - left;
    const uint32_t rows = (job.part.bottom + TILE - 1) / TILE - top;
    uint64_t paths = 0, primary = 0, shadow = 0, bounce = 0;
    bool whole = true;
#pragma omp parallel for schedule(dynamic) num_threads(tracer->threads)                                      \
    reduction(+ : paths, primary, shadow, bounce) reduction(&& : whole)
    for (uint32_t t = 0; t < columns * rows; t++) {
        struct lw_path_count c = {0};
        if (view->cancel && *view->cancel) {
            whole = false;
            continue;
        }
        trace_tile(&job, (left + t % columns) * TILE, (top + t / columns) * TILE, samples, &c);
        paths += c.paths, primary += c.rays_primary, shadow += c.rays_shadow, bounce += c.rays_bounce;
    }
    if (!whole) return false;
    film->samples += samples;
    if (count == NULL) return true;
    count->paths += paths;
    count->rays_primary += primary;
    count->rays_shadow += shadow;
    count->rays_bounce += bounce;
    return true;
}
