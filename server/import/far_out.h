/* far_out.h: warns of what lies so far from the origin that light there is inexact. Rays start off their
 * surface by what the rounding of floats asks for, LW_TRACE_LIFT times the coordinate: 7 cm at 100 km. The
 * rounding is compared with lengths that it must be small against: texels, and the distance from a lamp or a
 * camera to the nearest surface.
 * Threads: [any]. */
#ifndef LW_IMPORT_FAR_OUT_H
#define LW_IMPORT_FAR_OUT_H

#include "common/lightmap/lightmap.h"
#include "common/scene/scene.h"

/** At most one line each for objects, lamps (materials that shine among them) and cameras, as the scene
 * stands at time 0. report: per mesh; file: for the line. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_far_out_warn(const struct lw_scene *scene,
                                             const struct lw_lightmap_report *report, const char *file,
                                             struct lw_error *err);

#endif
