#include "common/light/lamp_rays.h"

#include "common/base/colour.h"
#include "common/light/direction.h"

#include <stdlib.h>

/* The box is wider than the scene by this share of its sides: what lies in its faces is lit as well. */
#define BOX_MARGIN 1e-3f

enum lw_status lw_lamp_rays_init(struct lw_lamp_rays *lamps, const struct lw_lights *lights) {
    *lamps = (struct lw_lamp_rays){
        .lights = lights, .count = lights->emitter_count + lights->near_count + lights->sun_count + 1};
    lamps->sum = calloc(lamps->count, sizeof *lamps->sum);
    return lamps->sum ? LW_OK : LW_NO_MEMORY;
}

void lw_lamp_rays_finish(struct lw_lamp_rays *lamps) {
    free(lamps->sum);
    *lamps = (struct lw_lamp_rays){0};
}

enum kind { EMITTER, NEAR, SUN, SKY };

/* Kind of a lamp, and its index among those of its kind. */
static enum kind kind_of(const struct lw_lamp_rays *lamps, uint32_t lamp, uint32_t *out_index) {
    const struct lw_lights *lights = lamps->lights;
    *out_index = lamp;
    if (lamp < lights->emitter_count) return EMITTER;
    *out_index -= lights->emitter_count;
    if (*out_index < lights->near_count) return NEAR;
    *out_index -= lights->near_count;
    return *out_index < lights->sun_count ? SUN : SKY;
}

static struct lw_vec3 sides(const struct lw_lamp_rays *lamps) { return lw_vec3_sub(lamps->high, lamps->low); }

/* Areas of the box's faces across x, y and z as a direction sees them, m^2. */
static struct lw_vec3 shown(const struct lw_lamp_rays *lamps, struct lw_vec3 direction) {
    const struct lw_vec3 s = sides(lamps);
    return lw_vec3(s.y * s.z * fabsf(direction.x), s.z * s.x * fabsf(direction.y),
                   s.x * s.y * fabsf(direction.z));
}

static float sum_of(struct lw_vec3 v) { return v.x + v.y + v.z; }

static const struct lw_light *scene_light(const struct lw_lamp_rays *lamps, uint32_t light) {
    return &lamps->lights->scene->light[light];
}

/* A point's or spot's directions, sr. */
static float solid_angle(const struct lw_light *light) {
    const float sine = sinf(0.5f * light->outer_cone);
    return 4 * LW_PI * (light->kind == LW_LIGHT_SPOT ? sine * sine : 1);
}

static double flux_of(const struct lw_lamp_rays *lamps, uint32_t lamp) {
    const struct lw_lights *lights = lamps->lights;
    uint32_t i;
    switch (kind_of(lamps, lamp, &i)) {
    case EMITTER:
        return (double)(lights->emitter[i].power * LW_PI);
    case NEAR:
        return (double)(lw_colour_luminance(lights->punctual[lights->near[i]].intensity) *
                        solid_angle(scene_light(lamps, lights->near[i])));
    case SUN: {
        const struct lw_light_state *state = &lights->punctual[lights->sun[i]];
        return (double)(lw_colour_luminance(state->intensity) * sum_of(shown(lamps, state->direction_ws)));
    }
    default: {
        const struct lw_vec3 s = sides(lamps);
        return (double)(lights->sky_luminance * 2 * LW_PI * (s.x * s.y + s.y * s.z + s.z * s.x));
    }
    }
}

void lw_lamp_rays_set_pose(struct lw_lamp_rays *lamps, const struct lw_pose *pose) {
    double sum = 0;
    lamps->low = lamps->high = lw_vec3(0, 0, 0);
    (void)lw_pose_bounds(pose, lamps->lights->scene, &lamps->low, &lamps->high);
    const struct lw_vec3 margin = lw_vec3_scale(sides(lamps), BOX_MARGIN);
    lamps->low = lw_vec3_sub(lamps->low, margin);
    lamps->high = lw_vec3_add(lamps->high, margin);
    for (uint32_t i = 0; i < lamps->count; i++) {
        const double flux = flux_of(lamps, i);
        lamps->sum[i] = sum += flux > 0 && flux < 1e30 ? flux : 0;
    }
}

/* A lamp, and how likely it is to be sampled. */
static uint32_t choose(const struct lw_lamp_rays *lamps, float pick, double *out_probability) {
    const double total = lamps->sum[lamps->count - 1], at = (double)pick * total;
    uint32_t low = 0, high = lamps->count - 1;
    while (low < high) {
        const uint32_t middle = (low + high) / 2;
        if (lamps->sum[middle] > at)
            high = middle;
        else
            low = middle + 1;
    }
    *out_probability = (lamps->sum[low] - (low ? lamps->sum[low - 1] : 0)) / total;
    return low;
}

/* ---- rays ---- */

static void from_emitter(const struct lw_lamp_rays *lamps, uint32_t i, const float place[2],
                         const float way[2], struct lw_lamp_ray *ray) {
    const struct lw_emitter *e = &lamps->lights->emitter[i];
    const float root = sqrtf(place[0]);
    const struct lw_vec2 b = {root * (1 - place[1]), root * place[1]};
    /* The half of `way` chooses one of two sides. */
    const bool back = e->both_sides && way[0] >= 0.5f;
    const float point[2] = {e->both_sides ? 2 * way[0] - (back ? 1 : 0) : way[0], way[1]};
    ray->place.u = b.x, ray->place.v = b.y;
    ray->face = lw_vec3_scale(e->normal, back ? -1 : 1);
    ray->origin = lw_vec3_mad(lw_vec3_mad(e->corner, e->edge_u, b.x), e->edge_v, b.y);
    ray->direction = lw_direction_about(ray->face, lw_direction_cosine(point));
    ray->flux_w =
        lw_vec3_scale(lw_lights_radiance(lamps->lights, i, b), LW_PI * e->area_m2 * (e->both_sides ? 2 : 1));
}

static void from_near(const struct lw_lamp_rays *lamps, uint32_t light, const float way[2],
                      struct lw_lamp_ray *ray) {
    const struct lw_light_state *state = &lamps->lights->punctual[light];
    const float around = solid_angle(scene_light(lamps, light)),
                point[2] = {way[0] * around / (4 * LW_PI), way[1]};
    const struct lw_vec3 local = lw_direction_sphere(point);
    ray->origin = state->position_ws;
    ray->direction = scene_light(lamps, light)->kind == LW_LIGHT_SPOT
                         ? lw_direction_about(state->direction_ws, local)
                         : local;
    /* at 1 m E is as much as the intensity */
    ray->flux_w = lw_vec3_scale(
        lw_lights_sample_punctual(lamps->lights, light, 0, 0, lw_vec3_add(ray->origin, ray->direction))
            .irradiance_normal,
        around);
}

/* From the faces of the box that a lamp at infinity sees. Returns the area that it sees. */
static float from_outside(const struct lw_lamp_rays *lamps, struct lw_vec3 towards, const float way[2],
                          struct lw_lamp_ray *ray) {
    const struct lw_vec3 areas = shown(lamps, towards);
    const float area = sum_of(areas), face[3] = {areas.x, areas.y, areas.z};
    const float side[3] = {towards.x, towards.y, towards.z};
    const float low[3] = {lamps->low.x, lamps->low.y, lamps->low.z},
                high[3] = {lamps->high.x, lamps->high.y, lamps->high.z};
    float left = way[0] * area, at[3];
    int axis = 0;
    while (axis < 2 && left >= face[axis]) left -= face[axis++];
    const int a = (axis + 1) % 3, b = (axis + 2) % 3;
    const float share = face[axis] > 0 ? fminf(left / face[axis], 1) : 0;
    at[axis] = side[axis] > 0 ? high[axis] : low[axis];
    at[a] = low[a] + share * (high[a] - low[a]);
    at[b] = low[b] + way[1] * (high[b] - low[b]);
    ray->origin = lw_vec3(at[0], at[1], at[2]);
    ray->direction = lw_vec3_scale(towards, -1);
    return area;
}

static void from_sun(const struct lw_lamp_rays *lamps, uint32_t light, const float place[2],
                     const float way[2], struct lw_lamp_ray *ray) {
    const struct lw_light_sample sample =
        lw_lights_sample_punctual(lamps->lights, light, place[0], place[1], lw_vec3(0, 0, 0));
    ray->place.u = place[0], ray->place.v = place[1];
    ray->flux_w = lw_vec3_scale(sample.irradiance_normal, from_outside(lamps, sample.direction, way, ray));
}

static void from_sky(const struct lw_lamp_rays *lamps, const float place[2], const float way[2],
                     struct lw_lamp_ray *ray) {
    const struct lw_lights *lights = lamps->lights;
    const float bright = lights->bright_share;
    struct lw_vec3 towards;
    float pdf = 0;
    if (place[0] < bright) {
        towards = lw_environment_importance_sample(&lights->environment, place[0] / bright, place[1], &pdf);
    } else {
        towards = lw_direction_sphere((const float[2]){(place[0] - bright) / (1 - bright), place[1]});
        if (bright > 0) pdf = lw_environment_importance_pdf(&lights->environment, towards);
    }
    pdf = bright * pdf + (1 - bright) / (4 * LW_PI);
    ray->place.direction = towards;
    ray->flux_w =
        lw_vec3_scale(lw_scene_sky(lights->scene, towards), from_outside(lamps, towards, way, ray) / pdf);
}

bool lw_lamp_rays_sample(const struct lw_lamp_rays *lamps, float pick, const float place[2],
                         const float way[2], struct lw_lamp_ray *out_ray) {
    double probability;
    uint32_t i;
    struct lw_lamp_ray ray = {.face = {0}};
    if (!(lamps->sum[lamps->count - 1] > 0)) return false;
    ray.place.lamp = choose(lamps, pick, &probability);
    switch (kind_of(lamps, ray.place.lamp, &i)) {
    case EMITTER:
        from_emitter(lamps, i, place, way, &ray);
        break;
    case NEAR:
        from_near(lamps, lamps->lights->near[i], way, &ray);
        break;
    case SUN:
        from_sun(lamps, lamps->lights->sun[i], place, way, &ray);
        break;
    case SKY:
        from_sky(lamps, place, way, &ray);
        break;
    }
    ray.flux_w = lw_vec3_scale(ray.flux_w, (float)(1 / probability));
    if (!(sum_of(ray.flux_w) > 0) || !lw_vec3_is_finite(ray.flux_w)) return false;
    *out_ray = ray;
    return true;
}

static struct lw_light_sample emitter_sight(const struct lw_lamp_rays *lamps, uint32_t i,
                                            const struct lw_lamp_place *place, struct lw_vec3 point) {
    const struct lw_emitter *e = &lamps->lights->emitter[i];
    const struct lw_vec3 to =
        lw_vec3_sub(lw_vec3_mad(lw_vec3_mad(e->corner, e->edge_u, place->u), e->edge_v, place->v), point);
    const float distance2 = fmaxf(lw_vec3_dot(to, to), 1e-12f), distance = sqrtf(distance2);
    struct lw_light_sample sample = {.direction = lw_vec3_scale(to, 1 / distance), .distance_m = distance};
    const float cosine = -lw_vec3_dot(sample.direction, e->normal);
    if (!(e->power > 0)) return sample; /* dark or hidden */
    sample.irradiance_normal =
        lw_vec3_scale(lw_lights_radiance(lamps->lights, i, (struct lw_vec2){place->u, place->v}),
                      (e->both_sides ? fabsf(cosine) : fmaxf(cosine, 0)) / distance2);
    return sample;
}

struct lw_light_sample lw_lamp_rays_sight(const struct lw_lamp_rays *lamps, const struct lw_lamp_place *place,
                                          struct lw_vec3 point_ws) {
    const struct lw_lights *lights = lamps->lights;
    uint32_t i;
    switch (kind_of(lamps, place->lamp, &i)) {
    case EMITTER:
        return emitter_sight(lamps, i, place, point_ws);
    case NEAR:
        return lw_lights_sample_punctual(lights, lights->near[i], 0, 0, point_ws);
    case SUN:
        return lw_lights_sample_punctual(lights, lights->sun[i], place->u, place->v, point_ws);
    default:
        return (struct lw_light_sample){.direction = place->direction,
                                        .distance_m = INFINITY,
                                        .irradiance_normal = lw_scene_sky(lights->scene, place->direction)};
    }
}
