#include "server/serve/admission/message_rates.h"

#include "common/base/invariant.h"

#include <math.h>

static const struct {
    double rate_hz, burst;
    const char *excess;
} limits[] = {
#define X(name, rate_hz, burst)                                                                              \
    [LW_MESSAGE_RATES_##name] = {rate_hz, burst, "more than " #rate_hz " " #name " a second"},
    LW_MESSAGE_RATES_MAP(X)
#undef X
};

void lw_message_rates_init(struct lw_message_rates *rates, uint64_t now_ns) {
    *rates = (struct lw_message_rates){.as_of_ns = now_ns};
    for (int k = 0; k < LW_MESSAGE_RATES_COUNT; k++) rates->left[k] = limits[k].burst;
}

void lw_message_rates_trust(struct lw_message_rates *rates, bool trusted) { rates->trusted = trusted; }

/* Nobody has more left than a burst, however long nothing was said. */
static bool are_within_bursts(const struct lw_message_rates *r) {
    for (int k = 0; k < LW_MESSAGE_RATES_COUNT; k++)
        if (!(r->left[k] <= limits[k].burst) || !isfinite(r->left[k])) return false;
    return true;
}

static void fill(struct lw_message_rates *r, uint64_t now_ns) {
    const double elapsed_s = now_ns > r->as_of_ns ? 1e-9 * (double)(now_ns - r->as_of_ns) : 0;
    for (int k = 0; k < LW_MESSAGE_RATES_COUNT; k++)
        r->left[k] = fmin(r->left[k] + elapsed_s * limits[k].rate_hz, limits[k].burst);
    if (now_ns > r->as_of_ns) r->as_of_ns = now_ns;
    LW_INVARIANT_DEAR(are_within_bursts(r));
}

/* LW_MESSAGE_RATES_COUNT: bounded by what else there is of them, such as once a session. */
static enum lw_message_rates_kind kind_of(uint16_t type) {
    switch (type) {
#define X(name, ...)                                                                                         \
    case LW_MESSAGE_##name:                                                                                  \
        return LW_MESSAGE_RATES_##name;
        X(INTEREST)
        X(PING)
        X(PONG)
        X(ACK)
        X(UPDATE)
        X(ASK)
        X(HOLDS)
#undef X
    default:
        return LW_MESSAGE_RATES_COUNT;
    }
}

bool lw_message_rates_wait(struct lw_message_rates *rates, uint64_t now_ns) {
    const double wanted_s = rates->waits ? 1e-3 * LW_MESSAGE_RATES_PAUSE_MS : 0;
    fill(rates, now_ns);
    rates->waits = false;
    for (int k = 0; k < LW_MESSAGE_RATES_COUNT; k++)
        rates->waits |= rates->left[k] < wanted_s * limits[k].rate_hz;
    return rates->waits;
}

bool lw_message_rates_count(struct lw_message_rates *rates, struct lw_framing_header header,
                            uint64_t now_ns) {
    const enum lw_message_rates_kind kind = kind_of(header.type);
    const double bytes = (double)(LW_FRAMING_HEADER_SIZE + header.body_size);
    if (kind < LW_MESSAGE_RATES_COUNT) rates->left[kind] -= 1;
    rates->left[LW_MESSAGE_RATES_FRAMES] += 1;
    rates->left[LW_MESSAGE_RATES_OVERHEAD] += LW_MESSAGE_RATES_ENVELOPE;
    return lw_message_rates_count_other(rates, LW_MESSAGE_RATES_BYTES,
                                        kind == LW_MESSAGE_RATES_HOLDS ? 0 : bytes, now_ns);
}

void lw_message_rates_bound(struct lw_message_rates *rates, enum lw_message_rates_kind kind, double at_once) {
    LW_INVARIANT(kind < LW_MESSAGE_RATES_COUNT && at_once >= 0);
    rates->left[kind] = fmin(fmax(rates->left[kind], 0), at_once);
}

bool lw_message_rates_count_other(struct lw_message_rates *rates, enum lw_message_rates_kind kind,
                                  double count, uint64_t now_ns) {
    LW_INVARIANT(kind < LW_MESSAGE_RATES_COUNT && count >= 0);
    rates->left[kind] -= rates->trusted ? count / LW_MESSAGE_RATES_TRUST : count;
    return lw_message_rates_wait(rates, now_ns);
}

const char *lw_message_rates_judge(struct lw_message_rates *rates, uint64_t elapsed_ns, uint64_t limit_ns) {
    if (!rates->waits) {
        rates->waited_ns = rates->waited_ns > elapsed_ns ? rates->waited_ns - elapsed_ns : 0;
        return NULL;
    }
    rates->waited_ns += elapsed_ns;
    if (rates->waited_ns <= limit_ns) return NULL;
    int worst = 0; /* the longest to wait for */
    for (int k = 1; k < LW_MESSAGE_RATES_COUNT; k++)
        if (rates->left[k] / limits[k].rate_hz < rates->left[worst] / limits[worst].rate_hz) worst = k;
    return limits[worst].excess;
}
