#include "common/open/scene_open.h"

#include "common/base/log.h"

#include <string.h>
#include <strings.h>
#include <sys/stat.h>

static void override_lights(struct lw_scene *scene, const struct lw_scene_open *open) {
    if (open->sky_given) memcpy(scene->sky, open->sky, sizeof scene->sky);
    for (uint32_t i = 0; i < scene->light_count; i++) {
        struct lw_light *light = &scene->light[i];
        if (light->kind != LW_LIGHT_DIRECTIONAL) continue;
        if (open->sun_angle_given || light->angular_diameter == 0)
            light->angular_diameter = (float)(open->sun_angle_deg * (double)LW_PI / 180);
    }
}

bool lw_scene_open_is_scene(const char *text) {
    /* packages, and what lightwell-import reads: server/import/scene_format.h */
    static const char *const endings[] = {".lwscene", ".gltf", ".glb", ".obj",
                                          ".ply",     ".fbx",  ".dae", ".stl"};
    struct stat st;
    const char *ending = strrchr(text, '.');
    for (size_t i = 0; ending && i < sizeof endings / sizeof *endings; i++)
        if (strcasecmp(ending, endings[i]) == 0) return true;
    return strncmp(text, "builtin:", strlen("builtin:")) == 0 ||
           (stat(text, &st) == 0 && S_ISREG(st.st_mode));
}

enum lw_status lw_scene_open(const struct lw_scene_open *open, struct lw_scene **out_scene,
                             struct lw_error *err) {
    struct lw_scene *scene;
    const struct lw_import_spawn_desc import = {.scene = open->path,
                                                .environment = open->environment,
                                                .texels_per_metre = open->texels_per_metre,
                                                .density_of = open->density_of,
                                                .texels_max = (uint32_t)open->texels_max,
                                                .lightmap_unused = open->lightmap_unused,
                                                .atlas_side_max = (uint32_t)open->atlas_side_max,
                                                .threads = (unsigned)open->threads,
                                                .import_seconds = open->import_seconds,
                                                .picture_texels = (uint32_t)open->picture_texels,
                                                .materials = (enum lw_import_spawn_materials)open->materials,
                                                .cancel = open->cancel};
    enum lw_status status = lw_import_spawn(&import, &scene, err);
    if (status != LW_OK) return status;
    override_lights(scene, open);
    if (open->plain_sky && !lw_scene_has_light(scene)) {
        for (int c = 0; c < 3; c++) scene->sky[c] = LW_SCENE_OPEN_PLAIN_SKY;
        lw_log(LW_LOG_WARNING, "%s: nothing shines in it: lit by a plain sky (--sky R,G,B sets it)",
               open->path);
    }
    if (!lw_scene_has_light(scene)) {
        lw_scene_destroy(scene);
        return lw_status_fail(
            err, LW_BAD_DATA,
            "%s: nothing shines in it: no lamp, no emissive material, no sky, no environment; "
            "give it a sky with --sky R,G,B (for example --sky 1,1,1)",
            open->path);
    }
    *out_scene = scene;
    return LW_OK;
}
