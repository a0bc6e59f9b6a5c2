/* Texels as areas: shadow edges through them, smooth normals on coarse meshes, rooms apart by thin walls at
 * any scale. */
#include "tests/reference/room.h"

#include "common/base/random.h"
#include "server/solve/surface/texels.h"

#include <math.h>
#include <string.h>

#define DENSITY   4  /* texels per metre: coarse, so that edges fall inside texels */
#define BAND_ROWS 64 /* rows of a picture */

/* A floor of 8 m x 8 m under a sun at the zenith and a half plane whose edge runs through (at, 0) at `angle`
 * to Z. */
struct edge {
    double at, sine, cosine;
    double worst, sum, want, area; /* largest error of one texel; means over texels */
};

static double lit(const struct edge *e, double x, double z) {
    return (x - e->at) * e->cosine + z * e->sine > 0 ? 1 : 0;
}

static void compare_with_lit_share(void *user, struct lw_vec3 p, double area, double direct,
                                   double indirect) {
    (void)indirect;
    struct edge *e = user;
    if (area < 0.999) return;
    const int side = 64;
    double share = 0;
    for (int i = 0; i < side; i++)
        for (int j = 0; j < side; j++)
            share += lit(e, (double)p.x + ((i + 0.5) / side - 0.5) / DENSITY,
                         (double)p.z + ((j + 0.5) / side - 0.5) / DENSITY);
    share /= side * side;
    e->worst = fmax(e->worst, fabs(direct - share));
    e->sum += direct;
    e->want += share;
    e->area += 1;
}

static void expect_shadow_edge(double at, double angle) {
    struct room room = {.texels_per_metre = DENSITY};
    struct edge edge = {.at = at, .sine = sin(angle), .cosine = cos(angle)};
    room_quad(&room, lw_vec3(-4, 0, -4), lw_vec3(0, 0, 8), lw_vec3(8, 0, 0), 0.5f, 0);
    /* the half plane behind the edge, facing up; its back must not look as if it buried the floor */
    const struct lw_vec3 along = lw_vec3((float)-edge.sine * 40, 0, (float)edge.cosine * 40),
                         away = lw_vec3((float)-edge.cosine * 40, 0, (float)-edge.sine * 40);
    struct lw_vec3 corner = lw_vec3_mad(lw_vec3((float)at, 3, 0), along, 0.5f);
    room_quad(&room, lw_vec3_add(corner, away), lw_vec3_scale(along, -1), lw_vec3_scale(away, -1), 0, 0);
    room.quad[1].double_sided = true;
    room.light[room.light_count++] = (struct lw_light){.kind = LW_LIGHT_DIRECTIONAL, .intensity = {1, 1, 1}};
    struct room_solution solution;
    room_solve(&solution, &room, (struct lw_solver_desc){.direct_samples = 1}, 16);
    room_each_texel(&solution, 0, compare_with_lit_share, &edge);
    assert_true(edge.area >= 31 * 31);
    /* A straight edge splits the eight places as it splits the square: to 1/16 along an axis, to little over
     * 1/8 aslant. */
    if (edge.worst > (angle == 0 ? 0.07 : 0.16))
        fail_msg("edge at %g, %g rad: a texel is off by %.3f", at, angle, edge.worst);
    expect_near(edge.sum / edge.area, edge.want / edge.area, 0.005);
    room_finish(&solution);
}

static void test_texels_hold_the_lit_share_of_a_shadow_edge(void **state) {
    (void)state;
    const double angle[] = {0, 0.5, 0.7854, 1.5708, 2.6};
    for (unsigned i = 0; i < sizeof angle / sizeof *angle; i++) expect_shadow_edge(0.1 + 0.07 * i, angle[i]);
}

/* Many samples a frame go through the places within the frame. A lamp a hundred metres up is nearly a
 * point; the edge of a plate runs through a row of texels, so high that the floor under it is not close
 * under it. */
static void test_samples_of_one_frame_spread_over_the_texel(void **state) {
    (void)state;
    const float far_m = 100, side_m = 2;
    struct room room = {.texels_per_metre = DENSITY};
    room_quad(&room, lw_vec3(-4, 0, -4), lw_vec3(0, 0, 8), lw_vec3(8, 0, 0), 0.5f, 0);
    room_quad(&room, lw_vec3(0.1f, 0.2f / DENSITY, -4), lw_vec3(0, 0, 8), lw_vec3(8, 0, 0), 0, 0);
    room_quad(&room, lw_vec3(-side_m / 2, far_m, -side_m / 2), lw_vec3(side_m, 0, 0), lw_vec3(0, 0, side_m),
              0, far_m * far_m / (side_m * side_m)); /* E = 1 under it */
    room.quad[1].double_sided = true;
    struct room_solution solution;
    struct edge edge = {.at = 0.1, .cosine = -1};
    room_solve(&solution, &room, (struct lw_solver_desc){.direct_samples = 8}, 1);
    room_each_texel(&solution, 0, compare_with_lit_share, &edge);
    room_finish(&solution);
    assert_true(edge.area >= 32 * 18); /* in the sun, and a row under the plate; deep under it all is dark */
    assert_true(edge.worst < 0.15);    /* a texel of eight places has eighths */
    expect_near(edge.sum, edge.want, 0.01);
}

#define SEGMENTS 16
#define RINGS    8
#define TURN     0.19f

/* A sphere of radius 1 with smooth normals and few faces. */
static struct lw_scene *coarse_sphere(void) {
    struct lw_scene *scene;
    lw_support_ok(lw_scene_create(&scene), NULL);
    scene->name = "sphere";
    scene->mesh_count = scene->material_count = scene->object_count = scene->light_count = 1;
    scene->node_count = 2;
    scene->mesh = lw_scene_alloc(scene, 1, sizeof *scene->mesh);
    scene->material = lw_scene_alloc(scene, 1, sizeof *scene->material);
    scene->object = lw_scene_alloc(scene, 1, sizeof *scene->object);
    scene->node = lw_scene_alloc(scene, 2, sizeof *scene->node);
    scene->light = lw_scene_alloc(scene, 1, sizeof *scene->light);
    struct lw_vec3 *position = lw_scene_alloc(scene, (RINGS + 1) * SEGMENTS, sizeof *position);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, 2 * SEGMENTS * (RINGS - 1), sizeof *triangle);
    uint32_t *material = lw_scene_alloc(scene, 2 * SEGMENTS * (RINGS - 1), sizeof *material), n = 0;
    assert_true(position && triangle && material);
    for (uint32_t r = 0; r <= RINGS; r++)
        for (uint32_t s = 0; s < SEGMENTS; s++) {
            double polar = acos(-1.0) * r / RINGS, around = 2 * acos(-1.0) * s / SEGMENTS;
            position[r * SEGMENTS + s] = lw_vec3((float)(sin(polar) * cos(around)), (float)cos(polar),
                                                 (float)(-sin(polar) * sin(around)));
        }
    for (uint32_t r = 0; r < RINGS; r++)
        for (uint32_t s = 0; s < SEGMENTS; s++) {
            uint32_t a = r * SEGMENTS + s, b = r * SEGMENTS + (s + 1) % SEGMENTS;
            if (r < RINGS - 1)
                memcpy(triangle[n++], (uint32_t[3]){a, a + SEGMENTS, b + SEGMENTS}, sizeof *triangle);
            if (r > 0) memcpy(triangle[n++], (uint32_t[3]){a, b + SEGMENTS, b}, sizeof *triangle);
        }
    scene->mesh[0] = (struct lw_mesh){.name = "sphere",
                                      .vertex_count = (RINGS + 1) * SEGMENTS,
                                      .triangle_count = n,
                                      .position = position,
                                      .normal = position,
                                      .triangle = triangle,
                                      .material = material};
    scene->material[0] = (struct lw_material){
        .name = "grey",
        .base_colour = {0.5f, 0.5f, 0.5f, 1},
        .base_colour_texture = {.texture = LW_SCENE_NONE, .transform = {1, 0, 0, 0, 1, 0}},
        .emission_texture = {.texture = LW_SCENE_NONE, .transform = {1, 0, 0, 0, 1, 0}}};
    scene->object[0] = (struct lw_object){.name = "sphere"};
    for (int i = 0; i < 2; i++)
        scene->node[i] = (struct lw_node){
            .name = "", .parent = LW_SCENE_NONE, .rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}};
    /* a sun along -Z, turned so that its terminator runs through the middle of faces */
    scene->node[1].rotation[1] = sinf(0.5f * TURN);
    scene->node[1].rotation[3] = cosf(0.5f * TURN);
    scene->light[0] =
        (struct lw_light){.name = "sun", .node = 1, .kind = LW_LIGHT_DIRECTIONAL, .intensity = {1, 1, 1}};
    return scene;
}

/* Every texel of the sphere gets the cosine of its shading normals with the sun: nothing is in the sun's way
 * but the face itself, whose edges a smooth normal denies. */
static void test_a_coarse_sphere_shades_smoothly(void **state) {
    (void)state;
    struct room_solution solution;
    struct lw_scene *scene = coarse_sphere();
    room_solve_scene(&solution, scene, 16, (struct lw_solver_desc){.direct_samples = 1}, 32);
    struct lw_error err = {0};
    struct lw_texels texels;
    lw_support_ok(lw_texels_init(&texels, scene, 1, NULL, NULL, &err), &err);
    const struct lw_mesh_texels *mesh = &texels.mesh[0];
    unsigned lit_texels = 0, near_terminator = 0;
    double sum = 0, want_sum = 0;
    for (uint32_t t = 0;
         t < solution.map.atlas[0]->level[0].tiles_x * solution.map.atlas[0]->level[0].tiles_y; t++) {
        struct lw_solver_tile tile;
        solution.solver->ops->read_tile(solution.solver, (lw_tile_id){t}, &tile);
        const uint32_t start = lw_texels_tile_start(mesh, t % solution.map.atlas[0]->level[0].tiles_x,
                                                    t / solution.map.atlas[0]->level[0].tiles_x);
        for (uint32_t i = 0; i < tile.width * tile.height; i++) {
            if (!tile.covered[i]) continue;
            const struct lw_vec3 n = lw_packed_normal_unpack(mesh->normal[start + i]);
            const double cosine = (double)(n.z * cosf(TURN) + n.x * sinf(TURN));
            /* a texel spans 0.06 rad and its normals the more; the mean of the clamped cosine lies off the
             * middle's */
            if (fabs((double)tile.direct[0][i] - fmax(0, cosine)) > 0.05)
                fail_msg("cosine %.3f, E %.3f", cosine, (double)tile.direct[0][i]);
            sum += (double)tile.direct[0][i];
            want_sum += fmax(0, cosine);
            lit_texels += cosine > 0.05;
            near_terminator += cosine > 0.05 && cosine < 0.3;
        }
    }
    assert_true(lit_texels > 500 && near_terminator > 100);
    expect_near(sum, want_sum, 0.01);
    lw_texels_finish(&texels);
    room_finish(&solution);
}

/* Two rooms in one shell, apart by a wall; one is lit. The walls are of two faces, `thick` apart. */
static double leak(double scale, struct lw_vec3 offset, double thick) {
    struct room room = {.texels_per_metre = (float)(6 / scale)};
    const float s = (float)scale, t = (float)(0.5 * thick * scale);
    const struct lw_vec3 x = lw_vec3(4 * s, 0, 0), y = lw_vec3(0, 2 * s, 0), z = lw_vec3(0, 0, 2 * s),
                         o = offset;
    room_quad(&room, o, z, x, 0.7f, 0);                 /* floor of both */
    room_quad(&room, lw_vec3_add(o, y), x, z, 0.7f, 0); /* ceiling of both */
    room_quad(&room, o, x, y, 0.7f, 0);                 /* z = 0, facing +Z */
    room_quad(&room, lw_vec3_add(o, z), y, x, 0.7f, 0);
    room_quad(&room, o, y, z, 0.7f, 0); /* x = 0, facing +X */
    room_quad(&room, lw_vec3_add(o, x), z, y, 0.7f, 0);
    const struct lw_vec3 left = lw_vec3_add(o, lw_vec3(2 * s - t, 0, 0)),
                         right = lw_vec3_add(o, lw_vec3(2 * s + t, 0, 0));
    room_quad(&room, left, z, y, 0.7f, 0);  /* facing -X */
    room_quad(&room, right, y, z, 0.7f, 0); /* facing +X */
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {s * s, s * s, s * s}};
    room.light_position[0] = lw_vec3_add(o, lw_vec3(s, 1.5f * s, s));
    room.light_count = 1;
    struct room_solution solution;
    room_solve(&solution, &room, (struct lw_solver_desc){.bounces = 3, .indirect_samples = 4}, 16);
    const double lit_side = room_object_mean(&solution, 4).total,
                 dark_side = room_object_mean(&solution, 5).total,
                 wall = room_object_mean(&solution, 7).total,
                 brightest = room_object_mean(&solution, 6).total;
    room_finish(&solution);
    assert_true(lit_side > 0.1 && brightest > 0.1);
    return fmax(dark_side, wall) / lit_side;
}

static void test_no_light_leaks_between_two_rooms(void **state) {
    (void)state;
    const struct {
        double scale, offset, thick;
    } cases[] = {{1, 0, 0.1},     {1, 0, 1e-3},  {1e-3, 0, 0.1}, {1e-3, 1, 0.1}, {1e5, 0, 0.1},
                 {1e5, 1e5, 0.1}, {1, 1e4, 0.1}, {1, 1e5, 0.2},  {1, 10, 0},     {1e3, 0, 1e-5}};
    for (unsigned i = 0; i < sizeof cases / sizeof *cases; i++) {
        const float at = (float)cases[i].offset;
        double share = leak(cases[i].scale, lw_vec3(at, 0.7f * at, -at), cases[i].thick);
        if (share > 1e-4)
            fail_msg("scale %g at %g, wall %g: %.2g of the light passes", cases[i].scale, cases[i].offset,
                     cases[i].thick, share);
    }
}

static void count_mixed(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    (void)p, (void)area, (void)indirect;
    unsigned *count = user;
    count[direct < 1 ? 0 : direct > 99 ? 1 : 2]++;
}

/* The texels of a room's first quad under a sun of E = 100 at the zenith. */
static void count_in_the_sun(struct room *room, unsigned count[3]) {
    struct room_solution solution;
    room->light[0] = (struct lw_light){.kind = LW_LIGHT_DIRECTIONAL, .intensity = {100, 100, 100}};
    room->light_count = 1;
    room_solve(&solution, room, (struct lw_solver_desc){0}, 16);
    room_each_texel(&solution, 0, count_mixed, count);
    room_finish(&solution);
}

/* A wall through the middle of texels, with a roof on one side of it: the sun outside does not light the
 * floor inside, nor the other way round; each texel belongs to the side that has more of it. */
static void test_a_wall_parts_the_texels_under_it(void **state) {
    (void)state;
    for (int i = 0; i < 2; i++) {
        const float x = i ? 0.15f : 0.1f; /* texels of 0.25 m begin at 0 */
        struct room room = {.texels_per_metre = 4};
        room_quad(&room, lw_vec3(-2, 0, -2), lw_vec3(0, 0, 4), lw_vec3(4, 0, 0), 0, 0);
        room_quad(&room, lw_vec3(x, 0, -3), lw_vec3(0, 0, 6), lw_vec3(0, 1, 0), 0, 0);
        room_quad(&room, lw_vec3(-3, 1, -3), lw_vec3(0, 0, 6), lw_vec3(3 + x, 0, 0), 0, 0);
        room.quad[1].double_sided = room.quad[2].double_sided = true;
        unsigned count[3] = {0};
        count_in_the_sun(&room, count);
        assert_int_equal(count[2], 0);
        assert_int_equal(count[0], 16 * (i ? 9 : 8));
        assert_int_equal(count[1], 16 * (i ? 6 : 7)); /* a row out of doors yields (crossings.h) */
    }
}

/* A floor goes on under a wall that is only modelled from outside, but for its last half metre, and ends as a
 * narrow ledge before it, in the sun: that is none of the dark behind the wall. The second one has texels
 * whose middle lies behind, close under a sheet, and points of theirs before the wall. */
static void test_a_ledge_before_a_wall_has_its_own_light(void **state) {
    (void)state;
    const float wall[] = {0, -0.08f}, end = 0.14f; /* texels of 0.25 m begin at 0 */
    for (int i = 0; i < 2; i++) {
        struct room room = {.texels_per_metre = 4};
        room_quad(&room, lw_vec3(-2, 0, -2), lw_vec3(0, 0, 2 + end), lw_vec3(4, 0, 0), 0, 0);
        room_quad(&room, lw_vec3(-3, 0, wall[i]), lw_vec3(4.5f, 0, 0), lw_vec3(0, 1, 0), 0, 0);
        room_quad(&room, lw_vec3(1.5f, 0, wall[i]), lw_vec3(1.5f, 0, 0), lw_vec3(0, 1, 0), 0, 0);
        room_quad(&room, lw_vec3(-3, i ? 0.01f : 1, -3), lw_vec3(0, 0, 3 + wall[i]), lw_vec3(6, 0, 0), 0, 0);
        room.quad[2].double_sided = room.quad[3].double_sided = true;
        unsigned count[3] = {0};
        count_in_the_sun(&room, count);
        assert_int_equal(count[1], i ? 2 * 16 : 16);
        assert_int_equal(count[2], 0);
    }
}

/* Where the sample points of a texel lie, in object space, and their normals. */
static void load_points(const struct lw_mesh_texels *mesh, uint32_t i, struct lw_sample_points_lanes *out) {
    const struct lw_sample_points *points = &mesh->sample_points;
    const uint32_t count = points->first[i + 1] - points->first[i];
    uint32_t texel[LW_TRACE_WIDTH], place[LW_TRACE_WIDTH];
    struct lw_sample_points_frame frame;
    const struct lw_affine as_it_is = {.m = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        texel[lane] = i;
        place[lane] = points->first[i] + (lane < count ? lane : 0);
    }
    lw_sample_points_frame_init(&frame, &as_it_is);
    lw_sample_points_load(points, mesh->position, texel, place, out);
    lw_sample_points_to_world(&frame, out);
}

/* The table holds the (0,2)-sequence, in the middle of eighths at first and then of 64ths. */
static void test_the_table_of_spots(void **state) {
    (void)state;
    for (uint32_t k = 0; k < LW_SAMPLE_POINTS_SPOTS; k++) {
        const struct lw_vec2 spot = lw_sample_points_spot(k);
        const float middle = k < LW_SAMPLE_POINTS_MAX ? 1.0f / 16 : 1.0f / 128;
        assert_true(spot.x == lw_random_unit(lw_random_reverse_bits(k)) + middle &&
                    spot.y == lw_random_unit(lw_random_reverse_bits(lw_random_pascal(k))) + middle);
    }
}

/* The texels of the first mesh of a room, which is solved once; the caller finishes both. */
static void place_texels(struct room *room, struct room_solution *out_solution,
                         struct lw_texels *out_texels) {
    struct lw_error err = {0};
    room_solve(out_solution, room, (struct lw_solver_desc){0}, 1);
    lw_support_ok(lw_texels_init(out_texels, out_solution->scene, 1, NULL, NULL, &err), &err);
}

/* A sloping floor is flat, but for texels whose middle lies off it: a byte a point, one plane for all. Its
 * points are at their spots. */
static void test_flat_texels_take_a_byte_a_point(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = DENSITY};
    const struct lw_vec3 across = lw_vec3(2, 0, 0), along = lw_vec3(0, 0.6f, -0.8f);
    room_quad(&room, lw_vec3(-2, 1, 0), lw_vec3_scale(across, 2), lw_vec3_scale(along, 4), 0.5f, 0);
    struct room_solution solution;
    struct lw_texels texels;
    place_texels(&room, &solution, &texels);
    const struct lw_mesh_texels *mesh = &texels.mesh[0];
    const struct lw_sample_points *points = &mesh->sample_points;
    const struct lw_vec3 up = lw_vec3_normalize(lw_vec3_cross(across, along));
    uint32_t covered = 0, flat = 0;
    for (uint32_t i = 0; i < mesh->texel_count; i++) {
        struct lw_sample_points_lanes lanes;
        if (!mesh->covered[i]) continue;
        covered++;
        flat += (points->form[i] & LW_SAMPLE_POINTS_FLAT) != 0;
        load_points(mesh, i, &lanes);
        const uint32_t count = points->first[i + 1] - points->first[i];
        struct lw_vec3 least = lw_vec3(1e9f, 1e9f, 1e9f), most = lw_vec3(-1e9f, -1e9f, -1e9f);
        for (uint32_t k = 0; k < count; k++) {
            const struct lw_vec3 p = lw_vec3(lanes.at.x[k], lanes.at.y[k], lanes.at.z[k]);
            const float above = lw_vec3_dot(lw_vec3_sub(p, lw_vec3(-2, 1, 0)), up);
            assert_true(above >= 0 && above < 1e-4f);
            assert_true(lanes.at.nx[k] * up.x + lanes.at.ny[k] * up.y + lanes.at.nz[k] * up.z > 0.99999f);
            assert_true(lanes.gx[k] * up.x + lanes.gy[k] * up.y + lanes.gz[k] * up.z > 0.999f);
            assert_true(p.x > -2.0001f && p.x < 2.0001f);
            for (int c = 0; c < 3; c++) {
                (&least.x)[c] = fminf((&least.x)[c], (&p.x)[c]);
                (&most.x)[c] = fmaxf((&most.x)[c], (&p.x)[c]);
            }
        }
        /* the first eight points of a whole texel spread over 7/8 of it, about its middle */
        if (count < LW_SAMPLE_POINTS_MAX || !(points->form[i] & LW_SAMPLE_POINTS_FLAT) ||
            points->spot[points->first[i] + 7] != 7)
            continue;
        assert_float_equal(most.x - least.x, 0.875f / DENSITY, 2e-3f / DENSITY);
        assert_float_equal((most.x + least.x) / 2, mesh->position[0][i], 2e-3f / DENSITY);
        assert_float_equal((most.y + least.y) / 2, mesh->position[1][i], 2e-3f / DENSITY);
    }
    assert_true(flat >= 16 * DENSITY * DENSITY && flat <= covered);
    assert_int_equal(points->plane_count, 1);
    assert_true(points->packed_count <= LW_SAMPLE_POINTS_MAX * (covered - flat));
    lw_texels_finish(&texels);
    room_finish(&solution);
}

/* A strip a fifth of a texel wide has as many places as a whole texel, all of them on it. */
static void test_a_strip_has_eight_places(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = DENSITY};
    room_quad(&room, lw_vec3(-2, 0, 0), lw_vec3(0, 0, 0.05f), lw_vec3(4, 0, 0), 0.5f, 0);
    struct room_solution solution;
    struct lw_texels texels;
    place_texels(&room, &solution, &texels);
    const struct lw_mesh_texels *mesh = &texels.mesh[0];
    const struct lw_sample_points *points = &mesh->sample_points;
    unsigned whole = 0;
    for (uint32_t i = 0; i < mesh->texel_count; i++) {
        const uint32_t places = points->first[i + 1] - points->first[i];
        whole += mesh->covered[i] && places == LW_SAMPLE_POINTS_MAX;
        for (uint32_t k = 0; k < places; k += LW_TRACE_WIDTH) {
            struct lw_sample_points_lanes lanes;
            uint32_t texel[LW_TRACE_WIDTH], place[LW_TRACE_WIDTH];
            for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
                texel[lane] = i;
                place[lane] = points->first[i] + (lane < places ? lane : 0);
            }
            lw_sample_points_load(points, mesh->position, texel, place, &lanes);
            for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
                assert_true(lanes.at.z[lane] > -1e-4f && lanes.at.z[lane] < 0.0501f);
        }
    }
    assert_true(whole >= 4 * DENSITY - 2); /* texels at its ends may have fewer */
    lw_texels_finish(&texels);
    room_finish(&solution);
}

/* A picture of three bands, black, white and black: a strip half a texel wide shows the white one. */
static struct lw_scene *strip_of_a_band(const struct room *room) {
    struct lw_scene *scene = room_scene(room);
    struct lw_texture *texture = lw_scene_alloc(scene, 1, sizeof *texture);
    uint8_t(*rgba)[4] = lw_scene_alloc(scene, BAND_ROWS, sizeof *rgba);
    assert_true(texture && rgba);
    for (uint32_t row = 0; row < BAND_ROWS; row++)
        memset(rgba[row], row >= BAND_ROWS / 4 && row < BAND_ROWS * 3 / 4 ? 255 : 0, sizeof rgba[row]);
    *texture = (struct lw_texture){.name = "bands", .width = 1, .height = BAND_ROWS, .rgba = rgba[0]};
    scene->texture = texture;
    scene->texture_count = 1;
    scene->material[0].base_colour_texture =
        (struct lw_texture_use){.texture = 0, .transform = {1, 0, 0, 0, 0.5f, 0.25f}};
    return scene;
}

/* What a picture has beyond the strip is none of its texels' albedo: bounces would find it dark. */
static void test_a_strip_has_the_albedo_of_what_is_seen_of_it(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = DENSITY};
    room_quad(&room, lw_vec3(-2, 0, 0), lw_vec3(4, 0, 0), lw_vec3(0, 0, -0.5f / DENSITY), 1, 0);
    struct room_solution solution;
    room_solve_scene(&solution, strip_of_a_band(&room), DENSITY, (struct lw_solver_desc){0}, 1);
    struct lw_error err = {0};
    struct lw_texels texels;
    lw_support_ok(lw_texels_init(&texels, solution.scene, 1, NULL, NULL, &err), &err);
    const struct lw_mesh_texels *mesh = &texels.mesh[0];
    uint32_t covered = 0;
    for (uint32_t i = 0; i < mesh->texel_count; i++) {
        if (!mesh->covered[i]) continue;
        covered++;
        /* a point on the very edge is between black and white */
        const float albedo = lw_packed_albedo_unpack(mesh->albedo[i]).x;
        if (albedo < 0.9f) fail_msg("texel %u: albedo %.3f", i, (double)albedo);
    }
    assert_true(covered >= 4 * DENSITY);
    lw_texels_finish(&texels);
    room_finish(&solution);
}

/* The four sides of a bar along x or y, open at both ends. */
static void bar(struct room *room, struct lw_vec3 low, struct lw_vec3 high, bool along_y, bool double_sided) {
    const struct lw_vec3 size = lw_vec3_sub(high, low),
                         a = along_y ? lw_vec3(0, size.y, 0) : lw_vec3(size.x, 0, 0),
                         b = along_y ? lw_vec3(0, 0, size.z) : lw_vec3(0, size.y, 0),
                         c = along_y ? lw_vec3(size.x, 0, 0) : lw_vec3(0, 0, size.z);
    const uint32_t first = room->quad_count;
    room_quad(room, low, a, c, 0, 0);
    room_quad(room, lw_vec3_add(low, b), c, a, 0, 0);
    room_quad(room, low, b, a, 0, 0);
    room_quad(room, lw_vec3_add(low, c), a, b, 0, 0);
    for (uint32_t q = first; q < room->quad_count; q++) room->quad[q].double_sided = double_sided;
}

static void find_darkest(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    (void)p, (void)area, (void)indirect;
    double *darkest = user;
    darkest[0] = fmin(darkest[0], direct);
    darkest[1]++;
}

/* A bar ends inside a post with double-sided faces, both black under an even sky. A face of the bar has E =
 * pi where it is free and, since the post hides at most half of the sky from it, pi/2 beside it. The part
 * inside is not light of any texel, wherever these begin. */
static void test_the_end_of_a_bar_inside_another_is_not_its_light(void **state) {
    (void)state;
    for (int i = 0; i < 4; i++) {
        struct room room = {.texels_per_metre = 10, .sky = 1};
        bar(&room, lw_vec3(-1 - 0.025f * (float)i, -0.02f, -0.02f), lw_vec3(0.05f, 0.02f, 0.02f), false,
            false);
        bar(&room, lw_vec3(0, -1, -0.03f), lw_vec3(0.06f, 1, 0.03f), true, true);
        struct room_solution solution;
        room_solve(&solution, &room, (struct lw_solver_desc){.direct_samples = 8}, 64);
        for (uint32_t face = 0; face < 4; face++) {
            double darkest[2] = {(double)INFINITY, 0};
            room_each_texel(&solution, face, find_darkest, darkest);
            assert_true(darkest[1] >= 10);
            if (darkest[0] < 0.97 * acos(-1.0) / 2) fail_msg("face %u: a texel reads %.3f", face, darkest[0]);
        }
        room_finish(&solution);
    }
}

/* A double-sided sheet half a texel above a floor shades it, though only its back is to be seen from there:
 * in its middle no sky is left within 84 degrees of the zenith, cos^2(84) = 0.011 of pi. */
static void test_a_sheet_close_to_a_floor_shades_it(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 10, .sky = 1};
    room_quad(&room, lw_vec3(-1, 0, -1), lw_vec3(0, 0, 2), lw_vec3(2, 0, 0), 0, 0);
    room_quad(&room, lw_vec3(-0.5f, 0.05f, -0.5f), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0, 0);
    room.quad[1].double_sided = true;
    struct room_solution solution;
    room_solve(&solution, &room, (struct lw_solver_desc){.direct_samples = 8}, 64);
    double darkest[2] = {(double)INFINITY, 0};
    room_each_texel(&solution, 0, find_darkest, darkest);
    assert_true(darkest[0] < 0.02 * acos(-1.0));
    assert_true(darkest[1] >= 0.95 * 400); /* some are as dark as if they were inside something */
    room_finish(&solution);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_the_table_of_spots),
        cmocka_unit_test(test_flat_texels_take_a_byte_a_point),
        cmocka_unit_test(test_a_strip_has_eight_places),
        cmocka_unit_test(test_a_strip_has_the_albedo_of_what_is_seen_of_it),
        cmocka_unit_test(test_the_end_of_a_bar_inside_another_is_not_its_light),
        cmocka_unit_test(test_a_sheet_close_to_a_floor_shades_it),
        cmocka_unit_test(test_texels_hold_the_lit_share_of_a_shadow_edge),
        cmocka_unit_test(test_samples_of_one_frame_spread_over_the_texel),
        cmocka_unit_test(test_a_coarse_sphere_shades_smoothly),
        cmocka_unit_test(test_no_light_leaks_between_two_rooms),
        cmocka_unit_test(test_a_wall_parts_the_texels_under_it),
        cmocka_unit_test(test_a_ledge_before_a_wall_has_its_own_light),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
