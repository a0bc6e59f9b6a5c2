/* live.h: what the parts of liblightwell share: struct lw_live, its lock, and structs of several versions,
 * which are told apart by their size.
 * Flow:    client -> [live: session, live_scene, live_tiles, live_interest] -> lightwell/lightwell.h ->
 *          engine
 * Threads: functions here run with the lock, or before and after there are two threads; lw_live_lock() is for
 * [any]. */
#ifndef LIGHTWELL_LIVE_H
#define LIGHTWELL_LIVE_H

#include "client/include/lightwell/lightwell.h"
#include "client/lib/client.h"
#include "client/lib/live_interest.h"
#include "client/lib/live_tiles.h"
#include "common/scene/pose.h"

#include <pthread.h>
#include <stdatomic.h>

#define LW_LIVE_KINDS 7u /* enum lw_live_kind */

struct lw_live {
    struct lw_client *client;
    uint32_t flags;
    bool is_connected;
    uint64_t sessions;

    /* With LW_LIVE_THREAD: a thread locks `turn`, then `data`, then unlocks `turn`. So no thread gets `data`
     * twice while another waits. */
    pthread_mutex_t turn, data;
    pthread_cond_t news; /* with data */
    pthread_t thread;
    bool has_thread;
    int wake; /* eventfd: ends the thread's waiting */
    atomic_bool stops;
    uint64_t taken, told;   /* times that something was taken in; as of the last lw_live_poll() */
    enum lw_status ended;   /* why the thread has ended */
    struct lw_error reason; /* likewise */
    bool other_scene;       /* the server lights one; the thread waits until the caller knows */

    /* once the scene is there */
    const struct lw_scene *scene;
    uint32_t *by_name[LW_LIVE_KINDS]; /* indices, sorted by name, then by index */
    struct lw_vec3 (*mesh_box)[2];    /* per mesh: least and greatest corner, object space */
    struct lw_pose cameras;           /* where they are; nothing else of it */
    bool has_cameras;
    struct lw_live_tiles tiles;
    struct lw_live_interest interest;

    struct lw_client_answer answer; /* the last one that was taken */
};

void lw_live_lock(const struct lw_live *live);
void lw_live_unlock(const struct lw_live *live);

/** Fills in an error; err may be NULL. */
enum lw_live_status lw_live_fail(struct lw_live_error *err, enum lw_live_status status, const char *format,
                                 ...) LW_PRINTF(3, 4);
/** The same of an error of ours. */
enum lw_live_status lw_live_pass(struct lw_live_error *err, enum lw_status status,
                                 const struct lw_error *cause);

/** Takes over a struct from outside: what its version lacks is zero. false: no version has its size. */
bool lw_live_read_struct(void *dst, size_t dst_size, const void *src);
/** Hands out what the caller's version has of a struct; src's own struct_size is not read. false:
 * likewise. */
bool lw_live_write_struct(void *dst, void *src, size_t src_size);

/** Prepares what only the scene says. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_live_scene_init(struct lw_live *live, const struct lw_scene *scene);
/** A zeroed one is fine. */
void lw_live_scene_finish(struct lw_live *live);

#endif
