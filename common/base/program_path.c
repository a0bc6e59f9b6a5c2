#include "common/base/program_path.h"

#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

void lw_program_path(const char *name, char *out_path, size_t capacity) {
    char self[PATH_MAX];
    ssize_t length = readlink("/proc/self/exe", self, sizeof self - 1);
    self[length > 0 ? length : 0] = 0;
    char *slash = strrchr(self, '/');
    if (slash) {
        *slash = 0;
        int size = snprintf(out_path, capacity, "%s/%s", self, name);
        if (size > 0 && (size_t)size < capacity && access(out_path, X_OK) == 0) return;
    }
    snprintf(out_path, capacity, "%s", name);
}
