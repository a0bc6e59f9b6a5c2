/* movers_truth.h: the light of a scene while an object, the mover, stands at A and at B; which texels and
 * blocks it changes; how far off another light is.
 * Flow:    solves that never converge -> [movers_truth] -> bench_movers
 * Threads: main() only. */
#ifndef LW_TESTS_MOVERS_TRUTH_H
#define LW_TESTS_MOVERS_TRUTH_H

#include "server/solve/cell_frame.h"
#include "tests/bench/bench_setup.h"

#define MOVERS_SEEDS 2u /* everything is measured by each */

enum { A, B, MOVERS_PLACES };
/* Of texels and blocks; bits. */
enum part { MOVER = 1, STILL = 2, STILL_CHANGED = 4, STILL_SLIGHTLY = 8 };

struct movers_settings {
    struct lw_scene_open open;
    const char *object;
    double shift, error;
    int64_t rays, frames, reference_frames;
    bool away;
};

struct movers_cost {
    double cpu_s;
    uint64_t rays;
};

/* What rays from the mover have met of a block. */
struct movers_sight {
    uint32_t first, hits; /* first: the number of a texel's ray, from 1; 0: none */
};

/* Its arrays belong to the scene. */
struct movers {
    const struct movers_settings *settings;
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose[MOVERS_PLACES];
    uint32_t mover;
    struct lw_cell_solver *solver[MOVERS_SEEDS]; /* of A */
    struct lw_probes probes[MOVERS_SEEDS];
    struct movers_cost filling;                /* of one set of probes */
    uint32_t count, *texel;                    /* covered ones: in the global numbering */
    uint32_t first, end;                       /* of these, the mover's */
    uint32_t block_count, *block;              /* of each texel */
    uint8_t *part, *part_of;                   /* of texels; of blocks */
    float *truth[MOVERS_PLACES][MOVERS_SEEDS]; /* three values a texel */
    float *direct[MOVERS_SEEDS];               /* of that, the direct light of B */
    float *sent[MOVERS_SEEDS];                 /* what texels send out of it: radiance[0] of tiles.h */
    double epsilon;
    float *shown[MOVERS_SEEDS];  /* what a way makes of the truth of B */
    uint8_t *told[MOVERS_SEEDS]; /* blocks, by a way */
    struct movers_sight *sight[MOVERS_PLACES][MOVERS_SEEDS];
};

/* relMSE of what is shown over texels of a part. */
struct movers_error {
    double plain, clean; /* clean: without noise */
    uint32_t count;
};

/** Zeroed memory that lives as long as the scene; NULL: there is none. */
void *movers_truth_take(const struct movers *m, size_t count, size_t size);

/** A solver as bench_light_desc() has it, at a place. */
LW_MUST_CHECK enum lw_status movers_truth_create(const struct movers *m, int place, double error,
                                                 uint32_t seed, struct lw_cell_solver **out,
                                                 struct lw_error *err);
/** NULL is fine. */
void movers_truth_destroy(struct lw_cell_solver *s);

/** Solves until nothing has been solved for some frames; at B it goes on from A.
 * frames  at most; the same for A and B
 * cost    to which it is added
 * solved  per block: set where it has been; or NULL */
LW_MUST_CHECK enum lw_status movers_truth_go_on(const struct movers *m, struct lw_cell_solver *s, int place,
                                                int64_t frames, struct movers_cost *cost, uint8_t *solved,
                                                struct lw_error *err);

/** All light and direct light of the texels, as movers_truth_take() has memory. A texel that is not covered
 * there no longer belongs to a part. */
LW_MUST_CHECK enum lw_status movers_truth_read(const struct movers *m, const struct lw_cell_solver *s,
                                               float **out_all, float **out_direct, struct lw_error *err);

/** Solves both places by each seed, and finds what changes. */
LW_MUST_CHECK enum lw_status movers_truth_find(struct movers *m, struct lw_error *err);

/** Of texel i. */
double movers_truth_luminance(const struct movers *m, int place, uint32_t seed, uint32_t i);

/** Of what is shown, over the texels of a part. */
struct movers_error movers_truth_error(const struct movers *m, unsigned part);

#endif
