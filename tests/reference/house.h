/* house.h: closed rooms on a ground that runs through, a lamp inside and the sun outside. The lamp is red and
 * the sun blue, so that one solve tells them apart. */
#ifndef LW_TESTS_HOUSE_H
#define LW_TESTS_HOUSE_H

#include "tests/reference/room.h"

#define HOUSE_LAMP  40.0f   /* W/sr */
#define HOUSE_SUN   5000.0f /* W/m^2 on the ground */
#define HOUSE_HALF  2.0f    /* inner half width, m */
#define HOUSE_HIGH  3.0f
#define HOUSE_FIELD 12.0f /* side of the ground, m */

enum house_kind {
    HOUSE_BOXES,  /* walls and roof are boxes */
    HOUSE_SHEETS, /* quads with two sides */
    HOUSE_DOUBLED /* two quads in one place, back to back */
};

struct house {
    enum house_kind kind;
    float thick;            /* thickness of walls, m; 0 but for boxes */
    float angle;            /* about Y */
    float shift_x, shift_z; /* place of its middle */
    float density;          /* texels per metre */
    bool filtered;
};

/* Parts of a house; each is some quads of the room. */
enum house_part { HOUSE_FRONT_X, HOUSE_BACK_X, HOUSE_BACK_Z, HOUSE_FRONT_Z, HOUSE_ROOF };
struct house_quads {
    uint32_t first, count;
};

/** A direction, and a place, of the house's own space. */
struct lw_vec3 house_along(const struct house *h, float x, float y, float z);
struct lw_vec3 house_at(const struct house *h, float x, float y, float z);

struct room house_build(const struct house *h);
struct house_quads house_quads(const struct house *h, enum house_part part);

/** Fails if over 1 % of the light inside is the sun's, or if the lamp's light is outside but for the texel at
 * a wall's foot. Look-ups are an engine's: bilinear.
 * wall     the quad that is the inner face of the wall at +X, of boxes
 * outside  the most that the lamp may give out of doors, W/m^2 */
void house_expect_apart(const struct room_solution *s, const struct house *h, uint32_t wall, double outside);
/** The same face, where nothing has moved. */
uint32_t house_inner_face(const struct house *h);
/** The lamp's and the sun's light on the floor, W/m^2. */
double house_lamp_on_floor(const struct room_solution *s, const struct house *h);
double house_sun_on_floor(const struct room_solution *s, const struct house *h);
/** The lamp's light on the ground right outside, W/m^2: from one to another distance from the walls, in
 * texels. */
double house_lamp_at_foot(const struct room_solution *s, const struct house *h, float from, float to);

#endif
