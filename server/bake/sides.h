/* sides.h: which side's light a double-sided chart shows in programs that read one lightmap for both sides.
 * Flow:    scene, pose -> [sides: what cameras see]; map of an object -> [sides: what light reaches] -> side
 *          per vertex -> lightmap coordinates of the .glb
 * Threads: main() only.
 *
 * A chart is a set of triangles that share vertices. One that has backs in the map shows
 *   1. the side that most rays from the scene's cameras meet, if enough of them do (a viewer turns: the rays
 *      leave in all directions);
 *   2. else the side that has more light: irradiance times area, which is what rays of light bring. */
#ifndef LW_BAKE_SIDES_H
#define LW_BAKE_SIDES_H

#include "common/scene/pose.h"
#include "server/bake/map.h"

enum lw_sides_choice { LW_SIDES_AUTO, LW_SIDES_FRONT, LW_SIDES_BACK };
#define LW_SIDES_CHOICES "auto|front|back"

#define LW_SIDES_RAYS        (1u << 18) /* from all cameras together */
#define LW_SIDES_CAMERAS_MAX 64u        /* more are left out */
#define LW_SIDES_HITS_MIN    8u         /* on a chart: fewer are chance, and its light decides */
#define LW_SIDES_SHARE_MIN   0.1 /* share of the other side's hits, or light: from it on a side matters */
/* limit of triangles for that test, of objects with backs; beyond it light alone decides */
#define LW_SIDES_COUNTED_MAX (1ull << 26)

struct lw_sides {
    const struct lw_scene *scene;
    enum lw_sides_choice choice;
    uint64_t *first;     /* per object: where its triangles begin in seen */
    uint32_t (*seen)[2]; /* hits per triangle and side, front and back; NULL: no camera */
};

/** Sends the cameras' rays. finish() also after failure. Errors: LW_NO_MEMORY, LW_INTERNAL. */
LW_MUST_CHECK enum lw_status lw_sides_init(struct lw_sides *sides, const struct lw_scene *scene,
                                           const struct lw_pose *pose, enum lw_sides_choice choice,
                                           struct lw_error *err);
void lw_sides_finish(struct lw_sides *sides);

/* The sides that one object shows. */
struct lw_sides_shown {
    uint8_t *back;   /* per vertex of its mesh, 1: its chart shows the back; NULL: all show the front */
    double back_m2;  /* area that does, in the mesh's own lengths */
    double both_m2;  /* area of charts whose other side is visible too */
    double total_m2; /* area of charts that have a back */
};

/** Chooses for the object of a map. *out is zero for one without backs. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_sides_choose(const struct lw_sides *sides, const struct lw_map *map,
                                             struct lw_sides_shown *out, struct lw_error *err);
void lw_sides_release(struct lw_sides_shown *shown);

/** "front", "back" or "mixed"; "front" for an object without backs. */
const char *lw_sides_name(const struct lw_sides_shown *shown);

#endif
