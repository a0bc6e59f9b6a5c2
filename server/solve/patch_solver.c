#include "server/solve/patch_solver.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "common/light/client_lights.h"
#include "server/solve/adapt/estimates.h"
#include "server/solve/transport/direct_light.h"

#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

/* For struct lw_lights_part: no material's value. */
#define NO_MATERIAL 2u

static bool parts_drawn(const struct lw_patch_solver *s) {
    return lw_client_lights_any(s->desc.client_lights);
}

bool lw_patch_solver_cancelled(const struct lw_patch_solver *s) { return s->desc.cancel && *s->desc.cancel; }

void lw_patch_solver_add(const struct lw_patch_solver *s, float *const dst[3], float *const src[3]) {
#pragma omp parallel for schedule(static) num_threads(s->threads)
    for (uint32_t i = 0; i < s->tiles.texel_count; i++)
        for (int c = 0; c < 3; c++) dst[c][i] += src[c][i];
}

void lw_patch_solver_reflect(struct lw_patch_solver *s, float *const e[3], float *out_radiance) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        const struct lw_solve_tile *tile = &s->tiles.tile[i];
        for (uint32_t k = 0; k < tile->width * tile->height; k++) {
            const struct lw_vec3 albedo = lw_packed_albedo_unpack(tile->mesh->albedo[tile->local + k]);
            for (int c = 0; c < 3; c++)
                out_radiance[3 * (size_t)(tile->first + k) + (size_t)c] =
                    s->tiles.covered[tile->first + k] ? (&albedo.x)[c] * e[c][tile->first + k] / LW_PI : 0;
        }
    }
}

/* ---- a frame ---- */

static struct lw_transport transport_of(struct lw_patch_solver *s, struct lw_tiles *tiles) {
    return (struct lw_transport){.scene = s->desc.scene,
                                 .pose = &s->pose,
                                 .trace = s->geometry.trace,
                                 .lights = &s->lights,
                                 .drawn = parts_drawn(s) ? &s->drawn : NULL,
                                 .texels = &s->geometry.texels,
                                 .tiles = tiles,
                                 .direct_samples = 1,
                                 .indirect_samples = 1,
                                 .seed = s->desc.seed,
                                 .tracing_range_m = INFINITY,
                                 .target_error = s->desc.target_error};
}

static void forget(struct lw_patch_solver *s) {
    const size_t bytes = s->tiles.texel_count * sizeof(float);
    float *const planes[] = {s->tiles.mean, s->tiles.spread, s->tiles.split_mean, s->tiles.split_spread};
    s->frames = 0;
    for (int k = 0; k < 4; k++)
        if (planes[k]) memset(planes[k], 0, bytes);
    for (int c = 0; c < 3; c++) {
        memset(s->tiles.direct[c], 0, bytes);
        memset(s->tiles.indirect[c], 0, bytes);
        if (s->tiles.drawn[c]) memset(s->tiles.drawn[c], 0, bytes);
    }
    lw_seams_welds_forget(&s->shown.welds);
    for (uint32_t b = 0; b < s->tiles.block_count; b++) {
        struct lw_solve_block *block = &s->tiles.block[b];
        block->sample_count = 0;
        block->direct = block->indirect = (struct lw_history){0};
        block->error = 1;
        block->state = block->covered_count ? LW_BLOCK_SAMPLED : LW_BLOCK_CONVERGED;
    }
}

/* Another pose begins another solution: nothing of the light before it is kept. */
static enum lw_status take_pose(struct lw_patch_solver *s, const struct lw_pose *pose, uint64_t frame,
                                bool *out_moved, struct lw_error *err) {
    const unsigned moved = lw_pose_difference(pose, &s->pose, s->desc.scene);
    *out_moved = moved != 0;
    enum lw_status status = lw_geometry_rest(&s->geometry, frame, err);
    if (status != LW_OK) return status;
    if (!moved && s->placed && s->texel_changes == s->geometry.changes) return LW_OK;
    if (s->placed && s->method->leave) s->method->leave(s, pose);
    lw_pose_copy(&s->pose, pose, s->desc.scene);
    if ((status = lw_geometry_set_pose(&s->geometry, &s->pose, false, frame, err)) != LW_OK) return status;
    if (s->texel_changes != s->geometry.changes) lw_tiles_recount(&s->tiles, s->threads);
    s->texel_changes = s->geometry.changes;
    struct lw_lights *const lights[] = {&s->emitters, &s->lights, &s->drawn};
    for (int i = 0; i < 3; i++) {
        if (i == 2 && !parts_drawn(s)) continue;
        if (moved & (LW_POSE_MATERIALS | LW_POSE_SKY) &&
            (status = lw_lights_set_materials(lights[i], &s->pose)) != LW_OK)
            return lw_status_fail(err, status, "taking over what has changed");
        lw_lights_set_pose(lights[i], &s->pose);
    }
    lw_tiles_set_pose(&s->tiles, &s->cells, &s->pose);
    status = lw_patches_set_pose(&s->patches, &s->pose, &s->emitters, s->threads);
    if (status != LW_OK) return lw_status_fail(err, status, "patches of %u texels", s->geometry.texels.count);
    if (s->placed) forget(s);
    s->placed = true;
    return LW_OK;
}

/* Direct light of lamps and sky: the mean of the frame's samples, by itself. */
static uint64_t light_directly(struct lw_patch_solver *s) {
    struct lw_tiles own = s->tiles; /* with sums of the frame's */
    uint64_t rays = 0;
    for (int c = 0; c < 3; c++) { /* to 0: a mean that begins elsewhere ends elsewhere, by rounding */
        own.direct[c] = memset(s->frame_direct[c], 0, s->tiles.texel_count * sizeof(float));
        if (parts_drawn(s)) own.drawn[c] = memset(s->frame_drawn[c], 0, s->tiles.texel_count * sizeof(float));
    }
    const struct lw_transport t = transport_of(s, &own);
    for (uint32_t k = 0; k < s->method->direct_samples; k++) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : rays)
        for (uint32_t i = 0; i < own.count; i++) {
            struct lw_solve_tile *tile = &own.tile[i];
            struct lw_ray_count count = {0};
            if (tile->hidden || lw_patch_solver_cancelled(s)) continue;
            LW_TILES_EACH_BLOCK (tile, block) {
                block->due = true;
                block->direct.weight = 1.0f / (float)(k + 1);
                block->sample_count = s->frames * s->method->direct_samples + k;
            }
            lw_direct_light_solve(&t, tile, &count);
            rays += count.shadow;
        }
    }
    return rays;
}

/* The frame's estimates enter the means. */
static void blend(struct lw_patch_solver *s) {
    struct lw_tiles *tiles = &s->tiles;
    const float weight = 1.0f / (float)(s->frames + 1);
    const struct lw_transport t = transport_of(s, tiles);
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads)
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        if (tile->hidden) continue;
        for (uint32_t texel = tile->first; texel < tile->first + tile->width * tile->height; texel++) {
            if (!tiles->covered[texel]) continue;
            const struct lw_vec3 direct = lw_texels_vector(s->frame_direct, texel),
                                 bounces = lw_texels_vector(s->frame_bounces, texel);
            lw_tiles_keep_estimate(tiles, LW_TILES_ESTIMATE_DIRECT, texel, direct);
            lw_tiles_keep_estimate(tiles, LW_TILES_ESTIMATE_BOUNCES + LW_CHANGE_FIRST, texel, bounces);
            lw_tiles_blend(tiles->direct, texel, direct, weight);
            lw_tiles_blend(tiles->indirect, texel, bounces, weight);
            if (!parts_drawn(s)) continue;
            const struct lw_vec3 drawn = lw_texels_vector(s->frame_drawn, texel);
            lw_tiles_keep_drawn_estimate(tiles, texel, drawn);
            lw_tiles_blend(tiles->drawn, texel, drawn, weight);
        }
        LW_TILES_EACH_BLOCK (tile, block) {
            block->sample_count = s->frames;
            lw_history_take(&block->direct, INFINITY);
            lw_history_take(&block->indirect, INFINITY);
        }
        lw_estimates_finish_tile(&t, tile);
        LW_INVARIANT(tile->block->sample_count == s->frames + (tile->block->covered_count > 0));
    }
}

static bool has_converged(const struct lw_patch_solver *s, const struct lw_solve_block *block) {
    return !block->covered_count ||
           (block->sample_count >= s->method->frames_min && block->error <= s->desc.target_error) ||
           (s->desc.frames_max && block->sample_count >= s->desc.frames_max);
}

static void update_convergence(struct lw_patch_solver *s) {
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        LW_TILES_EACH_BLOCK (tile, block)
            block->state = tile->hidden || has_converged(s, block) ? LW_BLOCK_CONVERGED : LW_BLOCK_SAMPLED;
        lw_tiles_sum_up(tile);
    }
}

/* All tiles go on until the last has converged: each lights all others. */
static bool is_done(const struct lw_patch_solver *s) {
    for (uint32_t i = 0; i < s->tiles.count; i++)
        if (s->tiles.tile[i].light.state != LW_BLOCK_CONVERGED) return false;
    return true;
}

static void mark_shown(struct lw_patch_solver *s, uint64_t number) {
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        if (tile->hidden || !tile->covered_count) continue;
        LW_TILES_EACH_BLOCK (tile, block) block->shown_frame = number;
        tile->light.solved_frame = number;
    }
}

static void solve_all(struct lw_patch_solver *s, struct lw_solver_stats *stats) {
    uint64_t t = lw_clock_ns();
    if (s->frames)
        lw_progress_init(&s->progress, s->method->name, s->method->steps(s));
    else
        lw_progress_init_waiting(&s->progress, "lighting the first frame", s->method->steps(s),
                                 s->desc.waiting, LW_WAITING_FIRST_LIGHT);
    stats->rays_shadow = light_directly(s);
    stats->direct_ns = lw_clock_ns() - t;
    t = lw_clock_ns();
    stats->rays_bounce = s->method->bounces(s);
    stats->scatter_ns = lw_clock_ns() - t;
}

static enum lw_status frame(struct lw_solver *solver, const struct lw_pose *pose, uint64_t number,
                            struct lw_solver_stats *out_stats, struct lw_error *err) {
    struct lw_patch_solver *s = (struct lw_patch_solver *)solver;
    struct lw_solver_stats stats = {.tiles = s->tiles.count};
    uint64_t t = lw_clock_ns();
    enum lw_status status = take_pose(s, pose, number, &stats.moved, err);
    if (status != LW_OK) return status;
    stats.pose_ns = lw_clock_ns() - t;
    LW_INVARIANT(s->texel_changes == s->geometry.changes && s->placed); /* the tiles know their texels */
    const bool solves = !is_done(s);
    if (solves) {
        if ((status = s->method->place(s, err)) != LW_OK) return status;
        solve_all(s, &stats);
        if (lw_patch_solver_cancelled(s)) {
            lw_progress_stop(&s->progress);
            return LW_CLOSED;
        }
        lw_progress_finish(&s->progress);
        if (s->method->keep) s->method->keep(s, stats.rays_bounce);
        blend(s);
        s->frames++;
        update_convergence(s);
        stats.texels_solved = s->patches.count;
        stats.tiles_solved = s->tiles.count;
    }
    if (solves || s->shown.all) {
        t = lw_clock_ns();
        mark_shown(s, number);
        s->shown.all = false;
        lw_shown_filter(&s->shown, number);
        if ((status = lw_shown_weld(&s->shown, number, err)) != LW_OK) return status;
        stats.weld_ns = lw_clock_ns() - t;
        stats.tiles_shown = s->tiles.count;
    }
    for (uint32_t i = 0; i < s->tiles.count; i++)
        stats.tiles_converged += s->tiles.tile[i].light.state == LW_BLOCK_CONVERGED;
    if (s->desc.frames_max && stats.tiles_converged < stats.tiles)
        stats.texels_left = (double)(s->desc.frames_max - s->frames) * s->patches.count;
    LW_INVARIANT(stats.tiles_converged <= stats.tiles && stats.texels_left >= 0);
    *out_stats = stats;
    return LW_OK;
}

/* ---- the rest of solver.h ---- */

static enum lw_status set_interest(struct lw_solver *solver, const uint8_t *interest, struct lw_error *err) {
    const struct lw_patch_solver *s = (const struct lw_patch_solver *)solver;
    return interest
               ? lw_status_fail(err, LW_USAGE, "the solver \"%s\" knows no interest: it lights all texels",
                                s->method->name)
               : LW_OK;
}

static void choose_channels(struct lw_solver *solver, uint32_t channels) {
    struct lw_patch_solver *s = (struct lw_patch_solver *)solver;
    lw_shown_choose(&s->shown, channels);
    s->shown.all &= s->frames > 0;
}

static enum lw_status filter(struct lw_solver *solver, struct lw_error *err) {
    struct lw_patch_solver *s = (struct lw_patch_solver *)solver;
    const uint64_t last = lw_tiles_last_solved(&s->tiles);
    mark_shown(s, last);
    s->shown.all = false;
    return lw_shown_filter_once(&s->shown, last, err);
}

static void read_tile(const struct lw_solver *solver, lw_tile_id id, struct lw_solver_tile *out_tile) {
    const struct lw_patch_solver *s = (const struct lw_patch_solver *)solver;
    lw_shown_read_tile(&s->shown, id, s->desc.bounces, out_tile);
}

#define PARTS_MAX (1 + LW_TILE_CHANNELS_MAX + LW_PATCH_SOLVER_PARTS_MAX)
static uint32_t list_parts(const struct lw_patch_solver *s, uint32_t *frames,
                           struct lw_checkpoint_part out_part[PARTS_MAX]) {
    uint32_t n = 0;
    out_part[n++] = (struct lw_checkpoint_part){frames, sizeof *frames};
    n += lw_seams_welds_list_parts(&s->shown.welds, out_part + n);
    if (s->method->list_parts) n += s->method->list_parts(s, out_part + n);
    return n;
}

static enum lw_status save(const struct lw_solver *solver, const char *path, const uint8_t key[16],
                           struct lw_error *err) {
    const struct lw_patch_solver *s = (const struct lw_patch_solver *)solver;
    struct lw_checkpoint_part part[PARTS_MAX];
    uint32_t frames = s->frames;
    const uint32_t parts = list_parts(s, &frames, part);
    return lw_checkpoint_save(path, key, &s->tiles, part, parts, err);
}

static enum lw_status load(struct lw_solver *solver, const char *path, const uint8_t key[16],
                           uint64_t *out_frames, struct lw_error *err) {
    struct lw_patch_solver *s = (struct lw_patch_solver *)solver;
    struct lw_checkpoint_part part[PARTS_MAX];
    uint32_t frames = 0;
    const uint32_t parts = list_parts(s, &frames, part);
    enum lw_status status = lw_checkpoint_load(path, key, &s->tiles, part, parts, err);
    if (status != LW_OK) return status;
    lw_seams_welds_resume(&s->shown.welds);
    s->frames = frames;
    update_convergence(s);
    *out_frames = frames;
    return LW_OK;
}

static size_t memory_bytes(const struct lw_solver *solver) {
    const struct lw_patch_solver *s = (const struct lw_patch_solver *)solver;
    return lw_tiles_memory_bytes(&s->tiles) + lw_shown_memory_bytes(&s->shown) +
           lw_patches_memory_bytes(&s->patches) + lw_geometry_memory_bytes(&s->geometry) +
           s->method->memory_bytes(s) +
           (size_t)s->tiles.texel_count * (parts_drawn(s) ? 12 : 9) * sizeof(float);
}

static void destroy(struct lw_solver *solver) {
    if (!solver) return;
    struct lw_patch_solver *s = (struct lw_patch_solver *)solver;
    s->method->finish(s);
    lw_geometry_forget_tiles(&s->geometry);
    lw_patches_finish(&s->patches);
    lw_lights_finish(&s->emitters);
    lw_lights_finish(&s->lights);
    lw_lights_finish(&s->drawn);
    lw_shown_finish(&s->shown);
    lw_tiles_finish(&s->tiles);
    lw_geometry_finish(&s->geometry);
    lw_pose_finish(&s->pose);
    for (int c = 0; c < 3; c++) {
        free(s->frame_direct[c]);
        free(s->frame_bounces[c]);
        free(s->frame_drawn[c]);
        free(s->arrived[c]);
    }
    free(s->no_light);
    free(s->no_material);
    free(s);
}

static const struct lw_solver_ops shared_ops = {.frame = frame,
                                                .set_interest = set_interest,
                                                .choose_channels = choose_channels,
                                                .filter = filter,
                                                .read_tile = read_tile,
                                                .save = save,
                                                .load = load,
                                                .memory_bytes = memory_bytes,
                                                .destroy = destroy};

/* Where surfaces shoot, the direct pass samples none of them. */
static enum lw_status init_lights(struct lw_patch_solver *s) {
    const struct lw_scene *scene = s->desc.scene;
    const struct lw_client_lights *client = parts_drawn(s) ? s->desc.client_lights : NULL;
    const bool none = s->method->surfaces_shoot && s->method->surfaces_shoot(s);
    s->no_light = calloc(scene->light_count + 1ul, 1);
    s->no_material = malloc(scene->material_count + 1ul);
    if (!s->no_light || !s->no_material) return LW_NO_MEMORY;
    memset(s->no_material, none ? NO_MATERIAL : 0, scene->material_count);
    struct lw_lights_part part = {.light = client ? client->light : s->no_light,
                                  .material = client && !none ? client->material : s->no_material,
                                  .value = 0,
                                  .sky = true};
    enum lw_status status = lw_lights_init(&s->emitters, scene, &s->pose);
    if (status == LW_OK) status = lw_lights_init_part(&s->lights, scene, &s->pose, &part);
    if (status != LW_OK || !client) return status;
    part.value = 1;
    part.sky = false;
    return lw_lights_init_part(&s->drawn, scene, &s->pose, &part);
}

static bool allocate(struct lw_patch_solver *s) {
    const size_t count = s->tiles.texel_count + 1ul;
    bool ok = true;
    for (int c = 0; c < 3; c++) {
        ok &= (s->frame_direct[c] = calloc(count, sizeof(float))) != NULL;
        ok &= (s->frame_bounces[c] = calloc(count, sizeof(float))) != NULL;
        ok &= (s->arrived[c] = calloc(count, sizeof(float))) != NULL;
        if (parts_drawn(s)) ok &= (s->frame_drawn[c] = calloc(count, sizeof(float))) != NULL;
    }
    return ok;
}

static enum lw_status build(struct lw_patch_solver *s, const struct lw_pose *pose, struct lw_error *err) {
    const struct lw_scene *scene = s->desc.scene;
    enum lw_status status = lw_pose_init_copy(&s->pose, pose, scene);
    if (status != LW_OK) return lw_status_fail(err, status, "poses");
    const struct lw_geometry_terms terms = {.saved = s->desc.saved_texels};
    status = lw_geometry_init(&s->geometry, scene, &s->pose, &terms, s->threads, s->desc.cancel,
                              s->desc.waiting, err);
    if (status != LW_OK) return status;
    const struct lw_texels *texels = &s->geometry.texels;
    struct lw_vec3 lo = {0}, hi = {0};
    lw_pose_bounds(&s->pose, scene, &lo, &hi);
    lw_cells_init(&s->cells, lo, hi, s->desc.cell_size_m);
    status = lw_tiles_init(&s->tiles, scene, s->desc.atlas_map, texels, 1, s->threads);
    if (status == LW_OK && parts_drawn(s)) status = lw_tiles_part_drawn(&s->tiles);
    if (status == LW_OK) status = lw_patches_init(&s->patches, &s->tiles, texels);
    if (status == LW_OK && !allocate(s)) status = LW_NO_MEMORY;
    if (status == LW_OK) status = init_lights(s);
    if (status != LW_OK) return lw_status_fail(err, status, "%u texels", texels->count);
    if ((status = s->method->init(s, err)) != LW_OK) return status;
    s->shown = (struct lw_shown){.geometry = &s->geometry,
                                 .map = s->desc.atlas_map,
                                 .tiles = &s->tiles,
                                 .threads = s->threads,
                                 .filters = s->desc.denoise};
    return lw_shown_init(&s->shown, err);
}

enum lw_status lw_patch_solver_create(struct lw_patch_solver *s, const struct lw_patch_solver_method *method,
                                      const struct lw_solver_desc *desc, const struct lw_pose *pose,
                                      struct lw_solver **out_solver, struct lw_error *err) {
    enum lw_status status;
    bool moved;
    s->method = method;
    s->ops = shared_ops;
    s->ops.name = method->name;
    s->base.ops = &s->ops;
    s->desc = *desc;
    s->threads = desc->threads ? (int)desc->threads : omp_get_max_threads();
    if ((status = build(s, pose, err)) == LW_OK) status = take_pose(s, pose, 0, &moved, err);
    if (status != LW_OK) {
        destroy(&s->base);
        return status;
    }
    *out_solver = &s->base;
    return LW_OK;
}
