/* Prints the instruction set that rays are traced with, as LW_TRACE_ISA or the processor says; where the
 * processor lacks what LW_TRACE_ISA names, the line that says so, with exit code 69. */
#include "tests/support/support.h"

#include "common/trace/trace.h"

#include <stdio.h>

int main(void) {
    struct lw_scene *scene = lw_support_squares(1, 1);
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_error err = {0};
    enum lw_status status = lw_pose_init(&pose, scene);
    if (status == LW_OK) {
        status = lw_trace_create(scene, &pose, &trace, &err);
        if (status == LW_OK) {
            puts(lw_trace_isa(trace));
            lw_trace_destroy(trace);
        }
        lw_pose_finish(&pose);
    }
    lw_scene_destroy(scene);
    if (status != LW_OK) fprintf(stderr, "%s\n", err.text);
    return lw_status_exit_code(status);
}
