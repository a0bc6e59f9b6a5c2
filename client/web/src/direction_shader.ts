// direction_shader.ts: common/light/direction_form.h for the GPU, for the page and for three's materials.

/** directed(): factor and gain of light from direction r; both are 1 where r is short, as it is where none is
 * known. n: the plain normal, m: the bent one, ahead: where the mirror's lobe points, alpha: its width.
 * fromTexel(): r of a texel, which has it by half and a half more; 0 where no tile has come. */
export const DIRECTED = `
vec3 fromTexel(vec3 texel) { return texel == vec3(0) ? texel : texel * 2.0 - 1.0; }
vec2 directed(vec3 r, vec3 n, vec3 m, vec3 ahead, float alpha) {
  float long2 = dot(r, r), w = 0.0;
  if (long2 <= 4e-4) return vec2(1); // not known
  r *= inversesqrt(max(long2, 1.0));
  vec3 u = r + (max(-dot(r, n), 0.0) - 2.0 / 3.0) * n, d = n;
  float rise = 1.2 * dot(u, n), found = min(rise + sqrt(rise * rise + 1.8 * dot(u, u)), 1.0);
  if (found > 0.02) {
    w = found;
    d = normalize(u / w + 2.0 / 3.0 * n);
  }
  vec2 along = vec2(dot(d, n), dot(d, m));
  float wide = 0.5 - 0.5 * w;
  vec2 lobe = (1.0 - wide) * max(along, 0.0) + wide * 0.5 * (1.0 + along);
  float factor = 1.0 + wide * dot(n, m - n) + w * (lobe.y - lobe.x) / max(lobe.x, 0.05);
  float sharp = 2.0 + 12.0 * w / (1.02 - w), q = 0.5 / (alpha * alpha), k = sharp * q / (sharp + q);
  float behind = exp(-2.0 * k), high = ((1.0 + behind) / (1.0 - behind) - 1.0 / k) * along.x;
  float cosine = max(0.5 * (high + sqrt(high * high + 1.0 / (4.0 + 1.5708 * k))), 0.05);
  float gain = k * exp(k * (min(dot(ahead, d), 1.0) - 1.0)) / (2.0 * cosine * (1.0 - behind));
  return clamp(vec2(factor, 1.0 - w + w * gain), vec2(0), vec2(4, 8));
}
`;
