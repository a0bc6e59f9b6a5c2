/* The mending of STL, on any bytes: it makes as many bytes at most, and none past their end. */
#include "server/import/foreign/foreign_text.h"

#include "common/base/log.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerInitialize(int *argc, char ***argv) {
    (void)argc, (void)argv;
    lw_log_init("fuzz_foreign_text", LW_LOG_ERROR);
    return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    struct lw_error err = {0};
    struct lw_foreign_files files = {.format = LW_SCENE_FORMAT_STL, .path = "fuzz", .size = size};
    files.bytes = malloc(size + 1); /* exactly as large as the file, but for an empty one */
    if (!files.bytes) abort();
    if (size) memcpy(files.bytes, bytes, size);
    if (lw_foreign_text_mend(&files, &err) || files.size > size) abort();
    lw_foreign_files_finish(&files);
    return 0;
}
