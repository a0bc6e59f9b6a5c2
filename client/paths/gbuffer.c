#include "client/paths/gbuffer.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

#define TILE       32u /* pixels; the side of what a thread takes */
#define SQUARE     4u  /* pixels; the side of a packet */
#define LAYERS_MAX 16u /* as compose.h and path_trace.h have it */
#define PLANES     20u

/* A share of light that no picture shows. */
#define TRANSMITTANCE_MIN 1e-4f
/* Sine of the angle under which a surface is seen; below, it counts as this, which keeps slopes finite. */
#define SINE_MIN 1e-4f

_Static_assert(SQUARE *SQUARE == LW_TRACE_WIDTH, "a packet is a square of pixels");
_Static_assert(sizeof(struct lw_gbuffer_planes) == PLANES * sizeof(float *), "each plane gets its memory");

static void place3(float *plane[3], float **at, size_t pixels) {
    for (int c = 0; c < 3; c++, *at += pixels) plane[c] = *at;
}

static void place_planes(struct lw_gbuffer *g, size_t pixels) {
    float *at = g->memory;
    g->plane.depth = at, at += pixels;
    g->plane.slope[0] = at, at += pixels;
    g->plane.slope[1] = at, at += pixels;
    g->plane.apart = at, at += pixels;
    place3(g->plane.normal, &at, pixels);
    place3(g->plane.albedo, &at, pixels);
    place3(g->plane.emission, &at, pixels);
    place3(g->plane.before, &at, pixels);
    place3(g->plane.origin, &at, pixels);
}

enum lw_status lw_gbuffer_init(struct lw_gbuffer *gbuffer, const struct lw_gbuffer_desc *desc,
                               struct lw_error *err) {
    struct lw_gbuffer g = {.width = desc->width,
                           .height = desc->height,
                           .scene = desc->scene,
                           .trace = desc->trace,
                           .threads = desc->threads ? (int)desc->threads : omp_get_max_threads()};
    const size_t pixels = (size_t)g.width * g.height, objects = desc->scene->object_count;
    g.plane.object = calloc(pixels, sizeof *g.plane.object);
    g.memory = calloc(pixels * (PLANES - 1), sizeof *g.memory);
    g.from_eye = calloc(pixels, sizeof *g.from_eye);
    g.place = calloc(objects + 1, sizeof *g.place); /* one more: no objects is no failure */
    g.light = calloc((size_t)desc->scene->light_count + 1, sizeof *g.light);
    if (!g.plane.object || !g.memory || !g.from_eye || !g.place || !g.light) {
        lw_gbuffer_finish(&g);
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for the first hits of %ux%u pixels", desc->width,
                              desc->height);
    }
    place_planes(&g, pixels);
    *gbuffer = g;
    return LW_OK;
}

void lw_gbuffer_finish(struct lw_gbuffer *gbuffer) {
    free(gbuffer->light);
    free(gbuffer->place);
    free(gbuffer->from_eye);
    free(gbuffer->memory);
    free(gbuffer->plane.object);
    *gbuffer = (struct lw_gbuffer){0};
}

static bool is_same_light(const struct lw_light_state *a, const struct lw_light_state *b) {
    return memcmp(a, b, sizeof *a) == 0;
}

/* Compares with the render before and remembers this one. */
static void compare_with_last(struct lw_gbuffer *g, const struct lw_pose *pose,
                              const struct lw_camera_view *camera) {
    bool still = g->started && memcmp(camera, &g->camera, sizeof *camera) == 0;
    for (uint32_t o = 0; o < g->scene->object_count; o++) {
        struct lw_gbuffer_place *place = &g->place[o];
        const struct lw_affine *now = &pose->object_to_world[o];
        place->before = g->started ? place->now.to_world : *now;
        place->now = lw_place_of(now);
        place->moved = memcmp(now, &place->before, sizeof *now) != 0;
        still &= !place->moved;
    }
    for (uint32_t l = 0; l < g->scene->light_count; l++) {
        still &= is_same_light(&pose->light[l], &g->light[l]);
        g->light[l] = pose->light[l];
    }
    g->camera = *camera;
    g->still = still;
    g->started = true;
}

/* Sums of a pixel over the layers in front of it. */
struct pixel {
    struct lw_vec3 albedo, emission;
    float transmittance;
    struct lw_vec3 tint; /* tint of the light through the layers so far */
    float weight;        /* the weight of the layer below: how much of its own reflection reaches the eye */
    uint32_t object;
    float depth, slope[2], apart;
    struct lw_vec3 normal, before, origin;
    bool from_eye;
};

static void store3(float *const plane[3], size_t at, struct lw_vec3 v) {
    plane[0][at] = v.x, plane[1][at] = v.y, plane[2][at] = v.z;
}

static void store(const struct lw_gbuffer *g, size_t at, const struct pixel *pixel) {
    const struct lw_gbuffer_planes *p = &g->plane;
    g->from_eye[at] = pixel->from_eye;
    p->object[at] = pixel->object;
    p->depth[at] = pixel->depth;
    p->slope[0][at] = pixel->slope[0];
    p->slope[1][at] = pixel->slope[1];
    p->apart[at] = pixel->apart;
    store3(p->normal, at, pixel->normal);
    store3(p->albedo, at, pixel->albedo);
    store3(p->emission, at, pixel->emission);
    store3(p->before, at, pixel->before);
    store3(p->origin, at, pixel->origin);
}

static const struct lw_mesh *mesh_of(const struct lw_gbuffer *g, uint32_t object) {
    return &g->scene->mesh[g->scene->object[object].mesh];
}

/* Makes a surface the one that a pixel is about.
 *
 * A plane n . x = d (x from the eye) is seen along the ray `middle + right i - up j` at depth d / (n . ray):
 * the inverse of depth is linear in the pixel. A point off by D in that inverse is d D z off the plane; a
 * pixel there is z `pixel` wide. In an orthographic view depth itself is linear in the pixel; the slope of
 * its inverse is that at the pixel. */
static void write_pixel(const struct lw_gbuffer *g, const struct lw_camera_plane *plane,
                        const struct lw_ray16 *rays, const struct lw_hit16 *hits, unsigned i,
                        const struct lw_surface *surface, const struct lw_place_point *point,
                        struct lw_vec3 normal, struct pixel *pixel) {
    const struct lw_vec3 direction = lw_vec3(rays->dir_x[i], rays->dir_y[i], rays->dir_z[i]),
                         origin = lw_vec3(rays->org_x[i], rays->org_y[i], rays->org_z[i]);
    const struct lw_gbuffer_place *place = &g->place[hits->object[i]];
    const struct lw_vec3 face = point->face;
    const float along = lw_vec3_dot(face, direction), length = lw_vec3_length(direction);
    const float sine = fabsf(along) > SINE_MIN * length ? along : copysignf(SINE_MIN * length, along);
    pixel->object = hits->object[i];
    pixel->depth = 1 / hits->t[i];
    const float steep = (plane->parallel ? pixel->depth : 1) / sine * pixel->depth;
    pixel->slope[0] = lw_vec3_dot(face, plane->parallel ? plane->across : plane->right) * steep;
    pixel->slope[1] = -lw_vec3_dot(face, plane->parallel ? plane->along : plane->up) * steep;
    pixel->apart = fabsf(sine) * hits->t[i] * hits->t[i] / lw_camera_pixel_at(plane, hits->t[i]);
    pixel->normal = normal;
    pixel->origin = point->origin;
    struct lw_vec3 now = lw_vec3_mad(origin, direction, hits->t[i]);
    pixel->before = place->moved ? lw_affine_point(&place->before, surface->position) : now;
}

/* Takes in one hit; true if the ray goes on behind it. */
static bool shade_hit(const struct lw_gbuffer *g, const struct lw_camera_plane *plane,
                      const struct lw_ray16 *rays, const struct lw_hit16 *hits, unsigned i, bool last,
                      struct pixel *pixel) {
    struct lw_vec3 direction = lw_vec3(rays->dir_x[i], rays->dir_y[i], rays->dir_z[i]);
    if (hits->object[i] == LW_TRACE_MISS) {
        struct lw_vec3 sky = lw_scene_sky(g->scene, lw_vec3_normalize(direction));
        pixel->emission = lw_vec3_mad(pixel->emission, lw_vec3_mul(sky, pixel->tint), pixel->transmittance);
        return false;
    }
    struct lw_surface surface;
    const struct lw_mesh *mesh = mesh_of(g, hits->object[i]);
    const struct lw_place *place = &g->place[hits->object[i]].now;
    lw_scene_surface(g->scene, mesh, hits->triangle[i], hits->u[i], hits->v[i], &surface);
    const struct lw_place_point point = lw_place_point(place, mesh, hits, i, &surface);
    struct lw_vec3 albedo = surface.albedo, normal = point.normal;
    struct lw_place_gloss gloss;
    if (surface.material->finish && lw_place_gloss(place, g->scene, mesh, hits, i, &surface, &point,
                                                   lw_vec3_scale(lw_vec3_normalize(direction), -1), &gloss)) {
        albedo = lw_lobes_seen_albedo(&gloss.seen);
        normal = gloss.normal;
        pixel->from_eye = true;
    }
    const bool blend = surface.material->alpha_mode == LW_ALPHA_BLEND && !last;
    const float share = pixel->transmittance * (blend ? surface.alpha : 1.0f);
    pixel->albedo = lw_vec3_mad(pixel->albedo, lw_vec3_mul(albedo, pixel->tint), share);
    pixel->emission = lw_vec3_mad(pixel->emission, lw_vec3_mul(surface.emission, pixel->tint), share);
    const float weight = share * (albedo.x + albedo.y + albedo.z);
    if (weight > pixel->weight) {
        pixel->weight = weight;
        write_pixel(g, plane, rays, hits, i, &surface, &point, normal, pixel);
    }
    pixel->transmittance -= share;
    pixel->tint = lw_material_tint(surface.material, pixel->tint);
    pixel->from_eye |= blend;
    return blend && pixel->transmittance > TRANSMITTANCE_MIN;
}

static void render_square(const struct lw_gbuffer *g, const struct lw_camera_plane *plane, uint32_t x,
                          uint32_t y) {
    struct lw_ray16 rays = {.salt = 0};
    struct pixel pixel[LW_TRACE_WIDTH];
    uint16_t active = 0;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        const uint32_t px = x + i % SQUARE, py = y + i / SQUARE;
        if (px < g->width && py < g->height) active |= (uint16_t)(1u << i);
        const float middle_x = (float)px + 0.5f, middle_y = (float)py + 0.5f;
        lw_trace_set_ray(&rays, i, lw_camera_origin(plane, middle_x, middle_y),
                         lw_camera_direction(plane, middle_x, middle_y), INFINITY);
        pixel[i] = (struct pixel){.transmittance = 1, .tint = {1, 1, 1}, .object = LW_TRACE_MISS};
    }
    uint16_t going = active;
    for (unsigned layer = 1; going; layer++) {
        struct lw_hit16 hits;
        uint16_t go_on = 0;
        lw_trace_closest16(g->trace, LW_TRACE_VIEW | LW_TRACE_COHERENT, going, &rays, &hits);
        for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
            if (!(going >> i & 1u) || !shade_hit(g, plane, &rays, &hits, i, layer == LAYERS_MAX, &pixel[i]))
                continue;
            /* Past the hit by more than its rounding in any packet. */
            rays.t_near[i] = hits.t[i] * (1.0f + 4e-6f) + 1e-7f;
            go_on |= (uint16_t)(1u << i);
        }
        going = go_on;
    }
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++)
        if (active >> i & 1u) store(g, (size_t)(y + i / SQUARE) * g->width + x + i % SQUARE, &pixel[i]);
}

void lw_gbuffer_render(struct lw_gbuffer *gbuffer, const struct lw_pose *pose,
                       const struct lw_camera_view *camera) {
    compare_with_last(gbuffer, pose, camera);
    const struct lw_camera_plane plane = lw_camera_plane(camera, gbuffer->width, gbuffer->height);
    const uint32_t columns = (gbuffer->width + TILE - 1) / TILE, rows = (gbuffer->height + TILE - 1) / TILE;
#pragma omp parallel for schedule(dynamic) num_threads(gbuffer->threads)
    for (uint32_t t = 0; t < columns * rows; t++) {
        const uint32_t left = t % columns * TILE, top = t / columns * TILE;
        for (uint32_t y = top; y < top + TILE && y < gbuffer->height; y += SQUARE)
            for (uint32_t x = left; x < left + TILE && x < gbuffer->width; x += SQUARE)
                render_square(gbuffer, &plane, x, y);
    }
}

enum lw_status lw_gbuffer_init_thin(struct lw_gbuffer *thin, const struct lw_gbuffer *full, uint32_t step,
                                    struct lw_error *err) {
    enum lw_status status =
        lw_gbuffer_init(thin,
                        &(struct lw_gbuffer_desc){.scene = full->scene,
                                                  .trace = full->trace,
                                                  .width = (full->width + step - 1) / step,
                                                  .height = (full->height + step - 1) / step,
                                                  .threads = (unsigned)full->threads},
                        err);
    if (status == LW_OK)
        thin->lattice =
            (struct lw_gbuffer_lattice){.step = step, .width = full->width, .height = full->height};
    return status;
}

/* Pixels of the lattice are step times as wide: slopes per pixel are steeper by that, and less is a pixel's
 * breadth. */
static void thin_row(const struct lw_gbuffer *thin, const struct lw_gbuffer *full, uint32_t row) {
    const struct lw_gbuffer_lattice *l = &thin->lattice;
    const struct lw_gbuffer_planes *to = &thin->plane, *from = &full->plane;
    const float step = (float)l->step, narrower = 1 / step;
    const uint32_t y = row * l->step + l->y < full->height ? row * l->step + l->y : full->height - 1;
    for (uint32_t column = 0; column < thin->width; column++) {
        const uint32_t x = column * l->step + l->x < full->width ? column * l->step + l->x : full->width - 1;
        const size_t at = (size_t)row * thin->width + column, of = (size_t)y * full->width + x;
        to->object[at] = from->object[of];
        to->depth[at] = from->depth[of];
        for (int c = 0; c < 2; c++) to->slope[c][at] = step * from->slope[c][of];
        to->apart[at] = narrower * from->apart[of];
        for (int c = 0; c < 3; c++) {
            to->normal[c][at] = from->normal[c][of];
            to->albedo[c][at] = from->albedo[c][of];
            to->emission[c][at] = from->emission[c][of];
            to->before[c][at] = from->before[c][of];
            to->origin[c][at] = from->origin[c][of];
        }
        thin->from_eye[at] = full->from_eye[of];
    }
}

void lw_gbuffer_thin(struct lw_gbuffer *thin, const struct lw_gbuffer *full, uint32_t x, uint32_t y) {
    thin->still = full->still && thin->lattice.x == x && thin->lattice.y == y;
    thin->camera = full->camera;
    thin->lattice.x = x;
    thin->lattice.y = y;
#pragma omp parallel for schedule(static) num_threads(full->threads)
    for (uint32_t row = 0; row < thin->height; row++) thin_row(thin, full, row);
}

struct lw_camera_plane lw_gbuffer_aim(const struct lw_gbuffer *g) {
    const struct lw_gbuffer_lattice *l = &g->lattice;
    if (!l->step) return lw_camera_plane(&g->camera, g->width, g->height);
    struct lw_camera_plane plane = lw_camera_plane(&g->camera, l->width, l->height);
    const float step = (float)l->step;
    plane.right = lw_vec3_scale(plane.right, step);
    plane.up = lw_vec3_scale(plane.up, step);
    plane.across = lw_vec3_scale(plane.across, step);
    plane.along = lw_vec3_scale(plane.along, step);
    plane.half_width = (plane.half_width - (float)l->x - 0.5f) / step + 0.5f;
    plane.half_height = (plane.half_height - (float)l->y - 0.5f) / step + 0.5f;
    plane.pixel *= step;
    return plane;
}
