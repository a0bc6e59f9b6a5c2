/* The window of lightwell-view, by SDL's driver that shows nothing: keys, mouse and sizes as events, the
 * light of a real lightwelld. */
#include "tests/support/process.h"

#include "client/view/window/window.h"
#include "common/base/clock.h"

#include <SDL.h>
#include <dirent.h>
#include <epoxy/gl.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#define LIMIT_NS (LW_PROCESS_LIMIT_S * 1000000000ull)

static struct lw_process server;
static char address[16];
static struct lw_view_options options;
static struct lw_window *window;

static void parse(const char *line) {
    static char storage[512]; /* the options point into it */
    char *argv[32] = {storage};
    int argc = 0;
    bool done = false;
    struct lw_error err = {0};
    snprintf(storage, sizeof storage, "lightwell-view %s", line);
    for (char *word = strtok(storage, " "); word; word = strtok(NULL, " ")) argv[argc++] = word;
    lw_support_ok(lw_view_options_parse(argc, argv, &options, &done, &err), &err);
}

/* what    an address's port, or a scene */
static void open_window(const char *what, const char *rest) {
    char line[256];
    struct lw_error err = {0};
    snprintf(line, sizeof line, "%s --renderer cpu --size 160x90 %s", what, rest);
    parse(line);
    lw_support_ok(lw_window_create(&options, &window, &err), &err);
}

static void close_window(void) {
    lw_window_destroy(window);
    window = NULL;
}

static struct lw_window_state now(void) { return lw_window_state(window); }

static struct lw_camera_view view_now(void) {
    const struct lw_window_state state = now();
    return lw_flight_view(&state.steering.flight);
}

static void step(void) {
    struct lw_error err = {0};
    lw_support_ok(lw_window_step(window, &err), &err);
}

static void steps(int count) {
    while (count-- > 0) step();
}

static void step_until(bool (*there)(void), const char *what) {
    const uint64_t deadline_ns = lw_clock_ns() + LIMIT_NS;
    while (!there()) {
        step();
        if (lw_clock_ns() > deadline_ns) fail_msg("%s: never; it says \"%s\"", what, now().says);
    }
}

static bool is_lit(void) { return now().staged && now().lit && now().pictures > 0; }
static bool is_of_another_scene(void) { return strcmp(now().says, "the scene is another one") == 0; }

static void key(SDL_Keycode sym, bool down) {
    SDL_Event event = {.type = down ? SDL_KEYDOWN : SDL_KEYUP};
    event.key.keysym.sym = sym;
    event.key.keysym.scancode = SDL_GetScancodeFromKey(sym);
    assert_int_equal(SDL_PushEvent(&event), 1);
}

static void press_key(SDL_Keycode sym) {
    key(sym, true);
    key(sym, false);
}

/* Pressed and let go. */
static void press(SDL_Keycode sym) {
    press_key(sym);
    step();
}

static void drag(int right, int down) {
    SDL_Event event = {.type = SDL_MOUSEMOTION};
    event.motion.xrel = right, event.motion.yrel = down;
    assert_int_equal(SDL_PushEvent(&event), 1);
    step();
}

static void click(void) {
    SDL_Event event = {.type = SDL_MOUSEBUTTONDOWN};
    assert_int_equal(SDL_PushEvent(&event), 1);
    step();
}

static void wheel(int notches) {
    SDL_Event event = {.type = SDL_MOUSEWHEEL};
    event.wheel.y = notches;
    assert_int_equal(SDL_PushEvent(&event), 1);
    step();
}

static float apart(struct lw_vec3 a, struct lw_vec3 b) { return lw_vec3_length(lw_vec3_sub(a, b)); }

/* A key that is held for some pictures. */
static void hold(SDL_Keycode sym, int pictures) {
    key(sym, true);
    for (int i = 0; i < pictures; i++) {
        lw_process_sleep_ms(5);
        step();
    }
    key(sym, false);
    step();
}

static int start(void **state) {
    (void)state;
    setenv("SDL_VIDEODRIVER", "dummy", 1);
    setenv("TMPDIR", lw_support_temporary(""), 1);
    lw_process_serve(&server, "builtin:cornell --texels-per-metre 8");
    snprintf(address, sizeof address, "%u", server.port);
    return 0;
}

static int stop(void **state) {
    (void)state;
    close_window();
    const int code = server.pid ? lw_process_stop(&server, SIGTERM, LW_PROCESS_LIMIT_S) : 0;
    lw_process_kill_all();
    return code;
}

static void test_keys(void **state) {
    (void)state;
    open_window(address, "");
    step_until(is_lit, "light");
    assert_true(now().keys_shown && now().figures_shown && !now().full_screen && now().auto_exposure);
    press(SDLK_h);
    assert_false(now().keys_shown);
    press(SDLK_h);
    assert_true(now().keys_shown);
    press(SDLK_F1);
    assert_false(now().figures_shown || now().keys_shown);
    press(SDLK_F1);
    assert_true(now().figures_shown);
    press(SDLK_F11);
    assert_true(now().full_screen || strstr(now().says, "no full screen here"));
    if (now().full_screen) press(SDLK_F11);
    assert_false(now().full_screen);

    const float stops = now().stops;
    press(SDLK_EQUALS);
    press(SDLK_KP_PLUS);
    assert_false(now().auto_exposure);
    assert_float_equal(now().stops, stops + 0.5f, 0.05f);
    press(SDLK_MINUS);
    assert_float_equal(now().stops, stops + 0.25f, 0.05f);
    press(SDLK_x);
    assert_true(now().auto_exposure);
    assert_string_equal(now().says, "exposure by the picture");

    press(SDLK_ESCAPE);
    assert_true(now().quit);
    close_window();
}

static void test_moves(void **state) {
    (void)state;
    open_window(address, "");
    step_until(is_lit, "light");
    const struct lw_vec3 first = now().steering.flight.position;
    assert_float_equal(apart(first, now().start.position), 0, 1e-6f);
    hold(SDLK_w, 5);
    const struct lw_vec3 ahead = lw_vec3_sub(now().steering.flight.position, first);
    assert_true(lw_vec3_dot(ahead, now().start.forward) > 0);
    drag(100, 0); /* nobody has clicked */
    assert_float_equal(
        lw_vec3_dot(lw_flight_view(&(struct lw_flight){.yaw = now().steering.flight.yaw}).right,
                    now().start.right),
        1, 1e-4f);
    click();
    const float yaw = now().steering.flight.yaw, speed = now().steering.flight.speed;
    drag(100, 0);
    assert_float_equal(remainderf(now().steering.flight.yaw - yaw, 2 * LW_PI), 0.25f, 1e-4f);
    wheel(4);
    assert_float_equal(now().steering.flight.speed, 2 * speed, 1e-3f * speed);
    press(SDLK_ESCAPE); /* frees the mouse alone */
    assert_false(now().quit);

    press(SDLK_0);
    assert_float_equal(apart(now().steering.flight.position, now().start.position), 0, 1e-5f);
    press(SDLK_m);
    assert_int_equal(now().steering.mode, LW_STEERING_WALK);
    assert_string_equal(now().says, "walk");
    press(SDLK_m);
    assert_int_equal(now().steering.mode, LW_STEERING_ORBIT);
    const struct lw_camera_view view = view_now();
    const struct lw_vec3 pivot = lw_vec3_mad(view.position, view.forward, now().steering.distance_m);
    click();
    drag(300, -100);
    const struct lw_camera_view turned = view_now();
    assert_true(apart(turned.position, view.position) > 0.1f * now().steering.distance_m);
    assert_float_equal(apart(lw_vec3_mad(turned.position, turned.forward, now().steering.distance_m), pivot),
                       0, 1e-3f);
    press(SDLK_1);
    assert_non_null(strstr(now().says, "camera 1 of "));
    close_window();
}

/* The camera as a command that shows the same; pictures as files. */
static void test_copies(void **state) {
    (void)state;
    char line[1024], folder[256];
    struct lw_camera_view view;
    struct lw_error err = {0};
    open_window(address, "--exposure 1.5");
    step_until(is_lit, "light");
    click();
    drag(40, 30);
    press(SDLK_k);
    assert_non_null(strstr(now().says, "camera"));
    view = view_now();
    char *text = SDL_GetClipboardText();
    snprintf(line, sizeof line, "%s", text);
    SDL_free(text);
    char expected[64];
    snprintf(expected, sizeof expected, "lightwell-view 127.0.0.1:%u --camera ", server.port);
    assert_memory_equal(line, expected, strlen(expected));
    assert_non_null(strstr(line, " --size 160x90 --exposure 1.5"));
    parse(line + strlen("lightwell-view "));
    assert_true(options.camera_given);
    assert_true(apart(options.camera.position, view.position) < 1e-5f);
    assert_true(apart(options.camera.forward, view.forward) < 1e-5f);
    assert_float_equal(options.camera.fov_y, view.fov_y, 1e-4f);

    char here[1024];
    assert_non_null(getcwd(here, sizeof here));
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("saved"));
    assert_int_equal(mkdir(folder, 0700), 0);
    assert_int_equal(chdir(folder), 0);
    press(SDLK_p);
    press(SDLK_p);
    assert_int_equal(chdir(here), 0);
    assert_non_null(strstr(now().says, "saved lightwell_"));
    int png = 0, exr = 0;
    DIR *dir = opendir(folder);
    assert_non_null(dir);
    for (struct dirent *entry; (entry = readdir(dir));) {
        png += strstr(entry->d_name, ".png") != NULL;
        exr += strstr(entry->d_name, ".exr") != NULL;
    }
    closedir(dir);
    assert_int_equal(png, 2);
    assert_int_equal(exr, 2);
    assert_int_equal(chmod(folder, 0500), 0);
    if (getuid() != 0) { /* nothing is forbidden to root */
        assert_int_equal(chdir(folder), 0);
        press(SDLK_p);
        assert_int_equal(chdir(here), 0);
        assert_non_null(strstr(now().says, "not saved: "));
    }
    close_window();
    (void)err;
}

/* Each chart is another picture, by key. */
static void test_charts(void **state) {
    (void)state;
    open_window(address, "--show level");
    step_until(is_lit, "light");
    assert_int_equal(now().show, LW_SHOW_LEVEL);
    press(SDLK_v);
    assert_int_equal(now().show, LW_SHOW_INTEREST);
    assert_memory_equal(now().says, "interest: ", 10);
    for (int show = LW_SHOW_NORMALS; show < LW_SHOW_COUNT; show++) {
        press(SDLK_v);
        assert_int_equal(now().show, show);
    }
    press(SDLK_v);
    assert_int_equal(now().show, LW_SHOW_ALL);
    for (int i = 0; i < LW_SHOW_COUNT; i++) {
        press(SDLK_v);
        steps(2);
    }
    assert_int_equal(now().show, LW_SHOW_ALL);
    close_window();
}

static bool is_traced(void) { return now().traced.samples >= 2; }

/* A path tracer beside it; it begins again with another view, and ends with the window. */
static void test_comparison(void **state) {
    (void)state;
    open_window(address, "");
    step_until(is_lit, "light");
    assert_false(now().compares);
    press(SDLK_t);
    assert_true(now().compares);
    step_until(is_traced, "paths");
    assert_int_equal(now().traced.width, 80);
    assert_int_equal(now().traced.height, 45);
    drag(0, 0); /* the mouse, not captured, moves the line to the left edge */
    assert_float_equal(now().wipe, 0, 0);
    press(SDLK_t);
    steps(3);
    click();
    drag(100, 0);
    press(SDLK_ESCAPE);
    assert_true(now().compares);
    step_until(is_traced, "paths of another view");
    press(SDLK_t);
    assert_false(now().compares);
    press(SDLK_t);
    close_window(); /* while it traces */
}

/* Another server at the same address: the camera is that of its scene. The same scene again: the camera
 * stays. */
static void test_another_scene(void **state) {
    (void)state;
    char line[256];
    struct lw_process first;
    lw_process_serve(&first, "builtin:cornell --texels-per-metre 8");
    snprintf(line, sizeof line, ":%u", first.port);
    open_window(line, "");
    step_until(is_lit, "light");
    const struct lw_camera_view start = now().start;
    press(SDLK_m);
    lw_process_end(&first);
    struct lw_process second;
    snprintf(line, sizeof line, "builtin:ajar --listen 127.0.0.1:%u --texels-per-metre 4", first.port);
    lw_process_serve(&second, line);
    step_until(is_of_another_scene, "another scene");
    assert_true(apart(now().start.position, start.position) > 0.1f);
    assert_float_equal(apart(now().steering.flight.position, now().start.position), 0, 1e-5f);
    assert_int_equal(now().steering.mode, LW_STEERING_FLY);
    steps(3);
    close_window();
    lw_process_end(&second);
}

static bool imports(void) { return strstr(now().says, "importing builtin:cornell, ") != NULL; }

/* The window is there before its server listens, and says what it waits for. */
static void test_own_server(void **state) {
    (void)state;
    open_window("builtin:cornell", "--texels-per-metre 9");
    step_until(imports, "the import");
    assert_false(now().staged);
    step_until(is_lit, "light");
    press(SDLK_k);
    char *text = SDL_GetClipboardText();
    assert_memory_equal(text, "lightwell-view builtin:cornell --camera ", 40);
    SDL_free(text);
    close_window();
    struct lw_error err = {0};
    parse("/nowhere/room.glb");
    lw_support_fails(lw_window_create(&options, &window, &err), LW_NO_INPUT, &err, "/nowhere/room.glb");
}

/* A window without pixels waits for better times. */
static bool minimised;
int __wrap_SDL_GetRendererOutputSize(SDL_Renderer *renderer, int *width, int *height);
int __real_SDL_GetRendererOutputSize(SDL_Renderer *renderer, int *width, int *height);
int __wrap_SDL_GetRendererOutputSize(SDL_Renderer *renderer, int *width, int *height) {
    if (!minimised) return __real_SDL_GetRendererOutputSize(renderer, width, height);
    *width = *height = 0;
    return 0;
}

static void resize_event(void) {
    SDL_Event event = {.type = SDL_WINDOWEVENT};
    event.window.event = SDL_WINDOWEVENT_SIZE_CHANGED;
    assert_int_equal(SDL_PushEvent(&event), 1);
    step();
}

static void test_minimised(void **state) {
    (void)state;
    minimised = true; /* from the beginning */
    open_window(address, "");
    steps(20);
    assert_int_equal(now().width, 0);
    press(SDLK_k);
    press(SDLK_p);
    press(SDLK_t);
    press(SDLK_t);
    press(SDLK_t);
    minimised = false;
    step_until(is_lit, "light");
    assert_int_equal(now().width, 160);
    minimised = true; /* later: the last picture's size stays */
    resize_event();
    steps(5);
    assert_int_equal(now().width, 160);
    minimised = false;
    resize_event();
    steps(5);
    close_window();
}

static PFNGLGETERRORPROC real_get_error;
static PFNGLGETSTRINGPROC real_get_string;
static GLenum lost_context(void) { return 0x0507; }
static const GLubyte *of_a_gpu(GLenum name) {
    return name == GL_RENDERER ? (const GLubyte *)"a GPU" : real_get_string(name);
}

/* By OpenGL without a display; when its context is lost the CPU goes on. */
static void test_lost_context(void **state) {
    (void)state;
    char line[64];
    setenv("SDL_VIDEODRIVER", "offscreen", 1);
    snprintf(line, sizeof line, "%s --renderer gl --size 160x90", address);
    struct lw_error err = {0};
    parse(line);
    if (lw_window_create(&options, &window, &err) != LW_OK) {
        print_message("no OpenGL for a window here, so it is not tested: %s\n", err.text);
        setenv("SDL_VIDEODRIVER", "dummy", 1);
        skip();
    }
    step_until(is_lit, "light");
    assert_true(now().by_gl);
    press(SDLK_v);
    press(SDLK_t);
    step_until(is_traced, "paths");
    press(SDLK_t);
    steps(3);
    glGetError(); /* the first call of each finds the driver's */
    glGetString(GL_RENDERER);
    real_get_error = epoxy_glGetError, real_get_string = epoxy_glGetString;
    epoxy_glGetError = lost_context; /* asked for, OpenGL is not left silently */
    enum lw_status status = LW_OK;
    for (int i = 0; i < 100 && status == LW_OK; i++) {
        press_key(SDLK_0);
        status = lw_window_step(window, &err);
    }
    epoxy_glGetError = real_get_error;
    lw_support_fails(status, LW_UNAVAILABLE, &err, "--renderer gl");
    close_window();

    epoxy_glGetString = of_a_gpu; /* by itself it is drawn with only where there is a GPU */
    snprintf(line, sizeof line, "%s --size 160x90", address);
    parse(line);
    err = (struct lw_error){0};
    lw_support_ok(lw_window_create(&options, &window, &err), &err);
    step_until(is_lit, "light");
    assert_true(now().by_gl);
    epoxy_glGetError = lost_context;
    for (int i = 0; i < 100 && now().by_gl; i++) press(SDLK_0);
    epoxy_glGetError = real_get_error, epoxy_glGetString = real_get_string;
    assert_false(now().by_gl);
    const uint64_t pictures = now().pictures;
    press(SDLK_0);
    steps(3);
    assert_true(now().pictures > pictures);
    close_window();
    setenv("SDL_VIDEODRIVER", "dummy", 1);
}

/* An X server of our own, on a free display; false: there is none. */
static bool start_xvfb(pid_t *out_pid, char out_display[16]) {
    int ready[2];
    char number[16] = "", descriptor[16];
    assert_int_equal(pipe(ready), 0);
    snprintf(descriptor, sizeof descriptor, "%d", ready[1]);
    const pid_t parent = getpid(), pid = fork();
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        if (getppid() != parent) _exit(1);
        const int nothing = open("/dev/null", O_WRONLY);
        dup2(nothing, STDERR_FILENO);
        execlp("Xvfb", "Xvfb", "-displayfd", descriptor, "-screen", "0", "320x240x24", "-nolisten", "tcp",
               (char *)NULL);
        _exit(1);
    }
    close(ready[1]);
    struct pollfd wait = {.fd = ready[0], .events = POLLIN};
    if (poll(&wait, 1, 60000) == 1) (void)!read(ready[0], number, sizeof number - 1);
    close(ready[0]);
    number[strcspn(number, "\n")] = 0;
    snprintf(out_display, 16, ":%.8s", number);
    *out_pid = pid;
    if (*number) return true;
    kill(pid, SIGKILL);
    waitpid(pid, NULL, 0);
    return false;
}

/* The X server goes: one line, and the server of the window's own goes as well. */
static void test_lost_display(void **state) {
    (void)state;
    char display[16];
    pid_t xvfb;
    struct lw_process view;
    if (!start_xvfb(&xvfb, display)) {
        print_message("no Xvfb here, so a lost display is not tested\n");
        skip();
    }
    /* pictures by Xlib alone: Mesa's software may hang where the server goes in the middle of one */
    setenv("SDL_RENDER_DRIVER", "software", 1);
    setenv("SDL_FRAMEBUFFER_ACCELERATION", "0", 1);
    setenv("SDL_VIDEODRIVER", "x11", 1);
    lw_process_set_display(display);
    lw_process_start(&view, "lightwell-view",
                     "builtin:cornell --renderer cpu --size 160x90 --texels-per-metre 8");
    lw_process_set_display(NULL);
    unsetenv("SDL_RENDER_DRIVER");
    unsetenv("SDL_FRAMEBUFFER_ACCELERATION");
    setenv("SDL_VIDEODRIVER", "dummy", 1);
    lw_process_await_text(&view, "serving builtin:cornell");
    kill(xvfb, SIGKILL);
    waitpid(xvfb, NULL, 0);
    const int code = lw_process_finish(&view, LW_PROCESS_LIMIT_S);
    char *err = lw_process_err(&view);
    if (code != 69 || !strstr(err, "lightwell-view: error: the display has gone\n") || strstr(err, "XIO") ||
        !strstr(err, "lightwelld: stopped"))
        fail_msg("ended with %d: %s", code, err);
    free(err);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_keys),         cmocka_unit_test(test_moves),
        cmocka_unit_test(test_copies),       cmocka_unit_test(test_another_scene),
        cmocka_unit_test(test_charts),       cmocka_unit_test(test_minimised),
        cmocka_unit_test(test_lost_context), cmocka_unit_test(test_lost_display),
        cmocka_unit_test(test_comparison),   cmocka_unit_test(test_own_server),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
