/* The mending of Collada, on any bytes: it makes a text of bounded size. */
#include "server/import/text/collada_text.h"

#include <stdlib.h>

#define GROWTH 8 /* <spot/> becomes fifty characters, and nothing grows by more */

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    struct lw_error err = {0};
    uint8_t *text = NULL;
    size_t text_size = 0;
    if (lw_collada_text_mend(bytes, size, &text, &text_size, &err)) abort();
    if (text_size > GROWTH * size) abort();
    free(text);
    return 0;
}
