// shared.mjs: one browser for all tests of a file: it starts with the first page, and ends after the last test.
import assert from 'node:assert/strict';
import { after } from 'node:test';

import { LIMIT_MS } from './daemon.mjs';
import { openBrowser } from './page.mjs';

let browser = null;
after(async () => (await browser)?.close());

/** A page of its own context. look(page, context): what to do with it. It shall throw nothing, nor warn of
 * anything unless mayWarn. more: of the context. */
export async function withPage(viewport, look, { mayWarn = false, args = [], ...more } = {}) {
  browser ??= openBrowser(...args);
  const context = await (await browser).newContext({ viewport, ...more });
  context.setDefaultTimeout(LIMIT_MS);
  context.setDefaultNavigationTimeout(LIMIT_MS);
  const thrown = [];
  context.on('weberror', (error) => thrown.push(error.error().stack));
  context.on('console', (message) => {
    if (message.type() === 'warning' && !mayWarn) thrown.push(message.text());
  });
  try {
    const result = await look(await context.newPage(), context);
    assert.deepEqual(thrown, []);
    return result;
  } finally {
    await context.close();
  }
}
