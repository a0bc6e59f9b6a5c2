/* nats_trust.h: which NATS servers are believed to be who they say, by TLS.
 * Flow:    --ca, --tls-insecure -> [nats_trust] -> nats_link
 * Threads: constants, [any]. */
#ifndef LW_NATS_NATS_TRUST_H
#define LW_NATS_NATS_TRUST_H

#include <stdbool.h>

/** Zero: those whose issuers the system believes. */
struct lw_nats_trust {
    const char *ca;  /* a file in PEM with the certificate to believe, or its issuer's; NULL: the system's */
    bool trusts_all; /* anybody is believed: for tests */
};

#endif
