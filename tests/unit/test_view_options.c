#include "tests/support/support.h"

#include "client/view/view_options.h"
#include "server/import/scene_format.h"

#include <stdio.h>
#include <string.h>

static enum lw_status parse(const char *line, struct lw_view_options *out, struct lw_error *err) {
    static char storage[512]; /* the options point into it */
    char *argv[32] = {storage};
    int argc = 0;
    snprintf(storage, sizeof storage, "lightwell-view %s", line);
    for (char *word = strtok(storage, " "); word; word = strtok(NULL, " ")) argv[argc++] = word;
    bool done = false;
    *err = (struct lw_error){0};
    enum lw_status status = lw_view_options_parse(argc, argv, out, &done, err);
    assert_false(done);
    return status;
}

static void test_defaults(void **state) {
    (void)state;
    struct lw_view_options o;
    struct lw_error err;
    lw_support_ok(parse("", &o, &err), &err);
    assert_string_equal(o.host, "127.0.0.1");
    assert_int_equal(o.port, 7780);
    assert_false(o.headless);
    assert_int_equal(o.width, 1280);
    assert_int_equal(o.height, 720);
    assert_int_equal(o.curve, LW_TONEMAP_REINHARD);
    assert_true(o.auto_exposure);
    assert_null(o.path.open.path);
}

/* Saved pictures have mirrors unless they are not wanted, a window the other way round. */
static void test_mirrors(void **state) {
    (void)state;
    static const struct {
        const char *line;
        bool mirrors;
    } cases[] = {{"", false},
                 {"--mirrors on", true},
                 {"--headless --json", true},
                 {"--headless --json --mirrors auto", true},
                 {"--headless --json --mirrors off", false}};
    struct lw_view_options o;
    struct lw_error err;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        lw_support_ok(parse(cases[i].line, &o, &err), &err);
        assert_int_equal(o.mirrors, cases[i].mirrors);
    }
    lw_support_fails(parse("--mirrors some", &o, &err), LW_USAGE, &err, "--mirrors");
    lw_support_fails(parse("--path-trace builtin:cornell --json --mirrors on", &o, &err), LW_USAGE, &err,
                     "--mirrors");
}

/* A window takes it, and --headless; what asks no server does not. */
static void test_renderer(void **state) {
    (void)state;
    struct lw_view_options o;
    struct lw_error err = {0};
    lw_support_ok(parse("", &o, &err), &err);
    assert_int_equal(o.renderer, LW_VIEW_RENDERER_AUTO);
    lw_support_ok(parse("--renderer gl", &o, &err), &err);
    assert_int_equal(o.renderer, LW_VIEW_RENDERER_GL);
    lw_support_ok(parse("--headless --json --renderer cpu", &o, &err), &err);
    assert_int_equal(o.renderer, LW_VIEW_RENDERER_CPU);
    lw_support_fails(parse("--renderer vulkan", &o, &err), LW_USAGE, &err, "--renderer");
    err = (struct lw_error){0};
    lw_support_fails(parse("--path-trace builtin:cornell --json --renderer gl", &o, &err), LW_USAGE, &err,
                     "--renderer");
}

static void test_direct(void **state) {
    (void)state;
    struct lw_view_options o;
    struct lw_error err = {0};
    lw_support_ok(parse("", &o, &err), &err);
    assert_true(o.draws_direct);
    lw_support_ok(parse("--direct tiles", &o, &err), &err);
    assert_false(o.draws_direct);
    lw_support_ok(parse("--headless --json --direct auto", &o, &err), &err);
    assert_true(o.draws_direct);
    lw_support_fails(parse("--direct none", &o, &err), LW_USAGE, &err, "--direct");
    err = (struct lw_error){0};
    lw_support_fails(parse("--path-trace builtin:cornell --json --direct tiles", &o, &err), LW_USAGE, &err,
                     "--direct");
}

static void test_addresses(void **state) {
    (void)state;
    struct lw_view_options o;
    struct lw_error err;
    lw_support_ok(parse("example.org", &o, &err), &err);
    assert_string_equal(o.host, "example.org");
    assert_int_equal(o.port, 7780);
    lw_support_ok(parse("99", &o, &err), &err);
    assert_string_equal(o.host, "127.0.0.1");
    assert_int_equal(o.port, 99);
    lw_support_ok(parse(":99", &o, &err), &err);
    assert_string_equal(o.host, "127.0.0.1");
    assert_int_equal(o.port, 99);
}

/* What people try first is answered with what they want. */
static void test_a_scene_is_no_server(void **state) {
    (void)state;
    static const char *const scene[] = {"builtin:city:2", "room.lwscene", "a.b/ROOM.GLB",
#define X(name, text, ending, other) "room" ending, "room" other,
                                        LW_SCENE_FORMAT_MAP(X)
#undef X
    };
    struct lw_view_options o;
    struct lw_error err = {0};
    for (size_t i = 0; i < sizeof scene / sizeof *scene; i++) {
        lw_support_ok(parse(scene[i], &o, &err), &err);
        assert_string_equal(o.scene, scene[i]);
        assert_string_equal(o.host, "127.0.0.1");
    }
    const char *file = lw_support_temporary("scene-without-an-ending");
    lw_support_write_file(file, "x", 1);
    lw_support_ok(parse(file, &o, &err), &err);
    assert_string_equal(o.scene, file);
    lw_support_ok(parse("room.local:7781", &o, &err), &err);
    assert_null(o.scene);
    lw_support_ok(parse("--show error", &o, &err), &err);
    assert_int_equal(o.show, LW_SHOW_ERROR);
    lw_support_ok(parse("--path-trace room.glb --json --show indirect", &o, &err), &err);
    assert_int_equal(o.path.part, LW_PATH_PART_INDIRECT);
    /* how it is opened is for its server */
    lw_support_ok(parse("room.glb --sky 1,2,3 --environment e.exr --texels-per-metre 5 --max-texels 7 "
                        "--density-of floor=2 "
                        "--atlas-max 64 --sun-angle 1 --threads 2",
                        &o, &err),
                  &err);
    assert_string_equal(o.own.path, "room.glb");
    assert_true(o.own.sky_given && o.own.sky[2] == 3 && o.own.sun_angle_given && o.own.threads == 2);
    assert_string_equal(o.own.environment, "e.exr");
    assert_float_equal(o.own.texels_per_metre, 5, 0);
    assert_int_equal(o.own.texels_max, 7);
    assert_string_equal(o.own.density_of, "floor=2");
    assert_int_equal(o.own.atlas_side_max, 64);
    lw_support_ok(parse("room.glb --headless --json --sky 1,2,3", &o, &err), &err);
    assert_true(o.own.sky_given);
    lw_support_fails(parse("room.local:7781 --sky 1,2,3", &o, &err), LW_USAGE, &err,
                     "--sky works with a scene");
}

static void test_path_trace(void **state) {
    (void)state;
    struct lw_view_options o;
    struct lw_error err;
    lw_support_ok(parse("--path-trace room.glb --out a.png", &o, &err), &err);
    assert_string_equal(o.path.open.path, "room.glb");
    assert_int_equal(o.path.samples, LW_VIEW_SPP);
    assert_true(o.path.error == 0);
    assert_int_equal(o.path.bounces, 2);
    assert_int_equal(o.path.seed, 1);
    assert_int_equal(o.path.pixel, LW_PATH_PIXEL_BOX);
    assert_int_equal(o.path.guide, LW_VIEW_GUIDE_OFF);
    assert_float_equal(o.path.open.sun_angle_deg, LW_SCENE_OPEN_SUN_DIAMETER_DEG, 0);
    lw_support_ok(parse("--path-trace room.glb --json --camera-name a --size 8x8 --spp 1048576 --error 0.01 "
                        "--bounces 64 --time 2.5 --seed 4294967295 --pixel centre --guide learned --sky "
                        "1,2,3 --sun-angle 0 "
                        "--threads 3 --tonemap none --exposure 1",
                        &o, &err),
                  &err);
    assert_int_equal(o.path.samples, 1048576);
    assert_float_equal(o.path.error, 0.01, 0);
    assert_int_equal(o.path.bounces, 64);
    assert_float_equal(o.path.time_s, 2.5, 0);
    assert_true(o.path.seed == UINT32_MAX);
    assert_int_equal(o.path.pixel, LW_PATH_PIXEL_CENTRE);
    assert_int_equal(o.path.guide, LW_VIEW_GUIDE_LEARNED);
    assert_true(o.path.open.sky_given && o.path.open.sky[1] == 2);
    assert_true(o.path.open.sun_angle_given && o.path.open.sun_angle_deg == 0);
    assert_int_equal(o.threads, 3);
    /* an error alone: as many samples as it takes */
    lw_support_ok(parse("--path-trace room.glb --json --error 1", &o, &err), &err);
    assert_int_equal(o.path.samples, LW_PATH_FILM_SAMPLES_MAX);
}

static void test_everything(void **state) {
    (void)state;
    struct lw_view_options o;
    struct lw_error err;
    lw_support_ok(parse("example.org:99 --headless --camera 0,0,0:1,0,0:60 --size 16384x1 --wait seconds:2.5 "
                        "--out a.b/view.EXR --json --tonemap aces --exposure -1.5 --threads 2 --timeout 7",
                        &o, &err),
                  &err);
    assert_string_equal(o.host, "example.org");
    assert_int_equal(o.port, 99);
    assert_true(o.headless && o.json && o.camera_given && !o.auto_exposure);
    assert_int_equal(o.width, 16384);
    assert_int_equal(o.height, 1);
    assert_int_equal(o.wait, LW_VIEW_WAIT_SECONDS);
    assert_float_equal(o.wait_s, 2.5, 0);
    assert_int_equal(o.format, LW_VIEW_EXR);
    assert_int_equal(o.curve, LW_TONEMAP_ACES);
    assert_float_equal(o.stops, -1.5f, 0);
    assert_int_equal(o.threads, 2);
    assert_float_equal(o.timeout_s, 7, 0);
    const char *waits[] = {"first", "complete", "good", "converged"};
    for (int i = 0; i < 4; i++) {
        char line[64];
        snprintf(line, sizeof line, "--headless --out x.png --wait %s", waits[i]);
        lw_support_ok(parse(line, &o, &err), &err);
        assert_int_equal(o.wait, i);
        assert_int_equal(o.format, LW_VIEW_PNG);
        assert_int_equal(o.samples_per_pixel, 16);
    }
    lw_support_ok(parse("--headless --json --samples-per-pixel 1", &o, &err), &err);
    assert_int_equal(o.samples_per_pixel, 1);
    assert_int_equal(o.wait, LW_VIEW_WAIT_GOOD); /* where nobody says */
}

static void test_errors_name_the_option(void **state) {
    (void)state;
    const struct {
        const char *line, *named;
    } cases[] = {
        {"--headless --out view.jpg", "--out"},
        {"--headless --out view", "--out"},
        {"--headless", "--out"},
        {"--headless --json --size 1280", "--size"},
        {"--headless --json --size 0x5", "--size"},
        {"--headless --json --size 5x0", "--size"},
        {"--headless --json --size 16385x5", "--size"},
        {"--headless --json --size 5x16385", "--size"},
        {"--headless --json --size -5x5", "--size"},
        {"--headless --json --size 5x5x5", "--size"},
        {"--headless --json --size 99999999999999999999x5", "--size"},
        {"--headless --json --wait soon", "--wait"},
        {"--headless --json --wait seconds:", "--wait"},
        {"--headless --json --wait seconds:-1", "--wait"},
        {"--headless --json --wait seconds:nan", "--wait"},
        {"--headless --json --samples-per-pixel 0", "--samples-per-pixel"},
        {"--headless --json --samples-per-pixel 1025", "--samples-per-pixel"},
        {"--headless --json --samples-per-pixel many", "--samples-per-pixel"},
        {"--headless --json --exposure bright", "--exposure"},
        {"--headless --json --exposure 61", "--exposure"},
        {"--headless --json --tonemap filmic", "--tonemap"},
        {"--headless --json --timeout 0", "--timeout"},
        {"--headless --json --threads -1", "--threads"},
        {"--headless --json --camera 1,2,3", "--camera"},
        {"--headless --json --camera 0,0,0:1,0,0:60 --camera-name x", "--camera-name"},
        {"--out view.png", "--out"},
        {"--json", "--json"},
        {"--wait first", "--wait"},
        {"--samples-per-pixel 4", "--samples-per-pixel"},
        {"--path-trace room.glb --json --samples-per-pixel 4", "--samples-per-pixel"},
        {"localhost:99999", "99999"},
        {"--path-trace room.glb", "--out"},
        {"--path-trace room.glb --json --spp 0", "--spp"},
        {"--path-trace room.glb --json --spp 1048577", "--spp"},
        {"--path-trace room.glb --json --error 0", "--error"},
        {"--path-trace room.glb --json --error 2", "--error"},
        {"--path-trace room.glb --json --bounces -1", "--bounces"},
        {"--path-trace room.glb --json --bounces 65", "--bounces"},
        {"--path-trace room.glb --json --time -1", "--time"},
        {"--path-trace room.glb --json --seed -1", "--seed"},
        {"--path-trace room.glb --json --seed 4294967296", "--seed"},
        {"--path-trace room.glb --json --pixel corner", "--pixel"},
        {"--path-trace room.glb --json --guide visible", "--guide"},
        /* each way refuses what belongs to another */
        {"--path-trace room.glb --json localhost", "localhost"},
        {"--path-trace room.glb --json --headless", "--headless"},
        {"--path-trace room.glb --json --wait first", "--wait"},
        {"--path-trace room.glb --json --timeout 5", "--timeout"},
        {"--headless --json --spp 4", "--spp"},
        {"--headless --json --error 0.1", "--error"},
        {"--headless --json --bounces 1", "--bounces"},
        {"--headless --json --time 1", "--time"},
        {"--headless --json --seed 1", "--seed"},
        {"--headless --json --pixel box", "--pixel"},
        {"--headless --json --guide learned", "--guide"},
        {"--headless --json --sky 1,1,1", "--sky"},
        {"room.glb --spp 4", "--spp"},
        {"--show shadows", "--show"},
        {"--path-trace room.glb --json --show level", "--show level"},
        {"--headless --json --sun-angle 1", "--sun-angle"},
        {"--headless --json --texels-per-metre 8", "--texels-per-metre"},
        {"--headless --json --atlas-max 64", "--atlas-max"},
        {"--spp 4", "--spp"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct lw_view_options o;
        struct lw_error err;
        if (parse(cases[i].line, &o, &err) != LW_USAGE) fail_msg("\"%s\" was accepted", cases[i].line);
        if (strstr(err.text, cases[i].named) == NULL) fail_msg("\"%s\" gave \"%s\"", cases[i].line, err.text);
        if (strchr(err.text, '\n') != NULL) fail_msg("\"%s\" gave more than a line", cases[i].line);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_defaults),
        cmocka_unit_test(test_renderer),
        cmocka_unit_test(test_mirrors),
        cmocka_unit_test(test_direct),
        cmocka_unit_test(test_addresses),
        cmocka_unit_test(test_a_scene_is_no_server),
        cmocka_unit_test(test_path_trace),
        cmocka_unit_test(test_everything),
        cmocka_unit_test(test_errors_name_the_option),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
