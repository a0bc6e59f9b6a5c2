#include "tests/reference/house.h"

#include <math.h>

static const char *const kind_name[] = {
    [HOUSE_BOXES] = "boxes", [HOUSE_SHEETS] = "sheets", [HOUSE_DOUBLED] = "doubled sheets"};

struct lw_vec3 house_along(const struct house *h, float x, float y, float z) {
    const float c = cosf(h->angle), s = sinf(h->angle);
    return lw_vec3(c * x + s * z, y, -s * x + c * z);
}
struct lw_vec3 house_at(const struct house *h, float x, float y, float z) {
    return lw_vec3_add(house_along(h, x, y, z), lw_vec3(h->shift_x, 0, h->shift_z));
}

/* ---- the house ---- */

enum { GROUND, FIRST_WALL }; /* quads of the room */
enum { DOWN, UP, BACK_Z, FRONT_Z, BACK_X, FRONT_X, FACES };

static void add_box(struct room *room, const struct house *h, struct lw_vec3 low, struct lw_vec3 high) {
    const struct lw_vec3 o = house_at(h, low.x, low.y, low.z), x = house_along(h, high.x - low.x, 0, 0),
                         y = house_along(h, 0, high.y - low.y, 0), z = house_along(h, 0, 0, high.z - low.z);
    room_quad(room, o, x, z, 0.7f, 0);
    room_quad(room, lw_vec3_add(o, y), z, x, 0.7f, 0);
    room_quad(room, o, y, x, 0.7f, 0);
    room_quad(room, lw_vec3_add(o, z), x, y, 0.7f, 0);
    room_quad(room, o, z, y, 0.7f, 0);
    room_quad(room, lw_vec3_add(o, x), y, z, 0.7f, 0);
}

static void add_boxes(struct room *room, const struct house *h) {
    const float a = HOUSE_HALF, b = HOUSE_HALF + h->thick;
    add_box(room, h, lw_vec3(a, 0, -a), lw_vec3(b, HOUSE_HIGH, a));
    add_box(room, h, lw_vec3(-b, 0, -a), lw_vec3(-a, HOUSE_HIGH, a));
    add_box(room, h, lw_vec3(-b, 0, -b), lw_vec3(b, HOUSE_HIGH, -a));
    add_box(room, h, lw_vec3(-b, 0, a), lw_vec3(b, HOUSE_HIGH, b));
    add_box(room, h, lw_vec3(-b, HOUSE_HIGH, -b), lw_vec3(b, HOUSE_HIGH + h->thick, b));
}

static void add_sheet(struct room *room, const struct house *h, struct lw_vec3 corner, struct lw_vec3 u,
                      struct lw_vec3 v) {
    room_quad(room, corner, u, v, 0.7f, 0);
    if (h->kind == HOUSE_SHEETS)
        room->quad[room->quad_count - 1].double_sided = true;
    else
        room_quad(room, corner, v, u, 0.7f, 0);
}

static void add_sheets(struct room *room, const struct house *h) {
    const struct lw_vec3 o = house_at(h, -HOUSE_HALF, 0, -HOUSE_HALF),
                         x = house_along(h, 2 * HOUSE_HALF, 0, 0), y = house_along(h, 0, HOUSE_HIGH, 0),
                         z = house_along(h, 0, 0, 2 * HOUSE_HALF);
    add_sheet(room, h, o, x, y);
    add_sheet(room, h, lw_vec3_add(o, z), x, y);
    add_sheet(room, h, o, z, y);
    add_sheet(room, h, lw_vec3_add(o, x), z, y);
    add_sheet(room, h, lw_vec3_add(o, y), z, x);
}

struct room house_build(const struct house *h) {
    struct room room = {.texels_per_metre = h->density};
    const float edge = -HOUSE_FIELD / 2;
    room_quad(&room, lw_vec3(edge, 0, edge), lw_vec3(0, 0, HOUSE_FIELD), lw_vec3(HOUSE_FIELD, 0, 0), 0.7f, 0);
    h->kind == HOUSE_BOXES ? add_boxes(&room, h) : add_sheets(&room, h);
    room.light[0] =
        (struct lw_light){.name = "lamp", .kind = LW_LIGHT_POINT, .intensity = {HOUSE_LAMP, 0, 0}};
    room.light_position[0] = house_at(h, 0, HOUSE_HIGH - 0.5f, 0);
    room.light[1] =
        (struct lw_light){.name = "sun", .kind = LW_LIGHT_DIRECTIONAL, .intensity = {0, 0, HOUSE_SUN}};
    room.light_count = 2;
    return room;
}

struct house_quads house_quads(const struct house *h, enum house_part part) {
    static const uint32_t sheet[] = {
        [HOUSE_BACK_Z] = 0, [HOUSE_FRONT_Z] = 1, [HOUSE_BACK_X] = 2, [HOUSE_FRONT_X] = 3, [HOUSE_ROOF] = 4};
    const uint32_t count = h->kind == HOUSE_BOXES    ? FACES
                           : h->kind == HOUSE_SHEETS ? 1
                                                     : 2,
                   index = h->kind == HOUSE_BOXES ? (uint32_t)part : sheet[part];
    return (struct house_quads){FIRST_WALL + index * count, count};
}

uint32_t house_inner_face(const struct house *h) { return house_quads(h, HOUSE_FRONT_X).first + BACK_X; }

/* ---- look-ups ---- */

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
        const struct lw_vec3 p = house_at(h, x, 0, z);
        add(&sum, look_up(s, GROUND, (double)(p.z / HOUSE_FIELD) + 0.5, (double)(p.x / HOUSE_FIELD) + 0.5),
            1);
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

void house_expect_apart(const struct room_solution *s, const struct house *h, uint32_t wall, double most) {
    const float outer = HOUSE_HALF + h->thick, texel_m = 1 / h->density, far = outer + 2.5f * texel_m;
    expect_no_sun(h, "the floor", mean_of_ground(s, h, 0, HOUSE_HALF - 0.005f));
    expect_no_sun(h, "its rim", mean_of_ground(s, h, HOUSE_HALF - 0.1f, HOUSE_HALF - 0.005f));
    if (h->kind == HOUSE_BOXES) {
        expect_no_sun(h, "a wall", mean_of_quad(s, wall, 0));
        expect_no_sun(h, "the ceiling",
                      mean_of_quad(s, house_quads(h, HOUSE_ROOF).first + DOWN,
                                   (double)(h->thick / (2 * outer)) + 1e-3));
    }
    const struct colour outside = mean_of_ground(s, h, far, far + 0.3f);
    if (!(outside.red <= most && outside.blue >= 0.98 * (double)HOUSE_SUN))
        fail_msg("%s of %g m, turned by %g, %g texels a metre: outside %g W/m^2 of the lamp, %g of the sun",
                 kind_name[h->kind], (double)h->thick, (double)h->angle, (double)h->density, outside.red,
                 outside.blue);
}

double house_lamp_on_floor(const struct room_solution *s, const struct house *h) {
    return mean_of_ground(s, h, 0, HOUSE_HALF - 0.005f).red;
}

double house_sun_on_floor(const struct room_solution *s, const struct house *h) {
    return mean_of_ground(s, h, 0, HOUSE_HALF - 0.005f).blue;
}

double house_lamp_at_foot(const struct room_solution *s, const struct house *h, float from, float to) {
    const float outer = HOUSE_HALF + h->thick;
    return mean_of_ground(s, h, outer + from / h->density, outer + to / h->density).red;
}
