/* client_case.h: what tests of the client library connect to: a scene with its package and light, behind our
 * own server, or a peer that says what a script has.
 * Threads: a server and a script run in threads of their own; the rest is the test's. */
#ifndef LW_TESTS_CLIENT_CASE_H
#define LW_TESTS_CLIENT_CASE_H

#include "client/lib/client.h"
#include "server/serve/server.h"
#include "tests/support/support.h"

#include <pthread.h>

#define CLIENT_CASE_WAIT_NS 600000000000u /* time limit of a wait */

/* ---- a scene, its package and messages about it ---- */

struct client_case_world {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    uint8_t *package, *compressed;
    size_t package_size, compressed_size;
    struct lw_tile_codec *codec;
};

/** spares: as lightwelld --spares, or NULL. */
struct client_case_world client_case_make_world_with(const char *spares);
struct client_case_world client_case_make_world(void);
void client_case_finish_world(struct client_case_world *w);

/** The value of texel (x, y) of a level in a version: exact in half floats over the tile's scale. */
float client_case_value_of(uint32_t object, uint32_t level, uint32_t x, uint32_t y, int channel,
                           uint64_t version);

/** payload: lw_tile_codec_bound() bytes. */
struct lw_message client_case_tile_message(const struct client_case_world *w, uint32_t id, uint64_t version,
                                           uint8_t *payload);

/** The client has this tile's light, as that version has it. */
void client_case_expect_texels(const struct lw_client *client, const struct client_case_world *w, uint32_t id,
                               uint64_t version);

/** The client has this tile in that version, with its light. */
void client_case_expect_tile(const struct lw_client *client, const struct client_case_world *w, uint32_t id,
                             uint64_t version);

/* ---- our own server ---- */

/** Body of a server's thread. */
void *client_case_serve(void *server);

/** All tiles in version `frame`, in both forms. */
struct lw_snapshot *client_case_make_snapshot(const struct client_case_world *w, uint64_t frame);

/** Polls until the client has been sent that number of tiles. */
void client_case_poll_until_tiles(struct lw_client *client, uint64_t tiles);

struct client_case_running {
    struct lw_server *server;
    pthread_t thread;
};

/** desc: beside the address and the world. */
struct client_case_running client_case_start_server_with(const struct client_case_world *w,
                                                         struct lw_server_desc desc);
struct client_case_running client_case_start_server(const struct client_case_world *w, uint16_t port);
void client_case_stop_server(struct client_case_running *r);
/** Takes the reference. */
void client_case_publish(const struct client_case_running *r, struct lw_snapshot *snapshot);

/** Polls until the client has noticed that its connection is broken. */
void client_case_lose_connection(struct lw_client *client);

/* ---- folders of packages ---- */

/** Calls back for each file of a folder with this ending; returns their number. */
unsigned client_case_for_files(const char *folder, const char *suffix,
                               void (*call)(const char *path, void *to), void *to);
/** Returns the number of removed files. */
unsigned client_case_remove_files(const char *folder, const char *suffix);
/** For client_case_for_files(): adds the size of the file to *(size_t *)to. */
void client_case_add_size(const char *path, void *to);
/** For client_case_for_files(): empties the file if *(bool *)to, else changes its first byte. */
void client_case_damage(const char *path, void *to);

/* ---- a peer that reads from a script ---- */

struct client_case_script {
    uint8_t *bytes;
    size_t size;
    bool closes; /* after the last byte; otherwise it stays silent until the client goes */
    int listener;
    uint16_t port;
    _Atomic bool said; /* all of it has been sent */
    pthread_t thread;
};

/** Appends to the script. */
void client_case_say_bytes(struct client_case_script *s, const void *bytes, size_t size);
void client_case_say(struct client_case_script *s, const struct lw_message *message);

struct lw_message client_case_welcome_of(const struct client_case_world *w);

/** In pieces of seven bytes and then the rest, so that decompression starts and stops. */
void client_case_say_package(struct client_case_script *s, const struct client_case_world *w);

/** Starts the thread that plays the script, and ends it. */
void client_case_begin(struct client_case_script *s);
void client_case_end(struct client_case_script *s);

/** Plays the script to a client until it fails as expected. created: there was a welcome. */
void client_case_expect_failure_of(struct client_case_script *s, bool draws, enum lw_status expected,
                                   const char *text, bool created);

void client_case_expect_failure(struct client_case_script *s, enum lw_status expected, const char *text,
                                bool created);

/** A frame and all of its tiles, after which the client asks for finishes. */
void client_case_say_all_light(struct client_case_script *s, const struct client_case_world *w,
                               uint64_t version);

#endif
