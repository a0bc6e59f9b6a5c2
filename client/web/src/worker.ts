// worker.ts: the link to the server, beside the page: socket, session, decoding, reconnecting.
import { ClosedError, DrawsTooMuch, nothingKept, Session, type SessionHost } from './session.ts';
import { findBody } from './body.ts';
import { Clusters, fitsMaps } from './clusters.ts';
import { ProtocolError, TokenError } from './failure.ts';
import type { Finishes } from './finishes.ts';
import { buffersOf, buildGeometry } from './geometry.ts';
import { changesOf, type Lamp, lampsOf } from './lamps.ts';
import { nodeToWorld } from './pose.ts';
import { askWhy } from './refusal.ts';
import type { CameraPlace, End, FromWorker, ToWorker, Wasm } from './protocol.ts';
import type { Replica } from './replica.ts';
import { Servers } from './servers.ts';
import { Store } from './store.ts';
import { Tiles, zstdFrom } from './tiles.ts';
import { Feature } from './wire.ts';

/** True in the worker of lightwell-three, whose messages help more: the page has no bytes for that
 * (build.mjs). */
declare const FOR_THREE: boolean;

const TICK_MS = 50;
const SLICE_MS = 8; // of decoding, before other events have their turn
const RETRY_FIRST_MS = 50;
const RETRY_MAX_MS = 1000;
const OPEN_MAX_MS = 10_000; // a machine that is gone answers nothing

const post = (message: FromWorker, transfer: Transferable[] = []) =>
  (self as unknown as DedicatedWorkerGlobalScope).postMessage(message, transfer);

let token = new Uint8Array(0);

function setToken(digits: string): void {
  token = Uint8Array.from(digits.match(/../g) ?? [], (pair) => parseInt(pair, 16));
}

class Link {
  private readonly kept = nothingKept();
  private socket: WebSocket | null = null;
  private session: Session | null = null;
  private readonly servers: Servers;
  private begunMs = 0; // the attempt to connect
  private retryMs = RETRY_FIRST_MS;
  private retry: ReturnType<typeof setTimeout> | undefined;
  private pumping = false;
  private paused = false;
  private over = false;
  private received = 0;
  private heard = false; // something of this connection
  private clusters: Clusters | null = null;
  private controls = false; // this session may change the scene
  private lamps: Lamp[] = [];
  private readonly dimmed = new Map<number, number>(); // what is to be said of lamps

  constructor(
    url: string,
    private draws: boolean,
    private readonly drawsMaterials: boolean,
    private readonly tiles: Tiles,
    private readonly store: Store,
    private readonly extras: bigint,
  ) {
    this.servers = new Servers(url);
    setInterval(() => this.guard(() => this.tick()), TICK_MS);
    this.connect();
  }

  /** Of the session that there is, or of the attempt. */
  private get url(): string {
    return this.servers.url;
  }

  private connect(): void {
    if (this.over) return;
    let socket: WebSocket;
    this.begunMs = performance.now();
    try {
      socket = new WebSocket(this.url, 'lightwell');
    } catch (error) {
      this.end(`${this.url}: ${(error as Error).message}`);
      return;
    }
    this.socket = socket;
    this.heard = false;
    this.controls = false;
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      if (socket !== this.socket) return;
      this.session = new Session(
        this.kept,
        this.tiles,
        this.hostOf(socket),
        (this.draws ? Feature.DRAWS : 0n) | this.extras,
        performance.now(),
      );
      this.session.pause(this.paused);
    };
    socket.onmessage = (event: MessageEvent) => {
      if (socket !== this.socket || !this.session) return;
      if (!(event.data instanceof ArrayBuffer))
        return this.end(`${this.url}: text where bytes were expected`);
      if (!this.heard) post({ kind: 'state', text: '', final: false }); // it answers
      this.heard = true;
      this.received += event.data.byteLength;
      this.session.push(new Uint8Array(event.data), performance.now());
      void this.pump();
    };
    socket.onclose = () => {
      if (socket !== this.socket) return;
      // it has not opened: nobody listens, or the server does not let this page in
      if (FOR_THREE && !this.session)
        return void askWhy(this.url).then(({ forbidden, text }) => {
          if (socket !== this.socket) return;
          if (forbidden) this.end(`${this.url}: ${text}`, 'forbidden');
          else this.reconnect(`${this.url}: ${text}`);
        });
      // what has come is still to be read: a refusal may be the last message
      void this.pump().then(() => {
        if (socket === this.socket) this.reconnect(`${this.url} does not answer`);
      });
    };
  }

  private hostOf(socket: WebSocket): SessionHost {
    return {
      drawsMaterials: this.drawsMaterials,
      find: (hash) => this.store.find(hash),
      keep: (hash, bytes) => this.store.keep(hash, bytes),
      send: (bytes) => {
        if (socket.readyState === WebSocket.OPEN) socket.send(bytes);
      },
      progress: (fraction) => post({ kind: 'progress', fraction }),
      scene: (replica) => this.postScene(replica),
      // three's materials have the file's own
      ...(!FOR_THREE && { finishes: (finishes: Finishes) => this.postFinishes(finishes) }),
      frame: (news) => {
        this.retryMs = RETRY_FIRST_MS;
        post({ kind: 'state', text: '', final: false });
        this.clusters?.takeFrame(news.frame);
        const clusters = this.clusters?.take();
        if (clusters) post({ kind: 'clusters', clusters });
        post({ kind: 'frame', ...news });
      },
      tiles: (batch, mean, visible) =>
        post({ kind: 'tiles', batch, mean, visible, first: this.kept.replica!.hasFirst() }, [
          batch.texels.buffer,
        ]),
      settled: () => post({ kind: 'settled' }),
      waiting: (waiting) => post({ kind: 'waiting', waiting }),
      token,
      named: this.servers.isNamed(),
      servers: (servers) => this.servers.found(servers),
      mayControl: () => {
        this.controls = true;
        this.postLamps();
      },
      refused: (text) => post({ kind: 'state', text, final: false }),
    };
  }

  private postScene(replica: Replica): void {
    const { clientLights, clientMaterials } = this.session!.draws();
    this.clusters = null;
    if (replica.layer === 1) {
      this.clusters = new Clusters(replica.scene, clientMaterials);
      // with more of them all light comes in tiles
      if (!fitsMaps(replica.scene.lights, clientLights, this.clusters.count())) throw new DrawsTooMuch();
    }
    const data = buildGeometry(replica.scene, this.tiles);
    const scene: FromWorker = {
      kind: 'scene',
      data,
      cameras: this.cameras(replica, 0),
      body: findBody(replica.scene),
      draws: replica.layer === 1,
      clientLights,
      clusters: this.clusters?.count() ?? 0,
      finer: replica.map.finer,
      directed: replica.isDirected,
    };
    post(scene, buffersOf(data));
    this.postLamps();
  }

  /** Surfaces again, with vertices split where tangents differ. */
  private postFinishes(finishes: Finishes): void {
    const data = buildGeometry(this.kept.replica!.scene, this.tiles, finishes);
    post({ kind: 'finishes', data }, buffersOf(data));
  }

  private postLamps(): void {
    const scene = this.kept.replica?.scene;
    this.lamps = scene && this.controls ? lampsOf(scene) : [];
    if (scene) post({ kind: 'lamps', names: this.lamps.map((lamp) => lamp.name) });
  }

  /** The newest of what was asked for, once the last of it is answered. */
  private tellLamps(): void {
    const scene = this.kept.replica?.scene;
    if (!this.dimmed.size || !scene || !this.controls || !this.session) return;
    const changes = [...this.dimmed].flatMap(([lamp, factor]) =>
      this.lamps[lamp] ? changesOf(scene, this.lamps[lamp], factor) : [],
    );
    if (this.session.change(changes)) this.dimmed.clear();
  }

  private cameras(replica: Replica, timeS: number): CameraPlace[] {
    return replica.scene.cameras.map((camera) => ({
      name: camera.name,
      fovY: camera.fovY,
      height: camera.height,
      toWorld: Array.from(nodeToWorld(replica.scene, camera.node, timeS)),
    }));
  }

  /** A camera may be carried by the animation. */
  private postCamera(index: number, timeS: number): void {
    const place = this.kept.replica && this.cameras(this.kept.replica, timeS)[index];
    if (place) post({ kind: 'camera', place });
  }

  /** Reads what is there, a slice at a time. */
  private async pump(): Promise<void> {
    if (this.pumping) return;
    this.pumping = true;
    try {
      const now = () => performance.now();
      while (this.session && (await this.session.pump(now, now() + SLICE_MS)))
        await new Promise((go) => setTimeout(go, 0));
    } catch (error) {
      this.fail(error);
    } finally {
      this.pumping = false;
    }
  }

  private tick(): void {
    if (this.session) this.session.tick(performance.now());
    else if (this.socket && performance.now() - this.begunMs > OPEN_MAX_MS)
      this.reconnect(`${this.url} does not answer`);
    this.tellLamps();
    const waiting = this.session?.waiting() ?? 0;
    post({ kind: 'traffic', bytes: this.received, waiting, memory: this.tiles.memoryBytes() });
  }

  private guard(run: () => void): void {
    try {
      run();
    } catch (error) {
      this.fail(error);
    }
  }

  private fail(error: unknown): void {
    const text = `${this.url}: ${(error as Error).message}`;
    if (error instanceof DrawsTooMuch) this.takeAllLight();
    else if (error instanceof TokenError && !this.servers.isNamed()) {
      this.drop();
      post({ kind: 'state', text, final: false });
      post({ kind: 'token' });
    } else if (error instanceof ClosedError) this.reconnect(text, error.retryAfterMs);
    else if (error instanceof ProtocolError) this.end(text);
    else
      this.end(
        error instanceof RangeError ? `${this.url}: this page has no memory left for the scene` : text,
        FOR_THREE ? 'failed' : undefined,
      );
  }

  private drop(): void {
    const socket = this.socket;
    this.socket = null;
    this.session?.close();
    this.session = null;
    socket?.close();
  }

  private end(text: string, end?: End): void {
    if (this.servers.isNamed()) return this.reconnect(text); // others are tried
    this.drop();
    this.over = true;
    post({ kind: 'state', text, final: true, ...(FOR_THREE && { end }) });
  }

  private reconnect(text: string, retryAfterMs = 0): void {
    if (this.over) return;
    this.drop();
    post({ kind: 'state', text: `${text}; trying again`, final: false });
    clearTimeout(this.retry);
    const waitMs = retryAfterMs ? retryAfterMs * (1 + Math.random() / 2) : this.retryMs * Math.random();
    this.retry = setTimeout(() => {
      this.servers.next();
      this.connect();
    }, waitMs);
    this.retryMs = Math.min(2 * this.retryMs, RETRY_MAX_MS);
  }

  take(message: Exclude<ToWorker, { kind: 'connect' }>): void {
    this.guard(() => {
      if (message.kind === 'interest') this.session?.setInterest(message.ids);
      else if (message.kind === 'taken') {
        this.session?.taken(message.count);
        void this.pump();
      } else if (message.kind === 'pause') {
        this.paused = message.paused;
        this.session?.pause(message.paused);
      } else if (message.kind === 'camera') this.postCamera(message.index, message.timeS);
      else if (message.kind === 'dim') this.dimmed.set(message.lamp, message.factor);
      else if (message.kind === 'token') this.connect();
      else if (message.kind === 'tiles') this.takeAllLight();
      else this.begin();
    });
  }

  /** Connects again without drawing any light. Parts of the scene are kept in the browser. */
  private takeAllLight(): void {
    this.draws = false;
    this.drop();
    this.connect();
  }

  /** The page has lost scene and light: all of them again. */
  private begin(): void {
    this.kept.replica?.destroy();
    this.kept.replica = null;
    this.kept.download = null;
    this.retryMs = RETRY_FIRST_MS;
    this.reconnect('the graphics context was lost');
  }
}

let link: Promise<Link> | null = null;

const WASM_MAGIC = 0x0061736d;

const beside: Wasm = { tiles: 'lightwell_tiles.wasm', zstd: 'zstd.wasm' };

/** A module's bytes. A bundler that does not know a file, or a server that answers all addresses with its
 * page, gives text. */
async function bytesOf(from: string | ArrayBuffer): Promise<ArrayBuffer> {
  if (FOR_THREE && typeof from !== 'string') return from;
  const response = await fetch(from as string);
  if (!response.ok) throw new Error(`${from}: ${response.status}`);
  const bytes = await response.arrayBuffer();
  if (FOR_THREE && (bytes.byteLength < 8 || new DataView(bytes).getUint32(0) !== WASM_MAGIC))
    throw new Error(`${from}: what is there is not WebAssembly`);
  return bytes;
}

async function open(
  url: string,
  draws: boolean,
  clusters: boolean,
  wasm = beside,
  extras = Feature.FINER | Feature.DIRECTION,
): Promise<Link> {
  zstdFrom(() => bytesOf(wasm.zstd));
  const [tiles, store] = await Promise.all([
    bytesOf(wasm.tiles).then((bytes) => Tiles.create(bytes)),
    Store.open(),
  ]);
  return new Link(url, draws, clusters, tiles, store, extras);
}

self.onmessage = (event: MessageEvent<ToWorker>) => {
  const message = event.data;
  if (message.kind === 'token') setToken(message.token);
  if (message.kind === 'connect') {
    link = open(message.url, message.draws, message.clusters, message.wasm, message.extras);
    link.catch((error: Error) =>
      post({ kind: 'state', text: error.message, final: true, ...(FOR_THREE && { end: 'failed' }) }),
    );
  } else void link?.then((it) => it.take(message));
};
