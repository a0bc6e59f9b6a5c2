#include "common/builtin/builtin_street.h"

#include "common/base/random.h"
#include "common/builtin/builtin_furnish.h"
#include "common/builtin/builtin_house.h"

#include <stdlib.h>

#define COUNT(array) ((uint32_t)(sizeof(array) / sizeof *(array)))

static const float quarter = 0.5f * LW_PI;

static void stand(struct lw_builtin_mesh *mesh, const struct lw_affine *there, float x, float y, float z,
                  float angle) {
    lw_builtin_mesh_place(mesh, lw_vec3(x, y, z), angle, lw_vec3(1, 1, 1));
    mesh->placement = lw_affine_multiply(there, &mesh->placement);
}

static void box(struct lw_builtin_mesh *mesh, float x0, float y0, float z0, float x1, float y1, float z1) {
    lw_builtin_mesh_box(mesh, lw_vec3(x0, y0, z0), lw_vec3(x1, y1, z1), LW_BUILTIN_ALL);
}

/** A level rectangle that faces up, cut into squares of about cell_m. */
static void ground(struct lw_builtin_mesh *mesh, float x0, float z0, float x1, float z1, float y,
                   float cell_m) {
    lw_builtin_mesh_quad(mesh, lw_vec3(x0, y, z1), lw_vec3(x1 - x0, 0, 0), lw_vec3(0, 0, z0 - z1), cell_m);
}

/* ---- paving ---- */

enum { KERB_ARC = 6, KERB_SIDE = 10, KERB_POINTS = 4 * (KERB_ARC + KERB_SIDE) + 1 };

/** The kerb's plan, a square with round corners, counter-clockwise seen from above; and the unit normals
 * outward. */
static void kerb_line(struct lw_vec3 point[KERB_POINTS], struct lw_vec3 out[KERB_POINTS]) {
    const float radius = LW_STREET_KERB - LW_STREET_FRONT, flat = LW_STREET_FRONT;
    uint32_t n = 0;
    for (int side = 0; side < 4; side++) {
        const float turn = quarter * (float)side;
        const struct lw_vec3 along = lw_vec3(cosf(turn), 0, -sinf(turn)),
                             normal = lw_vec3(sinf(turn), 0, cosf(turn));
        const struct lw_vec3 corner = lw_vec3_add(lw_vec3_scale(along, flat), lw_vec3_scale(normal, flat));
        for (int i = 0; i < KERB_SIDE; i++, n++) {
            out[n] = normal;
            point[n] = lw_vec3_mad(lw_vec3_scale(along, flat * (2.0f * (float)i / KERB_SIDE - 1.0f)), normal,
                                   LW_STREET_KERB);
        }
        for (int i = 0; i < KERB_ARC; i++, n++) {
            float a = quarter * (float)i / KERB_ARC;
            out[n] = lw_vec3_add(lw_vec3_scale(normal, cosf(a)), lw_vec3_scale(along, sinf(a)));
            point[n] = lw_vec3_mad(corner, out[n], radius);
        }
    }
    point[n] = point[0];
    out[n] = out[0];
}

/** White bars across the carriageway, just above it, where people cross towards -x beside a corner. */
static void crossing(struct lw_builtin_mesh *mesh) {
    for (int i = 0; i < 4; i++) {
        float z = LW_STREET_KERB + 0.4f + (float)i;
        lw_builtin_mesh_box(mesh, lw_vec3(21.0f, LW_STREET_ROAD_Y - 0.05f, z),
                            lw_vec3(24.0f, LW_STREET_ROAD_Y + 0.012f, z + 0.5f),
                            LW_BUILTIN_SIDES | LW_BUILTIN_TOP);
    }
}

void lw_builtin_street_tile(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints) {
    const struct lw_affine there = mesh->placement;
    struct lw_vec3 line[KERB_POINTS], out[KERB_POINTS], points[2 * KERB_POINTS];
    struct lw_builtin_frame frames[KERB_POINTS];
    const float half = 0.5f * LW_STREET_PITCH;
    kerb_line(line, out);
    for (uint32_t i = 0; i < KERB_POINTS; i++) {
        const struct lw_vec3 p = line[i];
        frames[i] = (struct lw_builtin_frame){.origin = p, .out = out[i], .up = lw_vec3(0, 1, 0)};
        /* straight across the street to the tile's rim; around the corner to the rim's corner */
        float reach = half / fmaxf(fabsf(p.x), fabsf(p.z));
        bool x_flat = fabsf(out[i].z) > 0.999f, z_flat = fabsf(out[i].x) > 0.999f;
        struct lw_vec3 rim = lw_vec3_scale(p, reach);
        if (x_flat) rim = lw_vec3(p.x, 0, copysignf(half, p.z));
        if (z_flat) rim = lw_vec3(copysignf(half, p.x), 0, p.z);
        points[i] = lw_vec3(rim.x, LW_STREET_ROAD_Y, rim.z);
        points[KERB_POINTS + i] = lw_vec3_mad(lw_vec3(p.x, LW_STREET_ROAD_Y, p.z), out[i], 0.01f);
    }
    lw_builtin_facade_use(mesh, paints->setts);
    lw_builtin_mesh_patch(mesh, points, 2, KERB_POINTS, LW_BUILTIN_CLOSED_COLUMNS);

    static const struct lw_vec2 kerb[] = {{0.01f, LW_STREET_ROAD_Y - 0.05f},
                                          {0.01f, -0.02f},
                                          {-0.02f, 0.01f},
                                          {-0.22f, 0.01f},
                                          {-0.23f, -0.02f}};
    lw_builtin_facade_use_along(mesh, paints->kerb);
    lw_builtin_mesh_sweep(mesh, kerb, COUNT(kerb), frames, KERB_POINTS, LW_BUILTIN_CLOSED_COLUMNS);
    for (uint32_t i = 0; i < KERB_POINTS; i++) { /* the pavement goes on under the parts at the front */
        const float inside = LW_STREET_FRONT - 0.5f;
        const struct lw_vec3 p = lw_vec3_mad(line[i], out[i], -0.22f);
        points[i] = lw_vec3(p.x, 0, p.z);
        points[KERB_POINTS + i] =
            lw_vec3(fminf(fmaxf(line[i].x, -inside), inside), 0, fminf(fmaxf(line[i].z, -inside), inside));
    }
    lw_builtin_facade_use(mesh, paints->paving);
    lw_builtin_mesh_patch(mesh, points, 2, KERB_POINTS, LW_BUILTIN_CLOSED_COLUMNS);
    lw_builtin_facade_use(mesh, paints->stripe);
    for (int side = 0; side < 4; side++) {
        stand(mesh, &there, 0, 0, 0, quarter * (float)side);
        crossing(mesh);
    }
    mesh->placement = there;
}

/* ---- furniture ---- */

void lw_builtin_street_lamp(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints) {
    static const struct lw_vec2 post[] = {{0.20f, 0},     {0.20f, 0.12f}, {0.15f, 0.18f}, {0.13f, 0.75f},
                                          {0.16f, 0.82f}, {0.10f, 0.92f}, {0.065f, 1.0f}, {0.05f, 3.1f},
                                          {0.08f, 3.16f}, {0.05f, 3.22f}, {0.04f, 3.55f}, {0.13f, 3.68f},
                                          {0.15f, 3.74f}, {0, 3.75f}};
    static const struct lw_vec2 glass[] = {{0.12f, 3.75f}, {0.20f, 4.18f}};
    static const struct lw_vec2 cap[] = {{0, 4.17f},     {0.20f, 4.18f}, {0.26f, 4.19f},
                                         {0.26f, 4.22f}, {0.12f, 4.36f}, {0.10f, 4.44f},
                                         {0.04f, 4.48f}, {0.05f, 4.56f}, {0, 4.60f}};
    const struct lw_affine there = mesh->placement;
    lw_builtin_facade_use_along(mesh, paints->iron);
    lw_builtin_mesh_revolve(mesh, post, COUNT(post), 8);
    lw_builtin_mesh_revolve(mesh, cap, COUNT(cap), 6);
    box(mesh, -0.38f, 3.28f, -0.02f, 0.38f, 3.33f, 0.02f); /* the ladder's rest */
    for (int i = 0; i < 6; i++) {                          /* bars of the lantern, on the glass' edges */
        const struct lw_affine turned = there;
        stand(mesh, &turned, 0, 0, 0, 2.0f * LW_PI * (float)i / 6.0f);
        const struct lw_vec3 corner = lw_vec3(-0.012f, 3.74f, 0.128f);
        lw_builtin_mesh_quad(mesh, corner, lw_vec3(0.024f, 0, 0), lw_vec3(0, 0.45f, 0.08f), 0);
    }
    mesh->placement = there;
    lw_builtin_facade_use_along(mesh, paints->lamp);
    lw_builtin_mesh_revolve(mesh, glass, COUNT(glass), 6);
}

static void bench(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints) {
    lw_builtin_facade_use(mesh, paints->wood);
    for (int i = 0; i < 4; i++) {
        float z = -0.2f + 0.12f * (float)i;
        box(mesh, -0.9f, 0.43f, z, 0.9f, 0.46f, z + 0.10f);
    }
    for (int i = 0; i < 3; i++) {
        float y = 0.55f + 0.13f * (float)i, z = -0.22f - 0.03f * (float)i;
        box(mesh, -0.9f, y, z - 0.03f, 0.9f, y + 0.10f, z);
    }
    lw_builtin_facade_use(mesh, paints->iron);
    for (int i = -1; i <= 1; i += 2) {
        float x = 0.75f * (float)i;
        box(mesh, x - 0.03f, 0, -0.22f, x + 0.03f, 0.43f, -0.16f);
        box(mesh, x - 0.03f, 0, 0.18f, x + 0.03f, 0.43f, 0.24f);
        box(mesh, x - 0.03f, 0.38f, -0.30f, x + 0.03f, 0.95f, -0.25f);
        box(mesh, x - 0.03f, 0.39f, -0.25f, x + 0.03f, 0.43f, 0.24f);
    }
}

static void bollard(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints) {
    static const struct lw_vec2 profile[] = {{0.12f, 0},     {0.12f, 0.06f}, {0.09f, 0.10f},
                                             {0.08f, 0.70f}, {0.10f, 0.74f}, {0.07f, 0.80f},
                                             {0.09f, 0.88f}, {0.05f, 0.96f}, {0, 0.98f}};
    lw_builtin_facade_use_along(mesh, paints->iron);
    lw_builtin_mesh_revolve(mesh, profile, COUNT(profile), 10);
}

void lw_builtin_street_furniture(struct lw_builtin_mesh *mesh,
                                 const struct lw_builtin_street_paints *paints) {
    const struct lw_affine there = mesh->placement;
    for (int side = 0; side < 4; side++) {
        struct lw_affine turned;
        stand(mesh, &there, 0, 0, 0, quarter * (float)side);
        turned = mesh->placement;
        for (int i = 0; i < 3;
             i++) { /* a third of the distance off the middle: those opposite stand between */
            stand(mesh, &turned, -19.0f + 16.0f * (float)i, 0, LW_STREET_LAMPS, 0);
            lw_builtin_street_lamp(mesh, paints);
        }
        for (int i = 0; i < 2; i++) {
            stand(mesh, &turned, -11.0f + 16.0f * (float)i, 0, LW_STREET_LAMPS, LW_PI);
            bench(mesh, paints);
        }
        for (int i = 0; i < 4; i++) {
            float a = quarter * ((float)i + 0.5f) / 4.0f, r = LW_STREET_KERB - LW_STREET_FRONT - 0.5f;
            stand(mesh, &turned, LW_STREET_FRONT + r * sinf(a), 0, LW_STREET_FRONT + r * cosf(a), 0);
            bollard(mesh, paints);
        }
    }
    mesh->placement = there;
}

/* ---- trees ---- */

/** A bough of leaves: a ball with bumps of leaves' clumps. */
static void crown(struct lw_builtin_mesh *mesh, float radius, uint32_t seed) {
    enum { ROWS = 13, COLUMNS = 21 };
    struct lw_vec3 points[ROWS * COLUMNS];
    for (uint32_t r = 0; r < ROWS; r++)
        for (uint32_t c = 0; c < COLUMNS; c++) {
            uint32_t column = r == 0 || r == ROWS - 1 ? 0 : c % (COLUMNS - 1);
            float pitch = LW_PI * ((float)r / (ROWS - 1) - 0.5f),
                  turn = 2.0f * LW_PI * (float)column / (COLUMNS - 1);
            float bump = 0.84f + 0.30f * lw_random_unit(lw_random_hash3(seed, r, column));
            if (r == 0 || r == ROWS - 1) bump = 0.95f;
            points[r * COLUMNS + c] =
                lw_vec3(radius * bump * cosf(pitch) * sinf(turn), 0.8f * radius * bump * sinf(pitch),
                        radius * bump * cosf(pitch) * cosf(turn));
        }
    for (uint32_t c = 0; c < COLUMNS; c++) /* the poles' points coincide */
        points[c].x = points[c].z = points[(ROWS - 1) * COLUMNS + c].x = points[(ROWS - 1) * COLUMNS + c].z =
            0;
    lw_builtin_mesh_patch(mesh, points, ROWS, COLUMNS, LW_BUILTIN_CLOSED_COLUMNS);
}

/** A tapering limb from a to b. */
static void limb(struct lw_builtin_mesh *mesh, struct lw_vec3 a, struct lw_vec3 b, float radius_a,
                 float radius_b) {
    enum { ROWS = 4, COLUMNS = 8 };
    struct lw_vec3 points[ROWS * COLUMNS], axis = lw_vec3_normalize(lw_vec3_sub(b, a)), u, v;
    lw_vec3_frame(axis, &u, &v);
    for (uint32_t r = 0; r < ROWS; r++)
        for (uint32_t c = 0; c < COLUMNS; c++) {
            float t = (float)r / (ROWS - 1),
                  angle = 2.0f * LW_PI * (float)(c % (COLUMNS - 1)) / (COLUMNS - 1);
            float radius = radius_a + (radius_b - radius_a) * sqrtf(t);
            struct lw_vec3 at = lw_vec3_add(lw_vec3_scale(a, 1 - t), lw_vec3_scale(b, t));
            points[r * COLUMNS + c] =
                lw_vec3_mad(lw_vec3_mad(at, u, radius * cosf(angle)), v, radius * sinf(angle));
        }
    lw_builtin_mesh_patch(mesh, points, ROWS, COLUMNS, LW_BUILTIN_CLOSED_COLUMNS);
}

void lw_builtin_street_tree(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints,
                            float height, uint32_t seed) {
    enum { BOUGHS = 7 };
    const struct lw_affine there = mesh->placement;
    const float crease_cos = mesh->crease_cos, fork_y = 0.36f * height, spread = 0.20f * height;
    const struct lw_vec3 fork = lw_vec3(0, fork_y, 0);
    mesh->crease_cos = -1.0f;
    lw_builtin_facade_use_along(mesh, paints->bark);
    limb(mesh, lw_vec3(0, -0.1f, 0), fork, 0.035f * height, 0.022f * height);
    for (uint32_t i = 0; i < BOUGHS; i++) {
        float turn = 2.399963f * (float)i, level = (float)i / (BOUGHS - 1);
        float out = spread * (1.0f - 0.75f * level * level) *
                    (0.8f + 0.4f * lw_random_unit(lw_random_hash2(seed, i)));
        struct lw_vec3 middle = lw_vec3(out * sinf(turn), height * (0.52f + 0.33f * level), out * cosf(turn));
        lw_builtin_facade_use_along(mesh, paints->bark);
        limb(mesh, fork, middle, 0.018f * height, 0.006f * height);
        lw_builtin_facade_use_along(mesh, paints->foliage);
        stand(mesh, &there, middle.x, middle.y, middle.z, (float)i);
        crown(mesh, height * (0.20f - 0.05f * level), lw_random_hash2(seed, 100 + i));
        mesh->placement = there;
    }
    mesh->crease_cos = crease_cos;
}

/* ---- grounds ---- */

/** A bed of low bushes in a stone rim. */
static void flower_bed(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints,
                       const struct lw_affine *there, float x, float z, float half_x, float half_z) {
    static const struct lw_vec2 rim[] = {{0.12f, 0}, {0.12f, 0.3f}, {-0.12f, 0.3f}, {-0.12f, 0.15f}};
    stand(mesh, there, x, 0, z, 0);
    lw_builtin_facade_use_along(mesh, paints->stone);
    lw_builtin_mesh_frame(mesh, rim, COUNT(rim), half_x, half_z, 0, false, 0);
    lw_builtin_facade_use(mesh, paints->soil);
    ground(mesh, -half_x, -half_z, half_x, half_z, 0.2f, 0);
    lw_builtin_facade_use_along(mesh, paints->foliage);
    const float crease_cos = mesh->crease_cos;
    mesh->crease_cos = -1.0f;
    const uint32_t bushes = (uint32_t)(half_x * 2.0f / 0.8f);
    for (uint32_t i = 0; i < bushes; i++) {
        float at = half_x * (2.0f * ((float)i + 0.5f) / (float)bushes - 1.0f);
        stand(mesh, there, x + at, 0.45f, z, (float)i);
        crown(mesh, fminf(0.45f, 0.85f * half_z), i);
    }
    mesh->crease_cos = crease_cos;
}

void lw_builtin_street_garden(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints) {
    const struct lw_affine there = mesh->placement;
    const float half = 13.2f, path = 1.2f, walk = 11.0f;
    lw_builtin_facade_use(mesh, paints->paving);
    ground(mesh, -half, walk, half, half, 0.01f, 4.0f);
    ground(mesh, -half, -half, half, -walk, 0.01f, 4.0f);
    ground(mesh, -half, -walk, -walk, walk, 0.01f, 4.0f);
    ground(mesh, walk, -walk, half, walk, 0.01f, 4.0f);
    lw_builtin_facade_use(mesh, paints->gravel);
    ground(mesh, -walk, -path, walk, path, 0.01f, 4.0f);
    ground(mesh, -path, path, path, walk, 0.01f, 4.0f);
    ground(mesh, -path, -walk, path, -path, 0.01f, 4.0f);
    lw_builtin_facade_use(mesh, paints->grass);
    for (int i = 0; i < 4; i++) {
        float x = i & 1 ? path : -walk, z = i & 2 ? path : -walk;
        ground(mesh, x, z, x + walk - path, z + walk - path, 0.03f, 4.0f);
    }
    for (int i = 0; i < 4; i++) {
        struct lw_affine turned;
        stand(mesh, &there, 0, 0, 0, quarter * (float)i);
        turned = mesh->placement;
        flower_bed(mesh, paints, &turned, 6.5f, 2.1f, 2.6f, 0.5f);
        stand(mesh, &turned, 9.0f, 0, 11.5f, 0);
        bench(mesh, paints);
        lw_builtin_facade_use(mesh, paints->wood); /* a shed against the houses' backs */
        if (i == 0) {
            stand(mesh, &turned, -9.0f, 0, -11.4f, 0);
            lw_builtin_mesh_box(mesh, lw_vec3(-1.6f, 0, -1.2f), lw_vec3(1.6f, 2.1f, 1.2f), LW_BUILTIN_SIDES);
            lw_builtin_facade_use_along(mesh, paints->roof);
            lw_builtin_mesh_quad(mesh, lw_vec3(-1.8f, 2.05f, 1.5f), lw_vec3(3.6f, 0, 0),
                                 lw_vec3(0, 0.8f, -3.0f), 0);
        }
    }
    static const struct lw_vec2 well[] = {{0.95f, 0},   {0.95f, 0.75f}, {1.05f, 0.8f}, {1.05f, 0.9f},
                                          {0.7f, 0.9f}, {0.7f, 0.3f},   {0, 0.3f}};
    stand(mesh, &there, 0, 0, 0, 0);
    lw_builtin_facade_use_along(mesh, paints->stone);
    lw_builtin_mesh_revolve(mesh, well, COUNT(well), 24);
    mesh->placement = there;
}

static void stall(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints,
                  uint32_t seed) {
    const float half = 1.5f, deep = 1.1f, front = 2.1f, rear = 2.6f;
    lw_builtin_facade_use(mesh, paints->wood);
    for (int i = 0; i < 4; i++) {
        float x = i & 1 ? half : -half, z = i & 2 ? deep : -deep, top = i & 2 ? front : rear;
        box(mesh, x - 0.04f, 0, z - 0.04f, x + 0.04f, top - 0.05f, z + 0.04f);
    }
    box(mesh, -half, 0.82f, 0.1f, half, 0.88f, deep + 0.15f);
    box(mesh, -half, 0.1f, deep, half, 0.82f, deep + 0.06f);
    for (uint32_t i = 0; i < 5; i++) { /* crates, with goods in them */
        float x = -1.3f + 0.55f * (float)i;
        lw_builtin_facade_use(mesh, paints->wood);
        box(mesh, x, 0.88f, 0.35f, x + 0.45f, 1.05f, 0.95f);
        lw_builtin_facade_use(mesh, i % 2 ? paints->foliage : paints->paintwork);
        const struct lw_affine there = mesh->placement;
        for (int k = 0; k < 6; k++) {
            stand(mesh, &there, x + 0.1f + 0.12f * (float)(k % 3), 1.07f, 0.5f + 0.25f * (float)(k / 3),
                  (float)k);
            lw_builtin_furnish_globe(
                mesh, 0.06f + 0.02f * lw_random_unit(lw_random_hash3(seed, i, (uint32_t)k)), 8);
        }
        mesh->placement = there;
    }
    lw_builtin_facade_use(mesh, paints->awning);
    lw_builtin_mesh_quad(mesh, lw_vec3(-half - 0.2f, front, deep + 0.4f), lw_vec3(2 * half + 0.4f, 0, 0),
                         lw_vec3(0, rear - front, -2 * deep - 0.8f), 0);
    lw_builtin_mesh_quad(mesh, lw_vec3(-half - 0.2f, rear - 0.02f, -deep - 0.4f),
                         lw_vec3(2 * half + 0.4f, 0, 0), lw_vec3(0, front - rear, 2 * deep + 0.8f), 0);
}

/** The fountain of the atrium, 2.4 times as large. */
static void fountain(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints,
                     const struct lw_affine *there) {
    const float s = 2.4f;
    static const struct lw_vec2 steps[] = {
        {5.6f, 0}, {5.6f, 0.15f}, {5.1f, 0.15f}, {5.1f, 0.3f}, {3.9f, 0.3f}};
    stand(mesh, there, 0, 0, 0, 0);
    lw_builtin_facade_use_along(mesh, paints->stone);
    lw_builtin_mesh_revolve(mesh, steps, COUNT(steps), 48);
    lw_builtin_mesh_place(mesh, lw_vec3(0, 0.3f, 0), 0, lw_vec3(s, s, s));
    mesh->placement = lw_affine_multiply(there, &mesh->placement);
    lw_builtin_furnish_basin(mesh);
    lw_builtin_facade_use_along(mesh, paints->water);
    lw_builtin_furnish_water(mesh);
    mesh->placement = *there;
}

static void monument(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints,
                     const struct lw_affine *there, float x, float z) {
    static const struct lw_vec2 figure[] = {{0.42f, 0},     {0.40f, 0.5f},  {0.30f, 1.0f},  {0.34f, 1.35f},
                                            {0.36f, 1.55f}, {0.16f, 1.72f}, {0.14f, 1.80f}, {0.20f, 1.95f},
                                            {0.18f, 2.10f}, {0, 2.2f}};
    stand(mesh, there, x, 0, z, 0);
    lw_builtin_facade_use(mesh, paints->stone);
    box(mesh, -2.2f, 0, -2.2f, 2.2f, 0.25f, 2.2f);
    box(mesh, -1.8f, 0.25f, -1.8f, 1.8f, 0.5f, 1.8f);
    box(mesh, -1.1f, 0.5f, -1.1f, 1.1f, 2.6f, 1.1f);
    box(mesh, -1.3f, 2.6f, -1.3f, 1.3f, 2.85f, 1.3f);
    lw_builtin_facade_use_along(mesh, paints->stone);
    stand(mesh, there, x, 2.85f, z, 0);
    lw_builtin_house_column(mesh, 9.0f, 0.75f);
    stand(mesh, there, x, 11.85f, z, 0);
    lw_builtin_facade_use_along(mesh, paints->iron);
    lw_builtin_mesh_revolve(mesh, figure, COUNT(figure), 16);
}

void lw_builtin_street_square(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints) {
    const struct lw_affine there = mesh->placement;
    const float half = LW_STREET_FRONT - 0.4f;
    lw_builtin_facade_use(mesh, paints->setts);
    ground(mesh, -half, -half, half, half, 0.01f, 4.0f);
    fountain(mesh, paints, &there);
    monument(mesh, paints, &there, 0, -16.0f);
    for (uint32_t i = 0; i < 8; i++) {
        bool left = i < 4;
        stand(mesh, &there, left ? -17.0f : 17.0f, 0, -8.0f + 6.0f * (float)(i % 4),
              left ? quarter : -quarter);
        stall(mesh, paints, i);
    }
    for (int i = 0; i < 8; i++) {
        float a = 0.25f * LW_PI * ((float)i + 0.5f);
        stand(mesh, &there, 9.0f * sinf(a), 0, 9.0f * cosf(a), a);
        bench(mesh, paints);
        stand(mesh, &there, 10.5f * sinf(a + 0.39f), 0, 10.5f * cosf(a + 0.39f), a);
        if (i & 1) lw_builtin_street_lamp(mesh, paints);
    }
    for (int i = 0; i < 4; i++)
        flower_bed(mesh, paints, &there, i & 1 ? 16.0f : -16.0f, i & 2 ? 20.5f : -20.5f, 3.0f, 0.6f);
    mesh->placement = there;
}

void lw_builtin_street_churchyard(struct lw_builtin_mesh *mesh,
                                  const struct lw_builtin_street_paints *paints) {
    const struct lw_affine there = mesh->placement;
    const float half = LW_STREET_FRONT - 0.4f;
    static const struct lw_vec2 wall[] = {{0, 0},         {0, 0.9f},      {0.1f, 0.95f}, {0.1f, 1.05f},
                                          {-0.4f, 1.05f}, {-0.4f, 0.95f}, {-0.3f, 0.9f}, {-0.3f, 0}};
    lw_builtin_facade_use(mesh, paints->grass);
    ground(mesh, -half, -half, half, half, 0.01f, 4.0f);
    lw_builtin_facade_use(mesh, paints->paving);
    ground(mesh, -3.0f, 16.0f, 3.0f, half, 0.03f, 4.0f);
    lw_builtin_facade_use_along(mesh, paints->wall);
    for (int i = 0; i < 4; i++) { /* open in the middle of every side */
        struct lw_affine turned;
        stand(mesh, &there, 0, 0, 0, quarter * (float)i);
        turned = mesh->placement;
        for (int k = 0; k < 2; k++) {
            const float from = k ? 3.2f : -half, to = k ? half : -3.2f;
            const struct lw_builtin_frame frames[] = {
                {lw_vec3(from, 0, half), lw_vec3(0, 0, 1), lw_vec3(0, 1, 0)},
                {lw_vec3(to, 0, half), lw_vec3(0, 0, 1), lw_vec3(0, 1, 0)}};
            lw_builtin_mesh_sweep(mesh, wall, COUNT(wall), frames, 2, 0);
            stand(mesh, &turned, k ? 3.2f : -3.2f, 0, half - 0.15f, 0);
            box(mesh, -0.35f, 0, -0.35f, 0.35f, 1.7f, 0.35f);
            mesh->placement = turned;
        }
    }
    lw_builtin_facade_use(mesh, paints->stone);
    for (uint32_t i = 0; i < 40; i++) { /* stones in rows beside the nave */
        float x = 12.0f + 3.0f * (float)(i % 4), z = -16.0f + 3.4f * (float)(i / 4 % 5);
        float jitter = lw_random_unit(lw_random_hash(i)) - 0.5f;
        stand(mesh, &there, i < 20 ? x : -x, 0, z, quarter + 0.2f * jitter);
        box(mesh, -0.35f, 0, -0.08f, 0.35f, 0.9f + 0.4f * jitter, 0.08f);
    }
    mesh->placement = there;
}

void lw_builtin_street_park(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints) {
    const struct lw_affine there = mesh->placement;
    const float half = LW_STREET_FRONT - 0.4f;
    static const struct lw_vec2 pond[] = {{9.4f, 0}, {9.4f, 0.25f}, {9.2f, 0.3f}, {8.8f, 0.3f}, {8.7f, 0.1f}};
    static const struct lw_vec2 water[] = {{8.75f, 0.14f}, {5.0f, 0.14f}, {0, 0.14f}};
    static const struct lw_vec2 path[] = {{12.0f, 0.03f}, {9.3f, 0.03f}};
    static const struct lw_vec2 roof[] = {{2.9f, 3.0f}, {3.1f, 3.05f}, {3.1f, 3.15f}, {1.6f, 4.0f},
                                          {0.4f, 5.0f}, {0.1f, 5.2f},  {0.2f, 5.5f},  {0, 5.7f}};
    static const struct lw_vec2 ceiling[] = {{0, 3.05f}, {2.95f, 3.02f}};
    static const struct lw_vec2 floor[] = {{3.2f, 0}, {3.2f, 0.2f}, {2.9f, 0.2f}, {2.9f, 0.4f}, {0, 0.4f}};
    lw_builtin_facade_use(mesh, paints->grass);
    ground(mesh, -half, -half, half, half, 0.01f, 4.0f);
    lw_builtin_facade_use_along(mesh, paints->stone);
    lw_builtin_mesh_revolve(mesh, pond, COUNT(pond), 64);
    lw_builtin_facade_use_along(mesh, paints->water);
    lw_builtin_mesh_revolve(mesh, water, COUNT(water), 64);
    lw_builtin_facade_use_along(mesh, paints->gravel);
    lw_builtin_mesh_revolve(mesh, path, COUNT(path), 64);
    for (int i = 0; i < 4; i++) {
        struct lw_affine turned;
        stand(mesh, &there, 0, 0, 0, quarter * (float)i);
        turned = mesh->placement;
        lw_builtin_facade_use(mesh, paints->gravel);
        ground(mesh, -1.3f, 11.8f, 1.3f, half, 0.04f, 4.0f);
        stand(mesh, &turned, 3.5f, 0, 12.6f, LW_PI);
        bench(mesh, paints);
        stand(mesh, &turned, 2.2f, 0, 17.0f, 0);
        lw_builtin_street_lamp(mesh, paints);
        mesh->placement = turned;
        flower_bed(mesh, paints, &turned, 8.0f, 21.0f, 4.0f, 0.6f);
        flower_bed(mesh, paints, &turned, -8.0f, 21.0f, 4.0f, 0.6f);
    }
    struct lw_affine pavilion;
    stand(mesh, &there, 16.5f, 0, -16.5f, 0.3f);
    pavilion = mesh->placement;
    lw_builtin_facade_use_along(mesh, paints->stone);
    lw_builtin_mesh_revolve(mesh, floor, COUNT(floor), 8);
    lw_builtin_facade_use_along(mesh, paints->roof);
    lw_builtin_mesh_revolve(mesh, roof, COUNT(roof), 8);
    lw_builtin_facade_use_along(mesh, paints->pale);
    lw_builtin_mesh_revolve(mesh, ceiling, COUNT(ceiling), 8);
    for (int i = 0; i < 8; i++) {
        float a = 0.25f * LW_PI * (float)i;
        stand(mesh, &pavilion, 2.55f * sinf(a), 0.4f, 2.55f * cosf(a), a);
        lw_builtin_house_column(mesh, 2.62f, 0.13f);
    }
    mesh->placement = there;
}

void lw_builtin_street_court(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints) {
    const struct lw_affine there = mesh->placement;
    const float half = LW_STREET_FRONT - 0.4f;
    lw_builtin_facade_use(mesh, paints->paving);
    ground(mesh, -half, -half, half, half, 0.01f, 4.0f);
    static const struct lw_vec2 well[] = {{1.9f, 0},     {1.9f, 0.2f},  {1.3f, 0.2f},   {1.15f, 0.5f},
                                          {1.15f, 1.0f}, {1.35f, 1.1f}, {1.35f, 1.25f}, {0.9f, 1.25f},
                                          {0.9f, 0.6f},  {0, 0.6f}};
    lw_builtin_facade_use_along(mesh, paints->stone);
    lw_builtin_mesh_revolve(mesh, well, COUNT(well), 32);
    for (int i = 0; i < 4; i++) {
        struct lw_affine turned;
        stand(mesh, &there, 0, 0, 0, quarter * (float)i);
        turned = mesh->placement;
        stand(mesh, &turned, 7.5f, 0, 7.5f, 0);
        lw_builtin_facade_use_along(mesh, paints->stone);
        lw_builtin_furnish_vase(mesh, LW_BUILTIN_POT, 1.0f);
        lw_builtin_facade_use_along(mesh, paints->soil);
        lw_builtin_furnish_soil(mesh, 1.0f);
        lw_builtin_facade_use_along(mesh, paints->foliage);
        stand(mesh, &turned, 7.5f, 1.6f, 7.5f, 0);
        const float crease_cos = mesh->crease_cos;
        mesh->crease_cos = -1.0f;
        crown(mesh, 0.9f, 7u + (uint32_t)i);
        mesh->crease_cos = crease_cos;
    }
    mesh->placement = there;
}

/* ---- vehicles ---- */

/** Wheels of an axle at z. */
static void axle(struct lw_builtin_mesh *mesh, const struct lw_affine *there, float half_track, float radius,
                 float width, float z) {
    const struct lw_vec2 tyre[] = {{0, -0.5f * width},
                                   {radius, -0.5f * width},
                                   {radius, 0.5f * width},
                                   {0.7f * radius, 0.5f * width},
                                   {0.6f * radius, 0.35f * width},
                                   {0, 0.4f * width}};
    for (int side = -1; side <= 1; side += 2) {
        /* the axis Y of the profile points outward */
        const float s = (float)side;
        const struct lw_affine lie = {{{0, s, 0, s * half_track}, {s, 0, 0, radius}, {0, 0, -1, z}}};
        mesh->placement = lw_affine_multiply(there, &lie);
        lw_builtin_mesh_revolve(mesh, tyre, COUNT(tyre), 20);
    }
    mesh->placement = *there;
}

/** A body with rounded edges: a plan's rectangle swept through its heights, then closed on top. */
static void body(struct lw_builtin_mesh *mesh, const struct lw_affine *there, const struct lw_vec2 *profile,
                 uint32_t count, float half_x, float half_z, float z) {
    stand(mesh, there, 0, 0, z, 0);
    lw_builtin_mesh_frame(mesh, profile, count, half_x, half_z, 0, false, 0.5f);
    float inset = profile[count - 1].x, y = profile[count - 1].y;
    ground(mesh, -half_x - inset, -half_z - inset, half_x + inset, half_z + inset, y, 0);
    mesh->placement = *there;
}

void lw_builtin_street_car(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints) {
    const struct lw_affine there = mesh->placement;
    static const struct lw_vec2 hull[] = {
        {-0.12f, 0.28f}, {0, 0.36f}, {0.02f, 0.62f}, {-0.03f, 0.82f}, {-0.10f, 0.88f}};
    static const struct lw_vec2 windows[] = {{0, 0.86f}, {-0.14f, 1.32f}};
    static const struct lw_vec2 roof[] = {{-0.12f, 1.31f}, {-0.15f, 1.38f}, {-0.24f, 1.42f}};
    static const struct lw_vec2 bumper[] = {{-0.05f, 0.36f}, {0.06f, 0.37f}, {0.06f, 0.48f}, {-0.05f, 0.49f}};
    lw_builtin_facade_use_along(mesh, paints->paintwork);
    body(mesh, &there, hull, COUNT(hull), 0.82f, 2.1f, 0);
    body(mesh, &there, roof, COUNT(roof), 0.74f, 1.15f, 0.25f);
    lw_builtin_facade_use_along(mesh, paints->glass);
    stand(mesh, &there, 0, 0, 0.25f, 0);
    lw_builtin_mesh_frame(mesh, windows, COUNT(windows), 0.74f, 1.15f, 0, false, 0);
    lw_builtin_facade_use_along(mesh, paints->iron);
    stand(mesh, &there, 0, 0, 0, 0);
    lw_builtin_mesh_frame(mesh, bumper, COUNT(bumper), 0.83f, 2.12f, 0, false, 0);
    ground(mesh, -0.7f, -2.0f, 0.7f, 2.0f, 0.28f, 0);
    axle(mesh, &there, 0.72f, 0.33f, 0.2f, -1.35f);
    axle(mesh, &there, 0.72f, 0.33f, 0.2f, 1.35f);
    for (int side = -1; side <= 1; side += 2) {
        float x = 0.55f * (float)side;
        lw_builtin_facade_use(mesh, paints->headlamp);
        box(mesh, x - 0.12f, 0.58f, -2.16f, x + 0.12f, 0.74f, -2.06f);
        lw_builtin_facade_use(mesh, paints->taillamp);
        box(mesh, x - 0.15f, 0.58f, 2.06f, x + 0.15f, 0.70f, 2.14f);
    }
}

void lw_builtin_street_tram(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints) {
    const struct lw_affine there = mesh->placement;
    const float half_x = 1.1f, half_z = 4.2f;
    static const struct lw_vec2 hull[] = {{-0.25f, 0.35f}, {-0.05f, 0.40f}, {0, 0.6f},      {0, 1.3f},
                                          {0.04f, 1.33f},  {0.04f, 1.42f},  {-0.05f, 1.42f}};
    static const struct lw_vec2 panes[] = {{-0.05f, 1.4f}, {-0.05f, 2.4f}};
    static const struct lw_vec2 roof[] = {
        {-0.05f, 2.35f}, {0.08f, 2.4f}, {0.08f, 2.5f}, {-0.25f, 2.75f}, {-0.7f, 2.88f}};
    lw_builtin_facade_use_along(mesh, paints->paintwork);
    stand(mesh, &there, 0, 0, 0, 0);
    lw_builtin_mesh_frame(mesh, hull, COUNT(hull), half_x, half_z, 0, false, 1.0f);
    lw_builtin_facade_use_along(mesh, paints->pale);
    body(mesh, &there, roof, COUNT(roof), half_x, half_z, 0);
    lw_builtin_facade_use_along(mesh, paints->cabin);
    lw_builtin_mesh_frame(mesh, panes, COUNT(panes), half_x, half_z, 0, false, 0);
    lw_builtin_facade_use(mesh, paints->paintwork);
    for (int i = 0; i <= 6; i++)
        for (int side = -1; side <= 1; side += 2) { /* posts between the panes */
            float z = -half_z + 0.05f + (2 * half_z - 0.1f) * (float)i / 6.0f,
                  x = (half_x - 0.04f) * (float)side;
            box(mesh, x - 0.05f, 1.4f, z - 0.08f, x + 0.05f, 2.4f, z + 0.08f);
        }
    lw_builtin_facade_use(mesh, paints->iron);
    box(mesh, -0.95f, 0.25f, -3.9f, 0.95f, 0.4f, 3.9f);
    box(mesh, -0.5f, 2.88f, -0.9f, 0.5f, 2.95f, 0.9f);
    axle(mesh, &there, 0.75f, 0.36f, 0.14f, -2.2f);
    axle(mesh, &there, 0.75f, 0.36f, 0.14f, 2.2f);
    lw_builtin_facade_use(mesh, paints->headlamp);
    box(mesh, -0.15f, 0.85f, -half_z - 0.06f, 0.15f, 1.1f, -half_z + 0.02f);
}

/* ---- the rim ---- */

#define WALL_Z     9.0f
#define WALL_TOP   7.0f
#define WALL_THICK 2.2f

/** Crenellated, along x from x0 to x1, its inner face at z = WALL_Z. */
static void town_wall(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints, float x0,
                      float x1) {
    lw_builtin_facade_use(mesh, paints->wall);
    const float far = WALL_Z + WALL_THICK, length = x1 - x0;
    lw_builtin_mesh_quad(mesh, lw_vec3(x1, -0.3f, WALL_Z), lw_vec3(-length, 0, 0),
                         lw_vec3(0, WALL_TOP + 0.3f, 0), 4.0f);
    lw_builtin_mesh_quad(mesh, lw_vec3(x0, -1.5f, far), lw_vec3(length, 0, 0), lw_vec3(0, WALL_TOP + 1.5f, 0),
                         4.0f);
    lw_builtin_facade_use(mesh, paints->stone);
    ground(mesh, x0, WALL_Z, x1, far, WALL_TOP, 4.0f);
    box(mesh, x0, WALL_TOP - 0.3f, far - 0.05f, x1, WALL_TOP + 0.9f, far + 0.25f);
    const uint32_t merlons = (uint32_t)(length / 1.6f);
    lw_builtin_facade_use(mesh, paints->wall);
    for (uint32_t i = 0; i < merlons; i++) {
        float at = x0 + length * ((float)i + 0.5f) / (float)merlons;
        lw_builtin_mesh_box(mesh, lw_vec3(at - 0.45f, WALL_TOP + 0.9f, far - 0.05f),
                            lw_vec3(at + 0.45f, WALL_TOP + 1.9f, far + 0.25f), LW_BUILTIN_ALL);
        if (i % 2) /* corbels under the parapet */
            box(mesh, at - 0.15f, WALL_TOP - 0.9f, far - 0.05f, at + 0.15f, WALL_TOP - 0.3f, far + 0.2f);
    }
}

static void wall_tower(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints,
                       const struct lw_affine *there, float x, float z) {
    static const struct lw_vec2 shaft[] = {{3.4f, -1.5f}, {3.4f, 0.8f},  {3.0f, 1.0f},  {3.0f, 10.2f},
                                           {3.3f, 10.7f}, {3.5f, 10.8f}, {3.5f, 11.8f}, {3.3f, 11.8f}};
    static const struct lw_vec2 roof[] = {{3.9f, 11.6f},  {3.9f, 11.75f}, {2.2f, 14.6f}, {0.15f, 18.4f},
                                          {0.08f, 19.6f}, {0.2f, 19.75f}, {0, 19.9f}};
    stand(mesh, there, x, 0, z, 0);
    lw_builtin_facade_use_along(mesh, paints->wall);
    lw_builtin_mesh_revolve(mesh, shaft, COUNT(shaft), 20);
    lw_builtin_facade_use_along(mesh, paints->roof);
    lw_builtin_mesh_revolve(mesh, roof, COUNT(roof), 20);
    mesh->placement = *there;
}

/** Carriageway and pavement of the rim: across z, from x0 to x1. */
static void rim_paving(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints, float x0,
                       float x1) {
    lw_builtin_facade_use(mesh, paints->setts);
    ground(mesh, x0, 0, x1, 4.0f, LW_STREET_ROAD_Y, 4.0f);
    lw_builtin_facade_use(mesh, paints->kerb);
    lw_builtin_mesh_box(mesh, lw_vec3(x0, LW_STREET_ROAD_Y - 0.05f, 3.99f), lw_vec3(x1, 0.01f, 4.22f),
                        LW_BUILTIN_BACK | LW_BUILTIN_TOP);
    lw_builtin_facade_use(mesh, paints->paving);
    ground(mesh, x0, 4.2f, x1, WALL_Z + 0.2f, 0, 4.0f);
}

void lw_builtin_street_rim(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints) {
    const struct lw_affine there = mesh->placement;
    const float half = 0.5f * LW_STREET_PITCH;
    rim_paving(mesh, paints, -half, half);
    town_wall(mesh, paints, -half, half);
    wall_tower(mesh, paints, &there, 0, WALL_Z + 1.6f);
    for (int i = 0; i < 4; i++) {
        stand(mesh, &there, -24.0f + 16.0f * (float)i, 0, 4.7f, 0);
        lw_builtin_street_lamp(mesh, paints);
    }
    mesh->placement = there;
}

void lw_builtin_street_rim_corner(struct lw_builtin_mesh *mesh,
                                  const struct lw_builtin_street_paints *paints) {
    const struct lw_affine there = mesh->placement;
    rim_paving(mesh, paints, 0, 4.0f);
    town_wall(mesh, paints, 0, LW_STREET_RIM - 1.0f);
    lw_builtin_facade_use(mesh, paints->paving);
    ground(mesh, 4.2f, 0, WALL_Z + 0.2f, WALL_Z + 0.2f, 0, 4.0f);
    lw_builtin_facade_use(mesh, paints->kerb);
    lw_builtin_mesh_box(mesh, lw_vec3(3.99f, LW_STREET_ROAD_Y - 0.05f, 0), lw_vec3(4.22f, 0.012f, 4.2f),
                        LW_BUILTIN_LEFT | LW_BUILTIN_TOP);
    stand(mesh, &there, 0, 0, 0,
          quarter); /* the wall that runs on along z: its +Z is our +X, its +X our -Z */
    town_wall(mesh, paints, 1.0f - LW_STREET_RIM, 0);
    mesh->placement = there;
    wall_tower(mesh, paints, &there, WALL_Z + 1.2f, WALL_Z + 1.2f);
}

void lw_builtin_street_country(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints,
                               float half, float width) {
    enum { RINGS = 9 };
    const uint32_t around = 4 * (2 + (uint32_t)(half / 24.0f));
    const uint32_t columns = around + 1;
    struct lw_vec3 *points = malloc(sizeof *points * RINGS * columns);
    if (!points) {
        mesh->failed = true;
        return;
    }
    for (uint32_t r = 0; r < RINGS; r++)
        for (uint32_t c = 0; c < columns; c++) {
            /* rows run inward, columns counter-clockwise seen from above */
            uint32_t per_side = around / 4, side = c % around / per_side;
            float t = 2.0f * (float)(c % around % per_side) / (float)per_side - 1.0f,
                  out = 1.0f - (float)r / (RINGS - 1);
            float turn = quarter * (float)side, reach = half + width * out;
            float x = reach * t, z = reach,
                  hill = out * out * (0.4f + 1.2f * lw_random_unit(lw_random_hash3(r, c % around, 9)));
            points[r * columns + c] = lw_vec3(cosf(turn) * x + sinf(turn) * z, -0.3f + 0.12f * width * hill,
                                              -sinf(turn) * x + cosf(turn) * z);
        }
    lw_builtin_facade_use(mesh, paints->grass);
    const float crease_cos = mesh->crease_cos;
    mesh->crease_cos = -1.0f;
    lw_builtin_mesh_patch(mesh, points, RINGS, columns, LW_BUILTIN_CLOSED_COLUMNS);
    mesh->crease_cos = crease_cos;
    free(points);
}
