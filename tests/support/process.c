#include "tests/support/process.h"

#include "common/base/clock.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/pidfd.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define LOOK_AGAIN_MS 20 /* at what gives no event: another process's state, a file of another folder */
#define WORDS_MAX     48
#define PROCESSES_MAX 24
#define FRAME_MAX     8192 /* bytes of a frame's JSON */
#define FAILED_EXEC   127  /* as shells say it */

static pid_t running[PROCESSES_MAX]; /* 0: free */

void lw_process_sleep_ms(unsigned ms) {
    nanosleep(&(struct timespec){.tv_sec = ms / 1000, .tv_nsec = (long)(ms % 1000) * 1000000}, NULL);
}

/* ---- waiting ---- */

/* Events of the folder where programs write their output and their port. What happens between a look at a
 * condition and the wait for the next event is in the queue. */
static int folder_events = -1;

static void watch_folder(void) {
    if (folder_events >= 0) return;
    char *folder = strdup(lw_support_temporary("")); /* with a slash at its end */
    assert_non_null(folder);
    folder_events = inotify_init1(IN_CLOEXEC | IN_NONBLOCK);
    if (inotify_add_watch(folder_events, folder, IN_MODIFY | IN_CREATE | IN_MOVED_TO | IN_DELETE) < 0)
        fail_msg("cannot watch %s: %s", folder, strerror(errno));
    free(folder);
}

static void forget_events(void) {
    char events[4096];
    while (read(folder_events, events, sizeof events) > 0) {
    }
}

/* Until something is written there, the program ends, or it is time to look again. */
static void wait_for_event(const struct lw_process *process) {
    const int end =
        process->pid ? pidfd_open(process->pid, 0) : -1; /* it polls as readable from its end on */
    struct pollfd event[] = {{.fd = folder_events, .events = POLLIN}, {.fd = end, .events = POLLIN}};
    poll(event, 2, LOOK_AGAIN_MS);
    forget_events();
    if (end >= 0) close(end);
}

static uint64_t limit_ns(unsigned limit_s) { return lw_clock_ns() + limit_s * 1000000000ull; }

bool lw_process_await(struct lw_process *process, bool (*is_so)(void *context), void *context) {
    const uint64_t deadline_ns = limit_ns(LW_PROCESS_LIMIT_S);
    watch_folder();
    for (;;) {
        const bool runs = lw_process_runs(process);
        if (is_so(context)) return true;
        if (!runs) return false;
        if (lw_clock_ns() > deadline_ns)
            fail_msg("waited for %u s in vain; it said: %s", LW_PROCESS_LIMIT_S, lw_process_err(process));
        wait_for_event(process);
    }
}

static bool file_is_there(void *path) { return access(path, F_OK) == 0; }

bool lw_process_await_file(struct lw_process *process, const char *path) {
    return lw_process_await(process, file_is_there, (void *)path);
}

struct text_in_file {
    const char *path, *text;
    unsigned times;
};

static bool text_is_there(void *context) {
    const struct text_in_file *in = context;
    unsigned times = 0;
    size_t size;
    char *said = (char *)lw_support_read_file(in->path, &size);
    for (const char *at = said; (at = strstr(at, in->text)) != NULL; at++) times++;
    free(said);
    return times >= in->times;
}

void lw_process_await_texts(struct lw_process *process, const char *text, unsigned times) {
    if (!lw_process_await(process, text_is_there, &(struct text_in_file){process->err, text, times}))
        fail_msg("ended without \"%s\" %u times; it said: %s", text, times, lw_process_err(process));
}

void lw_process_await_text(struct lw_process *process, const char *text) {
    lw_process_await_texts(process, text, 1);
}

/* ---- starting ---- */

static char given_display[32];
static int given_input = -1; /* the next program's; -1: ours */

void lw_process_set_display(const char *display) {
    snprintf(given_display, sizeof given_display, "%s", display ? display : "");
}

static void make_temporary(void) {
    if (mkdir(lw_support_temporary("tmp"), 0700) != 0 && errno != EEXIST) fail_msg("cannot make a folder");
}

void lw_process_find(char *path, size_t size, const char *file) {
    char self[512];
    ssize_t length = readlink("/proc/self/exe", self, sizeof self - 1);
    assert_true(length > 0);
    self[length] = '\0';
    *strrchr(self, '/') = '\0';
    assert_true((size_t)snprintf(path, size, "%s/%s", self, file) < size);
}

const char *lw_process_atrium(void) {
    static char path[512];
    lw_process_find(path, sizeof path, "../scenes/atrium.lwscene");
    return path;
}

/* In the child. The parent's death is ours: nothing is left running where a test is killed. */
static void become(const char *path, char **argv, const int outputs[2], pid_t parent) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != parent) _exit(FAILED_EXEC);
    setenv("TMPDIR", lw_support_temporary("tmp"), 1);
    setenv("XDG_CACHE_HOME", lw_support_temporary("caches"), 1);
    setenv("LIGHTWELL_LOG_FORMAT", "text", 0); /* tests read what the daemon says */
    if (*given_display)
        setenv("DISPLAY", given_display, 1);
    else
        unsetenv("DISPLAY");
    unsetenv("WAYLAND_DISPLAY");
    if (given_input >= 0) dup2(given_input, STDIN_FILENO);
    dup2(outputs[0], STDOUT_FILENO);
    dup2(outputs[1], STDERR_FILENO);
    execv(path, argv);
    dprintf(STDERR_FILENO, "cannot start %s: %m\n", path);
    _exit(FAILED_EXEC);
}

static int create(char *dst, size_t size, const char *kind) {
    static unsigned created;
    char name[32];
    snprintf(name, sizeof name, "process.%u.%s", ++created, kind);
    snprintf(dst, size, "%s", lw_support_temporary(name));
    int file = open(dst, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (file < 0) fail_msg("cannot create %s", dst);
    return file;
}

static pid_t *free_entry(void) {
    for (int i = 0; i < PROCESSES_MAX; i++)
        if (!running[i]) return &running[i];
    fail_msg("more than %d processes", PROCESSES_MAX);
    return NULL;
}

void lw_process_start(struct lw_process *process, const char *program, const char *arguments) {
    static char patience[] = "--timeout=500";
    char path[600], line[2048], *argv[WORDS_MAX] = {path};
    *process = (struct lw_process){0};
    make_temporary();
    watch_folder();
    if (*program == '/')
        snprintf(path, sizeof path, "%s", program);
    else
        lw_process_find(path, sizeof path, program);
    assert_true((size_t)snprintf(line, sizeof line, "%s", arguments) < sizeof line);
    int argc = 1;
    /* its own limit is for people, and a busy machine may need more */
    if (strcmp(program, "lightwellctl") == 0 && !strstr(arguments, "--timeout")) argv[argc++] = patience;
    for (char *word = strtok(line, " "); word; word = strtok(NULL, " ")) {
        assert_true(argc < WORDS_MAX - 1);
        argv[argc++] = word;
    }
    const int outputs[2] = {create(process->out, sizeof process->out, "out"),
                            create(process->err, sizeof process->err, "err")};
    pid_t parent = getpid(), *entry = free_entry();
    process->pid = fork();
    assert_true(process->pid >= 0);
    if (process->pid == 0) become(path, argv, outputs, parent);
    close(outputs[0]);
    close(outputs[1]);
    *entry = process->pid;
}

/* ---- ending ---- */

static void forget(struct lw_process *process) {
    for (int i = 0; i < PROCESSES_MAX; i++)
        if (running[i] == process->pid) running[i] = 0;
    process->pid = 0;
}

bool lw_process_runs(struct lw_process *process) {
    siginfo_t info = {0};
    return process->pid && waitid(P_PID, (id_t)process->pid, &info, WEXITED | WNOHANG | WNOWAIT) == 0 &&
           info.si_pid == 0;
}

static void kill_and_reap(struct lw_process *process) {
    kill(process->pid, SIGKILL);
    waitpid(process->pid, NULL, 0);
    forget(process);
}

int lw_process_finish(struct lw_process *process, unsigned limit_s) {
    assert_true(process->pid > 0);
    const uint64_t deadline_ns = limit_ns(limit_s);
    while (lw_process_runs(process)) {
        if (lw_clock_ns() > deadline_ns) {
            kill_and_reap(process);
            fail_msg("did not end within %u s; it said: %s", limit_s, lw_process_err(process));
        }
        wait_for_event(process);
    }
    int status;
    assert_int_equal(waitpid(process->pid, &status, 0), process->pid);
    forget(process);
    if (process->in) close(process->in);
    process->in = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

int lw_process_stop(struct lw_process *process, int signal_number, unsigned limit_s) {
    assert_true(process->pid > 0); /* signals to 0 would reach us all */
    kill(process->pid, signal_number);
    return lw_process_finish(process, limit_s);
}

void lw_process_kill_all(void) {
    for (int i = 0; i < PROCESSES_MAX; i++)
        if (running[i]) kill_and_reap(&(struct lw_process){.pid = running[i]});
    /* what they left is not the next test's: the folder goes out of its way */
    static unsigned ended;
    char name[32], tmp[256];
    snprintf(name, sizeof name, "tmp.%u", ++ended);
    snprintf(tmp, sizeof tmp, "%s", lw_support_temporary("tmp"));
    if (rename(tmp, lw_support_temporary(name)) != 0 && errno != ENOENT) fail_msg("cannot move %s away", tmp);
}

/* ---- what it says and leaves ---- */

static char *text_of(const char *path) {
    size_t size;
    return (char *)lw_support_read_file(path, &size);
}

char *lw_process_out(const struct lw_process *process) { return text_of(process->out); }

char *lw_process_err(const struct lw_process *process) { return text_of(process->err); }

int lw_process_teardown(void **state) {
    (void)state;
    lw_process_kill_all();
    return 0;
}

pid_t lw_process_child_of(pid_t parent) {
    pid_t child = 0;
    DIR *processes = opendir("/proc");
    assert_non_null(processes);
    for (struct dirent *entry; !child && (entry = readdir(processes));) {
        char path[300], line[512] = "";
        int its_parent = 0;
        snprintf(path, sizeof path, "/proc/%s/stat", entry->d_name);
        FILE *file = fopen(path, "r");
        if (!file) continue;
        const char *name_end = fgets(line, sizeof line, file) ? strrchr(line, ')') : NULL;
        if (name_end && sscanf(name_end, ") %*c %d", &its_parent) == 1 && its_parent == parent)
            child = atoi(entry->d_name);
        fclose(file);
    }
    closedir(processes);
    return child;
}

void lw_process_expect(const struct lw_process *process, int code, int expected) {
    if (code != expected) fail_msg("exit code %d, not %d: %s", code, expected, lw_process_err(process));
}

/* A line of how far long work is (progress.h), as a busy machine makes of short work. */
static bool is_progress(const char *line) {
    return strstr(line, " so far, ") || strstr(line, " s left") || strstr(line, ": done in ");
}

void lw_process_run(struct lw_process *process, const char *program, const char *arguments, int expected) {
    lw_process_start(process, program, arguments);
    lw_process_expect(process, lw_process_finish(process, LW_PROCESS_LIMIT_S), expected);
}

void lw_process_end(struct lw_process *process) {
    lw_process_expect(process, lw_process_stop(process, SIGTERM, LW_PROCESS_LIMIT_S), 0);
}

bool lw_process_said(const struct lw_process *process, const char *text) {
    char *said = lw_process_err(process);
    const bool found = strstr(said, text) != NULL;
    free(said);
    return found;
}

void lw_process_refuses(const char *program, const char *arguments, int expected, const char *text,
                        unsigned limit_s) {
    struct lw_process process;
    lw_process_start(&process, program, arguments);
    lw_process_expect(&process, lw_process_finish(&process, limit_s), expected);
    char *said = lw_process_err(&process);
    unsigned lines = 0, with_text = 0;
    for (char *line = said, *end; (end = strchr(line, '\n')) != NULL; line = end + 1) {
        *end = '\0';
        const bool counts = !is_progress(line);
        lines += counts;
        with_text += counts && strstr(line, text);
        *end = '\n';
    }
    if (lines != 1 || with_text != 1) fail_msg("not one line with \"%s\": %s", text, said);
    free(said);
}

unsigned lw_process_needed_mb(const char *arguments) {
    static const char need[] = "texels need ";
    struct lw_process process;
    char line[600];
    snprintf(line, sizeof line, "%s --listen 127.0.0.1:0 --log-format text --memory 1", arguments);
    lw_process_start(&process, "lightwelld", line);
    const int code = lw_process_finish(&process, LW_PROCESS_LIMIT_S);
    char *said = lw_process_err(&process);
    const char *at = strstr(said, need);
    if (code != 71 || !at || !strstr(said, "over 1 (--memory)")) fail_msg("%d: %s", code, said);
    const unsigned mb = (unsigned)atoi(at + strlen(need));
    free(said);
    return mb;
}

void lw_process_left_nothing(void) {
    DIR *folder = opendir(lw_support_temporary("tmp"));
    assert_non_null(folder);
    for (struct dirent *entry; (entry = readdir(folder));)
        if (entry->d_name[0] != '.') fail_msg("$TMPDIR/%s was left behind", entry->d_name);
    closedir(folder);
}

/* ---- serving ---- */

void lw_process_serve(struct lw_process *process, const char *arguments) {
    static unsigned served;
    char line[2048], name[32], port_file[128];
    snprintf(name, sizeof name, "port.%u", ++served);
    snprintf(port_file, sizeof port_file, "%s", lw_support_temporary(name));
    /* the last --listen and --http count */
    assert_true((size_t)snprintf(line, sizeof line, "--listen 127.0.0.1:0 --http none --port-file %s %s",
                                 port_file, arguments) < sizeof line);
    lw_process_start(process, "lightwelld", line);
    snprintf(process->port_file, sizeof process->port_file, "%s", port_file);
    if (!lw_process_await_file(process, port_file))
        fail_msg("lightwelld %s does not serve: %s", line, lw_process_err(process));
    char *text = text_of(port_file); /* written whole, then renamed */
    assert_non_null(strchr(text, '\n'));
    process->port = (uint16_t)atoi(text);
    free(text);
}

void lw_process_serve_by_hand(struct lw_process *process, const char *arguments) {
    char line[2048];
    int ends[2];
    assert_int_equal(pipe2(ends, O_CLOEXEC), 0);
    assert_true((size_t)snprintf(line, sizeof line, "--clock manual %s", arguments) < sizeof line);
    given_input = ends[0];
    lw_process_serve(process, line);
    given_input = -1;
    close(ends[0]);
    process->in = ends[1];
}

void lw_process_step(struct lw_process *process, unsigned frames) {
    while (frames--) assert_int_equal(write(process->in, "\n", 1), 1);
}

/* ---- what a daemon with --json says ---- */

double lw_process_number(const char *line, const char *key) {
    char quoted[64];
    snprintf(quoted, sizeof quoted, "\"%s\":", key);
    const char *at = strstr(line, quoted);
    if (!at) fail_msg("no %s in %.400s", quoted, line);
    return atof(at + strlen(quoted));
}

/* The newest whole line on stdout, without earlier ones; NULL: there is none yet. The caller frees. */
static char *newest_line(const char *path) {
    char *text = calloc(1, FRAME_MAX + 1), *line = NULL;
    FILE *file = fopen(path, "rbe");
    assert_true(text && file);
    assert_int_equal(fseek(file, 0, SEEK_END), 0);
    const long size = ftell(file);
    assert_int_equal(fseek(file, size > FRAME_MAX ? size - FRAME_MAX : 0, SEEK_SET), 0);
    const size_t got = fread(text, 1, FRAME_MAX, file);
    fclose(file);
    char *end = memrchr(text, '\n', got);
    if (end) {
        *end = '\0';
        const char *start = memrchr(text, '\n', (size_t)(end - text));
        assert_true(start || size <= FRAME_MAX); /* a line is no longer */
        assert_non_null(line = strdup(start ? start + 1 : text));
    }
    free(text);
    return line;
}

static bool has_a_line(void *path) {
    char *line = newest_line(path);
    free(line);
    return line != NULL;
}

double lw_process_newest(const struct lw_process *process, const char *key) {
    char *line = newest_line(process->out);
    if (!line) {
        struct lw_process waited = *process;
        if (!lw_process_await(&waited, has_a_line, waited.out))
            fail_msg("ended without a frame; it said: %s", lw_process_err(process));
        line = newest_line(process->out);
    }
    const double number = lw_process_number(line, key);
    free(line);
    return number;
}

struct frames {
    const struct lw_process *process;
    double number;
};

static bool frame_is_there(void *context) {
    const struct frames *f = context;
    return lw_process_newest(f->process, "frame") >= f->number;
}

long lw_process_resident_kb(pid_t pid) {
    char path[64], line[256];
    long kb = -1;
    snprintf(path, sizeof path, "/proc/%d/status", (int)pid);
    FILE *file = fopen(path, "re");
    assert_non_null(file);
    while (fgets(line, sizeof line, file)) (void)!sscanf(line, "VmRSS: %ld", &kb);
    fclose(file);
    assert_true(kb > 0);
    return kb;
}

void lw_process_await_frames(struct lw_process *process, unsigned count) {
    struct frames f = {process, lw_process_newest(process, "frame") + count};
    if (!lw_process_await(process, frame_is_there, &f))
        fail_msg("ended before frame %g; it said: %s", f.number, lw_process_err(process));
}
