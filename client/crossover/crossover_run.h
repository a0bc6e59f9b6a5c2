/* crossover_run.h: a row of the crossover under way: its scene, views and references, and the units that are
 * measured.
 * Flow:    options -> scene, references -> [crossover_run: unit by unit, renderers interleaved] ->
 *          crossover_store
 * Threads: main() only.
 *
 * Frames are of 1/30 s of scene time, on both sides, whatever the machine manages. Path renderers go through
 * the frames that their histories need, a user at a time. The cache is one server with twelve clients, one a
 * view, from frame 1 on; after the judged frames all but one of them leave, and that one looks at some of the
 * views alone. */
#ifndef LW_CLIENT_CROSSOVER_CROSSOVER_RUN_H
#define LW_CLIENT_CROSSOVER_CROSSOVER_RUN_H

#include "client/crossover/crossover_references.h"
#include "client/measure/fixed_views.h"
#include "client/measure/scene_densities.h"

#include <signal.h>

struct lw_crossover_run {
    const struct lw_crossover_options *options;
    const volatile sig_atomic_t *cancel;
    struct lw_crossover_store store;
    struct lw_scene_densities densities;
    char content[33]; /* the hash of its first package, in hexadecimal digits */
    double build_cpu_s[LW_CROSSOVER_DENSITIES_MAX + 1]; /* of packages as they were made, in their order */
    struct lw_fixed_views views;
    struct lw_crossover_references references;
    uint32_t judged[LW_CROSSOVER_JUDGED_MAX], judged_count;
    uint32_t window; /* the first frame whose cost counts */
    uint64_t end_ns; /* of lw_clock_ns(): no unit begins later; UINT64_MAX: no limit */
    uint32_t units_missing;
};

/** Opens the scene and what an earlier run has left, traces what references are missing, measures what units
 * are. A unit that fails is entered as such, and the next one begins. Finish it in any case.
 * Errors: LW_USAGE where the folder holds another row, naming what differs: an option, the scene's content,
 * the version; LW_CLOSED if cancelled; LW_TIMED_OUT if time was up before all was measured; those of
 * opening and of disks. */
LW_MUST_CHECK enum lw_status lw_crossover_run(struct lw_crossover_run *run,
                                              const struct lw_crossover_options *options, const char *command,
                                              const volatile sig_atomic_t *cancel, struct lw_error *err);
void lw_crossover_run_finish(struct lw_crossover_run *run);

/* ---- for crossover_unit.c ---- */

/** Where a view's camera is; context: the run's views. */
struct lw_camera_view lw_crossover_run_camera(const void *context, uint32_t user, uint64_t frame);
/** The package at a density, made when it is first asked for. Errors: lw_scene_densities_find()'s. */
LW_MUST_CHECK enum lw_status lw_crossover_run_package(struct lw_crossover_run *run, double density,
                                                      const char **out_path, struct lw_error *err);
/** CPU seconds that making it took, import included; NAN: it was not made. */
double lw_crossover_run_build_cpu_s(const struct lw_crossover_run *run, double density);

/** What was kept of a unit's pictures. */
void lw_crossover_run_picture_path(const char *folder, const char *kind, const struct lw_crossover_unit *unit,
                                   const char *ending, char *out, size_t size);

#endif
