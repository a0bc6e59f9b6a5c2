// Who may connect, in the browser client: tokens, TLS, sliders for those who may change the scene.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { createHash, X509Certificate } from 'node:crypto';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test from 'node:test';

import { hasDaemon, startDaemon } from './daemon.mjs';
import { load } from './load.mjs';
import { checkAccessibility, checkLayout, hasBrowser } from './page.mjs';
import { pictureName, resizeAround, until } from './page.mjs';
import { withPage } from './shared.mjs';

const { writeHello, writeUpdate, readUpdated, Refusal, Session, nothingKept, lampsOf, changesOf } = await load(
  'wire',
  'session',
  'lamps',
);

const VIEW = '11'.repeat(32);
const CONTROL = '22'.repeat(32);

const hasOpenssl = () => {
  try {
    return !!execFileSync('openssl', ['version']);
  } catch {
    return false;
  }
};
const missing =
  (!hasDaemon() && 'there is no lightwelld in build/release/bin') ||
  (!hasOpenssl() && 'there is no openssl') ||
  (!hasBrowser() && 'there is no chromium');

test('what a client writes', () => {
  const hex = (bytes) => Buffer.from(bytes).toString('hex');
  assert.equal(
    hex(writeHello(4n, 'x', new Uint8Array(32).fill(7))),
    `2900000001000000080110041a01782a20${'07'.repeat(32)}`,
  );
  assert.equal(
    hex(writeUpdate(3n, [{ kind: 5, target: 2, values: [1, 0, 2] }, { kind: 8, target: 1, values: [] }])),
    '2e0000000d000000080312080500000008000000' +
      '1a080200000001000000' +
      '22080300000000000000' +
      '2a0c0000803f0000000000000040',
  );
  const updated = Uint8Array.from([8, 3, 16, 6, 34, 2, 104, 105]);
  assert.deepEqual(readUpdated(updated), { request: 3n, code: 6, text: 'hi' });
});

test('what becomes of each refusal', async () => {
  const ends = {};
  for (const [name, code] of Object.entries(Refusal)) {
    const session = new Session(nothingKept(), null, { send() {} }, 0n, 0);
    session.push(Uint8Array.from([2, 0, 0, 0, 3, 0, 0, 0, 8, code]), 0);
    await session.pump(() => 0, 1).then(
      () => assert.fail('no refusal'),
      (error) => (ends[name] = `${error.constructor.name.replace(/^_/, '')} ${error.retryAfterMs ?? ''}`.trim()),
    );
  }
  const { VERSION, FULL, TIMEOUT, SHUTDOWN, PROTOCOL, FEATURES, RATE, NOT_ALLOWED, TOKEN } = ends;
  for (const final of [VERSION, PROTOCOL, FEATURES, NOT_ALLOWED]) assert.equal(final, 'ProtocolError');
  for (const later of [FULL, SHUTDOWN, TIMEOUT]) assert.equal(later, 'ClosedError 0');
  assert.equal(RATE, 'ClosedError 10000'); // who says too much waits
  assert.equal(TOKEN, 'TokenError');
});

test('lamps by name', () => {
  const scene = {
    lights: [
      { name: 'a', intensity: new Float32Array([1, 2, 4]) },
      { name: 'b', intensity: new Float32Array([1, 1, 1]) },
      { name: 'a', intensity: new Float32Array([8, 8, 8]) },
    ],
    materials: [
      { name: 'wall', emission: new Float32Array(3) },
      { name: 'a', emission: new Float32Array([6, 0, 0]) },
    ],
  };
  const lamps = lampsOf(scene);
  assert.deepEqual(lamps, [
    { name: 'a', lights: [0, 2], materials: [1] },
    { name: 'b', lights: [1], materials: [] },
  ]);
  assert.deepEqual(changesOf(scene, lamps[0], 0.5), [
    { kind: 5, target: 0, values: [0.5, 1, 2] },
    { kind: 5, target: 2, values: [4, 4, 4] },
    { kind: 10, target: 1, values: [3, 0, 0] },
  ]);
  assert.deepEqual(changesOf(scene, lamps[1], 1), [{ kind: 8, target: 1, values: [] }]);
});

test('a page by https, with a token', { skip: missing || false }, async () => {
  const folder = mkdtempSync(join(tmpdir(), 'lightwell-web-'));
  const [certificate, key, tokens] = ['certificate.pem', 'key.pem', 'tokens'].map((name) => join(folder, name));
  const make = 'req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj /CN=lightwell';
  execFileSync(
    'openssl',
    [...make.split(' '), '-addext', 'subjectAltName=IP:127.0.0.1', '-keyout', key, '-out', certificate],
    { stdio: 'ignore' },
  );
  writeFileSync(tokens, `view ${VIEW}\ncontrol ${CONTROL}\n`, { mode: 0o600 });
  const spki = new X509Certificate(readFileSync(certificate)).publicKey.export({ type: 'spki', format: 'der' });
  const pin = createHash('sha256').update(spki).digest('base64');
  const daemon = await startDaemon(
    ...['builtin:cornell', '--texels-per-metre', '8', '--freeze', '0'],
    ...['--tls-certificate', certificate, '--tls-key', key],
    ...['--tokens', tokens, '--control-socket', 'none'],
  );
  const size = { width: 160, height: 90 };
  const narrow = { width: 480, height: 640 };
  const args = [`--ignore-certificate-errors-spki-list=${pin}`];
  const address = `${daemon.url}?direct=tiles`;
  try {
    assert.match(daemon.url, /^https:/);
    await withPage(
      size,
      async (page) => {
        await page.goto(address);
        await page.locator('#token:visible').waitFor(); // it wants one
        await resizeAround(page, narrow);
        await checkAccessibility(page, 'token');
        assert.deepEqual(await checkLayout(page, 'token'), ['token', 'message']);
        const asks = pictureName('page', 'token');
        if (asks) await page.screenshot({ path: asks });
        await page.locator('#token input').fill('nonsense');
        await page.locator('#token button').click();
        const error = () => document.querySelector('#token input').validity.customError;
        assert.equal(await page.evaluate(error), true);
        await page.locator('#token input').fill(VIEW);
        await page.locator('#token button').click();
        await until(page, 'light', () => lightwell.stats.tiles > 0);
        assert.equal(await page.locator('#lamps label').count(), 0);
        await page.reload(); // the tab has kept it
        await until(page, 'light again', () => lightwell.stats.tiles > 0);
      },
      { args },
    );
    await withPage(size, async (page) => {
      await page.goto(`${address}#token=${CONTROL}`);
      await until(page, 'light', () => lightwell.stats.tiles > 0);
      assert.equal(new URL(page.url()).hash, ''); // no longer in the address
      const slider = page.locator('#lamps input').first();
      await slider.waitFor();
      await until(page, 'an exposure', () => lightwell.exposure() !== 0);
      const stops = await page.evaluate(() => lightwell.exposure());
      await slider.fill('0.25');
      await until(page, 'a longer exposure', (before) => lightwell.exposure() > before + 0.5, {
        given: stops,
      });
      // arrows move a slider that has the focus, and not the view
      const view = await page.evaluate(() => lightwell.view());
      await slider.focus();
      await page.keyboard.down('ArrowRight');
      assert.equal(await page.evaluate(() => lightwell.flight.keys.size), 0);
      await page.keyboard.up('ArrowRight');
      assert.equal(await slider.inputValue(), '0.3');
      await slider.press('w');
      await until(page, 'a step by a letter', (before) => lightwell.view() !== before, { given: view });
      await resizeAround(page, narrow);
      await checkAccessibility(page, 'sliders');
      assert.deepEqual(await checkLayout(page, 'sliders'), ['legend', 'lamps', 'help', 'tools']);
      const name = pictureName('access', 'control'); // with its sliders
      if (name) await page.screenshot({ path: name });
    });
  } finally {
    await daemon.stop();
    rmSync(folder, { recursive: true });
  }
});
