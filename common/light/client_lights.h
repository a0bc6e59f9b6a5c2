/* client_lights.h: the lights whose direct light clients draw at their pixels: "client lights".
 * Flow:    scene, pose, --client-lights -> [client_lights] -> solver, WELCOME (client/lib reads it) ->
 *          composer
 * Threads: built by one; then [any].
 *
 * Shadows of small sources have edges that belong to the pixel, and cost a shadow ray or a shadow map there.
 * What client lights give by bounces stays the server's, and so does all light of the others. */
#ifndef LW_COMMON_CLIENT_LIGHTS_H
#define LW_COMMON_CLIENT_LIGHTS_H

#include "common/light/light_form.h"
#include "common/light/lights.h"

#include <stddef.h>

/* An emissive material is a client light by itself ("auto") if all its connected pieces are no larger than
 * this: a lamp's shade, a street lamp, a ceiling panel; no window, no screen that fills a wall. */
#define LW_CLIENT_LIGHTS_EXTENT_MAX_M 3.0f /* diagonal of a piece's box */
#define LW_CLIENT_LIGHTS_AREA_MAX_M2  2.0f

struct lw_client_lights {
    uint32_t light_count, material_count; /* the scene's */
    uint8_t *light, *material;            /* 1: clients draw it */
    uint32_t drawn_lights, drawn_materials;
};

/** names    "auto": suns, points, spots, and emissive materials in small pieces, but where the scene says who
 *           draws a light or what shines (drawn_by); "lamps": suns, points and
 *           spots alone; "none"; or names of lights and emissive materials, apart by commas. NULL: as
 *           "auto". What does not shine now by a material stays the server's
 *  pose     where the pieces are measured
 *  Errors   LW_USAGE for a name that the scene does not have, or of a material that does not shine, or of no
 *           letters; LW_NO_MEMORY. *client is zeroed then */
LW_MUST_CHECK enum lw_status lw_client_lights_init(struct lw_client_lights *client,
                                                   const struct lw_scene *scene, const struct lw_pose *pose,
                                                   const char *names, struct lw_error *err);
/** Zeroed ones are fine. */
void lw_client_lights_finish(struct lw_client_lights *client);

/** Whether clients draw anything. NULL: no. */
static inline bool lw_client_lights_any(const struct lw_client_lights *client) {
    return client && client->drawn_lights + client->drawn_materials > 0;
}

/** Those that clients draw (drawn) or the server keeps, for lw_lights_init_part(). client outlives it. */
static inline struct lw_lights_part lw_client_lights_part(const struct lw_client_lights *client, bool drawn) {
    return (struct lw_lights_part){
        .light = client->light, .material = client->material, .value = drawn, .sky = !drawn};
}

/* ---- on the wire: a bit for each, the least significant of a byte first ---- */

static inline size_t lw_client_lights_bytes(uint32_t count) { return (count + 7ul) / 8; }

/** out_light, out_material: lw_client_lights_bytes() of the scene's counts; all written. */
void lw_client_lights_write(const struct lw_client_lights *client, uint8_t *out_light, uint8_t *out_material);

#endif
