/* packets: every covered texel of a block belongs to one packet. Packets are full. Packets on one surface
 * take turns. */
#include "server/solve/surface/packets.h"
#include "tests/support/support.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SIDE  LW_TILE_BLOCK
#define COUNT (SIDE * SIDE)

struct block {
    struct lw_mesh_texels mesh;
    float position[3][COUNT];
    uint32_t normal[COUNT];
    uint16_t reach[COUNT];
    uint8_t covered[COUNT], region[COUNT];
    struct lw_packet packet[LW_PACKETS_MAX];
    uint32_t count;
};

static void set_texel(struct block *b, uint32_t i, struct lw_vec3 position, struct lw_vec3 normal) {
    const float p[3] = {position.x, position.y, position.z};
    for (int c = 0; c < 3; c++) b->position[c][i] = p[c];
    b->normal[i] = lw_packed_normal(normal);
}

/* A flat square of texels of a decimetre. */
static struct block *flat(void) {
    struct block *b = calloc(1, sizeof *b);
    assert_non_null(b);
    for (int c = 0; c < 3; c++) b->mesh.position[c] = b->position[c];
    b->mesh.normal = b->normal;
    b->mesh.sample_points.reach = b->reach;
    for (uint32_t i = 0; i < COUNT; i++) {
        set_texel(b, i, lw_vec3(0.1f * (float)(i % SIDE), 0, 0.1f * (float)(i / SIDE)), lw_vec3(0, 1, 0));
        b->reach[i] = lw_packed_length(0.05f);
        b->covered[i] = 1;
        b->region[i] = (uint8_t)(i % SIDE / 4);
    }
    return b;
}

static void deal(struct block *b) {
    b->count = lw_packets_deal(&b->mesh, 0, SIDE, SIDE, SIDE, b->covered, b->region, b->packet);
}

/* Each covered texel once, no other, in as few packets as they fill. */
static void check(const struct block *b) {
    uint32_t seen[COUNT] = {0}, covered = 0;
    for (uint32_t k = 0; k < b->count; k++)
        for (uint32_t lane = 0; lane < b->packet[k].count; lane++) seen[b->packet[k].texel[lane]]++;
    for (uint32_t i = 0; i < COUNT; i++) {
        assert_int_equal(seen[i], b->covered[i]);
        covered += b->covered[i];
    }
    for (uint32_t k = 0; k < b->count; k++) {
        uint32_t lanes[LW_REGIONS] = {0};
        for (uint32_t lane = 0; lane < b->packet[k].count; lane++)
            lanes[b->region[b->packet[k].texel[lane]]]++;
        for (uint32_t r = 0; r < LW_REGIONS; r++) assert_int_equal(b->packet[k].lanes[r], lanes[r]);
    }
    assert_int_equal(b->count, (covered + LW_TRACE_WIDTH - 1) / LW_TRACE_WIDTH);
}

static void on_one_surface_every_fourth(void **state) {
    (void)state;
    struct block *b = flat();
    deal(b);
    check(b);
    for (uint32_t k = 0; k < b->count; k++)
        for (uint32_t lane = 1; lane < LW_TRACE_WIDTH; lane++) {
            const uint32_t one = b->packet[k].texel[0], other = b->packet[k].texel[lane];
            assert_int_equal(one % SIDE % 4, other % SIDE % 4);
            assert_int_equal(one / SIDE % 4, other / SIDE % 4);
        }
    free(b);
}

/* Texels in turn of two walls that look at one another: no packet shows both. */
static void what_looks_another_way_is_apart(void **state) {
    (void)state;
    struct block *b = flat();
    for (uint32_t i = 1; i < COUNT; i += 2)
        set_texel(b, i, lw_vec3(b->position[0][i], 3, b->position[2][i]), lw_vec3(0, -1, 0));
    deal(b);
    check(b);
    for (uint32_t k = 0; k < b->count; k++)
        for (uint32_t lane = 1; lane < b->packet[k].count; lane++)
            assert_int_equal(b->packet[k].texel[0] % 2, b->packet[k].texel[lane] % 2);
    free(b);
}

static void what_lies_elsewhere_is_apart(void **state) {
    (void)state;
    struct block *b = flat();
    for (uint32_t i = 0; i < COUNT; i++)
        if (i % SIDE % 8 >= 4) b->position[0][i] += 20;
    deal(b);
    check(b);
    for (uint32_t k = 0; k < b->count; k++)
        for (uint32_t lane = 1; lane < b->packet[k].count; lane++)
            assert_int_equal(b->packet[k].texel[0] / 4 % 2, b->packet[k].texel[lane] / 4 % 2);
    free(b);
}

static void some_texels_or_none(void **state) {
    (void)state;
    struct block *b = flat();
    memset(b->covered, 0, sizeof b->covered);
    deal(b);
    assert_int_equal(b->count, 0);
    for (uint32_t i = 0; i < COUNT; i++) { /* scattered, of any position and normal, some of no size */
        const float a = (float)(i * 2654435761u % 1024);
        set_texel(b, i, lw_vec3(a, -a, sinf(a)), lw_vec3(sinf(a), cosf(a), 0));
        b->reach[i] = i % 3 ? 0 : lw_packed_length(0.05f);
        b->covered[i] = i % 5 == 0 || i % 7 == 0;
    }
    deal(b);
    check(b);
    memset(b->covered, 0, sizeof b->covered);
    b->covered[37] = 1;
    deal(b);
    check(b);
    free(b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(on_one_surface_every_fourth), cmocka_unit_test(what_looks_another_way_is_apart),
        cmocka_unit_test(what_lies_elsewhere_is_apart), cmocka_unit_test(some_texels_or_none)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
