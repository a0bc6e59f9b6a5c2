// The page's picture against the CPU's, of the same light from the same camera.
import assert from 'node:assert/strict';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { get } from 'node:http';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test from 'node:test';
import { WebSocketServer } from 'ws';

import { bin, hasDaemon, LIMIT_MS, startDaemon } from './daemon.mjs';
import { root } from './load.mjs';
import { checkAccessibility, checkLayout, checkUploads, hasBrowser } from './page.mjs';
import { openBrowser, pictureName, pixels, resizeAround, until } from './page.mjs';
import { comparePictures, HEIGHT, startStill, WIDTH } from './pictures.mjs';
import { withPage } from './shared.mjs';

const missing =
  !hasDaemon() || !existsSync(join(bin, 'lightwell-view'))
    ? 'there is no lightwelld in build/release/bin'
    : !hasBrowser() && 'there is no chromium';

const viewport = { width: WIDTH, height: HEIGHT };

test('the Cornell box', { skip: missing || false }, async (t) => {
  const daemon = await startStill('builtin:cornell');
  try {
    await t.test('it says why there is no light yet', () => withPage(viewport, waitingPage(daemon)));
    for (const direct of ['tiles', 'auto'])
      await t.test(`picture, direct light: ${direct}`, () =>
        comparePictures(daemon, 'builtin:cornell', {
          direct,
          exposure: '2',
          cameras: ['0.3,1.2,3.4:0,0.8,0:45'],
        }),
      );
    await t.test('a shader that does not compile is named at once', () => refusesShader(daemon));
    await t.test('fingers look and move', () => withPage(viewport, touchPage(daemon), { hasTouch: true }));
  } finally {
    await daemon.stop();
  }
});

test('tiles of finer levels', { skip: missing || false }, async () => {
  const daemon = await startStill('builtin:cornell', '--light', 'seen'); // nobody asks for them of all light
  try {
    await withPage(viewport, finerPage(daemon));
  } finally {
    await daemon.stop();
  }
});

/** The page's own line and the wait's error have the compiler's log. */
async function refusesShader(daemon) {
  const browser = await openBrowser();
  try {
    const page = await browser.newPage({ viewport });
    await page.addInitScript(() => {
      const { shaderSource } = WebGL2RenderingContext.prototype;
      WebGL2RenderingContext.prototype.shaderSource = function (shader, source) {
        shaderSource.call(this, shader, `${source}\nvoid later() { noSuchName = 1.0; }`);
      };
    });
    await page.goto(`${daemon.url}?direct=tiles`);
    const never = until(page, 'light that never comes', () => false);
    await assert.rejects(never, /a shader is broken: .*noSuchName/s);
    const says = () => /does not take our shaders: .*noSuchName/s.test(lightwell.message());
    await page.waitForFunction(says, null, { timeout: LIMIT_MS });
  } finally {
    await browser.close();
  }
}

const WIRE_MAX = 92000; // bytes, of all that the page loads at first, headers included

/** What the page has loaded, as it is transferred: by brotli, as to this machine and by https, and by gzip. */
async function checkTransfer(page, url) {
  const entries = () => performance.getEntriesByType('resource').map(({ name }) => name);
  const inWorker = await page.workers()[0].evaluate(entries);
  const names = new Set([url, ...(await page.evaluate(entries)), ...inWorker].filter((name) => /^http/.test(name)));
  assert.equal(names.size, 6, [...names].join(' '));
  for (const coding of ['br', 'gzip']) {
    let bytes = 0;
    for (const name of names)
      bytes += await new Promise((resolve, reject) => {
        get(name, { headers: { 'accept-encoding': coding }, agent: false }, (response) => {
          assert.equal(response.headers['content-encoding'], coding, name);
          response.resume().on('end', () => resolve(response.socket.bytesRead));
        }).on('error', reject);
      });
    console.log(`the page on the wire by ${coding}: ${bytes} bytes`);
    assert.ok(bytes <= WIRE_MAX, `${bytes} bytes by ${coding}`);
  }
}

/** Leaves the page as a person sees it, for people to look at. */
async function showState(page, what) {
  const name = pictureName('page', what);
  if (name) await page.screenshot({ path: name });
}

/** The clock holds the server before its first frame. */
const waitingPage = (daemon) => async (page) => {
  await page.goto(`${daemon.url}?camera=0,1,3:0,1,0:45&direct=tiles`);
  const says = () => document.getElementById('wait').textContent;
  const inside = 'The server is lighting the scene, 100 %: looking inside objects';
  await until(page, 'its wait', (text) => document.getElementById('wait').textContent === text, {
    given: inside,
  });
  assert.equal(await page.evaluate(() => lightwell.message()), '');
  const bar = page.getByRole('progressbar', { name: 'Progress' });
  assert.equal(await bar.getAttribute('aria-valuetext'), inside);
  assert.equal(await bar.getAttribute('aria-valuenow'), '100');
  await checkAccessibility(page, 'waiting');
  await showState(page, 'waiting');
  await checkTransfer(page, daemon.url);
  daemon.frames(1);
  await until(page, 'a picture', () => lightwell.stats.firstMs > 0);
  assert.equal(await page.evaluate(says), '');
  assert.equal(await bar.count(), 0, 'it is hidden');
};

const touchPage = (daemon) => async (page, context) => {
  await page.goto(`${daemon.url}?camera=0,1,3:0,1,0:45&direct=tiles`);
  await until(page, 'the scene', () => lightwell.stats.sceneMs > 0);
  daemon.frames(1);
  await until(page, 'a picture', () => lightwell.stats.pictures > 0);
  const devtools = await context.newCDPSession(page);
  const touch = (type, ...points) => {
    const touchPoints = points.map(([x, y], id) => ({ x, y, id }));
    return devtools.send('Input.dispatchTouchEvent', { type, touchPoints });
  };
  /** Fingers, in five steps: Chromium may keep a single one to itself. */
  const drag = async (...fingers) => {
    for (let k = 0; k <= 5; k++) await touch(k ? 'touchMove' : 'touchStart', ...fingers.map((at) => at(k)));
    await touch('touchEnd');
  };
  const viewAfter = async (before) => {
    await until(page, 'another view', (view) => lightwell.view() !== view, { given: before });
    return page.evaluate(() => lightwell.view());
  };
  const eye = (view) => view.split(':')[0];
  const help = () => page.evaluate(() => document.getElementById('help').textContent);
  const first = await page.evaluate(() => lightwell.view());
  assert.match(await help(), /finger/);
  await drag((k) => [120 + 6 * k, 65]);
  const turned = await viewAfter(first);
  assert.equal(eye(turned), eye(first), 'one finger looks');
  assert.equal(await help(), '', 'and hides the hints');
  await drag(
    (k) => [100 - 4 * k, 65],
    (k) => [140 + 4 * k, 65],
  );
  await until(page, 'two fingers to move it', (from) => lightwell.view().split(':')[0] !== from, {
    given: eye(turned),
  });
};

/** Near a wall, given known light: of level 0, and of the level that is twice as fine. */
const finerPage = (daemon) => async (page) => {
  await page.goto(`${daemon.url}?camera=0,1.8,0.2:0,1.8,-1:10&direct=tiles&exposure=-3&tonemap=none`);
  await until(page, 'the scene', () => lightwell.stats.sceneMs > 0);
  daemon.frames(1);
  await until(page, 'light', () => lightwell.stats.interest > 0 && lightwell.stats.missing === 0);
  await page.evaluate(() => {
    lightwell.take = lightwell.look = lightwell.takeTiles = () => {}; // from here on light is the test's
    const { renderer } = lightwell;
    const { map } = renderer;
    const isOf = (level) => (id) => map.place(id).level === level;
    const ids = Uint32Array.from({ length: map.tileCount }, (_, id) => id);
    Object.assign(globalThis, { plain: ids.filter(isOf(0)), fine: ids.filter(isOf(65)) });
    /** Gives all texels of tiles a colour: red, green and blue in 512ths of 32 W/m^2.
     * colourOf(u, v): of a texel with its centre there, in texels of level 0 */
    globalThis.give = (ids, colourOf) => {
      const texels = Array.from(ids, (id) => map.place(id)).flatMap(({ level, x, y, width, height }) =>
        Array.from({ length: width * height }, (_, i) => {
          const scale = level > 64 ? 2 ** (level - 64) : 1;
          const [u, v] = [x + (i % width) + 0.5, y + Math.floor(i / width) + 0.5];
          const [r, g, b] = colourOf(u / scale, v / scale);
          return ((15 << 27) | (b << 18) | (g << 9) | r) >>> 0;
        }),
      );
      const noiseLevel = new Uint8Array(ids.length);
      const batch = { id: ids, noiseLevel, texels: Uint32Array.from(texels), directions: [] };
      renderer.takeTiles(batch, 0, 0, Infinity);
      lightwell.dirty = true;
    };
    globalThis.withdraw = (ids) => {
      const noiseLevel = new Uint8Array(ids.length).fill(255);
      const batch = { id: ids, noiseLevel, texels: new Uint32Array(0), directions: [] };
      renderer.takeTiles(batch, 0, 0, Infinity);
      lightwell.dirty = true;
    };
    globalThis.survey = async () => {
      while (renderer.surveyPixels.busy() && !renderer.takeSurvey()) await new Promise(requestAnimationFrame);
      renderer.beginSurvey(lightwell.flight.view, 240, 135);
      for (;;) {
        const found = renderer.takeSurvey();
        if (found) return [...found.inPicture];
        await new Promise(requestAnimationFrame);
      }
    };
  });
  const middle = async () => {
    const colours = await pixels(page);
    return [...colours.subarray(3 * (WIDTH * (HEIGHT >> 1) + (WIDTH >> 1))).subarray(0, 3)];
  };
  const plainCount = await page.evaluate(() => lightwell.renderer.map.plainCount);
  const wanted = () => page.evaluate(() => survey()).then((ids) => ids.filter((id) => id >= plainCount));

  await page.evaluate(() => give(plain, () => [0, 256, 0]));
  assert.deepEqual(await wanted(), [], 'light is even');
  const before = await middle();
  assert.ok(before[1] > 80 && before[0] === 0, `green: ${before}`);
  await page.evaluate(() => give(plain, (u, v) => [0, (u ^ v) & 1 ? 256 : 200, 0]));
  const ids = await wanted();
  assert.ok(ids.length > 0, 'light differs by more than a tenth');
  const level = await page.evaluate((id) => lightwell.renderer.map.place(id).level, ids[0]);
  assert.equal(level, 66, 'texels of 65 are more than eight pixels wide');
  await page.evaluate(() => give(plain, (u, v) => [0, (u ^ v) & 1 ? 256 : 240, 0]));
  assert.deepEqual(await wanted(), [], 'by less than a tenth');

  // what is there of level 65 is read in the place of level 66, once somebody wants it
  await page.evaluate(() => give(plain, () => [0, 256, 0]));
  await page.evaluate(() => give(fine, () => [256, 0, 0]));
  assert.deepEqual(await middle(), before, 'nobody wants it');
  await page.evaluate(() => lightwell.renderer.want(fine));
  const after = await middle();
  assert.ok(after[0] > 80 && after[1] === 0, `red: ${after}`);
  const half = await page.evaluate(async () => {
    const { renderer } = lightwell;
    const now = renderer.finer.steppedMs;
    renderer.want([]);
    renderer.fade(now + 125);
    return [...renderer.finer.kept.values()].filter(({ share }) => Math.abs(share - 0.5) < 1e-9).length;
  });
  assert.ok(half > 0, 'it fades');
  await page.evaluate(() => lightwell.renderer.want(fine));
  assert.deepEqual(await middle(), after);
  // no seam where tiles meet
  const row = (colours) => {
    const first = 3 * WIDTH * (HEIGHT >> 1);
    const at = (x) => [...colours.subarray(first + 3 * x, first + 3 * x + 3)].join();
    return Array.from({ length: WIDTH }, (_, x) => at(x));
  };
  assert.equal(new Set(row(await pixels(page))).size, 1, 'all of a row is one colour');
  await page.evaluate(() => withdraw(fine));
  assert.deepEqual(await middle(), before, 'they were withdrawn');

  // each texel of level 66 is where it belongs: a ramp looks as it does on level 0
  await page.evaluate(() => give(plain, (u, v) => [0, 80 + 3 * u + 2 * v, 0]));
  const plainRamp = await pixels(page);
  await page.evaluate((id) => {
    const { map } = lightwell.renderer;
    const { object } = map.place(id);
    const is = (other) => map.place(other).object === object && map.place(other).level === 66;
    const wall = Uint32Array.from({ length: map.tileCount }, (_, other) => other).filter(is);
    give(wall, (u, v) => [80 + 3 * u + 2 * v, 0, 0]);
    lightwell.renderer.want(wall);
  }, ids[0]);
  const ramp = await pixels(page);
  const ends = new Set();
  for (let at = 0; at < ramp.length; at += 3) {
    assert.ok(Math.abs(ramp[at] - plainRamp[at + 1]) <= 2 && ramp[at + 1] === 0, `${at / 3}: ${ramp[at]}`);
    ends.add(ramp[at]);
  }
  assert.ok(ends.size > 5, `${[...ends]}`);
};

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
  const path = join(folder, 'looks.gltf');
  let daemon;
  try {
    writeLooks(path);
    daemon = await startStill(path);
    const cameras = ['', '0.5,3,2:0,0.3,0:3m', '0.5,3,2:0,0.3,0:60'];
    await comparePictures(daemon, path, { direct: 'tiles', exposure: '0', cameras });
  } finally {
    await daemon?.stop();
    rmSync(folder, { recursive: true });
  }
});

test('a page lives on', { skip: missing || false }, async () => {
  let daemon = await startDaemon('builtin:cornell', '--clock', 'manual');
  const port = new URL(daemon.url).port;
  const live = async (page, context) => {
    await page.goto(daemon.url);
    await until(page, 'the scene', () => lightwell.stats.sceneMs > 0);
    daemon.frames(1);
    await until(page, 'light', () => lightwell.stats.interest > 0 && lightwell.stats.missing === 0);
    const { sceneMs, firstMs, allMs } = await page.evaluate(() => lightwell.stats);
    const after = [firstMs, allMs].map((ms) => Math.round(ms - sceneMs));
    console.log(`first light ${after[0]} ms after the scene, all of the view's ${after[1]} ms`);

    // nothing changes: it stops drawing, though it meters its exposure, and the legend says how things are
    const legend = () => page.evaluate(() => document.getElementById('legend').textContent);
    await until(page, 'a picture that is complete', () =>
      /^picture complete · light complete · .*\d+ kbit\/s/.test(
        document.getElementById('legend').textContent,
      ),
    );
    assert.doesNotMatch(await legend(), /NaN|undefined|Infinity/);
    await checkAccessibility(page, 'lit');
    await showState(page, 'lit');

    // mouse and keys
    const viewAfter = async (before) => {
      await until(page, 'another view', (view) => lightwell.view() !== view, { given: before });
      return page.evaluate(() => lightwell.view());
    };
    const before = await page.evaluate(() => lightwell.view());
    await page.mouse.move(80, 40);
    await page.mouse.down();
    await page.mouse.move(110, 50);
    await page.mouse.up();
    const turned = await viewAfter(before);
    await page.keyboard.down('w');
    await viewAfter(turned);
    await page.keyboard.up('w');

    // a narrow window: what keys do, fingers reach, and nothing covers anything
    await resizeAround(page, { width: 480, height: 640 });
    assert.deepEqual(await checkLayout(page, 'narrow'), ['legend', 'help', 'tools']);
    await showState(page, 'narrow');
    const view = await page.evaluate(() => lightwell.view());
    await page.getByRole('combobox', { name: 'Camera' }).selectOption('All of it');
    await viewAfter(view);
    await page.getByRole('button', { name: 'Darker' }).click(); // by hand from here on
    const stops = await page.evaluate(() => lightwell.exposure());
    await page.getByRole('button', { name: 'Brighter' }).click();
    assert.equal(await page.evaluate(() => lightwell.exposure()), stops + 0.25);
    const auto = page.getByRole('button', { name: 'Automatic exposure' });
    assert.equal(await auto.getAttribute('aria-pressed'), 'false');
    await auto.click();
    assert.equal(await auto.getAttribute('aria-pressed'), 'true');
    const [download] = await Promise.all([
      page.waitForEvent('download'),
      page.getByRole('button', { name: 'Save picture' }).click(),
    ]);
    assert.equal(download.suggestedFilename(), 'lightwell.png');
    await page.evaluate(() => (document.querySelector('canvas').style.cssText = ''));
    await page.setViewportSize({ width: 160, height: 90 });

    // as a scene without a camera is seen: the worker has said around what
    const whole = await page.evaluate(() => lightwell.view());
    await page.evaluate(() => Object.assign(lightwell, { cameras: [], framed: false }));
    assert.match(await viewAfter(whole), /:35$/);
    assert.ok(await page.evaluate(() => lightwell.body.low.every((low, k) => low < lightwell.body.high[k])));

    // a frame that is newer than the picture is not of the future
    const age = await page.evaluate(() => {
      const { frameMs, solveMs, stats } = lightwell;
      const { settled } = stats;
      Object.assign(lightwell, { frameMs: performance.now() + 5000, solveMs: 0 });
      stats.settled = -1;
      lightwell.showLegend(performance.now());
      Object.assign(lightwell, { frameMs, solveMs });
      stats.settled = settled;
      return document.getElementById('legend').textContent;
    });
    assert.match(age, /light 0\.0 s old/);

    // a window without room: pictures of one pixel, and a view that stays one
    await page.evaluate(() => (document.querySelector('canvas').style.cssText = 'width: 0; height: 0'));
    await page.keyboard.press('0');
    await until(page, 'a canvas of one pixel', () => document.querySelector('canvas').width === 1);
    assert.doesNotMatch(await page.evaluate(() => lightwell.view()), /NaN|Infinity/);
    await page.evaluate(() => (document.querySelector('canvas').style.cssText = ''));
    await page.keyboard.press('0');
    await until(page, 'the canvas again', () => document.querySelector('canvas').width > 1);
    await checkUploads(page, 'lightwell', 'lightwell.takeTiles()');

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
    await until(
      page,
      'light again',
      (count) => lightwell.stats.tiles > count && lightwell.message() === '',
      { given: tiles },
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
    // complete as its light may be
    const away = await page.evaluate(() => {
      const { stats } = lightwell;
      Object.assign(stats, { missing: 0, settled: stats.frames });
      lightwell.showLegend(performance.now());
      return document.getElementById('legend').textContent;
    });
    assert.doesNotMatch(away, /light complete|on their way/);
    await showState(page, 'away');
    // the clock holds the next one before its first frame: it answers, and has no light yet
    daemon = await startDaemon('builtin:cornell', '--http', `127.0.0.1:${port}`, '--clock', 'manual');
    await until(page, 'its wait', () => /^The server is lighting/.test(document.getElementById('wait').textContent));
    assert.equal(await page.evaluate(() => lightwell.message()), '');
    assert.doesNotMatch(await legend(), /light complete/);
    await showState(page, 'relighting');
    const frames = await page.evaluate(() => lightwell.stats.frames);
    daemon.frames(1);
    await until(
      page,
      'light of another server',
      (count) => lightwell.stats.frames > count && lightwell.message() === '',
      { given: frames },
    );

    // a server that answers, and has nothing to say yet
    let connections = 0;
    const loose = await context.browser().newContext({ bypassCSP: true }); // it may ask other servers
    const dumb = new WebSocketServer({ host: '127.0.0.1', port: 0 });
    const welcome = readFileSync(join(root, 'tests/golden/v1/welcome.bin'));
    dumb.on('connection', (socket) => (connections++ ? socket.send(welcome) : socket.close()));
    try {
      const early = await loose.newPage();
      await early.addInitScript(() => {
        globalThis.said = [];
        new MutationObserver(() => {
          const text = document.getElementById('message')?.textContent ?? '';
          if (said.at(-1) !== text) said.push(text);
        }).observe(document, { subtree: true, childList: true });
      });
      await early.goto(`${daemon.url}?server=ws://127.0.0.1:${dumb.address().port}/ws`);
      await until(early, 'an end, and an answer', () => {
        const end = said.findIndex((text) => /does not answer/.test(text));
        return end >= 0 && said[end + 1] === '';
      });
    } finally {
      await loose.close();
      dumb.close();
      for (const socket of dumb.clients) socket.terminate();
    }

    // a GPU that is slow: pictures of lights that the page draws take too long
    const slow = await context.newPage();
    await slow.addInitScript(() => {
      const { getParameter } = WebGL2RenderingContext.prototype;
      WebGL2RenderingContext.prototype.getParameter = function (name) {
        return name === 0x9246 ? 'a GPU' : getParameter.call(this, name); // UNMASKED_RENDERER_WEBGL
      };
    });
    await slow.goto(`${daemon.url}?camera=0,1,3:0,1,0:45`);
    await until(slow, 'the scene', () => lightwell.stats.sceneMs > 0);
    daemon.frames(1);
    await until(slow, 'a picture', () => lightwell.stats.pictures > 0);
    await slow.evaluate(() => {
      lightwell.go('0.5,1,2:0,1,0:45');
      for (let picture = 0; picture < 3; picture++) lightwell.judgePicture(101);
    });
    await until(slow, 'another scene', () => lightwell.renderer && lightwell.lightsDrawn().lights === 0);
    daemon.frames(1);
    await until(slow, 'light in tiles', () => lightwell.stats.tiles > 0 && !lightwell.stats.missing);
    await until(slow, 'a word of it', () => /a slow GPU/.test(document.getElementById('legend').textContent));
    assert.match(await slow.evaluate(() => lightwell.view()), /^0\.5,1,2:/); // it stays
    await slow.close();

    // a browser without WebGL2
    const plain = await context.newPage();
    await plain.addInitScript(() => {
      HTMLCanvasElement.prototype.getContext = () => null;
    });
    await plain.goto(daemon.url);
    assert.match(await plain.evaluate(() => lightwell.message()), /no WebGL2/);
  };
  try {
    await withPage({ width: 160, height: 90 }, live, { mayWarn: true });
  } finally {
    await daemon.stop();
  }
});
