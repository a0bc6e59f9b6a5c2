#include "server/serve/admission/address_places.h"

#include "common/base/invariant.h"

#include <netinet/in.h>
#include <stdlib.h>
#include <string.h>

struct lw_address_places_entry {
    struct lw_address_places_entry *next;
    struct lw_address address;
    uint32_t count; /* above 0 */
};

struct lw_address lw_address_of(const struct sockaddr *address) {
    struct lw_address out = {0};
    if (address->sa_family == AF_INET) {
        const uint32_t v4 = ((const struct sockaddr_in *)address)->sin_addr.s_addr;
        memset(out.bytes + 10, 0xff, 2);
        memcpy(out.bytes + 12, &v4, 4);
        out.is_loopback = out.bytes[12] == 127;
    } else if (address->sa_family == AF_INET6) {
        const struct in6_addr *v6 = &((const struct sockaddr_in6 *)address)->sin6_addr;
        const bool is_v4 = IN6_IS_ADDR_V4MAPPED(v6);
        memcpy(out.bytes, v6, is_v4 ? 16 : 8);
        out.is_loopback = IN6_IS_ADDR_LOOPBACK(v6) || (is_v4 && v6->s6_addr[12] == 127);
    }
    return out;
}

bool lw_address_equals(const struct lw_address *a, const struct lw_address *b) {
    return memcmp(a->bytes, b->bytes, sizeof a->bytes) == 0 && a->is_loopback == b->is_loopback;
}

uint32_t lw_address_hash(const struct lw_address *address, uint64_t seed) {
    uint64_t half[2];
    memcpy(half, address->bytes, sizeof half);
    uint64_t hash = seed;
    for (int i = 0; i < 2; i++) { /* the mixing of MurmurHash3's end (Appleby), after each half */
        hash ^= half[i];
        hash = (hash ^ hash >> 33) * 0xff51afd7ed558ccdull;
        hash = (hash ^ hash >> 33) * 0xc4ceb9fe1a85ec53ull;
        hash ^= hash >> 33;
    }
    return (uint32_t)hash;
}

static struct lw_address_places_entry **find(struct lw_address_places *places,
                                             const struct lw_address *address) {
    struct lw_address_places_entry **at =
        &places->bucket[lw_address_hash(address, places->seed) % LW_ADDRESS_PLACES_BUCKETS];
    while (*at && !lw_address_equals(&(*at)->address, address)) at = &(*at)->next;
    return at;
}

enum lw_status lw_address_places_take(struct lw_address_places *places, const struct lw_address *address,
                                      uint32_t most) {
    struct lw_address_places_entry **at = find(places, address);
    if ((*at ? (*at)->count : 0) >= most) return LW_UNAVAILABLE;
    if (!*at) {
        if (!(*at = calloc(1, sizeof **at))) return LW_NO_MEMORY;
        (*at)->address = *address;
    }
    (*at)->count++;
    LW_INVARIANT((*at)->count <= most);
    return LW_OK;
}

void lw_address_places_give(struct lw_address_places *places, const struct lw_address *address) {
    struct lw_address_places_entry **at = find(places, address), *entry = *at;
    LW_INVARIANT(entry && entry->count > 0);
    if (--entry->count) return;
    *at = entry->next;
    free(entry);
}

void lw_address_places_finish(struct lw_address_places *places) {
    for (unsigned b = 0; b < LW_ADDRESS_PLACES_BUCKETS; b++)
        for (struct lw_address_places_entry *entry; (entry = places->bucket[b]);) {
            places->bucket[b] = entry->next;
            free(entry);
        }
}

uint32_t lw_address_places_share(const struct lw_address *address, uint32_t all) {
    const uint32_t tenth = all / 10, share = address->is_loopback ? all - tenth : tenth;
    return share ? share : 1;
}
