#include "server/solve/adapt/motion.h"

#include "common/base/invariant.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum lw_status lw_motion_init(struct lw_motion *motion, uint32_t objects) {
    *motion = (struct lw_motion){.moved = calloc((size_t)objects + 1, sizeof *motion->moved)};
    return motion->moved ? LW_OK : LW_NO_MEMORY;
}

void lw_motion_finish(struct lw_motion *motion) {
    free(motion->moved);
    motion->moved = NULL;
}

static void add_places(struct lw_motion *motion, struct lw_vec3 was, struct lw_vec3 is) {
    if (motion->place_count + 2 > LW_MOTION_PLACES_MAX) return;
    motion->place_ws[motion->place_count++] = was;
    motion->place_ws[motion->place_count++] = is;
}

static void note_places(struct lw_motion *motion, const struct lw_tiles *tiles, const struct lw_scene *scene,
                        const struct lw_pose *was, const struct lw_pose *is) {
    uint32_t last = UINT32_MAX;
    motion->place_count = 0;
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (scene->light[i].kind != LW_LIGHT_DIRECTIONAL &&
            memcmp(&was->light[i], &is->light[i], sizeof *is->light) != 0)
            add_places(motion, was->light[i].position_ws, is->light[i].position_ws);
    for (uint32_t o = 0; o < scene->object_count; o++) motion->moved[o] = lw_pose_object_differs(was, is, o);
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        const uint32_t object = tile->object;
        if (object == last || !motion->moved[object] || tile->fine_pair) continue;
        last = object;
        add_places(motion, lw_affine_point(&was->object_to_world[object], tile->centre_os),
                   lw_affine_point(&is->object_to_world[object], tile->centre_os));
    }
}

void lw_motion_note(struct lw_motion *motion, const struct lw_tiles *tiles, const struct lw_scene *scene,
                    const struct lw_pose *was, const struct lw_pose *is, bool shines) {
    note_places(motion, tiles, scene, was, is);
    motion->moves++;
    if (shines) motion->light_moves = motion->moves;
    if (motion->moves == 1 || motion->frames_since_move > LW_MOTION_STILL_FRAMES) {
        motion->began = motion->moves;
        motion->shone = shines;
    }
    motion->frames_since_move = 0;
    LW_INVARIANT(motion->began <= motion->moves && motion->light_moves <= motion->moves);
    LW_INVARIANT(motion->place_count <= LW_MOTION_PLACES_MAX);
}

float lw_motion_distance(const struct lw_motion *motion, const struct lw_solve_tile *tile) {
    float distance = motion->place_count ? INFINITY : 0;
    if (motion->moved[tile->object]) return -1;
    for (uint32_t k = 0; k < motion->place_count; k++)
        distance = fminf(distance,
                         lw_vec3_length(lw_vec3_sub(tile->centre_ws, motion->place_ws[k])) - tile->radius_m);
    return fmaxf(distance, 0);
}
