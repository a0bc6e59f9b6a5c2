#include "common/scene/lightmap_mosaic.h"

#include <stdlib.h>

/* Small shapes come in great numbers and few sizes: the search for the next of a size starts where the last ended,
 * for what was full then is full now. Only full rectangles are alike enough for that. */
#define SIZES 17

struct place {
    uint32_t x, y;
};

struct mosaic {
    uint32_t width, height, stride; /* stride: words per row, one more than needed */
    uint64_t *row;
    struct place resume[SIZES][SIZES];
};

static bool is_free(const struct mosaic *m, const struct lw_lightmap_stone *s, uint32_t x, uint32_t y) {
    uint32_t words = lw_lightmap_mosaic_words(s->width), shift = x % 64;
    for (uint32_t r = 0; r < s->height; r++) {
        const uint64_t *shape = s->row + (size_t)r * words,
                       *at = m->row + (size_t)(y + r) * m->stride + x / 64;
        for (uint32_t k = 0; k < words; k++) {
            if (at[k] & shape[k] << shift) return false;
            if (shift && at[k + 1] & shape[k] >> (64 - shift)) return false;
        }
    }
    return true;
}

static void mark(struct mosaic *m, const struct lw_lightmap_stone *s) {
    uint32_t words = lw_lightmap_mosaic_words(s->width), shift = s->x % 64;
    for (uint32_t r = 0; r < s->height; r++) {
        const uint64_t *shape = s->row + (size_t)r * words;
        uint64_t *at = m->row + (size_t)(s->y + r) * m->stride + s->x / 64;
        for (uint32_t k = 0; k < words; k++) {
            at[k] |= shape[k] << shift;
            if (shift) at[k + 1] |= shape[k] >> (64 - shift);
        }
    }
}

static bool is_rectangle(const struct lw_lightmap_stone *s) {
    for (uint32_t r = 0; r < s->height; r++)
        for (uint32_t x = 0; x < s->width; x++)
            if (!(s->row[(size_t)r * lw_lightmap_mosaic_words(s->width) + x / 64] >> x % 64 & 1))
                return false;
    return true;
}

static bool place(struct mosaic *m, struct lw_lightmap_stone *s) {
    struct place start = {0, 0}, *resume = NULL;
    if (s->width < SIZES && s->height < SIZES && is_rectangle(s)) {
        resume = &m->resume[s->width][s->height];
        start = *resume;
    }
    uint32_t x = start.x;
    for (uint32_t y = start.y; y + s->height <= m->height; y++, x = 0)
        for (; x + s->width <= m->width; x++) {
            if (!is_free(m, s, x, y)) continue;
            s->x = x, s->y = y;
            if (resume) *resume = (struct place){x, y};
            mark(m, s);
            return true;
        }
    return false;
}

enum lw_status lw_lightmap_mosaic_pack(struct lw_lightmap_stone *const *stone, uint32_t count, uint32_t width,
                                       uint32_t height_max, uint32_t *out_width, uint32_t *out_height,
                                       bool *out_fits) {
    struct mosaic *m = calloc(1, sizeof *m);
    if (!m) return LW_NO_MEMORY;
    m->width = width, m->height = height_max, m->stride = lw_lightmap_mosaic_words(width) + 1;
    m->row = calloc((size_t)height_max * m->stride + 1, sizeof *m->row);
    enum lw_status status = m->row ? LW_OK : LW_NO_MEMORY;
    bool fits = true;
    uint32_t right = 0, top = 0;
    for (uint32_t i = 0; status == LW_OK && fits && i < count; i++) {
        fits = place(m, stone[i]);
        if (!fits) break;
        if (stone[i]->x + stone[i]->width > right) right = stone[i]->x + stone[i]->width;
        if (stone[i]->y + stone[i]->height > top) top = stone[i]->y + stone[i]->height;
    }
    free(m->row);
    free(m);
    if (status != LW_OK) return status;
    *out_width = right;
    *out_height = top;
    *out_fits = fits;
    return LW_OK;
}
