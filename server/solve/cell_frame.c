#include "server/solve/cell_frame.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "server/solve/adapt/correct.h"
#include "server/solve/adapt/estimates.h"
#include "server/solve/adapt/verify.h"
#include "server/solve/cell_light.h"
#include "server/solve/transport/bounces.h"

#include <math.h>
#include <string.h>

/* Lengths of the running means of rates: light changes seldom, and verification comes in bursts. Below
 * 1 / VERIFY_RATE_SHARE of a budget, work besides verification takes most of the time. */
#define SOLVE_RATE_FRAMES  10
#define VERIFY_RATE_FRAMES 2
#define VERIFY_RATE_SHARE  8

/* A frame under way. */
struct frame {
    struct lw_cell_solver *s;
    const struct lw_pose *pose;
    uint64_t number;
    struct lw_transport transport;
    struct lw_correct correct;
    struct lw_cell_light light;
    struct lw_solver_stats stats;
    uint64_t verified; /* work (budget.h) */
};

struct radiating {
    struct lw_transport passes;
    uint32_t bounce;
};

static void radiate_tile(void *user, uint32_t item, struct lw_work_report *report) {
    const struct radiating *r = user;
    (void)report;
    lw_bounces_radiate(&r->passes, &r->passes.tiles->tile[item], r->bounce);
}

/* What all tiles send out, from their sums. */
void lw_cell_frame_radiate_all(struct lw_cell_solver *s) {
    struct radiating r = {.passes = {.tiles = &s->tiles}};
    for (r.bounce = 0; r.bounce < s->desc.bounces; r.bounce++)
        lw_work_run(&s->work, s->tiles.count, LW_WORK_CHEAP, NULL, radiate_tile, &r);
}

struct lw_transport lw_cell_frame_transport(struct lw_cell_solver *s) {
    return (struct lw_transport){.scene = s->desc.scene,
                                 .pose = &s->pose,
                                 .trace = s->geometry->trace,
                                 .lights = &s->lights,
                                 .drawn = lw_cell_data_parts_drawn(s) ? &s->drawn : NULL,
                                 .texels = &s->geometry->texels,
                                 .probes = s->has_probes ? &s->probes : NULL,
                                 .tiles = &s->tiles,
                                 .ray_hit = s->ray_hit,
                                 .ray_direction = s->ray_direction,
                                 .ray_gloss = s->ray_gloss,
                                 .reflectors = &s->reflectors,
                                 .reflected = s->reflected,
                                 .reflected_direction = s->reflected_direction,
                                 .direct_samples = s->desc.direct_samples,
                                 .indirect_samples = s->desc.indirect_samples,
                                 .seed = s->desc.seed,
                                 .tracing_range_m = s->desc.tracing_range_m,
                                 .target_error = s->desc.target_error};
}

static struct lw_budget budget_of(const struct lw_cell_solver *s) {
    struct lw_budget budget = {0};
    if (!lw_solver_desc_is_limited(&s->desc)) return budget;
    budget = lw_solver_desc_counts(&s->desc) ? lw_budget_of_units(s->turn.budget)
                                             : lw_budget_of_time(s->turn.budget, &s->rates);
    budget.onset = s->turn.onset;
    budget.yields = s->turn.yields;
    return budget;
}

/* Whether this rank carries out the plan for a tile. */
static bool owns(const struct lw_cell_solver *s, lw_tile_id id) {
    return lw_tiles_at(&s->tiles, id)->owner == lw_ranks_self(s->desc.ranks);
}

static void exchange_due(const struct frame *f, enum lw_ranks_moment moment) {
    struct lw_cell_solver *s = f->s;
    lw_ranks_run(s->desc.ranks,
                 &(struct lw_ranks_exchange){
                     .moment = moment, .tiles = &s->tiles, .tile = s->due, .tile_count = s->due_count});
}

static void add_rays(struct frame *f, const struct lw_work_report *report) {
    f->stats.rays_shadow += report->rays.shadow;
    f->stats.rays_bounce += report->rays.bounce;
}

/* ---- pose ---- */

/* Takes over what of the texels is other than before. */
static bool take_texels(struct lw_cell_solver *s) {
    if (s->texel_changes == s->geometry->changes) return false;
    s->texel_changes = s->geometry->changes;
    lw_tiles_recount(&s->tiles, s->threads);
    return true;
}

/* Takes over s->pose. */
static enum lw_status apply_pose(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    enum lw_status status =
        lw_geometry_set_pose(s->geometry, &s->pose, lw_solver_desc_is_limited(&s->desc), f->number, err);
    if (status != LW_OK) return status;
    (void)take_texels(s);
    if (s->pose_due & (LW_POSE_MATERIALS | LW_POSE_SKY))
        status = lw_lights_set_materials(&s->lights, &s->pose);
    if (status == LW_OK && s->pose_due & (LW_POSE_MATERIALS | LW_POSE_SKY) && lw_cell_data_parts_drawn(s))
        status = lw_lights_set_materials(&s->drawn, &s->pose);
    if (status != LW_OK) return lw_status_fail(err, status, "taking over what has changed");
    if (s->pose_due & LW_POSE_MATERIALS) lw_cell_frame_radiate_all(s);
    lw_lights_set_pose(&s->lights, &s->pose);
    if (lw_cell_data_parts_drawn(s)) lw_lights_set_pose(&s->drawn, &s->pose);
    lw_tiles_set_pose(&s->tiles, &s->cells, &s->pose);
    lw_reflectors_place(&s->reflectors, &s->tiles);
    if (s->view_due || s->pose_due & LW_POSE_DYNAMIC) s->listing = 0; /* rays to gone objects would lie */
    LW_INVARIANT(s->texel_changes == s->geometry->changes);
    s->pose_due = 0;
    s->view_due = false;
    if (!s->has_probes) return LW_OK;
    lw_cell_light_charge(&f->light, &f->stats.pose_ns);
    f->stats.rays_probe += lw_probes_place(&s->probes, &s->pose, s->geometry->trace, s->threads);
    lw_cell_light_charge(&f->light, &f->stats.probe_ns);
    return LW_OK;
}

static void restore_estimates_of(void *user, uint32_t item, struct lw_work_report *report) {
    const struct lw_transport *passes = user;
    lw_verify_restore_estimates(passes, &passes->tiles->tile[item], &report->rays);
}

/* Estimates of the last solves, before anything moves from where it was then. */
static enum lw_status restore_estimates(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    enum lw_status status = lw_cell_light_list_reflectors(s, err);
    if (status != LW_OK) return status;
    const struct lw_work_report report =
        lw_work_run(&s->work, s->tiles.count, LW_WORK_TILES, NULL, restore_estimates_of, &f->transport);
    add_rays(f, &report);
    s->lacks_estimates = false;
    return LW_OK;
}

static void note_motion(struct lw_cell_solver *s, const struct lw_pose *is, bool shines) {
    lw_motion_note(&s->motion, &s->tiles, s->desc.scene, &s->pose, is, shines);
    lw_plan_note_move(&s->memory);
    lw_plan_log_event(s->plan_log, "move");
}

static enum lw_status take_pose(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    const unsigned moved = lw_pose_difference(f->pose, &s->pose, s->desc.scene);
    f->stats.moved = moved != 0;
    s->motion.frames_since_move++;
    enum lw_status status = lw_geometry_rest(s->geometry, f->number, err);
    if (status != LW_OK) return status;
    /* An object that comes to rest parts light that has gone through it so far. */
    if (take_texels(s) && !moved) note_motion(s, &s->pose, false);
    if (!moved) return LW_OK;
    if (s->lacks_estimates && (status = restore_estimates(f, err)) != LW_OK) return status;
    s->view_due |= memcmp(s->pose.object_hidden, f->pose->object_hidden,
                          s->desc.scene->object_count * sizeof *f->pose->object_hidden) != 0;
    note_motion(s, f->pose,
                lw_lights_differ(&s->lights, &s->pose, f->pose) ||
                    (lw_cell_data_parts_drawn(s) && lw_lights_differ(&s->drawn, &s->pose, f->pose)));
    lw_pose_copy(&s->pose, f->pose, s->desc.scene);
    s->pose_due |= moved;
    return LW_OK;
}

/* What appears is lit at once, whatever the interest: there is nothing without light (plan.h). So hidden
 * objects are placed before anything is verified. Where nobody looks, and nothing was hidden, the
 * pose waits. */
static enum lw_status pose(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    const bool looked_at = s->interest.scope != LW_INTEREST_NOTHING;
    enum lw_status status = take_pose(f, err);
    if (status == LW_OK) status = lw_trace_take_rebuilt(s->geometry->trace, false, err);
    if (status == LW_OK && s->pose_due && (looked_at || s->view_due)) status = apply_pose(f, err);
    lw_cell_light_charge(&f->light, &f->stats.pose_ns);
    return status;
}

/* ---- tiles of finer levels ---- */

/* Nothing is known of it. */
void lw_cell_frame_forget_tile(void *solver, lw_tile_id id) {
    struct lw_cell_solver *s = solver;
    s->memory.tile[id.v] = (struct lw_plan_tile){0};
    s->contributes[id.v] = s->corrected[id.v] = false;
    lw_interest_set_forget(&s->interest, id);
}

/* Due tiles that have gone are due no more. */
void lw_cell_frame_place_tiles(void *solver) {
    struct lw_cell_solver *s = solver;
    uint32_t kept = 0;
    lw_tiles_set_pose(&s->tiles, &s->cells, &s->geometry->pose);
    for (uint32_t i = 0; i < s->due_count; i++)
        if (lw_tiles_have(&s->tiles, s->due[i])) s->due[kept++] = s->due[i];
    s->due_count = kept;
}

static enum lw_status refine(struct frame *f, struct lw_error *err) {
    struct lw_geometry *geometry = f->s->geometry;
    enum lw_status status =
        lw_fine_tiles_update(&geometry->fine, &geometry->pose, geometry->trace, f->number);
    lw_cell_light_charge(&f->light, &f->stats.pose_ns);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "tiles of finer levels");
}

/* ---- plan ---- */

static struct lw_plan_input input_of(const struct lw_cell_solver *s, const struct lw_budget *budget) {
    return (struct lw_plan_input){.fact = s->fact,
                                  .count = s->tiles.count,
                                  .moves = {.moves = s->motion.moves,
                                            .began = s->motion.began,
                                            .light_moves = s->motion.light_moves,
                                            .shone = s->motion.shone},
                                  .budget = *budget,
                                  .everything = s->interest.scope == LW_INTEREST_EVERYTHING,
                                  .looked_at = s->interest.scope != LW_INTEREST_NOTHING,
                                  .bounces = s->tiles.bounces};
}

static void fill_fact(void *user, uint32_t item, struct lw_work_report *report) {
    const struct lw_cell_solver *s = user;
    const struct lw_solve_tile *tile = &s->tiles.tile[item];
    struct lw_plan_fact *fact = &s->fact[item];
    (void)report;
    *fact = (struct lw_plan_fact){.id = tile->id,
                                  .owner = tile->owner,
                                  .object = tile->object,
                                  .covered_count = tile->covered_count,
                                  .sample_count = tile->light.sample_count,
                                  .invalidated_count = tile->change.invalidated_count,
                                  .priority = tile->change.priority,
                                  .importance = lw_interest_set_importance(&s->interest, tile->id),
                                  .level = lw_interest_set_level(&s->interest, tile->id),
                                  .state = (uint8_t)tile->light.state,
                                  .hidden = tile->hidden,
                                  .contributes = s->contributes[tile->id.v],
                                  .invalidated = tile->change.invalidated,
                                  .begins = tile->light.begins,
                                  .corrected = s->corrected[tile->id.v]};
}

static void gather_facts(struct lw_cell_solver *s) {
    lw_work_run(&s->work, s->tiles.count, LW_WORK_CHEAP, NULL, fill_fact, s);
}

static void begin_mark(void *user, uint32_t item, struct lw_work_report *report) {
    const struct lw_cell_solver *s = user;
    const struct lw_solve_tile *tile = &s->tiles.tile[item];
    (void)report;
    s->contributes[tile->id.v] = lw_interest_set_contributes(&s->interest, tile, s->has_probes);
    s->corrected[tile->id.v] = false;
}

struct forecast {
    const struct lw_cell_solver *s;
    struct lw_gradient_round round;
};

static void forecast_tile(void *user, uint32_t item, struct lw_work_report *report) {
    const struct forecast *forecast = user;
    const struct lw_solve_tile *tile = &forecast->s->tiles.tile[item];
    struct lw_plan_fact *fact = &forecast->s->fact[item];
    (void)report;
    if (!fact->contributes) return;
    fact->distance_m = lw_motion_distance(&forecast->s->motion, tile);
    LW_TILES_EACH_BLOCK (tile, block) {
        fact->verify_work += lw_gradient_work(block, &forecast->round);
        fact->correct_work += lw_gradient_work_all(block);
    }
}

static void plan_verify(struct frame *f) {
    struct lw_cell_solver *s = f->s;
    lw_work_run(&s->work, s->tiles.count, LW_WORK_CHEAP, NULL, begin_mark, s);
    gather_facts(s);
    const struct lw_plan_input in = input_of(s, &f->correct.budget);
    struct forecast forecast = {s, lw_plan_round(&s->memory, &in)};
    if (in.budget.limited && in.moves.moves && in.looked_at)
        lw_work_run(&s->work, s->tiles.count, LW_WORK_CHEAP, NULL, forecast_tile, &forecast);
    lw_plan_verify(&s->memory, &in, &s->plan);
    lw_plan_log_stage(s->plan_log, LW_PLAN_STAGE_VERIFY, &in, &s->plan);
}

/* The share of the frame's budget that verification has taken. */
static double spent_share(const struct frame *f) {
    const struct lw_budget *budget = &f->correct.budget;
    if (!budget->limited) return 0;
    return lw_solver_desc_counts(&f->s->desc) ? (double)f->verified / (double)budget->verify
                                              : (double)f->stats.change_ns / (1e9 * f->s->turn.budget);
}

/* The blocks of the tiles that are due; of an invalidated one its invalidated blocks alone. Other tiles have
 * none, and are not looked at: in a big scene they are nearly all. */
static void choose_blocks(struct lw_cell_solver *s) {
    for (uint32_t i = 0; i < s->due_count; i++)
        LW_TILES_EACH_BLOCK (lw_cell_light_due(s, i), block) block->due = false;
    s->due_count = s->plan.solve.count;
    s->own_count = 0;
    for (uint32_t i = 0; i < s->due_count; i++) {
        const struct lw_plan_entry *entry = &s->plan.solve.entry[i];
        s->due[i] = entry->id;
        LW_TILES_EACH_BLOCK (lw_cell_light_due(s, i), block)
            block->due = block->state != LW_BLOCK_CONVERGED &&
                         (!entry->part || lw_gradient_is_strong(&block->change) || !block->sample_count);
        if (!owns(s, entry->id)) continue;
        const lw_tile_id first = s->due[s->own_count];
        s->due[s->own_count++] = entry->id;
        s->due[i] = first;
    }
    LW_INVARIANT(s->own_count <= s->due_count && s->due_count <= s->tiles.count);
}

/* Where nothing is due the pose waits, and with it the probes' rays. */
static enum lw_status plan_light(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    enum lw_status status = LW_OK;
    if (f->verified >= f->correct.budget.verify / VERIFY_RATE_SHARE)
        lw_budget_note(&s->rates.verify_ns, f->verified, f->stats.change_ns, 1.0 / VERIFY_RATE_FRAMES);
    if (s->memory.ended && s->memory.watched) {
        lw_ranks_run(s->desc.ranks, &(struct lw_ranks_exchange){.moment = LW_RANKS_COUNTED,
                                                                .tiles = &s->tiles,
                                                                .count = s->interest.hits,
                                                                .count_size = s->interest.ids});
        lw_interest_set_take_importance(&s->interest, &s->tiles, s->desc.indirect_samples);
    }
    gather_facts(s);
    struct lw_plan_input in = input_of(s, &f->correct.budget);
    in.spent = spent_share(f);
    in.lights_all = s->frames == 0;
    lw_plan_light(&s->memory, &in, &s->plan);
    lw_plan_log_stage(s->plan_log, LW_PLAN_STAGE_LIGHT, &in, &s->plan);
    f->stats.tiles_interest = s->memory.interest;
    f->stats.tiles_contributing = s->memory.contributing;
    f->light.changing = s->plan.changing;
    if (s->plan.solve.count && s->pose_due) status = apply_pose(f, err);
    choose_blocks(s);
    lw_cell_light_charge(&f->light, &f->stats.pose_ns);
    return status;
}

/* ---- verify ---- */

struct verification {
    struct frame *f;
    const struct lw_plan_entry *entry;
};

/* What an entry asks for, of a tile that this rank owns. */
static void carry_out(void *user, uint32_t item, struct lw_work_report *report) {
    const struct verification *v = user;
    const struct lw_plan_entry *entry = &v->entry[item];
    struct lw_cell_solver *s = v->f->s;
    struct lw_solve_tile *tile = lw_tiles_at(&s->tiles, entry->id);
    if (!owns(s, entry->id)) return;
    const struct lw_correct_found found = entry->reason == LW_PLAN_SWEPT
                                              ? lw_correct_all(&v->f->correct, s->motion.moves, tile)
                                              : lw_correct_round(&v->f->correct, &s->plan.round, tile);
    s->corrected[entry->id.v] |= found.corrected;
    report->rays = found.rays;
    report->direct = found.direct;
    report->invalidated = found.invalidated;
}

/* Adds what other ranks have found of those entries, and takes their tiles. */
static void exchange_entries(struct lw_cell_solver *s, const struct lw_plan_entry *entry, uint32_t count,
                             bool found[2]) {
    if (!s->desc.ranks) return;
    for (uint32_t i = 0; i < count; i++) s->exchanged[i] = entry[i].id;
    lw_ranks_run(s->desc.ranks, &(struct lw_ranks_exchange){.moment = LW_RANKS_VERIFIED,
                                                            .tiles = &s->tiles,
                                                            .tile = s->exchanged,
                                                            .tile_count = count,
                                                            .found = found,
                                                            .corrected = s->corrected});
}

/* Carries out `count` entries of a list, and adds up their findings. */
static void run_entries(struct frame *f, const struct lw_plan_entry *entry, uint32_t count,
                        struct lw_plan_found *found) {
    struct verification v = {f, entry};
    const struct lw_work_report report = lw_work_run(&f->s->work, count, LW_WORK_TILES, NULL, carry_out, &v);
    bool flags[] = {report.direct, report.invalidated};
    exchange_entries(f->s, entry, count, flags);
    add_rays(f, &report);
    found->direct |= flags[0];
    found->invalidated |= flags[1];
}

static void verify(struct frame *f) {
    struct lw_cell_solver *s = f->s;
    const struct lw_plan *plan = &s->plan;
    const struct lw_plan_input in = input_of(s, &f->correct.budget);
    struct lw_plan_found found = {.verified = plan->verify_sure}, swept = {0};
    run_entries(f, plan->verify.entry, plan->verify_sure, &found);
    f->verified = plan->verify_work[0] + plan->correct_work;
    if (!found.invalidated) {
        run_entries(f, plan->verify.entry + plan->verify_sure, plan->verify.count - plan->verify_sure,
                    &found);
        f->verified += plan->verify_work[1];
        found.verified = plan->verify.count;
    }
    lw_plan_note_verified(&s->memory, &in, plan, &found);
    lw_plan_log_found(s->plan_log, &found);
    run_entries(f, plan->correct.entry, plan->correct.count, &swept);
    lw_cell_light_charge(&f->light, &f->stats.change_ns);
}

bool lw_cell_frame_is_behind(const struct lw_cell_solver *s) {
    const struct lw_plan_input in = {.fact = s->fact, .count = s->tiles.count};
    return s->motion.shone && lw_plan_is_behind(&s->memory, &in);
}

/* ---- light ---- */

static void weigh_tile(void *user, uint32_t item, struct lw_work_report *report) {
    const struct frame *f = user;
    report->rays = lw_correct_due(&f->correct, f->s->motion.moves, lw_cell_light_due(f->s, item)).rays;
}

/* After apply_pose(): its new materials were verified before. */
static void weigh(struct frame *f) {
    struct lw_cell_solver *s = f->s;
    for (uint32_t bounce = 0; bounce < s->desc.bounces; bounce++)
        memset(s->tiles.radiance_change[bounce], 0,
               (size_t)s->tiles.block_capacity * LW_REGIONS * sizeof(struct lw_vec3));
    const struct lw_work_report report =
        lw_work_run(&s->work, s->own_count, LW_WORK_TILES, NULL, weigh_tile, f);
    add_rays(f, &report);
    exchange_due(f, LW_RANKS_WEIGHED);
}

static void radiate_corrected_tile(void *user, uint32_t item, struct lw_work_report *report) {
    const struct frame *f = user;
    const struct lw_solve_tile *tile = &f->s->tiles.tile[item];
    (void)report;
    if (!f->s->corrected[tile->id.v]) return;
    for (uint32_t bounce = 0; bounce < f->s->tiles.bounces; bounce++)
        lw_bounces_radiate(&f->transport, tile, bounce);
}

/* What corrected tiles reflect is sent out again, whether anything is solved or not. */
static enum lw_status light(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    if (s->due_count) weigh(f);
    lw_work_run(&s->work, s->tiles.count, LW_WORK_TILES, NULL, radiate_corrected_tile, f);
    lw_cell_light_charge(&f->light, &f->stats.change_ns);
    return s->due_count ? lw_cell_light_run(&f->light, err) : LW_OK;
}

/* ---- show ---- */

static void finish_tile(void *user, uint32_t item, struct lw_work_report *report) {
    const struct frame *f = user;
    struct lw_solve_tile *tile = lw_cell_light_due(f->s, item);
    (void)report;
    lw_estimates_finish_tile(&f->transport, tile);
}

/* Shows the blocks of a tile that were solved in this frame, or before and not shown. */
static void show_tile(void *user, uint32_t item, struct lw_work_report *report) {
    const struct frame *f = user;
    const struct lw_cell_solver *s = f->s;
    struct lw_solve_tile *tile = &s->tiles.tile[item];
    const struct lw_plan_tile *planned = &s->memory.tile[tile->id.v];
    LW_TILES_EACH_BLOCK (tile, block) {
        block->unseen |= planned->work && block->due && block->covered_count;
        if (!(block->unseen && planned->shows) &&
            !(s->shown.all && block->covered_count && block->sample_count))
            continue;
        block->unseen = tile->light.begins = false;
        block->shown_frame = tile->light.solved_frame = f->number;
    }
    report->tiles = tile->light.solved_frame == f->number;
}

static bool has_unseen(const struct lw_solve_tile *tile) {
    LW_TILES_EACH_BLOCK (tile, block)
        if (block->unseen) return true;
    return false;
}

/* Blocks are looked at where a plan may ask: they are many, and far apart in memory. */
static void fill_unseen(void *user, uint32_t item, struct lw_work_report *report) {
    const struct lw_cell_solver *s = user;
    struct lw_plan_fact *fact = &s->fact[item];
    (void)report;
    fact->unseen = (s->memory.sweep_ended || fact->corrected) && has_unseen(&s->tiles.tile[item]);
}

static enum lw_status filter_and_weld(struct frame *f, struct lw_error *err) {
    struct lw_cell_solver *s = f->s;
    lw_work_run(&s->work, s->own_count, LW_WORK_TILES, NULL, finish_tile, f);
    if (s->due_count) exchange_due(f, LW_RANKS_LIT);
    gather_facts(s);
    lw_work_run(&s->work, s->tiles.count, LW_WORK_CHEAP, NULL, fill_unseen, s);
    struct lw_plan_input in = input_of(s, &f->correct.budget);
    in.awaited = s->desc.awaited && *s->desc.awaited && s->frames > 0;
    lw_plan_show(&s->memory, &in, &s->plan);
    lw_plan_log_stage(s->plan_log, LW_PLAN_STAGE_SHOW, &in, &s->plan);
    f->stats.tiles_shown = lw_work_run(&s->work, s->tiles.count, LW_WORK_CHEAP, NULL, show_tile, f).tiles;
    s->shown.all = false;
    f->light.began_ns = lw_clock_ns();
    if (!f->stats.tiles_shown) {
        lw_fine_tiles_fill(&s->geometry->fine, &s->tiles, f->number, false, s->shown.channels);
        return LW_OK;
    }
    lw_shown_filter(&s->shown, f->number);
    lw_cell_light_charge(&f->light, &f->stats.denoise_ns);
    enum lw_status status = lw_shown_weld(&s->shown, f->number, err);
    lw_fine_tiles_fill(&s->geometry->fine, &s->tiles, f->number, true, s->shown.channels);
    lw_cell_light_charge(&f->light, &f->stats.weld_ns);
    return status;
}

/* ---- note ---- */

/* Blocks whose error is low enough stay converged until their light changes. */
static void update_convergence(void *user, uint32_t item, struct lw_work_report *report) {
    const struct frame *f = user;
    const struct lw_converged converged = f->correct.converged;
    struct lw_solve_tile *tile = lw_cell_light_due(f->s, item);
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!block->due || !block->covered_count) continue;
        report->texels += block->covered_count;
        block->state = lw_converged_is(&converged, block)                     ? LW_BLOCK_CONVERGED
                       : lw_gradient_is_stale(block, f->s->desc.target_error) ? LW_BLOCK_STALE
                                                                              : LW_BLOCK_SAMPLED;
        if (block->state == LW_BLOCK_CONVERGED) block->change.strength = 0;
    }
    lw_correct_sum(tile);
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

static void count_tile(void *user, uint32_t item, struct lw_work_report *report) {
    const struct frame *f = user;
    const struct lw_converged *converged = &f->correct.converged;
    const struct lw_solve_tile *tile = &f->s->tiles.tile[item];
    report->tiles = tile->light.state == LW_BLOCK_CONVERGED;
    if (tile->light.state == LW_BLOCK_CONVERGED) return;
    LW_TILES_EACH_BLOCK (tile, block)
        if (!lw_converged_may(converged, tile, block))
            report->texels_left += frames_left(converged, block) * (double)block->covered_count;
}

static void note(struct frame *f) {
    struct lw_cell_solver *s = f->s;
    struct lw_solver_stats *stats = &f->stats;
    stats->texels_solved =
        lw_work_run(&s->work, s->due_count, LW_WORK_CHEAP, NULL, update_convergence, f).texels;
    const struct lw_work_report all =
        lw_work_run(&s->work, s->tiles.count, LW_WORK_CHEAP, NULL, count_tile, f);
    stats->tiles = s->tiles.count;
    stats->tiles_fine = s->geometry->fine.used;
    stats->tiles_fine_wanted = s->geometry->fine.wanted_count;
    stats->tiles_solved = s->due_count;
    stats->tiles_converged = all.tiles;
    stats->texels_left = all.texels_left;
    if (!s->due_count) return;
    const uint64_t work = stats->texels_solved * LW_BUDGET_SOLVE,
                   took_ns = stats->direct_ns + stats->scatter_ns;
    lw_progress_finish(&s->progress);
    lw_budget_note(&s->rates.solve_ns, work, took_ns, 1.0 / SOLVE_RATE_FRAMES);
    s->since_listing += lw_solver_desc_counts(&s->desc) ? work : took_ns;
    s->frames++;
}

/* ---- the frame ---- */

enum lw_status lw_cell_frame_run(struct lw_cell_solver *s, const struct lw_pose *is, uint64_t number,
                                 struct lw_solver_stats *out_stats, struct lw_error *err) {
    struct frame f = {.s = s, .pose = is, .number = number, .transport = lw_cell_frame_transport(s)};
    f.correct = (struct lw_correct){.passes = &f.transport,
                                    .converged = lw_cell_data_converged(s),
                                    .budget = budget_of(s),
                                    .filtered = s->desc.denoise};
    f.light = (struct lw_cell_light){
        .s = s, .transport = &f.transport, .stats = &f.stats, .began_ns = lw_clock_ns()};
    lw_plan_log_frame(s->plan_log, number);
    enum lw_status status = pose(&f, err);
    if (status == LW_OK) status = refine(&f, err);
    if (status != LW_OK) return status;
    plan_verify(&f);
    lw_cell_light_charge(&f.light, &f.stats.pose_ns);
    verify(&f);
    if (s->desc.cancel && *s->desc.cancel) return LW_CLOSED;
    if ((status = plan_light(&f, err)) != LW_OK || (status = light(&f, err)) != LW_OK ||
        (status = filter_and_weld(&f, err)) != LW_OK)
        return status;
    note(&f);
    *out_stats = f.stats;
    return LW_OK;
}
