#include "server/solve/adapt/plan.h"

#include "common/base/invariant.h"
#include "common/base/random.h"
#include "server/solve/adapt/interest_set.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

/* Shares of a budget. Verification takes VERIFY_SHARE in any case, and SEARCH_SHARE while it has found no
 * change. Correction takes SWEEP_SHARE while lights keep moving. At least SOLVE_SHARE is left for solving. */
#define VERIFY_SHARE 0.5
#define SEARCH_SHARE 1.0
#define SWEEP_SHARE  0.5
#define SOLVE_SHARE  0.5
/* After this many rounds without a stale block, what the last one lights has followed. */
#define CHANGING_ROUNDS 2u
/* The share of a tile's importance that its own ray hits get: less with every bounce, as albedos. */
#define PASSED_ON  0.5f
#define WEIGHT_MAX UINT16_MAX
/* Log2 of the longest period of levels of interest; coarser levels are solved as often. */
#define PERIOD_LOG_MAX 3u
/* Mean square of the share of light that has changed: for as many texels it is the most to see. */
#define MOST 0.25f
#define MORE 0.0625f

enum lw_status lw_plan_init(struct lw_plan *plan, uint32_t tiles) {
    struct lw_plan_list *list[] = {&plan->verify, &plan->correct, &plan->solve, &plan->show};
    bool ok = true;
    *plan = (struct lw_plan){.capacity = tiles};
    for (size_t i = 0; i < sizeof list / sizeof *list; i++)
        ok &= (list[i]->entry = malloc((tiles + 1ul) * sizeof *list[i]->entry)) != NULL;
    ok &= (plan->order = malloc((tiles + 1ul) * sizeof *plan->order)) != NULL;
    return ok ? LW_OK : LW_NO_MEMORY;
}

void lw_plan_finish(struct lw_plan *plan) {
    free(plan->verify.entry);
    free(plan->correct.entry);
    free(plan->solve.entry);
    free(plan->show.entry);
    free(plan->order);
    *plan = (struct lw_plan){0};
}

enum lw_status lw_plan_memory_init(struct lw_plan_memory *memory, uint32_t ids) {
    *memory =
        (struct lw_plan_memory){.ids = ids, .ended = true, .tile = calloc(ids + 1ul, sizeof *memory->tile)};
    return memory->tile ? LW_OK : LW_NO_MEMORY;
}

void lw_plan_memory_finish(struct lw_plan_memory *memory) {
    free(memory->tile);
    *memory = (struct lw_plan_memory){0};
}

size_t lw_plan_bytes(uint32_t tiles, uint32_t ids) {
    return tiles * (4 * sizeof(struct lw_plan_entry) + sizeof(struct lw_plan_order)) +
           ids * sizeof(struct lw_plan_tile);
}

const char *lw_plan_reason_name(enum lw_plan_reason reason) {
    static const char *const names[] = {
#define LW_PLAN_REASON(name, text) text,
        LW_PLAN_REASONS(LW_PLAN_REASON)
#undef LW_PLAN_REASON
    };
    LW_INVARIANT(reason < LW_PLAN_REASON_COUNT);
    return names[reason];
}

static bool are_facts(const struct lw_plan_memory *memory, const struct lw_plan_input *in) {
    for (uint32_t i = 0; i < in->count; i++)
        if (in->fact[i].id.v >= memory->ids || in->fact[i].invalidated_count > in->fact[i].covered_count)
            return false;
    return true;
}

static void add(struct lw_plan_list *list, lw_tile_id id, enum lw_plan_reason reason, bool part) {
    list->entry[list->count++] = (struct lw_plan_entry){id, (uint8_t)reason, part};
}

/* ---- verify and correct ---- */

void lw_plan_note_move(struct lw_plan_memory *memory) {
    for (uint32_t id = 0; id < memory->ids; id++) memory->tile[id].unverified = true;
}

void lw_plan_resume(struct lw_plan_memory *memory) { memory->unchanged_rounds = CHANGING_ROUNDS + 1; }

void lw_plan_review(struct lw_plan_memory *memory) { memory->still_rounds = 0; }

bool lw_plan_is_behind(const struct lw_plan_memory *memory, const struct lw_plan_input *in) {
    for (uint32_t i = 0; i < in->count; i++)
        if (memory->tile[in->fact[i].id.v].unverified && in->fact[i].contributes && in->fact[i].level)
            return true;
    return false;
}

struct lw_gradient_round lw_plan_round(const struct lw_plan_memory *memory, const struct lw_plan_input *in) {
    return (struct lw_gradient_round){.moves = in->moves.moves,
                                      .began = in->moves.began,
                                      .light_moves = in->moves.light_moves,
                                      .tick = memory->round,
                                      .turn = memory->ended,
                                      /* not all were verified */
                                      .active = memory->still_rounds <= LW_PACKETS_MAX,
                                      .spreads = lw_budget_is_at_once(&in->budget) && memory->rereads > 0 &&
                                                 !lw_plan_is_behind(memory, in),
                                      .budget = in->budget};
}

static int compare_orders(const void *a, const void *b) {
    const struct lw_plan_order *x = a, *y = b;
    return x->rank != y->rank ? (x->rank > y->rank) - (x->rank < y->rank)
                              : (x->slot > y->slot) - (x->slot < y->slot);
}

/* Orders tiles of interest before their contributors, and tiles near a movement before tiles far from it. The
 * order stays where all may be verified, or none has to be. */
static void order_tiles(const struct lw_plan_memory *memory, const struct lw_plan_input *in,
                        struct lw_plan_order *order) {
    bool any = false;
    for (uint32_t i = 0; in->budget.limited && i < in->count; i++)
        any |= in->fact[i].contributes && memory->tile[in->fact[i].id.v].unverified;
    for (uint32_t i = 0; i < in->count; i++) {
        const struct lw_plan_fact *fact = &in->fact[i];
        order[i].slot = i;
        order[i].rank = any ? fact->distance_m + (fact->level ? 0 : FLT_MAX / 2) : 0;
    }
    if (any) qsort(order, in->count, sizeof *order, compare_orders);
}

/* Lists the tiles whose work, with the work of all unverified tiles before them, lies above `more` and up to
 * `most`, and the first tile in any case. first: also tiles that are not unverified. Returns the work. */
static uint64_t list_unverified(const struct lw_plan_memory *memory, const struct lw_plan_input *in,
                                struct lw_plan *plan, double more, double most, bool first) {
    uint64_t sum = 0, work = 0;
    for (uint32_t i = 0; i < in->count; i++) {
        const struct lw_plan_fact *fact = &in->fact[plan->order[i].slot];
        const bool unverified = memory->tile[fact->id.v].unverified, leads = sum == 0;
        if (!fact->contributes || !(unverified || first)) continue;
        if (unverified && in->budget.limited) {
            sum += fact->verify_work;
            const bool fits = (double)sum <= most || leads, before = (double)sum <= more || leads;
            if (!fits || (!first && before)) continue;
        }
        work += fact->verify_work;
        add(&plan->verify, fact->id, unverified ? LW_PLAN_MOVED : LW_PLAN_TURN, false);
    }
    return work;
}

/* At an onset of light direct light changes everywhere: all packets are verified about it, and it need not be
 * solved. Else there should be time to solve the changes found. */
static void plan_verify(const struct lw_plan_memory *memory, const struct lw_plan_input *in,
                        struct lw_plan *plan) {
    const bool verifies_all = in->budget.onset && in->moves.shone;
    const double most = SEARCH_SHARE * (double)in->budget.verify,
                 sure = verifies_all ? most : VERIFY_SHARE * (double)in->budget.verify;
    plan->round = lw_plan_round(memory, in);
    order_tiles(memory, in, plan->order);
    plan->verify_work[0] = list_unverified(memory, in, plan, 0, floor(sure), true);
    plan->verify_sure = plan->verify.count;
    if (in->budget.limited && sure < most)
        plan->verify_work[1] = list_unverified(memory, in, plan, floor(sure), floor(most), false);
}

/* A round is too long to wait for while lights keep moving. A share of each frame goes on through the
 * interest set, until all of it has been corrected since the last movement; at least one tile a frame. */
static void plan_correct(struct lw_plan_memory *memory, const struct lw_plan_input *in,
                         struct lw_plan *plan) {
    const uint64_t most = (uint64_t)(SWEEP_SHARE * (double)in->budget.verify);
    uint32_t i = memory->swept;
    if (lw_budget_is_at_once(&in->budget)) /* all are verified at once, or solved */
        memory->sweep_moves = in->moves.light_moves;
    if (i == 0 && memory->sweep_moves == in->moves.light_moves) return;
    if (i == 0) memory->sweep_moves = in->moves.light_moves;
    for (; i < in->count; i++) {
        const struct lw_plan_fact *fact = &in->fact[i];
        if (!fact->contributes || !fact->level) continue;
        if (plan->correct_work && plan->correct_work + fact->correct_work > most) break;
        plan->correct_work += fact->correct_work;
        add(&plan->correct, fact->id, LW_PLAN_SWEPT, false);
    }
    memory->sweep_ended = i >= in->count;
    memory->swept = memory->sweep_ended ? 0 : i;
}

void lw_plan_verify(struct lw_plan_memory *memory, const struct lw_plan_input *in, struct lw_plan *plan) {
    LW_INVARIANT(in->count <= plan->capacity);
    LW_INVARIANT_DEAR(are_facts(memory, in));
    plan->verify.count = plan->correct.count = plan->verify_sure = 0;
    plan->verify_work[0] = plan->verify_work[1] = plan->correct_work = 0;
    if (!in->moves.moves || !in->looked_at) return;
    memory->sweep_ended = false;
    plan_verify(memory, in, plan);
    plan_correct(memory, in, plan);
    LW_INVARIANT(plan->verify_sure <= plan->verify.count && plan->verify.count <= in->count);
    LW_INVARIANT(memory->swept < in->count || memory->swept == 0);
}

void lw_plan_note_verified(struct lw_plan_memory *memory, const struct lw_plan_input *in,
                           const struct lw_plan *plan, const struct lw_plan_found *found) {
    if (!in->moves.moves || !in->looked_at) return;
    LW_INVARIANT(found->verified <= plan->verify.count);
    for (uint32_t i = 0; i < found->verified; i++)
        memory->tile[plan->verify.entry[i].id.v].unverified = false;
    /* As many as there are bounces, once direct light has changed, and again once nothing invalidated is left
     * to solve. */
    memory->solved_changed |= memory->changed_solves > 0;
    if (found->direct || (memory->solved_changed && !memory->rereads && !memory->changed_left)) {
        memory->rereads = in->bounces;
        memory->solved_changed = false;
    } else if (plan->round.spreads) {
        LW_INVARIANT(memory->rereads > 0);
        memory->rereads--;
    }
}

/* ---- rounds ---- */

/* Frames from one solve of a contributor to the next. */
static uint32_t contributor_period(float importance) {
    return importance >= 2 ? 2 : importance >= 0.5f ? 4 : importance >= 0.125f ? 8 : LW_PLAN_PERIOD_MAX;
}

/* What its rays count for, when it is solved once in `period` frames: in the mean its own importance.
 * (Counted for more, tiles of no interest would keep each other important.) */
static uint16_t contributor_weight(float importance, uint32_t period) {
    return (uint16_t)fminf(PASSED_ON * importance * (float)(LW_INTEREST_WEIGHT * period), WEIGHT_MAX);
}

/* Where tiles of one period would all be due at once, some are each frame; but one that is too old is at
 * once. */
static bool is_turn(const struct lw_plan_memory *memory, lw_tile_id id, uint32_t period) {
    return memory->round - memory->tile[id.v].solved_round >= period ||
           ((memory->round + lw_random_hash(id.v)) & (period - 1)) == 0;
}

/* A contributor is seen in coarse levels alone, which may be old. It is shown in one of LW_PLAN_PERIOD_MAX
 * frames, all of an object at once, so that welded tiles show together. */
static bool shows_contributors(const struct lw_plan_memory *memory, uint32_t object) {
    return ((memory->round + lw_random_hash(object)) & (LW_PLAN_PERIOD_MAX - 1)) == 0;
}

/* Whether a tile of interest has not converged, or a contributor is stale. */
static bool is_watched(const struct lw_plan_input *in) {
    for (uint32_t i = 0; !in->everything && i < in->count; i++) {
        const struct lw_plan_fact *fact = &in->fact[i];
        if (fact->state != LW_BLOCK_CONVERGED &&
            (fact->level || (fact->state == LW_BLOCK_STALE && fact->contributes)))
            return true;
    }
    return false;
}

/* Rounds until a tile that is to be solved is solved again; 0: it neither is of interest nor contributes. */
static uint32_t period_of(const struct lw_plan_memory *memory, const struct lw_plan_input *in,
                          const struct lw_plan_fact *fact) {
    if (in->everything) return 1;
    if (fact->level) return 1u << (fact->level - 1u < PERIOD_LOG_MAX ? fact->level - 1u : PERIOD_LOG_MAX);
    return memory->watched && fact->contributes ? contributor_period(fact->importance) : 0;
}

/* Rounds that take many frames must not delay a stale tile by as many frames each. */
static uint32_t hurry(const struct lw_plan_memory *memory, const struct lw_plan_fact *fact, uint32_t period) {
    while (fact->state == LW_BLOCK_STALE && period > 1 && period * memory->frames > LW_PLAN_PERIOD_MAX)
        period /= 2;
    return period;
}

static void begin_round(struct lw_plan_memory *memory, const struct lw_plan_input *in) {
    memory->round++;
    memory->interest = memory->contributing = 0;
    memory->watched = is_watched(in);
    for (uint32_t i = 0; i < in->count; i++) {
        const struct lw_plan_fact *fact = &in->fact[i];
        struct lw_plan_tile *tile = &memory->tile[fact->id.v];
        const uint32_t period = period_of(memory, in, fact);
        tile->weight = !memory->watched ? 0
                       : fact->level    ? LW_INTEREST_WEIGHT
                       : period         ? contributor_weight(fact->importance, period)
                                        : 0;
        if (!fact->covered_count) continue;
        memory->interest += fact->level != 0;
        memory->contributing += !fact->level && period;
        tile->waiting =
            fact->state != LW_BLOCK_CONVERGED &&
            (fact->sample_count == 0 || (period && is_turn(memory, fact->id, hurry(memory, fact, period))));
    }
    memory->frames = 0;
}

/* ---- solve ---- */

static enum lw_plan_reason reason_of(const struct lw_plan_fact *fact) {
    if (!fact->invalidated) return fact->state == LW_BLOCK_STALE ? LW_PLAN_STALE : LW_PLAN_NOISY;
    if (!(fact->priority > 0)) return LW_PLAN_STALE;
    if (!fact->level) return LW_PLAN_CHANGED_BESIDE;
    return fact->priority >= MOST   ? LW_PLAN_CHANGED_MOST
           : fact->priority >= MORE ? LW_PLAN_CHANGED_MORE
                                    : LW_PLAN_CHANGED_LESS;
}

/* Texels that a frame solves, about. */
struct room {
    uint64_t changed; /* in invalidated blocks */
    uint64_t all;     /* with what else waits */
};

/* Until all tiles are verified after an onset, invalidated blocks alone are solved. */
static struct room room_of(const struct lw_plan_memory *memory, const struct lw_plan_input *in) {
    if (!in->budget.limited || in->lights_all) return (struct room){UINT64_MAX, UINT64_MAX};
    const double left = fmax(1 - in->spent, SOLVE_SHARE);
    const uint64_t texels = 1 + (uint64_t)(left * (double)in->budget.solve) / LW_BUDGET_SOLVE;
    bool waits = in->budget.yields;
    for (uint32_t i = 0; i < in->count && in->budget.onset && in->moves.moves && !waits; i++)
        waits = in->fact[i].contributes && memory->tile[in->fact[i].id.v].unverified;
    return (struct room){in->budget.yields ? 0 : texels, waits ? 0 : texels};
}

/* Takes the waiting tiles of a reason, up to `texels` texels. It takes the invalidated blocks alone of
 * invalidated tiles, if time is short. */
static void take_waiting(struct lw_plan_memory *memory, const struct lw_plan_input *in, struct lw_plan *plan,
                         enum lw_plan_reason reason, uint64_t texels, uint64_t *taken) {
    const bool part = reason < LW_PLAN_STALE && texels != UINT64_MAX;
    for (uint32_t i = 0; texels && i < in->count; i++) {
        const struct lw_plan_fact *fact = &in->fact[i];
        struct lw_plan_tile *tile = &memory->tile[fact->id.v];
        if (!(tile->waiting || fact->invalidated) || fact->state == LW_BLOCK_CONVERGED ||
            reason_of(fact) != reason)
            continue;
        const uint32_t count = part ? fact->invalidated_count : fact->covered_count;
        if (*taken && *taken + count > texels) continue;
        tile->work = part ? LW_TILE_WORK_INVALIDATED : LW_TILE_WORK_ALL;
        tile->solved_round = memory->round;
        add(&plan->solve, fact->id, reason, part);
        *taken += count;
    }
    LW_INVARIANT(plan->solve.count <= in->count);
}

/* Notes whether the round has ended, and how strong the changes are that remain. */
static void note_left(struct lw_plan_memory *memory, const struct lw_plan_input *in) {
    memory->ended = true;
    memory->changed_left = memory->changed_solves = 0;
    for (uint32_t i = 0; i < in->count; i++) {
        const struct lw_plan_fact *fact = &in->fact[i];
        struct lw_plan_tile *tile = &memory->tile[fact->id.v];
        const bool changed = fact->invalidated && !tile->work && fact->state != LW_BLOCK_CONVERGED;
        /* a tile may converge while it waits, as when its blocks are judged again after a movement */
        tile->waiting &= tile->work != LW_TILE_WORK_ALL && fact->state != LW_BLOCK_CONVERGED;
        memory->ended &= !tile->waiting && !changed;
        memory->changed_solves += tile->work == LW_TILE_WORK_INVALIDATED;
        if (changed && LW_PLAN_STALE - reason_of(fact) > memory->changed_left)
            memory->changed_left = LW_PLAN_STALE - reason_of(fact);
    }
}

/* Chooses the tiles that show their solved light. Once all has converged, all may be seen. */
static void choose_shown(struct lw_plan_memory *memory, const struct lw_plan_input *in, bool solves) {
    const bool whole = memory->ended || (memory->deferred && !memory->changed_solves);
    memory->released = memory->deferred && whole;
    memory->deferred &= !whole;
    LW_INVARIANT(!(memory->released && memory->deferred));
    for (uint32_t i = 0; i < in->count; i++) {
        const struct lw_plan_fact *fact = &in->fact[i];
        struct lw_plan_tile *tile = &memory->tile[fact->id.v];
        const bool in_turn = fact->level || fact->sample_count == 0 || fact->begins ||
                             shows_contributors(memory, fact->object);
        tile->shows =
            (!solves && memory->ended) || (in_turn && (whole || tile->work == LW_TILE_WORK_INVALIDATED));
    }
}

static bool is_any_stale(const struct lw_plan_input *in) {
    for (uint32_t i = 0; i < in->count; i++)
        if (in->fact[i].contributes && in->fact[i].state == LW_BLOCK_STALE) return true;
    return false;
}

void lw_plan_light(struct lw_plan_memory *memory, const struct lw_plan_input *in, struct lw_plan *plan) {
    const struct room room = room_of(memory, in);
    uint64_t taken = 0;
    LW_INVARIANT(in->count <= plan->capacity && in->spent >= 0);
    LW_INVARIANT_DEAR(are_facts(memory, in));
    memory->unchanged_rounds =
        is_any_stale(in) || memory->corrected ? 0 : memory->unchanged_rounds + memory->ended;
    plan->changing = in->moves.moves && memory->unchanged_rounds <= CHANGING_ROUNDS;
    for (uint32_t i = 0; i < in->count; i++) {
        struct lw_plan_tile *tile = &memory->tile[in->fact[i].id.v];
        if (tile->hidden != in->fact[i].hidden) tile->waiting = false; /* it starts again */
        tile->hidden = in->fact[i].hidden;
        tile->work = LW_TILE_WORK_NONE;
    }
    if (memory->ended) begin_round(memory, in);
    memory->frames++;
    plan->solve.count = 0;
    for (enum lw_plan_reason r = LW_PLAN_CHANGED_MOST; r <= LW_PLAN_CHANGED_BESIDE; r++)
        take_waiting(memory, in, plan, r, room.changed, &taken);
    take_waiting(memory, in, plan, LW_PLAN_STALE, room.all, &taken);
    take_waiting(memory, in, plan, LW_PLAN_NOISY, room.all, &taken);
    note_left(memory, in);
    choose_shown(memory, in, plan->solve.count > 0);
    memory->still_rounds = plan->solve.count || memory->corrected ? 0 : memory->still_rounds + memory->ended;
}

/* ---- show ---- */

/* Tiles whose corrections are to be seen: at once at an onset, after a sweep where movement goes on. */
static void show_corrected(struct lw_plan_memory *memory, const struct lw_plan_input *in) {
    for (uint32_t i = 0; i < in->count; i++) {
        const struct lw_plan_fact *fact = &in->fact[i];
        if (fact->level && fact->unseen &&
            (memory->sweep_ended || (fact->corrected && lw_budget_is_at_once(&in->budget))))
            memory->tile[fact->id.v].shows = true;
    }
}

/* Leaves what need not be shown in this frame for the next one without invalidated tiles, but not twice. */
static void defer(struct lw_plan_memory *memory, const struct lw_plan_input *in) {
    if (memory->deferred || memory->released) return;
    for (uint32_t i = 0; i < in->count; i++) {
        struct lw_plan_tile *tile = &memory->tile[in->fact[i].id.v];
        memory->deferred |= tile->shows && tile->work != LW_TILE_WORK_INVALIDATED;
        tile->shows &= tile->work == LW_TILE_WORK_INVALIDATED;
    }
}

void lw_plan_show(struct lw_plan_memory *memory, const struct lw_plan_input *in, struct lw_plan *plan) {
    LW_INVARIANT(in->count <= plan->capacity);
    plan->show.count = memory->corrected = 0;
    show_corrected(memory, in);
    if (in->awaited) defer(memory, in);
    for (uint32_t i = 0; i < in->count; i++) {
        const struct lw_plan_fact *fact = &in->fact[i];
        const struct lw_plan_tile *tile = &memory->tile[fact->id.v];
        memory->corrected += fact->corrected;
        if (tile->shows)
            add(&plan->show, fact->id,
                tile->work == LW_TILE_WORK_INVALIDATED || fact->corrected ? LW_PLAN_AT_ONCE
                                                                          : LW_PLAN_ROUND_ENDED,
                false);
    }
}
