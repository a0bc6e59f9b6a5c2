/* finish_package.h: the finishes of a scene, in a package of their own: clients draw without them first.
 * Flow:    scene -> [finish_package] -> a file's section, or parts on the wire -> [finish_package] -> scene
 * Threads: pure functions, [any]. Format: docs/scene_package.md, "Finishes". */
#ifndef LW_COMMON_FINISH_PACKAGE_H
#define LW_COMMON_FINISH_PACKAGE_H

#include "common/scene/scene.h"

#define LW_FINISH_PACKAGE_VERSION  1u
#define LW_FINISH_PACKAGE_SIZE_MAX UINT32_MAX /* bytes */

/** Writes the finishes of a valid scene that has some. *out_bytes is malloc'ed; the caller frees it. Same
 * scene, same bytes. Errors: LW_NO_MEMORY; LW_BAD_DATA past LW_FINISH_PACKAGE_SIZE_MAX. */
LW_MUST_CHECK enum lw_status lw_finish_package_write(const struct lw_scene *scene, uint8_t **out_bytes,
                                                     size_t *out_size, struct lw_error *err);

/** Gives a valid scene without finishes those of a package from outside: material.finish, mesh.tangent,
 * finish_texture. Nobody else may read the scene meanwhile. `bytes` may be freed afterwards. Checks as
 * lw_package_read(). A refused package changes nothing of the scene but the memory that it holds.
 * Errors: LW_BAD_DATA naming the section and field, or finishes of another scene; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_finish_package_read(const uint8_t *bytes, size_t size, struct lw_scene *scene,
                                                    struct lw_error *err);

/** The same of bytes that the scene owns, without a copy. */
LW_MUST_CHECK enum lw_status lw_finish_package_take(uint8_t *bytes, size_t size, struct lw_scene *scene,
                                                    struct lw_error *err);

/** Cuts a package into parts, each of which clients may have already: before each texture's pixels. Other
 * bytes are one part. *out_end: the end of each part, in bytes; the last is size. The caller frees it.
 * size > 0. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_finish_package_cut(const uint8_t *bytes, size_t size, uint64_t **out_end,
                                                   size_t *out_count);

#endif
