#include "tests/support/glb.h"

#include <stdlib.h>
#include <string.h>

void lw_glb_put_word(uint8_t *at, size_t value) {
    for (int i = 0; i < 4; i++) at[i] = (uint8_t)(value >> 8 * i);
}

uint8_t *lw_glb_pack(const char *json, const void *data, size_t data_size, size_t *out_size) {
    size_t json_size = (strlen(json) + 3) / 4 * 4, binary_size = (data_size + 3) / 4 * 4;
    *out_size = 12 + 8 + json_size + 8 + binary_size;
    uint8_t *bytes = calloc(*out_size, 1);
    memcpy(bytes, "glTF", 4);
    lw_glb_put_word(bytes + 4, 2);
    lw_glb_put_word(bytes + 8, *out_size);
    lw_glb_put_word(bytes + 12, json_size);
    memcpy(bytes + 16, "JSON", 4);
    memset(bytes + 20, ' ', json_size);
    for (size_t i = 0; json[i]; i++) bytes[20 + i] = (uint8_t)(json[i] == '\'' ? '"' : json[i]);
    lw_glb_put_word(bytes + 20 + json_size, binary_size);
    memcpy(bytes + 24 + json_size, "BIN", 4);
    memcpy(bytes + 28 + json_size, data, data_size);
    return bytes;
}
