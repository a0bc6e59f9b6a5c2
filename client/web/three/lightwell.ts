// lightwell.ts: live light on a three.js scene that was loaded from the glTF that a lightwelld lights.
//
//     const light = await Lightwell.attach(scene, 'wss://host/ws');
//     ... before each picture: light.update(camera, renderer.domElement.height);
//     light.dispose();
//
// Light arrives as lightMap, of every object by itself (lightmaps.ts); suns, points and spots that the server
// leaves to clients are three's own, with shadows. attach() puts the server's meshes in the place of the
// loaded ones (swap.ts), and dispose() puts those back. Objects of the client's alone get light by rays
// (gather.ts).
import * as THREE from 'three';

import { serverAddress } from '../src/address.ts';
import { AtlasMap } from '../src/atlas.ts';
import type { SceneData } from '../src/geometry.ts';
import { LightKind } from '../src/package.ts';
import type { FromWorker, ToWorker } from '../src/protocol.ts';
import { type DirectionTile, GONE, type TileBatch } from '../src/replica.ts';
import { READY, waitingText } from '../src/waiting.ts';
import { Feature, type Frame, INTEREST_MAX } from '../src/wire.ts';
import { FinePool, SLOTS_MAX } from './fine_pool.ts';
import { Follower } from './follow.ts';
import { Gather } from './gather.ts';
import { type AnyRenderer, emptyMap, isWebGL, takeTile, UNKNOWN, upload } from './lightmaps.ts';
import { lackOf, type ShadingNodes } from './nodes.ts';
import { startWorker } from './start.ts';
import { Survey } from './survey.ts';
import { Changes, hideLights, type Placed, placeObjects } from './swap.ts';

const UPLOAD_MS = 3;
const INTEREST_MS = 200;
const TIMEOUT_MS = 10_000;
const SUN_SHADOW = 2048;
const POINT_SHADOW = 512; // of each of six sides
const SHADOW_MAX = 16384;

export interface AttachOptions {
  /** Draw the server's suns, points and spots as three's own lights with shadows, where it lets clients do
   * so, and emissive surfaces are not among them. Default true. */
  keyLights?: boolean;
  /** Side of their shadow maps, texels. Default 2048, and 512 for each of the six sides of a point light. */
  shadowMapSize?: number;
  /** How many tiles of finer levels there is room for, 64 x 64 texels each, up to 1024: lightmaps are up to
   * 16 times finer where the camera is near. WebGPURenderer reads them with `tsl`. Default 0: none. */
  finerSlots?: number;
  /** Ask where light comes from: normal maps show in it, and gloss shows which side it comes from.
   * WebGPURenderer shows that with `tsl`. Default true. */
  directions?: boolean;
  /** three's shading language, for directions and finer levels with WebGPURenderer: TSL of three/webgpu.
   * Default: it shows neither. */
  tsl?: object;
  /** Folder that holds worker.js, lightwell_tiles.wasm and zstd.wasm of this package, for a bundler that does
   * not find them. Default: beside lightwell.js. lightwell-three/inline needs none. */
  assets?: string | URL;
  /** For a server that wants one: 64 hexadecimal digits. */
  token?: string;
  /** The longest silence of the server before its scene is here, ms; Infinity: no limit. The first light may
   * take longer: `signal` ends that wait. Default 10,000. */
  timeoutMs?: number;
  /** Ends the wait for the first light: attach() rejects with its reason. Later it has no effect. */
  signal?: AbortSignal;
  /** Called when the state or its text changes, and only then. text: what a person should know, one line
   * ("Looking inside objects: 42 %"); '': nothing. */
  onState?: (state: LightwellState, text: string) => void;
  /** The wait for the first light in numbers, for a bar of your own: a few times a second at most, from the
   * scene's request to the first light, the last time with 'ready'. Never, if there is light already. */
  onWaiting?: (waiting: LightwellWaiting) => void;
}

/** What becomes of the light.
 *
 * connecting  there is no connection yet; it is tried again
 * receiving   the scene is on its way
 * lighting    the scene is here, and no light yet
 * live        light is here, and follows the server
 * lost        light is here, and the connection is gone; it is tried again
 * forbidden   the server does not let this page in, or wants a token; final
 * refused     this server and this page cannot work together; final */
export type LightwellState =
  | 'connecting'
  | 'receiving'
  | 'lighting'
  | 'live'
  | 'lost'
  | 'forbidden'
  | 'refused';

/** Why attach(), sample() or follow() failed.
 *
 * option     an argument is wrong; the message names it
 * timeout    the server has been silent for timeoutMs: it is down, or the address is wrong
 * forbidden  the server does not let this page in (--http-origin, --http-host), or wants a token
 * refused    this server and this page cannot work together
 * attached   the scene, or a part of it, has a Lightwell already
 * failed     this page cannot go on: its worker, its WebAssembly, its memory
 * disposed   dispose() was called before the first light */
export type LightwellErrorCode =
  | 'option'
  | 'timeout'
  | 'forbidden'
  | 'refused'
  | 'attached'
  | 'failed'
  | 'disposed';

export class LightwellError extends Error {
  constructor(
    readonly code: LightwellErrorCode,
    message: string,
  ) {
    super(message);
    this.name = 'LightwellError';
  }
}

/** What a server does before its first light. */
export interface LightwellWaiting {
  /** 'other': of a newer server. */
  stage: 'placing texels' | 'looking inside objects' | 'first light' | 'ready' | 'other';
  /** Of that stage, 0 to 1. */
  share: number;
}

/** By WAITING's numbers. */
const STAGES: LightwellWaiting['stage'][] = [
  'other',
  'placing texels',
  'looking inside objects',
  'first light',
  'ready',
];

const fail = (what: string): never => {
  throw new LightwellError('option', what);
};

/** Scenes that have light, and from where. */
const attached = new WeakMap<THREE.Object3D, string>();

function checkGiven(scene: THREE.Object3D, url: string, options: AttachOptions): void {
  if (!(scene as Partial<THREE.Object3D> | null)?.isObject3D) fail('scene: it is not a THREE.Object3D');
  if (typeof url !== 'string' || !/^wss?:\/\/[^/]+/.test(url))
    fail(`url: ${String(url)}: it is not ws://HOST:PORT/ws or wss://HOST:PORT/ws`);
  const address = serverAddress(new URL(location.href), url);
  if ('problem' in address) fail(`url: ${address.problem}`);
  const { shadowMapSize: side, timeoutMs, token, finerSlots: slots } = options;
  if (side !== undefined && !(Number.isInteger(side) && side > 0 && side <= SHADOW_MAX))
    fail(`shadowMapSize: ${side}: it is not a whole number from 1 to ${SHADOW_MAX}`);
  if (slots !== undefined && !(Number.isInteger(slots) && slots >= 0 && slots <= SLOTS_MAX))
    fail(`finerSlots: ${slots}: it is not a whole number from 0 to ${SLOTS_MAX}`);
  const lack = options.tsl && lackOf(options.tsl);
  if (lack) fail(`tsl: it has no ${lack}: it is not TSL of three/webgpu, or that of an older three`);
  if (timeoutMs !== undefined && !(timeoutMs > 0)) fail(`timeoutMs: ${timeoutMs}: it is not a time above 0`);
  if (token !== undefined && !/^([0-9a-f]{64})?$/i.test(token))
    fail('token: it is not 64 hexadecimal digits');
  const check = (node: THREE.Object3D) => {
    const by = attached.get(node);
    if (by !== undefined)
      throw new LightwellError('attached', `scene: it has light from ${by} already; dispose() that first`);
  };
  scene.traverse(check);
  scene.traverseAncestors(check);
}

export class Lightwell {
  private readonly worker: Worker;
  private readonly endWorker: () => void;
  private placed: (Placed | null)[] = []; // by object
  private lights: (THREE.Light | null)[] = []; // by light
  private changes = new Changes(); // of the scene
  private map: AtlasMap | null = null;
  private gather: Gather | null = null;
  private pool: FinePool | null = null; // tiles of finer levels; null: there are none
  private survey: Survey | null = null;
  private readonly follower = new Follower();
  private queue: { batch: TileBatch; at: number; texel: number }[] = [];
  private interestMs = 0;
  private solveMs = 0;
  private frameMs = 0;
  private heardMs = performance.now();
  private heardBytes = 0;
  private limit: ReturnType<typeof setTimeout> | undefined;
  private renderer: AnyRenderer | null = null; // once it has drawn one of the meshes
  private settle: { resolve(): void; reject(reason: unknown): void } | null = null;
  private readonly onAbort = () => this.giveUp(this.options.signal!.reason);
  private wait = waitingText(null); // for the first light, in words
  private over = false; // no more from the server
  private disposed = false;
  private reported = { state: 'connecting' as LightwellState, text: '' };
  private frameNumber = 0;
  /** Names of nodes of the server's scene that the three.js scene does not have. */
  readonly missing: string[] = [];

  private constructor(
    private readonly root: THREE.Object3D,
    private readonly url: string,
    private readonly options: AttachOptions,
  ) {
    const { worker, wasm, end } = startWorker(options.assets);
    this.worker = worker;
    this.endWorker = end;
    worker.onmessage = (event: MessageEvent<FromWorker>) => this.take(event.data);
    worker.onerror = (event) => {
      event.preventDefault?.();
      const why = event.message || 'it does not load; see Bundlers in the README of lightwell-three';
      this.stop(new LightwellError('failed', `worker.js: ${why}`));
    };
    attached.set(root, url);
    if (options.token) this.tell({ kind: 'token', token: options.token });
    const extras =
      (options.finerSlots ? Feature.FINER : 0n) | ((options.directions ?? true) ? Feature.DIRECTION : 0n);
    this.tell({ kind: 'connect', url, draws: options.keyLights ?? true, clusters: false, wasm, extras });
    this.watch();
  }

  /** Resolves once the scene has its first light.
   *
   * scene    what GLTFLoader has loaded from the file that the server lights; its meshes are replaced until
   *          dispose()
   * url      ws://HOST:PORT/ws or wss://HOST:PORT/ws
   * Errors   a LightwellError whose `code` says what it is, in one line; the reason of `options.signal` */
  static attach(scene: THREE.Object3D, url: string, options: AttachOptions = {}): Promise<Lightwell> {
    return new Promise((resolve, reject) => {
      options.signal?.throwIfAborted();
      checkGiven(scene, url, options);
      const light: Lightwell = new Lightwell(scene, url, options);
      light.settle = { resolve: () => resolve(light), reject };
      options.signal?.addEventListener('abort', light.onAbort);
    });
  }

  /** Number of the server's newest frame that has come. */
  get frame(): number {
    return this.frameNumber;
  }

  /** What becomes of the light; onState tells each change. */
  get state(): LightwellState {
    return this.reported.state;
  }

  /** How many levels of lightmaps are finer than level 0; 0: none was asked for, or the server has none. */
  get finerLevels(): number {
    return this.pool ? this.map!.finer : 0;
  }

  /** How many tiles of finer levels are shown, up to finerSlots. */
  get finerTiles(): number {
    return this.pool?.shown ?? 0;
  }

  /** Ends the session. What is there stays, until dispose(). */
  detach(): void {
    if (this.over) return;
    this.over = true;
    this.worker.terminate();
    this.endWorker();
    clearTimeout(this.limit);
    this.options.signal?.removeEventListener('abort', this.onAbort);
  }

  /** Ends the session, puts the scene back as it was before attach(), and frees all that came since:
   * geometry, textures, shadow maps, the worker. What follow() has changed goes back, too. */
  dispose(): void {
    if (this.disposed) return;
    if (this.settle)
      return this.giveUp(new LightwellError('disposed', 'dispose() came before the first light'));
    this.disposed = true;
    this.detach();
    this.clear();
    attached.delete(this.root);
  }

  /** How old the light is, in seconds. While nothing changes it grows, though the light is right. */
  ageSeconds(): number {
    return (performance.now() - this.frameMs + this.solveMs) / 1000;
  }

  /** Irradiance at a point on a surface, for objects of the client's alone: W/m^2 per linear-sRGB channel, by
   * 128 rays to the nearest surfaces that the server lights. It does not contain what three's own lights give
   * (keyLights), nor see small lamps that shine by their material well.
   *
   * point    world space
   * normal   of the surface, world space; any length
   * target   gets the result and is returned
   * Errors   a LightwellError ('option'): a number that is not finite, a normal without a direction. Before
   * the
   *          first light and after dispose() the result is 0. */
  sample(point: THREE.Vector3, normal: THREE.Vector3, target: THREE.Color = new THREE.Color()): THREE.Color {
    const numbers = [...point.toArray(), ...normal.toArray()];
    if (!numbers.every(Number.isFinite)) fail('sample: point or normal is not finite');
    if (!normal.lengthSq()) fail('sample: normal has no direction');
    const e = this.gather?.irradiance(point, normal.clone().normalize()) ?? [0, 0, 0];
    [target.r, target.g, target.b] = [e[0]!, e[1]!, e[2]!];
    return target;
  }

  /** Keeps a light probe for an object of the client's alone, which lights this object and what is below it,
   * and nothing else: nine coefficients of spherical harmonics at its centre, by 256 rays, renewed by
   * update() as it moves and the light changes. Materials are copied meanwhile.
   *
   * Returns a function that ends it. dispose() does, too.
   * Errors   a LightwellError ('option'): no Object3D, or one that the server lights */
  follow(object: THREE.Object3D): () => void {
    if (!(object as Partial<THREE.Object3D> | null)?.isObject3D) fail('follow: it is not a THREE.Object3D');
    if (this.disposed) fail('follow: dispose() has been called');
    const lit = new Set<THREE.Object3D>();
    for (const placed of this.placed) if (placed) lit.add(placed.mesh);
    if (lit.has(object)) fail(`follow: the server lights "${object.name}" itself`);
    return this.follower.add(object, lit, this.gather);
  }

  private tell(message: ToWorker): void {
    if (!this.over) this.worker.postMessage(message);
  }

  private say(state: LightwellState, text = ''): void {
    if (this.over || (this.reported.state === state && this.reported.text === text)) return;
    this.reported = { state, text };
    this.options.onState?.(state, text);
  }

  /** The server must be heard of before its scene is here. */
  private watch(): void {
    const limitMs = this.options.timeoutMs ?? TIMEOUT_MS;
    if (!Number.isFinite(limitMs)) return;
    const leftMs = this.heardMs + limitMs - performance.now();
    if (this.settle && !this.isWaitingForServer()) this.heardMs = performance.now();
    else if (leftMs <= 0) {
      const why = this.reported.text ? `: ${this.reported.text.replace('; trying again', '')}` : '';
      return this.stop(
        new LightwellError(
          'timeout',
          `${this.url}: no answer in ${limitMs / 1000} s${unprefixed(why, this.url)}`,
        ),
      );
    }
    clearTimeout(this.limit);
    this.limit = setTimeout(() => this.watch(), Math.min(Math.max(leftMs, 50), 2 ** 31 - 1));
  }

  private isWaitingForServer(): boolean {
    return this.reported.state === 'connecting' || this.reported.state === 'receiving';
  }

  /** No more comes. Before the first light attach() rejects. */
  private stop(error: LightwellError): void {
    const { code, message } = error;
    if (code === 'forbidden' || code === 'refused') this.say(code, message);
    else if (!this.settle) this.say('lost', message);
    if (this.settle) this.giveUp(error);
    else this.detach();
  }

  private giveUp(reason: unknown): void {
    const { settle } = this;
    this.settle = null;
    this.dispose();
    settle?.reject(reason);
  }

  private take(message: FromWorker): void {
    if (this.over) return;
    if (message.kind !== 'traffic' || message.bytes !== this.heardBytes) {
      if (message.kind === 'traffic') this.heardBytes = message.bytes;
      if (message.kind !== 'state' || !message.text) this.heardMs = performance.now();
    }
    if (message.kind === 'token') this.stop(new LightwellError('forbidden', this.forbidden()));
    else if (message.kind === 'state') this.takeState(message);
    else if (message.kind === 'progress')
      this.say('receiving', `Receiving the scene: ${Math.round(100 * message.fraction)} %`);
    else if (message.kind === 'waiting') {
      const { stage, share } = message.waiting;
      this.options.onWaiting?.({ stage: STAGES[stage] ?? 'other', share });
      this.wait = waitingText(message.waiting);
      // it may come before the scene
      if (this.reported.state === 'lighting' && stage !== READY) this.say('lighting', this.wait);
    } else if (message.kind === 'scene') this.takeScene(message);
    else if (message.kind === 'frame') this.takeFrame(message.frame, message.visible);
    else if (message.kind === 'tiles') {
      if (message.visible) this.setVisible(message.visible);
      this.queue.push({ batch: message.batch, at: 0, texel: 0 });
      if (!message.first || !this.settle) return;
      while (this.queue.length) this.takeTiles(Infinity);
      clearTimeout(this.limit);
      this.options.signal?.removeEventListener('abort', this.onAbort);
      const { settle } = this;
      this.settle = null;
      this.say('live');
      settle.resolve();
    }
  }

  private forbidden(): string {
    return `${this.url}: the server wants a token${this.options.token ? ', and not this one' : ''}`;
  }

  private takeState({ text, final, end }: Extract<FromWorker, { kind: 'state' }>): void {
    if (final) return this.stop(new LightwellError(end ?? 'refused', text));
    if (text) this.say(this.settle ? 'connecting' : 'lost', text);
  }

  // ---- the scene ----

  /** A server that was started again may light another one. */
  private takeScene(message: Extract<FromWorker, { kind: 'scene' }>): void {
    const { data, draws, clientLights, finer, directed } = message;
    this.clear();
    const tsl = (this.options.tsl as ShadingNodes | undefined) ?? null;
    const map = (this.map = new AtlasMap(data.meshes, data.objectMesh, finer));
    const pool = map.finer ? new FinePool(map, this.options.finerSlots!, directed, !!tsl) : null;
    if (pool) this.changes.add(() => pool.dispose());
    this.pool = pool;
    this.placed = placeObjects(data, this.root, this.changes, this.missing, pool, directed, tsl);
    this.survey = pool && new Survey(map, this.placed, pool);
    for (const placed of this.placed) {
      if (!placed) continue;
      const { mesh } = placed;
      const before = mesh.onBeforeRender;
      this.changes.set(mesh, {
        onBeforeRender: (renderer, ...rest) => {
          this.renderer = renderer;
          pool?.drawnBy(renderer);
          before.call(mesh, renderer, ...rest);
        },
      });
    }
    hideLights(data, this.root, this.changes);
    this.placeLights(data, draws, clientLights);
    this.gather = new Gather(data, this.root, this.placed, (light) => !!this.lights[light]);
    if (this.settle) this.say('lighting', this.wait);
  }

  /** The scene as it was before. */
  private clear(): void {
    if (this.disposed) this.follower.restore();
    this.changes.restore();
    this.placed = [];
    this.lights = [];
    this.queue = [];
    this.missing.length = 0;
    this.map = this.gather = this.renderer = this.pool = this.survey = null;
  }

  private placeLights(data: SceneData, draws: boolean, clientLights: Uint8Array): void {
    data.lights.forEach((from, i) => {
      this.lights[i] = null;
      if (!draws || !((clientLights[i >> 3]! >> (i & 7)) & 1)) return;
      const light =
        from.kind === LightKind.DIRECTIONAL
          ? new THREE.DirectionalLight()
          : from.kind === LightKind.SPOT
            ? new THREE.SpotLight(0, 0, 0, from.outerCone, 1 - from.innerCone / from.outerCone, 2)
            : new THREE.PointLight(0, 0, 0, 2);
      light.name = from.name;
      light.castShadow = true;
      const side = this.options.shadowMapSize ?? (from.kind === LightKind.POINT ? POINT_SHADOW : SUN_SHADOW);
      light.shadow!.mapSize.setScalar(side);
      light.shadow!.bias = -0.0005;
      light.shadow!.normalBias = 0.02;
      this.root.add(light);
      const target = 'target' in light ? light.target : null;
      if (target) this.root.add(target);
      this.changes.add(() => {
        light.removeFromParent();
        target?.removeFromParent();
        light.dispose();
      });
      this.lights[i] = light;
    });
  }

  private takeFrame(frame: Frame, visible: Uint8Array | null): void {
    this.frameMs = performance.now();
    this.frameNumber = Number(frame.frame);
    this.solveMs = frame.solveNs / 1e6;
    this.root.updateWorldMatrix(true, false);
    const rows = new THREE.Matrix4();
    frame.object.forEach((object, i) => {
      const placed = this.placed[object];
      if (!placed) return;
      // 3 x 4, row-major
      rows.fromArray([...frame.transform.subarray(12 * i, 12 * i + 12), 0, 0, 0, 1]).transpose();
      const { mesh } = placed;
      // the server's world is the scene's space
      mesh.parent!.updateWorldMatrix(true, false);
      mesh.matrix.copy(mesh.parent!.matrixWorld).invert().multiply(this.root.matrixWorld).multiply(rows);
      mesh.matrixAutoUpdate = false;
      mesh.matrixWorldNeedsUpdate = true;
    });
    frame.light.forEach((index, i) => this.moveLight(index, frame, i));
    frame.material.forEach((material, i) => {
      for (const placed of this.placed)
        for (const each of placed?.materials ?? []) {
          if (each.index !== material) continue;
          const standard = each.material as THREE.MeshStandardMaterial;
          standard.color?.fromArray(frame.baseColour, 3 * i);
          standard.emissive?.fromArray(frame.emission, 3 * i);
          standard.emissiveIntensity = 1;
        }
    });
    this.gather?.takeFrame(frame);
    this.follower.lightChanged();
    if (visible) this.setVisible(visible);
    if (!this.settle) this.say('live');
  }

  private moveLight(index: number, frame: Frame, i: number): void {
    const light = this.lights[index];
    if (!light) return;
    light.color.fromArray(frame.lightIntensity, 3 * i);
    light.intensity = 1;
    light.position.fromArray(frame.lightPosition, 3 * i);
    if (!('target' in light)) return;
    const direction = new THREE.Vector3().fromArray(frame.lightDirection, 3 * i);
    if (light instanceof THREE.DirectionalLight) {
      // its map covers all of the scene
      const box = new THREE.Box3();
      for (const placed of this.placed) if (placed?.mesh.visible) box.expandByObject(placed.mesh);
      const sphere = box.getBoundingSphere(new THREE.Sphere());
      const inRoot = this.root.worldToLocal(sphere.center.clone());
      light.position.copy(inRoot).addScaledVector(direction, -2 * sphere.radius);
      const camera = light.shadow.camera;
      [camera.left, camera.right] = [-sphere.radius, sphere.radius];
      [camera.bottom, camera.top] = [-sphere.radius, sphere.radius];
      [camera.near, camera.far] = [0.5 * sphere.radius, 3.5 * sphere.radius];
      camera.updateProjectionMatrix();
    }
    (light.target as THREE.Object3D).position.copy(light.position).add(direction);
  }

  private setVisible(visible: Uint8Array): void {
    this.placed.forEach((placed, object) => {
      if (placed) placed.mesh.visible = visible[object] === 1;
    });
    this.gather?.forget();
  }

  // ---- light ----

  /** Takes over light that has come, for 3 ms at most, renews one followed object, and says what the camera
   * sees. To be called once a picture. A page that never calls it gets no light after the first.
   *
   * camera   that the picture is drawn with
   * height   of the picture, pixels */
  update(camera: THREE.Camera, height: number): void {
    const untilMs = performance.now() + UPLOAD_MS;
    while (this.queue.length && performance.now() < untilMs) this.takeTiles(untilMs);
    if (this.gather) this.follower.update(this.gather);
    this.updateFiner(camera, height);
    if (performance.now() - this.interestMs < INTEREST_MS || !this.map) return;
    this.interestMs = performance.now();
    this.tell({ kind: 'interest', ids: this.listInterest(camera, height) });
  }

  /** Looks for tiles of finer levels, and fades them. A WebGPURenderer reads them by tsl alone. */
  private updateFiner(camera: THREE.Camera, height: number): void {
    const { pool, survey, gather, renderer } = this;
    if (!pool || !survey || !gather || !renderer) return;
    if (!isWebGL(renderer) && !this.options.tsl) return;
    const nowMs = performance.now();
    camera.updateWorldMatrix(true, false);
    survey.step(gather, camera, height, nowMs);
    pool.tiles.step(nowMs);
  }

  private takeTiles(untilMs: number): void {
    const first = this.queue[0]!;
    const { batch } = first;
    const from = first.at;
    const isDone = () => first.at === batch.id.length && !batch.directions.length;
    do {
      if (first.at === batch.id.length) {
        const directions = batch.directions.shift();
        if (directions) this.takeDirections(directions);
        continue;
      }
      const id = batch.id[first.at]!;
      const noiseLevel = batch.noiseLevel[first.at]!;
      const place = this.map!.place(id);
      const size = noiseLevel === GONE ? 0 : place.width * place.height;
      const texels = batch.texels.subarray(first.texel, first.texel + size);
      const lightmap = this.placed[place.object]?.lightmap;
      if (id >= this.map!.plainCount) {
        // a noisy tile of a finer level is not read
        if (noiseLevel) this.pool?.tiles.drop(id);
        else this.pool?.tiles.take(id, texels);
      } else if (lightmap) {
        takeTile(lightmap, place, texels);
        upload(lightmap, place, this.renderer);
      }
      first.texel += size;
      first.at++;
    } while (!isDone() && performance.now() < untilMs);
    if (isDone()) this.queue.shift();
    this.follower.lightChanged();
    this.tell({ kind: 'taken', count: first.at - from });
  }

  private takeDirections({ id, texels }: DirectionTile): void {
    if (id >= this.map!.plainCount) {
      this.pool?.direct(id, texels);
      return;
    }
    const place = this.map!.place(id);
    const { directions, lightmap, materials } = this.placed[place.object] ?? {};
    if (!directions || !lightmap) return;
    if (!directions.map) {
      const { texture } = (directions.map = emptyMap(lightmap.width, lightmap.height, UNKNOWN));
      this.changes.add(() => texture.dispose());
      directions.uniforms.lightwellDirections.value = texture;
      // a WebGPURenderer looks at properties that it knows, and at this
      for (const { material } of materials!) material.needsUpdate = true;
    }
    takeTile(directions.map, place, texels);
    upload(directions.map, place, this.renderer);
  }

  /** All tiles of objects in view, of the level whose texels are as large as pixels. */
  private listInterest(camera: THREE.Camera, height: number): Uint32Array<ArrayBuffer> {
    camera.updateWorldMatrix(true, false);
    const projection = new THREE.Matrix4().multiplyMatrices(
      camera.projectionMatrix,
      camera.matrixWorldInverse,
    );
    const frustum = new THREE.Frustum().setFromProjectionMatrix(projection);
    const eye = new THREE.Vector3().setFromMatrixPosition(camera.matrixWorld);
    const perspective = (camera as Partial<THREE.PerspectiveCamera>).isPerspectiveCamera;
    // at distance 1; everywhere, of parallel rays
    const pixel = 2 / (camera.projectionMatrix.elements[5]! * height);
    const ids: number[] = [];
    this.placed.forEach((placed, object) => {
      if (!placed?.lightmap || !placed.mesh.visible) return;
      const sphere = placed.sphere.clone().applyMatrix4(placed.mesh.matrixWorld);
      if (!frustum.intersectsSphere(sphere)) return;
      const distance = perspective ? Math.max(eye.distanceTo(sphere.center) - sphere.radius, 0) : 1;
      const scale = placed.mesh.matrixWorld.getMaxScaleOnAxis();
      const levels = this.map!.of(object).levels;
      const texels = (placed.texels / scale) * distance * pixel;
      const level = Math.min(levels.length - 1, 2, Math.max(0, Math.floor(Math.log2(Math.max(texels, 1)))));
      const { tilesX, tilesY, firstTile } = levels[level]!;
      const first = this.map!.firstTile[object]! + firstTile;
      for (let tile = 0; tile < tilesX * tilesY && ids.length <= INTEREST_MAX; tile++) ids.push(first + tile);
    });
    const finer = this.survey?.list() ?? [];
    this.pool?.tiles.want(finer);
    // all is wanted where more are listed than a message takes, and then no finer one
    if (ids.length + finer.length <= INTEREST_MAX) ids.push(...finer);
    return Uint32Array.from(ids);
  }
}

/** A sentence of the worker's names the address first. */
function unprefixed(text: string, url: string): string {
  return text.replace(`: ${url}: `, ': ');
}
