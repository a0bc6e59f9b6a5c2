// bent_wall.mjs: a small glTF with a closed form: a wall with one bent normal everywhere, under a lamp.

/** The wall's own space: it spans x and y from -1 to 1, and faces z. */
const place = [0.7, -0.4, 1.2];
const intensity = 20; // W/sr
export const albedo = 0.5;
const texel = [180, 100, 214]; // the normal map's only one
const PNG =
  'iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGPYknINAAO+Ae9w7/3IAAAAAElFTkSuQmCC';

const unit = (v) => v.map((x) => x / Math.hypot(...v));
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
/** 34 degrees from the plain normal. */
const bentNormal = unit(texel.map((c) => (c / 255) * 2 - 1));

/** At a place of the wall: irradiance of the plain normal, and cosines of both normals to the lamp. */
export function lightAt(x, y) {
  const way = [place[0] - x, place[1] - y, place[2]];
  const d = unit(way);
  return { e: (intensity * d[2]) / dot(way, way), plain: d[2], bent: dot(d, bentNormal) };
}

/** The wall hangs aslant, so that the world's axes are not its own. lamp: false: there is none. */
export function bentWall({ lamp = true } = {}) {
  const corners = [
    [-1, 1, 0],
    [1, 1, 0],
    [-1, -1, 0],
    [1, -1, 0],
  ];
  const normals = corners.map(() => [0, 0, 1]);
  const uv = [0, 0, 1, 0, 0, 1, 1, 1];
  const floats = Float32Array.of(...corners.flat(), ...normals.flat(), ...uv);
  const bytes = Buffer.concat([floats, Uint16Array.of(0, 2, 1, 1, 2, 3)].map((a) => Buffer.from(a.buffer)));
  const accessor = (bufferView, componentType, count, type) => ({ bufferView, componentType, count, type });
  return JSON.stringify({
    asset: { version: '2.0' },
    extensionsUsed: ['KHR_lights_punctual'],
    extensions: { KHR_lights_punctual: { lights: [{ type: 'point', name: 'lamp', intensity }] } },
    scene: 0,
    scenes: [{ nodes: [0] }],
    nodes: [
      {
        name: 'wall',
        mesh: 0,
        rotation: unit([0.3, -0.5, 0.2, 0.8]),
        translation: [2, 1, -3],
        ...(lamp && { children: [1] }),
      },
      { name: 'lamp', translation: place, extensions: { KHR_lights_punctual: { light: 0 } } },
    ],
    meshes: [
      { primitives: [{ attributes: { POSITION: 0, NORMAL: 1, TEXCOORD_0: 2 }, indices: 3, material: 0 }] },
    ],
    materials: [
      {
        name: 'wall',
        pbrMetallicRoughness: {
          baseColorFactor: [albedo, albedo, albedo, 1],
          metallicFactor: 0,
          roughnessFactor: 1,
        },
        normalTexture: { index: 0 },
      },
    ],
    textures: [{ source: 0 }],
    images: [{ uri: `data:image/png;base64,${PNG}` }],
    accessors: [
      { ...accessor(0, 5126, 4, 'VEC3'), min: [-1, -1, 0], max: [1, 1, 0] },
      accessor(1, 5126, 4, 'VEC3'),
      accessor(2, 5126, 4, 'VEC2'),
      accessor(3, 5123, 6, 'SCALAR'),
    ],
    bufferViews: [
      { buffer: 0, byteLength: 48 },
      { buffer: 0, byteOffset: 48, byteLength: 48 },
      { buffer: 0, byteOffset: 96, byteLength: 32 },
      { buffer: 0, byteOffset: 128, byteLength: 12 },
    ],
    buffers: [
      { uri: `data:application/octet-stream;base64,${bytes.toString('base64')}`, byteLength: bytes.length },
    ],
  });
}
