#include "client/control/ctl_command.h"

#include "client/control/ctl_names.h"
#include "common/base/colour.h"
#include "common/scene/pose.h"

#include <stdlib.h>
#include <string.h>

/* A command's words behind its name, and what they are read into. */
struct call {
    struct lw_ctl_command_state *state;
    const char *const *word;
    size_t count;
    struct lw_scene_change *change;
    struct lw_error *err;
};

/* --help closes up blanks: what a command does follows a colon. */
static const char help[] =
    "Commands (NAME is a name, or #NUMBER as list prints it; lengths in metres):\n"
    "  list: objects, meshes with spares, lights, materials and cameras\n"
    "  status: whether the server answers; it downloads nothing\n"
    "  stats: the server's figures; --watch: a line a second. Over the server's Unix socket alone\n"
    "  tree: the server and the relays below it: who feeds whom, clients, Mbit/s, how old the light is; over "
    "that socket alone\n"
    "  drain [SECONDS]: ends the server: it takes nobody more, tells clients to come back after SECONDS, "
    "saves its "
    "light; over that socket alone\n"
    "  token view|control: makes a token and prints the line for lightwelld's --tokens; asks no server\n"
    "  move NAME X Y Z: an object, the middle of its box to this place\n"
    "  shift NAME DX DY DZ: an object, by so much\n"
    "  turn NAME x|y|z DEGREES: about its middle, by so much\n"
    "  turn NAME YAW PITCH ROLL: likewise, degrees about y, then x, then z\n"
    "  scale NAME S, scale NAME SX SY SZ: about its middle, along the axes of the world\n"
    "  hide NAME, show NAME: no ray meets what is hidden\n"
    "  restore NAME: where the scene has it, or it was added, and shown\n"
    "  add MESH X Y Z [DEGREES]: a spare of that mesh, the middle of its box to this place, as large and "
    "upright as the"
    " first object of the mesh in the file, turned about y; prints which object it is\n"
    "  remove NAME: an object; it is a spare from then on\n"
    "  light NAME on|off: a light or an emissive material; on is as bright as the scene has it\n"
    "  light NAME intensity R G B: W/sr, of a directional light W/m2, of a material W/(m2 sr)\n"
    "  light NAME colour R G B: as bright as it is, in this colour\n"
    "  light NAME position X Y Z, light NAME direction X Y Z: where it is, where it shines; no material\n"
    "  light NAME restore: all of that as the scene has it\n"
    "  (light #NUMBER is a light; a name that a light and an emissive material share is refused: say "
    "#NUMBER for the light, or material NAME emission)\n"
    "  sky R G B, sky restore: W/(m2 sr) from everywhere outside\n"
    "  material NAME albedo R G B: factor of its base colour, 0 to 1\n"
    "  material NAME emission R G B: W/(m2 sr), times its emission texture; any material\n"
    "  material NAME restore: both as the scene has them\n"
    "  clock play|pause, clock seek SECONDS, clock rate R: the scene's animation; R seconds of it a second\n"
    "  reset: all of that as when the server started";

const char *lw_ctl_command_help(void) { return help; }

static struct lw_vec3 vector_of(const float *v) { return lw_vec3(v[0], v[1], v[2]); }

/* As the first object of each mesh stands when the scene begins; a mesh that has none stands as it is. */
static enum lw_status stand_meshes(struct lw_ctl_command_state *state) {
    struct lw_pose pose;
    enum lw_status status = lw_pose_init(&pose, state->scene);
    if (status != LW_OK) return status;
    for (uint32_t m = 0; m < state->scene->mesh_count; m++) state->mesh_to_world[m] = LW_AFFINE_IDENTITY;
    for (uint32_t o = state->scene->object_count; o-- > 0;)
        if (!lw_scene_is_spare(state->scene, o))
            state->mesh_to_world[state->scene->object[o].mesh] = pose.object_to_world[o];
    lw_pose_finish(&pose);
    return LW_OK;
}

enum lw_status lw_ctl_command_state_init(struct lw_ctl_command_state *state, const struct lw_client *client) {
    const struct lw_scene *scene = lw_client_scene(client);
    *state = (struct lw_ctl_command_state){.scene = scene};
    state->object_to_world = malloc((scene->object_count + 1ul) * sizeof *state->object_to_world);
    state->mesh_to_world = malloc((scene->mesh_count + 1ul) * sizeof *state->mesh_to_world);
    state->light = malloc((scene->light_count + 1ul) * sizeof *state->light);
    state->emission = malloc((scene->material_count + 1ul) * sizeof *state->emission);
    if (!state->object_to_world || !state->mesh_to_world || !state->light || !state->emission) {
        lw_ctl_command_state_finish(state);
        return LW_NO_MEMORY;
    }
    for (uint32_t o = 0; o < scene->object_count; o++)
        state->object_to_world[o] = *lw_client_object_to_world(client, o);
    enum lw_status status = stand_meshes(state);
    if (status != LW_OK) {
        lw_ctl_command_state_finish(state);
        return status;
    }
    for (uint32_t l = 0; l < scene->light_count; l++) state->light[l] = lw_client_get_light(client, l);
    for (uint32_t m = 0; m < scene->material_count; m++)
        state->emission[m] = (struct lw_ctl_emission){vector_of(scene->material[m].emission),
                                                      lw_client_own_emission(client, m)};
    return LW_OK;
}

void lw_ctl_command_state_finish(struct lw_ctl_command_state *state) {
    free(state->emission);
    free(state->light);
    free(state->mesh_to_world);
    free(state->object_to_world);
    *state = (struct lw_ctl_command_state){0};
}

/* ---- words ---- */

static enum lw_status read_numbers(const struct call *c, size_t first, size_t count, float *out) {
    for (size_t i = 0; i < count; i++) {
        char *end;
        const char *text = c->word[first + i];
        out[i] = strtof(text, &end);
        if (end == text || *end) return lw_status_fail(c->err, LW_USAGE, "\"%.60s\" is not a number", text);
    }
    return LW_OK;
}

static enum lw_status misused(const struct call *c, const char *right) {
    return lw_status_fail(c->err, LW_USAGE, "not understood: say %s", right);
}

static enum lw_status find(const struct call *c, enum lw_scene_change_of of) {
    return lw_ctl_names_find(c->state->scene, of, c->word[0], &c->change->target, c->err);
}

/* A change whose values are the words from `first` on. */
static enum lw_status take_values(const struct call *c, enum lw_scene_change_kind kind, size_t first,
                                  uint32_t count) {
    c->change->kind = kind;
    c->change->value_count = count;
    return read_numbers(c, first, count, c->change->value);
}

static enum lw_status set_values(const struct call *c, enum lw_scene_change_kind kind, const float *value,
                                 uint32_t count) {
    c->change->kind = kind;
    c->change->value_count = count;
    if (count) memcpy(c->change->value, value, count * sizeof *value);
    return LW_OK;
}

/* ---- objects ---- */

/* The middle of a mesh's box, as an object of it stands. */
static struct lw_vec3 middle_of_mesh(const struct lw_mesh *mesh, const struct lw_affine *object_to_world) {
    struct lw_vec3 low = mesh->position[0], high = low;
    for (uint32_t i = 1; i < mesh->vertex_count; i++) {
        const struct lw_vec3 p = mesh->position[i];
        low = lw_vec3(fminf(low.x, p.x), fminf(low.y, p.y), fminf(low.z, p.z));
        high = lw_vec3(fmaxf(high.x, p.x), fmaxf(high.y, p.y), fmaxf(high.z, p.z));
    }
    return lw_affine_point(object_to_world, lw_vec3_scale(lw_vec3_add(low, high), 0.5f));
}

struct lw_vec3 lw_ctl_command_middle(const struct lw_scene *scene, uint32_t object,
                                     const struct lw_affine *object_to_world) {
    return middle_of_mesh(&scene->mesh[scene->object[object].mesh], object_to_world);
}

/* Moves the object by a linear map about its middle, and then its middle to another place. */
static enum lw_status transform_object(const struct call *c, const struct lw_affine *about,
                                       struct lw_vec3 to) {
    struct lw_affine *now = &c->state->object_to_world[c->change->target];
    struct lw_affine map = *about;
    const struct lw_vec3 middle = lw_ctl_command_middle(c->state->scene, c->change->target, now);
    const struct lw_vec3 rest = lw_vec3_sub(to, lw_affine_vector(about, middle));
    map.m[0][3] = rest.x, map.m[1][3] = rest.y, map.m[2][3] = rest.z;
    *now = lw_affine_multiply(&map, now);
    return set_values(c, LW_SCENE_CHANGE_OBJECT_TRANSFORM, &now->m[0][0], 12);
}

static struct lw_vec3 middle_of(const struct call *c) {
    const uint32_t o = c->change->target;
    return lw_ctl_command_middle(c->state->scene, o, &c->state->object_to_world[o]);
}

static enum lw_status move(const struct call *c) {
    float to[3];
    if (c->count != 4) return misused(c, "move NAME X Y Z");
    enum lw_status status = find(c, LW_SCENE_CHANGE_OF_OBJECT);
    if (status == LW_OK) status = read_numbers(c, 1, 3, to);
    return status == LW_OK ? transform_object(c, &LW_AFFINE_IDENTITY, lw_vec3(to[0], to[1], to[2])) : status;
}

static enum lw_status shift(const struct call *c) {
    float by[3];
    if (c->count != 4) return misused(c, "shift NAME DX DY DZ");
    enum lw_status status = find(c, LW_SCENE_CHANGE_OF_OBJECT);
    if (status == LW_OK) status = read_numbers(c, 1, 3, by);
    if (status != LW_OK) return status;
    return transform_object(c, &LW_AFFINE_IDENTITY, lw_vec3_add(middle_of(c), lw_vec3(by[0], by[1], by[2])));
}

static struct lw_affine turned(int axis, float degrees) {
    const float angle = degrees * (LW_PI / 180), sine = sinf(angle), cosine = cosf(angle);
    const int a = (axis + 1) % 3, b = (axis + 2) % 3;
    struct lw_affine t = LW_AFFINE_IDENTITY;
    t.m[a][a] = t.m[b][b] = cosine;
    t.m[b][a] = sine;
    t.m[a][b] = -sine;
    return t;
}

static enum lw_status turn(const struct call *c) {
    static const char right[] = "turn NAME x|y|z DEGREES, or turn NAME YAW PITCH ROLL";
    struct lw_affine by;
    float angle[3];
    enum lw_status status;
    if (c->count == 3) {
        const int axis = c->word[1][0] - 'x';
        if (axis < 0 || axis > 2 || c->word[1][1]) return misused(c, right);
        if ((status = read_numbers(c, 2, 1, angle)) != LW_OK) return status;
        by = turned(axis, angle[0]);
    } else if (c->count == 4) {
        if ((status = read_numbers(c, 1, 3, angle)) != LW_OK) return status;
        const struct lw_affine yaw = turned(1, angle[0]), pitch = turned(0, angle[1]),
                               roll = turned(2, angle[2]), both = lw_affine_multiply(&pitch, &yaw);
        by = lw_affine_multiply(&roll, &both);
    } else {
        return misused(c, right);
    }
    status = find(c, LW_SCENE_CHANGE_OF_OBJECT);
    return status == LW_OK ? transform_object(c, &by, middle_of(c)) : status;
}

static enum lw_status scale(const struct call *c) {
    float s[3] = {0};
    if (c->count != 2 && c->count != 4) return misused(c, "scale NAME S, or scale NAME SX SY SZ");
    enum lw_status status = find(c, LW_SCENE_CHANGE_OF_OBJECT);
    if (status == LW_OK) status = read_numbers(c, 1, c->count - 1, s);
    if (status != LW_OK) return status;
    if (c->count == 2) s[1] = s[2] = s[0];
    const struct lw_affine by = {{{s[0], 0, 0, 0}, {0, s[1], 0, 0}, {0, 0, s[2], 0}}};
    return transform_object(c, &by, middle_of(c));
}

static enum lw_status set_object(const struct call *c, enum lw_scene_change_kind kind, const char *right) {
    if (c->count != 1) return misused(c, right);
    enum lw_status status = find(c, LW_SCENE_CHANGE_OF_OBJECT);
    return status == LW_OK ? set_values(c, kind, NULL, 0) : status;
}

static enum lw_status hide_object(const struct call *c) {
    return set_object(c, LW_SCENE_CHANGE_OBJECT_HIDE, "hide NAME");
}
static enum lw_status show_object(const struct call *c) {
    return set_object(c, LW_SCENE_CHANGE_OBJECT_SHOW, "show NAME");
}
static enum lw_status restore_object(const struct call *c) {
    return set_object(c, LW_SCENE_CHANGE_OBJECT_RESTORE, "restore NAME");
}

static enum lw_status remove_object(const struct call *c) {
    return set_object(c, LW_SCENE_CHANGE_OBJECT_REMOVE, "remove NAME");
}

static enum lw_status add(const struct call *c) {
    float at[4] = {0};
    if (c->count != 4 && c->count != 5) return misused(c, "add MESH X Y Z, or add MESH X Y Z DEGREES");
    enum lw_status status = find(c, LW_SCENE_CHANGE_OF_MESH);
    if (status == LW_OK) status = read_numbers(c, 1, c->count - 1, at);
    if (status != LW_OK) return status;
    const struct lw_mesh *mesh = &c->state->scene->mesh[c->change->target];
    const struct lw_affine like = c->state->mesh_to_world[c->change->target], by = turned(1, at[3]);
    struct lw_affine there = lw_affine_multiply(&by, &like);
    const struct lw_vec3 to = lw_vec3_sub(lw_vec3(at[0], at[1], at[2]), middle_of_mesh(mesh, &there));
    there.m[0][3] += to.x, there.m[1][3] += to.y, there.m[2][3] += to.z;
    return set_values(c, LW_SCENE_CHANGE_OBJECT_ADD, &there.m[0][0], 12);
}

/* ---- lights, materials, sky, clock ---- */

static enum lw_status set_vector(const struct call *c, enum lw_scene_change_kind kind, struct lw_vec3 v) {
    return set_values(c, kind, (float[]){v.x, v.y, v.z}, 3);
}

/* Emitted light: a light's intensity, a material's emission. */
struct shine {
    enum lw_scene_change_kind kind; /* the one that changes it */
    struct lw_vec3 *now, own;       /* own: as the scene has it */
};

static enum lw_status set_shine(const struct call *c, const struct shine *s, struct lw_vec3 to) {
    *s->now = to;
    return set_vector(c, s->kind, to);
}

/* As bright as it is; as the scene has it, if it is off. */
static enum lw_status colour_shine(const struct call *c, const struct shine *s, struct lw_vec3 colour) {
    const float own = lw_colour_luminance(colour);
    float luminance = lw_colour_luminance(*s->now);
    if (!(luminance > 0)) luminance = lw_colour_luminance(s->own);
    if (!(own > 0)) return lw_status_fail(c->err, LW_USAGE, "a colour has at least one channel above 0");
    return set_shine(c, s, lw_vec3_scale(colour, luminance / own));
}

/* on, off, intensity, colour: lights and materials alike. LW_OK with *out_done false: it is another word. */
static enum lw_status change_shine(const struct call *c, const struct shine *s, bool *out_done) {
    const char *what = c->word[1];
    float v[3];
    *out_done = true;
    if (c->count == 2 && strcmp(what, "on") == 0) return set_shine(c, s, s->own);
    if (c->count == 2 && strcmp(what, "off") == 0) return set_shine(c, s, lw_vec3(0, 0, 0));
    const bool colour = strcmp(what, "colour") == 0;
    if (c->count == 5 && (colour || strcmp(what, "intensity") == 0)) {
        enum lw_status status = read_numbers(c, 2, 3, v);
        if (status != LW_OK) return status;
        return colour ? colour_shine(c, s, vector_of(v)) : set_shine(c, s, vector_of(v));
    }
    *out_done = false;
    return LW_OK;
}

static enum lw_status change_light(const struct call *c, const char *right) {
    const char *what = c->word[1];
    const uint32_t l = c->change->target;
    const struct shine shine = {LW_SCENE_CHANGE_LIGHT_INTENSITY, &c->state->light[l].intensity,
                                vector_of(c->state->scene->light[l].intensity)};
    bool done;
    enum lw_status status = change_shine(c, &shine, &done);
    if (done) return status;
    if (c->count == 2 && strcmp(what, "restore") == 0) {
        *shine.now = shine.own;
        return set_values(c, LW_SCENE_CHANGE_LIGHT_RESTORE, NULL, 0);
    }
    if (c->count == 5 && strcmp(what, "position") == 0)
        return take_values(c, LW_SCENE_CHANGE_LIGHT_POSITION, 2, 3);
    if (c->count == 5 && strcmp(what, "direction") == 0)
        return take_values(c, LW_SCENE_CHANGE_LIGHT_DIRECTION, 2, 3);
    return misused(c, right);
}

/* A change of its light leaves its albedo as it is. */
static enum lw_status change_emission(const struct call *c, const char *right) {
    const char *what = c->word[1];
    struct lw_ctl_emission *emission = &c->state->emission[c->change->target];
    const struct shine shine = {LW_SCENE_CHANGE_MATERIAL_EMISSION, &emission->now, emission->own};
    bool done;
    enum lw_status status = change_shine(c, &shine, &done);
    if (done) return status;
    if (c->count == 2 && strcmp(what, "restore") == 0) return set_shine(c, &shine, shine.own);
    if (c->count == 5 && (strcmp(what, "position") == 0 || strcmp(what, "direction") == 0))
        return lw_status_fail(c->err, LW_USAGE,
                              "\"%.60s\" is a material: move or turn the objects that have it", c->word[0]);
    return misused(c, right);
}

static bool is_lit(struct lw_vec3 v) { return v.x > 0 || v.y > 0 || v.z > 0; }

/* Lights, and materials that shine now or do so in the scene's file. */
static enum lw_status find_shining(const struct call *c, enum lw_scene_change_of *out_of) {
    const struct lw_scene *scene = c->state->scene;
    bool *shines = malloc((scene->material_count + 1ul) * sizeof *shines);
    if (!shines) return lw_status_fail(c->err, LW_NO_MEMORY, "materials");
    for (uint32_t m = 0; m < scene->material_count; m++)
        shines[m] = is_lit(c->state->emission[m].now) || is_lit(c->state->emission[m].own);
    enum lw_status status =
        lw_ctl_names_find_shining(scene, shines, c->word[0], out_of, &c->change->target, c->err);
    free(shines);
    return status;
}

static enum lw_status light(const struct call *c) {
    static const char right[] =
        "light NAME on|off|restore, or light NAME intensity|colour|position|direction "
        "and three numbers";
    enum lw_scene_change_of of;
    if (c->count != 2 && c->count != 5) return misused(c, right);
    enum lw_status status = find_shining(c, &of);
    if (status != LW_OK) return status;
    return of == LW_SCENE_CHANGE_OF_LIGHT ? change_light(c, right) : change_emission(c, right);
}

static enum lw_status sky(const struct call *c) {
    if (c->count == 1 && strcmp(c->word[0], "restore") == 0)
        return set_values(c, LW_SCENE_CHANGE_SKY_RESTORE, NULL, 0);
    if (c->count != 3) return misused(c, "sky R G B, or sky restore");
    return take_values(c, LW_SCENE_CHANGE_SKY, 0, 3);
}

static enum lw_status material(const struct call *c) {
    static const char right[] = "material NAME albedo|emission R G B, or material NAME restore";
    if (c->count != 2 && c->count != 5) return misused(c, right);
    enum lw_status status = find(c, LW_SCENE_CHANGE_OF_MATERIAL);
    if (status != LW_OK) return status;
    const char *what = c->word[1];
    struct lw_ctl_emission *emission = &c->state->emission[c->change->target];
    if (c->count == 2 && strcmp(what, "restore") == 0) {
        emission->now = emission->own;
        return set_values(c, LW_SCENE_CHANGE_MATERIAL_RESTORE, NULL, 0);
    }
    if (c->count == 5 && strcmp(what, "albedo") == 0)
        return take_values(c, LW_SCENE_CHANGE_MATERIAL_BASE_COLOUR, 2, 3);
    if (c->count != 5 || strcmp(what, "emission") != 0) return misused(c, right);
    status = take_values(c, LW_SCENE_CHANGE_MATERIAL_EMISSION, 2, 3);
    if (status == LW_OK) emission->now = vector_of(c->change->value);
    return status;
}

static enum lw_status set_clock(const struct call *c) {
    const char *what = c->count ? c->word[0] : "";
    if (c->count == 1 && strcmp(what, "play") == 0) return set_values(c, LW_SCENE_CHANGE_CLOCK_PLAY, NULL, 0);
    if (c->count == 1 && strcmp(what, "pause") == 0)
        return set_values(c, LW_SCENE_CHANGE_CLOCK_PAUSE, NULL, 0);
    if (c->count == 2 && strcmp(what, "seek") == 0) return take_values(c, LW_SCENE_CHANGE_CLOCK_SEEK, 1, 1);
    if (c->count == 2 && strcmp(what, "rate") == 0) return take_values(c, LW_SCENE_CHANGE_CLOCK_RATE, 1, 1);
    return misused(c, "clock play|pause, clock seek SECONDS or clock rate R");
}

static enum lw_status reset(const struct call *c) {
    if (c->count) return misused(c, "reset");
    return set_values(c, LW_SCENE_CHANGE_RESET, NULL, 0);
}

static const struct {
    const char *name;
    enum lw_status (*run)(const struct call *);
} command[] = {{"move", move},         {"shift", shift},
               {"turn", turn},         {"scale", scale},
               {"add", add},           {"remove", remove_object},
               {"hide", hide_object},  {"show", show_object},
               {"light", light},       {"restore", restore_object},
               {"material", material}, {"sky", sky},
               {"clock", set_clock},   {"reset", reset}};
#define COMMANDS (sizeof command / sizeof *command)

/* They change nothing, and stand alone. */
static const char *const question[] = {"list", "status", "token", "stats", "tree", "drain"};
#define QUESTIONS (sizeof question / sizeof *question)

static const char *name_of(size_t i) { return i < COMMANDS ? command[i].name : question[i - COMMANDS]; }

bool lw_ctl_command_is(const char *word) {
    for (size_t i = 0; i < COMMANDS + QUESTIONS; i++)
        if (strcmp(word, name_of(i)) == 0) return true;
    return false;
}

const char *lw_ctl_command_near(const char *word) {
    const char *best = NULL;
    unsigned least = 2 + (unsigned)strlen(word) / 4;
    for (size_t i = 0; i < COMMANDS + QUESTIONS; i++) {
        const char *name = name_of(i);
        const unsigned d =
            *word && strncmp(name, word, strlen(word)) == 0 ? 0 : lw_ctl_names_distance(name, word);
        if (d < least) best = name, least = d;
    }
    return best;
}

enum lw_status lw_ctl_command_fail_unknown(const char *word, struct lw_error *err) {
    const char *near = lw_ctl_command_near(word);
    if (near)
        return lw_status_fail(
            err, LW_USAGE, "there is no command \"%.60s\": near is \"%s\" (lightwellctl --help lists them)",
            word, near);
    return lw_status_fail(err, LW_USAGE, "there is no command \"%.60s\" (lightwellctl --help lists them)",
                          word);
}

enum lw_status lw_ctl_command_parse(struct lw_ctl_command_state *state, const char *const *word, size_t count,
                                    struct lw_scene_change *out_change, struct lw_error *err) {
    struct lw_scene_change change = {0};
    if (!count) return lw_status_fail(err, LW_USAGE, "a command is missing");
    for (size_t i = 0; i < COMMANDS; i++) {
        if (strcmp(word[0], command[i].name) != 0) continue;
        enum lw_status status = command[i].run(&(struct call){state, word + 1, count - 1, &change, err});
        if (status != LW_OK)
            lw_status_context(err, "%s", word[0]);
        else
            *out_change = change;
        return status;
    }
    if (lw_ctl_command_is(word[0]))
        return lw_status_fail(err, LW_USAGE, "%s stands alone, not among other commands", word[0]);
    return lw_ctl_command_fail_unknown(word[0], err);
}

enum lw_status lw_ctl_command_split(char *line, const char *out_word[LW_CTL_COMMAND_WORDS_MAX],
                                    size_t *out_count, struct lw_error *err) {
    static const char blanks[] = " \t\r\n";
    size_t count = 0;
    char *at = line + strspn(line, blanks);
    if (at[0] == '#' && (!at[1] || strchr(blanks, at[1]))) at += strlen(at);
    while (*at) {
        if (count == LW_CTL_COMMAND_WORDS_MAX)
            return lw_status_fail(err, LW_USAGE, "the line has too many words");
        const bool quoted = *at == '"';
        at += quoted;
        out_word[count++] = at;
        at += strcspn(at, quoted ? "\"" : blanks);
        if (quoted && !*at) return lw_status_fail(err, LW_USAGE, "a quote does not end on its line");
        if (*at) *at++ = '\0';
        at += strspn(at, blanks);
    }
    *out_count = count;
    return LW_OK;
}
