/* bench_look: how a view looks while its light converges, and what more samples of a pixel cost and bring.
 *
 *     bench_look [OPTIONS] SCENE[@PX,PY,PZ:TX,TY,TZ:FOV | @CAMERA]...
 *
 * Solves a scene that stands still, with the filter, and composes the view through the centres of the
 * pixels after 1, 2, 4, ... frames; light is as the solver shows it, not coded. Two tables in Markdown. The
 * first compares each picture with the last one: solve s is CPU time so far; shown error, good and max
 * error are lw_compose_report's; relMSE = mean((x - t)^2 / (t^2 + eps)), eps = 1 % of the mean of t^2; FLIP
 * at 67 pixels per degree, by the viewer's tone curve and the last picture's exposure. The second composes
 * the last light with more samples, of every pixel and at edges: CPU time over that of one sample, and
 * relMSE against as many samples of every pixel as --reference says, medians of --rounds. With -o DIR the
 * pictures as PNG. */
#include "client/view/antialias.h"
#include "client/view/tonemap.h"
#include "common/clock.h"
#include "common/image/flip.h"
#include "common/image/image.h"
#include "server/solve/solvers.h"
#include "tests/bench/bench_setup.h"
#include "tests/bench/bench_view.h"
#include "tests/support/support.h"

#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SHARES_MAX 8u
#define PICTURES   (21u * SHARES_MAX) /* after 1 frame, 2, 4, ... 2^20 */
#define ROUNDS_MAX 99

struct settings {
    struct lw_scene_open open;
    int64_t bounces, frames, width, height, reference, rounds;
    double time_s;
    const char *noise_shown;  /* numbers, apart by commas */
    double share[SHARES_MAX]; /* which they are */
    uint32_t share_count;
    const char *folder;
    uint32_t scenes; /* so far */
};

struct scene {
    const struct settings *settings;
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_compose *compose;
    struct bench_view_light light;
    struct lw_compose_view view;
    struct lw_compose_source source;
    uint32_t picture_count;
    struct picture {
        uint64_t frames;
        double noise_shown;
        double solve_s;
        struct lw_compose_report report;
        float *rgb; /* width * height * 3 */
    } picture[PICTURES];
    float *shown[2], *map_of_flip; /* for FLIP: as a display shows them; what it says */
    struct lw_antialias antialias;
    struct lw_tonemap tonemap;
};

static size_t pixel_count(const struct scene *s) { return (size_t)s->view.width * s->view.height; }

/* ---- the light ---- */

static enum lw_status keep_picture(struct scene *s, uint64_t frame, double noise_shown, double solve_s,
                                   struct lw_error *err) {
    struct picture *p = &s->picture[s->picture_count];
    *p = (struct picture){.frames = frame, .solve_s = solve_s, .noise_shown = noise_shown};
    p->rgb = malloc(pixel_count(s) * 3 * sizeof *p->rgb);
    if (!p->rgb) return lw_status_fail(err, LW_NO_MEMORY, "pictures");
    s->picture_count++;
    s->source.noise_shown = (float)noise_shown;
    lw_compose_render(s->compose, &s->source, &s->pose, &s->view, p->rgb, &p->report);
    return LW_OK;
}

static enum lw_status solve(struct scene *s, struct lw_error *err) {
    const struct settings *settings = s->settings;
    struct lw_solver *solver;
    enum lw_status status = lw_solvers_create(NULL,
                                              &(struct lw_solver_desc){.scene = s->scene,
                                                                       .atlas_map = &s->map,
                                                                       .bounces = (uint32_t)settings->bounces,
                                                                       .tracing_range_m = INFINITY,
                                                                       .direct_samples = 1,
                                                                       .indirect_samples = 2,
                                                                       .target_error = 1e-9f,
                                                                       .denoise = true,
                                                                       .seed = 1},
                                              &s->pose, &solver, err);
    if (status != LW_OK) return status;
    double solve_s = 0;
    for (uint64_t frame = 1; status == LW_OK && frame <= (uint64_t)settings->frames; frame++) {
        struct lw_solver_stats stats;
        const uint64_t began_ns = lw_clock_process_cpu_ns();
        status = solver->ops->frame(solver, &s->pose, frame, &stats, err);
        solve_s += 1e-9 * (double)(lw_clock_process_cpu_ns() - began_ns);
        if (status != LW_OK || ((frame & (frame - 1)) && frame != (uint64_t)settings->frames)) continue;
        bench_view_light_read(&s->light, solver);
        for (uint32_t i = s->settings->share_count; status == LW_OK && i-- > 0;)
            status = keep_picture(s, frame, s->settings->share[i], solve_s, err);
    }
    solver->ops->destroy(solver);
    return status;
}

/* ---- the pictures ---- */

static void show(const struct scene *s, const float *rgb, float *out) {
    for (size_t i = 0; i < pixel_count(s); i++) {
        const struct lw_vec3 c = lw_vec3_scale(lw_vec3(rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]),
                                               s->tonemap.scale),
                             d = lw_tonemap_apply(s->tonemap.curve, c);
        out[3 * i] = d.x, out[3 * i + 1] = d.y, out[3 * i + 2] = d.z;
    }
}

static enum lw_status write_picture(const struct scene *s, const char *name, const float *rgb,
                                    struct lw_error *err) {
    char path[512];
    if (s->settings->folder == NULL) return LW_OK;
    snprintf(path, sizeof path, "%s/look-%u-%s.png", s->settings->folder, s->settings->scenes, name);
    uint8_t *srgb = malloc(pixel_count(s) * 3);
    if (!srgb) return lw_status_fail(err, LW_NO_MEMORY, "pictures");
    lw_tonemap_encode(&s->tonemap, rgb, pixel_count(s), 3, srgb);
    enum lw_status status = lw_image_write_png(path, srgb, s->view.width, s->view.height, err);
    free(srgb);
    return status;
}

static enum lw_status tell_pictures(struct scene *s, struct lw_error *err) {
    const float *reference = s->picture[s->picture_count - 1].rgb;
    enum lw_status status = LW_OK;
    lw_tonemap_init(&s->tonemap, LW_TONEMAP_REINHARD, lw_tonemap_auto_stops(reference, pixel_count(s)));
    show(s, reference, s->shown[0]);
    printf("| frames | solve s | noise shown | shown error | good | max error | relMSE | FLIP |\n"
           "|---|---|---|---|---|---|---|---|\n");
    for (uint32_t i = 0; status == LW_OK && i < s->picture_count; i++) {
        const struct picture *p = &s->picture[i];
        char name[48];
        show(s, p->rgb, s->shown[1]);
        status = lw_flip_map(s->shown[0], s->shown[1], s->view.width, s->view.height,
                             LW_FLIP_PIXELS_PER_DEGREE, s->map_of_flip, err);
        if (status != LW_OK) return status;
        printf("| %llu | %.1f | %g | %.4f | %s | %.3f | %.4f | %.3f |\n", (unsigned long long)p->frames,
               p->solve_s, p->noise_shown, (double)p->report.shown_error, p->report.good ? "yes" : "no",
               (double)p->report.max_error, lw_support_relmse(p->rgb, reference, 3 * pixel_count(s)),
               lw_flip_mean(s->map_of_flip, NULL, pixel_count(s)));
        fflush(stdout);
        snprintf(name, sizeof name, "%llu-%g", (unsigned long long)p->frames, p->noise_shown);
        status = write_picture(s, name, p->rgb, err);
    }
    return status;
}

/* ---- samples ---- */

static void take(struct scene *s, bool edges, uint32_t samples, float *rgb) {
    struct lw_compose_report report;
    if (edges)
        lw_antialias_render_edges(&s->antialias, s->compose, &s->source, &s->pose, &s->view, samples, 0, rgb,
                                  &report);
    else
        lw_antialias_render(&s->antialias, s->compose, &s->source, &s->pose, &s->view, samples, rgb, &report);
}

static enum lw_status tell_samples(struct scene *s, struct lw_error *err) {
    static const struct {
        bool edges;
        uint32_t samples;
    } way[] = {{false, 1}, {true, 0},  {true, 2},  {true, 4},  {true, 8},
               {true, 16}, {false, 2}, {false, 4}, {false, 8}, {false, 16}};
    enum { WAYS = sizeof way / sizeof way[0] };
    const uint32_t rounds = (uint32_t)s->settings->rounds;
    double ms[WAYS][ROUNDS_MAX], error[WAYS] = {0}, share[WAYS] = {0};
    float *reference = s->shown[0], *rgb = s->shown[1];
    enum lw_status status = lw_antialias_reserve(&s->antialias, pixel_count(s), err);
    if (status != LW_OK) return status;
    take(s, false, (uint32_t)s->settings->reference, reference);
    for (uint32_t round = 0; round < rounds; round++) /* alternately: all meet the same machine */
        for (int w = 0; w < WAYS; w++) {
            const uint64_t began_ns = lw_clock_process_cpu_ns();
            take(s, way[w].edges, way[w].samples, rgb);
            ms[w][round] = 1e-6 * (double)(lw_clock_process_cpu_ns() - began_ns);
            if (round > 0) continue;
            char name[32];
            error[w] = lw_support_relmse(rgb, reference, 3 * pixel_count(s));
            share[w] = way[w].edges ? (double)s->antialias.edge_count / (double)pixel_count(s) : 1;
            snprintf(name, sizeof name, "%s-%u", way[w].edges ? "edges" : "all", way[w].samples);
            status = write_picture(s, name, rgb, err);
            if (status != LW_OK) return status;
        }
    const double one = bench_median(ms[0], rounds);
    printf("\n| samples | of pixels | CPU ms | times one sample | relMSE |\n|---|---|---|---|---|\n");
    for (int w = 0; w < WAYS; w++) {
        const double cost = bench_median(ms[w], rounds);
        printf(way[w].edges ? "| 1 + %u" : "| %u", way[w].samples);
        printf(" | %.1f %% | %.1f | %.2f | %.5f |\n", 100 * share[w], cost, cost / one, error[w]);
    }
    return LW_OK;
}

/* ---- the whole ---- */

static enum lw_status prepare(struct scene *s, const char *name, struct lw_error *err) {
    enum lw_status status = bench_open(&s->settings->open, name, BENCH_MOTION_OWN, s->settings->time_s,
                                       &s->scene, &s->pose, &s->map, err);
    if (status != LW_OK) return status;
    status = lw_trace_create(s->scene, &s->pose, &s->trace, err);
    if (status == LW_OK)
        status =
            lw_compose_create(&(struct lw_compose_desc){.scene = s->scene, .map = &s->map, .trace = s->trace},
                              &s->compose, err);
    if (status != LW_OK) return status;
    for (int i = 0; i < 2; i++) s->shown[i] = malloc(pixel_count(s) * 3 * sizeof *s->shown[i]);
    s->map_of_flip = malloc(pixel_count(s) * sizeof *s->map_of_flip);
    if (!s->shown[0] || !s->shown[1] || !s->map_of_flip)
        status = lw_status_fail(err, LW_NO_MEMORY, "pictures");
    if (status == LW_OK) status = bench_view_light_init(&s->light, &s->map, err);
    s->source = bench_view_light_source(&s->light, s->scene, (uint32_t)s->settings->bounces);
    s->source.target_error = 0.02f;
    if (status != LW_OK) return status;
    return bench_view_camera(name, s->scene, &s->pose, s->trace, (float)s->view.width / (float)s->view.height,
                             &s->view.camera, err);
}

static void finish(struct scene *s) {
    for (uint32_t i = 0; i < s->picture_count; i++) free(s->picture[i].rgb);
    for (int i = 0; i < 2; i++) free(s->shown[i]);
    free(s->map_of_flip);
    bench_view_light_finish(&s->light);
    lw_antialias_finish(&s->antialias);
    lw_compose_destroy(s->compose);
    lw_trace_destroy(s->trace);
    bench_close(s->scene, &s->pose, &s->map);
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    struct settings *settings = context;
    char label[64];
    struct scene s = {.settings = settings,
                      .view = {.width = (uint32_t)settings->width, .height = (uint32_t)settings->height}};
    enum lw_status status = prepare(&s, name, err);
    if (status == LW_OK)
        printf("\n%s, %u x %u\n\n", bench_label(name, label, sizeof label), s.view.width, s.view.height);
    if (status == LW_OK) status = solve(&s, err);
    if (status == LW_OK) status = tell_pictures(&s, err);
    if (status == LW_OK) status = tell_samples(&s, err);
    settings->scenes++;
    finish(&s);
    return status;
}

static enum lw_status begin(void *context, struct lw_error *err) {
    struct settings *s = context;
    const char *at = s->noise_shown;
    for (s->share_count = 0; s->share_count < SHARES_MAX; at++) {
        char *end;
        const double share = strtod(at, &end);
        if (end == at || !(share >= 0 && share <= 1) || (*end != ',' && *end != '\0'))
            return lw_status_fail(err, LW_USAGE,
                                  "--noise-shown: \"%.60s\" is not a list of numbers from 0 to 1",
                                  s->noise_shown);
        s->share[s->share_count++] = share;
        at = end;
        if (*end == '\0') break;
    }
    return LW_OK;
}

int main(int argc, char **argv) {
    struct settings s = {.bounces = 2,
                         .frames = 256,
                         .width = 640,
                         .height = 360,
                         .reference = 64,
                         .rounds = 5,
                         .noise_shown = "0.2"};
    const struct lw_option table[] = {
        {"bounces", "N", "indirect bounces (default 2)", LW_OPTION_INT, &s.bounces, 0, LW_SOLVER_BOUNCES_MAX,
         NULL},
        {"frames", "N", "frames of the solve (default 256)", LW_OPTION_INT, &s.frames, 1, 1 << 20, NULL},
        {"width", "N", "pixels (default 640)", LW_OPTION_INT, &s.width, 8, 16384, NULL},
        {"height", "N", "pixels (default 360)", LW_OPTION_INT, &s.height, 6, 16384, NULL},
        {"time", "SECONDS", "of the scene's animation (default 0)", LW_OPTION_REAL, &s.time_s, 0, 1e9, NULL},
        {"reference", "N", "samples per pixel of the true square (default 64)", LW_OPTION_INT, &s.reference,
         1, LW_ANTIALIAS_SAMPLES_MAX, NULL},
        {"rounds", "N", "of the second table (default 5)", LW_OPTION_INT, &s.rounds, 1, ROUNDS_MAX, NULL},
        {"noise-shown", "SHARE,...",
         "of tiles' errors that views see; the last picture with the first share is the reference (default "
         "0.2)",
         LW_OPTION_STRING, &s.noise_shown, 0, 0, NULL},
        {"o", "DIR", "write the pictures there", LW_OPTION_STRING, &s.folder, 0, 0, NULL}};
    return bench_main(&(struct bench_program){.name = "bench_look",
                                              .about = "Says how a view looks while its light converges, and "
                                                       "what more samples of a pixel bring.",
                                              .operand = "SCENE[@CAMERA]",
                                              .table = table,
                                              .count = sizeof table / sizeof table[0],
                                              .open = &s.open,
                                              .context = &s,
                                              .folder = &s.folder,
                                              .begin = begin,
                                              .run = run},
                      argc, argv);
}
