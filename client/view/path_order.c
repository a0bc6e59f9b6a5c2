#include "client/view/path_order.h"

#include <assert.h>
#include <string.h>

#define BINS     256u
#define BOX_BITS 3u /* per axis */
#define BOXES    (1u << BOX_BITS)

/* One of 49 classes of normals: 7 x 7 cells of the octahedral map (Meyer et al. 2010). The axes, along which most
 * surfaces of buildings face, are in the middle of cells. */
static uint32_t normal_class(struct lw_vec3 n) {
    float norm = fabsf(n.x) + fabsf(n.y) + fabsf(n.z), u = n.x / norm, v = n.y / norm;
    if (n.z < 0) {
        float folded = (1 - fabsf(v)) * copysignf(1, u);
        v = (1 - fabsf(u)) * copysignf(1, v);
        u = folded;
    }
    return (uint32_t)(u * 3 + 3.5f) << 3 | (uint32_t)(v * 3 + 3.5f);
}

/* abc to a00b00c */
static uint32_t spread(uint32_t v) { return (v & 4u) << 4 | (v & 2u) << 2 | (v & 1u); }

static void sort_by_byte(const uint16_t *key, unsigned shift, const uint16_t *from, uint16_t *to,
                         unsigned count) {
    unsigned start[BINS] = {0};
    for (unsigned i = 0; i < count; i++) start[key[from[i]] >> shift & (BINS - 1)]++;
    for (unsigned bin = 0, sum = 0; bin < BINS; bin++) {
        unsigned size = start[bin];
        start[bin] = sum;
        sum += size;
    }
    for (unsigned i = 0; i < count; i++) to[start[key[from[i]] >> shift & (BINS - 1)]++] = from[i];
}

void lw_path_order(const struct lw_path_order_item *item, unsigned count, uint16_t *order) {
    assert(count <= LW_PATH_ORDER_MAX);
    struct lw_vec3 low = lw_vec3(INFINITY, INFINITY, INFINITY),
                   high = lw_vec3(-INFINITY, -INFINITY, -INFINITY);
    for (unsigned i = 0; i < count; i++) {
        const struct lw_vec3 p = item[i].position;
        low = lw_vec3(fminf(low.x, p.x), fminf(low.y, p.y), fminf(low.z, p.z));
        high = lw_vec3(fmaxf(high.x, p.x), fmaxf(high.y, p.y), fmaxf(high.z, p.z));
    }
    const struct lw_vec3 size = lw_vec3_sub(high, low);
    const float scale = (BOXES - 0.01f) / fmaxf(fmaxf(size.x, fmaxf(size.y, size.z)), 1e-30f);
    if (count == 0) return;
    uint16_t key[LW_PATH_ORDER_MAX], index[LW_PATH_ORDER_MAX], half_sorted[LW_PATH_ORDER_MAX];
    for (unsigned i = 0; i < count; i++) {
        struct lw_vec3 box = lw_vec3_scale(lw_vec3_sub(item[i].position, low), scale);
        uint32_t curve =
            spread((uint32_t)box.x) << 2 | spread((uint32_t)box.y) << 1 | spread((uint32_t)box.z);
        key[i] = (uint16_t)(normal_class(item[i].normal) << (3 * BOX_BITS) | curve);
        index[i] = (uint16_t)i;
    }
    sort_by_byte(key, 0, index, half_sorted, count);
    sort_by_byte(key, 8, half_sorted, index, count);
    uint16_t before[LW_PATH_ORDER_MAX];
    memcpy(before, order, count * sizeof *order);
    for (unsigned i = 0; i < count; i++) order[i] = before[index[i]];
}
