/* package_cache.h: scene packages, or parts of them, in a folder, each under its hash: none is downloaded
 * twice.
 * Flow:    WELCOME's hashes -> [package_cache] -> package, or parts of it; a complete download ->
 *          [package_cache]
 * Threads: pure functions, [any]. Processes may share a folder: files appear whole. */
#ifndef LIGHTWELL_PACKAGE_CACHE_H
#define LIGHTWELL_PACKAGE_CACHE_H

#include "common/scene/package.h"

#define LW_PACKAGE_CACHE_BYTES_MAX (1ull << 30) /* of all files in a folder; the newest may be larger */

enum lw_package_cache_kind { LW_PACKAGE_CACHE_PACKAGE, LW_PACKAGE_CACHE_PART };

enum lw_package_cache_found {
    LW_PACKAGE_CACHE_ABSENT,
    LW_PACKAGE_CACHE_FOUND,
    LW_PACKAGE_CACHE_DAMAGED /* there is a file, but not of this size and hash, or it cannot be read */
};

/** Reads the file of this hash and size. FOUND: *out_bytes is the caller's to free(). */
LW_MUST_CHECK enum lw_package_cache_found lw_package_cache_read(const char *folder,
                                                                enum lw_package_cache_kind kind,
                                                                const struct lw_package_hash *hash,
                                                                uint64_t size, uint8_t **out_bytes);

/** Warns of it in the log: what a program of ours gives as lw_client_watch.damaged. context: unused. */
void lw_package_cache_warn(void *context, const char *folder);
/** The same of lw_client_watch.unkept. */
void lw_package_cache_warn_unkept(void *context, const char *why);

/** Writes bytes under their hash. Makes the folder, and those above it. Removes the least recently used files
 * until the rest keep to LW_PACKAGE_CACHE_BYTES_MAX. Files with other names stay and do not count.
 * Errors: LW_CANNOT_CREATE, LW_IO naming the path; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_package_cache_write(const char *folder, enum lw_package_cache_kind kind,
                                                    const struct lw_package_hash *hash, const uint8_t *bytes,
                                                    size_t size, struct lw_error *err);

#endif
