/* environment_file.h: an equirectangular EXR becomes a scene's environment.
 * Flow:    FILE.exr -> [environment_file: clean, filter down] -> scene->environment
 * Threads: pure, [any]. Outside bytes: for the importer's process only. */
#ifndef LW_IMPORT_IMAGES_ENVIRONMENT_FILE_H
#define LW_IMPORT_IMAGES_ENVIRONMENT_FILE_H

#include "common/scene/scene.h"

/* Value of an infinite texel: a half float that overflowed. */
#define LW_ENVIRONMENT_FILE_HALF_MAX 65504.0f

/** Reads R, G, B of an EXR as radiance, W/(m^2 sr); row 0 is up, the middle of the picture is +X (struct
 * lw_environment). Texels that are no light are reported in one warning: NaN and below 0 become 0, infinite
 * ones LW_ENVIRONMENT_FILE_HALF_MAX. A picture with a side past LW_SCENE_ENVIRONMENT_SIDE_MAX is box-filtered
 * down, by solid angle: the light it sends is kept. Errors: LW_NO_INPUT, LW_BAD_DATA (no EXR, no R, G and B),
 * LW_NO_MEMORY, each naming the file. */
LW_MUST_CHECK enum lw_status lw_environment_file_load(struct lw_scene *scene, const char *path,
                                                      struct lw_error *err);

/** Box filter for any two sizes, weighing each part of a texel by its solid angle: what both send, per band
 * of directions, is the same. dst: width x height x 3. */
void lw_environment_file_filter(const float *src, uint32_t src_width, uint32_t src_height, float *dst,
                                uint32_t width, uint32_t height);

#endif
