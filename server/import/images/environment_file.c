#include "server/import/images/environment_file.h"

#include "common/base/log.h"
#include "common/image/image.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Makes light of a number; true if it had to be changed. */
static bool clean(float *x) {
    if (*x >= 0 && *x <= LW_SCENE_RADIANCE_MAX) return false;
    *x = isinf(*x) && *x > 0 ? LW_ENVIRONMENT_FILE_HALF_MAX : *x > 0 ? LW_SCENE_RADIANCE_MAX : 0;
    return true;
}

static void clean_all(float *rgb, size_t count, const char *path) {
    size_t changed = 0;
    for (size_t i = 0; i < count; i++) {
        bool any = false;
        for (int c = 0; c < 3; c++) any |= clean(&rgb[3 * i + (size_t)c]);
        changed += any;
    }
    if (changed)
        lw_log(LW_LOG_WARNING, "%s: %zu of %zu texels are negative, infinite or no number; they are clamped",
               path, changed, count);
}

/* Source texels of a row or column that one target texel covers. */
struct span {
    uint32_t first, last; /* last one included */
    double from, to;      /* in source texels */
};

static struct span span_of(uint32_t t, uint32_t count, uint32_t src_count) {
    struct span s = {.from = (double)t * src_count / count, .to = (t + 1.0) * src_count / count};
    s.first = (uint32_t)s.from;
    s.last = (uint32_t)ceil(s.to) - 1;
    if (s.first >= src_count) s.first = src_count - 1;
    if (s.last >= src_count) s.last = src_count - 1;
    return s;
}

static double overlap_from(const struct span *s, uint32_t i) { return fmax(s->from, i); }
static double overlap_to(const struct span *s, uint32_t i) { return fmin(s->to, i + 1.0); }

void lw_environment_file_filter(const float *src, uint32_t src_width, uint32_t src_height, float *dst,
                                uint32_t width, uint32_t height) {
    const double step = acos(-1.0) / src_height;
    for (uint32_t y = 0; y < height; y++) {
        const struct span rows = span_of(y, height, src_height);
        const double band = cos(step * rows.from) - cos(step * rows.to);
        for (uint32_t x = 0; x < width; x++) {
            const struct span columns = span_of(x, width, src_width);
            double sum[3] = {0};
            for (uint32_t j = rows.first; j <= rows.last; j++) {
                double tall = cos(step * overlap_from(&rows, j)) - cos(step * overlap_to(&rows, j));
                for (uint32_t i = columns.first; i <= columns.last; i++) {
                    double weight = tall * (overlap_to(&columns, i) - overlap_from(&columns, i));
                    const float *texel = src + 3 * ((size_t)j * src_width + i);
                    for (int c = 0; c < 3; c++) sum[c] += weight * (double)texel[c];
                }
            }
            for (int c = 0; c < 3; c++)
                dst[3 * ((size_t)y * width + x) + (size_t)c] =
                    (float)(sum[c] / (band * (columns.to - columns.from)));
        }
    }
}

enum lw_status lw_environment_file_load(struct lw_scene *scene, const char *path, struct lw_error *err) {
    float *rgb = NULL;
    uint32_t src_width = 0, src_height = 0;
    enum lw_status status = lw_image_read_exr(path, &rgb, &src_width, &src_height, err);
    if (status) return status;
    clean_all(rgb, (size_t)src_width * src_height, path);

    /* both sides by the same factor: the picture keeps its proportions */
    const double longest = src_width > src_height ? src_width : src_height;
    const double factor = fmin(1, LW_SCENE_ENVIRONMENT_SIDE_MAX / longest);
    const uint32_t width = (uint32_t)fmax(1, round(src_width * factor)),
                   height = (uint32_t)fmax(1, round(src_height * factor));
    float *texels = lw_scene_alloc(scene, 3ul * width * height, sizeof *texels);
    if (!texels) {
        free(rgb);
        return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", path);
    }
    if (width == src_width && height == src_height) {
        memcpy(texels, rgb, 3ul * width * height * sizeof *texels);
    } else {
        lw_log(LW_LOG_INFO, "%s: %u x %u texels, filtered down to %u x %u", path, src_width, src_height,
               width, height);
        lw_environment_file_filter(rgb, src_width, src_height, texels, width, height);
    }
    free(rgb);
    scene->environment = (struct lw_environment){.width = width, .height = height, .rgb = texels};
    return LW_OK;
}
