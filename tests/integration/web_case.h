/* web_case.h: a lightwelld that serves over HTTP, and requests to it. */
#ifndef LW_TESTS_WEB_CASE_H
#define LW_TESTS_WEB_CASE_H

#include "tests/support/process.h"

#define LIMIT_S LW_PROCESS_LIMIT_S

/* The daemon, and its port for HTTP. */
extern struct lw_process web_case_daemon;
extern uint16_t web_case_port;

/** Starts lightwelld, whose light comes to rest, with a port for HTTP. */
void web_case_serve(const char *arguments);

/** Ends the daemon; its exit code must be 0. */
void web_case_stop(void);

/** The status of the answer to a request with a Host that is right. *out_answer may
 * be NULL; the caller frees it. */
unsigned web_case_ask(const char *method, const char *path, const char *lines, char **out_answer,
                      size_t *out_size);

/** Ends the test unless the answer has this text, in letters of any case. */
void web_case_expect_header(const char *answer, const char *line);

#endif
