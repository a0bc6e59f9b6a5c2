/* faults_case.h: a shim that lets calls of the C library fail in programs, and what it counts. */
#ifndef LW_TESTS_FAULTS_CASE_H
#define LW_TESTS_FAULTS_CASE_H

#include "tests/support/process.h"

#define LIMIT_S LW_PROCESS_LIMIT_S
#define TARGET  0.3f
#define CORNELL                                                                                              \
    "builtin:cornell --texels-per-metre 8 --clock step --json --light whole --error 0.3 --frame-rate 200 "

/* The program has an argument: it plays all of each fault instead of a sample. */
extern bool faults_case_is_long;

/** A teardown: no fault any more, and no program. */
int faults_case_kill_all(void **state);

/** Programs of that name run with the shim from now on. */
void faults_case_shim(const char *program);

/** Sets a variable that the shim reads. */
void faults_case_set_number(const char *name, long number);

/** What a whole run needs: allocations and writes. */
void faults_case_count_calls(const char *program, const char *arguments, int code, long *out_allocations,
                             long *out_writes);

#endif
