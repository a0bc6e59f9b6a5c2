#include "client/load/truth.h"

#include <stdlib.h>
#include <string.h>

#define FLOOR_SHARE 0.01 /* of the mean square of the truth */
#define DARK_SHARE  1e-4 /* of the views' mean square: a hundredth of their brightness */
#define STRIDE_MAX  7u

uint32_t lw_truth_stride(uint32_t width, uint32_t height) {
    for (uint32_t stride = STRIDE_MAX; stride > 1; stride -= 2)
        if (width % stride == 0 && height % stride == 0) return stride;
    return 1;
}

static size_t value_count(const struct lw_truth *truth) { return (size_t)truth->width * truth->height * 3; }

static double at(const struct lw_truth *truth, size_t i) {
    return 0.5 * ((double)truth->half[0][i] + (double)truth->half[1][i]);
}

/* What squares are divided by, without the pixel's own. */
static double floor_of(const struct lw_truth *truth) { return FLOOR_SHARE * truth->mean_square; }

enum lw_status lw_truth_init(struct lw_truth *truth, const struct lw_path_world *world,
                             const struct lw_camera_view *camera, uint32_t width, uint32_t height,
                             uint32_t samples, uint32_t seed, struct lw_error *err) {
    struct lw_path_film film;
    enum lw_status status = lw_path_film_init(&film, width, height, err);
    if (status != LW_OK) return status;
    lw_path_world_render(world, &(struct lw_path_view){.camera = *camera, .seed = seed}, samples, &film);
    *truth = (struct lw_truth){.width = width, .height = height, .half = {film.half[0], film.half[1]}};
    const float scale = 2.0f / (float)samples;
    for (size_t i = 0; i < value_count(truth); i++) truth->half[0][i] *= scale, truth->half[1][i] *= scale;

    for (size_t i = 0; i < value_count(truth); i++) truth->mean_square += at(truth, i) * at(truth, i);
    truth->mean_square /= (double)value_count(truth);
    const double floor = floor_of(truth);
    for (size_t i = 0; i < value_count(truth); i++) {
        double off = 0.5 * ((double)truth->half[0][i] - (double)truth->half[1][i]);
        if (floor > 0) truth->noise += off * off / (at(truth, i) * at(truth, i) + floor);
    }
    truth->noise /= (double)value_count(truth);
    return LW_OK;
}

void lw_truth_finish(struct lw_truth *truth) {
    free(truth->half[0]);
    free(truth->half[1]);
    *truth = (struct lw_truth){0};
}

double lw_truth_error(const struct lw_truth *truth, const float *rgb) {
    const double floor = floor_of(truth);
    double sum = 0;
    if (!(floor > 0)) return 0; /* black: whatever is seen is the emission of nothing */
    for (size_t i = 0; i < value_count(truth); i++) {
        double x = (double)rgb[i];
        sum += (x - (double)truth->half[0][i]) * (x - (double)truth->half[1][i]) /
               (at(truth, i) * at(truth, i) + floor);
    }
    return sum / (double)value_count(truth);
}

bool lw_truth_is_dark(const struct lw_truth *truth, double mean_square) {
    return truth->mean_square <= DARK_SHARE * mean_square;
}

void lw_truth_pick(const float *rgb, uint32_t width, uint32_t height, uint32_t stride, float *out_lattice) {
    for (uint32_t y = stride / 2; y < height; y += stride)
        for (uint32_t x = stride / 2; x < width; x += stride, out_lattice += 3)
            memcpy(out_lattice, rgb + 3 * ((size_t)y * width + x), 3 * sizeof *rgb);
}
