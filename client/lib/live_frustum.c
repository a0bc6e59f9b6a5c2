#include "client/lib/live_frustum.h"

struct lw_live_linear lw_live_frustum_row(const struct lw_live_view *view, int r,
                                          const struct lw_affine *to_world) {
    const float *m = view->view_projection;
    float row[4];
    for (int c = 0; c < 4; c++)
        row[c] = m[r] * to_world->m[0][c] + m[4 + r] * to_world->m[1][c] + m[8 + r] * to_world->m[2][c];
    return (struct lw_live_linear){lw_vec3(row[0], row[1], row[2]), row[3] + m[12 + r]};
}

struct lw_live_frustum lw_live_frustum_of(const struct lw_live_view *view, const struct lw_affine *to_world) {
    const struct lw_live_linear x = lw_live_frustum_row(view, 0, to_world),
                                y = lw_live_frustum_row(view, 1, to_world),
                                w = lw_live_frustum_row(view, 3, to_world);
    const float wide = 1 + LW_LIVE_FRUSTUM_AROUND, *m = view->view_projection;
    struct lw_live_frustum f = {.depth = w};
    for (int i = 0; i < 4; i++) {
        const struct lw_live_linear *edge = i < 2 ? &x : &y;
        const float sign = i & 1 ? -1.0f : 1.0f;
        f.side[i] = (struct lw_live_linear){lw_vec3_mad(lw_vec3_scale(w.n, wide), edge->n, sign),
                                            wide * w.d + sign * edge->d};
    }
    const float scale = cbrtf(fabsf(lw_affine_determinant(to_world)));
    const float per_m =
        lw_vec3_length(lw_vec3(m[1], m[5], m[9])) * (float)view->height / 2; /* pixels, at depth 1 */
    f.pixel_m = per_m > 0 && scale > 0 ? 1 / (per_m * scale) : 0;
    return f;
}

static float reach(const struct lw_live_linear *l, const struct lw_live_box *box) {
    return fabsf(l->n.x) * box->half.x + fabsf(l->n.y) * box->half.y + fabsf(l->n.z) * box->half.z;
}

bool lw_live_frustum_meets(const struct lw_live_frustum *f, const struct lw_live_box *box, float *out_depth) {
    if (box->half.x < 0) return false;
    for (int i = 0; i < 4; i++)
        if (lw_vec3_dot(f->side[i].n, box->middle) + f->side[i].d + reach(&f->side[i], box) < 0) return false;
    const float depth = lw_vec3_dot(f->depth.n, box->middle) + f->depth.d, around = reach(&f->depth, box);
    *out_depth = depth - around;
    return depth + around > 0;
}
