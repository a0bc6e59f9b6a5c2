#include "server/bake/manifest.h"

#include "common/base/atomic_file.h"
#include "common/light/client_lights.h"

#include <stdlib.h>
#include <string.h>

json_t *lw_manifest_text(const char *text) {
    json_t *string = json_string(text);
    if (string) return string;
    char *copy = strdup(text);
    for (char *c = copy; c && *c; c++)
        if ((unsigned char)*c >= 0x80) *c = '?';
    string = copy ? json_string(copy) : NULL;
    free(copy);
    return string;
}

/* Names of lights and materials whose direct light is not in the maps; null: of none. */
static json_t *list_left_out(const struct lw_scene *scene, const struct lw_client_lights *left_out) {
    if (!left_out) return json_null();
    json_t *lights = json_array(), *materials = json_array();
    for (uint32_t l = 0; l < scene->light_count; l++)
        if (left_out->light[l]) json_array_append_new(lights, lw_manifest_text(scene->light[l].name));
    for (uint32_t m = 0; m < scene->material_count; m++)
        if (left_out->material[m])
            json_array_append_new(materials, lw_manifest_text(scene->material[m].name));
    return json_pack("{s:o, s:o}", "lights", lights, "materials", materials);
}

enum lw_status lw_manifest_init(struct lw_manifest *manifest, const struct lw_manifest_desc *desc) {
    const struct lw_bake_result *result = desc->result;
    json_t *aim = desc->samples ? json_pack("{s:I}", "samples", (json_int_t)desc->samples)
                                : json_pack("{s:f}", "error", (double)desc->error);
    json_t *range = isfinite(desc->tracing_range_m) ? json_real(desc->tracing_range_m) : json_null();
    manifest->maps = json_array();
    manifest->root = json_pack(
        "{s:i, s:s, s:o, s:s, s:s, s:s, s:{s:s, s:i, s:s}, s:b, s:o, s:f, s:b, s:I, s:I, s:o, s:I, s:f, s:I, "
        "s:I, "
        "s:o, s:o}",
        "format", LW_MANIFEST_FORMAT, "program", "lightwell " LW_VERSION, "scene",
        lw_manifest_text(desc->scene_path), "convention", desc->convention->name, "quantity",
        desc->convention->quantity, "units", desc->convention->units, "uv", "attribute", "TEXCOORD_1", "set",
        1, "origin", "top left: row 0 of a file is v = 0", "complete", (int)(result->tiles_open == 0), "aim",
        aim, "time_s", desc->time_s, "denoised", (int)desc->denoised, "bounces", (json_int_t)desc->bounces,
        "seed", (json_int_t)desc->seed, "tracing_range_m", range, "frames", (json_int_t)result->frames,
        "seconds", result->seconds, "rays", (json_int_t)result->rays, "tiles_open",
        (json_int_t)result->tiles_open, "left_out", list_left_out(desc->scene, desc->left_out), "maps",
        json_incref(manifest->maps));
    if (manifest->root && desc->direction_form &&
        json_object_set_new(manifest->root, "direction_form", json_string(desc->direction_form)) != 0)
        manifest->root = (json_decref(manifest->root), NULL);
    if (manifest->root && manifest->maps) return LW_OK;
    lw_manifest_finish(manifest);
    return LW_NO_MEMORY;
}

void lw_manifest_finish(struct lw_manifest *manifest) {
    json_decref(manifest->maps);
    json_decref(manifest->root);
    *manifest = (struct lw_manifest){0};
}

enum lw_status lw_manifest_add(struct lw_manifest *manifest, const struct lw_scene *scene,
                               const struct lw_map *map, const struct lw_sides_shown *shown, const char *file,
                               const char *directions, bool half) {
    const struct lw_object *object = &scene->object[map->object];
    json_t *entry =
        json_pack("{s:I, s:o, s:o, s:o, s:s, s:I, s:I, s:s, s:I, s:I, s:I, s:f, s:f, s:f, s:s, s:f}",
                  "object", (json_int_t)map->object, "name", lw_manifest_text(object->name), "mesh",
                  lw_manifest_text(scene->mesh[object->mesh].name), "node",
                  lw_manifest_text(scene->node[object->node].name), "file", file, "width",
                  (json_int_t)map->width, "height", (json_int_t)map->height, "type", half ? "half" : "float",
                  "back_offset", (json_int_t)map->back_offset, "covered_texels", (json_int_t)map->covered,
                  "samples", (json_int_t)map->samples, "error", (double)map->error, "error_worst",
                  (double)map->error_worst, "largest", (double)map->largest, "side", lw_sides_name(shown),
                  "both_sides", shown->total_m2 > 0 ? shown->both_m2 / shown->total_m2 : 0);
    if (entry && directions && json_object_set_new(entry, "directions", json_string(directions)) != 0) {
        json_decref(entry);
        return LW_NO_MEMORY;
    }
    return entry && json_array_append_new(manifest->maps, entry) == 0 ? LW_OK : LW_NO_MEMORY;
}

enum lw_status lw_manifest_write(const struct lw_manifest *manifest, const char *path, struct lw_error *err) {
    char *text = json_dumps(manifest->root, JSON_INDENT(2) | JSON_REAL_PRECISION(9));
    if (!text) return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", path);
    struct lw_atomic_file file;
    enum lw_status status = lw_atomic_file_open(&file, path, err);
    if (status == LW_OK) {
        status = lw_atomic_file_write(&file, text, strlen(text), err);
        if (status == LW_OK) status = lw_atomic_file_write(&file, "\n", 1, err);
        if (status == LW_OK)
            status = lw_atomic_file_commit(&file, err);
        else
            lw_atomic_file_abandon(&file);
    }
    free(text);
    return status;
}
