#include "client/view/compose.h"

#include "common/scene/environment.h"
#include "common/scene/lightmap.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

#define SCREEN_TILE 32u /* pixels; the unit that a thread takes */
#define BLOCK       4u  /* pixels; one packet is BLOCK x BLOCK */

_Static_assert(BLOCK *BLOCK == LW_TRACE_WIDTH, "a packet is one block of pixels");

/* A share of light that no 8-bit picture shows. */
#define TRANSMITTANCE_MIN 1e-4f
/* Seen at a grazing angle a pixel covers a long strip; past this its level would only blur. */
#define COSINE_MIN 0.05f

/* Tiles with more error than this are read at level 2, or at level 1: 16 and 4 times the samples. */
#define COARSE_ERROR 0.25f
#define MIDDLE_ERROR 0.1f

/* A survey sees so much more than the view, in each direction, and is so many pixels wide or high. */
#define SURVEY_MARGIN 1.4f
#define SURVEY_SIDE   128u

/* One level of one object, with the pointers of this render. */
struct level {
    const float *rgb; /* NULL: not there */
    uint32_t width, height;
    uint32_t tiles_x, first_tile; /* the tile's id in the scene */
};

struct object {
    const struct level *level;
    uint32_t level_count;
};

struct lw_compose {
    const struct lw_scene *scene;
    const struct lw_atlas_map *map;
    const struct lw_trace *trace;
    int threads;
    bool unfiltered;

    struct level *level; /* of all objects */
    struct object *object;
    float **
        density; /* per mesh, per triangle: texels per unit of object space; 0: coarser levels mix other light in */
    uint8_t *here;   /* per tile */
    uint8_t *calm;   /* per tile: the finest level at which its noise is bearable */
    uint8_t *needed; /* per tile; written by all threads, only ever with 1 */
    uint8_t *around; /* the same, by the last survey */
    float *survey;   /* its pixels, which nobody sees */

    /* this render's */
    const struct lw_pose *pose;
    struct lw_vec3 sky;
    struct lw_vec3 stand_in; /* irradiance where nothing at all has arrived */
};

static struct lw_client_level client_level(const void *context, uint32_t object, uint32_t level) {
    return lw_client_get_level(context, object, level);
}

static struct lw_client_tile client_tile(const void *context, lw_tile_id tile) {
    return lw_client_get_tile(context, tile);
}

struct lw_compose_source lw_compose_source_of(const struct lw_client *client) {
    struct lw_client_stats stats;
    lw_client_get_stats(client, &stats);
    return (struct lw_compose_source){.context = client,
                                      .level = client_level,
                                      .tile = client_tile,
                                      .sky = lw_vec3(stats.sky[0], stats.sky[1], stats.sky[2]),
                                      .bounces = stats.bounces,
                                      .target_error = stats.target_error};
}

static float triangle_density(const struct lw_mesh *mesh, uint32_t triangle) {
    const uint32_t *v = mesh->triangle[triangle];
    const struct lw_vec2 *uv = mesh->lightmap_uv;
    struct lw_vec3 a = lw_vec3_sub(mesh->position[v[1]], mesh->position[v[0]]);
    struct lw_vec3 b = lw_vec3_sub(mesh->position[v[2]], mesh->position[v[0]]);
    float area = lw_vec3_length(lw_vec3_cross(a, b));
    float texels = fabsf((uv[v[1]].x - uv[v[0]].x) * (uv[v[2]].y - uv[v[0]].y) -
                         (uv[v[1]].y - uv[v[0]].y) * (uv[v[2]].x - uv[v[0]].x));
    return area > 1e-30f ? sqrtf(texels / area) : 0.0f;
}

static bool measure_densities(struct lw_compose *compose) {
    const struct lw_scene *scene = compose->scene;
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        const struct lw_mesh *mesh = &scene->mesh[m];
        if (mesh->lightmap_uv == NULL || mesh->triangle_count == 0) continue;
        float *density = malloc(mesh->triangle_count * sizeof *density);
        if (density == NULL) return false;
        compose->density[m] = density;
        uint8_t *shared = malloc(mesh->triangle_count);
        const bool known = shared && lw_lightmap_shared(mesh, shared) == LW_OK;
        for (uint32_t t = 0; known && t < mesh->triangle_count; t++)
            density[t] = shared[t] ? 0 : triangle_density(mesh, t);
        free(shared);
        if (!known) return false;
    }
    return true;
}

static void lay_out_levels(struct lw_compose *compose) {
    const struct lw_atlas_map *map = compose->map;
    struct level *level = compose->level;
    for (uint32_t o = 0; o < map->object_count; o++) {
        const struct lw_atlas *atlas = &map->atlas[o];
        compose->object[o] = (struct object){.level = level, .level_count = atlas->level_count};
        for (uint32_t k = 0; k < atlas->level_count; k++)
            *level++ = (struct level){.width = atlas->level[k].width,
                                      .height = atlas->level[k].height,
                                      .tiles_x = atlas->level[k].tiles_x,
                                      .first_tile = map->first_tile[o] + atlas->level[k].first_tile};
    }
}

enum lw_status lw_compose_create(const struct lw_compose_desc *desc, struct lw_compose **out_compose,
                                 struct lw_error *err) {
    const struct lw_atlas_map *map = desc->map;
    size_t level_count = 0;
    for (uint32_t o = 0; o < map->object_count; o++) level_count += map->atlas[o].level_count;

    struct lw_compose *compose = calloc(1, sizeof *compose);
    if (compose == NULL) goto fail;
    compose->scene = desc->scene;
    compose->map = map;
    compose->trace = desc->trace;
    compose->unfiltered = desc->unfiltered;
    compose->threads = desc->threads ? (int)desc->threads : omp_get_max_threads();
    /* one more of each: an empty scene is no failure */
    compose->level = calloc(level_count + 1, sizeof *compose->level);
    compose->object = calloc((size_t)map->object_count + 1, sizeof *compose->object);
    compose->density = calloc((size_t)desc->scene->mesh_count + 1, sizeof *compose->density);
    compose->here = calloc((size_t)map->tile_count + 1, 1);
    compose->calm = calloc((size_t)map->tile_count + 1, 1);
    compose->needed = calloc((size_t)map->tile_count + 1, 1);
    compose->around = calloc((size_t)map->tile_count + 1, 1);
    compose->survey = calloc((size_t)SURVEY_SIDE * SURVEY_SIDE * 3, sizeof *compose->survey);
    if (!compose->level || !compose->object || !compose->density || !compose->here || !compose->calm ||
        !compose->needed || !compose->around || !compose->survey)
        goto fail;
    if (!measure_densities(compose)) goto fail;
    lay_out_levels(compose);
    *out_compose = compose;
    return LW_OK;
fail:
    lw_compose_destroy(compose);
    return lw_status_fail(err, LW_NO_MEMORY, "no memory for the view");
}

void lw_compose_destroy(struct lw_compose *compose) {
    if (compose == NULL) return;
    free(compose->needed);
    free(compose->calm);
    free(compose->here);
    if (compose->density != NULL)
        for (uint32_t m = 0; m < compose->scene->mesh_count; m++) free(compose->density[m]);
    free(compose->density);
    free(compose->around);
    free(compose->survey);
    free(compose->object);
    free(compose->level);
    free(compose);
}

static bool is_light(struct lw_vec3 c) { return lw_vec3_is_finite(c) && c.x >= 0 && c.y >= 0 && c.z >= 0; }

/* The average of what has arrived of the objects' coarsest levels; before anything has, light that shows a surface
 * as its albedo. */
static struct lw_vec3 average_irradiance(const struct lw_compose *compose) {
    double sum[3] = {0}, count = 0;
    for (uint32_t o = 0; o < compose->map->object_count; o++) {
        const struct object *object = &compose->object[o];
        if (object->level_count == 0) continue;
        const struct level *coarsest = &object->level[object->level_count - 1];
        if (coarsest->rgb == NULL || !compose->here[coarsest->first_tile]) continue;
        for (size_t i = 0; i < (size_t)coarsest->width * coarsest->height; i++) {
            struct lw_vec3 e =
                lw_vec3(coarsest->rgb[3 * i], coarsest->rgb[3 * i + 1], coarsest->rgb[3 * i + 2]);
            if (!is_light(e)) continue;
            sum[0] += (double)e.x, sum[1] += (double)e.y, sum[2] += (double)e.z;
            count += 1;
        }
    }
    if (count > 0 && sum[0] + sum[1] + sum[2] > 0)
        return lw_vec3((float)(sum[0] / count), (float)(sum[1] / count), (float)(sum[2] / count));
    return lw_vec3(LW_PI, LW_PI, LW_PI);
}

static void begin(struct lw_compose *compose, const struct lw_compose_source *source,
                  const struct lw_pose *pose) {
    const struct lw_atlas_map *map = compose->map;
    for (uint32_t t = 0; t < map->tile_count; t++) {
        struct lw_client_tile tile = source->tile(source->context, (lw_tile_id){t});
        compose->here[t] = tile.version != 0;
        compose->calm[t] = compose->unfiltered || tile.error <= MIDDLE_ERROR ? 0
                           : tile.error > COARSE_ERROR                       ? 2
                                                                             : 1;
    }
    struct level *level = compose->level;
    for (uint32_t o = 0; o < map->object_count; o++) {
        for (uint32_t k = 0; k < compose->object[o].level_count; k++, level++) {
            struct lw_client_level there = source->level(source->context, o, k);
            level->rgb = there.width == level->width && there.height == level->height ? there.rgb : NULL;
        }
    }
    memset(compose->needed, 0, map->tile_count);
    compose->pose = pose;
    compose->sky = source->sky;
    compose->stand_in = average_irradiance(compose);
}

/* The texels that a bilinear lookup reads, and how it weighs them. */
struct footprint {
    uint32_t x0, y0, x1, y1;
    float fx, fy;
};

static void split(float texel, uint32_t size, uint32_t *out_0, uint32_t *out_1, float *out_fraction) {
    float at = fminf(fmaxf(texel - 0.5f, 0.0f), (float)(size - 1));
    uint32_t low = (uint32_t)at;
    *out_0 = low;
    *out_1 = low + 1 < size ? low + 1 : low;
    *out_fraction = at - (float)low;
}

static struct footprint footprint_at(const struct level *level, unsigned k, struct lw_vec2 uv) {
    struct footprint f;
    float scale = 1.0f / (float)(1u << k);
    split(uv.x * scale, level->width, &f.x0, &f.x1, &f.fx);
    split(uv.y * scale, level->height, &f.y0, &f.y1, &f.fy);
    return f;
}

/* The tiles under a footprint, each corner's; the same id more than once in most cases. */
static void footprint_tiles(const struct level *level, const struct footprint *f, uint32_t out[4]) {
    uint32_t left = f->x0 / LW_TILE_SIDE, right = f->x1 / LW_TILE_SIDE;
    uint32_t upper = level->first_tile + f->y0 / LW_TILE_SIDE * level->tiles_x;
    uint32_t lower = level->first_tile + f->y1 / LW_TILE_SIDE * level->tiles_x;
    out[0] = upper + left, out[1] = upper + right, out[2] = lower + left, out[3] = lower + right;
}

static struct lw_vec3 texel(const struct level *level, uint32_t x, uint32_t y) {
    const float *rgb = level->rgb + 3 * ((size_t)y * level->width + x);
    return lw_vec3(rgb[0], rgb[1], rgb[2]);
}

static struct lw_vec3 mix(struct lw_vec3 a, struct lw_vec3 b, float t) {
    return lw_vec3_mad(a, lw_vec3_sub(b, a), t);
}

/* Reads one level; false if a tile of the footprint is not there, or holds what is no light. */
static bool read_level(const struct lw_compose *compose, const struct level *level, unsigned k,
                       struct lw_vec2 uv, struct lw_vec3 *out) {
    if (level->rgb == NULL) return false;
    struct footprint f = footprint_at(level, k, uv);
    uint32_t tile[4];
    footprint_tiles(level, &f, tile);
    for (int i = 0; i < 4; i++)
        if (!compose->here[tile[i]]) return false;
    struct lw_vec3 upper = mix(texel(level, f.x0, f.y0), texel(level, f.x1, f.y0), f.fx);
    struct lw_vec3 lower = mix(texel(level, f.x0, f.y1), texel(level, f.x1, f.y1), f.fx);
    struct lw_vec3 e = mix(upper, lower, f.fy);
    if (!is_light(e)) return false;
    *out = e;
    return true;
}

static void mark_needed(struct lw_compose *compose, const uint32_t tile[4]) {
    for (int i = 0; i < 4; i++)
        /* all threads write the same value: the result does not depend on their order */
        if (!__atomic_load_n(&compose->needed[tile[i]], __ATOMIC_RELAXED))
            __atomic_store_n(&compose->needed[tile[i]], 1, __ATOMIC_RELAXED);
}

static struct lw_vec3 irradiance(struct lw_compose *compose, uint32_t o, struct lw_vec2 uv,
                                 float footprint_texels) {
    const struct object *object = &compose->object[o];
    if (object->level_count == 0) return compose->stand_in;
    unsigned coarsest = object->level_count - 1;
    unsigned finest = footprint_texels >= 2.0f ? (unsigned)ilogbf(fminf(footprint_texels, 1e6f)) : 0;
    if (finest > LW_COMPOSE_LEVEL_MAX) finest = LW_COMPOSE_LEVEL_MAX;
    if (finest > coarsest) finest = coarsest;
    struct footprint f = footprint_at(&object->level[finest], finest, uv);
    uint32_t tile[4];
    footprint_tiles(&object->level[finest], &f, tile);
    mark_needed(compose, tile);

    /* Fresh light is noise, but a texel of level 2 is the mean of 4 x 4: until the error has fallen, less is more. */
    if (footprint_texels > 0 && compose->calm[tile[0]] > finest)
        finest = compose->calm[tile[0]] < coarsest ? compose->calm[tile[0]] : coarsest;

    struct lw_vec3 e;
    for (unsigned k = finest; k <= coarsest; k++)
        if (read_level(compose, &object->level[k], k, uv, &e)) return e;
    for (unsigned k = finest; k-- > 0;)
        if (read_level(compose, &object->level[k], k, uv, &e)) return e;
    return compose->stand_in;
}

/* How many texels of level 0 a pixel spans where its ray meets a surface: the side of a square of the same area. */
static float footprint_texels(const struct lw_compose *compose, uint32_t o, uint32_t triangle,
                              struct lw_vec3 normal_os, struct lw_vec3 dir, float pixel_m) {
    const struct lw_affine *to_world = &compose->pose->object_to_world[o];
    const float *density = compose->density[compose->scene->object[o].mesh];
    if (density == NULL) return 0;
    struct lw_vec3 normal = lw_affine_cofactor_normal(to_world, normal_os);
    float cosine = fabsf(lw_vec3_dot(lw_vec3_normalize(normal), dir)) / lw_vec3_length(dir);
    /* m per unit of object space along this surface: a scale need not be the same along all axes */
    float metres_per_unit = sqrtf(lw_vec3_length(normal));
    float texels_per_m = density[triangle] / fmaxf(metres_per_unit, 1e-20f);
    return pixel_m * texels_per_m / sqrtf(fmaxf(cosine, COSINE_MIN));
}

/* Sixteen pixels on their way through the layers in front of them. */
struct packet {
    struct lw_ray16 rays;
    struct lw_vec3 radiance[LW_TRACE_WIDTH];
    float transmittance[LW_TRACE_WIDTH];
    float pixel_size; /* at depth 1 */
};

/* Takes in one hit; true if the ray goes on behind it. */
static bool shade(struct lw_compose *compose, struct packet *p, const struct lw_hit16 *hits, unsigned i,
                  bool last) {
    struct lw_vec3 *radiance = &p->radiance[i];
    if (hits->object[i] == LW_TRACE_MISS) {
        struct lw_vec3 direction = lw_vec3(p->rays.dir_x[i], p->rays.dir_y[i], p->rays.dir_z[i]);
        struct lw_vec3 outside =
            lw_vec3_add(compose->sky, lw_environment_radiance(&compose->scene->environment, direction));
        *radiance = lw_vec3_mad(*radiance, outside, p->transmittance[i]);
        return false;
    }
    uint32_t o = hits->object[i], triangle = hits->triangle[i];
    const struct lw_mesh *mesh = &compose->scene->mesh[compose->scene->object[o].mesh];
    struct lw_surface surface;
    lw_scene_surface(compose->scene, mesh, triangle, hits->u[i], hits->v[i], &surface);
    float alpha = 1.0f;
    if (surface.material->alpha_mode == LW_ALPHA_BLEND && !last) alpha = surface.alpha;
    if (alpha > 0) {
        struct lw_vec2 uv = surface.lightmap_uv;
        if (hits->back[i]) uv.y += (float)mesh->back_offset;
        struct lw_vec3 dir = lw_vec3(p->rays.dir_x[i], p->rays.dir_y[i], p->rays.dir_z[i]);
        float texels =
            footprint_texels(compose, o, triangle, surface.geometric_normal, dir, hits->t[i] * p->pixel_size);
        struct lw_vec3 reflected =
            lw_vec3_scale(lw_vec3_mul(surface.albedo, irradiance(compose, o, uv, texels)), 1.0f / LW_PI);
        struct lw_vec3 leaving = lw_vec3_add(reflected, surface.emission);
        *radiance = lw_vec3_mad(*radiance, leaving, p->transmittance[i] * alpha);
        p->transmittance[i] *= 1.0f - alpha;
    }
    if (!(p->transmittance[i] > TRANSMITTANCE_MIN)) return false;
    /* Past the hit by more than its rounding, whatever packet it is traced in. */
    p->rays.t_near[i] = hits->t[i] * (1.0f + 4e-6f) + 1e-7f;
    return true;
}

static uint16_t aim(struct packet *p, const struct lw_compose_view *view, const struct lw_camera_plane *plane,
                    uint32_t x, uint32_t y) {
    uint16_t active = 0;
    p->pixel_size = plane->pixel;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        uint32_t px = x + i % BLOCK, py = y + i / BLOCK;
        if (px < view->width && py < view->height) active |= (uint16_t)(1u << i);
        struct lw_vec3 dir =
            lw_camera_direction(plane, (float)px + 0.5f + view->offset_x, (float)py + 0.5f + view->offset_y);
        lw_trace_set_ray(&p->rays, i, view->camera.position, dir, INFINITY);
        p->radiance[i] = lw_vec3(0, 0, 0);
        p->transmittance[i] = 1;
    }
    return active;
}

static void render_block(struct lw_compose *compose, const struct lw_compose_view *view,
                         const struct lw_camera_plane *plane, uint32_t x, uint32_t y, float *out_rgb) {
    struct packet p;
    uint16_t active = aim(&p, view, plane, x, y), going = active;
    for (unsigned layer = 0; going && layer < LW_COMPOSE_LAYERS_MAX; layer++) {
        struct lw_hit16 hits;
        uint16_t go_on = 0;
        lw_trace_closest16(compose->trace, LW_TRACE_VIEW | LW_TRACE_COHERENT, going, &p.rays, &hits);
        for (unsigned i = 0; i < LW_TRACE_WIDTH; i++)
            if ((going >> i & 1u) && shade(compose, &p, &hits, i, layer + 1 == LW_COMPOSE_LAYERS_MAX))
                go_on |= (uint16_t)(1u << i);
        going = go_on;
    }
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        if (!(active >> i & 1u)) continue;
        float *pixel = out_rgb + 3 * ((size_t)(y + i / BLOCK) * view->width + x + i % BLOCK);
        pixel[0] = p.radiance[i].x, pixel[1] = p.radiance[i].y, pixel[2] = p.radiance[i].z;
    }
}

static void render(struct lw_compose *compose, const struct lw_compose_view *view,
                   const struct lw_camera_plane *plane, float *out_rgb) {
    uint32_t columns = (view->width + SCREEN_TILE - 1) / SCREEN_TILE;
    uint32_t rows = (view->height + SCREEN_TILE - 1) / SCREEN_TILE;
#pragma omp parallel for schedule(dynamic) num_threads(compose->threads)
    for (uint32_t t = 0; t < columns * rows; t++) {
        uint32_t left = t % columns * SCREEN_TILE, top = t / columns * SCREEN_TILE;
        for (uint32_t y = top; y < top + SCREEN_TILE && y < view->height; y += BLOCK)
            for (uint32_t x = left; x < left + SCREEN_TILE && x < view->width; x += BLOCK)
                render_block(compose, view, plane, x, y, out_rgb);
    }
}

void lw_compose_render(struct lw_compose *compose, const struct lw_compose_source *source,
                       const struct lw_pose *pose, const struct lw_compose_view *view, float *out_rgb,
                       struct lw_compose_report *out_report) {
    begin(compose, source, pose);
    const struct lw_camera_plane plane = lw_camera_plane(&view->camera, view->width, view->height);
    render(compose, view, &plane, out_rgb);
    lw_compose_check(compose, source, out_report);
}

static void swap_needed(struct lw_compose *compose) {
    uint8_t *needed = compose->needed;
    compose->needed = compose->around;
    compose->around = needed;
}

/* A small picture of a wide view, whose pixels are taken to be as small as the view's own: they need the same levels. */
void lw_compose_survey(struct lw_compose *compose, const struct lw_compose_source *source,
                       const struct lw_pose *pose, const struct lw_compose_view *view) {
    struct lw_compose_view wide = *view;
    const float longest = (float)(view->width > view->height ? view->width : view->height),
                scale = fminf(1, (float)SURVEY_SIDE / longest);
    wide.width = (uint32_t)fmaxf(1, (float)view->width * scale);
    wide.height = (uint32_t)fmaxf(1, (float)view->height * scale);
    wide.camera.fov_y = 2 * atanf(SURVEY_MARGIN * tanf(0.5f * view->camera.fov_y));
    struct lw_camera_plane plane = lw_camera_plane(&wide.camera, wide.width, wide.height);
    plane.pixel = lw_camera_plane(&view->camera, view->width, view->height).pixel;
    swap_needed(compose);
    begin(compose, source, pose);
    render(compose, &wide, &plane, compose->survey);
    swap_needed(compose);
}

void lw_compose_check(const struct lw_compose *compose, const struct lw_compose_source *source,
                      struct lw_compose_report *out_report) {
    struct lw_compose_report report = {0};
    for (uint32_t t = 0; t < compose->map->tile_count; t++) {
        if (!compose->needed[t]) continue;
        struct lw_client_tile tile = source->tile(source->context, (lw_tile_id){t});
        report.tiles_needed++;
        if (tile.version == 0) {
            report.tiles_missing++;
            continue;
        }
        report.tiles_unfinished += tile.bounces < source->bounces;
        report.tiles_noisy += !(tile.error <= source->target_error);
        report.max_error = fmaxf(report.max_error, tile.error);
    }
    report.complete = report.tiles_missing == 0 && report.tiles_unfinished == 0;
    report.converged = report.complete && report.tiles_noisy == 0;
    *out_report = report;
}

const uint8_t *lw_compose_needed(const struct lw_compose *compose) { return compose->needed; }

const uint8_t *lw_compose_around(const struct lw_compose *compose) { return compose->around; }
