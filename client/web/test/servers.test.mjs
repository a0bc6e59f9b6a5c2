// Where a page looks for its light when its server is gone; as tests/unit/test_servers.c.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

import { load, quietHost, root, wasm } from './load.mjs';

const { ClosedError, nothingKept, Servers, Session, Tiles } = await load('servers', 'session', 'tiles');

function expectNext(servers, url, isNamed) {
  servers.next();
  assert.equal(servers.url, url);
  assert.equal(servers.isNamed(), isNamed, url);
}

test('the named servers are tried in turn', () => {
  const servers = new Servers('ws://a/ws');
  assert.equal(servers.url, 'ws://a/ws');
  assert.equal(servers.isNamed(), false);
  for (let round = 0; round < 3; round++) expectNext(servers, 'ws://a/ws', false);
  servers.found('ws://b:2/ws,wss://c/x/ws');
  for (let round = 0; round < 2; round++) {
    expectNext(servers, 'ws://a/ws', false);
    expectNext(servers, 'ws://b:2/ws', true);
    expectNext(servers, 'wss://c/x/ws', true);
    expectNext(servers, 'ws://a/ws', false); // the one that was given
  }
  expectNext(servers, 'ws://a/ws', false);
  expectNext(servers, 'ws://b:2/ws', true);
  servers.found('ws://d/ws'); // b has welcomed us
  assert.equal(servers.isNamed(), false);
  expectNext(servers, 'ws://b:2/ws', false);
  expectNext(servers, 'ws://d/ws', true);
  expectNext(servers, 'ws://a/ws', false);
});

test('what is no address is left out, and by TLS what has none', () => {
  for (const named of ['', ',', 'b:2', 'http://b/', 'ws://', 'ws:///ws', 'javascript:1', '\n', 'x'.repeat(1024)]) {
    const servers = new Servers('ws://a/ws');
    servers.found(named);
    for (let i = 0; i < 4; i++) expectNext(servers, 'ws://a/ws', false);
  }
  const servers = new Servers('wss://a/ws');
  servers.found('ws://b/ws,wss://c/ws');
  expectNext(servers, 'wss://a/ws', false);
  expectNext(servers, 'wss://c/ws', true);
  expectNext(servers, 'wss://a/ws', false);
});

/** What a session does with the golden welcome that names servers. */
async function hear(kept, named) {
  const heard = [];
  const host = {
    ...quietHost,
    named,
    servers: (servers) => heard.push(servers),
  };
  const session = new Session(kept, await Tiles.create(wasm()), host, 0n, 0);
  session.push(new Uint8Array(readFileSync(join(root, 'tests/golden/v1/welcome_servers.bin'))), 0);
  await session.pump(() => 0, 1);
  return heard;
}

test('a named server lights the same scene, or is left', async () => {
  const servers = ['relay.example.org:7780,[2001:db8::1]:7780'];
  const kept = nothingKept();
  assert.deepEqual(await hear(kept, false), servers);
  assert.deepEqual(await hear(kept, true), servers);
  const other = { ...nothingKept(), packageHash: '00'.repeat(16), run: 7n };
  await assert.rejects(hear(other, true), (error) => error instanceof ClosedError && /another scene/.test(error));
  assert.equal(other.run, 7n, 'what is held still counts');
  assert.equal(other.packageHash, '00'.repeat(16));
  assert.deepEqual(await hear(other, false), servers, 'its own server may light another one');
});
