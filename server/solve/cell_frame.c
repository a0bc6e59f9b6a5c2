#include "server/solve/cell_frame.h"

#include "common/clock.h"
#include "server/solve/adapt/estimates.h"
#include "server/solve/adapt/verify.h"
#include "server/solve/transport/bounces.h"
#include "server/solve/transport/direct_light.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

/* Of the time that rays and sums take. */
#define LISTING_SHARE 0.05
/* Texels of a scene that listing looks at in the time in which one is solved. */
#define LISTING_TEXELS 256u
/* Of running means of rates: light changes seldom, and verification in bursts. */
#define SOLVE_RATE_FRAMES  10
#define VERIFY_RATE_FRAMES 2

/* A frame under way. */
struct frame {
    struct lw_cell_solver *s;
    const struct lw_pose *pose;
    uint64_t number;
    struct lw_transport transport;
    struct lw_scheduler_frame following;
    struct lw_solver_stats stats;
    uint64_t verified; /* work (budget.h) */
    /* Of the stage under way: time that belongs to probes. */
    uint64_t probe_ns;
    /* Something is due. */
    bool solves;
    /* Light that others read may be changing. */
    bool changing;
};

/* Seams that hold an object which has begun to move may do so a little longer where
 * frames have a time to keep. */
enum lw_status lw_cell_frame_find_seams(struct lw_cell_solver *s) {
    enum lw_status status =
        lw_geometry_find_seams(s->geometry, &s->tiles, lw_solver_desc_is_limited(&s->desc));
    if (status != LW_OK || s->seams_found == s->geometry->seams_found) return status;
    s->seams_found = s->geometry->seams_found;
    for (int f = 0; f < LW_LIGHT_FORM_COUNT && status == LW_OK; f++) {
        lw_seams_light_finish(&s->welds[f]);
        if (f == LW_LIGHT_FORM_FULL || lw_cell_frame_parts_drawn(s))
            status = lw_seams_light_init(&s->welds[f], &s->geometry->seams, f);
    }
    return status;
}

/* What all tiles send out, from their sums. */
void lw_cell_frame_radiate_all(struct lw_cell_solver *s) {
    const struct lw_transport passes = {.tiles = &s->tiles};
    for (uint32_t bounce = 0; bounce < s->desc.bounces; bounce++) {
#pragma omp parallel for schedule(static) num_threads(s->threads)
        for (uint32_t i = 0; i < s->tiles.count; i++) lw_bounces_radiate(&passes, &s->tiles.tile[i], bounce);
    }
}

struct lw_transport lw_cell_frame_transport(struct lw_cell_solver *s) {
    return (struct lw_transport){.scene = s->desc.scene,
                                 .pose = &s->pose,
                                 .trace = s->geometry->trace,
                                 .lights = &s->lights,
                                 .drawn = lw_cell_frame_parts_drawn(s) ? &s->drawn : NULL,
                                 .texels = &s->geometry->texels,
                                 .cells = &s->cells,
                                 .probes = s->has_probes ? &s->probes : NULL,
                                 .tiles = &s->tiles,
                                 .ray_hit = s->ray_hit,
                                 .reflectors = &s->reflectors,
                                 .reflected = s->reflected,
                                 .direct_samples = s->desc.direct_samples,
                                 .indirect_samples = s->desc.indirect_samples,
                                 .seed = s->desc.seed,
                                 .tracing_range_m = s->desc.tracing_range_m,
                                 .target_error = s->desc.target_error};
}

static bool counts_units(const struct lw_cell_solver *s) { return s->desc.frame_budget_units > 0; }

static struct lw_budget budget_of(const struct lw_cell_solver *s) {
    if (!lw_scheduler_mode_is_limited(s->turn.mode)) return (struct lw_budget){0};
    return counts_units(s) ? lw_budget_of_units(s->turn.budget)
                           : lw_budget_of_time(s->turn.budget, &s->rates);
}

static struct lw_scheduler_frame following_of(const struct lw_cell_solver *s,
                                              const struct lw_transport *passes) {
    return (struct lw_scheduler_frame){.passes = passes,

                                       .converged = lw_cell_frame_converged(s),
                                       .budget = budget_of(s),
                                       .mode = s->turn.mode,
                                       .filtered = s->desc.denoise,
                                       .threads = s->threads};
}

static bool cancelled(const struct lw_cell_solver *s) { return s->desc.cancel && *s->desc.cancel; }

/* Those that the frame under way solves. */
static struct lw_solve_tile *due_tile(const struct lw_cell_solver *s, uint32_t i) {
    return &s->tiles.tile[s->tiles.slot_of_id[s->due[i].v]];
}

/* The frames for which probes may remember, that many frames after a movement. */
static uint32_t probe_history_max(const struct lw_cell_solver *s) {
    const struct lw_scheduler *follow = &s->scheduler;
    return follow->moves ? LW_CELL_LAYER_HISTORY_PROBES - 1 + follow->frames_since_move / 2 : UINT32_MAX;
}

static void count_rays(struct lw_solver_stats *stats, const struct lw_ray_count *count) {
    stats->rays_shadow += count->shadow;
    stats->rays_bounce += count->bounce;
}

/* ---- stages: what has changed ---- */

/* Takes over what of the texels is other than before. */
static bool take_texels(struct lw_cell_solver *s) {
    if (s->texel_changes == s->geometry->changes) return false;
    s->texel_changes = s->geometry->changes;
    lw_tiles_recount(&s->tiles, s->threads);
    return true;
}

/* Takes over s->pose. */
static enum lw_status place(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    enum lw_status status =
        lw_geometry_set_pose(s->geometry, &s->pose, lw_solver_desc_is_limited(&s->desc), f->number, err);
    if (status != LW_OK) return status;
    (void)take_texels(s);
    if (s->pose_due & (LW_POSE_MATERIALS | LW_POSE_SKY))
        status = lw_lights_set_materials(&s->lights, &s->pose);
    if (status == LW_OK && s->pose_due & (LW_POSE_MATERIALS | LW_POSE_SKY) && lw_cell_frame_parts_drawn(s))
        status = lw_lights_set_materials(&s->drawn, &s->pose);
    if (status != LW_OK) return lw_status_fail(err, status, "taking over what has changed");
    if (s->pose_due & LW_POSE_MATERIALS) lw_cell_frame_radiate_all(s);
    lw_lights_set_pose(&s->lights, &s->pose);
    if (lw_cell_frame_parts_drawn(s)) lw_lights_set_pose(&s->drawn, &s->pose);
    lw_tiles_set_pose(&s->tiles, &s->cells, &s->pose);
    lw_reflectors_place(&s->reflectors, &s->tiles);
    if (s->view_due || s->pose_due & LW_POSE_DYNAMIC) s->listing = 0; /* rays to what is gone would lie */
    if (s->has_probes) {
        uint64_t t = lw_clock_ns();
        f->stats.rays_probe += lw_probes_place(&s->probes, &s->pose, s->geometry->trace, s->threads);
        f->probe_ns += lw_clock_ns() - t;
    }
    s->pose_due = 0;
    s->view_due = false;
    return LW_OK;
}

/* Rays are traced again to those of the last frame that solved something. A block that it left alone may find
 * another list than its own, and by that some noise in what has changed. */
static enum lw_status find_reflectors(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    if (!s->desc.bounces) return LW_OK;
    enum lw_status status = lw_reflectors_update(&s->reflectors, &s->tiles, &s->pose);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "listing what shines by reflected light");
}

/* A list that is a little old costs noise, not light: in a big scene, whose frames solve little of it,
 * listing takes its share of the time and no more. */
static enum lw_status find_reflectors_in_time(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    if (lw_solver_desc_is_limited(&s->desc) && (double)s->listing > LISTING_SHARE * (double)s->since_listing)
        return LW_OK;
    const uint64_t began_ns = lw_clock_ns();
    enum lw_status status = find_reflectors(f, err);
    s->listing = !s->frames        ? 0 /* the first frame looks at every texel */
                 : counts_units(s) ? s->tiles.texel_count / LISTING_TEXELS * LW_BUDGET_UNIT
                                   : lw_clock_ns() - began_ns;
    s->since_listing = 0;
    return status;
}

/* Estimates of the last solves, before anything moves from where it was then. */
static void recall(struct lw_cell_solver *s, const struct lw_transport *passes,
                   struct lw_solver_stats *stats) {
    uint64_t shadow = 0, bounce = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : shadow, bounce)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_ray_count count = {0};
        lw_verify_recall(passes, &s->tiles.tile[i], &count);
        shadow += count.shadow;
        bounce += count.bounce;
    }
    count_rays(stats, &(struct lw_ray_count){shadow, bounce});
    s->forgetful = false;
}

static enum lw_status take_pose(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    const unsigned moved = lw_pose_difference(f->pose, &s->pose, s->desc.scene);
    f->stats.moved = moved != 0;
    s->scheduler.frames_since_move++;
    enum lw_status rested = lw_geometry_rest(s->geometry, f->number, err);
    if (rested != LW_OK) return rested;
    /* What comes to rest parts light that has gone through it so far. */
    if (take_texels(s) && !moved)
        lw_scheduler_move(&s->scheduler, &s->tiles, s->desc.scene, &s->pose, &s->pose, false);
    if (!moved) return LW_OK;
    if (s->forgetful) {
        enum lw_status status = find_reflectors(f, err);
        if (status != LW_OK) return status;
        recall(s, &f->transport, &f->stats);
    }
    s->view_due |= memcmp(s->pose.object_hidden, f->pose->object_hidden,
                          s->desc.scene->object_count * sizeof *f->pose->object_hidden) != 0;
    lw_scheduler_move(&s->scheduler, &s->tiles, s->desc.scene, &s->pose, f->pose,
                      lw_lights_differ(&s->lights, &s->pose, f->pose) ||
                          (lw_cell_frame_parts_drawn(s) && lw_lights_differ(&s->drawn, &s->pose, f->pose)));
    lw_pose_copy(&s->pose, f->pose, s->desc.scene);
    s->pose_due |= moved;
    return LW_OK;
}

/* What appears is lit at once, whatever the interest: there is nothing without light (scheduler.h). That what
 * went was gone must be known by then. */
static enum lw_status place_if_seen(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    const bool looked_at = lw_scheduler_has_interest(&s->scheduler);
    enum lw_status status = lw_trace_settle(s->geometry->trace, false, err);
    if (status == LW_OK && s->pose_due && (looked_at || s->view_due)) status = place(f, err);
    return status;
}

static enum lw_status verify(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    struct lw_ray_count rays = {0};
    (void)err;
    lw_scheduler_find_contributors(&s->scheduler, &s->tiles, s->has_probes);
    f->verified = lw_scheduler_verify(&s->scheduler, &f->following, &rays);
    count_rays(&f->stats, &rays);
    return LW_OK;
}

/* ---- stages: what the frame solves ---- */

/* The blocks of the tiles that are due; of an invalidated one its invalidated blocks alone. Other tiles have
 * none, and are not looked at: in a big scene they are nearly all. */
static void choose_blocks(struct lw_cell_solver *s) {
    for (uint32_t i = 0; i < s->due_count; i++)
        LW_TILES_EACH_BLOCK (due_tile(s, i), block) block->due = false;
    s->due_count = 0;
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        if (!tile->work) continue;
        tile->solved_tick = s->scheduler.round;
        s->due[s->due_count++] = tile->id;
        LW_TILES_EACH_BLOCK (tile, block)
            block->due = block->state != LW_BLOCK_CONVERGED &&
                         (tile->work == LW_TILE_WORK_ALL || lw_gradient_is_strong(&block->change) ||
                          !block->sample_count);
    }
}

/* The share of the frame's budget that verification has taken. */
static double spent_share(const struct frame *f) {
    const struct lw_cell_solver *s = f->s;
    if (!f->following.budget.limited) return 0;
    return counts_units(s) ? (double)f->verified / (double)f->following.budget.verify
                           : (double)f->stats.change_ns / (1e9 * s->turn.budget);
}

/* Where nothing is due the pose waits, and with it the probes' rays. */
static enum lw_status choose(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    struct lw_scheduler_count count;
    lw_budget_note(&s->rates.verify_ns, f->verified, f->stats.change_ns, 1.0 / VERIFY_RATE_FRAMES);
    enum lw_status status = LW_OK;
    const struct lw_scheduler_room everything = {UINT64_MAX, UINT64_MAX};
    lw_scheduler_choose(&s->scheduler, &s->tiles,
                        s->frames
                            ? lw_scheduler_room_left(&s->scheduler, &s->tiles, &f->following, spent_share(f))
                            : everything, /* the first frame lights all */
                        &count);
    f->stats.tiles_interest = count.interest;
    f->stats.tiles_contributing = count.contributing;
    f->solves = count.due > 0;
    f->changing = lw_scheduler_is_changing(&s->scheduler);
    lw_scheduler_note_work(&s->scheduler, f->solves);
    if (f->solves && s->pose_due) status = place(f, err);
    choose_blocks(s);
    return status;
}

/* After place(): its new materials were verified before. */
static enum lw_status weigh_direct(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    struct lw_ray_count rays = {0};
    (void)err;
    for (uint32_t bounce = 0; bounce < s->desc.bounces; bounce++)
        memset(s->tiles.radiance_change[bounce], 0,
               (size_t)s->tiles.block_count * LW_REGIONS * sizeof(struct lw_vec3));
    lw_scheduler_weigh(&s->scheduler, &f->following, &rays);
    count_rays(&f->stats, &rays);
    return LW_OK;
}

static enum lw_status pass_on(struct frame *f, struct lw_error *err) {
    (void)err;
    lw_scheduler_pass_on(&f->s->scheduler, &f->following);
    return LW_OK;
}

/* ---- stages: light ---- */

/* A step is a tile in a pass over all that are due. Shown of the first frame, which may be long, and while
 * somebody waits for the end of one. */
static void begin_progress(struct lw_cell_solver *s) {
    static const _Atomic bool never = false;
    const uint32_t passes = 1 + (s->desc.bounces ? 1 + s->desc.bounces : 0);
    const uint64_t steps = (uint64_t)s->due_count * passes;
    if (!s->frames) {
        lw_progress_init_waiting(&s->progress, "lighting the first frame", steps, s->desc.waiting,
                                 LW_WAITING_FIRST_LIGHT);
        return;
    }
    lw_progress_init(&s->progress, "finishing the samples under way", steps);
    s->progress.wanted = s->desc.finishing ? s->desc.finishing : &never;
}

/* While what is remembered of the time before a movement may still show. */
static bool is_fading(const struct lw_cell_solver *s) {
    return s->scheduler.moves && s->scheduler.frames_since_move < LW_CELL_LAYER_FADE_FRAMES;
}

static void run_direct(struct lw_cell_solver *s, const struct lw_transport *passes,
                       struct lw_solver_stats *stats) {
    uint64_t shadow = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : shadow)
    for (uint32_t i = 0; i < s->due_count; i++) {
        struct lw_ray_count count = {0};
        if (cancelled(s)) continue;
        lw_direct_light_solve(passes, due_tile(s, i), &count);
        shadow += count.shadow;
        lw_progress_step(&s->progress, 1);
    }
    stats->rays_shadow += shadow;
}

static void run_trace_bounces(struct lw_cell_solver *s, const struct lw_transport *passes,
                              struct lw_solver_stats *stats) {
    uint64_t bounce = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : bounce)
    for (uint32_t i = 0; i < s->due_count; i++) {
        struct lw_ray_count count = {0};
        if (cancelled(s)) continue;
        lw_bounces_trace(passes, due_tile(s, i), &count);
        lw_scheduler_note_hits(&s->scheduler, passes, due_tile(s, i));
        bounce += count.bounce;
        lw_progress_step(&s->progress, 1);
    }
    stats->rays_bounce += bounce;
}

static void run_radiate(struct lw_cell_solver *s, const struct lw_transport *passes, uint32_t bounce) {
#pragma omp parallel for schedule(static) num_threads(s->threads)
    for (uint32_t i = 0; i < s->due_count; i++)
        if (!cancelled(s)) lw_bounces_radiate(passes, due_tile(s, i), bounce);
}

/* Light of earlier frames follows what direct light is now; along rays that new ones are
 * about to take the place of. */
static void run_reread(struct lw_cell_solver *s, const struct lw_transport *passes) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads)
    for (uint32_t i = 0; i < s->due_count; i++)
        if (!cancelled(s)) lw_verify_reread(passes, due_tile(s, i));
}

/* With which weight this frame's estimates of bounces enter their means. */
static void weigh_indirect(struct lw_cell_solver *s) {
    const float most = s->has_probes ? (float)probe_history_max(s) : INFINITY;
#pragma omp parallel for schedule(static) num_threads(s->threads)
    for (uint32_t i = 0; i < s->due_count; i++) {
        if (cancelled(s)) continue;
        LW_TILES_EACH_BLOCK (due_tile(s, i), block)
            if (block->due) lw_gradient_weigh_indirect(block, most, s->desc.denoise);
    }
}

/* Bounces from the second on change only now. */
static void run_arrive(struct lw_cell_solver *s, const struct lw_transport *passes) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads)
    for (uint32_t i = 0; i < s->due_count; i++)
        if (!cancelled(s)) lw_verify_arrive(passes, due_tile(s, i));
}

static void run_gather(struct lw_cell_solver *s, const struct lw_transport *passes, uint32_t bounce) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads)
    for (uint32_t i = 0; i < s->due_count; i++) {
        if (cancelled(s)) continue;
        lw_bounces_gather(passes, due_tile(s, i), bounce);
        lw_progress_step(&s->progress, 1);
    }
}

static enum lw_status direct(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    (void)err;
    begin_progress(s);
    run_direct(s, &f->transport, &f->stats);
    if (s->desc.bounces) run_radiate(s, &f->transport, 0);
    return LW_OK;
}

static enum lw_status trace_bounces(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    (void)err;
    if (s->desc.bounces && f->changing) run_reread(s, &f->transport);
    if (s->desc.bounces) run_trace_bounces(s, &f->transport, &f->stats);
    weigh_indirect(s);
    return LW_OK;
}

static enum lw_status gather_probes(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    (void)err;
    const struct lw_wall_sides sides = lw_geometry_sides(s->geometry);
    if (s->has_probes)
        f->stats.rays_probe += lw_probes_gather(&s->probes, &sides, s->frames, is_fading(s), s->threads);
    return LW_OK;
}

static void project_probes(struct frame *f, uint32_t bounce) {
    struct lw_cell_solver *s = f->s;
    const uint64_t t = lw_clock_ns();
    lw_probes_project(&s->probes, bounce, s->tiles.radiance[bounce], probe_history_max(s), s->threads);
    f->probe_ns += lw_clock_ns() - t;
}

static enum lw_status scatter(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    (void)err;
    for (uint32_t bounce = 1; bounce <= s->desc.bounces; bounce++) {
        if (s->has_probes) project_probes(f, bounce - 1);
        run_gather(s, &f->transport, bounce);
        if (bounce < s->desc.bounces) run_radiate(s, &f->transport, bounce);
    }
    return LW_OK;
}

static enum lw_status arrive(struct frame *f, struct lw_error *err) {
    (void)err;
    if (f->s->desc.bounces > 1 && f->changing) run_arrive(f->s, &f->transport);
    return LW_OK;
}

static enum lw_status stop_if_cancelled(struct frame *f, struct lw_error *err) {
    (void)err;
    if (!cancelled(f->s)) return LW_OK;
    lw_progress_stop(&f->s->progress);
    return LW_CLOSED;
}

/* ---- stages: what is shown ---- */

/* Of what was solved in this frame, or before and not shown. */
static enum lw_status accumulate(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    const uint64_t frame = f->number;
    (void)err;
    lw_scheduler_show(&s->scheduler, &f->following);
    uint32_t shown = 0;
    if (s->desc.awaited && *s->desc.awaited && s->frames > 0) lw_scheduler_put_off(&s->scheduler, &s->tiles);
#pragma omp parallel for schedule(dynamic, 1) num_threads(s->threads) reduction(+ : shown)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        struct lw_solve_tile *tile = &s->tiles.tile[i];
        if (tile->work) lw_estimates_finish_tile(&f->transport, tile);
        LW_TILES_EACH_BLOCK (tile, block) {
            block->unseen |= tile->work && block->due && block->covered_count;
            if (!(block->unseen && tile->shows) &&
                !(s->shows_all && block->covered_count && block->sample_count))
                continue;
            block->unseen = tile->begins = false;
            block->shown_frame = tile->solved_frame = frame;
        }
        shown += tile->solved_frame == frame;
    }
    f->stats.tiles_shown = shown;
    s->shows_all = false;
    return LW_OK;
}

/* The two sides of seams and the gutters, around what a frame shows. */
enum lw_status lw_cell_frame_weld(struct lw_cell_solver *s, uint64_t number, struct lw_error *err) {
    const struct lw_seams *seams = &s->geometry->seams;
    enum lw_status status = lw_cell_frame_find_seams(s);
    if (status != LW_OK) return lw_status_fail(err, status, "seams");
    lw_seams_weld(seams, s->welds, s->forms, &s->tiles, number, s->threads);
    lw_seam_gutters_fill(&seams->gutters, &s->tiles, number, s->forms, s->threads);
    return LW_OK;
}

static enum lw_status filter(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    (void)err;
    if (!f->stats.tiles_shown) return LW_OK;
    if (s->desc.denoise)
        lw_denoise_run(&s->denoise, f->number, s->forms, s->threads);
    else
        lw_tiles_show(&s->tiles, f->number, s->forms, s->threads);
    return LW_OK;
}

static enum lw_status weld(struct frame *f, struct lw_error *err) {
    return f->stats.tiles_shown ? lw_cell_frame_weld(f->s, f->number, err) : LW_OK;
}

/* Blocks whose error is low enough stay converged until their light changes. */
static void settle_tile(const struct lw_cell_solver *s, struct lw_solve_tile *tile) {
    const struct lw_converged converged = lw_cell_frame_converged(s);
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!block->due || !block->covered_count) continue;
        block->state = lw_converged_is(&converged, block)                  ? LW_BLOCK_CONVERGED
                       : lw_gradient_is_stale(block, s->desc.target_error) ? LW_BLOCK_STALE
                                                                           : LW_BLOCK_SAMPLED;
        if (block->state == LW_BLOCK_CONVERGED) block->change.strength = 0;
    }
    lw_scheduler_sum_invalidated(tile);
    lw_tiles_sum_up(tile);
}

/* Frames that a block still needs. Noise falls with the root of their number, what a dark block may have
 * missed with the number itself. */
static double frames_left(const struct lw_converged *converged, const struct lw_solve_block *block) {
    const double seen = fmax(1, block->sample_count),
                 ratio = (double)block->error / (double)converged->target_error;
    if (converged->frames_max) return fmax(0, (double)converged->frames_max - seen);
    return fmax(fmax(1, LW_SOLVER_FRAMES_MIN - seen),
                seen * (block->luminance > 0 ? ratio * ratio : ratio) - seen);
}

static double texels_left(const struct lw_cell_solver *s, const struct lw_solve_tile *tile) {
    const struct lw_converged converged = lw_cell_frame_converged(s);
    double sum = 0;
    LW_TILES_EACH_BLOCK (tile, block)
        if (!lw_converged_may(&converged, tile, block))
            sum += frames_left(&converged, block) * (double)block->covered_count;
    return sum;
}

static enum lw_status settle(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    struct lw_solver_stats *stats = &f->stats;
    uint32_t converged = 0;
    double left = 0;
    (void)err;
    for (uint32_t i = 0; i < s->due_count; i++) {
        LW_TILES_EACH_BLOCK (due_tile(s, i), block)
            stats->texels_solved += block->due ? block->covered_count : 0;
        settle_tile(s, due_tile(s, i));
    }
#pragma omp parallel for schedule(static) num_threads(s->threads) reduction(+ : converged, left)
    for (uint32_t i = 0; i < s->tiles.count; i++) {
        const struct lw_solve_tile *tile = &s->tiles.tile[i];
        converged += tile->state == LW_BLOCK_CONVERGED;
        if (tile->state != LW_BLOCK_CONVERGED) left += texels_left(s, tile);
    }
    stats->tiles = s->tiles.count;
    stats->tiles_solved = s->due_count;
    stats->tiles_converged = converged;
    stats->texels_left = left;
    return LW_OK;
}

static enum lw_status finish(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    const uint64_t work = f->stats.texels_solved * LW_BUDGET_SOLVE,
                   took_ns = f->stats.direct_ns + f->stats.scatter_ns;
    (void)err;
    lw_progress_finish(&s->progress);
    lw_budget_note(&s->rates.solve_ns, work, took_ns, 1.0 / SOLVE_RATE_FRAMES);
    s->since_listing += counts_units(s) ? work : took_ns;
    s->frames++;
    return LW_OK;
}

/* ---- the frame ---- */

struct stage {
    enum lw_status (*run)(struct frame *f, struct lw_error *err);
    /* Left out where nothing is due. */
    bool solves;
    /* Offset into struct lw_solver_stats: where its time counts; or NOT_COUNTED. */
    size_t spent;
};
#define SPENT(field) offsetof(struct lw_solver_stats, field)
#define NOT_COUNTED  SIZE_MAX
#define ALWAYS       false
#define IF_DUE       true

static const struct stage stages[] = {
    {take_pose, ALWAYS, SPENT(pose_ns)},
    {place_if_seen, ALWAYS, SPENT(pose_ns)},
    {verify, ALWAYS, SPENT(change_ns)},
    {choose, ALWAYS, SPENT(pose_ns)},
    {weigh_direct, IF_DUE, SPENT(change_ns)},
    {pass_on, ALWAYS, SPENT(change_ns)},
    {direct, IF_DUE, SPENT(direct_ns)},
    {find_reflectors_in_time, IF_DUE, SPENT(pose_ns)},
    {trace_bounces, IF_DUE, SPENT(scatter_ns)},
    {gather_probes, IF_DUE, SPENT(probe_ns)},
    {scatter, IF_DUE, SPENT(scatter_ns)},
    {arrive, IF_DUE, NOT_COUNTED},
    {stop_if_cancelled, IF_DUE, NOT_COUNTED},
    {accumulate, ALWAYS, NOT_COUNTED},
    {filter, ALWAYS, SPENT(denoise_ns)},
    {weld, ALWAYS, SPENT(weld_ns)},
    {settle, ALWAYS, NOT_COUNTED},
    {finish, IF_DUE, NOT_COUNTED},
};

static void note_time(struct frame *f, size_t spent, uint64_t ns) {
    if (spent != NOT_COUNTED) *(uint64_t *)((char *)&f->stats + spent) += ns - f->probe_ns;
    f->stats.probe_ns += f->probe_ns;
    f->probe_ns = 0;
}

enum lw_status lw_cell_frame_run(struct lw_cell_solver *s, const struct lw_pose *pose, uint64_t number,
                                 struct lw_solver_stats *out_stats, struct lw_error *err) {
    struct frame f = {.s = s, .pose = pose, .number = number, .transport = lw_cell_frame_transport(s)};
    f.following = following_of(s, &f.transport);
    for (size_t i = 0; i < sizeof stages / sizeof *stages; i++) {
        if (stages[i].solves && !f.solves) continue;
        const uint64_t began_ns = lw_clock_ns();
        enum lw_status status = stages[i].run(&f, err);
        if (status != LW_OK) return status;
        note_time(&f, stages[i].spent, lw_clock_ns() - began_ns);
    }
    *out_stats = f.stats;
    return LW_OK;
}
