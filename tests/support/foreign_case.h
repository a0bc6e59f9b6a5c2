/* foreign_case.h: scene files of the test's own folder through the importer, and what it says of them. */
#ifndef LW_TESTS_FOREIGN_CASE_H
#define LW_TESTS_FOREIGN_CASE_H

#include "tests/support/support.h"

#include "server/import/foreign/foreign.h"

/** Write a file, make a folder. */
void lw_foreign_case_write_bytes(const char *name, const void *bytes, size_t size);
void lw_foreign_case_write_text(const char *name, const char *text);
void lw_foreign_case_make_folder(const char *name);

/** Loads a file. *out: NULL unless that succeeds. Errors: those of lw_scene_format_of() and
 * lw_foreign_load(). */
LW_MUST_CHECK enum lw_status lw_foreign_case_load(const char *name, enum lw_foreign_sides sides,
                                                  struct lw_scene **out, struct lw_error *err);

/** The last load's text on stderr. */
const char *lw_foreign_case_talk(void);

#endif
