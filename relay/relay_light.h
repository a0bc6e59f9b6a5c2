/* relay_light.h: the light of one scene as another server sent it: tiles that stay encoded, and where
 * everything is.
 * Flow:    FRAME, TILE, SETTLED of one session for each channel -> [relay_light] -> snapshots -> server
 * Threads: one thread at a time.
 * Memory:  the scene, two references to encoded tiles, no texels.
 *
 * Tiles keep the versions that they came with, but for those of a later run (lw_relay_light_begin_run()). One
 * that came as a delta is also made whole, for clients that join. Every byte may come from anyone: each
 * tile is decoded once before it is forwarded.
 *
 * Tiles of finer levels are here for as long as clients list them (relay_fine.h). A session above forgets
 * them when it ends. Then they stay, in doubt: the first SETTLED of the next session withdraws the tiles that
 * did not come again. Where their versions would fall they get larger ones: no HOLDS names them. */
#ifndef LW_RELAY_LIGHT_H
#define LW_RELAY_LIGHT_H

#include "common/scene/scene.h"
#include "common/tile/atlas.h"
#include "server/publish/snapshot.h"

struct lw_relay_light;

#define LW_RELAY_LIGHT_FINE_MAX 4096u /* tiles of finer levels that clients may list at a time */

/** Reads a scene package; keeps none of its bytes. finer: levels that are finer than level 0, at most
 * LW_ATLAS_FINER_MAX. Errors: LW_BAD_DATA, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_relay_light_create(const uint8_t *package, size_t size, uint32_t finer,
                                                   struct lw_relay_light **out_light, struct lw_error *err);
void lw_relay_light_destroy(struct lw_relay_light *light);

const struct lw_scene *lw_relay_light_scene(const struct lw_relay_light *light);
const struct lw_atlas_map *lw_relay_light_map(const struct lw_relay_light *light);

/** A session that gets this channel begins. The channel is in snapshots again from when there is light for
 * every object. */
void lw_relay_light_begin(struct lw_relay_light *light, uint32_t channel);
/** It is over. Snapshots lack the channel while there are other sessions; its tiles stay, for the next
 * session of the same run. */
void lw_relay_light_end(struct lw_relay_light *light, uint32_t channel);

/** Sessions from now on are of another run of the same scene: none may be open. Their frames and versions
 * count on from those that are there, so that clients keep their sessions; snapshots tell them `run`, which
 * names all of it. Numbers that this header takes and gives are those of the server above.
 * Returns false: numbers have come to their end, and nothing has changed. */
LW_MUST_CHECK bool lw_relay_light_begin_run(struct lw_relay_light *light, uint64_t run);
/** The run that snapshots tell from now on; numbers stay as they are. 0: none. */
void lw_relay_light_set_run(struct lw_relay_light *light, uint64_t run);
/** The run that snapshots tell; 0: none. */
uint64_t lw_relay_light_run(const struct lw_relay_light *light);
/** By how much clients' numbers of frames are ahead of those of the server above; 0: no runs were joined. */
uint64_t lw_relay_light_ahead(const struct lw_relay_light *light);
/** A frame of a server above, as clients count that are ahead by so much; 0 stays 0. */
uint64_t lw_relay_light_count(uint64_t frame, uint64_t ahead);
/** A frame of the server above, as clients count; 0 stays 0. */
uint64_t lw_relay_light_frame_for_clients(const struct lw_relay_light *light, uint64_t frame);

/** What the session says. Errors: LW_PROTOCOL; LW_NO_MEMORY. After an error the session must end; what came
 * before stays. */
LW_MUST_CHECK enum lw_status lw_relay_light_take_frame(struct lw_relay_light *light, uint32_t channel,
                                                       const struct lw_message_frame *frame,
                                                       struct lw_error *err);
LW_MUST_CHECK enum lw_status lw_relay_light_take_tile(struct lw_relay_light *light, uint32_t channel,
                                                      const struct lw_message_tile *tile,
                                                      struct lw_error *err);
LW_MUST_CHECK enum lw_status lw_relay_light_take_settled(struct lw_relay_light *light, uint32_t channel,
                                                         uint64_t frame, struct lw_error *err);

/** The newest list of clients' interest, with its number (lw_server_interest). Returns whether a snapshot is
 * due without waiting for light: tiles of finer levels were dropped, and their ids are free with it. */
bool lw_relay_light_list(struct lw_relay_light *light, uint64_t number, const uint32_t *tile, uint32_t count);
/** The server above was sent this list of interest, by the channel's session. */
void lw_relay_light_ask(struct lw_relay_light *light, uint32_t channel, const lw_tile_id *tile,
                        uint32_t count);

/** The version that it has of a tile that is not of a finer level; 0: none of this run. */
uint64_t lw_relay_light_version(const struct lw_relay_light *light, uint32_t channel, lw_tile_id tile);
/** The last frame of the session; 0: none came. */
uint64_t lw_relay_light_frame(const struct lw_relay_light *light, uint32_t channel);
/** Whether every object has light in this channel. */
bool lw_relay_light_has_first(const struct lw_relay_light *light, uint32_t channel);

/** What came since the last snapshot. */
enum lw_relay_light_news {
    LW_RELAY_LIGHT_NOTHING,
    LW_RELAY_LIGHT_SOME, /* tiles of the frame are still to come */
    LW_RELAY_LIGHT_ALL   /* all of a frame, in some channel */
};
enum lw_relay_light_news lw_relay_light_news(const struct lw_relay_light *light);

/** A snapshot of all that came. With no session it is the last frame again, with every channel that has
 * light: what there is stays.
 * *out_snapshot: a new reference; NULL: there is no light yet, or the sessions are behind the last snapshot.
 * Errors: LW_NO_MEMORY; a later one has what this one would have had. */
LW_MUST_CHECK enum lw_status lw_relay_light_snapshot(struct lw_relay_light *light,
                                                     struct lw_snapshot **out_snapshot);

#endif
