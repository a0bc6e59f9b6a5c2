// main.ts: the page: canvas, keys, legend, messages.
// Parameters of the address: camera=PX,PY,PZ:TX,TY,TZ:FOV, camera-name=NAME, exposure=STOPS,
// tonemap=reinhard|aces|none, server=ws://HOST:PORT/ws (default: ws beside the page),
// direct=auto|tiles|pixels.
// Behind #: token=DIGITS (access.ts).
import { askForToken, findToken, showSliders } from './access.ts';
import { serverAddress } from './address.ts';
import { Attention } from './attention.ts';
import { Flight, formatView, frameBox, parseView, type Vec3, viewOf } from './camera.ts';
import { LimitError } from './failure.ts';
import { isSoftware } from './gpu.ts';
import type { Box } from './lights.ts';
import type { CameraPlace, FromWorker, ToWorker } from './protocol.ts';
import { type Curve, Renderer, SAMPLES_STILL, SHOWN } from './renderer.ts';
import type { TileBatch } from './replica.ts';
import { lightingText } from './waiting.ts';
import type { Waiting } from './wire.ts';

const UPLOAD_MS = 3; // of each picture's time, for tiles
const SURVEY_MS = 100;
const SURVEY_STILL_MS = 1000; // while nothing moves
const STILL_MS = 3000;
const REFINE_MS = 200; // after the view has moved, its pictures get better
const LEGEND_MS = 500;
const PIXEL_RATIO_MAX = 2;
const UPLOADS_KEPT = 1000;
const ADAPTATION_MS = 400; // of the exposure
const METER_MS = 250;
const ADAPT_FROM = 0.1; // stops: a smaller picture of the same view, or a sharper one, is metered alike
/** Pictures that take longer are slow: light comes in tiles alone after SLOW_PICTURES of them, or
 * SLOW_SUM_MS. */
const SLOW_MS = 100;
const SLOW_PICTURES = 3;
const SLOW_SUM_MS = 2000;
/** A slow GPU draws smaller pictures, of SMALL_MS each, and whole ones of a still view if they take under
 * WHOLE_MS. */
const SMALL_MS = 150;
const WHOLE_MS = 1000;
const SHARE_MIN = 0.25; // of width and height

const HELP = `Drag or one finger: look. Wheel or two fingers: move.
W A S D, E Q: fly; Shift: faster. 1 to 9: cameras. 0: all of it.
+ and -: exposure; X: automatic. T: tone curve. V: light, normals, roughness,
metalness. P: save picture. H: this text.`;

/** Where direct light comes from: tiles, or lights that the page draws at pixels; auto: at pixels, if that is
 * fast enough. */
type Direct = 'auto' | 'tiles' | 'pixels';

const element = (id: string) => document.getElementById(id)!;

class App {
  private readonly worker = new Worker('worker.js', { type: 'module' });
  private readonly canvas = document.querySelector('canvas')!;
  private readonly parameters = new URLSearchParams(location.search);
  private readonly flight = new Flight(this.canvas, (key) => this.onKey(key));
  private readonly camera = element('camera') as HTMLSelectElement;
  private gl: WebGL2RenderingContext | null = null;
  private renderer: Renderer | null = null;
  private cameras: CameraPlace[] = [];
  private body: Box | null = null;
  private queue: { batch: TileBatch; at: number; texel: number }[] = [];
  private attention = new Attention();
  private framed = false; // the view has been chosen
  private keepsView = false; // the next scene is the same one
  private dirty = true;
  private samples = 0; // that the picture is the mean of
  private movedMs = 0;
  private surveyedMs = 0;
  private meteredMs = 0;
  private steppedMs = 0;
  private beganMs = 0; // the picture that the GPU draws; 0: none
  private slow = { count: 0, sumMs: 0 }; // pictures, one after another
  private share = 1; // of width and height that pictures have while things change
  private stillShare = 1; // that all pictures of a still view have
  private owesLook = false; // a picture was drawn since the last look
  private drawnShare = 1; // that the last one has
  private wholeMs = 0; // that a whole picture takes
  private direct: Direct = 'auto';
  private tilesWhy = ''; // all light comes in tiles
  private readonly still = matchMedia('(prefers-reduced-motion: reduce)');
  private drawn = 0; // pictures since the last legend
  private legendMs = 0;
  private legendBytes = 0;
  private bytes = 0;
  private waiting = 0;
  private frameMs = 0;
  private solveMs = 0;
  private timeS = 0;
  private autoExposure = true;
  private adapting = false;
  private stopsWanted: number | null = null;
  private progress = 0;
  private wait: Waiting | null = null; // why there is no light yet; null: nobody has said, or there is
  private help = true;
  private state = ''; // of the connection, mostly
  private failure = '';
  /** For tests and the curious. */
  readonly stats = {
    frames: 0,
    frame: 0, // the last one's number
    tiles: 0,
    settled: 0,
    first: false,
    uploadMs: [] as number[], // of the last pictures into which tiles were taken
    decoderBytes: 0, // of memory
    finishes: 0, // sets of them that pictures show
    surveys: 0,
    interest: 0,
    missing: 0,
    pictures: 0,
    slowestMs: 0, // picture of the GPU
    // ms since the page was opened: scene there, first light drawn, all of the view's light drawn
    sceneMs: 0,
    firstMs: 0,
    allMs: 0,
  };

  constructor() {
    const exposure = this.parameters.get('exposure');
    if (exposure !== null && exposure !== 'auto') this.autoExposure = false;
    this.worker.onmessage = (event: MessageEvent<FromWorker>) => this.take(event.data);
    this.worker.onerror = (event) => this.fail(`worker.js: ${event.message || 'it does not load'}`);
    this.canvas.addEventListener('webglcontextlost', (event) => {
      event.preventDefault();
      this.renderer = null;
      this.gl = null;
      this.showMessage();
    });
    this.canvas.addEventListener('webglcontextrestored', () => {
      this.queue = [];
      this.keepsView = true;
      this.openGraphics();
      this.tell({ kind: 'lost' });
    });
    document.addEventListener('visibilitychange', () => {
      this.beganMs = 0; // a hidden page draws nothing
      this.tell({ kind: 'pause', paused: document.hidden });
    });
    // hints are for keys, and cover much of a small window
    this.canvas.addEventListener('pointerdown', (event) => {
      if (event.pointerType !== 'touch' || !this.help) return;
      this.help = false;
      this.showMessage();
    });
    for (const button of element('tools').querySelectorAll('button'))
      button.addEventListener('click', () => this.onKey(button.value));
    let pointed = false; // keys are to fly again once a finger or the mouse has chosen
    this.camera.addEventListener('pointerdown', () => (pointed = true));
    this.camera.addEventListener('change', () => {
      this.onKey(this.camera.value);
      if (pointed) this.canvas.focus();
      pointed = false;
    });
    window.addEventListener('resize', () => (this.dirty = true));
    if (!this.openGraphics()) return;
    const server = serverAddress(new URL(location.href), this.parameters.get('server'));
    if ('problem' in server) {
      this.fail(server.problem);
      return;
    }
    const { url } = server;
    const direct = this.parameters.get('direct');
    if (direct === 'tiles' || direct === 'pixels') this.direct = direct;
    if (this.direct === 'auto' && isSoftware(this.gl!)) {
      this.direct = 'tiles';
      this.tilesWhy = 'drawn without a GPU: all light in tiles';
      this.share = SHARE_MIN;
    }
    const draws = this.direct !== 'tiles';
    const token = findToken();
    if (token) this.tell({ kind: 'token', token });
    this.tell({ kind: 'connect', url, draws, clusters: draws });
    requestAnimationFrame((now) => this.step(now));
    this.showMessage();
  }

  private tell(message: ToWorker, transfer: Transferable[] = []): void {
    this.worker.postMessage(message, transfer);
  }

  private fail(text: string): void {
    this.failure = text;
    this.showMessage();
  }

  private openGraphics(): boolean {
    this.gl = this.canvas.getContext('webgl2', {
      alpha: false,
      antialias: false,
      powerPreference: 'high-performance',
    });
    if (!this.gl)
      this.fail(
        'This browser shows no WebGL2, which the picture needs. ' +
          'It may be switched off, or the graphics driver may be too old.',
      );
    return !!this.gl;
  }

  // ---- what comes from the worker ----

  private take(message: FromWorker): void {
    if (message.kind === 'traffic') {
      this.bytes = message.bytes;
      this.waiting = message.waiting;
      this.stats.decoderBytes = message.memory;
    } else if (message.kind === 'state') {
      if (message.final) this.failure = message.text;
      this.state = message.text;
      this.showMessage();
    } else if (message.kind === 'progress') {
      this.progress = message.fraction;
      this.showMessage();
    } else if (message.kind === 'token') {
      const form = element('token') as HTMLFormElement;
      askForToken(form, (token) => this.tell({ kind: 'token', token }));
    } else if (message.kind === 'lamps')
      showSliders(element('lamps'), message.names, (lamp, factor) =>
        this.tell({ kind: 'dim', lamp, factor }),
      );
    else if (message.kind === 'scene') this.takeScene(message);
    else if (message.kind === 'finishes') this.renderer?.takeFinishes(message.data);
    else if (message.kind === 'camera') this.goTo(message.place);
    else if (message.kind === 'clusters') this.renderer?.takeClusters(message.clusters);
    else if (message.kind === 'frame') {
      this.renderer?.takeFrame(message.frame, message.visible);
      this.frameMs = performance.now();
      this.solveMs = message.frame.solveNs / 1e6;
      this.timeS = message.frame.timeS;
      this.stats.frames++;
      this.wait = null;
      this.showWait();
      this.stats.frame = Number(message.frame.frame);
      this.dirty = true;
    } else if (message.kind === 'tiles') {
      if (message.visible) this.renderer?.setVisible(message.visible);
      this.renderer?.setMean(message.mean);
      this.stats.first ||= message.first;
      this.queue.push({ batch: message.batch, at: 0, texel: 0 });
    } else if (message.kind === 'waiting') {
      this.wait = message.waiting;
      this.state = ''; // the server is there
      this.showMessage();
    } else this.stats.settled = this.stats.frames;
  }

  private takeScene(message: Extract<FromWorker, { kind: 'scene' }>): void {
    if (!this.gl) return;
    this.queue = [];
    this.cameras = message.cameras;
    this.body = message.body;
    try {
      const before = this.renderer;
      const { draws, clientLights: lights, clusters, finer, directed } = message;
      const drawn = draws ? { lights, clusters } : null;
      this.renderer = new Renderer(this.gl, message.data, drawn, this.direct === 'tiles', finer, directed);
      before?.destroy();
    } catch (error) {
      if (!(error instanceof LimitError)) throw error;
      this.renderer = null;
      this.fail(error.message);
      return;
    }
    this.renderer.stops = Number(this.parameters.get('exposure')) || 0;
    const curve = this.parameters.get('tonemap');
    if (curve === 'aces' || curve === 'none') this.renderer.curve = curve;
    this.attention = new Attention();
    this.framed &&= this.keepsView;
    this.keepsView = false;
    this.stopsWanted = null;
    this.beganMs = 0;
    this.dirty = true;
    const options = [...message.cameras.slice(0, 9).map(({ name }) => name || 'nameless'), 'All of it'];
    this.camera.replaceChildren(...options.map((name, i) => new Option(name, `${(i + 1) % options.length}`)));
    this.camera.selectedIndex = -1;
    this.stats.sceneMs ||= performance.now();
    document.title = `${message.data.name || 'scene'} – lightwell`;
    this.showMessage();
  }

  // ---- the view ----

  /** Once there is a frame: where the address says, the scene's camera, or around all of it. */
  private frameView(): void {
    const box = this.renderer!.bounds();
    if (!box) return;
    this.framed = true;
    const size = Math.hypot(...box.high.map((x, i) => x - box.low[i]!));
    this.flight.speed = size / 15;
    const given = this.parameters.get('camera');
    const view = given !== null && parseView(given);
    if (view) return this.flight.go(view);
    if (given !== null) this.state = `camera=${given}: it is not PX,PY,PZ:TX,TY,TZ:FOV`;
    const name = this.parameters.get('camera-name');
    const index = name === null ? 0 : this.cameras.findIndex((camera) => camera.name === name);
    if (index < 0) this.state = `camera-name=${name}: the scene has no such camera`;
    if (this.state) this.showMessage();
    if (this.cameras[index]) this.goToCamera(index);
    else this.goAround(this.body);
  }

  private goToCamera(index: number): void {
    this.camera.value = `${index + 1}`;
    this.tell({ kind: 'camera', index, timeS: this.timeS });
  }

  /** body: what to show of the scene; null: all of it. */
  private goAround(body: Box | null): void {
    const box = this.renderer?.bounds();
    if (!box) return;
    const low = box.low.map((x, k) => Math.max(x, body?.low[k as 0] ?? x)) as Vec3;
    const high = box.high.map((x, k) => Math.min(x, body?.high[k as 0] ?? x)) as Vec3;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.camera.value = body ? '' : '0';
    this.flight.go(frameBox(low, high, Math.max(1, width) / Math.max(1, height)));
  }

  private goTo(place: CameraPlace): void {
    this.flight.go(viewOf(place.toWorld, place.fovY, place.height));
  }

  private onKey(key: string): void {
    const { renderer } = this;
    if (!renderer) return;
    if (key >= '1' && key <= '9' && this.cameras[Number(key) - 1]) this.goToCamera(Number(key) - 1);
    else if (key === '0') this.goAround(null);
    else if (key === '+' || key === '-' || key === '=') {
      this.autoExposure = false;
      renderer.stops += key === '-' ? -0.25 : 0.25;
    } else if (key === 'x') this.autoExposure = true;
    else if (key === 't')
      renderer.curve = ({ reinhard: 'aces', aces: 'none', none: 'reinhard' } as const)[renderer.curve];
    else if (key === 'v') renderer.showNext();
    else if (key === 'h') this.help = !this.help;
    else if (key === 'p') this.savePicture();
    else return;
    this.dirty = true;
    this.showMessage();
  }

  private savePicture(): void {
    this.finish();
    this.canvas.toBlob((blob) => {
      if (!blob) return;
      const link = document.createElement('a');
      link.href = URL.createObjectURL(blob);
      link.download = 'lightwell.png';
      link.click();
      URL.revokeObjectURL(link.href);
    });
  }

  // ---- one picture after another ----

  private step(now: number): void {
    requestAnimationFrame((next) => this.step(next));
    const seconds = (now - this.steppedMs) / 1000;
    this.steppedMs = now;
    if (!this.renderer || !this.gl || this.gl.isContextLost()) return;
    try {
      this.show(now, seconds);
    } catch (error) {
      if (!(error instanceof LimitError)) throw error;
      this.renderer = null;
      this.fail(error.message);
    }
    if (now - this.legendMs >= LEGEND_MS) this.showLegend(now);
  }

  private show(now: number, seconds: number): void {
    const renderer = this.renderer!;
    if (!this.framed && this.stats.frames) this.frameView();
    if (this.flight.step(now)) {
      this.dirty = true;
      this.movedMs = now;
    }
    this.takeTiles();
    this.dirty = renderer.fade(now) || this.dirty;
    this.bring(renderer);
    // one picture at a time: a slow GPU would only fall behind
    if (!renderer.isDrawable() || renderer.busy()) return;
    // by the clock, for `now` may be of before the picture began
    if (this.beganMs) this.judgePicture(Math.max(1, performance.now() - this.beganMs));
    this.adapt(now, seconds);
    const still = now - this.movedMs > REFINE_MS && this.samples <= SAMPLES_STILL;
    const wanted = (this.dirty || still) && this.framed;
    // a slow GPU gets either at a time
    if (wanted && !(this.share < 1 && this.owesLook)) {
      this.owesLook = true;
      this.beganMs = performance.now();
      this.draw();
      if (this.share < 1) return;
    }
    this.owesLook = false;
    this.look(now);
  }

  private bring(renderer: Renderer): void {
    if (!renderer.bringFinishes()) return;
    this.dirty = true;
    this.stats.finishes++;
  }

  /** ms: that the GPU took for a picture. */
  private judgePicture(ms: number): void {
    this.beganMs = 0;
    this.stats.slowestMs = Math.max(this.stats.slowestMs, ms);
    this.wholeMs = ms / this.drawnShare ** 2;
    if (this.direct === 'tiles') {
      // in steps, for each other size takes other textures
      const share = 2 ** (Math.round(Math.log2(SMALL_MS / this.wholeMs)) / 2);
      this.share = Math.min(1, Math.max(SHARE_MIN, share));
    }
    if (this.direct !== 'auto' || !this.renderer?.lightsDrawn().lights) return;
    const { count, sumMs } = this.slow;
    this.slow = ms > SLOW_MS ? { count: count + 1, sumMs: sumMs + ms } : { count: 0, sumMs: 0 };
    if (this.slow.count < SLOW_PICTURES && this.slow.sumMs < SLOW_SUM_MS) return;
    this.direct = 'tiles';
    this.tilesWhy = 'a slow GPU: all light in tiles';
    this.keepsView = true;
    this.tell({ kind: 'tiles' });
  }

  private draw(): void {
    if (this.dirty) this.samples = 0;
    if (this.samples === 1) this.stillShare = this.wholeMs < WHOLE_MS ? 1 : this.share;
    this.drawPicture(this.samples ? this.stillShare : this.share);
  }

  private drawPicture(share: number): void {
    const ratio = Math.min(devicePixelRatio, PIXEL_RATIO_MAX);
    const width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
      this.dirty = true;
    }
    if (this.dirty) this.samples = 0;
    this.drawnShare = share;
    this.renderer?.draw(this.flight.view, width, height, this.samples++, share);
    this.dirty = !!this.renderer?.lightsPending();
    if (this.samples > 1) return;
    this.drawn++;
    this.stats.pictures++;
    const { stats } = this;
    if (!stats.tiles || stats.firstMs) return;
    stats.firstMs = performance.now();
    this.showWait();
  }

  /** Draws the current view on the canvas, with all samples of a still picture. */
  finish(): void {
    const { renderer } = this;
    if (!renderer) return;
    renderer.waits = true;
    while (renderer.bringing()) this.bring(renderer);
    this.dirty = renderer.fade(Infinity) || this.dirty;
    this.dirty ||= this.stillShare < 1;
    this.stillShare = 1;
    do this.drawPicture(1);
    while (this.dirty || this.samples <= SAMPLES_STILL);
    renderer.waits = false;
  }

  private takeTiles(): void {
    const begin = performance.now();
    let taken = 0;
    while (this.queue.length && performance.now() < begin + UPLOAD_MS) {
      const first = this.queue[0]!;
      this.dirty ||= first.batch.directions.length > 0;
      const [at, texel] = this.renderer!.takeTiles(first.batch, first.at, first.texel, begin + UPLOAD_MS);
      taken += at - first.at;
      first.at = at;
      first.texel = texel;
      if (at === first.batch.id.length) this.queue.shift();
    }
    if (!taken) return;
    this.stats.tiles += taken;
    this.stats.uploadMs.push(performance.now() - begin);
    if (this.stats.uploadMs.length > UPLOADS_KEPT) this.stats.uploadMs.shift();
    this.tell({ kind: 'taken', count: taken });
    this.dirty = true;
  }

  private adapt(now: number, seconds: number): void {
    const { renderer } = this;
    if (!renderer || !this.autoExposure || !this.stats.first) return;
    if (now - this.meteredMs >= METER_MS) {
      const stops = renderer.meter();
      if (stops !== null) {
        if (this.stopsWanted === null) {
          renderer.stops = stops;
          this.dirty = true;
        }
        this.stopsWanted = stops;
        this.meteredMs = now;
      }
    }
    const way = (this.stopsWanted ?? renderer.stops) - renderer.stops;
    this.adapting = Math.abs(way) > (this.adapting ? 0.02 : ADAPT_FROM);
    if (!this.adapting) return;
    renderer.stops += way * (this.still.matches ? 1 : 1 - Math.exp((-1000 * seconds) / ADAPTATION_MS));
    this.dirty = true;
  }

  /** Says what the view needs. */
  private look(now: number): void {
    const { renderer, canvas } = this;
    if (!renderer || !this.framed) return;
    const found = renderer.takeSurvey();
    if (found) {
      const ids = this.attention.list(found, now, this.movedMs);
      this.stats.surveys++;
      this.stats.interest = ids.length;
      this.stats.missing = ids.reduce((count, id) => count + (renderer.hasTile(id) ? 0 : 1), 0);
      if (!this.stats.missing && this.stats.tiles && !this.dirty) this.stats.allMs ||= now;
      renderer.want(ids);
      this.tell({ kind: 'interest', ids: ids as Uint32Array<ArrayBuffer> });
    }
    const still = now - this.movedMs > STILL_MS;
    if (now - this.surveyedMs < (still ? SURVEY_STILL_MS : SURVEY_MS) || document.hidden) return;
    this.surveyedMs = now;
    renderer.beginSurvey(this.flight.view, canvas.width, canvas.height);
  }

  // ---- what it says ----

  private showLegend(now: number): void {
    const seconds = (now - this.legendMs) / 1000;
    const rate = ((this.bytes - this.legendBytes) * 8) / 1000 / seconds;
    const age = Math.max(0, now - this.frameMs + this.solveMs) / 1000; // a picture may be older than a frame
    const { frames, settled, missing } = this.stats;
    const finer = this.samples <= SAMPLES_STILL;
    const parts: string[] = [];
    const show = this.renderer?.show ?? SHOWN[0];
    if (show !== SHOWN[0]) parts.push(show);
    if (this.drawn) parts.push(`${Math.round(this.drawn / seconds)} pictures/s`);
    else if (this.stats.pictures) parts.push(finer ? 'smoothing edges' : 'picture complete');
    const here = !this.state && !this.wait; // the server, and its light
    if (here && frames && settled === frames && !missing) parts.push('light complete');
    else if (frames)
      parts.push(age < 10 ? `light ${age.toFixed(1)} s old` : `no new light for ${Math.round(age)} s`);
    if (missing && here) parts.push(`${missing} tiles of light on their way`);
    const { coarse = '', note = '' } = this.renderer ?? {};
    for (const text of [this.tilesWhy, coarse, note]) if (text) parts.push(text);
    parts.push(`${Math.round(rate)} kbit/s`);
    if (this.waiting > 1e6) parts.push(`${(this.waiting / 1e6).toFixed(1)} MB to decode`);
    element('legend').textContent = this.renderer ? parts.join(' · ') : '';
    this.legendMs = now;
    this.legendBytes = this.bytes;
    this.drawn = 0;
  }

  private showMessage(): void {
    const lost = this.gl ? '' : 'The graphics context is lost; waiting for it to come back';
    const text = this.failure || lost || this.state;
    // what has not changed is not read out again
    if (element('message').textContent !== text) element('message').textContent = text;
    this.showWait();
    const usable = this.renderer && !this.failure;
    element('help').textContent = this.help && usable ? HELP : '';
    element('tools').hidden = !usable;
    element('auto').setAttribute('aria-pressed', `${this.autoExposure}`);
  }

  /** What is waited for, where nothing else is to be said, and how much of it is done. */
  private waitingFor(): [text: string, share: number] {
    if (element('message').textContent) return ['', 0];
    if (!this.renderer && this.progress)
      return this.progress < 1
        ? [`Receiving the scene: ${Math.round(100 * this.progress)} %`, this.progress]
        : ['Preparing the scene', 1];
    if (this.wait || (this.renderer && !this.stats.frames))
      return [lightingText(this.wait), this.wait?.share ?? 0];
    if (!this.renderer) return ['Connecting', 0];
    return this.stats.firstMs ? ['', 0] : ['Drawing the first picture', 1];
  }

  /** Text for people, and a progress bar for who hears the page. */
  private showWait(): void {
    const bar = element('wait');
    const [text, share] = this.waitingFor();
    if (bar.textContent === text) return;
    bar.textContent = text;
    bar.setAttribute('aria-valuetext', text);
    bar.setAttribute('aria-valuenow', `${Math.round(100 * share)}`);
  }

  // ---- for tests ----

  setCurve(curve: Curve): void {
    if (this.renderer) this.renderer.curve = curve;
  }

  exposure(): number {
    return this.renderer?.stops ?? 0;
  }

  lightsDrawn(): { lights: number; maps: number } {
    return this.renderer?.lightsDrawn() ?? { lights: 0, maps: 0 };
  }

  go(view: string): void {
    const parsed = parseView(view);
    if (parsed) this.flight.go(parsed);
  }

  view(): string {
    return formatView(this.flight.view);
  }

  message(): string {
    return element('message').textContent ?? '';
  }

  loseContext(): { restore(): void } {
    const extension = this.gl!.getExtension('WEBGL_lose_context')!;
    extension.loseContext();
    return { restore: () => extension.restoreContext() };
  }
}

(globalThis as unknown as { lightwell: App }).lightwell = new App();
