#include "server/serve/metrics/serve_metrics.h"

#include "common/base/clock.h"

#include <dirent.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

static double resident_bytes(void) {
    unsigned long long pages = 0;
    FILE *file = fopen("/proc/self/statm", "re");
    if (!file) return 0;
    if (fscanf(file, "%*u %llu", &pages) != 1) pages = 0;
    fclose(file);
    return (double)pages * (double)sysconf(_SC_PAGESIZE);
}

static double open_descriptors(void) {
    DIR *folder = opendir("/proc/self/fd");
    double count = -1; /* the folder's own */
    if (!folder) return 0;
    for (const struct dirent *entry; (entry = readdir(folder));) count += entry->d_name[0] != '.';
    closedir(folder);
    return count;
}

void lw_serve_metrics_process(struct lw_exposition *e, double started_s) {
    struct rlimit limit;
    lw_exposition_counter(e, "process_cpu_seconds_total", (double)lw_clock_process_cpu_ns() * 1e-9,
                          "CPU time of the process, over all its threads.");
    lw_exposition_gauge(e, "process_start_time_seconds", started_s,
                        "When the process started, since the Unix epoch.");
    lw_exposition_gauge(e, "process_resident_memory_bytes", resident_bytes(), "Resident memory.");
    lw_exposition_gauge(e, "process_open_fds", open_descriptors(), "Open file descriptors.");
    if (getrlimit(RLIMIT_NOFILE, &limit) == 0)
        lw_exposition_gauge(e, "process_max_fds", (double)limit.rlim_cur,
                            "File descriptors that may be open at once.");
}

void lw_serve_metrics_sessions(struct lw_exposition *e, const struct lw_server_stats *serve) {
    lw_exposition_gauge(e, "lightwell_sessions", (double)serve->sessions_now, "Clients that are connected.");
    lw_exposition_gauge(e, "lightwell_drawing_sessions", (double)serve->sessions_drawing,
                        "Clients of these that draw direct light.");
    lw_exposition_counter(e, "lightwell_opened_sessions_total", (double)serve->sessions_total,
                          "Clients that were welcomed.");
    lw_exposition_counter(e, "lightwell_refusals_total", (double)serve->refused, "Refusals sent.");
    lw_exposition_counter(e, "lightwell_session_seconds_total", (double)serve->session_ns * 1e-9,
                          "Time that clients were connected, added up over them.");
    lw_exposition_counter(e, "lightwell_sent_tiles_total", (double)serve->tiles_sent,
                          "Tiles sent, over all clients.");
    lw_exposition_counter(e, "lightwell_sent_bytes_total", (double)serve->bytes_sent,
                          "Bytes sent, over all clients.");
    lw_exposition_gauge(e, "lightwell_waiting_bytes", (double)serve->waiting_bytes,
                        "Bytes that clients' links have not taken.");
    lw_exposition_gauge(e, "lightwell_largest_waiting_bytes", (double)serve->waiting_bytes_max,
                        "Those of the client that has most of them.");
    lw_exposition_gauge(e, "lightwell_socket_bytes", (double)serve->socket_bytes,
                        "Bytes that links have taken and clients' systems have not.");
    lw_exposition_metric(e, "lightwell_loop_lag_seconds", "histogram",
                         "How late the network's thread came to what was due, while there are clients.");
    lw_exposition_durations(e, "lightwell_loop_lag_seconds", NULL, &serve->loop_lag);
    lw_exposition_metric(e, "lightwell_acknowledgement_duration_seconds", "histogram",
                         "From a frame's reaching the network's thread to a client's saying that it has it.");
    lw_exposition_durations(e, "lightwell_acknowledgement_duration_seconds", NULL, &serve->ack);
}

bool lw_serve_metrics_plain(struct lw_server_page *out_page, unsigned status, const char *text) {
    *out_page = (struct lw_server_page){
        .status = status, .type = "text/plain; charset=utf-8", .text = strdup(text), .size = strlen(text)};
    return out_page->text;
}
