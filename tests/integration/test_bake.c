/* lightwell-bake as users run it: its maps against a closed form, through the coordinates in its .glb,
 * stopping and going on; what it refuses. */
#include "tests/support/process.h"

#include "common/base/clock.h"
#include "common/image/image.h"
#include "common/lightmap/lightmap.h"
#include "common/scene/package.h"
#include "common/scene/pose.h"
#include "server/import/gltf/gltf.h"

#include <errno.h>
#include <jansson.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define LIMIT_S LW_PROCESS_LIMIT_S

static int tear_down(void **state) {
    (void)state;
    lw_process_kill_all();
    return 0;
}

static int bake(const char *format, ...) __attribute__((format(printf, 1, 2)));
static struct lw_process process;

static int bake(const char *format, ...) {
    char arguments[1024];
    va_list list;
    va_start(list, format);
    vsnprintf(arguments, sizeof arguments, format, list);
    va_end(list);
    lw_process_start(&process, "lightwell-bake", arguments);
    return lw_process_finish(&process, LIMIT_S);
}

static void bake_fails(int code, const char *text, const char *arguments) {
    const int got = bake("%s", arguments);
    char *said = lw_process_err(&process);
    if (got != code || !strstr(said, text)) fail_msg("%s: code %d, said: %s", arguments, got, said);
    const char *error = strstr(said, "error: ");
    assert_non_null(error);
    assert_ptr_equal(strchr(error, '\n') + 1, strchr(error, 0)); /* one line, the last */
    free(said);
}

static char *in(const char *folder, const char *file) {
    static char path[8][256];
    static unsigned next;
    char *out = path[next++ % 8];
    snprintf(out, sizeof path[0], "%s/%s", folder, file);
    return out;
}

/* A file has this text somewhere. */
static void expect_bytes(const char *path, const char *text) {
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    static char bytes[1 << 22];
    const size_t size = fread(bytes, 1, sizeof bytes, file);
    fclose(file);
    if (!memmem(bytes, size, text, strlen(text))) fail_msg("%s lacks \"%s\"", path, text);
}

static json_t *read_index(const char *folder) {
    json_t *index = json_load_file(in(folder, "index.json"), 0, NULL);
    assert_non_null(index);
    return index;
}

/* ---- a closed form, through EXR and .glb ---- */

#define LAMP_X -0.4f
#define LAMP_Y 1.5f
#define LAMP_Z 0.7f

/* Two squares of albedo 0.5 under a point light of 10 W/sr that stands over neither's middle, so that a map
 * that is turned or mirrored shows. */
static const char *save_squares(void) {
    static char path[256];
    struct lw_scene *scene = lw_support_squares(2, 1);
    struct lw_error err = {0};
    const float lamp[3] = {LAMP_X, LAMP_Y, LAMP_Z};
    memcpy(scene->node[2].translation, lamp, sizeof lamp);
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 50}, NULL, &err),
                  &err);
    snprintf(path, sizeof path, "%s", lw_support_temporary("squares.lwscene"));
    lw_support_ok(lw_package_save(scene, path, &err), &err);
    lw_scene_destroy(scene);
    return path;
}

/* The lamp's place. */
static double irradiance_at(struct lw_vec3 p) {
    const double x = (double)(LAMP_X - p.x), y = (double)(LAMP_Y - p.y), z = (double)(LAMP_Z - p.z);
    const double d2 = x * x + y * y + z * z;
    return 10 * (y / sqrt(d2)) / d2;
}

struct picture {
    float *rgba;
    uint32_t width, height;
};

/* As an engine's sampler does it: v = 0 is the upper edge of row 0. */
static double sample(const struct picture *picture, float u, float v, size_t channel) {
    const float x = u * (float)picture->width - 0.5f, y = v * (float)picture->height - 0.5f;
    const int x0 = (int)floorf(x), y0 = (int)floorf(y);
    double sum = 0;
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 2; i++) {
            const int cx = x0 + i < 0 ? 0 : x0 + i, cy = y0 + j < 0 ? 0 : y0 + j;
            const float wx = i ? x - (float)x0 : 1 - (x - (float)x0),
                        wy = j ? y - (float)y0 : 1 - (y - (float)y0);
            sum +=
                (double)(wx * wy * picture->rgba[((size_t)cy * picture->width + (size_t)cx) * 4 + channel]);
        }
    return sum;
}

/* A point of an object, its lightmap coordinates from the .glb. */
typedef void point_fn(void *user, const struct picture *picture, struct lw_vec3 p, float u, float v);

/* Calls back at points all over an object. exr: its map */
static void each_point(const struct lw_scene *scene, const struct lw_pose *pose, uint32_t o, const char *exr,
                       point_fn *fn, void *user) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
    struct picture picture;
    struct lw_error err = {0};
    lw_support_ok(lw_image_read_exr_rgba(exr, &picture.rgba, &picture.width, &picture.height, &err), &err);
    assert_non_null(mesh->uv[1]);
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        for (int i = 1; i < 10; i++)
            for (int j = 1; i + j < 10; j++) {
                const float w[3] = {1 - 0.1f * (float)(i + j), 0.1f * (float)i, 0.1f * (float)j};
                struct lw_vec3 p = {0};
                float u = 0, v = 0;
                for (int k = 0; k < 3; k++) {
                    const uint32_t n = mesh->triangle[t][k];
                    p = lw_vec3_mad(p, mesh->position[n], w[k]);
                    u += mesh->uv[1][n].x * w[k];
                    v += mesh->uv[1][n].y * w[k];
                }
                fn(user, &picture, lw_affine_point(&pose->object_to_world[o], p), u, v);
            }
    free(picture.rgba);
}

/* Light: `factor` times that of as many lamps, and of a sky of that radiance. */
struct light {
    double factor, lamps, sky;
};

/* Half a thousandth by 16 bits, the rest by bilinear interpolation over 2 cm; a texel is the mean over its
 * area, which eight places of it stand for, so the samples are a multiple of eight. */
static void check_light(void *user, const struct picture *picture, struct lw_vec3 p, float u, float v) {
    const struct light *light = user;
    const double want = (light->lamps * irradiance_at(p) + M_PI * light->sky) * light->factor,
                 got = sample(picture, u, v, 0);
    if (!(fabs(got / want - 1) < 0.003))
        fail_msg("at (%g, %g): %g instead of %g", (double)p.x, (double)p.z, got, want);
}

/* The scene that a bake has written, where it stands. */
static void load_glb(const char *path, struct lw_scene **out_scene, struct lw_pose *pose) {
    struct lw_error err = {0};
    lw_support_ok(lw_gltf_load(path, 0, out_scene, &err), &err);
    lw_support_ok(lw_pose_init(pose, *out_scene), NULL);
}

static void check_object(const struct lw_scene *scene, const struct lw_pose *pose, uint32_t o,
                         const char *exr, double factor, double lamps, double sky) {
    struct light light = {factor, lamps, sky};
    each_point(scene, pose, o, exr, check_light, &light);
}

/* All light comes from the lamp. */
static void check_direction(void *user, const struct picture *picture, struct lw_vec3 p, float u, float v) {
    const struct lw_vec3 lamp = {LAMP_X, LAMP_Y, LAMP_Z}, want = lw_vec3_normalize(lw_vec3_sub(lamp, p)),
                         got = {(float)sample(picture, u, v, 0), (float)sample(picture, u, v, 1),
                                (float)sample(picture, u, v, 2)};
    (void)user;
    if (!(lw_vec3_length(lw_vec3_sub(got, want)) < 0.01f))
        fail_msg("at (%g, %g): %g, %g, %g instead of %g, %g, %g", (double)p.x, (double)p.z, (double)got.x,
                 (double)got.y, (double)got.z, (double)want.x, (double)want.y, (double)want.z);
}

static void maps_hold_the_light_where_the_glb_says(void **state) {
    (void)state;
    static const struct {
        const char *convention, *units;
        double factor;
    } cases[] = {{"irradiance", "W/m^2", 1},
                 {"radiosity", "W/m^2", 0.5},
                 {"three", "W/m^2", 1},
                 {"godot", "W/(m^2 sr)", 1 / M_PI},
                 {"babylon", "W/(m^2 sr)", 0.5 / M_PI}};
    const char *squares = save_squares();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char out[256], glb[256];
        snprintf(out, sizeof out, "%s", lw_support_temporary("squares"));
        snprintf(glb, sizeof glb, "%s", lw_support_temporary("squares.glb"));
        assert_int_equal(
            bake("%s -o %s --samples 16 --bounces 0 --threads 2 --convention %s --gltf-out %s %s", squares,
                 out, cases[i].convention, glb, i % 2 ? "--float" : ""),
            0);
        struct lw_scene *scene;
        struct lw_pose pose;
        load_glb(glb, &scene, &pose);
        assert_int_equal(scene->object_count, 2);
        check_object(scene, &pose, 0, in(out, "square_0.exr"), cases[i].factor, 1, 0);
        check_object(scene, &pose, 1, in(out, "square_1.exr"), cases[i].factor, 1, 0);
        lw_pose_finish(&pose);
        lw_scene_destroy(scene);
        json_t *index = read_index(out), *map = json_array_get(json_object_get(index, "maps"), 1);
        assert_string_equal(json_string_value(json_object_get(index, "units")), cases[i].units);
        assert_string_equal(json_string_value(json_object_get(index, "convention")), cases[i].convention);
        assert_true(json_is_true(json_object_get(index, "complete")));
        assert_string_equal(json_string_value(json_object_get(map, "name")), "square 1");
        assert_string_equal(json_string_value(json_object_get(map, "file")), "square_1.exr");
        assert_string_equal(json_string_value(json_object_get(map, "type")), i % 2 ? "float" : "half");
        json_decref(index);
    }
}

/* The lamp's own light is the engine's, which has the lamp from the .glb; the sky's is in the maps, in each
 * convention. */
static void indirect_only_leaves_the_lamp_to_the_engine(void **state) {
    (void)state;
    static const struct {
        const char *convention;
        double factor;
    } cases[] = {
        {"irradiance", 1}, {"radiosity", 0.5}, {"three", 1}, {"godot", 1 / M_PI}, {"babylon", 0.5 / M_PI}};
    const char *squares = save_squares();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char out[256], glb[256];
        snprintf(out, sizeof out, "%s", lw_support_temporary("rest"));
        snprintf(glb, sizeof glb, "%s", lw_support_temporary("rest.glb"));
        assert_int_equal(bake("%s -o %s --sky 0.2,0.2,0.2 --samples 16 --bounces 0 --threads 2 "
                              "--indirect-only --convention %s --gltf-out %s%s",
                              squares, out, cases[i].convention, glb, i ? "" : " --client-lights lamps"),
                         0);
        struct lw_scene *scene;
        struct lw_pose pose;
        load_glb(glb, &scene, &pose);
        check_object(scene, &pose, 0, in(out, "square_0.exr"), cases[i].factor, 0, 0.2);
        check_object(scene, &pose, 1, in(out, "square_1.exr"), cases[i].factor, 0, 0.2);
        assert_int_equal(scene->light_count, 1);
        assert_true(fabsf(scene->light[0].intensity[0] - 10) < 1e-4f);
        assert_true(fabsf(pose.light[0].position_ws.y - LAMP_Y) < 1e-5f);
        lw_pose_finish(&pose);
        lw_scene_destroy(scene);
        json_t *index = read_index(out), *left_out = json_object_get(index, "left_out");
        assert_int_equal(json_array_size(json_object_get(left_out, "lights")), 1);
        assert_int_equal(json_array_size(json_object_get(left_out, "materials")), 0);
        json_decref(index);
    }
    assert_true(lw_process_said(&process, "without the direct light of 1 lamp and 0"));
}

/* ---- stopping and going on ---- */

#define CORNELL "builtin:cornell --texels-per-metre 30 --threads 2 --bounces 2"
#define SMALL   "builtin:cornell --texels-per-metre 12 --threads 2 --bounces 2"
static const char *const cornell_maps[] = {"floor.exr",      "ceiling.exr",    "back_wall.exr",
                                           "left_wall.exr",  "right_wall.exr", "short_block.exr",
                                           "tall_block.exr", "lamp.exr"};

static void expect_same_maps(const char *a, const char *b) {
    for (size_t i = 0; i < sizeof cornell_maps / sizeof *cornell_maps; i++) {
        size_t size_a, size_b;
        uint8_t *bytes_a = lw_support_read_file(in(a, cornell_maps[i]), &size_a),
                *bytes_b = lw_support_read_file(in(b, cornell_maps[i]), &size_b);
        assert_int_equal(size_a, size_b);
        assert_memory_equal(bytes_a, bytes_b, size_a);
        free(bytes_a);
        free(bytes_b);
    }
}

static void expect_finite(const char *folder) {
    for (size_t i = 0; i < sizeof cornell_maps / sizeof *cornell_maps; i++) {
        float *rgba;
        uint32_t width, height;
        struct lw_error err = {0};
        lw_support_ok(lw_image_read_exr_rgba(in(folder, cornell_maps[i]), &rgba, &width, &height, &err),
                      &err);
        for (size_t p = 0; p < (size_t)width * height * 4; p++)
            assert_true(isfinite(rgba[p]) && rgba[p] >= 0);
        free(rgba);
    }
}

/* Starts a bake that would take hours, and sends Ctrl-C once it has saved its state for the first time. */
static void interrupt(const char *scene, const char *out, const char *more) {
    char arguments[512];
    snprintf(arguments, sizeof arguments, "%s -o %s --samples 1000000 --checkpoint 0.1 %s", scene, out, more);
    lw_process_start(&process, "lightwell-bake", arguments);
    assert_true(lw_process_await_file(&process, in(out, ".lightwell-bake-state")));
    assert_int_equal(lw_process_stop(&process, SIGINT, LIMIT_S), 75);
}

/* A double-sided square whose back alone is lit: what the .glb points at has the lamp's light, and index.json
 * says so. */
static void a_back_that_is_lit_is_shown(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(1, 1);
    struct lw_error err = {0};
    char path[256], out[256], glb[256];
    scene->material[0].double_sided = 1;
    const float lamp[3] = {0, -1, 0}; /* below the square, which looks up */
    memcpy(scene->node[scene->light[0].node].translation, lamp, sizeof lamp);
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 16}, NULL, &err),
                  &err);
    snprintf(path, sizeof path, "%s", lw_support_temporary("lit-back.lwscene"));
    snprintf(out, sizeof out, "%s", lw_support_temporary("lit-back"));
    snprintf(glb, sizeof glb, "%s", lw_support_temporary("lit-back.glb"));
    lw_support_ok(lw_package_save(scene, path, &err), &err);
    lw_scene_destroy(scene);
    static const struct {
        const char *option, *side;
    } cases[] = {{"", "back"}, {"--sides back", "back"}, {"--sides front", "front"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_int_equal(bake("%s -o %s --samples 2 --gltf-out %s %s", path, out, glb, cases[i].option), 0);
        json_t *index = read_index(out);
        json_t *map = json_array_get(json_object_get(index, "maps"), 0);
        assert_string_equal(json_string_value(json_object_get(map, "side")), cases[i].side);
        assert_true(json_number_value(json_object_get(map, "both_sides")) == 0 || i == 2);
        json_decref(index);
    }
    char both[512];
    snprintf(both, sizeof both, "%s -o %s --samples 2 --gltf-out %s --gltf-split-sides --sides back", path,
             out, glb);
    bake_fails(64, "--gltf-split-sides shows both sides", both);
}

static void resumed_is_uninterrupted(void **state) {
    (void)state;
    char whole[256], parts[256];
    snprintf(whole, sizeof whole, "%s", lw_support_temporary("whole"));
    snprintf(parts, sizeof parts, "%s", lw_support_temporary("parts"));
    interrupt(CORNELL, parts, "");
    char *said = lw_process_err(&process);
    const char *answer = strstr(said, "stopping: finishing the samples under way, then writing the maps");
    assert_non_null(answer);
    assert_non_null(strstr(answer, "not finished")); /* the answer comes first */
    assert_null(strstr(said, "baking: done"));
    free(said);
    json_t *index = read_index(parts); /* the finished part is kept, and says that it is not all */
    assert_true(json_is_false(json_object_get(index, "complete")));
    const long long frames = json_integer_value(json_object_get(index, "frames")), all = frames + 10;
    assert_true(frames >= 1);
    json_decref(index);
    expect_finite(parts);

    assert_int_equal(bake(CORNELL " -o %s --samples %lld", parts, all), 0);
    assert_true(lw_process_said(&process, "going on after"));
    assert_int_not_equal(access(in(parts, ".lightwell-bake-state"), F_OK), 0);

    assert_int_equal(bake(CORNELL " -o %s --samples %lld", whole, all), 0);
    assert_int_not_equal(access(in(whole, ".lightwell-bake-state"), F_OK), 0);
    expect_finite(whole);
    expect_same_maps(whole, parts);
}

/* The covered texels of a map, green channel: mean, and mean square of the difference to another bake of
 * it. */
static void compare_maps(const char *file, const char *folder, const char *other, double *out_mean,
                         double *out_square) {
    float *a, *b;
    uint32_t width, height, width_b, height_b, count = 0;
    struct lw_error err = {0};
    lw_support_ok(lw_image_read_exr_rgba(in(folder, file), &a, &width, &height, &err), &err);
    lw_support_ok(lw_image_read_exr_rgba(in(other, file), &b, &width_b, &height_b, &err), &err);
    assert_true(width == width_b && height == height_b);
    *out_mean = *out_square = 0;
    for (size_t i = 0; i < (size_t)width * height * 4; i += 4) {
        if (!(a[i + 3] > 0)) continue;
        *out_mean += (double)a[i + 1];
        *out_square += ((double)a[i + 1] - (double)b[i + 1]) * ((double)a[i + 1] - (double)b[i + 1]);
        count++;
    }
    *out_mean /= count;
    *out_square /= count;
    free(b);
    free(a);
}

static void denoise_takes_noise_and_leaves_light(void **state) {
    (void)state;
    char reference[256], noisy[256], filtered[256];
    snprintf(reference, sizeof reference, "%s", lw_support_temporary("reference"));
    snprintf(noisy, sizeof noisy, "%s", lw_support_temporary("noisy"));
    snprintf(filtered, sizeof filtered, "%s", lw_support_temporary("filtered"));
    assert_int_equal(bake(CORNELL " -o %s --samples 100 --seed 2", reference), 0);
    assert_int_equal(bake(CORNELL " -o %s --samples 8", noisy), 0);
    assert_int_equal(bake(CORNELL " -o %s --samples 8 --denoise", filtered), 0);
    double before = 0, after = 0;
    for (size_t i = 0; i < sizeof cornell_maps / sizeof *cornell_maps; i++) {
        double mean_noisy, mean_filtered, square;
        compare_maps(cornell_maps[i], noisy, reference, &mean_noisy, &square);
        before += square;
        compare_maps(cornell_maps[i], filtered, reference, &mean_filtered, &square);
        after += square;
        if (!(fabs(mean_filtered - mean_noisy) <= 0.005 * mean_noisy))
            fail_msg("%s: mean %g, filtered %g", cornell_maps[i], mean_noisy, mean_filtered);
    }
    print_message("squared error %.5f, filtered %.5f\n", before, after);
    assert_true(after < 0.6 * before);
}

static void an_unfinished_bake_is_not_mixed_with_another(void **state) {
    (void)state;
    char out[256], arguments[512];
    snprintf(out, sizeof out, "%s", lw_support_temporary("mixed"));
    interrupt(CORNELL, out, "");
    snprintf(arguments, sizeof arguments, CORNELL " -o %s --samples 4 --seed 2", out);
    bake_fails(65, "of another scene or of other options", arguments);
    assert_int_equal(bake(CORNELL " -o %s --samples 4 --seed 2 --restart", out), 0);

    interrupt(CORNELL, out, "");
    char *state_path = in(out, ".lightwell-bake-state");
    struct stat st;
    assert_int_equal(stat(state_path, &st), 0);
    assert_int_equal(truncate(state_path, st.st_size / 2), 0);
    snprintf(arguments, sizeof arguments, CORNELL " -o %s --samples 4", out);
    bake_fails(65, "cut short", arguments);
}

/* The same scene with another gloss is another scene: bounces differ. */
static void nor_with_one_of_other_finishes(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(1, 1);
    struct lw_error err = {0};
    char path[256], out[256], arguments[640];
    const struct lw_texture_use none = {.texture = LW_SCENE_NONE, .transform = {1, 0, 0, 0, 1, 0}};
    const struct lw_finish finish = {.metalness = 1,
                                     .specular_colour = {1, 1, 1},
                                     .ior = 1.5f,
                                     .normal_scale = 1,
                                     .surface_texture = none,
                                     .specular_texture = none,
                                     .occlusion_texture = none,
                                     .normal_texture = none};
    snprintf(path, sizeof path, "%s", lw_support_temporary("finished.lwscene"));
    snprintf(out, sizeof out, "%s", lw_support_temporary("finished"));
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 16}, NULL, &err),
                  &err);
    lw_support_ok(lw_package_save(scene, path, &err), &err);
    interrupt(path, out, "");
    scene->material[0].finish = &finish;
    lw_support_ok(lw_package_save(scene, path, &err), &err);
    snprintf(arguments, sizeof arguments, "%s -o %s --samples 4", path, out);
    bake_fails(65, "of another scene or of other options", arguments);
    lw_scene_destroy(scene);
}

/* Before there is light, the signal ends it without a file. */
static void stopped_early_it_writes_nothing(void **state) {
    (void)state;
    char out[256], arguments[512];
    snprintf(out, sizeof out, "%s", lw_support_temporary("early"));
    snprintf(arguments, sizeof arguments, "builtin:atrium-matt --threads 1 -o %s", out);
    lw_process_start(&process, "lightwell-bake", arguments);
    assert_true(lw_process_await_file(&process, out)); /* made after the handler is in place */
    assert_int_equal(lw_process_stop(&process, SIGINT, LIMIT_S), 75);
    assert_true(lw_process_said(&process, "nothing is written"));
    assert_int_not_equal(access(in(out, "index.json"), F_OK), 0);
    assert_int_equal(rmdir(out), 0); /* it is empty */
}

static void limits_end_a_bake_with_what_is_there(void **state) {
    (void)state;
    char out[256];
    snprintf(out, sizeof out, "%s", lw_support_temporary("limited"));
    assert_int_equal(bake(CORNELL " -o %s --error 0.0005 --time-limit 1.1", out), 0);
    char *said = lw_process_err(&process);
    assert_non_null(strstr(said, "short of --error 0.0005"));
    assert_non_null(strstr(said, "baking: stopped at "));
    assert_null(strstr(said, "baking: done"));
    assert_non_null(strstr(said, "noisiest: "));
    free(said);
    expect_finite(out);
    /* an aim that is easier is reached from there */
    assert_int_equal(bake(CORNELL " -o %s --error 0.5", out), 0);
    json_t *index = read_index(out), *map;
    size_t i;
    assert_true(json_is_true(json_object_get(index, "complete")));
    json_array_foreach(json_object_get(index, "maps"), i, map)
        assert_true(json_number_value(json_object_get(map, "error_worst")) <= 0.5);
    json_decref(index);
}

/* The means of maps are those of the cells; a solver's state is nobody else's. */
static void bakes_the_same_light(const char *solver, const char *options) {
    char cells[256], others[256], arguments[512];
    snprintf(cells, sizeof cells, "%s", lw_support_temporary("cells"));
    snprintf(others, sizeof others, "%s", lw_support_temporary(solver));
    assert_int_equal(bake(SMALL " -o %s --samples 256", cells), 0);
    assert_int_equal(bake(SMALL " -o %s --solver %s %s", others, solver, options), 0);
    expect_finite(others);
    static const char *const maps[] = {"floor.exr", "back_wall.exr", "left_wall.exr"};
    for (size_t i = 0; i < sizeof maps / sizeof *maps; i++) {
        double mean, other, square;
        compare_maps(maps[i], cells, others, &mean, &square);
        compare_maps(maps[i], others, cells, &other, &square);
        if (fabs(other / mean - 1) > 0.03)
            fail_msg("%s: %g by %s, %g by cells", maps[i], other, solver, mean);
        assert_true(square < 0.02 * mean * mean);
    }
    interrupt(SMALL, cells, "");
    snprintf(arguments, sizeof arguments, SMALL " -o %s --samples 2 --solver %s", cells, solver);
    bake_fails(65, "of another scene or of other options", arguments);
}

static void radiosity_bakes_the_same_light(void **state) {
    (void)state;
    bakes_the_same_light("radiosity", "--samples 2");
}

static void virtual_lights_bake_the_same_light(void **state) {
    (void)state;
    bakes_the_same_light("vpl", "--samples 64 --vpl-sets 4 --vpl-near 0.02");
}

static void directions_point_at_the_lamp(void **state) {
    (void)state;
    const char *squares = save_squares();
    char out[256], glb[256];
    snprintf(out, sizeof out, "%s", lw_support_temporary("directional"));
    snprintf(glb, sizeof glb, "%s", lw_support_temporary("directional.glb"));
    assert_int_equal(bake("%s -o %s --samples 16 --bounces 0 --directional --gltf-out %s", squares, out, glb),
                     0);
    struct lw_scene *scene;
    struct lw_pose pose;
    load_glb(glb, &scene, &pose);
    each_point(scene, &pose, 0, in(out, "directions/square_0.exr"), check_direction, NULL);
    each_point(scene, &pose, 1, in(out, "directions/square_1.exr"), check_direction, NULL);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
    json_t *index = read_index(out), *map = json_array_get(json_object_get(index, "maps"), 1);
    assert_string_equal(json_string_value(json_object_get(map, "directions")), "directions/square_1.exr");
    json_decref(index);
}

/* ---- directions as engines read them ---- */

/* The lamp's direction over the plain normal, (0, 1, 0), and over a bent one. */
struct bend {
    struct lw_vec3 m, lamp;
    double plain, bent;
};

static struct bend bend_at(struct lw_vec3 p) {
    const struct lw_vec3 lamp = {LAMP_X, LAMP_Y, LAMP_Z}, d = lw_vec3_normalize(lw_vec3_sub(lamp, p)),
                         m = lw_vec3_normalize(lw_vec3(0.5f, 1, -0.3f));
    return (struct bend){m, d, (double)d.y, (double)lw_vec3_dot(d, m)};
}

static void expect_near(const char *what, struct lw_vec3 p, double got, double want, double tolerance) {
    if (!(fabs(got - want) < tolerance))
        fail_msg("%s at (%g, %g): %g instead of %g", what, (double)p.x, (double)p.z, got, want);
}

/* Unity's DecodeDirectionalLightmap(), with the light map left out. A lamp alone: (1 + d.m) / (1 + d.n). */
static void check_dominant(void *user, const struct picture *picture, struct lw_vec3 p, float u, float v) {
    const struct bend b = bend_at(p);
    (void)user;
    double texel[4];
    for (size_t c = 0; c < 4; c++) texel[c] = sample(picture, u, v, c);
    expect_near("D.x", p, 2 * texel[0] - 1, (double)b.lamp.x, 0.01);
    expect_near("D.y", p, 2 * texel[1] - 1, (double)b.lamp.y, 0.01);
    expect_near("D.z", p, 2 * texel[2] - 1, (double)b.lamp.z, 0.01);
    const double half[2] = {texel[1], (texel[0] - 0.5) * (double)b.m.x + (texel[1] - 0.5) * (double)b.m.y +
                                          (texel[2] - 0.5) * (double)b.m.z + 0.5};
    expect_near("plain", p, half[0] / texel[3], 1, 0.002);
    expect_near("bent", p, half[1] / texel[3], (1 + b.bent) / (1 + b.plain), 0.01);
}

/* Godot's ambient light of normal m, times pi: layers L0, y, z, x from the top. */
static double read_sh(const struct picture *picture, float u, float v, struct lw_vec3 m) {
    const double along[4] = {0, (double)m.y, (double)m.z, (double)m.x};
    double l0 = 0, sum = 0;
    for (uint32_t l = 0; l < 4; l++) {
        const uint32_t height = picture->height / 4;
        const struct picture layer = {picture->rgba + (size_t)l * height * picture->width * 4, picture->width,
                                      height};
        const double texel = sample(&layer, u, v, 0);
        if (!l) l0 = texel;
        sum += l ? (texel - 0.5) * 2 * along[l] * l0 * 4 : texel;
    }
    return M_PI * sum;
}

/* A lamp alone: (1 + 4 d.m) / (1 + 4 d.n), where d.m / d.n is right. */
static void check_sh(void *user, const struct picture *picture, struct lw_vec3 p, float u, float v) {
    const struct bend b = bend_at(p);
    const double e = irradiance_at(p), bent = read_sh(picture, u, v, b.m) / e;
    (void)user;
    expect_near("plain", p, read_sh(picture, u, v, lw_vec3(0, 1, 0)) / e, 1, 0.005);
    expect_near("bent", p, bent, (1 + 4 * b.bent) / (1 + 4 * b.plain), 0.01);
    expect_near("bent, by the lamp", p, bent, b.bent / b.plain,
                fabs(b.plain - b.bent) / (b.plain * (1 + 4 * b.plain)) + 0.01);
}

static void bakes_directions(const char *form, const char *quantity, point_fn *check) {
    const char *squares = save_squares();
    char out[256], glb[256];
    snprintf(out, sizeof out, "%s", lw_support_temporary(form));
    snprintf(glb, sizeof glb, "%s.glb", out);
    assert_int_equal(
        bake("%s -o %s --samples 16 --bounces 0 --direction-form %s --gltf-out %s", squares, out, form, glb),
        0);
    struct lw_scene *scene;
    struct lw_pose pose;
    load_glb(glb, &scene, &pose);
    each_point(scene, &pose, 0, in(out, "directions/square_0.exr"), check, NULL);
    each_point(scene, &pose, 1, in(out, "directions/square_1.exr"), check, NULL);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
    json_t *index = read_index(out), *map = json_array_get(json_object_get(index, "maps"), 1);
    assert_string_equal(json_string_value(json_object_get(index, "direction_form")), form);
    assert_string_equal(json_string_value(json_object_get(map, "directions")), "directions/square_1.exr");
    json_decref(index);
    expect_bytes(in(out, "directions/square_1.exr"), quantity);
    expect_bytes(glb, "directions/square_1.exr");
}

static void dominant_directions_point_at_the_lamp(void **state) {
    (void)state;
    bakes_directions("dominant", "RGB: dominant direction / 2 + 1/2", check_dominant);
}

static void godot_reads_sh(void **state) {
    (void)state;
    bakes_directions("sh", "layers: L0 as E / pi", check_sh);
}

/* ---- refusals ---- */

/* Some 0.6 M texels: 230 MB at once. */
#define LARGE "builtin:cornell --texels-per-metre 150 --threads 2 --bounces 2 --samples 4"

/* The mean over the covered texels of a map of vectors. */
static struct lw_vec3 mean_vector(const char *file, const char *folder) {
    float *rgba;
    uint32_t width, height, count = 0;
    struct lw_error err = {0};
    struct lw_vec3 sum = lw_vec3(0, 0, 0);
    lw_support_ok(lw_image_read_exr_rgba(in(folder, file), &rgba, &width, &height, &err), &err);
    for (size_t i = 0; i < (size_t)width * height * 4; i += 4) {
        if (!(rgba[i + 3] > 0)) continue;
        sum = lw_vec3_add(sum, lw_vec3(rgba[i], rgba[i + 1], rgba[i + 2]));
        count++;
    }
    free(rgba);
    assert_true(count > 0);
    return lw_vec3_scale(sum, 1 / (float)count);
}

static void expect_same_directions(const char *a, const char *b) {
    for (size_t i = 0; i < sizeof cornell_maps / sizeof *cornell_maps; i++) {
        char file[64];
        snprintf(file, sizeof file, "directions/%s", cornell_maps[i]);
        const struct lw_vec3 one = mean_vector(file, a), other = mean_vector(file, b);
        assert_true(i > 0 || one.y > 0.5f); /* the floor has its light from above */
        if (!(lw_vec3_length(lw_vec3_sub(one, other)) < 0.03f))
            fail_msg("%s: (%g, %g, %g) and (%g, %g, %g)", file, (double)one.x, (double)one.y, (double)one.z,
                     (double)other.x, (double)other.y, (double)other.z);
    }
}

static void tile_by_tile_it_is_the_same_light(void **state) {
    (void)state;
    char at_once[256], by_tile[256];
    snprintf(at_once, sizeof at_once, "%s", lw_support_temporary("at-once"));
    snprintf(by_tile, sizeof by_tile, "%s", lw_support_temporary("by-tile"));
    assert_int_equal(bake(LARGE " -o %s --convention radiosity --directional", at_once), 0);
    assert_false(lw_process_said(&process, "tile by tile"));
    assert_int_equal(bake(LARGE " -o %s --convention radiosity --directional --memory 150", by_tile), 0);
    assert_true(lw_process_said(&process, "now tile by tile"));
    expect_finite(by_tile);
    assert_int_not_equal(access(in(by_tile, ".lightwell-bake-tiles"), F_OK), 0);
    for (size_t i = 0; i < sizeof cornell_maps / sizeof *cornell_maps; i++) {
        double mean, other, square;
        compare_maps(cornell_maps[i], by_tile, at_once, &mean, &square);
        compare_maps(cornell_maps[i], at_once, by_tile, &other, &square);
        /* rays end on coarse texels: more light gets over the lamp, to a tenth of the ceiling */
        const double tolerance = strcmp(cornell_maps[i], "ceiling.exr") == 0 ? 0.05 : 0.005;
        if (fabs(mean - other) > tolerance * other || square > 0.05 * other * other)
            fail_msg("%s: %g tile by tile, %g at once; mean square %g", cornell_maps[i], mean, other, square);
    }
    expect_same_directions(by_tile, at_once);
}

/* Killed in the middle, it goes on with the tiles that are finished. */
static void killed_tile_by_tile_it_goes_on(void **state) {
    (void)state;
    char whole[256], parts[256], arguments[512];
    snprintf(whole, sizeof whole, "%s", lw_support_temporary("whole-tiles"));
    snprintf(parts, sizeof parts, "%s", lw_support_temporary("part-tiles"));
    snprintf(arguments, sizeof arguments, LARGE " --memory 100 --denoise --checkpoint 0.1 -o %s", parts);
    lw_process_start(&process, "lightwell-bake", arguments);
    lw_process_await_text(&process, "now tile by tile");
    struct stat st = {.st_size = 0};
    while (stat(in(parts, ".lightwell-bake-tiles"), &st) == 0 && st.st_size < 1000000) lw_process_sleep_ms(5);
    assert_int_equal(lw_process_stop(&process, SIGKILL, LIMIT_S), -SIGKILL);
    assert_int_equal(bake("%s", arguments), 0);
    assert_true(lw_process_said(&process, "going on after"));
    assert_int_equal(bake(LARGE " --memory 100 --denoise -o %s", whole), 0);
    for (size_t i = 0; i < sizeof cornell_maps / sizeof *cornell_maps; i++) { /* but for rounding */
        double mean, square;
        compare_maps(cornell_maps[i], parts, whole, &mean, &square);
        assert_true(square <= 1e-6 * mean * mean);
    }
}

static void wrong_use_is_refused(void **state) {
    (void)state;
    char arguments[512];
    const char *squares = save_squares();
    lw_support_write_file(lw_support_temporary("a-file"), "", 0);
    bake_fails(64, "-o DIR", "builtin:cornell");
    bake_fails(71, "over 1 (--memory)", "builtin:cornell -o x --memory 1");
    bake_fails(71, "cells lights them tile by tile", "builtin:cornell -o x --solver radiosity --memory 1");
    bake_fails(64, "--samples and --error", "builtin:cornell -o x --samples 4 --error 0.1");
    bake_fails(64, "--convention", "builtin:cornell -o x --convention unity");
    bake_fails(64, ".glb", "builtin:cornell -o x --gltf-out room.gltf");
    bake_fails(64, "--gltf-lights", "builtin:cornell -o x --gltf-lights");
    bake_fails(64, "--indirect-only", "builtin:cornell -o x --client-lights auto");
    bake_fails(64, "builtin:cornell has no lamp", "builtin:cornell -o x --indirect-only");
    bake_fails(64, "has no lamp", "builtin:cornell -o x --indirect-only --client-lights none");
    bake_fails(64, "called \"moon\"", "builtin:cornell -o x --indirect-only --client-lights moon");
    bake_fails(64, "for \"radiosity\"", "builtin:cornell -o x --undersample mip");
    bake_fails(64, "--tracing-range", "builtin:cornell -o x --solver radiosity --tracing-range 1");
    bake_fails(64, "--directional", "builtin:cornell -o x --solver radiosity --directional");
    bake_fails(64, "--direction-form: \"unity\" is not one of own|dominant|sh",
               "builtin:cornell -o x --direction-form unity");
    bake_fails(64, "--directional", "builtin:cornell -o x --solver radiosity --direction-form sh");
    bake_fails(64, "needs --undersample", "builtin:cornell -o x --solver radiosity --window 2");
    bake_fails(64, "--directions does not work with --undersample",
               "builtin:cornell -o x --solver radiosity --directions 64 --undersample mip");
    bake_fails(64, "--subdivide", "builtin:cornell -o x --solver radiosity --subdivide 0.1 --directions 64");
    bake_fails(64, "--directions does not work with --keep-visibility",
               "builtin:cornell -o x --solver radiosity --directions 64 --visibility x.pairs");
    bake_fails(64, "emissive surfaces",
               "builtin:cornell -o x --solver radiosity --indirect-only --client-lights auto");
    bake_fails(64, "for \"vpl\"", "builtin:cornell -o x --vpl-sets 4");
    bake_fails(64, "--tracing-range", "builtin:cornell -o x --solver vpl --tracing-range 1");
    bake_fails(64, "--vpl-lights 8", "builtin:cornell -o x --solver vpl --vpl-lights 8 --vpl-sets 4");
    bake_fails(64, "for \"radiosity\"", "builtin:cornell -o x --solver vpl --window 2");
    bake_fails(73, "-o /nowhere/maps: the folder", "builtin:cornell -o /nowhere/maps");
    snprintf(arguments, sizeof arguments, "%s -o %s", squares, lw_support_temporary("a-file"));
    bake_fails(73, "not a folder", arguments);
    snprintf(arguments, sizeof arguments, "%s -o %s --gltf-out /nowhere/room.glb", squares,
             lw_support_temporary("out"));
    bake_fails(73, "--gltf-out: /nowhere/room.glb: there is no folder /nowhere", arguments);
    snprintf(arguments, sizeof arguments, "/nowhere/room.gltf -o %s", lw_support_temporary("out"));
    bake_fails(66, "/nowhere/room.gltf", arguments);
}

static void a_scene_without_light_is_refused(void **state) {
    (void)state;
    char arguments[512];
    struct lw_scene *scene = lw_support_squares(1, 1);
    struct lw_error err = {0};
    scene->light_count = 0;
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 20}, NULL, &err),
                  &err);
    lw_support_ok(lw_package_save(scene, lw_support_temporary("dark.lwscene"), &err), &err);
    lw_scene_destroy(scene);
    snprintf(arguments, sizeof arguments, "%s -o %s", lw_support_temporary("dark.lwscene"),
             lw_support_temporary("dark"));
    bake_fails(65, "--sky", arguments);
    assert_int_equal(bake("%s --samples 1 --sky 1,1,1", arguments), 0);
}

/* The state that cannot be saved is a warning; a map that cannot be written ends the bake, which keeps its
 * state. */
static void a_full_disk_is_reported(void **state) {
    (void)state;
    char out[256], arguments[512];
    const char *squares = save_squares();
    snprintf(out, sizeof out, "%s", lw_support_temporary("full"));
    assert_int_equal(mkdir(out, 0700), 0);
    snprintf(arguments, sizeof arguments, "%s -o %s --samples 2", squares, out);
    assert_int_equal(symlink("/dev/full", in(out, "square_1.exr")), 0);
    bake_fails(74, "/dev/full", arguments);
    assert_int_equal(access(in(out, ".lightwell-bake-state"), F_OK), 0);
    assert_int_equal(unlink(in(out, "square_1.exr")), 0);
    assert_int_equal(bake("%s", arguments), 0);
    assert_true(lw_process_said(&process, "going on after 2"));
}

int main(void) {
#define T(name) cmocka_unit_test_teardown(name, tear_down)
    const struct CMUnitTest tests[] = {
        T(maps_hold_the_light_where_the_glb_says),
        T(indirect_only_leaves_the_lamp_to_the_engine),
        T(a_back_that_is_lit_is_shown),
        T(resumed_is_uninterrupted),
        T(nor_with_one_of_other_finishes),
        T(denoise_takes_noise_and_leaves_light),
        T(an_unfinished_bake_is_not_mixed_with_another),
        T(stopped_early_it_writes_nothing),
        T(limits_end_a_bake_with_what_is_there),
        T(radiosity_bakes_the_same_light),
        T(virtual_lights_bake_the_same_light),
        T(directions_point_at_the_lamp),
        T(dominant_directions_point_at_the_lamp),
        T(godot_reads_sh),
        T(tile_by_tile_it_is_the_same_light),
        T(killed_tile_by_tile_it_goes_on),
        T(wrong_use_is_refused),
        T(a_scene_without_light_is_refused),
        T(a_full_disk_is_reported),
    };
#undef T
    return cmocka_run_group_tests(tests, NULL, NULL);
}
