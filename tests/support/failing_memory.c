#include "tests/support/failing_memory.h"

#include <limits.h>
#include <stdlib.h>

static _Atomic long left = LONG_MAX; /* before the first that fails */
static _Atomic bool all, failed;

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *memory, size_t size);
void *__real_aligned_alloc(size_t alignment, size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *memory, size_t size);
void *__wrap_aligned_alloc(size_t alignment, size_t size);

static bool fails(void) {
    if (left == LONG_MAX) return false;
    const long before = left--;
    if (before > 0 || (before < 0 && !all)) return false;
    failed = true;
    return true;
}

void *__wrap_malloc(size_t size) { return fails() ? NULL : __real_malloc(size); }
void *__wrap_calloc(size_t count, size_t size) { return fails() ? NULL : __real_calloc(count, size); }
void *__wrap_realloc(void *memory, size_t size) { return fails() ? NULL : __real_realloc(memory, size); }
void *__wrap_aligned_alloc(size_t alignment, size_t size) {
    return fails() ? NULL : __real_aligned_alloc(alignment, size);
}

static void begin(unsigned good, bool fails_on) {
    all = fails_on;
    failed = false;
    left = good;
}

void failing_memory_one(unsigned good) { begin(good, false); }
void failing_memory_all(unsigned good) { begin(good, true); }

bool failing_memory_end(void) {
    left = LONG_MAX;
    return failed;
}
