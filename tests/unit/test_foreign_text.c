/* OBJ and MTL as people and exporters write them: what readers take, name and skip, line by line of the
 * tables of docs/importing_other.md. */
#include "tests/support/foreign_case.h"

#include "common/base/log.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void write_red_library(void) { lw_foreign_case_write_text("m.mtl", "newmtl red\nKd 0.8 0.1 0.1\n"); }

/* ---- text ---- */

static void obj_is_read_however_it_is_written(void **state) {
    (void)state;
    static const char *const texts[] = {
        "\xEF\xBB\xBFmtllib m.mtl\nusemtl red\n" LW_FOREIGN_CASE_FLOOR LW_FOREIGN_CASE_FACE,
        "mtllib m.mtl  \nusemtl red \t\n" LW_FOREIGN_CASE_FLOOR "f 1 2 3 4 \t\n",
        "mtllib m.mtl # a tail\nusemtl red # a tail\n" LW_FOREIGN_CASE_FLOOR
        "f 1 2 3 4 # a tail\nf 4 3 2#tail\n",
        "mtllib m.mtl\nusemtl red\nv 0 0 2 # a tail\nv 2 0 2 #tail\nv 2 0 0\nv 0 0 0\nf 1 2 3 4\n",
        "mtllib\tm.mtl\t\nusemtl\tred\t\n\tv\t0 0 2\n  v 2 0 2\nv 2 0\t0\nv 0 0 0\n\tf 1 2 3 4\n",
        "mtllib m.mtl\r\nusemtl red\r\nv 0 0 2\r\nv 2 0 2\r\nv 2 0 0\r\nv 0 0 0\r\nf 1 2 \\\r\n3 4\r\n",
        "mtllib m.mtl\rusemtl red\rv 0 0 2\rv 2 0 2\rv 2 0 0\rv 0 0 0\rf 1 2 3 4\r",
        "MTLLIB m.mtl\nUseMtl red\nV 0 0 2\nV 2 0 2\nV 2 0 0\nV 0 0 0\nF 1 2 3 4",
        "mtllib m.mtl\nusemtl \\\nred\n" LW_FOREIGN_CASE_FLOOR "f 1 \\\n2 \\ \t\n3 4\n",
        "# a path: C:\\scenes\\\nmtllib m.mtl\nusemtl red\n" LW_FOREIGN_CASE_FLOOR "\n\f\nf 1 2 3 4\v\n\x1a",
        "mtllib \"m.mtl\"\nusemtl red\n" LW_FOREIGN_CASE_FLOOR "f 1/ 2/ 3// 4\n",
        "usemtl red\nf 1 2 3 4\n" LW_FOREIGN_CASE_FLOOR "mtllib m.mtl\n",
        "mtllib m.mtl\nusemtl red\n" LW_FOREIGN_CASE_FLOOR "f -4/-4 -3/-3 -2/-2 -1/-1\n",
        "mtllib m.mtl\nusemtl red\n" LW_FOREIGN_CASE_FLOOR "g a b\no my thing # tail\ng\ns off\nfo 1 2 3 4\n",
        "mtllib m.mtl\nusemtl red\nv 0,0 -.0 2,0\nv +2 .0 2.\nv 2e0 ,0 +.0\nv 0 0 0\nf 1 2 3 4\n",
    };
    write_red_library();
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        struct lw_scene *scene = lw_foreign_case_scene_of("text.obj", texts[i]);
        lw_foreign_case_expect_silence(texts[i]);
        lw_foreign_case_expect_colour(scene, LW_FOREIGN_CASE_RED, texts[i]);
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
    lw_foreign_case_write_texel("red.tga", 200, 10, 10);
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        lw_foreign_case_write_text("t.mtl", texts[i]);
        struct lw_scene *scene = lw_foreign_case_scene_of(
            "text.obj", "mtllib t.mtl\nusemtl t\n" LW_FOREIGN_CASE_FLOOR LW_FOREIGN_CASE_FACE);
        lw_foreign_case_expect_silence(texts[i]);
        lw_foreign_case_expect_colour(scene, LW_FOREIGN_CASE_RED, texts[i]);
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
        snprintf(text, sizeof text, "mtllib t.mtl\nusemtl %s\n" LW_FOREIGN_CASE_FLOOR LW_FOREIGN_CASE_FACE,
                 names[i]);
        struct lw_scene *scene = lw_foreign_case_scene_of("text.obj", text);
        lw_foreign_case_expect_silence(names[i]);
        assert_string_equal(lw_foreign_case_first_material(scene)->name, names[i]);
        lw_foreign_case_expect_colour(scene, LW_FOREIGN_CASE_RED, names[i]);
        lw_scene_destroy(scene);
    }
}

static void wide_text_is_named(void **state) {
    (void)state;
    static const char *const names[] = {"wide.obj", "wide.ply", "wide.stl", "wide.dae"};
    static const char *const starts[] = {"\xFF\xFEv", "\xFE\xFFv", "\xFF\xFEv"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        lw_foreign_case_refuse_text(names[i], starts[i % 3],
                                    "is UTF-16 text, which is not read: save it as UTF-8");
    lw_foreign_case_write_text("wide.mtl", "\xFF\xFEn");
    struct lw_scene *scene = lw_foreign_case_scene_of(
        "text.obj", "mtllib wide.mtl\nusemtl t\n" LW_FOREIGN_CASE_FLOOR LW_FOREIGN_CASE_FACE);
    lw_foreign_case_expect_line("the material library \"wide.mtl\" is UTF-16: save it as UTF-8");
    lw_foreign_case_expect_colour(scene, LW_FOREIGN_CASE_GREY, "wide.mtl");
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
        {"mtllib m.mtl my mats/a b.mtl", "red", {LW_FOREIGN_CASE_RED}, NULL}, /* the first of two counts */
        {"mtllib m.mtl my mats/a b.mtl", "blue", {0.1f, 0.1f, 0.8f}, NULL},
        {"mtllib my mats\\a b.mtl M.MTL", "blue", {0.1f, 0.1f, 0.8f}, NULL},
        {"mtllib m.mtl\nmtllib my mats/a b.mtl\nmtllib m.mtl", "blue", {0.1f, 0.1f, 0.8f}, NULL},
        {"mtllib other/none", "green", {0.1f, 0.8f, 0.1f}, NULL},
        {"mtllib m.mtl other/none", "green", {0.1f, 0.8f, 0.1f}, NULL},
        {"mtllib other/none gone", "green", {0.1f, 0.8f, 0.1f}, "library \"gone\" is not there"},
        {"mtllib C:\\work\\m.mtl", "red", {LW_FOREIGN_CASE_RED}, NULL},
        {"mtllib m.mtl gone.mtl",
         "red",
         {LW_FOREIGN_CASE_RED},
         "the material library \"gone.mtl\" is not there"},
        {"mtllib gone.mtl m.mtl lost.mtl",
         "red",
         {LW_FOREIGN_CASE_RED},
         "library \"gone.mtl\" (and 1 more) is not there"},
        {"mtllib ../m.mtl", "red", {LW_FOREIGN_CASE_RED}, NULL}, /* no file outside of the folder is opened */
        {"mtllib", "red", {LW_FOREIGN_CASE_GREY}, "line 1: \"mtllib\": names no library"},
        {"mtllib m.mtl",
         "green",
         {LW_FOREIGN_CASE_GREY},
         "materials that no library has are grey: \"green\""},
        {"mtllib m.mtl", "RED", {LW_FOREIGN_CASE_GREY}, "materials that no library has are grey: \"RED\""},
        {"mtllib m.mtl", "", {LW_FOREIGN_CASE_GREY}, "materials that no library has are grey: \"\""},
        {"# none", "red", {LW_FOREIGN_CASE_GREY}, "materials that no library has are grey: \"red\""},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[512];
        snprintf(text, sizeof text, "%s\nusemtl %s\n" LW_FOREIGN_CASE_FLOOR LW_FOREIGN_CASE_FACE,
                 cases[i].lines, cases[i].used);
        struct lw_scene *scene = lw_foreign_case_scene_of("names.obj", text);
        if (cases[i].warning)
            lw_foreign_case_expect_line(cases[i].warning);
        else
            lw_foreign_case_expect_silence(text);
        lw_foreign_case_expect_colour(scene, cases[i].colour[0], cases[i].colour[1], cases[i].colour[2],
                                      text);
        lw_scene_destroy(scene);
    }
    struct lw_scene *scene = lw_foreign_case_scene_of(
        "names.obj", "mtllib m.mtl\n" LW_FOREIGN_CASE_FLOOR "usemtl a\n" LW_FOREIGN_CASE_FACE
                     "usemtl b\n" LW_FOREIGN_CASE_FACE "usemtl red\n" LW_FOREIGN_CASE_FACE
                     "usemtl c\n" LW_FOREIGN_CASE_FACE);
    lw_foreign_case_expect_line(
        "materials that no library has are grey: \"a\" and 2 more"); /* one line for all */
    assert_int_equal(strchr(lw_foreign_case_talk(), '\n')[1], 0);
    lw_scene_destroy(scene);
}

static void libraries_and_materials_are_bounded(void **state) {
    (void)state;
    write_red_library();
    char *text = malloc(2000000), *at = text;
    at += sprintf(at, "mtllib");
    for (int i = 0; i < 1200; i++) at += sprintf(at, " gone%d.mtl", i);
    sprintf(at, " m.mtl\nusemtl red\n" LW_FOREIGN_CASE_FLOOR LW_FOREIGN_CASE_FACE);
    struct lw_scene *scene = lw_foreign_case_scene_of("many.obj", text);
    lw_foreign_case_expect_line(
        "more than 256 material libraries, or 1000 names of them: the rest is not read");
    lw_foreign_case_expect_line("materials that no library has are grey: \"red\"");
    lw_scene_destroy(scene);
    at = text;
    for (int i = 0; i < 65540; i++) at += sprintf(at, "usemtl %d\n", i);
    lw_foreign_case_refuse_text("many.obj", text, "line 65538: uses more than 65536 materials");
    free(text);
}

static void textures_lie_beside_their_library(void **state) {
    (void)state;
    lw_foreign_case_make_folder("mats");
    lw_foreign_case_make_folder("mats/tex");
    lw_foreign_case_make_folder("pics");
    lw_foreign_case_write_texel("mats/tex/deep blue.tga", 10, 10, 200);
    lw_foreign_case_write_texel("mats/flat.tga", 1, 2, 3);
    lw_foreign_case_write_texel("flat.tga", 4, 5, 6);
    lw_foreign_case_write_texel("pics/far.tga", 7, 8, 9);
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
        struct lw_scene *scene = lw_foreign_case_scene_of(
            "beside.obj", "mtllib mats/sub.mtl\nusemtl t\n" LW_FOREIGN_CASE_FLOOR LW_FOREIGN_CASE_FACE);
        if (scene->texture_count != 1) fail_msg("%s: %s", cases[i].path, lw_foreign_case_talk());
        assert_int_equal(scene->texture[0].rgba[0], cases[i].red);
        lw_scene_destroy(scene);
    }
    lw_foreign_case_write_text("mats/sub.mtl", "newmtl t\nmap_Kd ../../outside.tga\n");
    struct lw_scene *scene = lw_foreign_case_scene_of(
        "beside.obj", "mtllib mats/sub.mtl\nusemtl t\n" LW_FOREIGN_CASE_FLOOR LW_FOREIGN_CASE_FACE);
    lw_foreign_case_expect_line("texture \"../../outside.tga\": is not there");
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
    lw_foreign_case_write_texel("my red.tga", 200, 10, 10);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[256];
        snprintf(text, sizeof text, "newmtl t\nmap_Kd %s my red.tga\n", cases[i].options);
        lw_foreign_case_write_text("o.mtl", text);
        struct lw_scene *scene = lw_foreign_case_scene_of(
            "options.obj", "mtllib o.mtl\nusemtl t\n" LW_FOREIGN_CASE_FLOOR LW_FOREIGN_CASE_FACE);
        if (cases[i].warning)
            lw_foreign_case_expect_line(cases[i].warning);
        else
            lw_foreign_case_expect_silence(text);
        if (scene->texture_count != 1) fail_msg("%s: no texture: %s", text, lw_foreign_case_talk());
        const float *m = lw_foreign_case_first_material(scene)->base_colour_texture.transform;
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
    return lw_foreign_case_scene_of("options.obj",
                                    "mtllib o.mtl\nusemtl t\n" LW_FOREIGN_CASE_FLOOR LW_FOREIGN_CASE_FACE);
}

static void map_options_change_values(void **state) {
    (void)state;
    lw_foreign_case_write_texel("p.tga", 188, 64, 0); /* 0.503, 0.0513, 0 linear */
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
        assert_float_equal(lw_foreign_case_first_material(scene)->emission[0], 3, 0);
        assert_int_equal(scene->texture[0].rgba[0], 188);
        lw_scene_destroy(scene);
    }
    scene = load_map("map_Ke -mm 0.1 0.5 p.tga");
    assert_float_equal(lw_foreign_case_first_material(scene)->emission[0], 1, 0);
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
        const struct lw_texture_use *use = &lw_foreign_case_first_material(scene)->base_colour_texture;
        assert_int_not_equal(use->texture, LW_SCENE_NONE);
        if (scene->texture[use->texture].rgba[3] != cases[i].alpha)
            fail_msg("%s: %u", cases[i].line, scene->texture[use->texture].rgba[3]);
        lw_scene_destroy(scene);
    }
    scene = load_map("map_Kd p.tga\nmap_d -s 2 2 p.tga\nmap_d -imfchan r -s 2 p.tga");
    lw_foreign_case_expect_line("an opacity map lies otherwise than the colour beside it");
    lw_scene_destroy(scene);
    scene = load_map("map_Kd # none");
    lw_foreign_case_expect_line("line 3: \"map_Kd\": names no picture");
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
        struct lw_scene *scene = lw_foreign_case_scene_of(
            "rare.obj", "mtllib rare.mtl\nusemtl t\n" LW_FOREIGN_CASE_FLOOR LW_FOREIGN_CASE_FACE);
        lw_foreign_case_expect_line(cases[i].warning);
        assert_int_equal(strchr(lw_foreign_case_talk(), '\n')[1], 0); /* one line */
        lw_foreign_case_expect_colour(scene, LW_FOREIGN_CASE_RED, text);
        assert_int_equal(lw_foreign_case_first_material(scene)->alpha_mode, LW_ALPHA_OPAQUE);
        lw_scene_destroy(scene);
    }
    lw_foreign_case_write_text("rare.mtl", "Kd 1 1 1\nnewmtl t\nKd 0.5\nTr 0.75\nd 0.25\nTr 0.9\nKe 2\n");
    struct lw_scene *scene = lw_foreign_case_scene_of(
        "rare.obj", "mtllib rare.mtl\nusemtl t\n" LW_FOREIGN_CASE_FLOOR LW_FOREIGN_CASE_FACE);
    lw_foreign_case_expect_line("line 1: \"Kd\": stands before the first newmtl");
    lw_foreign_case_expect_colour(scene, 0.5f, 0.5f, 0.5f, "one number");               /* is all three */
    assert_float_equal(lw_foreign_case_first_material(scene)->base_colour[3], 0.25, 0); /* d goes before Tr */
    assert_float_equal(lw_foreign_case_first_material(scene)->emission[2], 2, 0);
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
        snprintf(text, sizeof text,
                 "mtllib m.mtl\nusemtl red\n" LW_FOREIGN_CASE_FLOOR "%s\n" LW_FOREIGN_CASE_FACE,
                 cases[i].line);
        struct lw_scene *scene = lw_foreign_case_scene_of("rare.obj", text);
        lw_foreign_case_expect_line(cases[i].warning);
        lw_foreign_case_expect_colour(scene, LW_FOREIGN_CASE_RED, text);
        assert_int_equal(scene->mesh[0].triangle_count, 2);
        lw_scene_destroy(scene);
    }
    /* ten kinds are named, and the number of the rest */
    char text[2048] = LW_FOREIGN_CASE_FLOOR LW_FOREIGN_CASE_FACE;
    for (int i = 0; i < 30; i++) sprintf(text + strlen(text), "frob%d\n", i);
    struct lw_scene *scene = lw_foreign_case_scene_of("rare.obj", text);
    lw_foreign_case_expect_line("\"frob9\"");
    assert_null(strstr(lw_foreign_case_talk(), "\"frob10\""));
    lw_foreign_case_expect_line("20 more lines of other kinds are not read");
    lw_scene_destroy(scene);
}

static void broken_lines_are_named(void **state) {
    (void)state;
    lw_foreign_case_refuse_text("b.obj", "v 0 0\nv 1 0 0\n", "line 1: v has 2 numbers, not three");
    lw_foreign_case_refuse_text("b.obj", "v 0 0 0\nv 2 fish 0\n", "line 2: v: \"fish\" is no number");
    lw_foreign_case_refuse_text("b.obj", "v 0 0 0\nv 2 0x1 0\n", "line 2: v: \"0x1\" is no number");
    lw_foreign_case_refuse_text("b.obj", "vt\n", "line 1: vt has no number");
    lw_foreign_case_refuse_text("b.obj", "vn 0 1\n", "line 1: vn has 2 numbers, not three");
    lw_foreign_case_refuse_text("b.obj", LW_FOREIGN_CASE_FLOOR "f 0 1 2\n",
                                "line 9: a corner names v 0; they count from 1");
    lw_foreign_case_refuse_text("b.obj", LW_FOREIGN_CASE_FLOOR "f 1 2 9\n",
                                "line 9: v 9 is out of range: there are 4");
    lw_foreign_case_refuse_text("b.obj", LW_FOREIGN_CASE_FLOOR "f 1/1 2/2 3/9\n",
                                "line 9: vt 9 is out of range: there are 4");
    lw_foreign_case_refuse_text("b.obj", LW_FOREIGN_CASE_FLOOR "f 1//1 2//1 3//1\n",
                                "line 9: vn 1 is out of range: there are 0");
    lw_foreign_case_refuse_text("b.obj", LW_FOREIGN_CASE_FLOOR "f 1 2 -5\n",
                                "line 9: v -5 is out of range: there are 4 before it");
    lw_foreign_case_refuse_text("b.obj", LW_FOREIGN_CASE_FLOOR "f 1.0 2 3\n",
                                "line 9: \"1.0\" is no corner of a face");
    lw_foreign_case_refuse_text("b.obj", LW_FOREIGN_CASE_FLOOR "f 1 2 3/1/1/1\n", "is no corner of a face");
    lw_foreign_case_refuse_text("b.obj", "v 0 0 0 1 \\\n0 fish\n", "line 1: v: \"fish\" is no number");
    lw_foreign_case_refuse_text("b.obj", "hello\n",
                                "is no OBJ file that can be read: line 1 begins with \"hello\"");
    lw_foreign_case_refuse_text("b.obj", "curv 1 2\n", "has no triangles");
}

/* ---- vertices ---- */

static void vertices_have_weights_colours_and_short_coordinates(void **state) {
    (void)state;
    struct lw_scene *scene =
        lw_foreign_case_scene_of("w.obj", "v 0 0 4 2\nv 4 0 4 2\nv 4 0 0 2\nv 0 0 0 1.0\nf 1 2 3 4\n");
    float largest = 0;
    for (uint32_t i = 0; i < scene->mesh[0].vertex_count; i++)
        largest = fmaxf(largest, scene->mesh[0].position[i].x);
    assert_float_equal(largest, 2, 0);
    lw_scene_destroy(scene);
    /* some with a colour, some without, which are white */
    scene =
        lw_foreign_case_scene_of("c.obj", "v 0 0 2\nv 2 0 2 1 0 0\nv 2 0 0 1 0 0\nv 0 0 0 1\nf 1 2 3 4\n");
    lw_foreign_case_expect_line("vertices without a colour beside some that have one are white");
    const struct lw_mesh *mesh = &scene->mesh[0];
    assert_non_null(mesh->colour);
    for (uint32_t i = 0; i < mesh->vertex_count; i++)
        assert_float_equal(mesh->colour[i].y, mesh->position[i].x > 0 ? 0 : 1, 0);
    lw_scene_destroy(scene);
    scene = lw_foreign_case_scene_of(
        "vt.obj",
        "v 0 0 2\nv 2 0 2\nv 2 0 0\nv 0 0 0\nvt 0\nvt 1 # u\nvt 1 1\nvt 0 1 5\n" LW_FOREIGN_CASE_FACE);
    lw_foreign_case_expect_silence("vt");
    assert_non_null(scene->mesh[0].uv[0]);
    lw_scene_destroy(scene);
    scene = lw_foreign_case_scene_of(
        "hex.obj", "v 0 0 0\nv 1 0 0\nv 2 0 -1\nv 1 0 -2\nv 0 0 -2\nv -1 0 -1\nf 1 2 3 4 5 6\n");
    assert_int_equal(scene->mesh[0].triangle_count, 4);
    lw_scene_destroy(scene);
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
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
