#include "common/scene/scene.h"

#include <stdlib.h>
#include <string.h>

/* A scene's arrays live as long as the scene, so they come from chunks that are freed together. Arrays larger
 * than half a chunk get a chunk of their own: calloc takes those from the system already zeroed, without
 * touching them. */
#define CHUNK_SIZE 65536u
#define ALIGNMENT  16u
/* Vector loads of the last element of an array (Embree reads 16 bytes of a 12-byte vertex) stay inside the
 * chunk. */
#define READABLE_PAST_END 16u

struct chunk {
    struct chunk *next;
    size_t used, capacity; /* bytes behind this header */
};
#define CHUNK_HEADER ((sizeof(struct chunk) + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT)

struct storage {
    struct chunk *small; /* small arrays are cut from the first of these */
    struct chunk *large; /* one array each */
};

/* Memory that create() allocates in one piece. */
struct whole {
    struct lw_scene scene;
    struct storage storage;
};

enum lw_status lw_scene_create(struct lw_scene **out_scene) {
    struct whole *whole = calloc(1, sizeof *whole);
    if (!whole) return LW_NO_MEMORY;
    whole->scene.storage = &whole->storage;
    whole->scene.name = "";
    *out_scene = &whole->scene;
    return LW_OK;
}

static void free_chunks(struct chunk *chunk) {
    while (chunk) {
        struct chunk *next = chunk->next;
        free(chunk);
        chunk = next;
    }
}

void lw_scene_destroy(struct lw_scene *scene) {
    if (!scene) return;
    struct storage *storage = scene->storage;
    free_chunks(storage->small);
    free_chunks(storage->large);
    free(scene); /* it is the first member of its struct whole */
}

static struct chunk *create_chunk(size_t capacity) {
    if (capacity > SIZE_MAX - CHUNK_HEADER - READABLE_PAST_END) return NULL;
    struct chunk *chunk = calloc(1, CHUNK_HEADER + capacity + READABLE_PAST_END);
    if (chunk) chunk->capacity = capacity;
    return chunk;
}

/* A chunk with room for `bytes`, linked into the storage. */
static struct chunk *find_room(struct storage *storage, size_t bytes) {
    struct chunk **list = bytes > CHUNK_SIZE / 2 ? &storage->large : &storage->small;
    if (list == &storage->small && *list && (*list)->capacity - (*list)->used >= bytes) return *list;
    struct chunk *chunk = create_chunk(list == &storage->small ? CHUNK_SIZE : bytes);
    if (!chunk) return NULL;
    chunk->next = *list;
    *list = chunk;
    return chunk;
}

enum lw_status lw_scene_init_variant(struct lw_scene *variant, const struct lw_scene *original) {
    const size_t count = original->material_count;
    *variant = *original;
    variant->storage = NULL; /* the original's alone */
    variant->material = malloc((count + 1) * sizeof *variant->material);
    if (!variant->material) return LW_NO_MEMORY;
    if (count) memcpy(variant->material, original->material, count * sizeof *variant->material);
    return LW_OK;
}

void lw_scene_finish_variant(struct lw_scene *variant) {
    free(variant->material);
    *variant = (struct lw_scene){0};
}

bool lw_scene_has_finishes(const struct lw_scene *scene) {
    for (uint32_t m = 0; m < scene->material_count; m++)
        if (scene->material[m].finish) return true;
    return false;
}

static bool has_finish(const struct lw_material *material) { return material->finish != NULL; }

static bool has_bumps(const struct lw_material *material) {
    const struct lw_finish *finish = material->finish;
    return finish && !material->unlit &&
           (finish->normal_texture.texture != LW_SCENE_NONE ||
            finish->surface_texture.texture != LW_SCENE_NONE || finish->roughness < LW_SCENE_ROUGH);
}

/* Whether a material of an object is one for which `holds` says so. */
static bool object_has(const struct lw_scene *scene, uint32_t object,
                       bool (*holds)(const struct lw_material *material)) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        if (holds(&scene->material[mesh->material[t]])) return true;
    return false;
}

bool lw_scene_object_has_finishes(const struct lw_scene *scene, uint32_t object) {
    return object_has(scene, object, has_finish);
}

bool lw_scene_object_has_bumps(const struct lw_scene *scene, uint32_t object) {
    return object_has(scene, object, has_bumps);
}

void lw_scene_drop_finishes(struct lw_scene *scene) {
    for (uint32_t i = 0; i < scene->material_count; i++) scene->material[i].finish = NULL;
    for (uint32_t i = 0; i < scene->mesh_count; i++) scene->mesh[i].tangent = NULL;
    scene->finish_texture = NULL;
    scene->finish_texture_count = 0;
}

void *lw_scene_alloc(struct lw_scene *scene, size_t count, size_t size) {
    size_t bytes;
    if (__builtin_mul_overflow(count, size, &bytes) || bytes > SIZE_MAX - ALIGNMENT) return NULL;
    if (bytes == 0) bytes = 1; /* an empty array has an address too: NULL means out of memory */
    bytes = (bytes + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    struct chunk *chunk = find_room(scene->storage, bytes);
    if (!chunk) return NULL;
    void *memory = (char *)chunk + CHUNK_HEADER + chunk->used;
    chunk->used += bytes;
    return memory;
}

const char *lw_scene_string(struct lw_scene *scene, const char *text) {
    if (!text || !*text) return "";
    size_t size = strlen(text) + 1;
    char *copy = lw_scene_alloc(scene, size, 1);
    if (copy) memcpy(copy, text, size);
    return copy;
}

enum lw_status lw_scene_add_object(struct lw_scene *scene, uint32_t mesh, uint32_t node,
                                   struct lw_error *err) {
    if (scene->object_count >= LW_SCENE_OBJECTS_MAX)
        return lw_status_fail(err, LW_BAD_DATA,
                              "has more than %u objects: join what stands together into one mesh",
                              LW_SCENE_OBJECTS_MAX);
    const char *name = *scene->node[node].name ? scene->node[node].name : scene->mesh[mesh].name;
    scene->object[scene->object_count++] = (struct lw_object){.name = name, .mesh = mesh, .node = node};
    return LW_OK;
}

static bool any_positive(const float rgb[3]) { return rgb[0] > 0 || rgb[1] > 0 || rgb[2] > 0; }

static bool mesh_emits(const struct lw_scene *scene, const struct lw_mesh *mesh) {
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        if (any_positive(scene->material[mesh->material[t]].emission)) return true;
    return false;
}

bool lw_scene_has_light(const struct lw_scene *scene) {
    if (any_positive(scene->sky)) return true;
    const struct lw_environment *e = &scene->environment;
    for (size_t i = 0; i < (size_t)e->width * e->height; i++)
        if (any_positive(e->rgb + 3 * i)) return true;
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (any_positive(scene->light[i].intensity)) return true;
    for (uint32_t i = 0; i < scene->light_channel_count; i++) {
        const struct lw_channel *channel = &scene->light_channel[i];
        const uint64_t floats = (uint64_t)channel->key_count * lw_channel_width(channel) *
                                (channel->interpolation == LW_INTERPOLATION_CUBIC ? 3 : 1);
        for (uint64_t k = 0; channel->path == LW_CHANNEL_INTENSITY && k < floats; k++)
            if (channel->value[k] > 0) return true;
    }
    for (uint32_t i = 0; i < scene->object_count; i++)
        if (!lw_scene_is_spare(scene, i) && mesh_emits(scene, &scene->mesh[scene->object[i].mesh]))
            return true;
    return false;
}
