/* The light that a shaded place gets from the edge of the sun's light, against closed forms: such an edge
 * cuts texels, of which the place sees one side alone. */
#include "tests/reference/room.h"

#include <math.h>

/* A roof one metre over a floor, in the zenith's sun. A sheet hangs a little before the edge of the roof,
 * from its height nearly down to the floor. Between both the sun draws a strip on the floor. The roof's
 * underside sees the strip, and a little floor under the hem. */
#define SUN    1000.0
#define ALBEDO 0.5
#define HEIGHT 1.0f
#define SHEET  0.01f /* x of the sheet and of the edge, m; texels are 0.2 m wide */
#define EDGE   0.05f
#define HEM    0.03f
#define LENGTH 40.0f /* along z: the strip counts as without end */
#define NEAR   0.4f  /* x that are looked at */
#define FAR    1.6f

struct sums {
    double got, want, area;
};

/* E of a strip from x0 to x1 on the floor, without end, at a place that faces down. */
static double strip(double x, double x0, double x1) {
    const double height = (double)HEIGHT;
    return SUN * ALBEDO / 2 * ((x - x0) / hypot(x - x0, height) - (x - x1) / hypot(x - x1, height));
}

static void add_texel(void *user, struct lw_vec3 at, double area, double direct, double indirect) {
    struct sums *sums = user;
    if (direct > 0 || at.x < NEAR || at.x > FAR || fabsf(at.z) > LENGTH / 4)
        return; /* direct: its upper side */
    /* under the hem it sees as far as this */
    const double x = (double)at.x,
                 seen = (double)SHEET - (double)HEM * (x - (double)SHEET) / (double)(HEIGHT - HEM);
    sums->got += area * indirect;
    sums->want += area * strip(x, seen, (double)EDGE);
    sums->area += area;
}

static struct sums solve(float shift, unsigned frames) {
    struct room room = {.texels_per_metre = 5};
    struct room_solution s;
    struct sums sums = {0};
    room_quad(&room, lw_vec3(-3 + shift, 0, LENGTH / 2), lw_vec3(6, 0, 0), lw_vec3(0, 0, -LENGTH), ALBEDO, 0);
    room_quad(&room, lw_vec3(EDGE, HEIGHT, -LENGTH / 2), lw_vec3(4, 0, 0), lw_vec3(0, 0, LENGTH), 0, 0);
    room_quad(&room, lw_vec3(SHEET, HEM, -LENGTH / 2), lw_vec3(0, HEIGHT - HEM, 0), lw_vec3(0, 0, LENGTH), 0,
              0);
    room.quad[1].double_sided = room.quad[2].double_sided = true;
    room.light[room.light_count] =
        (struct lw_light){.kind = LW_LIGHT_DIRECTIONAL, .intensity = {SUN, SUN, SUN}};
    room.light_position[room.light_count++] = lw_vec3(0, 5, 0);
    room_solve(&s, &room,
               (struct lw_solver_desc){.bounces = 1, .indirect_samples = 4, .tracing_range_m = INFINITY},
               frames);
    room_each_texel(&s, 1, add_texel, &sums);
    room_finish(&s);
    return sums;
}

/* By the means of the floor's texels the roof had up to 1.46 times this light, by where they lie. */
static void test_under_a_roof(void **state) {
    (void)state;
    for (unsigned k = 0; k < 4; k++) {
        const struct sums sums = solve(0.05f * (float)k, 12);
        print_message("floor moved by %.2f m: %.3g W/m^2, %.3g by the closed form\n", 0.05 * k,
                      sums.got / sums.area, sums.want / sums.area);
        assert_true(sums.area > 0);
        expect_near(sums.got / sums.area, sums.want / sums.area, 0.15);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_under_a_roof),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
