/* package_cache.h: scene packages in a folder, each under its hash, so that none is downloaded twice.
 * Flow:    WELCOME's hash -> [package_cache] -> package; a complete download -> [package_cache]
 * Threads: pure functions, [any]; processes may share a folder: files appear whole. */
#ifndef LIGHTWELL_PACKAGE_CACHE_H
#define LIGHTWELL_PACKAGE_CACHE_H

#include "common/scene/package.h"

#define LW_PACKAGE_CACHE_BYTES_MAX (1ull << 30) /* of all packages in a folder; the newest may be larger */

/** Reads the package of this hash and size; *out_bytes: the caller's to free(). false: there is none, it cannot be read or is
 * damaged, or there is no memory for it. */
LW_MUST_CHECK bool lw_package_cache_read(const char *folder, const struct lw_package_hash *hash,
                                         uint64_t size, uint8_t **out_bytes);

/** Keeps a package, under the hash that it has. Makes the folder, and those above it. Removes the packages that have not been read
 * or written for longest until the rest keep to LW_PACKAGE_CACHE_BYTES_MAX; files with other names are left alone and do not count.
 * Errors: LW_CANNOT_CREATE, LW_IO naming the path; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_package_cache_write(const char *folder, const struct lw_package_hash *hash,
                                                    const uint8_t *bytes, size_t size, struct lw_error *err);

#endif
