#include "client/view/compose/compose_texels.h"

#include <string.h>

/* The id of such a tile, which gets one; UINT32_MAX: none is left. */
static uint32_t fine_id(const struct lw_compose *compose, struct lw_compose_fine_ids *ids, uint32_t object,
                        int k, uint32_t x, uint32_t y) {
    const uint32_t level = lw_compose_level_number(k);
    struct lw_compose_fine_id *known = &ids->known[(object + 3 * x + 5 * y + level) % LW_COMPOSE_FINE_IDS];
    if (known->object != object || known->level != level || known->x != x || known->y != y)
        *known = (struct lw_compose_fine_id){object, level, x, y,
                                             lw_atlas_map_claim(compose->map, object, level, x, y).v};
    return known->id;
}

bool lw_compose_texels_claim_fine(const struct lw_compose *compose, struct lw_compose_fine_ids *ids,
                                  uint32_t object, int k, struct lw_vec2 uv, struct lw_compose_footprint *f) {
    const struct lw_compose_level *level = &compose->object[object].level[k];
    lw_compose_texels_footprint(level, k, uv, f);
    const uint32_t x[2] = {f->x.low / LW_TILE_SIDE, f->x.high / LW_TILE_SIDE},
                   y[2] = {f->y.low / LW_TILE_SIDE, f->y.high / LW_TILE_SIDE};
    bool known = true;
    for (unsigned i = 0; i < f->tile_count; i++) {
        f->tile[i] = fine_id(compose, ids, object, k, x[i & 1], y[i >> 1]);
        known &= f->tile[i] != UINT32_MAX;
    }
    return known;
}

bool lw_compose_texels_find_fine(const struct lw_compose *compose, uint32_t object, int k, struct lw_vec2 uv,
                                 struct lw_compose_footprint *f) {
    lw_compose_texels_footprint(&compose->object[object].level[k], k, uv, f);
    const uint32_t x[2] = {f->x.low / LW_TILE_SIDE, f->x.high / LW_TILE_SIDE},
                   y[2] = {f->y.low / LW_TILE_SIDE, f->y.high / LW_TILE_SIDE};
    for (unsigned i = 0; i < f->tile_count; i++) {
        f->tile[i] =
            lw_atlas_map_find(compose->map, object, lw_compose_level_number(k), x[i & 1], y[i >> 1]).v;
        if (f->tile[i] == UINT32_MAX) return false;
    }
    return true;
}

/* Blends the texels of a footprint of a finer level. of: by id, the tiles' texels; where a tile has none they
 * are 0. */
static struct lw_vec3 blend_fine(const struct lw_compose *compose, const float *const *of,
                                 const struct lw_compose_level *level, const struct lw_compose_footprint *f) {
    const uint32_t x[2] = {f->x.low, f->x.high}, y[2] = {f->y.low, f->y.high};
    float texel[12] = {0};
    for (unsigned i = 0; i < 4; i++) {
        const float *tile = of[f->tile[f->tile_count == 1 ? 0 : i] - compose->map->plain_count];
        const uint32_t left = x[i & 1] / LW_TILE_SIDE * LW_TILE_SIDE,
                       width = level->width - left < LW_TILE_SIDE ? level->width - left : LW_TILE_SIDE;
        if (tile) memcpy(texel + 3 * i, tile + 3 * (y[i >> 1] % LW_TILE_SIDE * width + x[i & 1] - left), 12);
    }
    return lw_compose_texels_blend(f, texel, (const size_t[4]){0, 3, 6, 9});
}

bool lw_compose_texels_read_fine(const struct lw_compose *compose, const struct lw_compose_level *level,
                                 const struct lw_compose_footprint *f, struct lw_compose_light *out) {
    if (!lw_compose_texels_here(compose, f)) return false;
    out->e = blend_fine(compose, compose->fine, level, f);
    out->direction =
        compose->has_directions ? blend_fine(compose, compose->fine_direction, level, f) : lw_vec3(0, 0, 0);
    return lw_compose_is_light(out->e);
}

struct lw_compose_light lw_compose_texels_stand_in(const struct lw_compose *compose,
                                                   const struct lw_compose_object *object, int first,
                                                   struct lw_vec2 uv, int *out_level) {
    struct lw_compose_light light;
    struct lw_compose_footprint f;
    for (int k = first; k < object->level_count; k++) {
        lw_compose_texels_footprint(&object->level[k], k, uv, &f);
        *out_level = k;
        if (lw_compose_texels_read(compose, &object->level[k], &f, &light)) return light;
    }
    for (int k = first - 1; k >= 0; k--) {
        lw_compose_texels_footprint(&object->level[k], k, uv, &f);
        *out_level = k;
        if (lw_compose_texels_read(compose, &object->level[k], &f, &light)) return light;
    }
    *out_level = (int)LW_ATLAS_LEVELS_MAX;
    return (struct lw_compose_light){.e = compose->stand_in};
}
