// Sessions with a real lightwelld: the package, light, and coming back with what is held.
import assert from 'node:assert/strict';
import { connect } from 'node:net';
import test from 'node:test';

import { hasDaemon, startDaemon } from './daemon.mjs';
import { load, wasm } from './load.mjs';

const { Session, nothingKept, Tiles, buildGeometry, readTile, Type } = await load(
  'session',
  'tiles',
  'geometry',
  'wire',
);
const skip = hasDaemon() ? false : 'there is no lightwelld in build/release/bin';

/** One connection by TCP, which carries the same bytes as a WebSocket. */
class Connection {
  constructor(port, kept, tiles, parts) {
    this.parts = parts;
    this.frames = 0;
    this.tileCount = 0;
    this.settledFrame = 0;
    this.sent = [];
    this.socket = connect(port, '127.0.0.1');
    this.session = new Session(kept, tiles, this, 0n, performance.now());
    this.socket.on('data', (bytes) => this.session.push(new Uint8Array(bytes), performance.now()));
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
  settled() {
    this.settledFrame = this.frames;
  }
  async until(what, done) {
    const limit = performance.now() + 60000;
    while (!done()) {
      assert.ok(performance.now() < limit, `waited for ${what}`);
      await this.session.pump(() => performance.now(), performance.now() + 50);
      this.session.tick(performance.now());
      await new Promise((go) => setTimeout(go, 10));
    }
  }
  end() {
    this.session.close();
    this.socket.destroy();
  }
}

const held = (connection) => connection.sent.filter((bytes) => bytes[4] === Type.HOLDS).length;

test('a session gets scene and light, and comes back with what it has', { skip }, async () => {
  const daemon = await startDaemon('builtin:cornell', '--clock', 'step', '--frames', '100000');
  try {
    const tiles = await Tiles.create(wasm());
    const kept = nothingKept();
    const parts = new Map();
    const first = new Connection(daemon.port, kept, tiles, parts);
    await first.until('the first light', () => first.settledFrame > 0);
    const { replica } = kept;
    assert.ok(replica.hasFirst());
    assert.equal(parts.size, 1);
    const coarse = first.tileCount;
    first.session.setInterest(Uint32Array.from({ length: replica.map.tileCount }, (_, id) => id));
    await first.until('all tiles', () => replica.held().ids.length === replica.map.tileCount);
    assert.ok(first.tileCount > coarse);
    const mean = replica.meanIrradiance();
    assert.ok(mean[0] > mean[2] && mean[2] > 0, `the lamp is warm: ${mean}`);

    // a long backlog: no tile is wanted until it is short again
    const interests = () => first.sent.filter((bytes) => bytes[4] === Type.INTEREST);
    await first.until('all that has come', () => first.session.waiting() === 0);
    const unknown = new Uint8Array(1 << 20);
    new DataView(unknown.buffer).setUint32(0, unknown.length - 8, true);
    unknown[4] = 77;
    for (let i = 0; i < 5; i++) first.session.push(unknown, performance.now());
    assert.equal(interests().at(-1).length, 8, 'an empty INTEREST');
    await first.until('interest again', () => interests().at(-1).length > 8);
    assert.equal(first.session.waiting() < 1 << 20, true);
    first.end();

    const second = new Connection(daemon.port, kept, tiles, parts);
    await second.until('more light', () => second.settledFrame > 0);
    assert.equal(held(second), 1);
    assert.equal(kept.replica, replica);
    assert.equal(second.replica, undefined, 'the scene is kept');
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
