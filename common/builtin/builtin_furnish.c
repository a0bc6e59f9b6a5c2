#include "common/builtin/builtin_furnish.h"

#include "common/base/random.h"

#include <stdlib.h>

#define COUNT(array) ((uint32_t)(sizeof(array) / sizeof *(array)))

/** Catmull-Rom through a handful of points, so that a profile drawn with ten numbers turns smooth. */
static uint32_t smooth_profile(const struct lw_vec2 *points, uint32_t count, uint32_t steps, float scale,
                               struct lw_vec2 *out) {
    uint32_t n = 0;
    for (uint32_t i = 0; i + 1 < count; i++) {
        struct lw_vec2 a = points[i ? i - 1 : 0], b = points[i], c = points[i + 1],
                       d = points[i + 2 < count ? i + 2 : count - 1];
        for (uint32_t k = 0; k < steps; k++) {
            float t = (float)k / (float)steps, t2 = t * t, t3 = t2 * t;
            float wa = -t3 + 2 * t2 - t, wb = 3 * t3 - 5 * t2 + 2, wc = -3 * t3 + 4 * t2 + t, wd = t3 - t2;
            out[n++] =
                (struct lw_vec2){scale * 0.5f * fmaxf(wa * a.x + wb * b.x + wc * c.x + wd * d.x, 0.002f),
                                 scale * 0.5f * (wa * a.y + wb * b.y + wc * c.y + wd * d.y)};
        }
    }
    out[n++] = (struct lw_vec2){scale * points[count - 1].x, scale * points[count - 1].y};
    return n;
}

/* ---- vases ---- */

/* (radius, height) in units of the height, up the outside, over the lip, down the inside */
static const struct lw_vec2 amphora[] = {{0.10f, 0},      {0.115f, 0.02f}, {0.08f, 0.05f},   {0.14f, 0.18f},
                                         {0.235f, 0.38f}, {0.26f, 0.54f},  {0.21f, 0.68f},   {0.105f, 0.77f},
                                         {0.085f, 0.87f}, {0.10f, 0.95f},  {0.145f, 0.985f}, {0.14f, 1.0f},
                                         {0.10f, 0.98f},  {0.065f, 0.88f}, {0.07f, 0.80f},   {0, 0.78f}};
static const struct lw_vec2 krater[] = {{0.22f, 0},     {0.23f, 0.03f}, {0.12f, 0.08f}, {0.09f, 0.16f},
                                        {0.15f, 0.24f}, {0.29f, 0.36f}, {0.33f, 0.52f}, {0.30f, 0.72f},
                                        {0.34f, 0.90f}, {0.42f, 0.98f}, {0.41f, 1.0f},  {0.36f, 0.96f},
                                        {0.29f, 0.84f}, {0.27f, 0.70f}, {0.22f, 0.50f}, {0, 0.42f}};
static const struct lw_vec2 jar[] = {{0.20f, 0},     {0.22f, 0.02f}, {0.34f, 0.16f}, {0.44f, 0.38f},
                                     {0.43f, 0.58f}, {0.32f, 0.78f}, {0.21f, 0.88f}, {0.20f, 0.94f},
                                     {0.25f, 0.99f}, {0.24f, 1.0f},  {0.19f, 0.97f}, {0.17f, 0.90f},
                                     {0.25f, 0.80f}};
static const struct lw_vec2 pot[] = {{0.30f, 0},     {0.32f, 0.02f}, {0.40f, 0.40f}, {0.47f, 0.74f},
                                     {0.49f, 0.80f}, {0.56f, 0.83f}, {0.58f, 0.92f}, {0.56f, 1.0f},
                                     {0.51f, 0.99f}, {0.49f, 0.94f}, {0.47f, 0.82f}};

void lw_builtin_furnish_vase(struct lw_builtin_mesh *mesh, enum lw_builtin_vase kind, float height) {
    static const struct {
        const struct lw_vec2 *points;
        uint32_t count;
    } shapes[LW_BUILTIN_VASE_COUNT] = {[LW_BUILTIN_AMPHORA] = {amphora, COUNT(amphora)},
                                       [LW_BUILTIN_KRATER] = {krater, COUNT(krater)},
                                       [LW_BUILTIN_JAR] = {jar, COUNT(jar)},
                                       [LW_BUILTIN_POT] = {pot, COUNT(pot)}};
    struct lw_vec2 profile[16 * 5];
    uint32_t n = smooth_profile(shapes[kind].points, shapes[kind].count, 4, height, profile);
    lw_builtin_mesh_revolve(mesh, profile, n, 36);
}

static void disc(struct lw_builtin_mesh *mesh, float y, float radius, uint32_t segments) {
    const struct lw_vec2 profile[] = {{radius, y}, {0.6f * radius, y}, {0, y}};
    lw_builtin_mesh_revolve(mesh, profile, COUNT(profile), segments);
}

void lw_builtin_furnish_soil(struct lw_builtin_mesh *mesh, float height) {
    disc(mesh, 0.86f * height, 0.49f * height, 24);
}

/* ---- cloth ---- */

/** Where the middle of a cloth is after `t` metres over the rail, from its hem behind: (z, y). */
static struct lw_vec2 drape(const struct lw_builtin_cloth *cloth, float t) {
    const float radius = 0.17f, arc = 0.5f * LW_PI * radius; /* a quarter turn on each side of the top */
    t -= cloth->behind;
    if (t < -arc) return (struct lw_vec2){-radius - 0.015f, t + arc - radius};
    if (t < arc) return (struct lw_vec2){radius * sinf(t / radius), radius * (cosf(t / radius) - 1.0f)};
    float down = t - arc, slide = fminf(down / cloth->clear_below, 1.0f);
    slide = slide * slide * (3.0f - 2.0f * slide);
    return (struct lw_vec2){radius + (cloth->clear - radius) * slide, -radius - down};
}

void lw_builtin_furnish_cloth(struct lw_builtin_mesh *mesh, const struct lw_builtin_cloth *cloth) {
    enum { ROWS = 73, COLUMNS = 49 };
    struct lw_vec3 *points = malloc(sizeof *points * ROWS * COLUMNS);
    if (!points) {
        mesh->failed = true;
        return;
    }
    for (uint32_t r = 0; r < ROWS; r++) {
        /* rows run up, so the last is the hem behind: fronts face the court */
        float t = (cloth->behind + cloth->front) * (1.0f - (float)r / (float)(ROWS - 1));
        struct lw_vec2 at = drape(cloth, t);
        float hang = fmaxf(0, fabsf(t - cloth->behind) - 0.3f), fold = hang / (hang + 0.8f);
        float gather = 1.0f - 0.22f * fold;
        for (uint32_t c = 0; c < COLUMNS; c++) {
            float s = 2.0f * (float)c / (float)(COLUMNS - 1) - 1.0f;
            float wave = sinf(9.5f * s + cloth->phase + 0.25f * hang) +
                         0.45f * sinf(16.0f * s + 2.1f * cloth->phase - 0.4f * hang) +
                         0.30f * sinf(5.0f * s - cloth->phase);
            float away = t > cloth->behind ? 1.0f : -0.15f;
            float sway = 0.05f * sinf(0.9f * hang + cloth->phase) * fold;
            points[r * COLUMNS + c] = lw_vec3(0.5f * cloth->width * gather * s + sway +
                                                  0.02f * fold * cosf(9.5f * s + cloth->phase),
                                              at.y + 0.03f * fold * cosf(3.0f * s + cloth->phase),
                                              at.x + away * 0.095f * fold * (1.75f + wave));
        }
    }
    float crease_cos = mesh->crease_cos;
    mesh->crease_cos = -1.0f;
    lw_builtin_mesh_patch(mesh, points, ROWS, COLUMNS, 0);
    mesh->crease_cos = crease_cos;
    free(points);
}

/* ---- plants ---- */

/** A sheet that grows from `root` along `heading` and bends down: one leaf, with its picture fitted to it. */
struct blade {
    struct lw_vec3 root;
    float heading, rise;       /* radians: about +Y, above the horizon at the root */
    float droop;               /* radians that it has bent by when it ends */
    float length, width, fold; /* fold: radians that each half is raised by */
};

static void add_blade(struct lw_builtin_mesh *mesh, const struct blade *b) {
    enum { ROWS = 9, COLUMNS = 3 };
    struct lw_vec3 p[ROWS * COLUMNS], n[ROWS * COLUMNS];
    uint32_t index[ROWS * COLUMNS];
    struct lw_vec3 out = lw_vec3(sinf(b->heading), 0, cosf(b->heading)), side = lw_vec3(out.z, 0, -out.x);
    struct lw_vec3 at = b->root;
    for (uint32_t r = 0; r < ROWS; r++) {
        float t = (float)r / (float)(ROWS - 1), pitch = b->rise - b->droop * t;
        struct lw_vec3 along = lw_vec3_add(lw_vec3_scale(out, cosf(pitch)), lw_vec3(0, sinf(pitch), 0));
        struct lw_vec3 up = lw_vec3_cross(along, side);
        for (uint32_t c = 0; c < COLUMNS; c++) {
            float s = (float)c - 1.0f;
            struct lw_vec3 across = lw_vec3_scale(side, 0.5f * b->width * cosf(b->fold) * s);
            p[r * COLUMNS + c] =
                lw_vec3_mad(lw_vec3_add(at, across), up, 0.5f * b->width * sinf(b->fold) * fabsf(s));
            n[r * COLUMNS + c] = lw_vec3_normalize(lw_vec3_mad(up, side, -0.8f * sinf(b->fold) * s));
        }
        at = lw_vec3_mad(at, along, b->length / (float)(ROWS - 1));
    }
    for (uint32_t i = 0; i < ROWS * COLUMNS; i++)
        index[i] = lw_builtin_mesh_vertex(
            mesh, p[i], n[i],
            (struct lw_vec2){0.5f * (float)(i % COLUMNS),
                             0.002f + 0.996f * (float)(i / COLUMNS) / (float)(ROWS - 1)});
    for (uint32_t r = 0; r + 1 < ROWS; r++)
        for (uint32_t c = 0; c + 1 < COLUMNS; c++) {
            const uint32_t *q = &index[r * COLUMNS + c];
            lw_builtin_mesh_triangle(mesh, q[0], q[COLUMNS + 1], q[1]);
            lw_builtin_mesh_triangle(mesh, q[0], q[COLUMNS], q[COLUMNS + 1]);
        }
}

static float pick(uint32_t seed, uint32_t index, uint32_t which, float low, float high) {
    return low + (high - low) * lw_random_unit(lw_random_hash3(seed, index, which));
}

void lw_builtin_furnish_palm(struct lw_builtin_mesh *mesh, float height, uint32_t fronds, uint32_t seed) {
    for (uint32_t i = 0; i < fronds; i++) {
        float age = (float)i / (float)fronds; /* young ones stand, old ones hang */
        struct blade b = {.heading = 2.399963f * (float)i + pick(seed, i, 0, -0.3f, 0.3f), /* golden angle */
                          .rise = 1.50f - 0.75f * age + pick(seed, i, 1, -0.08f, 0.08f),
                          .droop = 0.75f + 1.05f * age + pick(seed, i, 2, -0.15f, 0.15f),
                          .length = height * pick(seed, i, 3, 0.82f, 1.05f),
                          .fold = 0.45f};
        b.width = 0.42f * b.length;
        b.root = lw_vec3(0.05f * sinf(b.heading), 0, 0.05f * cosf(b.heading));
        add_blade(mesh, &b);
    }
}

void lw_builtin_furnish_bush(struct lw_builtin_mesh *mesh, float height, uint32_t leaves, uint32_t seed) {
    for (uint32_t i = 0; i < leaves; i++) {
        float level = sqrtf((float)i / (float)leaves), out = 0.34f * height * (1.05f - 0.7f * level);
        struct blade b = {.heading = 2.399963f * (float)i + pick(seed, i, 0, -0.4f, 0.4f),
                          .rise = 0.35f + 0.8f * level + pick(seed, i, 1, -0.2f, 0.2f),
                          .droop = pick(seed, i, 2, 0.5f, 1.1f),
                          .length = height * pick(seed, i, 3, 0.30f, 0.42f),
                          .fold = 0.30f};
        b.width = 0.62f * b.length;
        b.root = lw_vec3(0.5f * out * sinf(b.heading), 0.62f * height * level, 0.5f * out * cosf(b.heading));
        add_blade(mesh, &b);
    }
}

/* ---- water ---- */

void lw_builtin_furnish_basin(struct lw_builtin_mesh *mesh) {
    static const struct lw_vec2 rim[] = {{1.78f, 0},     {1.78f, 0.10f}, {1.70f, 0.14f}, {1.62f, 0.20f},
                                         {1.60f, 0.40f}, {1.66f, 0.45f}, {1.74f, 0.49f}, {1.76f, 0.53f},
                                         {1.74f, 0.57f}, {1.46f, 0.58f}, {1.43f, 0.55f}, {1.42f, 0.30f}};
    static const struct lw_vec2 foot[] = {{0.34f, 0.30f}, {0.34f, 0.52f}, {0.26f, 0.58f}, {0.15f, 0.66f},
                                          {0.13f, 0.80f}, {0.17f, 0.98f}, {0.16f, 1.06f}, {0.30f, 1.14f},
                                          {0.52f, 1.24f}, {0.60f, 1.34f}, {0.61f, 1.38f}, {0.57f, 1.39f},
                                          {0.48f, 1.30f}, {0.25f, 1.24f}, {0.0f, 1.23f}};
    lw_builtin_mesh_revolve(mesh, rim, COUNT(rim), 64);
    lw_builtin_mesh_revolve(mesh, foot, COUNT(foot), 40);
}

void lw_builtin_furnish_water(struct lw_builtin_mesh *mesh) {
    const struct lw_vec2 pool[] = {{1.44f, 0.44f}, {0.9f, 0.44f}, {0.32f, 0.44f}};
    lw_builtin_mesh_revolve(mesh, pool, COUNT(pool), 64);
    disc(mesh, 1.345f, 0.56f, 40);
}

/* ---- lamps and rings ---- */

/** A ring of round wire about local Z after the placement; flat > 1 makes it a band. */
static void ring(struct lw_builtin_mesh *mesh, float radius, float thick, float flat, uint32_t segments,
                 uint32_t around) {
    struct lw_vec2 profile[17];
    if (around > 16) around = 16;
    for (uint32_t i = 0; i <= around; i++) {
        float angle = 2.0f * LW_PI * (float)(i % around) / (float)around;
        profile[i] = (struct lw_vec2){radius + thick * cosf(angle), thick * flat * sinf(angle)};
    }
    lw_builtin_mesh_revolve(mesh, profile, around + 1, segments);
}

void lw_builtin_furnish_globe(struct lw_builtin_mesh *mesh, float radius, uint32_t segments) {
    struct lw_vec2 profile[33];
    uint32_t rows = segments / 2 > 32 ? 32 : segments / 2;
    for (uint32_t i = 0; i <= rows; i++) {
        float angle = LW_PI * (float)i / (float)rows;
        profile[i] = (struct lw_vec2){i == 0 || i == rows ? 0 : radius * sinf(angle), -radius * cosf(angle)};
    }
    lw_builtin_mesh_revolve(mesh, profile, rows + 1, segments);
}

void lw_builtin_furnish_lamp(struct lw_builtin_mesh *mesh, float radius, float chain) {
    struct lw_affine there = mesh->placement;
    const float r = radius;
    const struct lw_vec2 cap[] = {{1.25f * r, 1.02f * r}, {1.28f * r, 1.10f * r}, {0.95f * r, 1.28f * r},
                                  {0.45f * r, 1.55f * r}, {0.20f * r, 1.90f * r}, {0.16f * r, 2.20f * r},
                                  {0.24f * r, 2.32f * r}, {0.10f * r, 2.45f * r}, {0.0f, 2.46f * r}};
    lw_builtin_mesh_revolve(mesh, cap, COUNT(cap), 24);
    const struct lw_vec2 under[] = {{0, 1.06f * r}, {1.25f * r, 1.02f * r}};
    lw_builtin_mesh_revolve(mesh, under, COUNT(under), 24);
    const struct lw_vec2 tray[] = {{0, -1.45f * r},         {0.12f * r, -1.42f * r}, {0.18f * r, -1.32f * r},
                                   {0.45f * r, -1.24f * r}, {0.62f * r, -1.14f * r}, {0.60f * r, -1.08f * r},
                                   {0, -1.10f * r}};
    lw_builtin_mesh_revolve(mesh, tray, COUNT(tray), 24);
    for (int i = 0; i < 4; i++) { /* four bowed bars of the cage */
        struct lw_builtin_frame frames[9];
        float a = 0.5f * LW_PI * (float)i + 0.4f;
        for (int k = 0; k < 9; k++) {
            float t = (float)k / 8.0f, bow = 0.55f + 0.72f * sinf(LW_PI * (0.12f + 0.62f * t));
            struct lw_vec3 out = lw_vec3(sinf(a), 0, cosf(a));
            frames[k] = (struct lw_builtin_frame){
                .origin = lw_vec3_add(lw_vec3_scale(out, bow * r), lw_vec3(0, r * (-1.12f + 2.18f * t), 0)),
                .out = out,
                .up = lw_vec3(out.z, 0, -out.x)};
        }
        const float w = 0.05f * r;
        const struct lw_vec2 bar[] = {{w, -w}, {w, w}, {-w, w}, {-w, -w}, {w, -w}};
        lw_builtin_mesh_sweep(mesh, bar, COUNT(bar), frames, 9, LW_BUILTIN_FLIPPED);
    }
    const struct lw_vec2 wire[] = {{0.012f, 2.40f * r}, {0.012f, 2.40f * r + chain}};
    if (chain > 0) lw_builtin_mesh_revolve(mesh, wire, COUNT(wire), 8);
    mesh->placement = there;
}

void lw_builtin_furnish_armillary(struct lw_builtin_mesh *mesh, float radius) {
    struct lw_affine there = mesh->placement;
    static const float tilt[3] = {0.0f, 0.5f * LW_PI, 0.41f}; /* equator, meridian, ecliptic */
    for (int i = 0; i < 3; i++) {
        float c = cosf(tilt[i]), s = sinf(tilt[i]);
        struct lw_affine turn = {{{1, 0, 0, 0}, {0, c, -s, 0}, {0, s, c, 0}}};
        mesh->placement = lw_affine_multiply(&there, &turn);
        ring(mesh, radius * (1.0f - 0.085f * (float)i), 0.018f * radius, i == 2 ? 4.0f : 2.2f, 72, 12);
    }
    mesh->placement = there;
    lw_builtin_furnish_globe(mesh, 0.30f * radius, 32);
    const struct lw_vec2 axis[] = {{0.0f, -1.12f * radius},           {0.030f * radius, -1.08f * radius},
                                   {0.014f * radius, -1.0f * radius}, {0.014f * radius, 1.0f * radius},
                                   {0.030f * radius, 1.08f * radius}, {0.0f, 1.12f * radius}};
    lw_builtin_mesh_revolve(mesh, axis, COUNT(axis), 10);
}
