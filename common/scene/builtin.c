#include "common/scene/builtin.h"

#include "common/scene/builtin_scenes.h"

#include <string.h>

static const struct {
    const char *name, *about;
    enum lw_status (*build)(struct lw_scene **out_scene, struct lw_error *err);
} scenes[] = {
    {LW_BUILTIN_PREFIX "cornell",
     "the Cornell box: two blocks between a red and a green wall, under one lamp", lw_builtin_cornell_build},
    {LW_BUILTIN_PREFIX "atrium", "a sunlit two-storey court with cloth, plants and lamps; animated",
     lw_builtin_atrium_build},
};
#define SCENE_COUNT (sizeof scenes / sizeof *scenes)

const char *lw_builtin_name(unsigned index) { return index < SCENE_COUNT ? scenes[index].name : NULL; }
const char *lw_builtin_about(unsigned index) { return index < SCENE_COUNT ? scenes[index].about : NULL; }

enum lw_status lw_builtin_build(const char *name, struct lw_scene **out_scene, struct lw_error *err) {
    char names[256] = "";
    for (size_t i = 0; i < SCENE_COUNT; i++) {
        if (strcmp(name, scenes[i].name) == 0) return scenes[i].build(out_scene, err);
        if (i) strncat(names, ", ", sizeof names - strlen(names) - 1);
        strncat(names, scenes[i].name, sizeof names - strlen(names) - 1);
    }
    return lw_status_fail(err, LW_NO_INPUT, "%s: no such built-in scene; there are %s", name, names);
}
