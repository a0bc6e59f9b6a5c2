#include "server/solve/cell_light.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "server/solve/adapt/verify.h"
#include "server/solve/transport/bounces.h"
#include "server/solve/transport/direct_light.h"

#include <math.h>

/* Listing reflectors may take this share of the time that rays and sums take. */
#define LISTING_SHARE 0.05
/* Texels of a scene that listing looks at in the time in which one is solved. */
#define LISTING_TEXELS 256u

void lw_cell_light_charge(struct lw_cell_light *light, uint64_t *field_ns) {
    const uint64_t now_ns = lw_clock_ns();
    *field_ns += now_ns - light->began_ns;
    light->began_ns = now_ns;
}

/* ---- reflectors ---- */

/* Rays are traced again to those of the last frame that solved something. A block that it left alone may find
 * another list than its own, and so some noise in its changes. */
enum lw_status lw_cell_light_list_reflectors(struct lw_cell_solver *s, struct lw_error *err) {
    if (!s->desc.bounces) return LW_OK;
    enum lw_status status = lw_reflectors_update(&s->reflectors, &s->tiles, &s->pose);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "listing what shines by reflected light");
}

/* A list that is a little old costs noise, not light: in a big scene, whose frames solve little of it,
 * listing takes its share of the time and no more. The first frame looks at every texel. */
static enum lw_status list_reflectors_in_time(struct lw_cell_solver *s, struct lw_error *err) {
    if (lw_solver_desc_is_limited(&s->desc) && (double)s->listing > LISTING_SHARE * (double)s->since_listing)
        return LW_OK;
    const uint64_t began_ns = lw_clock_ns();
    enum lw_status status = lw_cell_light_list_reflectors(s, err);
    s->listing = !s->frames                        ? 0
                 : lw_solver_desc_counts(&s->desc) ? s->tiles.texel_count / LISTING_TEXELS * LW_BUDGET_UNIT
                                                   : lw_clock_ns() - began_ns;
    s->since_listing = 0;
    return status;
}

/* ---- probes ---- */

/* The frames for which probes may remember, that many frames after a movement. */
static uint32_t probe_history_max(const struct lw_cell_solver *s) {
    return s->motion.moves ? LW_CELL_LAYER_HISTORY_PROBES - 1 + s->motion.frames_since_move / 2 : UINT32_MAX;
}

/* While remembered light from before a movement may still show. */
static bool is_fading(const struct lw_cell_solver *s) {
    return s->motion.moves && s->motion.frames_since_move < LW_CELL_LAYER_FADE_FRAMES;
}

static void gather_probes(struct lw_cell_light *light) {
    struct lw_cell_solver *s = light->s;
    const struct lw_wall_sides sides = lw_geometry_sides(s->geometry);
    light->stats->rays_probe += lw_probes_gather(&s->probes, &sides, s->frames, is_fading(s), s->threads);
    lw_cell_light_charge(light, &light->stats->probe_ns);
}

static void project_probes(struct lw_cell_light *light, uint32_t bounce) {
    struct lw_cell_solver *s = light->s;
    lw_probes_project(&s->probes, bounce, s->tiles.radiance[bounce], probe_history_max(s), s->threads);
    lw_cell_light_charge(light, &light->stats->probe_ns);
}

/* ---- passes over the due tiles ---- */

struct pass {
    const struct lw_cell_light *light;
    uint32_t bounce;
};

static void solve_direct(void *user, uint32_t item, struct lw_work_report *report) {
    const struct pass *pass = user;
    lw_direct_light_solve(pass->light->transport, lw_cell_light_due(pass->light->s, item), &report->rays);
}

static void radiate(void *user, uint32_t item, struct lw_work_report *report) {
    const struct pass *pass = user;
    (void)report;
    lw_bounces_radiate(pass->light->transport, lw_cell_light_due(pass->light->s, item), pass->bounce);
}

/* Light of earlier frames follows what direct light is now; along rays that new ones are about to take the
 * place of. */
static void reread(void *user, uint32_t item, struct lw_work_report *report) {
    const struct pass *pass = user;
    (void)report;
    lw_verify_reread(pass->light->transport, lw_cell_light_due(pass->light->s, item));
}

static void trace_bounces(void *user, uint32_t item, struct lw_work_report *report) {
    const struct pass *pass = user;
    struct lw_cell_solver *s = pass->light->s;
    const struct lw_solve_tile *tile = lw_cell_light_due(s, item);
    lw_bounces_trace(pass->light->transport, tile, &report->rays);
    lw_interest_set_note_hits(&s->interest, pass->light->transport, tile, s->memory.round,
                              s->memory.tile[tile->id.v].weight);
}

/* With which weight this frame's estimates of bounces enter their means. */
static void weigh_indirect(void *user, uint32_t item, struct lw_work_report *report) {
    const struct pass *pass = user;
    const struct lw_cell_solver *s = pass->light->s;
    const float most = s->has_probes ? (float)probe_history_max(s) : INFINITY;
    (void)report;
    LW_TILES_EACH_BLOCK (lw_cell_light_due(s, item), block)
        if (block->due) lw_gradient_weigh_indirect(block, most, s->desc.denoise);
}

static void gather(void *user, uint32_t item, struct lw_work_report *report) {
    const struct pass *pass = user;
    (void)report;
    lw_bounces_gather(pass->light->transport, lw_cell_light_due(pass->light->s, item), pass->bounce);
}

/* Bounces from the second on change only now. */
static void add_indirect_change(void *user, uint32_t item, struct lw_work_report *report) {
    const struct pass *pass = user;
    (void)report;
    lw_verify_add_indirect_change(pass->light->transport, lw_cell_light_due(pass->light->s, item));
}

enum pass_kind { PASS_QUIET, PASS_STEPS };

static struct lw_ray_count run_pass(const struct lw_cell_light *light, enum lw_work_kind kind,
                                    enum pass_kind steps, lw_work_fn *fn, uint32_t bounce) {
    struct lw_cell_solver *s = light->s;
    struct pass pass = {light, bounce};
    return lw_work_run(&s->work, s->own_count, kind, steps == PASS_STEPS ? &s->progress : NULL, fn, &pass)
        .rays;
}

/* A step is a tile in a pass over all that are due. Shown of the first frame, which may be long, and while
 * somebody waits for the end of one. */
static void begin_progress(struct lw_cell_solver *s) {
    static const _Atomic bool never = false;
    const uint32_t passes = 1 + (s->desc.bounces ? 1 + s->desc.bounces : 0);
    const uint64_t steps = (uint64_t)s->own_count * passes;
    if (!s->frames) {
        lw_progress_init_waiting(&s->progress, "lighting the first frame", steps, s->desc.waiting,
                                 LW_WAITING_FIRST_LIGHT);
        return;
    }
    lw_progress_init(&s->progress, "finishing the samples under way", steps);
    s->progress.wanted = s->desc.finishing ? s->desc.finishing : &never;
}

/* What the due tiles send out, of all ranks. */
static void run_radiate(const struct lw_cell_light *light, uint32_t bounce) {
    struct lw_cell_solver *s = light->s;
    run_pass(light, LW_WORK_CHEAP, PASS_QUIET, radiate, bounce);
    lw_ranks_run(s->desc.ranks, &(struct lw_ranks_exchange){.moment = LW_RANKS_RADIATED,
                                                            .tiles = &s->tiles,
                                                            .tile = s->due,
                                                            .tile_count = s->due_count,
                                                            .bounce = bounce});
}

static void run_direct(struct lw_cell_light *light) {
    light->stats->rays_shadow += run_pass(light, LW_WORK_TILES, PASS_STEPS, solve_direct, 0).shadow;
    if (light->s->desc.bounces) run_radiate(light, 0);
    lw_cell_light_charge(light, &light->stats->direct_ns);
}

static void run_bounces(struct lw_cell_light *light) {
    struct lw_cell_solver *s = light->s;
    if (s->desc.bounces && light->changing) run_pass(light, LW_WORK_TILES, PASS_QUIET, reread, 0);
    if (s->desc.bounces) {
        const struct lw_ray_count rays = run_pass(light, LW_WORK_TILES, PASS_STEPS, trace_bounces, 0);
        light->stats->rays_bounce += rays.bounce;
        light->stats->rays_shadow += rays.shadow;
    }
    run_pass(light, LW_WORK_CHEAP, PASS_QUIET, weigh_indirect, 0);
    lw_cell_light_charge(light, &light->stats->scatter_ns);
    if (s->has_probes) gather_probes(light);
    for (uint32_t bounce = 1; bounce <= s->desc.bounces; bounce++) {
        if (s->has_probes) project_probes(light, bounce - 1);
        run_pass(light, LW_WORK_TILES, PASS_STEPS, gather, bounce);
        if (bounce < s->desc.bounces) run_radiate(light, bounce);
        lw_cell_light_charge(light, &light->stats->scatter_ns);
    }
    if (s->desc.bounces > 1 && light->changing)
        run_pass(light, LW_WORK_TILES, PASS_QUIET, add_indirect_change, 0);
}

enum lw_status lw_cell_light_run(struct lw_cell_light *light, struct lw_error *err) {
    struct lw_cell_solver *s = light->s;
    LW_INVARIANT(s->due_count > 0 && s->pose_due == 0); /* rays run in the pose that is lit */
    begin_progress(s);
    run_direct(light);
    enum lw_status status = list_reflectors_in_time(s, err);
    lw_cell_light_charge(light, &light->stats->pose_ns);
    if (status != LW_OK) return status;
    run_bounces(light);
    if (!s->desc.cancel || !*s->desc.cancel) return LW_OK;
    lw_progress_stop(&s->progress);
    return LW_CLOSED;
}
