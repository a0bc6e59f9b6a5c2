/* Light by way of small bright objects: a lamp over a dish in a black room, against closed forms. */
#include "server/solve/cell_layer.h"
#include "server/solve/transport/reflectors.h"
#include "tests/reference/effort.h"
#include "tests/reference/room.h"

#include <math.h>

#define SEGMENTS 96 /* triangles of room_disc() */
#define RADIUS   0.06f
#define ALBEDO   0.8f
#define HIGH_M   0.2f  /* the lamp over the dish: all of it is lit alike */
#define LOW_M    0.03f /* its middle has ten times what its rim has */

/* A dish that looks up, with a lamp of 1 W/sr over it. */
static void add_dish(struct room *room, struct lw_vec3 centre, float lamp_m) {
    const uint32_t light = room->light_count++;
    room_disc(room, centre, lw_vec3(RADIUS, 0, 0), lw_vec3(0, 0, -RADIUS), ALBEDO, 0);
    room->light[light] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {1, 1, 1}};
    room->light_position[light] = lw_vec3_add(centre, lw_vec3(0, lamp_m, 0));
}

/* Two metres each way; what the walls reflect is nothing, so that their indirect light is the dish's. */
static struct room black_room(void) {
    struct room room = {.texels_per_metre = 8};
    room_box(&room, lw_vec3(2, 2, 2), 0, 0);
    return room;
}

/* W that a dish sends out: the lamp's solid angle of a disc, less what the polygon lacks at its rim. */
static double sent(float lamp_m) {
    const double pi = acos(-1.0), h = (double)lamp_m, r = (double)RADIUS, n = SEGMENTS,
                 polygon = r * r * n / 2 * sin(2 * pi / n), rim = h / pow(h * h + r * r, 1.5);
    return (double)ALBEDO * (2 * pi * (1 - h / hypot(h, r)) - (pi * r * r - polygon) * rim);
}

static void add_watts(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    (void)p, (void)direct;
    *(double *)user += area / 64 * indirect; /* 8 texels a metre */
}

static double watts_on_walls(const struct room *room, struct lw_solver_desc desc, unsigned frames) {
    struct room_solution solution;
    double watts = 0;
    room_solve(&solution, room, desc, frames);
    for (uint32_t o = 0; o < 6; o++) room_each_texel(&solution, o, add_watts, &watts);
    room_finish(&solution);
    return watts;
}

struct picture {
    double got[6 * 16 * 16], want[6 * 16 * 16], got_sum, want_sum;
    uint32_t count;
};

/* From the middle of the room a dish is a point: E = W / pi cos cos' / d^2, within (r / d)^2. */
static void compare_texel(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    struct picture *picture = user;
    const double x = (double)p.x - 1, y = (double)p.y - 1, z = (double)p.z - 1,
                 square = x * x + y * y + z * z,
                 deep = fmax(fabs(x), fmax(fabs(y), fabs(z))), /* along the wall's normal: 1 */
        want = sent(LOW_M) / acos(-1.0) * y * deep / (square * square);
    (void)area, (void)direct;
    if (y < 0.2) return; /* beside and under the dish: grazing, and none */
    picture->got[picture->count] = indirect;
    picture->want[picture->count++] = want;
    picture->got_sum += indirect;
    picture->want_sum += want;
}

/* One bounce ray in 300 meets the dish, and 16 such rays a texel have a relMSE of 11. What all texels have in
 * common is the dish's own noise. */
static void test_few_frames_have_its_light(void **state) {
    (void)state;
    struct room room = black_room();
    struct room_solution solution;
    struct picture picture = {.count = 0};
    double square = 0;
    add_dish(&room, lw_vec3(1, 1, 1), LOW_M);
    room_solve(&solution, &room, (struct lw_solver_desc){.bounces = 1}, 16);
    for (uint32_t o = 0; o < 6; o++) room_each_texel(&solution, o, compare_texel, &picture);
    room_finish(&solution);
    assert_true(picture.count > 500);
    for (uint32_t i = 0; i < picture.count; i++)
        square += pow(picture.got[i] / picture.got_sum * picture.want_sum / picture.want[i] - 1, 2);
    if (!(square / picture.count < 0.01)) fail_msg("relMSE %.4f", square / picture.count);
}

/* W on the walls. blends: where alpha is blended bounce rays alone have the dish, and all of it if alpha is
 * 1. */
static double watts_of_dish(struct lw_vec3 at, bool blends, struct lw_solver_desc desc, unsigned frames) {
    struct room room = black_room();
    add_dish(&room, at, HIGH_M);
    if (blends) room.quad[6].alpha_mode = LW_ALPHA_BLEND, room.quad[6].alpha = 1;
    return watts_on_walls(&room, desc, frames);
}

/* All of it arrives, once: in the open; by a wall, where bounce rays have part of it. There texels of 12 cm
 * lie 10 cm from the dish: the closed form is missed by 3 %, by both alike. */
static void test_its_light_arrives_once(void **state) {
    (void)state;
    const struct lw_solver_desc desc = {.bounces = 1};
    const struct lw_vec3 beside = lw_vec3(0.1f, 1, 1);
    expect_near(watts_of_dish(lw_vec3(1, 1, 1), false, desc, 128), sent(HIGH_M), 0.02);
    const double got = watts_of_dish(beside, false, desc, 512 * effort),
                 plain = watts_of_dish(beside, true, desc, 512 * effort);
    expect_near(got, plain, noise(0.028));
    expect_near(got, sent(HIGH_M), 0.04);
}

/* Beyond the tracing range probes know the dish; rays to it count only within. */
static void test_probes_have_what_is_beyond_the_range(void **state) {
    (void)state;
    const struct lw_solver_desc desc = {.bounces = 1, .tracing_range_m = 1.2f, .probe_spacing_m = 0.25f};
    const double got = watts_of_dish(lw_vec3(1, 1, 1), false, desc, 256),
                 plain = watts_of_dish(lw_vec3(1, 1, 1), true, desc, 256);
    expect_near(got, plain, 0.04);
}

/* More than are listed: the others are left to bounce rays. Each dish is lit by all lamps. */
static void test_more_than_are_listed(void **state) {
    (void)state;
    struct room room = black_room();
    const uint32_t dishes = LW_REFLECTORS_MAX + 4, columns = 6;
    const double area = acos(-1.0) * (double)(RADIUS * RADIUS), h = (double)LOW_M;
    double want = dishes * sent(LOW_M);
    for (uint32_t i = 0; i < dishes; i++)
        add_dish(&room,
                 lw_vec3(0.3f + 0.28f * (float)(i % columns), 0.5f, 0.3f + 0.28f * (float)(i / columns)),
                 LOW_M);
    for (uint32_t i = 0; i < dishes; i++)
        for (uint32_t j = 0; j < dishes; j++) {
            const struct lw_vec3 a = room.light_position[i], b = room.light_position[j];
            const double d = hypot((double)(a.x - b.x), (double)(a.z - b.z));
            if (i != j) want += (double)ALBEDO * area * h / pow(d * d + h * h, 1.5);
        }
    const double got = watts_on_walls(&room, (struct lw_solver_desc){.bounces = 1}, 64);
    expect_near(got, want, 0.03);
}

/* A dish that goes through a wall, with its lamp on one side: its other half is dark, and lights nothing. */
static void test_a_dish_through_a_wall(void **state) {
    (void)state;
    struct room room = black_room();
    room_quad(&room, lw_vec3(1, 0, 0), lw_vec3(0, 2, 0), lw_vec3(0, 0, 2), 0, 0);
    room.quad[6].double_sided = true;
    add_dish(&room, lw_vec3(1.01f, 1, 1), HIGH_M);
    room.light_position[0].x = 1.05f;
    struct room_solution solution;
    room_solve(&solution, &room, (struct lw_solver_desc){.bounces = 1}, 64);
    const double dark = room_object_mean(&solution, 4).indirect,
                 lit = room_object_mean(&solution, 5).indirect;
    room_finish(&solution);
    if (!(lit > 1e-4 && dark < 0.01 * lit))
        fail_msg("the wall behind has %g W/m^2, the one before it %g", dark, lit);
}

/* Sums that corrections have left a little below none are no light that anything could stand out from. */
static void test_nothing_shines_in_the_dark(void **state) {
    (void)state;
    struct room room = black_room();
    struct room_solution s;
    struct lw_texels texels;
    struct lw_reflectors reflectors;
    struct lw_error err = {0};
    room_disc(&room, lw_vec3(1, 1, 1), lw_vec3(RADIUS, 0, 0), lw_vec3(0, 0, -RADIUS), ALBEDO, 0);
    room_solve(&s, &room, (struct lw_solver_desc){.bounces = 1}, 2);
    struct lw_tiles *tiles = lw_cell_layer_tiles(s.solver);
    for (uint32_t b = 0; b < tiles->block_count; b++)
        tiles->block[b].luminance = -1e-9 * tiles->block[b].covered_count;
    lw_support_ok(lw_texels_init(&texels, s.scene, 1, NULL, NULL, &err), &err);
    lw_support_ok(lw_reflectors_init(&reflectors, s.scene, &texels, &s.pose), NULL);
    lw_support_ok(lw_reflectors_update(&reflectors, tiles, &s.pose), NULL);
    assert_int_equal(reflectors.count, 0);
    lw_reflectors_finish(&reflectors);
    lw_texels_finish(&texels);
    room_finish(&s);
}

static void test_same_bytes_at_any_thread_count(void **state) {
    (void)state;
    struct room room = black_room();
    struct room_solution a, b;
    add_dish(&room, lw_vec3(1, 1, 1), HIGH_M);
    room_solve(&a, &room, (struct lw_solver_desc){.bounces = 2, .threads = 1}, 8);
    room_solve(&b, &room, (struct lw_solver_desc){.bounces = 2, .threads = 3}, 8);
    assert_true(room_expect_same(&a, &b) > 0);
    assert_true(a.rays == b.rays);
    room_finish(&b);
    room_finish(&a);
}

/* With an argument: the same of more samples. */
int main(int argc, char **argv) {
    (void)argv;
    set_effort(argc);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_few_frames_have_its_light),
        cmocka_unit_test(test_its_light_arrives_once),
        cmocka_unit_test(test_probes_have_what_is_beyond_the_range),
        cmocka_unit_test(test_more_than_are_listed),
        cmocka_unit_test(test_a_dish_through_a_wall),
        cmocka_unit_test(test_nothing_shines_in_the_dark),
        cmocka_unit_test(test_same_bytes_at_any_thread_count),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
