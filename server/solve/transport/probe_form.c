#include "server/solve/transport/probe_form.h"

#include "server/solve/transport/cube_map.h"
#include "server/solve/transport/octahedral.h"

#include <string.h>

/* ---- maps: sums of a cell are its weight, red, green, blue ---- */

static void add_to(float *cell, const float *radiance) {
    cell[0] += 1;
    for (int c = 0; c < 3; c++) cell[1 + c] += radiance[c];
}

/* The mean of the cells of a bordered square from low to before high, x and y, 0 at its border; false: no ray
 * has met them. */
static bool mean_of(const float *sums, uint32_t side, const uint32_t low[2], const uint32_t high[2],
                    float out_rgb[3]) {
    float sum[4] = {0};
    for (uint32_t y = low[1]; y < high[1]; y++)
        for (uint32_t x = low[0]; x < high[0]; x++)
            for (uint32_t c = 0; c < 4; c++) sum[c] += sums[(size_t)(y * (side + 2) + x) * 4 + c];
    for (int c = 0; sum[0] > 0 && c < 3; c++) out_rgb[c] = sum[1 + c] / sum[0];
    return sum[0] > 0;
}

/* The mean of each cell of a bordered square. A cell that no ray has met yet takes the mean of the nearest
 * ring of cells that rays have met, or `all` if there is none. */
static void square_to_map(const float *sums, uint32_t side, const float all[3], float *map) {
    for (uint32_t y = 1; y <= side; y++)
        for (uint32_t x = 1; x <= side; x++) {
            float *rgb = map + (size_t)(y * (side + 2) + x) * 3;
            bool known = false;
            for (uint32_t reach = 0; !known && reach < side; reach++) {
                const uint32_t low[2] = {x > reach ? x - reach : 1, y > reach ? y - reach : 1},
                               high[2] = {x + reach < side ? x + reach + 1 : side + 1,
                                          y + reach < side ? y + reach + 1 : side + 1};
                known = mean_of(sums, side, low, high, rgb);
            }
            if (!known) memcpy(rgb, all, 3 * sizeof *rgb);
        }
}

#define SIDE  16u
#define CELLS ((SIDE + 2) * (SIDE + 2))

static void octahedral_add(float *sum, struct lw_vec3 direction, const float *radiance) {
    add_to(sum + (size_t)lw_octahedral_cell(SIDE, direction) * 4, radiance);
}

static void octahedral_to_map(const float *mean, float *map) {
    square_to_map(mean, SIDE, (const float[3]){0, 0, 0}, map);
    lw_octahedral_wrap(map, SIDE, 3);
}

static struct lw_vec3 octahedral_read(const float *map, struct lw_vec3 direction) {
    float rgb[3];
    lw_octahedral_read(map, SIDE, 3, direction, rgb);
    return lw_vec3(rgb[0], rgb[1], rgb[2]);
}

/* The least side with as many cells as the octahedral map has. */
#define FACE_SIDE  7u
#define FACE_CELLS ((FACE_SIDE + 2) * (FACE_SIDE + 2))
#define CUBE_CELLS (LW_CUBE_MAP_FACES * FACE_CELLS)
_Static_assert(CUBE_CELLS * 4 <= LW_PROBE_FORM_FLOATS_MAX && CELLS * 4 <= LW_PROBE_FORM_FLOATS_MAX,
               "room for the sums of all forms");

static void cube_add(float *sum, struct lw_vec3 direction, const float *radiance) {
    add_to(sum + (size_t)lw_cube_map_cell(FACE_SIDE, direction) * 4, radiance);
}

static void cube_to_map(const float *mean, float *map) {
    float all[4] = {0};
    for (size_t i = 0; i < CUBE_CELLS; i++)
        for (size_t c = 0; c < 4; c++) all[c] += mean[i * 4 + c];
    for (int c = 1; all[0] > 0 && c < 4; c++) all[c] /= all[0];
    for (size_t face = 0; face < LW_CUBE_MAP_FACES; face++)
        square_to_map(mean + face * FACE_CELLS * 4, FACE_SIDE, all + 1, map + face * FACE_CELLS * 3);
    lw_cube_map_wrap(map, FACE_SIDE, 3);
}

static struct lw_vec3 cube_read(const float *map, struct lw_vec3 direction) {
    float rgb[3];
    lw_cube_map_read(map, FACE_SIDE, 3, direction, rgb);
    return lw_vec3(rgb[0], rgb[1], rgb[2]);
}

/* ---- spherical harmonics ---- */

#define COEFFICIENTS 9

/* Real spherical harmonics up to l = 2. */
static void basis(struct lw_vec3 d, float y[COEFFICIENTS]) {
    y[0] = 0.282095f;
    y[1] = 0.488603f * d.y;
    y[2] = 0.488603f * d.z;
    y[3] = 0.488603f * d.x;
    y[4] = 1.092548f * d.x * d.y;
    y[5] = 1.092548f * d.y * d.z;
    y[6] = 0.315392f * (3 * d.z * d.z - 1);
    y[7] = 1.092548f * d.x * d.z;
    y[8] = 0.546274f * (d.x * d.x - d.y * d.y);
}

static void sh_add(float *sum, struct lw_vec3 direction, const float *radiance) {
    float y[COEFFICIENTS];
    basis(direction, y);
    for (int k = 0; k < COEFFICIENTS; k++)
        for (int c = 0; c < 3; c++) sum[k * 3 + c] += 4 * LW_PI * y[k] * radiance[c];
}

static struct lw_vec3 sh_evaluate(const float *map, struct lw_vec3 direction) {
    float y[COEFFICIENTS], sum[3] = {0};
    basis(direction, y);
    for (int k = 0; k < COEFFICIENTS; k++)
        for (int c = 0; c < 3; c++) sum[c] += y[k] * map[k * 3 + c];
    return lw_vec3(sum[0], sum[1], sum[2]);
}

/* Where ringing is looked for: the axes, edges and corners of a cube are 26 directions some 40 degrees apart;
 * l = 2 has no lobe narrower than 60. */
static float lowest(const float *map) {
    float low = INFINITY;
    for (int z = -1; z <= 1; z++)
        for (int y = -1; y <= 1; y++)
            for (int x = -1; x <= 1; x++) {
                if (!x && !y && !z) continue;
                struct lw_vec3 value =
                    sh_evaluate(map, lw_vec3_normalize(lw_vec3((float)x, (float)y, (float)z)));
                low = fminf(low, fminf(value.x, fminf(value.y, value.z)));
            }
    return low;
}

/* Divides band l by 1 + lambda l^2 (l + 1)^2, which lowers the squared Laplacian (Sloan 2008,
 * "Windowing"), with the least lambda of a geometric series that leaves nothing below zero. The
 * mean over the sphere stays. */
static void sh_to_map(const float *mean, float *map) {
    for (int i = 0; i < COEFFICIENTS * 3; i++) map[i] = mean[i];
    for (float lambda = 0.005f; lambda < 100 && lowest(map) < 0; lambda *= 1.6f)
        for (int i = 3; i < COEFFICIENTS * 3; i++) map[i] = mean[i] / (1 + lambda * (i < 12 ? 4 : 36));
}

/* Between the sampled directions a little may be left below zero. */
static struct lw_vec3 sh_read(const float *map, struct lw_vec3 direction) {
    struct lw_vec3 value = sh_evaluate(map, direction);
    return lw_vec3(fmaxf(0, value.x), fmaxf(0, value.y), fmaxf(0, value.z));
}

static const struct lw_probe_form_ops forms[] = {
    [LW_PROBE_FORM_OCTAHEDRAL] = {"octahedral", CELLS * 4, CELLS * 3, octahedral_add, octahedral_to_map,
                                  octahedral_read},
    [LW_PROBE_FORM_SH] = {"sh", COEFFICIENTS * 3, COEFFICIENTS * 3, sh_add, sh_to_map, sh_read},
    [LW_PROBE_FORM_CUBE] = {"cube", CUBE_CELLS * 4, CUBE_CELLS * 3, cube_add, cube_to_map, cube_read}};

const struct lw_probe_form_ops *lw_probe_form(enum lw_probe_form_kind kind) { return &forms[kind]; }
