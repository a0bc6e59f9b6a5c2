// pose.ts: where nodes are at a time: glTF's transforms and animation, as common/scene/pose.c has them.
import type { Channel, Node, Scene } from './package.ts';
import { NONE } from './package.ts';

/** Rows of a 3 x 4 matrix. */
export type Affine = ArrayLike<number>;

function multiply(a: Affine, b: Affine): Float64Array {
  const out = new Float64Array(12);
  for (let i = 0; i < 3; i++)
    for (let j = 0; j < 4; j++)
      out[4 * i + j] =
        a[4 * i]! * b[j]! +
        a[4 * i + 1]! * b[4 + j]! +
        a[4 * i + 2]! * b[8 + j]! +
        (j === 3 ? a[4 * i + 3]! : 0);
  return out;
}

function normalized(q: number[]): number[] {
  const length = Math.hypot(...q);
  return length > 1e-30 ? q.map((x) => x / length) : [0, 0, 0, 1];
}

function slerp(a: number[], b: number[], t: number): number[] {
  let dot = a.reduce((sum, x, i) => sum + x * b[i]!, 0);
  const sign = dot < 0 ? -1 : 1;
  dot = Math.min(1, dot * sign);
  let [wa, wb] = [1 - t, t];
  if (dot < 0.9995) {
    const angle = Math.acos(dot);
    [wa, wb] = [Math.sin((1 - t) * angle) / Math.sin(angle), Math.sin(t * angle) / Math.sin(angle)];
  }
  return a.map((x, i) => wa * x + sign * wb * b[i]!);
}

function evaluate(channel: Channel, timeS: number): number[] {
  const width = channel.path === 1 ? 4 : 3;
  const cubic = channel.interpolation === 2;
  const stride = cubic ? 3 * width : width;
  const { time, value } = channel;
  let k = 0;
  while (k + 1 < time.length && time[k + 1]! <= timeS) k++;
  const at = (key: number, part: number) =>
    Array.from(value.subarray(key * stride + part * width, key * stride + (part + 1) * width));
  const own = at(k, cubic ? 1 : 0);
  let result = own;
  if (timeS > time[k]! && k + 1 < time.length && channel.interpolation !== 0) {
    const interval = time[k + 1]! - time[k]!;
    const t = (timeS - time[k]!) / interval;
    const next = at(k + 1, cubic ? 1 : 0);
    if (cubic) {
      const [leave, arrive] = [at(k, 2), at(k + 1, 0)];
      const [t2, t3] = [t * t, t * t * t];
      result = own.map(
        (x, i) =>
          (2 * t3 - 3 * t2 + 1) * x +
          interval * (t3 - 2 * t2 + t) * leave[i]! +
          (3 * t2 - 2 * t3) * next[i]! +
          interval * (t3 - t2) * arrive[i]!,
      );
    } else if (width === 4) result = slerp(own, next, t);
    else result = own.map((x, i) => (1 - t) * x + t * next[i]!);
  }
  return width === 4 ? normalized(result) : result;
}

function compose(translation: number[], q: number[], s: number[]): number[] {
  const [x, y, z, w] = normalized(q) as [number, number, number, number];
  const [sx, sy, sz] = s as [number, number, number];
  const [px, py, pz] = translation as [number, number, number];
  // prettier-ignore
  return [
    (1 - 2 * (y * y + z * z)) * sx, 2 * (x * y - z * w) * sy, 2 * (x * z + y * w) * sz, px,
    2 * (x * y + z * w) * sx, (1 - 2 * (x * x + z * z)) * sy, 2 * (y * z - x * w) * sz, py,
    2 * (x * z - y * w) * sx, 2 * (y * z + x * w) * sy, (1 - 2 * (x * x + y * y)) * sz, pz,
  ];
}

/** A node's transform to world at a time of the animation, which loops. */
export function nodeToWorld(scene: Scene, node: number, timeS: number): Affine {
  const wrapped = scene.durationS > 0 ? timeS - Math.floor(timeS / scene.durationS) * scene.durationS : 0;
  const local = (index: number): Affine => {
    const n: Node = scene.nodes[index]!;
    const of = (path: number, fixed: Float32Array): number[] => {
      const channel = scene.channels.find((each) => each.node === index && each.path === path);
      return channel ? evaluate(channel, wrapped) : Array.from(fixed);
    };
    return n.matrix ?? compose(of(0, n.translation), of(1, n.rotation), of(2, n.scale));
  };
  let toWorld = local(node);
  for (let up = scene.nodes[node]!.parent; up !== NONE; up = scene.nodes[up]!.parent)
    toWorld = multiply(local(up), toWorld);
  return toWorld;
}
