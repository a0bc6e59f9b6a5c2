// Why there is no light yet: the words, and the session that hears them.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

import { load, quietHost, root, wasm } from './load.mjs';

const { lightingText, READY, Session, Tiles, nothingKept, waitingText } = await load('session', 'tiles', 'waiting');
const golden = (name) => new Uint8Array(readFileSync(join(root, 'tests/golden/v1', name)));

test('words for people', () => {
  const text = (stage, share) => waitingText({ stage, share });
  assert.equal(waitingText(null), 'Waiting for the first light');
  assert.equal(text(1, 0), 'Placing texels: 0 %');
  assert.equal(text(2, Math.fround(0.42)), 'Looking inside objects: 42 %');
  assert.equal(text(3, Math.fround(0.17)), 'First light: 17 %');
  assert.equal(text(READY, 1), '');
  assert.equal(text(77, 0.5), 'Waiting for the first light', 'of a newer server');
  const lighting = (stage, share) => lightingText({ stage, share });
  assert.equal(lighting(2, 0.4), 'The server is lighting the scene, 40 %: looking inside objects');
  assert.equal(lighting(READY, 1), '');
  assert.equal(lighting(77, 0.5), 'Waiting for the first light');
  assert.equal(lightingText(null), 'Waiting for the first light');
});

async function hear(...names) {
  const heard = [];
  const host = {
    ...quietHost,
    waiting: (waiting) => heard.push([waiting.stage, waiting.share]),
  };
  const session = new Session(nothingKept(), await Tiles.create(wasm()), host, 0n, 0);
  for (const name of names) session.push(golden(name), 0);
  await session.pump(() => 0, 1);
  return heard;
}

test('a session hears them in order', async () => {
  const names = ['welcome.bin', 'waiting_none_done.bin', 'waiting.bin', 'waiting_ready.bin'];
  assert.deepEqual(await hear(...names), [
    [1, 0],
    [2, 0.25],
    [4, 1],
  ]);
});

test('what is no wait ends it', async () => {
  await assert.rejects(hear('waiting.bin'), /WELCOME/);
  await assert.rejects(hear('welcome.bin', 'invalid_waiting_share.bin'), /WAITING.*share/);
  await assert.rejects(hear('welcome.bin', 'invalid_waiting_stage.bin'), /WAITING.*stage/);
});
