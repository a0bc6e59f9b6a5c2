/* The reader of PLY headers on any bytes: a header that it reads again as the same header, or an error with a
 * text. */
#include "server/import/text/ply_header.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    struct lw_error err = {0};
    struct lw_ply_header first, again;
    if (lw_ply_header_read(&first, bytes, size, &err)) {
        if (!err.text[0]) abort();
    } else {
        if (first.body > size) abort();
        if (lw_ply_header_read(&again, (const uint8_t *)first.text, first.size, &err)) abort();
        if (again.size != first.size || memcmp(again.text, first.text, first.size) != 0) abort();
        lw_ply_header_finish(&again);
    }
    lw_ply_header_finish(&first);
    return 0;
}
