#include "client/lib/draws.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

void lw_draws_finish(struct lw_draws *draws) {
    free(draws->flags);
    free(draws->bits);
    *draws = (struct lw_draws){0};
}

enum lw_status lw_draws_begin(struct lw_draws *draws, const struct lw_message_welcome *welcome, bool offered,
                              struct lw_error *err) {
    lw_draws_finish(draws);
    if (!(welcome->features & LW_FEATURE_DRAWS)) return LW_OK;
    if (!offered)
        return lw_status_fail(
            err, LW_PROTOCOL,
            "message WELCOME: features have bit 6, draws direct light, which was not offered");
    draws->bits = malloc(welcome->client_lights_size + welcome->client_materials_size + 1);
    if (!draws->bits) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    draws->taken_up = true;
    draws->lights_size = welcome->client_lights_size;
    draws->materials_size = welcome->client_materials_size;
    if (draws->lights_size) memcpy(draws->bits, welcome->client_lights, draws->lights_size);
    if (draws->materials_size)
        memcpy(draws->bits + draws->lights_size, welcome->client_materials, draws->materials_size);
    return LW_OK;
}

/* One flag for each bit; `count`: things that there are. */
static enum lw_status read_bits(const uint8_t *bits, size_t size, const char *field, const char *thing,
                                uint32_t count, uint8_t *out_flag, struct lw_error *err) {
    for (size_t i = 0; i < 8 * size; i++) {
        const uint8_t bit = bits[i / 8] >> (i % 8) & 1;
        if (bit && i >= count)
            return lw_status_fail(err, LW_PROTOCOL, "message WELCOME: %s has %s %zu of %u", field, thing, i,
                                  count);
        if (i < count) out_flag[i] = bit;
    }
    return LW_OK;
}

enum lw_status lw_draws_set_scene(struct lw_draws *draws, const struct lw_scene *scene,
                                  struct lw_error *err) {
    if (!draws->taken_up) return LW_OK;
    const uint32_t lights = scene->light_count, materials = scene->material_count;
    LW_INVARIANT(!draws->has_scene ||
                 (draws->of.light_count == lights && draws->of.material_count == materials));
    free(draws->flags);
    if (!(draws->flags = calloc((size_t)lights + materials + 1, 1)))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    draws->of = (struct lw_client_draws){lights, materials, draws->flags, draws->flags + lights};
    enum lw_status status =
        read_bits(draws->bits, draws->lights_size, "client_lights", "light", lights, draws->flags, err);
    if (status == LW_OK)
        status = read_bits(draws->bits + draws->lights_size, draws->materials_size, "client_materials",
                           "material", materials, draws->flags + lights, err);
    draws->has_scene = status == LW_OK;
    return status;
}
