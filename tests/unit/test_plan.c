/* Plans of made-up tiles: no scene, no ray, no clock. */
#include "tests/support/support.h"

#include "server/solve/adapt/plan.h"

#include <string.h>

#define TILES_MAX 1000u

/* A frame's tiles, all of one size, lit once and noisy, looked at from near, unless a test says otherwise. */
struct house {
    struct lw_plan_fact fact[TILES_MAX];
    struct lw_plan_input in;
    struct lw_plan_memory memory;
    struct lw_plan plan;
};

#define COVERED 100u

static void begin(struct house *house, uint32_t count) {
    memset(house, 0, sizeof *house);
    lw_support_ok(lw_plan_init(&house->plan, count), NULL);
    lw_support_ok(lw_plan_memory_init(&house->memory, count), NULL);
    for (uint32_t i = 0; i < count; i++)
        house->fact[i] = (struct lw_plan_fact){.id = {i},
                                               .object = i,
                                               .covered_count = COVERED,
                                               .sample_count = 1,
                                               .level = 1,
                                               .state = LW_BLOCK_SAMPLED,
                                               .contributes = true,
                                               .verify_work = (uint64_t)COVERED * LW_BUDGET_SHADOW,
                                               .correct_work = (uint64_t)COVERED * LW_BUDGET_SHADOW};
    house->in = (struct lw_plan_input){
        .fact = house->fact, .count = count, .everything = true, .looked_at = true, .bounces = 2};
}

static void end(struct house *house) {
    lw_plan_finish(&house->plan);
    lw_plan_memory_finish(&house->memory);
}

/* A budget with room for the solve of that number of tiles. */
static void limit(struct house *house, double tiles) {
    house->in.budget = lw_budget_of_units(tiles * COVERED);
}

static void move(struct house *house, bool shines) {
    struct lw_plan_moves *moves = &house->in.moves;
    moves->began = ++moves->moves;
    if (shines) moves->light_moves = moves->moves;
    moves->shone = shines;
    lw_plan_note_move(&house->memory);
}

/* A whole frame in which verification finds the given change, and solved tiles stay as they were. */
static void plan_frame(struct house *house, struct lw_plan_found found) {
    lw_plan_verify(&house->memory, &house->in, &house->plan);
    found.verified = found.invalidated ? house->plan.verify_sure : house->plan.verify.count;
    lw_plan_note_verified(&house->memory, &house->in, &house->plan, &found);
    lw_plan_light(&house->memory, &house->in, &house->plan);
    lw_plan_show(&house->memory, &house->in, &house->plan);
}

static const struct lw_plan_found nothing = {0};

static bool lists(const struct lw_plan_list *list, uint32_t id) {
    for (uint32_t i = 0; i < list->count; i++)
        if (list->entry[i].id.v == id) return true;
    return false;
}

static void invalidate(struct house *house, uint32_t id, float priority) {
    house->fact[id].invalidated = true;
    house->fact[id].invalidated_count = COVERED / 2;
    house->fact[id].priority = priority;
    house->fact[id].state = LW_BLOCK_STALE;
}

/* ---- rounds ---- */

static void without_a_budget_a_round_is_a_frame(void **state) {
    (void)state;
    static struct house house;
    begin(&house, 8);
    house.fact[3].state = LW_BLOCK_CONVERGED;
    plan_frame(&house, nothing);
    assert_int_equal(house.plan.verify.count, 0);
    assert_int_equal(house.plan.solve.count, 7);
    assert_false(lists(&house.plan.solve, 3));
    assert_int_equal(house.plan.solve.entry[0].reason, LW_PLAN_NOISY);
    assert_int_equal(house.plan.show.count, 8);
    assert_true(house.memory.ended);
    end(&house);
}

/* A round of eight tiles in frames with room for two is shown at its end. */
static void a_round_takes_as_many_frames_as_its_budget_says(void **state) {
    (void)state;
    static struct house house;
    begin(&house, 8);
    limit(&house, 2);
    for (unsigned f = 0; f < 4; f++) {
        plan_frame(&house, nothing);
        assert_int_equal(house.plan.solve.count, 2);
        assert_int_equal(house.plan.show.count, f == 3 ? 8 : 0);
        assert_int_equal(house.memory.round, 1);
    }
    plan_frame(&house, nothing);
    assert_int_equal(house.memory.round, 2);
    end(&house);
}

/* A tile that converges before its turn, as when its blocks are judged again, keeps no other one waiting. */
static void a_round_ends_without_what_converges_in_it(void **state) {
    (void)state;
    static struct house house;
    begin(&house, 4);
    limit(&house, 2);
    plan_frame(&house, nothing);
    assert_false(house.memory.ended);
    house.fact[2].state = house.fact[3].state = LW_BLOCK_CONVERGED;
    plan_frame(&house, nothing);
    assert_int_equal(house.plan.solve.count, 0);
    assert_true(house.memory.ended);
    plan_frame(&house, nothing);
    assert_int_equal(house.memory.round, 2);
    assert_true(lists(&house.plan.solve, 0) && lists(&house.plan.solve, 1));
    end(&house);
}

/* A tile larger than the budget is solved in a frame of its own. */
static void a_budget_of_nothing_solves_one_tile(void **state) {
    (void)state;
    static struct house house;
    begin(&house, 3);
    limit(&house, 1e-9);
    for (uint32_t id = 0; id < 3; id++) {
        plan_frame(&house, nothing);
        assert_int_equal(house.plan.solve.count, 1);
        assert_true(lists(&house.plan.solve, id));
    }
    end(&house);
}

static void a_thousand_equal_priorities_are_taken_in_their_order(void **state) {
    (void)state;
    static struct house house;
    begin(&house, TILES_MAX);
    limit(&house, 10);
    for (uint32_t i = 0; i < TILES_MAX; i++) invalidate(&house, i, 0.5f);
    plan_frame(&house, nothing);
    assert_int_equal(house.plan.solve.count, 20); /* their invalidated halves */
    for (uint32_t i = 0; i < 20; i++) {
        assert_int_equal(house.plan.solve.entry[i].id.v, i);
        assert_true(house.plan.solve.entry[i].part);
        assert_int_equal(house.plan.solve.entry[i].reason, LW_PLAN_CHANGED_MOST);
    }
    assert_int_equal(house.plan.show.count, 20); /* at once */
    end(&house);
}

static void what_has_changed_most_comes_first(void **state) {
    (void)state;
    static const float priority[] = {0, 0.02f, 0.5f, 0.1f};
    static const uint32_t order[] = {2, 3, 1};
    static struct house house;
    begin(&house, 4);
    limit(&house, 0.5);
    for (uint32_t i = 1; i < 4; i++) invalidate(&house, i, priority[i]);
    for (uint32_t k = 0; k < 3; k++) {
        plan_frame(&house, nothing);
        assert_int_equal(house.plan.solve.count, 1);
        assert_int_equal(house.plan.solve.entry[0].id.v, order[k]);
        assert_int_equal(house.memory.changed_left > 0, k < 2);
        house.fact[order[k]].invalidated = false; /* solved */
    }
    plan_frame(&house, nothing); /* the round's own turn */
    assert_false(house.plan.solve.entry[0].part);
    end(&house);
}

/* ---- interest ---- */

/* Level k every 2^k-th round, a contributor by its importance, others not at all. */
static void far_tiles_are_solved_less_often(void **state) {
    (void)state;
    static const uint8_t level[] = {1, 2, 3, 0, 0};
    static const float importance[] = {0, 0, 0, 0.6f, 0};
    uint32_t solved[5] = {0};
    static struct house house;
    begin(&house, 5);
    house.in.everything = false;
    for (uint32_t i = 0; i < 5; i++) {
        house.fact[i].level = level[i];
        house.fact[i].importance = importance[i];
        house.fact[i].contributes = i < 4;
    }
    for (unsigned f = 0; f < 64; f++) {
        plan_frame(&house, nothing);
        for (uint32_t i = 0; i < 5; i++) solved[i] += lists(&house.plan.solve, i);
    }
    assert_int_equal(solved[0], 64);
    assert_in_range(solved[1], 31, 33);
    assert_in_range(solved[2], 15, 17);
    assert_in_range(solved[3], 15, 17);
    assert_int_equal(solved[4], 0);
    end(&house);
}

static void interest_that_jumps_is_solved_in_the_next_round(void **state) {
    (void)state;
    static struct house house;
    begin(&house, 6);
    house.in.everything = false;
    for (unsigned jump = 0; jump < 12; jump++) {
        for (uint32_t i = 0; i < 6; i++) {
            house.fact[i].level = i == jump % 6;
            house.fact[i].contributes = house.fact[i].level;
        }
        plan_frame(&house, nothing);
        assert_int_equal(house.plan.solve.count, 1);
        assert_true(lists(&house.plan.solve, jump % 6));
        assert_true(lists(&house.plan.show, jump % 6));
    }
    for (uint32_t i = 0; i < 6; i++) house.fact[i].level = house.fact[i].contributes = false;
    house.in.looked_at = false;
    move(&house, true);
    plan_frame(&house, nothing);
    assert_int_equal(house.plan.verify.count + house.plan.solve.count, 0); /* nobody looks */
    end(&house);
}

/* ---- movement ---- */

/* An onset of light takes the whole budget, nearest first; the rest waits for the next frame, and nothing
 * but invalidated tiles is solved until all are verified. */
static void an_onset_of_light_is_verified_nearest_first(void **state) {
    (void)state;
    static struct house house;
    begin(&house, 10);
    limit(&house, 2); /* four tiles' shadows */
    for (uint32_t i = 0; i < 10; i++) house.fact[i].distance_m = (float)(10 - i);
    house.fact[9].level = 0; /* a contributor: last, though nearest */
    house.in.everything = false;
    house.in.budget.onset = true;
    move(&house, true);
    plan_frame(&house, (struct lw_plan_found){.direct = true});
    static const uint32_t nearest[] = {8, 7, 6, 5};
    assert_int_equal(house.plan.verify.count, 4);
    assert_int_equal(house.plan.verify_sure, 4);
    for (uint32_t k = 0; k < 4; k++) {
        assert_int_equal(house.plan.verify.entry[k].id.v, nearest[k]);
        assert_int_equal(house.plan.verify.entry[k].reason, LW_PLAN_MOVED);
    }
    assert_int_equal(house.plan.solve.count, 0);
    assert_int_equal(house.memory.rereads, 2); /* as many as bounces */
    assert_true(lw_plan_is_behind(&house.memory, &house.in));
    plan_frame(&house, nothing);
    assert_true(lw_plan_is_behind(&house.memory, &house.in));
    plan_frame(&house, nothing);
    assert_false(lw_plan_is_behind(&house.memory, &house.in));
    assert_true(lists(&house.plan.verify, 9));
    assert_true(house.plan.solve.count > 0);
    end(&house);
}

/* Where something moves that does not shine, half of the budget is verified in any case, and the other half
 * only if that has found nothing. */
static void a_search_stops_at_what_it_finds(void **state) {
    (void)state;
    static struct house house;
    for (int found = 0; found < 2; found++) {
        begin(&house, 10);
        limit(&house, 3); /* six tiles' shadows */
        house.in.budget.onset = true;
        move(&house, false);
        plan_frame(&house, (struct lw_plan_found){.invalidated = found});
        assert_int_equal(house.plan.verify_sure, 3);
        assert_int_equal(house.plan.verify.count, 6);
        uint32_t left = 0;
        for (uint32_t i = 0; i < 10; i++) left += house.memory.tile[i].unverified;
        assert_int_equal(left, found ? 7 : 4);
        end(&house);
    }
}

/* While lights keep moving a share of each frame goes round; what it has corrected is shown at the end. */
static void a_sweep_goes_round_and_shows_at_its_end(void **state) {
    (void)state;
    static struct house house;
    begin(&house, 8);
    limit(&house, 2); /* half of it: two tiles' shadows */
    unsigned ended = 0;
    for (uint32_t i = 0; i < 8; i++) house.fact[i].unseen = true;
    for (unsigned f = 0; f < 8; f++) {
        move(&house, true);
        plan_frame(&house, nothing);
        assert_int_equal(house.plan.correct.count, 2);
        assert_int_equal(house.plan.correct.entry[0].id.v, f % 4 * 2);
        assert_int_equal(house.memory.sweep_ended, f % 4 == 3);
        if (house.memory.sweep_ended) assert_int_equal(house.plan.show.count, 8);
        ended += house.memory.sweep_ended;
    }
    assert_int_equal(ended, 2);
    end(&house);
}

/* Two layers follow an onset. The one in which less has changed verifies, and solves nothing. */
static void a_layer_that_yields_solves_nothing(void **state) {
    (void)state;
    static struct house house;
    for (int yields = 0; yields < 2; yields++) {
        begin(&house, 4);
        limit(&house, 8);
        house.in.budget.onset = true;
        house.in.budget.yields = yields;
        invalidate(&house, 1, 0.5f);
        move(&house, true);
        plan_frame(&house, nothing);
        assert_int_equal(house.plan.verify.count, 4);
        assert_int_equal(lists(&house.plan.solve, 1), !yields);
        assert_int_equal(house.memory.changed_left > 0, yields);
        end(&house);
    }
}

/* A hidden tile needs nothing; one that is shown again is solved first, even if nobody looks. */
static void a_hidden_object_that_comes_back_is_lit_at_once(void **state) {
    (void)state;
    static struct house house;
    begin(&house, 4);
    limit(&house, 1);
    house.fact[2].hidden = true;
    house.fact[2].state = LW_BLOCK_CONVERGED;
    for (unsigned f = 0; f < 4; f++) {
        plan_frame(&house, nothing);
        assert_false(lists(&house.plan.solve, 2));
    }
    house.fact[2].hidden = false;
    house.fact[2].begins = true;
    house.fact[2].sample_count = 0;
    house.in.everything = false;
    house.fact[2].level = 0;
    invalidate(&house, 2, 1);
    house.fact[2].invalidated_count = COVERED;
    plan_frame(&house, nothing);
    assert_int_equal(house.plan.solve.entry[0].id.v, 2);
    assert_int_equal(house.plan.solve.entry[0].reason, LW_PLAN_CHANGED_BESIDE);
    assert_true(lists(&house.plan.show, 2));
    end(&house);
}

/* Somebody waits for the end of the frame: a round's end is shown a frame later, and not later than that. */
static void what_may_wait_is_deferred_once(void **state) {
    (void)state;
    static struct house house;
    begin(&house, 4);
    limit(&house, 4);
    house.in.awaited = true;
    plan_frame(&house, nothing);
    assert_int_equal(house.plan.show.count, 0);
    plan_frame(&house, nothing);
    assert_int_equal(house.plan.show.count, 4);
    plan_frame(&house, nothing);
    assert_int_equal(house.plan.show.count, 0);
    end(&house);
}

/* The same input and memory give the same plan, and the facts stay as they were. */
static void a_plan_is_a_function(void **state) {
    (void)state;
    static struct house a, b;
    begin(&a, 50);
    begin(&b, 50);
    limit(&a, 3);
    limit(&b, 3);
    for (unsigned f = 0; f < 20; f++) {
        if (f == 5) invalidate(&a, 7, 0.3f), invalidate(&b, 7, 0.3f);
        if (f % 6 == 2) move(&a, f % 4), move(&b, f % 4);
        plan_frame(&a, nothing);
        plan_frame(&b, nothing);
        const struct lw_plan_list *x[] = {&a.plan.verify, &a.plan.correct, &a.plan.solve, &a.plan.show},
                                  *y[] = {&b.plan.verify, &b.plan.correct, &b.plan.solve, &b.plan.show};
        for (int k = 0; k < 4; k++) {
            assert_int_equal(x[k]->count, y[k]->count);
            for (uint32_t i = 0; i < x[k]->count; i++) {
                assert_int_equal(x[k]->entry[i].id.v, y[k]->entry[i].id.v);
                assert_int_equal(x[k]->entry[i].reason, y[k]->entry[i].reason);
            }
        }
    }
    assert_memory_equal(a.fact, b.fact, sizeof a.fact);
    end(&a);
    end(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(without_a_budget_a_round_is_a_frame),
        cmocka_unit_test(a_round_takes_as_many_frames_as_its_budget_says),
        cmocka_unit_test(a_round_ends_without_what_converges_in_it),
        cmocka_unit_test(a_budget_of_nothing_solves_one_tile),
        cmocka_unit_test(a_thousand_equal_priorities_are_taken_in_their_order),
        cmocka_unit_test(what_has_changed_most_comes_first),
        cmocka_unit_test(far_tiles_are_solved_less_often),
        cmocka_unit_test(interest_that_jumps_is_solved_in_the_next_round),
        cmocka_unit_test(an_onset_of_light_is_verified_nearest_first),
        cmocka_unit_test(a_search_stops_at_what_it_finds),
        cmocka_unit_test(a_sweep_goes_round_and_shows_at_its_end),
        cmocka_unit_test(a_layer_that_yields_solves_nothing),
        cmocka_unit_test(a_hidden_object_that_comes_back_is_lit_at_once),
        cmocka_unit_test(what_may_wait_is_deferred_once),
        cmocka_unit_test(a_plan_is_a_function),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
