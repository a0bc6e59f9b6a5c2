// Shortened shaders say what the written ones say: the same tokens in the same lines of the preprocessor, but
// for names, one for one.
import assert from 'node:assert/strict';
import test from 'node:test';

import { namesFor, shorten, tokensOf, withoutComments } from '../shorten.mjs';
import { load } from './load.mjs';

const modules = await Promise.all(['shader_head', 'finish_shaders', 'shaders'].map((name) => load(name)));
const shaders = modules.flatMap((module) =>
  Object.entries(module).filter(([, value]) => typeof value === 'string'),
);
const names = namesFor(shaders.map(([, text]) => text));

const isNumber = (token) => /^\.?\d/.test(token);
const isFloat = (token) => isNumber(token) && !/^0x|u$/i.test(token) && /[.e]/.test(token);

/** Code between lines of the preprocessor, and those lines, in order. */
function partsOf(text) {
  const parts = [[]];
  for (const line of withoutComments(text).split('\n'))
    if (/^\s*#/.test(line)) parts.push(tokensOf(line), []);
    else parts.at(-1).push(...tokensOf(line));
  return parts;
}

test('the same tokens, one short name for each', () => {
  assert.ok(shaders.length >= 10);
  const back = new Map();
  for (const [which, text] of shaders) {
    const short = partsOf(shorten(text, names));
    const long = partsOf(text);
    assert.equal(short.length, long.length, which);
    long.forEach((tokens, i) => {
      assert.equal(short[i].length, tokens.length, `${which}: ${tokens.join(' ')}`);
      tokens.forEach((token, k) => {
        const other = short[i][k];
        if (isNumber(token)) {
          assert.equal(isFloat(other), isFloat(token), token);
          assert.equal(Number.parseFloat(other), Number.parseFloat(token), `${token} ${other}`);
          assert.match(other, /\d/);
        } else if (/^\w/.test(token)) {
          assert.equal(back.get(other) ?? token, token, `${other} is two names`);
          back.set(other, token);
        } else assert.equal(other, token);
      });
    });
  }
  assert.ok([...back].filter(([short, long]) => short.length < long.length).length > 100);
});

test('names that are given or asked for stay', () => {
  const said = shaders.map(([, text]) => text).join('\n');
  for (const name of ['main', 'gl_Position', 'smoothTable', 'FINISH', 'texelFetch', 'xyz', 'rgb'])
    assert.ok(new RegExp(`\\b${name}\\b`).test(said) && !names.has(name), name);
  for (const name of ['finishOf', 'vLightmap', 'roughness', 'uvOf']) assert.ok(names.has(name), name);
});

test('what would run together stays apart, what is a float stays one', () => {
  const cases = [
    ['float   one = 0.50 + 10.0 * 0.0; // and so on', 'float one=.5+10.*0.;'],
    ['return - -1.0 + +x - 0.5;', 'return- -1.+ +x-.5;'],
    ['return 0.5; /* half */ uint u = 0xffffu >> 6u;', 'return .5;uint u=0xffffu>>6u;'],
    ['#define half -1\na = 1e-3;', '#define half -1\na=1e-3;'],
    ['#define of(set) (set > 0.5)\n', '#define of(set) (set>.5)'],
    ['#version 300 es\n  if (a) b++;\n  else c += 100;', '#version 300 es\nif(a)b++;else c+=100;'],
    ['  a = b;\n\n# endif // of it\n c;', 'a=b;\n#endif\nc;'],
  ];
  for (const [text, short] of cases) assert.equal(shorten(text, new Map()), short);
});
