/* What works together: every pair of choices either starts and lights a scene, or is refused by one line that
 * names both. The list of pairs that are refused stands here once more, so that the table cannot lose one. */
#include "tests/reference/room.h"

#include "common/light/client_lights.h"
#include "common/tile/tile_codec.h"
#include "server/publish/publisher.h"
#include "server/solve/adapt/ranks.h"

#include <stdio.h>
#include <string.h>

#define NAME(name, text) #name,
static const char *const ids[] = {LW_CHOICES(NAME)};

/* One line for each pair. */
static const char *const refused[] = {
    "RADIOSITY SERVED",
    "RADIOSITY GROUPS",
    "RADIOSITY DIRECTIONAL",
    "RADIOSITY TRACING_RANGE",
    "RADIOSITY BUDGET",
    "RADIOSITY VPL_TERMS",
    "RADIOSITY DRAWN_SURFACES",
    "VPL SERVED",
    "VPL GROUPS",
    "VPL DIRECTIONAL",
    "VPL TRACING_RANGE",
    "VPL BUDGET",
    "VPL UNDERSAMPLE",
    "VPL WINDOW",
    "VPL SUBDIVIDE",
    "VPL DIRECTIONS",
    "VPL VISIBILITY",
    "CELLS UNDERSAMPLE",
    "CELLS WINDOW",
    "CELLS SUBDIVIDE",
    "CELLS DIRECTIONS",
    "CELLS VISIBILITY",
    "CELLS VPL_TERMS",
    "UNDERSAMPLE SUBDIVIDE",
    "SUBDIVIDE DIRECTIONS",
    "SUBDIVIDE VISIBILITY",
    "UNDERSAMPLE DIRECTIONS",
    "DIRECTIONS VISIBILITY",
    "HALF STEP_WIDEST",
    "STEP BUDGET",
    "MANUAL BUDGET",
    "RADIOSITY UNITS",
    "VPL UNITS",
    "REAL UNITS",
    "BUDGET UNITS",
    "RADIOSITY RANKS",
    "VPL RANKS",
    "GROUPS RANKS",
    "TRACING_RANGE RANKS",
    "BUDGET RANKS",
    "ANIMATE FREEZE",
};

static bool is_refused(uint32_t a, uint32_t b) {
    char pair[64];
    snprintf(pair, sizeof pair, "%s %s", ids[a], ids[b]);
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++)
        if (strcmp(refused[i], pair) == 0) return true;
    return false;
}

#define SOLVERS (LW_CHOICE_CELLS | LW_CHOICE_RADIOSITY | LW_CHOICE_VPL)
#define CODECS  (LW_CHOICE_HALF | LW_CHOICE_DCT)
#define CLOCKS  (LW_CHOICE_REAL | LW_CHOICE_STEP | LW_CHOICE_MANUAL)

/* One has one of each. */
static bool are_of_a_kind(uint32_t both) {
    return __builtin_popcount(both & SOLVERS) == 2 || __builtin_popcount(both & CODECS) == 2 ||
           __builtin_popcount(both & CLOCKS) == 2;
}

static void each_pair_is_refused_or_not(void **state) {
    (void)state;
    uint32_t pairs = 0, lines = 0;
    for (uint32_t a = 0; a < LW_CHOICE_COUNT; a++)
        for (uint32_t b = a + 1; b < LW_CHOICE_COUNT; b++) {
            const uint32_t both = 1u << a | 1u << b;
            struct lw_error err = {0};
            const enum lw_status status = lw_combinations_check(both, &err);
            if (are_of_a_kind(both)) {
                assert_int_equal(status, LW_OK);
                continue;
            }
            pairs++;
            if ((status == LW_USAGE) != is_refused(a, b)) fail_msg("%s and %s: %s", ids[a], ids[b], err.text);
            if (status == LW_OK) continue;
            lines++;
            assert_int_equal(status, LW_USAGE);
            assert_non_null(strstr(err.text, lw_combinations_name((enum lw_choice_index)a)));
            assert_non_null(strstr(err.text, lw_combinations_name((enum lw_choice_index)b)));
            assert_null(strchr(err.text, '\n'));
        }
    assert_int_equal(lines, sizeof refused / sizeof *refused);
    print_message("%u pairs, of which %u are refused\n", pairs, lines);
}

/* ---- those that work do start ---- */

static const struct lw_solvers_entry *entry_of(uint32_t choices) {
    const struct lw_solvers_entry *entry;
    const uint32_t shots = LW_CHOICE_UNDERSAMPLE | LW_CHOICE_WINDOW | LW_CHOICE_SUBDIVIDE |
                           LW_CHOICE_DIRECTIONS | LW_CHOICE_VISIBILITY;
    uint32_t wanted = choices & SOLVERS;
    if (!wanted)
        wanted = choices & shots                 ? LW_CHOICE_RADIOSITY
                 : choices & LW_CHOICE_VPL_TERMS ? LW_CHOICE_VPL
                                                 : LW_CHOICE_CELLS;
    for (unsigned i = 0; (entry = lw_solvers_at(i)) && entry->choice != wanted; i++) {
    }
    assert_non_null(entry);
    return entry;
}

struct start {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_light_groups groups;
    struct lw_client_lights lamps, surfaces;
};

static void exchange(void *user, const struct lw_ranks_exchange *what) { (void)user, (void)what; }
static const struct lw_ranks alone = {.count = 1, .exchange = exchange};

static struct lw_solver_desc desc_of(const struct start *s, uint32_t choices) {
    return (struct lw_solver_desc){
        .scene = s->scene,
        .atlas_map = &s->map,
        .bounces = 1,
        .direct_samples = 1,
        .indirect_samples = 1,
        .target_error = 0.5f,
        .threads = 1,
        .directions = (choices & LW_CHOICE_DIRECTIONAL) != 0,
        .tracing_range_m = choices & LW_CHOICE_TRACING_RANGE ? 1 : INFINITY,
        .light_groups = choices & LW_CHOICE_GROUPS ? &s->groups : NULL,
        .client_lights = choices & LW_CHOICE_DRAWN_SURFACES ? &s->surfaces
                         : choices & LW_CHOICE_SPLIT        ? &s->lamps
                                                            : NULL,
        .frame_budget_s = choices & LW_CHOICE_BUDGET ? 0.01 : 0,
        .frame_budget_units = choices & LW_CHOICE_UNITS ? 1000 : 0,
        .ranks = choices & LW_CHOICE_RANKS ? &alone : NULL,
        /* a window needs something to choose in it */
        .radiosity = {.undersample = choices & (LW_CHOICE_UNDERSAMPLE | LW_CHOICE_WINDOW)
                                         ? LW_UNDERSAMPLE_MIP
                                         : LW_UNDERSAMPLE_NONE,
                      .window = choices & LW_CHOICE_WINDOW ? 2 : 0,
                      .subdivide = choices & LW_CHOICE_SUBDIVIDE ? 0.1f : 0,
                      .directions = choices & LW_CHOICE_DIRECTIONS ? 8 : 0,
                      .keeps_visibility = (choices & LW_CHOICE_VISIBILITY) != 0},
        .vpl = {.lights = choices & LW_CHOICE_VPL_TERMS ? 16 : 0}};
}

/* A frame in all channels that the solver shows, published. */
static void start(const struct start *s, uint32_t choices) {
    const struct lw_solvers_entry *entry = entry_of(choices);
    const struct lw_solver_desc desc = desc_of(s, choices);
    struct lw_solver *solver;
    struct lw_publisher *publisher;
    struct lw_snapshot *snapshot;
    struct lw_solver_stats stats;
    struct lw_publisher_stats published;
    struct lw_error err = {0};
    const bool splits = choices & (LW_CHOICE_SPLIT | LW_CHOICE_DRAWN_SURFACES);
    const uint32_t channels = entry->channels & lw_tile_channels_held(splits, desc.directions);
    lw_support_ok(lw_combinations_check(entry->choice | lw_combinations_of(&desc), &err), &err);
    lw_support_ok(entry->create(&desc, &s->pose, &solver, &err), &err);
    solver->ops->choose_channels(solver, channels);
    lw_support_ok(solver->ops->frame(solver, &s->pose, 1, &stats, &err), &err);
    assert_true(stats.tiles_solved > 0);
    lw_support_ok(lw_publisher_create(&(struct lw_publisher_desc){.scene = s->scene,
                                                                  .atlas_map = &s->map,
                                                                  .solver = solver,
                                                                  .target_error = 0.5f,
                                                                  .codec = choices & LW_CHOICE_HALF
                                                                               ? LW_TILE_CODEC_HALF_ZSTD
                                                                               : LW_TILE_CODEC_DCT,
                                                                  .threads = 1},
                                      &publisher),
                  NULL);
    lw_support_ok(lw_publisher_set_channels(publisher, channels), NULL);
    lw_support_ok(lw_publisher_publish(publisher, &s->pose, 1, 1, 1, 1, &snapshot, &published), NULL);
    assert_int_equal(snapshot->channels, channels);
    assert_true(published.tiles_encoded > 0);
    lw_snapshot_unref(snapshot);
    lw_publisher_destroy(publisher);
    solver->ops->destroy(solver);
}

static void what_works_starts(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    struct room_solution s;
    struct lw_error err = {0};
    room_solve_scene(&s, room_scene(&room), 1, (struct lw_solver_desc){.direct_samples = 1}, 0);
    struct start of = {.scene = s.scene, .map = s.map, .pose = s.pose};
    lw_support_ok(lw_light_groups_init(&of.groups, s.scene, &s.pose, "left", &err), &err);
    lw_support_ok(lw_client_lights_init(&of.lamps, s.scene, &s.pose, "lamps", &err), &err);
    lw_support_ok(lw_client_lights_init(&of.surfaces, s.scene, &s.pose, "auto", &err), &err);
    assert_true(of.groups.count == 2 && of.lamps.drawn_lights && of.surfaces.drawn_materials);
    uint32_t started = 0;
    for (uint32_t a = 0; a < LW_CHOICE_COUNT; a++)
        for (uint32_t b = a + 1; b < LW_CHOICE_COUNT; b++) {
            const uint32_t both = 1u << a | 1u << b;
            /* the programs' own are tested with them */
            if ((both & (LW_CHOICE_SERVED | CLOCKS | LW_CHOICE_ANIMATE | LW_CHOICE_FREEZE |
                         LW_CHOICE_STEP_WIDEST)) ||
                are_of_a_kind(both) || is_refused(a, b))
                continue;
            /* the solver of one choice may refuse the second choice */
            const struct lw_solver_desc desc = desc_of(&of, both);
            if (lw_combinations_check(entry_of(both)->choice | lw_combinations_of(&desc), NULL) != LW_OK)
                continue;
            start(&of, both);
            started++;
        }
    print_message("%u pairs started\n", started);
    assert_true(started > 50);
    lw_client_lights_finish(&of.surfaces);
    lw_client_lights_finish(&of.lamps);
    lw_light_groups_finish(&of.groups);
    room_finish(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(each_pair_is_refused_or_not),
                                       cmocka_unit_test(what_works_starts)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
