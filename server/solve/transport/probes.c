#include "server/solve/transport/probes.h"

#include "common/base/invariant.h"
#include "common/base/sampling.h"
#include "common/light/direction.h"
#include "server/solve/transport/octahedral.h"
#include "server/solve/transport/ray_hit.h"

#include <stdlib.h>
#include <string.h>

#define DEPTH_SIDE     16u
#define DEPTH_CELLS    ((DEPTH_SIDE + 2) * (DEPTH_SIDE + 2))
#define DEPTH_CHANNELS 5u
#define DEPTH_MEANS    3u    /* the first channels; the others are extremes */
#define DEPTH_RAYS     1024u /* four a cell */
#define SURVEY_RAYS    128u
/* A point that sees more backs of single-sided surfaces than this is inside
 * something (Majercik et al. 2021). */
#define BACKS_MAX 0.25f
/* A probe keeps this clear of surfaces, in shares of the grid's shortest side: nearer, one surface fills its
 * view and hides the other part of the box that it stands for. */
#define CLEARANCE 0.15f
/* How far a probe may leave the middle of its box, in shares of its sides: the trilinear
 * weights are those of the grid. */
#define REACH 0.4f
/* Probes tried per look-up. More of them spare rays where one of the eight sees the point; but when few do,
 * these stand for more of the light than their place warrants. */
#define TRIES 3u
/* Under this much of Chebyshev's bound a point counts as unseen: the bound has a long tail, and a bright room
 * behind a thin wall shines through the least weight. */
#define VISIBILITY_MIN 0.5f

/* While nothing changes, a probe past this age gathers in one of PERIOD frames: its noise is far under the
 * texels' by then, and all probes together may cost as much as the texels of a small scene. */
#define EAGER_AGE 8u
#define PERIOD    4u
/* Steps towards the point that ray and probe see in common, and how far apart what they see may be in the
 * end, as seen from the probe: about a cell of the map. More, and something stands between. */
#define AIM_STEPS    3
#define AIM_MISS_MAX 0.1f
/* A probe does not answer for a ray that on its way there, tested at this many points, ... */
#define WAY_STEPS 8
/* ... is farther off than the nearest that the probe sees in that cell by this share: it
 * may have hit what hides it. */
#define WAY_BEHIND_MAX 0.1f
/* Nor from an edge, where the nearest and the farthest in the cells that a read blends differ by more
 * than this factor: light beyond the edge would be handed to surfaces before it, and to the sky. Without
 * the two, Sponza under its sun gets 3 % too much light at a range of a tenth of its length, its darkest
 * places many times theirs; with this alone 0.4 %, with both 0.1 %. At a factor of 2 it is 0.7 %, for
 * half as many answers again. */
#define EDGE_MAX 1.5f

static void lay_grid(struct lw_probes *probes) {
    struct lw_vec3 extent = lw_vec3_sub(probes->desc.maximum_ws, probes->desc.minimum_ws);
    const float longest = fmaxf(extent.x, fmaxf(extent.y, extent.z));
    const uint32_t most = probes->desc.spacing_m > 0 ? LW_PROBES_MAX : LW_PROBES_DEFAULT;
    float spacing = fmaxf(probes->desc.spacing_m, longest / (float)LW_CELLS_PER_AXIS_MAX);
    do {
        lw_cells_init(&probes->grid, probes->desc.minimum_ws, probes->desc.maximum_ws, spacing);
        probes->count = lw_cells_total(&probes->grid);
        spacing *= 1.03f;
    } while (probes->count > most);
    LW_INVARIANT(probes->count > 0 && probes->count <= LW_PROBES_MAX); /* a ray hit's bits name each */
}

static void bound_meshes(struct lw_probes *probes) {
    const struct lw_scene *scene = probes->desc.scene;
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        struct lw_vec3 *box = probes->box_os[m];
        box[0] = lw_vec3(INFINITY, INFINITY, INFINITY);
        box[1] = lw_vec3(-INFINITY, -INFINITY, -INFINITY);
        for (uint32_t v = 0; v < scene->mesh[m].vertex_count; v++) {
            box[0] = lw_vec3_min(box[0], scene->mesh[m].position[v]);
            box[1] = lw_vec3_max(box[1], scene->mesh[m].position[v]);
        }
    }
}

enum lw_status lw_probes_init(struct lw_probes *probes, const struct lw_probes_desc *desc) {
    *probes = (struct lw_probes){.desc = *desc, .form = lw_probe_form(desc->form)};
    lay_grid(probes);
    /* The farthest point that a probe is read for lies a box away from its own, diagonally. */
    probes->depth_max_m = lw_vec3_length(probes->grid.size_m) * (1 + REACH) * 1.05f;
    const size_t count = probes->count, views = count * desc->bounces + 1;
    probes->probe = calloc(count, sizeof *probes->probe);
    probes->box_os = calloc((size_t)desc->scene->mesh_count + 1, sizeof *probes->box_os);
    probes->placed_for = calloc((size_t)desc->scene->object_count + 1, sizeof *probes->placed_for);
    probes->hidden_for = calloc((size_t)desc->scene->object_count + 1, sizeof *probes->hidden_for);
    probes->depth = calloc(count * DEPTH_CELLS * DEPTH_CHANNELS, sizeof *probes->depth);
    probes->ray = calloc(count * LW_PROBES_RAYS, sizeof *probes->ray);
    probes->sum = calloc(views * probes->form->sum_floats, sizeof *probes->sum);
    probes->map = calloc(views * probes->form->map_floats, sizeof *probes->map);
    if (!probes->probe || !probes->box_os || !probes->placed_for || !probes->hidden_for || !probes->depth ||
        !probes->ray || !probes->sum || !probes->map) {
        lw_probes_finish(probes);
        return LW_NO_MEMORY;
    }
    bound_meshes(probes);
    return LW_OK;
}

void lw_probes_finish(struct lw_probes *probes) {
    free(probes->map);
    free(probes->sum);
    free(probes->ray);
    free(probes->depth);
    free(probes->hidden_for);
    free(probes->placed_for);
    free(probes->box_os);
    free(probes->probe);
    *probes = (struct lw_probes){0};
}

size_t lw_probes_memory_bytes(const struct lw_probes *probes) {
    const size_t per_view = ((size_t)probes->form->sum_floats + probes->form->map_floats) * sizeof(float);
    return probes->count * (sizeof *probes->probe + DEPTH_CELLS * DEPTH_CHANNELS * sizeof(float) +
                            LW_PROBES_RAYS * sizeof *probes->ray + probes->desc.bounces * per_view);
}

uint32_t lw_probes_list_parts(const struct lw_probes *probes,
                              struct lw_checkpoint_part out_part[LW_PROBES_PARTS]) {
    const size_t count = probes->count, views = count * probes->desc.bounces;
    uint32_t n = 0;
    out_part[n++] = (struct lw_checkpoint_part){probes->probe, count * sizeof *probes->probe};
    out_part[n++] = (struct lw_checkpoint_part){probes->depth,
                                                count * DEPTH_CELLS * DEPTH_CHANNELS * sizeof *probes->depth};
    out_part[n++] =
        (struct lw_checkpoint_part){probes->sum, views * probes->form->sum_floats * sizeof *probes->sum};
    out_part[n++] =
        (struct lw_checkpoint_part){probes->map, views * probes->form->map_floats * sizeof *probes->map};
    return n;
}

/* Sixteen rays of a sequence that covers the sphere evenly. */
static void set_rays(struct lw_ray16 *rays, struct lw_vec3 from, uint32_t seed, uint32_t first) {
    rays->salt = first;
    for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) {
        float point[2];
        lw_random_sobol2(first + i, seed, point);
        lw_trace_set_ray(rays, i, from, lw_direction_sphere(point), INFINITY);
    }
}

static struct lw_vec3 ray_direction(const struct lw_ray16 *rays, uint32_t i) {
    return lw_vec3(rays->dir_x[i], rays->dir_y[i], rays->dir_z[i]);
}

static bool black_back(const struct lw_scene *scene, const struct lw_hit16 *hits, uint32_t i) {
    return hits->back[i] && !lw_trace_material(scene, hits, i)->double_sided;
}

/* What a place is worth: the distance to the nearest surface, up to `enough`; negative inside something. */
static float worth_of(const struct lw_probes *probes, const struct lw_trace *trace, struct lw_vec3 place,
                      float enough) {
    uint32_t backs = 0;
    float nearest = enough;
    for (uint32_t first = 0; first < SURVEY_RAYS; first += LW_TRACE_WIDTH) {
        struct lw_ray16 rays;
        struct lw_hit16 hits;
        set_rays(&rays, place, 0, first);
        lw_trace_closest16(trace, LW_TRACE_LIGHT, UINT16_MAX, &rays, &hits);
        for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) {
            if (hits.object[i] == LW_TRACE_MISS) continue;
            backs += black_back(probes->desc.scene, &hits, i);
            nearest = fminf(nearest, hits.t[i]);
        }
    }
    return (float)backs > BACKS_MAX * SURVEY_RAYS ? -1 : nearest;
}

/* Moves a probe as little as will do: its place now, the middle of its box, then
 * places around it, nearest first. */
static uint64_t choose_place(struct lw_probes *probes, const struct lw_trace *trace, uint32_t p,
                             bool placed) {
    struct lw_probe *probe = &probes->probe[p];
    const struct lw_vec3 size = probes->grid.size_m, centre = lw_cells_centre(&probes->grid, p);
    const float enough = CLEARANCE * fminf(size.x, fminf(size.y, size.z));
    struct lw_vec3 best_place = placed ? probe->position_ws : centre;
    float best = worth_of(probes, trace, best_place, enough);
    uint64_t rays = SURVEY_RAYS;
    for (int steps = 0; steps <= 3 && best < enough; steps++) /* along how many axes the place differs */
        for (int i = 0; i < 27 && best < enough; i++) {
            const int x = i % 3 - 1, y = i / 3 % 3 - 1, z = i / 9 - 1;
            if (abs(x) + abs(y) + abs(z) != steps) continue;
            struct lw_vec3 offset = lw_vec3((float)x * REACH, (float)y * REACH, (float)z * REACH);
            struct lw_vec3 place = lw_vec3_add(centre, lw_vec3_mul(offset, size));
            float worth = worth_of(probes, trace, place, enough);
            rays += SURVEY_RAYS;
            if (worth <= best) continue;
            best = worth;
            best_place = place;
        }
    const bool moved = !placed || memcmp(&best_place, &probe->position_ws, sizeof best_place) != 0 ||
                       probe->dead != (best < 0);
    if (moved) *probe = (struct lw_probe){.position_ws = best_place, .dead = best < 0};
    LW_INVARIANT_DEAR(lw_cells_at(&probes->grid, probe->position_ws) == p); /* it stays in its box */
    return rays;
}

static float *depth_of(const struct lw_probes *probes, uint32_t p) {
    return probes->depth + (size_t)p * DEPTH_CELLS * DEPTH_CHANNELS;
}

/* Moments of the distance to what the probe sees, per direction. */
static uint64_t look_around(struct lw_probes *probes, const struct lw_trace *trace, uint32_t p) {
    const struct lw_vec3 from = probes->probe[p].position_ws;
    float *depth = depth_of(probes, p), weight[DEPTH_CELLS] = {0};
    memset(depth, 0, DEPTH_CELLS * DEPTH_CHANNELS * sizeof *depth);
    for (uint32_t first = 0; first < DEPTH_RAYS; first += LW_TRACE_WIDTH) {
        struct lw_ray16 rays;
        struct lw_hit16 hits;
        set_rays(&rays, from, lw_sampling_seed(probes->desc.seed, p, 1, LW_SAMPLING_PROBE), first);
        lw_trace_closest16(trace, LW_TRACE_LIGHT, UINT16_MAX, &rays, &hits);
        for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) {
            const struct lw_vec3 d = ray_direction(&rays, i);
            float t = hits.object[i] == LW_TRACE_MISS
                          ? lw_vec3_length(lw_vec3_sub(lw_cells_project(&probes->grid, from, d), from))
                          : hits.t[i];
            float cut = hits.object[i] == LW_TRACE_MISS ? probes->depth_max_m : fminf(t, probes->depth_max_m);
            const uint32_t cell = lw_octahedral_cell(DEPTH_SIDE, d);
            weight[cell] += 1;
            depth[cell * DEPTH_CHANNELS] += cut;
            depth[cell * DEPTH_CHANNELS + 1] += cut * cut;
            depth[cell * DEPTH_CHANNELS + 2] += t;
            const float inverse = hits.object[i] == LW_TRACE_MISS ? 0 : 1 / fmaxf(t, 1e-6f);
            float *range = depth + cell * DEPTH_CHANNELS + 3;
            range[0] = weight[cell] > 1 ? fmaxf(range[0], inverse) : inverse;
            range[1] = weight[cell] > 1 ? fminf(range[1], inverse) : inverse;
        }
    }
    /* A cell without a ray says that nothing is seen there. */
    for (uint32_t cell = 0; cell < DEPTH_CELLS; cell++)
        for (uint32_t c = 0; c < DEPTH_MEANS && weight[cell] > 0; c++)
            depth[cell * DEPTH_CHANNELS + c] /= weight[cell];
    for (uint32_t cell = 0; cell < DEPTH_CELLS; cell++)
        LW_INVARIANT_DEAR(depth[cell * DEPTH_CHANNELS + 3] >= depth[cell * DEPTH_CHANNELS + 4]);
    lw_octahedral_wrap(depth, DEPTH_SIDE, DEPTH_CHANNELS);
    return DEPTH_RAYS;
}

/* Whether a probe may see, within the distances that matter, the box of an object in some place. */
static bool near_object(const struct lw_probes *probes, const struct lw_probe *probe, uint32_t object,
                        const struct lw_affine *to_world) {
    const struct lw_vec3 *box = probes->box_os[probes->desc.scene->object[object].mesh];
    struct lw_vec3 lo = lw_vec3(INFINITY, INFINITY, INFINITY), hi = lw_vec3(-INFINITY, -INFINITY, -INFINITY);
    for (int i = 0; i < 8; i++) {
        struct lw_vec3 p = lw_affine_point(to_world, lw_vec3(box[i & 1].x, box[i >> 1 & 1].y, box[i >> 2].z));
        lo = lw_vec3_min(lo, p);
        hi = lw_vec3_max(hi, p);
    }
    const struct lw_vec3 p = probe->position_ws, gap = lw_vec3_max(lw_vec3_sub(lo, p), lw_vec3_sub(p, hi));
    return lw_vec3_length(lw_vec3_max(gap, lw_vec3(0, 0, 0))) < probes->depth_max_m;
}

static bool disturbed(const struct lw_probes *probes, uint32_t p, const struct lw_pose *pose,
                      const uint32_t *moved, uint32_t moved_count) {
    for (uint32_t i = 0; i < moved_count; i++)
        if (near_object(probes, &probes->probe[p], moved[i], &probes->placed_for[moved[i]]) ||
            near_object(probes, &probes->probe[p], moved[i], &pose->object_to_world[moved[i]]))
            return true;
    return false;
}

uint64_t lw_probes_place(struct lw_probes *probes, const struct lw_pose *pose, const struct lw_trace *trace,
                         int threads) {
    const uint32_t objects = probes->desc.scene->object_count;
    const bool placed = probes->alive > 0;
    uint32_t *moved = malloc(((size_t)objects + 1) * sizeof *moved), moved_count = 0;
    for (uint32_t o = 0; moved && o < objects; o++)
        if (pose->object_hidden[o] != probes->hidden_for[o] ||
            (!pose->object_hidden[o] &&
             memcmp(&probes->placed_for[o], &pose->object_to_world[o], sizeof *probes->placed_for)))
            moved[moved_count++] = o;
    uint64_t rays = 0;
    uint32_t alive = 0;
#pragma omp parallel for schedule(dynamic, 4) num_threads(threads) reduction(+ : rays, alive)
    for (uint32_t p = 0; p < probes->count; p++) {
        /* Without memory for the list: all of them. */
        if (!placed || !moved || disturbed(probes, p, pose, moved, moved_count)) {
            rays += choose_place(probes, trace, p, placed);
            if (!probes->probe[p].dead) rays += look_around(probes, trace, p);
        }
        alive += !probes->probe[p].dead;
    }
    LW_INVARIANT(alive <= probes->count && moved_count <= objects);
    probes->alive = alive;
    memcpy(probes->placed_for, pose->object_to_world, objects * sizeof *probes->placed_for);
    memcpy(probes->hidden_for, pose->object_hidden, objects * sizeof *probes->hidden_for);
    free(moved);
    return rays;
}

static uint32_t gather_seed(const struct lw_probes *probes, uint32_t p) {
    return lw_sampling_seed(probes->desc.seed, p, 0, LW_SAMPLING_PROBE);
}

uint64_t lw_probes_gather(struct lw_probes *probes, const struct lw_wall_sides *sides, uint32_t frame,
                          bool eager, int threads) {
    uint64_t count = 0;
#pragma omp parallel for schedule(dynamic, 4) num_threads(threads) reduction(+ : count)
    for (uint32_t p = 0; p < probes->count; p++) {
        struct lw_probe *probe = &probes->probe[p];
        probe->gathered = !probe->dead && (eager || probe->age < EAGER_AGE || (p + frame) % PERIOD == 0);
        if (!probe->gathered) continue;
        for (uint32_t first = 0; first < LW_PROBES_RAYS; first += LW_TRACE_WIDTH) {
            struct lw_ray16 rays;
            struct lw_hit16 hits;
            set_rays(&rays, probe->position_ws, gather_seed(probes, p), probe->age * LW_PROBES_RAYS + first);
            lw_trace_closest16(sides->trace, LW_TRACE_LIGHT, UINT16_MAX, &rays, &hits);
            uint32_t texel[LW_TRACE_WIDTH];
            lw_wall_sides_at16(sides, UINT16_MAX, &rays, &hits, texel);
            for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) {
                LW_INVARIANT_DEAR(texel[i] == LW_RAY_HIT_NOTHING || sides->texels->covered[texel[i]]);
                probes->ray[p * LW_PROBES_RAYS + first + i] =
                    (struct lw_probe_ray){.direction = ray_direction(&rays, i), .hit = texel[i]};
            }
        }
        probe->age++;
        count += LW_PROBES_RAYS;
    }
    return count;
}

void lw_probes_project(struct lw_probes *probes, uint32_t bounce, const uint64_t *radiance,
                       uint32_t history_max, int threads) {
    const struct lw_probe_form_ops *form = probes->form;
#pragma omp parallel for schedule(dynamic, 4) num_threads(threads)
    for (uint32_t p = 0; p < probes->count; p++) {
        if (!probes->probe[p].gathered) continue;
        float sum[LW_PROBE_FORM_FLOATS_MAX];
        memset(sum, 0, form->sum_floats * sizeof *sum);
        for (uint32_t r = 0; r < LW_PROBES_RAYS; r++) {
            const struct lw_probe_ray *ray = &probes->ray[p * LW_PROBES_RAYS + r];
            const struct lw_vec3 l = lw_packed_light_unpack(
                ray->hit == LW_RAY_HIT_NOTHING ? 0 : radiance[ray->hit], LW_PACKED_LIGHT_POSITIVE);
            form->add(sum, ray->direction, (const float[3]){l.x, l.y, l.z});
        }
        const size_t view = (size_t)bounce * probes->count + p;
        float *mean = probes->sum + view * form->sum_floats;
        LW_INVARIANT(probes->probe[p].age > 0 && !probes->probe[p].dead);
        const uint32_t before = probes->probe[p].age - 1;
        const float weight = 1.0f / (float)((before < history_max ? before : history_max) + 1u);
        for (uint32_t i = 0; i < form->sum_floats; i++)
            mean[i] += (sum[i] * (1.0f / LW_PROBES_RAYS) - mean[i]) * weight;
        form->to_map(mean, probes->map + view * form->map_floats);
    }
}

float lw_probes_visibility(const struct lw_probes *probes, uint32_t p, struct lw_vec3 point_ws) {
    if (probes->probe[p].dead) return 0;
    struct lw_vec3 towards = lw_vec3_sub(point_ws, probes->probe[p].position_ws);
    const float distance = lw_vec3_length(towards);
    if (!(distance > 0)) return 1;
    float depth[DEPTH_CHANNELS];
    lw_octahedral_read(depth_of(probes, p), DEPTH_SIDE, DEPTH_CHANNELS, towards, depth);
    const float variance = fmaxf(depth[1] - depth[0] * depth[0], 0);
    /* A deviation short of the mean: behind a thin wall seen aslant, the mean alone
     * would let through a centimetre. */
    const float off = distance - depth[0] + sqrtf(variance);
    if (off <= 0) return 1;
    const float bound = variance / (variance + off * off); /* Chebyshev's, one-sided */
    return bound > VISIBILITY_MIN ? bound * bound * bound : 0;
}

/* One of the eight probes around a point, each with the probability of its trilinear weight. */
static uint32_t pick(const struct lw_cells *grid, struct lw_vec3 point, uint32_t random) {
    const float position[3] = {point.x, point.y, point.z},
                minimum[3] = {grid->minimum_ws.x, grid->minimum_ws.y, grid->minimum_ws.z},
                size[3] = {grid->size_m.x, grid->size_m.y, grid->size_m.z};
    uint32_t index = 0, stride = 1;
    for (int axis = 0; axis < 3; axis++) {
        const float last = (float)(grid->count[axis] - 1);
        float s = (position[axis] - minimum[axis]) / size[axis] - 0.5f;
        s = s > 0 ? s < last ? s : last : 0; /* beyond the outermost probes: the last; NaN: 0 */
        const uint32_t below = (uint32_t)s;
        const float unit = (float)(random >> axis * 10 & 1023u) * (1 / 1024.0f);
        index += (below + (unit < s - (float)below)) * stride;
        stride *= grid->count[axis];
    }
    LW_INVARIANT_DEAR(index < stride);
    return index;
}

/* Whether a ray from start to towards, both as seen from the probe, runs in front
 * of all that the probe sees. */
static bool way_is_free(const float *depth, struct lw_vec3 start, struct lw_vec3 towards) {
    const struct lw_vec3 way = lw_vec3_sub(towards, start);
    for (int i = 1; i < WAY_STEPS; i++) {
        const struct lw_vec3 at = lw_vec3_mad(start, way, (float)i / WAY_STEPS);
        const float distance = lw_vec3_length(at);
        if (!(distance > 0)) continue;
        const float nearest = depth[(size_t)lw_octahedral_cell(DEPTH_SIDE, at) * DEPTH_CHANNELS + 3];
        if (distance * nearest > 1 + WAY_BEHIND_MAX) return false;
    }
    return true;
}

/* Whether the four cells that a read blends hold more than one thing. */
static bool at_edge(const float *depth, struct lw_vec3 towards) {
    const struct lw_vec2 p = lw_octahedral_encode(towards);
    const uint32_t x = (uint32_t)(p.x * DEPTH_SIDE + 0.5f), y = (uint32_t)(p.y * DEPTH_SIDE + 0.5f);
    float nearest = 0, farthest = INFINITY;
    for (uint32_t i = 0; i < 4; i++) {
        const uint32_t cell = (y + i / 2) * (DEPTH_SIDE + 2) + x + i % 2;
        nearest = fmaxf(nearest, depth[cell * DEPTH_CHANNELS + 3]);
        farthest = fminf(farthest, depth[cell * DEPTH_CHANNELS + 4]);
    }
    return nearest > farthest * EDGE_MAX;
}

/* The direction in which a probe sees what the ray runs towards; false if it cannot know. */
static bool aim(const struct lw_probes *probes, uint32_t p, struct lw_vec3 point, struct lw_vec3 direction,
                struct lw_vec3 *out_towards) {
    const struct lw_vec3 from = probes->probe[p].position_ws, start = lw_vec3_sub(point, from);
    if (probes->desc.projection == LW_PROBE_PROJECTION_BOX) {
        *out_towards = lw_vec3_sub(lw_cells_project(&probes->grid, point, direction), from);
        return true;
    }
    if (probes->desc.projection == LW_PROBE_PROJECTION_STEP) {
        const struct lw_vec3 extent = lw_vec3_sub(probes->grid.maximum_ws, probes->grid.minimum_ws);
        *out_towards = lw_vec3_mad(start, direction, fmaxf(extent.x, fmaxf(extent.y, extent.z)));
        return true;
    }
    /* What the probe sees there lies at that distance: a fixed point on the ray, found in a few steps. */
    struct lw_vec3 towards = direction;
    for (int i = 0;; i++) {
        float depth[DEPTH_CHANNELS];
        struct lw_vec3 unit = lw_vec3_normalize(towards);
        lw_octahedral_read(depth_of(probes, p), DEPTH_SIDE, DEPTH_CHANNELS, unit, depth);
        const struct lw_vec3 seen = lw_vec3_scale(unit, depth[2]);
        const float along = lw_vec3_dot(lw_vec3_sub(seen, start), direction);
        towards = lw_vec3_mad(start, direction, fmaxf(0, along));
        if (i < AIM_STEPS) continue;
        *out_towards = towards;
        struct lw_vec3 off = lw_vec3_sub(seen, towards);
        if (!(lw_vec3_dot(off, off) <= AIM_MISS_MAX * AIM_MISS_MAX * depth[2] * depth[2])) return false;
        if (!(lw_vec3_dot(towards, towards) > 0)) return true;
        return !at_edge(depth_of(probes, p), towards) && way_is_free(depth_of(probes, p), start, towards);
    }
}

uint32_t lw_probes_ask(const struct lw_probes *probes, struct lw_vec3 point_ws, struct lw_vec3 direction,
                       uint32_t random) {
    for (uint32_t i = 0; i < TRIES; i++) {
        random = lw_random_hash(random);
        const uint32_t p = pick(&probes->grid, point_ws, random);
        random = lw_random_hash(random);
        if (!(lw_random_unit(random) < lw_probes_visibility(probes, p, point_ws))) continue;
        struct lw_vec3 towards;
        if (!aim(probes, p, point_ws, direction, &towards)) continue;
        return lw_ray_hit_pack_probe(p, lw_vec3_dot(towards, towards) > 0 ? towards : direction);
    }
    return LW_PROBES_UNSEEN;
}
