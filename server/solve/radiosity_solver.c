#include "server/solve/radiosity_solver.h"

#include "common/base/invariant.h"
#include "common/base/log.h"
#include "common/light/client_lights.h"
#include "server/solve/combinations.h"
#include "server/solve/patch_solver.h"
#include "server/solve/radiosity/radiosity_directions.h"
#include "server/solve/radiosity/radiosity_pass.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* By which a frame turns the directions of the one before, radians: no two frames have the same. */
#define GOLDEN_ANGLE 2.39996323f
#define WINDOW_MAX   LW_TILE_SIDE /* a window lies in one tile */

#define RADIANCE_FLOATS 3u /* a texel */

struct radiosity_solver {
    struct lw_patch_solver patch;
    struct lw_shooters shooters;
    struct lw_radiosity_directions directions;
    float *radiance;                      /* what texels reflect, 3 floats each, W/(m^2 sr) */
    struct lw_pair_visibility visibility; /* for patches and shooters as they were placed last */
    uint8_t visibility_key[16];
    bool visibility_saved;
};

enum lw_status lw_radiosity_solver_check(const struct lw_solver_desc *desc, struct lw_error *err) {
    enum lw_status status = lw_combinations_check(LW_CHOICE_RADIOSITY | lw_combinations_of(desc), err);
    if (status != LW_OK) return status;
    const struct lw_radiosity_terms *terms = &desc->radiosity;
    if (terms->window > WINDOW_MAX)
        return lw_status_fail(err, LW_USAGE, "a window of radiosity has at most %u texels a side",
                              WINDOW_MAX);
    if (terms->directions > LW_RADIOSITY_DIRECTIONS_MAX)
        return lw_status_fail(err, LW_USAGE, "radiosity has at most %u directions",
                              LW_RADIOSITY_DIRECTIONS_MAX);
    if (terms->window && terms->undersample == LW_UNDERSAMPLE_NONE)
        return lw_status_fail(err, LW_USAGE, "a window of radiosity (--window) needs --undersample");
    return LW_OK;
}

/* ---- a frame ---- */

static uint64_t pass(struct radiosity_solver *s, uint32_t order, const float *radiance) {
    struct lw_patch_solver *p = &s->patch;
    const uint32_t salt = p->frames * (p->desc.bounces + 1) + order;
    const struct lw_wall_sides sides = lw_geometry_sides(&p->geometry);
    if (s->directions.count)
        return lw_radiosity_directions_run(
            &(struct lw_radiosity_gather){.patches = &p->patches,
                                          .directions = &s->directions,
                                          .sides = &sides,
                                          .radiance = radiance,
                                          .stride = RADIANCE_FLOATS,
                                          .turn = GOLDEN_ANGLE * (float)p->frames,
                                          .salt = salt * LW_RADIOSITY_DIRECTIONS_MAX,
                                          .cancel = p->desc.cancel,
                                          .progress = &p->progress,
                                          .threads = p->threads},
            p->arrived);
    if (p->desc.radiosity.subdivide > 0) {
        /* Lamps keep their texels: a lamp of one point casts hard shadows, and there are few of them. */
        lw_shooters_subdivide(&s->shooters, order ? p->desc.radiosity.subdivide : 0, radiance,
                              RADIANCE_FLOATS);
        lw_log(LW_LOG_DEBUG, "radiosity: bounce %u: %u shooters", order, s->shooters.count);
    } else {
        lw_shooters_charge(&s->shooters, radiance, RADIANCE_FLOATS, p->threads);
    }
    return lw_radiosity_pass_run(
        &(struct lw_radiosity_pass){.patches = &p->patches,
                                    .shooters = &s->shooters,
                                    .trace = p->geometry.trace,
                                    .salt = salt,
                                    .visibility = s->visibility.mask ? &s->visibility : NULL,
                                    .cancel = p->desc.cancel,
                                    .progress = &p->progress,
                                    .threads = p->threads},
        p->arrived);
}

static bool surfaces_shoot(const struct lw_patch_solver *p) { return !p->desc.radiosity.directions; }

static bool shoots_emission(const struct lw_patch_solver *p) {
    return p->patches.emission && surfaces_shoot(p);
}

static uint64_t steps(const struct lw_patch_solver *p) {
    return (uint64_t)p->patches.packet_count * (p->desc.bounces + shoots_emission(p));
}

/* Emission first, then bounce by bounce. */
static uint64_t shoot(struct lw_patch_solver *p) {
    struct radiosity_solver *s = (struct radiosity_solver *)p;
    float *const *const indirect = p->frame_bounces;
    uint64_t rays = 0;
    if (!p->frames && s->directions.count)
        lw_log(LW_LOG_INFO, "radiosity: %u patches, %u directions", p->patches.count, s->directions.count);
    else if (!p->frames)
        lw_log(LW_LOG_INFO, "radiosity: %u patches, %u shooters: %.3g pairs a bounce", p->patches.count,
               s->shooters.count, (double)p->patches.count * (double)s->shooters.count);
    if (shoots_emission(p)) {
        rays += pass(s, 0, p->patches.emission[0]);
        lw_patch_solver_add(p, p->frame_direct, p->arrived);
    }
    for (int c = 0; c < 3; c++) memset(indirect[c], 0, p->tiles.texel_count * sizeof(float));
    LW_INVARIANT(!s->visibility.mask || s->visibility.packets == p->patches.packet_count);
    for (uint32_t order = 1; order <= p->desc.bounces && !lw_patch_solver_cancelled(p); order++) {
        lw_patch_solver_reflect(p, order == 1 ? p->frame_direct : p->arrived, s->radiance);
        rays += pass(s, order, s->radiance);
        lw_patch_solver_add(p, indirect, p->arrived);
    }
    return rays;
}

/* With bits for each pair, patches stay where they are from frame to frame. */
static enum lw_status place_patches(struct lw_patch_solver *p, struct lw_error *err) {
    struct radiosity_solver *s = (struct radiosity_solver *)p;
    const struct lw_radiosity_terms *terms = &p->desc.radiosity;
    uint8_t key[16];
    lw_patches_place(&p->patches, &p->pose, terms->keeps_visibility ? 0 : p->frames, p->threads);
    if (s->directions.count) return LW_OK;
    lw_shooters_place(&s->shooters, p->desc.seed, terms->keeps_visibility ? 0 : p->frames);
    if (!terms->keeps_visibility || (s->visibility.mask && p->frames)) return LW_OK;
    lw_pair_visibility_key(&p->patches, &s->shooters, &p->pose, key);
    if (s->visibility.mask && memcmp(key, s->visibility_key, sizeof key) == 0) return LW_OK;
    memcpy(s->visibility_key, key, sizeof key);
    lw_pair_visibility_finish(&s->visibility);
    s->visibility_saved = false;
    enum lw_status status =
        lw_pair_visibility_init(&s->visibility, p->patches.packet_count, s->shooters.count, err);
    if (status != LW_OK) return status;
    lw_log(LW_LOG_INFO, "radiosity: the visibility of all pairs takes %.3g MiB",
           (double)lw_pair_visibility_bytes(&s->visibility) / (1 << 20));
    if (!terms->visibility_path || access(terms->visibility_path, F_OK) != 0) return LW_OK;
    return lw_pair_visibility_load(&s->visibility, terms->visibility_path, key, err);
}

/* Light is not thrown away because a disk is full. */
static void save_visibility(struct lw_patch_solver *p, uint64_t rays) {
    struct radiosity_solver *s = (struct radiosity_solver *)p;
    struct lw_error err = {0};
    const char *path = p->desc.radiosity.visibility_path;
    if (!rays || !path || s->visibility_saved) return;
    if (lw_pair_visibility_save(&s->visibility, path, s->visibility_key, &err) != LW_OK)
        lw_log(LW_LOG_WARNING, "the visibility is not saved: %s", err.text);
    s->visibility_saved = true;
}

/* ---- the method ---- */

static enum lw_status init(struct lw_patch_solver *p, struct lw_error *err) {
    struct radiosity_solver *s = (struct radiosity_solver *)p;
    const struct lw_radiosity_terms *terms = &p->desc.radiosity;
    enum lw_status status = lw_radiosity_directions_init(&s->directions, terms->directions);
    s->radiance = malloc((p->geometry.texels.count + 1ul) * RADIANCE_FLOATS * sizeof *s->radiance);
    if (!s->radiance) status = LW_NO_MEMORY;
    if (status == LW_OK && !terms->directions)
        status = lw_shooters_init(&s->shooters, &p->patches, terms->undersample, terms->window);
    if (status != LW_OK) return lw_status_fail(err, status, "%u texels", p->geometry.texels.count);
    return terms->keeps_visibility && lw_trace_tints(p->geometry.trace)
               ? lw_status_fail(err, LW_USAGE,
                                "--keep-visibility holds bits, and the scene has surfaces that tint light")
               : LW_OK;
}

static void finish_shooters(struct lw_patch_solver *p) {
    struct radiosity_solver *s = (struct radiosity_solver *)p;
    lw_shooters_finish(&s->shooters);
    lw_pair_visibility_finish(&s->visibility);
    lw_radiosity_directions_finish(&s->directions);
    free(s->radiance);
}

static size_t memory_bytes(const struct lw_patch_solver *p) {
    const struct radiosity_solver *s = (const struct radiosity_solver *)p;
    return (s->shooters.patches ? lw_shooters_memory_bytes(&s->shooters) : 0) +
           lw_pair_visibility_bytes(&s->visibility) +
           p->geometry.texels.count * RADIANCE_FLOATS * sizeof *s->radiance;
}

static const struct lw_patch_solver_method method = {.name = "radiosity",
                                                     .direct_samples = LW_RADIOSITY_SOLVER_DIRECT,
                                                     .frames_min = LW_RADIOSITY_SOLVER_FRAMES_MIN,
                                                     .surfaces_shoot = surfaces_shoot,
                                                     .steps = steps,
                                                     .init = init,
                                                     .finish = finish_shooters,
                                                     .place = place_patches,
                                                     .bounces = shoot,
                                                     .keep = save_visibility,
                                                     .memory_bytes = memory_bytes};

enum lw_status lw_radiosity_solver_create(const struct lw_solver_desc *desc, const struct lw_pose *pose,
                                          struct lw_solver **out_solver, struct lw_error *err) {
    enum lw_status status = lw_radiosity_solver_check(desc, err);
    if (status != LW_OK) return status;
    struct radiosity_solver *s = calloc(1, sizeof *s);
    if (!s) return lw_status_fail(err, LW_NO_MEMORY, "solver");
    return lw_patch_solver_create(&s->patch, &method, desc, pose, out_solver, err);
}
