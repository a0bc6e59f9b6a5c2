/* gltf.h: reads glTF 2.0 (.gltf with its files, .glb) into a scene. Strict: a file that breaks the format is
 * refused; unused features are ignored with one warning. Details: docs/importing_gltf.md.
 * Flow:    file -> [glTF reader] -> scene -> lightmap UVs -> package
 * Threads: one document per call, [any].
 * Runs in lightwell-import only: outside files and their image decoders stay out of the daemon's process. */
#ifndef LW_IMPORT_GLTF_GLTF_H
#define LW_IMPORT_GLTF_GLTF_H

#include "common/scene/scene.h"

struct lw_gltf_options {
    uint64_t picture_texels; /* of all images together at most; 0: LW_IMAGE_FILE_TEXELS */
    bool matt;               /* no finishes: gloss and relief are not read */
};

/** Reads a file and the buffers and images it names, which must lie in its folder or below.
 * options  NULL: all 0
 * Errors: LW_NO_INPUT if the file itself cannot be opened; LW_BAD_DATA naming file, element and field;
 * LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_load(const char *path, const struct lw_gltf_options *options,
                                          struct lw_scene **out_scene, struct lw_error *err);

/** The same from memory, for tests and fuzzers: a .glb or .gltf that names no file. `name` opens its
 * errors. */
LW_MUST_CHECK enum lw_status lw_gltf_load_memory(const uint8_t *bytes, size_t size, const char *name,
                                                 struct lw_scene **out_scene, struct lw_error *err);
/** The same with options. */
LW_MUST_CHECK enum lw_status lw_gltf_load_bytes(const uint8_t *bytes, size_t size, const char *name,
                                                const struct lw_gltf_options *options,
                                                struct lw_scene **out_scene, struct lw_error *err);

#endif
