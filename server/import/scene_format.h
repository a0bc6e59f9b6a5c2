/* scene_format.h: recognises the format of a scene file by its first bytes, or else by its name.
 * Threads: [any]. */
#ifndef LW_IMPORT_SCENE_FORMAT_H
#define LW_IMPORT_SCENE_FORMAT_H

#include "common/base/status.h"

/* name, what people call it, file name endings (first: the one that Assimp gets) */
#define LW_SCENE_FORMAT_MAP(X)                                                                               \
    X(GLTF, "glTF", ".gltf", ".glb")                                                                         \
    X(OBJ, "OBJ", ".obj", ".obj")                                                                            \
    X(PLY, "PLY", ".ply", ".ply")                                                                            \
    X(FBX, "FBX", ".fbx", ".fbx")                                                                            \
    X(COLLADA, "Collada", ".dae", ".dae")                                                                    \
    X(STL, "STL", ".stl", ".stl")

enum lw_scene_format {
#define X(name, text, ending, other) LW_SCENE_FORMAT_##name,
    LW_SCENE_FORMAT_MAP(X)
#undef X
        LW_SCENE_FORMAT_COUNT
};

/* For help texts and errors. */
#define LW_SCENE_FORMAT_ENDINGS ".gltf, .glb, .obj, .ply, .fbx, .dae, .stl"

/** "OBJ" etc. */
const char *lw_scene_format_name(enum lw_scene_format format);
/** ".obj" etc. */
const char *lw_scene_format_ending(enum lw_scene_format format);

/** Recognises a file. Its first bytes count more than its name.
 * Errors: LW_NO_INPUT if it cannot be opened; LW_BAD_DATA if it is empty, no regular file, or in none of the
 * formats. Their text starts with the path. */
LW_MUST_CHECK enum lw_status lw_scene_format_of(const char *path, enum lw_scene_format *out,
                                                struct lw_error *err);

#endif
