/* certificate.h: certificates for tests, signed by themselves. */
#ifndef LW_TESTS_CERTIFICATE_H
#define LW_TESTS_CERTIFICATE_H

#include "tests/support/support.h"

/** Writes a certificate and its key, of P-256, in PEM; nobody else may read the key. Ends the test where that
 * fails.
 * names  as OpenSSL has them, such as "DNS:localhost,IP:127.0.0.1"
 * days   that it is good for; negative: it has expired */
void lw_certificate_make(const char *certificate_path, const char *key_path, const char *names, int days);

#endif
