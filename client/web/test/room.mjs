// room.mjs: a small glTF: a room with coloured walls, a box and a panel that turns nothing, a lamp and
// emissive glass.

const boxFaces = [
  [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ],
  [
    [0, 1, 0],
    [0, 0, 1],
    [1, 0, 0],
  ],
  [
    [0, 0, 1],
    [1, 0, 0],
    [0, 1, 0],
  ],
];

/** Both ends of the three axes; inward: seen from inside. */
function box(inward) {
  const [position, normal, index] = [[], [], []];
  for (const [n, u, v] of boxFaces)
    for (const side of [1, -1]) {
      const first = position.length / 3;
      for (const [a, b] of [
        [-1, -1],
        [1, -1],
        [1, 1],
        [-1, 1],
      ])
        for (let k = 0; k < 3; k++) position.push(0.5 * (side * n[k] + a * u[k] + b * v[k]));
      for (let corner = 0; corner < 4; corner++)
        normal.push(...n.map((x) => (inward ? -side : side) * x + 0));
      const order = side > 0 === !inward ? [0, 1, 2, 0, 2, 3] : [0, 2, 1, 0, 3, 2];
      index.push(...order.map((i) => first + i));
    }
  return { position, normal, index };
}

/** Where the lamp is at the beginning, and a second later if it moves. */
export const lampWay = [
  [0.6, 2.4, 0.4],
  [-1, 2.2, 1.2],
];

/** outside: it has no ceiling, a sun shines in, and the lamp moves.
 *  turned: box and shelf show their double-sided backs, as sofas of some programs do.
 *  unlit: so is the shelf.
 *  smooth: the box is bronze, a wall varnished, the shelf and the other wall glossy. */
export function room({ outside = false, turned = false, unlit = false, smooth = false } = {}) {
  const bytes = [];
  const gltf = {
    asset: { version: '2.0' },
    extensionsUsed: ['KHR_lights_punctual'],
    extensions: {
      KHR_lights_punctual: {
        lights: [
          {
            type: 'point',
            name: 'lamp',
            color: [1, 0.8, 0.6],
            intensity: 6,
            extras: { lightwell: { clientLight: true } },
          },
        ],
      },
    },
    scene: 0,
    scenes: [{ nodes: [0, 1, 2, 3] }],
    nodes: [
      { name: 'the room', mesh: 0, scale: [4, 3, 5], translation: [0, 1.5, 0] },
      {
        name: 'box',
        mesh: 1,
        scale: [1, 1.2, 1],
        translation: [-0.6, 0.6, -0.8],
        rotation: [0, 0.2588, 0, 0.9659],
      },
      { name: 'shelf', mesh: 2, scale: [1.4, 0.1, 0.6], translation: [1.2, 1.2, -1.5], children: [] },
      { name: 'lamp', translation: lampWay[0], extensions: { KHR_lights_punctual: { light: 0 } } },
    ],
    materials: [
      {
        name: 'wall',
        pbrMetallicRoughness: { baseColorFactor: [0.7, 0.65, 0.6, 1], metallicFactor: 0, roughnessFactor: 1 },
      },
      {
        name: 'red',
        pbrMetallicRoughness: { baseColorFactor: [0.7, 0.1, 0.05, 1], metallicFactor: 0, roughnessFactor: 1 },
      },
      {
        name: 'green',
        doubleSided: true,
        pbrMetallicRoughness: { baseColorFactor: [0.1, 0.5, 0.2, 1], metallicFactor: 0, roughnessFactor: 1 },
      },
    ],
    meshes: [],
    accessors: [],
    bufferViews: [],
  };
  const accessor = (values, type, width) => {
    const array = type === 5126 ? new Float32Array(values) : new Uint16Array(values);
    while (bytes.length % 4) bytes.push(0);
    gltf.bufferViews.push({ buffer: 0, byteOffset: bytes.length, byteLength: array.byteLength });
    bytes.push(...new Uint8Array(array.buffer));
    const ends = (pick) =>
      Array.from({ length: width }, (_, k) => pick(...values.filter((_, i) => i % width === k)));
    const bounds = width === 3 ? { min: ends(Math.min), max: ends(Math.max) } : {};
    const name = ['SCALAR', '', '', 'VEC3'][width === 3 ? 3 : 0];
    gltf.accessors.push({
      bufferView: gltf.bufferViews.length - 1,
      componentType: type,
      count: values.length / width,
      type: name,
      ...bounds,
    });
    return gltf.accessors.length - 1;
  };
  const mesh = (name, { position, normal, index }, cuts) => {
    const attributes = { POSITION: accessor(position, 5126, 3), NORMAL: accessor(normal, 5126, 3) };
    const primitives = cuts.map(([material, from, to]) => ({
      attributes,
      material,
      indices: accessor(index.slice(from, to), 5123, 1),
    }));
    gltf.meshes.push({ name, primitives });
  };
  // faces +x, -x, then the others
  mesh('walls', box(true), [
    [1, 0, 6],
    [2, 6, 12],
    [0, outside ? 18 : 12, 36],
  ]);
  mesh('block', box(turned), [[turned ? 2 : 0, 0, 36]]);
  mesh('board', box(turned), [[2, 0, 36]]);
  if (outside) {
    gltf.extensions.KHR_lights_punctual.lights.push({
      type: 'directional',
      name: 'sun',
      color: [1, 0.95, 0.9],
      intensity: 1,
      extras: { lightwell: { clientLight: true } },
    });
    gltf.scenes[0].nodes.push(gltf.nodes.length);
    // from behind the eye and the right, steeply down
    gltf.nodes.push({
      name: 'sun',
      rotation: [-0.5, 0.15, 0, 0.85].map((x) => x / Math.hypot(0.5, 0.15, 0.85)),
      extensions: { KHR_lights_punctual: { light: 1 } },
    });
    const lamp = gltf.nodes.findIndex(({ name }) => name === 'lamp');
    const sampler = { input: accessor([0, 1], 5126, 1), output: accessor(lampWay.flat(), 5126, 3) };
    gltf.animations = [
      { samplers: [sampler], channels: [{ sampler: 0, target: { node: lamp, path: 'translation' } }] },
    ];
    const times = gltf.accessors[sampler.input];
    [times.min, times.max] = [[0], [1]];
  }
  if (unlit) {
    gltf.extensionsUsed.push('KHR_materials_unlit');
    gltf.meshes[2].primitives[0].material = gltf.materials.length;
    gltf.materials.push({ ...gltf.materials[2], name: 'sign', extensions: { KHR_materials_unlit: {} } });
  }
  if (smooth) {
    const finish = (i, metallicFactor, roughnessFactor) =>
      Object.assign(gltf.materials[i].pbrMetallicRoughness, { metallicFactor, roughnessFactor });
    finish(1, 0, 0.4);
    finish(2, 0, 0.2);
    gltf.meshes[1].primitives[0].material = gltf.materials.length;
    const bronze = { baseColorFactor: [0.8, 0.5, 0.25, 1], metallicFactor: 1, roughnessFactor: 0.35 };
    gltf.materials.push({ name: 'bronze', pbrMetallicRoughness: bronze });
  }
  gltf.buffers = [
    {
      byteLength: bytes.length,
      uri: `data:application/octet-stream;base64,${Buffer.from(bytes).toString('base64')}`,
    },
  ];
  return JSON.stringify(gltf);
}
