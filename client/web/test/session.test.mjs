// Sessions with a real lightwelld: the package, light, and coming back with what is held.
import assert from 'node:assert/strict';
import { connect } from 'node:net';
import { join } from 'node:path';
import test from 'node:test';

import { hasDaemon, startDaemon, within } from './daemon.mjs';
import { load, root, wasm } from './load.mjs';

const { Feature, FINER, Session, nothingKept, Tiles, buildGeometry, readTile, Type } = await load(
  'atlas',
  'session',
  'tiles',
  'geometry',
  'wire',
);
const skip = hasDaemon() ? false : 'there is no lightwelld in build/release/bin';

/** One connection by TCP, which carries the same bytes as a WebSocket. Its clock stands at 0: no PING, no
 * silence. */
class Connection {
  constructor(port, kept, tiles, parts, features = 0n) {
    this.parts = parts;
    this.frames = 0;
    this.tileCount = 0;
    this.settledFrame = 0;
    this.waits = [];
    this.sent = [];
    this.socket = connect(port, '127.0.0.1');
    this.session = new Session(kept, tiles, this, features, 0);
    this.socket.on('data', (bytes) => {
      this.session.push(new Uint8Array(bytes), 0);
      this.came?.();
    });
    this.socket.on('error', () => {});
  }
  send(bytes) {
    this.sent.push(bytes);
    this.socket.write(bytes);
  }
  find(hash) {
    return Promise.resolve(this.parts.get(hash) ?? null);
  }
  keep(hash, bytes) {
    this.parts.set(hash, bytes);
  }
  progress() {}
  scene(replica) {
    this.replica = replica;
  }
  frame() {
    this.frames++;
  }
  tiles(batch) {
    this.tileCount += batch.id.length;
    this.session.taken(batch.id.length);
  }
  waiting(waiting) {
    this.waits.push(waiting);
  }
  settled() {
    this.settledFrame = this.frames;
  }
  /** Reads what comes until `done`. */
  async until(what, done) {
    for (;;) {
      const more = new Promise((resolve) => (this.came = resolve));
      await this.session.pump(() => 0, 1);
      this.session.tick(0);
      if (done()) return;
      await within(what, more);
    }
  }
  end() {
    this.session.close();
    this.socket.destroy();
  }
}

const held = (connection) => connection.sent.filter((bytes) => bytes[4] === Type.HOLDS).length;

test('a session gets scene and light, and comes back with what it has', { skip }, async () => {
  const daemon = await startDaemon('builtin:cornell', '--clock', 'manual');
  try {
    const tiles = await Tiles.create(wasm());
    const kept = nothingKept();
    const parts = new Map();
    const first = new Connection(daemon.port, kept, tiles, parts);
    await first.until('the scene', () => first.replica);
    // the clock holds it before its first frame
    const isInside = ({ stage, share }) => stage === 2 && share === 1;
    await first.until('the look inside objects', () => first.waits.some(isInside));
    assert.equal(first.frames, 0);
    daemon.frames(1);
    await first.until('the first light', () => first.settledFrame > 0);
    assert.deepEqual(first.waits.at(-1), { stage: 4, share: 1 });
    first.waits.reduce((before, now) => {
      const isLater = now.stage > before.stage || (now.stage === before.stage && now.share > before.share);
      assert.ok(isLater, JSON.stringify(first.waits));
      return now;
    });
    const { replica } = kept;
    const { map } = replica;
    assert.ok(replica.hasFirst());
    assert.equal(parts.size, 1);
    // until it says what it wants it gets stand-ins alone: what it sends first says so
    assert.deepEqual(
      first.sent.slice(0, 3).map((bytes) => bytes[4]),
      [Type.HELLO, Type.INTEREST, Type.PACKAGE_REQUEST],
    );
    const coarsest = replica.scene.objectMesh.reduce((sum, _, object) => {
      const { tilesX, tilesY } = map.of(object).levels.at(-1) ?? { tilesX: 0, tilesY: 0 };
      return sum + tilesX * tilesY;
    }, 0);
    assert.ok(coarsest < map.tileCount);
    assert.equal(replica.held().ids.length, coarsest);
    first.session.setInterest(Uint32Array.from({ length: map.tileCount }, (_, id) => id));
    await first.until('all tiles', () => replica.held().ids.length === map.tileCount);
    const mean = replica.meanIrradiance();
    assert.ok(mean[0] > mean[2] && mean[2] > 0, `the lamp is warm: ${mean}`);

    // a long backlog: no tile is wanted until it is short again
    const interests = () => first.sent.filter((bytes) => bytes[4] === Type.INTEREST);
    await first.until('all that has come', () => first.session.waiting() === 0);
    const unknown = new Uint8Array(1 << 20);
    new DataView(unknown.buffer).setUint32(0, unknown.length - 8, true);
    unknown[4] = 77;
    for (let i = 0; i < 5; i++) first.session.push(unknown, 0);
    assert.equal(interests().at(-1).length, 8, 'an empty INTEREST');
    await first.until('interest again', () => interests().at(-1).length > 8);
    assert.equal(first.session.waiting() < 1 << 20, true);
    first.end();

    const second = new Connection(daemon.port, kept, tiles, parts);
    await second.until('more light', () => second.settledFrame > 0);
    assert.equal(held(second), 2, 'its frame and its tiles');
    assert.equal(kept.replica, replica);
    assert.equal(second.replica, undefined, 'the scene is kept');
    assert.equal(second.tileCount, 0, 'and so is its light');
    assert.deepEqual(second.waits, [], 'for which it need not wait');
    second.end();

    // another page of the same browser: the package comes from the store
    const third = new Connection(daemon.port, nothingKept(), tiles, parts);
    await third.until('light', () => third.settledFrame > 0);
    assert.ok(third.replica);
    third.end();

    const data = buildGeometry(third.replica.scene, tiles);
    assert.equal(data.position.length / 3, data.tag.length);
    assert.ok(data.index.every((vertex) => vertex < data.tag.length));
    const triangles = third.replica.scene.meshes.reduce((sum, mesh) => sum + mesh.triangleCount, 0);
    assert.equal(data.index.length, 3 * triangles);
  } finally {
    await daemon.stop();
  }
});

test('a session that reads finer levels lists their tiles, and gets them whole', { skip }, async () => {
  const daemon = await startDaemon('builtin:cornell', '--clock', 'manual', '--freeze', '0', '--detail', '1');
  try {
    const tiles = await Tiles.create(wasm());
    const [kept, parts] = [nothingKept(), new Map()];
    const first = new Connection(daemon.port, kept, tiles, parts, Feature.FINER);
    await first.until('the scene', () => first.replica);
    const { replica } = kept;
    const { map } = replica;
    assert.equal(map.finer, 1);
    const id = map.find(2, FINER + 1, 0);
    first.session.setInterest(Uint32Array.of(id));
    const heldOf = () => replica.slots.get(0).held.get(id);
    for (let round = 0; round < 200 && !heldOf(); round++) {
      const before = first.settledFrame;
      daemon.frames(4);
      await first.until('light', () => first.settledFrame > before);
    }
    assert.ok(heldOf(), 'a tile of a finer level has come');
    assert.ok(replica.held().ids.length > 0 && !replica.held().ids.includes(id), 'HOLDS leaves it out');
    first.end();

    // in a new session it is dropped, and comes whole once more
    const second = new Connection(daemon.port, kept, tiles, parts, Feature.FINER);
    second.session.setInterest(Uint32Array.of(id));
    await second.until('the tile once more', () => second.settledFrame > 0 && heldOf());
    assert.equal(kept.replica, replica);
    second.end();

    // who does not ask for finer levels has none, and another scene's numbers
    const third = new Connection(daemon.port, kept, tiles, parts);
    await third.until('the scene', () => third.replica);
    assert.equal(third.replica.map.finer, 0);
    third.end();
  } finally {
    await daemon.stop();
  }
});

/** One that shows materials. */
class Shows extends Connection {
  finishes(finishes) {
    this.shown = finishes;
    this.framesBefore = this.frames;
  }
}

const sentTypes = (connection) => connection.sent.map((bytes) => bytes[4]);
const asked = (connection) => sentTypes(connection).filter((type) => type === Type.FINISH_REQUEST).length;

test('finishes come behind the first light, to who asks, and once', { skip }, async () => {
  const scene = join(root, 'tests/fuzz/corpus/fuzz_package/finishes');
  const daemon = await startDaemon(scene, '--clock', 'manual');
  try {
    const tiles = await Tiles.create(wasm());
    const kept = nothingKept();
    const parts = new Map();
    const first = new Shows(daemon.port, kept, tiles, parts);
    await first.until('the scene', () => first.replica);
    const isInside = ({ stage, share }) => stage === 2 && share === 1;
    await first.until('the look inside objects', () => first.waits.some(isInside));
    assert.equal(asked(first), 0, 'not before there is light');
    daemon.frames(2); // it may have the light of another layer first
    await first.until('finishes', () => first.shown);
    assert.equal(asked(first), 1);
    assert.ok(first.framesBefore > 0 && kept.replica.hasFirst());
    assert.equal(first.shown.materials[1].roughness, 0.5);
    assert.equal(first.shown.textures.length, 3);
    first.end();

    const second = new Shows(daemon.port, kept, tiles, parts);
    await second.until('more light', () => second.settledFrame > 0);
    assert.equal(asked(second), 0, 'it has them');
    assert.equal(second.shown, undefined);
    second.end();

    // another page of the same browser: from the store
    const third = new Shows(daemon.port, nothingKept(), tiles, parts);
    await third.until('finishes', () => third.shown);
    assert.equal(asked(third), 0);
    assert.equal(third.shown.materials[1].roughness, 0.5);
    third.end();

    const matt = new Connection(daemon.port, nothingKept(), tiles, new Map());
    await matt.until('light', () => matt.settledFrame > 0);
    assert.equal(asked(matt), 0);
    matt.end();
  } finally {
    await daemon.stop();
  }
});
