// finish_maps.ts: what shaders read of finishes: their textures, the lobes' table, the environment as mirrors
// blur it. The GPU gets one thing after another, so that no picture waits long.
import { BLUR, LOBES, LOBES_SIDE, SHRINK, SKIES, SKIES_SIZE } from './finish_shaders.ts';
import { Content, type FinishTexture } from './finishes.ts';
import { createProgram, type GL, nearest, type Program } from './gpu.ts';
import { FINISH_BYTES_MAX } from './limits.ts';
import { SCREEN_VERTEX } from './shaders.ts';

const LOBE_SAMPLES = 1024;
const SKY_SAMPLES = 128;
const MATT = 2; // to the shader, in the place of a mirror's alpha

const channelsOf = (texture: FinishTexture) => (texture.content === Content.NORMAL ? 2 : 4);
/** Of the GPU, with its mip levels. */
const bytesOf = (t: FinishTexture) => (4 / 3) * channelsOf(t) * t.width * t.height;

/** Half as wide and high; a texel is the mean of four. */
export function halved(t: FinishTexture): FinishTexture {
  const channels = channelsOf(t);
  const [width, height] = [Math.max(1, t.width >> 1), Math.max(1, t.height >> 1)];
  const texels = new Uint8Array(channels * width * height);
  const [right, down] = [t.width > 1 ? channels : 0, t.height > 1 ? channels * t.width : 0];
  for (let y = 0, to = 0; y < height; y++)
    for (let x = 0; x < width; x++)
      for (let c = 0; c < channels; c++, to++) {
        const at = channels * ((t.height > 1 ? 2 * y : 0) * t.width + (t.width > 1 ? 2 * x : 0)) + c;
        const upper = t.texels[at]! + t.texels[at + right]!;
        const lower = t.texels[at + down]! + t.texels[at + down + right]!;
        texels[to] = (upper + lower + 2) >> 2;
      }
  return { ...t, width, height, texels };
}

/** The textures as small as the GPU wants them. */
export function fitted(textures: FinishTexture[], sideMax: number, bytesMax: number): FinishTexture[] {
  const fits = (t: FinishTexture): FinishTexture =>
    Math.max(t.width, t.height) > sideMax ? fits(halved(t)) : t;
  let all = textures.map(fits);
  while (all.reduce((sum, t) => sum + bytesOf(t), 0) > bytesMax && all.some((t) => t.width * t.height > 1))
    all = all.map(halved);
  return all;
}

export class FinishMaps {
  readonly textures: WebGLTexture[] = [];
  readonly smooth: WebGLTexture;
  private readonly left: (() => void)[] = []; // to be done
  private readonly programs: Program[] = [];
  private readonly frame: WebGLFramebuffer;
  private shrunk: WebGLTexture | null = null;
  /** What a person should know: that textures are coarser than the file's. */
  readonly note: string = '';

  /** environment: RGB9E5, or null. nothing: to draw a screen with. */
  constructor(
    private readonly gl: GL,
    given: FinishTexture[],
    create: (texture: FinishTexture) => WebGLTexture,
    environment: { texture: WebGLTexture; width: number } | null,
    private readonly nothing: WebGLVertexArrayObject,
  ) {
    const textures = fitted(given, gl.getParameter(gl.MAX_TEXTURE_SIZE) as number, FINISH_BYTES_MAX);
    if (textures.some((texture, i) => texture !== given[i]))
      this.note = 'textures of materials coarser than the file has them';
    const [width, height] = environment ? SKIES_SIZE : [LOBES_SIDE, LOBES_SIDE];
    this.smooth = this.createPicture(width, height, 1, environment ? gl.RGBA16F : gl.RG16F);
    this.frame = gl.createFramebuffer()!;
    this.compute(LOBES, this.smooth, [0, 0, LOBES_SIDE, LOBES_SIDE], (program) =>
      gl.uniform1ui(program.at('count'), LOBE_SAMPLES),
    );
    if (environment) this.blur(environment.texture, environment.width);
    for (const texture of textures) this.left.push(() => this.textures.push(create(texture)));
  }

  private createPicture(width: number, height: number, levels: number, format: number): WebGLTexture {
    const { gl } = this;
    const texture = gl.createTexture()!;
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, levels, format, width, height);
    nearest(gl, gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, levels > 1 ? gl.LINEAR_MIPMAP_LINEAR : gl.LINEAR);
    return texture;
  }

  /** place: of the texture, left, top, width, height. */
  private compute(
    fragment: string,
    into: WebGLTexture,
    place: readonly [number, number, number, number],
    set: (program: Program) => void,
  ): void {
    const { gl } = this;
    const program = createProgram(gl, SCREEN_VERTEX, fragment);
    this.programs.push(program);
    this.left.push(() => {
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, into, 0);
      gl.viewport(...place);
      gl.enable(gl.SCISSOR_TEST); // the triangle is larger
      gl.scissor(...place);
      gl.disable(gl.DEPTH_TEST);
      gl.bindVertexArray(this.nothing);
      program.use();
      set(program);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
      gl.bindVertexArray(null);
      gl.disable(gl.SCISSOR_TEST);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    });
  }

  private blur(environment: WebGLTexture, width: number): void {
    const { gl } = this;
    const [, , wide, high] = SKIES[0];
    const shrunk = this.createPicture(wide, high, Math.log2(wide) + 1, gl.RGBA16F);
    this.shrunk = shrunk;
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.REPEAT);
    const read = (program: Program, texture: WebGLTexture) => {
      gl.activeTexture(gl.TEXTURE0);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.uniform1i(program.at('environment'), 0);
    };
    this.compute(SHRINK, shrunk, [0, 0, wide, high], (program) => {
      read(program, environment);
      gl.uniform1i(program.at('count'), Math.ceil(width / wide));
    });
    SKIES.forEach((place, level) =>
      this.compute(BLUR, this.smooth, place, (program) => {
        read(program, shrunk);
        if (!level) gl.generateMipmap(gl.TEXTURE_2D);
        const roughness = level / (SKIES.length - 2);
        gl.uniform1f(program.at('alpha'), roughness > 1 ? MATT : roughness ** 2);
        gl.uniform4fv(program.at('place'), place);
        gl.uniform1ui(program.at('count'), SKY_SAMPLES);
      }),
    );
  }

  /** Does the next thing. Returns whether all is there. */
  step(): boolean {
    this.left.shift()?.();
    if (this.left.length) return false;
    this.release();
    return true;
  }

  private release(): void {
    const { gl } = this;
    for (const { program } of this.programs.splice(0)) gl.deleteProgram(program);
    gl.deleteTexture(this.shrunk);
    gl.deleteFramebuffer(this.frame);
    this.shrunk = null;
  }

  destroy(): void {
    this.left.length = 0;
    this.release();
    for (const texture of [...this.textures, this.smooth]) this.gl.deleteTexture(texture);
  }
}
