/* The reader of material libraries on any bytes: materials of different names, or an error with a text. */
#include "server/import/text/mtl_file.h"

#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    struct lw_error err = {0};
    struct lw_mtl_file mtl;
    if (lw_mtl_file_read(&mtl, bytes, size, &err) && !err.text[0]) abort();
    for (uint32_t i = 0; i < mtl.name.count; i++) {
        if (lw_name_table_find(&mtl.name, mtl.name.name[i]) != i) abort();
        for (int m = 0; m < LW_MTL_MAPS; m++)
            if (mtl.material[i].map[m].path && !mtl.material[i].map[m].path[0]) abort();
    }
    lw_mtl_file_finish(&mtl);
    return 0;
}
