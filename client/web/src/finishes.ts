// finishes.ts: how smooth surfaces are, what they mirror, and their small relief: lw_finish of
// common/scene/scene.h.
import type { TextureUse } from './package.ts';

export const Content = { COLOUR: 0, NORMAL: 1, SURFACE: 2 } as const;

export interface FinishTexture {
  width: number;
  height: number;
  content: number;
  texels: Uint8Array<ArrayBuffer>; // NORMAL: 2 bytes a texel, x and y; else 4
  wrapS: number;
  wrapT: number;
}

export interface Finish {
  metalness: number;
  roughness: number;
  surface: TextureUse;
  specular: number;
  specularColour: ArrayLike<number> & Iterable<number>; // 3
  specularTexture: TextureUse;
  ior: number;
  occlusion: number;
  occlusionTexture: TextureUse;
  normalScale: number;
  normal: TextureUse;
}

export interface Finishes {
  materials: (Finish | null)[]; // by material; null: matt
  textures: FinishTexture[];
  tangents: (Uint16Array | null)[]; // by mesh: 3 a triangle
}
