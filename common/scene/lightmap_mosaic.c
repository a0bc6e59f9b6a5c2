#include "common/scene/lightmap_mosaic.h"

#include <stdlib.h>

/* Small shapes come in great numbers and few sizes: the search for the next of a size starts where the last ended,
 * for what was full then is full now. Of larger shapes only full rectangles are alike enough for that. */
#define SIZES 17
/* Up to this size holes are not worth a search, which would cost the square of a hundred thousand leaves. */
#define TINY 5

/* A chart ends exactly where its gutter begins; rounding must not push it over. */
#define ROUNDING 1e-3f

struct place {
    uint32_t x, y;
};

struct mosaic {
    uint32_t width, height, stride; /* stride: words per row, one more than needed */
    uint64_t *row;
    struct place resume[SIZES][SIZES];
};

/* Bits [from, to) of a row. */
static void set_bits(uint64_t *row, uint32_t from, uint32_t to) {
    for (uint32_t x = from; x < to; x++) row[x / 64] |= (uint64_t)1 << x % 64;
}

/* Width of a triangle between two heights; false if it has no part there. */
static bool extent(const struct lw_vec2 c[3], float low, float high, float *out_from, float *out_to) {
    float from = INFINITY, to = -INFINITY;
    for (int k = 0; k < 3; k++) {
        struct lw_vec2 p = c[k], q = c[(k + 1) % 3];
        if (p.y >= low && p.y <= high) from = fminf(from, p.x), to = fmaxf(to, p.x);
        for (int side = 0; side < 2; side++) {
            float y = side ? high : low;
            if ((p.y < y) == (q.y < y)) continue;
            float x = p.x + (q.x - p.x) * ((y - p.y) / (q.y - p.y));
            from = fminf(from, x), to = fmaxf(to, x);
        }
    }
    *out_from = from, *out_to = to;
    return from <= to;
}

void lw_lightmap_mosaic_mark(struct lw_lightmap_stone *stone, const struct lw_vec2 c[3], float cell,
                             float reach) {
    reach -= ROUNDING;
    float low = fminf(c[0].y, fminf(c[1].y, c[2].y)) - reach,
          high = fmaxf(c[0].y, fmaxf(c[1].y, c[2].y)) + reach;
    uint32_t end = (uint32_t)ceilf(high / cell);
    for (uint32_t y = low > 0 ? (uint32_t)(low / cell) : 0; y < end && y < stone->height; y++) {
        float from, to;
        if (!extent(c, (float)y * cell - reach, (float)(y + 1) * cell + reach, &from, &to)) continue;
        uint32_t left = from > reach ? (uint32_t)((from - reach) / cell) : 0;
        uint32_t right = to + reach > 0 ? (uint32_t)ceilf((to + reach) / cell) : 0;
        set_bits(stone->row + (size_t)y * lw_lightmap_mosaic_words(stone->width), left,
                 right < stone->width ? right : stone->width);
    }
}

void lw_lightmap_mosaic_fill(struct lw_lightmap_stone *stone) {
    for (uint32_t y = 0; y < stone->height; y++)
        set_bits(stone->row + (size_t)y * lw_lightmap_mosaic_words(stone->width), 0, stone->width);
}

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
    if (s->width < SIZES && s->height < SIZES &&
        ((s->width <= TINY && s->height <= TINY) || is_rectangle(s))) {
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
