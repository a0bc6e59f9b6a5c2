/* Solids that touch, or end in one another, hide texels where no light comes, of whatever size and faces they
 * are; spaces that light reaches keep all of theirs. */
#include "tests/reference/room.h"

#define DENSITY 10 /* texels per metre */

/* A closed box whose faces look outward. Returns its first quad: the ones that look along -x and +x come
 * first. */
static uint32_t box(struct room *room, struct lw_vec3 low, struct lw_vec3 high, float albedo,
                    bool double_sided) {
    const uint32_t first = room->quad_count;
    const struct lw_vec3 size = lw_vec3_sub(high, low), x = lw_vec3(size.x, 0, 0), y = lw_vec3(0, size.y, 0),
                         z = lw_vec3(0, 0, size.z);
    room_quad(room, low, z, y, albedo, 0);
    room_quad(room, lw_vec3_add(low, x), y, z, albedo, 0);
    room_quad(room, low, x, z, albedo, 0);
    room_quad(room, lw_vec3_add(low, y), z, x, albedo, 0);
    room_quad(room, low, y, x, albedo, 0);
    room_quad(room, lw_vec3_add(low, z), x, y, albedo, 0);
    for (uint32_t q = first; q < room->quad_count; q++) room->quad[q].double_sided = double_sided;
    return first;
}

struct found {
    double darkest, mean;
    uint32_t count;
};

static void note(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    struct found *found = user;
    (void)p, (void)area, (void)indirect;
    found->darkest = fmin(found->darkest, direct);
    found->mean += direct;
    found->count++;
}

static struct found texels_of(const struct room_solution *solution, uint32_t quad) {
    struct found found = {.darkest = (double)INFINITY};
    room_each_texel(solution, quad, note, &found);
    found.mean /= found.count ? found.count : 1;
    return found;
}

/* The end of a wall, 2 m high, black under an even sky. A black beam as wide as a house, with double-sided
 * faces, lies before its upper half, `gap` away. Under an endless beam a quarter of the sky is seen: E is
 * pi/2; this beam ends, and E is more. */
static void expect_end_of_wall(float gap, float beam_foot) {
    struct room room = {.texels_per_metre = DENSITY, .sky = 1};
    const uint32_t end = box(&room, lw_vec3(-1, -1, -1), lw_vec3(0, 1, 1), 0, false) + 1;
    box(&room, lw_vec3(gap, beam_foot, -6), lw_vec3(12, 8, 6), 0, true);
    struct room_solution solution;
    room_solve(&solution, &room, (struct lw_solver_desc){.direct_samples = 8}, 64);
    const struct found found = texels_of(&solution, end);
    assert_in_range(found.count, 20 * 10, 20 * 12);
    if (found.darkest < 0.95 * acos(-1.0) / 2)
        fail_msg("gap %g m, foot at %g m: a texel reads %.3f", (double)gap, (double)beam_foot, found.darkest);
    room_finish(&solution);
}

static void solids_that_touch_leave_no_dark_texel(void **state) {
    (void)state;
    for (int i = 0; i < 3; i++) expect_end_of_wall(0, 0.03f * (float)i);
}

static void solids_that_end_in_one_another_leave_none(void **state) {
    (void)state;
    expect_end_of_wall(-0.05f, 0.03f);
}

/* A room whose faces look outward, as those of a box do that somebody works in. Lamp: E is that of a lamp of
 * 1 W/sr in the middle of a cube of 4 m, 4 pi / 6 / 16 m^2 on a face in the mean. */
static void rooms_with_a_lamp_keep_their_texels(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = DENSITY};
    const uint32_t first = box(&room, lw_vec3(-2, -2, -2), lw_vec3(2, 2, 2), 0.5f, true);
    room.light[room.light_count++] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {1, 1, 1}};
    struct room_solution solution;
    room_solve(&solution, &room, (struct lw_solver_desc){.direct_samples = 8}, 16);
    for (uint32_t q = first; q < first + 6; q++) {
        const struct found found = texels_of(&solution, q);
        assert_true(found.count >= 2 * 40 * 40); /* the outside, too */
        expect_near(2 * found.mean, 4 * acos(-1.0) / 6 / 16, 0.02);
    }
    room_finish(&solution);
}

/* The same room without a lamp, under a sky that is seen through a window of a twentieth of one wall. Few
 * texels are lost: no walk of theirs has found the window. */
static void rooms_with_a_window_keep_theirs(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = DENSITY, .sky = 1};
    const uint32_t first = box(&room, lw_vec3(-2, -2, -2), lw_vec3(2, 2, 2), 0.5f, true);
    room.quad[first + 1].edge_u = lw_vec3(0, 3.8f, 0);
    struct room_solution solution;
    room_solve(&solution, &room, (struct lw_solver_desc){.direct_samples = 8, .bounces = 1}, 4);
    uint32_t count = 0;
    for (uint32_t q = first; q < first + 6; q++) count += texels_of(&solution, q).count;
    assert_in_range(count, 0.9 * 2 * 40 * (5 * 40 + 38), 2 * 41 * 6 * 41);
    room_finish(&solution);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(solids_that_touch_leave_no_dark_texel),
        cmocka_unit_test(solids_that_end_in_one_another_leave_none),
        cmocka_unit_test(rooms_with_a_lamp_keep_their_texels),
        cmocka_unit_test(rooms_with_a_window_keep_theirs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
