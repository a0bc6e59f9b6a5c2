/* cage.h: takes the rights from the importer's process that reading a scene does not need, before it reads a
 * byte. So a file that takes over a decoder gains little.
 * Flow:    arguments -> [cage] -> scene, read and written inside
 * Threads: main() only, before it starts others: they inherit the cage.
 *
 * Each part is there or not, by the kernel; missing parts are returned, to be reported once. */
#ifndef LW_IMPORT_CAGE_H
#define LW_IMPORT_CAGE_H

#include <stdbool.h>
#include <stdint.h>

#define LW_CAGE_KEPT_MAX 2

struct lw_cage_desc {
    const char *scene;          /* may be read, and what lies in its folder and below; NULL: no file */
    bool scene_alone;           /* it names no others: its folder is not to be read */
    const char *environment;    /* may be read; or NULL */
    const char *output;         /* may be written: files of its folder, or a device or pipe */
    int kept[LW_CAGE_KEPT_MAX]; /* descriptors beside the first three; 0: none */
    bool owner;                 /* as root: become the owner of the output's folder */
    uint64_t memory_bytes;      /* address space; 0: as it is */
    uint64_t file_bytes;        /* largest file to write */
};

/** Features that a kernel may lack. */
enum lw_cage_part {
    LW_CAGE_FILES = 1, /* Landlock: no file but the desc's is opened, changed or removed by any user */
    LW_CAGE_CALLS = 2, /* seccomp: no socket, no program, no process, no signal to others, no ptrace */
};

/** Enters the cage, for good. Closes descriptors. Makes limits of memory, files, descriptors and core dumps
 * hard. Wipes the environment. Gives up privileges, and as root all capabilities but those to read and write
 * files. Builds with a sanitizer or for coverage, which read and write files of their own, get neither of the
 * parts. Returns the parts that are missing, of enum lw_cage_part. */
unsigned lw_cage_enter(const struct lw_cage_desc *desc);

/** Whether this build can have the parts at all. */
bool lw_cage_is_built(void);

#endif
