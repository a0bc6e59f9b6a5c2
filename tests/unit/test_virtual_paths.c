/* Paths of virtual lights: which are lost, which are shot again, and when. */
#include "common/light/virtual_paths.h"
#include "tests/support/support.h"

#include <string.h>

#define LIGHTS_MAX 64

/* An owner that writes down what it is asked. */
struct owner {
    bool hidden[LIGHTS_MAX], dark[LIGHTS_MAX]; /* its parent does not see it; nothing reflects there */
    uint32_t shots[LIGHTS_MAX], bounces, total, order[256];
};

static bool holds(void *context, uint32_t path, uint32_t bounce) {
    const struct owner *o = context;
    return !o->hidden[path * o->bounces + bounce];
}

static bool shoot(void *context, uint32_t path, uint32_t bounce) {
    struct owner *o = context;
    const uint32_t light = path * o->bounces + bounce;
    o->shots[light]++;
    o->order[o->total++] = light;
    o->hidden[light] = false;
    return !o->dark[light];
}

static struct lw_virtual_paths_rays rays_of(struct owner *o) {
    return (struct lw_virtual_paths_rays){.context = o, .holds = holds, .shoot = shoot};
}

static void begin(struct lw_virtual_paths *paths, struct owner *o, uint32_t lights, uint32_t bounces,
                  uint32_t sets) {
    lw_support_ok(lw_virtual_paths_init(paths, lights, bounces, sets), NULL);
    *o = (struct owner){.bounces = bounces};
    const struct lw_virtual_paths_rays rays = rays_of(o);
    lw_virtual_paths_shoot(paths, &rays, false, 0);
}

static void test_sizes(void **state) {
    (void)state;
    static const struct {
        uint32_t lights, bounces, sets, paths;
    } want[] = {{512, 2, 8, 256}, {512, 3, 8, 168}, {7, 2, 4, 4}, {1, 3, 4, 4}, {512, 0, 8, 0}};
    for (size_t i = 0; i < sizeof want / sizeof *want; i++) {
        struct lw_virtual_paths paths;
        lw_support_ok(lw_virtual_paths_init(&paths, want[i].lights, want[i].bounces, want[i].sets), NULL);
        assert_int_equal(paths.paths, want[i].paths);
        bool seen[512] = {false};
        for (uint32_t p = 0; p < paths.paths; p++) { /* numbers: each once, and each set has every sets-th */
            const uint32_t number = lw_virtual_paths_number(&paths, p);
            assert_true(number < paths.paths && !seen[number]);
            seen[number] = true;
            assert_int_equal(number % paths.sets, p / (paths.paths / paths.sets));
        }
        lw_virtual_paths_finish(&paths);
    }
}

/* The first time all are shot, whatever the bound; nothing comes after a ray that met nothing. */
static void test_first_shots(void **state) {
    (void)state;
    struct lw_virtual_paths paths;
    struct owner o = {.bounces = 3};
    lw_support_ok(lw_virtual_paths_init(&paths, 12, 3, 2), NULL);
    o.dark[1 * 3 + 1] = true;
    const struct lw_virtual_paths_rays rays = rays_of(&o);
    assert_true(lw_virtual_paths_lack(&paths));
    lw_virtual_paths_shoot(&paths, &rays, false, 1);
    assert_false(lw_virtual_paths_lack(&paths));
    assert_int_equal(o.total, 11);
    assert_int_equal(paths.state[3], LW_VIRTUAL_LIGHT_LIT);
    assert_int_equal(paths.state[4], LW_VIRTUAL_LIGHT_ENDED);
    assert_int_equal(paths.state[5], LW_VIRTUAL_LIGHT_ENDED);
    lw_virtual_paths_finish(&paths);
}

/* A light that is hidden from its parent is lost with its children, and shot again within the bound; lights
 * before it in its path stay. */
static void test_lost_and_shot_again(void **state) {
    (void)state;
    struct lw_virtual_paths paths;
    struct owner o;
    begin(&paths, &o, 18, 3, 1);
    const struct lw_virtual_paths_rays rays = rays_of(&o);
    o.hidden[0 * 3 + 1] = o.hidden[2 * 3] = o.hidden[4 * 3 + 2] = true;
    lw_virtual_paths_check(&paths, &rays);
    static const uint8_t lost[] = {1, 2, 6, 7, 8, 14};
    for (uint32_t i = 0; i < 18; i++)
        assert_int_equal(lw_virtual_paths_is_lit(&paths, i), !memchr(lost, (int)i, sizeof lost));
    assert_true(lw_virtual_paths_lack(&paths));
    o.total = 0;
    lw_virtual_paths_shoot(&paths, &rays, false,
                           4); /* two, then three: the bound is passed by a path at most */
    assert_int_equal(o.total, 5);
    assert_true(o.order[0] == 1 && o.order[1] == 2 && o.order[2] == 6);
    assert_false(lw_virtual_paths_is_lit(&paths, 14));
    lw_virtual_paths_shoot(&paths, &rays, false, 4);
    assert_true(lw_virtual_paths_is_lit(&paths, 14));
    assert_int_equal(o.total, 6);
    lw_virtual_paths_finish(&paths);
}

/* What the lost leave of the bound goes to paths in turn. */
static void test_turns(void **state) {
    (void)state;
    struct lw_virtual_paths paths;
    struct owner o;
    begin(&paths, &o, 12, 2, 3);
    const struct lw_virtual_paths_rays rays = rays_of(&o);
    const uint32_t most = lw_virtual_paths_set_count(&paths);
    assert_int_equal(most, 4);
    o.total = 0;
    o.hidden[5 * 2 + 1] = true;
    lw_virtual_paths_check(&paths, &rays);
    lw_virtual_paths_shoot(&paths, &rays, true, most); /* the lost one, then path 0; one more would be 5 */
    assert_true(o.total == 3 && o.order[0] == 11 && o.order[1] == 0 && o.order[2] == 1);
    for (int frame = 0; frame < 3; frame++) lw_virtual_paths_shoot(&paths, &rays, true, most);
    for (uint32_t i = 0; i < 12; i++) assert_int_equal(o.shots[i], i < 2 ? 3 : i == 11 ? 3 : 2);
    lw_virtual_paths_shoot(&paths, &rays, true, 1000); /* no more than all of them */
    assert_int_equal(o.total, 3 + 12 + 12);
    lw_virtual_paths_finish(&paths);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sizes),
        cmocka_unit_test(test_first_shots),
        cmocka_unit_test(test_lost_and_shot_again),
        cmocka_unit_test(test_turns),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
