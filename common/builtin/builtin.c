#include "common/builtin/builtin.h"

#include "common/builtin/builtin_scenes.h"

#include <string.h>

static const struct {
    const char *name, *about;
    enum lw_status (*build)(struct lw_scene **out_scene, struct lw_error *err);
    /* in place of build, for a scene that has an argument */
    enum lw_status (*build_sized)(unsigned size, struct lw_scene **out_scene, struct lw_error *err);
    const char *size; /* what the argument is called */
    unsigned size_min, size_max, size_default;
} scenes[] = {
    {.name = LW_BUILTIN_PREFIX "cornell",
     .about = "the Cornell box: two blocks between a red and a green wall, under one lamp",
     .build = lw_builtin_cornell_build},
    {.name = LW_BUILTIN_PREFIX "ajar",
     .about = "a room that is lit through a door ajar, from a lamp in the next room",
     .build = lw_builtin_ajar_build},
    {.name = LW_BUILTIN_PREFIX "atrium",
     .about = "a sunlit two-storey court with cloth, plants and lamps; animated",
     .build = lw_builtin_atrium_build},
    {.name = LW_BUILTIN_PREFIX "atrium-matt",
     .about = "the same court, all its surfaces matt and even",
     .build = lw_builtin_atrium_matt_build},
    {.name = LW_BUILTIN_PREFIX "city",
     .about = "a town of four million triangles, sunlit, with street lamps and traffic; "
              "city:BLOCKS has BLOCKS x BLOCKS blocks, 1 to 32 (6)",
     .build_sized = lw_builtin_city_build,
     .size = "BLOCKS",
     .size_min = LW_BUILTIN_CITY_BLOCKS_MIN,
     .size_max = LW_BUILTIN_CITY_BLOCKS_MAX,
     .size_default = LW_BUILTIN_CITY_BLOCKS_DEFAULT},
};
#define SCENE_COUNT (sizeof scenes / sizeof *scenes)

const char *lw_builtin_name(unsigned index) { return index < SCENE_COUNT ? scenes[index].name : NULL; }
const char *lw_builtin_about(unsigned index) { return index < SCENE_COUNT ? scenes[index].about : NULL; }

/** Digits alone, of a number up to `most`; false for anything else. */
static bool read_size(const char *text, unsigned most, unsigned *out_size) {
    unsigned size = 0;
    if (!*text) return false;
    for (; *text; text++) {
        if (*text < '0' || *text > '9') return false;
        size = 10 * size + (unsigned)(*text - '0');
        if (size > most) return false;
    }
    *out_size = size;
    return true;
}

/** argument: what follows the name and its colon, or NULL. */
static enum lw_status build(size_t index, const char *argument, struct lw_scene **out_scene,
                            struct lw_error *err) {
    const char *name = scenes[index].name;
    if (!scenes[index].build_sized) {
        if (argument)
            return lw_status_fail(err, LW_USAGE, "%s:%.64s: %s takes no argument", name, argument, name);
        return scenes[index].build(out_scene, err);
    }
    unsigned size = scenes[index].size_default, least = scenes[index].size_min, most = scenes[index].size_max;
    if (argument && (!read_size(argument, most, &size) || size < least))
        return lw_status_fail(err, LW_USAGE, "%s:%.64s: %s is a whole number from %u to %u, not \"%.64s\"",
                              name, argument, scenes[index].size, least, most, argument);
    return scenes[index].build_sized(size, out_scene, err);
}

enum lw_status lw_builtin_build(const char *name, struct lw_scene **out_scene, struct lw_error *err) {
    char names[256] = "";
    for (size_t i = 0; i < SCENE_COUNT; i++) {
        size_t length = strlen(scenes[i].name);
        if (strncmp(name, scenes[i].name, length) == 0 && (name[length] == 0 || name[length] == ':'))
            return build(i, name[length] ? name + length + 1 : NULL, out_scene, err);
        if (i) strncat(names, ", ", sizeof names - strlen(names) - 1);
        strncat(names, scenes[i].name, sizeof names - strlen(names) - 1);
    }
    return lw_status_fail(err, LW_NO_INPUT, "%s: no such built-in scene; there are %s", name, names);
}
