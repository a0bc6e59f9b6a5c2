/* Faults: the real programs with a full disk, at each write in turn. */
#include "tests/integration/faults_case.h"

#include "common/base/sanitizer.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Promise (importing.md, running.md): a file is whole or not there, and the failure is a line with 74. */
static void each_write_may_fail(const char *program, const char *arguments, const char *output,
                                bool is_one_file) {
    static const int faults[] = {ENOSPC, EIO, 0};
    long allocations, writes;
    faults_case_count_calls(program, arguments, 0, &allocations, &writes);
    assert_true(writes > 0);
    const long step = faults_case_is_long || writes < 8 ? 1 : writes / 8;
    for (size_t f = 0; f < sizeof faults / sizeof *faults; f++)
        for (long n = 1; n <= writes; n += step) {
            struct lw_process process;
            (void)unlink(output);
            faults_case_set_number("FAULT_WRITE", n);
            faults_case_set_number("FAULT_ERRNO", faults[f]);
            lw_process_start(&process, program, arguments);
            const int code = lw_process_finish(&process, LIMIT_S);
            char *said = lw_process_err(&process);
            if (faults[f] && (code <= 0 || !strstr(said, strerror(faults[f]))))
                fail_msg("%s, write %ld of %ld, %s: ends with %d: %s", program, n, writes,
                         strerror(faults[f]), code, said);
            if (!faults[f] && code) fail_msg("%s, short writes from %ld on: %d: %s", program, n, code, said);
            if (is_one_file) assert_int_equal(access(output, F_OK) == 0, faults[f] == 0);
            free(said);
        }
    print_message("%s: %ld writes, each with ENOSPC, EIO and cut short\n", program, writes);
    unsetenv("FAULT_WRITE");
}

static void a_full_disk_leaves_no_half_package(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    char arguments[512], output[256];
    snprintf(output, sizeof output, "%s", lw_support_temporary("full.lwscene"));
    snprintf(arguments, sizeof arguments, "builtin:cornell -o %s --threads 1 --texels-per-metre 2", output);
    each_write_may_fail("lightwell-import", arguments, output, true);
}

/* A failed save is reported at the end. There are two files: either may be whole. */
static void a_full_disk_leaves_no_half_light(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    char arguments[512], output[256];
    snprintf(output, sizeof output, "%s", lw_support_temporary("full_keep/shown"));
    snprintf(
        arguments, sizeof arguments,
        CORNELL
        "--listen 127.0.0.1:0 --http none --control-socket none --texels-per-metre 2 --frames 2 --keep %s",
        lw_support_temporary("full_keep"));
    long allocations, writes;
    /* the first start also writes what later ones find in the cache */
    faults_case_count_calls("lightwelld", arguments, 0, &allocations, &writes);
    each_write_may_fail("lightwelld", arguments, output, false);
}

static void a_full_disk_leaves_no_half_bake(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    char arguments[512], output[256];
    snprintf(output, sizeof output, "%s", lw_support_temporary("full_bake/index.json"));
    snprintf(arguments, sizeof arguments, "builtin:cornell -o %s --texels-per-metre 1 --samples 1",
             lw_support_temporary("full_bake"));
    each_write_may_fail("lightwell-bake", arguments, output, true);
}

/* Its files in a folder; with half ones, which have names of their own. */
static unsigned files_in(const char *path) {
    unsigned count = 0;
    DIR *folder = opendir(path);
    for (const struct dirent *entry; folder && (entry = readdir(folder));) count += entry->d_name[0] != '.';
    if (folder) closedir(folder);
    return count;
}

static void empty(const char *path) {
    char command[600];
    snprintf(command, sizeof command, "rm -rf '%s'", path);
    assert_int_equal(system(command), 0);
}

/* Promise (client.h): a package that cannot be kept is reported in one line, and the command does its work;
 * all files in the folder are whole. */
static void a_full_disk_leaves_no_half_cache(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    static const int faults[] = {ENOSPC, EIO, 0};
    char arguments[600], folder[300];
    struct lw_process daemon, ctl;
    long allocations, writes;
    snprintf(arguments, sizeof arguments, "%s --texels-per-metre 4 --freeze 0 --http none --threads 1",
             lw_support_source("tests/support/moving.gltf"));
    lw_process_serve(&daemon, arguments); /* it has textures, which are parts of their own */
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("full_cache"));
    snprintf(arguments, sizeof arguments, "127.0.0.1:%u list --cache %s", daemon.port, folder);
    faults_case_count_calls("lightwellctl", arguments, 0, &allocations, &writes);
    const unsigned whole = files_in(folder);
    assert_true(writes > 0 && whole > 0);
    const long step = faults_case_is_long || writes < 3 ? 1 : writes / 3;
    for (size_t f = 0; f < sizeof faults / sizeof *faults; f++)
        for (long n = faults[f] ? 1 : writes; n <= writes; n += step) { /* a byte at a time takes long */
            empty(folder);
            faults_case_set_number("FAULT_WRITE", n);
            faults_case_set_number("FAULT_ERRNO", faults[f]);
            lw_process_run(&ctl, "lightwellctl", arguments, 0);
            char *said = lw_process_err(&ctl), *line = strstr(said, "is not kept");
            if ((line != NULL) != (faults[f] != 0)) fail_msg("write %ld of %ld: %s", n, writes, said);
            if (line && (!strstr(line, folder) || !strstr(line, strerror(faults[f])) ||
                         strstr(line + 1, "is not kept")))
                fail_msg("write %ld of %ld: %s", n, writes, said);
            free(said);
            const unsigned kept = files_in(folder);
            if (faults[f] ? kept >= whole : kept != whole)
                fail_msg("write %ld: %u of %u files", n, kept, whole);
            unsetenv("FAULT_WRITE"); /* the file is taken for whole: it must be */
            lw_process_run(&ctl, "lightwellctl", arguments, 0);
            said = lw_process_err(&ctl);
            if (*said) fail_msg("after write %ld: %s", n, said);
            free(said);
            assert_int_equal(files_in(folder), whole);
        }
    print_message("lightwellctl: %ld writes of the cache, each with ENOSPC and EIO, one cut short\n", writes);
}

static void a_full_disk_leaves_no_half_picture(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    char arguments[512], output[256];
    snprintf(output, sizeof output, "%s", lw_support_temporary("full.png"));
    snprintf(arguments, sizeof arguments,
             "--path-trace builtin:cornell --size 16x16 --spp 4 --out %s --threads 1", output);
    each_write_may_fail("lightwell-view", arguments, output, true);
}

int main(int argc, char **argv) {
    faults_case_is_long = argc > 1;
    if (argc > 2) cmocka_set_test_filter(argv[2]);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(a_full_disk_leaves_no_half_package, faults_case_kill_all),
        cmocka_unit_test_teardown(a_full_disk_leaves_no_half_light, faults_case_kill_all),
        cmocka_unit_test_teardown(a_full_disk_leaves_no_half_bake, faults_case_kill_all),
        cmocka_unit_test_teardown(a_full_disk_leaves_no_half_cache, faults_case_kill_all),
        cmocka_unit_test_teardown(a_full_disk_leaves_no_half_picture, faults_case_kill_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
