/** @file lightwell.h
 * liblightwell: the live light of a scene from a lightwelld, for your own renderer.
 *
 *     struct lw_live_desc desc = {0};
 *     desc.struct_size = sizeof desc;
 *     desc.host = "127.0.0.1";
 *     struct lw_live *live;
 *     struct lw_live_error err;
 *     if (lw_live_open(&desc, &live, &err) != LW_LIVE_OK) die(err.text);
 *     every frame: lw_live_poll(live, 0, &err), then lw_live_take_dirty() and
 *     lw_live_read() for texels that changed
 *
 * For C11 and C++11, and later ones. Units: metres, W/m^2, W/(m^2 sr), linear sRGB; right-handed, +Y up.
 * Matrices that are "row-major 3x4" transform columns: p' = m[.][0..2] p + m[.][3].
 *
 * Structs: a struct that begins with struct_size has its version by that: set it to sizeof before the call.
 * Later versions add fields at the end; a library that is newer or older than the program reads and writes
 * the fields that both know. A field of 0 in a struct that you fill is the default.
 *
 * Errors: each function that can fail returns a status and puts one line for people into *err, which may be
 * NULL; its outputs stay as they were. LW_LIVE_USAGE is for a call that is wrong in itself: a NULL, a
 * struct_size that no version had, an index that is out of range.
 *
 * Threads: calls for one lw_live come from one thread at a time, unless it has LW_LIVE_THREAD: then from any.
 * Different ones do not know each other. No function calls back.
 *
 * Memory: once the scene is there and all levels have arrived, lw_live_poll() and the functions for every
 * frame (they say so) allocate nothing, unless the server sends a message that is longer than all before, or
 * tiles of finer levels, which come and go. */
#ifndef LIGHTWELL_LIGHTWELL_H
#define LIGHTWELL_LIGHTWELL_H

#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
/** Marks what the library exports. */
#define LW_LIVE_API __attribute__((visibility("default")))
/** The result is a status, to be checked. */
#define LW_LIVE_CHECK __attribute__((warn_unused_result))
#else
#define LW_LIVE_API
#define LW_LIVE_CHECK
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define LW_LIVE_NONE      UINT32_MAX /**< "No such thing", and "all" where a function says so. */
#define LW_LIVE_WANT_MAX  4096u      /**< Tiles that a client can want one by one. */
#define LW_LIVE_TILE_SIDE 64u        /**< Texels: light arrives in squares of this side. */
#define LW_LIVE_VIEWS_MAX 8u         /**< Views of one call of lw_live_want_views(). */
#define LW_LIVE_FINER     64u        /**< Level LW_LIVE_FINER + k has both sides of level 0 times 2^k. */
#define LW_LIVE_SLOTS_MAX 1024u      /**< Tiles of such levels that a client can read at a time. */

/** Result of a call. */
enum lw_live_status {
    LW_LIVE_OK = 0,
    LW_LIVE_USAGE = 1,       /**< The call is not allowed, or its arguments are wrong. */
    LW_LIVE_BAD_DATA = 2,    /**< The server's scene makes no sense. */
    LW_LIVE_NO_HOST = 3,     /**< The host's name is unknown. */
    LW_LIVE_UNAVAILABLE = 4, /**< Nobody serves there, or the server refuses. */
    LW_LIVE_INTERNAL = 5,    /**< A defect of the library. */
    LW_LIVE_NO_MEMORY = 6,   /**< Out of memory. */
    LW_LIVE_SYSTEM = 7,      /**< The operating system refused something. */
    LW_LIVE_TIMED_OUT = 8,   /**< The server is silent. */
    LW_LIVE_PROTOCOL = 9,    /**< The peer is no lightwelld, or of another version, or sends nonsense. */
    LW_LIVE_CLOSED = 10,     /**< The session is over. */
    LW_LIVE_NOT_READY = 11,  /**< The scene has not arrived yet. */
    LW_LIVE_NOT_ALLOWED =
        12, /**< The server refuses the token, or wants one; or TLS could not verify the server. */
    /** The server lights another scene now. The scene before is forgotten: its indices and pointers, and
     * your interest in it. The new scene comes with the next calls of lw_live_poll(), or of
     * lw_live_reconnect(). */
    LW_LIVE_OTHER_SCENE = 13
};

/** A failure with its detail. A call that succeeds leaves it alone. */
struct lw_live_error {
    enum lw_live_status status; /**< Never LW_LIVE_OK after a failure. */
    char text[512];             /**< One line: names the address, field or argument. */
};

/** The words of a status, such as "out of memory"; never NULL. [any] */
LW_LIVE_API const char *lw_live_status_text(enum lw_live_status status);
/** The library's version, such as "0.1.0". [any] */
LW_LIVE_API const char *lw_live_version(void);

/* ---- the session ---- */

/** A live copy of the light of a server's scene. */
struct lw_live;

#define LW_LIVE_THREAD        1u   /**< A thread of the library's own receives, decodes and connects again. */
#define LW_LIVE_WANTS_NOTHING 2u   /**< Until a call of lw_live_want_*(); else it wants everything. */
#define LW_LIVE_DRAWS_DIRECT  4u   /**< You draw the direct light of what is_client_light marks. */
#define LW_LIVE_CONTROL       8u   /**< You may call lw_live_change(). */
#define LW_LIVE_AS_IT_IS      16u  /**< lw_live_read() gives texels as they came: see there. */
#define LW_LIVE_TLS           32u  /**< By TLS 1.3; the server's certificate must be for `host`. */
#define LW_LIVE_TLS_INSECURE  64u  /**< By TLS, without a check of the server's identity. For tests. */
#define LW_LIVE_MATERIALS     128u /**< You want finishes of materials: enum lw_live_finishes. */
#define LW_LIVE_DIRECTIONS    256u /**< You want to know where light comes from: LW_LIVE_DIRECTION. */

/** Options of a session. */
struct lw_live_desc {
    size_t struct_size;       /**< sizeof(struct lw_live_desc) */
    const char *host;         /**< Name or address; NULL: "127.0.0.1". */
    uint16_t port;            /**< 0: 7780. */
    uint32_t flags;           /**< LW_LIVE_*, added up. */
    const char *name;         /**< For the server's log; NULL: "liblightwell". */
    uint32_t timeout_ms;      /**< For connecting and for the server's welcome; 0: 5000. */
    uint32_t budget_us;       /**< lw_live_poll() takes nothing more in after this; 0: 2000. */
    const char *cache_folder; /**< Keeps scene packages, so that none is downloaded twice; NULL: none. */
    uint64_t rate_limit_bytes_per_s; /**< The server sends no more; 0: all that the link takes. */
    /* so far in 0.1.0 */
    const char *token; /**< 64 hexadecimal digits; NULL: none. Copied. */
    const char
        *ca_file; /**< With LW_LIVE_TLS: a server's certificate, or its issuer's; NULL: the system's. */
    /** Tiles of finer levels that your pool has room for (lw_live_take_slots()), up to LW_LIVE_SLOTS_MAX;
     * 0: you read no finer levels. */
    uint32_t finer_slots;
};

/** Connects, and returns once the server has welcomed us; the scene and its light come with lw_live_poll().
 * Errors: LW_LIVE_NO_HOST, LW_LIVE_UNAVAILABLE, LW_LIVE_TIMED_OUT, LW_LIVE_PROTOCOL,
 * LW_LIVE_NOT_ALLOWED, each naming the address; LW_LIVE_USAGE naming the field. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status
lw_live_open(const struct lw_live_desc *desc, struct lw_live **out_live, struct lw_live_error *err);

/** Ends the session and frees all that came from it. With LW_LIVE_THREAD it waits for the thread, which may
 * be connecting: up to timeout_ms. NULL is fine. */
LW_LIVE_API void lw_live_close(struct lw_live *live);

/** Takes in messages, for budget_us at most; the next call takes the rest. Waits up to timeout_ms if there
 * are none. The call in which the scene is complete reads it, which takes longer: the
 * atrium's 0.13 s. For every frame.
 *
 * With LW_LIVE_THREAD the thread does that: the call waits up to timeout_ms for something new since the last
 * call, and returns whether the session is alive.
 * Errors: LW_LIVE_CLOSED, LW_LIVE_TIMED_OUT, LW_LIVE_PROTOCOL, LW_LIVE_SYSTEM, LW_LIVE_NO_MEMORY. Scene and
 * light stay readable, and lw_live_reconnect() goes on. With LW_LIVE_THREAD only what connecting again
 * cannot mend, and LW_LIVE_OTHER_SCENE, once: then go on polling, as after lw_live_open(). */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_poll(struct lw_live *live, uint32_t timeout_ms,
                                                           struct lw_live_error *err);

/** Connects again after lw_live_poll() has failed. Scene, light and interest stay; a server that still runs
 * sends the tiles that changed since. Wait lw_live_backoff_ms() before each attempt.
 * Errors: as lw_live_open(); LW_LIVE_OTHER_SCENE, once: call it again; LW_LIVE_USAGE with LW_LIVE_THREAD,
 * which does it by itself. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_reconnect(struct lw_live *live,
                                                                struct lw_live_error *err);

/** Time to wait before attempt 0, 1, ... to connect again, in ms. It is random, from a range that grows to
 * 500..1000, so that the clients of a server do not all connect at once. seed: differs from client to client.
 * [any] */
LW_LIVE_API uint32_t lw_live_backoff_ms(uint32_t attempt, uint32_t seed);

/** File descriptor that an event loop of your own may watch for reading, before lw_live_poll(live, 0, ...);
 * -1 with LW_LIVE_THREAD. */
LW_LIVE_API int lw_live_descriptor(const struct lw_live *live);

/** Finishes of materials: roughness, mirrored light, relief. They come after the first
 * light, once a scene. */
enum lw_live_finishes {
    LW_LIVE_FINISHES_NONE = 0,   /**< None will come: without LW_LIVE_MATERIALS, or all is matt. */
    LW_LIVE_FINISHES_COMING = 1, /**< Until they are there all is matt. */
    LW_LIVE_FINISHES_THERE = 2   /**< lw_live_get_material(), _mesh() and _finish_texture() have them. */
};
/** State of the session. */
struct lw_live_stats {
    size_t struct_size;     /**< sizeof(struct lw_live_stats) */
    int is_connected;       /**< 0 while the link is broken. */
    int has_scene;          /**< The scene is there: lw_live_get_scene() and the rest work. */
    int has_light;          /**< Every object has light, if only of its coarsest level. */
    float package_progress; /**< Fraction of the scene that has arrived, 0..1. */
    uint64_t frame;         /**< The newest frame heard of. */
    uint64_t settled_frame; /**< The newest frame of which all wanted tiles have arrived. */
    double time_s;          /**< Scene time of the newest frame. */
    uint64_t changed_frame; /**< The last frame that changed a material, the sky or a hidden object. */
    uint64_t session;       /**< Counts connections, from 1 on: is_client_light may differ after it grew. */
    uint64_t tiles;         /**< Received. */
    uint64_t bytes;         /**< Received. */
    uint64_t decode_ns;     /**< Spent on decoding tiles. */
    uint64_t light_age_ns;  /**< Solve time of the newest frame, plus the time since it arrived. */
    uint32_t dirty_tiles;   /**< Tiles that lw_live_take_dirty() would give. */
    uint32_t bounces;       /**< Indirect bounces of a complete tile. */
    float target_error;     /**< Relative standard error below which a tile counts as converged. */
    enum lw_live_finishes finishes; /**< When it changes to THERE, ask for meshes and materials again. */
};
/** Fills in where the session stands. For every frame. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status
lw_live_get_stats(const struct lw_live *live, struct lw_live_stats *out_stats, struct lw_live_error *err);

/** Stage of a server before its first light. */
enum lw_live_waiting {
    LW_LIVE_WAITING_UNKNOWN = 0,        /**< It has not said: an older server, or nothing has come yet. */
    LW_LIVE_WAITING_PLACING_TEXELS = 1, /**< It places texels on surfaces. */
    LW_LIVE_WAITING_LOOKING_INSIDE = 2, /**< It looks for texels that lie inside objects. */
    LW_LIVE_WAITING_FIRST_LIGHT = 3,    /**< It lights its first frame. */
    LW_LIVE_WAITING_READY = 4           /**< There is light, and it is on its way, or here. */
};
/** Why there is no light yet, as the server said last. It says so after it was asked for the scene, at most
 * five times a second, until it is READY; it says nothing of the time before it listens. A session keeps
 * READY; a new one (lw_live_reconnect()) begins with UNKNOWN again. For every frame, before has_light.
 * live       NULL: UNKNOWN
 * out_share  of that stage, 0..1, which never falls within a stage; NULL is fine */
LW_LIVE_API enum lw_live_waiting lw_live_get_waiting(const struct lw_live *live, float *out_share);
/** Its words, such as "looking inside objects"; never NULL. [any] */
LW_LIVE_API const char *lw_live_waiting_text(enum lw_live_waiting waiting);

/* ---- the scene: all LW_LIVE_NOT_READY before it has arrived; then pointers live
 * as long as the session ---- */

/** Counts of the scene's parts. */
struct lw_live_scene {
    size_t struct_size;            /**< sizeof(struct lw_live_scene) */
    const char *name;              /**< Never NULL, as all names. */
    uint32_t object_count;         /**< Instances of meshes. */
    uint32_t mesh_count;           /**< Meshes. */
    uint32_t node_count;           /**< Nodes of the hierarchy. */
    uint32_t material_count;       /**< Materials. */
    uint32_t texture_count;        /**< Textures. */
    uint32_t light_count;          /**< Punctual lights. */
    uint32_t camera_count;         /**< Cameras. */
    float duration_s;              /**< The animation's length; it loops. 0: there is none. */
    float sky[3];                  /**< W/(m^2 sr) from everywhere outside, as of the newest frame. */
    uint32_t environment_width;    /**< Texels; 0: no environment. */
    uint32_t environment_height;   /**< Texels. */
    const float *environment;      /**< RGB, W/(m^2 sr), equirectangular: row 0 is up, the middle +X. */
    uint32_t finish_texture_count; /**< Textures of finishes; 0 until these are there. */
};
/** Counts what the scene has. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status
lw_live_get_scene(const struct lw_live *live, struct lw_live_scene *out_scene, struct lw_live_error *err);

/** Kinds of things that have names. */
enum lw_live_kind {
    LW_LIVE_KIND_OBJECT = 0,   /**< By the object's own name: its node's, or else its mesh's. */
    LW_LIVE_KIND_NODE = 1,     /**< Nodes. */
    LW_LIVE_KIND_MESH = 2,     /**< Meshes. */
    LW_LIVE_KIND_MATERIAL = 3, /**< Materials. */
    LW_LIVE_KIND_TEXTURE = 4,  /**< Textures. */
    LW_LIVE_KIND_LIGHT = 5,    /**< Lights. */
    LW_LIVE_KIND_CAMERA = 6    /**< Cameras. */
};
/** Finds things by name: the nth (0, 1, ...) of those that share it, in the scene's order, or
 * LW_LIVE_NONE, also before the scene is there. Names are as in the file that the server lights;
 * several things may share one. */
LW_LIVE_API uint32_t lw_live_find(const struct lw_live *live, enum lw_live_kind kind, const char *name,
                                  uint32_t nth);

/** Current state of an object. */
enum lw_live_object_state {
    LW_LIVE_OBJECT_SHOWN = 0,  /**< It is there. */
    LW_LIVE_OBJECT_HIDDEN = 1, /**< No ray meets it. */
    LW_LIVE_OBJECT_SPARE = 2   /**< It stands nowhere and may be added: LW_LIVE_CHANGE_OBJECT_ADD. */
};
/** One instance of a mesh, with a lightmap of its own. */
struct lw_live_object {
    size_t struct_size;              /**< sizeof(struct lw_live_object) */
    const char *name;                /**< Its node's name, or else its mesh's. */
    uint32_t mesh;                   /**< Index. */
    uint32_t node;                   /**< Index, or LW_LIVE_NONE: a spare. */
    uint32_t level_count;            /**< Mip levels of its lightmap; 0: it has none. */
    enum lw_live_object_state state; /**< As of the newest frame. */
    int is_drawn;                    /**< 0: do not draw it now: hidden, a spare, or not lit yet. */
    float object_to_world[12];       /**< Row-major 3x4, as of the newest frame. */
};
/** An object as it is now. For every frame. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_get_object(const struct lw_live *live, uint32_t object,
                                                                 struct lw_live_object *out_object,
                                                                 struct lw_live_error *err);

/** A triangle mesh in object space; it never changes. */
struct lw_live_mesh {
    size_t struct_size;       /**< sizeof(struct lw_live_mesh) */
    const char *name;         /**< Its name. */
    uint32_t vertex_count;    /**< Vertices. */
    uint32_t triangle_count;  /**< Triangles, counter-clockwise seen from the front. */
    const float *position;    /**< 3 per vertex, m. */
    const float *normal;      /**< 3 per vertex, unit. */
    const float *uv[2];       /**< 2 per vertex, or NULL for a set that is absent. */
    const float *colour;      /**< 4 per vertex, linear, a factor of base colour and alpha; NULL: white. */
    const uint32_t *triangle; /**< 3 vertices per triangle. */
    const uint32_t *material; /**< 1 per triangle. */
    const float *lightmap_uv; /**< 2 per vertex, in texels of level 0; a texel's centre is at .5. */
    uint32_t atlas_width;     /**< Texels of level 0; 0: no lightmap. */
    uint32_t atlas_height;    /**< Texels of level 0, backs included. */
    uint32_t back_offset;     /**< Added to v it gives the light of a triangle's back; 0: no backs. */
    /** 3 per triangle, of its corners, for normal maps; NULL: none, or not yet. lw_live_tangent() decodes
     * one. */
    const uint16_t *tangent;
};
/** A mesh. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_get_mesh(const struct lw_live *live, uint32_t mesh,
                                                               struct lw_live_mesh *out_mesh,
                                                               struct lw_live_error *err);

/** The tangent of a corner, from lw_live_mesh.tangent: unit, at right angles to the corner's normal, along a
 * normal map's u. The map's v is along w normal x tangent.
 * normal: 3, unit. out_tangent: 4: x, y, z, and w = 1 or -1. */
LW_LIVE_API void lw_live_tangent(uint16_t code, const float *normal, float *out_tangent);

/** A place in the hierarchy. */
struct lw_live_node {
    size_t struct_size; /**< sizeof(struct lw_live_node) */
    const char *name;   /**< Its name. */
    uint32_t parent;    /**< Index, smaller than the node's own; or LW_LIVE_NONE. */
};
/** A node. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_get_node(const struct lw_live *live, uint32_t node,
                                                               struct lw_live_node *out_node,
                                                               struct lw_live_error *err);

/** A texture as a material uses it. */
struct lw_live_texture_use {
    uint32_t texture;   /**< Index, or LW_LIVE_NONE. */
    uint32_t uv_set;    /**< 0 or 1. */
    float transform[6]; /**< Row-major 2x3, of (u, v, 1). */
};
/** Use of alpha by a material. */
enum lw_live_alpha {
    LW_LIVE_ALPHA_OPAQUE = 0, /**< Nothing. */
    LW_LIVE_ALPHA_MASK = 1,   /**< Below alpha_cutoff there is no surface. */
    LW_LIVE_ALPHA_BLEND = 2   /**< The fraction 1 - alpha of light passes. */
};
/** Diffuse reflection base_colour / pi, and emission. */
struct lw_live_material {
    size_t struct_size;                             /**< sizeof(struct lw_live_material) */
    const char *name;                               /**< Its name. */
    float base_colour[4];                           /**< Albedo and alpha, as of the newest frame. */
    float emission[3];                              /**< W/(m^2 sr), as of the newest frame. */
    float first_emission[3];                        /**< Emission at the start of the scene. */
    struct lw_live_texture_use base_colour_texture; /**< A factor. */
    struct lw_live_texture_use emission_texture;    /**< A factor. */
    enum lw_live_alpha alpha;                       /**< Use of alpha. */
    float alpha_cutoff;                             /**< With LW_LIVE_ALPHA_MASK. */
    int is_double_sided;                            /**< It reflects and shines on both sides. */
    int is_client_light; /**< The direct light of its triangles is yours to draw: it is in no texel. */
    int is_unlit;        /**< Seen as base_colour, W/(m^2 sr), in place of base_colour / pi * E. */
    float tint[3];       /**< LW_LIVE_ALPHA_BLEND: 1 - alpha of light passes, times this; 1 is no colour. */
    /** 0: matt and even, or finishes are not there yet. Else what follows is metallic-roughness of glTF 2.0
     * with KHR_materials_specular and KHR_materials_ior, textures that follow are those of
     * lw_live_get_finish_texture(), and base_colour is the colour of the metal, or of the layer under the
     * gloss. */
    int has_finish;
    float metalness;                              /**< 0..1; times B of surface_texture. */
    float roughness;                              /**< 0..1; times G of surface_texture. */
    struct lw_live_texture_use surface_texture;   /**< LW_LIVE_CONTENT_SURFACE. */
    float specular;                               /**< 0..1; times A of specular_texture. */
    float specular_colour[3];                     /**< From 0 on; times R, G, B of specular_texture. */
    struct lw_live_texture_use specular_texture;  /**< LW_LIVE_CONTENT_COLOUR. */
    float ior;                                    /**< From 1 on. */
    float occlusion;                              /**< 0..1: of E, 1 + occlusion (R - 1) arrives. */
    struct lw_live_texture_use occlusion_texture; /**< LW_LIVE_CONTENT_SURFACE. */
    float normal_scale;                           /**< A factor of the map's x and y, of any sign. */
    struct lw_live_texture_use normal_texture;    /**< LW_LIVE_CONTENT_NORMAL. */
};
/** A material as it is now. For every frame. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_get_material(const struct lw_live *live,
                                                                   uint32_t material,
                                                                   struct lw_live_material *out_material,
                                                                   struct lw_live_error *err);

/** Texture beyond its edges. */
enum lw_live_wrap {
    LW_LIVE_WRAP_REPEAT = 0, /**< Again. */
    LW_LIVE_WRAP_CLAMP = 1,  /**< With its last texel. */
    LW_LIVE_WRAP_MIRROR = 2  /**< Again, mirrored. */
};
/** Meaning of the four bytes of a texel. */
enum lw_live_content {
    LW_LIVE_CONTENT_COLOUR = 0, /**< sRGB colour, linear alpha, not premultiplied. */
    LW_LIVE_CONTENT_NORMAL = 1, /**< x, y, z of a unit normal in tangent space, 127.5 (1 + x); 255. */
    LW_LIVE_CONTENT_SURFACE = 2 /**< Occlusion, roughness, metalness, linear; 255. */
};
/** A picture. */
struct lw_live_texture {
    size_t struct_size;           /**< sizeof(struct lw_live_texture) */
    const char *name;             /**< Its name. */
    uint32_t width;               /**< Texels. */
    uint32_t height;              /**< Texels. */
    const uint8_t *rgba;          /**< Row 0 is v = 0; what they are says content. */
    enum lw_live_wrap wrap_s;     /**< In u. */
    enum lw_live_wrap wrap_t;     /**< In v. */
    enum lw_live_content content; /**< LW_LIVE_CONTENT_COLOUR but of finishes. */
};
/** A texture of finishes; there are lw_live_scene.finish_texture_count of them: 0 before these are there. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_get_finish_texture(const struct lw_live *live,
                                                                         uint32_t texture,
                                                                         struct lw_live_texture *out_texture,
                                                                         struct lw_live_error *err);
/** A texture. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_get_texture(const struct lw_live *live,
                                                                  uint32_t texture,
                                                                  struct lw_live_texture *out_texture,
                                                                  struct lw_live_error *err);

/** Kinds of lights. */
enum lw_live_light_kind {
    LW_LIVE_LIGHT_POINT = 0, /**< intensity in W/sr: E = I cos / d^2. */
    LW_LIVE_LIGHT_SPOT =
        1, /**< The same on its axis; clamp((cos a - cos o) / (cos i - cos o))^2 beside it. */
    LW_LIVE_LIGHT_DIRECTIONAL = 2 /**< intensity in W/m^2 on a surface that faces it. */
};
/** A light. */
struct lw_live_light {
    size_t struct_size;           /**< sizeof(struct lw_live_light) */
    const char *name;             /**< Its name. */
    enum lw_live_light_kind kind; /**< What it is. */
    float position_ws[3];         /**< m; not of a directional light. */
    float direction_ws[3];        /**< Unit, where it shines; not of a point light. */
    float intensity[3];           /**< As of the newest frame. */
    float inner_cone;             /**< Spot: half angle, radians. */
    float outer_cone;             /**< Spot: half angle, radians. */
    float angular_diameter;       /**< Directional: radians. */
    int is_client_light;          /**< Its direct light is yours to draw: it is in no texel. */
};
/** A light as it is now. For every frame. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_get_light(const struct lw_live *live, uint32_t light,
                                                                struct lw_live_light *out_light,
                                                                struct lw_live_error *err);

/** A camera of the scene, at the newest frame's time. */
struct lw_live_camera {
    size_t struct_size;   /**< sizeof(struct lw_live_camera) */
    const char *name;     /**< Its name. */
    float position_ws[3]; /**< m */
    float right_ws[3];    /**< Unit; right, up and forward are orthogonal. */
    float up_ws[3];       /**< Unit. */
    float forward_ws[3];  /**< Unit. */
    float fov_y;          /**< Radians. */
    float height_m;       /**< Height that an orthographic camera sees, which has no fov_y; 0: perspective. */
};
/** A camera. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_get_camera(const struct lw_live *live, uint32_t camera,
                                                                 struct lw_live_camera *out_camera,
                                                                 struct lw_live_error *err);

/* ---- light ---- */

/** Texels of one level of one object's lightmap. Its layout is for ever. */
struct lw_live_rect {
    uint32_t object; /**< Index. */
    uint32_t level;  /**< 0: the finest that is always there; or LW_LIVE_FINER + k. */
    uint32_t x;      /**< Texels from the left. */
    uint32_t y;      /**< Texels from row 0. */
    uint32_t width;  /**< Texels. */
    uint32_t height; /**< Texels. */
};

/** The whole of a level, as a rectangle: each level halves both sides of the one before, rounding up. Levels
 * above LW_LIVE_FINER are those of lw_live_get_finer().
 * Errors: LW_LIVE_USAGE for an object or level that is not there; LW_LIVE_UNAVAILABLE for a finer level that
 * the server does not light; LW_LIVE_NOT_READY. For every frame. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_get_level(const struct lw_live *live, uint32_t object,
                                                                uint32_t level, struct lw_live_rect *out_rect,
                                                                struct lw_live_error *err);

/** Takes rectangles whose texels have changed since they were last taken, oldest first;
 * neighbours come as one. The rest stays for the next call, so that you decide how much a frame
 * uploads. Finer levels are left to lw_live_take_slots(). For every frame.
 *
 * object      of this one alone, or LW_LIVE_NONE: of all
 * level       of this one alone, or LW_LIVE_NONE: of all
 * texels_max  stop before there are more, but take one rectangle at least; 0: no limit
 * out_rect    room for `capacity` of them
 * Returns how many there are in out_rect. */
LW_LIVE_API size_t lw_live_take_dirty(struct lw_live *live, uint32_t object, uint32_t level,
                                      uint64_t texels_max, struct lw_live_rect *out_rect, size_t capacity);

/** For GPU textures. */
enum lw_live_format {
    LW_LIVE_RGB9E5 = 0,  /**< 4 bytes a texel: GL_RGB9_E5, VK_FORMAT_E5B9G9R9_UFLOAT_PACK32. Up to 65408. */
    LW_LIVE_RGBA16F = 1, /**< 8 bytes: halves, alpha 1. Up to 65504. */
    LW_LIVE_RGB32F = 2,  /**< 12 bytes. */
    LW_LIVE_RGBA32F = 3  /**< 16 bytes, alpha 1. */
};
/** Quantity of a texel. */
enum lw_live_quantity {
    LW_LIVE_IRRADIANCE = 0,         /**< E, W/m^2: radiance is albedo / pi x E. */
    LW_LIVE_IRRADIANCE_OVER_PI = 1, /**< E / pi: radiance is albedo times it. */
    /** Direction of the light of E, with LW_LIVE_DIRECTIONS: r, x, y and z, world space, 1 long at most.
     * docs/baking.md, "Directions", makes E of a bumped normal of it. 0: not known. It
     * stays so until the direction arrives. The server has none of objects that look the same without, or of
     * any object. Not in LW_LIVE_RGB9E5, which has no sign. scale is not used. */
    LW_LIVE_DIRECTION = 2
};
/** Memory and format for lw_live_read(). */
struct lw_live_texels {
    size_t struct_size;             /**< sizeof(struct lw_live_texels) */
    enum lw_live_format format;     /**< A texel's format. */
    enum lw_live_quantity quantity; /**< What it says. */
    float scale;                    /**< Multiplies each value, for scenes beyond the format; 0: 1. */
    void *dst;                      /**< Row 0 of the rectangle first. */
    size_t dst_size;                /**< Bytes. */
    size_t row_size;                /**< Bytes from a row to the next; 0: rows lie without gaps. */
};
/** Writes the texels of a rectangle. For every frame.
 *
 * Where nothing has arrived at that level the texels are interpolated from the finest coarser one that is
 * there, and where a tile is still noisy from level 1 or 2, whose texels are means: a texture is whole
 * from the first level on. Texels that change so are dirty like texels that arrive. With LW_LIVE_AS_IT_IS
 * texels are as they came, and 0 where none did. A finer level without a tile there is read from level 0,
 * interpolated, with and without the flag.
 * Errors: LW_LIVE_USAGE for a rectangle beyond its level or a dst_size that is too small;
 *         LW_LIVE_UNAVAILABLE as lw_live_get_level(); LW_LIVE_NOT_READY. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_read(const struct lw_live *live,
                                                           const struct lw_live_rect *rect,
                                                           const struct lw_live_texels *texels,
                                                           struct lw_live_error *err);

/** Irradiance at a point of an object's lightmap, W/m^2, bilinear in level 0 as
 * lw_live_read() gives it. For every frame.
 * lightmap_uv: 2, in texels of level 0. out_rgb: 3.
 * Errors: LW_LIVE_USAGE for an object without lightmap; LW_LIVE_NOT_READY. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_sample(const struct lw_live *live, uint32_t object,
                                                             const float *lightmap_uv, float *out_rgb,
                                                             struct lw_live_error *err);

/** Hit of a ray. */
struct lw_live_hit {
    size_t struct_size;   /**< sizeof(struct lw_live_hit) */
    uint32_t object;      /**< Index; LW_LIVE_NONE: it meets nothing. */
    uint32_t triangle;    /**< Triangle of the object's mesh. */
    float distance;       /**< In lengths of the direction. */
    float position_ws[3]; /**< m */
    float lightmap_uv[2]; /**< For lw_live_sample(): of the side that the ray meets, if it has light. */
};
/** Follows a ray to the nearest triangle of the drawn objects, whatever its alpha. It looks at every
 * triangle of each object whose box the ray meets: for a few points, not for pictures.
 * origin_ws, direction_ws: 3 each; m.
 * Errors: LW_LIVE_USAGE for numbers that are not finite, or no direction; LW_LIVE_NOT_READY. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_cast(const struct lw_live *live, const float *origin_ws,
                                                           const float *direction_ws,
                                                           struct lw_live_hit *out_hit,
                                                           struct lw_live_error *err);

/* ---- interest: the server lights and sends the tiles that its clients want, and their contributors ---- */

/** One view that you draw. */
struct lw_live_view {
    size_t struct_size; /**< sizeof(struct lw_live_view) */
    float view_projection
        [16];        /**< World to clip space, column by column: clip = M (x, y, z, 1). Any depth range. */
    uint32_t width;  /**< The picture's width, pixels. */
    uint32_t height; /**< The picture's height, pixels. */
};
/** Wants the tiles in these views, some around them, and those of the last two seconds' views, each at the
 * level that a texture look-up reads there. Beyond LW_LIVE_WANT_MAX tiles all are wanted coarser. It knows
 * the frustum alone: tiles behind a wall count. Until the next call of lw_live_want_*(). For every frame.
 *
 * With finer_slots it also wants tiles of finer levels, where texels of level 0 are larger than four pixels
 * and light changes within a texel. Opaque surfaces hide such tiles. They are at most
 * finer_slots: where the views show more, all are wanted coarser. Views without perspective want none. To
 * find them takes milliseconds, at most four times a second, in lw_live_poll() or on the library's thread.
 *
 * view   the second lies view[0].struct_size bytes behind the first
 * count  up to LW_LIVE_VIEWS_MAX; 0: nothing is wanted
 * Errors: LW_LIVE_USAGE for a matrix that is not finite, or a picture without pixels. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_want_views(struct lw_live *live,
                                                                 const struct lw_live_view *view,
                                                                 size_t count, struct lw_live_error *err);
/** Wants the tiles that these rectangles touch, and no others; more than
 * LW_LIVE_WANT_MAX of them: everything, but no tile of a finer level.
 *
 * With a tile of a finer level the tiles of level 0 and of coarser levels below it are wanted. Some finer
 * tiles may be left out for a frame or two, while others are given up: call it each frame.
 * Errors: LW_LIVE_USAGE for one that is beyond its level, and for more than finer_slots
 *         tiles of finer levels; LW_LIVE_UNAVAILABLE as lw_live_get_level(); LW_LIVE_NOT_READY
 *         unless count is 0; LW_LIVE_NO_MEMORY. After an error the former wish stays. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_want_rects(struct lw_live *live,
                                                                 const struct lw_live_rect *rect,
                                                                 size_t count, struct lw_live_error *err);
/** Wants every tile, as a new session does, but none of a finer level. */
LW_LIVE_API void lw_live_want_everything(struct lw_live *live);

/* ---- finer levels: tiles that are lit where a client asks for them, in a pool of yours ---- */

/** Finer levels of the server. */
struct lw_live_finer {
    size_t struct_size;     /**< sizeof(struct lw_live_finer) */
    uint32_t level_count;   /**< Levels LW_LIVE_FINER + 1 and so on; 0: none, see lw_live_get_finer(). */
    uint32_t slot_count;    /**< finer_slots of the lw_live_desc. */
    uint32_t slots_used;    /**< Slots with a tile, after the last lw_live_take_slots(). */
    uint32_t slots_waiting; /**< Slots that later lw_live_take_slots() report; 0: none. */
    uint64_t page_count;    /**< Tiles of finer levels of all objects: the size of a page table. */
};
/** Tells of finer levels. level_count is 0 before the scene is there, with finer_slots 0, and where the
 * server lights no finer levels: an older one, one with --detail 0, a relay. All other calls work as without
 * finer levels. It may change when stats.session grows. For every frame.
 * Errors: LW_LIVE_USAGE. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status
lw_live_get_finer(const struct lw_live *live, struct lw_live_finer *out_finer, struct lw_live_error *err);

/** Tiles of one finer level of one object in a page table: at first + row * columns + column. */
struct lw_live_pages {
    size_t struct_size; /**< sizeof(struct lw_live_pages) */
    uint64_t first;     /**< Page of the tile at texel (0, 0); pages count through all objects. */
    uint32_t columns;   /**< Tiles side by side. */
    uint32_t rows;      /**< Tiles on top of each other. */
};
/** The pages of a level LW_LIVE_FINER + k of an object; they never change.
 * Errors: LW_LIVE_USAGE for a level that has none; else as lw_live_get_level(). */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_get_pages(const struct lw_live *live, uint32_t object,
                                                                uint32_t level,
                                                                struct lw_live_pages *out_pages,
                                                                struct lw_live_error *err);

/** Change of one slot of your pool. Its layout is for ever. */
struct lw_live_slot {
    uint32_t slot;       /**< Its number, below finer_slots. */
    uint32_t has_texels; /**< 1: lw_live_read() `rect` into the slot now. 0: its texels stay. */
    uint64_t page;       /**< The page of the tile: lw_live_get_pages(). */
    /** The tile, at (x, y), of at most LW_LIVE_TILE_SIDE texels a side, with the column to its right and
     * the row below it, which the tiles beside it begin with. The right and the lower edge of the level have
     * no border. So a bilinear look-up reads one slot: that of the tile which holds its upper left texel. */
    struct lw_live_rect rect;
    /** 0..1: the share of the tile over coarser light. 0 without has_texels: the tile is gone, and the slot
     * free. */
    float share;
};
/** Takes the changes of slots since the last call, in this order. A tile that is wanted and has arrived
 * gets a slot, and keeps it until the tile goes. A tile goes when the server drops it, when it is too
 * noisy, or when it is no longer wanted. Its share falls to 0 while the slot keeps its texels. Shares move
 * by 1 in a quarter of a second. The next call has the remaining changes. For every frame, before you
 * draw.
 *
 * now_ns      of a clock of yours, growing, above 0; 0: tiles come and go at once
 * tiles_max   limit of entries with has_texels; 0: no limit
 * out_slot    room for `capacity` entries; a slot has two at most in a call
 * Returns the number of entries in out_slot. */
LW_LIVE_API size_t lw_live_take_slots(struct lw_live *live, uint64_t now_ns, size_t tiles_max,
                                      struct lw_live_slot *out_slot, size_t capacity);

/* ---- changing the scene ---- */

/** Kinds of changes. In brackets: the target, and the number of values. */
enum lw_live_change_kind {
    LW_LIVE_CHANGE_OBJECT_TRANSFORM = 1,     /**< Object to world, row-major 3x4 [object, 12]. */
    LW_LIVE_CHANGE_OBJECT_RESTORE = 2,       /**< Where the scene has it, and shown [object, 0]. */
    LW_LIVE_CHANGE_OBJECT_HIDE = 3,          /**< No ray meets it [object, 0]. */
    LW_LIVE_CHANGE_OBJECT_SHOW = 4,          /**< It is there again [object, 0]. */
    LW_LIVE_CHANGE_LIGHT_INTENSITY = 5,      /**< RGB in the light's own unit [light, 3]. */
    LW_LIVE_CHANGE_LIGHT_POSITION = 6,       /**< m, world space [light, 3]. */
    LW_LIVE_CHANGE_LIGHT_DIRECTION = 7,      /**< Where it shines, of any length [light, 3]. */
    LW_LIVE_CHANGE_LIGHT_RESTORE = 8,        /**< As the scene has it [light, 0]. */
    LW_LIVE_CHANGE_MATERIAL_BASE_COLOUR = 9, /**< Factor, 0..1; alpha stays [material, 3]. */
    LW_LIVE_CHANGE_MATERIAL_EMISSION = 10,   /**< Factor, W/(m^2 sr) [material, 3]. */
    LW_LIVE_CHANGE_MATERIAL_RESTORE = 11,    /**< As the scene has it [material, 0]. */
    LW_LIVE_CHANGE_SKY = 12,                 /**< W/(m^2 sr) from everywhere outside [0, 3]. */
    LW_LIVE_CHANGE_SKY_RESTORE = 13,         /**< As the scene has it [0, 0]. */
    LW_LIVE_CHANGE_CLOCK_PAUSE = 14,         /**< The animation holds [0, 0]. */
    LW_LIVE_CHANGE_CLOCK_PLAY = 15,          /**< It goes on [0, 0]. */
    LW_LIVE_CHANGE_CLOCK_SEEK = 16,          /**< Seconds of the animation [0, 1]. */
    LW_LIVE_CHANGE_CLOCK_RATE = 17,          /**< Seconds of animation per second [0, 1]. */
    LW_LIVE_CHANGE_RESET = 18,               /**< All as at the start [0, 0]. */
    LW_LIVE_CHANGE_OBJECT_ADD = 19,   /**< A spare of the mesh stands there: object to world [mesh, 12]. */
    LW_LIVE_CHANGE_OBJECT_REMOVE = 20 /**< It becomes a spare [object, 0]. */
};
/** One change. */
struct lw_live_change {
    size_t struct_size;            /**< sizeof(struct lw_live_change) */
    enum lw_live_change_kind kind; /**< What it does. */
    uint32_t target;               /**< Index of the object, light, material or mesh; else 0. */
    float value[12];               /**< As many as the kind has. */
};
/** Changes the scene for everybody: all of these in one frame, or none. change[1] lies change[0].struct_size
 * bytes behind change[0]; count is up to 1024. out_request may be NULL: the number that the answer carries.
 * Errors: LW_LIVE_UNAVAILABLE where the server takes none from here (it wants LW_LIVE_CONTROL and its own
 * machine); LW_LIVE_TIMED_OUT while 1024 are unanswered or the link is busy: poll, then try again;
 * LW_LIVE_USAGE; LW_LIVE_CLOSED. */
LW_LIVE_CHECK LW_LIVE_API enum lw_live_status lw_live_change(struct lw_live *live,
                                                             const struct lw_live_change *change,
                                                             size_t count, uint64_t *out_request,
                                                             struct lw_live_error *err);

/** Result of a call of lw_live_change(). */
struct lw_live_answer {
    size_t struct_size;    /**< sizeof(struct lw_live_answer) */
    uint64_t request;      /**< Its number. */
    uint32_t code;         /**< 0: done; else refused as a whole. */
    uint32_t change;       /**< The first one that is wrong, from 0. */
    uint64_t frame;        /**< The first one that shows it; 0: refused. */
    const char *text;      /**< One line for people, empty if it was done; valid until the next call. */
    const uint32_t *added; /**< The object of each LW_LIVE_CHANGE_OBJECT_ADD; valid until the next call. */
    size_t added_count;    /**< How many. */
};
/** Takes the next answer; returns 0 if there is none, or struct_size is wrong. Each change that was sent gets
 * one, unless the link breaks first. Call it from one thread at a time. */
LW_LIVE_API int lw_live_next_answer(struct lw_live *live, struct lw_live_answer *out_answer);

#ifdef __cplusplus
}
#endif

#endif
