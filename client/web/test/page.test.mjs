// The page's picture against the CPU's, of the same light from the same camera.
import assert from 'node:assert/strict';
import { existsSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

import { bin, hasDaemon, startDaemon } from './daemon.mjs';
import {
  checkUploads,
  compare,
  hasBrowser,
  openBrowser,
  pictureName,
  pixels,
  reference,
  until,
} from './page.mjs';

const WIDTH = 480;
const HEIGHT = 270;
const missing =
  !hasDaemon() || !existsSync(join(bin, 'lightwell-view'))
    ? 'there is no lightwelld in build/release/bin'
    : !hasBrowser() && 'there is no chromium';

const scenes = (process.env.LW_WEB_SCENES ?? 'builtin:cornell').split(' ');
const cameras = { 'builtin:cornell': '0.3,1.2,3.4:0,0.8,0:45' };
const exposures = { 'builtin:cornell': '2' };

/** The page's picture against the CPU's. direct: who draws the lights that clients may draw, as shadow maps
 * against shadow rays; or all light is in tiles. */
async function comparePictures(given, direct, limits) {
  const [scene, camera = cameras[given] ?? '', exposure = exposures[given] ?? '0'] = given.split('@');
  const path = scene.startsWith('builtin:') ? scene : join(process.env.LW_TEST_SCENES ?? '', scene);
  const light = ['--clock', 'manual', '--light', 'whole', '--freeze', '0', '--codec', 'half'];
  const daemon = await startDaemon(path, ...light);
  const browser = await openBrowser();
  try {
    const page = await browser.newPage({ viewport: { width: WIDTH, height: HEIGHT } });
    const thrown = [];
    page.on('pageerror', (error) => thrown.push(error.stack));
    page.on('console', (message) => message.type() === 'warning' && thrown.push(message.text()));
    const parameters = `exposure=${exposure}${camera ? `&camera=${camera}` : ''}`;
    await page.goto(`${daemon.url}?${parameters}${direct === 'tiles' ? '&direct=tiles' : ''}`);
    daemon.frames(8);
    await until(
      page,
      'all tiles of the view',
      () =>
        lightwell.stats.surveys > 11 &&
        lightwell.stats.missing === 0 &&
        lightwell.stats.frame >= 8 &&
        lightwell.stats.settled === lightwell.stats.frames,
    );
    const web = await pixels(page);
    const view = await page.evaluate(() => lightwell.view());
    const options = ['--direct', direct, '--camera', camera || view, '--exposure', exposure];
    const cpu = await reference(
      page,
      daemon,
      `${WIDTH}x${HEIGHT}`,
      [...options, '--renderer', 'cpu'],
      pictureName(scene, `${direct}-cpu`),
    );
    const name = pictureName(scene, `${direct}-web`);
    const shown =
      name && (await page.evaluate(() => (lightwell.finish(), document.querySelector('canvas').toDataURL())));
    if (name) writeFileSync(name, Buffer.from(shown.slice(shown.indexOf(',') + 1), 'base64'));
    const { difference, flip } = compare(WIDTH, HEIGHT, cpu, web);
    const lamps = await page.evaluate(() => lightwell.lightsDrawn().lights);
    console.log(`${scene}, ${direct}, ${lamps} drawn: mean difference ${difference}/255, FLIP ${flip}`);
    assert.equal(lamps > 0, direct !== 'tiles');
    assert.ok(difference <= limits.difference, `mean difference ${difference}/255`);
    assert.ok(flip <= limits.flip, `FLIP ${flip}`);
    assert.deepEqual(thrown, []);
  } finally {
    await browser.close();
    await daemon.stop();
  }
}

for (const given of scenes) {
  const file = join(process.env.LW_TEST_SCENES ?? '', given.split('@')[0]);
  const skip = missing || (!given.startsWith('builtin:') && !existsSync(file) && `there is no ${given}`);
  test(`picture of ${given}, all light in tiles`, { skip: skip || false }, () =>
    comparePictures(given, 'tiles', { difference: 2, flip: 0.03 }),
  );
  test(`picture of ${given}, shadow maps`, { skip: skip || false }, () =>
    comparePictures(given, 'auto', { difference: 4, flip: 0.06 }),
  );
}

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

    // the graphics context is lost, and comes back
    const tiles = await page.evaluate(() => {
      globalThis.lost = lightwell.loseContext();
      return lightwell.stats.tiles;
    });
    await until(page, 'the loss', () => /graphics context/.test(lightwell.message()));
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
