// shorten.mjs: GLSL ES 3.00 that says the same in fewer bytes: no comments, no needless blanks, short names.
// One name has one short name in all shaders, so that what a vertex shader hands on still has its name in the
// fragment shader. Names that TypeScript gives or asks for stay: uniforms, and macros without small letters.

const LANGUAGE = new Set(
  `attribute bool break bvec2 bvec3 bvec4 case centroid const continue default discard do else false flat
  float for highp if in inout int invariant isampler2D isampler2DArray isampler3D isamplerCube ivec2 ivec3
  ivec4 layout location lowp mat2 mat2x2 mat2x3 mat2x4 mat3 mat3x2 mat3x3 mat3x4 mat4 mat4x2 mat4x3 mat4x4
  mediump out precision return sampler2D sampler2DArray sampler2DArrayShadow sampler2DShadow sampler3D
  samplerCube samplerCubeShadow smooth struct switch true uint uniform usampler2D usampler2DArray
  usampler3D usamplerCube uvec2 uvec3 uvec4 varying vec2 vec3 vec4 void while abs acos acosh all any asin
  asinh atan atanh ceil clamp cos cosh cross dFdx dFdy degrees determinant distance dot equal exp exp2
  faceforward floatBitsToInt floatBitsToUint floor fract fwidth greaterThan greaterThanEqual
  intBitsToFloat inverse inversesqrt isinf isnan length lessThan lessThanEqual log log2 matrixCompMult max
  min mix mod modf normalize not notEqual outerProduct packHalf2x16 packSnorm2x16 packUnorm2x16 pow
  radians reflect refract round roundEven sign sin sinh smoothstep sqrt step tan tanh texelFetch
  texelFetchOffset texture textureGrad textureGradOffset textureLod textureLodOffset textureOffset
  textureProj textureProjGrad textureProjGradOffset textureProjLod textureProjLodOffset textureProjOffset
  textureSize transpose trunc uintBitsToFloat unpackHalf2x16 unpackSnorm2x16 unpackUnorm2x16 asm cast
  common enum extern external filter fixed goto half inline input interface long namespace noinline output
  packed partition patch public resource sample short sizeof static subroutine superp template this
  typedef union unsigned using volatile active class buffer shared main define defined elif endif es ifdef
  ifndef line pragma undef version`.split(/\s+/),
);
const isKept = (name) =>
  LANGUAGE.has(name) ||
  !/[a-z]/.test(name) ||
  /^gl_|__/.test(name) ||
  /^(?:[xyzw]{1,4}|[rgba]{1,4}|[stpq]{1,4})$/.test(name); // parts of a vector

const TOKEN = new RegExp(
  [
    /\d+[uU]\b|0[xX][\da-fA-F]+[uU]?/, // without a sign, or by sixteen
    /(?:\d+\.\d*|\.\d+|\d+)(?:[eE][-+]?\d+)?|\w+/,
    /[-+*/%<>=!&|^]=|<<=?|>>=?|&&|\|\||\+\+|--|\S/,
  ]
    .map(({ source }) => source)
    .join('|'),
  'g',
);

/** The tokens of a line or of many, without comments. */
export const tokensOf = (text) => text.match(TOKEN) ?? [];
export const withoutComments = (text) => text.replace(/\/\*[^]*?\*\/|\/\/.*/g, ' ');

const uniformsOf = (text) =>
  [...text.matchAll(/\buniform\s+(?:(?:high|medium|low)p\s+)?\w+\s+([^;]+);/g)].flatMap(([, names]) =>
    names.split(',').map((name) => /\w+/.exec(name)[0]),
  );

function* shortNames() {
  const first = 'abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ';
  yield* first;
  for (const a of first) for (const b of `${first}0123456789`) yield a + b;
}

/** Short names for all others of shaders: the most frequent first. */
export function namesFor(shaders) {
  const counts = new Map();
  const kept = new Set(shaders.flatMap((text) => uniformsOf(withoutComments(text))));
  for (const text of shaders)
    for (const name of tokensOf(withoutComments(text)).filter((token) => /^[A-Za-z_]/.test(token)))
      if (isKept(name)) kept.add(name);
      else if (!kept.has(name)) counts.set(name, (counts.get(name) ?? 0) + 1);
  const names = new Map();
  const free = shortNames();
  for (const [name] of [...counts].sort((a, b) => b[1] - a[1])) {
    let short;
    do short = free.next().value;
    while (kept.has(short) || isKept(short));
    names.set(name, short);
  }
  return names;
}

const plainNumber = (token) =>
  /^\d+\.\d*$/.test(token) ? token.replace(/0+$/, '').replace(/^0+(?=\.\d)/, '') : token;

function joined(text, names) {
  let out = '';
  for (const token of tokensOf(text).map((token) => names.get(token) ?? plainNumber(token))) {
    const clash = /[\w.]$/.test(out) ? /^\w|^\.\d/.test(token) : /([-+])$/.exec(out)?.[1] === token[0];
    out += clash ? ` ${token}` : token;
  }
  return out;
}

/** A shader with the names of namesFor(). Lines that begin with # stay lines. */
export function shorten(text, names) {
  const out = [];
  let code = '';
  const endCode = () => {
    if (code.trim()) out.push(joined(code, names));
    code = '';
  };
  for (const line of withoutComments(text).split('\n')) {
    const [, word, rest] = /^\s*#\s*(\w+)\s*(.*)$/.exec(line) ?? [];
    if (!word) {
      code += `${line}\n`;
      continue;
    }
    endCode();
    const [, macro, body] = (word === 'define' && /^(\w+(?:\([^)]*\))?)\s*(.*)$/.exec(rest)) || [];
    if (macro) out.push(`#define ${joined(macro, names)} ${joined(body, names)}`.trim());
    else out.push(word === 'version' ? `#version ${rest}` : `#${word} ${joined(rest, names)}`.trim());
  }
  endCode();
  return out.join('\n');
}
