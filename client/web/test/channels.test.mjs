// A channel that only a test knows (tests/integration/test_channels.c), signed and of two planes, is decoded by
// the page's replica as by the C library, bit for bit.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

import { load, root, wasm } from './load.mjs';

const { channelsFor, readHeader, readTile, Replica, Tiles } = await load('replica', 'tiles', 'wire');
const tiles = await Tiles.create(wasm());
const SIDE = 20;
const ASKS = 1n << 20n;
const made = { planes: 2, isSigned: true, isPlain: true, asked: ASKS, asks: ASKS, slot: 2 };
const channels = [...tiles.channels, made];
const scene = {
  meshes: [{ atlasWidth: SIDE, atlasHeight: SIDE }],
  objectMesh: Uint32Array.of(0),
  objectNode: Uint32Array.of(0),
  lights: [],
  materials: [],
};

function messages() {
  const bytes = new Uint8Array(readFileSync(join(root, 'tests/golden/channels/drift.bin')));
  const found = [];
  for (let at = 0; at < bytes.length; ) {
    const { size } = readHeader(bytes, at);
    found.push(readTile(bytes.subarray(at + 8, at + 8 + size)));
    at += 8 + size;
  }
  return found;
}

test('the table is that of the C library', () => {
  assert.deepEqual(
    tiles.channels.map(({ planes, isSigned, isPlain, slot }) => [planes, isSigned, isPlain, slot]),
    [
      [3, false, false, 0],
      [3, false, false, 0],
      [3, true, true, 1],
      [3, true, true, 1],
    ],
  );
  assert.deepEqual([...channelsFor(tiles.channels, 0n)], [[0, 0]]);
  assert.deepEqual([...channelsFor(tiles.channels, 64n)], [[0, 1]]);
  assert.deepEqual([...channelsFor(tiles.channels, 64n | 2048n)], [[0, 1], [1, 3]]); // prettier-ignore
  assert.deepEqual([...channelsFor(tiles.channels, 2048n)], [[0, 0], [1, 2]]); // prettier-ignore
  assert.deepEqual(
    [...channelsFor(channels, ASKS | 64n)],
    [
      [0, 1],
      [2, 4],
    ],
  );
});

test('a made-up channel is decoded: whole, as a delta, in halves', () => {
  const expected = new Float32Array(
    new Uint8Array(readFileSync(join(root, 'tests/golden/channels/drift.values'))).buffer,
  );
  const replica = new Replica(scene, tiles, ASKS, channels);
  const count = 2 * SIDE * SIDE;
  messages().forEach((tile, i) => {
    replica.takeTile(tile, 1);
    const { others, id } = replica.takeBatch();
    assert.equal(id.length, 0);
    assert.equal(others.length, 1);
    assert.deepEqual([others[0].id, others[0].slot], [0, 2]);
    assert.deepEqual(others[0].values, expected.subarray(i * count, (i + 1) * count));
  });
  assert.ok(expected.some((value) => value < -1));
  assert.equal(replica.hasFirst(), false); // no light has come
  replica.takeTile(messages()[0], 1); // older than what is there
  assert.equal(replica.batchTiles(), 0);
  replica.destroy();
});

test('who does not ask for it does not take it', () => {
  for (const [replica, same] of [
    [new Replica(scene, tiles, 0n, channels), false],
    [new Replica(scene, tiles, 0n), true],
  ]) {
    replica.takeTile(messages()[0], 1);
    assert.equal(replica.batchTiles(), 0);
    assert.equal(replica.isFor(0n), true);
    assert.equal(replica.isFor(ASKS), same);
    replica.destroy();
  }
});
