/* The picture by OpenGL against the composer's, from the same light. */
#include "tests/reference/gl_case.h"
#include "tests/support/process.h"

#include "client/camera/camera.h"
#include "common/base/random.h"
#include "common/light/direction_form.h"
#include "common/lightmap/lightmap.h"
#include "common/shading/tangent.h"

#include <stdlib.h>
#include <string.h>

/* Light comes mostly from one side, here more and there less; on some texels that is not known. */
static void fill_directions(struct gl_case_world *w) {
    w->direction = calloc((size_t)w->scene->object_count * LW_ATLAS_LEVELS_MAX, sizeof *w->direction);
    assert_non_null(w->direction);
    for (uint32_t o = 0; o < w->scene->object_count; o++)
        for (uint32_t k = 0; k < w->map.atlas[o]->level_count; k++) {
            const struct lw_atlas_level *l = &w->map.atlas[o]->level[k];
            float *xyz = calloc((size_t)l->width * l->height * 3, sizeof *xyz);
            assert_non_null(xyz);
            w->direction[o * LW_ATLAS_LEVELS_MAX + k] = xyz;
            for (uint32_t y = 0; o % 4 && y < l->height; y++)
                for (uint32_t x = 0; x < l->width; x++) {
                    const float turn = 0.1f * ((float)x + 0.5f) * (float)(1u << k) + (float)o;
                    float *at = xyz + 3 * ((size_t)y * l->width + x);
                    at[0] = 0.5f * cosf(turn), at[1] = 0.7f, at[2] = 0.5f * sinf(turn);
                }
        }
    for (uint32_t t = 0; t < w->map.tile_count; t++) w->tile[t].direction_version = 1;
}

/* The scene from a camera, or its own, with levels that can be told apart. */
static void test_same_picture(const char *name, const char *camera) {
    struct gl_case_world w;
    struct lw_error err = {0};
    gl_case_start(&w, gl_case_open_scene(name), 0.5f, 1);
    if (camera) lw_support_ok(lw_camera_parse(camera, &w.view.camera, &err), &err);
    gl_case_draw(&w);
    gl_case_compare(name, &w);
    gl_case_world_finish(&w);
}

static void test_drawn(const char *name, const char *camera, float scale) {
    struct gl_case_world w;
    struct lw_error err = {0};
    gl_case_start_drawn(&w, name, scale);
    if (camera) lw_support_ok(lw_camera_parse(camera, &w.view.camera, &err), &err);
    gl_case_draw(&w);
    gl_case_compare(name, &w);
    const uint64_t maps = lw_gl_renderer_figures(w.renderer).maps_drawn;
    gl_case_take_and_draw(&w, 1); /* nothing has moved */
    assert_int_equal(lw_gl_renderer_figures(w.renderer).maps_drawn, maps);
    assert_true(maps > 0);
    gl_case_world_finish(&w);
}

static void test_drawn_atrium(void **state) {
    (void)state;
    test_drawn(lw_process_atrium(), NULL, 1);
}

static void test_drawn_cornell(void **state) {
    (void)state;
    test_drawn("builtin:cornell", NULL, 0.02f);
    test_drawn("builtin:cornell", "0.3,1.2,3.4:0,0.8,0:2.6m", 0.02f);
}

static void test_drawn_sponza(void **state) {
    (void)state;
    test_drawn(lw_support_scene("sponza/Sponza_lit.gltf"), "-8,1.8,-0.3:5,4,-0.3:75", 500);
}

static void test_atrium(void **state) {
    (void)state;
    test_same_picture(lw_process_atrium(), NULL);
}

/* Light that is noisy here and lacks there; of every object the coarsest level has arrived. */
static void test_part_of_the_light(void **state) {
    (void)state;
    struct gl_case_world w;
    uint32_t lacking = 0;
    gl_case_start(&w, gl_case_open_scene("builtin:cornell"), 0.5f, 1);
    for (uint32_t t = 0; t < w.map.tile_count; t++) {
        const struct lw_tile_place *p = &w.map.place[t];
        const uint32_t number = t * 2654435761u >> 16;
        w.tile[t].error = (float)(number % 5) * 0.08f;
        w.tile[t].version = 1 + (number % 7 != 0);
        if (number % 3 == 0 && p->level + 1 < w.map.atlas[p->object]->level_count)
            w.tile[t].version = 0, lacking++;
    }
    print_message("%u of %u tiles lack\n", lacking, w.map.tile_count);
    assert_true(lacking > w.map.tile_count / 5);
    gl_case_draw(&w);
    gl_case_compare("builtin:cornell, part of the light", &w);
    gl_case_world_finish(&w);
}

static void test_cornell(void **state) {
    (void)state;
    test_same_picture("builtin:cornell", NULL);
    test_same_picture("builtin:cornell", "0.3,1.2,3.4:0,0.8,0:2.6m");
}

enum { REPEATED, MASKED, BLENDED, BACK, AWAY, MIRRORED, GLOWING, COLOURED, GLASS, UNLIT, TINTED, PANELS };

/* A square of each kind, facing up, three in a row; glass, an unlit and a tinted one hang over others. */
static struct lw_scene *panels(void) {
    struct lw_scene *scene = lw_support_squares(PANELS, 1);
    const struct lw_mesh mesh = scene->mesh[0];
    const struct lw_material material = scene->material[0];
    scene->mesh = lw_scene_alloc(scene, PANELS, sizeof *scene->mesh);
    scene->material = lw_scene_alloc(scene, PANELS, sizeof *scene->material);
    scene->texture = lw_scene_alloc(scene, 2, sizeof *scene->texture);
    scene->mesh_count = scene->material_count = PANELS;
    scene->texture_count = 2;
    uint8_t *rgba = lw_scene_alloc(scene, 16 * 16, 4);
    struct lw_vec2 *uv = lw_scene_alloc(scene, 4, sizeof *uv);
    struct lw_vec4 *colour = lw_scene_alloc(scene, 4, sizeof *colour);
    for (uint32_t i = 0; i < 16 * 16; i++) {
        const uint8_t texel[4] = {(uint8_t)(40 + 13 * (i % 16)), (uint8_t)(250 - 12 * (i / 16)),
                                  (uint8_t)(i % 16 > 7 ? 200 : 60), (uint8_t)(16 * (i % 16) + i / 16)};
        memcpy(rgba + 4ul * i, texel, 4);
    }
    for (int i = 0; i < 4; i++) {
        uv[i] = (struct lw_vec2){2.5f * mesh.uv[0][i].x - 0.5f, 1.5f * mesh.uv[0][i].y - 0.3f};
        colour[i] = (struct lw_vec4){i & 1 ? 1 : 0.2f, i & 2 ? 0.9f : 0.3f, 0.6f, 1};
    }
    for (uint32_t t = 0; t < 2; t++)
        scene->texture[t] = (struct lw_texture){.name = "",
                                                .width = 16,
                                                .height = 16,
                                                .rgba = rgba,
                                                .wrap_s = t ? LW_WRAP_CLAMP : LW_WRAP_REPEAT,
                                                .wrap_t = t ? LW_WRAP_MIRROR : LW_WRAP_REPEAT};
    for (uint32_t i = 0; i < PANELS; i++) {
        uint32_t *materials = lw_scene_alloc(scene, 2, sizeof *materials);
        materials[0] = materials[1] = i;
        scene->mesh[i] = mesh;
        scene->mesh[i].material = materials;
        scene->mesh[i].uv[1] = uv;
        scene->material[i] = material;
        scene->object[i].mesh = i;
        scene->node[i].translation[0] = 1.1f * (float)(i % 3) - 1.1f;
        scene->node[i].translation[2] = 1.1f * (float)(i / 3) - 1.1f;
    }
    struct lw_material *m = scene->material;
    static const float turned[6] = {1.6f, -1.2f, 0.3f, 1.2f, 1.6f, -0.7f};
    m[REPEATED].base_colour_texture.texture = 0;
    memcpy(m[REPEATED].base_colour_texture.transform, turned, sizeof turned);
    m[MASKED].base_colour_texture.texture = 0, m[MASKED].alpha_mode = LW_ALPHA_MASK;
    m[BLENDED].base_colour_texture.texture = 1, m[BLENDED].alpha_mode = LW_ALPHA_BLEND;
    m[BLENDED].base_colour_texture.uv_set = 1;
    m[BACK].double_sided = 1;
    m[GLOWING].emission_texture.texture = 1, m[GLOWING].emission_texture.uv_set = 1;
    for (int c = 0; c < 3; c++) m[GLOWING].emission[c] = 2;
    scene->mesh[COLOURED].colour = colour;
    m[GLASS].alpha_mode = LW_ALPHA_BLEND, m[GLASS].base_colour[3] = 0.4f;
    scene->node[BACK].scale[1] = scene->node[BACK].scale[0] = -1; /* half a turn about Z */
    scene->node[AWAY].scale[1] = scene->node[AWAY].scale[0] = -1;
    scene->node[MIRRORED].scale[0] = -1;
    scene->node[GLASS].translation[0] = 0.6f, scene->node[GLASS].translation[1] = 0.4f;
    scene->node[GLASS].translation[2] = -0.9f;
    m[UNLIT].unlit = 1, m[UNLIT].base_colour_texture.texture = 0;
    scene->mesh[UNLIT].colour = colour;
    scene->node[UNLIT].translation[0] = -0.8f, scene->node[UNLIT].translation[1] = 0.4f;
    scene->node[UNLIT].translation[2] = -0.9f;
    m[TINTED].alpha_mode = LW_ALPHA_BLEND, m[TINTED].base_colour[3] = 0.2f;
    m[TINTED].tint[0] = 0.5f, m[TINTED].tint[1] = 1.2f, m[TINTED].tint[2] = 0.1f;
    scene->node[TINTED].translation[0] = -1.2f, scene->node[TINTED].translation[1] = 0.5f;
    scene->node[TINTED].translation[2] = 0.6f;
    scene->sky[0] = 0.2f, scene->sky[2] = 0.5f;
    return scene;
}

static void test_panels(void **state) {
    (void)state;
    struct gl_case_world w;
    struct lw_error err = {0};
    struct lw_scene *scene = panels();
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 30}, NULL, &err),
                  &err);
    gl_case_start(&w, scene, 0.5f, 1);
    w.view.camera = lw_camera_look_at(lw_vec3(0.3f, 3, 2.2f), lw_vec3(0, 0, 0.1f), 1);
    gl_case_draw(&w);
    gl_case_compare("panels", &w);
    const float *centre =
        w.by_gl + 3ul * (PIXELS / 2 + WIDTH / 2); /* a back that is not there: the sky is seen */
    assert_true(fabsf(centre[0] - 0.2f) < 1e-4f && centre[1] < 1e-4f);
    const struct lw_camera_view perspective = w.view.camera;
    w.view.camera.height_m = 3.5f;
    gl_case_draw(&w);
    gl_case_compare("panels, orthographic", &w);
    w.view.camera = perspective;
    w.pose.object_hidden[REPEATED] = true; /* things that change */
    w.pose.object_to_world[COLOURED].m[1][3] = 0.3f;
    w.pose.object_dynamic[REPEATED] = w.pose.object_dynamic[COLOURED] = true;
    scene->material[MIRRORED].base_colour[0] = 0.9f;
    scene->material[COLOURED].emission[1] = 3;
    lw_support_ok(lw_trace_set_pose(w.trace, &w.pose, &err), &err);
    gl_case_draw(&w);
    gl_case_compare("panels, changed", &w);
    gl_case_world_finish(&w);
}

/* A finish map: waves of normals, or of roughness, metalness and occlusion, or of colours. */
static void add_map(struct lw_scene *scene, uint32_t at, uint8_t content) {
    enum { SIDE = 32 };
    uint8_t *rgba = lw_scene_alloc(scene, (size_t)SIDE * SIDE, 4);
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        const float u = 2 * LW_PI * (float)(i % SIDE) / SIDE, v = 2 * LW_PI * (float)(i / SIDE) / SIDE;
        const uint8_t texel[4] = {(uint8_t)(127.5f + 60 * sinf(u)), (uint8_t)(127.5f + 60 * sinf(2 * v)),
                                  (uint8_t)(127.5f + 120 * cosf(u + v)), (uint8_t)(200 + 50 * sinf(v))};
        memcpy(rgba + 4ul * i, texel, 4);
    }
    scene->finish_texture[at] = (struct lw_texture){.name = "",
                                                    .width = SIDE,
                                                    .height = SIDE,
                                                    .rgba = rgba,
                                                    .content = content,
                                                    .wrap_t = LW_WRAP_MIRROR};
}

static const struct lw_finish plain_finish = {.roughness = 0.3f,
                                              .specular = 1,
                                              .specular_colour = {1, 1, 1},
                                              .ior = 1.5f,
                                              .occlusion = 1,
                                              .normal_scale = 1,
                                              .surface_texture = {.texture = LW_SCENE_NONE},
                                              .specular_texture = {.texture = LW_SCENE_NONE},
                                              .occlusion_texture = {.texture = LW_SCENE_NONE},
                                              .normal_texture = {.texture = LW_SCENE_NONE}};

static void use_map(struct lw_texture_use *use, uint32_t map, uint32_t set, float times) {
    const float turned[6] = {times, 0.3f, 0.1f, -0.2f, times, 0.4f};
    *use = (struct lw_texture_use){.texture = map, .uv_set = set};
    memcpy(use->transform, turned, sizeof turned);
}

/* A ball of triangles in place of a mesh's square, with smooth normals. */
static void make_round(struct lw_scene *scene, struct lw_mesh *mesh) {
    enum { ROWS = 16, COLUMNS = 32, COUNT = (ROWS + 1) * (COLUMNS + 1) };
    struct lw_vec3 *position = lw_scene_alloc(scene, COUNT, sizeof *position),
                   *normal = lw_scene_alloc(scene, COUNT, sizeof *normal);
    struct lw_vec2 *uv = lw_scene_alloc(scene, COUNT, sizeof *uv);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, 2 * ROWS * COLUMNS, sizeof *triangle);
    uint32_t *material = lw_scene_alloc(scene, 2 * ROWS * COLUMNS, sizeof *material), count = 0;
    for (uint32_t i = 0; i < COUNT; i++) {
        const float u = (float)(i % (COLUMNS + 1)) / COLUMNS, v = (float)(i / (COLUMNS + 1)) / ROWS;
        const float phi = 2 * LW_PI * u, sine = sinf(LW_PI * v);
        normal[i] = lw_vec3(sine * cosf(phi), cosf(LW_PI * v), -sine * sinf(phi));
        position[i] = lw_vec3_scale(normal[i], 0.5f);
        uv[i] = (struct lw_vec2){u, v};
    }
    for (uint32_t j = 0; j < ROWS; j++)
        for (uint32_t i = 0; i < COLUMNS; i++) {
            const uint32_t a = j * (COLUMNS + 1) + i, b = a + COLUMNS + 1;
            const uint32_t corners[2][3] = {{a, b, b + 1}, {a, b + 1, a + 1}};
            for (uint32_t t = 0; t < 2; t++)
                if (t ? j > 0 : j + 1 < ROWS) {
                    material[count] = mesh->material[0];
                    memcpy(triangle[count++], corners[t], sizeof corners[t]);
                }
        }
    mesh->vertex_count = COUNT, mesh->triangle_count = count;
    mesh->position = position, mesh->normal = normal, mesh->material = material;
    mesh->triangle = (const uint32_t(*)[3])triangle;
    mesh->uv[0] = mesh->uv[1] = uv;
}

/* Tangents along X, or around a ball; every other triangle of a mesh of many mirrored. */
static void add_tangents(struct lw_scene *scene, struct lw_mesh *mesh) {
    uint16_t *tangent = lw_scene_alloc(scene, 3ul * mesh->triangle_count, sizeof *tangent);
    for (uint32_t c = 0; c < 3 * mesh->triangle_count; c++) {
        const struct lw_vec3 n = mesh->normal[mesh->triangle[c / 3][c % 3]];
        const struct lw_vec3 along =
            mesh->triangle_count > 2 ? lw_vec3_cross(lw_vec3(0, 1, 0), n) : lw_vec3(1, 0, 0);
        tangent[c] = lw_tangent_encode(n, along, mesh->triangle_count <= 2 && c / 3 % 2);
    }
    mesh->tangent = tangent;
}

/* The panels with finishes, two of them balls, under a lamp. */
static struct lw_scene *finished_panels(void) {
    struct lw_scene *scene = panels();
    scene->finish_texture = lw_scene_alloc(scene, 3, sizeof *scene->finish_texture);
    scene->finish_texture_count = 3;
    for (uint8_t k = 0; k < 3; k++)
        add_map(scene, k, (uint8_t[]){LW_CONTENT_SURFACE, LW_CONTENT_NORMAL, LW_CONTENT_COLOUR}[k]);
    struct lw_finish *finish = lw_scene_alloc(scene, PANELS, sizeof *finish);
    for (uint32_t i = 0; i < PANELS; i++) {
        finish[i] = plain_finish;
        if (i != UNLIT) scene->material[i].finish = &finish[i];
    }
    make_round(scene, &scene->mesh[MIRRORED]);
    make_round(scene, &scene->mesh[GLOWING]);
    for (uint32_t i = 0; i < PANELS; i++) add_tangents(scene, &scene->mesh[i]);
    use_map(&finish[REPEATED].surface_texture, 0, 0, 2), use_map(&finish[REPEATED].normal_texture, 1, 0, 2);
    use_map(&scene->material[REPEATED].base_colour_texture, /* where its finish is read, too */
            scene->material[REPEATED].base_colour_texture.texture, 0, 2);
    finish[REPEATED].occlusion_texture = finish[REPEATED].surface_texture;
    finish[REPEATED].roughness = 0.8f;
    finish[MASKED].metalness = 1, finish[MASKED].roughness = 0.1f;
    use_map(&finish[BLENDED].specular_texture, 2, 1, 1), use_map(&finish[BLENDED].occlusion_texture, 0, 0, 1);
    finish[BACK].metalness = 0.7f;
    use_map(&finish[BACK].normal_texture, 1, 1, 2), finish[BACK].normal_scale = -0.7f;
    use_map(&finish[BACK].surface_texture, 0, 1, 1);
    use_map(&finish[MIRRORED].normal_texture, 1, 0, 4);
    use_map(&finish[GLOWING].surface_texture, 0, 0, 3), use_map(&finish[GLOWING].normal_texture, 1, 0, 3);
    finish[GLOWING].metalness = 1, finish[GLOWING].roughness = 0.6f;
    use_map(&finish[COLOURED].normal_texture, 1, 1, 2);
    finish[COLOURED].roughness = 1, finish[COLOURED].specular = 0; /* matt, but for its relief */
    finish[TINTED].roughness = 0.05f;
    for (int c = 0; c < 3; c++) {
        scene->material[MASKED].base_colour[c] = 0.9f;
        scene->material[GLOWING].emission[c] = 0.05f;
        scene->light[0].intensity[c] = 20;
    }
    return scene;
}

/* A sky that is bright and blue above, with a glow at one side. */
static void add_environment(struct lw_scene *scene) {
    enum { W = 64, H = 32 };
    float *rgb = lw_scene_alloc(scene, 3ul * W * H, sizeof *rgb);
    for (uint32_t i = 0; i < W * H; i++) {
        const float up = 1 - 2 * ((float)(i / W) + 0.5f) / H, side = cosf(2 * LW_PI * (float)(i % W) / W);
        rgb[3 * i] = up > 0 ? 0.5f + 3 * powf(fmaxf(side, 0), 8) : 0.2f;
        rgb[3 * i + 1] = up > 0 ? 0.6f + up : 0.15f, rgb[3 * i + 2] = up > 0 ? 1 + 2 * up : 0.1f;
    }
    scene->environment = (struct lw_environment){.width = W, .height = H, .rgb = rgb};
}

static void test_finish_picture(const char *name, bool environment, const char *lights) {
    struct gl_case_world w;
    struct lw_error err = {0};
    struct lw_scene *scene = finished_panels();
    if (environment) add_environment(scene);
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 30}, NULL, &err),
                  &err);
    gl_case_start_lit(&w, scene, 0.5f, 1, lights);
    w.view.camera = lw_camera_look_at(lw_vec3(0.3f, 3, 2.2f), lw_vec3(0, 0, 0.1f), 1);
    gl_case_draw(&w);
    gl_case_compare(name, &w);
    for (size_t i = 0; i < (size_t)3 * PIXELS; i++)
        assert_true(w.by_cpu[i] >= 0 && w.by_cpu[i] < INFINITY && w.by_gl[i] >= 0 && w.by_gl[i] < INFINITY);
    for (int show = LW_SHOW_NORMALS; show < LW_SHOW_COUNT; show++) {
        w.view.show = (enum lw_show)show;
        gl_case_draw(&w);
        gl_case_compare(lw_show_name((enum lw_show)show), &w);
    }
    gl_case_world_finish(&w);
}

static void test_finishes(void **state) {
    (void)state;
    test_finish_picture("finishes, light of tiles", true, "none");
    test_finish_picture("finishes, even sky, light of tiles", false, "none");
    test_finish_picture("finishes, even sky and a lamp", false, "lamps");
}

static double difference_of(const float *a, const float *b) {
    double sum = 0;
    for (size_t i = 0; i < (size_t)3 * PIXELS; i++) sum += fabs((double)(a[i] - b[i]));
    return sum / (3 * PIXELS);
}

/* Directions of light that come later than the light are taken up at the next picture, and shown as rays show
 * them. */
static void test_directions(void **state) {
    (void)state;
    struct gl_case_world w;
    for (int lamps = 0; lamps < 2; lamps++) {
        struct lw_error err = {0};
        struct lw_scene *scene = finished_panels();
        lw_support_ok(
            lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 30}, NULL, &err), &err);
        gl_case_start_lit(&w, scene, 0.5f, 1, lamps ? "lamps" : "none");
        w.view.camera = lw_camera_look_at(lw_vec3(0.3f, 3, 2.2f), lw_vec3(0, 0, 0.1f), 1);
        gl_case_draw(&w);
        float *before = malloc(sizeof(float) * 3 * PIXELS);
        assert_non_null(before);
        memcpy(before, w.by_gl, sizeof(float) * 3 * PIXELS);
        fill_directions(&w);
        gl_case_draw(&w);
        gl_case_compare(lamps ? "directions and a lamp" : "directions", &w);
        assert_true(difference_of(before, w.by_gl) > 10 * difference_of(w.by_cpu, w.by_gl));
        free(before);
        gl_case_world_finish(&w);
    }
}

/* Panels with finishes, light in tiles, and planes of directions in which nothing is known. */
static void start_without_directions(struct gl_case_world *w) {
    struct lw_error err = {0};
    struct lw_scene *scene = finished_panels();
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 30}, NULL, &err),
                  &err);
    gl_case_start_lit(w, scene, 0.5f, 1, "none");
    w->view.camera = lw_camera_look_at(lw_vec3(0.3f, 3, 2.2f), lw_vec3(0, 0, 0.1f), 1);
}

/* Calls a function of each number of all planes of directions, and tells clients that they are others. */
static void change_directions(struct gl_case_world *w, float (*change)(uint32_t number)) {
    uint32_t number = 0;
    for (uint32_t o = 0; o < w->scene->object_count; o++)
        for (uint32_t k = 0; k < w->map.atlas[o]->level_count; k++) {
            const struct lw_atlas_level *l = &w->map.atlas[o]->level[k];
            float *at = w->direction[o * LW_ATLAS_LEVELS_MAX + k];
            for (size_t i = 0; i < (size_t)l->width * l->height * 3; i++) at[i] = change(number++);
        }
    for (uint32_t t = 0; t < w->map.tile_count; t++) w->tile[t].direction_version++;
}

static float nothing(uint32_t number) {
    (void)number;
    return 0;
}

static float any_number(uint32_t number) {
    const uint32_t bits = lw_random_hash2(number, 5);
    float value;
    memcpy(&value, &bits, sizeof value);
    return number / 48 % 2 ? value : (float)(bits % 4001) / 1000 - 2;
}

/* Both pictures without directions, by rays and by OpenGL; then there are some. The caller frees it. */
static float *draw_without_directions(struct gl_case_world *w) {
    start_without_directions(w);
    gl_case_draw(w);
    float *before = malloc(sizeof(float) * 6 * PIXELS);
    assert_non_null(before);
    memcpy(before, w->by_cpu, sizeof(float) * 3 * PIXELS);
    memcpy(before + 3ul * PIXELS, w->by_gl, sizeof(float) * 3 * PIXELS);
    fill_directions(w);
    return before;
}

/* Where no direction is known, both pictures are those without directions. */
static void test_directions_unknown(void **state) {
    (void)state;
    struct gl_case_world w;
    float *before = draw_without_directions(&w);
    gl_case_draw(&w);
    assert_true(difference_of(before, w.by_cpu) > 1e-3);
    change_directions(&w, nothing);
    gl_case_draw(&w);
    assert_true(difference_of(before, w.by_cpu) < 1e-6);
    assert_true(difference_of(before + 3ul * PIXELS, w.by_gl) < 1e-4);
    free(before);
    gl_case_world_finish(&w);
}

/* Directions of any bits: no pixel is no number, negative, or above the bounds of direction_form.h. */
static void test_directions_hostile(void **state) {
    (void)state;
    struct gl_case_world w;
    float *before = draw_without_directions(&w);
    change_directions(&w, any_number);
    gl_case_draw(&w);
    const float most = fmaxf(LW_DIRECTION_FACTOR_MAX, LW_DIRECTION_GAIN_MAX) * 1.02f;
    assert_true(difference_of(before + 3ul * PIXELS, w.by_gl) > 1e-3);
    for (size_t i = 0; i < (size_t)3 * PIXELS; i++) {
        assert_true(w.by_cpu[i] >= 0 && w.by_cpu[i] <= most * before[i] + 1e-3f);
        assert_true(w.by_gl[i] >= 0 && w.by_gl[i] <= most * before[i + 3ul * PIXELS] + 1e-3f);
    }
    free(before);
    gl_case_world_finish(&w);
}

static void test_finished_atrium(void **state) {
    (void)state;
    test_drawn("builtin:atrium", NULL, 1);
}

/* Finishes that come later are taken up at the next picture. */
static void test_finishes_arrive(void **state) {
    (void)state;
    struct gl_case_world w;
    struct lw_error err = {0};
    struct lw_scene *scene = finished_panels();
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 30}, NULL, &err),
                  &err);
    const struct lw_finish *kept[PANELS];
    const uint16_t *tangent[PANELS];
    for (uint32_t i = 0; i < PANELS; i++) {
        kept[i] = scene->material[i].finish, tangent[i] = scene->mesh[i].tangent;
        scene->material[i].finish = NULL, scene->mesh[i].tangent = NULL;
    }
    const uint32_t count = scene->finish_texture_count;
    scene->finish_texture_count = 0;
    gl_case_start_lit(&w, scene, 0.5f, 1, "lamps");
    w.view.camera = lw_camera_look_at(lw_vec3(0.3f, 3, 2.2f), lw_vec3(0, 0, 0.1f), 1);
    gl_case_draw(&w);
    gl_case_compare("before finishes", &w);
    float *before = malloc(sizeof(float) * 3 * PIXELS);
    assert_non_null(before);
    memcpy(before, w.by_gl, sizeof(float) * 3 * PIXELS);
    scene->finish_texture_count = count;
    for (uint32_t i = 0; i < PANELS; i++)
        scene->material[i].finish = kept[i], scene->mesh[i].tangent = tangent[i];
    gl_case_draw(&w);
    gl_case_compare("after they came", &w);
    double differs = 0;
    for (size_t i = 0; i < (size_t)3 * PIXELS; i++) differs += fabs((double)(before[i] - w.by_gl[i]));
    assert_true(differs > 0.01 * 3 * PIXELS);
    free(before);
    gl_case_world_finish(&w);
}

/* Before any light has arrived surfaces are as bright as their albedo. */
static void test_no_light(void **state) {
    (void)state;
    struct gl_case_world w;
    gl_case_start(&w, gl_case_open_scene("builtin:cornell"), 0, 1);
    for (uint32_t t = 0; t < w.map.tile_count; t++) w.tile[t].version = 0;
    gl_case_draw(&w);
    gl_case_compare("builtin:cornell, without light", &w);
    gl_case_world_finish(&w);
}

static void test_sponza(void **state) {
    (void)state;
    test_same_picture(lw_support_scene("sponza/Sponza_lit.gltf"), "-8,1.8,-0.3:5,4,-0.3:75");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_atrium),
        cmocka_unit_test(test_part_of_the_light),
        cmocka_unit_test(test_cornell),
        cmocka_unit_test(test_panels),
        cmocka_unit_test(test_no_light),
        cmocka_unit_test(test_sponza),
        cmocka_unit_test(test_drawn_cornell),
        cmocka_unit_test(test_drawn_atrium),
        cmocka_unit_test(test_drawn_sponza),
        cmocka_unit_test(test_finishes),
        cmocka_unit_test(test_finishes_arrive),
        cmocka_unit_test(test_directions),
        cmocka_unit_test(test_directions_unknown),
        cmocka_unit_test(test_directions_hostile),
        cmocka_unit_test(test_finished_atrium),
    };
    return cmocka_run_group_tests(tests, NULL, gl_case_close_scenes);
}
