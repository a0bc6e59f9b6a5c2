// inline.ts: lightwell-three/inline, the same in one file (start_inline.ts).
export * from './lightwell.ts';
