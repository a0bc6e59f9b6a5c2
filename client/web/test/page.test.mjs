// The page's picture against the CPU's, of the same light from the same camera.
import assert from 'node:assert/strict';
import { existsSync } from 'node:fs';
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
