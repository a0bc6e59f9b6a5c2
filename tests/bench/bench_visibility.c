/* bench_visibility: what a pass of radiosity gains by bits of visibility, and by voxels in place of rays.
 *
 *     bench_visibility [OPTIONS] SCENE...
 *
 * Two questions of B. Kahl 2023, "Hardware Acceleration of Progressive Refinement Radiosity". Patches are the
 * texels of a scene; shooters are means of windows of them (mip), or each by itself. They send what they
 * reflect of direct light, that of emissive surfaces included, which all rows have in common; it is sampled
 * as in the cell solver. One pass gives E of one bounce, by way:
 *   rays                 a ray for each pair with a weight (radiosity_pass.h): the truth of the table
 *   rays, bits written   the same; the bits are kept, as in the first pass with --keep-visibility
 *   bits read            no ray: a later pass
 *   voxels, N            no ray: each pair marches through a grid of bits, N cells along the scene's longest
 *                        side, from patch to shooter. What that finds is kept as bits, and these are read
 * A cell is solid where a triangle overlaps it, by separating axes (Akenine-Moller 2001). The march visits
 * all cells of the segment in order (Amanatides and Woo 1987), for a packet of sixteen at once, as rays. The
 * cells of both ends do not count, nor those within --skip cells of them by every axis: or surfaces would be
 * in their own way. They still are for segments that leave at a small angle, which cross the same number of
 * their surface's cells in every grid. --lift raises both ends along their normals, by cells, against that.
 *
 * Rays go through what is cut out of a mask (MASK) and, by chance, through BLEND surfaces. Voxels know no
 * alpha: all triangles of objects that are not hidden are solid. Backs of surfaces stop both.
 *
 * Columns:
 *   build        CPU s of the rays' structure, of voxelising; bits need what traced them, once
 *   MiB          of the rays' structure, of the bits, of the grid
 *   pass         CPU s; median of --rounds for rays and bits. Of voxels one round: the march, and sums by its
 *                bits. Weights are found in both, so that is too much by 'bits read' at most
 *   false dark   pairs that see each other by rays and not by voxels, of all pairs with a weight
 *   leaks        pairs that see each other by voxels and not by rays, likewise
 *   relMSE       of E against the pass by rays, as in bench_light.h; ratio: of the means
 * Pairs with a weight face each other, and the shooter shines. Bits are kept of all pairs: 2 bytes for a
 * shooter and a packet of sixteen patches. */
#include "common/clock.h"
#include "common/light/form16.h"
#include "server/solve/patch_solver.h"
#include "server/solve/radiosity/radiosity_pass.h"
#include "tests/bench/bench_light.h"
#include "tests/bench/bench_setup.h"
#include "tests/bench/bench_voxels.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LANES          LW_TRACE_WIDTH
#define ROUNDS_MAX     64
#define DIRECT_SAMPLES 16u

struct settings {
    struct lw_scene_open open;
    int64_t window, coarsest, finest, skip, rounds;
    double lift;
};

enum way { RAYS, WRITTEN, READ, VOXELS, WAYS };

/* A patch solver whose frame is direct light alone; passes follow it. */
struct lab {
    struct lw_patch_solver patch;
    const struct settings *settings;
    const char *label;
    struct lw_shooters shooters;
    struct lw_pair_visibility by_rays, by_voxels;
    uint64_t pairs;     /* with a weight */
    float *light[WAYS]; /* E of each patch, 3 values, in the order of packets */
    double rays_s;
};

struct row {
    const char *name;
    enum way way;
    double build_s, mib, pass_s;
    uint64_t dark, leaks; /* pairs */
};

static double cpu_s(uint64_t since_ns) { return 1e-9 * (double)(lw_clock_process_cpu_ns() - since_ns); }
static double mib(size_t bytes) { return (double)bytes / (1 << 20); }

static bool shines(const struct lw_shooter *s) {
    return s->flux_w[0] > 0 || s->flux_w[1] > 0 || s->flux_w[2] > 0;
}

/* The bits of all pairs that rays would be traced for. */
static void march(struct lab *lab, const struct bench_voxels *voxels) {
    const struct lw_patches *patches = &lab->patch.patches;
    const struct lw_shooters *shooters = &lab->shooters;
#pragma omp parallel for schedule(dynamic, 4) num_threads(lab->patch.threads)
    for (uint32_t p = 0; p < patches->packet_count; p++) {
        const struct lw_patches_packet *packet = &patches->packet[p];
        uint16_t *mask = lab->by_voxels.mask + (size_t)p * shooters->count;
        for (uint32_t k = 0; k < shooters->count; k++) {
            const struct lw_shooter *s = &shooters->shooter[k];
            _Alignas(64) float weight[LANES];
            if (!shines(s)) continue;
            lw_form16_weigh(&packet->at, s->position, s->normal, s->area_m2, 0, weight);
            const uint16_t active = lw_form16_lit(weight) & packet->active;
            if (active) mask[k] = bench_voxels_see(voxels, &packet->at, s->position, s->normal, active);
        }
    }
    memset(lab->by_voxels.known, 1, shooters->count);
}

/* ---- passes ---- */

/* Writes E of each patch; returns CPU s. */
static double pass(struct lab *lab, struct lw_pair_visibility *visibility, float *light) {
    struct lw_patch_solver *p = &lab->patch;
    const uint64_t began_ns = lw_clock_process_cpu_ns();
    const uint64_t rays = lw_radiosity_pass_run(&(struct lw_radiosity_pass){.patches = &p->patches,
                                                                            .shooters = &lab->shooters,
                                                                            .trace = p->geometry.trace,
                                                                            .visibility = visibility,
                                                                            .progress = &p->progress,
                                                                            .threads = p->threads},
                                                p->arrived);
    const double seconds = cpu_s(began_ns);
    if (!visibility) lab->pairs = rays;
    for (uint32_t k = 0; k < p->patches.packet_count; k++)
        for (int i = 0; i < LANES && p->patches.packet[k].active >> i & 1; i++)
            for (int c = 0; c < 3; c++) *light++ = p->arrived[c][p->patches.packet[k].texel[i]];
    return seconds;
}

static void compare(const struct lab *lab, struct row *row) {
    const size_t count = (size_t)lab->by_rays.packets * lab->by_rays.shooters;
    for (size_t i = 0; i < count; i++) {
        const unsigned rays = lab->by_rays.mask[i], voxels = lab->by_voxels.mask[i];
        row->dark += (uint64_t)__builtin_popcount(rays & ~voxels);
        row->leaks += (uint64_t)__builtin_popcount(voxels & ~rays);
    }
}

static void print_row(const struct lab *lab, const struct row *row) {
    const size_t values = 3 * (size_t)lab->patch.patches.count;
    const float *light = lab->light[row->way], *truth = lab->light[RAYS];
    const double percent = 100 / (double)lab->pairs;
    double sum = 0, want = 0;
    for (size_t i = 0; i < values; i++) sum += (double)light[i], want += (double)truth[i];
    printf("| %s | %.3f | %.2f | %.3f | %.3f | %.3f %% | %.3f %% | %.4g | %.4f |\n", row->name, row->build_s,
           row->mib, row->pass_s, row->pass_s / lab->rays_s, percent * (double)row->dark,
           percent * (double)row->leaks, bench_light_relmse(light, truth, values), sum / want);
    fflush(stdout);
}

/* ---- the rows ---- */

static void print_heading(const struct lab *lab) {
    uint64_t seen = 0;
    for (size_t i = 0; i < (size_t)lab->by_rays.packets * lab->by_rays.shooters; i++)
        seen += (uint64_t)__builtin_popcount(lab->by_rays.mask[i]);
    printf("\n### %s\n\n"
           "%u patches, %u shooters, %.4g M pairs with a weight, of which %.1f %% see each other; "
           "skip %d, lift %g\n\n"
           "| way | build, CPU s | MiB | pass, CPU s | / rays | false dark | leaks | relMSE | ratio |\n"
           "|---|---|---|---|---|---|---|---|---|\n",
           lab->label, lab->patch.patches.count, lab->shooters.count, 1e-6 * (double)lab->pairs,
           100 * (double)seen / (double)lab->pairs, (int)lab->settings->skip, lab->settings->lift);
}

static enum lw_status print_rays(struct lab *lab, struct lw_error *err) {
    double seconds[VOXELS][ROUNDS_MAX];
    const size_t rounds = (size_t)lab->settings->rounds;
    struct lw_trace *trace;
    const uint64_t began_ns = lw_clock_process_cpu_ns();
    enum lw_status status = lw_trace_create(lab->patch.desc.scene, &lab->patch.pose, &trace, err);
    if (status != LW_OK) return status;
    const double build_s = cpu_s(began_ns), bits = mib(lw_pair_visibility_bytes(&lab->by_rays));
    struct row row[VOXELS] = {
        {.name = "rays", .way = RAYS, .build_s = build_s, .mib = mib(lw_trace_memory_bytes(trace))},
        {.name = "rays, bits written", .way = WRITTEN, .mib = bits},
        {.name = "bits read", .way = READ, .mib = bits}};
    lw_trace_destroy(trace);
    for (size_t r = 0; r < rounds; r++) {
        lw_pair_visibility_forget(&lab->by_rays);
        for (int w = RAYS; w <= READ; w++)
            seconds[w][r] = pass(lab, w == RAYS ? NULL : &lab->by_rays, lab->light[w]);
    }
    if (!lab->pairs) return lw_status_fail(err, LW_USAGE, "%s reflects no light on anything", lab->label);
    for (int w = RAYS; w <= READ; w++) row[w].pass_s = bench_median(seconds[w], rounds);
    lab->rays_s = row[RAYS].pass_s;
    print_heading(lab);
    for (int w = RAYS; w <= READ; w++) print_row(lab, &row[w]);
    return LW_OK;
}

static enum lw_status print_voxels(struct lab *lab, int32_t side, struct lw_error *err) {
    const struct bench_voxels_desc desc = {side, (int32_t)lab->settings->skip, (float)lab->settings->lift};
    struct bench_voxels voxels;
    char name[32];
    uint64_t began_ns = lw_clock_process_cpu_ns();
    enum lw_status status = bench_voxels_init(&voxels, &desc, lab->patch.desc.scene, &lab->patch.pose, err);
    if (status != LW_OK) return status;
    struct row row = {.name = name,
                      .way = VOXELS,
                      .build_s = cpu_s(began_ns),
                      .mib = mib(voxels.words * sizeof *voxels.solid)};
    snprintf(name, sizeof name, "voxels, %d", side);
    began_ns = lw_clock_process_cpu_ns();
    march(lab, &voxels);
    row.pass_s = cpu_s(began_ns) + pass(lab, &lab->by_voxels, lab->light[VOXELS]);
    compare(lab, &row);
    print_row(lab, &row);
    bench_voxels_finish(&voxels);
    return LW_OK;
}

/* ---- a scene ---- */

static bool surfaces_shoot(const struct lw_patch_solver *p) {
    (void)p;
    return false;
}

static uint64_t no_steps(const struct lw_patch_solver *p) {
    (void)p;
    return 0;
}

static enum lw_status init(struct lw_patch_solver *p, struct lw_error *err) {
    struct lab *lab = (struct lab *)p;
    enum lw_status status =
        lw_shooters_init(&lab->shooters, &p->patches, LW_UNDERSAMPLE_MIP, (uint32_t)lab->settings->window);
    if (status != LW_OK) return lw_status_fail(err, status, "%u texels", p->geometry.texels.count);
    return lw_trace_tints(p->geometry.trace)
               ? lw_status_fail(err, LW_USAGE, "%s has surfaces that tint light: bits cannot hold that",
                                lab->label)
               : LW_OK;
}

static void finish(struct lw_patch_solver *p) {
    struct lab *lab = (struct lab *)p;
    lw_shooters_finish(&lab->shooters);
    lw_pair_visibility_finish(&lab->by_rays);
    lw_pair_visibility_finish(&lab->by_voxels);
    for (int w = 0; w < WAYS; w++) free(lab->light[w]);
}

/* As with --keep-visibility. */
static enum lw_status place(struct lw_patch_solver *p, struct lw_error *err) {
    struct lab *lab = (struct lab *)p;
    lw_patches_place(&p->patches, &p->pose, 0, p->threads);
    lw_shooters_place(&lab->shooters, p->desc.seed, 0);
    enum lw_status status =
        lw_pair_visibility_init(&lab->by_rays, p->patches.packet_count, lab->shooters.count, err);
    if (status == LW_OK)
        status = lw_pair_visibility_init(&lab->by_voxels, p->patches.packet_count, lab->shooters.count, err);
    if (status != LW_OK) return status;
    for (int w = 0; w < WAYS; w++)
        if (!(lab->light[w] = calloc(3ul * p->patches.count + 1, sizeof *lab->light[w])))
            return lw_status_fail(err, LW_NO_MEMORY, "%u patches", p->patches.count);
    return LW_OK;
}

/* What shooters send: what they reflect of direct light. */
static uint64_t charge(struct lw_patch_solver *p) {
    lw_patch_solver_reflect(p, p->frame_direct);
    lw_shooters_charge(&((struct lab *)p)->shooters, p->tiles.radiance[0], 4, p->threads);
    return 0;
}

static size_t no_bytes(const struct lw_patch_solver *p) {
    (void)p;
    return 0;
}

static const struct lw_patch_solver_method method = {.name = "visibility",
                                                     .direct_samples = DIRECT_SAMPLES,
                                                     .frames_min = 1,
                                                     .surfaces_shoot = surfaces_shoot,
                                                     .steps = no_steps,
                                                     .init = init,
                                                     .finish = finish,
                                                     .place = place,
                                                     .bounces = charge,
                                                     .memory_bytes = no_bytes};

static enum lw_status measure(struct lab *lab, struct lw_error *err) {
    const struct settings *s = lab->settings;
    struct lw_solver_stats stats;
    struct lw_solver *solver = &lab->patch.base;
    enum lw_status status = solver->ops->frame(solver, &lab->patch.pose, 1, &stats, err);
    if (status == LW_OK) status = print_rays(lab, err);
    for (int64_t side = s->coarsest; status == LW_OK && side <= s->finest; side *= 2)
        status = print_voxels(lab, (int32_t)side, err);
    return status;
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    const struct settings *s = context;
    struct lw_scene *scene = NULL;
    struct lw_pose pose = {0};
    struct lw_atlas_map map = {0};
    struct lw_solver *solver = NULL;
    struct lab *lab = calloc(1, sizeof *lab);
    char label[64];
    if (!lab) return lw_status_fail(err, LW_NO_MEMORY, "%s", name);
    lab->settings = s;
    lab->label = bench_label(name, label, sizeof label);
    enum lw_status status = bench_open(&s->open, name, BENCH_MOTION_OWN, 0, &scene, &pose, &map, err);
    if (status != LW_OK) {
        free(lab);
    } else {
        struct lw_solver_desc desc = bench_light_desc(scene, &map, -1, 1);
        desc.threads = s->open.threads ? (unsigned)s->open.threads : 1;
        status = lw_patch_solver_create(&lab->patch, &method, &desc, &pose, &solver, err);
    }
    if (status == LW_OK) status = measure(lab, err);
    if (solver) solver->ops->destroy(solver);
    bench_close(scene, &pose, &map);
    return status;
}

static enum lw_status begin(void *context, struct lw_error *err) {
    const struct settings *s = context;
    return s->coarsest > s->finest ? lw_status_fail(err, LW_USAGE, "--coarsest %d is above --finest %d",
                                                    (int)s->coarsest, (int)s->finest)
                                   : LW_OK;
}

int main(int argc, char **argv) {
    struct settings s = {.window = 4, .coarsest = 32, .finest = 512, .skip = 1, .rounds = 1};
    const struct lw_option table[] = {
        {"window", "N", "side of a shooter's window, texels; 1: each by itself (default 4)", LW_OPTION_INT,
         &s.window, 1, LW_TILE_SIDE, NULL},
        {"coarsest", "N", "cells a side of the first grid; each has twice as many as the last (default 32)",
         LW_OPTION_INT, &s.coarsest, 2, BENCH_VOXELS_SIDE_MAX, NULL},
        {"finest", "N", "cells a side of the last grid, at most (default 512)", LW_OPTION_INT, &s.finest, 2,
         BENCH_VOXELS_SIDE_MAX, NULL},
        {"skip", "N", "cells about both ends of a segment that do not count (default 1)", LW_OPTION_INT,
         &s.skip, 0, BENCH_VOXELS_SIDE_MAX, NULL},
        {"lift", "N", "cells by which both ends are raised along their normals (default 0)", LW_OPTION_REAL,
         &s.lift, 0, 16, NULL},
        {"rounds", "N", "passes by rays and by bits, of which the median counts (default 1)", LW_OPTION_INT,
         &s.rounds, 1, ROUNDS_MAX, NULL}};
    return bench_main(&(struct bench_program){.name = "bench_visibility",
                                              .about = "Passes of radiosity by rays, by bits and by voxels, "
                                                       "as tables in Markdown.",
                                              .table = table,
                                              .count = sizeof table / sizeof table[0],
                                              .open = &s.open,
                                              .begin = begin,
                                              .context = &s,
                                              .run = run},
                      argc, argv);
}
