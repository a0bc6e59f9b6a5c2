#include "server/solve/adapt/gradient.h"

#include "common/base/invariant.h"
#include "common/base/random.h"
#include "server/solve/state/tiles.h"

#include <math.h>
#include <string.h>

/* The share of the noise's variance that counts against stale light. Noise is each texel's own: pixels,
 * and far more a filter, average it over many; light is out of date over many at once, most so where it is
 * indirect. After the filter, these shares bring a change through in a quarter of the frames for a tenth
 * more error while a lamp walks (docs/lab/dynamic.md). */
static const float counted[2][LW_TILES_PARTS] = {
    [false] = {[LW_TILES_DIRECT] = 1.0f / 4, [LW_TILES_INDIRECT] = 1.0f / 16},
    [true] = {[LW_TILES_DIRECT] = 1.0f / 64, [LW_TILES_INDIRECT] = 1.0f / 256}};
/* Indirect light is out of date over the whole block, where noise is each texel's own:
 * less of it is allowed in a converged block. */
#define COHERENT 2.0f
/* Where something begins to move and one packet finds that so much of the light has changed,
 * the others need not be verified. */
#define CERTAIN 1.0f
/* Where one packet has invalidated a block under a budget and less than this share of its light has changed,
 * the others are verified before it forgets
 * any: a packet's sixteen texels are few for noise. */
#define SURE 0.1f
/* A block that was solved because it was invalidated counts as changed by this share of it still. */
#define AGAIN 0.5f
/* And less than this does not count under a budget: the noise of a packet would invalidate half of all
 * blocks. Their turns will find it. */
#define LIMITED_ERROR_MIN 0.06f
/* Drift: one solve's weight; the share of its mean square beyond which its mean is no chance (4 standard
 * errors). It counts in this many solves after a movement. */
#define DRIFT_WEIGHT 0.0625f
#define DRIFT_SHARE  0.6f
#define DRIFT_SOLVES 64u
/* A block that did not contribute for this many rounds is verified as at an onset. */
#define ROUNDS_MAX 16u

/* A change on one surface says nothing of another. At an onset one packet is verified for this many of a
 * block's surfaces, and at most OBSERVERS_MAX. */
#define SURFACES_EACH 2u
#define OBSERVERS_MAX 4u

static uint32_t observers_of(const struct lw_solve_block *block) {
    uint32_t surfaces = 0;
    for (uint32_t set = 0; set < block->packet_count; set += block->packet[set].group) surfaces++;
    const uint32_t count = (surfaces + SURFACES_EACH - 1) / SURFACES_EACH;
    return count < OBSERVERS_MAX ? count : OBSERVERS_MAX;
}

/* Takes `count` packets. The packets of a surface follow each other: packets far apart in their row are of
 * different surfaces. */
static uint16_t take_turn(struct lw_solve_block *block, uint32_t count) {
    LW_INVARIANT(count > 0 && count <= block->packet_count);
    const uint32_t turns = block->packet_count / count;
    uint16_t packets = 0;
    for (uint32_t set = block->change.next++ % turns; set < block->packet_count; set += turns)
        packets |= (uint16_t)(1u << set);
    return packets;
}

static void verify_packets(struct lw_change_block *change, uint16_t packets) {
    change->compare = packets;
    change->uncorrected |= packets;
    change->verified |= packets;
    change->retrace = packets & change->unchecked;
    change->direct |= change->retrace;
    change->unchecked &= (uint16_t)~packets;
    LW_INVARIANT(!(change->retrace & ~change->compare) && !(change->retrace & ~change->direct));
}

/* Along the rays that there are: what arrives may have changed. */
static void reread_packets(struct lw_solve_block *block) {
    struct lw_change_block *change = &block->change;
    change->compare = lw_change_all_packets(block);
    change->uncorrected |= change->compare;
    change->verified |= change->compare;
}

/* What a round verifies of a block. */
struct choice {
    enum lw_change_verified verify;
    bool noted;  /* the block takes part in the round, even if nothing is verified */
    bool begins; /* something begins to move, as far as the block knows */
    bool lit;    /* all packets, about direct light; else by packets */
    uint32_t packets;
};

static struct choice choose(const struct lw_solve_block *block, const struct lw_gradient_round *round) {
    const struct lw_change_block *change = &block->change;
    const bool moved = change->moves != round->moves, missed = round->tick - change->tick > ROUNDS_MAX,
               first = change->moves < round->began, converged = block->state == LW_BLOCK_CONVERGED,
               lit = (missed || first) && change->moves < round->light_moves;
    if (!block->packet_count || !block->sample_count) return (struct choice){0};
    const bool begins = moved && (missed || first || (converged ? !change->unchecked : !change->moving));
    if (!begins && round->spreads && !lw_gradient_is_invalidated(change) && !(round->turn && converged))
        return (struct choice){.verify = LW_CHANGE_VERIFIED_RAYS};
    if (!converged && !begins) return (struct choice){0};
    /* Each packet once in LW_PACKETS_MAX rounds, however few a block has. */
    const bool active = moved || change->unchecked || round->active,
               turn = round->turn &&
                      (round->tick + lw_random_hash(block->tile_id)) % LW_PACKETS_MAX < block->packet_count;
    if (!active || !(begins || turn)) return (struct choice){.noted = true, .begins = begins};
    return (struct choice){.verify = lit && !round->budget.limited ? LW_CHANGE_VERIFIED_ALL
                                     : begins                      ? LW_CHANGE_VERIFIED_ONSET
                                                                   : LW_CHANGE_VERIFIED_TURN,
                           .noted = true,
                           .begins = begins,
                           .lit = lit,
                           .packets = first ? observers_of(block) : 1};
}

uint64_t lw_gradient_work(const struct lw_solve_block *block, const struct lw_gradient_round *round) {
    const struct choice choice = choose(block, round);
    const uint64_t texels = block->covered_count;
    switch (choice.verify) {
    case LW_CHANGE_VERIFIED_NONE:
        return 0;
    case LW_CHANGE_VERIFIED_RAYS:
        return texels * LW_BUDGET_READ;
    case LW_CHANGE_VERIFIED_ALL:
        return texels * (LW_BUDGET_SHADOW + LW_BUDGET_READ);
    default:
        break;
    }
    if (choice.lit) return texels * LW_BUDGET_SHADOW;
    return choice.packets * texels / block->packet_count *
           (LW_BUDGET_SHADOW + LW_BUDGET_TRACE + LW_BUDGET_READ);
}

bool lw_gradient_choose(struct lw_solve_block *block, const struct lw_gradient_round *round) {
    struct lw_change_block *change = &block->change;
    const struct choice choice = choose(block, round);
    LW_INVARIANT(round->began <= round->moves && round->light_moves <= round->moves);
    change->compare = change->retrace = change->direct = 0;
    change->verify = choice.verify;
    change->tick = round->tick;
    if (choice.noted) {
        if (change->moves != round->moves) change->unchecked = lw_change_all_packets(block);
        change->moves = round->moves;
        change->moving = true;
        if (choice.begins) change->verified = 0;
    }
    if (choice.verify == LW_CHANGE_VERIFIED_NONE) return false;
    if (choice.verify == LW_CHANGE_VERIFIED_RAYS || choice.verify == LW_CHANGE_VERIFIED_ALL)
        reread_packets(block);
    if (choice.lit)
        change->direct = change->verified = lw_change_all_packets(block);
    else if (choice.packets)
        verify_packets(change, take_turn(block, choice.packets));
    LW_INVARIANT(!((change->compare | change->direct) & ~lw_change_all_packets(block)));
    return true;
}

bool lw_gradient_choose_all(struct lw_solve_block *block, uint32_t moves) {
    struct lw_change_block *change = &block->change;
    change->compare = change->retrace = change->direct = 0;
    if (!block->packet_count || !block->sample_count) return false;
    change->moves = moves;
    reread_packets(block);
    change->verify =
        change->verify > LW_CHANGE_VERIFIED_RAYS ? LW_CHANGE_VERIFIED_ALL : LW_CHANGE_VERIFIED_RAYS;
    change->direct = change->compare;
    return true;
}

/* How far light is off what it was; weighted by regions (lw_solve_block.weight). */
struct off {
    float direct;
    struct lw_vec3 indirect[LW_REGIONS];
};

/* What rays end on has noise too, and new noise whenever it is solved: texels differ each in its own way,
 * where changing light changes for many. Returns the share of the sums that chance does not explain: the
 * squares of the regions' means, less the squares of their standard errors. (Without that, noise that was
 * taken for change shortened memories, which made noise: indirect light of the atrium never converged after a
 * movement. Twice the errors overlooks changes.) */
static float share_known(const struct off *sum, const float square[LW_REGIONS],
                         const uint32_t lanes[LW_REGIONS]) {
    float means = 0, errors = 0;
    for (uint32_t r = 0; r < LW_REGIONS; r++) {
        if (lanes[r] < 2) continue;
        const float n = (float)lanes[r],
                    mean_square = lw_vec3_dot(sum->indirect[r], sum->indirect[r]) / (n * n);
        means += mean_square;
        errors += fmaxf(square[r] / n - mean_square, 0) / (n - 1);
    }
    return means > 0 ? sqrtf(fmaxf(0, 1 - errors / means)) : 1;
}

/* What a block's means are out of date by, and what the packets of a mask have found, in
 * the mean over their texels. */
static struct off add_up(const struct lw_solve_block *block, uint16_t packets) {
    const struct lw_change_block *change = &block->change;
    struct off off = {0};
    uint32_t texels = 0, lanes[LW_REGIONS] = {0};
    float square[LW_REGIONS] = {0};
    for (uint32_t set = 0; set < block->packet_count; set++) {
        if (!(packets >> set & 1)) continue;
        off.direct += change->packet[set].direct_square + change->packet[set].direct_error;
        texels += block->packet[set].count;
        for (uint32_t r = 0; r < LW_REGIONS; r++) {
            const float weight = block->weight[r];
            off.indirect[r] =
                lw_vec3_mad(off.indirect[r], lw_change_both_orders(&change->packet[set], r), weight);
            square[r] += weight * weight * change->packet[set].indirect_square[r];
            lanes[r] += block->packet[set].lanes[r];
        }
    }
    const float known = share_known(&off, square, lanes);
    off.direct = change->staleness_direct + (texels ? sqrtf(off.direct / (float)texels) : 0);
    for (uint32_t r = 0; r < LW_REGIONS; r++)
        off.indirect[r] = lw_vec3_mad(change->staleness_indirect[r], off.indirect[r],
                                      lanes[r] ? known / (float)lanes[r] : 0);
    return off;
}

/* Root mean square over the regions. */
static float mean_over(const struct lw_vec3 region[LW_REGIONS]) {
    float square = 0;
    for (uint32_t r = 0; r < LW_REGIONS; r++)
        square += lw_vec3_max_abs(region[r]) * lw_vec3_max_abs(region[r]);
    return sqrtf(square / LW_REGIONS);
}

/* By how much indirect light is off, with its standard error. */
static float off_indirect(const struct lw_solve_block *block, const struct lw_vec3 region[LW_REGIONS]) {
    return hypotf(mean_over(region), block->change.standard_error);
}

static bool is_too_much(const struct lw_solve_block *block, const struct off *off, float target_error) {
    const float may_be = (block->reference_luminance + block->other_luminance) * fmaxf(target_error, 0);
    return off->direct > may_be || COHERENT * off_indirect(block, off->indirect) > may_be;
}

/* What share of a block's light is out of date, about. */
static float share_of(const struct lw_solve_block *block, const struct off *off) {
    const float light = block->reference_luminance + block->other_luminance,
                all = fmaxf(off->direct, COHERENT * off_indirect(block, off->indirect));
    return light > 0 ? all / light : 1;
}

/* Whether a block would have to be invalidated if all of it were as these packets are. */
static bool has_changed(const struct lw_solve_block *block, uint16_t packets, float target_error) {
    const struct off off = add_up(block, packets);
    return is_too_much(block, &off, target_error);
}

static bool rereads(const struct lw_change_block *change) {
    return change->verify == LW_CHANGE_VERIFIED_RAYS || change->verify == LW_CHANGE_VERIFIED_ALL;
}

/* This frame's findings are not added to earlier ones. */
static bool stands_alone(const struct lw_change_block *change) {
    return change->verify == LW_CHANGE_VERIFIED_ONSET || rereads(change);
}

/* Packets whose mean stands for the block: earlier findings know nothing of a movement that begins. */
static uint16_t packets_that_count(const struct lw_solve_block *block) {
    return stands_alone(&block->change) ? block->change.verified : lw_change_all_packets(block);
}

static bool is_staleness(const struct lw_vec3 region[LW_REGIONS]) {
    for (uint32_t r = 0; r < LW_REGIONS; r++)
        if (!lw_vec3_is_finite(region[r])) return false;
    return true;
}

void lw_gradient_note_staleness(struct lw_solve_block *block) {
    struct lw_change_block *change = &block->change;
    const struct off off = add_up(block, lw_change_all_packets(block));
    LW_INVARIANT_DEAR(is_staleness(off.indirect));
    memcpy(change->staleness_indirect, off.indirect, sizeof off.indirect);
    memset(change->packet, 0, block->packet_count * sizeof *change->packet);
    change->verified = change->uncorrected = 0;
}

bool lw_gradient_choose_more(struct lw_solve_block *block, float target_error,
                             const struct lw_budget *budget) {
    struct lw_change_block *change = &block->change;
    const uint16_t verified = change->compare, found = packets_that_count(block);
    change->compare = change->direct = 0;
    if (!verified || rereads(change) || !has_changed(block, found, target_error)) return false;
    if (change->verify == LW_CHANGE_VERIFIED_ONSET && (budget->limited || has_changed(block, found, CERTAIN)))
        return false;
    verify_packets(change, lw_change_all_packets(block) & (uint16_t)~verified);
    return change->compare != 0;
}

void lw_gradient_invalidate(struct lw_solve_block *block, float target_error,
                            const struct lw_budget *budget) {
    struct lw_change_block *change = &block->change;
    change->compare = change->direct = 0;
    const struct off off = add_up(block, packets_that_count(block));
    if (budget->limited && stands_alone(change)) target_error = fmaxf(target_error, LIMITED_ERROR_MIN);
    if (!(block->state == LW_BLOCK_CONVERGED || stands_alone(change)) ||
        !is_too_much(block, &off, target_error))
        return;
    change->strength = fminf(1, share_of(block, &off));
    LW_INVARIANT_DEAR(change->strength > 0);
    change->judged = packets_that_count(block);
    block->state = LW_BLOCK_STALE;
}

void lw_gradient_review(struct lw_solve_block *block, float target_error) {
    if (block->change.verify == LW_CHANGE_VERIFIED_ONSET) block->change.verify = LW_CHANGE_VERIFIED_TURN;
    lw_gradient_invalidate(block, target_error, &(struct lw_budget){0});
}

bool lw_gradient_choose_due(struct lw_solve_block *block, uint32_t moves) {
    struct lw_change_block *change = &block->change;
    const bool moved = moves != change->moves;
    if (!block->packet_count || !block->sample_count) return false;
    if (lw_gradient_is_invalidated(change) && change->strength < SURE &&
        change->judged != lw_change_all_packets(block)) {
        verify_packets(change, lw_change_all_packets(block) & (uint16_t)~change->judged);
        change->judged = lw_change_all_packets(block);
        return true;
    }
    if (change->verify > LW_CHANGE_VERIFIED_RAYS || lw_gradient_is_invalidated(change)) return false;
    if (moved) change->unchecked = lw_change_all_packets(block);
    if (moved) verify_packets(change, change->verified ? change->verified : take_turn(block, 1));
    return moved;
}

static float room_for(const struct lw_solve_block *block, int part, float staleness, bool filtered) {
    const float noise = block->noise[part];
    if (!(staleness > 0)) return INFINITY;
    if (noise < 0) return 1; /* not known before there are two */
    return lw_history_max(
        counted[filtered][part] * noise * block->reference_luminance * block->reference_luminance, staleness);
}

/* Values of all regions together are scaled by the largest factor. */
void lw_gradient_reweigh(struct lw_solve_block *block, const float factor[LW_REGIONS]) {
    struct lw_change_block *change = &block->change;
    float most = 1;
    for (uint32_t r = 0; r < LW_REGIONS; r++) {
        LW_INVARIANT(factor[r] > 0 && isfinite(factor[r]));
        change->staleness_indirect[r] = lw_vec3_scale(change->staleness_indirect[r], factor[r]);
        for (int part = 0; part < LW_TILES_PARTS; part++) {
            change->drift[part][r].mean *= factor[r];
            change->drift[part][r].square *= factor[r] * factor[r];
        }
        most = fmaxf(most, factor[r]);
    }
    change->staleness_direct *= most;
    change->standard_error *= most;
    for (uint32_t set = 0; set < block->packet_count; set++) {
        change->packet[set].direct_square *= most * most;
        change->packet[set].direct_error *= most * most;
    }
}

void lw_gradient_note_drift(struct lw_solve_block *block, int part, uint32_t region, float off) {
    LW_INVARIANT_DEAR(region < LW_REGIONS && part < LW_TILES_PARTS);
    struct lw_change_drift *drift = &block->change.drift[part][region];
    drift->mean += (off - drift->mean) * DRIFT_WEIGHT;
    drift->square += (off * off - drift->square) * DRIFT_WEIGHT;
    LW_INVARIANT_DEAR(!(drift->square < 0));
}

/* By how much a region's mean is surely off, which then starts again; else 0. */
static float take_drift(struct lw_change_drift *drift) {
    const float off = fabsf(drift->mean);
    if (!(off * off > DRIFT_SHARE * drift->square)) return 0;
    *drift = (struct lw_change_drift){0, 0};
    return off;
}

/* Raises the staleness of the means to the drift of their estimates. */
static void add_drift(struct lw_change_block *change, struct off *off) {
    for (uint32_t r = 0; r < LW_REGIONS; r++) {
        const float direct = take_drift(&change->drift[LW_TILES_DIRECT][r]),
                    indirect = take_drift(&change->drift[LW_TILES_INDIRECT][r]);
        off->direct = fmaxf(off->direct, direct);
        if (indirect > lw_vec3_max_abs(off->indirect[r]))
            off->indirect[r] = lw_vec3(indirect, indirect, indirect);
    }
}

void lw_gradient_weigh_direct(struct lw_solve_block *block, uint32_t moves, bool filtered,
                              const struct lw_budget *budget) {
    struct lw_change_block *change = &block->change;
    struct off off = add_up(block, lw_gradient_is_invalidated(change) ? change->judged : change->verified);
    change->still_solves = moves != change->solved_moves ? 0 : change->still_solves + 1;
    if (moves && change->still_solves < DRIFT_SOLVES) add_drift(change, &off);
    const float weight =
        lw_history_take(&block->direct, room_for(block, LW_TILES_DIRECT, off.direct, filtered));
    change->staleness_direct = off.direct * (1 - weight);
    LW_INVARIANT_DEAR(change->staleness_direct >= 0 && is_staleness(off.indirect));
    memcpy(change->staleness_indirect, off.indirect, sizeof off.indirect);
    memset(change->packet, 0, block->packet_count * sizeof *change->packet);
    change->moving = moves != change->solved_moves;
    LW_INVARIANT(moves >= change->solved_moves); /* movements are counted up */
    change->moves = change->solved_moves = moves;
    change->compare = change->retrace = change->direct = change->verified = change->uncorrected =
        change->unchecked = 0;
    change->strength *= budget->onset ? AGAIN : 0;
    if (!lw_gradient_is_strong(change)) change->strength = 0;
}

void lw_gradient_weigh_indirect(struct lw_solve_block *block, float most_frames, bool filtered) {
    struct lw_change_block *change = &block->change;
    const float room =
        room_for(block, LW_TILES_INDIRECT, off_indirect(block, change->staleness_indirect), filtered);
    const float weight = lw_history_take(&block->indirect, fminf(room, most_frames));
    for (uint32_t r = 0; r < LW_REGIONS; r++)
        change->staleness_indirect[r] = lw_vec3_scale(change->staleness_indirect[r], 1 - weight);
    change->standard_error *= 1 - weight;
    LW_INVARIANT_DEAR(change->standard_error >= 0 && is_staleness(change->staleness_indirect));
}

bool lw_gradient_is_stale(const struct lw_solve_block *block, float target_error) {
    return has_changed(block, 0, target_error);
}
