/* Rays from lamps: what they bring to a small disc is its E by the closed form, lamp by lamp; and what a
 * point gets from the place where a ray began follows the same law. */
#include "common/base/random.h"
#include "common/light/direction.h"
#include "common/light/lamp_rays.h"
#include "tests/support/light_stage.h"

#include <math.h>
#include <string.h>

#define RAYS     (1u << 18)
#define RADIUS_M 0.4f

static const float pi = 3.14159265f;

/* A scene of one quad that shines both ways or not at all, one light and a sky, in a box of 4 x 2 x 3 m. */
struct stage {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_lights lights;
    struct lw_lamp_rays lamps;
};

static void begin(struct stage *s, float emission, bool both, const struct lw_light *light, float sky) {
    struct lw_error err = {0};
    *s = (struct stage){.scene = light_stage_create()};
    /* faces down */
    light_stage_add_quad(s->scene, lw_vec3(-0.4f, 1.2f, -0.3f), lw_vec3(0.8f, 0, 0), lw_vec3(0, 0, 0.6f),
                         emission, both);
    /* dark: the floor, which makes the box */
    light_stage_add_quad(s->scene, lw_vec3(-2, -0.5f, -1.5f), lw_vec3(0, 0, 3), lw_vec3(4, 0, 0), 0, false);
    if (light) light_stage_add_light(s->scene, *light, lw_vec3(0.2f, 1.5f, -0.1f));
    for (int c = 0; c < 3; c++) s->scene->sky[c] = sky;
    lw_support_ok(lw_scene_validate(s->scene, &err), &err);
    lw_support_ok(lw_pose_init(&s->pose, s->scene), NULL);
    lw_support_ok(lw_lights_init(&s->lights, s->scene, &s->pose), NULL);
    lw_support_ok(lw_lamp_rays_init(&s->lamps, &s->lights), NULL);
    lw_lamp_rays_set_pose(&s->lamps, &s->pose);
}

static void end(struct stage *s) {
    lw_lamp_rays_finish(&s->lamps);
    lw_lights_finish(&s->lights);
    lw_pose_finish(&s->pose);
    lw_scene_destroy(s->scene);
}

/* E of a disc, by rays as if nothing were in their way. */
static double e_by_rays(const struct stage *s, struct lw_vec3 point, struct lw_vec3 normal, float radius) {
    double sum = 0;
    for (uint32_t i = 0; i < RAYS; i++) {
        float place[2], way[2];
        struct lw_lamp_ray ray;
        lw_random_sobol2(i, 1, place);
        lw_random_sobol2(i, 2, way);
        const float pick = ((float)i + 0.5f) / (float)RAYS;
        assert_true(lw_lamp_rays_sample(&s->lamps, pick, place, way, &ray));
        assert_float_equal(lw_vec3_length(ray.direction), 1, 1e-5f);
        const float along = -lw_vec3_dot(ray.direction, normal);
        const float t = lw_vec3_dot(lw_vec3_sub(ray.origin, point), normal) / along;
        if (!(along > 0) || !(t > 0)) continue;
        const struct lw_vec3 off = lw_vec3_sub(lw_vec3_mad(ray.origin, ray.direction, t), point);
        if (lw_vec3_dot(off, off) < radius * radius) sum += (double)ray.flux_w.x;
    }
    return sum / RAYS / (double)(pi * radius * radius);
}

/* E there by lights.h: the mean of many samples. */
static double e_by_samples(const struct stage *s, struct lw_vec3 middle, struct lw_vec3 normal,
                           float radius) {
    struct lw_vec3 t, b;
    double sum = 0;
    lw_vec3_frame(normal, &t, &b);
    for (uint32_t i = 0; i < RAYS; i++) {
        float at[2], on[2];
        lw_random_sobol2(i, 3, at);
        lw_random_sobol2(i, 4, on);
        const float r = radius * sqrtf(on[0]), angle = 2 * pi * on[1];
        const struct lw_vec3 point = lw_vec3_mad(lw_vec3_mad(middle, t, r * cosf(angle)), b, r * sinf(angle));
        const struct lw_light_sample sample =
            lw_lights_sample(&s->lights, point, normal, lw_random_unit(lw_random_hash(i)), at[0], at[1]);
        sum += (double)(sample.irradiance_normal.x * fmaxf(0, lw_vec3_dot(sample.direction, normal)));
    }
    return sum / RAYS;
}

static void expect_the_same_light(struct stage *s, double tolerance) {
    const struct lw_vec3 point = lw_vec3(0.1f, 0, 0.1f), up = lw_vec3(0, 1, 0),
                         tilted = lw_vec3_normalize(lw_vec3(0.5f, 0.8f, -0.3f));
    for (int k = 0; k < 2; k++) {
        const double rays = e_by_rays(s, point, k ? tilted : up, RADIUS_M),
                     samples = e_by_samples(s, point, k ? tilted : up, RADIUS_M);
        print_message("by rays %.4f, by samples %.4f\n", rays, samples);
        assert_true(samples > 0 && fabs(rays / samples - 1) < tolerance);
    }
    end(s);
}

/* One ray in 40 or so meets the disc. */
static void test_each_lamp(void **state) {
    (void)state;
    static const struct lw_light light[] = {
        {.kind = LW_LIGHT_POINT, .intensity = {3, 3, 3}},
        {.kind = LW_LIGHT_SPOT, .intensity = {5, 5, 5}, .inner_cone = 0.3f, .outer_cone = 0.9f},
        {.kind = LW_LIGHT_DIRECTIONAL, .intensity = {2, 2, 2}, .angular_diameter = 0.1f},
    };
    struct stage s;
    for (int i = 0; i < 3; i++) {
        begin(&s, 0, false, &light[i], 0);
        expect_the_same_light(&s, 0.02);
    }
    begin(&s, 4, false, NULL, 0);
    expect_the_same_light(&s, 0.02);
    begin(&s, 4, true, NULL, 0);
    expect_the_same_light(&s, 0.02);
    begin(&s, 0, false, NULL, 0.7f);
    expect_the_same_light(&s, 0.06); /* from everywhere: some 2,600 rays meet the disc, at random */
}

static void test_all_together(void **state) {
    (void)state;
    struct stage s;
    begin(&s, 4, true, &(struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {3, 3, 3}}, 0.7f);
    expect_the_same_light(&s, 0.02);
}

static void test_none_shines(void **state) {
    (void)state;
    struct stage s;
    struct lw_lamp_ray ray;
    begin(&s, 0, false, NULL, 0);
    assert_false(lw_lamp_rays_sample(&s.lamps, 0.5f, (float[2]){0.5f, 0.5f}, (float[2]){0.5f, 0.5f}, &ray));
    end(&s);
}

/* From a place on a lamp two points get light by the inverse square and the cosine at the lamp. */
static void test_sight(void **state) {
    (void)state;
    struct stage s;
    struct lw_lamp_ray ray;
    begin(&s, 4, false, NULL, 0);
    assert_true(lw_lamp_rays_sample(&s.lamps, 0.5f, (float[2]){0.3f, 0.6f}, (float[2]){0.2f, 0.1f}, &ray));
    const struct lw_vec3 below = lw_vec3_add(ray.origin, lw_vec3(0, -1, 0)),
                         aside = lw_vec3_add(ray.origin, lw_vec3(1, -1, 0)),
                         behind = lw_vec3_add(ray.origin, lw_vec3(0, 0.5f, 0));
    const struct lw_light_sample a = lw_lamp_rays_sight(&s.lamps, &ray.place, below),
                                 b = lw_lamp_rays_sight(&s.lamps, &ray.place, aside),
                                 c = lw_lamp_rays_sight(&s.lamps, &ray.place, behind);
    assert_float_equal(a.distance_m, 1, 1e-5f);
    assert_float_equal(b.irradiance_normal.x / a.irradiance_normal.x, sqrtf(0.5f) / 2, 1e-5f);
    assert_true(c.irradiance_normal.x == 0);
    s.pose.object_hidden[0] = true;
    lw_lights_set_pose(&s.lights, &s.pose);
    assert_true(lw_lamp_rays_sight(&s.lamps, &ray.place, below).irradiance_normal.x == 0);
    end(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_each_lamp),
        cmocka_unit_test(test_all_together),
        cmocka_unit_test(test_none_shines),
        cmocka_unit_test(test_sight),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
