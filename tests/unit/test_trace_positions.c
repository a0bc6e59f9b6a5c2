#include "tests/support/support.h"

#include "common/trace/trace_positions.h"

#include <string.h>

/* Two triangles of a square, whose shared corners are split; a third one repeats the first. */
static struct lw_vec3 position[] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0},    {0, 0, 0},
                                    {1, 1, 0}, {0, 1, 0}, {-0.0f, 0, 0}};
static uint32_t triangle[][3] = {{0, 1, 2}, {3, 4, 5}, {6, 1, 2}};

#define OBJECTS 8u

static void list(uint32_t objects, struct lw_scene *scene, struct lw_mesh *mesh,
                 struct lw_trace_positions **out_positions) {
    static struct lw_object object[OBJECTS];
    *mesh = (struct lw_mesh){.position = position,
                             .vertex_count = sizeof position / sizeof *position,
                             .triangle = triangle,
                             .triangle_count = sizeof triangle / sizeof *triangle};
    *scene = (struct lw_scene){.mesh = mesh, .mesh_count = 1, .object = object, .object_count = objects};
    lw_support_ok(lw_trace_positions_list(scene, out_positions), NULL);
}

static void test_triangles_keep_their_corners(void **state) {
    (void)state;
    struct lw_scene scene;
    struct lw_mesh mesh;
    struct lw_trace_positions *positions;
    list(OBJECTS, &scene, &mesh, &positions);
    assert_int_equal(positions->count, 4);
    for (uint32_t t = 0; t < mesh.triangle_count; t++)
        for (int c = 0; c < 3; c++) {
            assert_true(positions->triangle[t][c] < positions->count);
            const struct lw_vec3 is = position[positions->vertex[positions->triangle[t][c]]],
                                 was = position[triangle[t][c]];
            assert_true(is.x == was.x && is.y == was.y && is.z == was.z);
        }
    lw_trace_positions_free(positions, &scene);
}

/* One object has 36 bytes of positions less, and the list takes 52. */
static void test_a_mesh_of_few_objects_has_no_list(void **state) {
    (void)state;
    struct lw_scene scene;
    struct lw_mesh mesh;
    struct lw_trace_positions *positions;
    list(1, &scene, &mesh, &positions);
    assert_int_equal(positions->count, 0);
    lw_trace_positions_free(positions, &scene);
    list(2, &scene, &mesh, &positions);
    assert_int_equal(positions->count, 4);
    lw_trace_positions_free(positions, &scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_triangles_keep_their_corners),
        cmocka_unit_test(test_a_mesh_of_few_objects_has_no_list),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
