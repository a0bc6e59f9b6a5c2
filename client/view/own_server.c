#include "client/view/own_server.h"

#include "client/view/local_server.h"
#include "common/builtin/builtin.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define POLL_NS 20000000l

struct lw_own_server {
    struct lw_local_server local;
    const struct lw_scene_open *open;
    char sky[64];
};

static void add_options(struct lw_own_server *s) {
    const struct lw_scene_open *open = s->open;
    struct lw_local_server *l = &s->local;
    lw_local_server_option(l, "--log-format", "text");
    lw_local_server_option(l, "--plain-sky", NULL);
    if (open->texels_per_metre > 0) lw_local_server_number(l, "--texels-per-metre", open->texels_per_metre);
    if (open->density_of) lw_local_server_option(l, "--density-of", open->density_of);
    if (open->texels_max > 0) lw_local_server_number(l, "--max-texels", (double)open->texels_max);
    if (open->atlas_side_max > 0) lw_local_server_number(l, "--atlas-max", (double)open->atlas_side_max);
    if (open->threads > 0) lw_local_server_number(l, "--threads", (double)open->threads);
    if (open->import_seconds > 0) lw_local_server_number(l, "--import-seconds", open->import_seconds);
    if (open->picture_texels > 0) lw_local_server_number(l, "--picture-texels", (double)open->picture_texels);
    if (open->materials == LW_IMPORT_SPAWN_MATT) lw_local_server_option(l, "--materials", "matt");
    if (open->environment) lw_local_server_option(l, "--environment", open->environment);
    if (open->sun_angle_given) lw_local_server_number(l, "--sun-angle", open->sun_angle_deg);
    if (open->sky_given) {
        snprintf(s->sky, sizeof s->sky, "%.9g,%.9g,%.9g", (double)open->sky[0], (double)open->sky[1],
                 (double)open->sky[2]);
        lw_local_server_option(l, "--sky", s->sky);
    }
}

enum lw_status lw_own_server_poll(struct lw_own_server *s, uint16_t *out_port, struct lw_error *err) {
    const uint16_t port = lw_local_server_port(&s->local);
    if (!port && lw_local_server_has_ended(&s->local))
        return lw_status_fail(err, LW_UNAVAILABLE, "%.200s is not lit: its server has ended", s->open->path);
    *out_port = port;
    return LW_OK;
}

enum lw_status lw_own_server_wait(struct lw_own_server *s, uint16_t *out_port, struct lw_error *err) {
    uint16_t port = 0;
    for (;;) {
        enum lw_status status = lw_own_server_poll(s, &port, err);
        if (status != LW_OK) return status;
        if (port) break;
        nanosleep(&(struct timespec){.tv_nsec = POLL_NS}, NULL);
    }
    *out_port = port;
    return LW_OK;
}

enum lw_status lw_own_server_start(const struct lw_scene_open *open, struct lw_own_server **out_server,
                                   struct lw_error *err) {
    const char *scene = open->path;
    if (strncmp(scene, LW_BUILTIN_PREFIX, strlen(LW_BUILTIN_PREFIX)) != 0 && access(scene, R_OK) != 0)
        return lw_status_fail(err, LW_NO_INPUT, "cannot open \"%.300s\": %s", scene, strerror(errno));
    struct lw_own_server *s = calloc(1, sizeof *s);
    if (s == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a server");
    s->open = open;
    enum lw_status status = lw_local_server_init(&s->local, scene, err);
    if (status == LW_OK) {
        add_options(s);
        /* its standard output is not ours, which may be a report */
        status = lw_local_server_start(&s->local, -1, STDERR_FILENO, -1, err);
    }
    if (status == LW_OK)
        *out_server = s;
    else
        lw_own_server_stop(s);
    return status;
}

void lw_own_server_stop(struct lw_own_server *s) {
    if (s == NULL) return;
    lw_local_server_finish(&s->local);
    free(s);
}
