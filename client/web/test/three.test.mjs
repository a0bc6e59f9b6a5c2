// lightwell-three: a three.js page's picture of a glTF against lightwell-view's, of the same light. With
// LW_LONG all versions of three and all renderers, and a lamp in a closed room; else the oldest, and
// WebGPURenderer by WebGL.
import assert from 'node:assert/strict';
import { existsSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test from 'node:test';

import { bin, hasDaemon, startDaemon } from './daemon.mjs';
import { hookExample, readTarget, serveExample, untilExampleIsLit } from './example.mjs';
import { web } from './load.mjs';
import {
  checkUploads,
  compare,
  hasBrowser,
  pictureName,
  pixels,
  pixelsOf,
  reference,
  savePicture,
  until,
} from './page.mjs';
import { lampWay, room } from './room.mjs';
import { WEBGPU, withPage } from './shared.mjs';

const WIDTH = 320;
const HEIGHT = 180;
const FRAMES = 8;
const SAME = { difference: 2, flip: 0.02 }; // pictures of other versions and renderers, against the newest
const missing =
  !hasDaemon() || !existsSync(join(bin, 'lightwell-view'))
    ? 'there is no lightwelld in build/release/bin'
    : !hasBrowser() && 'there is no chromium';

const packageFolder = join(web, '../lightwell-three');

/** The first page of a server that is held before its first frame. */
async function firstLight(page, daemon) {
  // a client of a kind of its own gets its light with the next frame
  await until(page, 'the scene', () => heard.scene);
  const says = () => document.getElementById('state').textContent;
  const bar = () => {
    const { hidden, value } = document.getElementById('wait');
    return hidden || value;
  };
  // the clock holds the server before its first frame
  // its bar alone was full before: of the scene's bytes
  const inside = 'Looking inside objects: 100 %';
  const isThere = (text) => {
    const { hidden, value } = document.getElementById('wait');
    return document.getElementById('state').textContent === text && !hidden && value === 1;
  };
  await until(page, 'its wait', isThere, { given: inside });
  daemon.frames(1);
  await until(page, 'its first picture', () => drawOne() && example);
  assert.equal(await page.evaluate(says), '');
  assert.equal(await page.evaluate(bar), true, 'it is hidden');
}

/** The CPU's picture of what the server holds. */
function oursOf(page, daemon, what, view) {
  const camera = ['--camera', '1.5,1.7,2.2:-0.2,1,-1:60', '--exposure', '1', '--tonemap', 'none'];
  return reference(
    page,
    daemon,
    `${WIDTH}x${HEIGHT}`,
    [...camera, ...view],
    pictureName('room', `${what}-cpu`),
  );
}

function compareWith(wanted, got, what, limits) {
  const { difference, flip } = compare(WIDTH, HEIGHT, wanted, got);
  console.log(`${what}: mean difference ${difference}/255, FLIP ${flip}`);
  assert.ok(difference <= limits.difference, `${what}: mean difference ${difference}/255`);
  assert.ok(flip <= limits.flip, `${what}: FLIP ${flip}`);
}

/** A scene's file, its web server, and a lightwelld that is held before its first frame. */
async function serve(given, more, run) {
  const folder = mkdtempSync(join(tmpdir(), 'lightwell-three-'));
  const scene = join(folder, 'scene.gltf');
  writeFileSync(scene, room(given));
  const { origin, server } = await serveExample(packageFolder, scene);
  const light = ['--clock', 'manual', '--light', 'whole', '--codec', 'half', '--http-origin', origin];
  const daemon = await startDaemon(scene, ...light, ...more);
  try {
    return await run({ origin, daemon, address: `ws://${new URL(daemon.url).host}/ws` });
  } finally {
    await daemon.stop();
    server.close();
    server.closeAllConnections();
    rmSync(folder, { recursive: true });
  }
}

const PAGE = { mayWarn: true, args: WEBGPU };
const NEWEST = { three: 'three', renderer: 'webgl' };

/** The page's picture of a room against ours; returns the lamps that it draws, and the time. All pages after
 * the first, each of a version of three and a renderer, show what the first one does. */
function show(lights, { given, what, daemon: more = [], view = [], limits, variants = [] }) {
  return serve(given, more, async ({ origin, daemon, address }) => {
    let first = null;
    const look = async (page, { three, renderer }) => {
      await page.addInitScript(hookExample);
      const from = 'from=1.5,1.7,2.2&to=-0.2,1,-1&fov=60&exposure=1';
      const place = `${origin}${three === 'three' ? '' : `/${three}`}/example.html?scene=scene.gltf`;
      await page.goto(`${place}&server=${address}&${from}&lights=${lights}&renderer=${renderer}`);
      if (!first) await firstLight(page, daemon);
      await untilExampleIsLit(page, daemon, first ? 0 : FRAMES);
      const state = await page.evaluate(async () => {
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
      if (renderer === 'webgpu') state.picture = await page.evaluate(readTarget);
      const picture = await pixelsOf(page, state.picture);
      const name = pictureName('room', `${what}-${three}-${renderer}`);
      if (name)
        writeFileSync(name, Buffer.from(state.picture.slice(state.picture.indexOf(',') + 1), 'base64'));
      if (first) compareWith(first.picture, picture, `${what}, ${three}, ${renderer}`, SAME);
      else {
        compareWith(await oursOf(page, daemon, what, view), picture, what, limits);
        await checkUploads(page, 'example.light', 'example.light.update(example.camera, 180)');
        first = { ...state, picture };
      }
    };
    for (const variant of [NEWEST, ...variants])
      await withPage({ width: WIDTH, height: HEIGHT }, (page) => look(page, variant), PAGE);
    return first;
  });
}

const inLightmaps =
  'three: all light in lightmaps, and what is unlit as its colour; other versions, other renderers';
test(inLightmaps, { skip: missing || false }, async () => {
  const limits = { difference: 2, flip: 0.03 };
  const given = { unlit: true };
  const variants = [
    { three: 'three-160', renderer: 'webgl' },
    { three: 'three', renderer: 'nodes' },
  ];
  if (process.env.LW_LONG)
    variants.push({ three: 'three-170', renderer: 'webgl' }, { three: 'three', renderer: 'webgpu' });
  const view = ['--direct', 'tiles'];
  const { lamps } = await show('tiles', { given, what: 'tiles', view, limits, variants });
  assert.deepEqual(lamps, []);
});

const closed = { skip: missing || (!process.env.LW_LONG && 'LW_LONG is not set') };
test("three: the lamp is three's own, with shadows", closed, async () => {
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

/** Pages of other renderers and versions against the server's own. directional: auto or off. */
function showSmooth(directional, variants) {
  return serve({ smooth: true }, ['--directional', directional], async ({ origin, daemon, address }) => {
    const size = { width: WIDTH, height: HEIGHT };
    const wanted = await withPage(size, async (page) => {
      const view = '1.5,1.7,2.2:-0.2,1,-1:60';
      await page.goto(`${daemon.url}?exposure=1&tonemap=none&direct=tiles&camera=${view}`);
      await until(page, 'the scene', () => lightwell.stats.sceneMs > 0);
      const isLit = (frame) => {
        const { frame: last, frames, settled, surveys, missing, finishes } = lightwell.stats;
        return last >= frame && settled === frames && surveys > 8 && !missing && finishes > 0;
      };
      await until(page, 'its light, and what is smooth', isLit, { given: daemon.frames(FRAMES) });
      await savePicture(page, pictureName('room', `smooth-${directional}-page`));
      const light = await pixels(page);
      const floor = 3 * ((HEIGHT - 5) * WIDTH + WIDTH / 2);
      const shown = [];
      for (let k = 0; k < 4; k++) {
        await page.keyboard.press('v');
        shown.push([...(await pixels(page)).subarray(floor, floor + 3)]);
      }
      // sRGB of 0.5 is 188: normals, roughness, metalness; and light again
      const charts = [[188, 255, 188], [255, 255, 255], [0, 0, 0]]; // prettier-ignore
      const off = shown.slice(0, 3).flatMap((rgb, i) => rgb.map((x, c) => Math.abs(x - charts[i][c])));
      assert.ok(Math.max(...off) <= 3, `${shown}`);
      assert.deepEqual(shown[3], [...light.subarray(floor, floor + 3)]);
      return light;
    });
    const look = async (page, { three, renderer }) => {
      await page.addInitScript(hookExample);
      const from = 'from=1.5,1.7,2.2&to=-0.2,1,-1&fov=60&exposure=1';
      const place = `${origin}${three === 'three' ? '' : `/${three}`}/example.html?scene=scene.gltf`;
      await page.goto(`${place}&server=${address}&${from}&lights=tiles&renderer=${renderer}`);
      await untilExampleIsLit(page, daemon, 0);
      const picture = await page.evaluate(() => {
        const { scene, camera, renderer } = example;
        renderer.render(scene, camera);
        return renderer.domElement.toDataURL();
      });
      const what = `smooth-${directional}-${three}-${renderer}`;
      const name = pictureName('room', what);
      if (name) writeFileSync(name, Buffer.from(picture.slice(picture.indexOf(',') + 1), 'base64'));
      // r160 has another approximation of the lobes' table
      const flip = three === 'three-160' ? 0.04 : 0.03;
      compareWith(wanted, await pixelsOf(page, picture), what, { difference: 2, flip });
    };
    for (const variant of variants) await withPage(size, (page) => look(page, variant), PAGE);
  });
}

test('three: what is smooth is as the page has it', { skip: missing || false }, async () => {
  const oldest = process.env.LW_LONG ? [{ three: 'three-160', renderer: 'webgl' }] : [];
  const nodes = { three: 'three', renderer: 'nodes' };
  await showSmooth('auto', [NEWEST, nodes, ...oldest]);
  await showSmooth('off', [nodes]);
});
