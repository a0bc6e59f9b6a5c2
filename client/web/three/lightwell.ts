// lightwell.ts: live light on a three.js scene that was loaded from the glTF that a lightwelld lights.
//
//     const light = await Lightwell.attach(scene, 'wss://host/ws');
//     ... before each picture: light.update(camera, renderer.domElement.height);
//
// Light arrives as lightMap, of every object by itself; suns, points and spots that the server leaves to
// clients are three's own, with shadows. An original glTF has no coordinates for it, and other vertices, so
// that attach() replaces geometry, by the names of nodes, and clones materials.
import * as THREE from 'three';

import { AtlasMap } from '../src/atlas.ts';
import { MATERIAL_TEXELS, type MeshShape, type SceneData } from '../src/geometry.ts';
import { LightKind } from '../src/package.ts';
import type { FromWorker, ToWorker } from '../src/protocol.ts';
import type { TileBatch } from '../src/replica.ts';
import { waitingText } from '../src/waiting.ts';
import { INTEREST_MAX, type Frame } from '../src/wire.ts';

/** UV channel of the lightmap: 'uv2', since a glTF uses up to two. */
const CHANNEL = 2;
const UPLOAD_MS = 3;
const INTEREST_MS = 200;
const NEVER = 255; // a level that no texel has

export interface AttachOptions {
  /** Draw the server's suns, points and spots as three's own lights with shadows, where it lets clients do
   * so, and emissive surfaces are not among them. Default true. */
  keyLights?: boolean;
  /** Side of their shadow maps, texels. Default 2048. */
  shadowMapSize?: number;
  /** worker.js of this package. Default: beside this file. */
  worker?: string | URL;
  /** For a server that wants one: 64 hexadecimal digits. */
  token?: string;
  /** What a person should know: the link is lost, comes back, or why there is no light yet ("Looking inside
   * objects: 42 %"); '' for all is well. */
  onState?: (text: string) => void;
  /** The same wait in numbers, for a bar of your own: a few times a second at most, from the scene's request
   * to the first light, the last time with 'ready'. Never, if there is light already. */
  onWaiting?: (waiting: LightwellWaiting) => void;
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

/** A lightmap: level 0 of an object's atlas, in which coarser tiles stand in for finer ones. */
interface Lightmap {
  texture: THREE.DataTexture;
  texels: Uint32Array;
  level: Uint8Array; // by texel: of the tile that it is from, NEVER: none
  width: number;
  height: number;
}

interface Placed {
  mesh: THREE.Mesh;
  lightmap: Lightmap | null;
  sphere: THREE.Sphere; // object space
  texels: number; // of level 0 to a unit of length
}

export class Lightwell {
  private readonly worker: Worker;
  private readonly placed: (Placed | null)[] = []; // by object
  private readonly lights: (THREE.Light | null)[] = []; // by light
  private map: AtlasMap | null = null;
  private queue: { batch: TileBatch; at: number; texel: number }[] = [];
  private interestMs = 0;
  private solveMs = 0;
  private frameMs = 0;
  private renderer: THREE.WebGLRenderer | null = null; // once it has drawn one of the meshes
  private ready: (() => void) | null = null;
  private failed: ((error: Error) => void) | null = null;
  /** Number of the server's newest frame that has come. */
  frame = 0;
  /** Names of nodes of the server's scene that the three.js scene does not have. */
  readonly missing: string[] = [];

  private constructor(
    private readonly root: THREE.Object3D,
    url: string,
    private readonly options: AttachOptions,
  ) {
    this.worker = new Worker(options.worker ?? new URL('./worker.js', import.meta.url), { type: 'module' });
    this.worker.onmessage = (event: MessageEvent<FromWorker>) => this.take(event.data);
    this.worker.onerror = (event) =>
      this.failed?.(new Error(`worker.js: ${event.message || 'it does not load'}`));
    if (options.token) this.tell({ kind: 'token', token: options.token });
    this.tell({ kind: 'connect', url, draws: options.keyLights ?? true, clusters: false });
  }

  /** Resolves once the scene has its first light. Rejects with one line if the server cannot be used. */
  static attach(scene: THREE.Object3D, url: string, options: AttachOptions = {}): Promise<Lightwell> {
    return new Promise((resolve, reject) => {
      const light: Lightwell = new Lightwell(scene, url, options);
      light.ready = () => resolve(light);
      light.failed = reject;
    });
  }

  /** Ends the session; what is there stays. */
  detach(): void {
    this.worker.terminate();
  }

  /** How old the light is, in seconds. While nothing changes it grows, though the light is right. */
  ageSeconds(): number {
    return (performance.now() - this.frameMs + this.solveMs) / 1000;
  }

  private tell(message: ToWorker): void {
    this.worker.postMessage(message);
  }

  private take(message: FromWorker): void {
    if (message.kind === 'token') this.failed?.(new Error('the server wants a token, or not this one'));
    else if (message.kind === 'state') {
      if (message.final) this.failed?.(new Error(message.text));
      this.options.onState?.(message.text);
    } else if (message.kind === 'waiting') {
      const { stage, share } = message.waiting;
      this.options.onWaiting?.({ stage: STAGES[stage] ?? 'other', share });
      this.options.onState?.(waitingText(message.waiting));
    } else if (message.kind === 'scene') this.takeScene(message.data, message.draws, message.clientLights);
    else if (message.kind === 'frame') this.takeFrame(message.frame, message.visible);
    else if (message.kind === 'tiles') {
      if (message.visible) this.setVisible(message.visible);
      this.queue.push({ batch: message.batch, at: 0, texel: 0 });
      if (!message.first || !this.ready) return;
      while (this.queue.length) this.takeTiles(Infinity);
      this.ready();
      this.ready = null;
    }
  }

  // ---- the scene ----

  private takeScene(data: SceneData, draws: boolean, clientLights: Uint8Array): void {
    this.map = new AtlasMap(data.meshes, data.objectMesh);
    this.queue = [];
    const nodes = new Map<string, THREE.Object3D>();
    this.root.traverse((node) => {
      // GLTFLoader changes some names, and keeps the file's here
      const name = (node.userData.name as string | undefined) ?? node.name;
      if (name && !nodes.has(name)) nodes.set(name, node);
    });
    const names = new Set(data.objectName);
    const geometries = new Map<number, THREE.BufferGeometry>();
    data.objectMesh.forEach((index, object) => {
      this.placed[object] = null;
      const node = nodes.get(data.objectName[object]!);
      if (!node) return void this.missing.push(data.objectName[object]!);
      const shape = data.meshes[index]!;
      if (!geometries.has(index)) geometries.set(index, geometryOf(data, shape));
      const placed = place(node, geometries.get(index)!, data, shape, names);
      this.placed[object] = placed;
      const before = placed.mesh.onBeforeRender;
      placed.mesh.onBeforeRender = (renderer, ...rest) => {
        this.renderer = renderer;
        before.call(placed.mesh, renderer, ...rest);
      };
    });
    this.placeLights(data, draws, clientLights);
  }

  /** Lights of the file are in the tiles, or else the server's. */
  private placeLights(data: SceneData, draws: boolean, clientLights: Uint8Array): void {
    this.root.traverse((node) => {
      const light = node as Partial<THREE.DirectionalLight & THREE.PointLight & THREE.SpotLight>;
      if (light.isDirectionalLight || light.isPointLight || light.isSpotLight) node.visible = false;
    });
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
      light.shadow!.mapSize.setScalar(this.options.shadowMapSize ?? 2048);
      light.shadow!.bias = -0.0005;
      light.shadow!.normalBias = 0.02;
      this.root.add(light);
      if ('target' in light) this.root.add(light.target);
      this.lights[i] = light;
    });
  }

  private takeFrame(frame: Frame, visible: Uint8Array | null): void {
    this.frameMs = performance.now();
    this.frame = Number(frame.frame);
    this.solveMs = frame.solveNs / 1e6;
    this.root.updateWorldMatrix(true, false);
    const rows = new THREE.Matrix4();
    frame.object.forEach((object, i) => {
      const placed = this.placed[object];
      if (!placed) return;
      const m = frame.transform.subarray(12 * i, 12 * i + 12) as unknown as number[];
      rows.set(
        m[0]!,
        m[1]!,
        m[2]!,
        m[3]!,
        m[4]!,
        m[5]!,
        m[6]!,
        m[7]!,
        m[8]!,
        m[9]!,
        m[10]!,
        m[11]!,
        0,
        0,
        0,
        1,
      );
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
        for (const each of placed ? materialsOf(placed.mesh) : []) {
          if (each.userData.lightwellMaterial !== material) continue;
          const standard = each as THREE.MeshStandardMaterial;
          standard.color?.fromArray(frame.baseColour, 3 * i);
          standard.emissive?.fromArray(frame.emission, 3 * i);
          standard.emissiveIntensity = 1;
        }
    });
    if (visible) this.setVisible(visible);
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
  }

  // ---- light ----

  /** Takes over light that has come, for 3 ms at most, and says what the camera sees. To be called once a
   * picture. height: of the picture, pixels. A page that never calls it gets no light after the first. */
  update(camera: THREE.Camera, height: number): void {
    const untilMs = performance.now() + UPLOAD_MS;
    while (this.queue.length && performance.now() < untilMs) this.takeTiles(untilMs);
    if (performance.now() - this.interestMs < INTEREST_MS || !this.map) return;
    this.interestMs = performance.now();
    this.tell({ kind: 'interest', ids: this.listInterest(camera, height) });
  }

  private takeTiles(untilMs: number): void {
    const first = this.queue[0]!;
    const { batch } = first;
    const from = first.at;
    do {
      const place = this.map!.place(batch.id[first.at]!);
      const size = place.width * place.height;
      const lightmap = this.placed[place.object]?.lightmap;
      if (lightmap) {
        takeTile(lightmap, place, batch.texels.subarray(first.texel, first.texel + size));
        this.upload(lightmap, place);
      }
      first.texel += size;
      first.at++;
    } while (first.at < batch.id.length && performance.now() < untilMs);
    if (first.at === batch.id.length) this.queue.shift();
    this.tell({ kind: 'taken', count: first.at - from });
  }

  /** A texture that the GPU has gets the tile alone; one that it has not, all of it with the next picture. */
  private upload(map: Lightmap, { level, x, y, width, height }: ReturnType<AtlasMap['place']>): void {
    const { renderer } = this;
    const kept = renderer?.properties.get(map.texture) as
      { __webglTexture?: WebGLTexture; __version?: number } | undefined;
    if (!renderer || !kept?.__webglTexture || kept.__version !== map.texture.version) {
      map.texture.needsUpdate = true;
      return;
    }
    const gl = renderer.getContext() as WebGL2RenderingContext;
    const [left, top] = [x << level, y << level];
    const [right, bottom] = [(x + width) << level, (y + height) << level];
    renderer.state.bindTexture(gl.TEXTURE_2D, kept.__webglTexture);
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
    const from = [
      [gl.UNPACK_ROW_LENGTH, map.width],
      [gl.UNPACK_SKIP_PIXELS, left],
      [gl.UNPACK_SKIP_ROWS, top],
    ] as const;
    for (const [name, value] of from) gl.pixelStorei(name, value);
    gl.texSubImage2D(
      gl.TEXTURE_2D,
      0,
      left,
      top,
      Math.min(map.width, right) - left,
      Math.min(map.height, bottom) - top,
      gl.RGB,
      gl.UNSIGNED_INT_5_9_9_9_REV,
      map.texels,
    );
    for (const [name] of from) gl.pixelStorei(name, 0);
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
    return Uint32Array.from(ids);
  }
}

/** Puts a tile into level 0, unless a finer one is there. */
function takeTile(map: Lightmap, place: ReturnType<AtlasMap['place']>, texels: Uint32Array): void {
  const { level, x, y, width, height } = place;
  const right = Math.min(map.width, (x + width) << level);
  const bottom = Math.min(map.height, (y + height) << level);
  for (let row = y << level; row < bottom; row++) {
    const from = ((row >> level) - y) * width - x;
    for (let at = row * map.width + (x << level), column = x << level; column < right; column++, at++) {
      if (map.level[at]! < level) continue;
      map.level[at] = level;
      map.texels[at] = texels[from + (column >> level)]!;
    }
  }
}

function materialsOf(mesh: THREE.Mesh): THREE.Material[] {
  return Array.isArray(mesh.material) ? mesh.material : [mesh.material];
}

/** A mesh of the package. Double-sided triangles are there twice, as their backs have light of their own. */
function geometryOf(data: SceneData, shape: MeshShape): THREE.BufferGeometry {
  const { firstVertex, vertexCount, atlasWidth, atlasHeight, backOffset } = shape;
  const sides = shape.groups.some((group) => group.doubleSided) ? 2 : 1;
  const geometry = new THREE.BufferGeometry();
  const put = (
    name: string,
    from: ArrayLike<number> | null,
    width: number,
    stride: number,
    value?: (x: number, k: number, back: boolean) => number,
  ) => {
    if (!from) return;
    const values = new Float32Array(width * vertexCount * sides);
    for (let side = 0, at = 0; side < sides; side++)
      for (let v = firstVertex; v < firstVertex + vertexCount; v++)
        for (let k = 0; k < width; k++, at++) {
          const x = from[stride * v + k]!;
          values[at] = value ? value(x, k, side === 1) : x;
        }
    geometry.setAttribute(name, new THREE.BufferAttribute(values, width));
  };
  put('position', data.position, 3, 3);
  put('normal', data.normal, 3, 4, (x, _, back) => (back ? -x : x) / 127);
  put('uv', data.uv[0], 2, 2);
  put('uv1', data.uv[1], 2, 2);
  put('color', data.colour, 4, 4);
  const sizes = [atlasWidth || 1, atlasHeight || 1];
  put('uv2', data.lightmapUv, 2, 2, (x, k, back) => (x + (back && k === 1 ? backOffset : 0)) / sizes[k]!);
  // by material, so that each has a group
  const corners = new Map<number, number[]>();
  for (const group of shape.groups)
    for (let i = group.first; i < group.first + group.count; i += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => data.index[i + k]! - firstVertex) as [number, number, number];
      const material = data.tag[firstVertex + a]! & 0xffff;
      if (!corners.has(material)) corners.set(material, []);
      corners.get(material)!.push(a, b, c);
      if (group.doubleSided) corners.get(material)!.push(vertexCount + a, vertexCount + c, vertexCount + b);
    }
  const index: number[] = [];
  const materials: number[] = [];
  for (const [material, list] of corners) {
    geometry.addGroup(index.length, list.length, materials.length);
    materials.push(material);
    for (const corner of list) index.push(corner);
  }
  geometry.setIndex(index);
  geometry.userData.materials = materials;
  return geometry;
}

function isUnlit(data: SceneData, material: number): boolean {
  return data.materials[4 * MATERIAL_TEXELS * (material + 1) - 1] === 1;
}

/** Puts a mesh of the package in the place of a node's own. names: of all nodes with meshes. */
function place(
  node: THREE.Object3D,
  geometry: THREE.BufferGeometry,
  data: SceneData,
  shape: MeshShape,
  names: Set<string>,
): Placed {
  // a mesh of several primitives is a group of as many meshes
  const isOwn = (child: THREE.Object3D) =>
    (child as Partial<THREE.Mesh>).isMesh &&
    !names.has((child.userData.name as string | undefined) ?? child.name);
  const own = ((node as Partial<THREE.Mesh>).isMesh ? [node] : node.children.filter(isOwn)) as THREE.Mesh[];
  const originals = own.flatMap(materialsOf);
  const lightmap = lightmapOf(shape);
  const materials = (geometry.userData.materials as number[]).map((index) => {
    const name = data.materialName[index]!;
    const original = originals.find((material) => material.name === name) ?? originals[0];
    const unlit = isUnlit(data, index);
    const none = unlit ? new THREE.MeshBasicMaterial() : new THREE.MeshStandardMaterial();
    const material = (original ?? none).clone() as THREE.MeshStandardMaterial;
    material.userData.lightwellMaterial = index;
    material.lightMap = unlit ? null : (lightmap?.texture ?? null);
    material.lightMapIntensity = data.lightUnit;
    material.side = THREE.FrontSide; // backs are triangles of their own
    material.vertexColors = !!data.colour;
    return material;
  });
  const mesh = own[0] ?? new THREE.Mesh();
  mesh.geometry = geometry;
  mesh.material = materials.length === 1 ? materials[0]! : materials;
  mesh.castShadow = mesh.receiveShadow = true;
  for (const rest of own.slice(1)) rest.removeFromParent();
  if (!own.length) node.add(mesh);
  const sphere = new THREE.Sphere(new THREE.Vector3(...shape.centre), shape.radius);
  return { mesh, lightmap, sphere, texels: density(data, shape) };
}

/** Texels of level 0 to a unit of length, in the mean. */
function density(data: SceneData, shape: MeshShape): number {
  let [area, texels] = [0, 0];
  const [p, q, r] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3()];
  for (const group of shape.groups)
    for (let i = group.first; i < group.first + group.count; i += 3) {
      const [a, b, c] = [data.index[i]!, data.index[i + 1]!, data.index[i + 2]!];
      p.fromArray(data.position, 3 * a);
      q.fromArray(data.position, 3 * b).sub(p);
      r.fromArray(data.position, 3 * c).sub(p);
      area += q.cross(r).length();
      const uv = data.lightmapUv;
      const [u, v] = [uv[2 * a]!, uv[2 * a + 1]!];
      texels += Math.abs((uv[2 * b]! - u) * (uv[2 * c + 1]! - v) - (uv[2 * b + 1]! - v) * (uv[2 * c]! - u));
    }
  return area > 0 ? Math.sqrt(texels / area) : 0;
}

function lightmapOf(shape: MeshShape): Lightmap | null {
  const { atlasWidth: width, atlasHeight: height } = shape;
  if (!width || !height) return null;
  const texels = new Uint32Array(width * height);
  const texture = new THREE.DataTexture(
    texels as unknown as BufferSource,
    width,
    height,
    THREE.RGBFormat,
    THREE.UnsignedInt5999Type,
  );
  texture.internalFormat = 'RGB9_E5';
  texture.magFilter = texture.minFilter = THREE.LinearFilter;
  texture.generateMipmaps = false;
  texture.flipY = false;
  texture.colorSpace = THREE.NoColorSpace;
  texture.channel = CHANNEL;
  return { texture, texels, level: new Uint8Array(width * height).fill(NEVER), width, height };
}
