#include "tests/support/support.h"

#include "client/measure/crossover_options.h"
#include "client/measure/crossover_references.h"

#include <math.h>

static enum lw_status parse(const char *option, const char *value, struct lw_crossover_options *o,
                            struct lw_error *err) {
    char *argv[LW_SUPPORT_WORDS_MAX];
    const int argc = lw_support_command_line(argv, "crossover", option, value);
    bool done;
    return lw_crossover_options_parse(argc, argv, o, &done, err);
}

static void defaults_are_the_quick_form(void **state) {
    (void)state;
    struct lw_crossover_options o;
    struct lw_error err = {0};
    lw_support_ok(parse(NULL, NULL, &o, &err), &err);
    assert_int_equal(o.opponent_count, 2);
    assert_int_equal(o.opponent[0], LW_PATH_RENDERER_SVGF);
    assert_int_equal(o.opponent[1], LW_PATH_RENDERER_SVGF_QUARTER);
    assert_int_equal(o.base.motion, LW_SCENE_MOTION_LAMP_WALK);
    assert_int_equal(o.base.repeats, 2);
    assert_true(o.base.width == 640 && o.base.height == 360);
    assert_true(o.density_count == 4 && o.density[0] == 0.25 && o.density[3] == 2);
    assert_true(isinf(o.minutes_max) && !o.report_only);
    assert_true(o.pixels && !o.tiles && o.by_rays && !o.by_gl);
}

static void values(void **state) {
    (void)state;
    struct lw_crossover_options o;
    struct lw_error err = {0};
    lw_support_ok(parse("--opponents", "svgf,vpl", &o, &err), &err);
    assert_true(o.opponent_count == 2 && o.opponent[1] == LW_PATH_RENDERER_VPL);
    lw_support_ok(parse("--opponents", "raw,svgf", &o, &err), &err);
    assert_true(o.opponent_count == 2 && o.opponent[0] == LW_PATH_RENDERER_RAW);
    lw_support_ok(parse("--paths", "1,2,8", &o, &err), &err);
    assert_true(o.paths_count == 3 && o.paths[2] == 8);
    lw_support_ok(parse("--densities", "0.5", &o, &err), &err);
    assert_true(o.density_count == 1 && o.density[0] == 0.5);
    lw_support_ok(parse("--motion", "carry", &o, &err), &err);
    assert_int_equal(o.base.motion, LW_SCENE_MOTION_CARRY);
    lw_support_ok(parse("--renderer", "gl", &o, &err), &err);
    assert_true(!o.by_rays && o.by_gl);
    lw_support_ok(parse("--renderer", "both", &o, &err), &err);
    assert_true(o.by_rays && o.by_gl);
    lw_support_ok(parse("--truth-samples", "9", &o, &err), &err);
    assert_int_equal(o.base.reference_samples, 16);
}

static void bad_values_are_named(void **state) {
    (void)state;
    static const struct {
        const char *option, *value, *text;
    } bad[] = {
        {"--opponents", "svgf,fast", "--opponents: \"fast\" is none of"},
        {"--opponents", "svgf,svgf", "svgf is there twice"},
        {"--opponents", "", "--opponents"},
        {"--paths", "0", "--paths"},
        {"--paths", "1,,2", "--paths"},
        {"--paths", "257", "--paths"},
        {"--densities", "1,0.5", "must grow"},
        {"--densities", "nan", "--densities"},
        {"--densities", "0.001", "--densities"},
        {"--densities", "1x", "--densities"},
        {"--size", "64x31", "--size"},
        {"--size", "63x36", "--size"},
        {"--size", "64x36x", "--size"},
        {"--size", "9000x9000", "--size"},
        {"--motion", "fast", "--motion"},
        {"--renderer", "auto", "--renderer"},
        {"--warm", "0.9", "--warm"},
        {"--alone", "0", "--alone"},
        {"--alone", "13", "--alone"},
        {"--repeats", "21", "--repeats"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct lw_crossover_options o;
        struct lw_error err = {0};
        lw_support_fails(parse(bad[i].option, bad[i].value, &o, &err), LW_USAGE, &err, bad[i].text);
    }
}

static void what_is_missing_is_named(void **state) {
    (void)state;
    struct lw_crossover_options o;
    struct lw_error err = {0};
    bool done;
    char *no_folder[] = {(char *)"crossover", (char *)"builtin:cornell", NULL};
    lw_support_fails(lw_crossover_options_parse(2, no_folder, &o, &done, &err), LW_USAGE, &err,
                     "-o DIR is missing");
    char *no_scene[] = {(char *)"crossover", (char *)"-o", (char *)"out", NULL};
    err = (struct lw_error){0};
    lw_support_fails(lw_crossover_options_parse(3, no_scene, &o, &done, &err), LW_USAGE, &err,
                     "SCENE is missing");
    char *report[] = {(char *)"crossover", (char *)"--report-only", (char *)"-o", (char *)"out", NULL};
    err = (struct lw_error){0};
    lw_support_ok(lw_crossover_options_parse(4, report, &o, &done, &err), &err);
    assert_true(o.report_only);
}

static void crops_fit_into_pictures_of_all_sizes(void **state) {
    (void)state;
    static const char *const sizes[] = {"64x360", "360x64",  "96x96",   "64x32",   "70x40",
                                        "70x400", "180x400", "640x360", "64x8192", "8192x64"};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        struct lw_crossover_options o;
        struct lw_error err = {0};
        lw_support_ok(parse("--size", sizes[i], &o, &err), &err);
        const uint32_t side = lw_crossover_references_side(o.base.width, o.base.height);
        assert_true(side >= 16 && side <= 96 && side % 16 == 0);
        for (uint32_t view = 0; view < LW_MEASURE_VIEWS; view++) {
            const struct lw_crossover_crop left = lw_crossover_references_crop(o.base.width, o.base.height,
                                                                               view, 0),
                                           right = lw_crossover_references_crop(o.base.width, o.base.height,
                                                                                view, 1);
            assert_true(left.x % 16 == 0 && left.y % 16 == 0 && right.x % 16 == 0 && right.y % 16 == 0);
            assert_true(left.x < o.base.width && left.x + side <= right.x);
            assert_true(right.x < o.base.width && right.x + side <= o.base.width);
            assert_true(left.y < o.base.height && left.y + side <= o.base.height);
            assert_true(right.y < o.base.height && right.y + side <= o.base.height);
        }
    }
    assert_int_equal(lw_crossover_references_side(640, 360), 96);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(defaults_are_the_quick_form),
                                       cmocka_unit_test(values), cmocka_unit_test(bad_values_are_named),
                                       cmocka_unit_test(what_is_missing_is_named),
                                       cmocka_unit_test(crops_fit_into_pictures_of_all_sizes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
