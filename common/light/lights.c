#include "common/light/lights.h"

#include "common/base/cdf.h"
#include "common/base/colour.h"
#include "common/light/direction.h"
#include "common/light/light_kernels.h"
#include "common/light/spherical_triangle.h"

#include <stdlib.h>
#include <string.h>

#define HIDDEN_SHARE 0.02f /* share of a textured emitter's full emission, in its choice */
/* An emitter is sampled by solid angle where distance^2 to its middle is under NEAR_EDGES2 times its longest
 * edge squared. Farther away it is sampled by area: there 1/d^2 differs over it by a factor of 5 at most, and
 * sampling by area costs a fifth of the time. */
#define NEAR_EDGES2 3.0f
/* And only between these, sr. Below, the emitter is a sliver or seen edge on, and floats are not exact enough
 * for its corners. Above, the point almost touches it. */
#define SOLID_ANGLE_MIN 3e-4f
#define SOLID_ANGLE_MAX 6.28f
/* Bounds of bright_share where anything is bright. At most half: bright directions may be hidden from a
 * surface, which then only gets the other half. */
#define BRIGHT_SHARE_MIN 0.1f
#define BRIGHT_SHARE_MAX 0.5f

/* Whether a triangle shines the same all over. */
static bool is_uniform(const struct lw_material *m) {
    return m->emission_texture.texture == LW_SCENE_NONE && m->alpha_mode == LW_ALPHA_OPAQUE;
}

/* Emitted radiance at a point of an emitter: none where it is cut out, a share where it is transparent. */
static struct lw_vec3 radiance_at(const struct lw_scene *scene, const struct lw_mesh *mesh, uint32_t triangle,
                                  float u, float v) {
    struct lw_surface surface;
    lw_scene_surface(scene, mesh, triangle, u, v, &surface);
    return lw_vec3_scale(surface.emission, surface.alpha);
}

/* Mean emission of a triangle, from a regular set of points over it; exact where it is uniform. */
static struct lw_vec3 mean_radiance(const struct lw_scene *scene, const struct lw_mesh *mesh,
                                    uint32_t triangle) {
    const int side = is_uniform(&scene->material[mesh->material[triangle]]) ? 1 : 8;
    struct lw_vec3 sum = {0};
    int count = 0;
    for (int i = 0; i < side; i++)
        for (int j = 0; j < side - i; j++, count++)
            sum = lw_vec3_add(sum, radiance_at(scene, mesh, triangle, ((float)i + 1.0f / 3) / (float)side,
                                               ((float)j + 1.0f / 3) / (float)side));
    return lw_vec3_scale(sum, 1.0f / (float)count);
}

/* The luminance by which a triangle is chosen. Its texture may emit between the points of the mean, so it
 * keeps a share of its full emission: a weight of 0 would be a bias, a wrong weight is only noise. */
static float choice_luminance(const struct lw_material *m, struct lw_vec3 mean) {
    float luminance = lw_colour_luminance(mean);
    if (is_uniform(m)) return luminance;
    return fmaxf(luminance,
                 HIDDEN_SHARE * lw_colour_luminance(lw_vec3(m->emission[0], m->emission[1], m->emission[2])));
}

/* Whether triangles of a material are emitters here. */
static bool is_emitter(const struct lw_lights *lights, uint32_t material) {
    return lw_material_shines(&lights->scene->material[material]) &&
           (!lights->part.material || lights->part.material[material] == lights->part.value);
}

static bool has_sky(const struct lw_lights *lights) { return !lights->part.light || lights->part.sky; }

static uint32_t count_emitters(const struct lw_lights *lights) {
    const struct lw_scene *scene = lights->scene;
    uint64_t count = 0;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        for (uint32_t t = 0; t < mesh->triangle_count; t++) count += is_emitter(lights, mesh->material[t]);
    }
    return count < UINT32_MAX ? (uint32_t)count : UINT32_MAX;
}

static void list_emitters(struct lw_lights *lights) {
    const struct lw_scene *scene = lights->scene;
    uint32_t n = 0;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        lights->first_emitter[o] = n;
        for (uint32_t t = 0; t < mesh->triangle_count; t++) {
            const struct lw_material *material = &scene->material[mesh->material[t]];
            if (!is_emitter(lights, mesh->material[t])) continue;
            lights->radiance[n] = mean_radiance(scene, mesh, t);
            lights->luminance[n] = choice_luminance(material, lights->radiance[n]);
            lights->emitter[n++] =
                (struct lw_emitter){.object = o, .triangle = t, .both_sides = material->double_sided};
        }
    }
    lights->first_emitter[scene->object_count] = n;
}

static void list_punctual(struct lw_lights *lights) {
    for (uint32_t i = 0; i < lights->scene->light_count; i++) {
        if (!lw_lights_includes(lights, i)) continue;
        if (lights->scene->light[i].kind == LW_LIGHT_DIRECTIONAL)
            lights->sun[lights->sun_count++] = i;
        else
            lights->near[lights->near_count++] = i;
    }
}

static void weigh_sky(struct lw_lights *lights) {
    const float *sky = lights->scene->sky;
    lights->sky_luminance = lights->bright_share = 0;
    if (!has_sky(lights)) return;
    lights->sky_luminance = lw_colour_luminance(lw_vec3(sky[0], sky[1], sky[2])) + lights->environment.mean;
    if (lights->environment.excess > 0)
        lights->bright_share = fminf(
            fmaxf(lights->environment.excess / lights->sky_luminance, BRIGHT_SHARE_MIN), BRIGHT_SHARE_MAX);
}

enum lw_status lw_lights_init(struct lw_lights *lights, const struct lw_scene *scene,
                              const struct lw_pose *pose) {
    return lw_lights_init_part(lights, scene, pose, &(struct lw_lights_part){0});
}

enum lw_status lw_lights_init_part(struct lw_lights *lights, const struct lw_scene *scene,
                                   const struct lw_pose *pose, const struct lw_lights_part *part) {
    static const struct lw_environment none;
    *lights = (struct lw_lights){.scene = scene, .part = *part};
    lights->emitter_count = count_emitters(lights);
    const size_t count = lights->emitter_count ? lights->emitter_count : 1;
    lights->emitter = calloc(count, sizeof *lights->emitter);
    lights->radiance = calloc(count, sizeof *lights->radiance);
    lights->luminance = calloc(count, sizeof *lights->luminance);
    lights->first_emitter = calloc(scene->object_count + 1ul, sizeof *lights->first_emitter);
    lights->near = calloc(scene->light_count + 1ul, sizeof *lights->near);
    lights->sun = calloc(scene->light_count + 1ul, sizeof *lights->sun);
    lights->bounds = calloc(count + scene->light_count, sizeof *lights->bounds);
    if (!lights->emitter || !lights->radiance || !lights->luminance || !lights->first_emitter ||
        !lights->near || !lights->sun || !lights->bounds ||
        lw_environment_importance_init(&lights->environment, has_sky(lights) ? &scene->environment : &none) !=
            LW_OK) {
        lw_lights_finish(lights);
        return LW_NO_MEMORY;
    }
    list_emitters(lights);
    list_punctual(lights);
    weigh_sky(lights);
    lw_lights_set_pose(lights, pose);
    const uint32_t near = lights->emitter_count + lights->near_count;
    lights->few = near <= LW_LIGHTS_EXACT_MAX;
    if (near > 0 && lw_light_tree_init(&lights->tree, lights->bounds, near, lights->emitter_count) != LW_OK) {
        lw_lights_finish(lights);
        return LW_NO_MEMORY;
    }
    return LW_OK;
}

void lw_lights_finish(struct lw_lights *lights) {
    lw_environment_importance_finish(&lights->environment);
    lw_light_tree_finish(&lights->tree);
    free(lights->bounds);
    free(lights->sun);
    free(lights->near);
    free(lights->first_emitter);
    free(lights->luminance);
    free(lights->radiance);
    free(lights->emitter);
    *lights = (struct lw_lights){0};
}

/* The set of emissive triangles may differ, and with it the size of every array: builds everything again. */
enum lw_status lw_lights_set_materials(struct lw_lights *lights, const struct lw_pose *pose) {
    const struct lw_scene *scene = lights->scene;
    const struct lw_lights_part part = lights->part;
    lw_lights_finish(lights);
    return lw_lights_init_part(lights, scene, pose, &part);
}

static void place_emitter(struct lw_emitter *e, const struct lw_scene *scene, const struct lw_pose *pose,
                          float luminance) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[e->object].mesh];
    const struct lw_affine *t = &pose->object_to_world[e->object];
    const uint32_t *index = mesh->triangle[e->triangle];
    e->corner = lw_affine_point(t, mesh->position[index[0]]);
    e->edge_u = lw_vec3_sub(lw_affine_point(t, mesh->position[index[1]]), e->corner);
    e->edge_v = lw_vec3_sub(lw_affine_point(t, mesh->position[index[2]]), e->corner);
    struct lw_vec3 cross = lw_vec3_cross(e->edge_u, e->edge_v);
    e->area_m2 = 0.5f * lw_vec3_length(cross);
    struct lw_vec3 third = lw_vec3_sub(e->edge_v, e->edge_u);
    e->near_m2 = NEAR_EDGES2 * fmaxf(lw_vec3_dot(e->edge_u, e->edge_u),
                                     fmaxf(lw_vec3_dot(e->edge_v, e->edge_v), lw_vec3_dot(third, third)));
    e->normal = lw_vec3_scale(lw_vec3_normalize(cross), lw_affine_determinant(t) < 0 ? -1.0f : 1.0f);
    e->power = luminance * e->area_m2 * (e->both_sides ? 2.0f : 1.0f);
    if (!isfinite(e->power) || pose->object_hidden[e->object]) e->power = 0;
}

/* Turns weights into a cumulative distribution in place; false if all are zero. */
static bool accumulate(float *weight, uint32_t count) {
    double sum = 0;
    for (uint32_t i = 0; i < count; i++) sum += (double)weight[i];
    if (!(sum > 0)) return false;
    double running = 0;
    uint32_t last = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (weight[i] > 0) last = i;
        running += (double)weight[i];
        weight[i] = (float)(running / sum);
    }
    for (uint32_t i = last; i < count; i++) weight[i] = 1.0f;
    return true;
}

static struct lw_light_bounds bounds_of_emitter(const struct lw_emitter *e) {
    struct lw_vec3 a = e->corner, b = lw_vec3_add(a, e->edge_u), c = lw_vec3_add(a, e->edge_v);
    return (struct lw_light_bounds){.low = lw_vec3_min(a, lw_vec3_min(b, c)),
                                    .high = lw_vec3_max(a, lw_vec3_max(b, c)),
                                    .axis = e->normal,
                                    .spread = e->both_sides ? LW_PI : 0,
                                    .reach = 0.5f * LW_PI,
                                    .power = e->power};
}

static void note_bounds(struct lw_lights *lights) {
    for (uint32_t i = 0; i < lights->emitter_count; i++)
        lights->bounds[i] = bounds_of_emitter(&lights->emitter[i]);
    for (uint32_t i = 0; i < lights->near_count; i++) {
        const struct lw_light *light = &lights->scene->light[lights->near[i]];
        const struct lw_light_state *state = &lights->punctual[lights->near[i]];
        const bool spot = light->kind == LW_LIGHT_SPOT;
        lights->bounds[lights->emitter_count + i] =
            (struct lw_light_bounds){.low = state->position_ws,
                                     .high = state->position_ws,
                                     .axis = spot ? state->direction_ws : lw_vec3(0, 0, 1),
                                     .spread = spot ? 0 : LW_PI,
                                     .reach = spot ? light->outer_cone : 0.5f * LW_PI,
                                     .power = lw_colour_luminance(state->intensity)};
    }
}

void lw_lights_set_pose(struct lw_lights *lights, const struct lw_pose *pose) {
    lights->punctual = pose->light;
    lights->shining_count = 0;
    for (uint32_t i = 0; i < lights->emitter_count; i++) {
        place_emitter(&lights->emitter[i], lights->scene, pose, lights->luminance[i]);
        lights->shining_count += lights->emitter[i].power > 0;
    }
    note_bounds(lights);
    if (lights->tree.count) lw_light_tree_refit(&lights->tree, lights->bounds);
}

bool lw_lights_differ(const struct lw_lights *lights, const struct lw_pose *was, const struct lw_pose *is) {
    const struct lw_scene *scene = lights->scene;
    if (lw_pose_difference(was, is, scene) & (LW_POSE_LIGHTS | LW_POSE_SKY)) return true;
    for (uint32_t m = 0; m < scene->material_count; m++)
        if (memcmp(was->material[m].emission, is->material[m].emission, sizeof is->material->emission) != 0)
            return true;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (!lw_pose_object_differs(was, is, o)) continue;
        for (uint32_t e = lights->first_emitter[o]; e < lights->first_emitter[o + 1]; e++)
            if (lights->luminance[e] > 0) return true;
    }
    return false;
}

/* Emitters per ray, and most rays: past it a frame's cost no longer grows with their number. */
#define EMITTERS_PER_RAY 8u
#define EMITTER_RAYS_MAX 4u
/* Groups for each ray, which is sampled among all of them. */
#define GROUPS_PER_RAY 8u

uint32_t lw_lights_sample_groups(const struct lw_lights *lights, const struct lw_light_region *region,
                                 float pick, struct lw_light_group_sample *out_sampled) {
    struct lw_light_group group[LW_LIGHT_TREE_GROUPS_MAX];
    const bool all = lights->near_count > LW_LIGHTS_EXACT_MAX;
    uint32_t rays = (lights->shining_count + EMITTERS_PER_RAY - 1) / EMITTERS_PER_RAY;
    if (rays > EMITTER_RAYS_MAX) rays = EMITTER_RAYS_MAX;
    if (all) rays = LW_LIGHTS_EXACT_MAX;
    if (!rays) return 0;
    uint32_t groups = GROUPS_PER_RAY * rays;
    if (groups > LW_LIGHT_TREE_GROUPS_MAX) groups = LW_LIGHT_TREE_GROUPS_MAX;
    groups = lw_light_tree_split(&lights->tree, all || !lights->near_count ? 0 : 1, region, groups, group);
    return lw_light_tree_sample(group, groups, rays, pick, out_sampled);
}

/* An emitter as a point sees it, and how a direction towards it is chosen: even over its solid angle, so that
 * E / p is at most L times that, however near it is. Where it is far, even over its area. */
struct view {
    float inverse_sr;                      /* 0: by area */
    struct lw_vec3 corner;                 /* from the point */
    struct lw_spherical_triangle triangle; /* unless by area */
};

static struct view view_emitter(const struct lw_emitter *e, struct lw_vec3 point) {
    struct view view = {.corner = lw_vec3_sub(e->corner, point)};
    if (!lw_light_is_near(e, point)) return view;
    view.triangle = lw_spherical_triangle(view.corner, lw_vec3_add(view.corner, e->edge_u),
                                          lw_vec3_add(view.corner, e->edge_v));
    if (view.triangle.sr >= SOLID_ANGLE_MIN && view.triangle.sr <= SOLID_ANGLE_MAX)
        view.inverse_sr = 1 / view.triangle.sr;
    return view;
}

/* Barycentrics of the point that (u, v) choose. */
static struct lw_vec2 sample_triangle(const struct lw_emitter *e, const struct view *view, float u, float v) {
    if (!(view->inverse_sr > 0)) return lw_light_by_area(u, v);
    struct lw_vec3 d = lw_spherical_triangle_sample(&view->triangle, u, v);
    /* where the ray meets the triangle (Moeller and Trumbore 1997) */
    struct lw_vec3 p = lw_vec3_cross(d, e->edge_v), q = lw_vec3_cross(view->corner, e->edge_u);
    float scale = lw_vec3_dot(e->edge_u, p);
    float b_u = -lw_vec3_dot(view->corner, p) / scale, b_v = -lw_vec3_dot(d, q) / scale;
    b_u = fminf(fmaxf(b_u, 0), 1); /* and of no number, 0 */
    return (struct lw_vec2){b_u, fminf(fmaxf(b_v, 0), 1 - b_u)};
}

struct lw_vec3 lw_lights_radiance(const struct lw_lights *lights, uint32_t emitter, struct lw_vec2 b) {
    const struct lw_emitter *e = &lights->emitter[emitter];
    const struct lw_mesh *mesh = &lights->scene->mesh[lights->scene->object[e->object].mesh];
    if (is_uniform(&lights->scene->material[mesh->material[e->triangle]])) return lights->radiance[emitter];
    return radiance_at(lights->scene, mesh, e->triangle, b.x, b.y);
}

/* A point on emitter i, chosen with a probability; pdf includes it. */
static struct lw_light_sample sample_emitter(const struct lw_lights *lights, uint32_t i, float probability,
                                             float u, float v, struct lw_vec3 point_ws) {
    const struct lw_emitter *e = &lights->emitter[i];
    const struct view view = view_emitter(e, point_ws);
    const struct lw_vec2 b = sample_triangle(e, &view, u, v);
    return lw_light_emitter_sample(e, lw_lights_radiance(lights, i, b), probability, view.inverse_sr, b,
                                   point_ws);
}

/* Uniformly over the disc as a plane that faces it sees it: there E is what the light says, however wide the
 * disc. */
static struct lw_light_sample sample_directional(const struct lw_light *light,
                                                 const struct lw_light_state *state, float u, float v) {
    struct lw_vec3 axis = lw_vec3_scale(state->direction_ws, -1.0f), t, b;
    struct lw_light_sample sample = {
        .direction = axis, .distance_m = INFINITY, .irradiance_normal = state->intensity};
    if (light->angular_diameter > 0) {
        lw_vec3_frame(axis, &t, &b);
        float sine2 = sinf(0.5f * light->angular_diameter);
        sine2 *= sine2 * u;
        /* the widest disc ends at a right angle */
        float cosine = sqrtf(fmaxf(1e-6f, 1 - sine2)), radius = sqrtf(sine2), angle = 2 * LW_PI * v;
        sample.direction = lw_vec3_mad(lw_vec3_mad(lw_vec3_scale(axis, cosine), t, radius * cosf(angle)), b,
                                       radius * sinf(angle));
        sample.irradiance_normal = lw_vec3_scale(state->intensity, 1 / cosine);
    }
    return sample;
}

struct lw_light_sample lw_lights_sample_punctual(const struct lw_lights *lights, uint32_t light, float u,
                                                 float v, struct lw_vec3 point_ws) {
    const struct lw_light *l = &lights->scene->light[light];
    const struct lw_light_state *state = &lights->punctual[light];
    if (l->kind == LW_LIGHT_DIRECTIONAL) return sample_directional(l, state, u, v);

    return lw_light_near_sample(state, lw_light_cone_of(l), point_ws);
}

/* ---- one sample of all lights ---- */

/* Kinds of light: near lights (emitters, points, spots), suns, the sky. A kind is chosen by an estimate of
 * its contribution. The estimate does not know visibility, so each kind that can contribute keeps at least
 * KIND_SHARE. */
enum kind { NEAR, SUNS, SKY, KINDS };
#define KIND_SHARE 0.15f

struct choice {
    float probability[KINDS];
    /* cumulative over emitters, then points and spots, where they are few */
    float cdf[LW_LIGHTS_EXACT_MAX];
};

/* Estimate of an emitter's light at a point of a surface: power / distance^2, less if it faces away, but a
 * tenth at least, since its rim may face the point. 0 where emitter or surface faces away. */
static float emitter_weight(const struct lw_emitter *e, struct lw_vec3 point, struct lw_vec3 normal) {
    struct lw_vec3 a = lw_vec3_sub(e->corner, point);
    float height = -lw_vec3_dot(a, e->normal), above = lw_vec3_dot(a, normal);
    above = fmaxf(above, above + fmaxf(lw_vec3_dot(e->edge_u, normal), lw_vec3_dot(e->edge_v, normal)));
    if (above <= 0 || (!e->both_sides && height <= 0)) return 0;
    struct lw_vec3 middle = lw_vec3_mad(lw_vec3_mad(a, e->edge_u, 1.0f / 3), e->edge_v, 1.0f / 3);
    float distance2 = lw_vec3_dot(middle, middle), distance = sqrtf(distance2 + 1e-20f);
    float cosine = fmaxf(0, lw_vec3_dot(middle, normal) / distance);
    return e->power * (0.1f + fabsf(height) / distance) * (0.1f + cosine) / (distance2 + e->area_m2);
}

static float near_weight(const struct lw_lights *lights, uint32_t i, struct lw_vec3 point,
                         struct lw_vec3 normal) {
    if (i < lights->emitter_count) return emitter_weight(&lights->emitter[i], point, normal);
    struct lw_light_sample s =
        lw_lights_sample_punctual(lights, lights->near[i - lights->emitter_count], 0, 0, point);
    return lw_colour_luminance(s.irradiance_normal) * fmaxf(0, lw_vec3_dot(s.direction, normal));
}

static float sun_weight(const struct lw_lights *lights, uint32_t i, struct lw_vec3 normal) {
    const struct lw_light *light = &lights->scene->light[lights->sun[i]];
    const struct lw_light_state *state = &lights->punctual[lights->sun[i]];
    /* its disc may stand above a horizon that its centre is below */
    float cosine = -lw_vec3_dot(state->direction_ws, normal) + sinf(0.5f * light->angular_diameter);
    return lw_colour_luminance(state->intensity) * fmaxf(0, cosine);
}

static void weigh(const struct lw_lights *lights, struct lw_vec3 point, struct lw_vec3 normal,
                  struct choice *c) {
    float e[KINDS] = {0}; /* W/m^2 */
    const uint32_t count = lights->emitter_count + lights->near_count;
    for (uint32_t i = 0; i < lights->sun_count; i++) e[SUNS] += sun_weight(lights, i, normal);
    e[SKY] = LW_PI * lights->sky_luminance;
    if (!lights->few) {
        e[NEAR] = lw_light_tree_promise(&lights->tree, point, normal);
    } else {
        for (uint32_t i = 0; i < count; i++) {
            c->cdf[i] = near_weight(lights, i, point, normal);
            e[NEAR] += c->cdf[i];
        }
        if (!accumulate(c->cdf, count)) e[NEAR] = 0;
    }
    float sum = 0, shares = 0;
    for (int k = 0; k < KINDS; k++) {
        if (!isfinite(e[k])) e[k] = 1e30f;
        sum += e[k];
        shares += e[k] > 0 ? KIND_SHARE : 0;
    }
    for (int k = 0; k < KINDS; k++)
        c->probability[k] = e[k] > 0 ? KIND_SHARE + (1 - shares) * (e[k] / sum) : 0;
}

/* The rest of a choice's number: uniform in [0, 1) again. */
static float rescaled_pick(float pick, float low, float probability) {
    return fminf((pick - low) / probability, 0x1.fffffep-1f);
}

static struct lw_light_sample sample_near(const struct lw_lights *lights, uint32_t i, float probability,
                                          float u, float v, struct lw_vec3 point) {
    if (i < lights->emitter_count) return sample_emitter(lights, i, probability, u, v, point);
    struct lw_light_sample sample =
        lw_lights_sample_punctual(lights, lights->near[i - lights->emitter_count], u, v, point);
    sample.irradiance_normal = lw_vec3_scale(sample.irradiance_normal, 1 / probability);
    return sample;
}

/* Light from behind the surface, and NaN, count as none. */
static struct lw_light_sample keep_above(struct lw_light_sample sample, struct lw_vec3 normal) {
    if (lw_vec3_dot(sample.direction, normal) > 0 && lw_vec3_is_finite(sample.irradiance_normal))
        return sample;
    sample.irradiance_normal = lw_vec3(0, 0, 0);
    sample.pdf = 0;
    return sample;
}

struct lw_light_sample lw_lights_sample_near(const struct lw_lights *lights, uint32_t light,
                                             float probability, float u, float v, struct lw_vec3 point_ws,
                                             struct lw_vec3 normal_ws) {
    return keep_above(sample_near(lights, light, probability, u, v, point_ws), normal_ws);
}

static struct lw_light_sample sample_sun(const struct lw_lights *lights, float probability, float pick,
                                         float u, float v, struct lw_vec3 point, struct lw_vec3 normal) {
    float sum = 0, running = 0, weight = 0;
    uint32_t chosen = 0;
    for (uint32_t i = 0; i < lights->sun_count; i++) sum += sun_weight(lights, i, normal);
    for (uint32_t i = 0; i < lights->sun_count && running <= pick * sum; i++) {
        float w = sun_weight(lights, i, normal);
        if (!(w > 0)) continue;
        running += w;
        weight = w;
        chosen = i;
    }
    struct lw_light_sample sample = lw_lights_sample_punctual(lights, lights->sun[chosen], u, v, point);
    sample.irradiance_normal = lw_vec3_scale(sample.irradiance_normal, sum / (probability * weight));
    return sample;
}

struct lw_sky_sample lw_lights_sample_sky(const struct lw_lights *lights, float u, float v) {
    struct lw_sky_sample sky = {0};
    if (u < lights->bright_share) {
        sky.bright = true;
        sky.direction = lw_environment_importance_sample(
            &lights->environment, rescaled_pick(u, 0, lights->bright_share), v, &sky.pdf);
        sky.radiance = lw_scene_sky(lights->scene, sky.direction);
        return sky;
    }
    const float point[2] = {rescaled_pick(u, lights->bright_share, 1 - lights->bright_share), v};
    sky.direction = lw_direction_cosine(point);
    return sky;
}

struct lw_light_sample lw_lights_place_sky(const struct lw_lights *lights, const struct lw_sky_sample *sky,
                                           struct lw_vec3 normal_ws, float *out_cosine) {
    struct lw_light_sample sample = {.distance_m = INFINITY, .direction = sky->direction};
    struct lw_vec3 radiance = sky->radiance;
    float bright_pdf = sky->pdf;
    if (sky->bright) {
        *out_cosine = lw_vec3_dot(sky->direction, normal_ws);
    } else {
        sample.direction = lw_direction_about(normal_ws, sky->direction);
        *out_cosine = sky->direction.z;
        radiance = lw_scene_sky(lights->scene, sample.direction);
        bright_pdf = lw_environment_importance_pdf(&lights->environment, sample.direction);
    }
    if (!(*out_cosine > 0)) return sample;
    sample.pdf = (1 - lights->bright_share) * *out_cosine * (1 / LW_PI) + lights->bright_share * bright_pdf;
    sample.irradiance_normal = lw_vec3_scale(radiance, 1 / sample.pdf);
    return sample;
}

static struct lw_light_sample sample_sky(const struct lw_lights *lights, float probability, float u, float v,
                                         struct lw_vec3 normal) {
    float cosine;
    struct lw_sky_sample sky = lw_lights_sample_sky(lights, u, v);
    struct lw_light_sample sample = lw_lights_place_sky(lights, &sky, normal, &cosine);
    sample.pdf *= probability;
    sample.irradiance_normal = lw_vec3_scale(sample.irradiance_normal, 1 / probability);
    return sample;
}

struct lw_light_sample lw_lights_sample(const struct lw_lights *lights, struct lw_vec3 point_ws,
                                        struct lw_vec3 normal_ws, float pick, float u, float v) {
    struct choice c;
    weigh(lights, point_ws, normal_ws, &c);
    const float *p = c.probability;
    struct lw_light_sample sample = {.direction = {0, 0, 1}};
    if (pick < p[NEAR]) {
        pick = rescaled_pick(pick, 0, p[NEAR]);
        float probability = 0;
        uint32_t i = UINT32_MAX;
        if (!lights->few) {
            i = lw_light_tree_choose(&lights->tree, 0, &(struct lw_light_region){point_ws, normal_ws, 0, 1},
                                     pick, &probability);
        } else {
            i = lw_cdf_choose(c.cdf, lights->emitter_count + lights->near_count, pick);
            probability = lw_cdf_probability(c.cdf, i);
        }
        if (i == UINT32_MAX) return sample;
        sample = sample_near(lights, i, p[NEAR] * probability, u, v, point_ws);
    } else if (pick < p[NEAR] + p[SUNS])
        sample =
            sample_sun(lights, p[SUNS], rescaled_pick(pick, p[NEAR], p[SUNS]), u, v, point_ws, normal_ws);
    else if (p[SKY] > 0)
        sample = sample_sky(lights, p[SKY], u, v, normal_ws);
    return keep_above(sample, normal_ws);
}

/* Index of a triangle among the emitters, or UINT32_MAX. */
static uint32_t find_emitter(const struct lw_lights *lights, uint32_t object, uint32_t triangle) {
    uint32_t low = lights->first_emitter[object], end = lights->first_emitter[object + 1], high = end;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (lights->emitter[middle].triangle < triangle)
            low = middle + 1;
        else
            high = middle;
    }
    return low < end && lights->emitter[low].triangle == triangle ? low : UINT32_MAX;
}

float lw_lights_pdf_emitter(const struct lw_lights *lights, struct lw_vec3 point_ws, struct lw_vec3 normal_ws,
                            uint32_t object, uint32_t triangle, float u, float v, struct lw_vec3 direction,
                            float distance_m) {
    (void)u, (void)v; /* even over the triangle */
    const uint32_t i = find_emitter(lights, object, triangle);
    if (i == UINT32_MAX || !(lw_vec3_dot(direction, normal_ws) > 0) || !(lights->emitter[i].power > 0))
        return 0;
    struct choice c;
    weigh(lights, point_ws, normal_ws, &c);
    if (!(c.probability[NEAR] > 0)) return 0;
    const struct view view = view_emitter(&lights->emitter[i], point_ws);
    float probability = lights->few ? lw_cdf_probability(c.cdf, i)
                                    : lw_light_tree_probability(&lights->tree, point_ws, normal_ws, i);
    return c.probability[NEAR] * probability *
           lw_light_emitter_pdf(&lights->emitter[i], view.inverse_sr, direction, distance_m);
}

float lw_lights_pdf_sky(const struct lw_lights *lights, struct lw_vec3 point_ws, struct lw_vec3 normal_ws,
                        struct lw_vec3 direction) {
    const float cosine = lw_vec3_dot(direction, normal_ws);
    if (!(cosine > 0)) return 0;
    struct choice c;
    weigh(lights, point_ws, normal_ws, &c);
    if (!(c.probability[SKY] > 0)) return 0;
    return c.probability[SKY] *
           ((1 - lights->bright_share) * cosine / LW_PI +
            lights->bright_share * lw_environment_importance_pdf(&lights->environment, direction));
}
