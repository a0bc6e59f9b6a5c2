#include "server/solve/radiosity/patches.h"

#include "common/base/invariant.h"
#include "common/base/random.h"
#include "server/solve/transport/ray_launch.h"

#include <stdlib.h>
#include <string.h>

#define LANES LW_TRACE_WIDTH
/* A texel's square is looked at in this many points a side. */
#define SPOTS 8

/* Room for the packets of all tiles: where something stands elsewhere, tiles may have more than before. */
static bool make_room(struct lw_patches *patches) {
    const struct lw_tiles *tiles = patches->tiles;
    uint32_t packets = 0;
    for (uint32_t i = 0; i < tiles->count; i++)
        LW_TILES_EACH_BLOCK (&tiles->tile[i], block) packets += block->packet_count;
    if (patches->packet && packets <= patches->packet_capacity) return true;
    free(patches->packet);
    patches->packet_count = 0;
    patches->packet_capacity = packets;
    patches->packet = aligned_alloc(64, (packets + 1ul) * sizeof *patches->packet);
    return patches->packet != NULL;
}

enum lw_status lw_patches_init(struct lw_patches *patches, const struct lw_tiles *tiles,
                               const struct lw_texels *texels) {
    *patches = (struct lw_patches){.tiles = tiles, .texels = texels};
    patches->area_m2 = calloc(texels->count + 1ul, sizeof *patches->area_m2);
    patches->place = malloc((texels->count + 1ul) * sizeof *patches->place);
    patches->first_packet = malloc((tiles->count + 1ul) * sizeof *patches->first_packet);
    return make_room(patches) && patches->area_m2 && patches->place && patches->first_packet ? LW_OK
                                                                                             : LW_NO_MEMORY;
}

void lw_patches_finish(struct lw_patches *patches) {
    free(patches->packet);
    free(patches->first_packet);
    free(patches->area_m2);
    free(patches->place);
    free(patches->emission);
    *patches = (struct lw_patches){0};
}

size_t lw_patches_memory_bytes(const struct lw_patches *patches) {
    return patches->packet_capacity * sizeof *patches->packet +
           patches->tiles->count * sizeof *patches->first_packet +
           patches->texels->count * (sizeof *patches->area_m2 + sizeof *patches->place +
                                     (patches->emission ? sizeof *patches->emission : 0));
}

/* ---- areas ---- */

/* The texel that a spot of the lightmap belongs to, or NONE: what lies inside other objects shines for
 * nobody. */
static uint32_t texel_of(const struct lw_texels *texels, uint32_t object, uint32_t x, uint32_t y) {
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[object].mesh];
    if (x >= mesh->width || y >= mesh->height) return LW_TEXEL_NONE;
    const uint32_t local = lw_texels_index(mesh, x, y), texel = texels->first[object] + local;
    if (texels->covered[texel]) return texel;
    return mesh->covered[local] ? LW_TEXEL_NONE : texels->source[texel];
}

/* One side of a triangle: its share of the lightmap, spot by spot. */
struct side {
    const struct lw_texels *texels;
    uint32_t object;
    struct lw_vec2 corner[3]; /* texels */
    double det;
};

/* Barycentrics of the 2nd and 3rd corner; false outside. */
static bool inside(const struct side *s, double x, double y, struct lw_vec2 *out) {
    const double ax = (double)s->corner[0].x, ay = (double)s->corner[0].y;
    const double ux = (double)s->corner[1].x - ax, uy = (double)s->corner[1].y - ay,
                 vx = (double)s->corner[2].x - ax, vy = (double)s->corner[2].y - ay;
    const double u = ((x - ax) * vy - (y - ay) * vx) / s->det, v = ((y - ay) * ux - (x - ax) * uy) / s->det;
    *out = (struct lw_vec2){(float)u, (float)v};
    return u >= 0 && v >= 0 && u + v <= 1;
}

typedef void spot_fn(void *user, uint32_t texel, struct lw_vec2 b);

/* Calls back for every spot inside; for the middle of the triangle where there is none. */
static void each_spot(const struct side *s, spot_fn *fn, void *user) {
    float lo_x = INFINITY, lo_y = INFINITY, hi_x = 0, hi_y = 0;
    for (int k = 0; k < 3; k++) {
        lo_x = fminf(lo_x, s->corner[k].x), hi_x = fmaxf(hi_x, s->corner[k].x);
        lo_y = fminf(lo_y, s->corner[k].y), hi_y = fmaxf(hi_y, s->corner[k].y);
    }
    bool any = false;
    if (s->det != 0)
        for (int j = (int)(lo_y * SPOTS); j <= (int)(hi_y * SPOTS); j++)
            for (int i = (int)(lo_x * SPOTS); i <= (int)(hi_x * SPOTS); i++) {
                struct lw_vec2 b;
                if (!inside(s, (i + 0.5) / SPOTS, (j + 0.5) / SPOTS, &b)) continue;
                any = true;
                fn(user, texel_of(s->texels, s->object, (uint32_t)(i / SPOTS), (uint32_t)(j / SPOTS)), b);
            }
    if (any) return;
    const float x = (s->corner[0].x + s->corner[1].x + s->corner[2].x) / 3,
                y = (s->corner[0].y + s->corner[1].y + s->corner[2].y) / 3;
    fn(user, texel_of(s->texels, s->object, (uint32_t)fmaxf(x, 0), (uint32_t)fmaxf(y, 0)),
       (struct lw_vec2){1.0f / 3, 1.0f / 3});
}

static void count_spot(void *user, uint32_t texel, struct lw_vec2 b) {
    (void)texel, (void)b;
    ++*(uint32_t *)user;
}

struct deal {
    struct lw_patches *patches;
    const struct lw_lights *lights;
    uint32_t emitter; /* index, or LW_TEXEL_NONE */
    float area_m2;    /* each spot's */
};

static void deal_spot(void *user, uint32_t texel, struct lw_vec2 b) {
    const struct deal *d = user;
    if (texel == LW_TEXEL_NONE) return;
    d->patches->area_m2[texel] += d->area_m2;
    if (d->emitter == LW_TEXEL_NONE) return;
    const struct lw_vec3 l = lw_lights_radiance(d->lights, d->emitter, b);
    float *sum = d->patches->emission[texel];
    sum[0] += l.x * d->area_m2, sum[1] += l.y * d->area_m2, sum[2] += l.z * d->area_m2;
}

static void deal_side(struct deal *d, const struct side *side, float area_m2) {
    uint32_t spots = 0;
    each_spot(side, count_spot, &spots);
    LW_INVARIANT(spots > 0 && area_m2 >= 0);
    d->area_m2 = area_m2 / (float)spots;
    each_spot(side, deal_spot, d);
}

/* Emitters of an object are sorted by triangle. */
static uint32_t emitter_of(const struct lw_lights *lights, uint32_t object, uint32_t triangle) {
    uint32_t lo = lights->first_emitter[object], hi = lights->first_emitter[object + 1];
    while (lo < hi) {
        const uint32_t middle = lo + (hi - lo) / 2;
        if (lights->emitter[middle].triangle < triangle)
            lo = middle + 1;
        else
            hi = middle;
    }
    return lo < lights->first_emitter[object + 1] && lights->emitter[lo].triangle == triangle ? lo
                                                                                              : LW_TEXEL_NONE;
}

static void deal_object(struct lw_patches *patches, const struct lw_pose *pose,
                        const struct lw_lights *lights, uint32_t object) {
    const struct lw_scene *scene = patches->texels->scene;
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    const struct lw_affine *to_world = &pose->object_to_world[object];
    if (!mesh->lightmap_uv || pose->object_hidden[object]) return;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t *i = mesh->triangle[t];
        struct lw_vec3 p[3];
        struct side side = {.texels = patches->texels, .object = object};
        for (int k = 0; k < 3; k++) {
            p[k] = lw_affine_point(to_world, mesh->position[i[k]]);
            side.corner[k] = mesh->lightmap_uv[i[k]];
        }
        const float area =
            0.5f * lw_vec3_length(lw_vec3_cross(lw_vec3_sub(p[1], p[0]), lw_vec3_sub(p[2], p[0])));
        side.det =
            (double)(side.corner[1].x - side.corner[0].x) * (double)(side.corner[2].y - side.corner[0].y) -
            (double)(side.corner[1].y - side.corner[0].y) * (double)(side.corner[2].x - side.corner[0].x);
        struct deal d = {.patches = patches, .lights = lights, .emitter = emitter_of(lights, object, t)};
        deal_side(&d, &side, area);
        if (!mesh->back_offset || !scene->material[mesh->material[t]].double_sided) continue;
        for (int k = 0; k < 3; k++) side.corner[k].y += (float)mesh->back_offset;
        deal_side(&d, &side, area);
    }
}

/* From sums over a texel's area to its mean; then what of it lies inside others goes. */
static void average_texels(struct lw_patches *patches, uint32_t object) {
    const struct lw_texels *texels = patches->texels;
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[object].mesh];
    for (uint32_t local = 0; local < mesh->texel_count; local++) {
        const uint32_t texel = texels->first[object] + local;
        const float area = patches->area_m2[texel];
        if (!(area > 0)) continue;
        for (int c = 0; patches->emission && c < 3; c++) patches->emission[texel][c] /= area;
        const uint32_t points = mesh->sample_points.first[local + 1] - mesh->sample_points.first[local];
        if (points)
            patches->area_m2[texel] *= (float)__builtin_popcount(texels->usable[texel]) / (float)points;
        LW_INVARIANT_DEAR(isfinite(patches->area_m2[texel]) && patches->area_m2[texel] <= area);
    }
}

enum lw_status lw_patches_set_pose(struct lw_patches *patches, const struct lw_pose *pose,
                                   const struct lw_lights *lights, int threads) {
    const struct lw_texels *texels = patches->texels;
    if (!make_room(patches)) return LW_NO_MEMORY;
    memset(patches->area_m2, 0, texels->count * sizeof *patches->area_m2);
    if (lights->shining_count && !patches->emission &&
        !(patches->emission = malloc((texels->count + 1ul) * sizeof *patches->emission)))
        return LW_NO_MEMORY;
    if (patches->emission) memset(patches->emission, 0, texels->count * sizeof *patches->emission);
    if (!lights->shining_count) {
        free(patches->emission);
        patches->emission = NULL;
    }
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads)
    for (uint32_t o = 0; o < texels->scene->object_count; o++) {
        deal_object(patches, pose, lights, o);
        average_texels(patches, o);
    }
    return LW_OK;
}

/* ---- places ---- */

static uint32_t point_near_middle(const struct lw_mesh_texels *mesh, uint32_t local, uint8_t usable) {
    const struct lw_sample_points *points = &mesh->sample_points;
    const uint32_t first = points->first[local], count = (uint32_t)__builtin_popcount(usable);
    uint32_t texel[LANES], point[LANES], best = 0;
    struct lw_sample_points_lanes at;
    struct lw_vec3 middle = {0};
    float nearest = INFINITY;
    LW_INVARIANT_DEAR(count > 0);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        texel[lane] = local;
        point[lane] = first + (usable >> lane & 1 ? lane : (uint32_t)__builtin_ctz(usable));
    }
    lw_sample_points_load(points, mesh->position, texel, point, &at);
    for (uint32_t k = 0; k < LW_SAMPLE_POINTS_MAX; k++)
        if (usable >> k & 1)
            middle = lw_vec3_mad(middle, lw_vec3(at.at.x[k], at.at.y[k], at.at.z[k]), 1 / (float)count);
    for (uint32_t k = 0; k < LW_SAMPLE_POINTS_MAX; k++) {
        const struct lw_vec3 d = lw_vec3_sub(lw_vec3(at.at.x[k], at.at.y[k], at.at.z[k]), middle);
        const float distance = lw_vec3_dot(d, d);
        if (usable >> k & 1 && distance < nearest) nearest = distance, best = k;
    }
    return first + best;
}

static void place_packet(struct lw_patches *patches, struct lw_ray_launch_site *site,
                         const struct lw_solve_tile *tile, const struct lw_solve_block *block, uint32_t set,
                         uint32_t turn, struct lw_patches_packet *out) {
    struct lw_ray_launch launch;
    lw_ray_launch_init(&launch, tile, block, set);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        const uint32_t local = tile->local + launch.texel[lane];
        out->texel[lane] = tile->first + launch.texel[lane];
        const uint8_t usable = patches->texels->usable[out->texel[lane]];
        launch.point[lane] =
            turn ? tile->mesh->sample_points.first[local] +
                       lw_sample_points_choose(usable, turn - 1, lw_random_hash2(out->texel[lane], 1))
                 : point_near_middle(tile->mesh, local, usable);
    }
    lw_ray_launch_place(&launch, tile, site);
    out->active = launch.active;
    out->at = site->lanes.at;
    out->coherent = site->coherent;
}

void lw_patches_place(struct lw_patches *patches, const struct lw_pose *pose, uint32_t turn, int threads) {
    const struct lw_tiles *tiles = patches->tiles;
    memset(patches->place, 0xff, patches->texels->count * sizeof *patches->place); /* LW_TEXEL_NONE */
    patches->packet_count = patches->count = 0;
    for (uint32_t i = 0; i < tiles->count; i++) {
        patches->first_packet[i] = patches->packet_count;
        if (tiles->tile[i].hidden) continue;
        LW_TILES_EACH_BLOCK (&tiles->tile[i], block) patches->packet_count += block->packet_count;
    }
    LW_INVARIANT(patches->packet_count <= patches->packet_capacity);
    uint32_t covered = 0;
#pragma omp parallel for schedule(dynamic, 8) num_threads(threads) reduction(+ : covered)
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        struct lw_ray_launch_site site;
        if (tile->hidden) continue;
        uint32_t n = patches->first_packet[i];
        lw_sample_points_frame_init(&site.frame, &pose->object_to_world[tile->object]);
        LW_TILES_EACH_BLOCK (tile, block)
            for (uint32_t set = 0; set < block->packet_count; set++, n++) {
                LW_INVARIANT_DEAR(n < patches->packet_count);
                struct lw_patches_packet *out = &patches->packet[n];
                place_packet(patches, &site, tile, block, set, turn, out);
                for (uint32_t lane = 0; lane < block->packet[set].count; lane++)
                    patches->place[out->texel[lane]] = n * LANES + lane;
                covered += block->packet[set].count;
            }
    }
    LW_INVARIANT(covered <= LANES * patches->packet_count && covered <= patches->texels->count);
    patches->count = covered;
}
