// lightwell-three: where light comes from. What three draws of bent normals and of mirrors is that of
// common/light/direction_form.h; without directions it is the picture of before.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test, { after, before } from 'node:test';

import { hasDaemon, startDaemon } from './daemon.mjs';
import { serveExample } from './example.mjs';
import { web } from './load.mjs';
import { hasBrowser, pixelsOf, until } from './page.mjs';
import { room } from './room.mjs';
import { WEBGPU, withPage } from './shared.mjs';

const WIDTH = 160;
const HEIGHT = 90;
const FRAMES = 4;
const PLACES = 120;
/** Texels have 9 bits, and GPUs read between them by 8. */
const TOLERANCE = 0.02;
const missing = !hasDaemon()
  ? 'there is no lightwelld in build/release/bin'
  : !hasBrowser() && 'there is no chromium';
const skip = { skip: missing || false };
const LIGHT = '--clock manual --light whole --codec half --client-lights none --texels-per-metre 6';

let folder, scene, site;

before(async () => {
  if (missing) return;
  folder = mkdtempSync(join(tmpdir(), 'lightwell-three-'));
  scene = join(folder, 'scene.gltf');
  writeFileSync(scene, room());
  site = await serveExample(join(web, '../lightwell-three'), scene);
});

after(() => {
  site?.server.close();
  site?.server.closeAllConnections();
  if (folder) rmSync(folder, { recursive: true });
});

/** A server that is held before its first frame. */
async function withServer(directional, run) {
  const more = ['--directional', directional, '--http-origin', site.origin];
  const daemon = await startDaemon(scene, ...LIGHT.split(' '), ...more);
  try {
    await run(daemon);
  } finally {
    await daemon.stop();
  }
}

/** renderer: '' or of three_page.html. */
function withThree(three, look, renderer = '') {
  const open = async (page) => {
    const folder = three === 'three' ? '' : `/${three}`;
    await page.goto(`${site.origin}${folder}/test.html${renderer && `?renderer=${renderer}`}`);
    await until(page, 'its modules', () => globalThis.load);
    return look(page);
  };
  return withPage({ width: WIDTH, height: HEIGHT }, open, { mayWarn: true, args: WEBGPU });
}

/** In the page: walls and box have a normal map, the same bent normal everywhere; the shelf is a mirror. The
 * scene is turned and larger than the server's. */
const begin = async ([address, options]) => {
  globalThis.scene = await load();
  scene.rotation.set(0.2, 0.7, -0.3);
  scene.scale.setScalar(1.5);
  scene.updateMatrixWorld(true);
  const texel = (...rgb) => {
    const map = new THREE.DataTexture(Uint8Array.of(...rgb, 255), 1, 1);
    map.needsUpdate = true;
    return map;
  };
  globalThis.unknown = texel(0, 0, 0);
  globalThis.noLight = texel(128, 128, 128);
  const bits = Uint8Array.from({ length: 64 * 64 * 4 }, (_, i) => {
    const word = Math.imul((i >> 2) * 3 + (i & 3) + 1, 0x9e3779b1) >>> 8;
    return i % 5 ? word : 255 * (word & 1);
  });
  globalThis.wild = new THREE.DataTexture(bits, 64, 64);
  wild.needsUpdate = true;
  globalThis.wordOf = (...rgb) =>
    rgb.reduce((sum, x, k) => sum | (Math.round((511 * x) / 255) << (9 * k)), 15 << 27) >>> 0;
  globalThis.bentTexel = [168, 222, 150];
  globalThis.normalMap = texel(...bentTexel);
  scene.traverse(({ material }) => {
    const bent = { normalMap, normalMapType: THREE.ObjectSpaceNormalMap };
    if (material?.name === 'wall') {
      Object.assign(material, bent);
      material.normalScale.set(1, 1); // WebGPURenderer scales normals of this kind, too; GLTFLoader turned y
    }
    if (material?.name === 'green') {
      Object.assign(material, { metalness: 1, roughness: 0.3 });
      material.color.setScalar(1);
    }
  });
  globalThis.light = null;
  globalThis.lighting = false;
  const onState = (state) => (globalThis.lighting ||= state === 'lighting');
  const tsl = options.tsl && globalThis.tsl;
  Lightwell.attach(scene, address, { ...options, tsl, onState }).then((it) => (globalThis.light = it));
};

/** All tiles of FRAMES frames: none comes for a second. */
async function untilLit(page) {
  await until(page, 'the first light', () => globalThis.light);
  await until(
    page,
    'the last tiles',
    (frame) => {
      camera.position.set(0, 1.5, 30);
      camera.lookAt(0, 0, 0);
      light.update(camera, 1e5);
      if (light.frame < frame || light.queue.length) return false;
      const maps = light.placed.flatMap(({ lightmap, directions }) => [lightmap, directions?.map]);
      let sum = 0;
      for (const map of maps) for (const word of map?.texels ?? []) sum = (Math.imul(sum, 31) + word) | 0;
      globalThis.same = sum === globalThis.before ? globalThis.same + 1 : 0;
      globalThis.before = sum;
      return same > 10;
    },
    { given: FRAMES },
  );
}

async function attach(page, daemon, options) {
  await page.evaluate(begin, [`ws://${new URL(daemon.url).host}/ws`, options]);
  if (!daemon.lit) {
    await until(page, 'the scene', () => lighting);
    daemon.frames(FRAMES);
    daemon.lit = true;
  }
  await untilLit(page);
}

/** In the page. */
const end = () => {
  light.dispose();
  normalMap.dispose();
  for (const texture of [unknown, noLight, wild]) texture.dispose();
};

/** In the page: one pixel of each of many places, with directions over without; and what it is made of. */
const look = async (places) => {
  const nodes = !!renderer.isWebGPURenderer;
  const Target = nodes ? THREE.RenderTarget : THREE.WebGLRenderTarget;
  const target = new Target(1, 1, { type: THREE.FloatType });
  const eye = new THREE.PerspectiveCamera(0.1, 1, 0.01, 100);
  const ray = new THREE.Raycaster();
  const draw = async () => {
    renderer.setRenderTarget(target);
    renderer.render(scene, eye);
    if (nodes) return (await renderer.readRenderTargetPixelsAsync(target, 0, 0, 1, 1))[1];
    const rgba = new Float32Array(4);
    renderer.readRenderTargetPixels(target, 0, 0, 1, 1, rgba);
    return rgba[1];
  };
  const drawWith = (placed, texture) => {
    placed.directions.uniforms.lightwellDirections.value = texture;
    for (const { material } of placed.materials) material.needsUpdate ||= nodes;
    return draw();
  };
  const lerp = (attribute, width, { a, b, c }, at) =>
    Array.from({ length: width }, (_, k) =>
      [a, b, c].reduce((sum, v, i) => sum + at.getComponent(i) * attribute.array[width * v + k], 0),
    );
  const texelAt = ({ texels, width, height }, [u, v]) => {
    const clamp = (x, most) => Math.min(Math.max(x, 0), most - 1);
    const [x, y] = [u * width - 0.5, v * height - 0.5];
    const [i, j] = [Math.floor(x), Math.floor(y)];
    const sum = [0, 0, 0];
    for (let k = 0; k < 4; k++) {
      const weight = (k & 1 ? x - i : 1 - x + i) * (k >> 1 ? y - j : 1 - y + j);
      const word = texels[clamp(j + (k >> 1), height) * width + clamp(i + (k & 1), width)];
      const scale = weight * 2 ** ((word >>> 27) - 24);
      [0, 9, 18].forEach((shift, c) => (sum[c] += scale * ((word >>> shift) & 511)));
    }
    return sum;
  };
  let seed = 1;
  const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
  const meshes = light.placed.map(({ mesh }) => mesh);
  const found = [];
  for (let i = 0; i < places; i++) {
    // from the middle of the room to everywhere; each third to the shelf, half of these from behind it, where
    // it mirrors the lamp
    eye.position.set(0.4 * random(), 1.6 + 0.5 * random(), 0.5 + random());
    if (i % 6 === 0) eye.position.set(1.4 + 0.4 * random(), 1.6 + 0.6 * random(), -2.3);
    const to = new THREE.Vector3(random() - 0.5, random() - 0.5, random() - 0.5).normalize();
    if (i % 3 === 0) to.set(1.2 + 0.5 * random(), 1.2, -1.5 + 0.3 * random()).sub(eye.position);
    scene.localToWorld(eye.position);
    to.transformDirection(scene.matrixWorld);
    eye.lookAt(eye.position.clone().add(to));
    eye.updateMatrixWorld(true);
    ray.set(eye.position, to);
    const hit = ray.intersectObjects(meshes, false)[0];
    const placed = hit && light.placed.find(({ mesh }) => mesh === hit.object);
    const material = placed && [placed.mesh.material].flat()[hit.face.materialIndex];
    if (!placed?.directions?.map || !(material.normalMap || material.metalness)) continue;
    const { attributes } = placed.mesh.geometry;
    const { a, b, c } = hit.face;
    const corners = [a, b, c].map((v) => new THREE.Vector3().fromBufferAttribute(attributes.position, v));
    const local = placed.mesh.worldToLocal(hit.point.clone());
    const at = THREE.Triangle.getBarycoord(local, ...corners, new THREE.Vector3());
    const turn = new THREE.Matrix3().getNormalMatrix(placed.mesh.matrixWorld);
    const normal = (xyz) => new THREE.Vector3(...xyz).applyMatrix3(turn).normalize();
    const plain = normal(lerp(attributes.normal, 3, hit.face, at));
    const bent = material.normalMap ? normal(bentTexel.map((x) => (2 * x) / 255 - 1)) : plain;
    const texel = texelAt(placed.directions.map, lerp(attributes.uv2, 2, hit.face, at));
    const r = new THREE.Vector3(...texel.map((x) => 2 * x - 1));
    if (texel.every((x) => !x)) r.set(0, 0, 0);
    const known = r.lengthSq() > 0.02 ** 2;
    r.applyQuaternion(scene.quaternion);
    const map = placed.directions.uniforms.lightwellDirections.value;
    const directed = await draw();
    const even = await drawWith(placed, unknown);
    const dark = await drawWith(placed, noLight);
    const hostile = await drawWith(placed, wild);
    await drawWith(placed, map);
    const ahead = to.clone().reflect(plain);
    if (even > 0)
      found.push({
        ratio: directed / even,
        dark: dark / even,
        hostile: hostile / even,
        mirror: !material.normalMap,
        known,
        ...Object.fromEntries(
          Object.entries({ r, plain, bent, ahead }).map(([name, vector]) => [name, vector.toArray()]),
        ),
      });
  }
  target.dispose();
  renderer.setRenderTarget(null);
  return found;
};

/** In the page: of each object with bent normals, its middle without directions, and with those of tiles that
 * come when it has been drawn. Camera and object rest. */
const drawArriving = async () => {
  const target = new THREE.RenderTarget(1, 1, { type: THREE.FloatType });
  const eye = new THREE.PerspectiveCamera(0.1, 1, 0.01, 100);
  renderer.setRenderTarget(target);
  const draw = async () => {
    for (let i = 0; i < 2; i++) renderer.render(scene, eye);
    return (await renderer.readRenderTargetPixelsAsync(target, 0, 0, 1, 1))[1];
  };
  const seen = [];
  for (const [object, placed] of light.placed.entries()) {
    const { mesh, directions, materials } = placed;
    if (!directions?.map || !materials.some(({ material }) => material.normalMap)) continue;
    directions.map = null;
    directions.uniforms.lightwellDirections.value = unknown;
    for (const { material } of materials) material.needsUpdate = true;
    const shown = light.placed.map((each) => each.mesh.visible);
    for (const each of light.placed) each.mesh.visible = each.mesh.name === mesh.name;
    const middle = mesh.localToWorld(new THREE.Vector3(0, 0, 0));
    eye.position.copy(mesh.name === 'box' ? mesh.localToWorld(new THREE.Vector3(0, 0, 2)) : middle);
    eye.lookAt(mesh.localToWorld(new THREE.Vector3(0, 0, -0.5)));
    const before = await draw();
    const first = light.map.firstTile[object];
    const { firstTile, tilesX, tilesY } = light.map.of(object).levels[0];
    for (let id = first + firstTile; id < first + firstTile + tilesX * tilesY; id++) {
      const { width, height } = light.map.place(id);
      light.takeDirections({ id, texels: new Uint32Array(width * height).fill(wordOf(230, 60, 128)) });
    }
    seen.push({ name: mesh.name, before, after: await draw() });
    light.placed.forEach((each, i) => (each.mesh.visible = shown[i]));
  }
  renderer.setRenderTarget(null);
  target.dispose();
  return seen;
};

const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
const mad = (a, b, s) => a.map((x, k) => x + s * b[k]);
const scaled = (a, s) => a.map((x) => x * s);

/** lw_direction_source_of(). */
function sourceOf(r, n) {
  const even = { direction: n, share: 0 };
  const long2 = dot(r, r);
  if (long2 > 1) r = scaled(r, 1 / Math.sqrt(long2));
  r = mad(r, n, Math.max(-dot(r, n), 0));
  const u = mad(r, n, -2 / 3);
  const up = 1.2 * dot(u, n);
  const share = Math.min(up + Math.sqrt(up * up + 1.8 * dot(u, u)), 1);
  if (!(share > 0.02)) return even;
  const d = mad(scaled(u, 1 / share), n, 2 / 3);
  return { direction: scaled(d, 1 / Math.sqrt(dot(d, d))), share };
}

/** lw_direction_factor(). */
function factorOf({ direction, share }, n, m) {
  const wide = (1 - share) / 2;
  const lobe = (q) => (1 - wide) * Math.max(dot(direction, q), 0) + (wide * (1 + dot(direction, q))) / 2;
  const own = lobe(n);
  const factor = 1 + wide * (dot(n, m) - 1) + (share * (lobe(m) - own)) / Math.max(own, 0.05);
  return Math.min(Math.max(factor, 0), 4);
}

/** lw_direction_gain(). */
function gainOf({ direction, share: w }, n, ahead, alpha) {
  const sharp = 2 + (12 * w) / (1.02 - w);
  const q = 0.5 / alpha ** 2;
  const k = (sharp * q) / (sharp + q);
  const high = (1 / Math.tanh(k) - 1 / k) * dot(direction, n);
  const cosine = Math.max((high + Math.sqrt(high ** 2 + 1 / (4 + (Math.PI * k) / 2))) / 2, 0.05);
  const lobe = (k * Math.exp(k * (dot(ahead, direction) - 1))) / (2 * cosine * (1 - Math.exp(-2 * k)));
  return Math.min(1 - w + w * lobe, 8);
}

function check(found, what) {
  const spread = { bent: [], mirror: [] };
  for (const { ratio, dark, hostile, mirror, known, r, plain, bent, ahead } of found) {
    assert.equal(dark, 1, `${what}: nothing is known`);
    assert.ok(hostile >= 0 && hostile <= (mirror ? 8 : 4) * 1.01, `${what}: ${hostile} of any bits`);
    const source = sourceOf(r, plain);
    const [kind, wanted] = mirror
      ? ['mirror', gainOf(source, plain, ahead, 0.3 ** 2)]
      : ['bent', factorOf(source, plain, bent)];
    const most = TOLERANCE * Math.max(wanted, 1);
    const right = known ? wanted : 1;
    spread[kind].push(right);
    assert.ok(Math.abs(ratio - right) <= most, `${what}, ${kind}: ${ratio}, wanted ${right} of r ${r}`);
  }
  for (const [kind, all] of Object.entries(spread)) {
    const [least, most] = [Math.min(...all), Math.max(...all)];
    console.log(`${what}, ${kind}: ${all.length} places, ${least.toFixed(2)} to ${most.toFixed(2)}`);
    assert.ok(all.length >= 10 && least < 0.8 && most > 1.05, `${what}, ${kind}: the test sees something`);
  }
}

function checkArriving(seen, what) {
  assert.ok(seen.length >= 2, `${what}: objects that share their program`);
  for (const { name, before, after } of seen) {
    console.log(`${what}, ${name}: ${before}, with directions ${after}`);
    assert.ok(before > 0 && Math.abs(after - before) > 0.02 * before, `${what}, ${name}: they are shown`);
  }
}

test('three: bent normals and mirrors show which side light comes from', skip, () =>
  withServer('on', async (daemon) => {
    for (const [three, finerSlots, renderer = ''] of [
      ['three', 0],
      ['three', 16],
      ['three-170', 0],
      ['three-160', 0],
      ['three', 0, 'nodes'],
      ['three', 16, 'webgpu'],
    ])
      await withThree(
        three,
        async (page) => {
          await attach(page, daemon, { finerSlots, tsl: !!renderer });
          check(await page.evaluate(look, PLACES), `${three}, ${finerSlots} slots ${renderer}`);
          if (renderer) checkArriving(await page.evaluate(drawArriving), `${three} ${renderer}`);
          await page.evaluate(end);
        },
        renderer,
      );
  }),
);

test('three: without directions it is the picture of before', skip, () =>
  withServer('off', (daemon) =>
    withThree('three', async (page) => {
      const refused = await page.evaluate(async () =>
        Lightwell.attach(await load(), 'ws://127.0.0.1:1/ws', { tsl: {} }).catch(String),
      );
      assert.match(refused, /tsl: it has no float/);
      const seen = [];
      for (const options of [{ directions: false }, {}]) {
        await attach(page, daemon, options);
        const { url, ...rest } = await page.evaluate(() => {
          camera.position.copy(scene.localToWorld(new THREE.Vector3(1.5, 1.7, 2.2)));
          camera.lookAt(scene.localToWorld(new THREE.Vector3(-0.2, 1, -1)));
          renderer.render(scene, camera);
          const directed = light.placed.filter(({ directions }) => directions).length;
          const { programs, memory } = renderer.info;
          const gl = renderer.getContext();
          const code = programs.map(({ fragmentShader }) => gl.getShaderSource(fragmentShader));
          const readers = code.filter((text) => /lightwellDirect/.test(text)).length;
          const { textures } = memory;
          return { url: renderer.domElement.toDataURL(), directed, readers, textures };
        });
        seen.push({ ...rest, picture: await pixelsOf(page, url) });
        await page.evaluate(end);
      }
      const [without, off] = seen;
      assert.deepEqual([off.directed, off.readers, off.textures], [0, 0, without.textures]);
      assert.ok(off.picture.equals(without.picture));
    }),
  ),
);

/** In the page: draws a material whose shader, as each renderer has it, names what is nowhere. */
const drawBroken = () => {
  const broken = renderer.isWebGPURenderer
    ? Object.assign(new THREE.MeshBasicMaterial(), {
        setupOutgoingLight: () => tsl.expression('noSuchName', 'vec3'),
      })
    : new THREE.ShaderMaterial({ fragmentShader: 'void main() { gl_FragColor = noSuchName; }' });
  const sheet = new THREE.Mesh(new THREE.PlaneGeometry(), broken);
  sheet.frustumCulled = false;
  renderer.render(sheet, camera);
};

test('three: a shader that does not compile ends the wait with its log', skip, async () => {
  for (const renderer of ['', 'nodes', 'webgpu']) {
    const look = async (page) => {
      await page.evaluate(drawBroken);
      await until(page, 'a picture that never comes', () => false);
    };
    await assert.rejects(withThree('three', look, renderer), /a shader is broken: .*noSuchName/s);
  }
});
