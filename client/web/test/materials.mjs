// materials.mjs: materials side by side: what clients show of a scene with gloss and normal maps, and paths.
//     node client/web/test/materials.mjs FOLDER [atrium|chair|sponza]...
// FOLDER/materials_NAME.jpg has, of one view and exposure: matt (--materials matt) and with materials by
// lightwell-view's rays; our path tracer; by OpenGL; the page; lightwell-three's example; Blender's Cycles. A
// table on stdout compares them: against our paths (bench_compare, linear light), and FLIP of what is shown
// against the rays'. FOLDER keeps the parts, and what is there is not rendered again. Pictures of servers
// have FRAMES frames of light, 48 unless set.
// Scenes of files are below LW_TEST_SCENES. Wants Chromium; without blender its column is left out.
import { execFileSync } from 'node:child_process';
import { existsSync, mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { join, resolve } from 'node:path';

import { bin, startDaemon } from './daemon.mjs';
import { hookExample, serveExample, untilExampleIsLit } from './example.mjs';
import { root, web } from './load.mjs';
import { compare, drawNothing, openBrowser, pixelsOf, savePicture, until } from './page.mjs';

const WIDTH = 320;
const HEIGHT = 180;
const size = `${WIDTH}x${HEIGHT}`;
const FRAMES = Number(process.env.FRAMES ?? 48);
const PATHS = '128';
const SURVEYS = 7; // each finds tiles through other places of the pixels
const LIMIT_MS = 1800000;

// sky: W/(m^2 sr); stops: exposure; emitters: clients draw the light of emissive meshes, but three does not
const scenes = {
  atrium: { camera: '-11.2,1.75,1.5:0,2.6,0.1:58', sky: '2.1,3.1,4.6', stops: -4, emitters: true },
  chair: {
    file: 'mixed-lighting/MixedLightingExample.gltf',
    camera: '0.9,0.6,0.9:0,0.3,0:40',
    sky: '500,500,500',
    stops: -9.5,
  },
  sponza: {
    file: 'sponza/Sponza_lit.gltf',
    camera: '-8,1.8,-0.3:5,4,-0.3:75',
    sky: '0,0,0',
    stops: -6,
  },
};
const columns = {
  matt: '--materials matt',
  rays: 'lightwell-view',
  paths: `--path-trace, ${PATHS} paths a pixel`,
  gl: '--renderer gl',
  page: 'the page',
  three: 'lightwell-three',
  cycles: `Cycles, ${PATHS} paths a pixel`,
};

const [given, ...asked] = process.argv.slice(2);
if (!given || asked.some((name) => !scenes[name])) {
  console.error('usage: node materials.mjs FOLDER [atrium|chair|sponza]...');
  process.exit(64);
}
const folder = resolve(given);
mkdirSync(folder, { recursive: true });
const run = (program, ...options) =>
  execFileSync(program, options, { encoding: 'utf8', stdio: ['ignore', 'pipe', 'pipe'] });

/** Runs make(file) unless there is that file. */
async function once(file, make) {
  if (!existsSync(file)) await make(file);
  return file;
}

/** The atrium as a file, so that all columns read the same. */
const bakeAtrium = () =>
  once(join(folder, 'atrium.glb'), (glb) => {
    const options = ['--samples', '1', '--gltf-lights', '--gltf-out', glb, '-o', join(folder, 'atrium-maps')];
    run(join(bin, 'lightwell-bake'), 'builtin:atrium', ...options);
  });

class Row {
  constructor(name, path, browser) {
    Object.assign(this, { name, path, browser }, scenes[name]);
  }

  part(column, ending = 'png') {
    return join(folder, `${this.name}-${column}.${ending}`);
  }

  /** Linear light by lightwell-view, of a server's or by paths. */
  view(file, ...options) {
    const view = ['--camera', this.camera, '--size', size, '--out', file];
    run(join(bin, 'lightwell-view'), ...options, ...view);
  }

  headless(column, daemon, renderer) {
    const options = ['--headless', '--wait', 'complete', '--timeout', '1800', '--renderer', renderer,
      '--mirrors', 'off'];
    this.view(this.part(column, 'exr'), `127.0.0.1:${daemon.port}`, ...options);
  }

  async withPage(url, prepare, look) {
    const page = await this.browser.newPage({ viewport: { width: WIDTH, height: HEIGHT } });
    page.setDefaultTimeout(LIMIT_MS);
    page.on('pageerror', (error) => console.error(error.stack));
    if (prepare) await page.addInitScript(prepare);
    await page.goto(url);
    try {
      return await look(page);
    } finally {
      await page.close();
    }
  }

  /** The page asks for light, and gets all frames of it. finishes: it waits for them and for all tiles. */
  lightPage(daemon, finishes, look) {
    const url = `${daemon.url}?exposure=${this.stops}&direct=pixels&camera=${this.camera}`;
    return this.withPage(url, null, async (page) => {
      await until(page, 'the scene', () => lightwell.stats.sceneMs > 0, { limitMs: LIMIT_MS });
      await page.evaluate(drawNothing);
      daemon.frames(1); // then it says what it sees
      await until(page, 'a look', () => lightwell.stats.surveys > 1, { limitMs: LIMIT_MS });
      const frame = daemon.frames(FRAMES);
      const isLit = ([frame, surveys, finishes]) => {
        const { stats } = lightwell;
        if (!finishes) return stats.frame >= frame;
        const lit = stats.frame >= frame && stats.settled === stats.frames && stats.finishes >= finishes;
        return lit && stats.surveys > surveys && stats.missing === 0;
      };
      await until(page, 'its light', isLit, { given: [frame, SURVEYS, finishes], limitMs: LIMIT_MS });
      await look(page);
    });
  }

  async threePage(daemon, origin, frames) {
    const [from, to, fov] = this.camera.split(':');
    const view = `from=${from}&to=${to}&fov=${fov}&exposure=${this.stops}`;
    const address = `ws://${new URL(daemon.url).host}/ws`;
    const url = `${origin}/example.html?scene=scene.gltf&server=${address}&${view}`;
    await this.withPage(url, hookExample, async (page) => {
      await until(page, 'the scene', () => heard.scene, { limitMs: LIMIT_MS });
      daemon.frames(1); // a session of a kind of its own gets its light with the next frame
      await untilExampleIsLit(page, daemon, frames);
      const picture = await page.evaluate(shownByReinhard, this.sky.split(',').map(Number));
      writeFileSync(this.part('three'), Buffer.from(picture.slice(picture.indexOf(',') + 1), 'base64'));
    });
  }

  async serve(options, look) {
    const { origin, server } = await serveExample(join(web, '../lightwell-three'), this.path);
    const light = ['--clock', 'manual', '--freeze', '0', '--sky', this.sky];
    const daemon = await startDaemon(this.path, ...light, '--http-origin', origin, ...options);
    try {
      await look(daemon, origin);
    } finally {
      await daemon.stop();
      server.close();
      server.closeAllConnections();
    }
  }

  async render() {
    await once(this.part('matt', 'exr'), () =>
      this.serve(['--materials', 'matt'], (daemon) =>
        this.lightPage(daemon, 0, () => this.headless('matt', daemon, 'cpu')),
      ),
    );
    await once(this.part('gl', 'exr'), () =>
      this.serve([], async (daemon, origin) => {
        await this.lightPage(daemon, 1, async (page) => {
          await savePicture(page, this.part('page'));
          this.headless('rays', daemon, 'cpu');
          this.headless('gl', daemon, 'gl');
        });
        if (!this.emitters) await this.threePage(daemon, origin, 1);
      }),
    );
    await once(this.part('three'), () =>
      this.serve(['--client-lights', 'lamps'], (daemon, origin) => this.threePage(daemon, origin, FRAMES)),
    );
    await once(this.part('paths', 'exr'), (file) =>
      this.view(file, '--path-trace', this.path, '--sky', this.sky, '--spp', PATHS, '--bounces', '2'),
    );
    if (existsSync('/usr/bin/blender'))
      await once(this.part('cycles', 'exr'), (file) => {
        const script = join(root, 'tests/bench/cycles.py');
        const view = [`--camera=${this.camera}`, '--size', size, '--spp', PATHS, '--bounces', '2'];
        const blender = ['--background', '--factory-startup', '--python', script, '--', this.path];
        run('blender', ...blender, ...view, '--sky', this.sky, '--out', file);
      });
  }

  /** Against paths: ratio of means, FLIP, blocks within 5 % and 10 %; and the picture as it is shown. */
  againstPaths(column) {
    const [picture, paths] = [this.part(column, 'exr'), this.part('paths', 'exr')];
    if (!existsSync(picture)) return ['', '', ''];
    const shown = [this.part(column), `${this.stops}`];
    const said = run(join(bin, 'bench_compare'), picture, paths, ...shown);
    const [, ratio, flip, near, nearby] =
      /means ([^,]*), .*FLIP ([^,]*), (\d+) of .*, (\d+) within 10/.exec(said);
    return [Number(ratio).toFixed(3), Number(flip).toFixed(3), `${near}, ${nearby}`];
  }

  async report() {
    const there = Object.keys(columns).filter((column) =>
      ['exr', 'png'].some((ending) => existsSync(this.part(column, ending))),
    );
    const measured = there.map((column) => this.againstPaths(column));
    const url = (column) => `data:image/png;base64,${readFileSync(this.part(column)).toString('base64')}`;
    const figures = there.map(
      (column) => `<figure><img src="${url(column)}"><figcaption>${columns[column]}</figcaption></figure>`,
    );
    const page = await this.browser.newPage({ viewport: { width: 3 * WIDTH + 8, height: HEIGHT } });
    await page.setContent(
      `<style>body { margin: 0; display: grid; grid-template-columns: repeat(3, ${WIDTH}px); gap: 4px }
        figure { margin: 0 } img { display: block } figcaption { font: 13px sans-serif }</style>` +
        figures.join(''),
    );
    const sheet = join(folder, `materials_${this.name}.jpg`);
    await page.screenshot({ path: sheet, fullPage: true, type: 'jpeg', quality: 82 });
    const pixels = [];
    for (const column of there) pixels.push(await pixelsOf(page, url(column)));
    await page.close();
    const rays = pixels[there.indexOf('rays')];
    for (const [i, column] of there.entries()) {
      const { flip } = compare(WIDTH, HEIGHT, rays, pixels[i]);
      const cells = [this.name, column, column === 'rays' ? '' : flip.toFixed(3), ...measured[i]];
      console.log(`| ${cells.join(' | ')} |`);
    }
    console.error(`${sheet}: ${readFileSync(sheet).length} bytes`);
  }
}

/** In the page of the example: its picture with the curve of lightwell-view and of the page, for three's
 * Reinhard is another. sky: what a page sets as the colour behind its scene. */
async function shownByReinhard(sky) {
  const { Color, CustomToneMapping, ShaderChunk } = await import('three');
  const { scene, camera, renderer } = example;
  const chunk = ShaderChunk.tonemapping_pars_fragment;
  const plain = 'vec3 CustomToneMapping( vec3 color ) { return color; }';
  if (!chunk.includes(plain)) throw new Error('three has another CustomToneMapping()');
  const luminance = 'dot( color, vec3( 0.2126, 0.7152, 0.0722 ) )';
  const reinhard = `color *= toneMappingExposure; return saturate( color / ( 1.0 + ${luminance} ) );`;
  ShaderChunk.tonemapping_pars_fragment = chunk.replace(plain, plain.replace('return color;', reinhard));
  renderer.toneMapping = CustomToneMapping;
  const exposed = sky.map((x) => x * renderer.toneMappingExposure);
  const scale = 1 / (1 + 0.2126 * exposed[0] + 0.7152 * exposed[1] + 0.0722 * exposed[2]);
  renderer.setClearColor(new Color(...exposed.map((x) => Math.min(1, x * scale)))); // shown as it is
  renderer.render(scene, camera);
  return renderer.domElement.toDataURL();
}

const browser = await openBrowser();
try {
  const names = asked.length ? asked : Object.keys(scenes);
  console.log('| scene | picture | FLIP to rays | of paths: ratio of means | FLIP | blocks within 5, 10 % |');
  console.log('|---|---|---|---|---|---|');
  for (const name of names) {
    const { file } = scenes[name];
    const path = file ? join(process.env.LW_TEST_SCENES ?? '', file) : await bakeAtrium();
    if (!existsSync(path)) {
      console.error(`${path}: left out, there is no such file`);
      continue;
    }
    const row = new Row(name, path, browser);
    await row.render();
    await row.report();
  }
} finally {
  await browser.close();
}
