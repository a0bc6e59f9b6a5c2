// lightwell-three as people get it: packed, installed in an empty folder, imported and bundled from there.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import {
  existsSync,
  mkdtempSync,
  readdirSync,
  readFileSync,
  rmSync,
  symlinkSync,
  writeFileSync,
} from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test from 'node:test';
import { build } from 'esbuild';

import { web } from './load.mjs';

const folder = join(web, '../lightwell-three');
const modules = new URL('../node_modules/', import.meta.url).pathname;

test('lightwell-three is packed, installed and bundled', async () => {
  const work = mkdtempSync(join(tmpdir(), 'lightwell-packed-'));
  const npm = (...args) =>
    execFileSync('npm', [...args, '--offline', '--loglevel=error'], {
      cwd: work,
      encoding: 'utf8',
      timeout: 120000,
      env: { ...process.env, npm_config_cache: join(work, 'cache'), npm_config_update_notifier: 'false' },
    });
  try {
    npm('pack', folder);
    const archive = readdirSync(work).find((name) => name.endsWith('.tgz'));
    const { version, files } = JSON.parse(readFileSync(join(folder, 'package.json'), 'utf8'));
    assert.equal(archive, `lightwell-three-${version}.tgz`);
    writeFileSync(join(work, 'package.json'), '{ "private": true, "type": "module" }');
    // three itself is the page's own
    npm('install', `./${archive}`, '--legacy-peer-deps', '--no-audit', '--no-fund', '--ignore-scripts');
    const installed = join(work, 'node_modules/lightwell-three');
    for (const name of [...files, 'README.md', 'package.json'])
      assert.ok(existsSync(join(installed, name)), `${name} is not in the package`);
    symlinkSync(join(modules, 'three'), join(work, 'node_modules/three'));
    writeFileSync(
      join(work, 'page.js'),
      "import { Lightwell } from 'lightwell-three';\nglobalThis.light = Lightwell.attach;\n",
    );
    const made = await build({
      entryPoints: [join(work, 'page.js')],
      bundle: true,
      write: false,
      format: 'esm',
      external: ['three'],
      absWorkingDir: work,
      logLevel: 'silent',
    });
    assert.deepEqual(made.warnings, []);
    assert.match(made.outputFiles[0].text, /worker\.js/);
  } finally {
    rmSync(work, { recursive: true, force: true });
  }
});
