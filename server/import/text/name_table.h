/* name_table.h: gives names numbers, in the order in which they come.
 * Threads: a table belongs to one thread. */
#ifndef LW_IMPORT_TEXT_NAME_TABLE_H
#define LW_IMPORT_TEXT_NAME_TABLE_H

#include "common/base/status.h"

#include <stdint.h>

#define LW_NAME_TABLE_NONE UINT32_MAX

struct lw_name_table {
    char **name;
    uint32_t count;
    size_t capacity;
    uint32_t *slot; /* numbers by hash, open addressing */
    size_t slot_count;
};

/** Zeros are an empty table. */
void lw_name_table_finish(struct lw_name_table *table);

/** The number of a name that is there, or LW_NAME_TABLE_NONE. */
uint32_t lw_name_table_find(const struct lw_name_table *table, const char *name);

/** The same; a name that is not there gets the next number. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_name_table_add(struct lw_name_table *table, const char *name,
                                               uint32_t *out_number, struct lw_error *err);

#endif
