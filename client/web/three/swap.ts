// swap.ts: puts the server's meshes, with their lightmaps, in the place of those of a glTF that GLTFLoader
// has loaded, and puts the loaded ones back. An original glTF has no coordinates for lightmaps, and other
// vertices.
import * as THREE from 'three';

import { MATERIAL_TEXELS, type MeshShape, type SceneData } from '../src/geometry.ts';
import { LightKind } from '../src/package.ts';
import type { FinePool, FinerUniforms } from './fine_pool.ts';
import { CHANNEL, emptyMap, lightmapOf, type Lightmap, UNKNOWN } from './lightmaps.ts';
import { type DirectionUniforms, materialsOf, readsDirections, withServersLight } from './materials.ts';
import type { ShadingNodes } from './nodes.ts';

const COLOUR_EPS = 1e-3; // of a light's colours, relative

/** An object of the server's in the scene. */
export interface Placed {
  mesh: THREE.Mesh;
  materials: { material: THREE.Material; index: number }[]; // of the mesh; index: of the server's
  lightmap: Lightmap | null;
  directions: Directions | null; // null: none of its materials reads them
  sphere: THREE.Sphere; // object space
  texels: number; // of level 0 to a unit of length
}

/** Where the light of an object's lightmap comes from. */
export interface Directions {
  uniforms: DirectionUniforms;
  map: Lightmap | null; // by half and a half more; null: none has come
}

/** What has been done to a scene, to be undone from the last to the first. */
export class Changes {
  private readonly undo: (() => void)[] = [];

  /** Sets properties; remembers what they were, and whether they were there. */
  set<T extends object>(target: T, values: Partial<T>): void {
    for (const name of Object.keys(values) as (keyof T)[]) {
      const [own, before] = [Object.hasOwn(target, name), target[name]];
      this.undo.push(() => {
        if (own) target[name] = before;
        else delete target[name];
      });
      target[name] = values[name]!;
    }
  }

  add(undo: () => void): void {
    this.undo.push(undo);
  }

  restore(): void {
    for (const undo of this.undo.splice(0).reverse()) undo();
  }
}

/** GLTFLoader changes some names, and keeps the file's here. */
export function nameOf(node: THREE.Object3D): string {
  return (node.userData.name as string | undefined) ?? node.name;
}

/** By object; null: the scene has no node of that name, which `missing` gets. pool: of tiles of finer levels;
 * null: there are none. directed: tiles say where their light comes from. tsl: for WebGPURenderer to read
 * that. */
export function placeObjects(
  data: SceneData,
  root: THREE.Object3D,
  changes: Changes,
  missing: string[],
  pool: FinePool | null,
  directed: boolean,
  tsl: ShadingNodes | null,
): (Placed | null)[] {
  const nodes = new Map<string, THREE.Object3D>();
  root.traverse((node) => {
    const name = nameOf(node);
    if (name && !nodes.has(name)) nodes.set(name, node);
  });
  const names = new Set(data.objectName);
  const geometries = new Map<number, THREE.BufferGeometry>();
  const unknown = directed ? emptyMap(1, 1, UNKNOWN).texture : null;
  if (unknown) changes.add(() => unknown.dispose());
  return Array.from(data.objectMesh, (index, object) => {
    const node = nodes.get(data.objectName[object]!);
    if (!node) {
      missing.push(data.objectName[object]!);
      return null;
    }
    const shape = data.meshes[index]!;
    if (!geometries.has(index)) {
      const geometry = geometryOf(data, shape);
      geometries.set(index, geometry);
      changes.add(() => geometry.dispose());
    }
    const finer = pool?.uniformsOf(object) ?? null;
    const directions = unknown && {
      lightwellDirections: { value: unknown },
      lightwellRoot: { value: root.matrixWorld },
    };
    return place(node, geometries.get(index)!, data, shape, names, changes, finer, directions, tsl);
  });
}

/** A mesh of the package. Double-sided triangles are there twice, as their backs have light of their own. */
function geometryOf(data: SceneData, shape: MeshShape): THREE.BufferGeometry {
  const { firstVertex, vertexCount, atlasWidth, atlasHeight, backOffset } = shape;
  const sides = shape.groups.some((group) => group.doubleSided) ? 2 : 1;
  const geometry = new THREE.BufferGeometry();
  const put = (
    name: string,
    from: ArrayLike<number> | null,
    width: number,
    stride: number,
    value?: (x: number, k: number, back: boolean) => number,
  ) => {
    if (!from) return;
    const values = new Float32Array(width * vertexCount * sides);
    for (let side = 0, at = 0; side < sides; side++)
      for (let v = firstVertex; v < firstVertex + vertexCount; v++)
        for (let k = 0; k < width; k++, at++) {
          const x = from[stride * v + k]!;
          values[at] = value ? value(x, k, side === 1) : x;
        }
    geometry.setAttribute(name, new THREE.BufferAttribute(values, width));
  };
  put('position', data.position, 3, 3);
  put('normal', data.normal, 3, 4, (x, _, back) => (back ? -x : x) / 127);
  put('uv', data.uv[0], 2, 2);
  put('uv1', data.uv[1], 2, 2);
  put('color', data.colour, 4, 4);
  const sizes = [atlasWidth || 1, atlasHeight || 1];
  put(
    `uv${CHANNEL}`,
    data.lightmapUv,
    2,
    2,
    (x, k, back) => (x + (back && k === 1 ? backOffset : 0)) / sizes[k]!,
  );
  // by material, so that each has a group
  const corners = new Map<number, number[]>();
  for (const group of shape.groups)
    for (let i = group.first; i < group.first + group.count; i += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => data.index[i + k]! - firstVertex) as [number, number, number];
      const material = data.tag[firstVertex + a]! & 0xffff;
      if (!corners.has(material)) corners.set(material, []);
      corners.get(material)!.push(a, b, c);
      if (group.doubleSided) corners.get(material)!.push(vertexCount + a, vertexCount + c, vertexCount + b);
    }
  const index: number[] = [];
  const materials: number[] = [];
  for (const [material, list] of corners) {
    geometry.addGroup(index.length, list.length, materials.length);
    materials.push(material);
    for (const corner of list) index.push(corner);
  }
  geometry.setIndex(index);
  geometry.userData.materials = materials;
  return geometry;
}

function isUnlit(data: SceneData, material: number): boolean {
  return data.materials[4 * MATERIAL_TEXELS * (material + 1) - 1] === 1;
}

/** The meshes of a node that are of the file. GLTFLoader makes one mesh of one primitive, which is the node
 * itself, and of several a group of as many meshes. What an app has put below the node stays: it has a name of
 * the server's, a place of its own, a material that the file does not know, or `userData.lightwell` false. */
function ownMeshes(node: THREE.Object3D, names: Set<string>, materials: Set<string>): THREE.Mesh[] {
  if ((node as Partial<THREE.Mesh>).isMesh) return [node as THREE.Mesh];
  const still = new THREE.Matrix4();
  const isOwn = (child: THREE.Object3D) => {
    if (!(child as Partial<THREE.Mesh>).isMesh || names.has(nameOf(child))) return false;
    if (child.userData.lightwell === false) return false;
    if (child.matrixAutoUpdate) child.updateMatrix();
    return (
      child.matrix.equals(still) &&
      materialsOf(child as THREE.Mesh).every((material) => materials.has(material.name))
    );
  };
  return node.children.filter(isOwn) as THREE.Mesh[];
}

/** Puts a mesh of the package in the place of a node's own. names: of all nodes with meshes. */
function place(
  node: THREE.Object3D,
  geometry: THREE.BufferGeometry,
  data: SceneData,
  shape: MeshShape,
  names: Set<string>,
  changes: Changes,
  finer: FinerUniforms | null,
  directions: DirectionUniforms | null,
  tsl: ShadingNodes | null,
): Placed {
  const indices = geometry.userData.materials as number[];
  const own = ownMeshes(node, names, new Set(indices.map((index) => data.materialName[index]!)));
  const originals = own.flatMap(materialsOf);
  const lightmap = lightmapOf(shape);
  if (lightmap) changes.add(() => lightmap.texture.dispose());
  let areRead = false;
  const materials = indices.map((index) => {
    const name = data.materialName[index]!;
    const original = originals.find((material) => material.name === name) ?? originals[0];
    const unlit = isUnlit(data, index);
    const none = unlit ? new THREE.MeshBasicMaterial() : new THREE.MeshStandardMaterial();
    const directed = !unlit && lightmap && original && readsDirections(original) ? directions : null;
    if (directed) areRead = true;
    const material = withServersLight(
      original ?? none,
      null,
      unlit ? null : finer,
      directed,
      tsl,
    ) as THREE.MeshStandardMaterial;
    material.lightMap = unlit ? null : (lightmap?.texture ?? null);
    material.lightMapIntensity = data.lightUnit;
    material.side = THREE.FrontSide; // backs are triangles of their own
    material.vertexColors = !!data.colour;
    changes.add(() => material.dispose());
    return { material, index };
  });
  const mesh = own[0] ?? new THREE.Mesh();
  const matrix = mesh.matrix.clone();
  changes.add(() => {
    mesh.matrix.copy(matrix);
    mesh.matrixWorldNeedsUpdate = true;
  });
  changes.set(mesh, {
    geometry,
    material: materials.length === 1 ? materials[0]!.material : materials.map(({ material }) => material),
    castShadow: true,
    receiveShadow: true,
    visible: mesh.visible,
    matrixAutoUpdate: mesh.matrixAutoUpdate,
  });
  for (const rest of own.slice(1)) changes.set(rest, { visible: false });
  if (!own.length) {
    node.add(mesh);
    changes.add(() => mesh.removeFromParent());
  }
  const sphere = new THREE.Sphere(new THREE.Vector3(...shape.centre), shape.radius);
  return {
    mesh,
    materials,
    lightmap,
    directions: areRead ? { uniforms: directions!, map: null } : null,
    sphere,
    texels: density(data, shape),
  };
}

/** Texels of level 0 to a unit of length, in the mean. */
function density(data: SceneData, shape: MeshShape): number {
  let [area, texels] = [0, 0];
  const [p, q, r] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3()];
  for (const group of shape.groups)
    for (let i = group.first; i < group.first + group.count; i += 3) {
      const [a, b, c] = [data.index[i]!, data.index[i + 1]!, data.index[i + 2]!];
      p.fromArray(data.position, 3 * a);
      q.fromArray(data.position, 3 * b).sub(p);
      r.fromArray(data.position, 3 * c).sub(p);
      area += q.cross(r).length();
      const uv = data.lightmapUv;
      const [u, v] = [uv[2 * a]!, uv[2 * a + 1]!];
      texels += Math.abs((uv[2 * b]! - u) * (uv[2 * c + 1]! - v) - (uv[2 * b + 1]! - v) * (uv[2 * c]! - u));
    }
  return area > 0 ? Math.sqrt(texels / area) : 0;
}

/** Hides the scene's own copies of the server's lights, whose light is in the maps or comes back as lights
 * that follow the server. An app's own lights are none of these: of another kind, or of another name and
 * other colours, or with `userData.lightwell` false. */
export function hideLights(data: SceneData, root: THREE.Object3D, changes: Changes): void {
  const found: THREE.Light[] = [];
  root.traverse((node) => {
    if ((node as Partial<THREE.Light>).isLight && node.userData.lightwell !== false)
      found.push(node as THREE.Light);
  });
  const left = new Set(found);
  const claim = (is: (light: THREE.Light, from: SceneData['lights'][number]) => boolean, open: number[]) =>
    open.filter((i) => {
      const from = data.lights[i]!;
      const light = [...left].find((each) => kindOf(each) === from.kind && is(each, from));
      if (!light) return true;
      left.delete(light);
      changes.set(light, { visible: false });
      return false;
    });
  const byName = claim(
    (light, { name }) => !!name && (light.name === name || nameOf(light) === name),
    data.lights.map((_, i) => i),
  );
  // a node's name hides its light's
  claim(
    ({ color, intensity }, from) =>
      color
        .toArray()
        .every(
          (x, k) =>
            Math.abs(x * intensity - from.intensity[k]!) <= COLOUR_EPS * (from.intensity[k]! + COLOUR_EPS),
        ),
    byName,
  );
}

function kindOf(light: THREE.Light): number {
  const kinds = light as Partial<THREE.DirectionalLight & THREE.PointLight & THREE.SpotLight>;
  if (kinds.isDirectionalLight) return LightKind.DIRECTIONAL;
  return kinds.isSpotLight ? LightKind.SPOT : kinds.isPointLight ? LightKind.POINT : -1;
}
