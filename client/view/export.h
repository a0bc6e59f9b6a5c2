/* export.h: a rendered view becomes a file, or figures.
 * Flow:    linear radiance -> [export] -> EXR, or tone mapped PNG
 * Threads: main() only. */
#ifndef LW_CLIENT_VIEW_EXPORT_H
#define LW_CLIENT_VIEW_EXPORT_H

#include "client/view/view_options.h"

/** Whether the file that the options name could be written, before the long work. Errors:
 * lw_atomic_file_check()'s. */
LW_MUST_CHECK enum lw_status lw_export_check(const struct lw_view_options *options, struct lw_error *err);

/** Writes a picture as the options say, or nothing if they name no file.
 * rgb      options->width * options->height * 3 floats, W/(m^2 sr)
 * Errors   the image writer's */
LW_MUST_CHECK enum lw_status lw_export_picture(const struct lw_view_options *options, const float *rgb,
                                               struct lw_error *err);

/** Mean colour of pixels; out: 3 numbers. */
void lw_export_mean(const float *rgb, size_t pixel_count, double out[3]);

#endif
