#include "common/scene/scene_state.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

struct lw_scene_state_object {
    struct lw_affine object_to_world; /* if placed */
    struct lw_affine home;            /* where it was added, if it was */
    bool placed, added, hidden, dynamic;
};

struct lw_scene_state_light {
    struct lw_light_state now;
    bool has_intensity, has_position, has_direction;
};

enum lw_status lw_scene_state_init(struct lw_scene_state *state, const struct lw_scene *original,
                                   double start_scene_s, bool paused) {
    *state = (struct lw_scene_state){.original = original,
                                     .anchor_scene_s = start_scene_s,
                                     .rate = 1,
                                     .paused = paused,
                                     .start_scene_s = start_scene_s,
                                     .start_paused = paused};
    enum lw_status status = lw_scene_init_variant(&state->scene, original);
    if (status == LW_OK) status = lw_scene_roster_init(&state->roster, original);
    state->object = calloc((size_t)original->object_count + 1, sizeof *state->object);
    state->light = calloc((size_t)original->light_count + 1, sizeof *state->light);
    if (status != LW_OK || !state->object || !state->light) {
        lw_scene_state_finish(state);
        return LW_NO_MEMORY;
    }
    for (uint32_t i = 0; i < original->object_count; i++)
        state->object[i].dynamic = lw_scene_is_spare(original, i);
    return LW_OK;
}

void lw_scene_state_finish(struct lw_scene_state *state) {
    free(state->light);
    free(state->object);
    lw_scene_roster_finish(&state->roster);
    lw_scene_finish_variant(&state->scene);
    *state = (struct lw_scene_state){0};
}

double lw_scene_state_time(const struct lw_scene_state *state, double wall_s) {
    return state->paused ? state->anchor_scene_s
                         : state->anchor_scene_s + (wall_s - state->anchor_s) * state->rate;
}

/* The clock goes on from here after the change that follows. */
static void anchor(struct lw_scene_state *state, double wall_s) {
    state->anchor_scene_s = lw_scene_state_time(state, wall_s);
    state->anchor_s = wall_s;
}

/* dynamic stays: a structure built without the object is not built again */
static void restore_object(struct lw_scene_state_object *object) {
    object->placed = object->added;
    object->object_to_world = object->home;
    object->hidden = false;
}

/* As the scene has it. */
static void forget_object(struct lw_scene_state_object *object) {
    object->placed = object->added = object->hidden = false;
}

static void restore_material(struct lw_scene_state *state, uint32_t m) {
    state->scene.material[m] = state->original->material[m];
}

static void reset(struct lw_scene_state *state, double wall_s) {
    for (uint32_t i = 0; i < state->original->object_count; i++) forget_object(&state->object[i]);
    for (uint32_t i = 0; i < state->original->light_count; i++)
        state->light[i] = (struct lw_scene_state_light){0};
    for (uint32_t i = 0; i < state->original->material_count; i++) restore_material(state, i);
    memcpy(state->scene.sky, state->original->sky, sizeof state->scene.sky);
    state->anchor_s = wall_s;
    state->anchor_scene_s = state->start_scene_s;
    state->rate = 1;
    state->paused = state->start_paused;
}

void lw_scene_state_change(struct lw_scene_state *state, const struct lw_scene_change *c, double wall_s) {
    assert(lw_scene_change_check(state->original, c, NULL) == LW_SCENE_CHANGE_OK);
    const float *v = c->value;
    uint32_t number = state->scene.object_count; /* one more of each is allocated, for other changes */
    const enum lw_scene_change_code code = lw_scene_roster_take(&state->roster, c, &number, NULL);
    assert(code == LW_SCENE_CHANGE_OK);
    (void)code;
    struct lw_scene_state_object *object = &state->object[number];
    struct lw_scene_state_light *light =
        &state->light[c->target < state->scene.light_count ? c->target : state->scene.light_count];
    switch ((enum lw_scene_change_kind)c->kind) {
    case LW_SCENE_CHANGE_OBJECT_TRANSFORM:
        memcpy(object->object_to_world.m, v, sizeof object->object_to_world.m);
        object->placed = object->dynamic = true;
        break;
    case LW_SCENE_CHANGE_OBJECT_ADD:
        memcpy(object->home.m, v, sizeof object->home.m);
        object->added = object->dynamic = true;
        restore_object(object);
        break;
    case LW_SCENE_CHANGE_OBJECT_REMOVE:
        forget_object(object);
        object->dynamic = true;
        break;
    case LW_SCENE_CHANGE_OBJECT_RESTORE:
        restore_object(object);
        break;
    case LW_SCENE_CHANGE_OBJECT_HIDE:
        object->hidden = object->dynamic = true;
        break;
    case LW_SCENE_CHANGE_OBJECT_SHOW:
        object->hidden = false;
        break;
    case LW_SCENE_CHANGE_LIGHT_INTENSITY:
        light->now.intensity = lw_vec3(v[0], v[1], v[2]);
        light->has_intensity = true;
        break;
    case LW_SCENE_CHANGE_LIGHT_POSITION:
        light->now.position_ws = lw_vec3(v[0], v[1], v[2]);
        light->has_position = true;
        break;
    case LW_SCENE_CHANGE_LIGHT_DIRECTION:
        light->now.direction_ws = lw_vec3_normalize(lw_vec3(v[0], v[1], v[2]));
        light->has_direction = true;
        break;
    case LW_SCENE_CHANGE_LIGHT_RESTORE:
        *light = (struct lw_scene_state_light){0};
        break;
    case LW_SCENE_CHANGE_MATERIAL_BASE_COLOUR:
        memcpy(state->scene.material[c->target].base_colour, v, 3 * sizeof *v);
        break;
    case LW_SCENE_CHANGE_MATERIAL_EMISSION:
        memcpy(state->scene.material[c->target].emission, v, 3 * sizeof *v);
        break;
    case LW_SCENE_CHANGE_MATERIAL_RESTORE:
        restore_material(state, c->target);
        break;
    case LW_SCENE_CHANGE_SKY:
        memcpy(state->scene.sky, v, 3 * sizeof *v);
        break;
    case LW_SCENE_CHANGE_SKY_RESTORE:
        memcpy(state->scene.sky, state->original->sky, sizeof state->scene.sky);
        break;
    case LW_SCENE_CHANGE_CLOCK_PAUSE:
        anchor(state, wall_s);
        state->paused = true;
        break;
    case LW_SCENE_CHANGE_CLOCK_PLAY:
        anchor(state, wall_s);
        state->paused = false;
        break;
    case LW_SCENE_CHANGE_CLOCK_SEEK:
        state->anchor_s = wall_s;
        state->anchor_scene_s = (double)v[0];
        break;
    case LW_SCENE_CHANGE_CLOCK_RATE:
        anchor(state, wall_s);
        state->rate = (double)v[0];
        break;
    case LW_SCENE_CHANGE_RESET:
        reset(state, wall_s);
        break;
    }
}

void lw_scene_state_pose(const struct lw_scene_state *state, double wall_s, struct lw_pose *pose) {
    lw_pose_evaluate(pose, &state->scene, lw_scene_state_time(state, wall_s));
    for (uint32_t i = 0; i < state->scene.object_count; i++) {
        const struct lw_scene_state_object *object = &state->object[i];
        if (object->placed) pose->object_to_world[i] = object->object_to_world;
        pose->object_spare[i] = lw_scene_roster_is_spare(&state->roster, i);
        pose->object_hidden[i] = object->hidden || pose->object_spare[i];
        pose->object_dynamic[i] = object->dynamic;
    }
    for (uint32_t i = 0; i < state->scene.light_count; i++) {
        const struct lw_scene_state_light *light = &state->light[i];
        if (light->has_intensity) pose->light[i].intensity = light->now.intensity;
        if (light->has_position) pose->light[i].position_ws = light->now.position_ws;
        if (light->has_direction) pose->light[i].direction_ws = light->now.direction_ws;
    }
}
