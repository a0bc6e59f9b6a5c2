#include "client/gl/gl_renderer.h"

#include "client/gl/gl_light.h"
#include "client/gl/gl_lights.h"
#include "client/gl/gl_program.h"
#include "client/gl/gl_scene.h"
#include "client/gl/gl_shaders.h"
#include "client/gl/gl_target.h"
#include "client/gl/gl_texture.h"
#include "client/view/shading/ambient.h"
#include "common/light/direction_form.h"
#include "common/shading/lobe_table.h"
#include "common/tile/fine_choice.h"

#include <float.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define METERED      128u  /* pixels a side: enough for a log average */
#define SURVEY_SHARE 4u    /* a survey has one pixel for this many, each way */
#define NEAR_SHARE   1e-6f /* nearest visible distance from the eye, over the scene's diagonal */
#define NEAR_COARSE  1e-4f /* the same, where depth is not stored upside down */
#define TAPS         16    /* as of the shaders */
#define FAINT        2e-3f /* share of the mean light from which on a lamp is drawn on an object */
#define HALF_MAX     65504.0f
#define LOBE_STEPS   128 /* steps of the table of lobes, by angle and by roughness: the nearest is read */
#define OBJECT_WORDS 16u /* an object on the GPU: three rows of a transform, its atlas */

/* Key of a batch's program. */
enum variant {
    VARIANT_BASE = 1,
    VARIANT_GLOW = 2,
    VARIANT_BASE_UV1 = 4,
    VARIANT_GLOW_UV1 = 8,
    VARIANT_COLOUR = 16,
    VARIANT_MASK = 32,
    VARIANT_BLEND = 64,
    VARIANT_LIGHTMAP = 128,
    VARIANT_FEEDBACK = 256,
    VARIANT_SETTLED = 512,
    VARIANT_MSAA = 1024,
    VARIANT_LIT = 2048,
    VARIANT_SHADOW = 4096,
    VARIANT_SHOWN = 8192, /* something else than light: lw_show */
    VARIANT_FINISH = 16384,
    VARIANT_RELIEF = 32768, /* a normal map; the other maps of a finish: */
    VARIANT_SURFACE_MAP = 65536,
    VARIANT_SPECULAR_MAP = 131072,
    VARIANT_SHADE_MAP = 262144,
    VARIANT_PACKED = 524288,     /* normal map and surface in one texture: gl_scene.h */
    VARIANT_AT_BASE = 1048576,   /* all maps of a finish are read where the base colour is */
    VARIANT_FINE = 2097152,      /* tiles of finer levels may be read */
    VARIANT_DIRECTION = 4194304, /* it is known where tiles' light comes from */
    VARIANTS = 8388608
};

/* Texture units. */
enum {
    UNIT_BASE,
    UNIT_GLOW,
    UNIT_PAGES,
    UNIT_LEVELS,
    UNIT_TILES,
    UNIT_OBJECTS,
    UNIT_INSTANCES,
    UNIT_LIGHTS,
    UNIT_SHAPES,
    UNIT_SUN_MAPS,
    UNIT_LAMP_MAPS,
    UNIT_TILE_COLOURS,
    UNIT_LOBES,
    UNIT_AMBIENT,
    UNIT_FINE,
    UNIT_SMALL,
    UNIT_DIRECTIONS,
    UNIT_FINE_DIRECTIONS,
    UNIT_SURFACE /* and the other three maps of a finish */
};

struct program {
    GLuint name;
    GLint first, eye, parallel, clip, base_uv, glow_uv, base_colour, emission, unlit, cutoff, stand_in,
        unscale, finer, coarsest, first_triangle, reach, light, light_count, noise, faint, show, finish,
        specular_colour, relief, finish_uv, finish_set, sky;
};

struct object {
    struct lw_affine place;
    struct lw_box box; /* world space */
    bool mirrored, hidden;
};

/* Instances of a mesh that stand side by side in the list of instances. */
struct draw {
    uint32_t mesh, first, count;
    bool mirrored, settled;
    bool fine;         /* tiles of finer levels of one of them are there */
    struct lw_box box; /* of all of them */
    float distance;    /* from the eye to the nearest part of any */
};

struct lw_gl_renderer {
    struct lw_gl_renderer_desc desc;
    struct lw_gl_scene scene;
    struct lw_gl_light light;
    struct lw_gl_lights lights; /* zeroed: there are none to draw */
    struct lw_box bounds;       /* of all that has ever been shown */
    struct lw_box *moved;       /* scratch */
    struct lw_gl_target picture, survey, metered;
    struct program *program; /* programs made so far; the first one is none */
    uint32_t program_count;
    uint16_t *made; /* per variant: its program, or 0 */
    struct lw_ambient
        ambient; /* with finishes and an environment alone; so are its texture and that of lobes */
    GLuint lobes, ambient_maps;
    GLuint sky, show, empty_array;
    GLint sky_middle, sky_right, sky_up, sky_far, sky_colour, show_exposure, show_curve;
    bool upside_down; /* depth is 1 at the eye and 0 far away, where floats are most exact */
    float near_m;

    GLuint objects, object_buffer, instances, instance_buffer;
    GLuint tile_colours, tile_colour_buffer; /* made when a chart of tiles is first drawn */
    float *tile_colour;                      /* scratch: 4 floats a tile */
    struct object *object;
    uint32_t *by_mesh;  /* objects in the order of their meshes */
    uint32_t *first_of; /* per mesh, and one more: in by_mesh */
    /* for the view at hand: */
    uint32_t *instance;
    struct draw *draw;
    struct draw *blended; /* an instance each */
    uint32_t draw_count, blended_count, instance_count;
    bool *blends; /* per mesh: a batch of it is BLEND */
    const struct lw_pose *pose;
    struct lw_vec3 sky_radiance;
    uint32_t *tiles; /* a survey's, as read */
    size_t tiles_room;
    struct lw_gl_renderer_figures figures;
};

/* ---- setting up ---- */

static enum lw_status make_sky_and_show(struct lw_gl_renderer *r, const char *brightest,
                                        struct lw_error *err) {
    enum lw_status status =
        lw_gl_program_create(brightest, lw_gl_shaders_sky_vertex, lw_gl_shaders_sky_fragment, &r->sky, err);
    if (status == LW_OK)
        status =
            lw_gl_program_create("", lw_gl_shaders_show_vertex, lw_gl_shaders_show_fragment, &r->show, err);
    if (status != LW_OK) return status;
    r->sky_middle = glGetUniformLocation(r->sky, "u_middle");
    r->sky_right = glGetUniformLocation(r->sky, "u_right");
    r->sky_up = glGetUniformLocation(r->sky, "u_up");
    r->sky_far = glGetUniformLocation(r->sky, "u_far");
    r->sky_colour = glGetUniformLocation(r->sky, "u_sky");
    r->show_exposure = glGetUniformLocation(r->show, "u_exposure");
    r->show_curve = glGetUniformLocation(r->show, "u_curve");
    glGenVertexArrays(1, &r->empty_array);
    return LW_OK;
}

static void brightest(const struct lw_gl_renderer *r, char out[64]) {
    snprintf(out, 64, "#define BRIGHTEST %.9g\n", (double)(r->desc.exact ? FLT_MAX : HALF_MAX));
}

/* The limits of the composer's choice of finer levels. */
static void define_fine(char *defines, size_t size) {
    const size_t used = strlen(defines);
    snprintf(defines + used, size - used, "#define FINE_PIXELS %.9g\n#define FINE_CHANGE %.9g\n",
             (double)LW_FINE_CHOICE_PIXELS, (double)LW_FINE_CHOICE_CHANGE);
}

/* Places on the unit disc: Vogel's spiral, every second of them one as well. */
static void set_taps(const struct program *p) {
    float tap[TAPS][2];
    for (int i = 0; i < TAPS; i++) {
        const float radius = sqrtf(((float)i + 0.5f) / TAPS), angle = 2.39996323f * (float)i;
        tap[i][0] = radius * cosf(angle), tap[i][1] = radius * sinf(angle);
    }
    glUniform2fv(glGetUniformLocation(p->name, "u_tap"), TAPS, tap[0]);
}

static void set_level_colours(const struct program *p) {
    enum { FIRST = -2, COUNT = 6 };
    float colour[COUNT][3];
    for (int k = 0; k < COUNT; k++) {
        const struct lw_vec3 c = lw_show_level_colour(FIRST + k);
        colour[k][0] = c.x, colour[k][1] = c.y, colour[k][2] = c.z;
    }
    glUniform3fv(glGetUniformLocation(p->name, "u_level_colours"), COUNT, colour[0]);
}

static void find_finish_uniforms(struct program *p) {
    static const char *const maps[] = {"u_surface", "u_specular", "u_shade", "u_bumps"};
    p->finish = glGetUniformLocation(p->name, "u_finish");
    p->specular_colour = glGetUniformLocation(p->name, "u_specular_colour");
    p->relief = glGetUniformLocation(p->name, "u_relief");
    p->finish_uv = glGetUniformLocation(p->name, "u_finish_uv");
    p->finish_set = glGetUniformLocation(p->name, "u_finish_set");
    p->sky = glGetUniformLocation(p->name, "u_sky");
    glUseProgram(p->name);
    for (GLint k = 0; k < 4; k++) glUniform1i(glGetUniformLocation(p->name, maps[k]), UNIT_SURFACE + k);
    glUniform1i(glGetUniformLocation(p->name, "u_lobes"), UNIT_LOBES);
    glUniform1i(glGetUniformLocation(p->name, "u_ambient"), UNIT_AMBIENT);
}

/* A variant's program, or one that is to be made. */
static enum lw_status add_program(struct lw_gl_renderer *r, unsigned variant, struct program **out,
                                  struct lw_error *err) {
    if (r->made[variant] == 0) {
        struct program *more = realloc(r->program, (r->program_count + 1ul) * sizeof *more);
        if (!more || r->program_count == UINT16_MAX) {
            if (more) r->program = more;
            return lw_status_fail(err, LW_NO_MEMORY, "no memory for a shader program");
        }
        r->program = more;
        more[r->program_count] = (struct program){0};
        r->made[variant] = (uint16_t)r->program_count++;
    }
    *out = &r->program[r->made[variant]];
    return LW_OK;
}

/* The program of a variant, made when it is first drawn with. */
static enum lw_status find_program(struct lw_gl_renderer *r, unsigned variant, const struct program **out,
                                   struct lw_error *err) {
    static const char *const names[] = {
        "BASE",        "GLOW",         "BASE_UV1",  "GLOW_UV1", "COLOUR",  "MASK",  "BLEND",    "LIGHTMAP",
        "FEEDBACK",    "SETTLED",      "MSAA",      "LIT",      "SHADOW",  "SHOWN", "FINISH",   "RELIEF",
        "SURFACE_MAP", "SPECULAR_MAP", "SHADE_MAP", "PACKED",   "AT_BASE", "FINE",  "DIRECTION"};
    const unsigned maps = VARIANT_RELIEF | VARIANT_SURFACE_MAP | VARIANT_SPECULAR_MAP | VARIANT_SHADE_MAP;
    struct program *p = NULL;
    enum lw_status status = add_program(r, variant, &p, err);
    *out = p;
    if (status != LW_OK || p->name) return status;
    char defines[1024];
    brightest(r, defines);
    snprintf(defines + strlen(defines), sizeof defines - strlen(defines), "#define CENTROID %s\n",
             variant & VARIANT_MSAA ? "centroid" : "");
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (variant >> i & 1u)
            snprintf(defines + strlen(defines), sizeof defines - strlen(defines), "#define %s\n", names[i]);
    /* light from everywhere alone, whose mirror image is even, too */
    const bool even = variant & VARIANT_FINISH &&
                      !(variant & (VARIANT_LIT | VARIANT_SHOWN | VARIANT_DIRECTION)) && !r->ambient.rgb;
    if (even)
        strcat(defines, "#define EVEN\n");
    else if (variant & (VARIANT_LIT | VARIANT_FINISH | VARIANT_SHOWN))
        strcat(defines, "#define NORMAL\n");
    if (variant & maps && !(variant & VARIANT_AT_BASE)) strcat(defines, "#define FINISH_MAP\n");
    if (r->ambient.rgb) strcat(defines, "#define AMBIENT\n");
    if (variant & VARIANT_FINE) define_fine(defines, sizeof defines);
    if (variant & VARIANT_DIRECTION)
        snprintf(defines + strlen(defines), sizeof defines - strlen(defines), "#define SHORT %.9g\n",
                 (double)LW_DIRECTION_SHORT);
    status = lw_gl_program_create(defines, lw_gl_shaders_scene_vertex, lw_gl_shaders_scene_fragment, &p->name,
                                  err);
    if (status != LW_OK) return status;
    p->first = glGetUniformLocation(p->name, "u_first");
    p->eye = glGetUniformLocation(p->name, "u_eye");
    p->parallel = glGetUniformLocation(p->name, "u_parallel");
    p->clip = glGetUniformLocation(p->name, "u_clip");
    p->base_uv = glGetUniformLocation(p->name, "u_base_uv");
    p->glow_uv = glGetUniformLocation(p->name, "u_glow_uv");
    p->base_colour = glGetUniformLocation(p->name, "u_base_colour");
    p->emission = glGetUniformLocation(p->name, "u_emission");
    p->unlit = glGetUniformLocation(p->name, "u_unlit");
    p->cutoff = glGetUniformLocation(p->name, "u_cutoff");
    p->stand_in = glGetUniformLocation(p->name, "u_stand_in");
    p->unscale = glGetUniformLocation(p->name, "u_unscale");
    p->finer = glGetUniformLocation(p->name, "u_finer");
    p->coarsest = glGetUniformLocation(p->name, "u_coarsest");
    p->first_triangle = glGetUniformLocation(p->name, "u_first_triangle");
    p->reach = glGetUniformLocation(p->name, "u_reach");
    p->light = glGetUniformLocation(p->name, "u_light");
    p->light_count = glGetUniformLocation(p->name, "u_light_count");
    p->noise = glGetUniformLocation(p->name, "u_noise");
    p->faint = glGetUniformLocation(p->name, "u_faint");
    p->show = glGetUniformLocation(p->name, "u_show");
    if (variant & VARIANT_FINISH) find_finish_uniforms(p);
    glUseProgram(p->name);
    glUniform1i(glGetUniformLocation(p->name, "u_base"), UNIT_BASE);
    glUniform1i(glGetUniformLocation(p->name, "u_glow"), UNIT_GLOW);
    glUniform1i(glGetUniformLocation(p->name, "u_pages"), UNIT_PAGES);
    glUniform1i(glGetUniformLocation(p->name, "u_levels"), UNIT_LEVELS);
    glUniform1i(glGetUniformLocation(p->name, "u_tiles"), UNIT_TILES);
    glUniform1i(glGetUniformLocation(p->name, "u_objects"), UNIT_OBJECTS);
    glUniform1i(glGetUniformLocation(p->name, "u_instances"), UNIT_INSTANCES);
    glUniform1i(glGetUniformLocation(p->name, "u_lights"), UNIT_LIGHTS);
    glUniform1i(glGetUniformLocation(p->name, "u_shapes"), UNIT_SHAPES);
    glUniform1i(glGetUniformLocation(p->name, "u_sun_maps"), UNIT_SUN_MAPS);
    glUniform1i(glGetUniformLocation(p->name, "u_lamp_maps"), UNIT_LAMP_MAPS);
    glUniform1i(glGetUniformLocation(p->name, "u_tile_colours"), UNIT_TILE_COLOURS);
    glUniform1i(glGetUniformLocation(p->name, "u_fine"), UNIT_FINE);
    glUniform1i(glGetUniformLocation(p->name, "u_small"), UNIT_SMALL);
    glUniform1i(glGetUniformLocation(p->name, "u_directions"), UNIT_DIRECTIONS);
    glUniform1i(glGetUniformLocation(p->name, "u_fine_directions"), UNIT_FINE_DIRECTIONS);
    glUniform1f(glGetUniformLocation(p->name, "u_fine_levels"), (float)r->desc.map->finer_count);
    if (variant & VARIANT_LIT) set_taps(p);
    if (variant & VARIANT_SHOWN) set_level_colours(p);
    glUniform2f(glGetUniformLocation(p->name, "u_depth"), r->upside_down ? 0 : 1, r->upside_down ? 1 : -1);
    glUniform1f(glGetUniformLocation(p->name, "u_page_texel"), 1.0f / (float)r->light.side);
    return LW_OK;
}

static bool allocate(struct lw_gl_renderer *r) {
    const size_t objects = r->desc.scene->object_count + 1ul, meshes = r->desc.scene->mesh_count + 1ul;
    r->object = calloc(objects, sizeof *r->object);
    r->by_mesh = calloc(objects, sizeof *r->by_mesh);
    r->first_of = calloc(meshes + 1, sizeof *r->first_of);
    r->instance = calloc(objects, sizeof *r->instance);
    r->draw = calloc(2 * meshes, sizeof *r->draw); /* per mesh: mirrored and not */
    r->blended = calloc(objects, sizeof *r->blended);
    r->blends = calloc(meshes, sizeof *r->blends);
    r->moved = calloc(2 * objects, sizeof *r->moved);
    r->made = calloc(VARIANTS, sizeof *r->made);
    r->program = calloc(1, sizeof *r->program);
    r->program_count = 1;
    return r->made && r->program && r->object && r->by_mesh && r->first_of && r->instance && r->draw &&
           r->blended && r->blends && r->moved;
}

static void sort_by_mesh(struct lw_gl_renderer *r) {
    const struct lw_scene *scene = r->desc.scene;
    for (uint32_t o = 0; o < scene->object_count; o++) r->first_of[scene->object[o].mesh + 1]++;
    for (uint32_t m = 0; m < scene->mesh_count; m++) r->first_of[m + 1] += r->first_of[m];
    uint32_t *at = r->instance; /* scratch: the next place of each object's mesh, found from the back */
    for (uint32_t o = 0; o < scene->object_count; o++) at[o] = o;
    for (uint32_t o = scene->object_count; o-- > 0;) {
        const uint32_t m = scene->object[o].mesh;
        r->by_mesh[--r->first_of[m + 1]] = o;
    }
    /* each first_of[m + 1] is now where mesh m begins: move them down by one */
    for (uint32_t m = 0; m < scene->mesh_count; m++) r->first_of[m] = r->first_of[m + 1];
    r->first_of[scene->mesh_count] = scene->object_count;
    for (uint32_t b = 0, m = 0; b < r->scene.batch_count; b++) {
        while (b >= r->scene.mesh[m].first_batch + r->scene.mesh[m].batch_count) m++;
        r->blends[m] |= scene->material[r->scene.batch[b].material].alpha_mode == LW_ALPHA_BLEND;
    }
}

enum lw_status lw_gl_renderer_create(const struct lw_gl_renderer_desc *desc,
                                     struct lw_gl_renderer **out_renderer, struct lw_error *err) {
    if (epoxy_gl_version() < 33)
        return lw_status_fail(err, LW_UNAVAILABLE, "OpenGL 3.3 is needed, there is %d.%d",
                              epoxy_gl_version() / 10, epoxy_gl_version() % 10);
    struct lw_gl_renderer *r = calloc(1, sizeof *r);
    enum lw_status status = LW_OK;
    if (r) r->desc = *desc;
    if (!r || !allocate(r)) status = lw_status_fail(err, LW_NO_MEMORY, "no memory for the view");
    GLint table_max = 0;
    glGetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &table_max);
    if (status == LW_OK && desc->scene->object_count >= (uint32_t)table_max / 4)
        status = lw_status_fail(err, LW_UNAVAILABLE, "the scene has %u objects, the GPU takes %d",
                                desc->scene->object_count, table_max / 4);
    if (status == LW_OK) status = lw_gl_scene_init(&r->scene, desc->scene, desc->exact, err);
    if (status == LW_OK) status = lw_gl_light_init(&r->light, desc->map, desc->unfiltered, err);
    if (r) r->upside_down = epoxy_gl_version() >= 45 || epoxy_has_gl_extension("GL_ARB_clip_control");
    if (status == LW_OK && lw_client_lights_any(desc->drawn))
        status = lw_gl_lights_init(&r->lights, desc->scene, desc->trace, desc->drawn, desc->pose,
                                   r->upside_down, err);
    char top[64];
    if (status == LW_OK) brightest(r, top);
    if (status == LW_OK) status = make_sky_and_show(r, top, err);
    if (status != LW_OK) {
        lw_gl_renderer_destroy(r);
        return status;
    }
    const size_t objects = desc->scene->object_count + 1ul;
    lw_gl_texture_table(GL_RGBA32UI, objects * OBJECT_WORDS * sizeof(uint32_t), NULL, &r->object_buffer,
                        &r->objects);
    lw_gl_texture_table(GL_R32UI, objects * sizeof(uint32_t), NULL, &r->instance_buffer, &r->instances);
    sort_by_mesh(r);
    for (uint32_t o = 0; o < desc->scene->object_count; o++) r->object[o].hidden = true; /* not placed yet */
    r->picture.format = desc->exact ? GL_RGBA32F : GL_RGBA16F;
    r->survey.format = GL_RG32UI;
    r->metered.format = GL_RGBA16F;
    r->bounds = LW_BOX_EMPTY;
    *out_renderer = r;
    return LW_OK;
}

void lw_gl_renderer_destroy(struct lw_gl_renderer *r) {
    if (r == NULL) return;
    for (uint32_t i = 1; r->program && i < r->program_count; i++)
        if (r->program[i].name) glDeleteProgram(r->program[i].name);
    if (r->lobes) glDeleteTextures(1, &r->lobes);
    if (r->ambient_maps) glDeleteTextures(1, &r->ambient_maps);
    lw_ambient_finish(&r->ambient);
    if (r->sky) glDeleteProgram(r->sky);
    if (r->show) glDeleteProgram(r->show);
    if (r->empty_array) glDeleteVertexArrays(1, &r->empty_array);
    if (r->objects) glDeleteTextures(1, &r->objects);
    if (r->instances) glDeleteTextures(1, &r->instances);
    if (r->object_buffer) glDeleteBuffers(1, &r->object_buffer);
    if (r->instance_buffer) glDeleteBuffers(1, &r->instance_buffer);
    if (r->tile_colours) glDeleteTextures(1, &r->tile_colours);
    if (r->tile_colour_buffer) glDeleteBuffers(1, &r->tile_colour_buffer);
    lw_gl_target_finish(&r->metered);
    lw_gl_target_finish(&r->survey);
    lw_gl_target_finish(&r->picture);
    lw_gl_lights_finish(&r->lights);
    lw_gl_light_finish(&r->light);
    lw_gl_scene_finish(&r->scene);
    free(r->tile_colour);
    free(r->tiles);
    free(r->moved);
    free(r->blends);
    free(r->blended);
    free(r->draw);
    free(r->instance);
    free(r->first_of);
    free(r->by_mesh);
    free(r->object);
    free(r->program);
    free(r->made);
    free(r);
}

/* ---- finishes ---- */

/* The table of lobes in steps so small that none is seen: a look-up is one texel in place of four. Columns
 * are even in the root of the cosine. */
static enum lw_status make_lobes(struct lw_gl_renderer *r, struct lw_error *err) {
    float(*share)[2] = malloc(sizeof *share * LOBE_STEPS * LOBE_STEPS);
    if (!share) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the table of lobes");
    for (int i = 0; i < LOBE_STEPS * LOBE_STEPS; i++) {
        const float root = (float)(i % LOBE_STEPS) / (LOBE_STEPS - 1);
        const struct lw_lobe_share at =
            lw_lobe_table_at(root * root, (float)(i / LOBE_STEPS) / (LOBE_STEPS - 1));
        share[i][0] = at.a, share[i][1] = at.b;
    }
    lw_gl_texture_smooth(GL_TEXTURE_2D, &r->lobes);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RG16, LOBE_STEPS, LOBE_STEPS, 0, GL_RG, GL_FLOAT, share);
    free(share);
    return LW_OK;
}

/* Tables for the shaders of finishes. */
static enum lw_status make_tables(struct lw_gl_renderer *r, struct lw_error *err) {
    glActiveTexture(GL_TEXTURE0);
    enum lw_status status = make_lobes(r, err);
    if (status != LW_OK) return status;
    if (lw_ambient_take(&r->ambient, &r->desc.scene->environment) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for the sky in mirrors");
    if (!r->ambient.rgb) return LW_OK;
    lw_gl_texture_smooth(GL_TEXTURE_2D_ARRAY, &r->ambient_maps);
    glTexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_RGB32F, LW_AMBIENT_SIDE, LW_AMBIENT_SIDE, LW_AMBIENT_MAPS, 0,
                 GL_RGB, GL_FLOAT, r->ambient.rgb);
    return LW_OK;
}

/* Takes over finishes that have arrived. */
static enum lw_status take_finishes(struct lw_gl_renderer *r, struct lw_error *err) {
    if (!lw_scene_has_finishes(r->desc.scene)) return LW_OK;
    enum lw_status status = r->lobes ? LW_OK : make_tables(r, err);
    if (status == LW_OK) status = lw_gl_scene_follow(&r->scene, err);
    return status;
}

/* ---- changes ---- */

static void place_object(struct lw_gl_renderer *r, uint32_t o, const struct lw_affine *place) {
    struct object *object = &r->object[o];
    const uint32_t m = r->desc.scene->object[o].mesh;
    uint32_t words[OBJECT_WORDS] = {0};
    object->place = *place;
    object->mirrored = lw_affine_determinant(place) < 0;
    object->box = lw_box_moved(&object->place, &r->scene.mesh[m].box);
    memcpy(words, place->m, sizeof place->m);
    lw_gl_light_place(&r->light, o, r->desc.scene->mesh[m].back_offset, words + 12);
    glBufferSubData(GL_TEXTURE_BUFFER, (GLintptr)(o * sizeof words), sizeof words, words);
}

/* Returns how many boxes r->moved has then: where things that have moved were, and where they are. */
static uint32_t take_objects(struct lw_gl_renderer *r, const struct lw_pose *pose) {
    uint32_t moved = 0;
    glBindBuffer(GL_TEXTURE_BUFFER, r->object_buffer);
    for (uint32_t o = 0; o < r->desc.scene->object_count; o++) {
        struct object *object = &r->object[o];
        const struct lw_affine *now = &pose->object_to_world[o];
        const bool placed = memcmp(now, &object->place, sizeof *now) != 0;
        const bool was_hidden = object->hidden, differs = placed || was_hidden != pose->object_hidden[o];
        if (differs && !was_hidden) r->moved[moved++] = object->box;
        if (placed) place_object(r, o, now);
        object->hidden = pose->object_hidden[o];
        if (object->hidden) continue;
        if (differs) r->moved[moved++] = object->box;
        lw_box_add(&r->bounds, &object->box);
    }
    const float diagonal = 2 * lw_box_radius(&r->bounds);
    const float share = r->upside_down ? NEAR_SHARE : NEAR_COARSE;
    r->near_m = diagonal > 0 && diagonal < INFINITY ? share * diagonal : share;
    return moved;
}

enum lw_status lw_gl_renderer_take(struct lw_gl_renderer *r, const struct lw_compose_source *source,
                                   const struct lw_pose *pose, uint32_t tiles_max, uint64_t now_ns,
                                   uint32_t *out_waiting, struct lw_error *err) {
    enum lw_status finished = take_finishes(r, err);
    if (finished != LW_OK) return finished;
    lw_gl_light_take(&r->light, source, tiles_max, now_ns);
    const uint32_t moved = take_objects(r, pose);
    r->pose = pose;
    if (r->lights.scene) {
        enum lw_status status = lw_gl_lights_follow(&r->lights, pose, r->moved, moved, err);
        if (status != LW_OK) return status;
    }
    r->sky_radiance = source->sky;
    r->figures.tiles_uploaded = r->light.uploaded + r->light.fine.uploaded;
    r->figures.fine_tiles = r->light.fine.used;
    if (out_waiting) *out_waiting = r->light.waiting;
    return lw_gl_program_check("taking over light", err);
}

/* ---- a view ---- */

struct view {
    struct lw_vec3 eye, forward, right, up;
    float half_width, half_height; /* the picture's at depth 1; orthographic: 0, its sky is one point */
    bool parallel;                 /* orthographic */
    float shift_x, shift_y;        /* in the picture's units: -1 to 1 from side to side */
    struct lw_vec3 side[4];        /* normals of the frustum's sides, inward */
    float beyond[4];               /* how far they are from the eye, outward */
    float clip[16];                /* columns */
    float finer;
    float reach, noise; /* for a shadow map; for a picture */
    enum lw_show show;
    unsigned variant;
};

/* Largest distance along the view of a surface before the eye. */
static float depth_of(const struct lw_gl_renderer *r, const struct lw_camera_view *camera) {
    float depth = 1;
    for (unsigned k = 0; k < 8; k++) {
        const struct lw_vec3 corner = lw_box_corner(&r->bounds, k);
        depth = fmaxf(depth, lw_vec3_dot(lw_vec3_sub(corner, camera->position), camera->forward));
    }
    return 1.01f * depth;
}

/* An orthographic view: depth goes with distance, from the plane of the eye to behind all there is. */
static void make_parallel(const struct lw_gl_renderer *r, const struct lw_compose_view *v, struct view *out) {
    const float half_height = 0.5f * v->camera.height_m,
                half_width = half_height * (float)v->width / (float)v->height,
                steep = (r->upside_down ? -1.0f : 2.0f) / depth_of(r, &v->camera);
    const struct lw_vec3 x = lw_vec3_scale(out->right, 1 / half_width),
                         y = lw_vec3_scale(out->up, 1 / half_height), z = lw_vec3_scale(out->forward, steep);
    const float across[4] = {1, -1, 0, 0}, along[4] = {0, 0, 1, -1},
                axis[3][3] = {{x.x, y.x, z.x}, {x.y, y.y, z.y}, {x.z, y.z, z.z}};
    out->parallel = true;
    out->half_width = out->half_height = 0;
    for (int k = 0; k < 4; k++) {
        out->side[k] = lw_vec3_mad(lw_vec3_scale(x, across[k]), y, along[k]);
        out->beyond[k] = 1.01f;
    }
    for (int k = 0; k < 3; k++) {
        memcpy(&out->clip[4 * k], axis[k], sizeof axis[k]);
        out->clip[4 * k + 3] = 0;
    }
    out->clip[12] = out->shift_x, out->clip[13] = out->shift_y;
    out->clip[14] = r->upside_down ? 1 : -1;
    out->clip[15] = 1;
}

static struct view make_view(const struct lw_gl_renderer *r, const struct lw_compose_view *v) {
    struct view out = {.eye = v->camera.position,
                       .forward = v->camera.forward,
                       .right = v->camera.right,
                       .up = v->camera.up,
                       .half_height = tanf(0.5f * v->camera.fov_y),
                       .shift_x = -2 * v->offset_x / (float)v->width,
                       .shift_y = 2 * v->offset_y / (float)v->height,
                       .show = LW_SHOW_ALL,
                       .finer = 1};
    if (v->camera.height_m > 0) {
        make_parallel(r, v, &out);
        return out;
    }
    out.half_width = out.half_height * (float)v->width / (float)v->height;
    const struct lw_vec3 x = lw_vec3_scale(out.right, 1 / out.half_width),
                         y = lw_vec3_scale(out.up, 1 / out.half_height), f = out.forward;
    const float shift_x = out.shift_x, shift_y = out.shift_y, across[4] = {1, -1, 0, 0},
                along[4] = {0, 0, 1, -1};
    for (int k = 0; k < 4; k++)
        out.side[k] = lw_vec3_mad(lw_vec3_mad(lw_vec3_scale(f, 1.01f), x, across[k]), y, along[k]);
    /* an infinite far plane: depth is near / distance, or one minus twice that */
    const float axis[3][3] = {{x.x, y.x, f.x}, {x.y, y.y, f.y}, {x.z, y.z, f.z}};
    for (int k = 0; k < 3; k++) {
        const float w = axis[k][2];
        out.clip[4 * k] = axis[k][0] + shift_x * w;
        out.clip[4 * k + 1] = axis[k][1] + shift_y * w;
        out.clip[4 * k + 2] = r->upside_down ? 0 : w;
        out.clip[4 * k + 3] = w;
    }
    out.clip[14] = r->upside_down ? r->near_m : -2 * r->near_m;
    return out;
}

/* Whether a box may be seen. */
static bool is_seen(const struct view *v, const struct object *object, float *out_distance) {
    const struct lw_vec3 low = lw_vec3_sub(object->box.low, v->eye),
                         high = lw_vec3_sub(object->box.high, v->eye);
    for (int k = 0; k < 4; k++) {
        const struct lw_vec3 n = v->side[k];
        const struct lw_vec3 most =
            lw_vec3(n.x > 0 ? high.x : low.x, n.y > 0 ? high.y : low.y, n.z > 0 ? high.z : low.z);
        if (lw_vec3_dot(n, most) + v->beyond[k] < 0) return false;
    }
    const struct lw_vec3 nearest = lw_vec3(fmaxf(fmaxf(low.x, -high.x), 0), fmaxf(fmaxf(low.y, -high.y), 0),
                                           fmaxf(fmaxf(low.z, -high.z), 0));
    *out_distance = v->parallel ? lw_vec3_dot(lw_vec3_scale(lw_vec3_add(low, high), 0.5f), v->forward)
                                : lw_vec3_length(nearest);
    return true;
}

static int near_first(const void *a, const void *b) {
    const struct draw *x = a, *y = b;
    return x->distance < y->distance ? -1 : x->distance > y->distance;
}

static int far_first(const void *a, const void *b) { return near_first(b, a); }

/* Distance of an object's middle, for the order of blending. */
static float middle_distance(const struct view *v, const struct object *object) {
    const struct lw_vec3 middle = lw_box_middle(&object->box);
    const struct lw_vec3 away = lw_vec3_sub(middle, v->eye);
    return v->parallel ? lw_vec3_dot(away, v->forward) : lw_vec3_length(away);
}

static bool is_fine(const struct lw_gl_renderer *r, uint32_t object) {
    return r->light.fine.pool && r->light.fine.in_pool[object] > 0;
}

static void list_mesh(struct lw_gl_renderer *r, const struct view *v, uint32_t m) {
    for (int mirrored = 0; mirrored < 2; mirrored++) {
        struct draw draw = {.mesh = m,
                            .first = r->instance_count,
                            .mirrored = mirrored,
                            .settled = true,
                            .box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}},
                            .distance = INFINITY};
        for (uint32_t i = r->first_of[m]; i < r->first_of[m + 1]; i++) {
            const uint32_t o = r->by_mesh[i];
            const struct object *object = &r->object[o];
            float distance;
            if (object->hidden || object->mirrored != mirrored || !is_seen(v, object, &distance)) continue;
            if (r->blends[m])
                r->blended[r->blended_count++] = (struct draw){.mesh = m,
                                                               .first = r->instance_count,
                                                               .count = 1,
                                                               .mirrored = mirrored,
                                                               .settled = r->light.settled[o],
                                                               .fine = is_fine(r, o),
                                                               .box = object->box,
                                                               .distance = middle_distance(v, object)};
            r->instance[r->instance_count++] = o;
            draw.distance = fminf(draw.distance, distance);
            lw_box_add(&draw.box, &object->box);
            draw.settled &= r->light.settled[o];
            draw.fine |= is_fine(r, o);
        }
        draw.count = r->instance_count - draw.first;
        if (draw.count > 0) r->draw[r->draw_count++] = draw;
    }
}

static void list_draws(struct lw_gl_renderer *r, const struct view *v) {
    r->draw_count = r->blended_count = r->instance_count = 0;
    for (uint32_t m = 0; m < r->desc.scene->mesh_count; m++) list_mesh(r, v, m);
    qsort(r->draw, r->draw_count, sizeof *r->draw, near_first);
    qsort(r->blended, r->blended_count, sizeof *r->blended, far_first);
    glBindBuffer(GL_TEXTURE_BUFFER, r->instance_buffer);
    glBufferData(GL_TEXTURE_BUFFER, (GLsizeiptr)((r->desc.scene->object_count + 1ul) * sizeof *r->instance),
                 NULL, GL_DYNAMIC_DRAW); /* a new one: the old may still be drawn from */
    glBufferSubData(GL_TEXTURE_BUFFER, 0, (GLsizeiptr)(r->instance_count * sizeof *r->instance), r->instance);
}

static void bind(GLenum unit, GLenum kind, GLuint texture) {
    glActiveTexture(GL_TEXTURE0 + unit);
    glBindTexture(kind, texture);
}

/* Whether occlusion and surface are one look-up. */
static bool is_same_use(const struct lw_finish *f) {
    const struct lw_texture_use *a = &f->occlusion_texture, *b = &f->surface_texture;
    return a->texture == b->texture && a->uv_set == b->uv_set &&
           memcmp(a->transform, b->transform, sizeof a->transform) == 0;
}

/* Whether a texture, if there is one, is read at the coordinates of the base colour. */
static bool is_at_base(const struct lw_material *m, const struct lw_texture_use *use) {
    const struct lw_texture_use *base = &m->base_colour_texture;
    return use->texture == LW_SCENE_NONE ||
           (base->texture != LW_SCENE_NONE && base->uv_set == use->uv_set &&
            memcmp(base->transform, use->transform, sizeof base->transform) == 0);
}

/* The variant for a material with a finish. maps: as it is on the GPU */
static unsigned finish_variant(const struct lw_mesh *mesh, const struct lw_material *m,
                               const struct lw_gl_maps *maps) {
    const struct lw_finish *f = m->finish;
    unsigned variant = VARIANT_FINISH;
    if (is_at_base(m, &f->surface_texture) && is_at_base(m, &f->specular_texture) &&
        is_at_base(m, &f->normal_texture) && is_at_base(m, &f->occlusion_texture))
        variant |= VARIANT_AT_BASE;
    if (f->surface_texture.texture != LW_SCENE_NONE) variant |= VARIANT_SURFACE_MAP;
    if (f->specular_texture.texture != LW_SCENE_NONE) variant |= VARIANT_SPECULAR_MAP;
    if (f->normal_texture.texture != LW_SCENE_NONE && mesh->tangent) variant |= VARIANT_RELIEF;
    if (f->occlusion_texture.texture != LW_SCENE_NONE && !is_same_use(f)) variant |= VARIANT_SHADE_MAP;
    if (maps->packed && variant & VARIANT_RELIEF) {
        variant |= VARIANT_PACKED;
        variant &= ~(unsigned)VARIANT_SURFACE_MAP;
    }
    return variant;
}

static unsigned variant_of(const struct lw_gl_mesh *mesh, const struct lw_mesh *original,
                           const struct lw_material *m, const struct lw_gl_maps *maps) {
    unsigned variant = mesh->lit ? VARIANT_LIGHTMAP : 0;
    if (m->base_colour_texture.texture != LW_SCENE_NONE) {
        variant |= VARIANT_BASE;
        if (m->base_colour_texture.uv_set == 1) variant |= VARIANT_BASE_UV1;
    }
    if (m->emission_texture.texture != LW_SCENE_NONE && lw_material_shines(m)) {
        variant |= VARIANT_GLOW;
        if (m->emission_texture.uv_set == 1) variant |= VARIANT_GLOW_UV1;
    }
    if (original->colour) variant |= VARIANT_COLOUR;
    if (m->alpha_mode == LW_ALPHA_MASK) variant |= VARIANT_MASK;
    if (m->alpha_mode == LW_ALPHA_BLEND) variant |= VARIANT_BLEND;
    if (m->finish && !m->unlit) variant |= finish_variant(original, m, maps);
    return variant;
}

static void set_finish(const struct lw_gl_renderer *r, const struct program *p, const struct lw_finish *f,
                       const struct lw_gl_maps *maps, bool packed) {
    const struct lw_texture_use *use[4] = {&f->surface_texture, &f->specular_texture, &f->occlusion_texture,
                                           &f->normal_texture};
    const float bend = (f->ior - 1) / (f->ior + 1), *tint = f->specular_colour;
    float uv[8][3], set[4];
    for (unsigned k = 0; k < 4; k++) {
        memcpy(uv[2 * k], use[k]->transform, sizeof use[k]->transform);
        set[k] = (float)use[k]->uv_set;
        if (use[k]->texture != LW_SCENE_NONE && !(packed && (k == 0 || k == 3)))
            bind(UNIT_SURFACE + k, GL_TEXTURE_2D, r->scene.finish_texture[use[k]->texture]);
    }
    const bool first_occludes = packed ? maps->occludes : is_same_use(f);
    if (packed) bind(UNIT_SURFACE + 3, GL_TEXTURE_2D, maps->packed);
    glUniform4f(p->finish, f->metalness * (packed ? maps->metalness : 1), f->roughness, f->specular,
                bend * bend);
    glUniform3f(p->specular_colour, tint[0], tint[1], tint[2]);
    glUniform3f(p->relief, f->normal_scale, f->occlusion, first_occludes ? 1 : 0);
    glUniform3fv(p->finish_uv, 8, uv[0]);
    glUniform4fv(p->finish_set, 1, set);
    glUniform3f(p->sky, r->sky_radiance.x, r->sky_radiance.y, r->sky_radiance.z);
}

static void set_material(const struct lw_gl_renderer *r, const struct program *p,
                         const struct lw_material *m) {
    const struct lw_texture_use *base = &m->base_colour_texture, *glow = &m->emission_texture;
    glUniform4fv(p->base_colour, 1, m->base_colour);
    glUniform3fv(p->emission, 1, m->emission);
    glUniform1f(p->unlit, m->unlit);
    glUniform1f(p->cutoff, m->alpha_cutoff);
    if (base->texture != LW_SCENE_NONE) {
        bind(UNIT_BASE, GL_TEXTURE_2D, r->scene.texture[base->texture]);
        glUniform3fv(p->base_uv, 2, base->transform);
    }
    if (glow->texture != LW_SCENE_NONE) {
        bind(UNIT_GLOW, GL_TEXTURE_2D, r->scene.texture[glow->texture]);
        glUniform3fv(p->glow_uv, 2, glow->transform);
    }
}

/* The background shows through by 1 - alpha, by a colour of its own where the material has a tint. */
static void set_tint(const struct lw_material *m) {
    const bool tints = lw_material_tints(m);
    const float passes = 1 - m->base_colour[3];
    if (tints) glBlendColor(passes * m->tint[0], passes * m->tint[1], passes * m->tint[2], 1);
    glBlendFuncSeparate(GL_SRC_ALPHA, tints ? GL_CONSTANT_COLOR : GL_ONE_MINUS_SRC_ALPHA, GL_ZERO, GL_ONE);
}

/* Depth wants little: where a surface is, and where it has holes. */
static unsigned shadow_variant(unsigned variant) {
    const unsigned holes = VARIANT_MASK | VARIANT_BLEND,
                   looks = VARIANT_BASE | VARIANT_BASE_UV1 | VARIANT_COLOUR;
    return VARIANT_SHADOW | (variant & holes ? variant & (holes | looks) : 0);
}

/* Surveys read finer levels of all objects. */
static bool reads_fine(const struct lw_gl_renderer *r, unsigned variant, const struct draw *d) {
    return d->fine || (variant & (VARIANT_FEEDBACK | VARIANT_SHOWN) && r->light.fine.pool);
}

static enum lw_status draw_batch(struct lw_gl_renderer *r, const struct view *v, const struct draw *d,
                                 const struct lw_gl_batch *batch, struct lw_error *err) {
    const struct lw_gl_mesh *mesh = &r->scene.mesh[d->mesh];
    const struct lw_material *m = &r->desc.scene->material[batch->material];
    const struct program *p;
    const struct lw_gl_maps *maps = &r->scene.maps[batch->material];
    unsigned variant = v->variant | variant_of(mesh, &r->desc.scene->mesh[d->mesh], m, maps);
    if (v->variant & VARIANT_SHADOW) variant = shadow_variant(variant);
    if (mesh->lit && d->settled && !(variant & (VARIANT_FEEDBACK | VARIANT_SHADOW | VARIANT_SHOWN)))
        variant |= VARIANT_SETTLED;
    if (mesh->lit && !(variant & VARIANT_SHADOW) && reads_fine(r, variant, d)) variant |= VARIANT_FINE;
    if (mesh->lit && r->light.directions && variant & VARIANT_FINISH &&
        !(variant & (VARIANT_SHADOW | VARIANT_FEEDBACK)))
        variant |= VARIANT_DIRECTION;
    enum lw_status status = find_program(r, variant, &p, err);
    if (status != LW_OK) return status;
    glUseProgram(p->name);
    glUniform3f(p->eye, v->eye.x, v->eye.y, v->eye.z);
    glUniform4f(p->parallel, v->forward.x, v->forward.y, v->forward.z, v->parallel ? 1 : 0);
    glUniformMatrix4fv(p->clip, 1, GL_FALSE, v->clip);
    glUniform3f(p->stand_in, r->light.stand_in.x, r->light.stand_in.y, r->light.stand_in.z);
    glUniform1f(p->unscale, 1.0f / r->light.scale);
    glUniform1f(p->finer, v->finer);
    glUniform1ui(p->coarsest, batch->coarsest);
    glUniform1i(p->first, (GLint)d->first);
    glUniform1i(p->first_triangle, (GLint)(batch->first / 3));
    set_material(r, p, m);
    if (variant & VARIANT_FINISH) set_finish(r, p, m->finish, maps, variant & VARIANT_PACKED);
    if (variant & VARIANT_LIT) {
        GLint light[LW_GL_LIGHTS_MAX];
        const uint32_t count = lw_gl_lights_near(&r->lights, &d->box, FAINT * r->light.mean, light);
        if (count > 0) glUniform1iv(p->light, (GLsizei)count, light);
        glUniform1i(p->light_count, (GLint)count);
        glUniform1f(p->faint, FAINT * r->light.mean);
        glUniform2f(p->noise, 5.588238f * v->noise, 3.217711f * v->noise);
    }
    if (variant & VARIANT_SHADOW) glUniform1f(p->reach, v->reach);
    set_tint(m);
    if (variant & VARIANT_SHOWN) glUniform1i(p->show, (GLint)v->show);
    if (m->double_sided || (variant & VARIANT_SHADOW)) /* a back is a black wall for light */
        glDisable(GL_CULL_FACE);
    else
        glEnable(GL_CULL_FACE);
    glFrontFace(d->mirrored ? GL_CW : GL_CCW);
    glDrawElementsInstanced(GL_TRIANGLES, (GLsizei)batch->count, GL_UNSIGNED_INT,
                            (const void *)(batch->first * sizeof(uint32_t)), (GLsizei)d->count);
    r->figures.draw_calls++;
    return LW_OK;
}

/* blend: the batches that are, or those that are not. */
static enum lw_status draw_mesh(struct lw_gl_renderer *r, const struct view *v, const struct draw *d,
                                bool blend, struct lw_error *err) {
    const struct lw_gl_mesh *mesh = &r->scene.mesh[d->mesh];
    enum lw_status status = LW_OK;
    glBindVertexArray(mesh->array);
    for (uint32_t b = mesh->first_batch; status == LW_OK && b < mesh->first_batch + mesh->batch_count; b++) {
        const struct lw_gl_batch *batch = &r->scene.batch[b];
        if ((r->desc.scene->material[batch->material].alpha_mode == LW_ALPHA_BLEND) == blend)
            status = draw_batch(r, v, d, batch, err);
    }
    return status;
}

static bool shows_sky(enum lw_show show) { return show == LW_SHOW_ALL || show == LW_SHOW_DIRECT; }

static void draw_sky(struct lw_gl_renderer *r, const struct view *v) {
    /* an even one is what the picture is cleared to */
    if (!r->scene.environment || !shows_sky(v->show)) return;
    const struct lw_vec3 middle = lw_vec3_mad(lw_vec3_mad(v->forward, v->right, -v->shift_x * v->half_width),
                                              v->up, -v->shift_y * v->half_height);
    glUseProgram(r->sky);
    glUniform3f(r->sky_middle, middle.x, middle.y, middle.z);
    glUniform3f(r->sky_right, v->right.x * v->half_width, v->right.y * v->half_width,
                v->right.z * v->half_width);
    glUniform3f(r->sky_up, v->up.x * v->half_height, v->up.y * v->half_height, v->up.z * v->half_height);
    glUniform1f(r->sky_far, r->upside_down ? 0.0f : 1.0f);
    glUniform3f(r->sky_colour, r->sky_radiance.x, r->sky_radiance.y, r->sky_radiance.z);
    bind(UNIT_BASE, GL_TEXTURE_2D, r->scene.environment);
    glDisable(GL_CULL_FACE);
    glBindVertexArray(r->empty_array);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    r->figures.draw_calls++;
}

static void begin(struct lw_gl_renderer *r) {
    if (r->upside_down) glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(r->upside_down ? GL_GEQUAL : GL_LEQUAL);
    glDepthMask(GL_TRUE);
    glClearDepth(r->upside_down ? 0 : 1);
    glDisable(GL_BLEND);
    glDisable(GL_SCISSOR_TEST);
    glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
    glCullFace(GL_BACK);
    bind(UNIT_PAGES, GL_TEXTURE_2D_ARRAY, r->light.pages);
    bind(UNIT_LEVELS, GL_TEXTURE_BUFFER, r->light.levels);
    bind(UNIT_TILES, GL_TEXTURE_BUFFER, r->light.tiles);
    bind(UNIT_OBJECTS, GL_TEXTURE_BUFFER, r->objects);
    bind(UNIT_INSTANCES, GL_TEXTURE_BUFFER, r->instances);
    if (r->light.fine.pool) bind(UNIT_FINE, GL_TEXTURE_2D_ARRAY, r->light.fine.pool);
    if (r->light.directions) bind(UNIT_DIRECTIONS, GL_TEXTURE_2D_ARRAY, r->light.directions);
    if (r->light.fine.directions) bind(UNIT_FINE_DIRECTIONS, GL_TEXTURE_2D_ARRAY, r->light.fine.directions);
    if (r->light.fine.pool) bind(UNIT_SMALL, GL_TEXTURE_BUFFER, r->scene.small);
    if (r->lights.scene) {
        bind(UNIT_LIGHTS, GL_TEXTURE_BUFFER, r->lights.table);
        bind(UNIT_SHAPES, GL_TEXTURE_BUFFER, r->lights.shapes);
        bind(UNIT_SUN_MAPS, GL_TEXTURE_2D_ARRAY, r->lights.sun_maps);
        bind(UNIT_LAMP_MAPS, GL_TEXTURE_2D_ARRAY, r->lights.lamp_maps);
    }
    if (r->lobes) bind(UNIT_LOBES, GL_TEXTURE_2D, r->lobes);
    if (r->ambient_maps) bind(UNIT_AMBIENT, GL_TEXTURE_2D_ARRAY, r->ambient_maps);
    r->figures.draw_calls = 0;
}

/* Leaves what others who draw in this context take for granted. */
static void end(struct lw_gl_renderer *r) {
    if (r->upside_down) glClipControl(GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
    glDisable(GL_DEPTH_TEST);
    glDisable(GL_CULL_FACE);
    glDisable(GL_BLEND);
    glDepthMask(GL_TRUE);
    glFrontFace(GL_CCW);
    glBindVertexArray(0);
    glUseProgram(0);
    glActiveTexture(GL_TEXTURE0);
}

static enum lw_status draw_scene(struct lw_gl_renderer *r, const struct view *v, struct lw_error *err) {
    enum lw_status status = LW_OK;
    const bool light = !(v->variant & (VARIANT_FEEDBACK | VARIANT_SHADOW));
    list_draws(r, v);
    for (uint32_t i = 0; i < r->draw_count && status == LW_OK; i++)
        status = draw_mesh(r, v, &r->draw[i], false, err);
    if (status == LW_OK && light) draw_sky(r, v);
    if (light) {
        glEnable(GL_BLEND);
        glDepthMask(GL_FALSE);
    }
    for (uint32_t i = 0; i < r->blended_count && status == LW_OK; i++)
        status = draw_mesh(r, v, &r->blended[i], true, err);
    r->figures.objects = r->instance_count;
    return status;
}

/* ---- shadow maps ---- */

static enum lw_status draw_map(struct lw_gl_renderer *r, const struct lw_gl_shadow_map *map,
                               struct lw_error *err) {
    const uint32_t side = map->sun ? LW_GL_LIGHTS_SUN_SIDE : LW_GL_LIGHTS_LAMP_SIDE;
    struct view v = {.eye = map->eye, .finer = 1, .reach = map->reach_m, .variant = VARIANT_SHADOW};
    memcpy(v.side, map->side, sizeof v.side);
    memcpy(v.beyond, map->beyond, sizeof v.beyond);
    memcpy(v.clip, map->clip, sizeof v.clip);
    glFramebufferTextureLayer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT,
                              map->sun ? r->lights.sun_maps : r->lights.lamp_maps, 0, (GLint)map->layer);
    glViewport(0, 0, (GLsizei)side, (GLsizei)side);
    glClear(GL_DEPTH_BUFFER_BIT);
    r->lights.maps_drawn++;
    return draw_scene(r, &v, err);
}

/* Chooses the lights of a view and brings their maps up to date. */
static enum lw_status draw_maps(struct lw_gl_renderer *r, const struct lw_compose_view *view,
                                struct lw_error *err) {
    struct lw_gl_lights *lights = &r->lights;
    const size_t count = sizeof lights->map / sizeof lights->map[0];
    enum lw_status status = LW_OK;
    lw_gl_lights_choose(lights, r->pose, view->camera.position, view->camera.forward, &r->bounds);
    begin(r);
    glBindFramebuffer(GL_FRAMEBUFFER, lights->frame);
    glDrawBuffer(GL_NONE);
    glReadBuffer(GL_NONE);
    for (size_t i = 0; i < count && status == LW_OK; i++) {
        if (!lights->map[i].dirty) continue;
        status = draw_map(r, &lights->map[i], err);
        lights->map[i].dirty = false;
    }
    end(r);
    r->figures.maps_drawn = lights->maps_drawn;
    return status == LW_OK ? lw_gl_program_check("drawing shadow maps", err) : status;
}

/* ---- pictures ---- */

/* The colours of a chart of tiles. */
static enum lw_status take_tile_colours(struct lw_gl_renderer *r, const struct lw_compose_view *view,
                                        struct lw_error *err) {
    const struct lw_atlas_map *map = r->desc.map;
    const size_t count = map->plain_count + (r->light.fine.pool ? (size_t)map->fine_names : 0);
    const size_t size = 4 * (count + 1ul) * sizeof *r->tile_colour;
    if (r->tile_colour == NULL) {
        r->tile_colour = calloc(1, size);
        if (r->tile_colour == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a chart");
        lw_gl_texture_table(GL_RGBA32F, size, NULL, &r->tile_colour_buffer, &r->tile_colours);
    }
    if (lw_show_is_of_tiles(view->show)) {
        for (uint32_t t = 0; t < map->tile_count; t++) {
            const struct lw_vec3 c = view->tile_colour[t];
            if (t >= map->plain_count && (!r->light.fine.pool || !lw_atlas_map_is_used(map, (lw_tile_id){t})))
                continue;
            float *out =
                r->tile_colour +
                4 * (t < map->plain_count ? t : map->plain_count + lw_atlas_map_name(map, (lw_tile_id){t}));
            out[0] = c.x, out[1] = c.y, out[2] = c.z;
        }
        glBindBuffer(GL_TEXTURE_BUFFER, r->tile_colour_buffer);
        glBufferData(GL_TEXTURE_BUFFER, (GLsizeiptr)size, r->tile_colour, GL_DYNAMIC_DRAW);
    }
    bind(UNIT_TILE_COLOURS, GL_TEXTURE_BUFFER, r->tile_colours);
    return LW_OK;
}

enum lw_status lw_gl_renderer_draw(struct lw_gl_renderer *r, const struct lw_compose_view *view,
                                   unsigned samples, struct lw_error *err) {
    enum lw_status status = lw_gl_target_resize(&r->picture, view->width, view->height, samples, err);
    if (status != LW_OK) return status;
    struct view v = make_view(r, view);
    if (r->picture.samples > 1) v.variant = VARIANT_MSAA;
    if (r->lights.scene) {
        status = draw_maps(r, view, err);
        if (status != LW_OK) return status;
        v.variant |= VARIANT_LIT;
        v.noise = (float)view->sample;
    }
    if (view->show != LW_SHOW_ALL) {
        v.show = view->show;
        v.variant |= VARIANT_SHOWN;
        status = take_tile_colours(r, view, err);
        if (status != LW_OK) return status;
    }
    begin(r);
    lw_gl_target_bind(&r->picture);
    const float behind = lw_show_is_chart(v.show) ? LW_SHOW_BEHIND : 0;
    if (shows_sky(v.show))
        glClearColor(r->sky_radiance.x, r->sky_radiance.y, r->sky_radiance.z, 1);
    else
        glClearColor(behind, behind, behind, 1);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    status = draw_scene(r, &v, err);
    end(r);
    lw_gl_target_resolve(&r->picture);
    return status == LW_OK ? lw_gl_program_check("drawing", err) : status;
}

static enum lw_status read_target(const struct lw_gl_target *target, float *out_rgb, struct lw_error *err) {
    const size_t width = target->width, height = target->height;
    float *row = malloc(4 * width * sizeof *row);
    if (row == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a picture");
    glBindFramebuffer(GL_READ_FRAMEBUFFER, target->frame);
    glPixelStorei(GL_PACK_ALIGNMENT, 4);
    for (size_t y = 0; y < height; y++) {
        glReadPixels(0, (GLint)(height - 1 - y), (GLsizei)width, 1, GL_RGBA, GL_FLOAT, row);
        for (size_t x = 0; x < width; x++)
            memcpy(out_rgb + 3 * (y * width + x), row + 4 * x, 3 * sizeof *row);
    }
    free(row);
    return lw_gl_program_check("reading the picture", err);
}

enum lw_status lw_gl_renderer_read(struct lw_gl_renderer *r, float *out_rgb, struct lw_error *err) {
    return read_target(&r->picture, out_rgb, err);
}

void lw_gl_renderer_show(struct lw_gl_renderer *r, unsigned frame, enum lw_tonemap_curve curve, float stops,
                         uint32_t width, uint32_t height) {
    glBindFramebuffer(GL_FRAMEBUFFER, frame);
    glViewport(0, 0, (GLsizei)width, (GLsizei)height);
    glUseProgram(r->show);
    glUniform1f(r->show_exposure, exp2f(fminf(fmaxf(stops, -LW_TONEMAP_STOPS_MAX), LW_TONEMAP_STOPS_MAX)));
    glUniform1i(r->show_curve, (GLint)curve);
    bind(UNIT_BASE, GL_TEXTURE_2D, r->picture.texture);
    glBindVertexArray(r->empty_array);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glBindVertexArray(0);
    glUseProgram(0);
}

enum lw_status lw_gl_renderer_meter(struct lw_gl_renderer *r, float *out_stops, struct lw_error *err) {
    enum { WIDTH = METERED, HEIGHT = METERED };
    enum lw_status status = lw_gl_target_resize(&r->metered, WIDTH, HEIGHT, 1, err);
    if (status != LW_OK) return status;
    float *rgb = malloc(sizeof(float) * 3 * WIDTH * HEIGHT);
    if (rgb == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the exposure");
    glBindFramebuffer(GL_READ_FRAMEBUFFER, r->picture.frame);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, r->metered.frame);
    glBlitFramebuffer(0, 0, (GLint)r->picture.width, (GLint)r->picture.height, 0, 0, WIDTH, HEIGHT,
                      GL_COLOR_BUFFER_BIT, GL_LINEAR);
    status = read_target(&r->metered, rgb, err);
    glBindFramebuffer(GL_FRAMEBUFFER, 0);
    if (status == LW_OK) *out_stops = lw_tonemap_auto_stops(rgb, (size_t)WIDTH * HEIGHT);
    free(rgb);
    return status;
}

/* ---- which tiles a view needs ---- */

/* The tile of a pixel: its place in the table of words plus one, or 0. A tile of a finer level gets an id,
 * if one is left. */
static lw_tile_id tile_of(const struct lw_atlas_map *map, uint32_t pixel) {
    if (pixel == 0) return (lw_tile_id){UINT32_MAX};
    if (pixel <= map->plain_count) return (lw_tile_id){pixel - 1};
    const uint64_t name = pixel - 1 - map->plain_count;
    return name < map->fine_names ? lw_atlas_map_claim_name(map, name) : (lw_tile_id){UINT32_MAX};
}

enum lw_status lw_gl_renderer_survey(struct lw_gl_renderer *r, const struct lw_compose_view *view,
                                     uint8_t *out_needed, uint64_t *out_shown, uint64_t *out_pixels,
                                     struct lw_error *err) {
    struct lw_compose_view small = *view;
    small.width = (view->width + SURVEY_SHARE - 1) / SURVEY_SHARE;
    small.height = (view->height + SURVEY_SHARE - 1) / SURVEY_SHARE;
    const size_t count = (size_t)small.width * small.height;
    enum lw_status status = lw_gl_target_resize(&r->survey, small.width, small.height, 1, err);
    if (status != LW_OK) return status;
    if (count > r->tiles_room) {
        uint32_t *tiles = realloc(r->tiles, 2 * count * sizeof *tiles);
        if (tiles == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the view");
        r->tiles = tiles;
        r->tiles_room = count;
    }
    struct view v = make_view(r, &small);
    v.variant = VARIANT_FEEDBACK;
    if (r->lights.scene) {
        status = draw_maps(r, view, err);
        if (status != LW_OK) return status;
        v.variant |= VARIANT_LIT;
    }
    v.finer =
        (float)count / ((float)view->width * (float)view->height); /* levels are those of the large one */
    static const GLuint none[4] = {0};
    begin(r);
    lw_gl_target_bind(&r->survey);
    glClearBufferuiv(GL_COLOR, 0, none);
    glClear(GL_DEPTH_BUFFER_BIT);
    status = draw_scene(r, &v, err);
    end(r);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, r->survey.frame);
    glReadPixels(0, 0, (GLsizei)small.width, (GLsizei)small.height, GL_RG_INTEGER, GL_UNSIGNED_INT, r->tiles);
    if (status == LW_OK) status = lw_gl_program_check("drawing", err);
    lw_gl_fine_tiles_survey(&r->light.fine);
    for (size_t i = 0; status == LW_OK && i < count; i++) {
        const lw_tile_id tile = tile_of(r->desc.map, r->tiles[2 * i]);
        if (tile.v == UINT32_MAX) continue;
        lw_gl_fine_tiles_want(&r->light.fine, tile);
        out_needed[tile.v] = 1;
        out_shown[tile.v] += r->tiles[2 * i + 1];
    }
    *out_pixels = count;
    return status;
}

bool lw_gl_renderer_is_software(void) {
    const char *name = (const char *)glGetString(GL_RENDERER);
    return name == NULL || strstr(name, "llvmpipe") != NULL || strstr(name, "softpipe") != NULL ||
           strstr(name, "swrast") != NULL || strstr(name, "SwiftShader") != NULL;
}

const char *lw_gl_renderer_name(const struct lw_gl_renderer *r) {
    (void)r;
    const GLubyte *name = glGetString(GL_RENDERER);
    return name ? (const char *)name : "unknown";
}

struct lw_gl_renderer_figures lw_gl_renderer_figures(const struct lw_gl_renderer *r) {
    return r->figures;
}
