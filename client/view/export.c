#include "client/view/export.h"

#include "common/base/atomic_file.h"
#include "common/image/image.h"

#include <stdlib.h>

enum lw_status lw_export_check(const struct lw_view_options *o, struct lw_error *err) {
    if (o->format == LW_VIEW_NO_FILE) return LW_OK;
    enum lw_status status = lw_atomic_file_check(o->out, err);
    if (status != LW_OK) lw_status_context(err, "--out");
    return status;
}

enum lw_status lw_export_picture(const struct lw_view_options *o, const float *rgb, struct lw_error *err) {
    const size_t pixel_count = (size_t)o->width * o->height;
    if (o->format == LW_VIEW_NO_FILE) return LW_OK;
    if (o->format == LW_VIEW_EXR)
        return lw_image_write_exr(o->out, rgb, o->width, o->height, "W/(m^2 sr)", err);
    uint8_t *srgb = malloc(pixel_count * 3);
    if (srgb == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the picture");
    struct lw_tonemap tonemap;
    if (lw_show_is_chart(o->show))
        lw_tonemap_init(&tonemap, LW_TONEMAP_NONE, 0);
    else
        lw_tonemap_init(&tonemap, o->curve,
                        o->auto_exposure ? lw_tonemap_auto_stops(rgb, pixel_count) : o->stops);
    lw_tonemap_encode(&tonemap, rgb, pixel_count, 3, srgb);
    enum lw_status status = lw_image_write_png(o->out, srgb, o->width, o->height, err);
    free(srgb);
    return status;
}

void lw_export_mean(const float *rgb, size_t pixel_count, double out[3]) {
    for (size_t c = 0; c < 3; c++) {
        double sum = 0;
        for (size_t i = 0; i < pixel_count; i++) sum += (double)rgb[3 * i + c];
        out[c] = sum / (double)pixel_count;
    }
}
