#include "common/lightmap/lightmap.h"

#include "common/base/progress.h"
#include "common/lightmap/lightmap_chart.h"
#include "common/lightmap/lightmap_check.h"
#include "common/lightmap/lightmap_density.h"
#include "common/lightmap/lightmap_pack.h"
#include "common/lightmap/lightmap_things.h"
#include "common/scene/pose.h"

#include <float.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

#define ATLAS_SIDE_MIN (2 * LW_LIGHTMAP_BLOCK)

/* Density is sought twice more after the first guess: covered texels are nearly, not quite, its square. */
#define DENSITY_ROUNDS 3

/* A density below this share of the wanted one is reported: counting ends within a few percent. */
#define BOUNDED_UNDER 0.97

/* Steps of bisection for a mesh that does not fit: its density is within a percent of the best. */
#define FIT_STEPS 7

/* Where the number of texels bounds the density: the most of them that one object takes before the others
 * have the density that is wanted. */
#define SHARE_MAX 0.5
/* Rounding error of the area of coordinates that fill the unit square. */
#define UV_AREA_NOISE 1e-3

/* Halvings of the density before a mesh is given up: by then every chart has the smallest rectangle there
 * is. */
#define HALVINGS_MAX 64

/* One mesh on its way to a lightmap. */
struct job {
    const struct lw_mesh *mesh;
    uint32_t mesh_index, object_count;
    double metres_per_unit; /* its largest object's */
    double area_os;         /* square units */
    double edges_os;        /* units (lightmap_things.h); 0 where they do not matter */
    double asked;           /* texels per metre as a multiple of the scene's, by name */
    double relative;        /* the same where the number of texels is bounded, on top of that */
    bool has_back;
    uint8_t *back; /* per triangle; NULL without backs */

    bool unwrapped;      /* charts and layout are there */
    double charts_scale; /* texels per unit that the charts are made for */
    struct lw_lightmap_charts charts;
    struct lw_lightmap_layout layout;

    /* the result, at the density last asked for */
    struct lw_vec2 *uv;     /* per point, or per vertex if from the file */
    uint32_t width, height; /* front only */
    double scale;           /* texels per unit reached */
    uint64_t covered;
    bool from_file, capped;
    enum lw_status status;
    struct lw_error error;
};

struct drive {
    struct lw_scene *scene;
    struct job *job; /* most triangles first, so that no thread is left with a long one at the end */
    uint32_t job_count, side_max;
    double density_max, texels_max; /* texels per metre; of all objects, INFINITY: no bound */
    int threads;
};

static void finish_job(struct job *job) {
    lw_lightmap_pack_finish(&job->layout);
    lw_lightmap_chart_finish(&job->charts);
    free(job->back);
    free(job->uv);
}

/* Second moments of a mesh's area by direction: sum of area * n n^T. */
struct moments {
    double m[3][3], area;
};

static struct moments moments_of(const struct lw_mesh *mesh) {
    struct moments moments = {0};
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        struct lw_vec3 p = mesh->position[mesh->triangle[t][0]], q = mesh->position[mesh->triangle[t][1]],
                       r = mesh->position[mesh->triangle[t][2]];
        double u[3] = {(double)q.x - (double)p.x, (double)q.y - (double)p.y, (double)q.z - (double)p.z};
        double v[3] = {(double)r.x - (double)p.x, (double)r.y - (double)p.y, (double)r.z - (double)p.z};
        double n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
        double area = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) / 2;
        if (!(area > 0)) continue;
        moments.area += area;
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) moments.m[i][j] += n[i] * n[j] / (4 * area);
    }
    return moments;
}

/* Area grows by |cof(A) n|; the root of its mean square over the mesh is exact for similarities. */
static double area_scale(const struct moments *moments, const struct lw_affine *to_world) {
    double cofactor[3][3], sum = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            cofactor[i][j] = (double)to_world->m[i1][j1] * (double)to_world->m[i2][j2] -
                             (double)to_world->m[i1][j2] * (double)to_world->m[i2][j1];
        }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++) sum += cofactor[i][j] * moments->m[j][k] * cofactor[i][k];
    return moments->area > 0 && sum > 0 ? sqrt(sum / moments->area) : 0;
}

static enum lw_status find_backs(const struct lw_scene *scene, struct job *job) {
    const struct lw_mesh *mesh = job->mesh;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        if (!scene->material[mesh->material[t]].double_sided) continue;
        if (!job->back) job->back = calloc(mesh->triangle_count, 1);
        if (!job->back) return LW_NO_MEMORY;
        job->has_back = true;
        job->back[t] = 1;
    }
    return LW_OK;
}

static int compare_jobs(const void *left, const void *right) {
    const struct job *a = left, *b = right;
    if (a->mesh->triangle_count != b->mesh->triangle_count)
        return a->mesh->triangle_count > b->mesh->triangle_count ? -1 : 1;
    return a->mesh_index < b->mesh_index ? -1 : a->mesh_index > b->mesh_index;
}

/* A job for every mesh that an object uses. */
static enum lw_status find_jobs(struct drive *drive) {
    struct lw_scene *scene = drive->scene;
    struct lw_pose pose;
    enum lw_status status = lw_pose_init(&pose, scene);
    if (status != LW_OK) return status;
    struct job *job = calloc((size_t)scene->mesh_count + 1, sizeof *job);
    struct moments *moments = calloc((size_t)scene->mesh_count + 1, sizeof *moments);
    if (!job || !moments) status = LW_NO_MEMORY;
    for (uint32_t i = 0; status == LW_OK && i < scene->object_count; i++) {
        uint32_t m = scene->object[i].mesh;
        if (!job[m].object_count++) moments[m] = moments_of(&scene->mesh[m]);
        double scale = sqrt(area_scale(&moments[m], &pose.object_to_world[i]));
        if (scale > job[m].metres_per_unit) job[m].metres_per_unit = scale;
    }
    uint32_t count = 0;
    for (uint32_t m = 0; status == LW_OK && m < scene->mesh_count; m++) {
        if (!job[m].object_count) continue;
        struct job *j = &job[count];
        if (count++ != m) *j = job[m], job[m] = (struct job){0};
        j->mesh = &scene->mesh[m];
        j->mesh_index = m;
        j->area_os = moments[m].area;
        j->relative = 1;
        j->asked = 1;
        if (!(j->metres_per_unit > 0)) j->metres_per_unit = 1; /* flattened to nothing: any density will do */
        status = find_backs(scene, j);
    }
    free(moments);
    lw_pose_finish(&pose);
    drive->job = job;
    drive->job_count = count;
    if (status == LW_OK) qsort(job, count, sizeof *job, compare_jobs);
    return status;
}

static uint32_t height_max(const struct drive *drive, const struct job *job) {
    return (job->has_back ? drive->side_max / 2 : drive->side_max) / LW_LIGHTMAP_BLOCK * LW_LIGHTMAP_BLOCK;
}

/* Area of the file's second UV set, or 0 if it cannot be lightmap coordinates. */
static double file_uv_area(const struct lw_mesh *mesh) {
    const struct lw_vec2 *uv = mesh->uv[1];
    double area = 0;
    if (!uv) return 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        struct lw_vec2 c[3];
        for (int k = 0; k < 3; k++) {
            c[k] = uv[mesh->triangle[t][k]];
            if (!(c[k].x >= 0 && c[k].x <= 1 && c[k].y >= 0 && c[k].y <= 1)) return 0;
        }
        double twice = fabs(((double)c[1].x - (double)c[0].x) * ((double)c[2].y - (double)c[0].y) -
                            ((double)c[2].x - (double)c[0].x) * ((double)c[1].y - (double)c[0].y));
        if (!(twice > 1e-12)) return 0;
        area += twice / 2;
    }
    return area <= 1 + UV_AREA_NOISE ? area : 0; /* more: to lay out each takes triangles times texels */
}

static struct lw_lightmap_map map_of(const struct job *job) {
    return (struct lw_lightmap_map){
        .mesh = job->mesh,
        .triangle = job->from_file ? job->mesh->triangle : (const uint32_t(*)[3])job->charts.corner,
        .uv = job->uv,
        .uv_count = job->from_file ? job->mesh->vertex_count : job->charts.point_count,
        .width = job->width,
        .height = job->height,
    };
}

/* Takes UV set 1 if it is fit at this density; from_file tells. */
static enum lw_status try_file(const struct drive *drive, struct job *job, double scale) {
    const struct lw_mesh *mesh = job->mesh;
    double uv_area = file_uv_area(mesh);
    job->from_file = false;
    if (!(uv_area > 0 && job->area_os > 0)) return LW_OK;
    double wanted = sqrt(job->area_os / uv_area) * scale; /* side in texels */
    uint32_t limit = height_max(drive, job), side = limit;
    if (wanted < (double)limit) side = (uint32_t)ceil(wanted / LW_LIGHTMAP_BLOCK) * LW_LIGHTMAP_BLOCK;
    if (side < ATLAS_SIDE_MIN) side = ATLAS_SIDE_MIN;
    job->uv = malloc(((size_t)mesh->vertex_count + 1) * sizeof *job->uv);
    if (!job->uv) return LW_NO_MEMORY;
    for (uint32_t v = 0; v < mesh->vertex_count; v++)
        job->uv[v] = (struct lw_vec2){mesh->uv[1][v].x * (float)side, mesh->uv[1][v].y * (float)side};
    job->width = job->height = side;
    job->from_file = true;
    job->scale = sqrt(uv_area / job->area_os) * (double)side;
    job->capped = wanted > (double)limit;
    uint64_t overlaps;
    struct lw_lightmap_map map = map_of(job);
    enum lw_status status = lw_lightmap_check_overlaps(&map, &overlaps);
    if (status == LW_OK && overlaps == 0) return LW_OK;
    job->from_file = job->capped = false;
    free(job->uv);
    job->uv = NULL;
    return status;
}

static enum lw_status unwrap(const struct drive *drive, struct job *job, double scale) {
    if (job->unwrapped) return LW_OK;
    /* no denser than any atlas can be: charts are grown and merged for the texels they will have */
    double most = (double)drive->side_max / sqrt(job->area_os > 0 ? job->area_os : 1);
    job->charts_scale = scale < most ? scale : most;
    enum lw_status status = lw_lightmap_chart_build(&job->charts, job->mesh, job->charts_scale);
    if (status == LW_OK) status = lw_lightmap_pack_init(&job->layout, &job->charts, job->mesh);
    job->unwrapped = status == LW_OK;
    return status;
}

/* Packs at the scale, or at the largest that fits. */
static enum lw_status pack(const struct drive *drive, struct job *job, double scale) {
    uint32_t width = drive->side_max, height = height_max(drive, job);
    double wanted = scale / job->charts_scale, low = wanted, high = wanted;
    bool fits = false;
    enum lw_status status = lw_lightmap_pack(&job->layout, (float)wanted, width, height, &fits);
    job->capped = !fits;
    for (int i = 0; status == LW_OK && !fits && i < HALVINGS_MAX; i++) {
        high = low;
        low /= 2;
        status = lw_lightmap_pack(&job->layout, (float)low, width, height, &fits);
    }
    if (status == LW_OK && !fits)
        return lw_status_fail(
            &job->error, LW_BAD_DATA,
            "mesh %u (%s): its %u charts do not fit an atlas of %u x %u texels at any density; "
            "allow larger atlases (--atlas-max) or split the mesh",
            job->mesh_index, job->mesh->name ? job->mesh->name : "", job->charts.chart_count, width, height);
    for (int i = 0; status == LW_OK && job->capped && i < FIT_STEPS; i++) {
        double middle = sqrt(low * high);
        status = lw_lightmap_pack(&job->layout, (float)middle, width, height, &fits);
        if (fits)
            low = middle;
        else
            high = middle;
    }
    if (status == LW_OK && job->capped)
        status = lw_lightmap_pack(&job->layout, (float)low, width, height, &fits);
    job->scale = low * job->charts_scale;
    return status;
}

static enum lw_status place_points(struct job *job) {
    job->uv = malloc(((size_t)job->charts.point_count + 1) * sizeof *job->uv);
    if (!job->uv) return LW_NO_MEMORY;
    job->width = job->layout.width;
    job->height = job->layout.height;
    float middle = (float)LW_LIGHTMAP_BLOCK + 0.5f;
    for (uint32_t t = 0; t < job->charts.triangle_count; t++)
        for (int k = 0; k < 3; k++) {
            uint32_t chart = job->charts.chart[t], p = job->charts.corner[t][k];
            job->uv[p] = chart == LW_SCENE_NONE
                             ? (struct lw_vec2){middle, middle}
                             : lw_lightmap_slot_place(&job->layout.slot[chart], job->charts.point[p]);
        }
    return LW_OK;
}

/* Lays one mesh out at a density. */
static enum lw_status lay_out(const struct drive *drive, struct job *job, double texels_per_metre) {
    double scale =
        fmin(texels_per_metre * job->relative, drive->density_max) * job->asked * job->metres_per_unit;
    free(job->uv);
    job->uv = NULL;
    enum lw_status status = try_file(drive, job, scale);
    if (status == LW_OK && !job->from_file) {
        status = unwrap(drive, job, scale);
        if (status == LW_OK) status = pack(drive, job, scale);
        if (status == LW_OK) status = place_points(job);
    }
    struct lw_lightmap_map map = map_of(job);
    if (status == LW_OK) status = lw_lightmap_check_coverage(&map, job->back, &job->covered);
    return status;
}

static enum lw_status lay_out_all(struct drive *drive, double texels_per_metre, struct lw_progress *progress,
                                  struct lw_error *err) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(drive->threads)
    for (uint32_t i = 0; i < drive->job_count; i++) {
        struct job *job = &drive->job[i];
        job->status = lay_out(drive, job, texels_per_metre);
        lw_progress_step(progress, job->mesh->triangle_count);
    }
    for (uint32_t i = 0; i < drive->job_count; i++) { /* the first in order, whichever thread met it first */
        struct job *job = &drive->job[i];
        if (job->status == LW_OK) continue;
        return lw_status_fail(err, job->status, "%s",
                              job->error.status ? job->error.text : "out of memory for lightmap UVs");
    }
    return LW_OK;
}

/* The surface, m^2, that has one object's texels at the scene's density; with its backs. */
static double surface(const struct job *job) {
    const double side = job->metres_per_unit * job->asked;
    return job->area_os * side * side * (job->has_back ? 2 : 1);
}

static double total_surface(const struct drive *drive) {
    double sum = 0;
    for (uint32_t i = 0; i < drive->job_count; i++)
        sum += surface(&drive->job[i]) * (double)drive->job[i].object_count;
    return sum;
}

static double total_texels(const struct drive *drive) {
    double sum = 0;
    for (uint32_t i = 0; i < drive->job_count; i++)
        sum += (double)drive->job[i].covered * (double)drive->job[i].object_count;
    return sum;
}

/* The default bound of texels. Every chart takes a few texels at any density: with a room's bound, a scene of
 * millions of triangles would spend all texels on slivers, at metres a texel. */
static double default_most(const struct drive *drive) {
    double triangles = 0;
    for (uint32_t i = 0; i < drive->job_count; i++)
        triangles += (double)drive->job[i].mesh->triangle_count * (double)drive->job[i].object_count;
    return fmax((double)LW_LIGHTMAP_TEXELS_MAX, 0.5 * triangles);
}

static double clamp_density(double density) {
    return density < (double)FLT_MIN ? (double)FLT_MIN : density > 1e9 ? 1e9 : density;
}

static enum lw_status find_edges(struct drive *drive) {
    enum lw_status status = LW_OK;
#pragma omp parallel for schedule(dynamic, 1) num_threads(drive->threads)
    for (uint32_t i = 0; i < drive->job_count; i++) {
        const enum lw_status failed = lw_lightmap_things_edges(drive->job[i].mesh, &drive->job[i].edges_os);
        if (failed)
#pragma omp atomic write
            status = failed;
    }
    return status;
}

/* The mean size of things, m: twice the area by the edges. An object that is larger than all others together,
 * such as a ground to the horizon, counts as one of their size. 0: no edges. */
static double size_of_things(const struct drive *drive) {
    double area = 0, edges = 0, largest = 0, its_edges = 0;
    for (uint32_t i = 0; i < drive->job_count; i++) {
        const struct job *job = &drive->job[i];
        const double side = job->metres_per_unit, one = job->area_os * side * side;
        area += one * (double)job->object_count;
        edges += job->edges_os * side * (double)job->object_count;
        if (one > largest) largest = one, its_edges = job->edges_os * side;
    }
    const double others = area - largest;
    if (largest > others && others > 0) {
        area = 2 * others;
        edges -= its_edges * (1 - others / largest);
    }
    return edges > 0 ? 2 * area / edges : 0;
}

/* The wanted density where none is asked for, texels per metre. Edges are measured where they can matter. */
static enum lw_status default_density(struct drive *drive, double *out_density) {
    const double area = total_surface(drive), most = drive->texels_max;
    *out_density = LW_LIGHTMAP_DENSITY_DEFAULT;
    if (!(area > 0)) return LW_OK;
    *out_density = fmax(*out_density, sqrt(fmin((double)LW_LIGHTMAP_TEXELS_MIN, most) / area));
    const double affordable = sqrt(fmin((double)LW_LIGHTMAP_TEXELS_FINE, most) / area);
    if (affordable <= *out_density) return LW_OK;
    const enum lw_status status = find_edges(drive);
    const double things = size_of_things(drive);
    if (status == LW_OK && things > 0)
        *out_density = fmax(*out_density, fmin(LW_LIGHTMAP_ACROSS / things, affordable));
    return status;
}

/* The wanted density, and its bound. */
static enum lw_status choose_density(struct drive *drive, const struct lw_lightmap_desc *desc,
                                     struct lw_error *err) {
    const bool given = desc->texels_per_metre > 0;
    double density = (double)desc->texels_per_metre;
    enum lw_status status = LW_OK;
    drive->texels_max = desc->texels_max ? (double)desc->texels_max
                        : given          ? (double)INFINITY
                                         : default_most(drive);
    if (!given) status = default_density(drive, &density);
    drive->density_max = clamp_density(density);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "out of memory for lightmap UVs");
}

/* Before anything is laid out: charts cover about as many texels as surfaces have, and more at their
 * borders. */
static bool is_too_much(const struct drive *drive) {
    return total_surface(drive) * drive->density_max * drive->density_max > drive->texels_max;
}

/* Texels of all objects at a density, none with more than `most`. */
static double estimate(const struct drive *drive, double density, double most) {
    double sum = 0;
    for (uint32_t i = 0; i < drive->job_count; i++)
        sum += fmin(surface(&drive->job[i]) * density * density, most) * (double)drive->job[i].object_count;
    return sum;
}

/* Densities relative to `even`, which would give every metre the same. Where one object (the ground to the
 * horizon) would take more than SHARE_MAX of the texels, it gets that share. The others get what it leaves,
 * up to the density that was asked for. What they cannot use goes back to it. */
static void share_texels(struct drive *drive, double even) {
    double density = drive->density_max, target = drive->texels_max, most = SHARE_MAX * target;
    const bool useful = estimate(drive, density, most) >= target;
    double low = useful ? even : most, high = useful ? density : target;
    for (int i = 0; i < 60; i++) {
        double middle = 0.5 * (low + high);
        double texels = useful ? estimate(drive, middle, most) : estimate(drive, density, middle);
        if (texels < target)
            low = middle;
        else
            high = middle;
    }
    if (useful)
        density = high;
    else
        most = high;
    for (uint32_t i = 0; i < drive->job_count; i++) {
        double area = surface(&drive->job[i]);
        drive->job[i].relative = (area > 0 ? fmin(density, sqrt(most / area)) : density) / even;
    }
}

/* The density at which the scene has texels_max texels, found by laying out and counting. */
static enum lw_status lay_out_bounded(struct drive *drive, struct lw_progress *progress,
                                      struct lw_error *err) {
    double area = total_surface(drive), target = drive->texels_max;
    double density = fmin(clamp_density(area > 0 ? sqrt(target / area) : 1), drive->density_max);
    enum lw_status status = LW_OK;
    share_texels(drive, density);
    for (int round = 0; status == LW_OK; round++) {
        status = lay_out_all(drive, density, progress, err);
        double texels = status == LW_OK ? total_texels(drive) : 0;
        if (round + 1 == DENSITY_ROUNDS || !(texels > 0) || fabs(texels / target - 1) < 0.02) break;
        density = clamp_density(density * sqrt(target / texels));
    }
    return status;
}

/* At the density that is wanted, if the texels suffice. */
static enum lw_status lay_out_scene(struct drive *drive, struct lw_progress *progress, struct lw_error *err) {
    if (!is_too_much(drive)) {
        enum lw_status status = lay_out_all(drive, drive->density_max, progress, err);
        if (status != LW_OK || total_texels(drive) <= drive->texels_max) return status;
    }
    return lay_out_bounded(drive, progress, err);
}

/* New vertices: one for each pair of an old vertex and a place in the atlas. */
struct split {
    uint32_t count;
    uint32_t *vertex, *point; /* per new vertex */
    uint32_t *slot;           /* hash table of new vertices; LW_SCENE_NONE: free */
    size_t slots;             /* a power of two */
    uint32_t (*triangle)[3];
};

static void free_split(struct split *split) {
    free(split->vertex);
    free(split->point);
    free(split->slot);
}

static uint32_t split_vertex(struct split *split, uint32_t vertex, uint32_t point) {
    uint64_t h = ((uint64_t)vertex << 32 | point) * 0x9e3779b97f4a7c15u;
    size_t at = (h ^ h >> 32) & (split->slots - 1);
    for (; split->slot[at] != LW_SCENE_NONE; at = (at + 1) & (split->slots - 1)) {
        const uint32_t n = split->slot[at];
        if (split->vertex[n] == vertex && split->point[n] == point) return n;
    }
    const uint32_t n = split->slot[at] = split->count++;
    split->vertex[n] = vertex;
    split->point[n] = point;
    return n;
}

static void *copied(struct lw_scene *scene, const struct split *split, const void *array, size_t size) {
    char *to = lw_scene_alloc(scene, split->count, size);
    for (uint32_t n = 0; to && n < split->count; n++)
        memcpy(to + n * size, (const char *)array + split->vertex[n] * size, size);
    return to;
}

static enum lw_status replace_arrays(struct lw_scene *scene, struct lw_mesh *mesh, const struct split *split,
                                     const struct lw_vec2 *uv) {
    struct lw_mesh now = *mesh;
    struct lw_vec2 *lightmap_uv = lw_scene_alloc(scene, split->count, sizeof *lightmap_uv);
    now.position = copied(scene, split, mesh->position, sizeof *mesh->position);
    now.normal = copied(scene, split, mesh->normal, sizeof *mesh->normal);
    bool ready = lightmap_uv && now.position && now.normal;
    for (int set = 0; set < 2; set++)
        if (mesh->uv[set])
            ready = ready && (now.uv[set] = copied(scene, split, mesh->uv[set], sizeof **mesh->uv));
    if (mesh->colour)
        ready = ready && (now.colour = copied(scene, split, mesh->colour, sizeof *mesh->colour));
    if (!ready) return LW_NO_MEMORY;
    for (uint32_t n = 0; n < split->count; n++) lightmap_uv[n] = uv[split->point[n]];
    now.lightmap_uv = lightmap_uv;
    now.triangle = (const uint32_t(*)[3])split->triangle;
    now.vertex_count = split->count;
    *mesh = now;
    return LW_OK;
}

static enum lw_status split_charts(struct lw_scene *scene, struct lw_mesh *mesh, const struct job *job) {
    size_t corners = (size_t)mesh->triangle_count * 3, slots = 16;
    while (slots < 2 * corners) slots *= 2;
    struct split split = {
        .slots = slots,
        .vertex = malloc((corners + 1) * sizeof *split.vertex),
        .point = malloc((corners + 1) * sizeof *split.point),
        .slot = malloc(slots * sizeof *split.slot),
        .triangle = lw_scene_alloc(scene, mesh->triangle_count, sizeof *split.triangle),
    };
    enum lw_status status = LW_NO_MEMORY;
    if (split.vertex && split.point && split.slot && split.triangle) {
        memset(split.slot, 0xff, slots * sizeof *split.slot);
        for (uint32_t c = 0; c < corners; c++)
            split.triangle[c / 3][c % 3] =
                split_vertex(&split, mesh->triangle[c / 3][c % 3], job->charts.corner[c / 3][c % 3]);
        status = replace_arrays(scene, mesh, &split, job->uv);
    }
    free_split(&split);
    return status;
}

static enum lw_status keep_file(struct lw_scene *scene, struct lw_mesh *mesh, const struct job *job) {
    struct lw_vec2 *uv = lw_scene_alloc(scene, mesh->vertex_count, sizeof *uv);
    if (!uv) return LW_NO_MEMORY;
    memcpy(uv, job->uv, mesh->vertex_count * sizeof *uv);
    mesh->lightmap_uv = uv;
    return LW_OK;
}

static void report(const struct drive *drive, const struct job *job, struct lw_lightmap_report *out) {
    const struct lw_mesh *mesh = job->mesh;
    struct lw_lightmap_map map = map_of(job);
    const double reached = job->scale / job->metres_per_unit;
    *out = (struct lw_lightmap_report){
        .mesh = job->mesh_index,
        .atlas_width = mesh->atlas_width,
        .atlas_height = mesh->atlas_height,
        .chart_count = job->from_file ? 0 : job->charts.chart_count,
        .texels_covered = (uint32_t)job->covered,
        .coverage = (float)((double)job->covered / ((double)mesh->atlas_width * (double)mesh->atlas_height)),
        .texels_per_metre = (float)reached,
        .from_file = job->from_file,
        .capped = job->capped,
        .bounded = !job->capped && reached < BOUNDED_UNDER * drive->density_max * job->asked,
        .density_wanted = (float)(drive->density_max * job->asked),
        .texels_max = isfinite(drive->texels_max) ? (uint32_t)drive->texels_max : 0,
    };
    lw_lightmap_check_stretch(&map, &out->stretch_rms, &out->stretch_max);
}

static enum lw_status commit(struct drive *drive, struct lw_lightmap_report *out_report,
                             struct lw_error *err) {
    for (uint32_t i = 0; i < drive->job_count; i++) {
        struct job *job = &drive->job[i];
        struct lw_mesh *mesh = &drive->scene->mesh[job->mesh_index], before = *mesh;
        enum lw_status status =
            job->from_file ? keep_file(drive->scene, mesh, job) : split_charts(drive->scene, mesh, job);
        if (status != LW_OK) return lw_status_fail(err, status, "out of memory for lightmap UVs");
        mesh->atlas_width = job->width;
        mesh->back_offset = job->has_back ? job->height : 0;
        mesh->atlas_height = job->has_back ? job->height * 2 : job->height;
        if (!out_report) continue;
        /* the maps index the mesh as it was */
        before.atlas_width = mesh->atlas_width;
        before.atlas_height = mesh->atlas_height;
        job->mesh = &before;
        report(drive, job, &out_report[job->mesh_index]);
    }
    return LW_OK;
}

static enum lw_status read_densities(struct drive *drive, const char *density_of, struct lw_error *err) {
    float *factor = malloc((drive->scene->mesh_count + 1ul) * sizeof *factor);
    if (!factor) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for lightmap UVs");
    enum lw_status status = lw_lightmap_density_read(density_of, drive->scene, factor, err);
    for (uint32_t i = 0; i < drive->job_count && status == LW_OK; i++)
        drive->job[i].asked = (double)factor[drive->job[i].mesh_index];
    free(factor);
    return status;
}

enum lw_status lw_lightmap_build(struct lw_scene *scene, const struct lw_lightmap_desc *desc,
                                 struct lw_lightmap_report *out_report, struct lw_error *err) {
    uint32_t side = desc->atlas_side_max ? desc->atlas_side_max : LW_LIGHTMAP_SIDE_DEFAULT;
    if (side > LW_SCENE_ATLAS_SIDE_MAX) side = LW_SCENE_ATLAS_SIDE_MAX;
    struct drive drive = {.scene = scene,
                          .side_max = side / LW_LIGHTMAP_BLOCK * LW_LIGHTMAP_BLOCK,
                          .threads = desc->threads ? (int)desc->threads : omp_get_max_threads()};
    uint64_t triangles = 0;
    struct lw_progress progress;
    enum lw_status status = find_jobs(&drive);
    if (status != LW_OK)
        lw_status_fail(err, status, "out of memory for lightmap UVs");
    else
        status = read_densities(&drive, desc->density_of, err);
    for (uint32_t i = 0; i < drive.job_count; i++) triangles += drive.job[i].mesh->triangle_count;
    for (uint32_t m = 0; out_report && m < scene->mesh_count; m++)
        out_report[m] = (struct lw_lightmap_report){.mesh = m};
    if (status == LW_OK) status = choose_density(&drive, desc, err);
    lw_progress_init(&progress, "unwrapping", triangles * (is_too_much(&drive) ? DENSITY_ROUNDS : 1));
    if (status == LW_OK) status = lay_out_scene(&drive, &progress, err);
    lw_progress_finish(&progress);
    if (status == LW_OK) status = commit(&drive, out_report, err);
    for (uint32_t i = 0; i < drive.job_count; i++) finish_job(&drive.job[i]);
    free(drive.job);
    return status;
}

static struct lw_lightmap_map finished(const struct lw_mesh *mesh) {
    return (struct lw_lightmap_map){.mesh = mesh,
                                    .triangle = mesh->triangle,
                                    .uv = mesh->lightmap_uv,
                                    .uv_count = mesh->vertex_count,
                                    .width = mesh->atlas_width,
                                    .height = mesh->back_offset ? mesh->back_offset : mesh->atlas_height};
}

enum lw_status lw_lightmap_coarsest(const struct lw_mesh *mesh, uint8_t *out_level) {
    struct lw_lightmap_map map = finished(mesh);
    return lw_lightmap_check_coarsest(&map, out_level);
}

uint64_t lw_lightmap_overlaps(const struct lw_mesh *mesh) {
    struct lw_lightmap_map map = finished(mesh);
    uint64_t count;
    /* without memory to look, nothing can be vouched for */
    return lw_lightmap_check_overlaps(&map, &count) == LW_OK ? count : UINT64_MAX;
}

uint64_t lw_lightmap_mixed(const struct lw_mesh *mesh) {
    struct lw_lightmap_map map = finished(mesh);
    uint64_t count;
    return lw_lightmap_check_mixed(&map, &count) == LW_OK ? count : UINT64_MAX;
}
