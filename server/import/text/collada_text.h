/* collada_text.h: a Collada file with what Assimp would guess spelled out, where its guess is not what the
 * file says: a spot without an exponent is hard, a camera with an angle of its height is as high as that
 * says, an orthographic camera is none.
 * Flow:    bytes of the file -> [collada_text] -> bytes for Assimp
 * Threads: values only. */
#ifndef LW_IMPORT_TEXT_COLLADA_TEXT_H
#define LW_IMPORT_TEXT_COLLADA_TEXT_H

#include "common/base/status.h"

#include <stdint.h>

/** *out_text is malloc'ed. Text that is no XML stays as it is. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_collada_text_mend(const uint8_t *bytes, size_t size, uint8_t **out_text,
                                                  size_t *out_size, struct lw_error *err);

#endif
