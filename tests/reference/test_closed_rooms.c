/* Closed rooms on a ground that runs through, a lamp inside and the sun outside: neither's light passes a
 * wall. The lamp is red and the sun blue, so that one solve tells them apart. What is read is what an engine
 * reads: bilinear. The sun changes nothing inside by more than 1 %; a lamp lights nothing outside but for
 * the texel at a wall's foot, which the ground's two sides share. "long" asks the whole family. */
#include "tests/reference/room.h"

#include <math.h>
#include <string.h>

#define LAMP  40.0f   /* W/sr */
#define SUN   5000.0f /* W/m^2 on the ground */
#define HALF  2.0f    /* inner half width, m */
#define HIGH  3.0f
#define FIELD 12.0f /* side of the ground, m */

enum kind {
    BOXES,  /* walls and roof are boxes */
    SHEETS, /* quads with two sides */
    DOUBLED /* two quads in one place, back to back */
};
static const char *const kind_name[] = {[BOXES] = "boxes", [SHEETS] = "sheets", [DOUBLED] = "doubled sheets"};

struct house {
    enum kind kind;
    float thick;            /* of walls, m; 0 but for boxes */
    float angle;            /* about Y */
    float shift_x, shift_z; /* of its middle */
    float density;          /* texels per metre */
    bool filtered;
};

static struct lw_vec3 along(const struct house *h, float x, float y, float z) {
    const float c = cosf(h->angle), s = sinf(h->angle);
    return lw_vec3(c * x + s * z, y, -s * x + c * z);
}
static struct lw_vec3 at(const struct house *h, float x, float y, float z) {
    return lw_vec3_add(along(h, x, y, z), lw_vec3(h->shift_x, 0, h->shift_z));
}

/* ---- the house ---- */

enum { GROUND, FIRST_WALL }; /* quads of the room */
enum { DOWN, UP, BACK_Z, FRONT_Z, BACK_X, FRONT_X, FACES };
enum { WALL_AT_X, WALLS = 4, ROOF = WALLS };

static void add_box(struct room *room, const struct house *h, struct lw_vec3 low, struct lw_vec3 high) {
    const struct lw_vec3 o = at(h, low.x, low.y, low.z), x = along(h, high.x - low.x, 0, 0),
                         y = along(h, 0, high.y - low.y, 0), z = along(h, 0, 0, high.z - low.z);
    room_quad(room, o, x, z, 0.7f, 0);
    room_quad(room, lw_vec3_add(o, y), z, x, 0.7f, 0);
    room_quad(room, o, y, x, 0.7f, 0);
    room_quad(room, lw_vec3_add(o, z), x, y, 0.7f, 0);
    room_quad(room, o, z, y, 0.7f, 0);
    room_quad(room, lw_vec3_add(o, x), y, z, 0.7f, 0);
}

static void add_boxes(struct room *room, const struct house *h) {
    const float a = HALF, b = HALF + h->thick;
    add_box(room, h, lw_vec3(a, 0, -a), lw_vec3(b, HIGH, a));
    add_box(room, h, lw_vec3(-b, 0, -a), lw_vec3(-a, HIGH, a));
    add_box(room, h, lw_vec3(-b, 0, -b), lw_vec3(b, HIGH, -a));
    add_box(room, h, lw_vec3(-b, 0, a), lw_vec3(b, HIGH, b));
    add_box(room, h, lw_vec3(-b, HIGH, -b), lw_vec3(b, HIGH + h->thick, b));
}

static void add_sheet(struct room *room, const struct house *h, struct lw_vec3 corner, struct lw_vec3 u,
                      struct lw_vec3 v) {
    room_quad(room, corner, u, v, 0.7f, 0);
    if (h->kind == SHEETS)
        room->quad[room->quad_count - 1].double_sided = true;
    else
        room_quad(room, corner, v, u, 0.7f, 0);
}

static void add_sheets(struct room *room, const struct house *h) {
    const struct lw_vec3 o = at(h, -HALF, 0, -HALF), x = along(h, 2 * HALF, 0, 0), y = along(h, 0, HIGH, 0),
                         z = along(h, 0, 0, 2 * HALF);
    add_sheet(room, h, o, x, y);
    add_sheet(room, h, lw_vec3_add(o, z), x, y);
    add_sheet(room, h, o, z, y);
    add_sheet(room, h, lw_vec3_add(o, x), z, y);
    add_sheet(room, h, lw_vec3_add(o, y), z, x);
}

static struct room build(const struct house *h) {
    struct room room = {.texels_per_metre = h->density};
    const float edge = -FIELD / 2;
    room_quad(&room, lw_vec3(edge, 0, edge), lw_vec3(0, 0, FIELD), lw_vec3(FIELD, 0, 0), 0.7f, 0);
    h->kind == BOXES ? add_boxes(&room, h) : add_sheets(&room, h);
    room.light[0] = (struct lw_light){.name = "lamp", .kind = LW_LIGHT_POINT, .intensity = {LAMP, 0, 0}};
    room.light_position[0] = at(h, 0, HIGH - 0.5f, 0);
    room.light[1] = (struct lw_light){.name = "sun", .kind = LW_LIGHT_DIRECTIONAL, .intensity = {0, 0, SUN}};
    room.light_count = 2;
    return room;
}

/* ---- what is read ---- */

struct colour {
    double red, blue;
};

static void add(struct colour *sum, struct colour c, double weight) {
    sum->red += weight * c.red;
    sum->blue += weight * c.blue;
}

static struct colour look_up(const struct room_solution *s, uint32_t quad, double along_u, double along_v) {
    const struct lw_vec3 e = room_look_up(s, quad, along_u, along_v);
    return (struct colour){(double)e.x, (double)e.z};
}

static struct colour mean_of_quad(const struct room_solution *s, uint32_t quad, double margin) {
    const int steps = 40;
    struct colour sum = {0};
    for (int k = 0; k < steps * steps; k++)
        add(&sum,
            look_up(s, quad, margin + (1 - 2 * margin) * (k % steps + 0.5) / steps,
                    margin + (1 - 2 * margin) * (k / steps + 0.5) / steps),
            1.0 / (steps * steps));
    return sum;
}

/* The mean over a frame of the ground about the house's middle, between two half widths. */
static struct colour mean_of_ground(const struct room_solution *s, const struct house *h, float from,
                                    float to) {
    const int steps = 80;
    struct colour sum = {0};
    unsigned count = 0;
    for (int k = 0; k < steps * steps; k++) {
        const float x = ((float)(k % steps) + 0.5f) / (float)steps * 2 * to - to,
                    z = ((float)(k / steps) + 0.5f) / (float)steps * 2 * to - to;
        if (fmaxf(fabsf(x), fabsf(z)) < from) continue;
        const struct lw_vec3 p = at(h, x, 0, z);
        add(&sum, look_up(s, GROUND, (double)(p.z / FIELD) + 0.5, (double)(p.x / FIELD) + 0.5), 1);
        count++;
    }
    return (struct colour){sum.red / count, sum.blue / count};
}

static void expect_no_sun(const struct house *h, const char *where, struct colour inside) {
    if (!(inside.red > 5)) fail_msg("%s: the lamp gives %g W/m^2", where, inside.red);
    if (!(inside.blue <= 0.01 * inside.red))
        fail_msg(
            "%s of %g m, turned by %g, %g texels a metre, %s: %s has %g W/m^2 of the lamp and %g of the sun",
            kind_name[h->kind], (double)h->thick, (double)h->angle, (double)h->density,
            h->filtered ? "filtered" : "bare", where, inside.red, inside.blue);
}

static void expect_apart(const struct room_solution *s, const struct house *h) {
    const float outer = HALF + h->thick, texel_m = 1 / h->density, far = outer + 2.5f * texel_m;
    expect_no_sun(h, "the floor", mean_of_ground(s, h, 0, HALF - 0.005f));
    expect_no_sun(h, "its rim", mean_of_ground(s, h, HALF - 0.1f, HALF - 0.005f));
    if (h->kind == BOXES) {
        expect_no_sun(h, "a wall", mean_of_quad(s, FIRST_WALL + WALL_AT_X * FACES + BACK_X, 0));
        expect_no_sun(
            h, "the ceiling",
            mean_of_quad(s, FIRST_WALL + ROOF * FACES + DOWN, (double)(h->thick / (2 * outer)) + 1e-3));
    }
    const struct colour outside = mean_of_ground(s, h, far, far + 0.3f);
    if (!(outside.red <= 0.01 && outside.blue >= 0.98 * (double)SUN))
        fail_msg("%s of %g m, turned by %g, %g texels a metre: outside %g W/m^2 of the lamp, %g of the sun",
                 kind_name[h->kind], (double)h->thick, (double)h->angle, (double)h->density, outside.red,
                 outside.blue);
}

/* ---- the family ---- */

static void solve_apart(const struct house *h, unsigned frames) {
    const struct room room = build(h);
    struct room_solution s;
    room_solve(&s, &room,
               (struct lw_solver_desc){.bounces = 2, .denoise = h->filtered, .tracing_range_m = INFINITY},
               frames);
    expect_apart(&s, h);
    room_finish(&s);
}

static void each_kind(bool filtered, float density, unsigned frames) {
    const float thick[] = {0.02f, 0.1f, 0.3f, 1};
    for (unsigned turned = 0; turned < 2; turned++) {
        struct house h = {.angle = turned ? 0.3f : 0,
                          .shift_x = turned ? 0.13f : 0,
                          .shift_z = turned ? 0.07f : 0,
                          .density = density,
                          .filtered = filtered};
        for (unsigned k = 0; k < sizeof thick / sizeof *thick; k++) {
            h.thick = thick[k];
            solve_apart(&h, frames);
        }
        h.thick = 0;
        for (h.kind = SHEETS; h.kind <= DOUBLED; h.kind++) solve_apart(&h, frames);
    }
}

static void test_bare(void **state) {
    (void)state;
    each_kind(false, 5, 4);
}

static void test_filtered(void **state) {
    (void)state;
    each_kind(true, 3, 4);
}

static void test_all(void **state) {
    (void)state;
    const float density[] = {3, 5, 12};
    for (unsigned k = 0; k < 3; k++) {
        each_kind(false, density[k], 24);
        each_kind(true, density[k], 24);
    }
}

/* The sun comes and goes: what follows from it stays outside from the first frame on. */
static void test_the_sun_is_switched(void **state) {
    (void)state;
    for (unsigned k = 0; k < 2; k++) {
        const struct house h = {
            .kind = BOXES, .thick = k ? 0.3f : 0.1f, .angle = 0.3f, .density = 5, .filtered = true};
        const struct room room = build(&h);
        struct room_solution s;
        struct lw_error err = {0};
        room_solve(&s, &room,
                   (struct lw_solver_desc){
                       .bounces = 2, .denoise = true, .tracing_range_m = INFINITY, .target_error = 0.1f},
                   1);
        for (uint64_t frame = 2; frame <= 13; frame++) {
            const bool shines = frame < 4 || frame > 8;
            s.pose.light[1].intensity.z = shines ? SUN : 0;
            lw_support_ok(s.solver->ops->frame(s.solver, &s.pose, frame, &s.stats, &err), &err);
            if (shines) expect_apart(&s, &h);
        }
        room_finish(&s);
    }
}

static double lamp_on_floor(const struct room_solution *s, const struct house *h) {
    return mean_of_ground(s, h, 0, HALF - 0.005f).red;
}

/* A lamp of 12 W/m^2 that becomes a quarter of itself, beside 5 kW/m^2 of sun on the same ground: errors
 * inside are measured against what light there is inside. */
static void test_the_lamp_is_dimmed(void **state) {
    (void)state;
    const char *const groups[] = {NULL, "lamp;sun"};
    for (unsigned k = 0; k < 2; k++) {
        const struct house h = {.kind = BOXES, .thick = 0.3f, .angle = 0.3f, .density = 5, .filtered = true};
        const struct room room = build(&h);
        struct room_solution s;
        struct lw_error err = {0};
        const struct lw_solver_desc desc = {
            .bounces = 2, .denoise = true, .tracing_range_m = INFINITY, .target_error = 0.1f};
        if (groups[k])
            room_solve_layers(&s, room_scene(&room), h.density, desc, groups[k], 1);
        else
            room_solve(&s, &room, desc, 1);
        double before = 0;
        for (uint64_t frame = 2; frame <= 32; frame++) {
            if (frame == 20) before = lamp_on_floor(&s, &h);
            s.pose.light[0].intensity.x = frame < 20 ? LAMP : LAMP / 4;
            lw_support_ok(s.solver->ops->frame(s.solver, &s.pose, frame, &s.stats, &err), &err);
        }
        const double share = lamp_on_floor(&s, &h) / before;
        if (!(fabs(share - 0.25) <= 0.02)) fail_msg("%s: %g of the lamp's light is left", groups[k], share);
        room_finish(&s);
    }
}

int main(int argc, char **argv) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_bare),
        cmocka_unit_test(test_filtered),
        cmocka_unit_test(test_the_sun_is_switched),
        cmocka_unit_test(test_the_lamp_is_dimmed),
    };
    const struct CMUnitTest all[] = {cmocka_unit_test(test_all)};
    return argc > 1 && strcmp(argv[1], "long") == 0 ? cmocka_run_group_tests(all, NULL, NULL)
                                                    : cmocka_run_group_tests(tests, NULL, NULL);
}
