// pictures.mjs: the page's picture of a scene against the CPU's, of the same light from the same camera.
import assert from 'node:assert/strict';
import { isAbsolute, join } from 'node:path';

import { startDaemon } from './daemon.mjs';
import { compare, openBrowser, pictureName, pixels, reference, savePicture, until } from './page.mjs';

export const WIDTH = 480;
export const HEIGHT = 270;
const limitsOf = { tiles: { difference: 2, flip: 0.03 }, auto: { difference: 4, flip: 0.06 } };

/** Where a scene is: a builtin one, or a file of $LW_TEST_SCENES. */
export function scenePath(given) {
  const [scene] = given.split('@');
  if (scene.startsWith('builtin:') || isAbsolute(scene)) return scene;
  return join(process.env.LW_TEST_SCENES ?? '', scene);
}

/** The page's picture against the CPU's.
 * given: SCENE@CAMERA@STOPS
 * direct: tiles: all light is in tiles; auto: the lights that clients may draw are, as shadow maps against
 * shadow rays */
export async function comparePictures(given, direct, limitMs) {
  const [scene, camera = '', exposure = '0'] = given.split('@');
  const path = scenePath(given);
  const limits = limitsOf[direct];
  const light = ['--clock', 'manual', '--light', 'whole', '--freeze', '0', '--codec', 'half'];
  const daemon = await startDaemon(path, ...light);
  const browser = await openBrowser();
  try {
    const page = await browser.newPage({ viewport: { width: WIDTH, height: HEIGHT } });
    const thrown = [];
    page.on('pageerror', (error) => thrown.push(error.stack));
    page.on('console', (message) => message.type() === 'warning' && thrown.push(message.text()));
    const parameters = `exposure=${exposure}${camera ? `&camera=${camera}` : ''}`;
    await page.goto(`${daemon.url}?${parameters}${direct === 'tiles' ? '&direct=tiles' : ''}`);
    // light in the form that the page takes begins with the frame after it has joined
    await until(page, 'the scene', () => lightwell.stats.sceneMs > 0, limitMs);
    daemon.frames(8);
    await until(
      page,
      'all tiles of the view',
      () =>
        lightwell.stats.surveys > 11 &&
        lightwell.stats.missing === 0 &&
        lightwell.stats.frame >= 8 &&
        lightwell.stats.settled === lightwell.stats.frames,
      limitMs,
    );
    const web = await pixels(page);
    const view = await page.evaluate(() => lightwell.view());
    const options = ['--direct', direct, '--camera', camera || view, '--exposure', exposure];
    const cpu = await reference(
      page,
      daemon,
      `${WIDTH}x${HEIGHT}`,
      [...options, '--renderer', 'cpu'],
      pictureName(scene, `${direct}-cpu`),
    );
    await savePicture(page, pictureName(scene, `${direct}-web`));
    const { difference, flip } = compare(WIDTH, HEIGHT, cpu, web);
    const lamps = await page.evaluate(() => lightwell.lightsDrawn().lights);
    console.log(`${scene}, ${direct}, ${lamps} drawn: mean difference ${difference}/255, FLIP ${flip}`);
    assert.equal(lamps > 0, direct !== 'tiles');
    assert.ok(difference <= limits.difference, `mean difference ${difference}/255`);
    assert.ok(flip <= limits.flip, `FLIP ${flip}`);
    assert.deepEqual(thrown, []);
  } finally {
    await browser.close();
    await daemon.stop();
  }
}
