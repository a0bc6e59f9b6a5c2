#include "tests/support/process.h"

#include "common/clock.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define WORDS_MAX     48
#define PROCESSES_MAX 16
#define LIMIT_S       60  /* until a daemon serves, and until it has printed a line */
#define FAILED_EXEC   127 /* as shells say it */

static pid_t running[PROCESSES_MAX]; /* 0: free */

void lw_process_sleep_ms(unsigned ms) {
    nanosleep(&(struct timespec){.tv_sec = ms / 1000, .tv_nsec = (long)(ms % 1000) * 1000000}, NULL);
}

/* ---- starting ---- */

static char given_display[32];

void lw_process_set_display(const char *display) {
    snprintf(given_display, sizeof given_display, "%s", display ? display : "");
}

static void make_temporary(void) {
    if (mkdir(lw_support_temporary("tmp"), 0700) != 0 && errno != EEXIST) fail_msg("cannot make a folder");
}

static void find_program(char *path, size_t size, const char *program) {
    char self[512];
    ssize_t length = readlink("/proc/self/exe", self, sizeof self - 1);
    assert_true(length > 0);
    self[length] = '\0';
    *strrchr(self, '/') = '\0';
    assert_true((size_t)snprintf(path, size, "%s/%s", self, program) < size);
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
    char path[600], line[2048], *argv[WORDS_MAX] = {path};
    *process = (struct lw_process){0};
    make_temporary();
    find_program(path, sizeof path, program);
    assert_true((size_t)snprintf(line, sizeof line, "%s", arguments) < sizeof line);
    int argc = 1;
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
    uint64_t deadline_ns = lw_clock_ns() + limit_s * 1000000000ull;
    while (lw_process_runs(process)) {
        if (lw_clock_ns() > deadline_ns) {
            kill_and_reap(process);
            fail_msg("did not end within %u s; it said: %s", limit_s, lw_process_err(process));
        }
        lw_process_sleep_ms(2);
    }
    int status;
    assert_int_equal(waitpid(process->pid, &status, 0), process->pid);
    forget(process);
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

void lw_process_expect(const struct lw_process *process, int code, int expected) {
    if (code != expected) fail_msg("exit code %d, not %d: %s", code, expected, lw_process_err(process));
}

void lw_process_refuses(const char *program, const char *arguments, int expected, const char *text,
                        unsigned limit_s) {
    struct lw_process process;
    lw_process_start(&process, program, arguments);
    lw_process_expect(&process, lw_process_finish(&process, limit_s), expected);
    char *said = lw_process_err(&process), *end = strchr(said, '\n');
    if (!strstr(said, text) || !end || end[1]) fail_msg("not one line with \"%s\": %s", text, said);
    free(said);
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
    uint64_t deadline_ns = lw_clock_ns() + LIMIT_S * 1000000000ull;
    while (access(port_file, R_OK) != 0) {
        if (!lw_process_runs(process) || lw_clock_ns() > deadline_ns)
            fail_msg("lightwelld %s does not serve: %s", line, lw_process_err(process));
        lw_process_sleep_ms(2);
    }
    char *text = text_of(port_file); /* written whole, then renamed */
    assert_non_null(strchr(text, '\n'));
    process->port = (uint16_t)atoi(text);
    free(text);
}

/* ---- what a daemon with --json says ---- */

double lw_process_number(const char *line, const char *key) {
    char quoted[64];
    snprintf(quoted, sizeof quoted, "\"%s\":", key);
    const char *at = strstr(line, quoted);
    if (!at) fail_msg("no %s in %.400s", quoted, line);
    return atof(at + strlen(quoted));
}

double lw_process_newest(const struct lw_process *process, const char *key) {
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_S * 1000000000ull; lw_clock_ns() < end_ns;) {
        char *text = lw_process_out(process), *end = strrchr(text, '\n');
        if (end) {
            *end = '\0';
            char *start = strrchr(text, '\n');
            double number = lw_process_number(start ? start + 1 : text, key);
            free(text);
            return number;
        }
        free(text);
        lw_process_sleep_ms(10);
    }
    fail_msg("no frame within %u s", LIMIT_S);
    return 0;
}
