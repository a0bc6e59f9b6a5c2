// finish_shaders.ts: how what is smooth or uneven shines: common/shading/lobes.h in the form that all clients
// share; and what that is read from, which the GPU computes once.
// After: Karis 2013 (the split sum), Turquin 2019 (what facets scatter many times), Walter et al. 2007.

import { DIRECTED } from './direction_shader.ts';
import { FINISH_TEXELS } from './geometry.ts';
import { HEAD } from './shader_head.ts';

/** Shares of light by angle and roughness: common/shading/lobe_table.h. */
export const LOBES_SIDE = 32;

/** Where the environment is in the same texture: left, top, width, height; as it is, and as mirrors of
 * rougher and rougher surfaces blur it, up to 1; then as matt surfaces do. An environment is laid out as
 * lw_environment, but that columns 0 and width - 1 look the same way. */
export const SKIES = [
  [0, 128, 1024, 512],
  [512, 0, 256, 128],
  [256, 0, 128, 64],
  [128, 0, 64, 32],
  [64, 0, 32, 16],
  [96, 0, 32, 16],
  [32, 0, 32, 16],
] as const;
export const SKIES_SIZE = [1024, 640] as const;
/** Roughnesses between them are a mix of two. */
const ROUGHEST = SKIES.length - 2;

const PI = `${Math.PI}`;
/** Where a direction is in a picture of the environment. */
const PLACE_OF = `
vec2 placeOf(vec3 d) {
  float across = atan(d.z, abs(d.x) + abs(d.z) > 0.0 ? d.x : 1.0);
  return vec2(0.5 + across * ${0.5 / Math.PI}, atan(length(d.xz), d.y) * ${1 / Math.PI});
}`;

/** f of a surface as an eye sees it, and what it shows of light from everywhere. */
export const SHADING = `
uniform sampler2D smoothTable;
uniform vec3 sky; // from everywhere
uniform float skyUnit; // of the environment's texels

struct Lobes {
  vec3 diffuse, f0;
  float f90, gloss0, gloss90, roughness;
};

struct Seen {
  Lobes lobes;
  vec3 v, plain, n; // unit: to the eye; of the surface without its map, with it
  float nv, alpha, under, spread; // under: what the gloss leaves; spread: of n within a pixel, alpha^2
  float even; // what the gloss leaves of light from everywhere
  vec3 boost; // for light that facets scatter many times
  vec3 mirrored; // of light from everywhere
};

vec2 lobeShares(float cosine, float roughness) {
  vec2 place = vec2(sqrt(cosine), roughness) * ${LOBES_SIDE - 1}.0 + 0.5;
  return textureLod(smoothTable, place / vec2(textureSize(smoothTable, 0)), 0.0).rg;
}

float schlick(float cosine) {
  float x = 1.0 - clamp(cosine, 0.0, 1.0), x2 = x * x;
  return x2 * x2 * x;
}

// base, metalness and so on as common/scene/surface.c's lobes_of()
Lobes lobesOf(vec3 base, float metalness, float roughness, float specular, vec3 reflectance) {
  float metal = clamp(metalness, 0.0, 1.0), strength = clamp(specular, 0.0, 1.0);
  vec3 gloss = clamp(reflectance, 0.0, 1.0) * strength;
  return Lobes(base * (1.0 - metal), mix(gloss, base, metal), mix(strength, 1.0, metal),
    max(gloss.r, max(gloss.g, gloss.b)), strength, clamp(roughness, 0.0, 1.0));
}

// common/shading/shading_bend.h; GPUs' square roots are coarse
vec3 bentNormal(vec3 n, vec3 ng, vec3 v) {
  float seen = dot(ng, v);
  if (seen < 1e-3) ng = normalize(ng + (1e-3 - seen) * v);
  seen = max(dot(ng, v), 1e-3);
  float nv = dot(n, v), height = 2.0 * nv * dot(n, ng) - seen;
  float least = min(0.9 * seen, 0.01);
  if (nv > 0.0 && height >= least) return n;
  float lift = max(least - height, 0.0), more = lift * (2.0 * height + lift);
  // the mirrored direction, lifted, and as much of v
  vec3 between = v * (more / (1.0 + sqrt(max(1.0 + more, 0.0)))) + 2.0 * nv * n + lift * ng;
  float long2 = dot(between, between);
  return long2 > 1e-3 ? between * inversesqrt(long2) : ng;
}

// what the gloss leaves of light of which mirrors send back the shares
float leave(Lobes lobes, vec2 share) {
  float lost = 1.0 / clamp(share.x + share.y, 0.1, 1.0) - 1.0;
  return max(1.0 - (lobes.gloss0 * share.x + lobes.gloss90 * share.y) * (1.0 + lobes.gloss0 * lost), 0.0);
}

Seen see(Lobes lobes, vec3 v, vec3 plain, vec3 n) {
  Seen s;
  s.lobes = lobes;
  s.v = v;
  s.plain = plain;
  s.n = n;
#ifdef NORMAL_TEXTURE
  s.n = bentNormal(n, plain, v);
#endif
  s.spread = 0.0;
  s.nv = clamp(dot(s.n, v), 1e-4, 1.0);
  s.alpha = max(lobes.roughness * lobes.roughness, 1e-3);
  vec2 share = lobeShares(s.nv, lobes.roughness);
  float lost = 1.0 / clamp(share.x + share.y, 0.1, 1.0) - 1.0;
  s.under = leave(lobes, share);
  s.even = max(leave(lobes, lobeShares(0.47 + 0.08 * lobes.roughness, lobes.roughness)), 1e-3);
  s.boost = 1.0 + lobes.f0 * lost;
  s.mirrored = (lobes.f0 * share.x + lobes.f90 * share.y) * s.boost;
  return s;
}

float stretch(float cosine, float alpha2) { return sqrt(alpha2 + (1.0 - alpha2) * cosine * cosine); }

// f times pi; to: unit, to the light, above the surface by the cosine nl > 0. wide: radius of the lamp over
// its distance, by half of which the lobe is wider
vec3 reflected(Seen s, vec3 to, float nl, float wide) {
  vec3 h = s.v + to;
  h *= inversesqrt(max(dot(h, h), 1e-9));
  vec3 across = cross(s.n, h);
  float nh = dot(s.n, h), own = s.alpha * s.alpha, spread = s.spread * s.spread / (s.spread + own);
  float alpha2 = min(own + spread + 0.25 * wide * wide, 1.0);
  float d = dot(across, across) + alpha2 * nh * nh, near = max(nl, 1e-3);
  float visible = 0.5 / (near * stretch(s.nv, alpha2) + s.nv * stretch(near, alpha2));
  vec3 f = s.lobes.f0 + (s.lobes.f90 - s.lobes.f0) * schlick(dot(s.v, h));
  float left = leave(s.lobes, lobeShares(min(near, 1.0), s.lobes.roughness)) / s.even;
  return s.lobes.diffuse * (s.under * left) + f * s.boost * (visible * alpha2 / max(d * d, 1e-13));
}

#ifdef ENVIRONMENT
const vec4 skies[${SKIES.length}] = vec4[](${SKIES.map((place) => `vec4(${place.join()})`).join()});
${PLACE_OF}
vec3 skyOf(vec3 d, int level) {
  vec4 place = skies[level];
  vec2 at = placeOf(d);
  at = place.xy + vec2(at.x * (place.z - 1.0) + 0.5, clamp(at.y * place.w, 0.5, place.w - 0.5));
  return skyUnit * textureLod(smoothTable, at / vec2(${SKIES_SIZE.join()}), 0.0).rgb;
}
#endif

// Radiance that a surface under the irradiance e mirrors: the sky, as much of it as each colour of e
// allows, and else e from everywhere.
vec3 mirroredLight(Seen s, vec3 e) {
  vec3 open = ${PI} * sky, ahead = sky;
#ifdef ENVIRONMENT
  open += ${PI} * skyOf(s.plain, ${SKIES.length - 1});
  float level = s.lobes.roughness * ${ROUGHEST}.0, low = min(floor(level), ${ROUGHEST - 1}.0);
  vec3 d = reflect(-s.v, s.n);
  ahead += mix(skyOf(d, int(low)), skyOf(d, int(low) + 1), level - low);
#endif
  vec3 parts = e / max(open, vec3(1e-30));
  float share = open == vec3(0) ? 0.0 : min(min(parts.r, parts.g), min(parts.b, 1.0));
  return share * ahead + max(e - share * open, 0.0) / ${PI};
}

vec3 everywhere(Seen s, vec3 e, float factor, float gain) {
  return e * s.lobes.diffuse * (factor * s.under / ${PI}) + mirroredLight(s, e) * (gain * s.mirrored);
}
${DIRECTED}`;

/** A surface's own finish, where the fragment is. */
export const FINISH = `
uniform sampler2D surfaceTexture, specularTexture, occlusionTexture, normalTexture;
uniform vec4 finish[${FINISH_TEXELS}];
${SHADING}

// row: of the finish, where the rows of the transform are
vec4 sampleFinish(sampler2D image, int row) {
  vec3 uv = vec3(uvOf(finish[row].w), 1);
  return texture(image, vec2(dot(finish[row].xyz, uv), dot(finish[row + 1].xyz, uv)), sharper);
}

// Of light from everywhere, the share that arrives. s: the surface
float finishOf(vec3 base, Seen from, out Seen s, out float metalness) {
  vec4 mirror = vec4(finish[1].rgb, finish[0].z), surface = vec4(1), occlusion = surface;
#ifdef SURFACE_TEXTURE
  surface = sampleFinish(surfaceTexture, 2);
#endif
#ifdef SPECULAR_TEXTURE
  mirror *= sampleFinish(specularTexture, 4);
#endif
#ifdef OCCLUSION_IN_SURFACE
  occlusion = surface;
#endif
#ifdef OCCLUSION_TEXTURE
  occlusion = sampleFinish(occlusionTexture, 6);
#endif
  vec3 n = from.plain;
#ifdef NORMAL_TEXTURE
  vec3 front = gl_FrontFacing ? n : -n, t = vTangent.xyz - front * dot(front, vTangent.xyz);
  float long2 = dot(t, t);
  if (long2 > 1e-12 * dot(vTangent.xyz, vTangent.xyz)) {
    vec2 xy = sampleFinish(normalTexture, 8).xy * 2.0 - 1.0;
    float z = sqrt(max(1.0 - dot(xy, xy), 1e-4));
    xy *= finish[9].w;
    t *= inversesqrt(long2);
    n = normalize(front * z + t * xy.x + cross(front, t) * (vTangent.w < 0.0 ? -xy.y : xy.y));
    if (!gl_FrontFacing) n = -n;
  }
#endif
  metalness = finish[0].x * surface.b;
  s = see(lobesOf(base, metalness, finish[0].y * surface.g, mirror.a, finish[0].w * mirror.rgb),
    from.v, from.plain, n);
#ifdef DIRECT
  vec3 across = dFdx(s.n), down = dFdy(s.n);
  s.spread = min(0.5 * (dot(across, across) + dot(down, down)), 0.18);
#endif
  return 1.0 + finish[1].w * (occlusion.r - 1.0);
}
`;

const SAMPLES = `
uniform uint count;
out vec4 value;
// even over the unit square, as a lattice
vec2 sampleAt(uint i) {
  return vec2((float(i) + 0.5) / float(count), fract(float(i) * 0.61803399 + 0.5));
}
`;

/** common/shading/lobe_table.c: visible normals by caps (Dupuy and Benyoub 2023). */
export const LOBES = `${HEAD}
${SAMPLES}
float stretch(float cosine, float alpha2) { return sqrt(alpha2 + (1.0 - alpha2) * cosine * cosine); }
void main() {
  vec2 at = floor(gl_FragCoord.xy) / ${LOBES_SIDE - 1}.0;
  float cosine = max(at.x * at.x, 1e-4), alpha = max(at.y * at.y, 1e-3), alpha2 = alpha * alpha;
  vec3 v = vec3(sqrt(1.0 - cosine * cosine), 0, cosine), wide = normalize(vec3(alpha, alpha, 1) * v);
  value = vec4(0);
  for (uint i = 0u; i < count; i++) {
    vec2 u = sampleAt(i);
    float z = (1.0 - u.x) * (1.0 + wide.z) - wide.z, phi = 2.0 * ${PI} * u.y;
    vec3 cap = vec3(sqrt(max(1.0 - z * z, 0.0)) * vec2(cos(phi), sin(phi)), z) + wide;
    vec3 h = normalize(vec3(alpha * cap.xy, max(cap.z, 0.0)));
    float vh = dot(v, h), light = 2.0 * vh * h.z - v.z, x = 1.0 - clamp(vh, 0.0, 1.0), c = x * x * x * x * x;
    if (!(light > 0.0)) continue;
    float eye = stretch(cosine, alpha2);
    float seen = light * (eye + cosine) / (light * eye + cosine * stretch(light, alpha2));
    value.rg += vec2(1.0 - c, c) * seen;
  }
  value /= float(count);
}`;

/** The environment with fewer texels, as one that has mip levels. */
export const SHRINK = `${HEAD}
in vec2 vScreen;
uniform sampler2D environment;
uniform int count; // of texels to a side of each
out vec4 value;
void main() {
  vec2 pixel = fwidth(vScreen) * 0.5;
  value = vec4(0, 0, 0, 1);
  for (int i = 0; i < count * count; i++) {
    vec2 off = (vec2(i % count, i / count) + 0.5) / float(count) - 0.5;
    value.rgb += textureLod(environment, vScreen * 0.5 + 0.5 + off * pixel, 0.0).rgb;
  }
  value.rgb /= float(count * count);
}`;

/** The environment as a surface mirrors it that is seen from straight above; alpha 0: as it is, above 1: as a
 * matt one has it. Each reading is as wide as its share of directions (Krivanek and Colbert 2008). */
export const BLUR = `${HEAD}
${SAMPLES}
uniform sampler2D environment; // with mip levels
uniform vec4 place;
uniform float alpha;
${PLACE_OF}
vec3 read(vec3 d, float level) {
  return textureLod(environment, placeOf(d), level).rgb;
}
void main() {
  vec2 at = (gl_FragCoord.xy - place.xy - vec2(0.5, 0)) / (place.zw - vec2(1, 0));
  float phi = (at.x - 0.5) * 2.0 * ${PI}, down = at.y * ${PI};
  vec3 n = vec3(sin(down) * cos(phi), cos(down), sin(down) * sin(phi));
  value = vec4(read(n, 0.0), 1);
  if (alpha == 0.0) return;
  vec3 t = normalize(cross(n, abs(n.y) < 0.9 ? vec3(0, 1, 0) : vec3(1, 0, 0))), b = cross(n, t);
  vec2 size = vec2(textureSize(environment, 0));
  vec4 sum = vec4(0);
  for (uint i = 0u; i < count; i++) {
    vec2 u = sampleAt(i);
    float a2 = alpha * alpha, z = sqrt(1.0 - u.x), density = z;
    if (alpha <= 1.0) {
      float hz2 = (1.0 - u.x) / (1.0 + (a2 - 1.0) * u.x), d = 1.0 + (a2 - 1.0) * hz2;
      density = a2 / (4.0 * d * d);
      z = 2.0 * hz2 - 1.0;
    }
    float weight = alpha > 1.0 ? 1.0 : z;
    if (!(weight > 0.0)) continue;
    float around = 2.0 * ${PI} * u.y, flat1 = sqrt(max(1.0 - z * z, 0.0));
    vec3 to = n * z + flat1 * (cos(around) * t + sin(around) * b);
    // directions to a reading, in those of a texel
    float texels = size.x * size.y / (float(count) * max(density, 1e-6) * 4.0);
    sum += weight * vec4(read(to, max(0.5 * log2(texels) + 1.0, 0.0)), 1);
  }
  value = vec4(sum.rgb / max(sum.a, 1e-6), 1);
}`;
