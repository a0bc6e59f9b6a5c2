#include "tests/support/nats_case.h"

#include <arpa/inet.h>
#include <ftw.h>
#include <netinet/in.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#ifndef LW_NATS_SERVER
#define LW_NATS_SERVER ""
#endif

bool lw_nats_case_is_possible(void) {
    if (*LW_NATS_SERVER) return true;
    puts("skipped: there is no nats-server (scripts/deps.sh)");
    return false;
}

/* A port of 127.0.0.1 that nobody has: nats-server has to come back at it. */
static uint16_t free_port(void) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof address;
    const int descriptor = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(bind(descriptor, (struct sockaddr *)&address, size), 0);
    assert_int_equal(getsockname(descriptor, (struct sockaddr *)&address, &size), 0);
    close(descriptor);
    return ntohs(address.sin_port);
}

void lw_nats_case_start(struct lw_nats_case *nats, const struct lw_nats_case_desc *desc) {
    char arguments[900], config[128];
    const char *path = lw_support_temporary("nats.conf");
    const int length = desc->limit
                           ? snprintf(config, sizeof config,
                                      "jetstream { max_file_store: %u, max_memory_store: 1M }\n", desc->limit)
                           : 0;
    if (!nats->port) {
        nats->port = free_port();
        snprintf(nats->folder, sizeof nats->folder, "%s", lw_support_temporary("jetstream"));
    }
    lw_support_write_file(path, config, (size_t)length);
    const int before = desc->space ? snprintf(arguments, sizeof arguments, "ip netns exec %s %s ",
                                              desc->space, LW_NATS_SERVER)
                                   : 0;
    snprintf(arguments + before, sizeof arguments - (size_t)before, "-a %s -p %u -sd %s -c %s%s %s",
             desc->host ? desc->host : "127.0.0.1", nats->port, nats->folder, path,
             desc->no_jetstream ? "" : " -js", desc->options ? desc->options : "");
    lw_process_start(&nats->process, desc->space ? "/usr/bin/env" : LW_NATS_SERVER, arguments);
    lw_process_await_text(&nats->process, "Server is ready");
}

void lw_nats_case_kill(struct lw_nats_case *nats) {
    assert_int_equal(lw_process_stop(&nats->process, SIGKILL, LW_PROCESS_LIMIT_S), -SIGKILL);
}

static int remove_file(const char *path, const struct stat *about, int kind, struct FTW *walk) {
    (void)about, (void)kind, (void)walk;
    return remove(path);
}

void lw_nats_case_finish(struct lw_nats_case *nats) {
    if (*nats->folder) (void)nftw(nats->folder, remove_file, 16, FTW_DEPTH | FTW_PHYS);
    *nats = (struct lw_nats_case){.port = 0};
}

const char *lw_nats_case_address(const struct lw_nats_case *nats, const char *scene) {
    static char text[64];
    snprintf(text, sizeof text, "nats://127.0.0.1:%u/%s", nats->port, scene);
    return text;
}
