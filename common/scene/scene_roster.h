/* scene_roster.h: the set of objects in a scene, and the set of spares that may be added to it.
 * Flow:    changes, in order -> [roster] -> the object of each change, or why it is invalid
 * Threads: one thread at a time.
 *
 * Two rosters of a scene that take the same changes in the same order choose the same objects. So a server
 * can answer an update at once, and make its changes at the next frame, where they cannot fail. */
#ifndef LW_COMMON_SCENE_ROSTER_H
#define LW_COMMON_SCENE_ROSTER_H

#include "common/scene/scene_change.h"

struct lw_scene_roster {
    const struct lw_scene *scene;
    uint32_t *place;         /* per object: in the order of meshes, and within a mesh of numbers */
    uint32_t *object;        /* per place */
    uint32_t *first;         /* per mesh, and one more: its first place */
    uint64_t *spare, *saved; /* a bit per place */
    size_t words;            /* in each of them */
};

/** The scene as it begins, which outlives the roster. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_scene_roster_init(struct lw_scene_roster *roster,
                                                  const struct lw_scene *scene);
/** A zeroed roster is fine. */
void lw_scene_roster_finish(struct lw_scene_roster *roster);

/** Takes over a change that lw_scene_change_check() has passed. *out_object: for an OBJECT_ADD the spare that
 * now stands there, the first of its mesh. For another change of an object it is this object. Else it stays.
 * Returns LW_SCENE_CHANGE_OK; NO_SPARE or ABSENT, with LW_BAD_DATA and one line in *err: then nothing has
 * changed. */
enum lw_scene_change_code lw_scene_roster_take(struct lw_scene_roster *roster,
                                               const struct lw_scene_change *change, uint32_t *out_object,
                                               struct lw_error *err);

/** Saves the state; the next call of lw_scene_roster_go_back() returns to it. */
void lw_scene_roster_save(struct lw_scene_roster *roster);
void lw_scene_roster_go_back(struct lw_scene_roster *roster);

bool lw_scene_roster_is_spare(const struct lw_scene_roster *roster, uint32_t object);

#endif
