// Messages: the golden ones of version 1 are read and written as the C library does, and the invalid ones
// refused.
import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

import { load, root } from './load.mjs';

const wire = await load('wire');
const { Type } = wire;
const folder = join(root, 'tests/golden/v1');

const readers = {
  [Type.WELCOME]: wire.readWelcome,
  [Type.REFUSAL]: wire.readRefusal,
  [Type.PACKAGE_CHUNK]: wire.readChunk,
  [Type.FINISH_CHUNK]: wire.readChunk,
  [Type.FRAME]: wire.readFrame,
  [Type.TILE]: wire.readTile,
  [Type.PING]: wire.readToken,
  [Type.PONG]: wire.readToken,
  [Type.SETTLED]: wire.readSettled,
  [Type.WAITING]: wire.readWaiting,
};

function read(name) {
  const bytes = new Uint8Array(readFileSync(join(folder, name)));
  const { type, size } = wire.readHeader(bytes, 0);
  return readers[type]?.(bytes.subarray(wire.HEADER_BYTES, wire.HEADER_BYTES + size));
}

let count = 0;
for (const name of readdirSync(folder)) {
  const type = readFileSync(join(folder, name)).readUInt16LE(4);
  // what servers do not send, or not to this client, is not read
  if (!readers[type] && !name.startsWith('invalid_header')) continue;
  test(name, () => {
    if (name.startsWith('invalid_'))
      assert.throws(
        () => read(name),
        (error) => /message/.test(error.message),
      );
    else read(name);
  });
  count++;
}

test('there are golden messages', () => assert.ok(count > 20));

test('what they say', () => {
  assert.equal(read('frame_run.bin').run, 0x0123456789abcdefn);
  assert.equal(read('frame_cpu.bin').run, 0n);
  const tile = read('tile.bin');
  assert.deepEqual(
    [
      tile.object,
      tile.level,
      tile.tile,
      tile.version,
      tile.codec,
      tile.scale,
      tile.bounces,
      tile.error,
      tile.payload.length,
    ],
    [2, 3, 0, 300n, 1, 4, 2, 0.125, 15],
  );
  assert.equal(read('tile_delta.bin').base, 300n);
  assert.equal(read('tile_split.bin').layer, 1);
  const welcome = read('welcome_parts.bin');
  assert.equal(
    welcome.package.parts.reduce((sum, part) => sum + part.size, 0),
    welcome.package.size,
  );
  assert.equal(read('welcome.bin').package.parts.length, 1);
  assert.deepEqual([read('welcome.bin').finer, read('welcome_finer.bin').finer], [0, 2]);
  const gone = read('tile_gone.bin');
  assert.deepEqual([gone.level, gone.codec], [66, 0]);
  const frame = read('frame.bin');
  assert.deepEqual(Array.from(frame.transform), [1, 0, 0, 0.5, 0, 0, -1, 2, 0, 1, 0, -3]);
  assert.deepEqual(Array.from(read('frame_spares.bin').hidden.slice(0, 2)), [8, 9]);
  assert.equal(read('refusal.bin').code > 0, true);
  assert.equal(read('refusal.bin').retryAfterMs, 0);
  assert.deepEqual(read('waiting.bin'), { stage: 2, share: 0.25 });
  assert.deepEqual(read('waiting_none_done.bin'), { stage: 1, share: 0 });
  assert.deepEqual(read('waiting_unknown_stage.bin'), { stage: 65535, share: 0.5 });
  assert.equal(read('refusal_retry_after.bin').retryAfterMs, 2000);
});

function list(...tiles) {
  const column = (i) => Uint32Array.from(tiles, (tile) => tile[i]);
  return { object: column(0), level: column(1), tile: column(2) };
}

const none = new Uint8Array(0);
for (const [name, bytes] of [
  ['hello.bin', wire.writeHello(0n, 'stranger')],
  ['ack.bin', wire.writeAck(300n)],
  ['interest_everything.bin', wire.writeInterest(true, list(), false)],
  ['interest_tiles.bin', wire.writeInterest(false, list([0, 4, 0], [17, 0, 35]), false)],
  ['interest_stand_ins.bin', wire.writeInterest(false, list([17, 0, 2]), true)],
  ['holds.bin', wire.writeHolds(list([17, 0, 2]), BigUint64Array.of(300n))],
  [
    'holds_two.bin',
    wire.writeHolds(list([0, 4, 0], [17, 0, 35]), BigUint64Array.of(1n, 0x0123456789abcdefn)),
  ],
  ['holds_frame.bin', wire.writeHoldsFrame(300n)],
  ['package_request_empty.bin', wire.writePackageRequest(0, none)],
])
  test(`written as ${name}`, () => assert.deepEqual(Buffer.from(bytes), readFileSync(join(folder, name))));
