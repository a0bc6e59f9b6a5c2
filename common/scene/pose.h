/* pose.h: the scene at one moment: transforms of objects, lights and cameras, and all other values that may
 * change.
 * Flow:    scene, time -> [pose] -> trace, solve, frame messages
 * Threads: a pose belongs to one thread at a time. */
#ifndef LW_COMMON_POSE_H
#define LW_COMMON_POSE_H

#include "common/scene/scene.h"

/** A punctual light in world space. */
struct lw_light_state {
    struct lw_vec3 position_ws;  /* m; unused for directional */
    struct lw_vec3 direction_ws; /* unit; where it shines; unused for point */
    struct lw_vec3 intensity;
};

/** The factors of a material, as in struct lw_material. */
struct lw_material_state {
    float base_colour[3]; /* without alpha, which stays */
    float emission[3];    /* W/(m^2 sr) */
};

struct lw_pose_local;

struct lw_pose {
    double time_s;                      /* wrapped */
    struct lw_affine *object_to_world;  /* one per object */
    bool *object_hidden;                /* one per object: no ray meets it */
    bool *object_spare;                 /* one per object: it is not in the scene; then it is hidden too */
    bool *object_dynamic;               /* one per object: it may move without an animation channel */
    struct lw_light_state *light;       /* one per light */
    struct lw_material_state *material; /* one per material */
    float sky[3];                       /* W/(m^2 sr) */
    bool *node_moves;                   /* one per node: it or an ancestor has a channel */
    /* NULL in a copy by lw_pose_init_copy(): */
    struct lw_affine *node_to_world; /* one per node */
    struct lw_pose_local *local;     /* per node with a channel; scratch of lw_pose_evaluate() */
    uint32_t local_count;
};

/** Allocates for a scene and evaluates time 0. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_pose_init(struct lw_pose *pose, const struct lw_scene *scene);
/** Allocates and copies, for those who read objects, lights and materials. The copy has no transforms of
 * nodes: lw_pose_evaluate() is not for it. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_pose_init_copy(struct lw_pose *pose, const struct lw_pose *from,
                                               const struct lw_scene *scene);
void lw_pose_finish(struct lw_pose *pose);

/** Evaluates the scene's own animation at a time (s, wrapped into its duration). Only spares are hidden. */
void lw_pose_evaluate(struct lw_pose *pose, const struct lw_scene *scene, double time_s);

/** Copies src to dst; both are of the same scene. Transforms of nodes are copied if both have some. */
void lw_pose_copy(struct lw_pose *dst, const struct lw_pose *src, const struct lw_scene *scene);

/* The parts that may differ between two moments. */
enum lw_pose_change {
    LW_POSE_OBJECTS = 1, /* where they are, whether hidden */
    LW_POSE_LIGHTS = 2,
    LW_POSE_MATERIALS = 4,
    LW_POSE_SKY = 8,
    LW_POSE_DYNAMIC = 16 /* which objects are, of those that have no channel */
};

/** Differences between two moments of a scene, bit for bit: LW_POSE_* or 0. Not time, not cameras. */
unsigned lw_pose_difference(const struct lw_pose *a, const struct lw_pose *b, const struct lw_scene *scene);

/** Whether an object's transform or visibility differs. */
bool lw_pose_object_differs(const struct lw_pose *a, const struct lw_pose *b, uint32_t object);

/** Whether the scene looks the same at both moments: lw_pose_difference() is 0. */
bool lw_pose_equal(const struct lw_pose *a, const struct lw_pose *b, const struct lw_scene *scene);

/** Whether an object may move: its node or an ancestor of it has a channel, or it is dynamic, as spares
 * are. */
bool lw_pose_object_moves(const struct lw_pose *pose, const struct lw_scene *scene, uint32_t object);

/** Widens world-space bounds by those of an object. */
void lw_pose_object_bounds(const struct lw_pose *pose, const struct lw_scene *scene, uint32_t object,
                           struct lw_vec3 *min, struct lw_vec3 *max);

/** World-space bounds of all objects except dynamic ones, which may be anywhere; false without a vertex. */
bool lw_pose_bounds(const struct lw_pose *pose, const struct lw_scene *scene, struct lw_vec3 *out_min,
                    struct lw_vec3 *out_max);

#endif
