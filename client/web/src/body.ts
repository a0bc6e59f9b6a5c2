// body.ts: the box of nearly all triangles, without the ground that goes on to the horizon: what a view of a
// scene without a camera shows; as find_body() of client/paths/camera_default.c.
import type { Vec3 } from './camera.ts';
import type { Box } from './lights.ts';
import { NONE, type Scene } from './package.ts';
import { nodeToWorld } from './pose.ts';

const SAMPLES = 1024; // triangles that stand for all
const STRAY = 0.02; // of their corners are left out at each end of an axis
const MARGIN = 0.1; // added at each end for that

/** Objects that the animation does not move. */
function stillObjects(scene: Scene): number[] {
  const moves = new Set(scene.channels.map((channel) => channel.node));
  const isStill = (node: number): boolean =>
    node === NONE || (!moves.has(node) && isStill(scene.nodes[node]!.parent));
  return [...scene.objectNode.keys()].filter((o) => {
    const node = scene.objectNode[o]!;
    return node !== NONE && isStill(node);
  });
}

/** World space, a little wider than the triangles that it is found by; null: none stands still. */
export function findBody(scene: Scene): Box | null {
  const objects = stillObjects(scene);
  const trianglesOf = (object: number) => scene.meshes[scene.objectMesh[object]!]!.triangleCount;
  const total = objects.reduce((sum, object) => sum + trianglesOf(object), 0);
  if (!total) return null;
  const step = Math.ceil(total / SAMPLES);
  const at: [number[], number[], number[]] = [[], [], []];
  let passed = 0;
  for (const object of objects) {
    const mesh = scene.meshes[scene.objectMesh[object]!]!;
    const m = nodeToWorld(scene, scene.objectNode[object]!, 0);
    const place = (vertex: number, k: number) =>
      [0, 1, 2].reduce((sum, i) => sum + m[4 * k + i]! * mesh.position[3 * vertex + i]!, m[4 * k + 3]!);
    for (let t = (step - (passed % step)) % step; t < mesh.triangleCount; t += step)
      for (let corner = 0; corner < 3; corner++)
        for (const k of [0, 1, 2] as const) at[k].push(place(mesh.triangle[3 * t + corner]!, k));
    passed += mesh.triangleCount;
  }
  const ends = at.map((values) => {
    values.sort((a, b) => a - b);
    const stray = Math.floor(STRAY * values.length);
    const [low, high] = [values[stray]!, values[values.length - 1 - stray]!];
    const margin = MARGIN * (high - low);
    return [low - margin, high + margin] as const;
  });
  return { low: ends.map(([low]) => low) as Vec3, high: ends.map(([, high]) => high) as Vec3 };
}
