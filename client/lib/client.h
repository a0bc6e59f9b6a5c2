/* client.h: a live copy of the light of a lightwelld, for our own programs. liblightwell
 * (lightwell/lightwell.h) is built on it.
 *
 *     struct lw_client_desc desc = {0};
 *     desc.host = "127.0.0.1";
 *     desc.port = 7780;
 *     struct lw_client *client;
 *     struct lw_error err = {LW_OK, ""};
 *     if (lw_client_create(&desc, &client, &err) != LW_OK) ...
 *     while (lw_client_scene(client) == NULL) lw_client_poll(client, 100, &err);
 *     every frame: lw_client_poll(client, 0, &err), then read atlases and transforms,
 *                  draw albedo/pi * E + emission.
 *
 * Threads: one thread at a time per client; no threads of its own. */
#ifndef LIGHTWELL_CLIENT_H
#define LIGHTWELL_CLIENT_H

#include "client/lib/access.h"
#include "common/base/waiting.h"
#include "common/scene/scene.h"
#include "common/scene/scene_change.h"
#include "common/tile/atlas.h"

struct lw_client;

/** Callbacks from within lw_client_create(), lw_client_reconnect() and lw_client_poll(); each may be NULL. */
struct lw_client_watch {
    void *context;
    /** The scene has arrived: once, before any tile of it. */
    enum lw_status (*scene)(void *context, const struct lw_client *client, struct lw_error *err);
    /** The scene has its finishes now: once a scene, if desc.materials. */
    void (*finishes)(void *context);
    /** The texels of a tile have changed. */
    void (*tile)(void *context, lw_tile_id tile);
    /** Waits in place of the client until a descriptor can be read (or written), or until the deadline
     * (lw_clock_ns). false: the session is to end. */
    bool (*wait)(void *context, int descriptor, bool for_writing, uint64_t deadline_ns);
    /** A file in the folder of packages is not what its name says, or cannot be read: it is downloaded again.
     * Once per client. */
    void (*damaged)(void *context, const char *folder);
    /** A downloaded package, or a part of it, could not be written to that folder: the next client downloads
     * it again. `why` names the file. */
    void (*unkept)(void *context, const char *why);
    /** Called around connecting, which may take long and uses nothing of the client. */
    void (*leave)(void *context);
    void (*enter)(void *context);
};

struct lw_client_desc {
    const char *host;
    uint16_t port;
    const struct lw_access *access; /* copied; NULL: without a token */
    const char *name;               /* for the operator's log; NULL: "liblightwell" */
    unsigned timeout_ms;            /* for connect and for the server's answer; 0: 5000 */
    /* For a process with many sessions of one server: a client that has its scene and outlives this one. If
     * the server has the same scene, it is shared and not downloaded. NULL: none. */
    const struct lw_client *scene_of;
    /* A folder for scene packages, by their hashes. A package that is in it is not downloaded; a downloaded
     * one is written to it if possible. Over 1 GiB the least recently used files are removed. NULL: none. */
    const char *cache_folder;
    bool wants_nothing; /* its interest set is empty until lw_client_want(); else it begins with everything */
    bool control;       /* it may call lw_client_update() */
    bool operate;       /* it may call lw_client_ask(); it gets no scene */
    /* It wants the finishes of materials, which come after its first light (lw_client_finishes()). Means
     * nothing with scene_of: a shared scene keeps the finishes of the moment when it was shared. */
    bool materials;
    bool draws_direct; /* it draws the direct light that lw_client_draws() lists: levels come without it */
    uint32_t finer;    /* how many levels finer than level 0 it wants to read, at most */
    uint64_t channel_features;    /* bits that ask for more channels (tile_channels.h); 0: irradiance alone */
    uint64_t rate_limit_bytes_hz; /* the most that the server sends; 0: all that the link takes */
    uint64_t budget_ns;           /* lw_client_poll() takes no further message in after this; 0: 20 ms */
    struct lw_client_watch watch;
};

/** Connects and says hello; returns once the server has welcomed us.
 * Errors: LW_NO_HOST; LW_UNAVAILABLE naming the address ("is lightwelld running?"); LW_TIMED_OUT; LW_PROTOCOL
 * for a peer that is no lightwelld or of another version; LW_NOT_ALLOWED: it
 * takes no such token, or none. */
LW_MUST_CHECK enum lw_status lw_client_create(const struct lw_client_desc *desc,
                                              struct lw_client **out_client, struct lw_error *err);
void lw_client_destroy(struct lw_client *client);

/** Connects again after lw_client_poll() has failed. The client keeps its scene, its light and its interest
 * set.
 *   same run of the server   sends tiles that changed since, and the rest of a package that was cut short.
 *   a new run                sends all its light again; the old light stays until that comes.
 *   other client lights      (lw_client_draws()): tiles are dropped and come again.
 * Versions of tiles go on growing; numbers of frames (lw_client_stats) start again with the server. Updates
 * without an answer get none: nobody says whether they were made.
 *
 * Wait lw_client_backoff_ms() before each attempt; may be called until it succeeds. Attempts go in turn to
 * its last server, to the servers that this one named, and to desc.host.
 * Errors: as lw_client_create(); LW_BAD_DATA if there is another scene now (lw_client_found_other_scene()):
 * for that one forget this one first, or create another client. */
LW_MUST_CHECK enum lw_status lw_client_reconnect(struct lw_client *client, struct lw_error *err);

/** Whether the last lw_client_reconnect() failed because the server lights another scene now. */
bool lw_client_found_other_scene(const struct lw_client *client);

/** Drops scene, light, interest set and answers, after lw_client_reconnect() has failed: the next one takes
 * up whatever scene there is, and calls watch.scene(). */
void lw_client_forget_scene(struct lw_client *client);

/** How long to wait before an attempt to connect again, in ms. The time is random, so that not all clients of
 * a restarted server come at once. Its range doubles with each attempt (0, 1, ...) up to 500 to 1000.
 * seed  something that differs from client to client */
unsigned lw_client_backoff_ms(unsigned attempt, uint32_t seed);

/** The same where the server has said when to come back (0: it has not): the first attempt waits that
 * long, and up to half of it more. */
unsigned lw_client_return_ms(uint32_t retry_after_ms, unsigned attempt, uint32_t seed);
/** When to come back, as the server said with its last REFUSAL, ms; 0: it did not. */
uint32_t lw_client_retry_after_ms(const struct lw_client *client);

/** Waits up to timeout_ms for something to arrive (0: does not wait), then takes in all that is there
 * (bounded per call).
 * Errors: LW_CLOSED when the server ended the session (text says why), LW_PROTOCOL, LW_NO_MEMORY. After an
 * error only lw_client_reconnect() and lw_client_destroy() may follow; scene and light stay readable. */
LW_MUST_CHECK enum lw_status lw_client_poll(struct lw_client *client, unsigned timeout_ms,
                                            struct lw_error *err);

/** For use with an event loop of your own: poll() it for reading, then call lw_client_poll(client, 0,
 * ...). */
int lw_client_descriptor(const struct lw_client *client);

/** The scene, once its package has arrived; NULL before. Geometry, materials, lightmap UVs. Lives with the
 * client. lw_client_poll() keeps materials' base_colour and emission and the sky as the newest frame has them
 * (lw_client_stats.changed_frame), and gives it finishes once (lw_client_finishes()); nothing else of it
 * changes. */
const struct lw_scene *lw_client_scene(const struct lw_client *client);
/** Finishes of a scene's materials: material.finish, mesh.tangent, finish_texture. */
enum lw_client_finishes {
    LW_CLIENT_FINISHES_NONE, /* none will come: all is matt, or was not asked for; or there is no scene yet */
    LW_CLIENT_FINISHES_COMING, /* the scene is shown matt until they are there */
    LW_CLIENT_FINISHES_THERE   /* in lw_client_scene(), within lw_client_poll(); watch.finishes() said so */
};
/** With a server of before, or a scene without finishes, NONE from the scene's arrival on. */
enum lw_client_finishes lw_client_finishes(const struct lw_client *client);

/** Fraction of the scene package that has arrived, 0..1. */
float lw_client_package_progress(const struct lw_client *client);
/** The tiles of the scene, for walking over atlases; NULL before the scene is there. */
const struct lw_atlas_map *lw_client_atlas_map(const struct lw_client *client);
/** How many finer levels the session has, of those of the map; 0: none, or the scene is not there yet.
 * Another server may have fewer. */
uint32_t lw_client_finer(const struct lw_client *client);

/** Hash of the scene's package, which tells whether two clients have the same scene: LW_CLIENT_HASH_SIZE
 * bytes, zeros before the scene is there. */
#define LW_CLIENT_HASH_SIZE 16
const uint8_t *lw_client_package_hash(const struct lw_client *client);

/** Where an object is now. */
const struct lw_affine *lw_client_object_to_world(const struct lw_client *client, uint32_t object);

/** What the server says of an object. */
enum lw_client_object_state {
    LW_CLIENT_OBJECT_SHOWN,
    LW_CLIENT_OBJECT_HIDDEN,
    LW_CLIENT_OBJECT_SPARE /* it stands nowhere, and may be added: LW_SCENE_CHANGE_OBJECT_ADD */
};
/** Errors: none; an object that is not there is a spare, as one is before the scene has arrived. */
enum lw_client_object_state lw_client_object_state(const struct lw_client *client, uint32_t object);

/** Whether an object is not to be drawn now: it is hidden, or a spare, or it was added and none of its light
 * has arrived yet. That light comes to clients with an empty interest set, too. */
bool lw_client_object_hidden(const struct lw_client *client, uint32_t object);

/** A light as it is now. */
struct lw_client_light {
    struct lw_vec3 position_ws, direction_ws; /* m; unit, where it shines */
    struct lw_vec3 intensity;                 /* W/sr, or W/m^2 for a directional light */
};
/** Errors: none; a light that is not there is all zero. */
struct lw_client_light lw_client_get_light(const struct lw_client *client, uint32_t light);

/** A material's emission when the server began, W/(m^2 sr); lw_client_scene() has the current one.
 * Errors: none; a material that is not there gives zeros. */
struct lw_vec3 lw_client_own_emission(const struct lw_client *client, uint32_t material);

/** The client draws the direct light of these: 1 for each such light, and for each material of the scene with
 * such emission. */
struct lw_client_draws {
    uint32_t light_count, material_count; /* as in the scene */
    const uint8_t *light, *material;
};
/** Levels then hold all light but that: add, at each point, the direct light of these lights as the newest
 * frame has them (lw_client_get_light(), the scene's materials), by the equations of proto/wire_format.md,
 * section 6. The same as long as the session lasts; lw_client_reconnect() may bring another list, or none.
 * Valid until that, or lw_client_destroy().
 *
 * NULL: nothing; levels hold all light. So it is without desc.draws_direct, with a server that has no such
 * lights or is older, and before the scene is there. */
const struct lw_client_draws *lw_client_draws(const struct lw_client *client);

/** One level of one object's atlas. */
struct lw_client_level {
    uint32_t width, height;
    const float *rgb; /* irradiance, W/m^2: width*height*3, row by row; zeros where nothing has arrived */
    /* Where it comes from (common/light/direction_form.h): its cosine moment over its luminance, world space,
     * likewise; zeros where that is not known. NULL: not asked for, or not served. */
    const float *direction;
};
/** Errors: none; an object or level that is not there, or is finer than level 0, gives width 0. */
struct lw_client_level lw_client_get_level(const struct lw_client *client, uint32_t object, uint32_t level);

/** The same of any channel's slot (tile_channels.h): a float per plane, zeros where nothing has arrived;
 * NULL: there are none, or the server does not serve it. */
const float *lw_client_get_texels(const struct lw_client *client, uint32_t slot, uint32_t object,
                                  uint32_t level);

#define LW_CLIENT_INTEREST_MAX 4096u /* tiles in a list */

/** Sets the client's interest set. The server lights the interest sets of its clients and their contributors,
 * and sends each client its own set. With a tile come the coarser tiles that cover it; the coarsest level of
 * every object comes as well. Other tiles that have arrived stay readable and grow old.
 *
 * List what you draw, at the level that you read, and some more around it: a tile that enters the set shows
 * old light at first, then sharpens. Call it as often as you like. lw_client_poll() tells the server at most
 * ten times a second: of new tiles at once, of a few that left the set within two seconds.
 *
 * tile    in any order; copied. One of a finer level has an id (atlas.h), and loses it, and its light, some
 * time after
 *         it is listed no more. count 0: no tiles. More than LW_CLIENT_INTEREST_MAX different tiles:
 *         everything, which costs the server a whole solve. Coarser levels of far objects keep the list
 *         short.
 * Errors  LW_USAGE before the scene is there (but for count 0), or for a tile that it does not have;
 *         LW_NO_MEMORY */
LW_MUST_CHECK enum lw_status lw_client_want(struct lw_client *client, const lw_tile_id *tile, size_t count);
/** The interest set is every tile, as in a new client. */
void lw_client_want_everything(struct lw_client *client);

#define LW_CLIENT_CHANGES_MAX 1024u /* in one update */
#define LW_CLIENT_UPDATES_MAX 1024u /* sent, with an answer that was not taken yet */

/** Whether the server takes updates from this client: desc.control was set, and its token, or
 * where the client is, allows it. */
bool lw_client_may_update(const struct lw_client *client);

/** Changes the scene, for everybody: all of these changes in one frame, or none. They are made in the order
 * given, after all updates that the server got before. The later of two changes to the same thing counts.
 * The changes last until the server ends. scene_change.h has their kinds and limits. The
 * server checks every number; lw_client_next_answer() gives its answer.
 *
 * change       copied; count up to LW_CLIENT_CHANGES_MAX, and 0 is fine: it asks for the next frame's number
 * out_request  may be NULL: the number that the answer will carry, from 1 on
 * Errors  LW_UNAVAILABLE where lw_client_may_update() is false. LW_TIMED_OUT while LW_CLIENT_UPDATES_MAX
 *         answers are not taken yet, or the link is busy: nothing was sent; poll, then try again. LW_USAGE
 *         for too many changes. LW_CLOSED, LW_NO_MEMORY as lw_client_poll() */
LW_MUST_CHECK enum lw_status lw_client_update(struct lw_client *client, const struct lw_scene_change *change,
                                              size_t count, uint64_t *out_request, struct lw_error *err);

/** What became of an update. */
struct lw_client_answer {
    uint64_t request;
    /* enum lw_scene_change_code, or one of a newer server; other than 0: all of the update is refused */
    uint32_t code;
    uint32_t change; /* the first one that is wrong, counted from 0 */
    /* The first frame that shows the update; 0: refused. A client that gets frames has it by now, or a later
     * one. */
    uint64_t frame;
    char text[257]; /* one line for people; empty if it was done */
    /* The object of each LW_SCENE_CHANGE_OBJECT_ADD, in their order; readable until the next call of
     * lw_client_next_answer(). */
    const uint32_t *added;
    size_t added_count;
};
/** Takes the next answer that has arrived; false: there is none. Each update gets one. */
bool lw_client_next_answer(struct lw_client *client, struct lw_client_answer *out_answer);

/** Whether the server takes questions from this client: desc.operate was set, and it is over the server's own
 * Unix socket, which is looked for on this machine. */
bool lw_client_may_ask(const struct lw_client *client);

/** Asks as an operator (enum lw_ask of proto/message.h); lw_client_take_report() gives the answer.
 * return_after_ms  with LW_ASK_DRAIN: what other clients get; 0: the server's own
 * Errors: LW_NOT_ALLOWED: see lw_client_may_ask(); LW_CLOSED. */
LW_MUST_CHECK enum lw_status lw_client_ask(struct lw_client *client, uint32_t what, uint32_t return_after_ms,
                                           struct lw_error *err);
/** Takes the answer that has arrived; false: there is none. out_text: ends with a zero, the caller free()s
 * it. */
bool lw_client_take_report(struct lw_client *client, uint32_t *out_code, char **out_text);

/** Why there is no light yet, as the server said last: at most five times a second, until its first light.
 * stage  enum lw_waiting_stage (waiting.h). UNKNOWN: it has said nothing, as one of before never does, or a
 *        stage of a newer one. READY once there is light to send: with the first frame at the latest
 * share  of the stage that is done, 0 to 1 */
struct lw_waiting_state lw_client_waiting(const struct lw_client *client);

/** One tile, as the client has it. */
struct lw_client_tile {
    /* 0: not here yet. Grows; compare it with the last one you uploaded to see whether the tile has
     * changed. */
    uint64_t version;
    uint32_t bounces;    /* indirect bounces in it */
    float error;         /* relative standard error */
    uint64_t arrived_ns; /* lw_clock_ns() when this version came */
    /* A finer level's tile has its irradiance here, W/m^2, width*height*3 of its place, row by row, for it is
     * in no level of an atlas. Else NULL. */
    const float *rgb;
    const float *direction;     /* the same of lw_client_level.direction; NULL: not here */
    uint64_t direction_version; /* as version, of where its light comes from, at any level; 0: not here */
};
/** Grows when the tile's light, or where that comes from, changes; 0: it is not there. */
static inline uint64_t lw_client_tile_changes(const struct lw_client_tile *tile) {
    return tile->version ? tile->version + tile->direction_version : 0;
}
struct lw_client_tile lw_client_get_tile(const struct lw_client *client, lw_tile_id tile);

/** Counters and clocks. */
struct lw_client_stats {
    uint64_t frame;                /* newest frame heard of */
    uint64_t settled_frame;        /* newest frame of which all tiles have arrived */
    double time_s;                 /* scene time of that frame */
    uint64_t frames, tiles, bytes; /* received */
    /* compressed bytes of the scene package and of the finish package; 0: not known, or there is none */
    uint64_t package_bytes, finish_bytes;
    uint64_t rays_total;    /* the server's, as of that frame */
    uint64_t server_cpu_ns; /* CPU time of the server's process since it started; 0: not known */
    uint64_t decode_ns;     /* spent on decoding tiles */
    /* lw_clock_ns() of the call to connect, of the complete package, and of the first light, every object's
     * coarsest level. 0: not yet. */
    uint64_t connected_ns, package_ns, first_ns;
    uint64_t finishes_ns; /* lw_clock_ns() when the scene got its finishes; 0: not yet */
    /* How old the newest frame's light is now: its solve time plus the time since it arrived. The network's
     * delay is not in it. It grows until the next frame. A server whose light has converged sends no frames:
     * where nothing moves and every tile's error is at most target_error, the light is current at any age. */
    uint64_t light_age_ns;
    uint32_t bounces;   /* in a complete tile */
    float target_error; /* below which a tile counts as converged */
    /* about what share of a tile's error is left in its texels after the server's filter */
    float noise_shown;
    float sky[3];
    uint64_t changed_frame; /* the last one that changed materials or hidden objects; 0: none */
};
void lw_client_get_stats(const struct lw_client *client, struct lw_client_stats *out_stats);

#endif
