/* foreign.h: reads OBJ, PLY, FBX, Collada and STL through Assimp into a scene. The kept parts of each
 * format, and the conventions: docs/importing_other.md.
 * Flow:    file -> [Assimp, guarded] -> [foreign_*] -> scene -> lightmap UVs -> package
 * Threads: one import at a time: Assimp's last error and our guard are the process's.
 * Runs in lightwell-import only, like every reader of outside files. Assimp opens no file itself. */
#ifndef LW_IMPORT_FOREIGN_FOREIGN_H
#define LW_IMPORT_FOREIGN_FOREIGN_H

#include "common/scene/scene.h"
#include "server/import/scene_format.h"

/** For surfaces of files that do not say which sides they have. */
enum lw_foreign_sides {
    LW_FOREIGN_SIDES_AUTO, /* one where the surface is closed or emits, else two */
    LW_FOREIGN_SIDES_ONE,
    LW_FOREIGN_SIDES_TWO
};

struct lw_foreign_desc {
    const char *path;
    enum lw_scene_format format; /* not glTF */
    enum lw_foreign_sides sides;
    double read_seconds;     /* processor time that Assimp may take; 0: by the size of the file */
    uint64_t picture_texels; /* of all pictures together at most; 0: LW_IMAGE_FILE_TEXELS */
    bool matt;               /* no finishes: gloss and relief are not read */
    int failure_fd;          /* where the guard says why it ended the process; 0: stderr */
};

/** Errors: LW_NO_INPUT if the file cannot be opened; LW_BAD_DATA naming file and element; LW_NO_MEMORY. If
 * Assimp crashes or exceeds its limits, the process ends with one line (guard.h). */
LW_MUST_CHECK enum lw_status lw_foreign_load(const struct lw_foreign_desc *desc, struct lw_scene **out_scene,
                                             struct lw_error *err);

#endif
