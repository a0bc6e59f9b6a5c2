// Page and WebSocket behind the proxies of docs/access.md, by TLS and below a path.
// With LW_WEB_BROWSER=1 Chromium loads the page through them, too.
import assert from 'node:assert/strict';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { get } from 'node:https';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test from 'node:test';
import { connect } from 'node:tls';
import { brotliDecompressSync } from 'node:zlib';
import WebSocket from 'ws';

import { hasDaemon, LIMIT_MS, startDaemon, within } from './daemon.mjs';
import { load, quietHost, wasm, web } from './load.mjs';
import { HOST, hasProgram, startProxy } from './proxy.mjs';

const { serverAddress, Session, Tiles, nothingKept } = await load('address', 'session', 'tiles');
const PAGE = `https://${HOST}/light/`;
const skip = !hasDaemon() && 'there is no lightwelld in build/release/bin';
const names = ['nginx', 'caddy'];

/** A connection to the proxy under its public name. */
const dial = (port) => () =>
  connect({ host: '127.0.0.1', port, servername: HOST, rejectUnauthorized: false, ALPNProtocols: ['http/1.1'] });

function ask(port, path, headers) {
  const answer = new Promise((resolve, reject) => {
    const options = { host: HOST, path, headers: { host: HOST, ...headers }, createConnection: dial(port) };
    get(options, (response) => {
      const chunks = [];
      response.on('data', (chunk) => chunks.push(chunk));
      response.on('end', () => resolve({ ...response, headers: response.headers, body: Buffer.concat(chunks) }));
    }).once('error', reject);
  });
  return within(`${path} of the proxy`, answer);
}

/** A session by the address that the page asks for, until it has the scene. */
async function receive(port) {
  const { url } = serverAddress(new URL(PAGE), null);
  const tiles = await Tiles.create(wasm());
  const options = { createConnection: dial(port), origin: new URL(PAGE).origin };
  const socket = new WebSocket(url, 'lightwell', options);
  const scene = new Promise((resolve, reject) => {
    socket.once('error', reject);
    socket.once('close', (code) => reject(new Error(`closed: ${code}`)));
    let session;
    const host = {
      ...quietHost,
      send: (bytes) => socket.send(bytes),
      scene: (replica) => resolve(replica.scene),
    };
    socket.once('open', () => (session = new Session(nothingKept(), tiles, host, 0n, 0)));
    socket.on('message', (bytes) => {
      session.push(new Uint8Array(bytes), 0);
      session.pump(() => 0, 1).catch(reject);
    });
  });
  try {
    return await within('the scene', scene);
  } finally {
    socket.terminate();
  }
}

for (const name of names)
  test(`behind ${name}`, { skip: skip || (!hasProgram(name) && `there is no ${name}`) }, async () => {
    const folder = mkdtempSync(join(tmpdir(), 'lightwell-proxy-'));
    const daemon = await startDaemon('builtin:cornell', '--freeze', '0', '--http-host', HOST);
    let proxy;
    try {
      proxy = await startProxy(name, folder, new URL(daemon.url).host);
      const slashless = await ask(proxy.port, '/light', {});
      assert.ok([301, 302, 308].includes(slashless.statusCode ?? 0), `${slashless.statusCode}`);
      assert.match(slashless.headers.location, /\/light\/$/);
      const index = await ask(proxy.port, '/light/', {});
      assert.match(`${index.body}`, /<canvas/);
      const sockets = `connect-src 'self' ws://${HOST} wss://${HOST};`;
      assert.ok(index.headers['content-security-policy'].includes(sockets));
      const worker = await ask(proxy.port, '/light/worker.js', { 'accept-encoding': 'gzip, br' });
      assert.equal(worker.headers['content-encoding'], 'br');
      assert.ok(brotliDecompressSync(worker.body).equals(readFileSync(join(web, 'worker.js'))));
      const scene = await receive(proxy.port);
      assert.ok(scene.meshes.length > 0);
      if (process.env.LW_WEB_BROWSER) await look(proxy.port);
    } finally {
      await proxy?.stop();
      await daemon.stop();
      rmSync(folder, { recursive: true });
    }
  });

async function look(port) {
  const { openBrowser, until } = await import('./page.mjs'); // takes its time
  const browser = await openBrowser(`--host-resolver-rules=MAP ${HOST}:443 127.0.0.1:${port}`);
  try {
    const page = await browser.newPage({ ignoreHTTPSErrors: true, viewport: { width: 160, height: 90 } });
    await page.goto(`${PAGE}?direct=tiles`, { timeout: LIMIT_MS });
    await until(page, 'light', () => globalThis.lightwell?.stats.tiles > 0);
  } finally {
    await browser.close();
  }
}
