/* damage.h: bytes of a package, damaged in every place in turn. A reader refuses them, or they are sound. */
#ifndef LW_TESTS_DAMAGE_H
#define LW_TESTS_DAMAGE_H

#include "common/base/status.h"

#include <stdint.h>

/** Reads a package. Errors: LW_BAD_DATA with a text. err may be NULL. */
typedef enum lw_status damage_reader(const uint8_t *bytes, size_t size, struct lw_error *err);

/** Ends the test unless each shorter package is refused, also where its header has the shorter size. */
void damage_cut(uint8_t *bytes, size_t size, damage_reader *read);

/** Flips each bit. Ends the test unless the package is sound or refused; returns how often it is refused. */
size_t damage_flip(uint8_t *bytes, size_t size, damage_reader *read);

/** Gives each word of 4 bytes extreme values. Ends the test unless the package is sound or refused. */
void damage_words(uint8_t *bytes, size_t size, damage_reader *read);

#endif
