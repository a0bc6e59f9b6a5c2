// The page's view: keys by time, keys that are for something else, and what a scene without a camera shows.
import assert from 'node:assert/strict';
import test from 'node:test';

import { load } from './load.mjs';

globalThis.Element = class {};
globalThis.window = new EventTarget();
const { findBody, Flight, frameBox, dot, add } = await load('body', 'camera');
const NONE = 0xffffffff;

/** What keys do to a view at a speed of 1 m/s. */
function flight() {
  globalThis.window = new EventTarget();
  const pressed = [];
  const element = Object.assign(new EventTarget(), { style: {} });
  const it = new Flight(element, (key) => pressed.push(key));
  it.step(0);
  const send = (type, ms, code, key = 'w', target = null) => {
    const event = Object.assign(new Event(type), { code, key });
    Object.defineProperties(event, { timeStamp: { value: ms }, target: { value: target } });
    window.dispatchEvent(event);
  };
  const at = () => -it.view.position[2];
  return { it, pressed, send, at };
}

const near = (a, b) => assert.ok(Math.abs(a - b) < 1e-9, `${a}, not ${b}`);

test('a key moves by the time that it is held, however few pictures that were', () => {
  const { it, send, at } = flight();
  send('keydown', 100, 'KeyW');
  assert.ok(it.step(200));
  near(at(), 0.1);
  it.step(900); // one picture in 0.7 s
  near(at(), 0.8);
  send('keyup', 1000, 'KeyW');
  it.step(5000);
  near(at(), 0.9);
  assert.equal(it.step(6000), false);
  // pressed and let go between two pictures
  send('keydown', 6100, 'KeyW');
  send('keyup', 6150, 'KeyW');
  it.step(6200);
  near(at(), 0.95);
  // twice between two pictures
  for (const ms of [6300, 6400]) {
    send('keydown', ms, 'KeyS');
    send('keyup', ms + 50, 'KeyS');
  }
  it.step(6500);
  near(at(), 0.85);
  // an event that is newer than the picture's time
  send('keydown', 7000, 'KeyW');
  it.step(6990);
  it.step(7010);
  near(at(), 0.86);
});

test('a page that stood still for long moves no more than a second', () => {
  const { it, send, at } = flight();
  send('keydown', 0, 'KeyW');
  send('keydown', 0, 'ShiftLeft', 'Shift');
  it.step(60000);
  near(at(), 4);
});

test('letters are the same with Caps Lock', () => {
  const { pressed, send } = flight();
  for (const key of ['X', 'x', 'P', '+']) send('keydown', 0, 'KeyX', key);
  assert.deepEqual(pressed, ['x', 'x', 'p', '+']);
});

test('arrows move what has the focus, and text is typed', () => {
  const element = (...names) =>
    Object.assign(new Element(), { matches: (list) => names.some((name) => list.split(', ').includes(name)) });
  const slider = element('input');
  const text = element('input', 'input:not([type=range])');
  const list = element('select');
  const { it, pressed, send, at } = flight();
  for (const [code, key] of [
    ['ArrowUp', 'ArrowUp'],
    ['PageDown', 'PageDown'],
    ['Home', 'Home'],
  ])
    for (const target of [slider, list]) send('keydown', 0, code, key, target);
  for (const target of [text, list]) send('keydown', 0, 'KeyX', 'x', target);
  it.step(100);
  near(at(), 0);
  assert.deepEqual(pressed, []);
  send('keydown', 100, 'KeyW', 'w', slider); // no slider wants letters
  send('keydown', 100, 'ArrowUp', 'ArrowUp', element('button'));
  it.step(200);
  near(at(), 0.1);
});

/** How much of the picture's width or height a box takes, whichever is more; all of it must be in it. */
function extentOf(view, aspect, low, high) {
  const tangent = Math.tan(view.fovY / 2);
  const seen = [0, 1, 2, 3, 4, 5, 6, 7].map((i) => {
    const corner = [0, 1, 2].map((k) => (i & (1 << k) ? high : low)[k]);
    const to = add(corner, view.position, -1);
    const depth = dot(to, view.forward);
    assert.ok(depth > 0);
    return [dot(to, view.right) / (depth * tangent * aspect), dot(to, view.up) / (depth * tangent)];
  });
  const ends = [0, 1].map((axis) => seen.map((place) => place[axis]));
  assert.ok(ends.flat().every((x) => Math.abs(x) < 1));
  return Math.max(...ends.map((values) => (Math.max(...values) - Math.min(...values)) / 2));
}

test('a box is framed as near as it fits, at any aspect', () => {
  const boxes = [
    [[-1, 0, -1], [1, 2, 1]],
    [[0, 0, 0], [20, 0.1, 4]],
    [[99, 50, 7], [99.001, 90, 7.001]],
  ]; // prettier-ignore
  for (const [low, high] of boxes)
    for (const aspect of [0.5, 1, 16 / 9, 3]) {
      const extent = extentOf(frameBox(low, high, aspect), aspect, low, high);
      assert.ok(extent > 0.8, `${extent} at ${aspect}`);
    }
});

const identity = (x, y, z) => Float32Array.of(1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, z);

/** Squares of 1 m, `side` metres wide each, at places. */
function sceneOf(squares, channels = []) {
  const corners = [-1, 0, -1, 1, 0, -1, 1, 0, 1, -1, 0, 1].map((x) => x / 2);
  return {
    meshes: squares.map(({ side = 1 }) => ({
      position: Float32Array.from(corners, (x) => x * side),
      triangle: Uint32Array.of(0, 1, 2, 0, 2, 3),
      triangleCount: 2,
    })),
    nodes: squares.map(({ at }) => ({ parent: NONE, matrix: identity(...at) })),
    objectMesh: Uint32Array.from(squares.keys()),
    objectNode: Uint32Array.from(squares, ({ spare }, i) => (spare ? NONE : i)),
    channels,
    durationS: 0,
  };
}

test('what stands on wide ground is found', () => {
  const things = Array.from({ length: 60 }, (_, i) => ({ at: [10 + (i % 8), i % 3, 5 + (i >> 3)] }));
  const scene = sceneOf([{ at: [0, 0, 0], side: 1000 }, ...things]);
  const { low, high } = findBody(scene);
  assert.ok(low[0] > 8 && high[0] < 20 && low[2] > 3 && high[2] < 15, `${low} ${high}`);
  assert.ok(low[0] <= 9.5 && high[0] >= 17.5);
});

test('neither spares nor what moves belongs to the body', () => {
  const scene = sceneOf([{ at: [0, 0, 0] }, { at: [50, 0, 0] }, { at: [90, 0, 0], spare: true }], [{ node: 1 }]);
  const { low, high } = findBody(scene);
  assert.ok(low[0] > -1 && high[0] < 1, `${low} ${high}`);
  assert.equal(findBody(sceneOf([{ at: [0, 0, 0] }], [{ node: 0 }])), null);
});
