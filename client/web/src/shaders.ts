// shaders.ts: what the GPU runs. Shading is client/view/compose.c's: albedo / pi * E + emission, E from the
// level whose texels are as large as pixels, or what stands in for it.

import { MATERIAL_TEXELS } from './geometry.ts';

/** Width of textures that hold numbers by index. */
export const TABLE_WIDTH = 2048;
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
} as const;
/** Texels of the table of objects: three rows of a transform; first level, levels, back offset. */
export const OBJECT_TEXELS = 4;

const HEAD = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
precision highp sampler2DArray;
ivec2 at(uint i) { return ivec2(i & ${TABLE_WIDTH - 1}u, i >> ${Math.log2(TABLE_WIDTH)}u); }
`;

export const SURFACE_VERTEX = `${HEAD}
layout(location = ${Attribute.POSITION}) in vec3 position;
layout(location = ${Attribute.LIGHTMAP}) in vec2 lightmap;
layout(location = ${Attribute.UV0}) in vec2 uv0;
layout(location = ${Attribute.UV1}) in vec2 uv1;
layout(location = ${Attribute.COLOUR}) in vec4 colour;
layout(location = ${Attribute.TAG}) in uint tag;
layout(location = ${Attribute.OBJECT}) in uint object;
uniform sampler2D objects;
uniform vec3 eye, right, up, forward;
uniform vec2 scale, offset;
uniform float near;
out vec3 vAt; // from the eye
out vec4 vUv;
out vec4 vColour;
out vec2 vLightmap;
centroid out vec2 vLightmapIn; // within the triangle, at every sample
flat out uint vTag;
flat out uint vObject;
void main() {
  vec4 p = vec4(position, 1);
  vec3 world;
  for (uint i = 0u; i < 3u; i++)
    world[i] = dot(texelFetch(objects, at(${OBJECT_TEXELS}u * object + i), 0), p);
  vAt = world - eye;
  vUv = vec4(uv0, uv1);
  vColour = colour;
  vLightmap = lightmap;
  vLightmapIn = lightmap;
  vTag = tag;
  vObject = object;
  float depth = dot(vAt, forward);
#ifdef REVERSED
  gl_Position = vec4(dot(vAt, right) * scale.x, dot(vAt, up) * scale.y, near, depth);
#else
  gl_Position = vec4(dot(vAt, right) * scale.x, dot(vAt, up) * scale.y, depth - 2.0 * near, depth);
#endif
  gl_Position.xy -= offset * depth;
}`;

export const SURFACE_FRAGMENT = `${HEAD}
in vec3 vAt;
in vec4 vUv;
in vec4 vColour;
in vec2 vLightmap;
centroid in vec2 vLightmapIn;
flat in uint vTag;
flat in uint vObject;
uniform sampler2D objects, materials, baseTexture, glowTexture;
uniform usampler2D levels, tileState;
uniform sampler2DArray pages;
uniform vec2 pageSize;
uniform vec3 forward, standIn;
uniform float exposure, lightUnit, pixelArea, sharper;
uniform bool unfiltered;
#ifdef SURVEY
uniform uint surveyNumber;
out uvec4 needed;
#else
out vec4 radiance;
#endif

struct Footprint {
  uint tile; // of its first texel
  bool across, down; // whether it reads the tile beside that, below that
  uint tilesX;
  vec3 place; // in the pages
};

Footprint footprintOf(uint first, uint k, vec2 uv) {
  uvec4 level = texelFetch(levels, at(first + k), 0);
  uvec2 size = uvec2(level.w & 0xffffu, level.w >> 16);
  vec2 texel = clamp(uv * exp2(-float(k)) - 0.5, vec2(0), vec2(size - 1u));
  uvec2 low = uvec2(texel), high = min(low + 1u, size - 1u);
  Footprint f;
  f.tilesX = (size.x + 63u) >> 6;
  f.tile = level.z + (low.y >> 6) * f.tilesX + (low.x >> 6);
  f.across = low.x >> 6 != high.x >> 6;
  f.down = low.y >> 6 != high.y >> 6;
  f.place = vec3((vec2(level.x & 0xffffu, level.x >> 16) + texel + 0.5) / pageSize, float(level.y));
  return f;
}

// 0: not there; otherwise one more than the finest level at which its noise is bearable.
uint stateOf(uint tile) { return texelFetch(tileState, at(tile), 0).r; }

bool isThere(Footprint f) {
  if (stateOf(f.tile) == 0u) return false;
  if (f.across && stateOf(f.tile + 1u) == 0u) return false;
  if (f.down && stateOf(f.tile + f.tilesX) == 0u) return false;
  return !(f.across && f.down) || stateOf(f.tile + f.tilesX + 1u) != 0u;
}

vec3 irradianceAt(Footprint f) { return lightUnit * texture(pages, f.place).rgb; }

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

// The level of which a texel is as large as the pixel, or smaller.
uint levelFor(uint coarsest) {
  vec2 dx = dFdx(vLightmap), dy = dFdy(vLightmap);
  vec3 face = cross(dFdx(vAt), dFdy(vAt));
  float away = length(vAt), faceLength = length(face);
  float cosine = faceLength > 0.0 ? abs(dot(face, vAt)) / (faceLength * away) : 1.0;
  // seen at a grazing angle a pixel covers a long strip: past this its level would only blur
  float texels = abs(dx.x * dy.y - dx.y * dy.x) * pixelArea * min(1.0, cosine / 0.05);
  texels *= away / dot(vAt, forward);
  return texels >= 4.0 ? min(coarsest, uint(log2(texels) * 0.5)) : 0u;
}

// row: of the table of materials, where the rows of the transform are
vec3 sampleTexture(sampler2D image, uint row, out float alpha) {
  vec4 row0 = texelFetch(materials, at(row), 0), row1 = texelFetch(materials, at(row + 1u), 0);
  vec2 uv = row0.w > 0.5 ? vUv.zw : vUv.xy;
  vec4 value = texture(image, vec2(dot(row0.xyz, vec3(uv, 1)), dot(row1.xyz, vec3(uv, 1))), sharper);
  alpha = value.a;
  return value.rgb;
}

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
  alpha *= vColour.a;
  vec4 object = texelFetch(objects, at(${OBJECT_TEXELS}u * vObject + 3u), 0);
  uint first = uint(object.x), count = uint(object.y), coarsest = vTag >> 16;
  uint level = min(levelFor(coarsest), max(count, 1u) - 1u); // before any pixel leaves: it takes differences
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
    needed = uvec4(f.tile + 1u, (f.across ? 1u : 0u) | (f.down ? 2u : 0u), f.tilesX, 0u);
  }
#else
  vec3 e = standIn;
  if (count > 0u) {
    Footprint f = footprintOf(first, level, uv);
    // fresh light is noise, but a texel of level 2 is the mean of 4 x 4: until the error has fallen, less is
    // more
    uint noiseLevel = unfiltered ? 0u : max(stateOf(f.tile), 1u) - 1u;
    noiseLevel = min(noiseLevel, min(coarsest, count - 1u));
    e = noiseLevel <= level && isThere(f)
      ? irradianceAt(f)
      : standInFor(first, count, max(noiseLevel, level), uv);
  }
#ifdef DIRECT
  e += directLight();
#endif
  vec3 leaving = albedo * e * ${1 / Math.PI} + emission;
#ifdef BLEND
  radiance = vec4(min(leaving * exposure, 6e4), clamp(alpha, 0.0, 1.0));
#else
  radiance = vec4(min(leaving * exposure, 6e4), 1);
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
uniform float exposure, lightUnit;
uniform bool hasEnvironment;
uniform sampler2D environment;
out vec4 radiance;
void main() {
  vec2 place = (vScreen + offset) / scale;
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
  vec3 c = max(texelFetch(picture, ivec2(gl_FragCoord.xy), 0).rgb, 0.0);
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
