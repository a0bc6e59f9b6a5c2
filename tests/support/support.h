/* support.h: what every test includes first. */
#ifndef LW_TESTS_SUPPORT_H
#define LW_TESTS_SUPPORT_H

/* cmocka wants these before itself */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "common/scene/scene.h"

/** Ends the test with the error's text unless status is LW_OK. */
void lw_support_ok(enum lw_status status, const struct lw_error *err);

/** Ends the test unless status is as expected and the error's text contains `text`. */
void lw_support_fails(enum lw_status status, enum lw_status expected, const struct lw_error *err,
                      const char *text);

/** A scene of `count` objects, each a square of side_m metres facing +Y at height 0, 2*side_m apart along X,
 * albedo 0.5, with a point light of 10 W/sr at (0, 2, 0). No lightmap UVs. */
struct lw_scene *lw_support_squares(unsigned count, float side_m);
/** Gives a material a finish without textures, of ior 1.5; the scene has it. */
struct lw_finish *lw_support_finish(struct lw_scene *scene, uint32_t material, float metalness,
                                    float roughness);

/** A small valid scene that has everything a scene can have: two meshes (one with every array, double-sided
 * triangles and an atlas with backs), three textures, every alpha mode, wrap mode, kind of light, path and
 * interpolation, a hierarchy with a mirroring matrix, names in several scripts. The same on every call. */
struct lw_scene *lw_support_everything(void);
/** Gives that scene finishes: of two materials, with textures of each content, and tangents of one mesh. */
void lw_support_add_finishes(struct lw_scene *scene);

/** The part of that name, or the test ends. */
uint32_t lw_support_object(const struct lw_scene *scene, const char *name);
struct lw_material *lw_support_material(const struct lw_scene *scene, const char *name);
const struct lw_light *lw_support_light(const struct lw_scene *scene, const char *name);

/** Triangles of all objects. */
uint64_t lw_support_triangles(const struct lw_scene *scene);

/** Path of a file in a folder that the test program removes when it ends; valid until LW_SUPPORT_PATHS calls
 * later, those of process.h included. */
#define LW_SUPPORT_PATHS 128
const char *lw_support_temporary(const char *name);

/** Path of a file of the repository, e.g. "docs/scene_package.md"; valid until the next call. */
const char *lw_support_source(const char *relative);

/** Files in a folder, in one of the repository; hidden ones left out. */
size_t lw_support_files_in(const char *folder);
size_t lw_support_count_files(const char *relative);

/** Path of a real test scene, e.g. "sponza/Sponza_lit.gltf", under $LW_TEST_SCENES or beside the repository;
 * valid until the next call. Skips the calling test, saying so, where it is missing. */
const char *lw_support_scene(const char *relative);

/** Waits where no event tells: looks each millisecond. The test's time limit (LW_TEST_TIMEOUT) ends what
 * hangs. */
#define LW_SUPPORT_WAIT_UNTIL(condition)                                                                     \
    while (!(condition)) lw_support_pause()
void lw_support_pause(void);

/** Reads a whole file, or ends the test; the caller frees. A NUL follows the last byte. */
uint8_t *lw_support_read_file(const char *path, size_t *out_size);

/** Reads a file of a folder as text, or ends the test; the caller frees. */
char *lw_support_read_text(const char *folder, const char *name);

/** Bytes of the next block ```hex of a document: lines of an offset, bytes, and a comment behind ';'. *text
 * moves behind them. Returns how many there are; ends the test if there is none. */
size_t lw_support_document_bytes(const char **text, uint8_t *out, size_t capacity);

/** A copy of a text with `new` in the place of the first `old`, or the test ends. The caller frees. */
char *lw_support_replaced(const char *text, const char *old, const char *new);

/** Fills a command line: COMMAND builtin:cornell -o out [OPTION VALUE], NULL behind it. Returns the number of
 * words. option: NULL for none. */
#define LW_SUPPORT_WORDS_MAX 7
int lw_support_command_line(char *argv[LW_SUPPORT_WORDS_MAX], const char *command, const char *option,
                            const char *value);

/** Writes a whole file, or ends the test. */
void lw_support_write_file(const char *path, const void *bytes, size_t size);

/** relMSE of a picture: mean((x - t)^2 / (t^2 + 0.01 mean(t^2))) over its values. The reference's own noise
 * is in it. */
double lw_support_relmse(const float *rgb, const float *reference, size_t values);

#endif
