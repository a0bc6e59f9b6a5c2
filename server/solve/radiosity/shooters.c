#include "server/solve/radiosity/shooters.h"

#include "common/random.h"

#include <math.h>
#include <stdlib.h>

#define LANES LW_TRACE_WIDTH
/* The work's window: this part of a lightmap's side. */
#define SIDE_SHARE 128.0

enum lw_status lw_shooters_init(struct lw_shooters *shooters, const struct lw_patches *patches,
                                enum lw_undersample undersample, uint32_t side) {
    const uint32_t texels = patches->texels->count;
    uint32_t covered = 0;
    for (uint32_t i = 0; i < texels; i++) covered += patches->texels->covered[i];
    if (!side) side = (uint32_t)fmax(1, sqrt((double)covered) / SIDE_SHARE + 0.5);
    if (undersample == LW_UNDERSAMPLE_NONE) side = 1;
    *shooters = (struct lw_shooters){
        .patches = patches, .undersample = undersample, .side = side, .capacity = covered};
    shooters->shooter = aligned_alloc(64, (covered + 1ul) * sizeof *shooters->shooter);
    shooters->member = malloc((covered + 1ul) * sizeof *shooters->member);
    return shooters->shooter && shooters->member ? LW_OK : LW_NO_MEMORY;
}

void lw_shooters_finish(struct lw_shooters *shooters) {
    free(shooters->shooter);
    free(shooters->member);
    *shooters = (struct lw_shooters){0};
}

size_t lw_shooters_memory_bytes(const struct lw_shooters *shooters) {
    return shooters->capacity * (sizeof *shooters->shooter + sizeof *shooters->member);
}

static struct lw_vec3 place_of(const struct lw_patches *patches, uint32_t texel, struct lw_vec3 *out_normal) {
    const uint32_t place = patches->place[texel], lane = place % LANES;
    const struct lw_points16 *at = &patches->packet[place / LANES].at;
    *out_normal = lw_vec3(at->nx[lane], at->ny[lane], at->nz[lane]);
    return lw_vec3(at->x[lane], at->y[lane], at->z[lane]);
}

static void set_place(struct lw_shooter *s, struct lw_vec3 position, struct lw_vec3 normal) {
    s->position[0] = position.x, s->position[1] = position.y, s->position[2] = position.z;
    s->normal[0] = normal.x, s->normal[1] = normal.y, s->normal[2] = normal.z;
}

/* Of a window's texels one, with the probability of its area. */
static uint32_t draw(const struct lw_shooters *shooters, const struct lw_shooter *s, uint32_t random) {
    const float *area = shooters->patches->area_m2;
    float left = lw_random_unit(random) * s->area_m2;
    for (uint32_t i = s->first; i + 1 < s->first + s->count; i++)
        if ((left -= area[shooters->member[i]]) < 0) return shooters->member[i];
    return shooters->member[s->first + s->count - 1];
}

static void place_shooter(struct lw_shooters *shooters, struct lw_shooter *s, uint32_t seed, uint32_t turn) {
    const struct lw_patches *patches = shooters->patches;
    const uint32_t *member = shooters->member + s->first;
    struct lw_vec3 position = {0}, normal = {0}, n;
    s->area_m2 = 0;
    for (uint32_t i = 0; i < s->count; i++) s->area_m2 += patches->area_m2[member[i]];
    s->texel = shooters->undersample == LW_UNDERSAMPLE_RANDOM
                   ? draw(shooters, s, lw_random_hash3(seed, member[0], turn))
                   : member[0];
    if (shooters->undersample != LW_UNDERSAMPLE_MIP) {
        position = place_of(patches, s->texel, &normal);
    } else {
        for (uint32_t i = 0; i < s->count; i++) {
            const float share = s->area_m2 > 0 ? patches->area_m2[member[i]] / s->area_m2 : 1;
            position = lw_vec3_mad(position, place_of(patches, member[i], &n), share);
            normal = lw_vec3_mad(normal, n, share);
        }
        normal = lw_vec3_normalize(normal);
    }
    set_place(s, position, normal);
}

/* The covered texels of a window, chart by chart. */
static void add_window(struct lw_shooters *shooters, const struct lw_solve_tile *tile, uint32_t x0,
                       uint32_t y0, uint32_t *members) {
    const struct lw_patches *patches = shooters->patches;
    const uint32_t x1 = x0 + shooters->side < tile->width ? x0 + shooters->side : tile->width,
                   y1 = y0 + shooters->side < tile->height ? y0 + shooters->side : tile->height;
    const uint32_t before = shooters->count;
    for (uint32_t y = y0; y < y1; y++)
        for (uint32_t x = x0; x < x1; x++) {
            const uint32_t i = y * tile->width + x, chart = tile->mesh->chart[tile->local + i];
            if (patches->place[tile->first + i] == LW_TEXEL_NONE) continue;
            bool known = false;
            for (uint32_t k = before; k < shooters->count && !known; k++)
                known = shooters->shooter[k].texel == chart;
            if (!known) shooters->shooter[shooters->count++] = (struct lw_shooter){.texel = chart};
        }
    for (uint32_t k = before; k < shooters->count; k++) {
        struct lw_shooter *s = &shooters->shooter[k];
        s->first = *members;
        for (uint32_t y = y0; y < y1; y++)
            for (uint32_t x = x0; x < x1; x++) {
                const uint32_t i = y * tile->width + x;
                if (patches->place[tile->first + i] == LW_TEXEL_NONE ||
                    tile->mesh->chart[tile->local + i] != s->texel)
                    continue;
                shooters->member[(*members)++] = tile->first + i;
                s->count++;
            }
    }
}

void lw_shooters_place(struct lw_shooters *shooters, uint32_t seed, uint32_t turn) {
    const struct lw_tiles *tiles = shooters->patches->tiles;
    uint32_t members = 0;
    shooters->count = 0;
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        if (tile->hidden) continue;
        for (uint32_t y = 0; y < tile->height; y += shooters->side)
            for (uint32_t x = 0; x < tile->width; x += shooters->side)
                add_window(shooters, tile, x, y, &members);
    }
    for (uint32_t k = 0; k < shooters->count; k++) place_shooter(shooters, &shooters->shooter[k], seed, turn);
}

void lw_shooters_charge(struct lw_shooters *shooters, const float *radiance, uint32_t stride, int threads) {
    const bool of_all = shooters->undersample == LW_UNDERSAMPLE_MIP;
    const float *area = shooters->patches->area_m2;
#pragma omp parallel for schedule(static) num_threads(threads)
    for (uint32_t k = 0; k < shooters->count; k++) {
        struct lw_shooter *s = &shooters->shooter[k];
        for (int c = 0; c < 3; c++) {
            float sum = 0;
            for (uint32_t i = s->first; of_all && i < s->first + s->count; i++)
                sum += radiance[(size_t)shooters->member[i] * stride + (size_t)c] * area[shooters->member[i]];
            s->flux_w[c] =
                LW_PI * (of_all ? sum : radiance[(size_t)s->texel * stride + (size_t)c] * s->area_m2);
        }
    }
}
