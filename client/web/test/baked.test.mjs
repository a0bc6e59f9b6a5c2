// A baked .glb in three.js, by the loaders of docs/baking_engines.md, against our path tracer's picture of the scene.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test, { after } from 'node:test';

import { bin, LIMIT_MS } from './daemon.mjs';
import { compare, hasBrowser, pixelsOf, until } from './page.mjs';
import { room } from './room.mjs';
import { serveFolder } from './serve_folder.mjs';
import { withPage } from './shared.mjs';

const WIDTH = 160;
const HEIGHT = 90;
const BOUNCES = '4';
const MEAN_MAX = 0.03; // of the picture's mean, each channel
const FLIP_MAX = 0.15; // 0.11 measured: the noise of ours is most of it
const missing = !['lightwell-bake', 'lightwell-view'].every((name) => existsSync(join(bin, name)))
  ? 'there is no lightwell-bake in build/release/bin'
  : !hasBrowser() && 'there is no chromium';

// The plugin is that of docs/baking_engines.md.
const page = `<!doctype html>
<style>body { margin: 0 }</style>
<script type="importmap">{ "imports": {
  "three": "/node_modules/three/build/three.module.js",
  "three/addons/": "/node_modules/three/examples/jsm/" } }</script>
<script type="module">
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { EXRLoader } from 'three/addons/loaders/EXRLoader.js';
class Lightmaps {
  constructor(parser) { this.parser = parser; this.name = 'lightwell'; }
  afterRoot(gltf) {
    const exr = new EXRLoader(this.parser.options.manager).setPath(this.parser.options.path), jobs = [];
    gltf.scene.traverse(o => {
      const info = o.material?.userData.lightwell;
      if (!info) return;
      jobs.push(exr.loadAsync(info.lightmap).then(map => {
        map.channel = 1;
        map.repeat.y = -1;
        map.offset.y = 1;
        const { color, side } = o.material;
        o.material = new THREE.MeshLambertMaterial({ color, side, lightMap: map, lightMapIntensity: 1 });
      }));
    });
    return Promise.all(jobs);
  }
}
const renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
renderer.setSize(${WIDTH}, ${HEIGHT});
renderer.toneMapping = THREE.LinearToneMapping;
renderer.toneMappingExposure = 2;
document.body.append(renderer.domElement);
const gltf = await new GLTFLoader().register(parser => new Lightmaps(parser)).loadAsync('/lit.glb');
const camera = new THREE.PerspectiveCamera(60, ${WIDTH} / ${HEIGHT}, 0.01, 1000);
camera.position.set(1.5, 1.7, 2.2);
camera.lookAt(-0.2, 1, -1);
renderer.render(gltf.scene, camera);
globalThis.shown = renderer.domElement.toDataURL();
</script>`;

/** Linear means of the channels. */
function means(bytes) {
  const sums = [0, 0, 0];
  for (let i = 0; i < bytes.length; i++) {
    const c = bytes[i] / 255;
    sums[i % 3] += c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  }
  return sums.map((sum) => (sum * 3) / bytes.length);
}

function run(program, ...args) {
  execFileSync(join(bin, program), args, { stdio: 'pipe', timeout: LIMIT_MS });
}

const folder = mkdtempSync(join(tmpdir(), 'lightwell-baked-'));
const at = (name) => join(folder, name);
after(() => rmSync(folder, { recursive: true }));

let traced = null; // one picture, for all

function pathTraced() {
  if (traced) return traced;
  writeFileSync(at('scene.gltf'), room({ turned: true }));
  const view = ['--camera', '1.5,1.7,2.2:-0.2,1,-1:60', '--exposure', '1', '--tonemap', 'none'];
  const light = ['--path-trace', at('scene.gltf'), '--spp', '64', '--bounces', BOUNCES];
  run('lightwell-view', ...light, ...view, '--size', `${WIDTH}x${HEIGHT}`, '--out', at('ours.png'));
  traced = readFileSync(at('ours.png'));
  return traced;
}

async function show(...options) {
  const ours = pathTraced();
  const density = ['--texels-per-metre', '12', '--samples', '32', '--bounces', BOUNCES, '--denoise'];
  const file = ['--convention', 'three', '--restart', '--gltf-out', at('lit.glb')];
  run('lightwell-bake', at('scene.gltf'), '-o', folder, ...density, ...file, ...options);
  const server = await serveFolder(folder, page);
  const look = async (tab) => {
    await tab.goto(`http://127.0.0.1:${server.address().port}/`);
    await until(tab, 'a picture', () => globalThis.shown);
    const picture = await tab.evaluate(() => globalThis.shown);
    const theirs = await pixelsOf(tab, picture);
    const wanted = await pixelsOf(tab, `data:image/png;base64,${ours.toString('base64')}`);
    if (process.env.LW_WEB_PICTURES) {
      const start = process.env.LW_WEB_PICTURES;
      const png = Buffer.from(picture.split(',')[1], 'base64');
      writeFileSync(`${start}-baked-three${options.join('')}.png`, png);
      writeFileSync(`${start}-baked-ours.png`, ours);
    }
    return { theirs, wanted };
  };
  try {
    return await withPage({ width: WIDTH, height: HEIGHT }, look, { mayWarn: true });
  } finally {
    server.close();
    server.closeAllConnections();
  }
}

for (const options of [[], ['--gltf-split-sides']])
  test(`baked: the .glb in three.js ${options.join(' ')}`, { skip: missing || false }, async () => {
    const { theirs, wanted } = await show(...options);
    const [got, want] = [means(theirs), means(wanted)];
    const { difference, flip } = compare(WIDTH, HEIGHT, wanted, theirs);
    const ratios = got.map((mean, c) => mean / want[c]);
    const text = ratios.map((ratio) => ratio.toFixed(4));
    console.log(`means ${text} of ours, difference ${difference}/255, FLIP ${flip}`);
    for (const ratio of ratios) assert.ok(Math.abs(ratio - 1) < MEAN_MAX, `means ${ratios} of ours`);
    assert.ok(flip < FLIP_MAX, `FLIP ${flip}`);
  });

test('baked: a file that points at the fronts is darker', { skip: missing || false }, async () => {
  const { theirs, wanted } = await show('--sides', 'front');
  const [got, want] = [means(theirs), means(wanted)];
  assert.ok(got[1] / want[1] < 1 - MEAN_MAX, `means ${got}, not ${want}`); // else nothing here could fail
});
