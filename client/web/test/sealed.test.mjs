// Packages of versions 5 and 6, as files have them, are read, and with any flipped bit they are not.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

import { load, root, wasm } from './load.mjs';

const { readPackage, Tiles } = await load('package', 'tiles');
const tiles = await Tiles.create(wasm());
const file = (name) => readFileSync(join(root, 'tests/fuzz/corpus/fuzz_package', name));
const sealed = file('sealed');

test('a sealed package is read', () => {
  const bytes = new Uint8Array(sealed);
  assert.equal(bytes[8], 5);
  assert.equal(readPackage(bytes, tiles).meshes.length, 1);
  assert.deepEqual(Buffer.from(bytes), sealed); // and stays as it was
});

test('no flipped bit of any is read', () => {
  for (const whole of [sealed, file('looks')])
    for (let at = 0; at < whole.length; at++) {
      const bytes = new Uint8Array(whole);
      bytes[at] ^= 1 << at % 8;
      assert.throws(() => readPackage(bytes, tiles), /scene package/, `byte ${at}`);
    }
});

test('version 6 says what is unlit, tinted and orthographic', () => {
  const looks = readPackage(new Uint8Array(file('looks')), tiles);
  assert.equal(looks.materials[0].unlit, true);
  assert.deepEqual(looks.materials[0].tint, [0, 0, 0]);
  assert.equal(looks.cameras[0].height, 2);
  const glass = readPackage(new Uint8Array(file('glass')), tiles);
  const { unlit, tint } = glass.materials[0];
  assert.equal(unlit, false);
  // the base colour (0.5, 0.25, 0.125) over its luminance
  const luminance = 0.2126 * 0.5 + 0.7152 * 0.25 + 0.0722 * 0.125;
  [0.5, 0.25, 0.125].forEach((c, i) => assert.ok(Math.abs(tint[i] - c / luminance) < 1e-5, `${tint}`));
  assert.equal(glass.cameras[0].height, 0);
  assert.equal(glass.environment.width, 8);
});
