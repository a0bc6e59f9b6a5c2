/* beside.h: finds the files that a scene names: textures, material libraries. Their paths are often those of
 * another machine.
 * Threads: [any]. */
#ifndef LW_IMPORT_BESIDE_H
#define LW_IMPORT_BESIDE_H

#include "common/base/status.h"

/** Looks for `wanted` in the folder of the scene and below, never elsewhere. Tries the path itself if it
 * stays inside, then its last parts, then its base name in the folder, in textures, texture, tex, maps,
 * images, materials and in SCENE.fbm. Backslashes count as slashes, file:// and %-escapes are read as such
 * if nothing has that very name; upper and lower case count only if both exist.
 * folder     of the scene
 * scene      base name of the scene, for SCENE.fbm
 * out_path   malloc'ed; a regular file, from the folder on. Links may lead out of it: open it by
 *            lw_file_read_beneath()
 * False if there is none; NULL in *out_path when out of memory. */
LW_MUST_CHECK bool lw_beside_find(const char *folder, const char *scene, const char *wanted, char **out_path);

#endif
