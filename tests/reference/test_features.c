/* What a scene may be made of, each against a closed form: textures, vertex colours, masks, sides, mirrored
 * and sheared nodes, instances, lamps that an animation carries. */
#include "tests/reference/room.h"

#include <math.h>
#include <string.h>

#define PI 3.14159265358979323846

/* ---- helpers ---- */

/* Adds a texture of side x side texels; `white` says which are (1, 1, 1, 1), the others are (0, 0, 0, 0). */
static uint32_t add_texture(struct lw_scene *scene, uint32_t side, bool (*white)(uint32_t x, uint32_t y)) {
    uint8_t *rgba = lw_scene_alloc(scene, (size_t)side * side, 4);
    assert_non_null(rgba);
    for (uint32_t i = 0; i < side * side; i++) memset(rgba + 4 * i, white(i % side, i / side) ? 255 : 0, 4);
    struct lw_texture *grown = lw_scene_alloc(scene, scene->texture_count + 1, sizeof *grown);
    assert_non_null(grown);
    if (scene->texture_count) memcpy(grown, scene->texture, scene->texture_count * sizeof *grown);
    grown[scene->texture_count] =
        (struct lw_texture){.name = "pattern", .width = side, .height = side, .rgba = rgba};
    scene->texture = grown;
    return scene->texture_count++;
}

static bool left_half(uint32_t x, uint32_t y) {
    (void)y;
    return x < 32;
}
static bool fine_checks(uint32_t x, uint32_t y) { return (x / 4 + y / 4) % 2 == 0; }

/* A box that shines from all walls, which reflect `rho`: bounce 1 adds pi Le rho. */
static struct room shining_box(float rho) {
    struct room room = {.texels_per_metre = 8};
    room_box(&room, lw_vec3(2, 2, 2), rho, 1);
    return room;
}

static double first_bounce(struct lw_scene *scene) {
    struct room_solution solution;
    double mean = 0;
    room_solve_scene(&solution, scene, 8, (struct lw_solver_desc){.bounces = 1, .direct_samples = 4}, 48);
    for (uint32_t o = 0; o < 6; o++) mean += room_object_mean(&solution, o).indirect / 6;
    room_finish(&solution);
    return mean;
}

/* ---- albedo ---- */

/* Fine checks of white and black reflect half, wherever they are. */
static void test_textured_albedo(void **state) {
    (void)state;
    struct room room = shining_box(1);
    struct lw_scene *scene = room_scene(&room);
    uint32_t texture = add_texture(scene, 64, fine_checks);
    for (uint32_t m = 0; m < 6; m++) scene->material[m].base_colour_texture.texture = texture;
    expect_near(first_bounce(scene), PI * 0.5, 0.015);
}

/* A transform that shows the dark half alone, then the bright half alone (KHR_texture_transform: scale, then
 * shift). */
static void test_texture_transform(void **state) {
    (void)state;
    for (int bright = 0; bright < 2; bright++) {
        struct room room = shining_box(0.8f);
        struct lw_scene *scene = room_scene(&room);
        uint32_t texture = add_texture(scene, 64, left_half);
        for (uint32_t m = 0; m < 6; m++) {
            const float shown[6] = {0.4f, 0, bright ? 0.05f : 0.55f, 0, 1, 0};
            scene->material[m].base_colour_texture.texture = texture;
            memcpy(scene->material[m].base_colour_texture.transform, shown, sizeof shown);
        }
        double bounce = first_bounce(scene);
        if (bright)
            expect_near(bounce, PI * 0.8, 0.015);
        else
            assert_true(bounce < 1e-6);
    }
}

static void test_vertex_colours(void **state) {
    (void)state;
    struct room room = shining_box(0.8f);
    struct lw_scene *scene = room_scene(&room);
    for (uint32_t m = 0; m < 6; m++) {
        struct lw_vec4 *colour = lw_scene_alloc(scene, 4, sizeof *colour);
        assert_non_null(colour);
        for (int v = 0; v < 4; v++)
            colour[v] = (struct lw_vec4){v < 2 ? 1.0f : 0.5f, 1, 1, 1}; /* mean 0.75 */
        scene->mesh[m].colour = colour;
    }
    expect_near(first_bounce(scene), PI * 0.8 * 0.75, 0.015);
}

/* ---- visibility ---- */

struct halves {
    double bright, dark, soft;
    unsigned bright_count, dark_count, soft_count;
};

/* A stencil at height 0.5 lets the sun through where x < 0.5; its disc of 0.02 blurs the edge by 0.005 to
 * either side. */
static void sort_by_side(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    (void)area, (void)indirect;
    struct halves *h = user;
    double from_edge = (double)p.x - 0.5;
    bool inside = p.z > 0.1f && p.z < 0.9f && p.x > 0.1f && p.x < 0.9f;
    if (!inside) return;
    if (from_edge < -0.06) h->bright += direct, h->bright_count++;
    if (from_edge > 0.06) h->dark += direct, h->dark_count++;
    if (fabs(from_edge) <= 0.06) h->soft += direct, h->soft_count++;
}

static void test_mask_casts_its_shape(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 32};
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0.5f, 0);
    room_quad(&room, lw_vec3(0, 0.5f, 0), lw_vec3(1, 0, 0), lw_vec3(0, 0, 1), 0.5f, 0);
    room.light[0] = (struct lw_light){
        .kind = LW_LIGHT_DIRECTIONAL, .intensity = {100, 100, 100}, .angular_diameter = 0.02f};
    room.light_count = 1;
    struct lw_scene *scene = room_scene(&room);
    /* alpha 0 on the left half: cut out */
    scene->material[1].base_colour_texture.texture = add_texture(scene, 64, left_half);
    const float flipped[6] = {-1, 0, 1, 0, 1, 0};
    memcpy(scene->material[1].base_colour_texture.transform, flipped, sizeof flipped);
    scene->material[1].alpha_mode = LW_ALPHA_MASK;
    struct room_solution solution;
    struct halves halves = {0};
    room_solve_scene(&solution, scene, 32, (struct lw_solver_desc){0}, 64);
    room_each_texel(&solution, 0, sort_by_side, &halves);
    assert_true(halves.bright_count > 200 && halves.dark_count > 200 && halves.soft_count > 50);
    expect_near(halves.bright / halves.bright_count, 100, 1e-4);
    assert_true(halves.dark == 0);
    expect_near(halves.soft / halves.soft_count, 50, 0.1); /* the edge runs through the middle */
    room_finish(&solution);
}

/* The edge of a sun's shadow: E falls from 1 to 0 over 2 h tan(alpha/2), as the part of its disc that a
 * straight edge leaves: (acos(s) - s sqrt(1 - s^2)) / pi at s radii beyond the edge. */
#define SUN_EDGE_H     0.8
#define SUN_EDGE_ANGLE 0.4

static double sun_left(double x) {
    double s = x / (SUN_EDGE_H * tan(SUN_EDGE_ANGLE / 2));
    if (s <= -1) return 1;
    if (s >= 1) return 0;
    return (acos(s) - s * sqrt(1 - s * s)) / PI;
}

struct penumbra {
    double off_square;
    unsigned count, inside;
};

static void compare_penumbra(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    (void)area, (void)indirect;
    struct penumbra *penumbra = user;
    if (fabsf(p.z) > 0.5f) return; /* far from the ends of the screen */
    double want = 100 * sun_left((double)p.x);
    penumbra->off_square += (direct - want) * (direct - want);
    penumbra->count++;
    penumbra->inside += want > 5 && want < 95;
}

static void test_penumbra_of_the_sun(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 32};
    room_quad(&room, lw_vec3(-1, 0, -1), lw_vec3(0, 0, 2), lw_vec3(2, 0, 0), 0.5f, 0);
    room_quad(&room, lw_vec3(0, (float)SUN_EDGE_H, -3), lw_vec3(4, 0, 0), lw_vec3(0, 0, 6), 0, 0);
    room.quad[1].double_sided = true;
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_DIRECTIONAL,
                                      .intensity = {100, 100, 100},
                                      .angular_diameter = (float)SUN_EDGE_ANGLE};
    room.light_count = 1;
    struct room_solution solution;
    struct penumbra penumbra = {0};
    room_solve(&solution, &room, (struct lw_solver_desc){0}, 256);
    room_each_texel(&solution, 0, compare_penumbra, &penumbra);
    assert_true(penumbra.count > 1000 && penumbra.inside > 200);
    /* the cosine of rays off the sun's axis: at most 2 %. 256 samples: 3 % of the rest. A texel is 1/10
     * of the penumbra */
    double off = sqrt(penumbra.off_square / penumbra.count);
    if (off > 2) fail_msg("root mean square off by %g of 100", off);
    room_finish(&solution);
}

/* A plate between two lamps: each side has its own light. */
static void test_sides_of_a_plate(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 16};
    room_quad(&room, lw_vec3(-1, 0, -1), lw_vec3(0, 0, 2), lw_vec3(2, 0, 0), 0.5f, 0); /* facing up */
    room.quad[0].double_sided = true;
    for (int i = 0; i < 2; i++) {
        room.light[i] =
            (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {i ? 3 : 10, i ? 3 : 10, i ? 3 : 10}};
        room.light_position[i] = lw_vec3(0, i ? -1.5f : 1.5f, 0);
    }
    room.light_count = 2;
    struct room_solution solution;
    room_solve(&solution, &room, (struct lw_solver_desc){0}, 8);
    const struct lw_mesh *mesh = &solution.scene->mesh[0];
    assert_true(mesh->back_offset > 0);
    double sum[2] = {0}, count[2] = {0};
    const struct lw_atlas_level *level = &solution.map.atlas[0]->level[0];
    for (uint32_t t = 0; t < level->tiles_x * level->tiles_y; t++) {
        struct lw_solver_tile tile;
        solution.solver->ops->read_tile(solution.solver, (lw_tile_id){solution.map.first_tile[0] + t}, &tile);
        for (uint32_t i = 0; i < tile.width * tile.height; i++) {
            if (!tile.covered[i]) continue;
            uint32_t y = t / level->tiles_x * LW_TILE_SIDE + i / tile.width;
            sum[y >= mesh->back_offset] += (double)tile.direct[0][i];
            count[y >= mesh->back_offset]++;
        }
    }
    assert_true(count[0] > 500 && count[1] > 500);
    expect_near(sum[1] / count[1], 0.3 * sum[0] / count[0], 1e-3);
    room_finish(&solution);
}

/* ---- transforms ---- */

/* However a closed room is turned, mirrored, stretched or sheared: from inside it is still the same
 * furnace. */
static void expect_furnace_in(const struct lw_affine *matrix, float texels_per_metre) {
    struct room room = shining_box(0.5f);
    struct lw_scene *scene = room_scene(&room);
    for (uint32_t n = 0; n < 6; n++) {
        scene->node[n].has_matrix = 1;
        scene->node[n].matrix = *matrix;
    }
    struct room_solution solution;
    room_solve_scene(&solution, scene, texels_per_metre,
                     (struct lw_solver_desc){.bounces = 1, .direct_samples = 8}, 32);
    double area = 0, mean = 0;
    for (uint32_t o = 0; o < 6; o++) {
        struct room_mean m = room_object_mean(&solution, o);
        mean += m.total / 6;
        area += m.texels;
    }
    assert_true(area > 100);
    /* unweighted mean over faces of equal light: the scatter is that of area sampling in corners, 0.35 % over
     * seeds */
    if (fabs(mean / (PI * 1.5) - 1) > 0.02) fail_msg("furnace reads %g, expected %g", mean, PI * 1.5);
    room_finish(&solution);
}

static void test_transformed_furnaces(void **state) {
    (void)state;
    const struct lw_affine mirrored = {{{-1, 0, 0, 3}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
                           twice = {{{-1, 0, 0, 0}, {0, -1, 0, 0}, {0, 0, 1, 5}}},
                           thrice = {{{-1, 0, 0, 0}, {0, -2, 0, 0}, {0, 0, -1, 0}}},
                           stretched = {{{1, 0, 0, 0}, {0, 3, 0, 0}, {0, 0, 0.5f, 0}}},
                           sheared = {{{1, 0.7f, 0, 0}, {0, 1, 0, -8}, {0.3f, 0, 1, 0}}},
                           turned = {{{0, 0, -1.5f, 0}, {0, 1.5f, 0, 0}, {1.5f, 0, 0, 0}}};
    expect_furnace_in(&mirrored, 8);
    expect_furnace_in(&twice, 8);
    expect_furnace_in(&thrice, 8);
    expect_furnace_in(&stretched, 6);
    expect_furnace_in(&sheared, 8);
    expect_furnace_in(&turned, 8);
}

/* Two objects that share a mesh have light of their own. */
static void test_instances(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 16};
    for (int i = 0; i < 2; i++)
        room_quad(&room, lw_vec3(-0.5f, 0, -0.5f), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0.5f, 0);
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {10, 10, 10}};
    room.light_position[0] = lw_vec3(0, 2, 0);
    room.light_count = 1;
    struct lw_scene *scene = room_scene(&room);
    scene->object[1].mesh = 0;
    scene->node[1].translation[1] = 1; /* half way up to the lamp, out of the other's way */
    scene->node[1].translation[0] = 8;
    scene->node[2].translation[0] = 4;
    struct room_solution solution;
    room_solve_scene(&solution, scene, 16, (struct lw_solver_desc){0}, 1);
    /* E at the middle: I h / (h^2 + 16)^(3/2); the mean over 1 m^2 differs from it by under 1 % */
    expect_near(room_object_mean(&solution, 0).direct, 10 * 2 / pow(4 + 16, 1.5), 0.02);
    expect_near(room_object_mean(&solution, 1).direct, 10 * 1 / pow(1 + 16, 1.5), 0.03);
    room_finish(&solution);
}

/* ---- animation ---- */

static void add_channel(struct lw_scene *scene, uint32_t node, enum lw_channel_path path, const float *value,
                        uint32_t width) {
    float *time_s = lw_scene_alloc(scene, 2, sizeof *time_s),
          *values = lw_scene_alloc(scene, 2 * width, sizeof *values);
    struct lw_channel *grown = lw_scene_alloc(scene, scene->channel_count + 1, sizeof *grown);
    assert_non_null(time_s);
    assert_non_null(values);
    assert_non_null(grown);
    time_s[1] = 2;
    memcpy(values, value, 2 * width * sizeof *values);
    if (scene->channel_count) memcpy(grown, scene->channel, scene->channel_count * sizeof *grown);
    grown[scene->channel_count++] = (struct lw_channel){.node = node,
                                                        .path = (uint8_t)path,
                                                        .interpolation = LW_INTERPOLATION_LINEAR,
                                                        .key_count = 2,
                                                        .time_s = time_s,
                                                        .value = values};
    scene->channel = grown;
    scene->duration_s = 2;
}

/* A lamp that its node's animation lifts from 1 m to 3 m: after 1 of 2 s it hangs at 2 m, for the solver that
 * was made at that time as for the one that saw it come. */
static void test_a_lamp_that_moves(void **state) {
    (void)state;
    for (int late = 0; late < 2; late++) {
        struct room room = {.texels_per_metre = 16};
        room_quad(&room, lw_vec3(-0.5f, 0, -0.5f), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), 0.5f, 0);
        room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {10, 10, 10}};
        room.light_count = 1;
        struct lw_scene *scene = room_scene(&room);
        const float heights[6] = {0, 1, 0, 0, 3, 0};
        add_channel(scene, 1, LW_CHANNEL_TRANSLATION, heights, 3);
        struct room_solution solution;
        room_solve_at(&solution, scene, 16, (struct lw_solver_desc){0}, late ? 0 : 1, 1);
        if (late) {
            struct lw_error err = {0};
            lw_pose_evaluate(&solution.pose, scene, 1);
            for (uint64_t f = 2; f < 200; f++)
                lw_support_ok(
                    solution.solver->ops->frame(solution.solver, &solution.pose, f, &solution.stats, &err),
                    &err);
        }
        /* mean over the square of I h / d^3 is I times the solid angle that it fills: 4 asin(1/(1 + 4
         * h^2)) */
        expect_near(room_object_mean(&solution, 0).direct, 10 * 4 * asin(1.0 / (1 + 4 * 2 * 2)), 0.002);
        room_finish(&solution);
    }
}

/* A spot that hangs on a turning parent shines where the parent's turn points it. */
static void test_a_spot_on_a_turning_parent(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 32};
    room_quad(&room, lw_vec3(-2, 0, -2), lw_vec3(0, 0, 4), lw_vec3(4, 0, 0), 0.5f, 0);
    room_quad(&room, lw_vec3(-2, 4, -2), lw_vec3(4, 0, 0), lw_vec3(0, 0, 4), 0.5f, 0); /* facing down */
    room.light[0] = (struct lw_light){
        .kind = LW_LIGHT_SPOT, .intensity = {10, 10, 10}, .inner_cone = 0.2f, .outer_cone = 0.3f};
    room.light_position[0] = lw_vec3(0, 2, 0);
    room.light_count = 1;
    struct lw_scene *scene = room_scene(&room);
    /* the light's node becomes the child of a node about the same point */
    struct lw_node *node = lw_scene_alloc(scene, 4, sizeof *node);
    assert_non_null(node);
    memcpy(node, scene->node, 3 * sizeof *node);
    node[3] = node[2];
    node[3].parent = 2;
    memset(node[3].translation, 0, sizeof node[3].translation);
    node[2].rotation[0] = node[2].rotation[1] = node[2].rotation[2] = 0;
    node[2].rotation[3] = 1;
    scene->node = node;
    scene->node_count = 4;
    scene->light[0].node = 3;
    const float turn[8] = {0, 0, 0, 1, 0, 0, 1, 0}; /* half a turn about z */
    add_channel(scene, 2, LW_CHANNEL_ROTATION, turn, 4);
    for (int up = 0; up < 2; up++) {
        struct room_solution solution;
        if (up) { /* the solution takes the scene: the second round starts from the first one's */
            struct lw_scene *again = scene;
            room_solve_at(&solution, again, 32, (struct lw_solver_desc){0}, 1.9999, 1);
        } else {
            room_solve_at(&solution, scene, 32, (struct lw_solver_desc){0}, 0, 1);
        }
        double floor = room_object_mean(&solution, 0).direct, ceiling = room_object_mean(&solution, 1).direct;
        assert_true(up ? floor == 0 && ceiling > 0.01 : ceiling == 0 && floor > 0.01);
        if (up) {
            room_finish(&solution);
        } else { /* all but the scene */
            solution.solver->ops->destroy(solution.solver);
            lw_pose_finish(&solution.pose);
            lw_atlas_map_finish(&solution.map);
        }
    }
}

/* ---- emission ---- */

/* A lamp whose texture is dark on one half is the other half alone. */
static void test_textured_lamp(void **state) {
    (void)state;
    double e[2];
    for (int textured = 0; textured < 2; textured++) {
        struct room room = {.texels_per_metre = 16};
        room_quad(&room, lw_vec3(-0.5f, 1, -0.5f), lw_vec3(textured ? 1 : 0.5f, 0, 0), lw_vec3(0, 0, 1), 0,
                  3);
        room_quad(&room, lw_vec3(-1, 0, -1), lw_vec3(0, 0, 2), lw_vec3(2, 0, 0), 0, 0);
        struct lw_scene *scene = room_scene(&room);
        if (textured) scene->material[0].emission_texture.texture = add_texture(scene, 64, left_half);
        struct room_solution solution;
        room_solve_scene(&solution, scene, 16, (struct lw_solver_desc){.direct_samples = 8}, 64);
        e[textured] = room_object_mean(&solution, 1).direct;
        room_finish(&solution);
    }
    /* bilinear look-ups blur the edge and, by wrapping, the two ends: 1/64 of the width in all, half of it
     * lost */
    expect_near(e[1], e[0], 0.01);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_textured_albedo),      cmocka_unit_test(test_texture_transform),
        cmocka_unit_test(test_vertex_colours),       cmocka_unit_test(test_mask_casts_its_shape),
        cmocka_unit_test(test_penumbra_of_the_sun),  cmocka_unit_test(test_sides_of_a_plate),
        cmocka_unit_test(test_transformed_furnaces), cmocka_unit_test(test_instances),
        cmocka_unit_test(test_a_lamp_that_moves),    cmocka_unit_test(test_a_spot_on_a_turning_parent),
        cmocka_unit_test(test_textured_lamp),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
