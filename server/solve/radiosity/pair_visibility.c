#include "server/solve/radiosity/pair_visibility.h"

#include "common/base/checked_file.h"
#include "common/base/invariant.h"
#include "common/scene/package.h"

#include <stdlib.h>
#include <string.h>

struct header {
    struct lw_checked_file_kind kind;
    uint32_t packets, shooters;
    uint8_t key[16];
};
static const struct lw_checked_file_kind kind = {.magic = "LWPAIRS", .version = 1};

static size_t mask_bytes(const struct lw_pair_visibility *v) {
    return (size_t)v->packets * v->shooters * sizeof *v->mask;
}

enum lw_status lw_pair_visibility_init(struct lw_pair_visibility *visibility, uint32_t packets,
                                       uint32_t shooters, struct lw_error *err) {
    *visibility = (struct lw_pair_visibility){.packets = packets, .shooters = shooters};
    const size_t bytes = mask_bytes(visibility);
    if (bytes > LW_PAIR_VISIBILITY_MAX)
        return lw_status_fail(
            err, LW_USAGE,
            "the visibility of all pairs would take %.1f GiB, over %.0f: --undersample or a "
            "lower --texels-per-metre makes them fewer",
            (double)bytes / (1 << 30), (double)LW_PAIR_VISIBILITY_MAX / (1 << 30));
    visibility->mask = calloc(bytes + 1, 1);
    visibility->known = calloc(shooters + 1ul, 1);
    if (visibility->mask && visibility->known) return LW_OK;
    lw_pair_visibility_finish(visibility);
    return lw_status_fail(err, LW_NO_MEMORY, "the visibility of all pairs takes %.1f GiB",
                          (double)bytes / (1 << 30));
}

void lw_pair_visibility_finish(struct lw_pair_visibility *visibility) {
    free(visibility->mask);
    free(visibility->known);
    *visibility = (struct lw_pair_visibility){0};
}

void lw_pair_visibility_forget(struct lw_pair_visibility *visibility) {
    if (visibility->known) memset(visibility->known, 0, visibility->shooters);
}

size_t lw_pair_visibility_bytes(const struct lw_pair_visibility *visibility) {
    return visibility->mask ? mask_bytes(visibility) + visibility->shooters : 0;
}

/* ---- the key ---- */

static void fold(struct lw_package_hash *hash, const void *bytes, size_t size) {
    struct lw_package_hash pair[2] = {*hash};
    if (!bytes || !size) return;
    lw_package_hash(bytes, size, &pair[1]);
    lw_package_hash((const uint8_t *)pair, sizeof pair, hash);
}

/* By members: padding is nobody's. */
static void fold_material(struct lw_package_hash *hash, const struct lw_scene *scene,
                          const struct lw_material *m) {
    fold(hash, &m->alpha_mode, sizeof m->alpha_mode);
    fold(hash, &m->double_sided, sizeof m->double_sided);
    if (m->alpha_mode == LW_ALPHA_OPAQUE) return;
    fold(hash, &m->base_colour[3], sizeof m->base_colour[3]);
    fold(hash, &m->alpha_cutoff, sizeof m->alpha_cutoff);
    if (m->base_colour_texture.texture == LW_SCENE_NONE) return;
    const struct lw_texture *texture = &scene->texture[m->base_colour_texture.texture];
    fold(hash, &m->base_colour_texture.uv_set, sizeof m->base_colour_texture.uv_set);
    fold(hash, m->base_colour_texture.transform, sizeof m->base_colour_texture.transform);
    fold(hash, &texture->width, sizeof texture->width);
    fold(hash, &texture->wrap_s, sizeof texture->wrap_s);
    fold(hash, &texture->wrap_t, sizeof texture->wrap_t);
    fold(hash, texture->rgba, (size_t)texture->width * texture->height * 4);
}

static void fold_mesh(struct lw_package_hash *hash, const struct lw_mesh *mesh) {
    fold(hash, mesh->position, mesh->vertex_count * sizeof *mesh->position);
    fold(hash, mesh->colour, mesh->colour ? mesh->vertex_count * sizeof *mesh->colour : 0);
    for (int k = 0; k < 2; k++)
        fold(hash, mesh->uv[k], mesh->uv[k] ? mesh->vertex_count * sizeof *mesh->uv[k] : 0);
    fold(hash, mesh->triangle, mesh->triangle_count * sizeof *mesh->triangle);
    fold(hash, mesh->material, mesh->triangle_count * sizeof *mesh->material);
}

void lw_pair_visibility_key(const struct lw_patches *patches, const struct lw_shooters *shooters,
                            const struct lw_pose *pose, uint8_t out_key[16]) {
    const struct lw_scene *scene = patches->texels->scene;
    struct lw_package_hash hash = {{0}};
    for (uint32_t m = 0; m < scene->material_count; m++) fold_material(&hash, scene, &scene->material[m]);
    for (uint32_t m = 0; m < scene->mesh_count; m++) fold_mesh(&hash, &scene->mesh[m]);
    for (uint32_t o = 0; o < scene->object_count; o++)
        fold(&hash, &scene->object[o].mesh, sizeof scene->object[o].mesh);
    fold(&hash, pose->object_to_world, scene->object_count * sizeof *pose->object_to_world);
    fold(&hash, pose->object_hidden, scene->object_count * sizeof *pose->object_hidden);
    for (uint32_t p = 0; p < patches->packet_count; p++) {
        fold(&hash, &patches->packet[p].at, sizeof patches->packet[p].at);
        fold(&hash, &patches->packet[p].active, sizeof patches->packet[p].active);
    }
    for (uint32_t k = 0; k < shooters->count; k++)
        fold(&hash, shooters->shooter[k].position, sizeof shooters->shooter[k].position);
    memcpy(out_key, hash.bytes, 16);
}

/* ---- files ---- */

enum lw_status lw_pair_visibility_save(const struct lw_pair_visibility *visibility, const char *path,
                                       const uint8_t key[16], struct lw_error *err) {
    struct lw_checked_file_writer writer;
    struct header header;
    memset(&header, 0, sizeof header);
    header.kind = kind;
    header.packets = visibility->packets;
    header.shooters = visibility->shooters;
    LW_INVARIANT(mask_bytes(visibility) <= LW_PAIR_VISIBILITY_MAX);
    memcpy(header.key, key, sizeof header.key);
    enum lw_status status = lw_checked_file_write_begin(&writer, path, err);
    if (status != LW_OK) return status;
    lw_checked_file_put(&writer, &header, sizeof header);
    lw_checked_file_put(&writer, visibility->known, visibility->shooters);
    lw_checked_file_put(&writer, visibility->mask, mask_bytes(visibility));
    return lw_checked_file_write_end(&writer);
}

enum lw_status lw_pair_visibility_load(struct lw_pair_visibility *visibility, const char *path,
                                       const uint8_t key[16], struct lw_error *err) {
    struct lw_checked_file_reader reader;
    struct header header;
    enum lw_status status = lw_checked_file_read_begin(&reader, path, &kind, "visibility of pairs", err);
    if (status == LW_OK) status = lw_checked_file_take(&reader, &header, sizeof header);
    if (status == LW_OK &&
        (header.packets != visibility->packets || header.shooters != visibility->shooters ||
         memcmp(header.key, key, sizeof header.key) != 0))
        status = lw_status_fail(err, LW_BAD_DATA, "%s: is of other geometry or other patches", path);
    if (status == LW_OK) status = lw_checked_file_take(&reader, visibility->known, visibility->shooters);
    if (status == LW_OK) status = lw_checked_file_take(&reader, visibility->mask, mask_bytes(visibility));
    lw_checked_file_read_end(&reader);
    if (status != LW_OK) lw_pair_visibility_forget(visibility);
    return status;
}
