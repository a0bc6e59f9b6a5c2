/* options.h: command lines, by table. One table gives parsing, range checks, --help and its errors.
 * Threads: main() only. */
#ifndef LW_COMMON_BASE_OPTIONS_H
#define LW_COMMON_BASE_OPTIONS_H

#include "common/base/status.h"

#include <stdint.h>

enum lw_option_kind {
    LW_OPTION_FLAG,   /* bool: no argument */
    LW_OPTION_STRING, /* const char *: points into argv */
    LW_OPTION_INT,    /* int64_t within [min, max] */
    LW_OPTION_REAL,   /* double within [min, max], finite; "inf" only if max is INFINITY */
    LW_OPTION_RGB,    /* float[3]: "R,G,B", each within [min, max] */
    LW_OPTION_CHOICE  /* int: index into the '|'-separated list in `argument`, e.g. "real|step" */
};

struct lw_option {
    const char *name;     /* without dashes: "frame-rate"; one letter ("o") is written -o */
    const char *argument; /* as shown in help: "HZ"; NULL for a flag */
    /* One sentence, with a place for the default, such as {} (options_value.h). NULL: for our own programs,
     * so --help and hints leave it out. */
    const char *help;
    enum lw_option_kind kind;
    void *value;     /* has the kind's type; holds the default before parsing */
    double min, max; /* numbers only: min < max; both may be infinite for REAL and RGB */
    bool *given;     /* may be NULL: set when the option occurs */
};

struct lw_options {
    const char *program;  /* "lightwelld" */
    const char *synopsis; /* "SCENE [OPTIONS]" */
    const char *about;    /* a short paragraph: what it does; newlines and the blanks after them stay */
    const struct lw_option *table;
    size_t count;
    const char **positional; /* filled with pointers into argv */
    size_t positional_min, positional_max;
};

/** Parses a command line. Options and positionals may mix. "--" ends options. --name=value and --name value
 * both work.
 * --help and --version print to stdout and set *out_done: the program then ends with exit code 0.
 * Short names take -o VALUE and -oVALUE. An option's last value counts.
 * Errors: LW_USAGE, naming the option and what it accepts; LW_IO where help cannot be written; LW_NO_MEMORY.
 * Values and positionals met before the error are already set. out_positional_count may be NULL. */
LW_MUST_CHECK enum lw_status lw_options_parse(const struct lw_options *options, int argc, char **argv,
                                              size_t *out_positional_count, bool *out_done,
                                              struct lw_error *err);

/** Sets the option of this name to a text, as on a command line; a flag to true or false (also yes, no, on,
 * off, 1, 0). A string points into `text`.
 * Errors: LW_USAGE for an unknown name, with the nearest one, and for a value that the option does not
 * accept. */
LW_MUST_CHECK enum lw_status lw_options_set(const struct lw_options *options, const char *name,
                                            const char *text, struct lw_error *err);

#define LW_OPTIONS_HOST    "127.0.0.1"
#define LW_OPTIONS_PORT    7780
#define LW_OPTIONS_ADDRESS LW_OPTIONS_HOST ":7780"

/** Address of a server: "HOST:PORT", "[v6]:PORT" (brackets removed; port 0 is allowed), "HOST" or
 * "[v6]" at LW_OPTIONS_PORT, "PORT" or ":PORT" at LW_OPTIONS_HOST. Errors: LW_USAGE naming the text.
 * host_size includes the terminator. */
LW_MUST_CHECK enum lw_status lw_options_address(const char *text, char *out_host, size_t host_size,
                                                uint16_t *out_port, struct lw_error *err);

/** The same with another port where the text names none. */
LW_MUST_CHECK enum lw_status lw_options_address_or(const char *text, uint16_t port_default, char *out_host,
                                                   size_t host_size, uint16_t *out_port,
                                                   struct lw_error *err);

#endif
