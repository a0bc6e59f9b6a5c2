#include "client/view/lights/drawn_lights.h"

#include <stdlib.h>
#include <string.h>

enum lw_status lw_drawn_lights_init(struct lw_client_lights *drawn, const struct lw_client *client) {
    const struct lw_client_draws *draws = lw_client_draws(client);
    *drawn = (struct lw_client_lights){0};
    if (!draws) return LW_OK;
    struct lw_client_lights d = {.light_count = draws->light_count, .material_count = draws->material_count};
    d.light = calloc(d.light_count + 1ul, 1);
    d.material = calloc(d.material_count + 1ul, 1);
    if (!d.light || !d.material) {
        lw_client_lights_finish(&d);
        return LW_NO_MEMORY;
    }
    memcpy(d.light, draws->light, d.light_count);
    memcpy(d.material, draws->material, d.material_count);
    for (uint32_t l = 0; l < d.light_count; l++) d.drawn_lights += d.light[l] != 0;
    for (uint32_t m = 0; m < d.material_count; m++) d.drawn_materials += d.material[m] != 0;
    *drawn = d;
    return LW_OK;
}

bool lw_drawn_lights_follow(const struct lw_client_lights *drawn, const struct lw_client *client,
                            struct lw_pose *pose) {
    bool changed = false;
    for (uint32_t l = 0; l < drawn->light_count; l++) {
        if (!drawn->light[l]) continue;
        const struct lw_client_light light = lw_client_get_light(client, l);
        const struct lw_light_state state = {.position_ws = light.position_ws,
                                             .direction_ws = light.direction_ws,
                                             .intensity = light.intensity};
        changed |= memcmp(&pose->light[l], &state, sizeof state) != 0;
        pose->light[l] = state;
    }
    return changed;
}
