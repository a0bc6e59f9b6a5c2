/* live_state.h: what the parts of liblightwell share: struct lw_live and its lock.
 * Flow:    client -> [live_state] <- live, live_scene, live_texels -> lightwell/lightwell.h -> engine
 * Threads: functions here run with the lock, or before and after there are two threads; lw_live_lock() is for
 * [any]. */
#ifndef LIGHTWELL_LIVE_STATE_H
#define LIGHTWELL_LIVE_STATE_H

#include "client/include/lightwell/lightwell.h"
#include "client/lib/client.h"
#include "client/lib/live_interest.h"
#include "client/lib/live_slots.h"
#include "client/lib/live_tiles.h"
#include "common/scene/pose.h"

#include <pthread.h>
#include <stdatomic.h>

#define LW_LIVE_KINDS 7u /* enum lw_live_kind */

struct lw_live {
    struct lw_client *client;
    uint32_t flags;
    uint32_t finer_slots; /* as of the lw_live_desc */
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
    uint64_t taken, reported; /* times that something was taken in; as of the last lw_live_poll() */
    enum lw_status ended;     /* why the thread has ended */
    struct lw_error reason;   /* the same, in words */
    bool other_scene;         /* the server lights one; the thread waits until the caller knows */

    /* once the scene is there */
    const struct lw_scene *scene;
    uint32_t *by_name[LW_LIVE_KINDS]; /* indices, sorted by name, then by index */
    struct lw_vec3 (*mesh_box)[2];    /* per mesh: least and greatest corner, object space */
    struct lw_pose cameras;           /* where they are; nothing else of it */
    bool has_cameras;
    struct lw_live_tiles tiles;
    struct lw_live_slots slots;
    struct lw_live_interest interest;

    struct lw_client_answer answer; /* the last one that was taken */
};

void lw_live_lock(const struct lw_live *live);
void lw_live_unlock(const struct lw_live *live);

#endif
