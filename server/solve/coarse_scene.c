#include "server/solve/coarse_scene.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

static enum lw_status scale_meshes(struct lw_coarse_scene *coarse, const struct lw_scene *original) {
    const float scale = 1.0f / LW_COARSE_SCENE_SIDE;
    size_t vertices = 0;
    for (uint32_t m = 0; m < original->mesh_count; m++) vertices += original->mesh[m].vertex_count;
    coarse->mesh = malloc((original->mesh_count + 1ul) * sizeof *coarse->mesh);
    coarse->uv = malloc((vertices + 1) * sizeof *coarse->uv);
    if (!coarse->mesh || !coarse->uv) return LW_NO_MEMORY;
    struct lw_vec2 *uv = coarse->uv;
    for (uint32_t m = 0; m < original->mesh_count; m++) {
        const struct lw_mesh *from = &original->mesh[m];
        struct lw_mesh *to = &coarse->mesh[m];
        LW_INVARIANT(from->atlas_width % LW_COARSE_SCENE_SIDE == 0 &&
                     from->atlas_height % LW_COARSE_SCENE_SIDE == 0 &&
                     from->back_offset % LW_COARSE_SCENE_SIDE == 0);
        *to = *from;
        to->atlas_width /= LW_COARSE_SCENE_SIDE;
        to->atlas_height /= LW_COARSE_SCENE_SIDE;
        to->back_offset /= LW_COARSE_SCENE_SIDE;
        to->lightmap_uv = uv;
        for (uint32_t v = 0; v < from->vertex_count; v++)
            *uv++ = (struct lw_vec2){from->lightmap_uv[v].x * scale, from->lightmap_uv[v].y * scale};
    }
    coarse->scene.mesh = coarse->mesh;
    return LW_OK;
}

enum lw_status lw_coarse_scene_init(struct lw_coarse_scene *coarse, const struct lw_scene *original) {
    *coarse = (struct lw_coarse_scene){.mesh = NULL};
    enum lw_status status = lw_scene_init_variant(&coarse->scene, original);
    if (status == LW_OK) status = scale_meshes(coarse, original);
    if (status == LW_OK) status = lw_atlas_map_init(&coarse->map, &coarse->scene);
    if (status != LW_OK) lw_coarse_scene_finish(coarse);
    return status;
}

void lw_coarse_scene_finish(struct lw_coarse_scene *coarse) {
    lw_atlas_map_finish(&coarse->map);
    lw_scene_finish_variant(&coarse->scene);
    free(coarse->mesh);
    free(coarse->uv);
    *coarse = (struct lw_coarse_scene){.mesh = NULL};
}

lw_tile_id lw_coarse_scene_below(const struct lw_atlas_map *map, const struct lw_tile_place *place) {
    const uint32_t up = LW_COARSE_SCENE_SHIFT + lw_atlas_finer(place->level);
    return lw_atlas_map_find(map, place->object, 0, (uint32_t)place->x >> up, (uint32_t)place->y >> up);
}

void lw_coarse_scene_key(const uint8_t key[16], uint8_t out_key[16]) {
    memcpy(out_key, key, 16);
    out_key[0] ^= 0xff;
}

uint64_t lw_coarse_scene_count_texels(const struct lw_scene *scene) {
    uint64_t texels = 0;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        texels += (uint64_t)mesh->atlas_width * mesh->atlas_height;
    }
    return texels;
}

void lw_coarse_scene_follow(struct lw_scene *variant, const struct lw_scene *scene) {
    LW_INVARIANT(variant->material_count == scene->material_count && variant->material != scene->material);
    if (scene->material_count)
        memcpy(variant->material, scene->material, scene->material_count * sizeof *scene->material);
    memcpy(variant->sky, scene->sky, sizeof variant->sky);
}
