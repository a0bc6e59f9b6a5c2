/* Two ranks in one process, each with a solver and a thread of its own: their light is that of one solver,
 * bit for bit. */
#include "server/solve/adapt/ranks.h"
#include "tests/reference/room.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#define RANKS  2u
#define FRAMES 30u

/* What the ranks show each other: where one looks, all others wait. */
struct meeting {
    pthread_barrier_t barrier;
    struct lw_ranks_exchange of[RANKS];
    uint64_t radiated, lit; /* tiles that crossed */
};

struct seat {
    struct meeting *meeting;
    uint32_t self;
};

static void take_tiles(struct seat *seat, const struct lw_ranks_exchange *what) {
    struct meeting *m = seat->meeting;
    for (uint32_t i = 0; i < what->tile_count; i++) {
        const lw_tile_id id = what->tile[i];
        const uint32_t owner = lw_tiles_at(what->tiles, id)->owner;
        if (owner == seat->self) continue;
        const struct lw_ranks_exchange *other = &m->of[owner];
        if (what->moment == LW_RANKS_RADIATED)
            lw_tiles_take_radiance(what->tiles, other->tiles, id, what->bounce);
        else
            lw_tiles_take(what->tiles, other->tiles, id);
        if (what->corrected) what->corrected[id.v] = other->corrected[id.v];
        if (seat->self == 0) ++*(what->moment == LW_RANKS_RADIATED ? &m->radiated : &m->lit);
    }
}

static void exchange(void *user, const struct lw_ranks_exchange *what) {
    struct seat *seat = user;
    struct meeting *m = seat->meeting;
    bool found[2] = {false, false};
    m->of[seat->self] = *what;
    pthread_barrier_wait(&m->barrier);
    for (uint32_t r = 0; r < RANKS; r++) {
        assert_int_equal(m->of[r].moment, what->moment);
        assert_int_equal(m->of[r].tile_count, what->tile_count);
        for (int k = 0; what->found && k < 2; k++) found[k] |= m->of[r].found[k];
    }
    take_tiles(seat, what);
    pthread_barrier_wait(&m->barrier);
    if (what->found) memcpy(what->found, found, sizeof found);
    pthread_barrier_wait(&m->barrier);
}

static struct lw_solver_desc describe(double units) {
    return (struct lw_solver_desc){.bounces = 3,
                                   .indirect_samples = 2,
                                   .target_error = 0.08f,
                                   .denoise = true,
                                   .cell_size_m = 1,
                                   .frame_budget_units = units,
                                   .threads = 1,
                                   .seed = 5};
}

/* Frames of a room in which a lamp moves once, then a plate, then the lamp in each frame. */
static void solve(struct room_solution *s) {
    for (unsigned f = 1; f <= FRAMES; f++) {
        if (f == 10 || f > 22) s->pose.light[0].position_ws.x += 0.1f;
        if (f == 16) s->pose.object_to_world[ROOM_PLATE].m[2][3] += 0.2f;
        if (s->solver->ops->frame(s->solver, &s->pose, f, &s->stats, NULL) != LW_OK) abort();
        s->rays += s->stats.rays_shadow + s->stats.rays_bounce;
    }
}

struct rank {
    struct seat seat;
    struct lw_ranks ranks;
    struct room_solution s;
    double units;
};

static void *run(void *user) {
    solve(&((struct rank *)user)->s);
    return NULL;
}

static void ranks_have_the_light_of_one(double units) {
    struct room room = room_with_two_lamps();
    struct meeting meeting = {0};
    struct rank rank[RANKS];
    struct room_solution one;
    pthread_t thread[RANKS];
    room.texels_per_metre = 8;
    room_solve(&one, &room, describe(units), 0);
    solve(&one);
    pthread_barrier_init(&meeting.barrier, NULL, RANKS);
    for (uint32_t r = 0; r < RANKS; r++) {
        rank[r] = (struct rank){.seat = {&meeting, r}};
        rank[r].ranks =
            (struct lw_ranks){.count = RANKS, .self = r, .user = &rank[r].seat, .exchange = exchange};
        struct lw_solver_desc desc = describe(units);
        desc.ranks = &rank[r].ranks;
        room_solve(&rank[r].s, &room, desc, 0);
    }
    for (uint32_t r = 0; r < RANKS; r++) assert_int_equal(pthread_create(&thread[r], NULL, run, &rank[r]), 0);
    for (uint32_t r = 0; r < RANKS; r++) pthread_join(thread[r], NULL);
    for (uint32_t r = 0; r < RANKS; r++) assert_true(room_expect_same(&rank[r].s, &one) > 7);
    assert_true(meeting.radiated > 0 && meeting.lit > 0);
    /* Each does a part of the rays, and no ray is shot twice. */
    for (uint32_t r = 0; r < RANKS; r++) assert_true(20 * rank[r].s.rays > one.rays);
    assert_true(rank[0].s.rays + rank[1].s.rays == one.rays);
    for (uint32_t r = 0; r < RANKS; r++) room_finish(&rank[r].s);
    pthread_barrier_destroy(&meeting.barrier);
    room_finish(&one);
}

static void without_a_budget(void **state) {
    (void)state;
    ranks_have_the_light_of_one(0);
}

static void within_a_budget_of_units(void **state) {
    (void)state;
    ranks_have_the_light_of_one(700);
}

/* What ranks do not share is refused, by name. */
static void what_they_do_not_share_is_refused(void **state) {
    (void)state;
    struct room room = room_with_two_lamps();
    struct room_solution s;
    struct lw_solver *solver = NULL;
    const struct lw_ranks ranks = {.count = 1};
    room_solve(&s, &room, describe(0), 0);
    struct lw_solver_desc desc[] = {describe(0), describe(0)};
    static const char *const text[] = {"--tracing-range does not work with ranks",
                                       "--frame-budget-ms does not work with ranks"};
    desc[0].tracing_range_m = 1;
    desc[1].frame_budget_s = 1;
    for (int i = 0; i < 2; i++) {
        struct lw_error err = {0};
        desc[i].scene = s.scene;
        desc[i].atlas_map = &s.map;
        desc[i].ranks = &ranks;
        lw_support_fails(lw_solvers_create("cells", &desc[i], &s.pose, &solver, &err), LW_USAGE, &err,
                         text[i]);
    }
    room_finish(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(without_a_budget),
                                       cmocka_unit_test(within_a_budget_of_units),
                                       cmocka_unit_test(what_they_do_not_share_is_refused)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
