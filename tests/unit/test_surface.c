#include "tests/support/support.h"

#include "common/base/colour.h"

#include <string.h>

#define assert_near(a, b) assert_float_equal(a, b, 1e-6f)

static const struct lw_texture_use plain_use = {0, 0, {1, 0, 0, 0, 1, 0}};

/* A row of three texels that decode to red 0, 0.2140 (sRGB 127) and 1, alpha 0, 51 and 255. */
static const uint8_t row[] = {0, 0, 0, 0, 127, 0, 0, 51, 255, 0, 0, 255};

static struct lw_vec4 sample_row(uint8_t wrap_s, uint8_t wrap_t, float u, float v) {
    struct lw_texture texture = {"", 3, 1, row, wrap_s, wrap_t, LW_CONTENT_COLOUR};
    struct lw_scene scene = {.texture = &texture, .texture_count = 1};
    return lw_scene_sample(&scene, &plain_use, (struct lw_vec2){u, v});
}

static void texel_centres_give_texels(void **state) {
    (void)state;
    const float expected[] = {0, lw_colour_from_srgb8(127), 1};
    for (uint8_t wrap = LW_WRAP_REPEAT; wrap <= LW_WRAP_MIRROR; wrap++)
        for (int i = 0; i < 3; i++) {
            struct lw_vec4 c = sample_row(wrap, wrap, ((float)i + 0.5f) / 3, 0.5f);
            assert_near(c.x, expected[i]);
            assert_near(c.y, 0);
            assert_near(c.w, (float)row[4 * i + 3] / 255);
        }
}

static void light_is_mixed_after_decoding(void **state) {
    (void)state;
    float grey = lw_colour_from_srgb8(127);
    struct lw_vec4 c =
        sample_row(LW_WRAP_REPEAT, LW_WRAP_REPEAT, 2.0f / 3, 0.5f); /* between the 2nd and the 3rd */
    assert_near(c.x, 0.5f * (grey + 1));
    assert_near(c.w, 0.5f * (51 + 255) / 255);
    c = sample_row(LW_WRAP_REPEAT, LW_WRAP_REPEAT, 1.75f / 3, 0.5f);
    assert_near(c.x, 0.75f * grey + 0.25f);
}

static void edges_follow_the_wrap_mode(void **state) {
    (void)state;
    float grey = lw_colour_from_srgb8(127);
    const struct {
        float u, repeat, clamp, mirror;
    } cases[] = {
        {0, 0.5f, 0, 0}, /* between the first texel and the last, itself, itself */
        {1, 0.5f, 1, 1},
        {3.5f / 3, 0, 1, 1}, /* one texel past the end */
        {4.5f / 3, grey, 1, grey},
        {5.5f / 3, 1, 1, 0},
        {6.5f / 3, 0, 1, 0},
        {-0.5f / 3, 1, 0, 0},
        {-1.5f / 3, grey, 0, grey},
        {-2.5f / 3, 0, 0, 1},
        {2.0f / 3, 0.5f * (grey + 1), 0.5f * (grey + 1), 0.5f * (grey + 1)},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_near(sample_row(LW_WRAP_REPEAT, LW_WRAP_CLAMP, cases[i].u, 0.5f).x, cases[i].repeat);
        assert_near(sample_row(LW_WRAP_CLAMP, LW_WRAP_CLAMP, cases[i].u, 0.5f).x, cases[i].clamp);
        assert_near(sample_row(LW_WRAP_MIRROR, LW_WRAP_CLAMP, cases[i].u, 0.5f).x, cases[i].mirror);
    }
}

static void rows_go_down_and_have_their_own_wrap_mode(void **state) {
    (void)state;
    static const uint8_t column[] = {255, 0, 0, 255, 0, 255, 0, 255}; /* red at v = 0, green below */
    struct lw_texture texture = {"", 1, 2, column, LW_WRAP_REPEAT, LW_WRAP_CLAMP, LW_CONTENT_COLOUR};
    struct lw_scene scene = {.texture = &texture, .texture_count = 1};
    struct lw_vec4 c = lw_scene_sample(&scene, &plain_use, (struct lw_vec2){7.3f, 0.25f});
    assert_near(c.x, 1);
    c = lw_scene_sample(&scene, &plain_use, (struct lw_vec2){0, 0.75f});
    assert_near(c.y, 1);
    c = lw_scene_sample(&scene, &plain_use, (struct lw_vec2){0, 5});
    assert_near(c.y, 1);
    c = lw_scene_sample(&scene, &plain_use, (struct lw_vec2){0, -5});
    assert_near(c.x, 1);
    texture.wrap_t = LW_WRAP_REPEAT;
    c = lw_scene_sample(&scene, &plain_use, (struct lw_vec2){0, 5});
    assert_near(c.x, 0.5f);
}

static void wild_coordinates_stay_inside(void **state) {
    (void)state;
    static const float wild[] = {1e30f,     -1e30f, 3e38f,  -3e38f,      16777218,   -16777218, INFINITY,
                                 -INFINITY, NAN,    -1e-9f, 0.99999994f, 1.9999999f, -1e-38f};
    for (uint8_t wrap = LW_WRAP_REPEAT; wrap <= LW_WRAP_MIRROR; wrap++)
        for (size_t i = 0; i < sizeof wild / sizeof *wild; i++)
            for (size_t j = 0; j < sizeof wild / sizeof *wild; j++) {
                struct lw_vec4 c = sample_row(wrap, wrap, wild[i], wild[j]);
                assert_true(c.x >= 0 && c.x <= 1 && c.w >= 0 && c.w <= 1);
            }
}

static void no_texture_is_white_and_transforms_apply(void **state) {
    (void)state;
    struct lw_texture texture = {"", 3, 1, row, LW_WRAP_CLAMP, LW_WRAP_CLAMP, LW_CONTENT_COLOUR};
    struct lw_scene scene = {.texture = &texture, .texture_count = 1};
    struct lw_texture_use use = {LW_SCENE_NONE, 0, {0}};
    struct lw_vec4 c = lw_scene_sample(&scene, &use, (struct lw_vec2){0.3f, 0.4f});
    assert_true(c.x == 1 && c.y == 1 && c.z == 1 && c.w == 1);
    /* u' = 0.5 v + 1/6: v = 1 is the centre of the 2nd texel, v = 0 that of the 1st */
    use = (struct lw_texture_use){0, 0, {0, 1.0f / 3, 1.0f / 6, 1, 0, 0}};
    c = lw_scene_sample(&scene, &use, (struct lw_vec2){9, 1});
    assert_near(c.x, lw_colour_from_srgb8(127));
    c = lw_scene_sample(&scene, &use, (struct lw_vec2){9, 0});
    assert_near(c.x, 0);
}

static void expect_albedo(const struct lw_scene *scene, const struct lw_mesh *mesh, uint32_t triangle,
                          float u, float v) {
    struct lw_surface surface;
    float alpha;
    lw_scene_surface(scene, mesh, triangle, u, v, &surface);
    const struct lw_vec3 albedo = lw_scene_albedo(scene, mesh, triangle, u, v, &alpha);
    assert_memory_equal(&albedo, &surface.albedo, sizeof albedo);
    assert_memory_equal(&alpha, &surface.alpha, sizeof alpha);
}

static void albedo_alone_has_the_same_bits(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything();
    for (int finishes = 0; finishes < 2; finishes++) {
        for (uint32_t m = 0; m < scene->mesh_count; m++)
            for (uint32_t t = 0; t < scene->mesh[m].triangle_count; t++)
                for (int k = 0; k <= 16; k++)
                    expect_albedo(scene, &scene->mesh[m], t, (float)k / 16, (float)(16 - k) / 20);
        if (!finishes) lw_support_add_finishes(scene);
    }
    scene->material[scene->mesh[0].material[0]].unlit = true;
    expect_albedo(scene, &scene->mesh[0], 0, 0.5f, 0.25f);
    lw_scene_destroy(scene);
}

static void a_surface_is_its_corners_weighed(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything();
    struct lw_surface surface;
    /* triangle 0 of "full": vertices 0 (-1,0,-1), 2 (-1,0,1), 1 (1,0,-1), material "leaf" */
    lw_scene_surface(scene, &scene->mesh[0], 0, 0.5f, 0.25f, &surface);
    assert_near(surface.position.x, 0.25f * -1 + 0.5f * -1 + 0.25f * 1);
    assert_near(surface.position.z, 0.25f * -1 + 0.5f * 1 + 0.25f * -1);
    assert_near(surface.geometric_normal.y, 1);
    assert_near(surface.normal.y, 1);
    assert_near(surface.lightmap_uv.x, 0.25f * 2 + 0.5f * 2 + 0.25f * 10);
    assert_near(surface.lightmap_uv.y, 0.25f * 2 + 0.5f * 10 + 0.25f * 2);
    assert_ptr_equal(surface.material, &scene->material[1]);
    /* UV set 1 there is (0.125, 0.25), transformed (0.75, 0.75): the centre of the white texel, alpha 0; the
     * vertex colour is 0.25 (1,1,1,1) + 0.5 (1,1,.5,.5) + 0.25 (1,.5,1,1) */
    assert_near(surface.albedo.x, 1);
    assert_near(surface.albedo.y, 0.875f);
    assert_near(surface.albedo.z, 0.75f);
    assert_near(surface.alpha, 0); /* under the cutoff of 0.25 */
    assert_near(surface.emission.x, 0);
    lw_scene_destroy(scene);
}

static void lamps_shine_through_their_texture_and_blend(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything();
    struct lw_surface surface;
    /* the second triangle's first corner is vertex 1; UV set 1 there is (0.5, 0), swapped by the transform */
    lw_scene_surface(scene, &scene->mesh[0], 1, 0, 0, &surface);
    float grey = lw_colour_from_srgb8(188);
    assert_near(surface.emission.x, 10 * grey);
    assert_near(surface.emission.y, 5 * grey);
    assert_near(surface.emission.z, 2.5f * grey);
    assert_near(surface.albedo.x, 0);
    /* "Rampe" at u = 1, clamped: alpha 253/255; times 0.5 of the material, times the vertex' 1 */
    assert_near(surface.alpha, 0.5f * 253 / 255);
    assert_near(lw_scene_alpha(scene, &scene->mesh[0], 1, 0, 0), 0.5f * 253 / 255);
    lw_scene_destroy(scene);
}

static void what_is_absent_is_neutral(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything();
    struct lw_surface surface;
    lw_scene_surface(scene, &scene->mesh[1], 0, 0.25f, 0.25f, &surface); /* no UVs, no colours, no lightmap */
    assert_near(surface.albedo.x, 0.25f);
    assert_near(surface.albedo.y, 0.5f);
    assert_near(surface.albedo.z, 0.75f);
    assert_near(surface.alpha, 1);
    assert_near(surface.lightmap_uv.x, 0);
    assert_near(surface.geometric_normal.z, 1);
    /* an absent set reads (0, 0) */
    scene->mesh[0].uv[1] = NULL;
    lw_scene_surface(scene, &scene->mesh[0], 0, 0.5f, 0.25f, &surface);
    struct lw_vec4 c =
        lw_scene_sample(scene, &scene->material[1].base_colour_texture, (struct lw_vec2){0, 0});
    assert_near(surface.albedo.x, c.x);
    lw_scene_destroy(scene);
}

static void albedo_and_alpha_stay_between_0_and_1(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(1, 1);
    struct lw_material *material = &scene->material[0];
    struct lw_surface surface;
    memcpy(material->base_colour, (float[]){7, 0.5f, 1e12f, 3}, sizeof material->base_colour);
    material->alpha_mode = LW_ALPHA_BLEND;
    lw_scene_surface(scene, &scene->mesh[0], 0, 0.1f, 0.1f, &surface);
    assert_true(surface.albedo.x == 1 && surface.albedo.z == 1 && surface.alpha == 1);
    assert_near(surface.albedo.y, 0.5f);
    struct lw_vec4 dark[4] = {{-1, -1, -1, -1}, {-1, -1, -1, -1}, {-1, -1, -1, -1}, {-1, -1, -1, -1}};
    scene->mesh[0].colour = dark;
    lw_scene_surface(scene, &scene->mesh[0], 0, 0.1f, 0.1f, &surface);
    assert_true(surface.albedo.x == 0 && surface.albedo.y == 0 && surface.alpha == 0);
    lw_scene_destroy(scene);
}

static void each_alpha_mode_means_what_it_says(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(1, 1);
    struct lw_material *material = &scene->material[0];
    const struct lw_mesh *mesh = &scene->mesh[0];
    material->base_colour[3] = 0.5f;
    assert_near(lw_scene_alpha(scene, mesh, 0, 0, 0), 1);
    material->alpha_mode = LW_ALPHA_BLEND;
    assert_near(lw_scene_alpha(scene, mesh, 0, 0, 0), 0.5f);
    material->alpha_mode = LW_ALPHA_MASK;
    material->alpha_cutoff = 0.5f; /* at the cutoff it is a surface */
    assert_near(lw_scene_alpha(scene, mesh, 0, 0, 0), 1);
    material->alpha_cutoff = 0.50001f;
    assert_near(lw_scene_alpha(scene, mesh, 0, 0, 0), 0);
    material->alpha_cutoff = 0;
    assert_near(lw_scene_alpha(scene, mesh, 0, 0, 0), 1);
    lw_scene_destroy(scene);
}

static void normals_that_cancel_give_way_to_the_face(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(1, 1);
    struct lw_vec3 normals[4] = {{1, 0, 0}, {-1, 0, 0}, {-1, 0, 0}, {0, 0, 1}};
    scene->mesh[0].normal = normals;
    struct lw_surface surface;
    lw_scene_surface(scene, &scene->mesh[0], 0, 0.5f, 0, &surface);
    assert_near(surface.normal.y, 1);
    lw_scene_surface(scene, &scene->mesh[0], 0, 0.25f, 0, &surface);
    assert_near(surface.normal.x, 1); /* half as long, made unit */
    lw_scene_destroy(scene);
}

/* One triangle of a cylinder of radius 1 about Z, 0.4 rad wide, facing up: its outside, or for hollow = -1
 * its inside. */
static void bend(struct lw_mesh *mesh, struct lw_vec3 position[3], struct lw_vec3 normal[3], float hollow) {
    static const uint32_t triangle[1][3] = {{0, 1, 2}};
    for (int i = 0; i < 3; i++) {
        float angle = i == 1 ? 0.2f : -0.2f;
        normal[i] = lw_vec3(hollow * sinf(angle), cosf(angle), 0);
        position[i] = lw_vec3(sinf(angle), hollow * cosf(angle), i == 2 ? -0.5f : 0);
    }
    *mesh = (struct lw_mesh){.triangle = triangle, .position = position, .normal = normal};
}

static void light_starts_above_a_bulge(void **state) {
    (void)state;
    struct lw_mesh mesh;
    struct lw_vec3 position[3], normal[3];
    bend(&mesh, position, normal, 1);
    struct lw_vec3 middle = lw_scene_shadow_origin(&mesh, 0, 0.5f, 0, false);
    /* (v - p) . n of either end of the chord */
    float height = sinf(0.2f) * sinf(0.2f);
    assert_near(middle.x, 0);
    assert_near(middle.y, cosf(0.2f) + height * cosf(0.2f));
    /* a corner stays */
    struct lw_vec3 corner = lw_scene_shadow_origin(&mesh, 0, 1, 0, false);
    assert_near(corner.x, position[1].x);
    assert_near(corner.y, position[1].y);
    /* from within, the same surface is hollow, and a flat one does not lift at all */
    middle = lw_scene_shadow_origin(&mesh, 0, 0.5f, 0, true);
    assert_near(middle.y, cosf(0.2f));
    for (int i = 0; i < 3; i++) normal[i] = lw_vec3(0, 1, 0);
    middle = lw_scene_shadow_origin(&mesh, 0, 0.5f, 0, false);
    assert_near(middle.y, cosf(0.2f));
}

static void backs_of_hollows_bulge(void **state) {
    (void)state;
    struct lw_mesh mesh;
    struct lw_vec3 position[3], normal[3];
    bend(&mesh, position, normal, -1);
    struct lw_vec3 middle = lw_scene_shadow_origin(&mesh, 0, 0.5f, 0, false);
    assert_near(middle.y, -cosf(0.2f));
    middle = lw_scene_shadow_origin(&mesh, 0, 0.5f, 0, true);
    assert_near(middle.y, -cosf(0.2f) - sinf(0.2f) * sinf(0.2f) * cosf(0.2f));
}

static void sharp_edges_do_not_lift(void **state) {
    (void)state;
    struct lw_mesh mesh;
    struct lw_vec3 position[3], normal[3];
    bend(&mesh, position, normal, 1);
    for (int i = 0; i < 3; i++) normal[i] = lw_vec3_normalize(lw_vec3(position[i].x > 0 ? 2 : -2, 1, 0));
    struct lw_vec3 middle = lw_scene_shadow_origin(&mesh, 0, 0.5f, 0, false);
    assert_near(middle.y, cosf(0.2f));
}

/* Facets are a quicker way to the same numbers, for every kind of material. */
static void facets_say_what_surfaces_say(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything();
    unsigned varying = 0, plain = 0;
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        const struct lw_mesh *mesh = &scene->mesh[m];
        uint32_t *material = (uint32_t *)mesh->material; /* ours: every triangle of every material */
        for (uint32_t t = 0; t < mesh->triangle_count; t++)
            for (material[t] = 0; material[t] < scene->material_count; material[t]++) {
                for (int i = 0; i <= 8; i++)
                    for (int j = 0; j <= 8 - i; j++) {
                        const float u = 0.125f * (float)i, v = 0.125f * (float)j;
                        const float weight[3] = {1 - u - v, u, v};
                        struct lw_surface expected;
                        struct lw_facet facet;
                        lw_scene_surface(scene, mesh, t, u, v, &expected);
                        lw_scene_facet(scene, mesh, t, &facet);
                        struct lw_surface found = {
                            .albedo = facet.albedo, .alpha = facet.alpha, .emission = facet.emission};
                        struct lw_texture_quad texels;
                        lw_scene_facet_texels(scene, &facet, weight, &texels);
                        if (facet.varies) lw_scene_facet_colour(scene, &facet, weight, &texels, &found);
                        varying += facet.varies, plain += !facet.varies;
                        assert_memory_equal(&found.albedo, &expected.albedo, sizeof found.albedo);
                        assert_memory_equal(&found.emission, &expected.emission, sizeof found.emission);
                        assert_float_equal(found.alpha, expected.alpha, 0);
                        assert_ptr_equal(facet.material, expected.material);
                        const struct lw_vec2 uv = lw_scene_facet_mean(facet.lightmap_uv, weight);
                        assert_memory_equal(&uv, &expected.lightmap_uv, sizeof uv);
                    }
            }
    }
    assert_true(varying > 0 && plain > 0);
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(facets_say_what_surfaces_say),
        cmocka_unit_test(texel_centres_give_texels),
        cmocka_unit_test(light_is_mixed_after_decoding),
        cmocka_unit_test(edges_follow_the_wrap_mode),
        cmocka_unit_test(rows_go_down_and_have_their_own_wrap_mode),
        cmocka_unit_test(wild_coordinates_stay_inside),
        cmocka_unit_test(no_texture_is_white_and_transforms_apply),
        cmocka_unit_test(albedo_alone_has_the_same_bits),
        cmocka_unit_test(a_surface_is_its_corners_weighed),
        cmocka_unit_test(lamps_shine_through_their_texture_and_blend),
        cmocka_unit_test(what_is_absent_is_neutral),
        cmocka_unit_test(albedo_and_alpha_stay_between_0_and_1),
        cmocka_unit_test(light_starts_above_a_bulge),
        cmocka_unit_test(backs_of_hollows_bulge),
        cmocka_unit_test(sharp_edges_do_not_lift),
        cmocka_unit_test(each_alpha_mode_means_what_it_says),
        cmocka_unit_test(normals_that_cancel_give_way_to_the_face),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
