/* measure_options.h: options of both comparisons: scene, motion, pictures, random numbers.
 * Flow:    rows of a command's table, lists -> [measure_options] -> scaling_options, crossover_options
 * Threads: main() only. */
#ifndef LW_CLIENT_MEASURE_MEASURE_OPTIONS_H
#define LW_CLIENT_MEASURE_MEASURE_OPTIONS_H

#include "common/open/scene_open.h"
#include "common/scene/scene_motion.h"

#define LW_MEASURE_OPTIONS_SIDE_MAX    8192u /* pixels */
#define LW_MEASURE_OPTIONS_DENSITY_MIN 0.01  /* times a scene's default */
#define LW_MEASURE_OPTIONS_DENSITY_MAX 100.0
#define LW_MEASURE_OPTIONS_REPEATS_MAX 20u

struct lw_measure_options {
    struct lw_scene_open scene; /* scene.path NULL: there is none */
    const char *folder;         /* -o */
    enum lw_scene_motion motion;
    uint32_t width, height, bounces, seed, repeats, reference_samples;
    double seconds;     /* scene time that is measured */
    const char *solver; /* the server's, by name; NULL: its default */
};

/** Values as the table reads them. Defaults are set before parsing. */
struct lw_measure_options_raw {
    struct lw_measure_options options;
    int motion;
    const char *size;
    int64_t bounces, seed, repeats, reference_samples;
};

/** The digits of a macro that is a number, for a help that says more than its own option's default. */
#define LW_MEASURE_OPTIONS_TEXT(number)   LW_MEASURE_OPTIONS_DIGITS(number)
#define LW_MEASURE_OPTIONS_DIGITS(number) #number

/* Defaults of both commands. */
#define LW_MEASURE_OPTIONS_BOUNCES 2
#define LW_MEASURE_OPTIONS_SEED    1

/** The rows of an option table (common/base/options.h) that fill `raw`, a pointer to the above. Values hold
 * the defaults. */
/* clang-format off */
#define LW_MEASURE_OPTIONS(raw, repeats_help, reference_help, reference_min)                                 \
    {"size", "WxH", "pixels of each view (default {})", LW_OPTION_STRING, &(raw)->size, 0, 0,                \
     NULL},                                                                                                  \
    {"repeats", "N", repeats_help, LW_OPTION_INT, &(raw)->repeats, 1, LW_MEASURE_OPTIONS_REPEATS_MAX, NULL}, \
    {"solver", "NAME", "the server's solver, by a name that lightwelld --help lists (default: its own)",     \
     LW_OPTION_STRING, &(raw)->options.solver, 0, 0, NULL},                                                  \
    {"bounces", "N",                                                                                         \
     "indirect bounces on both sides (default {})",                                                          \
     LW_OPTION_INT, &(raw)->bounces, 0, 16, NULL},                                                           \
    {"reference-samples", "N", reference_help, LW_OPTION_INT, &(raw)->reference_samples, reference_min,      \
     1 << 19, NULL},                                                                                         \
    {"truth-samples", "N", NULL, LW_OPTION_INT, &(raw)->reference_samples, reference_min, 1 << 19, NULL},    \
    {"seed", "N", "of all random numbers (default {})",                                                      \
     LW_OPTION_INT, &(raw)->seed, 0, UINT32_MAX, NULL},                                                      \
    LW_SCENE_OPEN_OPTIONS(&(raw)->options.scene)
/* clang-format on */

/** Checks the values.
 * min_width..      the smallest picture, pixels
 * samples_divisor  reference samples are rounded up to a multiple
 * Errors: LW_USAGE where -o is missing, or --size is out of range: the error has the range. */
LW_MUST_CHECK enum lw_status lw_measure_options_finish(const struct lw_measure_options_raw *raw,
                                                       const char *scene, uint32_t width_min,
                                                       uint32_t height_min, uint32_t samples_divisor,
                                                       struct lw_measure_options *out, struct lw_error *err);

/** Limits of a list of numbers, apart by commas. */
struct lw_measure_options_list {
    const char *option; /* "--users" */
    double min, max;
    bool grows; /* each number is more than the one before */
    uint32_t count_max;
};

/** Read one number at least: whole ones, or any. Errors: LW_USAGE, naming the option and the number. */
LW_MUST_CHECK enum lw_status lw_measure_options_read_counts(const struct lw_measure_options_list *list,
                                                            const char *text, uint32_t *out_value,
                                                            uint32_t *out_count, struct lw_error *err);
LW_MUST_CHECK enum lw_status lw_measure_options_read_numbers(const struct lw_measure_options_list *list,
                                                             const char *text, double *out_value,
                                                             uint32_t *out_count, struct lw_error *err);

#endif
