/* ply_header.h: the header of a PLY as Assimp reads it well: without a byte order mark, in lower case, with
 * the names of colours that Assimp knows.
 * Flow:    bytes of the file -> [ply_header] -> bytes for Assimp
 * Threads: values only. */
#ifndef LW_IMPORT_TEXT_PLY_HEADER_H
#define LW_IMPORT_TEXT_PLY_HEADER_H

#include "server/import/text/skipped.h"

struct lw_ply_header {
    char *text; /* for the old one's place */
    size_t size, capacity;
    size_t body;    /* where the old one ends in the file */
    bool is_binary; /* the body */
    bool has_material;
    struct lw_skipped skipped; /* properties and elements that are not read */
};

/** finish() also after failure. Errors: LW_BAD_DATA: no PLY, or its header has no end; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_ply_header_read(struct lw_ply_header *header, const uint8_t *bytes,
                                                size_t size, struct lw_error *err);
void lw_ply_header_finish(struct lw_ply_header *header);

#endif
