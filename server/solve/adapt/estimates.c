#include "server/solve/adapt/estimates.h"

#include "common/base/colour.h"
#include "common/base/invariant.h"
#include "server/solve/adapt/gradient.h"

#include <string.h>

/* This many samples without light count as an error of 1; a full tile converges
 * after some 25 frames at 0.02. */
#define DARK_SAMPLES 2000.0
/* A noise estimate of a block holds while the block's light is within this factor of its former light. */
#define LIKE 4.0
/* Each frame's share in a block's estimated noise. */
#define NOISE_WEIGHT 0.125f
/* A darker room is measured against at least this share of the tile's light. */
#define DARKEST 1e-4f

/* What the last solve had of one part of a texel's light. */
static struct lw_vec3 estimate_at(const struct lw_tiles *tiles, int part, uint32_t texel) {
    if (part == LW_TILES_DIRECT) return lw_tiles_estimate(tiles, LW_TILES_ESTIMATE_DIRECT, texel);
    struct lw_vec3 e = {0};
    for (int order = 0; order < LW_CHANGE_ORDERS; order++)
        e = lw_vec3_add(e, lw_tiles_estimate(tiles, LW_TILES_ESTIMATE_BOUNCES + order, texel));
    return e;
}

/* Running mean and spread (Welford 1962), forgetting as the sums do. */
static void note_luminance(float *mean, float *spread, float x, float weight) {
    const float off = x - *mean;
    *mean += off * weight;
    *spread = (1 - weight) * (*spread + weight * off * off);
    LW_INVARIANT_DEAR(!(*spread < 0));
}

/* Updates mean and spread of the frames' estimates. */
static void note_estimate(struct lw_tiles *tiles, uint32_t texel, float weight) {
    const struct lw_vec3 e =
        lw_vec3_add(estimate_at(tiles, LW_TILES_DIRECT, texel), estimate_at(tiles, LW_TILES_INDIRECT, texel));
    note_luminance(&tiles->mean[texel], &tiles->spread[texel], lw_colour_luminance(e), weight);
    if (!tiles->split_mean) return;
    const struct lw_vec3 split = lw_vec3_sub(e, lw_tiles_drawn_estimate(tiles, texel));
    note_luminance(&tiles->split_mean[texel], &tiles->split_spread[texel], lw_colour_luminance(split),
                   weight);
}

/* The error of a block that has seen no light yet: the light that it may have missed falls as 1/N with the
 * samples that found none. A scene that casts no light on it at all is found dark as soon as one that hides
 * its light behind a pinhole could be. */
static float error_of_darkness(double samples) { return (float)fmin(1.0, DARK_SAMPLES / fmax(1, samples)); }

/* What an estimate is off the mean that it has entered with weight 1/m is (m-1)/m of what it is off the
 * others' mean, which has a noise of its own: V (m-1)/m in the mean of squares. */
static void note_noise(float *noise, double off_square, double light, const struct lw_history *memory) {
    if (memory->sample_count < 2 || !(light > 0)) return;
    const float now =
        (float)(off_square / (light * light)) * memory->sample_count / (memory->sample_count - 1);
    *noise = *noise < 0 ? now : *noise + (now - *noise) * NOISE_WEIGHT;
    LW_INVARIANT_DEAR(!(*noise < 0));
}

static void add_up_block(struct lw_tiles *tiles, const struct lw_solve_tile *tile, uint32_t column,
                         uint32_t row) {
    struct lw_solve_block *block = &tile->block[row * tile->block_columns + column];
    double variance = 0, luminance = 0, light = 0, square[LW_TILES_PARTS] = {0};
    float drift[LW_TILES_PARTS][LW_REGIONS] = {{0}};
    uint32_t texels[LW_REGIONS] = {0};
    float *const *const sum[LW_TILES_PARTS] = {tiles->direct, tiles->indirect};
    LW_TILES_EACH_TEXEL (tile, column, row, x, y) {
        const uint32_t texel = tile->first + y * tile->width + x;
        if (!tiles->covered[texel]) continue;
        note_estimate(tiles, texel, block->indirect.weight);
        const uint32_t region = tiles->region_of_texel[texel];
        const double weight = (double)block->weight[region];
        variance += weight * weight * (double)tiles->judged_spread[texel];
        luminance += (double)tiles->mean[texel];
        light += weight * (double)tiles->mean[texel];
        texels[region]++;
        for (int part = 0; part < LW_TILES_PARTS; part++) {
            const float off =
                block->weight[region] * lw_colour_luminance(lw_vec3_sub(estimate_at(tiles, part, texel),
                                                                        lw_texels_vector(sum[part], texel)));
            square[part] += (double)off * (double)off;
            drift[part][region] += off;
        }
    }
    const double each = 1.0 / block->covered_count;
    note_noise(&block->noise[LW_TILES_DIRECT], square[LW_TILES_DIRECT] * each, light * each, &block->direct);
    note_noise(&block->noise[LW_TILES_INDIRECT], square[LW_TILES_INDIRECT] * each, light * each,
               &block->indirect);
    for (uint32_t r = 0; r < LW_REGIONS; r++)
        for (int part = 0; texels[r] && part < LW_TILES_PARTS; part++)
            lw_gradient_note_drift(block, part, r, drift[part][r] / (float)texels[r]);
    LW_INVARIANT_DEAR(!(variance < 0));
    block->sample_count++;
    block->variance = variance;
    block->luminance = luminance;
}

/* ---- against what light errors are measured ---- */

/* Mean luminance of a tile, and of its wide rooms by themselves; variance of the parts of its blocks. */
struct tile_light {
    bool several; /* rooms; else what follows the mean is not set */
    double mean, room[LW_ROOMS_MAX];
    double variance[LW_TILE_BLOCKS * LW_TILE_BLOCKS][LW_REGIONS];
};

/* Measures a tile with several rooms: sets the luminance of its blocks' parts. */
static void measure_rooms(const struct lw_tiles *tiles, const struct lw_solve_tile *tile,
                          struct tile_light *light) {
    double sum[LW_TILE_BLOCKS * LW_TILE_BLOCKS][LW_REGIONS] = {{0}};
    uint32_t texels[LW_TILE_BLOCKS * LW_TILE_BLOCKS][LW_REGIONS] = {{0}}, in_room[LW_ROOMS_MAX] = {0};
    memset(light->room, 0, sizeof light->room);
    memset(light->variance, 0, sizeof light->variance);
    for (uint32_t i = 0; i < tile->width * tile->height; i++) {
        const uint32_t texel = tile->first + i;
        if (!tiles->covered[texel]) continue;
        const ptrdiff_t b = lw_tiles_block(tile, i % tile->width, i / tile->width) - tile->block;
        uint32_t part = 0;
        while (tiles->region_of_texel[texel] >= tile->block[b].parts.end[part]) part++;
        sum[b][part] += (double)tiles->mean[texel];
        light->variance[b][part] += (double)tiles->judged_spread[texel];
        texels[b][part]++;
    }
    LW_TILES_EACH_BLOCK (tile, block) {
        const ptrdiff_t b = block - tile->block;
        for (uint32_t part = 0; part < block->parts.count; part++) {
            light->room[block->parts.room[part]] += sum[b][part];
            in_room[block->parts.room[part]] += texels[b][part];
            block->part_luminance[part] = texels[b][part] ? (float)(sum[b][part] / texels[b][part]) : 0;
        }
    }
    for (uint32_t room = 0; room < LW_ROOMS_MAX; room++)
        if (in_room[room]) light->room[room] /= in_room[room];
}

/* Against which a dark corner is measured. */
static double light_around(const struct lw_solve_tile *tile, const struct tile_light *light, uint32_t room) {
    return light->several && room && room <= tile->wide_rooms
               ? fmax(light->room[room], (double)DARKEST * light->mean)
               : light->mean;
}

/* The part with the least light, but some, stands for the block: elsewhere a W/m^2 counts as
 * much less as there is more light. Returns the block's light without other layers'. */
static double weigh_parts(const struct lw_solve_tile *tile, struct lw_solve_block *block,
                          const struct tile_light *tile_light) {
    float light[LW_REGIONS], factor[LW_REGIONS];
    uint32_t least = 0;
    for (uint32_t part = 0; part < block->parts.count; part++) {
        const float around = (float)light_around(tile, tile_light, block->parts.room[part]);
        light[part] = fmaxf(block->part_luminance[part], around) + block->part_other[part];
        if (light[part] > 0 && !(light[least] > 0 && light[least] <= light[part])) least = part;
    }
    block->variance = 0;
    for (uint32_t part = 0, r = 0; part < block->parts.count; part++) {
        const float weight = light[part] > 0 ? light[least] / light[part] : 1;
        block->variance += (double)weight * (double)weight * tile_light->variance[block - tile->block][part];
        for (; r < block->parts.end[part]; r++) {
            LW_INVARIANT(weight > 0 && weight <= 1 && block->weight[r] > 0);
            factor[r] = weight / block->weight[r];
            block->weight[r] = weight;
        }
    }
    LW_INVARIANT(block->parts.end[block->parts.count - 1] == LW_REGIONS); /* each has its factor */
    lw_gradient_reweigh(block, factor);
    block->other_luminance = block->part_other[least];
    return (double)(light[least] - block->part_other[least]);
}

static double light_of(const struct lw_solve_tile *tile, struct lw_solve_block *block,
                       const struct tile_light *light) {
    if (block->parts.count > 1) return weigh_parts(tile, block, light);
    return fmax(block->luminance / block->covered_count, light_around(tile, light, block->parts.room[0]));
}

/* The light of a single room is its tile's. */
static bool has_several_rooms(const struct lw_solve_tile *tile) {
    const struct lw_solve_block *first = NULL;
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!block->covered_count) continue;
        if (!first) first = block;
        if (block->parts.count > 1 || block->parts.room[0] != first->parts.room[0]) return true;
    }
    return false;
}

void lw_estimates_judge(const struct lw_transport *t, struct lw_solve_tile *tile) {
    if (!tile->covered_count) return;
    const uint32_t samples =
        t->direct_samples > t->indirect_samples ? t->direct_samples : t->indirect_samples;
    double luminance = 0, looks = 0, square = 0;
    struct tile_light tile_light;
    tile_light.several = has_several_rooms(tile);
    LW_TILES_EACH_BLOCK (tile, block) {
        luminance += block->luminance;
        looks += (double)block->sample_count * samples * block->covered_count;
    }
    tile_light.mean = luminance / tile->covered_count;
    if (tile_light.several) measure_rooms(t->tiles, tile, &tile_light);
    LW_TILES_EACH_BLOCK (tile, block) {
        const double n = block->covered_count;
        if (!(n > 0)) continue;
        const double light = light_of(tile, block, &tile_light);
        if (!(light < LIKE * (double)block->reference_luminance &&
              (double)block->reference_luminance < LIKE * light))
            block->noise[LW_TILES_DIRECT] = block->noise[LW_TILES_INDIRECT] = -1;
        block->reference_luminance = (float)fmax(light, 0); /* sums that are corrected end a little below */
        /* variance is that of one estimate; the mean of h of them has 1/(h-1) of it
         * (Bessel's correction in it). */
        const double others = (double)block->indirect.sample_count - 1;
        if (others < 1)
            block->error = 1;
        else if (light > 0)
            block->error =
                (float)fmin(1, sqrt(block->variance / n / others) / (light + (double)block->other_luminance));
        else
            block->error = error_of_darkness(looks);
        square += n * (double)block->error * (double)block->error;
    }
    tile->light.error = (float)sqrt(square / tile->covered_count);
    LW_INVARIANT_DEAR(tile->light.error >= 0 && tile->light.error < 1.001f);
}

void lw_estimates_finish_tile(const struct lw_transport *t, struct lw_solve_tile *tile) {
    struct lw_tiles *tiles = t->tiles;
    for (uint32_t row = 0; row < tile->block_rows; row++)
        for (uint32_t column = 0; column < tile->block_columns; column++) {
            const struct lw_solve_block *block = &tile->block[row * tile->block_columns + column];
            if (block->due && block->covered_count) add_up_block(tiles, tile, column, row);
        }
    lw_estimates_judge(t, tile);
}
