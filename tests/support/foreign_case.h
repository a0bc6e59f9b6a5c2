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

/** Pictures: 2 x 2 texels as PNG, above red and green, below blue and white; one texel as TGA. */
void lw_foreign_case_write_png(const char *name);
void lw_foreign_case_write_texel(const char *name, uint8_t red, uint8_t green, uint8_t blue);

/** The scene of a file, or of a file written with that text. It must load. */
struct lw_scene *lw_foreign_case_scene(const char *name);
struct lw_scene *lw_foreign_case_scene_of(const char *name, const char *text);

/** Ends the test unless the file is refused with a line that names it and has the reason. */
void lw_foreign_case_refuse(const char *name, const char *reason);
void lw_foreign_case_refuse_text(const char *name, const char *text, const char *reason);

/** Ends the test unless the last load's text contains a phrase; unless it is empty. text: for the message. */
void lw_foreign_case_expect_line(const char *phrase);
void lw_foreign_case_expect_silence(const char *text);

/** The material of the first triangle. */
const struct lw_material *lw_foreign_case_first_material(const struct lw_scene *scene);

/** Ends the test unless v, or the base colour of the first triangle, has these values. of: as text. */
void lw_foreign_case_expect_vec3(struct lw_vec3 v, float x, float y, float z);
void lw_foreign_case_expect_colour(const struct lw_scene *scene, float red, float green, float blue,
                                   const char *of);

/* OBJ: a square of 1 m in the x-y plane, one of 2 m in the x-z plane, and the face of either. */
#define LW_FOREIGN_CASE_SQUARE "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
#define LW_FOREIGN_CASE_FLOOR  "v 0 0 2\nv 2 0 2\nv 2 0 0\nv 0 0 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
#define LW_FOREIGN_CASE_FACE   "f 1/1 2/2 3/3 4/4\n"

#define LW_FOREIGN_CASE_RED  0.8f, 0.1f, 0.1f
#define LW_FOREIGN_CASE_GREY 0.6f, 0.6f, 0.6f

#endif
