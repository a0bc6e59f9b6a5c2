#include "client/measure/sides/lattice.h"

#include <string.h>

#define STRIDE_MAX 7u

uint32_t lw_lattice_stride(uint32_t width, uint32_t height) {
    for (uint32_t stride = STRIDE_MAX; stride > 1; stride -= 2)
        if (width % stride == 0 && height % stride == 0) return stride;
    return 1;
}

void lw_lattice_pick(const float *rgb, uint32_t width, uint32_t height, uint32_t stride, float *out_lattice) {
    for (uint32_t y = stride / 2; y < height; y += stride)
        for (uint32_t x = stride / 2; x < width; x += stride, out_lattice += 3)
            memcpy(out_lattice, rgb + 3 * ((size_t)y * width + x), 3 * sizeof *rgb);
}
