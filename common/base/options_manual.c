#include "common/base/options_manual.h"

#include "common/base/options_range.h"

#include <stdio.h>
#include <string.h>

static bool is_number(const struct lw_option *o) {
    return o->kind == LW_OPTION_INT || o->kind == LW_OPTION_REAL || o->kind == LW_OPTION_RGB;
}

static bool is_shown(const struct lw_option *o) { return o->help != NULL; }

static const char *dashes(const struct lw_option *o) { return o->name[1] ? "--" : "-"; }

static const struct lw_option own[] = {
    {.name = "help", .help = "Print the options and end.", .kind = LW_OPTION_FLAG},
    {.name = "version", .help = "Print the version and end.", .kind = LW_OPTION_FLAG}};
#define OWN (sizeof own / sizeof *own)

static const struct lw_option *option_at(const struct lw_options *options, size_t i) {
    return i < options->count ? &options->table[i] : &own[i - options->count];
}

/* Prints a text, with blanks turned into another character. */
static void print_name(const char *text, char blank) {
    for (; *text; text++) putchar(*text == ' ' ? blank : *text);
}

/* ---- the manual page ---- */

/* Text within a line: a hyphen is one, and a backslash too. */
static void print_troff(const char *text, size_t length) {
    for (size_t i = 0; i < length; i++) {
        if (i == 0 && (text[i] == '.' || text[i] == '\'')) printf("\\&");
        if (text[i] == '\\')
            printf("\\e");
        else if (text[i] == '-')
            printf("\\-");
        else
            putchar(text[i]);
    }
}

static void print_troff_all(const char *text) { print_troff(text, strlen(text)); }

/* Lines that begin with blanks stand in by as many. */
static void print_paragraphs(const char *text) {
    while (*text) {
        const size_t indent = strspn(text, " "), length = strcspn(text, "\n");
        if (length == 0) {
            printf(".PP\n");
        } else {
            if (indent) printf(".RS %zu\n", indent);
            print_troff(text + indent, length - indent);
            printf(indent ? "\n.RE\n" : "\n.br\n");
        }
        text += length + (text[length] == '\n');
    }
}

static void print_option(const struct lw_option *o) {
    printf(".TP\n\\fB");
    print_troff_all(dashes(o));
    print_troff_all(o->name);
    printf("\\fR");
    if (o->argument) {
        printf(" \\fI");
        print_troff_all(o->argument);
        printf("\\fR");
    }
    printf("\n");
    print_troff_all(o->help);
    if (is_number(o)) {
        char range[96];
        lw_options_range_help(o, range, sizeof range);
        printf(" [");
        print_troff_all(range);
        printf("]");
    }
    printf("\n");
}

static void print_exit_codes(void) {
    static const struct {
        int code;
        const char *text;
    } codes[] = {
#define X(name, text, exit_code) {exit_code, text},
        LW_STATUS_MAP(X)
#undef X
    };
    for (size_t i = 0; i < sizeof codes / sizeof *codes; i++) {
        printf(".TP\n\\fB%d\\fR\n", codes[i].code);
        print_troff_all(codes[i].text);
        printf("\n");
    }
}

void lw_options_manual_page(const struct lw_options *options) {
    const char *about = options->about ? options->about : "";
    const char *end = strpbrk(about, ".:\n");
    printf(".TH ");
    print_name(options->program, '-');
    printf(" 1 \"\" \"lightwell " LW_VERSION "\" lightwell\n.SH NAME\n");
    print_name(options->program, '-');
    printf(" \\- ");
    print_troff(about, end ? (size_t)(end - about) : strlen(about));
    printf("\n.SH SYNOPSIS\n.B ");
    print_troff_all(options->program);
    printf("\n");
    print_troff_all(options->synopsis);
    printf("\n.SH DESCRIPTION\n");
    print_paragraphs(about);
    printf(".SH OPTIONS\n");
    for (size_t i = 0; i < options->count + OWN; i++)
        if (is_shown(option_at(options, i))) print_option(option_at(options, i));
    printf(".SH EXIT STATUS\n");
    print_exit_codes();
    printf(".SH SEE ALSO\n.BR lightwelld (1),\n.BR lightwellctl (1),\n.BR lightwell\\-view (1),\n"
           ".BR lightwell\\-bake (1),\n.BR lightwell\\-import (1),\n.BR lightwell\\-load (1)\n");
}

/* ---- completion ---- */

/* Completion of an option's value: its choices, files if it takes a file, or none. */
static void print_case(const struct lw_option *o) {
    if (o->kind == LW_OPTION_FLAG) return;
    printf("    %s%s)\n", dashes(o), o->name);
    if (o->kind == LW_OPTION_CHOICE) {
        printf("        COMPREPLY=($(compgen -W '");
        for (const char *c = o->argument; *c; c++) putchar(*c == '|' ? ' ' : *c);
        printf("' -- \"$word\"))\n");
    } else if (o->kind == LW_OPTION_STRING &&
               (strstr(o->argument, "FILE") || strstr(o->argument, "FOLDER"))) {
        printf("        COMPREPLY=($(compgen -f -- \"$word\"))\n");
    }
    printf("        return ;;\n");
}

void lw_options_manual_bash(const struct lw_options *options) {
    char function[128], *c = function;
    snprintf(function, sizeof function, "_%s", options->program);
    for (; *c; c++)
        if (*c == '-' || *c == ' ') *c = '_';
    printf("# bash completion, made from the program's own options\n%s() {\n", function);
    printf("    local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} commands\n"
           "    COMPREPLY=()\n");
    if (!strchr(options->program, ' '))
        printf("    if [ \"$COMP_CWORD\" -eq 1 ]; then\n"
               "        commands=$(compgen -A function %s_)\n"
               "        COMPREPLY=($(compgen -W \"${commands//%s_/}\" -- \"$word\"))\n"
               "        if [ -n \"${COMPREPLY[*]}\" ] && [ -n \"$word\" ]; then return; fi\n"
               "    elif declare -F \"%s_${COMP_WORDS[1]}\" >/dev/null; then\n"
               "        \"%s_${COMP_WORDS[1]}\"\n"
               "        return\n"
               "    fi\n",
               function, function, function, function);
    printf("    case $before in\n");
    for (size_t i = 0; i < options->count; i++)
        if (is_shown(&options->table[i])) print_case(&options->table[i]);
    printf("    esac\n    case $word in\n    -*) COMPREPLY=($(compgen -W '");
    for (size_t i = 0; i < options->count + OWN; i++)
        if (is_shown(option_at(options, i)))
            printf("%s%s%s", i ? " " : "", dashes(option_at(options, i)), option_at(options, i)->name);
    printf("' -- \"$word\")) ;;\n    *) COMPREPLY+=($(compgen -f -- \"$word\")) ;;\n    esac\n}\n");
    if (!strchr(options->program, ' '))
        printf("complete -o filenames -F %s %s\n", function, options->program);
}
