// lightwell-three in each bundler, by both entries, and with older versions of three; minutes.
import { mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test, { after } from 'node:test';

import { bundlers, hasMore, open, pack } from './bundlers.mjs';
import { hasDaemon } from './daemon.mjs';
import { hasBrowser } from './page.mjs';

const [major, minor] = process.versions.node.split('.').map(Number);
const isNew = major > 22 || (major === 22 && minor >= 12) || (major === 20 && minor >= 19);
const missing = !hasDaemon()
  ? 'there is no lightwelld in build/release/bin'
  : !hasBrowser()
    ? 'there is no chromium'
    : !hasMore() && 'there are no bundlers (scripts/deps.sh --all)';
const folder = mkdtempSync(join(tmpdir(), 'lightwell-bundlers-'));
after(() => rmSync(folder, { recursive: true }));
if (!missing) pack(folder);

// as the package's README has it; the scene's buffer is a data: URL
const csp =
  "script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; " +
  "connect-src 'self' data: ws://HOST:PORT http://HOST:PORT";
const rows = [
  ...Object.keys(bundlers).flatMap((bundler) => [
    [bundler, { example: 'vite' }],
    [bundler, { example: 'vite', inline: true }],
  ]),
  ['Vite 6, build', { example: 'vite', csp }],
  [
    'Vite 6, build',
    { example: 'vite', csp: csp.replace("worker-src 'self'", 'worker-src blob:'), inline: true },
  ],
  ['Vite 6, build', { example: 'react' }],
  ...['three-160', 'three-170'].map((three) => ['Vite 6, build', { example: 'vite', three }]),
];
for (const [bundler, options] of rows) {
  const old = bundler.startsWith('Vite 8') && !isNew && 'Vite 8 wants Node.js 20.19 or 22.12';
  const { example, inline = false, three = 'three' } = options;
  const entry = example === 'react' ? 'React' : inline ? 'inline' : 'files';
  const name = `${bundler}: ${entry}, ${three}${options.csp ? ', by a content security policy' : ''}`;
  test(`three: ${name}`, { skip: missing || old || false }, () => open(folder, bundler, options));
}
