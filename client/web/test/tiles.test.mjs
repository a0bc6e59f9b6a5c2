// The tile decoder as WebAssembly gives the native decoder's values, byte for byte, and refuses what that
// refuses.
import assert from 'node:assert/strict';
import { existsSync, readdirSync, readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

import { load, root, wasm } from './load.mjs';

const { Tiles } = await load('tiles');
const tiles = await Tiles.create(wasm());
const golden = join(root, 'tests/golden/tiles');

function read(name) {
  const bytes = readFileSync(join(golden, name));
  return {
    width: bytes.readUInt32LE(0),
    height: bytes.readUInt32LE(4),
    scale: bytes.readFloatLE(8),
    payload: bytes.subarray(12),
  };
}

function decode(name, delta, coefficients) {
  const { width, height, scale, payload } = read(name);
  if (!tiles.decode(delta, payload, scale, width, height, coefficients)) return null;
  return Buffer.from(tiles.values(3 * width * height).slice().buffer);
}

const names = readdirSync(golden).filter((name) => name.endsWith('.tile'));

for (const name of names) {
  const stem = join(golden, name.slice(0, -5));
  test(`tile ${name}`, () => {
    const coefficients = tiles.createCoefficients(64, 64);
    tiles.choose(tiles.channels[name.startsWith('direction_') ? 2 : 0]);
    const texels = decode(name, false, coefficients);
    if (!existsSync(`${stem}.rgb`)) return assert.equal(texels, null);
    assert.deepEqual(texels, readFileSync(`${stem}.rgb`));
    if (existsSync(`${stem}.next`)) {
      assert.deepEqual(
        decode(name.replace('.tile', '.next'), true, coefficients),
        readFileSync(`${stem}.next.rgb`),
      );
    }
    tiles.freeCoefficients(coefficients);
  });
}

test('there are golden tiles of each kind', () => {
  tiles.choose(tiles.channels[0]);
  const directions = names.filter((name) => name.startsWith('direction_')).length;
  assert.ok(directions > 4 && names.length > directions + 10);
});

/** What a GPU makes of RGB9E5. */
function unpack(texel) {
  const unit = 2 ** ((texel >>> 27) - 15 - 9);
  return [0, 9, 18].map((shift) => ((texel >>> shift) & 511) * unit);
}

test('RGB9E5 is within half a step of the brightest channel', () => {
  const values = [0, 1e-9, 1e-4, 0.3, 1, 31.97, 32, 100, 1e4, 2e6, 5e6, 1e30];
  const rgb = Float32Array.from(values.flatMap((v) => [v, v / 3, v / 1000]));
  const packed = tiles.packAll(rgb);
  values.forEach((value, i) => {
    const largest = Math.min(value, tiles.unit * 65408);
    const step = Math.max(largest / 256, tiles.unit * 2 ** -24);
    unpack(packed[i]).forEach((channel, c) => {
      const want = Math.min(rgb[3 * i + c], tiles.unit * 65408);
      assert.ok(
        Math.abs(channel * tiles.unit - want) <= step / 2 + 1e-12,
        `${value}, channel ${c}: ${channel * tiles.unit}`,
      );
    });
  });
});

test('XXH3-128 as packages are named', () => {
  // of no bytes, from the specification of XXH3
  assert.equal(
    Buffer.from(tiles.hash(new Uint8Array(0))).toString('hex'),
    '99aa06d3014798d86001c324468d497f',
  );
});

test('memory that was freed is taken again, in pieces of any size', () => {
  const height = (i) => 8 + 8 * (i % 8);
  const take = (count) => Array.from({ length: count }, (_, i) => tiles.createCoefficients(64, height(i)));
  const side = 1024;
  const image = () => tiles.unfilter(new Uint8Array(4 * side * side), side, side);
  image();
  const kept = take(400);
  assert.equal(new Set(kept).size, 400);
  assert.ok(kept.every((at) => at % 64 === 0));
  const before = tiles.memoryBytes();
  // neighbours become one: every other one first
  for (const odd of [1, 0]) kept.forEach((at, i) => i % 2 === odd && tiles.freeCoefficients(at));
  image();
  for (let round = 0; round < 20; round++) take(400).reverse().forEach((at) => tiles.freeCoefficients(at));
  assert.equal(tiles.memoryBytes(), before);
});
