/* ctl_names.h: names of objects, lights and materials: by name or by #number.
 * Threads: pure functions, [any]. */
#ifndef LW_CLIENT_CTL_NAMES_H
#define LW_CLIENT_CTL_NAMES_H

#include "common/scene/scene_change.h"

/** The number of that kind in a scene, and the name of one (never NULL). */
uint32_t lw_ctl_names_count(const struct lw_scene *scene, enum lw_scene_change_of of);
const char *lw_ctl_names_of(const struct lw_scene *scene, enum lw_scene_change_of of, uint32_t i);

/** Finds one by its name, or by #number.
 * Errors: LW_USAGE, in one line: an unknown name, with similar ones; a name that several have, with their
 *         numbers; a number that is too large. */
LW_MUST_CHECK enum lw_status lw_ctl_names_find(const struct lw_scene *scene, enum lw_scene_change_of of,
                                               const char *text, uint32_t *out_index, struct lw_error *err);

/** Finds an emitter: a light, or a material where shines[material] is true. #number is a light's.
 * Errors: as above; a name that two have is refused, also where one is a light and one a material. */
LW_MUST_CHECK enum lw_status lw_ctl_names_find_shining(const struct lw_scene *scene, const bool *shines,
                                                       const char *text, enum lw_scene_change_of *out_of,
                                                       uint32_t *out_index, struct lw_error *err);

/** The number of edits from a to b: characters inserted, removed, replaced (Levenshtein 1965).
 * UINT32_MAX: one is too long. */
unsigned lw_ctl_names_distance(const char *a, const char *b);

#endif
