/* builtin.h: scenes that need no file: "builtin:cornell", "builtin:atrium", "builtin:city", and with an
 * argument "builtin:city:2". "builtin:atrium-matt" is the atrium of before it had finishes, byte for byte.
 * Threads: [any], one scene per call. */
#ifndef LW_COMMON_BUILTIN_H
#define LW_COMMON_BUILTIN_H

#include "common/scene/scene.h"

#define LW_BUILTIN_PREFIX "builtin:"

/** Builds a scene by its full name ("builtin:cornell"), without lightmap UVs.
 * Errors: LW_NO_INPUT, with the names of all scenes; LW_USAGE for an argument that the scene does not take,
 * or out of its range, with the range; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_builtin_build(const char *name, struct lw_scene **out_scene,
                                              struct lw_error *err);

/** Names with their one-line descriptions, for --help. Index from 0; NULL past the end. */
const char *lw_builtin_name(unsigned index);
const char *lw_builtin_about(unsigned index);

#endif
