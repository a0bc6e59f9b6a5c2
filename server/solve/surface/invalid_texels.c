#include "server/solve/surface/invalid_texels.h"

#include "common/light/direction.h"
#include "common/progress.h"
#include "common/random.h"
#include "server/solve/surface/crossings.h"

#include <stdlib.h>
#include <string.h>

/* A sample point is inside when what it sees is backs, all but one ray of these, and near ones: a roof that
 * is only modelled from outside shows its back to the floor below, but a lamp may hang in between. So far
 * ones count only where it matters, beside a wall: under a house of the size of the scene its foot's outer
 * side is to have no dark rim. */
#define RAYS        8
#define INSIDE_RAYS 7
#define NEAR        0.1f /* of the scene's longest side */
#define RIM         4.0f /* texels beside a wall: a look-up at level 2 reads as far */
#define RIM_RAYS    8
/* Inside a solid whose faces are double-sided, rays both ways leave it, all but three of these: tubes and
 * boxes may be open at an end. */
#define ENCLOSED_RAYS 13
#define CROSSINGS_MAX 12
/* Closer to another surface than this many times the lift, a sample point may find itself
 * on the surface's other side. */
#define TOUCHING 8
/* How high above the surface its points are joined to the texel's own position, in texels. */
#define LOOK_ALONG 0.1f
/* A texel whose surroundings are clear this many texel sizes around it is searched no further; double-sided
 * solids are looked for as far. */
#define CLEAR 2
/* Texels of an object that one thread searches, in whole rows: an object may have half of the scene. */
#define PART (256u * LW_TRACE_WIDTH)

struct box {
    struct lw_vec3 low, high;
};

struct search {
    struct lw_texels *texels;
    const struct lw_pose *pose;
    const struct lw_trace *trace;
    float near_m, far_m; /* far: beyond all of the scene */
    /* where objects that have become movers stood; of a first look none */
    struct box *left;
    uint32_t left_count;
};

/* Sixteen texels in a row of one object. */
struct row {
    const struct lw_mesh_texels *mesh;
    struct lw_sample_points_frame frame;
    uint32_t object, first;
    uint8_t usable[LW_TRACE_WIDTH];
    struct lw_sample_points_lanes point; /* one sample point of each, in world space */
    float lift[LW_TRACE_WIDTH];          /* m */
};

/* Unpacks sample point k of every texel that has one; returns their mask. */
static uint16_t load_points(struct row *row, uint16_t wanted, uint32_t k) {
    const struct lw_sample_points *points = &row->mesh->sample_points;
    uint32_t texel[LW_TRACE_WIDTH], point[LW_TRACE_WIDTH];
    uint16_t active = 0;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (wanted >> lane & 1 && row->usable[lane] >> k & 1) active |= (uint16_t)(1u << lane);
    if (!active) return 0;
    /* those that are not active repeat one that is */
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        texel[lane] = row->first + (active >> lane & 1 ? lane : (uint32_t)__builtin_ctz(active));
        point[lane] = points->first[texel[lane]] + k;
    }
    lw_sample_points_load(points, row->mesh->position, texel, point, &row->point);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        row->lift[lane] =
            row->point.lift[lane] * row->frame.stretch + LW_TRACE_LIFT * row->frame.offset_m + 1e-30f;
    lw_sample_points_to_world(&row->frame, &row->point);
    return active;
}

static struct lw_vec3 origin_of(const struct row *row, uint32_t lane) {
    return lw_vec3(row->point.at.x[lane], row->point.at.y[lane], row->point.at.z[lane]);
}
static struct lw_vec3 face_of(const struct row *row, uint32_t lane) {
    return lw_vec3(row->point.gx[lane], row->point.gy[lane], row->point.gz[lane]);
}
/* Not the extent of its sample points: a texel that a chart only crosses may have one. */
static float texel_size(const struct row *row) { return row->mesh->texel_m * row->frame.stretch; }

static bool is_back(const struct search *s, const struct lw_hit16 *hits, uint32_t lane) {
    const uint32_t object = hits->object[lane];
    if (object == LW_TRACE_MISS || !hits->back[lane]) return false;
    const struct lw_scene *scene = s->texels->scene;
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    return !lw_pose_object_moves(s->pose, scene, object) &&
           !scene->material[mesh->material[hits->triangle[lane]]].double_sided;
}

/* Shoots direction r of a cosine-weighted set from the loaded sample points, near; those of `far` as far as
 * there is anything. */
static void look(const struct search *s, const struct row *row, uint16_t active, uint16_t far, uint32_t r,
                 struct lw_hit16 *out_hits) {
    struct lw_ray16 rays = {.salt = 0};
    float point[2];
    lw_random_sobol2(r, 0, point);
    struct lw_vec3 local = lw_direction_cosine(point);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (active >> lane & 1)
            lw_trace_set_ray(&rays, lane, origin_of(row, lane), lw_direction_about(face_of(row, lane), local),
                             far >> lane & 1 ? s->far_m : s->near_m);
    lw_trace_closest16(s->trace, LW_TRACE_COHERENT, active, &rays, out_hits);
}

static void set_up_rays(const struct row *row, uint16_t active, float reach_m, struct lw_ray16 *rays) {
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (active >> lane & 1)
            lw_trace_set_ray(rays, lane, origin_of(row, lane), face_of(row, lane), reach_m);
}

/* Sample points with something close above them. */
static uint16_t find_covered(const struct search *s, const struct row *row, uint16_t active) {
    struct lw_ray16 rays = {.salt = 0};
    set_up_rays(row, active, LW_CROSSINGS_CLOSE * texel_size(row), &rays);
    return lw_trace_occluded16(s->trace, LW_TRACE_COHERENT, active, &rays);
}

/* One ray from each sample point, and a short one straight up: enough to see that a texel stands free.
 * Returns the mask of those that may not. */
static uint16_t find_suspects(const struct search *s, struct row *row, uint16_t active) {
    uint16_t suspects = 0;
    for (uint32_t r = 0; r < RAYS; r++) {
        const uint16_t loaded = load_points(row, active, r);
        struct lw_hit16 hits;
        if (!loaded) continue;
        suspects |= find_covered(s, row, loaded);
        look(s, row, loaded, loaded, r, &hits);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
            if (loaded >> lane & 1 && (is_back(s, &hits, lane) || (hits.object[lane] != LW_TRACE_MISS &&
                                                                   hits.t[lane] < CLEAR * texel_size(row))))
                suspects |= (uint16_t)(1u << lane);
    }
    return suspects;
}

/* Texels beside the back of a wall, looked for a quarter of a texel above the surface. */
static uint16_t find_rim(const struct search *s, struct row *row, uint16_t suspects) {
    const uint16_t active = load_points(row, suspects, 0);
    uint16_t rim = 0;
    for (uint32_t r = 0; r < RIM_RAYS; r++) {
        const float angle = 2 * LW_PI * (float)r / RIM_RAYS;
        struct lw_ray16 rays = {.salt = 0};
        struct lw_hit16 hits;
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
            if (!(active >> lane & 1)) continue;
            const float size = texel_size(row);
            struct lw_vec3 t, b;
            lw_vec3_frame(face_of(row, lane), &t, &b);
            lw_trace_set_ray(&rays, lane, lw_vec3_mad(origin_of(row, lane), face_of(row, lane), 0.25f * size),
                             lw_vec3_mad(lw_vec3_scale(t, cosf(angle)), b, sinf(angle)), RIM * size);
        }
        lw_trace_closest16(s->trace, 0, active, &rays, &hits);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
            if (active >> lane & 1 && is_back(s, &hits, lane)) rim |= (uint16_t)(1u << lane);
    }
    return rim;
}

/* Most sample points stand free, and two rays say so: those that one ray too many
 * leaves are tested no further. */
static uint16_t find_inside(const struct search *s, const struct row *row, uint16_t active, uint16_t rim) {
    int free_rays[LW_TRACE_WIDTH] = {0};
    uint16_t inside = active;
    for (uint32_t r = 0; r < RAYS && inside; r++) {
        struct lw_hit16 hits;
        look(s, row, inside, rim, r, &hits);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
            if (inside >> lane & 1 && !is_back(s, &hits, lane) && ++free_rays[lane] > RAYS - INSIDE_RAYS)
                inside &= (uint16_t) ~(1u << lane);
    }
    return inside;
}

/* By how many the faces that a ray leaves solids by outnumber those by which it enters some: 1 from inside
 * a closed one, whatever else is in it; 0 from outside, and 1 or -1 from beside a sheet. What may let
 * light through does not count. */
static void count_exits(const struct search *s, const struct row *row, uint16_t active, struct lw_ray16 *rays,
                        int out_exits[LW_TRACE_WIDTH]) {
    const struct lw_scene *scene = s->texels->scene;
    memset(out_exits, 0, LW_TRACE_WIDTH * sizeof *out_exits);
    for (uint32_t k = 0; k < CROSSINGS_MAX && active; k++) {
        struct lw_hit16 hits;
        lw_trace_closest16(s->trace, 0, active, rays, &hits);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
            if (!(active >> lane & 1)) continue;
            const uint32_t object = hits.object[lane];
            if (object == LW_TRACE_MISS) {
                active &= (uint16_t) ~(1u << lane);
                continue;
            }
            const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
            if (!lw_pose_object_moves(s->pose, scene, object) &&
                scene->material[mesh->material[hits.triangle[lane]]].alpha_mode == LW_ALPHA_OPAQUE)
                out_exits[lane] += hits.back[lane] ? 1 : -1;
            rays->t_near[lane] = hits.t[lane] + 4 * row->lift[lane];
        }
    }
}

/* Places inside solids, by generalized winding numbers (Jacobson et al. 2013) of what is near: these bear
 * holes and solids that overlap, and tell a sample point under a sheet, from which the way down leads in,
 * or nowhere, from one in a box. So backs of double-sided surfaces bury, too. What lights the inside of
 * such a solid is nobody's to see. Rays up come first: most leave by no face at all. */
static uint16_t find_enclosed(const struct search *s, const struct row *row, uint16_t active) {
    const float reach_m = fminf(CLEAR * texel_size(row), s->near_m);
    int free_rays[LW_TRACE_WIDTH] = {0};
    uint16_t enclosed = active;
    for (uint32_t r = 0; r < 2 * RAYS && enclosed; r++) {
        struct lw_ray16 rays = {.salt = 0};
        int exits[LW_TRACE_WIDTH];
        float point[2];
        lw_random_sobol2(r % RAYS, 0, point);
        const struct lw_vec3 local = lw_vec3_scale(lw_direction_cosine(point), r < RAYS ? 1 : -1);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
            if (enclosed >> lane & 1)
                lw_trace_set_ray(&rays, lane, origin_of(row, lane),
                                 lw_direction_about(face_of(row, lane), local), reach_m);
        count_exits(s, row, enclosed, &rays, exits);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
            if (enclosed >> lane & 1 && exits[lane] < 1 && ++free_rays[lane] > 2 * RAYS - ENCLOSED_RAYS)
                enclosed &= (uint16_t) ~(1u << lane);
    }
    return enclosed;
}

/* Places that another surface runs through: short rays across them meet it. */
static uint16_t find_touching(const struct search *s, const struct row *row, uint16_t active) {
    uint16_t touching = 0;
    for (int axis = 0; axis < 2; axis++) {
        struct lw_ray16 rays = {.salt = 0};
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
            if (!(active >> lane & 1)) continue;
            struct lw_vec3 t, b;
            lw_vec3_frame(face_of(row, lane), &t, &b);
            struct lw_vec3 half = lw_vec3_scale(axis ? b : t, TOUCHING * row->lift[lane]);
            lw_trace_set_ray(&rays, lane, lw_vec3_sub(origin_of(row, lane), half), half, 2);
        }
        touching |= lw_trace_occluded16(s->trace, 0, active, &rays);
    }
    return touching;
}

/* Places that were raised off a bulge (lw_scene_shadow_origin) past something else:
 * looking back down they meet it. */
static uint16_t find_cut_off(const struct search *s, const struct row *row, uint16_t active) {
    struct lw_ray16 rays = {.salt = 0};
    struct lw_hit16 hits;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (active >> lane & 1)
            lw_trace_set_ray(&rays, lane, origin_of(row, lane), lw_vec3_scale(face_of(row, lane), -1),
                             s->near_m);
    lw_trace_closest16(s->trace, 0, active, &rays, &hits);
    uint16_t cut_off = 0;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (active >> lane & 1 && hits.object[lane] != LW_TRACE_MISS &&
            hits.t[lane] > TOUCHING * row->lift[lane] &&
            (hits.object[lane] != row->object || is_back(s, &hits, lane)))
            cut_off |= (uint16_t)(1u << lane);
    return cut_off;
}

/* Rays that something that stands still stops. */
static uint16_t find_parted(const struct search *s, unsigned flags, uint16_t active,
                            const struct lw_ray16 *rays) {
    struct lw_hit16 hits;
    uint16_t parted = 0;
    lw_trace_closest16(s->trace, flags, active, rays, &hits);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++)
        if (active >> lane & 1 && hits.object[lane] != LW_TRACE_MISS &&
            !lw_pose_object_moves(s->pose, s->texels->scene, hits.object[lane]))
            parted |= (uint16_t)(1u << lane);
    return parted;
}

/* Places close under another surface that stands still, such as the part of a wall behind a picture rail. */
static uint16_t find_close(const struct search *s, const struct row *row, uint16_t active) {
    struct lw_ray16 rays = {.salt = 0};
    set_up_rays(row, active, LW_CROSSINGS_CLOSE * texel_size(row), &rays);
    return find_parted(s, LW_TRACE_COHERENT, active, &rays);
}

/* Where another surface runs through a texel, such as a wall that stands on a floor, light on its far side is
 * not for those who look at this one: keeps the sample points on the side of the texel's own position, or
 * those before the face that shows this one its back, as water does to what is under it. Looked along
 * somewhat above the surface, so that a bulge does not part itself, but not above what is close. */
static void keep_one_side(const struct search *s, struct row *row, uint16_t suspects) {
    uint8_t beyond[LW_TRACE_WIDTH] = {0}, before[LW_TRACE_WIDTH] = {0};
    const float height_m = LOOK_ALONG * texel_size(row);
    for (uint32_t k = 0; k < LW_SAMPLE_POINTS_MAX; k++) {
        const uint16_t active = load_points(row, suspects, k);
        struct lw_ray16 rays = {.salt = 0};
        if (!active) continue;
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
            if (!(active >> lane & 1)) continue;
            const uint32_t i = row->first + lane;
            const struct lw_affine *to_world = &s->pose->object_to_world[row->object];
            const struct lw_vec3 own =
                lw_vec3_mad(lw_affine_point(to_world, lw_texels_vector(row->mesh->position, i)),
                            lw_affine_normal(to_world, lw_texels_vector(row->mesh->geometric, i)), height_m);
            const struct lw_vec3 raised = lw_vec3_mad(origin_of(row, lane), face_of(row, lane), height_m);
            lw_trace_set_ray(&rays, lane, own, lw_vec3_sub(raised, own), 1);
        }
        const uint16_t parted = find_parted(s, 0, active, &rays);
        /* who looks from there sees fronts alone */
        const uint16_t seen = parted ? find_parted(s, LW_TRACE_VIEW, parted, &rays) : 0;
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
            beyond[lane] |= (uint8_t)((parted >> lane & 1u) << k);
            before[lane] |= (uint8_t)(((parted & ~seen) >> lane & 1u) << k);
        }
    }
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        const uint8_t near = row->usable[lane] & (uint8_t)~beyond[lane];
        if (before[lane])
            row->usable[lane] = before[lane];
        else if (near)
            row->usable[lane] = near; /* else its position is where light cannot reach */
    }
}

/* Takes the sample points that light cannot reach out of the row's masks. */
static void examine(const struct search *s, struct row *row, uint16_t suspects) {
    uint8_t out[LW_TRACE_WIDTH] = {0}, uncertain[LW_TRACE_WIDTH] = {0};
    const uint16_t rim = find_rim(s, row, suspects);
    for (uint32_t k = 0; k < LW_SAMPLE_POINTS_MAX; k++) {
        const uint16_t active = load_points(row, suspects, k);
        if (!active) continue;
        uint16_t inside = find_inside(s, row, active, rim), unsure = 0;
        inside |= find_enclosed(s, row, active & (uint16_t)~inside);
        const uint16_t open = active & (uint16_t)~inside;
        if (open)
            unsure = find_touching(s, row, open) | find_cut_off(s, row, open) | find_close(s, row, open);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
            out[lane] |= (uint8_t)((inside >> lane & 1u) << k);
            uncertain[lane] |= (uint8_t)((unsure >> lane & 1u) << k);
        }
    }
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        row->usable[lane] &= (uint8_t)~out[lane];
        /* An uncertain sample point is better than none. */
        if (row->usable[lane] & ~uncertain[lane]) row->usable[lane] &= (uint8_t)~uncertain[lane];
    }
    keep_one_side(s, row, suspects);
}

static bool has_lost_places(const struct lw_mesh_texels *mesh, uint32_t i, uint8_t usable) {
    return mesh->covered[i] && usable != lw_sample_points_all(&mesh->sample_points, i);
}

static void unbury(const struct lw_mesh_texels *mesh, uint32_t i, uint8_t *covered, uint8_t *usable) {
    *covered = 1;
    *usable = lw_sample_points_all(&mesh->sample_points, i);
}

/* Whether the straight line from p by d comes within a margin of the box. */
static bool meets(const struct box *box, float margin, struct lw_vec3 p, struct lw_vec3 d) {
    const float at[3] = {p.x, p.y, p.z}, by[3] = {d.x, d.y, d.z},
                low[3] = {box->low.x, box->low.y, box->low.z},
                high[3] = {box->high.x, box->high.y, box->high.z};
    float enter = 0, leave = 1;
    for (int c = 0; c < 3; c++) {
        const float inverse = 1 / (fabsf(by[c]) > 1e-30f ? by[c] : 1e-30f);
        const float a = (low[c] - margin - at[c]) * inverse, b = (high[c] + margin - at[c]) * inverse;
        enter = fmaxf(enter, fminf(a, b));
        leave = fminf(leave, fmaxf(a, b));
    }
    return enter <= leave;
}

/* Whether what is no longer there may have cut one of the object's charts. */
static bool may_be_joined(const struct search *s, uint32_t object, float size_m) {
    struct box own = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    const float margin = 2 * CLEAR * size_m;
    lw_pose_object_bounds(s->pose, s->texels->scene, object, &own.low, &own.high);
    for (uint32_t k = 0; k < s->left_count; k++) {
        const struct box *left = &s->left[k];
        if (left->low.x - margin <= own.high.x && left->low.y - margin <= own.high.y &&
            left->low.z - margin <= own.high.z && left->high.x + margin >= own.low.x &&
            left->high.y + margin >= own.low.y && left->high.z + margin >= own.low.z)
            return true;
    }
    return false;
}

/* Whether what is no longer there may have been met from one of the texel's sample points: rays from
 * its middle stand for theirs. */
static bool may_be_freed(const struct search *s, const struct row *row, uint32_t i) {
    const struct lw_affine *to_world = &s->pose->object_to_world[row->object];
    const struct lw_vec3 p = lw_affine_point(to_world, lw_texels_vector(row->mesh->position, i)),
                         n = lw_affine_normal(to_world, lw_texels_vector(row->mesh->geometric, i));
    const float size = texel_size(row), margin = 2 * size;
    for (uint32_t k = 0; k < s->left_count; k++) {
        const struct box *box = &s->left[k];
        if (meets(box, margin + RIM * size, p, lw_vec3(0, 0, 0)) ||
            meets(box, margin, p, lw_vec3_scale(n, -s->near_m)))
            return true;
        for (uint32_t r = 0; r < RAYS; r++) {
            float point[2];
            lw_random_sobol2(r, 0, point);
            const struct lw_vec3 d = lw_direction_about(n, lw_direction_cosine(point));
            if (meets(box, margin, p, lw_vec3_scale(d, s->far_m))) return true;
        }
    }
    return false;
}

/* Returns how many texels of an object, from `first` to before `end`, are gone. again: only those are tested
 * that had lost a sample point before; returns how many these are. */
static uint64_t find_in_part(const struct search *s, uint32_t object, uint32_t first, uint32_t end,
                             bool again) {
    struct row row = {.mesh = &s->texels->mesh[s->texels->scene->object[object].mesh], .object = object};
    lw_sample_points_frame_init(&row.frame, &s->pose->object_to_world[object]);
    uint8_t *covered = s->texels->covered + s->texels->first[object],
            *usable = s->texels->usable + s->texels->first[object];
    uint64_t count = 0;
    for (row.first = first; row.first < end; row.first += LW_TRACE_WIDTH) {
        uint16_t active = 0;
        memset(row.usable, 0, sizeof row.usable);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH && row.first + lane < end; lane++) {
            const uint32_t i = row.first + lane;
            if (again) {
                if (!has_lost_places(row.mesh, i, usable[i]) || !may_be_freed(s, &row, i)) continue;
                unbury(row.mesh, i, &covered[i], &usable[i]);
                count++;
            } else if (!covered[i]) {
                continue;
            }
            active |= (uint16_t)(1u << lane);
            row.usable[lane] = usable[row.first + lane];
        }
        if (!active) continue;
        const uint16_t suspects = find_suspects(s, &row, active);
        if (!suspects) continue;
        examine(s, &row, suspects);
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
            if (!(suspects >> lane & 1)) continue;
            usable[row.first + lane] = row.usable[lane];
            if (row.usable[lane]) continue;
            covered[row.first + lane] = 0;
            count += !again;
        }
    }
    return count;
}

static struct search begin(struct lw_texels *texels, const struct lw_pose *pose,
                           const struct lw_trace *trace) {
    struct lw_vec3 low = {0}, high = {0};
    lw_pose_bounds(pose, texels->scene, &low, &high);
    const struct lw_vec3 size = lw_vec3_sub(high, low);
    const float longest = fmaxf(size.x, fmaxf(size.y, size.z));
    return (struct search){
        .texels = texels, .pose = pose, .trace = trace, .near_m = NEAR * longest, .far_m = 2 * longest};
}

struct part {
    uint32_t object, first, end;
};

/* out_part: NULL, to count them. */
static uint32_t list_parts(const struct search *s, struct part *out_part) {
    uint32_t count = 0;
    for (uint32_t o = 0; o < s->texels->scene->object_count; o++) {
        const uint32_t texels = s->texels->mesh[s->texels->scene->object[o].mesh].texel_count;
        if (lw_pose_object_moves(s->pose, s->texels->scene, o)) continue;
        for (uint32_t first = 0; first < texels; first += PART, count++)
            if (out_part)
                out_part[count] = (struct part){o, first, texels - first < PART ? texels : first + PART};
    }
    return count;
}

enum lw_status lw_invalid_texels_find(struct lw_texels *texels, const struct lw_pose *pose,
                                      const struct lw_trace *trace, int threads, const _Atomic bool *cancel,
                                      uint64_t *out_count) {
    const uint32_t objects = texels->scene->object_count;
    const struct search search = begin(texels, pose, trace);
    const uint32_t parts = list_parts(&search, NULL);
    struct part *part = malloc((parts + 1ul) * sizeof *part);
    if (!part) return LW_NO_MEMORY;
    list_parts(&search, part);
    uint64_t count = 0;
    int failures = 0;
    struct lw_progress progress;
    lw_progress_init(&progress, "looking inside objects", parts + objects);
#pragma omp parallel num_threads(threads) reduction(+ : count, failures)
    {
#pragma omp for schedule(dynamic, 1)
        for (uint32_t i = 0; i < parts; i++) {
            if (cancel && *cancel) continue;
            count += find_in_part(&search, part[i].object, part[i].first, part[i].end, false);
            lw_progress_step(&progress, 1);
        }
#pragma omp for schedule(dynamic, 1)
        for (uint32_t o = 0; o < objects; o++) {
            if (cancel && *cancel) continue;
            if (!lw_pose_object_moves(pose, texels->scene, o))
                failures += lw_crossings_find(texels, pose, trace, o, &count) != LW_OK;
            lw_progress_step(&progress, 1);
        }
    }
    free(part);
    if (cancel && *cancel) {
        lw_progress_stop(&progress);
        return LW_CLOSED;
    }
    lw_progress_finish(&progress);
    if (count) lw_texels_link(texels, threads);
    if (failures) return LW_NO_MEMORY;
    *out_count = count;
    return LW_OK;
}

static void unbury_all(struct lw_texels *texels, uint32_t object) {
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[object].mesh];
    const uint32_t first = texels->first[object];
    for (uint32_t i = 0; i < mesh->texel_count; i++)
        if (mesh->covered[i]) unbury(mesh, i, &texels->covered[first + i], &texels->usable[first + i]);
}

enum lw_status lw_invalid_texels_review(struct lw_texels *texels, const struct lw_pose *before,
                                        const struct lw_pose *pose, const struct lw_trace *trace,
                                        int threads) {
    const struct lw_scene *scene = texels->scene;
    struct search search = begin(texels, pose, trace);
    /* what an object inside it may have inside by rays as long as then */
    const struct search then = begin(texels, before, trace);
    search.near_m = fmaxf(search.near_m, then.near_m);
    search.far_m = fmaxf(search.far_m, then.far_m);
    search.left = malloc((scene->object_count + 1ul) * sizeof *search.left);
    if (!search.left) return LW_NO_MEMORY;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (!lw_pose_object_moves(pose, scene, o) || lw_pose_object_moves(before, scene, o)) continue;
        struct box *box = &search.left[search.left_count++];
        *box = (struct box){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
        lw_pose_object_bounds(before, scene, o, &box->low, &box->high);
        unbury_all(texels, o);
        lw_texels_link_object(texels, o);
    }
    int failures = 0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads) reduction(+ : failures)
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (!search.left_count || lw_pose_object_moves(pose, scene, o)) continue;
        struct row row = {.mesh = &texels->mesh[scene->object[o].mesh]};
        lw_sample_points_frame_init(&row.frame, &pose->object_to_world[o]);
        uint64_t yielding = 0;
        if (!find_in_part(&search, o, 0, row.mesh->texel_count, true) &&
            !may_be_joined(&search, o, texel_size(&row)))
            continue;
        failures += lw_crossings_find(texels, pose, trace, o, &yielding) != LW_OK;
        lw_texels_link_object(texels, o);
    }
    free(search.left);
    return failures ? LW_NO_MEMORY : LW_OK;
}
