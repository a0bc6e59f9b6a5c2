#include "tests/support/server_clock.h"

#include "tests/support/support.h"

#include <pthread.h>
#include <stdlib.h>
#include <time.h>
#include <uv.h>

#define TIMERS_MAX 8u

static _Atomic uint64_t stood_ns; /* where it stands; 0: it runs */
static _Atomic uint64_t ahead_ns; /* ahead of the real clock, or of where it stands */
static _Atomic uint64_t readings;
static pthread_mutex_t reading = PTHREAD_MUTEX_INITIALIZER;

int __real_clock_gettime(clockid_t id, struct timespec *out);
int __wrap_clock_gettime(clockid_t id, struct timespec *out);
int __real_uv_timer_start(uv_timer_t *timer, uv_timer_cb call, uint64_t timeout_ms, uint64_t repeat_ms);
int __wrap_uv_timer_start(uv_timer_t *timer, uv_timer_cb call, uint64_t timeout_ms, uint64_t repeat_ms);
int __real_uv_timer_stop(uv_timer_t *timer);
int __wrap_uv_timer_stop(uv_timer_t *timer);

static uint64_t real_ns(void) {
    struct timespec t;
    __real_clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

int __wrap_clock_gettime(clockid_t id, struct timespec *out) {
    if (id != CLOCK_MONOTONIC) return __real_clock_gettime(id, out);
    pthread_mutex_lock(&reading);
    const uint64_t now_ns = (stood_ns ? stood_ns : real_ns()) + ahead_ns;
    pthread_mutex_unlock(&reading);
    readings++;
    *out =
        (struct timespec){.tv_sec = (time_t)(now_ns / 1000000000u), .tv_nsec = (long)(now_ns % 1000000000u)};
    return 0;
}

void server_clock_stop(void) {
    if (!stood_ns) stood_ns = real_ns();
}

void server_clock_run(void) {
    pthread_mutex_lock(&reading); /* who reads between the two steps would see it go back */
    if (stood_ns) ahead_ns += stood_ns - real_ns();
    stood_ns = 0;
    pthread_mutex_unlock(&reading);
}

void server_clock_move(uint64_t ms) { ahead_ns += ms * 1000000u; }

/* ---- timers ---- */

static struct {
    uv_timer_t *timer; /* NULL: the place is free */
    uv_timer_cb call;
    uint64_t runs;
} timers[TIMERS_MAX];
static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t changed = PTHREAD_COND_INITIALIZER;

/* The place of a timer, or a free one for NULL; TIMERS_MAX: none. Under the mutex. */
static unsigned place_of(const uv_timer_t *timer) {
    unsigned i = 0;
    while (i < TIMERS_MAX && timers[i].timer != timer) i++;
    return i;
}

static void on_timer(uv_timer_t *timer) {
    pthread_mutex_lock(&mutex);
    const unsigned place = place_of(timer);
    const uv_timer_cb call = timers[place].call;
    pthread_mutex_unlock(&mutex);
    call(timer);
    pthread_mutex_lock(&mutex);
    timers[place].runs++;
    pthread_cond_broadcast(&changed);
    pthread_mutex_unlock(&mutex);
}

int __wrap_uv_timer_start(uv_timer_t *timer, uv_timer_cb call, uint64_t timeout_ms, uint64_t repeat_ms) {
    (void)timeout_ms, (void)repeat_ms;
    pthread_mutex_lock(&mutex);
    unsigned place = place_of(timer);
    if (place == TIMERS_MAX) place = place_of(NULL);
    if (place == TIMERS_MAX) abort(); /* no assertion: this is not the thread that cmocka knows */
    timers[place].timer = timer;
    timers[place].call = call;
    pthread_mutex_unlock(&mutex);
    return __real_uv_timer_start(timer, on_timer, 1, 1);
}

int __wrap_uv_timer_stop(uv_timer_t *timer) {
    pthread_mutex_lock(&mutex);
    const unsigned place = place_of(timer);
    if (place < TIMERS_MAX) timers[place].timer = NULL;
    pthread_cond_broadcast(&changed);
    pthread_mutex_unlock(&mutex);
    return __real_uv_timer_stop(timer);
}

bool server_clock_step(uint64_t ms) {
    bool any = false;
    server_clock_move(ms);
    pthread_mutex_lock(&mutex);
    for (unsigned i = 0; i < TIMERS_MAX; i++) {
        const uint64_t enough = timers[i].runs + 2; /* one may have begun before */
        any |= timers[i].timer != NULL;
        while (timers[i].timer && timers[i].runs < enough) pthread_cond_wait(&changed, &mutex);
    }
    pthread_mutex_unlock(&mutex);
    return any;
}

void server_clock_count(uint64_t *out_runs, uint64_t *out_readings) {
    pthread_mutex_lock(&mutex);
    *out_runs = 0;
    for (unsigned i = 0; i < TIMERS_MAX; i++) *out_runs += timers[i].runs;
    pthread_mutex_unlock(&mutex);
    *out_readings = readings;
}
