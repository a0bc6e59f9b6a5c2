#include "server/import/text/name_table.h"

#include "server/import/mesh/mesh_builder.h"

#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#define SLOTS_MIN 64u

void lw_name_table_finish(struct lw_name_table *table) {
    for (uint32_t i = 0; i < table->count; i++) free(table->name[i]);
    free(table->name);
    free(table->slot);
    *table = (struct lw_name_table){0};
}

/* Where the name is, or would be. There is always a free slot. */
static size_t slot_of(const struct lw_name_table *table, const char *name) {
    const size_t mask = table->slot_count - 1;
    size_t slot = XXH3_64bits(name, strlen(name)) & mask;
    while (table->slot[slot] != LW_NAME_TABLE_NONE && strcmp(table->name[table->slot[slot]], name) != 0)
        slot = (slot + 1) & mask;
    return slot;
}

uint32_t lw_name_table_find(const struct lw_name_table *table, const char *name) {
    return table->slot_count ? table->slot[slot_of(table, name)] : LW_NAME_TABLE_NONE;
}

static bool grow(struct lw_name_table *table) {
    const size_t count = table->slot_count ? 2 * table->slot_count : SLOTS_MIN;
    uint32_t *slot = malloc(count * sizeof *slot);
    if (!slot) return false;
    memset(slot, 0xff, count * sizeof *slot);
    free(table->slot);
    table->slot = slot;
    table->slot_count = count;
    for (uint32_t i = 0; i < table->count; i++) slot[slot_of(table, table->name[i])] = i;
    return true;
}

enum lw_status lw_name_table_add(struct lw_name_table *table, const char *name, uint32_t *out_number,
                                 struct lw_error *err) {
    if (2 * (table->count + 1ul) > table->slot_count && !grow(table))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for names");
    const size_t slot = slot_of(table, name);
    if (table->slot[slot] == LW_NAME_TABLE_NONE) {
        char *own = strdup(name);
        if (!own || !lw_mesh_builder_reserve((void **)&table->name, &table->capacity, table->count + 1ul,
                                             sizeof *table->name)) {
            free(own);
            return lw_status_fail(err, LW_NO_MEMORY, "out of memory for names");
        }
        table->name[table->count] = own;
        table->slot[slot] = table->count++;
    }
    *out_number = table->slot[slot];
    return LW_OK;
}
