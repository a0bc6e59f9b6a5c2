/* Seams: walks every seam of a scene and reads both sides as the viewer does. */
#include "tests/reference/room.h"

#include "common/builtin/builtin.h"
#include "common/open/scene_open.h"
#include "tests/support/seam_walk.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void print_spread(const char *name, const char *when, unsigned level, const struct seam_spread *s) {
    printf("%-12s level %u %-8s %8zu points: mean %.4f median %.4f 99%% %.4f 99.9%% %.4f worst %.4f, within "
           "1 %%: %.1f %%\n",
           name, level, when, s->points, s->mean, s->p50, s->p99, s->p999, s->worst, 100 * (1 - s->over));
}

static void expect_welded(const char *name, struct lw_scene *scene, float density, uint32_t samples,
                          unsigned frames, double mean_most, double over_most, double worst_most,
                          const double coarse_most[2], size_t points_min) {
    struct room_solution solution;
    room_solve_scene(
        &solution, scene, density,
        (struct lw_solver_desc){.bounces = 2, .direct_samples = samples, .indirect_samples = 2 * samples},
        frames);
    struct lw_seam_edges edges;
    lw_support_ok(lw_seam_edges_find(scene, &solution.pose, &edges), NULL);
    struct seam_walk before, after;
    lw_support_ok(seam_walk_init(&before, scene, &solution.map, solution.solver, SEAM_WALK_SEWN), NULL);
    lw_support_ok(seam_walk_init(&after, scene, &solution.map, solution.solver, SEAM_WALK_WELDED), NULL);
    double change, worst;
    seam_walk_mean_change(&solution.map, solution.solver, &change, &worst);
    printf("%-12s mean light changes by %.5f, that of an object by up to %.5f\n", name, change, worst);
    for (unsigned level = 0; level < 3; level++) {
        struct seam_spread b, a;
        lw_support_ok(seam_walk_measure(&before, &edges, level, LW_SCENE_NONE, &b), NULL);
        lw_support_ok(seam_walk_measure(&after, &edges, level, LW_SCENE_NONE, &a), NULL);
        print_spread(name, "sewn", level, &b);
        print_spread(name, "welded", level, &a);
        if (level > 0) {
            assert_true(a.mean < coarse_most[level - 1]);
            continue;
        }
        assert_true(a.points >= points_min);
        /* Frames go on from each other's corrections: these few leave a rest, which more frames take away. */
        assert_true(a.worst <= worst_most);
        assert_true(a.mean < mean_most && a.mean < 0.4 * b.mean && a.p50 < 0.005);
        assert_true(a.over < over_most);
    }
    assert_true(fabs(change) < 0.001 && worst < 0.005);
    seam_walk_finish(&before);
    seam_walk_finish(&after);
    lw_seam_edges_finish(&edges);
    room_finish(&solution);
}

/* Where light varies over texels but has no edge between two of them, every point of every seam agrees within
 * 1 %. */
static void test_ball(void **state) {
    (void)state;
    struct room room = {.sky = 0.3f};
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0), 0.7f, 0); /* becomes the ball */
    room_quad(&room, lw_vec3(-2, 0, -2), lw_vec3(0, 0, 4), lw_vec3(4, 0, 0), 0.7f, 0);
    room_quad(&room, lw_vec3(-0.5f, 2.5f, -0.5f), lw_vec3(1, 0, 0), lw_vec3(0, 0, 1), 0, 5); /* facing down */
    struct lw_scene *scene = room_scene(&room);
    room_make_ball(scene, 0, lw_vec3(0, 0.7f, 0), 0.5f);
    expect_welded("ball", scene, 16, 8, 32, 0.002, 1e-9, 0.01, (const double[]){0.02, 0.045}, 1000);
}

/* Solves a ball until all of it has converged; each frame of the whole as `parts`
 * frames of every parts-th tile. */
static void solve_ball_in_parts(struct room_solution *s, uint32_t parts) {
    struct room room = {.sky = 0.3f};
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0), 0.7f, 0); /* becomes the ball */
    room_quad(&room, lw_vec3(-0.5f, 2.5f, -0.5f), lw_vec3(1, 0, 0), lw_vec3(0, 0, 1), 0, 5);
    struct lw_scene *scene = room_scene(&room);
    room_make_ball(scene, 0, lw_vec3(0, 0.7f, 0), 0.5f);
    room_solve_scene(
        s, scene, 64,
        (struct lw_solver_desc){.direct_samples = 4, .denoise = true, .target_error = -1, .frames_max = 24},
        1);
    uint8_t *wanted = malloc(s->map.tile_count);
    assert_non_null(wanted);
    for (uint64_t frame = 2; s->stats.tiles_converged < s->stats.tiles; frame++) {
        assert_true(frame < 1000);
        for (uint32_t id = 0; id < s->map.tile_count; id++)
            wanted[id] = s->map.place[id].level == 0 && id % parts == frame % parts;
        lw_support_ok(s->solver->ops->set_interest(s->solver, wanted, NULL), NULL);
        room_frame(s, frame);
    }
    free(wanted);
}

/* Seams between what a frame solves and what it does not agree as well, and on the same light. */
static void test_parts_of_a_frame(void **state) {
    (void)state;
    struct room_solution whole, parts;
    solve_ball_in_parts(&whole, 1);
    solve_ball_in_parts(&parts, 5);
    assert_true(whole.map.atlas[0]->tile_count >= 10);
    double off = 0, welded = 0, square = 0;
    for (uint32_t id = 0; id < whole.map.tile_count; id++) {
        if (whole.map.place[id].level) continue;
        struct lw_solver_tile x, y;
        whole.solver->ops->read_tile(whole.solver, (lw_tile_id){id}, &x);
        parts.solver->ops->read_tile(parts.solver, (lw_tile_id){id}, &y);
        for (uint32_t i = 0; i < x.width * x.height; i++) {
            if (!x.covered[i]) continue;
            const double a = (double)x.shown[LW_TILE_CHANNEL_FULL][0][i],
                         b = (double)y.shown[LW_TILE_CHANNEL_FULL][0][i],
                         sum = (double)x.direct[0][i] + (double)x.indirect[0][i];
            off = fmax(off, fabs(a - b) / (a + 0.01));
            square += (a - b) * (a - b);
            welded += (a - sum) * (a - sum);
        }
    }
    struct lw_seam_edges edges;
    struct seam_walk walk;
    struct seam_spread spread;
    lw_support_ok(lw_seam_edges_find(parts.scene, &parts.pose, &edges), NULL);
    lw_support_ok(seam_walk_init(&walk, parts.scene, &parts.map, parts.solver, SEAM_WALK_WELDED), NULL);
    lw_support_ok(seam_walk_measure(&walk, &edges, 0, LW_SCENE_NONE, &spread), NULL);
    print_spread("ball in parts", "welded", 0, &spread);
    printf("shown otherwise than as a whole by up to %.2g, in square %.2g of what is changed\n", off,
           square / welded);
    assert_true(spread.points > 1000 && spread.worst <= 0.01);
    assert_true(off < 0.01 && square < 1e-3 * welded);
    seam_walk_finish(&walk);
    lw_seam_edges_finish(&edges);
    room_finish(&parts);
    room_finish(&whole);
}

#define SLATS 24u

/* Slats under a sun, every other one facing down, in place of quad `q`. */
static void make_slats(struct lw_scene *scene, uint32_t q) {
    const uint32_t vertices = 4 * SLATS, triangles = 2 * SLATS;
    struct lw_vec3 *position = lw_scene_alloc(scene, vertices, sizeof *position),
                   *normal = lw_scene_alloc(scene, vertices, sizeof *normal);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, triangles, sizeof *triangle);
    uint32_t *material = lw_scene_alloc(scene, triangles, sizeof *material);
    assert_true(position && normal && triangle && material);
    for (uint32_t i = 0; i < SLATS; i++) {
        const bool down = i & 1;
        const float x = (float)i, width = 0.1f + 0.03f * (float)i; /* 0.4 to 3.2 texels */
        for (uint32_t k = 0; k < 4; k++) {
            position[4 * i + k] = lw_vec3(x + (k & 1 ? width : 0), 0, k & 2 ? 5 : 0);
            normal[4 * i + k] = lw_vec3(0, down ? -1 : 1, 0);
        }
        const uint32_t a = 4 * i, b = a + 1, c = a + 2, d = a + 3;
        memcpy(triangle[2 * i], down ? (const uint32_t[3]){a, b, c} : (const uint32_t[3]){a, c, b},
               sizeof *triangle);
        memcpy(triangle[2 * i + 1], down ? (const uint32_t[3]){b, d, c} : (const uint32_t[3]){b, c, d},
               sizeof *triangle);
        material[2 * i] = material[2 * i + 1] = scene->mesh[q].material[0];
    }
    scene->mesh[q] = (struct lw_mesh){.name = "slats",
                                      .vertex_count = vertices,
                                      .triangle_count = triangles,
                                      .position = position,
                                      .normal = normal,
                                      .triangle = triangle,
                                      .material = material};
}

/* Slivers lie a texel apart in the atlas: look-ups of one give its own light to the very edge. */
static void test_slats(void **state) {
    (void)state;
    struct room room = {0};
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0), 0.5f, 0); /* becomes the slats */
    room.light[room.light_count++] = (struct lw_light){.kind = LW_LIGHT_DIRECTIONAL, .intensity = {1, 1, 1}};
    struct lw_scene *scene = room_scene(&room);
    make_slats(scene, 0);
    struct room_solution solution;
    room_solve_scene(&solution, scene, 4, (struct lw_solver_desc){.direct_samples = 1}, 2);
    struct seam_walk walk;
    lw_support_ok(seam_walk_init(&walk, scene, &solution.map, solution.solver, SEAM_WALK_WELDED), NULL);
    const struct lw_mesh *mesh = &scene->mesh[0];
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        for (unsigned i = 0; i <= 16; i++)
            for (unsigned j = 0; i + j <= 16; j++) {
                struct lw_surface at;
                double got;
                lw_scene_surface(scene, mesh, t, (float)i / 16, (float)j / 16, &at);
                assert_true(
                    seam_walk_read(&walk, 0, 0, (double)at.lightmap_uv.x, (double)at.lightmap_uv.y, &got));
                if (fabs(got - (at.normal.y > 0)) > 1e-4)
                    fail_msg("triangle %u at %u, %u: read %g, facing %g", t, i, j, got, (double)at.normal.y);
            }
    seam_walk_finish(&walk);
    room_finish(&solution);
}

/* ---- T-junctions ---- */

#define CUT   1.7f /* x at which one of two strips of floor is cut into two */
#define ABUT  2.0f /* z at which the strips meet */
#define LONG  4.0f
#define WIDTH 4.0f

/* One long strip of floor beside two short ones: as three objects, or as one mesh. */
static struct lw_scene *make_floor(bool one_mesh) {
    struct room room = {.sky = 0.1f};
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, ABUT), lw_vec3(LONG, 0, 0), 0.5f, 0);
    room_quad(&room, lw_vec3(0, 0, ABUT), lw_vec3(0, 0, WIDTH - ABUT), lw_vec3(CUT, 0, 0), 0.5f, 0);
    room_quad(&room, lw_vec3(CUT, 0, ABUT), lw_vec3(0, 0, WIDTH - ABUT), lw_vec3(LONG - CUT, 0, 0), 0.5f, 0);
    room_quad(&room, lw_vec3(1.2f, 1.2f, 1.6f), lw_vec3(0.8f, 0, 0), lw_vec3(0, 0, 0.8f), 0,
              9); /* faces down */
    struct lw_scene *scene = room_scene(&room);
    if (!one_mesh) return scene;
    struct lw_mesh *whole = &scene->mesh[0];
    struct lw_vec3 *position = lw_scene_alloc(scene, 12, sizeof *position),
                   *normal = lw_scene_alloc(scene, 12, sizeof *normal);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, 6, sizeof *triangle);
    uint32_t *material = lw_scene_alloc(scene, 6, sizeof *material);
    assert_true(position && normal && triangle && material);
    for (uint32_t q = 0; q < 3; q++) {
        const struct lw_mesh *quad = &scene->mesh[q];
        memcpy(position + 4 * q, quad->position, 4 * sizeof *position);
        memcpy(normal + 4 * q, quad->normal, 4 * sizeof *normal);
        for (uint32_t t = 0; t < 2; t++) {
            for (int c = 0; c < 3; c++) triangle[2 * q + t][c] = 4 * q + quad->triangle[t][c];
            material[2 * q + t] = whole->material[0];
        }
    }
    *whole = (struct lw_mesh){.name = "floor",
                              .vertex_count = 12,
                              .triangle_count = 6,
                              .position = position,
                              .normal = normal,
                              .triangle = triangle,
                              .material = material};
    return scene;
}

/* Reads the floor at x where the strips meet, from the long one or from the short ones. */
static double read_floor(const struct seam_walk *walk, const struct lw_scene *scene, bool one_mesh,
                         bool from_long, float x) {
    for (uint32_t o = 0; o < (one_mesh ? 1u : 3u); o++)
        for (uint32_t t = 0; t < scene->mesh[o].triangle_count; t++) {
            const struct lw_mesh *mesh = &scene->mesh[o];
            const uint32_t *v = mesh->triangle[t];
            const struct lw_vec3 a = mesh->position[v[0]], b = lw_vec3_sub(mesh->position[v[1]], a),
                                 c = lw_vec3_sub(mesh->position[v[2]], a);
            const float area = b.x * c.z - b.z * c.x, dx = x - a.x, dz = ABUT - a.z;
            const float bu = (dx * c.z - dz * c.x) / area, bv = (b.x * dz - b.z * dx) / area;
            if ((3 * a.z + b.z + c.z < 3 * ABUT) != from_long || bu < -1e-6f || bv < -1e-6f ||
                bu + bv > 1 + 1e-6f)
                continue;
            struct lw_surface at;
            double out;
            lw_scene_surface(scene, mesh, t, bu, bv, &at);
            assert_true(seam_walk_read(walk, o, 0, (double)at.lightmap_uv.x, (double)at.lightmap_uv.y, &out));
            return out;
        }
    fail_msg("no floor at x = %g", (double)x);
    return 0;
}

/* How far the strips differ at worst along the line where they meet. */
static double read_junction(const struct room_solution *solution, bool one_mesh, enum seam_walk_light light) {
    struct seam_walk walk;
    lw_support_ok(seam_walk_init(&walk, solution->scene, &solution->map, solution->solver, light), NULL);
    double worst = 0;
    for (float x = 0.01f; x < LONG; x += 0.02f) {
        const double a = read_floor(&walk, solution->scene, one_mesh, true, x),
                     b = read_floor(&walk, solution->scene, one_mesh, false, x);
        worst = fmax(worst, fabs(a - b) / (0.5 * (a + b)));
    }
    seam_walk_finish(&walk);
    return worst;
}

/* A surface that goes on over a T-junction is welded along it, in a mesh and between objects. */
static void test_t_junction(void **state) {
    (void)state;
    for (int one_mesh = 0; one_mesh < 2; one_mesh++) {
        struct room_solution solution;
        room_solve_scene(&solution, make_floor(one_mesh), 7,
                         (struct lw_solver_desc){.bounces = 1, .direct_samples = 8, .indirect_samples = 8},
                         24);
        const double before = read_junction(&solution, one_mesh, SEAM_WALK_SEWN),
                     after = read_junction(&solution, one_mesh, SEAM_WALK_WELDED);
        printf("T-junction in %s: worst %.4f, unwelded %.4f\n", one_mesh ? "a mesh" : "the world", after,
               before);
        assert_true(before > 0.01); /* else there is nothing to weld */
        assert_true(after < 0.005);
        room_finish(&solution);
    }
}

/* Seams of two quads with edges of 2 m along x = 1, one moved along that line and turned about it, or lying
 * on the first. */
static size_t count_seams(float by, float apart_m, float angle, bool folded) {
    struct room room = {0};
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 2), lw_vec3(1, 0, 0), 0.5f, 0);
    if (folded)
        room_quad(&room, lw_vec3(0.5f, 0, by), lw_vec3(0, 0, 2), lw_vec3(0.5f, 0, 0), 0.5f, 0);
    else
        room_quad(&room, lw_vec3(1 + apart_m, 0, by), lw_vec3(0, 0, 2), lw_vec3(cosf(angle), sinf(angle), 0),
                  0.5f, 0);
    struct room_solution solution;
    room_solve_scene(&solution, room_scene(&room), 4, (struct lw_solver_desc){.direct_samples = 1}, 1);
    struct lw_seam_edges edges;
    lw_support_ok(lw_seam_edges_find(solution.scene, &solution.pose, &edges), NULL);
    const size_t count = edges.count;
    for (size_t e = 0; e < count; e++)
        for (int side = 0; side < 2; side++) {
            const struct lw_vec2 from = edges.edge[e].from[side], to = edges.edge[e].to[side];
            expect_near(hypot((double)(to.x - from.x), (double)(to.y - from.y)), 4 * (2 - (double)by), 0.15);
        }
    lw_seam_edges_finish(&edges);
    room_finish(&solution);
    return count;
}

static void test_what_is_a_seam(void **state) {
    (void)state;
    assert_int_equal(count_seams(0, 0, 0, false), 1);    /* the whole edge */
    assert_int_equal(count_seams(0.5f, 0, 0, false), 1); /* the part that both have */
    assert_int_equal(count_seams(1.5f, 0, 0, false), 1);
    assert_int_equal(count_seams(2, 0, 0, false), 0);        /* end to end: a corner is no edge */
    assert_int_equal(count_seams(0.5f, 4e-6f, 0, false), 1); /* a rounding apart */
    assert_int_equal(count_seams(0.5f, 1e-3f, 0, false), 0);
    assert_int_equal(count_seams(0.5f, 0, 0.07f, false), 1); /* 4 degrees */
    assert_int_equal(count_seams(0.5f, 0, 0.11f, false), 0); /* 6 degrees */
    assert_int_equal(count_seams(0.5f, 0, 0, true), 0);      /* one upon the next: nothing goes on */
}

static void test_atrium(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:atrium-matt", &scene, &err), &err);
    expect_welded("atrium", scene, 0, 1, 16, 0.0035, 0.06, 2, (const double[]){0.12, 0.17}, 10000);
}

static void test_sponza(void **state) {
    (void)state;
    const char *path = lw_support_scene("sponza/Sponza_lit.gltf");
    struct lw_scene *scene;
    struct lw_error err = {0};
    struct lw_scene_open open = {.path = path, .sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG};
    lw_support_ok(lw_scene_open(&open, &scene, &err), &err);
    expect_welded("Sponza", scene, 0, 1, 16, 0.006, 0.11, 2, (const double[]){0.11, 0.10}, 10000);
}

/* With an argument: the long tests alone. */
int main(int argc, char **argv) {
    const struct CMUnitTest long_tests[] = {
        cmocka_unit_test(test_atrium),
        cmocka_unit_test(test_sponza),
    };
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_slats),
        cmocka_unit_test(test_ball),
        cmocka_unit_test(test_what_is_a_seam),
        cmocka_unit_test(test_t_junction),
        cmocka_unit_test(test_parts_of_a_frame),
    };
    (void)argv;
    if (argc > 1) return cmocka_run_group_tests(long_tests, NULL, NULL);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
