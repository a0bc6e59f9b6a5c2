/* saved_picture.h: the picture of the window as files: linear EXR, and PNG as it is shown.
 * Threads: [any]. */
#ifndef LW_CLIENT_VIEW_WINDOW_SAVED_PICTURE_H
#define LW_CLIENT_VIEW_WINDOW_SAVED_PICTURE_H

#include "client/view/tonemap.h"
#include "common/base/status.h"

#define LW_SAVED_PICTURE_NAME_SIZE 64

/** Writes NAME.exr and NAME.png into the current folder; NAME says the date and the time.
 * rgb       width * height * 3 floats, W/(m^2 sr)
 * out_name  without an ending
 * Errors: the image writers'; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_saved_picture_write(const float *rgb, uint32_t width, uint32_t height,
                                                    enum lw_tonemap_curve curve, float stops,
                                                    char out_name[LW_SAVED_PICTURE_NAME_SIZE],
                                                    struct lw_error *err);

#endif
