#include "server/solve/surface/hidden_points.h"

#include "common/base/random.h"
#include "common/light/direction.h"
#include "server/solve/surface/crossings.h"
#include "server/solve/surface/dark_spaces.h"

/* A sample point is inside when what it sees is backs, all but one ray of these, and near ones: a roof that
 * is only modelled from outside shows its back to the floor below, but a lamp may hang in between. So far
 * ones count only where it matters, beside a wall: under a house of the size of the scene its foot's outer
 * side is to have no dark rim. */
#define RAYS        LW_HIDDEN_POINTS_RAYS
#define INSIDE_RAYS 7
#define RIM_RAYS    8
/* Inside a solid whose faces are double-sided, rays both ways leave it, all but three of these: tubes and
 * boxes may be open at an end. */
#define ENCLOSED_RAYS 13
/* In a solid of any size rays up meet backs, all but two of these: other things may end in it. */
#define BACK_RAYS 6
/* A point's walks. All points of a texel that may be in the dark are in one space. */
#define WALKS (LW_DARK_SPACES_WALKS / LW_SAMPLE_POINTS_MAX)
/* Closer to another surface than this many times the lift, a sample point may find itself
 * on the surface's other side. */
#define TOUCHING 8
/* How high above the surface its points are joined to the texel's own position, in texels. */
#define LOOK_ALONG 0.1f

#define POINTS (LW_HIDDEN_POINTS_TEXELS * LW_SAMPLE_POINTS_MAX)

struct point;

struct texel {
    uint32_t index;            /* within the object */
    uint8_t usable;            /* mask of its points */
    uint8_t beyond, before;    /* masks of its points: behind what cuts the texel, and before that */
    const struct point *pivot; /* NULL: the texel's own position */
    uint8_t together;          /* mask of its points: the most that one of them sees along the surface */
    bool suspect, rim, torn;
    bool by_solid;  /* a face near one of its points may be the inside of a solid */
    bool by_back;   /* a ray of one of its points has met a back */
    bool uncovered; /* one of its points has nothing close above it */
    bool lit;       /* light has found one of its points */
};

struct point {
    struct lw_vec3 origin, face; /* world space; the face's normal is unit */
    float lift_m;
    uint16_t texel; /* index within the crowd */
    uint8_t number;
    /* masks of directions: looked in, with a back met, with nothing near (reach_of_solids) */
    uint8_t looked, back, clear;
    bool covered;             /* something is close above it */
    bool met_front, met_back; /* a ray of it has; single-sided or not */
    uint8_t free_rays;        /* rays looking for solids that leave none, or see no back */
};

/* Texels of one object and their points, in the order of their numbers: neighbours look the same way. */
struct crowd {
    const struct lw_hidden_points_search *search;
    uint32_t object;
    float size_m;
    uint32_t texels, points;
    struct texel texel[LW_HIDDEN_POINTS_TEXELS];
    struct point point[POINTS];
};

/* Points of a crowd. */
struct list {
    uint32_t count;
    uint16_t point[POINTS];
};

/* Up to sixteen of them, and a ray from each. */
struct packet {
    struct crowd *crowd;
    struct point *point[LW_TRACE_WIDTH];
    uint16_t active;
    struct lw_ray16 rays;
    struct lw_hit16 hits;
};

/* Keeps the points of a list of which `stays` says so, sixteen at a time. number: of a ray or an axis. */
static void sift(struct crowd *c, struct list *list,
                 uint16_t (*stays)(struct packet *packet, uint32_t number), uint32_t number) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < list->count; i += LW_TRACE_WIDTH) {
        const uint32_t lanes = list->count - i < LW_TRACE_WIDTH ? list->count - i : LW_TRACE_WIDTH;
        struct packet packet = {.crowd = c, .active = (uint16_t)((1u << lanes) - 1)};
        uint16_t index[LW_TRACE_WIDTH];
        for (uint32_t lane = 0; lane < lanes; lane++) {
            index[lane] = list->point[i + lane];
            packet.point[lane] = &c->point[index[lane]];
        }
        const uint16_t staying = stays(&packet, number);
        for (uint32_t lane = 0; lane < lanes; lane++)
            if (staying >> lane & 1) list->point[kept++] = index[lane];
    }
    list->count = kept;
}

static bool is_active(const struct packet *p, uint32_t lane) { return p->active >> lane & 1; }

static const struct lw_material *material_of(const struct packet *p, uint32_t lane) {
    return lw_trace_material(p->crowd->search->texels->scene, &p->hits, lane);
}

static bool is_met(const struct packet *p, uint32_t lane) { return p->hits.object[lane] != LW_TRACE_MISS; }

/* Only what stands hides points. */
static bool stands_still(const struct packet *p, uint32_t lane) {
    return p->crowd->search->texels->stands[p->hits.object[lane]];
}

static bool is_back(const struct packet *p, uint32_t lane) {
    return is_met(p, lane) && p->hits.back[lane] && stands_still(p, lane) &&
           !material_of(p, lane)->double_sided;
}

static bool is_parting(const struct packet *p, uint32_t lane) {
    return is_met(p, lane) && stands_still(p, lane);
}

static uint16_t lanes_where(const struct packet *p, bool (*holds)(const struct packet *, uint32_t lane)) {
    uint16_t lanes = 0;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (is_active(p, lane) && holds(p, lane)) lanes |= (uint16_t)(1u << lane);
    return lanes;
}

static void trace(struct packet *p, unsigned flags, uint16_t active) {
    lw_trace_closest16(p->crowd->search->trace, flags, active, &p->rays, &p->hits);
}

struct lw_vec3 lw_hidden_points_direction(uint32_t r) {
    float square[2];
    lw_random_sobol2(r, 0, square);
    return lw_direction_cosine(square);
}

static float reach_of_solids(const struct crowd *c) {
    return fminf(LW_HIDDEN_POINTS_CLEAR * c->size_m, c->search->near_m);
}

/* Looks from the points in direction r, where that is still to do: near; from those of a rim as far as there
 * is anything. */
static void look_along(struct packet *p, uint32_t r) {
    struct crowd *c = p->crowd;
    const struct lw_vec3 local = lw_hidden_points_direction(r);
    const float reach_m = reach_of_solids(c);
    uint16_t active = 0;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (!is_active(p, lane) || p->point[lane]->looked >> r & 1) continue;
        active |= (uint16_t)(1u << lane);
        lw_trace_set_ray(&p->rays, lane, p->point[lane]->origin,
                         lw_direction_about(p->point[lane]->face, local),
                         c->texel[p->point[lane]->texel].rim ? c->search->far_m : c->search->near_m);
    }
    if (!active) return;
    trace(p, LW_TRACE_COHERENT, active);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        struct point *point = p->point[lane];
        if (!(active >> lane & 1)) continue;
        point->looked |= (uint8_t)(1u << r);
        if (is_back(p, lane)) point->back |= (uint8_t)(1u << r);
        if (is_met(p, lane)) *(p->hits.back[lane] ? &point->met_back : &point->met_front) = true;
        if (!is_met(p, lane) || p->hits.t[lane] > reach_m)
            point->clear |= (uint8_t)(1u << r);
        else if (p->hits.back[lane] || material_of(p, lane)->double_sided)
            c->texel[point->texel].by_solid = true;
    }
}

static void set_up_rays(struct packet *p, float reach_m) {
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (is_active(p, lane))
            lw_trace_set_ray(&p->rays, lane, p->point[lane]->origin, p->point[lane]->face, reach_m);
}

static bool has_something_near(const struct packet *p, uint32_t lane) {
    return p->point[lane]->met_back || !p->point[lane]->clear;
}

/* One ray from each point of its texel, and a short one straight up: enough to see that it stands free. */
static uint16_t is_suspect(struct packet *p, uint32_t r) {
    const struct crowd *c = p->crowd;
    set_up_rays(p, LW_CROSSINGS_CLOSE * c->size_m);
    const uint16_t covered = lw_trace_occluded16(c->search->trace, LW_TRACE_COHERENT, p->active, &p->rays);
    look_along(p, r);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (is_active(p, lane)) p->point[lane]->covered = covered >> lane & 1;
    return covered | lanes_where(p, has_something_near);
}

/* No back of a wall beside it, looked for a quarter of a texel above the surface. */
static uint16_t has_no_rim(struct packet *p, uint32_t r) {
    const float angle = 2 * LW_PI * (float)r / RIM_RAYS, size = p->crowd->size_m;
    const struct lw_vec3 local = lw_vec3(cosf(angle), sinf(angle), 0);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (!is_active(p, lane)) continue;
        const struct point *point = p->point[lane];
        lw_trace_set_ray(&p->rays, lane, lw_vec3_mad(point->origin, point->face, 0.25f * size),
                         lw_direction_about(point->face, local), LW_HIDDEN_POINTS_RIM * size);
    }
    trace(p, LW_TRACE_COHERENT, p->active);
    return p->active & (uint16_t)~lanes_where(p, is_back);
}

static bool is_in_doubt(const struct packet *p, uint32_t lane) {
    return (uint32_t)__builtin_popcount(p->point[lane]->looked & ~p->point[lane]->back) <= RAYS - INSIDE_RAYS;
}

/* Most points stand free, and two rays say so: those that one ray too many leaves are tested no further. */
static uint16_t may_be_inside(struct packet *p, uint32_t r) {
    look_along(p, r);
    return lanes_where(p, is_in_doubt);
}

/* By how many the faces that a ray leaves solids by outnumber those by which it enters some: 1 from inside
 * a closed solid, with any contents; 0 from outside, and 1 or -1 from beside a sheet. Faces that may let
 * light through do not count. */
static int count_exits(const struct crowd *c, const struct lw_trace_through *through) {
    const struct lw_scene *scene = c->search->texels->scene;
    int exits = 0;
    for (uint32_t k = 0; k < through->count; k++) {
        const struct lw_trace_met *met = &through->met[k];
        const struct lw_mesh *mesh = &scene->mesh[scene->object[met->object].mesh];
        if (c->search->texels->stands[met->object] &&
            scene->material[mesh->material[met->triangle]].alpha_mode == LW_ALPHA_OPAQUE)
            exits += met->back ? 1 : -1;
    }
    return exits;
}

/* Points inside solids, by generalized winding numbers (Jacobson et al. 2013) of faces near by: these bear
 * holes and solids that overlap, and tell a sample point under a sheet, from which the way down leads in,
 * or nowhere, from one in a box. So backs of double-sided surfaces bury, too. What lights the inside of
 * such a solid is nobody's to see. Rays up come first: most leave by no face at all, and of some that is
 * known. */
static uint16_t may_be_enclosed(struct packet *p, uint32_t r) {
    const float reach_m = reach_of_solids(p->crowd);
    const struct lw_vec3 local = lw_vec3_scale(lw_hidden_points_direction(r % RAYS), r < RAYS ? 1 : -1);
    struct lw_trace_through through[LW_TRACE_WIDTH];
    uint16_t enclosed = p->active, active = 0;
    float gap[LW_TRACE_WIDTH];
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (!is_active(p, lane) || (r < RAYS && p->point[lane]->clear >> r & 1)) continue;
        active |= (uint16_t)(1u << lane);
        lw_trace_set_ray(&p->rays, lane, p->point[lane]->origin,
                         lw_direction_about(p->point[lane]->face, local), reach_m);
        gap[lane] = 4 * p->point[lane]->lift_m;
    }
    if (!active) return enclosed;
    lw_trace_through16(p->crowd->search->trace, active, &p->rays, gap, through);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (active >> lane & 1 && count_exits(p->crowd, &through[lane]) < 1 &&
            ++p->point[lane]->free_rays > 2 * RAYS - ENCLOSED_RAYS)
            enclosed &= (uint16_t) ~(1u << lane);
    return enclosed;
}

static bool is_inner_face(const struct packet *p, uint32_t lane) {
    return p->point[lane]->covered || (is_parting(p, lane) && p->hits.back[lane]);
}

/* May lie in a solid of any size, or where one touches another. */
static uint16_t may_be_sealed(struct packet *p, uint32_t r) {
    const struct lw_vec3 local = lw_hidden_points_direction(r);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (is_active(p, lane))
            lw_trace_set_ray(&p->rays, lane, p->point[lane]->origin,
                             lw_direction_about(p->point[lane]->face, local), p->crowd->search->far_m);
    trace(p, LW_TRACE_COHERENT, p->active);
    uint16_t sealed = lanes_where(p, is_inner_face);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (is_active(p, lane) && !(sealed >> lane & 1) && is_met(p, lane) &&
            ++p->point[lane]->free_rays <= RAYS - BACK_RAYS)
            sealed |= (uint16_t)(1u << lane);
    return sealed;
}

/* Walks of all points of a texel are different ones. */
static uint16_t is_dark(struct packet *p, uint32_t walk) {
    struct lw_vec3 at[LW_TRACE_WIDTH], normal[LW_TRACE_WIDTH];
    uint32_t number[LW_TRACE_WIDTH];
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (!is_active(p, lane)) continue;
        const struct point *point = p->point[lane];
        if (p->crowd->texel[point->texel].lit) p->active &= (uint16_t) ~(1u << lane);
        at[lane] = point->origin;
        normal[lane] = point->face;
        number[lane] = WALKS * point->number + walk;
    }
    const struct lw_hidden_points_search *search = p->crowd->search;
    const struct lw_dark_spaces spaces = {search->texels, search->pose, search->trace, search->far_m};
    const uint16_t lit = lw_dark_spaces_find_light(&spaces, p->active, number, at, normal);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (lit >> lane & 1) p->crowd->texel[p->point[lane]->texel].lit = true;
    return p->active & (uint16_t)~lit;
}

/* No other surface runs through the point: short rays across it, along one axis, meet none. */
static uint16_t stands_apart(struct packet *p, uint32_t axis) {
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (!is_active(p, lane)) continue;
        const struct point *point = p->point[lane];
        struct lw_vec3 t, b;
        lw_vec3_frame(point->face, &t, &b);
        const struct lw_vec3 half = lw_vec3_scale(axis ? b : t, TOUCHING * point->lift_m);
        lw_trace_set_ray(&p->rays, lane, lw_vec3_sub(point->origin, half), half, 2);
    }
    return p->active &
           (uint16_t)~lw_trace_occluded16(p->crowd->search->trace, LW_TRACE_COHERENT, p->active, &p->rays);
}

static bool is_cut_off(const struct packet *p, uint32_t lane) {
    return is_met(p, lane) && p->hits.t[lane] > TOUCHING * p->point[lane]->lift_m &&
           (p->hits.object[lane] != p->crowd->object || is_back(p, lane));
}

/* Points that were raised off a bulge (lw_scene_shadow_origin) past something else meet it, looking back
 * down. */
static uint16_t is_joined(struct packet *p, uint32_t unused) {
    (void)unused;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (is_active(p, lane))
            lw_trace_set_ray(&p->rays, lane, p->point[lane]->origin, lw_vec3_scale(p->point[lane]->face, -1),
                             p->crowd->search->near_m);
    trace(p, LW_TRACE_COHERENT, p->active);
    return p->active & (uint16_t)~lanes_where(p, is_cut_off);
}

/* Returns the lanes whose ray a standing object stops. */
static uint16_t find_parted(struct packet *p, unsigned flags) {
    trace(p, flags, p->active);
    return lanes_where(p, is_parting);
}

/* Not close under another surface that stands still, as is the part of a wall behind a picture rail. */
static uint16_t is_open(struct packet *p, uint32_t unused) {
    (void)unused;
    const uint16_t points = p->active;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (is_active(p, lane) && !p->point[lane]->covered) p->active &= (uint16_t) ~(1u << lane);
    if (!p->active) return points;
    set_up_rays(p, LW_CROSSINGS_CLOSE * p->crowd->size_m);
    return points & (uint16_t)~find_parted(p, LW_TRACE_COHERENT);
}

/* Somewhat above the surface, so that a bulge does not part itself, but not above close surfaces. */
static struct lw_vec3 raised(const struct crowd *c, const struct point *point) {
    return lw_vec3_mad(point->origin, point->face, LOOK_ALONG * c->size_m);
}

/* Where one looks along the surface from: the texel's own position, or its pivot. */
static struct lw_vec3 look_from(const struct crowd *c, const struct texel *texel) {
    const struct lw_hidden_points_search *s = c->search;
    const struct lw_mesh_texels *mesh = &s->texels->mesh[s->texels->scene->object[c->object].mesh];
    const struct lw_affine *to_world = &s->pose->object_to_world[c->object];
    if (texel->pivot) return raised(c, texel->pivot);
    return lw_vec3_mad(lw_affine_point(to_world, lw_texels_vector(mesh->position, texel->index)),
                       lw_affine_normal(to_world, lw_packed_normal_unpack(mesh->geometric[texel->index])),
                       LOOK_ALONG * c->size_m);
}

/* Finds the points that something stands before, who looks along the surface. Who looks from there sees
 * fronts alone. */
static uint16_t is_parted(struct packet *p, uint32_t unused) {
    (void)unused;
    const struct crowd *c = p->crowd;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (!is_active(p, lane)) continue;
        const struct lw_vec3 own = look_from(c, &c->texel[p->point[lane]->texel]);
        lw_trace_set_ray(&p->rays, lane, own, lw_vec3_sub(raised(c, p->point[lane]), own), 1);
    }
    p->active = find_parted(p, 0);
    const uint16_t seen = p->active ? find_parted(p, LW_TRACE_VIEW) : 0;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (!is_active(p, lane)) continue;
        struct texel *texel = &p->crowd->texel[p->point[lane]->texel];
        const uint8_t bit = (uint8_t)(1u << p->point[lane]->number);
        texel->beyond |= bit;
        if (!(seen >> lane & 1)) texel->before |= bit;
    }
    return p->active;
}

static void add_point(struct crowd *c, const struct lw_sample_points_frame *frame,
                      const struct lw_sample_points_lanes *lanes, uint32_t lane, uint32_t texel,
                      uint32_t number) {
    c->point[c->points++] = (struct point){
        .origin = lw_vec3(lanes->at.x[lane], lanes->at.y[lane], lanes->at.z[lane]),
        .face = lw_vec3(lanes->gx[lane], lanes->gy[lane], lanes->gz[lane]),
        .lift_m = lw_sample_points_lift_m(frame, lanes->lift[lane]),
        .texel = (uint16_t)texel,
        .number = (uint8_t)number,
    };
}

/* Unpacks the usable points of all texels. */
static void add_points(struct crowd *c, const struct lw_mesh_texels *mesh,
                       const struct lw_sample_points_frame *frame) {
    const struct lw_sample_points *points = &mesh->sample_points;
    uint32_t of[LW_TRACE_WIDTH], number[LW_TRACE_WIDTH], index[LW_TRACE_WIDTH], point[LW_TRACE_WIDTH],
        lanes = 0;
    for (uint32_t i = 0; i <= c->texels * LW_SAMPLE_POINTS_MAX; i++) {
        const uint32_t t = i / LW_SAMPLE_POINTS_MAX, k = i % LW_SAMPLE_POINTS_MAX;
        if (t < c->texels && c->texel[t].usable >> k & 1) {
            of[lanes] = t;
            number[lanes] = k;
            index[lanes] = c->texel[t].index;
            point[lanes] = points->first[c->texel[t].index] + k;
            lanes++;
        }
        if (!lanes || (lanes < LW_TRACE_WIDTH && t < c->texels)) continue;
        struct lw_sample_points_lanes loaded;
        for (uint32_t lane = lanes; lane < LW_TRACE_WIDTH; lane++)
            index[lane] = index[0], point[lane] = point[0];
        lw_sample_points_load(points, mesh->position, index, point, &loaded);
        lw_sample_points_to_world(frame, &loaded);
        for (uint32_t lane = 0; lane < lanes; lane++)
            add_point(c, frame, &loaded, lane, of[lane], number[lane]);
        lanes = 0;
    }
}

static void crowd_init(struct crowd *c, const struct lw_hidden_points_search *search, uint32_t object,
                       const uint32_t *texel, uint32_t count, const uint8_t *usable) {
    const struct lw_mesh_texels *mesh = &search->texels->mesh[search->texels->scene->object[object].mesh];
    struct lw_sample_points_frame frame;
    lw_sample_points_frame_init(&frame, &search->pose->object_to_world[object]);
    c->search = search;
    c->object = object;
    /* not the extent of its points: a texel that a chart only crosses may have one */
    c->size_m = mesh->texel_m * frame.stretch;
    c->texels = count;
    c->points = 0;
    for (uint32_t t = 0; t < count; t++) c->texel[t] = (struct texel){.index = texel[t], .usable = usable[t]};
    add_points(c, mesh, &frame);
}

/* Usable points with one of these numbers, of suspects or of all. */
static void list_points(const struct crowd *c, struct list *list, uint8_t numbers, bool suspects) {
    list->count = 0;
    for (uint32_t i = 0; i < c->points; i++) {
        const struct texel *texel = &c->texel[c->point[i].texel];
        if ((texel->suspect || !suspects) && texel->usable & numbers & 1u << c->point[i].number)
            list->point[list->count++] = (uint16_t)i;
    }
}

static void find_suspects(struct crowd *c, struct list *list) {
    for (uint32_t r = 0; r < RAYS; r++) {
        list_points(c, list, (uint8_t)(1u << r), false);
        sift(c, list, is_suspect, r);
        for (uint32_t i = 0; i < list->count; i++) c->texel[c->point[list->point[i]].texel].suspect = true;
    }
}

/* Texels beside the back of a wall, whose points are to look farther than they have. */
static void find_rims(struct crowd *c, struct list *list) {
    list_points(c, list, 1, true);
    for (uint32_t i = 0; i < list->count; i++) c->texel[c->point[list->point[i]].texel].rim = true;
    for (uint32_t r = 0; r < RIM_RAYS; r++) sift(c, list, has_no_rim, r);
    for (uint32_t i = 0; i < list->count; i++) c->texel[c->point[list->point[i]].texel].rim = false;
    for (uint32_t i = 0; i < c->points; i++)
        if (c->texel[c->point[i].texel].rim) c->point[i].looked = c->point[i].back = 0;
}

static void take_out(struct crowd *c, const struct list *list) {
    for (uint32_t i = 0; i < list->count; i++) {
        const struct point *point = &c->point[list->point[i]];
        c->texel[point->texel].usable &= (uint8_t) ~(1u << point->number);
    }
}

static void take_out_inside(struct crowd *c, struct list *list) {
    list_points(c, list, UINT8_MAX, true);
    for (uint32_t r = 0; r < RAYS; r++) sift(c, list, may_be_inside, r);
    take_out(c, list);
}

/* Takes out points inside solids, once two rays or more have looked for near faces. */
static void take_out_enclosed(struct crowd *c, struct list *list) {
    list_points(c, list, UINT8_MAX, true);
    uint32_t kept = 0;
    for (uint32_t i = 0; i < list->count; i++) {
        struct point *point = &c->point[list->point[i]];
        point->free_rays = (uint8_t)__builtin_popcount(point->clear);
        if (c->texel[point->texel].by_solid && point->free_rays <= 2 * RAYS - ENCLOSED_RAYS)
            list->point[kept++] = list->point[i];
    }
    list->count = kept;
    for (uint32_t r = 0; r < 2 * RAYS; r++) sift(c, list, may_be_enclosed, r);
    take_out(c, list);
}

/* Only backs tell a solid from inside, and only points that are all covered have none that is better. */
static bool may_hide(const struct crowd *c, const struct point *point) {
    const struct texel *texel = &c->texel[point->texel];
    return point->covered ? !texel->uncovered : texel->by_back && !point->met_front;
}

/* Takes out points inside large solids, of any faces, and between solids that touch, where no light comes. */
static void take_out_sealed(struct crowd *c, struct list *list) {
    list_points(c, list, UINT8_MAX, true);
    for (uint32_t i = 0; i < list->count; i++) {
        const struct point *point = &c->point[list->point[i]];
        c->texel[point->texel].uncovered |= !point->covered;
        c->texel[point->texel].by_back |= point->met_back;
    }
    uint32_t kept = 0;
    for (uint32_t i = 0; i < list->count; i++) {
        struct point *point = &c->point[list->point[i]];
        point->free_rays = 0;
        if (may_hide(c, point)) list->point[kept++] = list->point[i];
    }
    list->count = kept;
    for (uint32_t r = 0; r < RAYS; r++) sift(c, list, may_be_sealed, r);
    for (uint32_t walk = 0; walk < WALKS; walk++) sift(c, list, is_dark, walk);
    kept = 0;
    for (uint32_t i = 0; i < list->count; i++)
        if (!c->texel[c->point[list->point[i]].texel].lit) list->point[kept++] = list->point[i];
    list->count = kept;
    take_out(c, list);
}

/* An uncertain point is better than none. */
static void prefer_certain(struct crowd *c, struct list *list) {
    uint8_t certain[LW_HIDDEN_POINTS_TEXELS] = {0};
    list_points(c, list, UINT8_MAX, true);
    for (uint32_t axis = 0; axis < 2; axis++) sift(c, list, stands_apart, axis);
    sift(c, list, is_joined, 0);
    sift(c, list, is_open, 0);
    for (uint32_t i = 0; i < list->count; i++) {
        const struct point *point = &c->point[list->point[i]];
        certain[point->texel] |= (uint8_t)(1u << point->number);
    }
    for (uint32_t t = 0; t < c->texels; t++)
        if (certain[t]) c->texel[t].usable = certain[t];
}

/* Looks from one point of each torn texel to the others, from each in turn, and keeps the largest number
 * that see one another. */
static void find_together(struct crowd *c, struct list *list) {
    for (uint32_t number = 0; number < LW_SAMPLE_POINTS_MAX; number++) {
        bool any = false;
        for (uint32_t t = 0; t < c->texels; t++) c->texel[t].pivot = NULL;
        for (uint32_t i = 0; i < c->points; i++) {
            struct texel *texel = &c->texel[c->point[i].texel];
            if (c->point[i].number != number || !texel->torn || !(texel->usable >> number & 1)) continue;
            texel->pivot = &c->point[i];
            texel->beyond = texel->before = 0;
            any = true;
        }
        if (!any) continue;
        list_points(c, list, UINT8_MAX, true);
        uint32_t kept = 0;
        for (uint32_t i = 0; i < list->count; i++)
            if (c->texel[c->point[list->point[i]].texel].pivot) list->point[kept++] = list->point[i];
        list->count = kept;
        sift(c, list, is_parted, 0);
        for (uint32_t t = 0; t < c->texels; t++) {
            struct texel *texel = &c->texel[t];
            const uint8_t seen = texel->usable & (uint8_t)~texel->beyond;
            if (texel->pivot && __builtin_popcount(seen) > __builtin_popcount(texel->together))
                texel->together = seen;
        }
    }
}

/* Where another surface runs through a texel, such as a wall that stands on a floor, light on its far side is
 * not for those who look at this one: keeps the sample points on the side of the texel's own position, or
 * the points before the face that shows this surface its back, as water does to a floor under it. In that
 * case, and where the own position is inside the wall, keeps the points of the side that has most. */
static void keep_one_side(struct crowd *c, struct list *list) {
    list_points(c, list, UINT8_MAX, true);
    sift(c, list, is_parted, 0);
    for (uint32_t t = 0; t < c->texels; t++) {
        struct texel *texel = &c->texel[t];
        const uint8_t near = texel->usable & (uint8_t)~texel->beyond;
        texel->torn = texel->before || (!near && texel->beyond);
        if (texel->before)
            texel->usable = texel->before;
        else if (near)
            texel->usable = near;
    }
    find_together(c, list);
    for (uint32_t t = 0; t < c->texels; t++)
        if (c->texel[t].torn) c->texel[t].usable = c->texel[t].together;
}

void lw_hidden_points_find(const struct lw_hidden_points_search *search, uint32_t object,
                           const uint32_t *texel, uint32_t count, uint8_t *usable) {
    struct crowd crowd;
    struct list list;
    crowd_init(&crowd, search, object, texel, count, usable);
    find_suspects(&crowd, &list);
    find_rims(&crowd, &list);
    take_out_inside(&crowd, &list);
    take_out_enclosed(&crowd, &list);
    take_out_sealed(&crowd, &list);
    prefer_certain(&crowd, &list);
    keep_one_side(&crowd, &list);
    for (uint32_t t = 0; t < count; t++) usable[t] = crowd.texel[t].usable;
}
