// servers.ts: where a page finds its light, as client/lib/servers.h: at the server that it was with, at the
// ones that this server named, and at the one that it was given.

const ADDRESS = /^wss?:\/\/[^/]/;

export class Servers {
  /** Of the next attempt, or of the session that there is. */
  url: string;
  private last: string; // that it was with
  private named: string[] = [];
  private tries = 0; // since it was last with a server
  private turn = 0;

  constructor(private readonly first: string) {
    this.url = this.last = first;
  }

  /** A server has welcomed us, and names others. A page that came to its server by TLS goes to no other
   * without: its token would be sent in the clear, and browsers forbid it. */
  found(servers: string): void {
    const secure = this.first.startsWith('wss:');
    this.named = servers.split(',').filter((url) => ADDRESS.test(url) && !(secure && url.startsWith('ws:')));
    this.last = this.url;
    this.tries = this.turn = 0;
  }

  /** Sets the address of the next attempt, in turn. */
  next(): void {
    const all = [this.last, ...this.named, this.first];
    this.turn = this.tries++ % all.length;
    this.url = all[this.turn]!;
  }

  /** Whether a server has named it: if another scene is lit there, it is none of ours. */
  isNamed(): boolean {
    return this.turn > 0 && this.turn <= this.named.length;
  }
}
