/* foreign_files.h: the file that Assimp may read, served from memory: the scene. It cannot open, list or
 * overwrite any other.
 * Threads: one set belongs to one import. */
#ifndef LW_IMPORT_FOREIGN_FOREIGN_FILES_H
#define LW_IMPORT_FOREIGN_FOREIGN_FILES_H

#include "server/import/scene_format.h"
#include "server/import/text/obj_materials.h"

#include <assimp/cfileio.h>

#define LW_FOREIGN_FILE_SIZE_MAX (4ull << 30) /* bytes of a scene file */

struct lw_foreign_files {
    struct aiFileIO io; /* first: Assimp hands it back to our callbacks */
    enum lw_scene_format format;
    const char *path;       /* the scene's */
    char *folder;           /* the scene's */
    char name[300];         /* the scene's name for Assimp: its base name with the right ending */
    uint8_t *bytes;         /* the scene's, as foreign_text.h leaves them */
    size_t size, file_size; /* file_size: before that */
    struct lw_obj_text obj; /* an OBJ's; its text is moved to the bytes */
    struct lw_obj_materials materials;
    bool has_material; /* a PLY or STL names a colour for surfaces without a material */
};

/** Reads the scene file. finish() also after failure.
 * Errors: LW_NO_INPUT, LW_BAD_DATA, LW_IO, LW_NO_MEMORY; their text does not name the file. */
LW_MUST_CHECK enum lw_status lw_foreign_files_init(struct lw_foreign_files *files, const char *path,
                                                   enum lw_scene_format format, struct lw_error *err);
void lw_foreign_files_finish(struct lw_foreign_files *files);

#endif
