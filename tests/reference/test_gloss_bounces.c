/* What surfaces with a finish send back in the solve: all that their lobes send back of light from
 * everywhere, evenly. Where tiles know the direction of direct light, lobes send that light on. */
#include "tests/reference/effort.h"
#include "tests/reference/room.h"

#include <math.h>
#include <string.h>

#define SIDE 8u /* texels of a texture */

static struct lw_texture_use use_of(uint32_t texture) {
    return (struct lw_texture_use){.texture = texture, .transform = {1, 0, 0, 0, 1, 0}};
}

/* Metal where u < 0.5, rough to one half everywhere. */
static uint32_t half_of_metal(struct lw_scene *scene) {
    uint8_t *rgba = lw_scene_alloc(scene, SIDE * SIDE, 4);
    scene->finish_texture = lw_scene_alloc(scene, 1, sizeof *scene->finish_texture);
    assert_true(rgba && scene->finish_texture);
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        const uint8_t texel[4] = {255, 128, i % SIDE < SIDE / 2 ? 255 : 0, 255};
        memcpy(rgba + 4ul * i, texel, sizeof texel);
    }
    scene->finish_texture[0] = (struct lw_texture){
        .name = "half", .width = SIDE, .height = SIDE, .rgba = rgba, .content = LW_CONTENT_SURFACE};
    scene->finish_texture_count = 1;
    return 0;
}

static float varnish_albedo(float base, float roughness) {
    const struct lw_lobes lobes = {.diffuse = lw_vec3(base, base, base),
                                   .f0 = lw_vec3(0.04f, 0.04f, 0.04f),
                                   .f90 = 1,
                                   .gloss0 = 0.04f,
                                   .gloss90 = 1,
                                   .roughness = roughness};
    return lw_lobes_albedo(&lobes).x;
}
static float metal_albedo(float base, float roughness) {
    const struct lw_lobes lobes = {.f0 = lw_vec3(base, base, base), .f90 = 1, .roughness = roughness};
    return lw_lobes_albedo(&lobes).x;
}

/* The albedo of an object's texel that is nearest to (u, v) of its quad, as tiles have it. */
static float albedo_at(const struct room_solution *s, uint32_t quad, float u, float v) {
    const struct lw_mesh *mesh = &s->scene->mesh[quad];
    const struct lw_vec2 a = mesh->lightmap_uv[mesh->triangle[0][0]],
                         b = mesh->lightmap_uv[mesh->triangle[0][1]],
                         c = mesh->lightmap_uv[mesh->triangle[1][2]];
    const uint32_t x = (uint32_t)(a.x + u * (b.x - a.x) + v * (c.x - a.x)),
                   y = (uint32_t)(a.y + u * (b.y - a.y) + v * (c.y - a.y));
    struct lw_solver_tile tile;
    s->solver->ops->read_tile(s->solver, (lw_tile_id){s->map.first_tile[quad]}, &tile);
    const uint32_t i = y * tile.width + x;
    assert_true(x < tile.width && y < tile.height && tile.covered[i]);
    return lw_packed_albedo_unpack(tile.albedo[i]).x;
}

static struct room box(float albedo, float emission) {
    struct room room = {.texels_per_metre = 8};
    room_box(&room, lw_vec3(2, 2, 2), albedo, emission);
    return room;
}

static void test_texels_have_what_all_lobes_send_back(void **state) {
    (void)state;
    const struct room room = box(0.6f, 1);
    struct lw_scene *scene = room_scene(&room);
    lw_support_finish(scene, 0, 1, 0.25f);
    lw_support_finish(scene, 1, 0, 0.25f);
    lw_support_finish(scene, 2, 1, 1)->surface_texture = use_of(half_of_metal(scene));
    struct room_solution s;
    room_solve_scene(&s, scene, room.texels_per_metre, (struct lw_solver_desc){.bounces = 1}, 1);
    expect_near((double)albedo_at(&s, 0, 0.5f, 0.5f), (double)metal_albedo(0.6f, 0.25f), 1e-5);
    expect_near((double)albedo_at(&s, 1, 0.5f, 0.5f), (double)varnish_albedo(0.6f, 0.25f), 1e-5);
    expect_near((double)albedo_at(&s, 2, 0.25f, 0.5f), (double)metal_albedo(0.6f, 128 / 255.0f), 1e-5);
    expect_near((double)albedo_at(&s, 2, 0.75f, 0.5f), (double)varnish_albedo(0.6f, 128 / 255.0f), 1e-5);
    expect_near((double)albedo_at(&s, 3, 0.5f, 0.5f), 0.6, 1e-6);
    assert_true(albedo_at(&s, 1, 0.5f, 0.5f) > 0.6f);
    room_finish(&s);
}

/* A material that changes its colour keeps its finish: the lobes are taken again. */
static void test_a_changed_colour_passes_the_gloss(void **state) {
    (void)state;
    const struct room room = box(0.6f, 1);
    struct lw_scene *scene = room_scene(&room);
    lw_support_finish(scene, 0, 1, 0.25f);
    lw_support_finish(scene, 1, 0, 0.25f);
    struct room_solution s;
    room_solve_scene(&s, scene, room.texels_per_metre, (struct lw_solver_desc){.bounces = 1}, 1);
    for (uint32_t m = 0; m < 2; m++)
        for (int c = 0; c < 3; c++)
            scene->material[m].base_colour[c] = s.pose.material[m].base_colour[c] = 0.2f;
    room_frame(&s, 2);
    expect_near((double)albedo_at(&s, 0, 0.5f, 0.5f), (double)metal_albedo(0.2f, 0.25f), 5e-5); /* packed */
    expect_near((double)albedo_at(&s, 1, 0.5f, 0.5f), (double)varnish_albedo(0.2f, 0.25f), 5e-5);
    room_finish(&s);
}

/* As the furnace of test_bounces.c, whatever mirrors: bounce k adds pi Le rho^k, rho being all that is sent
 * back. A white mirror's loses nothing. */
static void expect_furnace(float base, float metalness, float roughness, float rho) {
    const uint32_t bounces = 3;
    const struct room room = box(base, 1.5f);
    struct lw_scene *scene = room_scene(&room);
    for (uint32_t m = 0; m < 6; m++) lw_support_finish(scene, m, metalness, roughness);
    struct room_solution s;
    double want = 0, mean = 0;
    room_solve_scene(&s, scene, room.texels_per_metre,
                     (struct lw_solver_desc){.bounces = bounces, .direct_samples = 16}, 32 * effort);
    for (uint32_t k = 0; k <= bounces; k++) want += 1.5 * (double)LW_PI * pow((double)rho, k);
    for (uint32_t o = 0; o < 6; o++) mean += room_object_mean(&s, o).total / 6;
    expect_near(mean, want, noise(0.013));
    room_finish(&s);
}

static void test_furnaces(void **state) {
    (void)state;
    expect_furnace(0.5f, 0, 0.3f, varnish_albedo(0.5f, 0.3f));
    expect_furnace(0.5f, 1, 0.3f, metal_albedo(0.5f, 0.3f));
    expect_furnace(1, 1, 0.6f, 1);
}

/* ---- which way it is sent ---- */

#define ELEVATION 0.35f /* rad; how high the sun stands */
#define SUN       100.0f
#define GLOSSY    0.5f /* roughness */

/* A varnished floor, and a black wall at its end that faces the sun. */
static struct lw_scene *floor_and_wall(void) {
    struct room room = {.texels_per_metre = 12};
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 3), lw_vec3(3, 0, 0), 0.3f, 0);
    room_quad(&room, lw_vec3(3, 0, 0), lw_vec3(0, 0, 3), lw_vec3(0, 1, 0), 0, 0);
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_DIRECTIONAL, .intensity = {SUN, SUN, SUN}};
    room.light_count = 1;
    struct lw_scene *scene = room_scene(&room);
    struct lw_node *node = &scene->node[room.quad_count];
    const float half = sqrtf(0.5f); /* -Z is turned to (cos, -sin, 0) */
    const float rotation[4] = {-sinf(ELEVATION) * half, -cosf(ELEVATION) * half, 0, half};
    memcpy(node->rotation, rotation, sizeof rotation);
    lw_support_finish(scene, 0, 0, GLOSSY);
    return scene;
}

struct of_wall {
    double got, want;
    unsigned texels;
};

/* What the floor sends to a point of the wall: midpoints of squares. */
static double from_floor(struct lw_vec3 p) {
    const struct lw_lobes lobes = {.diffuse = lw_vec3(0.3f, 0.3f, 0.3f),
                                   .f0 = lw_vec3(0.04f, 0.04f, 0.04f),
                                   .f90 = 1,
                                   .gloss0 = 0.04f,
                                   .gloss90 = 1,
                                   .roughness = GLOSSY};
    const struct lw_vec3 sun = lw_vec3(-cosf(ELEVATION), 0, sinf(ELEVATION)); /* the normal is +z */
    const int side = 120;
    double e = 0;
    for (int i = 0; i < side * side; i++) {
        const float step = 3.0f / (float)side;
        const struct lw_vec3 way =
            lw_vec3(p.x - ((float)(i % side) + 0.5f) * step, p.z - ((float)(i / side) + 0.5f) * step, p.y);
        const float square = lw_vec3_dot(way, way);
        const struct lw_vec3 out = lw_vec3_scale(way, 1 / sqrtf(square));
        const struct lw_lobes_seen seen = lw_lobes_see(&lobes, out);
        e += (double)(SUN * lw_lobes_reflect(&seen, sun).x * out.z * out.x / square * step * step);
    }
    return e;
}

static void compare_with_floor(void *user, struct lw_vec3 p, double area, double direct, double indirect) {
    struct of_wall *wall = user;
    (void)area, (void)direct;
    if (p.y < 0.2f || wall->texels++ % 5) return;
    wall->got += indirect;
    wall->want += from_floor(p);
}

static void test_gloss_sends_the_suns_light_one_way(void **state) {
    (void)state;
    double ratio[2];
    for (unsigned directed = 0; directed < 2; directed++) {
        struct room_solution s;
        struct of_wall wall = {0};
        room_solve_scene(&s, floor_and_wall(), 12,
                         (struct lw_solver_desc){.bounces = 1, .indirect_samples = 8, .directions = directed},
                         48 * effort);
        room_each_texel(&s, 1, compare_with_floor, &wall);
        assert_true(wall.texels > 300);
        ratio[directed] = wall.got / wall.want;
        room_finish(&s);
    }
    print_message("solve over integral: %.3f, evenly %.3f\n", ratio[1], ratio[0]);
    expect_near(ratio[1], 1, noise(0.02));
    assert_true(fabs(ratio[0] - 1) > 0.15); /* it matters here */
}

int main(int argc, char **argv) {
    (void)argv;
    set_effort(argc);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_texels_have_what_all_lobes_send_back),
        cmocka_unit_test(test_a_changed_colour_passes_the_gloss),
        cmocka_unit_test(test_furnaces),
        cmocka_unit_test(test_gloss_sends_the_suns_light_one_way),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
