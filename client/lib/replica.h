/* replica.h: the client's copy of the lit scene: geometry, where things are, atlases as far as they arrived.
 * Flow:    package, frame and tile messages -> [replica] -> renderer
 * Threads: one thread at a time. */
#ifndef LIGHTWELL_REPLICA_H
#define LIGHTWELL_REPLICA_H

#include "client/lib/client.h"
#include "common/scene/pose.h"
#include "proto/message.h"

#define LW_REPLICA_BYTES_MAX  (8ull << 30) /* for a channel's atlases; a scene that needs more is refused */
#define LW_REPLICA_FINE_MAX   2048u /* tiles of finer levels that have ids; some 75 KB each once they come */
#define LW_REPLICA_IRRADIANCE 0u    /* slots (tile_channels.h) */
#define LW_REPLICA_DIRECTION  1u

struct lw_replica;

/** Reads the package and makes room for all levels of all atlases (pages come when tiles do). Tiles of finer
 * levels are taken while they have ids (atlas.h).
 * finer   how many levels are finer than level 0
 * Errors: LW_BAD_DATA, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_replica_create(const uint8_t *package, size_t size, uint32_t finer,
                                               struct lw_replica **out_replica, struct lw_error *err);
/** A replica of the same scene, which `other` owns and must outlive it; no light in it yet. Errors:
 * LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_replica_create_beside(const struct lw_replica *other,
                                                      struct lw_replica **out_replica, struct lw_error *err);
void lw_replica_destroy(struct lw_replica *replica);

/** Called for each tile whose irradiance or direction has changed, in the replica's thread. It may only read
 * the replica. */
typedef void lw_replica_watch(void *context, lw_tile_id tile);
/** watch: NULL for nobody */
void lw_replica_set_watch(struct lw_replica *replica, lw_replica_watch *watch, void *context);

/** Another session begins: nobody tells it which tiles of finer levels are no light any more. Drops them
 * all; they keep their ids. */
void lw_replica_forget_fine(struct lw_replica *replica);
/** The server has started again. Versions that come from now on count as newer than all that are there. */
void lw_replica_begin_run(struct lw_replica *replica);
/** The version of a tile as the present run of the server counts; 0: it is not of this run. */
uint64_t lw_replica_version_of_run(const struct lw_replica *replica, lw_tile_id tile);

/** Tiles are of these channels from now on, at most one for each slot and one of irradiance. Tiles of
 * others are dropped. A new replica takes LW_TILE_CHANNEL_FULL. Errors: LW_NO_MEMORY, LW_BAD_DATA for too
 * many texels. */
LW_MUST_CHECK enum lw_status lw_replica_set_channels(struct lw_replica *replica, uint32_t channels,
                                                     struct lw_error *err);

/** Takes over transforms, lights, visibility, materials and sky. Errors: LW_PROTOCOL for an object, light or
 * material that the scene does not have. */
LW_MUST_CHECK enum lw_status
lw_replica_take_frame(struct lw_replica *replica, const struct lw_message_frame *frame, struct lw_error *err);

/** Decodes a tile into its level. Ignores a tile that is no newer than the one there, or of a layer that
 * is unknown or not taken.
 * Errors: LW_PROTOCOL for a place, codec or payload that makes no sense, or a tile of another channel. */
LW_MUST_CHECK enum lw_status lw_replica_take_tile(struct lw_replica *replica,
                                                  const struct lw_message_tile *tile, struct lw_error *err);

/** Drops a tile of a finer level, which loses its id. */
void lw_replica_release_fine(struct lw_replica *replica, lw_tile_id tile);

/** Reads a finish package for the scene, which stays as it is until lw_replica_show_finishes(): others may
 * read the scene meanwhile. Not for a replica beside another. Errors: as lw_finish_package_read(). */
LW_MUST_CHECK enum lw_status lw_replica_read_finishes(struct lw_replica *replica, const uint8_t *package,
                                                      size_t size, struct lw_error *err);
/** Whether the scene is another replica's. */
bool lw_replica_is_beside(const struct lw_replica *replica);
/** Gives the scene the finishes that were read. */
void lw_replica_show_finishes(struct lw_replica *replica);

/** Whether every object's coarsest level is there. */
bool lw_replica_has_first(const struct lw_replica *replica);

/** The scene, with the materials and the sky of the newest frame. */
const struct lw_scene *lw_replica_scene(const struct lw_replica *replica);
/** The same as its package has it. */
const struct lw_scene *lw_replica_own_scene(const struct lw_replica *replica);
bool lw_replica_object_hidden(const struct lw_replica *replica, uint32_t object);
enum lw_client_object_state lw_replica_object_state(const struct lw_replica *replica, uint32_t object);
/** A light of the scene as the newest frame has it. */
const struct lw_light_state *lw_replica_light(const struct lw_replica *replica, uint32_t light);
const struct lw_atlas_map *lw_replica_atlas_map(const struct lw_replica *replica);
const struct lw_affine *lw_replica_object_to_world(const struct lw_replica *replica, uint32_t object);
struct lw_client_level lw_replica_get_level(const struct lw_replica *replica, uint32_t object,
                                            uint32_t level);
struct lw_client_tile lw_replica_get_tile(const struct lw_replica *replica, lw_tile_id tile);
/** The same of any slot: texels row by row, a float per plane; NULL: there are none. */
const float *lw_replica_get_texels(const struct lw_replica *replica, uint32_t slot, uint32_t object,
                                   uint32_t level);
struct lw_client_tile lw_replica_get_tile_of(const struct lw_replica *replica, uint32_t slot,
                                             lw_tile_id tile);

#endif
