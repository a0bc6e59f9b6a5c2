// nodes.ts: what materials read of light besides lightmaps, for WebGPURenderer: ../src/direction_shader.ts
// and FINER_SHADER in three's shading language.
import * as THREE from 'three';

import { TILE_SIDE } from '../src/atlas.ts';
import { SHARE_WHOLE, SLOT_BITS, SLOT_SIDE } from '../src/finer.ts';
import { FINE_PIXELS, type FinerUniforms, LEVELS_MAX, TABLE_BITS } from './fine_pool.ts';
import { CHANNEL } from './lightmaps.ts';

/** A value of the shader, as far as it is used here. */
export interface Node {
  r: Node;
  g: Node;
  b: Node;
  x: Node;
  y: Node;
  rgb: Node;
  xyz: Node;
  zw: Node;
  mul(factor: number | Node): Node;
  add(other: number | Node): Node;
  sub(other: number | Node): Node;
  div(by: number | Node): Node;
  max(other: number | Node): Node;
  min(other: number | Node): Node;
  dot(other: Node): Node;
  reflect(normal: Node): Node;
  negate(): Node;
  oneMinus(): Node;
  sqrt(): Node;
  abs(): Node;
  floor(): Node;
  dFdx(): Node;
  dFdy(): Node;
  depth(layer: Node): Node;
  exp(): Node;
  length(): Node;
  normalize(): Node;
  clamp(least: number, most: number): Node;
  greaterThan(other: number | Node): Node;
  select(yes: Node, no: Node): Node;
  toVar(): Node;
  assign(value: Node): void;
}

/** What this module uses of TSL of three/webgpu. */
export interface ShadingNodes {
  float(value: number | Node): Node;
  int(value: Node): Node;
  ivec2(x: Node, y: Node): Node;
  vec4(x: Node | number, y: number, z?: number, w?: number): Node;
  uv(channel: number): Node;
  texture(of: THREE.Texture, at: Node, level: number): Node;
  textureLoad(of: THREE.Texture, at: Node): Node;
  materialReference(property: string, type: string): Node;
  normalView: Node;
  normalViewGeometry: Node;
  positionViewDirection: Node;
  cameraViewMatrix: Node;
  roughness: Node;
}

const USED: (keyof ShadingNodes)[] = [
  'float',
  'int',
  'ivec2',
  'vec4',
  'uv',
  'texture',
  'textureLoad',
  'materialReference',
  'normalView',
  'normalViewGeometry',
  'positionViewDirection',
  'cameraViewMatrix',
  'roughness',
];

/** The first thing that a module lacks of ShadingNodes; null: none. */
export function lackOf(tsl: object): string | null {
  return USED.find((name) => !(name in tsl)) ?? null;
}

export interface ByDirection {
  factor: Node; // of E, for the bent normal
  gain: Node; // of what is mirrored
}

/** Finer levels over a texel of level 0. */
export interface FineNodes {
  light: Node;
  from: Node; // where light of finer levels comes from, times their share
  rest: Node; // the share of level 0
}

/** Makes the numbers of FINER_SHADER properties of a material, which nodes read. */
export function exposeFiner(material: THREE.Material, finer: FinerUniforms): void {
  const rows = finer.lightwellFiner!.value as Int32Array;
  for (let k = 0; k < LEVELS_MAX; k++)
    Object.assign(material, { [`lightwellFiner${k + 1}`]: new THREE.Vector4().fromArray(rows, 4 * k) });
  for (const name of ['lightwellAtlas', 'lightwellLevels', 'lightwellFarther'])
    Object.defineProperty(material, name, { get: () => finer[name]!.value, enumerable: true });
}

/** FINER_SHADER's lightwellFinest(). light: of level 0, as the material shows it. */
export function finest(tsl: ShadingNodes, finer: FinerUniforms, light: Node): FineNodes {
  const { float, int, ivec2, materialReference, texture, textureLoad } = tsl;
  const pool = finer.lightwellPool!.value as THREE.Texture;
  const table = finer.lightwellTable!.value as THREE.Texture;
  const unit = materialReference('lightMapIntensity', 'float');
  const farther = materialReference('lightwellFarther', 'float');
  const isDirected = farther.greaterThan(0);
  const place = tsl.uv(CHANNEL).mul(materialReference('lightwellAtlas', 'vec2')).toVar();
  const [right, down] = [place.dFdx().toVar(), place.dFdy().toVar()];
  const texels = right.x.mul(down.y).sub(right.y.mul(down.x)).abs().mul(FINE_PIXELS ** 2).toVar();
  let fine = { light, from: light.mul(0), rest: float(1) };
  for (let k = 1; k <= LEVELS_MAX; k++) {
    const scale = 2 ** k;
    const level = materialReference(`lightwellFiner${k}`, 'vec4');
    const at = place.mul(scale).sub(0.5).min(level.zw.sub(1)).max(0).toVar();
    const tile = at.div(TILE_SIDE).floor().toVar();
    const entry = level.x.add(tile.y.mul(level.y)).add(tile.x).toVar();
    const row = entry.add(0.5).div(1 << TABLE_BITS).floor();
    const column = entry.sub(row.mul(1 << TABLE_BITS));
    const word = float(textureLoad(table, ivec2(int(column), int(row))).r).toVar();
    const whole = word.div(1 << SLOT_BITS).floor().toVar();
    const isThere = materialReference('lightwellLevels', 'float').greaterThan(k - 0.5);
    const isWide = float(1 + 1e-6).greaterThan(texels.mul(scale * scale));
    const shown = isThere.select(isWide.select(whole.div(SHARE_WHOLE), float(0)), float(0)).toVar();
    const slot = word.sub(whole.mul(1 << SLOT_BITS)).toVar();
    const within = at.sub(tile.mul(TILE_SIDE)).add(0.5).div(SLOT_SIDE).toVar();
    const own = texture(pool, within, 0).depth(int(slot)).rgb.mul(unit);
    const texel = texture(pool, within, 0).depth(int(slot.add(farther))).rgb;
    const directed = isDirected.select(shown, float(0)).toVar();
    const over = (before: Node, after: Node, share: Node) => before.add(after.sub(before).mul(share)).toVar();
    fine = {
      light: over(fine.light, own, shown),
      from: over(fine.from, known(tsl, texel), directed),
      rest: fine.rest.mul(directed.oneMinus()).toVar(),
    };
  }
  return fine;
}

/** DIRECTED's fromTexel(). */
function known({ float }: ShadingNodes, texel: Node): Node {
  const there = texel.dot(texel).greaterThan(0).select(float(1), float(0));
  return texel.mul(2).sub(1).mul(there);
}

/** The material's own lightwellDirections and lightwellRoot, turned into the camera's space. */
function directionOf(tsl: ShadingNodes, fine: FineNodes | null): Node {
  const { vec4, materialReference, cameraViewMatrix } = tsl;
  const plain = known(tsl, materialReference('lightwellDirections', 'texture').rgb.toVar());
  const root = materialReference('lightwellRoot', 'mat4');
  const turned = root.mul(vec4(fine ? fine.from.add(fine.rest.mul(plain)) : plain, 0));
  return cameraViewMatrix.mul(turned).xyz.div(root.mul(vec4(1, 0, 0, 0)).xyz.length());
}

/** DIRECTED's directed(). smooth: the surface mirrors by its roughness, else as one of roughness 1. */
export function byDirection(tsl: ShadingNodes, smooth: boolean, fine: FineNodes | null): ByDirection {
  const { float, normalViewGeometry: n, normalView: m } = tsl;
  const ahead = tsl.positionViewDirection.negate().reflect(m);
  const alpha = smooth ? tsl.roughness.mul(tsl.roughness) : float(1);
  const given = directionOf(tsl, fine).toVar();
  const long2 = given.dot(given).toVar();
  const r = given.div(long2.max(1).sqrt()).toVar();
  const u = r.add(n.mul(r.dot(n).negate().max(0).sub(2 / 3))).toVar();
  const rise = u.dot(n).mul(1.2).toVar();
  const found = rise.add(rise.mul(rise).add(u.dot(u).mul(1.8)).sqrt()).min(1).toVar();
  const isSide = found.greaterThan(0.02);
  const w = isSide.select(found, float(0)).toVar();
  const source = u.div(found.max(0.02)).add(n.mul(2 / 3));
  const d = isSide.select(source.normalize(), n).toVar();
  const along = d.dot(n).toVar();
  const wide = w.oneMinus().mul(0.5).toVar();
  const lobe = (cosine: Node) =>
    wide.oneMinus().mul(cosine.max(0)).add(wide.mul(0.5).mul(cosine.add(1)));
  const own = lobe(along).toVar();
  const bent = w.mul(lobe(d.dot(m)).sub(own)).div(own.max(0.05));
  const factor = wide.mul(n.dot(m.sub(n))).add(bent).add(1).clamp(0, 4);
  const sharp = w.mul(12).div(float(1.02).sub(w)).add(2).toVar();
  const q = float(0.5).div(alpha.mul(alpha)).toVar();
  const k = sharp.mul(q).div(sharp.add(q)).toVar();
  const behind = k.mul(-2).exp().toVar();
  const high = behind.add(1).div(behind.oneMinus()).sub(float(1).div(k)).mul(along).toVar();
  const flat = float(1).div(k.mul(Math.PI / 2).add(4));
  const cosine = high.add(high.mul(high).add(flat).sqrt()).mul(0.5).max(0.05);
  const peak = k.mul(k.mul(ahead.dot(d).min(1).sub(1)).exp()).div(cosine.mul(2).mul(behind.oneMinus()));
  const gain = w.oneMinus().add(w.mul(peak)).clamp(0, 8);
  const isKnown = long2.greaterThan(4e-4);
  return { factor: isKnown.select(factor, float(1)).toVar(), gain: isKnown.select(gain, float(1)).toVar() };
}
