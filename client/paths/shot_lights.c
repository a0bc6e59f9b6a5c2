#include "client/paths/shot_lights.h"

#include "common/base/colour.h"
#include "common/base/random.h"
#include "common/light/direction.h"

#include <stdlib.h>
#include <string.h>

/* Largest growth of a light with its lamp. A lamp that is nearer would have more lights. */
#define GROWTH_MAX 2.0f
/* Largest quotient of the cosines of shading and true normal. */
#define SLANT_MAX 4.0f

/* What a pair of random numbers is for. */
enum use { USE_LAMP, USE_PLACE, USE_WAY, USE_BOUNCE };

enum lw_status lw_shot_lights_init(struct lw_shot_lights *lights, const struct lw_shot_lights_desc *desc) {
    *lights = (struct lw_shot_lights){.desc = *desc};
    enum lw_status status =
        lw_virtual_paths_init(&lights->paths, desc->lights_max, desc->bounces, desc->sets);
    if (status == LW_OK) status = lw_lamp_rays_init(&lights->lamps, desc->lights);
    if (status == LW_OK) status = lw_pose_init(&lights->pose, desc->scene);
    if (status != LW_OK) return status;
    const size_t count = (size_t)lights->paths.paths * lights->paths.bounces;
    lights->light = calloc(count + 1, sizeof *lights->light);
    lights->place = calloc((size_t)desc->scene->object_count + 1, sizeof *lights->place);
    return lights->light && lights->place ? LW_OK : LW_NO_MEMORY;
}

void lw_shot_lights_finish(struct lw_shot_lights *lights) {
    free(lights->place);
    free(lights->light);
    lw_pose_finish(&lights->pose);
    lw_lamp_rays_finish(&lights->lamps);
    lw_virtual_paths_finish(&lights->paths);
    *lights = (struct lw_shot_lights){.salt = 0};
}

static const struct lw_mesh *mesh_of(const struct lw_scene *scene, uint32_t object) {
    return &scene->mesh[scene->object[object].mesh];
}

double lw_shot_lights_area_m2(const struct lw_scene *scene, const struct lw_pose *pose) {
    double area = 0;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = mesh_of(scene, o);
        for (uint32_t t = 0; t < mesh->triangle_count && !pose->object_hidden[o]; t++) {
            struct lw_vec3 corner[3];
            for (int i = 0; i < 3; i++)
                corner[i] = lw_affine_point(&pose->object_to_world[o], mesh->position[mesh->triangle[t][i]]);
            area += 0.5 * (double)lw_vec3_length(lw_vec3_cross(lw_vec3_sub(corner[1], corner[0]),
                                                               lw_vec3_sub(corner[2], corner[0])));
        }
    }
    return area;
}

/* ---- one light ---- */

struct flight {
    struct lw_shot_lights *lights;
    uint64_t rays;
};

static struct lw_vec3 load(const float v[3]) { return lw_vec3(v[0], v[1], v[2]); }
static void store(float out[3], struct lw_vec3 v) { out[0] = v.x, out[1] = v.y, out[2] = v.z; }

/* Whether a light sees a place; out_tint: of what lies between. */
static bool is_visible(struct flight *f, const struct lw_shot_light *light, struct lw_vec3 direction,
                       float distance, struct lw_vec3 *out_tint) {
    struct lw_ray16 rays = {.salt = f->lights->salt};
    float tint[3][LW_TRACE_WIDTH];
    lw_trace_set_ray(&rays, 0, load(light->position), direction, distance * LW_TRACE_SHORT);
    f->rays++;
    const uint16_t hidden = lw_trace_tinted16(f->lights->desc.trace, LW_TRACE_LIGHT, 1, &rays, tint);
    *out_tint = lw_vec3(tint[0][0], tint[1][0], tint[2][0]);
    return !hidden;
}

/* E that a first light gets from its lamp now, but for surfaces in between. */
static struct lw_vec3 e_of(const struct lw_shot_lights *lights, const struct lw_shot_light *light,
                           struct lw_light_sample *out_sample) {
    *out_sample = lw_lamp_rays_sight(&lights->lamps, &light->lamp, load(light->position));
    const float cosine = lw_vec3_dot(out_sample->direction, load(light->normal));
    const struct lw_vec3 e = lw_vec3_scale(out_sample->irradiance_normal, fmaxf(cosine, 0));
    return lw_vec3_is_finite(e) ? e : lw_vec3(0, 0, 0);
}

static bool sees_lamp(struct flight *f, struct lw_shot_light *light) {
    struct lw_light_sample sample;
    struct lw_vec3 tint, e = e_of(f->lights, light, &sample);
    const float bright = lw_colour_luminance(e), most = GROWTH_MAX * light->bright;
    if (!(bright > 0) || !is_visible(f, light, sample.direction, sample.distance_m, &tint)) return false;
    if (bright > most) e = lw_vec3_scale(e, most / bright);
    store(light->e, lw_vec3_mul(e, tint));
    return true;
}

static bool sees_parent(struct flight *f, const struct lw_shot_light *light) {
    const struct lw_shot_light *parent = light - 1;
    const struct lw_vec3 way = lw_vec3_sub(load(parent->position), load(light->position));
    struct lw_vec3 tint;
    return lw_vec3_dot(way, load(light->normal)) > 0 && lw_vec3_dot(way, load(parent->normal)) < 0 &&
           is_visible(f, light, way, 1, &tint);
}

static bool holds(void *context, uint32_t path, uint32_t bounce) {
    struct flight *f = context;
    struct lw_shot_light *light = &f->lights->light[lw_virtual_paths_light(&f->lights->paths, path, bounce)];
    return bounce ? sees_parent(f, light) : sees_lamp(f, light);
}

/* Puts a light where a ray ends; false: nothing reflects there. */
static bool land(struct flight *f, struct lw_vec3 origin, struct lw_vec3 direction,
                 struct lw_shot_light *light) {
    const struct lw_shot_lights *lights = f->lights;
    const struct lw_scene *scene = lights->desc.scene;
    struct lw_ray16 rays = {.salt = lights->salt};
    struct lw_hit16 hits;
    struct lw_surface surface;
    lw_trace_set_ray(&rays, 0, origin, direction, INFINITY);
    lw_trace_closest16(lights->desc.trace, LW_TRACE_LIGHT, 1, &rays, &hits);
    f->rays++;
    if (hits.object[0] == LW_TRACE_MISS) return false;
    const struct lw_mesh *mesh = mesh_of(scene, hits.object[0]);
    lw_scene_surface(scene, mesh, hits.triangle[0], hits.u[0], hits.v[0], &surface);
    if (hits.back[0] && !surface.material->double_sided) return false; /* a black wall */
    const struct lw_place_point point =
        lw_place_point(&lights->place[hits.object[0]], mesh, &hits, 0, &surface);
    const float shading = -lw_vec3_dot(point.normal, direction), flat = -lw_vec3_dot(point.face, direction);
    if (!(shading > 0) || !(flat > 0)) return false;
    if (!(surface.albedo.x + surface.albedo.y + surface.albedo.z > 0)) return false;
    store(light->position, point.origin);
    store(light->normal, point.normal);
    store(light->share, lw_vec3_scale(surface.albedo, fminf(shading / flat, SLANT_MAX)));
    light->object = hits.object[0];
    return true;
}

static bool shoot_first(struct flight *f, uint32_t path) {
    struct lw_shot_lights *lights = f->lights;
    const struct lw_virtual_paths *paths = &lights->paths;
    struct lw_shot_light *light = &lights->light[lw_virtual_paths_light(paths, path, 0)];
    const uint32_t number = lw_virtual_paths_number(paths, path), seed = lights->seed,
                   index = light->shots * paths->paths + number;
    const float offset = lw_random_unit(lw_random_hash4(seed, number, light->shots, USE_LAMP)),
                pick = fminf(((float)number + offset) / (float)paths->paths, 0x1.fffffep-1f);
    float place[2], way[2];
    struct lw_lamp_ray ray;
    struct lw_light_sample sample;
    struct lw_vec3 tint = lw_vec3(1, 1, 1);
    lw_random_sobol2(index, lw_random_hash2(seed, USE_PLACE), place);
    lw_random_sobol2(index, lw_random_hash2(seed, USE_WAY), way);
    light->shots++;
    if (!lw_lamp_rays_sample(&lights->lamps, pick, place, way, &ray)) return false;
    if (!land(f, lw_trace_lift(ray.origin, ray.face, lights->largest_m), ray.direction, light)) return false;
    light->lamp = ray.place;
    const struct lw_vec3 e = e_of(lights, light, &sample);
    light->bright = lw_colour_luminance(e);
    if (!(light->bright > 0)) return false;
    light->area_m2 = lw_colour_luminance(ray.flux_w) / ((float)paths->paths * light->bright);
    if (lw_trace_tints(lights->desc.trace))
        (void)is_visible(f, light, sample.direction, sample.distance_m, &tint);
    store(light->e, lw_vec3_mul(e, tint));
    return true;
}

static bool shoot_next(struct flight *f, uint32_t path, uint32_t bounce) {
    struct lw_shot_lights *lights = f->lights;
    const struct lw_virtual_paths *paths = &lights->paths;
    struct lw_shot_light *light = &lights->light[lw_virtual_paths_light(paths, path, bounce)];
    const struct lw_vec3 normal = load(light[-1].normal);
    const uint32_t index = light->shots * paths->paths + lw_virtual_paths_number(paths, path);
    float point[2];
    lw_random_sobol2(index, lw_random_hash3(lights->seed, bounce, USE_BOUNCE), point);
    light->shots++;
    return land(f, load(light[-1].position), lw_direction_about(normal, lw_direction_cosine(point)), light);
}

static bool shoot(void *context, uint32_t path, uint32_t bounce) {
    return bounce ? shoot_next(context, path, bounce) : shoot_first(context, path);
}

/* ---- all of them ---- */

static void charge(struct lw_shot_lights *lights) {
    const struct lw_virtual_paths *paths = &lights->paths;
    for (uint32_t path = 0; path < paths->paths; path++) {
        struct lw_vec3 flux = lw_vec3(0, 0, 0);
        for (uint32_t b = 0; b < paths->bounces; b++) {
            const uint32_t index = lw_virtual_paths_light(paths, path, b);
            struct lw_shot_light *light = &lights->light[index];
            if (!b) flux = lw_vec3_scale(load(light->e), light->area_m2);
            flux = lw_virtual_paths_is_lit(paths, index) ? lw_vec3_mul(flux, load(light->share))
                                                         : lw_vec3(0, 0, 0);
            store(light->flux_w, flux);
        }
    }
}

/* Loses those on objects that are elsewhere. */
static void leave(struct lw_shot_lights *lights, const struct lw_pose *pose) {
    struct lw_virtual_paths *paths = &lights->paths;
    for (uint32_t path = 0; path < paths->paths; path++)
        for (uint32_t b = 0; b < paths->bounces; b++) {
            const uint32_t index = lw_virtual_paths_light(paths, path, b);
            if (lw_virtual_paths_is_lit(paths, index) &&
                lw_pose_object_differs(&lights->pose, pose, lights->light[index].object))
                lw_virtual_paths_lose(paths, path, b);
        }
}

static void set_pose(struct lw_shot_lights *lights, const struct lw_pose *pose) {
    const struct lw_scene *scene = lights->desc.scene;
    lw_pose_copy(&lights->pose, pose, scene);
    lw_lamp_rays_set_pose(&lights->lamps, pose);
    lights->largest_m = fmaxf(lw_vec3_max_abs(lights->lamps.low), lw_vec3_max_abs(lights->lamps.high));
    for (uint32_t o = 0; o < scene->object_count; o++)
        lights->place[o] = lw_place_of(&pose->object_to_world[o]);
}

uint64_t lw_shot_lights_step(struct lw_shot_lights *lights, const struct lw_pose *pose, uint32_t seed) {
    struct flight f = {.lights = lights};
    const struct lw_virtual_paths_rays rays = {.context = &f, .holds = holds, .shoot = shoot};
    const bool first = !lights->paths.turn.shot;
    if (!lights->paths.paths || (!first && lw_pose_equal(&lights->pose, pose, lights->desc.scene))) return 0;
    if (!first) leave(lights, pose);
    set_pose(lights, pose);
    lights->seed = seed;
    if (!first) lw_virtual_paths_check(&lights->paths, &rays);
    lw_virtual_paths_shoot(&lights->paths, &rays, !first, lw_virtual_paths_set_count(&lights->paths));
    charge(lights);
    lights->salt++;
    return f.rays;
}
