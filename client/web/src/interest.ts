// interest.ts: the client's interest set, what the server was sent of it, and when to send it again; as
// client/lib/interest.h.

const TELL_MS = 100; // no more often
const SHED_MS = 2000; // a few tiles that left the set are sent by then
const SHED_ONE = 8; // a few: under one tile in SHED_ONE

export class Interest {
  private now = new Uint32Array(0); // sorted, each once
  private sent: Uint32Array | null = null; // null: nothing yet
  private sentMs = -Infinity;

  set(ids: Uint32Array): void {
    this.now = Uint32Array.from(new Set(ids)).sort();
  }

  list(): Uint32Array {
    return this.now;
  }

  /** A session begins: an empty set counts as sent. The set may follow at once. */
  begin(): void {
    this.sent = new Uint32Array(0);
    this.sentMs = -Infinity;
  }

  /** The server has another set than this one. */
  forget(): void {
    this.sent = null;
    this.sentMs = -Infinity;
  }

  isDue(nowMs: number): boolean {
    if (!this.sent) return true;
    const since = nowMs - this.sentMs;
    if (since < TELL_MS) return false;
    const before = this.sent;
    let at = 0;
    for (const id of this.now) {
      while (at < before.length && before[at]! < id) at++;
      if (before[at] !== id) return true; // it entered the set
    }
    const shed = before.length - this.now.length;
    return shed > 0 && (shed >= Math.ceil(before.length / SHED_ONE) || since >= SHED_MS);
  }

  tell(nowMs: number): void {
    this.sent = this.now;
    this.sentMs = nowMs;
  }
}
