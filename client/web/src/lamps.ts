// lamps.ts: what shines in a scene, by name, and the changes that make it brighter or darker.
import type { Scene } from './package.ts';
import type { Change } from './wire.ts';

const LAMPS_MAX = 32;

const Kind = { LIGHT_INTENSITY: 5, LIGHT_RESTORE: 8, MATERIAL_EMISSION: 10, MATERIAL_RESTORE: 11 } as const;

/** Lights and emissive materials that share a name: they change together. */
export interface Lamp {
  name: string;
  lights: number[];
  materials: number[];
}

/** The first of them, in the scene's order. */
export function lampsOf(scene: Scene): Lamp[] {
  const lamps = new Map<string, Lamp>();
  const add = (name: string, list: 'lights' | 'materials', index: number) => {
    if (!lamps.has(name)) lamps.set(name, { name, lights: [], materials: [] });
    lamps.get(name)![list].push(index);
  };
  scene.lights.forEach((light, index) => add(light.name, 'lights', index));
  scene.materials.forEach((material, index) => {
    if (material.emission.some((value) => value > 0)) add(material.name, 'materials', index);
  });
  return [...lamps.values()].slice(0, LAMPS_MAX);
}

/** factor: 1 is as the scene has it. */
export function changesOf(scene: Scene, lamp: Lamp, factor: number): Change[] {
  const as = (kind: number, restore: number, of: number[], value: (index: number) => Float32Array) =>
    of.map((target) =>
      factor === 1
        ? { kind: restore, target, values: [] }
        : { kind, target, values: Array.from(value(target), (x) => factor * x) },
    );
  return [
    ...as(Kind.LIGHT_INTENSITY, Kind.LIGHT_RESTORE, lamp.lights, (i) => scene.lights[i]!.intensity),
    ...as(Kind.MATERIAL_EMISSION, Kind.MATERIAL_RESTORE, lamp.materials, (i) => scene.materials[i]!.emission),
  ];
}
