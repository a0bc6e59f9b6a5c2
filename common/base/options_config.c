#include "common/base/options_config.h"

#include "common/base/options_value.h"

#include <ctype.h>
#include <errno.h>
#include <ini.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define NAME_MAX_LENGTH LW_OPTIONS_CONFIG_NAME_MAX

/* ---- what lasts ---- */

static char *keep_text(struct lw_options_config *config, const char *text) {
    if (config->text_count == config->text_capacity) {
        const size_t capacity = config->text_capacity ? 2 * config->text_capacity : 16;
        char **grown = realloc(config->text, capacity * sizeof *grown);
        if (!grown) return NULL;
        config->text = grown;
        config->text_capacity = capacity;
    }
    char *copy = strdup(text);
    if (copy) config->text[config->text_count++] = copy;
    return copy;
}

const char *lw_options_config_keep(struct lw_options_config *config, const char *text) {
    return keep_text(config, text);
}

void lw_options_config_finish(struct lw_options_config *config) {
    for (size_t i = 0; i < config->text_count; i++) free(config->text[i]);
    free(config->text);
    config->text = NULL;
    config->text_count = config->text_capacity = 0;
}

static bool is_listed(const char *const *names, const char *name) {
    for (; *names; names++)
        if (strcmp(*names, name) == 0) return true;
    return false;
}

static enum lw_status set(struct lw_options_config *config, const struct lw_options *options,
                          const char *name, const char *text, struct lw_error *err) {
    const char *copy = keep_text(config, text);
    if (!copy) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    if (strcmp(name, config->positional) == 0) {
        options->positional[0] = copy;
        return LW_OK;
    }
    if (is_listed(config->command, name))
        return lw_status_fail(err, LW_USAGE, "\"%s\" is for the command line alone", name);
    return lw_options_set(options, name, copy, err);
}

/* ---- the file ---- */

struct reading {
    struct lw_options_config *config;
    const struct lw_options *options;
    struct lw_error err; /* the first one */
    char seen[128][NAME_MAX_LENGTH];
    size_t seen_count;
};

static bool was_seen(struct reading *r, const char *name) {
    for (size_t i = 0; i < r->seen_count; i++)
        if (strncmp(r->seen[i], name, NAME_MAX_LENGTH - 1) == 0) return true;
    if (r->seen_count < sizeof r->seen / sizeof *r->seen)
        snprintf(r->seen[r->seen_count++], NAME_MAX_LENGTH, "%s", name);
    return false;
}

/* Returns 0 for an error: libinih then tells the line of the first one. */
static int on_key(void *context, const char *section, const char *name, const char *value) {
    struct reading *r = context;
    if (r->err.status != LW_OK) return 0;
    if (*section)
        lw_status_fail(&r->err, LW_USAGE, "there are no sections: [%.60s]", section);
    else if (was_seen(r, name)) /* also a line that begins with a blank, which goes on with a value */
        lw_status_fail(&r->err, LW_USAGE, "\"%.60s\" twice; a line begins with its key", name);
    else
        (void)!set(r->config, r->options, name, value, &r->err);
    return r->err.status == LW_OK;
}

static enum lw_status read_file(struct lw_options_config *config, const struct lw_options *options,
                                struct lw_error *err) {
    struct reading *r = calloc(1, sizeof *r);
    if (!r) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    *r = (struct reading){.config = config, .options = options};
    FILE *file = fopen(config->path, "re");
    const int line = file ? ini_parse_file(file, on_key, r) : 0;
    enum lw_status status = LW_OK;
    if (!file)
        status = lw_status_fail(err, LW_NO_INPUT, "%s: %s", config->path, strerror(errno));
    else if (line < 0 || ferror(file))
        status = lw_status_fail(err, LW_IO, "%s: cannot be read", config->path);
    else if (r->err.status == LW_NO_MEMORY)
        status = lw_status_fail(err, LW_NO_MEMORY, "%s: %s", config->path, r->err.text);
    else if (line > 0)
        status = lw_status_fail(err, LW_USAGE, "%s:%d: %s", config->path, line,
                                *r->err.text ? r->err.text : "no line of the form KEY = VALUE, or too long");
    if (file) fclose(file);
    free(r);
    return status;
}

/* ---- the environment ---- */

/* PREFIX_FRAME_RATE -> frame-rate; false: it is not of the prefix, or too long. */
static bool key_of(const char *prefix, const char *variable, char out[NAME_MAX_LENGTH]) {
    const size_t prefix_length = strlen(prefix), length = strcspn(variable, "=");
    if (strncmp(variable, prefix, prefix_length) != 0 || variable[prefix_length] != '_') return false;
    size_t at = 0;
    for (size_t i = prefix_length + 1; i < length; i++) {
        if (at + 1 >= NAME_MAX_LENGTH) return false;
        out[at++] = variable[i] == '_' ? '-' : (char)tolower((unsigned char)variable[i]);
    }
    out[at] = '\0';
    return at > 0;
}

static enum lw_status read_environment(struct lw_options_config *config, const struct lw_options *options,
                                       struct lw_error *err) {
    char name[NAME_MAX_LENGTH];
    for (char **variable = environ; variable && *variable; variable++) {
        if (!key_of(config->prefix, *variable, name)) continue;
        const char *value = strchr(*variable, '=');
        if (!value || strcmp(name, "config") == 0 || is_listed(config->foreign, name)) continue;
        const enum lw_status status = set(config, options, name, value + 1, err);
        if (status == LW_OK) continue;
        lw_status_context(err, "environment: %.*s", (int)(value - *variable), *variable);
        return status;
    }
    return LW_OK;
}

/* ---- all of them ---- */

enum lw_status lw_options_config_parse(struct lw_options_config *config, const struct lw_options *options,
                                       int argc, char **argv, bool *out_done, struct lw_error *err) {
    char variable[NAME_MAX_LENGTH];
    struct lw_options any = *options;
    any.positional_min = 0;
    snprintf(variable, sizeof variable, "%s_CONFIG", config->prefix);
    config->path = getenv(variable);
    /* twice: to know the file, and to have the last word */
    enum lw_status status = lw_options_parse(&any, argc, argv, NULL, out_done, err);
    if (status != LW_OK || *out_done) return status;
    if (config->path && (status = read_file(config, options, err)) != LW_OK) return status;
    if ((status = read_environment(config, options, err)) != LW_OK) return status;
    if ((status = lw_options_parse(&any, argc, argv, NULL, out_done, err)) != LW_OK) return status;
    if (options->positional_min && !options->positional[0])
        return lw_status_fail(err, LW_USAGE, "too few arguments; usage: %s %s (--help says more)",
                              options->program, options->synopsis);
    return LW_OK;
}

/* ---- the other way ---- */

static bool in_range(const struct lw_option *o, double value) { return value >= o->min && value <= o->max; }

static void print_option(FILE *stream, const struct lw_option *o) {
    const double real = o->kind == LW_OPTION_REAL  ? *(const double *)o->value
                        : o->kind == LW_OPTION_INT ? (double)*(const int64_t *)o->value
                                                   : 0;
    const bool number = o->kind == LW_OPTION_REAL || o->kind == LW_OPTION_INT;
    const bool unset = (o->given && !*o->given) || (number && !in_range(o, real)) ||
                       (o->kind == LW_OPTION_STRING && !*(const char *const *)o->value);
    fprintf(stream, "%s%s =", unset ? "# " : "", o->name);
    if (unset) {
        fputs(o->kind == LW_OPTION_FLAG ? " false\n" : "\n", stream);
        return;
    }
    fputc(' ', stream);
    lw_options_value_write(o, stream);
    fputc('\n', stream);
}

char *lw_options_config_print(const struct lw_options_config *config, const struct lw_options *options) {
    char *text = NULL;
    size_t size = 0;
    FILE *stream = open_memstream(&text, &size);
    if (!stream) return NULL;
    if (options->positional[0]) fprintf(stream, "%s = %s\n", config->positional, options->positional[0]);
    for (size_t i = 0; i < options->count; i++) {
        const struct lw_option *o = &options->table[i];
        if (o->help && o->name[1] && !is_listed(config->command, o->name)) print_option(stream, o);
    }
    const bool failed = ferror(stream);
    if (fclose(stream) == 0 && !failed) return text;
    free(text);
    return NULL;
}

/* ---- two of them ---- */

/* The text's line of that number, and its length; NULL: there is none. */
static const char *line_of(const char *text, size_t number, size_t *out_length) {
    while (number-- > 0) {
        text = strchr(text, '\n');
        if (!text) return NULL;
        text++;
    }
    *out_length = strcspn(text, "\n");
    return *text ? text : NULL;
}

const char *lw_options_config_difference(const char *before, const char *after, size_t *at, char *name) {
    size_t before_length, after_length;
    for (;;) {
        const char *a = line_of(before, *at, &before_length), *b = line_of(after, *at, &after_length);
        if (!a || !b) return NULL;
        ++*at;
        if (before_length == after_length && memcmp(a, b, before_length) == 0) continue;
        if (strncmp(b, "# ", 2) == 0) b += 2;
        const size_t length = strcspn(b, " \n");
        snprintf(name, NAME_MAX_LENGTH, "%.*s", (int)length, b);
        return name;
    }
}
