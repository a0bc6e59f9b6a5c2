/* obj_materials.h: the materials that an OBJ uses, from the libraries that it names. All libraries are read
 * before any material is searched, so mtllib may stand anywhere in the file.
 * Flow:    names of obj_text -> [obj_materials] -> foreign_look
 * Threads: a set belongs to one import. */
#ifndef LW_IMPORT_TEXT_OBJ_MATERIALS_H
#define LW_IMPORT_TEXT_OBJ_MATERIALS_H

#include "server/import/text/mtl_file.h"
#include "server/import/text/obj_text.h"

#define LW_OBJ_MATERIALS_LIBRARIES_MAX 256u        /* files that are read */
#define LW_OBJ_MATERIALS_NAMES_MAX     1000u       /* names that are looked for */
#define LW_OBJ_MATERIALS_SIZE_MAX      (64u << 20) /* bytes of a library */

/** Folder of the libraries (beside.h). */
struct lw_obj_materials_desc {
    const char *path;   /* the scene's, for warnings */
    const char *folder; /* the scene's */
    const char *name;   /* base name of the scene */
};

struct lw_obj_materials_use {
    const struct lw_mtl_material *material; /* NULL: no library has it */
    const char *folder;                     /* its library's, from the scene's on; "": the scene's */
};

struct lw_obj_materials_library;

struct lw_obj_materials {
    struct lw_obj_materials_library *library;
    uint32_t library_count;
    size_t capacity;
    struct lw_obj_materials_use *use; /* per material of the text */
    uint32_t use_count;
};

/** Warns of libraries that are not there, of lines in them that are not read, and of materials that no
 * library has. finish() also after failure. Errors: LW_BAD_DATA naming the library; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_obj_materials_load(struct lw_obj_materials *materials,
                                                   const struct lw_obj_text *obj,
                                                   const struct lw_obj_materials_desc *desc,
                                                   struct lw_error *err);
void lw_obj_materials_finish(struct lw_obj_materials *materials);

#endif
