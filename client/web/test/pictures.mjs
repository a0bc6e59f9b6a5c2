// pictures.mjs: the page's picture of a scene against the CPU's, of the same light from the same camera.
import assert from 'node:assert/strict';
import { isAbsolute, join } from 'node:path';

import { LIMIT_MS, startDaemon } from './daemon.mjs';
import { compare, pictureName, pixels, reference, savePicture, until } from './page.mjs';
import { withPage } from './shared.mjs';

export const WIDTH = 240;
export const HEIGHT = 135;
const SURVEYS = 11; // each finds tiles through other places of the pixels
const limitsOf = { tiles: { difference: 2, flip: 0.03 }, auto: { difference: 4, flip: 0.06 } };

/** Where a scene is: a builtin one, or a file of $LW_TEST_SCENES. */
export function scenePath(given) {
  const [scene] = given.split('@');
  if (scene.startsWith('builtin:') || isAbsolute(scene)) return scene;
  return join(process.env.LW_TEST_SCENES ?? '', scene);
}

/** A lightwelld whose light stands still between the frames that the test asks for. */
export function startStill(path, ...options) {
  const still = ['--clock', 'manual', '--light', 'whole', '--freeze', '0', '--codec', 'half'];
  return startDaemon(path, ...still, ...options);
}

async function untilLit(page, frame, limitMs) {
  const surveys = SURVEYS + (await page.evaluate(() => lightwell.stats.surveys));
  await until(
    page,
    'all tiles of the view',
    ([frame, surveys]) => {
      const { stats } = lightwell;
      const lit = stats.frame >= frame && stats.settled === stats.frames;
      return lit && stats.surveys > surveys && stats.missing === 0;
    },
    { given: [frame, surveys], limitMs },
  );
}

async function compareView(page, daemon, scene, { direct, camera, exposure, what }) {
  const web = await pixels(page);
  const options = ['--direct', direct, '--camera', camera, '--exposure', exposure, '--renderer', 'cpu'];
  const keepAs = pictureName(scene, `${what}-cpu`);
  const cpu = await reference(page, daemon, `${WIDTH}x${HEIGHT}`, options, keepAs);
  await savePicture(page, pictureName(scene, `${what}-web`));
  const { difference, flip } = compare(WIDTH, HEIGHT, cpu, web);
  console.log(`${scene}, ${what}: mean difference ${difference}/255, FLIP ${flip}`);
  const limits = limitsOf[direct];
  assert.ok(difference <= limits.difference, `${what}: mean difference ${difference}/255`);
  assert.ok(flip <= limits.flip, `${what}: FLIP ${flip}`);
}

/** The page's pictures against the CPU's, of a daemon's light.
 * direct: tiles: all light is in tiles; auto: the lights that clients may draw are, as shadow maps against
 * shadow rays
 * cameras: one picture each, '': where the page stands by itself */
export async function comparePictures(daemon, scene, { direct, exposure, cameras }, limitMs = LIMIT_MS) {
  await withPage({ width: WIDTH, height: HEIGHT }, async (page) => {
    const parameters = `exposure=${exposure}&direct=${direct === 'tiles' ? 'tiles' : 'pixels'}`;
    await page.goto(`${daemon.url}?${parameters}`);
    // light in the form that the page takes begins with the frame after it has joined
    await until(page, 'the scene', () => lightwell.stats.sceneMs > 0, { limitMs });
    const frame = daemon.frames(8);
    await until(page, 'a view', () => lightwell.stats.pictures > 0, { limitMs });
    for (const [i, camera] of cameras.entries()) {
      if (camera) await page.evaluate((view) => lightwell.go(view), camera);
      await untilLit(page, frame, limitMs);
      const view = camera || (await page.evaluate(() => lightwell.view()));
      const what = cameras.length > 1 ? `${direct}-${i + 1}` : direct;
      await compareView(page, daemon, scene, { direct, camera: view, exposure, what });
    }
    const lamps = await page.evaluate(() => lightwell.lightsDrawn().lights);
    assert.equal(lamps > 0, direct !== 'tiles');
  });
}
