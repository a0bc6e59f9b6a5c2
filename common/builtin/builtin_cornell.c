#include "common/builtin/builtin_scenes.h"
#include "common/builtin/builtin_stage.h"

/* The box of Goral et al. 1984 in the proportions that Cornell measured (width 0.556, height 0.5488, depth
 * 0.5592 m; https://www.graphics.cornell.edu/online/box/data.html), 3.6 times as large: about two metres. Its
 * open front is at +Z, its middle over the origin. */
#define SCALE  3.6f
#define WIDTH  (0.556f * SCALE)
#define HEIGHT (0.5488f * SCALE)
#define DEPTH  (0.5592f * SCALE)

/* Radiance of the lamp, W/(m^2 sr); it hangs this far below the ceiling, so that no two surfaces coincide. */
static const float lamp_radiance[3] = {17.0f, 12.0f, 4.0f};
#define LAMP_GAP_M 0.005f
#define LAMP_WIDTH (0.13f * SCALE)
#define LAMP_DEPTH (0.105f * SCALE)

static void block(struct lw_builtin_stage *stage, const char *name, uint32_t material,
                  struct lw_vec3 position, float angle, float side, float height) {
    struct lw_builtin_mesh mesh;
    lw_builtin_mesh_init(&mesh);
    mesh.material = material;
    lw_builtin_mesh_place(&mesh, lw_vec3(0, 0, 0), angle, lw_vec3(1, 1, 1));
    lw_builtin_mesh_box(&mesh, lw_vec3(-side / 2, 0, -side / 2), lw_vec3(side / 2, height, side / 2),
                        LW_BUILTIN_ALL & ~LW_BUILTIN_BOTTOM);
    lw_builtin_stage_object(stage, name, &mesh, lw_builtin_stage_node(stage, name, LW_SCENE_NONE, position));
    lw_builtin_mesh_finish(&mesh);
}

enum lw_status lw_builtin_cornell_build(struct lw_scene **out_scene, struct lw_error *err) {
    struct lw_builtin_stage stage;
    if (lw_builtin_stage_init(&stage, "cornell") != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory while building a scene");

    /* linear sRGB of the measured paints under an equal-energy light, rounded */
    uint32_t white = lw_builtin_stage_material(&stage, "white", lw_vec3(0.73f, 0.73f, 0.73f), LW_SCENE_NONE);
    uint32_t red = lw_builtin_stage_material(&stage, "red", lw_vec3(0.63f, 0.065f, 0.05f), LW_SCENE_NONE);
    uint32_t green = lw_builtin_stage_material(&stage, "green", lw_vec3(0.14f, 0.45f, 0.091f), LW_SCENE_NONE);
    uint32_t lamp = lw_builtin_stage_material(&stage, "lamp", lw_vec3(0.78f, 0.78f, 0.78f), LW_SCENE_NONE);
    lw_builtin_stage_emission(&stage, lamp, lamp_radiance);

    float x = WIDTH / 2, z = DEPTH / 2;
    struct lw_vec3 right = lw_vec3(WIDTH, 0, 0), up = lw_vec3(0, HEIGHT, 0), front = lw_vec3(0, 0, DEPTH),
                   back = lw_vec3(0, 0, -DEPTH);
    lw_builtin_stage_quad(&stage, "floor", white, lw_vec3(-x, 0, z), right, back);
    lw_builtin_stage_quad(&stage, "ceiling", white, lw_vec3(-x, HEIGHT, -z), right, front);
    lw_builtin_stage_quad(&stage, "back wall", white, lw_vec3(-x, 0, -z), right, up);
    lw_builtin_stage_quad(&stage, "left wall", red, lw_vec3(-x, 0, z), back, up);
    lw_builtin_stage_quad(&stage, "right wall", green, lw_vec3(x, 0, -z), front, up);
    block(&stage, "short block", white, lw_vec3(0.0925f * SCALE, 0, 0.111f * SCALE), 0.29f, 0.165f * SCALE,
          0.165f * SCALE);
    block(&stage, "tall block", white, lw_vec3(-0.0905f * SCALE, 0, -0.0715f * SCALE), -0.31f, 0.165f * SCALE,
          0.33f * SCALE);
    lw_builtin_stage_quad(&stage, "lamp", lamp,
                          lw_vec3(-LAMP_WIDTH / 2, HEIGHT - LAMP_GAP_M, -LAMP_DEPTH / 2),
                          lw_vec3(LAMP_WIDTH, 0, 0), lw_vec3(0, 0, LAMP_DEPTH));

    /* far back and narrow, as in the measured photograph */
    lw_builtin_stage_camera(&stage, "main", lw_vec3(0, HEIGHT / 2, z + 0.8f * SCALE),
                            lw_vec3(0, HEIGHT / 2, 0), 38.0f);
    return lw_builtin_stage_finish(&stage, out_scene, err);
}
