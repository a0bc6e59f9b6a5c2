/* bench_coherence: how bundles of bounce rays may share directions, and what it costs and gains. CSV on
 * stdout.
 *
 *     bench_coherence [--samples N] [--texels N] [--frames N] SCENE...
 *
 * The solver lights the scene for a few frames; what texels then send out stays as it is. Its bounce rays
 * then estimate the light that arrives, one order, on every n-th tile at the density and with the structure
 * of the real scene: each way of bundling draws N rays per texel, tile by tile, in the order in which
 * bounces.c would. Ways:
 *   independent   each texel a sequence of its own; packets of 4 x 4 neighbours
 *   block         one direction for a block of 16 x 16 texels; packets of 4 x 4 neighbours
 *   4x4           16 directions interleaved over 4 x 4 texels, a packet is 16 texels of one, with the
 *                 sequence of sampling.h
 *   2x2           4 directions interleaved over 2 x 2 texels, a packet is 16 texels of one, from 8 x 8
 *   jitter-4      as 4x4-dealt, but each texel a point of its own in the shared one's cell of 4 x 4 over the
 *                 square
 *   jitter-16     the same with cells of 16 x 16
 *   filled        the packets of packets.h, with the sequence of sampling.h: what bounces.c does
 *   4x4-dealt     as 4x4, but the 16 deal out one sequence among themselves
 *
 * Columns: rays per texel so far; CPU microseconds per texel of drawing, tracing and reading them, by one
 * worker; millions of rays per CPU second; relMSE of texels, and of means over 4 x 4 and 16 x 16 texels,
 * which is what shared directions leave for the eye and for a filter. relMSE = mean((x - a)(x - b) / (t^2 +
 * eps)): a, b two independent references of 256 rays a texel, t their mean, eps 1 % of the mean of t^2: their
 * own noise drops out. */
#include "common/clock.h"
#include "common/colour.h"
#include "common/light/direction.h"
#include "common/sampling.h"
#include "server/solve/solvers.h"
#include "server/solve/transport/bounces.h"
#include "server/solve/transport/ray_hit.h"
#include "tests/bench/bench_setup.h"
#include "tests/bench/bench_tile.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BLOCK             LW_TILE_BLOCK
#define LANES             LW_TRACE_WIDTH
#define REFERENCE_SAMPLES 256u
#define MOMENTS_MAX       12u /* powers of two */
#define SCALES            3u

struct way {
    const char *name;
    uint32_t spacing; /* texels between those of a set, in both directions; 0: packets.h */
    uint32_t cells;   /* of the jitter's grid, per side; 0: none */
    bool own;         /* each texel a sequence of its own */
    bool shift;       /* that of sampling.h */
};

static const struct way ways[] = {{"independent", 1, 0, true, false}, {"block", 1, 0, false, false},
                                  {"4x4", 4, 0, false, true},         {"2x2", 2, 0, false, false},
                                  {"jitter-4", 4, 4, false, false},   {"jitter-16", 4, 16, false, false},
                                  {"4x4-dealt", 4, 0, false, false},  {"filled", 0, 0, false, true}};
#define WAYS (sizeof ways / sizeof *ways)

/* Of one way after a number of samples, over all tiles. */
struct tally {
    double error[SCALES];
    uint64_t cpu_ns;
};

static const uint32_t scale_side[SCALES] = {1, 4, 16};
static const struct bench_scales scales = {SCALES, scale_side};

struct settings {
    struct lw_scene_open open;
    int64_t samples, texels, frames;
};

/* What the hook below reads and fills: one experiment at a time. */
static struct {
    bool armed;
    uint32_t stride, moments;
    double eps; /* under the divisor */
    uint64_t texels, means[SCALES];
    struct tally tally[WAYS][MOMENTS_MAX];
} lab;

/* Luminance that arrives, per texel of a tile: sums. */

struct bundle {
    const struct lw_transport *passes;
    const struct lw_solve_tile *tile;
    const struct way *way;
    struct lw_sample_points_frame frame;
    uint32_t use; /* of random numbers: tells ways and references apart */
};

static struct lw_vec3 draw(const struct bundle *b, uint32_t block, uint32_t texel, uint32_t set,
                           uint32_t sample) {
    const uint32_t sets = b->way->spacing * b->way->spacing;
    const uint32_t seed = lw_sampling_seed(b->use, b->tile->object, block, LW_SAMPLING_BOUNCE);
    float point[2];
    if (b->way->own) {
        lw_random_sobol2(sample, lw_random_hash2(seed, texel), point);
    } else if (b->way->shift) {
        lw_sampling_point(seed, sample, set, point);
    } else
        lw_random_sobol2(sample * sets + set, seed, point);
    for (uint32_t k = 0; k < 2 && b->way->cells; k++) {
        const float cells = (float)b->way->cells;
        const float jitter = lw_random_unit(lw_random_hash4(seed, texel, sample, k));
        point[k] = fminf((floorf(point[k] * cells) + jitter) / cells, 0x1.fffffep-1f);
    }
    return lw_direction_cosine(point);
}

/* Up to sixteen texels of a tile: one ray each, added to the sums. */
static void trace_packet(const struct bundle *b, const uint32_t texel[LANES], uint16_t active, uint32_t block,
                         uint32_t set, uint32_t sample, float *sum) {
    const struct lw_transport *p = b->passes;
    const struct lw_solve_tile *tile = b->tile;
    if (!active) return;
    struct lw_sample_points_lanes lanes;
    struct lw_ray16 rays;
    struct lw_hit16 hits;
    uint32_t local_texel[LANES], place[LANES];
    const uint32_t turn = lw_random_hash4(b->use, block, sample / LW_SAMPLE_POINTS_MAX, set);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        const uint32_t i = texel[active >> lane & 1 ? lane : (uint32_t)__builtin_ctz(active)];
        local_texel[lane] = tile->local + i;
        place[lane] = tile->mesh->sample_points.first[tile->local + i] +
                      lw_sample_points_choose(p->texels->usable[tile->first + i], sample, turn);
    }
    lw_sample_points_load(&tile->mesh->sample_points, tile->mesh->position, local_texel, place, &lanes);
    lw_sample_points_to_world(&b->frame, &lanes);
    const struct lw_points16 *at = &lanes.at;
    const bool each = b->way->own || b->way->cells;
    struct lw_vec3 local = draw(b, block, texel[__builtin_ctz(active)], set, sample);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        if (each && active >> lane & 1) local = draw(b, block, texel[lane], set, sample);
        lw_trace_set_ray(&rays, lane, lw_vec3(at->x[lane], at->y[lane], at->z[lane]),
                         lw_direction_about(lw_vec3(at->nx[lane], at->ny[lane], at->nz[lane]), local),
                         INFINITY);
    }
    rays.salt = sample;
    lw_trace_closest16(p->trace, each ? 0 : LW_TRACE_COHERENT, active, &rays, &hits);
    for (uint32_t lane = 0; lane < LANES; lane++)
        if (active >> lane & 1 && hits.object[lane] != LW_TRACE_MISS)
            sum[texel[lane]] +=
                bench_radiance_of(p, lw_texels_at(p->texels, hits.object[lane], hits.triangle[lane],
                                                  hits.u[lane], hits.v[lane], hits.back[lane]));
}

/* Sixteen texels from (x, y) on, `spacing` apart. */
static void trace_pattern(const struct bundle *b, uint32_t x, uint32_t y, uint32_t block, uint32_t set,
                          uint32_t sample, float *sum) {
    uint32_t texel[LANES];
    uint16_t active = 0;
    for (uint32_t lane = 0; lane < LANES; lane++) {
        const uint32_t tx = x + lane % 4 * b->way->spacing, ty = y + lane / 4 * b->way->spacing;
        texel[lane] = ty * b->tile->width + tx;
        if (tx < b->tile->width && ty < b->tile->height &&
            b->passes->tiles->covered[b->tile->first + texel[lane]])
            active |= (uint16_t)(1u << lane);
    }
    trace_packet(b, texel, active, block, set, sample, sum);
}

/* The solver's own packets of a block. */
static void trace_filled(const struct bundle *b, uint32_t x, uint32_t y, uint32_t number, uint32_t sample,
                         float *sum) {
    const struct lw_solve_block *block = lw_tiles_block(b->tile, x, y);
    for (uint32_t k = 0; k < block->packet_count; k++) {
        const struct lw_packet *packet = &block->packet[k];
        uint32_t texel[LANES] = {0};
        for (uint32_t lane = 0; lane < packet->count; lane++)
            texel[lane] =
                (y + packet->texel[lane] / BLOCK) * b->tile->width + x + packet->texel[lane] % BLOCK;
        trace_packet(b, texel, (uint16_t)((1u << packet->count) - 1), number, k, sample, sum);
    }
}

/* One ray for every covered texel of the tile. */
static void trace_tile(const struct bundle *b, uint32_t sample, float *sum) {
    const uint32_t spacing = b->way->spacing,
                   part = 4 * spacing; /* texels per side that packets of all sets fill */
    for (uint32_t by = 0; by < b->tile->height; by += BLOCK)
        for (uint32_t bx = 0; bx < b->tile->width; bx += BLOCK) {
            const uint32_t block = (b->tile->y * 4 + by / BLOCK) << 16 | (b->tile->x * 4 + bx / BLOCK);
            if (!spacing) {
                trace_filled(b, bx, by, block, sample, sum);
                continue;
            }
            for (uint32_t i = 0; i < BLOCK / part * (BLOCK / part); i++)
                for (uint32_t set = 0; set < spacing * spacing; set++)
                    trace_pattern(b, bx + i % (BLOCK / part) * part + set % spacing,
                                  by + i / (BLOCK / part) * part + set / spacing, block, set, sample, sum);
        }
}

static void trace_reference(struct bundle *b, bench_plane reference[2]) {
    for (uint32_t j = 0; j < 2; j++) {
        memset(reference[j], 0, sizeof reference[j]);
        b->way = &ways[2]; /* stratified over the samples as any, and fast */
        b->use = 1000 + j;
        for (uint32_t s = 0; s < REFERENCE_SAMPLES; s++) trace_tile(b, s, reference[j]);
    }
}

static void experiment(const struct lw_transport *p, const struct lw_solve_tile *tile) {
    struct bundle b = {.passes = p, .tile = tile};
    static bench_plane reference[2], sum[WAYS];
    lw_sample_points_frame_init(&b.frame, &p->pose->object_to_world[tile->object]);
    trace_reference(&b, reference);
    bench_count_means(p, tile, &scales, lab.means);
    memset(sum, 0, sizeof sum);
    uint64_t cpu_ns[WAYS] = {0};
    for (uint32_t m = 0, done = 0; m < lab.moments; m++)
        for (; done < 1u << m; done++)
            for (uint32_t w = 0; w < WAYS; w++) { /* alternately: all meet the same machine */
                b.way = &ways[w];
                b.use = 1 + w;
                const uint64_t began_ns = lw_clock_thread_cpu_ns();
                trace_tile(&b, done, sum[w]);
                cpu_ns[w] += lw_clock_thread_cpu_ns() - began_ns;
                if (done + 1 != 1u << m) continue;
                lab.tally[w][m].cpu_ns += cpu_ns[w];
                bench_add_errors(p, tile, &scales, sum[w], done + 1, reference, REFERENCE_SAMPLES, lab.eps,
                                 lab.tally[w][m].error);
            }
}

/* ---- the hook: what the tiles hold is the solver's, in the midst of a frame ---- */

void __real_lw_bounces_trace(const struct lw_transport *p, const struct lw_solve_tile *tile,
                             struct lw_ray_count *count);
void __wrap_lw_bounces_trace(const struct lw_transport *p, const struct lw_solve_tile *tile,
                             struct lw_ray_count *count);
_Static_assert(__builtin_types_compatible_p(__typeof__(lw_bounces_trace),
                                            __typeof__(__wrap_lw_bounces_trace)),
               "the parameters of lw_bounces_trace have changed");

void __wrap_lw_bounces_trace(const struct lw_transport *p, const struct lw_solve_tile *tile,
                             struct lw_ray_count *count) {
    __real_lw_bounces_trace(p, tile, count);
    if (!lab.armed || tile->id.v % lab.stride != 0) return;
    lab.texels += tile->covered_count;
    experiment(p, tile);
}

static enum lw_status light(const struct settings *s, const struct lw_scene *scene,
                            const struct lw_pose *pose, const struct lw_atlas_map *map,
                            struct lw_error *err) {
    struct lw_solver *solver;
    struct lw_solver_stats stats;
    enum lw_status status = lw_solvers_create(NULL,
                                              &(struct lw_solver_desc){.scene = scene,
                                                                       .atlas_map = map,
                                                                       .bounces = 2,
                                                                       .direct_samples = 1,
                                                                       .indirect_samples = 2,
                                                                       .target_error = -1,
                                                                       .threads = 1},
                                              pose, &solver, err);
    if (status != LW_OK) return status;
    for (int64_t f = 1; status == LW_OK && f <= s->frames; f++) {
        lab.armed = f == s->frames;
        status = solver->ops->frame(solver, pose, (uint64_t)f, &stats, err);
        if (f > 1) continue;
        /* From what a frame holds: which tiles, and what is dark. */
        double square = 0;
        lab.stride = (uint32_t)(1 + stats.texels_solved / (uint64_t)s->texels);
        for (uint32_t id = 0; id < map->tile_count; id++) {
            struct lw_solver_tile tile;
            if (map->place[id].level) continue;
            solver->ops->read_tile(solver, (lw_tile_id){id}, &tile);
            for (uint32_t i = 0; i < tile.width * tile.height; i++) {
                const double e = (double)lw_colour_luminance(
                    lw_vec3(tile.indirect[0][i], tile.indirect[1][i], tile.indirect[2][i]));
                square += tile.covered[i] ? e * e : 0;
            }
        }
        lab.eps = 0.01 * square / (double)stats.texels_solved;
    }
    lab.armed = false;
    solver->ops->destroy(solver);
    return status;
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    const struct settings *s = context;
    struct lw_scene *scene = NULL;
    struct lw_pose pose = {0};
    struct lw_atlas_map map = {0};
    char label[64];
    memset(&lab, 0, sizeof lab);
    while (1 << (lab.moments + 1) <= 2 * s->samples && lab.moments < MOMENTS_MAX) lab.moments++;
    enum lw_status status = bench_open(&s->open, name, BENCH_MOTION_OWN, 0, &scene, &pose, &map, err);
    if (status == LW_OK) status = light(s, scene, &pose, &map, err);
    if (status == LW_OK && lab.texels == 0) status = lw_status_fail(err, LW_USAGE, "%s: no texels", name);
    for (uint32_t w = 0; status == LW_OK && w < WAYS; w++)
        for (uint32_t m = 0; m < lab.moments; m++) {
            const struct tally *t = &lab.tally[w][m];
            const double us = 1e-3 * (double)t->cpu_ns / (double)lab.texels;
            printf("%s,%llu,%s,%u,%.4f,%.3f,%.6g,%.6g,%.6g\n", bench_label(name, label, sizeof label),
                   (unsigned long long)lab.texels, ways[w].name, 1u << m, us, (double)(1u << m) / us,
                   t->error[0] / (double)lab.means[0], t->error[1] / (double)lab.means[1],
                   t->error[2] / (double)lab.means[2]);
        }
    fflush(stdout);
    bench_close(scene, &pose, &map);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.samples = 64, .texels = 40000, .frames = 4};
    const struct lw_option table[] = {
        {"samples", "N", "rays per texel at most, a power of two (default 64)", LW_OPTION_INT, &s.samples, 1,
         1 << (MOMENTS_MAX - 1), NULL},
        {"texels", "N", "to estimate, some (default 40000)", LW_OPTION_INT, &s.texels, 1, 1 << 30, NULL},
        {"frames", "N", "of light before (default 4)", LW_OPTION_INT, &s.frames, 2, 10000, NULL}};
    return bench_main(
        &(struct bench_program){
            .name = "bench_coherence",
            .about = "Ways of sharing directions among bounce rays: "
                     "error at equal rays and at equal time, as CSV.",
            .table = table,
            .count = sizeof table / sizeof table[0],
            .open = &s.open,
            .context = &s,
            .heading = "scene,texels,way,rays,us_per_texel,mrays_per_s,relmse,relmse_4x4,relmse_16x16",
            .run = run},
        argc, argv);
}
