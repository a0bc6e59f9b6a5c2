// atlas.ts: how the texels of objects are cut into levels and tiles: proto/wire_format.md, section 4; the
// same as common/tile/atlas.h.

export const TILE_SIDE = 64;
const COARSEST = 16;
export const LEVELS_MAX = 12;

export interface Level {
  width: number;
  height: number;
  tilesX: number;
  tilesY: number;
  firstTile: number; // within the object
}

export interface Atlas {
  levels: Level[];
  tileCount: number;
}

/** 0 x 0: a mesh without a lightmap, which has no level. */
export function atlasOf(width: number, height: number): Atlas {
  const atlas: Atlas = { levels: [], tileCount: 0 };
  if (!width || !height) return atlas;
  for (let w = width, h = height; ; w = (w + 1) >> 1, h = (h + 1) >> 1) {
    const tilesX = Math.ceil(w / TILE_SIDE);
    const tilesY = Math.ceil(h / TILE_SIDE);
    atlas.levels.push({ width: w, height: h, tilesX, tilesY, firstTile: atlas.tileCount });
    atlas.tileCount += tilesX * tilesY;
    if ((w <= COARSEST && h <= COARSEST) || atlas.levels.length === LEVELS_MAX) return atlas;
  }
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

/** The tiles of all objects, numbered through: objects in order, levels from fine to coarse, rows, columns.
 * */
export class AtlasMap {
  readonly atlas: Atlas[]; // by mesh
  readonly firstTile: Uint32Array; // by object, and the number of all tiles behind the last one
  readonly tileCount: number;

  constructor(
    sides: { atlasWidth: number; atlasHeight: number }[],
    private readonly meshOf: Uint32Array,
  ) {
    this.atlas = sides.map((mesh) => atlasOf(mesh.atlasWidth, mesh.atlasHeight));
    this.firstTile = new Uint32Array(meshOf.length + 1);
    let count = 0;
    meshOf.forEach((mesh, object) => {
      this.firstTile[object] = count;
      count += this.atlas[mesh]!.tileCount;
    });
    this.firstTile[meshOf.length] = count;
    this.tileCount = count;
  }

  of(object: number): Atlas {
    return this.atlas[this.meshOf[object]!]!;
  }

  /** -1: there is none; any numbers are safe. */
  find(object: number, level: number, tile: number): number {
    if (object >= this.meshOf.length) return -1;
    const at = this.of(object).levels[level];
    return at && tile < at.tilesX * at.tilesY ? this.firstTile[object]! + at.firstTile + tile : -1;
  }

  place(id: number): Place {
    let low = 0;
    let high = this.meshOf.length; // objects [low, high) have it
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.firstTile[middle]! <= id) low = middle;
      else high = middle;
    }
    // objects without tiles come before the one that has it only if they share its first number: the last of
    // these has it
    const inObject = id - this.firstTile[low]!;
    const levels = this.of(low).levels;
    let level = levels.length - 1;
    while (levels[level]!.firstTile > inObject) level--;
    const at = levels[level]!;
    const tile = inObject - at.firstTile;
    const x = (tile % at.tilesX) * TILE_SIDE;
    const y = Math.floor(tile / at.tilesX) * TILE_SIDE;
    const width = Math.min(TILE_SIDE, at.width - x);
    const height = Math.min(TILE_SIDE, at.height - y);
    return { object: low, level, tile, x, y, width, height };
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
