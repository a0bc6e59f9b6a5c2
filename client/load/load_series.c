#include "client/load/load_series.h"

#include "common/base/clock.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct lw_load_series {
    const char *path;
    FILE *file;
    uint64_t bytes; /* received up to the last line */
};

enum lw_status lw_load_series_create(const char *path, struct lw_load_series **out_series,
                                     struct lw_error *err) {
    struct lw_load_series *series = calloc(1, sizeof *series);
    if (!series) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    series->path = path;
    series->file = fopen(path, "we");
    if (!series->file) {
        free(series);
        return lw_status_fail(err, LW_IO, "--series: cannot write %.200s: %s", path, strerror(errno));
    }
    fputs("unix_s,users,bytes,age_p50_ms,age_max_ms\n", series->file);
    *out_series = series;
    return LW_OK;
}

static void add_age(struct lw_histogram *ages, uint64_t light_ns, uint64_t now_ns) {
    if (light_ns) lw_histogram_add(ages, now_ns > light_ns ? now_ns - light_ns : 0);
}

void lw_load_series_add(struct lw_load_series *series, const struct lw_load_shared *shared, uint64_t now_ns) {
    struct lw_histogram ages = {0};
    unsigned users = 0;
    for (const struct lw_load_session *s = shared->first; s; s = lw_load_session_next(s)) {
        if (lw_load_session_is_live(s)) add_age(&ages, lw_load_session_light_ns(s), now_ns);
        users += lw_load_session_is_streaming(s);
    }
    for (const struct lw_load_return *r = shared->returning; r; r = r->next)
        add_age(&ages, r->light_ns, now_ns);
    const uint64_t bytes = shared->figures->bytes;
    fprintf(series->file, "%.3f,%u,%" PRIu64, 1e-9 * (double)lw_clock_read_ns(CLOCK_REALTIME), users,
            bytes - series->bytes);
    if (ages.count)
        fprintf(series->file, ",%.1f,%.1f\n", 1e-6 * (double)lw_histogram_quantile(&ages, 0.5),
                1e-6 * (double)ages.max);
    else
        fputs(",,\n", series->file);
    series->bytes = bytes;
}

enum lw_status lw_load_series_finish(struct lw_load_series *series, struct lw_error *err) {
    enum lw_status status = LW_OK;
    if (!series) return LW_OK;
    const bool is_bad = ferror(series->file) != 0;
    if (fclose(series->file) != 0 || is_bad)
        status = lw_status_fail(err, LW_IO, "--series: cannot write %.200s: %s", series->path,
                                is_bad ? "a line is missing" : strerror(errno));
    free(series);
    return status;
}
