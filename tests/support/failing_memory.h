/* failing_memory.h: allocations that fail at a moment of the test's choice. The test's line in CMakeLists.txt
 * has LIBS lw_test_failing_memory WRAP ${FAILING_MEMORY}; the linker then sends the calls of test and library
 * here, but none of a shared library. */
#ifndef LW_TESTS_FAILING_MEMORY_H
#define LW_TESTS_FAILING_MEMORY_H

#include <stdbool.h>

/** After `good` more allocations one fails. [any] */
void failing_memory_one(unsigned good);

/** After `good` more allocations all fail. [any] */
void failing_memory_all(unsigned good);

/** From here on none fails. Returns whether one has failed since the above. [any] */
bool failing_memory_end(void);

#endif
