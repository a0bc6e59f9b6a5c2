/* gl_renderer.h: the picture by OpenGL: the lightmapped triangles of the scene with the light that has
 * arrived.
 * Flow:    replica, pose, camera -> [gl_renderer] -> linear radiance, or the screen; which tiles the view
 *          needs
 * Threads: that of the context, which must be current in each call.
 *
 * It draws the composer's picture (client/view/compose/compose.h), whose rays are the reference, but
 * that BLEND surfaces are blended by the distance of their instances' boxes, farthest first, each in the
 * order of its triangles, and that shadows come from maps. It draws LW_GL_LIGHTS_MAX lights at most: the
 * brightest at the eye. */
#ifndef LW_CLIENT_GL_RENDERER_H
#define LW_CLIENT_GL_RENDERER_H

#include "client/view/compose/compose.h"
#include "client/view/tonemap.h"

struct lw_gl_renderer;

struct lw_gl_renderer_desc {
    const struct lw_scene *scene;
    const struct lw_atlas_map *map;
    bool unfiltered; /* as of lw_compose_desc */
    /* For files: pictures of 32-bit floats, textures read as the composer does, who averages many samples.
     * Else 16 bits, and textures are filtered. */
    bool exact;
    /* As of lw_compose_desc. Shadow maps find the obstacles of the client-drawn lights; trace, at the
     * pose of each picture, alone knows what stands close to an emitter. NULL: none; then trace and pose are
     * not read. */
    const struct lw_client_lights *drawn;
    const struct lw_trace *trace;
    const struct lw_pose *pose;
};

/** The objects that desc points to must outlive it. A context of OpenGL 3.3 core or later must be current.
 * Errors: LW_NO_MEMORY, of the GPU too; LW_UNAVAILABLE for what the GPU or its driver does not take. */
LW_MUST_CHECK enum lw_status lw_gl_renderer_create(const struct lw_gl_renderer_desc *desc,
                                                   struct lw_gl_renderer **out_renderer,
                                                   struct lw_error *err);
/** NULL is fine. */
void lw_gl_renderer_destroy(struct lw_gl_renderer *renderer);

/** Takes over arrived light and where things are, for the pictures from now on.
 * pose            as of lw_compose_render(); must stay as long as it is drawn
 * tiles_max       of light to upload at most, the rest waits; 0: all
 * now_ns          by any clock: tiles of finer levels fade in and out by it. 0: nothing fades
 * out_waiting     tiles that wait, or fade; may be NULL
 * Errors: LW_NO_MEMORY, LW_UNAVAILABLE if OpenGL fails. */
LW_MUST_CHECK enum lw_status lw_gl_renderer_take(struct lw_gl_renderer *renderer,
                                                 const struct lw_compose_source *source,
                                                 const struct lw_pose *pose, uint32_t tiles_max,
                                                 uint64_t now_ns, uint32_t *out_waiting,
                                                 struct lw_error *err);

/** Draws a view into the renderer's own memory.
 * samples   of MSAA per pixel, 1 or as the driver takes. With 1 the view's offset counts.
 * Errors: LW_NO_MEMORY; LW_UNAVAILABLE, also for a picture that is larger than the GPU takes. */
LW_MUST_CHECK enum lw_status lw_gl_renderer_draw(struct lw_gl_renderer *renderer,
                                                 const struct lw_compose_view *view, unsigned samples,
                                                 struct lw_error *err);

/** Reads the last picture: width * height * 3 floats, as of lw_compose_render(). Waits for the GPU.
 * Errors: as of lw_gl_renderer_draw(). */
LW_MUST_CHECK enum lw_status lw_gl_renderer_read(struct lw_gl_renderer *renderer, float *out_rgb,
                                                 struct lw_error *err);

/** Draws the last picture, exposed and tone mapped, into a framebuffer of width * height pixels; 0: the
 * window. */
void lw_gl_renderer_show(struct lw_gl_renderer *renderer, unsigned frame, enum lw_tonemap_curve curve,
                         float stops, uint32_t width, uint32_t height);

/** The exposure that lw_tonemap_auto_stops() gives the last picture, from a small copy of it; waits for the
 * GPU.
 * Errors: as of lw_gl_renderer_draw(). */
LW_MUST_CHECK enum lw_status lw_gl_renderer_meter(struct lw_gl_renderer *renderer, float *out_stops,
                                                  struct lw_error *err);

/** Finds the tiles that a view needs, and their shares of it, from a small picture. Waits for the GPU.
 * out_needed   a byte for each tile, as of lw_compose_needed(): set, never cleared
 * out_shown    for each tile: its share of light, summed over the small picture's pixels, 256 a pixel; added
 *              to
 * out_pixels   of the small picture
 * Errors: as of lw_gl_renderer_draw(). */
LW_MUST_CHECK enum lw_status lw_gl_renderer_survey(struct lw_gl_renderer *renderer,
                                                   const struct lw_compose_view *view, uint8_t *out_needed,
                                                   uint64_t *out_shown, uint64_t *out_pixels,
                                                   struct lw_error *err);

/** Whether what draws in the current context is a program on the CPU. */
bool lw_gl_renderer_is_software(void);

/** Name of what draws, as the driver gives it. */
const char *lw_gl_renderer_name(const struct lw_gl_renderer *renderer);

/** Costs of the last picture. */
struct lw_gl_renderer_figures {
    uint32_t draw_calls, objects; /* in the last picture */
    uint32_t fine_tiles;          /* tiles of finer levels that pictures may read now */
    uint64_t tiles_uploaded;      /* so far */
    uint64_t maps_drawn;          /* so far: shadow maps */
};
struct lw_gl_renderer_figures lw_gl_renderer_figures(const struct lw_gl_renderer *renderer);

#endif
