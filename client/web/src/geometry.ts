// geometry.ts: a scene as a GPU takes it: all meshes in one set of arrays, triangles grouped by what a draw
// call cannot change.
import { AlphaMode, type Light, type Mesh, NONE, type Scene } from './package.ts';
import type { Tiles } from './tiles.ts';

/** Triangles of a mesh that one draw call draws. */
export interface Group {
  first: number; // index
  count: number; // indices
  base: number; // texture, or NONE
  glow: number;
  alphaMode: number;
  doubleSided: boolean;
  passes: [number, number, number] | null; // what is behind times this; null: 1 - alpha
  kept?: number; // where the renderer keeps the indices of a blended one
}

export interface MeshShape {
  firstVertex: number;
  vertexCount: number;
  groups: Group[];
  low: [number, number, number]; // of a box around it, object space
  high: [number, number, number];
  centre: [number, number, number]; // of a sphere around it
  radius: number;
  atlasWidth: number;
  atlasHeight: number;
  backOffset: number;
}

export interface TextureData {
  width: number;
  height: number;
  rgba: Uint8Array<ArrayBuffer>;
  wrapS: number;
  wrapT: number;
}

/** Numbers of a material, in texels of 4: base colour; emission, cutoff; the rows of both transforms of
 * coordinates, with the UV set behind each first row; alpha mode and whether it is unlit behind the others.
 */
export const MATERIAL_TEXELS = 6;

export interface SceneData {
  name: string;
  position: Float32Array<ArrayBuffer>; // 3 a vertex
  normal: Int8Array<ArrayBuffer>; // 4 a vertex
  lightmapUv: Float32Array<ArrayBuffer>; // 2 a vertex
  uv: [Float32Array<ArrayBuffer> | null, Float32Array<ArrayBuffer> | null]; // null: no mesh has them
  colour: Float32Array<ArrayBuffer> | null; // 4 a vertex
  tag: Uint32Array<ArrayBuffer>; // a vertex: material, and from bit 16 the coarsest level that it may read
  index: Uint32Array<ArrayBuffer>;
  meshes: MeshShape[];
  objectMesh: Uint32Array;
  objectName: string[];
  materialName: string[];
  materials: Float32Array<ArrayBuffer>;
  textures: TextureData[];
  lights: Light[];
  environment: { width: number; height: number; texels: Uint32Array<ArrayBuffer> } | null; // RGB9E5
  lightUnit: number; // W/m^2 of a texel of 1
}

/** Where a triangle's vertices say different things of material or level, they are there several times. */
interface Split {
  source: number[]; // of vertices behind the mesh's own: which it is
  tag: Uint32Array;
  index: Uint32Array; // three a triangle, in the mesh's order
}

function split(mesh: Mesh, coarsest: Uint8Array | null): Split {
  const NO_TAG = NONE;
  const own = new Uint32Array(mesh.vertexCount).fill(NO_TAG);
  const index = mesh.triangle.slice();
  const source: number[] = [];
  const tags: number[] = [];
  const copies = new Map<number, number>();
  for (let t = 0; t < mesh.triangleCount; t++) {
    const tag = mesh.material[t]! | ((coarsest ? coarsest[t]! : 0) << 16);
    for (let i = 3 * t; i < 3 * t + 3; i++) {
      const vertex = index[i]!;
      if (own[vertex] === NO_TAG) own[vertex] = tag;
      if (own[vertex] === tag) continue;
      const key = vertex * 2 ** 18 + tag;
      let copy = copies.get(key);
      if (copy === undefined) {
        copy = mesh.vertexCount + source.length;
        source.push(vertex);
        tags.push(tag);
        copies.set(key, copy);
      }
      index[i] = copy;
    }
  }
  const tag = new Uint32Array(mesh.vertexCount + source.length);
  tag.set(own);
  tag.set(tags, mesh.vertexCount);
  return { source, tag, index };
}

/** `width` numbers a vertex, with the repeated vertices; `fill` where the mesh has none. */
function spread(
  from: Float32Array | null,
  width: number,
  source: number[],
  out: Float32Array,
  first: number,
  count: number,
  fill: number,
): void {
  if (!from) {
    out.fill(fill, width * first, width * (first + count + source.length));
    return;
  }
  out.set(from, width * first);
  source.forEach((vertex, i) => {
    out.set(from.subarray(width * vertex, width * (vertex + 1)), width * (first + count + i));
  });
}

function groupsOf(
  scene: Scene,
  mesh: Mesh,
  index: Uint32Array,
  out: Uint32Array,
  at: number,
  base: number,
): Group[] {
  const groups = new Map<string, Group & { triangles: number[] }>();
  for (let t = 0; t < mesh.triangleCount; t++) {
    const m = scene.materials[mesh.material[t]!]!;
    const passes = m.tint.some((x) => x > 0) ? m.tint.map((x) => x * (1 - m.baseColour[3]!)) : null;
    const key = `${m.base.texture} ${m.glow.texture} ${m.alphaMode} ${m.doubleSided} ${passes}`;
    let group = groups.get(key);
    if (!group) {
      group = {
        first: 0,
        count: 0,
        base: m.base.texture,
        glow: m.glow.texture,
        alphaMode: m.alphaMode,
        doubleSided: m.doubleSided,
        passes: passes as Group['passes'],
        triangles: [],
      };
      groups.set(key, group);
    }
    group.triangles.push(t);
  }
  return [...groups.values()].map(({ triangles, ...group }) => {
    group.first = at;
    for (const t of triangles) for (let k = 0; k < 3; k++) out[at++] = base + index[3 * t + k]!;
    group.count = at - group.first;
    return group;
  });
}

function boundsOf(position: Float32Array): Pick<MeshShape, 'low' | 'high' | 'centre' | 'radius'> {
  const low: [number, number, number] = [Infinity, Infinity, Infinity];
  const high: [number, number, number] = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < position.length; i++) {
    const axis = (i % 3) as 0;
    low[axis] = Math.min(low[axis], position[i]!);
    high[axis] = Math.max(high[axis], position[i]!);
  }
  const centre = low.map((x, i) => (x + high[i]!) / 2) as [number, number, number];
  let squared = 0;
  for (let i = 0; i < position.length; i += 3)
    squared = Math.max(
      squared,
      (position[i]! - centre[0]) ** 2 +
        (position[i + 1]! - centre[1]) ** 2 +
        (position[i + 2]! - centre[2]) ** 2,
    );
  return { low, high, centre, radius: Math.sqrt(squared) };
}

function packMaterials(scene: Scene): Float32Array<ArrayBuffer> {
  const out = new Float32Array(4 * MATERIAL_TEXELS * scene.materials.length);
  scene.materials.forEach((m, i) => {
    const { base, glow } = m;
    const [b, g] = [base.transform, glow.transform];
    // prettier-ignore
    out.set(
      [
        ...m.baseColour,
        ...m.emission, m.alphaCutoff,
        b[0]!, b[1]!, b[2]!, base.uvSet,
        b[3]!, b[4]!, b[5]!, m.alphaMode,
        g[0]!, g[1]!, g[2]!, glow.uvSet,
        g[3]!, g[4]!, g[5]!, m.unlit ? 1 : 0,
      ],
      4 * MATERIAL_TEXELS * i,
    );
  });
  return out;
}

export function buildGeometry(scene: Scene, tiles: Tiles): SceneData {
  const splits = scene.meshes.map((mesh) => {
    const height = mesh.backOffset || mesh.atlasHeight;
    const coarsest =
      mesh.lightmapUv &&
      tiles.coarsest(mesh.position, mesh.lightmapUv, mesh.triangle, mesh.atlasWidth, height);
    return split(mesh, coarsest);
  });
  const vertices = splits.reduce((sum, each) => sum + each.tag.length, 0);
  const indices = splits.reduce((sum, each) => sum + each.index.length, 0);
  const any = (has: (mesh: Mesh) => unknown) => scene.meshes.some(has);
  const data: SceneData = {
    name: scene.name,
    position: new Float32Array(3 * vertices),
    normal: new Int8Array(4 * vertices),
    lightmapUv: new Float32Array(2 * vertices),
    uv: [
      any((mesh) => mesh.uv[0]) ? new Float32Array(2 * vertices) : null,
      any((mesh) => mesh.uv[1]) ? new Float32Array(2 * vertices) : null,
    ],
    colour: any((mesh) => mesh.colour) ? new Float32Array(4 * vertices) : null,
    tag: new Uint32Array(vertices),
    index: new Uint32Array(indices),
    meshes: [],
    objectMesh: scene.objectMesh,
    objectName: scene.objectName,
    materialName: scene.materials.map((material) => material.name),
    materials: packMaterials(scene),
    textures: scene.textures,
    lights: scene.lights,
    environment: scene.environment && {
      width: scene.environment.width,
      height: scene.environment.height,
      texels: tiles.packAll(scene.environment.rgb) as Uint32Array<ArrayBuffer>,
    },
    lightUnit: tiles.unit,
  };
  let firstVertex = 0;
  let firstIndex = 0;
  scene.meshes.forEach((mesh, i) => {
    const { source, tag, index } = splits[i]!;
    const place = (from: Float32Array | null, width: number, out: Float32Array | null, fill: number) => {
      if (out) spread(from, width, source, out, firstVertex, mesh.vertexCount, fill);
    };
    place(mesh.position, 3, data.position, 0);
    place(mesh.lightmapUv, 2, data.lightmapUv, 0);
    place(mesh.uv[0], 2, data.uv[0], 0);
    place(mesh.uv[1], 2, data.uv[1], 0);
    place(mesh.colour, 4, data.colour, 1);
    for (let v = 0; v < tag.length; v++) {
      const from = v < mesh.vertexCount ? v : source[v - mesh.vertexCount]!;
      for (let k = 0; k < 3; k++)
        data.normal[4 * (firstVertex + v) + k] = Math.round(127 * mesh.normal[3 * from + k]!);
    }
    data.tag.set(tag, firstVertex);
    data.meshes.push({
      firstVertex,
      vertexCount: tag.length,
      groups: groupsOf(scene, mesh, index, data.index, firstIndex, firstVertex),
      ...boundsOf(mesh.position),
      atlasWidth: mesh.atlasWidth,
      atlasHeight: mesh.atlasHeight,
      backOffset: mesh.backOffset,
    });
    firstVertex += tag.length;
    firstIndex += index.length;
  });
  return data;
}

/** What of it may be handed over instead of copied. */
export function buffersOf(data: SceneData): ArrayBuffer[] {
  const arrays = [
    data.position,
    data.normal,
    data.lightmapUv,
    data.uv[0],
    data.uv[1],
    data.colour,
    data.tag,
    data.index,
  ];
  const all = [...arrays, ...data.textures.map((texture) => texture.rgba), data.environment?.texels];
  return all.filter((array) => !!array).map((array) => array.buffer);
}

/** Whether a group is drawn after what is opaque, back to front. */
export function isBlended(group: Group): boolean {
  return group.alphaMode === AlphaMode.BLEND;
}
