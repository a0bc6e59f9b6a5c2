/* A configuration file of any bytes: it is taken, or there is a line that names the file. */
#include "common/base/log.h"
#include "common/base/options_config.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static void require(bool condition) {
    if (!condition) abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    struct {
        bool animate, freeze_given;
        const char *keep;
        int64_t bounces;
        double rate, freeze;
        float sky[3];
        int clock;
    } values = {0};
    struct lw_options_config config = {.prefix = "LWFUZZ", .positional = "scene"};
    const char *scene[1] = {NULL};
    const struct lw_option table[] = {
        {"animate", NULL, "Run.", LW_OPTION_FLAG, &values.animate, 0, 0, NULL},
        {"keep", "FOLDER", "Keep.", LW_OPTION_STRING, &values.keep, 0, 0, NULL},
        {"config", "FILE", "Read.", LW_OPTION_STRING, (void *)&config.path, 0, 0, NULL},
        {"bounces", "N", "Bounces.", LW_OPTION_INT, &values.bounces, 0, 16, NULL},
        {"frame-rate", "HZ", "Rate.", LW_OPTION_REAL, &values.rate, 0.5, 240, NULL},
        {"freeze", "SECONDS", "Hold.", LW_OPTION_REAL, &values.freeze, 0, 1e9, &values.freeze_given},
        {"sky", "R,G,B", "Sky.", LW_OPTION_RGB, values.sky, 0, 100, NULL},
        {"clock", "real|step", "Time.", LW_OPTION_CHOICE, &values.clock, 0, 0, NULL},
    };
    const struct lw_options options = {.program = "fuzz",
                                       .synopsis = "SCENE",
                                       .table = table,
                                       .count = sizeof table / sizeof *table,
                                       .positional = scene,
                                       .positional_max = 1};
    static const char *const command[] = {"config", NULL}, *const none[] = {NULL};
    static int file = -1;
    static char path[64];
    if (file < 0) file = memfd_create("fuzz", MFD_CLOEXEC);
    require(file >= 0 && ftruncate(file, 0) == 0);
    require(pwrite(file, bytes, size, 0) == (ssize_t)size);
    snprintf(path, sizeof path, "/proc/self/fd/%d", file);
    char *argv[] = {(char *)"fuzz", (char *)"--config", path, NULL};
    bool done = false;
    struct lw_error err = {0};
    config.command = command;
    config.foreign = none;
    const enum lw_status status = lw_options_config_parse(&config, &options, 3, argv, &done, &err);
    require((status == LW_OK) == !*err.text);
    if (status == LW_OK) {
        require(values.bounces >= 0 && values.bounces <= 16);
        char *text = lw_options_config_print(&config, &options);
        require(text != NULL);
        free(text);
    }
    lw_options_config_finish(&config);
    return 0;
}
