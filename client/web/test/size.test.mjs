// All that a browser loads, gzipped, stays small.
import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';
import { gzipSync } from 'node:zlib';

import { web } from './load.mjs';

test('the client is at most 80 kB', () => {
  const sizes = readdirSync(web).map((name) => [
    name,
    gzipSync(readFileSync(join(web, name)), { level: 9 }).length,
  ]);
  assert.ok(sizes.some(([name]) => name === 'worker.js'));
  const all = sizes.reduce((sum, [, size]) => sum + size, 0);
  assert.ok(all <= 80000, `${all} bytes: ${sizes.map((each) => each.join(' ')).join(', ')}`);
});
