/* What a baked EXR says against a known configuration factor, in every convention: E = pi L F under a square
 * lamp that faces the floor. */
#include "tests/reference/room.h"

#include "server/bake/map.h"

#include <stdlib.h>

#define HEIGHT   0.8
#define RADIANCE 3.0f
#define ALBEDO   0.4
/* One point per texel: those four texels apart share their directions, so a coarser grid would average
 * nothing away. */
#define GRID 36

/* From a point to a parallel rectangle a x b at distance c, one corner above the point (Howell's catalogue,
 * B-3). */
static double corner_factor(double a, double b, double c) {
    const double x = a / c, y = b / c, rx = sqrt(1 + x * x), ry = sqrt(1 + y * y);
    return (x / rx * atan(y / rx) + y / ry * atan(x / ry)) / (2 * M_PI);
}

static double irradiance_at(double x, double z) {
    const double east = 0.5 - x, west = 0.5 + x, south = 0.5 - z, north = 0.5 + z;
    return M_PI * (double)RADIANCE *
           (corner_factor(east, south, HEIGHT) + corner_factor(east, north, HEIGHT) +
            corner_factor(west, south, HEIGHT) + corner_factor(west, north, HEIGHT));
}

static void solve_floor(struct room_solution *solution) {
    struct room room = {.texels_per_metre = 40};
    room_quad(&room, lw_vec3(-0.5f, 0, -0.5f), lw_vec3(0, 0, 1), lw_vec3(1, 0, 0), (float)ALBEDO, 0);
    room_quad(&room, lw_vec3(-0.5f, (float)HEIGHT, -0.5f), lw_vec3(1, 0, 0), lw_vec3(0, 0, 1), 0, RADIANCE);
    room_solve(solution, &room, (struct lw_solver_desc){.bounces = 0, .target_error = -1}, 64);
}

/* The texel that holds a point of the floor, by the mesh's own lightmap coordinates. */
static const float *texel_at(const struct lw_mesh *mesh, const float *rgba, uint32_t width, float x,
                             float z) {
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t *v = mesh->triangle[t];
        const struct lw_vec3 a = mesh->position[v[0]], b = mesh->position[v[1]], c = mesh->position[v[2]];
        const float area = (b.x - a.x) * (c.z - a.z) - (c.x - a.x) * (b.z - a.z);
        const float s = ((x - a.x) * (c.z - a.z) - (c.x - a.x) * (z - a.z)) / area,
                    r = ((b.x - a.x) * (z - a.z) - (x - a.x) * (b.z - a.z)) / area;
        if (s < -1e-4f || r < -1e-4f || s + r > 1 + 1e-4f) continue;
        const struct lw_vec2 *uv = mesh->lightmap_uv;
        const float u = uv[v[0]].x + s * (uv[v[1]].x - uv[v[0]].x) + r * (uv[v[2]].x - uv[v[0]].x),
                    w = uv[v[0]].y + s * (uv[v[1]].y - uv[v[0]].y) + r * (uv[v[2]].y - uv[v[0]].y);
        return rgba + ((size_t)w * width + (size_t)u) * 4;
    }
    fail_msg("no triangle at (%g, %g)", (double)x, (double)z);
    return NULL;
}

static void a_baked_floor_has_the_form_factor_of_its_lamp(void **state) {
    (void)state;
    static const double factor[LW_CONVENTION_COUNT] = {1, ALBEDO, 1, 1 / M_PI, ALBEDO / M_PI};
    struct room_solution solution;
    solve_floor(&solution);
    for (int kind = 0; kind < LW_CONVENTION_COUNT; kind++) {
        const char *path = lw_support_temporary("floor.exr");
        struct lw_map map;
        struct lw_error err = {0};
        float *rgba;
        uint32_t width, height;
        lw_support_ok(lw_map_build(&map, solution.scene, &solution.map, solution.solver, LW_TILE_CHANNEL_FULL,
                                   0, lw_convention_get((enum lw_convention_kind)kind), &err),
                      &err);
        lw_support_ok(lw_image_write_exr_with(path,
                                              &(struct lw_image_exr){.pixel = map.rgba,
                                                                     .width = map.width,
                                                                     .height = map.height,
                                                                     .channels = 4,
                                                                     .half = map.fits_half},
                                              &err),
                      &err);
        assert_true(map.fits_half);
        lw_support_ok(lw_image_read_exr_rgba(path, &rgba, &width, &height, &err), &err);
        double ratio = 0;
        for (int j = 0; j < GRID; j++)
            for (int i = 0; i < GRID; i++) {
                const double x = 0.9 * ((i + 0.5) / GRID - 0.5), z = 0.9 * ((j + 0.5) / GRID - 0.5);
                const float *texel = texel_at(&solution.scene->mesh[0], rgba, width, (float)x, (float)z);
                assert_true(texel[3] == 1);
                const double want = irradiance_at(x, z) * factor[kind];
                /* one texel: its noise, and that it is up to 1.8 cm from the point */
                expect_near((double)texel[0], want, 6 * (double)map.error + 0.03);
                ratio += (double)texel[0] / want / (GRID * GRID);
            }
        /* four standard errors of the mean, and the rounding to 16 bits */
        expect_near(ratio, 1, 4 * (double)map.error / GRID + 0.0005);
        assert_true(map.error > 0 && map.error < 0.05f);
        free(rgba);
        lw_map_finish(&map);
    }
    room_finish(&solution);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(a_baked_floor_has_the_form_factor_of_its_lamp)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
