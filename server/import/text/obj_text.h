/* obj_text.h: an OBJ as Assimp reads it well: one plain statement a line, and only those of polygons.
 * Material libraries are kept apart, because Assimp's reader of MTL loses or refuses much of them
 * (docs/importing_other.md).
 * Flow:    bytes of the file -> [obj_text] -> text for Assimp, names of libraries and materials
 * Threads: a text belongs to one import. */
#ifndef LW_IMPORT_TEXT_OBJ_TEXT_H
#define LW_IMPORT_TEXT_OBJ_TEXT_H

#include "server/import/text/name_table.h"
#include "server/import/text/skipped.h"

struct lw_obj_text_library {
    char *names; /* as they stand behind mtllib */
    unsigned line;
};

struct lw_obj_text {
    char *text; /* for Assimp: "usemtl N" is material N of the names below */
    size_t size, capacity;
    struct lw_name_table material; /* materials that the file uses */
    struct lw_obj_text_library *library;
    uint32_t library_count;
    size_t library_capacity;
    bool smooth; /* has smoothing groups and no normals, which Assimp does not say */
    struct lw_skipped skipped;
};

/** finish() also after failure.
 * Errors: LW_BAD_DATA naming the line: a vertex without numbers, a face with an index that is none or out of
 * range, no statement that is known; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_obj_text_read(struct lw_obj_text *obj, const uint8_t *bytes, size_t size,
                                              struct lw_error *err);
void lw_obj_text_finish(struct lw_obj_text *obj);

#endif
