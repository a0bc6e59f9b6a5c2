/* fixed_views.h: twelve views of a scene, the same for each motion and renderer.
 * Flow:    scene, its box -> [fixed_views: table, or the rule] -> camera of a view at a time
 * Threads: found by one; lookups [any].
 *
 * The rule, lw_fixed_views_pick(): a candidate stands at eye height over a floor, at a free place. Points
 * of interest lie on the lamp's way (LW_SCENE_MOTION_LAMP_WALK) and where the scene's own animation has
 * objects from 2 to 6 s. Five of six candidates stand within 4 m of such a point, out of the way of moving
 * objects, and look towards a visible one, at most 25 degrees aside. The others stand and look anywhere.
 * The middle of a view is free for 1.5 m. At most a tenth of the view is nearer than 0.7 m; at most a
 * third is sky.
 *
 * A path tracer renders 96 candidates, 96 x 54 pixels, 16 paths each. They are sorted by mean luminance
 * into twelve bins. From each bin the rule takes the candidate that is the farthest from those taken before.
 * The seed is fixed.
 *
 * The tables of builtin:atrium, builtin:city and Sponza began as views of that rule. Views that showed
 * little, or nothing that moves, were replaced by hand. So `bench_views --pick` prints views of the same
 * kind, not the same numbers. They go roughly from dark to bright. The table of builtin:cornell is the rule's
 * views, rounded to 1 cm: the rule takes 10 CPU s there.
 *
 * All views are 60 degrees high. Views of odd number drift sideways by drift_m * sin(2 pi t / 4 s), so that
 * reprojection and codecs have work; the others stand. */
#ifndef LW_CLIENT_MEASURE_SIDES_FIXED_VIEWS_H
#define LW_CLIENT_MEASURE_SIDES_FIXED_VIEWS_H

#include "client/camera/camera.h"

#define LW_FIXED_VIEWS_COUNT 12u

struct lw_fixed_view {
    struct lw_vec3 position, target; /* m, world space */
    const char *shows;               /* "" of a view that the rule has found */
};

struct lw_fixed_views {
    struct lw_fixed_view view[LW_FIXED_VIEWS_COUNT];
    float drift_m;   /* amplitude of views that drift: 0.3 m, less in a box below 15 m */
    bool from_table; /* else by the rule */
};

/** Takes the views from the table, by the scene's name and box, or else by the rule. Call it before
 * lw_scene_motion_set(), so that the motion does not change the views.
 * threads  0: all
 * Errors   LW_BAD_DATA where no place is free or nothing is lit; LW_NO_MEMORY, LW_INTERNAL */
LW_MUST_CHECK enum lw_status lw_fixed_views_init(struct lw_fixed_views *views, const struct lw_scene *scene,
                                                 unsigned threads, struct lw_error *err);

/** By the rule alone. Threads and errors as above. 30 CPU s in the atrium. */
LW_MUST_CHECK enum lw_status lw_fixed_views_pick(struct lw_fixed_views *views, const struct lw_scene *scene,
                                                 unsigned threads, struct lw_error *err);

/** Camera of a view. time_s: of the animation. view: below LW_FIXED_VIEWS_COUNT. */
struct lw_camera_view lw_fixed_views_at(const struct lw_fixed_views *views, uint32_t view, double time_s);

/** Whether a view drifts. */
bool lw_fixed_views_drifts(uint32_t view);

#endif
