/* web_memory.c: memory of the WebAssembly module, in place of the C library's, which a page would load 11 kB
 * for. First fit over a list of free blocks by address; neighbours are merged.
 * Threads: one instance of the module per thread.
 * After:   Kernighan and Ritchie, The C Programming Language, 8.7. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define UNIT       64u /* bytes; what aligned_alloc() is asked for, at most */
#define PAGE       65536u
#define GROW_PAGES 16u

/* Ahead of what callers get. */
struct block {
    _Alignas(UNIT) size_t units; /* with this one */
    struct block *next;          /* only in a free block */
};
_Static_assert(sizeof(struct block) == UNIT, "units are counted in blocks");

static struct block *first;

static void give(struct block *block) {
    struct block *before = NULL, *next = first;
    for (; next && next < block; next = next->next) before = next;
    block->next = next;
    if (before)
        before->next = block;
    else
        first = block;
    if (next && block + block->units == next) {
        block->units += next->units;
        block->next = next->next;
    }
    if (before && before + before->units == block) {
        before->units += block->units;
        before->next = block->next;
    }
}

static struct block *take_free_block(size_t units) {
    for (struct block **at = &first; *at; at = &(*at)->next) {
        struct block *block = *at;
        if (block->units < units) continue;
        if (block->units == units) {
            *at = block->next;
            return block;
        }
        block->units -= units;
        block += block->units;
        block->units = units;
        return block;
    }
    return NULL;
}

static void *allocate(size_t size) {
    if (size > SIZE_MAX / 2) return NULL;
    const size_t units = (size + UNIT - 1) / UNIT + 1;
    struct block *block = take_free_block(units);
    if (block) return block + 1;
    const size_t needed = units / (PAGE / UNIT) + 1, pages = needed > GROW_PAGES ? needed : GROW_PAGES,
                 end = __builtin_wasm_memory_grow(0, pages);
    if (end == SIZE_MAX) return NULL;
    block = (struct block *)(end * PAGE);
    block->units = pages * (PAGE / UNIT);
    give(block);
    return take_free_block(units) + 1;
}

void *malloc(size_t size) { return allocate(size); }

void free(void *memory) {
    if (memory) give((struct block *)memory - 1);
}

void *calloc(size_t count, size_t size) {
    size_t bytes;
    void *memory = __builtin_mul_overflow(count, size, &bytes) ? NULL : allocate(bytes);
    return memory ? memset(memory, 0, bytes) : NULL;
}

/* alignment: at most UNIT */
void *aligned_alloc(size_t alignment, size_t size) {
    (void)alignment;
    return allocate(size);
}
