/* gl_scene.h: meshes and textures of a scene on the GPU, cut into batches that one draw call takes.
 * Flow:    scene -> [gl_scene] -> gl_renderer
 * Threads: that of the context.
 *
 * A batch is the triangles of a mesh with one material and one coarsest level of their lightmap, of all
 * instances at once. */
#ifndef LW_CLIENT_GL_SCENE_H
#define LW_CLIENT_GL_SCENE_H

#include "common/base/box.h"
#include "common/scene/scene.h"

#include <epoxy/gl.h>

/* Places of vertex attributes. */
enum lw_gl_attribute {
    LW_GL_POSITION, /* m, object space */
    LW_GL_LIGHTMAP, /* texels of level 0 */
    LW_GL_NORMAL,
    LW_GL_UV0,
    LW_GL_UV1,
    LW_GL_COLOUR,
    LW_GL_TANGENT, /* for normal maps; w: as glTF's */
    LW_GL_ATTRIBUTES
};

struct lw_gl_batch {
    uint32_t material;
    uint32_t coarsest;     /* level of the lightmap, as of lw_lightmap_coarsest() */
    uint32_t first, count; /* indices, within all */
};

struct lw_gl_mesh {
    GLuint array; /* vertex array object */
    uint32_t first_batch, batch_count;
    struct lw_box box;     /* object space */
    bool lit;              /* it has a lightmap */
    bool tangents;         /* it had them when it was uploaded */
    uint32_t vertex_count; /* on the GPU: one for each tangent of a vertex */
};

/* The normal map of a material and its surface in one texture: x and y of the normal, roughness, and
 * occlusion or metalness, whichever differs from texel to texel. It is made where both maps have one size and
 * one placement, and all meshes with the material have tangents. */
struct lw_gl_maps {
    GLuint packed;   /* 0: there is none */
    bool shared;     /* another material's */
    bool occludes;   /* the last channel is occlusion */
    bool metal;      /* it is metalness */
    float metalness; /* the whole map's, where it is not */
};

struct lw_gl_scene {
    const struct lw_scene *scene;
    struct lw_gl_mesh *mesh; /* per mesh */
    struct lw_gl_batch *batch;
    uint32_t batch_count;
    GLuint vertices, indices; /* buffers */
    /* GL_TEXTURE_BUFFER of GL_R32UI: a bit for each triangle, in the order of indices, that says whether it
     * has fewer texels than LW_FINE_CHOICE_TEXELS */
    GLuint small, small_buffer;
    GLuint *texture;        /* per texture of the scene; 0: no material uses it */
    GLuint environment;     /* 0: there is none */
    GLuint *finish_texture; /* as texture, of those of finishes */
    uint32_t finish_texture_count;
    struct lw_gl_maps *maps; /* per material */
    bool exact;
};

/** Uploads a scene, which must outlive it. Zeroed on failure.
 * exact: textures are read as the composer reads them, without smaller copies
 * Errors: LW_NO_MEMORY, of the GPU too; LW_UNAVAILABLE for a texture that the GPU does not take. */
LW_MUST_CHECK enum lw_status lw_gl_scene_init(struct lw_gl_scene *scene, const struct lw_scene *original,
                                              bool exact, struct lw_error *err);
/** Takes over finishes that have arrived since: their textures, meshes' tangents. Costs little where there is
 * nothing new. Errors: as of lw_gl_scene_init(). */
LW_MUST_CHECK enum lw_status lw_gl_scene_follow(struct lw_gl_scene *scene, struct lw_error *err);
/** A zeroed one is fine. */
void lw_gl_scene_finish(struct lw_gl_scene *scene);

#endif
