// lightwell-three: from attach() to dispose(): errors and states, the scene as it was, light for objects that
// only the client has. One server for all. With LW_LONG a hundred mounts instead of three, and a server that
// goes and comes back.
import assert from 'node:assert/strict';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { connect, createServer } from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import test, { after, before } from 'node:test';
import { setTimeout as pause } from 'node:timers/promises';

import { bin, hasDaemon, LIMIT_MS, startDaemon } from './daemon.mjs';
import { serveExample } from './example.mjs';
import { web } from './load.mjs';
import { compare, hasBrowser, pixelsOf, until } from './page.mjs';
import { room } from './room.mjs';
import { withPage } from './shared.mjs';

const WIDTH = 320;
const HEIGHT = 180;
const long = !!process.env.LW_LONG;
const MOUNTS = long ? 100 : 3;
const missing =
  !hasDaemon() || !existsSync(join(bin, 'compare_pictures'))
    ? 'there is no lightwelld in build/release/bin'
    : !hasBrowser() && 'there is no chromium';
const skip = { skip: missing || false };

let folder, daemon, site, address;

before(async () => {
  if (missing) return;
  folder = mkdtempSync(join(tmpdir(), 'lightwell-three-'));
  const scene = join(folder, 'scene.gltf');
  writeFileSync(scene, room());
  site = await serveExample(join(web, '../lightwell-three'), scene);
  const light = [
    '--light',
    'whole',
    '--client-lights',
    'lamps',
    '--texels-per-metre',
    '8',
    '--bounces',
    '4',
    '--error',
    '0.1',
    '--metrics',
    '127.0.0.1:0',
    '--metrics-port-file',
    join(folder, 'metrics.port'),
  ];
  daemon = await startDaemon(scene, ...light, '--http-origin', site.origin);
  address = `ws://${new URL(daemon.url).host}/ws`;
});

after(async () => {
  await daemon?.stop();
  site?.server.close();
  site?.server.closeAllConnections();
  if (folder) rmSync(folder, { recursive: true });
});

/** Until the daemon has all of its light: before, it may be off by more than tests allow. */
async function converged() {
  const port = readFileSync(join(folder, 'metrics.port'), 'utf8').trim();
  for (const end = Date.now() + LIMIT_MS; ; await pause(50)) {
    const text = await (await fetch(`http://127.0.0.1:${port}/metrics`)).text();
    const figure = (name) => Number(new RegExp(`^${name} (.*)$`, 'm').exec(text)?.[1]);
    const tiles = figure('lightwell_tiles');
    if (tiles && figure('lightwell_converged_tiles') === tiles) return;
    assert.ok(Date.now() < end, 'the light converges');
  }
}

/** A page with the globals of three_page.html. origin: where it comes from. */
function withThree(look, origin = site.origin) {
  const open = async (page) => {
    await page.goto(`${origin}/test.html`);
    await until(page, 'its modules', () => globalThis.load);
    return look(page);
  };
  return withPage({ width: WIDTH, height: HEIGHT }, open, { mayWarn: true });
}

/** A port that nobody listens at. */
async function closedPort() {
  const { server } = await serveExample('/', '/');
  const { port } = server.address();
  await new Promise((closed) => server.close(closed));
  const refused = await new Promise((is) =>
    connect(port, '127.0.0.1')
      .on('error', () => is(true))
      .on('connect', is),
  );
  assert.equal(refused, true);
  return port;
}

/** What attach() rejects with, in the page. */
const failure = async ([url, options]) => {
  const ending = new AbortController();
  const given = { ...options, signal: options.aborted ? AbortSignal.abort() : ending.signal };
  const states = [];
  const onState = (state, text) => {
    states.push(`${state}: ${text}`);
    if (options.onlyStates) ending.abort();
  };
  const scene = options.noScene ? {} : await load();
  return Lightwell.attach(scene, url, { ...given, onState }).then(
    () => 'no failure',
    ({ name, code, message }) => ({ name, code, message, states, workers }),
  );
};

async function checkArguments(page) {
  for (const [url, options, named] of [
    ['http://x/ws', {}, /^url: http:\/\/x\/ws: it is not ws:/],
    [address, { shadowMapSize: 0.5 }, /^shadowMapSize: 0.5/],
    [address, { timeoutMs: 0 }, /^timeoutMs: 0/],
    [address, { token: 'abc' }, /^token: /],
    [address, { noScene: true }, /^scene: it is not a THREE.Object3D/],
  ]) {
    const { name, code, message, workers } = await page.evaluate(failure, [url, options]);
    assert.equal(`${name} ${code} ${workers}`, 'LightwellError option 0');
    assert.match(message, named);
  }
  const aborted = await page.evaluate(failure, [address, { aborted: true }]);
  assert.equal(aborted.name, 'AbortError');
}

test('three: errors: arguments, a server that is down, one that forbids the page', skip, async () => {
  const down = `ws://127.0.0.1:${await closedPort()}/ws`;
  // one that takes connections and says nothing
  const mute = createServer((socket) => socket.unref());
  mute.unref(); // a test that fails must not wait for it
  await new Promise((listens) => mute.listen(0, '127.0.0.1', listens));
  const silent = `ws://127.0.0.1:${mute.address().port}/ws`;
  const look = async (page) => {
    const told = await page.evaluate(failure, [down, { timeoutMs: 100_000, onlyStates: true }]);
    assert.deepEqual([told.name, told.workers], ['AbortError', 0]);
    assert.deepEqual(told.states, [`connecting: ${down}: nothing answers there; trying again`]);
    const { code, message, workers } = await page.evaluate(failure, [down, { timeoutMs: 300 }]);
    assert.deepEqual([code, workers], ['timeout', 0]);
    assert.match(message, /: no answer in 0.3 s(: nothing answers there)?$/); // by then, on a busy machine
    const files = new URL('/nowhere/', page.url()).href;
    const lost = await page.evaluate(failure, [down, { assets: files }]);
    assert.deepEqual([lost.code, lost.workers], ['failed', 0]);
    assert.match(lost.message, /^worker.js: it does not load/);
    const unheard = await page.evaluate(failure, [silent, { timeoutMs: 300 }]);
    assert.deepEqual([unheard.code, unheard.workers, unheard.states], ['timeout', 0, []]);
    await checkArguments(page);
  };
  await withThree(look);
  mute.close();
  // by another name it is another origin, which --http-origin does not name
  const other = site.origin.replace('127.0.0.1', 'localhost');
  const forbidden = await withThree((page) => page.evaluate(failure, [address, {}]), other);
  assert.deepEqual([forbidden.code, forbidden.workers], ['forbidden', 0]);
  assert.match(
    forbidden.message,
    /the server forbids this page: Pages of that origin .* --http-origin ORIGIN/,
  );
  assert.deepEqual(forbidden.states, [`forbidden: ${forbidden.message}`]);
});

/** In the page: everything of a scene that attach() may change. */
const looks = () => {
  globalThis.describe = (scene) => {
    const nodes = [];
    scene.traverse((node) => {
      const { uuid, type, visible, castShadow, receiveShadow, matrixAutoUpdate, material, geometry } = node;
      nodes.push([
        uuid,
        type,
        visible,
        castShadow,
        receiveShadow,
        matrixAutoUpdate,
        [material].flat().map((each) => each && [each.uuid, each.lightMap?.uuid, each.side]),
        geometry?.uuid,
        node.matrix.toArray(),
        node.position.toArray(),
        node.children.map((child) => child.uuid),
        Object.hasOwn(node, 'onBeforeRender'),
      ]);
    });
    return JSON.stringify(nodes);
  };
};

test(`three: ${MOUNTS} mounts leave the scene as it was, and nothing behind`, skip, () =>
  withThree(async (page) => {
    await page.evaluate(looks);
    const abort = await page.evaluate(async (address) => {
      globalThis.scene = await load();
      const signal = AbortSignal.timeout(2 ** 30);
      const stop = new AbortController();
      const before = describe(scene);
      const onState = () => stop.abort(new Error('the test has seen enough'));
      const message = await Lightwell.attach(scene, address, {
        onState,
        signal: AbortSignal.any([signal, stop.signal]),
      }).then(
        () => 'light',
        (error) => error.message,
      );
      return { message, workers, same: describe(scene) === before };
    }, address);
    assert.deepEqual(abort, { message: 'the test has seen enough', workers: 0, same: true });

    const result = await page.evaluate(
      async ([address, mounts]) => {
        const added = new THREE.Mesh(new THREE.BoxGeometry(0.3, 0.3, 0.3), new THREE.MeshStandardMaterial());
        // a node of several primitives is a group, which this mesh is in, too
        // one like the file's own primitives but for its material, one but for its place
        const second = new THREE.Mesh(added.geometry, new THREE.MeshStandardMaterial({ name: 'wall' }));
        second.position.set(0.1, 0, 0);
        scene.getObjectByName('the_room').add(added, second);
        const own = new THREE.PointLight(0xffffff, 1);
        scene.add(own);
        scene.updateMatrixWorld(true);
        // by the app's own lights alone
        renderer.render(scene, camera);
        const before = describe(scene);
        const steps = [];
        const told = [];
        let during;
        for (let i = 0; i < mounts; i++) {
          const states = [];
          const began = performance.now();
          const light = await Lightwell.attach(scene, address, {
            onState: (state, text) => states.push(`${state} ${text}`),
          });
          const firstMs = performance.now() - began;
          if (!during) {
            const lamp = [];
            scene.traverse(
              (node) => node.isLight && node.visible && lamp.push(node === own ? 'own' : node.name),
            );
            const twice = [scene, scene.children[0]].map((each) =>
              Lightwell.attach(each, address).catch((error) => `${error.code}: ${error.message}`),
            );
            // as with each frame of the server's
            for (let k = 0; k < 2; k++) light.say('live');
            const stop = light.follow(added);
            added.position.set(0.05, 0.1, 0.1);
            during = {
              lamp: lamp.sort(),
              twice: await Promise.all(twice),
              isSame: before === describe(scene),
              state: light.state,
              stay: [added, second].map(({ visible, geometry }) => visible && geometry === added.geometry),
            };
            stop();
            light.follow(added);
            renderer.render(scene, camera);
            const { x } = new THREE.Vector3().setFromMatrixPosition(added.matrixWorld);
            during.movedTo = x;
            added.position.set(0, 0, 0);
            added.updateMatrix();
          }
          renderer.render(scene, camera);
          light.update(camera, innerHeight);
          renderer.render(scene, camera);
          light.dispose();
          light.dispose();
          renderer.render(scene, camera);
          const { geometries, textures } = renderer.info.memory;
          steps.push([geometries, textures, renderer.info.programs.length, workers].join(' '));
          told.push({ states, firstMs });
        }
        return { steps, told, during, same: describe(scene) === before };
      },
      [address, MOUNTS],
    );
    const { during, told } = result;
    assert.equal(result.same, true);
    assert.deepEqual(during.lamp, ['lamp', 'own']);
    assert.equal(during.state, 'live');
    assert.deepEqual(during.stay, [true, true]);
    assert.equal(during.isSame, false);
    assert.ok(Math.abs(during.movedTo - 4 * 0.05) < 1e-6, `it is at ${during.movedTo}`);
    const said = `attached: scene: it has light from ${address} already; dispose() that first`;
    assert.deepEqual(during.twice, [said, said]);
    // the first mount compiles programs, and draws what shadows want
    assert.equal(new Set(result.steps.slice(1)).size, 1, result.steps.join(', '));
    assert.match(result.steps[0], / 0$/);
    for (const { states } of told) {
      assert.equal(new Set(states).size, states.length, `each once: ${states}`);
      const names = states.map((each) => each.split(' ')[0]).filter((name, i, all) => name !== all[i - 1]);
      assert.deepEqual(
        names,
        names.includes('receiving') ? ['receiving', 'lighting', 'live'] : ['lighting', 'live'],
      );
    }
    const times = told.map(({ firstMs }) => firstMs).sort((a, b) => a - b);
    const [first, middle] = [told[0].firstMs, times[times.length >> 1]].map(Math.round);
    console.log(`${MOUNTS} mounts: ${result.steps.at(-1)} geometries, textures, programs, workers;`);
    console.log(
      `to the first light: ${first} ms at first, median ${middle} ms, longest ${Math.round(times.at(-1))} ms`,
    );
  }),
);

test('three: light for objects that only the client has', skip, async () => {
  await converged();
  await withThree(async (page) => {
    const result = await page.evaluate(async (address) => {
      const scene = await load();
      const light = await Lightwell.attach(scene, address, { keyLights: false });
      const vector = (...xyz) => new THREE.Vector3(...xyz);
      // until the tiles of the view are there
      const isCoarse = (placed) => placed.lightmap.level.some((level) => level > 2);
      while (light.queue.length || light.placed.some(isCoarse)) {
        light.update(camera, innerHeight);
        await new Promise(requestAnimationFrame);
      }
      // on surfaces, by rays and by the lightmap itself; walls are of this albedo
      const albedo = [0.7, 0.65, 0.6];
      const places = [
        [vector(0.9, 1e-3, 1.2), vector(0, 1, 0)],
        [vector(-1.2, 1e-3, 1.5), vector(0, 2, 0)],
        [vector(0, 1.5, 2.499), vector(0, 0, -1)],
        [vector(-0.5, 2.999, -1), vector(0, -1, 0)],
      ];
      const ratios = places.map(([point, normal]) => {
        const e = light.sample(point, normal).toArray();
        const out = new Float64Array(3);
        const n = normal.clone().normalize();
        light.gather.addRadiance(point.clone().addScaledVector(n, 0.2), n.clone().negate(), Math.PI, out);
        return e.map((value, k) => (value / out[k]) * albedo[k]);
      });
      const errors = [
        [vector(NaN, 0, 0), vector(0, 1, 0)],
        [vector(0, 1, 0), vector(0, 0, 0)],
      ].map((given) => {
        try {
          return light.sample(...given);
        } catch ({ code, message }) {
          return `${code} ${message}`;
        }
      });
      const began = performance.now();
      for (let i = 0; i < 10; i++) light.sample(...places[0]);
      const sampleMs = (performance.now() - began) / 10;

      // a probe against samples at its place
      const ball = new THREE.Mesh(
        new THREE.SphereGeometry(0.25, 24, 16),
        new THREE.MeshStandardMaterial({ color: 0xffffff, roughness: 1 }),
      );
      ball.position.set(0.3, 0.9, 0.5);
      scene.add(ball);
      scene.updateMatrixWorld(true);
      const picture = (by = renderer) => {
        by.render(scene, camera);
        return by.domElement.toDataURL();
      };
      ball.visible = false;
      const without = picture();
      ball.visible = true;
      const dark = picture();
      const material = ball.material;
      const stop = light.follow(ball);
      const { probe } = light.follower.followed.get(ball);
      const probes = [vector(0, 1, 0), vector(1, 0, 0), vector(0, 0, 1), vector(0, -1, 0)].map((normal) => {
        const from = probe.sh.getIrradianceAt(normal, vector()).x;
        return from / light.sample(ball.position, normal).r;
      });
      const lit = picture();
      ball.visible = false;
      const again = picture();
      ball.visible = true;
      const { WebGPURenderer } = await import('three/webgpu');
      const nodes = new WebGPURenderer({ antialias: true, forceWebGL: true });
      await nodes.init();
      nodes.setSize(innerWidth, innerHeight);
      nodes.toneMapping = renderer.toneMapping;
      nodes.toneMappingExposure = renderer.toneMappingExposure;
      const byNodes = picture(nodes);
      // a second one, in the shade of the shelf, with a probe of its own
      const other = ball.clone();
      other.material = material.clone();
      other.position.set(1.2, 0.3, -1.6);
      scene.add(other);
      other.updateMatrixWorld();
      const stopOther = light.follow(other);
      const [both, bothByNodes] = [picture(), picture(nodes)];
      stopOther();
      other.removeFromParent();
      stop();
      const isBack = ball.material === material;
      const stopped = picture();
      const wrong = [() => light.follow(scene.getObjectByName('box')), () => light.follow({})].map((call) => {
        try {
          return call();
        } catch ({ code, message }) {
          return `${code} ${message}`;
        }
      });
      light.dispose();
      const after = light.sample(...places[0]).toArray();
      return {
        ratios,
        errors,
        sampleMs,
        probes,
        isBack,
        wrong,
        after,
        pictures: { without, dark, lit, again, byNodes, both, bothByNodes, stopped },
      };
    }, address);
    console.log(`of the lightmap: ${result.ratios.map((each) => each.map((x) => x.toFixed(2))).join('; ')}`);
    const sampleMs = result.sampleMs.toFixed(2);
    console.log(`probe over sample: ${result.probes.map((x) => x.toFixed(2))}; ${sampleMs} ms a sample`);
    for (const ratio of result.ratios.flat()) assert.ok(Math.abs(ratio - 1) < 0.08, `${result.ratios}`);
    for (const ratio of result.probes) assert.ok(Math.abs(ratio - 1) < 0.2, `${result.probes}`);
    assert.deepEqual(result.errors, [
      'option sample: point or normal is not finite',
      'option sample: normal has no direction',
    ]);
    assert.deepEqual(result.wrong, [
      'option follow: the server lights "box" itself',
      'option follow: it is not a THREE.Object3D',
    ]);
    assert.deepEqual(result.after, [0, 0, 0]);
    assert.equal(result.isBack, true);
    const { without, dark, lit, again, byNodes, both, bothByNodes, stopped } = result.pictures;
    assert.equal(again, without, 'lightmapped surfaces do not see the probe');
    assert.equal(stopped, dark, 'follow() ends');
    const [a, b, c] = [await pixelsOf(page, lit), await pixelsOf(page, byNodes), await pixelsOf(page, dark)];
    const same = compare(WIDTH, HEIGHT, a, b);
    const other = compare(WIDTH, HEIGHT, a, c);
    console.log(`followed, by WebGPURenderer: FLIP ${same.flip}; not followed: FLIP ${other.flip}`);
    assert.ok(same.flip < 0.02, `FLIP ${same.flip}`);
    assert.ok(other.flip > 0.02, `FLIP ${other.flip}`);
    const [two, twoByNodes] = [await pixelsOf(page, both), await pixelsOf(page, bothByNodes)];
    const apart = two.reduce((sum, x, i) => sum + (Math.abs(x - twoByNodes[i]) > 12 ? 1 : 0), 0);
    console.log(`two followed: ${apart} values of ${two.length} are apart`);
    assert.ok(apart < 0.003 * two.length, `${apart} values are apart`);
  });
});

const goes = { skip: missing || (!long && 'LW_LONG is not set') };
test('three: a server that goes, comes back, and then wants a token', goes, () =>
  withThree(async (page) => {
    await page.evaluate(async (address) => {
      globalThis.states = [];
      const scene = await load();
      globalThis.light = await Lightwell.attach(scene, address, {
        onState: (state, text) => states.push([state, text]),
      });
      globalThis.maps = () => {
        let count = 0;
        scene.traverse((node) => [node.material].flat().forEach((each) => (count += each?.lightMap ? 1 : 0)));
        return count;
      };
    }, address);
    const { port } = new URL(daemon.url);
    const maps = await page.evaluate(() => maps());
    const last = () => page.evaluate(() => [...states.at(-1), maps(), light.state]);
    await daemon.stop();
    await until(page, 'that it is lost', () => light.state === 'lost');
    const [, text, kept] = await last();
    assert.match(text, /trying again$/);
    assert.equal(kept, maps, 'the light stays');
    const again = ['--http', `127.0.0.1:${port}`, '--http-origin', site.origin, '--client-lights', 'lamps'];
    daemon = await startDaemon(join(folder, 'scene.gltf'), ...again);
    await until(page, 'light again', () => light.state === 'live');
    await daemon.stop();
    await until(page, 'that it is lost again', () => light.state === 'lost');
    const tokens = join(folder, 'tokens');
    writeFileSync(tokens, `view ${'5'.repeat(64)}\n`, { mode: 0o600 });
    daemon = await startDaemon(join(folder, 'scene.gltf'), ...again, '--tokens', tokens);
    await until(page, 'that it is forbidden', () => light.state === 'forbidden');
    const [state, why, still] = await last();
    assert.deepEqual([state, why, still], ['forbidden', `${address}: the server wants a token`, maps]);
    assert.equal(await page.evaluate(() => (light.dispose(), workers + maps())), 0);
  }),
);
