/* bench_compare: one picture against another, region by region.
 *
 *     bench_compare PICTURE.exr REFERENCE.exr [SHOWN.png STOPS]
 *
 * Prints the ratio of the means (all channels), relMSE = mean((x - t)^2 / (t^2 + eps)), eps = 1 % of the
 * mean of t^2, FLIP (67 pixels per degree, Reinhard's curve at the reference's own exposure), how many of 8 x
 * 4 blocks are within 5 % and 10 % of the reference and the farthest, and the ratio in each. For pictures of
 * other renderers (cycles.py) and of other options. SHOWN.png is the picture at that exposure, by Reinhard's
 * curve, as lightwell-view writes it. */
#include "client/measure/figures/flip.h"
#include "client/view/tonemap.h"
#include "common/base/log.h"
#include "common/image/image.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define COLUMNS 8u
#define ROWS    4u
#define NEAR    0.05
#define NEARBY  0.1

struct picture {
    float *rgb;
    uint32_t width, height;
};

static double region_mean(const struct picture *p, uint32_t column, uint32_t row) {
    const uint32_t x0 = column * p->width / COLUMNS, x1 = (column + 1) * p->width / COLUMNS;
    const uint32_t y0 = row * p->height / ROWS, y1 = (row + 1) * p->height / ROWS;
    double sum = 0;
    for (uint32_t y = y0; y < y1; y++)
        for (size_t i = ((size_t)y * p->width + x0) * 3; i < ((size_t)y * p->width + x1) * 3; i++)
            sum += (double)p->rgb[i];
    return x1 > x0 && y1 > y0 ? sum / (3.0 * (x1 - x0) * (y1 - y0)) : 0;
}

/* What a display shows of a picture at an exposure, linear. */
static void display(const struct picture *p, float stops, float *out) {
    const float scale = exp2f(stops);
    for (size_t i = 0; i < (size_t)p->width * p->height; i++) {
        const float *rgb = p->rgb + 3 * i;
        const struct lw_vec3 shown =
            lw_tonemap_apply(LW_TONEMAP_REINHARD, lw_vec3(rgb[0] * scale, rgb[1] * scale, rgb[2] * scale));
        out[3 * i] = shown.x, out[3 * i + 1] = shown.y, out[3 * i + 2] = shown.z;
    }
}

/* NAN without memory. */
static double flip(const struct picture *x, const struct picture *t) {
    const size_t pixels = (size_t)t->width * t->height;
    float *shown = malloc(7 * pixels * sizeof *shown), *map = shown + 6 * pixels;
    const float stops = lw_tonemap_auto_stops(t->rgb, pixels);
    double mean = (double)NAN;
    struct lw_error err;
    if (!shown) return mean;
    display(t, stops, shown);
    display(x, stops, shown + 3 * pixels);
    if (lw_flip_map(shown, shown + 3 * pixels, t->width, t->height, LW_FLIP_PIXELS_PER_DEGREE, map, &err) ==
        LW_OK)
        mean = lw_flip_mean(map, NULL, pixels);
    free(shown);
    return mean;
}

static void report_blocks(const struct picture *x, const struct picture *t) {
    double low = (double)INFINITY, high = 0, ratio[ROWS][COLUMNS];
    uint32_t near = 0, nearby = 0;
    for (uint32_t r = 0; r < ROWS; r++)
        for (uint32_t c = 0; c < COLUMNS; c++) {
            ratio[r][c] = region_mean(x, c, r) / region_mean(t, c, r);
            near += fabs(ratio[r][c] - 1) <= NEAR;
            nearby += fabs(ratio[r][c] - 1) <= NEARBY;
            low = fmin(low, ratio[r][c]);
            high = fmax(high, ratio[r][c]);
        }
    printf("%u of %u blocks within 5 %%, %u within 10 %%, from %.3f to %.3f\n", near, ROWS * COLUMNS, nearby,
           low, high);
    for (uint32_t r = 0; r < ROWS; r++)
        for (uint32_t c = 0; c < COLUMNS; c++) printf("%7.4f%s", ratio[r][c], c + 1 < COLUMNS ? "" : "\n");
}

static void report(const struct picture *x, const struct picture *t) {
    const size_t floats = (size_t)x->width * x->height * 3;
    double sum[2] = {0}, square = 0, error = 0;
    for (size_t i = 0; i < floats; i++) {
        sum[0] += (double)x->rgb[i];
        sum[1] += (double)t->rgb[i];
        square += (double)t->rgb[i] * (double)t->rgb[i] / (double)floats;
    }
    for (size_t i = 0; i < floats; i++) {
        const double a = (double)x->rgb[i], b = (double)t->rgb[i];
        error += (a - b) * (a - b) / (b * b + 0.01 * square) / (double)floats;
    }
    printf("ratio of means %.4f, relMSE %.5f, FLIP %.4f, ", sum[0] / sum[1], error, flip(x, t));
    report_blocks(x, t);
}

static enum lw_status write_shown(const struct picture *p, const char *path, const char *stops,
                                  struct lw_error *err) {
    const size_t pixels = (size_t)p->width * p->height;
    uint8_t *srgb = malloc(3 * pixels);
    struct lw_tonemap tonemap;
    if (!srgb) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %s", path);
    lw_tonemap_init(&tonemap, LW_TONEMAP_REINHARD, strtof(stops, NULL));
    lw_tonemap_encode(&tonemap, p->rgb, pixels, 3, srgb);
    const enum lw_status status = lw_image_write_png(path, srgb, p->width, p->height, err);
    free(srgb);
    return status;
}

int main(int argc, char **argv) {
    struct lw_error err = {0};
    struct picture picture[2] = {0};
    enum lw_status status = LW_OK;
    lw_log_init("bench_compare", LW_LOG_WARNING);
    if (argc != 3 && argc != 5)
        status = lw_status_fail(&err, LW_USAGE, "bench_compare PICTURE.exr REFERENCE.exr [SHOWN.png STOPS]");
    for (int i = 0; status == LW_OK && i < 2; i++)
        status = lw_image_read_exr(argv[1 + i], &picture[i].rgb, &picture[i].width, &picture[i].height, &err);
    if (status == LW_OK && (picture[0].width != picture[1].width || picture[0].height != picture[1].height))
        status = lw_status_fail(&err, LW_BAD_DATA, "the pictures differ in size");
    if (status == LW_OK) report(&picture[0], &picture[1]);
    if (status == LW_OK && argc == 5) status = write_shown(&picture[0], argv[3], argv[4], &err);
    for (int i = 0; i < 2; i++) free(picture[i].rgb);
    return status == LW_OK ? 0 : lw_log_failure(&err);
}
