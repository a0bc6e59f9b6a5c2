// limits.ts: of the lights that the page draws itself, as client/gl/gl_lights.h; of what it keeps.

/** Maps of a sun; their texels a side, and those of a side of a lamp's cube. */
export const CASCADES = 3;
export const SUN_SIDE = 2048;
export const LAMP_SIDE = 512;
/** With more of either, all light comes in tiles. */
export const SUNS_MAX = 2;
export const LAMPS_MAX = 16;
export const LIGHTS_MAX = SUNS_MAX + LAMPS_MAX;
/** Of one light in the table that shaders read. */
export const LIGHT_TEXELS = 4 + CASCADES;

/** Of textures of finishes, with their mip levels, in the GPU's memory. Past it all of them are halved. */
export const FINISH_BYTES_MAX = 2 ** 29;
