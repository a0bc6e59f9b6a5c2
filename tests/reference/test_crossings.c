/* Surfaces that cut charts, at coarse texels: what a look-up beside the cut reads. A floor through a
 * partition or out of doors, a wall above a ceiling, picture rails before a wall. Direct light alone. */
#include "tests/reference/room.h"

#include "server/solve/surface/texels.h"

#include <math.h>

#define DENSITY 5 /* texels per metre: the programs' default */

/* E of a point light of intensity 1, without shadows. */
static double of_lamp(struct lw_vec3 lamp, struct lw_vec3 p, struct lw_vec3 n) {
    const struct lw_vec3 d = lw_vec3_sub(lamp, p);
    const double distance = (double)lw_vec3_length(d);
    return fmax(0, (double)lw_vec3_dot(d, n)) / (distance * distance * distance);
}

static void add_lamp(struct room *room, struct lw_vec3 at, float intensity) {
    room->light[room->light_count] =
        (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {intensity, intensity, intensity}};
    room->light_position[room->light_count++] = at;
}

static double look_up(const struct room_solution *s, uint32_t quad, double along_u, double along_v) {
    return (double)room_look_up(s, quad, along_u, along_v).x;
}

/* Quad 0 is a wall at x = 0, 4 m long. Its look-ups between two heights give the light of this lamp. */
static void expect_lamp_on_wall(const struct room_solution *s, struct lw_vec3 lamp, float height, float from,
                                float to, float step) {
    for (float y = from; y < to; y += step)
        for (float z = 0.5f; z < 3.5f; z += 0.05f) {
            const double want = of_lamp(lamp, lw_vec3(0, y, z), lw_vec3(1, 0, 0)),
                         got = look_up(s, 0, (double)(y / height), (double)(z / 4));
            /* where a texel stands for what it only partly is, E is that of 0.2 m away: 15 % */
            if (!(fabs(got / want - 1) < 0.15))
                fail_msg("wall of %g m: E = %g, not %g at (%g, %g)", (double)height, got, want, (double)y,
                         (double)z);
        }
}

/* ---- two rooms on one floor ---- */

#define ANGLE 0.1f /* angle of the partition: it cuts the texels of the floor everywhere */

struct floor_of_two {
    unsigned lit, dark;
};

static const struct lw_vec3 lamp_of_two = {1, 1.5f, 0};

static void check_side(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    (void)area, (void)indirect;
    struct floor_of_two *count = user;
    const double beyond = (double)(p.x - 2) * cos((double)ANGLE) - (double)p.z * sin((double)ANGLE);
    if (fabs(beyond) < 0.01) return; /* a centimetre: either side's */
    if (beyond > 0) {
        count->dark++;
        if (direct > 0) fail_msg("(%g, %g) in the dark room has E = %g", (double)p.x, (double)p.z, direct);
        return;
    }
    count->lit++;
    const double want = of_lamp(lamp_of_two, p, lw_vec3(0, 1, 0));
    /* points of one side of a texel lie up to half a texel from its middle, where E is by 8 % another */
    if (!(fabs(direct / want - 1) < 0.1))
        fail_msg("(%g, %g) in the lit room has E = %g, not %g", (double)p.x, (double)p.z, direct, want);
}

static void test_a_floor_through_a_partition(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = DENSITY};
    const struct lw_vec3 along = lw_vec3(6 * sinf(ANGLE), 0, 6 * cosf(ANGLE));
    room_quad(&room, lw_vec3(0, 0, -2), lw_vec3(0, 0, 4), lw_vec3(4, 0, 0), 0.5f, 0);
    room_quad(&room, lw_vec3_mad(lw_vec3(2, -0.1f, 0), along, -0.5f), along, lw_vec3(0, 3, 0), 0.5f, 0);
    room.quad[1].double_sided = true;
    add_lamp(&room, lamp_of_two, 1);
    struct room_solution solution;
    struct floor_of_two count = {0};
    room_solve(&solution, &room, (struct lw_solver_desc){0}, 16);
    room_each_texel(&solution, 0, check_side, &count);
    assert_true(count.lit > 150 && count.dark > 150);
    room_finish(&solution);
}

/* ---- a wall that goes on above a ceiling ---- */

/* Above the ceiling it is a thousand times as bright. */
static void test_a_wall_above_a_ceiling(void **state) {
    (void)state;
    const struct lw_vec3 lamp = lw_vec3(2, 1, 2);
    const float strip[] = {0.02f, 0.05f, 0.08f, 0.11f};
    for (unsigned k = 0; k < sizeof strip / sizeof *strip; k++) {
        struct room room = {.texels_per_metre = DENSITY};
        const float height = 2 + strip[k];
        room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, height, 0), lw_vec3(0, 0, 4), 0.5f, 0); /* facing +X */
        room_quad(&room, lw_vec3(-0.5f, 2, -1), lw_vec3(0, 0, 6), lw_vec3(6, 0, 0), 0.5f, 0);
        room.quad[1].double_sided = true;
        add_lamp(&room, lamp, 1);
        add_lamp(&room, lw_vec3(2, 3, 2), 1000);
        struct room_solution solution;
        room_solve(&solution, &room, (struct lw_solver_desc){0}, 16);
        expect_lamp_on_wall(&solution, lamp, height, 1.6f, 2, 0.05f);
        room_finish(&solution);
    }
}

/* ---- a wall that goes on under water ---- */

/* The water is seen from above alone, and all under it is dark. Over it the wall may have few texels, or less
 * than one. */
static void test_a_wall_that_goes_on_under_water(void **state) {
    (void)state;
    const struct lw_vec3 lamp = lw_vec3(2, 1.5f, 2);
    const float shown[] = {0.05f, 0.1f, 0.15f, 0.25f};
    for (unsigned k = 0; k < sizeof shown / sizeof *shown; k++) {
        struct room room = {.texels_per_metre = DENSITY};
        const float height = 1 + shown[k];
        room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, height, 0), lw_vec3(0, 0, 4), 0.5f, 0); /* facing +X */
        room_quad(&room, lw_vec3(-0.05f, 1, -1), lw_vec3(0, 0, 6), lw_vec3(6, 0, 0), 0.5f, 0);
        add_lamp(&room, lamp, 1);
        struct room_solution solution;
        room_solve(&solution, &room, (struct lw_solver_desc){0}, 16);
        expect_lamp_on_wall(&solution, lamp, height, 1.01f, height, 0.01f);
        room_finish(&solution);
    }
}

/* ---- a floor that goes on out of doors ---- */

/* A hut without a floor of its own, and the sun outside, a thousand times as bright as the lamp. The hut's
 * first wall stands anywhere on the texels. */
static void test_a_floor_that_goes_on_out_of_doors(void **state) {
    (void)state;
    for (int i = 0; i < 4; i++) {
        const float x = 0.05f * (float)i, size = 3;
        const struct lw_vec3 lamp = lw_vec3(x + 1.5f, 1.5f, 0), u = lw_vec3(size, 0, 0),
                             v = lw_vec3(0, 2.5f, 0), w = lw_vec3(0, 0, size),
                             corner = lw_vec3(x, -0.1f, -1.5f);
        struct room room = {.texels_per_metre = DENSITY};
        room_quad(&room, lw_vec3(-4, 0, -6), lw_vec3(0, 0, 12), lw_vec3(12, 0, 0), 0.5f, 0);
        room_quad(&room, corner, w, v, 0.5f, 0);
        room_quad(&room, lw_vec3_add(corner, u), w, v, 0.5f, 0);
        room_quad(&room, corner, u, v, 0.5f, 0);
        room_quad(&room, lw_vec3_add(corner, w), u, v, 0.5f, 0);
        room_quad(&room, lw_vec3_add(corner, v), w, u, 0.5f, 0);
        for (uint32_t q = 1; q < room.quad_count; q++) room.quad[q].double_sided = true;
        add_lamp(&room, lamp, 1);
        room.light[room.light_count++] =
            (struct lw_light){.kind = LW_LIGHT_DIRECTIONAL, .intensity = {1000, 1000, 1000}};
        struct room_solution solution;
        room_solve(&solution, &room, (struct lw_solver_desc){0}, 16);
        for (float z = -1; z < 1; z += 0.05f) {
            for (float d = 0.02f; d < 0.4f; d += 0.04f) {
                const struct lw_vec3 p = lw_vec3(x + d, 0, z);
                const double want = of_lamp(lamp, p, lw_vec3(0, 1, 0)),
                             got = look_up(&solution, 0, (double)(p.z + 6) / 12, (double)(p.x + 4) / 12);
                /* up to a texel from where it is looked up */
                if (!(fabs(got / want - 1) < 0.25))
                    fail_msg("wall at %g: E = %g, not %g at (%g, %g)", (double)x, got, want, (double)p.x,
                             (double)z);
            }
            const double outside = look_up(&solution, 0, (double)(z + 6) / 12, (double)(x - 0.5f + 4) / 12);
            assert_true(fabs(outside / 1000 - 1) < 0.01);
        }
        room_finish(&solution);
    }
}

/* ---- what hangs close before a wall ---- */

/* Relative standard deviation of look-ups on a wall 4 m wide and 2 m high along a line, from (x0, y0) to
 * (x1, y1). */
static double variation(const struct room_solution *s, double x0, double y0, double x1, double y1) {
    double sum = 0, squares = 0;
    const int count = 400;
    for (int i = 0; i < count; i++) {
        const double f = (i + 0.5) / count,
                     e = look_up(s, 0, (x0 + f * (x1 - x0)) / 4, (y0 + f * (y1 - y0)) / 2);
        sum += e;
        squares += e * e;
    }
    return sqrt(fmax(0, squares * count / (sum * sum) - 1));
}

/* Rails, and a board as high as three texels, whose edges run aslant by a texel over their length. A lamp
 * far off shines straight at them: the wall beside them has E = 1 to 1 in 1,000. */
static void test_a_rail_before_a_wall(void **state) {
    (void)state;
    const float wide[] = {0.03f, 0.08f, 0.6f};
    for (unsigned k = 0; k < sizeof wide / sizeof *wide; k++) {
        struct room room = {.texels_per_metre = DENSITY};
        add_lamp(&room, lw_vec3(2, 1, 100), 1e4f);
        room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(4, 0, 0), lw_vec3(0, 2, 0), 0.5f, 0); /* facing +Z */
        room_quad(&room, lw_vec3(0, 1, 0.01f), lw_vec3(4, 0.2f, 0), lw_vec3(0, wide[k], 0), 0.5f, 0);
        room.quad[1].double_sided = true;
        struct room_solution solution;
        room_solve(&solution, &room, (struct lw_solver_desc){0}, 16);
        const double below = variation(&solution, 0.3, 1.015 - 0.03, 3.7, 1.185 - 0.03),
                     above = variation(&solution, 0.3, 1.015 + (double)wide[k] + 0.03, 3.7,
                                       1.185 + (double)wide[k] + 0.03);
        print_message("rail %g m: below %.4f, above %.4f\n", (double)wide[k], below, above);
        if (!(below < 0.02 && above < 0.02))
            fail_msg("a rail of %g m: E varies by %.3f below, %.3f above", (double)wide[k], below, above);
        room_finish(&solution);
    }
}

/* ---- mouldings: strips far narrower than a texel ---- */

/* Along the top of a wall a cornice of four steps, then a picture rail and a skirting, from 1.5 cm to 8 cm:
 * fronts, and undersides or tops. A lamp before them sees all of each. */
static void test_mouldings(void **state) {
    (void)state;
    const struct lw_vec3 lamp = lw_vec3(2, 1, 3), along = lw_vec3(4, 0, 0), out = lw_vec3(0, 0, 1);
    const struct {
        float low, high, depth, from; /* m; from: the depth of the surface under it */
    } step[] = {{2.68f, 2.70f, 0.08f, 0.06f}, {2.66f, 2.68f, 0.06f, 0.04f}, {2.64f, 2.66f, 0.04f, 0.02f},
                {2.62f, 2.64f, 0.02f, 0.0f},  {2.10f, 2.13f, 0.02f, 0.0f},  {0.00f, 0.08f, 0.015f, 0.0f}};
    struct room room = {.texels_per_metre = DENSITY};
    room_quad(&room, lw_vec3(0, 0, 0), along, lw_vec3(0, 2.7f, 0), 0.5f, 0);
    room_quad(&room, lw_vec3(0, 2.7f, 0), along, lw_vec3(0, 0, 4), 0.5f, 0); /* the ceiling, facing down */
    for (unsigned k = 0; k < sizeof step / sizeof *step; k++) {
        const bool is_skirting = step[k].low == 0;
        const float y = is_skirting ? step[k].high : step[k].low, wide = step[k].depth - step[k].from;
        room_quad(&room, lw_vec3(0, step[k].low, step[k].depth), along,
                  lw_vec3(0, step[k].high - step[k].low, 0), 0.5f, 0);
        if (is_skirting) /* its top */
            room_quad(&room, lw_vec3(0, y, step[k].depth), along, lw_vec3_scale(out, -wide), 0.5f, 0);
        else
            room_quad(&room, lw_vec3(0, y, step[k].from), along, lw_vec3_scale(out, wide), 0.5f, 0);
    }
    add_lamp(&room, lamp, 1);
    struct room_solution solution;
    room_solve(&solution, &room, (struct lw_solver_desc){0}, 16);
    for (uint32_t q = 2; q < room.quad_count; q++) {
        const struct room_quad *quad = &room.quad[q];
        const struct lw_vec3 n = lw_vec3_normalize(lw_vec3_cross(quad->edge_u, quad->edge_v));
        for (float u = 0.02f; u < 1; u += 0.01f)
            for (float v = 0.1f; v < 1; v += 0.2f) {
                const struct lw_vec3 p =
                    lw_vec3_mad(lw_vec3_mad(quad->corner, quad->edge_u, u), quad->edge_v, v);
                const double want = of_lamp(lamp, p, n), got = look_up(&solution, q, (double)u, (double)v);
                assert_true(want > 0);
                /* within a texel of 0.2 m E changes by up to 15 % */
                if (!(fabs(got / want - 1) < 0.15))
                    fail_msg("quad %u: E = %g, not %g at (%g, %g)", q, got, want, (double)u, (double)v);
            }
    }
    room_finish(&solution);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_floor_through_a_partition),
        cmocka_unit_test(test_a_wall_above_a_ceiling),
        cmocka_unit_test(test_a_wall_that_goes_on_under_water),
        cmocka_unit_test(test_a_floor_that_goes_on_out_of_doors),
        cmocka_unit_test(test_a_rail_before_a_wall),
        cmocka_unit_test(test_mouldings),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
