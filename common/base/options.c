#include "common/base/options.h"

#include "common/base/options_manual.h"
#include "common/base/options_range.h"
#include "common/base/options_value.h"

#include <assert.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#define HELP_COLUMNS_UNKNOWN 80u
#define HELP_COLUMNS_MIN     60u
#define HELP_COLUMNS_MAX     100u
#define HELP_INDENT_MAX      30u /* an option wider than this gets a line of its own */
#define NAME_LENGTH_MAX      48u /* longer words are not looked up for a suggestion */

/* ---- what an option accepts, as text
 * -------------------------------------------------------------------------- */

static void write_accepted(char *out, size_t out_size, const struct lw_option *o) {
    char range[96];
    lw_options_range_write(o, range, sizeof range);
    switch (o->kind) {
    case LW_OPTION_FLAG:
        snprintf(out, out_size, "nothing");
        break;
    case LW_OPTION_STRING:
        snprintf(out, out_size, "%s", o->argument);
        break;
    case LW_OPTION_INT:
        snprintf(out, out_size, "a whole number %s", range);
        break;
    case LW_OPTION_REAL:
        snprintf(out, out_size, "a number %s%s", range, isinf(o->max) ? ", or inf" : "");
        break;
    case LW_OPTION_RGB:
        snprintf(out, out_size, "three numbers R,G,B, each %s", range);
        break;
    case LW_OPTION_CHOICE:
        snprintf(out, out_size, "one of %s", o->argument);
        break;
    }
}

static const char *dashes(const char *name) { return name[1] ? "--" : "-"; }

static enum lw_status fail_value(const struct lw_option *o, const char *text, struct lw_error *err) {
    char accepted[256];
    write_accepted(accepted, sizeof accepted, o);
    return lw_status_fail(err, LW_USAGE, "%s%s: \"%.100s\" is not %s", dashes(o->name), o->name, text,
                          accepted);
}

/* ---- values
 * --------------------------------------------------------------------------------------------------- */

/* Decimal digits with an optional sign; nothing before or after, no overflow. */
static bool parse_int(const char *text, int64_t *out) {
    const char *digits = text + (*text == '-' || *text == '+');
    if (!*digits || digits[strspn(digits, "0123456789")]) return false;
    errno = 0;
    long long value = strtoll(text, NULL, 10);
    if (errno) return false;
    *out = value;
    return true;
}

/* A finite decimal number: strtod's blanks, hexadecimals, "nan" and "infinity" are refused. */
static bool parse_real(const char *text, size_t length, double *out) {
    char copy[64];
    if (!length || length >= sizeof copy) return false;
    memcpy(copy, text, length);
    copy[length] = 0;
    if (copy[strspn(copy, "0123456789+-.eE")]) return false;
    char *end;
    double value = strtod(copy, &end);
    if (*end || end == copy || !isfinite(value)) return false;
    *out = value;
    return true;
}

static bool parse_rgb(const struct lw_option *o, const char *text, float out[3]) {
    for (int i = 0; i < 3; i++) {
        size_t length = strcspn(text, ",");
        double value;
        if (!parse_real(text, length, &value) || value < o->min || value > o->max || !isfinite((float)value))
            return false;
        out[i] = (float)value;
        text += length;
        if (i < 2 && *text++ != ',') return false;
    }
    return !*text;
}

static bool parse_choice(const char *choices, const char *text, int *out) {
    size_t text_length = strlen(text);
    for (int i = 0;; i++) {
        size_t length = strcspn(choices, "|");
        if (length == text_length && !memcmp(choices, text, length)) {
            *out = i;
            return true;
        }
        if (!choices[length]) return false;
        choices += length + 1;
    }
}

static enum lw_status set_value(const struct lw_option *o, const char *text, struct lw_error *err) {
    bool good = false;
    switch (o->kind) {
    case LW_OPTION_FLAG:
        break; /* the caller sets flags: they have no text */
    case LW_OPTION_STRING:
        *(const char **)o->value = text;
        good = true;
        break;
    case LW_OPTION_INT: {
        int64_t value;
        good = parse_int(text, &value) && value >= lw_options_range_bound(o->min) &&
               value <= lw_options_range_bound(o->max);
        if (good) *(int64_t *)o->value = value;
        break;
    }
    case LW_OPTION_REAL: {
        double value;
        if (isinf(o->max) && !strcmp(text, "inf")) {
            *(double *)o->value = (double)INFINITY;
            good = true;
            break;
        }
        good = parse_real(text, strlen(text), &value) && value >= o->min && value <= o->max;
        if (good) *(double *)o->value = value;
        break;
    }
    case LW_OPTION_RGB: {
        float value[3];
        good = parse_rgb(o, text, value);
        if (good) memcpy(o->value, value, sizeof value);
        break;
    }
    case LW_OPTION_CHOICE:
        good = parse_choice(o->argument, text, o->value);
        break;
    }
    if (!good) return fail_value(o, text, err);
    if (o->given) *o->given = true;
    return LW_OK;
}

/* ---- unknown options: suggest the nearest
 * --------------------------------------------------------------------- */

/* Edits between two words, a swap of neighbours counting as one (optimal string alignment). */
static unsigned edit_distance(const char *a, const char *b) {
    size_t a_length = strlen(a), b_length = strlen(b);
    if (a_length > NAME_LENGTH_MAX || b_length > NAME_LENGTH_MAX) return UINT32_MAX;
    unsigned row[3][NAME_LENGTH_MAX + 1]; /* rows i - 2, i - 1, i in turn */
    for (size_t j = 0; j <= b_length; j++) row[0][j] = (unsigned)j;
    for (size_t i = 1; i <= a_length; i++) {
        unsigned *now = row[i % 3], *before = row[(i + 2) % 3], *earlier = row[(i + 1) % 3];
        now[0] = (unsigned)i;
        for (size_t j = 1; j <= b_length; j++) {
            unsigned best = before[j - 1] + (a[i - 1] != b[j - 1]);
            if (before[j] + 1 < best) best = before[j] + 1;
            if (now[j - 1] + 1 < best) best = now[j - 1] + 1;
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] && earlier[j - 2] + 1 < best)
                best = earlier[j - 2] + 1;
            now[j] = best;
        }
    }
    return row[a_length % 3][b_length];
}

/* own: --help and --version are names, too. */
static const char *nearest_name(const struct lw_options *options, const char *word, bool own) {
    unsigned limit = 1 + (unsigned)strlen(word) / 3, best_distance = limit + 1;
    const char *best = NULL;
    for (size_t i = 0; i < options->count + (own ? 2 : 0); i++) {
        if (i < options->count && !options->table[i].help) continue;
        const char *name = i < options->count    ? options->table[i].name
                           : i == options->count ? "help"
                                                 : "version";
        if (!name[1]) continue; /* any letter is near another */
        unsigned distance = edit_distance(word, name);
        /* the beginning of a name is as good as one slip */
        if (strlen(word) >= 3 && !strncmp(word, name, strlen(word)) && distance > 1) distance = 1;
        if (distance < best_distance) best = name, best_distance = distance;
    }
    return best;
}

static enum lw_status fail_unknown(const struct lw_options *options, const char *argument, size_t name_length,
                                   struct lw_error *err) {
    char word[NAME_LENGTH_MAX + 2];
    size_t skip = strspn(argument, "-");
    snprintf(word, sizeof word, "%.*s", (int)(name_length > skip ? name_length - skip : 0), argument + skip);
    const char *near = nearest_name(options, word, true);
    if (near)
        return lw_status_fail(err, LW_USAGE, "unknown option %.*s; did you mean --%s?", (int)name_length,
                              argument, near);
    return lw_status_fail(err, LW_USAGE, "unknown option %.*s; --help lists the options", (int)name_length,
                          argument);
}

/* ---- help
 * ----------------------------------------------------------------------------------------------------- */

static unsigned help_columns(void) {
    struct winsize size;
    unsigned columns = HELP_COLUMNS_UNKNOWN;
    if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col) columns = size.ws_col;
    if (columns < HELP_COLUMNS_MIN) return HELP_COLUMNS_MIN;
    return columns > HELP_COLUMNS_MAX ? HELP_COLUMNS_MAX : columns;
}

/* Prints words from column `at` on, breaking lines before `columns`; further lines start at `indent`. A
 * newline in the text stays, and so do the blanks after it (they indent the whole of their line: examples).
 */
static void print_wrapped(const char *text, unsigned at, unsigned indent, unsigned columns) {
    unsigned margin = indent;
    bool line_is_empty = true;
    while (*text) {
        size_t blanks = strspn(text, " ");
        text += blanks;
        if (*text == '\n') {
            putchar('\n');
            text++;
            margin = indent + (unsigned)strspn(text, " ");
            text += margin - indent;
            if (*text && *text != '\n') printf("%*s", (int)margin, "");
            at = margin;
            line_is_empty = true;
            continue;
        }
        size_t word = strcspn(text, " \n");
        if (!line_is_empty && at + 1 + word > columns) {
            printf("\n%*s", (int)margin, "");
            at = margin;
            line_is_empty = true;
        }
        if (!line_is_empty) putchar(' '), at++;
        printf("%.*s", (int)word, text);
        at += (unsigned)word;
        line_is_empty = word == 0;
        text += word;
    }
    putchar('\n');
}

static unsigned heading_length(const struct lw_option *o) {
    return (unsigned)(strlen("  ") + strlen(dashes(o->name)) + strlen(o->name) +
                      (o->argument ? 1 + strlen(o->argument) : 0));
}

static void print_option(const struct lw_option *o, unsigned indent, unsigned columns) {
    printf("  %s%s%s%s", dashes(o->name), o->name, o->argument ? " " : "", o->argument ? o->argument : "");
    unsigned at = heading_length(o);
    if (at + 2 > indent)
        printf("\n%*s", (int)indent, "");
    else
        printf("%*s", (int)(indent - at), "");
    char text[1024], range[96];
    bool number = o->kind == LW_OPTION_INT || o->kind == LW_OPTION_REAL || o->kind == LW_OPTION_RGB;
    lw_options_range_help(o, range, sizeof range);
    if (number)
        snprintf(text, sizeof text, "%s [%s]", o->help, range);
    else
        snprintf(text, sizeof text, "%s", o->help);
    print_wrapped(text, indent, indent, columns);
}

static void print_help(const struct lw_options *options) {
    static const struct lw_option own[] = {
        {.name = "help", .help = "print these options and end", .kind = LW_OPTION_FLAG},
        {.name = "version", .help = "print the version and end", .kind = LW_OPTION_FLAG}};
    unsigned columns = help_columns(), indent = 0;
    for (size_t i = 0; i < options->count; i++) {
        unsigned length = options->table[i].help ? heading_length(&options->table[i]) + 2 : 0;
        if (length > indent && length <= HELP_INDENT_MAX) indent = length;
    }
    if (indent < heading_length(&own[1]) + 2) indent = heading_length(&own[1]) + 2;
    printf("Usage: %s %s\n\n", options->program, options->synopsis);
    if (options->about) {
        print_wrapped(options->about, 0, 0, columns);
        putchar('\n');
    }
    printf("Options:\n");
    for (size_t i = 0; i < options->count; i++)
        if (options->table[i].help) print_option(&options->table[i], indent, columns);
    for (size_t i = 0; i < 2; i++) print_option(&own[i], indent, columns);
}

/* ---- the command line
 * ----------------------------------------------------------------------------------------- */

static const struct lw_option *find_option(const struct lw_options *options, const char *name,
                                           size_t length) {
    for (size_t i = 0; i < options->count; i++)
        if (strlen(options->table[i].name) == length && !memcmp(options->table[i].name, name, length))
            return &options->table[i];
    return NULL;
}

static bool parse_bool(const char *text, bool *out) {
    static const char *const words[] = {"true", "false", "yes", "no", "on", "off", "1", "0"};
    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        if (strcmp(text, words[i]) == 0) {
            *out = i % 2 == 0;
            return true;
        }
    return false;
}

enum lw_status lw_options_set(const struct lw_options *options, const char *name, const char *text,
                              struct lw_error *err) {
    const struct lw_option *o = find_option(options, name, strlen(name));
    if (!o) {
        const char *near = nearest_name(options, name, false);
        if (near)
            return lw_status_fail(err, LW_USAGE, "unknown key \"%.100s\"; did you mean \"%s\"?", name, near);
        return lw_status_fail(err, LW_USAGE, "unknown key \"%.100s\"; --help lists the options", name);
    }
    if (o->kind != LW_OPTION_FLAG) return set_value(o, text, err);
    bool value;
    if (!parse_bool(text, &value))
        return lw_status_fail(err, LW_USAGE, "--%s: \"%.100s\" is neither true nor false", o->name, text);
    *(bool *)o->value = value;
    if (o->given) *o->given = value;
    return LW_OK;
}

/* Is this argument, as it stands, one of our options? Then it is no value that somebody meant. */
static bool is_option(const struct lw_options *options, const char *argument) {
    size_t length = strcspn(argument, "=");
    return length > 3 && !strncmp(argument, "--", 2) && find_option(options, argument + 2, length - 2);
}

static void print_version(const struct lw_options *options) {
    printf("%s " LW_VERSION "\n", options->program);
}

/* Options that print and end the program. The manual is for our own build. */
static const struct {
    const char *option;
    void (*print)(const struct lw_options *options);
} prints[] = {{"--help", print_help},
              {"-h", print_help},
              {"--version", print_version},
              {"--help=man", lw_options_manual_page},
              {"--help=bash", lw_options_manual_bash}};

static enum lw_status print_and_check(const struct lw_options *options,
                                      void (*print)(const struct lw_options *), struct lw_error *err) {
    print(options);
    if (fflush(stdout) || ferror(stdout))
        return lw_status_fail(err, LW_IO, "cannot write to standard output: %s", strerror(errno));
    return LW_OK;
}

static bool is_to_print(int argc, char **argv) {
    for (int i = 1; i < argc; i++)
        for (size_t p = 0; p < sizeof prints / sizeof *prints; p++)
            if (!strcmp(argv[i], prints[p].option)) return true;
    return false;
}

/* Takes the option at argv[*index], and its value if that is the next argument. shown: what --help prints. */
static enum lw_status take_option(const struct lw_options *options, const struct lw_options *shown, int argc,
                                  char **argv, int *index, bool *out_done, struct lw_error *err) {
    const char *argument = argv[*index], *value = NULL;
    bool is_long = argument[1] == '-';
    const char *name = argument + (is_long ? 2 : 1);
    size_t length = is_long ? strcspn(name, "=") : 1;
    const struct lw_option *o = find_option(options, name, length);
    if (is_long && length == 1) o = NULL; /* "--o" */
    if (!o) {
        for (size_t i = 0; i < sizeof prints / sizeof *prints; i++)
            if (!strcmp(argument, prints[i].option)) {
                *out_done = true;
                return print_and_check(shown, prints[i].print, err);
            }
        if (!strncmp(argument, "--help=", 7) || !strncmp(argument, "--version=", 10))
            return lw_status_fail(err, LW_USAGE, "%.*s takes no value", (int)strcspn(argument, "="),
                                  argument);
        return fail_unknown(options, argument, strcspn(argument, "="), err);
    }
    if (name[length]) value = name + length + (is_long ? 1 : 0); /* --name=value, -oFILE */
    if (o->kind == LW_OPTION_FLAG) {
        if (value) return lw_status_fail(err, LW_USAGE, "%s%s takes no value", dashes(o->name), o->name);
        *(bool *)o->value = true;
        if (o->given) *o->given = true;
        return LW_OK;
    }
    if (!value) {
        if (*index + 1 >= argc || is_option(options, argv[*index + 1])) {
            char accepted[256];
            write_accepted(accepted, sizeof accepted, o);
            return lw_status_fail(err, LW_USAGE, "%s%s needs a value: %s", dashes(o->name), o->name,
                                  accepted);
        }
        value = argv[++*index];
    }
    return set_value(o, value, err);
}

static void check_table(const struct lw_options *options) {
    for (size_t i = 0; i < options->count; i++) {
        const struct lw_option *o = &options->table[i];
        assert((o->kind == LW_OPTION_FLAG) == !o->argument);
        assert(o->min < o->max || o->kind == LW_OPTION_FLAG || o->kind == LW_OPTION_STRING ||
               o->kind == LW_OPTION_CHOICE);
        (void)o;
    }
}

static enum lw_status take_all(const struct lw_options *options, const struct lw_options *shown, int argc,
                               char **argv, size_t *out_positional_count, bool *out_done,
                               struct lw_error *err) {
    size_t positional_count = 0;
    bool options_ended = false;
    for (int i = 1; i < argc; i++) {
        if (!options_ended && !strcmp(argv[i], "--")) {
            options_ended = true;
        } else if (options_ended || argv[i][0] != '-' || !argv[i][1]) { /* "-" alone is no option */
            if (positional_count == options->positional_max)
                return lw_status_fail(err, LW_USAGE, "unexpected argument \"%.100s\"; usage: %s %s", argv[i],
                                      options->program, options->synopsis);
            options->positional[positional_count++] = argv[i];
        } else {
            enum lw_status status = take_option(options, shown, argc, argv, &i, out_done, err);
            if (status || *out_done) return status;
        }
    }
    if (positional_count < options->positional_min)
        return lw_status_fail(err, LW_USAGE, "too few arguments; usage: %s %s (--help says more)",
                              options->program, options->synopsis);
    if (out_positional_count) *out_positional_count = positional_count;
    return LW_OK;
}

enum lw_status lw_options_parse(const struct lw_options *options, int argc, char **argv,
                                size_t *out_positional_count, bool *out_done, struct lw_error *err) {
    struct lw_options shown = *options;
    struct lw_option *filled = NULL;
    check_table(options);
    *out_done = false;
    if (is_to_print(argc, argv)) { /* before the first value is set: help says the defaults */
        if (!(filled = lw_options_value_fill(options->table, options->count)))
            return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
        shown.table = filled;
    }
    const enum lw_status status = take_all(options, &shown, argc, argv, out_positional_count, out_done, err);
    lw_options_value_free(filled, options->count);
    return status;
}

/* Digits alone are a port, text without a port a host. */
enum lw_status lw_options_address(const char *text, char *out_host, size_t host_size, uint16_t *out_port,
                                  struct lw_error *err) {
    return lw_options_address_or(text, LW_OPTIONS_PORT, out_host, host_size, out_port, err);
}

enum lw_status lw_options_address_or(const char *text, uint16_t port_default, char *out_host,
                                     size_t host_size, uint16_t *out_port, struct lw_error *err) {
    const char *colon = strrchr(text, ':'), *bracket = strrchr(text, ']'), *host = text, *port = NULL;
    size_t host_length = strlen(text);
    if (colon && (!bracket || colon > bracket)) {
        port = colon + 1;
        host_length = (size_t)(colon - text);
        if (!host_length && *port) { /* on this machine, as PORT alone */
            host = LW_OPTIONS_HOST;
            host_length = strlen(host);
        }
    } else if (host_length && !text[strspn(text, "0123456789")]) {
        port = text;
        host = LW_OPTIONS_HOST;
        host_length = strlen(host);
    }
    if (host[0] == '[' && host_length >= 2 && host[host_length - 1] == ']') {
        host++;
        host_length -= 2;
    } else if (memchr(host, ':', host_length)) {
        return lw_status_fail(
            err, LW_USAGE, "address \"%.200s\": write an IPv6 address in brackets, e.g. [::1] or [::1]:7780",
            text);
    }
    if (!host_length || memchr(host, '[', host_length) || memchr(host, ']', host_length))
        return lw_status_fail(err, LW_USAGE,
                              "address \"%.200s\" is not HOST:PORT, HOST, PORT or :PORT, e.g. 127.0.0.1:7780",
                              text);
    int64_t number = port_default;
    if (port && (*port == '+' || *port == '-' || !parse_int(port, &number) || number > UINT16_MAX))
        return lw_status_fail(err, LW_USAGE, "address \"%.200s\": the port is a whole number from 0 to 65535",
                              text);
    if (host_length >= host_size)
        return lw_status_fail(err, LW_USAGE,
                              "address \"%.60s...\": the host name is longer than %zu characters", text,
                              host_size - 1);
    memcpy(out_host, host, host_length);
    out_host[host_length] = 0;
    *out_port = (uint16_t)number;
    return LW_OK;
}
