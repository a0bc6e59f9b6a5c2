#include "tests/support/gltf_case.h"

#include "common/base/log.h"
#include "server/import/gltf/gltf.h"
#include "tests/support/glb.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Documents as a whole: the base scene, one wrong place each, sizes and containers. */

static void the_base_scene_arrives_whole(void **state) {
    (void)state;
    struct lw_scene *scene;
    GLTF_CASE_LOAD(scene, gltf_case_base_data, gltf_case_no_change);
    assert_string_equal(scene->name, "base");
    assert_int_equal(scene->mesh_count, 1);
    assert_int_equal(scene->mesh[0].vertex_count, 4);
    assert_int_equal(scene->mesh[0].triangle_count, 2);
    assert_float_equal(scene->mesh[0].normal[2].z, 1, 1e-6); /* was 2 */
    assert_non_null(scene->mesh[0].uv[0]);
    assert_null(scene->mesh[0].uv[1]);
    assert_null(scene->mesh[0].colour);

    assert_int_equal(scene->node_count, 3);
    assert_int_equal(scene->object_count, 1);
    assert_string_equal(scene->object[0].name, "square"); /* its node has no name */
    assert_int_equal(scene->node[scene->object[0].node].parent, 0);
    assert_float_equal(scene->node[0].translation[1], 1, 0);

    const struct lw_material *material = &scene->material[0];
    assert_float_equal(material->base_colour[2], 0.125, 0);
    assert_float_equal(material->emission[0], 4, 0);
    assert_float_equal(material->emission[1], 2, 0);
    assert_int_equal(material->alpha_mode, LW_ALPHA_MASK);
    assert_float_equal(material->alpha_cutoff, 0.25, 0);
    assert_true(material->double_sided);
    assert_int_equal(material->base_colour_texture.texture, 0);
    assert_int_equal(material->emission_texture.texture, LW_SCENE_NONE);
    assert_int_equal(scene->texture_count, 1);
    assert_int_equal(scene->texture[0].width, 2);
    assert_int_equal(scene->texture[0].wrap_s, LW_WRAP_CLAMP);
    assert_int_equal(scene->texture[0].wrap_t, LW_WRAP_MIRROR);
    const uint8_t texels[8] = {255, 0, 0, 255, 0, 128, 255, 64};
    assert_memory_equal(scene->texture[0].rgba, texels, sizeof texels);

    assert_int_equal(scene->light_count, 1);
    assert_int_equal(scene->light[0].kind, LW_LIGHT_SPOT);
    assert_float_equal(scene->light[0].intensity[1], 4, 0);
    assert_float_equal(scene->light[0].inner_cone, 0, 0);
    assert_float_equal(scene->light[0].outer_cone, LW_PI / 4, 1e-6);
    assert_int_equal(scene->camera_count, 1);
    assert_string_equal(scene->camera[0].name, "lamp");
    assert_float_equal(scene->camera[0].fov_y, 0.75, 0);

    assert_int_equal(scene->channel_count, 1);
    assert_int_equal(scene->channel[0].node, 0);
    assert_int_equal(scene->channel[0].path, LW_CHANNEL_TRANSLATION);
    assert_int_equal(scene->channel[0].interpolation, LW_INTERPOLATION_LINEAR);
    assert_float_equal(scene->channel[0].value[4], 3, 0);
    assert_float_equal(scene->duration_s, 2, 0);
    lw_scene_destroy(scene);
}

/* ---- one wrong place each ---- */

static const struct {
    const char *old, *new, *text;
} wrong_places[] = {
    {"'version':'2.0'", "'version':'1.0'", "asset: is glTF 1.0"},
    {"'version':'2.0'", "'version':'2.1','minVersion':'2.1'", "asset: is glTF 2.1"},
    {"'version':'2.0'", "'version':2.0", "asset: version: must be a string"},
    {"'asset':{'version':'2.0'}", "'asset':[]", "asset: must be an object"},
    {"'asset'", "'Asset'", "asset: is required"},
    {"'scene':0", "'extensionsRequired':['KHR_texture_basisu']",
     "KHR_texture_basisu (KTX2 textures), which is not supported; convert it: gltf-transform ktxdecompress"},
    {"'scene':0", "'extensionsRequired':['ACME_holes']", "requires the extension ACME_holes"},
    {"'scene':0", "'scene':1", "scene: must be an index into scenes"},
    {"'scene':0", "'scene':0.5", "scene: must be an index"},
    {"'scene':0", "'scene':-0.5", "scene: must be an index"},
    {"'count':4,", "'count':4.5,", "accessor 0: count: must be an integer"},
    {"'count':4,", "'count':1e300,", "accessor 0: count: must be an integer"},
    {"'children':[1]", "'children':[1.25]", "nodes[0].children: [0] must be an index"},
    {"{'mesh':0}", "{'mesh':0,'extensions':{'KHR_node_visibility':{'visible':1}}}",
     "nodes[1]: KHR_node_visibility: visible: must be true or false"},
    {"{'mesh':0}", "{'mesh':0,'extensions':{'MSFT_lod':{'ids':[3]}}}",
     "nodes[1]: MSFT_lod: [0] must be an index into nodes"},
    {"'scene':0", "'scene':-1", "scene: must be an index"},
    {"'nodes':[0,2]", "'nodes':[0,2,0]", "scenes[0]: nodes: nodes[0] is listed twice"},
    {"'nodes':[0,2]", "'nodes':[0,1]", "nodes[1] is a root of the scene and a child of nodes[0]"},
    {"'nodes':[0,2]", "'nodes':[0,3]", "scenes[0]: nodes: [1] must be an index"},
    {"'nodes':[0,2]", "'nodes':{}", "scenes[0]: nodes: must be an array"},
    {"'children':[1]", "'children':[1,1]", "nodes[1]: has two parents"},
    {"'children':[1]", "'children':[0]", "nodes[0]: is its own ancestor"},
    {"'children':[1]", "'children':['1']", "nodes[0].children: [0] must be an index"},
    {"'children':[1]", "'children':1", "nodes[0]: children: must be an array"},
    {"{'mesh':0}", "{'mesh':0,'children':[0]}", "is its own ancestor"},
    {"{'mesh':0}", "{'mesh':1}", "nodes[1]: mesh: must be an index into meshes"},
    {"{'mesh':0}", "7", "nodes[1]: must be an object"},
    {"'translation':[0,1,0]", "'translation':[0,1]", "nodes[0]: translation: must be an array of 3 numbers"},
    {"'translation':[0,1,0]", "'rotation':[0,0,0,0]", "nodes[0]: rotation: must be a unit quaternion"},
    {"'translation':[0,1,0]", "'translation':[0,1e300,0]", "nodes[0]: translation"},
    {"'translation':[0,1,0]", "'matrix':[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]",
     "has a matrix and cannot be animated"},
    {"'translation':[0,1,0]", "'matrix':[1,0,0,1,0,1,0,0,0,0,1,0,0,0,0,1]", "matrix: its last row"},
    {"'translation':[0,1,0]", "'scale':[1,1,1],'matrix':[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]",
     "matrix: excludes"},
    {"'type':'spot'", "'type':'area'", "lights[0]: type: must be point, spot or directional"},
    {"'type':'spot'", "'typ':'spot'", "lights[0]: type: is required"},
    {"'intensity':8", "'intensity':-8", "lights[0]: intensity: must be a number, at least 0"},
    {"'intensity':8", "'intensity':'8'", "lights[0]: intensity: must be a number"},
    {"'spot':{}", "'spot':{'outerConeAngle':1.6}",
     "lights[0]: spot: outerConeAngle: must be a number from 0"},
    {",'spot':{}", "", "lights[0]: spot: is required"},
    {"'spot':{}", "'spot':{'outerConeAngle':0}", "outerConeAngle must be greater than 0"},
    {"'color':[1,0.5,0.25]", "'color':[1,0.5]", "lights[0]: color: must be an array of 3 numbers"},
    {"'intensity':8", "'intensity':8,'extras':{'lightwell':{'clientLight':1}}",
     "lights[0]: extras: lightwell: clientLight: must be true or false"},
    {"'intensity':8", "'intensity':8,'extras':{'lightwell':true}",
     "lights[0]: extras: lightwell: must be an object"},
    {"'doubleSided':true", "'doubleSided':true,'extras':{'lightwell':{'clientLight':'yes'}}",
     "materials[0]: extras: lightwell: clientLight: must be true or false"},
    {"{'light':0}", "{'light':1}", "nodes[2]: light: must be an index"},
    {"{'light':0}", "{}", "nodes[2]: light: is required"},
    {"'lights':[", "'lights':[1,", "lights[0]: must be an object"},
    {"'type':'perspective'", "'type':'fisheye'", "cameras[0]: type: must be perspective or orthographic"},
    {"'yfov':0.75", "'yfov':0", "cameras[0]: perspective: yfov"},
    {"'POSITION':0,", "", "meshes[0]: primitives[0]: attributes: POSITION: is required"},
    {"'POSITION':0", "'POSITION':99", "attributes: POSITION: must be an index into accessors"},
    {"'POSITION':0", "'POSITION':2", "POSITION: accessor 2: type VEC2 cannot be used here"},
    {"'POSITION':0", "'POSITION':5", "has 4 elements, POSITION has 2"},
    {"'NORMAL':1", "'NORMAL':[1]", "attributes: NORMAL: must be an index"},
    {"'indices':3", "'indices':4", "indices: accessor 4: componentType 5126 cannot be used here"},
    {"'indices':3", "'indices':0", "indices: accessor 0: type VEC3"},
    {"'indices':3", "'mode':7", "primitives[0]: mode: must be an integer from 0 to 6"},
    {"'indices':3", "'mode':4", "4 indices do not make whole triangles"},
    {"'material':0", "'material':1", "primitives[0]: material: must be an index"},
    {"'primitives':[{", "'primitives':[3,{", "meshes[0]: primitives[0]: must be an object"},
    {"'primitives'", "'Primitives'", "meshes[0]: primitives: is required"},
    {"[0.5,0.25,0.125,1]", "[0.5,0.25,0.125]", "materials[0]: pbrMetallicRoughness: baseColorFactor"},
    {"[0.5,0.25,0.125,1]", "[-0.5,0.25,0.125,1]",
     "baseColorFactor: must be an array of 4 numbers, at least 0"},
    {"'emissiveFactor':[1,0.5,0]", "'emissiveFactor':1", "materials[0]: emissiveFactor"},
    {"'emissiveStrength':4", "'emissiveStrength':-4", "materials[0]: emissiveStrength"},
    {"'alphaMode':'MASK'", "'alphaMode':'ADD'", "materials[0]: alphaMode"},
    {"'doubleSided':true", "'doubleSided':1", "doubleSided: must be true or false"},
    {"'baseColorTexture':{'index':0}", "'baseColorTexture':{'index':1}", "baseColorTexture: index"},
    {"'baseColorTexture':{'index':0}", "'baseColorTexture':{}", "baseColorTexture: index: is required"},
    {"{'source':0,'sampler':0}", "{'extensions':{'EXT_texture_webp':{'source':4}}}",
     "textures[0]: EXT_texture_webp: source: must be an index into images"},
    {"{'source':0,'sampler':0}", "{'source':0,'sampler':9}", "textures[0]: sampler: must be an index"},
    {"'wrapS':33071", "'wrapS':1", "samplers[0]: wrapS"},
    {"'images':[{'uri':", "'images':[{'bufferView':0,'uri':",
     "images[0]: must have either uri or bufferView"},
    {"'path':'translation'", "'path':'rotation'", "accessor 5: type VEC3 cannot be used here"},
    {"'target':{'node':0,", "'target':{'node':3,", "animations[0]: channels[0]: node: must be an index"},
    {"'channels':[", "'channels':[{'sampler':0,'target':{'node':0,'path':'translation'}},",
     "is animated twice"},
    {"'channels':[{'sampler':0", "'channels':[{'sampler':1", "sampler: 1 is not one of the animation's 1"},
    {"'input':4", "'input':4,'interpolation':'SPLINE'", "interpolation: must be"},
    {"'input':4", "'input':4,'interpolation':'CUBICSPLINE'", "output: accessor 5 has 2 elements for 2 keys"},
    {"'input':4", "'input':5", "accessor 5: type VEC3"},
    {"'count':4,", "'count':5,", "accessor 0: reaches past bufferView 0"},
    {"'count':4,", "'count':0,", "accessor 0: count: must be an integer from 1"},
    {"'count':4,", "'count':2147483649,", "accessor 0: count"},
    {"'count':4,", "'count':99999999999999999999,", "too big"},
    {"'count':4,", "'byteOffset':4,'count':4,", "accessor 0: reaches past bufferView 0"},
    {"'count':4,", "'byteOffset':-4,'count':4,", "accessor 0: byteOffset"},
    {"'count':4,", "'byteOffset':4294967295,'count':4,", "accessor 0: reaches past"},
    {"'componentType':5126", "'componentType':5124", "accessor 0: componentType 5124"},
    {"'componentType':5126", "'componentType':5123", "accessor 0: componentType 5123 cannot be used here"},
    {"'componentType':5126", "'componentType':'FLOAT'", "accessor 0: componentType: must be an integer"},
    {"'type':'VEC3'", "'type':'MAT4'", "accessor 0: type MAT4"},
    {"{'bufferView':0,'componentType':5126,'count':4,", "{'componentType':5126,'count':1048577,",
     "without bufferView has at most 1048576"},
    {"{'buffer':0,'byteLength':48}", "{'buffer':0,'byteLength':48,'byteStride':8}",
     "elements of 12 bytes overlap"},
    {"{'buffer':0,'byteLength':48}", "{'buffer':0,'byteLength':48,'byteStride':13}", "multiple of 4"},
    {"{'buffer':0,'byteLength':48}", "{'buffer':0,'byteLength':48,'byteStride':256}", "byteStride: must be"},
    {"{'buffer':0,'byteLength':48}", "{'buffer':0,'byteLength':173}", "bufferViews[0]: reaches past the end"},
    {"{'buffer':0,'byteLength':48}", "{'buffer':0,'byteOffset':173,'byteLength':1}", "reaches past the end"},
    {"{'buffer':0,'byteLength':48}", "{'buffer':1,'byteLength':48}",
     "bufferViews[0]: buffer: must be an index"},
    {"{'buffer':0,'byteLength':48}", "{'byteLength':48}", "bufferViews[0]: buffer: is required"},
    {"'byteLength':172", "'byteLength':173",
     "buffers[0]: byteLength: 173 bytes are declared, the BIN chunk has 172"},
    {"'byteLength':172", "'byteLength':0", "buffers[0]: byteLength: must be an integer from 1"},
    {"'byteLength':172}", "'byteLength':172},{'byteLength':4}", "buffers[1]: uri: is missing"},
    {"'byteLength':172", "'byteLength':172,'uri':'data:application/octet-stream;base64,AAAA'",
     "has 3 bytes, 172 are declared"},
    {"'byteLength':172", "'byteLength':172,'uri':'other.bin'", "a scene in memory can name no file"},
    {"'asset':", "'asset':{},'asset':", "duplicate"},
    {"'mesh':0", "'name':'no mesh'", "no triangles in its default scene"},
    {"'indices':3", "'mode':1", "no triangles in its default scene"},
};

static void wrong_places_are_named(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof wrong_places / sizeof *wrong_places; i++) {
        const struct gltf_case_change change = {wrong_places[i].old, wrong_places[i].new};
        gltf_case_expect_refusal(&change, 1, &gltf_case_base_data, sizeof gltf_case_base_data,
                                 wrong_places[i].text);
    }
}

static void not_numbers_are_named(void **state) {
    (void)state;
    struct gltf_case_base_data data = gltf_case_base_data;
    data.position[3][1] = NAN;
    GLTF_CASE_REFUSE(
        "meshes[0]: primitives[0]: attributes.POSITION: accessor 0: element 3 is not a finite number", data,
        gltf_case_no_change);
    data = gltf_case_base_data;
    data.position[0][1] = INFINITY;
    GLTF_CASE_REFUSE("element 0 is not a finite number", data, gltf_case_no_change);
    data = gltf_case_base_data;
    data.position[1][0] = 2e9f;
    GLTF_CASE_REFUSE("element 1 is farther than 1e+09 m", data, gltf_case_no_change);
    data = gltf_case_base_data;
    data.normal[2][0] = NAN;
    GLTF_CASE_REFUSE("attributes.NORMAL: accessor 1: element 2", data, gltf_case_no_change);
    data = gltf_case_base_data;
    data.uv[1][1] = -INFINITY;
    GLTF_CASE_REFUSE("attributes.TEXCOORD_0: accessor 2: element 1", data, gltf_case_no_change);
    data = gltf_case_base_data;
    data.value[1][0] = NAN;
    GLTF_CASE_REFUSE("animations[0]: channels[0]: samplers[0]: output: accessor 5: element 1", data,
                     gltf_case_no_change);
    data = gltf_case_base_data;
    data.time[1] = 0;
    GLTF_CASE_REFUSE("input: accessor 4: times must be", data, gltf_case_no_change);
    data = gltf_case_base_data;
    data.time[0] = -1;
    GLTF_CASE_REFUSE("input: accessor 4: times must be", data, gltf_case_no_change);
    data = gltf_case_base_data;
    data.index[4] = 4;
    GLTF_CASE_REFUSE("indices: accessor 3: triangle 1 uses vertex 4, POSITION has 4 vertices", data,
                     gltf_case_no_change);
}

/* ---- nodes, textures, animation ---- */

static void only_the_default_scene_counts(void **state) {
    (void)state;
    struct lw_scene *scene;
    GLTF_CASE_LOAD(scene, gltf_case_base_data,
                   {"'scene':0,'scenes':[", "'scene':1,'scenes':[{'nodes':[2]},"});
    assert_int_equal(scene->node_count, 3);
    lw_scene_destroy(scene);
    GLTF_CASE_REFUSE("no triangles", gltf_case_base_data,
                     {"'scene':0,'scenes':[", "'scenes':[{'nodes':[2]},"});
    GLTF_CASE_LOAD(scene, gltf_case_base_data, {"'scene':0,'scenes':[{'name':'base','nodes':[0,2]}],", ""});
    assert_int_equal(scene->object_count, 1);
    assert_int_equal(scene->light_count, 1);
    lw_scene_destroy(scene);
    GLTF_CASE_LOAD(scene, gltf_case_base_data, {"'nodes':[0,2]", "'nodes':[0]"});
    assert_int_equal(scene->light_count, 0);
    assert_int_equal(scene->camera_count, 0);
    lw_scene_destroy(scene);
}

/* ---- extensions ---- */

static void harmless_extensions_may_be_required(void **state) {
    (void)state;
    static const char *const names[] = {"anisotropy", "clearcoat",   "diffuse_transmission",
                                        "dispersion", "iridescence", "sheen",
                                        "variants",   "volume"};
    char talk[4096], change[256], line[128];
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        snprintf(change, sizeof change,
                 "'extensionsRequired':['KHR_materials_%s'],'extensionsUsed':['KHR_materials_%s',", names[i],
                 names[i]);
        snprintf(line, sizeof line, "the extension KHR_materials_%s is ignored", names[i]);
        const struct gltf_case_change changes[] = {{"'extensionsUsed':[", change}};
        struct lw_scene *scene = gltf_case_load_and_listen(changes, 1, &gltf_case_base_data,
                                                           sizeof gltf_case_base_data, talk, sizeof talk);
        if (!strstr(talk, line) || gltf_case_count_lines(talk) != 1) fail_msg("talk is \"%s\"", talk);
        lw_scene_destroy(scene);
    }
}

static void many_unknown_extensions_take_eleven_lines(void **state) {
    (void)state;
    enum { COUNT = 20000 };
    char *list = malloc(COUNT * 16 + 64), *at = list, talk[4096];
    at += sprintf(at, "'extensionsUsed':[");
    for (int i = 0; i < COUNT; i++) at += sprintf(at, "'ACME_%d',", i);
    const struct gltf_case_change changes[] = {{"'extensionsUsed':[", list}};
    struct lw_scene *scene = gltf_case_load_and_listen(changes, 1, &gltf_case_base_data,
                                                       sizeof gltf_case_base_data, talk, sizeof talk);
    assert_int_equal(gltf_case_count_lines(talk), 11);
    assert_non_null(strstr(talk, "ACME_9 is ignored"));
    assert_null(strstr(talk, "ACME_10 "));
    assert_non_null(strstr(talk, "19990 more extensions are ignored"));
    lw_scene_destroy(scene);
    free(list);
}

static void integers_may_have_a_point(void **state) {
    (void)state;
    struct lw_scene *scene;
    GLTF_CASE_LOAD(scene, gltf_case_base_data,
                   {"{'buffer':0,'byteLength':48}", "{'buffer':0.0,'byteLength':48.0}"},
                   {"'children':[1]", "'children':[1.0]"}, {"'nodes':[0,2]", "'nodes':[0.0,2]"},
                   {"'count':4,", "'count':4.0,"}, {"'scene':0", "'scene':0.0"});
    assert_int_equal(scene->object_count, 1);
    assert_int_equal(scene->node[scene->object[0].node].parent, 0);
    assert_int_equal(scene->mesh[0].vertex_count, 4);
    lw_scene_destroy(scene);
}

static void what_is_not_used_is_no_error(void **state) {
    (void)state;
    struct lw_scene *scene;
    GLTF_CASE_LOAD(scene, gltf_case_base_data,
                   {"'KHR_texture_transform'", "'KHR_texture_transform','KHR_materials_clearcoat'"},
                   {"{'mesh':0}", "{'mesh':0,'weights':[1]}"}, {"'indices':3", "'indices':3,'targets':[{}]"},
                   {"'path':'translation'", "'path':'weights'"}, {"'intensity':8", "'intensity':8,'range':3"},
                   {"'baseColorTexture':{'index':0}", "'baseColorTexture':{'index':0,'texCoord':2}"},
                   {"[0.5,0.25,0.125,1]", "[1.5,0.25,0.125,1]"});
    assert_int_equal(scene->channel_count, 0);
    assert_float_equal(scene->material[0].base_colour[0], 1, 0);
    assert_int_equal(scene->material[0].base_colour_texture.texture, LW_SCENE_NONE);
    lw_scene_destroy(scene);
}

/* ---- size and shape ---- */

/* Nodes 0..count-1 in a row, the last one with the mesh. children: format of what follows a node's number. */
static char *nested(unsigned count, bool shared) {
    size_t capacity = (size_t)count * 48 + 4096;
    char *nodes = malloc(capacity), *at = nodes;
    at += sprintf(at, "'nodes':[{'name':'top','children':[1]}");
    for (unsigned i = 1; i + 1 < count; i++)
        at += shared ? sprintf(at, ",{'children':[%u,%u]}", i + 1, i + 1)
                     : sprintf(at, ",{'children':[%u]}", i + 1);
    sprintf(at, ",{'mesh':0}],");
    return nodes;
}

static enum lw_status load_nested(unsigned count, bool shared, struct lw_scene **out, struct lw_error *err) {
    char *nodes = nested(count, shared);
    const struct gltf_case_change changes[] = {
        {"'nodes':[{'name':'top','children':[1],'translation':[0,1,0]},{'mesh':0},"
         "{'name':'lamp','camera':0,'extensions':{'KHR_lights_punctual':{'light':0}}}],",
         nodes},
        {"'nodes':[0,2]", "'nodes':[0]"},
    };
    enum lw_status status =
        gltf_case_load_changed(changes, 2, &gltf_case_base_data, sizeof gltf_case_base_data, out, err);
    free(nodes);
    return status;
}

static void deep_hierarchies_load(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(load_nested(20000, false, &scene, &err), &err);
    assert_int_equal(scene->node_count, 20000);
    assert_int_equal(scene->node[19999].parent, 19998);
    lw_scene_destroy(scene);
}

static void shared_children_are_refused(void **state) {
    (void)state;
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    assert_int_equal(load_nested(42, true, &scene, &err), LW_BAD_DATA);
    assert_non_null(strstr(err.text, "two parents"));
}

static void deep_json_is_refused(void **state) {
    (void)state;
    enum { DEPTH = 100000 };
    uint8_t *text = malloc(DEPTH);
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    memset(text, '[', DEPTH);
    assert_int_equal(lw_gltf_load_memory(text, DEPTH, "deep.gltf", &scene, &err), LW_BAD_DATA);
    assert_non_null(strstr(err.text, "depth"));
    free(text);
}

/* ---- the container ---- */

static void expect_bytes_refused(const uint8_t *bytes, size_t size, const char *text) {
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    uint8_t *exact = malloc(size ? size : 1); /* so that a sanitizer sees a read past its end */
    memcpy(exact, bytes, size);
    enum lw_status status = lw_gltf_load_memory(exact, size, "x.glb", &scene, &err);
    free(exact);
    if (status != LW_BAD_DATA || !strstr(err.text, text))
        fail_msg("\"%s\" does not hold \"%s\"", err.text, text);
}

static void broken_containers_are_refused(void **state) {
    (void)state;
    size_t size;
    uint8_t *glb = lw_glb_pack("{'asset':{'version':'2.0'}}", "12345678", 8, &size);
    size_t binary = 20 + 28; /* where the BIN chunk's header starts */
    for (size_t cut = 4; cut < size; cut++) expect_bytes_refused(glb, cut, "truncated");
    for (size_t cut = 0; cut < 4; cut++) expect_bytes_refused(glb, cut, "x.glb: ");

    expect_bytes_refused(glb, size, "no triangles"); /* nothing wrong with the container itself */
    lw_glb_put_word(glb + 4, 1);
    expect_bytes_refused(glb, size, "is binary glTF 1");
    lw_glb_put_word(glb + 4, 2);
    lw_glb_put_word(glb + 8, 19);
    expect_bytes_refused(glb, size, "its header says 19 bytes: it is truncated");
    lw_glb_put_word(glb + 8, size - 4); /* what follows the end is not read: here the BIN chunk loses it */
    expect_bytes_refused(glb, size, "reach past the end");
    lw_glb_put_word(glb + 8, size);
    lw_glb_put_word(glb + binary, 12);
    expect_bytes_refused(glb, size, "chunk 1: its 12 bytes reach past the end");
    lw_glb_put_word(glb + binary, 0xfffffffc);
    expect_bytes_refused(glb, size, "chunk 1: its 4294967292 bytes reach past the end");
    lw_glb_put_word(glb + binary, 7);
    expect_bytes_refused(glb, size, "not a multiple of 4");
    lw_glb_put_word(glb + binary, 4);
    expect_bytes_refused(glb, size, "chunk 2: its header is truncated");
    lw_glb_put_word(glb + binary, 8);
    lw_glb_put_word(glb + 12, 28 + 16); /* the JSON chunk swallows the other one */
    expect_bytes_refused(glb, size, "line 1");
    lw_glb_put_word(glb + 12, 28 + 4); /* and here it ends inside the other's header */
    expect_bytes_refused(glb, size, "reach past the end");
    lw_glb_put_word(glb + 12, 28);
    memcpy(glb + binary + 4, "JSON", 4);
    expect_bytes_refused(glb, size, "the first chunk, and no other, must be JSON");
    memcpy(glb + 16, "BIN", 4);
    expect_bytes_refused(glb, size, "the first chunk, and no other, must be JSON");
    free(glb);
}

/* Validators warn of both, and programs write them. */
static void bytes_around_a_document_are_reported(void **state) {
    (void)state;
    size_t size;
    uint8_t *glb = lw_glb_pack(gltf_case_base_json, &gltf_case_base_data, sizeof gltf_case_base_data, &size);
    uint8_t *longer = calloc(1, size + 5);
    memcpy(longer, glb, size);
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    lw_support_ok(lw_gltf_load_memory(longer, size + 5, "x.glb", &scene, &err), &err);
    assert_int_equal(scene->object_count, 1);
    lw_scene_destroy(scene);
    free(longer);

    /* a .gltf with a byte order mark; without its buffer it comes to the line that asks for it */
    static const char marked[] =
        "\xEF\xBB\xBF{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":4}]}";
    expect_bytes_refused((const uint8_t *)marked, sizeof marked - 1, "buffers[0]: uri: is missing");
    expect_bytes_refused((const uint8_t *)marked, 3, "x.glb: ");
    free(glb);
}

/* Every prefix and every single wrong byte of a good file is read or refused: no crash, no leak. */
static void damaged_files_are_read_or_refused(void **state) {
    (void)state;
    size_t size;
    uint8_t *glb = lw_glb_pack(gltf_case_base_json, &gltf_case_base_data, sizeof gltf_case_base_data, &size);
    for (size_t i = 0; i < size; i++) {
        struct lw_scene *scene = NULL;
        uint8_t good = glb[i];
        glb[i] = (uint8_t)(good ^ (1 << i % 8));
        struct lw_error err = {0};
        enum lw_status status = lw_gltf_load_memory(glb, size, "x.glb", &scene, &err);
        assert_true(status == LW_OK || (status == LW_BAD_DATA && err.text[0] && !scene));
        lw_scene_destroy(scene);
        glb[i] = good;
    }
    free(glb);
}

int main(void) {
    lw_log_init("test_gltf", LW_LOG_ERROR);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_base_scene_arrives_whole),
        cmocka_unit_test(wrong_places_are_named),
        cmocka_unit_test(not_numbers_are_named),
        cmocka_unit_test(only_the_default_scene_counts),
        cmocka_unit_test(what_is_not_used_is_no_error),
        cmocka_unit_test(deep_hierarchies_load),
        cmocka_unit_test(shared_children_are_refused),
        cmocka_unit_test(deep_json_is_refused),
        cmocka_unit_test(broken_containers_are_refused),
        cmocka_unit_test(bytes_around_a_document_are_reported),
        cmocka_unit_test(harmless_extensions_may_be_required),
        cmocka_unit_test(many_unknown_extensions_take_eleven_lines),
        cmocka_unit_test(integers_may_have_a_point),
        cmocka_unit_test(damaged_files_are_read_or_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
