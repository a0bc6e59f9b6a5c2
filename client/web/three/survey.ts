// survey.ts: which tiles of finer levels a camera's picture wants, by a few rays a call. They are some 256
// pixels wide, so that few rays are enough.
// Flow: camera, nearest surfaces (gather.ts), light of level 0 -> [survey] -> wanted tiles (fine_pool.ts)
import * as THREE from 'three';

import { type AtlasMap, TILE_SIDE } from '../src/atlas.ts';
import { FINE_PIXELS } from './fine_pool.ts';
import type { Gather, Look } from './gather.ts';
import { addTexel, type Lightmap } from './lightmaps.ts';
import type { Placed } from './swap.ts';

/** The choice of finer levels is that of common/tile/fine_choice.h. */
const FINE_CHANGE = 0.1;
const FINE_TEXELS = 16;
const COSINE_MIN = 0.05;

const COLUMNS = 36; // rays side by side
const ROWS = 20;
const STRIDE = 143; // between the rays of a call; it shares no factor with their number
const RAYS_PER_CALL = 24;
const AROUND = 0.15; // beyond each edge, share of half a side
const KEEP_MS = 2000; // a tile is wanted after it was seen

export class Survey {
  private readonly objectOf = new Map<Placed, number>();
  private readonly seenMs = new Map<number, number>(); // by tile; seen last ones last
  private next = 0; // ray
  private coarser = 0; // levels above what they read that rays ask for, where that is too many tiles
  private readonly sum = new Float64Array(3);

  /** pool: its slots limit the list. */
  constructor(
    private readonly map: AtlasMap,
    placed: (Placed | null)[],
    private readonly pool: { slots: number },
  ) {
    placed.forEach((each, object) => each && this.objectOf.set(each, object));
  }

  /** Follows some rays of a camera. height: of the picture, pixels. */
  step(gather: Gather, camera: THREE.Camera, height: number, nowMs: number): void {
    const { projectionMatrix, projectionMatrixInverse, matrixWorld } = camera;
    const perspective = !!(camera as Partial<THREE.PerspectiveCamera>).isPerspectiveCamera;
    const pixel = 2 / (projectionMatrix.elements[5]! * height); // at distance 1, or everywhere
    const toWorld = matrixWorld.clone().multiply(projectionMatrixInverse);
    const axis = new THREE.Vector3().setFromMatrixColumn(matrixWorld, 2).normalize();
    const eye = new THREE.Vector3().setFromMatrixPosition(matrixWorld);
    const [from, to] = [new THREE.Vector3(), new THREE.Vector3()];
    for (let i = 0; i < RAYS_PER_CALL; i++) {
      const at = (this.next * STRIDE) % (COLUMNS * ROWS);
      this.next = (this.next + 1) % (COLUMNS * ROWS);
      const x = (1 + AROUND) * ((2 * ((at % COLUMNS) + 0.5)) / COLUMNS - 1);
      const y = (1 + AROUND) * ((2 * (Math.floor(at / COLUMNS) + 0.5)) / ROWS - 1);
      // a point of the ray, at whatever depth: ranges of depth differ
      to.set(x, y, 0.5).applyMatrix4(toWorld);
      if (perspective) to.sub(from.copy(eye)).normalize();
      else {
        from.copy(to).addScaledVector(axis, eye.dot(axis) - to.dot(axis));
        to.copy(axis).negate();
      }
      const look = gather.look(from, to);
      if (!look) continue;
      const depth = perspective ? look.distance * Math.abs(to.dot(axis)) : 1;
      this.ask(look, (pixel * depth) ** 2, nowMs);
    }
    this.forget(nowMs);
  }

  /** The tiles that are wanted, seen last ones first. */
  list(): number[] {
    return [...this.seenMs.keys()].reverse();
  }

  private forget(nowMs: number): void {
    for (const [id, ms] of this.seenMs) {
      if (nowMs - ms <= KEEP_MS && this.seenMs.size <= this.pool.slots) break;
      if (nowMs - ms <= KEEP_MS && this.coarser < this.map.finer - 1) {
        // all that is seen is asked for coarser, until it fits
        this.coarser++;
        this.seenMs.clear();
        break;
      }
      this.seenMs.delete(id);
    }
    if (this.next < RAYS_PER_CALL && this.coarser && 8 * this.seenMs.size < this.pool.slots) this.coarser--;
  }

  /** pixel: its area at the place, world space. */
  private ask({ placed, u, v, texels, area, facing }: Look, pixel: number, nowMs: number): void {
    const object = this.objectOf.get(placed);
    const lightmap = placed.lightmap!;
    if (object === undefined || !area) return;
    const perPixel = FINE_PIXELS ** 2 * pixel * (texels / area / Math.max(facing, COSINE_MIN));
    let k = 0;
    while (k < this.map.finer && perPixel * 4 ** (k + 1) <= 1) k++;
    if (!k || (texels >= FINE_TEXELS && this.isEven(lightmap, u, v))) return;
    k = Math.max(1, k - this.coarser);
    const level = this.map.of(object).finer[k - 1]!;
    const first = this.map.firstFiner[object]! + level.firstTile;
    const [left, right] = tiles(u, level.width);
    const [top, bottom] = tiles(v, level.height);
    for (let row = top; row <= bottom; row++)
      for (let column = left; column <= right; column++) {
        const id = first + row * level.tilesX + column;
        this.seenMs.delete(id);
        this.seenMs.set(id, nowMs);
      }
  }

  /** Whether a finer level would show the same as level 0 does; it may, where that has not come yet. */
  private isEven({ texels, level, width, height }: Lightmap, u: number, v: number): boolean {
    let [low, high] = [Infinity, 0];
    const [left, right] = span(u, width);
    const [top, bottom] = span(v, height);
    for (const row of [top, bottom])
      for (const column of [left, right]) {
        const at = row * width + column;
        if (level[at] !== 0) return true;
        this.sum.fill(0);
        addTexel(texels[at]!, 1, this.sum);
        const luminance = 0.2126 * this.sum[0]! + 0.7152 * this.sum[1]! + 0.0722 * this.sum[2]!;
        low = Math.min(low, luminance);
        high = Math.max(high, luminance);
      }
    return high - low <= FINE_CHANGE * high;
  }
}

/** The first and the last texel that a look-up mixes along one axis. at: 0 to 1 */
function span(at: number, size: number): [number, number] {
  const low = Math.floor(Math.min(Math.max(at * size - 0.5, 0), size - 1));
  return [low, Math.min(low + 1, size - 1)];
}

function tiles(at: number, size: number): [number, number] {
  const [low, high] = span(at, size);
  return [Math.floor(low / TILE_SIDE), Math.floor(high / TILE_SIDE)];
}
