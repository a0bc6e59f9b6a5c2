#include "server/solve/cell_frame.h"

#include "common/base/log.h"
#include "server/solve/adapt/estimates.h"
#include "server/solve/state/checkpoint.h"

#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

/* State of a solver that a checkpoint keeps. */
struct remembered {
    uint32_t frames, frames_since_move, moves;
    uint32_t judges_split; /* errors are those of split irradiance */
};

static bool judges_split(const struct lw_cell_solver *s) { return s->tiles.judged_spread != s->tiles.spread; }

static enum lw_status frame(struct lw_solver *solver, const struct lw_pose *pose, uint64_t number,
                            struct lw_solver_stats *out_stats, struct lw_error *err) {
    return lw_cell_frame_run((struct lw_cell_solver *)solver, pose, number, out_stats, err);
}

struct lw_tiles *lw_cell_layer_tiles(struct lw_solver *solver) {
    return &((struct lw_cell_solver *)solver)->tiles;
}

void lw_cell_layer_set_turn(struct lw_solver *solver, const struct lw_cell_layer_turn *turn) {
    ((struct lw_cell_solver *)solver)->turn = *turn;
}

unsigned lw_cell_layer_backlog(const struct lw_solver *solver) {
    const struct lw_cell_solver *s = (const struct lw_cell_solver *)solver;
    return s->turn.onset && lw_cell_frame_is_behind(s) ? LW_CELL_LAYER_BACKLOG_MAX : s->memory.changed_left;
}

bool lw_cell_layer_solved(const struct lw_solver *solver, lw_tile_id id) {
    return ((const struct lw_cell_solver *)solver)->memory.tile[id.v].work != LW_TILE_WORK_NONE;
}

void lw_cell_layer_review(struct lw_solver *solver) {
    struct lw_cell_solver *s = (struct lw_cell_solver *)solver;
    const struct lw_transport passes = lw_cell_frame_transport(s);
    const struct lw_converged converged = lw_cell_data_converged(s);
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        lw_estimates_judge(&passes, tile);
        LW_TILES_EACH_BLOCK (tile, block) {
            if (block->state != LW_BLOCK_CONVERGED || !block->covered_count) continue;
            if (!lw_converged_may(&converged, tile, block)) block->state = LW_BLOCK_SAMPLED;
            lw_gradient_review(block, s->desc.target_error);
        }
        lw_tiles_sum_up(tile);
    }
    lw_plan_review(&s->memory);
    lw_plan_log_event(s->plan_log, "review");
}

static enum lw_status set_interest(struct lw_solver *solver, const uint8_t *interest, struct lw_error *err) {
    struct lw_cell_solver *s = (struct lw_cell_solver *)solver;
    enum lw_status status = lw_fine_tiles_want(&s->geometry->fine, interest);
    if (status == LW_OK)
        status = lw_interest_set_replace(&s->interest, interest, s->desc.atlas_map->plain_count);
    if (status != LW_OK)
        return lw_status_fail(err, status, "interest in %u texels", s->geometry->texels.count);
    for (uint32_t i = 0; i < s->tiles.count; i++)
        s->fact[i].level = lw_interest_set_level(&s->interest, s->fact[i].id);
    return LW_OK;
}

static void choose_channels(struct lw_solver *solver, uint32_t channels) {
    struct lw_cell_solver *s = (struct lw_cell_solver *)solver;
    if (lw_shown_choose(&s->shown, channels)) lw_cell_layer_review(solver);
}

/* Filters all blocks again from the sums, whatever they show, and welds them. */
static enum lw_status filter(struct lw_solver *solver, struct lw_error *err) {
    struct lw_cell_solver *s = (struct lw_cell_solver *)solver;
    const uint64_t last = lw_tiles_last_solved(&s->tiles);
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        LW_TILES_EACH_BLOCK (tile, block) block->shown_frame = last;
        tile->light.solved_frame = last;
    }
    return lw_shown_filter_once(&s->shown, last, err);
}

static void read_tile(const struct lw_solver *solver, lw_tile_id id, struct lw_solver_tile *out_tile) {
    const struct lw_cell_solver *s = (const struct lw_cell_solver *)solver;
    lw_shown_read_tile(&s->shown, id, s->desc.bounces, out_tile);
}

static bool has_light(const void *user, lw_tile_id id) {
    const struct lw_solve_tile *tile = lw_tiles_at(&((const struct lw_cell_solver *)user)->tiles, id);
    return tile->light.solved_frame && (tile->light.sample_count || !tile->covered_count);
}

static uint32_t list_fine(const struct lw_solver *solver, const lw_tile_id **out_tile) {
    const struct lw_cell_solver *s = (const struct lw_cell_solver *)solver;
    return lw_fine_tiles_list(&s->geometry->fine, has_light, s, out_tile);
}

static bool holds_fine(const struct lw_solver *solver, lw_tile_id id) {
    return lw_tiles_have(&((const struct lw_cell_solver *)solver)->tiles, id);
}

/* What a frame reads of those before it, beside the tiles. */
#define PARTS_MAX (1 + LW_TILE_CHANNELS_MAX + LW_PROBES_PARTS)
static uint32_t list_parts(const struct lw_cell_solver *s, struct remembered *remembered,
                           struct lw_checkpoint_part out_part[PARTS_MAX]) {
    uint32_t n = 0;
    out_part[n++] = (struct lw_checkpoint_part){remembered, sizeof *remembered};
    n += lw_seams_welds_list_parts(&s->shown.welds, out_part + n);
    if (s->has_probes) n += lw_probes_list_parts(&s->probes, out_part + n);
    return n;
}

static enum lw_status save(const struct lw_solver *solver, const char *path, const uint8_t key[16],
                           struct lw_error *err) {
    const struct lw_cell_solver *s = (const struct lw_cell_solver *)solver;
    struct remembered remembered = {s->frames, s->motion.frames_since_move, s->motion.moves, judges_split(s)};
    struct lw_checkpoint_part part[PARTS_MAX];
    const uint32_t parts = list_parts(s, &remembered, part);
    return lw_checkpoint_save(path, key, &s->tiles, part, parts, err);
}

static enum lw_status load(struct lw_solver *solver, const char *path, const uint8_t key[16],
                           uint64_t *out_frames, struct lw_error *err) {
    struct lw_cell_solver *s = (struct lw_cell_solver *)solver;
    struct remembered remembered;
    const struct lw_converged converged = lw_cell_data_converged(s);
    struct lw_checkpoint_part part[PARTS_MAX];
    const uint32_t parts = list_parts(s, &remembered, part);
    enum lw_status status = lw_checkpoint_load(path, key, &s->tiles, part, parts, err);
    if (status != LW_OK) return status;
    s->frames = remembered.frames;
    s->motion.moves = remembered.moves;
    s->motion.frames_since_move = remembered.frames_since_move;
    lw_plan_resume(&s->memory);
    lw_plan_log_event(s->plan_log, "resume");
    s->lacks_estimates = true;
    lw_seams_welds_resume(&s->shown.welds);
    if (remembered.judges_split != judges_split(s)) {
        const struct lw_transport passes = lw_cell_frame_transport(s);
        lw_tiles_sum_variance(&s->tiles, s->threads);
        for (uint32_t i = 0; i < s->tiles.count; i++) lw_estimates_judge(&passes, &s->tiles.tile[i]);
    }
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        LW_TILES_EACH_BLOCK (tile, block) {
            block->state = lw_converged_may(&converged, tile, block) ? LW_BLOCK_CONVERGED : LW_BLOCK_SAMPLED;
            block->change.moves = s->motion.moves;
        }
        lw_tiles_sum_up(tile);
    }
    lw_cell_frame_radiate_all(
        /* which a checkpoint does not keep; converged tiles are read before they are solved again. */
        s);
    *out_frames = s->frames;
    return LW_OK;
}

static size_t memory_bytes(const struct lw_solver *solver) {
    const struct lw_cell_solver *s = (const struct lw_cell_solver *)solver;
    const size_t rays = (size_t)s->tiles.texel_capacity * s->desc.indirect_samples;
    size_t bytes =
        rays * (sizeof *s->ray_hit + (s->ray_direction ? sizeof *s->ray_direction : 0) +
                (s->ray_gloss ? sizeof *s->ray_gloss : 0)) +
        (size_t)s->tiles.texel_capacity *
            (sizeof *s->reflected + (s->reflected_direction ? sizeof *s->reflected_direction : 0)) +
        2 * s->tiles.capacity * sizeof *s->due + lw_reflectors_memory_bytes(&s->reflectors) +
        lw_tiles_memory_bytes(&s->tiles) + lw_shown_memory_bytes(&s->shown) +
        lw_interest_set_memory_bytes(&s->interest) + lw_plan_bytes(s->tiles.capacity, s->memory.ids) +
        2 * s->memory.ids * sizeof(bool) + s->tiles.capacity * (sizeof *s->fact + sizeof *s->work.reports);
    if (s->has_probes) bytes += lw_probes_memory_bytes(&s->probes);
    return bytes + (s->geometry == &s->own_geometry ? lw_geometry_memory_bytes(s->geometry) : 0);
}

static void destroy(struct lw_solver *solver) {
    if (!solver) return;
    struct lw_cell_solver *s = (struct lw_cell_solver *)solver;
    if (s->geometry) lw_geometry_forget_tiles(s->geometry);
    lw_probes_finish(&s->probes);
    lw_reflectors_finish(&s->reflectors);
    lw_lights_finish(&s->lights);
    lw_lights_finish(&s->drawn);
    lw_shown_finish(&s->shown);
    lw_tiles_finish(&s->tiles);
    lw_geometry_finish(&s->own_geometry);
    lw_pose_finish(&s->pose);
    lw_interest_set_finish(&s->interest);
    lw_motion_finish(&s->motion);
    lw_plan_finish(&s->plan);
    lw_plan_log_destroy(s->plan_log);
    lw_plan_memory_finish(&s->memory);
    lw_work_finish(&s->work);
    free(s->fact);
    free(s->contributes);
    free(s->corrected);
    free(s->ray_hit);
    free(s->ray_direction);
    free(s->ray_gloss);
    free(s->reflected);
    free(s->reflected_direction);
    free(s->due);
    free(s->exchanged);
    free(s);
}

static const struct lw_solver_ops ops = {.name = "cells",
                                         .frame = frame,
                                         .set_interest = set_interest,
                                         .choose_channels = choose_channels,
                                         .filter = filter,
                                         .list_fine = list_fine,
                                         .holds_fine = holds_fine,
                                         .read_tile = read_tile,
                                         .save = save,
                                         .load = load,
                                         .memory_bytes = memory_bytes,
                                         .destroy = destroy};

static enum lw_status place_probes(struct lw_cell_solver *s, struct lw_vec3 lo, struct lw_vec3 hi) {
    enum lw_status status =
        lw_probes_init(&s->probes, &(struct lw_probes_desc){.scene = s->desc.scene,
                                                            .minimum_ws = lo,
                                                            .maximum_ws = hi,
                                                            .spacing_m = s->desc.probe_spacing_m,
                                                            .bounces = s->desc.bounces,
                                                            .seed = s->desc.seed,
                                                            .form = s->desc.probe_form,
                                                            .projection = s->desc.probe_projection});
    if (status != LW_OK) return status;
    lw_probes_place(&s->probes, &s->pose, s->geometry->trace, s->threads);
    lw_log(LW_LOG_INFO, "%u probes, %s, %.2g m apart; %u of them dead inside objects", s->probes.count,
           s->probes.form->name, (double)s->probes.grid.size_m.x, s->probes.count - s->probes.alive);
    return LW_OK;
}

static enum lw_status init_lights(struct lw_cell_solver *s) {
    const struct lw_client_lights *client = s->desc.client_lights;
    if (!lw_cell_data_parts_drawn(s)) return lw_lights_init(&s->lights, s->desc.scene, &s->pose);
    const struct lw_lights_part served = lw_client_lights_part(client, false),
                                drawn = lw_client_lights_part(client, true);
    enum lw_status status = lw_lights_init_part(&s->lights, s->desc.scene, &s->pose, &served);
    return status == LW_OK ? lw_lights_init_part(&s->drawn, s->desc.scene, &s->pose, &drawn) : status;
}

static enum lw_status allocate_plan(struct lw_cell_solver *s) {
    const uint32_t ids = s->desc.atlas_map->tile_count;
    lw_interest_set_init(&s->interest, ids);
    s->fact = calloc(s->tiles.capacity + 1ul, sizeof *s->fact);
    s->contributes = calloc(ids + 1ul, sizeof *s->contributes);
    s->corrected = calloc(ids + 1ul, sizeof *s->corrected);
    enum lw_status status = s->fact && s->contributes && s->corrected ? LW_OK : LW_NO_MEMORY;
    if (status == LW_OK) status = lw_motion_init(&s->motion, s->desc.scene->object_count);
    if (status == LW_OK) status = lw_plan_init(&s->plan, s->tiles.capacity);
    if (status == LW_OK) status = lw_plan_memory_init(&s->memory, ids);
    return status == LW_OK ? lw_work_init(&s->work, s->tiles.capacity, s->threads, s->desc.cancel) : status;
}

static enum lw_status build(struct lw_cell_solver *s, const struct lw_pose *pose, struct lw_error *err) {
    const struct lw_scene *scene = s->desc.scene;
    enum lw_status status = lw_pose_init_copy(&s->pose, pose, scene);
    if (status != LW_OK) return lw_status_fail(err, status, "poses");
    if (!s->geometry) {
        s->geometry = &s->own_geometry;
        const struct lw_geometry_terms terms = {s->desc.saved_texels, s->desc.ranks ? 0 : s->desc.fine_tiles,
                                                s->desc.fine_when, s->desc.atlas_map};
        status = lw_geometry_init(s->geometry, scene, &s->pose, &terms, s->threads, s->desc.cancel,
                                  s->desc.waiting, err);
        if (status != LW_OK) return status;
    }
    const struct lw_texels *texels = &s->geometry->texels;
    struct lw_vec3 lo = {0}, hi = {0};
    lw_pose_bounds(&s->pose, scene, &lo, &hi);
    lw_cells_init(&s->cells, lo, hi, s->desc.cell_size_m);
    if ((status = lw_tiles_init(&s->tiles, scene, s->desc.atlas_map, texels, s->desc.bounces, s->threads)) !=
        LW_OK)
        return lw_status_fail(err, status, "%u texels", texels->count);
    if (lw_cell_data_parts_drawn(s) && (status = lw_tiles_part_drawn(&s->tiles)) != LW_OK)
        return lw_status_fail(err, status, "%u texels", texels->count);
    if (s->desc.directions &&
        (status = lw_tiles_hold_moments(&s->tiles, scene, s->desc.directional)) != LW_OK)
        return lw_status_fail(err, status, "directions of light in %u texels", texels->count);
    lw_fine_tiles_add_layer(&s->geometry->fine,
                            &(struct lw_fine_tiles_layer){.tiles = &s->tiles,
                                                          .note = lw_cell_frame_forget_tile,
                                                          .place = lw_cell_frame_place_tiles,
                                                          .user = s});
    s->shown = (struct lw_shown){.geometry = s->geometry,
                                 .map = s->desc.atlas_map,
                                 .tiles = &s->tiles,
                                 .threads = s->threads,
                                 .seams_later = lw_solver_desc_is_limited(&s->desc),
                                 .filters = s->desc.denoise};
    if ((status = lw_shown_init(&s->shown, err)) != LW_OK) return status;
    if ((status = init_lights(s)) != LW_OK) return lw_status_fail(err, status, "lights");
    lw_tiles_set_pose(&s->tiles, &s->cells, &s->pose);
    for (uint32_t i = 0; i < s->tiles.count; i++)
        s->tiles.tile[i].owner =
            lw_ranks_owner(s->desc.ranks, s->tiles.tile[i].cell, lw_cells_total(&s->cells));

    s->has_probes = isfinite(s->desc.tracing_range_m) && s->desc.bounces > 0;
    if (s->has_probes && (status = place_probes(s, lo, hi)) != LW_OK)
        return lw_status_fail(err, status, "probes");
    const size_t rays = (size_t)texels->capacity * s->desc.indirect_samples + 1;
    const bool glossy = s->desc.directions && lw_scene_has_finishes(scene);
    s->ray_hit = calloc(rays, sizeof *s->ray_hit);
    if (s->desc.directions) s->ray_direction = calloc(rays, sizeof *s->ray_direction);
    if (glossy) s->ray_gloss = calloc(rays, sizeof *s->ray_gloss);
    s->reflected = calloc((size_t)texels->capacity + 1, sizeof *s->reflected);
    if (s->desc.directions)
        s->reflected_direction = calloc((size_t)texels->capacity + 1, sizeof *s->reflected_direction);
    s->due = malloc(((size_t)s->tiles.capacity + 1) * sizeof *s->due);
    s->exchanged = malloc(((size_t)s->tiles.capacity + 1) * sizeof *s->exchanged);
    if (!s->ray_hit || (s->desc.directions && (!s->ray_direction || !s->reflected_direction)) ||
        (glossy && !s->ray_gloss) || !s->reflected || !s->due || !s->exchanged ||
        lw_reflectors_init(&s->reflectors, scene, texels, &s->pose) != LW_OK || allocate_plan(s) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "%u texels", texels->count);
    if (!s->desc.plan_log) return LW_OK;
    return lw_plan_log_create(s->desc.plan_log, s->tiles.capacity, s->memory.ids, &s->plan_log, err);
}

enum lw_status lw_cell_layer_create(struct lw_geometry *geometry, const struct lw_solver_desc *desc,
                                    const struct lw_pose *pose, struct lw_solver **out_solver,
                                    struct lw_error *err) {
    struct lw_cell_solver *s = calloc(1, sizeof *s);
    if (!s) return lw_status_fail(err, LW_NO_MEMORY, "solver");
    s->base.ops = &ops;
    s->geometry = geometry;
    s->desc = *desc;
    s->turn = (struct lw_cell_layer_turn){.budget = lw_solver_desc_budget(desc),
                                          .onset = lw_solver_desc_is_limited(desc)};
    s->threads = desc->threads ? (int)desc->threads : omp_get_max_threads();
    if (!(s->desc.tracing_range_m > 0)) s->desc.tracing_range_m = INFINITY;
    enum lw_status status = build(s, pose, err);
    if (status != LW_OK) {
        destroy(&s->base);
        return status;
    }
    *out_solver = &s->base;
    return LW_OK;
}
