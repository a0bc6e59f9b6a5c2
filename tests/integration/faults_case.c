#include "tests/integration/faults_case.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

bool faults_case_is_long;

int faults_case_kill_all(void **state) {
    (void)state;
    const char *const faults[] = {"LD_PRELOAD",       "FAULT_PROGRAM", "FAULT_ALLOCATION",
                                  "FAULT_CONNECTION", "FAULT_WRITE",   "FAULT_ERRNO",
                                  "FAULT_CLOCK",      "FAULT_COUNT",   "FAULT_KILL"};
    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++) unsetenv(faults[i]);
    lw_process_kill_all();
    return 0;
}

void faults_case_shim(const char *program) {
    char path[512], *slash;
    const ssize_t length = readlink("/proc/self/exe", path, sizeof path - 32);
    assert_true(length > 0);
    path[length] = 0;
    slash = strrchr(path, '/');
    snprintf(slash + 1, 32, "libfault_shim.so");
    assert_int_equal(access(path, R_OK), 0);
    setenv("LD_PRELOAD", path, 1);
    setenv("FAULT_PROGRAM", program, 1);
}

void faults_case_set_number(const char *name, long number) {
    char text[32];
    snprintf(text, sizeof text, "%ld", number);
    setenv(name, text, 1);
}

void faults_case_count_calls(const char *program, const char *arguments, int code, long *out_allocations,
                             long *out_writes) {
    struct lw_process process;
    faults_case_shim(program);
    setenv("FAULT_COUNT", "1", 1);
    lw_process_start(&process, program, arguments);
    lw_process_expect(&process, lw_process_finish(&process, LIMIT_S), code);
    unsetenv("FAULT_COUNT");
    char *said = lw_process_err(&process), *counts = strstr(said, "fault_shim: ");
    assert_non_null(counts);
    assert_int_equal(sscanf(counts, "fault_shim: %ld %ld", out_allocations, out_writes), 2);
    free(said);
    assert_true(*out_allocations > 0);
}
