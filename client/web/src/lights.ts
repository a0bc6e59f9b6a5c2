// lights.ts: the lights that the page draws, as shaders read them, and which of their shadow maps are out of
// date; as client/gl/gl_lights.h.
// Flow: scene, frames, clusters -> [lights] -> renderer draws the maps, then the picture
// A sun has CASCADES maps: the last one of the whole scene, each of the others a quarter as wide, about what
// is before the eye. Points, spots and small emissive meshes have the six sides of a cube.
import type { Vec3, View } from './camera.ts';
import { add, cross, dot, normalize } from './camera.ts';
import { type Cluster, MAP_SIDE } from './clusters.ts';
import { type GL, nearest } from './gpu.ts';
import { type Light, LightKind } from './package.ts';
import { CASCADES, LAMP_SIDE, LAMPS_MAX, LIGHT_TEXELS, LIGHTS_MAX, SUN_SIDE } from './limits.ts';
import type { Frame } from './wire.ts';

const WIDER = 4; // a cascade than the one before
const SNAP = 0.25; // of a cascade's half width: steps in which its middle moves
const NEAR_SHARE = 1e-3; // of the scene's diagonal: what is nearer to a point or spot casts no shadow
const DISC_SHARE = 0.6; // the radius of a disc that looks like an emitter, of that of the ball around it
const SHAPE = 2 * MAP_SIDE * MAP_SIDE; // numbers of a cluster

export interface Box {
  low: Vec3;
  high: Vec3;
}

/** A map to draw. What is in front of the eye's `side`s, moved out by `beyond`, is in it. */
export interface ShadowMap {
  sun: boolean;
  layer: number; // of the maps of suns or of lamps
  eye: Vec3; // of a sun: the middle
  side: Vec3[];
  beyond: number;
  clip: number[]; // of places from the eye, columns
  reach: number; // what is nearer is a part of the lamp
  dirty: boolean;
}

interface Source {
  kind: 0 | 1 | 2 | 3; // sun, point, spot, cluster
  light: number; // of the scene, or -1
  position: Vec3;
  direction: Vec3;
  colour: Vec3;
  intensity: number; // luminance, the most in any direction, W/sr
  radius: number;
  reach: number;
  near: number;
  maps: ShadowMap[];
  shown: boolean; // all of its maps have been drawn once
}

const luminance = (c: ArrayLike<number>) => 0.2126 * c[0]! + 0.7152 * c[1]! + 0.0722 * c[2]!;
const scale = (a: Vec3, s: number): Vec3 => [a[0] * s, a[1] * s, a[2] * s];

/** The six sides of a cube: where each looks, and its picture's axes. The shader's lampReach() knows them. */
const faces: Vec3[][] = [0, 1, 2].flatMap((axis) =>
  [1, -1].map((sign) =>
    [0, 1, 2].map((k) => {
      const v: Vec3 = [0, 0, 0];
      v[((axis + k) % 3) as 0] = k ? 1 : sign;
      return v;
    }),
  ),
);

/** Columns of a matrix from its rows. */
function clipOf(x: Vec3, y: Vec3, z: Vec3, w: Vec3, zAdd: number, wAdd: number): number[] {
  const rows = [
    [...x, 0],
    [...y, 0],
    [...z, zAdd],
    [...w, wAdd],
  ];
  return Array.from({ length: 16 }, (_, i) => rows[i & 3]![i >> 2]!);
}

export class Lights {
  readonly sunMaps: WebGLTexture;
  readonly lampMaps: WebGLTexture;
  readonly table: WebGLTexture;
  readonly shapes: WebGLTexture;
  readonly frame: WebGLFramebuffer;
  private readonly sources: Source[] = [];
  private readonly suns: number;
  private readonly scene: Box = {
    low: [Infinity, Infinity, Infinity],
    high: [-Infinity, -Infinity, -Infinity],
  };
  mapsDrawn = 0;

  /** drawn: a bit for each of the scene's lights; clusters: how many there are. */
  constructor(
    private readonly gl: GL,
    private readonly lights: Light[],
    drawn: Uint8Array,
    clusters: number,
    private readonly reversed: boolean,
  ) {
    const push = (kind: Source['kind'], light: number) => {
      const none = (): Vec3 => [0, 0, 0];
      this.sources.push({
        kind,
        light,
        position: none(),
        direction: [0, 0, 1],
        colour: none(),
        intensity: 0,
        radius: 0,
        reach: 0,
        near: 0,
        maps: [],
        shown: false,
      });
    };
    const some = (suns: boolean) =>
      lights.forEach(({ kind }, i) => {
        if (!((drawn[i >> 3]! >> (i & 7)) & 1) || (kind === LightKind.DIRECTIONAL) !== suns) return;
        push(suns ? 0 : kind === LightKind.SPOT ? 2 : 1, i);
      });
    some(true);
    this.suns = this.sources.length;
    some(false);
    for (let i = 0; i < clusters; i++) push(3, -1);
    const lamps = this.sources.length - this.suns;
    this.sunMaps = this.createMaps(SUN_SIDE, CASCADES * this.suns);
    this.lampMaps = this.createMaps(LAMP_SIDE, 6 * lamps);
    this.table = this.createTable(gl.RGBA32F, LIGHT_TEXELS, LIGHTS_MAX);
    this.shapes = this.createTable(gl.R32F, SHAPE, LAMPS_MAX);
    this.frame = gl.createFramebuffer()!;
  }

  destroy(): void {
    const { gl } = this;
    for (const texture of [this.sunMaps, this.lampMaps, this.table, this.shapes]) gl.deleteTexture(texture);
    gl.deleteFramebuffer(this.frame);
  }

  private createMaps(side: number, layers: number): WebGLTexture {
    const { gl } = this;
    const texture = gl.createTexture()!;
    const [width, depth] = layers ? [side, layers] : [1, 1];
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, texture);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.DEPTH_COMPONENT32F, width, width, depth);
    nearest(gl, gl.TEXTURE_2D_ARRAY);
    return texture;
  }

  private createTable(format: number, width: number, height: number): WebGLTexture {
    const { gl } = this;
    const texture = gl.createTexture()!;
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
    nearest(gl, gl.TEXTURE_2D);
    return texture;
  }

  count(): number {
    return this.sources.length;
  }

  // ---- what changes ----

  takeFrame(frame: Frame): void {
    frame.light.forEach((light, i) => {
      const source = this.sources.find((each) => each.light === light);
      if (!source) return;
      const of = (from: Float32Array) => Array.from(from.subarray(3 * i, 3 * i + 3)) as Vec3;
      this.put(source, of(frame.lightPosition), normalize(of(frame.lightDirection)), 0);
      source.colour = of(frame.lightIntensity);
      source.intensity = luminance(source.colour);
    });
  }

  private put(source: Source, position: Vec3, direction: Vec3, reach: number): void {
    const same = [...position, ...direction, reach].every(
      (x, k) => x === [...source.position, ...source.direction, source.reach][k],
    );
    if (!same) source.maps = [];
    [source.position, source.direction, source.reach] = [position, direction, reach];
  }

  takeClusters(clusters: Cluster[]): void {
    const { gl } = this;
    const first = this.sources.length - clusters.length;
    gl.bindTexture(gl.TEXTURE_2D, this.shapes);
    clusters.forEach((cluster, i) => {
      const source = this.sources[first + i]!;
      this.put(source, cluster.centre as Vec3, source.direction, cluster.reach);
      source.colour = cluster.colour as Vec3;
      source.intensity = cluster.intensity;
      source.radius = cluster.radius;
      gl.texSubImage2D(
        gl.TEXTURE_2D,
        0,
        0,
        first + i - this.suns,
        SHAPE,
        1,
        gl.RED,
        gl.FLOAT,
        cluster.shapes,
      );
    });
  }

  /** Something was in this box, or is now. */
  touch(box: Box): void {
    for (const { maps } of this.sources)
      for (const map of maps)
        map.dirty ||= map.side.every((n) => {
          const most = n.map((x, k) => x * ((x > 0 ? box.high : box.low)[k as 0] - map.eye[k as 0]));
          return most[0]! + most[1]! + most[2]! + map.beyond >= 0;
        });
  }

  // ---- a picture ----

  /** Places the maps for a view and writes the table; returns the maps that are to be drawn. A new light gets
   * one of its maps with each picture, and shines once it has all: a slow GPU draws them one after another.
   * scene: a box around it. */
  choose(view: View, scene: Box): ShadowMap[] {
    const { gl } = this;
    const { low, high } = this.scene;
    for (const k of [0, 1, 2] as const) {
      low[k] = Math.min(low[k], scene.low[k]);
      high[k] = Math.max(high[k], scene.high[k]);
    }
    const size = Math.max(1e-6, Math.hypot(...add(high, low, -1)));
    const middle = scale(add(low, high), 0.5);
    const table = new Float32Array(4 * LIGHT_TEXELS * LIGHTS_MAX);
    this.sources.forEach((source, i) => {
      if (source.kind) this.placeLamp(source, i - this.suns, size);
      else this.placeSun(source, i, view, middle, size);
      table.set(this.rowOf(source, i, view.position, size), 4 * LIGHT_TEXELS * i);
    });
    gl.bindTexture(gl.TEXTURE_2D, this.table);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, LIGHT_TEXELS, LIGHTS_MAX, gl.RGBA, gl.FLOAT, table);
    const dirtyOf = (shown: boolean) =>
      this.sources
        .filter((source) => source.intensity > 0 && this.isShown(source) === shown)
        .flatMap((source) => source.maps.filter((map) => map.dirty));
    return [...dirtyOf(true), ...dirtyOf(false).slice(0, 1)];
  }

  private isShown(source: Source): boolean {
    source.shown ||= source.maps.length > 0 && source.maps.every((map) => !map.dirty);
    return source.shown;
  }

  /** How many lights shine, or will once their maps are drawn. */
  shining(): { shown: number; pending: number } {
    const shining = this.sources.filter((source) => source.intensity > 0);
    const shown = shining.filter((source) => this.isShown(source)).length;
    return { shown, pending: shining.length - shown };
  }

  private placeLamp(source: Source, number: number, size: number): void {
    const near = source.kind === 3 ? Math.max(0.5 * source.reach, 1e-6 * size) : NEAR_SHARE * size;
    if (source.maps.length && source.near === near) return;
    source.near = near;
    source.maps = faces.map(([z, x, y], face) => ({
      sun: false,
      layer: 6 * number + face,
      eye: source.position,
      side: [x!, y!].flatMap((axis) => [add(z!, axis), add(z!, axis, -1)]),
      beyond: 0,
      clip: this.reversed ? clipOf(x!, y!, [0, 0, 0], z!, near, 0) : clipOf(x!, y!, z!, z!, -2 * near, 0),
      reach: source.reach,
      dirty: true,
    }));
  }

  private axes(source: Source): [Vec3, Vec3] {
    const d = source.direction;
    const right = normalize(cross(d, Math.abs(d[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0]));
    return [right, cross(right, d)];
  }

  private placeSun(source: Source, number: number, view: View, middle: Vec3, size: number): void {
    const [right, up] = this.axes(source);
    for (let c = 0; c < CASCADES; c++) {
      const half = (0.5 * size) / WIDER ** (CASCADES - 1 - c);
      let eye = middle;
      if (c + 1 < CASCADES) {
        // in steps, so that it seldom changes
        const way = add(add(view.position, view.forward, 0.6 * half), middle, -1);
        const step = SNAP * half;
        for (const axis of [right, up]) eye = add(eye, axis, step * Math.round(dot(way, axis) / step));
      }
      const before = source.maps[c];
      if (before && before.beyond === half && before.eye.every((x, k) => x === eye[k])) continue;
      // all of the scene along the light, whatever the middle
      const [x, y, away] = [scale(right, 1 / half), scale(up, 1 / half), source.direction];
      source.maps[c] = {
        sun: true,
        layer: CASCADES * number + c,
        eye,
        side: [right, scale(right, -1), up, scale(up, -1)],
        beyond: half,
        clip: this.reversed
          ? clipOf(x, y, scale(away, -0.5 / size), [0, 0, 0], 0.5, 1)
          : clipOf(x, y, scale(away, 1 / size), [0, 0, 0], 0, 1),
        reach: 0,
        dirty: true,
      };
    }
  }

  /** A light as the shader reads it. */
  private rowOf(source: Source, number: number, eye: Vec3, size: number): number[] {
    const { kind, colour, maps } = source;
    const light = this.lights[source.light];
    if (!kind) {
      const [right, up] = this.axes(source);
      return [
        ...scale(source.direction, -1), 0,
        ...colour, Math.tan(light!.angularDiameter / 2),
        ...right, size,
        ...up, CASCADES * number,
        ...maps.flatMap((map) => [...add(map.eye, eye, -1), map.beyond]),
      ]; // prettier-ignore
    }
    const lamp = number - this.suns;
    const [outer, inner] = [Math.cos(light?.outerCone ?? 0), Math.cos(light?.innerCone ?? 0)];
    return [
      ...add(source.position, eye, -1), kind,
      ...colour, kind === 3 ? DISC_SHARE * source.radius : 0,
      ...(kind === 3 ? [lamp, 0, 0] : source.direction), outer,
      source.near, 6 * lamp, source.reach, 1 / Math.max(inner - outer, 1e-6),
    ]; // prettier-ignore
  }

  /** The lights, by their rows in the table, that give more than `least` somewhere in a box; luminance,
   * W/m^2. */
  near(box: Box, least: number): number[] {
    const list: number[] = [];
    this.sources.forEach((source, i) => {
      const { kind, position, intensity } = source;
      if (!(intensity > 0) || !this.isShown(source)) return;
      const way = position.map((p, k) => Math.max(box.low[k as 0] - p, p - box.high[k as 0], 0));
      if (!kind || intensity > least * way.reduce((sum, x) => sum + x * x, 0)) list.push(i);
    });
    return list;
  }
}
