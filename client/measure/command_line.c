#include "client/measure/command_line.h"

#include <stdio.h>
#include <string.h>

void lw_command_line_write(int argc, char **argv, char *out, size_t size) {
    size_t length = (size_t)snprintf(out, size, "lightwell-load");
    for (int i = 0; i < argc && length < size; i++) {
        int more = snprintf(out + length, size - length, strchr(argv[i], ' ') ? " '%s'" : " %s", argv[i]);
        length += more > 0 ? (size_t)more : 0;
    }
}
