#include "client/view/compose/compose.h"

#include "client/view/compose/compose_render.h"
#include "common/base/colour.h"
#include "common/lightmap/lightmap.h"

#include <omp.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#define SURVEY_MARGIN 1.4f /* a survey's picture is wider and higher than the view by this factor */
#define SURVEY_SIDE   128u /* pixels of its longer side */

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
                                      .target_error = stats.target_error,
                                      .noise_shown = stats.noise_shown};
}

_Static_assert(LW_LIGHTMAP_LEVEL_MAX == LW_ATLAS_READ_MAX, "charts are apart on all levels that views read");

static bool find_coarsest(struct lw_compose *compose) {
    bool found = true;
#pragma omp parallel for schedule(dynamic) num_threads(compose->threads) reduction(&& : found)
    for (uint32_t m = 0; m < compose->scene->mesh_count; m++) {
        const struct lw_mesh *mesh = &compose->scene->mesh[m];
        if (mesh->lightmap_uv == NULL || mesh->triangle_count == 0) continue;
        compose->coarsest[m] = malloc(mesh->triangle_count);
        found = found && compose->coarsest[m] && lw_lightmap_coarsest(mesh, compose->coarsest[m]) == LW_OK;
    }
    return found;
}

static void lay_out_levels(struct lw_compose *compose) {
    const struct lw_atlas_map *map = compose->map;
    struct lw_compose_level *level = compose->level;
    for (uint32_t o = 0; o < map->object_count; o++) {
        const struct lw_atlas *atlas = map->atlas[o];
        const int finer = (int)atlas->finer_count, count = (int)atlas->level_count;
        compose->object[o] = (struct lw_compose_object){level + finer, count, finer, false};
        for (int k = -finer; k < count; k++) {
            const struct lw_atlas_level *at = lw_atlas_level(atlas, lw_compose_level_number(k));
            *level++ = (struct lw_compose_level){
                .width = at->width,
                .height = at->height,
                .tiles_x = at->tiles_x,
                .first_tile = k < 0 ? 0 : lw_atlas_map_first(map, o, lw_compose_level_number(k))};
        }
    }
}

static bool init_direct(struct lw_compose *compose, const struct lw_compose_desc *desc) {
    compose->worker = aligned_alloc(64, (size_t)compose->threads * sizeof *compose->worker);
    if (!compose->worker) return false;
    memset(compose->worker, 0, (size_t)compose->threads * sizeof *compose->worker);
    for (int i = 0; i < compose->threads; i++)
        if (lw_direct_tile_create(&compose->worker[i].tile) != LW_OK) return false;
    compose->drawn_material = desc->drawn->material;
    return lw_direct_pixels_create(&(struct lw_direct_pixels_desc){.scene = desc->scene,
                                                                   .trace = desc->trace,
                                                                   .drawn = desc->drawn,
                                                                   .threads = compose->threads},
                                   desc->pose, &compose->direct, NULL) == LW_OK;
}

enum lw_status lw_compose_create(const struct lw_compose_desc *desc, struct lw_compose **out_compose,
                                 struct lw_error *err) {
    const struct lw_atlas_map *map = desc->map;
    size_t level_count = 0;
    for (uint32_t o = 0; o < map->object_count; o++)
        level_count += map->atlas[o]->level_count + map->atlas[o]->finer_count;

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
    compose->coarsest = calloc((size_t)desc->scene->mesh_count + 1, sizeof *compose->coarsest);
    compose->here = calloc((size_t)map->tile_count + 1, 1);
    compose->fine = calloc(lw_atlas_map_room(map) + 1ul, sizeof *compose->fine);
    compose->fine_direction = calloc(lw_atlas_map_room(map) + 1ul, sizeof *compose->fine_direction);
    compose->noise_level = calloc((size_t)map->tile_count + 1, 1);
    compose->needed = calloc((size_t)map->tile_count + 1, 1);
    compose->around = calloc((size_t)map->tile_count + 1, 1);
    compose->shown = calloc((size_t)map->tile_count + 1, sizeof *compose->shown);
    compose->place = calloc((size_t)desc->scene->object_count + 1, sizeof *compose->place);
    compose->survey = calloc((size_t)SURVEY_SIDE * SURVEY_SIDE * 3, sizeof *compose->survey);
    if (!compose->level || !compose->object || !compose->coarsest || !compose->here || !compose->fine ||
        !compose->fine_direction || !compose->noise_level || !compose->needed || !compose->around ||
        !compose->shown || !compose->survey || !compose->place)
        goto fail;
    if (!find_coarsest(compose)) goto fail;
    if (lw_client_lights_any(desc->drawn) && !init_direct(compose, desc)) goto fail;
    lay_out_levels(compose);
    *out_compose = compose;
    return LW_OK;
fail:
    lw_compose_destroy(compose);
    return lw_status_fail(err, LW_NO_MEMORY, "no memory for the view");
}

void lw_compose_destroy(struct lw_compose *compose) {
    if (compose == NULL) return;
    lw_direct_pixels_destroy(compose->direct);
    for (int i = 0; compose->worker != NULL && i < compose->threads; i++)
        lw_direct_tile_destroy(compose->worker[i].tile);
    lw_ambient_finish(&compose->ambient);
    free(compose->worker);
    free(compose->place);
    free(compose->shown);
    free(compose->needed);
    free(compose->noise_level);
    free(compose->fine);
    free(compose->fine_direction);
    free(compose->here);
    for (uint32_t m = 0; compose->coarsest != NULL && m < compose->scene->mesh_count; m++)
        free(compose->coarsest[m]);
    free(compose->coarsest);
    free(compose->around);
    free(compose->survey);
    free(compose->object);
    free(compose->level);
    free(compose);
}

/* The average over the objects' coarsest levels that have arrived; before the first, light that shows a
 * surface as its albedo. */
static struct lw_vec3 average_irradiance(const struct lw_compose *compose, bool *out_known) {
    double sum[3] = {0}, count = 0;
    for (uint32_t o = 0; o < compose->map->object_count; o++) {
        const struct lw_compose_object *object = &compose->object[o];
        if (object->level_count == 0) continue;
        const struct lw_compose_level *coarsest = &object->level[object->level_count - 1];
        if (coarsest->rgb == NULL || !compose->here[coarsest->first_tile]) continue;
        for (size_t i = 0; i < (size_t)coarsest->width * coarsest->height; i++) {
            struct lw_vec3 e =
                lw_vec3(coarsest->rgb[3 * i], coarsest->rgb[3 * i + 1], coarsest->rgb[3 * i + 2]);
            if (!lw_compose_is_light(e)) continue;
            sum[0] += (double)e.x, sum[1] += (double)e.y, sum[2] += (double)e.z;
            count += 1;
        }
    }
    *out_known = count > 0 && sum[0] + sum[1] + sum[2] > 0;
    if (*out_known) return lw_vec3((float)(sum[0] / count), (float)(sum[1] / count), (float)(sum[2] / count));
    return lw_vec3(LW_PI, LW_PI, LW_PI);
}

/* Whether any material has a finish, or all surfaces are shown as if they had one. */
static bool find_finishes(const struct lw_compose *compose) {
    if (lw_show_is_of_finish(compose->show)) return true;
    for (uint32_t m = 0; m < compose->scene->material_count; m++)
        if (lw_compose_is_finished(&compose->scene->material[m])) return true;
    return false;
}

static void place_objects(struct lw_compose *compose) {
    for (uint32_t o = 0; o < compose->scene->object_count; o++)
        compose->place[o] = lw_place_of(&compose->pose->object_to_world[o]);
}

static void begin(struct lw_compose *compose, const struct lw_compose_source *source,
                  const struct lw_pose *pose) {
    const struct lw_atlas_map *map = compose->map;
    for (uint32_t o = 0; o < map->object_count; o++) compose->object[o].has_fine = false;
    for (uint32_t t = 0; t < map->tile_count; t++) {
        struct lw_client_tile tile = source->tile(source->context, (lw_tile_id){t});
        compose->here[t] = tile.version != 0;
        compose->noise_level[t] =
            compose->unfiltered ? 0 : (uint8_t)lw_atlas_noise_level_min(tile.error, source->noise_shown);
        if (t < map->plain_count) continue;
        compose->fine[t - map->plain_count] = tile.rgb;
        compose->fine_direction[t - map->plain_count] = tile.direction;
        if (compose->here[t]) compose->object[map->place[t].object].has_fine = true;
    }
    struct lw_compose_level *level = compose->level;
    compose->has_directions = false;
    for (uint32_t o = 0; o < map->object_count; o++) {
        level += compose->object[o].finer_count;
        for (uint32_t k = 0; (int)k < compose->object[o].level_count; k++, level++) {
            struct lw_client_level there = source->level(source->context, o, k);
            const bool fits = there.width == level->width && there.height == level->height;
            level->rgb = fits ? there.rgb : NULL;
            level->direction = fits ? there.direction : NULL;
            compose->has_directions |= level->direction != NULL;
        }
    }
    memset(compose->needed, 0, map->tile_count);
    compose->pose = pose;
    compose->sky = source->sky;
    bool known;
    compose->stand_in = average_irradiance(compose, &known);
    compose->mean = known ? lw_colour_luminance(compose->stand_in) : 0;
    compose->finishes = find_finishes(compose);
    if (!compose->finishes) return;
    place_objects(compose);
    /* without memory for it, surfaces mirror E alone and not the environment */
    if (lw_ambient_take(&compose->ambient, &compose->scene->environment) != LW_OK) return;
}

static void begin_direct(struct lw_compose *compose, uint32_t sample) {
    if (!compose->finishes) place_objects(compose);
    for (int i = 0; i < compose->threads; i++) compose->worker[i].tile->rays = 0;
    lw_direct_pixels_begin(compose->direct, compose->pose, compose->mean, sample);
}

/* Shadow rays of the last picture. */
static uint64_t count_shadow_rays(const struct lw_compose *compose) {
    uint64_t rays = 0;
    for (int i = 0; i < compose->threads; i++) rays += compose->worker[i].tile->rays;
    return rays;
}

static bool mirrors(const struct lw_compose *compose, const struct lw_compose_view *view) {
    return view->mirrors && compose->finishes && view->show == LW_SHOW_ALL;
}

void lw_compose_render(struct lw_compose *compose, const struct lw_compose_source *source,
                       const struct lw_pose *pose, const struct lw_compose_view *view, float *out_rgb,
                       struct lw_compose_report *out_report) {
    compose->show = view->show;
    compose->tile_colour = view->tile_colour;
    begin(compose, source, pose);
    compose->mirrors = mirrors(compose, view);
    compose->samples = view->samples;
    memset(compose->shown, 0, compose->map->tile_count * sizeof *compose->shown);
    compose->pixel_count = (uint64_t)view->width * view->height;
    if (compose->direct) begin_direct(compose, view->sample);
    const struct lw_camera_plane plane = lw_camera_plane(&view->camera, view->width, view->height);
    lw_compose_render_tiles(compose, view, &plane, compose->direct != NULL, out_rgb);
    lw_compose_check(compose, source, out_report);
    if (compose->direct) out_report->shadow_rays = count_shadow_rays(compose);
}

void lw_compose_render_more(struct lw_compose *compose, const struct lw_compose_view *view,
                            const uint32_t *pixel, size_t pixel_count, float *out_rgb) {
    const struct lw_camera_plane plane = lw_camera_plane(&view->camera, view->width, view->height);
    compose->samples = view->samples;
    if (compose->direct) begin_direct(compose, view->sample);
    lw_compose_render_list(compose, view, &plane, pixel, pixel_count, out_rgb);
}

static void swap_needed(struct lw_compose *compose) {
    uint8_t *needed = compose->needed;
    compose->needed = compose->around;
    compose->around = needed;
}

/* A small picture of a wide view, whose pixels are taken to be as small as the view's own: they need the same
 * levels. */
void lw_compose_survey(struct lw_compose *compose, const struct lw_compose_source *source,
                       const struct lw_pose *pose, const struct lw_compose_view *view) {
    struct lw_compose_view wide = *view;
    const float longest = (float)(view->width > view->height ? view->width : view->height),
                scale = fminf(1, (float)SURVEY_SIDE / longest);
    wide.width = (uint32_t)fmaxf(1, (float)view->width * scale);
    wide.height = (uint32_t)fmaxf(1, (float)view->height * scale);
    wide.camera.fov_y = 2 * atanf(SURVEY_MARGIN * tanf(0.5f * view->camera.fov_y));
    wide.camera.height_m *= SURVEY_MARGIN;
    struct lw_camera_plane plane = lw_camera_plane(&wide.camera, wide.width, wide.height);
    plane.pixel = lw_camera_plane(&view->camera, view->width, view->height).pixel;
    swap_needed(compose);
    compose->show = LW_SHOW_ALL;
    compose->mirrors = mirrors(compose, view);
    compose->surveys = true;
    begin(compose, source, pose);
    lw_compose_render_tiles(compose, &wide, &plane, false, compose->survey);
    compose->surveys = false;
    swap_needed(compose);
}

void lw_compose_note(struct lw_compose *compose, const uint8_t *needed, const uint64_t *shown,
                     uint64_t pixel_count) {
    memcpy(compose->needed, needed, compose->map->tile_count * sizeof *needed);
    memcpy(compose->shown, shown, compose->map->tile_count * sizeof *shown);
    compose->pixel_count = pixel_count;
}

/* The visible part of a tile's error: the share that the server's filter leaves, in texels that are means
 * of finer ones where views read it coarser. */
static double shown_error(const struct lw_compose *compose, const struct lw_compose_source *source,
                          uint32_t t, float error) {
    const unsigned noise_level =
                       compose->unfiltered ? 0 : lw_atlas_noise_level_min(error, source->noise_shown),
                   finer = lw_atlas_finer(compose->map->place[t].level),
                   level = finer ? 0 : compose->map->place[t].level;
    const double shown =
        ldexp((double)(error * source->noise_shown), -(int)(noise_level > level ? noise_level : level));
    return shown < 1 ? shown : 1;
}

/* A tile of a finer level that is not there: views read level 0 in its place. Returns the error that is seen
 * of that. */
static double check_below(const struct lw_compose *compose, const struct lw_compose_source *source,
                          uint32_t t, struct lw_compose_report *report) {
    const lw_tile_id below = lw_atlas_map_below(compose->map, (lw_tile_id){t});
    const struct lw_client_tile tile = source->tile(source->context, below);
    report->tiles_missing += tile.version == 0;
    report->tiles_unfinished += tile.version && tile.bounces < source->bounces;
    report->tiles_noisy++;
    return tile.version ? shown_error(compose, source, below.v, tile.error) : 1;
}

void lw_compose_check(const struct lw_compose *compose, const struct lw_compose_source *source,
                      struct lw_compose_report *out_report) {
    struct lw_compose_report report = {0};
    double shown = 0;
    for (uint32_t t = 0; t < compose->map->tile_count; t++) {
        if (!compose->needed[t] || !lw_atlas_map_is_used(compose->map, (lw_tile_id){t})) continue;
        struct lw_client_tile tile = source->tile(source->context, (lw_tile_id){t});
        report.tiles_needed++;
        if (tile.version == 0 && lw_atlas_finer(compose->map->place[t].level)) {
            shown += (double)compose->shown[t] * check_below(compose, source, t, &report);
            continue;
        }
        const bool missing = tile.version == 0;
        shown += (double)compose->shown[t] * (missing ? 1 : shown_error(compose, source, t, tile.error));
        if (missing) {
            report.tiles_missing++;
            continue;
        }
        report.tiles_unfinished += tile.bounces < source->bounces;
        report.tiles_noisy += !(tile.error <= source->target_error);
        report.max_error = fmaxf(report.max_error, tile.error);
    }
    report.shown_error = (float)(shown / ((double)LW_COMPOSE_PIXEL_LIGHT *
                                          (double)(compose->pixel_count ? compose->pixel_count : 1)));
    report.complete = report.tiles_missing == 0 && report.tiles_unfinished == 0;
    report.converged = report.complete && report.tiles_noisy == 0;
    report.good = report.converged || (report.complete && report.shown_error <= LW_COMPOSE_GOOD_ERROR);
    *out_report = report;
}

const uint8_t *lw_compose_needed(const struct lw_compose *compose) { return compose->needed; }

const uint8_t *lw_compose_around(const struct lw_compose *compose) { return compose->around; }
