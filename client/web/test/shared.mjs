// shared.mjs: one browser for all tests of a file, from the first page to the last test's end.
import assert from 'node:assert/strict';
import { after } from 'node:test';

import { LIMIT_MS } from './daemon.mjs';
import { brokenShader, openBrowser, readsCanvas } from './page.mjs';

/** WebGPU by SwiftShader: arguments of withPage(). */
export const WEBGPU = [
  '--enable-unsafe-webgpu',
  '--use-webgpu-adapter=swiftshader',
  '--enable-features=Vulkan',
  '--use-vulkan=swiftshader',
];

let browser = null;

/** In the page, before all else: it warns where it waits for the GPU to give it pixels. The graphics driver
 * says so, too, but of the browser's own reading as well. */
function watchReading() {
  const { readPixels } = WebGL2RenderingContext.prototype;
  WebGL2RenderingContext.prototype.readPixels = function (...given) {
    if (typeof given[6] !== 'number') console.warn('readPixels() into memory waits for the GPU');
    return readPixels.apply(this, given);
  };
}

after(async () => (await browser)?.close());

/** A page of its own context. look(page, context): what to do with it. It ends when the page
 * throws something, or has a shader that does not compile.
 * Nor shall the page warn of anything, unless mayWarn. args: of the browser, by the first page. more: of the
 * context. */
export async function withPage(viewport, look, { mayWarn = false, args = [], ...more } = {}) {
  browser ??= openBrowser(...args);
  const context = await (await browser).newContext({ viewport, ...more });
  context.setDefaultTimeout(LIMIT_MS);
  context.setDefaultNavigationTimeout(LIMIT_MS);
  const warnings = [];
  context.on('console', (message) => {
    if (message.type() !== 'warning' || mayWarn) return;
    if (readsCanvas && /GPU stall due to ReadPixels/.test(message.text())) return;
    warnings.push(message.text());
  });
  if (!mayWarn) await context.addInitScript(watchReading);
  const threw = new Promise((_, reject) => {
    context.on('weberror', (error) => reject(new Error(`the page threw ${error.error().stack}`)));
  });
  const looked = context.newPage().then((page) => look(page, context));
  try {
    const result = await Promise.race([looked, threw, brokenShader(context)]);
    assert.deepEqual(warnings, []);
    return result;
  } finally {
    for (const promise of [looked, threw]) promise.catch(() => {});
    await context.close();
  }
}
