#include "client/load/load_scene.h"

#include "client/lib/download.h"
#include "client/lib/link.h"
#include "common/base/clock.h"

#include <stdlib.h>
#include <string.h>

#define TIMEOUT_MS 5000u /* to connect, and to be welcomed */

/* The session that downloads for all. */
struct scout {
    const struct lw_access *access;
    struct lw_link link;
    struct lw_download download;
    bool welcomed;
    struct lw_load_scene *scene;
    size_t capacity; /* scene->compressed's, if that is kept */
    bool keep;
};

static enum lw_status keep_chunk(struct scout *s, const struct lw_message_package_chunk *chunk,
                                 struct lw_error *err) {
    size_t needed = (size_t)(chunk->offset + chunk->size);
    if (needed > s->capacity) {
        size_t capacity = needed > 2 * s->capacity ? needed : 2 * s->capacity;
        uint8_t *grown = realloc(s->scene->compressed, capacity);
        if (!grown) return lw_status_fail(err, LW_NO_MEMORY, "scene package: out of memory");
        s->scene->compressed = grown;
        s->capacity = capacity;
    }
    memcpy(s->scene->compressed + chunk->offset, chunk->data, chunk->size);
    return LW_OK;
}

static enum lw_status handle_welcome(struct scout *s, const struct lw_message_welcome *welcome,
                                     struct lw_error *err) {
    if (s->welcomed) return lw_status_fail(err, LW_PROTOCOL, "message WELCOME: out of order");
    if (welcome->version != LW_WIRE_VERSION)
        return lw_status_fail(err, LW_PROTOCOL,
                              "it speaks version %u of the protocol, this program version %u",
                              welcome->version, LW_WIRE_VERSION);
    s->welcomed = true;
    s->scene->hash = welcome->package_hash;
    s->scene->package_size = welcome->package_size;
    s->scene->compressed_size = welcome->package_compressed_size;
    const struct lw_message_package package = lw_message_welcome_package(welcome);
    enum lw_status status = lw_download_init(&s->download, "scene package", &package, NULL, NULL);
    struct lw_message request = {.type = LW_MESSAGE_PACKAGE_REQUEST};
    return status == LW_OK ? lw_link_send(&s->link, &request, err) : status;
}

static enum lw_status handle(struct scout *s, const struct lw_message *m, struct lw_error *err) {
    if (m->type == LW_MESSAGE_REFUSAL)
        return lw_status_fail(err, m->refusal.code == LW_REFUSAL_TOKEN ? LW_NOT_ALLOWED : LW_UNAVAILABLE,
                              "it refused us: %s",
                              m->refusal.text && *m->refusal.text ? m->refusal.text : "it did not say why");
    if (m->type == LW_MESSAGE_WELCOME) return handle_welcome(s, &m->welcome, err);
    if (m->type == LW_MESSAGE_PONG) return LW_OK; /* the link pings where the download takes long */
    if (m->type == LW_MESSAGE_WAITING && s->welcomed) return LW_OK;
    if (m->type != LW_MESSAGE_PACKAGE_CHUNK || !s->welcomed)
        return lw_status_fail(err, LW_PROTOCOL, "message %s: out of order",
                              lw_message_name((uint16_t)m->type));
    enum lw_status status = lw_download_add(&s->download, &m->package_chunk, err);
    return status == LW_OK && s->keep ? keep_chunk(s, &m->package_chunk, err) : status;
}

/* Handles the next whole message, if there is one and the package is not complete yet. */
static enum lw_status take_one(struct scout *s, bool *out_taken, struct lw_error *err) {
    struct lw_framing_header header;
    struct lw_message message;
    const uint8_t *body;
    *out_taken = false;
    if (s->welcomed && lw_download_is_complete(&s->download)) return LW_OK;
    enum lw_status status = lw_link_take(&s->link, &header, &body, err);
    *out_taken = status == LW_OK && body;
    if (!*out_taken || !lw_message_name(header.type)) return status;
    status = lw_message_decode(header, body, &message, err);
    if (status != LW_OK) return status;
    status = handle(s, &message, err);
    lw_message_finish(&message);
    return status;
}

static enum lw_status download(struct scout *s, struct lw_error *err) {
    struct lw_message hello = {.type = LW_MESSAGE_HELLO,
                               .hello = {.version = LW_WIRE_VERSION,
                                         .features = LW_FEATURES_READ,
                                         .name = "lightwell-load",
                                         .token = s->access->has_token ? s->access->token.bytes : NULL}};
    uint64_t deadline_ns = lw_clock_ns() + TIMEOUT_MS * 1000000ull;
    enum lw_status status = lw_link_send(&s->link, &hello, err);
    while (status == LW_OK) {
        bool taken;
        size_t size;
        do {
            status = take_one(s, &taken, err);
        } while (status == LW_OK && taken);
        if (status != LW_OK || (s->welcomed && lw_download_is_complete(&s->download))) break;
        uint64_t now_ns = lw_clock_ns();
        if (!s->welcomed && now_ns >= deadline_ns)
            return lw_status_fail(err, LW_TIMED_OUT, "it does not answer: is it a lightwelld?");
        /* silence of one who welcomed us is noticed by the link */
        status = lw_link_wait(&s->link, s->welcomed ? now_ns + TIMEOUT_MS * 1000000ull : deadline_ns, err);
        if (status == LW_OK) status = lw_link_receive(&s->link, &size, err);
    }
    return status;
}

static enum lw_status read_package(struct scout *s, bool with_model, struct lw_error *err) {
    struct lw_scene *scene;
    enum lw_status status = lw_package_read(s->download.bytes, s->download.size, &scene, err);
    if (status != LW_OK) return status;
    s->scene->object_count = scene->object_count;
    s->scene->light_count = scene->light_count;
    status = lw_atlas_map_init(&s->scene->map, scene);
    if (status == LW_OK && with_model)
        status = lw_viewer_model_create(scene, &s->scene->map, &s->scene->viewer_model);
    lw_scene_destroy(scene);
    return status;
}

enum lw_status lw_load_scene_fetch(const char *host, uint16_t port, const struct lw_access *access,
                                   bool keep_compressed, bool with_model, struct lw_load_scene *out_scene,
                                   struct lw_error *err) {
    struct lw_load_scene *scene = out_scene; /* in its place: the model points to the map in it */
    struct scout scout = {.scene = scene, .access = access, .keep = keep_compressed};
    *scene = (struct lw_load_scene){0};
    uint64_t began_ns = lw_clock_ns();
    enum lw_status status = lw_tls_trust_create(&access->tls, &scene->trust, err);
    if (status != LW_OK) return status;
    status = lw_link_connect(
        &scout.link,
        &(struct lw_link_desc){.host = host, .port = port, .timeout_ms = TIMEOUT_MS, .tls = scene->trust},
        err);
    if (status != LW_OK) {
        lw_load_scene_finish(scene);
        return status;
    }
    socklen_t size = sizeof scene->address;
    struct lw_error cause = {0};
    if (getpeername(scout.link.socket, (struct sockaddr *)&scene->address, &size) != 0)
        status = lw_status_fail(&cause, LW_CLOSED, "it closed the connection at once");
    if (status == LW_OK) status = download(&scout, &cause);
    scene->download_ns = lw_clock_ns() - began_ns;
    if (status == LW_OK) status = read_package(&scout, with_model, &cause);
    lw_download_finish(&scout.download);
    if (status != LW_OK) {
        lw_load_scene_finish(scene);
        lw_status_fail(&cause, status, "%s", lw_status_text(status));
        bool named = strncmp(cause.text, scout.link.address, strlen(scout.link.address)) == 0;
        lw_status_fail(err, status, "%s%s%s", named ? "" : scout.link.address, named ? "" : ": ", cause.text);
    }
    lw_link_finish(&scout.link);
    return status;
}

void lw_load_scene_finish(struct lw_load_scene *scene) {
    lw_viewer_model_destroy(scene->viewer_model);
    lw_atlas_map_finish(&scene->map);
    free(scene->compressed);
    lw_tls_trust_unref(scene->trust);
    *scene = (struct lw_load_scene){0};
}
