/* address_places.h: how many places each address has taken, so that one alone cannot take all of them.
 * Flow:    connection -> [address_places] -> session, or refusal
 * Threads: one thread at a time. */
#ifndef LW_SERVE_ADMISSION_ADDRESS_PLACES_H
#define LW_SERVE_ADMISSION_ADDRESS_PLACES_H

#include "common/base/status.h"

#include <stdint.h>
#include <sys/socket.h>

/** Peers with one IPv4 address count as one, and peers with one IPv6 network (64 bits). Loopback is
 * known as such. */
struct lw_address {
    uint8_t bytes[16];
    bool is_loopback; /* 127.0.0.0/8, ::1, and the former as ::ffff:127.0.0.0/104 */
};

/** All zero if address is no IP address. */
struct lw_address lw_address_of(const struct sockaddr *address);
bool lw_address_equals(const struct lw_address *a, const struct lw_address *b);
/** For tables; seed: by chance, so that nobody can choose addresses that collide. */
uint32_t lw_address_hash(const struct lw_address *address, uint64_t seed);

#define LW_ADDRESS_PLACES_BUCKETS 1024u

/** Zero but for seed has taken none. */
struct lw_address_places {
    uint64_t seed;
    struct lw_address_places_entry *bucket[LW_ADDRESS_PLACES_BUCKETS];
};

/** Takes a place for an address that has fewer than most. Errors: LW_UNAVAILABLE: it has them; LW_NO_MEMORY.
 */
LW_MUST_CHECK enum lw_status lw_address_places_take(struct lw_address_places *places,
                                                    const struct lw_address *address, uint32_t most);
/** Gives back one that was taken. */
void lw_address_places_give(struct lw_address_places *places, const struct lw_address *address);
void lw_address_places_finish(struct lw_address_places *places);

/** Places, of `all`, that one address may take: a tenth of them, or nine tenths for this machine itself; at
 * least one. */
uint32_t lw_address_places_share(const struct lw_address *address, uint32_t all);

#endif
