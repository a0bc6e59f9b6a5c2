/* serving.h: a server in a thread of its own, and raw sockets of the test as its peers. Snapshots are made by
 * hand: the payloads only have to be bytes. Peers ask for one irradiance, which snapshots have; the server
 * knows both. The server's clock stands from its start to its end: no time-out strikes unless the test moves
 * the clock. A test of it has LIBS lw_test_serving and WRAP clock_gettime uv_timer_start uv_timer_stop
 * (server_clock.h). */
#ifndef LW_TESTS_SERVING_H
#define LW_TESTS_SERVING_H

#include "common/scene/scene.h"
#include "common/tile/atlas.h"
#include "server/serve/server.h"
#include "tests/support/server_clock.h"
#include "tests/support/support.h"

#include <pthread.h>

#define SERVING_OBJECTS      3u
#define SERVING_STEP_MS      20 /* step of the clock while a peer waits */
#define SERVING_PAYLOAD_SIZE 20000u
#define SERVING_PACKAGE_SIZE 300000u
#define SERVING_FLOOD_MAX    (6u << 20) /* upper bound on the bytes that sockets hold */
#define SERVING_CLIENT_TOKEN 0x1122334455667788u

/* The irradiance that peers ask for. */
extern uint32_t serving_channel;
/* The clock goes on while a peer waits for bytes. serving_start() resets it. */
extern bool serving_is_paced;
/* Finer levels of the next server, and the ids that their tiles share. */
extern uint32_t serving_finer_levels, serving_fine_room;

/* ---- the server ---- */

struct serving {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    uint8_t *package;
    struct lw_server *server;
    pthread_t thread;
    enum lw_status result;
};

/** Body of a server's thread; context is its fixture. */
void *serving_serve(void *context);

/** The package: noise, unless extra has one. */
struct serving *serving_start(const struct lw_server_desc *extra);

/** Waits for the end of the server's thread and destroys the server. */
void serving_join(struct serving *f);
/** Frees the rest of the fixture. */
void serving_discard(struct serving *f);
/** Stops the server, joins and discards. */
void serving_end(struct serving *f);

struct lw_server_stats serving_stats_of(const struct serving *f);
void serving_wait_for_sessions(const struct serving *f, uint64_t sessions);

/* ---- snapshots ---- */

struct lw_blob *serving_blob_of(const struct lw_message *message);

/** All tiles of version `frame`, which is a number of its own: two of them are a frame to the server. The
 * full frame message has time 1, the delta time 2, to tell them apart. */
struct lw_snapshot *serving_make_snapshot(const struct serving *f, uint64_t frame, uint64_t previous);

/** Takes the reference. */
void serving_publish(struct serving *f, struct lw_snapshot *snapshot);

/* ---- a peer ---- */

/** receive_buffer: bytes, 0: the system's choice. Returns a socket, as all that dial do. */
int serving_dial_with_buffer(const struct serving *f, int receive_buffer);
int serving_dial(const struct serving *f);

void serving_put_bytes(int s, const void *bytes, size_t size);
void serving_put(int s, const struct lw_message *message);
bool serving_is_readable(int s);

/** Reads exactly size bytes; false at the end of the stream. */
bool serving_get_bytes(int s, uint8_t *dst, size_t size);

/** Reads the next message; false at the end of the stream. */
bool serving_get(int s, struct lw_message *out);

/** Reads the next message, which must have this type. */
void serving_expect(int s, enum lw_message_type type, struct lw_message *out);
/** Expects REFUSAL with this code and time to come back, and then the end of the stream. */
void serving_expect_refusal_after(int s, enum lw_refusal code, uint32_t retry_after_ms);
void serving_expect_refusal(int s, enum lw_refusal code);

/* HELLO of a new client, and of one that resumes (LW_FEATURE_RESUME). */
extern const struct lw_message serving_hello, serving_hello_again;

/** Says HELLO and reads WELCOME. */
int serving_dial_and_greet(const struct serving *f);
int serving_dial_and_greet_with(const struct serving *f, uint64_t features);

void serving_ask_for_package(int s, uint64_t offset);
/** Says HELLO, reads WELCOME, and asks for light as a client that has the package. */
int serving_dial_and_stream(const struct serving *f);

void serving_expect_frame(int s, uint64_t frame, double time_s);
void serving_expect_tiles(int s, uint32_t count, uint64_t version);

/** A whole frame message, with all of the tiles. */
void serving_expect_light(const struct serving *f, int s, uint64_t frame);

/** Nothing is on its way to a peer, and nothing comes: questions get their answers and nothing in between.
 * Two of them, as an answer may overtake tiles, which are sent before the second question is read. Time goes
 * by, so that the server lets more of them in. */
void serving_expect_silence(int s);

int serving_dial_again(const struct serving *f, struct lw_message_welcome *out_welcome);

/* ---- updates ---- */

extern const struct lw_scene_change serving_hide_1, serving_sky, serving_no_such;

/** A server whose scene may be changed; fixtures make theirs before the server knows it. */
struct serving *serving_start_controlled_with(struct lw_server_desc desc);
struct serving *serving_start_controlled(void);

/** Dials the server's Unix socket. */
int serving_dial_locally(void);
/** Greets over the Unix socket, as a client that may change the scene; asks for light if it streams. */
int serving_dial_and_control(const struct serving *f, bool stream);

void serving_update(int s, uint64_t request, const struct lw_scene_change *change, size_t count);

/** Waits until `updates` updates have arrived, and takes them for a frame. */
struct lw_scene_change *serving_take(const struct serving *f, uint64_t frame, size_t updates, size_t changes);

/** Writes until the link takes no more though the server has had its turns, or the other end has closed it,
 * which sets *out_closed. Returns the bytes. total: bytes of these that are written already. */
size_t serving_flood(int s, const struct lw_blob *bytes, size_t total, bool *out_closed);

/** Set-up of tests in which peers ask for the split irradiance. */
int serving_ask_for_split(void **state);

#endif
