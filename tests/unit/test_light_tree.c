/* The light tree: probabilities sum up to 1, are what is drawn, and are above 0 for all that gives light. */
#include "common/light/light_tree.h"
#include "common/random.h"
#include "tests/support/support.h"

#include <math.h>

#define LIGHTS 67u

static float number(uint32_t *state) { return lw_random_unit(*state = lw_random_hash(*state + 1)); }

static struct lw_vec3 direction(uint32_t *state) {
    float z = 2 * number(state) - 1, r = sqrtf(1 - z * z), angle = 2 * LW_PI * number(state);
    return lw_vec3(r * cosf(angle), r * sinf(angle), z);
}

/* Small lamps that face anywhere, some of them spots, some points, some out. */
static void scatter(struct lw_light_bounds light[LIGHTS], uint32_t seed) {
    for (uint32_t i = 0; i < LIGHTS; i++) {
        struct lw_vec3 at = lw_vec3(6 * number(&seed), 3 * number(&seed), 6 * number(&seed));
        float size = i % 3 ? 0 : 0.01f;
        light[i] = (struct lw_light_bounds){.low = at,
                                            .high = lw_vec3_add(at, lw_vec3(size, size, size)),
                                            .axis = direction(&seed),
                                            .spread = i % 4 == 1 ? LW_PI : 0,
                                            .reach = i % 4 == 2 ? 0.6f : 0.5f * LW_PI,
                                            .power = i % 7 == 5 ? 0 : 0.1f + number(&seed)};
    }
}

static bool shines_on(const struct lw_light_bounds *l, struct lw_vec3 point, struct lw_vec3 normal) {
    struct lw_vec3 to = lw_vec3_normalize(lw_vec3_sub(l->low, point));
    float off = acosf(fminf(fmaxf(-lw_vec3_dot(to, l->axis), -1), 1));
    return l->power > 0 && lw_vec3_dot(to, normal) > 0 && off < l->spread + l->reach;
}

static void probabilities_are_sound(void **state) {
    (void)state;
    struct lw_light_bounds light[LIGHTS];
    struct lw_light_tree tree;
    scatter(light, 1);
    lw_support_ok(lw_light_tree_init(&tree, light, LIGHTS), NULL);
    uint32_t seed = 99, lit = 0;
    for (uint32_t k = 0; k < 200; k++) {
        if (k == 100) { /* and after all have moved */
            scatter(light, 2);
            lw_light_tree_refit(&tree, light);
        }
        struct lw_vec3 point = lw_vec3(6 * number(&seed), 3 * number(&seed), 6 * number(&seed));
        struct lw_vec3 normal = direction(&seed);
        double sum = 0;
        for (uint32_t i = 0; i < LIGHTS; i++) {
            float p = lw_light_tree_probability(&tree, point, normal, i);
            assert_true(p >= 0 && p <= 1);
            if (shines_on(&light[i], point, normal)) {
                lit++;
                if (!(p > 0)) fail_msg("light %u shines on point %u, and is never chosen", i, k);
            }
            if (light[i].power == 0) assert_true(p == 0);
            sum += (double)p;
        }
        /* the rest is branches at whose end all turned out to give nothing */
        assert_true(sum < 1 + 1e-5);
        double missed = 0;
        enum { N = 4096 };
        for (uint32_t i = 0; i < N; i++) {
            float p = 0, pick = ((float)i + 0.5f) / N;
            uint32_t chosen = lw_light_tree_choose(&tree, point, normal, pick, &p);
            if (chosen == UINT32_MAX)
                missed += 1.0 / N;
            else
                assert_float_equal(p / lw_light_tree_probability(&tree, point, normal, chosen), 1, 1e-4f);
        }
        assert_true(fabs(sum + missed - 1) < 0.01);
    }
    assert_true(lit > 1000);
    lw_light_tree_finish(&tree);
}

static void one_light_is_a_tree(void **state) {
    (void)state;
    struct lw_light_bounds light[LIGHTS];
    struct lw_light_tree tree;
    scatter(light, 3);
    lw_support_ok(lw_light_tree_init(&tree, light, 1), NULL);
    float p = 0;
    assert_int_equal(lw_light_tree_choose(&tree, lw_vec3(0, 0, 0), lw_vec3(0, 1, 0), 0.5f, &p), 0);
    assert_true(p == 1);
    lw_light_tree_finish(&tree);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(probabilities_are_sound),
        cmocka_unit_test(one_light_is_a_tree),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
