/* Host, Origin and a list: any bytes. Input: the three, each ended by a line feed. */
#include "server/serve/web/http_origin.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

static void require(bool condition) {
    if (!condition) abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char *text = malloc(size + 1), name[LW_HTTP_ORIGIN_MAX];
    if (!text) return 0;
    memcpy(text, data, size);
    text[size] = '\0';
    char *rest = text, *host = strsep(&rest, "\n"), *origin = rest ? strsep(&rest, "\n") : host,
         *list = rest ? rest : host;
    if (lw_http_origin_host_name(host, name, sizeof name)) {
        /* a header of ours (web_server.c) has these characters alone */
        require(*name &&
                !host[strspn(host, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-._:[]")]);
        (void)lw_http_origin_is_loopback(name);
    }
    if (lw_http_origin_is_same(origin, host)) {
        const size_t origin_size = strlen(origin), host_size = strlen(host);
        require(host_size && origin_size >= host_size + strlen("http://"));
    }
    (void)lw_http_origin_is_listed(list, origin);
    free(text);
    return 0;
}
