#include "tests/support/gltf_case.h"

#include "common/base/log.h"
#include "server/import/gltf/gltf.h"
#include "tests/support/glb.h"

#include <fcntl.h>
#include <stdio.h>
#include <string.h>

/* Materials, textures and pictures. */

/* a header that says 40,000 texels wide */
#define PNG_TOO_WIDE                                                                                         \
    "iVBORw0KGgoAAAANSUhEUgAAnEAAAAABCAYAAAC9YMuEAAAACElEQVR4nAMAAAAAAUgGidIAAAAASUVORK5CYII="

/* the same texels in other formats */
#define WEBP "UklGRiAAAABXRUJQVlA4TBQAAAAvAQAAEA8wgPs//w/6Dy1UIKL/AQ=="

#define AVIF                                                                                                 \
    "AAAAIGZ0eXBhdmlmAAAAAGF2aWZtaWYxbWlhZk1BMUEAAAGNbWV0YQAAAAAAAAAoaGRscgAAAAAAAAAAcGljdAAAAAAAAAAA"       \
    "AAAAAGxpYmF2aWYAAAAADnBpdG0AAAAAAAEAAAAsaWxvYwAAAABEAAACAAEAAAABAAABzgAAADYAAgAAAAEAAAG1AAAAGQAA"       \
    "AEJpaW5mAAAAAAACAAAAGmluZmUCAAAAAAEAAGF2MDFDb2xvcgAAAAAaaW5mZQIAAAAAAgAAYXYwMUFscGhhAAAAABppcmVm"       \
    "AAAAAAAAAA5hdXhsAAIAAQABAAAAw2lwcnAAAACdaXBjbwAAABRpc3BlAAAAAAAAAAIAAAABAAAAEHBpeGkAAAAAAwgICAAA"       \
    "AAxhdjFDgSAAAAAAABNjb2xybmNseAACAAIAAIAAAAAOcGl4aQAAAAABCAAAAAxhdjFDgQAcAAAAADhhdXhDAAAAAHVybjpt"       \
    "cGVnOm1wZWdCOmNpY3A6c3lzdGVtczphdXhpbGlhcnk6YWxwaGEAAAAAHmlwbWEAAAAAAAAAAgABBAECgwQAAgQBBYYHAAAA"       \
    "V21kYXQSAAoEGAAuVTIPEACG0okppdY/cr1yvYOAEgAKBzgALlAgIAkyKRAAAIu7FZWxIsAzAMwDaVAW/9VnFzqLWI9Yj2+e"       \
    "1Re9U38GGfIJ8gp5"

/* ---- nodes, textures, animation ---- */

static void a_texture_transform_moves_its_coordinates(void **state) {
    (void)state;
    struct lw_scene *scene;
    GLTF_CASE_LOAD(scene, gltf_case_base_data,
                   {"'baseColorTexture':{'index':0}",
                    "'baseColorTexture':{'index':0,'extensions':{'KHR_texture_transform':"
                    "{'offset':[0.5,-0.25],'rotation':1.5707963,'scale':[2,3],'texCoord':1}}}"});
    const struct lw_texture_use *use = &scene->material[0].base_colour_texture;
    assert_int_equal(use->uv_set, 1);
    /* a quarter turn: u' = 3 v + 0.5, v' = -2 u - 0.25 */
    const float expected[6] = {0, 3, 0.5f, -2, 0, -0.25f};
    for (int i = 0; i < 6; i++) assert_float_equal(use->transform[i], expected[i], 1e-6);
    lw_scene_destroy(scene);
    GLTF_CASE_REFUSE("KHR_texture_transform: scale", gltf_case_base_data,
                     {"'baseColorTexture':{'index':0}",
                      "'baseColorTexture':{'index':0,'extensions':{'KHR_texture_transform':{'scale':2}}}"});
}

static void images_are_decoded_once(void **state) {
    (void)state;
    struct lw_scene *scene;
    GLTF_CASE_LOAD(
        scene, gltf_case_base_data,
        {"'alphaMode'", "'emissiveTexture':{'index':1},'normalTexture':{'index':2},'alphaMode'"},
        {"'textures':[", "'textures':[{'source':0,'sampler':1},{'source':0,'sampler':0},{'source':1},"},
        {"'wrapT':33648}", "'wrapT':33648},{'wrapS':33071}"},
        {"'images':[",
         "'images':[{'uri':'data:image/png;base64," GLTF_CASE_PNG "'},{'uri':'../never/read.png'},"});
    const struct lw_material *material = &scene->material[0];
    assert_int_equal(scene->texture_count, 2); /* they differ in how they repeat */
    assert_ptr_equal(scene->texture[0].rgba, scene->texture[1].rgba);
    assert_int_not_equal(material->base_colour_texture.texture, material->emission_texture.texture);
    lw_scene_destroy(scene);
}

/* Each way in which a picture fails gives one warning that names it, and a colour in its place. */
static void unreadable_pictures_have_a_stand_in(void **state) {
    (void)state;
    static const struct {
        struct gltf_case_change change;
        const char *text;
    } failures[] = {
        {{"'uri':'data:image/png;base64," GLTF_CASE_PNG "'", "'bufferView':0"},
         "images[0]: is not PNG, JPEG, WebP, AVIF, TGA or BMP"},
        {{"data:image/png;base64," GLTF_CASE_PNG, "data:image/png;base64," PNG_TOO_WIDE},
         "Invalid IHDR data"},
        {{"data:image/png;base64," GLTF_CASE_PNG, "data:image/png;base64,iVBORw0KGgoAAAANSUhEUg"},
         "it is truncated"},
        {{"{'source':0,'sampler':0}", "{'extensions':{'KHR_texture_basisu':{'source':0}}}"},
         "have no image in a format that is read; a colour stands in: \"textures[0]\""},
        {{"data:image/png;base64,", "data:image/png;base64,!"}, "is not base64"},
        {{"data:image/png;base64,", "data:image/png,"}, "must be data:TYPE;base64"},
        {{"data:image/png;base64," GLTF_CASE_PNG, "http://host/a.png"}, "http://host/a.png"},
        {{"data:image/png;base64," GLTF_CASE_PNG, "file:///etc/passwd"}, "only data: and relative paths"},
        {{"data:image/png;base64," GLTF_CASE_PNG, "C:\\\\textures\\\\a.png"},
         "only data: and relative paths"},
        {{"data:image/png;base64," GLTF_CASE_PNG, "/etc/passwd"}, "leaves the folder"},
        {{"data:image/png;base64," GLTF_CASE_PNG, "../textures/a.png"},
         "uri \"../textures/a.png\": leaves the folder"},
        {{"data:image/png;base64," GLTF_CASE_PNG, "a/%2e%2e/%2E./a.png"}, "leaves the folder"},
        {{"data:image/png;base64," GLTF_CASE_PNG, "%2fetc/passwd"}, "leaves the folder"},
        {{"data:image/png;base64," GLTF_CASE_PNG, "a%00.png"}, "wrong %-escape"},
        {{"data:image/png;base64," GLTF_CASE_PNG, "a%4"}, "wrong %-escape"},
        {{"data:image/png;base64," GLTF_CASE_PNG, ""}, "must have 1 to"},
        {{"data:image/png;base64," GLTF_CASE_PNG, "a\\n\\u001b[31m.png"}, "a??[31m.png"},
    };
    char talk[4096];
    for (size_t i = 0; i < sizeof failures / sizeof *failures; i++) {
        const struct gltf_case_change changes[] = {
            failures[i].change, {"'alphaMode'", "'emissiveTexture':{'index':0},'alphaMode'"}};
        struct lw_scene *scene = gltf_case_load_and_listen(changes, 2, &gltf_case_base_data,
                                                           sizeof gltf_case_base_data, talk, sizeof talk);
        const struct lw_material *material = &scene->material[0];
        if (!strstr(talk, failures[i].text) || gltf_case_count_lines(talk) != 1)
            fail_msg("talk is \"%s\"", talk);
        assert_int_equal(scene->texture_count, 0);
        assert_int_equal(material->base_colour_texture.texture, LW_SCENE_NONE);
        assert_int_equal(material->emission_texture.texture, LW_SCENE_NONE);
        assert_float_equal(material->base_colour[0], 0.25, 0); /* half of 0.5 */
        assert_float_equal(material->base_colour[3], 1, 0);
        assert_float_equal(material->emission[0], 0, 0);
        lw_scene_destroy(scene);
    }
}

static void pictures_of_extensions_are_read(void **state) {
    (void)state;
    static const struct {
        const char *extension, *uri;
    } formats[] = {{"EXT_texture_webp", "data:image/webp;base64," WEBP},
                   {"EXT_texture_avif", "data:image/avif;base64," AVIF}};
    for (size_t i = 0; i < sizeof formats / sizeof *formats; i++)
        for (int fallback = 0; fallback < 2; fallback++) {
            char texture[128], required[128];
            snprintf(texture, sizeof texture, "{%s'sampler':0,'extensions':{'%s':{'source':0}}}",
                     fallback ? "'source':1," : "", formats[i].extension);
            snprintf(required, sizeof required, "'asset':{'version':'2.0'},'extensionsRequired':['%s']",
                     formats[i].extension);
            struct lw_scene *scene;
            GLTF_CASE_LOAD(scene, gltf_case_base_data, {"{'source':0,'sampler':0}", texture},
                           {"'asset':{'version':'2.0'}", required},
                           {"data:image/png;base64," GLTF_CASE_PNG "'}", "@'},{'uri':'@'}"},
                           {"@", formats[i].uri});
            const uint8_t texels[8] = {255, 0, 0, 255, 0, 128, 255, 64};
            assert_int_equal(scene->texture_count, 1);
            assert_memory_equal(scene->texture[0].rgba, texels, sizeof texels);
            lw_scene_destroy(scene);
        }
}

static void emission_is_strength_times_texture(void **state) {
    (void)state;
    struct lw_scene *scene;
    GLTF_CASE_LOAD(scene, gltf_case_base_data, {"'alphaMode'", "'emissiveTexture':{'index':0},'alphaMode'"});
    struct lw_surface surface;
    /* the middle of the right texel, (0, 128, 255) in sRGB, at u = 0.75; factor (1, 0.5, 0) x 4 */
    lw_scene_surface(scene, &scene->mesh[0], 0, 0.75f, 0, &surface);
    assert_float_equal(surface.emission.x, 0, 1e-6);
    assert_float_equal(surface.emission.y, 4 * 0.5f * powf((128 / 255.0f + 0.055f) / 1.055f, 2.4f), 1e-5);
    assert_float_equal(surface.emission.z, 0, 1e-6);
    lw_scene_destroy(scene);
}

static void albedo_above_one_is_lowered_and_reported_once(void **state) {
    (void)state;
    char talk[4096];
    const struct gltf_case_change bright[] = {{"[0.5,0.25,0.125,1]", "[1.5,0.25,7,1]"}};
    struct lw_scene *scene = gltf_case_load_and_listen(bright, 1, &gltf_case_base_data,
                                                       sizeof gltf_case_base_data, talk, sizeof talk);
    assert_float_equal(scene->material[0].base_colour[0], 1, 0);
    assert_float_equal(scene->material[0].base_colour[1], 0.25, 0);
    assert_float_equal(scene->material[0].base_colour[2], 1, 0);
    assert_int_equal(gltf_case_count_lines(talk), 1);
    assert_non_null(strstr(talk, "base colours above 1 are lowered to 1: \"materials[0] paint\""));
    lw_scene_destroy(scene);

    const struct {
        struct gltf_case_base_data base;
        float colour[4][3];
    } data = {gltf_case_base_data, {{2, 0.5f, 0}, {3, 1, 1}, {1, 1, 1}, {1, 1, 1}}};
#define FLOAT_COLOUR                                                                                         \
    {"'count':2,'type':'VEC3'}",                                                                             \
     "'count':2,'type':'VEC3'},{'bufferView':6,'componentType':5126,'count':4,'type':'VEC3'}"},              \
        {"'byteOffset':148,'byteLength':24}",                                                                \
         "'byteOffset':148,'byteLength':24},{'buffer':0,'byteOffset':172,'byteLength':48}"},                 \
        {"'byteLength':172", "'byteLength':220"}, {                                                          \
        "'POSITION':0", "'POSITION':0,'COLOR_0':6"                                                           \
    }
    const struct gltf_case_change colours[] = {FLOAT_COLOUR};
    scene = gltf_case_load_and_listen(colours, 4, &data, sizeof data, talk, sizeof talk);
    assert_float_equal(scene->mesh[0].colour[0].x, 1, 0);
    assert_float_equal(scene->mesh[0].colour[0].y, 0.5, 0);
    assert_int_equal(gltf_case_count_lines(talk), 1);
    assert_non_null(strstr(talk, "vertex colours above 1 are lowered to 1: \"meshes[0] square\""));
    lw_scene_destroy(scene);

    typeof(data) negative = data;
    ((struct {
        struct gltf_case_base_data base;
        float colour[4][3];
    } *)(void *)&negative)
        ->colour[1][2] = -0.5f;
    GLTF_CASE_REFUSE("attributes.COLOR_0: accessor 6: element 1 is negative", negative, FLOAT_COLOUR);
}

/* ---- extensions ---- */

static void specular_glossiness_gives_its_diffuse_colour(void **state) {
    (void)state;
#define GLOSSY(fields)                                                                                       \
    {                                                                                                        \
        "{'KHR_materials_emissive_strength':",                                                               \
            "{'KHR_materials_pbrSpecularGlossiness':{" fields "},'KHR_materials_emissive_strength':"         \
    }
    struct lw_scene *scene;
    GLTF_CASE_LOAD(scene, gltf_case_base_data,
                   GLOSSY("'diffuseFactor':[0.125,0.5,0.75,0.5],'specularFactor':[0.9,0.9,0.9]"),
                   {"'scene':0", "'scene':0,'extensionsRequired':['KHR_materials_pbrSpecularGlossiness']"});
    const float expected[4] = {0.125f, 0.5f, 0.75f, 0.5f};
    for (int c = 0; c < 4; c++) assert_float_equal(scene->material[0].base_colour[c], expected[c], 0);
    assert_int_equal(scene->material[0].base_colour_texture.texture, LW_SCENE_NONE);
    lw_scene_destroy(scene);
    /* its texture; white is its default */
    GLTF_CASE_LOAD(scene, gltf_case_base_data, GLOSSY("'diffuseTexture':{'index':0}"));
    assert_float_equal(scene->material[0].base_colour[0], 1, 0);
    assert_int_equal(scene->material[0].base_colour_texture.texture, 0);
    lw_scene_destroy(scene);
    /* a metal: black below a bright specular colour */
    GLTF_CASE_LOAD(scene, gltf_case_base_data,
                   GLOSSY("'diffuseFactor':[0,0,0,1],'specularFactor':[0.9,0.6,0.3]"));
    assert_float_equal(scene->material[0].base_colour[1], 0, 0);
    assert_float_equal(scene->material[0].finish->specular_colour[1], 0.6f / 0.04f, 1e-5);
    lw_scene_destroy(scene);
    /* where all is matt, by the rule of MTL */
    gltf_case_matt = true;
    GLTF_CASE_LOAD(scene, gltf_case_base_data,
                   GLOSSY("'diffuseFactor':[0,0,0,1],'specularFactor':[0.9,0.6,0.3]"));
    assert_float_equal(scene->material[0].base_colour[1], 0.6f, 0);
    assert_null(scene->material[0].finish);
    lw_scene_destroy(scene);
    GLTF_CASE_LOAD(scene, gltf_case_base_data,
                   GLOSSY("'diffuseFactor':[0,0,0,1],'specularFactor':[0.5,0.5,0.5]"));
    assert_float_equal(scene->material[0].base_colour[1], 0, 0);
    lw_scene_destroy(scene);
    gltf_case_matt = false;
    GLTF_CASE_REFUSE("materials[0]: KHR_materials_pbrSpecularGlossiness: diffuseFactor", gltf_case_base_data,
                     GLOSSY("'diffuseFactor':[1,1,1]"));
}

/* Thin glass: t c passes, (1 - t) c is reflected. */
static void transmission_lets_light_through(void **state) {
    (void)state;
    static const struct {
        float t, colour[3];
    } panes[] = {{1, {1, 1, 1}}, {0.5f, {0.2f, 0.8f, 0.4f}}, {1, {0, 0.5f, 0}}, {0.25f, {1, 1, 1}},
                 {0, {1, 1, 0}}, {1, {0, 0, 1e-40f}}};
    for (size_t i = 0; i < sizeof panes / sizeof *panes; i++) {
        char glass[256];
        const float *c = panes[i].colour, t = panes[i].t;
        snprintf(glass, sizeof glass,
                 "'baseColorFactor':[%g,%g,%g,1]},'alphaMode':'OPAQUE','extensions':{"
                 "'KHR_materials_transmission':{'transmissionFactor':%g}}}],",
                 (double)c[0], (double)c[1], (double)c[2], (double)t);
        struct lw_scene *scene;
        GLTF_CASE_LOAD(scene, gltf_case_base_data,
                       {"'baseColorFactor':[0.5,0.25,0.125,1],'baseColorTexture':{'index':0}},"
                        "'emissiveFactor':[1,0.5,0],"
                        "'extensions':{'KHR_materials_emissive_strength':{'emissiveStrength':4}},"
                        "'alphaMode':'MASK','alphaCutoff':0.25,'doubleSided':true}],",
                        glass},
                       {"'scene':0", "'scene':0,'extensionsRequired':['KHR_materials_transmission']"});
        struct lw_surface surface;
        lw_scene_surface(scene, &scene->mesh[0], 0, 0.25f, 0.25f, &surface);
        const float luminance = 0.2126f * c[0] + 0.7152f * c[1] + 0.0722f * c[2];
        assert_float_equal(1 - surface.alpha, t * luminance, 1e-6);
        assert_float_equal(surface.alpha * surface.albedo.x, (1 - t) * c[0], 1e-6);
        assert_float_equal(surface.alpha * surface.albedo.y, (1 - t) * c[1], 1e-6);
        const struct lw_vec3 passed = lw_material_tint(&scene->material[0], lw_vec3(1, 1, 1));
        assert_float_equal((1 - surface.alpha) * passed.x, t * c[0], 1e-6);
        assert_float_equal((1 - surface.alpha) * passed.y, t * c[1], 1e-6);
        assert_float_equal((1 - surface.alpha) * passed.z, t * c[2], 1e-6);
        lw_scene_destroy(scene);
    }
}

static void unlit_materials_are_their_base_colour(void **state) {
    (void)state;
    char talk[4096];
    const struct gltf_case_change changes[] = {
        {"{'KHR_materials_emissive_strength':",
         "{'KHR_materials_unlit':{},'KHR_materials_emissive_strength':"},
        {"'extensionsUsed':[", "'extensionsRequired':['KHR_materials_unlit'],'extensionsUsed':["}};
    struct lw_scene *scene = gltf_case_load_and_listen(changes, 2, &gltf_case_base_data,
                                                       sizeof gltf_case_base_data, talk, sizeof talk);
    struct lw_surface surface;
    assert_string_equal(talk, "");
    assert_true(scene->material[0].unlit);
    assert_false(lw_material_shines(&scene->material[0]));
    assert_int_equal(scene->material[0].base_colour_texture.texture, 0);
    /* the middle of the right texel, (0, 128, 255) in sRGB; nothing of its emission */
    lw_scene_surface(scene, &scene->mesh[0], 0, 0.75f, 0, &surface);
    assert_float_equal(surface.albedo.x + surface.albedo.y + surface.albedo.z, 0, 0);
    assert_float_equal(surface.emission.x, 0, 1e-6);
    assert_float_equal(surface.emission.y, 0.25f * powf((128 / 255.0f + 0.055f) / 1.055f, 2.4f), 1e-6);
    assert_float_equal(surface.emission.z, 0.125f, 1e-6);
    lw_scene_destroy(scene);
    GLTF_CASE_REFUSE("materials[0]: extensions: KHR_materials_unlit: must be an object", gltf_case_base_data,
                     {"{'KHR_materials_emissive_strength':",
                      "{'KHR_materials_unlit':true,'KHR_materials_emissive_strength':"});
}

static void basisu_takes_the_fallback_or_says_what_to_run(void **state) {
    (void)state;
    char talk[4096];
    const struct gltf_case_change optional[] = {
        {"{'source':0,'sampler':0}",
         "{'source':0,'sampler':0,'extensions':{'KHR_texture_basisu':{'source':1}}}"},
        {"'images':[", "'images':[{'uri':'data:image/png;base64," GLTF_CASE_PNG "'},"},
        {"'extensionsUsed':[", "'extensionsUsed':['KHR_texture_basisu',"},
        {"'},{'uri':'data:image/png;base64," GLTF_CASE_PNG, "'},{'uri':'a.ktx2"}};
    struct lw_scene *scene = gltf_case_load_and_listen(optional, 4, &gltf_case_base_data,
                                                       sizeof gltf_case_base_data, talk, sizeof talk);
    if (!strstr(talk, "the extension KHR_texture_basisu is ignored") || gltf_case_count_lines(talk) != 1)
        fail_msg("talk is \"%s\"", talk);
    const uint8_t texels[8] = {255, 0, 0, 255, 0, 128, 255, 64};
    assert_int_equal(scene->texture_count, 1);
    assert_memory_equal(scene->texture[0].rgba, texels, sizeof texels);
    lw_scene_destroy(scene);
    GLTF_CASE_REFUSE("KHR_texture_basisu (KTX2 textures), which is not supported; convert it: gltf-transform "
                     "ktxdecompress IN.glb OUT.glb",
                     gltf_case_base_data,
                     {"'scene':0", "'scene':0,'extensionsRequired':['KHR_texture_basisu']"});
}

int main(void) {
    lw_log_init("test_gltf_materials", LW_LOG_ERROR);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_texture_transform_moves_its_coordinates),
        cmocka_unit_test(images_are_decoded_once),
        cmocka_unit_test(unreadable_pictures_have_a_stand_in),
        cmocka_unit_test(pictures_of_extensions_are_read),
        cmocka_unit_test(emission_is_strength_times_texture),
        cmocka_unit_test(albedo_above_one_is_lowered_and_reported_once),
        cmocka_unit_test(specular_glossiness_gives_its_diffuse_colour),
        cmocka_unit_test(transmission_lets_light_through),
        cmocka_unit_test(unlit_materials_are_their_base_colour),
        cmocka_unit_test(basisu_takes_the_fallback_or_says_what_to_run),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
