// pages.ts: where the levels of all atlases, and slots for tiles of finer levels, lie in the layers of one
// texture. Each is one rectangle. Look-ups are clamped to it, so none needs a border.
import type { AtlasMap } from './atlas.ts';
import { LimitError } from './failure.ts';
import { SLOT_SIDE } from './finer.ts';

export const BYTES_MAX = 2 ** 30;
/** Where there is no room for level 0 of all objects, or for level 1, it is left out. */
const FINEST_MAX = 2;

export interface Pages {
  width: number;
  height: number;
  layers: number;
  levelFirst: Uint32Array; // by object: its first level in `level`; behind the last one: the first slot
  level: Uint32Array; // 4 each: x | y << 16, layer, first tile, width | height << 16
  finest: number; // level; finer ones have no place, but for an object's coarsest
  slots: number;
}

/** sideMax, layersMax: of a texture. slots: at most; they cost no layer. */
export function layOut(map: AtlasMap, objects: number, sideMax: number, layersMax: number, slots = 0): Pages {
  let failure = '';
  for (let finest = 0; finest <= FINEST_MAX; finest++) {
    const pages = pack(map, objects, sideMax, layersMax, finest, 0);
    if (typeof pages === 'string') {
      failure ||= pages;
      continue;
    }
    for (let some = finest ? 0 : slots; some; some >>= 1) {
      const more = pack(map, objects, sideMax, pages.layers, finest, some);
      if (typeof more !== 'string') return more;
    }
    return pages;
  }
  throw new LimitError(failure);
}

/** Text: why there is no room. */
function pack(
  map: AtlasMap,
  objects: number,
  sideMax: number,
  layersMax: number,
  finest: number,
  slots: number,
): Pages | string {
  const levelFirst = new Uint32Array(objects + 1);
  for (let o = 0; o < objects; o++) levelFirst[o + 1] = levelFirst[o]! + map.of(o).levels.length;
  const level = new Uint32Array(4 * (levelFirst[objects]! + slots)).fill(SLOT_SIDE * 0x10001);
  const placed: number[] = [];
  let area = slots * SLOT_SIDE ** 2;
  let widest = slots ? SLOT_SIDE : 16;
  for (let o = 0, at = 0; o < objects; o++) {
    const { levels } = map.of(o);
    levels.forEach(({ width, height, firstTile }, i) => {
      level[4 * at + 2] = map.firstTile[o]! + firstTile;
      level[4 * at + 3] = width | (height << 16);
      at++;
      if (i < finest && i < levels.length - 1) return;
      placed.push(at - 1);
      area += width * height;
      widest = Math.max(widest, width, height);
    });
  }
  for (let slot = 0; slot < slots; slot++) placed.push(levelFirst[objects]! + slot);
  if (widest > sideMax)
    return `this scene has a lightmap of ${widest} texels; the graphics here takes ${sideMax}`;
  const width = Math.min(sideMax, Math.max(widest, 2 ** Math.ceil(Math.log2(Math.sqrt(area) + 1))));
  // rows of rectangles, the highest first
  const order = Uint32Array.from(placed);
  order.sort((a, b) => (level[4 * b + 3]! >>> 16) - (level[4 * a + 3]! >>> 16));
  let [x, y, row, layer] = [0, 0, 0, 0];
  for (const i of order) {
    const w = level[4 * i + 3]! & 0xffff;
    const h = level[4 * i + 3]! >>> 16;
    if (x + w > width) [x, y, row] = [0, y + row, 0];
    if (y + h > sideMax) [x, y, row, layer] = [0, 0, 0, layer + 1];
    level[4 * i] = x | (y << 16);
    level[4 * i + 1] = layer;
    x += w;
    row = Math.max(row, h);
  }
  const height = layer ? sideMax : Math.max(1, y + row);
  const layers = layer + 1;
  if (layers > layersMax || 4 * width * height * layers > BYTES_MAX)
    return `this scene's light takes ${Math.ceil((4 * area) / 2 ** 20)} MB, more than a page has`;
  return { width, height, layers, levelFirst, level, finest, slots };
}
