// session.ts: one connection: bytes in, messages out: proto/wire_format.md, section 3. Knows no socket.
import { Download, hex, type PartStore } from './download.ts';
import { LimitError, ProtocolError, TokenError } from './failure.ts';
import { readFinishPackage } from './finish_package.ts';
import type { Finishes } from './finishes.ts';
import { readPackage, type Scene } from './package.ts';
import { Replica, type TileBatch } from './replica.ts';
import type { Tiles } from './tiles.ts';
import { Interest } from './interest.ts';
import * as wire from './wire.ts';

const PING_MS = 5000;
const SILENCE_MS = 15000;
const BATCH_TILES = 64;
const RATE_WAIT_MS = 10_000; // after a refusal for saying too much

// A browser buffers all that comes, so a slow client cannot slow the server by a full link. With more than
// HIGH bytes waiting its interest set is empty, until there are under LOW.
const BACKLOG_HIGH = 4 << 20;
const BACKLOG_LOW = 256 << 10;
// Decoded tiles that wait for the renderer, at most: then none is decoded until it has taken some.
const UNTAKEN_MAX = 512;

/** A server ended the session, or refused it; later it may not. */
export class ClosedError extends Error {
  /** When to come back, as the server said, ms; 0: it did not. */
  retryAfterMs = 0;
}

/** The server leaves more lights to clients than this one draws: ask again without offering to draw any. */
export class DrawsTooMuch extends Error {}

export interface FrameNews {
  frame: wire.Frame;
  visible: Uint8Array<ArrayBuffer> | null;
}

export interface SessionHost extends PartStore {
  drawsMaterials?: boolean; // or lights alone
  send(bytes: Uint8Array<ArrayBuffer>): void;
  progress(fraction: number): void;
  scene(replica: Replica): void;
  finishes?(finishes: Finishes): void; // of the scene, behind its first light; without it none are asked for
  frame(news: FrameNews): void;
  tiles(batch: TileBatch, mean: [number, number, number], visible: Uint8Array<ArrayBuffer> | null): void;
  settled(): void;
  waiting?(waiting: wire.Waiting): void; // for the first light; before frame()
  token?: Uint8Array; // 32 bytes
  named?: boolean; // another server has named this one: then it lights the same scene, or is none of ours
  servers?(servers: string): void; // as WELCOME names them
  mayControl?(): void; // change() has effect; before scene()
  refused?(text: string): void; // a change
}

/** What outlives a connection. */
export interface Kept {
  replica: Replica | null;
  packageHash: string;
  drawn: string; // which lights the client draws, and how many finer levels there are
  run: bigint;
  frame: bigint; // the last one of that run
  download: Download | null;
  finishes: Download | null; // on their way
  finishHash: string; // of those that the host has; '': none
}

export function nothingKept(): Kept {
  return {
    replica: null,
    packageHash: '',
    drawn: '',
    run: 0n,
    frame: 0n,
    download: null,
    finishes: null,
    finishHash: '',
  };
}

export class Session {
  private chunks: Uint8Array[] = [];
  private backlog = 0;
  private welcome: wire.Welcome | null = null;
  private asked = false; // for the package
  private finishesAsked = false;
  private lastFrame = 0n;
  private readonly interest = new Interest();
  private held = false; // the interest set is empty until the backlog is shorter
  private paused = false; // the page is hidden
  private untaken = 0;
  private closed = false;
  private heardMs: number;
  private pingedMs: number;
  private readonly offered: bigint;
  private request = 0n; // of the last UPDATE
  private answered = 0n;

  constructor(
    private readonly kept: Kept,
    private readonly tiles: Tiles,
    private readonly host: SessionHost,
    features: bigint,
    nowMs: number,
  ) {
    this.heardMs = this.pingedMs = nowMs;
    this.offered = features | wire.Feature.RESUME | wire.Feature.PARTS | wire.Feature.DCT | wire.Feature.RUNS;
    if (host.mayControl) this.offered |= wire.Feature.CONTROL;
    if (host.finishes) this.offered |= wire.Feature.MATERIALS;
    host.send(wire.writeHello(this.offered, 'lightwell web', host.token));
  }

  /** Bytes from the socket; pump() reads them. */
  push(bytes: Uint8Array, nowMs: number): void {
    this.heardMs = nowMs;
    this.chunks.push(bytes);
    this.backlog += bytes.length;
    this.mindBacklog();
  }

  /** Nothing more is read or sent. */
  close(): void {
    this.closed = true;
  }

  /** What the client is to draw itself: a bit for each light and material. */
  draws(): { clientLights: Uint8Array; clientMaterials: Uint8Array } {
    const none = new Uint8Array(0);
    return this.welcome ?? { clientLights: none, clientMaterials: none };
  }

  /** Bytes that wait to be read. */
  waiting(): number {
    return this.backlog;
  }

  private take(size: number): Uint8Array {
    this.backlog -= size;
    const first = this.chunks[0]!;
    if (first.length > size) {
      this.chunks[0] = first.subarray(size);
      return first.subarray(0, size);
    }
    if (first.length === size) {
      this.chunks.shift();
      return first;
    }
    const whole = new Uint8Array(size);
    let at = 0;
    while (at < size) {
      const chunk = this.chunks[0]!;
      const some = chunk.subarray(0, size - at);
      whole.set(some, at);
      at += some.length;
      if (some.length === chunk.length) this.chunks.shift();
      else this.chunks[0] = chunk.subarray(some.length);
    }
    return whole;
  }

  private untake(bytes: Uint8Array): void {
    this.chunks.unshift(bytes);
    this.backlog += bytes.length;
  }

  /** Handles messages until the time is over, or the renderer has to take some over first. True: there are
   * more. */
  async pump(now: () => number, untilMs: number): Promise<boolean> {
    let more = false;
    for (;;) {
      if (this.closed) return false;
      if (this.untaken >= UNTAKEN_MAX) break;
      const message = this.nextMessage();
      if (!message) break;
      await this.handle(message.type, message.body);
      if (this.kept.replica && this.kept.replica.batchTiles() >= BATCH_TILES) this.flush();
      if (now() >= untilMs) {
        more = true;
        break;
      }
    }
    this.flush();
    this.mindBacklog();
    return more;
  }

  private nextMessage(): { type: number; body: Uint8Array } | null {
    if (this.backlog < wire.HEADER_BYTES) return null;
    const head = this.take(wire.HEADER_BYTES);
    const header = wire.readHeader(head, 0);
    if (this.backlog < header.size) {
      this.untake(head);
      return null;
    }
    return { type: header.type, body: header.size ? this.take(header.size) : new Uint8Array(0) };
  }

  private flush(): void {
    const { replica } = this.kept;
    if (!replica || !replica.batchTiles()) return;
    const batch = replica.takeBatch();
    this.untaken += batch.id.length;
    this.host.tiles(batch, replica.meanIrradiance(), replica.takeVisible());
  }

  /** The renderer has taken over `count` tiles. */
  taken(count: number): void {
    this.untaken -= count;
  }

  private mindBacklog(): void {
    const held = this.paused || this.backlog > (this.held ? BACKLOG_LOW : BACKLOG_HIGH);
    if (held === this.held || !this.asked || !this.kept.replica) return;
    this.held = held;
    if (held) {
      this.host.send(wire.writeInterest(false, this.kept.replica.listOf([]), false));
      this.kept.replica.keepFinerOf([]);
    }
    this.interest.forget();
  }

  /** The page is hidden, or is visible again. */
  pause(paused: boolean): void {
    this.paused = paused;
    this.mindBacklog();
  }

  /** Changes the scene, unless an earlier change is not answered yet: then false. */
  change(changes: wire.Change[]): boolean {
    if (this.answered !== this.request) return false;
    this.host.send(wire.writeUpdate(++this.request, changes));
    return true;
  }

  /** The view's interest set; more tiles than a message takes are everything. */
  setInterest(ids: Uint32Array): void {
    this.interest.set(ids);
    this.kept.replica?.want(ids);
  }

  /** Call it a few times a second: interest, pings, silence. */
  tick(nowMs: number): void {
    if (nowMs - this.heardMs > SILENCE_MS) throw new ClosedError('the server has been silent for 15 s');
    if (!this.welcome) return;
    if (nowMs - this.pingedMs >= PING_MS) {
      this.pingedMs = nowMs;
      this.host.send(wire.writePing(BigInt(Math.floor(nowMs))));
    }
    this.tellWant(nowMs);
  }

  private tellWant(nowMs: number): void {
    const { replica } = this.kept;
    if (!replica || !this.asked || this.held || !this.interest.isDue(nowMs)) return;
    const ids = this.interest.list();
    const everything = ids.length > wire.INTEREST_MAX;
    this.host.send(wire.writeInterest(everything, replica.listOf(everything ? [] : ids), true));
    this.interest.tell(nowMs);
    replica.keepFinerOf(everything ? [] : ids);
  }

  private async handle(type: number, body: Uint8Array): Promise<void> {
    const replica = this.kept.replica;
    const outOfOrder = (name: string): never => {
      throw new ProtocolError(`message ${name}: out of order`);
    };
    if (type === wire.Type.WELCOME) {
      if (this.welcome) outOfOrder('WELCOME');
      return this.takeWelcome(wire.readWelcome(body));
    }
    if (type === wire.Type.REFUSAL) return this.takeRefusal(wire.readRefusal(body));
    if (!this.welcome) throw new ProtocolError('it does not begin with WELCOME: is this a lightwelld?');
    if (type === wire.Type.PACKAGE_CHUNK) {
      const { download } = this.kept;
      if (!download || replica) return outOfOrder('PACKAGE_CHUNK');
      const chunk = wire.readChunk(body);
      download.add(chunk.offset, chunk.data);
      this.host.progress(download.progress());
      this.finishDownload();
    } else if (type === wire.Type.FINISH_CHUNK) {
      const { finishes } = this.kept;
      if (!finishes || !this.finishesAsked) return outOfOrder('FINISH_CHUNK');
      const chunk = wire.readChunk(body);
      finishes.add(chunk.offset, chunk.data);
      this.finishFinishes();
    } else if (type === wire.Type.FRAME) {
      if (!replica) return outOfOrder('FRAME');
      const frame = wire.readFrame(body);
      if (frame.frame < this.lastFrame)
        throw new ProtocolError(`message FRAME: ${frame.frame} after ${this.lastFrame}`);
      replica.takeFrame(frame);
      this.lastFrame = this.kept.frame = frame.frame;
      this.kept.run = frame.run || this.kept.run;
      this.flush();
      this.host.frame({ frame, visible: replica.takeVisible() });
      this.host.send(wire.writeAck(frame.frame));
    } else if (type === wire.Type.TILE) {
      if (!replica || !this.lastFrame) return outOfOrder('TILE');
      replica.takeTile(wire.readTile(body), this.welcome.noiseShown);
      if (replica.hasFirst()) await this.askForFinishes();
    } else if (type === wire.Type.PING) this.host.send(wire.writePong(wire.readToken(body)));
    else if (type === wire.Type.SETTLED) {
      if (wire.readSettled(body) !== this.lastFrame) return outOfOrder('SETTLED');
      this.flush();
      this.host.settled();
      await this.askForFinishes();
    } else if (type === wire.Type.WAITING) {
      const waiting = wire.readWaiting(body);
      if (!this.lastFrame) this.host.waiting?.(waiting);
    } else if (type === wire.Type.UPDATED) {
      const updated = wire.readUpdated(body);
      if (updated.request !== this.request || this.answered === this.request) outOfOrder('UPDATED');
      this.answered = updated.request;
      if (updated.code) this.host.refused?.(updated.text);
    } else if ((type <= wire.Type.HOLDS && type !== wire.Type.PONG) || type === wire.Type.FINISH_REQUEST)
      throw new ProtocolError(`a message of type ${type}, which servers do not send`);
  }

  private takeRefusal(refusal: { code: number; text: string; retryAfterMs: number }): void {
    const text = refusal.text || 'it did not say why';
    const { VERSION, PROTOCOL, FEATURES, RATE, NOT_ALLOWED, TOKEN } = wire.Refusal;
    if (refusal.code === TOKEN) throw new TokenError(`it refused us: ${text}`);
    if ([VERSION, PROTOCOL, FEATURES, NOT_ALLOWED].includes(refusal.code as 1 | 3 | 6 | 8))
      throw new ProtocolError(`it refused us: ${text}`);
    const closed = new ClosedError(`it ended the session: ${text}`);
    closed.retryAfterMs = refusal.retryAfterMs || (refusal.code === RATE ? RATE_WAIT_MS : 0);
    throw closed;
  }

  private async takeWelcome(welcome: wire.Welcome): Promise<void> {
    if (welcome.features & ~this.offered)
      throw new ProtocolError('message WELCOME: features that were not offered');
    const { clientMaterials } = welcome;
    if (
      welcome.features & wire.Feature.DRAWS &&
      !this.host.drawsMaterials &&
      clientMaterials.some((bits) => bits)
    )
      throw new DrawsTooMuch();
    if (this.host.named && hex(welcome.package.hash) !== this.kept.packageHash)
      throw new ClosedError('it lights another scene');
    this.host.servers?.(welcome.servers);
    this.welcome = welcome;
    if (welcome.features & wire.Feature.CONTROL) this.host.mayControl?.();
    const { kept } = this;
    const draws = welcome.features & wire.Feature.DRAWS;
    const drawn = `${draws ? `${hex(welcome.clientLights)} ${hex(clientMaterials)}` : ''} ${this.finer()}`;
    const sameRun = !!welcome.run && welcome.run === kept.run;
    const finishHash = welcome.finish ? hex(welcome.finish.hash) : '';
    const sameFinishes = !kept.finishHash || kept.finishHash === finishHash;
    const samePackage = hex(welcome.package.hash) === kept.packageHash && sameFinishes;
    kept.run = welcome.run;
    if (!sameRun) kept.frame = 0n;
    kept.packageHash = hex(welcome.package.hash);
    if (kept.replica && (!samePackage || !kept.replica.isFor(welcome.features) || kept.drawn !== drawn)) {
      kept.replica.destroy();
      kept.replica = null;
    }
    kept.drawn = drawn;
    this.beginFinishes(welcome);
    if (kept.replica) {
      kept.replica.beginSession();
      if (sameRun) this.sendHolds(kept.replica);
      else kept.replica.beginRun();
      this.askFor(welcome.package.compressedSize, new Uint8Array(0));
      return;
    }
    if (!kept.download?.isOf(welcome.package, welcome.run)) {
      kept.download = new Download(welcome.package, welcome.run, 'scene', this.tiles, this.host);
      await kept.download.begin();
      if (this.closed) return;
    }
    const request = kept.download.request();
    this.askFor(request.offset, request.held);
    this.finishDownload();
  }

  /** Notes finishes that are to come. A page without room for them shows the scene matt. */
  private beginFinishes({ finish, run }: wire.Welcome): void {
    const { kept } = this;
    if (!kept.replica) kept.finishHash = '';
    if (!finish || kept.finishHash) kept.finishes = null;
    else if (!kept.finishes?.isOf(finish, run))
      try {
        kept.finishes = new Download(finish, run, 'finish', this.tiles, this.host);
      } catch (error) {
        if (!(error instanceof LimitError)) throw error;
        kept.finishes = null;
      }
  }

  /** How many finer levels the server has. */
  private finer(): number {
    const { features, finer } = this.welcome!;
    return features & wire.Feature.FINER ? finer : 0;
  }

  private async askForFinishes(): Promise<void> {
    const { finishes } = this.kept;
    if (!finishes || this.finishesAsked) return;
    this.finishesAsked = true;
    await finishes.begin();
    if (this.closed || this.finishFinishes()) return;
    const { offset, held } = finishes.request();
    this.host.send(wire.writePackageRequest(offset, held, wire.Type.FINISH_REQUEST));
  }

  /** Whether all of them are there. */
  private finishFinishes(): boolean {
    const { kept } = this;
    const bytes = kept.finishes?.finished();
    if (!bytes || !kept.replica) return false;
    kept.finishes = null;
    kept.finishHash = hex(this.welcome!.finish!.hash);
    this.host.finishes?.(readFinishPackage(bytes, kept.replica.scene));
    return true;
  }

  /** Asks for the package. A session streams from here on, and who has never sent INTEREST gets all tiles: so
   * it goes first. The view's set follows once there is a view. */
  private askFor(offset: number, heldParts: Uint8Array): void {
    const nothing = new Uint32Array(0);
    this.host.send(wire.writeInterest(false, { object: nothing, level: nothing, tile: nothing }, true));
    this.interest.begin();
    this.host.send(wire.writePackageRequest(offset, heldParts));
    this.asked = true;
  }

  private finishDownload(): void {
    const bytes = this.kept.download?.finished();
    if (!bytes || !this.welcome) return;
    this.kept.download = null;
    const scene: Scene = readPackage(bytes, this.tiles);
    this.kept.replica = new Replica(scene, this.tiles, this.welcome.features, undefined, this.finer());
    this.host.scene(this.kept.replica);
  }

  private sendHolds(replica: Replica): void {
    if (!(this.welcome!.features & wire.Feature.RESUME)) return replica.beginRun();
    if (this.kept.frame) this.host.send(wire.writeHoldsFrame(this.kept.frame));
    const { ids, version } = replica.held();
    for (let at = 0; at < ids.length; at += wire.HOLDS_MAX)
      this.host.send(
        wire.writeHolds(
          replica.listOf(ids.slice(at, at + wire.HOLDS_MAX)),
          version.slice(at, at + wire.HOLDS_MAX),
        ),
      );
  }
}
