/* folders.h: folders that are made, and default ones: temporary files and caches.
 * Flow:    environment -> [folders] -> paths
 * Threads: [any], as long as none changes the environment. */
#ifndef LW_COMMON_BASE_FOLDERS_H
#define LW_COMMON_BASE_FOLDERS_H

#include "common/base/status.h"

/** The folder of temporary files: $TMPDIR, or /tmp where that is not set. */
const char *lw_folders_temporary(void);

/** Makes a new folder in it that only this user may open.
 * Errors: LW_CANNOT_CREATE naming the place; out_path is then "". */
LW_MUST_CHECK enum lw_status lw_folders_make_temporary(char *out_path, size_t capacity, struct lw_error *err);

/** Removes a folder and its files, as far as the system allows. Folders in it stay. path "":
 * there is none. */
void lw_folders_remove_temporary(const char *path);

/** Makes a folder, or leaves it as it is where it is there.
 * Errors: LW_CANNOT_CREATE naming it: where it shall be in none, or a file has its name. */
LW_MUST_CHECK enum lw_status lw_folders_make(const char *path, struct lw_error *err);

/** The folder of caches: $XDG_CACHE_HOME/lightwell, or ~/.cache/lightwell where that is not set or not
 * absolute (XDG Base Directory Specification). It need not exist. Returns false, and "", without a home
 * directory or if the path is too long. */
bool lw_folders_cache(char *out_path, size_t capacity);

/** The path of a file in a folder. malloc'ed; NULL: no memory. */
char *lw_folders_join(const char *folder, const char *name);

#endif
