#include "client/measure/report_text.h"

#include "common/base/atomic_file.h"

#include <math.h>
#include <stdlib.h>

enum lw_status lw_report_text_begin(struct lw_report_text *text, const char *name, struct lw_error *err) {
    *text = (struct lw_report_text){.name = name};
    text->stream = open_memstream(&text->bytes, &text->size);
    return text->stream ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "no memory for %s", name);
}

enum lw_status lw_report_text_end(struct lw_report_text *text, struct lw_error *err) {
    if (fclose(text->stream) == 0) return LW_OK;
    free(text->bytes);
    return lw_status_fail(err, LW_NO_MEMORY, "no memory for %s", text->name);
}

enum lw_status lw_report_text_save(struct lw_report_text *text, const char *folder, struct lw_error *err) {
    enum lw_status status = lw_report_text_end(text, err);
    if (status != LW_OK) return status;
    status = lw_report_text_write(folder, text->name, text->bytes, text->size, err);
    free(text->bytes);
    return status;
}

enum lw_status lw_report_text_write(const char *folder, const char *name, const char *bytes, size_t size,
                                    struct lw_error *err) {
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return lw_atomic_file_save(path, bytes, size, err);
}

void lw_report_text_rule(FILE *f, uint32_t columns) {
    fprintf(f, "\n|");
    for (uint32_t c = 0; c < columns; c++) fprintf(f, "---|");
    fprintf(f, "\n");
}

void lw_report_text_number(FILE *f, double x) {
    if (isfinite(x))
        fprintf(f, " %.3g |", x);
    else
        fprintf(f, " – |");
}
