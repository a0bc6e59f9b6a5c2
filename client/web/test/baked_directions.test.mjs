// Baked directions in three.js, by the code of docs/baking_engines.md: a normal-mapped wall under a lamp.
// Each form against its closed form.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { existsSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test, { after } from 'node:test';

import { albedo, bentWall, lightAt } from './bent_wall.mjs';
import { bin, LIMIT_MS } from './daemon.mjs';
import { hasBrowser, until } from './page.mjs';
import { serveFolder } from './serve_folder.mjs';
import { withPage } from './shared.mjs';

const SIDE = 48; // pixels of a view of the wall's middle
const REACH = 0.9; // m from the middle to the view's edge
const TOLERANCE = 0.01; // share of E(n): 16-bit texels of 25 mm, read between
const missing = !existsSync(join(bin, 'lightwell-bake'))
  ? 'there is no lightwell-bake in build/release/bin'
  : !hasBrowser() && 'there is no chromium';

const page = `<!doctype html>
<script type="importmap">{ "imports": {
  "three": "/node_modules/three/build/three.module.js",
  "three/addons/": "/node_modules/three/examples/jsm/" } }</script>
<script type="module">
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { EXRLoader } from 'three/addons/loaders/EXRLoader.js';
// E of bent normal m by those of lightMap, E, at plain normal n and coordinates at; world space
const forms = {
  own: \`vec3 bentIrradiance(vec3 E, vec2 at, vec3 n, vec3 m) {
    vec3 u = texture2D(directions, at).rgb - 2.0 / 3.0 * n;
    float up = 1.2 * dot(u, n), w = min(up + sqrt(up * up + 1.8 * dot(u, u)), 1.0), s = 0.5 * (1.0 - w);
    vec3 d = w > 0.02 ? normalize(u / w + 2.0 / 3.0 * n) : n;
    vec2 along = vec2(dot(d, n), dot(d, m)), lobe = (1.0 - s) * max(along, 0.0) + s * 0.5 * (1.0 + along);
    float factor = 1.0 + s * dot(n, m - n) + w * (lobe.y - lobe.x) / max(lobe.x, 0.05);
    return E * clamp(factor, 0.0, 4.0);
  }\`,
  dominant: \`vec3 bentIrradiance(vec3 E, vec2 at, vec3 n, vec3 m) {
    vec4 texel = texture2D(directions, at);
    return E * (dot(m, texel.rgb - 0.5) + 0.5) / max(texel.a, 1e-4);
  }\`,
  sh: \`vec3 layer(vec2 at, float l) { return texture2D(directions, vec2(at.x, (at.y + 3.0 - l) / 4.0)).rgb; }
  vec3 bentIrradiance(vec3 E, vec2 at, vec3 n, vec3 m) {
    vec3 sum = m.y * (layer(at, 1.0) - 0.5) + m.z * (layer(at, 2.0) - 0.5) + m.x * (layer(at, 3.0) - 0.5);
    return 3.14159265 * layer(at, 0.0) * (1.0 + 8.0 * sum);
  }\`,
};
function useDirections(material, map, form) {
  material.onBeforeCompile = shader => {
    shader.uniforms.directions = { value: map };
    shader.fragmentShader = shader.fragmentShader
      .replace('void main() {', 'uniform sampler2D directions;\\n' + forms[form] + '\\nvoid main() {')
      .replace('#include <lights_fragment_maps>', \`#include <lights_fragment_maps>
        irradiance += bentIrradiance(lightMapIrradiance, vLightMapUv,
          inverseTransformDirection(nonPerturbedNormal, viewMatrix),
          inverseTransformDirection(normal, viewMatrix)) - lightMapIrradiance;\`);
  };
  material.customProgramCacheKey = () => form;
}
const load = file => new EXRLoader().loadAsync(file).then(map => {
  map.channel = 1;
  map.repeat.y = -1;
  map.offset.y = 1;
  return map;
});
const gltf = await new GLTFLoader().loadAsync('/lit.glb');
const wall = gltf.scene.getObjectByProperty('isMesh', true), old = wall.material, info = old.userData.lightwell;
wall.material = new THREE.MeshLambertMaterial({
  color: old.color, normalMap: old.normalMap, normalScale: old.normalScale, lightMap: await load(info.lightmap) });
useDirections(wall.material, await load(info.directions), info.directionForm);
const eye = new THREE.OrthographicCamera(-${REACH}, ${REACH}, ${REACH}, -${REACH}, 0.1, 10);
eye.position.z = 3;
wall.add(eye);
const target = new THREE.WebGLRenderTarget(${SIDE}, ${SIDE}, { type: THREE.FloatType });
const renderer = new THREE.WebGLRenderer();
renderer.setRenderTarget(target);
renderer.render(gltf.scene, eye);
const rgba = new Float32Array(${SIDE * SIDE * 4});
renderer.readRenderTargetPixels(target, 0, 0, ${SIDE}, ${SIDE}, rgba);
globalThis.green = Array.from({ length: ${SIDE * SIDE} }, (_, i) => rgba[4 * i + 1]);
</script>`;

const folder = mkdtempSync(join(tmpdir(), 'lightwell-directions-'));
after(() => rmSync(folder, { recursive: true }));

/** The green of each pixel, row by row from the bottom. */
async function show(form) {
  writeFileSync(join(folder, 'wall.gltf'), bentWall());
  const light = ['--texels-per-metre', '40', '--samples', '16', '--bounces', '0', '--restart'];
  const files = ['-o', folder, '--convention', 'three', '--gltf-out', join(folder, 'lit.glb')];
  const scene = [join(folder, 'wall.gltf'), '--direction-form', form];
  execFileSync(join(bin, 'lightwell-bake'), [...scene, ...light, ...files], { stdio: 'pipe', timeout: LIMIT_MS });
  const server = await serveFolder(folder, page);
  const look = async (tab) => {
    await tab.goto(`http://127.0.0.1:${server.address().port}/`);
    await until(tab, 'a picture', () => globalThis.green);
    return tab.evaluate(() => globalThis.green);
  };
  try {
    return await withPage({ width: SIDE, height: SIDE }, look, { mayWarn: true });
  } finally {
    server.close();
    server.closeAllConnections();
  }
}

/** E(m) / E(n) of a lamp alone. */
const wanted = {
  own: ({ plain, bent }) => Math.min(Math.max(bent, 0) / plain, 4), // the lamp's own
  dominant: ({ plain, bent }) => (1 + bent) / (1 + plain),
  sh: ({ plain, bent }) => (1 + 4 * bent) / (1 + 4 * plain),
};

for (const form of Object.keys(wanted))
  test(`baked directions in three.js: ${form}`, { skip: missing || false }, async () => {
    const green = await show(form);
    let worst = 0;
    let lamps = 0;
    for (let i = 0; i < SIDE * SIDE; i++) {
      const at = (k) => (((k + 0.5) / SIDE) * 2 - 1) * REACH;
      const light = lightAt(at(i % SIDE), at(Math.floor(i / SIDE)));
      const factor = green[i] / ((albedo / Math.PI) * light.e);
      worst = Math.max(worst, Math.abs(factor - wanted[form](light)));
      lamps += (factor - wanted.own(light)) ** 2 / SIDE ** 2;
    }
    console.log(`${form}: E(m) / E(n) differs by ${worst}, RMS from the lamp's own by ${Math.sqrt(lamps)}`);
    assert.ok(worst < TOLERANCE, `${worst}`);
  });
