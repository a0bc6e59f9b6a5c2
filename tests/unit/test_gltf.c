/* The glTF reader against files made here: a base scene that holds one of everything, and what becomes of it
 * when one place in it is changed. */
#include "tests/support/glb.h"
#include "tests/support/support.h"

#include "common/log.h"
#include "common/scene/pose.h"
#include "server/import/gltf.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* 2 x 1 texels: (255, 0, 0, 255), (0, 128, 255, 64) */
#define PNG                                                                                                  \
    "iVBORw0KGgoAAAANSUhEUgAAAAIAAAABCAYAAAD0In+KAAAAEUlEQVR4nGP4z8Dwn6HhvwMAELoDvkeWIKAAAAAASU"             \
    "VORK5CYII="
/* a header that says 40,000 texels wide */
#define PNG_TOO_WIDE                                                                                         \
    "iVBORw0KGgoAAAANSUhEUgAAnEAAAAABCAYAAAC9YMuEAAAACElEQVR4nAMAAAAAAUgGidIAAAAASUVORK5CYII="

/* the same texels in other formats */
#define WEBP "UklGRiAAAABXRUJQVlA4TBQAAAAvAQAAEA8wgPs//w/6Dy1UIKL/AQ=="
#define AVIF                                                                                                 \
    "AAAAIGZ0eXBhdmlmAAAAAGF2aWZtaWYxbWlhZk1BMUEAAAGNbWV0YQAAAAAAAAAoaGRscgAAAAAAAAAAcGljdAAAAAAAAAAA"       \
    "AAAAAGxpYmF2aWYAAAAADnBpdG0AAAAAAAEAAAAsaWxvYwAAAABEAAACAAEAAAABAAABzgAAADYAAgAAAAEAAAG1AAAAGQAA"       \
    "AEJpaW5mAAAAAAACAAAAGmluZmUCAAAAAAEAAGF2MDFDb2xvcgAAAAAaaW5mZQIAAAAAAgAAYXYwMUFscGhhAAAAABppcmVm"       \
    "AAAAAAAAAA5hdXhsAAIAAQABAAAAw2lwcnAAAACdaXBjbwAAABRpc3BlAAAAAAAAAAIAAAABAAAAEHBpeGkAAAAAAwgICAAA"       \
    "AAxhdjFDgSAAAAAAABNjb2xybmNseAACAAIAAIAAAAAOcGl4aQAAAAABCAAAAAxhdjFDgQAcAAAAADhhdXhDAAAAAHVybjpt"       \
    "cGVnOm1wZWdCOmNpY3A6c3lzdGVtczphdXhpbGlhcnk6YWxwaGEAAAAAHmlwbWEAAAAAAAAAAgABBAECgwQAAgQBBYYHAAAA"       \
    "V21kYXQSAAoEGAAuVTIPEACG0okppdY/cr1yvYOAEgAKBzgALlAgIAkyKRAAAIu7FZWxIsAzAMwDaVAW/9VnFzqLWI9Yj2+e"       \
    "1Re9U38GGfIJ8gp5"

/* The binary part of the base scene: a square in the x-y plane, and a path of two keys. */
struct base_data {
    float position[4][3], normal[4][3], uv[4][2];
    uint16_t index[6];
    float time[2], value[2][3];
};

static const struct base_data base_data = {
    .position = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}},
    .normal = {{0, 0, 1}, {0, 0, 1}, {0, 0, 2}, {0, 0, 1}},
    .uv = {{0, 1}, {1, 1}, {0, 0}, {1, 0}},
    .index = {0, 1, 2, 2, 1, 3},
    .time = {0, 2},
    .value = {{0, 1, 0}, {0, 3, 0}},
};

/* ' stands for " */
static const char base_json[] =
    "{'asset':{'version':'2.0'},"
    "'extensionsUsed':['KHR_lights_punctual','KHR_materials_emissive_strength','KHR_texture_transform'],"
    "'extensions':{'KHR_lights_punctual':{'lights':[{'type':'spot','color':[1,0.5,0.25],'intensity':8,'spot':"
    "{}}]}},"
    "'scene':0,'scenes':[{'name':'base','nodes':[0,2]}],"
    "'nodes':[{'name':'top','children':[1],'translation':[0,1,0]},{'mesh':0},"
    "{'name':'lamp','camera':0,'extensions':{'KHR_lights_punctual':{'light':0}}}],"
    "'cameras':[{'type':'perspective','perspective':{'yfov':0.75}}],"
    "'meshes':[{'name':'square','primitives':[{'attributes':{'POSITION':0,'NORMAL':1,'TEXCOORD_0':2},'"
    "indices':3,"
    "'material':0}]}],"
    "'materials':[{'name':'paint','pbrMetallicRoughness':{'baseColorFactor':[0.5,0.25,0.125,1],"
    "'baseColorTexture':{'index':0}},'emissiveFactor':[1,0.5,0],"
    "'extensions':{'KHR_materials_emissive_strength':{'emissiveStrength':4}},"
    "'alphaMode':'MASK','alphaCutoff':0.25,'doubleSided':true}],"
    "'textures':[{'source':0,'sampler':0}],'samplers':[{'wrapS':33071,'wrapT':33648}],"
    "'images':[{'uri':'data:image/png;base64," PNG "'}],"
    "'animations':[{'channels':[{'sampler':0,'target':{'node':0,'path':'translation'}}],"
    "'samplers':[{'input':4,'output':5}]}],"
    "'accessors':[{'bufferView':0,'componentType':5126,'count':4,'type':'VEC3'},"
    "{'bufferView':1,'componentType':5126,'count':4,'type':'VEC3'},"
    "{'bufferView':2,'componentType':5126,'count':4,'type':'VEC2'},"
    "{'bufferView':3,'componentType':5123,'count':6,'type':'SCALAR'},"
    "{'bufferView':4,'componentType':5126,'count':2,'type':'SCALAR'},"
    "{'bufferView':5,'componentType':5126,'count':2,'type':'VEC3'}],"
    "'bufferViews':[{'buffer':0,'byteLength':48},{'buffer':0,'byteOffset':48,'byteLength':48},"
    "{'buffer':0,'byteOffset':96,'byteLength':32},{'buffer':0,'byteOffset':128,'byteLength':12},"
    "{'buffer':0,'byteOffset':140,'byteLength':8},{'buffer':0,'byteOffset':148,'byteLength':24}],"
    "'buffers':[{'byteLength':172}]}";

struct change {
    const char *old, *new;
};

static char *replace(char *text, const struct change *change) {
    char *at = strstr(text, change->old);
    if (!at) fail_msg("the base scene has no %s", change->old);
    char *out = malloc(strlen(text) + strlen(change->new) + 1);
    sprintf(out, "%.*s%s%s", (int)(at - text), text, change->new, at + strlen(change->old));
    free(text);
    return out;
}

static bool matt; /* of what is loaded next */

static enum lw_status load_json(const char *json, const void *data, size_t size, struct lw_scene **out,
                                struct lw_error *err) {
    size_t packed_size;
    uint8_t *packed = lw_glb_pack(json, data, size, &packed_size);
    const struct lw_gltf_options options = {.matt = matt};
    enum lw_status status = lw_gltf_load_bytes(packed, packed_size, "base.glb", &options, out, err);
    free(packed);
    return status;
}

static enum lw_status load_changed(const struct change *changes, size_t count, const void *data, size_t size,
                                   struct lw_scene **out, struct lw_error *err) {
    char *json = strdup(base_json);
    for (size_t i = 0; i < count; i++) json = replace(json, &changes[i]);
    enum lw_status status = load_json(json, data, size, out, err);
    free(json);
    return status;
}

/* The base scene with changes; it must load. */
#define LOAD(scene, data, ...)                                                                               \
    do {                                                                                                     \
        const struct change changes_[] = {__VA_ARGS__};                                                      \
        struct lw_error err_ = {0};                                                                          \
        lw_support_ok(load_changed(changes_, sizeof changes_ / sizeof *changes_, &(data), sizeof(data),      \
                                   &(scene), &err_),                                                         \
                      &err_);                                                                                \
    } while (0)

/* The base scene with changes; it must be refused with a line that holds `text`. */
#define REFUSE(text, data, ...)                                                                              \
    do {                                                                                                     \
        const struct change changes_[] = {__VA_ARGS__};                                                      \
        expect_refusal(changes_, sizeof changes_ / sizeof *changes_, &(data), sizeof(data), text);           \
    } while (0)

static void expect_refusal(const struct change *changes, size_t count, const void *data, size_t size,
                           const char *text) {
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    enum lw_status status = load_changed(changes, count, data, size, &scene, &err);
    if (status != LW_BAD_DATA)
        fail_msg("%s: status is \"%s\", text \"%s\"", text, lw_status_text(status), err.text);
    assert_null(scene);
    if (strncmp(err.text, "base.glb: ", 10) != 0 || !strstr(err.text, text))
        fail_msg("\"%s\" does not hold \"%s\"", err.text, text);
}

static const struct change no_change = {"'asset'", "'asset'"};

static void the_base_scene_arrives_whole(void **state) {
    (void)state;
    struct lw_scene *scene;
    LOAD(scene, base_data, no_change);
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
        const struct change change = {wrong_places[i].old, wrong_places[i].new};
        expect_refusal(&change, 1, &base_data, sizeof base_data, wrong_places[i].text);
    }
}

static void not_numbers_are_named(void **state) {
    (void)state;
    struct base_data data = base_data;
    data.position[3][1] = NAN;
    REFUSE("meshes[0]: primitives[0]: attributes.POSITION: accessor 0: element 3 is not a finite number",
           data, no_change);
    data = base_data;
    data.position[0][1] = INFINITY;
    REFUSE("element 0 is not a finite number", data, no_change);
    data = base_data;
    data.position[1][0] = 2e9f;
    REFUSE("element 1 is farther than 1e+09 m", data, no_change);
    data = base_data;
    data.normal[2][0] = NAN;
    REFUSE("attributes.NORMAL: accessor 1: element 2", data, no_change);
    data = base_data;
    data.uv[1][1] = -INFINITY;
    REFUSE("attributes.TEXCOORD_0: accessor 2: element 1", data, no_change);
    data = base_data;
    data.value[1][0] = NAN;
    REFUSE("animations[0]: channels[0]: samplers[0]: output: accessor 5: element 1", data, no_change);
    data = base_data;
    data.time[1] = 0;
    REFUSE("input: accessor 4: times must be", data, no_change);
    data = base_data;
    data.time[0] = -1;
    REFUSE("input: accessor 4: times must be", data, no_change);
    data = base_data;
    data.index[4] = 4;
    REFUSE("indices: accessor 3: triangle 1 uses vertex 4, POSITION has 4 vertices", data, no_change);
}

/* ---- accessors ---- */

static void sparse_accessors_replace_elements(void **state) {
    (void)state;
    const struct {
        struct base_data base;
        uint16_t index[2];
        float value[2][3];
    } data = {base_data, {1, 3}, {{2, 0, 0}, {2, 2, 0}}};
#define SPARSE_VIEWS                                                                                         \
    {"'byteOffset':148,'byteLength':24}",                                                                    \
     "'byteOffset':148,'byteLength':24},{'buffer':0,'byteOffset':172,'byteLength':4},"                       \
     "{'buffer':0,'byteOffset':176,'byteLength':24}"},                                                       \
    {                                                                                                        \
        "'byteLength':172", "'byteLength':200"                                                               \
    }
#define SPARSE(index_view, count)                                                                            \
    ",'sparse':{'count':" count ",'indices':{'bufferView':" index_view                                       \
    ",'componentType':5123},'values':{'bufferView':7}}"
    struct lw_scene *scene;
    LOAD(scene, data, SPARSE_VIEWS, {"'count':4,'type':'VEC3'", "'count':4,'type':'VEC3'" SPARSE("6", "2")});
    assert_float_equal(scene->mesh[0].position[1].x, 2, 0);
    assert_float_equal(scene->mesh[0].position[2].y, 1, 0);
    assert_float_equal(scene->mesh[0].position[3].y, 2, 0);
    lw_scene_destroy(scene);

    /* without a view the rest is zero: here two corners are left apart, and no triangle has an area */
    REFUSE("no triangles", data, SPARSE_VIEWS,
           {"{'bufferView':0,'componentType':5126,'count':4,'type':'VEC3'",
            "{'componentType':5126,'count':4,'type':'VEC3'" SPARSE("6", "1")});
    REFUSE("accessor 0: sparse: count: must be an integer from 1 to 4", data, SPARSE_VIEWS,
           {"'count':4,'type':'VEC3'", "'count':4,'type':'VEC3'" SPARSE("6", "5")});
    REFUSE("accessor 0: sparse: indices reaches past bufferView 6", data, SPARSE_VIEWS,
           {"'count':4,'type':'VEC3'", "'count':4,'type':'VEC3'" SPARSE("6", "3")});
    typeof(data) unordered = data, repeated = data, outside = data;
    memcpy((void *)unordered.index, (const uint16_t[]){3, 1}, 4);
    memcpy((void *)repeated.index, (const uint16_t[]){1, 1}, 4);
    memcpy((void *)outside.index, (const uint16_t[]){1, 4}, 4);
    const struct change sparse = {"'count':4,'type':'VEC3'", "'count':4,'type':'VEC3'" SPARSE("6", "2")};
    REFUSE("strictly increasing, element 1 is not", unordered, SPARSE_VIEWS, sparse);
    REFUSE("strictly increasing, element 1 is not", repeated, SPARSE_VIEWS, sparse);
    REFUSE("indices: 4 is past the accessor's 4 elements", outside, SPARSE_VIEWS, sparse);
}

static void interleaved_accessors_are_read_with_their_stride(void **state) {
    (void)state;
    struct {
        struct {
            float position[3], normal[3];
        } vertex[4];
        float rest[(sizeof base_data - 96) / 4];
    } data;
    for (int i = 0; i < 4; i++) {
        memcpy(data.vertex[i].position, base_data.position[i], 12);
        memcpy(data.vertex[i].normal, base_data.normal[i], 12);
    }
    memcpy(data.rest, base_data.uv, sizeof data.rest);
    struct lw_scene *scene;
    LOAD(scene, data, {"{'buffer':0,'byteLength':48}", "{'buffer':0,'byteLength':96,'byteStride':24}"},
         {"{'bufferView':1,", "{'bufferView':0,'byteOffset':12,"});
    for (int i = 0; i < 4; i++) {
        assert_memory_equal(&scene->mesh[0].position[i], base_data.position[i], 12);
        assert_float_equal(scene->mesh[0].normal[i].z, 1, 1e-6);
    }
    lw_scene_destroy(scene);
    REFUSE("accessor 1: reaches past bufferView 0", data,
           {"{'buffer':0,'byteLength':48}", "{'buffer':0,'byteLength':95,'byteStride':24}"},
           {"{'bufferView':1,", "{'bufferView':0,'byteOffset':12,"});
}

static void quantised_attributes_need_their_extension(void **state) {
    (void)state;
    struct {
        int16_t position[4][4]; /* the fourth pads */
        int8_t normal[4][4];
        uint16_t uv[4][2];
        uint16_t index[6];
        float time[2], value[2][3];
    } data = {.position = {{0, 0, 0}, {10, 0, 0}, {0, 10, 0}, {10, 10, 0}},
              .normal = {{0, 0, 127}, {0, 0, 127}, {0, 0, 127}, {0, -128, 0}},
              .uv = {{0, 65535}, {65535, 65535}, {0, 0}, {32768, 0}},
              .index = {0, 1, 2, 2, 1, 3},
              .time = {0, 2}};
#define QUANTISED                                                                                            \
    {"{'buffer':0,'byteLength':48},{'buffer':0,'byteOffset':48,'byteLength':48},"                            \
     "{'buffer':0,'byteOffset':96,'byteLength':32},{'buffer':0,'byteOffset':128,'byteLength':12},"           \
     "{'buffer':0,'byteOffset':140,'byteLength':8},{'buffer':0,'byteOffset':148,'byteLength':24}",           \
     "{'buffer':0,'byteLength':32,'byteStride':8},{'buffer':0,'byteOffset':32,'byteLength':16,'byteStride':" \
     "4},"                                                                                                   \
     "{'buffer':0,'byteOffset':48,'byteLength':16},{'buffer':0,'byteOffset':64,'byteLength':12},"            \
     "{'buffer':0,'byteOffset':76,'byteLength':8},{'buffer':0,'byteOffset':84,'byteLength':24}"},            \
        {"'byteLength':172", "'byteLength':108"},                                                            \
        {"{'bufferView':0,'componentType':5126", "{'bufferView':0,'componentType':5122"},                    \
        {"{'bufferView':1,'componentType':5126", "{'bufferView':1,'normalized':true,'componentType':5120"},  \
    {                                                                                                        \
        "{'bufferView':2,'componentType':5126", "{'bufferView':2,'normalized':true,'componentType':5123"     \
    }
    struct lw_scene *scene;
    LOAD(scene, data, QUANTISED, {"'scene':0", "'scene':0,'extensionsRequired':['KHR_mesh_quantization']"});
    assert_float_equal(scene->mesh[0].position[3].y, 10, 0);
    assert_float_equal(scene->mesh[0].normal[3].y, -1, 1e-6);
    assert_float_equal(scene->mesh[0].uv[0][3].x, 32768.0 / 65535, 1e-6);
    lw_scene_destroy(scene);
    LOAD(scene, data, QUANTISED, {"'scene':0", "'scene':0,'extensionsRequired':['KHR_mesh_quantization']"},
         {"{'bufferView':0,", "{'bufferView':0,'normalized':true,"});
    assert_float_equal(scene->mesh[0].position[3].y, 10.0 / 32767, 1e-9);
    lw_scene_destroy(scene);
    REFUSE("POSITION: accessor 0: componentType 5122 cannot be used here", data, QUANTISED);
}

static void colours_have_three_or_four_components(void **state) {
    (void)state;
    const struct {
        struct base_data base;
        uint8_t colour[4][4];
    } data = {base_data, {{255, 0, 51, 102}, {255, 255, 255, 255}, {0, 0, 0, 0}, {255, 0, 0, 0}}};
#define COLOUR(type, size)                                                                                   \
    {"'count':2,'type':'VEC3'}", "'count':2,'type':'VEC3'},{'bufferView':6,'componentType':5121,'"           \
                                 "normalized':true,'count':4,'type':'" type "'}"},                           \
        {"'byteOffset':148,'byteLength':24}",                                                                \
         "'byteOffset':148,'byteLength':24},{'buffer':0,'byteOffset':172,'byteLength':16" size "}"},         \
        {"'byteLength':172", "'byteLength':188"}, {                                                          \
        "'POSITION':0", "'POSITION':0,'COLOR_0':6"                                                           \
    }
    struct lw_scene *scene;
    LOAD(scene, data, COLOUR("VEC4", ""));
    assert_float_equal(scene->mesh[0].colour[0].z, 0.2, 1e-6);
    assert_float_equal(scene->mesh[0].colour[0].w, 0.4, 1e-6);
    lw_scene_destroy(scene);
    LOAD(scene, data, COLOUR("VEC3", ",'byteStride':4"));
    assert_float_equal(scene->mesh[0].colour[0].z, 0.2, 1e-6);
    assert_float_equal(scene->mesh[0].colour[0].w, 1, 0);
    lw_scene_destroy(scene);
    REFUSE("COLOR_0: accessor 6: type VEC2", data, COLOUR("VEC2", ""));
}

/* ---- primitives ---- */

static struct lw_vec3 face(const struct lw_mesh *mesh, uint32_t t) {
    const uint32_t *v = mesh->triangle[t];
    return lw_vec3_cross(lw_vec3_sub(mesh->position[v[1]], mesh->position[v[0]]),
                         lw_vec3_sub(mesh->position[v[2]], mesh->position[v[0]]));
}

static void strips_and_fans_keep_their_winding(void **state) {
    (void)state;
    struct lw_scene *scene;
    LOAD(scene, base_data, {"'indices':3", "'mode':5"});
    assert_int_equal(scene->mesh[0].triangle_count, 2);
    assert_int_equal(scene->mesh[0].vertex_count, 4);
    for (uint32_t t = 0; t < 2; t++) assert_float_equal(face(&scene->mesh[0], t).z, 1, 0);
    lw_scene_destroy(scene);

    struct base_data data = base_data;
    memcpy(data.position[2], base_data.position[3], 12); /* around the square */
    memcpy(data.position[3], base_data.position[2], 12);
    LOAD(scene, data, {"'indices':3", "'mode':6"});
    assert_int_equal(scene->mesh[0].triangle_count, 2);
    for (uint32_t t = 0; t < 2; t++) assert_float_equal(face(&scene->mesh[0], t).z, 1, 0);
    lw_scene_destroy(scene);
}

static void missing_normals_are_flat(void **state) {
    (void)state;
    struct base_data data = base_data;
    data.position[3][2] = 1; /* the second triangle rises */
    struct lw_scene *scene;
    LOAD(scene, data, {"'NORMAL':1,", ""});
    const struct lw_mesh *mesh = &scene->mesh[0];
    assert_int_equal(mesh->vertex_count, 6);
    for (uint32_t t = 0; t < 2; t++) {
        struct lw_vec3 n = lw_vec3_normalize(face(mesh, t));
        for (int k = 0; k < 3; k++)
            assert_float_equal(lw_vec3_dot(n, mesh->normal[mesh->triangle[t][k]]), 1, 1e-6);
    }
    assert_true(face(mesh, 1).x < 0);
    lw_scene_destroy(scene);

    data = base_data; /* a normal of no length gets its face's */
    memset(data.normal, 0, sizeof data.normal);
    LOAD(scene, data, no_change);
    assert_int_equal(scene->mesh[0].vertex_count, 4);
    assert_float_equal(scene->mesh[0].normal[3].z, 1, 1e-6);
    lw_scene_destroy(scene);
}

static void triangles_without_area_are_left_out(void **state) {
    (void)state;
    struct base_data data = base_data;
    memcpy(data.position[3], data.position[2], 12);
    struct lw_scene *scene;
    LOAD(scene, data, no_change);
    assert_int_equal(scene->mesh[0].triangle_count, 1);
    assert_int_equal(scene->mesh[0].vertex_count, 3); /* nobody uses the fourth */
    lw_scene_destroy(scene);
    data = base_data;
    data.index[5] = 1;
    LOAD(scene, data, no_change);
    assert_int_equal(scene->mesh[0].triangle_count, 1);
    lw_scene_destroy(scene);
    /* small is not degenerate */
    data = base_data;
    for (int i = 0; i < 4; i++)
        for (int c = 0; c < 3; c++) data.position[i][c] *= 1e-7f;
    LOAD(scene, data, no_change);
    assert_int_equal(scene->mesh[0].triangle_count, 2);
    lw_scene_destroy(scene);
}

static void a_mesh_keeps_a_material_per_triangle(void **state) {
    (void)state;
    struct lw_scene *scene;
    LOAD(scene, base_data,
         {"'primitives':[", "'primitives':[{'attributes':{'POSITION':0},'indices':3},"
                            "{'attributes':{'POSITION':0},'mode':0},"});
    const struct lw_mesh *mesh = &scene->mesh[0];
    assert_int_equal(scene->mesh_count, 1);
    assert_int_equal(mesh->triangle_count, 4);
    assert_int_equal(scene->material_count, 2);
    assert_int_equal(mesh->material[0], mesh->material[1]);
    assert_int_not_equal(mesh->material[1], mesh->material[2]);
    const struct lw_material *plain = &scene->material[mesh->material[0]];
    for (int c = 0; c < 4; c++) assert_float_equal(plain->base_colour[c], 1, 0);
    assert_int_equal(plain->alpha_mode, LW_ALPHA_OPAQUE);
    assert_false(plain->double_sided);
    lw_scene_destroy(scene);
}

/* ---- nodes, textures, animation ---- */

static void nodes_share_meshes_and_lights(void **state) {
    (void)state;
    struct lw_scene *scene;
    LOAD(scene, base_data, {"'nodes':[0,2]", "'nodes':[0,2,3]"},
         {"{'light':0}}}]", "{'light':0}}},{'mesh':0,'extensions':{'KHR_lights_punctual':{'light':0}}}]"});
    assert_int_equal(scene->mesh_count, 1);
    assert_int_equal(scene->object_count, 2);
    assert_int_equal(scene->light_count, 2);
    assert_int_not_equal(scene->light[0].node, scene->light[1].node);
    assert_memory_equal(scene->light[0].intensity, scene->light[1].intensity,
                        sizeof scene->light[0].intensity);
    lw_scene_destroy(scene);
}

static void extras_say_who_draws_a_light(void **state) {
    (void)state;
    struct lw_scene *scene;
    LOAD(scene, base_data, {"'intensity':8", "'intensity':8,'extras':{'lightwell':{'clientLight':false}}"},
         {"'doubleSided':true", "'doubleSided':true,'extras':{'lightwell':{'clientLight':true}}"});
    assert_int_equal(scene->light[0].drawn_by, LW_DRAWN_BY_SERVER);
    assert_int_equal(scene->material[0].drawn_by, LW_DRAWN_BY_CLIENTS);
    lw_scene_destroy(scene);
    /* extras of others, which may be anything, and ours that say something else */
    LOAD(scene, base_data, {"'intensity':8", "'intensity':8,'extras':['clientLight']"},
         {"'doubleSided':true",
          "'doubleSided':true,'extras':{'clientLight':true,'lightwell':{'lightmap':''}}"});
    assert_int_equal(scene->light[0].drawn_by, LW_DRAWN_BY_RULE);
    assert_int_equal(scene->material[0].drawn_by, LW_DRAWN_BY_RULE);
    lw_scene_destroy(scene);
}

static void only_the_default_scene_counts(void **state) {
    (void)state;
    struct lw_scene *scene;
    LOAD(scene, base_data, {"'scene':0,'scenes':[", "'scene':1,'scenes':[{'nodes':[2]},"});
    assert_int_equal(scene->node_count, 3);
    lw_scene_destroy(scene);
    REFUSE("no triangles", base_data, {"'scene':0,'scenes':[", "'scenes':[{'nodes':[2]},"});
    LOAD(scene, base_data, {"'scene':0,'scenes':[{'name':'base','nodes':[0,2]}],", ""});
    assert_int_equal(scene->object_count, 1);
    assert_int_equal(scene->light_count, 1);
    lw_scene_destroy(scene);
    LOAD(scene, base_data, {"'nodes':[0,2]", "'nodes':[0]"});
    assert_int_equal(scene->light_count, 0);
    assert_int_equal(scene->camera_count, 0);
    lw_scene_destroy(scene);
}

static void a_matrix_is_column_major(void **state) {
    (void)state;
    struct lw_scene *scene;
    LOAD(scene, base_data, {"{'mesh':0}", "{'mesh':0,'matrix':[1,2,3,0,4,5,6,0,7,8,10,0,11,12,13,1]}"});
    const struct lw_node *node = &scene->node[scene->object[0].node];
    assert_true(node->has_matrix);
    assert_float_equal(node->matrix.m[0][1], 4, 0);
    assert_float_equal(node->matrix.m[2][0], 3, 0);
    assert_float_equal(node->matrix.m[1][3], 12, 0);
    lw_scene_destroy(scene);
}

static void a_texture_transform_moves_its_coordinates(void **state) {
    (void)state;
    struct lw_scene *scene;
    LOAD(scene, base_data,
         {"'baseColorTexture':{'index':0}",
          "'baseColorTexture':{'index':0,'extensions':{'KHR_texture_transform':"
          "{'offset':[0.5,-0.25],'rotation':1.5707963,'scale':[2,3],'texCoord':1}}}"});
    const struct lw_texture_use *use = &scene->material[0].base_colour_texture;
    assert_int_equal(use->uv_set, 1);
    /* a quarter turn: u' = 3 v + 0.5, v' = -2 u - 0.25 */
    const float expected[6] = {0, 3, 0.5f, -2, 0, -0.25f};
    for (int i = 0; i < 6; i++) assert_float_equal(use->transform[i], expected[i], 1e-6);
    lw_scene_destroy(scene);
    REFUSE("KHR_texture_transform: scale", base_data,
           {"'baseColorTexture':{'index':0}",
            "'baseColorTexture':{'index':0,'extensions':{'KHR_texture_transform':{'scale':2}}}"});
}

static void images_are_decoded_once(void **state) {
    (void)state;
    struct lw_scene *scene;
    LOAD(scene, base_data,
         {"'alphaMode'", "'emissiveTexture':{'index':1},'normalTexture':{'index':2},'alphaMode'"},
         {"'textures':[", "'textures':[{'source':0,'sampler':1},{'source':0,'sampler':0},{'source':1},"},
         {"'wrapT':33648}", "'wrapT':33648},{'wrapS':33071}"},
         {"'images':[", "'images':[{'uri':'data:image/png;base64," PNG "'},{'uri':'../never/read.png'},"});
    const struct lw_material *material = &scene->material[0];
    assert_int_equal(scene->texture_count, 2); /* they differ in how they repeat */
    assert_ptr_equal(scene->texture[0].rgba, scene->texture[1].rgba);
    assert_int_not_equal(material->base_colour_texture.texture, material->emission_texture.texture);
    lw_scene_destroy(scene);
}

/* What is told while `changes` are loaded; the scene must load. */
static struct lw_scene *load_and_listen(const struct change *changes, size_t count, const void *data,
                                        size_t size, char *talk, size_t talk_size) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    fflush(stderr);
    int saved = dup(STDERR_FILENO),
        file = open(lw_support_temporary("talk"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    assert_true(saved >= 0 && file >= 0 && dup2(file, STDERR_FILENO) >= 0);
    lw_log_init("test_gltf", LW_LOG_WARNING);
    enum lw_status status = load_changed(changes, count, data, size, &scene, &err);
    lw_log_init("test_gltf", LW_LOG_ERROR);
    fflush(stderr);
    dup2(saved, STDERR_FILENO);
    ssize_t length = pread(file, talk, talk_size - 1, 0);
    talk[length > 0 ? length : 0] = 0;
    close(saved);
    close(file);
    lw_support_ok(status, &err);
    return scene;
}

static unsigned count_lines(const char *text) {
    unsigned lines = 0;
    for (; *text; text++) lines += *text == '\n';
    return lines;
}

/* Each way in which a picture fails gives one warning that names it, and a colour in its place. */
static void unreadable_pictures_have_a_stand_in(void **state) {
    (void)state;
    static const struct {
        struct change change;
        const char *text;
    } failures[] = {
        {{"'uri':'data:image/png;base64," PNG "'", "'bufferView':0"},
         "images[0]: is not PNG, JPEG, WebP, AVIF, TGA or BMP"},
        {{"data:image/png;base64," PNG, "data:image/png;base64," PNG_TOO_WIDE}, "Invalid IHDR data"},
        {{"data:image/png;base64," PNG, "data:image/png;base64,iVBORw0KGgoAAAANSUhEUg"}, "it is truncated"},
        {{"{'source':0,'sampler':0}", "{'extensions':{'KHR_texture_basisu':{'source':0}}}"},
         "have no image in a format that is read; a colour stands in: \"textures[0]\""},
        {{"data:image/png;base64,", "data:image/png;base64,!"}, "is not base64"},
        {{"data:image/png;base64,", "data:image/png,"}, "must be data:TYPE;base64"},
        {{"data:image/png;base64," PNG, "http://host/a.png"}, "http://host/a.png"},
        {{"data:image/png;base64," PNG, "file:///etc/passwd"}, "only data: and relative paths"},
        {{"data:image/png;base64," PNG, "C:\\\\textures\\\\a.png"}, "only data: and relative paths"},
        {{"data:image/png;base64," PNG, "/etc/passwd"}, "leaves the folder"},
        {{"data:image/png;base64," PNG, "../textures/a.png"}, "uri \"../textures/a.png\": leaves the folder"},
        {{"data:image/png;base64," PNG, "a/%2e%2e/%2E./a.png"}, "leaves the folder"},
        {{"data:image/png;base64," PNG, "%2fetc/passwd"}, "leaves the folder"},
        {{"data:image/png;base64," PNG, "a%00.png"}, "wrong %-escape"},
        {{"data:image/png;base64," PNG, "a%4"}, "wrong %-escape"},
        {{"data:image/png;base64," PNG, ""}, "must have 1 to"},
        {{"data:image/png;base64," PNG, "a\\n\\u001b[31m.png"}, "a??[31m.png"},
    };
    char talk[4096];
    for (size_t i = 0; i < sizeof failures / sizeof *failures; i++) {
        const struct change changes[] = {failures[i].change,
                                         {"'alphaMode'", "'emissiveTexture':{'index':0},'alphaMode'"}};
        struct lw_scene *scene = load_and_listen(changes, 2, &base_data, sizeof base_data, talk, sizeof talk);
        const struct lw_material *material = &scene->material[0];
        if (!strstr(talk, failures[i].text) || count_lines(talk) != 1) fail_msg("talk is \"%s\"", talk);
        assert_int_equal(scene->texture_count, 0);
        assert_int_equal(material->base_colour_texture.texture, LW_SCENE_NONE);
        assert_int_equal(material->emission_texture.texture, LW_SCENE_NONE);
        assert_float_equal(material->base_colour[0], 0.25, 0); /* half of 0.5 */
        assert_float_equal(material->base_colour[3], 1, 0);
        assert_float_equal(material->emission[0], 0, 0);
        lw_scene_destroy(scene);
    }
}

static void pictures_of_extensions_are_read(void **state) {
    (void)state;
    static const struct {
        const char *extension, *uri;
    } formats[] = {{"EXT_texture_webp", "data:image/webp;base64," WEBP},
                   {"EXT_texture_avif", "data:image/avif;base64," AVIF}};
    for (size_t i = 0; i < sizeof formats / sizeof *formats; i++)
        for (int fallback = 0; fallback < 2; fallback++) {
            char texture[128], required[128];
            snprintf(texture, sizeof texture, "{%s'sampler':0,'extensions':{'%s':{'source':0}}}",
                     fallback ? "'source':1," : "", formats[i].extension);
            snprintf(required, sizeof required, "'asset':{'version':'2.0'},'extensionsRequired':['%s']",
                     formats[i].extension);
            struct lw_scene *scene;
            LOAD(scene, base_data, {"{'source':0,'sampler':0}", texture},
                 {"'asset':{'version':'2.0'}", required},
                 {"data:image/png;base64," PNG "'}", "@'},{'uri':'@'}"}, {"@", formats[i].uri});
            const uint8_t texels[8] = {255, 0, 0, 255, 0, 128, 255, 64};
            assert_int_equal(scene->texture_count, 1);
            assert_memory_equal(scene->texture[0].rgba, texels, sizeof texels);
            lw_scene_destroy(scene);
        }
}

/* Exporters write a spot without a soft edge with equal cones, though glTF forbids it. */
static void a_spot_without_a_soft_edge_is_read(void **state) {
    (void)state;
    const struct change change = {"'spot':{}", "'spot':{'innerConeAngle':0.5,'outerConeAngle':0.5}"};
    char talk[4096];
    struct lw_scene *scene = load_and_listen(&change, 1, &base_data, sizeof base_data, talk, sizeof talk);
    if (!strstr(talk, "innerConeAngle") || count_lines(talk) != 1) fail_msg("talk is \"%s\"", talk);
    assert_float_equal(scene->light[0].outer_cone, 0.5, 0);
    assert_true(scene->light[0].inner_cone < 0.5f && scene->light[0].inner_cone > 0.49f);
    lw_scene_destroy(scene);
}

static void emission_is_strength_times_texture(void **state) {
    (void)state;
    struct lw_scene *scene;
    LOAD(scene, base_data, {"'alphaMode'", "'emissiveTexture':{'index':0},'alphaMode'"});
    struct lw_surface surface;
    /* the middle of the right texel, (0, 128, 255) in sRGB, at u = 0.75; factor (1, 0.5, 0) x 4 */
    lw_scene_surface(scene, &scene->mesh[0], 0, 0.75f, 0, &surface);
    assert_float_equal(surface.emission.x, 0, 1e-6);
    assert_float_equal(surface.emission.y, 4 * 0.5f * powf((128 / 255.0f + 0.055f) / 1.055f, 2.4f), 1e-5);
    assert_float_equal(surface.emission.z, 0, 1e-6);
    lw_scene_destroy(scene);
}

static void albedo_above_one_is_lowered_and_told_once(void **state) {
    (void)state;
    char talk[4096];
    const struct change bright[] = {{"[0.5,0.25,0.125,1]", "[1.5,0.25,7,1]"}};
    struct lw_scene *scene = load_and_listen(bright, 1, &base_data, sizeof base_data, talk, sizeof talk);
    assert_float_equal(scene->material[0].base_colour[0], 1, 0);
    assert_float_equal(scene->material[0].base_colour[1], 0.25, 0);
    assert_float_equal(scene->material[0].base_colour[2], 1, 0);
    assert_int_equal(count_lines(talk), 1);
    assert_non_null(strstr(talk, "base colours above 1 are lowered to 1: \"materials[0] paint\""));
    lw_scene_destroy(scene);

    const struct {
        struct base_data base;
        float colour[4][3];
    } data = {base_data, {{2, 0.5f, 0}, {3, 1, 1}, {1, 1, 1}, {1, 1, 1}}};
#define FLOAT_COLOUR                                                                                         \
    {"'count':2,'type':'VEC3'}",                                                                             \
     "'count':2,'type':'VEC3'},{'bufferView':6,'componentType':5126,'count':4,'type':'VEC3'}"},              \
        {"'byteOffset':148,'byteLength':24}",                                                                \
         "'byteOffset':148,'byteLength':24},{'buffer':0,'byteOffset':172,'byteLength':48}"},                 \
        {"'byteLength':172", "'byteLength':220"}, {                                                          \
        "'POSITION':0", "'POSITION':0,'COLOR_0':6"                                                           \
    }
    const struct change colours[] = {FLOAT_COLOUR};
    scene = load_and_listen(colours, 4, &data, sizeof data, talk, sizeof talk);
    assert_float_equal(scene->mesh[0].colour[0].x, 1, 0);
    assert_float_equal(scene->mesh[0].colour[0].y, 0.5, 0);
    assert_int_equal(count_lines(talk), 1);
    assert_non_null(strstr(talk, "vertex colours above 1 are lowered to 1: \"meshes[0] square\""));
    lw_scene_destroy(scene);

    typeof(data) negative = data;
    ((struct {
        struct base_data base;
        float colour[4][3];
    } *)(void *)&negative)
        ->colour[1][2] = -0.5f;
    REFUSE("attributes.COLOR_0: accessor 6: element 1 is negative", negative, FLOAT_COLOUR);
}

/* ---- extensions ---- */

static void hidden_nodes_have_no_objects_and_no_lights(void **state) {
    (void)state;
#define HIDDEN "'extensions':{'KHR_node_visibility':{'visible':false}}"
    struct lw_scene *scene;
    /* three squares: one below a hidden node, one hidden, one shown; a lamp below a hidden node */
    LOAD(scene, base_data, {"{'name':'top',", "{'name':'top'," HIDDEN ","},
         {"{'name':'lamp',", "{'mesh':0,'name':'lamp',"}, {"'nodes':[0,2]", "'nodes':[0,2,3,4]"},
         {"{'light':0}}}]",
          "{'light':0}}},{'mesh':0," HIDDEN "},{" HIDDEN ",'children':[5]},{'camera':0,'extensions':"
          "{'KHR_lights_punctual':{'light':0},'KHR_node_visibility':{'visible':true}}}]"});
    assert_int_equal(scene->object_count, 1);
    assert_string_equal(scene->object[0].name, "lamp");
    assert_int_equal(scene->light_count, 1);
    assert_string_equal(scene->node[scene->light[0].node].name, "lamp");
    assert_int_equal(scene->camera_count, 2); /* a camera is no thing to see */
    lw_scene_destroy(scene);
}

static void coarser_levels_are_left_out(void **state) {
    (void)state;
    struct lw_scene *scene;
    LOAD(scene, base_data, {"'nodes':[0,2]", "'nodes':[0,2,3]"},
         {"{'mesh':0}", "{'mesh':0,'extensions':{'MSFT_lod':{'ids':[3,1]}}}"},
         {"{'light':0}}}]", "{'light':0}}},{'children':[4]},{'mesh':0}]"});
    assert_int_equal(scene->object_count, 1);
    assert_int_equal(scene->node[scene->object[0].node].parent, 0);
    lw_scene_destroy(scene);
}

static void specular_glossiness_gives_its_diffuse_colour(void **state) {
    (void)state;
#define GLOSSY(fields)                                                                                       \
    {                                                                                                        \
        "{'KHR_materials_emissive_strength':",                                                               \
            "{'KHR_materials_pbrSpecularGlossiness':{" fields "},'KHR_materials_emissive_strength':"         \
    }
    struct lw_scene *scene;
    LOAD(scene, base_data, GLOSSY("'diffuseFactor':[0.125,0.5,0.75,0.5],'specularFactor':[0.9,0.9,0.9]"),
         {"'scene':0", "'scene':0,'extensionsRequired':['KHR_materials_pbrSpecularGlossiness']"});
    const float expected[4] = {0.125f, 0.5f, 0.75f, 0.5f};
    for (int c = 0; c < 4; c++) assert_float_equal(scene->material[0].base_colour[c], expected[c], 0);
    assert_int_equal(scene->material[0].base_colour_texture.texture, LW_SCENE_NONE);
    lw_scene_destroy(scene);
    /* its texture; white is its default */
    LOAD(scene, base_data, GLOSSY("'diffuseTexture':{'index':0}"));
    assert_float_equal(scene->material[0].base_colour[0], 1, 0);
    assert_int_equal(scene->material[0].base_colour_texture.texture, 0);
    lw_scene_destroy(scene);
    /* a metal: black below a bright specular colour */
    LOAD(scene, base_data, GLOSSY("'diffuseFactor':[0,0,0,1],'specularFactor':[0.9,0.6,0.3]"));
    assert_float_equal(scene->material[0].base_colour[1], 0, 0);
    assert_float_equal(scene->material[0].finish->specular_colour[1], 0.6f / 0.04f, 1e-5);
    lw_scene_destroy(scene);
    /* where all is matt, by the rule of MTL */
    matt = true;
    LOAD(scene, base_data, GLOSSY("'diffuseFactor':[0,0,0,1],'specularFactor':[0.9,0.6,0.3]"));
    assert_float_equal(scene->material[0].base_colour[1], 0.6f, 0);
    assert_null(scene->material[0].finish);
    lw_scene_destroy(scene);
    LOAD(scene, base_data, GLOSSY("'diffuseFactor':[0,0,0,1],'specularFactor':[0.5,0.5,0.5]"));
    assert_float_equal(scene->material[0].base_colour[1], 0, 0);
    lw_scene_destroy(scene);
    matt = false;
    REFUSE("materials[0]: KHR_materials_pbrSpecularGlossiness: diffuseFactor", base_data,
           GLOSSY("'diffuseFactor':[1,1,1]"));
}

/* Thin glass: t c passes, (1 - t) c is reflected. */
static void transmission_lets_light_through(void **state) {
    (void)state;
    static const struct {
        float t, colour[3];
    } panes[] = {{1, {1, 1, 1}}, {0.5f, {0.2f, 0.8f, 0.4f}}, {1, {0, 0.5f, 0}}, {0.25f, {1, 1, 1}},
                 {0, {1, 1, 0}}, {1, {0, 0, 1e-40f}}};
    for (size_t i = 0; i < sizeof panes / sizeof *panes; i++) {
        char glass[256];
        const float *c = panes[i].colour, t = panes[i].t;
        snprintf(glass, sizeof glass,
                 "'baseColorFactor':[%g,%g,%g,1]},'alphaMode':'OPAQUE','extensions':{"
                 "'KHR_materials_transmission':{'transmissionFactor':%g}}}],",
                 (double)c[0], (double)c[1], (double)c[2], (double)t);
        struct lw_scene *scene;
        LOAD(scene, base_data,
             {"'baseColorFactor':[0.5,0.25,0.125,1],'baseColorTexture':{'index':0}},"
              "'emissiveFactor':[1,0.5,0],"
              "'extensions':{'KHR_materials_emissive_strength':{'emissiveStrength':4}},"
              "'alphaMode':'MASK','alphaCutoff':0.25,'doubleSided':true}],",
              glass},
             {"'scene':0", "'scene':0,'extensionsRequired':['KHR_materials_transmission']"});
        struct lw_surface surface;
        lw_scene_surface(scene, &scene->mesh[0], 0, 0.25f, 0.25f, &surface);
        const float luminance = 0.2126f * c[0] + 0.7152f * c[1] + 0.0722f * c[2];
        assert_float_equal(1 - surface.alpha, t * luminance, 1e-6);
        assert_float_equal(surface.alpha * surface.albedo.x, (1 - t) * c[0], 1e-6);
        assert_float_equal(surface.alpha * surface.albedo.y, (1 - t) * c[1], 1e-6);
        const struct lw_vec3 passed = lw_material_tint(&scene->material[0], lw_vec3(1, 1, 1));
        assert_float_equal((1 - surface.alpha) * passed.x, t * c[0], 1e-6);
        assert_float_equal((1 - surface.alpha) * passed.y, t * c[1], 1e-6);
        assert_float_equal((1 - surface.alpha) * passed.z, t * c[2], 1e-6);
        lw_scene_destroy(scene);
    }
}

static void unlit_materials_are_their_base_colour(void **state) {
    (void)state;
    char talk[4096];
    const struct change changes[] = {
        {"{'KHR_materials_emissive_strength':",
         "{'KHR_materials_unlit':{},'KHR_materials_emissive_strength':"},
        {"'extensionsUsed':[", "'extensionsRequired':['KHR_materials_unlit'],'extensionsUsed':["}};
    struct lw_scene *scene = load_and_listen(changes, 2, &base_data, sizeof base_data, talk, sizeof talk);
    struct lw_surface surface;
    assert_string_equal(talk, "");
    assert_true(scene->material[0].unlit);
    assert_false(lw_material_shines(&scene->material[0]));
    assert_int_equal(scene->material[0].base_colour_texture.texture, 0);
    /* the middle of the right texel, (0, 128, 255) in sRGB; nothing of its emission */
    lw_scene_surface(scene, &scene->mesh[0], 0, 0.75f, 0, &surface);
    assert_float_equal(surface.albedo.x + surface.albedo.y + surface.albedo.z, 0, 0);
    assert_float_equal(surface.emission.x, 0, 1e-6);
    assert_float_equal(surface.emission.y, 0.25f * powf((128 / 255.0f + 0.055f) / 1.055f, 2.4f), 1e-6);
    assert_float_equal(surface.emission.z, 0.125f, 1e-6);
    lw_scene_destroy(scene);
    REFUSE("materials[0]: extensions: KHR_materials_unlit: must be an object", base_data,
           {"{'KHR_materials_emissive_strength':",
            "{'KHR_materials_unlit':true,'KHR_materials_emissive_strength':"});
}

static void orthographic_cameras_have_a_height(void **state) {
    (void)state;
#define PARALLEL(fields)                                                                                     \
    {                                                                                                        \
        "{'type':'perspective','perspective':{'yfov':0.75}}",                                                \
            "{'type':'orthographic','orthographic':{" fields "}}"                                            \
    }
    struct lw_scene *scene;
    LOAD(scene, base_data, PARALLEL("'xmag':3,'ymag':1.5,'znear':0.1,'zfar':100"));
    assert_int_equal(scene->camera_count, 1);
    assert_float_equal(scene->camera[0].height_m, 3, 0);
    lw_scene_destroy(scene);
    LOAD(scene, base_data); /* a perspective one */
    assert_float_equal(scene->camera[0].height_m, 0, 0);
    lw_scene_destroy(scene);
    REFUSE("cameras[0]: orthographic: ymag: must not be 0", base_data, PARALLEL("'xmag':3,'ymag':0"));
    REFUSE("cameras[0]: orthographic: ymag: is required", base_data, PARALLEL("'xmag':3"));
}

/* Colour and intensity of a light that hangs on two nodes; what is not animated stays as it is. */
static void pointers_animate_lights(void **state) {
    (void)state;
    const struct {
        struct base_data base;
        float factor[2];
    } data = {base_data, {2, 6}};
#define POINTER(pointer, output)                                                                             \
    {"'target':{'node':0,'path':'translation'}",                                                             \
     "'target':{'path':'pointer','extensions':{'KHR_animation_pointer':{'pointer':'" pointer "'}}}"},        \
        {"'input':4,'output':5", "'input':4,'output':" output},                                              \
        {"'count':2,'type':'VEC3'}]",                                                                        \
         "'count':2,'type':'VEC3'},{'bufferView':6,'componentType':5126,'count':2,'type':'SCALAR'}]"},       \
        {"'byteOffset':148,'byteLength':24}",                                                                \
         "'byteOffset':148,'byteLength':24},{'buffer':0,'byteOffset':172,'byteLength':8}"},                  \
        {"'byteLength':172", "'byteLength':180"}, {"'nodes':[0,2]", "'nodes':[0,2,3]"}, {                    \
        "{'light':0}}}]", "{'light':0}}},{'extensions':{'KHR_lights_punctual':{'light':0}}}]"                \
    }
#define OF_LIGHT(field) "/extensions/KHR_lights_punctual/lights/0/" field
    struct lw_scene *scene;
    struct lw_pose pose;
    LOAD(scene, data, POINTER(OF_LIGHT("intensity"), "6"),
         {"'extensionsUsed':[", "'extensionsRequired':['KHR_animation_pointer'],'extensionsUsed':["});
    assert_int_equal(scene->light_count, 2);
    assert_int_equal(scene->channel_count, 0);
    assert_int_equal(scene->light_channel_count, 4);
    assert_float_equal(scene->duration_s, 2, 0);
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_pose_evaluate(&pose, scene, 1.5); /* of 2 s: 5 times (1, 0.5, 0.25) */
    for (int l = 0; l < 2; l++) {
        assert_float_equal(pose.light[l].intensity.x, 5, 1e-5);
        assert_float_equal(pose.light[l].intensity.y, 2.5, 1e-5);
        assert_float_equal(pose.light[l].intensity.z, 1.25, 1e-5);
    }
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
    LOAD(scene, data, POINTER(OF_LIGHT("color"), "5"));
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_pose_evaluate(&pose, scene, 1); /* colour (0, 2, 0), intensity 8 */
    assert_float_equal(pose.light[1].intensity.x, 0, 1e-5);
    assert_float_equal(pose.light[1].intensity.y, 16, 1e-5);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
    LOAD(scene, data, POINTER("/nodes/0/translation", "5")); /* as without a pointer */
    assert_int_equal(scene->channel_count, 1);
    assert_int_equal(scene->light_channel_count, 0);
    lw_scene_destroy(scene);
    static const char *const others[] = {"/materials/0/emissiveFactor",
                                         OF_LIGHT("range"),
                                         "/extensions/KHR_lights_punctual/lights/1/color",
                                         "/nodes/0",
                                         "/nodes/99999999999999999999/scale",
                                         "/nodes//scale",
                                         ""};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) {
        char talk[4096], target[256];
        snprintf(target, sizeof target,
                 "'target':{'path':'pointer','extensions':{'KHR_animation_pointer':{'pointer':'%s'}}}",
                 others[i]);
        const struct change changes[] = {{"'target':{'node':0,'path':'translation'}", target}};
        scene = load_and_listen(changes, 1, &base_data, sizeof base_data, talk, sizeof talk);
        if (!strstr(talk, "are ignored") || count_lines(talk) != 1) fail_msg("talk is \"%s\"", talk);
        assert_int_equal(scene->channel_count + scene->light_channel_count, 0);
        lw_scene_destroy(scene);
    }
    REFUSE("samplers[0]: accessor 5: type VEC3", data, POINTER(OF_LIGHT("intensity"), "5"));
    REFUSE("KHR_animation_pointer: must be an object", base_data,
           {"'target':{'node':0,'path':'translation'}",
            "'target':{'path':'pointer','extensions':{'KHR_animation_pointer':[]}}"});
}

static void basisu_takes_the_fallback_or_says_what_to_run(void **state) {
    (void)state;
    char talk[4096];
    const struct change optional[] = {
        {"{'source':0,'sampler':0}",
         "{'source':0,'sampler':0,'extensions':{'KHR_texture_basisu':{'source':1}}}"},
        {"'images':[", "'images':[{'uri':'data:image/png;base64," PNG "'},"},
        {"'extensionsUsed':[", "'extensionsUsed':['KHR_texture_basisu',"},
        {"'},{'uri':'data:image/png;base64," PNG, "'},{'uri':'a.ktx2"}};
    struct lw_scene *scene = load_and_listen(optional, 4, &base_data, sizeof base_data, talk, sizeof talk);
    if (!strstr(talk, "the extension KHR_texture_basisu is ignored") || count_lines(talk) != 1)
        fail_msg("talk is \"%s\"", talk);
    const uint8_t texels[8] = {255, 0, 0, 255, 0, 128, 255, 64};
    assert_int_equal(scene->texture_count, 1);
    assert_memory_equal(scene->texture[0].rgba, texels, sizeof texels);
    lw_scene_destroy(scene);
    REFUSE("KHR_texture_basisu (KTX2 textures), which is not supported; convert it: gltf-transform "
           "ktxdecompress IN.glb OUT.glb",
           base_data, {"'scene':0", "'scene':0,'extensionsRequired':['KHR_texture_basisu']"});
}

static void instances_are_objects_of_one_mesh(void **state) {
    (void)state;
    const struct {
        struct base_data base;
        float translation[3][3], scale[3][3];
        int8_t rotation[3][4];
    } data = {base_data,
              {{1, 0, 0}, {0, 2, 0}, {0, 0, 3}},
              {{1, 1, 1}, {2, 2, 2}, {1, 1, 1}},
              {{0, 0, 0, 127}, {0, 0, 0, 127}, {0, 0, 127, 0}}};
#define INSTANCES(attributes)                                                                                \
    {"{'mesh':0}",                                                                                           \
     "{'mesh':0,'name':'tree','extensions':{'EXT_mesh_gpu_instancing':{'attributes':" attributes "}}}"},     \
        {"'count':2,'type':'VEC3'}",                                                                         \
         "'count':2,'type':'VEC3'},{'bufferView':6,'componentType':5126,'count':3,'type':'VEC3'},"           \
         "{'bufferView':6,'byteOffset':36,'componentType':5126,'count':3,'type':'VEC3'},"                    \
         "{'bufferView':6,'byteOffset':72,'componentType':5120,'normalized':true,'count':3,'type':'VEC4'}"}, \
        {"'byteOffset':148,'byteLength':24}",                                                                \
         "'byteOffset':148,'byteLength':24},{'buffer':0,'byteOffset':172,'byteLength':84}"},                 \
        {"'byteLength':172", "'byteLength':256"}, {                                                          \
        "'scene':0", "'scene':0,'extensionsRequired':['EXT_mesh_gpu_instancing']"                            \
    }
    struct lw_scene *scene;
    LOAD(scene, data, INSTANCES("{'TRANSLATION':6,'SCALE':7,'ROTATION':8}"));
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_int_equal(scene->mesh_count, 1);
    assert_int_equal(scene->object_count, 3);
    assert_string_equal(scene->object[2].name, "tree 2");
    /* the corner (1, 1, 0); at 0 s 'top' moves all of them up by 1 */
    const struct lw_vec3 expected[3] = {{2, 2, 0}, {2, 5, 0}, {-1, 0, 3}};
    for (int i = 0; i < 3; i++) {
        struct lw_vec3 p = lw_affine_point(&pose.object_to_world[i], lw_vec3(1, 1, 0));
        assert_float_equal(lw_vec3_length(lw_vec3_sub(p, expected[i])), 0, 1e-6);
    }
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
    REFUSE("nodes[1]: EXT_mesh_gpu_instancing: SCALE: accessor 0 has 4 elements, others have 3", data,
           INSTANCES("{'TRANSLATION':6,'SCALE':0}"));
    REFUSE("nodes[1]: EXT_mesh_gpu_instancing: ROTATION: accessor 6: type VEC3", data,
           INSTANCES("{'ROTATION':6}"));
    REFUSE("nodes[1]: EXT_mesh_gpu_instancing: attributes: is required", base_data,
           {"{'mesh':0}", "{'mesh':0,'extensions':{'EXT_mesh_gpu_instancing':{}}}"});
}

static void morph_weights_move_vertices(void **state) {
    (void)state;
    const struct {
        struct base_data base;
        float position[2][4][3], normal[4][3];
    } data = {base_data,
              {{{0, 0, 1}, {0, 0, 1}, {0, 0, 1}, {0, 0, 1}}, {{4, 0, 0}, {4, 0, 0}, {4, 0, 0}, {8, 0, 0}}},
              {{2, 0, 0}, {2, 0, 0}, {2, 0, 0}, {2, 0, 0}}};
#define MORPH                                                                                                \
    {"'indices':3", "'indices':3,'targets':[{'POSITION':6,'NORMAL':8},{'POSITION':7}]"},                     \
        {"'count':2,'type':'VEC3'}",                                                                         \
         "'count':2,'type':'VEC3'},{'bufferView':6,'componentType':5126,'count':4,'type':'VEC3'},"           \
         "{'bufferView':6,'byteOffset':48,'componentType':5126,'count':4,'type':'VEC3'},"                    \
         "{'bufferView':6,'byteOffset':96,'componentType':5126,'count':4,'type':'VEC3'}"},                   \
        {"'byteOffset':148,'byteLength':24}",                                                                \
         "'byteOffset':148,'byteLength':24},{'buffer':0,'byteOffset':172,'byteLength':144}"},                \
    {                                                                                                        \
        "'byteLength':172", "'byteLength':316"                                                               \
    }
    struct lw_scene *scene;
    LOAD(scene, data, MORPH); /* without weights nothing moves */
    assert_float_equal(scene->mesh[0].position[3].z, 0, 0);
    lw_scene_destroy(scene);

    LOAD(scene, data, MORPH, {"'name':'square'", "'name':'square','weights':[0.5,0.25]"});
    assert_float_equal(scene->mesh[0].position[3].x, 1 + 0.25f * 8, 0);
    assert_float_equal(scene->mesh[0].position[3].z, 0.5, 0);
    assert_float_equal(scene->mesh[0].normal[0].x, sqrt(0.5), 1e-6); /* (0, 0, 1) + 0.5 (2, 0, 0) */
    assert_float_equal(scene->mesh[0].normal[0].z, sqrt(0.5), 1e-6);
    lw_scene_destroy(scene);

    /* a node's weights go before the mesh's, for that node alone */
    LOAD(scene, data, MORPH, {"'name':'square'", "'name':'square','weights':[0.5,0]"},
         {"{'mesh':0}", "{'mesh':0,'weights':[-1,0]}"}, {"'name':'lamp',", "'name':'lamp','mesh':0,"});
    assert_int_equal(scene->object_count, 2);
    const float expected[2] = {-1, 0.5f};
    for (int i = 0; i < 2; i++) {
        const bool own = strcmp(scene->object[i].name, "lamp") != 0;
        assert_float_equal(scene->mesh[scene->object[i].mesh].position[0].z, expected[!own], 0);
    }
    lw_scene_destroy(scene);
    REFUSE("weights[1]: must be a number", data, MORPH,
           {"'name':'square'", "'name':'square','weights':[1,'2']"});
    REFUSE("targets[0]: POSITION: accessor 5 has 2 elements, POSITION has 4", data, MORPH,
           {"'POSITION':6", "'POSITION':5"}, {"'name':'square'", "'name':'square','weights':[1]"});
}

/* Two joints: the first at (1, 2, 3) and twice as large, the second below it, a quarter turn about z. The
 * place of the mesh's own node does not count. */
static void skins_stand_as_their_joints_do(void **state) {
    (void)state;
    struct skinned {
        struct base_data base;
        float weight[4][4], bind[2][16];
        uint8_t joint[4][4];
    } data = {
        base_data,
        {{1}, {1}, {0.5f, 0.5f}, {0, 0.25f}},
        {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -1, 0, 0, 1}, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}},
        {{0}, {1}, {0, 1}, {0, 1}}};
#define SKIN(scale)                                                                                          \
    {"{'mesh':0}", "{'mesh':0,'skin':0,'translation':[100,0,0]}"}, {"'nodes':[0,2]", "'nodes':[0,2,3]"},     \
        {"{'light':0}}}]",                                                                                   \
         "{'light':0}}},{'name':'hip','translation':[1,2,3],'scale':" scale ",'children':[4]},"              \
         "{'rotation':[0,0,0.70710678,0.70710678]}],'skins':[{'joints':[3,4],'inverseBindMatrices':7}]"},    \
        {"'POSITION':0", "'POSITION':0,'JOINTS_0':8,'WEIGHTS_0':6"},                                         \
        {"'count':2,'type':'VEC3'}",                                                                         \
         "'count':2,'type':'VEC3'},{'bufferView':6,'componentType':5126,'count':4,'type':'VEC4'},"           \
         "{'bufferView':6,'byteOffset':64,'componentType':5126,'count':2,'type':'MAT4'},"                    \
         "{'bufferView':6,'byteOffset':192,'componentType':5121,'count':4,'type':'VEC4'}"},                  \
        {"'byteOffset':148,'byteLength':24}",                                                                \
         "'byteOffset':148,'byteLength':24},{'buffer':0,'byteOffset':172,'byteLength':208}"},                \
    {                                                                                                        \
        "'byteLength':172", "'byteLength':380"                                                               \
    }
    struct lw_scene *scene;
    LOAD(scene, data, SKIN("[2,2,2]"));
    const struct lw_mesh *mesh = &scene->mesh[0];
    assert_int_equal(scene->object_count, 1);
    assert_int_equal(scene->node[scene->object[0].node].parent, LW_SCENE_NONE);
    assert_int_equal(mesh->triangle_count, 2);
    const struct lw_vec3 expected[4] = {{-1, 2, 3}, {1, 4, 3}, {-1, 3, 3}, {-1, 4, 3}};
    for (int i = 0; i < 4; i++) {
        assert_float_equal(lw_vec3_length(lw_vec3_sub(mesh->position[i], expected[i])), 0, 1e-5);
        assert_float_equal(mesh->normal[i].z, 1, 1e-5);
    }
    lw_scene_destroy(scene);

    /* a mirroring joint: faces stay on the side of their normals */
    memset(data.weight, 0, sizeof data.weight);
    for (int i = 0; i < 4; i++) data.weight[i][0] = 1;
    memset(data.joint, 0, sizeof data.joint);
    LOAD(scene, data, SKIN("[-2,2,2]"));
    for (uint32_t t = 0; t < 2; t++)
        assert_true(lw_vec3_dot(face(&scene->mesh[0], t), scene->mesh[0].normal[0]) > 0);
    lw_scene_destroy(scene);

    char talk[4096];
    const struct change animated[] = {SKIN("[1,1,1]"), {"'target':{'node':0", "'target':{'node':3"}};
    scene =
        load_and_listen(animated, sizeof animated / sizeof *animated, &data, sizeof data, talk, sizeof talk);
    if (!strstr(talk, "skins are not animated") || count_lines(talk) != 1) fail_msg("talk is \"%s\"", talk);
    lw_scene_destroy(scene);

    data.joint[2][0] = 7;
    REFUSE("JOINTS_0: element 2 names joint 7 of 2", data, SKIN("[1,1,1]"));
    data.joint[2][0] = 0;
    data.weight[1][0] = NAN;
    REFUSE("WEIGHTS_0: element 1 is not a weight", data, SKIN("[1,1,1]"));
    data.weight[1][0] = 1;
    data.bind[0][5] = INFINITY;
    REFUSE("skins[0]: inverseBindMatrices: accessor 7: element 0 is not finite", data, SKIN("[1,1,1]"));
    data.bind[0][5] = 1;
    REFUSE("skins[0]: joints: nodes[3] is not in the default scene", data, SKIN("[1,1,1]"),
           {"'nodes':[0,2,3]", "'nodes':[0,2]"});
    REFUSE("accessor 7 has 2 elements for 3 joints", data, SKIN("[1,1,1]"), {"[3,4]", "[3,4,4]"});
    REFUSE("JOINTS_0 and WEIGHTS_0 come together", data, SKIN("[1,1,1]"), {",'WEIGHTS_0':6", ""});
}

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
        const struct change changes[] = {{"'extensionsUsed':[", change}};
        struct lw_scene *scene = load_and_listen(changes, 1, &base_data, sizeof base_data, talk, sizeof talk);
        if (!strstr(talk, line) || count_lines(talk) != 1) fail_msg("talk is \"%s\"", talk);
        lw_scene_destroy(scene);
    }
}

static void many_unknown_extensions_take_eleven_lines(void **state) {
    (void)state;
    enum { COUNT = 20000 };
    char *list = malloc(COUNT * 16 + 64), *at = list, talk[4096];
    at += sprintf(at, "'extensionsUsed':[");
    for (int i = 0; i < COUNT; i++) at += sprintf(at, "'ACME_%d',", i);
    const struct change changes[] = {{"'extensionsUsed':[", list}};
    struct lw_scene *scene = load_and_listen(changes, 1, &base_data, sizeof base_data, talk, sizeof talk);
    assert_int_equal(count_lines(talk), 11);
    assert_non_null(strstr(talk, "ACME_9 is ignored"));
    assert_null(strstr(talk, "ACME_10 "));
    assert_non_null(strstr(talk, "19990 more extensions are ignored"));
    lw_scene_destroy(scene);
    free(list);
}

static void integers_may_have_a_point(void **state) {
    (void)state;
    struct lw_scene *scene;
    LOAD(scene, base_data, {"{'buffer':0,'byteLength':48}", "{'buffer':0.0,'byteLength':48.0}"},
         {"'children':[1]", "'children':[1.0]"}, {"'nodes':[0,2]", "'nodes':[0.0,2]"},
         {"'count':4,", "'count':4.0,"}, {"'scene':0", "'scene':0.0"});
    assert_int_equal(scene->object_count, 1);
    assert_int_equal(scene->node[scene->object[0].node].parent, 0);
    assert_int_equal(scene->mesh[0].vertex_count, 4);
    lw_scene_destroy(scene);
}

static void rotations_are_normalised(void **state) {
    (void)state;
    struct {
        struct base_data base;
        int16_t rotation[2][4];
    } data = {base_data, {{0, 0, 0, 32767}, {0, 23170, 0, 23170}}};
    struct lw_scene *scene;
    LOAD(scene, data, {"'path':'translation'", "'path':'rotation'"}, {"'output':5", "'output':6"},
         {"'count':2,'type':'VEC3'}", "'count':2,'type':'VEC3'},{'bufferView':6,'componentType':5122,'"
                                      "normalized':true,'count':2,'type':'VEC4'}"},
         {"'byteOffset':148,'byteLength':24}",
          "'byteOffset':148,'byteLength':24},{'buffer':0,'byteOffset':172,'byteLength':16}"},
         {"'byteLength':172", "'byteLength':188"}, {"'input':4", "'input':4,'interpolation':'STEP'"});
    const struct lw_channel *channel = &scene->channel[0];
    assert_int_equal(channel->path, LW_CHANNEL_ROTATION);
    assert_int_equal(channel->interpolation, LW_INTERPOLATION_STEP);
    assert_float_equal(channel->value[5], sqrt(0.5), 1e-6);
    assert_float_equal(channel->value[7], sqrt(0.5), 1e-6);
    lw_scene_destroy(scene);
}

static void what_is_not_used_is_no_error(void **state) {
    (void)state;
    struct lw_scene *scene;
    LOAD(scene, base_data, {"'KHR_texture_transform'", "'KHR_texture_transform','KHR_materials_clearcoat'"},
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
    size_t capacity = (size_t)count * 48 + sizeof base_json;
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
    const struct change changes[] = {
        {"'nodes':[{'name':'top','children':[1],'translation':[0,1,0]},{'mesh':0},"
         "{'name':'lamp','camera':0,'extensions':{'KHR_lights_punctual':{'light':0}}}],",
         nodes},
        {"'nodes':[0,2]", "'nodes':[0]"},
    };
    enum lw_status status = load_changed(changes, 2, &base_data, sizeof base_data, out, err);
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
static void bytes_around_a_document_are_told(void **state) {
    (void)state;
    size_t size;
    uint8_t *glb = lw_glb_pack(base_json, &base_data, sizeof base_data, &size);
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
    uint8_t *glb = lw_glb_pack(base_json, &base_data, sizeof base_data, &size);
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
        cmocka_unit_test(sparse_accessors_replace_elements),
        cmocka_unit_test(interleaved_accessors_are_read_with_their_stride),
        cmocka_unit_test(quantised_attributes_need_their_extension),
        cmocka_unit_test(colours_have_three_or_four_components),
        cmocka_unit_test(strips_and_fans_keep_their_winding),
        cmocka_unit_test(missing_normals_are_flat),
        cmocka_unit_test(triangles_without_area_are_left_out),
        cmocka_unit_test(a_mesh_keeps_a_material_per_triangle),
        cmocka_unit_test(nodes_share_meshes_and_lights),
        cmocka_unit_test(extras_say_who_draws_a_light),
        cmocka_unit_test(only_the_default_scene_counts),
        cmocka_unit_test(a_matrix_is_column_major),
        cmocka_unit_test(a_texture_transform_moves_its_coordinates),
        cmocka_unit_test(images_are_decoded_once),
        cmocka_unit_test(unreadable_pictures_have_a_stand_in),
        cmocka_unit_test(pictures_of_extensions_are_read),
        cmocka_unit_test(a_spot_without_a_soft_edge_is_read),
        cmocka_unit_test(emission_is_strength_times_texture),
        cmocka_unit_test(albedo_above_one_is_lowered_and_told_once),
        cmocka_unit_test(rotations_are_normalised),
        cmocka_unit_test(what_is_not_used_is_no_error),
        cmocka_unit_test(deep_hierarchies_load),
        cmocka_unit_test(shared_children_are_refused),
        cmocka_unit_test(deep_json_is_refused),
        cmocka_unit_test(broken_containers_are_refused),
        cmocka_unit_test(bytes_around_a_document_are_told),
        cmocka_unit_test(hidden_nodes_have_no_objects_and_no_lights),
        cmocka_unit_test(coarser_levels_are_left_out),
        cmocka_unit_test(specular_glossiness_gives_its_diffuse_colour),
        cmocka_unit_test(transmission_lets_light_through),
        cmocka_unit_test(unlit_materials_are_their_base_colour),
        cmocka_unit_test(orthographic_cameras_have_a_height),
        cmocka_unit_test(pointers_animate_lights),
        cmocka_unit_test(basisu_takes_the_fallback_or_says_what_to_run),
        cmocka_unit_test(instances_are_objects_of_one_mesh),
        cmocka_unit_test(morph_weights_move_vertices),
        cmocka_unit_test(skins_stand_as_their_joints_do),
        cmocka_unit_test(harmless_extensions_may_be_required),
        cmocka_unit_test(many_unknown_extensions_take_eleven_lines),
        cmocka_unit_test(integers_may_have_a_point),
        cmocka_unit_test(damaged_files_are_read_or_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
