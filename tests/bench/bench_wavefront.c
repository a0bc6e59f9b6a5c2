/* bench_wavefront: what it brings to trace many paths stage by stage, and to sort them before each bounce.
 *
 *     bench_wavefront [OPTIONS] SCENE[@PX,PY,PZ:TX,TY,TZ:FOV]...
 *
 * Per scene a table in Markdown, a row for each way to trace a picture with one thread:
 *   ours          lw_path_trace_render(): 16 paths of 4 x 4 pixels share their random numbers
 *   own numbers   every path has its own, as in all further rows (wavefront.h); packets of 4 x 4 pixels go
 *                 from the eye to the end of their last path
 *   wavefront     N paths go on together, stage by stage; packets are filled from the queue of those that are
 *                 left. N: 1,024, 16,384 and the whole picture
 *   by ...        the same with a sorted queue: by material; by normal and place; by direction and place
 * and the columns
 *   CPU ms        for a sample of every pixel; median of the rounds, in each of which every row has a turn
 *   rate          paths per CPU second over those of `own numbers`; median of the rounds' ratios
 *   sorting       share of the CPU time
 *   lanes         in use per packet of bounce rays
 *   rays          a path, of all kinds
 *   light         mean radiance of the pictures over that of ours: 1 within noise, since all compute the same
 * Rows of own numbers trace the same paths: where the light of one differs from another's, the program fails.
 * Ours gives Embree's coherent flag to rays to lamps, too, and to first bounces; the others to rays from the
 * eye alone, which is fastest for them (--coherent).
 * BLEND surfaces, tints and cut-outs are treated as in path_trace.c. Left out are the guide, the clamp, the
 * ways to choose light and pixels (struct lw_path_view), the halves of a film, and threads. */
#include "client/view/path_trace.h"
#include "common/clock.h"
#include "tests/bench/bench_setup.h"
#include "tests/bench/bench_view.h"
#include "tests/bench/wavefront.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ROUNDS_MAX      99
#define LIGHT_TOLERANCE 3e-4

static const char *const order_name[WAVEFRONT_ORDERS] = {"", ", by material", ", by normal and place",
                                                         ", by direction and place"};
static const uint32_t path_counts[] = {1024, 16384, UINT32_MAX};
#define COUNTS (sizeof path_counts / sizeof *path_counts)
enum { OURS, OWN_NUMBERS, WAVEFRONTS, WAYS = WAVEFRONTS + COUNTS * WAVEFRONT_ORDERS };

struct settings {
    struct lw_scene_open open;
    int64_t bounces, samples, width, height, rounds;
    int coherent; /* enum wavefront_coherent */
};

struct count {
    uint64_t packets, bounce_rays, rays;
};

struct way {
    char name[64];
    uint32_t paths;
    enum wavefront_order by;
    double cpu_ms[ROUNDS_MAX], sort_ms, radiance; /* the last two: of all rounds */
    struct count count;
};

struct bench {
    const struct settings *settings;
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_lights lights;
    struct lw_path_trace *tracer;
    struct wavefront *wavefront;
    struct lw_path_view view;
    struct lw_path_film film;
    float *picture;
    struct way way[WAYS];
};

/* What the hooks below count. */
static struct count meter;

__typeof__(lw_trace_closest16) __real_lw_trace_closest16, __wrap_lw_trace_closest16;
__typeof__(lw_trace_tinted16) __real_lw_trace_tinted16, __wrap_lw_trace_tinted16;

void __wrap_lw_trace_closest16(const struct lw_trace *trace, unsigned flags, uint16_t active,
                               const struct lw_ray16 *rays, struct lw_hit16 *out_hits) {
    const unsigned lanes = (unsigned)__builtin_popcount(active);
    meter.rays += lanes;
    if (!(flags & LW_TRACE_VIEW)) meter.packets++, meter.bounce_rays += lanes;
    __real_lw_trace_closest16(trace, flags, active, rays, out_hits);
}

uint16_t __wrap_lw_trace_tinted16(const struct lw_trace *trace, unsigned flags, uint16_t active,
                                  const struct lw_ray16 *rays, float out_tint[3][16]) {
    meter.rays += (unsigned)__builtin_popcount(active);
    return __real_lw_trace_tinted16(trace, flags, active, rays, out_tint);
}

static uint32_t pixel_count(const struct bench *b) {
    return (uint32_t)(b->settings->width * b->settings->height);
}

static void name_ways(struct bench *b) {
    snprintf(b->way[OURS].name, sizeof b->way->name, "ours");
    b->way[OWN_NUMBERS].paths = LW_TRACE_WIDTH;
    snprintf(b->way[OWN_NUMBERS].name, sizeof b->way->name, "own numbers, packets of 4 x 4 pixels");
    for (uint32_t i = 0; i < COUNTS * WAVEFRONT_ORDERS; i++) {
        struct way *way = &b->way[WAVEFRONTS + i];
        const uint32_t paths = path_counts[i / WAVEFRONT_ORDERS];
        way->paths = paths < pixel_count(b) ? paths : pixel_count(b);
        way->by = (enum wavefront_order)(i % WAVEFRONT_ORDERS);
        snprintf(way->name, sizeof way->name, "wavefront, %u paths%s", way->paths, order_name[way->by]);
    }
}

/* A picture. */
static void measure(struct bench *b, struct way *way, uint32_t round) {
    const struct settings *o = b->settings;
    const size_t values = (size_t)pixel_count(b) * 3;
    uint64_t sort_ns = 0;
    b->view.seed = round + 1;
    lw_path_film_clear(&b->film);
    memset(b->picture, 0, values * sizeof *b->picture);
    meter = way->count;
    const uint64_t began_ns = lw_clock_thread_cpu_ns();
    if (way == &b->way[OURS])
        lw_path_trace_render(b->tracer, &b->view, (uint32_t)o->samples, &b->film, NULL);
    else
        wavefront_render(b->wavefront, way->paths, way->by, b->view.seed, (uint32_t)o->samples, b->picture,
                         &sort_ns);
    way->cpu_ms[round] = 1e-6 * (double)(lw_clock_thread_cpu_ns() - began_ns);
    way->sort_ms += 1e-6 * (double)sort_ns;
    way->count = meter;
    double sum = 0;
    if (way == &b->way[OURS]) lw_path_film_resolve(&b->film, b->picture);
    for (size_t i = 0; i < values; i++) sum += (double)b->picture[i];
    way->radiance += way == &b->way[OURS] ? sum * (double)o->samples : sum;
}

static void report(const struct bench *b, const char *name) {
    const struct settings *o = b->settings;
    const size_t rounds = (size_t)o->rounds;
    const double paths = (double)(pixel_count(b) * o->samples * o->rounds);
    char label[64];
    printf("\n%s, %d x %d, %d samples, %d bounces, %d rounds\n\n", bench_label(name, label, sizeof label),
           (int)o->width, (int)o->height, (int)o->samples, (int)o->bounces, (int)rounds);
    printf("| way | CPU ms | rate | sorting | lanes | rays | light "
           "|\n|---|---|---|---|---|---|---|\n");
    for (const struct way *way = b->way; way < b->way + WAYS; way++) {
        double ms[ROUNDS_MAX], rate[ROUNDS_MAX], all_ms = 0;
        for (size_t r = 0; r < rounds; r++) {
            ms[r] = way->cpu_ms[r] / (double)o->samples;
            rate[r] = b->way[OWN_NUMBERS].cpu_ms[r] / way->cpu_ms[r];
            all_ms += way->cpu_ms[r];
        }
        printf("| %s | %.1f | %.2f | %.1f %% | %.1f | %.2f | %.4f |\n", way->name, bench_median(ms, rounds),
               bench_median(rate, rounds), 100 * way->sort_ms / all_ms,
               (double)way->count.bounce_rays / (double)way->count.packets, (double)way->count.rays / paths,
               way->radiance / b->way[OURS].radiance);
    }
    fflush(stdout);
}

/* Other packets let hits round otherwise, and some paths go elsewhere. */
static enum lw_status compare(const struct bench *b, const char *name, struct lw_error *err) {
    const double light = b->way[OWN_NUMBERS].radiance;
    for (const struct way *way = b->way + WAVEFRONTS; way < b->way + WAYS; way++)
        if (!(fabs(way->radiance - light) <= LIGHT_TOLERANCE * light))
            return lw_status_fail(err, LW_INTERNAL,
                                  "%s: \"%s\" has %.5f times the light of the same paths in \"%s\"", name,
                                  way->name, way->radiance / light, b->way[OWN_NUMBERS].name);
    return LW_OK;
}

static enum lw_status create_tracers(struct bench *b, const char *name, struct lw_error *err) {
    const struct settings *o = b->settings;
    const uint32_t width = (uint32_t)o->width, height = (uint32_t)o->height;
    enum lw_status status = bench_view_camera(name, b->scene, &b->pose, b->trace,
                                              (float)width / (float)height, &b->view.camera, err);
    if (status != LW_OK) return status;
    b->view.bounces = (uint32_t)o->bounces;
    status = lw_path_trace_create(
        &(struct lw_path_trace_desc){
            .scene = b->scene, .trace = b->trace, .lights = &b->lights, .pose = &b->pose, .threads = 1},
        &b->tracer, err);
    if (status != LW_OK) return status;
    status = lw_path_film_init(&b->film, width, height, err);
    if (status != LW_OK) return status;
    b->picture = malloc((size_t)pixel_count(b) * 3 * sizeof *b->picture);
    if (!b->picture) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a picture");
    return wavefront_create(&(struct wavefront_desc){.scene = b->scene,
                                                     .trace = b->trace,
                                                     .lights = &b->lights,
                                                     .pose = &b->pose,
                                                     .camera = b->view.camera,
                                                     .width = width,
                                                     .height = height,
                                                     .bounces = b->view.bounces,
                                                     .coherent = (enum wavefront_coherent)o->coherent},
                            &b->wavefront, err);
}

static enum lw_status set_up(struct bench *b, const char *name, struct lw_error *err) {
    enum lw_status status =
        bench_open(&b->settings->open, name, BENCH_MOTION_OWN, 0, &b->scene, &b->pose, NULL, err);
    if (status != LW_OK) return status;
    /* One moment: coherent packets are safe then (path_command.c). */
    memset(b->pose.node_moves, 0, b->scene->node_count * sizeof *b->pose.node_moves);
    status = lw_trace_create(b->scene, &b->pose, &b->trace, err);
    if (status != LW_OK) return status;
    status = lw_lights_init(&b->lights, b->scene, &b->pose);
    if (status != LW_OK) return lw_status_fail(err, status, "%s: no memory for the lights", name);
    return create_tracers(b, name, err);
}

static void tear_down(struct bench *b) {
    wavefront_destroy(b->wavefront);
    free(b->picture);
    lw_path_film_finish(&b->film);
    lw_path_trace_destroy(b->tracer);
    lw_lights_finish(&b->lights);
    lw_trace_destroy(b->trace);
    bench_close(b->scene, &b->pose, NULL);
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    struct bench b = {.settings = context};
    enum lw_status status = set_up(&b, name, err);
    if (status == LW_OK) {
        name_ways(&b);
        for (uint32_t round = 0; round < b.settings->rounds; round++)
            for (int way = 0; way < WAYS; way++) measure(&b, &b.way[way], round);
        report(&b, name);
        status = compare(&b, name, err);
    }
    tear_down(&b);
    return status;
}

static enum lw_status begin(void *context, struct lw_error *err) {
    const struct settings *o = context;
    if (o->width % WAVEFRONT_SQUARE || o->height % WAVEFRONT_SQUARE)
        return lw_status_fail(err, LW_USAGE, "--width %d and --height %d: they must be multiples of %u",
                              (int)o->width, (int)o->height, WAVEFRONT_SQUARE);
    return LW_OK;
}

int main(int argc, char **argv) {
    struct settings s = {.bounces = 2,
                         .samples = 16,
                         .width = 320,
                         .height = 180,
                         .rounds = 5,
                         .coherent = WAVEFRONT_COHERENT_EYE};
    const struct lw_option table[] = {
        {"bounces", "N", "of indirect light (default 2)", LW_OPTION_INT, &s.bounces, 0,
         LW_PATH_TRACE_BOUNCES_MAX, NULL},
        {"samples", "N", "paths a pixel (default 16)", LW_OPTION_INT, &s.samples, 1, LW_PATH_FILM_SAMPLES_MAX,
         NULL},
        {"width", "N", "pixels, a multiple of 4 (default 320)", LW_OPTION_INT, &s.width, 4,
         WAVEFRONT_SIDE_MAX, NULL},
        {"height", "N", "pixels, a multiple of 4 (default 180)", LW_OPTION_INT, &s.height, 4,
         WAVEFRONT_SIDE_MAX, NULL},
        {"rounds", "N", "turns of each row (default 5)", LW_OPTION_INT, &s.rounds, 1, ROUNDS_MAX, NULL},
        {"coherent", "eye|lamps|all", "own numbers: Embree's coherent flag up to these rays (default eye)",
         LW_OPTION_CHOICE, &s.coherent, 0, 0, NULL}};
    return bench_main(&(struct bench_program){.name = "bench_wavefront",
                                              .about = "Paths in wavefronts, sorted or not, against packets.",
                                              .operand = "SCENE[@CAMERA]",
                                              .table = table,
                                              .count = sizeof table / sizeof table[0],
                                              .open = &s.open,
                                              .context = &s,
                                              .begin = begin,
                                              .run = run},
                      argc, argv);
}
