#include "tests/support/import_probe.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <netinet/in.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <unistd.h>

static char folder[PATH_MAX]; /* the scene's */
static const char *token;     /* a value of the environment, as long as it is there */

static const char *path_of(const char *name) {
    static char path[PATH_MAX + 32];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

static bool opens(const char *path, int flags) {
    const int fd = open(path, flags | O_CLOEXEC, 0600);
    if (fd >= 0) close(fd);
    return fd >= 0;
}

static bool read_inside(void) { return opens(path_of("inside"), O_RDONLY); }
static bool read_outside(void) { return opens(path_of("../secret"), O_RDONLY); }
static bool read_absolute(void) { return opens("/etc/passwd", O_RDONLY); }
static bool read_through_link(void) { return opens(path_of("link"), O_RDONLY); }
static bool read_memory_of_parent(void) {
    char path[64];
    snprintf(path, sizeof path, "/proc/%d/environ", (int)getppid());
    return opens(path, O_RDONLY);
}
static bool write_outside(void) { return opens(path_of("../secret"), O_WRONLY); }
static bool write_inside(void) { return opens(path_of("inside"), O_WRONLY); }
static bool create_outside(void) { return opens(path_of("../created"), O_WRONLY | O_CREAT); }
static bool create_folder(void) { return mkdir(path_of("made"), 0700) == 0 && rmdir(path_of("made")) == 0; }
static bool create_link(void) { return symlink("x", path_of("laid")) == 0 && unlink(path_of("laid")) == 0; }
static bool change_mode(void) { return chmod(path_of("../secret"), 0600) == 0; }
static bool list_outside(void) {
    DIR *dir = opendir(path_of(".."));
    if (dir) closedir(dir);
    return dir != NULL;
}

static bool has_socket(int family) {
    const int fd = socket(family, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd >= 0) close(fd);
    return fd >= 0;
}

static bool network(void) { return has_socket(AF_INET); }
static bool connection(void) {
    const struct sockaddr_in to = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const bool reached = fd >= 0 && (connect(fd, (const struct sockaddr *)&to, sizeof to) == 0 ||
                                     errno == ECONNREFUSED || errno == EADDRNOTAVAIL);
    if (fd >= 0) close(fd);
    return reached;
}
static bool unix_socket(void) { return has_socket(AF_UNIX); }

static bool ends_well(long pid) { /* the child that a call made */
    int status = 1;
    if (pid == 0) _exit(0);
    return pid > 0 && waitpid((pid_t)pid, &status, 0) == pid && status == 0;
}

static bool process(void) { return ends_well(fork()); }
static bool process_by_clone(void) { return ends_well(syscall(SYS_clone, SIGCHLD, 0, 0, 0, 0)); }
static bool process_by_clone3(void) {
    const uint64_t arguments[8] = {[4] = SIGCHLD};
    return ends_well(syscall(SYS_clone3, arguments, sizeof arguments));
}
/* No file: a success would be the end of the probe. */
static bool program(void) {
    static char name[] = "x";
    execve("/nonexistent", (char *[]){name, NULL}, (char *[]){NULL});
    return errno == ENOENT;
}
static bool trace(void) { return ptrace(PTRACE_CONT, getppid(), NULL, NULL) == 0 || errno == ESRCH; }
static bool memory_of_others(void) {
    char byte;
    const struct iovec here = {&byte, 1}, there = {folder, 1};
    return process_vm_readv(getpid(), &here, 1, &there, 1, 0) == 1;
}
static bool signal_to_others(void) { return kill(getppid(), 0) == 0; }
static bool memory_that_runs(void) {
    void *at = mmap(NULL, 4096, PROT_READ | PROT_WRITE | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (at != MAP_FAILED) munmap(at, 4096);
    return at != MAP_FAILED;
}
static bool descriptor(void) { return fcntl(LW_IMPORT_PROBE_DESCRIPTOR, F_GETFD) >= 0; }
static bool environment(void) {
    if (!token) token = getenv("LW_PROBE_TOKEN");
    errno = ENOENT;
    return token && *token;
}
static bool many_files(void) {
    struct rlimit limit;
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_max > 64) return true;
    limit.rlim_max++;
    errno = 0;
    return setrlimit(RLIMIT_NOFILE, &limit) == 0;
}
static bool core_dump(void) {
    struct rlimit limit;
    errno = 0;
    return getrlimit(RLIMIT_CORE, &limit) != 0 || limit.rlim_max > 0;
}

void lw_import_probe(const char *scene, bool caged) {
    static const struct {
        const char *name;
        bool (*is_open)(void);
    } ways[] = {{"read inside", read_inside},
                {"read outside", read_outside},
                {"read an absolute path", read_absolute},
                {"read through a link", read_through_link},
                {"read the starter's environment", read_memory_of_parent},
                {"write outside", write_outside},
                {"write inside", write_inside},
                {"create outside", create_outside},
                {"create a folder", create_folder},
                {"create a link", create_link},
                {"change a mode", change_mode},
                {"list outside", list_outside},
                {"network", network},
                {"connection", connection},
                {"unix socket", unix_socket},
                {"process", process},
                {"process by clone", process_by_clone},
                {"process by clone3", process_by_clone3},
                {"program", program},
                {"ptrace", trace},
                {"memory of others", memory_of_others},
                {"signal to others", signal_to_others},
                {"memory that runs", memory_that_runs},
                {"descriptor", descriptor},
                {"environment", environment},
                {"many files", many_files},
                {"core dump", core_dump}};
    const char *slash = strrchr(scene, '/');
    snprintf(folder, sizeof folder, "%.*s", slash ? (int)(slash - scene) : 1, slash ? scene : ".");
    for (size_t i = 0; i < sizeof ways / sizeof *ways; i++) {
        errno = 0;
        const bool is_open = ways[i].is_open();
        dprintf(STDERR_FILENO, "%s %s: %s\n", caged ? "caged" : "free", ways[i].name,
                is_open ? "open" : strerror(errno));
    }
    dprintf(STDERR_FILENO, "%s user %u\n", caged ? "caged" : "free", (unsigned)geteuid());
}
