// finer.ts: which tiles of finer levels are in the GPU's slots, and how much of each is shown.
// Flow: tiles, what the view wants -> [finer] -> texels of slots, entries of the table of tiles
import { type AtlasMap, TILE_SIDE } from './atlas.ts';

/** Slots, at most: 9 MB. A scene whose other light leaves less room has fewer, or none. */
export const SLOTS_MAX = 512;
/** Texels of a slot's side. The last column and row are those of the tiles beside and below. */
export const SLOT_SIDE = TILE_SIDE + 1;
/** An entry of the table of tiles has the slot in its low bits. The others say how much is shown, up to
 * SHARE_WHOLE. 0: nothing is shown. */
export const SLOT_BITS = 10;
export const SHARE_WHOLE = 63;
const FADE_MS = 250;

interface Kept {
  texels: Uint32Array | null; // RGB9E5; null: withdrawn, and its slot still has them
  slot: number; // -1: none
  share: number; // the shown share, 0 to 1
}

export class FinerTiles {
  private readonly kept = new Map<number, Kept>(); // by tile; last wanted ones last
  private readonly directions = new Map<number, Uint32Array>(); // by tile
  private directed = false; // slots have directions, of some tile
  private readonly free: number[];
  private rank = new Map<number, number>(); // ranks of the tiles that the view wants; 0 gets a slot first
  private readonly fading = new Set<number>(); // tiles that may not be shown as much as the view wants
  private readonly withdrawn = new Set<number>(); // tiles that fade out, and have a slot until they have
  private readonly shown = new Set<number>();
  private steppedMs = 0;

  /** write: gives a slot its texels, SLOT_SIDE squared: light, or where it comes from. show: gives a tile
   * its entry. */
  constructor(
    private readonly map: AtlasMap,
    slots: number,
    private readonly write: (slot: number, texels: Uint32Array, directions: boolean) => void,
    private readonly show: (id: number, entry: number) => void,
  ) {
    this.free = Array.from({ length: slots }, (_, slot) => slot);
  }

  /** Takes a copy of a tile's texels, or those of its next version. */
  take(id: number, texels: Uint32Array): void {
    const tile = this.kept.get(id);
    if (tile) tile.texels = texels.slice();
    else this.kept.set(id, { texels: texels.slice(), slot: -1, share: 0 });
    if (this.withdrawn.delete(id)) this.fading.add(id);
    this.place(id);
    this.fill(id, -1);
  }

  /** Takes where a tile's light comes from. */
  direct(id: number, texels: Uint32Array): void {
    this.directions.set(id, texels);
    this.directed = true;
    this.fill(id, -1);
  }

  /** A tile is withdrawn. Its shown share fades out, with the texels in its slot. */
  drop(id: number): void {
    this.directions.delete(id);
    const tile = this.kept.get(id);
    if (!tile?.texels) return;
    tile.texels = null;
    this.withdrawn.add(id);
    this.fading.add(id);
    if (!tile.share) this.forget(id);
    this.fill(id, -1);
  }

  /** The view wants these tiles, the most important first; their slots go last. */
  want(ids: ArrayLike<number>): void {
    const wanted = Array.from(ids).filter((id) => id >= this.map.plainCount);
    const before = this.rank;
    this.rank = new Map(wanted.map((id, rank) => [id, rank]));
    for (const id of [...before.keys(), ...wanted]) this.fading.add(id);
    for (let rank = wanted.length; rank-- > 0; ) {
      const tile = this.kept.get(wanted[rank]!);
      if (!tile) continue;
      this.kept.delete(wanted[rank]!);
      this.kept.set(wanted[rank]!, tile);
    }
    for (const id of wanted) this.place(id);
  }

  /** Fades in what the view wants, and out what it does not. nowMs: of the caller's clock; Infinity: at once.
   * Returns whether pictures become others. */
  step(nowMs: number): boolean {
    const step = Math.max(0, nowMs - this.steppedMs) / FADE_MS;
    if (nowMs < Infinity) this.steppedMs = nowMs;
    let changed = false;
    for (const id of this.fading) {
      const tile = this.kept.get(id);
      const goal = tile?.texels && this.rank.has(id) ? 1 : 0;
      if (!tile || tile.slot < 0 || tile.share === goal) {
        this.fading.delete(id);
        if (this.withdrawn.has(id)) this.forget(id);
        continue;
      }
      tile.share = goal ? Math.min(1, tile.share + step) : Math.max(0, tile.share - step);
      this.tell(id, tile);
      changed = true;
      if (!tile.share && !tile.texels) this.forget(id);
    }
    return changed;
  }

  /** Whether any tile is shown. */
  any(): boolean {
    return this.shown.size > 0;
  }

  private tell(id: number, { slot, share }: Kept): void {
    const whole = Math.round(share * SHARE_WHOLE);
    this.show(id, whole && (whole << SLOT_BITS) | slot);
    if (whole) this.shown.add(id);
    else this.shown.delete(id);
  }

  /** Gives a tile a slot that is free, or that of one that fades out for good or is wanted less, at once. */
  private place(id: number): void {
    const tile = this.kept.get(id);
    if (!tile || tile.slot >= 0) return;
    if (!this.free.length) this.makeRoom(this.rank.get(id) ?? Infinity);
    const slot = this.free.pop();
    if (slot === undefined) return;
    tile.slot = slot;
    this.fading.add(id);
    this.fill(id, 0);
  }

  private makeRoom(rank: number): void {
    const [leaving] = this.withdrawn;
    if (leaving !== undefined) return this.forget(leaving);
    for (const [other, { slot }] of this.kept) {
      if (slot < 0) continue;
      if ((this.rank.get(other) ?? Infinity) > rank) this.evict(other);
      return;
    }
  }

  /** A withdrawn tile leaves its slot. */
  private forget(id: number): void {
    this.evict(id);
    this.kept.delete(id);
    this.withdrawn.delete(id);
  }

  private evict(id: number): void {
    const tile = this.kept.get(id)!;
    if (tile.slot < 0) return;
    this.free.push(tile.slot);
    tile.share = 0;
    this.tell(id, tile);
    tile.slot = -1;
  }

  /** Fills the slot of a tile; first -1: and those of the tiles to the left and above, which end with its
   * texels. */
  private fill(id: number, first: number): void {
    for (let row = first; row <= 0; row++)
      for (let column = first; column <= 0; column++) {
        const other = this.map.beside(id, column, row);
        const { slot, texels } = this.kept.get(other) ?? { slot: -1, texels: null };
        if (slot < 0 || !texels) continue;
        this.write(slot, this.texelsOf(other, (tile) => this.kept.get(tile)?.texels), false);
        if (this.directed)
          this.write(slot, this.texelsOf(other, (tile) => this.directions.get(tile)), true);
      }
  }

  /** A tile with one more column and row: those of the tiles beside and below, or its own last ones. */
  private texelsOf(id: number, of: (tile: number) => Uint32Array | null | undefined): Uint32Array {
    const { width, height } = this.map.place(id);
    const own = of(id);
    const out = new Uint32Array(SLOT_SIDE ** 2);
    if (!own) return out;
    for (const [right, below] of [[0, 0], [1, 0], [0, 1], [1, 1]] as const) { // prettier-ignore
      const other = this.map.beside(id, right, below);
      const there = of(other);
      const texels = there ?? own;
      const stride = there ? this.map.place(other).width : width;
      const first = there ? 0 : right * (width - 1) + below * (height - 1) * width;
      const columns = right ? 1 : width;
      for (let row = 0; row < (below ? 1 : height); row++) {
        const from = first + row * stride;
        const to = (TILE_SIDE * below + row) * SLOT_SIDE + TILE_SIDE * right;
        out.set(texels.subarray(from, from + columns), to);
      }
    }
    return out;
  }
}
