/* glb_scene.h: a lit scene as a .glb that engines load: geometry with lightmap coordinates, materials that
 * name their maps.
 * Flow:    scene, each object's map -> [glb_scene] -> .glb
 * Threads: main() only. Contents of the file and how to use it: docs/baking.md.
 *
 * Each object gets materials of its own, since each has a map of its own; vertices are shared by the objects
 * of a mesh. */
#ifndef LW_BAKE_GLB_SCENE_H
#define LW_BAKE_GLB_SCENE_H

#include "server/bake/glb.h"
#include "server/bake/map.h"
#include "server/bake/sides.h"

struct lw_glb_scene_desc {
    const struct lw_scene *scene;
    const struct lw_convention *convention; /* for the EXRs */
    const char *map_folder;                 /* the EXRs', relative to the .glb: "" or "maps/" */
    /* Folder of the maps of directions, in map_folder, and their form; NULL: there are none. */
    const char *direction_folder, *direction_form;
    bool split_sides; /* double-sided triangles twice, single-sided, so that each side shows its own light */
    bool with_lights; /* keeps the punctual lights, whose light the maps hold already */
    /* per light, 1: kept in any case, because the maps lack its direct light; NULL: none */
    const uint8_t *drawn;
};

/* A mesh in the file: the data that its objects share. */
struct lw_glb_mesh {
    uint32_t *attribute;                          /* accessors; NULL: not written yet */
    uint32_t back_position, back_normal, back_uv; /* accessors of the back of split sides; or LW_GLB_NONE */
    uint32_t *material, *indices, *back_indices;  /* per primitive: the scene's material; accessors */
    uint32_t primitive_count;
};

struct lw_glb_scene {
    struct lw_glb_scene_desc desc;
    struct lw_glb glb;
    struct lw_glb_mesh *mesh;                /* per mesh of the scene */
    uint32_t *texture;                       /* per texture of the scene: the file's, or LW_GLB_NONE */
    uint32_t *image;                         /* per texture of the scene */
    uint32_t *finish_texture, *finish_image; /* the same of textures of finishes */
    uint32_t *object_mesh;                   /* per object: the file's mesh */
    json_t **object_extras;                  /* per object */
    uint32_t lightmap_sampler;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_glb_scene_init(struct lw_glb_scene *g, const struct lw_glb_scene_desc *desc);
void lw_glb_scene_finish(struct lw_glb_scene *g);

/** Adds an object with its map. shown: which sides its lightmap coordinates point at; of split sides each
 * shows its own. irradiance: the map in 8 bits, W/m^2 per unit = scale, for MOZ_lightmap. file: the EXR's
 * name. Failures are kept for lw_glb_scene_write(). */
void lw_glb_scene_add(struct lw_glb_scene *g, const struct lw_map *map, const struct lw_sides_shown *shown,
                      const char *file, const uint8_t *irradiance_rgb, float scale);

/** After all objects: adds the rest of the scene and writes the file. Errors: as lw_glb_write(). */
LW_MUST_CHECK enum lw_status lw_glb_scene_write(struct lw_glb_scene *g, const char *path,
                                                struct lw_error *err);

#endif
