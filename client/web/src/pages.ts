// pages.ts: where the levels of all atlases lie in the layers of one texture. A level is one rectangle.
// Look-ups are clamped to it, so none needs a border.
import type { AtlasMap } from './atlas.ts';
import { LimitError } from './failure.ts';

const BYTES_MAX = 2 ** 30;

export interface Pages {
  width: number;
  height: number;
  layers: number;
  levelFirst: Uint32Array; // by object: its first level in `level`
  level: Uint32Array; // 4 each: x | y << 16, layer, first tile, width | height << 16
}

/** sideMax, layersMax: of a texture. */
export function layOut(map: AtlasMap, objects: number, sideMax: number, layersMax: number): Pages {
  const levelFirst = new Uint32Array(objects + 1);
  for (let o = 0; o < objects; o++) levelFirst[o + 1] = levelFirst[o]! + map.of(o).levels.length;
  const level = new Uint32Array(4 * levelFirst[objects]!);
  let area = 0;
  let widest = 16;
  for (let o = 0, at = 0; o < objects; o++)
    for (const { width, height, firstTile } of map.of(o).levels) {
      level[at + 2] = map.firstTile[o]! + firstTile;
      level[at + 3] = width | (height << 16);
      at += 4;
      area += width * height;
      widest = Math.max(widest, width, height);
    }
  if (widest > sideMax)
    throw new LimitError(`this scene has a lightmap of ${widest} texels; the graphics here takes ${sideMax}`);
  const width = Math.min(sideMax, Math.max(widest, 2 ** Math.ceil(Math.log2(Math.sqrt(area) + 1))));
  // rows of rectangles, the highest first
  const order = Uint32Array.from({ length: level.length / 4 }, (_, i) => i);
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
    throw new LimitError(
      `this scene's light takes ${Math.ceil((4 * area) / 2 ** 20)} MB, more than a page has`,
    );
  return { width, height, layers, levelFirst, level };
}
