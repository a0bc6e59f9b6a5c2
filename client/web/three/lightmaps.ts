// lightmaps.ts: the lightmap of one object as a texture of three's: level 0 of its atlas, in which coarser
// tiles stand in for finer ones; and its way to the GPU, tile by tile, with each renderer of three's.
import * as THREE from 'three';

import type { Place } from '../src/atlas.ts';
import type { MeshShape } from '../src/geometry.ts';

/** UV channel of the lightmap: 'uv2', since a glTF uses up to two. */
export const CHANNEL = 2;
const NEVER = 255; // a level that no texel has

export interface Lightmap {
  texture: THREE.DataTexture;
  texels: Uint32Array; // RGB9E5
  level: Uint8Array; // by texel: of the tile that it is from, NEVER: none
  width: number;
  height: number;
  uploaded: number; // version of the texture that the GPU has whole; 0: none
}

/** What draws: a WebGLRenderer or a WebGPURenderer. */
export type AnyRenderer = THREE.WebGLRenderer | WebGPURenderer;

/** As far as it is known here; the package does not import three/webgpu, which older versions lack. */
interface WebGPURenderer {
  isWebGPURenderer?: boolean; // has had other names
  backend?: {
    isWebGPUBackend?: boolean;
    isWebGLBackend?: boolean;
    gl?: WebGL2RenderingContext;
    state?: { bindTexture(target: number, texture: WebGLTexture): void };
    device?: GPUDeviceLike;
    get(texture: THREE.Texture): { texture?: unknown; textureGPU?: WebGLTexture } | undefined;
  };
}

interface GPUDeviceLike {
  limits: { maxTextureArrayLayers: number };
  queue: { writeTexture(to: object, data: BufferSource, layout: object, size: object): void };
}

// before r165 three has no constants for these, and takes WebGL's own names
const named = Number.parseInt(THREE.REVISION) < 170;
/** What a texture of RGB9E5 texels is for three. */
export const RGB9E5 = {
  format: (named ? 'RGB' : 1022) as THREE.PixelFormat, // RGBFormat
  type: (named ? 'UNSIGNED_INT_5_9_9_9_REV' : 35902) as THREE.TextureDataType, // UnsignedInt5999Type
  ...(named && { internalFormat: 'RGB9_E5' as const }),
};

/** null: of a mesh without a lightmap. */
export function lightmapOf({ atlasWidth, atlasHeight }: MeshShape): Lightmap | null {
  return atlasWidth && atlasHeight ? emptyMap(atlasWidth, atlasHeight) : null;
}

/** RGB9E5 of 1/2, which a map of directions has for 0: not known. */
export const UNKNOWN = (15 << 27) | (256 << 18) | (256 << 9) | 256;

/** Texels of one word. */
export function emptyMap(width: number, height: number, word = 0): Lightmap {
  const texels = new Uint32Array(width * height).fill(word);
  const texture = new THREE.DataTexture(texels, width, height);
  Object.assign(texture, RGB9E5);
  texture.magFilter = texture.minFilter = THREE.LinearFilter;
  texture.generateMipmaps = false;
  texture.flipY = false;
  texture.unpackAlignment = 4;
  texture.colorSpace = THREE.NoColorSpace;
  texture.channel = CHANNEL;
  texture.needsUpdate = true;
  const map = {
    texture,
    texels,
    level: new Uint8Array(texels.length).fill(NEVER),
    width,
    height,
    uploaded: 0,
  };
  texture.onUpdate = () => (map.uploaded = texture.version);
  return map;
}

/** Puts a tile into level 0, unless a finer one is there. */
export function takeTile(map: Lightmap, place: Place, texels: Uint32Array): void {
  const { level, x, y, width, height } = place;
  const right = Math.min(map.width, (x + width) << level);
  const bottom = Math.min(map.height, (y + height) << level);
  for (let row = y << level; row < bottom; row++) {
    const from = ((row >> level) - y) * width - x;
    for (let at = row * map.width + (x << level), column = x << level; column < right; column++, at++) {
      if (map.level[at]! < level) continue;
      map.level[at] = level;
      map.texels[at] = texels[from + (column >> level)]!;
    }
  }
}

/** A texture that the GPU has gets the tile alone; one that it has not, all of it with the next picture.
 * renderer: that has drawn it last; null: none has. */
export function upload(map: Lightmap, place: Place, renderer: AnyRenderer | null): void {
  const { level, x, y, width, height } = place;
  const [left, top] = [x << level, y << level];
  const right = Math.min(map.width, (x + width) << level);
  const bottom = Math.min(map.height, (y + height) << level);
  const send = map.uploaded === map.texture.version && renderer && sender(map, renderer);
  if (send) send(left, top, right - left, bottom - top);
  else map.texture.needsUpdate = true;
}

type Send = (left: number, top: number, width: number, height: number) => void;

/** null: this renderer does not have the texture, or is not as it is known here. */
function sender(map: Lightmap, renderer: AnyRenderer): Send | null {
  const gpu = keptGPU(map.texture, renderer);
  if (gpu) return sendGPU(map, gpu.device, gpu.texture);
  const kept = keptGL(map.texture, renderer);
  return kept && sendGL(map, kept.gl, kept.state, kept.texture);
}

interface KeptGL {
  gl: WebGL2RenderingContext;
  state: { bindTexture(target: number, texture: WebGLTexture): void };
  texture: WebGLTexture;
}

/** Where a renderer has a texture by WebGPU; null: it has not, or draws by WebGL. */
function keptGPU(texture: THREE.Texture, renderer: AnyRenderer) {
  const { backend } = renderer as WebGPURenderer;
  if (!backend?.isWebGPUBackend || !backend.device) return null;
  const kept = backend.get(texture)?.texture;
  return kept ? { device: backend.device, texture: kept } : null;
}

/** The same by WebGL. */
function keptGL(texture: THREE.Texture, renderer: AnyRenderer): KeptGL | null {
  if (!isWebGL(renderer)) {
    const { backend } = renderer as WebGPURenderer;
    if (!backend?.isWebGLBackend || !backend.gl || !backend.state) return null;
    const { gl, state } = backend;
    const own = backend.get(texture)?.textureGPU;
    return own ? { gl, state, texture: own } : null;
  }
  const { properties, state } = renderer;
  const kept = properties?.get(texture) as { __webglTexture?: WebGLTexture } | undefined;
  if (!kept?.__webglTexture) return null;
  return { gl: renderer.getContext() as WebGL2RenderingContext, state, texture: kept.__webglTexture };
}

/** Layers of an array texture that a renderer takes, at most. */
export function layersMax(renderer: AnyRenderer): number {
  const { backend } = renderer as WebGPURenderer;
  if (backend?.device) return backend.device.limits.maxTextureArrayLayers;
  const gl = backend?.gl ?? (isWebGL(renderer) && (renderer.getContext() as WebGL2RenderingContext));
  return gl ? (gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS) as number) : 256;
}

export function isWebGL(renderer: AnyRenderer): renderer is THREE.WebGLRenderer {
  return !(renderer as WebGPURenderer).backend;
}

/** Gives one layer of an array texture its texels, RGB9E5. False: the GPU does not have the texture. */
export function sendLayer(
  array: THREE.Texture,
  renderer: AnyRenderer,
  layer: number,
  side: number,
  texels: Uint32Array,
): boolean {
  const gpu = keptGPU(array, renderer);
  if (gpu) {
    const to = { texture: gpu.texture, origin: { x: 0, y: 0, z: layer } };
    const layout = { offset: 0, bytesPerRow: 4 * side, rowsPerImage: side };
    const size = { width: side, height: side, depthOrArrayLayers: 1 };
    gpu.device.queue.writeTexture(to, texels as unknown as BufferSource, layout, size);
    return true;
  }
  const kept = keptGL(array, renderer);
  if (!kept) return false;
  const { gl, state, texture } = kept;
  const target = gl.TEXTURE_2D_ARRAY;
  state.bindTexture(target, texture);
  gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
  const type = gl.UNSIGNED_INT_5_9_9_9_REV;
  gl.texSubImage3D(target, 0, 0, 0, layer, side, side, 1, gl.RGB, type, texels);
  return true;
}

/** The same of one texel of a table, R16UI or R32UI. */
export function sendTexel(
  table: THREE.Texture,
  renderer: AnyRenderer,
  x: number,
  y: number,
  one: Uint16Array | Uint32Array,
): boolean {
  const gpu = keptGPU(table, renderer);
  if (gpu) {
    const to = { texture: gpu.texture, origin: { x, y } };
    const size = { width: 1, height: 1 };
    gpu.device.queue.writeTexture(to, one as unknown as BufferSource, { offset: 0, bytesPerRow: 4 }, size);
    return true;
  }
  const kept = keptGL(table, renderer);
  if (!kept) return false;
  const { gl, state, texture } = kept;
  state.bindTexture(gl.TEXTURE_2D, texture);
  gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
  const type = one instanceof Uint16Array ? gl.UNSIGNED_SHORT : gl.UNSIGNED_INT;
  gl.texSubImage2D(gl.TEXTURE_2D, 0, x, y, 1, 1, gl.RED_INTEGER, type, one);
  return true;
}

function sendGL(
  map: Lightmap,
  gl: WebGL2RenderingContext,
  state: { bindTexture(target: number, texture: WebGLTexture): void },
  texture: WebGLTexture,
): Send {
  return (left, top, width, height) => {
    state.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
    const from = [
      [gl.UNPACK_ROW_LENGTH, map.width],
      [gl.UNPACK_SKIP_PIXELS, left],
      [gl.UNPACK_SKIP_ROWS, top],
    ] as const;
    for (const [name, value] of from) gl.pixelStorei(name, value);
    const [format, type] = [gl.RGB, gl.UNSIGNED_INT_5_9_9_9_REV];
    gl.texSubImage2D(gl.TEXTURE_2D, 0, left, top, width, height, format, type, map.texels);
    for (const [name] of from) gl.pixelStorei(name, 0);
  };
}

function sendGPU(map: Lightmap, device: GPUDeviceLike, texture: unknown): Send {
  return (left, top, width, height) => {
    const layout = { offset: 4 * (top * map.width + left), bytesPerRow: 4 * map.width, rowsPerImage: height };
    const to = { texture, origin: { x: left, y: top } };
    device.queue.writeTexture(to, map.texels as unknown as BufferSource, layout, { width, height });
  };
}

/** Irradiance at a point of the lightmap, bilinear, W/m^2, as lw_live_sample() of liblightwell has it.
 * u, v: 0 to 1; unit: W/m^2 of a texel of 1; out: 3. Where nothing has arrived it is 0. */
export function irradianceAt(map: Lightmap, u: number, v: number, unit: number, out: Float64Array): void {
  const x = Math.min(Math.max(u * map.width - 0.5, 0), map.width - 1);
  const y = Math.min(Math.max(v * map.height - 0.5, 0), map.height - 1);
  const [i, j] = [Math.floor(x), Math.floor(y)];
  out.fill(0);
  for (let k = 0; k < 4; k++) {
    const column = Math.min(i + (k & 1), map.width - 1);
    const row = Math.min(j + (k >> 1), map.height - 1);
    const weight = (k & 1 ? x - i : 1 - x + i) * (k >> 1 ? y - j : 1 - y + j);
    const at = row * map.width + column;
    if (!weight || map.level[at] === NEVER) continue;
    addTexel(map.texels[at]!, weight * unit, out);
  }
}

/** out += scale x texel, RGB9E5: nine bits each, and an exponent for all (EXT_texture_shared_exponent). */
export function addTexel(texel: number, scale: number, out: Float64Array): void {
  const factor = scale * 2 ** ((texel >>> 27) - 24);
  out[0]! += factor * (texel & 511);
  out[1]! += factor * ((texel >>> 9) & 511);
  out[2]! += factor * ((texel >>> 18) & 511);
}
