#include "server/solve/light_layers.h"

#include "common/base/colour.h"
#include "common/base/invariant.h"
#include "common/base/log.h"
#include "common/base/random.h"
#include "common/light/client_lights.h"
#include "server/solve/adapt/motion.h"
#include "server/solve/cell_layer.h"

#include <limits.h>
#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Share of the other layers' light that counts for a layer's errors once nothing moves: a layer with less
 * than this share of the light at a place is all but invisible there, even alone. */
#define STILL_SHARE (1.0f / 64)
/* Weights below this count as this where one layer's light is measured against another's. */
#define WEIGHT_MIN (1.0f / 16)
/* Weights of a layer's lights that agree to WEIGHT_SAME are one. Above WEIGHT_MAX a layer was solved too dark
 * for its lights as they are. */
#define WEIGHT_SAME 1e-5f
#define WEIGHT_MAX  1e6f

/* One of a layer's lights: punctual, a material, the sky. */
struct light {
    const float *now; /* its intensity in layers.pose */
    float *in_pose;   /* in the layer's pose: */
    float solved[3];  /* as it is solved */
};

/* Against which light a layer's errors are measured. */
enum measure { MEASURE_OWN, MEASURE_ALL };

struct layer {
    struct lw_solver *solver;
    struct lw_scene scene; /* the scene, with emission and sky of this layer alone */
    struct lw_pose pose;   /* with this layer's lights alone */
    struct light *light;
    uint32_t light_count;
    float environment[3]; /* stands for the sky's picture, a light that never changes */
    float weight[3];      /* a factor of its solved light in the sum */
    enum measure measure; /* the last frame's */
    bool begun;           /* it has had a frame */
    bool ran;             /* the last one */
};

struct layers {
    struct lw_solver base;
    struct lw_solver_desc desc;
    struct lw_light_groups groups;
    struct lw_geometry geometry;
    struct lw_pose pose; /* the last one given */
    struct layer layer[LW_LIGHT_GROUPS_MAX];
    uint32_t count;
    uint32_t still_frames; /* since any layer's light moved */
    /* A movement has begun and not gone on, and not all that it has changed was solved since. */
    bool onset;
    uint32_t yield_frames; /* frames in a row in which a layer has waited for another */
    bool shows_all;        /* an irradiance is new: the next frame shows everything */
    bool sums;             /* shown light is in the planes below; else it is the one layer's own */
    uint32_t channels;     /* shown ones (tile_channels.h) */
    float *direct[3], *indirect[3];
    /* By channel and plane; NULL: not one that layers hold. */
    float *shown[LW_TILE_CHANNELS_MAX][LW_TILE_CHANNEL_PLANES_MAX];
    uint64_t *solved_frame; /* per lw_tile_id: that last changed them */
    int threads;
};

/* ---- a layer's lights ---- */

static float most_of(const float colour[3]) { return fmaxf(colour[0], fmaxf(colour[1], colour[2])); }

static bool shines(const struct layer *layer) {
    for (uint32_t i = 0; i < layer->light_count; i++)
        if (most_of(layer->light[i].solved) > 0) return true;
    return false;
}

static bool is_off(const struct layer *layer) { return !(most_of(layer->weight) > 0); }

static float mean_weight(const struct layer *layer) {
    return lw_colour_luminance(lw_vec3(layer->weight[0], layer->weight[1], layer->weight[2]));
}

/* Whether a layer takes part in a frame. The first one's first frame always is, so that there is
 * something to show in the dark. */
static bool runs(const struct layers *s, const struct layer *layer) {
    return (layer == s->layer && !layer->begun) || (!is_off(layer) && shines(layer));
}

/* The weight of a channel that makes of all lights as they are solved what they
 * are now; < 0: there is none. */
static float weigh_channel(const struct layer *layer, int c) {
    float weight = -1;
    for (uint32_t i = 0; i < layer->light_count; i++) {
        const float now = layer->light[i].now[c], solved = layer->light[i].solved[c];
        if (!(solved > 0)) {
            if (now > 0) return -1;
            continue;
        }
        const float w = now / solved;
        if (!(w <= WEIGHT_MAX) || (weight >= 0 && fabsf(w - weight) > WEIGHT_SAME * fmaxf(w, weight)))
            return -1;
        if (weight < 0) weight = w;
    }
    return weight < 0 ? 1 : weight;
}

static bool weigh(const struct layer *layer, float out_weight[3]) {
    bool all = true;
    for (int c = 0; c < 3; c++) {
        out_weight[c] = weigh_channel(layer, c);
        all &= out_weight[c] >= 0;
    }
    return all;
}

/* Solves lights as they are from now on. One alone shines in every channel, so that
 * it may take any colour later. */
static void solve_as_it_is(struct layer *layer) {
    uint32_t shining = 0;
    for (uint32_t i = 0; i < layer->light_count; i++) shining += most_of(layer->light[i].now) > 0;
    for (uint32_t i = 0; i < layer->light_count; i++) {
        struct light *light = &layer->light[i];
        for (int c = 0; c < 3; c++)
            light->solved[c] = light->now[c] > 0 || shining > 1 ? light->now[c] : most_of(light->now);
    }
    (void)weigh(layer, layer->weight);
}

/* Weighs the layer's lights as they are now; where no weight does, they are solved again. Returns
 * whether the weight is another. */
static bool take_lights(struct layer *layer) {
    float weight[3];
    if (!weigh(layer, weight)) {
        solve_as_it_is(layer);
        return true;
    }
    const bool other = memcmp(weight, layer->weight, sizeof weight) != 0;
    memcpy(layer->weight, weight, sizeof weight);
    return other;
}

/* The layer's pose from layers.pose: all but other layers' lights. */
static void take_pose(struct layers *s, uint32_t k) {
    struct layer *layer = &s->layer[k];
    const struct lw_scene *scene = s->desc.scene;
    lw_pose_copy(&layer->pose, &s->pose, scene);
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (s->groups.light[i] != k) layer->pose.light[i] = (struct lw_light_state){0};
    for (uint32_t m = 0; m < scene->material_count; m++)
        memset(layer->pose.material[m].emission, 0, sizeof layer->pose.material[m].emission);
    memset(layer->pose.sky, 0, sizeof layer->pose.sky);
    for (uint32_t i = 0; i < layer->light_count; i++)
        memcpy(layer->light[i].in_pose, layer->light[i].solved, sizeof layer->light[i].solved);
    for (uint32_t m = 0; m < scene->material_count; m++) {
        const struct lw_material_state *now = &layer->pose.material[m];
        memcpy(layer->scene.material[m].base_colour, now->base_colour, sizeof now->base_colour);
        memcpy(layer->scene.material[m].emission, now->emission, sizeof now->emission);
    }
    memcpy(layer->scene.sky, layer->pose.sky, sizeof layer->scene.sky);
}

static const float always[3] = {1, 1, 1};

static void add_light(struct layer *layer, const float *now, float *in_pose) {
    layer->light[layer->light_count++] = (struct light){.now = now, .in_pose = in_pose};
}

static void list_lights(struct layers *s, uint32_t k) {
    struct layer *layer = &s->layer[k];
    for (uint32_t i = 0; i < s->desc.scene->light_count; i++)
        if (s->groups.light[i] == k)
            add_light(layer, &s->pose.light[i].intensity.x, &layer->pose.light[i].intensity.x);
    for (uint32_t m = 0; m < s->desc.scene->material_count; m++)
        if (s->groups.material[m] == k)
            add_light(layer, s->pose.material[m].emission, layer->pose.material[m].emission);
    if (s->groups.sky == k) add_light(layer, s->pose.sky, layer->pose.sky);
    if (layer->scene.environment.width) add_light(layer, always, layer->environment);
}

/* ---- sums ---- */

static const struct lw_tiles *tiles_of(const struct layer *layer) {
    return lw_cell_layer_tiles(layer->solver);
}

static const struct lw_solve_tile *tile_of(const struct layer *layer, lw_tile_id id) {
    return lw_tiles_at(tiles_of(layer), id);
}

static bool allocate_sums(struct layers *s) {
    const size_t count = s->geometry.texels.capacity + 1ul;
    bool ok = true;
    for (int c = 0; c < 3; c++) {
        ok &= (s->direct[c] = calloc(count, sizeof(float))) != NULL;
        ok &= (s->indirect[c] = calloc(count, sizeof(float))) != NULL;
    }
    LW_TILE_CHANNELS_EACH (channel, tiles_of(s->layer)->channels)
        for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++)
            ok &= (s->shown[channel][p] = calloc(count, sizeof(float))) != NULL;
    ok &= (s->solved_frame = calloc(s->desc.atlas_map->tile_count + 1ul, sizeof *s->solved_frame)) != NULL;
    return ok;
}

static size_t sums_bytes(const struct layers *s) {
    size_t planes = 0;
    for (int c = 0; c < 3; c++) planes += (s->direct[c] != NULL) + (s->indirect[c] != NULL);
    for (uint32_t i = 0; i < LW_TILE_CHANNELS_MAX; i++)
        for (uint32_t p = 0; p < LW_TILE_CHANNEL_PLANES_MAX; p++) planes += s->shown[i][p] != NULL;
    return planes * s->geometry.texels.capacity * sizeof(float) +
           (s->solved_frame ? s->desc.atlas_map->tile_count * sizeof *s->solved_frame : 0);
}

/* One plane of every layer, and by what each is weighed: its intensity in the plane's colour. */
struct terms {
    const float *plane[LW_LIGHT_GROUPS_MAX];
    float weight[LW_LIGHT_GROUPS_MAX];
};

/* Puts a sum into the plane of a tile; returns whether it is another than before. */
static bool put_sum(const struct lw_solve_tile *place, const float *sum, float *plane) {
    const size_t size = (size_t)place->width * place->height * sizeof *sum;
    if (memcmp(plane + place->first, sum, size) == 0) return false;
    memcpy(plane + place->first, sum, size);
    return true;
}

/* The weighted sum of one plane of a tile; returns whether it is another than before. */
static bool sum_plane(const struct layers *s, lw_tile_id id, const struct terms *terms, float *plane) {
    const struct lw_solve_tile *place = tile_of(s->layer, id);
    const uint32_t texels = place->width * place->height;
    float sum[LW_TILE_SIDE * LW_TILE_SIDE] = {0};
    for (uint32_t k = 0; k < s->count; k++) {
        const float weight = terms->weight[k];
        const float *light = terms->plane[k] + place->first;
        if (!(weight > 0)) continue;
        for (uint32_t i = 0; i < texels; i++) sum[i] += weight * light[i];
    }
    return put_sum(place, sum, plane);
}

/* By what weights change the luminance of a texel's light: by what its moment is weighed. So the moment of
 * light of one colour is exact, and no longer than the light allows. */
static float moment_weight(const struct layer *layer, const float *const *light, size_t texel) {
    const float *w = layer->weight;
    const struct lw_vec3 e = lw_vec3(light[0][texel], light[1][texel], light[2][texel]);
    const float solved = lw_colour_luminance(e),
                now = lw_colour_luminance(lw_vec3(w[0] * e.x, w[1] * e.y, w[2] * e.z));
    return solved > 0 && now > 0 ? now / solved : 0;
}

/* The sum of the cosine moments of a tile; returns whether it is another than before. */
static bool sum_moments(const struct layers *s, lw_tile_id id, uint32_t channel) {
    const struct lw_solve_tile *place = tile_of(s->layer, id);
    const uint32_t irradiance = lw_tile_channel_at(channel)->follows;
    float sum[3][LW_TILE_SIDE * LW_TILE_SIDE] = {{0}};
    for (const struct layer *layer = s->layer; layer < s->layer + s->count; layer++) {
        const float *const *light = (const float *const *)tiles_of(layer)->shown[irradiance];
        const float *const *moment = (const float *const *)tiles_of(layer)->shown[channel];
        const bool is_grey = layer->weight[0] == layer->weight[1] && layer->weight[1] == layer->weight[2];
        if (is_off(layer)) continue;
        for (uint32_t i = 0; i < place->width * place->height; i++) {
            const size_t texel = place->first + i;
            const float weight = is_grey ? layer->weight[0] : moment_weight(layer, light, texel);
            for (int p = 0; p < 3; p++) sum[p][i] += weight * moment[p][texel];
        }
    }
    bool other = false;
    for (int p = 0; p < 3; p++) other |= put_sum(place, sum[p], s->shown[channel][p]);
    return other;
}

static bool sum_light(const struct layers *s, lw_tile_id id, uint32_t channel) {
    bool other = false;
    for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++) {
        struct terms terms;
        for (uint32_t k = 0; k < s->count; k++) {
            terms.plane[k] = tiles_of(&s->layer[k])->shown[channel][p];
            terms.weight[k] = s->layer[k].weight[p];
        }
        other |= sum_plane(s, id, &terms, s->shown[channel][p]);
    }
    return other;
}

static bool sum_channel(const struct layers *s, lw_tile_id id, uint32_t channel) {
    return (lw_tile_channel_at(channel)->moment ? sum_moments : sum_light)(s, id, channel);
}

/* Sums a tile; returns whether it shows another light than before. */
static bool sum_tile(const struct layers *s, lw_tile_id id) {
    bool other = false;
    for (int c = 0; c < 3; c++) {
        struct terms direct, indirect;
        for (uint32_t k = 0; k < s->count; k++) {
            direct.plane[k] = tiles_of(&s->layer[k])->direct[c];
            indirect.plane[k] = tiles_of(&s->layer[k])->indirect[c];
            direct.weight[k] = indirect.weight[k] = s->layer[k].weight[c];
        }
        sum_plane(s, id, &direct, s->direct[c]);
        sum_plane(s, id, &indirect, s->indirect[c]);
    }
    LW_TILE_CHANNELS_EACH (channel, s->channels) other |= sum_channel(s, id, channel);
    return other;
}

/* Sums tiles that this frame shows of any layer; `all`: every tile, because weights are others.
 * Returns how many are shown. */
static uint32_t sum_tiles(struct layers *s, uint64_t frame, bool all) {
    const struct lw_atlas_map *map = s->desc.atlas_map;
    uint32_t shown = 0;
#pragma omp parallel for schedule(dynamic, 4) num_threads(s->threads) reduction(+ : shown)
    for (uint32_t id = 0; id < map->tile_count; id++) {
        if (!lw_tiles_have(tiles_of(s->layer), (lw_tile_id){id})) continue;
        bool solved = false;
        for (uint32_t k = 0; k < s->count; k++)
            solved |= s->layer[k].ran && tile_of(&s->layer[k], (lw_tile_id){id})->light.solved_frame == frame;
        if (!solved && !all) continue;
        if (!sum_tile(s, (lw_tile_id){id}) && !solved) continue;
        s->solved_frame[id] = frame;
        shown++;
    }
    return shown;
}

/* The error of shown light: a layer's standard error is relative to its own light and the light that counts
 * beside it. */
static float error_of(const struct layers *s, lw_tile_id id) {
    const struct lw_solve_tile *tile[LW_LIGHT_GROUPS_MAX];
    double mean = 0, square = 0;
    const uint32_t covered = tile_of(s->layer, id)->covered_count;
    for (uint32_t k = 0; k < s->count; k++) {
        tile[k] = tile_of(&s->layer[k], id);
        LW_TILES_EACH_BLOCK (tile[k], block) mean += (double)mean_weight(&s->layer[k]) * block->luminance;
    }
    mean /= covered;
    for (uint32_t b = 0; b < tile[0]->block_columns * tile[0]->block_rows; b++) {
        double light = 0, noise = 0, unknown = 0;
        const double n = tile[0]->block[b].covered_count;
        if (!(n > 0)) continue;
        for (uint32_t k = 0; k < s->count; k++) {
            const struct lw_solve_block *block = &tile[k]->block[b];
            const double weight = (double)mean_weight(&s->layer[k]);
            const double off =
                weight * (double)block->error * (double)(block->reference_luminance + block->other_luminance);
            if (!(weight > 0)) continue;
            light += weight * block->luminance / n;
            noise += off * off;
            unknown = fmax(unknown, (double)block->error);
        }
        light = fmax(light, mean);
        const double error = light > 0 ? fmin(1, sqrt(noise) / light) : unknown;
        square += n * error * error;
    }
    return (float)sqrt(square / covered);
}

/* ---- frames ---- */

/* other: the same texels of another layer, whose sums may end a little below none. Where it has several
 * parts, the part counts that the next judgement chooses (estimates.h); until then the darkest. */
static void add_beside(struct lw_solve_block *block, const struct lw_solve_block *other, float weight) {
    if (block->parts.count == 1) {
        block->other_luminance += weight * fmaxf((float)other->luminance, 0) / (float)other->covered_count;
        return;
    }
    float least = INFINITY;
    for (uint32_t part = 0; part < block->parts.count; part++) {
        block->part_other[part] += weight * fmaxf(other->part_luminance[part], 0);
        least = fminf(least, block->part_other[part]);
    }
    block->other_luminance = least;
}

/* Tells a layer's blocks what light the others give, in the measure in which this one is solved. */
static void set_beside(const struct layers *s, const struct layer *layer) {
    struct lw_tiles *tiles = lw_cell_layer_tiles(layer->solver);
    const float share = s->still_frames < LW_CELL_LAYER_FADE_FRAMES ? 1 : STILL_SHARE;
    for (uint32_t b = 0; b < tiles->block_capacity; b++) {
        tiles->block[b].other_luminance = 0;
        memset(tiles->block[b].part_other, 0, sizeof tiles->block[b].part_other);
    }
    for (const struct layer *other = s->layer; other < s->layer + s->count; other++) {
        if (other == layer || !runs(s, other)) continue;
        const struct lw_solve_block *block = tiles_of(other)->block;
        const float weight = share * mean_weight(other) / fmaxf(mean_weight(layer), WEIGHT_MIN);
        for (uint32_t b = 0; b < tiles->block_capacity; b++)
            if (block[b].covered_count) add_beside(&tiles->block[b], &block[b], weight);
    }
}

/* Measures a layer's errors against what counts now. What converged against all light is judged again. */
static void measure(const struct layers *s, struct layer *layer) {
    const enum measure before = layer->measure;
    set_beside(s, layer);
    layer->measure = s->still_frames < LW_CELL_LAYER_FADE_FRAMES ? MEASURE_ALL : MEASURE_OWN;
    if (before == MEASURE_ALL && layer->measure == MEASURE_OWN) lw_cell_layer_review(layer->solver);
}

static void add_stats(struct lw_solver_stats *sum, const struct lw_solver_stats *stats) {
    sum->rays_shadow += stats->rays_shadow;
    sum->rays_bounce += stats->rays_bounce;
    sum->rays_probe += stats->rays_probe;
    sum->pose_ns += stats->pose_ns;
    sum->direct_ns += stats->direct_ns;
    sum->change_ns += stats->change_ns;
    sum->probe_ns += stats->probe_ns;
    sum->scatter_ns += stats->scatter_ns;
    sum->denoise_ns += stats->denoise_ns;
    sum->weld_ns += stats->weld_ns;
    sum->texels_solved += stats->texels_solved;
    sum->texels_left += stats->texels_left;
    sum->tiles_shown += stats->tiles_shown;
    sum->tiles_fine = stats->tiles_fine;
    sum->tiles_fine_wanted = stats->tiles_fine_wanted;
    if (stats->tiles_interest > sum->tiles_interest) sum->tiles_interest = stats->tiles_interest;
    if (stats->tiles_contributing > sum->tiles_contributing)
        sum->tiles_contributing = stats->tiles_contributing;
}

/* How many tiles there are, were solved in this frame, and have converged, over all layers that run. */
static void count_tiles(const struct layers *s, struct lw_solver_stats *stats) {
    const struct lw_tiles *first = tiles_of(s->layer);
    stats->tiles = first->count;
    for (uint32_t i = 0; i < first->count; i++) {
        bool solved = false, converged = true;
        for (uint32_t k = 0; k < s->count; k++) {
            if (!s->layer[k].ran) continue;
            const lw_tile_id id = first->tile[i].id;
            solved |= lw_cell_layer_solved(s->layer[k].solver, id);
            converged &= tile_of(&s->layer[k], id)->light.state == LW_BLOCK_CONVERGED;
        }
        stats->tiles_solved += solved;
        stats->tiles_converged += converged;
    }
}

/* Takes over a pose; returns whether weights are others. */
static bool apply_pose(struct layers *s, const struct lw_pose *pose) {
    bool reweighed = false;
    lw_pose_copy(&s->pose, pose, s->desc.scene);
    for (uint32_t k = 0; k < s->count; k++) {
        reweighed |= take_lights(&s->layer[k]);
        take_pose(s, k);
    }
    return reweighed;
}

static void copy_part(float *to, const float *from, const struct lw_solve_tile *tile) {
    memcpy(to + tile->first, from + tile->first, tile->width * tile->height * sizeof *to);
}

/* Shows the first layer's light, without sums: a sum is compared with it to see whether it is another. Room
 * for finer tiles that are not there stays untouched, and takes no memory. */
static void show_first(struct layers *s) {
    const struct lw_tiles *tiles = tiles_of(s->layer);
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        for (int c = 0; c < 3; c++) {
            copy_part(s->direct[c], tiles->direct[c], tile);
            copy_part(s->indirect[c], tiles->indirect[c], tile);
        }
        LW_TILE_CHANNELS_EACH (channel, tiles->channels)
            for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++)
                copy_part(s->shown[channel][p], tiles->shown[channel][p], tile);
    }
    for (uint32_t id = 0; id < s->desc.atlas_map->tile_count; id++)
        if (lw_tiles_have(tiles, (lw_tile_id){id}))
            s->solved_frame[id] = tile_of(s->layer, (lw_tile_id){id})->light.solved_frame;
}

static enum lw_status begin_sums(struct layers *s, struct lw_error *err) {
    if (s->sums) return LW_OK;
    if (!allocate_sums(s))
        return lw_status_fail(err, LW_NO_MEMORY, "sums of %u texels", s->geometry.texels.count);
    show_first(s);
    s->sums = true;
    return LW_OK;
}

/* Where light has just changed more in one layer than in another, the other waits with what else it has, for
 * at most YIELDS_MAX frames in a row. It keeps this share of the time, for verification. */
#define YIELDS_MAX   16u
#define YIELDS_SHARE 0.25
/* While lights of the other have moved and not all of the interest set is verified: next to nothing. */
#define YIELDS_SHARE_LEAST 1e-3
/* When a first frame had no time for all changes, later ones may take this many budgets: to filter, weld and
 * encode shown tiles takes half as long as a budget. */
#define HURRY_SHARE 2.0
/* And the first frame of a movement this share: something of it is to be seen soon. */
#define BEGIN_SHARE 0.5

/* Shares out the time of a frame. */
static void give_time(struct layers *s, bool moved) {
    uint32_t running = 0, first = 0;
    unsigned most = 0;
    if (!lw_solver_desc_is_limited(&s->desc)) return;
    for (struct layer *layer = s->layer; layer < s->layer + s->count; layer++) {
        const unsigned hurry = layer->ran ? lw_cell_layer_backlog(layer->solver) : 0;
        running += layer->ran;
        most = hurry > most ? hurry : most;
    }
    /* Under steady movement all of the interest set has its turn. */
    const bool follows = moved ? s->still_frames > LW_MOTION_STILL_FRAMES
                               : s->onset && (most || s->still_frames <= LW_MOTION_STILL_FRAMES);
    s->onset = follows;
    if (moved || !follows || s->yield_frames >= YIELDS_MAX) most = 0;
    for (const struct layer *layer = s->layer; layer < s->layer + s->count; layer++)
        first += layer->ran && lw_cell_layer_backlog(layer->solver) >= most;
    s->yield_frames = first < running ? s->yield_frames + 1 : 0;
    const double left = most == LW_CELL_LAYER_BACKLOG_MAX ? YIELDS_SHARE_LEAST : YIELDS_SHARE,
                 shares = first + left * (running - first),
                 budgets = most                                                ? HURRY_SHARE
                           : moved && s->still_frames > LW_MOTION_STILL_FRAMES ? BEGIN_SHARE
                                                                               : 1,
                 budget = budgets * lw_solver_desc_budget(&s->desc);
    LW_INVARIANT(first <= running && (running == 0 || shares > 0));
    for (struct layer *layer = s->layer; layer < s->layer + s->count; layer++) {
        if (!layer->ran) continue;
        const bool yields = lw_cell_layer_backlog(layer->solver) < most;
        lw_cell_layer_set_turn(layer->solver,
                               &(struct lw_cell_layer_turn){.onset = yields || s->onset,
                                                            .yields = yields,
                                                            .budget = (yields ? left : 1) / shares * budget});
    }
}

static enum lw_status frame(struct lw_solver *solver, const struct lw_pose *pose, uint64_t number,
                            struct lw_solver_stats *out_stats, struct lw_error *err) {
    struct layers *s = (struct layers *)solver;
    struct lw_solver_stats stats = {.moved = !lw_pose_equal(pose, &s->pose, s->desc.scene)};
    const bool reweighed = stats.moved && apply_pose(s, pose);
    if (reweighed) {
        enum lw_status status = begin_sums(s, err);
        if (status != LW_OK) return status;
    }
    bool moved = false;
    for (struct layer *layer = s->layer; layer < s->layer + s->count; layer++) layer->ran = runs(s, layer);
    give_time(s, stats.moved);
    for (struct layer *layer = s->layer; layer < s->layer + s->count; layer++) {
        struct lw_solver_stats of_layer;
        if (!layer->ran) continue;
        if (s->count > 1) measure(s, layer);
        lw_waiting_set_part(s->desc.waiting, (uint32_t)(layer - s->layer), s->count);
        enum lw_status status =
            layer->solver->ops->frame(layer->solver, &layer->pose, number, &of_layer, err);
        if (status != LW_OK) return status;
        layer->begun = true;
        moved |= of_layer.moved;
        add_stats(&stats, &of_layer);
    }
    s->still_frames = moved ? 0 : s->still_frames + 1;
    if (s->sums) stats.tiles_shown = sum_tiles(s, number, reweighed || s->shows_all);
    s->shows_all = false;
    count_tiles(s, &stats);
    *out_stats = stats;
    return LW_OK;
}

static enum lw_status set_interest(struct lw_solver *solver, const uint8_t *interest, struct lw_error *err) {
    struct layers *s = (struct layers *)solver;
    enum lw_status status = LW_OK;
    for (uint32_t k = 0; k < s->count && status == LW_OK; k++)
        status = s->layer[k].solver->ops->set_interest(s->layer[k].solver, interest, err);
    return status;
}

static void choose_channels(struct lw_solver *solver, uint32_t channels) {
    struct layers *s = (struct layers *)solver;
    channels = lw_tiles_can_show(tiles_of(s->layer), channels);
    s->shows_all |= (channels & ~s->channels) != 0;
    s->channels = channels;
    for (uint32_t k = 0; k < s->count; k++)
        s->layer[k].solver->ops->choose_channels(s->layer[k].solver, channels);
}

static uint64_t last_frame(const struct layers *s) {
    uint64_t last = 0;
    for (uint32_t k = 0; k < s->count; k++) {
        const uint64_t solved = lw_tiles_last_solved(tiles_of(&s->layer[k]));
        if (solved > last) last = solved;
    }
    return last;
}

static enum lw_status filter(struct lw_solver *solver, struct lw_error *err) {
    struct layers *s = (struct layers *)solver;
    for (uint32_t k = 0; k < s->count; k++) {
        if (!runs(s, &s->layer[k])) continue;
        enum lw_status status = s->layer[k].solver->ops->filter(s->layer[k].solver, err);
        if (status != LW_OK) return status;
    }
    if (s->sums) sum_tiles(s, last_frame(s), true);
    return LW_OK;
}

/* Whether a tile of a finer level has light of all layers that run, and in the sums since it was made. */
static bool has_light(const void *user, lw_tile_id id) {
    const struct layers *s = user;
    for (uint32_t k = 0; k < s->count; k++) {
        const struct lw_solve_tile *tile = tile_of(&s->layer[k], id);
        if (runs(s, &s->layer[k]) && tile->covered_count && !tile->light.sample_count) return false;
    }
    const uint64_t solved = s->sums ? s->solved_frame[id.v] : tile_of(s->layer, id)->light.solved_frame;
    return solved >= lw_fine_tiles_made(&s->geometry.fine, tiles_of(s->layer), id);
}

static uint32_t list_fine(const struct lw_solver *solver, const lw_tile_id **out_tile) {
    const struct layers *s = (const struct layers *)solver;
    return lw_fine_tiles_list(&s->geometry.fine, has_light, s, out_tile);
}

static bool holds_fine(const struct lw_solver *solver, lw_tile_id id) {
    return lw_tiles_have(tiles_of(((const struct layers *)solver)->layer), id);
}

static void read_tile(const struct lw_solver *solver, lw_tile_id id, struct lw_solver_tile *out_tile) {
    const struct layers *s = (const struct layers *)solver;
    s->layer->solver->ops->read_tile(s->layer->solver, id, out_tile);
    if (!s->sums) return;
    const uint32_t first = tile_of(s->layer, id)->first;
    for (int c = 0; c < 3; c++) {
        out_tile->direct[c] = s->direct[c] + first;
        out_tile->indirect[c] = s->indirect[c] + first;
    }
    LW_TILE_CHANNELS_EACH (channel, s->channels | LW_TILE_CHANNELS_FULL)
        for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++)
            out_tile->shown[channel][p] = s->shown[channel][p] + first;
    for (uint32_t k = 1; k < s->count; k++) {
        const uint32_t frames = tile_of(&s->layer[k], id)->light.sample_count;
        if (runs(s, &s->layer[k]) && frames < out_tile->sample_count) out_tile->sample_count = frames;
        out_tile->converged &= tile_of(&s->layer[k], id)->light.state == LW_BLOCK_CONVERGED;
    }
    out_tile->error = tile_of(s->layer, id)->covered_count ? error_of(s, id) : 0;
    out_tile->solved_frame = s->solved_frame[id.v];
}

/* ---- between runs ---- */

/* Each layer has a file and a key of its own. */
static void name_layer(const struct layers *s, uint32_t k, const char *path, const uint8_t key[16],
                       char out_path[PATH_MAX], uint8_t out_key[16]) {
    if (k == 0)
        snprintf(out_path, PATH_MAX, "%s", path);
    else
        snprintf(out_path, PATH_MAX, "%s.%u", path, k);
    memcpy(out_key, key, 16);
    out_key[0] ^= (uint8_t)k;
    out_key[1] ^= (uint8_t)(s->count - 1);
}

static enum lw_status save(const struct lw_solver *solver, const char *path, const uint8_t key[16],
                           struct lw_error *err) {
    const struct layers *s = (const struct layers *)solver;
    for (uint32_t k = 0; k < s->count; k++) {
        char layer_path[PATH_MAX];
        uint8_t layer_key[16];
        name_layer(s, k, path, key, layer_path, layer_key);
        enum lw_status status = s->layer[k].solver->ops->save(s->layer[k].solver, layer_path, layer_key, err);
        if (status != LW_OK) return status;
    }
    return LW_OK;
}

static enum lw_status load(struct lw_solver *solver, const char *path, const uint8_t key[16],
                           uint64_t *out_frames, struct lw_error *err) {
    struct layers *s = (struct layers *)solver;
    for (uint32_t k = 0; k < s->count; k++) {
        char layer_path[PATH_MAX];
        uint8_t layer_key[16];
        uint64_t frames;
        name_layer(s, k, path, key, layer_path, layer_key);
        enum lw_status status =
            s->layer[k].solver->ops->load(s->layer[k].solver, layer_path, layer_key, &frames, err);
        if (status != LW_OK) return status;
        s->layer[k].begun = frames > 0;
        if (k == 0) *out_frames = frames;
    }
    if (s->sums) sum_tiles(s, last_frame(s), true);
    return LW_OK;
}

/* ---- beginning and end ---- */

static size_t memory_bytes(const struct lw_solver *solver) {
    const struct layers *s = (const struct layers *)solver;
    size_t bytes = lw_geometry_memory_bytes(&s->geometry);
    for (uint32_t k = 0; k < s->count; k++)
        bytes += s->layer[k].solver->ops->memory_bytes(s->layer[k].solver);
    return bytes + sums_bytes(s);
}

static void destroy(struct lw_solver *solver) {
    if (!solver) return;
    struct layers *s = (struct layers *)solver;
    for (uint32_t k = 0; k < s->count; k++) {
        struct layer *layer = &s->layer[k];
        if (layer->solver) layer->solver->ops->destroy(layer->solver);
        lw_pose_finish(&layer->pose);
        lw_scene_finish_variant(&layer->scene);
        free(layer->light);
    }
    for (int c = 0; c < 3; c++) {
        free(s->direct[c]);
        free(s->indirect[c]);
    }
    for (uint32_t i = 0; i < LW_TILE_CHANNELS_MAX; i++)
        for (uint32_t p = 0; p < LW_TILE_CHANNEL_PLANES_MAX; p++) free(s->shown[i][p]);
    free(s->solved_frame);
    lw_geometry_finish(&s->geometry);
    lw_pose_finish(&s->pose);
    lw_light_groups_finish(&s->groups);
    free(s);
}

static const struct lw_solver_ops ops = {.name = "layers",
                                         .frame = frame,
                                         .set_interest = set_interest,
                                         .choose_channels = choose_channels,
                                         .filter = filter,
                                         .list_fine = list_fine,
                                         .holds_fine = holds_fine,
                                         .read_tile = read_tile,
                                         .save = save,
                                         .load = load,
                                         .memory_bytes = memory_bytes,
                                         .destroy = destroy};

static enum lw_status build_layer(struct layers *s, uint32_t k, struct lw_error *err) {
    struct layer *layer = &s->layer[k];
    const struct lw_scene *scene = s->desc.scene;
    layer->light = calloc(scene->light_count + scene->material_count + 2ul, sizeof *layer->light);
    if (!layer->light || lw_scene_init_variant(&layer->scene, scene) != LW_OK ||
        lw_pose_init_copy(&layer->pose, &s->pose, scene) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "layer of light");
    if (s->groups.sky != k) layer->scene.environment = (struct lw_environment){0};
    list_lights(s, k);
    solve_as_it_is(layer);
    take_pose(s, k);
    struct lw_solver_desc desc = s->desc;
    desc.scene = &layer->scene;
    desc.threads = (unsigned)s->threads;
    if (k > 0) desc.seed = lw_random_hash2(desc.seed, k); /* noise of one layer does not repeat another's */
    char path[PATH_MAX];
    if (k > 0 && desc.plan_log) {
        snprintf(path, sizeof path, "%s.%u", s->desc.plan_log, k);
        desc.plan_log = path;
    }
    return lw_cell_layer_create(&s->geometry, &desc, &layer->pose, &layer->solver, err);
}

static enum lw_status build(struct layers *s, const struct lw_pose *pose, struct lw_error *err) {
    enum lw_status status = lw_pose_init_copy(&s->pose, pose, s->desc.scene);
    if (status != LW_OK) return lw_status_fail(err, status, "poses");
    const struct lw_geometry_terms terms = {s->desc.saved_texels, s->desc.fine_tiles, s->desc.fine_when,
                                            s->desc.atlas_map};
    status = lw_geometry_init(&s->geometry, s->desc.scene, &s->pose, &terms, s->threads, s->desc.cancel,
                              s->desc.waiting, err);
    bool plain = s->groups.count == 1;
    while (status == LW_OK && s->count < s->groups.count) {
        status = build_layer(s, s->count++, err);
        for (int c = 0; c < 3; c++) plain &= s->layer[s->count - 1].weight[c] == 1;
    }
    if (status != LW_OK) return status;
    if (s->count > 1) lw_log(LW_LOG_INFO, "light in %u layers", s->count);
    return plain ? LW_OK : begin_sums(s, err);
}

enum lw_status lw_light_layers_create(const struct lw_solver_desc *desc, const struct lw_pose *pose,
                                      struct lw_solver **out_solver, struct lw_error *err) {
    struct layers *s = calloc(1, sizeof *s);
    if (!s) return lw_status_fail(err, LW_NO_MEMORY, "solver");
    s->base.ops = &ops;
    s->desc = *desc;
    s->threads = desc->threads ? (int)desc->threads : omp_get_max_threads();
    s->still_frames = LW_CELL_LAYER_FADE_FRAMES;
    s->channels = LW_TILE_CHANNELS_FULL;
    enum lw_status status = lw_light_groups_copy(&s->groups, desc->light_groups, desc->scene);
    status = status == LW_OK ? build(s, pose, err) : lw_status_fail(err, status, "groups of lights");
    if (status != LW_OK) {
        destroy(&s->base);
        return status;
    }
    *out_solver = &s->base;
    return LW_OK;
}
