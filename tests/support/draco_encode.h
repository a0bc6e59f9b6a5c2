/* draco_encode.h: Draco streams for tests, by libdraco's encoder. */
#ifndef LW_TESTS_DRACO_ENCODE_H
#define LW_TESTS_DRACO_ENCODE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Encodes a mesh. Unique ids of attributes: 0 is positions, 3 floats, 1 normals, 3 floats, 2 colours, 4
 * normalised bytes. Without quantisation, so that decoded values are the encoded ones.
 * edgebreaker  or one triangle after the other
 * Returns the size of the stream; 0 if it fails or does not fit. */
size_t lw_draco_encode(const float *position, const float *normal, const uint8_t *colour,
                       uint32_t vertex_count, const uint32_t *index, uint32_t triangle_count,
                       bool edgebreaker, uint8_t *out, size_t capacity);

#ifdef __cplusplus
}
#endif

#endif
