/* The path tracer on surfaces with a finish, against closed forms. Tolerances come from the spread over
 * seeds. */
#include "common/base/random.h"
#include "common/builtin/builtin.h"
#include "common/shading/tangent.h"
#include "tests/reference/effort.h"
#include "tests/reference/path_case.h"

#include <string.h>

#define SEEDS 8
#define TABLE 0.01 /* what lobe_table.h may be off by */

static void set_up(struct path_case_set *set, struct lw_scene *scene) {
    struct lw_error err = {0};
    lw_support_ok(lw_scene_validate(scene, &err), &err);
    path_case_set_up(set, scene, 2);
    set->seeds = SEEDS;
}

static double pixel_of(const struct lw_path_film *film, uint32_t i) {
    return ((double)film->half[0][3 * i] + (double)film->half[1][3 * i]) / film->samples;
}

/* ---- surfaces ---- */

/* Gives a quad a map of 8 x 8 texels of noise, anywhere from flat to as steep as a map can be. */
static void bump(struct lw_scene *scene, uint32_t quad, struct lw_finish *finish) {
    enum { SIDE = 8 };
    uint8_t(*texel)[4] = lw_scene_alloc(scene, (size_t)SIDE * SIDE, sizeof *texel);
    uint16_t *tangent = lw_scene_alloc(scene, 6, sizeof *tangent);
    scene->finish_texture = lw_scene_alloc(scene, 1, sizeof *scene->finish_texture);
    assert_true(texel && tangent && scene->finish_texture);
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        texel[i][0] = (uint8_t)lw_random_hash2(i, 1), texel[i][1] = (uint8_t)lw_random_hash2(i, 2);
        texel[i][2] = 255, texel[i][3] = 255;
    }
    const struct lw_mesh *mesh = &scene->mesh[quad];
    const struct lw_vec3 along = lw_vec3_sub(mesh->position[1], mesh->position[0]);
    for (int i = 0; i < 6; i++) tangent[i] = lw_tangent_encode(mesh->normal[0], along, false);
    scene->mesh[quad].tangent = tangent;
    scene->finish_texture[0] = (struct lw_texture){
        .name = "bumps", .width = SIDE, .height = SIDE, .rgba = *texel, .content = LW_CONTENT_NORMAL};
    scene->finish_texture_count = 1;
    finish->normal_texture.texture = 0;
}

/* A floor from -1 to 1 m under an even sky. */
static struct lw_scene *floor_under_sky(float base) {
    struct room room = {.sky = 1};
    room_quad(&room, lw_vec3(-1, 0, -1), lw_vec3(0, 0, 2), lw_vec3(2, 0, 0), base, 0);
    return room_scene(&room);
}

/* Sees nothing but that floor; sine: of the angle that it is seen under, in the middle. */
static struct lw_path_view view_at(float sine) {
    const struct lw_vec3 from = lw_vec3(0, 4 * sine, 4 * sqrtf(1 - sine * sine));
    return (struct lw_path_view){.camera = lw_camera_look_at(from, lw_vec3(0, 0, 0), 0.04f),
                                 .pixel = LW_PATH_PIXEL_CENTRE,
                                 .pattern = LW_PATH_PATTERN_INTERLEAVED};
}

static void white_floors_send_back_all_light(void **state) {
    (void)state;
    const float roughness[] = {0.05f, 0.1f, 0.2f, 0.4f, 0.6f, 0.8f, 1}, sine[] = {0.12f, 0.4f, 0.95f};
    for (size_t r = 0; r < sizeof roughness / sizeof *roughness; r++)
        for (int metal = 0; metal < 2; metal++) {
            struct path_case_set set;
            struct lw_scene *scene = floor_under_sky(1);
            lw_support_finish(scene, 0, (float)metal, roughness[r]);
            set_up(&set, scene);
            for (size_t k = 0; k < sizeof sine / sizeof *sine; k++) {
                const struct path_case_mean got = path_case_mean_of(&set, view_at(sine[k]), 16, 16 * effort);
                if (fabs(got.value - 1) > TABLE + SIGMA * got.error || got.error > 0.006)
                    fail_msg("metalness %d, roughness %g, sine %g: %.4f +- %.4f", metal, (double)roughness[r],
                             (double)sine[k], got.value, got.error);
            }
            path_case_tear_down(&set);
        }
}

/* ---- a mirror ---- */

/* A panel that glows stands beyond a floor of metal. A pixel that sees the floor sees the panel's image, 0.8
 * of it at normal incidence, or black. Bounce rays alone find it without noise; samples of lamps add some. */
static void a_mirror_shows_the_panels_image(void **state) {
    (void)state;
    enum { SIDE = 32 };
    /* A mirror of alpha 0.001 throws (alpha / angle)^2 of its light by more than twice that angle: under
     * 0.5 % that far. */
    const float near = 0.04f; /* m */
    for (int all_lights = 0; all_lights < 2; all_lights++) {
        struct room room = {0};
        room_quad(&room, lw_vec3(-4, 0, -4), lw_vec3(0, 0, 8), lw_vec3(8, 0, 0), 0.8f, 0);
        room_quad(&room, lw_vec3(-0.5f, 0.3f, -1), lw_vec3(1, 0, 0), lw_vec3(0, 0.6f, 0), 0, 3);
        struct path_case_set set;
        struct lw_scene *scene = room_scene(&room);
        lw_support_finish(scene, 0, 1, 0);
        set_up(&set, scene);
        struct lw_path_view view = {
            .camera = lw_camera_look_at(lw_vec3(0, 1, 1.5f), lw_vec3(0, 0, 0), 0.9f),
            .pixel = LW_PATH_PIXEL_CENTRE,
            .method = all_lights ? LW_PATH_METHOD_BOTH : LW_PATH_METHOD_BOUNCE,
            .all_lights = all_lights,
            .clamp = all_lights ? 0.1f : 0, /* not of lamps in a mirror */
        };
        struct lw_path_film film = path_case_render(&set, &view, SIDE, SIDE, 16);
        const struct lw_camera_plane plane = lw_camera_plane(&view.camera, SIDE, SIDE);
        const double tolerance = all_lights ? 0.05 : 0.005;
        double ratio = 0;
        unsigned bright = 0, black = 0;
        for (uint32_t i = 0; i < SIDE * SIDE; i++) {
            const float x = (float)(i % SIDE) + 0.5f, y = (float)(i / SIDE) + 0.5f;
            const struct lw_vec3 d = lw_vec3_normalize(lw_camera_direction(&plane, x, y));
            if (!(d.y < -0.1f)) continue;
            const struct lw_vec3 at = lw_vec3_mad(lw_vec3(0, 1, 1.5f), d, 1 / -d.y);
            const struct lw_vec3 image = lw_vec3_mad(at, lw_vec3(d.x, -d.y, d.z), (at.z + 1) / -d.z);
            const float in = fminf(0.5f - fabsf(image.x), 0.3f - fabsf(image.y - 0.6f));
            if (at.z < -0.9f || fabsf(in) < near) continue;
            const double c = pow(1 + (double)d.y, 5), want = in > 0 ? 3 * (0.8 + 0.2 * c) : 0;
            const double got = pixel_of(&film, i);
            if (!(fabs(got - want) <= tolerance * 3))
                fail_msg("all lights %d, pixel %u: %g, expected %g", all_lights, i, got, want);
            if (in > 0) ratio += got / want;
            *(in > 0 ? &bright : &black) += 1;
        }
        assert_true(fabs(ratio / bright - 1) < 0.005);
        assert_true(bright > 20 && black > 100);
        lw_path_film_finish(&film);
        path_case_tear_down(&set);
    }
}

/* ---- the estimator ---- */

static void teach(const struct path_case_set *set, struct lw_path_view *view, struct lw_guide **out) {
    const struct lw_guide_desc desc = {.minimum_ws = {-1, -1, -1}, .maximum_ws = {1, 1, 1}, .trust = 8};
    struct lw_error err = {0};
    lw_support_ok(lw_guide_create(&desc, out, &err), &err);
    view->guide = *out;
    for (int i = 0; i < 4; i++) {
        struct lw_path_film film = path_case_render(set, view, 32, 32, 4);
        lw_path_film_finish(&film);
        lw_guide_learn(*out, 2);
    }
}

static void methods_agree_on_glossy_surfaces(void **state) {
    (void)state;
    static const struct {
        enum lw_path_method method;
        bool all_lights, guided;
    } way[] = {{LW_PATH_METHOD_BOTH, false, false},   {LW_PATH_METHOD_LAMPS, false, false},
               {LW_PATH_METHOD_BOUNCE, false, false}, {LW_PATH_METHOD_BOTH, true, false},
               {LW_PATH_METHOD_BOTH, false, true},    {LW_PATH_METHOD_BOUNCE, false, true}};
    enum { WAYS = sizeof way / sizeof *way };
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    scene->sky[0] = 0.1f;
    for (uint32_t m = 0; m < scene->material_count; m++) lw_support_finish(scene, m, m % 3 ? 0 : 1, 0.5f);
    struct path_case_set set;
    set_up(&set, scene);
    const struct lw_path_view plain = {.camera = lw_camera_of_scene(scene, &set.world.pose, 0), .bounces = 2};
    struct path_case_mean mean[WAYS];
    for (int w = 0; w < WAYS; w++) {
        struct lw_path_view view = plain;
        struct lw_guide *guide = NULL;
        if (way[w].guided) teach(&set, &view, &guide);
        view.method = way[w].method;
        view.all_lights = way[w].all_lights;
        mean[w] =
            path_case_mean_of(&set, view, 32, (view.method == LW_PATH_METHOD_BOUNCE ? 64 : 16) * effort);
        assert_true(mean[w].error < noise(0.025) * mean[w].value);
        lw_guide_destroy(guide);
    }
    path_case_expect_same(mean, WAYS);
    path_case_tear_down(&set);
}

/* ---- normal maps ---- */

/* White floors with the steepest bumps under an even sky: no pixel is black, none is brighter than the sky. A
 * mirror shows the sky in all of them: bent normals look up. */
static void bumps_have_no_fringes_and_add_no_light(void **state) {
    (void)state;
    enum { SIDE = 32 };
    const float roughness[] = {0, 0.3f, 1}, sine[] = {0.05f, 0.3f, 0.9f};
    for (int metal = 0; metal < 2; metal++)
        for (int r = 0; r < 3; r++) {
            struct path_case_set set;
            struct lw_scene *scene = floor_under_sky(1);
            bump(scene, 0, lw_support_finish(scene, 0, (float)metal, roughness[r]));
            set_up(&set, scene);
            for (int k = 0; k < 3; k++) {
                struct lw_path_view view = view_at(sine[k]);
                view.method = LW_PATH_METHOD_BOUNCE;
                struct lw_path_film film = path_case_render(&set, &view, SIDE, SIDE, 64);
                double mean = 0;
                for (uint32_t i = 0; i < SIDE * SIDE; i++) {
                    const double got = pixel_of(&film, i);
                    assert_true(isfinite(got) && got >= 0);
                    if (got < (metal && r == 0 ? 0.95 : 0.1))
                        fail_msg("metalness %d, roughness %g, sine %g: %g", metal, (double)roughness[r],
                                 (double)sine[k], got);
                    mean += got / (SIDE * SIDE);
                }
                assert_true(mean <= 1 + TABLE);
                lw_path_film_finish(&film);
            }
            path_case_tear_down(&set);
        }
}

/* Both sides of a floor see the same bumps: what stands out here is hollow there. A flat map is none. */
static void flat_maps_change_nothing(void **state) {
    (void)state;
    struct lw_path_film film[2];
    for (int mapped = 0; mapped < 2; mapped++) {
        struct path_case_set set;
        struct lw_scene *scene = floor_under_sky(0.5f);
        struct lw_finish *finish = lw_support_finish(scene, 0, 0, 0.4f);
        if (mapped) {
            bump(scene, 0, finish);
            finish->normal_scale = 0;
        }
        set_up(&set, scene);
        const struct lw_path_view view = view_at(0.5f);
        film[mapped] = path_case_render(&set, &view, 16, 16, 4);
        path_case_tear_down(&set);
    }
    for (uint32_t i = 0; i < 16 * 16; i++)
        assert_true(fabs(pixel_of(&film[0], i) - pixel_of(&film[1], i)) < 1e-4);
    lw_path_film_finish(&film[0]);
    lw_path_film_finish(&film[1]);
}

/* ---- shading by itself ---- */

static struct lw_vec3 any_direction(uint32_t s, uint32_t use) {
    const float z = 2 * lw_random_unit(lw_random_hash2(s, use)) - 1,
                angle = 6.2831853f * lw_random_unit(lw_random_hash2(s, use + 1)), r = sqrtf(1 - z * z);
    return lw_vec3(r * cosf(angle), z, r * sinf(angle));
}

/* One of 0, 0.25, ... 1. */
static float any_step(uint32_t s, uint32_t use) { return (float)(lw_random_hash2(s, use) % 5) / 4; }

/* Any finish, on a stretched and mirrored object, any eye, any light. */
static void shading_is_never_negative_and_no_nan(void **state) {
    (void)state;
    struct lw_scene *scene = floor_under_sky(1);
    struct lw_finish *finish = lw_support_finish(scene, 0, 0, 0);
    bump(scene, 0, finish);
    const struct lw_affine stretched = {{{-3, 0, 1, 0}, {0, 0.2f, 0, 1}, {0, 0.1f, 1, 0}}};
    const struct lw_place place = lw_place_of(&stretched);
    for (uint32_t s = 0; s < 20000; s++) {
        finish->metalness = any_step(s, 1), finish->roughness = any_step(s, 2);
        finish->specular = any_step(s, 3), finish->ior = 1 + 1e6f * powf(any_step(s, 4), 20);
        finish->normal_scale = s % 7 ? 2 * any_step(s, 5) - 1 : 1e9f;
        for (int c = 0; c < 4; c++) scene->material[0].base_colour[c] = any_step(s, 6 + (uint32_t)c);
        struct lw_hit16 hits = {.triangle = {s & 1u},
                                .u = {0.5f * lw_random_unit(lw_random_hash2(s, 10))},
                                .v = {0.5f * lw_random_unit(lw_random_hash2(s, 11))},
                                .back = {s >> 1 & 1u}};
        struct lw_surface surface;
        struct lw_place_gloss gloss;
        lw_scene_surface(scene, &scene->mesh[0], hits.triangle[0], hits.u[0], hits.v[0], &surface);
        const struct lw_place_point point = lw_place_point(&place, &scene->mesh[0], &hits, 0, &surface);
        assert_true(lw_place_gloss(&place, scene, &scene->mesh[0], &hits, 0, &surface, &point,
                                   any_direction(s, 12), &gloss));
        assert_true(fabsf(lw_vec3_length(gloss.normal) - 1) < 1e-4f);
        const struct lw_vec3 light = any_direction(s, 14), f = lw_place_gloss_reflect(&gloss, light);
        assert_true(lw_vec3_is_finite(f) && f.x >= 0 && f.y >= 0 && f.z >= 0);
        if (lw_vec3_dot(light, point.normal) <= 0) assert_true(f.x + f.y + f.z == 0);
        const struct lw_vec3 albedo = lw_lobes_seen_albedo(&gloss.seen);
        assert_true(albedo.x >= 0 && albedo.x <= 1.001f);
        const float u[2] = {lw_random_unit(lw_random_hash2(s, 16)), lw_random_unit(lw_random_hash2(s, 17))};
        struct lw_vec3 drawn;
        if (!lw_lobes_sample(&gloss.seen, u, lw_random_unit(lw_random_hash2(s, 18)), &drawn)) continue;
        const float pdf = lw_lobes_pdf(&gloss.seen, drawn);
        assert_true(isfinite(pdf) && pdf >= 0);
    }
    lw_scene_destroy(scene);
}

/* ---- first hits ---- */

/* Pixels that mirror start at the eye; the albedo of first hits is what they send back of an even sky. */
static void first_hits_know_the_finish(void **state) {
    (void)state;
    enum { SIDE = 16 };
    struct path_case_set set;
    struct lw_error err = {0};
    struct lw_scene *scene = floor_under_sky(0.6f);
    bump(scene, 0, lw_support_finish(scene, 0, 0, 0.3f));
    scene->finish_texture_count = 1;
    set_up(&set, scene);
    struct lw_path_view view = view_at(0.3f);
    struct lw_gbuffer gbuffer;
    lw_support_ok(
        lw_gbuffer_init(&gbuffer,
                        &(struct lw_gbuffer_desc){
                            .scene = scene, .trace = set.world.trace, .width = SIDE, .height = SIDE},
                        &err),
        &err);
    lw_gbuffer_render(&gbuffer, &set.world.pose, &view.camera);
    struct lw_path_film film[2];
    for (int given = 0; given < 2; given++) {
        view.first_hits = given ? &gbuffer : NULL;
        film[given] = path_case_render(&set, &view, SIDE, SIDE, 2);
    }
    for (int half = 0; half < 2; half++)
        assert_memory_equal(film[0].half[half], film[1].half[half], (size_t)SIDE * SIDE * 3 * sizeof(float));
    bool bumpy = false;
    for (int i = 0; i < SIDE * SIDE; i++) {
        assert_int_equal(gbuffer.from_eye[i], 1);
        assert_true(gbuffer.plane.albedo[0][i] > 0.5f && gbuffer.plane.albedo[0][i] < 1);
        bumpy |= gbuffer.plane.normal[1][i] < 0.9f;
    }
    assert_true(bumpy);
    for (int i = 0; i < 2; i++) lw_path_film_finish(&film[i]);
    lw_gbuffer_finish(&gbuffer);
    path_case_tear_down(&set);
}

int main(int argc, char **argv) {
    (void)argv;
    set_effort(argc);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(white_floors_send_back_all_light),
        cmocka_unit_test(a_mirror_shows_the_panels_image),
        cmocka_unit_test(methods_agree_on_glossy_surfaces),
        cmocka_unit_test(bumps_have_no_fringes_and_add_no_light),
        cmocka_unit_test(flat_maps_change_nothing),
        cmocka_unit_test(shading_is_never_negative_and_no_nan),
        cmocka_unit_test(first_hits_know_the_finish),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
