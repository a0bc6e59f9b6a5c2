// gpu.ts: small things around WebGL2: programs, textures, answers that are read without waiting for them.
import { LimitError } from './failure.ts';
import { TABLE_WIDTH } from './shader_head.ts';

export type GL = WebGL2RenderingContext;

export class Program {
  private readonly places = new Map<string, WebGLUniformLocation | null>();
  private linked = false;
  private ready = false;

  constructor(
    private readonly gl: GL,
    readonly program: WebGLProgram,
  ) {}

  /** Whether use() need not wait for the compiler. Browsers that do not say so have it wait. It throws where
   * the compiler has failed. */
  isReady(): boolean {
    if (this.ready) return true;
    const { gl, program } = this;
    const parallel = gl.getExtension('KHR_parallel_shader_compile');
    this.ready = !parallel || !!gl.getProgramParameter(program, parallel.COMPLETION_STATUS_KHR);
    if (parallel && this.ready) this.check();
    return this.ready;
  }

  /** Waits for the compiler the first time. */
  use(): void {
    this.check();
    this.gl.useProgram(this.program);
  }

  private check(): void {
    const { gl, program } = this;
    if (!this.linked && !gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      const shaders = gl.getAttachedShaders(program) ?? [];
      const logs = shaders.map((shader) => gl.getShaderInfoLog(shader)).join('\n');
      const what = `the graphics here does not take our shaders: ${gl.getProgramInfoLog(program)} ${logs}`;
      console.error(what);
      throw new LimitError(what);
    }
    this.linked = true;
  }

  at(name: string): WebGLUniformLocation | null {
    let place = this.places.get(name);
    if (place === undefined) {
      place = this.gl.getUniformLocation(this.program, name);
      this.places.set(name, place);
    }
    return place;
  }
}

/** Whether pictures are drawn by the CPU, as far as the browser says. */
export function isSoftware(gl: GL): boolean {
  const names = gl.getExtension('WEBGL_debug_renderer_info');
  const name = String(gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  return /swiftshader|llvmpipe|softpipe|basic render|software/i.test(name);
}

/** The compiler works beside us until the program is used. */
export function createProgram(gl: GL, vertex: string, fragment: string, defines: string[] = []): Program {
  const program = gl.createProgram()!;
  for (const [kind, source] of [
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ] as const) {
    const shader = gl.createShader(kind)!;
    const head = source.indexOf('\n') + 1;
    gl.shaderSource(
      shader,
      source.slice(0, head) + defines.map((name) => `#define ${name}\n`).join('') + source.slice(head),
    );
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    gl.deleteShader(shader);
  }
  gl.linkProgram(program);
  return new Program(gl, program);
}

/** A texture that is read by index, not by place, with a copy in memory. What has changed goes up row by row.
 * */
export class Table<T extends Float32Array | Uint32Array | Uint16Array> {
  readonly texture: WebGLTexture;
  private readonly rows: number;
  private low = Infinity;
  private high = -1;

  constructor(
    private readonly gl: GL,
    private readonly format: [internal: number, format: number, type: number],
    private readonly channels: number,
    count: number,
    make: (length: number) => T,
    readonly values: T = make(0),
  ) {
    this.rows = Math.max(1, Math.ceil(count / TABLE_WIDTH));
    if (this.rows > (gl.getParameter(gl.MAX_TEXTURE_SIZE) as number))
      throw new LimitError('the scene has more parts than the graphics here takes');
    this.values = make(this.rows * TABLE_WIDTH * channels);
    this.texture = gl.createTexture()!;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format[0], TABLE_WIDTH, this.rows);
    nearest(gl, gl.TEXTURE_2D);
    this.low = 0;
    this.high = this.rows - 1;
  }

  /** Element `index` has changed. */
  touch(index: number): void {
    const row = Math.floor(index / TABLE_WIDTH);
    this.low = Math.min(this.low, row);
    this.high = Math.max(this.high, row);
  }

  upload(): void {
    if (this.high < this.low) return;
    const { gl } = this;
    const row = TABLE_WIDTH * this.channels;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    const rows = this.high - this.low + 1;
    const some = this.values.subarray(this.low * row, (this.high + 1) * row);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, this.low, TABLE_WIDTH, rows, this.format[1], this.format[2], some);
    this.low = Infinity;
    this.high = -1;
  }
}

export function nearest(gl: GL, target: number): void {
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
    gl.texParameteri(target, name, gl.NEAREST);
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(target, name, gl.CLAMP_TO_EDGE);
}

/** Whether the GPU has done all that it was told until begin(). */
export class Fence {
  private sync: WebGLSync | null = null;

  constructor(private readonly gl: GL) {}

  begin(): void {
    this.gl.deleteSync(this.sync);
    this.sync = this.gl.fenceSync(this.gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    this.gl.flush();
  }

  busy(): boolean {
    const { gl } = this;
    if (!this.sync) return false;
    const state = gl.clientWaitSync(this.sync, 0, 0);
    if (state === gl.TIMEOUT_EXPIRED) return true;
    gl.deleteSync(this.sync);
    this.sync = null;
    return false;
  }
}

/** Pixels of the bound framebuffer, read once the GPU has them. */
export class LaterPixels {
  private sync: WebGLSync | null = null;
  private buffer: WebGLBuffer | null = null;
  private bytes = 0;

  constructor(private readonly gl: GL) {}

  busy(): boolean {
    return this.sync !== null;
  }

  start(width: number, height: number, format: number, type: number, bytesPerPixel: number): void {
    const { gl } = this;
    this.buffer ??= gl.createBuffer();
    this.bytes = width * height * bytesPerPixel;
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, this.buffer);
    gl.bufferData(gl.PIXEL_PACK_BUFFER, this.bytes, gl.STREAM_READ);
    gl.readPixels(0, 0, width, height, format, type, 0);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
    this.sync = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
  }

  /** null: not yet. */
  take(): ArrayBuffer | null {
    const { gl } = this;
    if (!this.sync) return null;
    const state = gl.clientWaitSync(this.sync, 0, 0);
    if (state !== gl.ALREADY_SIGNALED && state !== gl.CONDITION_SATISFIED) return null;
    gl.deleteSync(this.sync);
    this.sync = null;
    const bytes = new Uint8Array(this.bytes);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, this.buffer);
    gl.getBufferSubData(gl.PIXEL_PACK_BUFFER, 0, bytes);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
    return bytes.buffer;
  }
}
