#include "server/solve/transport/probe_form.h"

#include "server/solve/transport/octahedral.h"

#define SIDE  16u
#define CELLS ((SIDE + 2) * (SIDE + 2))

/* Sums: weight, red, green, blue per cell. */
static void octahedral_add(float *sum, struct lw_vec3 direction, const float *radiance) {
    float *cell = sum + (size_t)lw_octahedral_cell(SIDE, direction) * 4;
    cell[0] += 1;
    for (int c = 0; c < 3; c++) cell[1 + c] += radiance[c];
}

/* The mean of a cell that no ray has met yet: that of the nearest ring of cells
 * around it that rays have met. */
static void fill_from_neighbours(const float *mean, uint32_t x, uint32_t y, float *out_rgb) {
    for (uint32_t reach = 1; reach < SIDE; reach++) {
        float sum[4] = {0};
        uint32_t x0 = x > reach ? x - reach : 1, x1 = x + reach < SIDE ? x + reach : SIDE;
        uint32_t y0 = y > reach ? y - reach : 1, y1 = y + reach < SIDE ? y + reach : SIDE;
        for (uint32_t j = y0; j <= y1; j++)
            for (uint32_t i = x0; i <= x1; i++)
                for (int c = 0; c < 4; c++) sum[c] += mean[(size_t)(j * (SIDE + 2) + i) * 4 + (size_t)c];
        if (!(sum[0] > 0)) continue;
        for (int c = 0; c < 3; c++) out_rgb[c] = sum[1 + c] / sum[0];
        return;
    }
    out_rgb[0] = out_rgb[1] = out_rgb[2] = 0;
}

static void octahedral_settle(const float *mean, float *map) {
    for (uint32_t y = 1; y <= SIDE; y++)
        for (uint32_t x = 1; x <= SIDE; x++) {
            const size_t i = y * (SIDE + 2) + x;
            if (mean[i * 4] > 0)
                for (size_t c = 0; c < 3; c++) map[i * 3 + c] = mean[i * 4 + 1 + c] / mean[i * 4];
            else
                fill_from_neighbours(mean, x, y, map + i * 3);
        }
    lw_octahedral_wrap(map, SIDE, 3);
}

static struct lw_vec3 octahedral_read(const float *map, struct lw_vec3 direction) {
    float rgb[3];
    lw_octahedral_read(map, SIDE, 3, direction, rgb);
    return lw_vec3(rgb[0], rgb[1], rgb[2]);
}

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
static void sh_settle(const float *mean, float *map) {
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
    [LW_PROBE_FORM_OCTAHEDRAL] = {"octahedral", CELLS * 4, CELLS * 3, octahedral_add, octahedral_settle,
                                  octahedral_read},
    [LW_PROBE_FORM_SH] = {"sh", COEFFICIENTS * 3, COEFFICIENTS * 3, sh_add, sh_settle, sh_read}};

const struct lw_probe_form_ops *lw_probe_form(enum lw_probe_form_kind kind) { return &forms[kind]; }
