/* foreign_import.h: the state that the parts of one import through Assimp share.
 * Threads: an import belongs to one thread. err is never NULL here; errors do not name the file yet. */
#ifndef LW_IMPORT_FOREIGN_FOREIGN_IMPORT_H
#define LW_IMPORT_FOREIGN_FOREIGN_IMPORT_H

#include "server/import/foreign/foreign.h"
#include "server/import/foreign/foreign_files.h"
#include "server/import/tally.h"

#include <assimp/scene.h>

#define LW_FOREIGN_KEYS_MAX (1u << 26) /* of all channels together */

/* Ignored features; one warning each per file. */
#define LW_FOREIGN_WARNING_MAP(X)                                                                            \
    X(GLOSS_TRANSFORM,                                                                                       \
      "a metalness map lies otherwise than the roughness beside it: it is read as that lies")                \
    X(SKIN, "skins are ignored: skinned meshes keep the pose of the file")                                   \
    X(MORPH, "morph targets are ignored")                                                                    \
    X(POINTS, "points and lines are ignored: only triangles are lit")                                        \
    X(ORTHOGRAPHIC, "orthographic cameras are ignored")                                                      \
    X(AMBIENT, "ambient lights are ignored: lightwelld --sky gives light from all around")                   \
    X(AREA, "area lights are ignored: give a mesh an emissive material instead")                             \
    X(ATTENUATION, "constant and linear attenuation of lights are ignored: light falls off with the square") \
    X(VERTEX_ALPHA, "the alpha of vertex colours is ignored: surfaces are opaque")                           \
    X(UV_SET, "textures that use a third or higher UV set are ignored")                                      \
    X(UV_MISSING, "a material has a texture for which its mesh has no texture coordinates: (0, 0) is used")  \
    X(OPACITY_TRANSFORM, "an opacity map lies otherwise than the colour beside it: it is read as that lies") \
    X(SHEAR, "animated nodes lose the shear of their matrix")                                                \
    X(CHANNEL_TWICE, "several animations move the same node: the first one counts")                          \
    X(CHANNEL_LOST, "animations of nodes that do not exist are ignored")

enum lw_foreign_warning {
#define X(name, text) LW_FOREIGN_WARN_##name,
    LW_FOREIGN_WARNING_MAP(X)
#undef X
        LW_FOREIGN_WARNING_COUNT
};

struct lw_foreign_import {
    const struct lw_foreign_desc *desc;
    const struct lw_foreign_files *files;
    const struct aiScene *ai;
    struct lw_scene *scene; /* being made */
    uint32_t warned;        /* bit per enum lw_foreign_warning */
};

void lw_foreign_import_warn(struct lw_foreign_import *import, enum lw_foreign_warning warning);

/** A name of the file as UTF-8, owned by the scene: text that is no UTF-8 is taken as Latin-1, which old
 * exporters write. NULL when out of memory. */
const char *lw_foreign_import_text(struct lw_foreign_import *import, const struct aiString *text);

#endif
