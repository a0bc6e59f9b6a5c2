/* client_lights.h: the lights whose direct light clients draw at their pixels: "client lights".
 * Flow:    scene, pose, --client-lights -> [client_lights] -> solver, WELCOME (client/lib reads it) ->
 *          composer
 * Threads: built by one; then [any].
 *
 * The shadow edges of small sources are sharper than a texel. A client draws them at the pixel, by a shadow
 * ray or a shadow map. The server solves the bounced light of client lights, and all light of the other
 * lights. */
#ifndef LW_COMMON_CLIENT_LIGHTS_H
#define LW_COMMON_CLIENT_LIGHTS_H

#include "common/light/lights.h"
#include "common/tile/tile_channels.h"

#include <stddef.h>

/* Under "auto" an emissive material is a client light if no connected piece of it is larger than this. A lamp
 * shade, a street lamp and a ceiling panel are small enough; a window and a wall-sized screen are not. */
#define LW_CLIENT_LIGHTS_EXTENT_MAX_M 3.0f /* diagonal of a piece's box */
#define LW_CLIENT_LIGHTS_AREA_MAX_M2  2.0f

struct lw_client_lights {
    uint32_t light_count, material_count; /* the scene's */
    uint8_t *light, *material;            /* 1: clients draw it */
    uint32_t drawn_lights, drawn_materials;
};

/** names    "auto": suns, points, spots, and emissive materials in small pieces, unless the scene itself
 *          decides (drawn_by); "lamps": only suns, points and spots; "none"; or names of lights and emissive
 *          materials, separated by commas. NULL: as "auto". A material that does not emit now stays with the
 *          server
 *  pose     where the pieces are measured
 *  Errors   LW_USAGE for a name that the scene lacks, a material that emits nothing, or an empty name;
 *           LW_NO_MEMORY. *client is zeroed then */
LW_MUST_CHECK enum lw_status lw_client_lights_init(struct lw_client_lights *client,
                                                   const struct lw_scene *scene, const struct lw_pose *pose,
                                                   const char *names, struct lw_error *err);
/** Zeroed ones are fine. */
void lw_client_lights_finish(struct lw_client_lights *client);

/** Whether clients draw anything. NULL: no. */
static inline bool lw_client_lights_any(const struct lw_client_lights *client) {
    return client && client->drawn_lights + client->drawn_materials > 0;
}

/** The lights that clients draw (drawn) or the server keeps: for lw_lights_init_part().
 * client outlives it. */
static inline struct lw_lights_part lw_client_lights_part(const struct lw_client_lights *client, bool drawn) {
    return (struct lw_lights_part){
        .light = client->light, .material = client->material, .value = drawn, .sky = !drawn};
}

/* ---- on the wire: a bit for each, the least significant of a byte first ---- */

static inline size_t lw_client_lights_bytes(uint32_t count) { return (count + 7ul) / 8; }

/** out_light, out_material: lw_client_lights_bytes() of the scene's counts; all written. */
void lw_client_lights_write(const struct lw_client_lights *client, uint8_t *out_light, uint8_t *out_material);

#endif
