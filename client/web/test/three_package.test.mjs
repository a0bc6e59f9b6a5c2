// lightwell-three as npm packs it, and in the bundler that most use. Vite leaves three apart here, which is
// most of what it would bundle; web_three_bundlers has it whole.
import assert from 'node:assert/strict';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test, { after } from 'node:test';

import { open, pack } from './bundlers.mjs';
import { hasDaemon } from './daemon.mjs';
import { root } from './load.mjs';
import { hasBrowser } from './page.mjs';

const missing = !hasDaemon()
  ? 'there is no lightwelld in build/release/bin'
  : !hasBrowser() && 'there is no chromium';
const folder = mkdtempSync(join(tmpdir(), 'lightwell-package-'));
after(() => rmSync(folder, { recursive: true }));

test('three: the npm package has all that it names, and the version of lightwell', () => {
  const files = pack(folder);
  const { exports, version, types, main, license } = JSON.parse(
    readFileSync(join(folder, 'package/package.json')),
  );
  const named = [
    ...Object.values(exports).flatMap((each) => (each.types ? Object.values(each) : each)),
    types,
    main,
  ];
  for (const name of [...named, './LICENSE', './NOTICE', './README.md'])
    assert.ok(files.includes(name.slice(2)), `${name} is not among ${files}`);
  assert.equal(license, 'Apache-2.0');
  const [, ours] = /project\(lightwell VERSION (\S+)/.exec(
    readFileSync(join(root, 'CMakeLists.txt'), 'utf8'),
  );
  assert.equal(version, ours);
});

test('three: the example for Vite, built, is lit', { skip: missing || false }, async () => {
  const { frame } = await open(folder, 'Vite 6, build', { example: 'vite', threeApart: true });
  assert.ok(frame > 0);
});
