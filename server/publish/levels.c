#include "server/publish/levels.h"

#include "common/base/invariant.h"
#include "common/base/wide.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* texels beyond a chart that lookups on levels 1 and 2 may touch, with one to spare */
#define RIM_ROUNDS        2u
#define PLACEHOLDER_LEVEL 3u   /* from this level on charts mix, and every texel is filled */
#define ROUNDS_MAX        250u /* covered[] counts rounds in a byte */
/* The mean of filled texels alone, on a coarser level: as those of the last round of a rim. */
#define HALVED (RIM_ROUNDS + 1)
/* Filled by the solver: a round after all others of level 0, so that no fill starts from it. */
#define GIVEN (RIM_ROUNDS + 2)

/* A cell is a tile of level 0 with the texels that it covers on the levels below PLACEHOLDER_LEVEL. A change
 * reaches as far as a rim: 2 texels on level 0, 3 on level 1, 4 on level 2. So it reaches the neighbouring
 * cells, and no farther. */
enum { OLD, LOADED, BESIDE, BUILT };
_Static_assert((LW_TILE_SIDE >> (PLACEHOLDER_LEVEL - 1)) >= 2 * (RIM_ROUNDS + 2),
               "a cell is wider than two rims");

enum lw_status lw_levels_init(struct lw_levels *levels, uint32_t channel, const struct lw_atlas *atlas) {
    *levels = (struct lw_levels){
        .channel = channel, .planes = lw_tile_channel_at(channel)->planes, .count = atlas->level_count};
    if (!levels->count) return LW_OK;
    levels->columns = atlas->level[0].tiles_x;
    levels->rows = atlas->level[0].tiles_y;
    if (!(levels->part = calloc((size_t)levels->columns * levels->rows, 1))) return LW_NO_MEMORY;
    for (uint32_t l = 0; l < levels->count; l++) {
        struct lw_levels_image *image = &levels->level[l];
        LW_INVARIANT(atlas->level[l].width > 0 && atlas->level[l].height > 0);
        LW_INVARIANT(l == 0 || atlas->level[l].width == (atlas->level[l - 1].width + 1) / 2);
        *image = (struct lw_levels_image){.width = atlas->level[l].width, .height = atlas->level[l].height};
        const size_t texels = (size_t)image->width * image->height;
        image->value = calloc(texels * levels->planes, sizeof *image->value);
        image->covered = calloc(texels, 1);
        if (!image->value || !image->covered) {
            lw_levels_finish(levels);
            return LW_NO_MEMORY;
        }
    }
    return LW_OK;
}

void lw_levels_finish(struct lw_levels *levels) {
    for (uint32_t l = 0; l < levels->count; l++) {
        free(levels->level[l].covered);
        free(levels->level[l].value);
    }
    free(levels->part);
    *levels = (struct lw_levels){0};
}

/* The compiler unrolls loops over three planes, which most channels have. */
#define BY_PLANES(function, number, ...)                                                                     \
    ((number) == 3 ? function(3, __VA_ARGS__) : function(number, __VA_ARGS__))

LW_WIDE_INLINE void load_tile(uint32_t planes, struct lw_levels *levels, const struct lw_tile_place *place,
                              const struct lw_solver_tile *tile) {
    struct lw_levels_image *image = &levels->level[0];
    LW_INVARIANT(place->level == 0 && place->x < levels->columns && place->y < levels->rows);
    LW_INVARIANT(tile->width == place->width && tile->height == place->height);
    for (uint32_t y = 0; y < tile->height; y++)
        for (uint32_t x = 0; x < tile->width; x++) {
            size_t from = (size_t)y * tile->width + x;
            size_t to = (size_t)(place->y * LW_TILE_SIDE + y) * image->width + place->x * LW_TILE_SIDE + x;
            const bool filled = tile->filled && tile->filled[from];
            image->covered[to] = tile->covered[from] ? 1 : filled ? GIVEN : 0;
            for (uint32_t p = 0; p < planes; p++)
                image->value[to * planes + p] =
                    image->covered[to] ? tile->shown[levels->channel][p][from] : 0;
        }
    levels->part[place->y * levels->columns + place->x] = LOADED;
}

void lw_levels_load_tile(struct lw_levels *levels, const struct lw_tile_place *place,
                         const struct lw_solver_tile *tile) {
    BY_PLANES(load_tile, levels->planes, levels, place, tile);
}

/* Texels of a level, up to but without the last ones. */
struct area {
    uint32_t x0, y0, x1, y1;
};

static uint32_t smaller(uint32_t a, uint32_t b) { return a < b ? a : b; }

static struct area all_of(const struct lw_levels_image *image) {
    return (struct area){0, 0, image->width, image->height};
}

static struct area area_of(const struct lw_levels *levels, uint32_t cell, uint32_t level) {
    const struct lw_levels_image *image = &levels->level[level];
    const uint32_t side = LW_TILE_SIDE >> level, x = cell % levels->columns * side,
                   y = cell / levels->columns * side;
    LW_INVARIANT(x < image->width && y < image->height);
    return (struct area){x, y, smaller(x + side, image->width), smaller(y + side, image->height)};
}

/* Fills one empty texel from its neighbours of earlier rounds, of which it has some. */
LW_WIDE_INLINE void fill_texel(uint32_t planes, struct lw_levels_image *image, uint32_t x, uint32_t y,
                               uint8_t round) {
    float sum[LW_TILE_CHANNEL_PLANES_MAX] = {0};
    int count = 0;
    for (int dy = -1; dy <= 1; dy++)
        for (int dx = -1; dx <= 1; dx++) {
            int64_t nx = (int64_t)x + dx, ny = (int64_t)y + dy;
            if (nx < 0 || ny < 0 || nx >= image->width || ny >= image->height) continue;
            size_t n = (size_t)ny * image->width + (size_t)nx;
            if (!image->covered[n] || image->covered[n] >= round) continue;
            for (uint32_t p = 0; p < planes; p++) sum[p] += image->value[n * planes + p];
            count++;
        }
    size_t i = (size_t)y * image->width + x;
    LW_INVARIANT_DEAR(count > 0 && !image->covered[i]);
    for (uint32_t p = 0; p < planes; p++) image->value[i * planes + p] = sum[p] / (float)count;
    image->covered[i] = round;
}

/* Most empty texels lie far from any other: those that do not are found RUN at a time. */
#define RUN LW_TILE_SIDE

/* Which of `count` texels from (x, y) on are empty and have neighbours of earlier rounds; false: none. */
LW_WIDE static bool find_rim(const struct lw_levels_image *image, uint32_t x, uint32_t y, uint32_t count,
                             uint8_t round, uint8_t out[RUN]) {
    uint8_t near[RUN + 2] = {0}; /* per column from x - 1 on: it has one above, below or in the row */
    const uint32_t first = x ? 0 : 1, end = x + count < image->width ? count + 2 : count + 1;
    for (uint32_t v = y ? y - 1 : 0; v <= y + 1 && v < image->height; v++) {
        const uint8_t *covered = image->covered + (size_t)v * image->width + x - 1 + first;
        for (uint32_t i = first; i < end; i++)
            near[i] |= (uint8_t)(covered[i - first] - 1) < (uint8_t)(round - 1);
    }
    const uint8_t *covered = image->covered + (size_t)y * image->width + x;
    uint8_t any = 0;
    for (uint32_t i = 0; i < count; i++)
        any |= out[i] = (uint8_t)(covered[i] == 0) & (near[i] | near[i + 1] | near[i + 2]);
    return any;
}

/* One round; false if it filled nothing. */
static bool fill_area(struct lw_levels_image *image, uint32_t planes, struct area area, uint8_t round) {
    bool filled = false;
    for (uint32_t y = area.y0; y < area.y1; y++)
        for (uint32_t x = area.x0; x < area.x1; x += RUN) {
            const uint32_t count = smaller(area.x1 - x, RUN);
            uint8_t rim[RUN];
            if (!find_rim(image, x, y, count, round, rim)) continue;
            for (uint32_t i = 0; i < count; i++)
                if (rim[i]) BY_PLANES(fill_texel, planes, image, x + i, y, round);
            filled = true;
        }
    return filled;
}

/* Clears the texels that were filled before. */
static void clear_area(struct lw_levels_image *image, uint32_t planes, struct area area) {
    for (uint32_t y = area.y0; y < area.y1; y++)
        for (uint32_t x = area.x0; x < area.x1; x++) {
            const size_t i = (size_t)y * image->width + x;
            if (image->covered[i] <= 1 || image->covered[i] >= GIVEN) continue;
            image->covered[i] = 0;
            for (uint32_t p = 0; p < planes; p++) image->value[i * planes + p] = 0;
        }
}

LW_WIDE_INLINE void halve(uint32_t planes, struct lw_levels_image *coarse, const struct lw_levels_image *fine,
                          struct area area) {
    LW_INVARIANT(coarse->width == (fine->width + 1) / 2 && coarse->height == (fine->height + 1) / 2);
    LW_INVARIANT(area.x1 <= coarse->width && area.y1 <= coarse->height);
    for (uint32_t y = area.y0; y < area.y1; y++)
        for (uint32_t x = area.x0; x < area.x1; x++) {
            float sum[LW_TILE_CHANNEL_PLANES_MAX] = {0};
            int count = 0;
            bool surface = false;
            for (uint32_t j = 2 * y; j < 2 * y + 2 && j < fine->height; j++)
                for (uint32_t i = 2 * x; i < 2 * x + 2 && i < fine->width; i++) {
                    size_t from = (size_t)j * fine->width + i;
                    if (!fine->covered[from]) continue;
                    surface |= fine->covered[from] == 1;
                    for (uint32_t p = 0; p < planes; p++) sum[p] += fine->value[from * planes + p];
                    count++;
                }
            size_t to = (size_t)y * coarse->width + x;
            coarse->covered[to] = surface ? 1 : count ? HALVED : 0;
            for (uint32_t p = 0; p < planes; p++)
                coarse->value[to * planes + p] = count ? sum[p] / (float)count : 0;
        }
}

/* The cells beside those that were loaded change with them. */
static void find_parts(struct lw_levels *levels) {
    for (uint32_t y = 0; y < levels->rows; y++)
        for (uint32_t x = 0; x < levels->columns; x++) {
            if (levels->part[y * levels->columns + x] != LOADED) continue;
            for (uint32_t v = y ? y - 1 : 0; v <= y + 1 && v < levels->rows; v++)
                for (uint32_t u = x ? x - 1 : 0; u <= x + 1 && u < levels->columns; u++) {
                    uint8_t *part = &levels->part[v * levels->columns + u];
                    if (*part != LOADED) *part = BESIDE;
                }
        }
}

#define EACH_CELL(levels, cell)                                                                              \
    for (uint32_t cell = 0; cell < (levels)->columns * (levels)->rows; cell++)                               \
        if ((levels)->part[cell] != OLD)

static void build_cells(struct lw_levels *levels, uint32_t level) {
    struct lw_levels_image *image = &levels->level[level];
    EACH_CELL(levels, cell) {
        if (level > 0)
            BY_PLANES(halve, levels->planes, image, image - 1, area_of(levels, cell, level));
        else if (levels->part[cell] == BESIDE)
            clear_area(image, levels->planes, area_of(levels, cell, level));
    }
    for (uint8_t r = 0; r < RIM_ROUNDS; r++) EACH_CELL(levels, cell)
    fill_area(image, levels->planes, area_of(levels, cell, level), (uint8_t)(r + 2));
}

static void build_whole(struct lw_levels *levels, uint32_t level) {
    struct lw_levels_image *image = &levels->level[level];
    BY_PLANES(halve, levels->planes, image, image - 1, all_of(image));
    for (uint32_t round = 2; round < ROUNDS_MAX + 2; round++)
        if (!fill_area(image, levels->planes, all_of(image), (uint8_t)round) && round > HALVED) break;
}

/* All texels are filled, or there was nothing to fill from. */
static bool has_no_hole(const struct lw_levels_image *image) {
    const size_t texels = (size_t)image->width * image->height;
    size_t covered = 0;
    for (size_t i = 0; i < texels; i++) covered += image->covered[i] != 0;
    return covered == 0 || covered == texels;
}

/* The coarsest level is what a newcomer sees first: it must have no hole, whichever it is. */
static bool is_whole(const struct lw_levels *levels, uint32_t level) {
    return level >= PLACEHOLDER_LEVEL || (level > 0 && level + 1 == levels->count);
}

void lw_levels_build(struct lw_levels *levels) {
    for (uint32_t i = 0; i < levels->columns * levels->rows; i++)
        if (levels->part[i] != LOADED) levels->part[i] = OLD;
    find_parts(levels);
    for (uint32_t l = 0; l < levels->count; l++) {
        if (is_whole(levels, l))
            build_whole(levels, l);
        else
            build_cells(levels, l);
    }
    LW_INVARIANT_DEAR(levels->count < 2 || has_no_hole(&levels->level[levels->count - 1]));
    EACH_CELL(levels, cell)
    levels->part[cell] = BUILT;
}

bool lw_levels_has_changed(const struct lw_levels *levels, const struct lw_tile_place *place) {
    if (is_whole(levels, place->level)) return true;
    const uint32_t x0 = place->x << place->level, y0 = place->y << place->level, side = 1u << place->level;
    for (uint32_t y = y0; y < y0 + side && y < levels->rows; y++)
        for (uint32_t x = x0; x < x0 + side && x < levels->columns; x++)
            if (levels->part[y * levels->columns + x] != OLD) return true;
    return false;
}

void lw_levels_store_tile(const struct lw_levels *levels, const struct lw_tile_place *place, float *out_value,
                          uint8_t *out_covered) {
    const struct lw_levels_image *image = &levels->level[place->level];
    LW_INVARIANT(place->level < levels->count);
    LW_INVARIANT(place->x * LW_TILE_SIDE + place->width <= image->width &&
                 place->y * LW_TILE_SIDE + place->height <= image->height);
    for (uint32_t y = 0; y < place->height; y++) {
        const size_t from = (size_t)(place->y * LW_TILE_SIDE + y) * image->width + place->x * LW_TILE_SIDE;
        const size_t to = (size_t)y * place->width;
        memcpy(out_value + to * levels->planes, image->value + from * levels->planes,
               (size_t)place->width * levels->planes * sizeof *out_value);
        memcpy(out_covered + to, image->covered + from, place->width);
    }
}
