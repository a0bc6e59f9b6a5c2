/* Updates of a scene, from anyone: what a server has taken can be made, and makes what the server has
 * answered. A change is three bytes, kind, target and how many values it has, with two flags: 64, they are
 * those of the identity instead of what follows; 128, its update ends. */
#include "common/builtin/builtin.h"
#include "common/scene/scene_spares.h"
#include "common/scene/scene_state.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define CHANGES_MAX 64u

static void require(bool condition) {
    if (!condition) abort();
}

static const struct lw_scene *scene_with_spares(void) {
    static struct lw_scene *scene;
    if (!scene) {
        require(lw_builtin_build("builtin:cornell", &scene, NULL) == LW_OK);
        require(lw_scene_spares_add(scene, "2,lamp=0", NULL) == LW_OK);
    }
    return scene;
}

struct reader {
    const uint8_t *bytes;
    size_t size, at;
};

static uint8_t byte(struct reader *r) { return r->at < r->size ? r->bytes[r->at++] : 0; }

/* Reads a change. True: it is the last one of its update. */
static bool read_change(struct reader *r, struct lw_scene_change *out) {
    static const float identity[LW_SCENE_CHANGE_VALUES_MAX] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    *out = (struct lw_scene_change){.kind = byte(r), .target = byte(r)};
    const uint8_t rest = byte(r);
    out->value_count = rest % 16 < LW_SCENE_CHANGE_VALUES_MAX ? rest % 16 : LW_SCENE_CHANGE_VALUES_MAX;
    if (rest & 64) memcpy(out->value, identity, sizeof identity);
    for (uint32_t i = 0; !(rest & 64) && i < out->value_count && r->size - r->at >= sizeof(float); i++) {
        memcpy(&out->value[i], r->bytes + r->at, sizeof(float));
        r->at += sizeof(float);
    }
    return rest & 128;
}

/* As a session does. */
static bool apply_update(struct lw_scene_roster *roster, const struct lw_scene_change *change, size_t count) {
    enum lw_scene_change_code code = LW_SCENE_CHANGE_OK;
    lw_scene_roster_save(roster);
    for (size_t i = 0; i < count && !code; i++) {
        struct lw_error err = {0};
        uint32_t object = UINT32_MAX;
        code = lw_scene_change_check(roster->scene, &change[i], &err);
        if (!code) code = lw_scene_roster_take(roster, &change[i], &object, &err);
        require((code != LW_SCENE_CHANGE_OK) == (err.text[0] != 0) && strlen(err.text) < 200);
        require(code || change[i].kind != LW_SCENE_CHANGE_OBJECT_ADD ||
                roster->scene->object[object].mesh == change[i].target);
    }
    if (code) lw_scene_roster_go_back(roster);
    return !code;
}

static void compare(const struct lw_scene_roster *roster, const struct lw_pose *pose) {
    for (uint32_t o = 0; o < roster->scene->object_count; o++) {
        require(pose->object_spare[o] == lw_scene_roster_is_spare(roster, o));
        require(!pose->object_spare[o] || (pose->object_hidden[o] && pose->object_dynamic[o]));
        for (int i = 0; i < 12; i++) require(isfinite(pose->object_to_world[o].m[i / 4][i % 4]));
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    const struct lw_scene *scene = scene_with_spares();
    struct lw_scene_roster roster;
    struct lw_scene_state state;
    struct lw_pose pose;
    struct reader r = {bytes, size, 0};
    require(lw_scene_roster_init(&roster, scene) == LW_OK);
    require(lw_scene_state_init(&state, scene, 0, false) == LW_OK);
    require(lw_pose_init(&pose, scene) == LW_OK);
    while (r.at < r.size) {
        struct lw_scene_change change[CHANGES_MAX];
        size_t count = 0;
        while (count < CHANGES_MAX && r.at < r.size)
            if (read_change(&r, &change[count++])) break;
        if (!apply_update(&roster, change, count)) continue;
        for (size_t i = 0; i < count; i++) lw_scene_state_change(&state, &change[i], (double)r.at);
        lw_scene_state_pose(&state, (double)r.at, &pose);
        compare(&roster, &pose);
    }
    lw_pose_finish(&pose);
    lw_scene_state_finish(&state);
    lw_scene_roster_finish(&roster);
    return 0;
}
