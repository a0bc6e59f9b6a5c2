#include "tests/support/support.h"

#include "common/builtin/builtin.h"
#include "common/lightmap/lightmap.h"
#include "server/solve/surface/invalid_texels.h"
#include "server/solve/surface/standing.h"

#include <string.h>

/* Texels of an object that have surface; all: whether light reaches it or not. */
static uint32_t covered(const struct lw_texels *texels, uint32_t object, bool all) {
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[object].mesh];
    uint32_t count = 0;
    for (uint32_t i = 0; i < mesh->texel_count; i++)
        count += all ? mesh->covered[i] : texels->covered[texels->first[object] + i];
    return count;
}

/* As if things had always stood where they do. */
static void expect_fresh(const struct lw_texels *texels, const struct lw_pose *pose,
                         const struct lw_standing *standing, const struct lw_trace *trace) {
    struct lw_texels fresh;
    struct lw_error err = {0};
    uint64_t count;
    lw_support_ok(lw_texels_init(&fresh, texels->scene, 1, NULL, NULL, &err), &err);
    lw_support_ok(lw_invalid_texels_find(&fresh, pose, standing->stands, trace, 1, NULL, NULL, &count), NULL);
    assert_memory_equal(texels->covered, fresh.covered, texels->count);
    assert_memory_equal(texels->usable, fresh.usable, texels->count);
    assert_memory_equal(texels->walls, fresh.walls, texels->count);
    assert_memory_equal(texels->side, fresh.side, texels->count * sizeof *fresh.side);
    assert_memory_equal(texels->source, fresh.source, texels->count * sizeof *fresh.source);
    lw_texels_finish(&fresh);
}

/* The floor under the two blocks of the Cornell box comes to light as they go, one by one. */
static void what_was_buried_comes_to_light(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_texels texels;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    const uint32_t floor = lw_support_object(scene, "floor"), tall = lw_support_object(scene, "tall block"),
                   small = lw_support_object(scene, "short block");
    /* slabs: only a surface close above a texel buries it */
    scene->node[scene->object[tall].node].scale[1] = scene->node[scene->object[small].node].scale[1] = 0.01f;
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 20}, NULL, &err),
                  &err);
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_support_ok(lw_trace_create(scene, &pose, &trace, &err), &err);
    lw_support_ok(lw_texels_init(&texels, scene, 1, NULL, NULL, &err), &err);
    const uint32_t all = covered(&texels, floor, true);
    uint64_t count;
    struct lw_standing standing;
    bool others;
    lw_support_ok(lw_standing_init(&standing, scene, &pose), NULL);
    lw_support_ok(lw_invalid_texels_find(&texels, &pose, standing.stands, trace, 1, NULL, NULL, &count),
                  NULL);
    assert_true(count > 0);
    const uint32_t with_both = covered(&texels, floor, false);
    assert_true(with_both < all); /* some 0.6 m x 0.6 m under each */
    struct lw_pose before;
    lw_support_ok(lw_pose_init(&before, scene), NULL);
    assert_false(lw_standing_take(&standing, &before, &pose, 1)); /* nothing has changed */
    lw_support_ok(lw_invalid_texels_review(&texels, &before, standing.stood, &pose, trace, 1, &others), NULL);
    assert_false(others);
    assert_int_equal(covered(&texels, floor, false), with_both);

    pose.object_dynamic[tall] = pose.object_hidden[tall] = true;
    lw_support_ok(lw_trace_set_pose(trace, &pose, &err), &err);
    assert_true(lw_standing_take(&standing, &before, &pose, 2));
    lw_support_ok(lw_invalid_texels_review(&texels, &before, standing.stood, &pose, trace, 1, &others), NULL);
    assert_true(others);
    const uint32_t with_one = covered(&texels, floor, false);
    assert_true(with_both < with_one && with_one < all);
    assert_int_equal(covered(&texels, tall, false), covered(&texels, tall, true)); /* its foot, too */
    assert_true(covered(&texels, small, false) <= covered(&texels, small, true));

    lw_pose_copy(&before, &pose, scene);
    pose.object_dynamic[small] = true;
    pose.object_to_world[small].m[1][3] += 5;
    lw_support_ok(lw_trace_set_pose(trace, &pose, &err), &err);
    assert_true(lw_standing_take(&standing, &before, &pose, 3));
    lw_support_ok(lw_invalid_texels_review(&texels, &before, standing.stood, &pose, trace, 1, &others), NULL);
    assert_true(with_one < covered(&texels, floor, false));
    expect_fresh(&texels, &pose, &standing, trace);

    /* and is buried where they are put down again, together and elsewhere */
    lw_pose_copy(&before, &pose, scene);
    pose.object_hidden[tall] = false;
    pose.object_to_world[small].m[1][3] -= 5;
    pose.object_to_world[small].m[0][3] += 0.1f;
    lw_support_ok(lw_trace_set_pose(trace, &pose, &err), &err);
    assert_true(lw_standing_take(&standing, &before, &pose, 20));
    lw_support_ok(lw_invalid_texels_review(&texels, &before, standing.stood, &pose, trace, 1, &others), NULL);
    assert_true(with_one > covered(&texels, floor, false));
    expect_fresh(&texels, &pose, &standing, trace);
    lw_standing_finish(&standing);
    lw_texels_finish(&texels);
    lw_trace_destroy(trace);
    lw_pose_finish(&before);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_was_buried_comes_to_light),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
