#include "client/view/window/saved_picture.h"

#include "common/image/image.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#define NAMES_MAX 100 /* for one second */

static bool is_taken(const char *name) {
    char path[LW_SAVED_PICTURE_NAME_SIZE + 8];
    snprintf(path, sizeof path, "%s.png", name);
    if (access(path, F_OK) == 0) return true;
    snprintf(path, sizeof path, "%s.exr", name);
    return access(path, F_OK) == 0;
}

static void find_name(char out[LW_SAVED_PICTURE_NAME_SIZE]) {
    char when[32];
    struct tm tm = {0};
    const time_t now = time(NULL);
    localtime_r(&now, &tm);
    strftime(when, sizeof when, "%Y-%m-%d_%H.%M.%S", &tm);
    snprintf(out, LW_SAVED_PICTURE_NAME_SIZE, "lightwell_%s", when);
    for (int i = 2; i <= NAMES_MAX && is_taken(out); i++)
        snprintf(out, LW_SAVED_PICTURE_NAME_SIZE, "lightwell_%s_%d", when, i);
}

enum lw_status lw_saved_picture_write(const float *rgb, uint32_t width, uint32_t height,
                                      enum lw_tonemap_curve curve, float stops,
                                      char out_name[LW_SAVED_PICTURE_NAME_SIZE], struct lw_error *err) {
    char name[LW_SAVED_PICTURE_NAME_SIZE], path[LW_SAVED_PICTURE_NAME_SIZE + 8];
    const size_t pixel_count = (size_t)width * height;
    uint8_t *srgb = malloc(pixel_count * 3);
    if (srgb == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the picture");
    struct lw_tonemap tonemap;
    lw_tonemap_init(&tonemap, curve, stops);
    lw_tonemap_encode(&tonemap, rgb, pixel_count, 3, srgb);
    find_name(name);
    snprintf(path, sizeof path, "%s.png", name);
    enum lw_status status = lw_image_write_png(path, srgb, width, height, err);
    free(srgb);
    if (status != LW_OK) return status;
    char exr[sizeof path];
    snprintf(exr, sizeof exr, "%s.exr", name);
    status = lw_image_write_exr(exr, rgb, width, height, "W/(m^2 sr)", err);
    if (status == LW_OK)
        snprintf(out_name, LW_SAVED_PICTURE_NAME_SIZE, "%s", name);
    else
        unlink(path); /* both or none */
    return status;
}
