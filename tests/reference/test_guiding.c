/* Guided paths against paths that are not: the same light in the mean, and less noise where light comes by
 * few ways. Tolerances come from the spread over seeds. */
#include "client/measure/sides/path_world.h"
#include "common/base/random.h"
#include "common/base/sanitizer.h"
#include "common/builtin/builtin.h"
#include "tests/reference/room.h"

#include <string.h>

#define SIDE  16u
#define SEEDS 16
#define SIGMA 4.5 /* standard errors; of a thousand such comparisons none fails by chance */

struct set {
    struct lw_scene *scene;
    struct lw_path_world world;
    struct lw_path_view view;
};

static void set_up(struct set *set, struct lw_scene *scene, uint32_t bounces, unsigned threads) {
    struct lw_error err = {0};
    set->scene = scene;
    lw_support_ok(lw_path_world_init(&set->world, scene, 0, threads, &err), &err);
    set->view = (struct lw_path_view){.bounces = bounces};
    if (scene->camera_count) set->view.camera = lw_camera_of_scene(scene, &set->world.pose, 0);
}

static void set_up_builtin(struct set *set, const char *name, uint32_t bounces, unsigned threads) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build(name, &scene, &err), &err);
    set_up(set, scene, bounces, threads);
}

static void tear_down(struct set *set) {
    lw_path_world_finish(&set->world);
    lw_scene_destroy(set->scene);
}

/* trust: as in guide.h; 0: as users have it. */
static struct lw_guide *guide_of(const struct set *set, float trust) {
    struct lw_guide_desc desc = {.trust = trust};
    struct lw_guide *guide;
    struct lw_error err = {0};
    assert_true(lw_pose_bounds(&set->world.pose, set->scene, &desc.minimum_ws, &desc.maximum_ws));
    lw_support_ok(lw_guide_create(&desc, &guide, &err), &err);
    return guide;
}

/* Every sector of every cell, with nothing of the scene in it. */
static void learn_nonsense(struct lw_guide *guide) {
    const uint32_t places = LW_GUIDE_SIDE * LW_GUIDE_SIDE * LW_GUIDE_SIDE * LW_GUIDE_SECTORS;
    for (uint32_t p = 0; p < places; p++) {
        const float x = lw_random_unit(lw_random_hash2(p, 3));
        lw_guide_note(guide, p, x < 0.5f ? 0 : powf(10000, x));
    }
    lw_guide_learn(guide, 2);
}

/* A picture of `samples` passes; a guide learns after each if `learns`. */
static struct lw_path_film render(const struct set *set, struct lw_guide *guide, bool learns, uint32_t seed,
                                  uint32_t side, uint32_t samples) {
    struct lw_path_film film;
    struct lw_path_view view = set->view;
    struct lw_error err = {0};
    view.seed = seed;
    view.guide = guide;
    lw_support_ok(lw_path_film_init(&film, side, side, &err), &err);
    for (uint32_t i = 0; i < samples; i++) {
        lw_path_trace_render(set->world.tracer, &view, 1, &film, NULL);
        if (guide && learns) lw_guide_learn(guide, 2);
    }
    return film;
}

enum how { UNGUIDED, LEARNED, NONSENSE, HOW_COUNT };

struct mean {
    double value, error; /* standard error */
};

static struct mean mean_of(const struct set *set, enum how how, struct lw_guide *nonsense, uint32_t samples) {
    double sum = 0, squares = 0;
    for (uint32_t seed = 1; seed <= SEEDS; seed++) {
        struct lw_guide *guide = how == LEARNED ? guide_of(set, 64) : how == NONSENSE ? nonsense : NULL;
        struct lw_path_film film = render(set, guide, how == LEARNED, seed, SIDE, samples);
        double value = 0;
        for (uint32_t i = 0; i < SIDE * SIDE * 3; i++)
            value += (double)film.half[0][i] + (double)film.half[1][i];
        value /= SIDE * SIDE * 3 * samples;
        sum += value, squares += value * value;
        lw_path_film_finish(&film);
        if (how == LEARNED) lw_guide_destroy(guide);
    }
    const double mean = sum / SEEDS;
    return (struct mean){mean, sqrt(fmax(0, squares / SEEDS - mean * mean) / (SEEDS - 1))};
}

/* All ways to find light, with and without a guide, learned or absurd. */
static void expect_one_mean(struct set *set, uint32_t samples, double error_max) {
    struct mean first = {0};
    struct lw_guide *nonsense = guide_of(set, 1e-6f);
    learn_nonsense(nonsense);
    for (int method = LW_PATH_METHOD_BOTH; method <= LW_PATH_METHOD_BOUNCE; method++)
        for (int how = 0; how < HOW_COUNT; how++) {
            set->view.method = (enum lw_path_method)method;
            const struct mean mean = mean_of(set, (enum how)how, nonsense, samples);
            assert_true(mean.value > 0);
            if (method == LW_PATH_METHOD_BOTH && how == UNGUIDED) first = mean;
            if (method != LW_PATH_METHOD_BOUNCE && how != NONSENSE && mean.error > error_max * mean.value)
                fail_msg("method %d, guide %d: %g +- %g", method, how, mean.value, mean.error);
            const double sigma = hypot(mean.error, first.error);
            if (!(fabs(mean.value - first.value) <= SIGMA * sigma + 1e-5 * first.value))
                fail_msg("method %d, guide %d: %g +- %g, not %g +- %g", method, how, mean.value, mean.error,
                         first.value, first.error);
        }
    lw_guide_destroy(nonsense);
}

static void test_means_agree_in_a_box(void **state) {
    (void)state;
    struct set set;
    set_up_builtin(&set, "builtin:cornell", 3, 2);
    expect_one_mean(&set, 8, 0.03);
    tear_down(&set);
}

static void test_means_agree_behind_a_door(void **state) {
    (void)state;
    struct set set;
    set_up_builtin(&set, "builtin:ajar", 5, 2);
    expect_one_mean(&set, 16, 0.1);
    tear_down(&set);
}

/* Sky, a lamp without extent, a pane, and a surface that is double-sided. */
static void test_means_agree_under_a_sky(void **state) {
    (void)state;
    struct room room = {.sky = 0.7f};
    struct set set;
    room_quad(&room, lw_vec3(-2, 0, -2), lw_vec3(0, 0, 4), lw_vec3(4, 0, 0), 0.6f, 0);
    room_quad(&room, lw_vec3(-2, 0, -2), lw_vec3(4, 0, 0), lw_vec3(0, 2, 0), 0.8f, 0);
    room_quad(&room, lw_vec3(-0.5f, 0.7f, -0.5f), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0.5f, 0);
    room.quad[2].double_sided = true;
    room_quad(&room, lw_vec3(0.8f, 0, -0.5f), lw_vec3(0, 0, 1), lw_vec3(0, 1, 0), 0.5f, 3);
    room.quad[3].alpha_mode = LW_ALPHA_BLEND;
    room.quad[3].alpha = 0.5f;
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {2, 2, 2}};
    room.light_position[room.light_count++] = lw_vec3(-1, 1.5f, 0.3f);
    set_up(&set, room_scene(&room), 3, 2);
    set.view.camera = lw_camera_look_at(lw_vec3(0.5f, 2, 3), lw_vec3(0, 0.4f, 0), 0.9f);
    expect_one_mean(&set, 8, 0.02);
    for (int part = LW_PATH_PART_DIRECT; part <= LW_PATH_PART_INDIRECT; part++) {
        set.view.part = (enum lw_path_part)part;
        set.view.all_lights = part == LW_PATH_PART_DIRECT;
        expect_one_mean(&set, 8, 0.05);
    }
    tear_down(&set);
}

/* Where no light bounces there is nothing to follow: the same bytes. */
static void test_direct_light_stays_as_it_is(void **state) {
    (void)state;
    struct set set;
    set_up_builtin(&set, "builtin:cornell", 0, 2);
    struct lw_guide *guide = guide_of(&set, 0);
    struct lw_path_film off = render(&set, NULL, false, 1, SIDE, 4),
                        on = render(&set, guide, true, 1, SIDE, 4);
    for (int half = 0; half < 2; half++)
        assert_memory_equal(off.half[half], on.half[half], (size_t)SIDE * SIDE * 3 * sizeof(float));
    lw_path_film_finish(&off);
    lw_path_film_finish(&on);
    lw_guide_destroy(guide);
    tear_down(&set);
}

static void test_same_bytes_by_any_threads(void **state) {
    (void)state;
    enum { WIDE = 100 };
    struct lw_path_film film[2];
    for (unsigned i = 0; i < 2; i++) {
        struct set set;
        set_up_builtin(&set, "builtin:ajar", 3, i ? 4 : 1);
        struct lw_guide *guide = guide_of(&set, 0);
        film[i] = render(&set, guide, true, 5, WIDE, 6);
        lw_guide_destroy(guide);
        tear_down(&set);
    }
    for (int half = 0; half < 2; half++)
        assert_memory_equal(film[0].half[half], film[1].half[half], (size_t)WIDE * WIDE * 3 * sizeof(float));
    for (int i = 0; i < 2; i++) lw_path_film_finish(&film[i]);
}

static void resolve(struct lw_path_film *film, float *out) {
    lw_path_film_resolve(film, out);
    lw_path_film_finish(film);
}

/* What it is for: behind a door ajar, once it has learned, equal paths leave less than two thirds of the
 * error. */
static void test_less_noise_behind_a_door(void **state) {
    (void)state;
    enum { WIDE = 32, VALUES = WIDE * WIDE * 3 };
    static float reference[VALUES], picture[VALUES];
    double error[2];
    struct set set;
    set_up_builtin(&set, "builtin:ajar", 5, 2);
    struct lw_guide *guide = guide_of(&set, 0);
    struct lw_path_film film = render(&set, guide, true, 99, WIDE, 192);
    resolve(&film, reference);
    for (int guided = 0; guided < 2; guided++) {
        film = render(&set, guided ? guide : NULL, true, 1, WIDE, 64);
        resolve(&film, picture);
        error[guided] = lw_support_relmse(picture, reference, VALUES);
    }
    if (!(error[1] < 0.67 * error[0])) fail_msg("relMSE %.4g, unguided %.4g", error[1], error[0]);
    lw_guide_destroy(guide);
    tear_down(&set);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_direct_light_stays_as_it_is), cmocka_unit_test(test_same_bytes_by_any_threads),
        cmocka_unit_test(test_means_agree_in_a_box),        cmocka_unit_test(test_means_agree_behind_a_door),
        cmocka_unit_test(test_means_agree_under_a_sky),     cmocka_unit_test(test_less_noise_behind_a_door),
    };
    /* Means over many paths take minutes there, and show nothing that the first two do not. */
    const struct CMUnitTest brief[] = {tests[0], tests[1]};
    if (LW_SANITIZER) return cmocka_run_group_tests(brief, NULL, NULL);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
