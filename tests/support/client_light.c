#include "tests/support/client_light.h"

bool client_light_is_whole(const struct lw_client *client, float error_max) {
    const struct lw_atlas_map *map = lw_client_atlas_map(client);
    for (uint32_t t = 0; map && t < map->tile_count; t++) {
        const struct lw_client_tile tile = lw_client_get_tile(client, (lw_tile_id){t});
        if (lw_client_object_hidden(client, map->place[t].object)) continue; /* nobody lights it */
        if (!tile.version || tile.error > error_max) return false;
    }
    return map != NULL;
}

double client_light_total(const struct lw_client *client) {
    double sum = 0;
    for (uint32_t o = 0; o < lw_client_atlas_map(client)->object_count; o++) {
        const struct lw_client_level level = lw_client_get_level(client, o, 0);
        for (size_t i = 0; i < (size_t)3 * level.width * level.height; i++) sum += (double)level.rgb[i];
    }
    return sum;
}
