// lightwell-three: finer levels. Tiles come where the camera looks, and bring the picture nearer to that of
// dense lightmaps. They go when it looks away. A server may have none.
import assert from 'node:assert/strict';
import { existsSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test, { after, before } from 'node:test';

import { bin, hasDaemon, startDaemon } from './daemon.mjs';
import { serveExample } from './example.mjs';
import { web } from './load.mjs';
import { compare, hasBrowser, pictureName, pixelsOf, reference, until } from './page.mjs';
import { room } from './room.mjs';
import { withPage } from './shared.mjs';

const WIDTH = 320;
const HEIGHT = 180;
const missing =
  !hasDaemon() || !existsSync(join(bin, 'compare_pictures'))
    ? 'there is no lightwelld in build/release/bin'
    : !hasBrowser() && 'there is no chromium';
const skip = { skip: missing || false };
/** All light is in lightmaps, few texels a metre. */
const LIGHT = '--light seen --client-lights none --bounces 1 --error 0.05'.split(' ');
const COARSE = [...LIGHT, '--texels-per-metre', '2'];
/** What finer levels of the former come to. */
const DENSE = [...LIGHT, '--texels-per-metre', '16', '--detail', '0'];
const CAMERA = '--wait good --camera 1.5,1.7,2.2:-0.2,1,-1:60 --exposure 1 --tonemap none'.split(' ');

let folder, scene, site;

before(() => {
  if (missing) return;
  folder = mkdtempSync(join(tmpdir(), 'lightwell-three-'));
  scene = join(folder, 'scene.gltf');
  writeFileSync(scene, room());
  return serveExample(join(web, '../lightwell-three'), scene).then((it) => (site = it));
});

after(() => {
  site?.server.close();
  site?.server.closeAllConnections();
  if (folder) rmSync(folder, { recursive: true });
});

/** A page with the globals of three_page.html, and a server of its own. */
async function withLight(more, look) {
  const daemon = await startDaemon(scene, ...COARSE, ...more, '--http-origin', site.origin);
  const address = `ws://${new URL(daemon.url).host}/ws`;
  const open = async (page) => {
    await page.goto(`${site.origin}/test.html`);
    await until(page, 'its modules', () => globalThis.load);
    return look(page, address);
  };
  try {
    return await withPage({ width: WIDTH, height: HEIGHT }, open, { mayWarn: true });
  } finally {
    await daemon.stop();
  }
}

/** Light for a scene of its own; draws until end(). */
const attach = async ([address, options]) => {
  globalThis.scene = await load();
  scene.updateMatrixWorld(true);
  globalThis.light = await Lightwell.attach(scene, address, options);
  const draw = () => {
    if (!globalThis.light) return;
    light.update(camera, innerHeight);
    renderer.render(scene, camera);
    requestAnimationFrame(draw);
  };
  draw();
  return light.finerLevels;
};

const end = () => {
  light.dispose();
  globalThis.light = null;
  renderer.render(new THREE.Scene(), camera);
  return renderer.info.memory.textures;
};

/** The page's picture once nothing changes: as many tiles as before for a while of frames. */
const settle = (page, tiles) =>
  until(
    page,
    `${tiles} tiles`,
    (least) => {
      const now = light.finerTiles;
      globalThis.same = now === globalThis.before ? (globalThis.same ?? 0) + 1 : 0;
      globalThis.before = now;
      return now >= least && same > 40;
    },
    { given: tiles },
  );

async function denseReference(page) {
  const dense = await startDaemon(scene, ...DENSE);
  try {
    return await reference(page, dense, `${WIDTH}x${HEIGHT}`, CAMERA, pictureName('room', 'finer-cpu'));
  } finally {
    await dense.stop();
  }
}

/** what: a name, for people. */
async function pictureOf(page, what) {
  const url = await page.evaluate(() => {
    renderer.render(scene, camera);
    return renderer.domElement.toDataURL();
  });
  const name = pictureName('room', what);
  if (name) writeFileSync(name, Buffer.from(url.slice(url.indexOf(',') + 1), 'base64'));
  return pixelsOf(page, url);
}

test('three: finer levels come where the camera looks, and go', skip, () =>
  withLight([], async (page, address) => {
    assert.equal(await page.evaluate(attach, [address, {}]), 0);
    await settle(page, 0);
    const wanted = await denseReference(page);
    const plain = compare(WIDTH, HEIGHT, wanted, await pictureOf(page, 'plain'));
    const textures = await page.evaluate(end);
    assert.equal(await page.evaluate(attach, [address, { finerSlots: 128 }]), 4);
    await settle(page, 6);
    const tiles = await page.evaluate(() => light.finerTiles);
    const finer = compare(WIDTH, HEIGHT, wanted, await pictureOf(page, 'finer'));
    console.log(`level 0 alone: mean difference ${plain.difference}/255, FLIP ${plain.flip};`);
    console.log(`with ${tiles} tiles of finer levels: ${finer.difference}/255, FLIP ${finer.flip}`);
    assert.ok(finer.flip < 0.75 * plain.flip, `FLIP ${finer.flip}, before ${plain.flip}`);
    assert.ok(tiles <= 128);
    await page.evaluate(() => camera.position.set(0, 500, 0)); // above the room, whose ceiling has one side
    await until(page, 'tiles that go', () => light.finerTiles === 0);
    await page.evaluate(() => camera.position.set(1.5, 1.7, 2.2));
    await until(page, 'tiles that come again', () => light.finerTiles > 5);
    assert.equal(await page.evaluate(end), textures);
  }),
);

test('three: few slots, none, and a server without finer levels', skip, () =>
  withLight(['--detail', '0'], async (page, address) => {
    for (const finerSlots of [-1, 1.5, 1025, 'all']) {
      const error = await page.evaluate(
        ([address, finerSlots]) =>
          load()
            .then((scene) => Lightwell.attach(scene, address, { finerSlots }))
            .catch(({ code, message }) => `${code}: ${message}`),
        [address, finerSlots],
      );
      assert.equal(error, `option: finerSlots: ${finerSlots}: it is not a whole number from 0 to 1024`);
    }
    assert.equal(await page.evaluate(attach, [address, { finerSlots: 128 }]), 0);
    await settle(page, 0);
    assert.deepEqual(await page.evaluate(() => [light.finerTiles, light.state]), [0, 'live']);
    await page.evaluate(end);
    const other = await startDaemon(scene, ...COARSE, '--http-origin', site.origin);
    try {
      const url = `ws://${new URL(other.url).host}/ws`;
      assert.equal(await page.evaluate(attach, [url, { finerSlots: 3 }]), 4);
      await settle(page, 3);
      assert.equal(await page.evaluate(() => light.finerTiles), 3);
      await page.evaluate(end);
    } finally {
      await other.stop();
    }
  }),
);
