#include "common/builtin/builtin_furnish.h"
#include "common/builtin/builtin_house.h"
#include "common/builtin/builtin_scenes.h"
#include "common/builtin/builtin_stage.h"
#include "common/builtin/builtin_texture.h"

#define LOOP_S 20.0f

/* A clear afternoon, scaled to W/m^2 per channel so that sunlit stone is some ten times as bright as shaded
 * stone. The sun stands behind the main camera's right shoulder: it reaches the left colonnade, the far end
 * and half of the floor, and leaves the right gallery to the light that they throw back. */
static const struct lw_vec3 sun_direction = {0.50f, -1.15f, -0.48f};
static const struct lw_vec3 sun_irradiance = {104.0f, 90.0f, 69.0f};
#define SUN_ANGULAR_DIAMETER 0.0093f
static const float sky_radiance[3] = {2.1f, 3.1f, 4.6f};

/* W/(m^2 sr). Sunlit plaster shines with about 15: the globes are small, and must matter in the shade. */
static const float lamp_radiance[3] = {1500.0f, 820.0f, 330.0f};
static const float lantern_radiance[3] = {1900.0f, 900.0f, 280.0f};

struct palette {
    bool is_matt;
    uint32_t plaster, dado, upper_dado, ashlar, rib, marble, moulding, vault, inlay, meander, tiles, step,
        wood, roof, water, soil, clay, pottery, glaze, red, blue, green, frond, leaf, brass, bronze, lamp,
        lantern;
};

static uint32_t paint(struct lw_builtin_stage *stage, const char *name, float r, float g, float b,
                      uint32_t texture) {
    return lw_builtin_stage_material(stage, name, lw_vec3(r, g, b), texture);
}

static void set_sheet(struct lw_builtin_stage *stage, uint32_t material, enum lw_alpha_mode mode) {
    if (stage->failed) return;
    stage->scene->material[material].double_sided = 1;
    stage->scene->material[material].alpha_mode = (uint8_t)mode;
}

static struct palette mix_palette(struct lw_builtin_stage *stage) {
    uint32_t texture[LW_BUILTIN_TEXTURE_COUNT];
    for (unsigned i = 0; i < LW_BUILTIN_TEXTURE_OF_CITY; i++)
        texture[i] = lw_builtin_texture_add(stage, (enum lw_builtin_texture_kind)i);
    const uint32_t none = LW_SCENE_NONE, plaster = texture[LW_BUILTIN_TEXTURE_PLASTER],
                   ashlar = texture[LW_BUILTIN_TEXTURE_ASHLAR], marble = texture[LW_BUILTIN_TEXTURE_MARBLE];
    struct palette p = {
        .plaster = paint(stage, "plaster", 1.0f, 0.97f, 0.90f, plaster),
        .dado = paint(stage, "dado", 0.62f, 0.16f, 0.11f, plaster),
        .upper_dado = paint(stage, "upper dado", 0.20f, 0.40f, 0.42f, plaster),
        .ashlar = paint(stage, "ashlar", 1, 1, 1, ashlar),
        .rib = paint(stage, "rib", 0.92f, 0.88f, 0.82f, ashlar),
        .marble = paint(stage, "marble", 1, 1, 1, marble),
        .moulding = paint(stage, "moulding", 0.98f, 0.93f, 0.84f, marble),
        .vault = paint(stage, "vault", 1.0f, 0.99f, 0.96f, plaster),
        .inlay = paint(stage, "inlay", 1, 1, 1, texture[LW_BUILTIN_TEXTURE_INLAY]),
        .meander = paint(stage, "meander", 1, 1, 1, texture[LW_BUILTIN_TEXTURE_MEANDER]),
        .tiles = paint(stage, "tiles", 1, 1, 1, texture[LW_BUILTIN_TEXTURE_TILES]),
        .step = paint(stage, "step", 0.93f, 0.91f, 0.88f, marble),
        .wood = paint(stage, "wood", 1, 1, 1, texture[LW_BUILTIN_TEXTURE_WOOD]),
        .roof = paint(stage, "roof", 1, 1, 1, texture[LW_BUILTIN_TEXTURE_ROOF_TILES]),
        .water = paint(stage, "water", 0.07f, 0.24f, 0.27f, none),
        .soil = paint(stage, "soil", 0.10f, 0.07f, 0.05f, none),
        .clay = paint(stage, "clay", 0.62f, 0.33f, 0.21f, plaster),
        .pottery = paint(stage, "pottery", 1, 1, 1, texture[LW_BUILTIN_TEXTURE_POTTERY]),
        .glaze = paint(stage, "glaze", 0.16f, 0.42f, 0.50f, plaster),
        .red = paint(stage, "red cloth", 1, 1, 1, texture[LW_BUILTIN_TEXTURE_RED_CLOTH]),
        .blue = paint(stage, "blue cloth", 1, 1, 1, texture[LW_BUILTIN_TEXTURE_BLUE_CLOTH]),
        .green = paint(stage, "green cloth", 1, 1, 1, texture[LW_BUILTIN_TEXTURE_GREEN_CLOTH]),
        .frond = paint(stage, "frond", 1, 1, 1, texture[LW_BUILTIN_TEXTURE_FROND]),
        .leaf = paint(stage, "leaf", 1, 1, 1, texture[LW_BUILTIN_TEXTURE_LEAF]),
        .brass = paint(stage, "brass", 0.58f, 0.40f, 0.16f, none),
        .bronze = paint(stage, "bronze", 0.52f, 0.32f, 0.15f, none),
        .lamp = paint(stage, "lamp", 0.7f, 0.7f, 0.7f, none),
        .lantern = paint(stage, "lantern", 0.7f, 0.7f, 0.7f, none),
    };
    set_sheet(stage, p.red, LW_ALPHA_OPAQUE);
    set_sheet(stage, p.blue, LW_ALPHA_OPAQUE);
    set_sheet(stage, p.green, LW_ALPHA_OPAQUE);
    set_sheet(stage, p.frond, LW_ALPHA_MASK);
    set_sheet(stage, p.leaf, LW_ALPHA_MASK);
    lw_builtin_stage_emission(stage, p.lamp, lamp_radiance);
    lw_builtin_stage_emission(stage, p.lantern, lantern_radiance);
    return p;
}

/* Without a relief a surface is smooth but for its roughness. */
#define SMOOTH LW_BUILTIN_RELIEF_COUNT

/** The finish of a material. Its roughness is times the relief's. specular and ior belong to a dielectric's
 * gloss. scale is the normal map's. */
struct polish {
    uint32_t material;
    enum lw_builtin_relief_kind relief;
    float metalness, roughness, specular, ior, scale;
};

static struct lw_texture_use use_texture(uint32_t texture) {
    return (struct lw_texture_use){.texture = texture, .transform = {1, 0, 0, 0, 1, 0}};
}

static void polish(struct lw_builtin_stage *stage, const struct polish *how,
                   struct lw_builtin_relief relief) {
    const struct lw_finish finish = {
        .metalness = how->metalness,
        .roughness = how->roughness,
        .surface_texture = use_texture(relief.surface),
        .specular = how->specular,
        .specular_colour = {1, 1, 1},
        .specular_texture = use_texture(LW_SCENE_NONE),
        .ior = how->ior,
        .occlusion = relief.surface == LW_SCENE_NONE ? 0 : 1,
        .occlusion_texture = use_texture(relief.surface),
        .normal_scale = how->scale,
        .normal_texture = use_texture(relief.normal),
    };
    lw_builtin_stage_gloss(stage, how->material, &finish);
}

/* A metal mirrors by its base colour, which is darker in the matt form. */
static void set_metal(struct lw_builtin_stage *stage, uint32_t material, float r, float g, float b) {
    if (stage->failed) return;
    float *base = stage->scene->material[material].base_colour;
    base[0] = r, base[1] = g, base[2] = b;
}

static void polish_palette(struct lw_builtin_stage *stage, const struct palette *p) {
    const struct polish polishes[] = {
        {p->plaster, LW_BUILTIN_RELIEF_PLASTER, 0, 0.94f, 0.6f, 1.5f, 1},
        {p->vault, LW_BUILTIN_RELIEF_PLASTER, 0, 0.94f, 0.6f, 1.5f, 1},
        {p->dado, LW_BUILTIN_RELIEF_PLASTER, 0, 0.36f, 1, 1.5f, 0.35f}, /* stucco, rubbed with wax */
        {p->upper_dado, LW_BUILTIN_RELIEF_PLASTER, 0, 0.36f, 1, 1.5f, 0.35f},
        {p->clay, LW_BUILTIN_RELIEF_PLASTER, 0, 0.86f, 0.8f, 1.5f, 1.4f},
        {p->ashlar, LW_BUILTIN_RELIEF_ASHLAR, 0, 0.86f, 0.8f, 1.5f, 1},
        {p->rib, LW_BUILTIN_RELIEF_ASHLAR, 0, 0.80f, 0.8f, 1.5f, 0.8f},
        {p->marble, LW_BUILTIN_RELIEF_MARBLE, 0, 1, 1, 1.5f, 1},
        {p->moulding, LW_BUILTIN_RELIEF_MARBLE, 0, 1, 1, 1.5f, 1},
        {p->step, LW_BUILTIN_RELIEF_MARBLE, 0, 1, 1, 1.5f, 1},
        {p->inlay, LW_BUILTIN_RELIEF_INLAY, 0, 1, 1, 1.5f, 1},
        {p->meander, LW_BUILTIN_RELIEF_MEANDER, 0, 1, 1, 1.5f, 1},
        {p->tiles, LW_BUILTIN_RELIEF_TILES, 0, 1, 1, 1.52f, 1},
        {p->wood, LW_BUILTIN_RELIEF_WOOD, 0, 0.58f, 0.8f, 1.5f, 1},
        {p->roof, LW_BUILTIN_RELIEF_ROOF, 0, 0.85f, 0.8f, 1.5f, 1},
        {p->pottery, LW_BUILTIN_RELIEF_POTTERY, 0, 1, 1, 1.5f, 1},
        {p->glaze, SMOOTH, 0, 0.10f, 1, 1.52f, 1},
        {p->water, LW_BUILTIN_RELIEF_RIPPLES, 0, 0.04f, 1, 1.33f, 1},
        {p->soil, SMOOTH, 0, 0.98f, 0.4f, 1.5f, 1},
        {p->red, LW_BUILTIN_RELIEF_WEAVE, 0, 0.90f, 0.35f, 1.5f, 1},
        {p->blue, LW_BUILTIN_RELIEF_WEAVE, 0, 0.90f, 0.35f, 1.5f, 1},
        {p->green, LW_BUILTIN_RELIEF_WEAVE, 0, 0.90f, 0.35f, 1.5f, 1},
        {p->frond, SMOOTH, 0, 0.48f, 0.9f, 1.45f, 1},
        {p->leaf, SMOOTH, 0, 0.38f, 0.9f, 1.45f, 1},
        {p->brass, LW_BUILTIN_RELIEF_BRONZE, 1, 0.80f, 1, 1.5f, 0.5f},
        {p->bronze, LW_BUILTIN_RELIEF_BRONZE, 1, 1, 1, 1.5f, 1},
    };
    struct lw_builtin_relief relief[LW_BUILTIN_RELIEF_COUNT + 1];
    for (unsigned i = 0; i < LW_BUILTIN_RELIEF_COUNT; i++)
        relief[i] = lw_builtin_texture_add_relief(stage, (enum lw_builtin_relief_kind)i);
    relief[SMOOTH] = (struct lw_builtin_relief){LW_SCENE_NONE, LW_SCENE_NONE};
    for (unsigned i = 0; i < sizeof polishes / sizeof *polishes; i++)
        polish(stage, &polishes[i], relief[polishes[i].relief]);
    set_metal(stage, p->brass, 0.86f, 0.68f, 0.34f);
    set_metal(stage, p->bronze, 0.74f, 0.50f, 0.29f);
}

static void in_space(struct lw_builtin_mesh *mesh, uint32_t material, float metres) {
    lw_builtin_mesh_use(mesh, material, LW_BUILTIN_UV_SPACE, metres);
}
static void along(struct lw_builtin_mesh *mesh, uint32_t material, float metres) {
    lw_builtin_mesh_use(mesh, material, LW_BUILTIN_UV_SURFACE, metres);
}
static void fitted(struct lw_builtin_mesh *mesh, uint32_t material) {
    lw_builtin_mesh_use(mesh, material, LW_BUILTIN_UV_FIT, 1.0f);
}

static void place_mesh(struct lw_builtin_mesh *mesh, float x, float y, float z, float angle) {
    lw_builtin_mesh_place(mesh, lw_vec3(x, y, z), angle, lw_vec3(1, 1, 1));
}

/** Closes the mesh as an object that stands at a point. Returns its node. */
static uint32_t add_object_at(struct lw_builtin_stage *stage, struct lw_builtin_mesh *mesh, const char *name,
                              struct lw_vec3 position) {
    uint32_t node = lw_builtin_stage_node(stage, name, LW_SCENE_NONE, position);
    lw_builtin_stage_object(stage, name, mesh, node);
    return node;
}
static void add_object(struct lw_builtin_stage *stage, struct lw_builtin_mesh *mesh, const char *name) {
    add_object_at(stage, mesh, name, lw_vec3(0, 0, 0));
}

static void build_house(struct lw_builtin_stage *stage, struct lw_builtin_mesh *mesh,
                        const struct palette *p) {
    const float border = 0.62f;
    in_space(mesh, p->inlay, 2.0f);
    lw_builtin_house_court_floor(mesh, border);
    along(mesh, p->meander, 4.0f * border);
    mesh->uv_repeat = 1.0f / border; /* one band high; the texture is four times as long */
    lw_builtin_house_court_border(mesh, border);
    in_space(mesh, p->tiles, 1.6f);
    lw_builtin_house_lower_floor(mesh);
    in_space(mesh, p->step, 2.0f);
    lw_builtin_house_step(mesh);
    add_object(stage, mesh, "floor");

    in_space(mesh, p->plaster, 4.0f);
    lw_builtin_house_walls(mesh);
    in_space(mesh, p->dado, 3.0f);
    lw_builtin_house_dado(mesh, 0);
    in_space(mesh, p->upper_dado, 3.0f);
    lw_builtin_house_dado(mesh, LW_HOUSE_UPPER_FLOOR);
    in_space(mesh, p->rib, 1.8f);
    lw_builtin_house_pilasters(mesh);
    add_object(stage, mesh, "walls");

    along(mesh, p->marble, 2.4f);
    lw_builtin_house_columns(mesh, 0, LW_HOUSE_LOWER_SPRING, 0.28f);
    add_object(stage, mesh, "lower columns");
    along(mesh, p->marble, 2.4f);
    lw_builtin_house_columns(mesh, LW_HOUSE_UPPER_FLOOR + LW_HOUSE_PEDESTAL,
                             LW_HOUSE_UPPER_SPRING - LW_HOUSE_UPPER_FLOOR - LW_HOUSE_PEDESTAL, 0.22f);
    add_object(stage, mesh, "upper columns");

    in_space(mesh, p->ashlar, 1.5f);
    lw_builtin_house_arcade(mesh, false);
    add_object(stage, mesh, "lower arcade");
    in_space(mesh, p->ashlar, 1.5f);
    lw_builtin_house_arcade(mesh, true);
    add_object(stage, mesh, "upper arcade");
    along(mesh, p->moulding, 2.0f);
    lw_builtin_house_archivolts(mesh, false);
    lw_builtin_house_archivolts(mesh, true);
    lw_builtin_house_cornices(mesh);
    add_object(stage, mesh, "mouldings");

    in_space(mesh, p->vault, 4.0f);
    lw_builtin_house_vaults(mesh);
    along(mesh, p->rib, 1.5f);
    lw_builtin_house_ribs(mesh);
    add_object(stage, mesh, "vaults");
    in_space(mesh, p->tiles, 1.6f);
    lw_builtin_house_upper_floor(mesh);
    add_object(stage, mesh, "upper floor");
    in_space(mesh, p->wood, 1.0f);
    lw_builtin_house_timber(mesh);
    add_object(stage, mesh, "timber ceiling");
    along(mesh, p->marble, 2.0f);
    lw_builtin_house_balustrade(mesh);
    add_object(stage, mesh, "balustrade");
    along(mesh, p->roof, 1.0f);
    lw_builtin_house_roof(mesh);
    add_object(stage, mesh, "roof");
}

static void build_vases(struct lw_builtin_stage *stage, struct lw_builtin_mesh *mesh,
                        const struct palette *p) {
    fitted(mesh, p->pottery);
    lw_builtin_furnish_vase(mesh, LW_BUILTIN_AMPHORA, 1.15f);
    add_object_at(stage, mesh, "amphora", lw_vec3(-5.05f, 0, 5.72f));
    fitted(mesh, p->marble);
    lw_builtin_furnish_vase(mesh, LW_BUILTIN_KRATER, 0.95f);
    add_object_at(stage, mesh, "krater", lw_vec3(-7.5f, 0, -5.75f));
    fitted(mesh, p->glaze);
    lw_builtin_furnish_vase(mesh, LW_BUILTIN_JAR, 0.72f);
    add_object_at(stage, mesh, "jar", lw_vec3(2.25f, 0, -5.65f));
}

static void hang_cloth(struct lw_builtin_mesh *mesh, float x, float side, float front, float phase) {
    const struct lw_builtin_cloth cloth = {.width = 2.15f,
                                           .behind = 0.75f,
                                           .front = front,
                                           .clear = 0.60f,
                                           .clear_below = 0.55f,
                                           .phase = phase};
    place_mesh(mesh, x, LW_HOUSE_UPPER_FLOOR + LW_HOUSE_PEDESTAL + 0.01f, side * LW_HOUSE_HALF_Z,
               side > 0 ? LW_PI : 0);
    lw_builtin_furnish_cloth(mesh, &cloth);
}

static void build_cloths(struct lw_builtin_stage *stage, struct lw_builtin_mesh *mesh,
                         const struct palette *p) {
    fitted(mesh, p->red);
    hang_cloth(mesh, -1.5f, -1, 3.5f, 0.3f);
    hang_cloth(mesh, -4.5f, 1, 3.3f, 1.9f);
    add_object(stage, mesh, "red cloth");
    fitted(mesh, p->blue);
    hang_cloth(mesh, 4.5f, -1, 3.4f, 2.2f);
    hang_cloth(mesh, 1.5f, 1, 3.5f, 4.1f);
    add_object(stage, mesh, "blue cloth");
    fitted(mesh, p->green);
    hang_cloth(mesh, -7.5f, -1, 3.4f, 5.1f);
    hang_cloth(mesh, 7.5f, 1, 3.4f, 3.0f);
    add_object(stage, mesh, "green cloth");
}

static void build_plants(struct lw_builtin_stage *stage, struct lw_builtin_mesh *mesh,
                         const struct palette *p) {
    static const struct {
        float x, y, z, pot, plant;
        bool palm;
    } plants[] = {
        {10.2f, LW_HOUSE_COURT_Y, -4.2f, 0.70f, 1.75f, true},
        {10.2f, LW_HOUSE_COURT_Y, 4.2f, 0.70f, 1.65f, true},
        {-9.6f, LW_HOUSE_COURT_Y, -4.3f, 0.62f, 1.55f, true},
        {-3.3f, LW_HOUSE_COURT_Y, 4.55f, 0.66f, 1.60f, true},
        {-4.15f, 0, 5.75f, 0.42f, 0.95f, false},
        {4.5f, 0, -5.75f, 0.46f, 1.0f, false},
        {5.4f, LW_HOUSE_COURT_Y, 4.5f, 0.5f, 1.05f, false},
    };
    const uint32_t count = sizeof plants / sizeof *plants;
    for (uint32_t i = 0; i < count; i++) {
        float soil_y = plants[i].y + 0.86f * plants[i].pot;
        place_mesh(mesh, plants[i].x, plants[i].y, plants[i].z, (float)i);
        along(mesh, p->clay, 1.5f);
        lw_builtin_furnish_vase(mesh, LW_BUILTIN_POT, plants[i].pot);
        along(mesh, p->soil, 1.0f);
        lw_builtin_furnish_soil(mesh, plants[i].pot);
        place_mesh(mesh, plants[i].x, soil_y, plants[i].z, (float)i);
        fitted(mesh, plants[i].palm ? p->frond : p->leaf);
        if (plants[i].palm)
            lw_builtin_furnish_palm(mesh, plants[i].plant, 18, i);
        else
            lw_builtin_furnish_bush(mesh, plants[i].plant, 34, i);
    }
    add_object(stage, mesh, "plants");
}

static void build_basin(struct lw_builtin_stage *stage, struct lw_builtin_mesh *mesh,
                        const struct palette *p) {
    place_mesh(mesh, 0, LW_HOUSE_COURT_Y, 0, 0);
    along(mesh, p->moulding, 1.6f);
    lw_builtin_furnish_basin(mesh);
    if (p->is_matt)
        along(mesh, p->water, 1.0f);
    else
        in_space(mesh, p->water, 1.0f); /* no seam in the ripples */
    lw_builtin_furnish_water(mesh);
    add_object(stage, mesh, "basin");
}

static uint32_t build_lamp(struct lw_builtin_stage *stage, struct lw_builtin_mesh *mesh, const char *name,
                           uint32_t metal, uint32_t glow, float radius, float chain,
                           struct lw_vec3 position) {
    along(mesh, metal, 1.0f);
    lw_builtin_furnish_lamp(mesh, radius, chain);
    along(mesh, glow, 1.0f);
    lw_builtin_furnish_globe(mesh, radius, 12);
    return add_object_at(stage, mesh, name, position);
}

/* ---- animation ---- */

/** A closed smooth path, centre + amplitude * sin(turns * 2 pi t / LOOP_S + phase) per axis, as cubic keys:
 * Hermite tangents are the derivative, so the loop closes with its speed. */
struct path {
    float centre[3], amplitude[3], turns[3], phase[3];
};

static void move_along(struct lw_builtin_stage *stage, uint32_t node, const struct path *path) {
    enum { KEYS = 17 };
    float *value =
        lw_builtin_stage_channel(stage, node, LW_CHANNEL_TRANSLATION, LW_INTERPOLATION_CUBIC, KEYS, LOOP_S);
    for (int k = 0; k < KEYS && value; k++, value += 9)
        for (int axis = 0; axis < 3; axis++) {
            float speed = 2.0f * LW_PI * path->turns[axis] / LOOP_S;
            float angle = 2.0f * LW_PI * path->turns[axis] * (float)(k % (KEYS - 1)) / (float)(KEYS - 1) +
                          path->phase[axis];
            value[axis] = value[6 + axis] = path->amplitude[axis] * speed * cosf(angle);
            value[3 + axis] = path->centre[axis] + path->amplitude[axis] * sinf(angle);
        }
}

/** One even turn per loop about an axis that leans by `lean` radians from +Y towards +X. */
static void turn_about(struct lw_builtin_stage *stage, uint32_t node, float lean) {
    enum { KEYS = 17 };
    float *value =
        lw_builtin_stage_channel(stage, node, LW_CHANNEL_ROTATION, LW_INTERPOLATION_LINEAR, KEYS, LOOP_S);
    float lean_cos = cosf(-0.5f * lean), lean_sin = sinf(-0.5f * lean);
    for (int k = 0; k < KEYS && value; k++, value += 4) {
        float half = LW_PI * (float)k / (float)(KEYS - 1), c = cosf(half), s = sinf(half);
        /* lean about Z after a spin about Y */
        value[0] = -lean_sin * s;
        value[1] = lean_cos * s;
        value[2] = lean_sin * c;
        value[3] = lean_cos * c;
    }
}

static void build_lamps_and_rings(struct lw_builtin_stage *stage, struct lw_builtin_mesh *mesh,
                                  const struct palette *p) {
    float height = 2.75f, radius = 0.17f, crown = LW_HOUSE_LOWER_SPRING + 1.42f;
    build_lamp(stage, mesh, "hanging lamp", p->brass, p->lamp, radius, crown - height - 2.4f * radius,
               lw_vec3(1.5f, height, 7.65f));
    const struct path walk = {.centre = {-2.0f, 1.55f, 7.55f},
                              .amplitude = {7.0f, 0.04f, 0.35f},
                              .turns = {1, 8, 2},
                              .phase = {0.9f, 0, 0}};
    uint32_t lantern = build_lamp(stage, mesh, "lantern", p->brass, p->lantern, 0.11f, 0,
                                  lw_vec3(walk.centre[0], walk.centre[1], walk.centre[2]));
    move_along(stage, lantern, &walk);

    const struct path wander = {.centre = {0, 2.65f, 0},
                                .amplitude = {1.1f, 0.14f, 0.6f},
                                .turns = {1, 2, 1},
                                .phase = {0, 0, 0.5f * LW_PI}};
    along(mesh, p->bronze, 1.0f);
    lw_builtin_furnish_armillary(mesh, 0.75f);
    uint32_t rings = add_object_at(stage, mesh, "armillary",
                                   lw_vec3(wander.centre[0], wander.centre[1], wander.centre[2]));
    move_along(stage, rings, &wander);
    turn_about(stage, rings, 0.41f);
}

static enum lw_status build(bool is_matt, struct lw_scene **out_scene, struct lw_error *err) {
    struct lw_builtin_stage stage;
    struct lw_builtin_mesh mesh;
    if (lw_builtin_stage_init(&stage, "atrium") != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory while building a scene");
    lw_builtin_mesh_init(&mesh);
    struct palette palette = mix_palette(&stage);
    palette.is_matt = is_matt;
    if (!is_matt) polish_palette(&stage, &palette);
    build_house(&stage, &mesh, &palette);
    build_basin(&stage, &mesh, &palette);
    build_vases(&stage, &mesh, &palette);
    build_cloths(&stage, &mesh, &palette);
    build_plants(&stage, &mesh, &palette);
    build_lamps_and_rings(&stage, &mesh, &palette);
    lw_builtin_mesh_finish(&mesh);

    lw_builtin_stage_sun(&stage, "sun", sun_direction, sun_irradiance, SUN_ANGULAR_DIAMETER);
    for (int i = 0; i < 3; i++) stage.scene->sky[i] = sky_radiance[i];
    lw_builtin_stage_camera(&stage, "main", lw_vec3(-11.2f, 1.75f, 1.5f), lw_vec3(0, 2.6f, 0.1f), 58.0f);
    lw_builtin_stage_camera(&stage, "gallery", lw_vec3(-11.25f, 7.0f, -4.75f), lw_vec3(1.0f, 2.6f, 1.1f),
                            58.0f);
    lw_builtin_stage_camera(&stage, "vase", lw_vec3(-7.3f, 1.25f, 3.6f), lw_vec3(-4.6f, 0.85f, 5.8f), 42.0f);
    lw_builtin_stage_camera(&stage, "lamp", lw_vec3(-4.0f, 1.65f, 7.9f), lw_vec3(1.8f, 2.35f, 6.9f), 55.0f);
    return lw_builtin_stage_finish(&stage, out_scene, err);
}

enum lw_status lw_builtin_atrium_build(struct lw_scene **out_scene, struct lw_error *err) {
    return build(false, out_scene, err);
}
enum lw_status lw_builtin_atrium_matt_build(struct lw_scene **out_scene, struct lw_error *err) {
    return build(true, out_scene, err);
}
