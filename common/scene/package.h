/* package.h: the scene package (.lwscene): one flat, versioned binary that the importer writes, the daemon
 * lights and clients download. One writer, one strict reader.
 * Flow:    importer -> scene -> [package bytes] -> file or wire -> [package reader] -> scene
 * Threads: pure functions, [any]. Format: docs/scene_package.md. */
#ifndef LW_COMMON_PACKAGE_H
#define LW_COMMON_PACKAGE_H

#include "common/scene/scene.h"

#include <signal.h>

/* The newest version. A file has the oldest of 5, 6 and 7 that can hold the scene: 7 where it has finishes
 * (finish_package.h), which clients get apart. These versions have a checksum.
 * Clients get a scene in the oldest version that can hold it: 1, 2 with an environment, 3 with textures, 4
 * where it says whether clients draw a light, and 6 with unlit or tinted materials, orthographic cameras or
 * animated lights. */
#define LW_PACKAGE_VERSION  7u
#define LW_PACKAGE_SIZE_MAX (4ull << 30) /* bytes */

/** Content address of a package: XXH3-128 of its bytes, big-endian. */
struct lw_package_hash {
    uint8_t bytes[16];
};

/** Writes a validated scene for clients, which hear its hash apart. *out_bytes is malloc'ed; the caller frees
 * it. Same scene, same bytes. Errors: LW_NO_MEMORY; LW_BAD_DATA if the scene breaks lw_scene_validate() or a
 * limit. */
LW_MUST_CHECK enum lw_status lw_package_write(const struct lw_scene *scene, uint8_t **out_bytes,
                                              size_t *out_size, struct lw_error *err);

/** Whether a scene, whose lightmaps may be missing yet, fits a package.
 * Errors: LW_BAD_DATA with both sizes. */
LW_MUST_CHECK enum lw_status lw_package_check_size(const struct lw_scene *scene, struct lw_error *err);

/** The same for a file, with a checksum and with finishes: version 5, or 6 or 7 where that has to be. */
LW_MUST_CHECK enum lw_status lw_package_write_sealed(const struct lw_scene *scene, uint8_t **out_bytes,
                                                     size_t *out_size, struct lw_error *err);

/** Puts the checksum of a package from version 5 on into its header. Other bytes stay as they are. */
void lw_package_seal(uint8_t *bytes, size_t size);

/** Reads a package from outside. Checks every offset, count, index and number before use, stays within
 * bounds, and allocates only for bytes that are there. The scene has copies: `bytes` may be freed afterwards.
 * Errors: LW_BAD_DATA naming the section and field, or a checksum that is wrong; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_package_read(const uint8_t *bytes, size_t size, struct lw_scene **out_scene,
                                             struct lw_error *err);

/** Whether a path names a package: by its ending, .lwscene, or by the file's first bytes. */
bool lw_package_is(const char *path);

void lw_package_hash(const uint8_t *bytes, size_t size, struct lw_package_hash *out_hash);

/** Cuts a package into parts, so that scenes can share textures: before each texture's pixels, and after the
 * last one's. Bytes that are no package are one part. *out_end: where each part ends, the last one at size;
 * malloc'ed, the caller's. size > 0. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_package_cut(const uint8_t *bytes, size_t size, uint64_t **out_end,
                                            size_t *out_count);

/** The same from and to a file, sealed. Writing removes what killed writers of it left, and goes through a
 * temporary name, the disk, and a rename.
 * Errors: also LW_NO_INPUT, LW_CANNOT_CREATE, LW_IO, each naming the path. */
LW_MUST_CHECK enum lw_status lw_package_load(const char *path, struct lw_scene **out_scene,
                                             struct lw_error *err);
LW_MUST_CHECK enum lw_status lw_package_save(const struct lw_scene *scene, const char *path,
                                             struct lw_error *err);

/** The same; *stop, which a signal sets, ends the writing, and leaves nothing. Errors: also LW_CLOSED. */
LW_MUST_CHECK enum lw_status lw_package_save_stoppable(const struct lw_scene *scene, const char *path,
                                                       const volatile sig_atomic_t *stop,
                                                       struct lw_error *err);

#endif
