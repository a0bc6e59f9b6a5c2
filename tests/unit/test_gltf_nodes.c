#include "tests/support/gltf_case.h"

#include "common/base/log.h"
#include "common/scene/pose.h"
#include "server/import/gltf/gltf.h"

#include <stdio.h>
#include <string.h>

/* Nodes, lights, cameras and their animation. */

/* ---- nodes, textures, animation ---- */

static void nodes_share_meshes_and_lights(void **state) {
    (void)state;
    struct lw_scene *scene;
    GLTF_CASE_LOAD(
        scene, gltf_case_base_data, {"'nodes':[0,2]", "'nodes':[0,2,3]"},
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
    GLTF_CASE_LOAD(scene, gltf_case_base_data,
                   {"'intensity':8", "'intensity':8,'extras':{'lightwell':{'clientLight':false}}"},
                   {"'doubleSided':true", "'doubleSided':true,'extras':{'lightwell':{'clientLight':true}}"});
    assert_int_equal(scene->light[0].drawn_by, LW_DRAWN_BY_SERVER);
    assert_int_equal(scene->material[0].drawn_by, LW_DRAWN_BY_CLIENTS);
    lw_scene_destroy(scene);
    /* extras of others, which may be anything, and ours that say something else */
    GLTF_CASE_LOAD(scene, gltf_case_base_data, {"'intensity':8", "'intensity':8,'extras':['clientLight']"},
                   {"'doubleSided':true",
                    "'doubleSided':true,'extras':{'clientLight':true,'lightwell':{'lightmap':''}}"});
    assert_int_equal(scene->light[0].drawn_by, LW_DRAWN_BY_RULE);
    assert_int_equal(scene->material[0].drawn_by, LW_DRAWN_BY_RULE);
    lw_scene_destroy(scene);
}

static void a_matrix_is_column_major(void **state) {
    (void)state;
    struct lw_scene *scene;
    GLTF_CASE_LOAD(scene, gltf_case_base_data,
                   {"{'mesh':0}", "{'mesh':0,'matrix':[1,2,3,0,4,5,6,0,7,8,10,0,11,12,13,1]}"});
    const struct lw_node *node = &scene->node[scene->object[0].node];
    assert_true(node->has_matrix);
    assert_float_equal(node->matrix.m[0][1], 4, 0);
    assert_float_equal(node->matrix.m[2][0], 3, 0);
    assert_float_equal(node->matrix.m[1][3], 12, 0);
    lw_scene_destroy(scene);
}

/* Exporters write a spot without a soft edge with equal cones, though glTF forbids it. */
static void a_spot_without_a_soft_edge_is_read(void **state) {
    (void)state;
    const struct gltf_case_change change = {"'spot':{}",
                                            "'spot':{'innerConeAngle':0.5,'outerConeAngle':0.5}"};
    char talk[4096];
    struct lw_scene *scene = gltf_case_load_and_listen(&change, 1, &gltf_case_base_data,
                                                       sizeof gltf_case_base_data, talk, sizeof talk);
    if (!strstr(talk, "innerConeAngle") || gltf_case_count_lines(talk) != 1) fail_msg("talk is \"%s\"", talk);
    assert_float_equal(scene->light[0].outer_cone, 0.5, 0);
    assert_true(scene->light[0].inner_cone < 0.5f && scene->light[0].inner_cone > 0.49f);
    lw_scene_destroy(scene);
}

/* ---- extensions ---- */

static void hidden_nodes_have_no_objects_and_no_lights(void **state) {
    (void)state;
#define HIDDEN "'extensions':{'KHR_node_visibility':{'visible':false}}"
    struct lw_scene *scene;
    /* three squares: one below a hidden node, one hidden, one shown; a lamp below a hidden node */
    GLTF_CASE_LOAD(scene, gltf_case_base_data, {"{'name':'top',", "{'name':'top'," HIDDEN ","},
                   {"{'name':'lamp',", "{'mesh':0,'name':'lamp',"}, {"'nodes':[0,2]", "'nodes':[0,2,3,4]"},
                   {"{'light':0}}}]",
                    "{'light':0}}},{'mesh':0," HIDDEN "},{" HIDDEN
                    ",'children':[5]},{'camera':0,'extensions':"
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
    GLTF_CASE_LOAD(scene, gltf_case_base_data, {"'nodes':[0,2]", "'nodes':[0,2,3]"},
                   {"{'mesh':0}", "{'mesh':0,'extensions':{'MSFT_lod':{'ids':[3,1]}}}"},
                   {"{'light':0}}}]", "{'light':0}}},{'children':[4]},{'mesh':0}]"});
    assert_int_equal(scene->object_count, 1);
    assert_int_equal(scene->node[scene->object[0].node].parent, 0);
    lw_scene_destroy(scene);
}

static void orthographic_cameras_have_a_height(void **state) {
    (void)state;
#define PARALLEL(fields)                                                                                     \
    {                                                                                                        \
        "{'type':'perspective','perspective':{'yfov':0.75}}",                                                \
            "{'type':'orthographic','orthographic':{" fields "}}"                                            \
    }
    struct lw_scene *scene;
    GLTF_CASE_LOAD(scene, gltf_case_base_data, PARALLEL("'xmag':3,'ymag':1.5,'znear':0.1,'zfar':100"));
    assert_int_equal(scene->camera_count, 1);
    assert_float_equal(scene->camera[0].height_m, 3, 0);
    lw_scene_destroy(scene);
    GLTF_CASE_LOAD(scene, gltf_case_base_data); /* a perspective one */
    assert_float_equal(scene->camera[0].height_m, 0, 0);
    lw_scene_destroy(scene);
    GLTF_CASE_REFUSE("cameras[0]: orthographic: ymag: must not be 0", gltf_case_base_data,
                     PARALLEL("'xmag':3,'ymag':0"));
    GLTF_CASE_REFUSE("cameras[0]: orthographic: ymag: is required", gltf_case_base_data,
                     PARALLEL("'xmag':3"));
}

/* Colour and intensity of a light that hangs on two nodes; properties without an animation stay. */
static void pointers_animate_lights(void **state) {
    (void)state;
    const struct {
        struct gltf_case_base_data base;
        float factor[2];
    } data = {gltf_case_base_data, {2, 6}};
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
    GLTF_CASE_LOAD(
        scene, data, POINTER(OF_LIGHT("intensity"), "6"),
        {"'extensionsUsed':[", "'extensionsRequired':['KHR_animation_pointer'],'extensionsUsed':["});
    assert_int_equal(scene->light_count, 2);
    assert_int_equal(scene->channel_count, 0);
    assert_int_equal(scene->light_channel_count, 4);
    assert_float_equal(scene->duration_s, 2, 0);
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_pose_evaluate(&pose, scene, 1.5); /* the animation lasts 2 s: 5 times (1, 0.5, 0.25) */
    for (int l = 0; l < 2; l++) {
        assert_float_equal(pose.light[l].intensity.x, 5, 1e-5);
        assert_float_equal(pose.light[l].intensity.y, 2.5, 1e-5);
        assert_float_equal(pose.light[l].intensity.z, 1.25, 1e-5);
    }
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
    GLTF_CASE_LOAD(scene, data, POINTER(OF_LIGHT("color"), "5"));
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_pose_evaluate(&pose, scene, 1); /* colour (0, 2, 0), intensity 8 */
    assert_float_equal(pose.light[1].intensity.x, 0, 1e-5);
    assert_float_equal(pose.light[1].intensity.y, 16, 1e-5);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
    GLTF_CASE_LOAD(scene, data, POINTER("/nodes/0/translation", "5")); /* as without a pointer */
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
        const struct gltf_case_change changes[] = {{"'target':{'node':0,'path':'translation'}", target}};
        scene = gltf_case_load_and_listen(changes, 1, &gltf_case_base_data, sizeof gltf_case_base_data, talk,
                                          sizeof talk);
        if (!strstr(talk, "are ignored") || gltf_case_count_lines(talk) != 1)
            fail_msg("talk is \"%s\"", talk);
        assert_int_equal(scene->channel_count + scene->light_channel_count, 0);
        lw_scene_destroy(scene);
    }
    GLTF_CASE_REFUSE("samplers[0]: accessor 5: type VEC3", data, POINTER(OF_LIGHT("intensity"), "5"));
    GLTF_CASE_REFUSE("KHR_animation_pointer: must be an object", gltf_case_base_data,
                     {"'target':{'node':0,'path':'translation'}",
                      "'target':{'path':'pointer','extensions':{'KHR_animation_pointer':[]}}"});
}

static void rotations_are_normalised(void **state) {
    (void)state;
    struct {
        struct gltf_case_base_data base;
        int16_t rotation[2][4];
    } data = {gltf_case_base_data, {{0, 0, 0, 32767}, {0, 23170, 0, 23170}}};
    struct lw_scene *scene;
    GLTF_CASE_LOAD(
        scene, data, {"'path':'translation'", "'path':'rotation'"}, {"'output':5", "'output':6"},
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

int main(void) {
    lw_log_init("test_gltf_nodes", LW_LOG_ERROR);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nodes_share_meshes_and_lights),
        cmocka_unit_test(extras_say_who_draws_a_light),
        cmocka_unit_test(a_matrix_is_column_major),
        cmocka_unit_test(a_spot_without_a_soft_edge_is_read),
        cmocka_unit_test(rotations_are_normalised),
        cmocka_unit_test(hidden_nodes_have_no_objects_and_no_lights),
        cmocka_unit_test(coarser_levels_are_left_out),
        cmocka_unit_test(orthographic_cameras_have_a_height),
        cmocka_unit_test(pointers_animate_lights),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
