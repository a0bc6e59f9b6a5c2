// finish_package.ts: reads the finishes of a scene: docs/scene_package.md, Finishes. As strict as
// common/scene/finish_package.c: there is one way to say each thing. A ProtocolError names the place.
import { ProtocolError } from './failure.ts';
import { Content, type Finish, type Finishes, type FinishTexture } from './finishes.ts';
import { NONE, type TextureUse } from './package.ts';

const HEADER = 32;
const ENTRY = 24;
const NO_LIMIT = 2 ** 32;
/** Name, bytes per element, most elements. */
const SECTIONS = [
  ['scene', 16, 1],
  ['finishes', 168, 2 ** 16],
  ['textures', 32, 2 ** 14],
  ['meshes', 8, 2 ** 20],
  ['strings', 1, NO_LIMIT],
  ['tangents', 2, NO_LIMIT],
  ['pixels', 1, NO_LIMIT],
] as const;
const [SCENE, FINISHES, TEXTURES, MESHES, STRINGS, TANGENTS, PIXELS] = [0, 1, 2, 3, 4, 5, 6];
const SIDE_MAX = 16384;
const FACTOR_MAX = 1e12;
const PLANES = [4, 2, 3]; // by content

/** Of the scene that finishes are of. */
export interface Finished {
  materials: ArrayLike<unknown>;
  meshes: ArrayLike<{ triangleCount: number }>;
}

interface Section {
  at: number;
  count: number;
  used: number; // elements: each array lies right behind the one before
}

const text = new TextDecoder('utf-8', { fatal: true });

class Reader {
  private readonly view: DataView;
  private readonly sections: Section[] = [];
  private at = 0; // in the record
  place = '';

  constructor(private readonly bytes: Uint8Array) {
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const tableEnd = HEADER + ENTRY * SECTIONS.length;
    if (bytes.length < tableEnd || String.fromCharCode(...bytes.subarray(0, 8)) !== 'LWFINIS\n')
      this.fail('it is none');
    this.at = 8;
    if (this.u32() !== 1 || this.u32() !== SECTIONS.length) this.fail('another version');
    if (this.u64() !== bytes.length) this.fail('it says that it has another size');
    if (this.u64()) this.fail('a reserved field is not 0');
    let end = tableEnd;
    SECTIONS.forEach((_, i) => (end = this.readEntry(i, end)));
    if (end !== bytes.length) this.fail(`it ends at byte ${end} of ${bytes.length}`);
  }

  /** Returns where the section ends. */
  private readEntry(i: number, before: number): number {
    const [name, width, most] = SECTIONS[i]!;
    this.place = `section ${name}`;
    if (this.u32() !== i + 1 || this.u32() !== width) this.fail('it is another one');
    const at = this.u64();
    const count = this.u64();
    const end = at + count * width;
    if (at !== Math.ceil(before / 16) * 16 || end > this.bytes.length) this.fail(`it is at byte ${at}`);
    if (count > most) this.fail(`it has ${count} elements`);
    for (let p = before; p < at; p++) if (this.bytes[p]) this.fail('what is before it is not 0');
    this.sections.push({ at, count, used: 0 });
    return end;
  }

  fail(what: string): never {
    throw new ProtocolError(`finish package: ${this.place && `${this.place}: `}${what}`);
  }

  private u64(): number {
    this.at += 8;
    const value = this.view.getBigUint64(this.at - 8, true);
    return value > 2n ** 33n ? 2 ** 33 : Number(value);
  }

  u32(): number {
    this.at += 4;
    return this.view.getUint32(this.at - 4, true);
  }

  upTo(most: number, what: string): number {
    const value = this.u32();
    if (value > most) this.fail(`${what} is ${value}, over ${most}`);
    return value;
  }

  float(low: number, high: number, what: string): number {
    this.at += 4;
    const value = this.view.getFloat32(this.at - 4, true);
    if (!(value >= low && value <= high)) this.fail(`${what} is ${value}, not within ${low} to ${high}`);
    return value;
  }

  count(section: number): number {
    return this.sections[section]!.count;
  }

  records<T>(section: number, read: (index: number) => T): T[] {
    const { at, count } = this.sections[section]!;
    const [name, width] = SECTIONS[section]!;
    return Array.from({ length: count }, (_, i) => {
      this.place = `section ${name}, record ${i}`;
      this.at = at + i * width;
      return read(i);
    });
  }

  /** The bytes of `count` elements from `first` on, which is the next one that is free. */
  take(section: number, first: number, count: number): Uint8Array {
    const [name, width] = SECTIONS[section]!;
    const place = this.sections[section]!;
    if (first !== place.used) this.fail(`it starts at ${first} of ${name}; the next one is ${place.used}`);
    if (count > place.count - first) this.fail(`it takes ${count} ${name} from ${first} on`);
    place.used += count;
    const at = place.at + first * width;
    return this.bytes.subarray(at, at + count * width);
  }

  name(): void {
    const first = this.u32();
    const length = this.u32();
    const bytes = this.take(STRINGS, first, length + 1);
    if (bytes.indexOf(0) !== length) this.fail('its name does not end where its NUL is');
    try {
      text.decode(bytes.subarray(0, length));
    } catch {
      this.fail('its name is no UTF-8');
    }
  }

  /** Nothing is left over. */
  finish(): void {
    for (const section of [STRINGS, TANGENTS, PIXELS]) {
      const { count, used } = this.sections[section]!;
      this.place = `section ${SECTIONS[section]![0]}`;
      if (used !== count) this.fail(`it has ${count} elements, but ${used} are in use`);
    }
  }
}

function readScene(r: Reader, scene: Finished): void {
  if (r.u32() !== scene.materials.length || r.u32() !== scene.meshes.length) r.fail('is of another scene');
  if (r.u32() || r.u32()) r.fail('a reserved field is not 0');
}

function readUse(r: Reader): TextureUse {
  const texture = r.u32();
  if (texture !== NONE && texture >= r.count(TEXTURES)) r.fail(`texture ${texture} of ${r.count(TEXTURES)}`);
  const uvSet = r.upTo(1, 'UV set');
  const transform = Float32Array.from({ length: 6 }, () =>
    r.float(-Number.MAX_VALUE, Number.MAX_VALUE, 'transform'),
  );
  return { texture, uvSet, transform };
}

function readFinish(r: Reader): Finish {
  const metalness = r.float(0, 1, 'metalness');
  const roughness = r.float(0, 1, 'roughness');
  const specular = r.float(0, 1, 'specular');
  const specularColour = Float32Array.from({ length: 3 }, () => r.float(0, FACTOR_MAX, 'specular colour'));
  const ior = r.float(1, FACTOR_MAX, 'ior');
  const occlusion = r.float(0, 1, 'occlusion');
  const normalScale = r.float(-FACTOR_MAX, FACTOR_MAX, 'normal scale');
  const surface = readUse(r);
  const specularTexture = readUse(r);
  const occlusionTexture = readUse(r);
  const normal = readUse(r);
  return {
    ...{ metalness, roughness, surface, specular, specularColour, specularTexture, ior },
    ...{ occlusion, occlusionTexture, normalScale, normal },
  };
}

/** Puts a filtered plane (docs/scene_package.md, Pixels) into every `step`th byte of `out`, from `at` on. */
function unfilter(plane: Uint8Array, width: number, out: Uint8Array, at: number, step: number): void {
  const row = step * width;
  for (let i = 0, to = at; i < plane.length; i++, to += step) {
    const column = i % width;
    let expected = 0;
    if (column && i >= width) {
      const a = out[to - step]!;
      const b = out[to - row]!;
      const c = out[to - row - step]!;
      const [low, high] = a < b ? [a, b] : [b, a];
      expected = c >= high ? low : c <= low ? high : a + b - c;
    } else if (column) expected = out[to - step]!;
    else if (i) expected = out[to - row]!;
    out[to] = plane[i]! + expected; // modulo 256
  }
}

function readTexture(r: Reader): FinishTexture {
  r.name();
  const width = r.upTo(SIDE_MAX, 'width');
  const height = r.upTo(SIDE_MAX, 'height');
  if (!width || !height) r.fail('it is empty');
  const content = r.upTo(2, 'content');
  const wrapS = r.upTo(2, 'wrap');
  const wrapT = r.upTo(2, 'wrap');
  const planes = PLANES[content]!;
  const size = width * height;
  const bytes = r.take(PIXELS, r.u32(), planes * size);
  const step = content === Content.NORMAL ? 2 : 4;
  const texels = new Uint8Array(step * size);
  if (content === Content.SURFACE) texels.fill(255);
  for (let p = 0; p < planes; p++) unfilter(bytes.subarray(p * size, (p + 1) * size), width, texels, p, step);
  if (content === Content.COLOUR)
    for (let i = 0; i < texels.length; i += 4) {
      texels[i]! += texels[i + 1]!;
      texels[i + 2]! += texels[i + 1]!;
    }
  return { width, height, content, texels, wrapS, wrapT };
}

function checkContent(r: Reader, use: TextureUse, content: number, textures: FinishTexture[]): void {
  const found = textures[use.texture]?.content ?? content;
  if (found !== content) r.fail(`texture ${use.texture} has content ${found}, not ${content}`);
}

/** Reads the finishes of a scene. What they hold is theirs. */
export function readFinishPackage(bytes: Uint8Array, scene: Finished): Finishes {
  const r = new Reader(bytes);
  if (r.count(SCENE) !== 1 || !r.count(FINISHES)) r.fail('it has no scene, or no finish');
  r.records(SCENE, () => readScene(r, scene));
  const materials: (Finish | null)[] = Array.from({ length: scene.materials.length }, () => null);
  const tangents: (Uint16Array | null)[] = Array.from({ length: scene.meshes.length }, () => null);
  const ascending = (last: number, limit: number, what: string): number => {
    const index = r.u32();
    if (index >= limit || index <= last) r.fail(`${what} ${index}, after ${last} of ${limit}`);
    return index;
  };
  let last = -1;
  r.records(FINISHES, () => {
    last = ascending(last, materials.length, 'material');
    materials[last] = readFinish(r);
  });
  const textures = r.records(TEXTURES, () => readTexture(r));
  last = -1;
  r.records(MESHES, () => {
    last = ascending(last, tangents.length, 'mesh');
    const codes = r.take(TANGENTS, r.u32(), 3 * scene.meshes[last]!.triangleCount);
    tangents[last] = new Uint16Array(codes.slice().buffer);
  });
  r.finish();
  materials.forEach((finish, i) => {
    if (!finish) return;
    r.place = `material ${i}`;
    checkContent(r, finish.surface, Content.SURFACE, textures);
    checkContent(r, finish.specularTexture, Content.COLOUR, textures);
    checkContent(r, finish.occlusionTexture, Content.SURFACE, textures);
    checkContent(r, finish.normal, Content.NORMAL, textures);
  });
  return { materials, textures, tangents };
}
