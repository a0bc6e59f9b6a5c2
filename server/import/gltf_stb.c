/* gltf_stb.c: stb_image's code, PNG and JPEG alone. Apart, because its warnings are not ours to mend. */
#include "common/scene/scene.h"

#define STB_IMAGE_IMPLEMENTATION
#define STBI_ONLY_PNG
#define STBI_ONLY_JPEG
#define STBI_NO_STDIO
#define STBI_NO_HDR
#define STBI_NO_LINEAR
#define STBI_MAX_DIMENSIONS LW_SCENE_TEXTURE_SIDE_MAX
#include <stb_image.h>
