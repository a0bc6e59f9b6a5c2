#include "common/builtin/builtin_building.h"
#include "common/builtin/builtin_furnish.h"
#include "common/builtin/builtin_scenes.h"
#include "common/builtin/builtin_stage.h"
#include "common/builtin/builtin_street.h"
#include "common/builtin/builtin_texture.h"

#include "common/base/random.h"

#include <stdio.h>

#define LOOP_S 120.0f

/* A low sun in the evening, scaled as the atrium's: streets are in the shade of their houses, lit by the sky,
 * by what sunlit fronts throw back, and by lamps that already burn. */
static const struct lw_vec3 sun_direction = {0.62f, -0.66f, -0.42f};
static const struct lw_vec3 sun_irradiance = {96.0f, 78.0f, 54.0f};
#define SUN_ANGULAR_DIAMETER 0.0093f
static const float sky_radiance[3] = {1.9f, 2.6f, 3.8f};

/* W/(m^2 sr) */
static const float lamp_radiance[3] = {420.0f, 260.0f, 120.0f};
static const float window_radiance[3] = {24.0f, 15.0f, 6.5f};
static const float headlamp_radiance[3] = {600.0f, 560.0f, 480.0f};
static const float taillamp_radiance[3] = {60.0f, 4.0f, 3.0f};
static const float cabin_radiance[3] = {40.0f, 30.0f, 18.0f};
static const float lantern_radiance[3] = {1500.0f, 760.0f, 240.0f};

/* Buildings of the blocks. A larger town repeats them. */
enum block {
    HOUSES = 'h',
    BRICK_HOUSES = 'b',
    PALACE = 'p',
    TOWER = 't',
    SQUARE = 's',
    CHURCH = 'c',
    PARK = 'k'
};
enum { PLAN_SIDE = 8 };
static const char plan[PLAN_SIDE][PLAN_SIDE + 1] = {
    "hsbhphbh", /* -Z */
    "bphtbshp", "hbhchbkh", "tshbhpbh", "bhkbshhb", "hpbhthcb", "bhcshbhs", "hbhpbhtb",
};

/* ---- paints ---- */

enum { HOUSE_COLOURS = 5 };

struct palette {
    struct lw_builtin_street_paints street;
    struct lw_builtin_facade_paints house[HOUSE_COLOURS], palace, tower, church;
    uint32_t lantern, brass;
};

static struct lw_builtin_paint paint(struct lw_builtin_stage *stage, const char *name, float r, float g,
                                     float b, uint32_t texture, float metres) {
    return (struct lw_builtin_paint){lw_builtin_stage_material(stage, name, lw_vec3(r, g, b), texture),
                                     metres};
}

static struct lw_builtin_paint glowing(struct lw_builtin_stage *stage, const char *name,
                                       const float radiance[3]) {
    struct lw_builtin_paint lamp = paint(stage, name, 0.7f, 0.7f, 0.7f, LW_SCENE_NONE, 1.0f);
    lw_builtin_stage_emission(stage, lamp.material, radiance);
    return lamp;
}

static void mix_palette(struct lw_builtin_stage *stage, struct palette *p) {
    enum {
        PLASTER,
        ASHLAR,
        MARBLE,
        WOOD,
        TILES,
        SETTS,
        PAVING,
        BRICKS,
        GRASS,
        FOLIAGE,
        SLATE,
        STRIPES,
        TEXTURES
    };
    static const enum lw_builtin_texture_kind kinds[TEXTURES] = {
        LW_BUILTIN_TEXTURE_PLASTER, LW_BUILTIN_TEXTURE_ASHLAR,     LW_BUILTIN_TEXTURE_MARBLE,
        LW_BUILTIN_TEXTURE_WOOD,    LW_BUILTIN_TEXTURE_ROOF_TILES, LW_BUILTIN_TEXTURE_SETTS,
        LW_BUILTIN_TEXTURE_PAVING,  LW_BUILTIN_TEXTURE_BRICK,      LW_BUILTIN_TEXTURE_GRASS,
        LW_BUILTIN_TEXTURE_FOLIAGE, LW_BUILTIN_TEXTURE_SLATE,      LW_BUILTIN_TEXTURE_STRIPES};
    const uint32_t none = LW_SCENE_NONE;
    uint32_t texture[TEXTURES];
    for (int i = 0; i < TEXTURES; i++) texture[i] = lw_builtin_texture_add(stage, kinds[i]);

    const struct lw_builtin_paint stone = paint(stage, "stone", 0.95f, 0.93f, 0.90f, texture[MARBLE], 2.4f),
                                  ashlar = paint(stage, "ashlar", 0.92f, 0.90f, 0.88f, texture[ASHLAR], 2.0f),
                                  tiles = paint(stage, "roof tiles", 1, 1, 1, texture[TILES], 1.2f),
                                  slate = paint(stage, "slate", 1, 1, 1, texture[SLATE], 1.6f),
                                  copper = paint(stage, "copper", 0.30f, 0.52f, 0.44f, none, 1.0f),
                                  iron = paint(stage, "iron", 0.05f, 0.055f, 0.06f, none, 1.0f),
                                  glass = paint(stage, "glass", 0.07f, 0.09f, 0.11f, none, 1.0f),
                                  glow = glowing(stage, "lit window", window_radiance),
                                  wood = paint(stage, "wood", 1, 1, 1, texture[WOOD], 1.0f),
                                  awning = paint(stage, "awning", 1, 1, 1, texture[STRIPES], 0.9f),
                                  white = paint(stage, "white paint", 0.76f, 0.74f, 0.70f, none, 1.0f),
                                  green = paint(stage, "green paint", 0.10f, 0.22f, 0.15f, none, 1.0f),
                                  blue = paint(stage, "blue paint", 0.12f, 0.20f, 0.30f, none, 1.0f),
                                  red = paint(stage, "red paint", 0.42f, 0.07f, 0.06f, none, 1.0f);
    const struct lw_builtin_paint walls[HOUSE_COLOURS] = {
        paint(stage, "ochre plaster", 0.95f, 0.78f, 0.50f, texture[PLASTER], 4.0f),
        paint(stage, "rose plaster", 0.92f, 0.64f, 0.55f, texture[PLASTER], 4.0f),
        paint(stage, "pale plaster", 0.98f, 0.95f, 0.90f, texture[PLASTER], 4.0f),
        paint(stage, "brick", 1, 1, 1, texture[BRICKS], 1.0f),
        paint(stage, "dark brick", 0.72f, 0.66f, 0.62f, texture[BRICKS], 1.0f)};
    for (int i = 0; i < HOUSE_COLOURS; i++)
        p->house[i] = (struct lw_builtin_facade_paints){.wall = walls[i],
                                                        .base = i == 2 ? ashlar : stone,
                                                        .trim = stone,
                                                        .frame = white,
                                                        .glass = glass,
                                                        .glow = glow,
                                                        .shutter = i == 0 ? green : blue,
                                                        .door = i % 2 ? red : green,
                                                        .iron = iron,
                                                        .awning = awning,
                                                        .roof = i < 3 ? tiles : slate};
    p->house[0].base = walls[2];
    p->house[3].base = walls[3];
    p->palace = p->house[2];
    p->palace.wall = p->palace.base = ashlar;
    p->palace.roof = copper;
    p->tower = p->palace;
    p->tower.base = stone;
    p->tower.frame = iron;
    p->church = p->palace;
    p->church.roof = slate;
    p->street = (struct lw_builtin_street_paints){
        .setts = paint(stage, "setts", 1, 1, 1, texture[SETTS], 2.0f),
        .paving = paint(stage, "paving", 1, 1, 1, texture[PAVING], 2.4f),
        .kerb = ashlar,
        .stripe = white,
        .stone = stone,
        .grass = paint(stage, "grass", 0.80f, 0.74f, 0.74f, texture[GRASS], 3.0f),
        .gravel = paint(stage, "gravel", 0.55f, 0.48f, 0.38f, none, 1.0f),
        .water = paint(stage, "water", 0.06f, 0.16f, 0.18f, none, 1.0f),
        .bark = paint(stage, "bark", 0.20f, 0.15f, 0.11f, none, 1.0f),
        .foliage = paint(stage, "foliage", 0.88f, 0.84f, 0.84f, texture[FOLIAGE], 2.0f),
        .iron = iron,
        .lamp = glowing(stage, "street lamp", lamp_radiance),
        .wood = wood,
        .awning = awning,
        .soil = paint(stage, "soil", 0.12f, 0.09f, 0.06f, none, 1.0f),
        .wall = ashlar,
        .roof = tiles,
        .paintwork = red,
        .pale = white,
        .glass = glass,
        .headlamp = glowing(stage, "headlamp", headlamp_radiance),
        .taillamp = glowing(stage, "tail lamp", taillamp_radiance),
        .cabin = glowing(stage, "tram window", cabin_radiance)};
    p->lantern = glowing(stage, "lantern", lantern_radiance).material;
    p->brass = paint(stage, "brass", 0.58f, 0.40f, 0.16f, none, 1.0f).material;
}

/* ---- meshes ---- */

enum { ROWS = 4, CORNERS = 4, TREES = 3 };

struct kit {
    uint32_t tile, furniture, row[ROWS], corner[CORNERS], wing, tower, church, tree[TREES], garden, square,
        churchyard, park, court, rim, rim_corner;
};

static void build_houses(struct lw_builtin_stage *stage, struct lw_builtin_mesh *mesh,
                         const struct palette *p, struct kit *kit) {
    const struct lw_builtin_house_style rows[ROWS] = {
        {&p->house[0], 3, 4, LW_FACADE_GROUND_SHOPS, LW_FACADE_SHUTTERS | LW_FACADE_DOOR, false, 11},
        {&p->house[1], 4, 4, LW_FACADE_GROUND_WINDOWS, LW_FACADE_HOODS | LW_FACADE_BALCONIES | LW_FACADE_DOOR,
         false, 23},
        {&p->house[3], 3, 4, LW_FACADE_GROUND_WINDOWS, LW_FACADE_PEDIMENTS | LW_FACADE_DOOR, false, 37},
        {&p->house[4], 4, 4, LW_FACADE_GROUND_SHOPS, LW_FACADE_HOODS | LW_FACADE_DOOR, false, 41}};
    const struct lw_builtin_house_style corners[CORNERS] = {
        {&p->house[2], 4, 4, LW_FACADE_GROUND_SHOPS, LW_FACADE_HOODS | LW_FACADE_DOOR, true, 53},
        {&p->house[0], 4, 4, LW_FACADE_GROUND_SHOPS, LW_FACADE_SHUTTERS | LW_FACADE_BALCONIES, false, 67},
        {&p->house[3], 4, 4, LW_FACADE_GROUND_SHOPS, LW_FACADE_HOODS, true, 71},
        {&p->house[1], 3, 4, LW_FACADE_GROUND_WINDOWS, LW_FACADE_PEDIMENTS | LW_FACADE_DOOR, false, 83}};
    char name[32];
    for (int i = 0; i < ROWS; i++) {
        lw_builtin_building_row_house(mesh, &rows[i]);
        snprintf(name, sizeof name, "row house %c", 'a' + i);
        kit->row[i] = lw_builtin_stage_mesh(stage, name, mesh);
    }
    for (int i = 0; i < CORNERS; i++) {
        lw_builtin_building_corner_house(mesh, &corners[i]);
        snprintf(name, sizeof name, "corner house %c", 'a' + i);
        kit->corner[i] = lw_builtin_stage_mesh(stage, name, mesh);
    }
}

static struct kit build_kit(struct lw_builtin_stage *stage, struct lw_builtin_mesh *mesh,
                            const struct palette *p) {
    struct kit kit;
    build_houses(stage, mesh, p, &kit);
    lw_builtin_building_palace_wing(mesh, &p->palace, 97);
    kit.wing = lw_builtin_stage_mesh(stage, "palace wing", mesh);
    lw_builtin_building_tower(mesh, &p->tower, 101);
    kit.tower = lw_builtin_stage_mesh(stage, "tower", mesh);
    lw_builtin_building_church(mesh, &p->church);
    kit.church = lw_builtin_stage_mesh(stage, "church", mesh);
    static const char *const tree_names[TREES] = {"lime tree", "plane tree", "young tree"};
    static const float tree_heights[TREES] = {9.5f, 12.0f, 6.5f};
    for (int i = 0; i < TREES; i++) {
        lw_builtin_street_tree(mesh, &p->street, tree_heights[i], 7u * (uint32_t)(i + 1));
        kit.tree[i] = lw_builtin_stage_mesh(stage, tree_names[i], mesh);
    }
    const struct {
        void (*build)(struct lw_builtin_mesh *mesh, const struct lw_builtin_street_paints *paints);
        const char *name;
        uint32_t *index;
    } parts[] = {{lw_builtin_street_tile, "street", &kit.tile},
                 {lw_builtin_street_furniture, "street lamps", &kit.furniture},
                 {lw_builtin_street_garden, "garden", &kit.garden},
                 {lw_builtin_street_square, "square", &kit.square},
                 {lw_builtin_street_churchyard, "churchyard", &kit.churchyard},
                 {lw_builtin_street_park, "park", &kit.park},
                 {lw_builtin_street_court, "court", &kit.court},
                 {lw_builtin_street_rim, "town wall", &kit.rim},
                 {lw_builtin_street_rim_corner, "town wall corner", &kit.rim_corner}};
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        parts[i].build(mesh, &p->street);
        *parts[i].index = lw_builtin_stage_mesh(stage, parts[i].name, mesh);
    }
    return kit;
}

/* ---- blocks ---- */

/** An instance of a mesh, by the mesh's name. */
static void put(struct lw_builtin_stage *stage, uint32_t mesh, uint32_t parent, float x, float z,
                float angle) {
    if (stage->failed) return;
    const char *name = stage->scene->mesh[mesh].name;
    uint32_t node = lw_builtin_stage_node(stage, name, parent, lw_vec3(x, 0, z));
    lw_builtin_stage_turn(stage, node, angle);
    lw_builtin_stage_instance(stage, name, mesh, node);
}

static void plant(struct lw_builtin_stage *stage, const struct kit *kit, uint32_t parent, uint32_t seed,
                  float x, float z) {
    uint32_t chance = lw_random_hash3(seed, (uint32_t)(x * 8.0f + 1024.0f), (uint32_t)(z * 8.0f + 1024.0f));
    put(stage, kit->tree[chance % TREES], parent, x, z,
        2.0f * LW_PI * lw_random_unit(lw_random_hash(chance)));
}

static void put_houses(struct lw_builtin_stage *stage, const struct kit *kit, uint32_t parent, uint32_t seed,
                       bool brick) {
    for (uint32_t side = 0; side < 4; side++) {
        float angle = 0.5f * LW_PI * (float)side, c = cosf(angle), s = sinf(angle);
        uint32_t chance = lw_random_hash2(seed, side);
        const float front = LW_STREET_FRONT,
                    x[2] = {-0.5f * LW_BUILDING_ROW_WIDTH, 0.5f * LW_BUILDING_ROW_WIDTH};
        for (uint32_t i = 0; i < 2; i++) {
            uint32_t which = (brick ? 2 : 0) + (chance >> i & 1);
            if ((chance >> 4 & 7) == 0) which = (which + 2) % ROWS;
            put(stage, kit->row[which], parent, c * x[i] + s * front, -s * x[i] + c * front, angle);
        }
        put(stage, kit->corner[(chance >> 8) % CORNERS], parent, (c + s) * front, (c - s) * front, angle);
    }
    put(stage, kit->garden, parent, 0, 0, 0.5f * LW_PI * (float)(seed % 4));
    for (int i = 0; i < 4; i++) plant(stage, kit, parent, seed, i & 1 ? 7.0f : -7.0f, i & 2 ? 7.0f : -7.0f);
}

static void put_square(struct lw_builtin_stage *stage, const struct kit *kit, uint32_t parent,
                       uint32_t seed) {
    put(stage, kit->square, parent, 0, 0, 0);
    for (int i = 0; i < 6; i++) {
        plant(stage, kit, parent, seed, -22.5f, -15.0f + 6.0f * (float)i);
        plant(stage, kit, parent, seed, 22.5f, -15.0f + 6.0f * (float)i);
    }
}

static void put_park(struct lw_builtin_stage *stage, const struct kit *kit, uint32_t parent, uint32_t seed) {
    put(stage, kit->park, parent, 0, 0, 0);
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < 6; k++) {
            float x = -20.0f + 8.0f * (float)i, z = -20.0f + 8.0f * (float)k;
            uint32_t chance = lw_random_hash3(seed, (uint32_t)i, (uint32_t)k);
            x += 3.0f * (lw_random_unit(chance) - 0.5f);
            z += 3.0f * (lw_random_unit(lw_random_hash(chance)) - 0.5f);
            bool pavilion = i >= 4 && k <= 1, path = fabsf(x) < 2.8f || fabsf(z) < 2.8f;
            if (x * x + z * z > 14.5f * 14.5f && !pavilion && !path) plant(stage, kit, parent, seed, x, z);
        }
}

static void put_block(struct lw_builtin_stage *stage, const struct kit *kit, enum block what, uint32_t column,
                      uint32_t row, float x, float z) {
    char name[32];
    snprintf(name, sizeof name, "block %u-%u", column + 1, row + 1);
    const uint32_t parent = lw_builtin_stage_node(stage, name, LW_SCENE_NONE, lw_vec3(x, 0, z)),
                   seed = lw_random_hash2(column, row);
    const float turn = 0.5f * LW_PI * (float)(seed >> 8 & 3);
    put(stage, kit->tile, parent, 0, 0, 0);
    put(stage, kit->furniture, parent, 0, 0, 0);
    switch (what) {
    case HOUSES:
    case BRICK_HOUSES:
        put_houses(stage, kit, parent, seed, what == BRICK_HOUSES);
        break;
    case PALACE:
        for (int i = 0; i < 4; i++) put(stage, kit->wing, parent, 0, 0, 0.5f * LW_PI * (float)i);
        put(stage, kit->court, parent, 0, 0, 0);
        break;
    case TOWER:
        put(stage, kit->tower, parent, 0, 0, turn);
        break;
    case SQUARE:
        put_square(stage, kit, parent, seed);
        break;
    case CHURCH:
        put(stage, kit->church, parent, 0, 0, turn);
        put(stage, kit->churchyard, parent, 0, 0, turn);
        for (int i = 0; i < 4; i++)
            plant(stage, kit, parent, seed, i & 1 ? 20.0f : -20.0f, i & 2 ? 20.0f : -20.0f);
        break;
    case PARK:
        put_park(stage, kit, parent, seed);
        break;
    }
}

/** Middle of a block's column or row. */
static float block_at(uint32_t index, uint32_t blocks) {
    return LW_STREET_PITCH * ((float)index - 0.5f * (float)(blocks - 1));
}

static void put_rim(struct lw_builtin_stage *stage, const struct kit *kit, uint32_t blocks) {
    const float half = 0.5f * LW_STREET_PITCH * (float)blocks;
    for (int side = 0; side < 4; side++) {
        float angle = 0.5f * LW_PI * (float)side, c = cosf(angle), s = sinf(angle);
        for (uint32_t i = 0; i < blocks; i++) {
            float x = block_at(i, blocks);
            put(stage, kit->rim, LW_SCENE_NONE, c * x + s * half, -s * x + c * half, angle);
        }
        put(stage, kit->rim_corner, LW_SCENE_NONE, (c + s) * half, (c - s) * half, angle);
    }
}

/* ---- animation ---- */

/** A square with round corners about a block, clockwise seen from above. */
struct round {
    float x, y, z;      /* its middle; the height */
    float half, radius; /* the square's; its corners' */
    float start;        /* share of the way around at which it begins */
    uint32_t turns;     /* per loop of the animation */
};

/** Point and heading (unit) after a share of the way around. */
static void point_on_round(const struct round *round, float share, struct lw_vec3 *out_point,
                           struct lw_vec3 *out_heading) {
    const float flat = 2.0f * (round->half - round->radius), arc = 0.5f * LW_PI * round->radius;
    float way = (share - floorf(share)) * 4.0f * (flat + arc);
    int side = (int)(way / (flat + arc));
    if (side > 3) side = 3;
    way -= (float)side * (flat + arc);
    /* the side towards -Z, heading to +X, then turned by quarters */
    float turned = way > flat ? (way - flat) / round->radius : 0;
    struct lw_vec3 p = lw_vec3(fminf(way, flat) - 0.5f * flat + round->radius * sinf(turned), 0,
                               -0.5f * flat - round->radius * cosf(turned)),
                   h = lw_vec3(cosf(turned), 0, sinf(turned));
    float angle = 0.5f * LW_PI * (float)side, c = cosf(angle), s = sinf(angle);
    *out_point = lw_vec3(round->x + c * p.x - s * p.z, round->y, round->z + s * p.x + c * p.z);
    *out_heading = lw_vec3(c * h.x - s * h.z, 0, s * h.x + c * h.z);
}

/** Moves a node, whose front is -Z, around; it looks `aside` radians to the left of where it goes. */
static void drive(struct lw_builtin_stage *stage, uint32_t node, const struct round *round, float aside) {
    const float way = 8.0f * (round->half - round->radius) + 2.0f * LW_PI * round->radius;
    const uint32_t keys = 481;
    float *place = lw_builtin_stage_channel(stage, node, LW_CHANNEL_TRANSLATION, LW_INTERPOLATION_CUBIC, keys,
                                            LOOP_S),
          *turn = lw_builtin_stage_channel(stage, node, LW_CHANNEL_ROTATION, LW_INTERPOLATION_LINEAR, keys,
                                           LOOP_S);
    const float speed = way * (float)round->turns / LOOP_S;
    for (uint32_t k = 0; k < keys && place && turn; k++, place += 9, turn += 4) {
        struct lw_vec3 point, heading;
        /* whole turns: the last key is the first again, to the bit */
        point_on_round(round, round->start + (float)(k * round->turns % (keys - 1)) / (float)(keys - 1),
                       &point, &heading);
        const float p[3] = {point.x, point.y, point.z}, v[3] = {speed * heading.x, 0, speed * heading.z};
        for (int i = 0; i < 3; i++) {
            place[i] = place[6 + i] = v[i];
            place[3 + i] = p[i];
        }
        /* -Z turned by an angle about +Y is (-sin, 0, -cos) */
        float half = 0.5f * (atan2f(-heading.x, -heading.z) + aside);
        turn[1] = sinf(half);
        turn[3] = cosf(half);
        if (k > 0 && turn[1] * turn[-3] + turn[3] * turn[-1] < 0) turn[1] = -turn[1], turn[3] = -turn[3];
    }
}

static void put_traffic(struct lw_builtin_stage *stage, struct lw_builtin_mesh *mesh, const struct palette *p,
                        uint32_t blocks) {
    const uint32_t middle = blocks / 2, next = blocks > 1 ? middle - 1 : middle;
    const struct round by_car = {.x = block_at(next, blocks),
                                 .y = LW_STREET_ROAD_Y,
                                 .z = block_at(middle, blocks),
                                 .half = LW_STREET_LANE,
                                 .radius = 5.0f,
                                 .turns = 4},
                       by_tram = {.x = block_at(middle, blocks),
                                  .y = LW_STREET_ROAD_Y,
                                  .z = block_at(middle, blocks),
                                  .half = LW_STREET_LANE,
                                  .radius = 5.0f,
                                  .start = 0.4f,
                                  .turns = 3},
                       on_foot = {.x = block_at(next, blocks),
                                  .y = 1.35f,
                                  .z = block_at(next, blocks),
                                  .half = LW_STREET_WALK,
                                  .radius = 1.2f,
                                  .start = 0.6f,
                                  .turns = 1};
    lw_builtin_street_car(mesh, &p->street);
    uint32_t car = lw_builtin_stage_node(stage, "car", LW_SCENE_NONE, lw_vec3(0, 0, 0));
    lw_builtin_stage_object(stage, "car", mesh, car);
    for (int side = -1; side <= 1; side += 2)
        lw_builtin_stage_spot(stage, side < 0 ? "left headlight" : "right headlight", car,
                              lw_vec3(0.55f * (float)side, 0.66f, -2.25f), lw_vec3(0, -0.08f, -1),
                              lw_vec3(900.0f, 850.0f, 740.0f), 0.10f, 0.45f);
    drive(stage, car, &by_car, 0);

    lw_builtin_street_tram(mesh, &p->street);
    uint32_t tram = lw_builtin_stage_node(stage, "tram", LW_SCENE_NONE, lw_vec3(0, 0, 0));
    lw_builtin_stage_object(stage, "tram", mesh, tram);
    drive(stage, tram, &by_tram, 0);

    lw_builtin_mesh_use(mesh, p->brass, LW_BUILTIN_UV_SURFACE, 1.0f);
    lw_builtin_furnish_lamp(mesh, 0.11f, 0);
    lw_builtin_mesh_use(mesh, p->lantern, LW_BUILTIN_UV_SURFACE, 1.0f);
    lw_builtin_furnish_globe(mesh, 0.11f, 12);
    uint32_t lantern = lw_builtin_stage_node(stage, "lantern", LW_SCENE_NONE, lw_vec3(0, 0, 0));
    lw_builtin_stage_object(stage, "lantern", mesh, lantern);
    drive(stage, lantern, &on_foot, 0);
}

/** Turns what the next parts stand on... the walk goes around the block beside the middle, at the height of
 * eyes. */
static void put_cameras(struct lw_builtin_stage *stage, uint32_t blocks) {
    const uint32_t middle = blocks / 2;
    const float street = block_at(middle, blocks) - 0.5f * LW_STREET_PITCH,
                half = 0.5f * LW_STREET_PITCH * (float)blocks;
    /* in the middle of the street, since it is the cars' that keep to the right */
    lw_builtin_stage_camera(stage, "main", lw_vec3(street + 2.4f, 1.7f, half - 10.0f),
                            lw_vec3(street - 1.0f, 5.0f, half - 50.0f), 60.0f);
    float x = block_at(0, blocks), z = block_at(0, blocks);
    for (uint32_t i = 0; i < blocks * blocks; i++) {
        uint32_t column = i % blocks, row = i / blocks;
        if (plan[row % PLAN_SIDE][column % PLAN_SIDE] != SQUARE) continue;
        x = block_at(column, blocks);
        z = block_at(row, blocks);
        if (row >= middle) break; /* the one nearest to the middle, or at least the last before it */
    }
    lw_builtin_stage_camera(stage, "square", lw_vec3(x - 11.0f, 1.7f, z + 11.5f),
                            lw_vec3(x + 2.0f, 5.0f, z - 6.0f), 65.0f);
    lw_builtin_stage_camera(stage, "bird", lw_vec3(-1.05f * half, 0.45f * half + 55.0f, 1.25f * half),
                            lw_vec3(0.05f * half, 0, 0.15f * half), 50.0f);
    lw_builtin_stage_camera(stage, "roofs",
                            lw_vec3(block_at(middle, blocks) - 6.0f, 27.0f, block_at(middle, blocks) + 8.0f),
                            lw_vec3(0.3f * half, 10.0f, -half), 55.0f);
    const struct round walk = {.x = block_at(middle, blocks),
                               .y = 1.7f,
                               .z = block_at(middle, blocks),
                               .half = LW_STREET_WALK,
                               .radius = 1.2f,
                               .start = 0.85f,
                               .turns = 1};
    uint32_t node = lw_builtin_stage_camera(stage, "walk", lw_vec3(0, 1.7f, 0), lw_vec3(0, 1.7f, -1), 65.0f);
    drive(stage, node, &walk, 0.12f);
}

enum lw_status lw_builtin_city_build(unsigned blocks, struct lw_scene **out_scene, struct lw_error *err) {
    struct lw_builtin_stage stage;
    struct lw_builtin_mesh mesh;
    struct palette palette;
    if (lw_builtin_stage_init(&stage, "city") != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory while building a scene");
    lw_builtin_mesh_init(&mesh);
    mix_palette(&stage, &palette);
    const struct kit kit = build_kit(&stage, &mesh, &palette);
    for (uint32_t row = 0; row < blocks; row++)
        for (uint32_t column = 0; column < blocks; column++)
            put_block(&stage, &kit, (enum block)plan[row % PLAN_SIDE][column % PLAN_SIDE], column, row,
                      block_at(column, blocks), block_at(row, blocks));
    put_rim(&stage, &kit, blocks);
    const float half = 0.5f * LW_STREET_PITCH * (float)blocks + LW_STREET_RIM - 1.0f;
    lw_builtin_street_country(&mesh, &palette.street, half, 25.0f + 10.0f * (float)blocks);
    lw_builtin_stage_object(&stage, "country", &mesh,
                            lw_builtin_stage_node(&stage, "country", LW_SCENE_NONE, lw_vec3(0, 0, 0)));
    put_traffic(&stage, &mesh, &palette, blocks);
    lw_builtin_mesh_finish(&mesh);

    lw_builtin_stage_sun(&stage, "sun", sun_direction, sun_irradiance, SUN_ANGULAR_DIAMETER);
    for (int i = 0; i < 3; i++) stage.scene->sky[i] = sky_radiance[i];
    put_cameras(&stage, blocks);
    return lw_builtin_stage_finish(&stage, out_scene, err);
}
