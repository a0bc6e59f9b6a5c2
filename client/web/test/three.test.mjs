// lightwell-three: a three.js page's picture of a glTF against lightwell-view's, of the same light.
import assert from 'node:assert/strict';
import { existsSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test from 'node:test';

import { bin, hasDaemon, startDaemon } from './daemon.mjs';
import { serveExample } from './example.mjs';
import { web } from './load.mjs';
import { checkUploads, compare, hasBrowser, openBrowser, pictureName, pixelsOf, reference } from './page.mjs';
import { lampWay, room } from './room.mjs';

const WIDTH = 480;
const HEIGHT = 270;
const FRAMES = 64;
const missing =
  !hasDaemon() || !existsSync(join(bin, 'lightwell-view'))
    ? 'there is no lightwelld in build/release/bin'
    : !hasBrowser() && 'there is no chromium';

const packageFolder = join(web, '../lightwell-three');

async function show(lights, options, limits) {
  const folder = mkdtempSync(join(tmpdir(), 'lightwell-three-'));
  const scene = join(folder, 'scene.gltf');
  writeFileSync(scene, room(options));
  const { origin, server } = await serveExample(packageFolder, scene);
  const daemon = await startDaemon(
    scene,
    '--clock',
    'manual',
    '--light',
    'whole',
    '--codec',
    'half',
    '--http-origin',
    origin,
    ...options.daemon,
  );
  const browser = await openBrowser();
  try {
    const page = await browser.newPage({ viewport: { width: WIDTH, height: HEIGHT } });
    const thrown = [];
    page.on('pageerror', (error) => thrown.push(error.stack));
    const address = `ws://${new URL(daemon.url).host}/ws`;
    const view = 'from=1.5,1.7,2.2&to=-0.2,1,-1&fov=60&exposure=1';
    // a client of a kind of its own gets its light with the next frame
    const light = setInterval(() => daemon.frames(1), 500);
    await page.goto(`${origin}/example.html?scene=scene.gltf&server=${address}&${view}&lights=${lights}`);
    const attached = () => globalThis.example;
    const limit = { timeout: 240000, polling: 100 };
    await page.waitForFunction(attached, null, limit).finally(() => clearInterval(light));
    await page.evaluate(() => {
      const { light } = example;
      globalThis.uploadMs = [];
      light.update = (...given) => {
        const waiting = light.queue.length;
        const begin = performance.now();
        Object.getPrototypeOf(light).update.apply(light, given);
        if (waiting) uploadMs.push(performance.now() - begin);
      };
    });
    daemon.frames(FRAMES);
    const done = (frames) => globalThis.example?.light.frame >= frames;
    await page.waitForFunction(done, FRAMES, limit);
    await page.waitForTimeout(4000); // its last tiles
    const state = await page.evaluate(() => {
      const { light, scene, camera, renderer } = example;
      const lamps = [];
      scene.traverse(
        (node) => node.isLight && node.visible && lamps.push([node.type, ...node.position.toArray()]),
      );
      light.update(camera, renderer.domElement.height);
      renderer.render(scene, camera);
      return { lamps, missing: light.missing, picture: renderer.domElement.toDataURL() };
    });
    // a software GPU that draws shadow maps as well makes every call wait
    if (lights === 'tiles') checkUploads('three', await page.evaluate(() => uploadMs));
    assert.deepEqual(thrown, []);
    assert.deepEqual(state.missing, []);
    if (!options.view) return state;
    const three = await pixelsOf(page, state.picture);
    const cpuOptions = [
      '--camera',
      '1.5,1.7,2.2:-0.2,1,-1:60',
      '--exposure',
      '1',
      '--tonemap',
      'none',
      ...options.view,
    ];
    const what = options.outside ? 'outside' : options.unlit ? 'unlit' : lights;
    const keepAs = pictureName('room', `${what}-cpu`);
    const cpu = await reference(page, daemon, `${WIDTH}x${HEIGHT}`, cpuOptions, keepAs);
    const name = pictureName('room', `${what}-three`);
    if (name) writeFileSync(name, Buffer.from(state.picture.slice(state.picture.indexOf(',') + 1), 'base64'));
    const { difference, flip } = compare(WIDTH, HEIGHT, cpu, three);
    console.log(`${what}: mean difference ${difference}/255, FLIP ${flip}`);
    assert.ok(difference <= limits.difference, `mean difference ${difference}/255`);
    assert.ok(flip <= limits.flip, `FLIP ${flip}`);
    return state;
  } finally {
    await browser.close();
    await daemon.stop();
    server.close();
    server.closeAllConnections();
    rmSync(folder, { recursive: true });
  }
}

test('three: all light in lightmaps', { skip: missing || false }, async () => {
  const { lamps } = await show(
    'tiles',
    { daemon: [], view: ['--direct', 'tiles'] },
    { difference: 2, flip: 0.03 },
  );
  assert.deepEqual(lamps, []);
});

test('three: what is unlit is seen as its colour', { skip: missing || false }, async () => {
  const options = { daemon: [], view: ['--direct', 'tiles'], unlit: true };
  await show('tiles', options, { difference: 2, flip: 0.03 });
});

test("three: the lamp is three's own, with shadows", { skip: missing || false }, async () => {
  const limits = { difference: 4, flip: 0.06 };
  const { lamps } = await show('own', { daemon: ['--client-lights', 'lamps'], view: [] }, limits);
  assert.equal(lamps.length, 1);
  assert.equal(lamps[0][0], 'PointLight');
  lamps[0].slice(1).forEach((x, i) => assert.ok(Math.abs(x - [0.6, 2.4, 0.4][i]) < 1e-5));
});

test('three: a sun, and a lamp that is elsewhere than in the file', { skip: missing || false }, async () => {
  const limits = { difference: 4, flip: 0.06 };
  const daemon = ['--client-lights', 'lamps', '--freeze', '0.5'];
  const { lamps } = await show('own', { daemon, view: [], outside: true }, limits);
  assert.deepEqual(lamps.map(([type]) => type).sort(), ['DirectionalLight', 'PointLight']);
  const [, ...at] = lamps.find(([type]) => type === 'PointLight');
  at.forEach((x, i) => assert.ok(Math.abs(x - (lampWay[0][i] + lampWay[1][i]) / 2) < 1e-4, `${at}`));
});

test('three: a lamp moves as the server moves it', { skip: missing || false }, async () => {
  const { lamps } = await show('own', { daemon: ['--client-lights', 'lamps'], outside: true });
  const [, ...at] = lamps.find(([type]) => type === 'PointLight');
  const way = at.map((x, i) => (x - lampWay[0][i]) / (lampWay[1][i] - lampWay[0][i]));
  assert.ok(way[0] > 0.01 && way[0] <= 1, `${at}`);
  way.forEach((share) => assert.ok(Math.abs(share - way[0]) < 1e-3, `${way}`));
});
