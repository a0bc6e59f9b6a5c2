#include "common/scene/scene_roster.h"

#include <stdlib.h>
#include <string.h>

static void set(struct lw_scene_roster *r, uint32_t object, bool spare) {
    const uint32_t place = r->place[object];
    const uint64_t bit = 1ull << place % 64;
    if (spare)
        r->spare[place / 64] |= bit;
    else
        r->spare[place / 64] &= ~bit;
}

static void mark_spare(struct lw_scene_roster *r) {
    for (uint32_t o = 0; o < r->scene->object_count; o++) set(r, o, lw_scene_is_spare(r->scene, o));
}

/* Counting sort. */
static void order_by_mesh(struct lw_scene_roster *r) {
    const struct lw_scene *scene = r->scene;
    for (uint32_t o = 0; o < scene->object_count; o++) r->first[scene->object[o].mesh + 1]++;
    for (uint32_t m = 0; m < scene->mesh_count; m++) r->first[m + 1] += r->first[m];
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const uint32_t place = r->first[scene->object[o].mesh]++;
        r->place[o] = place;
        r->object[place] = o;
    }
    for (uint32_t m = scene->mesh_count; m > 0; m--) r->first[m] = r->first[m - 1];
    r->first[0] = 0;
}

enum lw_status lw_scene_roster_init(struct lw_scene_roster *r, const struct lw_scene *scene) {
    *r = (struct lw_scene_roster){.scene = scene, .words = scene->object_count / 64ul + 1};
    r->place = calloc(scene->object_count + 1ul, sizeof *r->place);
    r->object = calloc(scene->object_count + 1ul, sizeof *r->object);
    r->first = calloc(scene->mesh_count + 1ul, sizeof *r->first);
    r->spare = calloc(r->words, sizeof *r->spare);
    r->saved = calloc(r->words, sizeof *r->saved);
    if (!r->place || !r->object || !r->first || !r->spare || !r->saved) {
        lw_scene_roster_finish(r);
        return LW_NO_MEMORY;
    }
    order_by_mesh(r);
    mark_spare(r);
    return LW_OK;
}

void lw_scene_roster_finish(struct lw_scene_roster *r) {
    free(r->saved);
    free(r->spare);
    free(r->first);
    free(r->object);
    free(r->place);
    *r = (struct lw_scene_roster){0};
}

bool lw_scene_roster_is_spare(const struct lw_scene_roster *r, uint32_t object) {
    return r->spare[r->place[object] / 64] >> r->place[object] % 64 & 1;
}

/* Word by word: a scene may have a million instances of a mesh, and an update a thousand additions. */
static bool find_spare(const struct lw_scene_roster *r, uint32_t mesh, uint32_t *out_object) {
    const uint32_t end = r->first[mesh + 1];
    for (uint32_t place = r->first[mesh]; place < end; place = (place / 64 + 1) * 64) {
        const uint64_t left = r->spare[place / 64] >> place % 64;
        if (!left) continue;
        const uint32_t found = place + (uint32_t)__builtin_ctzll(left);
        if (found >= end) return false;
        *out_object = r->object[found];
        return true;
    }
    return false;
}

/* A name that --spares and a shell take between quotes, and that fits into a line of ASCII. */
static bool is_plain(const char *name) {
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-. ";
    const size_t length = strspn(name, plain);
    return length && length < 64 && !name[length];
}

static enum lw_scene_change_code refuse_add(const struct lw_scene *scene, uint32_t mesh,
                                            struct lw_error *err) {
    const char *name = scene->mesh[mesh].name, *why = lw_scene_change_text(LW_SCENE_CHANGE_NO_SPARE);
    const char *quote = strchr(name, ' ') ? "\"" : "";
    if (is_plain(name))
        lw_status_fail(err, LW_BAD_DATA, "mesh \"%s\": %s: start lightwelld with --spares %s%s=N%s", name,
                       why, quote, name, quote);
    else
        lw_status_fail(err, LW_BAD_DATA, "mesh %u: %s: start lightwelld with --spares \"#%u=N\"", mesh, why,
                       mesh);
    return LW_SCENE_CHANGE_NO_SPARE;
}

enum lw_scene_change_code lw_scene_roster_take(struct lw_scene_roster *r, const struct lw_scene_change *c,
                                               uint32_t *out_object, struct lw_error *err) {
    switch ((enum lw_scene_change_kind)c->kind) {
    case LW_SCENE_CHANGE_OBJECT_ADD:
        if (!find_spare(r, c->target, out_object)) return refuse_add(r->scene, c->target, err);
        set(r, *out_object, false);
        return LW_SCENE_CHANGE_OK;
    case LW_SCENE_CHANGE_OBJECT_TRANSFORM:
    case LW_SCENE_CHANGE_OBJECT_RESTORE:
    case LW_SCENE_CHANGE_OBJECT_HIDE:
    case LW_SCENE_CHANGE_OBJECT_SHOW:
    case LW_SCENE_CHANGE_OBJECT_REMOVE:
        if (lw_scene_roster_is_spare(r, c->target)) {
            lw_status_fail(err, LW_BAD_DATA, "object %u: %s", c->target,
                           lw_scene_change_text(LW_SCENE_CHANGE_ABSENT));
            return LW_SCENE_CHANGE_ABSENT;
        }
        *out_object = c->target;
        if (c->kind == LW_SCENE_CHANGE_OBJECT_REMOVE) set(r, c->target, true);
        return LW_SCENE_CHANGE_OK;
    case LW_SCENE_CHANGE_RESET:
        mark_spare(r);
        return LW_SCENE_CHANGE_OK;
    default: /* not about which objects there are */
        return LW_SCENE_CHANGE_OK;
    }
}

void lw_scene_roster_save(struct lw_scene_roster *r) {
    memcpy(r->saved, r->spare, r->words * sizeof *r->spare);
}

void lw_scene_roster_go_back(struct lw_scene_roster *r) {
    memcpy(r->spare, r->saved, r->words * sizeof *r->spare);
}
