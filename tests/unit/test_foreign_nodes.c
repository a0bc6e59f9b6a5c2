/* Collada and FBX through Assimp, against files written here: trees of nodes, units, lights, cameras, paths
 * and textures arrive as docs/importing_other.md says. */
#include "tests/support/foreign_case.h"

#include "common/base/log.h"
#include "common/scene/pose.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

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

static void collada_arrives_in_metres_and_upright(void **state) {
    (void)state;
    lw_foreign_case_make_folder("some dir");
    lw_foreign_case_write_png("some dir/pic.png");
    struct lw_scene *scene = lw_foreign_case_scene_of("t.dae", dae);
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_non_null(strstr(lw_foreign_case_talk(), "ambient lights are ignored"));
    assert_int_equal(scene->object_count, 2);
    assert_int_equal(lw_support_triangles(scene), 4);
    /* a square of 1 m that lies flat: file (x, y, z) cm is (x, z, -y) / 100 m */
    lw_foreign_case_expect_vec3(point_of_object(&pose, scene, "mover", lw_vec3(100, 100, 0)), 1, 0, -1);
    lw_foreign_case_expect_vec3(point_of_object(&pose, scene, "still", lw_vec3(100, 100, 0)), 2, 1, -2);

    /* the same geometry with two materials */
    const struct lw_material *glass = lw_support_material(scene, "glass"),
                             *paint = lw_support_material(scene, "m");
    assert_float_equal(glass->base_colour[0], 0.25, 0);
    assert_float_equal(glass->base_colour[3], 0.5, 1e-6);
    assert_int_equal(glass->alpha_mode, LW_ALPHA_BLEND);
    assert_float_equal(paint->base_colour[0], 1, 0);
    assert_float_equal(paint->emission[2], 7, 0);
    assert_int_equal(paint->alpha_mode, LW_ALPHA_OPAQUE);
    assert_int_not_equal(paint->base_colour_texture.texture, LW_SCENE_NONE);

    /* 4 / (0.0002 d^2) with d in cm is 2 / d^2 with d in m */
    const struct lw_light *point = lw_support_light(scene, "lp"), *sun = lw_support_light(scene, "ls"),
                          *spot = lw_support_light(scene, "lsp");
    assert_int_equal(scene->light_count, 3);
    assert_int_equal(point->kind, LW_LIGHT_POINT);
    assert_float_equal(point->intensity[0], 2, 1e-4);
    assert_float_equal(point->intensity[2], 0.5, 1e-4);
    lw_foreign_case_expect_vec3(pose.light[point - scene->light].position_ws, 0, 3, 0);
    assert_int_equal(sun->kind, LW_LIGHT_DIRECTIONAL);
    assert_float_equal(sun->intensity[1], 3, 0);
    lw_foreign_case_expect_vec3(pose.light[sun - scene->light].direction_ws, 0, -1, 0);
    assert_int_equal(spot->kind, LW_LIGHT_SPOT);
    assert_float_equal(spot->outer_cone, LW_PI / 6, 1e-5); /* half of 60 degrees */
    assert_float_equal(spot->intensity[0], 5, 0);

    assert_int_equal(scene->camera_count, 1);
    assert_float_equal(scene->camera[0].fov_y, 2 * atanf(0.5f),
                       1e-5); /* 90 degrees wide, twice as wide as high */
    const struct lw_affine *eye = &pose.node_to_world[scene->camera[0].node];
    lw_foreign_case_expect_vec3(lw_affine_point(eye, lw_vec3(0, 0, 0)), 0, 1, 5);
    lw_foreign_case_expect_vec3(lw_vec3_normalize(lw_affine_vector(eye, lw_vec3(0, 0, -1))), 0, 0, -1);
    lw_foreign_case_expect_vec3(lw_vec3_normalize(lw_affine_vector(eye, lw_vec3(0, 1, 0))), 0, 1, 0);

    /* rises by 2 m from 0.5 to 2 s; what stands still has no channel */
    assert_int_equal(scene->channel_count, 1);
    assert_float_equal(scene->duration_s, 2, 1e-6);
    lw_pose_evaluate(&pose, scene, 1.25);
    lw_foreign_case_expect_vec3(point_of_object(&pose, scene, "mover", lw_vec3(100, 100, 0)), 1, 1, -1);
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
        char *const texts[] = {
            strdup("mtllib four.mtl\n" LW_FOREIGN_CASE_SQUARE "usemtl paint\n" LW_FOREIGN_CASE_FACE),
            with_picture(dae, "some%20dir/PIC.png", names[i]),
            with_picture(fbx, "textures\\pic.png", names[i])};
        const char *const scenes[] = {"four.obj", "four.dae", "four.fbx"};
        for (int s = 0; s < 3; s++) {
            struct lw_scene *scene = lw_foreign_case_scene_of(scenes[s], texts[s]);
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
    struct lw_scene *scene = lw_foreign_case_scene_of("t.fbx", fbx);
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_string_equal(lw_foreign_case_talk(), "");
    assert_int_equal(scene->object_count, 1);
    lw_foreign_case_expect_vec3(point_of_object(&pose, scene, "quad", lw_vec3(1, 1, 0)), 4, 0, -1);
    const struct lw_material *paint = lw_support_material(scene, "paint");
    assert_float_equal(paint->base_colour[0], 1, 0); /* the texture takes the place of the colour */
    assert_float_equal(paint->emission[0], 6, 0);
    assert_float_equal(paint->emission[1], 3, 0);
    assert_int_equal(scene->texture_count, 1);
    assert_int_equal(scene->texture[0].width, 2);
    assert_int_equal(scene->texture[0].rgba[5], 128);

    const struct lw_light *lamp = lw_support_light(scene, "lamp");
    assert_int_equal(lamp->kind, LW_LIGHT_SPOT);
    assert_float_equal(lamp->intensity[0], 8, 1e-5); /* 100 % is 1 */
    assert_float_equal(lamp->intensity[2], 2, 1e-5);
    assert_float_equal(lamp->inner_cone, LW_PI / 12, 1e-5);
    assert_float_equal(lamp->outer_cone, LW_PI / 6, 1e-5);
    lw_foreign_case_expect_vec3(pose.light[0].position_ws, 0, 4, 0);
    lw_foreign_case_expect_vec3(pose.light[0].direction_ws, 0, 0, 1); /* along the file's -Y */

    const struct lw_affine *eye = &pose.node_to_world[scene->camera[0].node];
    lw_foreign_case_expect_vec3(lw_affine_point(eye, lw_vec3(0, 0, 0)), 0, 1, 5);
    lw_foreign_case_expect_vec3(lw_vec3_normalize(lw_affine_vector(eye, lw_vec3(0, 0, -1))), 0, 0, -1);
    assert_float_equal(scene->camera[0].fov_y, 2 * atanf(0.5f), 1e-5);

    assert_int_equal(scene->channel_count, 1);
    assert_float_equal(scene->duration_s, 2, 1e-5);
    lw_pose_evaluate(&pose, scene, 1);
    lw_foreign_case_expect_vec3(point_of_object(&pose, scene, "quad", lw_vec3(1, 1, 0)), 5, 0, -1);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

/* Assimp draws a tetrahedron for each node of a file that has no mesh, unless an option forbids it. */
static void lamps_alone_are_no_triangles(void **state) {
    (void)state;
    char *text = lw_support_replaced(dae, "<library_geometries>", "<!--"), *cut = text;
    text = lw_support_replaced(cut, "</library_geometries>", "-->");
    free(cut);
    cut = text;
    text = lw_support_replaced(cut, "<node id=\"mover\"", "<!--<node id=\"mover\"");
    free(cut);
    cut = text;
    text = lw_support_replaced(cut, "<node id=\"lp\"", "--><node id=\"lp\"");
    free(cut);
    lw_foreign_case_refuse_text("lamps.dae", text, "no triangles");
    free(text);
}

/* One of two keys at the same time counts, here the one that Assimp leaves; with none beside it things stand
 * there. */
static void equal_key_times_are_one_key(void **state) {
    (void)state;
    lw_foreign_case_make_folder("some dir");
    lw_foreign_case_write_png("some dir/pic.png");
    char *text = lw_support_replaced(dae, ">0.5 2</float_array>", ">2 2</float_array>");
    struct lw_scene *scene = lw_foreign_case_scene_of("equal.dae", text);
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
    char *text = lw_support_replaced(fbx, " C: \"OO\",50,20\n", "");
    struct lw_scene *scene = lw_foreign_case_scene_of("bare.fbx", text);
    assert_float_equal(scene->material[scene->mesh[0].material[0]].base_colour[0], 0.6, 1e-6);
    lw_scene_destroy(scene);
    free(text);
    text = lw_support_replaced(fbx, "   P: \"DiffuseColor\", \"Color\", \"\", \"A\",0.8,0.8,0.8\n", "");
    char *plain = lw_support_replaced(text, " C: \"OP\",61,50, \"DiffuseColor\"\n", "");
    scene = lw_foreign_case_scene_of("plain.fbx", plain);
    assert_float_equal(lw_support_material(scene, "paint")->base_colour[0], 0.6, 1e-6);
    lw_scene_destroy(scene);
    free(plain);
    free(text);
    text = lw_support_replaced(fbx, "   P: \"FieldOfView\", \"FieldOfView\", \"\", \"A\",90\n", "");
    scene = lw_foreign_case_scene_of("view.fbx", text);
    assert_string_equal(lw_foreign_case_talk(), "");
    assert_float_equal(scene->camera[0].fov_y, 2 * atanf(tanf(0.5f * 25.115f * LW_PI / 180) / 2), 1e-5);
    lw_scene_destroy(scene);
    free(text);
    static const char *const kinds[] = {"0", "1"};
    for (int i = 0; i < 2; i++) {
        char line[128];
        snprintf(line, sizeof line,
                 "   P: \"CameraProjectionType\", \"enum\", \"\", \"\",%s\n   P: \"FieldOfView\"", kinds[i]);
        text = lw_support_replaced(fbx, "   P: \"FieldOfView\"", line);
        scene = lw_foreign_case_scene_of("parallel.fbx", text);
        assert_int_equal(
            strstr(lw_foreign_case_talk(), "orthographic cameras are read as perspective ones") != NULL, i);
        lw_scene_destroy(scene);
        free(text);
    }
}

/* FBX counts in centimetres unless it says otherwise. */
static void fbx_units_are_centimetres(void **state) {
    (void)state;
    char *text = lw_support_replaced(fbx, "\"UnitScaleFactor\", \"double\", \"Number\", \"\",100",
                                     "\"X\", \"double\", \"Number\", \"\",1");
    struct lw_scene *scene = lw_foreign_case_scene_of("cm.fbx", text);
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_foreign_case_expect_vec3(point_of_object(&pose, scene, "quad", lw_vec3(100, 100, 0)), 1.03f, 0, -1);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
    free(text);
}

int main(void) {
    lw_log_init("test_foreign_nodes", LW_LOG_WARNING);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(collada_arrives_in_metres_and_upright),
        cmocka_unit_test(tga_and_bmp_are_read_by_every_format),
        cmocka_unit_test(fbx_arrives_in_metres_and_upright),
        cmocka_unit_test(fbx_leaves_out_what_it_means),
        cmocka_unit_test(equal_key_times_are_one_key),
        cmocka_unit_test(lamps_alone_are_no_triangles),
        cmocka_unit_test(fbx_units_are_centimetres),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
