/* patches.h: the texels of a scene as patches of radiosity: place, normal, area, albedo, emission.
 * Flow:    texels, pose -> [patches] -> shooters, receivers of a pass
 * Threads: built by one thread, workers inside; then [any].
 * After:   Kahl 2023 (texels of a lightmap are the patches).
 *
 * The area of a texel is exact in sum: the area of each triangle in the world goes to the texels that it
 * covers in the lightmap. What of a texel lies inside other objects does not count. Patches stand in packets
 * of sixteen, as the blocks of tiles deal them (packets.h): neighbours on one surface. */
#ifndef LW_RADIOSITY_PATCHES_H
#define LW_RADIOSITY_PATCHES_H

#include "common/base/points16.h"
#include "common/light/lights.h"
#include "server/solve/state/tiles.h"

struct lw_patches_packet {
    struct lw_points16 at; /* world space, off the surface by what rounding moves (sample_points.h) */
    uint32_t texel[LW_TRACE_WIDTH]; /* in the global numbering; lanes that are not active repeat the first */
    uint16_t active;
    bool coherent; /* normals agree: rays about them run nearly parallel */
};

struct lw_patches {
    const struct lw_tiles *tiles;
    const struct lw_texels *texels;
    struct lw_patches_packet *packet;
    uint32_t *first_packet;                        /* per tile */
    uint32_t packet_capacity, packet_count, count; /* count: covered texels that are not hidden */
    /* Per texel of the global numbering. */
    float *area_m2;
    uint32_t *place; /* where it is among the packets: 16 x packet + lane; LW_TEXEL_NONE: in none */
    /* Radiance that each sends by itself, W/(m^2 sr), 3 floats; NULL: nothing emits. */
    float (*emission)[3];
};

/** Collects what tiles cover. Both outlive the patches. Errors: LW_NO_MEMORY; finish them then. */
LW_MUST_CHECK enum lw_status lw_patches_init(struct lw_patches *patches, const struct lw_tiles *tiles,
                                             const struct lw_texels *texels);
/** A zeroed one is fine. */
void lw_patches_finish(struct lw_patches *patches);

/** Takes areas and emission from a pose, and what tiles cover now. lights: all that emit.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_patches_set_pose(struct lw_patches *patches, const struct lw_pose *pose,
                                                 const struct lw_lights *lights, int threads);

/** Chooses where on its texel each patch lies. turn 0: the usable sample point next to the middle of all of
 * them; others: each texel's points in turn. */
void lw_patches_place(struct lw_patches *patches, const struct lw_pose *pose, uint32_t turn, int threads);

size_t lw_patches_memory_bytes(const struct lw_patches *patches);

/** Position and normal of a placed patch, world space. */
static inline struct lw_vec3 lw_patches_place_of(const struct lw_patches *patches, uint32_t texel,
                                                 struct lw_vec3 *out_normal) {
    const uint32_t place = patches->place[texel], lane = place % LW_TRACE_WIDTH;
    LW_INVARIANT_DEAR(place / LW_TRACE_WIDTH < patches->packet_count);
    const struct lw_points16 *at = &patches->packet[place / LW_TRACE_WIDTH].at;
    *out_normal = lw_vec3(at->nx[lane], at->ny[lane], at->nz[lane]);
    return lw_vec3(at->x[lane], at->y[lane], at->z[lane]);
}

#endif
