#include "server/solve/vpl_solver.h"

#include "common/base/invariant.h"
#include "common/base/log.h"
#include "server/solve/combinations.h"
#include "server/solve/patch_solver.h"
#include "server/solve/radiosity/radiosity_pass.h"
#include "server/solve/radiosity/virtual_lights.h"

#include <stdlib.h>
#include <string.h>

/* As the cell solver: sets differ as samples do. */
#define FRAMES_MIN LW_SOLVER_FRAMES_MIN

struct vpl_solver {
    struct lw_patch_solver patch;
    struct lw_virtual_lights lights;
    uint32_t placed; /* turn at which the patches are, and one more */
    bool moved;      /* something has, since the lights were checked */
};

enum lw_status lw_vpl_solver_check(const struct lw_solver_desc *desc, struct lw_error *err) {
    const struct lw_vpl_terms *terms = &desc->vpl;
    enum lw_status status = lw_combinations_check(LW_CHOICE_VPL | lw_combinations_of(desc), err);
    if (status != LW_OK) return status;
    if (terms->lights > LW_VPL_LIGHTS_MAX)
        return lw_status_fail(err, LW_USAGE, "there are at most %u virtual point lights (--vpl-lights)",
                              LW_VPL_LIGHTS_MAX);
    if (terms->sets > LW_VPL_SETS_MAX)
        return lw_status_fail(err, LW_USAGE, "there are at most %u sets of them (--vpl-sets)",
                              LW_VPL_SETS_MAX);
    const uint32_t lights = terms->lights ? terms->lights : LW_VPL_LIGHTS_DEFAULT,
                   least = (terms->sets ? terms->sets : LW_VPL_SETS_DEFAULT) *
                           (desc->bounces ? desc->bounces : 1);
    if (lights < least)
        return lw_status_fail(err, LW_USAGE,
                              "--vpl-lights %u: with these --vpl-sets and --bounces there are %u at least",
                              lights, least);
    return LW_OK;
}

static uint32_t sets_of(const struct lw_patch_solver *p) {
    return p->desc.vpl.sets ? p->desc.vpl.sets : LW_VPL_SETS_DEFAULT;
}

static uint64_t steps(const struct lw_patch_solver *p) {
    return p->desc.bounces ? p->patches.packet_count : 0;
}

static enum lw_status init(struct lw_patch_solver *p, struct lw_error *err) {
    struct vpl_solver *s = (struct vpl_solver *)p;
    const uint32_t lights = p->desc.vpl.lights ? p->desc.vpl.lights : LW_VPL_LIGHTS_DEFAULT;
    enum lw_status status =
        lw_virtual_lights_init(&s->lights, &p->patches, lights, p->desc.bounces, sets_of(p));
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "%u virtual point lights", lights);
}

static void finish_lights(struct lw_patch_solver *p) {
    lw_virtual_lights_finish(&((struct vpl_solver *)p)->lights);
}

static void leave(struct lw_patch_solver *p, const struct lw_pose *next) {
    struct vpl_solver *s = (struct vpl_solver *)p;
    lw_virtual_lights_leave(&s->lights, &p->pose, next);
    s->moved = true;
    s->placed = 0;
}

/* All sets of a round meet the same places, so that they add up. */
static enum lw_status place_patches(struct lw_patch_solver *p, struct lw_error *err) {
    struct vpl_solver *s = (struct vpl_solver *)p;
    const uint32_t turn = p->frames / sets_of(p);
    (void)err;
    if (s->placed != turn + 1) lw_patches_place(&p->patches, &p->pose, turn, p->threads);
    s->placed = turn + 1;
    return LW_OK;
}

static float near_by_area(const struct vpl_solver *s) {
    const struct lw_patches *patches = &s->patch.patches;
    double area = 0;
    for (uint32_t p = 0; p < patches->packet_count; p++)
        for (int i = 0; i < LW_TRACE_WIDTH && patches->packet[p].active >> i & 1; i++)
            area += (double)patches->area_m2[patches->packet[p].texel[i]];
    return lw_virtual_paths_near_m(&s->lights.paths, area);
}

static float largest_m(const struct lw_patch_solver *p) {
    struct lw_vec3 lo = {0}, hi = {0};
    lw_pose_bounds(&p->pose, p->desc.scene, &lo, &hi);
    return fmaxf(lw_vec3_max_abs(lo), lw_vec3_max_abs(hi));
}

static uint32_t most_of(const struct lw_patch_solver *p) {
    const struct lw_virtual_lights *lights = &((const struct vpl_solver *)p)->lights;
    return p->desc.vpl.reshoot == UINT32_MAX ? 0
           : p->desc.vpl.reshoot             ? p->desc.vpl.reshoot
                                             : lw_virtual_paths_set_count(&lights->paths);
}

static uint64_t bounces(struct lw_patch_solver *p) {
    struct vpl_solver *s = (struct vpl_solver *)p;
    float *const *const indirect = p->frame_bounces;
    const uint32_t sets = sets_of(p), set = p->frames % sets;
    for (int c = 0; c < 3; c++) memset(indirect[c], 0, p->tiles.texel_count * sizeof(float));
    if (!s->lights.paths.paths) return 0;
    if (!p->frames) s->lights.paths.turn.next = 0; /* each set is shot again just before its turn */
    uint64_t rays =
        lw_virtual_lights_shoot(&s->lights, &(struct lw_virtual_lights_shot){.trace = p->geometry.trace,
                                                                             .lamps = &p->emitters,
                                                                             .direct = p->frame_direct,
                                                                             .largest_m = largest_m(p),
                                                                             .seed = p->desc.seed,
                                                                             .salt = p->frames,
                                                                             .checks = s->moved,
                                                                             .rotates = p->frames >= sets,
                                                                             .most = most_of(p)});
    s->moved = false;
    const float near_m = p->desc.vpl.near_m > 0 ? p->desc.vpl.near_m : near_by_area(s);
    if (!p->frames)
        lw_log(LW_LOG_INFO,
               "vpl: %u patches, %u lights in %u sets, as bright as at %.3g m where they are nearer",
               p->patches.count, s->lights.paths.paths * s->lights.paths.bounces, sets, (double)near_m);
    const struct lw_shooters shooters = lw_virtual_lights_set(&s->lights, set);
    LW_INVARIANT(shooters.count * sets ==
                 s->lights.paths.paths * s->lights.paths.bounces); /* in all sets, all */
    rays += lw_radiosity_pass_run(&(struct lw_radiosity_pass){.patches = &p->patches,
                                                              .shooters = &shooters,
                                                              .trace = p->geometry.trace,
                                                              .salt = p->frames,
                                                              .near_m2 = near_m * near_m,
                                                              .cancel = p->desc.cancel,
                                                              .progress = &p->progress,
                                                              .threads = p->threads},
                                  p->arrived);
#pragma omp parallel for schedule(static) num_threads(p->threads)
    for (uint32_t i = 0; i < p->tiles.texel_count; i++)
        for (int c = 0; c < 3; c++) indirect[c][i] = p->arrived[c][i] * (float)sets;
    return rays;
}

static uint32_t list_parts(const struct lw_patch_solver *p, struct lw_checkpoint_part *out_part) {
    const struct lw_virtual_lights *lights = &((const struct vpl_solver *)p)->lights;
    const size_t count = (size_t)lights->paths.paths * lights->paths.bounces;
    out_part[0] = (struct lw_checkpoint_part){(void *)&lights->paths.turn, sizeof lights->paths.turn};
    if (!count) return 1;
    out_part[1] = (struct lw_checkpoint_part){lights->shooter, count * sizeof *lights->shooter};
    out_part[2] = (struct lw_checkpoint_part){lights->light, count * sizeof *lights->light};
    out_part[3] = (struct lw_checkpoint_part){lights->paths.state, count * sizeof *lights->paths.state};
    return 4;
}

static size_t memory_bytes(const struct lw_patch_solver *p) {
    return lw_virtual_lights_memory_bytes(&((const struct vpl_solver *)p)->lights);
}

static const struct lw_patch_solver_method method = {.name = "vpl",
                                                     .direct_samples = 1,
                                                     .frames_min = FRAMES_MIN,
                                                     .steps = steps,
                                                     .init = init,
                                                     .finish = finish_lights,
                                                     .leave = leave,
                                                     .place = place_patches,
                                                     .bounces = bounces,
                                                     .list_parts = list_parts,
                                                     .memory_bytes = memory_bytes};

enum lw_status lw_vpl_solver_create(const struct lw_solver_desc *desc, const struct lw_pose *pose,
                                    struct lw_solver **out_solver, struct lw_error *err) {
    enum lw_status status = lw_vpl_solver_check(desc, err);
    if (status != LW_OK) return status;
    struct vpl_solver *s = calloc(1, sizeof *s);
    if (!s) return lw_status_fail(err, LW_NO_MEMORY, "solver");
    return lw_patch_solver_create(&s->patch, &method, desc, pose, out_solver, err);
}
