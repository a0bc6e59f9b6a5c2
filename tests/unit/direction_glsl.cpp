#include "tests/unit/direction_glsl.h"

#include "tests/support/glsl.hpp"

namespace {

using namespace glsl;

#define float double
#include "direction_web.glsl"

double of_document(vec3 r, vec3 n, vec3 m) {
    vec3 irradiance(1);
#include "direction_document.glsl"
    return irradiance.x;
}
#undef float

vec3 vector(const float from[3]) {
    return {static_cast<double>(from[0]), static_cast<double>(from[1]), static_cast<double>(from[2])};
}

} // namespace

double lw_direction_glsl_of_document(const float r[3], const float n[3], const float m[3]) {
    return of_document(vector(r), vector(n), vector(m));
}

void lw_direction_glsl_of_web(const float r[3], const float n[3], const float m[3], const float ahead[3],
                              float alpha, double out_by[2]) {
    const vec2 by = directed(vector(r), vector(n), vector(m), vector(ahead), static_cast<double>(alpha));
    out_by[0] = by.x, out_by[1] = by.y;
}

void lw_direction_glsl_from_texel(const float texel[3], double out_r[3]) {
    const vec3 r = fromTexel(vector(texel));
    out_r[0] = r.x, out_r[1] = r.y, out_r[2] = r.z;
}
