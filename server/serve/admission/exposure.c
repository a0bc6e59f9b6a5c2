#include "server/serve/admission/exposure.h"

#include "common/base/log.h"

#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>

static bool is_own(const struct sockaddr *address) {
    if (address->sa_family == AF_INET)
        return ntohl(((const struct sockaddr_in *)address)->sin_addr.s_addr) >> 24 == 127;
    if (address->sa_family != AF_INET6) return false;
    const struct in6_addr *v6 = &((const struct sockaddr_in6 *)address)->sin6_addr;
    return IN6_IS_ADDR_LOOPBACK(v6) || (IN6_IS_ADDR_V4MAPPED(v6) && v6->s6_addr[12] == 127);
}

bool lw_exposure_is_loopback(const char *host) {
    const struct addrinfo hints = {.ai_socktype = SOCK_STREAM, .ai_flags = AI_PASSIVE};
    struct addrinfo *found;
    if (getaddrinfo(host, NULL, &hints, &found) != 0) return true;
    bool own = true;
    for (const struct addrinfo *a = found; a; a = a->ai_next) own &= is_own(a->ai_addr);
    freeaddrinfo(found);
    return own;
}

enum lw_status lw_exposure_check(const struct lw_exposure *exposure, const char *option, const char *host,
                                 struct lw_error *err) {
    if ((exposure->has_tls && exposure->has_tokens) || lw_exposure_is_loopback(host)) return LW_OK;
    const char *lacking = exposure->has_tls      ? "tokens (--tokens)"
                          : exposure->has_tokens ? "TLS (--tls-certificate, --tls-key)"
                                                 : "TLS (--tls-certificate, --tls-key) and tokens (--tokens)";
    if (!exposure->is_insecure)
        return lw_status_fail(err, LW_USAGE,
                              "%s: other machines can reach %s, which wants %s; or --insecure, for a network "
                              "whose every machine you trust",
                              option, host, lacking);
    lw_log(LW_LOG_WARNING, "%s: other machines can reach %s, without %s: --insecure", option, host, lacking);
    return LW_OK;
}
