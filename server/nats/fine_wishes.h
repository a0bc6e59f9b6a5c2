/* fine_wishes.h: the tiles of finer levels that relays want, all of them together.
 * Flow:    lists of relays -> [fine_wishes: in turns] -> names for the solver
 * Threads: one thread at a time.
 *
 * Relays take turns: the first tile of each list comes first, then the second one of each. A relay with a
 * long list takes no place from one with a short list. */
#ifndef LW_NATS_FINE_WISHES_H
#define LW_NATS_FINE_WISHES_H

#include "common/base/status.h"

#include <stddef.h>
#include <stdint.h>

struct lw_fine_wishes {
    struct lw_fine_wish {
        uint64_t name;
        size_t turn;
    } * wish;
    size_t count, capacity;
};

/** Adds a list of names. Errors: LW_NO_MEMORY; then nothing is added. */
LW_MUST_CHECK enum lw_status lw_fine_wishes_add(struct lw_fine_wishes *wishes, const uint64_t *name,
                                                size_t count);
/** Empties it into a list of the first `most` names, each once. name: room for `most`. Returns how many there
 * are. */
size_t lw_fine_wishes_take(struct lw_fine_wishes *wishes, uint64_t *name, size_t most);
/** A zeroed one is fine, and is an empty one. */
void lw_fine_wishes_finish(struct lw_fine_wishes *wishes);

#endif
