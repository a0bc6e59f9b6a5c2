/* foreign_files.h: the files that Assimp may read, served from memory: the scene, and the material libraries
 * of an OBJ (beside.h). It cannot open, list or overwrite any other.
 * Threads: one set belongs to one import. */
#ifndef LW_IMPORT_FOREIGN_FILES_H
#define LW_IMPORT_FOREIGN_FILES_H

#include "server/import/scene_format.h"

#include <assimp/cfileio.h>

#define LW_FOREIGN_FILE_SIZE_MAX (4ull << 30)  /* bytes of a scene file */
#define LW_FOREIGN_MTL_SIZE_MAX  (64ull << 20) /* bytes of a material library */

struct lw_foreign_files {
    struct aiFileIO io; /* first: Assimp hands it back to our callbacks */
    enum lw_scene_format format;
    const char *path; /* of the scene */
    char *folder;     /* of the scene */
    char name[300];   /* what Assimp is told the scene is called: its base name with the right ending */
    uint8_t *bytes;   /* of the scene */
    size_t size;
    bool library_found;     /* any material library */
    char library_lost[200]; /* name of the first that was not; "" */
};

/** Reads the scene file. finish() also after failure.
 * Errors: LW_NO_INPUT, LW_BAD_DATA, LW_IO, LW_NO_MEMORY; their text does not name the file. */
LW_MUST_CHECK enum lw_status lw_foreign_files_init(struct lw_foreign_files *files, const char *path,
                                                   enum lw_scene_format format, struct lw_error *err);
void lw_foreign_files_finish(struct lw_foreign_files *files);

#endif
