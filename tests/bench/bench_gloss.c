/* bench_gloss: what glossy bounces bring, which the solve takes as even ones.
 *
 *     bench_gloss [OPTIONS] SCENE...
 *
 * Indirect E of texels, the solve's over that of paths that bounce by all lobes, normal maps included; one
 * row for each object with much light, and one for all. Columns:
 *   texels      of the object, those that paths start from
 *   E           indirect, by paths, W/m^2, luminance, with the standard error
 *   all         ratio: surfaces send back evenly all that their lobes send back (lw_lobes_albedo())
 *   left        ratio: what their gloss leaves; what is mirrored is lost
 *   matt        ratio, both without finishes: what the size of texels does
 *   tiles       in the row of all: mean of |solve - paths| / paths over tiles, weighted by their light, of
 *               each of the three */
#include "client/view/place.h"
#include "common/colour.h"
#include "common/light/direction.h"
#include "common/light/lights.h"
#include "common/random.h"
#include "common/shading/lobe_table.h"
#include "common/trace/trace.h"
#include "server/solve/geometry.h"
#include "server/solve/solvers.h"
#include "tests/bench/bench_light.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LANES      LW_TRACE_WIDTH
#define TILE_SPOTS 12u /* fewer of a tile are too noisy to be compared */

enum solve { SOLVE_ALL, SOLVE_LEFT, SOLVE_MATT, SOLVES };

struct settings {
    struct lw_scene_open open;
    int64_t bounces, frames, spp, texels, rows;
    const char *without;
};

/* A texel that paths start from. */
struct spot {
    uint32_t object, local, texel, tile;
    double paths[2], variance[2]; /* with finishes and without: luminance of E, and its variance */
    double solved[SOLVES];
};

struct job {
    const struct settings *settings;
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_geometry geometry;
    struct lw_lights lights;
    struct lw_place *place;
    struct spot *spot;
    size_t count;
};

/* ---- albedo of bounces ---- */

static bool leaves_mirrored;

static float many_times(float f0, float f90, float e) {
    const float f = f0 + (f90 - f0) * (1.0f / 21);
    return f * f * e / (1 - f * (1 - e));
}

struct lw_vec3 __real_lw_lobes_albedo(const struct lw_lobes *lobes);
struct lw_vec3 __wrap_lw_lobes_albedo(const struct lw_lobes *lobes);
struct lw_vec3 __wrap_lw_lobes_albedo(const struct lw_lobes *lobes) {
    const struct lw_vec3 all = __real_lw_lobes_albedo(lobes);
    if (!leaves_mirrored || !lw_lobes_mirror(lobes)) return all;
    const struct lw_lobe_share s = lw_lobe_table_mean(lobes->roughness);
    const float e = fminf(s.a + s.b, 1), f90 = lobes->f90;
    const float f0[3] = {lobes->f0.x, lobes->f0.y, lobes->f0.z}, sent[3] = {all.x, all.y, all.z};
    float left[3];
    for (int c = 0; c < 3; c++)
        left[c] = fmaxf(sent[c] - f0[c] * s.a - f90 * s.b - (1 - e) * many_times(f0[c], f90, e), 0);
    return lw_vec3(left[0], left[1], left[2]);
}

/* ---- paths ---- */

struct vertex {
    struct lw_vec3 origin, normal, face, t, b; /* normal: of the map, on the side that was met */
    struct lw_lobes_seen seen;
    struct lw_vec3 throughput;
};

static struct lw_vec3 to_frame(const struct vertex *v, struct lw_vec3 d) {
    return lw_vec3(lw_vec3_dot(d, v->t), lw_vec3_dot(d, v->b), lw_vec3_dot(d, v->normal));
}

/* The normal of the map, unless the eye is behind it. */
static struct lw_vec3 bumped(const struct job *job, const struct lw_hit16 *hits, unsigned i,
                             const struct lw_finish_point *finish, struct lw_vec3 normal,
                             struct lw_vec3 to_eye) {
    if (!finish->bumpy) return normal;
    const struct lw_vec3 tangent =
        lw_affine_vector(&job->pose.object_to_world[hits->object[i]],
                         lw_vec3(finish->tangent.x, finish->tangent.y, finish->tangent.z));
    const float side = hits->back[i] ? -1 : 1;
    const struct lw_vec3 bump =
        lw_vec3_scale(lw_scene_bump(finish, lw_vec3_scale(normal, side), tangent), side);
    return lw_vec3_dot(bump, to_eye) > 0.01f ? bump : normal;
}

/* Whether the path goes on from what lane i has met; *out_emission: what it shines. */
static bool arrive(const struct job *job, const struct lw_ray16 *rays, const struct lw_hit16 *hits,
                   unsigned i, struct vertex *v, struct lw_vec3 *out_emission) {
    const uint32_t object = hits->object[i];
    const struct lw_vec3 direction = lw_vec3(rays->dir_x[i], rays->dir_y[i], rays->dir_z[i]);
    if (object == LW_TRACE_MISS) {
        *out_emission = lw_scene_sky(job->scene, direction);
        return false;
    }
    const struct lw_mesh *mesh = &job->scene->mesh[job->scene->object[object].mesh];
    struct lw_surface surface;
    struct lw_finish_point finish;
    *out_emission = lw_vec3(0, 0, 0);
    lw_scene_surface(job->scene, mesh, hits->triangle[i], hits->u[i], hits->v[i], &surface);
    if ((hits->back[i] && !surface.material->double_sided) || surface.material->unlit) return false;
    *out_emission = surface.emission;
    lw_scene_finish(job->scene, mesh, hits->triangle[i], hits->u[i], hits->v[i], &surface, &finish);
    const struct lw_place_point at = lw_place_point(&job->place[object], mesh, hits, i, &surface);
    const struct lw_vec3 to_eye = lw_vec3_scale(direction, -1);
    v->origin = at.origin;
    v->face = at.face;
    v->normal = bumped(job, hits, i, &finish, at.normal, to_eye);
    lw_vec3_frame(v->normal, &v->t, &v->b);
    v->seen = lw_lobes_see(&finish.lobes, to_frame(v, to_eye));
    return true;
}

static float weight_of(float own, float other) { return own * own / (own * own + other * other); }

/* One sample of the lamps at each vertex. */
static void light16(const struct job *job, const struct vertex v[LANES], uint16_t active, uint32_t seed,
                    uint32_t index, struct lw_vec3 sum[LANES]) {
    struct lw_ray16 rays = {.salt = seed ^ index};
    struct lw_vec3 arriving[LANES];
    uint16_t lit = 0;
    for (unsigned i = 0; i < LANES; i++) {
        if (!(active >> i & 1u)) continue;
        float pick[2], at[2];
        lw_random_sobol2(index + i, lw_random_hash2(seed, 1), pick);
        lw_random_sobol2(index + i, lw_random_hash2(seed, 2), at);
        const struct lw_light_sample s =
            lw_lights_sample(&job->lights, v[i].origin, v[i].normal, pick[0], at[0], at[1]);
        if (!(lw_vec3_dot(v[i].face, s.direction) > 0)) continue;
        const struct lw_vec3 to_light = to_frame(&v[i], s.direction);
        const float weight = s.pdf > 0 ? weight_of(s.pdf, lw_lobes_pdf(&v[i].seen, to_light)) : 1;
        arriving[i] = lw_vec3_scale(
            lw_vec3_mul(lw_vec3_mul(s.irradiance_normal, lw_lobes_reflect(&v[i].seen, to_light)),
                        v[i].throughput),
            weight);
        if (!(lw_vec3_max_abs(arriving[i]) > 0)) continue;
        lw_trace_set_ray(&rays, i, v[i].origin, s.direction, s.distance_m * LW_TRACE_SHORT);
        lit |= (uint16_t)(1u << i);
    }
    float tint[3][LANES];
    if (!lit) return;
    lit &= (uint16_t)~lw_trace_tinted16(job->geometry.trace, LW_TRACE_LIGHT, lit, &rays, tint);
    for (unsigned i = 0; i < LANES; i++)
        if (lit >> i & 1u)
            sum[i] =
                lw_vec3_add(sum[i], lw_vec3_mul(arriving[i], lw_vec3(tint[0][i], tint[1][i], tint[2][i])));
}

/* Light of lamps and sky that a bounce ray from a vertex has found itself. */
static struct lw_vec3 shine(const struct job *job, const struct vertex *v, const struct lw_ray16 *rays,
                            const struct lw_hit16 *hits, unsigned i, float own, struct lw_vec3 emission) {
    if (!(lw_vec3_max_abs(emission) > 0)) return emission;
    const struct lw_vec3 d = lw_vec3(rays->dir_x[i], rays->dir_y[i], rays->dir_z[i]);
    const float pdf = hits->object[i] == LW_TRACE_MISS
                          ? lw_lights_pdf_sky(&job->lights, v->origin, v->normal, d)
                          : lw_lights_pdf_emitter(&job->lights, v->origin, v->normal, hits->object[i],
                                                  hits->triangle[i], hits->u[i], hits->v[i], d, hits->t[i]);
    return lw_vec3_scale(lw_vec3_mul(emission, v->throughput), weight_of(own, pdf));
}

/* Bounce rays from vertices, drawn by their lobes; returns those whose direction is one. density: of each. */
static uint16_t aim16(struct vertex v[LANES], uint16_t active, uint32_t seed, uint32_t index,
                      struct lw_ray16 *rays, float density[LANES]) {
    uint16_t going = 0;
    for (unsigned i = 0; i < LANES; i++) {
        if (!(active >> i & 1u)) continue;
        float at[2], pick[2];
        struct lw_vec3 local;
        lw_random_sobol2(index + i, lw_random_hash2(seed, 3), at);
        lw_random_sobol2(index + i, lw_random_hash2(seed, 4), pick);
        if (!lw_lobes_draw(&v[i].seen, at, pick[0], &local)) continue;
        density[i] = lw_lobes_pdf(&v[i].seen, local);
        const struct lw_vec3 direction = lw_vec3_normalize(
            lw_vec3_mad(lw_vec3_mad(lw_vec3_scale(v[i].t, local.x), v[i].b, local.y), v[i].normal, local.z));
        if (!(density[i] > 0) || !(lw_vec3_dot(direction, v[i].face) > 0)) continue;
        v[i].throughput =
            lw_vec3_mul(v[i].throughput, lw_vec3_scale(lw_lobes_reflect(&v[i].seen, local), 1 / density[i]));
        lw_trace_set_ray(rays, i, v[i].origin, direction, INFINITY);
        going |= (uint16_t)(1u << i);
    }
    return going;
}

/* Indirect radiance along 16 rays, all bounces of it. */
static void follow16(const struct job *job, struct lw_ray16 *rays, uint32_t seed, uint32_t index,
                     struct lw_vec3 sum[LANES]) {
    struct vertex v[LANES];
    float density[LANES];
    uint16_t going = UINT16_MAX;
    for (unsigned i = 0; i < LANES; i++) {
        sum[i] = lw_vec3(0, 0, 0);
        v[i].throughput = lw_vec3(1, 1, 1);
    }
    for (uint32_t bounce = 0; going; bounce++) {
        struct lw_hit16 hits;
        uint16_t there = 0;
        lw_trace_closest16(job->geometry.trace, LW_TRACE_LIGHT, going, rays, &hits);
        for (unsigned i = 0; i < LANES; i++) {
            if (!(going >> i & 1u)) continue;
            struct vertex next = {.throughput = v[i].throughput};
            struct lw_vec3 emission;
            const bool on = arrive(job, rays, &hits, i, &next, &emission);
            if (bounce > 0)
                sum[i] = lw_vec3_add(sum[i], shine(job, &v[i], rays, &hits, i, density[i], emission));
            if (on) v[i] = next, there |= (uint16_t)(1u << i);
        }
        if (bounce == (uint32_t)job->settings->bounces) return;
        light16(job, v, there, lw_random_hash2(seed, 16 + bounce), index, sum);
        going = aim16(v, there, lw_random_hash2(seed, 16 + bounce), index, rays, density);
    }
}

static void trace_spot(const struct job *job, struct spot *spot, bool matt) {
    const struct lw_mesh_texels *mesh = &job->geometry.texels.mesh[job->scene->object[spot->object].mesh];
    const uint32_t count = (uint32_t)job->settings->spp / LANES * LANES,
                   seed = lw_random_hash2(spot->texel, 77);
    double total = 0, squares = 0;
    for (uint32_t first = 0; first < count; first += LANES) {
        struct lw_sample_points_frame frame;
        struct lw_sample_points_lanes lanes;
        struct lw_ray16 rays = {.salt = lw_random_hash2(seed, first)};
        struct lw_vec3 sum[LANES];
        uint32_t local[LANES], point[LANES];
        for (uint32_t i = 0; i < LANES; i++) {
            local[i] = spot->local;
            point[i] = mesh->sample_points.first[spot->local] +
                       lw_sample_points_choose(job->geometry.texels.usable[spot->texel], first + i, 0);
        }
        lw_sample_points_load(&mesh->sample_points, mesh->position, local, point, &lanes);
        lw_sample_points_frame_init(&frame, &job->pose.object_to_world[spot->object]);
        lw_sample_points_to_world(&frame, &lanes);
        for (unsigned i = 0; i < LANES; i++) {
            float u[2];
            lw_random_sobol2(first + i, seed, u);
            const struct lw_vec3 normal = lw_vec3(lanes.at.nx[i], lanes.at.ny[i], lanes.at.nz[i]);
            lw_trace_set_ray(&rays, i, lw_vec3(lanes.at.x[i], lanes.at.y[i], lanes.at.z[i]),
                             lw_direction_about(normal, lw_direction_cosine(u)), INFINITY);
        }
        follow16(job, &rays, seed, first, sum);
        for (unsigned i = 0; i < LANES; i++) {
            const double e = (double)(LW_PI * lw_colour_luminance(sum[i]));
            total += e;
            squares += e * e;
        }
    }
    const double mean = total / count;
    spot->paths[matt] = mean;
    spot->variance[matt] = fmax(squares / count - mean * mean, 0) / count;
}

/* ---- the solve ---- */

static enum lw_status solve(struct job *job, enum solve which, struct lw_error *err) {
    struct lw_solver *solver;
    struct lw_solver_stats stats;
    struct lw_solver_desc desc = bench_light_desc(job->scene, &job->map, -1, 7);
    desc.bounces = (uint32_t)job->settings->bounces;
    desc.threads = (unsigned)job->settings->open.threads;
    leaves_mirrored = which == SOLVE_LEFT;
    enum lw_status status = lw_solvers_create(NULL, &desc, &job->pose, &solver, err);
    if (status != LW_OK) return status;
    for (int64_t f = 1; f <= job->settings->frames && status == LW_OK; f++)
        status = solver->ops->frame(solver, &job->pose, (uint64_t)f, &stats, err);
    for (size_t k = 0; status == LW_OK && k < job->count; k++) {
        struct spot *spot = &job->spot[k];
        const struct lw_tile_place *place = &job->map.place[spot->tile];
        const uint32_t start = lw_texels_tile_start(
            &job->geometry.texels.mesh[job->scene->object[spot->object].mesh], place->x, place->y);
        struct lw_solver_tile tile;
        solver->ops->read_tile(solver, (lw_tile_id){spot->tile}, &tile);
        const uint32_t i = spot->local - start;
        spot->solved[which] = (double)lw_colour_luminance(
            lw_vec3(tile.indirect[0][i], tile.indirect[1][i], tile.indirect[2][i]));
    }
    solver->ops->destroy(solver);
    return status;
}

/* ---- texels ---- */

static bool is_left_out(const struct job *job, uint32_t object) {
    return job->settings->without && strcmp(job->settings->without, job->scene->object[object].name) == 0;
}

/* Every `step`th covered texel. */
static size_t list_spots(const struct job *job, size_t step, struct spot *out) {
    size_t count = 0;
    for (uint32_t id = 0; id < job->map.tile_count; id++) {
        const struct lw_tile_place *place = &job->map.place[id];
        if (place->level || is_left_out(job, place->object)) continue;
        const struct lw_texels *texels = &job->geometry.texels;
        const uint32_t start =
            lw_texels_tile_start(&texels->mesh[job->scene->object[place->object].mesh], place->x, place->y);
        for (uint32_t i = 0; i < place->width * place->height; i++) {
            const uint32_t texel = texels->first[place->object] + start + i;
            if (!texels->covered[texel]) continue;
            if (out && count % step == 0)
                out[count / step] = (struct spot){place->object, start + i, texel, id, {0}, {0}, {0}};
            count++;
        }
    }
    return count;
}

static void trace_spots(struct job *job, bool matt) {
#pragma omp parallel for schedule(dynamic, 16)
    for (size_t k = 0; k < job->count; k++) trace_spot(job, &job->spot[k], matt);
}

/* ---- tables ---- */

struct sum {
    double paths[2], variance, solved[SOLVES];
    size_t count;
};

static void add(struct sum *sum, const struct spot *spot) {
    for (int m = 0; m < 2; m++) sum->paths[m] += spot->paths[m];
    for (int s = 0; s < SOLVES; s++) sum->solved[s] += spot->solved[s];
    sum->variance += spot->variance[0];
    sum->count++;
}

static double ratio(const struct sum *sum, enum solve which) {
    return sum->solved[which] / fmax(sum->paths[which == SOLVE_MATT], 1e-12);
}

static void print_row(const char *name, const struct sum *sum) {
    const double n = (double)sum->count;
    printf("| %s | %zu | %.4g ± %.2g | %.3f | %.3f | %.3f |", name, sum->count, sum->paths[0] / n,
           sqrt(sum->variance) / n, ratio(sum, SOLVE_ALL), ratio(sum, SOLVE_LEFT), ratio(sum, SOLVE_MATT));
}

/* Mean of |solve - paths| over tiles, over that of the paths. */
static double tile_error(const struct job *job, struct sum *tile, enum solve which) {
    double off = 0, all = 0;
    for (uint32_t id = 0; id < job->map.tile_count; id++) {
        if (tile[id].count < TILE_SPOTS) continue;
        off += fabs(tile[id].solved[which] - tile[id].paths[which == SOLVE_MATT]);
        all += tile[id].paths[which == SOLVE_MATT];
    }
    return all > 0 ? off / all : 0;
}

static void print_table(const struct job *job, struct sum *object, struct sum *tile, const char *label) {
    struct sum all = {0};
    for (size_t k = 0; k < job->count; k++) {
        add(&object[job->spot[k].object], &job->spot[k]);
        add(&tile[job->spot[k].tile], &job->spot[k]);
        add(&all, &job->spot[k]);
    }
    for (int64_t row = 0; row < job->settings->rows; row++) {
        uint32_t most = 0;
        for (uint32_t o = 1; o < job->scene->object_count; o++)
            if (object[o].paths[0] > object[most].paths[0]) most = o;
        if (!object[most].count) break;
        char name[128];
        snprintf(name, sizeof name, "%s: %s", label, job->scene->object[most].name);
        print_row(name, &object[most]);
        puts(" |");
        object[most] = (struct sum){0};
    }
    char name[128];
    snprintf(name, sizeof name, "%s: all", label);
    print_row(name, &all);
    printf(" %.3f, %.3f, %.3f |\n", tile_error(job, tile, SOLVE_ALL), tile_error(job, tile, SOLVE_LEFT),
           tile_error(job, tile, SOLVE_MATT));
    fflush(stdout);
}

static enum lw_status report(struct job *job, const char *label, struct lw_error *err) {
    struct sum *object = calloc(job->scene->object_count + 1ul, sizeof *object),
               *tile = calloc(job->map.tile_count + 1ul, sizeof *tile);
    const bool ok = object && tile;
    if (ok) print_table(job, object, tile, label);
    free(object);
    free(tile);
    return ok ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "sums");
}

/* ---- one scene ---- */

static enum lw_status prepare(struct job *job, struct lw_error *err) {
    enum lw_status status = lw_geometry_init(&job->geometry, job->scene, &job->pose, NULL,
                                             (int)job->settings->open.threads, NULL, NULL, err);
    if (status == LW_OK) status = lw_lights_init(&job->lights, job->scene, &job->pose);
    if (status != LW_OK) return status;
    const size_t texels = list_spots(job, 1, NULL), step = texels / (size_t)job->settings->texels + 1;
    job->count = (texels + step - 1) / step;
    job->spot = malloc((job->count + 1) * sizeof *job->spot);
    job->place = malloc((job->scene->object_count + 1ul) * sizeof *job->place);
    if (!job->spot || !job->place) return lw_status_fail(err, LW_NO_MEMORY, "%zu texels", texels);
    list_spots(job, step, job->spot);
    for (uint32_t o = 0; o < job->scene->object_count; o++)
        job->place[o] = lw_place_of(&job->pose.object_to_world[o]);
    return LW_OK;
}

static enum lw_status compare(struct job *job, const char *label, struct lw_error *err) {
    enum lw_status status = prepare(job, err);
    if (status == LW_OK) trace_spots(job, false);
    if (status == LW_OK) status = solve(job, SOLVE_ALL, err);
    if (status == LW_OK) status = solve(job, SOLVE_LEFT, err);
    for (uint32_t m = 0; m < job->scene->material_count; m++) job->scene->material[m].finish = NULL;
    if (status == LW_OK) trace_spots(job, true);
    if (status == LW_OK) status = solve(job, SOLVE_MATT, err);
    return status == LW_OK ? report(job, label, err) : status;
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    struct job job = {.settings = context};
    char label[64];
    enum lw_status status =
        bench_open(&job.settings->open, name, BENCH_MOTION_OWN, 0, &job.scene, &job.pose, &job.map, err);
    if (status == LW_OK) status = compare(&job, bench_label(name, label, sizeof label), err);
    free(job.spot);
    free(job.place);
    if (job.lights.scene) lw_lights_finish(&job.lights);
    if (job.scene) lw_geometry_finish(&job.geometry);
    bench_close(job.scene, &job.pose, &job.map);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.bounces = 2, .frames = 32, .spp = 64, .texels = 16384, .rows = 12};
    const struct lw_option table[] = {
        {"bounces", "N", "bounces of indirect light (default 2)", LW_OPTION_INT, &s.bounces, 1, 16, NULL},
        {"frames", "N", "frames of each solve (default 32)", LW_OPTION_INT, &s.frames, 1, 4096, NULL},
        {"spp", "N", "paths of a texel (default 64)", LW_OPTION_INT, &s.spp, LANES, 1 << 16, NULL},
        {"texels", "N", "texels that paths start from (default 16384)", LW_OPTION_INT, &s.texels, 16, 1 << 22,
         NULL},
        {"without", "NAME", "an object that no paths start from", LW_OPTION_STRING, &s.without, 0, 0, NULL},
        {"rows", "N", "objects, those with most light (default 12)", LW_OPTION_INT, &s.rows, 0, 1000, NULL},
    };
    return bench_main(
        &(struct bench_program){.name = "bench_gloss",
                                .about = "Indirect light of texels: the solve over paths that bounce by all "
                                         "lobes.",
                                .table = table,
                                .count = sizeof table / sizeof *table,
                                .open = &s.open,
                                .heading = "| object | texels | E by paths | all | left | matt | tiles |\n"
                                           "|---|---|---|---|---|---|---|",
                                .context = &s,
                                .run = run},
        argc, argv);
}
