#include "common/trace/trace_replay.h"

#include "common/base/clock.h"
#include "common/trace/trace_context.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* Packets between two looks at the clock, 190 kB: they stay in the second-level cache, with room for the
 * scene. */
#define CHUNK 128u

struct packet {
    struct RTCRayHit16 rays; /* for an occlusion query the rays alone; 64-byte aligned */
    _Alignas(64) int valid[16];
    struct lw_trace_context context;
    RTCScene scene;
    bool closest;
};

struct lw_trace_replay {
    struct packet *packet;
    size_t count, capacity;
    struct packet chunk[CHUNK]; /* Embree writes into its packets: these are traced */
};

static _Thread_local struct lw_trace_replay *recording;

enum lw_status lw_trace_replay_create(size_t packets, struct lw_trace_replay **out_replay) {
    struct lw_trace_replay *replay = aligned_alloc(_Alignof(struct packet), sizeof *replay);
    if (!replay) return LW_NO_MEMORY;
    replay->packet = aligned_alloc(_Alignof(struct packet), (packets ? packets : 1) * sizeof *replay->packet);
    replay->count = 0;
    replay->capacity = packets;
    if (!replay->packet) {
        free(replay);
        return LW_NO_MEMORY;
    }
    *out_replay = replay;
    return LW_OK;
}

void lw_trace_replay_destroy(struct lw_trace_replay *replay) {
    if (!replay) return;
    free(replay->packet);
    free(replay);
}

void lw_trace_replay_clear(struct lw_trace_replay *replay) { replay->count = 0; }

void lw_trace_replay_record(struct lw_trace_replay *replay) { recording = replay; }

static void record(const int valid[16], RTCScene scene, const struct RTCIntersectContext *context,
                   const void *rays, size_t rays_size, bool closest) {
    if (!recording || recording->count == recording->capacity) return;
    struct packet *packet = &recording->packet[recording->count++];
    memcpy(&packet->rays, rays, rays_size);
    memcpy(packet->valid, valid, sizeof packet->valid);
    packet->context = *(const struct lw_trace_context *)context;
    packet->scene = scene;
    packet->closest = closest;
}

/* The linker turns trace.c's calls into __wrap_, and __real_ into Embree's own. */
void __real_rtcIntersect16(const int *valid, RTCScene scene, struct RTCIntersectContext *context,
                           struct RTCRayHit16 *rays);
void __wrap_rtcIntersect16(const int *valid, RTCScene scene, struct RTCIntersectContext *context,
                           struct RTCRayHit16 *rays);
void __real_rtcOccluded16(const int *valid, RTCScene scene, struct RTCIntersectContext *context,
                          struct RTCRay16 *rays);
void __wrap_rtcOccluded16(const int *valid, RTCScene scene, struct RTCIntersectContext *context,
                          struct RTCRay16 *rays);

void __wrap_rtcIntersect16(const int *valid, RTCScene scene, struct RTCIntersectContext *context,
                           struct RTCRayHit16 *rays) {
    record(valid, scene, context, rays, sizeof *rays, true);
    __real_rtcIntersect16(valid, scene, context, rays);
}

void __wrap_rtcOccluded16(const int *valid, RTCScene scene, struct RTCIntersectContext *context,
                          struct RTCRay16 *rays) {
    record(valid, scene, context, rays, sizeof *rays, false);
    __real_rtcOccluded16(valid, scene, context, rays);
}

void lw_trace_replay_run(struct lw_trace_replay *replay, struct lw_trace_replay_cost *cost) {
    struct packet *chunk = replay->chunk;
    for (size_t first = 0; first < replay->count; first += CHUNK) {
        const size_t count = replay->count - first < CHUNK ? replay->count - first : CHUNK;
        memcpy(chunk, replay->packet + first, count * sizeof *chunk);
        const uint64_t began_ns = lw_clock_thread_cpu_ns();
        for (size_t i = 0; i < count; i++) {
            struct packet *p = &chunk[i];
            if (p->closest)
                __real_rtcIntersect16(p->valid, p->scene, &p->context.rtc, &p->rays);
            else
                __real_rtcOccluded16(p->valid, p->scene, &p->context.rtc, &p->rays.ray);
        }
        cost->cpu_ns += lw_clock_thread_cpu_ns() - began_ns;
        for (size_t i = 0; i < count; i++)
            for (int lane = 0; lane < 16; lane++) cost->rays += chunk[i].valid[lane] != 0;
        cost->packets += count;
    }
}
