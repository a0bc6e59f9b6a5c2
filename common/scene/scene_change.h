/* scene_change.h: one change of a running scene, and the check whether it is valid.
 * Flow:    UPDATE message or caller -> [check] -> scene_state -> scene and pose of the next frame
 * Threads: pure functions, [any]. */
#ifndef LW_COMMON_SCENE_CHANGE_H
#define LW_COMMON_SCENE_CHANGE_H

#include "common/scene/scene.h"

#define LW_SCENE_CHANGE_VALUES_MAX   12u   /* numbers that a change carries */
#define LW_SCENE_CHANGE_POSITION_MAX 1e8f  /* m, either sign: of a position and of an object's origin */
#define LW_SCENE_CHANGE_SCALE_MIN    1e-6f /* length of each axis of a transform */
#define LW_SCENE_CHANGE_SCALE_MAX    1e6f
/* Determinant of a transform whose axes are made unit, either sign. */
#define LW_SCENE_CHANGE_VOLUME_MIN 1e-6f
#define LW_SCENE_CHANGE_RATE_MAX   1000.0f /* the clock's, either sign */

/* The kind of target of a change. */
enum lw_scene_change_of {
    LW_SCENE_CHANGE_OF_SCENE, /* target is 0 */
    LW_SCENE_CHANGE_OF_OBJECT,
    LW_SCENE_CHANGE_OF_LIGHT,
    LW_SCENE_CHANGE_OF_MATERIAL,
    LW_SCENE_CHANGE_OF_MESH
};

/* kind, its number on the wire (for ever), what its target is, how many values it has */
#define LW_SCENE_CHANGE_MAP(X)                                                                               \
    X(OBJECT_TRANSFORM, 1, OBJECT, 12) /* object to world, row-major 3x4; its animation stops */             \
    X(OBJECT_RESTORE, 2, OBJECT, 0)    /* back to where the scene has it, or it was added, and shown */      \
    X(OBJECT_HIDE, 3, OBJECT, 0)       /* no ray meets it: neither seen, nor shadow, nor light */            \
    X(OBJECT_SHOW, 4, OBJECT, 0)                                                                             \
    X(LIGHT_INTENSITY, 5, LIGHT, 3)         /* RGB >= 0 in the light's own unit; 0, 0, 0 is off */           \
    X(LIGHT_POSITION, 6, LIGHT, 3)          /* m, world space */                                             \
    X(LIGHT_DIRECTION, 7, LIGHT, 3)         /* where it shines, world space, of any length */                \
    X(LIGHT_RESTORE, 8, LIGHT, 0)           /* intensity, position and direction as the scene has them */    \
    X(MATERIAL_BASE_COLOUR, 9, MATERIAL, 3) /* factor in [0, 1]; alpha stays */                              \
    X(MATERIAL_EMISSION, 10, MATERIAL, 3)   /* factor >= 0, W/(m^2 sr) */                                    \
    X(MATERIAL_RESTORE, 11, MATERIAL, 0)                                                                     \
    X(SKY, 12, SCENE, 3) /* W/(m^2 sr) >= 0 from everywhere outside */                                       \
    X(SKY_RESTORE, 13, SCENE, 0)                                                                             \
    X(CLOCK_PAUSE, 14, SCENE, 0)    /* the scene's animation holds */                                        \
    X(CLOCK_PLAY, 15, SCENE, 0)     /* and goes on */                                                        \
    X(CLOCK_SEEK, 16, SCENE, 1)     /* s of the animation, >= 0; paused or not stays */                      \
    X(CLOCK_RATE, 17, SCENE, 1)     /* seconds of animation per second; negative runs backwards */           \
    X(RESET, 18, SCENE, 0)          /* objects, lights, materials, sky and clock as at the start */          \
    X(OBJECT_ADD, 19, MESH, 12)     /* object to world: the first spare of the mesh stands there, shown */   \
    X(OBJECT_REMOVE, 20, OBJECT, 0) /* it becomes a spare of its mesh */

enum lw_scene_change_kind {
#define X(name, number, of, values) LW_SCENE_CHANGE_##name = number,
    LW_SCENE_CHANGE_MAP(X)
#undef X
};

/* The later of two changes to the same thing counts. */
struct lw_scene_change {
    uint32_t kind;        /* enum lw_scene_change_kind */
    uint32_t target;      /* number of the object, light, material or mesh in the scene; else 0 */
    uint32_t value_count; /* as the kind says */
    float value[LW_SCENE_CHANGE_VALUES_MAX];
};

/* code, its number on the wire, which never changes, and its meaning */
#define LW_SCENE_CHANGE_CODE_MAP(X)                                                                          \
    X(OK, 0, "done")                                                                                         \
    X(BUSY, 1, "too many updates wait for a frame")                                                          \
    X(UNKNOWN_KIND, 2, "this server does not know such a change")                                            \
    X(UNKNOWN_TARGET, 3, "the scene has no such object, light, material or mesh")                            \
    X(VALUE_COUNT, 4, "a change of this kind has another number of values")                                  \
    X(NOT_FINITE, 5, "a value is not a finite number")                                                       \
    X(OUT_OF_RANGE, 6, "a value is out of range")                                                            \
    X(DEGENERATE, 7, "a transform without volume, or a direction without length")                            \
    X(NO_SPARE, 8, "no spare of this mesh is left")                                                          \
    X(ABSENT, 9, "a spare, which stands nowhere until it is added")

/** Why a change, or the update that holds it, was not made. */
enum lw_scene_change_code {
#define X(name, number, text) LW_SCENE_CHANGE_##name = number,
    LW_SCENE_CHANGE_CODE_MAP(X)
#undef X
};

#ifdef __cplusplus
extern "C" {
#endif

/** Text of a code, or a text that says it is unknown. Never NULL. */
const char *lw_scene_change_text(uint32_t code);

/** Number of targets of a kind in a scene; 1 for the scene itself. */
uint32_t lw_scene_change_targets(const struct lw_scene *scene, enum lw_scene_change_of of);

/** Whether a change of a scene is valid, without regard to earlier changes. The objects in the scene depend
 * on earlier changes: scene_roster.h checks that. Returns LW_SCENE_CHANGE_OK, or why not, with LW_BAD_DATA
 * and one line of under 200 bytes of ASCII in *err. */
enum lw_scene_change_code lw_scene_change_check(const struct lw_scene *scene,
                                                const struct lw_scene_change *change, struct lw_error *err);

#ifdef __cplusplus
}
#endif

#endif
