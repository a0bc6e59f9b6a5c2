/* bench_thesis: the questions of Vandersanden 2023, asked of a CPU: what a setting does to the time of a
 * frame. CSV on stdout.
 *
 *     bench_thesis --question cells|range|projection|order|samples|none [--only NAME] [--frames N] SCENE...
 *
 *   cells       the scene's longest side over that of a radiance cell: 1, 2, 4, 8, 16
 *   range       tracing range, as a share of the longest side: 0 ... 1, inf
 *   projection  where a probe is asked at range 0.1: by its depths, at the scene's box, at a fixed step
 *   order       what follows what: tiles of a cell, tiles of an object, or tiles in no order at all
 *   samples     direct + indirect rays per texel and frame
 *   none        the default, for sweeps from outside (thesis.py)
 * A solver for each setting, one worker each; they solve their frames alternately. Medians over the frames:
 * CPU ms of the frame and of its parts; `over_first`: the median of the ratio to the first setting's frame of
 * the same turn. */
#include "common/clock.h"
#include "common/random.h"
#include "server/solve/solvers.h"
#include "server/solve/state/tiles.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FRAMES_MAX   256
#define SETTINGS_MAX 8u

enum order { ORDER_CELL = 0, ORDER_OBJECT, ORDER_NONE };

/* Zero: the default. */
struct setting {
    const char *name;
    float cells, range; /* of the longest side: cells per side, range; range 0: infinite */
    enum lw_probe_projection projection;
    uint32_t direct, indirect;
    enum order order;
};

static const struct {
    uint32_t count;
    struct setting setting[SETTINGS_MAX];
} questions[] = {
    {5,
     {{.name = "4", .cells = 4},
      {.name = "1", .cells = 1},
      {.name = "2", .cells = 2},
      {.name = "8", .cells = 8},
      {.name = "16", .cells = 16}}},
    {8,
     {{.name = "inf"},
      {.name = "0", .range = 1e-4f},
      {.name = "0.05", .range = 0.05f},
      {.name = "0.1", .range = 0.1f},
      {.name = "0.2", .range = 0.2f},
      {.name = "0.4", .range = 0.4f},
      {.name = "0.7", .range = 0.7f},
      {.name = "1", .range = 1}}},
    {4,
     {{.name = "inf"},
      {.name = "depth", .range = 0.1f, .projection = LW_PROBE_PROJECTION_DEPTH},
      {.name = "box", .range = 0.1f, .projection = LW_PROBE_PROJECTION_BOX},
      {.name = "step", .range = 0.1f, .projection = LW_PROBE_PROJECTION_STEP}}},
    {3, {{.name = "cell"}, {.name = "object", .order = ORDER_OBJECT}, {.name = "none", .order = ORDER_NONE}}},
    {4,
     {{.name = "1+1", .direct = 1, .indirect = 1},
      {.name = "1+2", .direct = 1, .indirect = 2},
      {.name = "2+4", .direct = 2, .indirect = 4},
      {.name = "8+10", .direct = 8, .indirect = 10}}},
    {1, {{.name = "default"}}}};

struct settings {
    struct lw_scene_open open;
    int question;
    int64_t frames;
    const char *only;
};

struct renderer {
    const struct setting *setting;
    struct lw_solver *solver;
    uint64_t rays;
    uint32_t texels;
    double frame[FRAMES_MAX], direct[FRAMES_MAX], scatter[FRAMES_MAX], probe[FRAMES_MAX]; /* CPU ms */
};

/* ---- another order of tiles than the solver's own ---- */

static enum order wanted_order; /* of the solver that is made */

static int by_object(const void *a, const void *b) {
    const struct lw_solve_tile *x = a, *y = b;
    return x->id.v < y->id.v ? -1 : x->id.v > y->id.v; /* ids go object by object */
}

static int by_chance(const void *a, const void *b) {
    const struct lw_solve_tile *x = a, *y = b;
    const uint32_t i = lw_random_hash(x->id.v), j = lw_random_hash(y->id.v);
    return i < j ? -1 : i > j;
}

void __real_lw_tiles_set_pose(struct lw_tiles *tiles, const struct lw_cells *cells,
                              const struct lw_pose *pose);
void __wrap_lw_tiles_set_pose(struct lw_tiles *tiles, const struct lw_cells *cells,
                              const struct lw_pose *pose);
_Static_assert(__builtin_types_compatible_p(__typeof__(lw_tiles_set_pose),
                                            __typeof__(__wrap_lw_tiles_set_pose)),
               "the parameters of lw_tiles_set_pose have changed");

void __wrap_lw_tiles_set_pose(struct lw_tiles *tiles, const struct lw_cells *cells,
                              const struct lw_pose *pose) {
    __real_lw_tiles_set_pose(tiles, cells, pose);
    if (wanted_order == ORDER_CELL) return;
    qsort(tiles->tile, tiles->count, sizeof *tiles->tile,
          wanted_order == ORDER_OBJECT ? by_object : by_chance);
    for (uint32_t i = 0; i < tiles->count; i++) tiles->slot_of_id[tiles->tile[i].id.v] = i;
}

static enum lw_status make(const struct lw_scene *scene, const struct lw_pose *pose,
                           const struct lw_atlas_map *map, struct renderer *c, struct lw_error *err) {
    const struct setting *s = c->setting;
    struct lw_vec3 lo, hi;
    lw_pose_bounds(pose, scene, &lo, &hi);
    const struct lw_vec3 size = lw_vec3_sub(hi, lo);
    const float longest_m = fmaxf(size.x, fmaxf(size.y, size.z));
    wanted_order = s->order;
    return lw_solvers_create(
        NULL,
        &(struct lw_solver_desc){.scene = scene,
                                 .atlas_map = map,
                                 .bounces = 2,
                                 .tracing_range_m = s->range > 0 ? s->range * longest_m : INFINITY,
                                 .cell_size_m = s->cells > 0 ? longest_m / s->cells : 0,
                                 .probe_projection = s->projection,
                                 .direct_samples = s->direct ? s->direct : 1,
                                 .indirect_samples = s->indirect ? s->indirect : 2,
                                 .target_error = -1,
                                 .threads = 1},
        pose, &c->solver, err);
}

/* The first frame is lit and allocated; it is solved, but not counted. */
static enum lw_status solve(struct renderer *c, const struct lw_pose *pose, uint32_t turn,
                            struct lw_error *err) {
    struct lw_solver_stats stats;
    const uint64_t cpu_ns = lw_clock_thread_cpu_ns(), wall_ns = lw_clock_ns();
    enum lw_status status = c->solver->ops->frame(c->solver, pose, turn + 1, &stats, err);
    if (status != LW_OK || turn == 0) return status;
    const double cpu = 1e-6 * (double)(lw_clock_thread_cpu_ns() - cpu_ns),
                 share =
                     cpu / (double)(lw_clock_ns() - wall_ns); /* who waits for a processor waits everywhere */
    c->frame[turn - 1] = cpu;
    c->direct[turn - 1] = share * (double)stats.direct_ns;
    c->scatter[turn - 1] = share * (double)stats.scatter_ns;
    c->probe[turn - 1] = share * (double)stats.probe_ns;
    c->rays = stats.rays_shadow + stats.rays_bounce + stats.rays_probe;
    c->texels = (uint32_t)stats.texels_solved;
    return LW_OK;
}

static void print(const char *label, const char *question, struct renderer *c, double *over_first,
                  size_t frames) {
    printf("%s,%s,%s,%u,%.3f,%.2f,%.2f,%.2f,%.2f,%.3f\n", label, question, c->setting->name, c->texels,
           1e-6 * (double)c->rays, bench_median(c->frame, frames), bench_median(c->direct, frames),
           bench_median(c->scatter, frames), bench_median(c->probe, frames),
           bench_median(over_first, frames));
}

static const char names[] = "cells|range|projection|order|samples|none";

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    const struct settings *s = context;
    struct lw_scene *scene = NULL;
    struct lw_pose pose = {0};
    struct lw_atlas_map map = {0};
    char label[64], question[16];
    const char *from = names;
    for (int i = 0; i < s->question; i++) from = strchr(from, '|') + 1;
    snprintf(question, sizeof question, "%.*s", (int)strcspn(from, "|"), from);
    struct renderer *renderer = calloc(SETTINGS_MAX, sizeof *renderer);
    if (!renderer) return lw_status_fail(err, LW_NO_MEMORY, "settings");
    uint32_t count = 0;
    enum lw_status status = bench_open(&s->open, name, BENCH_MOTION_OWN, 0, &scene, &pose, &map, err);
    for (uint32_t i = 0; status == LW_OK && i < questions[s->question].count; i++) {
        const struct setting *setting = &questions[s->question].setting[i];
        if (s->only && strcmp(s->only, setting->name) != 0) continue;
        renderer[count].setting = setting;
        status = make(scene, &pose, &map, &renderer[count++], err);
    }
    for (uint32_t turn = 0; status == LW_OK && turn <= s->frames; turn++)
        for (uint32_t i = 0; status == LW_OK && i < count; i++)
            status = solve(&renderer[i], &pose, turn, err);
    double over_first[SETTINGS_MAX][FRAMES_MAX];
    for (uint32_t i = 0; i < count; i++)
        for (int64_t f = 0; f < s->frames; f++)
            over_first[i][f] = renderer[i].frame[f] / renderer[0].frame[f];
    for (uint32_t i = 0; status == LW_OK && i < count; i++)
        print(bench_label(name, label, sizeof label), question, &renderer[i], over_first[i],
              (size_t)s->frames);
    fflush(stdout);
    for (uint32_t i = 0; i < count; i++)
        if (renderer[i].solver) renderer[i].solver->ops->destroy(renderer[i].solver);
    free(renderer);
    bench_close(scene, &pose, &map);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.frames = 9};
    const struct lw_option table[] = {
        {"question", names, "what is asked (default cells)", LW_OPTION_CHOICE, &s.question, 0, 0, NULL},
        {"only", "NAME", "one of the question's settings", LW_OPTION_STRING, &s.only, 0, 0, NULL},
        {"frames", "N", "of each setting, after the first (default 9)", LW_OPTION_INT, &s.frames, 1,
         FRAMES_MAX, NULL}};
    return bench_main(
        &(struct bench_program){
            .name = "bench_thesis",
            .about = "What settings of the solver do to the time of a frame, as CSV.",
            .table = table,
            .count = sizeof table / sizeof table[0],
            .open = &s.open,
            .context = &s,
            .heading =
                "scene,question,setting,texels,mrays,frame_ms,direct_ms,scatter_ms,probe_ms,over_first",
            .run = run},
        argc, argv);
}
