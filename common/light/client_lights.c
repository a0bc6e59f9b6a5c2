#include "common/light/client_lights.h"

#include "common/base/union_find.h"

#include <stdlib.h>
#include <string.h>

/* ---- small emitters ---- */

/* A corner of an emissive triangle. */
struct corner {
    struct lw_vec3 at_ws;
    uint32_t material, number; /* three for each triangle */
};

struct piece {
    struct lw_vec3 low, high;
    float area_m2;
};

static int compare_corners(const void *a, const void *b) {
    const struct corner *p = a, *q = b;
    if (p->material != q->material) return p->material < q->material ? -1 : 1;
    const int order = memcmp(&p->at_ws, &q->at_ws, sizeof p->at_ws);
    return order ? order : (p->number > q->number) - (p->number < q->number);
}

static bool is_same_place(const struct corner *a, const struct corner *b) {
    return a->material == b->material && memcmp(&a->at_ws, &b->at_ws, sizeof a->at_ws) == 0;
}

static void widen(struct piece *piece, struct lw_vec3 at) {
    piece->low = lw_vec3_min(piece->low, at);
    piece->high = lw_vec3_max(piece->high, at);
}

static bool is_small(const struct piece *piece) {
    const float extent_m = lw_vec3_length(lw_vec3_sub(piece->high, piece->low));
    return extent_m <= LW_CLIENT_LIGHTS_EXTENT_MAX_M && piece->area_m2 <= LW_CLIENT_LIGHTS_AREA_MAX_M2;
}

/* The emissive triangles of an object, three corners each, in world space. */
static uint32_t list_corners(const struct lw_scene *scene, const struct lw_pose *pose, uint32_t object,
                             struct corner *out) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    uint32_t count = 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        if (!lw_material_shines(&scene->material[mesh->material[t]])) continue;
        for (int k = 0; k < 3; k++, count++)
            out[count] = (struct corner){.at_ws = lw_affine_point(&pose->object_to_world[object],
                                                                  mesh->position[mesh->triangle[t][k]]),
                                         .material = mesh->material[t],
                                         .number = count};
    }
    return count;
}

/* Joins triangles that share a corner, and clears drawn[] of the materials that have a large piece. corner:
 * as listed. sorted: the same corners, by place. parent, piece: one for each triangle. */
static void judge_pieces(const struct corner *corner, const struct corner *sorted, uint32_t count,
                         uint32_t *parent, struct piece *piece, uint8_t *drawn) {
    const uint32_t triangles = count / 3;
    for (uint32_t t = 0; t < triangles; t++) parent[t] = t;
    for (uint32_t i = 1; i < count; i++)
        if (is_same_place(&sorted[i - 1], &sorted[i]))
            lw_union_find_join(parent, sorted[i - 1].number / 3, sorted[i].number / 3);
    for (uint32_t t = 0; t < triangles; t++)
        piece[t] = (struct piece){lw_vec3(INFINITY, INFINITY, INFINITY),
                                  lw_vec3(-INFINITY, -INFINITY, -INFINITY), 0};
    for (uint32_t t = 0; t < triangles; t++) {
        struct piece *of = &piece[lw_union_find_root(parent, t)];
        const struct corner *c = &corner[3 * t];
        for (int k = 0; k < 3; k++) widen(of, c[k].at_ws);
        of->area_m2 += 0.5f * lw_vec3_length(lw_vec3_cross(lw_vec3_sub(c[1].at_ws, c[0].at_ws),
                                                           lw_vec3_sub(c[2].at_ws, c[0].at_ws)));
    }
    for (uint32_t t = 0; t < triangles; t++)
        if (lw_union_find_root(parent, t) == t && !is_small(&piece[t])) drawn[corner[3 * t].material] = 0;
}

static size_t count_corners(const struct lw_scene *scene, uint32_t object) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    size_t count = 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        if (lw_material_shines(&scene->material[mesh->material[t]])) count += 3;
    return count;
}

static enum lw_status judge_object(const struct lw_scene *scene, const struct lw_pose *pose, uint32_t object,
                                   uint8_t *drawn) {
    const size_t most = count_corners(scene, object);
    if (!most) return LW_OK;
    struct corner *corner = malloc(2 * most * sizeof *corner);
    uint32_t *parent = malloc(most / 3 * sizeof *parent);
    struct piece *piece = malloc(most / 3 * sizeof *piece);
    const bool ok = corner && parent && piece;
    if (ok) {
        const uint32_t count = list_corners(scene, pose, object, corner);
        memcpy(corner + most, corner, count * sizeof *corner);
        qsort(corner + most, count, sizeof *corner, compare_corners);
        judge_pieces(corner, corner + most, count, parent, piece, drawn);
    }
    free(piece);
    free(parent);
    free(corner);
    return ok ? LW_OK : LW_NO_MEMORY;
}

/* The scene's choice for a light counts more than the rule. */
static void obey_scene(struct lw_client_lights *client, const struct lw_scene *scene) {
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (scene->light[i].drawn_by) client->light[i] = scene->light[i].drawn_by == LW_DRAWN_BY_CLIENTS;
    for (uint32_t m = 0; m < scene->material_count; m++) {
        const struct lw_material *material = &scene->material[m];
        if (material->drawn_by && lw_material_shines(material))
            client->material[m] = material->drawn_by == LW_DRAWN_BY_CLIENTS;
    }
}

/* Clients know shadows, and no colour of what passes: light that is coloured on its way is for tiles. */
static bool has_tint(const struct lw_scene *scene) {
    for (uint32_t m = 0; m < scene->material_count; m++)
        if (lw_material_tints(&scene->material[m])) return true;
    return false;
}

static enum lw_status choose_small(struct lw_client_lights *client, const struct lw_scene *scene,
                                   const struct lw_pose *pose) {
    const bool rule = !has_tint(scene);
    memset(client->light, rule, scene->light_count);
    for (uint32_t m = 0; m < scene->material_count; m++)
        client->material[m] = rule && lw_material_shines(&scene->material[m]);
    enum lw_status status = LW_OK;
    for (uint32_t o = 0; rule && o < scene->object_count && status == LW_OK; o++)
        if (!lw_scene_is_spare(scene, o)) status = judge_object(scene, pose, o, client->material);
    obey_scene(client, scene);
    return status;
}

/* ---- names ---- */

static bool is_called(const char *name, const char *text, size_t length) {
    return strlen(name) == length && memcmp(name, text, length) == 0;
}

static enum lw_status choose_named(struct lw_client_lights *client, const struct lw_scene *scene,
                                   const char *names, struct lw_error *err) {
    for (const char *at = names;; at++) {
        const size_t length = strcspn(at, ",");
        bool found = false, dark = false;
        if (!length)
            return lw_status_fail(err, LW_USAGE, "--client-lights: \"%.100s\" has a name of no letters",
                                  names);
        for (uint32_t i = 0; i < scene->light_count; i++)
            if (is_called(scene->light[i].name, at, length)) client->light[i] = found = true;
        for (uint32_t m = 0; m < scene->material_count; m++) {
            if (!is_called(scene->material[m].name, at, length)) continue;
            if (lw_material_shines(&scene->material[m]))
                client->material[m] = found = true;
            else
                dark = true;
        }
        if (!found)
            return lw_status_fail(err, LW_USAGE,
                                  dark
                                      ? "--client-lights: the material \"%.*s\" does not shine"
                                      : "--client-lights: the scene has no light or material called \"%.*s\"",
                                  (int)(length < 100 ? length : 100), at);
        at += length;
        if (!*at) return LW_OK;
    }
}

static enum lw_status allocate(struct lw_client_lights *client, const struct lw_scene *scene,
                               struct lw_error *err) {
    *client = (struct lw_client_lights){.light_count = scene->light_count,
                                        .material_count = scene->material_count,
                                        .light = calloc(scene->light_count + 1ul, 1),
                                        .material = calloc(scene->material_count + 1ul, 1)};
    if (client->light && client->material) return LW_OK;
    return lw_status_fail(err, LW_NO_MEMORY, "no memory for who draws %u lights", scene->light_count);
}

static void count_drawn(struct lw_client_lights *client) {
    for (uint32_t i = 0; i < client->light_count; i++) client->drawn_lights += client->light[i];
    for (uint32_t m = 0; m < client->material_count; m++) client->drawn_materials += client->material[m];
}

enum lw_status lw_client_lights_init(struct lw_client_lights *client, const struct lw_scene *scene,
                                     const struct lw_pose *pose, const char *names, struct lw_error *err) {
    enum lw_status status = allocate(client, scene, err);
    if (status == LW_OK && (!names || strcmp(names, "auto") == 0)) {
        status = choose_small(client, scene, pose);
        if (status != LW_OK) lw_status_fail(err, status, "no memory for the pieces of emitters");
    } else if (status == LW_OK && strcmp(names, "lamps") == 0) {
        memset(client->light, 1, scene->light_count);
    } else if (status == LW_OK && strcmp(names, "none") != 0) {
        status = choose_named(client, scene, names, err);
    }
    if (status == LW_OK)
        count_drawn(client);
    else
        lw_client_lights_finish(client);
    return status;
}

void lw_client_lights_finish(struct lw_client_lights *client) {
    free(client->light);
    free(client->material);
    *client = (struct lw_client_lights){0};
}

/* ---- bits ---- */

static void write_bits(const uint8_t *drawn, uint32_t count, uint8_t *out) {
    memset(out, 0, lw_client_lights_bytes(count));
    for (uint32_t i = 0; i < count; i++) out[i / 8] |= (uint8_t)(drawn[i] << i % 8);
}

void lw_client_lights_write(const struct lw_client_lights *client, uint8_t *out_light,
                            uint8_t *out_material) {
    write_bits(client->light, client->light_count, out_light);
    write_bits(client->material, client->material_count, out_material);
}
