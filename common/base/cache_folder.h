/* cache_folder.h: files that can be made again, in a folder, each under a hash: the least recently used ones
 * go when there are too many bytes of them.
 * Flow:    hash -> [cache_folder] -> path -> package_cache, saved_texels
 * Threads: pure functions, [any]; processes may share a folder if files appear whole (atomic_file.h). */
#ifndef LW_COMMON_BASE_CACHE_FOLDER_H
#define LW_COMMON_BASE_CACHE_FOLDER_H

#include <stddef.h>
#include <stdint.h>

#define LW_CACHE_FOLDER_HASH_SIZE 16u /* bytes */

/** FOLDER/HASH and a suffix; malloc'ed. NULL: no memory. */
char *lw_cache_folder_path(const char *folder, const uint8_t hash[LW_CACHE_FOLDER_HASH_SIZE],
                           const char *suffix);

/** Makes all folders above a file, as far as possible: opening the file reports a fault in them.
 * path: as it was afterwards */
void lw_cache_folder_make_above(char *path);

/** Notes that a file is of use: others go before it. */
void lw_cache_folder_touch(const char *path);

/** Removes the least recently used files until the rest keep to bytes_max. Files whose names are no hash with
 * one of the suffixes stay, and do not count.
 * suffix  ends with NULL
 * newest  path of a file of the folder, just written: it and newer files stay */
void lw_cache_folder_prune(const char *folder, const char *const *suffix, uint64_t bytes_max,
                           const char *newest);

#endif
