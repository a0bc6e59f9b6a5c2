/* A tile of directions from any server, in shading: the form (direction_form.h), the same in sixteen lanes
 * (gloss.h), and the texture of it (texel_format.h). The input: codec, and 128 for a delta; width; height; a
 * float for the scale; roughness and metalness; exponent of E, W/m^2, base 2; a texel of a normal map; three
 * signed bytes for the plain normal, three for where the eye is; the payload. */
#include "client/view/shading/gloss.h"
#include "common/base/random.h"
#include "common/light/direction_form.h"
#include "common/tile/texel_format.h"
#include "common/tile/tile_codec.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = LW_GLOSS_WIDTH, HEAD = 18 };

static const struct lw_ambient no_environment;
static const struct lw_gloss_sky sky = {{0.2f, 0.3f, 0.5f}, &no_environment};

static void require(bool condition) {
    if (!condition) abort();
}

static struct lw_vec3 vector_of(const uint8_t bytes[3]) {
    const struct lw_vec3 v = lw_vec3((int8_t)bytes[0], (int8_t)bytes[1], (int8_t)bytes[2]);
    return lw_vec3_dot(v, v) > 0 ? v : lw_vec3(0, 0, 1);
}

static void set(float (*to)[WIDTH], unsigned i, struct lw_vec3 v) {
    to[0][i] = v.x, to[1][i] = v.y, to[2][i] = v.z;
}
static struct lw_vec3 get(const float (*from)[WIDTH], unsigned i) {
    return lw_vec3(from[0][i], from[1][i], from[2][i]);
}

static struct lw_vec3 texel_of(const float *xyz, size_t i) {
    return lw_vec3(xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]);
}

/* Sixteen points of one surface: the normal map has other texels at each. */
static void make_surface(const uint8_t *head, struct lw_gloss16 *g) {
    const struct lw_vec3 plain = lw_vec3_normalize(vector_of(head + 12)), eye = vector_of(head + 15);
    struct lw_vec3 tangent, across;
    lw_vec3_frame(plain, &tangent, &across);
    *g = (struct lw_gloss16){.quads = 0xffff};
    for (unsigned i = 0; i < WIDTH; i++) {
        const uint32_t bump = head[9] | (uint32_t)head[10] << 8 | (uint32_t)head[11] << 16;
        for (unsigned k = 0; k < 4; k++) {
            g->surface.at[k][i] = g->shade.at[k][i] = UINT32_MAX;
            g->bump.at[k][i] = 0xff000000u | (i ? bump ^ (lw_random_hash(i) & 0xffffffu) : bump);
        }
        set(g->base, i, lw_vec3(1, 0.7f, 0.3f));
        set(g->dielectric, i, lw_vec3(0.04f, 0.04f, 0.04f));
        g->roughness[i] = (float)(head[7] & 15) / 15, g->metalness[i] = (float)(head[7] >> 4) / 15;
        g->specular[i] = g->normal_scale[i] = g->turn[i] = g->side[i] = 1;
        set(g->plain, i, plain), set(g->tangent, i, tangent), set(g->to_eye, i, eye);
    }
}

static void expect_share(float factor, float gain) {
    require(factor >= 0 && factor <= LW_DIRECTION_FACTOR_MAX); /* false for NaN */
    require(gain >= 0 && gain <= LW_DIRECTION_GAIN_MAX);
}

static void shade(const struct lw_gloss16 *g, const struct lw_gloss_seen16 *seen, float light,
                  const float (*direction)[WIDTH]) {
    float factor[WIDTH], gain[WIDTH], e[3][WIDTH], out[3][WIDTH];
    lw_gloss_direct16(g, seen, direction, factor, gain);
    for (unsigned i = 0; i < WIDTH; i++) {
        const struct lw_vec3 n = get(g->plain, i), m = get(seen->normal, i);
        const struct lw_vec3 mirrored = lw_vec3_sub(lw_vec3_scale(m, 2 * seen->cosine[i]), get(seen->eye, i));
        const struct lw_direction_source source = lw_direction_source_of(get(direction, i), n);
        expect_share(factor[i], gain[i]);
        expect_share(lw_direction_factor(&source, n, m),
                     lw_direction_gain(&source, n, mirrored, seen->alpha[i]));
        require(lw_direction_factor(&source, n, n) == 1);
        require(source.share >= 0 && source.share <= 1);
        set(e, i, lw_vec3(light, 0.5f * light, 0));
    }
    lw_gloss_ambient16(g, seen, 0xffff, &sky, (const float(*)[WIDTH])e, direction, NULL, out);
    for (unsigned c = 0; c < 3; c++)
        for (unsigned i = 0; i < WIDTH; i++) require(out[c][i] >= 0 && out[c][i] < INFINITY);
}

static void expect_texture(const float *xyz, size_t count) {
    float texel[4];
    uint16_t half[4];
    for (size_t i = 0; i < count; i++) {
        lw_texel_format_write_vectors(LW_TEXEL_FORMAT_RGBA32F, xyz + 3 * i, 1, texel);
        lw_texel_format_write_vectors(LW_TEXEL_FORMAT_RGBA16F, xyz + 3 * i, 1, half);
        for (unsigned k = 0; k < 3; k++)
            require(fabsf(texel[k]) <= 1 && (half[k] & 0x7fffu) <= 0x3c00u); /* 0x3c00: 1 */
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    static struct lw_tile_codec *codec;
    static struct lw_tile_dct_coefficients coefficients;
    static float xyz[3 * LW_TILE_TEXELS_MAX];
    const struct lw_tile_channel *channel = lw_tile_channel_at(LW_TILE_CHANNEL_DIRECTION);
    struct lw_gloss16 surface;
    struct lw_gloss_seen16 seen;
    float scale, direction[3][WIDTH];
    if (!codec) require(lw_tile_codec_create(&codec) == LW_OK);
    if (size < HEAD) return 0;
    memcpy(&scale, bytes + 3, sizeof scale);
    for (uint32_t i = 0; i < 3 * LW_TILE_DCT_PLANE_COEFFICIENTS; i++)
        coefficients.coefficient[i] = (int16_t)(i * 7919);
    if ((bytes[0] & 128 ? lw_tile_codec_decode_delta
                        : lw_tile_codec_decode)(codec, channel, bytes[0] & 7, bytes + HEAD, size - HEAD,
                                                scale, bytes[1], bytes[2], &coefficients, xyz) != LW_OK)
        return 0;
    make_surface(bytes, &surface);
    lw_gloss_see16(&surface, &seen);
    const size_t count = (size_t)bytes[1] * bytes[2];
    expect_texture(xyz, count);
    for (size_t first = 0; first < count; first += WIDTH) {
        for (unsigned i = 0; i < WIDTH; i++) /* the last ones: the first again */
            set(direction, i, texel_of(xyz, (first + i) % count));
        shade(&surface, &seen, ldexpf(1, (int8_t)bytes[8] / 2), (const float(*)[WIDTH])direction);
    }
    return 0;
}
