/* gl_shaders.h: the texts of the shaders.
 * Threads: constants, [any].
 *
 * Names that a program's defines may hold, besides those of texts: BASE, GLOW (textures of base colour
 * and of emission), BASE_UV1, GLOW_UV1 (which come by the second UV set), COLOUR (vertex colours), MASK,
 * BLEND, LIGHTMAP, LIT (with the direct light of lw_gl_lights), SHADOW (depth alone), SETTLED (every tile
 * that is asked for is there, of noise level 0), FINE (tiles of finer levels may be read), FEEDBACK
 * (which tile is wanted, instead of light), DIRECTION (it is known where tiles' light comes from), MSAA,
 * CENTROID (as attributes are interpolated), and FINE_PIXELS and FINE_CHANGE of the composer. */
#ifndef LW_CLIENT_GL_SHADERS_H
#define LW_CLIENT_GL_SHADERS_H

extern const char lw_gl_shaders_scene_vertex[], lw_gl_shaders_scene_fragment[];
extern const char lw_gl_shaders_sky_vertex[], lw_gl_shaders_sky_fragment[];
extern const char lw_gl_shaders_show_vertex[], lw_gl_shaders_show_fragment[];

#endif
