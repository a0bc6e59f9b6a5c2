/* Tiles of finer levels, as a pool on a GPU would hold them: finer [PORT [TILES]]
 * Looks through the first camera of the scene until TILES tiles (default: 3) have been shown whole, then
 * looks away until all are gone. A line for each slot that gets texels, is shown whole, or is free again.
 *     cc finer.c -o finer $(pkg-config --cflags --libs lightwell) -lm */
#include <lightwell/lightwell.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define SLOTS 64u
#define SIDE  (LW_LIVE_TILE_SIDE + 1)

static struct lw_live *live;
static struct lw_live_error err;
static uint32_t pool[SLOTS][SIDE * SIDE]; /* layers of a texture */
static struct page {
    uint32_t slot;
    float share; /* 0: the tile is not shown */
} * page_table;
static unsigned whole; /* tiles that were shown so, ever */

static void check(enum lw_live_status status) {
    if (status == LW_LIVE_OK) return;
    fprintf(stderr, "finer: %s\n", err.text);
    exit(EXIT_FAILURE);
}

/* Clip space from world space, column by column; z is w. */
static struct lw_live_view view_of(const struct lw_live_camera *c, uint32_t width, uint32_t height) {
    const float up = 1 / tanf(c->fov_y / 2), scale[4] = {up * (float)height / (float)width, up, 1, 1};
    const float *axis[4] = {c->right_ws, c->up_ws, c->forward_ws, c->forward_ws};
    struct lw_live_view view = {.struct_size = sizeof view, .width = width, .height = height};
    for (int r = 0; r < 4; r++)
        for (int k = 0; k < 3; k++) {
            view.view_projection[4 * k + r] = scale[r] * axis[r][k];
            view.view_projection[12 + r] -= scale[r] * axis[r][k] * c->position_ws[k];
        }
    return view;
}

static uint64_t now_ns(void) {
    struct timespec now;
    timespec_get(&now, TIME_UTC);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

static void say(const struct lw_live_slot *s, const char *what) {
    struct lw_live_object object = {.struct_size = sizeof object};
    check(lw_live_get_object(live, s->rect.object, &object, &err));
    printf("slot %2u: \"%s\", %u times finer, texel %u, %u: %s\n", s->slot, object.name,
           1u << (s->rect.level - LW_LIVE_FINER), s->rect.x, s->rect.y, what);
    fflush(stdout);
}

/* Called for each frame, before it is drawn. */
static void take_slots(void) {
    struct lw_live_slot slots[2 * SLOTS];
    size_t count = lw_live_take_slots(live, now_ns(), 8, slots, 2 * SLOTS);
    for (size_t i = 0; i < count; i++) {
        const struct lw_live_slot *s = &slots[i];
        const float before = page_table[s->page].share;
        page_table[s->page].slot = s->slot;
        page_table[s->page].share = s->share;
        if (s->has_texels) {
            struct lw_live_texels to = {.struct_size = sizeof to, .format = LW_LIVE_RGB9E5};
            to.quantity = LW_LIVE_IRRADIANCE_OVER_PI;
            to.dst = pool[s->slot];
            to.dst_size = sizeof pool[s->slot];
            to.row_size = SIDE * sizeof **pool;
            check(lw_live_read(live, &s->rect, &to, &err));
            if (s->share <= 0) say(s, "texels");
        } else if (s->share <= 0) {
            say(s, "gone");
        }
        if (before < 1 && s->share >= 1) say(s, "shown");
        whole += before < 1 && s->share >= 1;
    }
}

int main(int argc, char **argv) {
    struct lw_live_desc desc = {.struct_size = sizeof desc, .name = "finer", .finer_slots = SLOTS};
    struct lw_live_stats stats = {.struct_size = sizeof stats};
    struct lw_live_finer finer = {.struct_size = sizeof finer};
    struct lw_live_camera camera = {.struct_size = sizeof camera};
    const unsigned tiles = argc > 2 ? (unsigned)atoi(argv[2]) : 3;
    desc.port = (uint16_t)(argc > 1 ? atoi(argv[1]) : 7780);
    check(lw_live_open(&desc, &live, &err));
    do {
        check(lw_live_poll(live, 100, &err));
        check(lw_live_get_stats(live, &stats, &err));
    } while (!stats.has_light);
    check(lw_live_get_finer(live, &finer, &err));
    check(lw_live_get_camera(live, 0, &camera, &err));
    if (finer.level_count == 0) {
        fprintf(stderr, "finer: the server lights no finer levels\n");
        return EXIT_FAILURE;
    }
    page_table = calloc(finer.page_count, sizeof *page_table);
    if (!page_table) return EXIT_FAILURE;
    const struct lw_live_view view = view_of(&camera, 1280, 720);
    do {
        check(lw_live_want_views(live, &view, whole < tiles ? 1 : 0, &err));
        check(lw_live_poll(live, 15, &err));
        take_slots();
        check(lw_live_get_finer(live, &finer, &err));
    } while (whole < tiles || finer.slots_used > 0);
    free(page_table);
    lw_live_close(live);
}
