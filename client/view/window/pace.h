/* pace.h: how many pixels a moving picture can afford.
 * Threads: pure functions, [any]. */
#ifndef LW_CLIENT_VIEW_WINDOW_PACE_H
#define LW_CLIENT_VIEW_WINDOW_PACE_H

#include <stdint.h>

/* for rendering, while something moves: leaves time for the rest of a frame at 20 frames/s */
#define LW_PACE_FRAME_MS 40.0
#define LW_PACE_SIDE_MIN 64u /* pixels */

struct lw_pace {
    double ns_per_pixel; /* smoothed; 0: unknown */
};

/** Takes in what a render cost. */
void lw_pace_note(struct lw_pace *pace, uint64_t pixels, uint64_t ns);

/** Time that a frame has left after a number of pixels; 0 while no cost is measured. */
uint64_t lw_pace_spare_ns(const struct lw_pace *pace, uint64_t pixels);

/** The largest size of the window's shape that renders in time; never more than the window's. */
void lw_pace_size(const struct lw_pace *pace, uint32_t window_width, uint32_t window_height,
                  uint32_t *out_width, uint32_t *out_height);

#endif
