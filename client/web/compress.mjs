// compress.mjs FILE...: writes FILE.br and FILE.gz, which lightwelld sends to browsers that take them. zlib's
// gzip would be 4 % larger than zopfli's.
import { readFileSync, writeFileSync } from 'node:fs';
import { brotliCompressSync, constants } from 'node:zlib';
import { gzipAsync } from '@gfx/zopfli';

const files = process.argv.slice(2);
if (!files.length) {
  console.error('usage: node compress.mjs FILE...');
  process.exit(64);
}
for (const file of files) {
  const bytes = readFileSync(file);
  const params = {
    [constants.BROTLI_PARAM_QUALITY]: constants.BROTLI_MAX_QUALITY,
    [constants.BROTLI_PARAM_LGWIN]: constants.BROTLI_MAX_WINDOW_BITS,
    [constants.BROTLI_PARAM_SIZE_HINT]: bytes.length,
  };
  writeFileSync(`${file}.br`, brotliCompressSync(bytes, { params }));
  writeFileSync(`${file}.gz`, await gzipAsync(bytes, {}));
}
