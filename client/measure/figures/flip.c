#include "client/measure/figures/flip.h"

#include "common/image/image.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Names and values of the paper's constants. */
#define Q_C 0.7f  /* exponent of colour differences */
#define P_C 0.4f  /* share of the largest colour difference ... */
#define P_T 0.95f /* ... that is mapped to this */
#define Q_F 0.5f  /* exponent of feature differences */
#define W   0.082 /* degrees: width of the edges that the eye is most sensitive to */
#define PI  3.14159265358979323846

/* Contrast sensitivity functions (Johnson and Fairchild 2003), transformed to space:
 * g(x) = sum of a sqrt(pi / b) exp(-pi^2 x^2 / b), x in degrees. */
enum { PART_Y, PART_CX, PART_CZ_1, PART_CZ_2, PART_COUNT };
static const struct {
    double a, b;
} sensitivity[PART_COUNT] = {
    [PART_Y] = {1, 0.0047}, [PART_CX] = {1, 0.0053}, [PART_CZ_1] = {34.1, 0.04}, [PART_CZ_2] = {13.5, 0.025}};
#define B_MAX 0.04

#define REACH 3.0 /* standard deviations at which filters end */
/* The widest filter, contrast sensitivity at most pixels per degree: ceil(3 sqrt(0.04 / 2) / pi * 1000). */
#define RADIUS_MAX 136
#define TAPS_MAX   (2 * RADIUS_MAX + 1)

struct filter {
    int radius;
    float tap[TAPS_MAX];
};

/* XYZ of linear sRGB over the XYZ of its white (IEC 61966-2-1 primaries, D65). */
static const double to_relative_xyz[3][3] = {
    {10135552 / 23359437.0, 8788810 / 23359437.0, 4435075 / 23359437.0},
    {2613072 / 12288897.0, 8788810 / 12288897.0, 887015 / 12288897.0},
    {1425312 / 80288307.0, 8788810 / 80288307.0, 70074185 / 80288307.0}};

static void invert(const double m[3][3], float out[3][3]) {
    double cofactor[3][3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int a = (i + 1) % 3, b = (i + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
            cofactor[i][j] = m[a][c] * m[b][d] - m[a][d] * m[b][c];
        }
    const double det = m[0][0] * cofactor[0][0] + m[0][1] * cofactor[0][1] + m[0][2] * cofactor[0][2];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) out[i][j] = (float)(cofactor[j][i] / det);
}

static void relative_xyz(const float rgb[3], float out[3]) {
    for (int i = 0; i < 3; i++)
        out[i] = (float)to_relative_xyz[i][0] * rgb[0] + (float)to_relative_xyz[i][1] * rgb[1] +
                 (float)to_relative_xyz[i][2] * rgb[2];
}

/* L*, a*, b* of what its name says, for CIE's f of each; YCxCz is the same of the values themselves. */
static void opponents(const float f[3], float out[3]) {
    out[0] = 116 * f[1] - 16;
    out[1] = 500 * (f[0] - f[1]);
    out[2] = 200 * (f[1] - f[2]);
}

/* L*a*b* (CIE 15) whose chroma falls with luminance, as the Hunt effect has it. */
static void hunt_lab(const float rgb[3], float out[3]) {
    const float delta = 6.0f / 29;
    float f[3];
    relative_xyz(rgb, f);
    for (int i = 0; i < 3; i++)
        f[i] = f[i] > delta * delta * delta ? cbrtf(f[i]) : f[i] / (3 * delta * delta) + 4.0f / 29;
    opponents(f, out);
    out[1] *= 0.01f * out[0];
    out[2] *= 0.01f * out[0];
}

/* Abasi et al. 2020: fit for large differences. */
static float hyab(const float a[3], const float b[3]) {
    return fabsf(a[0] - b[0]) + sqrtf((a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
}

/* The largest difference there is in sRGB: of green and blue. */
static float largest_difference(void) {
    float green[3], blue[3];
    hunt_lab((float[3]){0, 1, 0}, green);
    hunt_lab((float[3]){0, 0, 1}, blue);
    return powf(hyab(green, blue), Q_C);
}

static float colour_difference(const float a[3], const float b[3], float largest) {
    const float e = powf(hyab(a, b), Q_C), knee = P_C * largest;
    return e < knee ? e * (P_T / knee) : P_T + (e - knee) / (largest - knee) * (1 - P_T);
}

/* A part of a contrast sensitivity function along one axis. Applied along both axes it counts with the square
 * of its scale. So each axis takes the root of the amplitude; then two parts add up as in the plane. */
static void sensitivity_filters(double pixels_per_degree, struct filter out[PART_COUNT]) {
    const int radius = (int)ceil(REACH * sqrt(B_MAX / (2 * PI * PI)) * pixels_per_degree);
    double tap[PART_COUNT][TAPS_MAX], sum[PART_COUNT] = {0};
    for (int p = 0; p < PART_COUNT; p++)
        for (int k = 0; k <= 2 * radius; k++) {
            const double x = (k - radius) / pixels_per_degree, b = sensitivity[p].b;
            tap[p][k] = sqrt(sensitivity[p].a * sqrt(PI / b)) * exp(-PI * PI * x * x / b);
            sum[p] += tap[p][k];
        }
    const double cz = hypot(sum[PART_CZ_1], sum[PART_CZ_2]);
    const double scale[PART_COUNT] = {sum[PART_Y], sum[PART_CX], cz, cz};
    for (int p = 0; p < PART_COUNT; p++) {
        out[p].radius = radius;
        for (int k = 0; k <= 2 * radius; k++) out[p].tap[k] = (float)(tap[p][k] / scale[p]);
    }
}

/* A Gaussian and its first and second derivative. The Gaussian's weights add up to 1; the positive ones of
 * either derivative to 1 and the negative ones to -1. */
enum { ORDER_0, ORDER_1, ORDER_2, ORDER_COUNT };
static void feature_filters(double pixels_per_degree, struct filter out[ORDER_COUNT]) {
    const double deviation = 0.5 * W * pixels_per_degree;
    const int radius = (int)ceil(REACH * deviation);
    double tap[ORDER_COUNT][TAPS_MAX], positive[ORDER_COUNT] = {0}, negative[ORDER_COUNT] = {0};
    for (int k = 0; k <= 2 * radius; k++) {
        const double x = (k - radius) / deviation, g = exp(-0.5 * x * x);
        tap[ORDER_0][k] = g;
        tap[ORDER_1][k] = -x * g;
        tap[ORDER_2][k] = (x * x - 1) * g;
        for (int o = 0; o < ORDER_COUNT; o++)
            *(tap[o][k] > 0 ? &positive[o] : &negative[o]) += fabs(tap[o][k]);
    }
    for (int o = 0; o < ORDER_COUNT; o++) {
        out[o].radius = radius;
        for (int k = 0; k <= 2 * radius; k++)
            out[o].tap[k] = (float)(tap[o][k] / (tap[o][k] > 0     ? positive[o]
                                                 : negative[o] > 0 ? negative[o]
                                                                   : 1));
    }
}

static size_t clamped(int64_t i, uint32_t count) {
    return i < 0 ? 0 : i < (int64_t)count ? (size_t)i : count - 1u;
}

struct size {
    uint32_t width, height;
};

static void filter_rows(const struct filter *f, const float *in, struct size size, float *out) {
    for (uint32_t y = 0; y < size.height; y++) {
        const float *from = in + (size_t)y * size.width;
        float *to = out + (size_t)y * size.width;
        memset(to, 0, size.width * sizeof *to);
        for (int k = -f->radius; k <= f->radius; k++) {
            const float tap = f->tap[k + f->radius];
            const int64_t width = size.width;
            /* Within [left, right) the tap lies inside the picture. */
            const int64_t left = k < 0 ? (-k < width ? -k : width) : 0;
            const int64_t right = k > 0 ? (k < width ? width - k : 0) : width;
            for (int64_t x = 0; x < left; x++) to[x] += tap * from[0];
            for (int64_t x = left; x < right; x++) to[x] += tap * from[x + k];
            for (int64_t x = right > left ? right : left; x < width; x++) to[x] += tap * from[width - 1];
        }
    }
}

static void filter_columns(const struct filter *f, const float *in, struct size size, float *out) {
    for (uint32_t y = 0; y < size.height; y++) {
        float *to = out + (size_t)y * size.width;
        memset(to, 0, size.width * sizeof *to);
        for (int k = -f->radius; k <= f->radius; k++) {
            const float tap = f->tap[k + f->radius];
            const float *from = in + clamped((int64_t)y + k, size.height) * size.width;
            for (uint32_t x = 0; x < size.width; x++) to[x] += tap * from[x];
        }
    }
}

/* Planes that pictures are compared by, a float a pixel. */
enum { SEEN_L, SEEN_A, SEEN_B, SEEN_EDGE, SEEN_POINT, SEEN_COUNT };
#define SCRATCH_COUNT 8
#define PLANE_COUNT   (2 * SEEN_COUNT + SCRATCH_COUNT)

struct job {
    struct size size;
    size_t pixel_count;
    struct filter sensitivity[PART_COUNT], feature[ORDER_COUNT];
    float to_rgb[3][3]; /* from XYZ over white */
    float *seen[2][SEEN_COUNT];
    float *scratch[SCRATCH_COUNT];
};

static float unit(float x) { return x > 0 ? (x < 1 ? x : 1) : 0; } /* NaN: 0 */

/* Linear RGB to planes of YCxCz, in scratch 0 to 2. */
static void split(struct job *job, const float *rgb) {
    for (size_t i = 0; i < job->pixel_count; i++) {
        const float clipped[3] = {unit(rgb[3 * i]), unit(rgb[3 * i + 1]), unit(rgb[3 * i + 2])};
        float xyz[3], ycxcz[3];
        relative_xyz(clipped, xyz);
        opponents(xyz, ycxcz);
        for (int c = 0; c < 3; c++) job->scratch[c][i] = ycxcz[c];
    }
}

static void filter_colours(struct job *job, float *const seen[SEEN_COUNT]) {
    static const int plane[PART_COUNT] = {0, 1, 2, 2};
    for (int p = 0; p < PART_COUNT; p++) {
        filter_rows(&job->sensitivity[p], job->scratch[plane[p]], job->size, job->scratch[7]);
        filter_columns(&job->sensitivity[p], job->scratch[7], job->size, job->scratch[3 + p]);
    }
    for (size_t i = 0; i < job->pixel_count; i++) {
        const float cz = job->scratch[3 + PART_CZ_1][i] + job->scratch[3 + PART_CZ_2][i];
        const float y = (job->scratch[3 + PART_Y][i] + 16) / 116;
        const float xyz[3] = {y + job->scratch[3 + PART_CX][i] / 500, y, y - cz / 200};
        float rgb[3], lab[3];
        for (int c = 0; c < 3; c++)
            rgb[c] =
                unit(job->to_rgb[c][0] * xyz[0] + job->to_rgb[c][1] * xyz[1] + job->to_rgb[c][2] * xyz[2]);
        hunt_lab(rgb, lab);
        for (int c = 0; c < 3; c++) seen[SEEN_L + c][i] = lab[c];
    }
}

/* Length of the gradient, or of the two second derivatives, of luminance in [0, 1]. */
static void filter_feature(struct job *job, int order, float *out) {
    float *rows = job->scratch[3], *across = job->scratch[4], *down = job->scratch[5];
    filter_rows(&job->feature[order], job->scratch[0], job->size, rows);
    filter_columns(&job->feature[ORDER_0], rows, job->size, across);
    filter_rows(&job->feature[ORDER_0], job->scratch[0], job->size, rows);
    filter_columns(&job->feature[order], rows, job->size, down);
    for (size_t i = 0; i < job->pixel_count; i++) out[i] = hypotf(across[i], down[i]);
}

static void filter(struct job *job, const float *rgb, float *const seen[SEEN_COUNT]) {
    split(job, rgb);
    filter_colours(job, seen);
    for (size_t i = 0; i < job->pixel_count; i++) job->scratch[0][i] = (job->scratch[0][i] + 16) / 116;
    filter_feature(job, ORDER_1, seen[SEEN_EDGE]);
    filter_feature(job, ORDER_2, seen[SEEN_POINT]);
}

static void compare(const struct job *job, float *out_map) {
    const float largest = largest_difference();
    float *const *a = job->seen[0], *const *b = job->seen[1];
    for (size_t i = 0; i < job->pixel_count; i++) {
        const float colour = colour_difference((float[3]){a[SEEN_L][i], a[SEEN_A][i], a[SEEN_B][i]},
                                               (float[3]){b[SEEN_L][i], b[SEEN_A][i], b[SEEN_B][i]}, largest);
        const float edge = fabsf(a[SEEN_EDGE][i] - b[SEEN_EDGE][i]);
        const float point = fabsf(a[SEEN_POINT][i] - b[SEEN_POINT][i]);
        const float feature = powf(unit(fmaxf(edge, point) * sqrtf(0.5f)), Q_F);
        out_map[i] = unit(powf(colour, 1 - feature));
    }
}

enum lw_status lw_flip_map(const float *reference_rgb, const float *test_rgb, uint32_t width, uint32_t height,
                           float pixels_per_degree, float *out_map, struct lw_error *err) {
    if (!width || !height || width > LW_IMAGE_SIDE_MAX || height > LW_IMAGE_SIDE_MAX)
        return lw_status_fail(err, LW_USAGE, "pictures of %u x %u pixels; each side is from 1 to %u", width,
                              height, LW_IMAGE_SIDE_MAX);
    if (!(pixels_per_degree >= LW_FLIP_PIXELS_PER_DEGREE_MIN &&
          pixels_per_degree <= LW_FLIP_PIXELS_PER_DEGREE_MAX))
        return lw_status_fail(err, LW_USAGE, "%g pixels per degree; there are from %g to %g",
                              (double)pixels_per_degree, (double)LW_FLIP_PIXELS_PER_DEGREE_MIN,
                              (double)LW_FLIP_PIXELS_PER_DEGREE_MAX);
    struct job job = {.size = {width, height}, .pixel_count = (size_t)width * height};
    float *plane = malloc(job.pixel_count * PLANE_COUNT * sizeof *plane);
    if (!plane)
        return lw_status_fail(err, LW_NO_MEMORY, "no memory to compare pictures of %u x %u pixels", width,
                              height);
    float *next = plane;
    for (int p = 0; p < 2 * SEEN_COUNT; p++, next += job.pixel_count)
        job.seen[p / SEEN_COUNT][p % SEEN_COUNT] = next;
    for (int p = 0; p < SCRATCH_COUNT; p++, next += job.pixel_count) job.scratch[p] = next;
    sensitivity_filters((double)pixels_per_degree, job.sensitivity);
    feature_filters((double)pixels_per_degree, job.feature);
    invert(to_relative_xyz, job.to_rgb);

    filter(&job, reference_rgb, job.seen[0]);
    filter(&job, test_rgb, job.seen[1]);
    compare(&job, out_map);
    free(plane);
    return LW_OK;
}

double lw_flip_mean(const float *map, const uint8_t *left_out, size_t pixel_count) {
    double sum = 0;
    size_t count = 0;
    for (size_t i = 0; i < pixel_count; i++) {
        if (left_out && left_out[i]) continue;
        sum += (double)map[i];
        count++;
    }
    return count ? sum / (double)count : 0;
}
