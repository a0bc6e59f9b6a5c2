// shaders.ts: what the GPU runs. Shading is client/view/compose/compose_hits.c's: albedo / pi * E + emission.
// E is from the level whose texels are as large as pixels, or from the one that is read in its place.

import { SHARE_WHOLE, SLOT_BITS } from './finer.ts';
import { FINISH } from './finish_shaders.ts';
import { MATERIAL_TEXELS, SMALL } from './geometry.ts';
import { HEAD } from './shader_head.ts';
import { CASCADES, LAMP_SIDE, LIGHTS_MAX, SUN_SIDE } from './limits.ts';

/** Where vertex arrays go. */
export const Attribute = {
  POSITION: 0,
  LIGHTMAP: 1,
  UV0: 2,
  UV1: 3,
  COLOUR: 4,
  TAG: 5,
  OBJECT: 6,
  NORMAL: 7,
  TANGENT: 8,
} as const;
/** Texels of the table of objects: three rows of a transform; first level, levels, back offset, first tile of
 * finer levels. */
export const OBJECT_TEXELS = 4;

export const SURFACE_VERTEX = `${HEAD}
layout(location = ${Attribute.POSITION}) in vec3 position;
layout(location = ${Attribute.LIGHTMAP}) in vec2 lightmap;
layout(location = ${Attribute.UV0}) in vec2 uv0;
layout(location = ${Attribute.UV1}) in vec2 uv1;
layout(location = ${Attribute.COLOUR}) in vec4 colour;
layout(location = ${Attribute.TAG}) in uint tag;
layout(location = ${Attribute.OBJECT}) in uint object;
layout(location = ${Attribute.NORMAL}) in vec3 normal;
layout(location = ${Attribute.TANGENT}) in vec4 tangent;
uniform sampler2D objects;
uniform mat4 clip;
uniform vec3 eye, right, up, forward;
uniform vec2 scale, offset;
uniform float near, parallel; // parallel: of an orthographic view, one over its depth; else 0
invariant gl_Position; // depth alone and the picture are of different programs
out vec3 vAt; // from the eye
#ifndef ONE_UV
out vec4 vUv;
#else
out vec2 vUv;
#endif
#ifndef WHITE
out vec4 vColour;
#endif
out vec2 vLightmap;
centroid out vec2 vLightmapIn; // within the triangle, at every sample
flat out uint vTag;
flat out uint vObject;
#ifdef NORMALS
out vec3 vNormal;
#endif
#ifdef NORMAL_TEXTURE
out vec4 vTangent;
#endif
void main() {
  vec4 p = vec4(position, 1), row[3];
  for (uint i = 0u; i < 3u; i++) row[i] = texelFetch(objects, at(${OBJECT_TEXELS}u * object + i), 0);
  vAt = vec3(dot(row[0], p), dot(row[1], p), dot(row[2], p)) - eye;
#ifdef NORMALS
  // by cofactors, outward under mirroring
  vec3 xy = cross(row[0].xyz, row[1].xyz), yz = cross(row[1].xyz, row[2].xyz);
  vec3 zx = cross(row[2].xyz, row[0].xyz);
  vNormal = vec3(dot(yz, normal), dot(zx, normal), dot(xy, normal)) * sign(dot(yz, row[0].xyz));
#endif
#ifdef NORMAL_TEXTURE
  for (int k = 0; k < 3; k++) vTangent[k] = dot(row[k].xyz, tangent.xyz);
  vTangent.w = tangent.w * sign(dot(yz, row[0].xyz)); // a mirrored object turns the map's y around
#endif
#ifndef ONE_UV
  vUv = vec4(uv0, uv1);
#else
  vUv = uv0;
#endif
#ifndef WHITE
  vColour = colour;
#endif
  vLightmap = lightmap;
  vLightmapIn = lightmap;
  vTag = tag;
  vObject = object;
#ifdef SHADOW
  gl_Position = clip * vec4(vAt, 1);
#else
  float depth = dot(vAt, forward);
#ifdef REVERSED
  gl_Position = vec4(dot(vAt, right) * scale.x, dot(vAt, up) * scale.y, near, depth);
#else
  gl_Position = vec4(dot(vAt, right) * scale.x, dot(vAt, up) * scale.y, depth - 2.0 * near, depth);
#endif
  if (parallel > 0.0) {
#ifdef REVERSED
    gl_Position.zw = vec2(1.0 - depth * parallel, 1);
#else
    gl_Position.zw = vec2(2.0 * depth * parallel - 1.0, 1);
#endif
  }
  gl_Position.xy -= offset * gl_Position.w;
#endif
}`;

// The direct light of the lights that the page draws: client/gl/gl_shaders.c's direct().
const DIRECT = `
#define SOUGHT 8
#define TAPS 16
uniform sampler2D lights, shapes;
uniform sampler2DArray sunMaps, lampMaps;
uniform int light[${LIGHTS_MAX}], lightCount;
uniform float pictureNumber, faint;
uniform vec2 tap[TAPS]; // on the unit disc

// what of a depth is near / distance
#ifdef REVERSED
float nearness(float d) { return d; }
#else
float nearness(float d) { return 1.0 - d; }
#endif

// from pixel to pixel, and from picture to picture
mat2 turnOf(vec2 at) {
  at += vec2(5.588238, 3.217711) * pictureNumber;
  float angle = 6.2831853 * fract(52.9829189 * fract(dot(at, vec2(0.06711056, 0.00583715))));
  return mat2(cos(angle), sin(angle), -sin(angle), cos(angle));
}

vec4 lightRow(int i, int k) { return texelFetch(lights, ivec2(k, i), 0); }

float sunHeight(vec2 at, float layer, float size) {
  return size * (2.0 * nearness(textureLod(sunMaps, vec3(at * 0.5 + 0.5, layer), 0.0).r) - 1.0);
}

// share of a sun that p sees; g: the face
float sunSeen(int i, vec3 to, float spread, vec3 p, vec3 g, mat2 turn) {
  vec4 right = lightRow(i, 2), up = lightRow(i, 3), box = lightRow(i, 4);
  float layer = up.w;
  for (int c = 1; c < ${CASCADES}; c++) {
    vec3 q = p - box.xyz;
    if (max(abs(dot(q, right.xyz)), abs(dot(q, up.xyz))) > 0.97 * box.w) {
      box = lightRow(i, 4 + c);
      layer = up.w + float(c);
    }
  }
  float texel = 2.0 * box.w / ${SUN_SIDE}.0, facing = max(dot(g, to), 0.02);
  vec3 q = p + g * (0.5 * texel) - box.xyz;
  vec2 here = vec2(dot(q, right.xyz), dot(q, up.xyz)) / box.w;
  float height = dot(q, to);
  vec2 slope = clamp(-vec2(dot(g, right.xyz), dot(g, up.xyz)) / facing, -8.0, 8.0);
  float bias = texel * (0.5 + 0.5 * (abs(slope.x) + abs(slope.y)));
  float wide = clamp(spread * (right.w * 0.3), 2.0 * texel, 0.1 * box.w), sum = 0.0, count = 0.0;
  for (int k = 0; k < SOUGHT; k++) {
    vec2 o = wide * (turn * tap[2 * k]);
    float blocker = sunHeight(here + o / box.w, layer, right.w) - height;
    if (blocker > dot(slope, o) + bias + 0.02 * wide) {
      sum += blocker;
      count += 1.0;
    }
  }
  // of a pixel that sees all or nothing no tap is taken
  if (count == 0.0 || count == float(SOUGHT)) return count == 0.0 ? 1.0 : 0.0;
  wide = clamp(spread * sum / count, 0.75 * texel, wide);
  float seen = 0.0;
  for (int k = 0; k < TAPS; k++) {
    vec2 o = wide * (turn * tap[k]);
    seen += float(sunHeight(here + o / box.w, layer, right.w) - height <= dot(slope, o) + bias);
  }
  return seen / float(TAPS);
}

// the distance along its side's axis of what a lamp sees in direction q, over that of q itself
float lampReach(vec3 q, float layer, float near) {
  vec3 a = abs(q);
  float major = max(a.x, max(a.y, a.z));
  vec2 st = a.x == major ? q.yz : a.y == major ? q.zx : q.xy;
  layer += a.x == major ? float(q.x < 0.0) : a.y == major ? 2.0 + float(q.y < 0.0) : 4.0 + float(q.z < 0.0);
  float d = nearness(textureLod(lampMaps, vec3(st / major * 0.5 + 0.5, layer), 0.0).r);
  return near / (max(d, 1e-9) * major);
}

// v: from the lamp to the point; maps: near, layer, reach
float lampSeen(vec4 maps, float radius, vec3 v, vec3 g, mat2 turn) {
  float far = length(v);
  if (far <= maps.z * 1.02 || far <= maps.x) return 1.0;
  float texel = 2.0 * far / ${LAMP_SIDE}.0;
  vec3 q = v + g * texel;
  vec3 side = normalize(cross(v, abs(v.z) < 0.7 * far ? vec3(0, 0, 1) : vec3(1, 0, 0)));
  vec3 across = cross(side, v / far);
  float facing = dot(g, q), wide = clamp(2.0 * radius, texel, 0.15 * far), sum = 0.0, count = 0.0;
  if (radius > 0.0) {
    for (int k = 0; k < SOUGHT; k++) {
      vec2 o = wide * (turn * tap[2 * k]);
      vec3 t = q + o.x * side + o.y * across;
      float blocker = lampReach(t, maps.y, maps.x) / clamp(facing / min(dot(g, t), -1e-6), 0.7, 1.4);
      if (blocker < 0.985) {
        sum += blocker;
        count += 1.0;
      }
    }
    if (count == 0.0 || count == float(SOUGHT)) return count == 0.0 ? 1.0 : 0.0;
  }
  wide = count > 0.0 ? clamp(radius * (count / max(sum, 1e-3) - 1.0), 0.75 * texel, wide) : 0.75 * texel;
  float seen = 0.0;
  for (int k = 0; k < TAPS; k++) {
    vec2 o = wide * (turn * tap[k]);
    vec3 t = q + o.x * side + o.y * across;
    seen += float(lampReach(t, maps.y, maps.x) >= 0.99 * clamp(facing / min(dot(g, t), -1e-6), 0.7, 1.4));
  }
  return seen / float(TAPS);
}

// an emitter's intensity by direction: an octahedron laid flat
float shape(int row, int first, vec3 d) {
  d /= abs(d.x) + abs(d.y) + abs(d.z) + 1e-30;
  vec2 sides = vec2(d.x < 0.0 ? -1.0 : 1.0, d.y < 0.0 ? -1.0 : 1.0);
  vec2 place = (0.5 + 0.5 * (d.z < 0.0 ? (1.0 - abs(d.yx)) * sides : d.xy)) * 16.0;
  ivec2 low = clamp(ivec2(place), ivec2(0), ivec2(15));
  vec2 f = place - vec2(low);
  ivec2 i = ivec2(first + 17 * low.y + low.x, row);
  return mix(mix(texelFetch(shapes, i, 0).r, texelFetch(shapes, i + ivec2(1, 0), 0).r, f.x),
    mix(texelFetch(shapes, i + ivec2(17, 0), 0).r, texelFetch(shapes, i + ivec2(18, 0), 0).r, f.x), f.y);
}

// times albedo / pi it is what leaves; of a finish, times 1 / pi
#ifdef FINISH
vec3 directLight(Seen s) {
  vec3 p = vAt, n = s.plain, lit = s.n, sum = vec3(0);
#else
vec3 directLight() {
  vec3 p = vAt, g = faceNormal(), n = plainNormal(g), lit = n, sum = vec3(0);
#endif
  mat2 turn = turnOf(gl_FragCoord.xy);
  for (int k = 0; k < lightCount; k++) {
    int i = light[k];
    vec4 place = lightRow(i, 0), colour = lightRow(i, 1), axis = lightRow(i, 2), maps = lightRow(i, 3);
    bool sun = place.w == 0.0;
    vec3 to = sun ? place.xyz : place.xyz - p;
    float far2 = dot(to, to) + 1e-20, far = sqrt(far2), e = dot(lit, to) / (sun ? 1.0 : far2 * far);
    if (place.w == 2.0) {
      float falls = clamp((dot(axis.xyz, -to) / far - axis.w) * maps.w, 0.0, 1.0);
      e *= falls * falls;
    }
    if (place.w == 3.0) {
      // reach is 1.5 radii; nearer than 5 of them an emitter is open
      e *= shape(int(axis.x), far * 1.5 < 5.0 * maps.z ? 289 : 0, -to);
      e *= far2 / max(far2, maps.z * maps.z);
    }
#ifdef FINISH
    // the share of the lamp above the plain surface; shadow maps do not know it
    e *= clamp(0.5 + 0.5 * dot(s.plain, to) / max(colour.w, 1e-6), 0.0, 1.0);
    if (!(e > 0.0)) continue;
    vec3 sent = colour.rgb * (e * reflected(s, to / far, dot(lit, to) / far, colour.w / (sun ? 1.0 : far)));
    if (dot(sent, vec3(0.2126, 0.7152, 0.0722)) <= faint) continue;
#else
    if (e * dot(colour.rgb, vec3(0.2126, 0.7152, 0.0722)) <= faint) continue;
#endif
    float seen = sun ? sunSeen(i, to, colour.w, p, n, turn) : lampSeen(maps, colour.w, -to, n, turn);
#ifdef FINISH
    sum += sent * seen;
#else
    sum += colour.rgb * (e * seen);
#endif
  }
  return sum;
}
`;

export const SURFACE_FRAGMENT = `${HEAD}
in vec3 vAt;
#ifndef ONE_UV
in vec4 vUv;
#define uvOf(set) (set > 0.5 ? vUv.zw : vUv.xy)
#else
in vec2 vUv;
#define uvOf(set) (vUv - vUv * step(0.5, set))
#endif
#ifndef WHITE
in vec4 vColour;
#else
const vec4 vColour = vec4(1);
#endif
in vec2 vLightmap;
centroid in vec2 vLightmapIn;
flat in uint vTag;
flat in uint vObject;
#ifdef NORMALS
in vec3 vNormal;
#endif
#ifdef NORMAL_TEXTURE
in vec4 vTangent;
#endif
uniform sampler2D objects, materials, baseTexture, glowTexture;
uniform usampler2D levels, tileState;
uniform sampler2DArray pages;
uniform vec2 pageSize;
uniform vec3 forward, standIn;
uniform float exposure, lightUnit, pixelArea, sharper, parallel;
uniform bool unfiltered;
uniform int finest; // level; below 0: finer than level 0
uniform uint slots; // the first one's in levels
// from the eye to what is seen; of an orthographic view unit
vec3 ray() { return parallel > 0.0 ? forward : vAt; }
#ifdef SURVEY
uniform uint surveyNumber;
out uvec4 needed;
#elif defined(SHADOW)
uniform float reach;
#else
out vec4 radiance;
#endif

struct Footprint {
  uint tile; // of its first texel
  bool across, down; // whether it reads the tile beside that, below that
  uint tilesX;
  vec2 texel; // in the level
  vec3 place; // in the pages
};

// first: tile of a level
Footprint footprintIn(uint first, uvec2 size, vec2 uv) {
  Footprint f;
  f.texel = clamp(uv - 0.5, vec2(0), vec2(size - 1u));
  uvec2 low = uvec2(f.texel), high = min(low + 1u, size - 1u);
  f.tilesX = (size.x + 63u) >> 6;
  f.tile = first + (low.y >> 6) * f.tilesX + (low.x >> 6);
  f.across = low.x >> 6 != high.x >> 6;
  f.down = low.y >> 6 != high.y >> 6;
  return f;
}

uvec2 pair(uint both) { return uvec2(both & 0xffffu, both >> 16); }

// rectangle: as in levels
vec3 placeIn(uvec4 rectangle, vec2 texel) {
  return vec3((vec2(pair(rectangle.x)) + texel + 0.5) / pageSize, float(rectangle.y));
}

Footprint footprintOf(uint first, uint k, vec2 uv) {
  uvec4 level = texelFetch(levels, at(first + k), 0);
  Footprint f = footprintIn(level.z, pair(level.w), uv * exp2(-float(k)));
  f.place = placeIn(level, f.texel);
  return f;
}

// On a level that is finer than level 0 by 2^k. It has no place.
Footprint finerOf(vec4 object, int k, vec2 uv) {
  uvec2 size = 2u * pair(texelFetch(levels, at(uint(object.x)), 0).w);
  uint first = uint(object.w);
  for (int i = 1; i < k; i++) {
    first += ((size.x + 63u) >> 6) * ((size.y + 63u) >> 6);
    size *= 2u;
  }
  return footprintIn(first, size, uv * exp2(float(k)));
}

// 0: not there; otherwise one more than the finest level at which its noise is bearable. Of a tile of a finer
// level the slot, and how much of it is shown.
uint stateOf(uint tile) { return texelFetch(tileState, at(tile), 0).r; }

bool isThere(Footprint f) {
  if (stateOf(f.tile) == 0u) return false;
  if (f.across && stateOf(f.tile + 1u) == 0u) return false;
  if (f.down && stateOf(f.tile + f.tilesX) == 0u) return false;
  return !(f.across && f.down) || stateOf(f.tile + f.tilesX + 1u) != 0u;
}

#ifdef FINISH
uniform float directions; // layers from light to where it comes from; 0: that is not known
vec3 fromTexel(vec3 texel);
vec3 direction = vec3(0); // of the light that was read last; 0: not known
#endif
vec3 irradianceAt(Footprint f) {
#ifdef FINISH
  if (directions > 0.0) direction = fromTexel(texture(pages, f.place + vec3(0, 0, directions)).rgb);
#endif
  return lightUnit * texture(pages, f.place).rgb;
}

// What stands in for a level: the next coarser one that is there, or else a finer one.
vec3 standInFor(uint first, uint count, uint from, vec2 uv) {
  for (uint k = from; k < count; k++) {
    Footprint f = footprintOf(first, k, uv);
    if (isThere(f)) return irradianceAt(f);
  }
  for (uint k = from; k-- > 0u;) {
    Footprint f = footprintOf(first, k, uv);
    if (isThere(f)) return irradianceAt(f);
  }
  return standIn;
}

#ifdef SURVEY
// Whether the texels of level 0 that it mixes differ by no more than a tenth, or are noisy, or not there.
bool isEven(Footprint f) {
  if (stateOf(f.tile) != 1u || !isThere(f)) return true;
  float low = 1e30, high = 0.0;
  for (int i = 0; i < 4; i++) {
    vec2 to = mix(floor(f.texel), ceil(f.texel), vec2(i & 1, i >> 1)) - f.texel;
    float e = dot(texture(pages, f.place + vec3(to / pageSize, 0)).rgb, vec3(0.2126, 0.7152, 0.0722));
    low = min(low, e);
    high = max(high, e);
  }
  return high - low <= 0.1 * high;
}
#endif

// The level of which a texel is as large as the pixel, or smaller. Below 0 it is finer than level 0: its
// texels are four pixels wide, or wider.
int levelFor(uint coarsest) {
  vec2 dx = dFdx(vLightmap), dy = dFdy(vLightmap);
  vec3 face = cross(dFdx(vAt), dFdy(vAt));
  float away = length(ray()), faceLength = length(face);
  float cosine = faceLength > 0.0 ? abs(dot(face, ray())) / (faceLength * away) : 1.0;
  // seen at a grazing angle a pixel covers a long strip: past this its level would only blur
  float texels = abs(dx.x * dy.y - dx.y * dy.x) * pixelArea * min(1.0, cosine / 0.05);
  texels *= away / dot(ray(), forward);
  if (texels >= 4.0) return int(min(coarsest, uint(log2(texels) * 0.5)));
  return finest < 0 ? -int(clamp(log2(texels) * -0.5 - 2.0, 0.0, float(-finest))) : 0;
}

// row: of the table of materials, where the rows of the transform are
vec3 sampleTexture(sampler2D image, uint row, out float alpha) {
  vec4 row0 = texelFetch(materials, at(row), 0), row1 = texelFetch(materials, at(row + 1u), 0);
  vec2 uv = uvOf(row0.w);
  vec4 value = texture(image, vec2(dot(row0.xyz, vec3(uv, 1)), dot(row1.xyz, vec3(uv, 1))), sharper);
  alpha = value.a;
  return value.rgb;
}

#ifdef NORMALS
// the side that is seen
vec3 faceNormal() {
  vec3 g = normalize(cross(dFdx(vAt), dFdy(vAt)));
  return dot(g, ray()) > 0.0 ? -g : g;
}

vec3 plainNormal(vec3 g) {
  vec3 n = normalize(gl_FrontFacing ? vNormal : -vNormal);
  return dot(n, g) > 0.01 ? n : g;
}
#endif
#ifdef FINISH
${FINISH}
#endif
#ifdef DIRECT
${DIRECT}
#endif
#ifdef SHOW
uniform int show;
#endif

void main() {
  uint m = ${MATERIAL_TEXELS}u * (vTag & 0xffffu);
  vec4 base = texelFetch(materials, at(m), 0);
  vec4 glow = texelFetch(materials, at(m + 1u), 0);
  vec3 albedo = base.rgb, emission = glow.rgb;
  float alpha = base.a, ignored;
#ifdef BASE_TEXTURE
  float textureAlpha;
  albedo *= sampleTexture(baseTexture, m + 2u, textureAlpha);
  alpha *= textureAlpha;
#endif
#ifdef GLOW_TEXTURE
  emission *= sampleTexture(glowTexture, m + 4u, ignored);
#endif
  albedo = clamp(albedo * vColour.rgb, 0.0, 1.0);
  float unlit = texelFetch(materials, at(m + 5u), 0).w;
  emission += unlit * albedo;
  albedo *= 1.0 - unlit;
  alpha *= vColour.a;
#if defined(SHADOW) || defined(DEPTH)
#ifdef MASK
  if (alpha < glow.w) discard;
#endif
#ifdef SHADOW
  if (dot(vAt, vAt) < reach * reach) discard;
#else
  radiance = vec4(0);
#endif
#ifdef BLEND
  // that share of the texels, in no pattern, lets light pass
  if (alpha <= fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))))) discard;
#endif
#else
  vec4 object = texelFetch(objects, at(${OBJECT_TEXELS}u * vObject + 3u), 0);
  uint first = uint(object.x), count = uint(object.y), coarsest = vTag >> 16 & 3u;
  int finer = max(levelFor(coarsest), finest); // before any pixel leaves: it takes differences
  uint level = min(uint(max(finer, 0)), max(count, 1u) - 1u);
#ifdef FINISH
  Seen plain, seen;
  plain.v = -normalize(ray());
  plain.plain = plainNormal(faceNormal());
  if (!(dot(plain.plain, plain.plain) > 0.5)) plain.plain = plain.v; // an edge: it has no face
  float metalness, occlusion = finishOf(albedo, plain, seen, metalness);
#endif
#ifdef MASK
  if (alpha < glow.w) discard;
#endif
  vec2 uv = vLightmapIn;
  if (!gl_FrontFacing) uv.y += object.z;
#ifdef SURVEY
#ifdef BLEND
  if (((uint(gl_FragCoord.x) ^ uint(gl_FragCoord.y) ^ surveyNumber) & 1u) == 0u) discard;
#endif
  needed = uvec4(0);
  if (count > 0u) {
    Footprint f = footprintOf(first, level, uv);
    if (finer < 0 && ((vTag & ${SMALL}u) != 0u || !isEven(f))) f = finerOf(object, -finer, uv);
    needed = uvec4(f.tile + 1u, (f.across ? 1u : 0u) | (f.down ? 2u : 0u), f.tilesX, 0u);
  }
#elif defined(SHOW)
#ifdef FINISH
  vec3 normal = seen.n;
  float rough = seen.lobes.roughness, metal = clamp(metalness, 0.0, 1.0);
#else
  vec3 normal = plainNormal(faceNormal());
  float rough = 1.0, metal = 0.0;
#endif
  radiance = vec4(show == 1 ? normal * 0.5 + 0.5 : vec3(show == 2 ? rough : metal), 1);
#else
  vec3 e = standIn;
  if (count > 0u) {
    vec3 shown = vec3(0), from = vec3(0);
    float left = 1.0; // share of coarser levels
    for (; finer < 0 && left > 0.0; finer++) {
      Footprint f = finerOf(object, -finer, uv);
      uint state = stateOf(f.tile);
      if (state == 0u) continue;
      float share = left * float(state >> ${SLOT_BITS}) / ${SHARE_WHOLE}.0;
      uvec4 slot = texelFetch(levels, at(slots + (state & ${(1 << SLOT_BITS) - 1}u)), 0);
      f.place = placeIn(slot, f.texel - vec2(uvec2(f.texel) & ~63u));
      shown += share * irradianceAt(f);
#ifdef FINISH
      from += share * direction;
#endif
      left -= share;
    }
    if (left > 0.0) {
      Footprint f = footprintOf(first, level, uv);
      // fresh light is noise, but a texel of level 2 is the mean of 4 x 4: until the error has fallen, less
      // is more
      uint noiseLevel = unfiltered ? 0u : max(stateOf(f.tile), 1u) - 1u;
      noiseLevel = min(noiseLevel, min(coarsest, count - 1u));
      e = noiseLevel <= level && isThere(f)
        ? irradianceAt(f)
        : standInFor(first, count, max(noiseLevel, level), uv);
    }
    e = shown + left * e;
#ifdef FINISH
    direction = from + left * direction;
#endif
  }
#ifdef FINISH
  vec3 ahead = reflect(-seen.v, seen.n);
  vec2 by = directed(direction, seen.plain, seen.n, ahead, seen.alpha);
  vec3 leaving = occlusion * everywhere(seen, e, by.x, by.y) + emission;
#ifdef DIRECT
  leaving += directLight(seen) * ${1 / Math.PI};
#endif
#else
#ifdef DIRECT
  e += directLight();
#endif
  vec3 leaving = albedo * e * ${1 / Math.PI} + emission;
#endif
#ifdef BLEND
  radiance = vec4(min(leaving * exposure, 6e4), clamp(alpha, 0.0, 1.0));
#else
  radiance = vec4(min(leaving * exposure, 6e4), 1);
#endif
#endif
#endif
}`;

/** A triangle that covers the picture. */
export const SCREEN_VERTEX = `${HEAD}
out vec2 vScreen;
void main() {
  vScreen = vec2(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1);
  gl_Position = vec4(vScreen, 0, 1);
}`;

export const SKY_FRAGMENT = `${HEAD}
in vec2 vScreen;
uniform vec3 right, up, forward, sky;
uniform vec2 scale, offset;
uniform float exposure, lightUnit, parallel;
uniform bool hasEnvironment;
uniform sampler2D environment;
out vec4 radiance;
void main() {
  vec2 place = parallel > 0.0 ? vec2(0) : (vScreen + offset) / scale; // a point, where rays are parallel
  vec3 d = normalize(forward + right * place.x + up * place.y);
  vec3 outside = sky;
  if (hasEnvironment) {
    vec2 size = vec2(textureSize(environment, 0));
    place = vec2(0.5 + atan(d.z, d.x) * ${0.5 / Math.PI}, atan(length(d.xz), d.y) * ${1 / Math.PI});
    place.y = clamp(place.y * size.y, 0.5, size.y - 0.5) / size.y;
    outside += lightUnit * textureLod(environment, place, 0.0).rgb;
  }
  radiance = vec4(min(outside * exposure, 6e4), 1);
}`;

// client/view/tonemap.c, with the sRGB curve of IEC 61966-2-1.
export const TONEMAP_FRAGMENT = `${HEAD}
in vec2 vScreen;
uniform sampler2D picture;
uniform int curve;
out vec4 srgb;
void main() {
  vec3 c = max(textureLod(picture, vScreen * 0.5 + 0.5, 0.0).rgb, 0.0); // the picture may be smaller
  if (curve == 0) c /= 1.0 + dot(c, vec3(0.2126, 0.7152, 0.0722));
  else if (curve == 1) c = c * (2.51 * c + 0.03) / (c * (2.43 * c + 0.59) + 0.14);
  c = clamp(c, 0.0, 1.0);
  srgb = vec4(mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)), 1);
}`;

export const COPY_FRAGMENT = `${HEAD}
in vec2 vScreen;
uniform sampler2D picture;
out vec4 value;
void main() { value = texelFetch(picture, ivec2(gl_FragCoord.xy), 0); }`;

/** A few pixels of a picture, evenly spread, for the exposure. */
export const METER_FRAGMENT = `${HEAD}
in vec2 vScreen;
uniform sampler2D picture;
out vec4 value;
void main() {
  value = texelFetch(picture, ivec2((vScreen * 0.5 + 0.5) * vec2(textureSize(picture, 0))), 0);
}`;
