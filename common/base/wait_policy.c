#include "common/base/wait_policy.h"

#include "common/base/log.h"

#include <errno.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

void lw_wait_passively(char **argv) {
    char self[PATH_MAX]; /* by its own path, so that the process keeps its name */
    if (getenv("OMP_WAIT_POLICY")) return;
    const ssize_t length = readlink("/proc/self/exe", self, sizeof self - 1);
    if (length > 0 && setenv("OMP_WAIT_POLICY", "passive", 1) == 0) {
        self[length] = 0;
        execv(self, argv);
    }
    lw_log(LW_LOG_WARNING, "idle threads spin (cannot start again with OMP_WAIT_POLICY=passive: %s)",
           strerror(errno));
}
