#include "tests/support/gltf_case.h"

#include "common/base/log.h"
#include "common/scene/pose.h"
#include "server/import/gltf/gltf.h"

#include <string.h>

/* Accessors, primitives, instances, skins and morph targets. */

/* ---- accessors ---- */

static void sparse_accessors_replace_elements(void **state) {
    (void)state;
    const struct {
        struct gltf_case_base_data base;
        uint16_t index[2];
        float value[2][3];
    } data = {gltf_case_base_data, {1, 3}, {{2, 0, 0}, {2, 2, 0}}};
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
    GLTF_CASE_LOAD(scene, data, SPARSE_VIEWS,
                   {"'count':4,'type':'VEC3'", "'count':4,'type':'VEC3'" SPARSE("6", "2")});
    assert_float_equal(scene->mesh[0].position[1].x, 2, 0);
    assert_float_equal(scene->mesh[0].position[2].y, 1, 0);
    assert_float_equal(scene->mesh[0].position[3].y, 2, 0);
    lw_scene_destroy(scene);

    /* without a view the rest is zero: here two corners are left apart, and no triangle has an area */
    GLTF_CASE_REFUSE("no triangles", data, SPARSE_VIEWS,
                     {"{'bufferView':0,'componentType':5126,'count':4,'type':'VEC3'",
                      "{'componentType':5126,'count':4,'type':'VEC3'" SPARSE("6", "1")});
    GLTF_CASE_REFUSE("accessor 0: sparse: count: must be an integer from 1 to 4", data, SPARSE_VIEWS,
                     {"'count':4,'type':'VEC3'", "'count':4,'type':'VEC3'" SPARSE("6", "5")});
    GLTF_CASE_REFUSE("accessor 0: sparse: indices reaches past bufferView 6", data, SPARSE_VIEWS,
                     {"'count':4,'type':'VEC3'", "'count':4,'type':'VEC3'" SPARSE("6", "3")});
    typeof(data) unordered = data, repeated = data, outside = data;
    memcpy((void *)unordered.index, (const uint16_t[]){3, 1}, 4);
    memcpy((void *)repeated.index, (const uint16_t[]){1, 1}, 4);
    memcpy((void *)outside.index, (const uint16_t[]){1, 4}, 4);
    const struct gltf_case_change sparse = {"'count':4,'type':'VEC3'",
                                            "'count':4,'type':'VEC3'" SPARSE("6", "2")};
    GLTF_CASE_REFUSE("strictly increasing, element 1 is not", unordered, SPARSE_VIEWS, sparse);
    GLTF_CASE_REFUSE("strictly increasing, element 1 is not", repeated, SPARSE_VIEWS, sparse);
    GLTF_CASE_REFUSE("indices: 4 is past the accessor's 4 elements", outside, SPARSE_VIEWS, sparse);
}

static void interleaved_accessors_are_read_with_their_stride(void **state) {
    (void)state;
    struct {
        struct {
            float position[3], normal[3];
        } vertex[4];
        float rest[(sizeof gltf_case_base_data - 96) / 4];
    } data;
    for (int i = 0; i < 4; i++) {
        memcpy(data.vertex[i].position, gltf_case_base_data.position[i], 12);
        memcpy(data.vertex[i].normal, gltf_case_base_data.normal[i], 12);
    }
    memcpy(data.rest, gltf_case_base_data.uv, sizeof data.rest);
    struct lw_scene *scene;
    GLTF_CASE_LOAD(scene, data,
                   {"{'buffer':0,'byteLength':48}", "{'buffer':0,'byteLength':96,'byteStride':24}"},
                   {"{'bufferView':1,", "{'bufferView':0,'byteOffset':12,"});
    for (int i = 0; i < 4; i++) {
        assert_memory_equal(&scene->mesh[0].position[i], gltf_case_base_data.position[i], 12);
        assert_float_equal(scene->mesh[0].normal[i].z, 1, 1e-6);
    }
    lw_scene_destroy(scene);
    GLTF_CASE_REFUSE("accessor 1: reaches past bufferView 0", data,
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
    GLTF_CASE_LOAD(scene, data, QUANTISED,
                   {"'scene':0", "'scene':0,'extensionsRequired':['KHR_mesh_quantization']"});
    assert_float_equal(scene->mesh[0].position[3].y, 10, 0);
    assert_float_equal(scene->mesh[0].normal[3].y, -1, 1e-6);
    assert_float_equal(scene->mesh[0].uv[0][3].x, 32768.0 / 65535, 1e-6);
    lw_scene_destroy(scene);
    GLTF_CASE_LOAD(scene, data, QUANTISED,
                   {"'scene':0", "'scene':0,'extensionsRequired':['KHR_mesh_quantization']"},
                   {"{'bufferView':0,", "{'bufferView':0,'normalized':true,"});
    assert_float_equal(scene->mesh[0].position[3].y, 10.0 / 32767, 1e-9);
    lw_scene_destroy(scene);
    GLTF_CASE_REFUSE("POSITION: accessor 0: componentType 5122 cannot be used here", data, QUANTISED);
}

static void colours_have_three_or_four_components(void **state) {
    (void)state;
    const struct {
        struct gltf_case_base_data base;
        uint8_t colour[4][4];
    } data = {gltf_case_base_data, {{255, 0, 51, 102}, {255, 255, 255, 255}, {0, 0, 0, 0}, {255, 0, 0, 0}}};
#define COLOUR(type, size)                                                                                   \
    {"'count':2,'type':'VEC3'}", "'count':2,'type':'VEC3'},{'bufferView':6,'componentType':5121,'"           \
                                 "normalized':true,'count':4,'type':'" type "'}"},                           \
        {"'byteOffset':148,'byteLength':24}",                                                                \
         "'byteOffset':148,'byteLength':24},{'buffer':0,'byteOffset':172,'byteLength':16" size "}"},         \
        {"'byteLength':172", "'byteLength':188"}, {                                                          \
        "'POSITION':0", "'POSITION':0,'COLOR_0':6"                                                           \
    }
    struct lw_scene *scene;
    GLTF_CASE_LOAD(scene, data, COLOUR("VEC4", ""));
    assert_float_equal(scene->mesh[0].colour[0].z, 0.2, 1e-6);
    assert_float_equal(scene->mesh[0].colour[0].w, 0.4, 1e-6);
    lw_scene_destroy(scene);
    GLTF_CASE_LOAD(scene, data, COLOUR("VEC3", ",'byteStride':4"));
    assert_float_equal(scene->mesh[0].colour[0].z, 0.2, 1e-6);
    assert_float_equal(scene->mesh[0].colour[0].w, 1, 0);
    lw_scene_destroy(scene);
    GLTF_CASE_REFUSE("COLOR_0: accessor 6: type VEC2", data, COLOUR("VEC2", ""));
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
    GLTF_CASE_LOAD(scene, gltf_case_base_data, {"'indices':3", "'mode':5"});
    assert_int_equal(scene->mesh[0].triangle_count, 2);
    assert_int_equal(scene->mesh[0].vertex_count, 4);
    for (uint32_t t = 0; t < 2; t++) assert_float_equal(face(&scene->mesh[0], t).z, 1, 0);
    lw_scene_destroy(scene);

    struct gltf_case_base_data data = gltf_case_base_data;
    memcpy(data.position[2], gltf_case_base_data.position[3], 12); /* around the square */
    memcpy(data.position[3], gltf_case_base_data.position[2], 12);
    GLTF_CASE_LOAD(scene, data, {"'indices':3", "'mode':6"});
    assert_int_equal(scene->mesh[0].triangle_count, 2);
    for (uint32_t t = 0; t < 2; t++) assert_float_equal(face(&scene->mesh[0], t).z, 1, 0);
    lw_scene_destroy(scene);
}

static void missing_normals_are_flat(void **state) {
    (void)state;
    struct gltf_case_base_data data = gltf_case_base_data;
    data.position[3][2] = 1; /* the second triangle rises */
    struct lw_scene *scene;
    GLTF_CASE_LOAD(scene, data, {"'NORMAL':1,", ""});
    const struct lw_mesh *mesh = &scene->mesh[0];
    assert_int_equal(mesh->vertex_count, 6);
    for (uint32_t t = 0; t < 2; t++) {
        struct lw_vec3 n = lw_vec3_normalize(face(mesh, t));
        for (int k = 0; k < 3; k++)
            assert_float_equal(lw_vec3_dot(n, mesh->normal[mesh->triangle[t][k]]), 1, 1e-6);
    }
    assert_true(face(mesh, 1).x < 0);
    lw_scene_destroy(scene);

    data = gltf_case_base_data; /* a normal of no length gets its face's */
    memset(data.normal, 0, sizeof data.normal);
    GLTF_CASE_LOAD(scene, data, gltf_case_no_change);
    assert_int_equal(scene->mesh[0].vertex_count, 4);
    assert_float_equal(scene->mesh[0].normal[3].z, 1, 1e-6);
    lw_scene_destroy(scene);
}

static void triangles_without_area_are_left_out(void **state) {
    (void)state;
    struct gltf_case_base_data data = gltf_case_base_data;
    memcpy(data.position[3], data.position[2], 12);
    struct lw_scene *scene;
    GLTF_CASE_LOAD(scene, data, gltf_case_no_change);
    assert_int_equal(scene->mesh[0].triangle_count, 1);
    assert_int_equal(scene->mesh[0].vertex_count, 3); /* nobody uses the fourth */
    lw_scene_destroy(scene);
    data = gltf_case_base_data;
    data.index[5] = 1;
    GLTF_CASE_LOAD(scene, data, gltf_case_no_change);
    assert_int_equal(scene->mesh[0].triangle_count, 1);
    lw_scene_destroy(scene);
    /* small is not degenerate */
    data = gltf_case_base_data;
    for (int i = 0; i < 4; i++)
        for (int c = 0; c < 3; c++) data.position[i][c] *= 1e-7f;
    GLTF_CASE_LOAD(scene, data, gltf_case_no_change);
    assert_int_equal(scene->mesh[0].triangle_count, 2);
    lw_scene_destroy(scene);
}

static void a_mesh_keeps_a_material_per_triangle(void **state) {
    (void)state;
    struct lw_scene *scene;
    GLTF_CASE_LOAD(scene, gltf_case_base_data,
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

/* ---- extensions ---- */

static void instances_are_objects_of_one_mesh(void **state) {
    (void)state;
    const struct {
        struct gltf_case_base_data base;
        float translation[3][3], scale[3][3];
        int8_t rotation[3][4];
    } data = {gltf_case_base_data,
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
    GLTF_CASE_LOAD(scene, data, INSTANCES("{'TRANSLATION':6,'SCALE':7,'ROTATION':8}"));
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
    GLTF_CASE_REFUSE("nodes[1]: EXT_mesh_gpu_instancing: SCALE: accessor 0 has 4 elements, others have 3",
                     data, INSTANCES("{'TRANSLATION':6,'SCALE':0}"));
    GLTF_CASE_REFUSE("nodes[1]: EXT_mesh_gpu_instancing: ROTATION: accessor 6: type VEC3", data,
                     INSTANCES("{'ROTATION':6}"));
    GLTF_CASE_REFUSE("nodes[1]: EXT_mesh_gpu_instancing: attributes: is required", gltf_case_base_data,
                     {"{'mesh':0}", "{'mesh':0,'extensions':{'EXT_mesh_gpu_instancing':{}}}"});
}

static void morph_weights_move_vertices(void **state) {
    (void)state;
    const struct {
        struct gltf_case_base_data base;
        float position[2][4][3], normal[4][3];
    } data = {gltf_case_base_data,
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
    GLTF_CASE_LOAD(scene, data, MORPH); /* without weights nothing moves */
    assert_float_equal(scene->mesh[0].position[3].z, 0, 0);
    lw_scene_destroy(scene);

    GLTF_CASE_LOAD(scene, data, MORPH, {"'name':'square'", "'name':'square','weights':[0.5,0.25]"});
    assert_float_equal(scene->mesh[0].position[3].x, 1 + 0.25f * 8, 0);
    assert_float_equal(scene->mesh[0].position[3].z, 0.5, 0);
    assert_float_equal(scene->mesh[0].normal[0].x, sqrt(0.5), 1e-6); /* (0, 0, 1) + 0.5 (2, 0, 0) */
    assert_float_equal(scene->mesh[0].normal[0].z, sqrt(0.5), 1e-6);
    lw_scene_destroy(scene);

    /* a node's weights go before the mesh's, for that node alone */
    GLTF_CASE_LOAD(scene, data, MORPH, {"'name':'square'", "'name':'square','weights':[0.5,0]"},
                   {"{'mesh':0}", "{'mesh':0,'weights':[-1,0]}"},
                   {"'name':'lamp',", "'name':'lamp','mesh':0,"});
    assert_int_equal(scene->object_count, 2);
    const float expected[2] = {-1, 0.5f};
    for (int i = 0; i < 2; i++) {
        const bool own = strcmp(scene->object[i].name, "lamp") != 0;
        assert_float_equal(scene->mesh[scene->object[i].mesh].position[0].z, expected[!own], 0);
    }
    lw_scene_destroy(scene);
    GLTF_CASE_REFUSE("weights[1]: must be a number", data, MORPH,
                     {"'name':'square'", "'name':'square','weights':[1,'2']"});
    GLTF_CASE_REFUSE("targets[0]: POSITION: accessor 5 has 2 elements, POSITION has 4", data, MORPH,
                     {"'POSITION':6", "'POSITION':5"}, {"'name':'square'", "'name':'square','weights':[1]"});
}

/* Two joints: the first at (1, 2, 3) and twice as large, the second below it, a quarter turn about z. The
 * place of the mesh's own node does not count. */
static void skins_stand_as_their_joints_do(void **state) {
    (void)state;
    struct skinned {
        struct gltf_case_base_data base;
        float weight[4][4], bind[2][16];
        uint8_t joint[4][4];
    } data = {
        gltf_case_base_data,
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
    GLTF_CASE_LOAD(scene, data, SKIN("[2,2,2]"));
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
    GLTF_CASE_LOAD(scene, data, SKIN("[-2,2,2]"));
    for (uint32_t t = 0; t < 2; t++)
        assert_true(lw_vec3_dot(face(&scene->mesh[0], t), scene->mesh[0].normal[0]) > 0);
    lw_scene_destroy(scene);

    char talk[4096];
    const struct gltf_case_change animated[] = {SKIN("[1,1,1]"),
                                                {"'target':{'node':0", "'target':{'node':3"}};
    scene = gltf_case_load_and_listen(animated, sizeof animated / sizeof *animated, &data, sizeof data, talk,
                                      sizeof talk);
    if (!strstr(talk, "skins are not animated") || gltf_case_count_lines(talk) != 1)
        fail_msg("talk is \"%s\"", talk);
    lw_scene_destroy(scene);

    data.joint[2][0] = 7;
    GLTF_CASE_REFUSE("JOINTS_0: element 2 names joint 7 of 2", data, SKIN("[1,1,1]"));
    data.joint[2][0] = 0;
    data.weight[1][0] = NAN;
    GLTF_CASE_REFUSE("WEIGHTS_0: element 1 is not a weight", data, SKIN("[1,1,1]"));
    data.weight[1][0] = 1;
    data.bind[0][5] = INFINITY;
    GLTF_CASE_REFUSE("skins[0]: inverseBindMatrices: accessor 7: element 0 is not finite", data,
                     SKIN("[1,1,1]"));
    data.bind[0][5] = 1;
    GLTF_CASE_REFUSE("skins[0]: joints: nodes[3] is not in the default scene", data, SKIN("[1,1,1]"),
                     {"'nodes':[0,2,3]", "'nodes':[0,2]"});
    GLTF_CASE_REFUSE("accessor 7 has 2 elements for 3 joints", data, SKIN("[1,1,1]"), {"[3,4]", "[3,4,4]"});
    GLTF_CASE_REFUSE("JOINTS_0 and WEIGHTS_0 come together", data, SKIN("[1,1,1]"), {",'WEIGHTS_0':6", ""});
}

int main(void) {
    lw_log_init("test_gltf_meshes", LW_LOG_ERROR);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sparse_accessors_replace_elements),
        cmocka_unit_test(interleaved_accessors_are_read_with_their_stride),
        cmocka_unit_test(quantised_attributes_need_their_extension),
        cmocka_unit_test(colours_have_three_or_four_components),
        cmocka_unit_test(strips_and_fans_keep_their_winding),
        cmocka_unit_test(missing_normals_are_flat),
        cmocka_unit_test(triangles_without_area_are_left_out),
        cmocka_unit_test(a_mesh_keeps_a_material_per_triangle),
        cmocka_unit_test(instances_are_objects_of_one_mesh),
        cmocka_unit_test(morph_weights_move_vertices),
        cmocka_unit_test(skins_stand_as_their_joints_do),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
