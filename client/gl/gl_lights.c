#include "client/gl/gl_lights.h"

#include "client/gl/gl_program.h"
#include "client/gl/gl_texture.h"
#include "common/base/colour.h"

#include <stdlib.h>
#include <string.h>

#define TEXELS     9u /* per light in the table */
#define MAP_VALUES ((LW_EMITTER_CLUSTERS_MAP + 1) * (LW_EMITTER_CLUSTERS_MAP + 1))
#define CASCADE    4.0f  /* how much wider one is than the one before */
#define SNAP       0.25f /* over a cascade's half width: steps in which its middle moves */
#define NEAR_SHARE 1e-3f /* over the scene's diagonal: nothing nearer to a point or spot casts a shadow */
#define DISC_SHARE 0.6f  /* the radius of a disc that looks like an emitter, of that of the ball around it */
#define SUN_MAPS   (LW_GL_LIGHTS_SUNS * LW_GL_LIGHTS_CASCADES)

enum kind { KIND_SUN, KIND_POINT, KIND_SPOT, KIND_CLUSTER };

struct lw_gl_light_source {
    enum kind kind;
    uint32_t index; /* the scene's light, or the cluster */
    struct lw_vec3 position, direction, colour;
    float intensity; /* luminance, the most in any direction, W/sr; a sun's W/m^2 */
    float radius_m, reach_m;
    bool moved;    /* since its maps were drawn */
    uint32_t slot; /* its maps'; UINT32_MAX: it has none */
    float score;
};

/* ---- setting up ---- */

static enum lw_status make_maps(GLuint *out, uint32_t side, uint32_t layers, struct lw_error *err) {
    glGenTextures(1, out);
    glBindTexture(GL_TEXTURE_2D_ARRAY, *out);
    glTexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_DEPTH_COMPONENT32F, (GLsizei)side, (GLsizei)side, (GLsizei)layers,
                 0, GL_DEPTH_COMPONENT, GL_FLOAT, NULL);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    return lw_gl_program_check("shadow maps", err);
}

static void list_sources(struct lw_gl_lights *l) {
    l->source_count = l->sun_count = 0;
    for (int suns = 1; suns >= 0; suns--)
        for (uint32_t i = 0; i < l->scene->light_count; i++) {
            const uint8_t kind = l->scene->light[i].kind;
            if (!l->drawn.light[i] || (kind == LW_LIGHT_DIRECTIONAL) != (suns == 1)) continue;
            l->source[l->source_count++] =
                (struct lw_gl_light_source){.kind = suns                    ? KIND_SUN
                                                    : kind == LW_LIGHT_SPOT ? KIND_SPOT
                                                                            : KIND_POINT,
                                            .index = i,
                                            .moved = true,
                                            .slot = UINT32_MAX};
            l->sun_count += suns == 1;
        }
    for (uint32_t i = 0; i < l->clusters.count; i++)
        l->source[l->source_count++] =
            (struct lw_gl_light_source){.kind = KIND_CLUSTER, .index = i, .moved = true, .slot = UINT32_MAX};
    for (uint32_t i = 0; i < LW_GL_LIGHTS_LAMPS; i++) l->owner[i] = UINT32_MAX;
}

static bool build(struct lw_gl_lights *l, const struct lw_pose *pose) {
    lw_emitter_clusters_finish(&l->clusters);
    lw_lights_finish(&l->lights);
    free(l->source);
    l->source = NULL;
    l->source_count = 0;
    const struct lw_lights_part part = lw_client_lights_part(&l->drawn, true);
    l->ready = lw_lights_init_part(&l->lights, l->scene, pose, &part) == LW_OK &&
               lw_emitter_clusters_init(&l->clusters, &l->lights) == LW_OK;
    if (l->ready)
        l->source = calloc((size_t)l->scene->light_count + l->clusters.count + 1, sizeof *l->source);
    l->ready = l->ready && l->source;
    if (!l->ready) return false;
    for (uint32_t i = 0; i < l->clusters.count; i++) lw_emitter_clusters_place(&l->clusters, i, l->trace);
    list_sources(l);
    for (uint32_t m = 0; m < l->scene->material_count; m++)
        memcpy(l->emission[m], l->scene->material[m].emission, sizeof l->emission[m]);
    return true;
}

enum lw_status lw_gl_lights_init(struct lw_gl_lights *l, const struct lw_scene *scene,
                                 const struct lw_trace *trace, const struct lw_client_lights *drawn,
                                 const struct lw_pose *pose, bool upside_down, struct lw_error *err) {
    *l = (struct lw_gl_lights){.scene = scene, .trace = trace, .drawn = *drawn, .upside_down = upside_down};
    l->emission = calloc(scene->material_count + 1ul, sizeof *l->emission);
    enum lw_status status = LW_OK;
    if (!l->emission || !build(l, pose))
        status = lw_status_fail(err, LW_NO_MEMORY, "no memory for the lights of the view");
    if (status == LW_OK) status = make_maps(&l->sun_maps, LW_GL_LIGHTS_SUN_SIDE, SUN_MAPS, err);
    if (status == LW_OK)
        status = make_maps(&l->lamp_maps, LW_GL_LIGHTS_LAMP_SIDE, 6 * LW_GL_LIGHTS_LAMPS, err);
    if (status != LW_OK) {
        lw_gl_lights_finish(l);
        return status;
    }
    lw_gl_texture_table(GL_RGBA32F, sizeof(float) * 4 * TEXELS * LW_GL_LIGHTS_MAX, NULL, &l->table_buffer,
                        &l->table);
    lw_gl_texture_table(GL_R32F, sizeof(float) * 2 * MAP_VALUES * LW_GL_LIGHTS_LAMPS, NULL, &l->shape_buffer,
                        &l->shapes);
    glGenFramebuffers(1, &l->frame);
    return LW_OK;
}

void lw_gl_lights_finish(struct lw_gl_lights *l) {
    if (l->frame) glDeleteFramebuffers(1, &l->frame);
    if (l->sun_maps) glDeleteTextures(1, &l->sun_maps);
    if (l->lamp_maps) glDeleteTextures(1, &l->lamp_maps);
    if (l->table) glDeleteTextures(1, &l->table);
    if (l->shapes) glDeleteTextures(1, &l->shapes);
    if (l->table_buffer) glDeleteBuffers(1, &l->table_buffer);
    if (l->shape_buffer) glDeleteBuffers(1, &l->shape_buffer);
    lw_emitter_clusters_finish(&l->clusters);
    if (l->scene) lw_lights_finish(&l->lights);
    free(l->source);
    free(l->emission);
    *l = (struct lw_gl_lights){0};
}

/* ---- changes ---- */

static bool materials_differ(const struct lw_gl_lights *l) {
    for (uint32_t m = 0; m < l->scene->material_count; m++)
        if (l->drawn.material[m] &&
            memcmp(l->emission[m], l->scene->material[m].emission, sizeof l->emission[m]) != 0)
            return true;
    return false;
}

static bool is_in_map(const struct lw_gl_shadow_map *map, const struct lw_box *box) {
    for (int k = 0; k < 4; k++) {
        const struct lw_vec3 n = map->side[k];
        const struct lw_vec3 most = lw_vec3((n.x > 0 ? box->high.x : box->low.x) - map->eye.x,
                                            (n.y > 0 ? box->high.y : box->low.y) - map->eye.y,
                                            (n.z > 0 ? box->high.z : box->low.z) - map->eye.z);
        if (lw_vec3_dot(n, most) + map->beyond[k] < 0) return false;
    }
    return true;
}

enum lw_status lw_gl_lights_follow(struct lw_gl_lights *l, const struct lw_pose *pose,
                                   const struct lw_box *moved, uint32_t moved_count, struct lw_error *err) {
    if (!l->ready || materials_differ(l)) {
        if (!build(l, pose)) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the lights of the view");
        return LW_OK;
    }
    lw_lights_set_pose(&l->lights, pose);
    if (moved_count == 0) return LW_OK;
    for (uint32_t i = 0; i < l->clusters.count; i++) {
        const struct lw_emitter_cluster *c = &l->clusters.cluster[i];
        bool close = false;
        for (uint32_t k = 0; k < moved_count && !close; k++)
            close = lw_box_holds(&moved[k], c->centre, c->reach_m);
        if (close) lw_emitter_clusters_place(&l->clusters, i, l->trace);
    }
    for (size_t k = 0; k < sizeof l->map / sizeof l->map[0]; k++)
        for (uint32_t i = 0; l->map[k].placed && i < moved_count && !l->map[k].dirty; i++)
            l->map[k].dirty = is_in_map(&l->map[k], &moved[i]);
    return LW_OK;
}

/* ---- the lights of a picture ---- */

static void take_source(struct lw_gl_lights *l, const struct lw_pose *pose, struct lw_gl_light_source *s) {
    const struct lw_gl_light_source was = *s;
    if (s->kind == KIND_CLUSTER) {
        const struct lw_emitter_cluster *c = &l->clusters.cluster[s->index];
        s->position = c->centre;
        s->colour = c->colour;
        s->intensity = c->intensity;
        s->radius_m = c->radius_m;
        s->reach_m = c->reach_m;
    } else {
        const struct lw_light_state *at = &pose->light[s->index];
        s->position = at->position_ws;
        s->direction = at->direction_ws;
        s->intensity = lw_colour_luminance(at->intensity);
        s->colour = at->intensity;
    }
    s->moved |= memcmp(&was.position, &s->position, sizeof s->position) != 0 ||
                memcmp(&was.direction, &s->direction, sizeof s->direction) != 0 || was.reach_m != s->reach_m;
}

static int best_first(const void *a, const void *b, void *of) {
    const struct lw_gl_light_source *source = of, *x = &source[*(const uint32_t *)a],
                                    *y = &source[*(const uint32_t *)b];
    if (x->score != y->score) return x->score > y->score ? -1 : 1;
    return x < y ? -1 : 1;
}

/* The lamps that give most at the eye, or before it. */
static void choose_lamps(struct lw_gl_lights *l, struct lw_vec3 eye, struct lw_vec3 forward, float size_m) {
    uint32_t *order = malloc((l->source_count + 1ul) * sizeof *order), count = 0;
    if (order == NULL) return;
    const struct lw_vec3 focus = lw_vec3_mad(eye, forward, 0.1f * size_m);
    for (uint32_t i = l->sun_count; i < l->source_count; i++) {
        struct lw_gl_light_source *s = &l->source[i];
        const struct lw_vec3 way = lw_vec3_sub(s->position, focus);
        s->score = s->intensity / (lw_vec3_dot(way, way) + 0.01f * size_m * size_m + 1e-20f);
        if (s->score > 0 && s->score < INFINITY) order[count++] = i;
    }
    qsort_r(order, count, sizeof *order, best_first, l->source);
    if (count > LW_GL_LIGHTS_LAMPS) count = LW_GL_LIGHTS_LAMPS;
    for (uint32_t i = 0; i < count; i++) l->chosen[l->chosen_count++] = order[i];
    free(order);
}

static bool is_chosen(const struct lw_gl_lights *l, uint32_t source) {
    for (uint32_t i = 0; i < l->chosen_count; i++)
        if (l->chosen[i] == source) return true;
    return false;
}

/* A chosen lamp keeps its maps; one that is new takes those of one that is not chosen. */
static void give_slots(struct lw_gl_lights *l) {
    for (uint32_t i = 0; i < l->chosen_count; i++) {
        struct lw_gl_light_source *s = &l->source[l->chosen[i]];
        if (s->kind == KIND_SUN || s->slot != UINT32_MAX) continue;
        uint32_t slot = 0;
        while (l->owner[slot] != UINT32_MAX && is_chosen(l, l->owner[slot])) slot++;
        if (l->owner[slot] != UINT32_MAX) l->source[l->owner[slot]].slot = UINT32_MAX;
        l->owner[slot] = l->chosen[i];
        s->slot = slot;
        s->moved = true;
    }
}

/* Columns of a matrix from its rows. */
static void set_clip(float out[16], struct lw_vec3 x, struct lw_vec3 y, struct lw_vec3 z, struct lw_vec3 w,
                     float z_add, float w_add) {
    const float rows[4][4] = {
        {x.x, x.y, x.z, 0}, {y.x, y.y, y.z, 0}, {z.x, z.y, z.z, z_add}, {w.x, w.y, w.z, w_add}};
    for (int c = 0; c < 4; c++)
        for (int r = 0; r < 4; r++) out[4 * c + r] = rows[r][c];
}

/* The six sides of a cube: where each looks, and its picture's axes. The shader's face_of() knows them. */
static const struct lw_vec3 faces[6][3] = {
    {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {{-1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
    {{0, 1, 0}, {0, 0, 1}, {1, 0, 0}}, {{0, -1, 0}, {0, 0, 1}, {1, 0, 0}},
    {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}}, {{0, 0, -1}, {1, 0, 0}, {0, 1, 0}}};

static float near_of(const struct lw_gl_light_source *s, float size_m) {
    return s->kind == KIND_CLUSTER ? fmaxf(0.5f * s->reach_m, 1e-6f * size_m) : NEAR_SHARE * size_m;
}

static void place_lamp(struct lw_gl_lights *l, struct lw_gl_light_source *s, float size_m) {
    const float near_m = near_of(s, size_m);
    for (uint32_t f = 0; f < 6 && s->moved; f++) {
        struct lw_gl_shadow_map *m = &l->map[SUN_MAPS + 6 * s->slot + f];
        const struct lw_vec3 z = faces[f][0], x = faces[f][1], y = faces[f][2];
        *m = (struct lw_gl_shadow_map){.layer = 6 * s->slot + f,
                                       .eye = s->position,
                                       .reach_m = s->reach_m,
                                       .placed = true,
                                       .dirty = true};
        m->side[0] = lw_vec3_add(z, x), m->side[1] = lw_vec3_sub(z, x);
        m->side[2] = lw_vec3_add(z, y), m->side[3] = lw_vec3_sub(z, y);
        if (l->upside_down)
            set_clip(m->clip, x, y, lw_vec3(0, 0, 0), z, near_m, 0);
        else
            set_clip(m->clip, x, y, z, z, -2 * near_m, 0);
    }
    s->moved = false;
}

/* Half the width and the middle of a cascade, in steps, so that it seldom changes. */
static struct lw_vec3 cascade_middle(uint32_t c, struct lw_vec3 eye, struct lw_vec3 forward,
                                     struct lw_vec3 middle, struct lw_vec3 right, struct lw_vec3 up,
                                     float size_m, float *out_half) {
    *out_half = 0.5f * size_m;
    for (uint32_t i = c; i + 1 < LW_GL_LIGHTS_CASCADES; i++) *out_half /= CASCADE;
    if (c + 1 == LW_GL_LIGHTS_CASCADES) return middle;
    const struct lw_vec3 way = lw_vec3_sub(lw_vec3_mad(eye, forward, 0.6f * *out_half), middle);
    const float step = SNAP * *out_half, x = step * roundf(lw_vec3_dot(way, right) / step),
                y = step * roundf(lw_vec3_dot(way, up) / step);
    return lw_vec3_mad(lw_vec3_mad(middle, right, x), up, y);
}

static void place_sun(struct lw_gl_lights *l, uint32_t number, struct lw_gl_light_source *s,
                      struct lw_vec3 eye, struct lw_vec3 forward, struct lw_vec3 middle, float size_m) {
    struct lw_vec3 right, up;
    lw_vec3_frame(s->direction, &right, &up);
    for (uint32_t c = 0; c < LW_GL_LIGHTS_CASCADES; c++) {
        struct lw_gl_shadow_map *m = &l->map[LW_GL_LIGHTS_CASCADES * number + c], was = *m;
        float half;
        m->sun = m->placed = true;
        m->layer = LW_GL_LIGHTS_CASCADES * number + c;
        m->eye = cascade_middle(c, eye, forward, middle, right, up, size_m, &half);
        m->side[0] = right, m->side[1] = lw_vec3_scale(right, -1);
        m->side[2] = up, m->side[3] = lw_vec3_scale(up, -1);
        for (int k = 0; k < 4; k++) m->beyond[k] = half;
        /* all of the scene along the light, whatever the middle; depth falls from 1 to 0 away from the sun,
         * or grows */
        const float range = 1 / size_m;
        const struct lw_vec3 away = s->direction, x = lw_vec3_scale(right, 1 / half),
                             y = lw_vec3_scale(up, 1 / half);
        if (l->upside_down)
            set_clip(m->clip, x, y, lw_vec3_scale(away, -0.5f * range), lw_vec3(0, 0, 0), 0.5f, 1);
        else
            set_clip(m->clip, x, y, lw_vec3_scale(away, range), lw_vec3(0, 0, 0), 0, 1);
        if (s->moved || memcmp(was.clip, m->clip, sizeof m->clip) != 0 ||
            memcmp(&was.eye, &m->eye, sizeof m->eye) != 0)
            m->dirty = true;
    }
    s->moved = false;
}

static void write_texel(float *out, struct lw_vec3 v, float w) {
    out[0] = v.x, out[1] = v.y, out[2] = v.z, out[3] = w;
}

static void write_light(const struct lw_gl_lights *l, uint32_t number, struct lw_vec3 eye, float size_m,
                        float *out, float *shapes) {
    const struct lw_gl_light_source *s = &l->source[l->chosen[number]];
    const struct lw_vec3 none = {0, 0, 0};
    if (s->kind == KIND_SUN) {
        struct lw_vec3 right, up;
        lw_vec3_frame(s->direction, &right, &up);
        write_texel(out, lw_vec3_scale(s->direction, -1), KIND_SUN);
        write_texel(out + 4, s->colour, tanf(0.5f * l->scene->light[s->index].angular_diameter));
        write_texel(out + 8, right, size_m);
        write_texel(out + 12, up, (float)(LW_GL_LIGHTS_CASCADES * number));
        for (uint32_t c = 0; c < LW_GL_LIGHTS_CASCADES; c++) {
            const struct lw_gl_shadow_map *m = &l->map[LW_GL_LIGHTS_CASCADES * number + c];
            write_texel(out + 16 + 4 * c, lw_vec3_sub(m->eye, eye), m->beyond[0]);
        }
        return;
    }
    const bool cluster = s->kind == KIND_CLUSTER;
    write_texel(out, lw_vec3_sub(s->position, eye), (float)s->kind);
    write_texel(out + 4, s->colour, cluster ? DISC_SHARE * s->radius_m : 0);
    write_texel(out + 12, lw_vec3(near_of(s, size_m), (float)(6 * s->slot), s->reach_m), 0);
    if (s->kind == KIND_SPOT) {
        const struct lw_light *light = &l->scene->light[s->index];
        const float outer = cosf(light->outer_cone), inner = cosf(light->inner_cone);
        write_texel(out + 8, s->direction, outer);
        out[15] = 1 / fmaxf(inner - outer, 1e-6f);
    } else {
        write_texel(out + 8, none, 0);
    }
    if (!cluster) return;
    const struct lw_emitter_cluster *c = &l->clusters.cluster[s->index];
    out[8] = (float)(2 * MAP_VALUES * s->slot);
    memcpy(shapes + 2 * MAP_VALUES * s->slot, c->map, sizeof c->map);
    memcpy(shapes + 2 * MAP_VALUES * s->slot + MAP_VALUES, c->open, sizeof c->open);
}

void lw_gl_lights_choose(struct lw_gl_lights *l, const struct lw_pose *pose, struct lw_vec3 eye,
                         struct lw_vec3 forward, const struct lw_box *scene) {
    float shapes[2 * MAP_VALUES * LW_GL_LIGHTS_LAMPS];
    float table[4 * TEXELS * LW_GL_LIGHTS_MAX] = {0};
    const float size_m = fmaxf(2 * lw_box_radius(scene), 1e-6f);
    const struct lw_vec3 middle = lw_box_middle(scene);
    for (uint32_t i = 0; i < l->source_count; i++) take_source(l, pose, &l->source[i]);
    l->chosen_count = 0;
    for (uint32_t i = 0; i < l->sun_count && i < LW_GL_LIGHTS_SUNS; i++) l->chosen[l->chosen_count++] = i;
    const uint32_t suns = l->chosen_count;
    choose_lamps(l, eye, forward, size_m);
    give_slots(l);
    for (uint32_t i = 0; i < l->chosen_count; i++) {
        struct lw_gl_light_source *s = &l->source[l->chosen[i]];
        if (i < suns)
            place_sun(l, i, s, eye, forward, middle, size_m);
        else
            place_lamp(l, s, size_m);
        write_light(l, i, eye, size_m, table + 4 * TEXELS * i, shapes);
    }
    glBindBuffer(GL_TEXTURE_BUFFER, l->table_buffer);
    glBufferData(GL_TEXTURE_BUFFER, sizeof table, table, GL_DYNAMIC_DRAW);
    glBindBuffer(GL_TEXTURE_BUFFER, l->shape_buffer);
    glBufferData(GL_TEXTURE_BUFFER, sizeof shapes, shapes, GL_DYNAMIC_DRAW);
}

uint32_t lw_gl_lights_near(const struct lw_gl_lights *l, const struct lw_box *box, float least,
                           GLint *out_light) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < l->chosen_count; i++) {
        const struct lw_gl_light_source *s = &l->source[l->chosen[i]];
        const struct lw_vec3 p = s->position;
        const struct lw_vec3 way = lw_vec3(fmaxf(fmaxf(box->low.x - p.x, p.x - box->high.x), 0),
                                           fmaxf(fmaxf(box->low.y - p.y, p.y - box->high.y), 0),
                                           fmaxf(fmaxf(box->low.z - p.z, p.z - box->high.z), 0));
        if (s->kind == KIND_SUN || s->intensity > least * lw_vec3_dot(way, way))
            out_light[count++] = (GLint)i;
    }
    return count;
}
