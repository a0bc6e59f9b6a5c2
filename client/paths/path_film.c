#include "client/paths/path_film.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define FLOOR_SHARE 0.01 /* share of the mean square that is added to each square */

static size_t value_count(const struct lw_path_film *film) { return (size_t)film->width * film->height * 3; }

enum lw_status lw_path_film_init(struct lw_path_film *film, uint32_t width, uint32_t height,
                                 struct lw_error *err) {
    struct lw_path_film f = {.width = width, .height = height};
    for (int h = 0; h < 2; h++) f.half[h] = calloc(value_count(&f), sizeof *f.half[h]);
    if (f.half[0] == NULL || f.half[1] == NULL) {
        lw_path_film_finish(&f);
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for a picture of %ux%u pixels", width, height);
    }
    *film = f;
    return LW_OK;
}

void lw_path_film_finish(struct lw_path_film *film) {
    free(film->half[0]);
    free(film->half[1]);
    *film = (struct lw_path_film){0};
}

void lw_path_film_clear(struct lw_path_film *film) {
    film->samples = 0;
    for (int h = 0; h < 2; h++) memset(film->half[h], 0, value_count(film) * sizeof *film->half[h]);
}

void lw_path_film_resolve(const struct lw_path_film *film, float *out_rgb) {
    const float scale = film->samples ? 1.0f / (float)film->samples : 0;
    for (size_t i = 0; i < value_count(film); i++) out_rgb[i] = (film->half[0][i] + film->half[1][i]) * scale;
}

double lw_path_film_error(const struct lw_path_film *film) {
    if (film->samples < 2) return (double)INFINITY;
    /* The even half has the odd sample more. */
    const double scale[2] = {1.0 / ((film->samples + 1) / 2), 1.0 / (film->samples / 2)};
    const size_t count = value_count(film);
    double square = 0;
    for (size_t i = 0; i < count; i++) {
        double x = (double)film->half[0][i] + (double)film->half[1][i];
        square += x * x;
    }
    square /= (double)film->samples * film->samples * (double)count;
    if (!(square > 0)) return 0;

    double sum = 0;
    for (size_t i = 0; i < count; i++) {
        double a = (double)film->half[0][i] * scale[0], b = (double)film->half[1][i] * scale[1];
        double x = 0.5 * (a + b), off = 0.5 * (a - b); /* Var((a + b) / 2) = E((a - b)^2) / 4 */
        sum += off * off / (x * x + FLOOR_SHARE * square);
    }
    return sqrt(sum / (double)count);
}
