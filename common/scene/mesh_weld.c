#include "common/scene/mesh_weld.h"

#include <stdlib.h>
#include <string.h>

static uint64_t mix(uint64_t x) {
    x = (x ^ (x >> 32)) * 0xd6e8feb86659fd93u;
    x = (x ^ (x >> 32)) * 0xd6e8feb86659fd93u;
    return x ^ (x >> 32);
}

static uint64_t position_hash(struct lw_vec3 p) {
    uint32_t bits[3];
    memcpy(bits, &p, sizeof bits);
    return mix(mix((uint64_t)bits[0] << 32 | bits[1]) + bits[2]);
}

enum lw_status lw_mesh_weld(const struct lw_mesh *mesh, uint32_t *out_weld, uint32_t *out_weld_count) {
    size_t capacity = 16;
    while (capacity < (size_t)mesh->vertex_count * 2) capacity *= 2;
    uint32_t *slot = malloc(capacity * sizeof *slot);
    if (!slot) return LW_NO_MEMORY;
    memset(slot, 0xff, capacity * sizeof *slot);
    uint32_t count = 0;
    for (uint32_t v = 0; v < mesh->vertex_count; v++) {
        /* adding zero makes -0 and +0 the same bits */
        struct lw_vec3 p = lw_vec3_add(mesh->position[v], lw_vec3(0, 0, 0));
        size_t at = position_hash(p) & (capacity - 1);
        for (;; at = (at + 1) & (capacity - 1)) {
            uint32_t other = slot[at];
            if (other == LW_SCENE_NONE) {
                slot[at] = v;
                out_weld[v] = count++;
                break;
            }
            struct lw_vec3 q = mesh->position[other];
            if (p.x == q.x && p.y == q.y && p.z == q.z) {
                out_weld[v] = out_weld[other];
                break;
            }
        }
    }
    free(slot);
    *out_weld_count = count;
    return LW_OK;
}
