/* scene.h: the scene: meshes, materials, textures, nodes, objects, lights, cameras, animation.
 * Flow:    file -> importer -> [scene] -> lightmap UVs -> package -> daemon and clients
 * Threads: immutable once built or read; then [any] may read. scene_state.h makes one whose materials and sky
 *          change.
 * Space:   right-handed, +Y up, metres. Colours are linear sRGB. Winding is counter-clockwise seen from the
 *          front. */
#ifndef LW_COMMON_SCENE_H
#define LW_COMMON_SCENE_H

#include "common/base/status.h"
#include "common/base/vec.h"
#include "common/shading/lobes.h"

#include <stdint.h>

#define LW_SCENE_NONE UINT32_MAX /* "no texture", "no parent" */

/* Limits of a scene. Package reader and importer refuse a scene past them; the error names the limit. */
#define LW_SCENE_MESHES_MAX       (1u << 20)
#define LW_SCENE_OBJECTS_MAX      (1u << 20)
#define LW_SCENE_NODES_MAX        (1u << 21)
#define LW_SCENE_MATERIALS_MAX    (1u << 16)
#define LW_SCENE_TEXTURES_MAX     (1u << 14)
#define LW_SCENE_TEXTURE_SIDE_MAX 16384u
#define LW_SCENE_LIGHTS_MAX       (1u << 20)
#define LW_SCENE_CAMERAS_MAX      (1u << 16)
#define LW_SCENE_CHANNELS_MAX     (1u << 20)
#define LW_SCENE_TRIANGLES_MAX    (1u << 28) /* of all meshes together; of all objects together */
#define LW_SCENE_VERTICES_MAX     (1u << 28) /* in all meshes together; in all objects together */
#define LW_SCENE_TEXELS_MAX       (1u << 28) /* in the atlases of all objects together */
#define LW_SCENE_ATLAS_SIDE_MAX   16384u     /* texels */
#define LW_SCENE_COORDINATE_MAX   1e9f       /* m; positions, transforms and key values, either sign */
/* emission, intensity and sky, in their units; other factors too */
#define LW_SCENE_RADIANCE_MAX         1e12f
#define LW_SCENE_DURATION_MAX         1e9f  /* s */
#define LW_SCENE_ENVIRONMENT_SIDE_MAX 4096u /* texels, either way */

/* Meaning of the four bytes of a texel. */
enum lw_content {
    LW_CONTENT_COLOUR,  /* R, G, B sRGB; A linear, not premultiplied */
    LW_CONTENT_NORMAL,  /* R, G: x and y of a unit normal in tangent space, 127.5 (1 + x); B: z; A: 255 */
    LW_CONTENT_SURFACE, /* R occlusion, G roughness, B metalness, linear; A: 255 */
};

struct lw_texture {
    const char *name;
    uint32_t width, height;
    /* width*height*4, row 0 first (glTF: v = 0) */
    const uint8_t *rgba;
    uint8_t wrap_s, wrap_t; /* enum lw_wrap */
    uint8_t content;        /* enum lw_content; of textures of finishes. Else LW_CONTENT_COLOUR */
};
enum lw_wrap { LW_WRAP_REPEAT, LW_WRAP_CLAMP, LW_WRAP_MIRROR };

/** A texture as a material uses it: uv' = transform (2x3, row-major) of (u, v, 1) from UV set `uv_set`. */
struct lw_texture_use {
    uint32_t texture; /* index, or LW_SCENE_NONE */
    uint32_t uv_set;  /* 0 or 1 */
    float transform[6];
};

enum lw_alpha_mode {
    LW_ALPHA_OPAQUE,
    LW_ALPHA_MASK, /* a surface where alpha >= alpha_cutoff, else nothing */
    LW_ALPHA_BLEND /* lets the fraction 1 - alpha of light pass */
};

/** The file's choice of who draws a light's direct light: common/light/client_lights.h. */
enum lw_drawn_by { LW_DRAWN_BY_RULE /* nothing */, LW_DRAWN_BY_CLIENTS, LW_DRAWN_BY_SERVER };

/** Roughness, mirrored light and relief of a surface: glTF 2.0's metallic-roughness,
 * with KHR_materials_specular and KHR_materials_ior. Textures are of lw_scene.finish_texture. */
struct lw_finish {
    float metalness, roughness;            /* [0, 1]; times B and G of the texture */
    struct lw_texture_use surface_texture; /* LW_CONTENT_SURFACE */
    /* Reflectance of a dielectric: at normal incidence min(((ior - 1) / (ior + 1))^2 colour, 1) specular, at
     * grazing incidence specular. 0 and metalness 0: nothing, a matt surface. */
    float specular;                         /* [0, 1]; times A of the texture */
    float specular_colour[3];               /* >= 0; times R, G, B of the texture */
    struct lw_texture_use specular_texture; /* LW_CONTENT_COLOUR */
    float ior;                              /* >= 1 */
    /* A share 1 + strength (R - 1) of light from everywhere, tiles and sky, arrives. */
    float occlusion; /* [0, 1]: strength */
    struct lw_texture_use occlusion_texture;
    float normal_scale;                   /* a factor of x and y; any finite number */
    struct lw_texture_use normal_texture; /* LW_CONTENT_NORMAL */
};

/** Diffuse reflection base_colour/pi, plus emission. A single-sided surface reflects and emits from its
 * front. With a finish it also mirrors, and base_colour is the metal's, or that of the layer under the gloss.
 *
 * An unlit surface has the radiance of its base colour, 1 W/(m^2 sr) for 1, under any light. It reflects
 * nothing, and lights nothing. */
struct lw_material {
    const char *name;
    float base_colour[4]; /* albedo and alpha; times texture and vertex colour */
    struct lw_texture_use base_colour_texture;
    float emission[3]; /* W/(m^2 sr): factor x strength; times texture */
    struct lw_texture_use emission_texture;
    float alpha_cutoff;
    uint8_t alpha_mode; /* enum lw_alpha_mode */
    uint8_t double_sided;
    uint8_t drawn_by; /* enum lw_drawn_by */
    uint8_t unlit;    /* then emission is 0 */
    /* BLEND: factors of light that passes, on top of 1 - alpha; their luminance is 1. All 0: none */
    float tint[3];
    const struct lw_finish *finish; /* NULL: matt and even */
};

/** A triangle mesh in object space. Its lightmap UVs are shared by all objects that use it. */
struct lw_mesh {
    const char *name;
    uint32_t vertex_count, triangle_count;
    const struct lw_vec3 *position; /* m */
    const struct lw_vec3 *normal;   /* unit shading normals */
    const struct lw_vec2 *uv[2];    /* texture coordinates, or NULL for a set that is absent */
    const struct lw_vec4 *colour;   /* vertex colour times alpha, linear; or NULL for white */
    const uint32_t (*triangle)[3];  /* vertex indices */
    const uint32_t *material;       /* per triangle */
    /* For normal maps: 3 per triangle, one a corner (tangent.h); or NULL: no material has one */
    const uint16_t *tangent;

    /* Lightmap (common/lightmap/lightmap.h). Atlas coordinates are in texels: texel (i, j) has its centre at
     * (i + 0.5, j + 0.5). A mesh with double-sided triangles keeps the light of their backs in a second copy
     * of the chart layout, back_offset rows further down; back_offset = 0 if the mesh has no back. */
    const struct lw_vec2 *lightmap_uv;  /* per vertex; NULL before lw_lightmap_build() */
    uint32_t atlas_width, atlas_height; /* texels, multiples of 4, backs included */
    uint32_t back_offset;               /* rows, a multiple of 4 */
};

/** A place in the hierarchy. Parents come before their children. */
struct lw_node {
    const char *name;
    uint32_t parent; /* index < own, or LW_SCENE_NONE */
    /* local = matrix if has_matrix (then it cannot be animated), else T * R * S */
    float translation[3];
    float rotation[4]; /* unit quaternion x, y, z, w */
    float scale[3];
    struct lw_affine matrix;
    uint8_t has_matrix;
};

/** One instance of a mesh, with an atlas of its own. An object without a node is a spare: it is not in the
 * scene until it is added. */
struct lw_object {
    const char *name;
    uint32_t mesh;
    uint32_t node; /* or LW_SCENE_NONE */
};

enum lw_light_kind {
    LW_LIGHT_POINT,      /* W/sr per channel: E = I cos / d^2 */
    LW_LIGHT_SPOT,       /* W/sr on the axis; falls off as clamp((cos a - cos o) / (cos i - cos o))^2 */
    LW_LIGHT_DIRECTIONAL /* W/m^2 on a surface that faces it; shines along the node's -Z */
};

/** inner_cone / outer_cone of a spot whose file gives it no soft edge. */
#define LW_LIGHT_CONE_EDGE 0.99f

/** Punctual light. Emissive triangles are lights too, but live in their materials. */
struct lw_light {
    const char *name;
    uint32_t node;
    uint8_t kind;                 /* enum lw_light_kind */
    float intensity[3];           /* colour x intensity */
    float inner_cone, outer_cone; /* spot: half angles, radians; inner is the smaller */
    float angular_diameter;       /* directional: radians; 0 is a point at infinity */
    uint8_t drawn_by;             /* enum lw_drawn_by */
};

struct lw_camera {
    const char *name;
    uint32_t node;  /* looks along -Z, up is +Y */
    float fov_y;    /* radians; an orthographic camera has one for renderers that know only perspective */
    float height_m; /* height of an orthographic camera's view; 0: a perspective one */
};

/* The last two are of lights. */
enum lw_channel_path {
    LW_CHANNEL_TRANSLATION,
    LW_CHANNEL_ROTATION,
    LW_CHANNEL_SCALE,
    LW_CHANNEL_INTENSITY, /* instead of the light's own */
    LW_CHANNEL_FACTOR     /* times that */
};
enum lw_interpolation { LW_INTERPOLATION_STEP, LW_INTERPOLATION_LINEAR, LW_INTERPOLATION_CUBIC };

/** One animated property of a node or a light. Values: lw_channel_width() floats a key; CUBIC has in-tangent,
 * value, out-tangent per key. */
struct lw_channel {
    uint32_t node; /* or light */
    uint8_t path, interpolation;
    uint32_t key_count;
    const float *time_s; /* strictly increasing, first >= 0 */
    const float *value;
};

/** The environment by direction: an equirectangular picture. Row 0 is up (+Y), the middle of the picture is
 * +X: u = 0.5 + atan2(d.z, d.x) / 2 pi, v = acos(d.y) / pi, texel (i, j) has its centre at ((i + 0.5) /
 * width, (j + 0.5) / height). common/scene/environment.h reads it. */
struct lw_environment {
    uint32_t width, height; /* texels; 0: there is none */
    const float *rgb;       /* width * height * 3, row 0 first: W/(m^2 sr), linear */
};

struct lw_scene {
    const char *name;
    struct lw_mesh *mesh;
    struct lw_material *material;
    struct lw_texture *texture;
    struct lw_texture *finish_texture;
    struct lw_node *node;
    struct lw_object *object;
    struct lw_light *light;
    struct lw_camera *camera;
    struct lw_channel *channel;       /* moves nodes */
    struct lw_channel *light_channel; /* changes lights */
    uint32_t mesh_count, material_count, texture_count, node_count, object_count, light_count, camera_count,
        channel_count, light_channel_count, finish_texture_count;
    float duration_s; /* the animation's; it loops. 0: there is none */
    float sky[3];     /* W/(m^2 sr) from everywhere outside; the environment's comes on top */
    struct lw_environment environment;
    void *storage; /* owns every array above; see lw_scene_destroy() */
};

#ifdef __cplusplus
extern "C" {
#endif

/** An empty scene that allocates from itself. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_scene_create(struct lw_scene **out_scene);
void lw_scene_destroy(struct lw_scene *scene);

/** A copy of a scene that owns its materials and its sky, so that they may be changed. It shares everything
 * else with the original, which outlives it.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_scene_init_variant(struct lw_scene *variant, const struct lw_scene *original);
/** A zeroed one is fine. */
void lw_scene_finish_variant(struct lw_scene *variant);

/** Makes all materials matt and even: no finishes, none of their textures, no tangents. For builders only. */
void lw_scene_drop_finishes(struct lw_scene *scene);
bool lw_scene_has_finishes(const struct lw_scene *scene);
/** The same of an object's materials. */
bool lw_scene_object_has_finishes(const struct lw_scene *scene, uint32_t object);
/** Whether an object looks different by where light comes from: a material of it has a normal map, a texture
 * of roughness, or roughness under LW_SCENE_ROUGH. */
bool lw_scene_object_has_bumps(const struct lw_scene *scene, uint32_t object);
#define LW_SCENE_ROUGH 0.6f

/** Zeroed memory that lives as long as the scene, 16-byte aligned and readable for 16 bytes past its end
 * (vector loads of the last vertex); NULL when out of memory, never for count 0. For builders only. */
void *lw_scene_alloc(struct lw_scene *scene, size_t count, size_t size);
/** Copy of a string, owned by the scene; NULL becomes "". Returns NULL when out of memory. */
const char *lw_scene_string(struct lw_scene *scene, const char *text);

/** Adds an object to an array with room for it, in the name of its node or else of its mesh. For builders
 * only.
 * Errors: LW_BAD_DATA past LW_SCENE_OBJECTS_MAX. */
LW_MUST_CHECK enum lw_status lw_scene_add_object(struct lw_scene *scene, uint32_t mesh, uint32_t node,
                                                 struct lw_error *err);

/** Checks everything that other code relies on: counts, indices, order of nodes, finite numbers, unit
 * quaternions and normals (within 1 %), increasing key times, atlas sizes, names (UTF-8, never NULL), no
 * empty mesh. The package reader calls it, and importers before they write.
 * Errors: LW_BAD_DATA naming the element and field; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_scene_validate(const struct lw_scene *scene, struct lw_error *err);

/** Checks finishes and their textures alone: of a scene that was valid without. */
LW_MUST_CHECK enum lw_status lw_scene_validate_finishes(const struct lw_scene *scene, struct lw_error *err);

/** Floats of one value of a channel. */
static inline unsigned lw_channel_width(const struct lw_channel *channel) {
    return channel->path == LW_CHANNEL_ROTATION ? 4 : channel->path == LW_CHANNEL_FACTOR ? 1 : 3;
}

/** Whether light that passes is coloured. */
static inline bool lw_material_tints(const struct lw_material *m) {
    return m->tint[0] > 0 || m->tint[1] > 0 || m->tint[2] > 0;
}

/** Light that has passed a surface, 1 - alpha of it counted elsewhere. */
static inline struct lw_vec3 lw_material_tint(const struct lw_material *m, struct lw_vec3 light) {
    if (!lw_material_tints(m)) return light;
    return lw_vec3(light.x * m->tint[0], light.y * m->tint[1], light.z * m->tint[2]);
}

/** Whether surfaces of the material emit light. */
static inline bool lw_material_shines(const struct lw_material *m) {
    return m->emission[0] > 0 || m->emission[1] > 0 || m->emission[2] > 0;
}

/** Whether an object starts as a spare. */
static inline bool lw_scene_is_spare(const struct lw_scene *scene, uint32_t object) {
    return scene->object[object].node == LW_SCENE_NONE;
}

/** Whether anything shines: a light with intensity, an emissive triangle in an object, sky or environment. */
bool lw_scene_has_light(const struct lw_scene *scene);

/** Texture at (u, v) of a use, bilinear, wrapped, linear colour; white if there is no texture. [any] */
struct lw_vec4 lw_scene_sample(const struct lw_scene *scene, const struct lw_texture_use *use,
                               struct lw_vec2 uv);

/** The same of a texture of finishes; its bytes as lw_content has them. */
struct lw_vec4 lw_scene_sample_finish(const struct lw_scene *scene, const struct lw_texture_use *use,
                                      struct lw_vec2 uv);

/** z of a unit normal by its x and y: bytes of LW_CONTENT_NORMAL. 128 where these are longer than 1. */
uint8_t lw_scene_normal_blue(uint8_t red, uint8_t green);

/** Radiance that arrives from outside the scene: sky and environment, W/(m^2 sr). direction_ws: unit, where
 * one looks. */
struct lw_vec3 lw_scene_sky(const struct lw_scene *scene, struct lw_vec3 direction_ws);

/** A point on a mesh: barycentrics u, v weigh the triangle's 2nd and 3rd vertex. */
struct lw_surface {
    struct lw_vec3 position, normal; /* object space, interpolated; the normal is unit */
    struct lw_vec3 geometric_normal; /* object space, unit, by winding */
    /* Base colour x texture x vertex colour, in [0, 1]; unlit: 0. With a finish, what all lobes send back of
     * light from everywhere, mirrored light included: lw_lobes_albedo(). Bounces spread it evenly. */
    struct lw_vec3 albedo;
    struct lw_vec3 base;        /* the base colour there, in [0, 1] */
    float alpha;                /* in [0, 1]: 1 for OPAQUE; 1 or 0 for MASK, by alpha_cutoff */
    struct lw_vec3 emission;    /* W/(m^2 sr); unlit: its looks, and no light */
    struct lw_vec2 lightmap_uv; /* texels; of the front */
    const struct lw_material *material;
};
void lw_scene_surface(const struct lw_scene *scene, const struct lw_mesh *mesh, uint32_t triangle, float u,
                      float v, struct lw_surface *out);
/** Its albedo and alpha, and nothing else: the same bits. */
struct lw_vec3 lw_scene_albedo(const struct lw_scene *scene, const struct lw_mesh *mesh, uint32_t triangle,
                               float u, float v, float *out_alpha);
/** A triangle of a mesh, with the values that all its points share. Saves time for many points on few
 * triangles. */
struct lw_facet {
    const struct lw_mesh *mesh;
    const struct lw_material *material;
    uint32_t vertex[3];
    bool varies; /* false: the next four fields hold for every point */
    struct lw_vec3 albedo, base;
    float alpha;
    struct lw_vec3 emission;
    struct lw_vec2 lightmap_uv[3]; /* per corner */
    struct lw_vec2 uv[3];          /* for the base colour's texture */
};
void lw_scene_facet(const struct lw_scene *scene, const struct lw_mesh *mesh, uint32_t triangle,
                    struct lw_facet *out);

/** Weights of the corners at a point: 1 - u - v, u, v for barycentrics u, v. */
static inline struct lw_vec2 lw_scene_facet_mean(const struct lw_vec2 corner[3], const float weight[3]) {
    const float *w = weight;
    const struct lw_vec2 mean = {w[0] * corner[0].x + w[1] * corner[1].x + w[2] * corner[2].x,
                                 w[0] * corner[0].y + w[1] * corner[1].y + w[2] * corner[2].y};
    return mean;
}

/** The four texels that a bilinear look-up mixes, row by row. */
struct lw_texture_quad {
    const uint8_t *at[4]; /* the first one NULL: there is no texture */
    float x, y;           /* how far from the first to the second; from the first row to the second */
};

/** The texels that a point of a facet reads its base colour from. Prefetches them: find the texels of some
 * points first, then read their colours. */
void lw_scene_facet_texels(const struct lw_scene *scene, const struct lw_facet *facet, const float weight[3],
                           struct lw_texture_quad *out);
/** Albedo, alpha and emission at a point of a facet that varies, as in struct lw_surface; the rest of *out
 * stays. */
void lw_scene_facet_colour(const struct lw_scene *scene, const struct lw_facet *facet, const float weight[3],
                           const struct lw_texture_quad *texels, struct lw_surface *out);
/** The same without albedo, which stays. Emission is without the base colour of unlit surfaces. */
void lw_scene_facet_base(const struct lw_scene *scene, const struct lw_facet *facet, const float weight[3],
                         const struct lw_texture_quad *texels, struct lw_surface *out);

/** A specular texture of a finish at four of its texels. */
struct lw_vec4 lw_scene_specular_texel(const struct lw_scene *scene, const struct lw_finish *finish,
                                       const struct lw_texture_quad *texels);

/** Scattering of light at a point of a surface. */
struct lw_finish_point {
    struct lw_lobes lobes;
    float occlusion;        /* share of light from everywhere that arrives: [0, 1] */
    bool bumpy;             /* there is a normal map here */
    struct lw_vec3 bump;    /* its normal, in tangent space, unit, z > 0 */
    struct lw_vec4 tangent; /* object space, unit, not quite at right angles; glTF's w */
};
/** Without a finish it is matt: lobes.diffuse is the albedo. surface: lw_scene_surface() of that point. */
void lw_scene_finish(const struct lw_scene *scene, const struct lw_mesh *mesh, uint32_t triangle, float u,
                     float v, const struct lw_surface *surface, struct lw_finish_point *out);
/** The normal of a bumpy point. normal, tangent: world space or object space, the tangent of any length; both
 * on the front of the surface, where the map is not mirrored. Unit. */
struct lw_vec3 lw_scene_bump(const struct lw_finish_point *point, struct lw_vec3 normal,
                             struct lw_vec3 tangent);

/** The two normals alone, as in struct lw_surface: returns the shading normal. */
struct lw_vec3 lw_scene_normal(const struct lw_mesh *mesh, uint32_t triangle, float u, float v,
                               struct lw_vec3 *out_geometric);

/** The normal that light is gathered about: the shading normal, or the geometric one where the shading normal
 * points into the surface. Both unit, object space. */
static inline struct lw_vec3 lw_scene_light_normal(struct lw_vec3 shading, struct lw_vec3 geometric) {
    return lw_vec3_dot(shading, geometric) <= 0.01f ? geometric : shading;
}

/** Start of light rays on a smooth-shaded triangle, object space: above its flat face, on the curved
 * surface that the corners' normals describe. So a coarse mesh does not shade itself along its edges (Hanika,
 * Hacking the Shadow Terminator, in Ray Tracing Gems II, 2021):
 *     p + sum over corners of w_i k_i max(0, (v_i - p) . n_i) n_i
 *   w_i       barycentric weight
 *   v_i, n_i  the corner and its normal, turned over for the back
 *   k_i       falls from 1 to 0 between 41 and 60 degrees off the face: normals that lean farther smooth over
 *             a sharp edge, where lifted rays would start beyond a neighbouring surface
 * On flat and on hollow triangles it is the point itself. It is not lifted by a rounding error yet. Trace
 * also directions above the shading normal's plane but below the face. On a bulge they run over the
 * neighbouring faces. In a hollow they meet the own face from in front, as they would soon meet the true
 * surface. */
struct lw_vec3 lw_scene_shadow_origin(const struct lw_mesh *mesh, uint32_t triangle, float u, float v,
                                      bool back);

/** Alpha alone, for visibility, as in struct lw_surface. */
float lw_scene_alpha(const struct lw_scene *scene, const struct lw_mesh *mesh, uint32_t triangle, float u,
                     float v);

#ifdef __cplusplus
}
#endif

#endif
