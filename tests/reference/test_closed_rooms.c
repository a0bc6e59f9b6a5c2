/* Closed rooms on a ground that runs through, a lamp inside and the sun outside: neither's light passes a
 * wall. The lamp is red and the sun blue, so that one solve tells them apart. Look-ups are those that an
 * engine reads: bilinear. The sun changes nothing inside by more than 1 %; a lamp lights nothing outside but
 * for the foot of a thin wall, whose texels the ground's two sides share. "long" asks the whole family. */
#include "tests/reference/house.h"

#include <math.h>
#include <string.h>

static void solve_apart(const struct house *h, unsigned frames) {
    const struct room room = house_build(h);
    struct room_solution s;
    room_solve(&s, &room,
               (struct lw_solver_desc){.bounces = 2, .denoise = h->filtered, .tracing_range_m = INFINITY},
               frames);
    house_expect_apart(&s, h, house_inner_face(h), 0.01);
    room_finish(&s);
}

static void each_kind(bool filtered, float density, unsigned frames) {
    const float thick[] = {0.02f, 0.1f, 0.3f, 1};
    for (unsigned turned = 0; turned < 2; turned++) {
        struct house h = {.angle = turned ? 0.3f : 0,
                          .shift_x = turned ? 0.13f : 0,
                          .shift_z = turned ? 0.07f : 0,
                          .density = density,
                          .filtered = filtered};
        for (unsigned k = 0; k < sizeof thick / sizeof *thick; k++) {
            h.thick = thick[k];
            solve_apart(&h, frames);
        }
        h.thick = 0;
        for (h.kind = HOUSE_SHEETS; h.kind <= HOUSE_DOUBLED; h.kind++) solve_apart(&h, frames);
    }
}

static void test_bare(void **state) {
    (void)state;
    each_kind(false, 5, 4);
}

static void test_filtered(void **state) {
    (void)state;
    each_kind(true, 3, 4);
}

/* Look-ups at the foot of a wall thinner than three texels read what those inside read, too; a thicker one
 * has texels of its own for each side. */
static void test_the_foot_of_a_wall(void **state) {
    (void)state;
    const float texels[] = {0.5f, 1.5f, 3};
    for (unsigned k = 0; k < 3; k++) {
        const struct house h = {
            .kind = HOUSE_BOXES, .thick = texels[k] / 5, .angle = 0.3f, .shift_x = 0.13f, .density = 5};
        const struct room room = house_build(&h);
        struct room_solution s;
        room_solve(&s, &room, (struct lw_solver_desc){.bounces = 1, .tracing_range_m = INFINITY}, 2);
        const double near = house_lamp_at_foot(&s, &h, 0, 0.25f), far = house_lamp_at_foot(&s, &h, 2, 2.5f);
        room_finish(&s);
        print_message("a wall of %g texels: %.2g W/m^2 of the lamp at its foot, %.2g two texels away\n",
                      (double)texels[k], near, far);
        if (!(far <= 0.01 && (near <= 0.01 || texels[k] < 3)))
            fail_msg("a wall of %g texels: %g W/m^2 of the lamp at its foot, %g two texels away",
                     (double)texels[k], near, far);
    }
}

static void test_all(void **state) {
    (void)state;
    const float density[] = {3, 5, 12};
    for (unsigned k = 0; k < 3; k++) {
        each_kind(false, density[k], 24);
        each_kind(true, density[k], 24);
    }
}

/* The sun comes and goes: what follows from it stays outside from the first frame on. */
static void test_the_sun_is_switched(void **state) {
    (void)state;
    for (unsigned k = 0; k < 2; k++) {
        const struct house h = {
            .kind = HOUSE_BOXES, .thick = k ? 0.3f : 0.1f, .angle = 0.3f, .density = 5, .filtered = true};
        const struct room room = house_build(&h);
        struct room_solution s;
        room_solve(&s, &room,
                   (struct lw_solver_desc){
                       .bounces = 2, .denoise = true, .tracing_range_m = INFINITY, .target_error = 0.1f},
                   1);
        for (uint64_t frame = 2; frame <= 13; frame++) {
            const bool shines = frame < 4 || frame > 8;
            s.pose.light[1].intensity.z = shines ? HOUSE_SUN : 0;
            room_frame(&s, frame);
            if (shines) house_expect_apart(&s, &h, house_inner_face(&h), 0.01);
        }
        room_finish(&s);
    }
}

/* A lamp of 12 W/m^2 that becomes a quarter of itself, beside 5 kW/m^2 of sun on the same ground: errors
 * inside are measured against what light there is inside. */
static void test_the_lamp_is_dimmed(void **state) {
    (void)state;
    const char *const groups[] = {NULL, "lamp;sun"};
    for (unsigned k = 0; k < 2; k++) {
        const struct house h = {
            .kind = HOUSE_BOXES, .thick = 0.3f, .angle = 0.3f, .density = 5, .filtered = true};
        const struct room room = house_build(&h);
        struct room_solution s;
        const struct lw_solver_desc desc = {
            .bounces = 2, .denoise = true, .tracing_range_m = INFINITY, .target_error = 0.1f};
        if (groups[k])
            room_solve_layers(&s, room_scene(&room), h.density, desc, groups[k], 1);
        else
            room_solve(&s, &room, desc, 1);
        double before = 0;
        for (uint64_t frame = 2; frame <= 32; frame++) {
            if (frame == 20) before = house_lamp_on_floor(&s, &h);
            s.pose.light[0].intensity.x = frame < 20 ? HOUSE_LAMP : HOUSE_LAMP / 4;
            room_frame(&s, frame);
        }
        const double share = house_lamp_on_floor(&s, &h) / before;
        if (!(fabs(share - 0.25) <= 0.02)) fail_msg("%s: %g of the lamp's light is left", groups[k], share);
        room_finish(&s);
    }
}

int main(int argc, char **argv) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_bare),
        cmocka_unit_test(test_filtered),
        cmocka_unit_test(test_the_foot_of_a_wall),
        cmocka_unit_test(test_the_sun_is_switched),
        cmocka_unit_test(test_the_lamp_is_dimmed),
    };
    const struct CMUnitTest all[] = {cmocka_unit_test(test_all)};
    return argc > 1 && strcmp(argv[1], "long") == 0 ? cmocka_run_group_tests(all, NULL, NULL)
                                                    : cmocka_run_group_tests(tests, NULL, NULL);
}
