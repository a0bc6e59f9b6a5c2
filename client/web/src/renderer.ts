// renderer.ts: draws the scene in the light that has come.
// Flow: geometry, frames, tiles -> [renderer] -> picture on the canvas; tiles that the view needs
import { AtlasMap } from './atlas.ts';
import { add, dot, scaleOf, type Vec3, type View } from './camera.ts';
import type { Cluster } from './clusters.ts';
import { autoStops } from './exposure.ts';
import { LimitError } from './failure.ts';
import { FinishMaps } from './finish_maps.ts';
import { FinerTiles, SLOT_SIDE, SLOTS_MAX } from './finer.ts';
import { Content, type FinishTexture } from './finishes.ts';
import {
  FINISH_TEXELS,
  type Group,
  IN_SURFACE,
  isBlended,
  MATERIAL_TEXELS,
  type SceneData,
} from './geometry.ts';
import { createProgram, Fence, type GL, LaterPixels, nearest, type Program, Table } from './gpu.ts';
import { type Box, Lights, type ShadowMap } from './lights.ts';
import { LAMP_SIDE, SUN_SIDE } from './limits.ts';
import { AlphaMode, NONE } from './package.ts';
import { BYTES_MAX, layOut, type Pages } from './pages.ts';
import { type DirectionTile, GONE, type TileBatch } from './replica.ts';
import {
  Attribute,
  COPY_FRAGMENT,
  METER_FRAGMENT,
  OBJECT_TEXELS,
  SCREEN_VERTEX,
  SKY_FRAGMENT,
  SURFACE_FRAGMENT,
  SURFACE_VERTEX,
  TONEMAP_FRAGMENT,
} from './shaders.ts';
import type { Frame } from './wire.ts';

const SURVEY_MARGIN = 1.4; // a survey's picture is wider and higher than the view by this factor
const SURVEY_SIDE = 192; // pixels of its longer side
const SPHERE = 5; // numbers for each object
const METER_WIDTH = 128;
const METER_HEIGHT = 72;
const SAMPLES = 4;
/** Pictures that are added to a still one, each through other places of the pixels. */
export const SAMPLES_STILL = 16;
/** Their textures are read at finer mip levels, by this many. */
const SHARPER = -3;
/** Of textures, where the GPU is fast. */
const ANISOTROPY = 8;
/** Share of the mean light from which on a lamp is drawn on an object. */
const FAINT = 2e-3;
/** Highlights are seen of lamps that are fainter by this. */
const FAINT_SHARE = 0.1;
/** Places on a disc at which shadow maps are read: a spiral, every second one as far out as all of them. */
const TAPS = Float32Array.from({ length: 32 }, (_, i) => {
  const [tap, radius] = [i >> 1, Math.sqrt(((i >> 1) + 0.5) / 16)];
  return radius * (i & 1 ? Math.sin : Math.cos)(2.399963 * tap);
});

export type Curve = 'reinhard' | 'aces' | 'none';
const CURVES: Curve[] = ['reinhard', 'aces', 'none'];

/** What pictures show: light, or what materials say. By the shader's numbers. */
export const SHOWN = ['light', 'normals', 'roughness', 'metalness'] as const;
/** What of a finish has a texture, in the order of FinishPlace: by the shader's names. */
const FINISH_TEXTURES = ['surface', 'specular', 'occlusion', 'normal'];

/** Tiles that a view needs: in the picture, and around it. */
export interface Survey {
  inPicture: Uint32Array;
  around: Uint32Array;
}

/** Where sample 1 to SAMPLES_STILL lies in the pixel, from its centre: as lw_antialias_offset() of
 * client/view/compose/antialias.h. Sample 0 is the centre. */
function placeOf(sample: number): [number, number] {
  if (!sample) return [0, 0];
  const index = sample - 1;
  const reversed = [0, 1, 2, 3].reduce((sum, bit) => sum + (((index >> bit) & 1) << (3 - bit)), 0);
  return [(index + 0.5) / SAMPLES_STILL - 0.5, (reversed + 0.5) / SAMPLES_STILL - 0.5];
}

interface Draw {
  mesh: number;
  group: Group;
  defines: string[]; // of its programs
  finish: string[]; // likewise, where light is seen
  programs: Map<string, Program>; // by what is defined besides
}

/** A scene's surfaces as they are drawn. */
interface Surfaces {
  vertices: WebGLVertexArrayObject;
  buffers: WebGLBuffer[];
  draws: Draw[];
}

/** Those with finishes, until the GPU has all of them. */
interface Next {
  data: SceneData;
  maps: FinishMaps;
  surfaces: Surfaces | null;
  programs: Map<string, Program>;
}

/** Pixels to draw into. */
interface Target {
  width: number;
  height: number;
  framebuffer: WebGLFramebuffer; // to draw into
  resolved: WebGLFramebuffer;
  picture: WebGLTexture; // of resolved
  owned: (() => void)[];
}

const keyOf = (defines: string[], fragment: string) => `${defines.join()} ${fragment}`;

const emptyBox = (): Box => ({
  low: [Infinity, Infinity, Infinity],
  high: [-Infinity, -Infinity, -Infinity],
});

function widen(box: Box, by: Box): void {
  for (const i of [0, 1, 2] as const) {
    box.low[i] = Math.min(box.low[i], by.low[i]);
    box.high[i] = Math.max(box.high[i], by.high[i]);
  }
}

export class Renderer {
  private readonly programs = new Map<string, Program>();
  private readonly later = new Map<string, string[]>(); // programs that are still to be made
  private drawable = false; // all programs of the first picture are there
  private readonly fence: Fence;
  private readonly objects: Table<Float32Array>;
  private readonly materials: Table<Float32Array>;
  private readonly levels: Table<Uint32Array>;
  private readonly tileState: Table<Uint16Array>;
  private readonly map: AtlasMap;
  private readonly pages: Pages;
  private readonly finer: FinerTiles;
  private readonly pageTexture: WebGLTexture;
  private readonly directions: number; // layers from light to where it comes from; 0: that is not known
  private readonly textures: WebGLTexture[];
  private readonly environment: WebGLTexture | null;
  private readonly white: WebGLTexture;
  private readonly nothing: WebGLVertexArrayObject;
  private readonly instances: WebGLBuffer;
  private surfaces: Surfaces;
  private maps: FinishMaps | null = null;
  private next: Next | null = null;
  private readonly objectsOf: number[][]; // by mesh
  private readonly visible: Uint8Array;
  private readonly sphere: Float32Array; // by object, world space: centre, radius, 1 if it is mirrored
  private readonly surveyPixels: LaterPixels;
  private readonly meterPixels: LaterPixels;
  private readonly reversed: boolean;
  private readonly samples: number;
  private target: Target | null = null;
  private single: Target | null = null; // without samples beside each other
  private average: Target | null = null; // of those
  private shown: Target | null = null;
  private surveyTarget: Target | null = null;
  private meterTarget: Target | null = null;
  private sky: ArrayLike<number> = [0, 0, 0];
  private mean: [number, number, number] = [Math.PI, Math.PI, Math.PI];
  private box: Box | null | undefined; // undefined: to be found
  private surveyNumber = 0;
  private meteredExposure = 1;
  private readonly lights: Lights | null;
  stops = 0;
  curve: Curve = 'reinhard';
  unfiltered = false;
  waits = false; // for the compiler
  show: (typeof SHOWN)[number] = 'light';
  note = ''; // what a person should know of finishes
  readonly coarse: string; // the same of lightmaps

  constructor(
    private readonly gl: GL,
    private data: SceneData,
    drawn: { lights: Uint8Array; clusters: number } | null,
    private readonly slow = false, // the GPU: pictures of one sample each
    finer = 0, // levels that are finer than level 0, at most
    directed = false, // it is known where light comes from
  ) {
    if (!gl.getExtension('EXT_color_buffer_float') && !gl.getExtension('EXT_color_buffer_half_float'))
      throw new LimitError('the graphics here cannot draw into 16-bit floats');
    const clip = gl.getExtension('EXT_clip_control') as {
      clipControlEXT(origin: number, depth: number): void;
    } | null;
    this.reversed = !!clip;
    clip?.clipControlEXT(0x8ca1, 0x935f); // LOWER_LEFT, ZERO_TO_ONE
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);

    const objects = data.objectMesh.length;
    this.map = new AtlasMap(data.meshes, data.objectMesh, finer);
    const sideMax = Math.min(gl.getParameter(gl.MAX_TEXTURE_SIZE) as number, 8192);
    const layersMax = gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS) as number;
    this.pages = layOut(this.map, objects, sideMax, layersMax, this.map.finer && SLOTS_MAX);
    this.coarse = this.pages.finest ? 'lightmaps are too large for this page: coarser ones are shown' : '';
    const { width, height, layers } = this.pages;
    const hasRoom = 2 * layers <= layersMax && 8 * width * height * layers <= BYTES_MAX;
    this.directions = directed && hasRoom ? layers : 0;
    this.pageTexture = this.createPages(layers + this.directions);
    const floats = (length: number) => new Float32Array(length);
    const rgba32f: [number, number, number] = [gl.RGBA32F, gl.RGBA, gl.FLOAT];
    this.objects = new Table(gl, rgba32f, 4, OBJECT_TEXELS * objects, floats);
    this.materials = new Table(gl, rgba32f, 4, data.materials.length / 4, floats);
    this.materials.values.set(data.materials);
    const ints = (length: number) => new Uint32Array(length);
    this.levels = new Table(
      gl,
      [gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT],
      4,
      this.pages.level.length / 4,
      ints,
    );
    this.levels.values.set(this.pages.level);
    this.tileState = new Table(
      gl,
      [gl.R16UI, gl.RED_INTEGER, gl.UNSIGNED_SHORT],
      1,
      this.map.tileCount,
      (length) => new Uint16Array(length),
    );
    const first = this.pages.levelFirst[objects]!;
    this.finer = new FinerTiles(
      this.map,
      this.pages.slots,
      (slot, texels, directions) =>
        this.write(first + slot, 0, 0, SLOT_SIDE, SLOT_SIDE, texels, directions ? this.directions : 0),
      (id, entry) => this.setState(id, entry),
    );
    this.visible = new Uint8Array(objects);
    this.sphere = new Float32Array(SPHERE * objects);
    this.objectsOf = data.meshes.map(() => []);
    data.objectMesh.forEach((mesh, object) => {
      this.objectsOf[mesh]!.push(object);
      const first = this.pages.levelFirst[object]!;
      const at = 4 * (OBJECT_TEXELS * object + 3);
      this.objects.values.set(
        [
          first,
          this.pages.levelFirst[object + 1]! - first,
          data.meshes[mesh]!.backOffset,
          this.map.firstFiner[object]!,
        ],
        at,
      );
    });

    const lights = drawn && new Lights(gl, data.lights, drawn.lights, drawn.clusters, this.reversed);
    this.lights = lights?.count() ? lights : null;
    if (!this.lights) lights?.destroy();
    this.white = this.createTexture({
      width: 1,
      height: 1,
      rgba: new Uint8Array(4).fill(255),
      wrapS: 0,
      wrapT: 0,
    });
    this.textures = data.textures.map((texture) => this.createTexture(texture));
    this.environment = data.environment && this.createEnvironment(data.environment);
    this.instances = gl.createBuffer()!;
    this.nothing = gl.createVertexArray()!;
    this.surfaces = this.createSurfaces(data);
    const most = gl.getInternalformatParameter(gl.RENDERBUFFER, gl.RGBA16F, gl.SAMPLES) as Int32Array;
    this.samples = slow ? 1 : Math.min(SAMPLES, most[0] ?? 1);
    for (const fragment of [SKY_FRAGMENT, TONEMAP_FRAGMENT, METER_FRAGMENT])
      this.programOf(SCREEN_VERTEX, fragment, []);
    for (const extra of ['', 'SURVEY'])
      for (const draw of this.surfaces.draws)
        this.programOf(SURFACE_VERTEX, SURFACE_FRAGMENT, this.definesWith(draw, extra));
    // the compiler gets those of direct light with the first pictures
    if (this.lights)
      for (const extra of ['SHADOW', 'DEPTH', 'DIRECT'])
        for (const draw of this.surfaces.draws) {
          const defines = this.definesWith(draw, extra);
          this.later.set(defines.join(), defines);
        }
    this.fence = new Fence(gl);
    this.surveyPixels = new LaterPixels(gl);
    this.meterPixels = new LaterPixels(gl);
    if (gl.getError() === gl.OUT_OF_MEMORY)
      throw new LimitError('the graphics here has no memory for the scene');
    // the largest is on the GPU now
    this.keepBlended();
  }

  /** Frees the GPU's memory; call nothing afterwards. */
  destroy(): void {
    const { gl } = this;
    for (const target of [this.target, this.single, this.average, this.surveyTarget, this.meterTarget])
      for (const release of target?.owned ?? []) release();
    const tables = [this.objects, this.materials, this.levels, this.tileState].map((table) => table.texture);
    for (const texture of [...tables, ...this.textures, this.pageTexture, this.white, this.environment])
      gl.deleteTexture(texture);
    gl.deleteBuffer(this.instances);
    this.deleteSurfaces(this.surfaces);
    this.dropNext();
    this.maps?.destroy();
    gl.deleteVertexArray(this.nothing);
    this.lights?.destroy();
    for (const program of this.programs.values()) gl.deleteProgram(program.program);
  }

  // ---- what stays ----

  private createPages(layers: number): WebGLTexture {
    const { gl, pages } = this;
    const texture = gl.createTexture()!;
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, texture);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGB9_E5, pages.width, pages.height, layers);
    nearest(gl, gl.TEXTURE_2D_ARRAY);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(gl.TEXTURE_2D_ARRAY, name, gl.LINEAR);
    // the first texel makes the browser clear all of it: now, and not while pictures are drawn
    const target = gl.TEXTURE_2D_ARRAY;
    const type = gl.UNSIGNED_INT_5_9_9_9_REV;
    for (let layer = 0; layer < layers; layer++)
      gl.texSubImage3D(target, 0, 0, 0, layer, 1, 1, 1, gl.RGB, type, new Uint32Array(1));
    return texture;
  }

  private createTexture(t: SceneData['textures'][number]): WebGLTexture {
    const { gl } = this;
    const sideMax = gl.getParameter(gl.MAX_TEXTURE_SIZE) as number;
    if (t.width > sideMax || t.height > sideMax)
      throw new LimitError(
        `the scene has a texture of ${t.width} x ${t.height}; the graphics here takes ${sideMax}`,
      );
    return this.createMipmapped(t, gl.SRGB8_ALPHA8, gl.RGBA, t.rgba, ANISOTROPY);
  }

  private createFinishTexture(t: FinishTexture): WebGLTexture {
    const { gl } = this;
    const sharp = this.slow ? 0 : ANISOTROPY; // each is read as often as the base colour's
    if (t.content === Content.NORMAL) return this.createMipmapped(t, gl.RG8, gl.RG, t.texels, sharp);
    return this.createMipmapped(t, t.content ? gl.RGBA8 : gl.SRGB8_ALPHA8, gl.RGBA, t.texels, sharp);
  }

  private createMipmapped(
    t: { width: number; height: number; wrapS: number; wrapT: number },
    internal: number,
    format: number,
    texels: Uint8Array,
    sharp: number, // anisotropy; 0: of one mip level alone
  ): WebGLTexture {
    const { gl } = this;
    const texture = gl.createTexture()!;
    gl.bindTexture(gl.TEXTURE_2D, texture);
    const levels = Math.floor(Math.log2(Math.max(t.width, t.height))) + 1;
    gl.texStorage2D(gl.TEXTURE_2D, levels, internal, t.width, t.height);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, t.width, t.height, format, gl.UNSIGNED_BYTE, texels);
    gl.generateMipmap(gl.TEXTURE_2D);
    const wraps = [gl.REPEAT, gl.CLAMP_TO_EDGE, gl.MIRRORED_REPEAT];
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, wraps[t.wrapS]!);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, wraps[t.wrapT]!);
    const levelsRead = sharp ? gl.LINEAR_MIPMAP_LINEAR : gl.LINEAR_MIPMAP_NEAREST;
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, levelsRead);
    const anisotropy = gl.getExtension('EXT_texture_filter_anisotropic');
    if (anisotropy && sharp) gl.texParameteri(gl.TEXTURE_2D, anisotropy.TEXTURE_MAX_ANISOTROPY_EXT, sharp);
    return texture;
  }

  private createEnvironment(e: NonNullable<SceneData['environment']>): WebGLTexture {
    const { gl } = this;
    const texture = gl.createTexture()!;
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGB9_E5, e.width, e.height);
    gl.texSubImage2D(
      gl.TEXTURE_2D,
      0,
      0,
      0,
      e.width,
      e.height,
      gl.RGB,
      gl.UNSIGNED_INT_5_9_9_9_REV,
      e.texels,
    );
    nearest(gl, gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.REPEAT);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(gl.TEXTURE_2D, name, gl.LINEAR);
    return texture;
  }

  private createSurfaces(data: SceneData): Surfaces {
    const draws = data.meshes.flatMap((shape, mesh) =>
      shape.groups.map((group) => ({
        mesh,
        group,
        defines: this.definesOf(group),
        finish: this.finishOf(data, group),
        programs: new Map(),
      })),
    );
    const rank = ({ group }: Draw) => [
      ...[group.alphaMode, group.base, group.glow, group.doubleSided ? 1 : 0],
      ...(group.finish ?? [-1]),
    ];
    draws.sort((a, b) => {
      const [x, y] = [rank(a), rank(b)];
      const i = x.findIndex((value, k) => value !== y[k]);
      return i < 0 ? a.mesh - b.mesh : x[i]! - y[i]!;
    });
    return { ...this.createVertices(data), draws };
  }

  private deleteSurfaces({ vertices, buffers }: Surfaces): void {
    for (const buffer of buffers) this.gl.deleteBuffer(buffer);
    this.gl.deleteVertexArray(vertices);
  }

  private createVertices(data: SceneData): Pick<Surfaces, 'vertices' | 'buffers'> {
    const { gl } = this;
    const buffers: WebGLBuffer[] = [];
    const createBuffer = () => {
      const buffer = gl.createBuffer()!;
      buffers.push(buffer);
      return buffer;
    };
    const vertices = gl.createVertexArray()!;
    gl.bindVertexArray(vertices);
    const put = (
      values: AllowSharedBufferSource | null,
      place: number,
      size: number,
      type: number = gl.FLOAT,
    ) => {
      if (!values) return;
      gl.bindBuffer(gl.ARRAY_BUFFER, createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      if (type === gl.UNSIGNED_INT) gl.vertexAttribIPointer(place, size, type, 0, 0);
      else gl.vertexAttribPointer(place, size, type, type === gl.BYTE, 0, 0);
    };
    put(data.position, Attribute.POSITION, 3);
    put(data.lightmapUv, Attribute.LIGHTMAP, 2);
    put(data.uv[0], Attribute.UV0, 2);
    put(data.uv[1], Attribute.UV1, 2);
    put(data.colour, Attribute.COLOUR, 4);
    put(data.tag, Attribute.TAG, 1, gl.UNSIGNED_INT);
    if (this.lights || data.finish || this.show !== 'light') put(data.normal, Attribute.NORMAL, 4, gl.BYTE);
    put(data.finish?.tangent ?? null, Attribute.TANGENT, 4, gl.BYTE);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.instances);
    gl.enableVertexAttribArray(Attribute.OBJECT);
    gl.vertexAttribDivisor(Attribute.OBJECT, 1);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, data.index, gl.DYNAMIC_DRAW);
    gl.bindVertexArray(null);
    gl.vertexAttrib4f(Attribute.COLOUR, 1, 1, 1, 1);
    return { vertices, buffers };
  }

  /** Indices of blended groups alone, which are put in order again and again. */
  private keepBlended(): void {
    const kept: number[] = [];
    for (const { group } of this.surfaces.draws) {
      if (!isBlended(group)) continue;
      group.kept = kept.length;
      for (let i = 0; i < group.count; i++) kept.push(this.data.index[group.first + i]!);
    }
    this.data.index = new Uint32Array(kept);
  }

  private definesOf(group: Group): string[] {
    const defines = this.reversed ? ['REVERSED'] : [];
    if (group.base !== NONE) defines.push('BASE_TEXTURE');
    if (group.glow !== NONE) defines.push('GLOW_TEXTURE');
    if (group.alphaMode === AlphaMode.MASK) defines.push('MASK');
    if (group.alphaMode === AlphaMode.BLEND) defines.push('BLEND');
    return defines;
  }

  private finishOf(data: SceneData, { finish }: Group): string[] {
    if (!finish) return [];
    const names = finish.map((texture, place) => {
      const name = FINISH_TEXTURES[place]!.toUpperCase();
      return texture === NONE ? '' : texture === IN_SURFACE ? 'OCCLUSION_IN_SURFACE' : `${name}_TEXTURE`;
    });
    // what no mesh has goes to no fragment: normals and tangents are dear enough
    const none = [data.colour ? '' : 'WHITE', data.uv[1] ? '' : 'ONE_UV'];
    const sky = this.environment ? 'ENVIRONMENT' : '';
    return ['FINISH', 'NORMALS', sky, ...none, ...names].filter((name) => name);
  }

  /** extra: '', DIRECT, SHOW, DEPTH, SHADOW or SURVEY. Depth wants little: where a surface and its holes
   * are. */
  private definesWith({ defines, finish, group }: Draw, extra: string): string[] {
    if (extra === 'SURVEY') return [...defines, extra];
    if (extra !== 'SHADOW' && extra !== 'DEPTH') {
      const all = [...defines, ...finish];
      if (!extra) return all;
      return finish.length ? [...all, extra] : [...all, 'NORMALS', extra];
    }
    const holes = group.alphaMode !== AlphaMode.OPAQUE;
    const needed = (name: string) =>
      name === 'REVERSED' ? extra === 'DEPTH' : holes && name !== 'GLOW_TEXTURE';
    return [...defines.filter(needed), extra];
  }

  private programOf(vertex: string, fragment: string, defines: string[]): Program {
    const key = keyOf(defines, fragment);
    let program = this.programs.get(key);
    if (!program) {
      program = createProgram(this.gl, vertex, fragment, defines);
      this.programs.set(key, program);
    }
    return program;
  }

  // ---- what comes ----

  takeFrame(frame: Frame, visible: Uint8Array | null): void {
    this.lights?.takeFrame(frame);
    frame.object.forEach((object, i) => {
      const at = OBJECT_TEXELS * object;
      const transform = frame.transform.subarray(12 * i, 12 * i + 12);
      if (this.lights && transform.every((x, k) => x === this.objects.values[4 * at + k])) return;
      this.touch(object);
      this.objects.values.set(transform, 4 * at);
      this.touch(object);
      this.objects.touch(at);
      this.objects.touch(at + OBJECT_TEXELS - 1);
      this.placeSphere(object);
      this.box = undefined;
    });
    frame.material.forEach((material, i) => {
      const at = MATERIAL_TEXELS * material;
      this.materials.values.set(frame.baseColour.subarray(3 * i, 3 * i + 3), 4 * at);
      this.materials.values.set(frame.emission.subarray(3 * i, 3 * i + 3), 4 * (at + 1));
      this.materials.touch(at);
      this.materials.touch(at + 1);
    });
    this.sky = frame.sky;
    if (visible) this.setVisible(visible);
  }

  /** data: the scene again, with finishes and without textures. bringFinishes() shows them. */
  takeFinishes(data: SceneData): void {
    const { gl, environment } = this;
    this.dropNext();
    const sky = environment && { texture: environment, width: this.data.environment!.width };
    const create = (texture: FinishTexture) => this.createFinishTexture(texture);
    const maps = new FinishMaps(gl, data.finish!.textures, create, sky, this.nothing);
    this.next = { data, maps, surfaces: null, programs: new Map() };
  }

  /** Gets on with finishes, one thing with each call: the compiler works beside it. Returns whether pictures
   * have become others. */
  bringFinishes(): boolean {
    const { gl, next } = this;
    if (!next) return false;
    if (!next.surfaces) {
      next.surfaces = this.createSurfaces(next.data);
      for (const extra of this.lights ? ['', 'DIRECT'] : [''])
        for (const draw of next.surfaces.draws) {
          const defines = this.definesWith(draw, extra);
          const key = keyOf(defines, SURFACE_FRAGMENT);
          if (draw.finish.length && !this.programs.has(key) && !next.programs.has(key))
            next.programs.set(key, createProgram(gl, SURFACE_VERTEX, SURFACE_FRAGMENT, defines));
        }
      return false;
    }
    if (!next.maps.step()) return false;
    if (gl.getError() === gl.OUT_OF_MEMORY) {
      this.note = 'no memory on the GPU for what is smooth: surfaces are matt';
      this.dropNext();
      return false;
    }
    if (!this.waits && ![...next.programs.values()].every((program) => program.isReady())) return false;
    this.swap(next, next.surfaces);
    return true;
  }

  /** Whether finishes are on their way to the GPU. */
  bringing(): boolean {
    return !!this.next;
  }

  private swap({ data, maps, programs }: Next, surfaces: Surfaces): void {
    this.next = null;
    this.deleteSurfaces(this.surfaces);
    this.maps?.destroy();
    this.maps = maps;
    this.surfaces = surfaces;
    this.note = maps.note;
    programs.forEach((program, key) => this.programs.set(key, program));
    this.data = { ...data, textures: this.data.textures, environment: this.data.environment };
    this.keepBlended();
  }

  private dropNext(): void {
    const { next } = this;
    this.next = null;
    if (!next) return;
    next.maps.destroy();
    if (next.surfaces) this.deleteSurfaces(next.surfaces);
    for (const { program } of next.programs.values()) this.gl.deleteProgram(program);
  }

  /** The next of SHOWN. */
  showNext(): void {
    this.show = SHOWN[(SHOWN.indexOf(this.show) + 1) % SHOWN.length]!;
    if (this.lights || this.data.finish || this.show === 'light') return;
    // a matt scene has its normals on the GPU once they are to be seen
    const { vertices } = this.surfaces;
    const { gl } = this;
    gl.bindVertexArray(vertices);
    const buffer = gl.createBuffer()!;
    this.surfaces.buffers.push(buffer);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, this.data.normal, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(Attribute.NORMAL);
    gl.vertexAttribPointer(Attribute.NORMAL, 4, gl.BYTE, true, 0, 0);
    gl.bindVertexArray(null);
  }

  takeClusters(clusters: Cluster[]): void {
    this.lights?.takeClusters(clusters);
  }

  /** An object throws other shadows than before. */
  private touch(object: number): void {
    if (this.lights && this.visible[object]) this.lights.touch(this.boxOf(object));
  }

  setVisible(visible: Uint8Array): void {
    visible.forEach((shown, object) => {
      if (shown === this.visible[object]) return;
      this.visible[object] = 1;
      this.touch(object);
    });
    this.visible.set(visible);
    this.box = undefined;
  }

  setMean(mean: [number, number, number]): void {
    this.mean = mean;
  }

  /** Takes over tiles of a batch from `first` on, texels from `texel` on, until the time is over. Returns
   * where it stopped. */
  takeTiles(batch: TileBatch, first: number, texel: number, untilMs: number): [number, number] {
    const { levelFirst, finest } = this.pages;
    let at = first;
    for (; at < batch.id.length && (at === first || performance.now() < untilMs); at++) {
      const id = batch.id[at]!;
      const noiseLevel = batch.noiseLevel[at]!;
      const { object, level, x, y, width, height } = this.map.place(id);
      const texels = noiseLevel === GONE ? null : batch.texels.subarray(texel, (texel += width * height));
      if (id >= this.map.plainCount) {
        // of finer levels nobody reads what is noisy
        if (texels && !noiseLevel) this.finer.take(id, texels);
        else this.finer.drop(id);
        continue;
      }
      const place = levelFirst[object]! + level;
      if (!texels || (level < finest && place + 1 < levelFirst[object + 1]!)) continue; // it has no place
      this.write(place, x, y, width, height, texels);
      this.setState(id, 1 + noiseLevel);
    }
    if (at === batch.id.length) for (const tile of batch.directions.splice(0)) this.takeDirections(tile);
    return [at, texel];
  }

  private takeDirections({ id, texels }: DirectionTile): void {
    if (!this.directions) return;
    if (id >= this.map.plainCount) return this.finer.direct(id, texels);
    const { object, level, x, y, width, height } = this.map.place(id);
    const { levelFirst, finest } = this.pages;
    const place = levelFirst[object]! + level;
    if (level >= finest || place + 1 >= levelFirst[object + 1]!)
      this.write(place, x, y, width, height, texels, this.directions);
  }

  /** Texels at (x, y) of a rectangle of the pages. */
  private write(
    place: number,
    x: number,
    y: number,
    width: number,
    height: number,
    texels: Uint32Array,
    layers = 0, // further on
  ): void {
    const { gl } = this;
    const { level } = this.pages;
    const [left, top] = [(level[4 * place]! & 0xffff) + x, (level[4 * place]! >>> 16) + y];
    const target = gl.TEXTURE_2D_ARRAY;
    const type = gl.UNSIGNED_INT_5_9_9_9_REV;
    gl.bindTexture(target, this.pageTexture);
    const layer = level[4 * place + 1]! + layers;
    gl.texSubImage3D(target, 0, left, top, layer, width, height, 1, gl.RGB, type, texels);
  }

  private setState(id: number, state: number): void {
    this.tileState.values[id] = state;
    this.tileState.touch(id);
  }

  /** The view wants these tiles, the most important first. */
  want(ids: ArrayLike<number>): void {
    this.finer.want(ids);
  }

  /** Fades tiles of finer levels in and out; Infinity: at once. Returns whether pictures become others. */
  fade(nowMs: number): boolean {
    return this.finer.step(nowMs);
  }

  /** A box around what is to be seen; null: nothing. */
  bounds(): Box | null {
    if (this.box === undefined) this.box = this.findBounds();
    return this.box;
  }

  private findBounds(): Box | null {
    const all = emptyBox();
    this.visible.forEach((shown, object) => {
      if (shown) widen(all, this.boxOf(object));
    });
    return all.low[0] <= all.high[0] ? all : null;
  }

  private boxOf(object: number): Box {
    const box = emptyBox();
    const m = this.objects.values.subarray(4 * OBJECT_TEXELS * object);
    const shape = this.data.meshes[this.data.objectMesh[object]!]!;
    for (let i = 0 as 0 | 1 | 2; i < 3; i++) {
      let [low, high] = [m[4 * i + 3]!, m[4 * i + 3]!];
      for (let k = 0; k < 3; k++) {
        const [a, b] = [m[4 * i + k]! * shape.low[k as 0], m[4 * i + k]! * shape.high[k as 0]];
        low += Math.min(a, b);
        high += Math.max(a, b);
      }
      box.low[i] = low;
      box.high[i] = high;
    }
    return box;
  }

  private placeSphere(object: number): void {
    const m = this.objects.values;
    const at = 4 * OBJECT_TEXELS * object;
    const shape = this.data.meshes[this.data.objectMesh[object]!]!;
    const [x, y, z] = shape.centre;
    const column = (i: number) => [m[at + i]!, m[at + 4 + i]!, m[at + 8 + i]!] as const;
    const [a, b, c, d] = [column(0), column(1), column(2), column(3)];
    const centre = [0, 1, 2].map((i) => a[i]! * x + b[i]! * y + c[i]! * z + d[i]!);
    // no direction grows by more than all three columns together
    const radius = shape.radius * Math.hypot(...a, ...b, ...c);
    const determinant =
      a[0] * (b[1] * c[2] - b[2] * c[1]) -
      a[1] * (b[0] * c[2] - b[2] * c[0]) +
      a[2] * (b[0] * c[1] - b[1] * c[0]);
    this.sphere.set([...centre, radius, determinant < 0 ? 1 : 0], SPHERE * object);
  }

  // ---- a picture ----

  private createTarget(width: number, height: number, format: number, samples: number): Target {
    const { gl } = this;
    const owned: (() => void)[] = [];
    const frame = () => {
      const framebuffer = gl.createFramebuffer()!;
      gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
      owned.push(() => gl.deleteFramebuffer(framebuffer));
      return framebuffer;
    };
    const storage = (attachment: number, internal: number, many: number) => {
      const buffer = gl.createRenderbuffer()!;
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorageMultisample(gl.RENDERBUFFER, many, internal, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, attachment, gl.RENDERBUFFER, buffer);
      owned.push(() => gl.deleteRenderbuffer(buffer));
    };
    const picture = gl.createTexture()!;
    owned.push(() => gl.deleteTexture(picture));
    gl.bindTexture(gl.TEXTURE_2D, picture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
    nearest(gl, gl.TEXTURE_2D);
    if (format === gl.RGBA16F)
      for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
        gl.texParameteri(gl.TEXTURE_2D, name, gl.LINEAR);
    const resolved = frame();
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, picture, 0);
    let framebuffer = resolved;
    if (samples > 1) {
      framebuffer = frame();
      storage(gl.COLOR_ATTACHMENT0, format, samples);
    }
    storage(gl.DEPTH_ATTACHMENT, gl.DEPTH_COMPONENT32F, samples > 1 ? samples : 0);
    if (gl.checkFramebufferStatus(gl.FRAMEBUFFER) !== gl.FRAMEBUFFER_COMPLETE && !gl.isContextLost())
      throw new LimitError(`the graphics here cannot draw a picture of ${width} x ${height}`);
    return { width, height, framebuffer, resolved, picture, owned };
  }

  private fitted(
    target: Target | null,
    width: number,
    height: number,
    format: number,
    samples: number,
  ): Target {
    if (target && target.width === width && target.height === height) return target;
    for (const release of target?.owned ?? []) release();
    return this.createTarget(width, height, format, samples);
  }

  private setView(program: Program, view: View, scale: [number, number], near: number): void {
    const { gl } = this;
    gl.uniform3fv(program.at('eye'), view.position);
    gl.uniform3fv(program.at('right'), view.right);
    gl.uniform3fv(program.at('up'), view.up);
    gl.uniform3fv(program.at('forward'), view.forward);
    gl.uniform2f(program.at('scale'), ...scale);
    gl.uniform1f(program.at('near'), near);
    gl.uniform1f(program.at('parallel'), view.height ? 1 / this.depthOf(view) : 0);
  }

  /** How far along a view anything is that is not behind the eye. */
  private depthOf(view: View): number {
    const box = this.bounds();
    let depth = 1;
    for (let k = 0; box && k < 8; k++) {
      const corner = [0, 1, 2].map((axis) => (k >> axis) & 1 ? box.high[axis as 0] : box.low[axis as 0]);
      depth = Math.max(depth, dot(add(corner as Vec3, view.position, -1), view.forward));
    }
    return 1.01 * depth;
  }

  private bind(program: Program, unit: number, name: string, target: number, texture: WebGLTexture): void {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(target, texture);
    gl.uniform1i(program.at(name), unit);
  }

  /** Objects by mesh, those that are mirrored apart. isIn: whether a sphere is in view. */
  private findVisible(isIn: (centre: Vec3, radius: number) => boolean): Map<number, [number[], number[]]> {
    const found = new Map<number, [number[], number[]]>();
    this.objectsOf.forEach((objects, mesh) => {
      for (const object of objects) {
        if (!this.visible[object]) continue;
        const [x, y, z, radius, mirrored] = this.sphere.subarray(SPHERE * object, SPHERE * (object + 1));
        if (!isIn([x!, y!, z!], radius!)) continue;
        if (!found.has(mesh)) found.set(mesh, [[], []]);
        found.get(mesh)![mirrored ? 1 : 0].push(object);
      }
    });
    return found;
  }

  private inView(view: View, scale: [number, number]): (centre: Vec3, radius: number) => boolean {
    const sides = [1 / scale[0], 1 / scale[1]].map((tangent) => [tangent, Math.hypot(1, tangent)] as const);
    return (centre, radius) => {
      const from = add(centre, view.position, -1);
      const depth = dot(from, view.forward);
      if (depth < -radius) return false;
      if (view.height)
        return [view.right, view.up].every((axis, i) => Math.abs(dot(from, axis)) <= sides[i]![0] + radius);
      return [view.right, view.up].every(
        (axis, i) => Math.abs(dot(from, axis)) - depth * sides[i]![0] <= radius * sides[i]![1],
      );
    };
  }

  private near(): number {
    const box = this.bounds();
    const size = box ? Math.hypot(...box.high.map((x, i) => x - box.low[i]!)) : 1;
    return Math.min(0.02, 0.001 * size) * (this.reversed ? 0.1 : 1);
  }

  /** extra: '', DIRECT, SHOW, DEPTH, SHADOW or SURVEY. */
  private drawSurfaces(
    view: View,
    scale: [number, number],
    extra: string,
    set: (program: Program) => void,
    isIn = this.inView(view, scale),
  ): void {
    const { gl } = this;
    const found = this.findVisible(isIn);
    const shadow = extra === 'SHADOW';
    const ids: number[] = [];
    const ranges = new Map<number, { first: number; count: number; mirrored: boolean }[]>();
    for (const [mesh, both] of found)
      both.forEach((objects, mirrored) => {
        if (!objects.length) return;
        if (!ranges.has(mesh)) ranges.set(mesh, []);
        ranges.get(mesh)!.push({ first: ids.length, count: objects.length, mirrored: mirrored === 1 });
        for (const object of objects) ids.push(object);
      });
    gl.bindVertexArray(this.surfaces.vertices);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.instances);
    gl.bufferData(gl.ARRAY_BUFFER, Uint32Array.from(ids), gl.STREAM_DRAW);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(this.reversed ? gl.GEQUAL : gl.LEQUAL);
    const near = this.near();
    let current: Program | null = null;
    let group: Group | null = null;
    const prepare = (draw: Draw) => {
      let program = draw.programs.get(extra);
      if (!program) {
        program = this.programOf(SURFACE_VERTEX, SURFACE_FRAGMENT, this.definesWith(draw, extra));
        draw.programs.set(extra, program);
      }
      if (program !== current) {
        program.use();
        current = program;
        group = null;
        this.setView(program, view, scale, near);
        this.bind(program, 0, 'objects', gl.TEXTURE_2D, this.objects.texture);
        this.bind(program, 1, 'materials', gl.TEXTURE_2D, this.materials.texture);
        this.bind(program, 2, 'levels', gl.TEXTURE_2D, this.levels.texture);
        this.bind(program, 3, 'tileState', gl.TEXTURE_2D, this.tileState.texture);
        this.bind(program, 4, 'pages', gl.TEXTURE_2D_ARRAY, this.pageTexture);
        gl.uniform2f(program.at('pageSize'), this.pages.width, this.pages.height);
        gl.uniform3fv(program.at('standIn'), this.mean);
        gl.uniform1f(program.at('lightUnit'), this.data.lightUnit);
        gl.uniform1f(program.at('directions'), this.directions);
        gl.uniform1i(program.at('unfiltered'), this.unfiltered ? 1 : 0);
        const asksFiner = this.pages.slots && (extra === 'SURVEY' || this.finer.any());
        gl.uniform1i(program.at('finest'), asksFiner ? -this.map.finer : this.pages.finest);
        gl.uniform1ui(program.at('slots'), this.pages.levelFirst.at(-1)!);
        if (this.maps) this.bindFinishes(program);
        set(program);
      }
      if (!group || group.base !== draw.group.base || group.glow !== draw.group.glow) {
        this.bind(program, 5, 'baseTexture', gl.TEXTURE_2D, this.textures[draw.group.base] ?? this.white);
        this.bind(program, 6, 'glowTexture', gl.TEXTURE_2D, this.textures[draw.group.glow] ?? this.white);
      }
      if (draw.group.finish && group !== draw.group) this.bindFinish(program, draw.group);
      // a back is a black wall for light
      if (draw.group.doubleSided || shadow) gl.disable(gl.CULL_FACE);
      else gl.enable(gl.CULL_FACE);
      group = draw.group;
    };
    const run = (draw: Draw, first: number, count: number, mirrored: boolean) => {
      if (extra === 'DIRECT') this.setLights(current!, ids.slice(first, first + count), !!draw.group.finish);
      gl.frontFace(mirrored ? gl.CW : gl.CCW);
      gl.vertexAttribIPointer(Attribute.OBJECT, 1, gl.UNSIGNED_INT, 4, 4 * first);
      gl.drawElementsInstanced(gl.TRIANGLES, draw.group.count, gl.UNSIGNED_INT, 4 * draw.group.first, count);
    };
    const blended: { draw: Draw; at: number; object: number; mirrored: boolean; depth: number }[] = [];
    for (const draw of this.surfaces.draws)
      for (const range of ranges.get(draw.mesh) ?? []) {
        if (isBlended(draw.group) && extra === 'DEPTH') continue;
        if (isBlended(draw.group) && extra !== 'SURVEY' && !shadow) {
          for (let i = 0; i < range.count; i++) {
            const object = ids[range.first + i]!;
            const middle = [0, 1, 2].map((k) => this.sphere[SPHERE * object + k]!) as Vec3;
            const away = add(middle, view.position, -1);
            const depth = view.height ? dot(away, view.forward) : Math.hypot(...away);
            blended.push({ draw, at: range.first + i, object, mirrored: range.mirrored, depth });
          }
          continue;
        }
        prepare(draw);
        run(draw, range.first, range.count, range.mirrored);
      }
    blended.sort((a, b) => b.depth - a.depth);
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    for (const each of blended) {
      const { passes } = each.draw.group;
      if (passes) gl.blendColor(...passes, 1);
      const behind = passes ? gl.CONSTANT_COLOR : gl.ONE_MINUS_SRC_ALPHA;
      gl.blendFuncSeparate(gl.SRC_ALPHA, behind, gl.ONE, gl.ONE);
      this.putInOrder(each.draw.group, each.object, view);
      prepare(each.draw);
      run(each.draw, each.at, 1, each.mirrored);
    }
    gl.depthMask(true);
    gl.disable(gl.BLEND);
    gl.disable(gl.CULL_FACE);
    gl.bindVertexArray(null);
  }

  private bindFinish(program: Program, { finish, material }: Group): void {
    const { gl } = this;
    const size = 4 * FINISH_TEXELS;
    gl.uniform4fv(program.at('finish'), this.data.finish!.materials, size * material, size);
    finish!.forEach((texture, place) => {
      const image = this.maps!.textures[texture];
      const name = `${FINISH_TEXTURES[place]}Texture`;
      if (image) this.bind(program, 12 + place, name, gl.TEXTURE_2D, image);
    });
  }

  private bindFinishes(program: Program): void {
    const { gl } = this;
    this.bind(program, 11, 'smoothTable', gl.TEXTURE_2D, this.maps!.smooth);
    gl.uniform3fv(program.at('sky'), this.sky as Float32Array);
    gl.uniform1f(program.at('skyUnit'), this.data.lightUnit);
  }

  /** The lights that shine on objects. */
  private setLights(program: Program, objects: number[], smooth: boolean): void {
    const { gl } = this;
    const box = emptyBox();
    for (const object of objects) widen(box, this.boxOf(object));
    const list = this.lights!.near(box, FAINT * this.meanLuminance() * (smooth ? FAINT_SHARE : 1));
    if (list.length) gl.uniform1iv(program.at('light'), list);
    gl.uniform1i(program.at('lightCount'), list.length);
  }

  private meanLuminance(): number {
    return 0.2126 * this.mean[0] + 0.7152 * this.mean[1] + 0.0722 * this.mean[2];
  }

  /** Gets on with what direct light needs, a program or a shadow map with each picture until all is there.
   * Returns whether this picture has any. */
  private prepareLights(view: View): boolean {
    const bounds = this.lights && this.bounds();
    if (!this.lights || !bounds) return false;
    for (const [name, defines] of this.later) {
      this.programOf(SURFACE_VERTEX, SURFACE_FRAGMENT, defines);
      this.later.delete(name);
      break;
    }
    if (this.later.size || !this.isReady()) return false;
    for (const map of this.lights.choose(view, bounds)) this.drawMap(map);
    return this.lights.shining().shown > 0;
  }

  /** Whether more direct light comes with the next pictures. */
  lightsPending(): boolean {
    if (!this.lights || !this.bounds()) return false;
    return this.later.size > 0 || !this.isReady() || this.lights.shining().pending > 0;
  }

  /** Whether the compiler has all programs that it was given, or is waited for. */
  private isReady(): boolean {
    return this.waits || [...this.programs.values()].every((program) => program.isReady());
  }

  /** Whether a picture need not wait for the compiler. */
  isDrawable(): boolean {
    this.drawable ||= this.isReady();
    return this.drawable;
  }

  /** Whether the GPU still draws the last picture. */
  busy(): boolean {
    return this.fence.busy();
  }

  private drawMap(map: ShadowMap): void {
    const { gl } = this;
    const lights = this.lights!;
    lights.mapsDrawn++;
    const side = map.sun ? SUN_SIDE : LAMP_SIDE;
    gl.bindFramebuffer(gl.FRAMEBUFFER, lights.frame);
    const texture = map.sun ? lights.sunMaps : lights.lampMaps;
    gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, texture, 0, map.layer);
    gl.drawBuffers([gl.NONE]);
    this.clear(lights.frame, side, side);
    const view: View = { position: map.eye, right: [0, 0, 0], up: [0, 0, 0], forward: [0, 0, 0], fovY: 1 };
    this.drawSurfaces(
      view,
      [1, 1],
      'SHADOW',
      (program) => {
        gl.uniformMatrix4fv(program.at('clip'), false, map.clip);
        gl.uniform1f(program.at('reach'), map.reach);
      },
      (centre, radius) => {
        const from = add(centre, map.eye, -1);
        return map.side.every((n) => dot(n, from) + map.beyond + radius * Math.hypot(...n) >= 0);
      },
    );
    map.dirty = false;
  }

  /** Triangles of a blended group, the farthest first. */
  private putInOrder(group: Group, object: number, view: View): void {
    const { gl } = this;
    const { position, index } = this.data;
    const m = this.objects.values;
    const at = 4 * OBJECT_TEXELS * object;
    const kept = index.subarray(group.kept!, group.kept! + group.count);
    // distance is the world's: along each row of the transform
    const distances = new Float64Array(group.count / 3);
    for (let t = 0; t < distances.length; t++) {
      let squared = 0;
      for (let row = 0; row < 3; row++) {
        let x = m[at + 4 * row + 3]! - view.position[row as 0];
        for (let k = 0; k < 3; k++) {
          const axis = m[at + 4 * row + k]! / 3;
          for (let corner = 0; corner < 3; corner++) x += axis * position[3 * kept[3 * t + corner]! + k]!;
        }
        squared += view.height ? x * view.forward[row as 0] : x * x; // what is parallel needs no square
      }
      distances[t] = squared;
    }
    const order = Uint32Array.from(distances.keys()).sort((a, b) => distances[b]! - distances[a]!);
    const ordered = new Uint32Array(group.count);
    order.forEach((t, i) => ordered.set(kept.subarray(3 * t, 3 * t + 3), 3 * i));
    gl.bufferSubData(gl.ELEMENT_ARRAY_BUFFER, 4 * group.first, ordered);
  }

  private upload(): void {
    for (const table of [this.objects, this.materials, this.levels, this.tileState]) table.upload();
  }

  private clear(framebuffer: WebGLFramebuffer, width: number, height: number): void {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.viewport(0, 0, width, height);
    gl.clearDepth(this.reversed ? 0 : 1);
    gl.clear(gl.DEPTH_BUFFER_BIT);
  }

  private drawScreen(fragment: string, set: (program: Program) => void): void {
    const { gl } = this;
    gl.disable(gl.DEPTH_TEST);
    gl.bindVertexArray(this.nothing);
    const program = this.programOf(SCREEN_VERTEX, fragment, []);
    program.use();
    set(program);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindVertexArray(null);
  }

  /** Draws onto the canvas. sample: 0, or the number of one more of the same view, light and exposure, up to
   * SAMPLES_STILL. share: of the canvas' width and height that the picture has, before it is stretched. */
  draw(view: View, canvasWidth: number, canvasHeight: number, sample: number, share: number): void {
    const { gl } = this;
    const scaled = (side: number) => Math.max(1, Math.round(share * side));
    const [width, height] = [canvasWidth, canvasHeight].map(scaled) as [
      number,
      number,
    ];
    this.upload();
    if (sample) {
      this.single = this.fitted(this.single, width, height, gl.RGBA16F, 1);
      this.average = this.fitted(this.average, width, height, gl.RGBA16F, 1);
    } else this.target = this.fitted(this.target, width, height, gl.RGBA16F, this.samples); // it is shown
    const target = (sample ? this.single : this.target)!;
    const lights = this.prepareLights(view) ? this.lights : null;
    const scale = scaleOf(view, width, height);
    const exposure = this.show === 'light' ? 2 ** this.stops : 0; // of the sky
    const [x, y] = placeOf(sample);
    const offset: [number, number] = [(2 * x) / width, (-2 * y) / height];
    this.clear(target.framebuffer, width, height);
    this.drawScreen(SKY_FRAGMENT, (program) => {
      this.setView(program, view, scale, 0);
      gl.uniform2f(program.at('offset'), ...offset);
      gl.uniform3fv(program.at('sky'), this.sky as Float32Array);
      gl.uniform1f(program.at('exposure'), exposure);
      gl.uniform1f(program.at('lightUnit'), this.data.lightUnit);
      gl.uniform1i(program.at('hasEnvironment'), this.environment ? 1 : 0);
      this.bind(program, 0, 'environment', gl.TEXTURE_2D, this.environment ?? this.white);
    });
    const place = (program: Program) => {
      gl.uniform2f(program.at('offset'), ...offset);
      gl.uniform1f(program.at('sharper'), sample ? SHARPER : 0);
    };
    // direct light is dear: depth first, so that only what is seen is lit
    if (lights) {
      gl.colorMask(false, false, false, false);
      this.drawSurfaces(view, scale, 'DEPTH', place);
      gl.colorMask(true, true, true, true);
    }
    const extra = this.show !== 'light' ? 'SHOW' : lights ? 'DIRECT' : '';
    this.drawSurfaces(view, scale, extra, (program) => {
      place(program);
      gl.uniform1i(program.at('show'), SHOWN.indexOf(this.show));
      if (lights) {
        this.bind(program, 7, 'lights', gl.TEXTURE_2D, lights.table);
        this.bind(program, 8, 'shapes', gl.TEXTURE_2D, lights.shapes);
        this.bind(program, 9, 'sunMaps', gl.TEXTURE_2D_ARRAY, lights.sunMaps);
        this.bind(program, 10, 'lampMaps', gl.TEXTURE_2D_ARRAY, lights.lampMaps);
        gl.uniform2fv(program.at('tap'), TAPS);
        gl.uniform1f(program.at('pictureNumber'), sample);
        gl.uniform1f(program.at('faint'), FAINT * this.meanLuminance());
      }
      gl.uniform1f(program.at('exposure'), exposure);
      gl.uniform1f(program.at('pixelArea'), 1);
    });
    if (target.framebuffer !== target.resolved) {
      gl.bindFramebuffer(gl.READ_FRAMEBUFFER, target.framebuffer);
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, target.resolved);
      gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    }
    if (sample) this.addSample(sample - 1);
    if (sample && sample < SAMPLES_STILL) return this.fence.begin();
    this.shown = sample ? this.average! : target;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, canvasWidth, canvasHeight);
    this.drawScreen(TONEMAP_FRAGMENT, (program) => {
      this.bind(program, 0, 'picture', gl.TEXTURE_2D, this.shown!.picture);
      const curve = this.show === 'light' ? this.curve : 'none';
      gl.uniform1i(program.at('curve'), CURVES.indexOf(curve));
    });
    this.fence.begin();
  }

  /** The mean of the picture just drawn and of `before` earlier ones. */
  private addSample(before: number): void {
    const { gl } = this;
    const { width, height, resolved } = this.average!;
    gl.bindFramebuffer(gl.FRAMEBUFFER, resolved);
    gl.viewport(0, 0, width, height);
    if (before) gl.enable(gl.BLEND);
    gl.blendColor(0, 0, 0, 1 / (before + 1));
    gl.blendFunc(gl.CONSTANT_ALPHA, gl.ONE_MINUS_CONSTANT_ALPHA);
    this.drawScreen(COPY_FRAGMENT, (program) =>
      this.bind(program, 0, 'picture', gl.TEXTURE_2D, this.single!.picture),
    );
    gl.disable(gl.BLEND);
  }

  /** The exposure that suits the last picture, in stops: asked for in one frame, there in a later one. null:
   * not yet, or black. */
  meter(): number | null {
    const { gl } = this;
    if (!this.shown || this.show !== 'light') return null;
    if (this.meterPixels.busy()) {
      const pixels = this.meterPixels.take();
      const stops = pixels && autoStops(new Float32Array(pixels));
      return stops === null ? null : stops + Math.log2(this.meteredExposure);
    }
    this.meterTarget ??= this.createTarget(METER_WIDTH, METER_HEIGHT, gl.RGBA16F, 1);
    this.clear(this.meterTarget.framebuffer, METER_WIDTH, METER_HEIGHT);
    this.drawScreen(METER_FRAGMENT, (program) =>
      this.bind(program, 0, 'picture', gl.TEXTURE_2D, this.shown!.picture),
    );
    this.meteredExposure = 2 ** this.stops;
    this.meterPixels.start(METER_WIDTH, METER_HEIGHT, gl.RGBA, gl.FLOAT, 16);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return null;
  }

  // ---- what the view needs ----

  /** Begins a small picture of a wide view that says which tiles it reads, unless one is under way. width,
   * height: of the view. */
  beginSurvey(view: View, width: number, height: number): void {
    const { gl } = this;
    if (this.surveyPixels.busy()) return;
    this.upload();
    const shrink = Math.min(1, SURVEY_SIDE / Math.max(width, height));
    const [w, h] = [Math.max(1, Math.round(width * shrink)), Math.max(1, Math.round(height * shrink))];
    this.surveyTarget = this.fitted(this.surveyTarget, w, h, gl.RGBA32UI, 1);
    this.surveyNumber++;
    // another place in the pixels each time
    const jitter = (step: number, side: number) => ((((this.surveyNumber * step) % 1) - 0.5) * 2) / side;
    const scale = scaleOf(view, width, height).map((x) => x / SURVEY_MARGIN) as [number, number];
    const [x, y] = [jitter(0.75487767, w) / scale[0], jitter(0.56984029, h) / scale[1]];
    const moved = (from: Vec3) => add(add(from, view.right, x), view.up, y);
    const jittered: View = view.height
      ? { ...view, position: moved(view.position) }
      : { ...view, forward: moved(view.forward) };
    this.clear(this.surveyTarget.framebuffer, w, h);
    gl.clearBufferuiv(gl.COLOR, 0, [0, 0, 0, 0]);
    const pixel = (SURVEY_MARGIN * height) / h;
    this.drawSurfaces(jittered, scale, 'SURVEY', (program) => {
      gl.uniform2f(program.at('offset'), 0, 0);
      gl.uniform1f(program.at('sharper'), 0);
      gl.uniform1f(program.at('pixelArea'), 1 / (pixel * pixel));
      gl.uniform1ui(program.at('surveyNumber'), this.surveyNumber);
    });
    this.surveyPixels.start(w, h, gl.RGBA_INTEGER, gl.UNSIGNED_INT, 16);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** What the survey under way has found; null: not yet. */
  takeSurvey(): Survey | null {
    const pixels = this.surveyPixels.take();
    if (!pixels || !this.surveyTarget) return null;
    const values = new Uint32Array(pixels);
    const { width, height } = this.surveyTarget;
    const inPicture = new Set<number>();
    const around = new Set<number>();
    const edge = (1 - 1 / SURVEY_MARGIN) / 2;
    for (let i = 0, at = 0; at < values.length; i++, at += 4) {
      const tile = values[at]!;
      if (!tile) continue;
      const x = ((i % width) + 0.5) / width;
      const y = (Math.floor(i / width) + 0.5) / height;
      const set = Math.min(x, y, 1 - x, 1 - y) >= edge ? inPicture : around;
      const flags = values[at + 1]!;
      const row = values[at + 2]!;
      set.add(tile - 1);
      if (flags & 1) set.add(tile);
      if (flags & 2) set.add(tile - 1 + row);
      if (flags === 3) set.add(tile + row);
    }
    return { inPicture: Uint32Array.from(inPicture), around: Uint32Array.from(around) };
  }

  /** How many lights it draws, and how many of their shadow maps it has drawn so far. */
  lightsDrawn(): { lights: number; maps: number } {
    return { lights: this.lights?.count() ?? 0, maps: this.lights?.mapsDrawn ?? 0 };
  }

  /** Whether a tile is there, or may never come. */
  hasTile(id: number): boolean {
    return id >= this.map.plainCount || this.tileState.values[id]! > 0;
  }
}
