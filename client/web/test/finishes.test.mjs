// What is smooth or uneven: tangents and textures on their way to the GPU, and the shading function on it,
// given all that a file may say.
import assert from 'node:assert/strict';
import test from 'node:test';

import { bundle, load } from './load.mjs';
import { hasBrowser } from './page.mjs';
import { withPage } from './shared.mjs';

const { buildGeometry, fitted, halved, NONE, tangentOf } = await load('geometry', 'finish_maps', 'package');

const near = (a, b, most, what) => assert.ok(Math.abs(a - b) <= most, `${what}: ${a}, not ${b}`);
const none = { texture: NONE, uvSet: 0, transform: Float32Array.of(1, 0, 0, 0, 1, 0) };
const finish = {
  metalness: 0,
  roughness: 0.5,
  surface: none,
  specular: 1,
  specularColour: [1, 1, 1],
  specularTexture: none,
  ior: 1.5,
  occlusion: 1,
  occlusionTexture: none,
  normalScale: 1,
  normal: none,
};
const material = (more) => ({
  name: '',
  baseColour: Float32Array.of(1, 1, 1, 1),
  emission: Float32Array.of(0, 0, 0),
  alphaCutoff: 0.5,
  base: none,
  glow: none,
  alphaMode: 0,
  doubleSided: false,
  unlit: false,
  tint: [0, 0, 0],
  ...more,
});

test('a tangent is unit and at right angles to any normal', () => {
  const normals = [
    [0, 0, 1],
    [0, 0, -1],
    [1, 0, 0],
    [1, 0, -0],
    [0, -1, -0],
    [0.6, 0, -0.8],
    [0.36, 0.48, 0.8],
  ];
  for (const n of normals)
    for (const code of [0, 1, 8191, 16384, 32767, 0x8000, 0xffff]) {
      const [x, y, z, w] = tangentOf(code, ...n);
      near(Math.hypot(x, y, z), 1, 1e-6, `length, ${n} ${code}`);
      near(x * n[0] + y * n[1] + z * n[2], 0, 1e-6, `across, ${n} ${code}`);
      assert.equal(w, code & 0x8000 ? -1 : 1);
    }
  // lw_vec3_frame(): below the horizon, and at -0, the frame is another
  near(tangentOf(0, 0.6, 0, -0.8)[2], 0.6, 1e-6, 'z');
  near(tangentOf(0, 1, 0, -0)[2], 1, 1e-6, 'at -0');
  near(tangentOf(0, 1, 0, 0)[2], -1, 1e-6, 'at 0');
});

/** Two triangles of four vertices; tangents of the second one's corners are others, if given. */
function sceneOf(materials, uses = [0, 0]) {
  return {
    name: '',
    meshes: [
      {
        vertexCount: 4,
        triangleCount: 2,
        position: Float32Array.of(0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0),
        normal: Float32Array.of(0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1),
        uv: [Float32Array.of(0, 0, 1, 0, 1, 1, 0, 1), null],
        colour: null,
        triangle: Uint32Array.of(0, 1, 2, 0, 2, 3),
        material: Uint32Array.from(uses),
        lightmapUv: null,
        atlasWidth: 0,
        atlasHeight: 0,
        backOffset: 0,
      },
    ],
    materials,
    textures: [],
    objectMesh: Uint32Array.of(0),
    objectName: [''],
    lights: [],
    environment: null,
  };
}
const tiles = { unit: 32 };

test('vertices are there twice where tangents of corners differ, and only there', () => {
  const scene = sceneOf([material()]);
  const matt = buildGeometry(scene, tiles);
  assert.equal(matt.tag.length, 4);
  assert.equal(matt.finish, null);
  const bumpy = { ...finish, normal: { ...none, texture: 0 } };
  const built = (codes) =>
    buildGeometry(scene, tiles, { materials: [bumpy], textures: [], tangents: [Uint16Array.from(codes)] });
  assert.equal(built([7, 7, 7, 7, 7, 7]).tag.length, 4);
  const { tag, index, position, finish: made } = built([7, 7, 7, 7, 0x8007, 9]);
  assert.equal(tag.length, 5); // vertex 2 says two things
  assert.deepEqual([...index], [0, 1, 2, 0, 4, 3]);
  assert.deepEqual([...position.subarray(12)], [1, 1, 0]);
  assert.deepEqual(
    [2, 4].map((v) => made.tangent[4 * v + 3]),
    [127, -127],
  );
  // another copy of the same is the same
  assert.equal(built([7, 7, 7, 9, 9, 9]).tag.length, 6);
});

test('what is matt, unlit or without tangents is drawn as before', () => {
  const scene = sceneOf([material(), material({ unlit: true })], [0, 1]);
  const bumpy = { ...finish, normal: { ...none, texture: 3 } };
  const given = { materials: [null, bumpy], textures: [], tangents: [null] };
  const groups = (of) => buildGeometry(scene, tiles, of).meshes[0].groups.map((group) => group.finish);
  assert.deepEqual(groups(given), [null]);
  assert.deepEqual(groups({ ...given, materials: [bumpy, null] }), [[NONE, NONE, NONE, NONE], null]);
});

test('textures are halved until they fit', () => {
  const picture = (width, height, content, texels) => ({
    ...{ width, height, content, texels: Uint8Array.from(texels) },
    ...{ wrapS: 0, wrapT: 0 },
  });
  const normals = picture(4, 1, 1, [0, 10, 100, 20, 255, 255, 255, 255]);
  assert.deepEqual([...halved(normals).texels], [50, 15, 255, 255]);
  assert.deepEqual([...halved(halved(normals)).texels], [153, 135]);
  const one = picture(2, 2, 2, [...Array(16).keys()]);
  assert.deepEqual([...halved(one).texels], [6, 7, 8, 9]);
  assert.equal(fitted([normals], 4, 1e9)[0], normals);
  assert.equal(fitted([normals], 2, 1e9)[0].width, 2);
  assert.deepEqual(
    fitted([normals, one], 4, 12).map(({ width }) => width),
    [2, 1],
  );
  assert.equal(fitted([normals], 4, 0)[0].width, 1, 'it ends');
});

// ---- on the GPU ----

/** In the page: what all shaders read, once without an environment and once with one. */
function begin(sky) {
  const { FinishMaps } = parts;
  const gl = new OffscreenCanvas(1, 1).getContext('webgl2');
  for (const name of ['EXT_color_buffer_float', 'OES_texture_float_linear']) gl.getExtension(name);
  const nothing = gl.createVertexArray();
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA16F, sky.width, sky.height);
  const [format, type] = [gl.RGBA, gl.FLOAT];
  const texels = Float32Array.from(sky.texels);
  gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, sky.width, sky.height, format, type, texels);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
    gl.texParameteri(gl.TEXTURE_2D, name, gl.LINEAR);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  globalThis.gpu = { gl, nothing };
  for (const [name, from] of [
    ['plain', null],
    ['sky', { texture, width: sky.width }],
  ]) {
    gpu[name] = new FinishMaps(gl, [], null, from, nothing);
    while (!gpu[name].step());
  }
}

/** In the page: draws a fragment shader into floats; their bytes as base64. */
function drawFloats([fragment, side, name]) {
  const { createProgram, SCREEN_VERTEX } = parts;
  const { gl, nothing } = gpu;
  const target = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, target);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, side, side);
  gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
  gl.viewport(0, 0, side, side);
  const defines = ['NORMAL_TEXTURE', ...(name === 'sky' ? ['ENVIRONMENT'] : [])];
  const program = createProgram(gl, SCREEN_VERTEX, fragment, defines);
  program.use();
  gl.bindTexture(gl.TEXTURE_2D, gpu[name].smooth);
  gl.uniform1i(program.at('smoothTable'), 0);
  gl.uniform3f(program.at('sky'), 1, 1, 1);
  gl.uniform1f(program.at('skyUnit'), 1);
  gl.bindVertexArray(nothing);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  const floats = new Float32Array(4 * side * side);
  gl.readPixels(0, 0, side, side, gl.RGBA, gl.FLOAT, floats);
  if (gl.getError()) throw new Error('an error of WebGL');
  let text = '';
  for (const byte of new Uint8Array(floats.buffer)) text += String.fromCharCode(byte);
  return btoa(text);
}

/** By name; floatsOf(main, side, maps): what the fragments of a shader give, 4 numbers each. */
const onGpu = [];
const gpuTest = (name, run) => onGpu.push([name, run]);

gpuTest('the table of lobes is the integral', async (floatsOf) => {
  const side = 32;
  const table = await floatsOf(
    'void main() { vec2 at = floor(gl_FragCoord.xy) / 31.0; value.rg = lobeShares(at.x * at.x, at.y); }',
    side,
  );
  // entries of lw_lobe_table()
  for (const [i, j, ...wanted] of [
    [31, 31, 0.30681, 0.00003],
    [8, 31, 0.78641, 0.02886],
    [16, 16, 0.76305, 0.07032],
    [31, 10, 0.987, 0.00001],
    [5, 12, 0.67723, 0.27835],
    [20, 6, 0.92644, 0.06763],
  ])
    for (const k of [0, 1]) near(table[4 * (j * side + i) + k], wanted[k], 2e-3, `entry ${i}, ${j}`);
});

// a surface of each fragment, of the worst that there is; and lights
const HOSTILE = `
uint state;
float random() {
  state = state * 747796405u + 2891336453u;
  uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
  return float(((word >> 22u) ^ word) >> 8u) / 16777216.0;
}
float some(float low, float high) {
  float pick = random();
  return pick < 0.2 ? low : pick < 0.4 ? high : pick < 0.5 ? low + 1e-6 : mix(low, high, random());
}
vec3 direction() {
  float z = some(-1.0, 1.0), phi = 6.2831853 * random(), r = sqrt(max(1.0 - z * z, 0.0));
  return random() < 0.1 ? vec3(0, 0, 1) : vec3(r * cos(phi), r * sin(phi), z);
}
vec3 above(vec3 g) {
  vec3 d = direction();
  float height = dot(d, g);
  if (random() < 0.2) d = normalize(d - (height - 1e-7) * g + 1e-9);
  return dot(d, g) < 0.0 ? -d : d;
}
Seen hostile() {
  state = uint(gl_FragCoord.y) * 65536u + uint(gl_FragCoord.x);
  random();
  vec3 g = direction(), v = above(g), plain = above(g), n = random() < 0.3 ? plain : direction();
  if (random() < 0.05) n = -v;
  Lobes lobes = lobesOf(vec3(some(0.0, 1.0), some(0.0, 1.0), some(0.0, 1.0)), some(-1.0, 2.0),
    some(-0.1, 1.5), some(-1.0, 2.0), vec3(some(0.0, 3.0), some(0.0, 1e30), some(0.0, 0.04)));
  return see(lobes, v, plain, n);
}
`;

gpuTest('no finish makes a pixel that is no number, negative, or more than arrives', async (floatsOf) => {
  const check = (values, what, most = Infinity) => {
    const bad = values.findIndex((x) => !(x >= 0 && x <= most));
    assert.ok(bad < 0, `${what}: fragment ${bad >> 2}: ${values.slice(bad & ~3, (bad & ~3) + 4)}`);
  };
  const lamps = await floatsOf(`${HOSTILE}
void main() {
  Seen s = hostile();
  vec3 to = above(s.plain);
  float nl = dot(s.n, to);
  value = nl > 0.0 ? vec4(min(reflected(s, to, nl, some(0.0, 3.0)) * nl, 6e4), 0) : vec4(0);
}`);
  check(lamps, 'of a lamp', 6e4);
  const around = (e) => `${HOSTILE}
void main() {
  Seen s = hostile();
  value = vec4(everywhere(s, ${e}, 1.0, 1.0), 0);
}`;
  // as much as a white sky gives: nothing sends back more. The gloss' own many bounces are not counted
  check(await floatsOf(around(`vec3(${Math.PI})`)), 'of a white sky', 1.02);
  check(await floatsOf(around('vec3(0)')), 'in the dark', 0);
  check(await floatsOf(around('vec3(some(0.0, 1e12), some(0.0, 1e-30), some(0.0, 1.0))')), 'of any light');
  const bent = await floatsOf(`${HOSTILE}
void main() {
  Seen s = hostile();
  float above = dot(reflect(-s.v, s.n), s.plain) - min(dot(s.v, s.plain), 0.0);
  value = vec4(above + 0.02, dot(s.n, s.v) + 0.02, 1.0 - abs(length(s.n) - 1.0), 1);
}`);
  check(bent.map((x) => x - 1e-9), 'what is mirrored is above the surface');
});

gpuTest('factor and gain of any direction are within their bounds, of none 1', async (floatsOf) => {
  const values = await floatsOf(`${HOSTILE}
void main() {
  Seen s = hostile();
  vec3 r = some(-1.0, 1e4) * vec3(some(-1.0, 1.0), some(-1.0, 1.0), some(-1.0, 1.0));
  value.rg = directed(r, s.plain, s.n, reflect(-s.v, s.n), s.alpha) / vec2(4, 8);
  value.ba = directed(0.01 * direction(), s.plain, s.n, reflect(-s.v, s.n), s.alpha);
}`);
  const bad = values.findIndex((x, at) => ((at & 3) < 2 ? !(x >= 0 && x <= 1) : x !== 1));
  assert.ok(bad < 0, `fragment ${bad >> 2}: ${values.slice(bad & ~3, (bad & ~3) + 4)}`);
  assert.ok(Math.max(...values.filter((_, at) => (at & 3) < 2)) === 1, 'some meet the bounds');
  const texels = await floatsOf(
    `void main() {
  vec3 texel = vec3(0.25 * floor(gl_FragCoord.x));
  value.rgb = gl_FragCoord.y < 1.0 ? fromTexel(texel) : vec3(0);
}`,
    4,
  );
  assert.deepEqual(
    [0, 1, 2, 3].map((i) => texels[4 * i]),
    [0, -0.5, 0, 0.5],
  );
});

gpuTest('a white metal in an even light sends back all of it', async (floatsOf) => {
  const values = await floatsOf(
    `
void main() {
  vec2 at = (floor(gl_FragCoord.xy) + 0.5) / 64.0;
  vec3 z = vec3(0, 0, 1), v = vec3(sqrt(1.0 - at.x * at.x), 0, at.x);
  value = vec4(everywhere(see(lobesOf(vec3(1), 1.0, at.y, 1.0, vec3(0.04)), v, z, z), vec3(${Math.PI}), 1.0, 1.0), 1);
}`,
    64,
  );
  assert.ok(values.every((x) => Math.abs(x - 1) < 0.01));
});

/** A sky that is red above, and blue below; greener to +x. */
function colouredSky() {
  const [width, height] = [64, 32];
  const texels = Array.from({ length: 4 * width * height }, (_, at) => {
    const [i, j, k] = [(at >> 2) % width, Math.floor((at >> 2) / width), at & 3];
    const [phi, down] = [((i + 0.5) / width - 0.5) * 2 * Math.PI, ((j + 0.5) / height) * Math.PI];
    const x = Math.cos(phi) * Math.sin(down);
    return k === 3 ? 1 : k === 0 ? (j < 16 ? 1 : 0) : k === 1 ? 0.5 + 0.5 * x : j < 16 ? 0 : 1;
  });
  return { width, height, texels };
}

const MIRRORS = 'mirrors show the environment, blurred if rough, and not where light does not reach';
gpuTest(MIRRORS, async (floatsOf) => {
  // row 0: mirrors by roughness, that look up; row 1: to +x; row 2: to the front; 3: S
  const values = await floatsOf(
    `
void main() {
  vec2 at = floor(gl_FragCoord.xy);
  vec3 d = at.y == 1.0 ? vec3(1, 0, 0) : at.y == 2.0 ? vec3(0, 0, 1) : vec3(0, 1, 0);
  Seen s = see(lobesOf(vec3(1), 1.0, at.x / 5.0, 1.0, vec3(0)), d, d, d);
  vec3 lit = at.y == 3.0 ? vec3(0) : vec3(1e6);
  vec3 up = ${Math.PI} * skyOf(d, 6) + ${Math.PI};
  value = at.y == 4.0 ? vec4(up, 1) : vec4(mirroredLight(s, min(lit, up)) - 1.0, 1);
}`,
    8,
    'sky',
  );
  const at = (x, y) => values.slice(4 * (8 * y + x), 4 * (8 * y + x) + 3);
  const close = (a, b, most, what) => a.forEach((x, k) => near(x, b[k], most, what));
  close(at(0, 0), [1, 0.5, 0], 0.03, 'a mirror that looks up');
  close(at(0, 1).slice(1, 2), [1], 0.02, 'to +x');
  close(at(0, 2).slice(1, 2), [0.5], 0.02, 'to +z');
  assert.ok(at(5, 0)[0] < 0.97 && at(5, 0)[0] > 0.8, `a rough one sees some of the ground: ${at(5, 0)}`);
  assert.ok(at(5, 1)[1] < at(3, 1)[1] && at(3, 1)[1] < 1, 'rougher is more blurred');
  close(at(0, 4), [2 * Math.PI, 1.5 * Math.PI, Math.PI], 0.12, 'what a matt one gets of it');
  close(at(0, 3), [-1, -1, -1], 1e-3, 'in the dark');
});

const missing = !hasBrowser() && 'there is no chromium';
test('on the GPU', { skip: missing }, async (all) => {
  const { HEAD, SHADING } = await load('shader_head', 'finish_shaders');
  const script = await bundle('parts', 'gpu', 'finish_maps', 'shaders');
  const look = async (page) => {
    await page.addScriptTag({ content: script });
    await page.evaluate(begin, colouredSky());
    const floatsOf = async (main, side = 128, maps = 'plain') => {
      const given = [`${HEAD}\nout vec4 value;\n${SHADING}\n${main}`, side, maps];
      const bytes = Buffer.from(await page.evaluate(drawFloats, given), 'base64');
      return new Float32Array(Uint8Array.from(bytes).buffer);
    };
    for (const [name, run] of onGpu) await all.test(name, () => run(floatsOf));
  };
  await withPage({ width: 64, height: 64 }, look, { mayWarn: true }); // it waits for pixels
});
