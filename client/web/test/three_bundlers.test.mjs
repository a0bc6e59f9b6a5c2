// lightwell-three in each bundler, by both entries, and with older versions of three; minutes.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { cpSync, mkdirSync, mkdtempSync, rmSync, symlinkSync, writeFileSync } from 'node:fs';
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

const program = `import { Lightwell, LightwellError, type LightwellState } from 'lightwell-three';
import { Lightwell as Inline } from 'lightwell-three/inline';
import { Color, PerspectiveCamera, Scene, Vector3 } from 'three';

const states: LightwellState[] = [];
const options = { signal: AbortSignal.timeout(1), timeoutMs: 5, onState: (state: LightwellState) => states.push(state) };
export async function run(): Promise<number> {
  const light: Lightwell = await Lightwell.attach(new Scene(), 'ws://host/ws', options);
  const stop: () => void = light.follow(new Scene());
  const e: Color = light.sample(new Vector3(), new Vector3(0, 1, 0));
  light.update(new PerspectiveCamera(), 100);
  stop();
  light.dispose();
  // @ts-expect-error: it is read only
  light.state = 'live';
  // @ts-expect-error: no such option
  await Inline.attach(new Scene(), 'ws://host/ws', { worker: 'x' });
  return e.r + light.frame + light.missing.length + light.ageSeconds();
}
export const isForbidden = (error: unknown): boolean => error instanceof LightwellError && error.code === 'forbidden';
`;
test('three: its types, as a program sees them', { skip: missing || false }, () => {
  const app = mkdtempSync(join(folder, 'types-'));
  const own = new URL('../node_modules/', import.meta.url).pathname;
  mkdirSync(join(app, 'node_modules/@types'), { recursive: true });
  cpSync(join(folder, 'package'), join(app, 'node_modules/lightwell-three'), { recursive: true });
  for (const name of ['three', '@types/three']) symlinkSync(join(own, name), join(app, 'node_modules', name));
  writeFileSync(join(app, 'program.ts'), program);
  const options = ['--noEmit', '--strict', '--target', 'es2022', '--module', 'esnext', '--skipLibCheck'];
  const args = [...options, '--moduleResolution', 'bundler', 'program.ts'];
  try {
    execFileSync(process.execPath, [join(own, 'typescript/bin/tsc'), ...args], {
      cwd: app,
      encoding: 'utf8',
    });
  } catch (error) {
    assert.fail(error.stdout);
  }
});
