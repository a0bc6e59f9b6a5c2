/* The light tree: probabilities sum up to 1, agree with the samples, and are above 0 for all that gives
 * light; groups of a region hold each light once. */
#include "common/base/random.h"
#include "common/light/light_tree.h"

#include "common/light/light_kernels.h"
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
    lw_support_ok(lw_light_tree_init(&tree, light, LIGHTS, 0), NULL);
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
            uint32_t chosen =
                lw_light_tree_choose(&tree, 0, &(struct lw_light_region){point, normal, 0, 1}, pick, &p);
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

/* A point of a region, with a normal within its cone. */
static struct lw_light_region point_within(const struct lw_light_region *r, uint32_t *state) {
    const struct lw_vec3 off = direction(state), aside = direction(state);
    const struct lw_vec3 at = lw_vec3_mad(r->centre_ws, off, r->radius_m * number(state));
    struct lw_vec3 normal = r->normal_ws;
    for (float bend = 1; bend > 0.01f; bend *= 0.7f) {
        normal = lw_vec3_normalize(lw_vec3_mad(r->normal_ws, aside, bend));
        if (lw_vec3_dot(normal, r->normal_ws) >= r->cos_spread) break;
        normal = r->normal_ws;
    }
    return (struct lw_light_region){at, normal, 0, 1};
}

/* What the groups of a region give to a point of it: by choices of their own, every light that shines on it
 * counts once. */
static double count_by_groups(const struct lw_light_tree *tree, const struct lw_light_bounds *light,
                              const struct lw_light_region *region, const struct lw_light_region *at,
                              uint32_t most) {
    enum { PICKS = 1024 };
    struct lw_light_group group[LW_LIGHT_TREE_GROUPS_MAX];
    const uint32_t groups = lw_light_tree_split(tree, 0, region, most, group);
    double sum = 0;
    assert_true(groups <= most);
    for (uint32_t g = 0; g < groups; g++)
        for (uint32_t i = 0; i < PICKS; i++) {
            float p = 0;
            const uint32_t chosen = lw_light_tree_choose(
                tree, group[g].node, lw_light_tree_is_far(tree, group[g].node, region) ? region : at,
                ((float)i + 0.5f) / PICKS, &p);
            if (chosen != UINT32_MAX && shines_on(&light[chosen], at->centre_ws, at->normal_ws))
                sum += 1 / (double)p / PICKS;
        }
    return sum;
}

static void groups_hold_every_light_once(void **state) {
    (void)state;
    static const uint32_t most[] = {1, 2, 7, 32, LW_LIGHT_TREE_GROUPS_MAX};
    struct lw_light_bounds light[LIGHTS];
    struct lw_light_tree tree;
    scatter(light, 4);
    lw_support_ok(lw_light_tree_init(&tree, light, LIGHTS, 20), NULL);
    for (size_t m = 0; m < sizeof most / sizeof *most; m++) {
        uint32_t seed = 5;
        double want = 0, got = 0;
        for (uint32_t k = 0; k < 100; k++) {
            const struct lw_vec3 centre = lw_vec3(6 * number(&seed), 3 * number(&seed), 6 * number(&seed));
            const struct lw_light_region region = {centre, direction(&seed), 1.5f * number(&seed),
                                                   k % 2 ? 1 : 2 * number(&seed) - 1};
            const struct lw_light_region at = point_within(&region, &seed);
            got += count_by_groups(&tree, light, &region, &at, most[m]);
            for (uint32_t i = 0; i < LIGHTS; i++) want += shines_on(&light[i], at.centre_ws, at.normal_ws);
        }
        assert_true(want > 500);
        if (fabs(got / want - 1) > 0.01) fail_msg("%u groups: %g lights, not %g", most[m], got, want);
    }
    lw_light_tree_finish(&tree);
}

/* The first lights, and each by itself where there is room for all. */
static void groups_are_as_small_as_may_be(void **state) {
    (void)state;
    enum { FIRST = 20, COUNT = 50 };
    struct lw_light_bounds light[LIGHTS];
    struct lw_light_tree tree;
    struct lw_light_group group[LW_LIGHT_TREE_GROUPS_MAX];
    uint32_t seen = 0, seed = 8;
    scatter(light, 6);
    lw_support_ok(lw_light_tree_init(&tree, light, COUNT, FIRST), NULL);
    for (uint32_t k = 0; k < 50; k++) {
        const struct lw_light_region region = {
            lw_vec3(6 * number(&seed), 3 * number(&seed), 6 * number(&seed)), direction(&seed), 0.3f, 0.9f};
        const uint32_t groups = lw_light_tree_split(&tree, 1, &region, LW_LIGHT_TREE_GROUPS_MAX, group);
        for (uint32_t g = 0; g < groups; g++, seen++) {
            float p = 0;
            assert_true(lw_light_tree_choose(&tree, group[g].node, &region, 0.5f, &p) < FIRST);
            assert_true(p == 1);
        }
    }
    assert_true(seen > 100);
    for (uint32_t i = 0; i < COUNT; i++) light[i].power = 0;
    lw_light_tree_refit(&tree, light);
    const struct lw_light_region anywhere = {lw_vec3(3, 1, 3), lw_vec3(0, 1, 0), 100, -1};
    assert_int_equal(lw_light_tree_split(&tree, 0, &anywhere, 8, group), 0);
    lw_light_tree_finish(&tree);
}

/* Samples of `most` groups by picks that are even in [0, 1): none is sampled twice by one pick, and each as
 * often as its probability says. */
static void expect_samples(const struct lw_light_group *group, uint32_t count, uint32_t most) {
    enum { PICKS = 4096 };
    struct lw_light_group_sample sampled[LW_LIGHT_TREE_GROUPS_MAX];
    double counted[LW_LIGHT_TREE_GROUPS_MAX] = {0}, below[LW_LIGHT_TREE_GROUPS_MAX] = {0};
    for (uint32_t i = 0; i < PICKS; i++) {
        bool seen[LW_LIGHT_TREE_GROUPS_MAX] = {false};
        const uint32_t sample_count =
            lw_light_tree_sample(group, count, most, ((float)i + 0.5f) / PICKS, sampled);
        assert_int_equal(sample_count, most < count ? most : count);
        for (uint32_t d = 0; d < sample_count; d++) {
            uint32_t g = 0;
            while (group[g].node != sampled[d].node) g++;
            assert_false(seen[g]);
            assert_int_equal(sampled[d].number, d);
            assert_true(sampled[d].probability > 0 && sampled[d].probability <= 1);
            assert_true(sampled[d].pick >= 0 && sampled[d].pick < 1);
            seen[g] = true;
            counted[g] += 1 / (double)sampled[d].probability / PICKS;
            below[g] += sampled[d].pick < 0.25f ? 1 / (double)sampled[d].probability / PICKS : 0;
        }
    }
    for (uint32_t g = 0; g < count; g++) {
        /* a pick in 4,096 more or less, of the smallest probability, which is 1/40 */
        if (fabs(counted[g] - 1) > 0.02) fail_msg("%u of %u: group %u is %g", most, count, g, counted[g]);
        if (fabs(below[g] - 0.25) > 0.02) fail_msg("%u of %u: a quarter is %g", most, count, below[g]);
    }
}

static void draws_count_every_group_once(void **state) {
    (void)state;
    static const float promise[] = {1, 0.4f, 30, 2, 2, 0.5f, 0.5f, 3, 0.3f};
    enum { COUNT = sizeof promise / sizeof *promise };
    struct lw_light_group group[COUNT];
    for (uint32_t i = 0; i < COUNT; i++) group[i] = (struct lw_light_group){100 + i, promise[i]};
    for (uint32_t most = 2; most <= COUNT + 1; most++) expect_samples(group, COUNT, most);
    struct lw_light_group_sample sampled[4];
    assert_int_equal(lw_light_tree_sample(group, 0, 4, 0.5f, sampled), 0);
    /* what promises nearly all leaves nearly nothing to the others, but not nothing */
    const struct lw_light_group uneven[] = {{7, 1e-20f}, {8, 1e20f}, {9, 1e-20f}};
    assert_int_equal(lw_light_tree_sample(uneven, 3, 2, 0, sampled), 2);
    assert_true(sampled[0].node == 7 && sampled[0].probability == 0.5f && sampled[1].node == 8 &&
                sampled[1].probability == 1);
}

static uint32_t depth_of(const struct lw_light_tree *tree, uint32_t node) {
    uint32_t depth = 0;
    for (; node; node = tree->node[node].parent) depth++;
    return depth;
}

/* Lights at twice the distance each: a cut takes few from the rest. */
static void trees_are_not_deep(void **state) {
    (void)state;
    enum { COUNT = 252 };
    struct lw_light_bounds light[COUNT];
    struct lw_light_tree tree;
    uint32_t deepest = 0;
    for (uint32_t i = 0; i < COUNT; i++) {
        const struct lw_vec3 at = lw_vec3(ldexpf(1, (int)i - COUNT / 2), 0, 0);
        light[i] = (struct lw_light_bounds){at, at, lw_vec3(0, 1, 0), 0, 0.5f * LW_PI, 1};
    }
    lw_support_ok(lw_light_tree_init(&tree, light, COUNT, 0), NULL);
    for (uint32_t i = 0; i < COUNT; i++) {
        const uint32_t depth = depth_of(&tree, tree.leaf[i]);
        if (depth > deepest) deepest = depth;
    }
    if (deepest <= LW_LIGHT_TREE_DEPTH_MAX / 2 || deepest > LW_LIGHT_TREE_DEPTH_MAX)
        fail_msg("%u nodes deep", deepest);
    lw_light_tree_finish(&tree);
}

static void one_light_is_a_tree(void **state) {
    (void)state;
    struct lw_light_bounds light[LIGHTS];
    struct lw_light_tree tree;
    scatter(light, 3);
    lw_support_ok(lw_light_tree_init(&tree, light, 1, 0), NULL);
    float p = 0;
    assert_int_equal(lw_light_tree_choose(&tree, 0,
                                          &(struct lw_light_region){lw_vec3(0, 0, 0), lw_vec3(0, 1, 0), 0, 1},
                                          0.5f, &p),
                     0);
    assert_true(p == 1);
    lw_light_tree_finish(&tree);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(probabilities_are_sound),
        cmocka_unit_test(groups_hold_every_light_once),
        cmocka_unit_test(groups_are_as_small_as_may_be),
        cmocka_unit_test(draws_count_every_group_once),
        cmocka_unit_test(trees_are_not_deep),
        cmocka_unit_test(one_light_is_a_tree),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
