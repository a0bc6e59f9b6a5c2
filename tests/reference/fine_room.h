/* fine_room.h: a room with tiles of finer levels, and who looks at them. */
#ifndef LW_TESTS_FINE_ROOM_H
#define LW_TESTS_FINE_ROOM_H

#include "common/lightmap/lightmap.h"
#include "tests/reference/room.h"

#include <stdlib.h>

/** A scene at twice its density, `finer` times over: the charts lie where they lie, magnified. */
static inline void fine_room_magnify(struct lw_scene *scene, uint32_t finer) {
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        struct lw_mesh *mesh = &scene->mesh[m];
        struct lw_vec2 *uv = lw_scene_alloc(scene, mesh->vertex_count, sizeof *uv);
        assert_non_null(uv);
        for (uint32_t v = 0; v < mesh->vertex_count; v++)
            uv[v] = (struct lw_vec2){mesh->lightmap_uv[v].x * (float)(1u << finer),
                                     mesh->lightmap_uv[v].y * (float)(1u << finer)};
        mesh->lightmap_uv = uv;
        mesh->atlas_width <<= finer;
        mesh->atlas_height <<= finer;
        mesh->back_offset <<= finer;
    }
}

static inline struct lw_scene *fine_room_scene(uint32_t finer) {
    const struct room room = room_with_two_lamps();
    struct lw_scene *scene = room_scene(&room);
    struct lw_error err = {0};
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 9}, NULL, &err),
                  &err);
    fine_room_magnify(scene, finer);
    return scene;
}

#define FINE_ROOM_IDS 4096u

/** Every tile of the finer levels has an id. */
static inline void fine_room_name_all(struct lw_atlas_map *map, const struct lw_scene *scene,
                                      uint32_t finer) {
    lw_support_ok(lw_atlas_map_init_finer(map, scene, finer, finer ? FINE_ROOM_IDS : 0), NULL);
    for (uint32_t o = 0; o < map->object_count; o++)
        for (uint32_t k = 1; k <= finer; k++)
            for (uint32_t t = 0; lw_atlas_map_has_tile(map, o, LW_ATLAS_FINER + k, t); t++)
                assert_true(lw_atlas_map_claim_tile(map, o, LW_ATLAS_FINER + k, t).v != UINT32_MAX);
}

static inline void fine_room_begin(struct room_solution *s, struct lw_scene *scene, uint32_t finer,
                                   struct lw_solver_desc desc) {
    struct lw_error err = {0};
    s->scene = scene;
    fine_room_name_all(&s->map, scene, finer);
    lw_support_ok(lw_pose_init(&s->pose, scene), NULL);
    desc.scene = scene;
    desc.atlas_map = &s->map;
    lw_support_ok(lw_solvers_create(NULL, &desc, &s->pose, &s->solver, &err), &err);
}

/** Somebody looks at all tiles of a level of some objects. */
static inline void fine_room_look_at(struct room_solution *s, uint32_t level, uint32_t first_object,
                                     uint32_t end_object) {
    uint8_t *interest = calloc(s->map.tile_count, 1);
    assert_non_null(interest);
    for (uint32_t id = 0; id < s->map.tile_count; id++) {
        const struct lw_tile_place *place = &s->map.place[id];
        const bool looked = place->width && place->object >= first_object && place->object < end_object;
        interest[id] = place->level == 0 || (looked && place->level == level);
    }
    lw_support_ok(s->solver->ops->set_interest(s->solver, interest, NULL), NULL);
    free(interest);
}

#endif
