/* foreign_text.h: makes text of a scene plain before Assimp reads it. Text that Assimp would refuse, lose or
 * guess is mended or reported (docs/importing_other.md).
 * Flow:    foreign_files -> [foreign_text] -> bytes for Assimp
 * Threads: one import at a time. */
#ifndef LW_IMPORT_FOREIGN_FOREIGN_TEXT_H
#define LW_IMPORT_FOREIGN_FOREIGN_TEXT_H

#include "server/import/foreign/foreign_files.h"

/** Replaces the bytes of the scene, and reads the material libraries of an OBJ. Warns of skipped parts.
 * Errors: LW_BAD_DATA naming the line; LW_NO_MEMORY; their text does not name the file. */
LW_MUST_CHECK enum lw_status lw_foreign_text_mend(struct lw_foreign_files *files, struct lw_error *err);

#endif
