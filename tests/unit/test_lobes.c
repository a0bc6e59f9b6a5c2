#include "tests/support/support.h"

#include "common/base/random.h"
#include "common/shading/lobe_table.h"
#include "common/shading/lobes.h"
#include "common/shading/microfacets.h"
#include "common/shading/shading_bend.h"
#include "common/shading/tangent.h"

#include <math.h>

#define SAMPLES 40000u

static struct lw_vec3 at(float cosine, float phi) {
    const float sine = sqrtf(1 - cosine * cosine);
    return lw_vec3(sine * cosf(phi), sine * sinf(phi), cosine);
}

static struct lw_lobes metal(float f0, float roughness) {
    return (struct lw_lobes){.f0 = lw_vec3(f0, f0, f0), .f90 = 1, .roughness = roughness};
}

static struct lw_lobes varnish(float base, float roughness) {
    return (struct lw_lobes){.diffuse = lw_vec3(base, base, base),
                             .f0 = lw_vec3(0.04f, 0.04f, 0.04f),
                             .f90 = 1,
                             .gloss0 = 0.04f,
                             .gloss90 = 1,
                             .roughness = roughness};
}

/* Light of radiance 1 from everywhere, as the eye sees it; by the drawn directions, as a path does. */
static double furnace(const struct lw_lobes *lobes, float cosine) {
    const struct lw_lobes_seen seen = lw_lobes_see(lobes, at(cosine, 0.3f));
    double sum = 0;
    for (uint32_t s = 0; s < SAMPLES; s++) {
        float u[2], pick[2];
        struct lw_vec3 to_light;
        lw_random_sobol2(s, 1, u);
        lw_random_sobol2(s, 2, pick);
        if (!lw_lobes_sample(&seen, u, pick[0], &to_light)) continue;
        sum += (double)(lw_lobes_reflect(&seen, to_light).y / lw_lobes_pdf(&seen, to_light));
    }
    return sum / SAMPLES;
}

static void white_surfaces_send_back_all_light(void **state) {
    (void)state;
    const float roughness[] = {0, 0.05f, 0.1f, 0.2f, 0.35f, 0.5f, 0.7f, 0.85f, 1};
    const float cosine[] = {0.05f, 0.15f, 0.4f, 0.7f, 1};
    for (size_t r = 0; r < sizeof roughness / sizeof *roughness; r++)
        for (size_t c = 0; c < sizeof cosine / sizeof *cosine; c++) {
            const struct lw_lobes white[] = {metal(1, roughness[r]), varnish(1, roughness[r])};
            for (int k = 0; k < 2; k++) {
                const double back = furnace(&white[k], cosine[c]);
                if (fabs(back - 1) > 0.01)
                    fail_msg("%s, roughness %g, cosine %g: %g", k ? "varnish" : "metal", (double)roughness[r],
                             (double)cosine[c], back);
            }
        }
}

static void none_sends_back_more_than_arrives(void **state) {
    (void)state;
    for (float r = 0; r <= 1; r += 0.125f)
        for (float f0 = 0; f0 <= 1; f0 += 0.25f) {
            const struct lw_lobes m = metal(f0, r), v = varnish(f0, r);
            assert_true(furnace(&m, 0.3f) < 1.01);
            assert_true(furnace(&v, 0.3f) < 1.01);
        }
}

static void light_goes_both_ways_alike(void **state) {
    (void)state;
    for (uint32_t s = 0; s < 2000; s++) {
        float a[2], b[2], c[2];
        lw_random_sobol2(s, 3, a);
        lw_random_sobol2(s, 4, b);
        lw_random_sobol2(s, 5, c);
        const struct lw_lobes lobes = s & 1 ? metal(c[0], c[1]) : varnish(c[0], c[1]);
        const struct lw_vec3 x = at(0.02f + 0.98f * a[0], 6 * a[1]), y = at(0.02f + 0.98f * b[0], 6 * b[1]);
        const struct lw_lobes_seen from_x = lw_lobes_see(&lobes, x), from_y = lw_lobes_see(&lobes, y);
        const float there = lw_lobes_reflect(&from_x, y).x / y.z, back = lw_lobes_reflect(&from_y, x).x / x.z;
        assert_true(fabsf(there - back) <= 1e-3f * fmaxf(there, back) + 1e-6f);
    }
}

/* The density of directions holds all of them: its integral over even ones is the chance not to go below. */
static void densities_are_those_of_what_is_drawn(void **state) {
    (void)state;
    for (float r = 0.3f; r <= 1; r += 0.35f) {
        const struct lw_lobes lobes = varnish(0.5f, r);
        const struct lw_lobes_seen seen = lw_lobes_see(&lobes, at(0.5f, 1));
        double above = 0, integral = 0;
        for (uint32_t s = 0; s < SAMPLES; s++) {
            float u[2], pick[2];
            struct lw_vec3 drawn;
            lw_random_sobol2(s, 6, u);
            lw_random_sobol2(s, 7, pick);
            above += lw_lobes_sample(&seen, u, pick[0], &drawn);
            integral += (double)lw_lobes_pdf(&seen, at(u[0], 2 * LW_PI * u[1])) * 2 * (double)LW_PI;
        }
        assert_true(fabs(above - integral) < 0.01 * SAMPLES);
    }
}

/* The mean over all eyes, weighted by their cosines, of the radiance sent to them. */
static double sent_to_all(const struct lw_lobes *lobes) {
    double sum = 0;
    for (int i = 0; i < 256; i++) {
        const struct lw_lobes_seen seen = lw_lobes_see(lobes, at(sqrtf(((float)i + 0.5f) / 256), 0));
        sum += (double)(seen.spread.x + seen.mirrored.x) / 256;
        assert_true(seen.spread.x + seen.mirrored.x <= 1.001f);
    }
    return sum;
}

/* What bounces carry is what all lobes send back of light from everywhere: of white all of it. */
static void the_albedo_is_all_that_is_sent_back(void **state) {
    (void)state;
    for (int r = 0; r <= 4; r++) {
        const struct lw_lobes lobes = varnish(0.6f, 0.25f * (float)r), white = varnish(1, 0.25f * (float)r),
                              mirror = metal(1, 0.25f * (float)r), copper = metal(0.6f, 0.25f * (float)r);
        assert_true(fabs((double)lw_lobes_albedo(&lobes).x - sent_to_all(&lobes)) < 0.005);
        assert_true(fabs((double)lw_lobes_albedo(&copper).x - sent_to_all(&copper)) < 0.005);
        assert_true(lw_lobes_albedo(&lobes).x > 0.6f && lw_lobes_albedo(&lobes).x < 0.65f);
        assert_true(fabsf(lw_lobes_albedo(&white).x - 1) < 1e-5f && lw_lobes_albedo(&white).x <= 1);
        assert_true(fabsf(lw_lobes_albedo(&mirror).x - 1) < 1e-5f && lw_lobes_albedo(&mirror).x <= 1);
    }
    const struct lw_lobes matt = lw_lobes_matt(lw_vec3(0.6f, 0.6f, 0.6f));
    assert_true(lw_lobes_albedo(&matt).x == 0.6f);
    const struct lw_lobes_seen seen = lw_lobes_see(&matt, at(0.5f, 0));
    assert_true(fabsf(lw_lobes_reflect(&seen, at(0.25f, 2)).x - 0.6f / LW_PI * 0.25f) < 1e-6f);
}

/* Any numbers in range, and eyes and lights anywhere. */
static void nothing_is_negative_or_no_number(void **state) {
    (void)state;
    for (uint32_t s = 0; s < 20000; s++) {
        float a[2], b[2], c[2], d[2];
        lw_random_sobol2(s, 8, a);
        lw_random_sobol2(s, 9, b);
        lw_random_sobol2(s, 10, c);
        lw_random_sobol2(s, 11, d);
        struct lw_lobes lobes = s & 1 ? metal(floorf(3 * c[0]) / 2, floorf(5 * c[1]) / 4)
                                      : varnish(floorf(3 * c[0]) / 2, floorf(5 * c[1]) / 4);
        if (s % 7 == 0) lobes.f90 = lobes.gloss90 = d[0];
        const struct lw_vec3 eye = at(2 * a[0] - 1, 6 * a[1]),
                             light = s % 5 ? at(2 * b[0] - 1, 6 * b[1]) : eye;
        const struct lw_lobes_seen seen = lw_lobes_see(&lobes, eye);
        const struct lw_vec3 f = lw_lobes_reflect(&seen, light);
        const float pdf = lw_lobes_pdf(&seen, light);
        assert_true(lw_vec3_is_finite(f) && f.x >= 0 && f.y >= 0 && f.z >= 0);
        assert_true(isfinite(pdf) && pdf >= 0);
    }
}

/* Any bumps, under any eye: they face it, and mirror nothing from below. */
static void bent_normals_mirror_what_is_above(void **state) {
    (void)state;
    for (uint32_t s = 0; s < 20000; s++) {
        float a[2], b[2];
        lw_random_sobol2(s, 12, a);
        lw_random_sobol2(s, 13, b);
        const struct lw_vec3 v = at(s % 3 ? a[0] : 0.01f * a[0], 0), n = at(2 * b[0] - 1, 2 * LW_PI * b[1]);
        const struct lw_vec3 up = lw_vec3(0, 0, 1), bent = lw_shading_bend(n, up, v);
        const struct lw_vec3 mirrored = lw_microfacets_mirror(v, bent);
        assert_true(lw_vec3_is_finite(bent) && fabsf(lw_vec3_length(bent) - 1) < 1e-5f);
        assert_true(lw_vec3_dot(bent, v) > 0);
        assert_true(mirrored.z > 0 || v.z < LW_SHADING_BEND_SEEN_MIN);
        if (n.z > 0.995f && v.z > 0.3f) assert_memory_equal(&n, &bent, sizeof n);
    }
    /* a smoothed normal that has turned away from the eye */
    const struct lw_vec3 v = at(-0.3f, 0), bent = lw_shading_bend(at(0.9f, 2), lw_vec3(0, 0, 1), v);
    assert_true(lw_vec3_is_finite(bent) && lw_vec3_dot(bent, v) > 0);
}

/* A mirror's share is Fresnel's reflectance. */
static void smooth_mirrors_follow_fresnel(void **state) {
    (void)state;
    for (float cosine = 0.1f; cosine <= 1; cosine += 0.1f) {
        const struct lw_lobe_share s = lw_lobe_table_at(cosine, 0.05f);
        assert_true(fabsf(s.a + s.b - 1) < 0.01f);
        assert_true(fabsf(s.b - lw_microfacets_schlick(cosine)) < 0.01f);
    }
}

static void tangents_come_back_from_16_bits(void **state) {
    (void)state;
    for (uint32_t s = 0; s < 2000; s++) {
        float a[2], b[2];
        lw_random_sobol2(s, 12, a);
        lw_random_sobol2(s, 13, b);
        const struct lw_vec3 n = at(2 * a[0] - 1, 7 * a[1]);
        struct lw_vec3 t = lw_vec3_cross(n, at(2 * b[0] - 1, 7 * b[1]));
        if (lw_vec3_length(t) < 0.01f) continue;
        t = lw_vec3_normalize(t);
        const struct lw_vec4 found = lw_tangent_decode(lw_tangent_encode(n, t, s & 1), n);
        assert_true(found.w == (s & 1 ? -1.0f : 1.0f));
        assert_true(lw_vec3_dot(t, lw_vec3(found.x, found.y, found.z)) > 0.9999f);
        assert_true(fabsf(lw_vec3_dot(n, lw_vec3(found.x, found.y, found.z))) < 1e-3f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(white_surfaces_send_back_all_light),
        cmocka_unit_test(none_sends_back_more_than_arrives),
        cmocka_unit_test(light_goes_both_ways_alike),
        cmocka_unit_test(densities_are_those_of_what_is_drawn),
        cmocka_unit_test(the_albedo_is_all_that_is_sent_back),
        cmocka_unit_test(nothing_is_negative_or_no_number),
        cmocka_unit_test(smooth_mirrors_follow_fresnel),
        cmocka_unit_test(bent_normals_mirror_what_is_above),
        cmocka_unit_test(tangents_come_back_from_16_bits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
