/* glb.h: a binary glTF file in memory, for tests that make their own. */
#ifndef LW_TESTS_GLB_H
#define LW_TESTS_GLB_H

#include <stddef.h>
#include <stdint.h>

/** A .glb of a JSON text, in which ' stands for ", and a binary chunk; the caller frees it. */
uint8_t *lw_glb_pack(const char *json, const void *data, size_t data_size, size_t *out_size);

/** Writes a 32-bit number, little-endian. */
void lw_glb_put_word(uint8_t *at, size_t value);

#endif
