// Finishes of a scene: what the C library wrote is read, and what is damaged is read or refused as there.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

import { load, root, wasm } from './load.mjs';

const { NONE, ProtocolError, readFinishPackage, readPackage, Tiles } = await load(
  'failure',
  'finish_package',
  'package',
  'tiles',
);
const file = (name) => new Uint8Array(readFileSync(join(root, 'tests/fuzz/corpus', name)));
const scene = readPackage(file('fuzz_package/everything'), await Tiles.create(wasm()));
const whole = file('fuzz_finish_package/everything');

test('what tests/support/everything.c has', () => {
  const { materials, textures, tangents } = readFinishPackage(whole, scene);
  assert.equal(materials.length, 3);
  assert.equal(materials[0], null);
  const [, first, second] = materials;
  const { metalness, roughness, specular, specularColour, occlusion, normalScale } = first;
  assert.deepEqual([metalness, roughness, specular, occlusion, normalScale], [0.25, 0.5, 0.75, 0.875, -1.5]);
  assert.deepEqual([...specularColour], [1, 0.5, 2]);
  assert.ok(Math.abs(first.ior - 1.33) < 1e-6);
  assert.equal(first.surface.texture, 1);
  assert.equal(first.surface.uvSet, 1);
  assert.deepEqual([...first.surface.transform], [2, 0, 0.5, 0, -1, 1]);
  assert.equal(first.specularTexture.texture, NONE);
  assert.equal(first.occlusionTexture.texture, 1);
  assert.equal(first.normal.texture, 0);
  assert.equal(second.metalness, 1);
  assert.equal(second.specularTexture.texture, 2);
  assert.equal(second.normal.texture, NONE);
  assert.deepEqual(
    textures.map(({ width, height, content, wrapS, wrapT }) => [width, height, content, wrapS, wrapT]),
    [
      [2, 2, 1, 0, 1],
      [3, 1, 2, 2, 0],
      [1, 2, 0, 1, 2],
    ],
  );
  assert.deepEqual([...textures[0].texels], [128, 128, 200, 100, 0, 128, 128, 255]);
  assert.deepEqual([...textures[1].texels], [255, 10, 0, 255, 200, 100, 128, 255, 0, 255, 255, 255]);
  assert.deepEqual([...textures[2].texels], [1, 2, 3, 4, 250, 251, 252, 253]);
  assert.deepEqual(tangents[0], Uint16Array.of(0, 0x8000, 0x7fff, 1, 0xffff, 12345));
  assert.equal(tangents[1], null);
});

function refuses(bytes) {
  try {
    readFinishPackage(bytes, scene);
    return false;
  } catch (error) {
    assert.ok(error instanceof ProtocolError, error.stack);
    assert.match(error.message, /^finish package: /);
    return true;
  }
}

test('as many flipped bits are refused as tests/unit/test_finish_package.c refuses', () => {
  const expected = readFileSync(join(root, 'tests/unit/test_finish_package.c'), 'utf8').match(
    /#define FLIPPED_BITS_REFUSED (\d+)/,
  )[1];
  let refused = 0;
  for (let bit = 0; bit < 8 * whole.length; bit++) {
    const bytes = whole.slice();
    bytes[bit >> 3] ^= 1 << bit % 8;
    if (refuses(bytes)) refused++;
  }
  assert.equal(refused, Number(expected));
});

test('what is cut off, too long or of another scene is refused', () => {
  for (let size = 0; size < whole.length; size++) assert.ok(refuses(whole.slice(0, size)), `${size}`);
  assert.ok(refuses(Uint8Array.from([...whole, 0])));
  assert.ok(refuses(file('fuzz_finish_package/another-scene')));
});

test('any word may be anything', () => {
  const extremes = [0, 1, 3, 4, 0x7f, 0x7fffffff, 0x80000000, 0xfffffffe, NONE, 0x7f800000, 0x7fc00000];
  for (let at = 0; at + 4 <= whole.length; at += 4)
    for (const value of extremes) {
      const bytes = whole.slice();
      new DataView(bytes.buffer).setUint32(at, value, true);
      refuses(bytes);
    }
});
