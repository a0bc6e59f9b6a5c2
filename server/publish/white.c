#include "server/publish/white.h"

#include "common/base/invariant.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SIDE         8u /* texels of a square */
#define SQUARES_MAX  (LW_TILE_TEXELS_MAX / (SIDE * SIDE))
#define BINS         1024u
#define BIN_SHIFT    21u /* leaves, of a float's bits, eight of the exponent and two below them */
#define NO_LIGHT_YET UINT16_MAX

static uint32_t squares_along(uint32_t texels) { return (texels + SIDE - 1) / SIDE; }

enum lw_status lw_white_init(struct lw_white *white, const struct lw_atlas_map *map) {
    *white = (struct lw_white){.map = map};
    white->first = malloc((map->plain_count + 1ul) * sizeof *white->first);
    if (!white->first) return LW_NO_MEMORY;
    for (uint32_t id = 0; id < map->plain_count; id++) {
        const struct lw_tile_place *place = &map->place[id];
        white->first[id] = (uint32_t)white->square_count;
        if (place->level == 0)
            white->square_count += squares_along(place->width) * squares_along(place->height);
    }
    white->bin = malloc((white->square_count + 1) * sizeof *white->bin);
    if (white->bin) memset(white->bin, 0xff, white->square_count * sizeof *white->bin); /* NO_LIGHT_YET */
    return white->bin ? LW_OK : LW_NO_MEMORY;
}

void lw_white_finish(struct lw_white *white) {
    free(white->bin);
    free(white->first);
    *white = (struct lw_white){.map = NULL};
}

static uint16_t bin_of(float value) {
    uint32_t bits;
    value = fmaxf(value, 0);
    LW_INVARIANT_DEAR(isfinite(value));
    memcpy(&bits, &value, sizeof bits);
    return (uint16_t)(bits >> BIN_SHIFT);
}

static float lower_end(uint32_t bin) {
    const uint32_t bits = bin << BIN_SHIFT;
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

void lw_white_note(struct lw_white *white, lw_tile_id id, const struct lw_solver_tile *tile) {
    float sum[SQUARES_MAX][3] = {{0}};
    uint32_t covered[SQUARES_MAX] = {0};
    const uint32_t columns = squares_along(tile->width), squares = columns * squares_along(tile->height);
    LW_INVARIANT(white->map->place[id.v].level == 0 && squares <= SQUARES_MAX);
    for (uint32_t i = 0; i < tile->width * tile->height; i++) {
        if (!tile->covered[i]) continue;
        const uint32_t square = i / tile->width / SIDE * columns + i % tile->width / SIDE;
        for (int c = 0; c < 3; c++) sum[square][c] += tile->direct[c][i] + tile->indirect[c][i];
        covered[square]++;
    }
    for (uint32_t s = 0; s < squares; s++)
        for (int c = 0; c < 3; c++)
            white->bin[white->first[id.v] + s][c] =
                covered[s] ? bin_of(sum[s][c] / (float)covered[s]) : NO_LIGHT_YET;
}

/* Where the share of the values is reached. */
static float find_quantile(const uint64_t count[BINS], double share) {
    uint64_t all = 0, under = 0;
    for (uint32_t i = 0; i < BINS; i++) all += count[i];
    if (!all) return 0;
    uint32_t i = 0;
    while ((double)(under += count[i]) <= share * (double)all && i + 1 < BINS) i++;
    return lower_end(i);
}

float lw_white_find(const struct lw_white *white, const bool *hidden) {
    uint64_t count[BINS] = {0};
    for (uint32_t id = 0; id < white->map->plain_count; id++) {
        if (hidden[white->map->place[id].object]) continue;
        const size_t end = id + 1 < white->map->plain_count ? white->first[id + 1] : white->square_count;
        for (size_t s = white->first[id]; s < end; s++)
            for (int c = 0; c < 3; c++)
                if (white->bin[s][c] != NO_LIGHT_YET) count[white->bin[s][c]]++;
    }
    return find_quantile(count, LW_WHITE_QUANTILE);
}

size_t lw_white_memory_bytes(const struct lw_white *white) {
    return white->square_count * sizeof *white->bin + white->map->plain_count * sizeof *white->first;
}
