#include "server/import/gltf_image.h"

#include <stdlib.h>
#include <string.h>

#define STBI_NO_STDIO
#include <stb_image.h>

enum lw_status lw_gltf_image_size(const uint8_t *bytes, size_t size, uint32_t *out_width,
                                  uint32_t *out_height, struct lw_error *err) {
    int width, height, channels;
    if (size > LW_GLTF_IMAGE_SIZE_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has %zu bytes; the limit is %u", size,
                              LW_GLTF_IMAGE_SIZE_MAX);
    if (!stbi_info_from_memory(bytes, (int)size, &width, &height, &channels))
        return lw_status_fail(err, LW_BAD_DATA,
                              "is not a readable PNG or JPEG of at most %u x %u texels (%s)",
                              LW_SCENE_TEXTURE_SIDE_MAX, LW_SCENE_TEXTURE_SIDE_MAX, stbi_failure_reason());
    if (width < 1 || height < 1 || width > (int)LW_SCENE_TEXTURE_SIDE_MAX ||
        height > (int)LW_SCENE_TEXTURE_SIDE_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has %d x %d texels; the limit is %u x %u", width, height,
                              LW_SCENE_TEXTURE_SIDE_MAX, LW_SCENE_TEXTURE_SIDE_MAX);
    *out_width = (uint32_t)width;
    *out_height = (uint32_t)height;
    return LW_OK;
}

enum lw_status lw_gltf_image_decode(const uint8_t *bytes, size_t size, uint32_t width, uint32_t height,
                                    uint8_t *out_rgba, struct lw_error *err) {
    int got_width = 0, got_height = 0, channels;
    uint8_t *rgba = stbi_load_from_memory(bytes, (int)size, &got_width, &got_height, &channels, 4);
    if (!rgba) return lw_status_fail(err, LW_BAD_DATA, "cannot be decoded: %s", stbi_failure_reason());
    bool same = (uint32_t)got_width == width && (uint32_t)got_height == height;
    if (same) memcpy(out_rgba, rgba, (size_t)width * height * 4);
    stbi_image_free(rgba);
    return same ? LW_OK : lw_status_fail(err, LW_BAD_DATA, "its header contradicts its content");
}
