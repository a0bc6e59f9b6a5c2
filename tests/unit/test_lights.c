/* One sample over all lights: unbiased, and its density is the one that the other technique gets. */
#include "common/base/colour.h"
#include "common/base/random.h"
#include "common/light/direction.h"
#include "common/light/lights16.h"
#include "tests/support/light_stage.h"

#include <math.h>
#include <string.h>

struct stage {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_lights lights;
};

static void ready(struct stage *s) {
    struct lw_error err = {0};
    lw_support_ok(lw_scene_validate(s->scene, &err), &err);
    lw_support_ok(lw_pose_init(&s->pose, s->scene), NULL);
    lw_support_ok(lw_lights_init(&s->lights, s->scene, &s->pose), NULL);
}

static void end(struct stage *s) {
    lw_lights_finish(&s->lights);
    lw_pose_finish(&s->pose);
    lw_scene_destroy(s->scene);
}

static const struct lw_vec3 origin = {0, 0, 0}, up = {0, 1, 0};

/* Two lamps overhead, one of them shining both ways, one that turns its back, a point, a spot, two suns, a
 * sky. */
static void everything(struct stage *s, unsigned lamps) {
    *s = (struct stage){.scene = light_stage_create()};
    for (unsigned i = 0; i < lamps; i++) {
        float x = 0.9f * (float)(i % 6) - 2.5f, z = 0.8f * (float)(i / 6) - 1.5f;
        light_stage_add_quad(s->scene, lw_vec3(x, 1 + 0.2f * (float)(i % 3), z), lw_vec3(0.5f, 0, 0),
                             lw_vec3(0, 0, 0.4f), 1 + (float)(i % 4), i % 5 == 1);
    }
    light_stage_add_quad(s->scene, lw_vec3(0.3f, 0.1f, 0.2f), lw_vec3(0, 0, 0.3f), lw_vec3(0.3f, 0, 0), 40,
                         false);
    light_stage_add_quad(s->scene, lw_vec3(1, -0.5f, 0.5f), lw_vec3(0, 1, 0), lw_vec3(0, 0, -1), 2,
                         false); /* across the horizon */
    light_stage_add_light(s->scene, (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {3, 3, 3}},
                          lw_vec3(1, 1, 1));
    light_stage_add_light(
        s->scene,
        (struct lw_light){
            .kind = LW_LIGHT_SPOT, .intensity = {5, 5, 5}, .inner_cone = 0.3f, .outer_cone = 0.9f},
        lw_vec3(-0.3f, 1.2f, 0));
    light_stage_add_light(s->scene, (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {9, 9, 9}},
                          lw_vec3(0, -1, 0));
    for (int i = 1; i < 3; i++)
        light_stage_add_light(s->scene,
                              (struct lw_light){.kind = LW_LIGHT_DIRECTIONAL,
                                                .intensity = {(float)i, (float)i, (float)i},
                                                .angular_diameter = 0.01f},
                              origin);
    for (int c = 0; c < 3; c++) s->scene->sky[c] = 0.4f;
    ready(s);
}

/* E at the origin, facing up, of a polygon above the horizon: Lambert's formula (L/2) sum of angle x (edge
 * normal . n). */
static double polygon_irradiance(double radiance, const struct lw_vec3 *p, unsigned count) {
    double sum = 0;
    for (unsigned i = 0; i < count; i++) {
        struct lw_vec3 a = lw_vec3_normalize(p[i]), b = lw_vec3_normalize(p[(i + 1) % count]);
        struct lw_vec3 axis = lw_vec3_cross(a, b);
        double sine = (double)lw_vec3_length(axis);
        if (!(sine > 0)) continue;
        sum += atan2(sine, (double)lw_vec3_dot(a, b)) * (double)axis.y / sine;
    }
    return 0.5 * radiance * fabs(sum);
}

/* A quad's irradiance: cut off at the horizon, 0 where the origin sees a side that does not shine. */
static double quad_irradiance(const struct lw_scene *scene, uint32_t object) {
    const struct lw_mesh *mesh = &scene->mesh[object];
    const struct lw_material *m = &scene->material[object];
    if (!m->double_sided && lw_vec3_dot(mesh->position[0], mesh->normal[0]) >= 0) return 0;
    struct lw_vec3 cut[8];
    unsigned count = 0;
    for (unsigned i = 0; i < 4; i++) {
        struct lw_vec3 a = mesh->position[i], b = mesh->position[(i + 1) % 4];
        if (a.y >= 0) cut[count++] = a;
        if ((a.y < 0) != (b.y < 0)) cut[count++] = lw_vec3_mad(a, lw_vec3_sub(b, a), a.y / (a.y - b.y));
    }
    return polygon_irradiance((double)m->emission[0], cut, count);
}

static double irradiance(const struct stage *s) {
    const double pi = acos(-1.0);
    double e = pi * (double)s->scene->sky[0];
    for (uint32_t o = 0; o < s->scene->object_count; o++) e += quad_irradiance(s->scene, o);
    for (uint32_t i = 0; i < s->scene->light_count; i++) {
        const struct lw_light *l = &s->scene->light[i];
        struct lw_vec3 p = s->pose.light[i].position_ws;
        double d = (double)lw_vec3_length(p), cosine = (double)p.y / d, i0 = (double)l->intensity[0];
        double f =
            (cosine - cos((double)l->outer_cone)) /
            (cos((double)l->inner_cone) - cos((double)l->outer_cone)); /* shines down: cos is the same */
        f = f < 0 ? 0 : f > 1 ? 1 : f;
        if (l->kind == LW_LIGHT_DIRECTIONAL) e += i0;
        if (l->kind == LW_LIGHT_POINT && cosine > 0) e += i0 * cosine / (d * d);
        if (l->kind == LW_LIGHT_SPOT && cosine > 0) e += i0 * cosine / (d * d) * f * f;
    }
    return e;
}

static struct lw_light_sample sample_of(const struct stage *s, uint32_t i) {
    float a[2], b[2];
    lw_random_sobol2(i, 7, a);
    lw_random_sobol2(i, 99, b);
    return lw_lights_sample(&s->lights, origin, up, a[0], b[0], b[1]);
}

/* Where a ray from the origin meets a triangle; false if it does not. */
static bool meet(const struct lw_mesh *mesh, uint32_t t, struct lw_vec3 dir, float *out_distance,
                 float *out_u, float *out_v) {
    const uint32_t *k = mesh->triangle[t];
    struct lw_vec3 a = mesh->position[k[0]], e1 = lw_vec3_sub(mesh->position[k[1]], a),
                   e2 = lw_vec3_sub(mesh->position[k[2]], a), p = lw_vec3_cross(dir, e2);
    float det = lw_vec3_dot(e1, p);
    if (fabsf(det) < 1e-12f) return false;
    struct lw_vec3 from = lw_vec3_scale(a, -1), q = lw_vec3_cross(from, e1);
    *out_u = lw_vec3_dot(from, p) / det;
    *out_v = lw_vec3_dot(dir, q) / det;
    *out_distance = lw_vec3_dot(e2, q) / det;
    return *out_u >= 0 && *out_v >= 0 && *out_u + *out_v <= 1 && *out_distance > 0;
}

/* The density of a direction for the other technique: the densities of all emitters along it. */
static double density(const struct stage *s, struct lw_vec3 dir, float nearest, float farthest) {
    double pdf = farthest < INFINITY ? 0 : (double)lw_lights_pdf_sky(&s->lights, origin, up, dir);
    for (uint32_t o = 0; o < s->scene->object_count; o++)
        for (uint32_t t = 0; t < 2; t++) {
            float distance, u, v;
            if (meet(&s->scene->mesh[o], t, dir, &distance, &u, &v) && distance >= nearest &&
                distance <= farthest)
                pdf += (double)lw_lights_pdf_emitter(&s->lights, origin, up, o, t, u, v, dir, distance);
        }
    return pdf;
}

static void expect_everything(unsigned lamps, double tolerance) {
    struct stage s;
    everything(&s, lamps);
    enum { N = 1 << 18 };
    double sum = 0, squares = 0, chance = 0;
    for (uint32_t i = 0; i < N; i++) {
        struct lw_light_sample sample = sample_of(&s, i);
        double e = (double)(sample.irradiance_normal.x * fmaxf(0, lw_vec3_dot(sample.direction, up)));
        assert_true(isfinite(e) && e >= 0);
        sum += e;
        squares += e * e;
        /* the density of the sample is the one that the other technique gets */
        if (sample.pdf > 0) {
            chance += 1;
            double stated =
                density(&s, sample.direction, 0.999f * sample.distance_m, 1.001f * sample.distance_m);
            if (i % 64 == 0 && fabs(stated / (double)sample.pdf - 1) > 0.01)
                fail_msg("sampled with density %g, stated %g", (double)sample.pdf, stated);
        }
    }
    double mean = sum / N, sigma = sqrt((squares / N - mean * mean) / N), want = irradiance(&s);
    if (fabs(mean - want) > fmax(tolerance * want, 4 * sigma) || 4 * sigma > tolerance * want)
        fail_msg("E %g, expected %g; sigma %g", mean, want, sigma);

    /* all directions' densities together are the share of the samples that have one */
    double total = 0, total2 = 0;
    for (uint32_t i = 0; i < N; i++) {
        float p[2];
        lw_random_sobol2(i, 3, p);
        float z = 1 - 2 * p[0], r = sqrtf(1 - z * z), angle = 2 * LW_PI * p[1];
        double d = 4 * acos(-1.0) * density(&s, lw_vec3(r * cosf(angle), r * sinf(angle), z), 0, INFINITY);
        total += d;
        total2 += d * d;
    }
    sigma = sqrt((total2 / N - total / N * (total / N)) / N);
    if (fabs(total - chance) / N > 4 * sigma || 4 * sigma > 0.03)
        fail_msg("densities sum up to %g, samples to %g; sigma %g", total / N, chance / N, sigma);
    end(&s);
}

static void test_few_lights(void **state) {
    (void)state;
    expect_everything(2, 0.02);
}

static void test_many_lights(void **state) {
    (void)state;
    expect_everything(30, 0.02);
}

/* A point that nothing can light gets samples of nothing, never NaN. */
static void test_no_light(void **state) {
    (void)state;
    struct stage s;
    s = (struct stage){.scene = light_stage_create()};
    light_stage_add_quad(s.scene, lw_vec3(-1, 1, -1), lw_vec3(0, 0, 2), lw_vec3(2, 0, 0), 1,
                         false); /* its back */
    light_stage_add_light(s.scene, (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {1, 1, 1}},
                          lw_vec3(0, -1, 0));
    light_stage_add_light(s.scene, (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {1, 1, 1}}, origin);
    ready(&s);
    for (uint32_t i = 0; i < 64; i++) {
        struct lw_light_sample sample = sample_of(&s, i);
        assert_true(sample.irradiance_normal.x == 0 && sample.pdf == 0);
        assert_true(lw_vec3_is_finite(sample.direction));
    }
    assert_true(lw_lights_pdf_emitter(&s.lights, origin, up, 0, 0, 0.2f, 0.2f, up, 1) == 0);
    assert_true(lw_lights_pdf_sky(&s.lights, origin, up, up) == 0);
    end(&s);
}

static void test_what_does_not_shine_has_no_density(void **state) {
    (void)state;
    struct stage s;
    s = (struct stage){.scene = light_stage_create()};
    light_stage_add_quad(s.scene, lw_vec3(-1, 1, -1), lw_vec3(2, 0, 0), lw_vec3(0, 0, 2), 0, false);
    light_stage_add_quad(s.scene, lw_vec3(-1, 2, -1), lw_vec3(2, 0, 0), lw_vec3(0, 0, 2), 1, false);
    ready(&s);
    assert_true(lw_lights_pdf_emitter(&s.lights, origin, up, 0, 0, 0.2f, 0.2f, up, 1) == 0);
    assert_true(lw_lights_pdf_emitter(&s.lights, origin, up, 1, 0, 0.2f, 0.2f, up, 2) > 0);
    end(&s);
}

/* A hidden emitter gives nothing; materials and sky are taken over, with triangles that did not shine
 * before. */
static void test_changes(void **state) {
    (void)state;
    struct stage s;
    s = (struct stage){.scene = light_stage_create()};
    light_stage_add_quad(s.scene, lw_vec3(-0.5f, 1, -0.5f), lw_vec3(1, 0, 0), lw_vec3(0, 0, 1), 3, false);
    light_stage_add_quad(s.scene, lw_vec3(-0.5f, 2, -0.5f), lw_vec3(1, 0, 0), lw_vec3(0, 0, 1), 0, false);
    ready(&s);
    assert_int_equal(s.lights.emitter_count, 2);
    assert_true(s.lights.shining_count);
    s.pose.object_hidden[0] = true;
    lw_lights_set_pose(&s.lights, &s.pose);
    assert_false(s.lights.shining_count);
    assert_true(lw_lights_sample(&s.lights, origin, up, 0.5f, 0.5f, 0.5f).irradiance_normal.x == 0);
    s.scene->material[1].emission[0] = 2;
    s.scene->sky[2] = 5;
    lw_support_ok(lw_lights_set_materials(&s.lights, &s.pose), NULL);
    assert_int_equal(s.lights.emitter_count, 4);
    assert_true(s.lights.shining_count && s.lights.sky_luminance > 0);
    for (uint32_t i = 0; i < 4; i++)
        assert_int_equal(s.lights.emitter[i].power > 0, s.lights.emitter[i].object == 1);
    end(&s);
}

/* ---- sixteen points at once ---- */

/* Around the lamps, some of them very near, facing anywhere. */
static void scatter_points(struct lw_points16 *points, uint32_t round) {
    for (uint32_t i = 0; i < 16; i++) {
        float at[2], n[2];
        lw_random_sobol2(round * 16 + i, 1, at);
        lw_random_sobol2(round * 16 + i, 2, n);
        const struct lw_vec3 normal = lw_direction_sphere(n);
        points->x[i] = 6 * at[0] - 3, points->y[i] = 3 * n[1] - 1.2f, points->z[i] = 5 * at[1] - 2.5f;
        points->nx[i] = normal.x, points->ny[i] = normal.y, points->nz[i] = normal.z;
    }
}
static struct lw_vec3 point_of(const struct lw_points16 *p, uint32_t i) {
    return lw_vec3(p->x[i], p->y[i], p->z[i]);
}
static struct lw_vec3 normal_of(const struct lw_points16 *p, uint32_t i) {
    return lw_vec3(p->nx[i], p->ny[i], p->nz[i]);
}

/* The same kernels: the same directions, to the bit. Returns whether anything arrives. */
static bool expect_same(const struct lw_light_sample16 *wide, const struct lw_points16 *points, uint32_t i,
                        const struct lw_light_sample *one) {
    const float cosine = lw_vec3_dot(one->direction, normal_of(points, i)),
                want = cosine > 0 ? one->irradiance_normal.x * cosine : 0;
    if (!(fabsf(wide->e[0][i] - want) <= 1e-5f * want))
        fail_msg("E %g, one by one %g", (double)wide->e[0][i], (double)want);
    assert_int_equal(lw_light_sample16_lit(wide) >> i & 1, want > 0);
    if (!(want > 0)) return false;
    assert_true(wide->dir_x[i] == one->direction.x && wide->dir_y[i] == one->direction.y &&
                wide->dir_z[i] == one->direction.z && wide->distance_m[i] == one->distance_m);
    return true;
}

static uint32_t split(const struct stage *s, struct lw_light_group group[LW_LIGHTS_EXACT_MAX]) {
    const struct lw_light_region all = {origin, up, 100, -1};
    return lw_light_tree_split(&s->lights.tree, 0, &all, 8, group);
}

static uint32_t compare_near(const struct stage *s, const struct lw_points16 *points, float pick,
                             const float point[2]) {
    uint32_t light[16], lit = 0;
    struct lw_light_group group[LW_LIGHTS_EXACT_MAX];
    float probability[16];
    const uint32_t groups = split(s, group);
    assert_true(groups > 1);
    for (uint32_t g = 0; g < groups; g++) {
        const uint16_t active = 0xdfff; /* all but one */
        lw_light_tree_choose16(&s->lights.tree, group[g].node, points, pick, active, light, probability);
        assert_int_equal(light[13], UINT32_MAX);
        for (uint32_t i = 0; i < 16; i++) {
            if (!(active >> i & 1)) continue;
            const struct lw_light_region here = {point_of(points, i), normal_of(points, i), 0, 1};
            float p = 0;
            assert_int_equal(lw_light_tree_choose(&s->lights.tree, group[g].node, &here, pick, &p), light[i]);
            if (light[i] == UINT32_MAX) continue;
            assert_true(fabsf(probability[i] - p) <= 1e-6f * p);
            struct lw_light_sample16 wide;
            memset(&wide, 0x7f, sizeof wide); /* channels that are not chosen stay */
            const struct lw_light_sample16 before = wide;
            lw_lights_sample_near16(&s->lights, light[i], probability, point[0], point[1], points,
                                    (uint16_t)(1u << i), &wide);
            assert_memory_equal(&wide.e[1][(i + 1) % 16], &before.e[1][(i + 1) % 16], sizeof(float));
            const struct lw_light_sample one = lw_lights_sample_near(
                &s->lights, light[i], probability[i], point[0], point[1], here.centre_ws, here.normal_ws);
            lit += expect_same(&wide, points, i, &one);
        }
    }
    return lit;
}

static void compare_regions(const struct stage *s, const struct lw_points16 *points, const float pick[2]) {
    struct lw_light_choice choice[LW_LIGHTS_EXACT_MAX];
    struct lw_light_group group[LW_LIGHTS_EXACT_MAX];
    const uint32_t groups = split(s, group);
    for (uint32_t i = 0; i < 16; i++) {
        const struct lw_light_region region = {point_of(points, i), normal_of(points, i), 0.1f * (float)i,
                                               1 - 0.1f * (float)i};
        for (uint32_t g = 0; g < groups; g++)
            choice[g] = (struct lw_light_choice){.group = group[g].node, .pick = pick[g & 1]};
        lw_light_tree_choose_each(&s->lights.tree, &region, choice, groups);
        for (uint32_t g = 0; g < groups; g++) {
            float p = 0;
            assert_int_equal(lw_light_tree_choose(&s->lights.tree, group[g].node, &region, pick[g & 1], &p),
                             choice[g].light);
            if (choice[g].light != UINT32_MAX) assert_true(fabsf(choice[g].probability - p) <= 1e-6f * p);
        }
    }
}

static uint32_t compare_far(const struct stage *s, const struct lw_points16 *points, const float point[2]) {
    uint32_t lit = 0;
    struct lw_light_sample16 wide;
    for (uint32_t l = 0; l < s->scene->light_count; l++) {
        lw_lights_sample_punctual16(&s->lights, l, point[0], point[1], points, &wide);
        for (uint32_t i = 0; i < 16; i++) {
            const struct lw_light_sample one =
                lw_lights_sample_punctual(&s->lights, l, point[0], point[1], point_of(points, i));
            lit += expect_same(&wide, points, i, &one);
        }
    }
    struct lw_sky_sample sky[16];
    for (uint32_t i = 0; i < 16; i++)
        sky[i] = lw_lights_sample_sky(&s->lights, fmodf(point[0] + (float)i / 16, 1), point[1]);
    lw_lights_place_sky16(&s->lights, sky, points, &wide);
    for (uint32_t i = 0; i < 16; i++) {
        float cosine;
        const struct lw_light_sample one =
            lw_lights_place_sky(&s->lights, &sky[i], normal_of(points, i), &cosine);
        lit += expect_same(&wide, points, i, &one);
    }
    return lit;
}

static void test_sixteen_points_at_once(void **state) {
    (void)state;
    for (int many = 0; many < 2; many++) {
        struct stage s;
        uint32_t near = 0, far = 0;
        everything(&s, many ? 40 : 12);
        for (uint32_t round = 0; round < 500; round++) {
            struct lw_points16 points;
            float point[2], pick[2];
            scatter_points(&points, round);
            lw_random_sobol2(round, 3, point);
            lw_random_sobol2(round, 4, pick);
            near += compare_near(&s, &points, pick[0], point);
            far += compare_far(&s, &points, point);
            compare_regions(&s, &points, pick);
        }
        assert_in_range(near, 2000, UINT32_MAX); /* not all in the dark */
        assert_in_range(far, 2000, UINT32_MAX);
        end(&s);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_few_lights), cmocka_unit_test(test_many_lights),
        cmocka_unit_test(test_changes),    cmocka_unit_test(test_sixteen_points_at_once),
        cmocka_unit_test(test_no_light),   cmocka_unit_test(test_what_does_not_shine_has_no_density),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
