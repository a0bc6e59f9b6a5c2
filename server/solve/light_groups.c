#include "server/solve/light_groups.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

/* Part of a list, not terminated. */
struct name {
    const char *text;
    size_t length;
};

static bool is_called(const char *name, struct name wanted) {
    return strlen(name) == wanted.length && memcmp(name, wanted.text, wanted.length) == 0;
}

/* Puts all that has a name into a group; returns whether anything has. */
static bool assign(struct lw_light_groups *groups, const struct lw_scene *scene, struct name name,
                   uint8_t group) {
    bool found = false;
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (is_called(scene->light[i].name, name)) groups->light[i] = group, found = true;
    for (uint32_t m = 0; m < scene->material_count; m++)
        if (is_called(scene->material[m].name, name)) groups->material[m] = group, found = true;
    if (is_called("sky", name)) groups->sky = group, found = true;
    return found;
}

/* The next part of a list up to one of `ends`; *list is behind it then, NULL at the list's end. */
static struct name next_name(const char **list, const char *ends) {
    struct name name = {*list, strcspn(*list, ends)};
    *list = name.text[name.length] ? name.text + name.length + 1 : NULL;
    return name;
}

static enum lw_status take_names(struct lw_light_groups *groups, const struct lw_scene *scene,
                                 const char *names, struct lw_error *err) {
    while (names) {
        const struct name of_group = next_name(&names, ";");
        if (groups->count == LW_LIGHT_GROUPS_MAX)
            return lw_status_fail(err, LW_USAGE, "more than %u groups of lights", LW_LIGHT_GROUPS_MAX - 1);
        const uint8_t group = (uint8_t)groups->count++;
        for (const char *at = of_group.text, *end = at + of_group.length; at <= end;) {
            struct name name = {at, strcspn(at, ",;")};
            if (!assign(groups, scene, name, group))
                return lw_status_fail(err, LW_USAGE,
                                      "the scene has no light or material called \"%.*s\"; nor is it \"sky\"",
                                      (int)(name.length < 100 ? name.length : 100), name.text);
            at += name.length + 1;
        }
    }
    return LW_OK;
}

static bool shines(const float colour[3]) { return colour[0] > 0 || colour[1] > 0 || colour[2] > 0; }

/* Marks what the scene's animation moves or dims, and shines: 1. Returns how many lights and materials that
 * are. */
static uint32_t mark_moving(struct lw_light_groups *groups, const struct lw_scene *scene,
                            const struct lw_pose *pose) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < scene->light_count; i++) {
        groups->light[i] = pose->node_moves[scene->light[i].node];
    }
    for (uint32_t i = 0; i < scene->light_channel_count; i++) groups->light[scene->light_channel[i].node] = 1;
    for (uint32_t i = 0; i < scene->light_count; i++) count += groups->light[i];
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (lw_scene_is_spare(scene, o) || !pose->node_moves[scene->object[o].node]) continue;
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        for (uint32_t t = 0; t < mesh->triangle_count; t++) {
            uint8_t *group = &groups->material[mesh->material[t]];
            if (*group || !shines(scene->material[mesh->material[t]].emission)) continue;
            *group = 1;
            count++;
        }
    }
    return count;
}

/* Each in a group of its own; in one together if they are many. */
static void part_moving(struct lw_light_groups *groups, const struct lw_scene *scene, uint32_t count) {
    groups->count = count == 0 ? 1 : count < LW_LIGHT_GROUPS_MAX ? 1 + count : 2;
    if (groups->count == 2) return;
    uint8_t next = 1;
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (groups->light[i]) groups->light[i] = next++;
    for (uint32_t m = 0; m < scene->material_count; m++)
        if (groups->material[m]) groups->material[m] = next++;
}

/* Whether the first group shines by what the scene has to begin with. */
static bool first_shines(const struct lw_light_groups *groups, const struct lw_scene *scene) {
    bool lit = groups->sky == 0 && (shines(scene->sky) || scene->environment.width);
    for (uint32_t i = 0; i < scene->light_count; i++)
        lit |= !groups->light[i] && shines(scene->light[i].intensity);
    for (uint32_t m = 0; m < scene->material_count; m++)
        lit |= !groups->material[m] && shines(scene->material[m].emission);
    return lit;
}

/* The second group is the first one's, and so on. */
static void drop_first(struct lw_light_groups *groups, const struct lw_scene *scene) {
    for (uint32_t i = 0; i < scene->light_count; i++) groups->light[i] -= groups->light[i] > 0;
    for (uint32_t m = 0; m < scene->material_count; m++) groups->material[m] -= groups->material[m] > 0;
    groups->sky -= groups->sky > 0;
    groups->count--;
}

/* Each light is in a group that there is. */
static bool are_groups(const struct lw_light_groups *groups, const struct lw_scene *scene) {
    bool are = groups->sky < groups->count;
    for (uint32_t i = 0; i < scene->light_count; i++) are &= groups->light[i] < groups->count;
    for (uint32_t m = 0; m < scene->material_count; m++) are &= groups->material[m] < groups->count;
    return are;
}

enum lw_status lw_light_groups_init(struct lw_light_groups *groups, const struct lw_scene *scene,
                                    const struct lw_pose *pose, const char *names, struct lw_error *err) {
    *groups = (struct lw_light_groups){.count = 1,
                                       .light = calloc(scene->light_count + 1ul, 1),
                                       .material = calloc(scene->material_count + 1ul, 1)};
    enum lw_status status = LW_OK;
    if (!groups->light || !groups->material)
        status = lw_status_fail(err, LW_NO_MEMORY, "groups of %u lights", scene->light_count);
    else if (!names)
        part_moving(groups, scene, mark_moving(groups, scene, pose));
    else if (strcmp(names, "none") != 0)
        status = take_names(groups, scene, names, err);
    if (status != LW_OK) {
        lw_light_groups_finish(groups);
        return status;
    }
    if (groups->count > 1 && !first_shines(groups, scene)) drop_first(groups, scene);
    LW_INVARIANT(groups->count > 0 && groups->count <= LW_LIGHT_GROUPS_MAX);
    LW_INVARIANT_DEAR(are_groups(groups, scene));
    return LW_OK;
}

enum lw_status lw_light_groups_copy(struct lw_light_groups *copy, const struct lw_light_groups *groups,
                                    const struct lw_scene *scene) {
    *copy = (struct lw_light_groups){.count = groups->count,
                                     .light = malloc(scene->light_count + 1ul),
                                     .material = malloc(scene->material_count + 1ul),
                                     .sky = groups->sky};
    if (!copy->light || !copy->material) {
        lw_light_groups_finish(copy);
        return LW_NO_MEMORY;
    }
    memcpy(copy->light, groups->light, scene->light_count);
    memcpy(copy->material, groups->material, scene->material_count);
    return LW_OK;
}

void lw_light_groups_finish(struct lw_light_groups *groups) {
    free(groups->light);
    free(groups->material);
    *groups = (struct lw_light_groups){0};
}
