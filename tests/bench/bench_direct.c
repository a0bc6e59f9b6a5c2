/* bench_direct: noise and cost of direct light by emissive triangles, and by points and spots where they are
 * many.
 *
 *     bench_direct --at X,Y,Z --spacing M SCENE...
 *
 * Packets of 4 x 4 points lie where rays from --at end, whose directions are random. After 16 frames the
 * error is measured: relMSE is the variance over the square of the mean, by luminance. Prints mean and
 * median of relMSE over packets, CPU us and rays of a packet and frame, and the sum of E, which is the same
 * for two versions of the program within its noise. */
#include "common/base/clock.h"
#include "common/base/random.h"
#include "common/light/direct16.h"
#include "common/trace/trace.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LANES    LW_TRACE_WIDTH
#define TOGETHER 16 /* frames */
#define SEED     7u

struct settings {
    struct lw_scene_open open;
    const char *at;
    double spacing_m;
    int64_t packets, frames;
};

struct stage {
    const struct lw_scene *scene;
    const struct lw_pose *pose;
    struct lw_lights lights;
    struct lw_trace *trace;
    struct lw_vec3 eye;
};

struct sums {
    double *relmse, total, cpu_us, rays;
    size_t count;
};

/* Where a ray in a random direction ends; false: nowhere. */
static bool meet(const struct stage *s, uint32_t number, struct lw_vec3 *out_at, struct lw_vec3 *out_normal) {
    struct lw_ray16 rays;
    struct lw_hit16 hits;
    const float z = 2 * lw_random_unit(lw_random_hash2(SEED, 2 * number)) - 1,
                angle = 2 * LW_PI * lw_random_unit(lw_random_hash2(SEED, 2 * number + 1)),
                side = sqrtf(1 - z * z);
    const struct lw_vec3 way = lw_vec3(side * cosf(angle), z, side * sinf(angle));
    memset(&rays, 0, sizeof rays);
    lw_trace_set_ray(&rays, 0, s->eye, way, INFINITY);
    lw_trace_closest16(s->trace, LW_TRACE_LIGHT, 1, &rays, &hits);
    if (hits.object[0] == LW_TRACE_MISS) return false;
    const struct lw_mesh *mesh = &s->scene->mesh[s->scene->object[hits.object[0]].mesh];
    const uint32_t *corner = mesh->triangle[hits.triangle[0]];
    struct lw_vec3 v[3];
    for (int i = 0; i < 3; i++)
        v[i] = lw_affine_point(&s->pose->object_to_world[hits.object[0]], mesh->position[corner[i]]);
    *out_normal = lw_vec3_normalize(lw_vec3_cross(lw_vec3_sub(v[1], v[0]), lw_vec3_sub(v[2], v[0])));
    if (lw_vec3_dot(*out_normal, way) > 0) *out_normal = lw_vec3_scale(*out_normal, -1);
    *out_at = lw_vec3_mad(s->eye, way, hits.t[0]);
    return true;
}

static struct lw_points16 points_around(struct lw_vec3 at, struct lw_vec3 normal, float spacing_m) {
    const struct lw_vec3 up = fabsf(normal.y) < 0.9f ? lw_vec3(0, 1, 0) : lw_vec3(1, 0, 0),
                         along = lw_vec3_normalize(lw_vec3_cross(up, normal)),
                         aside = lw_vec3_cross(normal, along), lifted = lw_vec3_mad(at, normal, 2e-3f);
    struct lw_points16 points;
    for (int i = 0; i < LANES; i++) {
        const struct lw_vec3 row = lw_vec3_mad(lifted, along, spacing_m * ((float)(i % 4) - 1.5f)),
                             p = lw_vec3_mad(row, aside, spacing_m * ((float)(i / 4) - 1.5f));
        points.x[i] = p.x, points.y[i] = p.y, points.z[i] = p.z;
        points.nx[i] = normal.x, points.ny[i] = normal.y, points.nz[i] = normal.z;
    }
    return points;
}

static void measure(const struct stage *s, const struct lw_points16 *points, uint32_t packet, uint32_t frames,
                    struct sums *sums) {
    double sum[LANES] = {0}, together[LANES] = {0}, square[LANES] = {0}, variance = 0, mean2 = 0;
    for (uint32_t f = 0; f < frames; f++) {
        float e[3][LANES] = {{0}};
        struct lw_direct16 direct = {.lights = &s->lights,
                                     .trace = s->trace,
                                     .points = points,
                                     .active = UINT16_MAX,
                                     .coherent = true,
                                     .seed = SEED,
                                     .object = packet,
                                     .salt = f,
                                     .e = e};
        const uint64_t began_ns = lw_clock_thread_cpu_ns();
        lw_direct16_groups(&direct, f, 1);
        sums->cpu_us += (double)(lw_clock_thread_cpu_ns() - began_ns) / 1e3 / frames;
        sums->rays += (double)direct.rays / frames;
        for (int i = 0; i < LANES; i++) {
            together[i] += (0.2126 * (double)e[0][i] + 0.7152 * (double)e[1][i] + 0.0722 * (double)e[2][i]);
            if (f % TOGETHER != TOGETHER - 1) continue;
            sum[i] += together[i] / frames;
            square[i] += together[i] * together[i] / TOGETHER / frames;
            together[i] = 0;
        }
    }
    for (int i = 0; i < LANES; i++) {
        sums->total += sum[i];
        mean2 += sum[i] * sum[i];
        variance += square[i] - sum[i] * sum[i];
    }
    if (mean2 > 1e-9) sums->relmse[sums->count++] = fmax(variance, 0) / mean2;
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    const struct settings *s = context;
    struct lw_scene *scene = NULL;
    struct lw_pose pose = {0};
    struct sums sums = {.relmse = calloc((size_t)s->packets, sizeof *sums.relmse)};
    struct stage stage = {.pose = &pose};
    double mean = 0;
    if (sscanf(s->at, "%f,%f,%f", &stage.eye.x, &stage.eye.y, &stage.eye.z) != 3)
        return lw_status_fail(err, LW_USAGE, "--at: \"%s\" is not X,Y,Z", s->at);
    enum lw_status status = bench_open(&s->open, name, BENCH_MOTION_OWN, 0, &scene, &pose, NULL, err);
    stage.scene = scene;
    if (status == LW_OK) status = lw_lights_init(&stage.lights, scene, &pose);
    if (status == LW_OK) status = lw_trace_create(scene, &pose, &stage.trace, err);
    for (uint32_t p = 0; status == LW_OK && sums.relmse && p < s->packets; p++) {
        struct lw_vec3 at, normal;
        if (!meet(&stage, p, &at, &normal)) continue;
        const struct lw_points16 points = points_around(at, normal, (float)s->spacing_m);
        measure(&stage, &points, p, (uint32_t)s->frames * TOGETHER, &sums);
    }
    for (size_t i = 0; i < sums.count; i++) mean += sums.relmse[i] / (double)sums.count;
    if (sums.count)
        printf("%s: %zu packets, relMSE mean %.3g, median %.3g; %.2f us, %.1f rays a packet; E %.6g\n", name,
               sums.count, mean, bench_median(sums.relmse, sums.count), sums.cpu_us / (double)sums.count,
               sums.rays / (double)sums.count, sums.total);
    lw_trace_destroy(stage.trace);
    lw_lights_finish(&stage.lights);
    bench_close(scene, &pose, NULL);
    free(sums.relmse);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.at = "0,1.7,0", .spacing_m = 0.2, .packets = 150, .frames = 16};
    const struct lw_option table[] = {
        {"at", "X,Y,Z", "m (default 0,1.7,0)", LW_OPTION_STRING, &s.at, 0, 0, NULL},
        {"spacing", "M", "between points (default 0.2)", LW_OPTION_REAL, &s.spacing_m, 1e-3, 100, NULL},
        BENCH_INT("packets", "rays from --at (default 150)", &s.packets, 1, 100000),
        BENCH_INT("frames", "times 16 frames (default 16)", &s.frames, 2, 10000)};
    return BENCH_MAIN(argc, argv, table, .name = "bench_direct",
                      .about = "Noise and cost of direct light by many lamps.", .open = &s.open,
                      .context = &s);
}
