#include "client/view/window/pace.h"

#include <math.h>

/* Until something is measured: slow enough for a laptop that lights the scene as well. */
#define NS_PER_PIXEL_GUESS 200.0
#define SMOOTHING          0.3

void lw_pace_note(struct lw_pace *pace, uint64_t pixels, uint64_t ns) {
    if (pixels == 0) return;
    double cost = (double)ns / (double)pixels;
    pace->ns_per_pixel =
        pace->ns_per_pixel > 0 ? pace->ns_per_pixel + SMOOTHING * (cost - pace->ns_per_pixel) : cost;
}

static uint32_t scaled(uint32_t side, double scale) {
    uint32_t least = side < LW_PACE_SIDE_MIN ? side : LW_PACE_SIDE_MIN;
    uint32_t wanted = (uint32_t)((double)side * scale);
    wanted -= wanted % 4; /* whole packets */
    return wanted < least ? least : wanted > side ? side : wanted;
}

void lw_pace_size(const struct lw_pace *pace, uint32_t window_width, uint32_t window_height,
                  uint32_t *out_width, uint32_t *out_height) {
    double cost = pace->ns_per_pixel > 0 ? pace->ns_per_pixel : NS_PER_PIXEL_GUESS;
    double affordable = LW_PACE_FRAME_MS * 1e6 / cost, wanted = (double)window_width * (double)window_height;
    double scale = sqrt(affordable / wanted);
    if (scale >= 1) {
        *out_width = window_width;
        *out_height = window_height;
        return;
    }
    *out_width = scaled(window_width, scale);
    *out_height = scaled(window_height, scale);
}

uint64_t lw_pace_spare_ns(const struct lw_pace *pace, uint64_t pixels) {
    const double spare = LW_PACE_FRAME_MS * 1e6 - pace->ns_per_pixel * (double)pixels;
    return pace->ns_per_pixel > 0 && spare > 0 ? (uint64_t)spare : 0;
}
