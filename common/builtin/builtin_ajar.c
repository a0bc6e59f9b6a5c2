#include "common/builtin/builtin_scenes.h"
#include "common/builtin/builtin_stage.h"

/* Two rooms and a door between them that stands ajar, after Veach 1997, figure 11.2: the lamp hangs in the
 * room beyond, and all light of this one comes through the gap. The room is 4 m wide and 2.5 m high; the door
 * is in its back wall. */
#define HALF_X   2.0f
#define HEIGHT   2.5f
#define DEPTH    4.0f /* each room's, from the wall between them */
#define WALL_M   0.1f
#define DOOR_X   0.5f /* half its width */
#define DOOR_Y   2.0f
#define DOOR_M   0.04f /* its thickness */
#define AJAR     0.35f /* radians */
#define PLINTH_M 0.5f

/* Radiance of the lamp, W/(m^2 sr). Its front is the floor's side; it hangs below the ceiling. */
static const float lamp_radiance[3] = {120.0f, 105.0f, 80.0f};
#define LAMP_M     0.8f
#define LAMP_GAP_M 0.005f

static void keep(struct lw_builtin_stage *stage, const char *name, struct lw_builtin_mesh *mesh,
                 struct lw_vec3 position, float angle) {
    const uint32_t node = lw_builtin_stage_node(stage, name, LW_SCENE_NONE, position);
    lw_builtin_stage_turn(stage, node, angle);
    lw_builtin_stage_object(stage, name, mesh, node);
    lw_builtin_mesh_finish(mesh);
}

static void box(struct lw_builtin_stage *stage, const char *name, uint32_t material, struct lw_vec3 position,
                float angle, struct lw_vec3 low, struct lw_vec3 high, unsigned faces) {
    struct lw_builtin_mesh mesh;
    lw_builtin_mesh_init(&mesh);
    mesh.material = material;
    lw_builtin_mesh_box(&mesh, low, high, faces);
    keep(stage, name, &mesh, position, angle);
}

/* Floor, ceiling and three walls of a room from z = near to far; the fourth is the wall between. */
static void room(struct lw_builtin_stage *stage, const char *const name[5], uint32_t white, uint32_t floor,
                 uint32_t left, uint32_t right, float near, float far) {
    const float x = HALF_X, z0 = fminf(near, far), z1 = fmaxf(near, far);
    const struct lw_vec3 across = lw_vec3(2 * x, 0, 0), up = lw_vec3(0, HEIGHT, 0),
                         front = lw_vec3(0, 0, z1 - z0), back = lw_vec3(0, 0, z0 - z1);
    lw_builtin_stage_quad(stage, name[0], floor, lw_vec3(-x, 0, z1), across, back);
    lw_builtin_stage_quad(stage, name[1], white, lw_vec3(-x, HEIGHT, z0), across, front);
    lw_builtin_stage_quad(stage, name[2], left, lw_vec3(-x, 0, z1), back, up);
    lw_builtin_stage_quad(stage, name[3], right, lw_vec3(x, 0, z0), front, up);
    if (far > near)
        lw_builtin_stage_quad(stage, name[4], white, lw_vec3(x, 0, far), lw_vec3(-2 * x, 0, 0), up);
    else
        lw_builtin_stage_quad(stage, name[4], white, lw_vec3(-x, 0, far), across, up);
}

/* The wall between the rooms, with its hole: three boxes, in one mesh. */
static void wall_between(struct lw_builtin_stage *stage, uint32_t white) {
    struct lw_builtin_mesh mesh;
    lw_builtin_mesh_init(&mesh);
    mesh.material = white;
    const unsigned sides = LW_BUILTIN_FRONT | LW_BUILTIN_BACK;
    lw_builtin_mesh_box(&mesh, lw_vec3(-HALF_X, 0, -WALL_M), lw_vec3(-DOOR_X, HEIGHT, 0),
                        sides | LW_BUILTIN_RIGHT);
    lw_builtin_mesh_box(&mesh, lw_vec3(DOOR_X, 0, -WALL_M), lw_vec3(HALF_X, HEIGHT, 0),
                        sides | LW_BUILTIN_LEFT);
    lw_builtin_mesh_box(&mesh, lw_vec3(-DOOR_X, DOOR_Y, -WALL_M), lw_vec3(DOOR_X, HEIGHT, 0),
                        sides | LW_BUILTIN_BOTTOM);
    keep(stage, "wall", &mesh, lw_vec3(0, 0, 0), 0);
}

enum lw_status lw_builtin_ajar_build(struct lw_scene **out_scene, struct lw_error *err) {
    static const char *const here[5] = {"floor", "ceiling", "left wall", "right wall", "front wall"};
    static const char *const beyond[5] = {"far floor", "far ceiling", "far left wall", "far right wall",
                                          "far wall"};
    struct lw_builtin_stage stage;
    if (lw_builtin_stage_init(&stage, "ajar") != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory while building a scene");

    const uint32_t white =
        lw_builtin_stage_material(&stage, "white", lw_vec3(0.75f, 0.74f, 0.72f), LW_SCENE_NONE);
    const uint32_t wood =
        lw_builtin_stage_material(&stage, "wood", lw_vec3(0.40f, 0.26f, 0.15f), LW_SCENE_NONE);
    const uint32_t blue =
        lw_builtin_stage_material(&stage, "blue", lw_vec3(0.20f, 0.30f, 0.50f), LW_SCENE_NONE);
    const uint32_t ochre =
        lw_builtin_stage_material(&stage, "ochre", lw_vec3(0.60f, 0.45f, 0.20f), LW_SCENE_NONE);
    const uint32_t lamp =
        lw_builtin_stage_material(&stage, "lamp", lw_vec3(0.78f, 0.78f, 0.78f), LW_SCENE_NONE);
    lw_builtin_stage_emission(&stage, lamp, lamp_radiance);

    room(&stage, here, white, wood, blue, ochre, 0, DEPTH);
    room(&stage, beyond, white, wood, white, white, -WALL_M, -WALL_M - DEPTH);
    wall_between(&stage, white);
    lw_builtin_stage_quad(&stage, "sill", wood, lw_vec3(-DOOR_X, 0, 0), lw_vec3(2 * DOOR_X, 0, 0),
                          lw_vec3(0, 0, -WALL_M));
    /* Hinged at the hole's left, its edge within the wall; it opens into this room. */
    box(&stage, "door", wood, lw_vec3(-DOOR_X - 0.005f, 0, -0.002f), -AJAR, lw_vec3(0, 0, 0),
        lw_vec3(2 * DOOR_X, DOOR_Y + 0.01f, DOOR_M), LW_BUILTIN_ALL & ~LW_BUILTIN_BOTTOM);
    box(&stage, "plinth", white, lw_vec3(-0.9f, 0, 1.3f), 0.4f, lw_vec3(-PLINTH_M / 2, 0, -PLINTH_M / 2),
        lw_vec3(PLINTH_M / 2, 0.9f, PLINTH_M / 2), LW_BUILTIN_ALL & ~LW_BUILTIN_BOTTOM);
    box(&stage, "stool", ochre, lw_vec3(0.9f, 0, 1.0f), -0.3f, lw_vec3(-0.25f, 0, -0.25f),
        lw_vec3(0.25f, 0.45f, 0.25f), LW_BUILTIN_ALL & ~LW_BUILTIN_BOTTOM);
    /* Behind the wall, where the door hides it from all of this room. */
    lw_builtin_stage_quad(&stage, "lamp", lamp, lw_vec3(0.9f, HEIGHT - LAMP_GAP_M, -WALL_M - 1.6f),
                          lw_vec3(LAMP_M, 0, 0), lw_vec3(0, 0, LAMP_M));

    lw_builtin_stage_camera(&stage, "main", lw_vec3(0.3f, 1.35f, DEPTH - 0.15f), lw_vec3(-0.1f, 1.05f, 0),
                            62.0f);
    return lw_builtin_stage_finish(&stage, out_scene, err);
}
