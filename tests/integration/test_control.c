/* lightwellctl against a real lightwelld: the light after a change is that of a scene which was built so, as
 * the path tracer has it. */
#include "tests/support/process.h"

#include "client/lib/client.h"
#include "common/base/clock.h"
#include "common/builtin/builtin.h"
#include "common/image/image.h"
#include "common/lightmap/lightmap.h"
#include "common/scene/package.h"
#include "common/scene/pose.h"
#include "common/scene/scene.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LIMIT_S LW_PROCESS_LIMIT_S
#define BLOCK   8u /* pixels: means over blocks are compared */
#define CAMERA  "0,0.99,3.4:0,0.99,0:40"

/* Scene files that the tests write. */
enum { BASE, MOVED, HIDDEN, ADDED, BLUE, PAINTED, SCENES };
static char scene_path[SCENES][128];

static const char *scene_file(unsigned which) {
    char name[32];
    snprintf(name, sizeof name, "scene%u.lwscene", which);
    if (!*scene_path[which])
        snprintf(scene_path[which], sizeof scene_path[which], "%s", lw_support_temporary(name));
    return scene_path[which];
}

static struct lw_process server;
static char address[64];
static struct lw_client *viewer; /* a session with everything in its interest, all the time */

/* ---- scenes ---- */

/* The Cornell box with a point light of its own, which an animation carries from left to right within two
 * seconds. */
static struct lw_scene *build_scene(void) {
    static const float times[] = {0, 2}, values[] = {-0.6f, 1.2f, 0.6f, 0.6f, 1.2f, 0.6f};
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    for (uint32_t o = 0; o < scene->object_count; o++) /* the test's command lines know no quotes */
        if (strcmp(scene->object[o].name, "tall block") == 0) scene->object[o].name = "tall-block";
    struct lw_node *node = lw_scene_alloc(scene, scene->node_count + 1, sizeof *node);
    memcpy(node, scene->node, scene->node_count * sizeof *node);
    node[scene->node_count] = (struct lw_node){.name = "bulb",
                                               .parent = LW_SCENE_NONE,
                                               .rotation = {0, 0, 0, 1},
                                               .scale = {1, 1, 1},
                                               .translation = {values[0], values[1], values[2]}};
    scene->node = node;
    scene->light = lw_scene_alloc(scene, 1, sizeof *scene->light);
    scene->light[0] = (struct lw_light){
        .name = "bulb", .node = scene->node_count, .kind = LW_LIGHT_POINT, .intensity = {0.5f, 0.5f, 0.5f}};
    scene->channel = lw_scene_alloc(scene, 1, sizeof *scene->channel);
    scene->channel[0] = (struct lw_channel){.node = scene->node_count,
                                            .path = LW_CHANNEL_TRANSLATION,
                                            .interpolation = LW_INTERPOLATION_LINEAR,
                                            .key_count = 2,
                                            .time_s = times,
                                            .value = values};
    scene->node_count++;
    scene->light_count = scene->channel_count = 1;
    scene->duration_s = 2;
    return scene;
}

/* Takes the scene over. */
static void write_scene(struct lw_scene *scene, const char *path) {
    struct lw_error err = {0};
    uint8_t *bytes;
    size_t size;
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 8}, NULL, &err),
                  &err);
    lw_support_ok(lw_package_write(scene, &bytes, &size, &err), &err);
    lw_support_write_file(path, bytes, size);
    free(bytes);
    lw_scene_destroy(scene);
}

static void write_without_block(void) {
    struct lw_scene *scene = build_scene();
    const uint32_t block = lw_support_object(scene, "tall-block");
    scene->object[block] = scene->object[--scene->object_count];
    write_scene(scene, scene_file(HIDDEN));
}

/* With a second block beside the first one. Writes where its middle is, and the mesh that it is of. */
static void write_with_two_blocks(struct lw_vec3 by, struct lw_vec3 *out_middle, uint32_t *out_mesh) {
    struct lw_scene *scene = build_scene();
    const uint32_t block = lw_support_object(scene, "tall-block");
    struct lw_node *node = lw_scene_alloc(scene, scene->node_count + 1, sizeof *node);
    struct lw_object *object = lw_scene_alloc(scene, scene->object_count + 1, sizeof *object);
    memcpy(node, scene->node, scene->node_count * sizeof *node);
    memcpy(object, scene->object, scene->object_count * sizeof *object);
    node[scene->node_count] = node[object[block].node];
    node[scene->node_count].name = "second";
    node[scene->node_count].translation[0] += by.x;
    node[scene->node_count].translation[1] += by.y;
    node[scene->node_count].translation[2] += by.z;
    object[scene->object_count] = object[block];
    object[scene->object_count].node = scene->node_count;
    scene->node = node;
    scene->object = object;
    scene->node_count++;
    scene->object_count++;
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    const struct lw_mesh *mesh = &scene->mesh[object[block].mesh];
    struct lw_vec3 low = mesh->position[0], high = low;
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        const struct lw_vec3 p = mesh->position[i];
        low = lw_vec3(fminf(low.x, p.x), fminf(low.y, p.y), fminf(low.z, p.z));
        high = lw_vec3(fmaxf(high.x, p.x), fmaxf(high.y, p.y), fmaxf(high.z, p.z));
    }
    *out_middle = lw_affine_point(&pose.object_to_world[scene->object_count - 1],
                                  lw_vec3_scale(lw_vec3_add(low, high), 0.5f));
    *out_mesh = object[block].mesh;
    lw_pose_finish(&pose);
    write_scene(scene, scene_file(ADDED));
}

/* ---- programs ---- */

static int run(const char *program, const char *arguments, char **out_said) {
    struct lw_process p;
    lw_process_start(&p, program, arguments);
    int code = lw_process_finish(&p, LIMIT_S);
    char *said = lw_process_out(&p), *err = lw_process_err(&p);
    if (code != 0) print_message("%s %s: %d: %s", program, arguments, code, err);
    if (out_said)
        *out_said = code ? err : said;
    else
        free(code ? err : said);
    free(code ? said : err);
    return code;
}

static int ctl(const char *commands, char **out_said) {
    char arguments[512];
    snprintf(arguments, sizeof arguments, "%s %s", address, commands);
    return run("lightwellctl", arguments, out_said);
}

static struct lw_client_stats poll_viewer(unsigned ms) {
    struct lw_client_stats stats;
    struct lw_error err = {0};
    lw_support_ok(lw_client_poll(viewer, ms, &err), &err);
    lw_client_get_stats(viewer, &stats);
    return stats;
}

/* Makes a change and waits until the viewer has heard of it. */
static void change(const char *commands) {
    char *said;
    unsigned long long frame = 0;
    assert_int_equal(ctl(commands, &said), 0);
    assert_int_equal(sscanf(said, "frame %llu", &frame), 1);
    free(said);
    const uint64_t limit_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
    while (poll_viewer(50).frame < frame) assert_true(lw_clock_ns() < limit_ns);
}

static float *picture(const char *arguments, const char *file, uint32_t *out_width, uint32_t *out_height) {
    char all[512];
    float *rgb;
    struct lw_error err = {0};
    snprintf(all, sizeof all, "%s --camera " CAMERA " --size 64x48 --out %s", arguments,
             lw_support_temporary(file));
    assert_int_equal(run("lightwell-view", all, NULL), 0);
    lw_support_ok(lw_image_read_exr(lw_support_temporary(file), &rgb, out_width, out_height, &err), &err);
    return rgb;
}

static double block_mean(const float *rgb, uint32_t width, uint32_t x, uint32_t y, uint32_t c) {
    double sum = 0;
    for (uint32_t j = 0; j < BLOCK; j++)
        for (uint32_t i = 0; i < BLOCK; i++) sum += (double)rgb[3 * ((y + j) * width + x + i) + c];
    return sum / (BLOCK * BLOCK);
}

struct image {
    float *rgb;
    uint32_t width, height;
};

static struct image live_picture(void) {
    char live[128];
    struct image image;
    snprintf(live, sizeof live, "%s --headless --wait complete --samples-per-pixel 1 --timeout %d", address,
             LIMIT_S);
    image.rgb = picture(live, "live.exr", &image.width, &image.height);
    return image;
}

static struct image path_traced(const char *scene, double time_s) {
    char reference[256];
    struct image image;
    snprintf(reference, sizeof reference, "--path-trace %s --time %g --spp 64 --bounces 2 --pixel centre",
             scene, time_s);
    image.rgb = picture(reference, "reference.exr", &image.width, &image.height);
    return image;
}

/* How far the daemon's picture is from the reference, over blocks, relative to the reference's mean: root
 * mean square. */
static double difference(const struct image *reference) {
    struct image live = live_picture();
    assert_true(live.width == reference->width && live.height == reference->height);
    double square = 0, mean = 0, count = 0;
    for (uint32_t y = 0; y < live.height; y += BLOCK)
        for (uint32_t x = 0; x < live.width; x += BLOCK)
            for (uint32_t c = 0; c < 3; c++) {
                const double p = block_mean(live.rgb, live.width, x, y, c),
                             q = block_mean(reference->rgb, live.width, x, y, c);
                square += (p - q) * (p - q);
                mean += q;
                count++;
            }
    free(live.rgb);
    if (!(mean > 0)) return sqrt(square / count);
    return sqrt(square / count) / (mean / count);
}

/* The mean of the daemon's picture. */
static double brightness(void) {
    struct image live = live_picture();
    double sum = 0;
    for (size_t i = 0; i < (size_t)live.width * live.height * 3; i++) sum += (double)live.rgb[i];
    free(live.rgb);
    return sum / (live.width * live.height * 3.0);
}

/* Looks until the picture is that near, and returns how near it is then. What only this picture shows is lit
 * from when it is asked for. */
static double wait_until_near(const struct image *reference, double near) {
    for (const uint64_t limit_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;;) {
        const double now = difference(reference);
        if (now < near) return now;
        if (lw_clock_ns() > limit_ns) fail_msg("%.4f off after %u s, not %.4f", now, LIMIT_S, near);
    }
}

/* Looks until all light but a rest that dies away has gone. */
static void wait_until_dark(double lit) {
    for (const uint64_t limit_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;;) {
        const double dark = brightness();
        assert_true(dark >= 0);
        if (dark < 0.02 * lit) return;
        if (lw_clock_ns() > limit_ns) fail_msg("mean with light %.4f, without %.2g", lit, dark);
    }
}

/* The change has arrived if the picture is near that of the new scene and was far from it before. */
static void expect_change(const char *commands, const char *scene, double time_s) {
    struct image reference = path_traced(scene, time_s);
    const double before = difference(&reference);
    change(commands);
    const double after = wait_until_near(&reference, 0.035 + 0.01 * before); /* noise, and the light before */
    print_message("%s: %.4f before, %.4f after\n", commands, before, after);
    assert_true(before > 2 * after);
    free(reference.rgb);
}

static int start_all(void **state) {
    (void)state;
    struct lw_error err = {0};
    char arguments[256];
    write_scene(build_scene(), scene_file(BASE));
    snprintf(arguments, sizeof arguments, "%s --freeze 0 --frame-rate 1000 --threads 1 --spares 1",
             scene_file(BASE));
    lw_process_serve(&server, arguments);
    snprintf(address, sizeof address, "127.0.0.1:%u", server.port);
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = server.port}, &viewer, &err),
        &err);
    return 0;
}

static int stop_all(void **state) {
    (void)state;
    lw_client_destroy(viewer);
    int code = server.pid ? lw_process_stop(&server, SIGTERM, LIMIT_S) : 0;
    lw_process_kill_all();
    return code;
}

static void ctl_fails(const char *commands, int code, const char *text) {
    char *said;
    assert_int_equal(ctl(commands, &said), code);
    if (!strstr(said, text)) fail_msg("%s: %s", commands, said);
    assert_string_equal(strchr(said, '\n'), "\n"); /* one line */
    free(said);
}

/* ---- tests ---- */

static void test_objects(void **state) {
    (void)state;
    struct image reference = path_traced(scene_file(BASE), 0);
    change("reset");
    wait_until_near(&reference, 0.03);
    free(reference.rgb);
    struct lw_scene *scene = build_scene();
    const uint32_t block = lw_support_object(scene, "tall-block");
    scene->node[scene->object[block].node].translation[0] += 0.5f;
    scene->node[scene->object[block].node].translation[1] += 0.4f;
    write_scene(scene, scene_file(MOVED));
    expect_change("shift tall-block 0.5 0.4 0", scene_file(MOVED), 0);
    write_without_block(); /* the place where it stood is lit as if it had never been there */
    expect_change("hide tall-block", scene_file(HIDDEN), 0);
    expect_change("restore tall-block", scene_file(BASE), 0);
}

/* An added object is lit as if it were there from the start, and a removed one leaves nothing behind. */
static void test_added_and_removed(void **state) {
    (void)state;
    char commands[128], *said;
    struct lw_vec3 at;
    uint32_t mesh;
    change("reset");
    write_with_two_blocks(lw_vec3(0.9f, 0.3f, 0.2f), &at, &mesh);
    write_without_block();
    snprintf(commands, sizeof commands, "add #%u %.6f %.6f %.6f", mesh, (double)at.x, (double)at.y,
             (double)at.z);
    expect_change(commands, scene_file(ADDED), 0);
    ctl_fails(commands, 65, "no spare of this mesh is left");
    assert_int_equal(ctl("list", &said), 0);
    assert_non_null(strstr(said, "tall block#1"));
    assert_non_null(strstr(said, "objects 2, spares 0"));
    free(said);
    const uint32_t spare = lw_client_scene(viewer)->object_count - lw_client_scene(viewer)->mesh_count + mesh;
    snprintf(commands, sizeof commands, "remove #%u", spare);
    expect_change(commands, scene_file(BASE), 0);
    ctl_fails(commands, 65, "stands nowhere");
    expect_change("remove tall-block", scene_file(HIDDEN), 0);
    ctl_fails("hide tall-block", 65, "stands nowhere");
    expect_change("reset", scene_file(BASE), 0);
    const double lit = brightness();
    change("remove lamp -- light bulb off"); /* the last of what shines */
    wait_until_dark(lit);
    change("reset");
}

static void test_lights(void **state) {
    (void)state;
    change("reset");
    struct lw_scene *scene = build_scene();
    scene->light[0].intensity[0] = 0;
    scene->light[0].intensity[2] = 1.5f;
    write_scene(scene, scene_file(BLUE));
    expect_change("light bulb intensity 0 0.5 1.5", scene_file(BLUE), 0);
    const double lit = brightness();
    change("light bulb off -- material lamp emission 0 0 0"); /* the last light is out */
    wait_until_dark(lit);                                     /* as the light of old is forgotten */
    expect_change("light bulb on -- material lamp restore", scene_file(BASE), 0);
}

static void test_materials_and_sky(void **state) {
    (void)state;
    change("reset");
    struct lw_scene *scene = build_scene();
    memcpy(lw_support_material(scene, "red")->base_colour, (float[]){0.1f, 0.2f, 0.8f}, sizeof(float[3]));
    memcpy(lw_support_material(scene, "green")->emission, (float[]){0, 1, 2}, sizeof(float[3]));
    memcpy(scene->sky, (float[]){0.5f, 0.25f, 0.125f}, sizeof(float[3]));
    write_scene(scene, scene_file(PAINTED));
    expect_change("material red albedo 0.1 0.2 0.8 -- material green emission 0 1 2 -- sky 0.5 0.25 0.125",
                  scene_file(PAINTED), 0);
    expect_change("reset", scene_file(BASE), 0);
}

static void test_clock(void **state) {
    (void)state;
    change("reset");
    expect_change("clock seek 1.5", scene_file(BASE), 1.5);
    assert_true(lw_client_get_light(viewer, 0).position_ws.x > 0.29f);
    assert_int_equal(ctl("clock rate 0.5 -- clock play", NULL), 0);
    const double from_s = poll_viewer(200).time_s;
    double to_s = from_s;
    for (int i = 0; i < 100 && to_s == from_s; i++) to_s = poll_viewer(50).time_s;
    assert_true(to_s != from_s);
    change("clock pause -- clock seek 0"); /* and no frame comes any more */
    assert_true(poll_viewer(0).time_s == 0);
}

static void test_bad_input(void **state) {
    (void)state;
    change("reset");
    const struct lw_affine before = *lw_client_object_to_world(viewer, 1);
    ctl_fails("hide tall-blok", 64, "near are \"tall-block\" (#");
    ctl_fails("hide #99", 64, "there is no object #99");
    ctl_fails("light bulb dim", 64, "say light NAME on|off");
    ctl_fails("move #0 1 2", 64, "say move NAME X Y Z");
    ctl_fails("move #0 1 2 x", 64, "\"x\" is not a number");
    ctl_fails("dance", 64, "there is no command \"dance\"");
    ctl_fails("hide #0 -- dance", 64, "there is no command \"dance\"");
    /* what the server judges: nothing of the whole is done */
    ctl_fails("hide #0 -- move #1 nan 0 0", 65, "command 2: OBJECT_TRANSFORM 1: a value is not finite");
    ctl_fails("move #1 inf 0 0", 65, "not finite");
    ctl_fails("hide #0 -- shift #1 1e9 0 0", 65, "1e8 m");
    ctl_fails("hide #0 -- scale #1 0", 65, "command 2: OBJECT_TRANSFORM 1: scaled to under 1e-6");
    ctl_fails("material red albedo 2 0 0", 65, "not from 0 to 1");
    ctl_fails("clock seek -1", 65, "1e9 s");
    assert_int_equal(ctl("clock pause", NULL), 0); /* which the viewer hears of before what follows */
    for (int i = 0; i < 5; i++) (void)poll_viewer(100);
    assert_memory_equal(lw_client_object_to_world(viewer, 1), &before, sizeof before);
    for (uint32_t o = 0; o < lw_client_scene(viewer)->object_count; o++)
        assert_int_not_equal(lw_client_object_state(viewer, o), LW_CLIENT_OBJECT_HIDDEN);
}

static struct lw_client *join_control(void) {
    struct lw_client *client;
    struct lw_error err = {0};
    lw_support_ok(lw_client_create(
                      &(struct lw_client_desc){
                          .host = "127.0.0.1", .port = server.port, .wants_nothing = true, .control = true},
                      &client, &err),
                  &err);
    assert_true(lw_client_may_update(client));
    return client;
}

/* As fast as they go, contradicting each other: each is answered, in order, and the last one holds. */
static void test_a_thousand_updates(void **state) {
    (void)state;
    struct lw_client *client = join_control();
    struct lw_error err = {0};
    assert_false(lw_client_may_update(viewer));
    lw_support_fails(lw_client_update(viewer, NULL, 0, NULL, &err), LW_UNAVAILABLE, &err, "no updates");
    uint64_t sent = 0, answered = 0, frame = 0;
    while (answered < 2500) {
        struct lw_client_answer answer;
        err = (struct lw_error){0};
        const struct lw_scene_change change = {
            .kind = sent % 2 ? LW_SCENE_CHANGE_OBJECT_SHOW : LW_SCENE_CHANGE_OBJECT_HIDE, .target = 6};
        enum lw_status status = sent < 2500 ? lw_client_update(client, &change, 1, &sent, &err) : LW_OK;
        if (status == LW_OK && sent < 2500) continue;
        if (status != LW_OK) assert_int_equal(status, LW_TIMED_OUT);
        err = (struct lw_error){0};
        lw_support_ok(lw_client_poll(client, 50, &err), &err);
        while (lw_client_next_answer(client, &answer)) {
            assert_int_equal(answer.request, ++answered);
            assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
            assert_true(answer.frame >= frame);
            frame = answer.frame;
        }
    }
    lw_client_destroy(client);
    struct lw_client_stats stats = poll_viewer(50);
    for (int i = 0; i < 200 && stats.frame < frame; i++) stats = poll_viewer(50);
    assert_true(stats.frame >= frame);
    assert_false(lw_client_object_hidden(viewer, 6));
}

/* A change, and the code of its refusal; LW_SCENE_CHANGE_OK where it is fine. */
static const struct {
    struct lw_scene_change change;
    enum lw_scene_change_code code;
} sorted_out[] = {
    {{LW_SCENE_CHANGE_OBJECT_HIDE, 6, 0, {0}}, LW_SCENE_CHANGE_OK},
    {{LW_SCENE_CHANGE_OBJECT_HIDE, 4711, 0, {0}}, LW_SCENE_CHANGE_UNKNOWN_TARGET},
    {{LW_SCENE_CHANGE_LIGHT_INTENSITY, 1, 3, {1, 1, 1}}, LW_SCENE_CHANGE_UNKNOWN_TARGET},
    {{4711, 0, 0, {0}}, LW_SCENE_CHANGE_UNKNOWN_KIND},
    {{LW_SCENE_CHANGE_OBJECT_TRANSFORM, 1, 12, {1, 0, 0, NAN, 0, 1, 0, 0, 0, 0, 1, 0}},
     LW_SCENE_CHANGE_NOT_FINITE},
    {{LW_SCENE_CHANGE_OBJECT_TRANSFORM, 1, 12, {1, 0, 0, 0, 0, INFINITY, 0, 0, 0, 0, 1, 0}},
     LW_SCENE_CHANGE_NOT_FINITE},
    {{LW_SCENE_CHANGE_OBJECT_TRANSFORM, 1, 12, {0}}, LW_SCENE_CHANGE_DEGENERATE},
    {{LW_SCENE_CHANGE_OBJECT_TRANSFORM, 1, 12, {1, 0, 0, 1e9f, 0, 1, 0, 0, 0, 0, 1, 0}},
     LW_SCENE_CHANGE_OUT_OF_RANGE},
    {{LW_SCENE_CHANGE_OBJECT_SHOW, 6, 0, {0}}, LW_SCENE_CHANGE_OK},
    {{LW_SCENE_CHANGE_SKY, 0, 2, {0}}, LW_SCENE_CHANGE_VALUE_COUNT},
};
#define SORTED_OUT (sizeof sorted_out / sizeof *sorted_out)

/* A controller that sends right and wrong updates alternately; request i + 1 is the i-th. */
struct sender {
    struct lw_client *client;
    uint64_t sent, refused, done; /* the last ones answered so */
    uint64_t answers, frame;
};

static void send_one(struct sender *s) {
    struct lw_error err = {0};
    lw_support_ok(lw_client_update(s->client, &sorted_out[s->sent % SORTED_OUT].change, 1, NULL, &err), &err);
    s->sent++;
}

/* Refusals come at once, the others with their frames: each kind in the order of the requests. */
static void take_answers(struct sender *s) {
    struct lw_error err = {0};
    struct lw_client_answer answer;
    lw_support_ok(lw_client_poll(s->client, 20, &err), &err);
    for (; lw_client_next_answer(s->client, &answer); s->answers++) {
        assert_int_equal(answer.code, sorted_out[(answer.request - 1) % SORTED_OUT].code);
        uint64_t *last = answer.code ? &s->refused : &s->done;
        assert_true(answer.request > *last);
        *last = answer.request;
        assert_int_equal(answer.frame == 0, answer.code != 0);
        assert_int_equal(answer.text[0] == 0, answer.code == 0);
        if (answer.code) continue;
        assert_true(answer.frame >= s->frame);
        s->frame = answer.frame;
    }
}

/* Two at once, each of them against the other and half of it nonsense: nothing is lost, and who only looks
 * sees frames. */
static void test_bad_updates_among_good_ones(void **state) {
    (void)state;
    change("reset");
    struct sender sender[2] = {{.client = join_control()}, {.client = join_control()}};
    const uint64_t each = 1000;
    const struct lw_client_stats before = poll_viewer(0);
    const struct lw_affine place = *lw_client_object_to_world(viewer, 1);
    for (uint64_t i = 0; i < each; i++) {
        send_one(&sender[0]);
        send_one(&sender[1]);
    }
    const uint64_t limit_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
    while (sender[0].answers < each || sender[1].answers < each) {
        take_answers(&sender[0]);
        take_answers(&sender[1]);
        (void)poll_viewer(0);
        assert_true(lw_clock_ns() < limit_ns);
    }
    const uint64_t last = sender[0].frame > sender[1].frame ? sender[0].frame : sender[1].frame;
    struct lw_client_stats stats = poll_viewer(0);
    while (stats.frame < last) {
        stats = poll_viewer(50);
        assert_true(lw_clock_ns() < limit_ns);
    }
    assert_true(stats.frames > before.frames);
    assert_false(lw_client_object_hidden(viewer, 6)); /* both end with showing it */
    assert_memory_equal(lw_client_object_to_world(viewer, 1), &place, sizeof place);
    lw_client_destroy(sender[0].client);
    lw_client_destroy(sender[1].client);
}

/* As far and as small as a change may make things: they are as good as gone, and come back. */
static void test_extremes(void **state) {
    (void)state;
    change("reset");
    write_without_block();
    expect_change("shift tall-block 9.9e7 0 0", scene_file(HIDDEN), 0);
    expect_change("restore tall-block", scene_file(BASE), 0);
    expect_change("scale tall-block 2e-6", scene_file(HIDDEN), 0);
    expect_change("restore tall-block", scene_file(BASE), 0);
}

static void test_batch_and_list(void **state) {
    (void)state;
    char *said;
    change("reset");
    assert_int_equal(ctl("hide #2 -- material #0 albedo 0.5 0.5 0.5 -- light bulb off --json", &said), 0);
    assert_non_null(strstr(said, "\"code\": 0"));
    assert_non_null(strstr(said, "\"changes\": 3"));
    free(said);
    assert_int_equal(ctl("list", &said), 0);
    assert_non_null(strstr(said, "object   #2     back wall"));
    assert_non_null(strstr(said, ", hidden"));
    assert_non_null(strstr(said, "albedo 0.5 0.5 0.5"));
    assert_non_null(strstr(said, "point, intensity 0 0 0"));
    assert_non_null(strstr(said, "camera   #0     main"));
    free(said);
    assert_int_equal(ctl("list --json", &said), 0);
    assert_non_null(strstr(said, "\"hidden\": true"));
    free(said);
    change("reset");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_objects),
        cmocka_unit_test(test_added_and_removed),
        cmocka_unit_test(test_lights),
        cmocka_unit_test(test_materials_and_sky),
        cmocka_unit_test(test_clock),
        cmocka_unit_test(test_bad_input),
        cmocka_unit_test(test_a_thousand_updates),
        cmocka_unit_test(test_bad_updates_among_good_ones),
        cmocka_unit_test(test_extremes),
        cmocka_unit_test(test_batch_and_list),
    };
    return cmocka_run_group_tests(tests, start_all, stop_all);
}
