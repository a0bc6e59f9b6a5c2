/* gltf_finish.h: what a glTF material says of gloss and relief, as a finish.
 * Threads: one set belongs to one document.
 *
 * docs/importing_finish.md says which materials stay matt, and how each field is read. */
#ifndef LW_IMPORT_GLTF_GLTF_FINISH_H
#define LW_IMPORT_GLTF_GLTF_FINISH_H

#include "server/import/gltf/gltf_texture.h"

/** A texture of finishes that was made of two pictures, or of one and a factor. */
struct lw_gltf_made {
    uint32_t texture[2]; /* the document's */
    float factor;
    uint32_t made[2]; /* the scene's */
};

struct lw_gltf_finishes {
    struct lw_gltf_textures *textures;
    struct lw_gltf_made *made;
    size_t made_count, made_capacity;
    struct lw_tally silent;       /* materials that say nothing of gloss */
    struct lw_tally out_of_range; /* factors that were taken as the nearest that may be */
    struct lw_tally low_ior;      /* indices of refraction below 1 */
    struct lw_tally left_out;     /* materials for whose pictures there is no room */
    struct lw_tally apart;        /* specular textures that lie otherwise than their colours */
};

void lw_gltf_finishes_init(struct lw_gltf_finishes *finishes, struct lw_gltf_textures *textures);
void lw_gltf_finishes_finish(struct lw_gltf_finishes *finishes);

/** Sets material->finish by the material's object: NULL where it is matt and even. material: otherwise whole.
 * Errors: LW_BAD_DATA that starts with the field; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_finishes_read(struct lw_gltf_finishes *finishes, const json_t *object,
                                                   struct lw_material *material, struct lw_error *err);

/** Logs warnings, after everything is converted. */
void lw_gltf_finishes_report(const struct lw_gltf_finishes *finishes);

#endif
