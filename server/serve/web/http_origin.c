#include "server/serve/web/http_origin.h"

#include <arpa/inet.h>
#include <ctype.h>
#include <netinet/in.h>
#include <string.h>
#include <strings.h>

#define NAME_CHARACTERS    "abcdefghijklmnopqrstuvwxyz0123456789-._"
#define ADDRESS_CHARACTERS "abcdef0123456789:."

/* An empty one, or ":" and digits. */
static bool is_port(const char *text) {
    if (!*text) return true;
    const size_t digits = *text == ':' ? strspn(text + 1, "0123456789") : 0;
    return digits >= 1 && digits <= 5 && !text[1 + digits];
}

bool lw_http_origin_host_name(const char *host, char *out_name, size_t name_size) {
    char lower[LW_HTTP_ORIGIN_MAX];
    const size_t length = strlen(host);
    if (length >= sizeof lower) return false;
    for (size_t i = 0; i <= length; i++) lower[i] = (char)tolower((unsigned char)host[i]);
    const bool bracketed = *lower == '[';
    const char *name = lower + bracketed, *rest;
    const size_t size = strspn(name, bracketed ? ADDRESS_CHARACTERS : NAME_CHARACTERS);
    rest = name + size;
    if (!size || size >= name_size || (bracketed && *rest++ != ']') || !is_port(rest)) return false;
    memcpy(out_name, name, size);
    out_name[size] = '\0';
    return true;
}

bool lw_http_origin_is_loopback(const char *name) {
    struct in_addr v4;
    struct in6_addr v6;
    if (strcmp(name, "localhost") == 0) return true;
    if (inet_pton(AF_INET, name, &v4) == 1) return ntohl(v4.s_addr) >> 24 == 127;
    return inet_pton(AF_INET6, name, &v6) == 1 && IN6_IS_ADDR_LOOPBACK(&v6);
}

bool lw_http_origin_is_same(const char *origin, const char *host) {
    static const char *const schemes[] = {"http://", "https://"};
    for (size_t i = 0; i < sizeof schemes / sizeof *schemes; i++)
        if (strncasecmp(origin, schemes[i], strlen(schemes[i])) == 0)
            return *host && strcasecmp(origin + strlen(schemes[i]), host) == 0;
    return false;
}

bool lw_http_origin_is_listed(const char *list, const char *text) {
    const size_t length = strlen(text);
    for (const char *at = list; at && *at;) {
        const size_t size = strcspn(at, ",");
        if (size == length && length && strncasecmp(at, text, size) == 0) return true;
        at += size + (at[size] == ',');
    }
    return false;
}
