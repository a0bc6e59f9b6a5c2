// tiles.ts: our own C (wasm/web_tiles.c) as functions: tiles, hashes, pixels.
import { ZSTDDecoder } from 'zstddec';

import { LimitError } from './failure.ts';

interface Exports {
  memory: WebAssembly.Memory;
  lw_web_tiles_init(): void;
  lw_web_tiles_channel(number: number, column: number): number;
  lw_web_tiles_choose(planes: number, isSigned: boolean, isPlain: boolean): void;
  lw_web_tiles_values(): number;
  lw_web_tiles_packed(): number;
  lw_web_tiles_alloc(size: number): number;
  lw_web_tiles_free(at: number): void;
  lw_web_tiles_coefficients(width: number, height: number): number;
  lw_web_tiles_decode(
    kind: number,
    src: number,
    size: number,
    scale: number,
    w: number,
    h: number,
    coefficients: number,
  ): number;
  lw_web_tiles_decode_half(planes: number, scale: number, w: number, h: number): number;
  lw_web_tiles_pack(texels: number, sum: number): void;
  lw_web_tiles_unit(): number;
  lw_web_tiles_hash_begin(): void;
  lw_web_tiles_hash_add(bytes: number, size: number): void;
  lw_web_tiles_hash_finish(hash: number): void;
  lw_web_tiles_unfilter(bytes: number, w: number, h: number, rgba: number): void;
  lw_web_tiles_coarsest(
    position: number,
    uv: number,
    vertices: number,
    triangle: number,
    triangles: number,
    w: number,
    h: number,
    level: number,
  ): number;
}

const PAYLOAD_MAX = 1 << 18;
const TEXELS_MAX = 64 * 64;

/** Gives the bytes of zstd.wasm, before the first Tiles.create(). build.mjs takes them out of zstddec. */
export function zstdFrom(load: () => Promise<ArrayBuffer>): void {
  (ZSTDDecoder as unknown as { load: typeof load }).load = load;
}

/** A channel of tiles: common/tile/tile_channels.h. */
export interface Channel {
  planes: number;
  isSigned: boolean;
  isPlain: boolean;
  asked: bigint; // a session gets it whose features, masked by `asked`, are `asks`
  asks: bigint;
  slot: number; // channels of one slot exclude each other; 0: irradiance
}

/** Of channels, those that a session with these features gets, by slot: their numbers. */
export function channelsFor(channels: Channel[], features: bigint): Map<number, number> {
  const taken = new Map<number, number>();
  channels.forEach((channel, number) => {
    if ((features & channel.asked) === channel.asks) taken.set(channel.slot, number);
  });
  return taken;
}

/** What deltas of a tile build on: a place in the module's memory. */
export type Coefficients = number;

export class Tiles {
  private readonly wasm: Exports;
  private readonly payload: number;
  private readonly sum: number;
  private readonly zstd: ZSTDDecoder;
  /** What tiles may hold, by number: their `layer`. */
  readonly channels: Channel[] = [];
  /** A texel of 1 in a texture is so much light, W/m^2. */
  readonly unit: number;

  private constructor(instance: WebAssembly.Instance, zstd: ZSTDDecoder) {
    this.wasm = instance.exports as unknown as Exports;
    this.zstd = zstd;
    this.wasm.lw_web_tiles_init();
    this.payload = this.alloc(PAYLOAD_MAX);
    this.sum = this.alloc(24);
    this.unit = this.wasm.lw_web_tiles_unit();
    const of = (column: number) => this.wasm.lw_web_tiles_channel(this.channels.length, column);
    while (of(0) >= 0)
      this.channels.push({
        planes: of(0),
        isSigned: of(1) === 1,
        isPlain: of(2) === 1,
        asked: BigInt(of(3)),
        asks: BigInt(of(4)),
        slot: of(5),
      });
  }

  static async create(module: BufferSource): Promise<Tiles> {
    const zstd = new ZSTDDecoder();
    const [made] = await Promise.all([WebAssembly.instantiate(module, {}), zstd.init()]);
    return new Tiles(made.instance, zstd);
  }

  private alloc(size: number): number {
    const at = this.wasm.lw_web_tiles_alloc(Math.max(size, 1));
    if (!at) throw new LimitError('this page has no memory left for the scene');
    return at;
  }

  /** Copies bytes into the module's memory; to be freed. */
  private put(bytes: ArrayBufferView): number {
    const at = this.alloc(bytes.byteLength);
    new Uint8Array(this.wasm.memory.buffer, at).set(
      new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength),
    );
    return at;
  }

  /** Of the module. */
  memoryBytes(): number {
    return this.wasm.memory.buffer.byteLength;
  }

  /** What is decoded from now on is of this channel. */
  choose(channel: Channel): void {
    this.wasm.lw_web_tiles_choose(channel.planes, channel.isSigned, channel.isPlain);
  }

  createCoefficients(width: number, height: number): Coefficients {
    const coefficients = this.wasm.lw_web_tiles_coefficients(width, height);
    if (!coefficients) throw new LimitError('this page has no memory left for tiles');
    return coefficients;
  }

  freeCoefficients(coefficients: Coefficients): void {
    this.wasm.lw_web_tiles_free(coefficients);
  }

  /** Decodes a payload of codec 4. delta: it builds on `coefficients`, which become those of this version.
   * False: it is damaged. */
  decode(
    delta: boolean,
    payload: Uint8Array,
    scale: number,
    width: number,
    height: number,
    coefficients: Coefficients,
  ): boolean {
    new Uint8Array(this.wasm.memory.buffer, this.payload).set(payload);
    return (
      this.wasm.lw_web_tiles_decode(
        delta ? 2 : 1,
        this.payload,
        payload.length,
        scale,
        width,
        height,
        coefficients,
      ) !== 0
    );
  }

  /** Decodes a payload of codec 1. */
  decodeHalf(planeCount: number, payload: Uint8Array, scale: number, width: number, height: number): boolean {
    const planes = this.decompress(payload, 2 * planeCount * width * height);
    if (!planes) return false;
    new Uint8Array(this.wasm.memory.buffer, this.payload).set(planes);
    return this.wasm.lw_web_tiles_decode_half(this.payload, scale, width, height) !== 0;
  }

  /** What was decoded last, a number per plane, good until the next call. */
  values(count: number): Float32Array {
    return new Float32Array(this.wasm.memory.buffer, this.wasm.lw_web_tiles_values(), count);
  }

  /** Light that was decoded last as RGB9E5 into `out`; returns the sum of each channel, W/m^2. */
  pack(out: Uint32Array): Float64Array {
    this.wasm.lw_web_tiles_pack(out.length, this.sum);
    out.set(new Uint32Array(this.wasm.memory.buffer, this.wasm.lw_web_tiles_packed(), out.length));
    return new Float64Array(this.wasm.memory.buffer.slice(this.sum, this.sum + 24));
  }

  /** Any number of texels of 3 floats as RGB9E5. */
  packAll(rgb: Float32Array): Uint32Array {
    const out = new Uint32Array(rgb.length / 3);
    for (let at = 0; at < out.length; at += TEXELS_MAX) {
      const some = out.subarray(at, at + TEXELS_MAX);
      this.values(3 * TEXELS_MAX).set(rgb.subarray(3 * at, 3 * (at + some.length)));
      this.pack(some);
    }
    return out;
  }

  /** Vectors of 3 numbers from -1 to 1 as RGB9E5, by half and a half more. */
  packDirections(xyz: Float32Array): Uint32Array<ArrayBuffer> {
    const { unit } = this;
    const half = xyz.map((x) => (0.5 + 0.5 * Math.min(1, Math.max(-1, x))) * unit);
    return this.packAll(half) as Uint32Array<ArrayBuffer>;
  }

  /** Decompresses one zstd frame of `size` bytes; null if it is none. */
  decompress(frame: Uint8Array, size: number): Uint8Array | null {
    const bytes = this.zstd.decode(frame, size);
    return bytes.length === size ? bytes : null;
  }

  /** XXH3-128, most significant byte first. */
  hash(bytes: Uint8Array): Uint8Array {
    this.wasm.lw_web_tiles_hash_begin();
    for (let at = 0; at < bytes.length; at += PAYLOAD_MAX) {
      const some = bytes.subarray(at, at + PAYLOAD_MAX);
      new Uint8Array(this.wasm.memory.buffer, this.payload).set(some);
      this.wasm.lw_web_tiles_hash_add(this.payload, some.length);
    }
    this.wasm.lw_web_tiles_hash_finish(this.payload);
    return new Uint8Array(this.wasm.memory.buffer, this.payload, 16).slice();
  }

  /** Pixels of a package of version 3, as RGBA. */
  unfilter(bytes: Uint8Array, width: number, height: number): Uint8Array<ArrayBuffer> {
    const at = this.put(bytes);
    const out = this.alloc(bytes.length);
    this.wasm.lw_web_tiles_unfilter(at, width, height, out);
    const rgba = new Uint8Array(this.wasm.memory.buffer, out, bytes.length).slice();
    this.wasm.lw_web_tiles_free(out);
    this.wasm.lw_web_tiles_free(at);
    return rgba as Uint8Array<ArrayBuffer>;
  }

  /** By triangle: the coarsest level up to 2 on which look-ups read light of its own chart alone. Indices
   * have been checked. */
  coarsest(
    position: Float32Array,
    lightmapUv: Float32Array,
    triangle: Uint32Array,
    width: number,
    height: number,
  ): Uint8Array {
    const triangles = triangle.length / 3;
    const at = [this.put(position), this.put(lightmapUv), this.put(triangle), this.alloc(triangles)] as const;
    const ok = this.wasm.lw_web_tiles_coarsest(
      at[0],
      at[1],
      position.length / 3,
      at[2],
      triangles,
      width,
      height,
      at[3],
    );
    const levels = new Uint8Array(this.wasm.memory.buffer, at[3], triangles).slice();
    for (const place of at) this.wasm.lw_web_tiles_free(place);
    if (!ok) throw new LimitError('this page has no memory left for the scene');
    return levels;
  }
}
