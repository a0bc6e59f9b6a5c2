/* import_probe.h: what code in lightwell-import could do that a broken scene smuggles in. Only the tests'
 * build of the program, import_probe, has it.
 * Threads: main() only. */
#ifndef LW_TESTS_IMPORT_PROBE_H
#define LW_TESTS_IMPORT_PROBE_H

#include <stdbool.h>

#define LW_IMPORT_PROBE_DESCRIPTOR 9 /* a descriptor that a test leaves open */

/** Tries each way out and says on stderr, a line each, whether it is open: "free WAY: open", or
 * "caged WAY: REASON". Beside the folder of the scene there is a file called secret, in it a link to that. */
void lw_import_probe(const char *scene, bool caged);

#endif
