/* load_scene.h: what all users of a load test share: the server's address, the scene package, its tiles.
 * Flow:    HOST:PORT -> one session that downloads the package -> [load_scene] -> all other sessions
 * Threads: fetched by one thread; then immutable. */
#ifndef LW_CLIENT_LOAD_LOAD_SCENE_H
#define LW_CLIENT_LOAD_LOAD_SCENE_H

#include "client/lib/access.h"
#include "client/load/viewer_model.h"
#include "proto/message.h"

#include <sys/socket.h>

struct lw_load_scene {
    struct sockaddr_storage address; /* the address that answered */
    struct ssl_ctx_st *trust;        /* by TLS: whom users believe; NULL: they connect in plain */
    struct lw_package_hash hash;     /* the package's */
    uint64_t package_size, compressed_size;
    uint8_t *compressed; /* the package as it came; NULL if it was not to be kept */
    uint32_t object_count, light_count;
    struct lw_atlas_map map;
    struct lw_viewer_model *viewer_model; /* NULL if it was not asked for */
    uint64_t download_ns;                 /* from connect to the whole package */
};

/** Connects, downloads the package, reads it, leaves.
 * access            with which token, and whether by TLS
 * keep_compressed   keep the package's bytes, to compare what others get
 * with_model        find out where tiles are
 * out_scene         must not be moved afterwards; all zero on failure.
 * Errors: LW_NO_HOST; LW_UNAVAILABLE naming the address ("is lightwelld running?"); LW_TIMED_OUT;
 *         LW_PROTOCOL for a peer that is no lightwelld or breaks the protocol; LW_CLOSED; LW_BAD_DATA;
 *         LW_NO_MEMORY; LW_NOT_ALLOWED: it takes no such token. */
LW_MUST_CHECK enum lw_status lw_load_scene_fetch(const char *host, uint16_t port,
                                                 const struct lw_access *access, bool keep_compressed,
                                                 bool with_model, struct lw_load_scene *out_scene,
                                                 struct lw_error *err);
void lw_load_scene_finish(struct lw_load_scene *scene);

#endif
