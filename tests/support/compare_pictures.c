/* compare_pictures.c: how different two pictures are, for tests that are not in C:
 *     compare_pictures WIDTH HEIGHT REFERENCE TEST
 * Both files hold WIDTH * HEIGHT pixels of 3 bytes, sRGB, row 0 on top. Prints the mean difference of a
 * channel in 255ths, and the mean of FLIP. */
#include "client/measure/figures/flip.h"
#include "common/base/colour.h"

#include <stdio.h>
#include <stdlib.h>

static uint8_t *read_picture(const char *path, size_t size) {
    uint8_t *bytes = malloc(size + 1);
    FILE *file = fopen(path, "rb");
    const bool fits = bytes && file && fread(bytes, 1, size + 1, file) == size;
    if (file) fclose(file);
    if (fits) return bytes;
    fprintf(stderr, "compare_pictures: %s has not %zu bytes\n", path, size);
    free(bytes);
    return NULL;
}

static void linearize(const uint8_t *srgb, size_t count, float *out) {
    for (size_t i = 0; i < count; i++) out[i] = lw_colour_from_srgb8(srgb[i]);
}

int main(int argc, char **argv) {
    if (argc != 5) {
        fprintf(stderr, "usage: compare_pictures WIDTH HEIGHT REFERENCE TEST\n");
        return 64;
    }
    const uint32_t width = (uint32_t)strtoul(argv[1], NULL, 10),
                   height = (uint32_t)strtoul(argv[2], NULL, 10);
    const size_t pixels = (size_t)width * height, count = 3 * pixels;
    uint8_t *a = read_picture(argv[3], count), *b = read_picture(argv[4], count);
    float *linear = malloc((2 * count + pixels + 1) * sizeof *linear);
    int code = 1;
    if (a && b && linear) {
        float *map = linear + 2 * count;
        double difference = 0;
        struct lw_error err = {0};
        for (size_t i = 0; i < count; i++) difference += abs(a[i] - b[i]);
        linearize(a, count, linear);
        linearize(b, count, linear + count);
        if (lw_flip_map(linear, linear + count, width, height, LW_FLIP_PIXELS_PER_DEGREE, map, &err) ==
            LW_OK) {
            printf("%.4f %.5f\n", difference / (double)count, lw_flip_mean(map, NULL, pixels));
            code = 0;
        } else {
            fprintf(stderr, "compare_pictures: %s\n", err.text);
        }
    }
    free(linear);
    free(b);
    free(a);
    return code;
}
