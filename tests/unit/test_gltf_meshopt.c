/* EXT_meshopt_compression: a square of four vertices whose views libmeshoptimizer's encoders wrote, and what
 * becomes of it when one place in it is changed. */
#include "tests/support/glb.h"
#include "tests/support/support.h"

#include "common/base/log.h"
#include "server/import/gltf/gltf.h"

#include <math.h>
#include <meshoptimizer.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const float position[4][3] = {{0, 0, 0}, {1.5f, 0, 0}, {0, 1.5f, 0}, {1.5f, 1.5f, 0}};
static const float normal[4][4] = {{0, 0, 1, 0}, {0.6f, 0, 0.8f, 0}, {0, 0.6f, 0.8f, 0}, {0, 0, 1, 0}};
static const uint32_t triangle[6] = {0, 1, 2, 2, 1, 3};

/* The binary part: three streams in a row, 4 bytes apart at least. */
struct streams {
    uint8_t data[2048];
    size_t size, at[3], length[3];
};

static uint8_t *room(struct streams *streams, int which) {
    streams->at[which] = streams->size;
    return streams->data + streams->size;
}

static void put(struct streams *streams, int which, size_t length) {
    assert_in_range(length, 1, 1000);
    streams->length[which] = length;
    streams->size += (length + 3) / 4 * 4;
}

/* as_list: indices as a sequence, not as triangles */
static void encode(struct streams *out, bool as_list) {
    *out = (struct streams){0};
    uint32_t exponential[4][3];
    uint8_t octahedral[4][4];
    meshopt_encodeFilterExp(exponential, 4, 12, 24, position[0]);
    meshopt_encodeFilterOct(octahedral, 4, 4, 8, normal[0]);
    put(out, 0, meshopt_encodeVertexBuffer(room(out, 0), 1000, exponential, 4, 12));
    put(out, 1, meshopt_encodeVertexBuffer(room(out, 1), 1000, octahedral, 4, 4));
    if (as_list)
        put(out, 2, meshopt_encodeIndexSequence(room(out, 2), 1000, triangle, 6));
    else
        put(out, 2, meshopt_encodeIndexBuffer(room(out, 2), 1000, triangle, 6));
}

static char *describe(const struct streams *streams, bool as_list) {
    static char json[4096];
    snprintf(
        json, sizeof json,
        "{'asset':{'version':'2.0'},'nodes':[{'mesh':0}],"
        "'extensionsUsed':['EXT_meshopt_compression','KHR_mesh_quantization'],"
        "'extensionsRequired':['EXT_meshopt_compression','KHR_mesh_quantization'],"
        "'meshes':[{'primitives':[{'attributes':{'POSITION':0,'NORMAL':1},'indices':2}]}],"
        "'accessors':[{'bufferView':0,'componentType':5126,'count':4,'type':'VEC3'},"
        "{'bufferView':1,'componentType':5120,'normalized':true,'count':4,'type':'VEC3'},"
        "{'bufferView':2,'componentType':5123,'count':6,'type':'SCALAR'}],"
        "'bufferViews':["
        "{'buffer':1,'byteLength':48,'byteStride':12,'extensions':{'EXT_meshopt_compression':{'buffer':0,"
        "'byteOffset':%zu,'byteLength':%zu,'byteStride':12,'count':4,'mode':'ATTRIBUTES',"
        "'filter':'EXPONENTIAL'}}},"
        "{'buffer':1,'byteOffset':48,'byteLength':16,'byteStride':4,'extensions':{"
        "'EXT_meshopt_compression':{'buffer':0,"
        "'byteOffset':%zu,'byteLength':%zu,'byteStride':4,'count':4,'mode':'ATTRIBUTES',"
        "'filter':'OCTAHEDRAL'}}},"
        "{'buffer':1,'byteOffset':64,'byteLength':12,'extensions':{'EXT_meshopt_compression':{'buffer':0,"
        "'byteOffset':%zu,'byteLength':%zu,'byteStride':2,'count':6,'mode':'%s'}}}],"
        "'buffers':[{'byteLength':%zu},{'byteLength':76,'extensions':{'EXT_meshopt_compression':{"
        "'fallback':true}}}]}",
        streams->at[0], streams->length[0], streams->at[1], streams->length[1], streams->at[2],
        streams->length[2], as_list ? "INDICES" : "TRIANGLES", streams->size);
    return json;
}

static enum lw_status load(const char *json, const struct streams *streams, struct lw_scene **out,
                           struct lw_error *err) {
    size_t size;
    uint8_t *glb = lw_glb_pack(json, streams->data, streams->size, &size);
    enum lw_status status = lw_gltf_load_memory(glb, size, "base.glb", out, err);
    free(glb);
    return status;
}

static void a_compressed_square_is_the_square(void **state) {
    (void)state;
    for (int as_list = 0; as_list < 2; as_list++) {
        struct streams streams;
        struct lw_scene *scene = NULL;
        struct lw_error err = {0};
        encode(&streams, as_list);
        lw_support_ok(load(describe(&streams, as_list), &streams, &scene, &err), &err);
        const struct lw_mesh *mesh = &scene->mesh[0];
        assert_int_equal(mesh->vertex_count, 4);
        assert_int_equal(mesh->triangle_count, 2);
        for (unsigned t = 0; t < 2; t++)
            for (unsigned k = 0; k < 3; k++) {
                /* the encoder of triangles may turn them: (1, 2, 0) is (0, 1, 2) */
                unsigned from = 0;
                while (from < 3 && mesh->position[mesh->triangle[t][from]].x +
                                           2 * mesh->position[mesh->triangle[t][from]].y !=
                                       position[triangle[3 * t]][0] + 2 * position[triangle[3 * t]][1])
                    from++;
                assert_in_range(from, 0, 2);
                uint32_t v = mesh->triangle[t][(from + k) % 3], expected = triangle[3 * t + k];
                const float *p = position[expected], *n = normal[expected];
                assert_float_equal(mesh->position[v].x, p[0], 1e-6);
                assert_float_equal(mesh->position[v].y, p[1], 1e-6);
                assert_float_equal(mesh->position[v].z, p[2], 1e-6);
                assert_float_equal(mesh->normal[v].x, n[0], 0.02); /* 8 bits */
                assert_float_equal(mesh->normal[v].y, n[1], 0.02);
                assert_float_equal(mesh->normal[v].z, n[2], 0.02);
            }
        lw_scene_destroy(scene);
    }
}

static const struct {
    const char *old, *new, *text;
} wrong_places[] = {
    {"'mode':'TRIANGLES'", "'mode':'FANS'", "bufferViews[2]: EXT_meshopt_compression: mode: must be"},
    {"'mode':'TRIANGLES'", "'mode':'INDICES'", "the stream is none of INDICES"},
    {"'filter':'OCTAHEDRAL'", "'filter':'CUBIC'", "bufferViews[1]: EXT_meshopt_compression: filter: must be"},
    {"'filter':'OCTAHEDRAL'", "'filter':'QUATERNION'", "filter: QUATERNION cannot be used"},
    {"'byteStride':2", "'byteStride':3", "byteStride: must be 2 or 4 for TRIANGLES"},
    {"'byteStride':12,'count'", "'byteStride':10,'count'", "byteStride: must be a multiple of 4"},
    {"'byteStride':12,'count'", "'byteStride':260,'count'", "byteStride: must be an integer from 1 to 256"},
    {"'byteStride':12,'count':4", "'byteStride':12,'count':5",
     "count x byteStride is 60 bytes, the view has 48"},
    {"'byteLength':12,", "'byteLength':14,", "count x byteStride is 12 bytes, the view has 14"},
    {"'count':6,'mode'", "'count':7,'mode'", "count: must be a multiple of 3"},
    {"{'buffer':0,'byteOffset':0", "{'buffer':0,'byteOffset':5000", "reaches past the end of buffers[0]"},
    {"{'buffer':0,'byteOffset':0", "{'buffer':1,'byteOffset':0", "buffers[1] is a fallback"},
    {"{'buffer':0,'byteOffset':0", "{'byteOffset':0", "buffer: is required"},
    {"'byteLength':48,'byteStride':12,'extensions'", "'byteLength':48,'byteStride':12,'extras'",
     "bufferViews[0]: buffer: buffers[1] is a fallback and has no bytes"},
    {"'fallback':true", "'fallback':false", "buffers[1]: uri: is missing"},
    {"'byteLength':48,'byteStride':12,'extensions':{'EXT_meshopt_compression':{'buffer':0,'byteOffset':0,",
     "'byteLength':120000,'byteStride':12,'extensions':{'EXT_meshopt_compression':{'buffer':0,'count':10000,"
     "'byteStride':12,'mode':'ATTRIBUTES','byteLength':60}},'extras':{'b':{",
     "byteLength: 60 bytes cannot hold 120000"},
};

static void wrong_places_are_named(void **state) {
    (void)state;
    struct streams streams;
    encode(&streams, false);
    for (size_t i = 0; i < sizeof wrong_places / sizeof *wrong_places; i++) {
        struct lw_scene *scene = NULL;
        struct lw_error err = {0};
        char *json = lw_support_replaced(describe(&streams, false), wrong_places[i].old, wrong_places[i].new);
        lw_support_fails(load(json, &streams, &scene, &err), LW_BAD_DATA, &err, wrong_places[i].text);
        assert_null(scene);
        free(json);
    }
}

static void a_newer_version_is_refused_by_name(void **state) {
    (void)state;
    struct streams streams;
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    encode(&streams, false);
    streams.data[streams.at[0]] = 0xa1;
    lw_support_fails(load(describe(&streams, false), &streams, &scene, &err), LW_BAD_DATA, &err,
                     "the stream of ATTRIBUTES has version 1 of meshoptimizer's format; up to 0 is read");
}

/* Every single wrong byte, and every stream that is cut short, is read or refused: no crash, no leak. */
static void damaged_streams_are_read_or_refused(void **state) {
    (void)state;
    unsigned refused = 0;
    for (int as_list = 0; as_list < 2; as_list++) {
        struct streams streams;
        encode(&streams, as_list);
        for (size_t i = 0; i < streams.size; i++)
            for (int bit = 0; bit < 8; bit++) {
                struct lw_scene *scene = NULL;
                struct lw_error err = {0};
                streams.data[i] ^= (uint8_t)(1 << bit);
                enum lw_status status = load(describe(&streams, as_list), &streams, &scene, &err);
                assert_true(status == LW_OK || (status == LW_BAD_DATA && err.text[0] && !scene));
                refused += status != LW_OK;
                lw_scene_destroy(scene);
                streams.data[i] ^= (uint8_t)(1 << bit);
            }
        for (int which = 0; which < 3; which++) {
            struct streams cut = streams;
            struct lw_scene *scene = NULL;
            struct lw_error err = {0};
            cut.length[which]--;
            lw_support_fails(load(describe(&cut, as_list), &cut, &scene, &err), LW_BAD_DATA, &err,
                             "is corrupt");
        }
    }
    assert_true(refused > 0);
}

int main(void) {
    lw_log_init("test_gltf_meshopt", LW_LOG_ERROR);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_compressed_square_is_the_square),
        cmocka_unit_test(wrong_places_are_named),
        cmocka_unit_test(a_newer_version_is_refused_by_name),
        cmocka_unit_test(damaged_streams_are_read_or_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
