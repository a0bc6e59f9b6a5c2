#include "common/scene/scene.h"

struct lw_vec3 lw_scene_sky(const struct lw_scene *scene, struct lw_vec3 direction_ws) {
    (void)direction_ws;
    return lw_vec3(scene->sky[0], scene->sky[1], scene->sky[2]);
}
