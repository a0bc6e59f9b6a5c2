// wire.ts: messages as bytes: proto/wire_format.md, sections 1 and 2.
// A broken "must" there is a ProtocolError that names message and field.
import { ProtocolError } from './failure.ts';

export const HEADER_BYTES = 8;
export const BODY_MAX = 1 << 20;
export const INTEREST_MAX = 4096;
export const HOLDS_MAX = 2048;
const FIELDS_MAX = 64;
const TEXT_MAX = 256;
const RETRY_AFTER_MAX = 3_600_000;
const NAME_MAX = 64;
const PAYLOAD_MAX = 1 << 18;
const PARTS_MAX = (1 << 14) + 2;
const FINISH_PARTS_MAX = 8192;
const PACKAGE_MAX = 2 ** 32;
const COMPRESSED_MAX = PACKAGE_MAX + PACKAGE_MAX / 256;
const BOUNCES_MAX = 64;
const RELAYS_MAX = 16;
const SERVERS_MAX = 1024;
const FINER_MAX = 4;

export const Type = {
  HELLO: 1,
  WELCOME: 2,
  REFUSAL: 3,
  PACKAGE_REQUEST: 4,
  PACKAGE_CHUNK: 5,
  INTEREST: 6,
  FRAME: 7,
  TILE: 8,
  ACK: 9,
  PING: 10,
  PONG: 11,
  SETTLED: 12,
  UPDATE: 13,
  UPDATED: 14,
  HOLDS: 15,
  WAITING: 18,
  FINISH_REQUEST: 19,
  FINISH_CHUNK: 20,
} as const;

export const Feature = {
  CONTROL: 2n,
  RESUME: 4n,
  PARTS: 16n,
  DCT: 32n,
  DRAWS: 64n,
  MATERIALS: 256n,
  FINER: 512n,
  RUNS: 1024n,
  DIRECTION: 2048n,
} as const;

export const Refusal = {
  VERSION: 1,
  FULL: 2,
  PROTOCOL: 3,
  SHUTDOWN: 4,
  TIMEOUT: 5,
  FEATURES: 6,
  RATE: 7,
  NOT_ALLOWED: 8,
  TOKEN: 9,
} as const;

const text = new TextDecoder('utf-8', { fatal: true });

/** Fields of one body, one after another. */
class Reader {
  private at = 0;
  private fields = 0;
  private readonly view: DataView;
  no = 0;
  private kind = 0;

  constructor(
    private readonly name: string,
    private readonly bytes: Uint8Array,
  ) {
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  }

  fail(what: string): never {
    throw new ProtocolError(`message ${this.name}: ${what}`);
  }

  /** Goes to the next field; false at the end. */
  next(): boolean {
    if (this.at === this.bytes.length) return false;
    if (++this.fields > FIELDS_MAX) this.fail('too many fields');
    const key = this.varint();
    if (key >> 3n === 0n || key >> 32n !== 0n) this.fail('a field without a number');
    this.no = Number(key >> 3n);
    this.kind = Number(key & 7n);
    return true;
  }

  private expect(kind: number): void {
    if (this.kind !== kind) this.fail(`field ${this.no} has wire type ${this.kind}`);
  }

  private take(size: number): number {
    if (size > this.bytes.length - this.at) this.fail('it ends early');
    this.at += size;
    return this.at - size;
  }

  private varint(): bigint {
    let low = 0;
    let high = 0;
    for (let shift = 0; shift < 70; shift += 7) {
      const byte = this.bytes[this.take(1)]!;
      if (shift < 28) low |= (byte & 127) << shift;
      else if (shift === 28) {
        low |= (byte & 15) << 28;
        high |= (byte & 127) >> 4;
      } else if (shift < 63) high |= (byte & 127) << (shift - 32);
      else high |= (byte & 1) << 31;
      if (byte < 128) return high ? (BigInt(high >>> 0) << 32n) | BigInt(low >>> 0) : BigInt(low >>> 0);
    }
    return this.fail('a number without an end');
  }

  uint64(): bigint {
    this.expect(0);
    return this.varint();
  }

  /** Within 0 to max, which is at most 2^53. */
  uint(max: number): number {
    const value = this.uint64();
    if (value > BigInt(max)) this.fail(`field ${this.no} is ${value}, over ${max}`);
    return Number(value);
  }

  uint32(): number {
    return this.uint(0xffffffff);
  }

  float(): number {
    this.expect(5);
    return this.finite(this.view.getFloat32(this.take(4), true));
  }

  double(): number {
    this.expect(1);
    return this.finite(this.view.getFloat64(this.take(8), true));
  }

  private finite(value: number): number {
    if (!Number.isFinite(value)) this.fail(`field ${this.no} is not finite`);
    return value;
  }

  /** Of the body's own memory. */
  blob(max: number): Uint8Array {
    this.expect(2);
    const size = this.varint();
    if (size > BigInt(max)) this.fail(`field ${this.no} has ${size} bytes, over ${max}`);
    const at = this.take(Number(size));
    return this.bytes.subarray(at, at + Number(size));
  }

  string(max: number): string {
    const bytes = this.blob(max);
    let value = '';
    try {
      value = text.decode(bytes);
    } catch {
      this.fail(`field ${this.no} is no UTF-8`);
    }
    if (/[\u0000-\u001f\u007f-\u009f]/.test(value)) this.fail(`field ${this.no} has control characters`);
    return value;
  }

  /** A packed list of elements of `width` bytes, as memory of its own. */
  private packed(width: number, max: number): ArrayBuffer {
    const bytes = this.blob(width * max);
    if (bytes.length % width) this.fail(`field ${this.no} has ${bytes.length} bytes`);
    return bytes.slice().buffer as ArrayBuffer;
  }

  fixed32s(max: number): Uint32Array {
    return new Uint32Array(this.packed(4, max));
  }

  fixed64s(max: number): BigUint64Array {
    return new BigUint64Array(this.packed(8, max));
  }

  floats(max: number): Float32Array {
    const values = new Float32Array(this.packed(4, max));
    for (const value of values) this.finite(value);
    return values;
  }

  skip(): void {
    if (this.kind === 0) this.varint();
    else if (this.kind === 1) this.take(8);
    else if (this.kind === 2) this.blob(BODY_MAX);
    else if (this.kind === 5) this.take(4);
    else this.fail(`field ${this.no} has wire type ${this.kind}`);
  }
}

export interface Header {
  type: number;
  size: number;
}

/** at: a header is there. */
export function readHeader(bytes: Uint8Array, at: number): Header {
  const view = new DataView(bytes.buffer, bytes.byteOffset + at, HEADER_BYTES);
  const size = view.getUint32(0, true);
  const type = view.getUint16(4, true);
  if (view.getUint16(6, true)) throw new ProtocolError(`a message of type ${type} with flags`);
  if (size > BODY_MAX)
    throw new ProtocolError(`a message of type ${type} with ${size} bytes, over ${BODY_MAX}`);
  return { type, size };
}

export interface Part {
  size: number;
  compressedSize: number;
  hash: Uint8Array;
}

/** A package as a server announces it. */
export interface AnnouncedPackage {
  hash: Uint8Array;
  size: number;
  compressedSize: number;
  parts: Part[]; // at least one
}

export interface Welcome {
  features: bigint;
  name: string;
  package: AnnouncedPackage;
  bounces: number;
  targetError: number;
  run: bigint;
  noiseShown: number;
  clientLights: Uint8Array;
  clientMaterials: Uint8Array;
  finish: AnnouncedPackage | null;
  servers: string; // other ones of this light, apart by commas
  finer: number; // levels that are finer than level 0
}

const noPackage = (): AnnouncedPackage => ({ hash: new Uint8Array(0), size: 0, compressedSize: 0, parts: [] });

/** The three lists of parts of a package, as they are read. */
class PartLists {
  private sizes: BigUint64Array = new BigUint64Array(0);
  private compressed: BigUint64Array = new BigUint64Array(0);
  private hashes: Uint8Array = new Uint8Array(0);

  constructor(
    private readonly first: number, // field number; the other two lists have the next ones
    private readonly max: number,
  ) {}

  /** Whether the field is one of them. */
  take(r: Reader): boolean {
    if (r.no === this.first) this.sizes = r.fixed64s(this.max);
    else if (r.no === this.first + 1) this.compressed = r.fixed64s(this.max);
    else if (r.no === this.first + 2) this.hashes = r.blob(16 * this.max).slice();
    else return false;
    return true;
  }

  into(r: Reader, of: AnnouncedPackage): void {
    const { sizes, compressed, hashes } = this;
    if (compressed.length !== sizes.length || hashes.length !== 16 * sizes.length)
      r.fail('the lists of parts have different lengths');
    let size = 0n;
    let compressedSize = 0n;
    sizes.forEach((bytes, i) => {
      if (!bytes || !compressed[i]) r.fail(`part ${i} has no bytes`);
      size += bytes;
      compressedSize += compressed[i]!;
      if (size > BigInt(of.size) || compressedSize > BigInt(of.compressedSize))
        r.fail('the parts are more than the package');
      of.parts.push({
        size: Number(bytes),
        compressedSize: Number(compressed[i]),
        hash: hashes.subarray(16 * i, 16 * i + 16),
      });
    });
    if (sizes.length && (size !== BigInt(of.size) || compressedSize !== BigInt(of.compressedSize)))
      r.fail('the parts are less than the package');
  }
}

export function readWelcome(body: Uint8Array): Welcome {
  const r = new Reader('WELCOME', body);
  const w: Welcome = {
    features: 0n,
    name: '',
    package: noPackage(),
    bounces: 0,
    targetError: 0,
    run: 0n,
    noiseShown: 0,
    clientLights: new Uint8Array(0),
    clientMaterials: new Uint8Array(0),
    finish: null,
    servers: '',
    finer: 0,
  };
  const finish = noPackage();
  let version = 0;
  const parts = new PartLists(11, PARTS_MAX);
  const finishParts = new PartLists(20, FINISH_PARTS_MAX);
  while (r.next()) {
    if (r.no === 1) version = r.uint32();
    else if (r.no === 2) w.features = r.uint64();
    else if (r.no === 4) w.name = r.string(NAME_MAX);
    else if (r.no === 5) w.package.hash = r.blob(16).slice();
    else if (r.no === 6) w.package.size = r.uint(PACKAGE_MAX);
    else if (r.no === 7) w.package.compressedSize = r.uint(COMPRESSED_MAX);
    else if (r.no === 8) w.bounces = r.uint(BOUNCES_MAX);
    else if (r.no === 9) w.targetError = r.float();
    else if (r.no === 10) w.run = r.uint64();
    else if (r.no === 14) w.noiseShown = r.float();
    else if (r.no === 15) w.clientLights = r.blob((1 << 20) / 8).slice();
    else if (r.no === 16) w.clientMaterials = r.blob((1 << 16) / 8).slice();
    else if (r.no === 17) finish.hash = r.blob(16).slice();
    else if (r.no === 18) finish.size = r.uint(0xffffffff);
    else if (r.no === 19) finish.compressedSize = r.uint(COMPRESSED_MAX);
    else if (r.no === 23) r.fixed64s(RELAYS_MAX);
    else if (r.no === 24) w.servers = r.string(SERVERS_MAX);
    else if (r.no === 25) w.finer = r.uint(FINER_MAX);
    else if (!parts.take(r) && !finishParts.take(r)) r.skip();
  }
  if (version !== 1) r.fail(`version ${version}; this client speaks version 1`);
  if (w.package.hash.length !== 16) r.fail(`package_hash has ${w.package.hash.length} bytes`);
  if (!w.package.size || !w.package.compressedSize) r.fail('the package has no bytes');
  if (w.targetError < 0) r.fail('target_error is below 0');
  if (w.noiseShown < 0 || w.noiseShown > 1) r.fail('noise_shown is not within 0 to 1');
  if (w.noiseShown === 0) w.noiseShown = 1;
  parts.into(r, w.package);
  if (!w.package.parts.length) w.package.parts.push(w.package);
  finishParts.into(r, finish);
  const none = !finish.size && !finish.compressedSize;
  if (finish.hash.length !== (none ? 0 : 16) || none !== !finish.parts.length || none !== !finish.size)
    r.fail('finish_hash, sizes and parts of finishes do not belong together');
  if (!none && !finish.compressedSize) r.fail('the finish package has no bytes');
  if (!none) w.finish = finish;
  return w;
}

export function readRefusal(body: Uint8Array): { code: number; text: string; retryAfterMs: number } {
  const r = new Reader('REFUSAL', body);
  const refusal = { code: 0, text: '', retryAfterMs: 0 };
  while (r.next()) {
    if (r.no === 1) refusal.code = r.uint(65535);
    else if (r.no === 2) refusal.text = r.string(TEXT_MAX);
    else if (r.no === 3) refusal.retryAfterMs = r.uint(RETRY_AFTER_MAX);
    else r.skip();
  }
  if (!refusal.code) r.fail('code 0');
  return refusal;
}

/** PACKAGE_CHUNK and FINISH_CHUNK. */
export function readChunk(body: Uint8Array): { offset: number; data: Uint8Array } {
  const r = new Reader('PACKAGE_CHUNK', body);
  const chunk: { offset: number; data: Uint8Array } = { offset: 0, data: new Uint8Array(0) };
  while (r.next()) {
    if (r.no === 1) chunk.offset = r.uint(COMPRESSED_MAX);
    else if (r.no === 2) chunk.data = r.blob(1 << 18);
    else r.skip();
  }
  if (!chunk.data.length) r.fail('no data');
  return chunk;
}

export interface Frame {
  frame: bigint;
  timeS: number;
  solveNs: number;
  sky: Float32Array; // 3
  object: Uint32Array;
  transform: Float32Array; // 12 for each object
  light: Uint32Array;
  lightPosition: Float32Array; // 3 for each light, as the next two
  lightDirection: Float32Array;
  lightIntensity: Float32Array;
  hidden: Uint32Array;
  shown: Uint32Array;
  spares: number; // of hidden, the first
  run: bigint; // 0: as before
  material: Uint32Array;
  baseColour: Float32Array; // 3 for each material, as the next
  emission: Float32Array;
}

const noFloats = new Float32Array(0);
const noInts = new Uint32Array(0);

export function readFrame(body: Uint8Array): Frame {
  const r = new Reader('FRAME', body);
  const f: Frame = {
    frame: 0n,
    timeS: 0,
    solveNs: 0,
    sky: noFloats,
    object: noInts,
    transform: noFloats,
    light: noInts,
    lightPosition: noFloats,
    lightDirection: noFloats,
    lightIntensity: noFloats,
    hidden: noInts,
    shown: noInts,
    spares: 0,
    run: 0n,
    material: noInts,
    baseColour: noFloats,
    emission: noFloats,
  };
  while (r.next()) {
    if (r.no === 1) f.frame = r.uint64();
    else if (r.no === 2) f.timeS = r.double();
    else if (r.no === 3) f.solveNs = Number(r.uint64());
    else if (r.no === 6) f.sky = r.floats(3);
    else if (r.no === 7) f.object = r.fixed32s(8192);
    else if (r.no === 8) f.transform = r.floats(12 * 8192);
    else if (r.no === 9) f.light = r.fixed32s(8192);
    else if (r.no === 10) f.lightPosition = r.floats(3 * 8192);
    else if (r.no === 11) f.lightDirection = r.floats(3 * 8192);
    else if (r.no === 12) f.lightIntensity = r.floats(3 * 8192);
    else if (r.no === 14) f.hidden = r.fixed32s(8192);
    else if (r.no === 15) f.shown = r.fixed32s(8192);
    else if (r.no === 16) f.material = r.fixed32s(4096);
    else if (r.no === 17) f.baseColour = r.floats(3 * 4096);
    else if (r.no === 18) f.emission = r.floats(3 * 4096);
    else if (r.no === 19) f.spares = r.uint32();
    else if (r.no === 20) f.run = r.uint64();
    else r.skip();
  }
  if (!f.frame) r.fail('frame 0');
  const least = (values: Float32Array) => values.reduce((a, b) => Math.min(a, b), 0);
  if (f.sky.length !== 3 || least(f.sky) < 0) r.fail('sky is not 3 values from 0');
  if (f.transform.length !== 12 * f.object.length) r.fail('transform has not 12 values for each object');
  const lights = 3 * f.light.length;
  if (
    f.lightPosition.length !== lights ||
    f.lightDirection.length !== lights ||
    f.lightIntensity.length !== lights
  )
    r.fail('lights have not 3 values each');
  const materials = 3 * f.material.length;
  if (f.baseColour.length !== materials || f.emission.length !== materials)
    r.fail('materials have not 3 values each');
  if (least(f.baseColour) < 0 || least(f.emission) < 0) r.fail('a factor is below 0');
  if (f.spares > f.hidden.length) r.fail('more spares than hidden objects');
  return f;
}

export interface Tile {
  object: number;
  level: number;
  tile: number;
  version: bigint;
  layer: number;
  codec: number;
  scale: number;
  bounces: number;
  error: number;
  payload: Uint8Array; // of the body's memory
  base: bigint;
}

export function readTile(body: Uint8Array): Tile {
  const r = new Reader('TILE', body);
  const t: Tile = {
    object: 0,
    level: 0,
    tile: 0,
    version: 0n,
    layer: 0,
    codec: 0,
    scale: 0,
    bounces: 0,
    error: 0,
    payload: new Uint8Array(0),
    base: 0n,
  };
  while (r.next()) {
    if (r.no === 1) t.object = r.uint32();
    else if (r.no === 2) t.level = r.uint32();
    else if (r.no === 3) t.tile = r.uint32();
    else if (r.no === 4) t.version = r.uint64();
    else if (r.no === 5) t.layer = r.uint32();
    else if (r.no === 6) t.codec = r.uint32();
    else if (r.no === 7) t.scale = r.float();
    else if (r.no === 8) t.bounces = r.uint(BOUNCES_MAX);
    else if (r.no === 9) t.error = r.float();
    else if (r.no === 10) t.payload = r.blob(PAYLOAD_MAX);
    else if (r.no === 11) t.base = r.uint64();
    else r.skip();
  }
  if (!t.version) r.fail('version 0');
  if (!(t.scale > 0)) r.fail('scale is not above 0');
  if (t.error < 0) r.fail('error is below 0');
  if (!t.payload.length) r.fail('no payload');
  if (t.base && (t.codec !== 4 || t.base >= t.version)) r.fail('base_version makes no sense');
  return t;
}

/** PING and PONG. */
export function readToken(body: Uint8Array): bigint {
  const r = new Reader('PING', body);
  let token = 0n;
  while (r.next()) {
    if (r.no === 1) token = r.uint64();
    else r.skip();
  }
  return token;
}

export function readSettled(body: Uint8Array): bigint {
  const r = new Reader('SETTLED', body);
  let frame = 0n;
  while (r.next()) {
    if (r.no === 1) frame = r.uint64();
    else r.skip();
  }
  if (!frame) r.fail('frame 0');
  return frame;
}

/** Why there is no light yet. */
export interface Waiting {
  stage: number; // waiting.ts names some
  share: number; // of it that is done, 0 to 1
}

export function readWaiting(body: Uint8Array): Waiting {
  const r = new Reader('WAITING', body);
  const w = { stage: 0, share: 0 };
  while (r.next()) {
    if (r.no === 1) w.stage = r.uint32();
    else if (r.no === 2) w.share = r.float();
    else r.skip();
  }
  if (w.stage < 1 || w.stage > 65535) r.fail('stage out of range');
  if (w.share < 0 || w.share > 1) r.fail('share out of range');
  return w;
}

/** The answer to an UPDATE. code: 0: done. */
export function readUpdated(body: Uint8Array): { request: bigint; code: number; text: string } {
  const r = new Reader('UPDATED', body);
  const u = { request: 0n, code: 0, text: '' };
  while (r.next()) {
    if (r.no === 1) u.request = r.uint64();
    else if (r.no === 2) u.code = r.uint32();
    else if (r.no === 4) u.text = r.string(TEXT_MAX);
    else r.skip();
  }
  return u;
}

/** A message as it grows; fields of value 0 are left out. */
class Writer {
  private bytes = new Uint8Array(64);
  private size = HEADER_BYTES;

  private reserve(more: number): number {
    if (this.size + more > this.bytes.length) {
      const grown = new Uint8Array(2 * (this.size + more));
      grown.set(this.bytes);
      this.bytes = grown;
    }
    this.size += more;
    return this.size - more;
  }

  private varint(value: bigint): void {
    for (; value > 127n; value >>= 7n) this.bytes[this.reserve(1)] = Number(value & 127n) | 128;
    this.bytes[this.reserve(1)] = Number(value);
  }

  uint(no: number, value: bigint | number): this {
    if (!value) return this;
    this.varint(BigInt(no << 3));
    this.varint(BigInt(value));
    return this;
  }

  blob(no: number, value: Uint8Array): this {
    if (!value.length) return this;
    this.varint(BigInt((no << 3) | 2));
    this.varint(BigInt(value.length));
    const at = this.reserve(value.length);
    this.bytes.set(value, at);
    return this;
  }

  list(no: number, values: Uint32Array | BigUint64Array | Float32Array): this {
    return this.blob(no, new Uint8Array(values.buffer, values.byteOffset, values.byteLength));
  }

  finish(type: number): Uint8Array<ArrayBuffer> {
    const view = new DataView(this.bytes.buffer);
    view.setUint32(0, this.size - HEADER_BYTES, true);
    view.setUint16(4, type, true);
    return this.bytes.slice(0, this.size);
  }
}

/** token: 32 bytes, or none. */
export function writeHello(features: bigint, name: string, token: Uint8Array = new Uint8Array(0)): Uint8Array<ArrayBuffer> {
  return new Writer()
    .uint(1, 1)
    .uint(2, features)
    .blob(3, new TextEncoder().encode(name))
    .blob(5, token)
    .finish(Type.HELLO);
}

export interface Change {
  kind: number;
  target: number;
  values: number[];
}

export function writeUpdate(request: bigint, changes: Change[]): Uint8Array<ArrayBuffer> {
  const each = (value: (change: Change) => number) => Uint32Array.from(changes, value);
  return new Writer()
    .uint(1, request)
    .list(
      2,
      each((change) => change.kind),
    )
    .list(
      3,
      each((change) => change.target),
    )
    .list(
      4,
      each((change) => change.values.length),
    )
    .list(5, Float32Array.from(changes.flatMap((change) => change.values)))
    .finish(Type.UPDATE);
}

/** held: a bit for each part. type: PACKAGE_REQUEST or FINISH_REQUEST. */
export function writePackageRequest(
  offset: number,
  held: Uint8Array,
  type: number = Type.PACKAGE_REQUEST,
): Uint8Array<ArrayBuffer> {
  return new Writer().uint(1, offset).blob(2, held).finish(type);
}

export interface TileList {
  object: Uint32Array;
  level: Uint32Array;
  tile: Uint32Array;
}

export function writeInterest(
  everything: boolean,
  list: TileList,
  standIns: boolean,
): Uint8Array<ArrayBuffer> {
  const writer = new Writer()
    .uint(1, everything ? 1 : 0)
    .list(2, list.object)
    .list(3, list.level)
    .list(4, list.tile);
  return writer.uint(5, standIns ? 1 : 0).finish(Type.INTEREST);
}

export function writeHolds(list: TileList, version: BigUint64Array): Uint8Array<ArrayBuffer> {
  return new Writer()
    .list(1, list.object)
    .list(2, list.level)
    .list(3, list.tile)
    .list(4, version)
    .finish(Type.HOLDS);
}

/** No FRAME before this one is to come. */
export function writeHoldsFrame(frame: bigint): Uint8Array<ArrayBuffer> {
  return new Writer().uint(5, frame).finish(Type.HOLDS);
}

export function writeAck(frame: bigint): Uint8Array<ArrayBuffer> {
  return new Writer().uint(1, frame).finish(Type.ACK);
}

export function writePing(token: bigint): Uint8Array<ArrayBuffer> {
  return new Writer().uint(1, token).finish(Type.PING);
}

export function writePong(token: bigint): Uint8Array<ArrayBuffer> {
  return new Writer().uint(1, token).finish(Type.PONG);
}
