/* web_files.h: the files of the browser client, read once and kept in memory.
 * Flow:    folder -> [web_files] -> path, coding -> bytes -> web_server
 * Threads: built once; after that immutable, [any].
 *
 * A path is looked up in a list of the files found, so that none leads out of the folder. Links and names
 * that begin with a dot are left out.
 *
 * A file NAME.br or NAME.gz beside NAME is NAME in that coding. One that is older than NAME, to the second,
 * or not smaller is no coding of it. */
#ifndef LW_SERVE_WEB_WEB_FILES_H
#define LW_SERVE_WEB_WEB_FILES_H

#include "common/base/status.h"
#include "server/serve/web/content_coding.h"

#include <stddef.h>
#include <stdint.h>

#define LW_WEB_FILES_MAX       1000u
#define LW_WEB_FILES_BYTES_MAX (64u << 20) /* of all of them */
#define LW_WEB_FILES_DEPTH_MAX 8u          /* nested folders */

struct lw_web_files {
    struct lw_web_file {
        char *path;       /* as in a URL: "/index.html", "/js/main.js" */
        const char *type; /* for Content-Type */
        char tag[35];     /* for ETag, with its quotes: a hash of the bytes */
        uint8_t *bytes;
        size_t size;
        int64_t modified_s;
        const struct lw_web_file *coded[LW_CONTENT_CODING_COUNT]; /* NULL: there is none */
    } * file;                                                     /* by path */
    size_t count, bytes;
};

/** Reads all files of a folder and of the folders in it.
 * Errors, naming the file: LW_NO_INPUT, there is no such folder; LW_BAD_DATA, over one of the
 * limits; LW_IO; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_web_files_read(const char *folder, struct lw_web_files *out_files,
                                               struct lw_error *err);
void lw_web_files_finish(struct lw_web_files *files);

/** File of a URL's decoded path. A path that ends with a slash is a folder's: its index.html. NULL if there
 * is none. */
const struct lw_web_file *lw_web_files_find(const struct lw_web_files *files, const char *path);

/** Codings of a file besides identity: bit 1 << coding. */
unsigned lw_web_files_codings(const struct lw_web_file *file);

#endif
