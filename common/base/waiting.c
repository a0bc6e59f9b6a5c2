#include "common/base/waiting.h"

#include <assert.h>
#include <stdbool.h>
#include <stdio.h>

#define HUNDREDTHS  100u
#define STAGE_SHIFT 8 /* in the word: the stage, above hundredths of it */

const char *lw_waiting_text(uint32_t stage) {
    switch (stage) {
#define X(number, name, text)                                                                                \
    case number:                                                                                             \
        return text;
        LW_WAITING_MAP(X)
#undef X
    default:
        return lw_waiting_text(LW_WAITING_UNKNOWN);
    }
}

void lw_waiting_line(uint32_t stage, float share, char out[LW_WAITING_LINE_SIZE]) {
    const bool counts = stage != LW_WAITING_UNKNOWN && stage < LW_WAITING_READY;
    /* to the nearest: a share of 0.29 is 28.999 hundredths */
    if (counts)
        snprintf(out, LW_WAITING_LINE_SIZE, "%s, %.0f %%", lw_waiting_text(stage), 100 * (double)share);
    else
        snprintf(out, LW_WAITING_LINE_SIZE, "%s", lw_waiting_text(stage));
}

void lw_waiting_raise(struct lw_waiting *waiting, enum lw_waiting_stage stage, uint64_t done,
                      uint64_t total) {
    if (!waiting) return;
    if (done > total) done = total;
    double share = total ? (double)done / (double)total : 0;
    if (stage == LW_WAITING_FIRST_LIGHT && waiting->parts) share = (waiting->part + share) / waiting->parts;
    assert(share >= 0 && share <= 1);
    const uint32_t word = (uint32_t)stage << STAGE_SHIFT | (uint32_t)(HUNDREDTHS * share);
    uint32_t before = atomic_load_explicit(&waiting->word, memory_order_relaxed);
    while (before < word && !atomic_compare_exchange_weak_explicit(
                                &waiting->word, &before, word, memory_order_relaxed, memory_order_relaxed)) {
    }
}

void lw_waiting_set_part(struct lw_waiting *waiting, uint32_t part, uint32_t parts) {
    if (!waiting) return;
    assert(part < parts);
    waiting->part = part;
    waiting->parts = parts;
}

struct lw_waiting_state lw_waiting_read(const struct lw_waiting *waiting) {
    const uint32_t word = atomic_load_explicit(&waiting->word, memory_order_relaxed);
    return (struct lw_waiting_state){(enum lw_waiting_stage)(word >> STAGE_SHIFT),
                                     (float)(word & ((1u << STAGE_SHIFT) - 1)) / HUNDREDTHS};
}
