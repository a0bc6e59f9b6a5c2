/* Closed rooms with a lamp inside and the sun outside: none of either's light passes a wall. The lamp is red and
 * the sun blue, so that one solve tells the two apart. What is read is what an engine reads: bilinear. */
#include "tests/reference/room.h"

#include "common/random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define RED  0
#define BLUE 2
#define LAMP 40.0f   /* W/sr */
#define SUN  5000.0f /* W/m^2 */

/* A room of inner half width `half` and height `high` that stands on a ground quad. */
struct house {
    float half, high, thick; /* thick 0: walls are double-sided quads */
    float angle;             /* about Y */
    float shift_x, shift_z;
    float density;
    enum { BOXES, SHEETS, DOUBLED } kind;
};

static struct lw_vec3 at(const struct house *h, float x, float y, float z) {
    const float c = cosf(h->angle), s = sinf(h->angle);
    return lw_vec3(c * x + s * z + h->shift_x, y, -s * x + c * z + h->shift_z);
}
static struct lw_vec3 along(const struct house *h, float x, float y, float z) {
    return lw_vec3_sub(at(h, x, y, z), at(h, 0, 0, 0));
}

/* Faces of a box, outward. */
static void add_box(struct room *room, const struct house *h, struct lw_vec3 low, struct lw_vec3 high) {
    const float sx = high.x - low.x, sy = high.y - low.y, sz = high.z - low.z;
    const struct lw_vec3 o = at(h, low.x, low.y, low.z), x = along(h, sx, 0, 0), y = along(h, 0, sy, 0),
                         z = along(h, 0, 0, sz);
    room_quad(room, o, x, z, 0.7f, 0);                    /* down */
    room_quad(room, lw_vec3_add(o, y), z, x, 0.7f, 0);    /* up */
    room_quad(room, o, y, x, 0.7f, 0);                    /* -z */
    room_quad(room, lw_vec3_add(o, z), x, y, 0.7f, 0);    /* +z */
    room_quad(room, o, z, y, 0.7f, 0);                    /* -x */
    room_quad(room, lw_vec3_add(o, x), y, z, 0.7f, 0);    /* +x */
}

/* A wall of no thickness: one quad with two sides, or two with one. */
static void add_sheet(struct room *room, const struct house *h, struct lw_vec3 corner, struct lw_vec3 u, struct lw_vec3 v) {
    room_quad(room, corner, u, v, 0.7f, 0);
    if (h->kind == SHEETS)
        room->quad[room->quad_count - 1].double_sided = true;
    else
        room_quad(room, corner, v, u, 0.7f, 0);
}

static void add_sheets(struct room *room, const struct house *h) {
    const float a = h->half;
    const struct lw_vec3 o = at(h, -a, 0, -a), x = along(h, 2 * a, 0, 0), y = along(h, 0, h->high, 0), z = along(h, 0, 0, 2 * a);
    add_sheet(room, h, o, x, y);
    add_sheet(room, h, lw_vec3_add(o, z), x, y);
    add_sheet(room, h, o, z, y);
    add_sheet(room, h, lw_vec3_add(o, x), z, y);
    add_sheet(room, h, lw_vec3_add(o, y), z, x);
}

static void add_boxes(struct room *room, const struct house *h) {
    const float a = h->half, b = h->half + h->thick, y = h->high;
    add_box(room, h, lw_vec3(a, 0, -a), lw_vec3(b, y, a));
    add_box(room, h, lw_vec3(-b, 0, -a), lw_vec3(-a, y, a));
    add_box(room, h, lw_vec3(-b, 0, -b), lw_vec3(b, y, -a));
    add_box(room, h, lw_vec3(-b, 0, a), lw_vec3(b, y, b));
    add_box(room, h, lw_vec3(-b, y, -b), lw_vec3(b, y + h->thick, b));
}

static void add_house(struct room *room, const struct house *h) {
    room_quad(room, lw_vec3(-6, 0, -6), lw_vec3(0, 0, 12), lw_vec3(12, 0, 0), 0.7f, 0);
    h->kind == BOXES ? add_boxes(room, h) : add_sheets(room, h);
    room->light[room->light_count] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {LAMP, 0, 0}};
    room->light_position[room->light_count++] = at(h, 0, h->high - 0.5f, 0);
    room->light[room->light_count++] = (struct lw_light){.kind = LW_LIGHT_DIRECTIONAL, .intensity = {0, 0, SUN}};
}

static double texel(const struct room_solution *s, uint32_t object, uint32_t x, uint32_t y, int channel) {
    const struct lw_atlas_level *level = &s->map.atlas[object].level[0];
    struct lw_solver_tile tile;
    s->solver->ops->read_tile(
        s->solver,
        (lw_tile_id){s->map.first_tile[object] + y / LW_TILE_SIDE * level->tiles_x + x / LW_TILE_SIDE},
        &tile);
    return (double)tile.irradiance[channel][y % LW_TILE_SIDE * tile.width + x % LW_TILE_SIDE];
}

static double look_up(const struct room_solution *s, uint32_t quad, double along_u, double along_v, int channel) {
    const struct lw_mesh *mesh = &s->scene->mesh[quad];
    const struct lw_vec2 a = mesh->lightmap_uv[mesh->triangle[0][0]],
                         b = mesh->lightmap_uv[mesh->triangle[0][1]],
                         c = mesh->lightmap_uv[mesh->triangle[1][2]];
    const double x = (double)a.x + along_u * (double)(b.x - a.x) + along_v * (double)(c.x - a.x) - 0.5,
                 y = (double)a.y + along_u * (double)(b.y - a.y) + along_v * (double)(c.y - a.y) - 0.5;
    double sum = 0;
    for (uint32_t j = 0; j < 2; j++)
        for (uint32_t i = 0; i < 2; i++) {
            const double wx = i ? x - floor(x) : 1 - (x - floor(x)),
                         wy = j ? y - floor(y) : 1 - (y - floor(y));
            if (wx * wy > 0)
                sum += wx * wy * texel(s, quad, (uint32_t)floor(x) + i, (uint32_t)floor(y) + j, channel);
        }
    return sum;
}

struct pair {
    double red, blue;
};

static struct pair ground_at(const struct room_solution *s, struct lw_vec3 p) {
    const double u = (double)(p.z + 6) / 12, v = (double)(p.x + 6) / 12;
    return (struct pair){look_up(s, 0, u, v, RED), look_up(s, 0, u, v, BLUE)};
}

/* Mean over the floor inside, or over a strip around the house. */
static struct pair mean_ground(const struct room_solution *s, const struct house *h, float low, float high) {
    struct pair sum = {0};
    unsigned count = 0;
    const int steps = 120;
    for (int i = 0; i < steps; i++)
        for (int j = 0; j < steps; j++) {
            const float x = ((float)i + 0.5f) / (float)steps * 2 * high - high, z = ((float)j + 0.5f) / (float)steps * 2 * high - high;
            if (fmaxf(fabsf(x), fabsf(z)) < low) continue;
            const struct pair p = ground_at(s, at(h, x, 0, z));
            sum.red += p.red, sum.blue += p.blue, count++;
        }
    sum.red /= count, sum.blue /= count;
    return sum;
}

static struct pair mean_quad(const struct room_solution *s, uint32_t quad, double u0, double u1, double v0, double v1) {
    struct pair sum = {0};
    const int steps = 60;
    for (int i = 0; i < steps; i++)
        for (int j = 0; j < steps; j++) {
            const double u = u0 + (u1 - u0) * (i + 0.5) / steps, v = v0 + (v1 - v0) * (j + 0.5) / steps;
            sum.red += look_up(s, quad, u, v, RED), sum.blue += look_up(s, quad, u, v, BLUE);
        }
    sum.red /= steps * steps, sum.blue /= steps * steps;
    return sum;
}

#include "server/solve/surface/invalid_texels.h"
#include "common/trace/trace.h"
static void debug_texels(const struct room_solution *s, const struct house *h) {
    struct lw_texels t; struct lw_error err={0}; struct lw_trace *trace; uint64_t n;
    lw_support_ok(lw_texels_init(&t, s->scene, 1, NULL, &err), &err);
    lw_support_ok(lw_trace_create(s->scene, &s->pose, &trace, &err), &err);
    lw_support_ok(lw_invalid_texels_find(&t, &s->pose, trace, 1, NULL, &n), &err);
    const struct lw_mesh_texels *m=&t.mesh[0];
    for (uint32_t y=0;y<m->height;y++) for (uint32_t x=0;x<m->width;x++) {
        const uint32_t i=lw_texels_index(m,x,y);
        if (!m->covered[i]) continue;
        const struct lw_vec3 p=lw_texels_vector(m->position,i);
        const float c=cosf(h->angle), q=sinf(h->angle), dx=p.x-h->shift_x, dz=p.z-h->shift_z;
        const float hx=c*dx-q*dz, hz=q*dx+c*dz;
        const double blue=texel(s,0,x,y,2);
        struct lw_vec3 pl = t.covered[i]? lw_texels_place(&t,0,i):p;
        const float px=c*(pl.x-h->shift_x)-q*(pl.z-h->shift_z), pz=q*(pl.x-h->shift_x)+c*(pl.z-h->shift_z);
        if (fmaxf(fabsf(hx),fabsf(hz))<h->half+h->thick+0.3f && fmaxf(fabsf(hx),fabsf(hz))>h->half-0.4f && hx>1.2f && hz > 1.2f)
            printf("DBG (%6.3f %6.3f) place (%6.3f %6.3f) covered %d usable %02x walls %x side %u blue %.2f red %.2f\n", (double)hx,(double)hz,(double)px,(double)pz,t.covered[i],t.usable[i],t.walls[i],t.side[i],blue,texel(s,0,x,y,0));
    }
    lw_texels_finish(&t); lw_trace_destroy(trace);
}
static void measure(const struct house *h, bool denoise, unsigned bounces, unsigned frames) {
    struct room room = {.texels_per_metre = h->density};
    add_house(&room, h);
    struct room_solution s;
    room_solve(&s, &room, (struct lw_solver_desc){.bounces = bounces, .denoise = denoise, .tracing_range_m = INFINITY}, frames);
    const struct pair floor = mean_ground(&s, h, 0, h->half - 0.01f), middle = mean_ground(&s, h, 0, 1),
                      near = mean_ground(&s, h, h->half + h->thick + 0.01f, h->half + h->thick + 0.3f);
    const float b = h->half + h->thick;
    const double edge = (double)(h->thick / (2 * b));
    struct pair wall = {0}, ceiling = {0};
    if (h->kind == BOXES) {
        wall = mean_quad(&s, 5, 0, 1, 0, 1); /* -x face of the +x wall */
        ceiling = mean_quad(&s, 25, edge, 1 - edge, edge, 1 - edge);
    }
    print_message("%s thick %.2f angle %.1f density %g bounces %u %s: floor %.2f + %.3f, middle %.2f + %.3f, wall %.2f + %.3f, "
                  "ceiling %.2f + %.3f; outside %.0f + %.3f\n",
                  h->kind == BOXES ? "boxes" : h->kind == SHEETS ? "sheets" : "doubled", (double)h->thick, (double)h->angle, (double)h->density, bounces, denoise ? "filtered" : "raw", floor.red, floor.blue,
                  middle.red, middle.blue, wall.red, wall.blue, ceiling.red, ceiling.blue, near.blue, near.red);
    if (getenv("DBG")) debug_texels(&s, h);
    room_finish(&s);
}

static void test_family(void **state) {
    (void)state;
    if (getenv("DBG")) { float v[3]; sscanf(getenv("DBG"),"%f,%f,%f",v,v+1,v+2); const struct house h={.half=2,.high=3,.thick=v[0],.angle=v[1],.density=v[2],.shift_x=v[1]>0?0.13f:0,.shift_z=v[1]>0?0.07f:0}; measure(&h,false,getenv("B")?2:0,getenv("B")?256:8); return; }
    const float thick[] = {0.02f, 0.1f, 0.3f, 1.0f}, density[] = {3, 5, 12};
    for (unsigned t = 0; t < 4; t++)
        for (unsigned d = 0; d < 3; d++)
            for (unsigned a = 0; a < 2; a++) {
                const struct house h = {.half = 2, .high = 3, .thick = thick[t], .angle = a ? 0.3f : 0, .density = density[d],
                                        .shift_x = a ? 0.13f : 0, .shift_z = a ? 0.07f : 0};
                measure(&h, false, 2, 24);
                if (t < 2) {
                    struct house sheet = h;
                    sheet.thick = 0;
                    sheet.kind = t ? SHEETS : DOUBLED;
                    measure(&sheet, false, 2, 24);
                    measure(&sheet, true, 2, 24);
                }
                if (d == 1) measure(&h, true, 2, 24), measure(&h, false, 0, 24), measure(&h, false, 1, 24);
            }
}

static void test_switch(void **state) {
    (void)state;
    for (unsigned k = 0; k < 4; k++) {
        const struct house h = {.half = 2, .high = 3, .thick = k & 1 ? 0.3f : 0.1f, .angle = 0.3f, .shift_x = 0.13f, .shift_z = 0.07f, .density = 5};
        struct room room = {.texels_per_metre = h.density};
        add_house(&room, &h);
        struct room_solution s;
        struct lw_error err = {0};
        struct lw_scene *scene = room_scene(&room);
        room_solve_scene(&s, scene, room.texels_per_metre, (struct lw_solver_desc){.bounces = 2, .denoise = true, .tracing_range_m = INFINITY, .target_error = k & 2 ? 0.1f : -1}, 0);
        float sun = s.pose.light[1].intensity.z;
        s.pose.light[1].intensity.z = 0;
        uint64_t f = 0;
        for (unsigned i = 0; i < 32; i++) lw_support_ok(s.solver->ops->frame(s.solver, &s.pose, ++f, &s.stats, &err), &err);
        s.pose.light[1].intensity.z = sun;
        for (unsigned i = 1; i <= 256; i++) {
            lw_support_ok(s.solver->ops->frame(s.solver, &s.pose, ++f, &s.stats, &err), &err);
            if (i & (i - 1)) continue;
            const struct pair floor = mean_ground(&s, &h, 0, h.half - 0.01f), middle = mean_ground(&s, &h, 0, 1), wall = mean_quad(&s, 5, 0, 1, 0, 1), ceiling = mean_quad(&s, 25, 0.1, 0.9, 0.1, 0.9);
            const struct pair near = mean_ground(&s, &h, h.half + h.thick + 0.2f, h.half + h.thick + 0.5f);
            print_message("thick %.1f switch +%u: floor %.2f + %.3f, middle %.2f + %.3f, wall %.2f + %.3f, ceiling %.2f + %.3f, outside %.0f\n", (double)h.thick, i, floor.red, floor.blue, middle.red, middle.blue, wall.red, wall.blue, ceiling.red, ceiling.blue, near.blue);
        }
        room_finish(&s);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_family), cmocka_unit_test(test_switch)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
