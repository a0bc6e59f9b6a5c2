#include "server/serve/address_rates.h"

#include <math.h>

bool lw_address_rates_allow(struct lw_address_rates *rates, const struct lw_address *address, double rate_hz,
                            double burst, uint64_t now_ns) {
    struct lw_address_rates_slot *slot =
        &rates->slot[lw_address_hash(address, rates->seed) % LW_ADDRESS_RATES_SLOTS];
    if (!lw_address_equals(&slot->address, address))
        *slot = (struct lw_address_rates_slot){.address = *address, .as_of_ns = now_ns};
    const double elapsed_s = now_ns > slot->as_of_ns ? 1e-9 * (double)(now_ns - slot->as_of_ns) : 0;
    slot->done = fmax(slot->done - elapsed_s * rate_hz, 0);
    slot->as_of_ns = now_ns;
    if (slot->done + 1 > burst) return false;
    slot->done += 1;
    return true;
}
