#include "common/builtin/builtin_facade.h"

#include "common/base/random.h"

#include <assert.h>

#define COUNT(array) ((uint32_t)(sizeof(array) / sizeof *(array)))

#define BAYS_MAX      16u
#define STOREYS_MAX   24u
#define FOUNDATION_M  0.3f  /* walls go on below the pavement */
#define REVEAL_M      0.24f /* from the wall to the glass */
#define NO_BACK       (LW_BUILTIN_ALL & ~(unsigned)LW_BUILTIN_BACK)
#define UPRIGHT_FACES (LW_BUILTIN_FRONT | LW_BUILTIN_LEFT | LW_BUILTIN_RIGHT)
#define LEVEL_FACES   (LW_BUILTIN_FRONT | LW_BUILTIN_TOP | LW_BUILTIN_BOTTOM)

void lw_builtin_facade_use(struct lw_builtin_mesh *mesh, struct lw_builtin_paint paint) {
    lw_builtin_mesh_use(mesh, paint.material, LW_BUILTIN_UV_SPACE, paint.metres);
}
void lw_builtin_facade_use_along(struct lw_builtin_mesh *mesh, struct lw_builtin_paint paint) {
    lw_builtin_mesh_use(mesh, paint.material, LW_BUILTIN_UV_SURFACE, paint.metres);
}

static void box(struct lw_builtin_mesh *mesh, float x0, float y0, float z0, float x1, float y1, float z1,
                unsigned faces) {
    lw_builtin_mesh_box(mesh, lw_vec3(x0, y0, z0), lw_vec3(x1, y1, z1), faces);
}

/** A rectangle that faces +Z. */
static void sheet(struct lw_builtin_mesh *mesh, float x0, float y0, float x1, float y1, float z) {
    lw_builtin_mesh_quad(mesh, lw_vec3(x0, y0, z), lw_vec3(x1 - x0, 0, 0), lw_vec3(0, y1 - y0, 0), 0);
}

/** A wall at z = 0 with a grid of lines; cells of odd column and odd row are openings. */
static void pierced(struct lw_builtin_mesh *mesh, const float *x, uint32_t columns, const float *y,
                    uint32_t rows) {
    struct lw_vec3 points[(2 * BAYS_MAX + 2) * (2 * STOREYS_MAX + 2)];
    assert(columns * rows <= COUNT(points));
    for (uint32_t r = 0; r < rows; r++)
        for (uint32_t c = 0; c < columns; c++) points[r * columns + c] = lw_vec3(x[c], y[r], 0);
    lw_builtin_mesh_patch(mesh, points, rows, columns, LW_BUILTIN_HOLES);
}

/** A profile of (inset, z) around a rectangle, mitred at its corners: from the outside in where it faces
 * +Z. */
static void surround(struct lw_builtin_mesh *mesh, float x0, float y0, float x1, float y1,
                     const struct lw_vec2 *profile, uint32_t count) {
    struct lw_vec3 points[8 * 5];
    assert(count * 5 <= COUNT(points));
    for (uint32_t r = 0; r < count; r++) {
        float i = profile[r].x, z = profile[r].y;
        const float x[5] = {x0 + i, x1 - i, x1 - i, x0 + i, x0 + i},
                    y[5] = {y0 + i, y0 + i, y1 - i, y1 - i, y0 + i};
        for (uint32_t c = 0; c < 5; c++) points[r * 5 + c] = lw_vec3(x[c], y[c], z);
    }
    lw_builtin_mesh_patch(mesh, points, count, 5, LW_BUILTIN_CLOSED_COLUMNS);
}

/* ---- windows ---- */

/** Jambs, frame, bars and glass of a rectangular opening. */
static void glazing(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade_paints *paints, float x,
                    float y, float w, float h, uint32_t across, uint32_t up, bool lit) {
    static const struct lw_vec2 jamb[] = {{-0.11f, 0}, {-0.11f, 0.05f}, {0, 0.05f}, {0, -REVEAL_M}};
    static const struct lw_vec2 frame[] = {
        {0, -REVEAL_M + 0.06f}, {0.06f, -REVEAL_M + 0.06f}, {0.06f, -REVEAL_M}};
    lw_builtin_facade_use(mesh, paints->trim);
    surround(mesh, x, y, x + w, y + h, jamb, COUNT(jamb));
    lw_builtin_facade_use(mesh, paints->frame);
    surround(mesh, x, y, x + w, y + h, frame, COUNT(frame));
    const float z = -REVEAL_M + 0.045f, half = 0.025f;
    for (uint32_t i = 1; i < across; i++) {
        float at = x + w * (float)i / (float)across;
        box(mesh, at - half, y + 0.06f, -REVEAL_M, at + half, y + h - 0.06f, z, UPRIGHT_FACES);
    }
    for (uint32_t i = 1; i < up; i++) {
        float at = y + h * (float)i / (float)up;
        box(mesh, x + 0.06f, at - half, -REVEAL_M, x + w - 0.06f, at + half, z - 0.01f, LEVEL_FACES);
    }
    lw_builtin_facade_use(mesh, lit ? paints->glow : paints->glass);
    sheet(mesh, x, y, x + w, y + h, -REVEAL_M);
}

/** One leaf, folded back against the wall. */
static void shutter(struct lw_builtin_mesh *mesh, float x, float y, float w, float h) {
    const float slats = floorf(h / 0.16f), rail = 0.06f;
    box(mesh, x, y, 0.055f, x + rail, y + h, 0.10f, NO_BACK);
    box(mesh, x + w - rail, y, 0.055f, x + w, y + h, 0.10f, NO_BACK);
    box(mesh, x + rail, y, 0.055f, x + w - rail, y + rail, 0.095f, LEVEL_FACES);
    box(mesh, x + rail, y + h - rail, 0.055f, x + w - rail, y + h, 0.095f, LEVEL_FACES);
    for (int i = 0; i < (int)slats; i++) {
        float pitch = (h - 2 * rail) / slats, low = y + rail + pitch * (float)i;
        lw_builtin_mesh_quad(mesh, lw_vec3(x + rail, low, 0.09f), lw_vec3(w - 2 * rail, 0, 0),
                             lw_vec3(0, pitch, -0.03f), 0);
    }
}

static void pediment(struct lw_builtin_mesh *mesh, float x0, float x1, float y, float rise, float depth) {
    const float middle = 0.5f * (x0 + x1);
    const struct lw_vec3 front[] = {lw_vec3(x0, y, depth), lw_vec3(x1, y, depth),
                                    lw_vec3(middle, y + rise, depth), lw_vec3(middle, y + rise, depth)};
    lw_builtin_mesh_patch(mesh, front, 2, 2, 0);
    for (int side = -1; side <= 1; side += 2) {
        float from = side < 0 ? x0 : middle, to = side < 0 ? middle : x1;
        float from_y = side < 0 ? y : y + rise, to_y = side < 0 ? y + rise : y;
        lw_builtin_mesh_quad(mesh, lw_vec3(from, from_y, depth), lw_vec3(to - from, to_y - from_y, 0),
                             lw_vec3(0, 0, -depth), 0);
    }
}

void lw_builtin_facade_window(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade *facade, float x,
                              float y, float w, float h, bool lit) {
    const struct lw_builtin_facade_paints *paints = facade->paints;
    glazing(mesh, paints, x, y, w, h, 2, 3, lit);
    lw_builtin_facade_use(mesh, paints->trim);
    box(mesh, x - 0.16f, y - 0.20f, 0, x + w + 0.16f, y - 0.11f, 0.17f, NO_BACK);
    if (facade->features & (LW_FACADE_HOODS | LW_FACADE_PEDIMENTS)) {
        float top = y + h + 0.11f;
        box(mesh, x - 0.14f, top, 0, x + w + 0.14f, top + 0.10f, 0.10f, NO_BACK);
        box(mesh, x - 0.22f, top + 0.10f, 0, x + w + 0.22f, top + 0.18f, 0.20f, NO_BACK);
        if (facade->features & LW_FACADE_PEDIMENTS)
            pediment(mesh, x - 0.22f, x + w + 0.22f, top + 0.18f, 0.35f, 0.16f);
    }
    if (facade->features & LW_FACADE_SHUTTERS) {
        lw_builtin_facade_use(mesh, paints->shutter);
        shutter(mesh, x - 0.13f - 0.5f * w, y - 0.05f, 0.5f * w, h + 0.1f);
        shutter(mesh, x + w + 0.13f, y - 0.05f, 0.5f * w, h + 0.1f);
    }
}

/* ---- railings ---- */

void lw_builtin_facade_railing(struct lw_builtin_mesh *mesh, struct lw_builtin_paint paint, float x0,
                               float x1, float y, float z) {
    const uint32_t bars = (uint32_t)((x1 - x0) / 0.13f) + 1;
    lw_builtin_facade_use(mesh, paint);
    box(mesh, x0, y + 0.95f, z - 0.025f, x1, y + 1.0f, z + 0.025f, LW_BUILTIN_ALL);
    box(mesh, x0, y + 0.08f, z - 0.015f, x1, y + 0.11f, z + 0.015f, LW_BUILTIN_ALL);
    for (uint32_t i = 0; i <= bars; i++) {
        float at = x0 + 0.01f + (x1 - x0 - 0.02f) * (float)i / (float)bars;
        box(mesh, at - 0.009f, y, z - 0.009f, at + 0.009f, y + 0.95f, z + 0.009f, LW_BUILTIN_SIDES);
    }
}

void lw_builtin_facade_balustrade(struct lw_builtin_mesh *mesh, struct lw_builtin_paint paint, float x0,
                                  float x1, float y, float z, float pitch) {
    static const struct lw_vec2 baluster[] = {
        {0.05f, 0.14f}, {0.09f, 0.30f}, {0.085f, 0.38f}, {0.045f, 0.56f}, {0.065f, 0.72f}};
    const struct lw_affine there = mesh->placement;
    const uint32_t count = (uint32_t)((x1 - x0) / pitch);
    lw_builtin_facade_use(mesh, paint);
    box(mesh, x0, y, z - 0.13f, x1, y + 0.14f, z + 0.13f, LW_BUILTIN_ALL);
    box(mesh, x0, y + 0.72f, z - 0.14f, x1, y + 0.88f, z + 0.14f, LW_BUILTIN_ALL);
    for (uint32_t i = 0; i < count; i++) {
        float at = x0 + (x1 - x0) * ((float)i + 0.5f) / (float)count;
        const struct lw_affine move = {{{1, 0, 0, at}, {0, 1, 0, y}, {0, 0, 1, z}}};
        mesh->placement = lw_affine_multiply(&there, &move);
        lw_builtin_mesh_revolve(mesh, baluster, COUNT(baluster), 6);
        mesh->placement = there;
    }
}

static void balcony(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade_paints *paints, float x0,
                    float x1, float y) {
    const float depth = 0.95f;
    lw_builtin_facade_use(mesh, paints->trim);
    box(mesh, x0, y - 0.16f, 0, x1, y, depth, NO_BACK);
    for (int side = 0; side < 2; side++) {
        float at = side ? x1 - 0.35f : x0 + 0.15f;
        box(mesh, at, y - 0.36f, 0, at + 0.2f, y - 0.16f, 0.75f, NO_BACK & ~(unsigned)LW_BUILTIN_TOP);
        box(mesh, at, y - 0.56f, 0, at + 0.2f, y - 0.36f, 0.40f, NO_BACK & ~(unsigned)LW_BUILTIN_TOP);
    }
    lw_builtin_facade_railing(mesh, paints->iron, x0 + 0.03f, x1 - 0.03f, y, depth - 0.05f);
    const struct lw_affine there = mesh->placement;
    for (int side = 0; side < 2; side++) { /* along z, so turned by a quarter */
        const struct lw_affine turn = {
            {{0, 0, 1, side ? x1 - 0.05f : x0 + 0.05f}, {0, 1, 0, 0}, {-1, 0, 0, depth - 0.08f}}};
        mesh->placement = lw_affine_multiply(&there, &turn);
        lw_builtin_facade_railing(mesh, paints->iron, 0.02f, depth - 0.10f, y, 0);
        mesh->placement = there;
    }
}

/* ---- ground floor ---- */

static void door(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade_paints *paints, float x,
                 float w, float h) {
    const float leaf_top = h - 0.6f, z = -REVEAL_M;
    glazing(mesh, paints, x, leaf_top, w, h - leaf_top, 4, 1, true);
    lw_builtin_facade_use(mesh, paints->trim);
    box(mesh, x - 0.22f, 0, 0, x, leaf_top - 0.11f, 0.12f, NO_BACK);
    box(mesh, x + w, 0, 0, x + w + 0.22f, leaf_top - 0.11f, 0.12f, NO_BACK);
    box(mesh, x - 0.30f, h + 0.11f, 0, x + w + 0.30f, h + 0.27f, 0.28f, NO_BACK);
    box(mesh, x - 0.2f, 0, -REVEAL_M, x + w + 0.2f, 0.12f, 0.34f, NO_BACK);
    box(mesh, x, leaf_top - 0.11f, z, x + w, leaf_top, 0, LW_BUILTIN_BOTTOM); /* under the fanlight */
    lw_builtin_facade_use(mesh, paints->door);
    /* jambs of the leaf: the opening is cut in full, the surround above ends at the fanlight */
    lw_builtin_mesh_quad(mesh, lw_vec3(x, 0, 0), lw_vec3(0, 0, z), lw_vec3(0, leaf_top, 0), 0);
    lw_builtin_mesh_quad(mesh, lw_vec3(x + w, 0, z), lw_vec3(0, 0, -z), lw_vec3(0, leaf_top, 0), 0);
    sheet(mesh, x, 0, x + w, leaf_top, z);
    for (int column = 0; column < 2; column++)
        for (int row = 0; row < 3; row++) {
            float px = x + w * (0.08f + 0.46f * (float)column), pw = 0.38f * w;
            float py = 0.2f + (leaf_top - 0.3f) * (float)row / 3.0f, ph = (leaf_top - 0.3f) / 3.0f - 0.12f;
            box(mesh, px, py, z, px + pw, py + ph, z + 0.05f, NO_BACK);
        }
}

static void shop(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade *facade, float x, float w,
                 float h, uint32_t bay) {
    const struct lw_builtin_facade_paints *paints = facade->paints;
    bool lit = lw_random_unit(lw_random_hash3(facade->seed, bay, 77)) < 3.0f * facade->lit;
    glazing(mesh, paints, x, 0.55f, w, h - 0.55f, 3, 2, lit);
    lw_builtin_facade_use(mesh, paints->door);
    for (int i = 0; i < 3; i++) { /* panels of the riser */
        float px = x + w * (float)i / 3.0f;
        box(mesh, px + 0.06f, 0.1f, 0, px + w / 3.0f - 0.06f, 0.38f, 0.05f, NO_BACK);
    }
    box(mesh, x - 0.15f, h + 0.12f, 0, x + w + 0.15f, h + 0.55f, 0.14f, NO_BACK); /* the sign */
    if (lw_random_unit(lw_random_hash3(facade->seed, bay, 78)) < 0.6f) {
        lw_builtin_facade_use(mesh, paints->awning);
        const float out = 1.05f, top = h + 0.05f, low = h - 0.30f;
        lw_builtin_mesh_quad(mesh, lw_vec3(x - 0.1f, low, out), lw_vec3(w + 0.2f, 0, 0),
                             lw_vec3(0, top - low, 0.06f - out), 0);
        lw_builtin_mesh_quad(mesh, lw_vec3(x - 0.1f, top - 0.02f, 0.06f), lw_vec3(w + 0.2f, 0, 0),
                             lw_vec3(0, low - top, out - 0.06f), 0);
        for (int i = 0; i < 8; i++) { /* a valance of tongues */
            float px = x - 0.1f + (w + 0.2f) * (float)i / 8.0f, pw = (w + 0.2f) / 8.0f;
            box(mesh, px + 0.01f, low - 0.2f, out - 0.02f, px + pw - 0.01f, low, out, LW_BUILTIN_ALL);
        }
    }
}

static void ground_floor(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade *facade) {
    const struct lw_builtin_facade_paints *paints = facade->paints;
    const float bay = facade->width / (float)facade->bays, top = facade->ground_m;
    for (uint32_t i = 0; i < facade->bays; i++) {
        const bool is_door = (facade->features & LW_FACADE_DOOR) && i == facade->bays / 2;
        const bool is_shop = facade->ground == LW_FACADE_GROUND_SHOPS && !is_door;
        float w = is_door ? 1.3f : is_shop ? bay - 0.7f : facade->window_m[0];
        float low = is_door ? 0 : is_shop ? 0.55f : 1.0f, high = top - (is_shop ? 0.95f : 0.75f);
        float x0 = bay * (float)i, x = x0 + 0.5f * (bay - w);
        const float xs[] = {x0, x, x + w, x0 + bay}, ys[] = {-FOUNDATION_M, low, high, top};
        lw_builtin_facade_use(mesh, paints->base);
        pierced(mesh, xs, 4, ys, 4);
        if (is_door)
            door(mesh, paints, x, w, high);
        else if (is_shop)
            shop(mesh, facade, x, w, high, i);
        else
            glazing(mesh, paints, x, low, w, high - low, 2, 3,
                    lw_random_unit(lw_random_hash3(facade->seed, i, 76)) < facade->lit);
    }
    lw_builtin_facade_use(mesh, paints->trim);
    box(mesh, 0, top - 0.14f, 0, facade->width, top + 0.02f, 0.16f, NO_BACK);
    box(mesh, 0, top + 0.02f, 0, facade->width, top + 0.14f, 0.08f, NO_BACK);
}

/* ---- the whole ---- */

float lw_builtin_facade_height(const struct lw_builtin_facade *facade) {
    return facade->ground_m + facade->storey_m * (float)facade->storeys;
}

void lw_builtin_facade_blank(struct lw_builtin_mesh *mesh, struct lw_builtin_paint paint, float width,
                             float bottom, float top) {
    lw_builtin_facade_use(mesh, paint);
    lw_builtin_mesh_quad(mesh, lw_vec3(0, bottom, 0), lw_vec3(width, 0, 0), lw_vec3(0, top - bottom, 0),
                         4.0f);
}

void lw_builtin_facade_cornice(struct lw_builtin_mesh *mesh, struct lw_builtin_paint paint, float width,
                               float top) {
    lw_builtin_facade_use(mesh, paint);
    box(mesh, 0, top - 0.62f, 0, width, top - 0.50f, 0.10f, NO_BACK);
    box(mesh, 0, top - 0.30f, 0, width, top - 0.12f, 0.46f, NO_BACK);
    box(mesh, 0, top - 0.12f, 0, width, top, 0.55f, NO_BACK);
    const uint32_t dentils = (uint32_t)(width / 0.42f);
    for (uint32_t i = 0; i < dentils; i++) {
        float at = width * ((float)i + 0.5f) / (float)dentils;
        box(mesh, at - 0.1f, top - 0.50f, 0, at + 0.1f, top - 0.30f, 0.32f,
            UPRIGHT_FACES | LW_BUILTIN_BOTTOM);
    }
}

static void upper_floors(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade *facade) {
    float xs[2 * BAYS_MAX + 2], ys[2 * STOREYS_MAX + 2];
    const float bay = facade->width / (float)facade->bays, w = facade->window_m[0], h = facade->window_m[1];
    const float sill = 0.5f * (facade->storey_m - h) + 0.1f;
    uint32_t columns = 0, rows = 0;
    assert(facade->bays <= BAYS_MAX && facade->storeys <= STOREYS_MAX);
    xs[columns++] = 0;
    for (uint32_t i = 0; i < facade->bays; i++) {
        xs[columns++] = bay * ((float)i + 0.5f) - 0.5f * w;
        xs[columns++] = bay * ((float)i + 0.5f) + 0.5f * w;
    }
    xs[columns++] = facade->width;
    ys[rows++] = facade->ground_m;
    for (uint32_t s = 0; s < facade->storeys; s++) {
        ys[rows++] = facade->ground_m + facade->storey_m * (float)s + sill;
        ys[rows] = ys[rows - 1] + h;
        rows++;
    }
    ys[rows++] = lw_builtin_facade_height(facade);
    lw_builtin_facade_use(mesh, facade->paints->wall);
    pierced(mesh, xs, columns, ys, rows);
    for (uint32_t s = 0; s < facade->storeys; s++)
        for (uint32_t i = 0; i < facade->bays; i++) {
            bool lit = lw_random_unit(lw_random_hash3(facade->seed, i, s)) < facade->lit;
            lw_builtin_facade_window(mesh, facade, xs[2 * i + 1], ys[2 * s + 1], w, h, lit);
            if ((facade->features & LW_FACADE_BALCONIES) && s == 0 && i % 2 == 1)
                balcony(mesh, facade->paints, xs[2 * i + 1] - 0.45f, xs[2 * i + 2] + 0.45f,
                        ys[2 * s + 1] - 0.3f);
        }
}

void lw_builtin_facade_build(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade *facade) {
    const float top = lw_builtin_facade_height(facade);
    if (facade->ground != LW_FACADE_GROUND_NONE) ground_floor(mesh, facade);
    if (facade->storeys) upper_floors(mesh, facade);
    if (facade->features & LW_FACADE_PILASTERS) {
        lw_builtin_facade_use(mesh, facade->paints->trim);
        for (uint32_t i = 0; i <= facade->bays; i++) {
            float at = facade->width * (float)i / (float)facade->bays, half = 0.22f;
            float x0 = fmaxf(at - half, 0), x1 = fminf(at + half, facade->width);
            box(mesh, x0, facade->ground_m + 0.14f, 0, x1, top, 0.18f, UPRIGHT_FACES);
        }
    }
    if (facade->features & LW_FACADE_CORNICE)
        lw_builtin_facade_cornice(mesh, facade->paints->trim, facade->width, top);
}

/* ---- arches ---- */

enum { ARC_SIDE = 4, ARC_TOP = 6, ARC_POINTS = 2 * ARC_SIDE + ARC_TOP + 1, CONTOUR = ARC_POINTS + 2 };

/** The opening's contour from bottom left to bottom right, and where its points go on the rectangle around
 * it. The rectangle's corners are among these, so that the wall fills it. */
static void arch_contour(const struct lw_builtin_arch *a, struct lw_vec2 inner[CONTOUR],
                         struct lw_vec2 outer[CONTOUR]) {
    const float middle = 0.5f * (a->x0 + a->x1), r = 0.5f * a->width;
    const float half = a->x1 - middle, rise = a->y1 - a->spring, corner = atan2f(rise, half);
    inner[0] = (struct lw_vec2){middle - r, a->y0};
    outer[0] = (struct lw_vec2){a->x0, a->y0};
    for (int i = 0; i < ARC_POINTS; i++) {
        float angle = i <= ARC_SIDE ? LW_PI - corner * (float)i / ARC_SIDE
                      : i < ARC_SIDE + ARC_TOP
                          ? LW_PI - corner - (LW_PI - 2 * corner) * (float)(i - ARC_SIDE) / ARC_TOP
                          : corner * (float)(ARC_POINTS - 1 - i) / ARC_SIDE;
        float c = cosf(angle), s = fmaxf(sinf(angle), 0);
        float reach = fminf(half / fmaxf(fabsf(c), 1e-6f), rise / fmaxf(s, 1e-6f));
        inner[i + 1] = (struct lw_vec2){middle + r * c, a->spring + r * s};
        outer[i + 1] = (struct lw_vec2){middle + reach * c, a->spring + reach * s};
    }
    inner[CONTOUR - 1] = (struct lw_vec2){middle + r, a->y0};
    outer[CONTOUR - 1] = (struct lw_vec2){a->x1, a->y0};
}

void lw_builtin_facade_arch(struct lw_builtin_mesh *mesh, const struct lw_builtin_arch *arch) {
    struct lw_vec2 inner[CONTOUR], outer[CONTOUR];
    struct lw_vec3 front[2 * CONTOUR], back[2 * CONTOUR], soffit[2 * CONTOUR];
    arch_contour(arch, inner, outer);
    for (int i = 0; i < CONTOUR; i++) {
        front[i] = lw_vec3(inner[i].x, inner[i].y, 0);
        front[CONTOUR + i] = lw_vec3(outer[i].x, outer[i].y, 0);
        soffit[i] = lw_vec3(inner[i].x, inner[i].y, -arch->depth);
        soffit[CONTOUR + i] = front[i];
        back[i] = soffit[i];
        back[CONTOUR + i] = lw_vec3(outer[i].x, outer[i].y, -arch->depth);
    }
    lw_builtin_mesh_patch(mesh, front, 2, CONTOUR, 0);
    lw_builtin_mesh_patch(mesh, soffit, 2, CONTOUR, 0);
    if (arch->back) lw_builtin_mesh_patch(mesh, back, 2, CONTOUR, LW_BUILTIN_FLIPPED);
}

void lw_builtin_facade_arch_glass(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade_paints *paints,
                                  const struct lw_builtin_arch *arch, bool lit) {
    struct lw_vec2 inner[CONTOUR], outer[CONTOUR];
    struct lw_vec3 pane[2 * CONTOUR];
    const float middle = 0.5f * (arch->x0 + arch->x1), z = -arch->depth + 0.02f, r = 0.5f * arch->width;
    arch_contour(arch, inner, outer);
    for (int i = 0; i < CONTOUR; i++) {
        pane[i] = lw_vec3(middle, arch->y0, z);
        pane[CONTOUR + i] = lw_vec3(inner[i].x, inner[i].y, z);
    }
    lw_builtin_facade_use(mesh, lit ? paints->glow : paints->glass);
    lw_builtin_mesh_patch(mesh, pane, 2, CONTOUR, 0);
    lw_builtin_facade_use(mesh, paints->frame);
    box(mesh, middle - 0.04f, arch->y0, z, middle + 0.04f, arch->spring + r, z + 0.06f, UPRIGHT_FACES);
    for (float y = arch->y0 + 0.9f; y < arch->spring + 0.1f; y += 0.9f)
        box(mesh, middle - r, y - 0.03f, z, middle + r, y + 0.03f, z + 0.05f, LEVEL_FACES);
}
