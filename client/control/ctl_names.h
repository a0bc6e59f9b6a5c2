/* ctl_names.h: what somebody calls an object, a light, a material: by name or by #number.
 * Threads: pure functions, [any]. */
#ifndef LW_CLIENT_CTL_NAMES_H
#define LW_CLIENT_CTL_NAMES_H

#include "common/scene/scene_change.h"

/** How many of that kind a scene has, and what one of them is called (never NULL). */
uint32_t lw_ctl_names_count(const struct lw_scene *scene, enum lw_scene_change_of of);
const char *lw_ctl_names_of(const struct lw_scene *scene, enum lw_scene_change_of of, uint32_t i);

/** Finds one by its name, or by #number.
 * Errors: LW_USAGE, in one line: a name that nothing has, with those that are near; one that several have,
 * with their numbers; a number that is too large. */
LW_MUST_CHECK enum lw_status lw_ctl_names_find(const struct lw_scene *scene, enum lw_scene_change_of of,
                                               const char *text, uint32_t *out_index, struct lw_error *err);

/** Finds what shines: a light, or a material where shines[material] is true. #number is a light's.
 * Errors: as above; a name that two have is refused, be one of them a light and one a material. */
LW_MUST_CHECK enum lw_status lw_ctl_names_find_shining(const struct lw_scene *scene, const bool *shines,
                                                       const char *text, enum lw_scene_change_of *out_of,
                                                       uint32_t *out_index, struct lw_error *err);

/** Edits from one to the other: characters put in, left out, exchanged (Levenshtein 1965).
 * UINT32_MAX: one is too long. */
unsigned lw_ctl_names_distance(const char *a, const char *b);

#endif
