/* OBJ, PLY and STL through Assimp, against files written here: one known value per rule of
 * docs/importing_other.md, and files that are broken in one place each. */
#include "tests/support/foreign_case.h"

#include "common/base/log.h"
#include "common/base/sanitizer.h"
#include "common/image/image.h"
#include "server/import/guard.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

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

static void textures_stand_upright(void **state) {
    (void)state;
    lw_foreign_case_write_png("pic.png");
    lw_foreign_case_write_text("one.mtl", "newmtl paint\nKd 1 1 1\nmap_Kd pic.png\n");
    struct lw_scene *scene = lw_foreign_case_scene_of("one.obj", "mtllib one.mtl\n" LW_FOREIGN_CASE_SQUARE
                                                                 "usemtl paint\n" LW_FOREIGN_CASE_FACE);
    assert_string_equal(lw_foreign_case_talk(), "");
    assert_int_equal(lw_support_triangles(scene), 2);
    assert_int_equal(scene->mesh[0].vertex_count, 4); /* shared again */
    const struct lw_mesh *mesh = &scene->mesh[0];
    lw_foreign_case_expect_vec3(albedo_at(scene, mesh, 0.25f, 0.75f), 1, 0, 0);
    lw_foreign_case_expect_vec3(albedo_at(scene, mesh, 0.75f, 0.75f), 0, 1, 0);
    lw_foreign_case_expect_vec3(albedo_at(scene, mesh, 0.25f, 0.25f), 0, 0, 1);
    lw_foreign_case_expect_vec3(albedo_at(scene, mesh, 0.75f, 0.25f), 1, 1, 1);
    lw_scene_destroy(scene);
}

static void obj_materials_follow_their_rules(void **state) {
    (void)state;
    lw_foreign_case_write_png("pic.png");
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
    char text[4096] = "mtllib rules.mtl\n" LW_FOREIGN_CASE_SQUARE;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        sprintf(text + strlen(text), "o %s\nusemtl %s\n" LW_FOREIGN_CASE_FACE, names[i], names[i]);
    struct lw_scene *scene = lw_foreign_case_scene_of("rules.obj", text);

    const float *c = lw_support_material(scene, "paint")->base_colour;
    assert_float_equal(c[0], 0.1, 1e-6); /* a highlight is no albedo */
    assert_float_equal(c[2], 0.3, 1e-6);
    c = lw_support_material(scene, "mirror")->base_colour;
    assert_float_equal(c[0], 0.9, 1e-6); /* where nothing is diffuse, the mirror's colour is */
    assert_float_equal(c[2], 0.7, 1e-6);
    assert_float_equal(lw_support_material(scene, "rubber")->base_colour[0], 0, 0);
    assert_float_equal(lw_support_material(scene, "tube")->base_colour[0], 0, 0);
    const struct lw_material *lamp = lw_support_material(scene, "lamp");
    assert_float_equal(lamp->emission[0], 17, 0);
    assert_float_equal(lamp->emission[2], 4, 0);
    assert_false(lamp->double_sided);                               /* what emits has one side */
    assert_true(lw_support_material(scene, "paint")->double_sided); /* a sheet */
    const struct lw_material *glass = lw_support_material(scene, "glass");
    assert_int_equal(glass->alpha_mode, LW_ALPHA_BLEND);
    assert_float_equal(glass->base_colour[3], 0.25, 0);
    assert_float_equal(lw_support_material(scene, "turned")->base_colour[3], 0.75, 1e-6);
    assert_int_equal(lw_support_material(scene, "gone")->alpha_mode, LW_ALPHA_OPAQUE);
    assert_non_null(strstr(lw_foreign_case_talk(), "materials of opacity 0 are taken as opaque: \"gone\"\n"));
    c = lw_support_material(scene, "bright")->base_colour;
    assert_float_equal(c[0], 1, 0);
    assert_float_equal(c[1], 0.5, 0);
    assert_non_null(strstr(lw_foreign_case_talk(), "diffuse colours above 1 are lowered to 1: \"bright\"\n"));
    assert_float_equal(lw_support_material(scene, "half")->base_colour[1], 0.5, 0);
    assert_float_equal(lw_support_material(scene, "black")->base_colour[1], 1, 0);
    const struct lw_material *leaf = lw_support_material(scene, "leaf");
    assert_int_equal(leaf->alpha_mode, LW_ALPHA_BLEND); /* a third is no clear yes or no */
    assert_int_equal(scene->texture[leaf->base_colour_texture.texture].rgba[3], 85);
    assert_int_equal(scene->texture[leaf->base_colour_texture.texture].rgba[15], 255);
    assert_float_equal(lw_support_material(scene, "glow")->emission[1], 1, 0);
    assert_int_not_equal(lw_support_material(scene, "glow")->emission_texture.texture, LW_SCENE_NONE);
    lw_scene_destroy(scene);

    lw_foreign_case_write_text("wrong.mtl", "newmtl paint\nKd 0.1 -0.2 0.3\n");
    lw_foreign_case_refuse_text(
        "wrong.obj", "mtllib wrong.mtl\n" LW_FOREIGN_CASE_SQUARE "usemtl paint\n" LW_FOREIGN_CASE_FACE,
        "material \"paint\": its diffuse colour has the component -0.2");
    lw_foreign_case_write_text("wrong.mtl", "newmtl paint\nKe nan 1 1\n");
    lw_foreign_case_refuse_text(
        "wrong.obj", "mtllib wrong.mtl\n" LW_FOREIGN_CASE_SQUARE "usemtl paint\n" LW_FOREIGN_CASE_FACE,
        "material \"paint\": its emissive colour has the component nan");
}

/* An opacity map of yes and no cuts out. */
static void opacity_maps_cut_out(void **state) {
    (void)state;
    static const uint8_t rgb[6] = {255, 255, 255, 0, 0, 0};
    struct lw_error err = {0};
    lw_support_ok(lw_image_write_png(lw_support_temporary("mask.png"), rgb, 2, 1, &err), &err);
    lw_foreign_case_write_png("pic.png");
    lw_foreign_case_write_text("leaf.mtl", "newmtl leaf\nKd 1 1 1\nmap_Kd pic.png\nmap_d mask.png\n");
    struct lw_scene *scene = lw_foreign_case_scene_of("leaf.obj", "mtllib leaf.mtl\n" LW_FOREIGN_CASE_SQUARE
                                                                  "usemtl leaf\n" LW_FOREIGN_CASE_FACE);
    const struct lw_material *leaf = lw_support_material(scene, "leaf");
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
    struct lw_scene *scene = lw_foreign_case_scene_of("cube.obj", CUBE LAST_FACE);
    assert_int_equal(lw_support_triangles(scene), 12);
    assert_false(scene->material[scene->mesh[0].material[0]].double_sided);
    assert_float_equal(scene->material[0].base_colour[0], 0.6, 1e-6); /* nothing is said */
    lw_scene_destroy(scene);
    scene = lw_foreign_case_scene_of("open.obj", CUBE);
    assert_true(scene->material[scene->mesh[0].material[0]].double_sided);
    lw_scene_destroy(scene);
    /* one face turned over opens it too; two pieces are judged each by itself */
    scene = lw_foreign_case_scene_of("turned.obj", CUBE "f 8 5 1 4\n");
    assert_true(scene->material[scene->mesh[0].material[0]].double_sided);
    lw_scene_destroy(scene);
    scene = lw_foreign_case_scene_of("both.obj", CUBE LAST_FACE "v 5 0 0\nv 6 0 0\nv 6 1 0\nf 9 10 11\n");
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
    scene = lw_foreign_case_scene_of("flat.obj", text);
    assert_int_equal(scene->mesh[0].vertex_count, 6);
    lw_scene_destroy(scene);
    snprintf(text, sizeof text, "%ss 1\n%s", steep, fold);
    scene = lw_foreign_case_scene_of("crease.obj", text); /* sharper than 60 degrees stays sharp */
    assert_int_equal(scene->mesh[0].vertex_count, 6);
    lw_scene_destroy(scene);
    snprintf(text, sizeof text, "v 0 0 -1\nv 0 0 1\nv -1 -0.17 0\nv 1 -0.17 0\ns 1\n%s", fold);
    scene = lw_foreign_case_scene_of("smooth.obj", text);
    assert_int_equal(scene->mesh[0].vertex_count, 4);
    uint32_t ridge = scene->mesh[0].triangle[0][0];
    lw_foreign_case_expect_vec3(scene->mesh[0].normal[ridge], 0, 1, 0);
    lw_scene_destroy(scene);
    snprintf(text, sizeof text, "v 0 0 -1\nv 0 0 1\nv -1 -0.17 0\nv 1 -0.17 0\ns off\n%s", fold);
    scene = lw_foreign_case_scene_of("off.obj", text);
    assert_int_equal(scene->mesh[0].vertex_count, 6);
    lw_scene_destroy(scene);
    /* normals of the file, made unit; they decide the front, whatever the winding */
    scene = lw_foreign_case_scene_of("given.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 -4\nf 1//1 2//1 3//1\n");
    const struct lw_mesh *mesh = &scene->mesh[0];
    lw_foreign_case_expect_vec3(mesh->normal[0], 0, 0, -1);
    struct lw_surface surface;
    lw_scene_surface(scene, mesh, 0, 0.2f, 0.2f, &surface);
    lw_foreign_case_expect_vec3(surface.geometric_normal, 0, 0, -1);
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
    lw_foreign_case_write_png("textures/wood 1.png");
    lw_foreign_case_write_png("deep/er/Tile.PNG");
    lw_foreign_case_write_png("found.fbm/embedded.png");
    lw_foreign_case_write_png("50%25 grey.png");
    lw_foreign_case_write_png("w\xE4nde.png"); /* Latin-1 */
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
        struct lw_scene *scene = lw_foreign_case_scene_of(
            "found.obj", "mtllib found.mtl\n" LW_FOREIGN_CASE_SQUARE "usemtl paint\n" LW_FOREIGN_CASE_FACE);
        if (scene->texture_count != 1) fail_msg("%s: not found: %s", paths[i], lw_foreign_case_talk());
        lw_scene_destroy(scene);
    }
    /* no file outside the folder is ever read */
    lw_foreign_case_write_png("outside.png");
    lw_foreign_case_make_folder("inside");
    lw_foreign_case_write_text("inside/one.mtl", "newmtl paint\nKd 1 1 1\nmap_Kd ../outside.png\n");
    struct lw_scene *scene = lw_foreign_case_scene_of(
        "inside/one.obj", "mtllib one.mtl\n" LW_FOREIGN_CASE_SQUARE "usemtl paint\n" LW_FOREIGN_CASE_FACE);
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
        struct lw_scene *scene = lw_foreign_case_scene_of(
            "lost.obj", "mtllib lost.mtl\n" LW_FOREIGN_CASE_SQUARE "usemtl paint\n" LW_FOREIGN_CASE_FACE);
        if (!strstr(lw_foreign_case_talk(), cases[i].reason))
            fail_msg("\"%s\" lacks \"%s\"", lw_foreign_case_talk(), cases[i].reason);
        assert_int_equal(strchr(lw_foreign_case_talk(), '\n')[1], 0); /* one line */
        assert_float_equal(scene->material[0].base_colour[0], 0.4, 1e-6);
        assert_float_equal(scene->material[0].emission[0], 0, 0);
        lw_scene_destroy(scene);
    }
    struct lw_scene *scene = lw_foreign_case_scene_of(
        "nolib.obj", "mtllib lost and gone.mtl\n" LW_FOREIGN_CASE_SQUARE LW_FOREIGN_CASE_FACE);
    assert_non_null(
        strstr(lw_foreign_case_talk(), "the material library \"lost and gone.mtl\" is not there"));
    lw_scene_destroy(scene);
    /* a library of the scene's own name serves, as viewers have it */
    lw_foreign_case_write_text("own.mtl", "newmtl paint\nKd 0.25 0.25 0.25\n");
    scene = lw_foreign_case_scene_of("own.obj", "mtllib lost.and.gone.mtl\n" LW_FOREIGN_CASE_SQUARE
                                                "usemtl paint\n" LW_FOREIGN_CASE_FACE);
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
    struct lw_scene *scene = lw_foreign_case_scene_of(
        "scan.ply",
        PLY_HEAD "property uchar red\nproperty uchar green\nproperty uchar blue\n" PLY_FACES
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
    scene = lw_foreign_case_scene_of("scan.obj", "v 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 1 1 0 1 1 1\nf 1 2 3\n");
    assert_non_null(scene->mesh[0].colour);
    assert_float_equal(scene->material[scene->mesh[0].material[0]].base_colour[0], 1, 0);
    lw_scene_destroy(scene);
    lw_foreign_case_refuse_text("out.ply", PLY_HEAD PLY_FACES "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 4\n",
                                "uses vertex 4");
    lw_foreign_case_refuse_text("nan.ply", PLY_HEAD PLY_FACES "0 0 0\n1 nan 0\n1 1 0\n0 1 0\n4 0 1 2 3\n",
                                "is not a finite number");
    lw_foreign_case_refuse_text("nothing.ply", PLY_HEAD PLY_FACES "0 0 0\n1 0 0\n1 1 0\n0 1 0\n0\n",
                                "face 0 has no vertices");
    lw_foreign_case_refuse_text("none.ply", PLY_HEAD PLY_FACES "0 0 0\n0 0 0\n0 0 0\n0 0 0\n4 0 1 2 3\n",
                                "no triangles");
}

static void stl_has_triangles_alone(void **state) {
    (void)state;
    struct lw_scene *scene = lw_foreign_case_scene_of(
        "one.stl", "solid one\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 2 0 0\nvertex 0 2 0\n"
                   "endloop\nendfacet\nendsolid one\n");
    assert_int_equal(lw_support_triangles(scene), 1);
    assert_float_equal(scene->mesh[0].position[1].x, 2, 0);
    lw_scene_destroy(scene);
    uint8_t binary[84 + 50] = {[80] = 1};
    const float facet[12] = {0, 0, 1, 0, 0, 0, 3, 0, 0, 0, 3, 0};
    memcpy(binary + 84, facet, sizeof facet);
    lw_foreign_case_write_bytes("two.stl", binary, sizeof binary);
    scene = lw_foreign_case_scene("two.stl");
    assert_int_equal(lw_support_triangles(scene), 1);
    lw_scene_destroy(scene);
    binary[80] = 2;
    lw_foreign_case_write_bytes("short.stl", binary, sizeof binary);
    lw_foreign_case_refuse("short.stl", "has the name of a STL file but does not begin like one");
}

/* ---- broken files ---- */

static void broken_files_are_refused_in_one_line(void **state) {
    (void)state;
    lw_foreign_case_refuse_text("empty.obj", "", "is empty");
    lw_foreign_case_refuse_text("text.obj", "nothing of use\n", "is no OBJ file that can be read");
    lw_foreign_case_refuse_text("points.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\n", "no triangles");
    lw_foreign_case_refuse_text("line.obj", "v 0 0 0\nv 1 0 0\nl 1 2\n", "no triangles");
    lw_foreign_case_refuse_text("index.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 9\n", "out of range");
    lw_foreign_case_refuse_text("nan.obj", "v 0 0 0\nv nan 0 0\nv 1 1 0\nf 1 2 3\n",
                                "vertex 1 is not a finite number");
    lw_foreign_case_refuse_text("far.obj", "v 0 0 0\nv 2e9 0 0\nv 1 1 0\nf 1 2 3\n",
                                "vertex 1 is farther than 1e+09 m");
    lw_foreign_case_write_bytes("zeros.obj", "v 0 0 0\n\0\0\0\0", 12);
    lw_foreign_case_refuse("zeros.obj", "has the name of a OBJ file but does not begin like one");
    lw_foreign_case_refuse_text("not.fbx", "hello", "has the name of a FBX file but does not begin like one");
    lw_foreign_case_refuse_text("not.dae", "<html></html>",
                                "has the name of a Collada file but does not begin like one");
    lw_foreign_case_refuse_text("not.3ds", "MM",
                                "is in no format that is read: .gltf, .glb, .obj, .ply, .fbx, .dae, .stl");
    lw_foreign_case_refuse_text("cut.dae", "<?xml version=\"1.0\"?><COLLADA><asset>",
                                "is no Collada file that can be read");
    lw_foreign_case_refuse_text("cut.fbx", "Kaydara FBX Binary  ", "is no FBX file that can be read");
    lw_foreign_case_refuse_text("cut.ply", "ply\nformat ascii 1.0\n", "is cut short: its header has no end");
    lw_foreign_case_make_folder("folder.obj");
    lw_foreign_case_refuse("folder.obj", "is not a regular file");
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_fails(lw_foreign_case_load("never.obj", LW_FOREIGN_SIDES_AUTO, &scene, &err), LW_NO_INPUT,
                     &err, "never.obj: No such file");
}

/* Headers of two hundred bytes that claim 2^31 elements. */
static void claims_do_not_cost_memory(void **state) {
    (void)state;
    if (LW_SANITIZER) skip(); /* such builds have no limit on memory */
    lw_foreign_case_refuse_text(
        "vertices.ply",
        "ply\nformat binary_little_endian 1.0\nelement vertex 2147483647\nproperty float x\n"
        "property float y\nproperty float z\nelement face 1\nproperty list uchar int "
        "vertex_indices\nend_header\n",
        "needs more memory than a file of");
    lw_foreign_case_refuse_text(
        "faces.ply",
        "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n"
        "property float y\nproperty float z\nelement face 2147483647\nproperty list uchar int "
        "vertex_indices\nend_header\n",
        "needs more memory than a file of");
}

/* What a file is counts more than its name; degenerate and doubled triangles, and names that are no UTF-8, do
 * no harm. */
static void odd_files_are_read(void **state) {
    (void)state;
    struct lw_scene *scene = lw_foreign_case_scene_of("really a ply.obj", PLY_HEAD PLY_FACES
                                                      "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n");
    assert_int_equal(lw_support_triangles(scene), 2);
    lw_scene_destroy(scene);
    scene = lw_foreign_case_scene_of(
        "w\xE4nde 100%.obj",
        "o gr\xFCn\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 7 7 7\nf 1 2 3\nf 1 2 3\nf 3 2 1\nf 1 1 2\n");
    assert_int_equal(lw_support_triangles(scene), 3);
    assert_int_equal(scene->mesh[0].vertex_count, 6); /* flat: three a side; nobody uses the fourth */
    assert_non_null(strstr(lw_foreign_case_talk(), "1 triangles without area are left out"));
    assert_string_equal(scene->object[0].name, "gr\xC3\xBCn");
    lw_scene_destroy(scene);
    /* a millimetre and a hundred kilometres */
    scene = lw_foreign_case_scene_of("small.obj",
                                     "v 0 0 0\nv 0.001 0 0\nv 0.001 0.001 0\nv 0 0.001 0\nf 1 2 3 4\n");
    assert_int_equal(lw_support_triangles(scene), 2);
    lw_scene_destroy(scene);
    scene = lw_foreign_case_scene_of("large.obj", "v 0 0 0\nv 1e5 0 0\nv 1e5 1e5 0\nv 0 1e5 0\nf 1 2 3 4\n");
    assert_int_equal(lw_support_triangles(scene), 2);
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
        cmocka_unit_test(broken_files_are_refused_in_one_line),
        cmocka_unit_test(claims_do_not_cost_memory),
        cmocka_unit_test(odd_files_are_read),
        cmocka_unit_test(a_guarded_failure_is_one_line),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
