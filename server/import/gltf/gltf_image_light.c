#include "server/import/gltf/gltf_image_light.h"

#include "common/base/colour.h"

#define NAME  "EXT_lights_image_based"
#define FACES 6u
/* Places in each texel of the environment, along a side, at which the cube is read: texels are a little
 * smaller than the cube's. */
#define SUBSAMPLES 2u

struct cube {
    const struct lw_gltf_image_slot *face[FACES]; /* +X, -X, +Y, -Y, +Z, -Z */
    float intensity;
    float rotation[4]; /* unit; of the cube in the world */
};

/* Where a face looks, and the upward direction of its picture. */
static const struct lw_vec3 ahead[FACES] = {{1, 0, 0},  {-1, 0, 0}, {0, 1, 0},
                                            {0, -1, 0}, {0, 0, 1},  {0, 0, -1}};
static const struct lw_vec3 upward[FACES] = {{0, 1, 0}, {0, 1, 0}, {0, 0, -1},
                                             {0, 0, 1}, {0, 1, 0}, {0, 1, 0}};

static struct lw_vec3 read_texel(const struct cube *cube, unsigned face, uint32_t x, uint32_t y) {
    const struct lw_gltf_image_slot *image = cube->face[face];
    const uint8_t *p = image->texel[LW_CONTENT_COLOUR] + 4 * ((size_t)y * image->width + x);
    const float scale = cube->intensity * 255.0f / (float)(p[3] ? p[3] : 1);
    return lw_vec3(scale * lw_colour_from_srgb8(p[0]), scale * lw_colour_from_srgb8(p[1]),
                   scale * lw_colour_from_srgb8(p[2]));
}

static struct lw_vec3 read_cube(const struct cube *cube, struct lw_vec3 d) {
    const struct lw_vec3 a = lw_vec3(fabsf(d.x), fabsf(d.y), fabsf(d.z));
    const unsigned face = a.x >= a.y && a.x >= a.z ? d.x < 0 : a.y >= a.z ? 2 + (d.y < 0) : 4 + (d.z < 0);
    const struct lw_vec3 right = lw_vec3_cross(ahead[face], upward[face]);
    const float depth = lw_vec3_dot(d, ahead[face]), side = (float)cube->face[face]->width;
    const float x = 0.5f * side * (1 + lw_vec3_dot(d, right) / depth),
                y = 0.5f * side * (1 - lw_vec3_dot(d, upward[face]) / depth);
    return read_texel(cube, face, (uint32_t)fminf(fmaxf(x, 0), side - 1),
                      (uint32_t)fminf(fmaxf(y, 0), side - 1));
}

/* Into the cube's own space: by the inverse of the rotation. */
static struct lw_vec3 turn_back(const float q[4], struct lw_vec3 d) {
    const struct lw_vec3 axis = lw_vec3(-q[0], -q[1], -q[2]);
    const struct lw_vec3 t = lw_vec3_scale(lw_vec3_cross(axis, d), 2);
    return lw_vec3_add(lw_vec3_mad(d, t, q[3]), lw_vec3_cross(axis, t));
}

static enum lw_status resample(const struct cube *cube, struct lw_scene *scene, struct lw_error *err) {
    const uint32_t most = LW_SCENE_ENVIRONMENT_SIDE_MAX / 4, side = cube->face[0]->width;
    const uint32_t height = 2 * (side < most ? side : most), width = 2 * height;
    float *rgb = lw_scene_alloc(scene, 3ul * width * height, sizeof *rgb);
    if (!rgb) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %u x %u texels", width, height);
    for (uint32_t i = 0; i < width * height; i++) {
        struct lw_vec3 sum = {0};
        for (uint32_t s = 0; s < SUBSAMPLES * SUBSAMPLES; s++) {
            const float x = (float)(i % width) + ((float)(s % SUBSAMPLES) + 0.5f) / SUBSAMPLES,
                        y = (float)(i / width) + ((float)(s / SUBSAMPLES) + 0.5f) / SUBSAMPLES;
            const float around = 2 * LW_PI * (x / (float)width - 0.5f), down = LW_PI * y / (float)height;
            const struct lw_vec3 d =
                lw_vec3(sinf(down) * cosf(around), cosf(down), sinf(down) * sinf(around));
            sum = lw_vec3_add(sum, read_cube(cube, turn_back(cube->rotation, d)));
        }
        sum = lw_vec3_scale(sum, 1.0f / (SUBSAMPLES * SUBSAMPLES));
        rgb[3ul * i] = fminf(sum.x, LW_SCENE_RADIANCE_MAX);
        rgb[3ul * i + 1] = fminf(sum.y, LW_SCENE_RADIANCE_MAX);
        rgb[3ul * i + 2] = fminf(sum.z, LW_SCENE_RADIANCE_MAX);
    }
    scene->environment = (struct lw_environment){.width = width, .height = height, .rgb = rgb};
    return LW_OK;
}

/* *out_found: whether all six can be read. */
static enum lw_status read_faces(struct lw_gltf_materials *materials, const json_t *light, struct cube *cube,
                                 bool *out_found, struct lw_error *err) {
    const json_t *levels = NULL;
    const uint32_t count = materials->document->count[LW_GLTF_IMAGES];
    if (lw_gltf_json_require(light, "specularImages", err) ||
        lw_gltf_json_array(light, "specularImages", &levels, err))
        return err->status;
    const json_t *faces = json_array_get(levels, 0); /* the sharpest level */
    if (json_array_size(faces) != FACES)
        return lw_status_fail(err, LW_BAD_DATA, "specularImages: [0] must have six images");
    *out_found = true;
    for (unsigned f = 0; f < FACES; f++) {
        uint64_t image;
        if (!lw_gltf_json_whole(json_array_get(faces, f), &image) || image >= count)
            return lw_status_fail(
                err, LW_BAD_DATA,
                "specularImages: [0][%u] must be an index into images, which has %u elements", f, count);
        if (lw_gltf_textures_image(&materials->textures, (uint32_t)image, LW_CONTENT_COLOUR, &cube->face[f],
                                   err))
            return err->status;
        *out_found &= !cube->face[f]->unreadable;
    }
    for (unsigned f = 0; *out_found && f < FACES; f++)
        if (cube->face[f]->width != cube->face[f]->height || cube->face[f]->width != cube->face[0]->width)
            return lw_status_fail(
                err, LW_BAD_DATA,
                "specularImages: [0][%u] has %u x %u texels; all must be squares of one size", f,
                cube->face[f]->width, cube->face[f]->height);
    return LW_OK;
}

static enum lw_status convert_light(struct lw_gltf_materials *materials, const json_t *light,
                                    struct lw_scene *scene, struct lw_error *err) {
    struct cube cube = {.intensity = 1, .rotation = {0, 0, 0, 1}};
    bool found = false;
    double square = 0;
    if (lw_gltf_json_real(light, "intensity", 0, (double)LW_SCENE_RADIANCE_MAX, &cube.intensity, err) ||
        lw_gltf_json_reals(light, "rotation", 4, -1.001, 1.001, cube.rotation, err))
        return err->status;
    for (int c = 0; c < 4; c++) square += (double)cube.rotation[c] * (double)cube.rotation[c];
    if (fabs(square - 1) > 0.01)
        return lw_status_fail(err, LW_BAD_DATA, "rotation: must be a unit quaternion");
    for (int c = 0; c < 4; c++) cube.rotation[c] = (float)((double)cube.rotation[c] / sqrt(square));
    if (read_faces(materials, light, &cube, &found, err)) return err->status;
    if (found) return resample(&cube, scene, err);
    lw_gltf_document_warn(materials->document, LW_GLTF_WARN_IMAGE_LIGHT);
    return LW_OK;
}

/* The default scene's use of a light; NULL if it has none. */
static enum lw_status find_use(const struct lw_gltf_document *document, const json_t **out,
                               struct lw_error *err) {
    uint32_t scene = 0;
    if (!document->count[LW_GLTF_SCENES] ||
        lw_gltf_document_index(document, document->root, "scene", LW_GLTF_SCENES, &scene, err))
        return err->status;
    if (lw_gltf_json_extension(lw_gltf_document_item(document, LW_GLTF_SCENES, scene), NAME, out, err))
        lw_status_context(err, "scenes[%u]", scene);
    return err->status;
}

enum lw_status lw_gltf_image_light_convert(struct lw_gltf_document *document,
                                           struct lw_gltf_materials *materials, struct lw_scene *scene,
                                           struct lw_error *err) {
    const json_t *use = NULL, *extension = NULL, *lights = NULL;
    uint64_t index = 0;
    if (find_use(document, &use, err) || !use) return err->status;
    if (lw_gltf_json_extension(document->root, NAME, &extension, err) ||
        (extension && lw_gltf_json_array(extension, "lights", &lights, err)) ||
        lw_gltf_json_require(use, "light", err) ||
        lw_gltf_json_integer(use, "light", 0, UINT32_MAX, &index, err)) {
        lw_status_context(err, NAME);
        return err->status;
    }
    const json_t *light = json_array_get(lights, index);
    if (!json_is_object(light))
        return lw_status_fail(err, LW_BAD_DATA, NAME ": light: %llu is not one of its %zu lights",
                              (unsigned long long)index, json_array_size(lights));
    if (convert_light(materials, light, scene, err))
        lw_status_context(err, "extensions." NAME ".lights[%llu]", (unsigned long long)index);
    return err->status;
}
