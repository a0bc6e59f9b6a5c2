// atlas.ts: how the texels of objects are cut into levels and tiles: proto/wire_format.md, section 4; the
// same as common/tile/atlas.h.

export const TILE_SIDE = 64;
const COARSEST = 16;
export const LEVELS_MAX = 12;
/** Level FINER + k is the atlas with both sides times 2^k. */
export const FINER = 64;
/** A scene has as many finer levels as leave it with no more tiles than this: each has 2 bytes in a table. */
export const TILES_MAX = 1 << 20;

export interface Level {
  width: number;
  height: number;
  tilesX: number;
  tilesY: number;
  firstTile: number; // of those of the object, or of its finer levels
}

export interface Atlas {
  levels: Level[];
  tileCount: number;
  finer: Level[]; // level FINER + 1 and so on
  finerCount: number; // their tiles
}

/** 0 x 0: a mesh without a lightmap, which has no level. */
export function atlasOf(width: number, height: number): Atlas {
  const atlas: Atlas = { levels: [], tileCount: 0, finer: [], finerCount: 0 };
  if (!width || !height) return atlas;
  for (let w = width, h = height; ; w = (w + 1) >> 1, h = (h + 1) >> 1) {
    const level = levelOf(w, h, atlas.tileCount);
    atlas.levels.push(level);
    atlas.tileCount += tilesIn(level);
    if ((w <= COARSEST && h <= COARSEST) || atlas.levels.length === LEVELS_MAX) return atlas;
  }
}

const across = (texels: number) => Math.ceil(texels / TILE_SIDE);
const tilesIn = (level: Level | undefined) => (level ? level.tilesX * level.tilesY : 0);

function levelOf(width: number, height: number, firstTile: number): Level {
  return { width, height, tilesX: across(width), tilesY: across(height), firstTile };
}

/** The level that is twice as fine as the finest of an atlas; none of a mesh without a lightmap. */
function nextFiner({ levels, finer, finerCount }: Atlas): Level | undefined {
  const finest = finer.at(-1) ?? levels[0];
  return finest && levelOf(2 * finest.width, 2 * finest.height, finerCount);
}

export interface Place {
  object: number;
  level: number;
  tile: number; // within the level
  x: number; // texels
  y: number;
  width: number;
  height: number;
}

/** The tiles of all objects, numbered through: objects in order, levels from 0 on, rows, columns. Then come
 * those of finer levels in the same order. */
export class AtlasMap {
  readonly atlas: Atlas[]; // by mesh
  readonly firstTile: Uint32Array; // by object, and the number of plain tiles behind the last one
  readonly firstFiner: Uint32Array; // the same of finer levels, with the number of all tiles
  readonly finer: number = 0; // finer levels of each atlas
  readonly plainCount: number; // tiles that are of no finer level: those with the first numbers
  readonly tileCount: number;

  /** finer: levels at most; fewer where there would be over TILES_MAX tiles. */
  constructor(
    sides: { atlasWidth: number; atlasHeight: number }[],
    private readonly meshOf: Uint32Array,
    finer = 0,
  ) {
    this.atlas = sides.map((mesh) => atlasOf(mesh.atlasWidth, mesh.atlasHeight));
    this.firstTile = this.number(0, ({ tileCount }) => tileCount);
    this.plainCount = this.firstTile[meshOf.length]!;
    let count = this.plainCount;
    const tilesOfNext = (sum: number, mesh: number) => sum + tilesIn(nextFiner(this.atlas[mesh]!));
    while (this.finer < finer && (count = meshOf.reduce(tilesOfNext, count)) <= TILES_MAX) {
      this.finer++;
      for (const atlas of this.atlas) {
        const next = nextFiner(atlas);
        if (next) atlas.finer.push(next);
        atlas.finerCount += tilesIn(next);
      }
    }
    this.firstFiner = this.number(this.plainCount, ({ finerCount }) => finerCount);
    this.tileCount = this.firstFiner[meshOf.length]!;
  }

  private number(first: number, countOf: (atlas: Atlas) => number): Uint32Array {
    const numbers = new Uint32Array(this.meshOf.length + 1).fill(first);
    this.meshOf.forEach((mesh, object) => {
      numbers[object + 1] = numbers[object]! + countOf(this.atlas[mesh]!);
    });
    return numbers;
  }

  of(object: number): Atlas {
    return this.atlas[this.meshOf[object]!]!;
  }

  /** -1: there is none; any numbers are safe. */
  find(object: number, level: number, tile: number): number {
    if (object >= this.meshOf.length) return -1;
    const { levels, finer } = this.of(object);
    const at = levels[level] ?? finer[level - FINER - 1];
    const first = levels[level] ? this.firstTile : this.firstFiner;
    return tile < tilesIn(at) ? first[object]! + at!.firstTile + tile : -1;
  }

  /** A neighbour of a tile of a finer level, `columns` to the right and `rows` down; -1: there is none. */
  beside(id: number, columns: number, rows: number): number {
    const { object, level, x, y } = this.place(id);
    const { tilesX, tilesY } = this.of(object).finer[level - FINER - 1]!;
    const [column, row] = [x / TILE_SIDE + columns, y / TILE_SIDE + rows];
    return column >= 0 && column < tilesX && row >= 0 && row < tilesY ? id + rows * tilesX + columns : -1;
  }

  place(id: number): Place {
    const isFiner = id >= this.plainCount;
    const first = isFiner ? this.firstFiner : this.firstTile;
    let low = 0;
    let high = this.meshOf.length; // objects [low, high) have it
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (first[middle]! <= id) low = middle;
      else high = middle;
    }
    // objects without tiles come before the one that has it only if they share its first number: the last of
    // these has it
    const inObject = id - first[low]!;
    const atlas = this.of(low);
    const levels = isFiner ? atlas.finer : atlas.levels;
    let i = levels.length - 1;
    while (levels[i]!.firstTile > inObject) i--;
    const at = levels[i]!;
    const tile = inObject - at.firstTile;
    const x = (tile % at.tilesX) * TILE_SIDE;
    const y = Math.floor(tile / at.tilesX) * TILE_SIDE;
    const width = Math.min(TILE_SIDE, at.width - x);
    const height = Math.min(TILE_SIDE, at.height - y);
    return { object: low, level: isFiner ? FINER + 1 + i : i, tile, x, y, width, height };
  }
}

const COARSE_NOISE = 0.25;
const MIDDLE_NOISE = 0.1;

/** The finest level at which views read a tile. error: relative; noiseShown: the share of it left in
 * texels. */
export function noiseLevelMin(error: number, noiseShown: number): number {
  const noise = error * noiseShown;
  return noise <= MIDDLE_NOISE ? 0 : noise > COARSE_NOISE ? 2 : 1;
}
