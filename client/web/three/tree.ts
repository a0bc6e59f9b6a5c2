// tree.ts: a tree of boxes over boxes, for rays. Nodes are halved at the middle of the centres' longest axis
// (Wald 2007 does better for pictures; these are for some hundred rays at a time).

const LEAF = 4;
const STACK = 64;

/** Called for what a leaf holds: returns the nearest distance now, in lengths of the direction. */
export type Visit = (item: number, nearest: number) => number;

export class Tree {
  /** By node: low and high of its box. */
  private readonly box: Float32Array;
  /** By node: of a leaf the first item and the count; of others the second child and 0. The first child is
   * the next node. */
  private readonly link: Uint32Array;
  private readonly item: Uint32Array;
  private nodes = 0;
  private readonly stack = new Uint32Array(STACK); // visits trace other trees, never this one

  /** boxes: low and high of each item, 6 numbers. */
  constructor(private readonly boxes: Float32Array) {
    const count = boxes.length / 6;
    this.item = Uint32Array.from({ length: count }, (_, i) => i);
    this.box = new Float32Array(6 * Math.max(1, 2 * count));
    this.link = new Uint32Array(2 * Math.max(1, 2 * count));
    this.build(0, count, 0);
  }

  private build(first: number, end: number, depth: number): void {
    const node = this.nodes++;
    const { box, boxes, item, link } = this;
    const low = [Infinity, Infinity, Infinity, Infinity, Infinity, Infinity]; // of boxes, of centres
    const high = low.map((x) => -x);
    for (let i = first; i < end; i++)
      for (let k = 0; k < 3; k++) {
        const [a, b] = [boxes[6 * item[i]! + k]!, boxes[6 * item[i]! + 3 + k]!];
        low[k] = Math.min(low[k]!, a);
        high[k] = Math.max(high[k]!, b);
        low[3 + k] = Math.min(low[3 + k]!, a + b);
        high[3 + k] = Math.max(high[3 + k]!, a + b);
      }
    box.set([...low.slice(0, 3), ...high.slice(0, 3)], 6 * node);
    if (end - first <= LEAF) return void link.set([first, end - first], 2 * node);
    const width = [3, 4, 5].map((k) => high[k]! - low[k]!);
    const axis = width.indexOf(Math.max(...width));
    const middle = (low[3 + axis]! + high[3 + axis]!) / 2;
    let split = first;
    for (let i = first; i < end; i++) {
      const each = item[i]!;
      if (boxes[6 * each + axis]! + boxes[6 * each + 3 + axis]! > middle) continue;
      item[i] = item[split]!;
      item[split++] = each;
    }
    // all centres in one place, or a tree that would be deeper than the stack
    if (split === first || split === end || depth > STACK / 2) split = (first + end) >> 1;
    this.build(first, split, depth + 1);
    link.set([this.nodes, 0], 2 * node);
    this.build(split, end, depth + 1);
  }

  /** Visits the items whose boxes a ray meets before the nearest distance so far, roughly near ones first.
   * origin, direction: 3 each. Returns the nearest distance. */
  trace(origin: ArrayLike<number>, direction: ArrayLike<number>, nearest: number, visit: Visit): number {
    const { stack } = this;
    let depth = 0;
    if (this.item.length && this.enters(0, origin, direction, nearest) < nearest) stack[depth++] = 0;
    while (depth) {
      const node = stack[--depth]!;
      const [at, count] = [this.link[2 * node]!, this.link[2 * node + 1]!];
      if (count) {
        for (let i = at; i < at + count; i++) nearest = visit(this.item[i]!, nearest);
        continue;
      }
      const a = this.enters(node + 1, origin, direction, nearest);
      const b = this.enters(at, origin, direction, nearest);
      if (a <= b) {
        if (b < nearest) stack[depth++] = at;
        if (a < nearest) stack[depth++] = node + 1;
      } else {
        if (a < nearest) stack[depth++] = node + 1;
        stack[depth++] = at;
      }
    }
    return nearest;
  }

  /** Where the ray enters a node's box; Infinity: it misses. */
  private enters(node: number, origin: ArrayLike<number>, direction: ArrayLike<number>, far: number): number {
    let near = 0;
    for (let k = 0; k < 3; k++) {
      const inverse = 1 / direction[k]!;
      const a = (this.box[6 * node + k]! - origin[k]!) * inverse;
      const b = (this.box[6 * node + 3 + k]! - origin[k]!) * inverse;
      // 0 / 0 is NaN, which neither comparison takes
      if (Math.min(a, b) > near) near = Math.min(a, b);
      if (Math.max(a, b) < far) far = Math.max(a, b);
    }
    return near <= far ? near : Infinity;
  }
}
