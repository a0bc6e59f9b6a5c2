/* The reader of OBJ on any bytes: plain text that it reads again as the same text, or an error with a
 * text. */
#include "server/import/text/obj_text.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    struct lw_error err = {0};
    struct lw_obj_text first, again;
    if (lw_obj_text_read(&first, bytes, size, &err)) {
        if (!err.text[0]) abort();
    } else {
        if (lw_obj_text_read(&again, (const uint8_t *)first.text, first.size, &err)) abort();
        if (again.size != first.size || memcmp(again.text, first.text, first.size) != 0) abort();
        lw_obj_text_finish(&again);
    }
    lw_obj_text_finish(&first);
    return 0;
}
