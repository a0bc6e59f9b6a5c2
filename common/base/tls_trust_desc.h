/* tls_trust_desc.h: options of how TLS verifies servers.
 * Flow:    --tls, --ca, --tls-insecure -> [tls_trust_desc] -> tls_trust, nats_link
 * Threads: constants, [any]. */
#ifndef LW_COMMON_BASE_TLS_TRUST_DESC_H
#define LW_COMMON_BASE_TLS_TRUST_DESC_H

#include <stdbool.h>

/** Zero: no TLS. */
struct lw_tls_trust_desc {
    bool wanted;     /* not read where an address says so, as those of NATS do */
    const char *ca;  /* a file of certificates in PEM whose servers are believed; NULL: those of the system */
    bool trusts_all; /* anybody is believed: for tests */
};

#endif
