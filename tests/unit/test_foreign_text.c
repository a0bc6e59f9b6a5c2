/* OBJ, MTL, PLY, STL and Collada as people and exporters write them: what readers take, name and
 * skipped, line by line of the tables of docs/importing_other.md. */
#include "tests/support/foreign_case.h"

#include "common/base/log.h"
#include "common/scene/pose.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* One texel of a TGA. */
static void write_picture(const char *name, uint8_t red, uint8_t green, uint8_t blue) {
    const uint8_t tga[21] = {[2] = 2, [12] = 1, [14] = 1, [16] = 24, [18] = blue, [19] = green, [20] = red};
    lw_foreign_case_write_bytes(name, tga, sizeof tga);
}

static struct lw_scene *load(const char *name) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    if (lw_foreign_case_load(name, LW_FOREIGN_SIDES_AUTO, &scene, &err)) fail_msg("%s: %s", name, err.text);
    return scene;
}

static struct lw_scene *load_text(const char *name, const char *text) {
    lw_foreign_case_write_text(name, text);
    return load(name);
}

static void refuse_text(const char *name, const char *text, const char *reason) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_foreign_case_write_text(name, text);
    if (lw_foreign_case_load(name, LW_FOREIGN_SIDES_AUTO, &scene, &err) != LW_BAD_DATA ||
        !strstr(err.text, reason))
        fail_msg("%s: \"%s\", not \"%s\"", name, err.text, reason);
}

static void assert_warned(const char *what) {
    if (!strstr(lw_foreign_case_talk(), what))
        fail_msg("\"%s\" is not told; but: %s", what, lw_foreign_case_talk());
}

static void assert_quiet(const char *text) {
    if (*lw_foreign_case_talk()) fail_msg("%s tells: %s", text, lw_foreign_case_talk());
}

static const struct lw_material *first_material(const struct lw_scene *scene) {
    return &scene->material[scene->mesh[0].material[0]];
}

static void assert_colour(const struct lw_scene *scene, float red, float green, float blue, const char *of) {
    const float *c = first_material(scene)->base_colour;
    if (fabsf(c[0] - red) > 1e-5f || fabsf(c[1] - green) > 1e-5f || fabsf(c[2] - blue) > 1e-5f)
        fail_msg("%s: (%g, %g, %g), not (%g, %g, %g); told: %s", of, (double)c[0], (double)c[1], (double)c[2],
                 (double)red, (double)green, (double)blue, lw_foreign_case_talk());
}

#define QUAD "v 0 0 2\nv 2 0 2\nv 2 0 0\nv 0 0 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
#define FACE "f 1/1 2/2 3/3 4/4\n"
#define RED  0.8f, 0.1f, 0.1f
#define GREY 0.6f, 0.6f, 0.6f

static void write_red_library(void) { lw_foreign_case_write_text("m.mtl", "newmtl red\nKd 0.8 0.1 0.1\n"); }

/* ---- text ---- */

static void obj_is_read_however_it_is_written(void **state) {
    (void)state;
    static const char *const texts[] = {
        "\xEF\xBB\xBFmtllib m.mtl\nusemtl red\n" QUAD FACE,
        "mtllib m.mtl  \nusemtl red \t\n" QUAD "f 1 2 3 4 \t\n",
        "mtllib m.mtl # a tail\nusemtl red # a tail\n" QUAD "f 1 2 3 4 # a tail\nf 4 3 2#tail\n",
        "mtllib m.mtl\nusemtl red\nv 0 0 2 # a tail\nv 2 0 2 #tail\nv 2 0 0\nv 0 0 0\nf 1 2 3 4\n",
        "mtllib\tm.mtl\t\nusemtl\tred\t\n\tv\t0 0 2\n  v 2 0 2\nv 2 0\t0\nv 0 0 0\n\tf 1 2 3 4\n",
        "mtllib m.mtl\r\nusemtl red\r\nv 0 0 2\r\nv 2 0 2\r\nv 2 0 0\r\nv 0 0 0\r\nf 1 2 \\\r\n3 4\r\n",
        "mtllib m.mtl\rusemtl red\rv 0 0 2\rv 2 0 2\rv 2 0 0\rv 0 0 0\rf 1 2 3 4\r",
        "MTLLIB m.mtl\nUseMtl red\nV 0 0 2\nV 2 0 2\nV 2 0 0\nV 0 0 0\nF 1 2 3 4",
        "mtllib m.mtl\nusemtl \\\nred\n" QUAD "f 1 \\\n2 \\ \t\n3 4\n",
        "# a path: C:\\scenes\\\nmtllib m.mtl\nusemtl red\n" QUAD "\n\f\nf 1 2 3 4\v\n\x1a",
        "mtllib \"m.mtl\"\nusemtl red\n" QUAD "f 1/ 2/ 3// 4\n",
        "usemtl red\nf 1 2 3 4\n" QUAD "mtllib m.mtl\n",
        "mtllib m.mtl\nusemtl red\n" QUAD "f -4/-4 -3/-3 -2/-2 -1/-1\n",
        "mtllib m.mtl\nusemtl red\n" QUAD "g a b\no my thing # tail\ng\ns off\nfo 1 2 3 4\n",
        "mtllib m.mtl\nusemtl red\nv 0,0 -.0 2,0\nv +2 .0 2.\nv 2e0 ,0 +.0\nv 0 0 0\nf 1 2 3 4\n",
    };
    write_red_library();
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        struct lw_scene *scene = load_text("text.obj", texts[i]);
        assert_quiet(texts[i]);
        assert_colour(scene, RED, texts[i]);
        lw_scene_destroy(scene);
    }
}

static void mtl_is_read_however_it_is_written(void **state) {
    (void)state;
    static const char *const texts[] = {
        "\xEF\xBB\xBFnewmtl t\nKd 0.8 0.1 0.1\nmap_Kd red.tga\n",
        "newmtl t   # name\nKd 0.8 0.1 0.1 # red\nmap_Kd red.tga # a picture\n",
        "newmtl t \t\nKd 0.8 0.1 0.1\t \nmap_Kd red.tga  \n",
        "NEWMTL t\nKD 0.8 0.1 0.1\nMAP_KD red.tga\n",
        "newmtl t\nkd 0.8 0.1 0.1\nmap_kd red.tga",
        "newmtl t\r\nKd 0.8 0.1 0.1\r\nmap_Kd red.tga\r\n",
        "newmtl t\rKd 0.8 0.1 0.1\rmap_Kd red.tga\r",
        "\tnewmtl t\n\t\tKd\t0.8 0.1\t0.1\n\t\tmap_Kd\tred.tga\n",
        "newmtl t\nKd 0.8 \\\n0.1 0.1#red\nmap_Kd \\\nred.tga\n",
        "newmtl t\nKd 8e-1 0,1 .1\nmap_Kd \"red.tga\"\n",
        ("newmtl t\nKa 1 1 1\nKs 0 0 0\nNs 10\nNi 1.5\nillum 2\nKd 0.8 0.1 0.1\nmap_Kd red.tga\nTf 1 1 1\n"
         "Pr 0\nPm 0\nPs 0\nPc 0\nPcr 0\naniso 0\nanisor 0\nmap_Ka a\nmap_Ks b\nmap_Ns c\nmap_Ps d\n"),
    };
    write_picture("red.tga", 200, 10, 10);
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        lw_foreign_case_write_text("t.mtl", texts[i]);
        struct lw_scene *scene = load_text("text.obj", "mtllib t.mtl\nusemtl t\n" QUAD FACE);
        assert_quiet(texts[i]);
        assert_colour(scene, RED, texts[i]);
        assert_int_equal(scene->texture_count, 1);
        assert_int_equal(scene->texture[0].rgba[0], 200);
        lw_scene_destroy(scene);
    }
    /* names may hold blanks and hashes: exporters of 3ds Max write "Material #25" */
    static const char *const names[] = {"my red", "red#1", "Material #25", "r\xC3\xB6t"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char text[256];
        snprintf(text, sizeof text, "newmtl %s # tail\nKd 0.8 0.1 0.1\n", names[i]);
        lw_foreign_case_write_text("t.mtl", text);
        snprintf(text, sizeof text, "mtllib t.mtl\nusemtl %s\n" QUAD FACE, names[i]);
        struct lw_scene *scene = load_text("text.obj", text);
        assert_quiet(names[i]);
        assert_string_equal(first_material(scene)->name, names[i]);
        assert_colour(scene, RED, names[i]);
        lw_scene_destroy(scene);
    }
}

static void wide_text_is_named(void **state) {
    (void)state;
    static const char *const names[] = {"wide.obj", "wide.ply", "wide.stl", "wide.dae"};
    static const char *const starts[] = {"\xFF\xFEv", "\xFE\xFFv", "\xFF\xFEv"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        refuse_text(names[i], starts[i % 3], "is UTF-16 text, which is not read: save it as UTF-8");
    lw_foreign_case_write_text("wide.mtl", "\xFF\xFEn");
    struct lw_scene *scene = load_text("text.obj", "mtllib wide.mtl\nusemtl t\n" QUAD FACE);
    assert_warned("the material library \"wide.mtl\" is UTF-16: save it as UTF-8");
    assert_colour(scene, GREY, "wide.mtl");
    lw_scene_destroy(scene);
}

/* ---- libraries and names ---- */

static void libraries_are_found(void **state) {
    (void)state;
    lw_foreign_case_make_folder("my mats");
    lw_foreign_case_make_folder("other");
    write_red_library();
    lw_foreign_case_write_text("my mats/a b.mtl", "newmtl blue\nKd 0.1 0.1 0.8\nnewmtl red\nKd 0 0 0\n");
    lw_foreign_case_write_text("other/none", "newmtl green\nKd 0.1 0.8 0.1\n");
    static const struct {
        const char *lines, *used;
        float colour[3];
        const char *warning; /* NULL: nothing */
    } cases[] = {
        {"mtllib m.mtl my mats/a b.mtl", "red", {RED}, NULL}, /* the first of two counts */
        {"mtllib m.mtl my mats/a b.mtl", "blue", {0.1f, 0.1f, 0.8f}, NULL},
        {"mtllib my mats\\a b.mtl M.MTL", "blue", {0.1f, 0.1f, 0.8f}, NULL},
        {"mtllib m.mtl\nmtllib my mats/a b.mtl\nmtllib m.mtl", "blue", {0.1f, 0.1f, 0.8f}, NULL},
        {"mtllib other/none", "green", {0.1f, 0.8f, 0.1f}, NULL},
        {"mtllib m.mtl other/none", "green", {0.1f, 0.8f, 0.1f}, NULL},
        {"mtllib other/none gone", "green", {0.1f, 0.8f, 0.1f}, "library \"gone\" is not there"},
        {"mtllib C:\\work\\m.mtl", "red", {RED}, NULL},
        {"mtllib m.mtl gone.mtl", "red", {RED}, "the material library \"gone.mtl\" is not there"},
        {"mtllib gone.mtl m.mtl lost.mtl", "red", {RED}, "library \"gone.mtl\" (and 1 more) is not there"},
        {"mtllib ../m.mtl", "red", {RED}, NULL}, /* no file outside of the folder is opened */
        {"mtllib", "red", {GREY}, "line 1: \"mtllib\": names no library"},
        {"mtllib m.mtl", "green", {GREY}, "materials that no library has are grey: \"green\""},
        {"mtllib m.mtl", "RED", {GREY}, "materials that no library has are grey: \"RED\""},
        {"mtllib m.mtl", "", {GREY}, "materials that no library has are grey: \"\""},
        {"# none", "red", {GREY}, "materials that no library has are grey: \"red\""},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[512];
        snprintf(text, sizeof text, "%s\nusemtl %s\n" QUAD FACE, cases[i].lines, cases[i].used);
        struct lw_scene *scene = load_text("names.obj", text);
        if (cases[i].warning)
            assert_warned(cases[i].warning);
        else
            assert_quiet(text);
        assert_colour(scene, cases[i].colour[0], cases[i].colour[1], cases[i].colour[2], text);
        lw_scene_destroy(scene);
    }
    struct lw_scene *scene = load_text("names.obj", "mtllib m.mtl\n" QUAD "usemtl a\n" FACE "usemtl b\n" FACE
                                                    "usemtl red\n" FACE "usemtl c\n" FACE);
    assert_warned("materials that no library has are grey: \"a\" and 2 more"); /* one line for all */
    assert_int_equal(strchr(lw_foreign_case_talk(), '\n')[1], 0);
    lw_scene_destroy(scene);
}

static void libraries_and_materials_are_bounded(void **state) {
    (void)state;
    write_red_library();
    char *text = malloc(2000000), *at = text;
    at += sprintf(at, "mtllib");
    for (int i = 0; i < 1200; i++) at += sprintf(at, " gone%d.mtl", i);
    sprintf(at, " m.mtl\nusemtl red\n" QUAD FACE);
    struct lw_scene *scene = load_text("many.obj", text);
    assert_warned("more than 256 material libraries, or 1000 names of them: the rest is not read");
    assert_warned("materials that no library has are grey: \"red\"");
    lw_scene_destroy(scene);
    at = text;
    for (int i = 0; i < 65540; i++) at += sprintf(at, "usemtl %d\n", i);
    refuse_text("many.obj", text, "line 65538: uses more than 65536 materials");
    free(text);
}

static void textures_lie_beside_their_library(void **state) {
    (void)state;
    lw_foreign_case_make_folder("mats");
    lw_foreign_case_make_folder("mats/tex");
    lw_foreign_case_make_folder("pics");
    write_picture("mats/tex/deep blue.tga", 10, 10, 200);
    write_picture("mats/flat.tga", 1, 2, 3);
    write_picture("flat.tga", 4, 5, 6);
    write_picture("pics/far.tga", 7, 8, 9);
    static const struct {
        const char *path;
        uint8_t red;
    } cases[] = {
        {"tex/deep blue.tga", 10}, {"tex\\Deep Blue.TGA", 10},   {"mats/tex/deep blue.tga", 10},
        {"flat.tga", 1},           {"C:\\x\\flat.tga", 4},       {"../pics/far.tga", 7},
        {"pics/far.tga", 7},       {"C:\\x\\deep blue.tga", 10},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[256];
        snprintf(text, sizeof text, "newmtl t\nKd 1 1 1\nmap_Kd %s\n", cases[i].path);
        lw_foreign_case_write_text("mats/sub.mtl", text);
        struct lw_scene *scene = load_text("beside.obj", "mtllib mats/sub.mtl\nusemtl t\n" QUAD FACE);
        if (scene->texture_count != 1) fail_msg("%s: %s", cases[i].path, lw_foreign_case_talk());
        assert_int_equal(scene->texture[0].rgba[0], cases[i].red);
        lw_scene_destroy(scene);
    }
    lw_foreign_case_write_text("mats/sub.mtl", "newmtl t\nmap_Kd ../../outside.tga\n");
    struct lw_scene *scene = load_text("beside.obj", "mtllib mats/sub.mtl\nusemtl t\n" QUAD FACE);
    assert_warned("texture \"../../outside.tga\": is not there");
    lw_scene_destroy(scene);
}

/* ---- options of maps ---- */

struct map_case {
    const char *options;
    float scale[2], offset[2]; /* v down */
    const char *warning;       /* NULL: nothing */
};

static void map_options_move_textures_or_are_named(void **state) {
    (void)state;
    static const struct map_case cases[] = {
        {"", {1, 1}, {0, 0}, NULL},
        {"-s 2", {2, 1}, {0, 0}, NULL},
        {"-s 2 3", {2, 3}, {0, -2}, NULL},
        {"-S 2 3 4", {2, 3}, {0, -2}, NULL},
        {"-o 0.5", {1, 1}, {0.5f, 0}, NULL},
        {"-o 0.5 0.25", {1, 1}, {0.5f, -0.25f}, NULL},
        {"-o 0.5 0.25 7", {1, 1}, {0.5f, -0.25f}, NULL},
        {"-blendu on -s 2 2 -o .5 -blendv on -clamp off -cc off", {2, 2}, {0.5f, -1}, NULL},
        {"-t 0 0 0 -s 2", {2, 1}, {0, 0}, NULL},
        {"-colorspace sRGB -s 2", {2, 1}, {0, 0}, NULL},
        {"-t 1", {1, 1}, {0, 0}, "line 2: \"-t\": turbulence is not read"},
        {"-t 0 1 0", {1, 1}, {0, 0}, "line 2: \"-t\": turbulence is not read"},
        {"-bm 0.5 -s 2", {2, 1}, {0, 0}, "line 2: \"-bm\": is read of bump and norm alone"},
        {"-blendu off -s 2", {2, 1}, {0, 0}, "line 2: \"-blendu\": is not read"},
        {"-blendv off -s 2", {2, 1}, {0, 0}, "line 2: \"-blendv\": is not read"},
        {"-cc on -s 2", {2, 1}, {0, 0}, "line 2: \"-cc\": colour correction is not read"},
        {"-imfchan r -s 2", {2, 1}, {0, 0}, "line 2: \"-imfchan\": is read of map_d, map_Pr"},
        {"-type sphere -s 2", {2, 1}, {0, 0}, "line 2: \"-type\": is not read"},
        {"-texres 512 -s 2", {2, 1}, {0, 0}, "line 2: \"-texres\": is not read"},
        {"-boost 2 -s 2", {2, 1}, {0, 0}, "line 2: \"-boost\": is not read"},
        {"-colorspace linear -s 2", {2, 1}, {0, 0}, "line 2: \"-colorspace\": is not read"},
        {"-frob 3 4 -s 2", {2, 1}, {0, 0}, "line 2: \"-frob\": is no option of a map"},
        {"-s", {1, 1}, {0, 0}, "line 2: \"-s\": has no number"},
        {"-s nan 1 1", {1, 1}, {0, 0}, "line 2: \"-s\": has no number"},
        {"-o", {1, 1}, {0, 0}, "line 2: \"-o\": has no number"},
        {"-mm", {1, 1}, {0, 0}, "line 2: \"-mm\": has no number"},
        {"-clamp", {1, 1}, {0, 0}, "line 2: \"-clamp\": is neither on nor off"},
        {"-imfchan q -s 2", {2, 1}, {0, 0}, "line 2: \"-imfchan\": is none of r, g, b, m and l"},
        {"-s 0 0", {0, 0}, {0, 1}, "line 2: \"-s\": a scale of 0 is read"},
    };
    write_picture("my red.tga", 200, 10, 10);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[256];
        snprintf(text, sizeof text, "newmtl t\nmap_Kd %s my red.tga\n", cases[i].options);
        lw_foreign_case_write_text("o.mtl", text);
        struct lw_scene *scene = load_text("options.obj", "mtllib o.mtl\nusemtl t\n" QUAD FACE);
        if (cases[i].warning)
            assert_warned(cases[i].warning);
        else
            assert_quiet(text);
        if (scene->texture_count != 1) fail_msg("%s: no texture: %s", text, lw_foreign_case_talk());
        const float *m = first_material(scene)->base_colour_texture.transform;
        const float expected[6] = {cases[i].scale[0], 0, cases[i].offset[0], 0, cases[i].scale[1],
                                   cases[i].offset[1]};
        for (int k = 0; k < 6; k++)
            if (fabsf(m[k] - expected[k]) > 1e-6f) fail_msg("%s: transform[%d] is %g", text, k, (double)m[k]);
        lw_scene_destroy(scene);
    }
}

static struct lw_scene *load_map(const char *line) {
    char text[256];
    snprintf(text, sizeof text, "newmtl t\nKd 1 1 1\n%s\n", line);
    lw_foreign_case_write_text("o.mtl", text);
    return load_text("options.obj", "mtllib o.mtl\nusemtl t\n" QUAD FACE);
}

static void map_options_change_values(void **state) {
    (void)state;
    write_picture("p.tga", 188, 64, 0); /* 0.503, 0.0513, 0 linear */
    struct lw_scene *scene = load_map("map_Kd -clamp on p.tga");
    assert_int_equal(scene->texture[0].wrap_s, LW_WRAP_CLAMP);
    assert_int_equal(scene->texture[0].wrap_t, LW_WRAP_CLAMP);
    lw_scene_destroy(scene);
    scene = load_map("map_Kd -mm 0.1 0.5 p.tga"); /* 0.1 + 0.5 x, linear, is 0.3515, 0.1256, 0.1 */
    assert_int_equal(scene->texture[0].rgba[0], 160);
    assert_int_equal(scene->texture[0].rgba[1], 99);
    assert_int_equal(scene->texture[0].rgba[2], 89);
    lw_scene_destroy(scene);
    scene = load_map("map_Kd -mm 1 p.tga");
    assert_int_equal(scene->texture[0].rgba[2], 255);
    lw_scene_destroy(scene);
    static const char *const lamps[] = {"map_Ke -mm 0 3 p.tga", "map_emissive -mm 0 3 p.tga"};
    for (int i = 0; i < 2; i++) { /* light may be above 1 */
        scene = load_map(lamps[i]);
        assert_float_equal(first_material(scene)->emission[0], 3, 0);
        assert_int_equal(scene->texture[0].rgba[0], 188);
        lw_scene_destroy(scene);
    }
    scene = load_map("map_Ke -mm 0.1 0.5 p.tga");
    assert_float_equal(first_material(scene)->emission[0], 1, 0);
    assert_int_equal(scene->texture[0].rgba[0], 160);
    lw_scene_destroy(scene);
    static const struct {
        const char *line;
        uint8_t alpha;
    } cases[] = {{"map_d p.tga", 84},
                 {"map_d -imfchan l p.tga", 84},
                 {"map_d -imfchan r p.tga", 188},
                 {"map_d -imfchan g p.tga", 64},
                 {"map_d -imfchan b -mm 0.5 1 p.tga", 127},
                 {"map_d -imfchan m p.tga", 255},
                 {"map_opacity -imfchan r -mm 0 0.5 p.tga", 94},
                 {"map_Kd p.tga\nmap_d -imfchan r p.tga", 188}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        scene = load_map(cases[i].line);
        const struct lw_texture_use *use = &first_material(scene)->base_colour_texture;
        assert_int_not_equal(use->texture, LW_SCENE_NONE);
        if (scene->texture[use->texture].rgba[3] != cases[i].alpha)
            fail_msg("%s: %u", cases[i].line, scene->texture[use->texture].rgba[3]);
        lw_scene_destroy(scene);
    }
    scene = load_map("map_Kd p.tga\nmap_d -s 2 2 p.tga\nmap_d -imfchan r -s 2 p.tga");
    assert_warned("an opacity map lies otherwise than the colour beside it");
    lw_scene_destroy(scene);
    scene = load_map("map_Kd # none");
    assert_warned("line 3: \"map_Kd\": names no picture");
    lw_scene_destroy(scene);
}

/* ---- rare statements ---- */

static void rare_statements_of_mtl_are_named(void **state) {
    (void)state;
    static const struct {
        const char *line, *warning;
    } cases[] = {
        {"d -halo 0.5", "line 3: \"d\": -halo is not read"},
        {"d -halo", "line 3: \"d\": -halo is not read"},
        {"d x", "line 3: \"d\": has not one number"},
        {"Tr", "line 3: \"Tr\": has not one number"},
        {"Kd spectral file.rfl", "line 3: \"Kd\": spectral curves are not read"},
        {"Kd spectral file.rfl 1.0", "line 3: \"Kd\": spectral curves are not read"},
        {"Kd xyz 0.3 0.3 0.3", "line 3: \"Kd\": CIE XYZ colours are not read"},
        {"Kd 0.5 0.2", "line 3: \"Kd\": has not three numbers"},
        {"Kd red", "line 3: \"Kd\": has not three numbers"},
        {"Kd 0.8 0.1 0.1 0.5", "line 3: \"Kd\": numbers behind the third are not read"},
        {"Ke spectral a.rfl", "line 3: \"Ke\": spectral curves are not read"},
        {"Ks xyz 1 1 1", "line 3: \"Ks\": CIE XYZ colours are not read"},
        {"Ka xyz 1 1 1", "line 3: \"Ka\": CIE XYZ colours are not read"},
        {"Ka fish", "line 3: \"Ka\": has not three numbers"},
        {"Tf 0.5", "line 3: \"Tf\": coloured glass is not read"},
        {"Tf xyz 1", "line 3: \"Tf\": CIE XYZ colours are not read"},
        {"illum fish", "line 3: \"illum\": has no number"},
        {"Ns abc", "line 3: \"Ns\": has no number"},
        {"Pr", "line 3: \"Pr\": has no number"},
        {"sharpness 60", "line 3: \"sharpness\": is not read"},
        {"refl -type sphere a.tga", "line 3: \"refl\": is not read"},
        {"decal a.tga", "line 3: \"decal\": is not read"},
        {"disp a.tga", "line 3: \"disp\": is not read"},
        {"map_aat on", "line 3: \"map_aat\": is not read"},
        {"map_Tr a.tga", "line 3: \"map_tr\": is not read"},
        {"frobnicate 1 2", "line 3: \"frobnicate\": is not read"},
        {"newmtl t", "line 3: \"newmtl\": a name that was there before: the first one counts"},
        {"Pc 0.5", "line 3: \"Pc\": is not shown"},
        {"aniso 1", "line 3: \"aniso\": is not shown"},
        {"Pr 1.5\nPm 0", "metalness or roughness is taken to the end of its range: \"t\""},
        {"bump -bm 0.2 a.tga", "texture \"a.tga\": is not there"},
        {"norm a.tga", "texture \"a.tga\": is not there"},
        {"map_Pr a.tga", "texture \"a.tga\": is not there"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[256];
        snprintf(text, sizeof text, "newmtl t\nKd 0.8 0.1 0.1\n%s\n", cases[i].line);
        lw_foreign_case_write_text("rare.mtl", text);
        struct lw_scene *scene = load_text("rare.obj", "mtllib rare.mtl\nusemtl t\n" QUAD FACE);
        assert_warned(cases[i].warning);
        assert_int_equal(strchr(lw_foreign_case_talk(), '\n')[1], 0); /* one line */
        assert_colour(scene, RED, text);
        assert_int_equal(first_material(scene)->alpha_mode, LW_ALPHA_OPAQUE);
        lw_scene_destroy(scene);
    }
    lw_foreign_case_write_text("rare.mtl", "Kd 1 1 1\nnewmtl t\nKd 0.5\nTr 0.75\nd 0.25\nTr 0.9\nKe 2\n");
    struct lw_scene *scene = load_text("rare.obj", "mtllib rare.mtl\nusemtl t\n" QUAD FACE);
    assert_warned("line 1: \"Kd\": stands before the first newmtl");
    assert_colour(scene, 0.5f, 0.5f, 0.5f, "one number");               /* is all three */
    assert_float_equal(first_material(scene)->base_colour[3], 0.25, 0); /* d goes before Tr */
    assert_float_equal(first_material(scene)->emission[2], 2, 0);
    lw_scene_destroy(scene);
}

static void rare_statements_of_obj_are_named(void **state) {
    (void)state;
    static const struct {
        const char *line, *warning;
    } cases[] = {
        {"p 1", "line 11: \"p\": points are ignored"},
        {"p 99", "line 11: \"p\": points are ignored"},
        {"l 1 2", "line 11: \"l\": lines are ignored"},
        {"l", "line 11: \"l\": lines are ignored"},
        {"f 1 2", "line 11: \"f\": a face of less than three corners"},
        {"curv 0.0 1.0 1 2 3 4", "line 11: \"curv\": free-form curves and surfaces are not read"},
        {"surf 0 1 0 1 1 2 3 4", "line 11: \"surf\": free-form"},
        {"cstype rat bspline", "line 11: \"cstype\": free-form"},
        {"vp 0 0 1", "line 11: \"vp\": free-form"},
        {"mg 1 0.5", "line 11: \"mg\": free-form"},
        {"call x.obj", "line 11: \"call\": other files are not read"},
        {"maplib x.map", "line 11: \"maplib\": other files are not read"},
        {"bevel on", "line 11: \"bevel\": is for display"},
        {"lod 2", "line 11: \"lod\": is for display"},
        {"s fish", "line 11: \"s\": is no smoothing group"},
        {"v 1 1 1 1 0 0 1", "line 11: \"v\": numbers behind the colour are not read"},
        {"v 1 1 1 1 1", "line 11: \"v\": its two numbers behind the place are not read"},
        {"v 1 1 1 0", "line 11: \"v\": its weight is 0 and not read"},
        {"vt 0 0 0 0", "line 11: \"vt\": its fourth number is not read"},
        {"frob 1 2\nfrob 2", "line 11: \"frob\": is no statement of OBJ (2 such lines)"},
    };
    write_red_library();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[512];
        snprintf(text, sizeof text, "mtllib m.mtl\nusemtl red\n" QUAD "%s\n" FACE, cases[i].line);
        struct lw_scene *scene = load_text("rare.obj", text);
        assert_warned(cases[i].warning);
        assert_colour(scene, RED, text);
        assert_int_equal(scene->mesh[0].triangle_count, 2);
        lw_scene_destroy(scene);
    }
    /* ten kinds are named, and the number of the rest */
    char text[2048] = QUAD FACE;
    for (int i = 0; i < 30; i++) sprintf(text + strlen(text), "frob%d\n", i);
    struct lw_scene *scene = load_text("rare.obj", text);
    assert_warned("\"frob9\"");
    assert_null(strstr(lw_foreign_case_talk(), "\"frob10\""));
    assert_warned("20 more lines of other kinds are not read");
    lw_scene_destroy(scene);
}

static void broken_lines_are_named(void **state) {
    (void)state;
    refuse_text("b.obj", "v 0 0\nv 1 0 0\n", "line 1: v has 2 numbers, not three");
    refuse_text("b.obj", "v 0 0 0\nv 2 fish 0\n", "line 2: v: \"fish\" is no number");
    refuse_text("b.obj", "v 0 0 0\nv 2 0x1 0\n", "line 2: v: \"0x1\" is no number");
    refuse_text("b.obj", "vt\n", "line 1: vt has no number");
    refuse_text("b.obj", "vn 0 1\n", "line 1: vn has 2 numbers, not three");
    refuse_text("b.obj", QUAD "f 0 1 2\n", "line 9: a corner names v 0; they count from 1");
    refuse_text("b.obj", QUAD "f 1 2 9\n", "line 9: v 9 is out of range: there are 4");
    refuse_text("b.obj", QUAD "f 1/1 2/2 3/9\n", "line 9: vt 9 is out of range: there are 4");
    refuse_text("b.obj", QUAD "f 1//1 2//1 3//1\n", "line 9: vn 1 is out of range: there are 0");
    refuse_text("b.obj", QUAD "f 1 2 -5\n", "line 9: v -5 is out of range: there are 4 before it");
    refuse_text("b.obj", QUAD "f 1.0 2 3\n", "line 9: \"1.0\" is no corner of a face");
    refuse_text("b.obj", QUAD "f 1 2 3/1/1/1\n", "is no corner of a face");
    refuse_text("b.obj", "v 0 0 0 1 \\\n0 fish\n", "line 1: v: \"fish\" is no number");
    refuse_text("b.obj", "hello\n", "is no OBJ file that can be read: line 1 begins with \"hello\"");
    refuse_text("b.obj", "curv 1 2\n", "has no triangles");
}

/* ---- vertices ---- */

static void vertices_have_weights_colours_and_short_coordinates(void **state) {
    (void)state;
    struct lw_scene *scene = load_text("w.obj", "v 0 0 4 2\nv 4 0 4 2\nv 4 0 0 2\nv 0 0 0 1.0\nf 1 2 3 4\n");
    float largest = 0;
    for (uint32_t i = 0; i < scene->mesh[0].vertex_count; i++)
        largest = fmaxf(largest, scene->mesh[0].position[i].x);
    assert_float_equal(largest, 2, 0);
    lw_scene_destroy(scene);
    /* some with a colour, some without, which are white */
    scene = load_text("c.obj", "v 0 0 2\nv 2 0 2 1 0 0\nv 2 0 0 1 0 0\nv 0 0 0 1\nf 1 2 3 4\n");
    assert_warned("vertices without a colour beside some that have one are white");
    const struct lw_mesh *mesh = &scene->mesh[0];
    assert_non_null(mesh->colour);
    for (uint32_t i = 0; i < mesh->vertex_count; i++)
        assert_float_equal(mesh->colour[i].y, mesh->position[i].x > 0 ? 0 : 1, 0);
    lw_scene_destroy(scene);
    scene =
        load_text("vt.obj", "v 0 0 2\nv 2 0 2\nv 2 0 0\nv 0 0 0\nvt 0\nvt 1 # u\nvt 1 1\nvt 0 1 5\n" FACE);
    assert_quiet("vt");
    assert_non_null(scene->mesh[0].uv[0]);
    lw_scene_destroy(scene);
    scene =
        load_text("hex.obj", "v 0 0 0\nv 1 0 0\nv 2 0 -1\nv 1 0 -2\nv 0 0 -2\nv -1 0 -1\nf 1 2 3 4 5 6\n");
    assert_int_equal(scene->mesh[0].triangle_count, 4);
    lw_scene_destroy(scene);
}

/* ---- PLY ---- */

#define PLY_XYZ            "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
#define PLY_FACES          "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
#define RGB(type, r, g, b) "property " type " " r "\nproperty " type " " g "\nproperty " type " " b "\n"
#define ROWS(c)            "0 0 2" c "\n2 0 2" c "\n2 0 0" c "\n0 0 0" c "\n4 0 1 2 3\n"

static void ply_colours_have_many_names(void **state) {
    (void)state;
    static const struct {
        const char *text, *warning;
        bool coloured;
    } cases[] = {
        {"ply\nformat ascii 1.0\n" PLY_XYZ PLY_FACES ROWS(""), NULL, false},
        {"ply\nformat ascii 1.0\n" PLY_XYZ RGB("uchar", "red", "green", "blue") PLY_FACES ROWS(" 200 20 20"),
         NULL, true},
        {"ply\nformat ascii 1.0\n" PLY_XYZ RGB("uint8", "diffuse_red", "diffuse_green", "diffuse_blue")
             PLY_FACES ROWS(" 200 20 20"),
         NULL, true},
        {"ply\nformat ascii 1.0\n" PLY_XYZ RGB("uchar", "r", "g", "b") PLY_FACES ROWS(" 200 20 20"), NULL,
         true},
        {"ply\nformat ascii 1.0\n" PLY_XYZ RGB("float", "r", "g", "b")
             PLY_FACES ROWS(" 0.784314 0.0784314 0.0784314"),
         NULL, true},
        {"ply\nformat ascii 1.0\n" PLY_XYZ RGB("ushort", "red", "green", "blue")
             PLY_FACES ROWS(" 51400 5140 5140"),
         NULL, true},
        {"ply\nformat ascii 1.0\n" PLY_XYZ RGB("uchar", "Red", "GREEN", "bLue") PLY_FACES ROWS(" 200 20 20"),
         NULL, true},
        {"ply\nformat ascii 1.0\n" PLY_XYZ RGB("uchar", "red", "green", "blue")
             RGB("uchar", "diffuse_red", "diffuse_green", "diffuse_blue") PLY_FACES ROWS(" 200 20 20 0 0 0"),
         "line 10: \"diffuse_red\": a second colour of vertices is not read", true},
        {"ply\nformat ascii 1.0\n" PLY_XYZ RGB("int", "red", "green", "blue") PLY_FACES ROWS(" 200 20 20"),
         "line 7: \"red\": colours are read as uchar, ushort, float and double alone", false},
        {"ply\nformat ascii 1.0\n" PLY_XYZ RGB("float", "f_dc_0", "quality", "ambient_red")
             PLY_FACES ROWS(" 1 2 3"),
         "line 8: \"quality\": is no property of vertices that is read", false},
        {"ply\nformat ascii 1.0\n" PLY_XYZ "element face 1\nproperty list uchar int vertex_index\n" RGB(
             "uchar", "red", "green", "blue") "end_header\n0 0 2\n2 0 2\n2 0 0\n0 0 0\n4 0 1 2 3 200 20 20\n",
         "line 9: \"red\": colours of faces are not read", false},
        {"ply\nformat ascii 1.0\n" PLY_XYZ "element face 1\nproperty list uchar int vertex_indices\n"
         "property int flags\nelement edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n"
         "0 0 2\n2 0 2\n2 0 0\n0 0 0\n4 0 1 2 3 7\n0 1\n",
         "line 10: \"edge\": is not read", false},
        {"ply\nformat ascii 1.0\n" PLY_XYZ RGB(
             "uchar", "red", "green", "blue") "property uchar alpha\n" PLY_FACES ROWS(" 200 20 20 128"),
         "the alpha of vertex colours is ignored", true},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct lw_scene *scene = load_text("c.ply", cases[i].text);
        if (cases[i].warning)
            assert_warned(cases[i].warning);
        else
            assert_quiet(cases[i].text);
        const struct lw_mesh *mesh = &scene->mesh[0];
        assert_int_equal(mesh->colour != NULL, cases[i].coloured);
        if (cases[i].coloured) assert_float_equal(mesh->colour[0].x, 0.5775804, 1e-4); /* 200 of 255 */
        const float c = cases[i].coloured ? 1 : 0.6f;
        assert_colour(scene, c, c, c, cases[i].text);
        lw_scene_destroy(scene);
    }
}

static void ply_is_read_however_it_is_written(void **state) {
    (void)state;
#define RED_PLY RGB("uchar", "red", "green", "blue") PLY_FACES ROWS(" 200 20 20")
    static const char *const texts[] = {
        "\xEF\xBB\xBFply\nformat ascii 1.0\n" PLY_XYZ RED_PLY,
        "ply \t\nformat ascii 1.0  \ncomment by hand\nobj_info x\n\n" PLY_XYZ RED_PLY,
        "PLY\nFORMAT ASCII 1.0\nComment TextureFile  \n" PLY_XYZ RED_PLY,
        "ply\nformat ascii 1.0\nELEMENT Vertex 4\nPROPERTY FLOAT X\nProperty Float Y\nproperty float z "
        "\n" RED_PLY,
    };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        for (int end = 0; end < 3; end++) { /* LF, CR LF, CR */
            char text[4096], *to = text;
            for (const char *from = texts[i]; *from; from++) {
                if (*from != '\n' || end == 0) *to++ = *from;
                if (*from == '\n' && end > 0) *to++ = '\r';
                if (*from == '\n' && end == 1) *to++ = '\n';
            }
            *to = 0;
            struct lw_scene *scene = load_text("e.ply", text);
            assert_quiet(text);
            assert_int_equal(scene->mesh[0].triangle_count, 2);
            assert_float_equal(scene->mesh[0].colour[0].x, 0.5775804, 1e-4);
            lw_scene_destroy(scene);
        }
    }
    /* a header of each end before bytes that could be one */
    static const char rows[] =
        "ply\nformat ascii 1.0\n" PLY_XYZ PLY_FACES
        "\n# rows\n\t0 0 2 \n2\t0 2 # a tail\n\n2. .0 0\ncomment x\n0 0 0\n 4 0 1 2 3\n\n";
    struct lw_scene *in_rows = load_text("rows.ply", rows);
    assert_quiet(rows);
    assert_int_equal(in_rows->mesh[0].triangle_count, 2);
    lw_scene_destroy(in_rows);
    /* "\x0A" below: the lowest byte of the first number is a line's end */
    static const char *const ends[] = {"\n", "\r\n", "\r"};
    static const char *const lines[] = {"ply",
                                        "format binary_little_endian 1.0",
                                        "element vertex 3",
                                        "property uchar x",
                                        "property uchar y",
                                        "property uchar z",
                                        "element face 1",
                                        "property list uchar uchar vertex_indices",
                                        "end_header"};
    for (int e = 0; e < 3; e++) {
        char text[1024] = "";
        for (size_t i = 0; i < sizeof lines / sizeof *lines; i++)
            sprintf(text + strlen(text), "%s%s", lines[i], ends[e]);
        const size_t length = strlen(text);
        memcpy(text + length, "\x0A\x01\x01\x09\x01\x01\x0A\x09\x01\x03\x00\x01\x02", 13);
        lw_foreign_case_write_bytes("b.ply", text, length + 13);
        struct lw_scene *scene = load("b.ply");
        assert_int_equal(scene->mesh[0].triangle_count, 1);
        float x = 0;
        for (uint32_t i = 0; i < 3; i++) x = fmaxf(x, scene->mesh[0].position[i].x);
        assert_float_equal(x, 10, 0);
        lw_scene_destroy(scene);
    }
    /* Assimp takes the bytes of an element that it does not know for those of the next */
    static const char foreign[] =
        "ply\nformat binary_little_endian 1.0\nelement camera 2\nproperty uchar a\n"
        "property list uchar uchar b\nelement vertex 3\nproperty uchar x\n"
        "property uchar y\nproperty uchar z\nelement face 1\n"
        "property list uchar uchar vertex_indices\nend_header\n"
        "\x07\x02\x07\x07\x07\x01\x07\x05\x01\x01\x09\x01\x01\x05\x09\x01\x03\x00\x01\x02";
    lw_foreign_case_write_bytes("camera.ply", foreign, sizeof foreign - 1);
    struct lw_scene *scene = load("camera.ply");
    assert_warned("line 3: \"camera\": is not read");
    assert_float_equal(scene->mesh[0].position[1].x, 9, 0);
    lw_scene_destroy(scene);
    write_picture("wood 1.tga", 200, 10, 10);
    scene = load_text("t.ply", "ply\nformat ascii 1.0\ncomment TextureFile wood 1.tga \t\n" PLY_XYZ
                               "property float s\nproperty float t\n" PLY_FACES ROWS(" 0 0"));
    assert_int_equal(scene->texture_count, 1);
    assert_colour(scene, 1, 1, 1, "a texture alone");
    lw_scene_destroy(scene);
    static const char *const textured[] = {
        "ply\nformat ascii 1.0\ncomment TextureFile wood 1.tga\n" PLY_XYZ
        "property float texture_u\nproperty float texture_v\n" PLY_FACES ROWS(" 0.25 0.5"),
        "ply\nformat ascii 1.0\ncomment TextureFile wood 1.tga\n" PLY_XYZ
        "property float u\nproperty float v\n" PLY_FACES ROWS(" 0.25 0.5"),
        "ply\nformat ascii 1.0\nCOMMENT texturefile wood 1.tga\n" PLY_XYZ
        "element face 1\nproperty list uchar int vertex_indices\nproperty list uchar float "
        "texcoord\nend_header\n"
        "0 0 2\n2 0 2\n2 0 0\n0 0 0\n4 0 1 2 3 8 0.25 0.5 0.25 0.5 0.25 0.5 0.25 0.5\n"};
    for (int i = 0; i < 3; i++) {
        scene = load_text("uv.ply", textured[i]);
        assert_quiet(textured[i]);
        assert_int_equal(scene->texture_count, 1);
        assert_non_null(scene->mesh[0].uv[0]);
        assert_float_equal(scene->mesh[0].uv[0][0].x, 0.25, 0);
        lw_scene_destroy(scene);
    }
    scene = load_text("material.ply",
                      "ply\nformat ascii 1.0\n" PLY_XYZ
                      "element face 1\nproperty list uchar int vertex_indices\nelement material 1\n" RGB(
                          "uchar", "diffuse_red", "diffuse_green",
                          "diffuse_blue") "end_header\n"
                                          "0 0 2\n2 0 2\n2 0 0\n0 0 0\n4 0 1 2 3\n51 102 255\n");
    assert_quiet("material");
    assert_colour(scene, 0.2f, 0.4f, 1, "element material");
    lw_scene_destroy(scene);
    refuse_text("s.ply",
                "ply\nformat ascii 1.0\n" PLY_XYZ
                "element tristrips 1\nproperty list int int vertex_indices\n"
                "end_header\n0 0 2\n2 0 2\n2 0 0\n0 0 0\n4 0 1 3 2\n",
                "no triangles");
    assert_warned("line 7: \"tristrips\": strips are not read");
    refuse_text("h.ply", "ply\nformat ascii 1.0\nfrob\nend_header\n",
                "line 3 of its header, \"frob\", is not known");
    refuse_text("h.ply", "ply\nelement vertex\nend_header\n", "line 2 of its header is no element");
    refuse_text("h.ply", "ply\nelement vertex 1\nproperty x\nend_header\n",
                "line 3 of its header is no property");
}

/* ---- STL ---- */

#define STL                                                                                                  \
    "solid one\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 2 0 0\nvertex 0 2 0\nendloop\n"         \
    "endfacet\nendsolid one\n"

static void stl_is_read_however_it_is_written(void **state) {
    (void)state;
    static const char *const texts[] = {
        STL,
        "\xEF\xBB\xBF" STL,
        "\n\n  " STL,
        "SOLID one\nFACET NORMAL 0 0 1\nOUTER LOOP\nVERTEX 0 0 0\nVertex 2E0 0 0\nVERTEX 0 2 0\nENDLOOP\n"
        "ENDFACET\nENDSOLID one\n",
        "solid one\r  facet normal 0 0 1 \r\touter loop\rvertex 0 0 0\rvertex 2 0 0\t\rvertex 0 2 "
        "0\rendloop\r"
        "endfacet\rendsolid one\r",
        "solid one\r\nfacet normal 0 0 1\r\nouter loop\r\nvertex 0 0 0\r\nvertex 2 0 0\r\nvertex 0 2 0\r\n"
        "endloop\r\nendfacet\r\nendsolid\r\n",
    };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        struct lw_scene *scene = load_text("one.stl", texts[i]);
        assert_quiet(texts[i]);
        assert_string_equal(scene->mesh[0].name, "one");
        assert_int_equal(scene->mesh[0].triangle_count, 1);
        assert_float_equal(scene->mesh[0].position[1].x, 2, 0);
        assert_colour(scene, GREY, texts[i]);
        lw_scene_destroy(scene);
    }
}

static struct lw_scene *load_binary_stl(const char *header, unsigned first, unsigned second) {
    uint8_t binary[84 + 100] = {[80] = 2};
    const float facet[12] = {0, 0, 1, 0, 0, 0, 3, 0, 0, 0, 3, 0};
    memcpy(binary, header, strlen(header));
    for (int i = 0; i < 2; i++) {
        float corner[12];
        memcpy(corner, facet, sizeof corner);
        corner[5] = corner[8] = corner[11] = (float)i;
        memcpy(binary + 84 + 50 * i, corner, sizeof corner);
    }
    binary[84 + 48] = (uint8_t)first, binary[84 + 49] = (uint8_t)(first >> 8);
    binary[84 + 98] = (uint8_t)second, binary[84 + 99] = (uint8_t)(second >> 8);
    lw_foreign_case_write_bytes("two.stl", binary, sizeof binary);
    return load("two.stl");
}

static void stl_colours_are_those_of_a_screen(void **state) {
    (void)state;
    struct lw_scene *scene = load_binary_stl("solid, but binary", 0, 0);
    assert_quiet("no colour");
    assert_colour(scene, GREY, "no colour");
    assert_null(scene->mesh[0].colour);
    lw_scene_destroy(scene);
    /* red on one facet; the second is grey, as uncoloured facets are */
    scene = load_binary_stl("", 0x8000 | 31 << 10, 0);
    assert_quiet("one colour");
    assert_colour(scene, 1, 1, 1, "colours of facets");
    for (uint32_t i = 0; i < scene->mesh[0].vertex_count; i++)
        assert_float_equal(scene->mesh[0].colour[i].y, scene->mesh[0].position[i].z > 0 ? 0.6 : 0, 1e-6);
    lw_scene_destroy(scene);
    scene = load_binary_stl("COLOR=\xFF\x80\x80\xFF", 0, 0);
    assert_quiet("one colour of all");
    assert_colour(scene, 1, 0.2158605f, 0.2158605f, "COLOR=");
    lw_scene_destroy(scene);
    scene = load_binary_stl("COLOR=\xFF\x80\x80\xFF", 0, 31);
    assert_warned("facet 1 has a colour of its own: it is not read");
    assert_colour(scene, 1, 0.2158605f, 0.2158605f, "COLOR=");
    lw_scene_destroy(scene);
}

/* ---- Collada ---- */

static const char dae_format[] =
    "<?xml version=\"1.0\"?><COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" "
    "version=\"1.4.1\">"
    "<asset><up_axis>Y_UP</up_axis></asset>"
    "<library_cameras><camera id=\"c\"><optics><technique_common>%s</technique_common></optics></camera>"
    "</library_cameras>"
    "<library_lights><light id=\"l\"><technique_common>%s</technique_common></light></library_lights>"
    "<library_geometries><geometry id=\"g\"><mesh><source id=\"p\"><float_array id=\"pa\" count=\"9\">0 0 0 "
    "1 0 0 "
    "1 1 0</float_array><technique_common><accessor source=\"#pa\" count=\"3\" stride=\"3\"><param "
    "name=\"X\" "
    "type=\"float\"/><param name=\"Y\" type=\"float\"/><param name=\"Z\" type=\"float\"/></accessor>"
    "</technique_common></source><vertices id=\"v\"><input semantic=\"POSITION\" source=\"#p\"/></vertices>"
    "<triangles count=\"1\"><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/><p>0 1 2</p></triangles>"
    "</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id=\"vs\">"
    "<node id=\"n\"><instance_geometry url=\"#g\"/></node><node id=\"ln\"><instance_light url=\"#l\"/></node>"
    "<node id=\"cn\"><instance_camera url=\"#c\"/></node></visual_scene></library_visual_scenes>"
    "<scene><instance_visual_scene url=\"#vs\"/></scene></COLLADA>\n";

static struct lw_scene *load_dae(const char *camera, const char *light) {
    char text[4096];
    snprintf(text, sizeof text, dae_format, camera, light);
    return load_text("d.dae", text);
}

#define SPOT(inner) "<spot><color>5 5 5</color><falloff_angle>60</falloff_angle>" inner "</spot>"
#define SQUARE      "<perspective><xfov>60</xfov></perspective>"

static void collada_spots_are_soft_by_an_exponent_alone(void **state) {
    (void)state;
    static const struct {
        const char *light;
        bool soft;
    } cases[] = {
        {SPOT(""), false},
        {SPOT("<falloff_exponent>0</falloff_exponent>"), false},
        {SPOT("<falloff_exponent sid=\"e\"> 0.0 </falloff_exponent>"), false},
        {SPOT("<falloff_exponent/>"), false},
        {SPOT("<!-- <falloff_exponent>1</falloff_exponent> -->"), false},
        {SPOT("<falloff_exponent>0.15</falloff_exponent>"), true},
        {SPOT("<falloff_exponent>1</falloff_exponent>"), true},
        {SPOT("<falloff_exponent sid=\"e\">16</falloff_exponent><!-- </spot> -->"), true},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct lw_scene *scene = load_dae(SQUARE, cases[i].light);
        assert_quiet(cases[i].light);
        assert_int_equal(scene->light_count, 1);
        const struct lw_light *light = &scene->light[0];
        assert_float_equal(light->outer_cone, LW_PI / 6, 1e-5);
        const float inner = cases[i].soft ? 0 : LW_LIGHT_CONE_EDGE * LW_PI / 6;
        if (fabsf(light->inner_cone - inner) > 1e-5f)
            fail_msg("%s: %g", cases[i].light, (double)light->inner_cone);
        lw_scene_destroy(scene);
    }
    struct lw_scene *scene = load_dae(SQUARE, "<point><color>4 4 4</color><linear_attenuation>0.5"
                                              "</linear_attenuation></point>");
    assert_warned("constant and linear attenuation of lights are ignored");
    lw_scene_destroy(scene);
}

static void collada_cameras_are_as_high_as_they_say(void **state) {
    (void)state;
    const float high = LW_PI / 3; /* 60 degrees */
    const struct {
        const char *camera;
        float fov_y;
    } cases[] = {
        {SQUARE, high},
        {"<perspective><yfov>60</yfov></perspective>", high},
        {"<perspective><yfov>60</yfov><aspect_ratio>2</aspect_ratio></perspective>", high},
        {"<perspective><xfov sid=\"x\">80</xfov><yfov>60</yfov></perspective>", high},
        {"<perspective><xfov>90</xfov><aspect_ratio>2</aspect_ratio></perspective>", 2 * atanf(0.5f)},
        {"<orthographic><xmag>5</xmag></orthographic>", 0},
        {"<orthographic><ymag>5</ymag><aspect_ratio>1</aspect_ratio></orthographic>", 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct lw_scene *scene = load_dae(cases[i].camera, SPOT(""));
        if (cases[i].fov_y == 0) {
            assert_warned("orthographic cameras are ignored");
            assert_int_equal(scene->camera_count, 0);
        } else if (fabsf(scene->camera[0].fov_y - cases[i].fov_y) > 1e-5f) {
            fail_msg("%s: %g", cases[i].camera, (double)scene->camera[0].fov_y);
        }
        lw_scene_destroy(scene);
    }
}

int main(void) {
    lw_log_init("test_foreign_text", LW_LOG_WARNING);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(obj_is_read_however_it_is_written),
        cmocka_unit_test(mtl_is_read_however_it_is_written),
        cmocka_unit_test(wide_text_is_named),
        cmocka_unit_test(libraries_are_found),
        cmocka_unit_test(libraries_and_materials_are_bounded),
        cmocka_unit_test(textures_lie_beside_their_library),
        cmocka_unit_test(map_options_move_textures_or_are_named),
        cmocka_unit_test(map_options_change_values),
        cmocka_unit_test(rare_statements_of_mtl_are_named),
        cmocka_unit_test(rare_statements_of_obj_are_named),
        cmocka_unit_test(broken_lines_are_named),
        cmocka_unit_test(vertices_have_weights_colours_and_short_coordinates),
        cmocka_unit_test(ply_colours_have_many_names),
        cmocka_unit_test(ply_is_read_however_it_is_written),
        cmocka_unit_test(stl_is_read_however_it_is_written),
        cmocka_unit_test(stl_colours_are_those_of_a_screen),
        cmocka_unit_test(collada_spots_are_soft_by_an_exponent_alone),
        cmocka_unit_test(collada_cameras_are_as_high_as_they_say),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
