// interest.ts: the client's interest set, what the server was told of it, and when to tell it again; as
// client/lib/interest.h.

const TELL_MS = 100; // the server is told no more often
const SHED_MS = 2000; // the server is told of a few tiles that left the set by then
const SHED_ONE = 8; // a few: under one tile in SHED_ONE

export class Interest {
  private now = new Uint32Array(0); // sorted, each once
  private told: Uint32Array | null = null; // null: nothing yet
  private toldMs = -Infinity;

  set(ids: Uint32Array): void {
    this.now = Uint32Array.from(new Set(ids)).sort();
  }

  list(): Uint32Array {
    return this.now;
  }

  /** A session begins: the server was told that nothing is wanted. The set may follow at once. */
  begin(): void {
    this.told = new Uint32Array(0);
    this.toldMs = -Infinity;
  }

  /** The server was told something else than the set. */
  forget(): void {
    this.told = null;
    this.toldMs = -Infinity;
  }

  isDue(nowMs: number): boolean {
    if (!this.told) return true;
    const since = nowMs - this.toldMs;
    if (since < TELL_MS) return false;
    const before = this.told;
    let at = 0;
    for (const id of this.now) {
      while (at < before.length && before[at]! < id) at++;
      if (before[at] !== id) return true; // it entered the set
    }
    const shed = before.length - this.now.length;
    return shed > 0 && (shed >= Math.ceil(before.length / SHED_ONE) || since >= SHED_MS);
  }

  tell(nowMs: number): void {
    this.told = this.now;
    this.toldMs = nowMs;
  }
}
