#include "server/solve/surface/standing.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

static bool may_stand(const struct lw_standing *s, const struct lw_pose *pose, uint32_t object) {
    return !pose->object_hidden[object] &&
           (lw_scene_is_spare(s->scene, object) || /* which hangs on no node */
            !pose->node_moves[s->scene->object[object].node]);
}

static bool stands_at_first(const struct lw_standing *s, const struct lw_pose *pose, uint32_t object) {
    return !lw_pose_object_moves(pose, s->scene, object) || may_stand(s, pose, object);
}

enum lw_status lw_standing_init(struct lw_standing *standing, const struct lw_scene *scene,
                                const struct lw_pose *pose) {
    const size_t count = scene->object_count + 1ul;
    *standing = (struct lw_standing){.scene = scene,
                                     .stands = calloc(count, sizeof *standing->stands),
                                     .stood = calloc(count, sizeof *standing->stood),
                                     .moved_frame = malloc(count * sizeof *standing->moved_frame)};
    if (!standing->stands || !standing->stood || !standing->moved_frame) {
        lw_standing_finish(standing);
        return LW_NO_MEMORY;
    }
    for (uint32_t o = 0; o < scene->object_count; o++) {
        standing->stands[o] = standing->stood[o] = stands_at_first(standing, pose, o);
        standing->moved_frame[o] = LW_STANDING_NEVER;
    }
    return LW_OK;
}

void lw_standing_finish(struct lw_standing *standing) {
    free(standing->stands);
    free(standing->stood);
    free(standing->moved_frame);
    *standing = (struct lw_standing){0};
}

static bool has_rested(const struct lw_standing *s, uint32_t object, uint64_t frame) {
    const uint64_t moved = s->moved_frame[object];
    LW_INVARIANT(moved == LW_STANDING_NEVER || moved <= frame);
    return moved == LW_STANDING_NEVER || frame - moved >= LW_STANDING_FRAMES;
}

bool lw_standing_take(struct lw_standing *standing, const struct lw_pose *was, const struct lw_pose *is,
                      uint64_t frame) {
    bool changed = false;
    if (was == is && !standing->waits) return false;
    memcpy(standing->stood, standing->stands, standing->scene->object_count * sizeof *standing->stands);
    standing->waits = false;
    for (uint32_t o = 0; o < standing->scene->object_count; o++) {
        const bool stood = standing->stands[o];
        bool moved = false;
        if (lw_pose_object_moves(is, standing->scene, o)) {
            moved = was != is && lw_pose_object_differs(was, is, o);
            standing->stands[o] =
                may_stand(standing, is, o) && (has_rested(standing, o, frame) || (stood && !moved));
            standing->waits |= may_stand(standing, is, o) && !standing->stands[o];
            if (moved && !is->object_hidden[o]) standing->moved_frame[o] = frame;
        }
        changed |= stood != standing->stands[o] || (stood && moved);
    }
    return changed;
}
