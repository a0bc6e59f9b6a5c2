#include "server/solve/radiosity/virtual_lights.h"

#include "common/base/colour.h"
#include "common/base/invariant.h"
#include "common/base/random.h"
#include "common/light/direction.h"

#include <stdlib.h>
#include <string.h>

#define LANES LW_TRACE_WIDTH
/* Samples of all lamps until one arrives: with fewer, texels that a corner of one lamp lights would have no
 * parent, and would be shot again whenever something moves. */
#define TRIES 16u

/* What a random number is for. */
enum use { USE_TEXEL, USE_LAMP, USE_POINT, USE_BOUNCE };

enum lw_status lw_virtual_lights_init(struct lw_virtual_lights *lights, const struct lw_patches *patches,
                                      uint32_t count, uint32_t bounces, uint32_t sets) {
    *lights = (struct lw_virtual_lights){.patches = patches};
    enum lw_status status = lw_virtual_paths_init(&lights->paths, count, bounces, sets);
    if (status != LW_OK) return status;
    const size_t all = (size_t)lights->paths.paths * bounces;
    const size_t packets = patches->tiles->packet_count; /* for any covered texels */
    lights->shooter = aligned_alloc(64, (all + 1) * sizeof *lights->shooter);
    lights->light = calloc(all + 1, sizeof *lights->light);
    lights->sum = malloc((packets + 2) * sizeof *lights->sum);
    if (!lights->shooter || !lights->light || !lights->sum) return LW_NO_MEMORY;
    memset(lights->shooter, 0, (all + 1) * sizeof *lights->shooter);
    return LW_OK;
}

void lw_virtual_lights_finish(struct lw_virtual_lights *lights) {
    free(lights->shooter);
    free(lights->light);
    free(lights->sum);
    lw_virtual_paths_finish(&lights->paths);
    *lights = (struct lw_virtual_lights){0};
}

size_t lw_virtual_lights_memory_bytes(const struct lw_virtual_lights *lights) {
    return (size_t)lights->paths.paths * lights->paths.bounces *
               (sizeof *lights->shooter + sizeof *lights->light + sizeof *lights->paths.state) +
           (lights->patches->packet_count + 1ul) * sizeof *lights->sum;
}

static uint32_t index_of(const struct lw_virtual_lights *v, uint32_t path, uint32_t bounce) {
    return lw_virtual_paths_light(&v->paths, path, bounce);
}

static uint32_t number_of(const struct lw_virtual_lights *v, uint32_t path) {
    return lw_virtual_paths_number(&v->paths, path);
}

void lw_virtual_lights_leave(struct lw_virtual_lights *lights, const struct lw_pose *was,
                             const struct lw_pose *is) {
    for (uint32_t path = 0; path < lights->paths.paths && lights->paths.turn.shot; path++)
        for (uint32_t b = 0; b < lights->paths.bounces; b++) {
            const uint32_t index = index_of(lights, path, b);
            if (lw_virtual_paths_is_lit(&lights->paths, index) &&
                lw_pose_object_differs(was, is, lights->light[index].object))
                lw_virtual_paths_lose(&lights->paths, path, b);
        }
}

/* ---- patches ---- */

static struct lw_vec3 albedo_of(const struct lw_patches *patches, uint32_t texel) {
    const struct lw_tiles *tiles = patches->tiles;
    const struct lw_solve_tile *tile =
        lw_tiles_at(tiles, (lw_tile_id){tiles->block[tiles->block_of_texel[texel]].tile_id});
    return lw_packed_albedo_unpack(tile->mesh->albedo[tile->local + (texel - tile->first)]);
}

static uint32_t object_of(const struct lw_patches *patches, uint32_t texel) {
    const struct lw_tiles *tiles = patches->tiles;
    return lw_tiles_at(tiles, (lw_tile_id){tiles->block[tiles->block_of_texel[texel]].tile_id})->object;
}

/* Light that a patch reflects, by which it is sampled. */
static double reflected(const struct lw_patches *patches, float *const *direct, uint32_t texel) {
    const struct lw_vec3 e = lw_vec3(direct[0][texel], direct[1][texel], direct[2][texel]);
    const double l =
        (double)(lw_colour_luminance(lw_vec3_mul(albedo_of(patches, texel), e)) * patches->area_m2[texel]);
    return l > 0 && l < 1e30 ? l : 0;
}

static void sum_up(struct lw_virtual_lights *v, float *const *direct) {
    const struct lw_patches *patches = v->patches;
    v->sum[0] = 0;
    for (uint32_t p = 0; p < patches->packet_count; p++) {
        v->sum[p + 1] = v->sum[p];
        for (int i = 0; i < LANES && patches->packet[p].active >> i & 1; i++)
            v->sum[p + 1] += reflected(patches, direct, patches->packet[p].texel[i]);
    }
    LW_INVARIANT(isfinite(v->sum[patches->packet_count]));
}

/* The patch at a place of that sum; out_share: what it has of it. NONE: rounding has it. */
static uint32_t draw_patch(const struct lw_virtual_lights *v, float *const *direct, double at,
                           double *out_share) {
    const struct lw_patches *patches = v->patches;
    uint32_t lo = 0, hi = patches->packet_count;
    LW_INVARIANT(at >= 0 && at < v->sum[hi] * 1.000001);
    while (hi - lo > 1) {
        const uint32_t middle = lo + (hi - lo) / 2;
        if (v->sum[middle] <= at)
            lo = middle;
        else
            hi = middle;
    }
    double left = at - v->sum[lo];
    uint32_t last = LW_TEXEL_NONE;
    for (int i = 0; i < LANES && patches->packet[lo].active >> i & 1; i++) {
        const uint32_t texel = patches->packet[lo].texel[i];
        const double share = reflected(patches, direct, texel);
        if (!(share > 0)) continue;
        last = texel;
        *out_share = share;
        if ((left -= share) < 0) break;
    }
    return last;
}

/* ---- rays ---- */

struct flight {
    struct lw_virtual_lights *v;
    const struct lw_virtual_lights_shot *shot;
    uint64_t rays;
};

static struct lw_vec3 place_of(const struct lw_shooter *s) {
    return lw_vec3(s->position[0], s->position[1], s->position[2]);
}
static struct lw_vec3 facing(const struct lw_shooter *s) {
    return lw_vec3(s->normal[0], s->normal[1], s->normal[2]);
}

static bool sees(struct flight *f, struct lw_vec3 from, struct lw_vec3 direction, float distance) {
    struct lw_ray16 rays = {.salt = f->shot->salt};
    lw_trace_set_ray(&rays, 0, from, direction, distance * LW_TRACE_SHORT);
    f->rays++;
    return !lw_trace_occluded16(f->shot->trace, LW_TRACE_LIGHT, 1, &rays);
}

/* The first of a path and its lamp. */
static bool sees_lamp(struct flight *f, const struct lw_shooter *s, const float sample[3]) {
    const struct lw_vec3 place = place_of(s), normal = facing(s);
    const struct lw_light_sample lamp =
        lw_lights_sample(f->shot->lamps, place, normal, sample[0], sample[1], sample[2]);
    const struct lw_vec3 e = lamp.irradiance_normal;
    return e.x + e.y + e.z > 0 && lw_vec3_dot(normal, lamp.direction) > 0 &&
           sees(f, place, lamp.direction, lamp.distance_m);
}

static bool sees_parent(struct flight *f, uint32_t index) {
    const struct lw_shooter *s = &f->v->shooter[index], *parent = s - 1;
    const struct lw_vec3 way = lw_vec3_sub(place_of(parent), place_of(s));
    return lw_vec3_dot(way, facing(s)) > 0 && lw_vec3_dot(way, facing(parent)) < 0 &&
           sees(f, place_of(s), way, 1);
}

/* Between two shots only where something has moved: p was chosen by the light of a few samples, and where
 * they had none there is no light that could follow. */
static void read_light(struct flight *f, uint32_t index) {
    struct lw_virtual_light *light = &f->v->light[index];
    for (int c = 0; c < 3; c++) light->e[c] = f->shot->direct[c][light->texel];
}

static bool holds(void *context, uint32_t path, uint32_t bounce) {
    struct flight *f = context;
    const uint32_t index = index_of(f->v, path, bounce);
    const struct lw_virtual_light *light = &f->v->light[index];
    if (bounce) return sees_parent(f, index);
    read_light(f, index);
    return light->sample[0] >= 0 && sees_lamp(f, &f->v->shooter[index], light->sample);
}

/* ---- shots ---- */

static bool shoot_first(struct flight *f, uint32_t path) {
    struct lw_virtual_lights *v = f->v;
    const struct lw_patches *patches = v->patches;
    struct lw_virtual_light *light = &v->light[index_of(v, path, 0)];
    struct lw_shooter *s = &v->shooter[index_of(v, path, 0)];
    const double total = v->sum[patches->packet_count];
    const uint32_t number = number_of(v, path);
    const float pick = lw_random_unit(lw_random_hash4(f->shot->seed, number, light->shots, USE_TEXEL));
    double share;
    light->texel = total > 0 ? draw_patch(v, f->shot->direct,
                                          total * ((double)number + (double)pick) / v->paths.paths, &share)
                             : LW_TEXEL_NONE;
    light->shots++;
    if (light->texel == LW_TEXEL_NONE) return false;
    LW_INVARIANT(patches->place[light->texel] != LW_TEXEL_NONE && share > 0);
    struct lw_vec3 normal;
    const struct lw_vec3 place = lw_patches_place_of(patches, light->texel, &normal);
    lw_shooter_set_place(s, place, normal);
    light->object = object_of(patches, light->texel);
    light->scale = (float)((double)patches->area_m2[light->texel] * total / (share * v->paths.paths));
    read_light(f, index_of(v, path, 0));
    for (uint32_t n = 0; n < TRIES; n++) {
        const uint32_t turn = light->shots * TRIES + n;
        light->sample[0] = lw_random_unit(lw_random_hash4(f->shot->seed, number, turn, USE_LAMP));
        lw_random_sobol2(turn, lw_random_hash3(f->shot->seed, number, USE_POINT), light->sample + 1);
        if (sees_lamp(f, s, light->sample)) return true;
    }
    light->sample[0] = -1; /* it is lit, says its texel; it is shot again when something moves */
    return true;
}

static bool shoot_next(struct flight *f, uint32_t path, uint32_t bounce) {
    struct lw_virtual_lights *v = f->v;
    const uint32_t index = index_of(v, path, bounce);
    struct lw_virtual_light *light = &v->light[index];
    const struct lw_shooter *parent = &v->shooter[index - 1];
    float point[2];
    lw_random_sobol2(light->shots++, lw_random_hash4(f->shot->seed, number_of(v, path), bounce, USE_BOUNCE),
                     point);
    const struct lw_vec3 direction = lw_direction_about(facing(parent), lw_direction_cosine(point));
    struct lw_ray16 rays = {.salt = f->shot->salt};
    struct lw_hit16 hits;
    lw_trace_set_ray(&rays, 0, place_of(parent), direction, INFINITY);
    lw_trace_closest16(f->shot->trace, LW_TRACE_LIGHT, 1, &rays, &hits);
    f->rays++;
    if (hits.object[0] == LW_TRACE_MISS) return false;
    const uint32_t texel = lw_texels_at(v->patches->texels, hits.object[0], hits.triangle[0], hits.u[0],
                                        hits.v[0], hits.back[0]);
    if (texel == LW_TEXEL_NONE || v->patches->place[texel] == LW_TEXEL_NONE) return false;
    struct lw_vec3 normal;
    (void)lw_patches_place_of(v->patches, texel, &normal);
    if (!(lw_vec3_dot(normal, direction) < 0)) return false;
    lw_shooter_set_place(
        &v->shooter[index],
        lw_trace_lift(lw_vec3_mad(place_of(parent), direction, hits.t[0]), normal, f->shot->largest_m),
        normal);
    light->texel = texel;
    light->object = hits.object[0];
    return true;
}

static bool shoot(void *context, uint32_t path, uint32_t bounce) {
    return bounce ? shoot_next(context, path, bounce) : shoot_first(context, path);
}

static void charge(struct lw_virtual_lights *v) {
    for (uint32_t path = 0; path < v->paths.paths; path++) {
        struct lw_vec3 flux = lw_vec3(0, 0, 0);
        for (uint32_t b = 0; b < v->paths.bounces; b++) {
            const uint32_t index = index_of(v, path, b);
            const struct lw_virtual_light *light = &v->light[index];
            if (!b) flux = lw_vec3_scale(lw_vec3(light->e[0], light->e[1], light->e[2]), light->scale);
            flux = lw_virtual_paths_is_lit(&v->paths, index)
                       ? lw_vec3_mul(flux, albedo_of(v->patches, light->texel))
                       : lw_vec3(0, 0, 0);
            LW_INVARIANT_DEAR(lw_vec3_is_finite(flux));
            memcpy(v->shooter[index].flux_w, &flux, sizeof flux);
        }
    }
}

uint64_t lw_virtual_lights_shoot(struct lw_virtual_lights *lights,
                                 const struct lw_virtual_lights_shot *shot) {
    struct flight f = {.v = lights, .shot = shot};
    const struct lw_virtual_paths_rays rays = {.context = &f, .holds = holds, .shoot = shoot};
    if (!lights->paths.paths) return 0;
    if (shot->checks && lights->paths.turn.shot) lw_virtual_paths_check(&lights->paths, &rays);
    if (lw_virtual_paths_lack(&lights->paths) || shot->rotates) sum_up(lights, shot->direct);
    lw_virtual_paths_shoot(&lights->paths, &rays, shot->rotates, shot->most);
    charge(lights);
    return f.rays;
}
