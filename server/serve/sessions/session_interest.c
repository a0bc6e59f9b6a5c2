#include "server/serve/sessions/session_private.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

bool lw_session_interest_test_and_set(uint64_t *bits, uint32_t tile) {
    const uint64_t bit = 1ull << (tile % 64);
    const bool before = bits[tile / 64] & bit;
    bits[tile / 64] |= bit;
    return before;
}

/* Sets a session's bits of listed tiles, and with stand-ins those of coarser ones that cover the same. */
static void mark(struct lw_session *s) {
    const struct lw_atlas_map *map = s->shared->atlas_map;
    const size_t words = lw_session_interest_words(s);
    uint64_t *listed_bits = s->interest_bits + words;
    memset(s->interest_bits, 0, 2 * words * sizeof *s->interest_bits);
    for (uint32_t i = 0; i < s->interest.tile_count; i++) {
        const uint32_t listed = s->interest.tile[i];
        LW_INVARIANT(listed < map->tile_count);
        const struct lw_tile_place *place = &map->place[listed];
        lw_session_interest_test_and_set(listed_bits, listed);
        /* above a tile that has its bit all have theirs */
        if (lw_session_interest_test_and_set(s->interest_bits, listed) || !s->interest.stand_ins) continue;
        /* a finer level's tile: tiles above it from level 0 on */
        const uint32_t finer = lw_atlas_finer(place->level), first = finer ? 0 : place->level + 1;
        for (uint32_t l = first; l < map->atlas[place->object]->level_count; l++) {
            const uint32_t up = l + finer - (finer ? 0 : place->level);
            if (lw_session_interest_test_and_set(
                    s->interest_bits,
                    lw_atlas_map_find(map, place->object, l, place->x >> up, place->y >> up).v))
                break;
        }
    }
}

/* One session more, or less, that takes its channels. */
static void count_taker(struct lw_session *s, bool more) {
    for (uint32_t i = 0; i < s->take_count; i++) {
        struct lw_session_channel *c = s->take[i].channel;
        LW_INVARIANT(more || c->session_count > 0);
        if (more ? !c->session_count++ : !--c->session_count) s->shared->channels.taken ^= 1u << c->number;
        LW_INVARIANT((s->shared->channels.taken >> c->number & 1) == (c->session_count > 0));
    }
}

static bool has_fine(const struct lw_session *s) {
    for (uint32_t i = 0; i < s->interest.tile_count; i++)
        if (s->interest.tile[i] >= s->shared->atlas_map->plain_count) return true;
    return false;
}

static void count_in(struct lw_session *s, const struct lw_session_interest *interest) {
    if (interest->everything)
        lw_interest_union_add_everything(&s->shared->interest_union);
    else
        lw_interest_union_add(&s->shared->interest_union, interest->tile, interest->tile_count);
}

static void count_out(struct lw_session *s, const struct lw_session_interest *interest) {
    if (interest->everything)
        lw_interest_union_remove_everything(&s->shared->interest_union);
    else
        lw_interest_union_remove(&s->shared->interest_union, interest->tile, interest->tile_count);
}

void lw_session_interest_forget_fine(struct lw_session *s, const struct lw_session_interest *before,
                                     const uint64_t *listed) {
    for (uint32_t i = 0; i < before->tile_count; i++) {
        const uint32_t id = before->tile[i];
        if (id < s->shared->atlas_map->plain_count) continue;
        if (listed && lw_session_interest_is_set(listed, id)) continue;
        for (uint32_t k = 0; k < s->take_count; k++)
            if (s->take[k].sent) s->take[k].sent[id] = 0;
    }
}

void lw_session_interest_free(struct lw_session *s, struct lw_session_interest *interest) {
    /* ids are free again once the solver has a list without them */
    s->shared->interest_union.changed |=
        lw_fine_names_remove(&s->shared->fine, interest->tile, interest->tile_count);
    free(interest->tile);
    *interest = (struct lw_session_interest){0};
}

bool lw_session_interest_take_up(struct lw_session *s) {
    struct lw_session_interest before = s->interest;
    LW_INVARIANT(s->has_waiting && s->waiting.tile_count <= s->shared->atlas_map->tile_count);
    if (s->waiting.everything) {
        free(s->interest_bits);
        s->interest_bits = NULL;
    } else if (!s->interest_bits) {
        s->interest_bits = calloc(2 * lw_session_interest_words(s), sizeof *s->interest_bits);
        if (!s->interest_bits) return false;
    }
    s->interest = s->waiting;
    s->waiting = (struct lw_session_interest){0};
    s->has_waiting = false;
    s->interest_epoch = s->shared->epoch;
    if (s->interest_bits) mark(s);
    /* once more: until now the list before it was served */
    lw_session_interest_forget_fine(s, &before, s->interest_bits);
    if (s->state == LW_SESSION_STREAMING) {
        /* in this order, so that a tile of both is never without interest */
        count_in(s, &s->interest);
        count_out(s, &before);
        s->shared->interest_union.changed |= has_fine(s); /* turns may be others */
    }
    lw_session_interest_free(s, &before);
    s->settled_due = s->frame_sent > 0;
    for (uint32_t i = 0; i < s->take_count; i++) s->take[i].generation = 0; /* the walk starts again */
    return true;
}

void lw_session_interest_join(struct lw_session *s) {
    count_in(s, &s->interest);
    count_taker(s, true);
}

void lw_session_interest_leave(struct lw_session *s) {
    count_out(s, &s->interest);
    count_taker(s, false);
}
