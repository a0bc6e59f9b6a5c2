/* PLY, STL and Collada as people and exporters write them: what readers take, name and skip. */
#include "tests/support/foreign_case.h"

#include "common/base/log.h"

#include <stdio.h>
#include <string.h>

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
        struct lw_scene *scene = lw_foreign_case_scene_of("c.ply", cases[i].text);
        if (cases[i].warning)
            lw_foreign_case_expect_line(cases[i].warning);
        else
            lw_foreign_case_expect_silence(cases[i].text);
        const struct lw_mesh *mesh = &scene->mesh[0];
        assert_int_equal(mesh->colour != NULL, cases[i].coloured);
        if (cases[i].coloured) assert_float_equal(mesh->colour[0].x, 0.5775804, 1e-4); /* 200 of 255 */
        const float c = cases[i].coloured ? 1 : 0.6f;
        lw_foreign_case_expect_colour(scene, c, c, c, cases[i].text);
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
            struct lw_scene *scene = lw_foreign_case_scene_of("e.ply", text);
            lw_foreign_case_expect_silence(text);
            assert_int_equal(scene->mesh[0].triangle_count, 2);
            assert_float_equal(scene->mesh[0].colour[0].x, 0.5775804, 1e-4);
            lw_scene_destroy(scene);
        }
    }
    /* a header of each end before bytes that could be one */
    static const char rows[] =
        "ply\nformat ascii 1.0\n" PLY_XYZ PLY_FACES
        "\n# rows\n\t0 0 2 \n2\t0 2 # a tail\n\n2. .0 0\ncomment x\n0 0 0\n 4 0 1 2 3\n\n";
    struct lw_scene *in_rows = lw_foreign_case_scene_of("rows.ply", rows);
    lw_foreign_case_expect_silence(rows);
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
        struct lw_scene *scene = lw_foreign_case_scene("b.ply");
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
    struct lw_scene *scene = lw_foreign_case_scene("camera.ply");
    lw_foreign_case_expect_line("line 3: \"camera\": is not read");
    assert_float_equal(scene->mesh[0].position[1].x, 9, 0);
    lw_scene_destroy(scene);
    lw_foreign_case_write_texel("wood 1.tga", 200, 10, 10);
    scene =
        lw_foreign_case_scene_of("t.ply", "ply\nformat ascii 1.0\ncomment TextureFile wood 1.tga \t\n" PLY_XYZ
                                          "property float s\nproperty float t\n" PLY_FACES ROWS(" 0 0"));
    assert_int_equal(scene->texture_count, 1);
    lw_foreign_case_expect_colour(scene, 1, 1, 1, "a texture alone");
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
        scene = lw_foreign_case_scene_of("uv.ply", textured[i]);
        lw_foreign_case_expect_silence(textured[i]);
        assert_int_equal(scene->texture_count, 1);
        assert_non_null(scene->mesh[0].uv[0]);
        assert_float_equal(scene->mesh[0].uv[0][0].x, 0.25, 0);
        lw_scene_destroy(scene);
    }
    scene = lw_foreign_case_scene_of(
        "material.ply", "ply\nformat ascii 1.0\n" PLY_XYZ
                        "element face 1\nproperty list uchar int vertex_indices\nelement material 1\n" RGB(
                            "uchar", "diffuse_red", "diffuse_green",
                            "diffuse_blue") "end_header\n"
                                            "0 0 2\n2 0 2\n2 0 0\n0 0 0\n4 0 1 2 3\n51 102 255\n");
    lw_foreign_case_expect_silence("material");
    lw_foreign_case_expect_colour(scene, 0.2f, 0.4f, 1, "element material");
    lw_scene_destroy(scene);
    lw_foreign_case_refuse_text("s.ply",
                                "ply\nformat ascii 1.0\n" PLY_XYZ
                                "element tristrips 1\nproperty list int int vertex_indices\n"
                                "end_header\n0 0 2\n2 0 2\n2 0 0\n0 0 0\n4 0 1 3 2\n",
                                "no triangles");
    lw_foreign_case_expect_line("line 7: \"tristrips\": strips are not read");
    lw_foreign_case_refuse_text("h.ply", "ply\nformat ascii 1.0\nfrob\nend_header\n",
                                "line 3 of its header, \"frob\", is not known");
    lw_foreign_case_refuse_text("h.ply", "ply\nelement vertex\nend_header\n",
                                "line 2 of its header is no element");
    lw_foreign_case_refuse_text("h.ply", "ply\nelement vertex 1\nproperty x\nend_header\n",
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
        struct lw_scene *scene = lw_foreign_case_scene_of("one.stl", texts[i]);
        lw_foreign_case_expect_silence(texts[i]);
        assert_string_equal(scene->mesh[0].name, "one");
        assert_int_equal(scene->mesh[0].triangle_count, 1);
        assert_float_equal(scene->mesh[0].position[1].x, 2, 0);
        lw_foreign_case_expect_colour(scene, LW_FOREIGN_CASE_GREY, texts[i]);
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
    return lw_foreign_case_scene("two.stl");
}

static void stl_colours_are_those_of_a_screen(void **state) {
    (void)state;
    struct lw_scene *scene = load_binary_stl("solid, but binary", 0, 0);
    lw_foreign_case_expect_silence("no colour");
    lw_foreign_case_expect_colour(scene, LW_FOREIGN_CASE_GREY, "no colour");
    assert_null(scene->mesh[0].colour);
    lw_scene_destroy(scene);
    /* red on one facet; the second is grey, as uncoloured facets are */
    scene = load_binary_stl("", 0x8000 | 31 << 10, 0);
    lw_foreign_case_expect_silence("one colour");
    lw_foreign_case_expect_colour(scene, 1, 1, 1, "colours of facets");
    for (uint32_t i = 0; i < scene->mesh[0].vertex_count; i++)
        assert_float_equal(scene->mesh[0].colour[i].y, scene->mesh[0].position[i].z > 0 ? 0.6 : 0, 1e-6);
    lw_scene_destroy(scene);
    scene = load_binary_stl("COLOR=\xFF\x80\x80\xFF", 0, 0);
    lw_foreign_case_expect_silence("one colour of all");
    lw_foreign_case_expect_colour(scene, 1, 0.2158605f, 0.2158605f, "COLOR=");
    lw_scene_destroy(scene);
    scene = load_binary_stl("COLOR=\xFF\x80\x80\xFF", 0, 31);
    lw_foreign_case_expect_line("facet 1 has a colour of its own: it is not read");
    lw_foreign_case_expect_colour(scene, 1, 0.2158605f, 0.2158605f, "COLOR=");
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
    return lw_foreign_case_scene_of("d.dae", text);
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
        lw_foreign_case_expect_silence(cases[i].light);
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
    lw_foreign_case_expect_line("constant and linear attenuation of lights are ignored");
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
            lw_foreign_case_expect_line("orthographic cameras are ignored");
            assert_int_equal(scene->camera_count, 0);
        } else if (fabsf(scene->camera[0].fov_y - cases[i].fov_y) > 1e-5f) {
            fail_msg("%s: %g", cases[i].camera, (double)scene->camera[0].fov_y);
        }
        lw_scene_destroy(scene);
    }
}

int main(void) {
    lw_log_init("test_foreign_formats", LW_LOG_WARNING);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ply_colours_have_many_names),
        cmocka_unit_test(ply_is_read_however_it_is_written),
        cmocka_unit_test(stl_is_read_however_it_is_written),
        cmocka_unit_test(stl_colours_are_those_of_a_screen),
        cmocka_unit_test(collada_spots_are_soft_by_an_exponent_alone),
        cmocka_unit_test(collada_cameras_are_as_high_as_they_say),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
