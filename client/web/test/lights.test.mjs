// Lights that the page draws: which triangles are a lamp and how bright it is, and which shadow maps are
// drawn again.
import assert from 'node:assert/strict';
import test from 'node:test';

import { load } from './load.mjs';

const { Clusters, fitsMaps, Lights, MAP_SIDE, LightKind } = await load('clusters', 'lights', 'package');
const NONE = 0xffffffff;

const use = { texture: NONE, uvSet: 0, transform: Float32Array.of(1, 0, 0, 0, 1, 0) };
const material = (...emission) => ({
  name: '',
  baseColour: Float32Array.of(1, 1, 1, 1),
  emission: Float32Array.from(emission),
  alphaCutoff: 0.5,
  base: use,
  glow: use,
  alphaMode: 0,
  doubleSided: false,
});

/** A square of side s about (x, y, z) that faces down, of two triangles. */
function square(x, y, z, s, index) {
  const corners = [
    [-1, -1],
    [1, -1],
    [1, 1],
    [-1, 1],
  ].map(([a, b]) => [x + (a * s) / 2, y, z + (b * s) / 2]);
  return {
    position: Float32Array.from(corners.flat()),
    triangle: Uint32Array.of(0, 1, 2, 0, 2, 3),
    material: Uint32Array.of(index, index),
    uv: [null, null],
  };
}

function sceneOf(...meshes) {
  return {
    meshes,
    materials: [material(10, 10, 10), material(0, 0, 0)],
    textures: [],
    nodes: meshes.map(() => ({
      parent: NONE,
      matrix: Float32Array.of(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0),
    })),
    objectMesh: Uint32Array.from(meshes.keys()),
    objectNode: Uint32Array.from(meshes.keys()),
    channels: [],
    durationS: 0,
  };
}

const nothing = { object: [], hidden: [], shown: [], material: [], light: [] };
const near = (a, b, most) => assert.ok(Math.abs(a - b) <= most, `${a}, not ${b}`);
const down = Math.floor(MAP_SIDE / 2) * MAP_SIDE + Math.floor(MAP_SIDE / 2); // +z; the axes are below
const at = (x, y) => y * MAP_SIDE + x;
const MIDDLE = (MAP_SIDE - 1) / 2;

test('a panel shines by the cosine, and not to its back', () => {
  const clusters = new Clusters(sceneOf(square(1, 2, 3, 0.5, 0)), Uint8Array.of(1));
  assert.equal(clusters.count(), 1);
  const [lamp] = clusters.take();
  lamp.centre.forEach((x, k) => near(x, [1, 2, 3][k], 1e-6));
  near(lamp.radius, Math.hypot(0.25, 0.25), 1e-6);
  near(lamp.intensity, 10 * 0.25, 0.03); // L A, and the map's gain
  lamp.colour.forEach((x) => near(x, 1, 1e-6));
  near(lamp.shapes[at(MIDDLE, 0)], 2.5, 0.03); // -y
  assert.equal(lamp.shapes[at(MIDDLE, MAP_SIDE - 1)], 0); // +y
  near(lamp.shapes[down], 0, 1e-6); // +z, along it
  assert.equal(clusters.take(), null, 'nothing is new');
});

/** The direction of a place in the map, in steps. */
function direction(column, row) {
  const [a, b] = [column / MIDDLE - 1, row / MIDDLE - 1];
  const z = 1 - Math.abs(a) - Math.abs(b);
  const d = z < 0 ? [(1 - Math.abs(b)) * Math.sign(a), (1 - Math.abs(a)) * Math.sign(b), z] : [a, b, z];
  return d.map((x) => x / Math.hypot(...d));
}

test('between its values the map is right in the mean', () => {
  const [lamp] = new Clusters(sceneOf(square(0, 2, 0, 0.5, 0)), Uint8Array.of(1)).take();
  let [is, should] = [0, 0];
  for (let y = 0.05; y < 2 * MIDDLE; y += 0.1)
    for (let x = 0.05; x < 2 * MIDDLE; x += 0.1) {
      const [i, j] = [Math.floor(x), Math.floor(y)];
      const [u, v] = [x - i, y - j];
      const row = (k) => (1 - u) * lamp.shapes[at(i, k)] + u * lamp.shapes[at(i + 1, k)];
      is += (1 - v) * row(j) + v * row(j + 1);
      should += 2.5 * Math.max(0, -direction(x, y)[1]);
    }
  near(is / should, 1, 1e-3);
});

test('what stands close takes light away, and gives it back when it leaves', () => {
  const clusters = new Clusters(sceneOf(square(0, 2, 0, 0.5, 0), square(0, 1.9, 0, 1, 1)), Uint8Array.of(1));
  const [lamp] = clusters.take();
  assert.equal(lamp.shapes[at(MIDDLE, 0)], 0);
  near(lamp.shapes[MAP_SIDE * MAP_SIDE + at(MIDDLE, 0)], 2.5, 0.03); // the same without it
  const away = { ...nothing, object: [1], transform: Float32Array.of(1, 0, 0, 9, 0, 1, 0, 0, 0, 0, 1, 0) };
  clusters.takeFrame(away);
  near(clusters.take()[0].shapes[at(MIDDLE, 0)], 2.5, 0.03);
  clusters.takeFrame(away);
  assert.equal(clusters.take(), null);
  clusters.takeFrame({
    ...nothing,
    object: [1],
    transform: Float32Array.of(1, 0, 0, 8, 0, 1, 0, 0, 0, 0, 1, 0),
  });
  assert.equal(clusters.take(), null, 'far away is no matter');
  clusters.takeFrame({ ...nothing, material: [0], emission: Float32Array.of(20, 20, 20) });
  near(clusters.take()[0].intensity, 5, 0.06);
  clusters.takeFrame({ ...nothing, hidden: [0] });
  assert.equal(clusters.take()[0].intensity, 0);
});

test('pieces of one object that lie close together are one lamp', () => {
  const both = (a, b) => ({
    ...a,
    position: Float32Array.of(...a.position, ...b.position),
    triangle: Uint32Array.of(...a.triangle, ...b.triangle.map((i) => i + 4)),
    material: Uint32Array.of(...a.material, ...b.material),
  });
  const count = (...meshes) => new Clusters(sceneOf(...meshes), Uint8Array.of(1)).count();
  assert.equal(count(both(square(0.1, 2, 0.1, 0.1, 0), square(0.3, 2, 0.3, 0.1, 0))), 1);
  assert.equal(count(both(square(0.1, 2, 0.1, 0.1, 0), square(1.3, 2, 0.3, 0.1, 0))), 2);
  assert.equal(count(square(0.1, 2, 0.1, 0.1, 0), square(0.3, 2, 0.3, 0.1, 0)), 2, 'two objects are two');
});

test('more lights than there are maps', () => {
  const lights = (kind, count) => Array.from({ length: count }, () => ({ kind }));
  const all = Uint8Array.of(255, 255, 255);
  const { DIRECTIONAL, POINT } = LightKind;
  assert.ok(fitsMaps(lights(DIRECTIONAL, 2), all, 16));
  assert.ok(!fitsMaps(lights(DIRECTIONAL, 3), all, 0));
  assert.ok(!fitsMaps(lights(POINT, 1), all, 16));
  assert.ok(fitsMaps(lights(POINT, 17), Uint8Array.of(255, 255, 0), 0));
  assert.ok(!fitsMaps(lights(POINT, 17), all, 0));
});

const gl = new Proxy({}, { get: (_, name) => (/^[A-Z]/.test(name) ? 0 : () => ({})) });
const view = { position: [0, 1, 0], right: [1, 0, 0], up: [0, 1, 0], forward: [0, 0, -1], fovY: 1 };
const scene = { low: [-8, 0, -8], high: [8, 8, 8] };
const kinds = [
  { kind: LightKind.POINT },
  { kind: LightKind.DIRECTIONAL, angularDiameter: 0.01 },
  { kind: LightKind.SPOT, innerCone: 0.3, outerCone: 0.5 },
];
const lit = (index, position, direction) => ({
  ...nothing,
  light: [index],
  lightPosition: Float32Array.from(position),
  lightDirection: Float32Array.from(direction),
  lightIntensity: Float32Array.of(5, 5, 5),
});

function lightsOf(drawn) {
  const lights = new Lights(gl, kinds, Uint8Array.of(drawn), 0, true);
  lights.takeFrame(lit(0, [0, 4, 0], [0, -1, 0]));
  lights.takeFrame(lit(1, [0, 0, 0], [0, -0.8, 0.6]));
  lights.takeFrame(lit(2, [3, 4, 0], [0, -1, 0]));
  return lights;
}

/** Pictures until all maps are drawn; returns those of each picture. */
function pictures(lights, from = view, box = scene) {
  const all = [];
  for (;;) {
    const maps = lights.choose(from, box);
    if (!maps.length) return all;
    for (const map of maps) map.dirty = false;
    all.push(maps);
  }
}

const drawn = (...args) => pictures(...args).flat();

test('maps are drawn again only where something has moved', () => {
  const lights = lightsOf(7);
  assert.equal(lights.count(), 3);
  assert.equal(drawn(lights).length, 3 + 6 + 6);
  assert.equal(drawn(lights).length, 0);

  // a box beside the point light, at its height: one side of its cube, one of the spot's, and the sun's
  lights.touch({ low: [-4.1, 3.9, -0.1], high: [-3.9, 4.1, 0.1] });
  const maps = drawn(lights);
  assert.deepEqual(
    maps.filter((map) => !map.sun).map((map) => map.layer),
    [1, 7],
  );
  assert.ok(maps.some((map) => map.sun && map.layer === 2));

  lights.takeFrame(lit(0, [0, 4, 0.5], [0, -1, 0]));
  assert.equal(drawn(lights).length, 6);
  lights.takeFrame(lit(1, [0, 0, 0], [0, -0.6, 0.8]));
  assert.equal(drawn(lights).length, 3);
  lights.takeFrame({ ...lit(2, [3, 4, 0], [0, -1, 0]), lightIntensity: Float32Array.of(1, 2, 3) });
  assert.equal(drawn(lights).length, 0, 'dimmed, not moved');
});

test('a new light gets a map with each picture, and shines once it has all', () => {
  const lights = lightsOf(7);
  const shown = [];
  const box = { low: [-1, 0, -1], high: [1, 1, 1] };
  for (let picture = 0; picture < 15; picture++) {
    const maps = lights.choose(view, scene);
    assert.equal(maps.length, 1);
    shown.push(lights.near(box, 0.01).length);
    maps[0].dirty = false;
  }
  // a sun's three, then six of each lamp
  assert.deepEqual(shown, [...Array(3).fill(0), ...Array(6).fill(1), ...Array(6).fill(2)]);
  assert.deepEqual(lights.near(box, 0.01), [0, 1, 2]);
  assert.deepEqual(lights.shining(), { shown: 3, pending: 0 });

  // one that moves goes on shining, and gets all of its maps at once
  lights.takeFrame(lit(0, [0, 4, 0.5], [0, -1, 0]));
  assert.equal(lights.choose(view, scene).length, 6);
  // one that is off waits for none
  lights.takeFrame({ ...lit(2, [5, 4, 0], [0, -1, 0]), lightIntensity: new Float32Array(3) });
  assert.deepEqual(lights.shining(), { shown: 2, pending: 0 });
});

test('the smaller maps of a sun follow the eye in steps', () => {
  const lights = lightsOf(2);
  drawn(lights);
  assert.equal(drawn(lights, { ...view, position: [0.01, 1, 0] }).length, 0);
  const far = drawn(lights, { ...view, position: [6, 1, 0] }).map((map) => map.layer);
  assert.deepEqual(far, [0, 1]);
});

test('lights that give too little to be seen are left out', () => {
  const lights = lightsOf(7);
  drawn(lights);
  const box = { low: [-1, 0, -1], high: [1, 1, 1] };
  assert.deepEqual(lights.near(box, 0.01), [0, 1, 2]);
  assert.deepEqual(lights.near(box, 5 / 9.01), [0, 1]); // the spot is farther away than the point
  assert.deepEqual(lights.near(box, 100), [0]);
});
