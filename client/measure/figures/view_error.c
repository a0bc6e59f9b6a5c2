#include "client/measure/figures/view_error.h"

#include "client/measure/figures/flip.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>

/* Standard errors by which light must change from other moments to the last one, for a lag to be known. 4 x 4
 * pixels of a reference share random numbers (path_trace.h), so that a standard error over pixels is not what
 * it seems: light that stands still came to 0.9 and 3.8 of them (Cornell box, 64 and 16 paths a pixel). */
#define CHANGE_SIGMA 6.0

void lw_view_error_init(struct lw_view_error_sum *sum, const struct lw_view_error_desc *desc) {
    *sum = (struct lw_view_error_sum){.desc = *desc};
    if (!(sum->desc.pixels_per_degree > 0)) sum->desc.pixels_per_degree = LW_FLIP_PIXELS_PER_DEGREE;
}

void lw_view_error_finish(struct lw_view_error_sum *sum) {
    free(sum->pixel);
    *sum = (struct lw_view_error_sum){0};
}

static size_t pixels_of(const struct lw_view_error_reference *reference) {
    return (size_t)reference->width * reference->height;
}

static bool counts(const struct lw_view_error_reference *reference, size_t pixel) {
    if (reference->left_out && reference->left_out[pixel]) return false;
    for (size_t i = 3 * pixel; i < 3 * pixel + 3; i++)
        if (!isfinite(reference->half[0][i]) || !isfinite(reference->half[1][i])) return false;
    return true;
}

static double half_of(const struct lw_view_error_reference *reference, int half, size_t value) {
    return (double)reference->half[half][value];
}

static double mean_of(const struct lw_view_error_reference *reference, size_t value) {
    return 0.5 * (half_of(reference, 0, value) + half_of(reference, 1, value));
}

static double finite_value(const float *picture, size_t value) {
    return isfinite(picture[value]) ? (double)picture[value] : 0;
}

/* product over t^2 + epsilon */
static double relative(double product, double reference, double epsilon) {
    const double weight = reference * reference + epsilon;
    if (weight > 0) return product / weight;
    return product > 0 ? (double)INFINITY : 0;
}

double lw_view_error_relmse(const struct lw_view_error_reference *reference, const float *const picture[2],
                            double epsilon) {
    double sum = 0;
    size_t count = 0;
    for (size_t p = 0; p < pixels_of(reference); p++) {
        if (!counts(reference, p)) continue;
        for (size_t i = 3 * p; i < 3 * p + 3; i++, count++) {
            double product = 1;
            for (int h = 0; h < 2; h++) product *= finite_value(picture[h], i) - half_of(reference, h, i);
            sum += relative(product, mean_of(reference, i), epsilon);
        }
    }
    return count ? sum / (double)count : (double)NAN;
}

/* ---- one picture ---- */

/* Light as a display shows it. */
static void to_display(const struct lw_view_error_desc *desc, const float light[3], float out_rgb[3]) {
    const float scale = exp2f(fminf(fmaxf(desc->stops, -LW_TONEMAP_STOPS_MAX), LW_TONEMAP_STOPS_MAX));
    const struct lw_vec3 exposed = lw_vec3_scale(lw_vec3(light[0], light[1], light[2]), scale);
    const struct lw_vec3 c = lw_tonemap_apply(desc->curve, exposed);
    out_rgb[0] = c.x, out_rgb[1] = c.y, out_rgb[2] = c.z;
}

/* Pixels that are left out are black on both sides: FLIP's filters bring no difference from there to
 * neighbours. */
static enum lw_status add_flip(struct lw_view_error_sum *sum, const struct lw_view_error_reference *reference,
                               const float *picture, struct lw_error *err) {
    const size_t count = pixels_of(reference);
    float *shown = malloc(count * 7 * sizeof *shown + count + 1);
    if (!shown) return lw_status_fail(err, LW_NO_MEMORY, "no memory to compare a view");
    float *test = shown + 3 * count, *map = test + 3 * count;
    uint8_t *left_out = (uint8_t *)(map + count);
    for (size_t p = 0; p < count; p++) {
        left_out[p] = !counts(reference, p);
        float light[2][3] = {{0}};
        for (size_t c = 0; c < 3 && !left_out[p]; c++) {
            light[0][c] = (float)mean_of(reference, 3 * p + c);
            light[1][c] = (float)finite_value(picture, 3 * p + c);
        }
        to_display(&sum->desc, light[0], shown + 3 * p);
        to_display(&sum->desc, light[1], test + 3 * p);
    }
    enum lw_status status =
        lw_flip_map(shown, test, reference->width, reference->height, sum->desc.pixels_per_degree, map, err);
    for (size_t p = 0; p < count && status == LW_OK; p++) {
        if (left_out[p]) continue;
        sum->flip += (double)map[p];
        sum->flip_count++;
    }
    free(shown);
    return status;
}

static enum lw_status reserve(struct lw_view_error_sum *sum, size_t more, struct lw_error *err) {
    if (more <= sum->pixel_capacity - sum->pixel_count) return LW_OK;
    const size_t twice = 2 * sum->pixel_capacity, needed = sum->pixel_count + more;
    const size_t capacity = twice > needed ? twice : needed;
    float *pixel = realloc(sum->pixel, capacity * sizeof *pixel);
    if (!pixel) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the errors of %zu pixels", capacity);
    sum->pixel = pixel;
    sum->pixel_capacity = capacity;
    return LW_OK;
}

enum lw_status lw_view_error_add(struct lw_view_error_sum *sum,
                                 const struct lw_view_error_reference *reference, const float *picture,
                                 struct lw_error *err) {
    enum lw_status status = reserve(sum, pixels_of(reference), err);
    if (status == LW_OK) status = add_flip(sum, reference, picture, err);
    if (status != LW_OK) return status;
    for (size_t p = 0; p < pixels_of(reference); p++) {
        if (!counts(reference, p)) continue;
        double pixel = 0;
        for (size_t i = 3 * p; i < 3 * p + 3; i++) {
            const double x = finite_value(picture, i), t = mean_of(reference, i);
            const double product = (x - half_of(reference, 0, i)) * (x - half_of(reference, 1, i));
            pixel += relative(product, t, sum->desc.epsilon);
            sum->relative_fixed += relative(product, t, LW_VIEW_ERROR_FIXED_EPSILON);
            sum->not_finite += !isfinite(picture[i]);
        }
        sum->relative += pixel;
        sum->pixel[sum->pixel_count++] = (float)(pixel / 3);
    }
    return LW_OK;
}

/* ---- several moments ---- */

void lw_view_error_add_step(struct lw_view_error_sum *sum, const struct lw_view_error_reference *before,
                            const float *picture_before, const struct lw_view_error_reference *reference,
                            const float *picture) {
    assert(before->width == reference->width && before->height == reference->height);
    for (size_t p = 0; p < pixels_of(reference); p++) {
        if (!counts(reference, p) || !counts(before, p)) continue;
        for (size_t i = 3 * p; i < 3 * p + 3; i++) {
            const double step = finite_value(picture, i) - finite_value(picture_before, i);
            double product = 1;
            for (int h = 0; h < 2; h++) product *= step - (half_of(reference, h, i) - half_of(before, h, i));
            sum->flicker += relative(product, mean_of(reference, i), sum->desc.epsilon);
            sum->flicker_count++;
        }
    }
}

/* The mean of (x - t_m)(x - t_n), without the references' noise. */
static double product_of(const struct lw_view_error_reference *m, const struct lw_view_error_reference *n,
                         double x, size_t i) {
    return 0.5 * ((x - half_of(m, 0, i)) * (x - half_of(n, 1, i)) +
                  (x - half_of(n, 0, i)) * (x - half_of(m, 1, i)));
}

void lw_view_error_add_lag(struct lw_view_error_sum *sum, const struct lw_view_error_reference *moment,
                           uint32_t moment_count, const float *picture) {
    assert(moment_count >= 2 && moment_count <= LW_VIEW_ERROR_MOMENTS_MAX);
    assert(!sum->moment_count || sum->moment_count == moment_count);
    sum->moment_count = moment_count;
    const struct lw_view_error_reference *now = &moment[moment_count - 1];
    for (uint32_t m = 0; m < moment_count; m++)
        assert(moment[m].width == now->width && moment[m].height == now->height);
    for (size_t p = 0; p < pixels_of(now); p++) {
        bool all = true;
        for (uint32_t m = 0; m < moment_count; m++) all = all && counts(&moment[m], p);
        if (!all) continue;
        double change = 0, noise = 0;
        for (size_t i = 3 * p; i < 3 * p + 3; i++) {
            const double x = finite_value(picture, i), t = mean_of(now, i), epsilon = sum->desc.epsilon;
            for (uint32_t m = 0; m < moment_count; m++) {
                sum->fit[m] += relative(product_of(&moment[m], &moment[m], x, i), t, epsilon);
                if (m + 1 == moment_count) break;
                sum->fit_of_neighbours[m] +=
                    relative(product_of(&moment[m], &moment[m + 1], x, i), t, epsilon);
                const double a = half_of(now, 0, i) - half_of(&moment[m], 0, i);
                const double b = half_of(now, 1, i) - half_of(&moment[m], 1, i);
                change += relative(a * b, t, epsilon);
                /* Without a change, a * b has the deviation of the variance of either. */
                noise += relative(0.5 * (a - b) * (a - b), t, epsilon);
            }
        }
        sum->change += change;
        sum->change_noise_square += noise * noise;
        sum->lag_count += 3;
    }
}

/* ---- the figures ---- */

/* Puts the `first` least of count values first (Hoare's selection). */
static void select_least(float *value, size_t count, size_t first) {
    size_t low = 0, high = count;
    while (high - low > 1) {
        const float pivot = value[low + (high - low) / 2];
        size_t i = low, j = high - 1;
        for (;;) {
            while (value[i] < pivot) i++;
            while (value[j] > pivot) j--;
            if (i >= j) break;
            const float swapped = value[i];
            value[i++] = value[j];
            value[j--] = swapped;
        }
        /* Values before i are at most the pivot, those from there on at least. There are
         * some of either: the pivot was not the first value. */
        if (first == i) return;
        if (first < i)
            high = i;
        else
            low = i;
    }
}

static double trimmed(struct lw_view_error_sum *sum) {
    const size_t worst = (size_t)((double)sum->pixel_count * LW_VIEW_ERROR_WORST_SHARE);
    const size_t kept = sum->pixel_count - worst;
    if (worst) select_least(sum->pixel, sum->pixel_count, kept);
    double total = 0;
    for (size_t p = 0; p < kept; p++) total += (double)sum->pixel[p];
    return kept ? total / (double)kept : (double)NAN;
}

/* The least of p0 (1 - f)^2 + 2 q f (1 - f) + p1 f^2 over f in [0, 1]. */
static double least_of_mix(double p0, double q, double p1, double *out_share) {
    const double bend = p0 - 2 * q + p1;
    double f = p1 <= p0 ? 1 : 0;
    if (bend > 0) f = fmin(fmax((p0 - q) / bend, 0), 1);
    *out_share = f;
    return p0 * (1 - f) * (1 - f) + 2 * q * f * (1 - f) + p1 * f * f;
}

static void find_lag(const struct lw_view_error_sum *sum, struct lw_view_error *error) {
    const uint32_t last = sum->moment_count - 1;
    const double count = (double)sum->lag_count;
    double least = (double)INFINITY, age = 0;
    for (uint32_t m = last; m-- > 0;) { /* the latest wins among equal fits */
        double share;
        const double fit = least_of_mix(sum->fit[m], sum->fit_of_neighbours[m], sum->fit[m + 1], &share);
        if (!(fit < least)) continue;
        least = fit;
        age = (double)(last - m) - share;
    }
    error->lag_relmse = least / count;
    error->lag_relmse_now = sum->fit[last] / count;
    if (sum->change > CHANGE_SIGMA * sqrt(sum->change_noise_square))
        error->lag_s = age * sum->desc.moment_distance_s;
}

struct lw_view_error lw_view_error_of(struct lw_view_error_sum *sum) {
    const double none = (double)NAN, values = 3.0 * (double)sum->pixel_count;
    struct lw_view_error error = {.relmse = none,
                                  .relmse_fixed = none,
                                  .relmse_trimmed = none,
                                  .flip = none,
                                  .flicker = none,
                                  .lag_s = none,
                                  .lag_relmse = none,
                                  .lag_relmse_now = none,
                                  .pixel_count = sum->pixel_count,
                                  .not_finite = sum->not_finite};
    if (sum->pixel_count) {
        error.relmse = sum->relative / values;
        error.relmse_fixed = sum->relative_fixed / values;
        error.relmse_trimmed = trimmed(sum);
    }
    if (sum->flip_count) error.flip = sum->flip / (double)sum->flip_count;
    if (sum->flicker_count) error.flicker = sum->flicker / (double)sum->flicker_count;
    if (sum->lag_count) find_lag(sum, &error);
    return error;
}
