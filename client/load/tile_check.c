#include "client/load/tile_check.h"

#include "common/tile/tile_codec.h"

#include <stdlib.h>
#include <string.h>

#define CHANNELS 3u

/* A version that was decoded. */
struct seen {
    uint64_t version; /* 0: none */
    uint64_t base;
    struct lw_package_hash hash;
    float scale, error;
    uint32_t bounces;
};

struct lw_tile_check {
    const struct lw_atlas_map *map;
    bool always;
    uint64_t decoded_count;
    struct lw_tile_codec *codec;
    struct seen (*seen)[LW_TILE_CHECK_VERSIONS]; /* per tile */
    struct seen (
        *light)[LW_TILE_CHECK_VERSIONS]; /* per tile: versions and texels of the sessions that are followed */
    struct lw_tile_dct_coefficients coefficients;
    float decoded[LW_TILE_TEXELS_MAX * CHANNELS];
};

enum lw_status lw_tile_check_create(const struct lw_atlas_map *map, bool always,
                                    struct lw_tile_check **out_check) {
    struct lw_tile_check *check = aligned_alloc(_Alignof(struct lw_tile_check), sizeof *check);
    if (!check) return LW_NO_MEMORY;
    memset(check, 0, sizeof *check);
    check->map = map;
    check->always = always;
    check->seen = calloc((size_t)map->tile_count + 1, sizeof *check->seen);
    check->light = calloc((size_t)map->tile_count + 1, sizeof *check->light);
    enum lw_status status = check->seen && check->light ? lw_tile_codec_create(&check->codec) : LW_NO_MEMORY;
    if (status == LW_OK)
        *out_check = check;
    else
        lw_tile_check_destroy(check);
    return status;
}

void lw_tile_check_destroy(struct lw_tile_check *check) {
    if (!check) return;
    lw_tile_codec_destroy(check->codec);
    free(check->seen);
    free(check->light);
    free(check);
}

struct lw_tile_held {
    uint32_t tile_count;
    struct lw_tile_dct_coefficients *coefficients[]; /* per tile; NULL: none that deltas could build on */
};

enum lw_status lw_tile_held_create(const struct lw_atlas_map *map, struct lw_tile_held **out_held) {
    struct lw_tile_held *held = calloc(1, sizeof *held + map->tile_count * sizeof held->coefficients[0]);
    if (!held) return LW_NO_MEMORY;
    held->tile_count = map->tile_count;
    *out_held = held;
    return LW_OK;
}

void lw_tile_held_destroy(struct lw_tile_held *held) {
    for (uint32_t t = 0; held && t < held->tile_count; t++) free(held->coefficients[t]);
    free(held);
}

size_t lw_tile_held_bytes_max(const struct lw_atlas_map *map) {
    return map->tile_count * (sizeof(struct lw_tile_dct_coefficients) + sizeof(void *));
}

static bool same(const struct seen *a, const struct seen *b) {
    return memcmp(a->hash.bytes, b->hash.bytes, sizeof a->hash.bytes) == 0 && a->scale == b->scale &&
           a->error == b->error && a->bounces == b->bounces;
}

static enum lw_status decode(struct lw_tile_check *check, const struct lw_message_tile *tile, lw_tile_id id,
                             bool *out_decodes) {
    const struct lw_tile_place *place = &check->map->place[id.v];
    enum lw_status status;
    if (tile->base) { /* whether its bytes make sense; on black: what the session has is not kept here */
        memset(&check->coefficients, 0, sizeof check->coefficients);
        status = lw_tile_codec_decode_delta(check->codec, NULL, tile->codec, tile->payload,
                                            tile->payload_size, tile->scale, place->width, place->height,
                                            &check->coefficients, check->decoded);
    } else {
        status = lw_tile_codec_decode(check->codec, NULL, tile->codec, tile->payload, tile->payload_size,
                                      tile->scale, place->width, place->height, NULL, check->decoded);
    }
    if (status == LW_NO_MEMORY) return status;
    check->decoded_count++;
    *out_decodes = status == LW_OK;
    return LW_OK;
}

/* The slot of this version, else the oldest slot, to be replaced; NULL: none. A version in flight to a slow
 * session may be older than all remembered ones, and then replaces none. */
static struct seen *find_slot(struct seen slot[LW_TILE_CHECK_VERSIONS], uint64_t version, uint64_t base) {
    struct seen *oldest = &slot[0];
    for (uint32_t i = 0; i < LW_TILE_CHECK_VERSIONS; i++) {
        if (slot[i].version == version && slot[i].base == base) return &slot[i];
        if (slot[i].version < oldest->version) oldest = &slot[i];
    }
    return oldest->version < version ? oldest : NULL;
}

/* Decodes a tile as a client does, and compares it with what others made of that version. */
static enum lw_status decode_and_compare(struct lw_tile_check *check, const struct lw_message_tile *t,
                                         lw_tile_id id, struct lw_tile_held *held, bool *out_decodes,
                                         bool *out_agrees) {
    const struct lw_tile_place *p = &check->map->place[id.v];
    struct lw_tile_dct_coefficients **coefficients = &held->coefficients[id.v];
    enum lw_status status = LW_BAD_DATA;
    check->decoded_count++;
    if (!t->base && t->codec == LW_TILE_CODEC_DCT && !*coefficients &&
        !(*coefficients = aligned_alloc(_Alignof(struct lw_tile_dct_coefficients),
                                        lw_tile_dct_coefficients_size(NULL, p->width, p->height))))
        return LW_NO_MEMORY;
    if (!t->base)
        status = lw_tile_codec_decode(check->codec, NULL, t->codec, t->payload, t->payload_size, t->scale,
                                      p->width, p->height, *coefficients, check->decoded);
    else if (*coefficients)
        status = lw_tile_codec_decode_delta(check->codec, NULL, t->codec, t->payload, t->payload_size,
                                            t->scale, p->width, p->height, *coefficients, check->decoded);
    if (status == LW_NO_MEMORY) return status;
    *out_decodes = status == LW_OK;
    if (!*out_decodes) return LW_OK;
    struct seen now = {.version = t->version};
    lw_package_hash((const uint8_t *)check->decoded,
                    (size_t)p->width * p->height * CHANNELS * sizeof check->decoded[0], &now.hash);
    struct seen *slot = find_slot(check->light[id.v], t->version, 0);
    *out_agrees = !slot || slot->version != t->version || same(slot, &now);
    if (slot && *out_agrees) *slot = now;
    return LW_OK;
}

/* Decodes the tile unless its bytes were decoded before. */
static enum lw_status check_tile(struct lw_tile_check *check, const struct lw_message_tile *t, lw_tile_id id,
                                 struct lw_tile_held *held, enum lw_tile_verdict *out_verdict) {
    struct seen now = {
        .version = t->version, .base = t->base, .scale = t->scale, .error = t->error, .bounces = t->bounces};
    lw_package_hash(t->payload, t->payload_size, &now.hash);
    struct seen *slot = find_slot(check->seen[id.v], t->version, t->base);
    bool remembered = slot && slot->version == t->version && slot->base == t->base, decodes = true,
         agrees = true;
    enum lw_status status = LW_OK;
    if (held)
        status = decode_and_compare(check, t, id, held, &decodes, &agrees);
    else if (!remembered || check->always)
        status = decode(check, t, id, &decodes);
    if (status != LW_OK) return status;
    agrees &= !remembered || same(slot, &now);
    *out_verdict = !decodes ? LW_TILE_DAMAGED : agrees ? LW_TILE_GOOD : LW_TILE_DIFFERENT;
    if (slot && *out_verdict == LW_TILE_GOOD) *slot = now;
    return LW_OK;
}

enum lw_status lw_tile_check_take(struct lw_tile_check *check, const struct lw_message_tile *t,
                                  uint64_t *known, struct lw_tile_held *held,
                                  struct lw_tile_finding *out_finding) {
    struct lw_tile_finding f = {.verdict = LW_TILE_NOWHERE,
                                .id = lw_atlas_map_find_tile(check->map, t->object, t->level, t->tile)};
    enum lw_status status = LW_OK;
    if (f.id.v != UINT32_MAX) {
        f.before = known[f.id.v];
        if (t->layer != 0)
            f.verdict = LW_TILE_IGNORED;
        else if (t->version <= f.before)
            f.verdict = LW_TILE_BACKWARDS;
        else if (!lw_tile_codec_is_known(t->codec) || (t->base && t->base != f.before))
            f.verdict = LW_TILE_DAMAGED;
        else
            status = check_tile(check, t, f.id, held, &f.verdict);
    }
    if (status != LW_OK) return status;
    if (f.verdict == LW_TILE_GOOD) known[f.id.v] = t->version;
    *out_finding = f;
    return LW_OK;
}

void lw_tile_check_forget(struct lw_tile_check *check) {
    memset(check->seen, 0, (size_t)check->map->tile_count * sizeof *check->seen);
    memset(check->light, 0, (size_t)check->map->tile_count * sizeof *check->light);
}

uint64_t lw_tile_check_decoded(const struct lw_tile_check *check) { return check->decoded_count; }
