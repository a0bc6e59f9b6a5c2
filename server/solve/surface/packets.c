#include "server/solve/surface/packets.h"

#include "common/base/invariant.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LANES LW_TRACE_WIDTH
/* Normals that no two of a group differ by more than: some 18 degrees, as for Embree's
 * coherent traversal (bounces.c). */
#define NORMALS_APART 0.31f
/* What a group may measure across, over the root of its area: a square has 1.4. */
#define ELONGATION 1.6f

#define AXES 6 /* position, then normal */

struct member {
    float at[AXES];
    uint8_t texel; /* 16 y + x */
    uint8_t region;
    uint8_t turn; /* along a Morton curve over the block: 16 in a row are 4 x 4 texels */
};

struct extent {
    float size[AXES];
};

static uint8_t turn_of(uint32_t x, uint32_t y) {
    uint32_t turn = 0;
    for (uint32_t bit = 0; bit < 4; bit++)
        turn |= (x >> bit & 1) << (2 * bit) | (y >> bit & 1) << (2 * bit + 1);
    return (uint8_t)turn;
}

static struct extent extent_of(const struct member *member, uint32_t count) {
    struct extent e;
    for (int a = 0; a < AXES; a++) {
        float lo = INFINITY, hi = -INFINITY;
        for (uint32_t i = 0; i < count; i++) {
            lo = fminf(lo, member[i].at[a]);
            hi = fmaxf(hi, member[i].at[a]);
        }
        e.size[a] = hi - lo;
    }
    return e;
}

static float diagonal(const float size[3]) {
    return sqrtf(size[0] * size[0] + size[1] * size[1] + size[2] * size[2]);
}

static int compare_turns(const void *left, const void *right) {
    const struct member *a = left, *b = right;
    return (int)a->turn - (int)b->turn;
}

static int compare_along(const void *left, const void *right, void *axis) {
    const struct member *a = left, *b = right;
    const float x = a->at[*(const int *)axis], y = b->at[*(const int *)axis];
    return x != y ? (x < y ? -1 : 1) : (int)a->turn - (int)b->turn;
}

/* The packets of one group take turns with its texels. */
static uint32_t deal(struct member *member, uint32_t count, struct lw_packet *out) {
    const uint32_t packets = (count + LANES - 1) / LANES;
    LW_INVARIANT(packets > 0 && packets <= LW_PACKETS_MAX);
    qsort(member, count, sizeof *member, compare_turns);
    for (uint32_t k = 0; k < packets; k++) {
        out[k].count = 0;
        out[k].group = (uint8_t)packets;
        memset(out[k].lanes, 0, sizeof out[k].lanes);
        for (uint32_t i = k; i < count; i += packets) {
            out[k].texel[out[k].count++] = member[i].texel;
            out[k].lanes[member[i].region]++;
        }
    }
    return packets;
}

/* Halves a group until it lies on one surface. spacing: of texels, m in object space. */
static uint32_t split(struct member *member, uint32_t count, float spacing, struct lw_packet *out) {
    uint32_t packets = 0;
    while (count > LANES) {
        const struct extent e = extent_of(member, count);
        const float far = diagonal(e.size) / (ELONGATION * spacing * sqrtf((float)count)),
                    turned = diagonal(e.size + 3) / NORMALS_APART;
        if (!(far > 1 || turned > 1)) break;
        int axis = turned > far ? 3 : 0;
        for (int a = axis + 1, end = axis + 3; a < end; a++)
            if (e.size[a] > e.size[axis]) axis = a;
        qsort_r(member, count, sizeof *member, compare_along, &axis);
        const uint32_t first = (count / 2 + LANES / 2) / LANES * LANES; /* at least 16, if count >= 17 */
        LW_INVARIANT(first > 0 && first < count);
        packets += split(member, first, spacing, out + packets);
        member += first;
        count -= first;
    }
    return packets + deal(member, count, out + packets);
}

/* Each covered texel is in one packet, and its region is counted there. */
static bool has_each_once(const struct lw_packet *packet, uint32_t packets, uint32_t count) {
    bool seen[LW_TILE_BLOCK * LW_TILE_BLOCK] = {false};
    for (uint32_t k = 0; k < packets; k++) {
        uint32_t lanes = 0;
        for (uint32_t r = 0; r < LW_REGIONS; r++) lanes += packet[k].lanes[r];
        if (!packet[k].count || lanes != packet[k].count) return false;
        for (uint32_t lane = 0; lane < packet[k].count; lane++, count--) {
            if (seen[packet[k].texel[lane]]) return false;
            seen[packet[k].texel[lane]] = true;
        }
    }
    return !count;
}

uint32_t lw_packets_deal(const struct lw_mesh_texels *mesh, uint32_t first, uint32_t stride, uint32_t width,
                         uint32_t height, const uint8_t *covered, const uint8_t *region,
                         struct lw_packet out[LW_PACKETS_MAX]) {
    struct member member[LW_TILE_BLOCK * LW_TILE_BLOCK];
    uint32_t count = 0;
    float reach = 0;
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            if (!covered[y * stride + x]) continue;
            const uint32_t i = first + y * stride + x;
            const struct lw_vec3 p = lw_texels_vector(mesh->position, i),
                                 n = lw_packed_normal_unpack(mesh->normal[i]);
            member[count++] = (struct member){.at = {p.x, p.y, p.z, n.x, n.y, n.z},
                                              .texel = (uint8_t)(y * LW_TILE_BLOCK + x),
                                              .region = region[y * stride + x],
                                              .turn = turn_of(x, y)};
            reach += lw_packed_length_unpack(mesh->sample_points.reach[i]);
        }
    /* Places reach half a texel to both sides along its axes. */
    const uint32_t packets = count ? split(member, count, fmaxf(2 * reach / (float)count, 1e-30f), out) : 0;
    LW_INVARIANT(packets == (count + LANES - 1) / LANES); /* as few as there can be */
    LW_INVARIANT_DEAR(has_each_once(out, packets, count));
    return packets;
}
