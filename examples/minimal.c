/* Irradiance at a point of the scene as it changes: minimal [PORT [FROM_X FROM_Y FROM_Z [DIR_X DIR_Y DIR_Z]]]
 * The point is where a ray from FROM along DIR (default: from 1.7 m above the origin, down) meets the scene.
 *     cc minimal.c -o minimal $(pkg-config --cflags --libs lightwell) */
#include <lightwell/lightwell.h>

#include <stdio.h>
#include <stdlib.h>

static struct lw_live_error err;

static void check(enum lw_live_status status) {
    if (status == LW_LIVE_OK) return;
    fprintf(stderr, "minimal: %s\n", err.text);
    exit(EXIT_FAILURE);
}

int main(int argc, char **argv) {
    struct lw_live_desc desc = {.struct_size = sizeof desc, .name = "minimal"};
    struct lw_live_stats stats = {.struct_size = sizeof stats};
    struct lw_live_hit hit = {.struct_size = sizeof hit};
    struct lw_live *live;
    float ray[6] = {0, 1.7f, 0, 0, -1, 0}, rgb[3], before[3] = {-1, -1, -1};
    desc.port = (uint16_t)(argc > 1 ? atoi(argv[1]) : 7780);
    for (int i = 0; i < 6 && i + 2 < argc; i++) ray[i] = strtof(argv[i + 2], NULL);

    check(lw_live_open(&desc, &live, &err));
    do { /* the scene first, then its first light */
        check(lw_live_poll(live, 100, &err));
        check(lw_live_get_stats(live, &stats, &err));
    } while (!stats.has_light);

    check(lw_live_cast(live, ray, ray + 3, &hit, &err));
    if (hit.object == LW_LIVE_NONE) {
        fprintf(stderr, "minimal: the ray meets nothing\n");
        return EXIT_FAILURE;
    }
    struct lw_live_object object = {.struct_size = sizeof object};
    check(lw_live_get_object(live, hit.object, &object, &err));
    printf("on \"%s\", at %.2f %.2f %.2f\n", object.name, hit.position_ws[0], hit.position_ws[1],
           hit.position_ws[2]);
    for (;;) {
        check(lw_live_sample(live, hit.object, hit.lightmap_uv, rgb, &err));
        if (rgb[0] != before[0] || rgb[1] != before[1] || rgb[2] != before[2]) {
            check(lw_live_get_stats(live, &stats, &err));
            printf("%8.3f s  %.4g %.4g %.4g W/m^2\n", stats.time_s, rgb[0], rgb[1], rgb[2]);
            fflush(stdout);
        }
        for (int i = 0; i < 3; i++) before[i] = rgb[i];
        check(lw_live_poll(live, 1000, &err)); /* ends when the server does */
    }
}
