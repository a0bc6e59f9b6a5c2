// ways_in.mjs: a picture of the page, or of lightwell-three's example, as a person sees it. For
// tests/bench/ways_in.sh:
//     node ways_in.mjs page URL OUT.png          the page of a lightwelld
//     node ways_in.mjs three PACKAGE OUT.png     an installed lightwell-three's example.html, in a room
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

import { startDaemon } from './daemon.mjs';
import { serveExample } from './example.mjs';
import { openBrowser, until } from './page.mjs';
import { room } from './room.mjs';

const [what, from, out] = process.argv.slice(2);
const viewport = { width: 640, height: 360 };

async function picture(look) {
  const browser = await openBrowser();
  try {
    const page = await browser.newPage({ viewport });
    page.on('pageerror', (error) => console.error(error.stack));
    await look(page);
    await page.screenshot({ path: out, timeout: 120000 });
  } finally {
    await browser.close();
  }
}

async function three() {
  const folder = mkdtempSync(join(tmpdir(), 'lightwell-ways-'));
  const scene = join(folder, 'scene.gltf');
  writeFileSync(scene, room({ outside: true }));
  const { origin, server } = await serveExample(from, scene);
  const daemon = await startDaemon(scene, '--client-lights', 'lamps', '--http-origin', origin);
  try {
    await picture(async (page) => {
      const address = `ws://${new URL(daemon.url).host}/ws`;
      const view = 'from=1.5,1.7,2.2&to=-0.2,1,-1&fov=60&exposure=1';
      await page.goto(`${origin}/example.html?scene=scene.gltf&server=${address}&${view}`);
      await page.waitForFunction(() => globalThis.example?.pictures > 3, null, { timeout: 120000 });
      await page.waitForTimeout(10000);
    });
  } finally {
    await daemon.stop();
    server.close();
    server.closeAllConnections();
    rmSync(folder, { recursive: true });
  }
}

if (what === 'three') await three();
else
  await picture(async (page) => {
    await page.goto(from);
    await until(page, 'light', () => globalThis.lightwell?.stats.tiles > 0);
    await page.waitForTimeout(10000);
  });
