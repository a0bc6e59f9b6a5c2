/* nats_case.h: a nats-server as a test runs it, on a free port, with its files in the test's own folder. */
#ifndef LW_TESTS_NATS_CASE_H
#define LW_TESTS_NATS_CASE_H

#include "tests/support/process.h"

struct lw_nats_case {
    struct lw_process process;
    uint16_t port;
    char folder[200]; /* JetStream's files */
};

struct lw_nats_case_desc {
    bool no_jetstream;
    unsigned limit;      /* bytes of JetStream's files; 0: none */
    const char *options; /* further ones of nats-server; NULL: none */
    const char *host;    /* where it listens; NULL: 127.0.0.1 */
    const char *space;   /* the network namespace that it runs in (net_space.h); NULL: the test's */
};

/** Whether there is a nats-server; else it says on stdout that the test is skipped. */
bool lw_nats_case_is_possible(void);
/** Starts it and waits until it is ready; a later one has the port and the files of the first. */
void lw_nats_case_start(struct lw_nats_case *nats, const struct lw_nats_case_desc *desc);
/** SIGKILL. */
void lw_nats_case_kill(struct lw_nats_case *nats);
/** Removes the files of a server that has ended. */
void lw_nats_case_finish(struct lw_nats_case *nats);
/** "nats://127.0.0.1:PORT/SCENE"; until the next call. */
const char *lw_nats_case_address(const struct lw_nats_case *nats, const char *scene);

#endif
