// build.mjs OUT: bundles the browser client into a folder: index.html, lightwell.css, lightwell.js,
// worker.js, zstd.wasm; and the npm package lightwell-three into a folder beside it.
import { build } from 'esbuild';
import { copyFileSync, existsSync, mkdirSync, readFileSync, writeFileSync } from 'node:fs';

const out = process.argv[2];
if (!out) {
  console.error('usage: node build.mjs OUT');
  process.exit(64);
}
mkdirSync(out, { recursive: true });
const here = (path) => new URL(path, import.meta.url).pathname;
// zstddec brings its WebAssembly as text, a third more bytes than a file of its own
const zstdApart = {
  name: 'zstd-apart',
  setup({ onLoad }) {
    onLoad({ filter: /zstddec\.mjs$/ }, ({ path }) => {
      const source = readFileSync(path, 'utf8');
      const contents = source
        .replace(/const wasm = "([^"]+)"/, (_, text) => {
          writeFileSync(`${out}/zstd.wasm`, Buffer.from(text, 'base64'));
          return '';
        })
        .replace('`data:application/wasm;base64,${wasm}`', '"zstd.wasm"');
      if (!contents.includes('fetch("zstd.wasm")') || !existsSync(`${out}/zstd.wasm`))
        throw new Error('zstddec is not as build.mjs knows it');
      return { contents, loader: 'js' };
    });
  },
};
// shaders are text that no bundler shortens: without comments and needless blanks the page is 0.9 kB smaller
const plainShaders = {
  name: 'plain-shaders',
  setup({ onLoad }) {
    onLoad({ filter: /shaders\.ts$/ }, ({ path }) => ({
      contents: readFileSync(path, 'utf8')
        .replace(/^\s*\/\/.*\n/gm, '')
        .replace(/^ +/gm, '')
        .replace(/ ([-+*/=<>?:&|]+|[<>=!]=) /g, '$1'),
      loader: 'ts',
    }));
  },
};
await build({
  plugins: [zstdApart, plainShaders],
  entryPoints: { lightwell: here('src/main.ts'), worker: here('src/worker.ts') },
  outdir: out,
  bundle: true,
  minify: true,
  format: 'esm',
  target: ['es2022'],
  legalComments: 'none',
  logLevel: 'warning',
});
for (const name of ['index.html', 'lightwell.css']) copyFileSync(here(`src/${name}`), `${out}/${name}`);

// for pages with three.js, beside it
const three = `${out}/../lightwell-three`;
mkdirSync(three, { recursive: true });
await build({
  entryPoints: [here('three/lightwell.ts')],
  outdir: three,
  bundle: true,
  minify: true,
  format: 'esm',
  target: ['es2022'],
  external: ['three'],
  logLevel: 'warning',
});
for (const name of ['package.json', 'README.md', 'lightwell.d.ts', 'example.html'])
  copyFileSync(here(`three/${name}`), `${three}/${name}`);
for (const name of ['worker.js', 'zstd.wasm']) copyFileSync(`${out}/${name}`, `${three}/${name}`);
