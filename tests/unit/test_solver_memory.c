/* What a solver says it holds is what it has allocated: of all calls of malloc and its kin by the solver's
 * own code (Embree's are not among them: lw_trace_memory_bytes() has them). */
#include "tests/support/support.h"

#include "common/builtin/builtin.h"
#include "common/lightmap/lightmap.h"
#include "server/solve/cell_layer.h"
#include "server/solve/solvers.h"

#include <malloc.h>
#include <math.h>
#include <stdlib.h>

/* Bytes held. */
#define OFF_MOST 0.01

static _Atomic int64_t held_bytes;

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *memory, size_t size);
void __real_free(void *memory);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *memory, size_t size);
void __wrap_free(void *memory);

static void *note(void *memory) {
    held_bytes += (int64_t)malloc_usable_size(memory);
    return memory;
}
void *__wrap_malloc(size_t size) { return note(__real_malloc(size)); }
void *__wrap_calloc(size_t count, size_t size) { return note(__real_calloc(count, size)); }
void *__wrap_realloc(void *memory, size_t size) {
    const int64_t before = (int64_t)malloc_usable_size(memory);
    void *moved = __real_realloc(memory, size);
    if (moved) held_bytes -= before;
    return moved ? note(moved) : NULL;
}
void __wrap_free(void *memory) {
    held_bytes -= (int64_t)malloc_usable_size(memory);
    __real_free(memory);
}

struct fixture {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
};

static struct lw_scene *build(const char *name, float texels_per_metre) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build(name, &scene, &err), &err);
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = texels_per_metre},
                                    NULL, &err),
                  &err);
    return scene;
}

static void open_scene(struct fixture *f, struct lw_scene *scene) {
    f->scene = scene;
    lw_support_ok(lw_atlas_map_init(&f->map, f->scene), NULL);
    lw_support_ok(lw_pose_init(&f->pose, f->scene), NULL);
}

static void close_scene(struct fixture *f) {
    lw_pose_finish(&f->pose);
    lw_atlas_map_finish(&f->map);
}

static struct lw_solver_desc desc_of(const struct fixture *f) {
    return (struct lw_solver_desc){.scene = f->scene,
                                   .atlas_map = &f->map,
                                   .bounces = 2,
                                   .tracing_range_m = INFINITY,
                                   .direct_samples = 1,
                                   .indirect_samples = 2,
                                   .target_error = 0.02f,
                                   .threads = 1,
                                   .seed = 1,
                                   .denoise = true};
}

static void expect_counted(const char *name, size_t said, int64_t held) {
    const double off = (double)said / (double)held - 1;
    printf("%s: %.3f MB said, %.3f MB held: %+.2f %%\n", name, 1e-6 * (double)said, 1e-6 * (double)held,
           100 * off);
    assert_true(fabs(off) <= OFF_MOST);
}

static void run_frame(struct lw_solver *solver, const struct fixture *f) {
    struct lw_error err = {0};
    struct lw_solver_stats stats;
    lw_support_ok(solver->ops->frame(solver, &f->pose, 1, &stats, &err), &err);
}

/* One layer; geometry and cell solver apart. */
static void expect_cells_counted(const char *name, struct lw_scene *scene) {
    struct fixture f;
    struct lw_error err = {0};
    open_scene(&f, scene);
    const struct lw_solver_desc desc = desc_of(&f);
    const int64_t before = held_bytes;
    struct lw_geometry geometry;
    struct lw_solver *solver;
    lw_support_ok(lw_geometry_init(&geometry, f.scene, &f.pose, NULL, 1, NULL, NULL, &err), &err);
    lw_support_ok(lw_cell_layer_create(&geometry, &desc, &f.pose, &solver, &err), &err);
    uint8_t *wanted = calloc(f.map.tile_count, 1);
    assert_non_null(wanted);
    lw_support_ok(solver->ops->set_interest(solver, wanted, &err), &err);
    free(wanted);
    run_frame(solver, &f);
    expect_counted(name,
                   solver->ops->memory_bytes(solver) + lw_geometry_memory_bytes(&geometry) -
                       lw_trace_memory_bytes(geometry.trace),
                   held_bytes - before);
    solver->ops->destroy(solver);
    lw_geometry_finish(&geometry);
    assert_true(held_bytes == before);
    close_scene(&f);
}

static void cornell_is_counted(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:cornell", 40);
    expect_cells_counted("builtin:cornell", scene);
    lw_scene_destroy(scene);
}

static void atrium_is_counted(void **state) { expect_cells_counted("builtin:atrium-matt", *state); }

/* With the sums of layers; another structure for rays stands for theirs. */
static void layers_are_counted(void **state) {
    struct fixture f;
    struct lw_error err = {0};
    struct lw_light_groups groups;
    struct lw_trace *trace;
    open_scene(&f, *state);
    lw_support_ok(lw_trace_create(f.scene, &f.pose, &trace, &err), &err);
    const size_t trace_bytes = lw_trace_memory_bytes(trace);
    lw_trace_destroy(trace);
    lw_support_ok(lw_light_groups_init(&groups, f.scene, &f.pose, NULL, &err), &err);
    assert_true(groups.count > 1);
    struct lw_solver_desc desc = desc_of(&f);
    desc.light_groups = &groups;
    const int64_t before = held_bytes;
    struct lw_solver *solver;
    lw_support_ok(lw_solvers_create(NULL, &desc, &f.pose, &solver, &err), &err);
    run_frame(solver, &f);
    expect_counted("atrium in layers", solver->ops->memory_bytes(solver) - trace_bytes, held_bytes - before);
    solver->ops->destroy(solver);
    assert_true(held_bytes == before);
    lw_light_groups_finish(&groups);
    close_scene(&f);
}

int main(void) {
    struct lw_scene *atrium = build("builtin:atrium-matt", 0.5f);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cornell_is_counted),
        cmocka_unit_test_prestate(atrium_is_counted, atrium),
        cmocka_unit_test_prestate(layers_are_counted, atrium),
    };
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    lw_scene_destroy(atrium);
    return failed;
}
