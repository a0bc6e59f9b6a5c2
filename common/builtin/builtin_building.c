#include "common/builtin/builtin_building.h"

#include "common/builtin/builtin_house.h"

#define COUNT(array) ((uint32_t)(sizeof(array) / sizeof *(array)))

#define GROUND_M    3.9f /* houses: height of the ground floor, of a storey */
#define STOREY_M    3.1f
#define PARTY_GAP_M 0.03f /* walls of neighbours do not coincide */
#define PARTY_LOW_M 8.0f  /* what the lowest neighbour hides of a party wall */

/** Puts the next parts at a point of the building, turned about +Y. */
static void stand(struct lw_builtin_mesh *mesh, const struct lw_affine *there, float x, float y, float z,
                  float angle) {
    lw_builtin_mesh_place(mesh, lw_vec3(x, y, z), angle, lw_vec3(1, 1, 1));
    mesh->placement = lw_affine_multiply(there, &mesh->placement);
}

static const float quarter = 0.5f * LW_PI;

/* ---- roofs ---- */

/** A tiled slope that faces +Z and up: from x = -low_half..low_half at (y, z) = (0, 0) up to
 * -high_half..high_half at (rise, -run), hipped where it narrows. Rows of pantiles run up it. */
static void slope(struct lw_builtin_mesh *mesh, float low_half, float high_half, float rise, float run) {
    enum { WAVE_STEPS = 4, COLUMNS_MAX = 800 };
    struct lw_vec3 points[2 * COLUMNS_MAX];
    uint32_t waves = (uint32_t)(low_half / 0.22f), columns = waves * WAVE_STEPS + 1;
    if (columns > COLUMNS_MAX) columns = COLUMNS_MAX;
    const float length = sqrtf(rise * rise + run * run);
    const struct lw_vec3 normal = lw_vec3(0, run / length, rise / length);
    for (uint32_t c = 0; c < columns; c++) {
        float x = low_half * (2.0f * (float)c / (float)(columns - 1) - 1.0f);
        float lift = 0.04f * sinf(2.0f * LW_PI * (float)(c % WAVE_STEPS) / WAVE_STEPS);
        float up = low_half > high_half ? fminf((low_half - fabsf(x)) / (low_half - high_half), 1.0f) : 1.0f;
        points[c] = lw_vec3_mad(lw_vec3(x, 0, 0), normal, lift);
        points[columns + c] = lw_vec3_mad(lw_vec3(x, rise * up, -run * up), normal, lift);
    }
    const float crease_cos = mesh->crease_cos;
    mesh->crease_cos = -1.0f; /* the waves are round */
    lw_builtin_mesh_patch(mesh, points, 2, columns, 0);
    mesh->crease_cos = crease_cos;
}

/** A triangle of wall under a saddle roof: z = 0, faces +Z, base from x0 to x1 at y. */
static void gable(struct lw_builtin_mesh *mesh, float x0, float x1, float y, float rise) {
    const float middle = 0.5f * (x0 + x1);
    const struct lw_vec3 points[] = {lw_vec3(x0, y, 0), lw_vec3(x1, y, 0), lw_vec3(middle, y + rise, 0),
                                     lw_vec3(middle, y + rise, 0)};
    lw_builtin_mesh_patch(mesh, points, 2, 2, 0);
}

static void chimney(struct lw_builtin_mesh *mesh, const struct lw_affine *there,
                    const struct lw_builtin_facade_paints *paints, float x, float low, float high, float z) {
    static const struct lw_vec2 pot[] = {{0.13f, 0},     {0.16f, 0.1f}, {0.12f, 0.18f}, {0.11f, 0.5f},
                                         {0.15f, 0.55f}, {0.14f, 0.6f}, {0.09f, 0.6f},  {0.08f, 0.3f}};
    const unsigned open = LW_BUILTIN_SIDES | LW_BUILTIN_TOP;
    stand(mesh, there, x, 0, z, 0);
    lw_builtin_facade_use(mesh, paints->base);
    lw_builtin_mesh_box(mesh, lw_vec3(-0.6f, low, -0.35f), lw_vec3(0.6f, high, 0.35f), open);
    lw_builtin_facade_use(mesh, paints->trim);
    lw_builtin_mesh_box(mesh, lw_vec3(-0.68f, high, -0.43f), lw_vec3(0.68f, high + 0.15f, 0.43f),
                        LW_BUILTIN_ALL);
    lw_builtin_facade_use(mesh, paints->roof);
    for (int i = -1; i <= 1; i++) {
        stand(mesh, there, x + 0.4f * (float)i, high + 0.15f, z, 0);
        lw_builtin_mesh_revolve(mesh, pot, COUNT(pot), 10);
    }
}

/** A window in the roof. The foot of its front is at the placement's origin, which lies on the slope. It
 * reaches `deep` metres back. */
static void dormer(struct lw_builtin_mesh *mesh, const struct lw_affine *there,
                   const struct lw_builtin_facade *facade, float x, float y, float z, float deep, bool lit) {
    const struct lw_builtin_facade_paints *paints = facade->paints;
    struct lw_builtin_facade plain = *facade;
    const float half = 0.8f, top = 1.85f, rise = 0.55f, w = 0.9f, h = 1.2f;
    plain.features = 0;
    stand(mesh, there, x, y, z, 0);
    lw_builtin_facade_use(mesh, paints->wall);
    const struct lw_vec3 low = lw_vec3(-half, -0.6f, -deep), high = lw_vec3(half, top, 0);
    lw_builtin_mesh_box(mesh, low, high, LW_BUILTIN_LEFT | LW_BUILTIN_RIGHT);
    /* the wall around its window: a rectangle would cover the reveal */
    const float xs[] = {-half, -0.5f * w, 0.5f * w, half}, ys[] = {-0.6f, 0.45f, 0.45f + h, top};
    struct lw_vec3 wall[16];
    for (int i = 0; i < 16; i++) wall[i] = lw_vec3(xs[i % 4], ys[i / 4], 0);
    lw_builtin_mesh_patch(mesh, wall, 4, 4, LW_BUILTIN_HOLES);
    gable(mesh, -half, half, top, rise);
    lw_builtin_facade_window(mesh, &plain, -0.5f * w, 0.45f, w, h, lit);
    lw_builtin_facade_use_along(mesh, paints->roof);
    const float over = 0.15f, slant = over * rise / half;
    for (int side = -1; side <= 1; side += 2) {
        const struct lw_vec3 eave = lw_vec3((float)side * (half + over), top - slant, 0),
                             ridge = lw_vec3(0, top + rise, 0), front = lw_vec3(0, 0, over),
                             back = lw_vec3(0, 0, -deep - 0.6f), up = lw_vec3_sub(ridge, eave);
        const struct lw_vec3 from = lw_vec3_add(eave, side > 0 ? front : back),
                             to = lw_vec3_add(eave, side > 0 ? back : front);
        lw_builtin_mesh_quad(mesh, from, lw_vec3_sub(to, from), up, 0);
        const struct lw_vec3 rim = lw_vec3(0, -0.1f, 0); /* a board under the front edge */
        const struct lw_vec3 edge = lw_vec3_add(lw_vec3_add(side > 0 ? ridge : eave, front), rim);
        lw_builtin_mesh_quad(mesh, edge, side > 0 ? lw_vec3_scale(up, -1) : up, lw_vec3_scale(rim, -1), 0);
    }
}

/* ---- houses ---- */

static struct lw_builtin_facade street_front(const struct lw_builtin_house_style *style, float width,
                                             uint32_t bays) {
    return (struct lw_builtin_facade){.paints = style->paints,
                                      .width = width,
                                      .ground_m = GROUND_M,
                                      .storey_m = STOREY_M,
                                      .bays = bays,
                                      .storeys = style->storeys,
                                      .window_m = {1.05f, 1.75f},
                                      .ground = style->ground,
                                      .features = style->features | LW_FACADE_CORNICE,
                                      .seed = style->seed,
                                      .lit = 0.06f};
}

/** A facade towards the court: a front with windows, shutters and a door alone. */
static struct lw_builtin_facade court_front(struct lw_builtin_facade facade) {
    facade.ground = LW_FACADE_GROUND_WINDOWS;
    facade.features &= (unsigned)LW_FACADE_SHUTTERS;
    facade.features |= LW_FACADE_DOOR;
    facade.seed += 1000;
    return facade;
}

void lw_builtin_building_row_house(struct lw_builtin_mesh *mesh, const struct lw_builtin_house_style *style) {
    const struct lw_affine there = mesh->placement;
    const struct lw_builtin_facade_paints *paints = style->paints;
    const float w = LW_BUILDING_ROW_WIDTH, d = LW_BUILDING_ROW_DEPTH, half = 0.5f * w;
    const struct lw_builtin_facade front = street_front(style, w, style->bays), rear = court_front(front);
    const float top = lw_builtin_facade_height(&front), rise = 4.4f, eave = 0.62f, rear_eave = 0.4f;

    stand(mesh, &there, -half, 0, 0, 0);
    lw_builtin_facade_build(mesh, &front);
    stand(mesh, &there, half, 0, -d, LW_PI);
    lw_builtin_facade_build(mesh, &rear);
    for (int side = 0; side < 2; side++) {
        float x = (half - PARTY_GAP_M) * (side ? 1.0f : -1.0f);
        stand(mesh, &there, x, 0, side ? 0 : -d, side ? quarter : -quarter);
        lw_builtin_facade_blank(mesh, paints->wall, d, PARTY_LOW_M, top);
        gable(mesh, 0, d, top, rise);
    }
    lw_builtin_facade_use(mesh, paints->trim);
    stand(mesh, &there, 0, top, 0, 0);
    lw_builtin_mesh_box(mesh, lw_vec3(-half, 0, 0), lw_vec3(half, 0.06f, eave), LW_BUILTIN_ALL);
    lw_builtin_mesh_box(mesh, lw_vec3(-half, -0.1f, -d - rear_eave), lw_vec3(half, 0.06f, -d),
                        LW_BUILTIN_ALL);
    lw_builtin_facade_use_along(mesh, paints->roof);
    stand(mesh, &there, 0, top + 0.06f, eave, 0);
    slope(mesh, half, half, rise, 0.5f * d + eave);
    stand(mesh, &there, 0, top + 0.06f, -d - rear_eave, LW_PI);
    slope(mesh, half, half, rise, 0.5f * d + rear_eave);
    stand(mesh, &there, 0, top + 0.06f + rise, -0.5f * d, 0);
    lw_builtin_mesh_box(mesh, lw_vec3(-half, -0.1f, -0.14f), lw_vec3(half, 0.1f, 0.14f), LW_BUILTIN_ALL);

    const uint32_t dormers = style->bays - 1;
    for (uint32_t i = 0; i < dormers; i++) {
        float x = w * (((float)i + 0.5f) / (float)dormers - 0.5f), z = -0.9f;
        dormer(mesh, &there, &front, x, top + rise * (eave - z) / (0.5f * d + eave), z, 2.6f,
               i == style->seed % 5);
    }
    chimney(mesh, &there, paints, half - 1.2f, top + 2.0f, top + rise + 1.1f, -0.5f * d - 1.2f);
    mesh->placement = there;
}

/** An eight-sided bay on the corner, from the first storey to above the roof. */
static void turret(struct lw_builtin_mesh *mesh, const struct lw_affine *there,
                   const struct lw_builtin_facade *front) {
    const struct lw_builtin_facade_paints *paints = front->paints;
    const float apothem = 1.9f, side = 2.0f * apothem * tanf(0.125f * LW_PI),
                radius = apothem / cosf(0.125f * LW_PI), middle = -0.5f;
    struct lw_builtin_facade facet = *front;
    facet.width = side;
    facet.bays = 1;
    facet.ground = LW_FACADE_GROUND_NONE;
    facet.window_m[0] = 0.8f;
    facet.features &= (unsigned)LW_FACADE_HOODS;
    const float low = facet.ground_m, top = lw_builtin_facade_height(&facet) + 1.3f;
    for (int i = -1; i <= 3; i++) {
        float angle = 0.5f * quarter * (float)i;
        struct lw_affine centre;
        stand(mesh, there, middle, 0, middle, angle);
        centre = mesh->placement;
        stand(mesh, &centre, -0.5f * side, 0, apothem, 0);
        facet.seed++;
        lw_builtin_facade_build(mesh, &facet);
        lw_builtin_facade_blank(mesh, paints->wall, side, top - 1.3f, top);
    }
    stand(mesh, there, middle, 0, middle,
          0.25f * quarter); /* corners of the octagon, not middles of its sides */
    const struct lw_vec2 corbel[] = {
        {0.1f, low - 1.6f},          {0.5f * radius, low - 1.1f}, {0.85f * radius, low - 0.45f},
        {radius + 0.1f, low - 0.2f}, {radius + 0.1f, low},        {radius - 0.1f, low}};
    const struct lw_vec2 band[] = {
        {radius - 0.02f, top - 0.3f}, {radius + 0.3f, top - 0.1f}, {radius + 0.3f, top}, {radius, top}};
    const struct lw_vec2 cap[] = {{radius + 0.25f, top},        {0.85f * radius, top + 1.0f},
                                  {0.72f * radius, top + 2.0f}, {0.30f * radius, top + 3.8f},
                                  {0.08f, top + 5.2f},          {0.05f, top + 6.0f},
                                  {0.16f, top + 6.15f},         {0, top + 6.3f}};
    lw_builtin_facade_use(mesh, paints->trim);
    lw_builtin_mesh_revolve(mesh, corbel, COUNT(corbel), 8);
    lw_builtin_mesh_revolve(mesh, band, COUNT(band), 8);
    lw_builtin_facade_use_along(mesh, paints->roof);
    lw_builtin_mesh_revolve(mesh, cap, COUNT(cap), 8);
}

void lw_builtin_building_corner_house(struct lw_builtin_mesh *mesh,
                                      const struct lw_builtin_house_style *style) {
    const struct lw_affine there = mesh->placement;
    const struct lw_builtin_facade_paints *paints = style->paints;
    const float side = LW_BUILDING_CORNER, half = 0.5f * side;
    struct lw_builtin_facade front = street_front(style, side, style->bays + 1);
    const float top = lw_builtin_facade_height(&front);
    stand(mesh, &there, -side, 0, 0, 0);
    lw_builtin_facade_build(mesh, &front);
    front.seed += 50;
    front.features &= ~(unsigned)LW_FACADE_DOOR;
    stand(mesh, &there, 0, 0, 0, quarter);
    lw_builtin_facade_build(mesh, &front);
    stand(mesh, &there, PARTY_GAP_M - side, 0, -side, -quarter);
    lw_builtin_facade_blank(mesh, paints->wall, side, 0, top);
    stand(mesh, &there, 0, 0, PARTY_GAP_M - side, LW_PI);
    lw_builtin_facade_blank(mesh, paints->wall, side, 0, top);

    static const struct lw_vec2 eaves[] = {{0, 0}, {0.6f, 0}, {0.6f, 0.1f}, {0.45f, 0.1f}};
    static const struct lw_vec2 mansard[] = {{0.45f, 0.1f}, {0.1f, 0.45f}, {-1.0f, 3.1f}};
    static const struct lw_vec2 curb[] = {{-1.0f, 3.1f}, {-0.92f, 3.2f}, {-1.15f, 3.3f}};
    static const struct lw_vec2 crown[] = {{-1.15f, 3.3f}, {-3.0f, 3.9f}, {-5.0f, 4.5f}, {-7.0f, 5.0f}};
    stand(mesh, &there, -half, top, -half, 0);
    lw_builtin_facade_use_along(mesh, paints->trim);
    lw_builtin_mesh_frame(mesh, eaves, COUNT(eaves), half, half, 0, false, 2.0f);
    lw_builtin_mesh_frame(mesh, curb, COUNT(curb), half, half, 0, false, 2.0f);
    lw_builtin_facade_use_along(mesh, paints->roof);
    lw_builtin_mesh_frame(mesh, mansard, COUNT(mansard), half, half, 0, false, 1.0f);
    lw_builtin_mesh_frame(mesh, crown, COUNT(crown), half, half, 0, false, 1.0f);
    for (int wall = 0; wall < 2; wall++) {
        struct lw_affine face;
        stand(mesh, &there, -half, top, -half, wall ? quarter : 0);
        face = mesh->placement;
        for (int i = -1; i <= 1; i++)
            dormer(mesh, &face, &front, 3.6f * (float)i, 0.75f, half - 0.1f, 1.2f, i == wall);
    }
    chimney(mesh, &there, paints, -half - 3.0f, top + 3.0f, top + 5.8f, -half - 3.0f);
    if (style->turret) turret(mesh, &there, &front);
    mesh->placement = there;
}

/* ---- palace ---- */

#define PALACE_GROUND_M 5.2f
#define PALACE_STOREY_M 4.3f
#define PALACE_STOREYS  3
#define PALACE_PORTICO  4.7f  /* from the street front to the wall behind its arcade */
#define PALACE_COURT    12.0f /* half of the court's side */
#define PALACE_GALLERY  3.5f  /* from the court's columns to the wall behind them */

/** A level strip that faces down, as wide as a mitred wing at either edge. */
static void ceiling(struct lw_builtin_mesh *mesh, float y, float near_z, float far_z) {
    const struct lw_vec3 points[] = {lw_vec3(-near_z, y, near_z), lw_vec3(near_z, y, near_z),
                                     lw_vec3(-far_z, y, far_z), lw_vec3(far_z, y, far_z)};
    lw_builtin_mesh_patch(mesh, points, 2, 2, 0);
}

static void palace_street_side(struct lw_builtin_mesh *mesh, const struct lw_affine *there,
                               struct lw_builtin_facade facade) {
    const struct lw_builtin_facade_paints *paints = facade.paints;
    const float half = 0.5f * LW_BUILDING_BLOCK, bay = facade.width / (float)facade.bays;
    stand(mesh, there, -half, 0, half, 0);
    lw_builtin_facade_build(mesh, &facade);
    for (uint32_t i = 0; i < facade.bays; i++) {
        const struct lw_builtin_arch arch = {.x0 = bay * (float)i,
                                             .x1 = bay * (float)(i + 1),
                                             .y1 = PALACE_GROUND_M,
                                             .width = bay - 1.1f,
                                             .spring = 3.2f,
                                             .depth = 0.7f,
                                             .back = true};
        lw_builtin_facade_use(mesh, paints->base);
        lw_builtin_facade_arch(mesh, &arch);
        lw_builtin_facade_use(mesh, paints->trim); /* impost and foot of the pier to the left; key stone */
        for (int k = 0; k < 2; k++) {
            float y = k ? 3.0f : 0, out = k ? 0.10f : 0.08f, high = k ? 0.22f : 0.5f;
            lw_builtin_mesh_box(mesh, lw_vec3(arch.x0 - (i ? 0.6f : 0.0f), y, -0.75f),
                                lw_vec3(arch.x0 + 0.6f, y + high, out), LW_BUILTIN_ALL);
        }
        float middle = 0.5f * (arch.x0 + arch.x1), crown = arch.spring + 0.5f * arch.width;
        lw_builtin_mesh_box(mesh, lw_vec3(middle - 0.2f, crown - 0.1f, -0.3f),
                            lw_vec3(middle + 0.2f, PALACE_GROUND_M, 0.15f), LW_BUILTIN_ALL);
    }
    lw_builtin_facade_balustrade(mesh, paints->trim, 0.4f, facade.width - 0.4f,
                                 lw_builtin_facade_height(&facade), -0.2f, 0.45f);
    const float wall = half - PALACE_PORTICO;
    struct lw_builtin_facade shops = facade;
    shops.width = 2.0f * wall;
    shops.ground = LW_FACADE_GROUND_SHOPS;
    shops.bays = 10;
    shops.storeys = 0;
    shops.ground_m = PALACE_GROUND_M - 0.05f;
    shops.features = LW_FACADE_DOOR;
    shops.lit = 0.15f;
    stand(mesh, there, -wall, 0, wall, 0);
    lw_builtin_facade_build(mesh, &shops);
    mesh->placement = *there;
    lw_builtin_facade_use(mesh, paints->wall);
    ceiling(mesh, PALACE_GROUND_M - 0.02f, wall, half - 0.7f);
}

static void palace_court_side(struct lw_builtin_mesh *mesh, const struct lw_affine *there,
                              struct lw_builtin_facade facade) {
    const struct lw_builtin_facade_paints *paints = facade.paints;
    const uint32_t bays = 6;
    const float half = PALACE_COURT, bay = 2.0f * half / (float)bays, wall = half + PALACE_GALLERY;
    facade.width = 2.0f * half;
    facade.bays = bays;
    facade.features = LW_FACADE_HOODS;
    facade.seed += 300;
    stand(mesh, there, half, 0, half, LW_PI);
    const struct lw_affine front = mesh->placement;
    lw_builtin_facade_build(mesh, &facade);
    for (uint32_t i = 0; i < bays; i++) {
        const struct lw_builtin_arch arch = {.x0 = bay * (float)i,
                                             .x1 = bay * (float)(i + 1),
                                             .y0 = 3.1f,
                                             .y1 = PALACE_GROUND_M,
                                             .width = bay - 0.6f,
                                             .spring = 3.1f,
                                             .depth = 0.55f,
                                             .back = true};
        lw_builtin_facade_use(mesh, paints->wall);
        lw_builtin_facade_arch(mesh, &arch);
        lw_builtin_facade_use_along(mesh, paints->trim);
        stand(mesh, &front, arch.x0, 0, -0.275f, 0);
        lw_builtin_house_column(mesh, 3.1f, 0.24f);
        mesh->placement = front;
    }
    struct lw_builtin_facade back = facade;
    back.width = 2.0f * wall;
    back.ground = LW_FACADE_GROUND_WINDOWS;
    back.storeys = 0;
    back.features = LW_FACADE_DOOR;
    back.ground_m = PALACE_GROUND_M - 0.05f;
    back.bays = 7;
    stand(mesh, there, wall, 0, wall, LW_PI);
    lw_builtin_facade_build(mesh, &back);
    mesh->placement = *there;
    lw_builtin_facade_use(mesh, paints->wall);
    ceiling(mesh, PALACE_GROUND_M - 0.02f, half + 0.55f, wall);
}

void lw_builtin_building_palace_wing(struct lw_builtin_mesh *mesh,
                                     const struct lw_builtin_facade_paints *paints, uint32_t seed) {
    const struct lw_affine there = mesh->placement;
    const struct lw_builtin_facade facade = {.paints = paints,
                                             .width = LW_BUILDING_BLOCK,
                                             .ground_m = PALACE_GROUND_M,
                                             .storey_m = PALACE_STOREY_M,
                                             .bays = 12,
                                             .storeys = PALACE_STOREYS,
                                             .window_m = {1.35f, 2.3f},
                                             .ground = LW_FACADE_GROUND_NONE,
                                             .features = LW_FACADE_PEDIMENTS | LW_FACADE_PILASTERS |
                                                         LW_FACADE_CORNICE,
                                             .seed = seed,
                                             .lit = 0.05f};
    const float half = 0.5f * LW_BUILDING_BLOCK, top = lw_builtin_facade_height(&facade);
    const float eave = half - 0.8f, ridge = 0.5f * (half + PALACE_COURT), inner = PALACE_COURT - 0.5f;
    palace_street_side(mesh, &there, facade);
    palace_court_side(mesh, &there, facade);
    lw_builtin_facade_use_along(mesh, paints->roof);
    stand(mesh, &there, 0, top + 0.1f, eave, 0);
    slope(mesh, eave, ridge, 3.0f, eave - ridge);
    /* towards the court a slope widens as it rises: two halves of it are mirrored hips of the corners */
    const struct lw_vec3 back[] = {lw_vec3(inner, top + 0.1f, inner), lw_vec3(-inner, top + 0.1f, inner),
                                   lw_vec3(ridge, top + 3.1f, ridge), lw_vec3(-ridge, top + 3.1f, ridge)};
    mesh->placement = there;
    lw_builtin_mesh_patch(mesh, back, 2, 2, 0);
    lw_builtin_facade_use(mesh, paints->trim);
    ceiling(mesh, top + 0.08f, inner, PALACE_COURT); /* soffit of the eaves */
    const struct lw_vec3 gutter[] = {lw_vec3(eave, top + 0.1f, eave), lw_vec3(-eave, top + 0.1f, eave),
                                     lw_vec3(half, top + 0.01f, half), lw_vec3(-half, top + 0.01f, half)};
    lw_builtin_mesh_patch(mesh, gutter, 2, 2, 0);
    mesh->placement = there;
}

/* ---- tower ---- */

/** Four like fronts around a square. */
static void four_fronts(struct lw_builtin_mesh *mesh, const struct lw_affine *there,
                        struct lw_builtin_facade facade) {
    for (int side = 0; side < 4; side++) {
        struct lw_affine turned;
        stand(mesh, there, 0, 0, 0, quarter * (float)side);
        turned = mesh->placement;
        stand(mesh, &turned, -0.5f * facade.width, 0, 0.5f * facade.width, 0);
        facade.seed += 17;
        lw_builtin_facade_build(mesh, &facade);
    }
}

/** A parapet around a flat roof of this half side, and the roof. */
static void terrace(struct lw_builtin_mesh *mesh, const struct lw_affine *there,
                    const struct lw_builtin_facade_paints *paints, float half, float y) {
    static const struct lw_vec2 parapet[] = {{0.62f, 0},    {0.62f, 0.12f}, {0.1f, 0.2f},    {0.1f, 0.95f},
                                             {0.18f, 1.0f}, {0.18f, 1.12f}, {-0.25f, 1.12f}, {-0.25f, 0.05f}};
    stand(mesh, there, 0, y, 0, 0);
    lw_builtin_facade_use_along(mesh, paints->trim);
    lw_builtin_mesh_frame(mesh, parapet, COUNT(parapet), half, half, 0, false, 2.0f);
    lw_builtin_facade_use(mesh, paints->base);
    lw_builtin_mesh_quad(mesh, lw_vec3(-half, 0.06f, half), lw_vec3(2 * half, 0, 0), lw_vec3(0, 0, -2 * half),
                         4.0f);
}

void lw_builtin_building_tower(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade_paints *paints,
                               uint32_t seed) {
    const struct lw_affine there = mesh->placement;
    struct lw_builtin_facade facade = {.paints = paints,
                                       .width = LW_BUILDING_BLOCK - 2.0f,
                                       .ground_m = 4.6f,
                                       .storey_m = 3.8f,
                                       .bays = 12,
                                       .storeys = 1,
                                       .window_m = {2.2f, 2.3f},
                                       .ground = LW_FACADE_GROUND_SHOPS,
                                       .features = LW_FACADE_PILASTERS | LW_FACADE_CORNICE | LW_FACADE_DOOR,
                                       .seed = seed,
                                       .lit = 0.10f};
    static const struct {
        float width, window_w;
        uint32_t bays, storeys;
    } tiers[] = {{26.0f, 1.7f, 8, 12}, {19.0f, 1.6f, 6, 3}, {12.0f, 1.5f, 4, 2}};
    four_fronts(mesh, &there, facade);
    float y = lw_builtin_facade_height(&facade);
    terrace(mesh, &there, paints, 0.5f * facade.width, y);
    facade.features = LW_FACADE_PILASTERS | LW_FACADE_CORNICE;
    facade.ground = LW_FACADE_GROUND_NONE;
    facade.storey_m = 3.5f;
    facade.window_m[1] = 2.1f;
    for (uint32_t i = 0; i < COUNT(tiers); i++) {
        facade.width = tiers[i].width;
        facade.bays = tiers[i].bays;
        facade.storeys = tiers[i].storeys;
        facade.window_m[0] = tiers[i].window_w;
        facade.ground_m = y;
        facade.seed += 100;
        four_fronts(mesh, &there, facade);
        y = lw_builtin_facade_height(&facade);
        if (i + 1 < COUNT(tiers)) terrace(mesh, &there, paints, 0.5f * facade.width, y);
    }
    const struct lw_vec2 crown[] = {{0.55f, 0},      {0.2f, 0.4f},  {-2.4f, 5.0f},  {-2.2f, 5.2f},
                                    {-2.2f, 5.5f},   {-2.6f, 5.6f}, {-4.9f, 12.0f}, {-5.2f, 12.2f},
                                    {-5.85f, 19.0f}, {-6.0f, 19.2f}};
    stand(mesh, &there, 0, y, 0, 0);
    lw_builtin_facade_use_along(mesh, paints->roof);
    lw_builtin_mesh_frame(mesh, crown, COUNT(crown), 6.0f, 6.0f, 0, false, 2.0f);
    mesh->placement = there;
}

/* ---- church ---- */

#define NAVE_HALF  8.0f
#define NAVE_BACK  -19.0f
#define NAVE_FRONT 9.0f
#define NAVE_TOP   13.0f
#define NAVE_RISE  9.0f
#define BELL_SIDE  8.4f
#define BELL_TOP   33.0f
#define SPIRE_RISE 18.0f

/** A wall of `bays` tall round-headed windows. */
static void arched_wall(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade_paints *paints,
                        float width, uint32_t bays, float low, float top, float window, float sill,
                        float spring) {
    const float bay = width / (float)bays;
    lw_builtin_facade_blank(mesh, paints->base, width, low, sill);
    for (uint32_t i = 0; i < bays; i++) {
        const struct lw_builtin_arch arch = {.x0 = bay * (float)i,
                                             .y0 = sill,
                                             .x1 = bay * (float)(i + 1),
                                             .y1 = top,
                                             .width = window,
                                             .spring = spring,
                                             .depth = 0.5f};
        const float middle = 0.5f * (arch.x0 + arch.x1);
        lw_builtin_facade_use(mesh, paints->wall);
        lw_builtin_facade_arch(mesh, &arch);
        lw_builtin_facade_arch_glass(mesh, paints, &arch, false);
        lw_builtin_facade_use(mesh, paints->trim);
        lw_builtin_mesh_box(mesh, lw_vec3(middle - 0.5f * window - 0.2f, sill - 0.25f, -0.5f),
                            lw_vec3(middle + 0.5f * window + 0.2f, sill, 0.15f), LW_BUILTIN_ALL);
    }
}

/** Stands against a wall at x, stepping back twice. */
static void buttress(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade_paints *paints, float x,
                     float top) {
    static const float out[] = {1.5f, 1.05f, 0.6f};
    const float half = 0.45f;
    for (int i = 0; i < 3; i++) {
        float low = top * (float)i / 3.0f, high = top * (float)(i + 1) / 3.0f, next = i < 2 ? out[i + 1] : 0;
        lw_builtin_facade_use(mesh, paints->base);
        lw_builtin_mesh_box(mesh, lw_vec3(x - half, low - (i ? 0.0f : 0.3f), 0),
                            lw_vec3(x + half, high, out[i]),
                            LW_BUILTIN_FRONT | LW_BUILTIN_LEFT | LW_BUILTIN_RIGHT);
        lw_builtin_facade_use(mesh, paints->trim);
        const float slant = 0.6f * (out[i] - next);
        lw_builtin_mesh_quad(mesh, lw_vec3(x - half, high, out[i]), lw_vec3(2 * half, 0, 0),
                             lw_vec3(0, slant, next - out[i]), 0);
        for (int side = -1; side <= 1; side += 2) {
            float at = x + half * (float)side;
            const struct lw_vec3 low_out = lw_vec3(at, high, out[i]), low_in = lw_vec3(at, high, next),
                                 tip = lw_vec3(at, high + slant, next);
            const struct lw_vec3 cheek[] = {side > 0 ? low_out : low_in, side > 0 ? low_in : low_out, tip,
                                            tip};
            lw_builtin_mesh_patch(mesh, cheek, 2, 2, 0);
        }
    }
}

static void bell_tower(struct lw_builtin_mesh *mesh, const struct lw_affine *there,
                       const struct lw_builtin_facade_paints *paints) {
    const float half = 0.5f * BELL_SIDE, z = NAVE_FRONT + half;
    for (int side = 0; side < 4; side++) {
        struct lw_affine turned;
        stand(mesh, there, 0, 0, z, quarter * (float)side);
        turned = mesh->placement;
        stand(mesh, &turned, -half, 0, half, 0);
        if (side == 0) { /* the portal */
            const struct lw_builtin_arch portal = {
                .x1 = BELL_SIDE, .y1 = 9.0f, .width = 3.4f, .spring = 3.6f, .depth = 1.0f};
            lw_builtin_facade_use(mesh, paints->base);
            lw_builtin_facade_arch(mesh, &portal);
            struct lw_builtin_facade_paints doors = *paints;
            doors.glass = paints->door;
            lw_builtin_facade_arch_glass(mesh, &doors, &portal, false);
        } else
            lw_builtin_facade_blank(mesh, paints->base, BELL_SIDE, -0.3f, 9.0f);
        arched_wall(mesh, paints, BELL_SIDE, 1, 9.0f, 20.0f, 1.2f, 12.0f, 16.0f);
        arched_wall(mesh, paints, BELL_SIDE, 2, 20.0f, BELL_TOP, 1.9f, 24.0f, 29.0f);
        lw_builtin_facade_cornice(mesh, paints->trim, BELL_SIDE, BELL_TOP);
        lw_builtin_facade_use(mesh, paints->trim);
        for (int band = 0; band < 2; band++)
            lw_builtin_mesh_box(mesh, lw_vec3(0, band ? 20.0f : 9.0f, 0),
                                lw_vec3(BELL_SIDE, band ? 20.4f : 9.4f, 0.2f),
                                LW_BUILTIN_ALL & ~(unsigned)LW_BUILTIN_BACK);
        for (int corner = 0; corner < 2; corner++)
            buttress(mesh, paints, corner ? BELL_SIDE - 0.46f : 0.46f, 15.0f);
    }
    const struct lw_vec2 spire[] = {{0.5f, 0},           {0.3f, 0.5f},
                                    {-1.4f, 2.6f},       {-3.95f, SPIRE_RISE - 0.4f},
                                    {-4.1f, SPIRE_RISE}, {-4.2f, SPIRE_RISE + 0.1f}};
    stand(mesh, there, 0, BELL_TOP, z, 0);
    lw_builtin_facade_use_along(mesh, paints->roof);
    lw_builtin_mesh_frame(mesh, spire, COUNT(spire), half, half, 0, false, 1.0f);
    for (int i = 0; i < 4; i++) { /* pinnacles */
        static const struct lw_vec2 pinnacle[] = {{0.5f, 0},    {0.5f, 1.6f},   {0.62f, 1.7f}, {0.55f, 1.9f},
                                                  {0.1f, 4.2f}, {0.16f, 4.35f}, {0, 4.5f}};
        lw_builtin_facade_use_along(mesh, paints->trim);
        stand(mesh, there, i & 1 ? half - 0.3f : 0.3f - half, BELL_TOP,
              z + (i & 2 ? half - 0.3f : 0.3f - half), 0);
        lw_builtin_mesh_revolve(mesh, pinnacle, COUNT(pinnacle), 8);
    }
}

void lw_builtin_building_church(struct lw_builtin_mesh *mesh, const struct lw_builtin_facade_paints *paints) {
    const struct lw_affine there = mesh->placement;
    const float length = NAVE_FRONT - NAVE_BACK, middle = 0.5f * (NAVE_FRONT + NAVE_BACK);
    for (int side = 0; side < 2; side++) {
        const float s = side ? 1.0f : -1.0f;
        stand(mesh, &there, s * NAVE_HALF, 0, side ? NAVE_FRONT : NAVE_BACK, s * quarter);
        arched_wall(mesh, paints, length, 7, -0.3f, NAVE_TOP, 1.8f, 3.2f, 9.0f);
        lw_builtin_facade_cornice(mesh, paints->trim, length, NAVE_TOP);
        for (int i = 0; i <= 7; i++)
            buttress(mesh, paints, fminf(fmaxf(length * (float)i / 7.0f, 0.5f), length - 0.5f), 10.0f);
        lw_builtin_facade_use_along(mesh, paints->roof);
        stand(mesh, &there, s * (NAVE_HALF + 0.6f), NAVE_TOP, middle, s * quarter);
        slope(mesh, 0.5f * length, 0.5f * length, NAVE_RISE, NAVE_HALF + 0.6f);
        stand(mesh, &there, side ? -NAVE_HALF : NAVE_HALF, 0, side ? NAVE_FRONT : NAVE_BACK,
              side ? 0 : LW_PI);
        lw_builtin_facade_blank(mesh, paints->wall, 2 * NAVE_HALF, -0.3f, NAVE_TOP);
        gable(mesh, 0, 2 * NAVE_HALF, NAVE_TOP, NAVE_RISE);
    }
    /* the apse: half of it is inside the nave */
    const struct lw_vec2 apse[] = {{5.2f, -0.3f}, {5.2f, 1.2f}, {5.0f, 1.3f}, {5.0f, 9.0f},
                                   {5.5f, 9.3f},  {5.5f, 9.6f}, {5.2f, 9.7f}};
    const struct lw_vec2 dome[] = {{5.3f, 9.65f}, {4.6f, 11.0f}, {3.0f, 12.6f}, {1.2f, 13.5f}, {0, 13.8f}};
    stand(mesh, &there, 0, 0, NAVE_BACK, 0);
    lw_builtin_facade_use_along(mesh, paints->wall);
    lw_builtin_mesh_revolve(mesh, apse, COUNT(apse), 20);
    lw_builtin_facade_use_along(mesh, paints->roof);
    lw_builtin_mesh_revolve(mesh, dome, COUNT(dome), 20);
    bell_tower(mesh, &there, paints);
    mesh->placement = there;
}
