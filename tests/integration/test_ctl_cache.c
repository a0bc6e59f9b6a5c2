/* lightwellctl keeps the scene package: one download, however many commands. */
#include "tests/support/process.h"

#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LIMIT_S LW_PROCESS_LIMIT_S

static struct lw_process server;

static int start(void **state) {
    (void)state;
    char arguments[600];
    snprintf(arguments, sizeof arguments, "%s --freeze 0 --json --frame-rate 100 --threads 1",
             lw_process_atrium());
    lw_process_serve(&server, arguments);
    return 0;
}

static int stop(void **state) {
    (void)state;
    int code = server.pid ? lw_process_stop(&server, SIGTERM, LIMIT_S) : 0;
    lw_process_kill_all();
    return code;
}

/* What the server has sent; it says so at the end of each frame. */
static double bytes_sent(void) {
    lw_process_await_frames(&server, 2);
    return lw_process_newest(&server, "bytes_sent");
}

/* The bytes that a command takes. */
static double bytes_of(const char *command) {
    char arguments[256];
    struct lw_process ctl;
    const double before = bytes_sent();
    snprintf(arguments, sizeof arguments, "127.0.0.1:%u %s", server.port, command);
    lw_process_start(&ctl, "lightwellctl", arguments);
    const int code = lw_process_finish(&ctl, LIMIT_S);
    if (code) fail_msg("%s: %d: %s", command, code, lw_process_err(&ctl));
    return bytes_sent() - before;
}

/* Size of the one package in the folder, whole or its parts; 0: there is none. */
static size_t package_in(const char *folder_path) {
    char path[512];
    size_t size = 0;
    DIR *folder = opendir(folder_path);
    for (struct dirent *entry; folder && (entry = readdir(folder));) {
        if (!strstr(entry->d_name, ".lwscene") && !strstr(entry->d_name, ".lwpart")) continue;
        size_t of_file;
        snprintf(path, sizeof path, "%s/%s", folder_path, entry->d_name);
        free(lw_support_read_file(path, &of_file));
        size += of_file;
    }
    if (folder) closedir(folder);
    return size;
}

static void the_second_command_downloads_nothing(void **state) {
    (void)state;
    const double first = bytes_of("list"), second = bytes_of("hide #0"), third = bytes_of("show #0 --json");
    const size_t package = package_in(lw_support_temporary("caches/lightwell"));
    print_message("package of %zu bytes: %.0f sent, then %.0f and %.0f\n", package, first, second, third);
    assert_true(package > 100000);
    assert_true(first > 0.1 * (double)package); /* compressed */
    assert_true(second < 0.01 * (double)package && second < 0.1 * first);
    assert_true(third < 0.01 * (double)package && third < 0.1 * first);
}

static void the_folder_is_the_users_choice(void **state) {
    (void)state;
    char command[256];
    const double whole = bytes_of("list --cache=");
    assert_true(whole > 0.1 * (double)package_in(lw_support_temporary("caches/lightwell")));
    snprintf(command, sizeof command, "list --cache %s", lw_support_temporary("here/and/there"));
    assert_true(bytes_of(command) > 0.5 * whole);
    assert_true(package_in(lw_support_temporary("here/and/there")) > 100000);
    assert_true(bytes_of(command) < 0.1 * whole);
}

/* A damaged one is reported once, downloaded again and written in its place. */
static void a_damaged_one_is_reported_and_healed(void **state) {
    (void)state;
    char arguments[300], folder_path[300], path[700] = "";
    struct lw_process ctl;
    snprintf(folder_path, sizeof folder_path, "%s", lw_support_temporary("damaged"));
    snprintf(arguments, sizeof arguments, "127.0.0.1:%u list --cache %s", server.port, folder_path);
    for (unsigned run = 0; run < 3; run++) {
        lw_process_run(&ctl, "lightwellctl", arguments, 0);
        char *said = lw_process_err(&ctl), *warning = strstr(said, "is damaged or cannot be read");
        if ((warning != NULL) != (run == 1)) fail_msg("run %u: %s", run, said);
        if (warning) assert_null(strstr(warning + 1, "is damaged"));
        free(said);
        DIR *folder = run == 0 ? opendir(folder_path) : NULL;
        for (struct dirent *entry; folder && (entry = readdir(folder));)
            if (strstr(entry->d_name, ".lw")) { /* all of them */
                snprintf(path, sizeof path, "%s/%s", folder_path, entry->d_name);
                lw_support_write_file(path, "damaged", 7);
            }
        if (folder) closedir(folder);
        assert_true(*path);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_second_command_downloads_nothing),
        cmocka_unit_test(the_folder_is_the_users_choice),
        cmocka_unit_test(a_damaged_one_is_reported_and_healed),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
