/* foreign_animation.h: Assimp's keyed nodes become the channels of a scene. All animations of a file play
 * together, as those of a glTF file do. */
#ifndef LW_IMPORT_FOREIGN_FOREIGN_ANIMATION_H
#define LW_IMPORT_FOREIGN_FOREIGN_ANIMATION_H

#include "server/import/foreign/foreign_node.h"

/** Adds channels and the duration to a scene whose nodes are complete. An animated node loses its matrix.
 * Errors: LW_BAD_DATA naming the animation; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_foreign_animation_convert(struct lw_foreign_import *import,
                                                          const struct lw_foreign_nodes *nodes,
                                                          struct lw_error *err);

#endif
