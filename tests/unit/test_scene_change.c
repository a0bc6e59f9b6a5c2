#include "tests/support/support.h"

#include "common/scene/scene_change.h"

#include <float.h>
#include <math.h>
#include <string.h>

static struct lw_scene *scene; /* objects 0..2, light 0, material 0 */

static enum lw_scene_change_code check(uint32_t kind, uint32_t target, uint32_t count, const float *value) {
    struct lw_scene_change change = {.kind = kind, .target = target, .value_count = count};
    struct lw_error err = {0};
    if (count <= LW_SCENE_CHANGE_VALUES_MAX && value) memcpy(change.value, value, count * sizeof *value);
    enum lw_scene_change_code code = lw_scene_change_check(scene, &change, &err);
    assert_int_equal(code == LW_SCENE_CHANGE_OK, err.status == LW_OK);
    assert_int_equal(code != LW_SCENE_CHANGE_OK, err.text[0] != 0);
    assert_true(strlen(err.text) < 200);
    return code;
}

/* The identity with one of its twelve numbers replaced. */
static enum lw_scene_change_code transform(unsigned at, float value) {
    float m[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    m[at] = value;
    return check(LW_SCENE_CHANGE_OBJECT_TRANSFORM, 2, 12, m);
}

static void check_kind(uint32_t kind, uint32_t targets, uint32_t values) {
    static const float fine[LW_SCENE_CHANGE_VALUES_MAX] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    assert_int_equal(check(kind, targets - 1, values, fine), LW_SCENE_CHANGE_OK);
    assert_int_equal(check(kind, targets, values, fine), LW_SCENE_CHANGE_UNKNOWN_TARGET);
    assert_int_equal(check(kind, UINT32_MAX, values, fine), LW_SCENE_CHANGE_UNKNOWN_TARGET);
    assert_int_equal(check(kind, 0, values + 1, fine), LW_SCENE_CHANGE_VALUE_COUNT);
    for (uint32_t i = 0; i < values; i++) {
        float bad[LW_SCENE_CHANGE_VALUES_MAX];
        memcpy(bad, fine, sizeof bad);
        bad[i] = NAN;
        assert_int_equal(check(kind, 0, values, bad), LW_SCENE_CHANGE_NOT_FINITE);
        bad[i] = -INFINITY;
        assert_int_equal(check(kind, 0, values, bad), LW_SCENE_CHANGE_NOT_FINITE);
    }
}

static void every_kind_has_its_target_and_its_values(void **state) {
    (void)state;
    static const uint32_t count[] = {[LW_SCENE_CHANGE_OF_SCENE] = 1,
                                     [LW_SCENE_CHANGE_OF_OBJECT] = 3,
                                     [LW_SCENE_CHANGE_OF_LIGHT] = 1,
                                     [LW_SCENE_CHANGE_OF_MATERIAL] = 1,
                                     [LW_SCENE_CHANGE_OF_MESH] = 1};
#define X(name, number, of, values) check_kind(number, count[LW_SCENE_CHANGE_OF_##of], values);
    LW_SCENE_CHANGE_MAP(X)
#undef X
    assert_int_equal(check(0, 0, 0, NULL), LW_SCENE_CHANGE_UNKNOWN_KIND);
    assert_int_equal(check(LW_SCENE_CHANGE_OBJECT_REMOVE + 1, 0, 0, NULL), LW_SCENE_CHANGE_UNKNOWN_KIND);
    assert_int_equal(check(UINT32_MAX, 0, 0, NULL), LW_SCENE_CHANGE_UNKNOWN_KIND);
}

static void transforms_keep_a_volume_within_reach(void **state) {
    (void)state;
    const float reach = LW_SCENE_CHANGE_POSITION_MAX;
    assert_int_equal(transform(3, reach), LW_SCENE_CHANGE_OK);
    assert_int_equal(transform(3, nextafterf(reach, INFINITY)), LW_SCENE_CHANGE_OUT_OF_RANGE);
    assert_int_equal(transform(11, 1e9f), LW_SCENE_CHANGE_OUT_OF_RANGE);
    assert_int_equal(transform(7, -1e9f), LW_SCENE_CHANGE_OUT_OF_RANGE);
    assert_int_equal(transform(5, LW_SCENE_CHANGE_SCALE_MIN), LW_SCENE_CHANGE_OK);
    assert_int_equal(transform(5, nextafterf(LW_SCENE_CHANGE_SCALE_MIN, 0)), LW_SCENE_CHANGE_DEGENERATE);
    assert_int_equal(transform(5, 0), LW_SCENE_CHANGE_DEGENERATE);
    assert_int_equal(transform(5, -LW_SCENE_CHANGE_SCALE_MAX), LW_SCENE_CHANGE_OK); /* mirrored */
    assert_int_equal(transform(5, 1.001f * LW_SCENE_CHANGE_SCALE_MAX), LW_SCENE_CHANGE_OUT_OF_RANGE);
    assert_int_equal(transform(0, FLT_MAX), LW_SCENE_CHANGE_OUT_OF_RANGE); /* its length is infinite */
    const float nothing[12] = {0}, flat[12] = {1, 1, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0},
                thin[12] = {1, 1, 0, 0, 0, 1e-5f, 0, 0, 0, 0, 1, 0};
    assert_int_equal(check(LW_SCENE_CHANGE_OBJECT_TRANSFORM, 0, 12, nothing), LW_SCENE_CHANGE_DEGENERATE);
    assert_int_equal(check(LW_SCENE_CHANGE_OBJECT_TRANSFORM, 0, 12, flat), LW_SCENE_CHANGE_DEGENERATE);
    assert_int_equal(check(LW_SCENE_CHANGE_OBJECT_TRANSFORM, 0, 12, thin), LW_SCENE_CHANGE_OK);
    assert_int_equal(check(LW_SCENE_CHANGE_OBJECT_ADD, 0, 12, thin), LW_SCENE_CHANGE_OK);
    assert_int_equal(check(LW_SCENE_CHANGE_OBJECT_ADD, 0, 12, flat), LW_SCENE_CHANGE_DEGENERATE);
}

static void values_keep_within_their_limits(void **state) {
    (void)state;
    static const struct {
        enum lw_scene_change_kind kind;
        float low, high;
    } limit[] = {
        {LW_SCENE_CHANGE_LIGHT_INTENSITY, 0, LW_SCENE_RADIANCE_MAX},
        {LW_SCENE_CHANGE_LIGHT_POSITION, -LW_SCENE_CHANGE_POSITION_MAX, LW_SCENE_CHANGE_POSITION_MAX},
        {LW_SCENE_CHANGE_MATERIAL_BASE_COLOUR, 0, 1},
        {LW_SCENE_CHANGE_MATERIAL_EMISSION, 0, LW_SCENE_RADIANCE_MAX},
        {LW_SCENE_CHANGE_SKY, 0, LW_SCENE_RADIANCE_MAX},
        {LW_SCENE_CHANGE_CLOCK_SEEK, 0, LW_SCENE_DURATION_MAX},
        {LW_SCENE_CHANGE_CLOCK_RATE, -LW_SCENE_CHANGE_RATE_MAX, LW_SCENE_CHANGE_RATE_MAX}};
    for (size_t i = 0; i < sizeof limit / sizeof *limit; i++) {
        const uint32_t count = limit[i].kind >= LW_SCENE_CHANGE_CLOCK_SEEK ? 1 : 3;
        for (uint32_t c = 0; c < count; c++) {
            float value[3] = {limit[i].low, limit[i].high, limit[i].low};
            value[c] = limit[i].low;
            assert_int_equal(check(limit[i].kind, 0, count, value), LW_SCENE_CHANGE_OK);
            value[c] = nextafterf(limit[i].low, -INFINITY);
            assert_int_equal(check(limit[i].kind, 0, count, value), LW_SCENE_CHANGE_OUT_OF_RANGE);
            value[c] = limit[i].high;
            assert_int_equal(check(limit[i].kind, 0, count, value), LW_SCENE_CHANGE_OK);
            value[c] = nextafterf(limit[i].high, INFINITY);
            assert_int_equal(check(limit[i].kind, 0, count, value), LW_SCENE_CHANGE_OUT_OF_RANGE);
        }
    }
    scene->material[0].unlit = 1; /* it shows its base colour alone */
    assert_int_equal(check(LW_SCENE_CHANGE_MATERIAL_EMISSION, 0, 3, (float[]){0, 1, 0}),
                     LW_SCENE_CHANGE_OUT_OF_RANGE);
    assert_int_equal(check(LW_SCENE_CHANGE_MATERIAL_EMISSION, 0, 3, (float[]){0, 0, 0}), LW_SCENE_CHANGE_OK);
    assert_int_equal(check(LW_SCENE_CHANGE_MATERIAL_BASE_COLOUR, 0, 3, (float[]){0, 1, 0}),
                     LW_SCENE_CHANGE_OK);
    scene->material[0].unlit = 0;
    assert_int_equal(check(LW_SCENE_CHANGE_LIGHT_DIRECTION, 0, 3, (float[]){0, 0, 0}),
                     LW_SCENE_CHANGE_DEGENERATE);
    assert_int_equal(check(LW_SCENE_CHANGE_LIGHT_DIRECTION, 0, 3, (float[]){0, -3, 0}), LW_SCENE_CHANGE_OK);
    assert_int_equal(check(LW_SCENE_CHANGE_LIGHT_DIRECTION, 0, 3, (float[]){0, 2e6f, 0}),
                     LW_SCENE_CHANGE_OUT_OF_RANGE);
}

static void codes_have_texts(void **state) {
    (void)state;
    assert_string_equal(lw_scene_change_text(LW_SCENE_CHANGE_OK), "done");
    assert_non_null(strstr(lw_scene_change_text(LW_SCENE_CHANGE_DEGENERATE), "volume"));
    assert_non_null(strstr(lw_scene_change_text(4711), "unknown"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_has_its_target_and_its_values),
        cmocka_unit_test(transforms_keep_a_volume_within_reach),
        cmocka_unit_test(values_keep_within_their_limits),
        cmocka_unit_test(codes_have_texts),
    };
    scene = lw_support_squares(3, 1);
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    lw_scene_destroy(scene);
    return failed;
}
