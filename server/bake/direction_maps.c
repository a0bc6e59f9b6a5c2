#include "server/bake/direction_maps.h"

#include "common/light/direction_linear.h"

#include <assert.h>
#include <stdlib.h>

#define DOMINANT_RATIO 1.0f
#define SH_RATIO       4.0f /* packed L1 has no room for more */
#define SH_LAYERS      4u

const struct lw_direction_maps_form *lw_direction_maps_get(enum lw_direction_maps_kind kind) {
    static const struct lw_direction_maps_form table[LW_DIRECTION_MAPS_COUNT] = {
        [LW_DIRECTION_MAPS_OWN] = {"own", "cosine moment over irradiance", "1", 1},
        [LW_DIRECTION_MAPS_DOMINANT] = {"dominant", "RGB: dominant direction / 2 + 1/2; A: its factor at n",
                                        "1", 1},
        [LW_DIRECTION_MAPS_SH] = {"sh", "layers: L0 as E / pi; L1 of y, z, x as L1 / (8 L0) + 1/2",
                                  "W/(m^2 sr)", SH_LAYERS},
    };
    return &table[kind];
}

static struct lw_vec3 vector_at(const struct lw_map *map, size_t i) {
    return lw_vec3(map->rgba[4 * i], map->rgba[4 * i + 1], map->rgba[4 * i + 2]);
}

/* Far from all charts there is no normal: light is the same for all of them. */
static struct lw_direction_linear line_at(const struct lw_map *map, const struct lw_map *normals, size_t i,
                                          float ratio, struct lw_vec3 *out_normal) {
    const struct lw_vec3 mean = vector_at(normals, i);
    *out_normal = lw_vec3(0, 0, 0);
    if (!(lw_vec3_dot(mean, mean) > 1e-12f)) return (struct lw_direction_linear){1, *out_normal};
    *out_normal = lw_vec3_normalize(mean);
    const struct lw_direction_source source = lw_direction_source_of(vector_at(map, i), *out_normal);
    return lw_direction_linear_of(&source, *out_normal, ratio);
}

static void to_dominant(struct lw_map *map, const struct lw_map *normals) {
    for (size_t i = 0; i < (size_t)map->width * map->height; i++) {
        struct lw_vec3 n;
        const struct lw_direction_linear line = line_at(map, normals, i, DOMINANT_RATIO, &n);
        const struct lw_vec3 dominant = lw_vec3_scale(line.slope, 1 / line.even);
        float *texel = map->rgba + 4 * i;
        texel[0] = 0.5f * dominant.x + 0.5f;
        texel[1] = 0.5f * dominant.y + 0.5f;
        texel[2] = 0.5f * dominant.z + 0.5f;
        texel[3] = 0.5f * lw_vec3_dot(dominant, n) + 0.5f;
    }
    map->fits_half = true;
}

/* Layer 0 is light: dark texels may lose it. */
static bool fits_half(const struct lw_map *irradiance, float *surface, const float *l0) {
    size_t n = 0;
    for (size_t i = 0; i < (size_t)irradiance->width * irradiance->height; i++)
        for (size_t c = 0; irradiance->rgba[4 * i + 3] == 1 && c < 3; c++) surface[n++] = l0[4 * i + c];
    return irradiance->fits_half && lw_map_half_loss(surface, n) <= LW_MAP_HALF_LOSS_MAX;
}

static enum lw_status to_sh(struct lw_map *map, const struct lw_map *normals, const struct lw_map *irradiance,
                            struct lw_error *err) {
    const size_t texels = (size_t)map->width * map->height;
    float *layers = malloc(SH_LAYERS * texels * 4 * sizeof *layers + 1),
          *surface = malloc(3 * texels * sizeof *surface + 1);
    for (size_t i = 0; layers && surface && i < texels; i++) {
        struct lw_vec3 n;
        const struct lw_direction_linear line = line_at(map, normals, i, SH_RATIO, &n);
        const float packed[SH_LAYERS] = {0, line.slope.y, line.slope.z, line.slope.x};
        for (size_t l = 0; l < SH_LAYERS; l++) {
            float *texel = layers + (l * texels + i) * 4;
            for (size_t c = 0; c < 3; c++)
                texel[c] = l ? packed[l] / (2 * SH_RATIO * line.even) + 0.5f
                             : line.even * irradiance->rgba[4 * i + c] / LW_PI;
            texel[3] = irradiance->rgba[4 * i + 3];
        }
    }
    if (layers && surface) map->fits_half = fits_half(irradiance, surface, layers);
    free(surface);
    if (!layers || !surface) {
        free(layers);
        return lw_status_fail(err, LW_NO_MEMORY, "the directions of object %u", map->object);
    }
    free(map->rgba);
    map->rgba = layers;
    map->height *= SH_LAYERS;
    return LW_OK;
}

enum lw_status lw_direction_maps_convert(struct lw_map *map, enum lw_direction_maps_kind kind,
                                         const struct lw_map *normals, const struct lw_map *irradiance,
                                         struct lw_error *err) {
    assert(map->width == irradiance->width && map->height == irradiance->height);
    switch (kind) {
    case LW_DIRECTION_MAPS_DOMINANT:
        to_dominant(map, normals);
        return LW_OK;
    case LW_DIRECTION_MAPS_SH:
        return to_sh(map, normals, irradiance, err);
    default:
        map->fits_half = true;
        return LW_OK;
    }
}
