/* builtin_stage.h: puts a computed scene together: textures, materials, nodes, objects, lights, cameras,
 * animation.
 * Failure: as in builtin_mesh.h: the first one is kept, later calls do nothing, lw_builtin_stage_finish()
 * tells.
 * Threads: one stage, one thread. */
#ifndef LW_COMMON_BUILTIN_STAGE_H
#define LW_COMMON_BUILTIN_STAGE_H

#include "common/builtin/builtin_mesh.h"
#include "common/scene/scene.h"

struct lw_builtin_stage {
    struct lw_scene *scene;
    bool failed;
};

LW_MUST_CHECK enum lw_status lw_builtin_stage_init(struct lw_builtin_stage *stage, const char *name);

/** Hands the scene over, validated, without meshes that no object uses; or destroys it and tells why not. */
LW_MUST_CHECK enum lw_status lw_builtin_stage_finish(struct lw_builtin_stage *stage,
                                                     struct lw_scene **out_scene, struct lw_error *err);

/** Room for width x height RGBA texels that the caller fills; NULL when out of memory. Repeats in both
 * directions. */
uint8_t *lw_builtin_stage_texture(struct lw_builtin_stage *stage, const char *name, uint32_t width,
                                  uint32_t height, uint32_t *out_index);

/** The same of finishes (lw_scene.finish_texture). */
uint8_t *lw_builtin_stage_finish_texture(struct lw_builtin_stage *stage, const char *name, uint32_t width,
                                         uint32_t height, enum lw_content content, uint32_t *out_index);

/** An opaque, single-sided, dark material of this albedo; returned index for meshes. texture: or
 * LW_SCENE_NONE. */
uint32_t lw_builtin_stage_material(struct lw_builtin_stage *stage, const char *name, struct lw_vec3 albedo,
                                   uint32_t texture);

/** Gives a material a finish. Meshes that are kept afterwards have tangents where one of their materials has
 * a normal map. */
void lw_builtin_stage_gloss(struct lw_builtin_stage *stage, uint32_t material,
                            const struct lw_finish *finish);

void lw_builtin_stage_emission(struct lw_builtin_stage *stage, uint32_t material, const float radiance[3]);

uint32_t lw_builtin_stage_node(struct lw_builtin_stage *stage, const char *name, uint32_t parent,
                               struct lw_vec3 translation);

/** Turns a node by an angle (radians) about +Y. */
void lw_builtin_stage_turn(struct lw_builtin_stage *stage, uint32_t node, float angle);

/** Keeps the mesh built so far and empties the builder. Returns its index, for instances. */
uint32_t lw_builtin_stage_mesh(struct lw_builtin_stage *stage, const char *name,
                               struct lw_builtin_mesh *mesh);
void lw_builtin_stage_instance(struct lw_builtin_stage *stage, const char *name, uint32_t mesh,
                               uint32_t node);

/** Both: turns the mesh built so far into an object at a node. */
void lw_builtin_stage_object(struct lw_builtin_stage *stage, const char *name, struct lw_builtin_mesh *mesh,
                             uint32_t node);

/** An object of one quad in world space; right and up are its edges from the corner. */
void lw_builtin_stage_quad(struct lw_builtin_stage *stage, const char *name, uint32_t material,
                           struct lw_vec3 corner, struct lw_vec3 right, struct lw_vec3 up);

/** direction  where it shines, world space
 *  irradiance W/m^2 on a surface that faces it */
void lw_builtin_stage_sun(struct lw_builtin_stage *stage, const char *name, struct lw_vec3 direction,
                          struct lw_vec3 irradiance, float angular_diameter);

/** Point and spot lights, at a point of their parent's space. intensity: W/sr, the spot's on its axis.
 * cones: half angles, radians. */
void lw_builtin_stage_point(struct lw_builtin_stage *stage, const char *name, uint32_t parent,
                            struct lw_vec3 position, struct lw_vec3 intensity);
void lw_builtin_stage_spot(struct lw_builtin_stage *stage, const char *name, uint32_t parent,
                           struct lw_vec3 position, struct lw_vec3 direction, struct lw_vec3 intensity,
                           float inner_cone, float outer_cone);

/** Returns its node, which may be moved. */
uint32_t lw_builtin_stage_camera(struct lw_builtin_stage *stage, const char *name, struct lw_vec3 eye,
                                 struct lw_vec3 target, float fov_y_deg);

/** Room for a channel's values, 3 or 4 floats a key (CUBIC: three times that); the caller fills it. Keys are
 * spread evenly over duration_s, the first at 0. NULL when out of memory. */
float *lw_builtin_stage_channel(struct lw_builtin_stage *stage, uint32_t node, enum lw_channel_path path,
                                enum lw_interpolation interpolation, uint32_t key_count, float duration_s);

#endif
