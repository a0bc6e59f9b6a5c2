/* gltf_image_light.h: EXT_lights_image_based: the pictures of the default scene's image-based light
 * become its environment.
 * Flow:    cube of pictures, turned and scaled -> [gltf_image_light] -> scene->environment
 * Threads: one conversion per document.
 * Colours are sRGB; of PNGs they are divided by alpha (RGBD). A picture is what a camera in the middle sees
 * along its axis over 90 degrees, up +Y, or away from +Z for +Y and towards +Z for -Y: the mirrored faces of
 * cube maps that the extension asks for. Coefficients and blurred levels are not used: light is solved. */
#ifndef LW_IMPORT_GLTF_GLTF_IMAGE_LIGHT_H
#define LW_IMPORT_GLTF_GLTF_IMAGE_LIGHT_H

#include "server/import/gltf/gltf_material.h"

/** Fills the scene's environment if its default scene has an image-based light. With pictures that cannot be
 * read there is no environment, and a warning.
 * Errors: LW_BAD_DATA naming the field; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_image_light_convert(struct lw_gltf_document *document,
                                                         struct lw_gltf_materials *materials,
                                                         struct lw_scene *scene, struct lw_error *err);

#endif
