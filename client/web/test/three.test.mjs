// lightwell-three: a three.js page's picture of a glTF against lightwell-view's, of the same light.
import assert from 'node:assert/strict';
import { existsSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test from 'node:test';

import { bin, hasDaemon, startDaemon } from './daemon.mjs';
import { serveExample } from './example.mjs';
import { web } from './load.mjs';
import { checkUploads, compare, hasBrowser, pictureName, pixelsOf, reference, until } from './page.mjs';
import { lampWay, room } from './room.mjs';
import { withPage } from './shared.mjs';

const WIDTH = 320;
const HEIGHT = 180;
const FRAMES = 8;
const missing =
  !hasDaemon() || !existsSync(join(bin, 'lightwell-view'))
    ? 'there is no lightwelld in build/release/bin'
    : !hasBrowser() && 'there is no chromium';

const packageFolder = join(web, '../lightwell-three');

/** In the page, before all else: it draws when told to, and what its worker says is noted. */
function hook() {
  const waiting = [];
  globalThis.requestAnimationFrame = (draw) => waiting.push(draw);
  globalThis.drawOne = () => {
    const draws = waiting.splice(0);
    for (const draw of draws) draw(performance.now());
    return draws.length > 0;
  };
  const heard = { scene: false, settled: 0, timeS: 0, frame: 0, tiles: new Set() };
  globalThis.heard = heard;
  const hear = ({ data }) => {
    if (data.kind === 'scene') heard.scene = true;
    if (data.kind === 'tiles') for (const id of data.batch.id) heard.tiles.add(id);
    if (data.kind === 'settled') heard.settled = heard.frame;
    if (data.kind !== 'frame') return;
    heard.frame = Number(data.frame.frame);
    heard.timeS = data.frame.timeS;
  };
  globalThis.Worker = class extends Worker {
    constructor(...given) {
      super(...given);
      this.addEventListener('message', hear);
    }
  };
}

/** The page with all light of `frames` frames. */
async function lit(page, daemon, frames) {
  // a client of a kind of its own gets its light with the next frame
  await until(page, 'the scene', () => heard.scene);
  const says = () => document.getElementById('state').textContent;
  const bar = () => {
    const { hidden, value } = document.getElementById('wait');
    return hidden || value;
  };
  // the clock holds the server before its first frame
  await until(page, 'its wait', () => document.getElementById('wait').value === 1);
  assert.equal(await page.evaluate(says), 'Looking inside objects: 100 %');
  assert.equal(await page.evaluate(bar), 1);
  daemon.frames(1);
  await until(page, 'its first picture', () => drawOne() && example);
  assert.equal(await page.evaluate(says), '');
  assert.equal(await page.evaluate(bar), true, 'it is hidden');
  await until(page, 'all tiles of the view', () => {
    const { light, camera, renderer } = example;
    light.update(camera, renderer.domElement.height);
    return light.listInterest(camera, renderer.domElement.height).every((id) => heard.tiles.has(id));
  });
  const last = daemon.frames(frames);
  const settled = (frame) => {
    const { light, camera, renderer } = example;
    light.update(camera, renderer.domElement.height);
    return heard.settled >= frame && !light.queue.length;
  };
  await until(page, 'the last tiles', settled, { given: last });
}

async function compareWithOurs(page, daemon, picture, { what, view, limits }) {
  const three = await pixelsOf(page, picture);
  const camera = ['--camera', '1.5,1.7,2.2:-0.2,1,-1:60', '--exposure', '1', '--tonemap', 'none'];
  const keepAs = pictureName('room', `${what}-cpu`);
  const cpu = await reference(page, daemon, `${WIDTH}x${HEIGHT}`, [...camera, ...view], keepAs);
  const name = pictureName('room', `${what}-three`);
  if (name) writeFileSync(name, Buffer.from(picture.slice(picture.indexOf(',') + 1), 'base64'));
  const { difference, flip } = compare(WIDTH, HEIGHT, cpu, three);
  console.log(`${what}: mean difference ${difference}/255, FLIP ${flip}`);
  assert.ok(difference <= limits.difference, `mean difference ${difference}/255`);
  assert.ok(flip <= limits.flip, `FLIP ${flip}`);
}

/** The page's picture of a room against ours; returns the lamps that it draws, and the time. */
async function show(lights, { given, what, daemon: more = [], view = [], limits }) {
  const folder = mkdtempSync(join(tmpdir(), 'lightwell-three-'));
  const scene = join(folder, 'scene.gltf');
  writeFileSync(scene, room(given));
  const { origin, server } = await serveExample(packageFolder, scene);
  const light = ['--clock', 'manual', '--light', 'whole', '--codec', 'half', '--http-origin', origin];
  const daemon = await startDaemon(scene, ...light, ...more);
  const look = async (page) => {
    await page.addInitScript(hook);
    const address = `ws://${new URL(daemon.url).host}/ws`;
    const from = 'from=1.5,1.7,2.2&to=-0.2,1,-1&fov=60&exposure=1';
    await page.goto(`${origin}/example.html?scene=scene.gltf&server=${address}&${from}&lights=${lights}`);
    await lit(page, daemon, FRAMES);
    const state = await page.evaluate(() => {
      const { light, scene, camera, renderer } = example;
      const lamps = [];
      scene.traverse(
        (node) => node.isLight && node.visible && lamps.push([node.type, ...node.position.toArray()]),
      );
      renderer.render(scene, camera);
      const { timeS } = heard;
      return { lamps, timeS, missing: light.missing, picture: renderer.domElement.toDataURL() };
    });
    assert.deepEqual(state.missing, []);
    await compareWithOurs(page, daemon, state.picture, { what, view, limits });
    await checkUploads(page, 'example.light', 'example.light.update(example.camera, 180)');
    return state;
  };
  try {
    return await withPage({ width: WIDTH, height: HEIGHT }, look, { mayWarn: true });
  } finally {
    await daemon.stop();
    server.close();
    server.closeAllConnections();
    rmSync(folder, { recursive: true });
  }
}

const inLightmaps = 'three: all light in lightmaps, and what is unlit as its colour';
test(inLightmaps, { skip: missing || false }, async () => {
  const limits = { difference: 2, flip: 0.03 };
  const given = { unlit: true };
  const { lamps } = await show('tiles', { given, what: 'tiles', view: ['--direct', 'tiles'], limits });
  assert.deepEqual(lamps, []);
});

test("three: the lamp is three's own, with shadows", { skip: missing || false }, async () => {
  const limits = { difference: 4, flip: 0.06 };
  const { lamps } = await show('own', { what: 'own', daemon: ['--client-lights', 'lamps'], limits });
  assert.equal(lamps.length, 1);
  assert.equal(lamps[0][0], 'PointLight');
  lamps[0].slice(1).forEach((x, i) => assert.ok(Math.abs(x - [0.6, 2.4, 0.4][i]) < 1e-5));
});

test('three: a sun, and a lamp that moves as the server moves it', { skip: missing || false }, async () => {
  const limits = { difference: 4, flip: 0.06 };
  const given = { outside: true };
  const daemon = ['--client-lights', 'lamps'];
  const { lamps, timeS } = await show('own', { given, what: 'outside', daemon, limits });
  assert.deepEqual(lamps.map(([type]) => type).sort(), ['DirectionalLight', 'PointLight']);
  assert.ok(timeS > 0.1 && timeS < 1, `${timeS} s`); // elsewhere than in the file, and on its way
  const [, ...at] = lamps.find(([type]) => type === 'PointLight');
  at.forEach((x, i) => {
    const there = lampWay[0][i] + timeS * (lampWay[1][i] - lampWay[0][i]);
    assert.ok(Math.abs(x - there) < 1e-4, `${at} after ${timeS} s`);
  });
});
