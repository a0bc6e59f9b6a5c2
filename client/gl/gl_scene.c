#include "client/gl/gl_scene.h"

#include "client/gl/gl_program.h"
#include "client/gl/gl_texture.h"
#include "common/lightmap/lightmap.h"
#include "common/shading/tangent.h"
#include "common/tile/fine_choice.h"

#include <stdlib.h>
#include <string.h>

#define ANISOTROPY 8.0f

/* Layout of a mesh's vertices: its attributes, interleaved. */
struct layout {
    size_t stride, at[LW_GL_ATTRIBUTES]; /* bytes; at: 0 where absent, but of the position */
};

static struct layout layout_of(const struct lw_mesh *mesh) {
    struct layout l = {.stride = sizeof(struct lw_vec3)};
    l.at[LW_GL_NORMAL] = l.stride, l.stride += 4 * sizeof(int16_t);
    if (mesh->lightmap_uv) l.at[LW_GL_LIGHTMAP] = l.stride, l.stride += sizeof(struct lw_vec2);
    for (int set = 0; set < 2; set++)
        if (mesh->uv[set]) l.at[LW_GL_UV0 + set] = l.stride, l.stride += sizeof(struct lw_vec2);
    if (mesh->colour) l.at[LW_GL_COLOUR] = l.stride, l.stride += sizeof(struct lw_vec4);
    if (mesh->tangent) l.at[LW_GL_TANGENT] = l.stride, l.stride += 4 * sizeof(int16_t);
    return l;
}

static int16_t snorm(float x) { return (int16_t)lrintf(32767.0f * (x > -1 ? (x < 1 ? x : 1) : -1)); }

/* The vertices of a mesh with tangents: those that it has, and more for corners whose tangents differ. */
struct split {
    uint32_t count;
    uint32_t *corner; /* 3 per triangle: its vertices among these; NULL: the mesh has no tangents */
    uint32_t *of;     /* the mesh's vertex */
    uint16_t *code;   /* its tangent */
    uint32_t *next;   /* scratch: another one of the same vertex; 0: there is none */
    bool *taken;      /* scratch, of the mesh's vertices */
};

static void free_split(struct split *s) {
    free(s->taken);
    free(s->next);
    free(s->code);
    free(s->of);
    free(s->corner);
    *s = (struct split){0};
}

/* The vertex of a tangent; made where there is none. */
static uint32_t find_vertex(struct split *s, uint32_t vertex, uint16_t code) {
    if (!s->taken[vertex]) {
        s->taken[vertex] = true;
        s->code[vertex] = code;
        return vertex;
    }
    uint32_t at = vertex;
    while (s->code[at] != code) {
        if (s->next[at] == 0) {
            s->of[s->count] = vertex;
            s->code[s->count] = code;
            s->next[at] = s->count++;
        }
        at = s->next[at];
    }
    return at;
}

static bool split_corners(const struct lw_mesh *mesh, struct split *s) {
    const size_t corners = 3ul * mesh->triangle_count, room = mesh->vertex_count + corners;
    *s = (struct split){.count = mesh->vertex_count};
    if (!mesh->tangent) return true;
    s->corner = malloc((corners + 1) * sizeof *s->corner);
    s->of = malloc((room + 1) * sizeof *s->of);
    s->code = calloc(room + 1, sizeof *s->code);
    s->next = calloc(room + 1, sizeof *s->next);
    s->taken = calloc(mesh->vertex_count + 1ul, sizeof *s->taken);
    if (!s->corner || !s->of || !s->code || !s->next || !s->taken) {
        free_split(s);
        return false;
    }
    for (uint32_t v = 0; v < mesh->vertex_count; v++) s->of[v] = v;
    for (size_t c = 0; c < corners; c++)
        s->corner[c] = find_vertex(s, mesh->triangle[c / 3][c % 3], mesh->tangent[c]);
    return true;
}

static void write_tangent(struct lw_vec3 normal, uint16_t code, uint8_t *out) {
    const struct lw_vec4 t = lw_tangent_decode(code, normal);
    const int16_t tangent[4] = {snorm(t.x), snorm(t.y), snorm(t.z), snorm(t.w)};
    memcpy(out, tangent, sizeof tangent);
}

static void write_vertices(const struct lw_mesh *mesh, const struct split *split, const struct layout *l,
                           uint8_t *out) {
    for (uint32_t i = 0; i < split->count; i++, out += l->stride) {
        const uint32_t v = split->of ? split->of[i] : i;
        const struct lw_vec3 n = mesh->normal[v];
        const int16_t normal[4] = {snorm(n.x), snorm(n.y), snorm(n.z), 0};
        memcpy(out, &mesh->position[v], sizeof(struct lw_vec3));
        memcpy(out + l->at[LW_GL_NORMAL], normal, sizeof normal);
        if (l->at[LW_GL_LIGHTMAP])
            memcpy(out + l->at[LW_GL_LIGHTMAP], &mesh->lightmap_uv[v], sizeof(struct lw_vec2));
        for (int set = 0; set < 2; set++)
            if (l->at[LW_GL_UV0 + set])
                memcpy(out + l->at[LW_GL_UV0 + set], &mesh->uv[set][v], sizeof(struct lw_vec2));
        if (l->at[LW_GL_COLOUR]) memcpy(out + l->at[LW_GL_COLOUR], &mesh->colour[v], sizeof(struct lw_vec4));
        if (l->at[LW_GL_TANGENT]) write_tangent(n, split->code[i], out + l->at[LW_GL_TANGENT]);
    }
}

static void attribute(GLuint place, GLint count, GLenum type, const struct layout *l, size_t first) {
    if (place != LW_GL_POSITION && l->at[place] == 0) return;
    glEnableVertexAttribArray(place);
    glVertexAttribPointer(place, count, type, type == GL_SHORT, (GLsizei)l->stride,
                          (const void *)(first + l->at[place])); /* an offset, in a pointer's clothes */
}

static void make_array(struct lw_gl_scene *s, const struct layout *l, size_t first, GLuint *out_array) {
    glGenVertexArrays(1, out_array);
    glBindVertexArray(*out_array);
    glBindBuffer(GL_ARRAY_BUFFER, s->vertices);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, s->indices);
    attribute(LW_GL_POSITION, 3, GL_FLOAT, l, first);
    attribute(LW_GL_NORMAL, 4, GL_SHORT, l, first);
    attribute(LW_GL_LIGHTMAP, 2, GL_FLOAT, l, first);
    attribute(LW_GL_UV0, 2, GL_FLOAT, l, first);
    attribute(LW_GL_UV1, 2, GL_FLOAT, l, first);
    attribute(LW_GL_COLOUR, 4, GL_FLOAT, l, first);
    attribute(LW_GL_TANGENT, 4, GL_SHORT, l, first);
}

/* ---- batches ---- */

/* A triangle in its place: by material, then by level; 64 bits that sort. */
static int by_key(const void *a, const void *b) {
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y;
}

struct lists {
    uint64_t *key;   /* per triangle of the largest mesh */
    uint8_t *level;  /* per triangle: its coarsest one */
    uint32_t *index; /* of all triangles, batch by batch */
    uint32_t *small; /* a bit for each of them */
    uint32_t count;  /* indices so far */
};

static struct lw_gl_batch *add_batch(struct lw_gl_scene *s, uint32_t material, uint32_t level,
                                     uint32_t first) {
    if ((s->batch_count & (s->batch_count - 1)) == 0) { /* full: it grows at powers of two */
        const size_t room = s->batch_count ? 2ul * s->batch_count : 1;
        struct lw_gl_batch *batch = realloc(s->batch, room * sizeof *batch);
        if (batch == NULL) return NULL;
        s->batch = batch;
    }
    s->batch[s->batch_count] = (struct lw_gl_batch){material, level, first, 0};
    return &s->batch[s->batch_count++];
}

static bool is_small(const struct lw_mesh *mesh, uint32_t triangle) {
    const uint32_t *v = mesh->triangle[triangle];
    if (!mesh->lightmap_uv) return false;
    const struct lw_vec2 a = mesh->lightmap_uv[v[0]], b = mesh->lightmap_uv[v[1]],
                         c = mesh->lightmap_uv[v[2]];
    return fabsf(lw_vec2_twice_area(a, b, c)) < LW_FINE_CHOICE_TEXELS;
}

static enum lw_status cut_into_batches(struct lw_gl_scene *s, uint32_t m, struct lists *lists) {
    const struct lw_mesh *mesh = &s->scene->mesh[m];
    memset(lists->level, 0, mesh->triangle_count);
    if (mesh->lightmap_uv && lw_lightmap_coarsest(mesh, lists->level) != LW_OK) return LW_NO_MEMORY;
    struct split split;
    if (!split_corners(mesh, &split)) return LW_NO_MEMORY;
    s->mesh[m].vertex_count = split.count;
    s->mesh[m].tangents = mesh->tangent != NULL;
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        lists->key[t] = (uint64_t)mesh->material[t] << 40 | (uint64_t)lists->level[t] << 32 | t;
    qsort(lists->key, mesh->triangle_count, sizeof *lists->key, by_key);
    struct lw_gl_batch *batch = NULL;
    s->mesh[m].first_batch = s->batch_count;
    for (uint32_t i = 0; i < mesh->triangle_count; i++) {
        const uint32_t t = (uint32_t)lists->key[i], material = mesh->material[t], level = lists->level[t];
        if (!batch || batch->material != material || batch->coarsest != level)
            batch = add_batch(s, material, level, lists->count);
        if (!batch) {
            free_split(&split);
            return LW_NO_MEMORY;
        }
        if (is_small(mesh, t)) lists->small[lists->count / 96] |= 1u << lists->count / 3 % 32;
        for (unsigned k = 0; k < 3; k++)
            lists->index[lists->count++] = split.corner ? split.corner[3ul * t + k] : mesh->triangle[t][k];
        batch->count += 3;
    }
    free_split(&split);
    s->mesh[m].batch_count = s->batch_count - s->mesh[m].first_batch;
    return LW_OK;
}

static void find_box(struct lw_gl_mesh *out, const struct lw_mesh *mesh) {
    out->box = LW_BOX_EMPTY;
    for (uint32_t v = 0; v < mesh->vertex_count; v++) lw_box_add_point(&out->box, mesh->position[v]);
}

/* A mesh at a time, through memory for the largest. */
static enum lw_status upload_vertices(struct lw_gl_scene *s, struct lw_error *err) {
    size_t size = 0, largest = 0;
    for (uint32_t m = 0; m < s->scene->mesh_count; m++) {
        const size_t bytes = layout_of(&s->scene->mesh[m]).stride * s->mesh[m].vertex_count;
        size += bytes;
        largest = bytes > largest ? bytes : largest;
    }
    uint8_t *memory = malloc(largest + 1);
    if (memory == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the scene's vertices");
    glGenBuffers(1, &s->vertices);
    glBindBuffer(GL_ARRAY_BUFFER, s->vertices);
    glBufferData(GL_ARRAY_BUFFER, (GLsizeiptr)size + 1, NULL, GL_STATIC_DRAW);
    enum lw_status status = lw_gl_program_check("the scene's vertices", err);
    size_t first = 0;
    for (uint32_t m = 0; m < s->scene->mesh_count && status == LW_OK; m++) {
        const struct lw_mesh *mesh = &s->scene->mesh[m];
        const struct layout l = layout_of(mesh);
        const size_t bytes = l.stride * s->mesh[m].vertex_count;
        struct split split;
        if (!split_corners(mesh, &split)) {
            status = lw_status_fail(err, LW_NO_MEMORY, "no memory for the scene's vertices");
            break;
        }
        write_vertices(mesh, &split, &l, memory);
        free_split(&split);
        glBufferSubData(GL_ARRAY_BUFFER, (GLintptr)first, (GLsizeiptr)bytes, memory);
        make_array(s, &l, first, &s->mesh[m].array);
        find_box(&s->mesh[m], mesh);
        s->mesh[m].lit = mesh->lightmap_uv != NULL;
        first += bytes;
    }
    glBindVertexArray(0);
    free(memory);
    return status == LW_OK ? lw_gl_program_check("the scene's vertices", err) : status;
}

static enum lw_status upload_indices(struct lw_gl_scene *s, struct lw_error *err) {
    size_t triangles = 0, most = 0;
    for (uint32_t m = 0; m < s->scene->mesh_count; m++) {
        triangles += s->scene->mesh[m].triangle_count;
        most = s->scene->mesh[m].triangle_count > most ? s->scene->mesh[m].triangle_count : most;
    }
    struct lists lists = {.key = malloc((most + 1) * sizeof *lists.key),
                          .level = malloc(most + 1),
                          .index = malloc((3 * triangles + 1) * sizeof *lists.index),
                          .small = calloc(triangles / 32 + 1, sizeof *lists.small)};
    enum lw_status status = lists.key && lists.level && lists.index && lists.small ? LW_OK : LW_NO_MEMORY;
    for (uint32_t m = 0; m < s->scene->mesh_count && status == LW_OK; m++)
        status = cut_into_batches(s, m, &lists);
    if (status == LW_OK) {
        glGenBuffers(1, &s->indices);
        glBindBuffer(GL_ARRAY_BUFFER, s->indices);
        glBufferData(GL_ARRAY_BUFFER, (GLsizeiptr)(lists.count * sizeof *lists.index), lists.index,
                     GL_STATIC_DRAW);
        lw_gl_texture_table(GL_R32UI, (triangles / 32 + 1) * sizeof *lists.small, lists.small,
                            &s->small_buffer, &s->small);
        status = lw_gl_program_check("the scene's triangles", err);
    } else {
        lw_status_fail(err, status, "no memory for the scene's triangles");
    }
    free(lists.small);
    free(lists.index);
    free(lists.level);
    free(lists.key);
    return status;
}

/* ---- pictures ---- */

static GLint wrap(uint8_t kind) {
    switch ((enum lw_wrap)kind) {
    case LW_WRAP_CLAMP:
        return GL_CLAMP_TO_EDGE;
    case LW_WRAP_MIRROR:
        return GL_MIRRORED_REPEAT;
    case LW_WRAP_REPEAT:
        break;
    }
    return GL_REPEAT;
}

/* Samples along the long side of a pixel seen askew. llvmpipe has the extension, but Mesa 22.3's pictures by
 * it are far off (Sponza: a mean difference of 2.7 instead of 1.3 / 255), for more than twice the time. */
static float find_anisotropy(void) {
    const char *name = (const char *)glGetString(GL_RENDERER);
    GLfloat most = 1;
    if (!epoxy_has_gl_extension("GL_EXT_texture_filter_anisotropic") || !name || strstr(name, "llvmpipe"))
        return 1;
    glGetFloatv(GL_MAX_TEXTURE_MAX_ANISOTROPY_EXT, &most);
    return most < ANISOTROPY ? most : ANISOTROPY;
}

static GLint format_of(const struct lw_texture *t) {
    switch ((enum lw_content)t->content) {
    case LW_CONTENT_NORMAL:
        return GL_RG8;
    case LW_CONTENT_SURFACE:
        return GL_RGBA8;
    case LW_CONTENT_COLOUR:
        break;
    }
    return GL_SRGB8_ALPHA8;
}

/* exact: no filter but the four nearest texels, as lw_scene_sample() */
static enum lw_status upload_texture(const struct lw_texture *t, bool exact, float anisotropy, GLuint *out,
                                     struct lw_error *err) {
    GLint side_max = 0;
    /* without a GPU the second copy costs a tenth of a picture */
    const GLint filter = exact            ? GL_LINEAR
                         : anisotropy > 1 ? GL_LINEAR_MIPMAP_LINEAR
                                          : GL_LINEAR_MIPMAP_NEAREST;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &side_max);
    if (t->width > (uint32_t)side_max || t->height > (uint32_t)side_max)
        return lw_status_fail(err, LW_UNAVAILABLE,
                              "texture \"%.60s\" has %ux%u pixels, the GPU takes %d a side; --renderer cpu "
                              "takes it",
                              t->name, t->width, t->height, side_max);
    glGenTextures(1, out);
    glBindTexture(GL_TEXTURE_2D, *out);
    glTexImage2D(GL_TEXTURE_2D, 0, format_of(t), (GLsizei)t->width, (GLsizei)t->height, 0, GL_RGBA,
                 GL_UNSIGNED_BYTE, t->rgba);
    if (!exact) glGenerateMipmap(GL_TEXTURE_2D);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, filter);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    if (anisotropy > 1) glTexParameterf(GL_TEXTURE_2D, GL_TEXTURE_MAX_ANISOTROPY_EXT, anisotropy);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, wrap(t->wrap_s));
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, wrap(t->wrap_t));
    return LW_OK;
}

static enum lw_status upload_textures(struct lw_gl_scene *s, bool exact, struct lw_error *err) {
    const struct lw_scene *scene = s->scene;
    const float anisotropy = exact ? 1 : find_anisotropy();
    enum lw_status status = LW_OK;
    glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
    for (uint32_t m = 0; m < scene->material_count && status == LW_OK; m++) {
        const uint32_t used[2] = {scene->material[m].base_colour_texture.texture,
                                  scene->material[m].emission_texture.texture};
        for (int k = 0; k < 2 && status == LW_OK; k++)
            if (used[k] != LW_SCENE_NONE && s->texture[used[k]] == 0)
                status =
                    upload_texture(&scene->texture[used[k]], exact, anisotropy, &s->texture[used[k]], err);
    }
    const struct lw_environment *e = &scene->environment;
    if (status == LW_OK && e->width > 0) {
        lw_gl_texture_smooth(GL_TEXTURE_2D, &s->environment);
        glTexImage2D(GL_TEXTURE_2D, 0, GL_RGB32F, (GLsizei)e->width, (GLsizei)e->height, 0, GL_RGB, GL_FLOAT,
                     e->rgb);
        glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_REPEAT);
    }
    return status == LW_OK ? lw_gl_program_check("the scene's textures", err) : status;
}

/* ---- finishes ---- */

static bool is_same_use(const struct lw_texture_use *a, const struct lw_texture_use *b) {
    return a->uv_set == b->uv_set && memcmp(a->transform, b->transform, sizeof a->transform) == 0;
}

static bool varies(const struct lw_texture *t, unsigned channel) {
    const size_t count = (size_t)t->width * t->height;
    for (size_t i = 1; i < count; i++)
        if (t->rgba[4 * i + channel] != t->rgba[channel]) return true;
    return false;
}

/* Whether one texture can stand for the two, and then what its last channel is. */
static bool plan_packed(const struct lw_scene *scene, const struct lw_finish *f, struct lw_gl_maps *out) {
    const struct lw_texture_use *surface = &f->surface_texture, *normal = &f->normal_texture,
                                *shade = &f->occlusion_texture;
    if (surface->texture == LW_SCENE_NONE || normal->texture == LW_SCENE_NONE) return false;
    const struct lw_texture *s = &scene->finish_texture[surface->texture],
                            *n = &scene->finish_texture[normal->texture];
    if (s->width != n->width || s->height != n->height || s->wrap_s != n->wrap_s || s->wrap_t != n->wrap_t ||
        !is_same_use(surface, normal))
        return false;
    const bool shaded = f->occlusion > 0 && shade->texture == surface->texture && is_same_use(shade, surface);
    out->metal = f->metalness > 0 && varies(s, 2);
    out->occludes = shaded && (s->rgba[0] < 255 || varies(s, 0));
    out->metalness = out->metal ? 1 : (float)s->rgba[2] * (1.0f / 255);
    return !(out->metal && out->occludes);
}

/* Another material with the same texture, if there is one. */
static const struct lw_gl_maps *find_packed(const struct lw_gl_scene *s, uint32_t m,
                                            const struct lw_gl_maps *like) {
    const struct lw_finish *f = s->scene->material[m].finish;
    for (uint32_t k = 0; k < s->scene->material_count; k++) {
        const struct lw_finish *other = s->scene->material[k].finish;
        if (s->maps[k].packed && other && s->maps[k].metal == like->metal &&
            s->maps[k].occludes == like->occludes &&
            other->surface_texture.texture == f->surface_texture.texture &&
            other->normal_texture.texture == f->normal_texture.texture)
            return &s->maps[k];
    }
    return NULL;
}

static enum lw_status pack_maps(struct lw_gl_scene *s, uint32_t m, float anisotropy, struct lw_error *err) {
    const struct lw_finish *f = s->scene->material[m].finish;
    struct lw_gl_maps maps = {0};
    if (s->maps[m].packed || !plan_packed(s->scene, f, &maps)) return LW_OK;
    const struct lw_gl_maps *other = find_packed(s, m, &maps);
    if (other) {
        maps.packed = other->packed;
        maps.shared = true;
        s->maps[m] = maps;
        return LW_OK;
    }
    const struct lw_texture *surface = &s->scene->finish_texture[f->surface_texture.texture];
    struct lw_texture packed = s->scene->finish_texture[f->normal_texture.texture];
    const size_t count = (size_t)packed.width * packed.height;
    uint8_t *rgba = malloc(4 * count + 1);
    if (!rgba) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the scene's textures");
    for (size_t i = 0; i < count; i++) {
        rgba[4 * i] = packed.rgba[4 * i], rgba[4 * i + 1] = packed.rgba[4 * i + 1];
        rgba[4 * i + 2] = surface->rgba[4 * i + 1];
        rgba[4 * i + 3] = maps.occludes ? surface->rgba[4 * i] : maps.metal ? surface->rgba[4 * i + 2] : 255;
    }
    packed.rgba = rgba;
    packed.content = LW_CONTENT_SURFACE;
    enum lw_status status = upload_texture(&packed, s->exact, anisotropy, &maps.packed, err);
    free(rgba);
    if (status == LW_OK) s->maps[m] = maps;
    return status;
}

/* Whether a mesh without tangents has the material: it reads the surface alone. */
static bool lacks_tangents(const struct lw_gl_scene *s, uint32_t m) {
    for (uint32_t k = 0; k < s->scene->mesh_count; k++) {
        const struct lw_gl_mesh *mesh = &s->mesh[k];
        for (uint32_t b = 0; !mesh->tangents && b < mesh->batch_count; b++)
            if (s->batch[mesh->first_batch + b].material == m) return true;
    }
    return false;
}

static enum lw_status upload_finish_textures(struct lw_gl_scene *s, struct lw_error *err) {
    const struct lw_scene *scene = s->scene;
    if (s->finish_texture_count < scene->finish_texture_count) {
        GLuint *more = realloc(s->finish_texture, scene->finish_texture_count * sizeof *more);
        if (!more) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the scene's textures");
        s->finish_texture = more;
        while (s->finish_texture_count < scene->finish_texture_count) more[s->finish_texture_count++] = 0;
    }
    const float anisotropy = s->exact ? 1 : find_anisotropy();
    enum lw_status status = LW_OK;
    for (uint32_t m = 0; m < scene->material_count && status == LW_OK; m++) {
        const struct lw_finish *f = scene->material[m].finish;
        if (!f) continue;
        if (!lacks_tangents(s, m)) status = pack_maps(s, m, anisotropy, err);
        const uint32_t used[4] = {f->surface_texture.texture, f->specular_texture.texture,
                                  f->occlusion_texture.texture, f->normal_texture.texture};
        for (int k = 0; k < 4 && status == LW_OK; k++)
            if (used[k] != LW_SCENE_NONE && s->finish_texture[used[k]] == 0 &&
                !(s->maps[m].packed && (k == 3 || used[k] == used[0])))
                status = upload_texture(&scene->finish_texture[used[k]], s->exact, anisotropy,
                                        &s->finish_texture[used[k]], err);
    }
    return status;
}

static bool has_new_tangents(const struct lw_gl_scene *s) {
    for (uint32_t m = 0; m < s->scene->mesh_count; m++)
        if (s->mesh[m].tangents != (s->scene->mesh[m].tangent != NULL)) return true;
    return false;
}

static void drop_meshes(struct lw_gl_scene *s) {
    for (uint32_t m = 0; s->mesh && m < s->scene->mesh_count; m++) {
        if (s->mesh[m].array) glDeleteVertexArrays(1, &s->mesh[m].array);
        s->mesh[m].array = 0;
    }
    if (s->vertices) glDeleteBuffers(1, &s->vertices);
    if (s->indices) glDeleteBuffers(1, &s->indices);
    if (s->small) glDeleteTextures(1, &s->small);
    if (s->small_buffer) glDeleteBuffers(1, &s->small_buffer);
    s->vertices = s->indices = s->small = s->small_buffer = 0;
    s->batch_count = 0;
    free(s->batch);
    s->batch = NULL;
}

enum lw_status lw_gl_scene_follow(struct lw_gl_scene *s, struct lw_error *err) {
    enum lw_status status = LW_OK;
    if (!lw_scene_has_finishes(s->scene)) return LW_OK;
    if (has_new_tangents(s)) {
        drop_meshes(s);
        status = upload_indices(s, err);
        if (status == LW_OK) status = upload_vertices(s, err);
    }
    return status == LW_OK ? upload_finish_textures(s, err) : status;
}

/* ---- the whole ---- */

enum lw_status lw_gl_scene_init(struct lw_gl_scene *s, const struct lw_scene *scene, bool exact,
                                struct lw_error *err) {
    *s = (struct lw_gl_scene){.scene = scene, .exact = exact};
    s->mesh = calloc(scene->mesh_count + 1ul, sizeof *s->mesh);
    s->texture = calloc(scene->texture_count + 1ul, sizeof *s->texture);
    s->maps = calloc(scene->material_count + 1ul, sizeof *s->maps);
    enum lw_status status = LW_OK;
    if (!s->mesh || !s->texture || !s->maps)
        status = lw_status_fail(err, LW_NO_MEMORY, "no memory for the scene");
    if (status == LW_OK) status = upload_indices(s, err);
    if (status == LW_OK) status = upload_vertices(s, err);
    if (status == LW_OK) status = upload_textures(s, exact, err);
    if (status == LW_OK) status = lw_gl_scene_follow(s, err);
    if (status != LW_OK) lw_gl_scene_finish(s);
    return status;
}

void lw_gl_scene_finish(struct lw_gl_scene *s) {
    if (s->scene == NULL) return;
    drop_meshes(s);
    for (uint32_t t = 0; s->texture && t < s->scene->texture_count; t++)
        if (s->texture[t]) glDeleteTextures(1, &s->texture[t]);
    for (uint32_t t = 0; t < s->finish_texture_count; t++)
        if (s->finish_texture[t]) glDeleteTextures(1, &s->finish_texture[t]);
    for (uint32_t m = 0; s->maps && m < s->scene->material_count; m++)
        if (s->maps[m].packed && !s->maps[m].shared) glDeleteTextures(1, &s->maps[m].packed);
    if (s->environment) glDeleteTextures(1, &s->environment);
    free(s->maps);
    free(s->finish_texture);
    free(s->texture);
    free(s->mesh);
    *s = (struct lw_gl_scene){0};
}
