/* secret_file.h: reads files that hold secrets: tokens, keys. One that others can read is refused.
 * Threads: [any].
 *
 * A name "credential:NAME" is the systemd credential NAME: the file of that name in $CREDENTIALS_DIRECTORY.
 * systemd decides who may read files there. */
#ifndef LW_COMMON_BASE_SECRET_FILE_H
#define LW_COMMON_BASE_SECRET_FILE_H

#include "common/base/status.h"

#include <stdint.h>

/** The users that may be able to read the file. */
enum lw_secret_file_readers {
    LW_SECRET_FILE_OWNER, /* its owner alone */
    LW_SECRET_FILE_GROUP, /* its group, too: keys of many servers are kept so */
    LW_SECRET_FILE_ALL    /* no secret: a certificate */
};

/** Reads a whole regular file. *out_bytes is for lw_secret_file_free(); a NUL follows its last byte.
 * path  as above. It is also in the text of errors
 * Errors: LW_NO_INPUT; LW_BAD_DATA: others can read it, is too large, is no file, or no such credential;
 *         LW_IO, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_secret_file_read(const char *path, enum lw_secret_file_readers readers,
                                                 uint64_t size_max, uint8_t **out_bytes, size_t *out_size,
                                                 struct lw_error *err);

/** Overwrites and frees. NULL is fine. */
void lw_secret_file_free(uint8_t *bytes, size_t size);

#endif
