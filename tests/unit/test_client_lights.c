/* Who draws a light: the rule, names, bits of the wire; parts of the lights add up to all. */
#include "common/base/colour.h"
#include "common/base/random.h"
#include "common/builtin/builtin.h"
#include "common/light/client_lights.h"
#include "tests/support/support.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

struct stage {
    struct lw_scene variant, *scene; /* with materials and lights of its own */
    struct lw_pose pose;
};

/* Built once. */
static struct lw_scene *atrium;

static void begin(struct stage *s, const char *name) {
    const bool is_atrium = strcmp(name, "builtin:atrium-matt") == 0;
    struct lw_error err = {0};
    if (is_atrium) {
        if (!atrium) lw_support_ok(lw_builtin_build(name, &atrium, &err), &err);
        lw_support_ok(lw_scene_init_variant(&s->variant, atrium), NULL);
        s->variant.light = lw_scene_alloc(atrium, atrium->light_count, sizeof *atrium->light);
        assert_non_null(s->variant.light);
        memcpy(s->variant.light, atrium->light, atrium->light_count * sizeof *atrium->light);
        s->scene = &s->variant;
    } else
        lw_support_ok(lw_builtin_build(name, &s->scene, &err), &err);
    lw_support_ok(lw_pose_init(&s->pose, s->scene), NULL);
}

static void end(struct stage *s) {
    lw_pose_finish(&s->pose);
    if (s->scene == &s->variant)
        lw_scene_finish_variant(&s->variant);
    else
        lw_scene_destroy(s->scene);
}

static int destroy_atrium(void **state) {
    (void)state;
    lw_scene_destroy(atrium);
    return 0;
}

static uint32_t find_material(const struct lw_scene *scene, bool shines) {
    for (uint32_t m = 0; m < scene->material_count; m++)
        if ((scene->material[m].emission[0] > 0) == shines) return m;
    fail_msg("no such material");
    return 0;
}

static void small_emitters_and_punctual_lights(void **state) {
    (void)state;
    struct stage s;
    struct lw_error err = {0};
    struct lw_client_lights client;
    begin(&s, "builtin:atrium-matt");
    lw_support_ok(lw_client_lights_init(&client, s.scene, &s.pose, "auto", &err), &err);
    assert_int_equal(client.drawn_lights, s.scene->light_count);
    uint32_t emissive = 0;
    for (uint32_t m = 0; m < s.scene->material_count; m++) {
        const bool shines = s.scene->material[m].emission[0] > 0;
        emissive += shines;
        assert_int_equal(client.material[m], shines); /* lamp and lantern are small */
    }
    assert_true(emissive > 0);
    assert_int_equal(client.drawn_materials, emissive);
    assert_true(lw_client_lights_any(&client));
    lw_client_lights_finish(&client);

    /* so are all where glass colours light on its way, but by name */
    struct lw_material *glass = &s.scene->material[find_material(s.scene, false)];
    const uint8_t opaque = glass->alpha_mode;
    glass->alpha_mode = LW_ALPHA_BLEND;
    glass->tint[0] = 2;
    lw_support_ok(lw_client_lights_init(&client, s.scene, &s.pose, "auto", &err), &err);
    assert_false(lw_client_lights_any(&client));
    lw_client_lights_finish(&client);
    lw_support_ok(lw_client_lights_init(&client, s.scene, &s.pose, "lamps", &err), &err);
    assert_int_equal(client.drawn_lights, s.scene->light_count);
    lw_client_lights_finish(&client);
    glass->tint[0] = 0;
    glass->alpha_mode = opaque;

    /* the same lamps ten times as large are the server's */
    for (uint32_t o = 0; o < s.scene->object_count; o++)
        for (int c = 0; c < 12; c++) s.pose.object_to_world[o].m[c / 4][c % 4] *= 10;
    lw_support_ok(lw_client_lights_init(&client, s.scene, &s.pose, NULL, &err), &err);
    assert_int_equal(client.drawn_materials, 0);
    lw_client_lights_finish(&client);
    assert_false(lw_client_lights_any(&client));
    end(&s);
}

/* One large emitter among small pieces of the same material makes it the server's. */
static void connected_pieces_count(void **state) {
    (void)state;
    struct stage s;
    struct lw_error err = {0};
    struct lw_client_lights client;
    begin(&s, "builtin:cornell");
    const uint32_t lamp = find_material(s.scene, true);
    lw_support_ok(lw_client_lights_init(&client, s.scene, &s.pose, "auto", &err), &err);
    assert_int_equal(client.material[lamp], 1);
    lw_client_lights_finish(&client);
    const uint32_t wall = find_material(s.scene, false);
    const float emission[3] = {1, 1, 1};
    memcpy(s.scene->material[wall].emission, emission, sizeof emission);
    lw_support_ok(lw_client_lights_init(&client, s.scene, &s.pose, "auto", &err), &err);
    assert_int_equal(client.material[lamp], 1);
    assert_int_equal(client.material[wall], 0); /* walls of 5.5 m */
    lw_client_lights_finish(&client);
    end(&s);
}

static void names_choose(void **state) {
    (void)state;
    struct stage s;
    struct lw_error err = {0};
    struct lw_client_lights client;
    begin(&s, "builtin:atrium-matt");
    const uint32_t lamp = find_material(s.scene, true), dark = find_material(s.scene, false);
    lw_support_ok(lw_client_lights_init(&client, s.scene, &s.pose, "none", &err), &err);
    assert_false(lw_client_lights_any(&client));
    lw_client_lights_finish(&client);
    lw_support_ok(lw_client_lights_init(&client, s.scene, &s.pose, "lamps", &err), &err);
    assert_int_equal(client.drawn_lights, s.scene->light_count);
    assert_int_equal(client.drawn_materials, 0);
    lw_client_lights_finish(&client);
    char names[256];
    snprintf(names, sizeof names, "%s,%s", s.scene->light[0].name, s.scene->material[lamp].name);
    lw_support_ok(lw_client_lights_init(&client, s.scene, &s.pose, names, &err), &err);
    assert_int_equal(client.light[0], 1);
    assert_int_equal(client.material[lamp], 1);
    lw_client_lights_finish(&client);
    assert_int_equal(lw_client_lights_init(&client, s.scene, &s.pose, "nobody", &err), LW_USAGE);
    assert_non_null(strstr(err.text, "nobody"));
    err = (struct lw_error){0};
    snprintf(names, sizeof names, "%s,", s.scene->light[0].name);
    assert_int_equal(lw_client_lights_init(&client, s.scene, &s.pose, names, &err), LW_USAGE);
    err = (struct lw_error){0};
    assert_int_equal(lw_client_lights_init(&client, s.scene, &s.pose, s.scene->material[dark].name, &err),
                     LW_USAGE);
    assert_non_null(strstr(err.text, "does not shine"));
    assert_null(client.light);
    end(&s);
}

static void the_scene_says_who_draws(void **state) {
    (void)state;
    struct stage s;
    struct lw_error err = {0};
    struct lw_client_lights client;
    begin(&s, "builtin:atrium-matt");
    const uint32_t lamp = find_material(s.scene, true), dark = find_material(s.scene, false);
    s.scene->light[0].drawn_by = LW_DRAWN_BY_SERVER;
    s.scene->material[lamp].drawn_by = LW_DRAWN_BY_SERVER;
    s.scene->material[dark].drawn_by = LW_DRAWN_BY_CLIENTS; /* does not shine */
    lw_support_ok(lw_client_lights_init(&client, s.scene, &s.pose, "auto", &err), &err);
    assert_int_equal(client.light[0], 0);
    assert_int_equal(client.drawn_lights, s.scene->light_count - 1);
    assert_int_equal(client.material[lamp], 0);
    assert_int_equal(client.material[dark], 0);
    lw_client_lights_finish(&client);

    /* who runs the server has the last word */
    char names[256];
    snprintf(names, sizeof names, "%s,%s", s.scene->light[0].name, s.scene->material[lamp].name);
    lw_support_ok(lw_client_lights_init(&client, s.scene, &s.pose, names, &err), &err);
    assert_int_equal(client.light[0], 1);
    assert_int_equal(client.material[lamp], 1);
    lw_client_lights_finish(&client);

    /* a lamp ten times as large, but the scene says */
    s.scene->material[lamp].drawn_by = LW_DRAWN_BY_CLIENTS;
    for (uint32_t o = 0; o < s.scene->object_count; o++)
        for (int c = 0; c < 12; c++) s.pose.object_to_world[o].m[c / 4][c % 4] *= 10;
    lw_support_ok(lw_client_lights_init(&client, s.scene, &s.pose, NULL, &err), &err);
    assert_int_equal(client.material[lamp], 1);
    assert_int_equal(client.drawn_materials, 1);
    lw_client_lights_finish(&client);
    end(&s);
}

static void bits_are_least_significant_first(void **state) {
    (void)state;
    uint8_t light[3] = {1, 0, 1}, material[9] = {0, 1, 0, 0, 0, 0, 0, 0, 1};
    const struct lw_client_lights client = {
        .light_count = 3, .material_count = 9, .light = light, .material = material};
    uint8_t out_light[1] = {0xff}, out_material[2] = {0xff, 0xff};
    assert_int_equal(lw_client_lights_bytes(3), 1);
    assert_int_equal(lw_client_lights_bytes(9), 2);
    lw_client_lights_write(&client, out_light, out_material);
    assert_int_equal(out_light[0], 0x05);
    assert_int_equal(out_material[0], 0x02);
    assert_int_equal(out_material[1], 0x01);
}

/* Unoccluded E of a point, each part by itself and all together, of many samples. */
static double irradiance(const struct lw_lights *lights, struct lw_vec3 point, struct lw_vec3 normal) {
    enum { SAMPLES = 40000 };
    double sum = 0;
    for (uint32_t i = 0; i < SAMPLES; i++) {
        const struct lw_light_sample sample = lw_lights_sample(
            lights, point, normal, lw_random_unit(lw_random_hash3(1, i, 0)),
            lw_random_unit(lw_random_hash3(1, i, 1)), lw_random_unit(lw_random_hash3(1, i, 2)));
        sum += (double)(lw_colour_luminance(sample.irradiance_normal) *
                        fmaxf(0, lw_vec3_dot(sample.direction, normal)));
    }
    return sum / SAMPLES;
}

static void parts_add_up(void **state) {
    (void)state;
    struct stage s;
    struct lw_error err = {0};
    struct lw_client_lights client;
    struct lw_lights all, part[2];
    begin(&s, "builtin:atrium-matt");
    lw_support_ok(lw_client_lights_init(&client, s.scene, &s.pose, "auto", &err), &err);
    lw_support_ok(lw_lights_init(&all, s.scene, &s.pose), NULL);
    for (int drawn = 0; drawn < 2; drawn++) {
        const struct lw_lights_part of = lw_client_lights_part(&client, drawn);
        lw_support_ok(lw_lights_init_part(&part[drawn], s.scene, &s.pose, &of), NULL);
        lw_support_ok(lw_lights_set_materials(&part[drawn], &s.pose), NULL); /* the part stays */
    }
    assert_int_equal(part[0].emitter_count + part[1].emitter_count, all.emitter_count);
    assert_true(part[1].emitter_count > 0);
    assert_int_equal(part[1].sun_count + part[1].near_count, s.scene->light_count);
    assert_true(part[0].sky_luminance == all.sky_luminance && part[1].sky_luminance == 0);
    const struct lw_vec3 point = lw_vec3(0.3f, 1.5f, 0.4f), up = lw_vec3(0, 1, 0);
    const double both = irradiance(&part[0], point, up) + irradiance(&part[1], point, up),
                 whole = irradiance(&all, point, up);
    assert_true(fabs(both / whole - 1) < 0.03);
    for (int drawn = 0; drawn < 2; drawn++) lw_lights_finish(&part[drawn]);
    lw_lights_finish(&all);
    lw_client_lights_finish(&client);
    end(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(small_emitters_and_punctual_lights), cmocka_unit_test(connected_pieces_count),
        cmocka_unit_test(the_scene_says_who_draws),           cmocka_unit_test(names_choose),
        cmocka_unit_test(bits_are_least_significant_first),   cmocka_unit_test(parts_add_up)};
    return cmocka_run_group_tests(tests, NULL, destroy_atrium);
}
