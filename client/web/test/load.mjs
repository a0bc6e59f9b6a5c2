// load.mjs: the client's modules, and its own C, for tests in Node.js. LW_WEB names the folder that was
// built.
import { build } from 'esbuild';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

export const root = new URL('../../../', import.meta.url).pathname;
export const web = process.env.LW_WEB ?? join(root, 'build/release/web');

/** All exports of modules of src. */
export async function load(...names) {
  const folder = mkdtempSync(join(tmpdir(), 'lightwell-web-'));
  const file = join(folder, 'modules.mjs');
  const src = new URL('../src/', import.meta.url).pathname;
  await build({
    stdin: {
      contents: names.map((name) => `export * from './${name}.ts';`).join('\n'),
      resolveDir: src,
      loader: 'ts',
    },
    outfile: file,
    bundle: true,
    format: 'esm',
    platform: 'node',
    logLevel: 'warning',
  });
  try {
    return await import(file);
  } finally {
    rmSync(folder, { recursive: true });
  }
}

export function wasm() {
  return readFileSync(join(web, 'lightwell_tiles.wasm'));
}
