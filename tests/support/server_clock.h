/* server_clock.h: the clock of a server in a thread of the test. While it stands, time is what the test says:
 * no time-out of the server strikes because the machine is busy, and none is waited for. The test's line in
 * CMakeLists.txt has LIBS lw_test_server_clock WRAP clock_gettime uv_timer_start uv_timer_stop. The server's
 * timers then run each millisecond, whatever their period. */
#ifndef LW_TESTS_SERVER_CLOCK_H
#define LW_TESTS_SERVER_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

/** From here on it stands. [test] */
void server_clock_stop(void);

/** From here on it goes, beginning where it stood. [test] */
void server_clock_run(void);

/** Moves it on. [any] */
void server_clock_move(uint64_t ms);

/** Moves it on, and returns when each of the server's timers has begun and ended a run after that. Returns
 * false if no timer runs, as while a server has no connection. [test] */
bool server_clock_step(uint64_t ms);

/** Counts of the server's timers that have run, and of readings of the clock. [any] */
void server_clock_count(uint64_t *out_runs, uint64_t *out_readings);

#endif
