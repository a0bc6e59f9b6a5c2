/* web_tiles.c: what the browser client has of our own C, as WebAssembly: the tile decoder, tiles as a GPU
 * takes them, the hash that names scene packages, the filter of pixels, and the levels at which triangles
 * read their own light.
 * Flow:    payload of a TILE -> [web_tiles] -> texels in RGB9E5 -> texture
 * Threads: one instance of the module per thread; it has no other state than the static variables here.
 * After:   EXT_texture_shared_exponent, for RGB9E5. */
#include "common/lightmap/lightmap_check.h"
#include "common/scene/pixel_filter.h"
#include "common/tile/tile_dct.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#define EXPORT(name) __attribute__((export_name(#name))) name

/* A texel of 1 in a texture is so much light, W/m^2: from 0.001 to 2,000,000 it has nine bits or more. */
#define LIGHT_UNIT 32.0f

#define MANTISSA_BITS 9
#define EXPONENT_BIAS 15
#define EXPONENT_MAX  31
/* The largest value that a texel holds. */
#define SHARED_MAX (511.0f / 512.0f * 65536.0f)

#define HALF_LARGEST 0x7bffu
#define HALF_SIGN    0x8000u
#define VALUES_MAX   (LW_TILE_TEXELS_MAX * LW_TILE_CHANNEL_PLANES_MAX)

/* The C library's, for cosines beyond 2^20: 7 kB that this page would load for the decoder's table of angles
 * below 2 pi. */
__attribute__((used)) int __rem_pio2_large(double *x, double *y, int e0, int nx, int prec) {
    (void)x, (void)y, (void)e0, (void)nx, (void)prec;
    __builtin_trap();
}

static struct lw_tile_dct dct;
static float values[VALUES_MAX];
static struct lw_tile_channel channel; /* the decoded tile's */
static uint32_t packed[LW_TILE_TEXELS_MAX];
static XXH3_state_t hash;

void EXPORT(lw_web_tiles_init)(void) {
    lw_tile_dct_init(&dct);
    channel = *lw_tile_channel_at(LW_TILE_CHANNEL_FULL);
}

/** The table of tile_channels.h, number by number; -1 behind the last: planes, is it signed, is it coded
 * plain, the bits of features that it asks about and for, its slot. */
int32_t EXPORT(lw_web_tiles_channel)(uint32_t number, uint32_t column) {
    if (number >= lw_tile_channels()->count) return -1;
    const struct lw_tile_channel *c = lw_tile_channel_at(number);
    const uint32_t is[] = {c->planes,          c->is_signed,      c->coding == LW_TILE_CODING_PLAIN,
                           (uint32_t)c->asked, (uint32_t)c->asks, c->slot};
    return (int32_t)is[column];
}

/** Tiles are of such a channel from now on. planes: at most LW_TILE_CHANNEL_PLANES_MAX */
void EXPORT(lw_web_tiles_choose)(uint32_t planes, bool is_signed, bool is_plain) {
    channel = (struct lw_tile_channel){.planes = planes,
                                       .is_signed = is_signed,
                                       .coding = is_plain ? LW_TILE_CODING_PLAIN : LW_TILE_CODING_LIGHT};
}

/** Where decoded texels are: width * height floats per plane; and, of light, as lw_web_tiles_pack() makes
 * them. */
float *EXPORT(lw_web_tiles_values)(void) { return values; }
uint32_t *EXPORT(lw_web_tiles_packed)(void) { return packed; }

void *EXPORT(lw_web_tiles_alloc)(size_t size) { return malloc(size); }
void EXPORT(lw_web_tiles_free)(void *bytes) { free(bytes); }

/** Memory for what deltas of a tile of this channel and size build on; NULL: there is none.
 * lw_web_tiles_free() frees it. */
struct lw_tile_dct_coefficients *EXPORT(lw_web_tiles_coefficients)(uint32_t width, uint32_t height) {
    return aligned_alloc(_Alignof(struct lw_tile_dct_coefficients),
                         lw_tile_dct_coefficients_size(&channel, width, height));
}

static bool is_tile(uint32_t width, uint32_t height) {
    return width - 1 < LW_TILE_SIDE && height - 1 < LW_TILE_SIDE;
}

/** Decodes a payload of codec 4 as lw_tile_codec_decode() and lw_tile_codec_decode_delta() do. Bytes may come
 * from anyone. */
bool EXPORT(lw_web_tiles_decode)(uint32_t kind, const uint8_t *src, size_t src_size, float scale,
                                 uint32_t width, uint32_t height,
                                 struct lw_tile_dct_coefficients *coefficients) {
    return is_tile(width, height) && scale > 0 && (kind == LW_TILE_DCT_INTRA || coefficients) &&
           lw_tile_dct_decode(&dct, &channel, kind, src, src_size, scale, width, height, coefficients,
                              values);
}

static float float_from_half(uint32_t half) {
    const uint32_t exponent = half >> 10, mantissa = half & 0x3ffu;
    return exponent ? ldexpf((float)(mantissa | 0x400u), (int)exponent - 25) : (float)mantissa * 0x1p-24f;
}

/** Decodes a payload of codec 1 that zstd has been taken off: 2 * planes * width * height bytes. */
bool EXPORT(lw_web_tiles_decode_half)(const uint8_t *bytes, float scale, uint32_t width, uint32_t height) {
    const size_t texels = (size_t)width * height, count = channel.planes * texels;
    const uint32_t sign = channel.is_signed ? HALF_SIGN : 0;
    if (!is_tile(width, height) || !(scale > 0 && scale <= 0x1p111f)) return false;
    for (size_t i = 0; i < count; i++) {
        const uint32_t half = bytes[i] | (uint32_t)bytes[count + i] << 8, size = half & ~sign;
        if (size > HALF_LARGEST) return false;
        const float value = float_from_half(size) * scale;
        values[channel.planes * (i % texels) + i / texels] = half == size ? value : -value;
    }
    return true;
}

static float power_of_two(int exponent) {
    const uint32_t bits = (uint32_t)(exponent + 127) << 23;
    float power;
    memcpy(&power, &bits, sizeof power);
    return power;
}

/* Channels are finite and >= 0. Too large values become the largest that fits. */
static uint32_t pack(float r, float g, float b) {
    r = fminf(r, SHARED_MAX), g = fminf(g, SHARED_MAX), b = fminf(b, SHARED_MAX);
    const float largest = fmaxf(r, fmaxf(g, b));
    uint32_t bits;
    memcpy(&bits, &largest, sizeof bits);
    int exponent = (int)(bits >> 23) - 126; /* largest < 2^exponent */
    if (exponent < -EXPONENT_BIAS) exponent = -EXPONENT_BIAS;
    if (largest * power_of_two(MANTISSA_BITS - exponent) + 0.5f >= 1 << MANTISSA_BITS) exponent++;
    const float unit = power_of_two(MANTISSA_BITS - exponent);
    return (uint32_t)(r * unit + 0.5f) | (uint32_t)(g * unit + 0.5f) << 9 |
           (uint32_t)(b * unit + 0.5f) << 18 | (uint32_t)(exponent + EXPONENT_BIAS) << 27;
}
_Static_assert(EXPONENT_MAX - EXPONENT_BIAS == 16, "SHARED_MAX has the largest exponent");

/** Makes the first texels of light RGB9E5 in units of LIGHT_UNIT; out_sum: of each channel, W/m^2. */
void EXPORT(lw_web_tiles_pack)(uint32_t texels, double out_sum[3]) {
    const float scale = 1 / LIGHT_UNIT;
    double sum[3] = {0};
    for (uint32_t i = 0; i < texels && i < LW_TILE_TEXELS_MAX; i++) {
        packed[i] = pack(values[3 * i] * scale, values[3 * i + 1] * scale, values[3 * i + 2] * scale);
        for (int c = 0; c < 3; c++) sum[c] += (double)values[3 * i + (uint32_t)c];
    }
    memcpy(out_sum, sum, sizeof sum);
}
float EXPORT(lw_web_tiles_unit)(void) { return LIGHT_UNIT; }

/** XXH3-128 of bytes, as packages are named: begin, add as often as it takes, finish. */
void EXPORT(lw_web_tiles_hash_begin)(void) { XXH3_128bits_reset(&hash); }
void EXPORT(lw_web_tiles_hash_add)(const uint8_t *bytes, size_t size) {
    XXH3_128bits_update(&hash, bytes, size);
}
/** out_hash: most significant byte first. */
void EXPORT(lw_web_tiles_hash_finish)(uint8_t out_hash[16]) {
    XXH128_canonical_t canonical;
    XXH128_canonicalFromHash(&canonical, XXH3_128bits_digest(&hash));
    memcpy(out_hash, canonical.digest, 16);
}

/** lw_pixel_filter_undo(). */
void EXPORT(lw_web_tiles_unfilter)(const uint8_t *bytes, uint32_t width, uint32_t height, uint8_t *out_rgba) {
    lw_pixel_filter_undo(bytes, width, height, out_rgba);
}

/** lw_lightmap_coarsest() of a mesh whose indices have been checked. Returns whether there was memory for
 * it. */
bool EXPORT(lw_web_tiles_coarsest)(const struct lw_vec3 *position, const struct lw_vec2 *lightmap_uv,
                                   uint32_t vertex_count, const uint32_t (*triangle)[3],
                                   uint32_t triangle_count, uint32_t width, uint32_t height,
                                   uint8_t *out_level) {
    const struct lw_mesh mesh = {.position = position,
                                 .vertex_count = vertex_count,
                                 .triangle = triangle,
                                 .triangle_count = triangle_count};
    const struct lw_lightmap_map map = {.mesh = &mesh,
                                        .triangle = triangle,
                                        .uv = lightmap_uv,
                                        .uv_count = vertex_count,
                                        .width = width,
                                        .height = height};
    return lw_lightmap_check_coarsest(&map, out_level) == LW_OK;
}
