// clusters.ts: small emissive meshes as lamps: which triangles are one, and how bright it is in each
// direction; as client/view/lights/emitter_clusters.h from afar. The renderer draws their light with a shadow
// map.
// Flow:   scene, frames -> [clusters] -> lights.ts
import { LAMPS_MAX, SUNS_MAX } from './limits.ts';
import { AlphaMode, type Light, LightKind, type Material, NONE, type Scene } from './package.ts';
import { nodeToWorld } from './pose.ts';
import type { Frame } from './wire.ts';

/** Values along a side of a map of intensity by direction, which is an octahedron laid flat. */
export const MAP_SIDE = 17;
const DIRECTIONS = MAP_SIDE * MAP_SIDE;
/** Pieces of an object that share a box of this side are one lamp, m. */
const TOGETHER = 0.4;
/** What stands within this many radii of a lamp is part of it. */
const REACH = 1.5;
/** Places on a lamp from which rays look for what stands close to it. */
const POINTS = 24;
/** Of these a ray looks at all, or else only at the first: a lamp in a thicket must not stop the page. */
const NEAR_MAX = 4000;
const MEAN_SIDE = 8; // of the grid of points over a triangle that give its mean

export interface Cluster {
  centre: number[]; // of a ball around it, world space, m
  radius: number;
  reach: number;
  colour: number[]; // of unit luminance
  intensity: number; // the most in any direction, luminance, W/sr
  shapes: Float32Array; // luminance by direction, W/sr: behind what stands close, and without that
}

/** Whether the page has maps for the lights whose bits are set, and these clusters. */
export function fitsMaps(lights: Light[], drawn: Uint8Array, clusters: number): boolean {
  const those = lights.filter((_, i) => (drawn[i >> 3]! >> (i & 7)) & 1);
  const suns = those.filter(({ kind }) => kind === LightKind.DIRECTIONAL).length;
  return suns <= SUNS_MAX && those.length - suns + clusters <= LAMPS_MAX;
}

interface Emitter {
  object: number;
  material: number;
  corner: number; // of the mesh's triangles: the first
  share: number[]; // of its material's emission, mean over it
}

const luminance = (c: ArrayLike<number>) => 0.2126 * c[0]! + 0.7152 * c[1]! + 0.0722 * c[2]!;
const fromSrgb = (x: number) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);

const STEPS = MAP_SIDE - 1;

/** The direction of a place in the map, in steps. */
const direction = (column: number, row: number) => {
  let [x, y] = [column, row].map((at) => (2 * at) / STEPS - 1) as [number, number];
  const z = 1 - Math.abs(x) - Math.abs(y);
  if (z < 0) [x, y] = [(1 - Math.abs(y)) * (x < 0 ? -1 : 1), (1 - Math.abs(x)) * (y < 0 ? -1 : 1)];
  const length = Math.hypot(x, y, z);
  return [x / length, y / length, z / length] as const;
};

/** The directions of a grid of places: the values of the map, or the middles of its cells. */
const grid = (side: number, first: number) =>
  Array.from({ length: side * side }, (_, k) => direction((k % side) + first, Math.floor(k / side) + first));
const directions = grid(MAP_SIDE, 0);
const middles = grid(STEPS, 0.5);

/** Of the emitters that share a key, or are joined by one, the first is the root. */
class Forest {
  private readonly parent: number[];
  private readonly first = new Map<string, number>();

  constructor(count: number) {
    this.parent = Array.from({ length: count }, (_, i) => i);
  }

  root(i: number): number {
    while (this.parent[i] !== i) i = this.parent[i] = this.parent[this.parent[i]!]!;
    return i;
  }

  join(key: string, i: number): void {
    const other = this.root(this.first.get(key) ?? i);
    this.first.set(key, other);
    const own = this.root(i);
    this.parent[Math.max(own, other)] = Math.min(own, other);
  }
}

export class Clusters {
  private readonly toWorld: ArrayLike<number>[]; // by object: rows of 3 x 4
  private readonly hidden: Uint8Array;
  private readonly emission: Float32Array[]; // by material
  private readonly emitters: Emitter[] = [];
  private readonly members: Emitter[][] = [];
  private readonly stale = new Set<number>();
  private readonly placed: Cluster[] = [];

  /** materials: a bit for each; those that are set are lamps. Textures must be there now, but not later. */
  constructor(
    private readonly scene: Scene,
    materials: Uint8Array,
  ) {
    this.toWorld = Array.from(scene.objectNode, (node) =>
      node === NONE ? [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0] : nodeToWorld(scene, node, 0),
    );
    this.hidden = Uint8Array.from(scene.objectNode, (node) => (node === NONE ? 1 : 0));
    this.emission = scene.materials.map((material) => material.emission.slice());
    scene.objectMesh.forEach((index, object) => {
      const mesh = scene.meshes[index]!;
      mesh.material.forEach((material, t) => {
        if (!((materials[material >> 3]! >> (material & 7)) & 1)) return;
        this.emitters.push({ object, material, corner: 3 * t, share: this.shareOf(index, t) });
      });
    });
    this.find();
  }

  count(): number {
    return this.members.length;
  }

  // ---- which triangles are one ----

  /** How much of its emission a triangle sends out, by its textures. */
  private shareOf(index: number, t: number): number[] {
    const mesh = this.scene.meshes[index]!;
    const m = this.scene.materials[mesh.material[t]!]!;
    if (m.glow.texture === NONE && m.alphaMode === AlphaMode.OPAQUE) return [1, 1, 1];
    const sum = [0, 0, 0];
    let count = 0;
    for (let i = 0; i < MEAN_SIDE; i++)
      for (let j = 0; j < MEAN_SIDE - i; j++, count++) {
        const at = [(i + 1 / 3) / MEAN_SIDE, (j + 1 / 3) / MEAN_SIDE] as const;
        const texel = (use: Material['base']) => {
          const texture = this.scene.textures[use.texture];
          const uv = mesh.uv[use.uvSet as 0];
          if (!texture || !uv) return [1, 1, 1, 1];
          const [a, b, c] = [0, 1, 2].map((k) => 2 * mesh.triangle[3 * t + k]!) as [number, number, number];
          const x = [0, 1].map(
            (k) => uv[a + k]! + at[0] * (uv[b + k]! - uv[a + k]!) + at[1] * (uv[c + k]! - uv[a + k]!),
          );
          const place = [0, 3].map((row, k) => {
            const u = use.transform[row]! * x[0]! + use.transform[row + 1]! * x[1]! + use.transform[row + 2]!;
            const side = k ? texture.height : texture.width;
            return Math.min(side - 1, Math.floor((u - Math.floor(u)) * side));
          });
          const first = 4 * (place[1]! * texture.width + place[0]!);
          return Array.from(texture.rgba.subarray(first, first + 4), (x) => x / 255);
        };
        let alpha = m.baseColour[3]! * texel(m.base)[3]!;
        if (m.alphaMode === AlphaMode.OPAQUE) alpha = 1;
        if (m.alphaMode === AlphaMode.MASK) alpha = alpha < m.alphaCutoff ? 0 : 1;
        texel(m.glow).forEach((x, c) => c < 3 && (sum[c]! += alpha * fromSrgb(x)));
      }
    return sum.map((x) => x / count);
  }

  private find(): void {
    const { scene, emitters } = this;
    const touching = new Forest(emitters.length);
    const cornersOf = emitters.map((e) => this.cornersOf(e));
    emitters.forEach((e, i) => {
      const mesh = scene.meshes[scene.objectMesh[e.object]!]!;
      for (let k = 0; k < 3; k++) {
        const at = 3 * mesh.triangle[e.corner + k]!;
        touching.join(`${e.object} ${e.material} ${mesh.position.subarray(at, at + 3).join()}`, i);
      }
    });
    const boxes = new Map<number, number[]>();
    cornersOf.forEach((corners, i) => {
      const root = touching.root(i);
      const box = boxes.get(root) ?? [Infinity, Infinity, Infinity, -Infinity, -Infinity, -Infinity];
      boxes.set(root, widen(box, corners));
    });
    const together = new Forest(emitters.length);
    emitters.forEach((e, i) => {
      const root = touching.root(i);
      const box = boxes.get(root)!;
      together.join(`${root}`, i);
      if ([0, 1, 2].some((k) => box[k + 3]! - box[k]! > TOGETHER)) return;
      const cell = [0, 1, 2].map((k) => Math.floor((box[k]! + box[k + 3]!) / 2 / TOGETHER));
      together.join(`${e.object} ${e.material} cell ${cell.join()}`, i);
    });
    const clusters = new Map<number, Emitter[]>();
    emitters.forEach((e, i) => {
      const root = together.root(i);
      if (!clusters.has(root)) clusters.set(root, []);
      clusters.get(root)!.push(e);
    });
    for (const members of clusters.values()) this.members.push(members);
    this.members.forEach((_, i) => this.stale.add(i));
  }

  /** Nine numbers, world space. */
  private cornersOf(e: Emitter): number[] {
    const mesh = this.scene.meshes[this.scene.objectMesh[e.object]!]!;
    return [0, 1, 2].flatMap((k) =>
      apply(this.toWorld[e.object]!, mesh.position, 3 * mesh.triangle[e.corner + k]!),
    );
  }

  // ---- what changes ----

  /** Takes over what has moved or shines otherwise. */
  takeFrame(frame: Frame): void {
    const moved: number[] = [];
    const touch = (object: number) => {
      moved.push(object);
      this.staleNear(object);
    };
    frame.object.forEach((object, i) => {
      const row = frame.transform.subarray(12 * i, 12 * i + 12);
      if (row.every((x, k) => x === this.toWorld[object]![k])) return;
      this.staleNear(object);
      this.toWorld[object] = row.slice();
      touch(object);
    });
    for (const [list, value] of [
      [frame.hidden, 1],
      [frame.shown, 0],
    ] as const)
      for (const object of list)
        if (this.hidden[object] !== value) {
          this.hidden[object] = value;
          touch(object);
        }
    const changed = new Set<number>();
    frame.material.forEach((material, i) => {
      const emission = frame.emission.slice(3 * i, 3 * i + 3);
      if (emission.every((x, k) => x === this.emission[material]![k])) return;
      this.emission[material] = emission;
      changed.add(material);
    });
    const objects = new Set(moved);
    this.members.forEach((members, i) => {
      if (members.some((e) => objects.has(e.object) || changed.has(e.material))) this.stale.add(i);
    });
  }

  /** Lamps that something stands close to, or did. */
  private staleNear(object: number): void {
    const box = this.boxOf(object);
    this.placed.forEach((cluster, i) => {
      if (isClose(box, cluster.centre, cluster.reach)) this.stale.add(i);
    });
  }

  /** An object's vertices' box, world space; a box of the box of its mesh is good enough. */
  private boxOf(object: number): number[] {
    const mesh = this.scene.meshes[this.scene.objectMesh[object]!]!;
    let box = this.meshBox.get(mesh.position);
    if (!box) {
      box = widen([Infinity, Infinity, Infinity, -Infinity, -Infinity, -Infinity], mesh.position);
      this.meshBox.set(mesh.position, box);
    }
    const corners: number[] = [];
    for (let corner = 0; corner < 8; corner++)
      corners.push(
        ...apply(
          this.toWorld[object]!,
          [0, 1, 2].map((k) => box[k + (corner & (1 << k) ? 3 : 0)]!),
          0,
        ),
      );
    return widen([Infinity, Infinity, Infinity, -Infinity, -Infinity, -Infinity], corners);
  }
  private readonly meshBox = new Map<Float32Array, number[]>();

  /** The lamps, if any is another than at the last call. */
  take(): Cluster[] | null {
    if (!this.stale.size) return null;
    for (const i of this.stale) this.placed[i] = this.place(this.members[i]!);
    this.stale.clear();
    return [...this.placed];
  }

  // ---- one lamp ----

  private place(members: Emitter[]): Cluster {
    const sides: { power: number; normal: number[]; corners: number[] }[] = [];
    const sum = [0, 0, 0];
    let box = [Infinity, Infinity, Infinity, -Infinity, -Infinity, -Infinity];
    for (const e of members) {
      const corners = this.cornersOf(e);
      box = widen(box, corners);
      const [u, v] = [3, 6].map((at) => [0, 1, 2].map((k) => corners[at + k]! - corners[k]!)) as [
        number[],
        number[],
      ];
      const normal = cross(u, v);
      const twice = Math.hypot(...normal);
      const radiance = e.share.map((x, c) => x * this.emission[e.material]![c]!);
      const power = (luminance(radiance) * twice) / 2;
      if (this.hidden[e.object] || !(power > 0 && power < Infinity)) continue;
      radiance.forEach((x, c) => (sum[c]! += (x * twice) / 2));
      const sign = determinant(this.toWorld[e.object]!) < 0 ? -1 : 1;
      const outward = normal.map((x) => (sign * x) / twice);
      sides.push({ power, normal: outward, corners });
      if (this.scene.materials[e.material]!.doubleSided)
        sides.push({ power, normal: outward.map((x) => -x), corners });
    }
    const centre = [0, 1, 2].map((k) => (box[k]! + box[k + 3]!) / 2);
    const radius = Math.hypot(...[0, 1, 2].map((k) => box[k + 3]! - box[k]!)) / 2;
    const shapes = new Float32Array(2 * DIRECTIONS);
    const open = shapes.subarray(DIRECTIONS);
    const shine = (d: readonly number[]) =>
      sides.reduce((all, side) => all + side.power * Math.max(0, dot(side.normal, d)), 0);
    directions.forEach((d, k) => (open[k] = shine(d)));
    // Between its values a map has their means, which are less than a curved intensity has there. The mean
    // over all places is right by Simpson's rule in each cell, as in emitter_clusters.c.
    let [between, mean] = [0, 0];
    middles.forEach((d, k) => {
      between += shine(d);
      for (const i of [0, 1, MAP_SIDE, MAP_SIDE + 1]) mean += open[k + Math.floor(k / STEPS) + i]! / 4;
    });
    directions.forEach((_, k) => (shapes[k] = open[k]! *= (1 + (2 * between) / (mean || 1)) / 3));
    const all = luminance(sum);
    const cluster: Cluster = {
      centre,
      radius,
      reach: REACH * radius,
      colour: sum.map((x) => (all > 0 ? x / all : 0)),
      intensity: open.reduce((a, b) => Math.max(a, b), 0),
      shapes,
    };
    if (cluster.intensity > 0) this.shade(cluster, sides);
    return cluster;
  }

  /** Takes out of the first map what stands close to the lamp. */
  private shade(cluster: Cluster, sides: { power: number; normal: number[]; corners: number[] }[]): void {
    const { centre, reach, shapes } = cluster;
    const near = this.trianglesNear(centre, reach);
    const total = sides.reduce((sum, side) => sum + side.power, 0);
    const points: { at: number[]; normal: number[] }[] = [];
    let running = 0;
    for (const { power, normal, corners } of sides) {
      running += power;
      while (points.length < POINTS && ((points.length + 0.5) / POINTS) * total <= running) {
        // places on the triangle by the golden ratio's steps
        const [a, b] = [(points.length * 0.618034) % 1, (points.length * 0.7548777) % 1] as const;
        const [u, v] = a + b > 1 ? [1 - a, 1 - b] : [a, b];
        const at = [0, 1, 2].map(
          (k) =>
            corners[k]! +
            u * (corners[3 + k]! - corners[k]!) +
            v * (corners[6 + k]! - corners[k]!) +
            1e-4 * reach * normal[k]! -
            centre[k]!,
        );
        points.push({ at, normal });
      }
    }
    directions.forEach((d, k) => {
      let [all, seen] = [0, 0];
      for (const { at, normal } of points) {
        const cosine = dot(normal, d);
        if (cosine <= 0) continue;
        all += cosine;
        const along = dot(at, d);
        const left = along * along - dot(at, at) + reach * reach;
        seen += cosine * (left > 0 ? passes(near, at, d, Math.sqrt(left) - along) : 1);
      }
      if (all > 0) shapes[k]! *= seen / all;
    });
  }

  /** Triangles that reach into a ball, about its middle: a corner, two edges, and how much light each lets
   * pass. */
  private trianglesNear(centre: number[], reach: number): number[] {
    const { scene } = this;
    const out: number[] = [];
    scene.objectMesh.forEach((index, object) => {
      const t = this.toWorld[object]!;
      if (this.hidden[object] || !isClose(this.boxOf(object), centre, reach)) return;
      const mesh = scene.meshes[index]!;
      const { position, triangle } = mesh;
      const ball = localBox(t, centre, reach);
      for (let i = 0; i < triangle.length && out.length < 10 * NEAR_MAX; i += 3) {
        const [a, b, c] = [3 * triangle[i]!, 3 * triangle[i + 1]!, 3 * triangle[i + 2]!];
        let apart = false;
        for (let k = 0; k < 3; k++) {
          const [x, y, z] = [position[a + k]!, position[b + k]!, position[c + k]!];
          apart ||= Math.min(x, y, z) > ball[k + 3]! || Math.max(x, y, z) < ball[k]!;
        }
        if (apart) continue;
        const [p, q, r] = [a, b, c].map((at) => apply(t, position, at)) as [number[], number[], number[]];
        const m = scene.materials[mesh.material[i / 3]!]!;
        p.forEach((x, k) => out.push(x - centre[k]!));
        for (const end of [q, r]) end.forEach((x, k) => out.push(x - p[k]!));
        out.push(m.alphaMode === AlphaMode.BLEND ? 1 - m.baseColour[3]! : 0);
      }
    });
    return out;
  }
}

/** The share of light that passes triangles along a ray (Möller and Trumbore 1997). */
function passes(near: number[], from: number[], d: readonly number[], end: number): number {
  let share = 1;
  for (let i = 0; i < near.length; i += 10) {
    const [ux, uy, uz, vx, vy, vz] = [
      near[i + 3]!,
      near[i + 4]!,
      near[i + 5]!,
      near[i + 6]!,
      near[i + 7]!,
      near[i + 8]!,
    ];
    const [px, py, pz] = [d[1]! * vz - d[2]! * vy, d[2]! * vx - d[0]! * vz, d[0]! * vy - d[1]! * vx];
    const det = ux * px + uy * py + uz * pz;
    if (det === 0) continue;
    const [sx, sy, sz] = [from[0]! - near[i]!, from[1]! - near[i + 1]!, from[2]! - near[i + 2]!];
    const u = (sx * px + sy * py + sz * pz) / det;
    if (u < 0 || u > 1) continue;
    const [qx, qy, qz] = [sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux];
    const v = (d[0]! * qx + d[1]! * qy + d[2]! * qz) / det;
    if (v < 0 || u + v > 1) continue;
    const t = (vx * qx + vy * qy + vz * qz) / det;
    if (t > 0 && t < end) share *= near[i + 9]!;
    if (share === 0) return 0;
  }
  return share;
}

const dot = (a: ArrayLike<number>, b: ArrayLike<number>) => a[0]! * b[0]! + a[1]! * b[1]! + a[2]! * b[2]!;

function cross(a: number[], b: number[]): number[] {
  return [0, 1, 2].map((k) => a[(k + 1) % 3]! * b[(k + 2) % 3]! - a[(k + 2) % 3]! * b[(k + 1) % 3]!);
}

function determinant(m: ArrayLike<number>): number {
  const row = (i: number) => [m[4 * i]!, m[4 * i + 1]!, m[4 * i + 2]!];
  return dot(row(0), cross(row(1), row(2)));
}

function apply(m: ArrayLike<number>, from: ArrayLike<number>, at: number): number[] {
  const [x, y, z] = [from[at]!, from[at + 1]!, from[at + 2]!];
  return [0, 4, 8].map((row) => m[row]! * x + m[row + 1]! * y + m[row + 2]! * z + m[row + 3]!);
}

/** A box around a ball as an object sees it. */
function localBox(m: ArrayLike<number>, centre: number[], reach: number): number[] {
  const row = (i: number) => [m[4 * i]!, m[4 * i + 1]!, m[4 * i + 2]!];
  const from = centre.map((x, i) => x - m[4 * i + 3]!);
  // rows of the inverse are columns of the cofactors
  const cofactors = [0, 1, 2].map((i) => cross(row((i + 1) % 3), row((i + 2) % 3)));
  const det = dot(row(0), cofactors[0]!);
  const box: number[] = [];
  for (let k = 0; k < 3; k++) {
    const inverse = cofactors.map((column) => (det ? column[k]! / det : 0));
    const [middle, half] = [dot(inverse, from), det ? reach * Math.hypot(...inverse) : Infinity];
    [box[k], box[k + 3]] = [middle - half, middle + half];
  }
  return box;
}

/** low x, y, z, high x, y, z */
function widen(box: number[], points: ArrayLike<number>): number[] {
  for (let i = 0; i < points.length; i++) {
    box[i % 3] = Math.min(box[i % 3]!, points[i]!);
    box[(i % 3) + 3] = Math.max(box[(i % 3) + 3]!, points[i]!);
  }
  return box;
}

function isClose(box: number[], p: number[], m: number): boolean {
  return p.every((x, k) => x >= box[k]! - m && x <= box[k + 3]! + m);
}
