/* What a file's extensions mean for light: each is a .glb made here, and a number from a closed form. A floor
 * of 2 m x 2 m faces up, a pane lies 1 m above it, a sun of 100 W/m^2 stands straight above both. */
#include "client/measure/sides/path_world.h"
#include "common/base/colour.h"
#include "common/image/image.h"
#include "server/import/gltf/gltf.h"
#include "tests/reference/room.h"
#include "tests/support/glb.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SUN    100.0
#define FRAMES 64u

struct file {
    float position[4][3];
    uint16_t index[6];
    float time[2], colour[2][3], intensity[2];
    uint8_t picture[4096];
};

/* A change of the text. */
struct change {
    const char *old, *new;
};

/* ' stands for " */
static const char text[] =
    "{'asset':{'version':'2.0'},@EXTENSIONS"
    "'extensions':{@ROOT'KHR_lights_punctual':{'lights':[{'type':'directional','intensity':100}]}},"
    "'scenes':[{@SCENE'nodes':[0,1,2]}],"
    "'nodes':[{'name':'floor','mesh':0@LEVELS},"
    "{'name':'pane','mesh':1,'translation':[0.13,1,-0.17],'scale':[8,1,8]@PANE},"
    "{'name':'sun','rotation':[-0.70710678,0,0,0.70710678],'extensions':{@SUN'KHR_lights_punctual':{'light':"
    "0}}"
    "}],"
    "'meshes':[{'primitives':[{'attributes':{'POSITION':0},'indices':1,'material':0}]},"
    "{'primitives':[{'attributes':{'POSITION':0},'indices':1,'material':1}]}],"
    "'materials':[{@FLOOR},{'doubleSided':true@GLASS}],@MORE"
    "'accessors':[{'bufferView':0,'componentType':5126,'count':4,'type':'VEC3'},"
    "{'bufferView':1,'componentType':5123,'count':6,'type':'SCALAR'},"
    "{'bufferView':2,'componentType':5126,'count':2,'type':'SCALAR'},"
    "{'bufferView':3,'componentType':5126,'count':2,'type':'VEC3'},"
    "{'bufferView':4,'componentType':5126,'count':2,'type':'SCALAR'}],"
    "'bufferViews':[{'buffer':0,'byteLength':48},{'buffer':0,'byteOffset':48,'byteLength':12},"
    "{'buffer':0,'byteOffset':60,'byteLength':8},{'buffer':0,'byteOffset':68,'byteLength':24},"
    "{'buffer':0,'byteOffset':92,'byteLength':8}@VIEWS],'buffers':[{'byteLength':4196}]}";

static struct file plain(void) {
    return (struct file){.position = {{-1, 0, -1}, {1, 0, -1}, {-1, 0, 1}, {1, 0, 1}},
                         .index = {0, 2, 1, 1, 2, 3},
                         .time = {0, 2},
                         .colour = {{1, 1, 1}, {0, 1, 0.5f}},
                         .intensity = {0, 100}};
}

/* What no change fills in is empty. */
static struct lw_scene *load(const struct file *file, const struct change *changes, size_t count) {
    static const char *const places[] = {"@EXTENSIONS", "@ROOT",  "@SCENE", "@LEVELS", "@PANE",
                                         "@SUN",        "@FLOOR", "@GLASS", "@MORE",   "@VIEWS"};
    char *json = strdup(text);
    for (size_t p = 0; p < sizeof places / sizeof *places; p++) {
        const char *fill = "";
        for (size_t c = 0; c < count; c++)
            if (strcmp(changes[c].old, places[p]) == 0) fill = changes[c].new;
        char *at = strstr(json, places[p]), *filled = malloc(strlen(json) + strlen(fill) + 1);
        assert_non_null(at);
        sprintf(filled, "%.*s%s%s", (int)(at - json), json, fill, at + strlen(places[p]));
        free(json);
        json = filled;
    }
    struct lw_scene *scene;
    struct lw_error err = {0};
    size_t size;
    uint8_t *glb = lw_glb_pack(json, file, sizeof *file, &size);
    lw_support_ok(lw_gltf_load_memory(glb, size, "made.glb", &scene, &err), &err);
    free(glb);
    free(json);
    return scene;
}

#define LOAD(file, ...)                                                                                      \
    load(&(file), (const struct change[]){__VA_ARGS__},                                                      \
         sizeof((const struct change[]){__VA_ARGS__}) / sizeof(struct change))

/* Without the pane. */
#define OPEN                                                                                                 \
    { "@PANE", ",'extensions':{'KHR_node_visibility':{'visible':false}}" }

/* Mean direct E of the floor, whose texels are the first tile, by channel. */
static void floor_direct(const struct room_solution *solution, double out[3]) {
    struct lw_solver_tile tile;
    double sum[3] = {0}, count = 0;
    solution->solver->ops->read_tile(solution->solver, (lw_tile_id){0}, &tile);
    for (uint32_t i = 0; i < tile.width * tile.height; i++) {
        if (!tile.covered[i]) continue;
        for (int c = 0; c < 3; c++) sum[c] += (double)tile.direct[c][i];
        count++;
    }
    assert_true(count > 900); /* 32 x 32 texels in all */
    for (int c = 0; c < 3; c++) out[c] = sum[c] / count;
}

static void expect_floor(struct lw_scene *scene, double time_s, double r, double g, double b,
                         double tolerance) {
    struct room_solution solution;
    double e[3];
    room_solve_at(&solution, scene, 16, (struct lw_solver_desc){0}, time_s, FRAMES);
    floor_direct(&solution, e);
    expect_near(e[0], r, tolerance);
    expect_near(e[1], g, tolerance);
    expect_near(e[2], b, tolerance);
    room_finish(&solution);
}

/* Mean radiance of a picture of the path tracer. */
static void mean_radiance(const struct lw_scene *scene, struct lw_vec3 from, struct lw_vec3 to,
                          uint32_t bounces, uint32_t samples, double out[3]) {
    struct lw_path_world world;
    struct lw_path_film film;
    struct lw_error err = {0};
    enum { SIDE = 32 };
    lw_support_ok(lw_path_world_init(&world, scene, bounces, 1, &err), &err);
    lw_support_ok(lw_path_film_init(&film, SIDE, SIDE, &err), &err);
    const struct lw_path_view view = {.camera = lw_camera_look_at(from, to, 0.5f), .seed = 1};
    lw_path_world_render(&world, &view, samples, &film);
    for (int c = 0; c < 3; c++) {
        out[c] = 0;
        for (size_t i = 0; i < SIDE * SIDE; i++)
            out[c] += (double)film.half[0][3 * i + (size_t)c] + (double)film.half[1][3 * i + (size_t)c];
        out[c] /= SIDE * SIDE * (double)samples;
    }
    lw_path_film_finish(&film);
    lw_path_world_finish(&world);
}

/* ---- materials ---- */

/* E on the floor is t c of the sun's, a channel each. 39 % of 1024 texels x 64 rays pass: sigma of the mean
 * is 0.5 %. */
static void transmission_is_thin_and_tinted(void **state) {
    (void)state;
    const struct file file = plain();
    const struct change glass[] = {{"@GLASS",
                                    ",'pbrMetallicRoughness':{'baseColorFactor':[0.9,0.4,0.1,1]},"
                                    "'extensions':{'KHR_materials_transmission':{'transmissionFactor':0.8}}"},
                                   {"@EXTENSIONS", "'extensionsRequired':['KHR_materials_transmission'],"},
                                   {"@FLOOR", "'pbrMetallicRoughness':{'baseColorFactor':[0.5,0.5,0.5,1]}"}};
    expect_floor(load(&file, glass, 3), 0, SUN * 0.8 * 0.9, SUN * 0.8 * 0.4, SUN * 0.8 * 0.1, 0.02);

    /* the path tracer, from below the pane and from above it: there the pane reflects (1 - t) c of all */
    struct lw_scene *scene = load(&file, glass, 3);
    double below[3], above[3];
    mean_radiance(scene, lw_vec3(0.02f, 0.5f, 0.03f), lw_vec3(0.05f, 0, 0.04f), 0, 64, below);
    mean_radiance(scene, lw_vec3(0.02f, 2.5f, 0.03f), lw_vec3(0.05f, 0, 0.04f), 0, 64, above);
    for (int c = 0; c < 3; c++) {
        const double colour[3] = {0.9, 0.4, 0.1}, passes = 0.8 * colour[c],
                     floor = 0.5 * SUN * passes / (double)LW_PI;
        expect_near(below[c], floor, 0.03);
        expect_near(above[c], floor * passes + 0.2 * colour[c] * SUN / (double)LW_PI, 0.03);
    }
    lw_scene_destroy(scene);
}

/* Seen as its base colour, and the floor below it is black: no light, also none that it would reflect. */
static void unlit_is_seen_and_no_light(void **state) {
    (void)state;
    const struct file file = plain();
    const struct change unlit[] = {
        {"@GLASS", ",'pbrMetallicRoughness':{'baseColorFactor':[0.9,0.4,0.1,1]},'emissiveFactor':[1,1,1],"
                   "'extensions':{'KHR_materials_unlit':{}}"},
        {"@EXTENSIONS", "'extensionsRequired':['KHR_materials_unlit'],"}};
    struct lw_scene *scene = load(&file, unlit, 2);
    double seen[3];
    mean_radiance(scene, lw_vec3(0, 0.1f, 0), lw_vec3(0.2f, 1, 0), 0, 4, seen); /* its dark side, too */
    expect_near(seen[0], 0.9, 1e-5);
    expect_near(seen[1], 0.4, 1e-5);
    expect_near(seen[2], 0.1, 1e-5);
    mean_radiance(scene, lw_vec3(0, 0.9f, 0), lw_vec3(0.2f, 0, 0), 3, 4,
                  seen); /* the floor, by paths that meet it */
    assert_true(seen[0] == 0 && seen[1] == 0 && seen[2] == 0);
    struct room_solution solution;
    room_solve_scene(&solution, scene, 16, (struct lw_solver_desc){.bounces = 3}, 8);
    const struct room_mean mean = room_object_mean(&solution, 0);
    assert_true(mean.direct == 0 && mean.indirect == 0);
    room_finish(&solution);
    /* and the sun is the only light: without it there is none */
    scene = load(&file, unlit, 2);
    scene->light_count = 0;
    assert_false(lw_scene_has_light(scene));
    lw_scene_destroy(scene);
}

/* White metallic-roughness beside a diffuse colour: the latter reflects. */
/* A black specular colour makes the surface matt. test_gltf_finish has the others. */
static void specular_glossiness_reflects_its_diffuse(void **state) {
    (void)state;
    const struct file file = plain();
    struct lw_scene *scene = LOAD(
        file, OPEN,
        {"@FLOOR", "'extensions':{'KHR_materials_pbrSpecularGlossiness':{'diffuseFactor':[0.1,0.2,0.3,1],"
                   "'specularFactor':[0,0,0],'glossinessFactor':1}}"});
    double seen[3];
    mean_radiance(scene, lw_vec3(0, 1, 0), lw_vec3(0.1f, 0, 0), 0, 4, seen);
    for (int c = 0; c < 3; c++) expect_near(seen[c], 0.1 * (c + 1) * SUN / (double)LW_PI, 1e-4);
    lw_scene_destroy(scene);
}

/* ---- nodes ---- */

static void hidden_lamps_and_coarser_levels_are_no_part_of_the_light(void **state) {
    (void)state;
    const struct file file = plain();
    expect_floor(LOAD(file, OPEN), 0, SUN, SUN, SUN, 1e-5);
    expect_floor(LOAD(file, {"@PANE", ""}), 0, 0, 0, 0, 0);
    /* as a coarser level of the floor it does not keep the sun out */
    expect_floor(LOAD(file, {"@LEVELS", ",'extensions':{'MSFT_lod':{'ids':[1]}}"}), 0, SUN, SUN, SUN, 1e-5);
    struct lw_scene *scene = LOAD(file, OPEN, {"@SUN", "'KHR_node_visibility':{'visible':false},"});
    assert_false(lw_scene_has_light(scene));
    lw_scene_destroy(scene);
}

/* ---- animation ---- */

/* After 1 of 2 s: half of the intensity, and half-way between the colours. */
static void animated_lights_are_lit_as_they_are(void **state) {
    (void)state;
    const struct file file = plain();
#define POINTER(sampler, field)                                                                              \
    "{'sampler':" sampler ",'target':{'path':'pointer','extensions':{'KHR_animation_pointer':{'pointer':"    \
    "'/extensions/KHR_lights_punctual/lights/0/" field "'}}}}"
    const struct change dims[] = {
        OPEN,
        {"@EXTENSIONS", "'extensionsRequired':['KHR_animation_pointer'],"},
        {"@MORE", "'animations':[{'channels':[" POINTER("0", "intensity") "," POINTER(
                      "1", "color") "],"
                                    "'samplers':[{'input':2,'output':4},{'input':2,'output':3}]}],"}};
    expect_floor(load(&file, dims, 3), 1, 50 * 0.5, 50, 50 * 0.75, 1e-5);
    /* the solver that saw it come, too */
    struct room_solution solution;
    struct lw_error err = {0};
    double e[3];
    room_solve_at(&solution, load(&file, dims, 3), 16, (struct lw_solver_desc){0}, 0, 1);
    floor_direct(&solution, e);
    assert_true(e[0] == 0 && e[1] == 0 && e[2] == 0);
    lw_pose_evaluate(&solution.pose, solution.scene, 1);
    for (uint64_t f = 2; f < 40; f++)
        lw_support_ok(solution.solver->ops->frame(solution.solver, &solution.pose, f, &solution.stats, &err),
                      &err);
    floor_direct(&solution, e);
    expect_near(e[0], 25, 0.01);
    expect_near(e[1], 50, 0.01);
    expect_near(e[2], 37.5, 0.01);
    room_finish(&solution);
}

/* ---- image-based light ---- */

/* Puts two pictures of 8 x 8 texels into the binary part: texels of the first are (255, 255, 255, alpha),
 * those of the second black. */
static void add_pictures(struct file *file, uint8_t alpha, char views[256]) {
    size_t at = 0, length[2];
    for (int p = 0; p < 2; p++) {
        uint8_t texels[8 * 8 * 4], *png;
        struct lw_error err = {0};
        memset(texels, p ? 0 : 255, sizeof texels);
        for (size_t i = 0; i < 64; i++) texels[4 * i + 3] = p ? 255 : alpha;
        lw_support_ok(lw_image_encode_png(texels, 8, 8, 4, &png, &length[p], &err), &err);
        assert_true(at + length[p] <= sizeof file->picture);
        memcpy(file->picture + at, png, length[p]);
        at += length[p];
        free(png);
    }
    snprintf(views, 256,
             ",{'buffer':0,'byteOffset':100,'byteLength':%zu},{'buffer':0,'byteOffset':%zu,'byteLength':%zu}",
             length[0], 100 + length[0], length[1]);
}

static struct lw_scene *load_cube(const char *fields, uint8_t alpha) {
    char views[256], root[512];
    struct file file = plain();
    add_pictures(&file, alpha, views);
    snprintf(root, sizeof root, "'EXT_lights_image_based':{'lights':[{%s}]},", fields);
    struct lw_scene *scene =
        LOAD(file, OPEN, {"@ROOT", root}, {"@SCENE", "'extensions':{'EXT_lights_image_based':{'light':0}},"},
             {"@EXTENSIONS", "'extensionsRequired':['EXT_lights_image_based'],"},
             {"@MORE",
              "'images':[{'bufferView':5,'mimeType':'image/png'},{'bufferView':6,'mimeType':'image/png'}],"},
             {"@VIEWS", views}, {"@SUN", "'KHR_node_visibility':{'visible':false},"});
    assert_int_equal(scene->light_count, 0);
    assert_int_equal(scene->environment.width, 32);
    assert_int_equal(scene->environment.height, 16);
    return scene;
}

/* One face of a cube that lights from above sends 55.4 % of what an even sky does: four times the view factor
 * of a square that faces an element below its corner, with sides as long as it is far (Howell, C-11):
 *     1 / pi  1 / sqrt(2)  atan(1 / sqrt(2)) */
static void image_based_lights_are_environments(void **state) {
    (void)state;
    const double pi = acos(-1.0), face = 4 / pi * sqrt(0.5) * atan(sqrt(0.5));
    const double even = pi * 2; /* W/m^2 of 2 W/(m^2 sr) */
    expect_floor(load_cube("'intensity':2,'specularImageSize':8,'specularImages':[[0,0,0,0,0,0]]", 255), 0,
                 even, even, even, 0.01);
    /* RGBD: divided by alpha, 51 / 255 */
    expect_floor(load_cube("'specularImages':[[0,0,0,0,0,0],[1,1,1,1,1,1]]", 51), 0, 5 * pi, 5 * pi, 5 * pi,
                 0.01);
    /* +Y, +Z that a quarter turn about X takes up, and -X, about Z. The edge of a face is blurred over the
     * texels of the environment, of which 16 are from pole to pole. */
    static const char *const ups[] = {
        "'specularImages':[[1,1,0,1,1,1]]",
        "'rotation':[-0.70710678,0,0,0.70710678],'specularImages':[[1,1,1,1,0,1]]",
        "'rotation':[0,0,-0.70710678,0.70710678],'specularImages':[[1,0,1,1,1,1]]",
    };
    for (size_t i = 0; i < sizeof ups / sizeof *ups; i++)
        expect_floor(load_cube(ups[i], 255), 0, pi * face, pi * face, pi * face, 0.04);
}

/* A picture whose one corner is bright: it is where a camera in the middle sees it. */
static void faces_are_seen_from_inside(void **state) {
    (void)state;
    char views[256];
    struct file file = plain();
    uint8_t texels[8 * 8 * 4] = {0}, *png;
    size_t length;
    struct lw_error err = {0};
    for (uint32_t y = 0; y < 8; y++)
        for (uint32_t x = 0; x < 8; x++) memset(texels + 4 * (8 * y + x), y < 4 && x >= 4 ? 255 : 0, 3);
    for (uint32_t i = 0; i < 64; i++) texels[4 * i + 3] = 255;
    lw_support_ok(lw_image_encode_png(texels, 8, 8, 4, &png, &length, &err), &err);
    memcpy(file.picture, png, length);
    free(png);
    snprintf(views, sizeof views, ",{'buffer':0,'byteOffset':100,'byteLength':%zu}", length);
    struct lw_scene *scene = LOAD(
        file, OPEN, {"@ROOT", "'EXT_lights_image_based':{'lights':[{'specularImages':[[0,0,0,0,0,0]]}]},"},
        {"@SCENE", "'extensions':{'EXT_lights_image_based':{'light':0}},"},
        {"@MORE", "'images':[{'bufferView':5}],"}, {"@VIEWS", views});
    /* ahead, to the right, up of each face: upper right quarter */
    static const float axes[6][3][3] = {
        {{1, 0, 0}, {0, 0, 1}, {0, 1, 0}},   {{-1, 0, 0}, {0, 0, -1}, {0, 1, 0}},
        {{0, 1, 0}, {-1, 0, 0}, {0, 0, -1}}, {{0, -1, 0}, {-1, 0, 0}, {0, 0, 1}},
        {{0, 0, 1}, {-1, 0, 0}, {0, 1, 0}},  {{0, 0, -1}, {1, 0, 0}, {0, 1, 0}},
    };
    for (int f = 0; f < 6; f++)
        for (int quarter = 0; quarter < 4; quarter++) {
            const float right = quarter & 1 ? 0.5f : -0.5f, up = quarter & 2 ? 0.5f : -0.5f;
            float d[3];
            for (int k = 0; k < 3; k++) d[k] = axes[f][0][k] + right * axes[f][1][k] + up * axes[f][2][k];
            const struct lw_vec3 seen = lw_scene_sky(scene, lw_vec3_normalize(lw_vec3(d[0], d[1], d[2])));
            assert_float_equal(seen.x, quarter == 3 ? 1 : 0, 0.05);
        }
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(transmission_is_thin_and_tinted),
        cmocka_unit_test(unlit_is_seen_and_no_light),
        cmocka_unit_test(specular_glossiness_reflects_its_diffuse),
        cmocka_unit_test(hidden_lamps_and_coarser_levels_are_no_part_of_the_light),
        cmocka_unit_test(animated_lights_are_lit_as_they_are),
        cmocka_unit_test(image_based_lights_are_environments),
        cmocka_unit_test(faces_are_seen_from_inside),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
