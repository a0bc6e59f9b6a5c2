/* test_package.c: a scene comes back from its package, and the bytes are where
 * docs/scene_package.md says. */
#include "tests/support/failing_memory.h"
#include "tests/support/package_case.h"

#include "common/scene/package.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* What docs/scene_package.md shows byte by byte: one triangle that shines. */
static struct lw_scene *build_example(void) {
    static const struct lw_vec3 position[] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    static const struct lw_vec3 normal[] = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}};
    static const uint32_t triangle[][3] = {{0, 1, 2}};
    static const uint32_t triangle_material[] = {0};
    static struct lw_mesh mesh = {.name = "tri",
                                  .vertex_count = 3,
                                  .triangle_count = 1,
                                  .position = position,
                                  .normal = normal,
                                  .triangle = triangle,
                                  .material = triangle_material};
    static struct lw_material material = {.name = "glow",
                                          .base_colour = {0.5f, 0.5f, 0.5f, 1},
                                          .emission = {2, 1, 0.5f},
                                          .base_colour_texture = {LW_SCENE_NONE, 0, {1, 0, 0, 0, 1, 0}},
                                          .emission_texture = {LW_SCENE_NONE, 0, {1, 0, 0, 0, 1, 0}},
                                          .alpha_cutoff = 0.5f,
                                          .double_sided = 1};
    static struct lw_node node = {.name = "",
                                  .parent = LW_SCENE_NONE,
                                  .translation = {0, 1, 0},
                                  .rotation = {0, 0, 0, 1},
                                  .scale = {1, 1, 1}};
    static struct lw_object object = {.name = "tri"};
    struct lw_scene *scene;
    lw_support_ok(lw_scene_create(&scene), NULL);
    scene->name = "example";
    scene->mesh = &mesh;
    scene->material = &material;
    scene->node = &node;
    scene->object = &object;
    scene->mesh_count = scene->material_count = scene->node_count = scene->object_count = 1;
    return scene;
}

static void the_document_shows_the_bytes(void **state) {
    (void)state;
    size_t text_size, size;
    char *text = (char *)lw_support_read_file(lw_support_source("docs/scene_package.md"), &text_size);
    uint8_t expected[4096], head[64];
    const char *at = text;
    size_t expected_size = lw_support_document_bytes(&at, expected, sizeof expected);
    struct lw_scene *scene = build_example();
    uint8_t *bytes = package_case_write(scene, &size);
    assert_int_equal(size, expected_size);
    assert_memory_equal(bytes, expected, size);
    struct lw_scene *read;
    struct lw_error err = {0};
    lw_support_ok(lw_package_read(expected, expected_size, &read, &err), &err);
    assert_string_equal(read->object[0].name, "tri");
    assert_true(read->material[0].emission[1] == 1.0f);
    lw_scene_destroy(read);
    free(bytes);
    bytes = package_case_write_sealed(scene, &size); /* as a file: its header */
    assert_int_equal(lw_support_document_bytes(&at, head, sizeof head), 32);
    assert_memory_equal(bytes, head, 32);
    lw_scene_destroy(scene);
    free(bytes);
    free(text);
}

static void everything_comes_back(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(), *read;
    size_t size, again_size;
    uint8_t *bytes = package_case_write(scene, &size);
    struct lw_error err = {0};
    lw_support_ok(lw_package_read(bytes, size, &read, &err), &err);
    uint8_t *again = package_case_write(read, &again_size);
    assert_int_equal(again_size, size);
    assert_memory_equal(again, bytes, size);
    memset(bytes, 0xEE, size); /* the scene needs nothing of what it was read from */
    free(bytes);
    package_case_expect_same_scene(scene, read);
    free(again);
    lw_scene_destroy(read);
    lw_scene_destroy(scene);
}

static void same_scene_same_bytes(void **state) {
    (void)state;
    size_t size, other_size;
    uint8_t *bytes = package_case_write_everything(&size);
    /* memory with other garbage in it */
    for (int i = 0; i < 50; i++) {
        void *garbage = malloc(100u << i % 10);
        assert_non_null(garbage);
        memset(garbage, 0x5A, 100u << i % 10);
        free(garbage);
    }
    uint8_t *other = package_case_write_everything(&other_size);
    assert_int_equal(size, other_size);
    assert_memory_equal(bytes, other, size);
    free(bytes);
    free(other);
}

static void an_unsound_scene_is_not_written(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything();
    scene->object[1].mesh = 99;
    uint8_t *bytes = NULL;
    size_t size = 0;
    struct lw_error err = {0};
    enum lw_status status = lw_package_write(scene, &bytes, &size, &err);
    lw_support_fails(status, LW_BAD_DATA, &err, "object 1 \"second\": names mesh 99 of 2");
    assert_null(bytes);
    err = (struct lw_error){0};
    const char *path = lw_support_temporary("unsound.lwscene");
    status = lw_package_save(scene, path, &err);
    lw_support_fails(status, LW_BAD_DATA, &err, "unsound.lwscene: object 1");
    assert_int_equal(access(path, F_OK), -1);
    lw_scene_destroy(scene);
}

static uint32_t float_bits(float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

/* A round trip cannot see two fields that writer and reader swap alike; the offsets of the document can. */
static void fields_lie_where_the_document_says(void **state) {
    (void)state;
    const struct {
        unsigned section, record_size, record, offset;
        uint32_t value;
    } fields[] = {
        {SCENE, 24, 0, 8, float_bits(4)},
        {SCENE, 24, 0, 12, float_bits(0.5f)},
        {MESHES, 64, 0, 8, 4},
        {MESHES, 64, 0, 12, 2},
        {MESHES, 64, 0, 28, 4},
        {MESHES, 64, 0, 48, 12},
        {MESHES, 64, 0, 52, 24},
        {MESHES, 64, 0, 56, 12},
        {MATERIALS, 112, 2, 40, 2},
        {MATERIALS, 112, 2, 72, 1},
        {MATERIALS, 112, 2, 76, 1},
        {MATERIALS, 112, 1, 36, float_bits(0.25f)},
        {MATERIALS, 112, 1, 104, 1},
        {MATERIALS, 112, 1, 108, 1},
        {MATERIALS, 112, 2, 24, float_bits(10)},
        {TEXTURES, 28, 2, 8, 3},
        {TEXTURES, 28, 2, 12, 1},
        {TEXTURES, 28, 2, 16, 5},
        {TEXTURES, 28, 2, 20, 1},
        {TEXTURES, 28, 2, 24, 2},
        {NODES, 104, 2, 8, 1},
        {NODES, 104, 1, 12, 1},
        {NODES, 104, 1, 56, float_bits(-1)},
        {NODES, 104, 2, 48, float_bits(2)},
        {NODES, 104, 3, 20, float_bits(10)},
        {NODES, 104, 3, 28, float_bits(0.6f)},
        {OBJECTS, 16, 1, 8, 0},
        {OBJECTS, 16, 1, 12, 3},
        {LIGHTS, 40, 1, 8, 2},
        {LIGHTS, 40, 1, 12, 1},
        {LIGHTS, 40, 1, 16, float_bits(4)},
        {LIGHTS, 40, 1, 28, float_bits(0.1f)},
        {LIGHTS, 40, 1, 32, float_bits(0.75f)},
        {LIGHTS, 40, 2, 36, float_bits(0.0093f)},
        {CAMERAS, 16, 0, 8, 3},
        {CAMERAS, 16, 0, 12, float_bits(1)},
        {CHANNELS, 24, 1, 0, 2},
        {CHANNELS, 24, 1, 4, 1},
        {CHANNELS, 24, 3, 8, 2},
        {CHANNELS, 24, 2, 12, 2},
        {CHANNELS, 24, 2, 16, 6},
        {CHANNELS, 24, 2, 20, 21},
    };
    size_t size;
    uint8_t *bytes = package_case_write_everything(&size);
    for (size_t i = 0; i < sizeof fields / sizeof *fields; i++) {
        uint32_t value;
        memcpy(&value,
               bytes + package_case_section_offset(bytes, fields[i].section) +
                   fields[i].record * fields[i].record_size + fields[i].offset,
               sizeof value);
        if (value != fields[i].value)
            fail_msg("section %u, record %u, offset %u: 0x%x instead of 0x%x", fields[i].section,
                     fields[i].record, fields[i].offset, value, fields[i].value);
    }
    free(bytes);
}

static void failing_allocations_are_reported(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything();
    size_t size, other_size;
    uint8_t *bytes = package_case_write(scene, &size), *other;
    unsigned write_failures = 0, read_failures = 0;
    for (unsigned n = 0;; n++, write_failures++) {
        struct lw_error err = {0};
        failing_memory_one(n);
        enum lw_status status = lw_package_write(scene, &other, &other_size, &err);
        (void)failing_memory_end();
        if (status == LW_OK) break;
        lw_support_fails(status, LW_NO_MEMORY, &err, "no memory");
    }
    assert_memory_equal(other, bytes, size);
    free(other);
    for (unsigned n = 0;; n++, read_failures++) {
        struct lw_error err = {0};
        struct lw_scene *read = NULL;
        failing_memory_one(n);
        enum lw_status status = lw_package_read(bytes, size, &read, &err);
        (void)failing_memory_end();
        assert_int_equal(read != NULL, status == LW_OK);
        lw_scene_destroy(read);
        if (status == LW_OK) break;
        lw_support_fails(status, LW_NO_MEMORY, &err, "no memory");
    }
    /* the bytes or the scene, the check of channels, the four arrays of a pose */
    assert_true(write_failures >= 6 && read_failures >= 7);
    free(bytes);
    lw_scene_destroy(scene);
}

static void hash_is_xxh3_of_the_bytes(void **state) {
    (void)state;
    /* XXH3-128 of the empty input, seed 0, as xxhsum -H2 prints it: 99aa06d3014798d86001c324468d497f */
    static const uint8_t expected[16] = {0x99, 0xAA, 0x06, 0xD3, 0x01, 0x47, 0x98, 0xD8,
                                         0x60, 0x01, 0xC3, 0x24, 0x46, 0x8D, 0x49, 0x7F};
    struct lw_package_hash hash, other;
    lw_package_hash((const uint8_t *)"", 0, &hash);
    assert_memory_equal(hash.bytes, expected, 16);
    size_t size;
    uint8_t *bytes = package_case_write_everything(&size);
    lw_package_hash(bytes, size, &hash);
    bytes[size - 1] ^= 1;
    lw_package_hash(bytes, size, &other);
    assert_memory_not_equal(hash.bytes, other.bytes, 16);
    free(bytes);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_document_shows_the_bytes),
        cmocka_unit_test(fields_lie_where_the_document_says),
        cmocka_unit_test(everything_comes_back),
        cmocka_unit_test(same_scene_same_bytes),
        cmocka_unit_test(an_unsound_scene_is_not_written),
        cmocka_unit_test(failing_allocations_are_reported),
        cmocka_unit_test(hash_is_xxh3_of_the_bytes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
