/* scene_motion.h: replaces a scene's animation by a static scene, a moving light or a moving object, to
 * measure their cost.
 * Flow:    scene -> [scene_motion: channels kept, dropped, made] -> scene
 * Threads: while the scene is being built. */
#ifndef LW_COMMON_SCENE_MOTION_H
#define LW_COMMON_SCENE_MOTION_H

#include "common/scene/scene.h"

/* The first four keep the scene's own animation. The others replace it by one mover. */
enum lw_scene_motion {
    LW_SCENE_MOTION_STATIC,      /* nothing */
    LW_SCENE_MOTION_LIGHT,       /* what carries a light or an emissive surface */
    LW_SCENE_MOTION_OBJECT,      /* objects that carry none */
    LW_SCENE_MOTION_ALL,         /* both */
    LW_SCENE_MOTION_LAMP_WALK,   /* a lamp goes to and fro at a walker's pace */
    LW_SCENE_MOTION_SUN_SWING,   /* the sun swings sideways */
    LW_SCENE_MOTION_LAMP_SWITCH, /* a lamp goes off and on at once */
    LW_SCENE_MOTION_CARRY,       /* an object is carried to and fro */
    LW_SCENE_MOTION_COUNT
};

/* For the last four motions. Movers turn round at 0 s and every 7 to 11 s after: speed is constant from 0 to
 * 7 s. */
#define LW_SCENE_MOTION_WALK_M_S    1.5f
#define LW_SCENE_MOTION_CARRY_M_S   1.0f
#define LW_SCENE_MOTION_SWING_DEG_S 6.0f
#define LW_SCENE_MOTION_OFF_S       3.0f /* the lamp goes off, and on again */
#define LW_SCENE_MOTION_ON_S        5.0f

/** "static", "light", "object", "all", "lamp-walk", "sun-swing", "lamp-switch", "carry". */
const char *lw_scene_motion_name(enum lw_scene_motion motion);
/* In the order of the enum. */
#define LW_SCENE_MOTION_CHOICES "static|light|object|all|lamp-walk|sun-swing|lamp-switch|carry"

/** The outcome, for people. */
struct lw_scene_motion_report {
    uint32_t kept, dropped; /* channels */
    const char *light;  /* name of the light or lamp that was set moving because none did; NULL: none was */
    const char *object; /* the object's; NULL: none was set moving */
    /* For the last four motions, else 0: */
    float speed_m_s;   /* the lamp's or object's, from 0 to 7 s */
    float speed_deg_s; /* the sun's direction's, from 0 to 7 s */
    float switch_m; /* a lamp that has no surface goes off by being so far away; else its surface shrinks */
    struct lw_vec3 from_ws, to_ws; /* m: ends of the way of lamp or object */
};

/** Drops the animation that does not belong to a motion; cameras keep theirs, and so does the animation's
 * length. Where the scene has none that belongs to it, one mover is made, in a loop of some 4 s:
 *  - a light: the strongest point or spot light, or else an emissive object, goes round a circle of 5 % of
 *    the scene's longest side. The circle is smaller (down to 0.5 %) where a point or spot would come nearer
 *    to a surface than a tenth of the radius. Without either, the strongest directional light swings by 5
 *    degrees to either side;
 *  - an object: of those that measure at most half the scene's longest side the one with the largest surface
 *    turns about its vertical axis.
 * The last four motions drop all animation but cameras'. Its length becomes 16 s where no camera moves or it
 * is below 12 s. Their mover:
 *  - lamp-walk: the lamp of lw_scene_motion_find_way(), along that way.
 *  - sun-swing: the strongest directional light. Its direction turns on a great circle, sideways, by 24
 *    degrees to either side of where it is.
 *  - lamp-switch: the same lamp, in the middle of that way. Intensities cannot be animated: an emissive
 *    object shrinks to a thousandth of its size about its middle, so to a millionth of its light. A point or
 *    spot light is put a thousand times the scene's longest side away. Both from one moment to the next. So
 *    a renderer gets a mover, not a lamp that is dimmed.
 *  - carry: the object of lw_scene_motion_find_way(), along that way.
 * Errors: LW_BAD_DATA where nothing of the scene can; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_scene_motion_set(struct lw_scene *scene, enum lw_scene_motion motion,
                                                 struct lw_scene_motion_report *out_report,
                                                 struct lw_error *err);

/** A straight way to and fro, of constant speed. */
struct lw_scene_motion_way {
    uint32_t light, object;        /* the mover; one of them is LW_SCENE_NONE */
    struct lw_vec3 from_ws, to_ws; /* its middle's; m */
    float speed_m_s;
};

/** The way of lamp-walk or carry in a scene to which no motion has been set yet.
 * Lamp: the first of these that the scene has: its brightest animated emissive object, its strongest animated
 * point or spot light (W), its strongest light that stands, its brightest emissive object that stands.
 * Object: of those without emission, at most 3 m and half the scene's longest side long, the one with the
 *         largest surface; animated ones first.
 * Way:    in builtin:atrium and Sponza (the lamp's) from a table, recognised by name and size. Elsewhere it
 *         is the first free level line of 16 directions, through where the mover stands at 0 s, that is long
 *         enough for 8 s, else the longest: then speed is less.
 * Errors: LW_BAD_DATA where the scene has no such mover, or no room for it; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_scene_motion_find_way(const struct lw_scene *scene,
                                                      enum lw_scene_motion motion,
                                                      struct lw_scene_motion_way *out_way,
                                                      struct lw_error *err);

#endif
