#include "client/load/frame_clock.h"

#include <stdlib.h>

enum lw_status lw_frame_clock_init(struct lw_frame_clock *clock) {
    *clock = (struct lw_frame_clock){.entry = malloc(LW_FRAME_CLOCK_FRAMES * sizeof *clock->entry)};
    return clock->entry ? LW_OK : LW_NO_MEMORY;
}

void lw_frame_clock_finish(struct lw_frame_clock *clock) {
    free(clock->entry);
    clock->entry = NULL;
}

static struct lw_frame_clock_entry *entry_of(const struct lw_frame_clock *clock, uint64_t i) {
    return &clock->entry[i % LW_FRAME_CLOCK_FRAMES];
}

const struct lw_frame_clock_entry *lw_frame_clock_at(const struct lw_frame_clock *clock, uint64_t i) {
    bool is_there = i < clock->count && clock->count - i <= LW_FRAME_CLOCK_FRAMES;
    return is_there ? entry_of(clock, i) : NULL;
}

uint64_t lw_frame_clock_newest(const struct lw_frame_clock *clock) {
    return clock->count ? entry_of(clock, clock->count - 1)->frame : 0;
}

bool lw_frame_clock_hear(struct lw_frame_clock *clock, struct lw_frame_clock_entry heard) {
    if (heard.frame <= lw_frame_clock_newest(clock)) return false;
    *entry_of(clock, clock->count++) = heard;
    return true;
}

const struct lw_frame_clock_entry *lw_frame_clock_find(const struct lw_frame_clock *clock, uint64_t frame) {
    uint64_t low = clock->count > LW_FRAME_CLOCK_FRAMES ? clock->count - LW_FRAME_CLOCK_FRAMES : 0,
             high = clock->count;
    while (low < high) {
        uint64_t middle = low + (high - low) / 2;
        if (entry_of(clock, middle)->frame < frame)
            low = middle + 1;
        else
            high = middle;
    }
    return low < clock->count ? entry_of(clock, low) : NULL;
}
