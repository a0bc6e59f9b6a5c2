// gather.ts: the light that arrives at points of space, for objects that only the client has: rays to the
// nearest surfaces, each of which shines by its albedo x E / pi and its emission, as the last bounce of the
// server's solve does; and to the lights whose light is in the tiles.
import * as THREE from 'three';

import { LightKind, NONE } from '../src/package.ts';
import { MATERIAL_TEXELS, type SceneData } from '../src/geometry.ts';
import type { Frame } from '../src/wire.ts';
import { addTexel, irradianceAt } from './lightmaps.ts';
import type { Placed } from './swap.ts';
import { Tree } from './tree.ts';

/** Rays over the whole sphere, the same at all times: light that is still does not flicker. */
export const RAYS = 256;
const AVERAGE_SIDE = 16; // of the small copy of a texture that rays read
const AVERAGE_STEPS = 8; // read of the texture across one texel of the copy
const LIGHTS_MAX = 64; // that get shadow rays

/** Even over the sphere (spherical Fibonacci points), 3 numbers each. */
export const DIRECTIONS = Float64Array.from({ length: 3 * RAYS }, (_, at) => {
  const i = Math.floor(at / 3);
  const y = 1 - (2 * i + 1) / RAYS;
  const angle = i * Math.PI * (3 - Math.sqrt(5));
  return [Math.cos(angle) * Math.sqrt(1 - y * y), y, Math.sin(angle) * Math.sqrt(1 - y * y)][at % 3]!;
});

interface Hit {
  placed: Placed;
  triangle: number;
  b: number; // barycentric, of the second and third corner
  c: number;
}

type Three = [number, number, number];

/** A place of a lightmap that a ray meets. */
export interface Look {
  placed: Placed;
  u: number; // 0 to 1 in the lightmap
  v: number;
  distance: number;
  texels: number; // level 0, twice the triangle
  area: number; // twice the triangle, world space
  facing: number; // cosine between the ray and the triangle's normal
}

interface Lamp {
  kind: number;
  position: Float64Array; // the scene's space, as the next
  direction: Float64Array;
  intensity: Float64Array; // W/sr; W/m^2 of a sun
  innerCone: number;
  outerCone: number;
  isInTiles: boolean; // three's own lights do not give it
}

/** Row of the packed numbers of a material (geometry.ts). */
const row = (material: number, texel: number) => 4 * (MATERIAL_TEXELS * material + texel);

export class Gather {
  private readonly trees = new Map<THREE.BufferGeometry, Tree>();
  private readonly averages = new Map<number, Float32Array>(); // by texture
  private readonly lamps: Lamp[];
  private readonly textureOf: { base: number; glow: number }[] = []; // by material
  private readonly materials: Float32Array;
  private objects: Tree | null = null;
  private shown: Placed[] = []; // by item of `objects`
  private inverse: THREE.Matrix4[] = [];
  private sky = new Float64Array(3);
  private readonly e = new Float64Array(3);
  private readonly o = new THREE.Vector3(); // of a ray in an object's space, as the next three
  private readonly d = new THREE.Vector3();
  private readonly from = [0, 0, 0];
  private readonly to = [0, 0, 0];

  /** drawn: whether three's own light stands for a light of the server's. */
  constructor(
    private readonly data: SceneData,
    private readonly root: THREE.Object3D,
    private readonly placed: (Placed | null)[],
    drawn: (light: number) => boolean,
  ) {
    this.materials = data.materials.slice();
    for (const mesh of data.meshes)
      for (const { first, count, base, glow } of mesh.groups)
        for (let i = first; i < first + count; i += 3)
          this.textureOf[data.tag[data.index[i]!]! & 0xffff] ??= { base, glow };
    this.lamps = data.lights.map(({ kind, innerCone, outerCone }, i) => ({
      kind,
      innerCone,
      outerCone,
      position: new Float64Array(3),
      direction: new Float64Array([0, 0, -1]),
      intensity: new Float64Array(3),
      isInTiles: !drawn(i),
    }));
  }

  takeFrame(frame: Frame): void {
    this.sky.set(frame.sky);
    frame.light.forEach((index, i) => {
      const lamp = this.lamps[index];
      lamp?.position.set(frame.lightPosition.subarray(3 * i, 3 * i + 3));
      lamp?.direction.set(frame.lightDirection.subarray(3 * i, 3 * i + 3));
      lamp?.intensity.set(frame.lightIntensity.subarray(3 * i, 3 * i + 3));
    });
    frame.material.forEach((material, i) => {
      this.materials.set(frame.baseColour.subarray(3 * i, 3 * i + 3), row(material, 0));
      this.materials.set(frame.emission.subarray(3 * i, 3 * i + 3), row(material, 1));
    });
    if (frame.object.length || frame.hidden.length || frame.shown.length) this.objects = null;
  }

  /** Objects have moved, or are there or not. */
  forget(): void {
    this.objects = null;
  }

  private placeObjects(): Tree {
    this.shown = this.placed.filter((each): each is Placed => !!each?.mesh.visible);
    this.root.updateWorldMatrix(true, true);
    const boxes = new Float32Array(6 * this.shown.length);
    this.inverse = this.shown.map(({ mesh }, i) => {
      if (!mesh.geometry.boundingBox) mesh.geometry.computeBoundingBox();
      const { min, max } = mesh.geometry.boundingBox!.clone().applyMatrix4(mesh.matrixWorld);
      boxes.set([...min.toArray(), ...max.toArray()], 6 * i);
      return mesh.matrixWorld.clone().invert();
    });
    return new Tree(boxes);
  }

  private treeOf(geometry: THREE.BufferGeometry): Tree {
    let tree = this.trees.get(geometry);
    if (tree) return tree;
    const index = geometry.index!.array;
    const position = geometry.getAttribute('position').array;
    const boxes = new Float32Array(2 * index.length);
    for (let i = 0; i < index.length; i += 3)
      for (let k = 0; k < 3; k++) {
        const corners = [0, 1, 2].map((corner) => position[3 * index[i + corner]! + k]!);
        boxes[2 * i + k] = Math.min(...corners);
        boxes[2 * i + 3 + k] = Math.max(...corners);
      }
    this.trees.set(geometry, (tree = new Tree(boxes)));
    return tree;
  }

  /** The nearest triangle that a ray meets from its front, whatever its alpha. World space; within `far`
   * lengths of the direction. */
  private cast(origin: THREE.Vector3, direction: THREE.Vector3, far: number): Hit | null {
    const objects = (this.objects ??= this.placeObjects());
    let hit: Hit | null = null;
    const { o, d, from, to } = this;
    origin.toArray(from);
    direction.toArray(to);
    objects.trace(from.slice(), to.slice(), far, (item, nearest) => {
      const placed = this.shown[item]!;
      const inverse = this.inverse[item]!;
      o.copy(origin).applyMatrix4(inverse).toArray(from);
      // as long as it was, in the object's units
      d.copy(direction).add(origin).applyMatrix4(inverse).sub(o).toArray(to);
      const { geometry } = placed.mesh;
      return this.treeOf(geometry).trace(from, to, nearest, (triangle, before) => {
        const found = meet(geometry, triangle, from, to, before);
        if (!found) return before;
        hit = { placed, triangle, b: found.b, c: found.c };
        return found.t;
      });
    });
    return hit;
  }

  /** What a ray meets that has a lightmap; null: nothing, or without one. World space. */
  look(origin: THREE.Vector3, direction: THREE.Vector3): Look | null {
    const hit = this.cast(origin, direction, Infinity);
    const lightmap = hit?.placed.lightmap;
    if (!hit || !lightmap) return null;
    const { placed, triangle, b, c } = hit;
    const { geometry, matrixWorld } = placed.mesh;
    const uv = geometry.getAttribute('uv2').array;
    const position = geometry.getAttribute('position').array;
    const [i, j, k] = [0, 1, 2].map((each) => geometry.index!.array[3 * triangle + each]!) as Three;
    const { width, height } = lightmap;
    const [p, q, r] = [i, j, k].map((v) =>
      new THREE.Vector3().fromArray(position, 3 * v).applyMatrix4(matrixWorld),
    ) as [THREE.Vector3, THREE.Vector3, THREE.Vector3];
    const normal = q.clone().sub(p).cross(r.clone().sub(p)); // twice the triangle's area long
    const [u, v] = [uv[2 * i]!, uv[2 * i + 1]!];
    const [su, sv] = [uv[2 * j]! - u, uv[2 * j + 1]! - v];
    const [tu, tv] = [uv[2 * k]! - u, uv[2 * k + 1]! - v];
    return {
      placed,
      u: u + b * su + c * tu,
      v: v + b * sv + c * tv,
      distance: p
        .multiplyScalar(1 - b - c)
        .addScaledVector(q, b)
        .addScaledVector(r, c)
        .distanceTo(origin),
      texels: Math.abs(su * tv - sv * tu) * width * height,
      area: normal.length(),
      facing: Math.abs(normal.dot(direction)) / (normal.length() * direction.length() || 1),
    };
  }

  /** Adds the radiance that comes along a ray, W/(m^2 sr), times `scale`, to 3 numbers. */
  private addRadiance(
    origin: THREE.Vector3,
    direction: THREE.Vector3,
    scale: number,
    out: Float64Array,
  ): void {
    const hit = this.cast(origin, direction, Infinity);
    if (hit) this.addSurface(hit, scale, out);
    else this.addSky(direction, scale, out);
  }

  private addSky(direction: THREE.Vector3, scale: number, out: Float64Array): void {
    for (let k = 0; k < 3; k++) out[k]! += scale * this.sky[k]!;
    const { environment, lightUnit } = this.data;
    if (!environment) return;
    const { x, y, z } = direction.clone().applyQuaternion(this.rootTurn().invert());
    const { width, height, texels } = environment;
    const u = 0.5 + Math.atan2(z, x) / (2 * Math.PI);
    const v = Math.atan2(Math.hypot(x, z), y) / Math.PI;
    const column = Math.min(Math.floor(u * width), width - 1);
    const line = Math.min(Math.floor(v * height), height - 1);
    addTexel(texels[line * width + column]!, scale * lightUnit, out);
  }

  private rootTurn(): THREE.Quaternion {
    return this.root.getWorldQuaternion(new THREE.Quaternion());
  }

  private addSurface({ placed, triangle, b, c }: Hit, scale: number, out: Float64Array): void {
    const { geometry } = placed.mesh;
    const corner = 3 * triangle;
    const group = geometry.groups.find(({ start, count }) => corner < start + count)!;
    const material = (geometry.userData.materials as number[])[group.materialIndex!]!;
    if (this.materials[row(material, 5) + 3] === 1) return; // unlit: it lights nothing
    const read = (name: string, width: number): number[] | null => {
      const array = geometry.getAttribute(name)?.array;
      if (!array) return null;
      const [i, j, k] = [0, 1, 2].map((each) => width * geometry.index!.array[corner + each]!);
      const weigh = (at: number) => (1 - b - c) * array[i! + at]! + b * array[j! + at]! + c * array[k! + at]!;
      return Array.from({ length: width }, (_, at) => weigh(at));
    };
    const { base, glow } = this.textureOf[material] ?? { base: NONE, glow: NONE };
    const albedo = this.texel(material, base, 2, read);
    const colour = read('color', 4);
    const emitted = this.texel(material, glow, 4, read);
    this.e.fill(0);
    const uv = placed.lightmap && read('uv2', 2);
    if (uv) irradianceAt(placed.lightmap!, uv[0]!, uv[1]!, this.data.lightUnit, this.e);
    for (let k = 0; k < 3; k++) {
      const reflected = this.materials[row(material, 0) + k]! * albedo[k]! * (colour?.[k] ?? 1) * this.e[k]!;
      out[k]! += scale * (reflected / Math.PI + this.materials[row(material, 1) + k]! * emitted[k]!);
    }
  }

  /** A texture of a material at a hit, linear; white where there is none. at: texel of the transform's rows.
   * */
  private texel(
    material: number,
    texture: number,
    at: number,
    read: (name: string, width: number) => number[] | null,
  ): ArrayLike<number> {
    if (texture === NONE) return [1, 1, 1];
    const m = this.materials.subarray(row(material, at), row(material, at) + 8);
    const uv = read(m[3] === 1 ? 'uv1' : 'uv', 2);
    if (!uv) return [1, 1, 1];
    const u = m[0]! * uv[0]! + m[1]! * uv[1]! + m[2]!;
    const v = m[4]! * uv[0]! + m[5]! * uv[1]! + m[6]!;
    const { wrapS, wrapT } = this.data.textures[texture]!;
    const place = AVERAGE_SIDE * wrapped(v, wrapT) + wrapped(u, wrapS);
    const copy = this.averageOf(texture);
    return copy.subarray(3 * place, 3 * place + 3);
  }

  private averageOf(texture: number): Float32Array {
    let copy = this.averages.get(texture);
    if (copy) return copy;
    copy = new Float32Array(3 * AVERAGE_SIDE ** 2);
    const { width, height, rgba } = this.data.textures[texture]!;
    const side = AVERAGE_SIDE * AVERAGE_STEPS;
    for (let y = 0; y < side; y++)
      for (let x = 0; x < side; x++) {
        const from = 4 * (Math.floor((y * height) / side) * width + Math.floor((x * width) / side));
        const to = 3 * (Math.floor(y / AVERAGE_STEPS) * AVERAGE_SIDE + Math.floor(x / AVERAGE_STEPS));
        for (let k = 0; k < 3; k++) copy[to + k]! += linear(rgba[from + k]! / 255) / AVERAGE_STEPS ** 2;
      }
    this.averages.set(texture, copy);
    return copy;
  }

  /** Irradiance at a point on a surface of a normal, W/m^2, without what three's own lights give. World
   * space. */
  irradiance(point: THREE.Vector3, normal: THREE.Vector3): Float64Array {
    const out = new Float64Array(3);
    const direction = new THREE.Vector3();
    for (let i = 0; i < RAYS; i++) {
      direction.fromArray(DIRECTIONS, 3 * i);
      const cosine = direction.dot(normal);
      if (cosine > 0) this.addRadiance(point, direction, (4 * Math.PI * cosine) / RAYS, out);
    }
    this.eachLamp(point, (towards, e) => {
      const cosine = Math.max(0, towards.dot(normal));
      for (let k = 0; k < 3; k++) out[k]! += cosine * e[k]!;
    });
    return out;
  }

  /** Adds the radiance that comes to a point along directions [first, end) of all RAYS to spherical harmonics
   * of three's LightProbe; with the last one that of lights, too. */
  project(point: THREE.Vector3, sh: THREE.SphericalHarmonics3, first: number, end: number): void {
    const basis = new Array<number>(9);
    const direction = new THREE.Vector3();
    const out = new Float64Array(3);
    const add = (towards: THREE.Vector3, light: Float64Array) => {
      THREE.SphericalHarmonics3.getBasisAt(towards, basis);
      basis.forEach((value, i) => {
        const c = sh.coefficients[i]!;
        c.set(c.x + value * light[0]!, c.y + value * light[1]!, c.z + value * light[2]!);
      });
    };
    for (let i = first; i < end; i++) {
      out.fill(0);
      direction.fromArray(DIRECTIONS, 3 * i);
      this.addRadiance(point, direction, (4 * Math.PI) / RAYS, out);
      add(direction, out);
    }
    if (end === RAYS) this.eachLamp(point, add);
  }

  /** Those whose light is in the tiles and that nothing hides from a point: the direction to each, and its
   * irradiance on a surface that faces it, W/m^2. */
  private eachLamp(point: THREE.Vector3, take: (towards: THREE.Vector3, e: Float64Array) => void): void {
    const turn = this.rootTurn();
    const e = new Float64Array(3);
    const [towards, place, axis] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3()];
    for (const lamp of this.lamps.slice(0, LIGHTS_MAX)) {
      if (!lamp.isInTiles || !(lamp.intensity[0]! + lamp.intensity[1]! + lamp.intensity[2]! > 0)) continue;
      axis.fromArray(lamp.direction).applyQuaternion(turn).normalize();
      let [far, factor] = [Infinity, 1];
      if (lamp.kind === LightKind.DIRECTIONAL) towards.copy(axis).negate();
      else {
        place.fromArray(lamp.position);
        towards.copy(this.root.localToWorld(place)).sub(point);
        far = towards.length();
        factor = 1 / Math.max(far * far, 1e-6);
        towards.divideScalar(far || 1);
        if (lamp.kind === LightKind.SPOT) factor *= cone(lamp, -axis.dot(towards));
      }
      if (factor <= 0 || this.cast(point, towards, far)) continue;
      for (let k = 0; k < 3; k++) e[k] = factor * lamp.intensity[k]!;
      take(towards, e);
    }
  }
}

/** glTF's fall-off of spots. */
function cone({ innerCone, outerCone }: Lamp, cosine: number): number {
  const [inner, outer] = [Math.cos(innerCone), Math.cos(outerCone)];
  return Math.min(Math.max((cosine - outer) / Math.max(inner - outer, 1e-6), 0), 1) ** 2;
}

function linear(x: number): number {
  return x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4;
}

/** 0 repeat, 1 clamp, 2 mirror; a column or row of the small copy. */
function wrapped(x: number, wrap: number): number {
  const whole = Math.floor(x);
  let within = wrap === 1 ? Math.min(Math.max(x, 0), 1) : x - whole;
  if (wrap === 2 && whole & 1) within = 1 - within;
  return Math.min(Math.floor(within * AVERAGE_SIDE), AVERAGE_SIDE - 1) || 0;
}

/** Moeller and Trumbore 1997. Object space, where a front stays one under a mirror. */
function meet(
  geometry: THREE.BufferGeometry,
  triangle: number,
  o: number[],
  d: number[],
  nearest: number,
): { t: number; b: number; c: number } | null {
  const index = geometry.index!.array;
  const p = geometry.getAttribute('position').array;
  const [i, j, k] = [3 * index[3 * triangle]!, 3 * index[3 * triangle + 1]!, 3 * index[3 * triangle + 2]!];
  const [ux, uy, uz] = [p[j]! - p[i]!, p[j + 1]! - p[i + 1]!, p[j + 2]! - p[i + 2]!];
  const [vx, vy, vz] = [p[k]! - p[i]!, p[k + 1]! - p[i + 1]!, p[k + 2]! - p[i + 2]!];
  const [qx, qy, qz] = [d[1]! * vz - d[2]! * vy, d[2]! * vx - d[0]! * vz, d[0]! * vy - d[1]! * vx];
  const determinant = ux * qx + uy * qy + uz * qz;
  if (!(determinant > 0)) return null; // from behind, or along it
  const [sx, sy, sz] = [o[0]! - p[i]!, o[1]! - p[i + 1]!, o[2]! - p[i + 2]!];
  const b = (sx * qx + sy * qy + sz * qz) / determinant;
  if (b < 0 || b > 1) return null;
  const [rx, ry, rz] = [sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux];
  const c = (d[0]! * rx + d[1]! * ry + d[2]! * rz) / determinant;
  if (c < 0 || b + c > 1) return null;
  const t = (vx * rx + vy * ry + vz * rz) / determinant;
  return t > 0 && t < nearest ? { t, b, c } : null;
}
