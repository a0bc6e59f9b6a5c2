// A package of version 5, as files have it, is read, and with any flipped bit it is not.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

import { load, root, wasm } from './load.mjs';

const { readPackage, Tiles } = await load('package', 'tiles');
const tiles = await Tiles.create(wasm());
const sealed = readFileSync(join(root, 'tests/fuzz/corpus/fuzz_package/sealed'));

test('a sealed package is read', () => {
  const bytes = new Uint8Array(sealed);
  assert.equal(bytes[8], 5);
  assert.equal(readPackage(bytes, tiles).meshes.length, 1);
  assert.deepEqual(Buffer.from(bytes), sealed); // and stays as it was
});

test('no flipped bit of it is read', () => {
  for (let at = 0; at < sealed.length; at++) {
    const bytes = new Uint8Array(sealed);
    bytes[at] ^= 1 << at % 8;
    assert.throws(() => readPackage(bytes, tiles), /scene package/, `byte ${at}`);
  }
});
