// geometry.ts: a scene as a GPU takes it: all meshes in one set of arrays, triangles grouped by what a draw
// call cannot change.
import { type Finish, type Finishes, type FinishTexture } from './finishes.ts';
import { AlphaMode, type Light, type Mesh, NONE, type Scene, type TextureUse } from './package.ts';
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
  finish: number[] | null; // textures of its finish in the order of FinishPlace, or NONE; null: matt
  material: number; // of its finish
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

/** Numbers of a finish, in texels of 4: metalness, roughness, specular, reflectance at normal incidence;
 * colour of that, strength of occlusion; then for each texture, in the order of FinishPlace, the rows of its
 * transform, with the UV set behind the first one; the scale of the normal map behind its second.
 */
export const FINISH_TEXELS = 10;

/** Textures of a finish. */
export const FinishPlace = { SURFACE: 0, SPECULAR: 1, OCCLUSION: 2, NORMAL: 3 } as const;
/** In the place of an occlusion texture: it is the surface's own, read at the same place. */
export const IN_SURFACE = NONE - 1;

export interface SceneData {
  name: string;
  position: Float32Array<ArrayBuffer>; // 3 a vertex
  normal: Int8Array<ArrayBuffer>; // 4 a vertex
  lightmapUv: Float32Array<ArrayBuffer>; // 2 a vertex
  uv: [Float32Array<ArrayBuffer> | null, Float32Array<ArrayBuffer> | null]; // null: no mesh has them
  colour: Float32Array<ArrayBuffer> | null; // 4 a vertex
  // a vertex: material; from bit 16 the coarsest level that it may read; bit 18: its triangle is SMALL
  tag: Uint32Array<ArrayBuffer>;
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
  finish: FinishData | null; // null: not there yet, or all is matt
}

/** What finishes bring to a scene. Its other arrays are built again with them, but for textures: those are
 * there. */
export interface FinishData {
  tangent: Int8Array<ArrayBuffer> | null; // 4 a vertex, as glTF's; null: no mesh has any
  materials: Float32Array<ArrayBuffer>; // FINISH_TEXELS of each
  textures: FinishTexture[];
}

/** Texels of level 0 on twice a triangle, under which it always wants finer levels: its chart may be narrower
 * than a texel. */
const FINE_TEXELS = 16;
export const SMALL = 1 << 18; // of its tag

function isSmall({ triangle, lightmapUv: uv }: Mesh, t: number): boolean {
  const at = (corner: number, k: number) => uv![2 * triangle[3 * t + corner]! + k]!;
  const edge = (corner: number, k: number) => at(corner, k) - at(0, k);
  return Math.abs(edge(1, 0) * edge(2, 1) - edge(1, 1) * edge(2, 0)) < FINE_TEXELS;
}

/** Where a triangle's vertices say different things of material, level or tangent, they are there several
 * times. */
interface Split {
  source: number[]; // of vertices behind the mesh's own: which it is
  tag: Uint32Array;
  code: Uint16Array | null; // of tangents
  index: Uint32Array; // three a triangle, in the mesh's order
}

function split(mesh: Mesh, coarsest: Uint8Array | null, tangent: Uint16Array | null): Split {
  const NO_TAG = NONE;
  const NO_COPY = 0;
  const own = new Uint32Array(mesh.vertexCount).fill(NO_TAG);
  const ownCode = tangent && new Uint16Array(mesh.vertexCount);
  const index = mesh.triangle.slice();
  const source: number[] = [];
  const tags: number[] = [];
  const codes: number[] = [];
  // of each vertex, the copies one after another
  const first = new Uint32Array(mesh.vertexCount);
  const next: number[] = [];
  const copyOf = (vertex: number, tag: number, code: number) => {
    let copy = first[vertex]!;
    for (; copy !== NO_COPY; copy = next[copy - mesh.vertexCount]!)
      if (tags[copy - mesh.vertexCount] === tag && codes[copy - mesh.vertexCount] === code) return copy;
    copy = mesh.vertexCount + source.length;
    source.push(vertex);
    tags.push(tag);
    codes.push(code);
    next.push(first[vertex]!);
    first[vertex] = copy;
    return copy;
  };
  for (let t = 0; t < mesh.triangleCount; t++) {
    const small = coarsest && isSmall(mesh, t) ? SMALL : 0;
    const tag = mesh.material[t]! | ((coarsest ? coarsest[t]! : 0) << 16) | small;
    for (let i = 3 * t; i < 3 * t + 3; i++) {
      const vertex = index[i]!;
      const code = tangent ? tangent[i]! : 0;
      if (own[vertex] === NO_TAG) {
        own[vertex] = tag;
        if (ownCode) ownCode[vertex] = code;
      }
      if (own[vertex] !== tag || (ownCode && ownCode[vertex] !== code)) index[i] = copyOf(vertex, tag, code);
    }
  }
  const tag = new Uint32Array(mesh.vertexCount + source.length);
  tag.set(own);
  tag.set(tags, mesh.vertexCount);
  const code = ownCode && new Uint16Array(tag.length);
  code?.set(ownCode!);
  code?.set(codes, mesh.vertexCount);
  return { source, tag, code, index };
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

/** The tangents of a mesh's vertices; code: common/shading/tangent.h. */
function placeTangents(mesh: Mesh, { source, code }: Split, out: Int8Array, first: number): void {
  if (!code) return;
  for (let v = 0; v < code.length; v++) {
    const from = 3 * (v < mesh.vertexCount ? v : source[v - mesh.vertexCount]!);
    const [x, y, z] = [mesh.normal[from]!, mesh.normal[from + 1]!, mesh.normal[from + 2]!];
    tangentOf(code[v]!, x, y, z).forEach((value, k) => (out[4 * (first + v) + k] = Math.round(127 * value)));
  }
}

/** lw_tangent_decode(), of a normal. */
export function tangentOf(code: number, x: number, y: number, z: number): [number, number, number, number] {
  // lw_vec3_frame()
  const sign = z < 0 || Object.is(z, -0) ? -1 : 1;
  const a = -1 / (sign + z);
  const b = x * y * a;
  const angle = (code & 0x7fff) * ((2 * Math.PI) / 32768);
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return [
    c * (1 + sign * x * x * a) + s * b,
    c * sign * b + s * (sign + y * y * a),
    -(c * sign * x + s * y),
    code & 0x8000 ? -1 : 1,
  ];
}

const isSame = (a: TextureUse, b: TextureUse) =>
  a.texture === b.texture && a.uvSet === b.uvSet && a.transform.every((x, i) => x === b.transform[i]);

/** The textures that a finish reads on a mesh. */
function finishTextures({ surface, specularTexture, occlusionTexture, normal }: Finish, bumpy: boolean) {
  const none = occlusionTexture.texture === NONE;
  const shared = !none && isSame(surface, occlusionTexture);
  const occlusion = shared ? IN_SURFACE : occlusionTexture.texture;
  return [surface.texture, specularTexture.texture, occlusion, bumpy ? normal.texture : NONE];
}

function packFinishes(scene: Scene, finishes: Finishes): Float32Array<ArrayBuffer> {
  const out = new Float32Array(4 * FINISH_TEXELS * scene.materials.length);
  finishes.materials.forEach((finish, i) => {
    if (!finish) return;
    const uses = [finish.surface, finish.specularTexture, finish.occlusionTexture, finish.normal];
    const rows = uses.flatMap(({ transform: t, uvSet }, place) => [
      ...[t[0]!, t[1]!, t[2]!, uvSet],
      ...[t[3]!, t[4]!, t[5]!, place === FinishPlace.NORMAL ? finish.normalScale : 0],
    ]);
    const bend = (finish.ior - 1) / (finish.ior + 1);
    const { metalness, roughness, specular, specularColour, occlusion } = finish;
    out.set(
      [metalness, roughness, specular, bend * bend, ...specularColour, occlusion, ...rows],
      4 * FINISH_TEXELS * i,
    );
  });
  return out;
}

function groupsOf(
  scene: Scene,
  finishes: Finishes | null,
  mesh: Mesh,
  bumpy: boolean,
  index: Uint32Array,
  out: Uint32Array,
  at: number,
  base: number,
): Group[] {
  const groups = new Map<string, Group & { triangles: number[] }>();
  for (let t = 0; t < mesh.triangleCount; t++) {
    const m = scene.materials[mesh.material[t]!]!;
    const passes = m.tint.some((x) => x > 0) ? m.tint.map((x) => x * (1 - m.baseColour[3]!)) : null;
    const smooth = !m.unlit && finishes?.materials[mesh.material[t]!];
    const finish = smooth ? finishTextures(smooth, bumpy) : null;
    const material = finish ? mesh.material[t]! : NONE; // of a finish the GPU has one at a time
    const key = `${m.base.texture} ${m.glow.texture} ${m.alphaMode} ${m.doubleSided} ${passes} ${material}`;
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
        finish,
        material,
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

/** With finishes: the scene again, whose textures and environment are there. */
export function buildGeometry(scene: Scene, tiles: Tiles, finishes: Finishes | null = null): SceneData {
  const tangents = finishes?.tangents ?? [];
  const splits = scene.meshes.map((mesh, i) => {
    const height = mesh.backOffset || mesh.atlasHeight;
    const coarsest =
      mesh.lightmapUv &&
      tiles.coarsest(mesh.position, mesh.lightmapUv, mesh.triangle, mesh.atlasWidth, height);
    return split(mesh, coarsest, tangents[i] ?? null);
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
    textures: finishes ? [] : scene.textures,
    lights: scene.lights,
    environment: scene.environment && !finishes ? {
      width: scene.environment.width,
      height: scene.environment.height,
      texels: tiles.packAll(scene.environment.rgb) as Uint32Array<ArrayBuffer>,
    } : null,
    lightUnit: tiles.unit,
    finish: finishes && {
      tangent: tangents.some((each) => each) ? new Int8Array(4 * vertices) : null,
      materials: packFinishes(scene, finishes),
      textures: finishes.textures,
    },
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
    if (data.finish?.tangent) placeTangents(mesh, splits[i]!, data.finish.tangent, firstVertex);
    data.tag.set(tag, firstVertex);
    data.meshes.push({
      firstVertex,
      vertexCount: tag.length,
      groups: groupsOf(scene, finishes, mesh, !!tangents[i], index, data.index, firstIndex, firstVertex),
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
    data.finish?.tangent,
    data.finish?.materials,
  ];
  const textures = [
    ...data.textures.map((texture) => texture.rgba),
    ...(data.finish?.textures ?? []).map((texture) => texture.texels),
  ];
  const all = [...arrays, ...textures, data.environment?.texels];
  return all.filter((array) => !!array).map((array) => array.buffer);
}

/** Whether a group is drawn after what is opaque, back to front. */
export function isBlended(group: Group): boolean {
  return group.alphaMode === AlphaMode.BLEND;
}
