// Finer levels: how their tiles are numbered, kept and given slots, and what servers may say of them.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

import { load, root, wasm } from './load.mjs';

const { AtlasMap, FinerTiles, FINER, FINER_KEPT, GONE, layOut, LimitError, SLOT_BITS, SLOT_SIDE, ...rest } =
  await load('atlas', 'failure', 'finer', 'pages', 'replica', 'tiles', 'wire');
const { ProtocolError, readTile, Replica, SHARE_WHOLE, TILES_MAX, Tiles } = rest;
const tiles = await Tiles.create(wasm());

const sides = [
  [132, 68],
  [0, 0],
  [20, 100],
].map(([atlasWidth, atlasHeight]) => ({ atlasWidth, atlasHeight }));
const meshOf = Uint32Array.of(0, 1, 2, 0);

// ---- numbers ----

test('tiles of finer levels have the numbers that C gives them', () => {
  const map = new AtlasMap(sides, meshOf, 2);
  // as tests/unit/test_atlas.c has them
  assert.deepEqual([map.finer, map.plainCount, map.tileCount], [2, 27, 165]);
  assert.deepEqual([...map.firstFiner], [27, 87, 87, 105, 165]);
  for (const [object, level, tile, id] of [
    [0, FINER + 1, 0, 27],
    [0, FINER + 1, 14, 41],
    [0, FINER + 2, 0, 42],
    [0, FINER + 2, 44, 86],
    [2, FINER + 1, 3, 90],
    [2, FINER + 2, 13, 104],
    [3, FINER + 2, 7, 127],
  ]) {
    assert.equal(map.find(object, level, tile), id);
    const place = map.place(id);
    assert.deepEqual([place.object, place.level, place.tile], [object, level, tile]);
  }
});

test('every finer tile is found under its number, and none beside them', () => {
  const map = new AtlasMap(sides, meshOf, 3);
  let texels = 0;
  for (let id = map.plainCount; id < map.tileCount; id++) {
    const { object, level, tile, x, y, width, height } = map.place(id);
    assert.equal(map.find(object, level, tile), id);
    if (level === FINER + 1 && object === 0) texels += width * height;
    const right = map.beside(id, 1, 0);
    if (right >= 0) assert.deepEqual([map.place(right).x, map.place(right).y], [x + 64, y]);
    const above = map.beside(id, 0, -1);
    if (above >= 0) assert.deepEqual([map.place(above).x, map.place(above).y], [x, y - 64]);
  }
  assert.equal(texels, 264 * 136);
  for (const [object, level, tile] of [
    [0, FINER, 0],
    [0, FINER + 4, 0],
    [0, FINER + 1, 15],
    [1, FINER + 1, 0],
    [4, FINER + 1, 0],
    [0, 0xffffffff, 0],
  ])
    assert.equal(map.find(object, level, tile), -1);
  const plain = new AtlasMap(sides, meshOf);
  assert.deepEqual([plain.tileCount, plain.find(0, FINER + 1, 0)], [map.plainCount, -1]);
});

test('a scene with many tiles has fewer finer levels', () => {
  const large = [{ atlasWidth: 4096, atlasHeight: 4096 }];
  // 5461 plain tiles, 16384, 65536 and 262144, then 1048576 more
  const map = new AtlasMap(large, Uint32Array.of(0), 4);
  assert.equal(map.finer, 3);
  assert.ok(map.tileCount <= TILES_MAX);
});

// ---- what servers say ----

const scene = {
  meshes: sides,
  objectMesh: meshOf,
  objectNode: Uint32Array.of(0, 1, 2, 3),
  lights: [],
  materials: [],
};
const replicaOf = (finer = 2) => new Replica(scene, tiles, 0n, undefined, finer);
/** A payload of codec 4 for 64 x 64 texels. */
const golden = (() => {
  const bytes = readFileSync(join(root, 'tests/golden/tiles/whole.tile'));
  return { scale: bytes.readFloatLE(8), payload: bytes.subarray(12) };
})();
const tileOf = (object, level, tile, version, more = {}) => ({
  ...{ object, level, tile, version: BigInt(version), layer: 0, codec: 4, bounces: 2, error: 0, base: 0n },
  ...golden,
  ...more,
});
const gone = (object, level, tile, version) =>
  tileOf(object, level, tile, version, { codec: 0, scale: 1, payload: Uint8Array.of(0) });
const coefficientsOf = (replica) =>
  [...replica.slots.get(0).held.values()].filter((held) => held.coefficients);

test('a tile of a finer level comes, is withdrawn, and comes whole again', () => {
  const replica = replicaOf();
  const id = replica.map.find(0, FINER + 2, 1);
  replica.takeTile(tileOf(0, FINER + 2, 1, 5), 1);
  assert.deepEqual([...replica.takeBatch().id], [id]);
  replica.takeTile(gone(0, FINER + 2, 1, 5), 1);
  assert.equal(replica.batchTiles(), 0, 'it is no newer');
  replica.takeTile(gone(0, FINER + 2, 1, 6), 1);
  assert.equal(coefficientsOf(replica).length, 0);
  const batch = replica.takeBatch();
  assert.deepEqual([[...batch.id], [...batch.noiseLevel], batch.texels.length], [[id], [GONE], 0]);
  replica.takeTile(gone(0, FINER + 2, 1, 7), 1);
  assert.equal(replica.batchTiles(), 0, 'it was not there');
  assert.throws(() => replica.takeTile(tileOf(0, FINER + 2, 1, 8, { base: 6n }), 1), /builds on/);
  replica.takeTile(tileOf(0, FINER + 2, 1, 8), 1);
  assert.equal(replica.takeBatch().texels.length, 64 * 64);
  assert.equal(replica.held().ids.length, 0, 'HOLDS lists none');
  replica.beginRun();
  assert.deepEqual([...replica.takeBatch().noiseLevel], [GONE], 'another run has none yet');
  replica.destroy();
});

test('of finer tiles those listed last are kept, and a difference to others is no error', () => {
  const wide = { ...scene, meshes: [{ atlasWidth: 2048, atlasHeight: 1024 }], objectMesh: Uint32Array.of(0) };
  const replica = new Replica(wide, tiles, 0n, undefined, 1);
  const { map } = replica;
  const id = (tile) => map.find(0, FINER + 1, tile);
  const take = (tile) => replica.takeTile(tileOf(0, FINER + 1, tile, 1), 1);
  for (let tile = 0; tile < FINER_KEPT; tile++) take(tile);
  replica.want([id(0), id(1)]);
  replica.takeBatch();
  for (let tile = FINER_KEPT; tile < FINER_KEPT + 10; tile++) take(tile);
  assert.equal(coefficientsOf(replica).length, FINER_KEPT);
  const { id: ids, noiseLevel } = replica.takeBatch();
  const dropped = [...ids].filter((_, i) => noiseLevel[i] === GONE);
  assert.deepEqual(dropped, Array.from({ length: 10 }, (_, i) => id(i + 2)));
  const next = tileOf(0, FINER + 1, 2, 2, { base: 1n });
  replica.takeTile(next, 1);
  assert.equal(replica.batchTiles(), 0, 'it waits for all of it');
  replica.beginSession();
  assert.throws(() => replica.takeTile(next, 1), /builds on/);
  take(2); // the same version, whole
  assert.ok([...replica.takeBatch().id].includes(id(2)));
  replica.destroy();
});

for (const [what, given, finer, expected] of [
  ['of a level that this session lacks', tileOf(0, FINER + 1, 0, 1), 0, /there is none/],
  ['of a level beyond the finest', tileOf(0, FINER + 3, 0, 1), 2, /there is none/],
  ['of level 64', tileOf(0, FINER, 0, 1), 2, /there is none/],
  ['beyond its level', tileOf(0, FINER + 1, 15, 1), 2, /there is none/],
  ['of an object without a lightmap', tileOf(1, FINER + 1, 0, 1), 2, /there is none/],
  ['withdrawn, and of level 0', gone(0, 0, 0, 1), 2, /codec 0/],
  ['of an unknown codec', tileOf(0, FINER + 1, 0, 1, { codec: 2 }), 2, /codec 2/],
  ['a difference to nothing', tileOf(0, FINER + 1, 0, 2, { base: 1n }), 2, /builds on/],
  ['of another layer', tileOf(0, FINER + 1, 0, 1, { layer: 1 }), 2, /layer 1/],
  ['damaged', tileOf(0, FINER + 1, 0, 1, { payload: Uint8Array.of(1, 2, 3) }), 2, /damaged/],
])
  test(`a finer tile is ${what}`, () => {
    const replica = replicaOf(finer);
    assert.throws(
      () => replica.takeTile(given, 1),
      (error) => error instanceof ProtocolError && expected.test(error.message),
    );
    assert.equal(replica.batchTiles(), 0);
    replica.destroy();
  });

test('the golden withdrawal, and bytes from anyone', () => {
  const bytes = new Uint8Array(readFileSync(join(root, 'tests/golden/v1/tile_gone.bin'))).subarray(8);
  const told = readTile(bytes);
  assert.deepEqual([told.object, told.level, told.tile, told.codec, told.version], [2, 66, 5, 0, 302n]);
  const replica = replicaOf();
  let [taken, seed] = [0, 1];
  const random = () => (seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0) >>> 8;
  for (let round = 0; round < 3000; round++) {
    const torn = bytes.slice();
    for (let i = random() % 4; i >= 0; i--) torn[random() % torn.length] = random();
    try {
      replica.takeTile(readTile(torn), 1);
      taken++;
    } catch (error) {
      assert.ok(error instanceof ProtocolError, error.stack);
    }
  }
  assert.ok(taken > 0 && taken < 3000, `${taken} were tiles`);
  replica.destroy();
});

// ---- slots ----

/** One atlas of 2 x 2 tiles of its finer level, or of more. */
function slotsOf(count, width = 64) {
  const map = new AtlasMap([{ atlasWidth: width, atlasHeight: 64 }], Uint32Array.of(0), 1);
  const [written, shown] = [new Map(), new Map()];
  const pool = new FinerTiles(
    map,
    count,
    (slot, texels) => written.set(slot, texels),
    (id, entry) => shown.set(id, entry),
  );
  const id = (tile) => map.find(0, FINER + 1, tile);
  const take = (tile, value = tile + 1) => pool.take(id(tile), new Uint32Array(64 * 64).fill(value));
  const want = (...wanted) => pool.want(wanted.map(id));
  const slot = (tile) => shown.get(id(tile)) & ((1 << SLOT_BITS) - 1);
  const share = (tile) => (shown.get(id(tile)) ?? 0) >> SLOT_BITS;
  return { pool, id, take, want, slot, share, written };
}

test('a tile fades in by the clock of who draws, and out when nobody wants it', () => {
  const { pool, take, want, share } = slotsOf(4);
  pool.step(1000);
  want(0);
  take(0);
  assert.equal(share(0), 0);
  pool.step(1000);
  assert.equal(share(0), 0);
  assert.equal(pool.step(1125), true);
  assert.equal(share(0), Math.round(SHARE_WHOLE / 2));
  pool.step(1250);
  assert.equal(share(0), SHARE_WHOLE);
  assert.equal(pool.step(1300), false, 'pictures stay');
  take(0, 9);
  assert.equal(pool.step(1400), false, 'its next version is there at once');
  want();
  pool.step(1500);
  assert.equal(share(0), Math.round(0.6 * SHARE_WHOLE));
  want(0);
  pool.step(Infinity);
  assert.equal(share(0), SHARE_WHOLE);
});

test('a withdrawn tile fades out with its texels, and in again from there if it comes back', () => {
  const { pool, id, take, want, slot, share, written } = slotsOf(4);
  want(0, 1);
  take(0);
  take(1);
  pool.step(Infinity);
  pool.step(1000);
  const before = [slot(0), written.get(slot(0))];
  pool.drop(id(0));
  assert.equal(share(0), SHARE_WHOLE, 'no picture was drawn since');
  assert.equal(pool.step(1125), true);
  assert.equal(share(0), Math.round(SHARE_WHOLE / 2));
  take(1, 7);
  assert.deepEqual([slot(0), written.get(slot(0))], before, 'it stays as it was');
  take(0, 5);
  assert.equal(slot(0), before[0]);
  assert.deepEqual([written.get(slot(0))[0], written.get(slot(0))[64]], [5, 7]);
  assert.equal(share(0), Math.round(SHARE_WHOLE / 2));
  pool.step(1187.5);
  assert.equal(share(0), Math.round(0.75 * SHARE_WHOLE));
  pool.drop(id(0));
  pool.drop(id(0));
  assert.equal(pool.step(1375), true);
  assert.equal(share(0), 0);
  assert.equal(pool.step(1400), false);
  for (const tile of [0, 2, 3]) take(tile); // its slot is free
  want(0, 1, 2, 3);
  pool.step(Infinity);
  assert.deepEqual([0, 1, 2, 3].map(share), Array(4).fill(SHARE_WHOLE));
  pool.drop(id(3));
  pool.step(Infinity);
  assert.equal(share(3), 0, 'without a clock it goes at once');
});

test('a full pool takes the slot of a tile that fades out at once, before those of others', () => {
  const { pool, id, take, want, slot, share } = slotsOf(2, 256);
  want(0, 1);
  take(0);
  take(1);
  pool.step(Infinity);
  pool.step(1000);
  pool.drop(id(1));
  pool.step(1050);
  const freed = slot(1);
  want(0, 1, 2);
  take(2);
  pool.step(1100);
  assert.deepEqual([share(1), slot(2)], [0, freed]);
  assert.equal(share(0), SHARE_WHOLE);
  assert.ok(share(2) > 0);
  take(1);
  want(0, 1, 2); // it is wanted more than the one that has its slot
  assert.deepEqual([share(2), share(0)], [0, SHARE_WHOLE]);
});

test('a withdrawn tile of which nothing is shown leaves its slot at once', () => {
  const { pool, id, take, want, share } = slotsOf(1);
  take(0);
  pool.drop(id(0));
  want(1);
  take(1);
  pool.step(Infinity);
  assert.deepEqual([share(0), share(1)], [0, SHARE_WHOLE]);
  assert.equal(pool.step(2000), false);
});

test('what nobody wants loses its slot first, and what the picture wants last', () => {
  const { pool, take, want, share } = slotsOf(3, 256);
  want(0, 1, 2);
  for (const tile of [0, 1, 2]) take(tile);
  pool.step(Infinity);
  const shown = () => [0, 1, 2, 3, 4, 5].filter((tile) => share(tile));
  take(3);
  pool.step(Infinity);
  assert.deepEqual(shown(), [0, 1, 2], 'nobody wants it');
  want(3, 1, 2);
  pool.step(Infinity);
  assert.deepEqual(shown(), [1, 2, 3]);
  // more than there are slots: the most important ones
  take(4);
  want(4, 3, 2, 1);
  pool.step(Infinity);
  assert.deepEqual(shown(), [2, 3, 4]);
  take(5);
  pool.step(Infinity);
  assert.deepEqual(shown(), [2, 3, 4], 'it has no rank');
  // the tile that comes back still has its slot
  want(0, 1);
  pool.step(Infinity);
  assert.deepEqual(shown(), [0, 1]);
  assert.equal(pool.step(2000), false);
});

test('a tile without directions has none of the tile whose slot it has', () => {
  const map = new AtlasMap([{ atlasWidth: 64, atlasHeight: 64 }], Uint32Array.of(0), 1);
  const slot = { light: null, directions: null };
  const pool = new FinerTiles(
    map,
    1,
    (_, texels, directions) => (slot[directions ? 'directions' : 'light'] = texels),
    () => {},
  );
  const [first, second] = [map.plainCount, map.plainCount + 3];
  const texels = (value) => new Uint32Array(64 * 64).fill(value);
  pool.take(first, texels(1));
  assert.equal(slot.directions, null);
  pool.direct(first, texels(7));
  assert.equal(slot.directions[0], 7);
  pool.drop(first);
  pool.take(second, texels(2));
  assert.deepEqual([slot.light[0], slot.directions[0]], [2, 0]);
});

test('a slot ends with the texels of the tiles beside and below, or with its own', () => {
  const { pool, id, take, want, slot, written } = slotsOf(4);
  want(0, 1, 2, 3);
  take(0);
  pool.step(Infinity);
  const at = (tile, x, y) => written.get(slot(tile))[SLOT_SIDE * y + x];
  const ends = () => [at(0, 63, 63), at(0, 64, 5), at(0, 5, 64), at(0, 64, 64)];
  assert.deepEqual(ends(), [1, 1, 1, 1]);
  take(3);
  assert.deepEqual(ends(), [1, 1, 1, 4]);
  take(1);
  take(2);
  pool.step(Infinity);
  assert.deepEqual(ends(), [1, 2, 3, 4]);
  assert.equal(at(1, 5, 64), 4);
  assert.equal(at(1, 64, 5), 2, 'the edge of the level');
  take(1, 7);
  assert.deepEqual(ends(), [1, 7, 3, 4]);
  pool.drop(id(2));
  assert.deepEqual(ends(), [1, 7, 1, 4]);
});

test('tiles at the edge of a level are narrower', () => {
  const map = new AtlasMap([{ atlasWidth: 40, atlasHeight: 34 }], Uint32Array.of(0), 1);
  let written = null;
  const pool = new FinerTiles(map, 4, (slot, texels) => slot === 3 && (written = texels), () => {});
  pool.want([map.plainCount]);
  const place = (tile) => map.place(map.plainCount + tile);
  const take = (tile) => {
    const { x, y, width, height } = place(tile);
    const at = (i) => 1000 * (y + Math.floor(i / width)) + x + (i % width);
    const texels = Uint32Array.from({ length: width * height }, (_, i) => at(i));
    pool.take(map.plainCount + tile, texels);
  };
  for (const tile of [0, 1, 2, 3]) take(tile);
  assert.deepEqual([place(1).width, place(2).height], [16, 4]);
  for (const [x, y] of [[0, 0], [63, 63], [64, 0], [64, 63], [0, 64], [64, 64]]) // prettier-ignore
    assert.equal(written[SLOT_SIDE * y + x], 1000 * y + x);
});

// ---- the pages ----

test('slots lie in the pages beside levels, and cost no layer', () => {
  const map = new AtlasMap([{ atlasWidth: 130, atlasHeight: 70 }], Uint32Array.of(0), 2);
  const { width, height, layers, level, levelFirst, slots } = layOut(map, 1, 2048, 256, 512);
  assert.deepEqual([slots, layers, level.length / 4 - levelFirst[1]], [512, 1, 512]);
  const taken = new Uint8Array(width * height);
  for (let i = 0; i < level.length; i += 4) {
    const [x, y, w, h] = [level[i] & 0xffff, level[i] >>> 16, level[i + 3] & 0xffff, level[i + 3] >>> 16];
    if (i >= 4 * levelFirst[1]) assert.deepEqual([w, h], [SLOT_SIDE, SLOT_SIDE]);
    assert.ok(x + w <= width && y + h <= height);
    for (let row = y; row < y + h; row++)
      for (let column = x; column < x + w; column++) assert.equal(taken[row * width + column]++, 0);
  }
  // a page of 512 x 512 has few places left
  const some = layOut(map, 1, 512, 256, 512).slots;
  assert.ok(some > 0 && some < 64, `${some}`);
  const full = new AtlasMap([{ atlasWidth: 512, atlasHeight: 340 }], Uint32Array.of(0), 1);
  assert.equal(layOut(full, 1, 512, 256, 512).slots, 0);
});

test('what a page has no room for is left out: level 0, then level 1', () => {
  const of = (side, objects) => {
    const map = new AtlasMap([{ atlasWidth: side, atlasHeight: side }], new Uint32Array(objects), 1);
    return layOut(map, objects, 4096, 256, 512);
  };
  assert.deepEqual([of(4096, 11).finest, of(4096, 13).finest, of(4096, 60).finest], [0, 1, 2]);
  assert.equal(of(4096, 13).slots, 0, 'finer ones then have none either');
  assert.equal(of(4097, 1).finest, 1);
  const { level } = of(4096, 13);
  assert.deepEqual([level[2], level[6]], [0, 4096], 'tiles have their numbers');
  assert.throws(
    () => of(4096, 300),
    (error) => error instanceof LimitError && /takes \d+ MB, more than a page has/.test(error.message),
  );
  // the only level of a small lightmap stays
  const beside = [
    { atlasWidth: 16, atlasHeight: 16 },
    { atlasWidth: 4097, atlasHeight: 4 },
  ];
  const small = layOut(new AtlasMap(beside, Uint32Array.of(0, 1)), 2, 4096, 1);
  assert.equal(small.finest, 1);
  const [x, y] = [small.level[0] & 0xffff, small.level[0] >>> 16];
  assert.ok(x + 16 <= small.width && y + 16 <= small.height);
});
