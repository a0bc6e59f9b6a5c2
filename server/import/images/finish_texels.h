/* finish_texels.h: the texels of pictures become those of finishes (enum lw_content of scene.h).
 * Threads: pure functions, [any]. */
#ifndef LW_IMPORT_IMAGES_FINISH_TEXELS_H
#define LW_IMPORT_IMAGES_FINISH_TEXELS_H

#include "common/scene/scene.h"

/** White lies this share of the picture's longer side above black, by a height map. */
#define LW_FINISH_TEXELS_RELIEF 0.02f

/** Whether no texel has an alpha below 255. */
bool lw_finish_texels_opaque(const uint8_t *rgba, size_t texels);
/** Sets all alphas to 255. */
void lw_finish_texels_cover(uint8_t *rgba, size_t texels);

/** A normal map of a file becomes LW_CONTENT_NORMAL, in place: normals are made unit. A negative z is
 * replaced by the one that follows from x and y. A texel of no length, or black, becomes even. Returns the
 * number of both. */
size_t lw_finish_texels_normal(uint8_t *rgba, size_t texels);

/** Whether a picture holds normals, not heights: it is blue, and in its mean even. */
bool lw_finish_texels_are_normals(const uint8_t *rgba, size_t texels);

/** A specular-glossiness picture: R, G, B the specular colour, A glossiness. *out_surface becomes
 * LW_CONTENT_SURFACE with roughness 1 - glossiness x A, and the picture opaque. */
void lw_finish_texels_gloss(uint8_t *rgba, size_t texels, float glossiness, uint8_t *out_surface);

/** Heights, the mean of R, G and B, become LW_CONTENT_NORMAL by differences of neighbours; texture->rgba is
 * not read. out: not rgba. */
void lw_finish_texels_height(const uint8_t *rgba, const struct lw_texture *texture, uint8_t *out);

/** A picture that is read at another size. */
struct lw_finish_texels_join {
    const uint8_t *rgba;
    uint32_t width, height;
};
/** The texel of a picture at (x, y) of one of width x height. */
const uint8_t *lw_finish_texels_at(const struct lw_finish_texels_join *from, uint32_t x, uint32_t y,
                                   uint32_t width, uint32_t height);

#endif
