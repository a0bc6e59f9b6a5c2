// replica.ts: the client's copy of the lit scene: where things are, and which version of each tile is here;
// as client/lib/replica.h. Outlives connections. Texels are not kept: they go on to the renderer.
import { AtlasMap, FINER, noiseLevelMin } from './atlas.ts';
import { ProtocolError } from './failure.ts';
import { NONE, type Scene } from './package.ts';
import { type Channel, channelsFor, type Coefficients, type Tiles } from './tiles.ts';
import type { Frame, Tile, TileList } from './wire.ts';

/** Tiles on their way to the renderer. */
export interface TileBatch {
  id: Uint32Array<ArrayBuffer>;
  noiseLevel: Uint8Array<ArrayBuffer>; // the finest level at which each one's noise is bearable, or GONE
  texels: Uint32Array<ArrayBuffer>; // RGB9E5, one tile behind the other
  directions: DirectionTile[];
  others: OtherTile[]; // of other channels than these
}

/** Where the light of a tile comes from (common/light/direction_form.h), by half and a half more. */
export interface DirectionTile {
  id: number;
  texels: Uint32Array<ArrayBuffer>; // RGB9E5; 0: not known
}

export interface OtherTile {
  id: number;
  slot: number;
  values: Float32Array<ArrayBuffer>; // of a texel all planes
}

/** In the place of a noise level: the tile, of a finer level, is there no more. It has no texels. */
export const GONE = 255;
/** Tiles of finer levels that are kept, at most: 24 kB of coefficients each. */
export const FINER_KEPT = 1024;

interface Held {
  version: bigint; // 0: none of this run
  coefficients: Coefficients; // 0: none
}

/** The tiles of a channel. */
interface Slot {
  number: number;
  channel: Channel;
  held: Map<number, Held>; // by tile
}

const IRRADIANCE = 0;
const DIRECTION = 1;
const CODEC_NONE = 0;

const fail = (what: string): never => {
  throw new ProtocolError(what);
};

export class Replica {
  readonly map: AtlasMap;
  private readonly slots = new Map<number, Slot>();
  private readonly hiddenNow: Uint8Array;
  private readonly spare: Uint8Array;
  private readonly unlit: Uint8Array; // since it was a spare, its coarsest level has not come
  private readonly coarsestSum = new Map<number, Float64Array>(); // by tile: of its texels
  private readonly sum = new Float64Array(3);
  private sumTexels = 0;
  private coarsestMissing = 0;
  private visibleChanged = true;
  private readonly finer = new Set<number>(); // tiles of irradiance of finer levels, last listed ones last
  private readonly dropped = new Set<number>(); // that were among them: no difference to these can be read
  private batch = this.emptyBatch();

  constructor(
    readonly scene: Scene,
    private readonly tiles: Tiles,
    features: bigint, // of the session
    private readonly channels: Channel[] = tiles.channels,
    finer = 0, // levels, at most
  ) {
    this.map = new AtlasMap(scene.meshes, scene.objectMesh, finer);
    for (const [slot, number] of channelsFor(channels, features))
      this.slots.set(slot, { number, channel: channels[number]!, held: new Map() });
    const objects = scene.objectMesh.length;
    this.hiddenNow = new Uint8Array(objects);
    this.spare = new Uint8Array(objects);
    this.unlit = new Uint8Array(objects);
    for (let o = 0; o < objects; o++) {
      const levels = this.map.of(o).levels;
      if (scene.objectNode[o] === NONE) this.hiddenNow[o] = this.spare[o] = 1;
      if (this.spare[o] && levels.length) this.unlit[o] = 1;
      const coarsest = levels[levels.length - 1];
      if (coarsest) this.coarsestMissing += coarsest.tilesX * coarsest.tilesY;
    }
  }

  private emptyBatch() {
    return {
      id: [] as number[],
      noiseLevel: [] as number[],
      texels: [] as Uint32Array[],
      size: 0,
      directions: [] as DirectionTile[],
      others: [] as OtherTile[],
    };
  }

  /** Its tiles' channel of irradiance. */
  get layer(): number {
    return this.slots.get(IRRADIANCE)!.number;
  }

  /** Whether tiles say where their light comes from. */
  get isDirected(): boolean {
    return this.slots.has(DIRECTION);
  }

  /** Whether a session with these features gets the same channels. */
  isFor(features: bigint): boolean {
    const taken = channelsFor(this.channels, features);
    return taken.size === this.slots.size && [...taken].every(([s, n]) => this.slots.get(s)?.number === n);
  }

  destroy(): void {
    for (const slot of this.slots.values()) for (const id of [...slot.held.keys()]) this.free(slot, id);
  }

  private free({ held }: Slot, id: number): void {
    const of = held.get(id)?.coefficients;
    if (of) this.tiles.freeCoefficients(of);
    held.delete(id);
  }

  /** Forgets a tile of a finer level, and tells the renderer. */
  private drop(id: number): void {
    for (const slot of this.slots.values()) this.free(slot, id);
    if (this.finer.delete(id)) this.add(id, GONE, new Uint32Array(0));
  }

  private add(id: number, noiseLevel: number, texels: Uint32Array): void {
    this.batch.id.push(id);
    this.batch.noiseLevel.push(noiseLevel);
    this.batch.texels.push(texels);
    this.batch.size += texels.length;
  }

  /** The server has started again, or the old light is gone: versions that come now count as newer than all
   * that are there. It has no tile of a finer level yet. */
  beginRun(): void {
    for (const id of [...this.finer]) this.drop(id);
    for (const { held } of this.slots.values()) for (const tile of held.values()) tile.version = 0n;
  }

  /** A session begins: nobody tells it which tiles of finer levels are no light any more. They come whole. */
  beginSession(): void {
    for (const id of [...this.finer]) this.drop(id);
    this.dropped.clear();
  }

  /** The server was told that these tiles are wanted: it tells of no others of finer levels, which would show
   * old light. */
  keepFinerOf(ids: ArrayLike<number>): void {
    const listed = new Set(Array.from(ids));
    for (const id of [...this.finer]) {
      if (listed.has(id)) continue;
      this.drop(id);
      this.dropped.add(id);
    }
  }

  /** The view wants these tiles, the most important first. Of finer levels those that were wanted last are
   * kept. */
  want(ids: ArrayLike<number>): void {
    for (let i = ids.length; i-- > 0; ) if (this.finer.delete(ids[i]!)) this.finer.add(ids[i]!);
  }

  takeFrame(frame: Frame): void {
    const { scene } = this;
    const check = (list: Uint32Array, limit: number, what: string) => {
      for (const index of list) if (index >= limit) fail(`message FRAME: ${what} ${index} of ${limit}`);
    };
    const objects = scene.objectMesh.length;
    check(frame.object, objects, 'transform_object');
    check(frame.light, scene.lights.length, 'light');
    check(frame.material, scene.materials.length, 'material');
    check(frame.hidden, objects, 'hidden_object');
    check(frame.shown, objects, 'shown_object');
    frame.hidden.forEach((object, i) => this.setHidden(object, 1, i < frame.spares ? 1 : 0));
    for (const object of frame.shown) this.setHidden(object, 0, 0);
  }

  private setHidden(object: number, hidden: number, spare: number): void {
    this.hiddenNow[object] = hidden;
    this.spare[object] = spare;
    if (spare) this.unlit[object] = this.map.of(object).levels.length ? 1 : 0;
    this.visibleChanged = true;
  }

  /** By object: whether to draw it; null if nothing has changed since the last call. */
  takeVisible(): Uint8Array<ArrayBuffer> | null {
    if (!this.visibleChanged) return null;
    this.visibleChanged = false;
    return this.hiddenNow.map((hidden, o) => (hidden || this.unlit[o] ? 0 : 1)) as Uint8Array<ArrayBuffer>;
  }

  /** Decodes a tile into the batch. Ignores one that is no newer than the tile there. */
  takeTile(t: Tile, noiseShown: number): void {
    const id = this.map.find(t.object, t.level, t.tile);
    const where = `message TILE: object ${t.object}, level ${t.level}, tile ${t.tile}`;
    if (id < 0) fail(`${where}: there is none`);
    const slot = this.slots.get(this.channels[t.layer]?.slot ?? -1);
    if (!slot) return;
    if (t.layer !== slot.number)
      fail(`${where}: it is of layer ${t.layer} in a session that gets layer ${slot.number}`);
    const { version, coefficients } = slot.held.get(id) ?? { version: 0n, coefficients: 0 };
    if (t.version <= version) return;
    const isFiner = t.level > FINER;
    if (isFiner && t.codec === CODEC_NONE) {
      this.dropped.delete(id);
      return this.drop(id);
    }
    if (t.codec !== 1 && t.codec !== 4) fail(`${where}: codec ${t.codec} is unknown`);
    if (t.base && this.dropped.has(id)) return; // level 0 is read there until it comes whole
    if (t.base && (t.base !== version || !coefficients))
      fail(`${where}: it builds on a version that is not here`);
    this.dropped.delete(id);
    const place = this.map.place(id);
    this.tiles.choose(slot.channel);
    if (!this.decode(t, slot, id, place.width, place.height)) fail(`${where}: the payload is damaged`);
    slot.held.get(id)!.version = t.version;
    const { planes, slot: at } = slot.channel;
    if (at !== IRRADIANCE) {
      const values = this.tiles.values(planes * place.width * place.height).slice();
      if (at === DIRECTION) this.batch.directions.push({ id, texels: this.tiles.packDirections(values) });
      else this.batch.others.push({ id, slot: at, values });
      return;
    }
    const texels = new Uint32Array(place.width * place.height);
    const sum = this.tiles.pack(texels);
    if (t.level === this.map.of(t.object).levels.length - 1)
      this.takeCoarsest(t.object, id, sum, texels.length);
    this.add(id, noiseLevelMin(t.error, noiseShown), texels);
    if (isFiner) this.keepFiner(id);
  }

  private keepFiner(id: number): void {
    this.finer.add(id);
    const [oldest] = this.finer;
    if (this.finer.size <= FINER_KEPT) return;
    this.drop(oldest!);
    this.dropped.add(oldest!);
  }

  /** False: it is damaged. Then coefficients are half those of the new version: nothing builds on them. */
  private decode(t: Tile, { held, channel }: Slot, id: number, width: number, height: number): boolean {
    if (!held.has(id)) held.set(id, { version: 0n, coefficients: 0 });
    const tile = held.get(id)!;
    tile.version = 0n;
    if (t.codec === 1) {
      if (tile.coefficients) this.tiles.freeCoefficients(tile.coefficients);
      tile.coefficients = 0;
      return this.tiles.decodeHalf(channel.planes, t.payload, t.scale, width, height);
    }
    tile.coefficients ||= this.tiles.createCoefficients(width, height);
    return this.tiles.decode(t.base > 0n, t.payload, t.scale, width, height, tile.coefficients);
  }

  private takeCoarsest(object: number, id: number, sum: Float64Array, texels: number): void {
    const before = this.coarsestSum.get(id);
    if (!before) {
      this.sumTexels += texels;
      this.coarsestMissing--;
    }
    for (let c = 0; c < 3; c++) this.sum[c]! += sum[c]! - (before ? before[c]! : 0);
    this.coarsestSum.set(id, sum);
    if (this.unlit[object] && !this.spare[object]) {
      this.unlit[object] = 0;
      this.visibleChanged = true;
    }
  }

  /** Mean irradiance of the tiles that have arrived, W/m^2: it stands in for the others. Before any has, the
   * light that shows a surface as its albedo. */
  meanIrradiance(): [number, number, number] {
    const all = this.sum[0]! + this.sum[1]! + this.sum[2]!;
    if (!(this.sumTexels > 0 && all > 0)) return [Math.PI, Math.PI, Math.PI];
    return [0, 1, 2].map((c) => Math.max(0, this.sum[c]! / this.sumTexels)) as [number, number, number];
  }

  /** Whether every object's coarsest level is there. */
  hasFirst(): boolean {
    return this.coarsestMissing === 0;
  }

  batchTiles(): number {
    return this.batch.id.length + this.batch.directions.length + this.batch.others.length;
  }

  takeBatch(): TileBatch {
    const texels = new Uint32Array(this.batch.size);
    let at = 0;
    for (const tile of this.batch.texels) {
      texels.set(tile, at);
      at += tile.length;
    }
    const noiseLevel = Uint8Array.from(this.batch.noiseLevel);
    const { directions, others } = this.batch;
    const batch = { id: Uint32Array.from(this.batch.id), noiseLevel, texels, directions, others };
    this.batch = this.emptyBatch();
    return batch;
  }

  /** Tiles by number as messages list them. */
  listOf(ids: ArrayLike<number>): TileList {
    const list = {
      object: new Uint32Array(ids.length),
      level: new Uint32Array(ids.length),
      tile: new Uint32Array(ids.length),
    };
    for (let i = 0; i < ids.length; i++) {
      const place = this.map.place(ids[i]!);
      list.object[i] = place.object;
      list.level[i] = place.level;
      list.tile[i] = place.tile;
    }
    return list;
  }

  /** The tiles of irradiance of this run, for HOLDS: those of no finer level. */
  held(): { ids: number[]; version: BigUint64Array } {
    const { held } = this.slots.get(IRRADIANCE)!;
    const ids = [...held.keys()].filter((id) => id < this.map.plainCount && held.get(id)!.version);
    return { ids, version: BigUint64Array.from(ids, (id) => held.get(id)!.version) };
  }
}
