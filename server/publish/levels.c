#include "server/publish/levels.h"

#include <stdlib.h>
#include <string.h>

#define RIM_ROUNDS        2u /* texels beyond a chart that lookups on levels 1 and 2 may touch, with one to spare */
#define PLACEHOLDER_LEVEL 3u   /* from here on charts mix, and every texel is filled */
#define ROUNDS_MAX        250u /* covered[] counts rounds in a byte */

enum lw_status lw_levels_init(struct lw_levels *levels, const struct lw_atlas *atlas) {
    *levels = (struct lw_levels){.count = atlas->level_count};
    for (uint32_t l = 0; l < levels->count; l++) {
        struct lw_levels_image *image = &levels->level[l];
        const size_t texels = (size_t)atlas->level[l].width * atlas->level[l].height;
        *image = (struct lw_levels_image){.width = atlas->level[l].width, .height = atlas->level[l].height};
        image->rgb = calloc(texels * 3, sizeof *image->rgb);
        image->covered = calloc(texels, 1);
        if (!image->rgb || !image->covered) {
            lw_levels_finish(levels);
            return LW_NO_MEMORY;
        }
    }
    return LW_OK;
}

void lw_levels_finish(struct lw_levels *levels) {
    for (uint32_t l = 0; l < levels->count; l++) {
        free(levels->level[l].covered);
        free(levels->level[l].rgb);
    }
    *levels = (struct lw_levels){0};
}

void lw_levels_load_tile(struct lw_levels *levels, const struct lw_tile_place *place,
                         const struct lw_solver_tile *tile) {
    struct lw_levels_image *image = &levels->level[0];
    for (uint32_t y = 0; y < tile->height; y++)
        for (uint32_t x = 0; x < tile->width; x++) {
            size_t from = (size_t)y * tile->width + x;
            size_t to = (size_t)(place->y * LW_TILE_SIDE + y) * image->width + place->x * LW_TILE_SIDE + x;
            /* What the solver has filled counts as filled in the last round, so that none goes on from it. */
            const bool filled = tile->filled && tile->filled[from];
            image->covered[to] = tile->covered[from] ? 1 : filled ? RIM_ROUNDS + 1 : 0;
            for (int c = 0; c < 3; c++)
                image->rgb[to * 3 + (size_t)c] = image->covered[to] ? tile->light[c][from] : 0;
        }
}

/* Fills one empty texel from its neighbours of earlier rounds; false if it has none. */
static bool fill_texel(struct lw_levels_image *image, uint32_t x, uint32_t y, uint8_t round) {
    float sum[3] = {0};
    int count = 0;
    for (int dy = -1; dy <= 1; dy++)
        for (int dx = -1; dx <= 1; dx++) {
            int64_t nx = (int64_t)x + dx, ny = (int64_t)y + dy;
            if (nx < 0 || ny < 0 || nx >= image->width || ny >= image->height) continue;
            size_t n = (size_t)ny * image->width + (size_t)nx;
            if (!image->covered[n] || image->covered[n] >= round) continue;
            for (int c = 0; c < 3; c++) sum[c] += image->rgb[n * 3 + (size_t)c];
            count++;
        }
    if (!count) return false;
    size_t i = (size_t)y * image->width + x;
    for (int c = 0; c < 3; c++) image->rgb[i * 3 + (size_t)c] = sum[c] / (float)count;
    image->covered[i] = round;
    return true;
}

static void fill(struct lw_levels_image *image, uint32_t rounds) {
    for (uint32_t r = 0; r < rounds && r < ROUNDS_MAX; r++) {
        bool filled = false;
        for (uint32_t y = 0; y < image->height; y++)
            for (uint32_t x = 0; x < image->width; x++)
                if (!image->covered[(size_t)y * image->width + x])
                    filled |= fill_texel(image, x, y, (uint8_t)(r + 2));
        if (!filled) return;
    }
}

static void halve(struct lw_levels_image *coarse, const struct lw_levels_image *fine) {
    for (uint32_t y = 0; y < coarse->height; y++)
        for (uint32_t x = 0; x < coarse->width; x++) {
            float sum[3] = {0};
            int count = 0;
            bool surface = false;
            for (uint32_t j = 2 * y; j < 2 * y + 2 && j < fine->height; j++)
                for (uint32_t i = 2 * x; i < 2 * x + 2 && i < fine->width; i++) {
                    size_t from = (size_t)j * fine->width + i;
                    if (!fine->covered[from]) continue;
                    surface |= fine->covered[from] == 1;
                    for (int c = 0; c < 3; c++) sum[c] += fine->rgb[from * 3 + (size_t)c];
                    count++;
                }
            size_t to = (size_t)y * coarse->width + x;
            coarse->covered[to] = surface ? 1 : count ? RIM_ROUNDS + 1 : 0;
            for (int c = 0; c < 3; c++) coarse->rgb[to * 3 + (size_t)c] = count ? sum[c] / (float)count : 0;
        }
}

void lw_levels_build(struct lw_levels *levels) {
    for (uint32_t l = 0; l < levels->count; l++) {
        struct lw_levels_image *image = &levels->level[l];
        if (l > 0) halve(image, &levels->level[l - 1]);
        /* The coarsest level is what a newcomer sees first: it must have no hole, whichever it is. */
        bool whole = l >= PLACEHOLDER_LEVEL || (l > 0 && l + 1 == levels->count);
        fill(image, whole ? ROUNDS_MAX : RIM_ROUNDS);
    }
}

void lw_levels_store_tile(const struct lw_levels *levels, const struct lw_tile_place *place, float *out_rgb,
                          uint8_t *out_covered) {
    const struct lw_levels_image *image = &levels->level[place->level];
    for (uint32_t y = 0; y < place->height; y++) {
        const size_t from = (size_t)(place->y * LW_TILE_SIDE + y) * image->width + place->x * LW_TILE_SIDE;
        const size_t to = (size_t)y * place->width;
        memcpy(out_rgb + to * 3, image->rgb + from * 3, (size_t)place->width * 3 * sizeof *out_rgb);
        memcpy(out_covered + to, image->covered + from, place->width);
    }
}

#define BIN_SHIFT 21u /* of a float's bits: eight of the exponent and two below them stay */

void lw_levels_count_values(const struct lw_levels *levels, uint64_t bin[LW_LEVELS_BINS]) {
    if (!levels->count) return;
    const uint32_t level = levels->count > PLACEHOLDER_LEVEL ? PLACEHOLDER_LEVEL : levels->count - 1;
    const struct lw_levels_image *image = &levels->level[level];
    for (size_t i = 0; i < (size_t)image->width * image->height; i++)
        for (size_t c = 0; image->covered[i] == 1 && c < 3; c++) {
            uint32_t bits;
            memcpy(&bits, &image->rgb[i * 3 + c], sizeof bits);
            bin[bits >> BIN_SHIFT & (LW_LEVELS_BINS - 1)] += (uint64_t)1 << 2 * (PLACEHOLDER_LEVEL - level);
        }
}

float lw_levels_quantile(const uint64_t bin[LW_LEVELS_BINS], double share) {
    uint64_t all = 0, under = 0;
    for (uint32_t i = 0; i < LW_LEVELS_BINS; i++) all += bin[i];
    if (!all) return 0;
    uint32_t i = 0;
    while ((double)(under += bin[i]) <= share * (double)all && i + 1 < LW_LEVELS_BINS) i++;
    const uint32_t bits = i << BIN_SHIFT;
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}
