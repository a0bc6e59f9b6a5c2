#include "common/scene/scene_state.h"

#include <assert.h>
#include <math.h>
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

/* ---- as changes ---- */

/* A list that grows. After a failure nothing is added. */
struct change_list {
    struct lw_scene_change *change;
    size_t count, capacity;
    bool failed;
};

static void add(struct change_list *list, enum lw_scene_change_kind kind, uint32_t target, size_t count,
                const float *value) {
    if (list->count == list->capacity && !list->failed) {
        const size_t capacity = list->capacity ? 2 * list->capacity : 64;
        struct lw_scene_change *grown = realloc(list->change, capacity * sizeof *grown);
        if (grown) {
            list->change = grown;
            list->capacity = capacity;
        }
        list->failed = !grown;
    }
    if (list->failed) return;
    struct lw_scene_change *change = &list->change[list->count++];
    *change = (struct lw_scene_change){.kind = kind, .target = target, .value_count = (uint32_t)count};
    if (count) memcpy(change->value, value, count * sizeof *value);
}

static void add_vector(struct change_list *list, enum lw_scene_change_kind kind, uint32_t target,
                       struct lw_vec3 v) {
    add(list, kind, target, 3, (const float[]){v.x, v.y, v.z});
}

static bool stands(const struct lw_scene_state *state, uint32_t object) {
    return !lw_scene_roster_is_spare(&state->roster, object);
}

/* An object of the scene that was removed, and has been added somewhere since. */
static bool was_replaced(const struct lw_scene_state *state, uint32_t object) {
    return stands(state, object) && state->object[object].added &&
           !lw_scene_is_spare(state->original, object);
}

/* An addition takes the first spare of its mesh. So all spares up to the last one that stands are added, and
 * those between are removed again. */
static void add_objects(const struct lw_scene_state *state, struct change_list *list) {
    const struct lw_scene *scene = state->original;
    const struct lw_scene_roster *roster = &state->roster;
    for (uint32_t o = 0; o < scene->object_count; o++)
        if (was_replaced(state, o)) add(list, LW_SCENE_CHANGE_OBJECT_REMOVE, o, 0, NULL);
    for (uint32_t mesh = 0; mesh < scene->mesh_count; mesh++) {
        uint32_t end = roster->first[mesh];
        for (uint32_t place = end; place < roster->first[mesh + 1]; place++)
            if (stands(state, roster->object[place]) && state->object[roster->object[place]].added)
                end = place + 1;
        for (uint32_t place = roster->first[mesh]; place < end; place++) {
            const uint32_t o = roster->object[place];
            if (!lw_scene_is_spare(scene, o) && !was_replaced(state, o)) continue;
            const struct lw_affine home = stands(state, o) ? state->object[o].home : LW_AFFINE_IDENTITY;
            add(list, LW_SCENE_CHANGE_OBJECT_ADD, mesh, 12, &home.m[0][0]);
        }
        for (uint32_t place = roster->first[mesh]; place < roster->first[mesh + 1]; place++) {
            const uint32_t o = roster->object[place];
            if (!stands(state, o) && (place < end || !lw_scene_is_spare(scene, o)))
                add(list, LW_SCENE_CHANGE_OBJECT_REMOVE, o, 0, NULL);
        }
    }
}

static void add_places(const struct lw_scene_state *state, struct change_list *list) {
    for (uint32_t o = 0; o < state->original->object_count; o++) {
        const struct lw_scene_state_object *object = &state->object[o];
        if (!stands(state, o)) continue;
        if (object->placed &&
            (!object->added || memcmp(&object->home, &object->object_to_world, sizeof object->home) != 0))
            add(list, LW_SCENE_CHANGE_OBJECT_TRANSFORM, o, 12, &object->object_to_world.m[0][0]);
        if (object->hidden) add(list, LW_SCENE_CHANGE_OBJECT_HIDE, o, 0, NULL);
    }
}

static void add_lights(const struct lw_scene_state *state, struct change_list *list) {
    for (uint32_t l = 0; l < state->original->light_count; l++) {
        const struct lw_scene_state_light *light = &state->light[l];
        if (light->has_intensity) add_vector(list, LW_SCENE_CHANGE_LIGHT_INTENSITY, l, light->now.intensity);
        if (light->has_position) add_vector(list, LW_SCENE_CHANGE_LIGHT_POSITION, l, light->now.position_ws);
        if (light->has_direction)
            add_vector(list, LW_SCENE_CHANGE_LIGHT_DIRECTION, l, light->now.direction_ws);
    }
}

static void add_materials(const struct lw_scene_state *state, struct change_list *list) {
    for (uint32_t m = 0; m < state->original->material_count; m++) {
        const struct lw_material *now = &state->scene.material[m], *before = &state->original->material[m];
        if (memcmp(now->base_colour, before->base_colour, 3 * sizeof(float)) != 0)
            add(list, LW_SCENE_CHANGE_MATERIAL_BASE_COLOUR, m, 3, now->base_colour);
        if (memcmp(now->emission, before->emission, 3 * sizeof(float)) != 0)
            add(list, LW_SCENE_CHANGE_MATERIAL_EMISSION, m, 3, now->emission);
    }
    if (memcmp(state->scene.sky, state->original->sky, 3 * sizeof(float)) != 0)
        add(list, LW_SCENE_CHANGE_SKY, 0, 3, state->scene.sky);
}

/* A change cannot say a time before 0, of a clock that runs backwards, nor one over LW_SCENE_DURATION_MAX. */
struct lw_scene_change lw_scene_state_seek(const struct lw_scene_state *state, double wall_s) {
    const float time_s = (float)lw_scene_state_time(state, wall_s);
    return (struct lw_scene_change){.kind = LW_SCENE_CHANGE_CLOCK_SEEK,
                                    .value_count = 1,
                                    .value = {fminf(fmaxf(time_s, 0), LW_SCENE_DURATION_MAX)}};
}

static void add_clock(const struct lw_scene_state *state, double wall_s, struct change_list *list) {
    const struct lw_scene_change seek = lw_scene_state_seek(state, wall_s);
    if (state->rate != 1) add(list, LW_SCENE_CHANGE_CLOCK_RATE, 0, 1, &(float){(float)state->rate});
    if (state->paused != state->start_paused)
        add(list, state->paused ? LW_SCENE_CHANGE_CLOCK_PAUSE : LW_SCENE_CHANGE_CLOCK_PLAY, 0, 0, NULL);
    if (state->anchor_s != 0 || state->anchor_scene_s != state->start_scene_s || state->rate != 1)
        add(list, LW_SCENE_CHANGE_CLOCK_SEEK, 0, 1, seek.value);
}

enum lw_status lw_scene_state_changes(const struct lw_scene_state *state, double wall_s,
                                      struct lw_scene_change **out_change, size_t *out_count) {
    struct change_list list = {0};
    add_objects(state, &list);
    add_places(state, &list);
    add_lights(state, &list);
    add_materials(state, &list);
    add_clock(state, wall_s, &list);
    if (list.failed) {
        free(list.change);
        return LW_NO_MEMORY;
    }
    *out_change = list.change;
    *out_count = list.count;
    return LW_OK;
}
