#include "tests/support/seam_walk.h"

#include "common/lightmap/lightmap.h"

#include <math.h>
#include <stdlib.h>

#define STEPS       8    /* points per texel along a seam */
#define FLOOR_SHARE 0.02 /* share of the mean light */

static uint32_t tiles_of(const struct lw_atlas *atlas) {
    return atlas->level_count ? atlas->level[0].tiles_x * atlas->level[0].tiles_y : 0;
}

/* Which triangles views read at level 0 alone. */
static enum lw_status find_coarsest(struct seam_walk *walk) {
    const struct lw_scene *scene = walk->scene;
    enum lw_status status = LW_OK;
    for (uint32_t o = 0; status == LW_OK && o < scene->object_count; o++) {
        const uint32_t m = scene->object[o].mesh;
        if (walk->coarsest[m] || !scene->mesh[m].lightmap_uv) continue;
        walk->coarsest[m] = calloc(scene->mesh[m].triangle_count + 1u, 1);
        status = walk->coarsest[m] ? lw_lightmap_coarsest(&scene->mesh[m], walk->coarsest[m]) : LW_NO_MEMORY;
    }
    return status;
}

/* Level 0. */
static void blacken_gutters(struct lw_levels *levels) {
    const struct lw_levels_image *image = &levels->level[0];
    for (size_t i = 0; levels->count && i < (size_t)image->width * image->height; i++)
        for (size_t c = 0; image->covered[i] != 1 && c < 3; c++) image->value[i * 3 + c] = 0;
}

enum lw_status seam_walk_init(struct seam_walk *walk, const struct lw_scene *scene,
                              const struct lw_atlas_map *map, const struct lw_solver *solver,
                              enum seam_walk_light light) {
    *walk = (struct seam_walk){.object_count = map->object_count, .scene = scene};
    float *plain = calloc(LW_TILE_TEXELS_MAX, sizeof *plain);
    walk->levels = calloc(map->object_count + 1u, sizeof *walk->levels);
    walk->coarsest = calloc(scene->mesh_count + 1u, sizeof *walk->coarsest);
    enum lw_status status = plain && walk->levels && walk->coarsest ? find_coarsest(walk) : LW_NO_MEMORY;
    double sum = 0, count = 0;
    for (uint32_t o = 0; status == LW_OK && o < map->object_count; o++) {
        if ((status = lw_levels_init(&walk->levels[o], LW_TILE_CHANNEL_FULL, map->atlas[o])) != LW_OK) break;
        for (uint32_t id = map->first_tile[o]; id < map->first_tile[o] + tiles_of(map->atlas[o]); id++) {
            struct lw_solver_tile tile;
            solver->ops->read_tile(solver, (lw_tile_id){id}, &tile);
            for (uint32_t i = 0; i < tile.width * tile.height; i++) {
                plain[i] = tile.direct[0][i] + tile.indirect[0][i];
                if (tile.covered[i]) sum += (double)plain[i], count++;
            }
            if (light != SEAM_WALK_WELDED) {
                tile.filled = NULL;
                for (int c = 0; c < 3; c++) tile.shown[LW_TILE_CHANNEL_FULL][c] = plain;
            }
            lw_levels_load_tile(&walk->levels[o], &map->place[id], &tile);
        }
        lw_levels_build(&walk->levels[o]);
        if (light == SEAM_WALK_BARE) blacken_gutters(&walk->levels[o]);
    }
    free(plain);
    walk->floor = FLOOR_SHARE * sum / fmax(1, count);
    if (status != LW_OK) seam_walk_finish(walk);
    return status;
}

void seam_walk_finish(struct seam_walk *walk) {
    for (uint32_t o = 0; walk->levels && o < walk->object_count; o++) lw_levels_finish(&walk->levels[o]);
    for (uint32_t m = 0; walk->coarsest && m < walk->scene->mesh_count; m++) free(walk->coarsest[m]);
    free(walk->levels);
    free(walk->coarsest);
    *walk = (struct seam_walk){0};
}

/* A bilinear look-up of a level, as in client/view/compose/compose_texels.h. */
bool seam_walk_read(const struct seam_walk *walk, uint32_t object, unsigned level, double u, double v,
                    double *out) {
    if (level >= walk->levels[object].count) return false;
    const struct lw_levels_image *image = &walk->levels[object].level[level];
    const double scale = 1.0 / (1u << level);
    const double x = fmin(fmax(u * scale - 0.5, 0), image->width - 1),
                 y = fmin(fmax(v * scale - 0.5, 0), image->height - 1);
    const uint32_t x0 = (uint32_t)x, y0 = (uint32_t)y;
    *out = 0;
    for (uint32_t j = 0; j < 2; j++)
        for (uint32_t i = 0; i < 2; i++) {
            const uint32_t tx = x0 + i < image->width ? x0 + i : x0,
                           ty = y0 + j < image->height ? y0 + j : y0;
            const double weight = (i ? x - x0 : 1 - (x - x0)) * (j ? y - y0 : 1 - (y - y0));
            const size_t at = (size_t)ty * image->width + tx;
            if (weight > 0 && !image->covered[at]) return false;
            *out += weight * (double)image->value[at * 3];
        }
    return true;
}

static bool read_side(const struct seam_walk *walk, const struct lw_seam_edge *edge, int side, double t,
                      unsigned level, double *out) {
    const struct lw_vec2 from = edge->from[side], to = edge->to[side];
    return seam_walk_read(walk, edge->object[side], level, (double)from.x + t * (double)(to.x - from.x),
                          (double)from.y + t * (double)(to.y - from.y), out);
}

static bool is_read(const struct seam_walk *walk, const struct lw_seam_edge *edge, unsigned level) {
    for (int s = 0; s < 2; s++)
        if (level > walk->coarsest[walk->scene->object[edge->object[s]].mesh][edge->triangle[s]])
            return false;
    return true;
}

static unsigned points_of(const struct lw_seam_edge *edge, unsigned level) {
    double length = 0;
    for (int s = 0; s < 2; s++)
        length = fmax(length, hypot((double)(edge->to[s].x - edge->from[s].x),
                                    (double)(edge->to[s].y - edge->from[s].y)));
    return (unsigned)ceil(length * STEPS / (1u << level)) + 1;
}

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

static struct seam_spread spread_of(double *difference, size_t count) {
    struct seam_spread spread = {.points = count};
    if (!count) return spread;
    qsort(difference, count, sizeof *difference, compare);
    for (size_t i = 0; i < count; i++) {
        spread.mean += difference[i] / (double)count;
        spread.over += (difference[i] > 0.01) / (double)count;
        spread.far_over += (difference[i] > 0.05) / (double)count;
    }
    spread.p50 = difference[count / 2];
    spread.p99 = difference[(size_t)(0.99 * (double)(count - 1))];
    spread.p999 = difference[(size_t)(0.999 * (double)(count - 1))];
    spread.worst = difference[count - 1];
    return spread;
}

enum lw_status seam_walk_measure(const struct seam_walk *walk, const struct lw_seam_edges *edges,
                                 unsigned level, uint32_t object, struct seam_spread *out) {
    size_t capacity = 1, count = 0, dark = 0;
    double light = 0;
    for (size_t e = 0; e < edges->count; e++) capacity += points_of(&edges->edge[e], level);
    double *difference = malloc(capacity * sizeof *difference);
    if (!difference) return LW_NO_MEMORY;
    enum lw_status status = LW_OK;
    for (size_t e = 0; e < edges->count; e++) {
        const unsigned points = points_of(&edges->edge[e], level);
        if (object != LW_SCENE_NONE && edges->edge[e].object[0] != object) continue;
        if (!is_read(walk, &edges->edge[e], level)) continue;
        for (unsigned i = 0; i < points; i++) {
            double a, b;
            if (!read_side(walk, &edges->edge[e], 0, (i + 0.5) / points, level, &a) ||
                !read_side(walk, &edges->edge[e], 1, (i + 0.5) / points, level, &b))
                continue;
            if (!(isfinite(a) && isfinite(b) && a >= 0 && b >= 0)) status = LW_INTERNAL;
            dark += 0.5 * (a + b) < walk->floor;
            light += 0.5 * (a + b);
            difference[count++] = fabs(a - b) / fmax(0.5 * (a + b), walk->floor);
        }
    }
    if (status == LW_OK) {
        *out = spread_of(difference, count);
        if (count) out->dark = (double)dark / (double)count, out->light = light / (double)count;
    }
    free(difference);
    return status;
}

void seam_walk_mean_change(const struct lw_atlas_map *map, const struct lw_solver *solver, double *out_scene,
                           double *out_object) {
    double total[2] = {0};
    *out_object = 0;
    for (uint32_t o = 0; o < map->object_count; o++) {
        double sum[2] = {0}, count = 0;
        for (uint32_t id = map->first_tile[o]; id < map->first_tile[o] + tiles_of(map->atlas[o]); id++) {
            struct lw_solver_tile tile;
            solver->ops->read_tile(solver, (lw_tile_id){id}, &tile);
            for (uint32_t i = 0; i < tile.width * tile.height; i++) {
                if (!tile.covered[i]) continue;
                sum[0] += (double)(tile.direct[1][i] + tile.indirect[1][i]);
                sum[1] += (double)tile.shown[LW_TILE_CHANNEL_FULL][1][i];
                count++;
            }
        }
        for (int i = 0; i < 2; i++) total[i] += sum[i];
        if (count >= 1000 && sum[0] > 0) *out_object = fmax(*out_object, fabs(sum[1] / sum[0] - 1));
    }
    *out_scene = total[0] > 0 ? total[1] / total[0] - 1 : 0;
}
