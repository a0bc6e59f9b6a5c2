/* bench_solvers: the solvers at equal error.
 *
 *     bench_solvers [OPTIONS] SCENE[@CAMERA]...
 *
 * Every solver and its settings light a scene in one thread, frame by frame, until E is within relMSE 0.02 of
 * two truths or --seconds of CPU time are over. Truths: the cell solver, run long with another seed, over all
 * texels; the path tracer from the sample points of --texels texels. relMSE as in bench_light.h, unfiltered.
 * One row in Markdown each:
 *   created     CPU s until the first frame: texels, rays' structure, the solver's own tables
 *   first       CPU s of the first frame, after which every texel has light, and its errors by both truths
 *   0.1, 0.02   CPU s, frames alone, until the error by both truths is under that, by cells and by paths
 *   last        errors and ratio of means where the row ends, by both truths
 *   bytes       of the solver per covered texel, without the rays' structure
 *   moved lamp  a lamp moves then: CPU s until the error is under 0.1 and 0.02 again, over the texels alone
 *               whose light has changed by over a tenth; the error at the end. Not where the first frame took
 *               longer than --seconds
 * A point or spot moves by a twentieth of the scene's longest side, a sun turns by 5 degrees; else the first
 * object that emits moves. Undersampling whose window is one texel is left out. What takes more than --pairs
 * pairs a bounce is not run.
 *
 * --early S prints errors over CPU time instead, frame by frame for S seconds, as CSV; the last column is of
 * indirect light alone, each texel by itself. With --denoise, errors are those of shown light. With -o DIR
 * also pictures after S/64, S/8 and S seconds (solver_pictures.h), numbered as solvers are: the first has 0.
 * --points prints the gain and loss of sets of virtual point lights, by the number of sets and for some d0:
 * CPU time of a frame in the mean of a round, with and without that of a frame of direct light alone. Errors
 * after the first frame, the first round and four. The median of a texel's indirect light over that of the
 * truth by cells, and the number of texels under half.
 * --passes prints what one pass of radiosity costs: the CPU time of a frame of one bounce without that of a
 * frame of none, rays of it, and the errors of the light after one bounce. */
#include "client/paths/path_trace.h"
#include "common/base/clock.h"
#include "common/base/colour.h"
#include "server/solve/geometry.h"
#include "server/solve/solvers.h"
#include "tests/bench/bench_light.h"
#include "tests/bench/bench_setup.h"
#include "tests/bench/solver_pictures.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ROW     64u    /* texels a row of the picture that the path tracer is given */
#define TURNS   24u    /* over the sample points of a texel: a multiple of 1, 2, 3, 4, 6 and 8 */
#define CHANGED 0.1f   /* share of a texel's light */
#define SHIFT   0.05f  /* share of the scene's longest side */
#define TURN    0.0873 /* radians: 5 degrees */
#define LIMITS  2
#define TRUTHS  2
#define CHECKED 8 /* the first frames are all looked at, later ones at 1 + 1/CHECKED of the last number */

static const double limit[LIMITS] = {0.1, 0.02};
enum { BY_CELLS, BY_PATHS };

struct settings {
    struct lw_scene_open open;
    int64_t bounces, reference, spp, texels;
    double seconds, pairs, early;
    const char *only, *folder;
    bool passes, points, still, denoise;
};

/* A solver and what it is asked for. */
struct entrant {
    const char *name, *solver;
    struct lw_radiosity_terms radiosity;
    struct lw_vpl_terms vpl;
};

static const struct entrant entrants[] = {
    {.name = "cells", .solver = "cells"},
    {.name = "radiosity, none", .solver = "radiosity"},
    {.name = "radiosity, stride", .solver = "radiosity", .radiosity = {.undersample = LW_UNDERSAMPLE_STRIDE}},
    {.name = "radiosity, random", .solver = "radiosity", .radiosity = {.undersample = LW_UNDERSAMPLE_RANDOM}},
    {.name = "radiosity, mip", .solver = "radiosity", .radiosity = {.undersample = LW_UNDERSAMPLE_MIP}},
    {.name = "radiosity, stride, 4 x 4",
     .solver = "radiosity",
     .radiosity = {.undersample = LW_UNDERSAMPLE_STRIDE, .window = 4}},
    {.name = "radiosity, random, 4 x 4",
     .solver = "radiosity",
     .radiosity = {.undersample = LW_UNDERSAMPLE_RANDOM, .window = 4}},
    {.name = "radiosity, mip, 4 x 4",
     .solver = "radiosity",
     .radiosity = {.undersample = LW_UNDERSAMPLE_MIP, .window = 4}},
    {.name = "radiosity, subdivide 0.05", .solver = "radiosity", .radiosity = {.subdivide = 0.05f}},
    {.name = "radiosity, directions 64", .solver = "radiosity", .radiosity = {.directions = 64}},
    {.name = "radiosity, directions 256", .solver = "radiosity", .radiosity = {.directions = 256}},
    {.name = "vpl, 512", .solver = "vpl"},
    {.name = "vpl, 512 in 8", .solver = "vpl", .vpl = {.sets = 8}},
    {.name = "vpl, 512 in 32", .solver = "vpl", .vpl = {.sets = 32}},
};
#define ENTRANTS (sizeof entrants / sizeof *entrants)

/* Light to compare with: of all texels, or of some. */
struct truth {
    float *light;    /* 3 values each */
    uint32_t *texel; /* which; NULL: all */
    size_t count;    /* texels */
    double epsilon;
};

struct job {
    const struct settings *settings;
    const char *label;
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose, moved;
    const char *lamp;
    struct truth truth[TRUTHS], after; /* after: of the moved lamp, of the texels that it changes */
    float *indirect;                   /* the truth by cells, luminance */
    struct solver_pictures pictures;   /* with a folder */
    size_t trace_bytes;
    double left; /* relMSE of the light before, over those */
    size_t texels;
};

static double cpu_s(uint64_t since_ns) { return 1e-9 * (double)(lw_clock_process_cpu_ns() - since_ns); }

static unsigned threads_of(const struct settings *s) {
    return s->open.threads ? (unsigned)s->open.threads : 1;
}

/* ---- truths ---- */

static void truth_finish(struct truth *truth) {
    free(truth->light);
    free(truth->texel);
    *truth = (struct truth){0};
}

/* all: light of all texels. out_ratio: of the means; may be NULL. */
static double error_of(const struct truth *truth, const float *all, double *out_ratio) {
    double error = 0, sum = 0, want = 0;
    for (size_t k = 0; k < truth->count; k++) {
        const float *x = all + 3 * (truth->texel ? truth->texel[k] : k), *t = truth->light + 3 * k;
        error += bench_light_error(x, t, truth->epsilon);
        for (int c = 0; c < 3; c++) sum += (double)x[c], want += (double)t[c];
    }
    if (out_ratio) *out_ratio = sum / want;
    return truth->count ? error / (double)truth->count : 0;
}

static void indirect_luminance(const struct lw_solver_tile *tile, uint32_t i, float *out) {
    *out = lw_colour_luminance(lw_vec3(tile->indirect[0][i], tile->indirect[1][i], tile->indirect[2][i]));
}

static float *read_indirect(const struct job *job, const struct lw_solver *solver) {
    size_t count;
    return bench_light_gather(solver, &job->map, 1, indirect_luminance, &count);
}

static enum lw_status by_cells(struct job *job, const struct lw_pose *pose, uint32_t seed, float **out_light,
                               size_t *out_texels, struct lw_error *err) {
    struct lw_solver *solver;
    struct lw_solver_stats stats;
    struct lw_solver_desc desc = bench_light_desc(job->scene, &job->map, -1, seed);
    desc.bounces = (uint32_t)job->settings->bounces;
    desc.threads = threads_of(job->settings);
    enum lw_status status = lw_solvers_create(NULL, &desc, pose, &solver, err);
    if (status != LW_OK) return status;
    for (int64_t f = 1; f <= job->settings->reference && status == LW_OK; f++)
        status = solver->ops->frame(solver, pose, (uint64_t)f, &stats, err);
    if (status == LW_OK && !(*out_light = bench_read_light(solver, &job->map, out_texels)))
        status = lw_status_fail(err, LW_NO_MEMORY, "texels");
    *out_texels /= 3;
    job->texels = *out_texels;
    if (status == LW_OK && !job->indirect && !(job->indirect = read_indirect(job, solver)))
        status = lw_status_fail(err, LW_NO_MEMORY, "texels");
    if (status == LW_OK && job->pictures.folder) status = solver_pictures_truth(&job->pictures, solver, err);
    solver->ops->destroy(solver);
    return status;
}

/* Where texels are, in the order of bench_read_light(). */
struct spot {
    uint32_t object, local, texel; /* local: in the mesh; texel: in the global numbering */
};

static size_t list_spots(const struct job *job, const struct lw_texels *texels, struct spot *out) {
    size_t count = 0;
    for (uint32_t id = 0; id < job->map.tile_count; id++) {
        const struct lw_tile_place *place = &job->map.place[id];
        if (place->level) continue;
        const struct lw_mesh_texels *mesh = &texels->mesh[job->scene->object[place->object].mesh];
        const uint32_t start = lw_texels_tile_start(mesh, place->x, place->y);
        for (uint32_t i = 0; i < place->width * place->height; i++) {
            const uint32_t texel = texels->first[place->object] + start + i;
            if (!texels->covered[texel]) continue;
            if (out) out[count] = (struct spot){place->object, start + i, texel};
            count++;
        }
    }
    return count;
}

/* The surface at a sample point of each spot, as if a pixel showed it: white, so that its radiance is
 * E / pi. */
static void show_spots(const struct job *job, const struct lw_texels *texels, const struct spot *spot,
                       uint32_t turn, struct lw_gbuffer *gbuffer) {
    for (uint32_t k = 0; k < gbuffer->width * gbuffer->height; k++) {
        const struct lw_mesh_texels *mesh = &texels->mesh[job->scene->object[spot[k].object].mesh];
        struct lw_sample_points_frame frame;
        struct lw_sample_points_lanes lanes;
        uint32_t local[LW_TRACE_WIDTH], point[LW_TRACE_WIDTH];
        for (int i = 0; i < LW_TRACE_WIDTH; i++) {
            local[i] = spot[k].local;
            point[i] = mesh->sample_points.first[local[i]] +
                       lw_sample_points_choose(texels->usable[spot[k].texel], turn, 0);
        }
        lw_sample_points_load(&mesh->sample_points, mesh->position, local, point, &lanes);
        lw_sample_points_frame_init(&frame, &job->pose.object_to_world[spot[k].object]);
        lw_sample_points_to_world(&frame, &lanes);
        gbuffer->from_eye[k] = 0;
        gbuffer->plane.object[k] = spot[k].object;
        const float origin[3] = {lanes.at.x[0], lanes.at.y[0], lanes.at.z[0]},
                    normal[3] = {lanes.at.nx[0], lanes.at.ny[0], lanes.at.nz[0]};
        for (int c = 0; c < 3; c++) {
            gbuffer->plane.origin[c][k] = origin[c];
            gbuffer->plane.normal[c][k] = normal[c];
            gbuffer->plane.albedo[c][k] = 1;
            gbuffer->plane.emission[c][k] = 0;
        }
    }
}

/* out_noise: relMSE of the truth itself, estimated. */
static enum lw_status trace_spots(const struct job *job, const struct lw_geometry *geometry,
                                  const struct spot *spot, struct truth *truth, double *out_noise,
                                  struct lw_error *err) {
    struct lw_gbuffer gbuffer = {0};
    struct lw_path_film film = {0};
    struct lw_path_trace *tracer = NULL;
    struct lw_lights lights;
    const struct lw_camera_view camera = lw_camera_look_at(lw_vec3(0, 0, 0), lw_vec3(0, 0, 1), 1);
    const uint32_t height = (uint32_t)truth->count / ROW;
    enum lw_status status = lw_lights_init(&lights, job->scene, &job->pose);
    if (status != LW_OK) return lw_status_fail(err, status, "lights");
    status = lw_path_trace_create(&(struct lw_path_trace_desc){.scene = job->scene,
                                                               .trace = geometry->trace,
                                                               .lights = &lights,
                                                               .pose = &job->pose,
                                                               .threads = threads_of(job->settings)},
                                  &tracer, err);
    if (status == LW_OK)
        status = lw_gbuffer_init(
            &gbuffer,
            &(struct lw_gbuffer_desc){
                .scene = job->scene, .trace = geometry->trace, .width = ROW, .height = height},
            err);
    if (status == LW_OK) status = lw_path_film_init(&film, ROW, height, err);
    gbuffer.camera = camera;
    for (uint32_t turn = 0; status == LW_OK && turn < TURNS; turn++) {
        show_spots(job, &geometry->texels, spot, turn, &gbuffer);
        lw_path_trace_render(tracer,
                             &(struct lw_path_view){.camera = camera,
                                                    .bounces = (uint32_t)job->settings->bounces,
                                                    .seed = 1000 + turn,
                                                    .pixel = LW_PATH_PIXEL_CENTRE,
                                                    .first_hits = &gbuffer},
                             (uint32_t)job->settings->spp / TURNS, &film, NULL);
    }
    if (status == LW_OK) {
        const double error = lw_path_film_error(&film);
        *out_noise = error * error;
        lw_path_film_resolve(&film, truth->light);
        for (size_t i = 0; i < 3 * truth->count; i++) truth->light[i] *= LW_PI;
    }
    lw_path_film_finish(&film);
    lw_gbuffer_finish(&gbuffer);
    lw_path_trace_destroy(tracer);
    lw_lights_finish(&lights);
    return status;
}

static enum lw_status by_paths(struct job *job, struct truth *truth, double *out_noise,
                               struct lw_error *err) {
    struct lw_geometry geometry = {0};
    struct spot *all = NULL, *spot = NULL;
    enum lw_status status = lw_geometry_init(&geometry, job->scene, &job->pose, NULL,
                                             (int)threads_of(job->settings), NULL, NULL, err);
    if (status == LW_OK) {
        const size_t texels = list_spots(job, &geometry.texels, NULL);
        truth->count = texels < (size_t)job->settings->texels ? texels : (size_t)job->settings->texels;
        truth->count = truth->count / ROW * ROW;
        all = malloc((texels + 1) * sizeof *all);
        spot = malloc((truth->count + 1) * sizeof *spot);
        truth->texel = malloc((truth->count + 1) * sizeof *truth->texel);
        truth->light = malloc((3 * truth->count + 1) * sizeof *truth->light);
        if (!truth->count) status = lw_status_fail(err, LW_USAGE, "%s has too few texels", job->label);
        if (!all || !spot || !truth->texel || !truth->light)
            status = lw_status_fail(err, LW_NO_MEMORY, "%zu texels", texels);
        if (status == LW_OK) {
            list_spots(job, &geometry.texels, all);
            for (size_t k = 0; k < truth->count; k++) {
                truth->texel[k] = (uint32_t)(k * texels / truth->count);
                spot[k] = all[truth->texel[k]];
            }
            status = trace_spots(job, &geometry, spot, truth, out_noise, err);
        }
    }
    if (status == LW_OK) truth->epsilon = bench_light_epsilon(truth->light, 3 * truth->count);
    if (status == LW_OK) job->trace_bytes = lw_trace_memory_bytes(geometry.trace);
    free(all);
    free(spot);
    lw_geometry_finish(&geometry);
    return status;
}

/* The light after the movement, of the texels that it changes. */
static enum lw_status find_after(struct job *job, struct lw_error *err) {
    const float *before = job->truth[BY_CELLS].light;
    float *light = NULL;
    size_t texels;
    enum lw_status status = by_cells(job, &job->moved, 8, &light, &texels, err);
    struct truth *after = &job->after;
    if (status == LW_OK && !(after->texel = malloc((texels + 1) * sizeof *after->texel)))
        status = lw_status_fail(err, LW_NO_MEMORY, "texels");
    for (size_t k = 0; status == LW_OK && k < texels; k++) {
        float most = 0;
        for (size_t i = 3 * k; i < 3 * k + 3; i++)
            most = fmaxf(most, fabsf(light[i] - before[i]) / (light[i] + 1e-6f));
        if (most < CHANGED) continue;
        memmove(light + 3 * after->count, light + 3 * k, 3 * sizeof *light);
        after->texel[after->count++] = (uint32_t)k;
    }
    if (status != LW_OK) {
        free(light);
        return status;
    }
    after->light = light;
    after->epsilon = bench_light_epsilon(light, 3 * after->count);
    job->left = error_of(after, before, NULL);
    return LW_OK;
}

static enum lw_status find_truths(struct job *job, struct lw_error *err) {
    struct truth *cells = &job->truth[BY_CELLS];
    double noise = 0, ratio;
    enum lw_status status = by_cells(job, &job->pose, 7, &cells->light, &job->texels, err);
    if (status != LW_OK) return status;
    cells->count = job->texels;
    cells->epsilon = bench_light_epsilon(cells->light, 3 * cells->count);
    if ((status = by_paths(job, &job->truth[BY_PATHS], &noise, err)) != LW_OK) return status;
    const double apart = error_of(&job->truth[BY_PATHS], cells->light, &ratio);
    printf(
        "\n%s: %zu texels; of the truths: paths of %zu texels have noise of relMSE %.5f; cells against them "
        "%.5f, ratio of means %.4f",
        job->label, job->texels, job->truth[BY_PATHS].count, noise, apart, ratio);
    if (job->settings->passes || job->settings->points || job->settings->early > 0 || job->settings->still) {
        puts("\n");
        return LW_OK;
    }
    if ((status = find_after(job, err)) != LW_OK) return status;
    printf("; %s moved: %.1f %% of texels change by over a tenth, old light against new %.3f\n\n", job->lamp,
           100 * (double)job->after.count / (double)job->texels, job->left);
    return LW_OK;
}

/* ---- a lamp that moves ---- */

static void move_lamp(struct job *job) {
    const struct lw_scene *scene = job->scene;
    struct lw_vec3 lo = {0}, hi = {0};
    lw_pose_bounds(&job->pose, scene, &lo, &hi);
    const struct lw_vec3 size = lw_vec3_sub(hi, lo);
    const float shift = SHIFT * fmaxf(size.x, fmaxf(size.y, size.z));
    uint32_t sun = LW_SCENE_NONE;
    for (uint32_t i = 0; i < scene->light_count; i++) {
        if (scene->light[i].kind == LW_LIGHT_DIRECTIONAL) {
            if (sun == LW_SCENE_NONE) sun = i;
            continue;
        }
        job->moved.light[i].position_ws.x += shift;
        job->lamp = scene->light[i].name;
        return;
    }
    if (sun != LW_SCENE_NONE) {
        struct lw_vec3 *d = &job->moved.light[sun].direction_ws;
        const float c = (float)cos(TURN), s = (float)sin(TURN), x = d->x;
        d->x = c * x + s * d->z;
        d->z = c * d->z - s * x;
        job->lamp = scene->light[sun].name;
        return;
    }
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        if (!mesh->triangle_count || !lw_material_shines(&scene->material[mesh->material[0]])) continue;
        job->pose.object_dynamic[o] = job->moved.object_dynamic[o] = true;
        job->moved.object_to_world[o].m[0][3] += shift;
        job->lamp = scene->object[o].name;
        return;
    }
    job->lamp = "nothing";
}

/* ---- rows ---- */

static struct lw_solver_desc desc_of(const struct job *job, const struct entrant *e, uint32_t bounces) {
    struct lw_solver_desc desc = bench_light_desc(job->scene, &job->map, -1, 1);
    desc.bounces = bounces;
    desc.threads = threads_of(job->settings);
    desc.radiosity = e->radiosity;
    desc.vpl = e->vpl;
    return desc;
}

/* Texels a side; 1: each shoots. */
static double window_of(const struct job *job, const struct entrant *e) {
    if (e->radiosity.undersample == LW_UNDERSAMPLE_NONE) return 1;
    return e->radiosity.window ? e->radiosity.window : fmax(1, round(sqrt((double)job->texels) / 128));
}

/* Pairs of a pass, about: charts and windows that are not full make more. 0: it knows no pairs. */
static double pairs_of(const struct job *job, const struct entrant *e) {
    const double n = (double)job->texels;
    if (strcmp(e->solver, "radiosity") != 0 || e->radiosity.directions) return 0;
    if (e->radiosity.subdivide > 0) return n * n / 16; /* it depends on the light: squares of 4 x 4 */
    if (e->radiosity.undersample == LW_UNDERSAMPLE_NONE) return n * n;
    const double side = window_of(job, e);
    return n * n / (side * side);
}

static bool is_too_much(const struct job *job, const struct entrant *e) {
    return pairs_of(job, e) > job->settings->pairs;
}

struct run {
    const struct job *job;
    struct lw_solver *solver;
    uint64_t frame;
    double cpu_s;
    bool still; /* the last frame solved nothing */
};

static enum lw_status step(struct run *r, const struct lw_pose *pose, struct lw_error *err) {
    struct lw_solver_stats stats;
    const uint64_t began_ns = lw_clock_process_cpu_ns();
    enum lw_status status = r->solver->ops->frame(r->solver, pose, ++r->frame, &stats, err);
    r->cpu_s += cpu_s(began_ns);
    r->still = !stats.texels_solved;
    return status;
}

/* Solves until the errors by `count` truths are under all limits, or time is over. reached: CPU s, or < 0. */
static enum lw_status until(struct run *r, const struct lw_pose *pose, const struct truth *const *truth,
                            uint32_t count, double reached[][LIMITS], double error[], double ratio[],
                            double *first_s, double first[], struct lw_error *err) {
    const double began_s = r->cpu_s;
    for (uint32_t t = 0; t < count; t++)
        for (int l = 0; l < LIMITS; l++) reached[t][l] = -1;
    for (uint64_t n = 1, next = 1;; n++) {
        size_t values;
        enum lw_status status = step(r, pose, err);
        if (status != LW_OK) return status;
        const double spent_s = r->cpu_s - began_s;
        const bool over = spent_s > r->job->settings->seconds || r->still;
        if (n < next && !over) continue;
        next = n < CHECKED ? n + 1 : n + n / CHECKED;
        float *light = bench_read_light(r->solver, &r->job->map, &values);
        if (!light) return lw_status_fail(err, LW_NO_MEMORY, "texels");
        bool done = true;
        for (uint32_t t = 0; t < count; t++) {
            error[t] = error_of(truth[t], light, &ratio[t]);
            for (int l = 0; l < LIMITS; l++) {
                if (reached[t][l] < 0 && error[t] <= limit[l]) reached[t][l] = spent_s;
                done &= reached[t][l] >= 0;
            }
            if (n == 1 && first) first[t] = error[t];
        }
        free(light);
        if (n == 1 && first_s) *first_s = spent_s;
        if (done || over) return LW_OK;
    }
}

static void print_reached(const double *reached) {
    for (int l = 0; l < LIMITS; l++) {
        if (reached[l] >= 0)
            printf(" %.3g |", reached[l]);
        else
            printf(" never |");
    }
}

static enum lw_status print_row(const struct job *job, const struct entrant *e, struct lw_error *err) {
    struct run r = {.job = job};
    const struct lw_solver_desc desc = desc_of(job, e, (uint32_t)job->settings->bounces);
    const struct truth *const truths[TRUTHS] = {&job->truth[0], &job->truth[1]}, *const after[] = {
                                                                                     &job->after};
    double reached[TRUTHS][LIMITS], again[1][LIMITS], error[TRUTHS], ratio[TRUTHS], first[TRUTHS],
        first_s = 0, ignored;
    printf("| %s | %s |", job->label, e->name);
    fflush(stdout);
    if (is_too_much(job, e)) {
        printf(" cannot: %.2g pairs a bounce, over %.2g | | | | | | | | | | | |\n", pairs_of(job, e),
               job->settings->pairs);
        return LW_OK;
    }
    const uint64_t began_ns = lw_clock_process_cpu_ns();
    enum lw_status status = lw_solvers_create(e->solver, &desc, &job->pose, &r.solver, err);
    if (status != LW_OK) return status;
    printf(" %.2f |", cpu_s(began_ns));
    status = until(&r, &job->pose, truths, TRUTHS, reached, error, ratio, &first_s, first, err);
    if (status == LW_OK) {
        printf(" %.3g: %.4f, %.4f |", first_s, first[BY_CELLS], first[BY_PATHS]);
        print_reached(reached[BY_CELLS]);
        print_reached(reached[BY_PATHS]);
        printf(" %.1f s: %.4f, %.4f; %.3f, %.3f | %.0f |", r.cpu_s, error[BY_CELLS], error[BY_PATHS],
               ratio[BY_CELLS], ratio[BY_PATHS],
               (double)(r.solver->ops->memory_bytes(r.solver) - job->trace_bytes) / (double)job->texels);
        fflush(stdout);
    }
    if (status == LW_OK && !job->settings->still && first_s > job->settings->seconds) {
        printf(" not run | | |");
    } else if (status == LW_OK && !job->settings->still) {
        status = until(&r, &job->moved, after, 1, again, error, &ignored, NULL, NULL, err);
        if (status == LW_OK) print_reached(again[0]);
        if (status == LW_OK) printf(" %.4f |", error[0]);
    }
    puts("");
    r.solver->ops->destroy(r.solver);
    return status;
}

/* CPU s and rays of a frame; the light after it. */
static enum lw_status solve_once(const struct job *job, const struct entrant *e, uint32_t bounces,
                                 double *out_s, struct lw_solver_stats *out_stats, float **out_light,
                                 struct lw_error *err) {
    struct lw_solver *solver;
    size_t values;
    const struct lw_solver_desc desc = desc_of(job, e, bounces);
    enum lw_status status = lw_solvers_create(e->solver, &desc, &job->pose, &solver, err);
    if (status != LW_OK) return status;
    const uint64_t began_ns = lw_clock_process_cpu_ns();
    status = solver->ops->frame(solver, &job->pose, 1, out_stats, err);
    *out_s = cpu_s(began_ns);
    if (status == LW_OK && !(*out_light = bench_read_light(solver, &job->map, &values)))
        status = lw_status_fail(err, LW_NO_MEMORY, "texels");
    solver->ops->destroy(solver);
    return status;
}

static enum lw_status print_pass(const struct job *job, const struct entrant *e, struct lw_error *err) {
    float *light[2] = {NULL, NULL};
    double seconds[2], ratio[TRUTHS], error[TRUTHS];
    struct lw_solver_stats stats[2];
    enum lw_status status = LW_OK;
    printf("| %s | %zu | %s |", job->label, job->texels, e->name);
    fflush(stdout);
    if (is_too_much(job, e)) {
        printf(" not run: %.2g pairs, over %.2g | | | |\n", pairs_of(job, e), job->settings->pairs);
        return LW_OK;
    }
    for (uint32_t b = 0; b < 2 && status == LW_OK; b++)
        status = solve_once(job, e, b, &seconds[b], &stats[b], &light[b], err);
    for (int t = 0; t < TRUTHS && status == LW_OK; t++)
        error[t] = error_of(&job->truth[t], light[1], &ratio[t]);
    if (status == LW_OK)
        printf(" %.3f | %.1f M | %.5f, %.5f | %.4f, %.4f |\n", seconds[1] - seconds[0],
               1e-6 * (double)(stats[1].rays_bounce - stats[0].rays_bounce), error[BY_CELLS], error[BY_PATHS],
               ratio[BY_CELLS], ratio[BY_PATHS]);
    fflush(stdout);
    free(light[0]);
    free(light[1]);
    return status;
}

/* Error of indirect light alone, by the truth by cells, each texel by itself: the mean of min(1, (x - t)^2 /
 * (t^2 + (1 % of the mean of t)^2)). */
static double indirect_error(const struct job *job, const struct lw_solver *solver) {
    float *light = read_indirect(job, solver);
    double mean = 0, error = 0;
    for (size_t i = 0; i < job->texels; i++) mean += (double)job->indirect[i] / (double)job->texels;
    for (size_t i = 0; light && i < job->texels; i++) {
        const double t = (double)job->indirect[i], off = (double)light[i] - t;
        error += fmin(1, off * off / (t * t + 1e-4 * mean * mean)) / (double)job->texels;
    }
    if (!light) error = 1;
    free(light);
    return error;
}

static void shown_light(const struct lw_solver_tile *tile, uint32_t i, float *out) {
    for (int c = 0; c < 3; c++) out[c] = tile->shown[LW_TILE_CHANNEL_FULL][c][i];
}

/* Filtered and welded. */
static float *read_shown(const struct job *job, const struct lw_solver *solver) {
    size_t count;
    return bench_light_gather(solver, &job->map, 3, shown_light, &count);
}

static enum lw_status print_early(struct job *job, const struct entrant *e, struct lw_error *err) {
    struct run r = {.job = job};
    struct lw_solver_desc desc = desc_of(job, e, (uint32_t)job->settings->bounces);
    const bool shown = job->settings->denoise;
    if (is_too_much(job, e)) return LW_OK;
    desc.denoise = shown;
    enum lw_status status = lw_solvers_create(e->solver, &desc, &job->pose, &r.solver, err);
    if (status != LW_OK) return status;
    if (job->pictures.folder) solver_pictures_begin(&job->pictures);
    while (status == LW_OK && r.cpu_s < job->settings->early) {
        size_t values;
        float *light = NULL;
        status = step(&r, &job->pose, err);
        if (status == LW_OK &&
            !(light = shown ? read_shown(job, r.solver) : bench_read_light(r.solver, &job->map, &values)))
            status = lw_status_fail(err, LW_NO_MEMORY, "texels");
        if (status == LW_OK)
            printf("%s,\"%s\",%llu,%.4f,%.5f,%.5f,%.5f\n", job->label, e->name, (unsigned long long)r.frame,
                   r.cpu_s, error_of(&job->truth[BY_CELLS], light, NULL),
                   error_of(&job->truth[BY_PATHS], light, NULL), indirect_error(job, r.solver));
        fflush(stdout);
        free(light);
        if (status == LW_OK && job->pictures.folder)
            status = solver_pictures_frame(&job->pictures, r.solver, (uint32_t)(e - entrants), r.cpu_s, err);
    }
    r.solver->ops->destroy(r.solver);
    return status;
}

/* ---- virtual point lights ---- */

static int compare_floats(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static enum lw_status compare_indirect(const struct job *job, const struct lw_solver *solver,
                                       double *out_median, double *out_dim, struct lw_error *err) {
    float *light = read_indirect(job, solver);
    size_t count = 0, dim = 0;
    if (!light) return lw_status_fail(err, LW_NO_MEMORY, "texels");
    for (size_t i = 0; i < job->texels; i++)
        if (job->indirect[i] > 0) light[count++] = light[i] / job->indirect[i];
    for (size_t i = 0; i < count; i++) dim += light[i] < 0.5f;
    qsort(light, count, sizeof *light, compare_floats);
    *out_median = count ? (double)light[count / 2] : 0;
    *out_dim = count ? (double)dim / (double)count : 0;
    free(light);
    return LW_OK;
}

static enum lw_status print_points_row(const struct job *job, struct lw_vpl_terms terms, double direct_s,
                                       double *whole_s, struct lw_error *err) {
    enum { ROUNDS = 4 };
    struct run r = {.job = job};
    const struct entrant e = {.name = "vpl", .solver = "vpl", .vpl = terms};
    const struct lw_solver_desc desc = desc_of(job, &e, (uint32_t)job->settings->bounces);
    enum lw_status status = lw_solvers_create(e.solver, &desc, &job->pose, &r.solver, err);
    double error[3] = {0}, round_s = 0, median = 0, dim = 0;
    for (uint64_t f = 1; status == LW_OK && f <= ROUNDS * terms.sets; f++) {
        size_t values;
        float *light = NULL;
        status = step(&r, &job->pose, err);
        if (f == terms.sets) round_s = r.cpu_s / terms.sets;
        if (status == LW_OK && f == terms.sets) status = compare_indirect(job, r.solver, &median, &dim, err);
        if (status != LW_OK || (f != 1 && f != terms.sets && f != ROUNDS * terms.sets)) continue;
        if (!(light = bench_read_light(r.solver, &job->map, &values)))
            return lw_status_fail(err, LW_NO_MEMORY, "texels");
        const double now = error_of(&job->truth[BY_PATHS], light, NULL);
        if (f == 1) error[0] = now;
        if (f == terms.sets) error[1] = now;
        if (f == ROUNDS * terms.sets) error[2] = now;
        free(light);
    }
    if (terms.sets == 1) *whole_s = round_s;
    if (status == LW_OK)
        printf("| %s | %u | %u | %.3g | %.3f | %.1f | %.3f | %.4f | %.4f | %.4f | %.3f, %.1f %% |\n",
               job->label, terms.lights, terms.sets, (double)terms.near_m, round_s, *whole_s / round_s,
               round_s - direct_s, error[0], error[1], error[2], median, 100 * dim);
    fflush(stdout);
    if (r.solver) r.solver->ops->destroy(r.solver);
    return status;
}

static enum lw_status print_points(const struct job *job, struct lw_error *err) {
    enum { LIGHTS = 512, SETS_MAX = 32 };
    static const double near_m[] = {0.01, 0.03, 0.1, 0.3, 1, 3};
    const struct entrant e = {.name = "vpl", .solver = "vpl"};
    struct lw_solver_stats stats;
    float *light = NULL;
    double direct_s = 0, whole_s = 0;
    enum lw_status status = solve_once(job, &e, 0, &direct_s, &stats, &light, err);
    free(light);
    puts(
        "| scene | lights | sets | d0, m; 0: by area | CPU s a frame | of one set over this | without direct "
        "light | relMSE by paths: first frame | first round | 4 rounds | indirect over the truth's: median, "
        "share under half |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|");
    for (uint32_t sets = 1; sets <= SETS_MAX && status == LW_OK; sets *= 2)
        status = print_points_row(job, (struct lw_vpl_terms){.lights = LIGHTS, .sets = sets}, direct_s,
                                  &whole_s, err);
    for (size_t k = 0; k < sizeof near_m / sizeof *near_m && status == LW_OK; k++)
        status = print_points_row(
            job, (struct lw_vpl_terms){.lights = LIGHTS, .sets = 4, .near_m = (float)near_m[k]}, direct_s,
            &whole_s, err);
    return status;
}

static enum lw_status measure(struct job *job, struct lw_error *err) {
    const struct settings *s = job->settings;
    enum lw_status status = find_truths(job, err);
    if (status != LW_OK) return status;
    if (s->points) return print_points(job, err);
    if (s->early > 0)
        puts("scene,solver,frame,cpu_s,relmse_cells,relmse_paths,indirect");
    else if (s->passes)
        puts("| scene | texels | solver | CPU s a pass | rays | relMSE by cells, paths | ratio of means |\n"
             "|---|---|---|---|---|---|---|");
    else
        printf("| scene | solver | created, s | first picture, s: relMSE by cells, paths | 0.1 by cells, s | "
               "0.02 | 0.1 by paths, s | 0.02 | last: relMSE; ratio of means | bytes a texel |%s\n"
               "|---|---|---|---|---|---|---|---|---|---|%s\n",
               s->still ? "" : " lamp moved: 0.1, s | 0.02 | last |", s->still ? "" : "---|---|---|");
    for (size_t k = 0; k < ENTRANTS && status == LW_OK; k++) {
        const struct entrant *e = &entrants[k];
        if (s->only && !strstr(e->name, s->only)) continue;
        if (s->passes && strcmp(e->solver, "radiosity") != 0) continue;
        if (e->radiosity.undersample != LW_UNDERSAMPLE_NONE && window_of(job, e) <= 1) continue;
        status = s->early > 0 ? print_early(job, e, err)
                 : s->passes  ? print_pass(job, e, err)
                              : print_row(job, e, err);
    }
    return status;
}

static enum lw_status run(void *context, const char *path, struct lw_error *err) {
    struct job job = {.settings = context};
    char label[64];
    job.label = bench_label(path, label, sizeof label);
    enum lw_status status =
        bench_open(&job.settings->open, path, BENCH_MOTION_OWN, 0, &job.scene, &job.pose, &job.map, err);
    if (status == LW_OK) status = lw_pose_init(&job.moved, job.scene);
    if (status == LW_OK) {
        lw_pose_copy(&job.moved, &job.pose, job.scene);
        move_lamp(&job);
        if (job.settings->folder)
            status = solver_pictures_init(&job.pictures, path, job.scene, &job.pose, &job.map,
                                          (uint32_t)job.settings->bounces, job.settings->early,
                                          job.settings->folder, err);
        if (status == LW_OK) status = measure(&job, err);
    }
    lw_pose_finish(&job.moved);
    for (int t = 0; t < TRUTHS; t++) truth_finish(&job.truth[t]);
    truth_finish(&job.after);
    free(job.indirect);
    solver_pictures_finish(&job.pictures);
    bench_close(job.scene, &job.pose, &job.map);
    return status;
}

static enum lw_status begin(void *context, struct lw_error *err) {
    struct settings *s = context;
    if (s->passes) s->bounces = 1;
    if (s->folder && !(s->early > 0)) return lw_status_fail(err, LW_USAGE, "-o needs --early");
    for (size_t k = 0; s->only && k < ENTRANTS; k++)
        if (strstr(entrants[k].name, s->only)) return LW_OK;
    return s->only ? lw_status_fail(err, LW_USAGE, "--only: no solver has \"%s\" in its name", s->only)
                   : LW_OK;
}

int main(int argc, char **argv) {
    struct settings s = {
        .bounces = 2, .reference = 256, .spp = 768, .texels = 4096, .seconds = 60, .pairs = 2e9};
    const struct lw_option table[] = {
        BENCH_INT("bounces", "indirect (default 2; with --passes 1)", &s.bounces, 0, LW_SOLVER_BOUNCES_MAX),
        BENCH_INT("reference", "frames of the truths by cells (default 256)", &s.reference, 1, 1000000),
        BENCH_INT("spp", "paths of a texel in the truth by paths (default 768)", &s.spp, TURNS, 1 << 20),
        BENCH_INT("texels", "texels of the truth by paths (default 4096)", &s.texels, ROW, 1 << 20),
        {"seconds", "S", "CPU time of a row, at most and twice: before and after the movement (default 60)",
         LW_OPTION_REAL, &s.seconds, 1e-3, 1e6, NULL},
        {"pairs", "N", "of a pass at most; what takes more is not run (default 2e9)", LW_OPTION_REAL,
         &s.pairs, 1, 1e15, NULL},
        {"only", "TEXT", "solvers that have it in their name", LW_OPTION_STRING, &s.only, 0, 0, NULL},
        {"passes", NULL, "what a pass of radiosity costs, instead", LW_OPTION_FLAG, &s.passes, 0, 0, NULL},
        {"early", "S", "errors over the first S CPU seconds, as CSV, instead", LW_OPTION_REAL, &s.early, 1e-3,
         1e6, NULL},
        {"denoise", NULL, "with --early: of what is shown, filtered, in place of the sums", LW_OPTION_FLAG,
         &s.denoise, 0, 0, NULL},
        {"o", "DIR", "with --early: write pictures there", LW_OPTION_STRING, &s.folder, 0, 0, NULL},
        {"points", NULL, "what sets of virtual point lights gain and lose, instead", LW_OPTION_FLAG,
         &s.points, 0, 0, NULL},
        {"still", NULL, "no lamp moves", LW_OPTION_FLAG, &s.still, 0, 0, NULL}};
    return BENCH_MAIN(argc, argv, table, .name = "bench_solvers", .about = "The solvers at equal error.",
                      .operand = "SCENE[@CAMERA]", .open = &s.open, .folder = &s.folder, .context = &s,
                      .begin = begin);
}
