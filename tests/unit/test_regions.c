/* What regions hold: quarters of a block, or texels of one room; what rooms are. */
#include "server/solve/surface/regions.h"
#include "tests/support/support.h"

#define SIDE  LW_TILE_BLOCK
#define COUNT (SIDE * SIDE)

struct block {
    uint8_t covered[COUNT], room[COUNT], region[COUNT];
    uint32_t side[COUNT], chart[COUNT], wide;
    struct lw_region_parts parts;
};

static void deal(struct block *b) {
    const struct lw_mesh_texels mesh = {.chart = b->chart};
    b->wide = lw_rooms_find(&mesh, 0, SIDE, SIDE, b->covered, b->side, b->room);
    b->parts = lw_regions_deal(SIDE, SIDE, SIDE, b->covered, b->room, b->region);
}

static struct block whole(void) {
    struct block b = {.parts.count = 0};
    for (uint32_t i = 0; i < COUNT; i++) b.covered[i] = 1;
    return b;
}

static uint32_t part_of(const struct block *b, uint32_t texel) {
    uint32_t part = 0;
    while (b->region[texel] >= b->parts.end[part]) part++;
    assert_true(part < b->parts.count);
    return part;
}

/* Texels of two sides of a chart are of two parts; all regions are somebody's. */
static void check_apart(const struct block *b) {
    assert_int_equal(b->parts.end[b->parts.count - 1], LW_REGIONS);
    for (uint32_t i = 0; i < COUNT; i++)
        for (uint32_t j = 0; j < i; j++)
            if (b->covered[i] && b->covered[j] && b->chart[i] == b->chart[j])
                assert_int_equal(part_of(b, i) == part_of(b, j), b->side[i] == b->side[j]);
}

static void count_regions(const struct block *b, uint32_t count[LW_REGIONS]) {
    for (uint32_t r = 0; r < LW_REGIONS; r++) count[r] = 0;
    for (uint32_t i = 0; i < COUNT; i++)
        if (b->covered[i]) count[b->region[i]]++;
}

static void without_walls_quarters(void **state) {
    (void)state;
    struct block b = whole();
    for (uint32_t i = 0; i < COUNT; i++) b.chart[i] = b.side[i] = i / 48; /* charts, each of one side */
    deal(&b);
    assert_int_equal(b.parts.count, 1);
    assert_int_equal(b.parts.end[0], LW_REGIONS);
    for (uint32_t i = 0; i < COUNT; i++) assert_int_equal(b.region[i], (i / SIDE / 8) * 2 + i % SIDE / 8);
}

/* Two sides that lie in one quarter, as in a lightmap of a few texels. */
static void a_wall_in_a_corner(void **state) {
    (void)state;
    struct block b = {.parts.count = 0};
    for (uint32_t i = 0; i < COUNT; i++) {
        b.covered[i] = i / SIDE < 8 && i % SIDE < 8;
        b.side[i] = i % SIDE < 4;
    }
    deal(&b);
    assert_int_equal(b.parts.count, 2);
    check_apart(&b);
}

/* At any column: two regions each, whose texels lie together. */
static void a_wall_parts_two_sides(void **state) {
    (void)state;
    for (uint32_t at = 1; at < SIDE; at++) {
        struct block b = whole();
        uint32_t count[LW_REGIONS];
        for (uint32_t i = 0; i < COUNT; i++) b.side[i] = 7 + (i % SIDE < at);
        deal(&b);
        check_apart(&b);
        assert_int_equal(b.parts.count, 2);
        count_regions(&b, count);
        for (uint32_t r = 0; r < LW_REGIONS; r++) assert_true(count[r] > 0);
    }
}

static void many_sides(void **state) {
    (void)state;
    for (uint32_t sides = 3; sides <= 6; sides++) {
        struct block b = whole();
        uint32_t count[LW_REGIONS];
        for (uint32_t i = 0; i < COUNT; i++)
            b.side[i] = i / SIDE < sides - 1 ? i / SIDE : sides - 1; /* one row each, and the rest */
        deal(&b);
        if (sides <= LW_REGIONS) check_apart(&b);
        assert_int_equal(b.parts.count, sides < LW_REGIONS ? sides : LW_REGIONS);
        assert_int_equal(b.parts.end[b.parts.count - 1], LW_REGIONS);
        count_regions(&b, count);
        for (uint32_t r = 0; r < LW_REGIONS; r++) assert_true(count[r] > 0);
        /* left-over texels are no part of the largest sides */
        for (uint32_t i = 0; i < COUNT; i++)
            if (b.side[i] != sides - 1) assert_true(part_of(&b, i) != part_of(&b, COUNT - 1));
    }
}

/* Small charts that nothing cuts are together, and with no side of one that is cut. */
static void beside_charts_without_walls(void **state) {
    (void)state;
    struct block b = whole();
    for (uint32_t i = 0; i < COUNT; i++) {
        b.chart[i] = i / SIDE < 4 ? 0 : i / SIDE < 12 ? 1 : 2;
        b.side[i] = 10 * b.chart[i] + (b.chart[i] == 1 && i % SIDE < 8);
        b.covered[i] = i % 5 != 0;
    }
    deal(&b);
    check_apart(&b);
    assert_int_equal(b.parts.count, 3);
    const uint32_t uncut = part_of(&b, 1);
    for (uint32_t i = 0; i < COUNT; i++)
        if (b.covered[i]) assert_int_equal(part_of(&b, i) == uncut, b.chart[i] != 1);
}

/* A wall that stands on texels without light cuts nothing. */
static void what_is_not_covered_does_not_count(void **state) {
    (void)state;
    struct block b = whole();
    for (uint32_t i = 0; i < COUNT; i++) b.side[i] = b.covered[i] = i % SIDE < 8;
    deal(&b);
    assert_int_equal(b.parts.count, 1);
    for (uint32_t i = 0; i < COUNT; i++) b.covered[i] = 0;
    deal(&b);
    assert_int_equal(b.parts.count, 1);
}

/* The largest comes first; a chart that nothing cuts is one if it is wide, and else room 0. */
static void rooms_by_size(void **state) {
    (void)state;
    struct block b = whole();
    for (uint32_t i = 0; i < COUNT; i++) {
        b.chart[i] = i / SIDE >= 12;
        b.side[i] = b.chart[i] ? 9 : i / SIDE < 3 ? 1 : 2; /* 48, 144 and, of a chart of its own, 64 texels */
        b.covered[i] = i != COUNT - 1;
    }
    deal(&b);
    assert_int_equal(b.wide, 1);
    for (uint32_t i = 0; i < COUNT; i++) assert_int_equal(b.room[i], b.chart[i] ? 0 : b.side[i] == 2 ? 1 : 2);
    b.covered[COUNT - 1] = 1;
    deal(&b);
    assert_int_equal(b.wide, 2);
    for (uint32_t i = 0; i < COUNT; i++) assert_int_equal(b.room[i], b.chart[i] ? 2 : b.side[i] == 2 ? 1 : 3);
    b.covered[COUNT - 1] = 0;
    deal(&b);
    for (uint32_t part = 0; part < b.parts.count; part++)
        assert_int_equal(b.parts.room[part], part == 0 ? 1 : part == 1 ? 0 : 2);
}

/* Each texel a side of its own: more than there are numbers. */
static void more_rooms_than_numbers(void **state) {
    (void)state;
    struct block b = whole();
    for (uint32_t i = 0; i < COUNT; i++) b.side[i] = i;
    deal(&b);
    assert_int_equal(b.wide, 0);
    assert_int_equal(b.room[0], 1);
    assert_int_equal(b.room[COUNT - 2], LW_ROOMS_MAX - 1);
    assert_int_equal(b.room[COUNT - 1], LW_ROOMS_MAX - 1);
    assert_int_equal(b.parts.count, LW_REGIONS);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(without_walls_quarters),
        cmocka_unit_test(a_wall_in_a_corner),
        cmocka_unit_test(a_wall_parts_two_sides),
        cmocka_unit_test(many_sides),
        cmocka_unit_test(beside_charts_without_walls),
        cmocka_unit_test(what_is_not_covered_does_not_count),
        cmocka_unit_test(rooms_by_size),
        cmocka_unit_test(more_rooms_than_numbers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
