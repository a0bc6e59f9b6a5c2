#include "server/daemon_succession.h"

#include "common/base/log.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#define DROP_WAIT_S 1u /* for the end of a scene that is being read, but will not be lit */

/* A file of these forms is all of its scene; others may read files beside it. */
static bool is_one_file(const char *path) {
    const char *ending = strrchr(path, '.');
    return ending && (strcasecmp(ending, ".glb") == 0 || strcasecmp(ending, ".lwscene") == 0);
}

static bool scene_may_have_changed(const struct lw_daemon *d) {
    const struct lw_scene_open *scene = &d->settings.scene;
    if (strncmp(scene->path, "builtin:", 8) == 0) return false;
    const struct lw_file_stamp now = lw_file_stamp(scene->path),
                               environment_now = lw_file_stamp(scene->environment);
    return !is_one_file(scene->path) || !lw_file_stamp_equal(&now, &d->scene_stamp) ||
           !lw_file_stamp_equal(&environment_now, &d->environment_stamp);
}

static bool have_same_packages(const struct lw_daemon *a, const struct lw_daemon *b) {
    return a->package_size == b->package_size && a->finishes_size == b->finishes_size &&
           memcmp(&a->package_hash, &b->package_hash, sizeof a->package_hash) == 0 &&
           memcmp(&a->finishes_hash, &b->finishes_hash, sizeof a->finishes_hash) == 0;
}

static enum lw_status prepare_next(struct lw_daemon *d, bool *out_same, struct lw_error *err) {
    struct lw_daemon *next = d->succession.next;
    enum lw_status status = lw_daemon_read_scene(next, err);
    if (status != LW_OK) return status;
    *out_same = d->succession.only_scene && have_same_packages(next, d);
    if (*out_same) return LW_OK;
    status = lw_daemon_create_server(next, &d->succession.sockets, err);
    if (status == LW_OK) status = lw_daemon_set_up_solver(next, err);
    return status;
}

static void *succeed(void *argument) {
    struct lw_daemon *d = argument;
    struct lw_error err = {0};
    bool same = false;
    lw_daemon_give_way();
    const enum lw_status status = prepare_next(d, &same, &err);
    if (status == LW_OK && !same) {
        lw_log(LW_LOG_INFO, "options and scene have changed: clients go over to %s",
               d->succession.next->settings.scene.path);
        d->succession.relays = true;
        lw_server_relay(d->server);
        return NULL;
    }
    if (status == LW_OK) d->scene_stamp = d->succession.next->scene_stamp;
    d->succession.ended = true; /* before the line: who reads it may send the next SIGHUP at once */
    if (status == LW_OK)
        lw_log(LW_LOG_INFO, "%s is the same scene as before", d->settings.scene.path);
    else if (status != LW_CLOSED)
        lw_log(LW_LOG_ERROR, "options and scene stay as they were: %s", err.text);
    return NULL;
}

static void drop_next(struct lw_daemon *d) {
    lw_server_sockets_close(&d->succession.sockets);
    if (d->succession.next) lw_daemon_finish(d->succession.next);
    free(d->succession.next);
    d->succession.next = NULL;
    d->succession.ended = false;
    d->succession.runs = false;
}

static enum lw_status begin_succession(struct lw_daemon *d, struct lw_error *err) {
    struct lw_daemon_succession *u = &d->succession;
    bool changed, done;
    struct lw_daemon *next = u->next = malloc(sizeof *next);
    if (!next) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    lw_daemon_init(next, d->argc, d->argv, d->signalled);
    next->isa = d->isa;
    next->hooks = d->hooks;
    next->hooks.context = next;
    enum lw_status status = lw_daemon_settings_parse(&next->settings, d->argc, d->argv, &done, err);
    if (status != LW_OK) return status;
    status = lw_daemon_settings_keep(&next->settings, &d->settings, &changed, err);
    if (status != LW_OK) return status;
    lw_log_set_level((enum lw_log_level)next->settings.log_level);
    u->only_scene = !changed;
    if (!changed && !scene_may_have_changed(d)) {
        lw_log(LW_LOG_INFO, "options and scene are as before");
        drop_next(d);
        return LW_OK;
    }
    lw_daemon_metrics_init(&next->metrics, next->isa, next->settings.entry->name);
    next->metrics.renderers = next->settings.renderers;
    if ((status = lw_server_share_sockets(d->server, &u->sockets, err)) != LW_OK) return status;
    u->runs = pthread_create(&u->thread, NULL, succeed, d) == 0;
    return u->runs ? LW_OK : lw_status_fail(err, LW_OS, "cannot start a thread");
}

/* At SIGHUP, in the loop's thread. */
void lw_daemon_succession_reload(void *context) {
    struct lw_daemon *d = context;
    struct lw_error err = {0};
    lw_server_reload(d->server);
    if (d->succession.runs && !d->succession.ended) {
        lw_log(LW_LOG_WARNING,
               "options and scene are being read since the last SIGHUP: send another one later");
        return;
    }
    if (d->succession.runs) pthread_join(d->succession.thread, NULL);
    drop_next(d);
    if (begin_succession(d, &err) == LW_OK) return;
    lw_log(LW_LOG_ERROR, "options and scene stay as they were: %s", err.text);
    drop_next(d);
}

/* Successor of d, which has served, or NULL. *out_left: the thread is still at work, and what it
 * works on must stay. */
struct lw_daemon *lw_daemon_succession_take(struct lw_daemon *d, bool served, bool *out_left) {
    struct lw_daemon_succession *u = &d->succession;
    const bool follows = served && u->relays && !(d->server && lw_server_was_signalled(d->server));
    if (u->runs && !follows) {
        *d->signalled = true; /* an import and a solver in the making end */
        u->next->cancel = true;
        const struct timespec until = lw_daemon_in_seconds(1 + DROP_WAIT_S);
        *out_left = pthread_timedjoin_np(u->thread, NULL, &until) != 0;
        if (*out_left) return NULL;
    } else if (u->runs) {
        pthread_join(u->thread, NULL);
    }
    u->runs = false;
    if (!follows) {
        drop_next(d);
        return NULL;
    }
    lw_server_sockets_close(&u->sockets);
    return u->next;
}
