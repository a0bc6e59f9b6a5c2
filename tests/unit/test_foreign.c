/* OBJ, PLY, FBX, Collada and STL through Assimp, against files written here: one known value per rule of
 * docs/importing_other.md, and files that are broken in one place each. */
#include "tests/support/foreign_case.h"

#include "common/base/log.h"
#include "common/base/sanitizer.h"
#include "common/image/image.h"
#include "common/scene/pose.h"
#include "server/import/guard.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

/* 2 x 2: above red and green, below blue and white */
static void write_picture(const char *name) {
    static const uint8_t rgb[12] = {255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255};
    struct lw_error err = {0};
    lw_support_ok(lw_image_write_png(lw_support_temporary(name), rgb, 2, 2, &err), &err);
}

static struct lw_scene *load(const char *name) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_foreign_case_load(name, LW_FOREIGN_SIDES_AUTO, &scene, &err), &err);
    return scene;
}

static struct lw_scene *load_text(const char *name, const char *text) {
    lw_foreign_case_write_text(name, text);
    return load(name);
}

static void refuse(const char *name, const char *reason) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    enum lw_status status = lw_foreign_case_load(name, LW_FOREIGN_SIDES_AUTO, &scene, &err);
    if (status != LW_BAD_DATA || !strstr(err.text, reason))
        fail_msg("%s: \"%s\", not \"%s\"", name, status ? err.text : "it loads", reason);
    assert_null(scene);
    assert_non_null(strstr(err.text, name)); /* the file is named */
}

static void refuse_text(const char *name, const char *text, const char *reason) {
    lw_foreign_case_write_text(name, text);
    refuse(name, reason);
}

static const struct lw_material *material_named(const struct lw_scene *scene, const char *name) {
    for (uint32_t i = 0; i < scene->material_count; i++)
        if (strcmp(scene->material[i].name, name) == 0) return &scene->material[i];
    fail_msg("no material %s", name);
    return NULL;
}

static uint32_t triangles_of(const struct lw_scene *scene) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < scene->object_count; i++)
        count += scene->mesh[scene->object[i].mesh].triangle_count;
    return count;
}

static void assert_vec3(struct lw_vec3 v, float x, float y, float z) {
    if (fabsf(v.x - x) > 1e-4f || fabsf(v.y - y) > 1e-4f || fabsf(v.z - z) > 1e-4f)
        fail_msg("(%g, %g, %g), not (%g, %g, %g)", (double)v.x, (double)v.y, (double)v.z, (double)x,
                 (double)y, (double)z);
}

/* Albedo where the x-y plane of object space is at (x, y), which has texture coordinates (x, y) in these
 * files. */
static struct lw_vec3 albedo_at(const struct lw_scene *scene, const struct lw_mesh *mesh, float x, float y) {
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        struct lw_vec3 a = mesh->position[mesh->triangle[t][0]], b = mesh->position[mesh->triangle[t][1]],
                       c = mesh->position[mesh->triangle[t][2]];
        float area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        float u = ((x - a.x) * (c.y - a.y) - (y - a.y) * (c.x - a.x)) / area,
              v = ((b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x)) / area;
        if (u < 0 || v < 0 || u + v > 1) continue;
        struct lw_surface surface;
        lw_scene_surface(scene, mesh, t, u, v, &surface);
        return surface.albedo;
    }
    fail_msg("nothing at (%g, %g)", (double)x, (double)y);
    return lw_vec3(0, 0, 0);
}

/* ---- OBJ ---- */

#define SQUARE "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
#define FACE   "f 1/1 2/2 3/3 4/4\n"

static void textures_stand_upright(void **state) {
    (void)state;
    write_picture("pic.png");
    lw_foreign_case_write_text("one.mtl", "newmtl paint\nKd 1 1 1\nmap_Kd pic.png\n");
    struct lw_scene *scene = load_text("one.obj", "mtllib one.mtl\n" SQUARE "usemtl paint\n" FACE);
    assert_string_equal(lw_foreign_case_talk(), "");
    assert_int_equal(triangles_of(scene), 2);
    assert_int_equal(scene->mesh[0].vertex_count, 4); /* shared again */
    const struct lw_mesh *mesh = &scene->mesh[0];
    assert_vec3(albedo_at(scene, mesh, 0.25f, 0.75f), 1, 0, 0);
    assert_vec3(albedo_at(scene, mesh, 0.75f, 0.75f), 0, 1, 0);
    assert_vec3(albedo_at(scene, mesh, 0.25f, 0.25f), 0, 0, 1);
    assert_vec3(albedo_at(scene, mesh, 0.75f, 0.25f), 1, 1, 1);
    lw_scene_destroy(scene);
}

static void obj_materials_follow_their_rules(void **state) {
    (void)state;
    write_picture("pic.png");
    lw_foreign_case_write_text("rules.mtl", "newmtl paint\nKd 0.1 0.2 0.3\nKs 1 1 1\n"
                                            "newmtl mirror\nKd 0 0 0\nKs 0.9 0.8 0.7\n"
                                            "newmtl rubber\nKd 0 0 0\nKs 0.5 0.5 0.5\n"
                                            "newmtl tube\nKd 0 0 0\nKs 0.9 0.9 0.9\nKe 5 5 5\n"
                                            "newmtl lamp\nKd 0.5 0.5 0.5\nKe 17 12 4\n"
                                            "newmtl glass\nKd 1 1 1\nd 0.25\n"
                                            "newmtl turned\nKd 1 1 1\nTr 0.25\n"
                                            "newmtl gone\nKd 1 1 1\nd 0\n"
                                            "newmtl bright\nKd 3 0.5 1.5\n"
                                            "newmtl half\nKd 0.5 0.5 0.5\nmap_Kd pic.png\n"
                                            "newmtl black\nKd 0 0 0\nmap_Kd pic.png\n"
                                            "newmtl leaf\nKd 1 1 1\nmap_d pic.png\n"
                                            "newmtl glow\nKd 0 0 0\nmap_Ke pic.png\n");
    static const char *const names[] = {"paint", "rubber", "tube", "mirror", "lamp", "glass", "turned",
                                        "gone",  "bright", "half", "black",  "leaf", "glow"};
    char text[4096] = "mtllib rules.mtl\n" SQUARE;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        sprintf(text + strlen(text), "o %s\nusemtl %s\n" FACE, names[i], names[i]);
    struct lw_scene *scene = load_text("rules.obj", text);

    const float *c = material_named(scene, "paint")->base_colour;
    assert_float_equal(c[0], 0.1, 1e-6); /* a highlight is no albedo */
    assert_float_equal(c[2], 0.3, 1e-6);
    c = material_named(scene, "mirror")->base_colour;
    assert_float_equal(c[0], 0.9, 1e-6); /* where nothing is diffuse, the mirror's colour is */
    assert_float_equal(c[2], 0.7, 1e-6);
    assert_float_equal(material_named(scene, "rubber")->base_colour[0], 0, 0);
    assert_float_equal(material_named(scene, "tube")->base_colour[0], 0, 0);
    const struct lw_material *lamp = material_named(scene, "lamp");
    assert_float_equal(lamp->emission[0], 17, 0);
    assert_float_equal(lamp->emission[2], 4, 0);
    assert_false(lamp->double_sided);                          /* what emits has one side */
    assert_true(material_named(scene, "paint")->double_sided); /* a sheet */
    const struct lw_material *glass = material_named(scene, "glass");
    assert_int_equal(glass->alpha_mode, LW_ALPHA_BLEND);
    assert_float_equal(glass->base_colour[3], 0.25, 0);
    assert_float_equal(material_named(scene, "turned")->base_colour[3], 0.75, 1e-6);
    assert_int_equal(material_named(scene, "gone")->alpha_mode, LW_ALPHA_OPAQUE);
    assert_non_null(strstr(lw_foreign_case_talk(), "materials of opacity 0 are taken as opaque: \"gone\"\n"));
    c = material_named(scene, "bright")->base_colour;
    assert_float_equal(c[0], 1, 0);
    assert_float_equal(c[1], 0.5, 0);
    assert_non_null(strstr(lw_foreign_case_talk(), "diffuse colours above 1 are lowered to 1: \"bright\"\n"));
    assert_float_equal(material_named(scene, "half")->base_colour[1], 0.5, 0);
    assert_float_equal(material_named(scene, "black")->base_colour[1], 1, 0);
    const struct lw_material *leaf = material_named(scene, "leaf");
    assert_int_equal(leaf->alpha_mode, LW_ALPHA_BLEND); /* a third is no clear yes or no */
    assert_int_equal(scene->texture[leaf->base_colour_texture.texture].rgba[3], 85);
    assert_int_equal(scene->texture[leaf->base_colour_texture.texture].rgba[15], 255);
    assert_float_equal(material_named(scene, "glow")->emission[1], 1, 0);
    assert_int_not_equal(material_named(scene, "glow")->emission_texture.texture, LW_SCENE_NONE);
    lw_scene_destroy(scene);

    lw_foreign_case_write_text("wrong.mtl", "newmtl paint\nKd 0.1 -0.2 0.3\n");
    refuse_text("wrong.obj", "mtllib wrong.mtl\n" SQUARE "usemtl paint\n" FACE,
                "material \"paint\": its diffuse colour has the component -0.2");
    lw_foreign_case_write_text("wrong.mtl", "newmtl paint\nKe nan 1 1\n");
    refuse_text("wrong.obj", "mtllib wrong.mtl\n" SQUARE "usemtl paint\n" FACE,
                "material \"paint\": its emissive colour has the component nan");
}

/* An opacity map of yes and no cuts out. */
static void opacity_maps_cut_out(void **state) {
    (void)state;
    static const uint8_t rgb[6] = {255, 255, 255, 0, 0, 0};
    struct lw_error err = {0};
    lw_support_ok(lw_image_write_png(lw_support_temporary("mask.png"), rgb, 2, 1, &err), &err);
    write_picture("pic.png");
    lw_foreign_case_write_text("leaf.mtl", "newmtl leaf\nKd 1 1 1\nmap_Kd pic.png\nmap_d mask.png\n");
    struct lw_scene *scene = load_text("leaf.obj", "mtllib leaf.mtl\n" SQUARE "usemtl leaf\n" FACE);
    const struct lw_material *leaf = material_named(scene, "leaf");
    const struct lw_texture *texture = &scene->texture[leaf->base_colour_texture.texture];
    assert_int_equal(leaf->alpha_mode, LW_ALPHA_MASK);
    const uint8_t expected[16] = {255, 0, 0, 255, 0, 255, 0, 0, 0, 0, 255, 255, 255, 255, 255, 0};
    assert_int_equal(texture->width, 2);
    assert_int_equal(texture->height, 2);
    assert_memory_equal(texture->rgba, expected, sizeof expected);
    lw_scene_destroy(scene);
}

#define CUBE                                                                                                 \
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"                               \
    "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 2 3 7 6\n"
#define LAST_FACE "f 4 1 5 8\n"

static void closed_surfaces_have_one_side(void **state) {
    (void)state;
    struct lw_scene *scene = load_text("cube.obj", CUBE LAST_FACE);
    assert_int_equal(triangles_of(scene), 12);
    assert_false(scene->material[scene->mesh[0].material[0]].double_sided);
    assert_float_equal(scene->material[0].base_colour[0], 0.6, 1e-6); /* nothing is said */
    lw_scene_destroy(scene);
    scene = load_text("open.obj", CUBE);
    assert_true(scene->material[scene->mesh[0].material[0]].double_sided);
    lw_scene_destroy(scene);
    /* one face turned over opens it too; two pieces are judged each by itself */
    scene = load_text("turned.obj", CUBE "f 8 5 1 4\n");
    assert_true(scene->material[scene->mesh[0].material[0]].double_sided);
    lw_scene_destroy(scene);
    scene = load_text("both.obj", CUBE LAST_FACE "v 5 0 0\nv 6 0 0\nv 6 1 0\nf 9 10 11\n");
    assert_int_equal(scene->mesh_count, 1);
    assert_false(scene->material[scene->mesh[0].material[0]].double_sided);
    assert_true(scene->material[scene->mesh[0].material[12]].double_sided);
    lw_scene_destroy(scene);
    struct lw_error err = {0};
    lw_support_ok(lw_foreign_case_load("open.obj", LW_FOREIGN_SIDES_ONE, &scene, &err), &err);
    assert_false(scene->material[0].double_sided);
    lw_scene_destroy(scene);
    lw_support_ok(lw_foreign_case_load("cube.obj", LW_FOREIGN_SIDES_TWO, &scene, &err), &err);
    assert_true(scene->material[0].double_sided);
    lw_scene_destroy(scene);
}

static void normals_are_the_files_or_flat_or_smooth_where_it_asks(void **state) {
    (void)state;
    /* a roof of 90 degrees between its sides, and one of 20 degrees */
    static const char steep[] = "v 0 0 -1\nv 0 0 1\nv -1 -1 0\nv 1 -1 0\n", fold[] = "f 1 3 2\nf 1 2 4\n";
    char text[512];
    struct lw_scene *scene;
    snprintf(text, sizeof text, "%s%s", steep, fold);
    scene = load_text("flat.obj", text);
    assert_int_equal(scene->mesh[0].vertex_count, 6);
    lw_scene_destroy(scene);
    snprintf(text, sizeof text, "%ss 1\n%s", steep, fold);
    scene = load_text("crease.obj", text); /* sharper than 60 degrees stays sharp */
    assert_int_equal(scene->mesh[0].vertex_count, 6);
    lw_scene_destroy(scene);
    snprintf(text, sizeof text, "v 0 0 -1\nv 0 0 1\nv -1 -0.17 0\nv 1 -0.17 0\ns 1\n%s", fold);
    scene = load_text("smooth.obj", text);
    assert_int_equal(scene->mesh[0].vertex_count, 4);
    uint32_t ridge = scene->mesh[0].triangle[0][0];
    assert_vec3(scene->mesh[0].normal[ridge], 0, 1, 0);
    lw_scene_destroy(scene);
    snprintf(text, sizeof text, "v 0 0 -1\nv 0 0 1\nv -1 -0.17 0\nv 1 -0.17 0\ns off\n%s", fold);
    scene = load_text("off.obj", text);
    assert_int_equal(scene->mesh[0].vertex_count, 6);
    lw_scene_destroy(scene);
    /* normals of the file, made unit; they decide the front, whatever the winding */
    scene = load_text("given.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 -4\nf 1//1 2//1 3//1\n");
    const struct lw_mesh *mesh = &scene->mesh[0];
    assert_vec3(mesh->normal[0], 0, 0, -1);
    struct lw_surface surface;
    lw_scene_surface(scene, mesh, 0, 0.2f, 0.2f, &surface);
    assert_vec3(surface.geometric_normal, 0, 0, -1);
    assert_non_null(strstr(lw_foreign_case_talk(), "1 triangles are wound against their normals"));
    lw_scene_destroy(scene);
}

/* Paths of other machines, other letters, other folders. */
static void textures_are_found_by_name(void **state) {
    (void)state;
    lw_foreign_case_make_folder("textures");
    lw_foreign_case_make_folder("deep");
    lw_foreign_case_make_folder("deep/er");
    lw_foreign_case_make_folder("found.fbm");
    write_picture("textures/wood 1.png");
    write_picture("deep/er/Tile.PNG");
    write_picture("found.fbm/embedded.png");
    write_picture("50%25 grey.png");
    write_picture("w\xE4nde.png"); /* Latin-1 */
    static const char *const paths[] = {
        "textures/wood 1.png",        "wood 1.png",
        "C:\\work\\maps\\wood 1.png", "/home/me/wood 1.png",
        "../../elsewhere/wood 1.png", "textures\\WOOD 1.PNG",
        "deep/er/tile.png",           "DEEP\\er\\tile.png",
        "D:\\x\\deep\\er\\Tile.PNG",  "embedded.png",
        "file:///z/wood%201.png",     "50%25 grey.png",
        "50%2525 grey.png",           "w\xE4nde.png",
    };
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
        char text[256];
        snprintf(text, sizeof text, "newmtl paint\nKd 1 1 1\nmap_Kd %s\n", paths[i]);
        lw_foreign_case_write_text("found.mtl", text);
        struct lw_scene *scene = load_text("found.obj", "mtllib found.mtl\n" SQUARE "usemtl paint\n" FACE);
        if (scene->texture_count != 1) fail_msg("%s: not found: %s", paths[i], lw_foreign_case_talk());
        lw_scene_destroy(scene);
    }
    /* no file outside the folder is ever read */
    write_picture("outside.png");
    lw_foreign_case_make_folder("inside");
    lw_foreign_case_write_text("inside/one.mtl", "newmtl paint\nKd 1 1 1\nmap_Kd ../outside.png\n");
    struct lw_scene *scene = load_text("inside/one.obj", "mtllib one.mtl\n" SQUARE "usemtl paint\n" FACE);
    assert_int_equal(scene->texture_count, 0);
    assert_non_null(strstr(lw_foreign_case_talk(), "texture \"../outside.png\": is not there"));
    lw_scene_destroy(scene);
}

static void unreadable_textures_have_a_stand_in(void **state) {
    (void)state;
    lw_foreign_case_write_text("old.dds", "DDS |and so on, for more bytes than a header has");
    lw_foreign_case_write_text("cut.png", "\x89PNG\r\n\x1a\n");
    static const struct {
        const char *name, *reason;
    } cases[] = {{"none.png", "texture \"none.png\": is not there"},
                 {"old.dds", "texture \"old.dds\": is not PNG, JPEG, WebP, AVIF, TGA or BMP"},
                 {"cut.png", "texture \"cut.png\": cannot be decoded"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[256];
        snprintf(text, sizeof text, "newmtl paint\nKd 0.8 0.8 0.8\nKe 0 0 0\nmap_Kd %s\nmap_Ke %s\n",
                 cases[i].name, cases[i].name);
        lw_foreign_case_write_text("lost.mtl", text);
        struct lw_scene *scene = load_text("lost.obj", "mtllib lost.mtl\n" SQUARE "usemtl paint\n" FACE);
        if (!strstr(lw_foreign_case_talk(), cases[i].reason))
            fail_msg("\"%s\" lacks \"%s\"", lw_foreign_case_talk(), cases[i].reason);
        assert_int_equal(strchr(lw_foreign_case_talk(), '\n')[1], 0); /* one line */
        assert_float_equal(scene->material[0].base_colour[0], 0.4, 1e-6);
        assert_float_equal(scene->material[0].emission[0], 0, 0);
        lw_scene_destroy(scene);
    }
    struct lw_scene *scene = load_text("nolib.obj", "mtllib lost and gone.mtl\n" SQUARE FACE);
    assert_non_null(
        strstr(lw_foreign_case_talk(), "the material library \"lost and gone.mtl\" is not there"));
    lw_scene_destroy(scene);
    /* a library of the scene's own name serves, as viewers have it */
    lw_foreign_case_write_text("own.mtl", "newmtl paint\nKd 0.25 0.25 0.25\n");
    scene = load_text("own.obj", "mtllib lost.and.gone.mtl\n" SQUARE "usemtl paint\n" FACE);
    assert_string_equal(lw_foreign_case_talk(), "");
    assert_float_equal(scene->material[0].base_colour[0], 0.25, 0);
    lw_scene_destroy(scene);
}

/* ---- PLY, STL ---- */

#define PLY_HEAD                                                                                             \
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
#define PLY_FACES "element face 1\nproperty list uchar int vertex_indices\nend_header\n"

static void ply_colours_are_those_of_a_screen(void **state) {
    (void)state;
    struct lw_scene *scene =
        load_text("scan.ply", PLY_HEAD
                  "property uchar red\nproperty uchar green\nproperty uchar blue\n" PLY_FACES
                  "0 0 0 255 0 0\n1 0 0 128 128 128\n1 1 0 128 128 128\n0 1 0 128 128 128\n4 0 1 2 3\n");
    const struct lw_mesh *mesh = &scene->mesh[0];
    assert_int_equal(mesh->triangle_count, 2);
    assert_non_null(mesh->colour);
    assert_float_equal(scene->material[mesh->material[0]].base_colour[0], 1, 0);
    for (uint32_t i = 0; i < mesh->vertex_count; i++)
        if (mesh->position[i].x > 0)
            assert_float_equal(mesh->colour[i].y, 0.2158605, 1e-5); /* IEC 61966-2-1 */
    lw_scene_destroy(scene);
    /* an OBJ can have them too; without a material they are all the colour there is */
    scene = load_text("scan.obj", "v 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 1 1 0 1 1 1\nf 1 2 3\n");
    assert_non_null(scene->mesh[0].colour);
    assert_float_equal(scene->material[scene->mesh[0].material[0]].base_colour[0], 1, 0);
    lw_scene_destroy(scene);
    refuse_text("out.ply", PLY_HEAD PLY_FACES "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 4\n", "uses vertex 4");
    refuse_text("nan.ply", PLY_HEAD PLY_FACES "0 0 0\n1 nan 0\n1 1 0\n0 1 0\n4 0 1 2 3\n",
                "is not a finite number");
    refuse_text("nothing.ply", PLY_HEAD PLY_FACES "0 0 0\n1 0 0\n1 1 0\n0 1 0\n0\n",
                "face 0 has no vertices");
    refuse_text("none.ply", PLY_HEAD PLY_FACES "0 0 0\n0 0 0\n0 0 0\n0 0 0\n4 0 1 2 3\n", "no triangles");
}

static void stl_has_triangles_alone(void **state) {
    (void)state;
    struct lw_scene *scene = load_text(
        "one.stl", "solid one\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 2 0 0\nvertex 0 2 0\n"
                   "endloop\nendfacet\nendsolid one\n");
    assert_int_equal(triangles_of(scene), 1);
    assert_float_equal(scene->mesh[0].position[1].x, 2, 0);
    lw_scene_destroy(scene);
    uint8_t binary[84 + 50] = {[80] = 1};
    const float facet[12] = {0, 0, 1, 0, 0, 0, 3, 0, 0, 0, 3, 0};
    memcpy(binary + 84, facet, sizeof facet);
    lw_foreign_case_write_bytes("two.stl", binary, sizeof binary);
    scene = load("two.stl");
    assert_int_equal(triangles_of(scene), 1);
    lw_scene_destroy(scene);
    binary[80] = 2;
    lw_foreign_case_write_bytes("short.stl", binary, sizeof binary);
    refuse("short.stl", "has the name of a STL file but does not begin like one");
}

/* ---- Collada ---- */

/* In centimetres, +Z up: a textured square that rises, one twice as large of half opacity, a lamp of each
 * kind. */
static const char dae[] =
    "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n"
    "<COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" version=\"1.4.1\">\n"
    "<asset><unit name=\"centimeter\" meter=\"0.01\"/><up_axis>Z_UP</up_axis></asset>\n"
    "<library_cameras><camera id=\"cam\" "
    "name=\"cam\"><optics><technique_common><perspective><xfov>90</xfov><aspect_ratio>2</"
    "aspect_ratio><znear>1</znear><zfar>100</zfar></perspective></technique_common></optics></camera></"
    "library_cameras>\n"
    "<library_lights>\n"
    "<light id=\"pt\" name=\"pt\"><technique_common><point><color>4 2 "
    "1</color><quadratic_attenuation>0.0002</quadratic_attenuation></point></technique_common></light>\n"
    "<light id=\"sun\" name=\"sun\"><technique_common><directional><color>3 3 "
    "3</color></directional></technique_common></light>\n"
    "<light id=\"spot\" name=\"spot\"><technique_common><spot><color>5 5 "
    "5</color><falloff_angle>60</falloff_angle><falloff_exponent>1</falloff_exponent></spot></"
    "technique_common></light>\n"
    "<light id=\"amb\" name=\"amb\"><technique_common><ambient><color>1 1 "
    "1</color></ambient></technique_common></light>\n"
    "</library_lights>\n"
    "<library_images><image id=\"img\" "
    "name=\"img\"><init_from>some%20dir/PIC.png</init_from></image></library_images>\n"
    "<library_effects>\n"
    "<effect id=\"fx\"><profile_COMMON>\n"
    "<newparam sid=\"surf\"><surface type=\"2D\"><init_from>img</init_from></surface></newparam>\n"
    "<newparam sid=\"samp\"><sampler2D><source>surf</source></sampler2D></newparam>\n"
    "<technique sid=\"common\"><lambert><emission><color>0 0 7 1</color></emission><diffuse><texture "
    "texture=\"samp\" texcoord=\"UV\"/></diffuse></lambert></technique></profile_COMMON>\n"
    "<extra><technique profile=\"GOOGLEEARTH\"><double_sided>1</double_sided></technique></extra></effect>\n"
    "<effect id=\"fx2\"><profile_COMMON><technique sid=\"common\"><phong><diffuse><color>0.25 0.5 0.75 "
    "1</color></diffuse><transparent opaque=\"A_ONE\"><color>0 0 0 "
    "0.5</color></transparent><transparency><float>1</float></transparency></phong></technique></"
    "profile_COMMON></effect>\n"
    "</library_effects>\n"
    "<library_materials><material id=\"m\" name=\"m\"><instance_effect url=\"#fx\"/></material><material "
    "id=\"m2\" name=\"glass\"><instance_effect url=\"#fx2\"/></material></library_materials>\n"
    "<library_geometries><geometry id=\"g\" name=\"quad\"><mesh>\n"
    "<source id=\"p\"><float_array id=\"pa\" count=\"12\">0 0 0 100 0 0 100 100 0 0 100 "
    "0</float_array><technique_common><accessor source=\"#pa\" count=\"4\" stride=\"3\"><param name=\"X\" "
    "type=\"float\"/><param name=\"Y\" type=\"float\"/><param name=\"Z\" "
    "type=\"float\"/></accessor></technique_common></source>\n"
    "<source id=\"uv\"><float_array id=\"uva\" count=\"8\">0 0 1 0 1 1 0 "
    "1</float_array><technique_common><accessor source=\"#uva\" count=\"4\" stride=\"2\"><param name=\"S\" "
    "type=\"float\"/><param name=\"T\" type=\"float\"/></accessor></technique_common></source>\n"
    "<vertices id=\"v\"><input semantic=\"POSITION\" source=\"#p\"/></vertices>\n"
    "<polylist material=\"ms\" count=\"1\"><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/><input "
    "semantic=\"TEXCOORD\" source=\"#uv\" offset=\"1\" set=\"0\"/><vcount>4</vcount><p>0 0 1 1 2 2 3 "
    "3</p></polylist>\n"
    "</mesh></geometry></library_geometries>\n"
    "<library_animations><animation id=\"an\"><source id=\"t\"><float_array id=\"ta\" count=\"2\">0.5 "
    "2</float_array><technique_common><accessor source=\"#ta\" count=\"2\" stride=\"1\"><param name=\"TIME\" "
    "type=\"float\"/></accessor></technique_common></source>\n"
    "<source id=\"o\"><float_array id=\"oa\" count=\"6\">0 0 0 0 0 "
    "200</float_array><technique_common><accessor source=\"#oa\" count=\"2\" stride=\"3\"><param name=\"X\" "
    "type=\"float\"/><param name=\"Y\" type=\"float\"/><param name=\"Z\" "
    "type=\"float\"/></accessor></technique_common></source>\n"
    "<source id=\"ip\"><Name_array id=\"ipa\" count=\"2\">LINEAR "
    "LINEAR</Name_array><technique_common><accessor source=\"#ipa\" count=\"2\" stride=\"1\"><param "
    "name=\"INTERPOLATION\" type=\"name\"/></accessor></technique_common></source>\n"
    "<sampler id=\"s\"><input semantic=\"INPUT\" source=\"#t\"/><input semantic=\"OUTPUT\" "
    "source=\"#o\"/><input semantic=\"INTERPOLATION\" source=\"#ip\"/></sampler><channel source=\"#s\" "
    "target=\"mover/tr\"/></animation></library_animations>\n"
    "<library_visual_scenes><visual_scene id=\"vs\" name=\"vs\">\n"
    "<node id=\"mover\" name=\"mover\"><translate sid=\"tr\">0 0 0</translate><instance_geometry "
    "url=\"#g\"><bind_material><technique_common><instance_material symbol=\"ms\" "
    "target=\"#m\"><bind_vertex_input semantic=\"UV\" input_semantic=\"TEXCOORD\" "
    "input_set=\"0\"/></instance_material></technique_common></bind_material></instance_geometry></node>\n"
    "<node id=\"still\" name=\"still\"><translate>0 0 100</translate><scale>2 2 2</scale><instance_geometry "
    "url=\"#g\"><bind_material><technique_common><instance_material symbol=\"ms\" "
    "target=\"#m2\"/></technique_common></bind_material></instance_geometry></node>\n"
    "<node id=\"lp\" name=\"lp\"><translate>0 0 300</translate><instance_light url=\"#pt\"/></node>\n"
    "<node id=\"ls\" name=\"ls\"><instance_light url=\"#sun\"/></node>\n"
    "<node id=\"lsp\" name=\"lsp\"><translate>100 0 300</translate><instance_light "
    "url=\"#spot\"/><instance_light url=\"#amb\"/></node>\n"
    "<node id=\"cn\" name=\"cn\"><translate>0 -500 100</translate><rotate>1 0 0 90</rotate><instance_camera "
    "url=\"#cam\"/></node>\n"
    "</visual_scene></library_visual_scenes><scene><instance_visual_scene url=\"#vs\"/></scene></COLLADA>\n";

static struct lw_vec3 point_of_object(const struct lw_pose *pose, const struct lw_scene *scene,
                                      const char *object, struct lw_vec3 p) {
    for (uint32_t i = 0; i < scene->object_count; i++)
        if (strcmp(scene->object[i].name, object) == 0) return lw_affine_point(&pose->object_to_world[i], p);
    fail_msg("no object %s", object);
    return p;
}

static const struct lw_light *light_named(const struct lw_scene *scene, const char *name) {
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (strcmp(scene->light[i].name, name) == 0) return &scene->light[i];
    fail_msg("no light %s", name);
    return NULL;
}

static void collada_arrives_in_metres_and_upright(void **state) {
    (void)state;
    lw_foreign_case_make_folder("some dir");
    write_picture("some dir/pic.png");
    struct lw_scene *scene = load_text("t.dae", dae);
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_non_null(strstr(lw_foreign_case_talk(), "ambient lights are ignored"));
    assert_int_equal(scene->object_count, 2);
    assert_int_equal(triangles_of(scene), 4);
    /* a square of 1 m that lies flat: file (x, y, z) cm is (x, z, -y) / 100 m */
    assert_vec3(point_of_object(&pose, scene, "mover", lw_vec3(100, 100, 0)), 1, 0, -1);
    assert_vec3(point_of_object(&pose, scene, "still", lw_vec3(100, 100, 0)), 2, 1, -2);

    /* the same geometry with two materials */
    const struct lw_material *glass = material_named(scene, "glass"), *paint = material_named(scene, "m");
    assert_float_equal(glass->base_colour[0], 0.25, 0);
    assert_float_equal(glass->base_colour[3], 0.5, 1e-6);
    assert_int_equal(glass->alpha_mode, LW_ALPHA_BLEND);
    assert_float_equal(paint->base_colour[0], 1, 0);
    assert_float_equal(paint->emission[2], 7, 0);
    assert_int_equal(paint->alpha_mode, LW_ALPHA_OPAQUE);
    assert_int_not_equal(paint->base_colour_texture.texture, LW_SCENE_NONE);

    /* 4 / (0.0002 d^2) with d in cm is 2 / d^2 with d in m */
    const struct lw_light *point = light_named(scene, "lp"), *sun = light_named(scene, "ls"),
                          *spot = light_named(scene, "lsp");
    assert_int_equal(scene->light_count, 3);
    assert_int_equal(point->kind, LW_LIGHT_POINT);
    assert_float_equal(point->intensity[0], 2, 1e-4);
    assert_float_equal(point->intensity[2], 0.5, 1e-4);
    assert_vec3(pose.light[point - scene->light].position_ws, 0, 3, 0);
    assert_int_equal(sun->kind, LW_LIGHT_DIRECTIONAL);
    assert_float_equal(sun->intensity[1], 3, 0);
    assert_vec3(pose.light[sun - scene->light].direction_ws, 0, -1, 0);
    assert_int_equal(spot->kind, LW_LIGHT_SPOT);
    assert_float_equal(spot->outer_cone, LW_PI / 6, 1e-5); /* half of 60 degrees */
    assert_float_equal(spot->intensity[0], 5, 0);

    assert_int_equal(scene->camera_count, 1);
    assert_float_equal(scene->camera[0].fov_y, 2 * atanf(0.5f),
                       1e-5); /* 90 degrees wide, twice as wide as high */
    const struct lw_affine *eye = &pose.node_to_world[scene->camera[0].node];
    assert_vec3(lw_affine_point(eye, lw_vec3(0, 0, 0)), 0, 1, 5);
    assert_vec3(lw_vec3_normalize(lw_affine_vector(eye, lw_vec3(0, 0, -1))), 0, 0, -1);
    assert_vec3(lw_vec3_normalize(lw_affine_vector(eye, lw_vec3(0, 1, 0))), 0, 1, 0);

    /* rises by 2 m from 0.5 to 2 s; what stands still has no channel */
    assert_int_equal(scene->channel_count, 1);
    assert_float_equal(scene->duration_s, 2, 1e-6);
    lw_pose_evaluate(&pose, scene, 1.25);
    assert_vec3(point_of_object(&pose, scene, "mover", lw_vec3(100, 100, 0)), 1, 1, -1);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

/* ---- FBX ---- */

/* In metres, +Z up, +X right, -Y towards the viewer: a square with a texture inside the file that moves along
 * x, a spot, a camera. */
static const char fbx[] = "; FBX 7.4.0 project file\n"
                          "FBXHeaderExtension:  {\n"
                          " FBXHeaderVersion: 1003\n"
                          " FBXVersion: 7400\n"
                          " Creator: \"by hand\"\n"
                          "}\n"
                          "GlobalSettings:  {\n"
                          " Version: 1000\n"
                          " Properties70:  {\n"
                          "  P: \"UpAxis\", \"int\", \"Integer\", \"\",2\n"
                          "  P: \"UpAxisSign\", \"int\", \"Integer\", \"\",1\n"
                          "  P: \"FrontAxis\", \"int\", \"Integer\", \"\",1\n"
                          "  P: \"FrontAxisSign\", \"int\", \"Integer\", \"\",-1\n"
                          "  P: \"CoordAxis\", \"int\", \"Integer\", \"\",0\n"
                          "  P: \"CoordAxisSign\", \"int\", \"Integer\", \"\",1\n"
                          "  P: \"UnitScaleFactor\", \"double\", \"Number\", \"\",100\n"
                          " }\n"
                          "}\n"
                          "Objects:  {\n"
                          " Geometry: 10, \"Geometry::\", \"Mesh\" {\n"
                          "  Vertices: *12 {\n"
                          "   a: 0,0,0,1,0,0,1,1,0,0,1,0\n"
                          "  }\n"
                          "  PolygonVertexIndex: *4 {\n"
                          "   a: 0,1,2,-4\n"
                          "  }\n"
                          "  LayerElementUV: 0 {\n"
                          "   Version: 101\n"
                          "   Name: \"map1\"\n"
                          "   MappingInformationType: \"ByPolygonVertex\"\n"
                          "   ReferenceInformationType: \"IndexToDirect\"\n"
                          "   UV: *8 {\n"
                          "    a: 0,0,1,0,1,1,0,1\n"
                          "   }\n"
                          "   UVIndex: *4 {\n"
                          "    a: 0,1,2,3\n"
                          "   }\n"
                          "  }\n"
                          "  LayerElementMaterial: 0 {\n"
                          "   Version: 101\n"
                          "   Name: \"\"\n"
                          "   MappingInformationType: \"AllSame\"\n"
                          "   ReferenceInformationType: \"IndexToDirect\"\n"
                          "   Materials: *1 {\n"
                          "    a: 0\n"
                          "   }\n"
                          "  }\n"
                          "  Layer: 0 {\n"
                          "   Version: 100\n"
                          "   LayerElement:  {\n"
                          "    Type: \"LayerElementUV\"\n"
                          "    TypedIndex: 0\n"
                          "   }\n"
                          "   LayerElement:  {\n"
                          "    Type: \"LayerElementMaterial\"\n"
                          "    TypedIndex: 0\n"
                          "   }\n"
                          "  }\n"
                          " }\n"
                          " Model: 20, \"Model::quad\", \"Mesh\" {\n"
                          "  Version: 232\n"
                          "  Properties70:  {\n"
                          "   P: \"Lcl Translation\", \"Lcl Translation\", \"\", \"A\",3,0,0\n"
                          "  }\n"
                          " }\n"
                          " NodeAttribute: 30, \"NodeAttribute::lamp\", \"Light\" {\n"
                          "  Properties70:  {\n"
                          "   P: \"LightType\", \"enum\", \"\", \"\",2\n"
                          "   P: \"Color\", \"Color\", \"\", \"A\",1,0.5,0.25\n"
                          "   P: \"Intensity\", \"Number\", \"\", \"A\",800\n"
                          "   P: \"InnerAngle\", \"Number\", \"\", \"A\",30\n"
                          "   P: \"OuterAngle\", \"Number\", \"\", \"A\",60\n"
                          "   P: \"DecayType\", \"enum\", \"\", \"\",2\n"
                          "  }\n"
                          "  TypeFlags: \"Light\"\n"
                          " }\n"
                          " Model: 31, \"Model::lamp\", \"Light\" {\n"
                          "  Version: 232\n"
                          "  Properties70:  {\n"
                          "   P: \"Lcl Translation\", \"Lcl Translation\", \"\", \"A\",0,0,4\n"
                          "  }\n"
                          " }\n"
                          " NodeAttribute: 40, \"NodeAttribute::eye\", \"Camera\" {\n"
                          "  Properties70:  {\n"
                          "   P: \"AspectWidth\", \"double\", \"Number\", \"\",200\n"
                          "   P: \"AspectHeight\", \"double\", \"Number\", \"\",100\n"
                          "   P: \"FieldOfView\", \"FieldOfView\", \"\", \"A\",90\n"
                          "  }\n"
                          "  TypeFlags: \"Camera\"\n"
                          " }\n"
                          " Model: 41, \"Model::eye\", \"Camera\" {\n"
                          "  Version: 232\n"
                          "  Properties70:  {\n"
                          "   P: \"Lcl Translation\", \"Lcl Translation\", \"\", \"A\",0,-5,1\n"
                          "   P: \"Lcl Rotation\", \"Lcl Rotation\", \"\", \"A\",0,0,90\n"
                          "  }\n"
                          " }\n"
                          " Material: 50, \"Material::paint\", \"\" {\n"
                          "  Version: 102\n"
                          "  ShadingModel: \"phong\"\n"
                          "  Properties70:  {\n"
                          "   P: \"DiffuseColor\", \"Color\", \"\", \"A\",0.8,0.8,0.8\n"
                          "   P: \"EmissiveColor\", \"Color\", \"\", \"A\",1,0.5,0\n"
                          "   P: \"EmissiveFactor\", \"Number\", \"\", \"A\",6\n"
                          "  }\n"
                          " }\n"
                          " Video: 60, \"Video::pic\", \"Clip\" {\n"
                          "  Type: \"Clip\"\n"
                          "  RelativeFilename: \"textures\\pic.png\"\n"
                          "  Filename: \"C:\\work\\textures\\pic.png\"\n"
                          "  Content: ,\n"
                          "   "
                          "\"iVBORw0KGgoAAAANSUhEUgAAAAIAAAABCAYAAAD0In+"
                          "KAAAAEUlEQVR4nGP4z8Dwn6HhvwMAELoDvkeWIKAAAAAASUVORK5CYII=\"\n"
                          " }\n"
                          " Texture: 61, \"Texture::pic\", \"\" {\n"
                          "  Type: \"TextureVideoClip\"\n"
                          "  Version: 202\n"
                          "  TextureName: \"Texture::pic\"\n"
                          "  Media: \"Video::pic\"\n"
                          "  FileName: \"C:\\work\\textures\\pic.png\"\n"
                          "  RelativeFilename: \"textures\\pic.png\"\n"
                          " }\n"
                          " AnimationStack: 70, \"AnimStack::Take\", \"\" {\n"
                          " }\n"
                          " AnimationLayer: 71, \"AnimLayer::Base\", \"\" {\n"
                          " }\n"
                          " AnimationCurveNode: 72, \"AnimCurveNode::T\", \"\" {\n"
                          "  Properties70:  {\n"
                          "   P: \"d|X\", \"Number\", \"\", \"A\",3\n"
                          "   P: \"d|Y\", \"Number\", \"\", \"A\",0\n"
                          "   P: \"d|Z\", \"Number\", \"\", \"A\",0\n"
                          "  }\n"
                          " }\n"
                          " AnimationCurve: 73, \"AnimCurve::\", \"\" {\n"
                          "  Default: 0\n"
                          "  KeyVer: 4008\n"
                          "  KeyTime: *2 {\n"
                          "   a: 0,92372316000\n"
                          "  }\n"
                          "  KeyValueFloat: *2 {\n"
                          "   a: 3,5\n"
                          "  }\n"
                          "  KeyAttrFlags: *1 {\n"
                          "   a: 24836\n"
                          "  }\n"
                          "  KeyAttrDataFloat: *4 {\n"
                          "   a: 0,0,0,0\n"
                          "  }\n"
                          "  KeyAttrRefCount: *1 {\n"
                          "   a: 2\n"
                          "  }\n"
                          " }\n"
                          "}\n"
                          "Connections:  {\n"
                          " C: \"OO\",20,0\n"
                          " C: \"OO\",10,20\n"
                          " C: \"OO\",50,20\n"
                          " C: \"OO\",31,0\n"
                          " C: \"OO\",30,31\n"
                          " C: \"OO\",41,0\n"
                          " C: \"OO\",40,41\n"
                          " C: \"OP\",61,50, \"DiffuseColor\"\n"
                          " C: \"OO\",60,61\n"
                          " C: \"OO\",71,70\n"
                          " C: \"OO\",72,71\n"
                          " C: \"OP\",72,20, \"Lcl Translation\"\n"
                          " C: \"OP\",73,72, \"d|X\"\n"
                          "}\n";

/* A copy of `text` with another file name for every picture, and without the bytes of one that it holds. */
static char *with_picture(const char *text, const char *old, const char *new) {
    char *out = malloc(strlen(text) * 2), *at = out;
    for (const char *from = text; *from;) {
        const char *next = strstr(from, old);
        if (!next) next = from + strlen(from);
        at += sprintf(at, "%.*s%s", (int)(next - from), from, *next ? new : "");
        from = next + (*next ? strlen(old) : 0);
    }
    char *content = strstr(out, "  Content: ,"); /* else the picture within counts */
    if (content) {
        const char *end = strstr(content, "\n }");
        memmove(content, end + 1, strlen(end + 1) + 1);
    }
    return out;
}

/* The same four texels in either format, by each format of scenes. */
static void tga_and_bmp_are_read_by_every_format(void **state) {
    (void)state;
    static const uint8_t tga[] = {0, 0,  2,    0, 0, 0,   0, 0,   0, 0,   0, 0, 2,   0,   2,
                                  0, 24, 0x20, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 255};
    static const uint8_t bmp[] = {'B', 'M', 70, 0,   0,   0,   0, 0, 0, 0, 54,  0, 0,   0, 40, 0, 0,  0,
                                  2,   0,   0,  0,   2,   0,   0, 0, 1, 0, 24,  0, 0,   0, 0,  0, 16, 0,
                                  0,   0,   0,  0,   0,   0,   0, 0, 0, 0, 0,   0, 0,   0, 0,  0, 0,  0,
                                  255, 0,   0,  255, 255, 255, 0, 0, 0, 0, 255, 0, 255, 0, 0,  0};
    static const uint8_t rgba[16] = {255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 255, 255, 255, 255};
    const char *const names[] = {"four.tga", "four.bmp"};
    lw_support_write_file(lw_support_temporary(names[0]), tga, sizeof tga);
    lw_support_write_file(lw_support_temporary(names[1]), bmp, sizeof bmp);
    for (int i = 0; i < 2; i++) {
        char library[64];
        snprintf(library, sizeof library, "newmtl paint\nKd 1 1 1\nmap_Kd %s\n", names[i]);
        lw_foreign_case_write_text("four.mtl", library);
        char *const texts[] = {strdup("mtllib four.mtl\n" SQUARE "usemtl paint\n" FACE),
                               with_picture(dae, "some%20dir/PIC.png", names[i]),
                               with_picture(fbx, "textures\\pic.png", names[i])};
        const char *const scenes[] = {"four.obj", "four.dae", "four.fbx"};
        for (int s = 0; s < 3; s++) {
            struct lw_scene *scene = load_text(scenes[s], texts[s]);
            if (scene->texture_count != 1)
                fail_msg("%s, %s: %s", scenes[s], names[i], lw_foreign_case_talk());
            assert_int_equal(scene->texture[0].width, 2);
            assert_memory_equal(scene->texture[0].rgba, rgba, sizeof rgba);
            lw_scene_destroy(scene);
            free(texts[s]);
        }
    }
}

static void fbx_arrives_in_metres_and_upright(void **state) {
    (void)state;
    struct lw_scene *scene = load_text("t.fbx", fbx);
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_string_equal(lw_foreign_case_talk(), "");
    assert_int_equal(scene->object_count, 1);
    assert_vec3(point_of_object(&pose, scene, "quad", lw_vec3(1, 1, 0)), 4, 0, -1);
    const struct lw_material *paint = material_named(scene, "paint");
    assert_float_equal(paint->base_colour[0], 1, 0); /* the texture takes the place of the colour */
    assert_float_equal(paint->emission[0], 6, 0);
    assert_float_equal(paint->emission[1], 3, 0);
    assert_int_equal(scene->texture_count, 1);
    assert_int_equal(scene->texture[0].width, 2);
    assert_int_equal(scene->texture[0].rgba[5], 128);

    const struct lw_light *lamp = light_named(scene, "lamp");
    assert_int_equal(lamp->kind, LW_LIGHT_SPOT);
    assert_float_equal(lamp->intensity[0], 8, 1e-5); /* 100 % is 1 */
    assert_float_equal(lamp->intensity[2], 2, 1e-5);
    assert_float_equal(lamp->inner_cone, LW_PI / 12, 1e-5);
    assert_float_equal(lamp->outer_cone, LW_PI / 6, 1e-5);
    assert_vec3(pose.light[0].position_ws, 0, 4, 0);
    assert_vec3(pose.light[0].direction_ws, 0, 0, 1); /* along the file's -Y */

    const struct lw_affine *eye = &pose.node_to_world[scene->camera[0].node];
    assert_vec3(lw_affine_point(eye, lw_vec3(0, 0, 0)), 0, 1, 5);
    assert_vec3(lw_vec3_normalize(lw_affine_vector(eye, lw_vec3(0, 0, -1))), 0, 0, -1);
    assert_float_equal(scene->camera[0].fov_y, 2 * atanf(0.5f), 1e-5);

    assert_int_equal(scene->channel_count, 1);
    assert_float_equal(scene->duration_s, 2, 1e-5);
    lw_pose_evaluate(&pose, scene, 1);
    assert_vec3(point_of_object(&pose, scene, "quad", lw_vec3(1, 1, 0)), 5, 0, -1);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

static char *replaced(const char *text, const char *old, const char *new) {
    const char *at = strstr(text, old);
    if (!at) fail_msg("no %s", old);
    char *out = malloc(strlen(text) + strlen(new) + 1);
    sprintf(out, "%.*s%s%s", (int)(at - text), text, new, at + strlen(old));
    return out;
}

/* Assimp draws a tetrahedron for each node of a file that has no mesh, unless an option forbids it. */
static void lamps_alone_are_no_triangles(void **state) {
    (void)state;
    char *text = replaced(dae, "<library_geometries>", "<!--"), *cut = text;
    text = replaced(cut, "</library_geometries>", "-->");
    free(cut);
    cut = text;
    text = replaced(cut, "<node id=\"mover\"", "<!--<node id=\"mover\"");
    free(cut);
    cut = text;
    text = replaced(cut, "<node id=\"lp\"", "--><node id=\"lp\"");
    free(cut);
    refuse_text("lamps.dae", text, "no triangles");
    free(text);
}

/* One of two keys at the same time counts, here the one that Assimp leaves; with none beside it things stand
 * there. */
static void equal_key_times_are_one_key(void **state) {
    (void)state;
    lw_foreign_case_make_folder("some dir");
    write_picture("some dir/pic.png");
    char *text = replaced(dae, ">0.5 2</float_array>", ">2 2</float_array>");
    struct lw_scene *scene = load_text("equal.dae", text);
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_int_equal(scene->channel_count, 0);
    assert_true(scene->duration_s == 0);
    const float height = point_of_object(&pose, scene, "mover", lw_vec3(100, 100, 0)).y;
    assert_true(fabsf(height) < 1e-5f || fabsf(height - 2) < 1e-5f);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
    free(text);
}

/* Where FBX says nothing, Assimp's own guesses do not count. */
static void fbx_leaves_out_what_it_means(void **state) {
    (void)state;
    char *text = replaced(fbx, " C: \"OO\",50,20\n", "");
    struct lw_scene *scene = load_text("bare.fbx", text);
    assert_float_equal(scene->material[scene->mesh[0].material[0]].base_colour[0], 0.6, 1e-6);
    lw_scene_destroy(scene);
    free(text);
    text = replaced(fbx, "   P: \"DiffuseColor\", \"Color\", \"\", \"A\",0.8,0.8,0.8\n", "");
    char *plain = replaced(text, " C: \"OP\",61,50, \"DiffuseColor\"\n", "");
    scene = load_text("plain.fbx", plain);
    assert_float_equal(material_named(scene, "paint")->base_colour[0], 0.6, 1e-6);
    lw_scene_destroy(scene);
    free(plain);
    free(text);
    text = replaced(fbx, "   P: \"FieldOfView\", \"FieldOfView\", \"\", \"A\",90\n", "");
    scene = load_text("view.fbx", text);
    assert_string_equal(lw_foreign_case_talk(), "");
    assert_float_equal(scene->camera[0].fov_y, 2 * atanf(tanf(0.5f * 25.115f * LW_PI / 180) / 2), 1e-5);
    lw_scene_destroy(scene);
    free(text);
    static const char *const kinds[] = {"0", "1"};
    for (int i = 0; i < 2; i++) {
        char line[128];
        snprintf(line, sizeof line,
                 "   P: \"CameraProjectionType\", \"enum\", \"\", \"\",%s\n   P: \"FieldOfView\"", kinds[i]);
        text = replaced(fbx, "   P: \"FieldOfView\"", line);
        scene = load_text("parallel.fbx", text);
        assert_int_equal(
            strstr(lw_foreign_case_talk(), "orthographic cameras are read as perspective ones") != NULL, i);
        lw_scene_destroy(scene);
        free(text);
    }
}

/* FBX counts in centimetres unless it says otherwise. */
static void fbx_units_are_centimetres(void **state) {
    (void)state;
    char *text = replaced(fbx, "\"UnitScaleFactor\", \"double\", \"Number\", \"\",100",
                          "\"X\", \"double\", \"Number\", \"\",1");
    struct lw_scene *scene = load_text("cm.fbx", text);
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_vec3(point_of_object(&pose, scene, "quad", lw_vec3(100, 100, 0)), 1.03f, 0, -1);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
    free(text);
}

/* ---- broken files ---- */

static void broken_files_are_refused_in_one_line(void **state) {
    (void)state;
    refuse_text("empty.obj", "", "is empty");
    refuse_text("text.obj", "nothing of use\n", "is no OBJ file that can be read");
    refuse_text("points.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\n", "no triangles");
    refuse_text("line.obj", "v 0 0 0\nv 1 0 0\nl 1 2\n", "no triangles");
    refuse_text("index.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 9\n", "out of range");
    refuse_text("nan.obj", "v 0 0 0\nv nan 0 0\nv 1 1 0\nf 1 2 3\n", "vertex 1 is not a finite number");
    refuse_text("far.obj", "v 0 0 0\nv 2e9 0 0\nv 1 1 0\nf 1 2 3\n", "vertex 1 is farther than 1e+09 m");
    lw_foreign_case_write_bytes("zeros.obj", "v 0 0 0\n\0\0\0\0", 12);
    refuse("zeros.obj", "has the name of a OBJ file but does not begin like one");
    refuse_text("not.fbx", "hello", "has the name of a FBX file but does not begin like one");
    refuse_text("not.dae", "<html></html>", "has the name of a Collada file but does not begin like one");
    refuse_text("not.3ds", "MM", "is in no format that is read: .gltf, .glb, .obj, .ply, .fbx, .dae, .stl");
    refuse_text("cut.dae", "<?xml version=\"1.0\"?><COLLADA><asset>", "is no Collada file that can be read");
    refuse_text("cut.fbx", "Kaydara FBX Binary  ", "is no FBX file that can be read");
    refuse_text("cut.ply", "ply\nformat ascii 1.0\n", "is cut short: its header has no end");
    lw_foreign_case_make_folder("folder.obj");
    refuse("folder.obj", "is not a regular file");
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_fails(lw_foreign_case_load("never.obj", LW_FOREIGN_SIDES_AUTO, &scene, &err), LW_NO_INPUT,
                     &err, "never.obj: No such file");
}

/* Headers of two hundred bytes that claim 2^31 elements. */
static void claims_do_not_cost_memory(void **state) {
    (void)state;
    if (LW_SANITIZER) skip(); /* such builds have no limit on memory */
    refuse_text("vertices.ply",
                "ply\nformat binary_little_endian 1.0\nelement vertex 2147483647\nproperty float x\n"
                "property float y\nproperty float z\nelement face 1\nproperty list uchar int "
                "vertex_indices\nend_header\n",
                "needs more memory than a file of");
    refuse_text("faces.ply",
                "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n"
                "property float y\nproperty float z\nelement face 2147483647\nproperty list uchar int "
                "vertex_indices\nend_header\n",
                "needs more memory than a file of");
}

/* What a file is counts more than its name; degenerate and doubled triangles, and names that are no UTF-8, do
 * no harm. */
static void odd_files_are_read(void **state) {
    (void)state;
    struct lw_scene *scene =
        load_text("really a ply.obj", PLY_HEAD PLY_FACES "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n");
    assert_int_equal(triangles_of(scene), 2);
    lw_scene_destroy(scene);
    scene = load_text("w\xE4nde 100%.obj",
                      "o gr\xFCn\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 7 7 7\nf 1 2 3\nf 1 2 3\nf 3 2 1\nf 1 1 2\n");
    assert_int_equal(triangles_of(scene), 3);
    assert_int_equal(scene->mesh[0].vertex_count, 6); /* flat: three a side; nobody uses the fourth */
    assert_non_null(strstr(lw_foreign_case_talk(), "1 triangles without area are left out"));
    assert_string_equal(scene->object[0].name, "gr\xC3\xBCn");
    lw_scene_destroy(scene);
    /* a millimetre and a hundred kilometres */
    scene = load_text("small.obj", "v 0 0 0\nv 0.001 0 0\nv 0.001 0.001 0\nv 0 0.001 0\nf 1 2 3 4\n");
    assert_int_equal(triangles_of(scene), 2);
    lw_scene_destroy(scene);
    scene = load_text("large.obj", "v 0 0 0\nv 1e5 0 0\nv 1e5 1e5 0\nv 0 1e5 0\nf 1 2 3 4\n");
    assert_int_equal(triangles_of(scene), 2);
    lw_scene_destroy(scene);
}

/* ---- the guard ---- */

static volatile char sink;

static int recurse(int depth);
static int (*volatile again)(int) = recurse;

static int recurse(int depth) {
    volatile char frame[1 << 16];
    frame[0] = (char)depth;
    int below = again(depth + 1);
    sink = frame[0];
    return below + 1;
}

static void do_crash(void) { raise(SIGSEGV); }
static void do_overflow(void) { (void)again(0); }
static void do_abort(void) { abort(); }
static void do_spin(void) {
    for (;;) sink++;
}
static void do_eat(void) {
    /* within the limit it would fit: the guard's is what makes it fail */
    void *memory = malloc(1ull << 30);
    if (!memory) abort();
    memset(memory, 1, 4096);
}
static void do_nothing(void) {}

/* Runs under a guard in a process of its own. Returns its exit code and what it said. */
static int run_guarded(void (*deed)(void), char *said, size_t said_size) {
    int ends[2];
    assert_int_equal(pipe(ends), 0);
    pid_t pid = fork();
    if (pid == 0) {
        const struct lw_guard_desc desc = {.scene = "court.fbx",
                                           .reader = "the reader",
                                           .failure_fd = ends[1],
                                           .processor_s = 1,
                                           .memory_bytes = 256 << 20};
        lw_guard_enter(&desc);
        deed();
        lw_guard_leave();
        _exit(0);
    }
    close(ends[1]);
    ssize_t length = read(ends[0], said, said_size - 1);
    said[length > 0 ? length : 0] = 0;
    close(ends[0]);
    int status;
    assert_int_equal(waitpid(pid, &status, 0), pid);
    assert_true(WIFEXITED(status));
    return WEXITSTATUS(status);
}

static void a_guarded_failure_is_one_line(void **state) {
    (void)state;
    if (LW_SANITIZER) skip(); /* such builds keep their own handlers */
    static const struct {
        void (*deed)(void);
        const char *said;
    } cases[] = {
        {do_crash, "court.fbx: the reader crashed on it: the file is broken, or hits a bug there"},
        {do_overflow, "court.fbx: the reader crashed on it: the file is broken, or hits a bug there"},
        {do_abort, "court.fbx: the reader gave up on it: the file is broken, or needs too much memory"},
        {do_eat, "court.fbx: the reader gave up on it: the file is broken, or needs too much memory"},
        {do_spin,
         "court.fbx: the reader took more than 1 s of processor time, so it was stopped; --read-seconds "
         "gives it more"},
    };
    char said[1024];
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_int_equal(run_guarded(cases[i].deed, said, sizeof said), 65);
        assert_string_equal(said, cases[i].said);
    }
    assert_int_equal(run_guarded(do_nothing, said, sizeof said), 0);
    assert_string_equal(said, "");
}

int main(void) {
    lw_log_init("test_foreign", LW_LOG_WARNING);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(textures_stand_upright),
        cmocka_unit_test(obj_materials_follow_their_rules),
        cmocka_unit_test(opacity_maps_cut_out),
        cmocka_unit_test(closed_surfaces_have_one_side),
        cmocka_unit_test(normals_are_the_files_or_flat_or_smooth_where_it_asks),
        cmocka_unit_test(textures_are_found_by_name),
        cmocka_unit_test(unreadable_textures_have_a_stand_in),
        cmocka_unit_test(ply_colours_are_those_of_a_screen),
        cmocka_unit_test(stl_has_triangles_alone),
        cmocka_unit_test(collada_arrives_in_metres_and_upright),
        cmocka_unit_test(tga_and_bmp_are_read_by_every_format),
        cmocka_unit_test(fbx_arrives_in_metres_and_upright),
        cmocka_unit_test(fbx_leaves_out_what_it_means),
        cmocka_unit_test(equal_key_times_are_one_key),
        cmocka_unit_test(lamps_alone_are_no_triangles),
        cmocka_unit_test(fbx_units_are_centimetres),
        cmocka_unit_test(broken_files_are_refused_in_one_line),
        cmocka_unit_test(claims_do_not_cost_memory),
        cmocka_unit_test(odd_files_are_read),
        cmocka_unit_test(a_guarded_failure_is_one_line),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
