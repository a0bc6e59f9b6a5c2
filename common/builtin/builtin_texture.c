#include "common/builtin/builtin_texture.h"

#include "common/base/random.h"

#include <stdlib.h>

/** A point of a relief. */
struct grain {
    float height_mm, roughness;
    float open; /* share of the light from everywhere that reaches it, in [0, 1] */
};

/* ---- noise and shapes ---- */

static float mix(float a, float b, float t) { return a + (b - a) * t; }
static float clamp01(float x) { return x < 0.0f ? 0.0f : x > 1.0f ? 1.0f : x; }
static float smooth(float low, float high, float x) {
    float t = clamp01((x - low) / (high - low));
    return t * t * (3.0f - 2.0f * t);
}
static float fraction(float x) { return x - floorf(x); }

static uint32_t wrapped(int x, int period) { return (uint32_t)(((x % period) + period) % period); }

/* Periods stay below 4099. */
static float lattice_at(uint32_t x, uint32_t y, uint32_t seed) {
    return lw_random_unit(lw_random_hash(x + 4099u * y + 0x9e3779b9u * seed));
}
static float lattice(int x, int y, int period, uint32_t seed) {
    return lattice_at(wrapped(x, period), wrapped(y, period), seed);
}

/* floorf, which is a call on processors that the compiler must assume, for |x| < 2^31. */
static int floor_int(float x) {
    const int i = (int)x;
    return i - ((float)i > x);
}

/** Value noise in [0, 1] that repeats after `period` cells. */
static float noise(float x, float y, int period, uint32_t seed) {
    const int fx = floor_int(x), fy = floor_int(y);
    const bool within = (uint32_t)fx < (uint32_t)period && (uint32_t)fy < (uint32_t)period;
    const uint32_t ix = within ? (uint32_t)fx : wrapped(fx, period),
                   iy = within ? (uint32_t)fy : wrapped(fy, period),
                   next_x = ix + 1 < (uint32_t)period ? ix + 1 : 0,
                   next_y = iy + 1 < (uint32_t)period ? iy + 1 : 0;
    float tx = x - (float)fx, ty = y - (float)fy;
    tx = tx * tx * (3.0f - 2.0f * tx);
    ty = ty * ty * (3.0f - 2.0f * ty);
    return mix(mix(lattice_at(ix, iy, seed), lattice_at(next_x, iy, seed), tx),
               mix(lattice_at(ix, next_y, seed), lattice_at(next_x, next_y, seed), tx), ty);
}

/** Octaves of noise over the unit square, in [0, 1], starting with `cells` cells. */
static float fractal(float u, float v, int cells, int octaves, uint32_t seed) {
    float sum = 0, weight = 0.5f, total = 0;
    for (int i = 0; i < octaves; i++, weight *= 0.5f, cells *= 2) {
        sum += weight * noise(u * (float)cells, v * (float)cells, cells, seed + (uint32_t)i);
        total += weight;
    }
    return sum / total;
}

static struct lw_vec3 blend(struct lw_vec3 a, struct lw_vec3 b, float t) {
    return lw_vec3(mix(a.x, b.x, t), mix(a.y, b.y, t), mix(a.z, b.z, t));
}
static struct lw_vec4 opaque(struct lw_vec3 c) { return (struct lw_vec4){c.x, c.y, c.z, 1}; }

/** Distance to the nearest edge of cells of the given size, and which cell it is. */
struct cell {
    int x, y;
    float edge; /* in units of u */
};
static struct cell brick(float u, float v, int columns, int rows, float stagger) {
    float row = v * (float)rows, column = u * (float)columns;
    int iy = (int)floorf(row);
    column += (iy & 1) ? stagger : 0.0f;
    int ix = (int)floorf(column);
    float fx = column - (float)ix, fy = row - (float)iy;
    return (struct cell){((ix % columns) + columns) % columns, iy,
                         fminf(fminf(fx, 1 - fx) / (float)columns, fminf(fy, 1 - fy) / (float)rows)};
}

/* ---- textures ---- */

static struct lw_vec4 plaster(float u, float v) {
    float clouds = fractal(u, v, 4, 5, 11), grain = fractal(u, v, 64, 2, 17);
    struct lw_vec3 c =
        blend(lw_vec3(0.84f, 0.75f, 0.62f), lw_vec3(0.91f, 0.86f, 0.76f), smooth(0.25f, 0.75f, clouds));
    c = blend(c, lw_vec3(0.76f, 0.66f, 0.53f), 0.5f * smooth(0.62f, 0.8f, fractal(u, v, 3, 4, 29)));
    return opaque(lw_vec3_scale(c, 0.95f + 0.07f * grain));
}

static struct lw_vec4 ashlar(float u, float v) {
    struct cell block = brick(u, v, 2, 4, 0.5f);
    float tint = lattice(block.x, block.y, 64, 5), hue = lattice(block.x, block.y, 64, 6);
    float grain = fractal(u, v, 16, 5, 7 + (uint32_t)block.y);
    struct lw_vec3 c = blend(lw_vec3(0.83f, 0.76f, 0.64f), lw_vec3(0.87f, 0.82f, 0.73f), tint);
    c = blend(c, lw_vec3(0.84f, 0.72f, 0.58f), 0.5f * hue);
    c = lw_vec3_scale(c, 0.88f + 0.15f * grain);
    float pits = smooth(0.66f, 0.74f, fractal(u, v, 32, 3, 77));
    c = lw_vec3_scale(c, 1.0f - 0.16f * pits);
    float joint = 1.0f - smooth(0.0025f, 0.006f, block.edge + 0.003f * (grain - 0.5f));
    return opaque(blend(c, lw_vec3(0.60f, 0.53f, 0.44f), 0.75f * joint));
}

/** Light veined stone between two tints. */
static struct lw_vec3 veined(float u, float v, struct lw_vec3 light, struct lw_vec3 vein, uint32_t seed) {
    float warp = fractal(u, v, 3, 5, seed);
    float ridge = fabsf(2.0f * noise(4.0f * u + 3.0f * warp, 4.0f * v + 2.0f * warp, 4, seed + 40) - 1.0f);
    float fine = fabsf(2.0f * fractal(u + 0.13f * warp, v, 8, 3, seed + 50) - 1.0f);
    struct lw_vec3 c = blend(vein, light, 0.35f + 0.65f * smooth(0.0f, 0.22f, ridge));
    c = blend(c, vein, 0.35f * (1.0f - smooth(0.0f, 0.10f, fine)));
    return lw_vec3_scale(c, 0.95f + 0.07f * warp);
}

static struct lw_vec4 marble(float u, float v) {
    return opaque(veined(u, v, lw_vec3(0.91f, 0.87f, 0.80f), lw_vec3(0.72f, 0.64f, 0.55f), 100));
}

/** The stone of one field of the floor; out_line: how far the nearest joint is. */
static struct lw_vec3 inlaid_stone(float u, float v, float *out_line) {
    const struct lw_vec3 cream = lw_vec3(0.86f, 0.80f, 0.68f), porphyry = lw_vec3(0.55f, 0.23f, 0.20f),
                         serpentine = lw_vec3(0.30f, 0.42f, 0.34f), ochre = lw_vec3(0.76f, 0.62f, 0.42f),
                         grey = lw_vec3(0.56f, 0.54f, 0.52f);
    float x = fabsf(u - 0.5f) * 2, y = fabsf(v - 0.5f) * 2; /* 0 in the middle, 1 at the rim */
    float square = fmaxf(x, y), diamond = x + y, radius = sqrtf(x * x + y * y);
    struct lw_vec3 stone = (square > 0.94f) ? grey : (square > 0.88f) ? cream : ochre;
    float line = fminf(fabsf(square - 0.94f), fabsf(square - 0.88f));
    if (square < 0.88f) {
        if (diamond < 0.88f) stone = cream;
        if (diamond < 0.80f) stone = serpentine;
        line = fminf(line, fminf(fabsf(diamond - 0.88f), fabsf(diamond - 0.80f)) * 0.7f);
        float corner = sqrtf((x - 0.66f) * (x - 0.66f) + (y - 0.66f) * (y - 0.66f));
        if (corner < 0.17f) stone = corner < 0.11f ? porphyry : cream;
        line = fminf(line, fminf(fabsf(corner - 0.17f), fabsf(corner - 0.11f)));
        if (radius < 0.52f) stone = cream;
        if (radius < 0.46f) stone = porphyry;
        float turn = atan2f(v - 0.5f, u - 0.5f) * 8.0f / (2.0f * LW_PI),
              star = 0.21f + 0.2f * fabsf(fraction(turn) - 0.5f) * 2.0f;
        if (radius < star) stone = cream;
        if (radius < 0.16f) stone = ochre;
        line = fminf(line, fminf(fabsf(radius - 0.52f), fabsf(radius - 0.46f)));
        line = fminf(line, fminf(fabsf(radius - 0.16f), fabsf(radius - star) * 0.6f));
    }
    *out_line = line;
    return stone;
}

static struct lw_vec4 inlay(float u, float v) {
    float line;
    struct lw_vec3 stone = inlaid_stone(u, v, &line);
    float clouds = fractal(u, v, 8, 4, 200);
    float vein = fabsf(2.0f * noise(6.0f * u + 2.0f * clouds, 6.0f * v, 6, 210) - 1.0f);
    stone = lw_vec3_scale(stone, (0.84f + 0.2f * clouds) * (0.88f + 0.12f * smooth(0.0f, 0.15f, vein)));
    return opaque(lw_vec3_scale(stone, 0.72f + 0.28f * smooth(0.001f, 0.006f, line)));
}

/** 1 inside the line of a Greek key, for x in periods and y in [0, 1]. */
static float greek_key(float x, float y) {
    static const char rows[7][9] = {"########", "......#.", ".####.#.", ".#..#.#.",
                                    ".#....#.", ".######.", "........"};
    int column = (int)(fraction(x) * 8.0f), row = (int)(clamp01(y) * 6.999f);
    return rows[row][column] == '#' ? 1.0f : 0.0f;
}

static struct lw_vec4 meander(float u, float v) {
    float key = (v > 0.14f && v < 0.86f) ? greek_key(u * 4.0f, (v - 0.14f) / 0.72f) : 0.0f;
    if (v < 0.06f || v > 0.94f) key = 1.0f;
    struct lw_vec3 c = blend(lw_vec3(0.85f, 0.79f, 0.67f), lw_vec3(0.33f, 0.24f, 0.22f), key);
    c = lw_vec3_scale(c, 0.88f + 0.16f * fractal(u, v, 16, 4, 300));
    float tessera = fminf(fabsf(fraction(u * 64.0f) - 0.5f), fabsf(fraction(v * 16.0f) - 0.5f));
    return opaque(lw_vec3_scale(c, 0.94f + 0.06f * smooth(0.0f, 0.2f, 0.5f - tessera)));
}

static struct lw_vec4 tiles(float u, float v) {
    struct cell tile = brick(u, v, 4, 4, 0);
    float tint = lattice(tile.x, tile.y, 64, 31);
    bool light = (tile.x + tile.y) & 1;
    struct lw_vec3 c = light ? blend(lw_vec3(0.80f, 0.66f, 0.50f), lw_vec3(0.84f, 0.73f, 0.58f), tint)
                             : blend(lw_vec3(0.66f, 0.37f, 0.25f), lw_vec3(0.73f, 0.45f, 0.31f), tint);
    c = lw_vec3_scale(c, 0.86f + 0.2f * fractal(u, v, 8, 5, 37));
    return opaque(blend(lw_vec3(0.52f, 0.44f, 0.37f), c, smooth(0.003f, 0.008f, tile.edge)));
}

static struct lw_vec4 wood(float u, float v) {
    int plank = (int)(u * 4.0f) & 3;
    float across = fraction(u * 4.0f), edge = fminf(across, 1 - across) / 4.0f;
    float grain = fractal(u * 1.0f + 0.37f * (float)plank, v, 4, 3, 401);
    float rings = 0.5f + 0.5f * sinf(2.0f * LW_PI * (6.0f * across + 7.0f * grain));
    float fibre = noise(u * 128.0f, v * 8.0f, 128, 411 + (uint32_t)plank);
    struct lw_vec3 c =
        blend(lw_vec3(0.40f, 0.26f, 0.16f), lw_vec3(0.58f, 0.40f, 0.26f), 0.6f * rings + 0.4f * fibre);
    c = lw_vec3_scale(c, 0.88f + 0.2f * lattice(plank, 0, 64, 421));
    return opaque(lw_vec3_scale(c, 0.4f + 0.6f * smooth(0.001f, 0.006f, edge)));
}

static struct lw_vec4 roof_tiles(float u, float v) {
    float across = fraction(u * 4.0f), along = fraction(v * 4.0f);
    float tint = lattice((int)(u * 4.0f), (int)(v * 4.0f), 64, 51);
    struct lw_vec3 c = blend(lw_vec3(0.60f, 0.32f, 0.21f), lw_vec3(0.75f, 0.47f, 0.32f), tint);
    float round = 0.55f + 0.45f * sinf(LW_PI * across), lap = smooth(0.0f, 0.12f, along);
    return opaque(lw_vec3_scale(c, round * (0.7f + 0.3f * lap) * (0.9f + 0.15f * fractal(u, v, 16, 3, 55))));
}

static struct lw_vec4 cloth(float u, float v, struct lw_vec3 ground, struct lw_vec3 figure) {
    const struct lw_vec3 gold = lw_vec3(0.82f, 0.64f, 0.30f);
    /* ogee lattice: two sine waves that touch, with a lozenge in every eye */
    float wave = 0.25f * sinf(2.0f * LW_PI * v * 4.0f), column = fraction(u * 4.0f) - 0.5f;
    float lattice_line = fminf(fabsf(fabsf(column) - (0.25f + wave)), fabsf(fabsf(column) - (0.25f - wave)));
    float eye = fabsf(column) * 2.2f + fabsf(fraction(v * 4.0f - 0.75f) - 0.5f) * 1.6f;
    float eye2 = (0.5f - fabsf(column)) * 2.2f + fabsf(fraction(v * 4.0f - 0.25f) - 0.5f) * 1.6f;
    float motif = fmaxf(1.0f - smooth(0.02f, 0.045f, lattice_line),
                        fmaxf(1.0f - smooth(0.22f, 0.26f, eye), 1.0f - smooth(0.22f, 0.26f, eye2)));
    struct lw_vec3 c = blend(ground, figure, 0.8f * motif);
    float rim = fminf(u, 1.0f - u);
    float band = smooth(0.016f, 0.020f, rim) * (1.0f - smooth(0.075f, 0.079f, rim));
    float key = rim > 0.03f && rim < 0.066f ? greek_key(v * 10.0f, (rim - 0.03f) / 0.036f) : 0.0f;
    c = blend(c, blend(gold, ground, key), band);
    float weave = 0.5f + 0.25f * sinf(2.0f * LW_PI * u * 128.0f) + 0.25f * sinf(2.0f * LW_PI * v * 128.0f);
    return opaque(lw_vec3_scale(c, 0.90f + 0.06f * weave + 0.07f * fractal(u, v, 8, 4, 61)));
}
static struct lw_vec4 red_cloth(float u, float v) {
    return cloth(u, v, lw_vec3(0.66f, 0.16f, 0.13f), lw_vec3(0.48f, 0.09f, 0.09f));
}
static struct lw_vec4 blue_cloth(float u, float v) {
    return cloth(u, v, lw_vec3(0.17f, 0.29f, 0.60f), lw_vec3(0.11f, 0.18f, 0.42f));
}
static struct lw_vec4 green_cloth(float u, float v) {
    return cloth(u, v, lw_vec3(0.19f, 0.46f, 0.25f), lw_vec3(0.12f, 0.33f, 0.19f));
}

static struct lw_vec4 frond(float u, float v) {
    float side = (u - 0.5f) * 2.0f, x = fabsf(side);
    float reach = 0.96f * powf(sinf(LW_PI * fminf(powf(v, 0.62f) * 0.97f + 0.03f, 1.0f)), 0.6f) + 0.01f;
    float slot = (v - 0.13f * x) * 26.0f + (side < 0 ? 0.5f : 0.0f), along = x / reach;
    float width = 0.42f * (1.0f - powf(clamp01(along), 3.0f)) * smooth(0.0f, 0.15f, along + 0.05f);
    float leaflet = fabsf(fraction(slot) - 0.5f);
    bool inside = (along < 1.0f && leaflet < width && v > 0.12f && v < 0.985f) || x < 0.035f * (1.15f - v);
    float tint = lattice((int)floorf(slot), side < 0, 64, 71);
    struct lw_vec3 c =
        blend(lw_vec3(0.22f, 0.37f, 0.12f), lw_vec3(0.42f, 0.55f, 0.20f), 0.5f * tint + 0.5f * v);
    c = lw_vec3_scale(c, 1.0f - 0.25f * (1.0f - smooth(0.0f, 0.08f, leaflet)));
    if (x < 0.035f) c = lw_vec3(0.50f, 0.52f, 0.26f);
    return (struct lw_vec4){c.x, c.y, c.z, inside ? 1.0f : 0.0f};
}

static struct lw_vec4 leaf(float u, float v) {
    float x = fabsf(u - 0.5f) * 2.0f;
    float half = 0.93f * powf(sinf(LW_PI * clamp01(powf(v, 0.75f))), 0.8f);
    float vein = fabsf(fraction((v - 0.45f * x) * 9.0f) - 0.5f);
    struct lw_vec3 c =
        blend(lw_vec3(0.17f, 0.36f, 0.14f), lw_vec3(0.34f, 0.52f, 0.20f), fractal(u, v, 4, 3, 81));
    c = blend(lw_vec3(0.55f, 0.62f, 0.34f), c,
              fminf(smooth(0.02f, 0.06f, x), 0.6f + 0.4f * smooth(0.02f, 0.10f, vein)));
    bool inside = x < half || (x < 0.06f && v < 0.1f);
    return (struct lw_vec4){c.x, c.y, c.z, inside ? 1.0f : 0.0f};
}

/** The amphora's paint before any wear: 0 or 1. */
static float pottery_paint(float u, float v) {
    float paint = 0;
    if (v < 0.10f)
        paint = 1;
    else if (v > 0.16f && v < 0.17f)
        paint = 1;
    else if (v > 0.19f && v < 0.29f)
        paint = greek_key(u * 8.0f, (v - 0.19f) / 0.10f);
    else if (v > 0.31f && v < 0.32f)
        paint = 1;
    else if (v > 0.36f && v < 0.56f) { /* tongues */
        float across = fabsf(fraction(u * 16.0f) - 0.5f) * 2.0f, down = (v - 0.36f) / 0.20f;
        paint = across < 0.72f * sqrtf(clamp01(1.0f - down * down)) ? 1.0f : 0.0f;
    } else if (v > 0.60f && v < 0.64f)
        paint = 1;
    else if (v > 0.70f && v < 0.78f)
        paint = sinf(2.0f * LW_PI * u * 12.0f) * 0.03f + 0.74f > v ? 1.0f : 0.0f;
    else if (v > 0.84f)
        paint = v < 0.96f;
    return paint;
}
static float pottery_gloss(float u, float v) {
    return pottery_paint(u, v) * smooth(0.16f, 0.28f, fractal(u, v, 8, 5, 91));
}

static struct lw_vec4 pottery(float u, float v) {
    const struct lw_vec3 clay = lw_vec3(0.76f, 0.45f, 0.28f), black = lw_vec3(0.17f, 0.13f, 0.12f);
    struct lw_vec3 c = blend(clay, black, pottery_gloss(u, v));
    return opaque(lw_vec3_scale(c, 0.84f + 0.22f * fractal(u, v, 4, 4, 95)));
}

/* ---- the city's ---- */

static struct lw_vec4 setts(float u, float v) {
    struct cell stone = brick(u, v, 12, 16, 0.5f);
    float tint = lattice(stone.x, stone.y, 64, 501), grain = fractal(u, v, 32, 3, 503);
    struct lw_vec3 c = blend(lw_vec3(0.42f, 0.41f, 0.40f), lw_vec3(0.58f, 0.55f, 0.51f), tint);
    c = lw_vec3_scale(c, 0.85f + 0.2f * grain);
    return opaque(blend(lw_vec3(0.29f, 0.27f, 0.25f), c, smooth(0.003f, 0.012f, stone.edge)));
}

static struct lw_vec4 paving(float u, float v) {
    struct cell slab = brick(u, v, 3, 4, 0.5f);
    float tint = lattice(slab.x, slab.y, 64, 511);
    struct lw_vec3 c = blend(lw_vec3(0.62f, 0.60f, 0.56f), lw_vec3(0.72f, 0.69f, 0.63f), tint);
    c = lw_vec3_scale(c, 0.86f + 0.18f * fractal(u, v, 16, 4, 513));
    return opaque(blend(lw_vec3(0.42f, 0.40f, 0.37f), c, smooth(0.003f, 0.009f, slab.edge)));
}

static struct lw_vec4 bricks(float u, float v) {
    struct cell one = brick(u, v, 4, 14, 0.5f);
    float tint = lattice(one.x, one.y, 64, 521);
    struct lw_vec3 c = blend(lw_vec3(0.58f, 0.31f, 0.24f), lw_vec3(0.72f, 0.44f, 0.33f), tint);
    c = lw_vec3_scale(c, 0.88f + 0.16f * fractal(u, v, 32, 3, 523));
    return opaque(blend(lw_vec3(0.74f, 0.69f, 0.62f), c, smooth(0.003f, 0.007f, one.edge)));
}

static struct lw_vec4 grass(float u, float v) {
    float clump = fractal(u, v, 8, 4, 531), blade = noise(u * 64.0f, v * 64.0f, 64, 533);
    struct lw_vec3 c = blend(lw_vec3(0.27f, 0.40f, 0.16f), lw_vec3(0.45f, 0.55f, 0.25f), clump);
    return opaque(lw_vec3_scale(c, 0.8f + 0.3f * blade));
}

static struct lw_vec4 foliage(float u, float v) {
    float leaves = noise(u * 48.0f, v * 48.0f, 48, 541), clump = fractal(u, v, 6, 3, 543);
    struct lw_vec3 c =
        blend(lw_vec3(0.17f, 0.32f, 0.12f), lw_vec3(0.42f, 0.56f, 0.22f), 0.6f * clump + 0.4f * leaves);
    return opaque(lw_vec3_scale(c, 0.6f + 0.5f * smooth(0.15f, 0.6f, leaves)));
}

static struct lw_vec4 slate(float u, float v) {
    struct cell one = brick(u, v, 6, 6, 0.5f);
    float tint = lattice(one.x, one.y, 64, 551), lap = fraction(v * 6.0f);
    struct lw_vec3 c = blend(lw_vec3(0.33f, 0.36f, 0.41f), lw_vec3(0.46f, 0.48f, 0.52f), tint);
    c = lw_vec3_scale(c, (0.75f + 0.25f * smooth(0.0f, 0.15f, lap)) *
                             (0.9f + 0.12f * fractal(u, v, 16, 3, 553)));
    return opaque(lw_vec3_scale(c, 0.7f + 0.3f * smooth(0.002f, 0.008f, one.edge)));
}

static struct lw_vec4 stripes(float u, float v) {
    (void)v;
    float edge = fabsf(fraction(u * 2.0f) - 0.5f) * 2.0f;
    return opaque(
        blend(lw_vec3(0.88f, 0.85f, 0.78f), lw_vec3(0.70f, 0.22f, 0.18f), smooth(0.48f, 0.52f, edge)));
}

/* ---- reliefs ---- */

#define EVEN(height_mm) ((struct grain){(height_mm), 1, 1})

/** Heights that the trowel and the sand leave. */
static struct grain plaster_relief(float u, float v) {
    return EVEN(9.0f * fractal(u, v, 6, 3, 611) + 2.2f * fractal(u, v, 48, 2, 613));
}

static struct grain ashlar_relief(float u, float v) {
    struct cell block = brick(u, v, 2, 4, 0.5f);
    float grain = fractal(u, v, 16, 5, 7 + (uint32_t)block.y);
    float joint = 1.0f - smooth(0.0015f, 0.008f, block.edge + 0.003f * (grain - 0.5f));
    float pits = smooth(0.66f, 0.74f, fractal(u, v, 32, 3, 77));
    return (struct grain){6.0f * grain - 1.6f * pits - 4.5f * joint, 1, 1.0f - 0.5f * joint};
}

/** Sawn and rubbed, not polished: hands and weather have dulled it in places. */
static struct grain marble_relief(float u, float v) {
    float worn = smooth(0.40f, 0.70f, fractal(u, v, 5, 4, 621));
    return (struct grain){2.4f * fractal(u, v, 8, 4, 623), 0.30f + 0.22f * worn, 1};
}

static struct grain inlay_relief(float u, float v) {
    float line, worn = smooth(0.35f, 0.75f, fractal(u, v, 4, 5, 631));
    struct lw_vec3 stone = inlaid_stone(u, v, &line);
    float joint = 1.0f - smooth(0.002f, 0.008f, line), soft = smooth(0.4f, 0.8f, stone.y);
    return (struct grain){1.6f * fractal(u, v, 4, 3, 633) - 1.0f * joint,
                          mix(0.13f + 0.06f * soft + 0.20f * worn, 0.75f, joint), 1.0f - 0.4f * joint};
}

/** No stone of a mosaic lies quite level. */
static struct grain meander_relief(float u, float v) {
    float x = u * 64.0f, y = v * 16.0f, fx = fraction(x) - 0.5f, fy = fraction(y) - 0.5f;
    int ix = floor_int(x), iy = floor_int(y);
    float lean_x = lattice(ix, iy, 64, 641) - 0.5f, lean_y = lattice(ix, iy, 64, 643) - 0.5f;
    float gap = smooth(0.38f, 0.5f, fmaxf(fabsf(fx), fabsf(fy)));
    return (struct grain){1.2f * (lean_x * fx + lean_y * fy) - 1.2f * gap,
                          mix(0.22f + 0.14f * lattice(ix, iy, 64, 645), 0.85f, gap), 1.0f - 0.4f * gap};
}

/** Glazed terracotta, bowed as kilns leave it; feet have dulled it in places. */
static struct grain tiles_relief(float u, float v) {
    struct cell tile = brick(u, v, 4, 4, 0);
    float grout = 1.0f - smooth(0.003f, 0.008f, tile.edge), rim = smooth(0.003f, 0.022f, tile.edge);
    float worn = smooth(0.42f, 0.72f, fractal(u, v, 6, 4, 651));
    float glaze = 0.14f + 0.08f * lattice(tile.x, tile.y, 64, 653) + 0.26f * worn;
    return (struct grain){3.5f * rim + 2.0f * fractal(u, v, 8, 4, 655), mix(glaze, 0.92f, grout),
                          1.0f - 0.5f * grout};
}

static struct grain wood_relief(float u, float v) {
    float across = fraction(u * 4.0f), edge = fminf(across, 1 - across) / 4.0f;
    float sway = 3.0f * noise(u * 8.0f, v * 8.0f, 8, 657); /* the fibres', which run along v */
    float fibre = noise(u * 128.0f + sway, 0, 128, 659);
    return EVEN(0.7f * fibre + 4.0f * smooth(0.001f, 0.008f, edge));
}

static struct grain roof_relief(float u, float v) {
    float across = fraction(u * 4.0f), along = fraction(v * 4.0f);
    return EVEN(30.0f * sinf(LW_PI * across) + 12.0f * smooth(0.0f, 0.12f, along));
}

static struct grain weave_relief(float u, float v) {
    float weave = 0.5f * sinf(2.0f * LW_PI * u * 128.0f) + 0.5f * sinf(2.0f * LW_PI * v * 128.0f);
    return EVEN(0.45f * weave + 14.0f * fractal(u, v, 8, 3, 661));
}

static struct grain pottery_relief(float u, float v) {
    float gloss = pottery_gloss(u, v);
    return (struct grain){1.2f * fractal(u, v, 8, 3, 671),
                          mix(0.68f, 0.24f + 0.12f * fractal(u, v, 6, 3, 673), gloss), 1};
}

/** Hammered and polished, then handled. */
static struct grain bronze_relief(float u, float v) {
    float worn = smooth(0.35f, 0.70f, fractal(u, v, 6, 4, 681));
    return (struct grain){2.6f * fractal(u, v, 14, 2, 683), 0.24f + 0.26f * worn, 1};
}

/** Waves that the air makes, of 11 to 50 cm. */
static struct grain ripples_relief(float u, float v) {
    static const struct {
        float x, y, mm, phase;
    } wave[] = {{2, 1, 1.00f, 0.3f},  {-1, 2, 0.90f, 1.9f}, {3, -2, 0.50f, 4.0f}, {4, 3, 0.34f, 2.6f},
                {-3, 5, 0.24f, 0.8f}, {6, -5, 0.16f, 5.3f}, {-7, -4, 0.14f, 3.1f}};
    float height = 0;
    for (unsigned i = 0; i < sizeof wave / sizeof *wave; i++)
        height += wave[i].mm * sinf(2.0f * LW_PI * (wave[i].x * u + wave[i].y * v) + wave[i].phase);
    return EVEN(height);
}

/* ---- storing ---- */

static uint8_t quantise(float x) { return (uint8_t)(clamp01(x) * 255.0f + 0.5f); }

uint32_t lw_builtin_texture_add(struct lw_builtin_stage *stage, enum lw_builtin_texture_kind kind) {
    static const struct {
        const char *name;
        uint32_t width, height;
        struct lw_vec4 (*texel)(float u, float v);
    } textures[LW_BUILTIN_TEXTURE_COUNT] = {
#define X(kind, name, width, height) {#name, width, height, name},
        LW_BUILTIN_TEXTURE_MAP(X)
#undef X
    };
    uint32_t width = textures[kind].width, height = textures[kind].height, index;
    uint8_t *rgba = lw_builtin_stage_texture(stage, textures[kind].name, width, height, &index);
    if (!rgba) return index;
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++, rgba += 4) {
            struct lw_vec4 c =
                textures[kind].texel(((float)x + 0.5f) / (float)width, ((float)y + 0.5f) / (float)height);
            rgba[0] = quantise(c.x);
            rgba[1] = quantise(c.y);
            rgba[2] = quantise(c.z);
            rgba[3] = quantise(c.w);
        }
    return index;
}

static void store_surface(uint8_t *rgba, const struct grain *grain, size_t count) {
    for (size_t i = 0; i < count; i++, rgba += 4) {
        rgba[0] = quantise(grain[i].open);
        rgba[1] = quantise(grain[i].roughness);
        rgba[2] = rgba[3] = 255;
    }
}

/** y of a normal is up in the picture, rows run down. texel_mm: side of a texel. */
static void store_normals(uint8_t *rgba, const struct grain *grain, uint32_t width, uint32_t height,
                          float texel_mm) {
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++, rgba += 4) {
            const struct grain *row = &grain[(size_t)y * width],
                               *above = &grain[(size_t)(y ? y - 1 : height - 1) * width],
                               *below = &grain[(size_t)(y + 1 < height ? y + 1 : 0) * width];
            const float right =
                row[x + 1 < width ? x + 1 : 0].height_mm - row[x ? x - 1 : width - 1].height_mm;
            const float up = above[x].height_mm - below[x].height_mm;
            const struct lw_vec3 n = lw_vec3_normalize(lw_vec3(-right, -up, 2 * texel_mm));
            rgba[0] = (uint8_t)(127.5f * (1 + n.x) + 0.5f);
            rgba[1] = (uint8_t)(127.5f * (1 + n.y) + 0.5f);
            rgba[2] = (uint8_t)(127.5f * (1 + n.z) + 0.5f);
            rgba[3] = 255;
        }
}

struct lw_builtin_relief lw_builtin_texture_add_relief(struct lw_builtin_stage *stage,
                                                       enum lw_builtin_relief_kind kind) {
    static const struct {
        const char *normal, *surface;
        uint32_t width, height;
        float metres;
        bool is_even;
        struct grain (*grain)(float u, float v);
    } reliefs[LW_BUILTIN_RELIEF_COUNT] = {
#define X(kind, name, width, height, metres, even)                                                           \
    {#name " normal", #name " surface", width, height, metres, even, name##_relief},
        LW_BUILTIN_RELIEF_MAP(X)
#undef X
    };
    struct lw_builtin_relief out = {LW_SCENE_NONE, LW_SCENE_NONE};
    const uint32_t width = reliefs[kind].width, height = reliefs[kind].height;
    struct grain *grain = malloc((size_t)width * height * sizeof *grain);
    if (!grain) {
        stage->failed = true;
        return out;
    }
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            grain[(size_t)y * width + x] =
                reliefs[kind].grain(((float)x + 0.5f) / (float)width, ((float)y + 0.5f) / (float)height);
    uint8_t *rgba = lw_builtin_stage_finish_texture(stage, reliefs[kind].normal, width, height,
                                                    LW_CONTENT_NORMAL, &out.normal);
    if (rgba) store_normals(rgba, grain, width, height, 1e3f * reliefs[kind].metres / (float)width);
    rgba = reliefs[kind].is_even ? NULL
                                 : lw_builtin_stage_finish_texture(stage, reliefs[kind].surface, width,
                                                                   height, LW_CONTENT_SURFACE, &out.surface);
    if (rgba) store_surface(rgba, grain, (size_t)width * height);
    free(grain);
    return out;
}
