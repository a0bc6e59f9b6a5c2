#include "server/serve/sessions/session_handlers.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "server/serve/sessions/fine_turns.h"
#include "server/serve/sessions/session_private.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

/* A client that draws direct light gets the rest; all others get all light, and no list of client-drawn
 * lights. */
static void choose_channels(struct lw_session *s, const struct lw_message_hello *hello,
                            struct lw_message_welcome *welcome) {
    const uint32_t served = s->shared->channels.served;
    const uint64_t asked = hello->features & lw_tile_channels_features(served);
    const uint32_t channels = lw_tile_channels_for(asked, served);
    s->take_count = 0;
    for (uint32_t c = 0; c < LW_TILE_CHANNELS_MAX; c++)
        if (channels >> c & 1) s->take[s->take_count++].channel = &s->shared->channels.at[c];
    LW_INVARIANT(s->take_count > 0 &&
                 s->take[0].channel->number < LW_TILE_CHANNEL_IRRADIANCES); /* irradiance */
    welcome->features |= asked;
    if (asked & LW_FEATURE_DRAWS) return;
    welcome->client_lights = welcome->client_materials = NULL;
    welcome->client_lights_size = welcome->client_materials_size = 0;
}

/* Who knows nothing of finishes hears nothing of them. */
static void choose_finishes(struct lw_session *s, const struct lw_message_hello *hello,
                            struct lw_message_welcome *welcome) {
    s->has_materials = (hello->features & LW_FEATURE_MATERIALS) && welcome->finish.size;
    if (s->has_materials)
        welcome->features |= LW_FEATURE_MATERIALS;
    else
        welcome->finish = (struct lw_message_package){0};
}

static void choose_finer(struct lw_session *s, const struct lw_message_hello *hello,
                         struct lw_message_welcome *welcome) {
    s->has_finer = (hello->features & LW_FEATURE_FINER) && s->shared->atlas_map->finer_count;
    if (!s->has_finer) return;
    welcome->features |= LW_FEATURE_FINER;
    welcome->finer = s->shared->atlas_map->finer_count;
}

/* Notes what the peer may do; false: it is refused. */
static bool admit(struct lw_session *s, const struct lw_message_hello *hello) {
    if (!s->shared->tokens || s->peer.may_control) return true;
    s->role = lw_tokens_role(s->shared->tokens, hello->token);
    if (s->role == LW_TOKENS_NONE) {
        lw_session_refuse(s, LW_REFUSAL_TOKEN, "%s",
                          hello->token ? "the token is not one of this server's"
                                       : "this server wants a token");
        return false;
    }
    memcpy(s->token.bytes, hello->token, sizeof s->token.bytes);
    s->peer.may_control = s->role == LW_TOKENS_CONTROL;
    s->keeps_control_place = s->peer.may_control && s->has_place;
    s->shared->control_count += s->keeps_control_place;
    LW_INVARIANT(s->shared->control_count <= s->shared->place_count);
    if (s->peer.may_control || !lw_session_is_crowded(s->shared)) return true;
    lw_session_refuse(s, LW_REFUSAL_FULL, "the last %u places are for those who may control",
                      lw_session_kept_places(s->shared));
    return false;
}

/* The light of a relay must not come back to it. false: it is refused. */
static bool admit_relay(struct lw_session *s, uint64_t relay) {
    const struct lw_session_shared *shared = s->shared;
    s->relay = relay;
    if (!relay) return true;
    for (uint32_t i = 0; i < shared->relay_count; i++)
        if (shared->relays[i] == relay) {
            lw_session_refuse(s, LW_REFUSAL_LOOP, "a loop of relays: this server's light comes through you");
            return false;
        }
    if (shared->relay_count < LW_MESSAGE_RELAYS_MAX) return true;
    lw_session_refuse(s, LW_REFUSAL_LOOP, "this server's light comes through %u relays already",
                      shared->relay_count);
    return false;
}

static void handle_hello(struct lw_session *s, const struct lw_message_hello *hello) {
    lw_peer_log_quote(s->name, sizeof s->name, hello->name && *hello->name ? hello->name : "nameless");
    if (hello->version != LW_WIRE_VERSION) {
        lw_session_refuse(s, LW_REFUSAL_VERSION, "this server speaks version %u of the protocol, not %u",
                          LW_WIRE_VERSION, hello->version);
        return;
    }
    if (!admit(s, hello) || !admit_relay(s, hello->relay)) return;
    const uint64_t lacking = s->shared->welcome.features & ~hello->features;
    if (lacking & LW_FEATURE_DCT) { /* tiles are encoded once: there are no others */
        lw_session_refuse(s, LW_REFUSAL_FEATURES,
                          "this server sends tiles of codec 4 (dct), which the client does not read: a newer "
                          "client does, and lightwelld --codec half sends others");
        return;
    }
    if (lacking) { /* so is the package */
        lw_session_refuse(s, LW_REFUSAL_FEATURES,
                          "this server's scene has textures, which are parts of the package that the client "
                          "does not read: a newer client does");
        return;
    }
    struct lw_message message = {.type = LW_MESSAGE_WELCOME, .welcome = s->shared->welcome};
    message.welcome.session = s->number;
    choose_channels(s, hello, &message.welcome);
    choose_finishes(s, hello, &message.welcome);
    choose_finer(s, hello, &message.welcome);
    if (s->relay) {
        message.welcome.relays = s->shared->relays;
        message.welcome.relay_count = s->shared->relay_count;
    }
    if (s->peer.is_web) message.welcome.servers = s->shared->web_servers;
    s->controls = s->peer.may_control && (s->shared->scene || s->shared->is_relay) &&
                  (hello->features & LW_FEATURE_CONTROL);
    if (s->controls) message.welcome.features |= LW_FEATURE_CONTROL;
    s->operates = s->peer.is_operator && (hello->features & LW_FEATURE_OPERATE);
    if (s->operates) message.welcome.features |= LW_FEATURE_OPERATE;
    lw_message_rates_trust(&s->rates, s->controls);
    s->resumes = hello->features & LW_FEATURE_RESUME;
    if (s->resumes) message.welcome.features |= LW_FEATURE_RESUME;
    s->reports = s->relay && (hello->features & LW_FEATURE_TREE);
    if (s->reports) message.welcome.features |= LW_FEATURE_TREE;
    s->reads_runs = s->shared->is_relay && (hello->features & LW_FEATURE_RUNS);
    if (s->reads_runs) message.welcome.features |= LW_FEATURE_RUNS;
    if (lw_blob_from_message(&message, &s->control) != LW_OK) {
        lw_session_lacks_memory(s);
        return;
    }
    s->rate_limit_bytes_hz = s->shared->limits.rate_limit_bytes_hz;
    if (hello->rate_limit_bytes_hz &&
        (!s->rate_limit_bytes_hz || hello->rate_limit_bytes_hz < s->rate_limit_bytes_hz))
        s->rate_limit_bytes_hz = hello->rate_limit_bytes_hz;
    s->allowed_ns = lw_clock_ns();
    LW_INVARIANT(s->state == LW_SESSION_EXPECTS_HELLO && !s->welcomed); /* else it counts twice */
    s->state = LW_SESSION_WELCOMED;
    s->welcomed = true;
    lw_session_queues_set_due(s, true);
    lw_session_count(s->shared, &s->shared->stats.sessions_total, 1);
    lw_session_count_one(s, 1);
    lw_session_tell(s, "joined%s", message.welcome.features & LW_FEATURE_DRAWS ? ", draws direct light" : "");
}

static bool make_sent(struct lw_session *s) {
    bool ok = true;
    for (struct lw_session_take *t = s->take; t < s->take + s->take_count; t++) {
        if (!t->sent) t->sent = calloc(lw_session_tiles(s) + 1ul, sizeof *t->sent);
        ok &= t->sent != NULL;
    }
    return ok;
}

/* What an earlier session of the peer was sent of irradiance counts as sent. */
static void handle_holds(struct lw_session *s, const struct lw_message_holds *holds) {
    const struct lw_session_take *take = &s->take[0];
    const struct lw_snapshot *snapshot = take->channel->snapshot;
    if (!make_sent(s)) {
        lw_session_lacks_memory(s);
        return;
    }
    for (size_t i = 0; i < holds->tile_count; i++) {
        struct lw_message_held t = holds->tile[i];
        uint32_t id = lw_atlas_map_find_tile(s->shared->atlas_map, t.object, t.level, t.tile).v;
        const bool is_ahead =
            !snapshot || (id != UINT32_MAX && t.version > snapshot->tile[take->channel->number][id].version);
        /* another relay, from which the peer comes, may be ahead of this one */
        if (id == UINT32_MAX || lw_atlas_finer(t.level) || (is_ahead && !s->shared->is_relay)) {
            lw_session_refuse(s, LW_REFUSAL_PROTOCOL,
                              "message HOLDS: there is no object %u, level %u, tile %u of version %" PRIu64,
                              t.object, t.level, t.tile, t.version);
            return;
        }
        take->sent[id] = t.version;
    }
    if (holds->frame > (snapshot ? snapshot->frame : 0) && !s->shared->is_relay)
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL, "message HOLDS: there is no frame %" PRIu64, holds->frame);
    else if (holds->frame > s->frame_held)
        s->frame_held = holds->frame;
}

/* A request for a package that a welcome announced; false: it makes no sense, and the peer is refused. */
static bool check_request(struct lw_session *s, const char *name, const struct lw_message_package *package,
                          const struct lw_message_package_request *request) {
    if (request->offset > package->compressed_size) {
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL, "message %s: offset is past the package's end", name);
        return false;
    }
    for (size_t i = package->part_count; i < 8 * request->held_size; i++)
        if (request->held[i / 8] >> (i % 8) & 1) {
            lw_session_refuse(s, LW_REFUSAL_PROTOCOL, "message %s: held names a part that is not there",
                              name);
            return false;
        }
    return true;
}

static void handle_package_request(struct lw_session *s, const struct lw_message_package_request *request) {
    const struct lw_session_shared *shared = s->shared;
    const struct lw_message_package package = lw_message_welcome_package(&shared->welcome);
    if (!check_request(s, "PACKAGE_REQUEST", &package, request)) return;
    if (!make_sent(s) || !lw_send_queue_start(&s->package, &shared->package, package.part_count, request)) {
        lw_session_lacks_memory(s);
        return;
    }
    LW_INVARIANT(s->state == LW_SESSION_WELCOMED); /* else its channels would count it twice */
    s->state = LW_SESSION_STREAMING;
    s->first_light_due = s->shared->first_light != NULL;
    lw_session_queues_set_due(s, true);
    lw_session_interest_join(s);
}

static void handle_finish_request(struct lw_session *s, const struct lw_message_package_request *request) {
    const struct lw_session_shared *shared = s->shared;
    const struct lw_message_package *finish = &shared->welcome.finish;
    if (!check_request(s, "FINISH_REQUEST", finish, request)) return;
    if (lw_send_queue_start(&s->finishes, &shared->finishes, finish->part_count, request))
        lw_session_queues_set_due(s, true);
    else
        lw_session_lacks_memory(s);
}

/* The id of a tile that a session lists; UINT32_MAX: it is of a finer level, and has none yet. */
static bool name_tile(const struct lw_session *s, const struct lw_message_interest_tile *t,
                      uint32_t *out_id) {
    const struct lw_atlas_map *map = s->shared->atlas_map;
    if (!lw_atlas_map_has_tile(map, t->object, t->level, t->tile) ||
        (lw_atlas_finer(t->level) && !s->has_finer))
        return false;
    *out_id = lw_atlas_map_find_tile(map, t->object, t->level, t->tile).v;
    return true;
}

/* Gives ids to listed tiles of finer levels, coarser levels first, as they have their turns (fine_turns.h).
 * UINT32_MAX: there is no id left for a tile, or none for this session. */
static void claim_fine(const struct lw_session *s, const struct lw_message_interest *said, uint32_t *id) {
    const struct lw_atlas_map *map = s->shared->atlas_map;
    uint32_t fine = 0;
    for (uint32_t k = 1; s->has_finer && k <= map->finer_count; k++)
        for (size_t i = 0; i < said->tile_count; i++) {
            const struct lw_message_interest_tile *t = &said->tile[i];
            if (lw_atlas_finer(t->level) != k) continue;
            if (fine >= LW_SESSION_FINE_MAX)
                id[i] = UINT32_MAX;
            else if (id[i] == UINT32_MAX && lw_fine_turns_may_claim(map, fine))
                id[i] = lw_atlas_map_claim_tile(map, t->object, t->level, t->tile).v;
            fine++;
        }
}

/* Notes a session's interest. A peer may say it as often as it likes: the first holds at once, later ones
 * wait for the next snapshot or tick, the last of them alone. */
static void handle_interest(struct lw_session *s, const struct lw_message_interest *said) {
    struct lw_session_interest interest = {.everything = said->everything, .stand_ins = said->stand_ins};
    if (said->tile_count && !(interest.tile = malloc(said->tile_count * sizeof *interest.tile))) {
        lw_session_lacks_memory(s);
        return;
    }
    for (size_t i = 0; i < said->tile_count; i++) {
        const struct lw_message_interest_tile *t = &said->tile[i];
        if (name_tile(s, t, &interest.tile[i])) continue;
        free(interest.tile);
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL,
                          "message INTEREST: there is no object %u, level %u, tile %u", t->object, t->level,
                          t->tile);
        return;
    }
    claim_fine(s, said, interest.tile);
    uint64_t *listed = s->shared->listed;
    for (size_t i = 0; i < said->tile_count; i++)
        if (interest.tile[i] != UINT32_MAX && !lw_session_interest_test_and_set(listed, interest.tile[i]))
            interest.tile[interest.tile_count++] = interest.tile[i];
    LW_INVARIANT(interest.tile_count <= said->tile_count && !(interest.everything && interest.tile_count));
    lw_session_interest_forget_fine(s, &s->interest, listed);
    lw_session_interest_forget_fine(s, &s->waiting, listed);
    for (uint32_t i = 0; i < interest.tile_count; i++) listed[interest.tile[i] / 64] = 0;
    lw_fine_names_add(&s->shared->fine, interest.tile, interest.tile_count);
    lw_session_interest_free(s, &s->waiting);
    s->waiting = interest;
    s->has_waiting = true;
    if (s->interest_epoch == s->shared->epoch) return;
    if (lw_session_interest_take_up(s))
        lw_session_queues_set_due(s, true);
    else
        lw_session_lacks_memory(s);
}

/* The server above checks it, and answers. */
static void pass_update(struct lw_session *s, const struct lw_message_update *update) {
    const struct lw_token *token = s->role == LW_TOKENS_NONE ? NULL : &s->token;
    if (lw_passed_updates_add(&s->shared->passed, s, token, update)) return;
    lw_session_answer(s, &(struct lw_message_updated){.request = update->request,
                                                      .code = LW_SCENE_CHANGE_BUSY,
                                                      .text = lw_scene_change_text(LW_SCENE_CHANGE_BUSY)});
}

static void handle_update(struct lw_session *s, const struct lw_message_update *update) {
    struct lw_session_shared *shared = s->shared;
    struct lw_message_updated refused = {.request = update->request};
    struct lw_error err = {0};
    uint32_t added[LW_MESSAGE_CHANGES_MAX], object;
    size_t added_count = 0;
    lw_scene_roster_save(&shared->roster);
    for (size_t i = 0; i < update->change_count && !refused.code; i++) {
        const struct lw_scene_change *change = &update->change[i];
        refused.code = lw_scene_change_check(shared->scene, change, &err);
        if (!refused.code) refused.code = lw_scene_roster_take(&shared->roster, change, &object, &err);
        if (!refused.code && change->kind == LW_SCENE_CHANGE_OBJECT_ADD) added[added_count++] = object;
        refused.change = refused.code ? (uint32_t)i : 0;
    }
    refused.text = err.text;
    if (!refused.code && !lw_updates_add(&shared->updates, s, update->request, update->change,
                                         update->change_count, added, added_count)) {
        refused.code = LW_SCENE_CHANGE_BUSY;
        refused.text = lw_scene_change_text(LW_SCENE_CHANGE_BUSY);
    }
    if (!refused.code) return;
    lw_scene_roster_go_back(&shared->roster); /* nothing of it is done */
    lw_session_answer(s, &refused);
}

/* Says that the peer has the light of a frame; how long that took is what we measure of links. */
static void handle_ack(struct lw_session *s, uint64_t frame) {
    const struct lw_session_shared *shared = s->shared;
    if (frame == 0 || frame > s->frame_sent || frame < s->frame_acked) {
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL, "message ACK: frame %" PRIu64 " %s", frame,
                          frame && frame <= s->frame_sent ? "after a later one" : "was not sent");
        return;
    }
    if (frame == s->frame_acked) return;
    LW_INVARIANT(s->frame_acked < frame);
    const bool first = s->frame_acked == 0;
    s->frame_acked = frame;
    if (first) return; /* the frame may be much older than the session */
    for (uint64_t back = 0; back < LW_SESSION_RECENT && back < shared->generation; back++) {
        const struct lw_session_recent *recent =
            &shared->recent[(shared->generation - back) % LW_SESSION_RECENT];
        if (recent->frame > frame) continue;
        if (recent->frame == frame) {
            const uint64_t ack_ns = lw_clock_ns() - recent->at_ns;
            lw_histogram_add(&s->shared->ack, ack_ns);
            lw_durations_add(&s->shared->ack_all, ack_ns);
        }
        return;
    }
}

static void handle_ask(struct lw_session *s, const struct lw_message_ask *ask) {
    char *text = NULL;
    struct lw_message_report report = {.request = ask->request};
    report.code = s->shared->ask(s->shared->server, ask, &text, &report.size);
    report.data = (const uint8_t *)text;
    lw_session_queue_answer(s, &(struct lw_message){.type = LW_MESSAGE_REPORT, .report = report});
    free(text);
}

static void handle_report(struct lw_session *s, const struct lw_message_report *report) {
    struct lw_error err = {0};
    if (!s->reports)
        lw_session_refuse(s, LW_REFUSAL_NOT_ALLOWED, "message REPORT: this session may not send it");
    else if (lw_session_relays_report(s, report, &err) != LW_OK)
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL, "%s", err.text);
}

static void handle_message(struct lw_session *s, const struct lw_message *m) {
    bool in_order = m->type == LW_MESSAGE_HELLO             ? s->state == LW_SESSION_EXPECTS_HELLO
                    : m->type == LW_MESSAGE_PACKAGE_REQUEST ? s->state == LW_SESSION_WELCOMED
                    : m->type == LW_MESSAGE_FINISH_REQUEST
                        ? s->state == LW_SESSION_STREAMING && s->has_materials && !s->finishes.of
                    : m->type == LW_MESSAGE_HOLDS
                        ? s->state == LW_SESSION_WELCOMED && s->resumes
                        : s->state == LW_SESSION_WELCOMED || s->state == LW_SESSION_STREAMING;
    if (!in_order) {
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL, "message %s: out of order",
                          lw_message_name((uint16_t)m->type));
        return;
    }
    switch (m->type) {
    case LW_MESSAGE_HELLO:
        handle_hello(s, &m->hello);
        break;
    case LW_MESSAGE_PACKAGE_REQUEST:
        handle_package_request(s, &m->package_request);
        break;
    case LW_MESSAGE_FINISH_REQUEST:
        handle_finish_request(s, &m->finish_request);
        break;
    case LW_MESSAGE_HOLDS:
        handle_holds(s, &m->holds);
        break;
    case LW_MESSAGE_INTEREST:
        handle_interest(s, &m->interest);
        break;
    case LW_MESSAGE_UPDATE:
        if (s->controls && s->shared->is_relay)
            pass_update(s, &m->update);
        else if (s->controls)
            handle_update(s, &m->update);
        else
            lw_session_refuse(s, LW_REFUSAL_NOT_ALLOWED,
                              "message UPDATE: this session may not change the scene");
        break;
    case LW_MESSAGE_ASK:
        if (s->operates)
            handle_ask(s, &m->ask);
        else
            lw_session_refuse(s, LW_REFUSAL_NOT_ALLOWED,
                              "message ASK: that is for the server's own Unix socket alone");
        break;
    case LW_MESSAGE_REPORT:
        handle_report(s, &m->report);
        break;
    case LW_MESSAGE_PING:
        s->pong_due = true;
        s->pong_token = m->ping.token;
        lw_session_queues_set_due(s, true);
        break;
    case LW_MESSAGE_ACK:
        handle_ack(s, m->ack.frame);
        break;
    case LW_MESSAGE_PONG: /* hearing the peer is all that counts */
        break;
    default:
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL, "message %s: not one that a client sends",
                          lw_message_name((uint16_t)m->type));
    }
}

/* Takes one message; false: none is whole yet, or the session came to its end. */
static bool take_message(struct lw_session *s) {
    struct lw_framing_header header;
    struct lw_message message;
    struct lw_error err = {0};
    const uint8_t *body;
    enum lw_status status = lw_message_reader_take(&s->input, &header, &body, &err);
    if (status == LW_OK && !body) return false;
    if (status == LW_OK) status = lw_message_decode_with(header, body, &s->shared->parse, &message, &err);
    if (status == LW_NO_MEMORY) {
        lw_session_lacks_memory(s);
        return false;
    }
    if (status != LW_OK) {
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL, "%s", err.text);
        return false;
    }
    handle_message(s, &message);
    lw_message_finish(&message);
    (void)lw_message_rates_count(&s->rates, header, lw_clock_ns());
    return true;
}

static bool takes_more(const struct lw_session *s) {
    return s->state < LW_SESSION_LEAVING && !s->lacks_memory;
}

/* Handles the messages at hand, as far as others do not have to wait and the peer keeps to its rates. */
void lw_session_handlers_take(struct lw_session *s) {
    unsigned count = 0;
    bool more = true;
    while (takes_more(s) && !s->rates.waits && count < LW_SERVER_TURN_MESSAGES && more) {
        more = take_message(s);
        count++;
    }
    if (!takes_more(s)) {
        lw_message_reader_clear(&s->input);
        if (s->state == LW_SESSION_LEAVING && !s->rates.waits) lw_session_queues_read_on(s);
    } else if (lw_message_reader_keep(&s->input) != LW_OK) {
        lw_session_lacks_memory(s);
    } else if (s->rates.waits) {
        lw_session_queues_enter_inbox(s, &s->shared->queues.slowed);
    } else if (more) {
        lw_session_queues_enter_inbox(s, &s->shared->queues.unread);
    } else {
        lw_session_queues_read_on(s);
    }
}

/* Adds to bytes kept before: while a session is in an inbox a link may still hand over bytes that it read. */
void lw_session_handlers_receive(struct lw_session *s, const uint8_t *bytes, size_t size) {
    if (s->state == LW_SESSION_LEAVING) lw_session_count_other(s, LW_MESSAGE_RATES_BYTES, size);
    if (!takes_more(s)) return;
    s->heard_ns = lw_clock_ns();
    s->pinged = false;
    lw_message_reader_lend(&s->input, bytes, size);
    if (!s->inbox)
        lw_session_handlers_take(s);
    else if (lw_message_reader_keep(&s->input) != LW_OK)
        lw_session_lacks_memory(s);
}
