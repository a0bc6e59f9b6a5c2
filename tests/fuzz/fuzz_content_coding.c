/* Accept-Encoding: any bytes. Input: a byte of which codings there are, then the header. */
#include "server/serve/web/content_coding.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (!size) return 0;
    char *text = malloc(size);
    if (!text) return 0;
    memcpy(text, data + 1, size - 1);
    text[size - 1] = '\0';
    const unsigned available = *data & 3u;
    const enum lw_content_coding coding = lw_content_coding_choose(text, available);
    /* a missing coding is never chosen */
    if (coding < LW_CONTENT_CODING_IDENTITY && !(available >> coding & 1)) abort();
    if (coding > LW_CONTENT_CODING_NONE) abort();
    free(text);
    return 0;
}
