// The page, with relays between it and the solver.
import assert from 'node:assert/strict';
import { connect, createServer } from 'node:net';
import test from 'node:test';

import { hasDaemon, startRelay } from './daemon.mjs';
import { hasBrowser, until } from './page.mjs';
import { startStill } from './pictures.mjs';
import { withPage } from './shared.mjs';

const skip =
  (!hasDaemon() && 'there is no lightwelld in build/release/bin') || (!hasBrowser() && 'there is no chromium');

/** An address that is known before the server behind it: to(port) says where that is. */
function openDoor() {
  const sockets = new Set();
  let port = 0;
  const server = createServer((from) => {
    const to = connect(port, '127.0.0.1');
    for (const [socket, other] of [
      [from, to],
      [to, from],
    ]) {
      sockets.add(socket);
      socket.on('error', () => other.destroy());
      socket.on('close', () => sockets.delete(socket) && other.destroy());
      socket.pipe(other);
    }
  });
  return new Promise((resolve, reject) => {
    server.once('error', reject);
    server.listen(0, '127.0.0.1', () =>
      resolve({
        port: server.address().port,
        to: (url) => (port = Number(new URL(url).port)),
        close() {
          server.close();
          for (const socket of sockets) socket.destroy();
        },
      }),
    );
  });
}

const settled = (frames) => {
  const { stats } = lightwell;
  const complete = stats.settled === stats.frames && stats.interest && !stats.missing;
  return stats.frames > frames && complete && lightwell.message() === '';
};

test('a page goes on where its server sent it, with the light that it has', { skip }, async () => {
  const door = await openDoor();
  const running = [];
  const start = async (starting) => {
    running.push(await starting);
    return running.at(-1);
  };
  try {
    const daemon = await start(startStill('builtin:cornell'));
    const above = `127.0.0.1:${daemon.port}`;
    // nobody is at the first address; programs are told the second alone
    const servers = `ws://127.0.0.1:9/ws,127.0.0.1:9,ws://127.0.0.1:${door.port}/ws`;
    const first = await start(startRelay(above, '--servers', servers));
    const middle = await start(startRelay(above));
    const origin = new URL(first.url).origin;
    const second = await start(startRelay(`127.0.0.1:${middle.port}`, '--http-origin', origin));
    door.to(second.url);
    await withPage(
      { width: 160, height: 90 },
      async (page) => {
        await page.goto(`${first.url}?camera=0,1,3:0,1,0:45&direct=tiles`);
        await until(page, 'the scene', () => lightwell.stats.sceneMs > 0);
        daemon.frames(1);
        await until(page, 'light', settled, { given: 0 });
        const before = await page.evaluate(() => ({ ...lightwell.stats }));
        await first.crash();
        await until(page, 'the other server', settled, { given: before.frames });
        const after = await page.evaluate(() => ({ ...lightwell.stats }));
        assert.equal(after.tiles, before.tiles, 'it said what it holds');
        assert.equal(after.sceneMs, before.sceneMs, 'the scene stays');
        daemon.frames(1);
        await until(page, 'new light', (tiles) => lightwell.stats.tiles > tiles, { given: after.tiles });
      },
      { mayWarn: true }, // browsers name servers that do not answer
    );
  } finally {
    door.close();
    for (const server of running.reverse()) await server.stop();
  }
});
