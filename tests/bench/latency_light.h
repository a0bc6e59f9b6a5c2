/* latency_light.h: the references of bench_latency: converged light before and after a change, and the
 * progress of other light between them.
 * Flow:    scene, camera -> introduce, look from -> [states -> fresh servers or kept files -> pair] -> judge
 *          -> p, error of a client's light
 * Threads: main() only. A failure ends the program with its reason.
 *
 * Light is read at level LW_ATLAS_READ_MAX, or at the coarsest level of objects that have fewer:
 * LATENCY_CHANNELS values per texel, object by object. It is judged in squares of 4 x 4 texels: d is the sum
 * of the values in brackets over the square's texels that the picture shows, each times w: one over the
 * texel's mean light before and after (plus the median's of all, in the square). Light over twice that light
 * is clipped. */
#ifndef LW_TESTS_BENCH_LATENCY_LIGHT_H
#define LW_TESTS_BENCH_LATENCY_LIGHT_H

#include "tests/support/process.h"

#include "client/camera/camera.h"
#include "client/lib/client.h"

#include <jansson.h>

#define LATENCY_CHANNELS    3u
#define LATENCY_POLL_MS     100u
#define LATENCY_LIMIT_NS    240000000000ull /* for the light to converge */
#define LATENCY_PATIENCE_NS 120000000000ull /* for the scene, for the first light, for an answer */

/* Zeroed but for the settings, then introduced, used and finished. */
struct latency_light {
    /* settings */
    const char *scene, *daemon_options;
    const char *reference; /* a folder for fresh light; NULL: one for this run */
    int64_t fresh_frames;
    /* the scene's */
    struct lw_client *introduced; /* by a server that has ended: has the scene */
    char folder[128];             /* for this run */
    struct lw_camera_view camera;
    struct lw_atlas_map map;
    size_t texel_count;
    size_t *first;    /* texel of each object */
    uint32_t *square; /* the square of each texel */
    size_t square_count;
    uint8_t *wanted; /* per tile: by the pictures of all states so far */
    /* the reference pair's */
    const struct latency_pair *pair;
    double agreement;             /* cosine of E1 - E0 and E1' - E0' */
    double *change[2], *progress; /* E1 - E0, E1' - E0', a client's E - E0: d of them */
    float *weight, *most;         /* w, 0 where nothing is shown; upper bound of light */
};

/* A state of the scene. */
struct latency_state {
    const char *text;                     /* identifies it, with the camera */
    double time_s;                        /* time of the held animation; `text` has it where it is not 0 */
    const struct lw_scene_change *change; /* change that leads to it; NULL: none */
    bool undone;                          /* made and taken back */
};

/* Light on both sides of a change, by two seeds: E0 and E0', E1 and E1'. */
struct latency_pair {
    float *before[2], *after[2];
    uint8_t *shown; /* per texel: in a picture of either state */
};

void latency_must(enum lw_status status, struct lw_error *err);
_Noreturn void latency_give_up(const char *what);
/** A number of JSON; null where it is not finite. */
json_t *latency_real(double x);
/** Prints an object on stdout and gives it back. NULL ends the program: there was no memory for it. */
void latency_print(json_t *object);
/** calloc() that never fails. */
void *latency_room(size_t count, size_t size);

/** Hears of the scene from a server that nothing is wanted of. */
void latency_light_introduce(struct latency_light *l);
void latency_light_finish(struct latency_light *l);
const struct lw_scene *latency_light_scene(const struct latency_light *l);
/** The level that an object's light is read at. */
uint32_t latency_light_level(const struct latency_light *l, uint32_t object);
/** Looks from a camera of the scene, where the pose has it, or from a place as --camera of lightwell-view has
 * it. Returns whether the animation moves that camera. */
bool latency_light_look_from(struct latency_light *l, const struct lw_pose *pose, const char *camera);

/** Starts a server of the scene with --daemon's options behind these. */
void latency_light_serve(const struct latency_light *l, const char *options, struct lw_process *out_server);
/** Starts one, and a client of it that has its first light, and from then on wants what the pictures of all
 * states so far take. */
void latency_light_watch(const struct latency_light *l, const char *options, struct lw_process *out_server,
                         struct lw_client **out_client);
void latency_light_poll(struct lw_client *client, unsigned ms, struct lw_client_stats *out_stats);
void latency_light_read(const struct latency_light *l, const struct lw_client *client, float *out);

/** Gets the light of both states from the folder, or else from two servers that solve it. */
void latency_light_solve(struct latency_light *l, const struct latency_state *before,
                         const struct latency_state *after, struct latency_pair *out_pair);
void latency_pair_finish(struct latency_pair *pair);

/** Judges by a pair, which must stay, from now on. */
void latency_light_judge(struct latency_light *l, const struct latency_pair *pair);
/** p(E) = sum d(E - E0) d(E1' - E0') / sum d(E1 - E0) d(E1' - E0'): 0 for light as before, 1 for light as
 * after. */
double latency_light_share(struct latency_light *l, const float *light);
/** d(E - E1), or by the other seed d(E - E1'): LATENCY_CHANNELS values per square. */
void latency_light_residual(const struct latency_light *l, const float *light, unsigned seed, double *out);
/** The sum of the products of two residuals, relative to sum d(E1 - E0) d(E1' - E0'). One light by both
 * seeds: its mean squared error, 1 for light as before, 0 for light as after, and the seeds' noise is not in
 * it. Two lights whose noise differs: their noise is not in it either. */
double latency_light_error(const struct latency_light *l, const double *residual, const double *other);

#endif
