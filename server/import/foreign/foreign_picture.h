/* foreign_picture.h: the pictures that materials of Assimp's and of MTL name, decoded on first use, each
 * once, and those that are made of them.
 * Threads: one set belongs to one import. */
#ifndef LW_IMPORT_FOREIGN_FOREIGN_PICTURE_H
#define LW_IMPORT_FOREIGN_FOREIGN_PICTURE_H

#include "server/import/foreign/foreign_import.h"
#include "server/import/foreign/foreign_look.h"
#include "server/import/images/image_file.h"

struct lw_foreign_picture {
    char *key; /* folder and path as the file has them; of one that is made of others, what it is made of */
    const uint8_t *rgba;
    uint32_t width, height;
    bool unreadable, has_alpha;
};

struct lw_foreign_pictures {
    struct lw_foreign_import *import;
    struct lw_foreign_picture *picture;
    uint32_t picture_count;
    size_t picture_capacity;
    struct lw_image_file_budget budget;
    uint64_t unreadable_count;
};

void lw_foreign_pictures_init(struct lw_foreign_pictures *pictures, struct lw_foreign_import *import);
void lw_foreign_pictures_finish(struct lw_foreign_pictures *pictures);

/** A path behind its last slash. */
const char *lw_foreign_pictures_base_name(const char *path);

/** The picture of a map. *out_index: into the pictures, which may move. One that cannot be read is reported,
 * and marked so. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_foreign_pictures_get(struct lw_foreign_pictures *pictures,
                                                     const struct lw_foreign_map *map, uint32_t *out_index,
                                                     struct lw_error *err);

/** The picture that was made under a key, or NULL. */
struct lw_foreign_picture *lw_foreign_pictures_find(struct lw_foreign_pictures *pictures, const char *key);
/** A new one. */
LW_MUST_CHECK enum lw_status lw_foreign_pictures_add(struct lw_foreign_pictures *pictures, const char *key,
                                                     struct lw_foreign_picture **out, struct lw_error *err);
/** Allocates texels of its size, and counts them as the scene's. Errors: LW_BAD_DATA: past a limit;
 * LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_foreign_pictures_texels(struct lw_foreign_pictures *pictures,
                                                        struct lw_foreign_picture *picture, uint8_t **out,
                                                        struct lw_error *err);

/** A copy of picture *index with the values that its map asks for. */
LW_MUST_CHECK enum lw_status lw_foreign_pictures_change(struct lw_foreign_pictures *pictures,
                                                        const struct lw_foreign_map *map, uint32_t *index,
                                                        struct lw_error *err);
/** The colour of one picture (LW_SCENE_NONE: white) with the opacity of another. */
LW_MUST_CHECK enum lw_status lw_foreign_pictures_combine(struct lw_foreign_pictures *pictures,
                                                         uint32_t colour, uint32_t opacity,
                                                         const struct lw_foreign_map *map,
                                                         uint32_t *out_index, struct lw_error *err);
/** Whether its alpha lets parts of light pass, rather than cuts out. */
bool lw_foreign_pictures_blend(const struct lw_foreign_picture *picture);

/** Logs how many more could not be read. */
void lw_foreign_pictures_report(const struct lw_foreign_pictures *pictures);

#endif
