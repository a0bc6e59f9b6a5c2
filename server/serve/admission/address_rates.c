#include "server/serve/admission/address_rates.h"

bool lw_address_rates_allow(struct lw_address_rates *rates, const struct lw_address *address, double rate_hz,
                            double burst, uint64_t now_ns) {
    struct lw_address_rates_slot *slot =
        &rates->slot[lw_address_hash(address, rates->seed) % LW_ADDRESS_RATES_SLOTS];
    if (!lw_address_equals(&slot->address, address))
        *slot = (struct lw_address_rates_slot){.address = *address};
    return lw_leaky_bucket_take(&slot->bucket, rate_hz, burst, now_ns);
}
