#include "server/solve/adapt/verify_order.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum lw_status lw_verify_order_init(struct lw_verify_order *order, uint32_t tile_count) {
    *order = (struct lw_verify_order){.turn = calloc(tile_count + 1ul, sizeof *order->turn)};
    return order->turn ? LW_OK : LW_NO_MEMORY;
}

void lw_verify_order_finish(struct lw_verify_order *order) { free(order->turn); }

static void add_places(struct lw_verify_order *order, struct lw_vec3 was, struct lw_vec3 is) {
    if (order->place_count + 2 > LW_VERIFY_ORDER_PLACES_MAX) return;
    order->place_ws[order->place_count++] = was;
    order->place_ws[order->place_count++] = is;
}

void lw_verify_order_note(struct lw_verify_order *order, struct lw_tiles *tiles, const struct lw_scene *scene,
                          const struct lw_pose *was, const struct lw_pose *is) {
    uint32_t last = UINT32_MAX;
    order->place_count = 0;
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (scene->light[i].kind != LW_LIGHT_DIRECTIONAL &&
            memcmp(&was->light[i], &is->light[i], sizeof *is->light) != 0)
            add_places(order, was->light[i].position_ws, is->light[i].position_ws);
    for (uint32_t i = 0; i < tiles->count; i++) {
        struct lw_solve_tile *tile = &tiles->tile[i];
        const uint32_t object = tile->object;
        tile->unasked = true;
        tile->moved = lw_pose_object_differs(was, is, object);
        if (object == last || !tile->moved) continue;
        last = object;
        add_places(order, lw_affine_point(&was->object_to_world[object], tile->centre_os),
                   lw_affine_point(&is->object_to_world[object], tile->centre_os));
    }
}

/* The least is asked first. */
static float rank_of(const struct lw_verify_order *order, const struct lw_schedule *schedule,
                     const struct lw_solve_tile *tile) {
    float distance = order->place_count ? INFINITY : 0;
    for (uint32_t k = 0; k < order->place_count; k++)
        distance = fminf(distance,
                         lw_vec3_length(lw_vec3_sub(tile->centre_ws, order->place_ws[k])) - tile->radius_m);
    const bool looked_at = lw_schedule_looks_at(schedule, tile);
    return (tile->moved ? -1 : fmaxf(distance, 0)) + (looked_at ? 0 : FLT_MAX / 2);
}

static int compare_turns(const void *a, const void *b) {
    const struct lw_verify_order_turn *x = a, *y = b;
    return x->rank != y->rank ? (x->rank > y->rank) - (x->rank < y->rank)
                              : (x->tile > y->tile) - (x->tile < y->tile);
}

void lw_verify_order_sort(struct lw_verify_order *order, const struct lw_tiles *tiles,
                          const struct lw_schedule *schedule, bool limited) {
    bool any = false;
    for (uint32_t i = 0; limited && i < tiles->count; i++)
        any |= tiles->tile[i].serves && tiles->tile[i].unasked;
    for (uint32_t i = 0; i < tiles->count; i++)
        order->turn[i] =
            (struct lw_verify_order_turn){any ? rank_of(order, schedule, &tiles->tile[i]) : 0, i};
    if (any) qsort(order->turn, tiles->count, sizeof *order->turn, compare_turns);
}
