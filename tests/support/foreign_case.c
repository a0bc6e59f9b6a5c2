#include "tests/support/foreign_case.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static char talk[16384];

void lw_foreign_case_write_bytes(const char *name, const void *bytes, size_t size) {
    lw_support_write_file(lw_support_temporary(name), bytes, size);
}

void lw_foreign_case_write_text(const char *name, const char *text) {
    lw_foreign_case_write_bytes(name, text, strlen(text));
}

void lw_foreign_case_make_folder(const char *name) {
    assert_true(mkdir(lw_support_temporary(name), 0700) == 0 || errno == EEXIST);
}

enum lw_status lw_foreign_case_load(const char *name, enum lw_foreign_sides sides, struct lw_scene **out,
                                    struct lw_error *err) {
    char path[512];
    snprintf(path, sizeof path, "%s", lw_support_temporary(name));
    struct lw_foreign_desc desc = {.path = path, .sides = sides};
    *out = NULL;
    fflush(stderr);
    int saved = dup(STDERR_FILENO);
    int file = open(lw_support_temporary("talk"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    assert_true(saved >= 0 && file >= 0 && dup2(file, STDERR_FILENO) >= 0);
    enum lw_status status = lw_scene_format_of(path, &desc.format, err);
    if (status == LW_OK) {
        assert_int_not_equal(desc.format, LW_SCENE_FORMAT_GLTF);
        status = lw_foreign_load(&desc, out, err);
    }
    fflush(stderr);
    dup2(saved, STDERR_FILENO);
    ssize_t length = pread(file, talk, sizeof talk - 1, 0);
    talk[length > 0 ? length : 0] = 0;
    close(saved);
    close(file);
    return status;
}

const char *lw_foreign_case_talk(void) { return talk; }
