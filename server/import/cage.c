#include "server/import/cage.h"

#include "common/base/sanitizer.h"

#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <limits.h>
#include <linux/audit.h>
#include <linux/capability.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sched.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#define DESCRIPTORS_MAX 64 /* files that are open at once: a scene, a picture, folders that are searched */

extern char **environ;

bool lw_cage_is_built(void) {
#ifdef LW_COVERAGE
    return false;
#else
    return !LW_SANITIZER;
#endif
}

/* ---- descriptors, limits, environment ---- */

static void close_from_to(unsigned first, unsigned last) {
    if (first > last || syscall(SYS_close_range, first, last, 0) == 0) return;
    struct rlimit limit; /* Linux before 5.9 */
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
    for (unsigned fd = first; fd <= last && fd < limit.rlim_cur; fd++) close((int)fd);
}

static void close_strays(const int kept[LW_CAGE_KEPT_MAX]) {
    unsigned first = STDERR_FILENO + 1;
    for (unsigned next; first; first = next) {
        next = 0; /* the smallest that is kept, from first on */
        for (int i = 0; i < LW_CAGE_KEPT_MAX; i++)
            if (kept[i] >= (int)first && (!next || (unsigned)kept[i] < next)) next = (unsigned)kept[i];
        close_from_to(first, next ? next - 1 : UINT_MAX);
        if (next) next++;
    }
}

/* Sets the soft and the hard limit, so that nothing raises it again. A lower limit stays. */
static void limit(int resource, rlim_t most) {
    struct rlimit now;
    if (getrlimit(resource, &now) != 0) return;
    if (now.rlim_max > most) now.rlim_max = most;
    if (now.rlim_cur > now.rlim_max) now.rlim_cur = now.rlim_max;
    setrlimit(resource, &now);
}

static void set_limits(const struct lw_cage_desc *desc) {
    signal(SIGXFSZ, SIG_IGN); /* so that a file that grows too long is reported as a full disk is */
    limit(RLIMIT_FSIZE, desc->file_bytes);
    limit(RLIMIT_NOFILE, DESCRIPTORS_MAX);
    limit(RLIMIT_CORE, 0);
    if (desc->memory_bytes && !LW_SANITIZER) limit(RLIMIT_AS, desc->memory_bytes);
}

/* The strings as well: a token may stand there, and the process can read its own memory. */
static void wipe_environment(void) {
    for (char **variable = environ; variable && *variable; variable++)
        explicit_bzero(*variable, strlen(*variable));
    clearenv();
}

/* ---- Landlock ---- */

/* The kernel's interface: Debian 12's header has only a part of it. */
#ifndef SYS_landlock_create_ruleset
#define SYS_landlock_create_ruleset 444
#define SYS_landlock_add_rule       445
#define SYS_landlock_restrict_self  446
#endif

struct ruleset {
    uint64_t files, net, scoped; /* since the interface's versions 1, 4 and 6 */
};

struct path_rule {
    uint64_t allowed;
    int32_t parent_fd;
} __attribute__((packed));

#define ASK_VERSION    1u
#define RULE_PATH      1u
#define FS_WRITE_FILE  (1ull << 1)
#define FS_READ_FILE   (1ull << 2)
#define FS_READ_DIR    (1ull << 3)
#define FS_REMOVE_FILE (1ull << 5)
#define FS_MAKE_FILE   (1ull << 8)
#define FS_TRUNCATE    (1ull << 14)
#define NET_TCP        3ull /* bind, connect */
#define SCOPED_ALL     3ull /* abstract sockets, signals */

/* All rights over files that a version of the interface knows. */
static uint64_t file_rights(long version) {
    const unsigned count = version >= 5 ? 16 : version >= 3 ? 15 : version == 2 ? 14 : 13;
    return (1ull << count) - 1;
}

/* Returns a descriptor; -1: the kernel has none of this. */
static int create_ruleset(uint64_t *out_rights) {
    const long version = syscall(SYS_landlock_create_ruleset, NULL, 0, ASK_VERSION);
    if (version < 1) return -1;
    struct ruleset ruleset = {.files = file_rights(version)};
    size_t size = offsetof(struct ruleset, net);
    if (version >= 4) ruleset.net = NET_TCP, size = offsetof(struct ruleset, scoped);
    if (version >= 6) ruleset.scoped = SCOPED_ALL, size = sizeof ruleset;
    *out_rights = ruleset.files;
    return (int)syscall(SYS_landlock_create_ruleset, &ruleset, size, 0);
}

/* A path that is not there needs no rule: opening it fails and says so. */
static void allow(int ruleset, const char *path, uint64_t rights) {
    const int fd = open(path, O_PATH | O_CLOEXEC);
    if (fd < 0) return;
    const struct path_rule rule = {.allowed = rights, .parent_fd = fd};
    (void)syscall(SYS_landlock_add_rule, ruleset, RULE_PATH, &rule, 0);
    close(fd);
}

static void folder_of(const char *path, char out[PATH_MAX]) {
    const char *slash = strrchr(path, '/');
    snprintf(out, PATH_MAX, "%.*s", slash ? (int)(slash - path) + 1 : 1, slash ? path : ".");
}

/* Where it points to, as common/base/atomic_file.c has it. */
static void folder_of_output(const char *output, char out[PATH_MAX]) {
    char target[PATH_MAX];
    folder_of(realpath(output, target) ? target : output, out);
}

static int make_rules(const struct lw_cage_desc *desc) {
    char folder[PATH_MAX];
    struct stat output;
    uint64_t rights = 0;
    const int ruleset = create_ruleset(&rights);
    if (ruleset < 0) return -1;
    if (desc->scene) allow(ruleset, desc->scene, rights & FS_READ_FILE);
    if (desc->environment) allow(ruleset, desc->environment, rights & FS_READ_FILE);
    if (desc->scene && !desc->scene_alone) {
        folder_of(desc->scene, folder);
        allow(ruleset, folder, rights & (FS_READ_FILE | FS_READ_DIR));
    }
    if (stat(desc->output, &output) == 0 && !S_ISREG(output.st_mode) && !S_ISDIR(output.st_mode)) {
        allow(ruleset, desc->output, rights & (FS_WRITE_FILE | FS_TRUNCATE));
    } else {
        folder_of_output(desc->output, folder); /* its temporary name is there, too */
        allow(ruleset, folder,
              rights & (FS_WRITE_FILE | FS_TRUNCATE | FS_MAKE_FILE | FS_REMOVE_FILE | FS_READ_DIR));
    }
    return ruleset;
}

/* ---- who it is ---- */

static void keep_capabilities(uint32_t kept) {
    struct __user_cap_header_struct header = {.version = _LINUX_CAPABILITY_VERSION_3};
    struct __user_cap_data_struct data[_LINUX_CAPABILITY_U32S_3] = {0};
    if (syscall(SYS_capget, &header, data) != 0) return;
    const uint32_t mine = data[0].permitted & kept;
    memset(data, 0, sizeof data);
    data[0].permitted = mine;
    data[0].effective = mine;
    (void)syscall(SYS_capset, &header, data);
}

/* Root's files are still read, which Landlock bounds; so without that, root stays. */
static bool become_owner(const struct lw_cage_desc *desc) {
    char folder[PATH_MAX];
    struct stat st;
    folder_of_output(desc->output, folder);
    if (!desc->owner || geteuid() != 0 || stat(folder, &st) != 0 || st.st_uid == 0) return false;
    int death_signal = 0; /* another user's process forgets it */
    prctl(PR_GET_PDEATHSIG, &death_signal);
    prctl(PR_SET_KEEPCAPS, 1);
    const bool is_owner = setgroups(0, NULL) == 0 && setresgid(st.st_gid, st.st_gid, st.st_gid) == 0 &&
                          setresuid(st.st_uid, st.st_uid, st.st_uid) == 0;
    prctl(PR_SET_PDEATHSIG, death_signal);
    return is_owner;
}

static void give_up_privileges(const struct lw_cage_desc *desc, bool bounded) {
    const bool is_owner = bounded && become_owner(desc);
    uint32_t kept = CAP_TO_MASK(CAP_DAC_READ_SEARCH);
    if (!is_owner) kept |= CAP_TO_MASK(CAP_DAC_OVERRIDE);
    keep_capabilities(kept);
}

/* ---- seccomp ---- */

#if defined(__x86_64__)
#define ARCHITECTURE AUDIT_ARCH_X86_64
#elif defined(__aarch64__)
#define ARCHITECTURE AUDIT_ARCH_AARCH64
#endif

/* The calls for computing, reading and writing, by the C library, OpenMP and the decoders. A call that is not
 * here fails with ENOSYS, as on an older kernel, for which libraries have a way round. */
static const int calls[] = {
    SYS_read,
    SYS_write,
    SYS_readv,
    SYS_writev,
    SYS_pread64,
    SYS_pwrite64,
    SYS_close,
    SYS_lseek,
    SYS_dup,
    SYS_fcntl,
    SYS_fstat,
    SYS_statx,
    SYS_newfstatat,
    SYS_openat,
    SYS_openat2,
    SYS_faccessat,
    SYS_faccessat2,
    SYS_readlinkat,
    SYS_getcwd,
    SYS_getdents64,
    SYS_flock,
    SYS_fsync,
    SYS_fdatasync,
    SYS_ftruncate,
    SYS_fchmod,
    SYS_fchown,
    SYS_renameat,
    SYS_renameat2,
    SYS_unlinkat,
    SYS_ppoll,
    SYS_pselect6,
    SYS_munmap,
    SYS_mremap,
    SYS_madvise,
    SYS_brk,
    SYS_futex,
    SYS_set_robust_list,
    SYS_get_robust_list,
    SYS_rseq,
    SYS_membarrier,
    SYS_sched_yield,
    SYS_sched_getaffinity,
    SYS_sched_setaffinity,
    SYS_sched_getparam,
    SYS_sched_getscheduler,
    SYS_set_tid_address,
    SYS_exit,
    SYS_exit_group,
    SYS_rt_sigaction,
    SYS_rt_sigprocmask,
    SYS_rt_sigreturn,
    SYS_rt_sigpending,
    SYS_rt_sigtimedwait,
    SYS_sigaltstack,
    SYS_restart_syscall,
    SYS_getpid,
    SYS_getppid,
    SYS_gettid,
    SYS_getuid,
    SYS_geteuid,
    SYS_getgid,
    SYS_getegid,
    SYS_getrandom,
    SYS_clock_gettime,
    SYS_clock_getres,
    SYS_clock_nanosleep,
    SYS_nanosleep,
    SYS_gettimeofday,
    SYS_times,
    SYS_getrusage,
    SYS_uname,
    SYS_sysinfo,
    SYS_getrlimit,
    SYS_setrlimit,
    SYS_getcpu,
#ifdef SYS_open /* the older ways, which newer machines are without */
    SYS_open,
    SYS_stat,
    SYS_lstat,
    SYS_access,
    SYS_readlink,
    SYS_rename,
    SYS_unlink,
    SYS_poll,
    SYS_select,
    SYS_time,
    SYS_dup2,
#endif
#ifdef SYS_fadvise64
    SYS_fadvise64,
#endif
};
#define CALL_COUNT (sizeof calls / sizeof *calls)

/* Loads a word of what the filter sees: of an argument the low half, which is all that is asked. */
#define LOAD(field) BPF_STMT(BPF_LD | BPF_W | BPF_ABS, (uint32_t)offsetof(struct seccomp_data, field))
#define ANSWER(a)   BPF_STMT(BPF_RET | BPF_K, (a))
#define FAIL(error) ANSWER(SECCOMP_RET_ERRNO | (error))
#define ALLOW       ANSWER(SECCOMP_RET_ALLOW)
/* lines to skip where the loaded word is the value, has one of the bits, and where not */
#define IF(value, yes, no)    BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, (uint32_t)(value), yes, no)
#define IF_ANY(bits, yes, no) BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, (uint32_t)(bits), yes, no)

static bool filter_calls(void) {
#ifdef ARCHITECTURE
    const uint32_t me = (uint32_t)getpid();
    /* clang-format off */
    const struct sock_filter head[] = {LOAD(arch), IF(ARCHITECTURE, 1, 0), FAIL(ENOSYS), LOAD(nr)};
    const struct sock_filter tail[] = {
        /* memory, but none that runs */
        IF(SYS_mmap, 1, 0), IF(SYS_mprotect, 0, 4),
        LOAD(args[2]), IF_ANY(PROT_EXEC, 0, 1), FAIL(EPERM), ALLOW,
        /* threads, but no processes; clone3() has its flags in memory, where no filter sees them */
        IF(SYS_clone, 0, 4),
        LOAD(args[0]), IF_ANY(CLONE_THREAD, 0, 1), ALLOW, FAIL(EPERM),
        /* raise() and abort(), limits; but of no other process */
        IF(SYS_tgkill, 1, 0), IF(SYS_prlimit64, 0, 5),
        LOAD(args[0]), IF(me, 1, 0), IF(0, 0, 1), ALLOW, FAIL(EPERM),
        /* whether there is a terminal, and how wide */
        IF(SYS_ioctl, 0, 5),
        LOAD(args[1]), IF(TCGETS, 1, 0), IF(TIOCGWINSZ, 0, 1), ALLOW, FAIL(ENOTTY),
        /* a thread's name */
        IF(SYS_prctl, 0, 4),
        LOAD(args[0]), IF(PR_SET_NAME, 0, 1), ALLOW, FAIL(EPERM),
        FAIL(ENOSYS)};
    /* clang-format on */
    struct sock_filter filter[sizeof head / sizeof *head + 2 * CALL_COUNT + sizeof tail / sizeof *tail];
    size_t count = 0;
    for (size_t i = 0; i < sizeof head / sizeof *head; i++) filter[count++] = head[i];
    for (size_t i = 0; i < CALL_COUNT; i++) {
        filter[count++] = (struct sock_filter)IF(calls[i], 0, 1);
        filter[count++] = (struct sock_filter)ALLOW;
    }
    for (size_t i = 0; i < sizeof tail / sizeof *tail; i++) filter[count++] = tail[i];
    const struct sock_fprog program = {.len = (unsigned short)count, .filter = filter};
    return prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0;
#else
    return false;
#endif
}

/* ---- the cage ---- */

unsigned lw_cage_enter(const struct lw_cage_desc *desc) {
    unsigned missing = 0;
    close_strays(desc->kept);
    set_limits(desc);
    if (!lw_cage_is_built()) return 0;
    wipe_environment();
    (void)prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
    const int ruleset = make_rules(desc);
    give_up_privileges(desc, ruleset >= 0);
    if (ruleset < 0 || syscall(SYS_landlock_restrict_self, ruleset, 0) != 0) missing |= LW_CAGE_FILES;
    if (ruleset >= 0) close(ruleset);
    if (!filter_calls()) missing |= LW_CAGE_CALLS;
    return missing;
}
