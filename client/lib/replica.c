#include "client/lib/replica.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "common/scene/finish_package.h"
#include "common/tile/tile_codec.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* The tiles of a channel. */
struct slot {
    bool is_there;
    uint32_t number; /* the channel's */
    const struct lw_tile_channel *is;
    float *texels;               /* all levels of all objects, one after another */
    float **fine;                /* per id of a finer level: texels of its tile; NULL: none */
    struct lw_client_tile *tile; /* by tile id */
    /* By tile id: what deltas build on; NULL before there was anything. */
    struct lw_tile_dct_coefficients **coefficients;
    bool *has_coefficients; /* by tile id: they are those of the newest version */
};

struct lw_replica {
    const struct lw_replica *beside; /* who owns scene and map; NULL: we do */
    struct lw_scene *scene;          /* as in the package */
    struct lw_scene now;             /* the same with materials of its own, and sky: as in the newest frame */
    struct lw_scene finished; /* the scene with finishes that are not shown yet; zero: there are none */
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_tile_codec *codec;
    bool has_map, has_pose;
    struct slot slot[LW_TILE_CHANNELS_MAX]; /* as channels have it; LW_REPLICA_IRRADIANCE is always there */
    size_t *first_texel;                    /* per object and level */
    bool *unlit;             /* by object: since it was a spare, its coarsest level has not come */
    lw_replica_watch *watch; /* NULL: nobody */
    void *watch_context;
    uint64_t version_base, version_max; /* added to versions of this run; the largest so far */
    uint32_t coarsest_missing;          /* tiles of irradiance of coarsest levels that have not arrived */
    float decoded[LW_TILE_TEXELS_MAX * LW_TILE_CHANNEL_PLANES_MAX];
};

static size_t *first_texel_of(const struct lw_replica *r, uint32_t object, uint32_t level) {
    return &r->first_texel[(size_t)object * LW_ATLAS_LEVELS_MAX + level];
}

/* The texels of a tile of a finer level in a slot. */
static float **fine_of(const struct lw_replica *r, const struct slot *slot, lw_tile_id id) {
    LW_INVARIANT(id.v >= r->map.plain_count && id.v < r->map.tile_count);
    return &slot->fine[id.v - r->map.plain_count];
}

static void count_coarsest(struct lw_replica *r) {
    r->coarsest_missing = 0;
    for (uint32_t o = 0; o < r->map.object_count; o++) {
        const struct lw_atlas *atlas = r->map.atlas[o];
        if (!atlas->level_count) continue; /* a mesh without lightmap */
        const struct lw_atlas_level *coarsest = &atlas->level[atlas->level_count - 1];
        r->coarsest_missing += coarsest->tiles_x * coarsest->tiles_y;
    }
    LW_INVARIANT(r->coarsest_missing <= r->map.plain_count);
}

/* Objects are at most 2^20 and an atlas at most 2^28 texels with a third on top: 64 bits hold the sum. */
static uint64_t place_levels(struct lw_replica *r) {
    uint64_t texels = 0;
    for (uint32_t o = 0; o < r->map.object_count; o++) {
        const struct lw_atlas *atlas = r->map.atlas[o];
        for (uint32_t l = 0; l < atlas->level_count; l++) {
            *first_texel_of(r, o, l) = (size_t)texels;
            texels += (uint64_t)atlas->level[l].width * atlas->level[l].height;
        }
    }
    return texels;
}

static void free_slot(const struct lw_replica *r, struct slot *slot) {
    for (uint32_t i = 0; slot->coefficients && i < r->map.tile_count; i++) free(slot->coefficients[i]);
    for (uint32_t i = 0; slot->fine && i < lw_atlas_map_room(&r->map); i++) free(slot->fine[i]);
    free(slot->fine);
    free(slot->coefficients);
    free(slot->has_coefficients);
    free(slot->texels);
    free(slot->tile);
    *slot = (struct slot){0};
}

static enum lw_status make_slot(struct lw_replica *r, uint32_t number, struct lw_error *err) {
    const struct lw_tile_channel *is = lw_tile_channel_at(number);
    const uint64_t texels = place_levels(r);
    struct slot slot = {.is_there = true, .number = number, .is = is};
    LW_INVARIANT(!r->slot[is->slot].is_there);
    if (texels > LW_REPLICA_BYTES_MAX / (is->planes * sizeof(float)))
        return lw_status_fail(err, LW_BAD_DATA,
                              "scene package: atlases of %llu texels, over the limit of %llu GiB",
                              (unsigned long long)texels, LW_REPLICA_BYTES_MAX >> 30);
    slot.tile = calloc((size_t)r->map.tile_count + 1, sizeof *slot.tile);
    slot.coefficients = calloc((size_t)r->map.tile_count + 1, sizeof *slot.coefficients);
    slot.has_coefficients = calloc((size_t)r->map.tile_count + 1, sizeof *slot.has_coefficients);
    slot.texels = calloc((size_t)texels + 1, is->planes * sizeof(float));
    slot.fine = calloc(lw_atlas_map_room(&r->map) + 1ul, sizeof *slot.fine);
    if (slot.tile && slot.coefficients && slot.has_coefficients && slot.texels && slot.fine) {
        r->slot[is->slot] = slot;
        return LW_OK;
    }
    free_slot(r, &slot);
    return LW_NO_MEMORY;
}

static enum lw_status make_room(struct lw_replica *r, struct lw_error *err) {
    r->first_texel = calloc((size_t)r->map.object_count * LW_ATLAS_LEVELS_MAX + 1, sizeof *r->first_texel);
    r->unlit = calloc((size_t)r->map.object_count + 1, sizeof *r->unlit);
    if (!r->first_texel || !r->unlit) return LW_NO_MEMORY;
    for (uint32_t o = 0; o < r->map.object_count; o++)
        r->unlit[o] = lw_scene_is_spare(r->scene, o) && r->map.atlas[o]->level_count > 0;
    count_coarsest(r);
    return make_slot(r, LW_TILE_CHANNEL_FULL, err);
}

/* The rest, once scene and map are there. Takes r over. */
static enum lw_status complete(struct lw_replica *r, enum lw_status status, struct lw_replica **out_replica,
                               struct lw_error *err) {
    if (status == LW_OK) status = lw_scene_init_variant(&r->now, r->scene);
    if (status == LW_OK) {
        status = lw_pose_init(&r->pose, r->scene);
        r->has_pose = status == LW_OK;
    }
    if (status == LW_OK) status = lw_tile_codec_create(&r->codec);
    if (status == LW_OK) status = make_room(r, err);
    if (status == LW_OK) {
        *out_replica = r;
        return LW_OK;
    }
    lw_status_fail(err, status, "scene package: %s", lw_status_text(status));
    lw_replica_destroy(r);
    return status;
}

static enum lw_status make_map(struct lw_replica *r, uint32_t finer) {
    const enum lw_status status =
        lw_atlas_map_init_finer(&r->map, r->scene, finer, finer ? LW_REPLICA_FINE_MAX : 0);
    r->has_map = status == LW_OK;
    return status;
}

enum lw_status lw_replica_create(const uint8_t *package, size_t size, uint32_t finer,
                                 struct lw_replica **out_replica, struct lw_error *err) {
    struct lw_replica *r = calloc(1, sizeof *r);
    enum lw_status status = r ? lw_package_read(package, size, &r->scene, err) : LW_NO_MEMORY;
    if (status == LW_OK) status = make_map(r, finer);
    return complete(r, status, out_replica, err);
}

enum lw_status lw_replica_create_beside(const struct lw_replica *other, struct lw_replica **out_replica,
                                        struct lw_error *err) {
    struct lw_replica *r = calloc(1, sizeof *r);
    enum lw_status status = r ? LW_OK : LW_NO_MEMORY;
    if (r) {
        r->beside = other;
        r->scene = other->scene;
        r->map = other->map;
        /* a replica with another interest set has ids of its own */
        if (other->map.finer_count) status = make_map(r, other->map.finer_count);
    }
    return complete(r, status, out_replica, err);
}

static void drop_finished(struct lw_replica *r) {
    free(r->finished.material);
    free(r->finished.mesh);
    r->finished = (struct lw_scene){0};
}

void lw_replica_destroy(struct lw_replica *r) {
    if (!r) return;
    for (uint32_t i = 0; i < LW_TILE_CHANNELS_MAX; i++) free_slot(r, &r->slot[i]);
    free(r->unlit);
    free(r->first_texel);
    lw_tile_codec_destroy(r->codec);
    if (r->has_pose) lw_pose_finish(&r->pose);
    drop_finished(r);
    lw_scene_finish_variant(&r->now);
    if (r->has_map) lw_atlas_map_finish(&r->map);
    if (r->scene && !r->beside) lw_scene_destroy(r->scene);
    free(r);
}

/* Materials and meshes of its own; the rest is the scene's. */
enum lw_status lw_replica_read_finishes(struct lw_replica *r, const uint8_t *package, size_t size,
                                        struct lw_error *err) {
    const struct lw_scene *scene = r->scene;
    struct lw_scene *finished = &r->finished;
    const size_t materials = scene->material_count, meshes = scene->mesh_count;
    LW_INVARIANT(!r->beside);
    drop_finished(r);
    *finished = *scene; /* its storage too: finishes live as long as the scene */
    finished->material = malloc((materials + 1) * sizeof *finished->material);
    finished->mesh = malloc((meshes + 1) * sizeof *finished->mesh);
    enum lw_status status = LW_OK;
    if (!finished->material || !finished->mesh)
        status = lw_status_fail(err, LW_NO_MEMORY, "finish package: out of memory");
    if (status == LW_OK) {
        memcpy(finished->material, scene->material, materials * sizeof *scene->material);
        memcpy(finished->mesh, scene->mesh, meshes * sizeof *scene->mesh);
        status = lw_finish_package_read(package, size, finished, err);
    }
    if (status != LW_OK) drop_finished(r);
    return status;
}

bool lw_replica_is_beside(const struct lw_replica *r) { return r->beside; }

void lw_replica_show_finishes(struct lw_replica *r) {
    const struct lw_scene *finished = &r->finished;
    if (!finished->material) return;
    LW_INVARIANT(!r->beside && finished->material_count == r->scene->material_count &&
                 finished->mesh_count == r->scene->mesh_count);
    for (uint32_t m = 0; m < finished->material_count; m++)
        r->scene->material[m].finish = r->now.material[m].finish = finished->material[m].finish;
    for (uint32_t m = 0; m < finished->mesh_count; m++)
        r->scene->mesh[m].tangent = finished->mesh[m].tangent; /* now has the same meshes */
    r->scene->finish_texture = r->now.finish_texture = finished->finish_texture;
    r->scene->finish_texture_count = r->now.finish_texture_count = finished->finish_texture_count;
    drop_finished(r);
}

void lw_replica_set_watch(struct lw_replica *r, lw_replica_watch *watch, void *context) {
    r->watch = watch;
    r->watch_context = context;
}

/* The tile is here no more. */
static void drop_fine(struct lw_replica *r, struct slot *slot, lw_tile_id id) {
    float **fine = fine_of(r, slot, id);
    slot->tile[id.v] = (struct lw_client_tile){0};
    slot->has_coefficients[id.v] = false;
    free(slot->coefficients[id.v]);
    slot->coefficients[id.v] = NULL;
    free(*fine);
    *fine = NULL;
}

void lw_replica_forget_fine(struct lw_replica *r) {
    for (uint32_t i = 0; i < LW_TILE_CHANNELS_MAX; i++)
        for (uint32_t t = r->map.plain_count; r->slot[i].is_there && t < r->map.tile_count; t++) {
            if (!r->slot[i].tile[t].version) continue;
            drop_fine(r, &r->slot[i], (lw_tile_id){t});
            if (r->watch && i == LW_REPLICA_IRRADIANCE) r->watch(r->watch_context, (lw_tile_id){t});
        }
}

void lw_replica_begin_run(struct lw_replica *r) {
    LW_INVARIANT(r->version_max >= r->version_base);
    r->version_base = r->version_max;
}

uint64_t lw_replica_version_of_run(const struct lw_replica *r, lw_tile_id tile) {
    const uint64_t version = lw_replica_get_tile(r, tile).version;
    return version > r->version_base ? version - r->version_base : 0;
}

/* The first `spares` of them are. */
static enum lw_status set_hidden(struct lw_replica *r, const uint32_t *object, size_t count, size_t spares,
                                 bool hidden, struct lw_error *err) {
    LW_INVARIANT(spares <= count && (hidden || !spares));
    for (size_t i = 0; i < count; i++) {
        if (object[i] >= r->scene->object_count)
            return lw_status_fail(err, LW_PROTOCOL, "message FRAME: %s_object %u of %u",
                                  hidden ? "hidden" : "shown", object[i], r->scene->object_count);
        r->pose.object_hidden[object[i]] = hidden;
        r->pose.object_spare[object[i]] = i < spares;
        if (i < spares) r->unlit[object[i]] = r->map.atlas[object[i]]->level_count > 0;
    }
    return LW_OK;
}

static enum lw_status set_materials(struct lw_replica *r, const struct lw_message_frame *frame,
                                    struct lw_error *err) {
    for (size_t i = 0; i < frame->material_count; i++) {
        const struct lw_message_material *m = &frame->material[i];
        if (m->material >= r->scene->material_count)
            return lw_status_fail(err, LW_PROTOCOL, "message FRAME: material %u of %u", m->material,
                                  r->scene->material_count);
        memcpy(r->now.material[m->material].base_colour, m->base_colour, sizeof m->base_colour);
        memcpy(r->now.material[m->material].emission, m->emission, sizeof m->emission);
    }
    memcpy(r->now.sky, frame->sky, sizeof r->now.sky);
    return LW_OK;
}

enum lw_status lw_replica_take_frame(struct lw_replica *r, const struct lw_message_frame *frame,
                                     struct lw_error *err) {
    for (size_t i = 0; i < frame->transform_count; i++) {
        uint32_t object = frame->transform[i].object;
        if (object >= r->scene->object_count)
            return lw_status_fail(err, LW_PROTOCOL, "message FRAME: transform_object %u of %u", object,
                                  r->scene->object_count);
        r->pose.object_to_world[object] = frame->transform[i].object_to_world;
    }
    for (size_t i = 0; i < frame->light_count; i++) {
        const struct lw_message_light *light = &frame->light[i];
        if (light->light >= r->scene->light_count)
            return lw_status_fail(err, LW_PROTOCOL, "message FRAME: light %u of %u", light->light,
                                  r->scene->light_count);
        r->pose.light[light->light] =
            (struct lw_light_state){light->position_ws, light->direction_ws, light->intensity};
    }
    enum lw_status status = set_hidden(r, frame->hidden, frame->hidden_count, frame->spare_count, true, err);
    if (status == LW_OK) status = set_hidden(r, frame->shown, frame->shown_count, 0, false, err);
    return status == LW_OK ? set_materials(r, frame, err) : status;
}

/* What the decoder promises, whatever the bytes. */
static bool are_values(const struct lw_tile_channel *is, const float *value, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (!isfinite(value[i]) || (value[i] < 0 && !is->is_signed)) return false;
    return true;
}

static enum lw_status copy_fine(struct lw_replica *r, const struct slot *slot, lw_tile_id id) {
    const struct lw_tile_place *place = &r->map.place[id.v];
    const size_t size = slot->is->planes * place->width * place->height * sizeof(float);
    float **fine = fine_of(r, slot, id);
    if (!*fine && !(*fine = malloc(size))) return LW_NO_MEMORY;
    memcpy(*fine, r->decoded, size);
    return LW_OK;
}

static void copy_into_level(struct lw_replica *r, const struct slot *slot,
                            const struct lw_tile_place *place) {
    const struct lw_atlas_level *at = lw_atlas_level(r->map.atlas[place->object], place->level);
    const size_t level_width = at->width, planes = slot->is->planes;
    size_t x = (size_t)place->x * LW_TILE_SIDE, y = (size_t)place->y * LW_TILE_SIDE;
    float *level = slot->texels + planes * *first_texel_of(r, place->object, place->level);
    LW_INVARIANT(x + place->width <= level_width && y + place->height <= at->height);
    for (uint32_t row = 0; row < place->height; row++)
        memcpy(level + planes * ((y + row) * level_width + x), r->decoded + planes * row * place->width,
               planes * place->width * sizeof(float));
}

/* Takes over the decoded tile. Errors: LW_NO_MEMORY, for tiles of finer levels. */
static enum lw_status keep_decoded(struct lw_replica *r, const struct slot *slot, lw_tile_id id) {
    const struct lw_tile_place *place = &r->map.place[id.v];
    LW_INVARIANT_DEAR(are_values(slot->is, r->decoded, slot->is->planes * place->width * place->height));
    if (lw_atlas_finer(place->level)) return copy_fine(r, slot, id);
    copy_into_level(r, slot, place);
    return LW_OK;
}

/* Irradiance is of another channel: the old values would lack some light, or have it twice. */
static void drop_light(struct lw_replica *r, struct slot *slot) {
    memset(r->decoded, 0, sizeof r->decoded);
    for (uint32_t t = 0; t < r->map.tile_count; t++) {
        if (!slot->tile[t].version) continue;
        if (t < r->map.plain_count)
            copy_into_level(r, slot, &r->map.place[t]);
        else
            drop_fine(r, slot, (lw_tile_id){t});
        slot->tile[t] = (struct lw_client_tile){0};
        if (r->watch) r->watch(r->watch_context, (lw_tile_id){t});
    }
    count_coarsest(r);
    lw_replica_begin_run(r); /* versions go on growing for who compares them */
    LW_INVARIANT(r->version_base == r->version_max);
}

enum lw_status lw_replica_set_channels(struct lw_replica *r, uint32_t channels, struct lw_error *err) {
    uint32_t wanted[LW_TILE_CHANNELS_MAX]; /* by slot */
    memset(wanted, 0xff, sizeof wanted);
    for (uint32_t c = 0; c < lw_tile_channels()->count; c++)
        if (channels >> c & 1) wanted[lw_tile_channel_at(c)->slot] = c;
    LW_INVARIANT(wanted[LW_REPLICA_IRRADIANCE] != UINT32_MAX && r->slot[LW_REPLICA_IRRADIANCE].is_there);
    for (uint32_t i = 0; i < LW_TILE_CHANNELS_MAX; i++) {
        struct slot *slot = &r->slot[i];
        if (slot->is_there ? slot->number == wanted[i] : wanted[i] == UINT32_MAX) continue;
        if (i == LW_REPLICA_IRRADIANCE) { /* renderers may hold on to its texels */
            slot->number = wanted[i];
            slot->is = lw_tile_channel_at(wanted[i]);
            drop_light(r, slot);
            continue;
        }
        free_slot(r, slot);
        enum lw_status status = wanted[i] == UINT32_MAX ? LW_OK : make_slot(r, wanted[i], err);
        if (status != LW_OK) return lw_status_fail(err, status, "out of memory");
    }
    return LW_OK;
}

/* Only a tile whose newest version came in codec 4 has coefficients. */
static enum lw_status decode(struct lw_replica *r, struct slot *slot, const struct lw_message_tile *t,
                             lw_tile_id id, const struct lw_tile_place *place) {
    struct lw_tile_dct_coefficients **coefficients = &slot->coefficients[id.v];
    LW_INVARIANT(!slot->has_coefficients[id.v] || *coefficients);
    if (t->base)
        return lw_tile_codec_decode_delta(r->codec, slot->is, t->codec, t->payload, t->payload_size, t->scale,
                                          place->width, place->height, *coefficients, r->decoded);
    slot->has_coefficients[id.v] = t->codec == LW_TILE_CODEC_DCT;
    if (slot->has_coefficients[id.v] && !*coefficients &&
        !(*coefficients =
              aligned_alloc(_Alignof(struct lw_tile_dct_coefficients),
                            lw_tile_dct_coefficients_size(slot->is, place->width, place->height)))) {
        slot->has_coefficients[id.v] = false;
        return LW_NO_MEMORY;
    }
    return lw_tile_codec_decode(r->codec, slot->is, t->codec, t->payload, t->payload_size, t->scale,
                                place->width, place->height, *coefficients, r->decoded);
}

void lw_replica_release_fine(struct lw_replica *r, lw_tile_id id) {
    for (uint32_t i = 0; i < LW_TILE_CHANNELS_MAX; i++)
        if (r->slot[i].is_there) drop_fine(r, &r->slot[i], id);
    lw_atlas_map_release(&r->map, id);
}

enum lw_status lw_replica_take_tile(struct lw_replica *r, const struct lw_message_tile *t,
                                    struct lw_error *err) {
    lw_tile_id id = lw_atlas_map_find_tile(&r->map, t->object, t->level, t->tile);
    if (!lw_atlas_map_has_tile(&r->map, t->object, t->level, t->tile))
        return lw_status_fail(err, LW_PROTOCOL, "message TILE: there is no object %u, level %u, tile %u",
                              t->object, t->level, t->tile);
    if (id.v == UINT32_MAX) return LW_OK; /* a tile of a finer level that is not wanted any more */
    if (t->version > UINT64_MAX - r->version_base)
        return lw_status_fail(err, LW_PROTOCOL, "message TILE: versions have come to their end");
    const uint64_t version = r->version_base + t->version;
    if (t->layer >= lw_tile_channels()->count) return LW_OK;
    const uint32_t at = lw_tile_channel_at(t->layer)->slot;
    struct slot *slot = &r->slot[at];
    if (!slot->is_there) return LW_OK;
    if (t->layer != slot->number)
        return lw_status_fail(err, LW_PROTOCOL,
                              "message TILE: it is of layer %u in a session that gets layer %u", t->layer,
                              slot->number);
    struct lw_client_tile *known = &slot->tile[id.v];
    if (version <= known->version) return LW_OK;
    if (t->codec == LW_TILE_CODEC_NONE && lw_atlas_finer(t->level)) {
        drop_fine(r, slot, id); /* the server has it no more */
        if (version > r->version_max) r->version_max = version;
        if (r->watch && at <= LW_REPLICA_DIRECTION) r->watch(r->watch_context, id);
        return LW_OK;
    }
    if (!lw_tile_codec_is_known(t->codec))
        return lw_status_fail(err, LW_PROTOCOL, "message TILE: codec %u is unknown", t->codec);
    const bool builds_on = r->version_base + t->base == known->version && slot->has_coefficients[id.v];
    /* it was dropped since the server sent this; once the server has the current INTEREST, it sends a whole
     * one */
    if (t->base && !builds_on && lw_atlas_finer(t->level)) return LW_OK;
    if (t->base && !builds_on)
        return lw_status_fail(
            err, LW_PROTOCOL,
            "message TILE: object %u, level %u, tile %u: it builds on a version that is not here", t->object,
            t->level, t->tile);
    const struct lw_tile_place *place = &r->map.place[id.v];
    const bool is_coarsest =
        at == LW_REPLICA_IRRADIANCE && t->level == r->map.atlas[t->object]->level_count - 1;
    enum lw_status status = decode(r, slot, t, id, place);
    if (status != LW_OK) {
        /* half of the coefficients are the new version's: no delta may build on them, in a later session
         * either */
        if (known->version && is_coarsest) r->coarsest_missing++;
        LW_INVARIANT(r->coarsest_missing <= r->map.tile_count);
        *known = (struct lw_client_tile){0};
    }
    if (status == LW_NO_MEMORY) return lw_status_fail(err, status, "message TILE: out of memory");
    if (status != LW_OK)
        return lw_status_fail(err, LW_PROTOCOL,
                              "message TILE: object %u, level %u, tile %u: the payload is damaged", t->object,
                              t->level, t->tile);
    if (keep_decoded(r, slot, id) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "message TILE: out of memory");
    LW_INVARIANT(known->version || !is_coarsest || r->coarsest_missing > 0);
    if (!known->version && is_coarsest) r->coarsest_missing--;
    if (is_coarsest && !r->pose.object_spare[t->object]) r->unlit[t->object] = false;
    *known = (struct lw_client_tile){.version = version,
                                     .bounces = t->bounces,
                                     .error = t->error,
                                     .arrived_ns = lw_clock_ns(),
                                     .rgb = lw_atlas_finer(t->level) ? *fine_of(r, slot, id) : NULL};
    if (version > r->version_max) r->version_max = version;
    LW_INVARIANT(known->version > r->version_base && known->version <= r->version_max);
    if (r->watch && at <= LW_REPLICA_DIRECTION) r->watch(r->watch_context, id);
    return LW_OK;
}

bool lw_replica_has_first(const struct lw_replica *r) { return r->coarsest_missing == 0; }

const struct lw_scene *lw_replica_scene(const struct lw_replica *r) { return &r->now; }
const struct lw_scene *lw_replica_own_scene(const struct lw_replica *r) { return r->scene; }

bool lw_replica_object_hidden(const struct lw_replica *r, uint32_t object) {
    return object < r->scene->object_count && (r->pose.object_hidden[object] || r->unlit[object]);
}

enum lw_client_object_state lw_replica_object_state(const struct lw_replica *r, uint32_t object) {
    if (object >= r->scene->object_count || r->pose.object_spare[object]) return LW_CLIENT_OBJECT_SPARE;
    return r->pose.object_hidden[object] ? LW_CLIENT_OBJECT_HIDDEN : LW_CLIENT_OBJECT_SHOWN;
}

const struct lw_light_state *lw_replica_light(const struct lw_replica *r, uint32_t light) {
    return light < r->scene->light_count ? &r->pose.light[light] : NULL;
}

const struct lw_atlas_map *lw_replica_atlas_map(const struct lw_replica *r) { return &r->map; }

const struct lw_affine *lw_replica_object_to_world(const struct lw_replica *r, uint32_t object) {
    return object < r->scene->object_count ? &r->pose.object_to_world[object] : NULL;
}

struct lw_client_level lw_replica_get_level(const struct lw_replica *r, uint32_t object, uint32_t level) {
    if (object >= r->map.object_count || level >= r->map.atlas[object]->level_count)
        return (struct lw_client_level){0};
    const struct lw_atlas_level *at = &r->map.atlas[object]->level[level];
    return (struct lw_client_level){at->width, at->height,
                                    lw_replica_get_texels(r, LW_REPLICA_IRRADIANCE, object, level),
                                    lw_replica_get_texels(r, LW_REPLICA_DIRECTION, object, level)};
}

const float *lw_replica_get_texels(const struct lw_replica *r, uint32_t slot, uint32_t object,
                                   uint32_t level) {
    if (slot >= LW_TILE_CHANNELS_MAX || !r->slot[slot].is_there || object >= r->map.object_count ||
        level >= r->map.atlas[object]->level_count)
        return NULL;
    return r->slot[slot].texels + r->slot[slot].is->planes * *first_texel_of(r, object, level);
}

struct lw_client_tile lw_replica_get_tile(const struct lw_replica *r, lw_tile_id tile) {
    const struct lw_client_tile direction = lw_replica_get_tile_of(r, LW_REPLICA_DIRECTION, tile);
    struct lw_client_tile light = lw_replica_get_tile_of(r, LW_REPLICA_IRRADIANCE, tile);
    light.direction = direction.rgb;
    light.direction_version = direction.version;
    return light;
}

struct lw_client_tile lw_replica_get_tile_of(const struct lw_replica *r, uint32_t slot, lw_tile_id tile) {
    return slot < LW_TILE_CHANNELS_MAX && r->slot[slot].is_there && tile.v < r->map.tile_count
               ? r->slot[slot].tile[tile.v]
               : (struct lw_client_tile){0};
}
