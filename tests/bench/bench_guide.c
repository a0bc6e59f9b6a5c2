/* bench_guide: whether a guide would pay in the cell solver. CSV on stdout.
 *
 *     bench_guide [OPTIONS] SCENE...
 *
 * As in bench_coherence the solver lights the scene for some frames, and what texels then send out stays as
 * it is. Its bounce rays then estimate the light that arrives, one order, on every n-th tile, by the packets
 * and the sequence of bounces.c. What a ray's end sends out is cached: that is what a guide is told. Ways:
 *   cosine    about each texel's normal: what bounces.c does
 *   learned   guide.h. A packet has the aim of its first texel; each ray carries its weight cos / (pi p)
 *   shared    the same, but a packet whose sample is the guide's takes one world direction for all its rays
 *   visible   each cell of the same grid lists the blocks that give it most light and that it sees
 *             (Vandersanden 2023, chapter 6). A ray goes into the cap about one block's sphere, as seen from
 *             the packet's first texel, with the share beta; the density is that of all caps it lies in.
 *             Cells find their blocks by rays, then take over those of their six neighbours that they see,
 *             in waves
 *
 * What precedes (the frames' rays that teach, the waves) is not in the times: they flatter the guides.
 * Columns as of bench_coherence; relMSE is of texels and of means over 16 x 16 of them. */
#include "common/clock.h"
#include "common/colour.h"
#include "common/guide/guide.h"
#include "common/light/direction.h"
#include "common/sampling.h"
#include "server/solve/solvers.h"
#include "server/solve/transport/bounces.h"
#include "tests/bench/bench_setup.h"
#include "tests/bench/bench_tile.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BLOCK             LW_TILE_BLOCK
#define LANES             LW_TRACE_WIDTH
#define REFERENCE_SAMPLES 512u
#define MOMENTS_MAX       10u /* powers of two */
#define SCALES            2u
#define TEACHING_RAYS     4u /* per texel and frame */
#define LISTED            16u
#define WAVES             4u
#define SIDE              LW_GUIDE_SIDE
#define CELLS             (SIDE * SIDE * SIDE)

enum way { COSINE, LEARNED, SHARED, VISIBLE, WAYS };
static const char *const way_name[WAYS] = {"cosine", "learned", "shared", "visible"};
static const uint32_t scale_side[SCALES] = {1, BLOCK};
static const struct bench_scales scales = {SCALES, scale_side};

struct tally {
    double error[SCALES];
    uint64_t cpu_ns;
};

struct settings {
    struct lw_scene_open open;
    int64_t samples, texels, frames;
    double beta, alpha;
};

/* A block as cells see it. */
struct block_sphere {
    struct lw_vec3 centre;
    float radius, luminance; /* of what it sends out */
};

/* The blocks that a cell sees, and where it looks from. */
struct list {
    struct lw_vec3 eye, normal;
    bool seen; /* somebody has been there */
    uint32_t count, block[LISTED];
    float light[LISTED]; /* luminance times solid angle, from the eye */
};

static struct {
    bool teaching, armed;
    uint32_t stride, moments, teaching_sample;
    float beta;
    double eps;
    uint64_t texels, means[SCALES];
    struct tally tally[WAYS][MOMENTS_MAX];
    struct lw_guide *guide;
    struct block_sphere *sphere;
    struct list *list, *next;
    struct lw_vec3 low, cells_per_m;
} lab;

struct bundle {
    const struct lw_transport *passes;
    const struct lw_solve_tile *tile;
    enum way way;
    bool teaches;
    struct lw_sample_points_frame frame;
    uint32_t use; /* of random numbers: tells ways and references apart */
};

/* ---- lists of visible blocks ---- */

static uint32_t axis_cell(float from_low, float cells_per_m) {
    return (uint32_t)fminf(fmaxf(from_low * cells_per_m, 0), (float)(SIDE - 1));
}

static uint32_t cell_of(struct lw_vec3 point) {
    const struct lw_vec3 p = lw_vec3_sub(point, lab.low);
    return (axis_cell(p.z, lab.cells_per_m.z) * SIDE + axis_cell(p.y, lab.cells_per_m.y)) * SIDE +
           axis_cell(p.x, lab.cells_per_m.x);
}

/* Cap of a sphere as seen from a point: its axis, the cosine of its rim. False from inside or close by. */
static bool cap_of(const struct block_sphere *s, struct lw_vec3 eye, struct lw_vec3 *out_axis,
                   float *out_cosine) {
    const struct lw_vec3 to = lw_vec3_sub(s->centre, eye);
    const float distance = lw_vec3_length(to);
    if (!(distance > 1.1f * s->radius)) return false;
    const float sine = s->radius / distance;
    *out_axis = lw_vec3_scale(to, 1 / distance);
    *out_cosine = sqrtf(1 - sine * sine);
    return true;
}

static void find_spheres(const struct lw_transport *p) {
    for (uint32_t i = 0; i < p->tiles->count; i++) {
        const struct lw_solve_tile *tile = &p->tiles->tile[i];
        const struct lw_affine *to_world = &p->pose->object_to_world[tile->object];
        for (int pass = 0; pass < 2; pass++)
            for (uint32_t t = 0; t < tile->width * tile->height; t++) {
                const uint32_t texel = tile->first + t;
                if (!p->tiles->covered[texel]) continue;
                const uint32_t number = p->tiles->block_of_texel[texel];
                const float share = 1 / (float)p->tiles->block[number].covered_count;
                struct block_sphere *s = &lab.sphere[number];
                const struct lw_vec3 at =
                    lw_affine_point(to_world, lw_texels_vector(tile->mesh->position, tile->local + t));
                if (pass == 0) {
                    s->centre = lw_vec3_mad(s->centre, at, share);
                    s->luminance += share * bench_radiance_of(p, texel);
                } else
                    s->radius = fmaxf(s->radius, 1.05f * lw_vec3_length(lw_vec3_sub(at, s->centre)));
            }
    }
}

/* Puts a block into a list unless those there all give more. */
static void enlist(struct list *l, uint32_t block, float light) {
    uint32_t least = 0;
    for (uint32_t i = 0; i < l->count; i++) {
        if (l->block[i] == block) return;
        if (l->light[i] < l->light[least]) least = i;
    }
    if (l->count < LISTED)
        least = l->count++;
    else if (!(light > l->light[least]))
        return;
    l->block[least] = block;
    l->light[least] = light;
}

static float light_of(const struct list *l, uint32_t block) {
    struct lw_vec3 axis;
    float cosine;
    if (!cap_of(&lab.sphere[block], l->eye, &axis, &cosine)) return 0;
    return lab.sphere[block].luminance * (1 - cosine) * fmaxf(0, lw_vec3_dot(axis, l->normal));
}

/* One ray from a cell to the middle of a block. */
static bool sees(const struct lw_transport *p, const struct list *l, uint32_t block) {
    struct lw_ray16 rays = {.salt = 1};
    struct lw_hit16 hits;
    lw_trace_set_ray(&rays, 0, l->eye, lw_vec3_sub(lab.sphere[block].centre, l->eye), INFINITY);
    lw_trace_closest16(p->trace, 0, 1, &rays, &hits);
    if (hits.object[0] == LW_TRACE_MISS) return false;
    const uint32_t texel =
        lw_texels_at(p->texels, hits.object[0], hits.triangle[0], hits.u[0], hits.v[0], hits.back[0]);
    return texel != LW_TEXEL_NONE && p->tiles->block_of_texel[texel] == block;
}

static void spread(const struct lw_transport *p) {
    static const int step[6] = {1, -1, (int)SIDE, -(int)SIDE, (int)(SIDE * SIDE), -(int)(SIDE * SIDE)};
    for (uint32_t wave = 0; wave < WAVES; wave++) {
        memcpy(lab.next, lab.list, CELLS * sizeof *lab.list);
        for (uint32_t c = 0; c < CELLS; c++) {
            if (!lab.list[c].seen) continue;
            for (int k = 0; k < 6; k++) {
                const int64_t other = (int64_t)c + step[k];
                if (other < 0 || other >= (int64_t)CELLS) continue;
                const struct list *from = &lab.list[other];
                for (uint32_t i = 0; from->seen && i < from->count; i++) {
                    const float light = light_of(&lab.next[c], from->block[i]);
                    if (light > 0 && sees(p, &lab.next[c], from->block[i]))
                        enlist(&lab.next[c], from->block[i], light);
                }
            }
        }
        memcpy(lab.list, lab.next, CELLS * sizeof *lab.list);
    }
}

/* The caps that a packet may aim at. */
struct caps {
    uint32_t count;
    struct lw_vec3 axis[LISTED];
    float cosine[LISTED], share[LISTED]; /* shares sum to 1 */
};

static void take_caps(struct lw_vec3 eye, struct lw_vec3 normal, struct caps *out) {
    const struct list *l = &lab.list[cell_of(eye)];
    float total = 0;
    out->count = 0;
    for (uint32_t i = 0; i < l->count; i++) {
        const uint32_t k = out->count;
        const struct block_sphere *s = &lab.sphere[l->block[i]];
        if (!cap_of(s, eye, &out->axis[k], &out->cosine[k])) continue;
        const float cosine = lw_vec3_dot(out->axis[k], normal);
        if (!(cosine > 0.02f)) continue;
        total += out->share[k] = s->luminance * (1 - out->cosine[k]) * cosine;
        out->count += out->share[k] > 0;
    }
    for (uint32_t k = 0; k < out->count; k++) out->share[k] /= total;
}

static float caps_density(const struct caps *c, struct lw_vec3 d) {
    float sum = 0;
    for (uint32_t k = 0; k < c->count; k++)
        if (lw_vec3_dot(c->axis[k], d) >= c->cosine[k]) sum += c->share[k] / (2 * LW_PI * (1 - c->cosine[k]));
    return sum;
}

static struct lw_vec3 caps_sample(const struct caps *c, const float point[2]) {
    float left = point[0];
    uint32_t k = 0;
    while (k + 1 < c->count && left >= c->share[k]) left -= c->share[k++];
    const float rise = fminf(left / c->share[k], 1);
    /* A hair inside, so that rounding does not put it outside its own cap. */
    const float z = 1 - rise * (1 - c->cosine[k]) * 0.9999f, radius = sqrtf(fmaxf(0, 1 - z * z));
    const float angle = 2 * LW_PI * point[1];
    return lw_direction_about(c->axis[k], lw_vec3(radius * cosf(angle), radius * sinf(angle), z));
}

/* ---- rays ---- */

/* One direction for all lanes, or one about each one's normal: the choice is the packet's. */
static void draw_shared(const struct lw_guide_aim *aim, const struct lw_points16 *at, const float point[2],
                        struct lw_vec3 direction[LANES], float weight[LANES]) {
    const float beta = aim->q ? aim->beta : 0;
    const bool guided = point[0] < beta;
    const float rest[2] = {guided ? point[0] : fminf((point[0] - beta) / (1 - beta), 0x1.fffffep-1f),
                           point[1]};
    struct lw_guide_sample one = {.density = 0};
    float by_q = 0;
    if (guided) {
        one = lw_guide_sample(aim, aim->normal, point);
        by_q = one.density - (1 - beta) * fmaxf(0, lw_vec3_dot(aim->normal, one.direction)) / LW_PI;
    }
    for (uint32_t lane = 0; lane < LANES; lane++) {
        const struct lw_vec3 normal = lw_vec3(at->nx[lane], at->ny[lane], at->nz[lane]);
        float own[2], density;
        if (guided) {
            direction[lane] = one.direction;
            density = (1 - beta) * fmaxf(0, lw_vec3_dot(normal, one.direction)) / LW_PI + by_q;
        } else {
            lw_sampling_spread(rest, lane, own);
            direction[lane] = lw_direction_about(normal, lw_direction_cosine(own));
            density = lw_guide_density(aim, normal, direction[lane]);
        }
        const float cosine = lw_vec3_dot(normal, direction[lane]);
        weight[lane] = cosine > 0 ? cosine / (LW_PI * density) : 0;
    }
}

/* Directions and weights of a packet; place: of the guide. */
static void draw(const struct bundle *b, const struct lw_points16 *at, const float point[2],
                 struct lw_vec3 direction[LANES], float weight[LANES], uint32_t place[LANES]) {
    const struct lw_vec3 eye = lw_vec3(at->x[0], at->y[0], at->z[0]),
                         facing = lw_vec3(at->nx[0], at->ny[0], at->nz[0]);
    struct lw_guide_aim aim;
    struct caps caps = {.count = 0};
    if (b->way == LEARNED || b->way == SHARED) lw_guide_aim_at(lab.guide, eye, facing, &aim);
    if (b->way == SHARED) {
        draw_shared(&aim, at, point, direction, weight);
        return;
    }
    if (b->way == VISIBLE) take_caps(eye, facing, &caps);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        const struct lw_vec3 normal = lw_vec3(at->nx[lane], at->ny[lane], at->nz[lane]);
        float own[2];
        lw_sampling_spread(point, lane, own);
        weight[lane] = 1;
        if (b->way == LEARNED) {
            const struct lw_guide_sample s = lw_guide_sample(&aim, normal, own);
            const float cosine = lw_vec3_dot(normal, s.direction);
            direction[lane] = s.direction;
            weight[lane] = cosine > 0 ? cosine / (LW_PI * s.density) : 0;
            place[lane] = s.place;
        } else if (b->way == VISIBLE && caps.count) {
            const bool by_caps = own[0] < lab.beta;
            own[0] =
                by_caps ? own[0] / lab.beta : fminf((own[0] - lab.beta) / (1 - lab.beta), 0x1.fffffep-1f);
            direction[lane] =
                by_caps ? caps_sample(&caps, own) : lw_direction_about(normal, lw_direction_cosine(own));
            const float cosine = lw_vec3_dot(normal, direction[lane]);
            const float density =
                (1 - lab.beta) * cosine / LW_PI + lab.beta * caps_density(&caps, direction[lane]);
            weight[lane] = cosine > 0 ? cosine / (LW_PI * density) : 0;
        } else
            direction[lane] = lw_direction_about(normal, lw_direction_cosine(own));
    }
}

/* What a ray teaches: the guide its luminance, the cell's list its block. */
static void teach(const struct bundle *b, const struct lw_points16 *at, uint32_t lane, uint32_t place,
                  uint32_t texel, float luminance) {
    lw_guide_note(lab.guide, place, luminance);
    struct list *l = &lab.list[cell_of(lw_vec3(at->x[lane], at->y[lane], at->z[lane]))];
    if (!l->seen) {
        l->seen = true;
        l->eye = lw_vec3(at->x[lane], at->y[lane], at->z[lane]);
        l->normal = lw_vec3(at->nx[lane], at->ny[lane], at->nz[lane]);
    }
    if (texel == LW_TEXEL_NONE) return;
    const uint32_t block = b->passes->tiles->block_of_texel[texel];
    const float light = light_of(l, block);
    if (light > 0) enlist(l, block, light);
}

static void trace_packet(const struct bundle *b, const uint32_t texel[LANES], uint16_t active, uint32_t block,
                         uint32_t set, uint32_t sample, float *sum) {
    const struct lw_transport *p = b->passes;
    const struct lw_solve_tile *tile = b->tile;
    struct lw_sample_points_lanes lanes;
    struct lw_ray16 rays;
    struct lw_hit16 hits;
    struct lw_vec3 direction[LANES];
    float weight[LANES], point[2];
    uint32_t local_texel[LANES], where[LANES], place[LANES] = {0};
    uint16_t going = 0;
    const uint32_t turn = lw_random_hash4(b->use, block, sample / LW_SAMPLE_POINTS_MAX, set);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        const uint32_t i = texel[active >> lane & 1 ? lane : 0];
        local_texel[lane] = tile->local + i;
        where[lane] = tile->mesh->sample_points.first[tile->local + i] +
                      lw_sample_points_choose(p->texels->usable[tile->first + i], sample, turn);
    }
    lw_sample_points_load(&tile->mesh->sample_points, tile->mesh->position, local_texel, where, &lanes);
    lw_sample_points_to_world(&b->frame, &lanes);
    lw_sampling_point(lw_sampling_seed(b->use, tile->object, block, LW_SAMPLING_BOUNCE), sample, set, point);
    draw(b, &lanes.at, point, direction, weight, place);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        lw_trace_set_ray(&rays, lane, lw_vec3(lanes.at.x[lane], lanes.at.y[lane], lanes.at.z[lane]),
                         direction[lane], INFINITY);
        if (active >> lane & 1 && weight[lane] > 0) going |= (uint16_t)(1u << lane);
    }
    rays.salt = sample;
    lw_trace_closest16(p->trace, LW_TRACE_COHERENT, going, &rays, &hits);
    for (uint32_t lane = 0; lane < LANES; lane++) {
        if (!(going >> lane & 1)) continue;
        const uint32_t end = hits.object[lane] == LW_TRACE_MISS
                                 ? LW_TEXEL_NONE
                                 : lw_texels_at(p->texels, hits.object[lane], hits.triangle[lane],
                                                hits.u[lane], hits.v[lane], hits.back[lane]);
        const float luminance = bench_radiance_of(p, end);
        sum[texel[lane]] += weight[lane] * luminance;
        if (b->teaches) teach(b, &lanes.at, lane, place[lane], end, luminance);
    }
}

/* One ray for every covered texel of the tile, by the solver's packets. */
static void trace_tile(const struct bundle *b, uint32_t sample, float *sum) {
    for (uint32_t y = 0; y < b->tile->height; y += BLOCK)
        for (uint32_t x = 0; x < b->tile->width; x += BLOCK) {
            const uint32_t number = (b->tile->y * 4 + y / BLOCK) << 16 | (b->tile->x * 4 + x / BLOCK);
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
}

static void experiment(const struct lw_transport *p, const struct lw_solve_tile *tile) {
    struct bundle b = {.passes = p, .tile = tile};
    static bench_plane reference[2], sum[WAYS];
    uint64_t cpu_ns[WAYS] = {0};
    lw_sample_points_frame_init(&b.frame, &p->pose->object_to_world[tile->object]);
    memset(reference, 0, sizeof reference);
    memset(sum, 0, sizeof sum);
    for (uint32_t j = 0; j < 2; j++)
        for (uint32_t s = 0; s < REFERENCE_SAMPLES; s++) {
            b.use = 1000 + j;
            trace_tile(&b, s, reference[j]);
        }
    bench_count_means(p, tile, &scales, lab.means);
    for (uint32_t m = 0, done = 0; m < lab.moments; m++)
        for (; done < 1u << m; done++)
            for (uint32_t w = 0; w < WAYS; w++) { /* alternately: all meet the same machine */
                b.way = (enum way)w;
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

static void teach_tile(const struct lw_transport *p, const struct lw_solve_tile *tile) {
    struct bundle b = {.passes = p, .tile = tile, .way = LEARNED, .teaches = true, .use = 500};
    static bench_plane ignored;
    lw_sample_points_frame_init(&b.frame, &p->pose->object_to_world[tile->object]);
    for (uint32_t s = 0; s < TEACHING_RAYS; s++) trace_tile(&b, lab.teaching_sample + s, ignored);
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
    if (!lab.teaching && !lab.armed) return;
    if (!lab.sphere) {
        lab.sphere = calloc(p->tiles->block_count, sizeof *lab.sphere);
        assert(lab.sphere);
        find_spheres(p);
    }
    if (lab.teaching) teach_tile(p, tile);
    if (!lab.armed || tile->id.v % lab.stride != 0) return;
    if (!lab.texels) spread(p);
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
                                                                       .bounces = 4,
                                                                       .direct_samples = 1,
                                                                       .indirect_samples = 2,
                                                                       .target_error = -1,
                                                                       .threads = 1},
                                              pose, &solver, err);
    if (status != LW_OK) return status;
    for (int64_t f = 1; status == LW_OK && f <= s->frames; f++) {
        lab.armed = f == s->frames;
        lab.teaching = f > s->frames / 2 && !lab.armed;
        status = solver->ops->frame(solver, pose, (uint64_t)f, &stats, err);
        if (lab.teaching) lw_guide_learn(lab.guide, 1);
        lab.teaching_sample += TEACHING_RAYS;
        if (f > 1) continue;
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
    solver->ops->destroy(solver);
    return status;
}

/* Room for guide and lists over the scene. */
static enum lw_status set_up(const struct settings *s, const struct lw_scene *scene,
                             const struct lw_pose *pose, struct lw_error *err) {
    struct lw_guide_desc desc = {.alpha = (float)s->alpha, .beta = (float)s->beta};
    if (!lw_pose_bounds(pose, scene, &desc.minimum_ws, &desc.maximum_ws))
        return lw_status_fail(err, LW_BAD_DATA, "the scene is empty");
    const struct lw_vec3 size = lw_vec3_sub(desc.maximum_ws, desc.minimum_ws);
    lab.low = desc.minimum_ws;
    lab.cells_per_m = lw_vec3((float)SIDE / fmaxf(size.x, 1e-20f), (float)SIDE / fmaxf(size.y, 1e-20f),
                              (float)SIDE / fmaxf(size.z, 1e-20f));
    lab.beta = desc.beta;
    lab.list = calloc(CELLS, sizeof *lab.list);
    lab.next = calloc(CELLS, sizeof *lab.next);
    if (!lab.list || !lab.next) return lw_status_fail(err, LW_NO_MEMORY, "no memory for lists");
    return lw_guide_create(&desc, &lab.guide, err);
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
    if (status == LW_OK) status = set_up(s, scene, &pose, err);
    if (status == LW_OK) status = light(s, scene, &pose, &map, err);
    if (status == LW_OK && lab.texels == 0) status = lw_status_fail(err, LW_USAGE, "%s: no texels", name);
    for (uint32_t w = 0; status == LW_OK && w < WAYS; w++)
        for (uint32_t m = 0; m < lab.moments; m++) {
            const struct tally *t = &lab.tally[w][m];
            const double us = 1e-3 * (double)t->cpu_ns / (double)lab.texels;
            printf("%s,%llu,%s,%u,%.4f,%.3f,%.6g,%.6g\n", bench_label(name, label, sizeof label),
                   (unsigned long long)lab.texels, way_name[w], 1u << m, us, (double)(1u << m) / us,
                   t->error[0] / (double)lab.means[0], t->error[1] / (double)lab.means[1]);
        }
    fflush(stdout);
    lw_guide_destroy(lab.guide);
    free(lab.list);
    free(lab.next);
    free(lab.sphere);
    bench_close(scene, &pose, &map);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.samples = 64,
                         .texels = 20000,
                         .frames = 12,
                         .beta = (double)LW_GUIDE_BETA,
                         .alpha = (double)LW_GUIDE_ALPHA};
    const struct lw_option table[] = {
        {"samples", "N", "rays per texel at most, a power of two (default 64)", LW_OPTION_INT, &s.samples, 1,
         1 << (MOMENTS_MAX - 1), NULL},
        {"texels", "N", "to estimate, some (default 20000)", LW_OPTION_INT, &s.texels, 1, 1 << 30, NULL},
        {"frames", "N", "of light before; those of the second half teach (default 12)", LW_OPTION_INT,
         &s.frames, 4, 10000, NULL},
        {"alpha", "A", "weight of a note (default 0.05)", LW_OPTION_REAL, &s.alpha, 1e-6, 1, NULL},
        {"beta", "B", "share of guided directions (default 0.5)", LW_OPTION_REAL, &s.beta, 1e-3, 0.999,
         NULL}};
    return bench_main(&(struct bench_program){.name = "bench_guide",
                                              .about = "Guided bounce rays in the cell solver: error at "
                                                       "equal rays and at equal time, as CSV.",
                                              .table = table,
                                              .count = sizeof table / sizeof table[0],
                                              .open = &s.open,
                                              .context = &s,
                                              .heading = "scene,texels,way,rays,us_per_texel,mrays_per_s,"
                                                         "relmse,relmse_16x16",
                                              .run = run},
                      argc, argv);
}
