#include "server/solve/radiosity_solver.h"

#include "common/clock.h"
#include "common/light/client_lights.h"
#include "common/log.h"
#include "server/solve/adapt/estimates.h"
#include "server/solve/geometry.h"
#include "server/solve/radiosity/radiosity_directions.h"
#include "server/solve/radiosity/radiosity_pass.h"
#include "server/solve/state/checkpoint.h"
#include "server/solve/transport/direct_light.h"

#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* By which a frame turns the directions of the one before, radians: no two frames have the same. */
#define GOLDEN_ANGLE 2.39996323f
/* Of lw_lights_part: no material's value. */
#define NO_MATERIAL 2u
#define WINDOW_MAX  LW_TILE_SIDE /* a window lies in one tile */

struct radiosity_solver {
    struct lw_solver base;
    struct lw_solver_desc desc;
    int threads;
    struct lw_geometry geometry;
    struct lw_cells cells;
    /* One order of bounces: all of them together. Its radiance is what a pass shoots. */
    struct lw_tiles tiles;
    struct lw_seams_light welds[LW_LIGHT_FORM_COUNT];
    uint32_t seams_found;
    unsigned forms;
    bool shows_all;
    /* emitters: all lights, for their surfaces; lights, drawn: what the direct pass samples, no surfaces. */
    struct lw_lights emitters, lights, drawn;
    uint8_t *no_light, *no_material; /* of a scene without client lights; of every material, NO_MATERIAL */
    struct lw_patches patches;
    struct lw_shooters shooters;
    struct lw_radiosity_directions directions;
    struct lw_pair_visibility visibility; /* of patches and shooters as they were placed last */
    uint8_t visibility_key[16];
    bool visibility_saved;
    struct lw_denoise denoise;
    float *frame_direct[3], *frame_drawn[3], *arrived[3]; /* E of this frame; of the pass under way */
    struct lw_pose pose;
    bool placed;
    struct lw_progress progress;
    uint32_t frames; /* whole ones, since the light last changed */
};

static bool parts_drawn(const struct radiosity_solver *s) {
    return lw_client_lights_any(s->desc.client_lights);
}

enum lw_status lw_radiosity_solver_check(const struct lw_solver_desc *desc, struct lw_error *err) {
    const char *cannot = desc->light_groups ? "light groups"
                         : isfinite(desc->tracing_range_m) && desc->tracing_range_m > 0
                             ? "a tracing range (--tracing-range)"
                         : desc->frame_budget_s > 0 ? "a frame's budget"
                         : desc->client_lights && desc->client_lights->drawn_materials
                             ? "emissive surfaces that clients draw (--client-lights): those shoot"
                             : NULL;
    if (cannot) return lw_status_fail(err, LW_USAGE, "the solver \"radiosity\" does not do %s", cannot);
    const struct lw_radiosity_terms *terms = &desc->radiosity;
    if (terms->window > WINDOW_MAX)
        return lw_status_fail(err, LW_USAGE, "a window of radiosity has at most %u texels a side",
                              WINDOW_MAX);
    if (terms->directions > LW_RADIOSITY_DIRECTIONS_MAX)
        return lw_status_fail(err, LW_USAGE, "radiosity has at most %u directions",
                              LW_RADIOSITY_DIRECTIONS_MAX);
    if (terms->window && terms->undersample == LW_UNDERSAMPLE_NONE)
        return lw_status_fail(err, LW_USAGE, "a window of radiosity (--window) needs --undersample");
    if (terms->subdivide > 0 &&
        (terms->directions || terms->keeps_visibility || terms->undersample != LW_UNDERSAMPLE_NONE))
        return lw_status_fail(
            err, LW_USAGE,
            "--subdivide has shooters of its own for each bounce: it excludes --undersample, "
            "--keep-visibility and --directions");
    if (terms->directions && terms->keeps_visibility)
        return lw_status_fail(err, LW_USAGE, "--directions knows no pairs: it excludes --keep-visibility");
    if (terms->directions && terms->undersample != LW_UNDERSAMPLE_NONE)
        return lw_status_fail(err, LW_USAGE, "--directions looks at no shooters: it excludes --undersample");
    return LW_OK;
}

/* ---- a frame ---- */

static bool cancelled(const struct radiosity_solver *s) { return s->desc.cancel && *s->desc.cancel; }

static struct lw_transport transport_of(struct radiosity_solver *s, struct lw_tiles *tiles) {
    return (struct lw_transport){.scene = s->desc.scene,
                                 .pose = &s->pose,
                                 .trace = s->geometry.trace,
                                 .lights = &s->lights,
                                 .drawn = parts_drawn(s) ? &s->drawn : NULL,
                                 .texels = &s->geometry.texels,
                                 .cells = &s->cells,
                                 .tiles = tiles,
                                 .direct_samples = 1,
                                 .indirect_samples = 1,
                                 .seed = s->desc.seed,
                                 .tracing_range_m = INFINITY,
                                 .target_error = s->desc.target_error};
}

static void forget(struct radiosity_solver *s) {
    const size_t bytes = s->tiles.texel_count * sizeof(float);
    float *const planes[] = {s->tiles.mean, s->tiles.spread, s->tiles.split_mean, s->tiles.split_spread};
    s->frames = 0;
    for (int k = 0; k < 4; k++)
        if (planes[k]) memset(planes[k], 0, bytes);
    for (int c = 0; c < 3; c++) {
        memset(s->tiles.direct[c], 0, bytes);
        memset(s->tiles.order[0][c], 0, bytes);
        if (s->tiles.drawn[c]) memset(s->tiles.drawn[c], 0, bytes);
    }
    for (int f = 0; f < LW_LIGHT_FORM_COUNT; f++)
        if (s->welds[f].member_count)
            memset(s->welds[f].correction, 0,
                   (size_t)s->welds[f].member_count * 3 * sizeof *s->welds[f].correction);
    for (uint32_t b = 0; b < s->tiles.block_count; b++) {
        struct lw_solve_block *block = &s->tiles.block[b];
        block->sample_count = 0;
        block->direct = block->indirect = (struct lw_history){0};
        block->error = 1;
        block->state = block->covered_count ? LW_BLOCK_SAMPLED : LW_BLOCK_CONVERGED;
    }
}

/* Another pose begins another solution: nothing of the light before it is kept. */
static enum lw_status take_pose(struct radiosity_solver *s, const struct lw_pose *pose, bool *out_moved,
                                struct lw_error *err) {
    const unsigned moved = lw_pose_difference(pose, &s->pose, s->desc.scene);
    *out_moved = moved != 0;
    if (!moved && s->placed) return LW_OK;
    lw_pose_copy(&s->pose, pose, s->desc.scene);
    enum lw_status status = lw_geometry_set_pose(&s->geometry, &s->pose, false, err);
    if (status != LW_OK) return status;
    if (moved & LW_POSE_DYNAMIC) lw_tiles_recount(&s->tiles, s->threads);
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
static uint64_t light_directly(struct radiosity_solver *s) {
    struct lw_tiles own = s->tiles; /* with sums of the frame's */
    uint64_t rays = 0;
    for (int c = 0; c < 3; c++) { /* to 0: a mean that begins elsewhere ends elsewhere, by rounding */
        own.direct[c] = memset(s->frame_direct[c], 0, s->tiles.texel_count * sizeof(float));
        if (parts_drawn(s)) own.drawn[c] = memset(s->frame_drawn[c], 0, s->tiles.texel_count * sizeof(float));
    }
    const struct lw_transport t = transport_of(s, &own);
    for (uint32_t k = 0; k < LW_RADIOSITY_SOLVER_DIRECT; k++) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : rays)
        for (uint32_t i = 0; i < own.count; i++) {
            struct lw_solve_tile *tile = &own.tile[i];
            struct lw_ray_count count = {0};
            if (tile->hidden || cancelled(s)) continue;
            LW_TILES_EACH_BLOCK (tile, block) {
                block->due = true;
                block->direct.weight = 1.0f / (float)(k + 1);
                block->sample_count = s->frames * LW_RADIOSITY_SOLVER_DIRECT + k;
            }
            lw_direct_light_solve(&t, tile, &count);
            rays += count.shadow;
        }
    }
    return rays;
}

/* What each patch reflects of the light that has arrived, for the next pass. */
static void reflect(struct radiosity_solver *s, float *const e[3]) {
    float *radiance = s->tiles.radiance[0];
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        const struct lw_solve_tile *tile = &s->tiles.tile[i];
        for (uint32_t k = 0; k < tile->width * tile->height; k++)
            for (int c = 0; c < 3; c++)
                radiance[4 * (size_t)(tile->first + k) + (size_t)c] =
                    s->tiles.covered[tile->first + k]
                        ? tile->mesh->albedo[c][tile->local + k] * e[c][tile->first + k] / LW_PI
                        : 0;
    }
}

static uint64_t pass(struct radiosity_solver *s, uint32_t order, const float *radiance, uint32_t stride) {
    const uint32_t salt = s->frames * (s->desc.bounces + 1) + order;
    if (s->directions.count)
        return lw_radiosity_directions_run(
            &(struct lw_radiosity_gather){.patches = &s->patches,
                                          .directions = &s->directions,
                                          .trace = s->geometry.trace,
                                          .radiance = radiance,
                                          .stride = stride,
                                          .turn = GOLDEN_ANGLE * (float)s->frames,
                                          .salt = salt * LW_RADIOSITY_DIRECTIONS_MAX,
                                          .cancel = s->desc.cancel,
                                          .progress = &s->progress,
                                          .threads = s->threads},
            s->arrived);
    if (s->desc.radiosity.subdivide > 0) {
        /* Lamps keep their texels: a lamp of one point casts hard shadows, and there are few of them. */
        lw_shooters_subdivide(&s->shooters, order ? s->desc.radiosity.subdivide : 0, radiance, stride);
        lw_log(LW_LOG_DEBUG, "radiosity: bounce %u: %u shooters", order, s->shooters.count);
    } else {
        lw_shooters_charge(&s->shooters, radiance, stride, s->threads);
    }
    return lw_radiosity_pass_run(
        &(struct lw_radiosity_pass){.patches = &s->patches,
                                    .shooters = &s->shooters,
                                    .trace = s->geometry.trace,
                                    .salt = salt,
                                    .visibility = s->visibility.mask ? &s->visibility : NULL,
                                    .cancel = s->desc.cancel,
                                    .progress = &s->progress,
                                    .threads = s->threads},
        s->arrived);
}

static void add(const struct radiosity_solver *s, float *const dst[3], float *const src[3]) {
#pragma omp parallel for schedule(static) num_threads(s->threads)
    for (uint32_t i = 0; i < s->tiles.texel_count; i++)
        for (int c = 0; c < 3; c++) dst[c][i] += src[c][i];
}

static bool shoots_emission(const struct radiosity_solver *s) {
    return s->patches.emission && !s->directions.count;
}

/* Emission first, then bounce by bounce; into the estimates of the frame. */
static uint64_t shoot(struct radiosity_solver *s) {
    float *const *const indirect = s->tiles.estimate[LW_TILES_ESTIMATE_BOUNCES + LW_CHANGE_FIRST];
    uint64_t rays = 0;
    const size_t bytes = s->tiles.texel_count * sizeof(float);
    if (shoots_emission(s)) {
        rays += pass(s, 0, s->patches.emission[0], 3);
        add(s, s->frame_direct, s->arrived);
    }
    for (int c = 0; c < 3; c++) memset(indirect[c], 0, bytes);
    for (uint32_t order = 1; order <= s->desc.bounces && !cancelled(s); order++) {
        reflect(s, order == 1 ? s->frame_direct : s->arrived);
        rays += pass(s, order, s->tiles.radiance[0], 4);
        add(s, indirect, s->arrived);
    }
    return rays;
}

/* The frame's estimates enter the means. */
static void blend(struct radiosity_solver *s) {
    struct lw_tiles *tiles = &s->tiles;
    const float weight = 1.0f / (float)(s->frames + 1);
    const struct lw_transport t = transport_of(s, tiles);
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads)
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        if (tile->hidden) continue;
        for (uint32_t texel = tile->first; texel < tile->first + tile->width * tile->height; texel++) {
            if (!tiles->covered[texel]) continue;
            const struct lw_vec3 direct = lw_texels_vector(s->frame_direct, texel);
            lw_tiles_store(tiles->estimate[LW_TILES_ESTIMATE_DIRECT], texel, direct);
            lw_tiles_blend(tiles->direct, texel, direct, weight);
            lw_tiles_blend(
                tiles->order[0], texel,
                lw_texels_vector(tiles->estimate[LW_TILES_ESTIMATE_BOUNCES + LW_CHANGE_FIRST], texel),
                weight);
            if (!parts_drawn(s)) continue;
            const struct lw_vec3 drawn = lw_texels_vector(s->frame_drawn, texel);
            lw_tiles_store(tiles->drawn_estimate, texel, drawn);
            lw_tiles_blend(tiles->drawn, texel, drawn, weight);
        }
        LW_TILES_EACH_BLOCK (tile, block) {
            block->sample_count = s->frames;
            lw_history_take(&block->direct, INFINITY);
            lw_history_take(&block->indirect, INFINITY);
        }
        lw_estimates_finish_tile(&t, tile);
    }
}

static bool has_converged(const struct radiosity_solver *s, const struct lw_solve_block *block) {
    return !block->covered_count ||
           (block->sample_count >= LW_RADIOSITY_SOLVER_FRAMES_MIN && block->error <= s->desc.target_error) ||
           (s->desc.frames_max && block->sample_count >= s->desc.frames_max);
}

static void settle(struct radiosity_solver *s) {
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        LW_TILES_EACH_BLOCK (tile, block)
            block->state = tile->hidden || has_converged(s, block) ? LW_BLOCK_CONVERGED : LW_BLOCK_SAMPLED;
        lw_tiles_sum_up(tile);
    }
}

/* All tiles go on until the last has converged: each lights all others. */
static bool is_done(const struct radiosity_solver *s) {
    for (uint32_t i = 0; i < s->tiles.count; i++)
        if (s->tiles.tile[i].state != LW_BLOCK_CONVERGED) return false;
    return true;
}

static void mark_shown(struct radiosity_solver *s, uint64_t number) {
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        if (tile->hidden || !tile->covered_count) continue;
        LW_TILES_EACH_BLOCK (tile, block) block->shown_frame = number;
        tile->solved_frame = number;
    }
}

static enum lw_status find_seams(struct radiosity_solver *s, struct lw_error *err) {
    enum lw_status status = lw_geometry_find_seams(&s->geometry, &s->tiles, false);
    if (status == LW_OK && s->seams_found != s->geometry.seams_found) {
        s->seams_found = s->geometry.seams_found;
        for (int f = 0; f < LW_LIGHT_FORM_COUNT && status == LW_OK; f++) {
            lw_seams_light_finish(&s->welds[f]);
            if (f == LW_LIGHT_FORM_FULL || parts_drawn(s))
                status = lw_seams_light_init(&s->welds[f], &s->geometry.seams, f);
        }
    }
    return status == LW_OK ? LW_OK
                           : lw_status_fail(err, status, "seams of %u texels", s->geometry.texels.count);
}

static enum lw_status weld(struct radiosity_solver *s, uint64_t number, struct lw_error *err) {
    enum lw_status status = find_seams(s, err);
    if (status != LW_OK) return status;
    lw_seams_weld(&s->geometry.seams, s->welds, s->forms, &s->tiles, number, s->threads);
    lw_seam_gutters_fill(&s->geometry.seams.gutters, &s->tiles, number, s->forms, s->threads);
    return LW_OK;
}

static enum lw_status set_up_denoise(struct radiosity_solver *s, struct lw_error *err) {
    if (s->denoise.pairs) return LW_OK;
    enum lw_status status = lw_geometry_weigh_pairs(&s->geometry);
    if (status == LW_OK)
        status = lw_denoise_init(&s->denoise, &s->geometry.pairs, s->desc.atlas_map, &s->tiles, s->threads);
    return status == LW_OK ? LW_OK
                           : lw_status_fail(err, status, "denoiser of %u texels", s->geometry.texels.count);
}

static enum lw_status show_light(struct radiosity_solver *s, uint64_t number, bool filters,
                                 struct lw_error *err) {
    mark_shown(s, number);
    s->shows_all = false;
    if (filters)
        lw_denoise_run(&s->denoise, number, s->forms, s->threads);
    else
        lw_tiles_show(&s->tiles, number, s->forms, s->threads);
    return weld(s, number, err);
}

/* With bits for each pair, patches stay where they are from frame to frame. */
static enum lw_status place_all(struct radiosity_solver *s, struct lw_error *err) {
    const struct lw_radiosity_terms *terms = &s->desc.radiosity;
    uint8_t key[16];
    lw_patches_place(&s->patches, &s->pose, terms->keeps_visibility ? 0 : s->frames, s->threads);
    if (s->directions.count) return LW_OK;
    lw_shooters_place(&s->shooters, s->desc.seed, terms->keeps_visibility ? 0 : s->frames);
    if (!terms->keeps_visibility || (s->visibility.mask && s->frames)) return LW_OK;
    lw_pair_visibility_key(&s->patches, &s->shooters, &s->pose, key);
    if (s->visibility.mask && memcmp(key, s->visibility_key, sizeof key) == 0) return LW_OK;
    memcpy(s->visibility_key, key, sizeof key);
    lw_pair_visibility_finish(&s->visibility);
    s->visibility_saved = false;
    enum lw_status status =
        lw_pair_visibility_init(&s->visibility, s->patches.packet_count, s->shooters.count, err);
    if (status != LW_OK) return status;
    lw_log(LW_LOG_INFO, "radiosity: the visibility of all pairs takes %.3g MiB",
           (double)lw_pair_visibility_bytes(&s->visibility) / (1 << 20));
    if (!terms->visibility_path || access(terms->visibility_path, F_OK) != 0) return LW_OK;
    return lw_pair_visibility_load(&s->visibility, terms->visibility_path, key, err);
}

/* Light is not thrown away because a disk is full. */
static void save_visibility(struct radiosity_solver *s) {
    struct lw_error err = {0};
    const char *path = s->desc.radiosity.visibility_path;
    if (!path || s->visibility_saved) return;
    if (lw_pair_visibility_save(&s->visibility, path, s->visibility_key, &err) != LW_OK)
        lw_log(LW_LOG_WARNING, "the visibility is not saved: %s", err.text);
    s->visibility_saved = true;
}

static void solve_all(struct radiosity_solver *s, struct lw_solver_stats *stats) {
    uint64_t t = lw_clock_ns();
    lw_progress_init(&s->progress, s->frames ? "radiosity" : "lighting the first frame",
                     (uint64_t)s->patches.packet_count * (s->desc.bounces + shoots_emission(s)));
    stats->rays_shadow = light_directly(s);
    stats->direct_ns = lw_clock_ns() - t;
    t = lw_clock_ns();
    if (!s->frames && s->directions.count)
        lw_log(LW_LOG_INFO, "radiosity: %u patches, %u directions", s->patches.count, s->directions.count);
    else if (!s->frames)
        lw_log(LW_LOG_INFO, "radiosity: %u patches, %u shooters: %.3g pairs a bounce", s->patches.count,
               s->shooters.count, (double)s->patches.count * (double)s->shooters.count);
    stats->rays_bounce = shoot(s);
    stats->scatter_ns = lw_clock_ns() - t;
}

static enum lw_status frame(struct lw_solver *solver, const struct lw_pose *pose, uint64_t number,
                            struct lw_solver_stats *out_stats, struct lw_error *err) {
    struct radiosity_solver *s = (struct radiosity_solver *)solver;
    struct lw_solver_stats stats = {.tiles = s->tiles.count};
    uint64_t t = lw_clock_ns();
    enum lw_status status = take_pose(s, pose, &stats.moved, err);
    if (status != LW_OK) return status;
    stats.pose_ns = lw_clock_ns() - t;
    const bool solves = !is_done(s);
    if (solves) {
        if ((status = place_all(s, err)) != LW_OK) return status;
        solve_all(s, &stats);
        if (cancelled(s)) {
            lw_progress_stop(&s->progress);
            return LW_CLOSED;
        }
        lw_progress_finish(&s->progress);
        if (stats.rays_bounce) save_visibility(s);
        blend(s);
        s->frames++;
        settle(s);
        stats.texels_solved = s->patches.count;
        stats.tiles_solved = s->tiles.count;
    }
    if (solves || s->shows_all) {
        t = lw_clock_ns();
        if ((status = show_light(s, number, s->desc.denoise, err)) != LW_OK) return status;
        stats.weld_ns = lw_clock_ns() - t;
        stats.tiles_shown = s->tiles.count;
    }
    for (uint32_t i = 0; i < s->tiles.count; i++)
        stats.tiles_converged += s->tiles.tile[i].state == LW_BLOCK_CONVERGED;
    if (s->desc.frames_max && stats.tiles_converged < stats.tiles)
        stats.texels_left = (double)(s->desc.frames_max - s->frames) * s->patches.count;
    *out_stats = stats;
    return LW_OK;
}

/* ---- the rest of solver.h ---- */

static enum lw_status set_interest(struct lw_solver *solver, const uint8_t *interest, struct lw_error *err) {
    (void)solver;
    return interest ? lw_status_fail(err, LW_USAGE,
                                     "the solver \"radiosity\" knows no interest: every "
                                     "texel lights all others")
                    : LW_OK;
}

static void show_forms(struct lw_solver *solver, unsigned forms) {
    struct radiosity_solver *s = (struct radiosity_solver *)solver;
    if (!parts_drawn(s)) forms = LW_LIGHT_FORMS_FULL;
    s->shows_all |= (forms & ~s->forms) != 0 && s->frames > 0;
    s->forms = forms;
    lw_tiles_judge_forms(&s->tiles, forms, s->threads);
}

static enum lw_status filter(struct lw_solver *solver, struct lw_error *err) {
    struct radiosity_solver *s = (struct radiosity_solver *)solver;
    enum lw_status status = set_up_denoise(s, err);
    uint64_t last = 0;
    for (uint32_t i = 0; i < s->tiles.count; i++)
        last = s->tiles.tile[i].solved_frame > last ? s->tiles.tile[i].solved_frame : last;
    return status == LW_OK ? show_light(s, last, true, err) : status;
}

static void read_tile(const struct lw_solver *solver, lw_tile_id id, struct lw_solver_tile *out_tile) {
    const struct radiosity_solver *s = (const struct radiosity_solver *)solver;
    const struct lw_solve_tile *tile = &s->tiles.tile[s->tiles.slot_of_id[id.v]];
    *out_tile = (struct lw_solver_tile){.covered = s->tiles.covered + tile->first,
                                        .filled = s->geometry.texels.filled + tile->first,
                                        .width = tile->width,
                                        .height = tile->height,
                                        .bounces = s->desc.bounces,
                                        .sample_count = tile->sample_count,
                                        .error = tile->covered_count ? tile->error : 0,
                                        .solved_frame = tile->solved_frame};
    for (int c = 0; c < 3; c++) {
        out_tile->direct[c] = s->tiles.direct[c] + tile->first;
        out_tile->indirect[c] = s->tiles.indirect[c] + tile->first;
        out_tile->irradiance[c] = s->tiles.irradiance[LW_LIGHT_FORM_FULL][c] + tile->first;
        if (s->forms & lw_light_form_bit(LW_LIGHT_FORM_SPLIT))
            out_tile->split[c] = s->tiles.irradiance[LW_LIGHT_FORM_SPLIT][c] + tile->first;
        out_tile->albedo[c] = tile->mesh->albedo[c] + tile->local;
    }
}

#define PARTS_MAX (1 + LW_LIGHT_FORM_COUNT)
static uint32_t list_parts(const struct radiosity_solver *s, uint32_t *frames,
                           struct lw_checkpoint_part out_part[PARTS_MAX]) {
    uint32_t n = 0;
    out_part[n++] = (struct lw_checkpoint_part){frames, sizeof *frames};
    for (int f = 0; f < LW_LIGHT_FORM_COUNT; f++)
        if (s->welds[f].member_count)
            out_part[n++] =
                (struct lw_checkpoint_part){s->welds[f].correction, (size_t)s->welds[f].member_count * 3 *
                                                                        sizeof *s->welds[f].correction};
    return n;
}

static enum lw_status save(const struct lw_solver *solver, const char *path, const uint8_t key[16],
                           struct lw_error *err) {
    const struct radiosity_solver *s = (const struct radiosity_solver *)solver;
    struct lw_checkpoint_part part[PARTS_MAX];
    uint32_t frames = s->frames;
    const uint32_t parts = list_parts(s, &frames, part);
    return lw_checkpoint_save(path, key, &s->tiles, part, parts, err);
}

static enum lw_status load(struct lw_solver *solver, const char *path, const uint8_t key[16],
                           uint64_t *out_frames, struct lw_error *err) {
    struct radiosity_solver *s = (struct radiosity_solver *)solver;
    struct lw_checkpoint_part part[PARTS_MAX];
    uint32_t frames = 0;
    const uint32_t parts = list_parts(s, &frames, part);
    enum lw_status status = lw_checkpoint_load(path, key, &s->tiles, part, parts, err);
    if (status != LW_OK) return status;
    for (int f = 0; f < LW_LIGHT_FORM_COUNT; f++) s->welds[f].fresh = true;
    s->frames = frames;
    settle(s);
    *out_frames = frames;
    return LW_OK;
}

static size_t memory_bytes(const struct lw_solver *solver) {
    const struct radiosity_solver *s = (const struct radiosity_solver *)solver;
    size_t bytes = lw_tiles_memory_bytes(&s->tiles) + lw_denoise_memory_bytes(&s->denoise) +
                   lw_patches_memory_bytes(&s->patches) + lw_shooters_memory_bytes(&s->shooters) +
                   lw_geometry_memory_bytes(&s->geometry) + lw_pair_visibility_bytes(&s->visibility) +
                   (size_t)s->tiles.texel_count * (parts_drawn(s) ? 9 : 6) * sizeof(float);
    for (int f = 0; f < LW_LIGHT_FORM_COUNT; f++) bytes += lw_seams_light_memory_bytes(&s->welds[f]);
    return bytes;
}

static void destroy(struct lw_solver *solver) {
    if (!solver) return;
    struct radiosity_solver *s = (struct radiosity_solver *)solver;
    lw_geometry_forget_tiles(&s->geometry);
    lw_denoise_finish(&s->denoise);
    lw_shooters_finish(&s->shooters);
    lw_pair_visibility_finish(&s->visibility);
    lw_radiosity_directions_finish(&s->directions);
    lw_patches_finish(&s->patches);
    lw_lights_finish(&s->emitters);
    lw_lights_finish(&s->lights);
    lw_lights_finish(&s->drawn);
    for (int f = 0; f < LW_LIGHT_FORM_COUNT; f++) lw_seams_light_finish(&s->welds[f]);
    lw_tiles_finish(&s->tiles);
    lw_geometry_finish(&s->geometry);
    lw_pose_finish(&s->pose);
    for (int c = 0; c < 3; c++) {
        free(s->frame_direct[c]);
        free(s->frame_drawn[c]);
        free(s->arrived[c]);
    }
    free(s->no_light);
    free(s->no_material);
    free(s);
}

static const struct lw_solver_ops ops = {.name = "radiosity",
                                         .frame = frame,
                                         .set_interest = set_interest,
                                         .show = show_forms,
                                         .filter = filter,
                                         .read_tile = read_tile,
                                         .save = save,
                                         .load = load,
                                         .memory_bytes = memory_bytes,
                                         .destroy = destroy};

/* Surfaces shoot: the direct pass samples none of them. Along directions, which would miss small lamps, it
 * samples them all. */
static enum lw_status init_lights(struct radiosity_solver *s) {
    const struct lw_scene *scene = s->desc.scene;
    const struct lw_client_lights *client = s->desc.client_lights;
    s->no_light = calloc(scene->light_count + 1ul, 1);
    s->no_material = malloc(scene->material_count + 1ul);
    if (!s->no_light || !s->no_material) return LW_NO_MEMORY;
    memset(s->no_material, s->directions.count ? 0 : NO_MATERIAL, scene->material_count);
    struct lw_lights_part part = {.light = parts_drawn(s) ? client->light : s->no_light,
                                  .material = s->no_material,
                                  .value = 0,
                                  .sky = true};
    enum lw_status status = lw_lights_init(&s->emitters, scene, &s->pose);
    if (status == LW_OK) status = lw_lights_init_part(&s->lights, scene, &s->pose, &part);
    if (status != LW_OK || !parts_drawn(s)) return status;
    part.value = 1;
    part.sky = false;
    return lw_lights_init_part(&s->drawn, scene, &s->pose, &part);
}

static bool allocate(struct radiosity_solver *s) {
    const size_t count = s->tiles.texel_count + 1ul;
    bool ok = true;
    for (int c = 0; c < 3; c++) {
        ok &= (s->frame_direct[c] = calloc(count, sizeof(float))) != NULL;
        ok &= (s->arrived[c] = calloc(count, sizeof(float))) != NULL;
        if (parts_drawn(s)) ok &= (s->frame_drawn[c] = calloc(count, sizeof(float))) != NULL;
    }
    return ok;
}

static enum lw_status build(struct radiosity_solver *s, const struct lw_pose *pose, struct lw_error *err) {
    const struct lw_scene *scene = s->desc.scene;
    const struct lw_radiosity_terms *terms = &s->desc.radiosity;
    enum lw_status status = lw_pose_init(&s->pose, scene);
    if (status != LW_OK) return lw_status_fail(err, status, "poses");
    lw_pose_copy(&s->pose, pose, scene);
    status = lw_geometry_init(&s->geometry, scene, &s->pose, s->threads, s->desc.cancel, err);
    if (status != LW_OK) return status;
    const struct lw_texels *texels = &s->geometry.texels;
    struct lw_vec3 lo = {0}, hi = {0};
    lw_pose_bounds(&s->pose, scene, &lo, &hi);
    lw_cells_init(&s->cells, lo, hi, s->desc.cell_size_m);
    status = lw_tiles_init(&s->tiles, scene, s->desc.atlas_map, texels, 1, s->threads);
    if (status == LW_OK && parts_drawn(s)) status = lw_tiles_part_drawn(&s->tiles);
    if (status == LW_OK) status = lw_patches_init(&s->patches, &s->tiles, texels);
    if (status == LW_OK) status = lw_radiosity_directions_init(&s->directions, terms->directions);
    if (status == LW_OK && !terms->directions)
        status = lw_shooters_init(&s->shooters, &s->patches, terms->undersample, terms->window);
    if (status == LW_OK && !allocate(s)) status = LW_NO_MEMORY;
    if (status == LW_OK) status = init_lights(s);
    if (status != LW_OK) return lw_status_fail(err, status, "%u texels", texels->count);
    if (terms->keeps_visibility && lw_trace_tints(s->geometry.trace))
        return lw_status_fail(err, LW_USAGE,
                              "--keep-visibility holds bits, and the scene has surfaces that tint light");
    if ((status = find_seams(s, err)) != LW_OK) return status;
    return s->desc.denoise ? set_up_denoise(s, err) : LW_OK;
}

enum lw_status lw_radiosity_solver_create(const struct lw_solver_desc *desc, const struct lw_pose *pose,
                                          struct lw_solver **out_solver, struct lw_error *err) {
    enum lw_status status = lw_radiosity_solver_check(desc, err);
    if (status != LW_OK) return status;
    struct radiosity_solver *s = calloc(1, sizeof *s);
    if (!s) return lw_status_fail(err, LW_NO_MEMORY, "solver");
    s->base.ops = &ops;
    s->desc = *desc;
    s->forms = LW_LIGHT_FORMS_FULL;
    s->threads = desc->threads ? (int)desc->threads : omp_get_max_threads();
    bool moved;
    if ((status = build(s, pose, err)) == LW_OK) status = take_pose(s, pose, &moved, err);
    if (status != LW_OK) {
        destroy(&s->base);
        return status;
    }
    *out_solver = &s->base;
    return LW_OK;
}
