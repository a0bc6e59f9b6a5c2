/* gl_lights.h: the lights that the client draws, as shaders read them, and which of their shadow maps are out
 * of date.
 * Flow:    scene, pose -> [gl_lights] -> gl_renderer draws the maps, then the picture
 * Threads: that of the context.
 *
 * A sun has LW_GL_LIGHTS_CASCADES maps: the last one of the whole scene, each of the others a quarter as
 * wide, about a place before the eye. Points, spots and small emissive meshes have the six sides of a cube. A
 * map is drawn again when its light or something in it has moved, and a sun's smaller ones when the eye has
 * left their middle.
 * After:   Fernando, Percentage-Closer Soft Shadows, 2005, for the width of edges. */
#ifndef LW_CLIENT_GL_LIGHTS_H
#define LW_CLIENT_GL_LIGHTS_H

#include "client/view/lights/emitter_clusters.h"
#include "common/base/box.h"
#include "common/light/client_lights.h"

#include <epoxy/gl.h>

#define LW_GL_LIGHTS_CASCADES  3u
#define LW_GL_LIGHTS_SUNS      2u  /* suns that are drawn */
#define LW_GL_LIGHTS_LAMPS     16u /* the same of others: those that give most where the eye is */
#define LW_GL_LIGHTS_MAX       (LW_GL_LIGHTS_SUNS + LW_GL_LIGHTS_LAMPS)
#define LW_GL_LIGHTS_SUN_SIDE  2048u /* texels of a map */
#define LW_GL_LIGHTS_LAMP_SIDE 512u

/** A map to draw. It has everything in front of the eye's `side`s, moved out by `beyond`. */
struct lw_gl_shadow_map {
    bool sun;
    uint32_t layer;     /* in the maps of suns or of lamps */
    struct lw_vec3 eye; /* a sun's: the middle */
    struct lw_vec3 side[4];
    float beyond[4];
    float clip[16]; /* for places from the eye, columns */
    float reach_m;  /* nearer surfaces are a part of the lamp */
    bool placed, dirty;
};

struct lw_gl_light_source; /* one light */

struct lw_gl_lights {
    const struct lw_scene *scene;
    const struct lw_trace *trace;
    struct lw_client_lights drawn;
    struct lw_lights lights;
    struct lw_emitter_clusters clusters;
    bool ready; /* lights and clusters are there */
    float (*emission)[3];
    struct lw_gl_light_source *source; /* all of them, suns first */
    uint32_t source_count, sun_count;
    uint32_t chosen[LW_GL_LIGHTS_MAX], chosen_count; /* for the picture at hand */
    struct lw_gl_shadow_map map[LW_GL_LIGHTS_SUNS * LW_GL_LIGHTS_CASCADES + LW_GL_LIGHTS_LAMPS * 6];
    uint32_t owner[LW_GL_LIGHTS_LAMPS]; /* the source that has those six maps */
    GLuint sun_maps, lamp_maps;         /* GL_TEXTURE_2D_ARRAY of depth */
    GLuint table, table_buffer;         /* GL_TEXTURE_BUFFER of GL_RGBA32F: the chosen lights */
    GLuint shapes, shape_buffer;        /* GL_R32F: the chosen clusters' maps of intensity */
    GLuint frame;                       /* to draw maps with */
    uint64_t maps_drawn;                /* so far */
    bool upside_down;                   /* depth, as of the renderer */
};

/** drawn, scene and trace must outlive it. Zeroed on failure. Errors: LW_NO_MEMORY, LW_UNAVAILABLE. */
LW_MUST_CHECK enum lw_status lw_gl_lights_init(struct lw_gl_lights *lights, const struct lw_scene *scene,
                                               const struct lw_trace *trace,
                                               const struct lw_client_lights *drawn,
                                               const struct lw_pose *pose, bool upside_down,
                                               struct lw_error *err);
/** A zeroed one is fine. */
void lw_gl_lights_finish(struct lw_gl_lights *lights);

/** Takes over lights, materials and the boxes of moved objects. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gl_lights_follow(struct lw_gl_lights *lights, const struct lw_pose *pose,
                                                 const struct lw_box *moved, uint32_t moved_count,
                                                 struct lw_error *err);

/** Chooses the lights of a picture and places their maps; writes the tables.
 * scene   its bounds */
void lw_gl_lights_choose(struct lw_gl_lights *lights, const struct lw_pose *pose, struct lw_vec3 eye,
                         struct lw_vec3 forward, const struct lw_box *scene);

/** Lists those of the chosen lights that give more than `least` somewhere in a box, luminance, W/m^2.
 * out_light   LW_GL_LIGHTS_MAX numbers in the table */
uint32_t lw_gl_lights_near(const struct lw_gl_lights *lights, const struct lw_box *box, float least,
                           GLint *out_light);

#endif
