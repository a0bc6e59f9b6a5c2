/* Gloss and relief of MTL, FBX and Collada. */
#include "tests/support/foreign_case.h"

#include "common/base/log.h"

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

static struct lw_scene *load_mtl(const char *lines) {
    char text[1024];
    snprintf(text, sizeof text, "newmtl t\n%s\n", lines);
    lw_foreign_case_write_text("t.mtl", text);
    lw_foreign_case_write_text("t.obj", "mtllib t.mtl\nusemtl t\n" QUAD FACE);
    return lw_foreign_case_scene("t.obj");
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
        if (lw_foreign_case_first_material(scene)->finish || scene->mesh[0].tangent ||
            *lw_foreign_case_talk())
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
        const struct lw_finish *f = lw_foreign_case_first_material(scene)->finish;
        if (!f || f->metalness != cases[i].metalness || fabsf(f->roughness - cases[i].roughness) > 1e-6f ||
            f->specular != 1 || lw_foreign_case_first_material(scene)->base_colour[1] != cases[i].base)
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
    const struct lw_finish *f = lw_foreign_case_first_material(scene)->finish;
    assert_int_equal(scene->finish_texture_count, 1);
    assert_int_equal(scene->finish_texture[0].width, 4);
    assert_memory_equal(scene->finish_texture[0].rgba + 12, ((const uint8_t[]){255, 40, 200, 255}), 4);
    assert_float_equal(f->roughness, 1, 0);
    assert_float_equal(f->metalness, 1, 0);
    lw_scene_destroy(scene);
    scene = load_mtl("Pm 0.5\nPr 0\nmap_Pr both.tga\nmap_Pm both.tga"); /* as glTF has it in one picture */
    assert_memory_equal(scene->finish_texture[0].rgba, ((const uint8_t[]){255, 60, 70, 255}), 4);
    assert_float_equal(lw_foreign_case_first_material(scene)->finish->metalness, 0.5, 0);
    assert_float_equal(lw_foreign_case_first_material(scene)->finish->roughness, 1, 0); /* 0 hides no map */
    lw_scene_destroy(scene);
    scene = load_mtl("map_Pr -imfchan b -mm 0.5 0.5 -s 2 2 both.tga");
    assert_int_equal(scene->finish_texture[0].rgba[1], 163); /* 127.5 + 35 */
    assert_float_equal(lw_foreign_case_first_material(scene)->finish->surface_texture.transform[0], 2, 0);
    assert_float_equal(lw_foreign_case_first_material(scene)->finish->metalness, 0, 0);
    lw_scene_destroy(scene);
    scene = load_mtl("map_Pr lost.tga\nPm 1");
    assert_null(lw_foreign_case_first_material(scene)->finish);
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
        const struct lw_finish *f = lw_foreign_case_first_material(scene)->finish;
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
    assert_null(lw_foreign_case_first_material(scene)->finish);
    lw_scene_destroy(scene);
    scene = load_mtl("norm lost.tga");
    assert_null(lw_foreign_case_first_material(scene)->finish);
    assert_null(scene->mesh[0].tangent);
    lw_scene_destroy(scene);
}

/* A normal map that is the colour too, as a broken exporter writes: neither use spoils the second one. */
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

/* ---- FBX and Collada, read by Assimp ---- */

/* A square with one material. %s: its properties, its textures, their connections. */
static const char fbx_format[] =
    "; FBX 7.4.0 project file\n"
    "FBXHeaderExtension:  {\n FBXHeaderVersion: 1003\n FBXVersion: 7400\n Creator: \"by hand\"\n}\n"
    "GlobalSettings:  {\n Version: 1000\n}\n"
    "Objects:  {\n"
    " Geometry: 10, \"Geometry::\", \"Mesh\" {\n"
    "  Vertices: *12 {\n   a: 0,0,0,1,0,0,1,1,0,0,1,0\n  }\n"
    "  PolygonVertexIndex: *4 {\n   a: 0,1,2,-4\n  }\n"
    "  LayerElementUV: 0 {\n"
    "   Version: 101\n   Name: \"map1\"\n"
    "   MappingInformationType: \"ByPolygonVertex\"\n   ReferenceInformationType: \"IndexToDirect\"\n"
    "   UV: *8 {\n    a: 0,0,1,0,1,1,0,1\n   }\n"
    "   UVIndex: *4 {\n    a: 0,1,2,3\n   }\n  }\n"
    "  LayerElementMaterial: 0 {\n"
    "   Version: 101\n   Name: \"\"\n"
    "   MappingInformationType: \"AllSame\"\n   ReferenceInformationType: \"IndexToDirect\"\n"
    "   Materials: *1 {\n    a: 0\n   }\n  }\n"
    "  Layer: 0 {\n"
    "   Version: 100\n"
    "   LayerElement:  {\n    Type: \"LayerElementUV\"\n    TypedIndex: 0\n   }\n"
    "   LayerElement:  {\n    Type: \"LayerElementMaterial\"\n    TypedIndex: 0\n   }\n  }\n"
    " }\n"
    " Model: 20, \"Model::quad\", \"Mesh\" {\n  Version: 232\n }\n"
    " Material: 50, \"Material::t\", \"\" {\n"
    "  Version: 102\n  ShadingModel: \"phong\"\n  Properties70:  {\n%s  }\n }\n"
    "%s}\n"
    "Connections:  {\n C: \"OO\",20,0\n C: \"OO\",10,20\n C: \"OO\",50,20\n%s}\n";

#define FBX_COLOUR(name, rgb)   "   P: \"" name "\", \"Color\", \"\", \"A\"," rgb "\n"
#define FBX_NUMBER(name, value) "   P: \"" name "\", \"Number\", \"\", \"A\"," value "\n"

struct fbx_map {
    const char *property, *file;
};

static struct lw_scene *load_fbx(const char *properties, const struct fbx_map *map, size_t maps) {
    char text[8192], textures[2048] = "", connections[1024] = "";
    for (size_t i = 0; i < maps; i++) {
        size_t at = strlen(textures);
        snprintf(textures + at, sizeof textures - at,
                 " Texture: %zu, \"Texture::%zu\", \"\" {\n  Type: \"TextureVideoClip\"\n  Version: 202\n"
                 "  FileName: \"C:\\work\\%s\"\n  RelativeFilename: \"%s\"\n }\n",
                 60 + i, i, map[i].file, map[i].file);
        at = strlen(connections);
        snprintf(connections + at, sizeof connections - at, " C: \"OP\",%zu,50, \"%s\"\n", 60 + i,
                 map[i].property);
    }
    snprintf(text, sizeof text, fbx_format, properties, textures, connections);
    lw_foreign_case_write_text("t.fbx", text);
    return lw_foreign_case_scene("t.fbx");
}

/* A square with one effect of a shading model. %s: its parameters, its extras. */
static const char dae_format[] =
    "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n"
    "<COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" version=\"1.4.1\">\n"
    "<asset><unit name=\"meter\" meter=\"1\"/><up_axis>Y_UP</up_axis></asset>\n"
    "<library_images><image id=\"img\"><init_from>%s</init_from></image></library_images>\n"
    "<library_effects><effect id=\"fx\"><profile_COMMON>\n"
    "<newparam sid=\"surf\"><surface type=\"2D\"><init_from>img</init_from></surface></newparam>\n"
    "<newparam sid=\"samp\"><sampler2D><source>surf</source></sampler2D></newparam>\n"
    "<technique sid=\"common\">%s%s</technique></profile_COMMON></effect></library_effects>\n"
    "<library_materials><material id=\"m\" name=\"m\"><instance_effect url=\"#fx\"/></material>"
    "</library_materials>\n"
    "<library_geometries><geometry id=\"g\" name=\"quad\"><mesh>\n"
    "<source id=\"p\"><float_array id=\"pa\" count=\"12\">0 0 0 1 0 0 1 1 0 0 1 0</float_array>"
    "<technique_common><accessor source=\"#pa\" count=\"4\" stride=\"3\"><param name=\"X\" type=\"float\"/>"
    "<param name=\"Y\" type=\"float\"/><param name=\"Z\" type=\"float\"/></accessor></technique_common>"
    "</source>\n"
    "<source id=\"uv\"><float_array id=\"uva\" count=\"8\">0 0 1 0 1 1 0 1</float_array>"
    "<technique_common><accessor source=\"#uva\" count=\"4\" stride=\"2\"><param name=\"S\" type=\"float\"/>"
    "<param name=\"T\" type=\"float\"/></accessor></technique_common></source>\n"
    "<vertices id=\"v\"><input semantic=\"POSITION\" source=\"#p\"/></vertices>\n"
    "<polylist material=\"ms\" count=\"1\"><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/>"
    "<input semantic=\"TEXCOORD\" source=\"#uv\" offset=\"1\" set=\"0\"/><vcount>4</vcount>"
    "<p>0 0 1 1 2 2 3 3</p></polylist></mesh></geometry></library_geometries>\n"
    "<library_visual_scenes><visual_scene id=\"vs\"><node id=\"n\"><instance_geometry url=\"#g\">"
    "<bind_material><technique_common><instance_material symbol=\"ms\" target=\"#m\"><bind_vertex_input "
    "semantic=\"UV\" input_semantic=\"TEXCOORD\" input_set=\"0\"/></instance_material></technique_common>"
    "</bind_material></instance_geometry></node></visual_scene></library_visual_scenes>\n"
    "<scene><instance_visual_scene url=\"#vs\"/></scene></COLLADA>\n";

/* As OpenCOLLADA and Blender write bumps. */
#define DAE_BUMP                                                                                             \
    "<extra><technique profile=\"FCOLLADA\"><bump><texture texture=\"samp\" texcoord=\"UV\"/></bump>"        \
    "</technique></extra>"

static struct lw_scene *load_dae(const char *picture, const char *model, const char *extra) {
    char text[8192];
    snprintf(text, sizeof text, dae_format, picture, model, extra);
    lw_foreign_case_write_text("t.dae", text);
    return lw_foreign_case_scene("t.dae");
}

static void write_reliefs(void) {
    write_picture("heights.tga", 4,
                  (const uint8_t[][3]){{0, 0, 0}, {80, 80, 80}, {160, 160, 160}, {240, 240, 240}});
    write_picture("normals.tga", 2, (const uint8_t[][3]){{128, 128, 255}, {160, 128, 250}});
}

/* A normal map of x 160 in its second texel, or heights that rise to the right; and no gloss. */
static void check_relief(struct lw_scene *scene, bool normals, float scale) {
    const struct lw_finish *f = lw_foreign_case_first_material(scene)->finish;
    assert_non_null(f);
    assert_float_equal(f->normal_scale, scale, 0);
    assert_float_equal(f->specular, 0, 0);
    assert_float_equal(f->metalness, 0, 0);
    assert_int_equal(scene->finish_texture_count, 1);
    const struct lw_texture *texture = &scene->finish_texture[f->normal_texture.texture];
    assert_int_equal(texture->content, LW_CONTENT_NORMAL);
    assert_int_equal(texture->width, normals ? 2 : 4);
    if (normals)
        assert_int_equal(texture->rgba[4], 160);
    else
        assert_true(texture->rgba[4] < 127);
    assert_non_null(scene->mesh[0].tangent);
    lw_scene_destroy(scene);
}

static void phong_of_fbx_and_collada_is_matt(void **state) {
    (void)state;
    static const char phong[] =
        FBX_COLOUR("DiffuseColor", "0.8,0.8,0.8") FBX_COLOUR("SpecularColor", "0.5,0.5,0.5")
            FBX_NUMBER("ShininessExponent", "25") FBX_NUMBER("ReflectionFactor", "0.5");
    struct lw_scene *scene = load_fbx(phong, NULL, 0);
    assert_null(lw_foreign_case_first_material(scene)->finish);
    lw_scene_destroy(scene);
    scene = load_dae(
        "none.tga",
        "<phong><diffuse><color>0.8 0.8 0.8 1</color></diffuse><specular><color>0.5 0.5 0.5 "
        "1</color></specular><shininess><float>50</float></shininess><reflective><color>1 1 1 1</color>"
        "</reflective><reflectivity><float>0.5</float></reflectivity></phong>",
        "");
    assert_null(lw_foreign_case_first_material(scene)->finish);
    lw_scene_destroy(scene);
}

static void a_black_diffuse_of_fbx_and_collada_is_a_mirror(void **state) {
    (void)state;
    struct lw_scene *mirror[] = {
        load_fbx(FBX_COLOUR("DiffuseColor", "0,0,0") FBX_COLOUR("SpecularColor", "0.75,0.75,0.75")
                     FBX_NUMBER("ShininessExponent", "30"),
                 NULL, 0),
        load_dae("none.tga",
                 "<blinn><diffuse><color>0 0 0 1</color></diffuse><specular><color>0.75 0.75 0.75 "
                 "1</color></specular><shininess><float>30</float></shininess></blinn>",
                 "")};
    for (int i = 0; i < 2; i++) {
        const struct lw_finish *f = lw_foreign_case_first_material(mirror[i])->finish;
        assert_non_null(f);
        assert_float_equal(f->metalness, 1, 0);
        assert_float_equal(f->roughness, 0.5, 1e-6); /* (2 / 32)^(1/4) */
        assert_float_equal(lw_foreign_case_first_material(mirror[i])->base_colour[1], 0.75, 1e-6);
        lw_scene_destroy(mirror[i]);
    }
}

static void relief_of_fbx_and_collada_is_read(void **state) {
    (void)state;
    write_reliefs();
    static const char grey[] =
        FBX_COLOUR("DiffuseColor", "0.8,0.8,0.8") FBX_NUMBER("ShininessExponent", "25");
    static const char bumpy[] = FBX_COLOUR("DiffuseColor", "0.8,0.8,0.8") FBX_NUMBER("BumpFactor", "0.25");
    check_relief(load_fbx(grey, &(struct fbx_map){"NormalMap", "normals.tga"}, 1), true, 1);
    check_relief(load_fbx(bumpy, &(struct fbx_map){"NormalMap", "normals.tga"}, 1), true, 0.25f);
    check_relief(load_fbx(bumpy, &(struct fbx_map){"Bump", "heights.tga"}, 1), false, 0.25f);
    check_relief(load_fbx(grey, &(struct fbx_map){"Maya|normalCamera", "normals.tga"}, 1), true, 1);
    check_relief(load_fbx(grey, &(struct fbx_map){"3dsMax|Parameters|bump_map", "heights.tga"}, 1), false, 1);
    static const char lambert[] = "<lambert><diffuse><color>0.8 0.8 0.8 1</color></diffuse></lambert>";
    check_relief(load_dae("normals.tga", lambert, DAE_BUMP), true, 1);
    check_relief(load_dae("heights.tga", lambert, DAE_BUMP), false, 1);
}

/* Maya's Stingray and 3ds Max's physical materials say metalness and roughness. */
static void metalness_and_roughness_of_fbx_are_read(void **state) {
    (void)state;
    write_reliefs();
    write_picture("rough.tga", 4, (const uint8_t[][3]){{10, 1, 1}, {20, 1, 1}, {30, 1, 1}, {40, 1, 1}});
    write_picture("metal.tga", 2, (const uint8_t[][3]){{100, 2, 2}, {200, 2, 2}});
    write_picture("cover.tga", 1, (const uint8_t[][3]){{90, 90, 90}});
    struct lw_scene *scene =
        load_fbx(FBX_COLOUR("Maya|base_color", "0.75,0.5,0.25") FBX_NUMBER("Maya|metallic", "1")
                     FBX_NUMBER("Maya|roughness", "0.25"),
                 NULL, 0);
    const struct lw_finish *f = lw_foreign_case_first_material(scene)->finish;
    assert_non_null(f);
    assert_float_equal(f->metalness, 1, 0);
    assert_float_equal(f->roughness, 0.25, 0);
    assert_float_equal(f->specular, 1, 0);
    assert_float_equal(lw_foreign_case_first_material(scene)->base_colour[1], 0.5, 1e-6);
    lw_scene_destroy(scene);
    static const struct fbx_map maps[][4] = {{{"Maya|TEX_roughness_map", "rough.tga"},
                                              {"Maya|TEX_metallic_map", "metal.tga"},
                                              {"Maya|TEX_normal_map", "normals.tga"},
                                              {"Maya|TEX_ao_map", "cover.tga"}},
                                             {{"3dsMax|main|roughness_map", "rough.tga"},
                                              {"3dsMax|main|metalness_map", "metal.tga"},
                                              {"3dsMax|main|norm_map", "normals.tga"},
                                              {"3dsMax|main|ao_map", "cover.tga"}}};
    for (int i = 0; i < 2; i++) {
        scene = load_fbx(
            FBX_COLOUR("DiffuseColor",
                       "0.8,0.8,0.8") "   P: \"3dsMax|main|useGlossiness\", \"Integer\", \"\", \"A\",2\n",
            maps[i], 4);
        f = lw_foreign_case_first_material(scene)->finish;
        assert_non_null(f);
        assert_float_equal(f->metalness, 1, 0);
        assert_float_equal(f->roughness, 1, 0);
        const struct lw_texture *texture = scene->finish_texture;
        assert_int_equal(scene->finish_texture_count, 2); /* without occlusion */
        assert_memory_equal(texture[f->surface_texture.texture].rgba + 12,
                            ((const uint8_t[]){255, 40, 200, 255}), 4);
        assert_int_equal(texture[f->normal_texture.texture].rgba[4], 160);
        assert_int_equal(f->occlusion_texture.texture, LW_SCENE_NONE);
        lw_scene_destroy(scene);
    }
}

int main(void) {
    lw_log_init("test_foreign_finish", LW_LOG_WARNING);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(highlights_of_exporters_are_no_gloss),
        cmocka_unit_test(roughness_and_metalness_are_read),
        cmocka_unit_test(maps_of_gloss_become_one),
        cmocka_unit_test(relief_is_of_heights_or_normals),
        cmocka_unit_test(one_picture_may_be_several_things),
        cmocka_unit_test(phong_of_fbx_and_collada_is_matt),
        cmocka_unit_test(a_black_diffuse_of_fbx_and_collada_is_a_mirror),
        cmocka_unit_test(relief_of_fbx_and_collada_is_read),
        cmocka_unit_test(metalness_and_roughness_of_fbx_are_read),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
