/* options_config.h: options from a file and from the environment, by the same table as the command line.
 * Flow:    defaults < file < environment < command line -> values of the table
 * Threads: one caller at a time per table.
 *
 * The file has lines KEY = VALUE, a key being an option's long name; # and ; begin comments (libinih). The
 * variable of an option "frame-rate" is PREFIX_FRAME_RATE. */
#ifndef LW_COMMON_BASE_OPTIONS_CONFIG_H
#define LW_COMMON_BASE_OPTIONS_CONFIG_H

#include "common/base/options.h"

#define LW_OPTIONS_CONFIG_LINE_MAX 199u /* bytes of a line of the file, as libinih is built */

#define LW_OPTIONS_CONFIG_NAME_MAX 48u /* bytes of a key, with the zero at its end */

/** Sources of a table's values. Strings of file and environment are copied, and live until
 * lw_options_config_finish(). */
struct lw_options_config {
    const char *prefix;         /* "LIGHTWELL" */
    const char *positional;     /* key of the one positional argument: "scene" */
    const char *const *command; /* NULL-terminated: options of the command line alone, "config" among them */
    const char *const *foreign; /* NULL-terminated: keys of variables that are for other programs */
    const char *path;           /* the value of the option "config"; NULL: no file */
    bool check, print;          /* the flags "check-config" and "print-config", for the program to heed */
    char **text;                /* copies */
    size_t text_count, text_capacity;
};

/* clang-format off */
/** Rows of an option table. config: a struct lw_options_config. */
#define LW_OPTIONS_CONFIG(config)                                                                            \
    {"config", "FILE",                                                                                       \
     "read options from this file, one KEY = VALUE a line. The environment (LIGHTWELL_KEY) wins over the "   \
     "file, and the command line over both",                                                                 \
     LW_OPTION_STRING, (void *)&(config)->path, 0, 0, NULL},                                                 \
    {"check-config", NULL, "check all options, and end", LW_OPTION_FLAG, &(config)->check, 0, 0, NULL},      \
    {"print-config", NULL, "print all options and values as a file for --config, and end", LW_OPTION_FLAG,   \
     &(config)->print, 0, 0, NULL}
/* clang-format on */

/** Parses as lw_options_parse() does, with what file and environment say below it. The table holds an option
 * "config" whose value is config->path, and options->positional has room for one.
 * Errors: LW_USAGE naming file, line and key, or the variable, with the nearest key where there is none;
 * LW_NO_INPUT: there is no such file; LW_NO_MEMORY; those of lw_options_parse(). */
LW_MUST_CHECK enum lw_status lw_options_config_parse(struct lw_options_config *config,
                                                     const struct lw_options *options, int argc, char **argv,
                                                     bool *out_done, struct lw_error *err);
void lw_options_config_finish(struct lw_options_config *config);

/** A copy of a text that lives as long: for a value that comes from another table. NULL: out of memory. */
const char *lw_options_config_keep(struct lw_options_config *config, const char *text);

/** Names, one a call, the keys by which two texts of lw_options_config_print() of one table differ.
 * *at: 0 at first. NULL: no more. name: at least LW_OPTIONS_CONFIG_NAME_MAX bytes; returned. */
const char *lw_options_config_difference(const char *before, const char *after, size_t *at, char *name);

/** Writes all options in the form of the file, to be free()d. An option at its default for want of a value is
 * a comment. NULL: out of memory. */
char *lw_options_config_print(const struct lw_options_config *config, const struct lw_options *options);

#endif
