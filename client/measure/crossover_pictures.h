/* crossover_pictures.h: pictures of the renderers, side by side.
 * Flow:    a row's pictures and references -> [crossover_pictures] -> strips.png
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_MEASURE_CROSSOVER_PICTURES_H
#define LW_CLIENT_MEASURE_CROSSOVER_PICTURES_H

#include "client/measure/measure_store.h"

#define LW_CROSSOVER_STRIP_MAX 8u

/** A column; unit.repeat is not read. */
struct lw_crossover_strip {
    struct lw_measure_unit unit;
    const char *title; /* drawn on top; ASCII */
};

/** Writes strips.png into the row's folder. Each judged view has a line per crop: the reference first,
 * then the columns, all at one exposure, each pixel 2 x 2 large. A picture whose file is missing stays
 * grey.
 * Errors: LW_NO_INPUT where the references are not there; LW_NO_MEMORY, LW_IO, LW_CANNOT_CREATE. */
LW_MUST_CHECK enum lw_status lw_crossover_pictures_write(const struct lw_measure_store *store,
                                                         const struct lw_crossover_strip *strip,
                                                         uint32_t strip_count, struct lw_error *err);

#endif
