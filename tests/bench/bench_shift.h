/* bench_shift.h: an object that moves once, in place of a scene's own animation.
 * Threads: main() only. */
#ifndef LW_TESTS_BENCH_SHIFT_H
#define LW_TESTS_BENCH_SHIFT_H

#include "common/scene/scene.h"

/** From 1 s on the object of that name stands `widths` of its widths further along its own x. Nothing
 * else moves.
 * Poses of before want to be made again.
 * out_object  its index; may be NULL
 * Errors      LW_USAGE: there is none of that name; LW_NO_MEMORY */
LW_MUST_CHECK enum lw_status bench_shift(struct lw_scene *scene, const char *name, float widths,
                                         uint32_t *out_object, struct lw_error *err);

#endif
