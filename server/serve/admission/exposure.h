/* exposure.h: whether what a server listens on can be reached from other machines, and may be.
 * Threads: main() only. */
#ifndef LW_SERVE_ADMISSION_EXPOSURE_H
#define LW_SERVE_ADMISSION_EXPOSURE_H

#include "common/base/status.h"

/** Protection of a server. */
struct lw_exposure {
    bool has_tls, has_tokens;
    bool is_insecure; /* --insecure: then nothing has to */
};

/** Whether all addresses of a host, a name or an address, are this machine's own. An unknown address counts
 * as one of this machine, since to listen on it will fail. */
bool lw_exposure_is_loopback(const char *host);

/** Refuses an address of other machines without TLS and tokens. With --insecure it warns instead.
 * option  that names it, such as "--listen"
 * Errors: LW_USAGE. */
LW_MUST_CHECK enum lw_status lw_exposure_check(const struct lw_exposure *exposure, const char *option,
                                               const char *host, struct lw_error *err);

#endif
