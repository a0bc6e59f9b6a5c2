// The page's picture against the CPU's, of the same light from the same camera.
import assert from 'node:assert/strict';
import { existsSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test from 'node:test';

import { bin, hasDaemon, startDaemon } from './daemon.mjs';
import { checkUploads, hasBrowser, openBrowser, until } from './page.mjs';
import { comparePictures, HEIGHT, WIDTH } from './pictures.mjs';

const missing =
  !hasDaemon() || !existsSync(join(bin, 'lightwell-view'))
    ? 'there is no lightwelld in build/release/bin'
    : !hasBrowser() && 'there is no chromium';

for (const direct of ['tiles', 'auto'])
  test(`picture of the Cornell box, direct light: ${direct}`, { skip: missing || false }, () =>
    comparePictures('builtin:cornell@0.3,1.2,3.4:0,0.8,0:45@2', direct),
  );

/** A floor below a sun, a textured sign that is unlit, a pane that is red; seen by an orthographic camera. */
function writeLooks(path) {
  const square = Float32Array.of(-1, 0, -1, 1, 0, -1, -1, 0, 1, 1, 0, 1, 0, 0, 1, 0, 0, 1, 1, 1);
  const bytes = Buffer.concat([square, Uint16Array.of(0, 2, 1, 1, 2, 3)].map((a) => Buffer.from(a.buffer)));
  const uri = `data:application/octet-stream;base64,${bytes.toString('base64')}`;
  // 2 x 1 texels: (255, 0, 0, 255), (0, 128, 255, 64)
  const png =
    'iVBORw0KGgoAAAANSUhEUgAAAAIAAAABCAYAAAD0In+KAAAAEUlEQVR4nGP4z8Dwn6HhvwMAELoDvkeWIKAAAAAASUVORK5CYII=';
  const mesh = (material) => ({
    primitives: [{ attributes: { POSITION: 0, TEXCOORD_0: 1 }, indices: 2, material }],
  });
  const down = [-Math.SQRT1_2, 0, 0, Math.SQRT1_2];
  const accessor = (bufferView, componentType, count, type) => ({ bufferView, componentType, count, type });
  writeFileSync(
    path,
    JSON.stringify({
      asset: { version: '2.0' },
      extensionsUsed: ['KHR_lights_punctual', 'KHR_materials_unlit', 'KHR_materials_transmission'],
      extensions: { KHR_lights_punctual: { lights: [{ type: 'directional', intensity: 3 }] } },
      scenes: [{ nodes: [0, 1, 2, 3, 4] }],
      nodes: [
        { name: 'floor', mesh: 0, scale: [2, 1, 2] },
        { name: 'sign', mesh: 1, translation: [-0.8, 0.5, 0], scale: [0.6, 1, 0.8] },
        { name: 'pane', mesh: 2, translation: [0.9, 0.7, 0.2], scale: [0.5, 1, 0.9] },
        { name: 'sun', rotation: down, extensions: { KHR_lights_punctual: { light: 0 } } },
        { name: 'camera', camera: 0, translation: [0, 4, 0], rotation: down },
      ],
      cameras: [{ type: 'orthographic', orthographic: { xmag: 3, ymag: 1.25, znear: 0.1, zfar: 10 } }],
      meshes: [mesh(0), mesh(1), mesh(2)],
      materials: [
        { name: 'grey', pbrMetallicRoughness: { baseColorFactor: [0.5, 0.5, 0.5, 1] } },
        {
          name: 'sign',
          pbrMetallicRoughness: { baseColorTexture: { index: 0 } },
          extensions: { KHR_materials_unlit: {} },
        },
        {
          name: 'red',
          doubleSided: true,
          pbrMetallicRoughness: { baseColorFactor: [0.9, 0.3, 0.1, 1] },
          extensions: { KHR_materials_transmission: { transmissionFactor: 0.9 } },
        },
      ],
      textures: [{ source: 0 }],
      images: [{ uri: `data:image/png;base64,${png}` }],
      accessors: [accessor(0, 5126, 4, 'VEC3'), accessor(1, 5126, 4, 'VEC2'), accessor(2, 5123, 6, 'SCALAR')],
      bufferViews: [
        { buffer: 0, byteLength: 48 },
        { buffer: 0, byteOffset: 48, byteLength: 32 },
        { buffer: 0, byteOffset: 80, byteLength: 12 },
      ],
      buffers: [{ uri, byteLength: 92 }],
    }),
  );
}

test('picture of what is unlit, tinted and orthographic', { skip: missing || false }, async () => {
  const folder = mkdtempSync(join(tmpdir(), 'looks-'));
  try {
    writeLooks(join(folder, 'looks.gltf'));
    await comparePictures(`${join(folder, 'looks.gltf')}@@0`, 'tiles');
    await comparePictures(`${join(folder, 'looks.gltf')}@0.5,3,2:0,0.3,0:3m@0`, 'tiles');
    await comparePictures(`${join(folder, 'looks.gltf')}@0.5,3,2:0,0.3,0:60@0`, 'tiles');
  } finally {
    rmSync(folder, { recursive: true });
  }
});

test('a page lives on', { skip: missing || false }, async () => {
  let daemon = await startDaemon('builtin:cornell');
  const port = new URL(daemon.url).port;
  const browser = await openBrowser();
  try {
    const context = await browser.newContext({ viewport: { width: WIDTH, height: HEIGHT } });
    const page = await context.newPage();
    const thrown = [];
    page.on('pageerror', (error) => thrown.push(error.stack));
    await page.goto(daemon.url);
    const lit = () => lightwell.stats.interest > 0 && lightwell.stats.missing === 0;
    await until(page, 'light', lit);
    const { sceneMs, firstMs, allMs, uploadMs } = await page.evaluate(() => lightwell.stats);
    const after = [firstMs, allMs].map((ms) => Math.round(ms - sceneMs));
    console.log(`first light ${after[0]} ms after the scene, all of the view's ${after[1]} ms`);
    checkUploads('page', uploadMs);

    // mouse and keys
    const before = await page.evaluate(() => lightwell.view());
    await page.mouse.move(200, 100);
    await page.mouse.down();
    await page.mouse.move(260, 120);
    await page.mouse.up();
    await page.waitForFunction((view) => lightwell.view() !== view, before, { timeout: 30000 });
    const turned = await page.evaluate(() => lightwell.view());
    await page.keyboard.down('w');
    await page.waitForFunction((view) => lightwell.view() !== view, turned, { timeout: 30000 });
    await page.keyboard.up('w');

    // the legend says how things are
    const legend = () => page.evaluate(() => document.getElementById('legend').textContent);
    await until(page, 'the legend', () =>
      /^(\d+ pictures\/s|smoothing edges|picture complete) · light .* · .*\d+ kbit\/s/.test(
        document.getElementById('legend').textContent,
      ),
    );
    assert.doesNotMatch(await legend(), /NaN|undefined|Infinity/);

    // a window without room: pictures of one pixel, and a view that stays one
    await page.evaluate(() => (document.querySelector('canvas').style.cssText = 'width: 0; height: 0'));
    await page.keyboard.press('0');
    await until(page, 'a canvas of one pixel', () => document.querySelector('canvas').width === 1);
    assert.doesNotMatch(await page.evaluate(() => lightwell.view()), /NaN|Infinity/);
    await page.evaluate(() => (document.querySelector('canvas').style.cssText = ''));
    await until(page, 'the canvas again', () => document.querySelector('canvas').width > 1);

    // the graphics context is lost, and comes back
    const tiles = await page.evaluate(() => {
      globalThis.lost = lightwell.loseContext();
      return lightwell.stats.tiles;
    });
    await until(page, 'the loss', () => /graphics context/.test(lightwell.message()));
    // the connection has come back meanwhile: that is not what the page waits for
    const meanwhile = await page.evaluate(() => {
      lightwell.worker.onmessage({ data: { kind: 'state', text: '', final: false } });
      return lightwell.message();
    });
    assert.match(meanwhile, /graphics context/);
    await page.evaluate(() => lost.restore());
    await page.waitForFunction(
      (count) => lightwell.stats.tiles > count && lightwell.message() === '',
      tiles,
      { timeout: 240000 },
    );

    // another page of this browser has the scene already
    const kept = await page.evaluate(async () => {
      const db = await new Promise((done) => {
        const request = indexedDB.open('lightwell');
        request.onsuccess = () => done(request.result);
      });
      return new Promise((done) => {
        const request = db.transaction('parts').objectStore('parts').count();
        request.onsuccess = () => done(request.result);
      });
    });
    assert.equal(kept, 1);

    // the server goes away, and another one comes
    await daemon.stop();
    await until(page, 'the end', () => /trying again/.test(lightwell.message()));
    daemon = await startDaemon('builtin:cornell', '--http', `127.0.0.1:${port}`);
    const frames = await page.evaluate(() => lightwell.stats.frames);
    await page.waitForFunction(
      (count) => lightwell.stats.frames > count && lightwell.message() === '',
      frames,
      { timeout: 240000 },
    );
    assert.deepEqual(thrown, []);

    // a browser without WebGL2
    const plain = await context.newPage();
    await plain.addInitScript(() => {
      HTMLCanvasElement.prototype.getContext = () => null;
    });
    await plain.goto(daemon.url);
    assert.match(await plain.evaluate(() => lightwell.message()), /no WebGL2/);
  } finally {
    await browser.close();
    await daemon.stop();
  }
});

test('fingers look and move', { skip: missing || false }, async () => {
  const daemon = await startDaemon('builtin:cornell');
  const browser = await openBrowser();
  try {
    const context = await browser.newContext({ viewport: { width: WIDTH, height: HEIGHT }, hasTouch: true });
    const page = await context.newPage();
    await page.goto(`${daemon.url}?camera=0,1,3:0,1,0:45&direct=tiles`);
    await until(page, 'the scene', () => lightwell.stats.pictures > 0);
    const devtools = await context.newCDPSession(page);
    const touch = (type, ...points) => {
      const touchPoints = points.map(([x, y], id) => ({ x, y, id }));
      return devtools.send('Input.dispatchTouchEvent', { type, touchPoints });
    };
    const viewAfter = async (before) => {
      await page.waitForFunction((view) => lightwell.view() !== view, before, { timeout: 60000 });
      return page.evaluate(() => lightwell.view());
    };
    const eye = (view) => view.split(':')[0];
    const first = await page.evaluate(() => lightwell.view());
    assert.match(await page.evaluate(() => document.getElementById('help').textContent), /finger/);
    await touch('touchStart', [240, 130]);
    await touch('touchMove', [300, 130]);
    await touch('touchEnd');
    const turned = await viewAfter(first);
    assert.equal(eye(turned), eye(first), 'one finger looks');
    assert.equal(
      await page.evaluate(() => document.getElementById('help').textContent),
      '',
      'and hides the hints',
    );
    await touch('touchStart', [200, 130], [280, 130]);
    await touch('touchMove', [160, 130], [320, 130]);
    await touch('touchEnd');
    assert.notEqual(eye(await viewAfter(turned)), eye(turned), 'two fingers move');
  } finally {
    await browser.close();
    await daemon.stop();
  }
});
