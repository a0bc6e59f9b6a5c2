/* foreign_material.h: Assimp's materials and their textures, converted on first use, each once.
 * Threads: one set belongs to one import. */
#ifndef LW_IMPORT_FOREIGN_FOREIGN_MATERIAL_H
#define LW_IMPORT_FOREIGN_FOREIGN_MATERIAL_H

#include "server/import/foreign/foreign_finish.h"

/** Properties of a surface that its material depends on. */
struct lw_foreign_surface {
    bool closed;   /* it has an inside: its back is never seen */
    bool coloured; /* it has vertex colours */
};

struct lw_foreign_converted;

struct lw_foreign_materials {
    struct lw_foreign_import *import;
    struct lw_foreign_converted *converted; /* per material of the file */
    struct lw_foreign_pictures pictures;
    struct lw_foreign_finish finish;
    struct lw_tally bright;    /* materials whose diffuse colour is above 1 */
    struct lw_tally invisible; /* materials whose opacity is 0 */
};

/** finish() also after failure. Errors: LW_BAD_DATA (too many), LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_foreign_materials_init(struct lw_foreign_materials *materials,
                                                       struct lw_foreign_import *import,
                                                       struct lw_error *err);
void lw_foreign_materials_finish(struct lw_foreign_materials *materials);

/** The scene's material for a material of the file. Errors: LW_BAD_DATA naming the material; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_foreign_materials_get(struct lw_foreign_materials *materials, uint32_t index,
                                                      struct lw_foreign_surface surface, uint32_t *out,
                                                      struct lw_error *err);

/** Logs warnings, after everything is converted. */
void lw_foreign_materials_report(const struct lw_foreign_materials *materials);

#endif
