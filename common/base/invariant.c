#include "common/base/invariant.h"

#include <stdio.h>
#include <stdlib.h>

void lw_invariant_broken(const char *file, int line, const char *condition) {
    fprintf(stderr, "%s:%d: broken invariant: %s\n", file, line, condition);
    fflush(stderr);
    abort();
}
