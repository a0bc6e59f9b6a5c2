/* bench_direction: how well a few numbers beside E predict E of a bent normal. A table in Markdown.
 *
 *     bench_direction [--frames N] [--places N] SCENE...
 *
 * A solver lights the scene for some frames. From covered texels, chosen evenly, rays go out over the
 * hemisphere and read the light where they end, and the sky where they meet nothing: light that clients do
 * not draw. These rays give E of every normal, and the moments that each form would keep:
 *     E          irradiance of the texel's own normal
 *     D          cosine moment, the integral of L cos w: of cosine-weighted rays the mean of pi L w
 *     R0, R1     moments of radiance, the integrals of L and of L w: of cosine-weighted rays they need 1/cos
 *
 * Errors are root mean squares, over azimuths and the brighter half of the places. For normals: of predicted
 * E minus E of the bent normal, over the larger of E of the two normals. For mirrors: of predicted minus
 * mirrored radiance, over the larger of that and E/pi. Noise: relative standard deviation of one
 * cosine-weighted ray's share. */
#include "common/colour.h"
#include "common/light/direction.h"
#include "common/light/direction_form.h"
#include "common/random.h"
#include "common/scene/environment.h"
#include "common/trace/trace.h"
#include "server/solve/solvers.h"
#include "server/solve/surface/texels.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define RAYS     4096u
#define AZIMUTHS 8u
#define LIFT_M   1e-3f
static const double bend_deg[] = {12, 30, 45, 60};
#define BENDS (sizeof bend_deg / sizeof bend_deg[0])

struct settings {
    struct lw_scene_open open;
    int64_t frames, places;
};

struct job {
    const struct settings *settings;
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_atlas_map map;
    struct lw_texels texels;
    struct lw_trace *trace;
    struct lw_solver *solver;
    float *luminance; /* radiance that a texel sends out, per texel */
};

/* What the rays of one place brought. All vectors about the normal, which is +z. */
struct place {
    double e, r0;
    double moment[3], r1[3];   /* D; R1 */
    double square_e, square_r; /* mean squares of one cosine-weighted ray's share */
    float radiance[RAYS];
    struct lw_vec3 way[RAYS];
};

/* ---- forms: E of normal m over E of the own one, +z ---- */

static double dot(const double a[3], struct lw_vec3 b) {
    return a[0] * (double)b.x + a[1] * (double)b.y + a[2] * (double)b.z;
}
static double length(const double a[3]) { return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

static double form_none(const struct place *p, struct lw_vec3 m) { return (void)p, (void)m, 1; }

static double form_even(const struct place *p, struct lw_vec3 m) {
    (void)p;
    return 0.5 * (1 + (double)m.z);
}

/* Unity's dominant direction, with the cosine moment for it. */
static double form_dominant(const struct place *p, struct lw_vec3 m) {
    return (0.5 + 0.5 * dot(p->moment, m) / p->e) / (0.5 + 0.5 * p->moment[2] / p->e);
}

static double geomerics(const double direction[3], double x, struct lw_vec3 m) {
    const double size = length(direction), q = size > 0 ? 0.5 * (1 + dot(direction, m) / size) : 0.5,
                 p = 1 + 2 * x, a = (1 - x) / (1 + x);
    return a + (1 - a) * (p + 1) * pow(fmax(q, 0), p);
}

static const struct lw_vec3 up = {0, 0, 1};

/* Hazel's formula, of the moments of radiance. */
static double form_radiance(const struct place *p, struct lw_vec3 m) {
    const double x = fmin(length(p->r1) / p->r0, 1);
    return geomerics(p->r1, x, m) / geomerics(p->r1, x, up);
}

/* The same of the moments of radiance that a linear radiance with the same E and D has. */
static double form_linear_radiance(const struct place *p, struct lw_vec3 m) {
    const double pi = (double)LW_PI, r[3] = {p->moment[0] / p->e, p->moment[1] / p->e, p->moment[2] / p->e};
    /* pi A + 2pi/3 B = 1; 2pi/3 A + pi/2 B = r_n */
    const double det = pi * pi / 2 - 4 * pi * pi / 9, a = (pi / 2 - 2 * pi / 3 * r[2]) / det,
                 b = (pi * r[2] - 2 * pi / 3) / det;
    const double r0 = 2 * pi * a + pi * b, r1[3] = {8.0 / 3 * r[0], 8.0 / 3 * r[1], pi * a + 2 * pi / 3 * b};
    const double x = r0 > 0 ? fmin(length(r1) / r0, 1) : 1;
    return geomerics(r1, x, m) / geomerics(r1, x, up);
}

static struct lw_direction_source source_of(const struct place *p) {
    const float inverse = 1 / (float)p->e;
    return lw_direction_source_of(
        lw_vec3((float)p->moment[0] * inverse, (float)p->moment[1] * inverse, (float)p->moment[2] * inverse),
        up);
}

/* The form that tiles hold. */
static double form_ours(const struct place *p, struct lw_vec3 m) {
    const struct lw_direction_source source = source_of(p);
    return (double)lw_direction_factor(&source, up, m);
}

struct form {
    const char *name;
    double (*at)(const struct place *p, struct lw_vec3 m);
};
static const struct form form[] = {{"E alone", form_none},
                                   {"E alone, an even hemisphere", form_even},
                                   {"E, D as a dominant direction", form_dominant},
                                   {"R0, R1 of radiance, Geomerics", form_radiance},
                                   {"E, D through a linear radiance, Geomerics", form_linear_radiance},
                                   {"E, D: even light and one source", form_ours}};
#define FORMS (sizeof form / sizeof form[0])

/* ---- rays ---- */

static float sky_at(const struct job *job, struct lw_vec3 way) {
    struct lw_vec3 sky = lw_vec3(job->pose.sky[0], job->pose.sky[1], job->pose.sky[2]);
    if (job->scene->environment.width)
        sky = lw_vec3_add(sky, lw_environment_radiance(&job->scene->environment, way));
    return lw_colour_luminance(sky);
}

static void look(const struct job *job, struct lw_vec3 from, struct lw_vec3 normal, uint32_t seed,
                 struct place *out) {
    memset(out, 0, offsetof(struct place, radiance));
    for (uint32_t first = 0; first < RAYS; first += 16) {
        struct lw_ray16 rays = {.salt = 0};
        struct lw_hit16 hits;
        for (uint32_t lane = 0; lane < 16; lane++) {
            float u[2];
            lw_random_sobol2(first + lane, seed, u);
            const float z = u[0], radius = sqrtf(fmaxf(1 - z * z, 0)), angle = 2 * LW_PI * u[1];
            const struct lw_vec3 local = lw_vec3(radius * cosf(angle), radius * sinf(angle), z);
            out->way[first + lane] = local;
            lw_trace_set_ray(&rays, lane, from, lw_direction_about(normal, local), INFINITY);
        }
        lw_trace_closest16(job->trace, LW_TRACE_LIGHT, 0xffff, &rays, &hits);
        for (uint32_t lane = 0; lane < 16; lane++) {
            float light;
            if (hits.object[lane] == LW_TRACE_MISS) {
                light = sky_at(job, lw_vec3(rays.dir_x[lane], rays.dir_y[lane], rays.dir_z[lane]));
            } else {
                const uint32_t texel = lw_texels_at(&job->texels, hits.object[lane], hits.triangle[lane],
                                                    hits.u[lane], hits.v[lane], hits.back[lane]);
                light = texel == LW_TEXEL_NONE ? 0 : job->luminance[texel];
            }
            out->radiance[first + lane] = light;
        }
    }
    const double weight = 2 * (double)LW_PI / RAYS;
    for (uint32_t i = 0; i < RAYS; i++) {
        const double l = (double)out->radiance[i], z = (double)out->way[i].z;
        const double w[3] = {(double)out->way[i].x, (double)out->way[i].y, z};
        out->e += weight * l * z;
        out->r0 += weight * l;
        out->square_e += weight * (double)LW_PI * l * l * z;
        out->square_r += weight * (double)LW_PI * l * l / fmax(z, 1e-6);
        for (int k = 0; k < 3; k++) {
            out->moment[k] += weight * l * z * w[k];
            out->r1[k] += weight * l * w[k];
        }
    }
}

static double truth(const struct place *p, struct lw_vec3 m) {
    double e = 0;
    for (uint32_t i = 0; i < RAYS; i++) e += (double)(p->radiance[i] * fmaxf(lw_vec3_dot(p->way[i], m), 0));
    return e * 2 * (double)LW_PI / RAYS;
}

/* ---- a scene ---- */

static void read_light(struct job *job) {
    for (uint32_t id = 0; id < job->map.plain_count; id++) {
        const struct lw_tile_place *at = &job->map.place[id];
        if (at->level) continue;
        struct lw_solver_tile tile;
        job->solver->ops->read_tile(job->solver, (lw_tile_id){id}, &tile);
        const struct lw_mesh_texels *mesh = &job->texels.mesh[job->scene->object[at->object].mesh];
        const uint32_t first = job->texels.first[at->object] + lw_texels_tile_start(mesh, at->x, at->y);
        for (uint32_t i = 0; i < tile.width * tile.height; i++) {
            job->texels.covered[first + i] = tile.covered[i];
            float sent[3];
            for (int c = 0; c < 3; c++)
                sent[c] = tile.albedo[c][i] / LW_PI * (tile.direct[c][i] + tile.indirect[c][i]);
            job->luminance[first + i] = lw_colour_luminance(lw_vec3(sent[0], sent[1], sent[2]));
        }
    }
    lw_texels_link(&job->texels, omp_get_max_threads());
}

/* Covered texels, evenly over all of them. */
static uint32_t choose(const struct job *job, uint32_t places, uint32_t *texel, uint32_t *object) {
    uint32_t covered = 0, count = 0, n = 0;
    for (uint32_t t = 0; t < job->texels.count; t++) covered += job->texels.covered[t];
    const uint32_t step = covered / places > 0 ? covered / places : 1;
    for (uint32_t o = 0; o < job->scene->object_count; o++) {
        const struct lw_mesh_texels *mesh = &job->texels.mesh[job->scene->object[o].mesh];
        for (uint32_t t = 0; t < mesh->texel_count && count < places; t++)
            if (job->texels.covered[job->texels.first[o] + t] && n++ % step == step / 2)
                texel[count] = t, object[count++] = o;
    }
    return count;
}

/* ---- mirrors ---- */

static const double roughness[] = {0.2, 0.35, 0.5};
#define MIRRORS (sizeof roughness / sizeof roughness[0])

/* Radiance that a mirror's lobe sees, over E/pi. */
static double mirrored(const struct place *p, struct lw_vec3 m, double alpha) {
    double sum = 0, weight = 0;
    for (uint32_t i = 0; i < RAYS; i++) {
        const double lobe = exp(0.5 / (alpha * alpha) * ((double)lw_vec3_dot(p->way[i], m) - 1));
        sum += lobe * (double)p->radiance[i];
        weight += lobe;
    }
    return sum / weight * (double)LW_PI / p->e;
}

static struct lw_vec3 tilted(double tilt_deg, uint32_t azimuth) {
    const float tilt = (float)(tilt_deg * (double)LW_PI / 180), turn = 2 * LW_PI * (float)azimuth / AZIMUTHS;
    return lw_vec3(sinf(tilt) * cosf(turn), sinf(tilt) * sinf(turn), cosf(tilt));
}

/* What one place adds to the table. */
struct row {
    double e, square[FORMS][BENDS], noise[3];
    double mirror[2][MIRRORS]; /* by E alone; by E and D */
};

static void add_place(const struct place *p, struct row *row) {
    row->e = p->e;
    for (uint32_t b = 0; b < BENDS && p->e > 0; b++)
        for (uint32_t k = 0; k < AZIMUTHS; k++) {
            const struct lw_vec3 m = tilted(bend_deg[b], k);
            const double right = truth(p, m) / p->e;
            for (uint32_t f = 0; f < FORMS; f++) {
                const double off = (form[f].at(p, m) - right) / fmax(right, 1);
                row->square[f][b] += off * off / AZIMUTHS;
            }
        }
    const struct lw_direction_source source = source_of(p);
    for (uint32_t r = 0; r < MIRRORS && p->e > 0; r++)
        for (uint32_t k = 0; k < AZIMUTHS; k++) {
            const double alpha = roughness[r] * roughness[r];
            const struct lw_vec3 m = tilted(k % 2 ? 25 : 55, k);
            const double right = mirrored(p, m, alpha),
                         gain[2] = {1, (double)lw_direction_gain(&source, up, m, (float)alpha)};
            for (int f = 0; f < 2; f++) {
                const double off = (gain[f] - right) / fmax(right, 1);
                row->mirror[f][r] += off * off / AZIMUTHS;
            }
        }
    row->noise[0] = sqrt(fmax(p->square_e / (p->e * p->e) - 1, 0));
    row->noise[1] = sqrt(fmax(p->square_e / pow(length(p->moment), 2) - 1, 0));
    row->noise[2] = sqrt(fmax(p->square_r / pow(length(p->r1), 2) - 1, 0));
}

static int by_light(const void *a, const void *b) {
    const struct row *x = a, *y = b;
    return (x->e > y->e) - (x->e < y->e);
}

/* The brighter half of the places: errors and noise are relative. */
static void print(const char *label, struct row *row, uint32_t count) {
    const uint32_t first = count / 2;
    double noise[3][RAYS];
    qsort(row, count, sizeof *row, by_light);
    for (uint32_t f = 0; f < FORMS; f++) {
        printf("| %s | %s |", label, form[f].name);
        for (uint32_t b = 0; b < BENDS; b++) {
            double square = 0;
            for (uint32_t i = first; i < count; i++) square += row[i].square[f][b] / (count - first);
            printf(" %.1f |", 100 * sqrt(square));
        }
        putchar('\n');
    }
    for (uint32_t i = first; i < count; i++)
        for (int k = 0; k < 3; k++) noise[k][i - first] = row[i].noise[k];
    printf("\n%s: mirrors of roughness 0.2, 0.35, 0.5:", label);
    for (int f = 0; f < 2; f++) {
        printf(f ? "; E, D" : " E alone");
        for (uint32_t r = 0; r < MIRRORS; r++) {
            double square = 0;
            for (uint32_t i = first; i < count; i++) square += row[i].mirror[f][r] / (count - first);
            printf(" %.0f %%", 100 * sqrt(square));
        }
    }
    printf("\n%s: noise of one ray, median: E %.2f, D %.2f, R1 %.2f\n\n", label,
           bench_median(noise[0], count - first), bench_median(noise[1], count - first),
           bench_median(noise[2], count - first));
}

static void measure_at(const struct job *job, uint32_t object, uint32_t texel, uint32_t seed,
                       struct row *row) {
    const struct lw_mesh_texels *mesh = &job->texels.mesh[job->scene->object[object].mesh];
    const struct lw_affine *to_world = &job->pose.object_to_world[object];
    const struct lw_vec3 normal = lw_vec3_normalize(
                             lw_affine_normal(to_world, lw_texels_vector(mesh->normal, texel))),
                         at = lw_affine_point(to_world, lw_texels_place(&job->texels, object, texel));
    struct place place;
    look(job, lw_vec3_mad(at, normal, LIFT_M), normal, seed, &place);
    add_place(&place, row);
}

static enum lw_status measure(const struct job *job, const char *label, struct lw_error *err) {
    const uint32_t places = (uint32_t)job->settings->places;
    uint32_t *texel = calloc(places, sizeof *texel), *object = calloc(places, sizeof *object);
    struct row *row = calloc(places, sizeof *row);
    const bool there = texel && object && row;
    if (there) {
        const uint32_t count = choose(job, places, texel, object);
#pragma omp parallel for schedule(dynamic)
        for (uint32_t i = 0; i < count; i++) measure_at(job, object[i], texel[i], i, &row[i]);
        if (count) print(label, row, count);
    }
    free(texel);
    free(object);
    free(row);
    return there ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "places");
}

static enum lw_status light(struct job *job, struct lw_error *err) {
    const struct lw_solver_desc desc = {.scene = job->scene,
                                        .atlas_map = &job->map,
                                        .bounces = 4,
                                        .tracing_range_m = INFINITY,
                                        .direct_samples = 1,
                                        .indirect_samples = 2,
                                        .target_error = -1,
                                        .denoise = true};
    struct lw_solver_stats stats;
    enum lw_status status = lw_solvers_create(NULL, &desc, &job->pose, &job->solver, err);
    for (int64_t i = 1; status == LW_OK && i <= job->settings->frames; i++)
        status = job->solver->ops->frame(job->solver, &job->pose, (uint64_t)i, &stats, err);
    if (status == LW_OK) status = lw_texels_init(&job->texels, job->scene, 0, NULL, NULL, err);
    if (status == LW_OK) status = lw_trace_create(job->scene, &job->pose, &job->trace, err);
    if (status != LW_OK) return status;
    job->luminance = calloc(job->texels.count + 1ul, sizeof *job->luminance);
    if (!job->luminance) return lw_status_fail(err, LW_NO_MEMORY, "light");
    read_light(job);
    return LW_OK;
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    char label[64];
    struct job job = {.settings = context};
    enum lw_status status =
        bench_open(&job.settings->open, name, BENCH_MOTION_OWN, 0, &job.scene, &job.pose, &job.map, err);
    if (status == LW_OK) status = light(&job, err);
    if (status == LW_OK) status = measure(&job, bench_label(name, label, sizeof label), err);
    if (job.solver) job.solver->ops->destroy(job.solver);
    lw_trace_destroy(job.trace);
    lw_texels_finish(&job.texels);
    free(job.luminance);
    bench_close(job.scene, &job.pose, &job.map);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.frames = 40, .places = 2000};
    const struct lw_option table[] = {
        {"frames", "N", "of the solver (default 40)", LW_OPTION_INT, &s.frames, 1, 10000, NULL},
        {"places", "N", "texels to look from (default 2000)", LW_OPTION_INT, &s.places, 2, 2 * RAYS, NULL}};
    return bench_main(
        &(struct bench_program){.name = "bench_direction",
                                .about = "How well a form of directional light predicts E of bent normals.",
                                .table = table,
                                .count = sizeof table / sizeof table[0],
                                .open = &s.open,
                                .heading =
                                    "| scene | form | 12 deg, % | 30 | 45 | 60 |\n|---|---|---|---|---|---|",
                                .context = &s,
                                .run = run},
        argc, argv);
}
