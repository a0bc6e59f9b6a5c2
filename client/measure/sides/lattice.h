/* lattice.h: the pixels of a picture that errors are measured at.
 * Threads: pure functions, [any].
 *
 * They are every stride-th one in each direction, in the middle of its stride x stride square. A picture of
 * width / stride x height / stride pixels with the same field of view has the same pixel centres, if the
 * stride is odd and divides both sides. */
#ifndef LW_CLIENT_MEASURE_SIDES_LATTICE_H
#define LW_CLIENT_MEASURE_SIDES_LATTICE_H

#include <stdint.h>

/** The largest odd stride up to 7 that divides both sides; 1 if there is none. */
uint32_t lw_lattice_stride(uint32_t width, uint32_t height);

/** Copies the lattice out of a whole picture. */
void lw_lattice_pick(const float *rgb, uint32_t width, uint32_t height, uint32_t stride, float *out_lattice);

#endif
