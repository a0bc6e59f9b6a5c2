/* Octahedral maps, the forms of probes, and what probes know of their surroundings. */
#include "tests/support/support.h"

#include "common/base/sampling.h"
#include "common/light/direction.h"
#include "common/trace/trace.h"
#include "server/solve/transport/cube_map.h"
#include "server/solve/transport/octahedral.h"
#include "server/solve/transport/probes.h"
#include "server/solve/transport/ray_hit.h"

#include <math.h>
#include <stdlib.h>

/* Directions that cover the sphere, poles and folds included. */
#define DIRECTIONS 1024u
static struct lw_vec3 direction(uint32_t i) {
    static const float axes[6][3] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    if (i < 6) return lw_vec3(axes[i][0], axes[i][1], axes[i][2]);
    float point[2];
    lw_random_sobol2(i, 7, point);
    return lw_direction_sphere(point);
}

static void test_octahedral_round_trip(void **state) {
    (void)state;
    for (uint32_t i = 0; i < DIRECTIONS; i++) {
        struct lw_vec2 p = lw_octahedral_encode(direction(i));
        assert_true(p.x >= 0 && p.x <= 1 && p.y >= 0 && p.y <= 1);
        assert_true(lw_vec3_dot(lw_octahedral_decode(p), direction(i)) > 0.999999f);
    }
    for (uint32_t y = 0; y < 8; y++)
        for (uint32_t x = 0; x < 8; x++)
            assert_int_equal(lw_octahedral_cell(8, lw_octahedral_direction(8, x, y)), (y + 1) * 10 + x + 1);
}

/* A smooth function comes back as itself everywhere, across the folds as well: there the border is read. */
static void test_octahedral_read_is_continuous(void **state) {
    (void)state;
    enum { SIDE = 64 };
    static float map[(SIDE + 2) * (SIDE + 2)];
    for (uint32_t y = 0; y < SIDE; y++)
        for (uint32_t x = 0; x < SIDE; x++) {
            struct lw_vec3 d = lw_octahedral_direction(SIDE, x, y);
            map[(y + 1) * (SIDE + 2) + x + 1] = d.x + 2 * d.y - 3 * d.z;
        }
    lw_octahedral_wrap(map, SIDE, 1);
    for (uint32_t i = 0; i < DIRECTIONS; i++) {
        struct lw_vec3 d = direction(i);
        float value;
        lw_octahedral_read(map, SIDE, 1, d, &value);
        assert_float_equal(value, d.x + 2 * d.y - 3 * d.z, 0.06);
    }
}

static void test_cube_round_trip(void **state) {
    (void)state;
    enum { SIDE = 5, FACE = (SIDE + 2) * (SIDE + 2) };
    for (uint32_t i = 0; i < DIRECTIONS; i++) {
        const struct lw_cube_map_place p = lw_cube_map_place(direction(i));
        assert_true(p.face < LW_CUBE_MAP_FACES && p.u >= 0 && p.u <= 1 && p.v >= 0 && p.v <= 1);
        assert_true(lw_vec3_dot(lw_cube_map_direction(p), direction(i)) > 0.999999f);
    }
    for (uint32_t face = 0; face < LW_CUBE_MAP_FACES; face++)
        for (uint32_t y = 1; y <= SIDE; y++)
            for (uint32_t x = 1; x <= SIDE; x++) {
                const struct lw_vec3 d = lw_cube_map_direction((struct lw_cube_map_place){
                    face, lw_cube_map_middle(SIDE, x), lw_cube_map_middle(SIDE, y)});
                assert_int_equal(lw_cube_map_cell(SIDE, d), face * FACE + y * (SIDE + 2) + x);
            }
}

/* As of the octahedral map, across the cube's edges; and what two faces say of an edge is the same. */
static void test_cube_read_is_continuous(void **state) {
    (void)state;
    enum { SIDE = 32, FACE = (SIDE + 2) * (SIDE + 2) };
    static float map[LW_CUBE_MAP_FACES * FACE];
    for (uint32_t face = 0; face < LW_CUBE_MAP_FACES; face++)
        for (uint32_t y = 1; y <= SIDE; y++)
            for (uint32_t x = 1; x <= SIDE; x++) {
                const struct lw_vec3 d = lw_cube_map_direction((struct lw_cube_map_place){
                    face, lw_cube_map_middle(SIDE, x), lw_cube_map_middle(SIDE, y)});
                map[face * FACE + y * (SIDE + 2) + x] = d.x + 2 * d.y - 3 * d.z;
            }
    lw_cube_map_wrap(map, SIDE, 1);
    for (uint32_t i = 0; i < DIRECTIONS; i++) {
        const struct lw_vec3 d = direction(i);
        float value;
        lw_cube_map_read(map, SIDE, 1, d, &value);
        assert_float_equal(value, d.x + 2 * d.y - 3 * d.z, 0.06);
    }
    for (float along = -0.97f; along < 0.97f; along += 0.01f) {
        float one, other;
        lw_cube_map_read(map, SIDE, 1, lw_vec3(1.0001f, 1, along), &one);
        lw_cube_map_read(map, SIDE, 1, lw_vec3(1, 1.0001f, along), &other);
        assert_float_equal(one, other, 0.002);
    }
}

typedef float function_of_direction(struct lw_vec3 d);

static void project(const struct lw_probe_form_ops *form, function_of_direction *fn, uint32_t rays,
                    float *map) {
    float sum[LW_PROBE_FORM_FLOATS_MAX] = {0};
    for (uint32_t i = 0; i < rays; i++) {
        float point[2];
        lw_random_sobol2(i, 3, point);
        struct lw_vec3 d = lw_direction_sphere(point);
        form->add(sum, d, (const float[3]){fn(d), 2 * fn(d), 0});
    }
    for (uint32_t i = 0; i < form->sum_floats; i++) sum[i] /= (float)rays;
    form->to_map(sum, map);
}

static float smooth(struct lw_vec3 d) { return 3 + d.x - 0.5f * d.y * d.z + 0.7f * d.y * d.y; }
static float lamp(struct lw_vec3 d) { return d.y > 0.9f ? 100.0f : 0; }

/* SH-9 spans all of l <= 2, so it returns such a function exactly; the map within its cell's width. */
static void expect_smooth(enum lw_probe_form_kind kind, double tolerance) {
    const struct lw_probe_form_ops *form = lw_probe_form(kind);
    float map[LW_PROBE_FORM_FLOATS_MAX];
    project(form, smooth, 1u << 14, map);
    for (uint32_t i = 0; i < DIRECTIONS; i++) {
        struct lw_vec3 d = direction(i), value = form->read(map, d);
        assert_float_equal(value.x, smooth(d), tolerance);
        assert_true(fabs((double)(value.y - 2 * smooth(d))) < 2 * tolerance);
        assert_true(value.z == 0);
    }
}

static void test_forms_return_smooth_light(void **state) {
    (void)state;
    expect_smooth(LW_PROBE_FORM_SH, 0.01);
    expect_smooth(LW_PROBE_FORM_OCTAHEDRAL, 0.15);
    expect_smooth(LW_PROBE_FORM_CUBE, 0.15);
}

/* A small lamp in the dark: nothing may go below zero, and no form may gain light. Its mean over the sphere
 * is 100 (1 - 0.9) / 2 = 5. */
static void expect_lamp(enum lw_probe_form_kind kind, double most_gain) {
    const struct lw_probe_form_ops *form = lw_probe_form(kind);
    float map[LW_PROBE_FORM_FLOATS_MAX];
    project(form, lamp, 1u << 14, map);
    double mean = 0, high = 0;
    for (uint32_t i = 6; i < 6 + 4096; i++) {
        float point[2];
        lw_random_sobol2(i, 7, point);
        struct lw_vec3 value = form->read(map, lw_direction_sphere(point));
        assert_true(value.x >= 0 && value.y >= 0);
        mean += (double)value.x / 4096;
        high = fmax(high, (double)value.x);
    }
    assert_true(fabs(mean - 5) < 5 * most_gain);
    assert_true(high < 130 && high > 8);
}

static void test_forms_neither_ring_nor_gain(void **state) {
    (void)state;
    expect_lamp(LW_PROBE_FORM_SH, 0.02);
    expect_lamp(LW_PROBE_FORM_OCTAHEDRAL, 0.05);
    expect_lamp(LW_PROBE_FORM_CUBE, 0.05);
}

/* After a single frame most cells of a map have met no ray; look-ups have to give light all the same. */
static void test_map_without_rays_takes_its_neighbours(void **state) {
    (void)state;
    static const enum lw_probe_form_kind maps[] = {LW_PROBE_FORM_OCTAHEDRAL, LW_PROBE_FORM_CUBE};
    for (size_t m = 0; m < sizeof maps / sizeof *maps; m++) {
        const struct lw_probe_form_ops *form = lw_probe_form(maps[m]);
        float map[LW_PROBE_FORM_FLOATS_MAX];
        project(form, smooth, 32, map);
        for (uint32_t i = 0; i < DIRECTIONS; i++)
            assert_float_equal(form->read(map, direction(i)).x, smooth(direction(i)), 1.5);
    }
}

/* A closed cube of 4 m around the origin, seen from inside, with a solid block in it. */
struct hall {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
};

static void add_box(struct lw_mesh *mesh, struct lw_scene *scene, struct lw_vec3 lo, struct lw_vec3 hi,
                    bool inwards) {
    static const uint32_t quads[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                         {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    struct lw_vec3 *position = lw_scene_alloc(scene, 8, sizeof *position),
                   *normal = lw_scene_alloc(scene, 8, sizeof *normal);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, 12, sizeof *triangle);
    uint32_t *material = lw_scene_alloc(scene, 12, sizeof *material);
    assert_true(position && normal && triangle && material);
    for (uint32_t i = 0; i < 8; i++) {
        position[i] = lw_vec3(i & 1 ? hi.x : lo.x, i & 2 ? hi.y : lo.y, i & 4 ? hi.z : lo.z);
        normal[i] = lw_vec3(0, 1, 0);
    }
    for (uint32_t q = 0; q < 6; q++)
        for (uint32_t t = 0; t < 2; t++) {
            uint32_t a = quads[q][0], b = quads[q][t + 1], c = quads[q][t + 2];
            triangle[2 * q + t][0] = a;
            triangle[2 * q + t][1] = inwards ? c : b;
            triangle[2 * q + t][2] = inwards ? b : c;
            material[2 * q + t] = 0;
        }
    *mesh = (struct lw_mesh){.name = "box",
                             .vertex_count = 8,
                             .triangle_count = 12,
                             .position = position,
                             .normal = normal,
                             .triangle = triangle,
                             .material = material};
}

static void hall_init(struct hall *hall, struct lw_vec3 lo, struct lw_vec3 hi) {
    struct lw_error err = {0};
    lw_support_ok(lw_scene_create(&hall->scene), NULL);
    struct lw_scene *scene = hall->scene;
    scene->name = "hall";
    scene->mesh_count = scene->object_count = scene->node_count = 2;
    scene->material_count = 1;
    scene->mesh = lw_scene_alloc(scene, 2, sizeof *scene->mesh);
    scene->object = lw_scene_alloc(scene, 2, sizeof *scene->object);
    scene->node = lw_scene_alloc(scene, 2, sizeof *scene->node);
    scene->material = lw_scene_alloc(scene, 1, sizeof *scene->material);
    assert_true(scene->mesh && scene->object && scene->node && scene->material);
    add_box(&scene->mesh[0], scene, lw_vec3(-2, -2, -2), lw_vec3(2, 2, 2), true);
    add_box(&scene->mesh[1], scene, lo, hi, false);
    scene->material[0] = (struct lw_material){
        .name = "grey",
        .base_colour = {0.5f, 0.5f, 0.5f, 1},
        .base_colour_texture = {.texture = LW_SCENE_NONE, .transform = {1, 0, 0, 0, 1, 0}},
        .emission_texture = {.texture = LW_SCENE_NONE, .transform = {1, 0, 0, 0, 1, 0}}};
    for (uint32_t i = 0; i < 2; i++) {
        scene->object[i] = (struct lw_object){.name = "box", .mesh = i, .node = i};
        scene->node[i] = (struct lw_node){
            .name = "", .parent = LW_SCENE_NONE, .rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}};
    }
    lw_support_ok(lw_pose_init(&hall->pose, scene), NULL);
    lw_support_ok(lw_trace_create(scene, &hall->pose, &hall->trace, &err), &err);
}

static void hall_finish(struct hall *hall) {
    lw_trace_destroy(hall->trace);
    lw_pose_finish(&hall->pose);
    lw_scene_destroy(hall->scene);
}

static void probes_init(struct lw_probes *probes, const struct hall *hall, float spacing_m) {
    lw_support_ok(lw_probes_init(probes, &(struct lw_probes_desc){.scene = hall->scene,
                                                                  .minimum_ws = lw_vec3(-2, -2, -2),
                                                                  .maximum_ws = lw_vec3(2, 2, 2),
                                                                  .spacing_m = spacing_m,
                                                                  .bounces = 1,
                                                                  .seed = 1}),
                  NULL);
    lw_probes_place(probes, &hall->pose, hall->trace, 2);
}

static uint32_t probe_at(const struct lw_probes *probes, float x, float y, float z) {
    return lw_cells_at(&probes->grid, lw_vec3(x, y, z));
}

static void test_probes_leave_geometry(void **state) {
    (void)state;
    /* The middle of the box [0,1]^3 is inside the block, half of the box is not. */
    struct hall hall;
    hall_init(&hall, lw_vec3(-0.1f, -1.9f, -0.1f), lw_vec3(0.6f, 1.9f, 1.9f));
    struct lw_probes probes;
    probes_init(&probes, &hall, 1);
    assert_int_equal(probes.count, 64);
    const struct lw_probe *moved = &probes.probe[probe_at(&probes, 0.5f, 0.5f, 0.5f)];
    assert_false(moved->dead);
    assert_true(moved->position_ws.x > 0.6f && moved->position_ws.x < 1);
    /* Undisturbed ones stay in the middle. */
    const struct lw_probe *free_one = &probes.probe[probe_at(&probes, -1.5f, 0.5f, 0.5f)];
    assert_true(free_one->position_ws.x < -1.49f && free_one->position_ws.x > -1.51f);
    lw_probes_finish(&probes);
    hall_finish(&hall);
}

static void test_probes_with_nowhere_to_go_are_dead(void **state) {
    (void)state;
    struct hall hall;
    hall_init(&hall, lw_vec3(-0.01f, -0.01f, -0.01f), lw_vec3(1.01f, 1.01f, 1.01f));
    struct lw_probes probes;
    probes_init(&probes, &hall, 1);
    const uint32_t inside = probe_at(&probes, 0.5f, 0.5f, 0.5f);
    assert_true(probes.probe[inside].dead);
    assert_int_equal(probes.alive, probes.count - 1);
    assert_true(lw_probes_visibility(&probes, inside, lw_vec3(0.5f, 0.5f, 0.5f)) == 0);
    /* Deep inside the block nobody answers; beside it, never the dead one. */
    for (uint32_t i = 0; i < 200; i++) {
        uint32_t end = lw_probes_ask(&probes, lw_vec3(-0.3f, 0.5f, 0.5f), direction(i), lw_random_hash(i));
        assert_true(end == LW_PROBES_UNSEEN || lw_ray_hit_probe(end) != inside);
        assert_int_equal(lw_probes_ask(&probes, lw_vec3(0.5f, 0.5f, 0.5f), direction(i), lw_random_hash(i)),
                         LW_PROBES_UNSEEN);
    }
    lw_probes_finish(&probes);
    hall_finish(&hall);
}

static void test_visibility_ends_at_walls(void **state) {
    (void)state;
    struct hall hall; /* a wall of 20 cm across the hall */
    hall_init(&hall, lw_vec3(-0.1f, -1.99f, -1.99f), lw_vec3(0.1f, 1.99f, 1.99f));
    struct lw_probes probes;
    probes_init(&probes, &hall, 1);
    const uint32_t p = probe_at(&probes, -0.5f, 0.5f, 0.5f); /* 0.4 m before the wall */
    assert_true(lw_probes_visibility(&probes, p, lw_vec3(-0.2f, 0.5f, 0.5f)) > 0.9f);
    assert_true(lw_probes_visibility(&probes, p, lw_vec3(-1.3f, 0.7f, 0.2f)) > 0.9f);
    assert_true(lw_probes_visibility(&probes, p, lw_vec3(0.2f, 0.5f, 0.5f)) < 0.02f);
    assert_true(lw_probes_visibility(&probes, p, lw_vec3(0.3f, 0.7f, 0.3f)) < 0.02f);
    /* So a point close behind it hears of no probe before it. */
    for (uint32_t i = 0; i < 2000; i++) {
        uint32_t end =
            lw_probes_ask(&probes, lw_vec3(0.3f, 0.6f, 0.4f), direction(i % DIRECTIONS), lw_random_hash(i));
        if (end != LW_PROBES_UNSEEN) assert_true(probes.probe[lw_ray_hit_probe(end)].position_ws.x > 0);
    }
    lw_probes_finish(&probes);
    hall_finish(&hall);
}

/* Who answers sees what the ray hits: not the floor beyond a low wall that stands in the ray's way, which
 * lies in the same direction. */
static void test_who_answers_sees_the_end(void **state) {
    (void)state;
    struct hall hall; /* a wall across the hall, up to half its height */
    hall_init(&hall, lw_vec3(-0.1f, -1.99f, -1.99f), lw_vec3(0.1f, 0, 1.99f));
    struct lw_probes probes;
    probes_init(&probes, &hall, 1);
    uint32_t answered = 0, wrong = 0;
    for (uint32_t i = 0; i < 16 * 1024; i += LW_TRACE_WIDTH) {
        struct lw_ray16 rays = {.salt = 0};
        struct lw_hit16 hits;
        struct lw_vec3 from[LW_TRACE_WIDTH], d[LW_TRACE_WIDTH];
        for (uint32_t r = 0; r < LW_TRACE_WIDTH; r++) {
            float point[2];
            lw_random_sobol2(i + r, 5, point);
            from[r] = lw_vec3(-1.5f + 1.3f * point[0], -0.5f + 1.5f * point[1], 0.3f);
            d[r] = direction(lw_random_hash(i + r) % DIRECTIONS);
            lw_trace_set_ray(&rays, r, from[r], d[r], INFINITY);
        }
        lw_trace_closest16(hall.trace, LW_TRACE_LIGHT, UINT16_MAX, &rays, &hits);
        for (uint32_t r = 0; r < LW_TRACE_WIDTH; r++) {
            uint32_t end = lw_probes_ask(&probes, from[r], d[r], lw_random_hash(i + r));
            if (end == LW_PROBES_UNSEEN) continue;
            struct lw_vec3 hit = lw_vec3_mad(from[r], d[r], hits.t[r]);
            struct lw_vec3 seen = lw_vec3_sub(hit, probes.probe[lw_ray_hit_probe(end)].position_ws);
            answered++;
            wrong += lw_vec3_dot(lw_vec3_normalize(seen), lw_ray_hit_direction(end)) < 0.92f; /* two cells */
        }
    }
    assert_true(answered > 2000);
    assert_true(wrong < answered / 200);
    lw_probes_finish(&probes);
    hall_finish(&hall);
}

static void test_probes_follow_what_moves(void **state) {
    (void)state;
    struct hall hall;
    hall_init(&hall, lw_vec3(-0.01f, -0.01f, -0.01f), lw_vec3(1.01f, 1.01f, 1.01f));
    struct lw_probes probes;
    struct lw_error err = {0};
    probes_init(&probes, &hall, 1);
    const uint32_t left = probe_at(&probes, 0.5f, 0.5f, 0.5f), entered = probe_at(&probes, -0.5f, 0.5f, 0.5f);
    hall.pose.object_to_world[1].m[0][3] = -1;
    /* A static scene is one structure: build it again where the block is now. */
    lw_trace_destroy(hall.trace);
    lw_support_ok(lw_trace_create(hall.scene, &hall.pose, &hall.trace, &err), &err);
    uint64_t rays = lw_probes_place(&probes, &hall.pose, hall.trace, 2);
    assert_true(rays > 0);
    assert_false(probes.probe[left].dead);
    assert_int_equal(probes.probe[left].age, 0);
    assert_true(probes.probe[entered].dead);
    assert_int_equal(lw_probes_place(&probes, &hall.pose, hall.trace, 2), 0);
    /* Hidden, it is no longer about them; shown, it is. */
    for (int shown = 0; shown < 2; shown++) {
        hall.pose.object_hidden[1] = !shown;
        hall.pose.object_dynamic[1] = true;
        lw_support_ok(lw_trace_set_pose(hall.trace, &hall.pose, &err), &err);
        assert_true(lw_probes_place(&probes, &hall.pose, hall.trace, 2) > 0);
        assert_int_equal(probes.probe[entered].dead, shown);
        assert_int_equal(lw_probes_place(&probes, &hall.pose, hall.trace, 2), 0);
    }
    lw_probes_finish(&probes);
    hall_finish(&hall);
}

static void test_many_probes_are_bounded(void **state) {
    (void)state;
    struct hall hall;
    hall_init(&hall, lw_vec3(0, 0, 0), lw_vec3(1, 1, 1));
    struct lw_probes probes;
    lw_support_ok(lw_probes_init(&probes, &(struct lw_probes_desc){.scene = hall.scene,
                                                                   .minimum_ws = lw_vec3(-2, -2, -2),
                                                                   .maximum_ws = lw_vec3(2, 2, 2),
                                                                   .spacing_m = 1e-6f,
                                                                   .bounces = 1}),
                  NULL);
    assert_true(probes.count <= LW_PROBES_MAX && probes.count > LW_PROBES_MAX / 2);
    lw_probes_finish(&probes);
    hall_finish(&hall);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_octahedral_round_trip),
        cmocka_unit_test(test_octahedral_read_is_continuous),
        cmocka_unit_test(test_cube_round_trip),
        cmocka_unit_test(test_cube_read_is_continuous),
        cmocka_unit_test(test_forms_return_smooth_light),
        cmocka_unit_test(test_forms_neither_ring_nor_gain),
        cmocka_unit_test(test_map_without_rays_takes_its_neighbours),
        cmocka_unit_test(test_probes_leave_geometry),
        cmocka_unit_test(test_probes_with_nowhere_to_go_are_dead),
        cmocka_unit_test(test_visibility_ends_at_walls),
        cmocka_unit_test(test_who_answers_sees_the_end),
        cmocka_unit_test(test_probes_follow_what_moves),
        cmocka_unit_test(test_many_probes_are_bounded),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
