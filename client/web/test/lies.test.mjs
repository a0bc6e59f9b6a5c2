// Servers that lie: whatever they send, the session ends with one line that says why.
import assert from 'node:assert/strict';
import test from 'node:test';

import { load, wasm } from './load.mjs';

const { Session, nothingKept, Tiles, ProtocolError, LimitError, ClosedError, DrawsTooMuch } = await load(
  'session',
  'tiles',
  'failure',
);
const tiles = await Tiles.create(wasm());

function varint(value) {
  const bytes = [];
  for (let v = BigInt(value); ; v >>= 7n) {
    if (v < 128n) return [...bytes, Number(v)];
    bytes.push(Number(v & 127n) | 128);
  }
}
const uint = (no, value) => [...varint(no << 3), ...varint(value)];
const blob = (no, bytes) => [...varint((no << 3) | 2), ...varint(bytes.length), ...bytes];
function message(type, ...fields) {
  const body = Uint8Array.from(fields.flat());
  const head = Buffer.alloc(8);
  head.writeUInt32LE(body.length, 0);
  head.writeUInt16LE(type, 4);
  return Buffer.concat([head, body]);
}

const welcome = (bytes, hash, compressed) =>
  message(2, uint(1, 1), uint(2, 52), blob(5, hash), uint(6, bytes), uint(7, compressed), uint(10, 7));

/** An empty frame of zstd with one raw block. */
function stored(bytes) {
  const head = [0x28, 0xb5, 0x2f, 0xfd, 0x60, (bytes.length - 256) & 255, (bytes.length - 256) >> 8];
  const block = (bytes.length << 3) | 1;
  return Uint8Array.from([...head, block & 255, (block >> 8) & 255, block >> 16, ...bytes]);
}

async function hearWith(features, ...parts) {
  const host = {
    send() {},
    find: () => Promise.resolve(null),
    keep() {},
    progress() {},
    scene() {},
    frame() {},
    tiles() {},
    settled() {},
  };
  const session = new Session(nothingKept(), tiles, host, features, 0);
  for (const part of parts) session.push(new Uint8Array(part), 0);
  await session.pump(() => 0, 1);
}

const hear = (...parts) => hearWith(0n, ...parts);

const hash = Buffer.alloc(16, 1);
const garbage = new Uint8Array(600).fill(7);
const refused = [
  ['no lightwelld', [Buffer.from('HTTP/1.1 400 Bad Request\r\n\r\n')], /bytes, over|with flags/],
  ['a message that is too long', [Buffer.from([0, 0, 0x20, 0, 2, 0, 0, 0])], /over 1048576/],
  ['something before WELCOME', [message(8, uint(4, 1))], /does not begin with WELCOME/],
  ['another version', [message(2, uint(1, 2), blob(5, hash), uint(6, 1), uint(7, 1))], /version 2/],
  ['WELCOME twice', [welcome(600, hash, 610), welcome(600, hash, 610)], /WELCOME: out of order/],
  [
    'features that were not offered',
    [message(2, uint(1, 1), uint(2, 2), blob(5, hash), uint(6, 1), uint(7, 1))],
    /not offered/,
  ],
  ['no hash', [message(2, uint(1, 1), uint(6, 1), uint(7, 1))], /package_hash/],
  ['a package for no page', [welcome(2 ** 31, hash, 100)], /2048 MB, more than a page takes/],
  [
    'a chunk from elsewhere',
    [welcome(600, hash, 610), message(5, uint(1, 5), blob(2, [1]))],
    /chunk at 5 where 0/,
  ],
  ['more than was promised', [welcome(600, hash, 10), message(5, blob(2, garbage))], /over the end/],
  ['no zstd', [welcome(600, hash, 600), message(5, blob(2, garbage))], /600 bytes of zstd/],
  [
    'another package',
    [welcome(600, hash, 610), message(5, blob(2, stored(garbage)))],
    /not the one that was promised/,
  ],
  [
    'a package that is none',
    [welcome(600, tiles.hash(garbage), 610), message(5, blob(2, stored(garbage)))],
    /scene package: it is none/,
  ],
  [
    'a tile before the scene',
    [welcome(600, hash, 610), message(8, uint(4, 1), uint(6, 4), [0x3d, 0, 0, 0x80, 0x3f], blob(10, [1]))],
    /TILE: out of order/,
  ],
  ['a frame before the scene', [welcome(600, hash, 610), message(7, uint(1, 1))], /FRAME: out of order/],
  ['a message of clients', [welcome(600, hash, 610), message(6)], /servers do not send/],
];

for (const [name, parts, expected] of refused)
  test(name, async () => {
    await assert.rejects(hear(...parts), (error) => {
      assert.ok(error instanceof ProtocolError || error instanceof LimitError, error.stack);
      assert.match(error.message, expected);
      return true;
    });
  });

/** A frame of zstd of many megabytes: blocks of 128 KiB that say one byte each. */
function bombOf(blocks) {
  const block = (last) => [(last ? 1 : 0) | 2 | 0, 0, 0x10, 0];
  const all = Array.from({ length: blocks }, (_, i) => block(i === blocks - 1));
  return Uint8Array.from([0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x58, ...all.flat()]);
}

test('a bomb: what it holds beyond what was promised is not made', async () => {
  const bomb = bombOf(2048);
  assert.equal(tiles.decompress(bombOf(8), 8 << 17)?.length, 8 << 17, 'it is what it should be');
  await assert.rejects(hear(welcome(600, hash, bomb.length), message(5, blob(2, bomb))), /600 bytes of zstd/);
});

test('a server that ends is asked again, one that refuses our version is not', async () => {
  await assert.rejects(
    hear(message(3, uint(1, 4), blob(2, Buffer.from('bye')))),
    (error) => error instanceof ClosedError && /bye/.test(error.message),
  );
  await assert.rejects(hear(message(3, uint(1, 1))), ProtocolError);
});

test('unknown messages are skipped', async () => {
  await hear(welcome(600, hash, 610), message(77, [1, 2, 3]), message(11, uint(1, 5)));
});

test('lights that it cannot draw', async () => {
  const drawn = (...lights) =>
    message(2, uint(1, 1), uint(2, 52 + 64), blob(5, hash), uint(6, 600), uint(7, 610), ...lights);
  await hearWith(64n, drawn(blob(15, [1]), blob(16, [0])));
  await assert.rejects(hearWith(64n, drawn(blob(16, [0, 2]))), DrawsTooMuch);
  await assert.rejects(hear(drawn()), /not offered/);
});
