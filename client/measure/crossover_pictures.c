#include "client/measure/crossover_pictures.h"

#include "client/measure/crossover_references.h"
#include "client/view/font.h"
#include "common/image/image.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LARGE 2u  /* a pixel's side */
#define GAP   4u  /* between pictures, in pixels of the strips */
#define HEAD  24u /* for titles */
#define GREY  0x60
#define LABEL 20u /* for the views' numbers, at the left */

struct sheet {
    uint32_t side, width, height, rows;
    uint8_t *pixel;
    struct lw_tonemap tonemap;
};

/* The first frame that is judged. */
static uint32_t first_frame(const struct lw_measure_store *s) {
    uint32_t frame = UINT32_MAX;
    for (size_t i = 0; i < s->sample_count; i++)
        if (s->sample[i].frame < frame) frame = s->sample[i].frame;
    return frame;
}

static bool is_judged(const struct lw_measure_store *s, uint32_t view) {
    for (size_t i = 0; i < s->sample_count; i++)
        if (s->sample[i].view == view) return true;
    return false;
}

/* A view's crops of the reference, the mean of its halves. */
static bool read_reference(const struct lw_measure_store *s, uint32_t view, uint32_t frame, size_t values,
                           float *out) {
    char path[4096], key[512];
    snprintf(path, sizeof path, "%s/reference/v%02u-f%04u-l00.raw", s->folder, view, frame);
    float *second = malloc(values * sizeof *second);
    FILE *f = second ? fopen(path, "re") : NULL;
    const bool good = f && fgets(key, sizeof key, f) && fread(out, sizeof *out, values, f) == values &&
                      fread(second, sizeof *second, values, f) == values;
    for (size_t i = 0; good && i < values; i++) out[i] = 0.5f * (out[i] + second[i]);
    if (f) fclose(f);
    free(second);
    return good;
}

static bool read_crops(const struct lw_measure_store *s, const struct lw_measure_unit *unit, uint32_t view,
                       size_t values, float *out) {
    char path[4096];
    lw_measure_store_picture_path(s->folder, "crops", unit, "raw", path, sizeof path);
    FILE *f = fopen(path, "re");
    const bool good = f && fseek(f, (long)(view * values * sizeof *out), SEEK_SET) == 0 &&
                      fread(out, sizeof *out, values, f) == values;
    if (f) fclose(f);
    return good;
}

static void paste(struct sheet *sheet, uint32_t row, uint32_t column, const float *rgb) {
    const uint32_t cell = LARGE * sheet->side + GAP;
    uint8_t *line = malloc(3 * (size_t)sheet->side);
    for (uint32_t y = 0; line && y < sheet->side; y++) {
        lw_tonemap_encode(&sheet->tonemap, rgb + 3 * (size_t)y * sheet->side, sheet->side, 3, line);
        for (uint32_t d = 0; d < LARGE; d++) {
            uint8_t *to = sheet->pixel + 3 * ((size_t)(HEAD + row * cell + LARGE * y + d) * sheet->width +
                                              LABEL + column * cell);
            for (uint32_t x = 0; x < LARGE * sheet->side; x++) memcpy(to + 3 * x, line + 3 * (x / LARGE), 3);
        }
    }
    free(line);
}

/* Text by the overlay's letters, whose canvas has other pixels. */
static void write_text(struct sheet *sheet, uint32_t x, uint32_t y, uint32_t width, const char *text) {
    const uint32_t height = HEAD - 4;
    uint32_t *pixel = calloc((size_t)width * height, sizeof *pixel);
    if (!pixel) return;
    const struct lw_font_canvas canvas = {pixel, (int)width, (int)height, width};
    lw_font_draw(&canvas, 0, 0, 1, 0xffffffff, text);
    for (uint32_t r = 0; r < height && y + r < sheet->height; r++)
        for (uint32_t c = 0; c < width && x + c < sheet->width; c++)
            if (pixel[r * width + c])
                memset(sheet->pixel + 3 * ((size_t)(y + r) * sheet->width + x + c), 255, 3);
    free(pixel);
}

static enum lw_status fill(struct sheet *sheet, const struct lw_measure_store *s,
                           const struct lw_crossover_strip *strip, uint32_t strip_count,
                           struct lw_error *err) {
    const size_t one = 3 * (size_t)sheet->side * sheet->side, values = LW_CROSSOVER_CROPS * one;
    const uint32_t frame = first_frame(s), cell = LARGE * sheet->side + GAP;
    float *rgb = malloc(values * sizeof *rgb);
    if (!rgb) return lw_status_fail(err, LW_NO_MEMORY, "no memory for strips");
    uint32_t row = 0, references = 0;
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++) {
        if (!is_judged(s, v)) continue;
        char number[12];
        snprintf(number, sizeof number, "%u", v);
        write_text(sheet, 4, HEAD + row * cell + 4, LABEL, number);
        for (uint32_t column = 0; column <= strip_count; column++) {
            const bool good = column ? read_crops(s, &strip[column - 1].unit, v, values, rgb)
                                     : read_reference(s, v, frame, values, rgb);
            references += good && !column;
            for (uint32_t c = 0; good && c < LW_CROSSOVER_CROPS; c++)
                paste(sheet, row + c, column, rgb + c * one);
        }
        row += LW_CROSSOVER_CROPS;
    }
    free(rgb);
    for (uint32_t column = 0; column <= strip_count; column++)
        write_text(sheet, LABEL + column * cell, 6, cell, column ? strip[column - 1].title : "reference");
    return references
               ? LW_OK
               : lw_status_fail(err, LW_NO_INPUT, "%s/reference: the references are not there", s->folder);
}

enum lw_status lw_crossover_pictures_write(const struct lw_measure_store *s,
                                           const struct lw_crossover_strip *strip, uint32_t strip_count,
                                           struct lw_error *err) {
    const char *side = lw_measure_store_get(s, "crop"), *stops = lw_measure_store_get(s, "stops");
    struct sheet sheet = {.side = side ? (uint32_t)strtoul(side, NULL, 10) : 0};
    if (!sheet.side || sheet.side > 4096 || !stops || strip_count > LW_CROSSOVER_STRIP_MAX)
        return lw_status_fail(err, LW_NO_INPUT, "%s/row.csv says no crop or no stops", s->folder);
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++) sheet.rows += LW_CROSSOVER_CROPS * is_judged(s, v);
    sheet.width = LABEL + (strip_count + 1) * (LARGE * sheet.side + GAP);
    sheet.height = HEAD + sheet.rows * (LARGE * sheet.side + GAP);
    sheet.pixel = malloc(3 * (size_t)sheet.width * sheet.height);
    if (!sheet.pixel) return lw_status_fail(err, LW_NO_MEMORY, "no memory for strips");
    memset(sheet.pixel, GREY, 3 * (size_t)sheet.width * sheet.height);
    lw_tonemap_init(&sheet.tonemap, LW_TONEMAP_ACES, strtof(stops, NULL));
    enum lw_status status = fill(&sheet, s, strip, strip_count, err);
    if (status == LW_OK) {
        char path[4096];
        snprintf(path, sizeof path, "%s/strips.png", s->folder);
        status = lw_image_write_png(path, sheet.pixel, sheet.width, sheet.height, err);
    }
    free(sheet.pixel);
    return status;
}
