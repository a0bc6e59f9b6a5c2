#include "server/import/text_lines.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#define NUMBER_SIZE 64 /* characters of a number; more are none */

/* Control characters too: a NUL and the end mark of old systems are no part of any name. */
static bool is_blank(char c) { return (unsigned char)c <= ' '; }
static bool ends_line(char c) { return c == '\n' || c == '\r'; }

void lw_text_lines_init(struct lw_text_lines *lines, const uint8_t *bytes, size_t size) {
    const size_t mark = size >= 3 && memcmp(bytes, "\xEF\xBB\xBF", 3) == 0 ? 3 : 0;
    *lines = (struct lw_text_lines){
        .at = (const char *)bytes + mark, .end = (const char *)bytes + size, .next = 1};
}

void lw_text_lines_finish(struct lw_text_lines *lines) {
    free(lines->text);
    *lines = (struct lw_text_lines){0};
}

static bool reserve(struct lw_text_lines *lines, size_t size) {
    if (size <= lines->capacity) return true;
    char *text = realloc(lines->text, size + size / 2);
    lines->out_of_memory = !text;
    if (!text) return false;
    lines->text = text;
    lines->capacity = size + size / 2;
    return true;
}

/* Appends the line at `at` to the text, without its end, and steps past it. */
static bool append_line(struct lw_text_lines *lines, size_t *length) {
    const char *end = lines->at;
    while (end < lines->end && !ends_line(*end)) end++;
    const size_t size = (size_t)(end - lines->at);
    if (!reserve(lines, *length + size + 1)) return false;
    memcpy(lines->text + *length, lines->at, size);
    *length += size;
    lines->text[*length] = 0;
    if (end < lines->end) end += end[0] == '\r' && end + 1 < lines->end && end[1] == '\n' ? 2 : 1;
    lines->at = end;
    lines->next++;
    return true;
}

static size_t length_without_blanks(const char *text, size_t length) {
    while (length > 0 && is_blank(text[length - 1])) length--;
    return length;
}

/* A comment does not go on: paths in it may end with a backslash. */
static bool continues(const struct lw_text_lines *lines, size_t length) {
    return lines->at < lines->end && length > 0 && lines->text[length - 1] == '\\' && *lines->text != '#';
}

/* The next line with those that continue it. */
static bool read_line(struct lw_text_lines *lines) {
    size_t length = 0;
    while (lines->at < lines->end && is_blank(*lines->at)) {
        lines->next +=
            *lines->at == '\n' || (*lines->at == '\r' && lines->at + 1 < lines->end && lines->at[1] != '\n');
        lines->at++;
    }
    lines->line = lines->next;
    if (lines->at == lines->end || !append_line(lines, &length)) return false;
    while (continues(lines, length = length_without_blanks(lines->text, length))) {
        lines->text[length - 1] = ' ';
        if (!append_line(lines, &length)) return false;
    }
    for (size_t i = 0; i < length; i++)
        if (!lines->text[i]) lines->text[i] = ' ';
    lines->text[length] = 0;
    return true;
}

bool lw_text_lines_next(struct lw_text_lines *lines) {
    do {
        if (!read_line(lines)) return false;
    } while (*lines->text == '#');
    char *at = lines->text;
    size_t length = 0;
    for (; *at && !is_blank(*at); at++)
        if (length + 1 < sizeof lines->keyword) lines->keyword[length++] = (char)tolower((unsigned char)*at);
    lines->keyword[length] = 0;
    while (*at && is_blank(*at)) at++;
    lines->rest = at;
    return true;
}

char *lw_text_lines_word(char **at) {
    char *word = *at;
    while (*word && is_blank(*word)) word++;
    if (!*word || *word == '#') {
        *at = word + strlen(word);
        return NULL;
    }
    char *end = word;
    while (*end && !is_blank(*end) && *end != '#') end++;
    *at = *end == '#' ? end + strlen(end) : *end ? end + 1 : end;
    *end = 0;
    return word;
}

bool lw_text_lines_number(const char *word, double *out) {
    char text[NUMBER_SIZE], *end;
    const size_t length = strlen(word);
    if (length == 0 || length >= sizeof text || strpbrk(word, "xX")) return false; /* no hexadecimal ones */
    memcpy(text, word, length + 1);
    char *comma = strchr(text, ',');
    if (comma) *comma = '.';
    *out = strtod(text, &end);
    return *end == 0;
}

void lw_text_lines_cut_comment(char *name) {
    for (char *mark = strchr(name, '#'); mark; mark = strchr(mark + 1, '#')) {
        if ((mark > name && !is_blank(mark[-1])) || isdigit((unsigned char)mark[1])) continue;
        *mark = 0;
        break;
    }
    size_t length = strlen(name);
    while (length > 0 && is_blank(name[length - 1])) name[--length] = 0;
}

bool lw_text_lines_is_wide(const uint8_t *bytes, size_t size) {
    if (size < 2) return false;
    return (bytes[0] == 0xFF && bytes[1] == 0xFE) || (bytes[0] == 0xFE && bytes[1] == 0xFF) ||
           (size >= 4 && memcmp(bytes, "\0\0\xFE\xFF", 4) == 0);
}
