/* KHR_draco_mesh_compression: a mesh of nine vertices that libdraco's encoder wrote, and what becomes of it
 * when one place in it is changed. */
#include "tests/support/draco_encode.h"
#include "tests/support/glb.h"
#include "tests/support/support.h"

#include "common/base/log.h"
#include "server/import/gltf/gltf.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SIDE 3 /* vertices: a bent sheet of 2 x 2 squares */
enum { VERTICES = SIDE * SIDE, TRIANGLES = 2 * (SIDE - 1) * (SIDE - 1) };

struct mesh {
    float position[VERTICES][3], normal[VERTICES][3];
    uint8_t colour[VERTICES][4];
    uint32_t index[TRIANGLES][3];
};

struct stream {
    uint8_t data[4096];
    size_t size;
};

static struct mesh sheet(void) {
    struct mesh mesh = {0};
    unsigned t = 0;
    for (unsigned y = 0; y < SIDE; y++)
        for (unsigned x = 0; x < SIDE; x++) {
            unsigned v = y * SIDE + x;
            const float slope = 0.3f * (float)x - 0.2f, length = sqrtf(1 + slope * slope);
            mesh.position[v][0] = 0.7f * (float)x;
            mesh.position[v][1] = 1.1f * (float)y;
            mesh.position[v][2] = 0.15f * (float)(x * x);
            mesh.normal[v][0] = -slope / length;
            mesh.normal[v][2] = 1 / length;
            const uint8_t colour[4] = {(uint8_t)(20 * v), (uint8_t)(255 - 10 * v), 51, 255};
            memcpy(mesh.colour[v], colour, 4);
            if (x + 1 == SIDE || y + 1 == SIDE) continue;
            const uint32_t two[2][3] = {{v, v + 1, v + SIDE}, {v + SIDE, v + 1, v + SIDE + 1}};
            memcpy(mesh.index[t], two, sizeof two);
            t += 2;
        }
    return mesh;
}

static void encode(struct stream *out, bool edgebreaker) {
    const struct mesh mesh = sheet();
    *out = (struct stream){0};
    out->size = lw_draco_encode(mesh.position[0], mesh.normal[0], mesh.colour[0], VERTICES, mesh.index[0],
                                TRIANGLES, edgebreaker, out->data, sizeof out->data);
    assert_true(out->size > 0);
}

static const char *describe(const struct stream *stream) {
    static char json[2048];
    snprintf(json, sizeof json,
             "{'asset':{'version':'2.0'},'nodes':[{'mesh':0}],"
             "'extensionsUsed':['KHR_draco_mesh_compression'],"
             "'extensionsRequired':['KHR_draco_mesh_compression'],"
             "'meshes':[{'primitives':[{'attributes':{'POSITION':0,'NORMAL':1,'COLOR_0':2},'indices':3,"
             "'extensions':{'KHR_draco_mesh_compression':{'bufferView':0,"
             "'attributes':{'POSITION':0,'NORMAL':1,'COLOR_0':2}}}}]}],"
             "'accessors':[{'componentType':5126,'count':9,'type':'VEC3'},"
             "{'componentType':5126,'count':9,'type':'VEC3'},"
             "{'componentType':5121,'normalized':true,'count':9,'type':'VEC4'},"
             "{'componentType':5123,'count':24,'type':'SCALAR'}],"
             "'bufferViews':[{'buffer':0,'byteLength':%zu}],'buffers':[{'byteLength':%zu}]}",
             stream->size, stream->size);
    return json;
}

static enum lw_status load(const char *json, const struct stream *stream, struct lw_scene **out,
                           struct lw_error *err) {
    size_t size;
    uint8_t *glb = lw_glb_pack(json, stream->data, stream->size, &size);
    enum lw_status status = lw_gltf_load_memory(glb, size, "base.glb", out, err);
    free(glb);
    return status;
}

static uint32_t find(const struct lw_mesh *mesh, const float position[3]) {
    for (uint32_t v = 0; v < mesh->vertex_count; v++)
        if (mesh->position[v].x == position[0] && mesh->position[v].y == position[1] &&
            mesh->position[v].z == position[2])
            return v;
    fail_msg("no vertex at (%g, %g, %g)", (double)position[0], (double)position[1], (double)position[2]);
    return 0;
}

static void check_vertices(const struct lw_mesh *mesh, const struct mesh *expected) {
    assert_int_equal(mesh->vertex_count, VERTICES);
    for (unsigned i = 0; i < VERTICES; i++) {
        const uint32_t v = find(mesh, expected->position[i]);
        assert_float_equal(mesh->normal[v].x, expected->normal[i][0], 1e-6);
        assert_float_equal(mesh->normal[v].z, expected->normal[i][2], 1e-6);
        assert_float_equal(mesh->colour[v].x, expected->colour[i][0] / 255.0f, 1e-6);
        assert_float_equal(mesh->colour[v].y, expected->colour[i][1] / 255.0f, 1e-6);
        assert_float_equal(mesh->colour[v].z, 0.2, 1e-6);
    }
}

/* The stream may have another order of triangles, and each may begin elsewhere; its winding stays. */
static void check_triangles(const struct lw_mesh *mesh, const struct mesh *expected) {
    assert_int_equal(mesh->triangle_count, TRIANGLES);
    for (unsigned i = 0; i < TRIANGLES; i++) {
        uint32_t v[3];
        unsigned found = 0;
        for (unsigned k = 0; k < 3; k++) v[k] = find(mesh, expected->position[expected->index[i][k]]);
        for (unsigned t = 0; t < TRIANGLES; t++)
            for (unsigned k = 0; k < 3; k++)
                found += mesh->triangle[t][k] == v[0] && mesh->triangle[t][(k + 1) % 3] == v[1] &&
                         mesh->triangle[t][(k + 2) % 3] == v[2];
        assert_int_equal(found, 1);
    }
}

static void a_compressed_sheet_is_the_sheet(void **state) {
    (void)state;
    const struct mesh expected = sheet();
    for (int edgebreaker = 0; edgebreaker < 2; edgebreaker++) {
        struct stream stream;
        struct lw_scene *scene = NULL;
        struct lw_error err = {0};
        encode(&stream, edgebreaker);
        lw_support_ok(load(describe(&stream), &stream, &scene, &err), &err);
        check_vertices(&scene->mesh[0], &expected);
        check_triangles(&scene->mesh[0], &expected);
        lw_scene_destroy(scene);
    }
}

static const struct {
    const char *old, *new, *text;
} wrong_places[] = {
    {"{'bufferView':0,", "{'bufferView':1,",
     "meshes[0]: primitives[0]: KHR_draco_mesh_compression: bufferView: must be an index"},
    {"{'bufferView':0,", "{", "KHR_draco_mesh_compression: bufferView: is required"},
    {"'bufferView':0,'attributes'", "'bufferView':0,'Attributes'", "attributes: is required"},
    {"'attributes':{'POSITION':0,'NORMAL':1,'COLOR_0':2}}}", "'attributes':{'POSITION':7}}}",
     "POSITION: the Draco stream has no attribute 7 of 3 components"},
    {"'attributes':{'POSITION':0,'NORMAL':1,'COLOR_0':2}}}", "'attributes':{'POSITION':2}}}",
     "POSITION: the Draco stream has no attribute 2 of 3 components"},
    {"'count':9", "'count':8", "accessor 1 has 9 elements, POSITION has 8"},
    {"'count':24", "'count':21", "8 triangles and 9 vertices in"},
    {"'indices':3,", "", "asks for indices and mode 4"},
    {"'indices':3,", "'indices':3,'mode':5,", "asks for indices and mode 4"},
};

static void wrong_places_are_named(void **state) {
    (void)state;
    struct stream stream;
    encode(&stream, true);
    for (size_t i = 0; i < sizeof wrong_places / sizeof *wrong_places; i++) {
        struct lw_scene *scene = NULL;
        struct lw_error err = {0};
        char *json = lw_support_replaced(describe(&stream), wrong_places[i].old, wrong_places[i].new);
        lw_support_fails(load(json, &stream, &scene, &err), LW_BAD_DATA, &err, wrong_places[i].text);
        assert_null(scene);
        free(json);
    }
}

static void expect_refusal(const struct stream *stream, const char *text) {
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    lw_support_fails(load(describe(stream), stream, &scene, &err), LW_BAD_DATA, &err, text);
}

static void the_header_is_checked_before_decoding(void **state) {
    (void)state;
    struct stream stream, good;
    encode(&good, true);
    stream = good;
    stream.data[6] = 1;
    expect_refusal(&stream, "of version 2.1; only 2.2 is read");
    stream = good;
    stream.data[0] = 'd';
    expect_refusal(&stream, "bufferView 0: is no Draco stream");
    stream = good;
    stream.data[7] = 0;
    expect_refusal(&stream, "of points; only plain meshes");
    stream = good;
    stream.data[10] |= 0x80;
    expect_refusal(&stream, "of metadata; only plain meshes");
    stream = good;
    memcpy(stream.data + 12, "\xff\xff\xff\xff\x0f", 5);
    expect_refusal(&stream, "4294967295 vertices in");
    for (stream = good; stream.size > 1;) {
        stream.size--;
        expect_refusal(&stream, "Draco stream");
    }
}

/* Every single wrong byte is read or refused: no crash, no leak. */
static void damaged_streams_are_read_or_refused(void **state) {
    (void)state;
    unsigned refused = 0;
    for (int edgebreaker = 0; edgebreaker < 2; edgebreaker++) {
        struct stream stream;
        encode(&stream, edgebreaker);
        for (size_t i = 0; i < stream.size; i++)
            for (unsigned mask = 1; mask < 256; mask = 2 * mask + 1) {
                struct lw_scene *scene = NULL;
                struct lw_error err = {0};
                stream.data[i] ^= (uint8_t)mask;
                enum lw_status status = load(describe(&stream), &stream, &scene, &err);
                assert_true(status == LW_OK || (err.text[0] && !scene));
                refused += status != LW_OK;
                lw_scene_destroy(scene);
                stream.data[i] ^= (uint8_t)mask;
            }
    }
    assert_true(refused > 0);
}

int main(void) {
    lw_log_init("test_gltf_draco", LW_LOG_ERROR);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_compressed_sheet_is_the_sheet),
        cmocka_unit_test(wrong_places_are_named),
        cmocka_unit_test(the_header_is_checked_before_decoding),
        cmocka_unit_test(damaged_streams_are_read_or_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
