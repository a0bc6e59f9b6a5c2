/* foreign_finish.h: what a material of OBJ, FBX or Collada says of gloss and relief, as a finish.
 * Threads: one set of pictures belongs to one import.
 *
 * docs/importing_finish.md says which materials stay matt. */
#ifndef LW_IMPORT_FOREIGN_FOREIGN_FINISH_H
#define LW_IMPORT_FOREIGN_FOREIGN_FINISH_H

#include "server/import/foreign/foreign_picture.h"

/** The most textures that a number of materials may have. */
size_t lw_foreign_finish_textures_max(size_t materials);

struct lw_foreign_finish {
    struct lw_foreign_pictures *pictures;
    struct lw_tally out_of_range; /* materials whose metalness or roughness is not within 0 and 1 */
    struct lw_tally left_out;     /* materials for whose pictures there is no room */
    struct lw_tally odd_normals;  /* normal maps with many texels that are no normals */
};

/** Sets material->finish: NULL where it is matt and even.
 * mirror  its base colour is the specular one, as of a metal (mirror.h)
 * Errors: LW_BAD_DATA: too many textures, texels past a limit; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_foreign_finish_read(struct lw_foreign_finish *finish,
                                                    const struct lw_foreign_look *look, bool mirror,
                                                    struct lw_material *material, struct lw_error *err);

/** Whether a file says metalness or roughness. */
bool lw_foreign_finish_is_said(const struct lw_foreign_look *look);

/** Logs warnings, after everything is converted. */
void lw_foreign_finish_report(const struct lw_foreign_finish *finish);

#endif
