// Servers that lie: whatever they send, the session ends with one line that says why.
import assert from 'node:assert/strict';
import test from 'node:test';

import { load, quietHost, wasm } from './load.mjs';

const { AtlasMap, ClosedError, DrawsTooMuch, layOut, LimitError, nothingKept, ProtocolError, ...rest } =
  await load('atlas', 'failure', 'pages', 'replica', 'session', 'tiles', 'wire');
const { serverAddress } = await load('address');
const { readFrame, readTile, Replica, Session, Tiles } = rest;
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
    ...quietHost,
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

// ---- once the scene is there: FRAME and TILE ----

const NONE = 0xffffffff;
const atlases = [
  { atlasWidth: 100, atlasHeight: 30 },
  { atlasWidth: 0, atlasHeight: 0 },
];
const scene = {
  meshes: atlases,
  objectMesh: Uint32Array.of(0, 1, 0),
  objectNode: Uint32Array.of(0, 1, NONE),
  lights: [{}],
  materials: [{}, {}],
};

const float = (no, ...values) => {
  const bytes = Buffer.alloc(4 * values.length);
  values.forEach((value, i) => bytes.writeFloatLE(value, 4 * i));
  return values.length === 1 ? [...varint((no << 3) | 5), ...bytes] : blob(no, bytes);
};
const ids = (no, ...values) => blob(no, Buffer.from(Uint32Array.from(values).buffer));
const frame = (...fields) =>
  readFrame(new Uint8Array(message(7, uint(1, 1), float(6, 1, 1, 1), ...fields)).subarray(8));
const identity = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];

for (const [what, fields, expected] of [
  ['an object', [ids(7, 3), float(8, ...identity)], /transform_object 3 of 3/],
  ['a light', [ids(9, 1), float(10, 0, 0, 0), float(11, 0, 0, 1), float(12, 1, 1, 1)], /light 1 of 1/],
  ['a material', [ids(16, 2), float(17, 1, 1, 1), float(18, 0, 0, 0)], /material 2 of 2/],
  ['a hidden object', [ids(14, 9)], /hidden_object 9 of 3/],
  ['a shown object', [ids(15, NONE)], /shown_object 4294967295 of 3/],
])
  test(`FRAME tells of ${what} that the scene lacks`, () => {
    const replica = new Replica(scene, tiles, 0n);
    assert.throws(
      () => replica.takeFrame(frame(...fields)),
      (error) => {
        assert.ok(error instanceof ProtocolError, error.stack);
        assert.match(error.message, expected);
        return true;
      },
    );
  });

for (const [what, fields] of [
  ['too few numbers for an object', [ids(7, 0), float(8, ...identity.slice(1))]],
  ['objects without places', [ids(7, 0, 2)]],
  ['a light without a colour', [ids(9, 0), float(10, 0, 0, 0), float(11, 0, 0, 1)]],
  ['places that are no numbers', [ids(7, 0), float(8, ...identity.slice(1), NaN)]],
  ['light below nothing', [ids(16, 0), float(17, 1, 1, 1), float(18, 0, -1, 0)]],
  ['half a list', [blob(14, [1, 2, 3])]],
])
  test(`FRAME has ${what}`, () => assert.throws(() => frame(...fields), ProtocolError));

const tile = (object, level, number, ...more) =>
  readTile(
    new Uint8Array(
      message(
        8,
        ...[uint(1, object), uint(2, level), uint(3, number)],
        ...[uint(4, 1), uint(6, 4), float(7, 1)],
        ...(more.length ? more : [blob(10, [1, 2, 3])]),
      ),
    ).subarray(8),
  );

for (const [what, fields, expected] of [
  ['an unknown object', [3, 0, 0], /there is none/],
  ['an object without a lightmap', [1, 0, 0], /there is none/],
  ['a level that the atlas lacks', [0, 4, 0], /there is none/],
  ['a tile beyond its level', [0, 0, 2], /there is none/],
  ['a payload that is none', [0, 0, 0], /damaged/],
  ['a payload that ends at once', [0, 0, 0, blob(10, [0])], /damaged/],
  ['a difference to what was never sent', [0, 0, 0, uint(4, 2), blob(10, [1]), uint(11, 1)], /builds on/],
  ['a codec that there is not', [0, 0, 0, uint(6, 9), blob(10, [1])], /codec/],
  ['another layer', [0, 0, 0, uint(5, 1), blob(10, [1])], /layer 1/],
])
  test(`TILE is of ${what}`, () => {
    const replica = new Replica(scene, tiles, 0n);
    assert.throws(
      () => replica.takeTile(tile(...fields), 1),
      (error) => {
        assert.ok(error instanceof ProtocolError, error.stack);
        assert.match(error.message, expected);
        return true;
      },
    );
    assert.equal(replica.batchTiles(), 0);
    replica.destroy();
  });

test('half the texels of a tile, or twice as many', () => {
  const planes = (texels) => stored(new Uint8Array(6 * texels));
  const half = (object, level, number, payload) =>
    tile(object, level, number, uint(6, 1), blob(10, [...payload]));
  const replica = new Replica(scene, tiles, 0n);
  for (const texels of [64 * 15, 64 * 60])
    assert.throws(() => replica.takeTile(half(0, 0, 0, planes(texels)), 1), /damaged/);
  replica.takeTile(half(0, 0, 0, planes(64 * 30)), 1);
  assert.equal(replica.takeBatch().texels.length, 64 * 30);
});

// ---- a scene that is too large for the graphics ----

test('what a page has no room for is told', () => {
  const of = (width, height, objects, sideMax = 4096, layersMax = 256) => {
    const meshOf = new Uint32Array(objects);
    return layOut(
      new AtlasMap([{ atlasWidth: width, atlasHeight: height }], meshOf),
      objects,
      sideMax,
      layersMax,
    );
  };
  assert.equal(of(4096, 64, 1).width, 4096);
  assert.throws(
    () => of(4 * 4096 + 1, 64, 1),
    (error) => error instanceof LimitError && /16385 texels/.test(error.message),
  );
  // levels of 4096^2 to 1 texels in layers of 4096 x 4096: 64 MB each, 1 GiB at most
  assert.ok(of(4096, 4096, 11).layers <= 16);
  assert.throws(() => of(4096, 4096, 300), /more than a page has/);
  assert.throws(() => of(4096, 4096, 40, 4096, 2), /more than a page has/);
  assert.equal(of(0, 0, 1).layers, 1, 'a scene without lightmaps has one all the same');
});

test('no two levels share a texel, and none leaves its layer', () => {
  const sides = [
    [130, 70],
    [64, 64],
    [17, 200],
    [1, 1],
    [500, 3],
  ];
  const map = new AtlasMap(
    sides.map(([atlasWidth, atlasHeight]) => ({ atlasWidth, atlasHeight })),
    Uint32Array.of(0, 1, 2, 3, 4, 2),
  );
  const { width, height, layers, level } = layOut(map, 6, 512, 16);
  const taken = new Set();
  for (let i = 0; i < level.length; i += 4) {
    const [x, y, w, h] = [level[i] & 0xffff, level[i] >>> 16, level[i + 3] & 0xffff, level[i + 3] >>> 16];
    assert.ok(x + w <= width && y + h <= height && level[i + 1] < layers);
    for (let row = y; row < y + h; row++)
      for (let column = x; column < x + w; column++) {
        const place = (level[i + 1] * height + row) * width + column;
        assert.ok(!taken.has(place));
        taken.add(place);
      }
  }
});

// ---- addresses ----

test('which server a page asks', () => {
  const page = (address, given = null) => serverAddress(new URL(address), given);
  assert.deepEqual(page('http://host:7781/'), { url: 'ws://host:7781/ws' });
  assert.deepEqual(page('https://host/'), { url: 'wss://host/ws' });
  // a proxy serves it below a path
  assert.deepEqual(page('https://host/light/?camera-name=a/b#x'), { url: 'wss://host/light/ws' });
  assert.deepEqual(page('http://[::1]:7781/a/index.html'), { url: 'ws://[::1]:7781/a/ws' });
  assert.deepEqual(page('https://host/', 'wss://other/ws'), { url: 'wss://other/ws' });
  assert.deepEqual(page('http://host/', 'ws://other:1/ws'), { url: 'ws://other:1/ws' });
  // browsers let a page by https open these alone
  for (const local of ['ws://localhost:7781/ws', 'ws://127.0.0.1/ws', 'ws://[::1]:7781/ws'])
    assert.deepEqual(page('https://host/', local), { url: local });
  assert.match(page('https://host/', 'ws://other/ws').problem, /by https may not open.*wss:\/\//s);
  assert.match(page('https://host/', 'ws://localhost.other/ws').problem, /by https/);
  for (const none of ['', 'http://host/', 'host:7781', 'ws://', 'ws:///ws'])
    assert.match(page('http://host/', none).problem, /is not ws:\/\/HOST:PORT/);
});
