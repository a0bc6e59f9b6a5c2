#include "tests/support/support.h"

#include "common/scene/scene.h"

#include <stdlib.h>
#include <string.h>

static void storage_is_zeroed_and_aligned(void **state) {
    (void)state;
    static const size_t sizes[] = {1, 15, 16, 17, 100, 4096, 32768, 32769, 65536, 65537, 1000000};
    struct lw_scene *scene;
    lw_support_ok(lw_scene_create(&scene), NULL);
    assert_string_equal(scene->name, "");
    unsigned char *previous = NULL;
    size_t previous_size = 0;
    for (int round = 0; round < 50; round++) {
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
            unsigned char *memory = lw_scene_alloc(scene, sizes[i], 1);
            assert_non_null(memory);
            assert_int_equal((uintptr_t)memory % 16, 0);
            for (size_t j = 0; j < sizes[i]; j++) assert_int_equal(memory[j], 0);
            memset(memory, 0xAB, sizes[i]); /* a later array that overlaps this one would not be zero */
            previous = memory;
            previous_size = sizes[i];
        }
    }
    /* readable for a vector load of the last bytes; only a sanitizer could tell otherwise */
    volatile unsigned char past_end = previous[previous_size + 15];
    (void)past_end;
    lw_scene_destroy(scene);
}

static void storage_refuses_sizes_that_overflow(void **state) {
    (void)state;
    struct lw_scene *scene;
    lw_support_ok(lw_scene_create(&scene), NULL);
    assert_null(lw_scene_alloc(scene, SIZE_MAX, 2));
    assert_null(lw_scene_alloc(scene, SIZE_MAX / 2 + 1, 2));
    assert_null(lw_scene_alloc(scene, SIZE_MAX, 1));
    assert_null(lw_scene_alloc(scene, SIZE_MAX - 40, 1));
    void *first = lw_scene_alloc(scene, 0, 8), *second = lw_scene_alloc(scene, 0, 8);
    assert_non_null(first);
    assert_ptr_not_equal(first, second);
    lw_scene_destroy(scene);
    lw_scene_destroy(NULL);
}

static void strings_are_copied(void **state) {
    (void)state;
    struct lw_scene *scene;
    lw_support_ok(lw_scene_create(&scene), NULL);
    char text[] = "wall";
    const char *copy = lw_scene_string(scene, text);
    text[0] = 'b';
    assert_string_equal(copy, "wall");
    assert_string_equal(lw_scene_string(scene, NULL), "");
    assert_string_equal(lw_scene_string(scene, ""), "");
    lw_scene_destroy(scene);
}

/* Two channels for the intensity of the first light, of which one counts. */
static struct lw_channel *dim(struct lw_scene *s, float least) {
    static const float time_s[] = {0};
    static float value[3];
    static struct lw_channel channel[2];
    value[2] = least;
    for (int i = 0; i < 2; i++)
        channel[i] = (struct lw_channel){0, LW_CHANNEL_INTENSITY, LW_INTERPOLATION_LINEAR, 1, time_s, value};
    s->light_channel = channel;
    s->light_channel_count = 1;
    return channel;
}

static void light_is_found_wherever_it_is(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(1, 1);
    assert_true(lw_scene_has_light(scene));
    memset(scene->light[0].intensity, 0, sizeof scene->light[0].intensity);
    assert_false(lw_scene_has_light(scene));
    scene->sky[2] = 0.001f;
    assert_true(lw_scene_has_light(scene));
    scene->sky[2] = 0;
    scene->material[0].emission[1] = 1;
    assert_true(lw_scene_has_light(scene));
    scene->object_count = 0; /* the mesh is still there, but nobody uses it */
    assert_false(lw_scene_has_light(scene));
    dim(scene, 0);
    assert_false(lw_scene_has_light(scene));
    dim(scene, 1); /* a lamp that is dark at first */
    assert_true(lw_scene_has_light(scene));
    lw_scene_destroy(scene);
}

static void an_emissive_material_that_no_triangle_uses_is_no_light(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything();
    scene->light_count = 0;
    memset(scene->sky, 0, sizeof scene->sky);
    assert_true(lw_scene_has_light(scene)); /* the second triangle of "full" is a lamp */
    ((uint32_t *)(uintptr_t)scene->mesh[0].material)[1] = 0;
    assert_false(lw_scene_has_light(scene));
    lw_scene_destroy(scene);
}

/* Meshes show their arrays as const; a test owns them. */
static void set(const float *p, float value) { *(float *)(uintptr_t)p = value; }
static void set_index(const uint32_t *p, uint32_t value) { *(uint32_t *)(uintptr_t)p = value; }

/* Every rule of lw_scene_validate: how to break it in lw_support_everything(), and what the message must
 * say. */
#define RULE_MAP(X)                                                                                          \
    X("scene: name is NULL", s->name = NULL)                                                                 \
    X("scene: name is not UTF-8", s->name = "\xC0\x80")                                                      \
    X("scene: duration_s is -1", s->duration_s = -1)                                                         \
    X("scene: duration_s is inf", s->duration_s = INFINITY)                                                  \
    X("scene: sky is nan", s->sky[2] = NAN)                                                                  \
    X("scene: sky is -0.5", s->sky[0] = -0.5f)                                                               \
    X("scene has 1048577 meshes; the limit is 1048576", s->mesh_count = LW_SCENE_MESHES_MAX + 1)             \
    X("scene has 65537 materials", s->material_count = LW_SCENE_MATERIALS_MAX + 1)                           \
    X("scene has 16385 textures", s->texture_count = LW_SCENE_TEXTURES_MAX + 1)                              \
    X("scene has 2097153 nodes", s->node_count = LW_SCENE_NODES_MAX + 1)                                     \
    X("scene has 1048577 objects", s->object_count = LW_SCENE_OBJECTS_MAX + 1)                               \
    X("scene has 1048577 lights", s->light_count = LW_SCENE_LIGHTS_MAX + 1)                                  \
    X("scene has 65537 cameras", s->camera_count = LW_SCENE_CAMERAS_MAX + 1)                                 \
    X("scene has 1048577 channels", s->channel_count = LW_SCENE_CHANNELS_MAX + 1)                            \
    X("scene has 2 cameras but no array of them", s->camera = NULL)                                          \
    X("texture 0: name is NULL", s->texture[0].name = NULL)                                                  \
    X("texture 0 \"checker\": size 0x2", s->texture[0].width = 0)                                            \
    X("texture 0 \"checker\": size 2x16385", s->texture[0].height = LW_SCENE_TEXTURE_SIDE_MAX + 1)           \
    X("texture 1: has no pixels", s->texture[1].rgba = NULL)                                                 \
    X("texture 0 \"checker\": wrap_s 3", s->texture[0].wrap_s = 3)                                           \
    X("texture 0 \"checker\": wrap_t 255", s->texture[0].wrap_t = 255)                                       \
    X("material 1: name is NULL", s->material[1].name = NULL)                                                \
    X("material 0 \"plain\": base_colour is nan", s->material[0].base_colour[3] = NAN)                       \
    X("material 0 \"plain\": base_colour is -1", s->material[0].base_colour[0] = -1)                         \
    X("material 1 \"leaf 葉\": base_colour_texture names texture 3 of 3",                                    \
      s->material[1].base_colour_texture.texture = 3)                                                        \
    X("base_colour_texture uses UV set 2", s->material[1].base_colour_texture.uv_set = 2)                    \
    X("base_colour_texture has a transform", s->material[1].base_colour_texture.transform[5] = INFINITY)     \
    X("material 2 \"lamp\": emission is inf", s->material[2].emission[1] = INFINITY)                         \
    X("material 2 \"lamp\": emission_texture names", s->material[2].emission_texture.texture = 9)            \
    X("material 2 \"lamp\": alpha_cutoff", s->material[2].alpha_cutoff = -1)                                 \
    X("material 2 \"lamp\": alpha_mode 3", s->material[2].alpha_mode = 3)                                    \
    X("material 2 \"lamp\": double_sided is 2", s->material[2].double_sided = 2)                             \
    X("mesh 0: name is NULL", s->mesh[0].name = NULL)                                                        \
    X("mesh 0 \"full\": has 0 vertices", s->mesh[0].vertex_count = 0)                                        \
    X("mesh 0 \"full\": has 4 vertices and 0 triangles", s->mesh[0].triangle_count = 0)                      \
    X("mesh 0 \"full\": lacks", s->mesh[0].position = NULL)                                                  \
    X("mesh 0 \"full\": lacks", s->mesh[0].normal = NULL)                                                    \
    X("mesh 0 \"full\": lacks", s->mesh[0].triangle = NULL)                                                  \
    X("mesh 0 \"full\": lacks", s->mesh[0].material = NULL)                                                  \
    X("mesh 0 \"full\": triangle 1 uses vertex 4 of 4", set_index(&s->mesh[0].triangle[1][2], 4))            \
    X("mesh 0 \"full\": triangle 0 uses material 3 of 3", set_index(&s->mesh[0].material[0], 3))             \
    X("mesh 0 \"full\": position 2 is (-1, nan, 1)", set(&s->mesh[0].position[2].y, NAN))                    \
    X("mesh 0 \"full\": position 0 is (2e+09", set(&s->mesh[0].position[0].x, 2e9f))                         \
    X("mesh 0 \"full\": position 3 is (1, 0, inf)", set(&s->mesh[0].position[3].z, INFINITY))                \
    X("mesh 0 \"full\": normal 3 is (0, nan, 0)", set(&s->mesh[0].normal[3].y, NAN))                         \
    X("mesh 0 \"full\": normal 1 is (0, 0, 0)", set(&s->mesh[0].normal[1].y, 0))                             \
    X("mesh 0 \"full\": normal 1 is (0, 1.02, 0)", set(&s->mesh[0].normal[1].y, 1.02f))                      \
    X("mesh 0 \"full\": UV set 0 of entry 3", set(&s->mesh[0].uv[0][3].y, NAN))                              \
    X("mesh 0 \"full\": UV set 1 of entry 0", set(&s->mesh[0].uv[1][0].x, INFINITY))                         \
    X("mesh 0 \"full\": vertex colour of entry 2", set(&s->mesh[0].colour[2].w, NAN))                        \
    X("mesh 0 \"full\": has an atlas of 12x24 but no lightmap UVs", s->mesh[0].lightmap_uv = NULL)           \
    X("mesh 0 \"full\": atlas of 0x24", s->mesh[0].atlas_width = 0)                                          \
    X("mesh 0 \"full\": atlas of 12x26", s->mesh[0].atlas_height = 26)                                       \
    X("mesh 0 \"full\": atlas of 16388x24", s->mesh[0].atlas_width = LW_SCENE_ATLAS_SIDE_MAX + 4)            \
    X("mesh 0 \"full\": back_offset 10", s->mesh[0].back_offset = 10)                                        \
    X("mesh 0 \"full\": back_offset 24", s->mesh[0].back_offset = 24)                                        \
    X("mesh 0 \"full\": has double-sided triangles but", s->mesh[0].back_offset = 0)                         \
    X("mesh 0 \"full\": lightmap UV 0 is (-1, 2)", set(&s->mesh[0].lightmap_uv[0].x, -1))                    \
    X("mesh 0 \"full\": lightmap UV 1 is (12.5, 2)", set(&s->mesh[0].lightmap_uv[1].x, 12.5f))               \
    X("mesh 0 \"full\": lightmap UV 3 is (10, 12.5)", set(&s->mesh[0].lightmap_uv[3].y, 12.5f))              \
    X("mesh 0 \"full\": lightmap UV 2 is (2, 10); it must be within [0, 12] x [0, 8]",                       \
      s->mesh[0].back_offset = 16) /* then the backs have 8 rows left */                                     \
    X("mesh 0 \"full\": lightmap UV 3 is (10, nan)", set(&s->mesh[0].lightmap_uv[3].y, NAN))                 \
    X("node 0: name is NULL", s->node[0].name = NULL)                                                        \
    X("node 2 \"turned\": parent 2 does not come before", s->node[2].parent = 2)                             \
    X("node 2 \"turned\": parent 4 does not come before", s->node[2].parent = 4)                             \
    X("node 2 \"turned\": has_matrix is 2", s->node[2].has_matrix = 2)                                       \
    X("node 0 \"root\": translation component 1 is nan", s->node[0].translation[1] = NAN)                    \
    X("node 0 \"root\": scale component 2 is inf", s->node[0].scale[2] = INFINITY)                           \
    X("node 0 \"root\": rotation component 0 is nan", s->node[0].rotation[0] = NAN)                          \
    X("node 0 \"root\": rotation is no unit quaternion", s->node[0].rotation[3] = 0.98f)                     \
    X("node 1 \"mirror\": matrix component 11 is nan", s->node[1].matrix.m[2][3] = NAN)                      \
    X("node 2 \"turned\": transform to the world component",                                                 \
      (s->node[1].matrix.m[2][2] = 1e8f, s->node[2].scale[0] = 1e8f, s->channel_count = 0))                  \
    X("object 0: name is NULL", s->object[0].name = NULL)                                                    \
    X("object 1 \"second\": names mesh 2 of 2", s->object[1].mesh = 2)                                       \
    X("object 2: names node 4 of 4", s->object[2].node = 4)                                                  \
    X("light 0: name is NULL", s->light[0].name = NULL)                                                      \
    X("light 2 \"sun\": names node 4294967295 of 4", s->light[2].node = LW_SCENE_NONE)                       \
    X("light 0 \"point\": kind 3", s->light[0].kind = 3)                                                     \
    X("light 0 \"point\": intensity is -1", s->light[0].intensity[2] = -1)                                   \
    X("light 0 \"point\": intensity is nan", s->light[0].intensity[0] = NAN)                                 \
    X("light 1 \"spot\": inner_cone is nan", s->light[1].inner_cone = NAN)                                   \
    X("light 1 \"spot\": outer_cone is 1.6", s->light[1].outer_cone = 1.6f)                                  \
    X("light 1 \"spot\": outer_cone 0.1 must be wider", s->light[1].outer_cone = 0.1f)                       \
    X("light 1 \"spot\": outer_cone 0.1 must be wider",                                                      \
      (s->light[1].inner_cone = 0.1f, s->light[1].outer_cone = 0.1f))                                        \
    X("light 2 \"sun\": angular_diameter is 4", s->light[2].angular_diameter = 4)                            \
    X("camera 0: name is NULL", s->camera[0].name = NULL)                                                    \
    X("camera 1 \"камера\": names node 7 of 4", s->camera[1].node = 7)                                       \
    X("camera 0 \"main\": fov_y is 0;", s->camera[0].fov_y = 0)                                              \
    X("camera 0 \"main\": fov_y is 3.14159", s->camera[0].fov_y = LW_PI)                                     \
    X("camera 0 \"main\": fov_y is nan", s->camera[0].fov_y = NAN)                                           \
    X("channel 0: names node 4 of 4", s->channel[0].node = 4)                                                \
    X("channel 0: animates node 1, which has a matrix", s->channel[0].node = 1)                              \
    X("channel 0: path 3", s->channel[0].path = 3)                                                           \
    X("channel 0: interpolation 3", s->channel[0].interpolation = 3)                                         \
    X("channel 0: has no keys", s->channel[0].key_count = 0)                                                 \
    X("channel 0: has no keys", s->channel[0].time_s = NULL)                                                 \
    X("channel 0: has no keys", s->channel[0].value = NULL)                                                  \
    X("channel 0: time of key 0 is -1", set(&s->channel[0].time_s[0], -1))                                   \
    X("channel 0: time of key 2 is not after", set(&s->channel[0].time_s[2], 1))                             \
    X("channel 0: time of key 1 is nan", set(&s->channel[0].time_s[1], NAN))                                 \
    X("channel 0: key value component 8 is nan", set(&s->channel[0].value[8], NAN))                          \
    X("channel 2: key value component 17 is inf", set(&s->channel[2].value[17], INFINITY))                   \
    X("channel 1: rotation of key 2 is no unit", set(&s->channel[1].value[10], 0.5f))                        \
    X("channel 3: rotation of key 1 is no unit", set(&s->channel[3].value[12 + 4 + 2], 0.5f))                \
    X("channel 4: animates a property of node 0 that an earlier channel", s->channel[4].node = 0)            \
    X("material 0 \"plain\": unlit is 2", s->material[0].unlit = 2)                                          \
    X("material 2 \"lamp\": is unlit, and has an emission", s->material[2].unlit = 1)                        \
    X("material 2 \"lamp\": has a tint, but lets no light pass",                                             \
      (s->material[2].alpha_mode = LW_ALPHA_OPAQUE, s->material[2].tint[0] = 1))                             \
    X("material 2 \"lamp\": tint is 15",                                                                     \
      (s->material[2].alpha_mode = LW_ALPHA_BLEND, s->material[2].tint[1] = 15))                             \
    X("camera 0 \"main\": height_m is -1", s->camera[0].height_m = -1)                                       \
    X("channel of a light 0: names light 3 of 3", dim(s, 0)->node = 3)                                       \
    X("channel of a light 0: path 0", dim(s, 0)->path = LW_CHANNEL_TRANSLATION)                              \
    X("channel of a light 0: has no keys", dim(s, 0)->key_count = 0)                                         \
    X("channel of a light 0: key value is -1", (void)dim(s, -1))                                             \
    X("channel of a light 1: animates a property of light 0", (dim(s, 0), s->light_channel_count = 2))

static void break_rule(struct lw_scene *s, unsigned rule) {
    unsigned i = 0;
#define X(message, ...)                                                                                      \
    if (rule == i++) __VA_ARGS__;
    RULE_MAP(X)
#undef X
}

static const char *const rule_messages[] = {
#define X(message, ...) message,
    RULE_MAP(X)
#undef X
};

static void each_rule_refuses_its_violation(void **state) {
    (void)state;
    for (unsigned rule = 0; rule < sizeof rule_messages / sizeof *rule_messages; rule++) {
        struct lw_scene *scene = lw_support_everything();
        break_rule(scene, rule);
        struct lw_error err = {0};
        enum lw_status status = lw_scene_validate(scene, &err);
        lw_support_fails(status, LW_BAD_DATA, &err, rule_messages[rule]);
        assert_int_equal(lw_scene_validate(scene, NULL), LW_BAD_DATA);
        lw_scene_destroy(scene);
    }
}

static void good_scenes_pass(void **state) {
    (void)state;
    struct lw_error err = {0};
    struct lw_scene *scene = lw_support_everything();
    lw_support_ok(lw_scene_validate(scene, &err), &err);
    /* at the limits */
    set(&scene->mesh[0].lightmap_uv[3].x, 12);
    set(&scene->mesh[0].lightmap_uv[3].y, 12);
    set(&scene->mesh[0].lightmap_uv[0].x, 0);
    set(&scene->mesh[0].position[0].x, LW_SCENE_COORDINATE_MAX);
    scene->sky[0] = LW_SCENE_RADIANCE_MAX;
    scene->light[2].angular_diameter = 0;
    scene->light[1].outer_cone = LW_PI / 2;
    scene->node[1].rotation[3] = 0; /* not used beside a matrix */
    scene->name =
        "\x7F \xC2\x80 \xDF\xBF \xE0\xA0\x80 \xED\x9F\xBF \xEE\x80\x80 \xF0\x90\x80\x80 \xF4\x8F\xBF\xBF";
    lw_support_ok(lw_scene_validate(scene, &err), &err);
    lw_scene_destroy(scene);
    lw_support_ok(lw_scene_create(&scene), NULL);
    lw_support_ok(lw_scene_validate(scene, &err),
                  &err); /* an empty scene is sound; that it is dark is another matter */
    lw_scene_destroy(scene);
}

static void names_that_are_no_utf8_are_refused(void **state) {
    (void)state;
    static const char *const bad[] = {"\x80",
                                      "\xC1\xBF",
                                      "\xC3",
                                      "a\xE2\x82",
                                      "\xE0\x9F\xBF",
                                      "\xED\xA0\x80",
                                      "\xEF\xBFz",
                                      "\xF0\x8F\xBF\xBF",
                                      "\xF4\x90\x80\x80",
                                      "\xF5\x80\x80\x80",
                                      "\xFF",
                                      "\xE2\x28\xA1"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct lw_scene *scene = lw_support_squares(1, 1);
        struct lw_error err = {0};
        scene->object[0].name = bad[i];
        enum lw_status status = lw_scene_validate(scene, &err);
        lw_support_fails(status, LW_BAD_DATA, &err, "object 0: name is not UTF-8");
        lw_scene_destroy(scene);
    }
}

static void names_in_messages_stay_on_one_short_line(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(1, 1);
    struct lw_error err = {0};
    scene->object[0].name = "a\nb\x1B[31m";
    scene->object[0].mesh = 5;
    enum lw_status status = lw_scene_validate(scene, &err);
    lw_support_fails(status, LW_BAD_DATA, &err, "object 0 \"a?b?[31m\": names mesh 5 of 1");
    char long_name[400];
    memset(long_name, 'x', 63);
    strcpy(long_name + 63, "\xC3\xB6 and more"); /* the cut falls into the two bytes of the letter */
    scene->object[0].name = long_name;
    err = (struct lw_error){0};
    status = lw_scene_validate(scene, &err);
    lw_support_fails(status, LW_BAD_DATA, &err, "xxx\": names mesh");
    lw_scene_destroy(scene);
}

static void instances_count_towards_the_limits(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything();
    /* 16384 x 16384 is the limit of texels: one object of it passes, two do not */
    scene->object_count = 1;
    scene->mesh[0].atlas_width = scene->mesh[0].atlas_height = LW_SCENE_ATLAS_SIDE_MAX;
    struct lw_error err = {0};
    lw_support_ok(lw_scene_validate(scene, &err), &err);
    scene->object_count = 2;
    enum lw_status status = lw_scene_validate(scene, &err);
    lw_support_fails(status, LW_BAD_DATA, &err, "scene has 536870912 texels in its objects' atlases");
    lw_scene_destroy(scene);
}

/* An object of one mesh, whose last triangle is of another material than the others. */
static bool has_bumps(const struct lw_finish *first, const struct lw_finish *last, bool unlit) {
    const uint32_t number[3] = {0, 0, 1};
    struct lw_material material[2] = {{.finish = first}, {.finish = last, .unlit = unlit}};
    struct lw_mesh mesh = {.triangle_count = 3, .material = number};
    struct lw_object object = {.mesh = 0};
    const struct lw_scene scene = {.material = material,
                                   .material_count = 2,
                                   .mesh = &mesh,
                                   .mesh_count = 1,
                                   .object = &object,
                                   .object_count = 1};
    return lw_scene_object_has_bumps(&scene, 0);
}

/* --directional auto: objects with a normal map, a texture of roughness, or roughness under 0.6. */
static void bumps_and_gloss_ask_for_directions(void **state) {
    (void)state;
    const struct lw_texture_use none = {.texture = LW_SCENE_NONE}, some = {.texture = 0};
    const struct lw_finish even = {.roughness = 1,
                                   .ior = 1.5f,
                                   .surface_texture = none,
                                   .specular_texture = none,
                                   .occlusion_texture = none,
                                   .normal_texture = none};
    struct lw_finish normals = even, roughnesses = even, smooth = even, rough = even, others = even;
    normals.normal_texture = roughnesses.surface_texture = some;
    others.specular_texture = others.occlusion_texture = some;
    smooth.roughness = 0.59f, rough.roughness = 0.61f;
    assert_true(LW_SCENE_ROUGH > 0.59f && LW_SCENE_ROUGH < 0.61f);
    const struct lw_finish *const asks[] = {&normals, &roughnesses, &smooth};
    const struct lw_finish *const does_not[] = {NULL, &even, &rough, &others};
    for (size_t i = 0; i < sizeof asks / sizeof *asks; i++) {
        assert_true(has_bumps(asks[i], NULL, false));
        assert_true(has_bumps(NULL, asks[i], false)); /* one triangle is enough */
        assert_false(has_bumps(NULL, asks[i], true)); /* unlit: no light at all */
    }
    for (size_t i = 0; i < sizeof does_not / sizeof *does_not; i++)
        assert_false(has_bumps(does_not[i], does_not[i], false));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(storage_is_zeroed_and_aligned),
        cmocka_unit_test(storage_refuses_sizes_that_overflow),
        cmocka_unit_test(strings_are_copied),
        cmocka_unit_test(light_is_found_wherever_it_is),
        cmocka_unit_test(an_emissive_material_that_no_triangle_uses_is_no_light),
        cmocka_unit_test(each_rule_refuses_its_violation),
        cmocka_unit_test(good_scenes_pass),
        cmocka_unit_test(names_that_are_no_utf8_are_refused),
        cmocka_unit_test(names_in_messages_stay_on_one_short_line),
        cmocka_unit_test(instances_count_towards_the_limits),
        cmocka_unit_test(bumps_and_gloss_ask_for_directions),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
