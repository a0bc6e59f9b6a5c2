// frames.mjs: how long the frames of a page take, and when it is lit. Chromium without a GPU (SwiftShader).
//     node test/frames.mjs URL [WIDTHxHEIGHT] [SECONDS] [OUT.png]
// URL: the page of a lightwelld that is lit. A frame is the time between two calls of
// requestAnimationFrame(); times are from the navigation on, in seconds. It judges nothing.
import { openBrowser, until } from './page.mjs';

const [url, size = '1280x720', seconds = '20', out = ''] = process.argv.slice(2);
if (!url) {
  console.error('usage: node test/frames.mjs URL [WIDTHxHEIGHT] [SECONDS] [OUT.png]');
  process.exit(64);
}
const [width, height] = size.split('x').map(Number);

function watch() {
  const frames = [];
  globalThis.frames = frames;
  let last = performance.now();
  const step = () => {
    const now = performance.now();
    frames.push(now - last);
    last = now;
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

const browser = await openBrowser();
try {
  const page = await browser.newPage({ viewport: { width, height } });
  page.on('pageerror', (error) => console.error(error.stack));
  await page.addInitScript(watch);
  await page.goto(url);
  // all tiles of the view are there, and a picture of them
  const lit = () => {
    const { firstMs, surveys, missing } = lightwell.stats;
    return firstMs > 0 && surveys > 0 && missing === 0;
  };
  await until(page, 'all light of the view', lit);
  const litMs = await page.evaluate(() => performance.now());
  await page.waitForFunction((ms) => performance.now() > ms, 1000 * Number(seconds));
  const { frames, stats, legend } = await page.evaluate(() => ({
    frames: globalThis.frames,
    stats: lightwell.stats,
    legend: document.getElementById('legend').textContent,
  }));
  const s = (ms) => (ms / 1000).toFixed(1);
  frames.sort((a, b) => a - b);
  console.log(
    `scene ${s(stats.sceneMs)} s, first light ${s(stats.firstMs)} s, all of the view's ${s(litMs)} s; ` +
      `${frames.length} frames in ${seconds} s, median ${s(frames[frames.length >> 1])} s, ` +
      `longest ${s(frames.at(-1))} s; ${legend}`,
  );
  if (out) await page.screenshot({ path: out });
} finally {
  await browser.close();
}
