/* daemon.h: the state of lightwelld for one scene: the scene, its solver, its publisher, its server.
 * Flow:    settings -> [daemon: scene, server, solver] -> daemon_frames, daemon_succession
 * Threads: the loop's [loop]; one solver thread [solver] simulates, solves and publishes. They share the
 *          server's hand-over and the atomic fields, nothing else. */
#ifndef LW_SERVER_DAEMON_H
#define LW_SERVER_DAEMON_H

#include "common/base/waiting.h"
#include "common/light/client_lights.h"
#include "common/scene/package.h"
#include "common/scene/scene_state.h"
#include "server/daemon_memory.h"
#include "server/daemon_metrics.h"
#include "server/daemon_settings.h"
#include "server/file_stamp.h"
#include "server/nats/nats_publisher.h"
#include "server/publish/change_store.h"
#include "server/publish/light_store.h"
#include "server/publish/publisher.h"
#include "server/serve/server.h"

#include <pthread.h>
#include <stdatomic.h>
#include <time.h>

/* A thread that prepares the next scene at SIGHUP. */
struct lw_daemon_succession {
    pthread_t thread;
    bool runs;           /* it is to be joined */
    _Atomic bool ended;  /* it leaves next alone from now on, and does not relay */
    _Atomic bool relays; /* the server hands over to next's */
    bool only_scene;     /* no option has changed: a scene that is the same changes nothing */
    struct lw_daemon *next;
    struct lw_server_sockets sockets;
};

struct lw_daemon {
    struct lw_daemon_settings settings;
    struct lw_server_hooks hooks; /* their context is this daemon */
    _Atomic bool *signalled;      /* a signal has come before the loop watches for any */
    int argc;
    char **argv; /* as it was called */
    struct lw_file_stamp scene_stamp, environment_stamp;
    struct lw_daemon_succession succession;
    struct lw_scene *scene;
    struct lw_scene_state state; /* the scene as updates left it: this is lit */
    uint8_t *package;            /* until the server takes it */
    uint8_t *finishes;           /* the same of the finish package; NULL: all is matt */
    size_t package_size, finishes_size;
    struct lw_package_hash package_hash, finishes_hash;
    struct lw_atlas_map atlas_map;
    struct lw_pose pose;
    struct lw_light_groups light_groups;
    struct lw_client_lights client_lights;
    uint8_t *light_bits, *material_bits; /* the same for the WELCOME */
    bool *directional;                   /* per object: its tiles say where light comes from */
    bool has_directions;                 /* some object's do */
    struct lw_daemon_memory memory;
    struct lw_solver *solver;
    struct lw_publisher *publisher;
    struct lw_server *server;
    struct lw_nats_publisher *nats; /* NULL: none */
    pthread_t solver_thread;
    struct lw_light_store light_store;   /* if --keep says so */
    struct lw_change_store change_store; /* if --keep-changes does */
    struct lw_scene_change *restored;    /* changes of the last run, for the first frame */
    size_t restored_count;
    _Atomic bool stopping;
    _Atomic bool cancel;            /* ends a frame under way */
    _Atomic bool lit;               /* the solver has had a frame */
    struct lw_waiting first_light;  /* how far that is */
    _Atomic uint64_t solver_due_ns; /* when the solver must have made progress; UINT64_MAX: it rests */
    _Atomic uint64_t frame_count;   /* frames solved */
    struct lw_error solver_error;   /* read after the thread is joined */
    bool logged_stall, stops;       /* [loop] */
    struct lw_daemon_metrics metrics;
    const char *isa; /* instruction set of the rays' kernels */
    uint64_t started_ns, rays_total;
    uint64_t first; /* number of the first frame: 1, or after the frames of the saved light */
    struct {        /* until there is light */
        uint64_t lit_ns, frame_ns, texels; /* the end of the first frame, how long it took, what it solved */
        unsigned rounds;                   /* that all of the light has had (frames whose light is shown) */
    } young;
    uint64_t published; /* the last frame that was */
    bool moved;         /* something has moved since then */
    bool owes_snapshot; /* there was no memory for one */
    bool owes_channel;  /* nor for a channel that somebody takes */
    bool is_looked_at;  /* by some client */
    uint64_t interest;  /* the number of the list of interest that the solver has (lw_server_interest) */
    uint64_t published_interest; /* the newest snapshot's */
    bool is_coarse;              /* tiles are of a coarse scene (coarse_first.h) */
    bool prepares;               /* all of the scene is solved, though nobody looks */
    uint64_t prepared_ns;        /* wall time for which it was */
    uint32_t channels;           /* channels shown and published: bit for each (tile_channels.h) */
    uint32_t channels_kept;      /* channels of the saved light */
    uint64_t taken_ns[LW_TILE_CHANNELS_MAX]; /* when somebody last took it */
};

/** Sets the defaults. signalled: a flag that a handler sets; it ends long work. */
void lw_daemon_init(struct lw_daemon *daemon, int argc, char **argv, _Atomic bool *signalled);
void lw_daemon_finish(struct lw_daemon *daemon);

/** Opens the scene and names its tiles, lights and groups. Errors: the scene's; LW_USAGE naming an option. */
LW_MUST_CHECK enum lw_status lw_daemon_read_scene(struct lw_daemon *daemon, struct lw_error *err);
/** Makes the server of the scene. sockets: those of the server before; NULL: there was none.
 * Errors: lw_server_create()'s. */
LW_MUST_CHECK enum lw_status lw_daemon_create_server(struct lw_daemon *daemon,
                                                     struct lw_server_sockets *sockets, struct lw_error *err);
/** Shows the light of the last run, for --keep. Clients get it as soon as the server runs, seconds before the
 * solver has texels to light. With --keep-changes the first frame makes the changes of that run.
 * Errors: lw_light_store_init()'s, lw_change_store_open()'s. */
LW_MUST_CHECK enum lw_status lw_daemon_restore_light(struct lw_daemon *daemon, struct lw_error *err);
/** Makes solver and publisher. Errors: theirs. */
LW_MUST_CHECK enum lw_status lw_daemon_set_up_solver(struct lw_daemon *daemon, struct lw_error *err);
/** Empties the solver's interest set. Errors: LW_NO_MEMORY; the solver's. */
LW_MUST_CHECK enum lw_status lw_daemon_solve_nothing(struct lw_daemon *daemon, struct lw_error *err);

/** Bytes of solver and publisher. */
uint64_t lw_daemon_memory_bytes(const struct lw_daemon *daemon);
/** Lowers the priority of the calling thread; its workers inherit that. */
void lw_daemon_give_way(void);
/** A moment of CLOCK_REALTIME, for pthread_timedjoin_np(). */
struct timespec lw_daemon_in_seconds(unsigned seconds);

#endif
