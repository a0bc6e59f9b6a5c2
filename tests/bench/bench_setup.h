/* bench_setup.h: the frame of this folder's programs: command line, rows of options, scenes, medians.
 * Threads: main() only. */
#ifndef LW_TESTS_BENCH_SETUP_H
#define LW_TESTS_BENCH_SETUP_H

#include "common/open/scene_open.h"
#include "common/scene/pose.h"
#include "common/tile/atlas.h"

/** A program that does the same with each of its operands, mostly SCENEs. */
struct bench_program {
    const char *name, *about;
    const char *operand; /* NULL: "SCENE" */
    const struct lw_option *table;
    size_t count;
    struct lw_scene_open *open; /* its options follow those of the table; NULL: it opens no scene */
    bool runs_once;             /* without an operand: run() has its default, or NULL */
    const char *by_default;
    const char *heading; /* lines printed before the first scene; may be NULL */
    /* where the value of -o is; the folder is made before the first scene, and where that fails the first
     * picture says so. NULL: no such option */
    const char *const *folder;
    void *context;
    enum lw_status (*begin)(void *context, struct lw_error *err); /* before the first scene; may be NULL */
    enum lw_status (*run)(void *context, const char *scene, struct lw_error *err);
};

/** main() of it: parses, begins, runs scene by scene until one fails. */
int bench_main(const struct bench_program *program, int argc, char **argv);

/** bench_main() of an array of options and a function run(), with more fields of struct bench_program. */
#define BENCH_MAIN(argc, argv, rows, ...)                                                                    \
    bench_main(                                                                                              \
        &(struct bench_program){                                                                             \
            .table = rows, .count = sizeof(rows) / sizeof(rows)[0], .run = run, __VA_ARGS__},                \
        argc, argv)

/* Rows of options that several programs have. A default is a literal, for the help. */
/* clang-format off */
#define BENCH_INT(name, help, value, least, most)                                                            \
    {name, "N", help, LW_OPTION_INT, value, least, most, NULL}
#define BENCH_SIZE(settings, width_default, height_default, width_min, height_min)                           \
    BENCH_INT("width", "pixels (default " width_default ")", &(settings)->width, width_min, 16384),          \
    BENCH_INT("height", "pixels (default " height_default ")", &(settings)->height, height_min, 16384)
#define BENCH_BOUNCES(settings, most)                                                                        \
    BENCH_INT("bounces", "indirect bounces (default 2)", &(settings)->bounces, 0, most)
#define BENCH_ROUNDS(settings, most)                                                                         \
    BENCH_INT("rounds", "pictures; the median time of each kind is printed (default 9)",                     \
              &(settings)->rounds, 1, most)
#define BENCH_TIME(settings)                                                                                 \
    {"time", "SECONDS", "of the animation (default 0)", LW_OPTION_REAL, &(settings)->time_s, 0, 1e9, NULL}
#define BENCH_FOLDER(settings)                                                                               \
    {"o", "DIR", "write the pictures there", LW_OPTION_STRING, &(settings)->folder, 0, 0, NULL}
/* clang-format on */

/** The last part of a scene's path, up to '@', behind which some programs take a camera. buffer: of at least
 * 64 bytes. */
const char *bench_label(const char *scene, char *buffer, size_t size);

/** Opens what stands before a '@' in `name`.
 * motion  the movement (enum lw_scene_motion), or BENCH_MOTION_OWN: the scene's own
 * time_s  the pose's moment
 * out_map may be NULL
 * Where it fails, bench_close() frees the rest; give it zeroed structures. */
#define BENCH_MOTION_OWN (-1)
LW_MUST_CHECK enum lw_status bench_open(const struct lw_scene_open *open, const char *name, int motion,
                                        double time_s, struct lw_scene **out_scene, struct lw_pose *out_pose,
                                        struct lw_atlas_map *out_map, struct lw_error *err);

/** map may be NULL. */
void bench_close(struct lw_scene *scene, struct lw_pose *pose, struct lw_atlas_map *map);

/** The median of `count` values, at least 1. It sorts them; of two in the middle it takes the upper one. */
double bench_median(double *value, size_t count);

#endif
