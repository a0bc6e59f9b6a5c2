// lightwell-three: finer levels. Tiles come where the camera looks, and bring the picture nearer to that of
// dense lightmaps. They go when it looks away. A server may have none. With LW_LONG WebGPURenderer by WebGPU,
// and its directions.
import assert from 'node:assert/strict';
import { existsSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test, { after, before } from 'node:test';

import { bin, hasDaemon, startDaemon } from './daemon.mjs';
import { readTarget, serveExample } from './example.mjs';
import { web } from './load.mjs';
import { compare, hasBrowser, pictureName, pixelsOf, reference, until } from './page.mjs';
import { room } from './room.mjs';
import { WEBGPU, withPage } from './shared.mjs';

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

/** A page with the globals of three_page.html, and a server of its own. renderer: '' or of that page. */
async function withLight(more, look, renderer = '') {
  const daemon = await startDaemon(scene, ...COARSE, ...more, '--http-origin', site.origin);
  const address = `ws://${new URL(daemon.url).host}/ws`;
  const open = async (page) => {
    await page.goto(`${site.origin}/test.html${renderer && `?renderer=${renderer}`}`);
    await until(page, 'its modules', () => globalThis.load);
    return look(page, address);
  };
  try {
    return await withPage({ width: WIDTH, height: HEIGHT }, open, { mayWarn: true, args: WEBGPU });
  } finally {
    await daemon.stop();
  }
}

/** Light for a scene of its own; draws until end(). bent: all surfaces have the same bent normal. */
const attach = async ([address, options, bent]) => {
  globalThis.scene = await load();
  globalThis.example = { scene, camera, renderer };
  globalThis.constant = (...rgb) => {
    const map = new THREE.DataTexture(Uint8Array.of(...rgb, 255), 1, 1);
    map.needsUpdate = true;
    return map;
  };
  const normalMap = bent && constant(168, 222, 150);
  scene.traverse(({ material }) => {
    if (!bent || !material) return;
    Object.assign(material, { normalMap, normalMapType: THREE.ObjectSpaceNormalMap });
    material.normalScale.set(1, 1); // as in three_directions.test.mjs
  });
  scene.updateMatrixWorld(true);
  globalThis.light = await Lightwell.attach(scene, address, { ...options, tsl: globalThis.tsl });
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

/** In the page: pictures with directions of finer levels (`finer`), and of level 0 alone (`plain`). Level 0
 * has its own ones, or in `other` one direction everywhere; in `both` finer levels have that, too. */
const drawDirections = () => {
  const { pool, placed } = light;
  const draw = () => {
    // WebGPURenderer does not look at what is changed here
    for (const each of placed) for (const { material } of each.materials) material.needsUpdate = true;
    renderer.render(scene, camera);
    return renderer.domElement.toDataURL();
  };
  const layers = pool.farther.value;
  const drawBoth = () => {
    const finer = draw();
    pool.farther.value = 0;
    const plain = draw();
    pool.farther.value = layers;
    return { finer, plain };
  };
  const own = pool.texels.slice(layers * 65 ** 2).filter((word) => word).length;
  const pictures = { own: drawBoth() };
  for (const each of placed)
    if (each?.directions) each.directions.uniforms.lightwellDirections.value = constant(230, 60, 128);
  pictures.other = drawBoth();
  const word = [230, 60, 128].reduce((sum, x, k) => sum | (Math.round((511 * x) / 255) << (9 * k)), 15 << 27);
  pool.texels.fill(word >>> 0, layers * 65 ** 2);
  pool.pool.needsUpdate = true;
  pictures.both = drawBoth();
  return { own, slots: pool.slots, layers, pictures };
};

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
  const drawn = await page.evaluate(() => {
    if (renderer.backend?.isWebGPUBackend) return null;
    renderer.render(scene, camera);
    return renderer.domElement.toDataURL();
  });
  const url = drawn ?? (await page.evaluate(readTarget));
  const name = pictureName('room', what);
  if (name) writeFileSync(name, Buffer.from(url.slice(url.indexOf(',') + 1), 'base64'));
  return pixelsOf(page, url);
}

const comeAndGo = (renderer) =>
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
    if (renderer !== 'webgpu') return;
    // WebGPU takes 256 layers
    await page.evaluate(attach, [address, { finerSlots: 300 }]);
    await settle(page, 6);
    assert.deepEqual(await page.evaluate(() => [light.pool.slots, light.pool.pool.image.depth]), [256, 256]);
    await page.evaluate(end);
  }, renderer);

const long = { skip: missing || (!process.env.LW_LONG && 'LW_LONG is not set') };
const comes = 'three: finer levels come where the camera looks, and go';
test(comes, skip, () => comeAndGo(''));
test(`${comes}, with WebGPURenderer by WebGL`, skip, () => comeAndGo('nodes'));
test(`${comes}, with WebGPURenderer by WebGPU`, long, () => comeAndGo('webgpu'));

/** Share of the values that are further apart than their rounding. */
function shareApart(a, b) {
  let apart = 0;
  for (let i = 0; i < a.length; i++) apart += Math.abs(a[i] - b[i]) > 3;
  return apart / a.length;
}

const readDirections = (renderer) =>
  withLight(['--directional', 'on'], async (page, address) => {
    assert.equal(await page.evaluate(attach, [address, { finerSlots: 128 }, true]), 4);
    await settle(page, 6);
    const { own, slots, layers, pictures } = await page.evaluate(drawDirections);
    assert.deepEqual([slots, layers], [128, 128]);
    assert.ok(own > 64 * 64, `${own} texels of directions`);
    const pixels = {};
    for (const [name, { finer, plain }] of Object.entries(pictures))
      pixels[name] = { finer: await pixelsOf(page, finer), plain: await pixelsOf(page, plain) };
    const { own: known, other, both } = pixels;
    const [reads, changes, changesPlain, same] = [
      shareApart(known.finer, known.plain),
      shareApart(known.finer, other.finer),
      shareApart(known.plain, other.plain),
      shareApart(both.finer, both.plain),
    ];
    console.log(`directions of finer levels change ${reads} of the values;`);
    console.log(`other ones of level 0 ${changes}, and ${changesPlain} where finer levels have none`);
    assert.ok(reads > 0.01);
    assert.ok(changesPlain > 0.2 && changes < 0.5 * changesPlain);
    assert.ok(same < 0.001, `${same} differ where both have one direction`);
    await page.evaluate(end);
    if (renderer) return;
    // a GPU with fewer layers
    for (const [most, room] of [[200, 128], [100, 100]]) { // prettier-ignore
      await page.evaluate((most) => {
        const gl = renderer.getContext();
        const all = Object.getPrototypeOf(gl).getParameter;
        gl.getParameter = (name) => (name === gl.MAX_ARRAY_TEXTURE_LAYERS ? most : all.call(gl, name));
      }, most);
      await page.evaluate(attach, [address, { finerSlots: 128 }, true]);
      await settle(page, 6);
      const given = await page.evaluate(() => {
        const { pool } = light;
        return [pool.slots, pool.farther.value, pool.pool.image.depth];
      });
      assert.deepEqual(given, [room, 0, room]);
      await page.evaluate(end);
    }
  }, renderer);

const reads = 'three: finer levels read their own directions, as level 0 does its';
test(reads, skip, () => readDirections(''));
test(`${reads}, with WebGPURenderer`, long, () => readDirections('nodes'));

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
