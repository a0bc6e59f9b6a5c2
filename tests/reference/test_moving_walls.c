/* Closed rooms with walls that clients move: once they stand they part light as if they had always stood
 * there (standing.h), by frames and not by a clock. */
#include "tests/reference/house.h"

#include "server/solve/surface/standing.h"

#define SETTLED 10u /* frames */
/* Share of the lamp's light that the ground out of doors may still have after that. */
#define STRAY 0.01

static const struct house boxes = {
    .kind = HOUSE_BOXES, .thick = 0.1f, .angle = 0.3f, .shift_x = 0.13f, .density = 3, .filtered = true};
static const struct house sheets = {.kind = HOUSE_SHEETS, .angle = 0.3f, .shift_z = 0.07f, .density = 3};
static const struct house doubled = {.kind = HOUSE_DOUBLED, .density = 3};
/* Its ground has four tiles, and the room parts of all. */
static const struct house wide = {.kind = HOUSE_SHEETS, .angle = 0.3f, .density = 10};
static const struct house coarse = {.kind = HOUSE_SHEETS, .angle = 0.3f, .density = 1.5f};
static const struct lw_solver_desc terms = {.bounces = 2, .tracing_range_m = INFINITY, .target_error = 0.02f};

/* A house and its solution, frame by frame. */
struct moving {
    const struct house *house;
    struct room_solution solution;
    uint64_t frame;
    double lamp; /* on the floor of the same house without movers, W/m^2 */
};

static void begin(struct moving *m, const struct house *house, const char *groups) {
    const struct room room = house_build(house);
    struct lw_solver_desc desc = terms;
    desc.denoise = house->filtered;
    *m = (struct moving){.house = house};
    room_solve(&m->solution, &room, desc, SETTLED);
    m->lamp = house_lamp_on_floor(&m->solution, house);
    room_finish(&m->solution);
    if (groups)
        room_solve_layers(&m->solution, room_scene(&room), house->density, desc, groups, 0);
    else
        room_solve(&m->solution, &room, desc, 0);
}

/* Puts a part of the house by that much along its X from where the file has it. */
static void put(struct moving *m, enum house_part part, float x_m) {
    const struct house_quads quads = house_quads(m->house, part);
    const struct lw_vec3 by = house_along(m->house, x_m, 0, 0);
    struct lw_pose *pose = &m->solution.pose;
    for (uint32_t o = quads.first; o < quads.first + quads.count; o++) {
        pose->object_dynamic[o] = true;
        pose->object_to_world[o].m[0][3] = by.x;
        pose->object_to_world[o].m[2][3] = by.z;
    }
}

static void hide(struct moving *m, enum house_part part, bool hidden) {
    const struct house_quads quads = house_quads(m->house, part);
    for (uint32_t o = quads.first; o < quads.first + quads.count; o++)
        m->solution.pose.object_dynamic[o] = true, m->solution.pose.object_hidden[o] = hidden;
}

static void solve(struct moving *m, unsigned frames) {
    struct room_solution *s = &m->solution;
    for (unsigned f = 0; f < frames; f++) room_frame(s, ++m->frame);
}

static void expect_closed(const struct moving *m, enum house_part at_front) {
    const uint32_t inner = house_inner_face(m->house),
                   by = house_quads(m->house, at_front).first - house_quads(m->house, HOUSE_FRONT_X).first;
    print_message("frame %u: the floor has %.3g W/m^2 of the lamp and %.3g of the sun\n", (unsigned)m->frame,
                  house_lamp_on_floor(&m->solution, m->house), house_sun_on_floor(&m->solution, m->house));
    house_expect_apart(&m->solution, m->house, inner + by, STRAY * m->lamp);
    expect_near(house_lamp_on_floor(&m->solution, m->house), m->lamp, 0.02);
}

/* One wall is placed, taken away, and put back in the other's place, and that in its. */
static void walk_about(const struct house *house, const char *groups) {
    struct moving m;
    const float across = 2 * HOUSE_HALF + house->thick;
    begin(&m, house, groups);
    hide(&m, HOUSE_FRONT_X, true);
    solve(&m, 2);
    hide(&m, HOUSE_FRONT_X, false);
    solve(&m, SETTLED);
    expect_closed(&m, HOUSE_FRONT_X);
    put(&m, HOUSE_FRONT_X, 3);
    solve(&m, LW_STANDING_FRAMES);
    put(&m, HOUSE_FRONT_X, -across);
    put(&m, HOUSE_BACK_X, across);
    solve(&m, SETTLED);
    expect_closed(&m, HOUSE_BACK_X);
    room_finish(&m.solution);
}

static void test_boxes(void **state) {
    (void)state;
    walk_about(&boxes, NULL);
}

static void test_sheets(void **state) {
    (void)state;
    walk_about(&sheets, NULL);
}

static void test_doubled_sheets(void **state) {
    (void)state;
    walk_about(&doubled, NULL);
}

static void test_layers(void **state) {
    (void)state;
    walk_about(&boxes, "lamp;sun");
}

/* While it is away the room and what lies out of doors are one side, in tiles far from it, too. */
static void test_far_from_the_wall(void **state) {
    (void)state;
    struct moving m;
    begin(&m, &wide, NULL);
    hide(&m, HOUSE_FRONT_X, true);
    solve(&m, 4);
    hide(&m, HOUSE_FRONT_X, false);
    solve(&m, SETTLED);
    expect_closed(&m, HOUSE_FRONT_X);
    room_finish(&m.solution);
}

/* It slides away and back, a bit in every frame: it parts light again some frames after it has come to
 * rest. */
static void test_sliding(void **state) {
    (void)state;
    struct moving m;
    begin(&m, &boxes, NULL);
    solve(&m, 2);
    for (int step = 1; step <= 8; step++) {
        put(&m, HOUSE_FRONT_X, 0.1f * (float)(step < 4 ? step : 8 - step));
        solve(&m, 1);
    }
    solve(&m, LW_STANDING_FRAMES + SETTLED);
    expect_closed(&m, HOUSE_FRONT_X);
    room_finish(&m.solution);
}

/* Every pose begins another solution: radiosity and virtual point lights. */
static void test_other_solvers(void **state) {
    (void)state;
    const char *const names[] = {"radiosity", "vpl"};
    for (unsigned k = 0; k < sizeof names / sizeof *names; k++) {
        const struct room room = house_build(&coarse);
        struct moving m = {.house = &coarse};
        room_solve_by(&m.solution, &room, names[k], (struct lw_solver_desc){.bounces = 2}, 0);
        hide(&m, HOUSE_FRONT_X, true);
        solve(&m, 1);
        hide(&m, HOUSE_FRONT_X, false);
        solve(&m, 2);
        house_expect_apart(&m.solution, m.house, 0, STRAY * (double)HOUSE_LAMP);
        room_finish(&m.solution);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_boxes),
        cmocka_unit_test(test_sheets),
        cmocka_unit_test(test_doubled_sheets),
        cmocka_unit_test(test_layers),
        cmocka_unit_test(test_far_from_the_wall),
        cmocka_unit_test(test_sliding),
        cmocka_unit_test(test_other_solvers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
