#include "client/view/shading/gloss_maps.h"

#include "common/base/colour.h"
#include "common/base/wide.h"

#include <string.h>

#define WIDTH    LW_GLOSS_WIDTH
#define MAPS     5 /* a material's */
#define SHORT2   1e-30f
#define IS_IN(i) (lanes >> (i)&1u)

LW_WIDE_INLINE float least(float a, float b) { return a < b ? a : b; }
LW_WIDE_INLINE float most(float a, float b) { return a > b ? a : b; }
LW_WIDE_INLINE float inside(float x, float low, float high) { return least(most(x, low), high); }

/* Texel coordinates of lanes, and how far they are to the next texels. */
struct places16 {
    _Alignas(64) uint32_t at[4][WIDTH]; /* texels: a row after the other */
    float x[WIDTH], y[WIDTH];
};

/* As surface.c's reduce(): finite or not, the outcome is within one period. */
LW_WIDE_INLINE float reduce(float u, enum lw_wrap wrap) {
    const float in = wrap == LW_WRAP_REPEAT   ? u - floorf(u)
                     : wrap == LW_WRAP_MIRROR ? u - 2 * floorf(u * 0.5f)
                                              : inside(u, 0, 1);
    return inside(in, 0, wrap == LW_WRAP_MIRROR ? 2 : 1);
}

/* As surface.c's wrap_index(). */
LW_WIDE_INLINE int wrapped(int i, int side, enum lw_wrap wrap) {
    const int period = wrap == LW_WRAP_MIRROR ? 2 * side : side;
    const int around = i + (period & -(i < 0)) - (period & -(i >= period)); /* no branch */
    const int held = i < 0 ? 0 : i, inner = held >= side ? side - 1 : held;
    if (wrap == LW_WRAP_CLAMP) return inner;
    return wrap == LW_WRAP_MIRROR && around >= side ? 2 * side - 1 - around : around;
}

/* Along one axis: the texel before a place, the one behind it, and how far on from the first it is. */
struct axis16 {
    _Alignas(64) int low[WIDTH], high[WIDTH];
    float share[WIDTH];
};

/* wrap: a constant, so that nothing branches */
LW_WIDE_INLINE void find_axis(const float *restrict m, int side, enum lw_wrap wrap, const float *restrict u,
                              const float *restrict v, struct axis16 *restrict out) {
    const float a = m[0], b = m[1], c = m[2];
    for (unsigned i = 0; i < WIDTH; i++) {
        const float x = reduce(a * u[i] + b * v[i] + c, wrap) * (float)side - 0.5f;
        const int cut = (int)x, low = cut - ((float)cut > x); /* towards 0, but the floor is wanted */
        out->low[i] = wrapped(low, side, wrap), out->high[i] = wrapped(low + 1, side, wrap);
        out->share[i] = x - (float)low;
    }
}

LW_WIDE static void find_repeated(const float *m, int side, const float *u, const float *v,
                                  struct axis16 *out) {
    find_axis(m, side, LW_WRAP_REPEAT, u, v, out);
}
LW_WIDE static void find_mirrored(const float *m, int side, const float *u, const float *v,
                                  struct axis16 *out) {
    find_axis(m, side, LW_WRAP_MIRROR, u, v, out);
}
LW_WIDE static void find_held(const float *m, int side, const float *u, const float *v, struct axis16 *out) {
    find_axis(m, side, LW_WRAP_CLAMP, u, v, out);
}

static void find_along(const float *m, uint32_t side, uint8_t wrap, const float *u, const float *v,
                       struct axis16 *out) {
    switch ((enum lw_wrap)wrap) {
    case LW_WRAP_REPEAT:
        find_repeated(m, (int)side, u, v, out);
        break;
    case LW_WRAP_MIRROR:
        find_mirrored(m, (int)side, u, v, out);
        break;
    case LW_WRAP_CLAMP:
        find_held(m, (int)side, u, v, out);
        break;
    }
}

LW_WIDE static void cross_axes(const struct axis16 *restrict x, const struct axis16 *restrict y, int width,
                               struct places16 *restrict out) {
    for (unsigned i = 0; i < WIDTH; i++) {
        const int upper = y->low[i] * width, lower = y->high[i] * width;
        out->at[0][i] = (uint32_t)(upper + x->low[i]), out->at[1][i] = (uint32_t)(upper + x->high[i]);
        out->at[2][i] = (uint32_t)(lower + x->low[i]), out->at[3][i] = (uint32_t)(lower + x->high[i]);
        out->x[i] = x->share[i], out->y[i] = y->share[i];
    }
}

/* A texture as a material uses it, and where that is read. */
struct found {
    const struct lw_texture *texture;
    const struct lw_texture_use *use;
    struct places16 place;
};

/* The maps that a material has been found to have. */
struct finds {
    struct found map[MAPS];
    unsigned count;
};

static bool is_same_place(const struct found *a, const struct lw_texture *texture,
                          const struct lw_texture_use *use) {
    const struct lw_texture *t = a->texture;
    return t->width == texture->width && t->height == texture->height && t->wrap_s == texture->wrap_s &&
           t->wrap_t == texture->wrap_t && a->use->uv_set == use->uv_set &&
           memcmp(a->use->transform, use->transform, sizeof use->transform) == 0;
}

static const struct places16 *find(struct finds *all, const struct lw_texture *texture,
                                   const struct lw_texture_use *use, const struct lw_gloss_uv16 *uv) {
    for (unsigned k = 0; k < all->count; k++)
        if (is_same_place(&all->map[k], texture, use)) return &all->map[k].place;
    struct found *next = &all->map[all->count++];
    next->texture = texture, next->use = use;
    const float *u = uv->u[use->uv_set], *v = uv->v[use->uv_set];
    struct axis16 x, y;
    find_along(use->transform, texture->width, texture->wrap_s, u, v, &x);
    find_along(use->transform + 3, texture->height, texture->wrap_t, u, v, &y);
    cross_axes(&x, &y, (int)texture->width, &next->place);
    return &next->place;
}

static bool is_same_map(const struct lw_texture_use *a, const struct lw_texture_use *b) {
    return a->texture == b->texture && a->uv_set == b->uv_set &&
           memcmp(a->transform, b->transform, sizeof a->transform) == 0;
}

/* Starts to fetch a texture's texels: those of all maps are on their way before the first is waited for. */
static void prefetch(struct finds *finds, const struct lw_texture *all, const struct lw_texture_use *use,
                     const struct lw_gloss_uv16 *uv, uint16_t lanes) {
    if (use->texture == LW_SCENE_NONE) return;
    const struct lw_texture *texture = &all[use->texture];
    const struct places16 *place = find(finds, texture, use, uv);
    for (uint32_t left = lanes; left; left &= left - 1) {
        const unsigned i = (unsigned)__builtin_ctz(left);
        __builtin_prefetch(texture->rgba + 4ul * place->at[0][i]);
        __builtin_prefetch(texture->rgba + 4ul * place->at[2][i]);
    }
}

static void prefetch_all(struct finds *finds, const struct lw_scene *scene,
                         const struct lw_material *material, unsigned what, const struct lw_gloss_uv16 *uv,
                         uint16_t lanes) {
    const struct lw_finish *f = material->finish;
    const struct lw_texture *maps = scene->finish_texture;
    if (what & LW_GLOSS_MAPS_BASE) prefetch(finds, scene->texture, &material->base_colour_texture, uv, lanes);
    prefetch(finds, maps, &f->surface_texture, uv, lanes);
    if (f->occlusion > 0 && !is_same_map(&f->occlusion_texture, &f->surface_texture))
        prefetch(finds, maps, &f->occlusion_texture, uv, lanes);
    if (what & LW_GLOSS_MAPS_BUMPS) prefetch(finds, maps, &f->normal_texture, uv, lanes);
    prefetch(finds, maps, &f->specular_texture, uv, lanes);
}

static void fetch(const struct lw_texture *texture, const struct places16 *place, uint16_t lanes,
                  struct lw_gloss_texels16 *out) {
    for (uint32_t left = lanes; left; left &= left - 1) {
        const unsigned i = (unsigned)__builtin_ctz(left);
        for (int k = 0; k < 4; k++) memcpy(&out->at[k][i], texture->rgba + 4ul * place->at[k][i], 4);
        out->x[i] = place->x[i], out->y[i] = place->y[i];
    }
}

LW_WIDE static void copy(const struct lw_gloss_texels16 *restrict from, unsigned lanes,
                         struct lw_gloss_texels16 *restrict to) {
    for (unsigned k = 0; k < 4; k++)
        for (unsigned i = 0; i < WIDTH; i++) to->at[k][i] = IS_IN(i) ? from->at[k][i] : to->at[k][i];
    for (unsigned i = 0; i < WIDTH; i++) to->x[i] = IS_IN(i) ? from->x[i] : to->x[i];
    for (unsigned i = 0; i < WIDTH; i++) to->y[i] = IS_IN(i) ? from->y[i] : to->y[i];
}

static void take_map(struct finds *finds, const struct lw_scene *scene, const struct lw_texture_use *use,
                     const struct lw_gloss_uv16 *uv, uint16_t lanes, struct lw_gloss_texels16 *out) {
    if (use->texture == LW_SCENE_NONE) return;
    const struct lw_texture *texture = &scene->finish_texture[use->texture];
    fetch(texture, find(finds, texture, use, uv), lanes, out);
}

/* Takes a specular texture, whose texels are colours. */
static void take_specular(struct finds *finds, const struct lw_scene *scene, const struct lw_finish *finish,
                          const struct lw_gloss_uv16 *uv, uint16_t lanes, struct lw_gloss16 *g) {
    const struct lw_texture *texture = &scene->finish_texture[finish->specular_texture.texture];
    const struct places16 *place = find(finds, texture, &finish->specular_texture, uv);
    for (uint32_t left = lanes; left; left &= left - 1) {
        const unsigned i = (unsigned)__builtin_ctz(left);
        struct lw_texture_quad quad = {.x = place->x[i], .y = place->y[i]};
        for (int k = 0; k < 4; k++) quad.at[k] = texture->rgba + 4ul * place->at[k][i];
        const struct lw_vec4 texel = lw_scene_specular_texel(scene, finish, &quad);
        g->specular[i] *= texel.w;
        g->dielectric[0][i] *= texel.x, g->dielectric[1][i] *= texel.y, g->dielectric[2][i] *= texel.z;
    }
}

/* A base colour's texels, mixed and tinted. */
LW_WIDE static void read_base(const float *restrict factor, const struct lw_gloss_texels16 *restrict t,
                              unsigned lanes, float (*restrict base)[WIDTH]) {
    const float *linear = lw_colour_srgb8_table;
    for (unsigned c = 0; c < 3; c++)
        for (unsigned i = 0; i < WIDTH; i++) {
            const float a0 = linear[t->at[0][i] >> 8 * c & 255u], a1 = linear[t->at[1][i] >> 8 * c & 255u],
                        b0 = linear[t->at[2][i] >> 8 * c & 255u], b1 = linear[t->at[3][i] >> 8 * c & 255u];
            const float a = a0 + t->x[i] * (a1 - a0), b = b0 + t->x[i] * (b1 - b0);
            const float colour = inside(factor[c] * (a + t->y[i] * (b - a)), 0, 1);
            base[c][i] = IS_IN(i) ? colour : base[c][i];
        }
}

static void take_base(struct finds *finds, const struct lw_scene *scene, const struct lw_material *material,
                      const struct lw_gloss_uv16 *uv, uint16_t lanes, float base[3][WIDTH]) {
    const struct lw_texture_use *use = &material->base_colour_texture;
    struct lw_gloss_texels16 texels;
    memset(&texels, use->texture == LW_SCENE_NONE ? 255 : 0, sizeof texels.at);
    memset(texels.x, 0, sizeof texels.x), memset(texels.y, 0, sizeof texels.y);
    if (use->texture != LW_SCENE_NONE) {
        const struct lw_texture *texture = &scene->texture[use->texture];
        fetch(texture, find(finds, texture, use, uv), lanes, &texels);
    }
    read_base(material->base_colour, &texels, lanes, base);
}

LW_WIDE_INLINE void fill(float *to, float value, unsigned lanes) {
    for (unsigned i = 0; i < WIDTH; i++) to[i] = IS_IN(i) ? value : to[i];
}

LW_WIDE static void fill_all(const struct lw_finish *restrict finish, const float *restrict dielectric,
                             float normal_scale, unsigned lanes, struct lw_gloss16 *restrict g) {
    fill(g->metalness, finish->metalness, lanes);
    fill(g->roughness, finish->roughness, lanes);
    fill(g->specular, finish->specular, lanes);
    fill(g->occlusion, finish->occlusion, lanes);
    fill(g->normal_scale, normal_scale, lanes);
    for (unsigned c = 0; c < 3; c++) fill(g->dielectric[c], dielectric[c], lanes);
}

void lw_gloss_maps_take(struct lw_gloss16 *gloss, uint16_t lanes, const struct lw_scene *scene,
                        const struct lw_material *material, unsigned what, const struct lw_gloss_uv16 *uv) {
    const struct lw_finish *finish = material->finish;
    const float bend = (finish->ior - 1) / (finish->ior + 1), *tint = finish->specular_colour;
    const float dielectric[3] = {bend * bend * tint[0], bend * bend * tint[1], bend * bend * tint[2]};
    const bool bumps = what & LW_GLOSS_MAPS_BUMPS && finish->normal_texture.texture != LW_SCENE_NONE;
    struct finds finds;
    finds.count = 0;
    prefetch_all(&finds, scene, material, what, uv, lanes);
    if (what & LW_GLOSS_MAPS_BASE) take_base(&finds, scene, material, uv, lanes, gloss->base);
    fill_all(finish, dielectric, bumps ? finish->normal_scale : 0, lanes, gloss);
    take_map(&finds, scene, &finish->surface_texture, uv, lanes, &gloss->surface);
    if (finish->occlusion > 0 && is_same_map(&finish->occlusion_texture, &finish->surface_texture))
        copy(&gloss->surface, lanes, &gloss->shade);
    else if (finish->occlusion > 0)
        take_map(&finds, scene, &finish->occlusion_texture, uv, lanes, &gloss->shade);
    if (bumps) take_map(&finds, scene, &finish->normal_texture, uv, lanes, &gloss->bump);
    if (finish->specular_texture.texture != LW_SCENE_NONE)
        take_specular(&finds, scene, finish, uv, lanes, gloss);
}

static void take_white(struct lw_gloss_texels16 *out) { memset(out->at, 255, sizeof out->at); }

LW_WIDE static void take_means(const float (*restrict normal)[12], const float *restrict side,
                               struct lw_gloss16 *restrict g, struct lw_gloss_uv16 *restrict uv) {
    for (unsigned i = 0; i < WIDTH; i++) {
        const float x = normal[i][0], y = normal[i][1], z = normal[i][2];
        const float scale = side[i] / sqrtf(most(x * x + y * y + z * z, SHORT2));
        g->plain[0][i] = scale * x, g->plain[1][i] = scale * y, g->plain[2][i] = scale * z;
        uv->u[0][i] = normal[i][3];
        g->tangent[0][i] = normal[i][4], g->tangent[1][i] = normal[i][5], g->tangent[2][i] = normal[i][6];
        uv->v[0][i] = normal[i][7];
        uv->u[1][i] = normal[i][8], uv->v[1][i] = normal[i][9];
    }
}

void lw_gloss_maps_begin(const struct lw_gloss_corner mean[LW_GLOSS_WIDTH], const float side[LW_GLOSS_WIDTH],
                         struct lw_gloss16 *out, struct lw_gloss_uv16 *uv) {
    _Static_assert(sizeof *mean == 12 * sizeof(float), "a mean is read as 12 floats");
    memset(out, 0, sizeof *out);
    take_white(&out->surface), take_white(&out->shade), take_white(&out->bump);
    for (unsigned i = 0; i < WIDTH; i++) out->roughness[i] = 1;
    take_means((const float(*)[12])mean, side, out, uv);
    memcpy(out->side, side, sizeof out->side);
}
