#include "tests/integration/web_case.h"

#include "tests/support/web_peer.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define RESTS                                                                                                \
    "builtin:cornell --texels-per-metre 8 --clock step --json --light whole --error 0.3 --http 127.0.0.1:0 "

struct lw_process web_case_daemon;
uint16_t web_case_port;

void web_case_serve(const char *arguments) {
    char line[2048], text[16] = "";
    const char *port_file = lw_support_temporary("http-port");
    snprintf(line, sizeof line, RESTS "--http-port-file %s %s", port_file, arguments);
    lw_process_serve(&web_case_daemon, line);
    FILE *file = fopen(port_file, "re"); /* written before the one that lw_process_serve() waits for */
    assert_non_null(file);
    assert_non_null(fgets(text, sizeof text, file));
    fclose(file);
    web_case_port = (uint16_t)atoi(text);
    assert_true(web_case_port > 0);
}

void web_case_stop(void) {
    const int code = lw_process_stop(&web_case_daemon, SIGTERM, LIMIT_S);
    if (code != 0) fail_msg("ended with %d: %s", code, lw_process_err(&web_case_daemon));
}

unsigned web_case_ask(const char *method, const char *path, const char *lines, char **out_answer,
                      size_t *out_size) {
    char request[4096];
    unsigned status = 0;
    snprintf(request, sizeof request, "%s %s HTTP/1.1\r\nHost: 127.0.0.1:%u\r\n%s\r\n", method, path,
             (unsigned)web_case_port, lines);
    const int s = lw_web_peer_dial(web_case_port);
    char *answer = lw_web_peer_ask(s, request, strcmp(method, "HEAD") == 0, out_size);
    close(s);
    (void)sscanf(answer, "HTTP/1.%*u %u", &status);
    if (out_answer)
        *out_answer = answer;
    else
        free(answer);
    return status;
}

void web_case_expect_header(const char *answer, const char *line) {
    if (!strcasestr(answer, line)) fail_msg("no \"%s\" in: %s", line, answer);
}
