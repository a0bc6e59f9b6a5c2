// nodes.ts: where light comes from, for WebGPURenderer: ../src/direction_shader.ts in three's shading language.

/** A value of the shader, as far as it is used here. */
export interface Node {
  r: Node;
  g: Node;
  b: Node;
  rgb: Node;
  xyz: Node;
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
  exp(): Node;
  length(): Node;
  normalize(): Node;
  clamp(least: number, most: number): Node;
  greaterThan(other: number): Node;
  select(yes: Node, no: Node): Node;
  toVar(): Node;
  assign(value: Node): void;
}

/** What this module uses of TSL of three/webgpu. */
export interface ShadingNodes {
  float(value: number): Node;
  vec4(x: Node | number, y: number, z?: number, w?: number): Node;
  materialReference(property: string, type: string): Node;
  materialLightMap: Node;
  normalView: Node;
  normalViewGeometry: Node;
  positionViewDirection: Node;
  cameraViewMatrix: Node;
  roughness: Node;
}

const USED: (keyof ShadingNodes)[] = [
  'float',
  'vec4',
  'materialReference',
  'materialLightMap',
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

/** The material's own lightwellDirections and lightwellRoot, turned into the camera's space. */
function directionOf(tsl: ShadingNodes): Node {
  const { float, vec4, materialReference, cameraViewMatrix } = tsl;
  const texel = materialReference('lightwellDirections', 'texture').rgb.toVar();
  const known = texel.dot(texel).greaterThan(0).select(float(1), float(0));
  const root = materialReference('lightwellRoot', 'mat4');
  const turned = root.mul(vec4(texel.mul(2).sub(1).mul(known), 0));
  return cameraViewMatrix.mul(turned).xyz.div(root.mul(vec4(1, 0, 0, 0)).xyz.length());
}

/** DIRECTED's directed(). smooth: the surface mirrors by its roughness, else as one of roughness 1. */
export function byDirection(tsl: ShadingNodes, smooth: boolean): ByDirection {
  const { float, normalViewGeometry: n, normalView: m } = tsl;
  const ahead = tsl.positionViewDirection.negate().reflect(m);
  const alpha = smooth ? tsl.roughness.mul(tsl.roughness) : float(1);
  const given = directionOf(tsl).toVar();
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
  const known = long2.greaterThan(4e-4);
  return { factor: known.select(factor, float(1)).toVar(), gain: known.select(gain, float(1)).toVar() };
}
