// package.ts: reads a scene package: docs/scene_package.md. All that later code relies on is checked here:
// places of arrays, indices, numbers that are finite. A ProtocolError names the place.
import { ProtocolError } from './failure.ts';
import type { Tiles } from './tiles.ts';

export const NONE = 0xffffffff;

export interface Mesh {
  vertexCount: number;
  triangleCount: number;
  position: Float32Array; // 3 a vertex
  normal: Float32Array;
  uv: [Float32Array | null, Float32Array | null]; // 2 a vertex
  colour: Float32Array | null; // 4 a vertex
  triangle: Uint32Array; // 3 a triangle
  material: Uint32Array; // 1 a triangle
  lightmapUv: Float32Array | null;
  atlasWidth: number;
  atlasHeight: number;
  backOffset: number;
}

export interface TextureUse {
  texture: number; // or NONE
  uvSet: number;
  transform: Float32Array; // 6
}

export const AlphaMode = { OPAQUE: 0, MASK: 1, BLEND: 2 } as const;

export interface Material {
  name: string;
  baseColour: Float32Array; // 4
  emission: Float32Array; // 3
  alphaCutoff: number;
  base: TextureUse;
  glow: TextureUse;
  alphaMode: number;
  doubleSided: boolean;
  unlit: boolean; // seen as its base colour
  tint: [number, number, number]; // of what passes, on top of 1 - alpha; 0, 0, 0: none
}

export interface Texture {
  width: number;
  height: number;
  rgba: Uint8Array<ArrayBuffer>;
  wrapS: number; // 0 repeat, 1 clamp, 2 mirror
  wrapT: number;
}

export interface Node {
  parent: number; // below its own, or NONE
  matrix: Float32Array | null; // 12
  translation: Float32Array;
  rotation: Float32Array;
  scale: Float32Array;
}

export const LightKind = { POINT: 0, SPOT: 1, DIRECTIONAL: 2 } as const;

export interface Light {
  name: string;
  node: number;
  kind: number;
  intensity: Float32Array; // 3
  innerCone: number;
  outerCone: number;
  angularDiameter: number;
}

export interface Camera {
  name: string;
  node: number;
  fovY: number;
  height: number; // of what an orthographic camera sees, m; 0: a perspective one
}

export interface Channel {
  node: number;
  path: number; // 0 translation, 1 rotation, 2 scale
  interpolation: number; // 0 step, 1 linear, 2 cubic
  time: Float32Array;
  value: Float32Array;
}

export interface Scene {
  name: string;
  durationS: number;
  sky: Float32Array;
  meshes: Mesh[];
  materials: Material[];
  textures: Texture[];
  nodes: Node[];
  objectName: string[];
  objectMesh: Uint32Array;
  objectNode: Uint32Array; // NONE: a spare
  lights: Light[];
  cameras: Camera[];
  channels: Channel[];
  environment: { width: number; height: number; rgb: Float32Array } | null;
}

const WIDTHS = [
  24, 64, 112, 28, 104, 16, 40, 16, 24, 1, 12, 12, 8, 16, 12, 4, 8, 4, 4, 4, 12, 12, 4, 4, 16, 4, 24,
];
const COUNTS = [1, 20, 16, 14, 21, 20, 20, 16, 20].map((bits) => (bits === 1 ? 1 : 2 ** bits));
const SEALED = 5; // from this version on there is a checksum
const SEAL_AT = 24;
const ATLAS_SIDE_MAX = 16384;
const TEXELS_MAX = 2 ** 28;
const VERTICES_MAX = 2 ** 28;

interface Section {
  at: number;
  count: number;
}

class PackageReader {
  private readonly view: DataView;
  private readonly section: Section[] = [];
  readonly version: number;

  constructor(
    private readonly bytes: Uint8Array,
    tiles: Tiles,
  ) {
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    if (bytes.length < 512 || String.fromCharCode(...bytes.subarray(0, 8)) !== 'LWSCENE\n')
      this.fail('it is none');
    if (bytes.byteOffset % 16) throw new Error('a package lies at a multiple of 16');
    this.version = this.u32(8);
    const sections = [0, 20, 22, 22, 24, 24, 27][this.version] ?? 0;
    if (!sections) this.fail(`version ${this.version}`);
    if (this.version >= SEALED) this.checkSeal(tiles);
    else if (this.u64(SEAL_AT)) this.fail('a reserved field is not 0');
    if (this.u32(12) !== sections || 32 + 24 * sections > bytes.length) this.fail(`${this.u32(12)} sections`);
    for (let i = 0; i < sections; i++) {
      const entry = 32 + 24 * i;
      const at = this.u64(entry + 8);
      const count = this.u64(entry + 16);
      if (this.u32(entry) !== i + 1 || this.u32(entry + 4) !== WIDTHS[i])
        this.fail(`section ${i + 1} is another one`);
      if (at % 16 || at + count * WIDTHS[i]! > bytes.length) this.fail(`section ${i + 1} is past its end`);
      if (count > (COUNTS[i] ?? Infinity)) this.fail(`section ${i + 1} has ${count} elements`);
      this.section.push({ at, count });
    }
  }

  /** A package of version 5 or 6 holds a part of its own hash, with zeros where that stands. */
  private checkSeal(tiles: Tiles): void {
    const seal = this.bytes.slice(SEAL_AT, SEAL_AT + 8);
    this.bytes.fill(0, SEAL_AT, SEAL_AT + 8);
    const hash = tiles.hash(this.bytes);
    this.bytes.set(seal, SEAL_AT);
    if (seal.some((byte, i) => byte !== hash[i])) this.fail('its bytes do not have its checksum');
  }

  fail(what: string): never {
    throw new ProtocolError(`scene package: ${what}`);
  }

  u32(at: number): number {
    return this.view.getUint32(at, true);
  }

  private u64(at: number): number {
    const value = this.view.getBigUint64(at, true);
    return value > 2n ** 33n ? 2 ** 33 : Number(value);
  }

  f32(at: number, place: string): number {
    const value = this.view.getFloat32(at, true);
    if (!Number.isFinite(value)) this.fail(`${place} is not finite`);
    return value;
  }

  f32s(at: number, count: number, place: string): Float32Array {
    return Float32Array.from({ length: count }, (_, i) => this.f32(at + 4 * i, place));
  }

  /** Reads all records of a section. */
  records<T>(id: number, name: string, read: (at: number, place: string) => T): T[] {
    const { at, count } = this.section[id - 1]!;
    const width = WIDTHS[id - 1]!;
    return Array.from({ length: count }, (_, i) => read(at + i * width, `${name} ${i}`));
  }

  count(id: number): number {
    return this.section[id - 1]?.count ?? 0;
  }

  private place(id: number, first: number, count: number, place: string): number {
    const section = this.section[id - 1]!;
    if (first + count > section.count) this.fail(`${place}: its array is past the end of section ${id}`);
    return this.bytes.byteOffset + section.at + first * WIDTHS[id - 1]!;
  }

  /** An array as it lies in the package. */
  floats(id: number, first: number, count: number, place: string): Float32Array {
    const at = this.place(id, first, count, place);
    const values = new Float32Array(this.bytes.buffer, at, (count * WIDTHS[id - 1]!) / 4);
    for (let i = 0; i < values.length; i++)
      if (!Number.isFinite(values[i]!)) this.fail(`${place}: a number is not finite`);
    return values;
  }

  optional(id: number, first: number, count: number, place: string): Float32Array | null {
    return first === NONE ? null : this.floats(id, first, count, place);
  }

  /** Indices, each below `limit`. */
  indices(id: number, first: number, count: number, limit: number, place: string): Uint32Array {
    const values = new Uint32Array(
      this.bytes.buffer,
      this.place(id, first, count, place),
      (count * WIDTHS[id - 1]!) / 4,
    );
    for (let i = 0; i < values.length; i++)
      if (values[i]! >= limit) this.fail(`${place}: index ${values[i]} of ${limit}`);
    return values;
  }

  raw(id: number, first: number, count: number, place: string): Uint8Array {
    return new Uint8Array(this.bytes.buffer, this.place(id, first, count, place), count * WIDTHS[id - 1]!);
  }

  index(at: number, limit: number, place: string, optional: boolean): number {
    const value = this.u32(at);
    if (value >= limit && !(optional && value === NONE)) this.fail(`${place}: index ${value} of ${limit}`);
    return value;
  }

  upTo(at: number, most: number, place: string): number {
    const value = this.u32(at);
    if (value > most) this.fail(`${place} is ${value}, over ${most}`);
    return value;
  }

  string(at: number, place: string): string {
    const bytes = this.raw(10, this.u32(at), this.u32(at + 4), place);
    return new TextDecoder().decode(bytes);
  }
}

function readMesh(r: PackageReader, at: number, place: string): Mesh {
  const vertexCount = r.upTo(at + 8, VERTICES_MAX, `${place}: vertices`);
  const triangleCount = r.upTo(at + 12, VERTICES_MAX, `${place}: triangles`);
  if (!vertexCount || !triangleCount) r.fail(`${place} is empty`);
  const mesh: Mesh = {
    vertexCount,
    triangleCount,
    position: r.floats(11, r.u32(at + 16), vertexCount, place),
    normal: r.floats(12, r.u32(at + 20), vertexCount, place),
    uv: [
      r.optional(13, r.u32(at + 24), vertexCount, place),
      r.optional(13, r.u32(at + 28), vertexCount, place),
    ],
    colour: r.optional(14, r.u32(at + 32), vertexCount, place),
    triangle: r.indices(15, r.u32(at + 36), triangleCount, vertexCount, place),
    material: r.indices(16, r.u32(at + 40), triangleCount, r.count(3), place),
    lightmapUv: r.optional(17, r.u32(at + 44), vertexCount, place),
    atlasWidth: r.upTo(at + 48, ATLAS_SIDE_MAX, `${place}: atlas width`),
    atlasHeight: r.upTo(at + 52, ATLAS_SIDE_MAX, `${place}: atlas height`),
    backOffset: r.u32(at + 56),
  };
  if (!mesh.lightmapUv !== !mesh.atlasWidth || !mesh.atlasWidth !== !mesh.atlasHeight)
    r.fail(`${place}: an atlas without lightmap coordinates, or these without it`);
  if (mesh.atlasHeight && mesh.backOffset >= mesh.atlasHeight)
    r.fail(`${place}: back offset ${mesh.backOffset}`);
  const height = mesh.backOffset
    ? Math.min(mesh.backOffset, mesh.atlasHeight - mesh.backOffset)
    : mesh.atlasHeight;
  const uv = mesh.lightmapUv ?? [];
  for (let i = 0; i < uv.length; i += 2)
    if (!(uv[i]! >= 0 && uv[i]! <= mesh.atlasWidth && uv[i + 1]! >= 0 && uv[i + 1]! <= height))
      r.fail(`${place}: lightmap coordinates outside of the atlas`);
  return mesh;
}

function readUse(r: PackageReader, at: number, place: string): TextureUse {
  return {
    texture: r.index(at, r.count(4), place, true),
    uvSet: r.upTo(at + 4, 1, `${place}: UV set`),
    transform: r.f32s(at + 8, 6, place),
  };
}

function readMaterial(r: PackageReader, at: number, place: string): Material {
  return {
    name: r.string(at, place),
    baseColour: r.f32s(at + 8, 4, place),
    emission: r.f32s(at + 24, 3, place),
    alphaCutoff: r.f32(at + 36, place),
    base: readUse(r, at + 40, place),
    glow: readUse(r, at + 72, place),
    alphaMode: r.upTo(at + 104, 2, `${place}: alpha mode`),
    doubleSided: r.upTo(at + 108, 1, `${place}: double-sided`) === 1,
    unlit: false,
    tint: [0, 0, 0],
  };
}

function readTexture(r: PackageReader, tiles: Tiles, at: number, place: string): Texture {
  const width = r.upTo(at + 8, 16384, `${place}: width`);
  const height = r.upTo(at + 12, 16384, `${place}: height`);
  if (!width || !height) r.fail(`${place} is empty`);
  const bytes = r.raw(20, r.u32(at + 16), width * height, place);
  const rgba =
    r.version >= 3 ? tiles.unfilter(bytes, width, height) : (bytes.slice() as Uint8Array<ArrayBuffer>);
  return {
    width,
    height,
    rgba,
    wrapS: r.upTo(at + 20, 2, `${place}: wrap`),
    wrapT: r.upTo(at + 24, 2, `${place}: wrap`),
  };
}

function readNode(r: PackageReader, at: number, place: string, index: number): Node {
  return {
    parent: r.index(at + 8, index, `${place}: parent`, true),
    matrix: r.upTo(at + 12, 1, `${place}: matrix`) ? r.f32s(at + 56, 12, place) : null,
    translation: r.f32s(at + 16, 3, place),
    rotation: r.f32s(at + 28, 4, place),
    scale: r.f32s(at + 44, 3, place),
  };
}

/** ofLight: frames tell all there is to know of lights: it is checked alone. */
function readChannel(r: PackageReader, at: number, place: string, ofLight: boolean): Channel {
  const path = r.upTo(at + 4, ofLight ? 4 : 2, `${place}: path`);
  const interpolation = r.upTo(at + 8, 2, `${place}: interpolation`);
  const keys = r.upTo(at + 12, 2 ** 28, `${place}: keys`);
  if (!keys) r.fail(`${place} has no key`);
  const values = keys * (path === 1 ? 4 : path === 4 ? 1 : 3) * (interpolation === 2 ? 3 : 1);
  return {
    node: r.index(at, r.count(ofLight ? 7 : 5), place, false),
    path,
    interpolation,
    time: r.floats(18, r.u32(at + 16), keys, place),
    value: r.floats(19, r.u32(at + 20), values, place),
  };
}

/** bytes: at a multiple of 16 of its buffer, which the scene refers to. */
export function readPackage(bytes: Uint8Array, tiles: Tiles): Scene {
  const r = new PackageReader(bytes, tiles);
  const head = r.records(1, 'scene', (at, place) => ({
    name: r.string(at, place),
    durationS: r.f32(at + 8, place),
    sky: r.f32s(at + 12, 3, place),
  }))[0];
  if (!head) return r.fail('it has no scene');
  const meshes = r.records(2, 'mesh', (at, place) => readMesh(r, at, place));
  const nodeCount = r.count(5);
  let node = 0;
  const objects = r.records(6, 'object', (at, place) => ({
    name: r.string(at, place),
    mesh: r.index(at + 8, meshes.length, `${place}: mesh`, false),
    node: r.index(at + 12, nodeCount, `${place}: node`, true),
  }));
  const scene: Scene = {
    ...head,
    meshes,
    materials: r.records(3, 'material', (at, place) => readMaterial(r, at, place)),
    textures: r.records(4, 'texture', (at, place) => readTexture(r, tiles, at, place)),
    nodes: r.records(5, 'node', (at, place) => readNode(r, at, place, node++)),
    objectName: objects.map((object) => object.name),
    objectMesh: Uint32Array.from(objects, (object) => object.mesh),
    objectNode: Uint32Array.from(objects, (object) => object.node),
    lights: r.records(7, 'light', (at, place) => ({
      name: r.string(at, place),
      node: r.index(at + 8, nodeCount, place, false),
      kind: r.upTo(at + 12, 2, `${place}: kind`),
      intensity: r.f32s(at + 16, 3, place),
      innerCone: r.f32(at + 28, place),
      outerCone: r.f32(at + 32, place),
      angularDiameter: r.f32(at + 36, place),
    })),
    cameras: r.records(8, 'camera', (at, place) => ({
      name: r.string(at, place),
      node: r.index(at + 8, nodeCount, place, false),
      fovY: r.f32(at + 12, place),
      height: 0,
    })),
    channels: r.records(9, 'channel', (at, place) => readChannel(r, at, place, false)),
    environment: null,
  };
  if (r.version > 1)
    r.records(21, 'environment', (at, place) => {
      const width = r.upTo(at, 4096, `${place}: width`);
      const height = r.upTo(at + 4, 4096, `${place}: height`);
      if (!width || !height) r.fail(`${place} is empty`);
      scene.environment = { width, height, rgb: r.floats(22, r.u32(at + 8), width * height, place) };
    });
  if (r.version >= 6) readLooks(r, scene);
  checkTotals(r, scene);
  return scene;
}

/** What version 6 says on top. */
function readLooks(r: PackageReader, scene: Scene): void {
  if (r.count(25) !== scene.materials.length || r.count(26) !== scene.cameras.length)
    r.fail('looks of materials, or heights of cameras, are not as many as these');
  let [material, camera] = [0, 0];
  r.records(25, 'material look', (at, place) => {
    const m = scene.materials[material++]!;
    m.unlit = r.upTo(at, 1, `${place}: unlit`) === 1;
    m.tint = [...r.f32s(at + 4, 3, place)] as [number, number, number];
  });
  r.records(26, 'camera height', (at, place) => {
    const height = r.f32(at, place);
    if (height < 0) r.fail(`${place} is ${height}`);
    scene.cameras[camera++]!.height = height;
  });
  r.records(27, 'light channel', (at, place) => readChannel(r, at, place, true));
}

function checkTotals(r: PackageReader, scene: Scene): void {
  let texels = 0;
  let triangles = 0;
  for (const index of scene.objectMesh) {
    const mesh = scene.meshes[index]!;
    texels += mesh.atlasWidth * mesh.atlasHeight;
    triangles += mesh.triangleCount;
  }
  if (texels > TEXELS_MAX) r.fail(`atlases of ${texels} texels`);
  if (triangles > VERTICES_MAX) r.fail(`objects of ${triangles} triangles`);
}
