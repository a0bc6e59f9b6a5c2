#include "server/serve/admission/peer_log.h"

#include "common/base/invariant.h"
#include "common/base/log.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

bool lw_peer_log_allows(struct lw_peer_log *log, const struct lw_address *address, const char *address_text,
                        uint64_t now_ns) {
    struct lw_peer_log_slot *slot = &log->slot[lw_address_hash(address, log->seed) % LW_PEER_LOG_SLOTS];
    if (lw_leaky_bucket_take(&slot->bucket, LW_PEER_LOG_HZ, LW_PEER_LOG_BURST, now_ns) &&
        lw_leaky_bucket_take(&log->all, LW_PEER_LOG_ALL_HZ, 10 * LW_PEER_LOG_ALL_HZ, now_ns))
        return true;
    slot->left_out++;
    snprintf(slot->address, sizeof slot->address, "%s", address_text);
    return false;
}

void lw_peer_log_tell(struct lw_peer_log *log, uint64_t now_ns) {
    uint64_t others = 0;
    unsigned lines = 0;
    LW_INVARIANT(now_ns >= log->logged_ns);
    if (now_ns - log->logged_ns < LW_PEER_LOG_TELL_S * 1000000000ull) return;
    log->logged_ns = now_ns;
    for (unsigned i = 0; i < LW_PEER_LOG_SLOTS; i++) {
        struct lw_peer_log_slot *slot = &log->slot[i];
        if (!slot->left_out) continue;
        if (++lines <= LW_PEER_LOG_TELL_S)
            lw_log(LW_LOG_INFO, "%s: %" PRIu64 " more lines are left out", slot->address, slot->left_out);
        else
            others += slot->left_out;
        slot->left_out = 0;
    }
    if (others) lw_log(LW_LOG_INFO, "other addresses: %" PRIu64 " more lines are left out", others);
}

void lw_peer_log_quote(char *dst, size_t dst_size, const char *name) {
    size_t size = 0;
    if (dst_size < 3) return;
    dst[size++] = '"';
    for (; *name && size + 3 < dst_size; name++) {
        if (*name == '"' || *name == '\\') dst[size++] = '\\';
        dst[size++] = *name;
    }
    dst[size++] = '"';
    LW_INVARIANT(size < dst_size);
    dst[size] = '\0';
}
