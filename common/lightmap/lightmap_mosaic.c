#include "common/lightmap/lightmap_mosaic.h"

#include <stdlib.h>

/* Small shapes come in great numbers and few sizes: the search for the next of a size starts where the last
 * ended, for a full place stays full. Among larger shapes only full rectangles are alike enough for
 * that. */
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
    uint64_t *looks; /* how many are left */
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

/* Nothing is free any more once all looks are used up. */
static bool is_free(const struct mosaic *m, const struct lw_lightmap_stone *s, uint32_t x, uint32_t y) {
    uint32_t words = lw_lightmap_mosaic_words(s->width), shift = x % 64;
    if (!*m->looks) return false;
    --*m->looks;
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

/* Whether a place that is full for one such shape is full for the next of its size. */
static bool is_of_few_sizes(const struct lw_lightmap_stone *s) {
    return s->width < SIZES && s->height < SIZES &&
           ((s->width <= TINY && s->height <= TINY) || is_rectangle(s));
}

/* resume: where the search begins, and where it ended; or NULL. */
static bool place_stone(struct mosaic *m, struct lw_lightmap_stone *s, struct place *resume) {
    uint32_t x = resume ? resume->x : 0;
    for (uint32_t y = resume ? resume->y : 0; y + s->height <= m->height && *m->looks; y++, x = 0)
        for (; x + s->width <= m->width; x++) {
            if (!is_free(m, s, x, y)) continue;
            s->x = x, s->y = y;
            if (resume) *resume = (struct place){x, y};
            mark(m, s);
            return true;
        }
    return false;
}

static enum lw_status mosaic_init(struct mosaic *m, uint32_t width, uint32_t height, uint64_t *looks) {
    *m = (struct mosaic){
        .width = width, .height = height, .stride = lw_lightmap_mosaic_words(width) + 1, .looks = looks};
    m->row = calloc((size_t)height * m->stride + 1, sizeof *m->row);
    return m->row ? LW_OK : LW_NO_MEMORY;
}

/* Bounds of all charts that have a place. */
struct extent {
    uint32_t right, top;
};

static void extend(struct extent *e, const struct lw_lightmap_stone *s) {
    if (s->x + s->width > e->right) e->right = s->x + s->width;
    if (s->y + s->height > e->top) e->top = s->y + s->height;
}

enum lw_status lw_lightmap_mosaic_pack(struct lw_lightmap_stone *const *stone, uint32_t count, uint32_t width,
                                       uint32_t height_max, uint64_t *looks, uint32_t *out_width,
                                       uint32_t *out_height, bool *out_fits) {
    struct mosaic m;
    struct extent used = {0};
    struct place resume[SIZES][SIZES] = {0};
    bool fits = true;
    if (mosaic_init(&m, width, height_max, looks) != LW_OK) return LW_NO_MEMORY;
    for (uint32_t i = 0; fits && i < count; i++) {
        fits = place_stone(&m, stone[i],
                           is_of_few_sizes(stone[i]) ? &resume[stone[i]->width][stone[i]->height] : NULL);
        if (fits) extend(&used, stone[i]);
    }
    free(m.row);
    *out_width = used.right;
    *out_height = used.top;
    *out_fits = fits;
    return LW_OK;
}

/* ---- each near the place it wants ---- */

/* In blocks: squares of 16 x 16 texels, and of these a tile's side. */
#define SQUARE 4u
#define TILE   4u

/* Room for shapes that are to lie near where they want to, as a multiple of their area: at first, the
 * factor if it is too little, and the limit. */
#define NEAR_ROOM     1.08
#define NEAR_MORE     1.06
#define NEAR_ROOM_MAX 4.0

/* The squares of an atlas in the order of the curve; full[i] bit by bit: has no room for the sizes up to 8 x
 * 8. */
struct curve {
    uint32_t count;
    struct place *square; /* in squares */
    uint64_t *full;
};

static enum lw_status curve_init(struct curve *c, uint32_t width, uint32_t height) {
    static const uint8_t HILBERT[TILE * TILE][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0, 2}, {0, 3},
                                                    {1, 3}, {1, 2}, {2, 2}, {2, 3}, {3, 3}, {3, 2},
                                                    {3, 1}, {2, 1}, {2, 0}, {3, 0}};
    const uint32_t columns = (width + SQUARE - 1) / SQUARE, rows = (height + SQUARE - 1) / SQUARE;
    const uint32_t tiles = (columns + TILE - 1) / TILE, tile_rows = (rows + TILE - 1) / TILE;
    *c = (struct curve){.square = malloc(((size_t)columns * rows + 1) * sizeof *c->square),
                        .full = calloc((size_t)columns * rows + 1, sizeof *c->full)};
    if (!c->square || !c->full) return LW_NO_MEMORY;
    for (uint32_t y = 0; y < tile_rows; y++)
        for (uint32_t i = 0; i < tiles; i++)
            for (uint32_t k = 0; k < TILE * TILE; k++) {
                const bool back = y & 1;
                const uint32_t sx = back ? TILE - 1 - HILBERT[k][0] : HILBERT[k][0];
                const struct place at = {TILE * (back ? tiles - 1 - i : i) + sx, TILE * y + HILBERT[k][1]};
                if (at.x < columns && at.y < rows) c->square[c->count++] = at;
            }
    return LW_OK;
}

static void curve_finish(struct curve *c) {
    free(c->square);
    free(c->full);
}

/* With its lower corner in that square. */
static bool place_in(struct mosaic *m, struct lw_lightmap_stone *s, struct place square) {
    for (uint32_t y = square.y * SQUARE; y < (square.y + 1) * SQUARE && y + s->height <= m->height; y++)
        for (uint32_t x = square.x * SQUARE; x < (square.x + 1) * SQUARE && x + s->width <= m->width; x++) {
            if (!is_free(m, s, x, y)) continue;
            s->x = x, s->y = y;
            mark(m, s);
            return true;
        }
    return false;
}

static bool place_near(struct mosaic *m, struct curve *c, struct lw_lightmap_stone *s) {
    const uint64_t size = s->width <= 8 && s->height <= 8 && is_of_few_sizes(s)
                              ? (uint64_t)1 << (8 * (s->height - 1) + s->width - 1)
                              : 0;
    const uint32_t wanted = (uint32_t)(fminf(fmaxf(s->wanted, 0), 0.999999f) * (float)c->count);
    for (uint32_t i = 0; i < 2 * c->count && *m->looks;
         i++) { /* at it, one before, one after, two before ... */
        const uint32_t off = (i + 1) / 2;
        if (i & 1 ? off > wanted : wanted + off >= c->count) continue;
        const uint32_t at = i & 1 ? wanted - off : wanted + off;
        if (c->full[at] & size) continue;
        if (place_in(m, s, c->square[at])) return true;
        c->full[at] |= size;
    }
    return false;
}

static enum lw_status pack_near(struct lw_lightmap_stone *const *stone, uint32_t count, uint32_t width,
                                uint32_t height, uint64_t *looks, struct extent *out_used, bool *out_fits) {
    struct mosaic m;
    struct curve curve = {0};
    bool fits = true;
    *out_used = (struct extent){0};
    enum lw_status status = mosaic_init(&m, width, height, looks);
    if (status == LW_OK) status = curve_init(&curve, width, height);
    for (uint32_t i = 0; status == LW_OK && fits && i < count; i++) {
        fits = place_near(&m, &curve, stone[i]);
        if (fits) extend(out_used, stone[i]);
    }
    curve_finish(&curve);
    free(m.row);
    *out_fits = fits;
    return status;
}

uint64_t lw_lightmap_mosaic_area(const struct lw_lightmap_stone *s) {
    uint64_t cells = 0;
    for (size_t k = 0; k < (size_t)s->height * lw_lightmap_mosaic_words(s->width); k++)
        cells += (uint64_t)__builtin_popcountll(s->row[k]);
    return cells;
}

int lw_lightmap_mosaic_by_size(const void *left, const void *right) {
    const struct lw_lightmap_stone *a = *(struct lw_lightmap_stone *const *)left,
                                   *b = *(struct lw_lightmap_stone *const *)right;
    uint32_t sa = a->width + a->height, sb = b->width + b->height;
    if (sa != sb) return sa > sb ? -1 : 1;
    if (a->height != b->height) return a->height > b->height ? -1 : 1;
    return a < b ? -1 : a > b; /* in order of number: they lie in one array */
}

enum lw_status lw_lightmap_mosaic_pack_near(struct lw_lightmap_stone **stone, uint32_t count,
                                            uint32_t width_max, uint32_t height_max, uint64_t *looks,
                                            uint32_t *out_width, uint32_t *out_height, bool *out_fits) {
    double area = 0;
    uint32_t widest = 1, highest = 1;
    for (uint32_t i = 0; i < count; i++) {
        area += (double)lw_lightmap_mosaic_area(stone[i]);
        if (stone[i]->width > widest) widest = stone[i]->width;
        if (stone[i]->height > highest) highest = stone[i]->height;
    }
    qsort(stone, count, sizeof *stone, lw_lightmap_mosaic_by_size);
    *out_fits = false;
    for (double room = NEAR_ROOM; room < NEAR_ROOM_MAX && !*out_fits && *looks; room *= NEAR_MORE) {
        const double side = fmax(ceil(sqrt(area * room) / (SQUARE * TILE)) * (SQUARE * TILE), widest);
        if (side > width_max) return LW_OK;
        const uint32_t width = (uint32_t)side;
        const double height = fmax(ceil(area * room / width), highest);
        struct extent used;
        if (height > height_max) return LW_OK;
        enum lw_status status = pack_near(stone, count, width, (uint32_t)height, looks, &used, out_fits);
        if (status != LW_OK) return status;
        *out_width = used.right, *out_height = used.top;
    }
    return LW_OK;
}
