// shader_head.ts: what all shaders begin with.

/** Width of textures that hold numbers by index. */
export const TABLE_WIDTH = 2048;
export const HEAD = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
precision highp sampler2DArray;
ivec2 at(uint i) { return ivec2(i & ${TABLE_WIDTH - 1}u, i >> ${Math.log2(TABLE_WIDTH)}u); }
`;
