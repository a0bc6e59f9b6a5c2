#include "tests/support/support.h"

#include "client/control/ctl_command.h"
#include "client/control/ctl_names.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Three squares of 1 m, at x = 0, 2 and 4, a light of (10, 10, 10) at (0, 2, 0), and materials: "grey" is
 * dark, "tube" shines by (1, 2, 3), and two are called "globe". */
static struct lw_scene *scene;
static struct lw_material paint[4];
static struct lw_ctl_emission emission[4];
static struct lw_affine place[3], like;
static struct lw_client_light light;
static struct lw_ctl_command_state state;

static int begin(void **unused) {
    (void)unused;
    scene = lw_support_squares(3, 1);
    scene->object[0].name = "chair", scene->object[1].name = "chair", scene->object[2].name = "round table";
    scene->light[0].name = "lamp";
    for (int i = 0; i < 3; i++) {
        place[i] = LW_AFFINE_IDENTITY;
        place[i].m[0][3] = 2 * (float)i;
    }
    memset(paint, 0, sizeof paint);
    memset(emission, 0, sizeof emission);
    for (int i = 0; i < 4; i++) paint[i].name = (const char *[]){"grey", "tube", "globe", "globe"}[i];
    emission[1].now = emission[1].own = lw_vec3(1, 2, 3);
    emission[2].own = emission[3].now = lw_vec3(1, 1, 1); /* one is off; the other was painted bright */
    scene->material = paint, scene->material_count = 4;
    light = (struct lw_client_light){.intensity = {10, 10, 10}};
    like = LW_AFFINE_IDENTITY;
    like.m[1][1] = 3;
    like.m[1][3] = 100; /* where the first one stands is of no account */
    state = (struct lw_ctl_command_state){scene, place, &like, &light, emission};
    return 0;
}

static int free_scene(void **unused) {
    (void)unused;
    lw_scene_destroy(scene);
    return 0;
}

static enum lw_status parse(const char *line, struct lw_scene_change *out, struct lw_error *err) {
    char text[200];
    const char *word[LW_CTL_COMMAND_WORDS_MAX];
    size_t count;
    snprintf(text, sizeof text, "%s", line);
    *err = (struct lw_error){0};
    enum lw_status status = lw_ctl_command_split(text, word, &count, err);
    return status == LW_OK ? lw_ctl_command_parse(&state, word, count, out, err) : status;
}

/* Every command's change is one that a server would make. */
static struct lw_scene_change change_of(const char *line, enum lw_scene_change_kind kind, uint32_t target) {
    struct lw_scene_change c = {.kind = UINT32_MAX};
    struct lw_error err;
    lw_support_ok(parse(line, &c, &err), &err);
    assert_int_equal(c.kind, kind);
    assert_int_equal(c.target, target);
    assert_int_equal(lw_scene_change_check(scene, &c, &err), LW_SCENE_CHANGE_OK);
    return c;
}

static void fails(const char *line, const char *text) {
    struct lw_scene_change c = {.kind = UINT32_MAX};
    struct lw_error err;
    lw_support_fails(parse(line, &c, &err), LW_USAGE, &err, text);
    assert_int_equal(c.kind, UINT32_MAX);
    assert_null(strchr(err.text, '\n'));
}

static void assert_middle(uint32_t object, float x, float y, float z) {
    struct lw_vec3 p = lw_ctl_command_middle(scene, object, &place[object]);
    assert_true(fabsf(p.x - x) < 1e-5f && fabsf(p.y - y) < 1e-5f && fabsf(p.z - z) < 1e-5f);
}

static void objects_move_about_their_middle_one_command_after_another(void **unused) {
    (void)unused;
    struct lw_scene_change c = change_of("move #1 5 -6 7e0", LW_SCENE_CHANGE_OBJECT_TRANSFORM, 1);
    assert_true(c.value[3] == 5 && c.value[7] == -6 && c.value[11] == 7);
    change_of("shift #1 1 0 0", LW_SCENE_CHANGE_OBJECT_TRANSFORM, 1);
    assert_middle(1, 6, -6, 7);
    change_of("turn #1 y 90", LW_SCENE_CHANGE_OBJECT_TRANSFORM, 1);
    assert_middle(1, 6, -6, 7);
    struct lw_vec3 corner = lw_affine_point(&place[1], lw_vec3(0.5f, 0, 0)); /* x has turned to -z */
    assert_true(fabsf(corner.x - 6) < 1e-5f && fabsf(corner.z - 6.5f) < 1e-5f);
    change_of("scale #1 1 1 3", LW_SCENE_CHANGE_OBJECT_TRANSFORM, 1); /* along the world's axes */
    corner = lw_affine_point(&place[1], lw_vec3(0.5f, 0, 0));
    assert_true(fabsf(corner.z - 5.5f) < 1e-5f);
    assert_middle(1, 6, -6, 7);
    c = change_of("turn \"round table\" 90 90 0", LW_SCENE_CHANGE_OBJECT_TRANSFORM, 2);
    corner = lw_vec3_sub(lw_affine_point(&place[2], lw_vec3(1, 0, 0)), lw_vec3(4, 0, 0));
    assert_true(fabsf(corner.y - 1) < 1e-5f); /* x to -z by the yaw, that to +y by the pitch */
    change_of("scale #0 2", LW_SCENE_CHANGE_OBJECT_TRANSFORM, 0);
    change_of("hide #0", LW_SCENE_CHANGE_OBJECT_HIDE, 0);
    change_of("show \"round table\"", LW_SCENE_CHANGE_OBJECT_SHOW, 2);
    change_of("restore #0", LW_SCENE_CHANGE_OBJECT_RESTORE, 0);
}

static void objects_are_added_like_the_first_of_their_mesh(void **unused) {
    (void)unused;
    struct lw_scene_change c = change_of("add square 5 -6 7", LW_SCENE_CHANGE_OBJECT_ADD, 0);
    assert_true(c.value[3] == 5 && c.value[7] == -6 && c.value[11] == 7);
    assert_true(c.value[0] == 1 && c.value[5] == 3 && c.value[2] == 0);
    c = change_of("add #0 5 -6 7 90", LW_SCENE_CHANGE_OBJECT_ADD, 0);
    assert_true(fabsf(c.value[2] - 1) < 1e-6f && fabsf(c.value[8] + 1) < 1e-6f && c.value[5] == 3);
    change_of("remove #1", LW_SCENE_CHANGE_OBJECT_REMOVE, 1);
    fails("add square 1 2", "say add MESH X Y Z");
    fails("add square 1 2 3 4 5", "say add MESH X Y Z");
    fails("add square 1 2 east", "\"east\" is not a number");
    fails("add squares 1 2 3", "no mesh is called \"squares\": near are \"square\" (#0)");
    fails("add #1 1 2 3", "there is no mesh #1: the scene has 1");
    fails("remove", "say remove NAME");
}

static void lights_materials_sky_and_clock(void **unused) {
    (void)unused;
    struct lw_scene_change c = change_of("light lamp colour 1 0 0", LW_SCENE_CHANGE_LIGHT_INTENSITY, 0);
    assert_true(c.value[0] > 40 && c.value[1] == 0); /* red alone is as bright as white was: 10 / 0.2126 */
    c = change_of("light lamp off", LW_SCENE_CHANGE_LIGHT_INTENSITY, 0);
    assert_true(c.value[0] == 0);
    c = change_of("light lamp colour 1 1 1", LW_SCENE_CHANGE_LIGHT_INTENSITY, 0);
    assert_true(fabsf(c.value[2] - 10) < 1e-4f); /* it was off: as the scene has it */
    c = change_of("light #0 on", LW_SCENE_CHANGE_LIGHT_INTENSITY, 0);
    assert_true(c.value[1] == 10);
    change_of("light lamp position 1 2 3", LW_SCENE_CHANGE_LIGHT_POSITION, 0);
    change_of("light lamp direction 0 -1 0", LW_SCENE_CHANGE_LIGHT_DIRECTION, 0);
    change_of("light lamp restore", LW_SCENE_CHANGE_LIGHT_RESTORE, 0);
    change_of("light lamp intensity 40 40 40", LW_SCENE_CHANGE_LIGHT_INTENSITY, 0);
    c = change_of("light lamp colour 1 1 1", LW_SCENE_CHANGE_LIGHT_INTENSITY, 0);
    assert_true(fabsf(c.value[2] - 40) < 1e-4f); /* as the command before has made it */
    c = change_of("material grey albedo 0.1 0.2 0.3", LW_SCENE_CHANGE_MATERIAL_BASE_COLOUR, 0);
    assert_true(c.value[2] == 0.3f);
    change_of("material #0 emission 1 2 3", LW_SCENE_CHANGE_MATERIAL_EMISSION, 0);
    change_of("material #0 restore", LW_SCENE_CHANGE_MATERIAL_RESTORE, 0);
    change_of("sky 1 2 3", LW_SCENE_CHANGE_SKY, 0);
    change_of("sky restore", LW_SCENE_CHANGE_SKY_RESTORE, 0);
    change_of("clock play", LW_SCENE_CHANGE_CLOCK_PLAY, 0);
    change_of("clock pause", LW_SCENE_CHANGE_CLOCK_PAUSE, 0);
    change_of("clock seek 1.5", LW_SCENE_CHANGE_CLOCK_SEEK, 0);
    change_of("clock rate -2", LW_SCENE_CHANGE_CLOCK_RATE, 0);
    change_of("reset", LW_SCENE_CHANGE_RESET, 0);
}

static void assert_shines(const char *line, uint32_t material, float r, float g, float b) {
    struct lw_scene_change c = change_of(line, LW_SCENE_CHANGE_MATERIAL_EMISSION, material);
    assert_true(fabsf(c.value[0] - r) < 1e-5f && fabsf(c.value[1] - g) < 1e-5f &&
                fabsf(c.value[2] - b) < 1e-5f);
}

static void emissive_materials_are_lights(void **unused) {
    (void)unused;
    assert_shines("light tube off", 1, 0, 0, 0);
    assert_shines("light tube on", 1, 1, 2, 3);
    assert_shines("light tube intensity 4 5 6", 1, 4, 5, 6);
    assert_shines("light tube restore", 1, 1, 2, 3); /* and its albedo stays */
    assert_shines("material tube emission 7 7 7", 1, 7, 7, 7);
    assert_shines("light tube colour 2 2 2", 1, 7, 7, 7);
    change_of("material tube restore", LW_SCENE_CHANGE_MATERIAL_RESTORE, 1);
    const float luminance = 0.2126f + 2 * 0.7152f + 3 * 0.0722f;
    assert_shines("light tube colour 5 5 5", 1, luminance, luminance, luminance);
    assert_shines("light tube off", 1, 0, 0, 0);
    assert_shines("light tube colour 1 1 1", 1, luminance, luminance,
                  luminance); /* off: as the scene has it */
    fails("light tube position 1 2 3", "\"tube\" is a material");
    fails("light tube dim", "say light NAME");
    fails("light tub off",
          "no light or emissive material is called \"tub\": near are \"tube\" (material #1)");
    fails("light ube off", "\"tube\" (material #1)");
    fails("light grey off", "no light or emissive material is called \"grey\"");
    fails(
        "light globe on",
        "2 lights or emissive materials are called \"globe\": say which by number: material #2, material #3");
    paint[1].name = "lamp";
    fails("light lamp off", "light #0, material #1 (of a material: material #NUMBER emission R G B)");
    change_of("light #0 off", LW_SCENE_CHANGE_LIGHT_INTENSITY, 0);
    paint[1].name = "tube";
    change_of("material grey emission 1 0 0", LW_SCENE_CHANGE_MATERIAL_EMISSION, 0);
    assert_shines("light grey off", 0, 0, 0, 0); /* it shone, by a command before */
    scene->light_count = 0;
    memset(emission, 0, sizeof emission);
    fails("light tube off", "no light or emissive material is called \"tube\": the scene has none");
    scene->light_count = 1;
}

static void what_is_wrong_is_said_in_a_line(void **unused) {
    (void)unused;
    fails("hide chair", "2 objects are called \"chair\": say which by number: #0, #1");
    fails("hide \"round tabel\"", "near are \"round table\" (#2)");
    fails("hide table", "near are \"round table\" (#2)");
    fails("hide zzzzzzzz", "no object is called \"zzzzzzzz\": the scene has \"chair\" (#0), \"chair\" (#1), "
                           "\"round table\" (#2)");
    struct lw_object *const three = scene->object, many[6]; /* more than a line names */
    for (int i = 0; i < 6; i++) many[i] = three[i / 2];
    scene->object = many, scene->object_count = 6;
    fails("hide zzzzzzzz", "lightwellctl list");
    scene->object = three, scene->object_count = 3;
    fails("light lam off", "no light or emissive material is called \"lam\": near are \"lamp\" (light #0)");
    fails("hide #3", "the scene has 3");
    fails("hide #", "not a number behind #");
    fails("hide #-1", "not a number behind #");
    fails("hide #99999999999999999999", "not a number behind #");
    fails("move #0 1 2", "say move NAME X Y Z");
    fails("move #0 1 2 3m", "\"3m\" is not a number");
    fails("turn #0 w 3", "say turn NAME");
    fails("light lamp", "say light NAME");
    fails("light lamp dim", "say light NAME");
    fails("light lamp colour 0 0 0", "above 0");
    fails("material grey colour 1 1 1", "say material NAME");
    fails("sky 1 1", "say sky R G B");
    fails("clock", "say clock");
    fails("clock stop", "say clock");
    fails("reset all", "say reset");
    fails("list", "stands alone");
    fails("status", "stands alone");
    fails("fly", "there is no command \"fly\" (lightwellctl --help lists them)");
    fails("lst", "there is no command \"lst\": near is \"list\"");
    fails("colck play", "near is \"clock\"");
    fails("mat grey", "near is \"material\"");
    fails("hide \"chair", "does not end");
    fails("a b c d e f g h i j k l m n o p q", "too many words");
    fails("", "missing");
    fails("# hide chair", "missing");
}

static void commands_are_known_by_name(void **unused) {
    (void)unused;
    assert_true(lw_ctl_command_is("list") && lw_ctl_command_is("move") && lw_ctl_command_is("reset"));
    assert_false(lw_ctl_command_is("127.0.0.1:7780") || lw_ctl_command_is("") || lw_ctl_command_is("--"));
    assert_non_null(strstr(lw_ctl_command_help(), "clock seek SECONDS"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(objects_are_added_like_the_first_of_their_mesh, begin, free_scene),
        cmocka_unit_test_setup_teardown(objects_move_about_their_middle_one_command_after_another, begin,
                                        free_scene),
        cmocka_unit_test_setup_teardown(lights_materials_sky_and_clock, begin, free_scene),
        cmocka_unit_test_setup_teardown(emissive_materials_are_lights, begin, free_scene),
        cmocka_unit_test_setup_teardown(what_is_wrong_is_said_in_a_line, begin, free_scene),
        cmocka_unit_test_setup_teardown(commands_are_known_by_name, begin, free_scene),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
