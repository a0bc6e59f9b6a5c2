/* address_rates.h: how often each address may do something, such as connect.
 * Flow:    connection -> [address_rates] -> session, or refusal
 * Threads: one thread at a time. */
#ifndef LW_SERVE_ADMISSION_ADDRESS_RATES_H
#define LW_SERVE_ADMISSION_ADDRESS_RATES_H

#include "server/serve/admission/address_places.h"
#include "server/serve/admission/leaky_bucket.h"

#define LW_ADDRESS_RATES_SLOTS 4096u

/** Zero but for seed has counted nothing. Addresses may share a slot: it remembers the last one. */
struct lw_address_rates {
    uint64_t seed;
    struct lw_address_rates_slot {
        struct lw_address address;
        struct lw_leaky_bucket bucket;
    } slot[LW_ADDRESS_RATES_SLOTS];
};

/** Whether the address may once more: rate_hz times a second, burst at once. Counts it then. */
LW_MUST_CHECK bool lw_address_rates_allow(struct lw_address_rates *rates, const struct lw_address *address,
                                          double rate_hz, double burst, uint64_t now_ns);

#endif
