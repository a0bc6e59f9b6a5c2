/* map_names.h: file names for the objects' maps, safe on every file system.
 *
 * The rule: of an object's name, letters and digits of ASCII, '.', '_' and '-' are kept. Each run of anything
 * else becomes one '_'. Dots and dashes at the beginning are dropped, and names are cut at 100 bytes. A
 * name that is then empty is "object", and one that Windows keeps for a device gets a '_' behind it. If
 * several objects have one name (in any case of letters), later ones get "-2", "-3" and so on. Then comes
 * ".exr". So a file never lies outside the folder, is never hidden, and no two objects share one.
 * Threads: one lw_map_names belongs to one thread. */
#ifndef LW_BAKE_MAP_NAMES_H
#define LW_BAKE_MAP_NAMES_H

#include "common/scene/scene.h"

#define LW_MAP_NAMES_STEM_MAX 100u /* bytes of a name, before a number and ".exr" */

struct lw_map_names {
    uint32_t count;
    char **file; /* per object: "Table_lamp-2.exr" */
};

/** Names the map of every object, in order. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_map_names_init(struct lw_map_names *names, const struct lw_scene *scene);
void lw_map_names_finish(struct lw_map_names *names);

#endif
