/* support.h: what every test includes first. */
#ifndef LW_TESTS_SUPPORT_H
#define LW_TESTS_SUPPORT_H

/* cmocka wants these before itself */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "common/scene/scene.h"

/** Ends the test with the error's text unless status is LW_OK. */
void lw_support_ok(enum lw_status status, const struct lw_error *err);

/** A scene of `count` objects, each a square of side_m metres facing +Y at height 0, 2*side_m apart along X, albedo
 * 0.5, with a point light of 10 W/sr at (0, 2, 0). No lightmap UVs. */
struct lw_scene *lw_support_squares(unsigned count, float side_m);

#endif
