#include "common/builtin/builtin_house.h"

#define ARCH_RADIUS  1.15f
#define ARCH_STEPS   32u
#define IMPOST_HALF  0.37f /* what an arcade needs under its springing: half a bay less the arch's radius */
#define MOULD_WIDTH  0.24f /* an archivolt's, from the arch's edge */
#define VAULT_RISE   1.40f
#define VAULT_STEPS  16u
#define RIB_HALF     0.18f
#define CEILING_Y    9.30f
#define DADO_Y       1.15f
#define PIECE_M      1.5f /* the long sides' */
#define COUNT(array) ((uint32_t)(sizeof(array) / sizeof *(array)))

static const struct lw_vec3 unscaled = {1, 1, 1};

static void stand_at(struct lw_builtin_mesh *mesh, float x, float y, float z, float angle) {
    lw_builtin_mesh_place(mesh, lw_vec3(x, y, z), angle, unscaled);
}

/* ---- columns ---- */

/** Appends a quarter or half round between two points of a profile that bulges by `bulge` times their
 * distance. */
static uint32_t round_to(struct lw_vec2 *profile, uint32_t count, struct lw_vec2 to, float bulge,
                         uint32_t steps) {
    struct lw_vec2 from = profile[count - 1];
    float dx = to.x - from.x, dy = to.y - from.y;
    for (uint32_t i = 1; i <= steps; i++) {
        float t = (float)i / (float)steps, swell = bulge * sinf(LW_PI * t);
        profile[count++] = (struct lw_vec2){from.x + dx * t + dy * swell, from.y + dy * t - dx * swell};
    }
    return count;
}

void lw_builtin_house_column(struct lw_builtin_mesh *mesh, float height, float radius) {
    struct lw_vec2 p[64];
    uint32_t n = 0;
    float r = radius, top = height - 1.15f * r; /* the shaft's */
    /* Attic base: torus, scotia, torus */
    p[n++] = (struct lw_vec2){1.30f * r, 0.26f * r};
    n = round_to(p, n, (struct lw_vec2){1.30f * r, 0.52f * r}, 0.45f, 6);
    p[n++] = (struct lw_vec2){1.20f * r, 0.54f * r};
    n = round_to(p, n, (struct lw_vec2){1.14f * r, 0.76f * r}, -0.30f, 5);
    n = round_to(p, n, (struct lw_vec2){1.14f * r, 0.94f * r}, 0.42f, 5);
    p[n++] = (struct lw_vec2){1.05f * r, 0.96f * r};
    /* shaft: straight for a third, then a curve to 5/6 of the radius, as Vignola draws it */
    for (uint32_t i = 0; i <= 10; i++) {
        float t = (float)i / 10.0f, above = fmaxf(0, (t - 0.33f) / 0.67f);
        float flare = t == 0 ? 0.04f : t == 1.0f ? 0.02f : 0;
        p[n++] =
            (struct lw_vec2){r * (1.0f - 0.165f * above * above + flare), 1.02f * r + (top - 1.02f * r) * t};
    }
    /* capital: astragal, necking, egg, abacus above */
    n = round_to(p, n, (struct lw_vec2){0.86f * r, top + 0.12f * r}, 0.5f, 4);
    p[n++] = (struct lw_vec2){0.84f * r, top + 0.16f * r};
    p[n++] = (struct lw_vec2){0.84f * r, top + 0.40f * r};
    p[n++] = (struct lw_vec2){0.92f * r, top + 0.43f * r};
    p[n++] = (struct lw_vec2){0.92f * r, top + 0.48f * r};
    n = round_to(p, n, (struct lw_vec2){1.22f * r, top + 0.80f * r}, 0.16f, 5);
    lw_builtin_mesh_revolve(mesh, p, n, 24);

    float plinth = 1.36f * r, abacus = fmaxf(1.26f * r, IMPOST_HALF - 0.08f * r);
    lw_builtin_mesh_box(mesh, lw_vec3(-plinth, 0, -plinth), lw_vec3(plinth, 0.27f * r, plinth),
                        LW_BUILTIN_SIDES | LW_BUILTIN_TOP);
    const struct lw_vec2 slab[] = {{-0.5f * r, 0},         {0, 0},
                                   {0, 0.16f * r},         {0.08f * r, 0.24f * r},
                                   {0.08f * r, 0.36f * r}, {-0.3f * r, 0.36f * r}};
    lw_builtin_mesh_frame(mesh, slab, COUNT(slab), abacus, abacus, top + 0.79f * r, false, 0);
}

void lw_builtin_house_columns(struct lw_builtin_mesh *mesh, float base_y, float height, float radius) {
    for (int i = 0; i < 2 * (LW_HOUSE_BAYS_X + LW_HOUSE_BAYS_Z); i++) {
        bool along_x = i < 2 * LW_HOUSE_BAYS_X;
        int k = along_x ? i / 2 : (i - 2 * LW_HOUSE_BAYS_X) / 2;
        float side = i % 2 ? 1.0f : -1.0f; /* each side keeps one of its corners */
        float x = along_x ? -side * (-LW_HOUSE_HALF_X + LW_HOUSE_BAY * (float)k) : side * LW_HOUSE_HALF_X;
        float z = along_x ? side * LW_HOUSE_HALF_Z : side * (-LW_HOUSE_HALF_Z + LW_HOUSE_BAY * (float)k);
        stand_at(mesh, x, base_y, z, 0);
        mesh->uv_offset = (struct lw_vec2){0.37f * (float)i, 0.71f * (float)i};
        lw_builtin_house_column(mesh, height, radius);
    }
    mesh->uv_offset = (struct lw_vec2){0, 0};
    mesh->placement = LW_AFFINE_IDENTITY;
}

/* ---- bays ---- */

/** One arch: local X along the arcade, +Z to the court, the origin on its axis. */
struct bay {
    bool upper, first, last; /* first: its left neighbour is round the corner */
    float spring, top;
};

/** Calls `add` for each bay of one storey, placed; seen from the court. */
static void each_bay(struct lw_builtin_mesh *mesh, bool upper,
                     void (*add)(struct lw_builtin_mesh *mesh, const struct bay *bay)) {
    struct bay bay = {.upper = upper,
                      .spring = upper ? LW_HOUSE_UPPER_SPRING : LW_HOUSE_LOWER_SPRING,
                      .top = upper ? LW_HOUSE_UPPER_TOP : LW_HOUSE_LOWER_TOP};
    for (int side = 0; side < 4; side++) {
        int bays = side % 2 ? LW_HOUSE_BAYS_Z : LW_HOUSE_BAYS_X;
        float angle = 0.5f * LW_PI * (float)side, out = side % 2 ? LW_HOUSE_HALF_X : LW_HOUSE_HALF_Z;
        struct lw_affine turn = {
            {{cosf(angle), 0, sinf(angle), 0}, {0, 1, 0, 0}, {-sinf(angle), 0, cosf(angle), 0}}};
        for (int k = 0; k < bays; k++) {
            struct lw_vec3 at = lw_vec3(LW_HOUSE_BAY * ((float)k + 0.5f - 0.5f * (float)bays), 0, -out);
            at = lw_affine_point(&turn, at);
            stand_at(mesh, at.x, 0, at.z, angle);
            bay.first = k == 0;
            bay.last = k == bays - 1;
            add(mesh, &bay);
        }
    }
    mesh->placement = LW_AFFINE_IDENTITY;
}

static float arch_angle(uint32_t step) { return LW_PI * (1.0f - (float)step / (float)ARCH_STEPS); }

/** Flat wall between an arch and a rectangle (left, right, height above the springing); the steps nearest to
 * the rectangle's corners move there. */
static void spandrel(struct lw_builtin_mesh *mesh, float spring, float z, float inner, float left,
                     float right, float height, bool back) {
    struct lw_vec3 points[2 * (ARCH_STEPS + 1)];
    float corner_left = LW_PI - atan2f(height, left), corner_right = atan2f(height, right);
    float half_step = 0.5001f * LW_PI / (float)ARCH_STEPS;
    for (uint32_t i = 0; i <= ARCH_STEPS; i++) {
        float angle = arch_angle(i);
        if (fabsf(angle - corner_left) < half_step) angle = corner_left;
        if (fabsf(angle - corner_right) < half_step) angle = corner_right;
        float c = cosf(angle), s = sinf(angle);
        float reach = fminf((c < 0 ? left : right) / fmaxf(fabsf(c), 1e-6f), height / fmaxf(s, 1e-6f));
        float from = fminf(inner, reach);
        points[i] = lw_vec3(from * c, spring + from * s, z);
        points[ARCH_STEPS + 1 + i] = lw_vec3(reach * c, spring + reach * s, z);
    }
    lw_builtin_mesh_patch(mesh, points, 2, ARCH_STEPS + 1, back ? LW_BUILTIN_FLIPPED : 0);
}

/** Flat wall between an arch and the vault behind it. */
static void lunette_rim(struct lw_builtin_mesh *mesh, float spring, float z) {
    struct lw_vec3 points[2 * (ARCH_STEPS + 1)];
    for (uint32_t i = 0; i <= ARCH_STEPS; i++) {
        float c = cosf(arch_angle(i)), s = sinf(arch_angle(i));
        points[i] = lw_vec3(ARCH_RADIUS * c, spring + ARCH_RADIUS * s, z);
        /* a little past the vault, which then covers the seam */
        points[ARCH_STEPS + 1 + i] = lw_vec3(0.5f * LW_HOUSE_BAY * c, spring + (VAULT_RISE + 0.05f) * s, z);
    }
    lw_builtin_mesh_patch(mesh, points, 2, ARCH_STEPS + 1, LW_BUILTIN_FLIPPED);
}

static void add_arch(struct lw_builtin_mesh *mesh, const struct bay *bay) {
    float half = 0.5f * LW_HOUSE_BAY, depth = LW_HOUSE_THICKNESS, height = bay->top - bay->spring;
    /* the front starts under the archivolt */
    spandrel(mesh, bay->spring, depth, ARCH_RADIUS + MOULD_WIDTH - 0.03f, half - (bay->first ? depth : 0),
             half - (bay->last ? depth : 0), height, false);
    if (bay->upper) {
        spandrel(mesh, bay->spring, -depth, ARCH_RADIUS, half + (bay->first ? depth : 0),
                 half + (bay->last ? depth : 0), CEILING_Y + 0.05f - bay->spring, true);
    } else {
        lunette_rim(mesh, bay->spring, -depth);
        struct lw_vec3 left = lw_vec3(-depth, 0, 0), up = lw_vec3(0, VAULT_RISE + 0.05f, 0);
        if (bay->first) lw_builtin_mesh_quad(mesh, lw_vec3(-half, bay->spring, -depth), left, up, 0);
        if (bay->last) lw_builtin_mesh_quad(mesh, lw_vec3(half + depth, bay->spring, -depth), left, up, 0);
    }

    struct lw_vec3 soffit[2 * (ARCH_STEPS + 1)];
    for (uint32_t i = 0; i <= ARCH_STEPS; i++) {
        float x = ARCH_RADIUS * cosf(arch_angle(i)), y = bay->spring + ARCH_RADIUS * sinf(arch_angle(i));
        soffit[i] = lw_vec3(x, y, -depth);
        soffit[ARCH_STEPS + 1 + i] = lw_vec3(x, y, depth);
    }
    lw_builtin_mesh_patch(mesh, soffit, 2, ARCH_STEPS + 1, 0);
}

void lw_builtin_house_arcade(struct lw_builtin_mesh *mesh, bool upper) { each_bay(mesh, upper, add_arch); }

static void add_archivolt(struct lw_builtin_mesh *mesh, const struct bay *bay) {
    /* (away from the arch's axis, towards the court); two fasciae and a bead */
    static const struct lw_vec2 profile[] = {{0, -0.01f},     {0, 0.05f},           {0.09f, 0.05f},
                                             {0.095f, 0.07f}, {0.175f, 0.07f},      {0.185f, 0.10f},
                                             {0.22f, 0.11f},  {MOULD_WIDTH, 0.08f}, {MOULD_WIDTH, -0.01f}};
    struct lw_builtin_frame frames[ARCH_STEPS + 1];
    for (uint32_t i = 0; i <= ARCH_STEPS; i++) {
        struct lw_vec3 out = lw_vec3(cosf(arch_angle(i)), sinf(arch_angle(i)), 0);
        struct lw_vec3 origin = lw_vec3_mad(lw_vec3(0, bay->spring, LW_HOUSE_THICKNESS), out, ARCH_RADIUS);
        frames[i] = (struct lw_builtin_frame){.origin = origin, .out = out, .up = lw_vec3(0, 0, 1)};
    }
    lw_builtin_mesh_sweep(mesh, profile, COUNT(profile), frames, ARCH_STEPS + 1, 0);

    /* keystone: a wedge that stands out from the mouldings */
    float low = bay->spring + ARCH_RADIUS - 0.03f, high = bay->spring + ARCH_RADIUS + 0.28f,
          z = LW_HOUSE_THICKNESS;
    struct lw_vec3 wedge[] = {lw_vec3(-0.13f, high, z),         lw_vec3(-0.09f, low, z),
                              lw_vec3(-0.13f, high, z + 0.17f), lw_vec3(-0.09f, low, z + 0.13f),
                              lw_vec3(0.13f, high, z + 0.17f),  lw_vec3(0.09f, low, z + 0.13f),
                              lw_vec3(0.13f, high, z),          lw_vec3(0.09f, low, z)};
    lw_builtin_mesh_patch(mesh, wedge, 4, 2, 0);
    struct lw_vec3 under[] = {wedge[1], wedge[7], wedge[3], wedge[5]};
    lw_builtin_mesh_patch(mesh, under, 2, 2, 0);
    struct lw_vec3 over[] = {wedge[0], wedge[6], wedge[2], wedge[4]};
    lw_builtin_mesh_patch(mesh, over, 2, 2, LW_BUILTIN_FLIPPED);
}

void lw_builtin_house_archivolts(struct lw_builtin_mesh *mesh, bool upper) {
    each_bay(mesh, upper, add_archivolt);
}

void lw_builtin_house_cornices(struct lw_builtin_mesh *mesh) {
    struct lw_vec2 p[32];
    float half_x = LW_HOUSE_HALF_X - LW_HOUSE_THICKNESS, half_z = LW_HOUSE_HALF_Z - LW_HOUSE_THICKNESS;
    uint32_t n = 0;
    p[n++] = (struct lw_vec2){-0.02f, 0};
    p[n++] = (struct lw_vec2){0.04f, 0};
    p[n++] = (struct lw_vec2){0.04f, 0.10f};
    n = round_to(p, n, (struct lw_vec2){0.12f, 0.18f}, -0.2f, 4);
    p[n++] = (struct lw_vec2){0.14f, 0.18f};
    p[n++] = (struct lw_vec2){0.20f, 0.19f};
    p[n++] = (struct lw_vec2){0.20f, 0.30f};
    n = round_to(p, n, (struct lw_vec2){0.27f, 0.38f}, 0.2f, 4);
    p[n++] = (struct lw_vec2){0.27f, 0.40f};
    p[n++] = (struct lw_vec2){-0.12f, 0.40f};
    lw_builtin_mesh_frame(mesh, p, n, half_x, half_z, LW_HOUSE_LOWER_TOP, true, PIECE_M);

    n = 0;
    p[n++] = (struct lw_vec2){-0.02f, 0};
    p[n++] = (struct lw_vec2){0.05f, 0};
    p[n++] = (struct lw_vec2){0.05f, 0.10f};
    p[n++] = (struct lw_vec2){0.08f, 0.12f};
    n = round_to(p, n, (struct lw_vec2){0.20f, 0.22f}, -0.2f, 5);
    p[n++] = (struct lw_vec2){0.34f, 0.23f};
    p[n++] = (struct lw_vec2){0.34f, 0.33f};
    n = round_to(p, n, (struct lw_vec2){0.44f, 0.43f}, 0.2f, 5);
    p[n++] = (struct lw_vec2){0.44f, 0.46f};
    lw_builtin_mesh_frame(mesh, p, n, half_x, half_z, LW_HOUSE_UPPER_TOP, true, PIECE_M);
}

/* ---- ceilings ---- */

/** A quarter of a groin vault: the barrel along local Z whose springing lines are at x = -half_x and half_x,
 * cut by the diagonals to z >= |x| half_z / half_x. */
static void vault_quarter(struct lw_builtin_mesh *mesh, float half_x, float half_z) {
    enum { ROWS = 5, COLUMNS = VAULT_STEPS + 1 };
    struct lw_vec3 points[ROWS * COLUMNS];
    for (uint32_t c = 0; c < COLUMNS; c++) {
        float angle = LW_PI * (1.0f - (float)c / (float)VAULT_STEPS);
        float x = cosf(angle), y = VAULT_RISE * sinf(angle), start = fabsf(x);
        if (c == 0 || c == VAULT_STEPS) y = 0;
        for (uint32_t r = 0; r < ROWS; r++) {
            float z = start + (1.0f - start) * (float)r / (float)(ROWS - 1);
            points[r * COLUMNS + c] = lw_vec3(half_x * x, y, half_z * z);
        }
    }
    lw_builtin_mesh_patch(mesh, points, ROWS, COLUMNS, 0);
}

static void vault(struct lw_builtin_mesh *mesh, float x, float z, float half_x, float half_z) {
    for (int quarter = 0; quarter < 4; quarter++) {
        stand_at(mesh, x, LW_HOUSE_LOWER_SPRING, z, 0.5f * LW_PI * (float)quarter);
        if (quarter % 2)
            vault_quarter(mesh, half_z, half_x);
        else
            vault_quarter(mesh, half_x, half_z);
    }
}

void lw_builtin_house_vaults(struct lw_builtin_mesh *mesh) {
    float depth = 0.5f * (LW_HOUSE_GALLERY - LW_HOUSE_THICKNESS), half = 0.5f * LW_HOUSE_BAY;
    float x = LW_HOUSE_HALF_X + LW_HOUSE_GALLERY - depth, z = LW_HOUSE_HALF_Z + LW_HOUSE_GALLERY - depth;
    for (int side = -1; side <= 1; side += 2) {
        for (int k = 0; k < LW_HOUSE_BAYS_X; k++)
            vault(mesh, LW_HOUSE_BAY * ((float)k + 0.5f) - LW_HOUSE_HALF_X, (float)side * z, half, depth);
        for (int k = 0; k < LW_HOUSE_BAYS_Z; k++)
            vault(mesh, (float)side * x, LW_HOUSE_BAY * ((float)k + 0.5f) - LW_HOUSE_HALF_Z, depth, half);
        vault(mesh, (float)side * x, z, depth, depth);
        vault(mesh, (float)side * x, -z, depth, depth);
    }
    mesh->placement = LW_AFFINE_IDENTITY;
}

/** A band across the gallery, from the arcade (local z = 0) to the wall (local z = -span), under the joint of
 * two vaults; its middle is at local x = shift. */
static void rib(struct lw_builtin_mesh *mesh, float shift, float half_width) {
    float span = LW_HOUSE_GALLERY - LW_HOUSE_THICKNESS, drop = 0.06f;
    const struct lw_vec2 profile[] = {
        {0.12f, half_width}, {0, half_width}, {0, -half_width}, {0.12f, -half_width}};
    struct lw_builtin_frame frames[VAULT_STEPS + 1];
    for (uint32_t i = 0; i <= VAULT_STEPS; i++) {
        float angle = LW_PI * (float)i / (float)VAULT_STEPS;
        float c = cosf(angle), s = sinf(angle), rz = 0.5f * span - drop, ry = VAULT_RISE - drop;
        struct lw_vec3 origin = lw_vec3(shift, LW_HOUSE_LOWER_SPRING + ry * s, rz * c - 0.5f * span);
        if (i == 0 || i == VAULT_STEPS) origin.y = LW_HOUSE_LOWER_SPRING;
        frames[i] =
            (struct lw_builtin_frame){.origin = origin, .out = lw_vec3(0, s, c), .up = lw_vec3(1, 0, 0)};
    }
    lw_builtin_mesh_sweep(mesh, profile, COUNT(profile), frames, VAULT_STEPS + 1, LW_BUILTIN_FLIPPED);
}

void lw_builtin_house_ribs(struct lw_builtin_mesh *mesh) {
    for (int side = 0; side < 4; side++) {
        int bays = side % 2 ? LW_HOUSE_BAYS_Z : LW_HOUSE_BAYS_X;
        float angle = 0.5f * LW_PI * (float)side;
        float out = (side % 2 ? LW_HOUSE_HALF_X : LW_HOUSE_HALF_Z) + LW_HOUSE_THICKNESS;
        for (int k = 0; k <= bays; k++) {
            /* at a corner the rib also covers what the arcade's thickness adds to the gallery's length */
            float corner = k == 0 ? -1.0f : k == bays ? 1.0f : 0.0f;
            float shift = LW_HOUSE_BAY * ((float)k - 0.5f * (float)bays) + corner * 0.5f * LW_HOUSE_THICKNESS;
            stand_at(mesh, -out * sinf(angle), 0, -out * cosf(angle), angle);
            rib(mesh, shift, RIB_HALF + fabsf(corner) * 0.5f * LW_HOUSE_THICKNESS);
        }
    }
    mesh->placement = LW_AFFINE_IDENTITY;
}

/** A ring of floor or ceiling between the arcade and the wall; `from` is measured from the columns' axes. */
static void gallery_ring(struct lw_builtin_mesh *mesh, float y, float from, float to, bool ceiling) {
    const struct lw_vec2 up[] = {{to, 0}, {from, 0}}, down[] = {{from, 0}, {to, 0}};
    lw_builtin_mesh_frame(mesh, ceiling ? down : up, 2, LW_HOUSE_HALF_X, LW_HOUSE_HALF_Z, y, false, PIECE_M);
}

void lw_builtin_house_timber(struct lw_builtin_mesh *mesh) {
    float from = LW_HOUSE_THICKNESS - 0.05f, to = LW_HOUSE_GALLERY + 0.05f;
    gallery_ring(mesh, CEILING_Y, from, to, true);
    for (int side = 0; side < 4; side++) {
        int beams = 1 + 2 * (side % 2 ? LW_HOUSE_BAYS_Z : LW_HOUSE_BAYS_X);
        float angle = 0.5f * LW_PI * (float)side, out = side % 2 ? LW_HOUSE_HALF_X : LW_HOUSE_HALF_Z;
        stand_at(mesh, -out * sinf(angle), 0, -out * cosf(angle), angle);
        for (int k = 0; k < beams; k++) {
            float x = 0.5f * LW_HOUSE_BAY * ((float)k - 0.5f * (float)(beams - 1));
            lw_builtin_mesh_box(mesh, lw_vec3(x - 0.09f, CEILING_Y - 0.20f, -to),
                                lw_vec3(x + 0.09f, CEILING_Y, -from),
                                LW_BUILTIN_LEFT | LW_BUILTIN_RIGHT | LW_BUILTIN_BOTTOM);
        }
    }
    mesh->placement = LW_AFFINE_IDENTITY;
}

/* ---- walls and floors ---- */

void lw_builtin_house_walls(struct lw_builtin_mesh *mesh) {
    float x = LW_HOUSE_HALF_X + LW_HOUSE_GALLERY, z = LW_HOUSE_HALF_Z + LW_HOUSE_GALLERY;
    const struct lw_vec2 lower[] = {{0, DADO_Y}, {0, LW_HOUSE_LOWER_TOP}};
    const struct lw_vec2 upper[] = {{0, LW_HOUSE_UPPER_FLOOR + DADO_Y}, {0, CEILING_Y + 0.05f}};
    lw_builtin_mesh_frame(mesh, lower, 2, x, z, 0, true, PIECE_M);
    lw_builtin_mesh_frame(mesh, upper, 2, x, z, 0, true, PIECE_M);
}

void lw_builtin_house_dado(struct lw_builtin_mesh *mesh, float floor_y) {
    const struct lw_vec2 profile[] = {
        {0, -0.05f},     {0, DADO_Y - 0.08f}, {0.03f, DADO_Y - 0.07f}, {0.04f, DADO_Y - 0.03f},
        {0.02f, DADO_Y}, {-0.02f, DADO_Y}};
    lw_builtin_mesh_frame(mesh, profile, COUNT(profile), LW_HOUSE_HALF_X + LW_HOUSE_GALLERY,
                          LW_HOUSE_HALF_Z + LW_HOUSE_GALLERY, floor_y, true, PIECE_M);
}

void lw_builtin_house_pilasters(struct lw_builtin_mesh *mesh) {
    static const struct lw_vec2 cap[] = {{0.0f, -0.02f}, {0.03f, 0},     {0.03f, 0.05f},
                                         {0.08f, 0.14f}, {0.08f, 0.22f}, {-0.1f, 0.22f}};
    for (int side = 0; side < 4; side++) {
        int bays = side % 2 ? LW_HOUSE_BAYS_Z : LW_HOUSE_BAYS_X;
        float angle = 0.5f * LW_PI * (float)side;
        float out = (side % 2 ? LW_HOUSE_HALF_X : LW_HOUSE_HALF_Z) + LW_HOUSE_GALLERY;
        for (int k = 0; k <= bays; k++) {
            float corner = k == 0 ? -1.0f : k == bays ? 1.0f : 0.0f;
            float x = LW_HOUSE_BAY * ((float)k - 0.5f * (float)bays) + corner * 0.5f * LW_HOUSE_THICKNESS;
            float half = 0.21f + fabsf(corner) * 0.5f * LW_HOUSE_THICKNESS, depth = 0.13f,
                  y = LW_HOUSE_LOWER_SPRING - 0.22f;
            stand_at(mesh, -out * sinf(angle), 0, -out * cosf(angle), angle);
            lw_builtin_mesh_box(mesh, lw_vec3(x - half, 0, -0.02f), lw_vec3(x + half, y, depth),
                                LW_BUILTIN_LEFT | LW_BUILTIN_RIGHT | LW_BUILTIN_FRONT);
            struct lw_builtin_frame frames[4] = {
                {lw_vec3(x - half, y, -0.02f), lw_vec3(-1, 0, 0), lw_vec3(0, 1, 0)},
                {lw_vec3(x - half, y, depth), lw_vec3(-1, 0, 1), lw_vec3(0, 1, 0)},
                {lw_vec3(x + half, y, depth), lw_vec3(1, 0, 1), lw_vec3(0, 1, 0)},
                {lw_vec3(x + half, y, -0.02f), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0)},
            };
            lw_builtin_mesh_sweep(mesh, cap, COUNT(cap), frames, 4, 0);
        }
    }
    mesh->placement = LW_AFFINE_IDENTITY;
}

#define COURT_X (LW_HOUSE_HALF_X - 0.65f) /* where the step is */
#define COURT_Z (LW_HOUSE_HALF_Z - 0.65f)

void lw_builtin_house_court_floor(struct lw_builtin_mesh *mesh, float border) {
    float x = COURT_X - border, z = COURT_Z - border;
    lw_builtin_mesh_quad(mesh, lw_vec3(-x, LW_HOUSE_COURT_Y, z), lw_vec3(2 * x, 0, 0), lw_vec3(0, 0, -2 * z),
                         1.0f);
}

void lw_builtin_house_court_border(struct lw_builtin_mesh *mesh, float border) {
    /* mitred strips, each with its texture running along it */
    for (int side = 0; side < 4; side++) {
        float half = side % 2 ? COURT_Z : COURT_X, out = side % 2 ? COURT_X : COURT_Z;
        stand_at(mesh, 0, LW_HOUSE_COURT_Y, 0, 0.5f * LW_PI * (float)side);
        struct lw_vec3 points[4] = {lw_vec3(-half, 0, out), lw_vec3(half, 0, out),
                                    lw_vec3(border - half, 0, out - border),
                                    lw_vec3(half - border, 0, out - border)};
        lw_builtin_mesh_patch(mesh, points, 2, 2, 0);
    }
    mesh->placement = LW_AFFINE_IDENTITY;
}

void lw_builtin_house_lower_floor(struct lw_builtin_mesh *mesh) {
    gallery_ring(mesh, 0, -0.35f, LW_HOUSE_GALLERY + 0.05f, false);
}

void lw_builtin_house_step(struct lw_builtin_mesh *mesh) {
    const struct lw_vec2 profile[] = {{0.30f, 0},       {-0.02f, 0}, {-0.04f, -0.02f},
                                      {-0.02f, -0.05f}, {0, -0.06f}, {0, LW_HOUSE_COURT_Y - 0.02f}};
    lw_builtin_mesh_frame(mesh, profile, COUNT(profile), COURT_X, COURT_Z, 0, false, PIECE_M);
}

void lw_builtin_house_upper_floor(struct lw_builtin_mesh *mesh) {
    gallery_ring(mesh, LW_HOUSE_UPPER_FLOOR, -0.18f, LW_HOUSE_GALLERY + 0.05f, false);
}

void lw_builtin_house_roof(struct lw_builtin_mesh *mesh) {
    float inner_x = LW_HOUSE_HALF_X - 0.85f, inner_z = LW_HOUSE_HALF_Z - 0.85f;
    const struct lw_vec2 profile[] = {{4.45f, 1.20f}, {4.45f, 1.42f}, {0, 0.13f}, {0, 0}, {0.75f, 0.03f}};
    lw_builtin_mesh_frame(mesh, profile, COUNT(profile), inner_x, inner_z, LW_HOUSE_EAVE, false, PIECE_M);
}

/* ---- balustrade ---- */

static void baluster(struct lw_builtin_mesh *mesh, float height) {
    static const struct lw_vec2 shape[] = {{0.075f, 0},     {0.075f, 0.06f}, {0.045f, 0.10f}, {0.050f, 0.14f},
                                           {0.085f, 0.28f}, {0.090f, 0.36f}, {0.070f, 0.50f}, {0.042f, 0.68f},
                                           {0.036f, 0.80f}, {0.055f, 0.86f}, {0.042f, 0.91f}, {0.070f, 0.96f},
                                           {0.070f, 1.0f}};
    struct lw_vec2 profile[COUNT(shape)];
    for (uint32_t i = 0; i < COUNT(shape); i++)
        profile[i] = (struct lw_vec2){shape[i].x, shape[i].y * height};
    lw_builtin_mesh_revolve(mesh, profile, COUNT(shape), 12);
}

static void add_balustrade_bay(struct lw_builtin_mesh *mesh, const struct bay *bay) {
    (void)bay;
    const float floor_y = LW_HOUSE_UPPER_FLOOR, plinth = 0.14f, rail = LW_HOUSE_PEDESTAL - 0.16f;
    const float end = 0.5f * LW_HOUSE_BAY - 0.34f; /* inside the pedestals */
    static const struct lw_vec2 top[] = {{0.08f, 0},      {0.13f, 0.02f},  {0.15f, 0.06f},  {0.15f, 0.09f},
                                         {0.11f, 0.13f},  {0, 0.15f},      {-0.11f, 0.13f}, {-0.15f, 0.09f},
                                         {-0.15f, 0.06f}, {-0.13f, 0.02f}, {-0.08f, 0},     {0.08f, 0}};
    struct lw_affine there = mesh->placement;
    lw_builtin_mesh_box(mesh, lw_vec3(-end, floor_y, -0.14f), lw_vec3(end, floor_y + plinth, 0.14f),
                        LW_BUILTIN_TOP | LW_BUILTIN_FRONT | LW_BUILTIN_BACK);
    const struct lw_builtin_frame ends[2] = {
        {lw_vec3(-end, floor_y + rail, 0), lw_vec3(0, 0, 1), lw_vec3(0, 1, 0)},
        {lw_vec3(end, floor_y + rail, 0), lw_vec3(0, 0, 1), lw_vec3(0, 1, 0)},
    };
    lw_builtin_mesh_sweep(mesh, top, COUNT(top), ends, 2, 0);
    for (int i = 0; i < 7; i++) {
        struct lw_affine shift = LW_AFFINE_IDENTITY;
        shift.m[0][3] = 2.0f * end * (((float)i + 0.5f) / 7.0f - 0.5f);
        shift.m[1][3] = floor_y + plinth;
        mesh->placement = lw_affine_multiply(&there, &shift);
        baluster(mesh, rail - plinth);
    }
    mesh->placement = there;
}

static void pedestals(struct lw_builtin_mesh *mesh) {
    static const struct lw_vec2 profile[] = {{0.04f, 0},     {0.04f, 0.12f}, {0, 0.15f},     {0, 0.74f},
                                             {0.03f, 0.77f}, {0.05f, 0.80f}, {0.05f, 0.90f}, {-0.2f, 0.90f}};
    for (int i = -LW_HOUSE_BAYS_X / 2; i <= LW_HOUSE_BAYS_X / 2; i++)
        for (int j = -LW_HOUSE_BAYS_Z / 2; j <= LW_HOUSE_BAYS_Z / 2; j++) {
            if (i != -LW_HOUSE_BAYS_X / 2 && i != LW_HOUSE_BAYS_X / 2 && j != -LW_HOUSE_BAYS_Z / 2 &&
                j != LW_HOUSE_BAYS_Z / 2)
                continue;
            stand_at(mesh, LW_HOUSE_BAY * (float)i, 0, LW_HOUSE_BAY * (float)j, 0);
            lw_builtin_mesh_frame(mesh, profile, COUNT(profile), 0.31f, 0.31f, LW_HOUSE_UPPER_FLOOR, false,
                                  0);
        }
    mesh->placement = LW_AFFINE_IDENTITY;
}

void lw_builtin_house_balustrade(struct lw_builtin_mesh *mesh) {
    pedestals(mesh);
    each_bay(mesh, true, add_balustrade_bay);
}
