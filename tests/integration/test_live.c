/* The interface lightwell.h against the real daemon: opening, the scene and its parts, changes. */
#include "tests/integration/live_daemon.h"

#include "client/lib/live_state.h"

#include <arpa/inet.h>
#include <math.h>
#include <netinet/in.h>
#include <signal.h>
#include <stdio.h>
#include <sys/socket.h>
#include <unistd.h>

/* ---- before the first light ---- */

struct heard {
    enum lw_live_waiting stage;
    float share;
};

/* Stages of the wait, which goes on: never an earlier stage, nor less of one. */
static struct heard hear(struct heard before) {
    struct heard now;
    ok(lw_live_poll(live, 20, &err));
    now.stage = lw_live_get_waiting(live, &now.share);
    assert_true(now.stage >= before.stage);
    assert_true(now.share >= 0 && now.share <= 1);
    if (now.stage == before.stage) assert_true(now.share >= before.share);
    return now;
}

/* The manual clock holds the server before its first frame: all of its work before that is done by then. Who
 * comes then hears so at once; with the frame the wait is over. */
static void test_waits_for_the_first_light(void **state) {
    (void)state;
    struct lw_process daemon;
    struct lw_live_desc desc = {.struct_size = sizeof desc, .name = "test_live"};
    struct heard heard = {LW_LIVE_WAITING_UNKNOWN, 0};
    lw_process_serve_by_hand(&daemon, "builtin:cornell --texels-per-metre 40 --light whole --error 0.5");
    desc.port = daemon.port;
    assert_int_equal(lw_live_get_waiting(NULL, NULL), LW_LIVE_WAITING_UNKNOWN);
    for (int client = 0; client < 2; client++) {
        lw_live_close(live);
        ok(lw_live_open(&desc, &live, &err));
        assert_int_equal(lw_live_get_waiting(live, &heard.share), LW_LIVE_WAITING_UNKNOWN);
        heard = (struct heard){LW_LIVE_WAITING_UNKNOWN, 0};
        while (heard.stage == LW_LIVE_WAITING_UNKNOWN) heard = hear(heard);
        assert_true(heard.stage <= LW_LIVE_WAITING_LOOKING_INSIDE);
        if (client) assert_true(heard.stage == LW_LIVE_WAITING_LOOKING_INSIDE && heard.share == 1);
        while (heard.stage < LW_LIVE_WAITING_LOOKING_INSIDE || heard.share < 1) heard = hear(heard);
        assert_int_equal(heard.stage, LW_LIVE_WAITING_LOOKING_INSIDE);
    }
    assert_false(stats().frame);
    lw_process_step(&daemon, 1);
    while (heard.stage != LW_LIVE_WAITING_READY) heard = hear(heard);
    assert_true(heard.share == 1);
    while (!stats().has_light) heard = hear(heard);
    assert_string_equal(lw_live_waiting_text(heard.stage), "ready");
    assert_string_equal(lw_live_waiting_text(LW_LIVE_WAITING_LOOKING_INSIDE), "looking inside objects");
    lw_live_close(live);
    ok(lw_live_open(&desc, &live, &err)); /* a client that comes now gets light without a wait */
    heard = (struct heard){LW_LIVE_WAITING_UNKNOWN, 0};
    while (heard.stage == LW_LIVE_WAITING_UNKNOWN) heard = hear(heard);
    assert_int_equal(heard.stage, LW_LIVE_WAITING_READY);
    assert_true(stats().frame > 0);
}

/* ---- wrong arguments ---- */

static void test_refuses(void **state) {
    (void)state;
    struct lw_live_desc desc = {.port = 1};
    fails(lw_live_open(&desc, &live, &err), LW_LIVE_USAGE, "struct_size");
    desc.struct_size = sizeof desc;
    desc.token = "0123";
    fails(lw_live_open(&desc, &live, &err), LW_LIVE_USAGE, "token is not 64 hexadecimal digits");
    desc.struct_size =
        offsetof(struct lw_live_desc, token); /* an older caller's size: then nobody reads it */
    fails(lw_live_open(&desc, &live, &err), LW_LIVE_UNAVAILABLE, "127.0.0.1:1");
    desc.token = NULL;
    desc.struct_size = sizeof desc - 1;
    fails(lw_live_open(&desc, &live, &err), LW_LIVE_USAGE, "struct_size");
    fails(lw_live_open(NULL, &live, &err), LW_LIVE_USAGE, "struct_size");
    desc.struct_size = sizeof desc;
    fails(lw_live_open(&desc, NULL, &err), LW_LIVE_USAGE, "out_live");
    fails(lw_live_open(&desc, &live, &err), LW_LIVE_UNAVAILABLE, "127.0.0.1:1");
    desc.flags = 1u << 20;
    fails(lw_live_open(&desc, &live, &err), LW_LIVE_USAGE, "flags has 0x100000");
    assert_null(live);
    assert_int_equal(lw_live_open(&desc, &live, NULL), LW_LIVE_USAGE);
    fails(lw_live_poll(NULL, 0, &err), LW_LIVE_USAGE, "NULL");
    for (int s = LW_LIVE_OK; s <= LW_LIVE_OTHER_SCENE; s++)
        assert_string_not_equal(lw_live_status_text((enum lw_live_status)s), "unknown status");
    assert_string_equal(lw_live_status_text((enum lw_live_status)99), "unknown status");
    assert_string_equal(lw_live_version(), LW_VERSION);
    lw_live_close(NULL);
}

static void test_before_the_scene(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, RESTS);
    struct lw_live_desc desc = {.struct_size = sizeof desc, .port = daemon.port};
    ok(lw_live_open(&desc, &live, &err));
    struct lw_live_scene scene = {.struct_size = sizeof scene};
    struct lw_live_rect rect = {.width = 1, .height = 1};
    struct lw_live_texels texels = {.struct_size = sizeof texels};
    float rgb[3] = {0};
    fails(lw_live_get_scene(live, &scene, &err), LW_LIVE_NOT_READY, "scene");
    fails(lw_live_read(live, &rect, &texels, &err), LW_LIVE_NOT_READY, "scene");
    fails(lw_live_sample(live, 0, rgb, rgb, &err), LW_LIVE_NOT_READY, "scene");
    fails(lw_live_want_rects(live, &rect, 1, &err), LW_LIVE_NOT_READY, "scene");
    ok(lw_live_want_rects(live, NULL, 0, &err));
    assert_int_equal(lw_live_find(live, LW_LIVE_KIND_MESH, "room", 0), LW_LIVE_NONE);
    assert_int_equal(lw_live_take_dirty(live, LW_LIVE_NONE, LW_LIVE_NONE, 0, &rect, 1), 0);
    assert_false(stats().has_scene);
    assert_true(stats().is_connected);
}

/* ---- the scene ---- */

static void test_names_and_things(void **state) {
    (void)state;
    open_live(still_daemon()->port, LW_LIVE_DRAWS_DIRECT);
    struct lw_live_scene scene = {.struct_size = sizeof scene};
    ok(lw_live_get_scene(live, &scene, &err));
    const struct lw_scene *own = live->scene;
    assert_int_equal(scene.object_count, own->object_count);
    for (uint32_t o = 0; o < scene.object_count; o++) {
        struct lw_live_object object = {.struct_size = sizeof object};
        ok(lw_live_get_object(live, o, &object, &err));
        assert_true(object.is_drawn && object.state == LW_LIVE_OBJECT_SHOWN && object.level_count > 0);
        /* the same name may come more than once: all of them are found, in order */
        uint32_t nth = 0, before = LW_LIVE_NONE, found;
        bool is_found = false;
        while ((found = lw_live_find(live, LW_LIVE_KIND_OBJECT, object.name, nth)) != LW_LIVE_NONE) {
            assert_true(nth == 0 || found > before);
            assert_string_equal(own->object[found].name, object.name);
            is_found |= found == o;
            before = found;
            nth++;
        }
        assert_true(is_found);
        struct lw_live_mesh mesh = {.struct_size = sizeof mesh};
        ok(lw_live_get_mesh(live, object.mesh, &mesh, &err));
        assert_ptr_equal(mesh.triangle, own->mesh[object.mesh].triangle);
        assert_true(mesh.atlas_width > 0 && mesh.lightmap_uv);
        struct lw_live_node node = {.struct_size = sizeof node};
        ok(lw_live_get_node(live, object.node, &node, &err));
        assert_string_equal(node.name, own->node[object.node].name);
    }
    assert_int_equal(lw_live_find(live, LW_LIVE_KIND_CAMERA, "main", 0), 0);
    assert_int_equal(lw_live_find(live, LW_LIVE_KIND_CAMERA, "main", 1), LW_LIVE_NONE);
    assert_int_equal(lw_live_find(live, LW_LIVE_KIND_CAMERA, "mai", 0), LW_LIVE_NONE);
    assert_int_equal(lw_live_find(live, (enum lw_live_kind)7, "main", 0), LW_LIVE_NONE);
    bool any_light = false, any_shines = false;
    for (uint32_t l = 0; l < scene.light_count; l++) {
        struct lw_live_light light = {.struct_size = sizeof light};
        ok(lw_live_get_light(live, l, &light, &err));
        any_light |= light.is_client_light;
    }
    for (uint32_t m = 0; m < scene.material_count; m++) {
        struct lw_live_material material = {.struct_size = sizeof material};
        ok(lw_live_get_material(live, m, &material, &err));
        assert_int_equal(lw_live_find(live, LW_LIVE_KIND_MATERIAL, material.name, 0), m);
        any_shines |= material.emission[0] > 0;
    }
    assert_true(any_light && any_shines);
    struct lw_live_camera camera = {.struct_size = sizeof camera};
    ok(lw_live_get_camera(live, 0, &camera, &err));
    assert_true(fabsf(camera.position_ws[0] + 11.2f) < 1e-3f && fabsf(camera.up_ws[1]) > 0.9f);
    struct lw_live_texture texture = {.struct_size = sizeof texture};
    for (uint32_t t = 0; t < scene.texture_count; t++) ok(lw_live_get_texture(live, t, &texture, &err));
    fails(lw_live_get_texture(live, scene.texture_count, &texture, &err), LW_LIVE_USAGE, "texture");
    fails(lw_live_get_object(live, 9999, &(struct lw_live_object){.struct_size = 1000}, &err), LW_LIVE_USAGE,
          "object 9999");
    fails(lw_live_get_camera(live, 0, &(struct lw_live_camera){0}, &err), LW_LIVE_USAGE, "struct_size");
}

/* A program that was built with a newer header has structs that end later: what it added stays as it was. */
/* A matt scene until its finishes come; for who wants them alone. */
static void test_finishes(void **state) {
    (void)state;
    struct lw_process daemon;
    char arguments[512];
    snprintf(arguments, sizeof arguments, "%s --clock step --bounces 0 --error 0.5",
             lw_support_source("tests/fuzz/corpus/fuzz_package/finishes"));
    lw_process_serve(&daemon, arguments);
    struct lw_live_material material = {.struct_size = sizeof material};
    struct lw_live_mesh mesh = {.struct_size = sizeof mesh};
    struct lw_live_texture texture = {.struct_size = sizeof texture};
    struct lw_live_scene scene = {.struct_size = sizeof scene};
    const uint32_t flags[] = {0, LW_LIVE_MATERIALS, LW_LIVE_MATERIALS | LW_LIVE_THREAD};
    for (int i = 0; i < 3; i++) {
        open_live(daemon.port, flags[i]);
        if (!i) {
            assert_int_equal(stats().finishes, LW_LIVE_FINISHES_NONE);
            ok(lw_live_get_material(live, 1, &material, &err));
            assert_false(material.has_finish);
            fails(lw_live_get_finish_texture(live, 0, &texture, &err), LW_LIVE_USAGE, "of finishes 0 of 0");
            lw_live_close(live);
            continue;
        }
        const uint64_t end_ns = lw_clock_ns() + LIMIT_NS;
        while (stats().finishes != LW_LIVE_FINISHES_THERE) {
            assert_true(lw_clock_ns() < end_ns);
            ok(lw_live_poll(live, 20, &err));
        }
        ok(lw_live_get_material(live, 1, &material, &err));
        assert_true(material.has_finish && material.roughness == 0.5f && material.normal_scale == -1.5f);
        assert_int_equal(material.normal_texture.texture, 0);
        assert_int_equal(material.specular_texture.texture, LW_LIVE_NONE);
        ok(lw_live_get_material(live, 0, &material, &err));
        assert_false(material.has_finish);
        ok(lw_live_get_mesh(live, 0, &mesh, &err));
        assert_non_null(mesh.tangent);
        float tangent[4];
        lw_live_tangent(mesh.tangent[1], mesh.normal, tangent);
        assert_true(tangent[3] == -1);
        assert_true(fabsf(tangent[0] * mesh.normal[0] + tangent[1] * mesh.normal[1] +
                          tangent[2] * mesh.normal[2]) < 1e-4f);
        ok(lw_live_get_scene(live, &scene, &err));
        assert_int_equal(scene.finish_texture_count, 3);
        ok(lw_live_get_finish_texture(live, 0, &texture, &err));
        assert_true(texture.content == LW_LIVE_CONTENT_NORMAL && texture.rgba[2] == 255);
        lw_live_close(live);
    }
    live = NULL;
}

static void test_newer_programs(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, RESTS);
    open_live(daemon.port, 0);
    struct {
        struct lw_live_scene scene;
        uint64_t newer;
    } longer = {.scene.struct_size = sizeof longer, .newer = 77};
    ok(lw_live_get_scene(live, &longer.scene, &err));
    assert_int_equal(longer.scene.object_count, live->scene->object_count);
    assert_int_equal(longer.scene.struct_size, sizeof longer);
    assert_int_equal(longer.newer, 77);
    struct {
        struct lw_live_view view;
        uint64_t newer;
    } two[2] = {{.view = {.struct_size = sizeof *two, .view_projection = {1}, .width = 4, .height = 4}},
                {.view = {.struct_size = sizeof *two, .view_projection = {2}, .width = 4, .height = 4}}};
    ok(lw_live_want_views(live, &two[0].view, 2, &err));
    assert_true(live->interest.view[1].view_projection[0] == 2);
}

/* ---- a thread of its own ---- */

/* A listener at the port of a server that has ended. */
static int listen_at(uint16_t port) {
    const struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons(port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    const int listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), on = 1;
    assert_int_equal(setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on), 0);
    assert_int_equal(bind(listener, (const struct sockaddr *)&address, sizeof address), 0);
    assert_int_equal(listen(listener, 1), 0);
    return listener;
}

static void test_closes_while_connecting(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, RESTS "--return-after 0.01");
    open_live(daemon.port, LW_LIVE_THREAD);
    (void)lw_process_stop(&daemon, SIGTERM, LIMIT_S);
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_NS; stats().is_connected;) {
        (void)!lw_live_poll(live, 20, &err);
        assert_true(lw_clock_ns() < end_ns);
    }
    const int listener = listen_at(daemon.port), peer = accept4(listener, NULL, NULL, SOCK_CLOEXEC);
    assert_true(peer >= 0); /* the library's thread waits for its answer */
    lw_live_close(live);
    live = NULL;
    close(peer);
    close(listener);
}

/* ---- changes ---- */

static void test_changes_the_scene(void **state) {
    (void)state;
    struct lw_process daemon;
    serve_never_resting(&daemon, "--freeze 1 --light-groups none");
    open_live(daemon.port, LW_LIVE_CONTROL | LW_LIVE_THREAD);
    const struct lw_live_change change[2] = {
        {.struct_size = sizeof *change, .kind = LW_LIVE_CHANGE_OBJECT_HIDE, .target = 3},
        {.struct_size = sizeof *change, .kind = LW_LIVE_CHANGE_SKY, .value = {1, 2, 3}}};
    uint64_t request = 0;
    ok(lw_live_change(live, change, 2, &request, &err));
    assert_int_equal(request, 1);
    struct lw_live_answer answer = {.struct_size = sizeof answer};
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_NS; !lw_live_next_answer(live, &answer);) {
        ok(lw_live_poll(live, 20, &err));
        assert_true(lw_clock_ns() < end_ns);
    }
    assert_true(answer.request == 1 && answer.code == 0 && answer.frame > 0);
    assert_string_equal(answer.text, "");
    struct lw_live_object object = {.struct_size = sizeof object};
    struct lw_live_scene scene = {.struct_size = sizeof scene};
    ok(lw_live_get_object(live, 3, &object, &err));
    ok(lw_live_get_scene(live, &scene, &err));
    assert_true(object.state == LW_LIVE_OBJECT_HIDDEN && !object.is_drawn && scene.sky[2] == 3);
    struct lw_live_change bad = {.struct_size = 3};
    fails(lw_live_change(live, &bad, 1, NULL, &err), LW_LIVE_USAGE, "struct_size");
    end_all(NULL);
    lw_process_serve(&daemon, RESTS);
    open_live(daemon.port, 0);
    fails(lw_live_change(live, change, 2, NULL, &err), LW_LIVE_UNAVAILABLE, "no updates");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_refuses, end_session),
        cmocka_unit_test_teardown(test_names_and_things, end_session),
        cmocka_unit_test_teardown(test_waits_for_the_first_light, end_all),
        cmocka_unit_test_teardown(test_before_the_scene, end_all),
        cmocka_unit_test_teardown(test_newer_programs, end_all),
        cmocka_unit_test_teardown(test_finishes, end_all),
        cmocka_unit_test_teardown(test_closes_while_connecting, end_all),
        cmocka_unit_test_teardown(test_changes_the_scene, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
