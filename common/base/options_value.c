#include "common/base/options_value.h"

#include <assert.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

static void write_real(FILE *stream, double value) {
    char text[40];
    const bool single = value == (double)(float)value; /* it came from a float, or is one all the same */
    for (int digits = 6; digits <= 17; digits++) {     /* as short as it is exact */
        snprintf(text, sizeof text, "%.*g", digits, value);
        const double back = strtod(text, NULL);
        if (single ? (float)back == (float)value : back == value) break;
    }
    fputs(text, stream);
}

/* The word of a choice or a text, and its length. */
static const char *word_of(const struct lw_option *o, size_t *out_length) {
    if (o->kind == LW_OPTION_STRING) {
        const char *text = *(const char *const *)o->value;
        *out_length = text ? strlen(text) : 0;
        return text ? text : "";
    }
    assert(o->kind == LW_OPTION_CHOICE);
    const char *choice = o->argument;
    for (int i = *(const int *)o->value; i > 0; i--) choice += strcspn(choice, "|") + 1;
    *out_length = strcspn(choice, "|");
    return choice;
}

void lw_options_value_write(const struct lw_option *o, FILE *stream) {
    size_t length;
    const char *word;
    switch (o->kind) {
    case LW_OPTION_FLAG:
        fputs(*(const bool *)o->value ? "true" : "false", stream);
        break;
    case LW_OPTION_INT:
        fprintf(stream, "%" PRId64, *(const int64_t *)o->value);
        break;
    case LW_OPTION_REAL:
        write_real(stream, *(const double *)o->value);
        break;
    case LW_OPTION_RGB:
        for (int c = 0; c < 3; c++) {
            if (c) fputc(',', stream);
            write_real(stream, (double)((const float *)o->value)[c]);
        }
        break;
    case LW_OPTION_STRING:
    case LW_OPTION_CHOICE:
        word = word_of(o, &length);
        fwrite(word, 1, length, stream);
        break;
    }
}

/* ---- help ---- */

/* A place between its braces. */
static void write_place(const struct lw_option *o, const char *place, size_t size, FILE *stream) {
    static const char mark[] = " (default)";
    if (size == 0) {
        lw_options_value_write(o, stream);
        return;
    }
    const char *bar = memchr(place, '|', size);
    const size_t word_size = bar ? (size_t)(bar - place) : size;
    size_t length;
    const char *word = word_of(o, &length);
    if (length != word_size || memcmp(word, place, length) != 0) return;
    if (bar)
        fwrite(bar + 1, 1, size - word_size - 1, stream);
    else
        fputs(mark, stream);
}

void lw_options_value_write_help(const struct lw_option *o, FILE *stream) {
    const char *help = o->help;
    for (const char *place; (place = strchr(help, '{')); help = place + 1) {
        fwrite(help, 1, (size_t)(place - help), stream);
        const size_t size = strcspn(++place, "}");
        assert(place[size] == '}');
        write_place(o, place, size, stream);
        place += size;
    }
    fputs(help, stream);
}

static char *filled_help(const struct lw_option *o) {
    char *text = NULL;
    size_t size = 0;
    FILE *stream = open_memstream(&text, &size);
    if (!stream) return NULL;
    lw_options_value_write_help(o, stream);
    const bool failed = ferror(stream);
    if (fclose(stream) == 0 && !failed) return text;
    free(text);
    return NULL;
}

struct lw_option *lw_options_value_fill(const struct lw_option *table, size_t count) {
    struct lw_option *filled = calloc(count + 1, sizeof *filled);
    if (!filled) return NULL;
    for (size_t i = 0; i < count; i++) {
        filled[i] = table[i];
        if (table[i].help && !(filled[i].help = filled_help(&table[i]))) {
            lw_options_value_free(filled, i);
            return NULL;
        }
    }
    return filled;
}

void lw_options_value_free(struct lw_option *filled, size_t count) {
    for (size_t i = 0; filled && i < count; i++) free((char *)filled[i].help);
    free(filled);
}
