/* What glTF materials say of gloss and relief, by scenes that are made here: one square, one
 * material, pictures of a few texels. */
#include "tests/support/glb.h"
#include "tests/support/support.h"

#include "common/base/log.h"
#include "common/shading/tangent.h"
#include "server/import/gltf/gltf.h"

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define PICTURES   4
#define TEXELS_MAX 4

/* A TGA of 32 bits, one row. */
struct picture {
    uint8_t header[18], bgra[TEXELS_MAX][4], pad[2];
};

struct data {
    float position[4][3], normal[4][3], uv[4][2], tangent[4][4];
    uint16_t index[6], pad[2];
    struct picture picture[PICTURES];
};

static const struct data base = {
    .position = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}},
    .normal = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}, {0, 0, 1}},
    .uv = {{0, 1}, {1, 1}, {0, 0}, {1, 0}},
    .tangent = {{0, 1, 0, -1}, {0, 1, 0, -1}, {0, 1, 0, -1}, {0, 1, 0, -1}},
    .index = {0, 1, 2, 2, 1, 3},
};

static void draw(struct picture *picture, uint8_t count, const uint8_t rgba[][4]) {
    *picture = (struct picture){.header = {[2] = 2, [12] = count, [14] = 1, [16] = 32, [17] = 0x28}};
    for (int i = 0; i < count; i++)
        memcpy(picture->bgra[i], (const uint8_t[]){rgba[i][2], rgba[i][1], rgba[i][0], rgba[i][3]}, 4);
}

/* Pictures: 0 has two texels with alpha, 1 four opaque ones, 2 normals, 3 is no picture. */
static struct data data_of(void) {
    struct data data = base;
    draw(&data.picture[0], 2, (const uint8_t[][4]){{200, 100, 50, 255}, {20, 40, 60, 51}});
    draw(&data.picture[1], 4,
         (const uint8_t[][4]){{255, 128, 0, 255}, {0, 64, 255, 255}, {10, 20, 30, 255}, {1, 2, 3, 255}});
    draw(&data.picture[2], 2, (const uint8_t[][4]){{128, 128, 255, 255}, {218, 128, 218, 255}});
    return data;
}

static struct lw_gltf_options options;

static enum lw_status load(const struct data *data, const char *attributes, const char *material,
                           struct lw_scene **out, struct lw_error *err) {
    char json[8192], views[1024] = "";
    for (size_t i = 0; i < PICTURES; i++)
        snprintf(views + strlen(views), sizeof views - strlen(views),
                 ",{'buffer':0,'byteOffset':%zu,'byteLength':%zu}",
                 offsetof(struct data, picture) + i * sizeof(struct picture), sizeof(struct picture));
    snprintf(
        json, sizeof json,
        "{'asset':{'version':'2.0'},'scene':0,'scenes':[{'nodes':[0]}],'nodes':[{'mesh':0}],"
        "'meshes':[{'primitives':[{'attributes':{'POSITION':0,'NORMAL':1%s},'indices':4,'material':0}]}],"
        "'materials':[{'name':'paint',%s}],"
        "'textures':[{'source':0},{'source':1},{'source':2},{'source':3},{'source':1,'sampler':0}],"
        "'samplers':[{'wrapS':33071}],"
        "'images':[{'bufferView':5,'mimeType':'image/x-tga'},{'bufferView':6,'mimeType':'image/x-tga'},"
        "{'bufferView':7,'mimeType':'image/x-tga'},{'bufferView':8,'mimeType':'image/x-tga'}],"
        "'accessors':[{'bufferView':0,'componentType':5126,'count':4,'type':'VEC3'},"
        "{'bufferView':1,'componentType':5126,'count':4,'type':'VEC3'},"
        "{'bufferView':2,'componentType':5126,'count':4,'type':'VEC2'},"
        "{'bufferView':3,'componentType':5126,'count':4,'type':'VEC4'},"
        "{'bufferView':4,'componentType':5123,'count':6,'type':'SCALAR'}],"
        "'bufferViews':[{'buffer':0,'byteLength':48},{'buffer':0,'byteOffset':48,'byteLength':48},"
        "{'buffer':0,'byteOffset':96,'byteLength':32},{'buffer':0,'byteOffset':128,'byteLength':64},"
        "{'buffer':0,'byteOffset':192,'byteLength':12}%s],"
        "'buffers':[{'byteLength':%zu}]}",
        attributes, material, views, sizeof *data);
    size_t size;
    uint8_t *glb = lw_glb_pack(json, data, sizeof *data, &size);
    enum lw_status status = lw_gltf_load_bytes(glb, size, "base.glb", &options, out, err);
    free(glb);
    return status;
}

#define UV                                                                                                   \
    ","                                                                                                      \
    "'TEXCOORD_0':2"

static char talk[8192];

/* The scene must load; what it tells is in `talk`. */
static struct lw_scene *scene_of(const struct data *data, const char *attributes, const char *material) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    fflush(stderr);
    int saved = dup(STDERR_FILENO),
        file = open(lw_support_temporary("talk"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    assert_true(saved >= 0 && file >= 0 && dup2(file, STDERR_FILENO) >= 0);
    enum lw_status status = load(data, attributes, material, &scene, &err);
    fflush(stderr);
    dup2(saved, STDERR_FILENO);
    ssize_t length = pread(file, talk, sizeof talk - 1, 0);
    talk[length > 0 ? length : 0] = 0;
    close(saved);
    close(file);
    lw_support_ok(status, &err);
    return scene;
}

static struct lw_scene *scene_of_material(const char *material) {
    const struct data data = data_of();
    return scene_of(&data, UV, material);
}

static void assert_warned_once(const char *what) {
    const char *end = strchr(talk, '\n');
    if (!strstr(talk, what) || !end || end[1]) fail_msg("\"%s\" is not the one line of: %s", what, talk);
}

static void matt_materials_have_no_finish(void **state) {
    (void)state;
    static const struct {
        const char *material;
        bool silent; /* it says nothing of gloss, which a line reports */
    } cases[] = {
        {"'pbrMetallicRoughness':{'baseColorFactor':[0.5,0.5,0.5,1]}", true},
        {"'doubleSided':true", true},
        {"'pbrMetallicRoughness':{'metallicFactor':0}", false}, /* roughness is 1 unless said */
        {"'pbrMetallicRoughness':{'metallicFactor':0,'roughnessFactor':1}", false},
        {"'pbrMetallicRoughness':{'metallicFactor':0,'roughnessFactor':0.2},"
         "'extensions':{'KHR_materials_specular':{'specularFactor':0}}",
         false},
        {"'extensions':{'KHR_materials_pbrSpecularGlossiness':{'specularFactor':[0,0,0]}}", false},
        {"'extensions':{'KHR_materials_pbrSpecularGlossiness':{'diffuseFactor':[1,0,0,1]}}", true},
        {"'pbrMetallicRoughness':{'metallicFactor':1,'roughnessFactor':0.2},'extensions':{'KHR_materials_"
         "unlit':{}}",
         false},
        {"'pbrMetallicRoughness':{'metallicFactor':0},'normalTexture':{'index':2,'scale':0},"
         "'occlusionTexture':{'index':1}",
         false},
    };
    lw_log_init("test", LW_LOG_INFO);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct lw_scene *scene = scene_of_material(cases[i].material);
        if (scene->material[0].finish || scene->finish_texture_count) fail_msg("%s", cases[i].material);
        if (cases[i].silent)
            assert_warned_once("materials that say nothing of metal or roughness are matt");
        else if (*talk)
            fail_msg("%s: %s", cases[i].material, talk);
        lw_scene_destroy(scene);
    }
    lw_log_init("test", LW_LOG_WARNING);
}

static void factors_become_those_of_the_finish(void **state) {
    (void)state;
    static const struct {
        const char *material;
        float metalness, roughness, specular, colour, ior;
    } cases[] = {
        {"'pbrMetallicRoughness':{'roughnessFactor':0.5}", 1, 0.5f, 1, 1, 1.5f},
        {"'pbrMetallicRoughness':{'metallicFactor':0.25,'roughnessFactor':0}", 0.25f, 0, 1, 1, 1.5f},
        {"'pbrMetallicRoughness':{'metallicFactor':0,'roughnessFactor':0.5},"
         "'extensions':{'KHR_materials_specular':{'specularFactor':0.5,'specularColorFactor':[2,2,2]},"
         "'KHR_materials_ior':{'ior':1.33}}",
         0, 0.5f, 0.5f, 2, 1.33f},
        {"'pbrMetallicRoughness':{'metallicFactor':0},'extensions':{'KHR_materials_ior':{'ior':1.8}}", 0, 1,
         1, 1, 1.8f},
        {"'pbrMetallicRoughness':{'metallicFactor':0},'extensions':{'KHR_materials_ior':{'ior':0}}", 0, 1, 1,
         1, 1e6f},
        {"'extensions':{'KHR_materials_pbrSpecularGlossiness':{'diffuseFactor':[0.5,0.5,0.5,1],"
         "'specularFactor':[0.2,0.2,0.2],'glossinessFactor':0.75}}",
         0, 0.25f, 1, 5, 1.5f},
        {"'extensions':{'KHR_materials_pbrSpecularGlossiness':{'glossinessFactor':1}}", 0, 0, 1, 25, 1.5f},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct lw_scene *scene = scene_of_material(cases[i].material);
        const struct lw_finish *f = scene->material[0].finish;
        if (!f || f->metalness != cases[i].metalness || f->roughness != cases[i].roughness ||
            f->specular != cases[i].specular || fabsf(f->specular_colour[1] - cases[i].colour) > 1e-5f ||
            f->ior != cases[i].ior || *talk)
            fail_msg("%s: %s", cases[i].material, talk);
        lw_scene_destroy(scene);
    }
}

/* What the finish says must be what the file said: f0 and roughness at a point. */
static void specular_glossiness_is_exact(void **state) {
    (void)state;
    struct lw_scene *scene = scene_of_material(
        "'extensions':{'KHR_materials_pbrSpecularGlossiness':{'diffuseFactor':[0.5,0.25,0,1],"
        "'specularFactor':[1,0.5,1],'glossinessFactor':0.5,'specularGlossinessTexture':{'index':0}}}");
    const struct lw_material *material = &scene->material[0];
    assert_int_equal(scene->finish_texture_count, 2);
    assert_int_equal(scene->texture_count, 0);
    assert_float_equal(material->base_colour[0], 0.5, 0);
    struct lw_surface surface;
    struct lw_finish_point point;
    lw_scene_surface(scene, &scene->mesh[0], 0, 0.25f, 0,
                     &surface); /* u 0.25: the middle of the first texel */
    lw_scene_finish(scene, &scene->mesh[0], 0, 0.25f, 0, &surface, &point);
    const float red = powf((200 / 255.0f + 0.055f) / 1.055f, 2.4f),
                green = powf((100 / 255.0f + 0.055f) / 1.055f, 2.4f);
    assert_float_equal(point.lobes.f0.x, red, 1e-4);
    assert_float_equal(point.lobes.f0.y, 0.5f * green, 1e-4);
    assert_float_equal(point.lobes.f90, 1, 0);
    assert_float_equal(point.lobes.roughness, 0.5, 0.002); /* 1 - 0.5 x 1 */
    assert_float_equal(point.lobes.diffuse.y, 0.25, 1e-6);
    lw_scene_surface(scene, &scene->mesh[0], 0, 0.75f, 0, &surface);
    lw_scene_finish(scene, &scene->mesh[0], 0, 0.75f, 0, &surface, &point);
    assert_float_equal(point.lobes.roughness, 0.9, 0.002); /* 1 - 0.5 x 0.2 */
    lw_scene_destroy(scene);
}

static void one_picture_of_two_things_is_one_memory(void **state) {
    (void)state;
    struct lw_scene *scene = scene_of_material("'pbrMetallicRoughness':{'baseColorTexture':{'index':1},"
                                               "'metallicRoughnessTexture':{'index':1}},"
                                               "'occlusionTexture':{'index':1,'strength':0.5}");
    /* occlusion is not read: light is traced */
    const struct lw_finish *f = scene->material[0].finish;
    assert_int_equal(scene->finish_texture_count, 1);
    assert_int_equal(f->occlusion_texture.texture, LW_SCENE_NONE);
    assert_float_equal(f->occlusion, 0, 0);
    /* and its memory is that of the base colour */
    assert_ptr_equal(scene->finish_texture[0].rgba, scene->texture[0].rgba);
    assert_int_equal(scene->finish_texture[0].content, LW_CONTENT_SURFACE);
    lw_scene_destroy(scene);
    /* alpha is no part of a surface, but of a colour */
    scene = scene_of_material("'pbrMetallicRoughness':{'baseColorTexture':{'index':0},"
                              "'metallicRoughnessTexture':{'index':0}},'occlusionTexture':{'index':4}");
    assert_int_equal(scene->finish_texture_count, 1);
    assert_int_equal(scene->texture[0].rgba[7], 51);
    assert_int_equal(scene->finish_texture[0].rgba[7], 255);
    assert_int_equal(scene->finish_texture[0].rgba[5], 40);
    lw_scene_destroy(scene);
}

static void specular_textures_become_one(void **state) {
    (void)state;
#define SPECULAR(fields)                                                                                     \
    "'pbrMetallicRoughness':{'metallicFactor':0,'roughnessFactor':0.5},"                                     \
    "'extensions':{'KHR_materials_specular':{" fields "}}"
    /* the larger one of two sizes */
    struct lw_scene *scene =
        scene_of_material(SPECULAR("'specularTexture':{'index':0},'specularColorTexture':{'index':1}"));
    assert_int_equal(scene->finish_texture_count, 1);
    assert_int_equal(scene->finish_texture[0].width, 4);
    assert_int_equal(scene->finish_texture[0].rgba[4 * 3 + 0], 1);
    assert_int_equal(scene->finish_texture[0].rgba[4 * 1 + 3], 255);
    assert_int_equal(scene->finish_texture[0].rgba[4 * 3 + 3], 51);
    lw_scene_destroy(scene);
    /* a strength alone has no colour; a colour alone is all there */
    scene = scene_of_material(SPECULAR("'specularTexture':{'index':0}"));
    assert_int_equal(scene->finish_texture[0].rgba[4], 255);
    assert_int_equal(scene->finish_texture[0].rgba[7], 51);
    lw_scene_destroy(scene);
    scene = scene_of_material(SPECULAR("'specularColorTexture':{'index':0}"));
    assert_int_equal(scene->finish_texture[0].rgba[4], 20);
    assert_int_equal(scene->finish_texture[0].rgba[7], 255);
    lw_scene_destroy(scene);
    scene = scene_of_material(SPECULAR("'specularTexture':{'index':0},'specularColorTexture':{'index':0}"));
    assert_int_equal(scene->finish_texture[0].rgba[4], 20);
    assert_int_equal(scene->finish_texture[0].rgba[7], 51);
    lw_scene_destroy(scene);
    scene = scene_of_material(
        SPECULAR("'specularTexture':{'index':0},'specularColorTexture':{'index':1,'extensions':{"
                 "'KHR_texture_transform':{'scale':[2,2]}}}"));
    assert_warned_once("a specular texture lies otherwise than the specular colour");
    assert_float_equal(scene->material[0].finish->specular_texture.transform[0], 2, 0);
    lw_scene_destroy(scene);
}

static void normal_maps_keep_their_place_and_scale(void **state) {
    (void)state;
    const struct data data = data_of();
    struct lw_scene *scene =
        scene_of(&data, UV ",'TEXCOORD_1':2",
                 "'normalTexture':{'index':2,'scale':-0.5,'texCoord':0,'extensions':{"
                 "'KHR_texture_transform':{'scale':[0.5,0.5],'offset':[0.25,0],'texCoord':1}}}");
    const struct lw_finish *f = scene->material[0].finish;
    assert_float_equal(f->normal_scale, -0.5, 0);
    assert_int_equal(f->normal_texture.uv_set, 1);
    assert_float_equal(f->normal_texture.transform[2], 0.25, 0);
    assert_float_equal(f->specular, 0, 0); /* it says nothing of gloss: matt below its relief */
    assert_float_equal(f->metalness, 0, 0);
    assert_int_equal(scene->finish_texture[0].content, LW_CONTENT_NORMAL);
    assert_non_null(scene->mesh[0].tangent);
    lw_scene_destroy(scene);
}

static void tangents_of_the_file_count(void **state) {
    (void)state;
    struct data data = data_of();
    static const char normal_map[] = "'normalTexture':{'index':2}";
    struct lw_scene *scene = scene_of(&data, UV ",'TANGENT':3", normal_map);
    for (int c = 0; c < 6; c++) {
        const struct lw_vec4 t = lw_tangent_decode(scene->mesh[0].tangent[c], lw_vec3(0, 0, 1));
        assert_float_equal(t.y, 1, 1e-3);
        assert_float_equal(t.w, -1, 0);
    }
    lw_scene_destroy(scene);
    data.tangent[0][0] = NAN;
    data.tangent[1][3] = 0;
    scene = scene_of(&data, UV ",'TANGENT':3", normal_map);
    assert_warned_once("2 vertices have a TANGENT that is none: computed ones stand in");
    assert_float_equal(lw_tangent_decode(scene->mesh[0].tangent[0], lw_vec3(0, 0, 1)).x, 1, 1e-3);
    lw_scene_destroy(scene);
    /* without a normal map nobody reads them */
    scene = scene_of(&data, UV ",'TANGENT':3", "'pbrMetallicRoughness':{'roughnessFactor':0.5}");
    assert_null(scene->mesh[0].tangent);
    assert_string_equal(talk, "");
    lw_scene_destroy(scene);
    /* without coordinates there are none */
    scene = scene_of(&data, "", normal_map);
    assert_null(scene->mesh[0].tangent);
    assert_warned_once("no texture coordinates");
    lw_scene_destroy(scene);
    struct lw_error err = {0};
    lw_support_fails(load(&data, UV ",'TANGENT':2", normal_map, &scene, &err), LW_BAD_DATA, &err,
                     "TANGENT: accessor 2");
}

/* One clear line each, and something sensible. */
static void bad_values_are_reported_and_mended(void **state) {
    (void)state;
#define PBR(fields) "'pbrMetallicRoughness':{" fields "}"
    static const struct {
        const char *material, *warning;
        float metalness, roughness, ior;
    } cases[] = {
        {PBR("'metallicFactor':-1,'roughnessFactor':0.5"), "\"paint: metallicFactor -1\"", 0, 0.5f, 1.5f},
        {PBR("'metallicFactor':1,'roughnessFactor':7"), "\"paint: roughnessFactor 7\"", 1, 1, 1.5f},
        {PBR("'metallicFactor':0,'roughnessFactor':0.5") ",'extensions':{'KHR_materials_ior':{'ior':0.5}}",
         "\"paint: ior 0.5\"", 0, 0.5f, 2},
        {PBR("'metallicFactor':0,'roughnessFactor':0.5") ",'extensions':{'KHR_materials_ior':{'ior':-3}}",
         "\"paint: ior -3\"", 0, 0.5f, 1.5f},
        /* a metal without its picture would be rough and everywhere: matt */
        {PBR("'metallicRoughnessTexture':{'index':3}") ",'normalTexture':{'index':2}", "images[3]", 0, 1,
         1.5f},
        {PBR("'metallicFactor':0,'roughnessFactor':0.5") ",'normalTexture':{'index':3}", "images[3]", 0, 0.5f,
         1.5f},
        {PBR("'metallicFactor':0,'roughnessFactor':0.5") ",'normalTexture':{'index':2,'texCoord':3}",
         "TEXCOORD_2 or higher", 0, 0.5f, 1.5f},
        /* a base colour that is no normal map: black has no direction */
        {PBR("'metallicFactor':0,'roughnessFactor':0.5") ",'normalTexture':{'index':1}",
         "normal maps have texels of no length", 0, 0.5f, 1.5f},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct lw_scene *scene = scene_of_material(cases[i].material);
        const struct lw_finish *f = scene->material[0].finish;
        assert_warned_once(cases[i].warning);
        if (!f || f->metalness != cases[i].metalness || f->roughness != cases[i].roughness ||
            f->ior != cases[i].ior)
            fail_msg("%s", cases[i].material);
        lw_scene_destroy(scene);
    }
    struct lw_scene *scene;
    struct lw_error err = {0};
    const struct data data = data_of();
    lw_support_fails(load(&data, UV, PBR("'metallicFactor':'much'"), &scene, &err), LW_BAD_DATA, &err,
                     "materials[0]: pbrMetallicRoughness: metallicFactor");
    err = (struct lw_error){0};
    lw_support_fails(load(&data, UV, "'normalTexture':{'index':77}", &scene, &err), LW_BAD_DATA, &err,
                     "materials[0]: normalTexture: index");
}

/* A black mirror, a metal of roughness 0, all at once: the reflected light is a number, and no more than
 * arrives. */
static void no_finish_makes_energy(void **state) {
    (void)state;
    static const char *const materials[] = {
        PBR("'baseColorFactor':[0,0,0,1],'metallicFactor':1,'roughnessFactor':0"),
        PBR("'baseColorFactor':[1,1,1,1],'metallicFactor':0.5,'roughnessFactor':0,'metallicRoughnessTexture':"
            "{"
            "'index':1}") ",'normalTexture':{'index':1,'scale':1e11},'extensions':{'KHR_materials_specular':{"
                          "'specularColorFactor':[1e11,0,1]},'KHR_materials_ior':{'ior':1e30}}",
        "'extensions':{'KHR_materials_pbrSpecularGlossiness':{'diffuseFactor':[1,1,1,1],'specularFactor':[1,"
        "1,1],"
        "'specularGlossinessTexture':{'index':0}}},'occlusionTexture':{'index':0}",
    };
    for (size_t i = 0; i < sizeof materials / sizeof *materials; i++) {
        struct lw_scene *scene = scene_of_material(materials[i]);
        for (int step = 0; step < 50; step++) {
            struct lw_surface surface;
            struct lw_finish_point point;
            const float u = (float)step / 50;
            lw_scene_surface(scene, &scene->mesh[0], 0, u, 0, &surface);
            lw_scene_finish(scene, &scene->mesh[0], 0, u, 0, &surface, &point);
            const struct lw_vec3 albedo = lw_lobes_albedo(&point.lobes);
            assert_true(lw_vec3_is_finite(albedo) && lw_vec3_max_abs(albedo) <= 1);
            assert_true(lw_vec3_is_finite(point.lobes.f0) && lw_vec3_max_abs(point.lobes.f0) <= 1);
            assert_true(point.occlusion >= 0 && point.occlusion <= 1);
            if (!point.bumpy) continue;
            const struct lw_vec3 n = lw_scene_bump(
                &point, surface.normal, lw_vec3(point.tangent.x, point.tangent.y, point.tangent.z));
            assert_float_equal(lw_vec3_length(n), 1, 1e-4);
        }
        lw_scene_destroy(scene);
    }
}

static void matt_drops_all(void **state) {
    (void)state;
    options.matt = true;
    struct lw_scene *scene =
        scene_of_material(PBR("'metallicRoughnessTexture':{'index':3}") ",'normalTexture':{'index':2}");
    assert_null(scene->material[0].finish);
    assert_int_equal(scene->finish_texture_count, 0);
    assert_string_equal(talk, ""); /* the picture was not looked for */
    lw_scene_destroy(scene);
    options.matt = false;
    scene = scene_of_material(PBR("'metallicRoughnessTexture':{'index':1}") ",'normalTexture':{'index':2}");
    lw_scene_drop_finishes(scene);
    assert_null(scene->material[0].finish);
    assert_null(scene->mesh[0].tangent);
    struct lw_error err = {0};
    lw_support_ok(lw_scene_validate(scene, &err), &err);
    lw_scene_destroy(scene);
}

/* Pictures of finishes count, those that are made of others too. */
static void pictures_are_bounded(void **state) {
    (void)state;
    options.picture_texels = 3;
    struct lw_scene *scene =
        scene_of_material(PBR("'metallicRoughnessTexture':{'index':0}") ",'normalTexture':{'index':2}");
    assert_warned_once("--picture-texels allows more");
    assert_int_equal(scene->finish_texture_count, 1);
    lw_scene_destroy(scene);
    scene = scene_of_material("'extensions':{'KHR_materials_pbrSpecularGlossiness':{"
                              "'specularGlossinessTexture':{'index':0}}}");
    assert_warned_once("gloss is left out where its picture is one too many");
    assert_null(scene->material[0].finish);
    lw_scene_destroy(scene);
    options.picture_texels = 0;
}

int main(void) {
    lw_log_init("test", LW_LOG_WARNING);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(matt_materials_have_no_finish),
        cmocka_unit_test(factors_become_those_of_the_finish),
        cmocka_unit_test(specular_glossiness_is_exact),
        cmocka_unit_test(one_picture_of_two_things_is_one_memory),
        cmocka_unit_test(specular_textures_become_one),
        cmocka_unit_test(normal_maps_keep_their_place_and_scale),
        cmocka_unit_test(tangents_of_the_file_count),
        cmocka_unit_test(bad_values_are_reported_and_mended),
        cmocka_unit_test(no_finish_makes_energy),
        cmocka_unit_test(matt_drops_all),
        cmocka_unit_test(pictures_are_bounded),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
