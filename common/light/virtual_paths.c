#include "common/light/virtual_paths.h"

#include "common/base/vec.h"

#include <math.h>
#include <stdlib.h>

/* Share of the radius of a disc as large as the share of all surfaces that the first light of a path stands
 * for: between the shares of least error in Cornell's box, a half, and in Sponza, a seventh
 * (docs/lab/solvers.md). */
#define NEAR_SHARE 0.35f

enum lw_status lw_virtual_paths_init(struct lw_virtual_paths *paths, uint32_t lights, uint32_t bounces,
                                     uint32_t sets) {
    uint32_t count = bounces ? lights / (bounces * sets) * sets : 0;
    if (bounces && !count) count = sets;
    uint8_t *state = calloc((size_t)count * bounces + 1, sizeof *state);
    if (!state) return LW_NO_MEMORY;
    *paths = (struct lw_virtual_paths){.paths = count, .bounces = bounces, .sets = sets, .state = state};
    return LW_OK;
}

void lw_virtual_paths_finish(struct lw_virtual_paths *paths) {
    free(paths->state);
    *paths = (struct lw_virtual_paths){0};
}

float lw_virtual_paths_near_m(const struct lw_virtual_paths *paths, double area_m2) {
    return NEAR_SHARE * (float)sqrt(area_m2 / ((double)LW_PI * paths->paths));
}

void lw_virtual_paths_lose(struct lw_virtual_paths *paths, uint32_t path, uint32_t bounce) {
    for (uint32_t b = bounce; b < paths->bounces; b++)
        paths->state[lw_virtual_paths_light(paths, path, b)] = LW_VIRTUAL_LIGHT_LOST;
}

void lw_virtual_paths_check(struct lw_virtual_paths *paths, const struct lw_virtual_paths_rays *rays) {
    for (uint32_t path = 0; path < paths->paths; path++)
        for (uint32_t b = 0; b < paths->bounces; b++)
            if (lw_virtual_paths_is_lit(paths, lw_virtual_paths_light(paths, path, b)) &&
                !rays->holds(rays->context, path, b))
                lw_virtual_paths_lose(paths, path, b);
}

bool lw_virtual_paths_lack(const struct lw_virtual_paths *paths) {
    for (uint32_t path = 0; path < paths->paths; path++)
        if (paths->state[lw_virtual_paths_light(paths, path, 0)] == LW_VIRTUAL_LIGHT_LOST) return true;
    return false;
}

/* From one light of a path on; the others stay. Returns how many were shot. */
static uint32_t shoot_path(struct lw_virtual_paths *paths, const struct lw_virtual_paths_rays *rays,
                           uint32_t path, uint32_t bounce) {
    bool lit = true;
    for (uint32_t b = bounce; b < paths->bounces; b++) {
        uint8_t *state = &paths->state[lw_virtual_paths_light(paths, path, b)];
        lit = lit && (b == 0 || state[-1] == LW_VIRTUAL_LIGHT_LIT) && rays->shoot(rays->context, path, b);
        *state = lit ? LW_VIRTUAL_LIGHT_LIT : LW_VIRTUAL_LIGHT_ENDED;
    }
    return paths->bounces - bounce;
}

void lw_virtual_paths_shoot(struct lw_virtual_paths *paths, const struct lw_virtual_paths_rays *rays,
                            bool rotates, uint32_t most) {
    const bool all = !paths->turn.shot;
    uint32_t count = 0;
    for (uint32_t path = 0; path < paths->paths; path++)
        for (uint32_t b = 0; b < paths->bounces; b++) {
            if (paths->state[lw_virtual_paths_light(paths, path, b)] != LW_VIRTUAL_LIGHT_LOST) continue;
            if (all || count < most) count += shoot_path(paths, rays, path, b);
            break;
        }
    paths->turn.shot = 1;
    for (; rotates && count + paths->bounces <= most && count < paths->paths * paths->bounces;
         paths->turn.next = (paths->turn.next + 1) % paths->paths)
        count += shoot_path(paths, rays, paths->turn.next, 0);
}
