/* Gloss and relief of MTL, FBX and Collada. */
#include "tests/support/foreign_case.h"

#include "common/log.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define QUAD "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n"
#define FACE "f 1/1/1 2/2/1 3/3/1 4/4/1\n"

/* One row of texels: R, G, B. */
static void write_picture(const char *name, uint8_t count, const uint8_t rgb[][3]) {
    uint8_t tga[18 + 3 * 4] = {[2] = 2, [12] = count, [14] = 1, [16] = 24, [17] = 0x20};
    for (int i = 0; i < count; i++)
        memcpy(tga + 18 + 3 * i, (const uint8_t[]){rgb[i][2], rgb[i][1], rgb[i][0]}, 3);
    lw_foreign_case_write_bytes(name, tga, 18 + 3u * count);
}

static struct lw_scene *load(const char *name) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    if (lw_foreign_case_load(name, LW_FOREIGN_SIDES_AUTO, &scene, &err)) fail_msg("%s: %s", name, err.text);
    return scene;
}

static struct lw_scene *load_mtl(const char *lines) {
    char text[1024];
    snprintf(text, sizeof text, "newmtl t\n%s\n", lines);
    lw_foreign_case_write_text("t.mtl", text);
    lw_foreign_case_write_text("t.obj", "mtllib t.mtl\nusemtl t\n" QUAD FACE);
    return load("t.obj");
}

static const struct lw_material *material_of(const struct lw_scene *scene) {
    return &scene->material[scene->mesh[0].material[0]];
}

/* What exporters write on everything is no gloss: rooms keep their light. */
static void highlights_of_exporters_are_no_gloss(void **state) {
    (void)state;
    static const char *const matt[] = {
        "Kd 0.8 0.8 0.8",
        "Kd 0.8 0.8 0.8\nKa 1 1 1\nKs 0.5 0.5 0.5\nNs 250\nNi 1.45\nillum 2", /* Blender */
        "Kd 0.8 0.8 0.8\nKs 1 1 1\nNs 1000\nillum 3",
        "Kd 0.8 0.8 0.8\nPr 0\nPm 0\nPs 0\nPc 0\nPcr 0\naniso 0\nanisor 0", /* tinyobjloader */
        "Kd 0.8 0.8 0.8\nPr 1\nPm 0",
        "Kd 0.8 0.8 0.8\nPm 0",
        "Kd 0 0 0\nKs 0.5 0.5 0.5\nNs 250", /* black rubber */
    };
    for (size_t i = 0; i < sizeof matt / sizeof *matt; i++) {
        struct lw_scene *scene = load_mtl(matt[i]);
        if (material_of(scene)->finish || scene->mesh[0].tangent || *lw_foreign_case_talk())
            fail_msg("%s: %s", matt[i], lw_foreign_case_talk());
        lw_scene_destroy(scene);
    }
}

static void roughness_and_metalness_are_read(void **state) {
    (void)state;
    static const struct {
        const char *lines;
        float metalness, roughness, base;
    } cases[] = {
        {"Kd 0.8 0.8 0.8\nPr 0.25", 0, 0.25f, 0.8f},
        {"Kd 0.8 0.8 0.8\nPr 0.25\nPm 1", 1, 0.25f, 0.8f},
        {"Kd 0.8 0.8 0.8\nPm 1", 1, 1, 0.8f},
        {"Kd 0.8 0.8 0.8\nPm 1\nPr 0", 1, 0, 0.8f},
        {"Kd 0 0 0\nKs 1 1 1\nPr 0.5", 0, 0.5f, 0},             /* it says what it is: no rule for mirrors */
        {"Kd 0 0 0\nKs 0.75 0.75 0.75\nNs 30", 1, 0.5f, 0.75f}, /* (2 / 32)^(1/4) */
        {"Kd 0 0 0\nKs 0.75 0.75 0.75", 1, 0, 0.75f},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct lw_scene *scene = load_mtl(cases[i].lines);
        const struct lw_finish *f = material_of(scene)->finish;
        if (!f || f->metalness != cases[i].metalness || fabsf(f->roughness - cases[i].roughness) > 1e-6f ||
            f->specular != 1 || material_of(scene)->base_colour[1] != cases[i].base)
            fail_msg("%s: %g %g", cases[i].lines, f ? (double)f->metalness : -1,
                     f ? (double)f->roughness : -1);
        lw_scene_destroy(scene);
    }
}

static void maps_of_gloss_become_one(void **state) {
    (void)state;
    write_picture("rough.tga", 4, (const uint8_t[][3]){{10, 1, 1}, {20, 1, 1}, {30, 1, 1}, {40, 1, 1}});
    write_picture("metal.tga", 2, (const uint8_t[][3]){{100, 2, 2}, {200, 2, 2}});
    write_picture("both.tga", 1, (const uint8_t[][3]){{1, 60, 70}});
    struct lw_scene *scene = load_mtl("map_Pr rough.tga\nmap_Pm metal.tga");
    const struct lw_finish *f = material_of(scene)->finish;
    assert_int_equal(scene->finish_texture_count, 1);
    assert_int_equal(scene->finish_texture[0].width, 4);
    assert_memory_equal(scene->finish_texture[0].rgba + 12, ((const uint8_t[]){255, 40, 200, 255}), 4);
    assert_float_equal(f->roughness, 1, 0);
    assert_float_equal(f->metalness, 1, 0);
    lw_scene_destroy(scene);
    scene = load_mtl("Pm 0.5\nPr 0\nmap_Pr both.tga\nmap_Pm both.tga"); /* as glTF has it in one picture */
    assert_memory_equal(scene->finish_texture[0].rgba, ((const uint8_t[]){255, 60, 70, 255}), 4);
    assert_float_equal(material_of(scene)->finish->metalness, 0.5, 0);
    assert_float_equal(material_of(scene)->finish->roughness, 1, 0); /* 0 hides no map */
    lw_scene_destroy(scene);
    scene = load_mtl("map_Pr -imfchan b -mm 0.5 0.5 -s 2 2 both.tga");
    assert_int_equal(scene->finish_texture[0].rgba[1], 163); /* 127.5 + 35 */
    assert_float_equal(material_of(scene)->finish->surface_texture.transform[0], 2, 0);
    assert_float_equal(material_of(scene)->finish->metalness, 0, 0);
    lw_scene_destroy(scene);
    scene = load_mtl("map_Pr lost.tga\nPm 1");
    assert_null(material_of(scene)->finish);
    lw_scene_destroy(scene);
}

static void relief_is_of_heights_or_normals(void **state) {
    (void)state;
    write_picture("heights.tga", 4,
                  (const uint8_t[][3]){{0, 0, 0}, {80, 80, 80}, {160, 160, 160}, {240, 240, 240}});
    write_picture("normals.tga", 2, (const uint8_t[][3]){{128, 128, 255}, {160, 128, 250}});
    static const struct {
        const char *lines;
        float scale;
        bool normals;
    } cases[] = {
        {"bump heights.tga", 1, false},
        {"map_Bump -bm 0.25 heights.tga", 0.25f, false},
        {"bump -bm 2 -mm 0 0.5 heights.tga", 1, false},
        {"map_Bump -bm 0.5 normals.tga", 0.5f, true}, /* as Blender writes normal maps */
        {"norm normals.tga", 1, true},
        {"norm -bm 3 heights.tga", 3, true},
        {"bump heights.tga\nnorm normals.tga", 1, true},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct lw_scene *scene = load_mtl(cases[i].lines);
        const struct lw_finish *f = material_of(scene)->finish;
        if (!f || f->normal_scale != cases[i].scale || f->specular != 0) fail_msg("%s", cases[i].lines);
        const struct lw_texture *texture = &scene->finish_texture[f->normal_texture.texture];
        assert_int_equal(texture->content, LW_CONTENT_NORMAL);
        assert_int_equal(scene->finish_texture_count, 1);
        if (!cases[i].normals)
            assert_true(texture->rgba[4] < 127); /* it rises to the right: the normal leans left */
        if (cases[i].normals && texture->width == 2) assert_int_equal(texture->rgba[4], 160);
        assert_non_null(scene->mesh[0].tangent);
        lw_scene_destroy(scene);
    }
    struct lw_scene *scene = load_mtl("bump -bm 0 heights.tga");
    assert_null(material_of(scene)->finish);
    lw_scene_destroy(scene);
    scene = load_mtl("norm lost.tga");
    assert_null(material_of(scene)->finish);
    assert_null(scene->mesh[0].tangent);
    lw_scene_destroy(scene);
}

/* A normal map that is the colour too, as a broken exporter writes: neither spoils the other. */
static void one_picture_may_be_several_things(void **state) {
    (void)state;
    write_picture("normals.tga", 2, (const uint8_t[][3]){{128, 128, 128}, {90, 90, 90}});
    struct lw_scene *scene = load_mtl("norm normals.tga\nmap_Kd normals.tga\nmap_Pr normals.tga");
    assert_int_equal(scene->texture[0].rgba[4], 90);
    assert_int_equal(scene->texture[0].rgba[6], 90);
    assert_int_equal(scene->finish_texture_count, 2);
    if (!strstr(lw_foreign_case_talk(), "normal maps have texels of no length"))
        fail_msg("%s", lw_foreign_case_talk());
    lw_scene_destroy(scene);
}

int main(void) {
    lw_log_init("test_foreign_finish", LW_LOG_WARNING);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(highlights_of_exporters_are_no_gloss),
        cmocka_unit_test(roughness_and_metalness_are_read),
        cmocka_unit_test(maps_of_gloss_become_one),
        cmocka_unit_test(relief_is_of_heights_or_normals),
        cmocka_unit_test(one_picture_may_be_several_things),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
