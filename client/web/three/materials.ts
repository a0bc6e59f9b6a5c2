// materials.ts: makes three's materials show light as the server does: what is matt albedo / pi x E; what is
// smooth or a metal also mirrors it, as the page does.
// three's physical materials of r187 take what their specular lobe reflects out of the light of lightmaps
// and probes (RE_IndirectDiffuse_Physical), and put nothing in its place where there is no environment map.
// Against lightwell-view's picture of the tests' room FLIP is 0.058 so, and 0.010 with that share left in.
import * as THREE from 'three';

import { DIRECTED } from '../src/direction_shader.ts';
import { FINER_SHADER, type FinerUniforms } from './fine_pool.ts';
import { byDirection, exposeFiner, type FineNodes, finest, type Node, type ShadingNodes } from './nodes.ts';

type Shader = THREE.WebGLProgramParametersWithUniforms;

/** The uniforms of the materials of an object, for where the light of its lightmap comes from. */
export interface DirectionUniforms {
  lightwellDirections: { value: THREE.Texture }; // of the lightmap's size; 1 x 1: not known
  lightwellRoot: { value: THREE.Matrix4 }; // of the server's world
}

/** The fields of NodeMaterial that this module uses. */
interface NodeMaterial extends THREE.Material {
  setupLightingModel(builder: unknown): LightingModel;
  setupLightMap(builder: { renderer: unknown }): unknown;
  lightwellDirections?: THREE.Texture; // as DirectionUniforms have it
  lightwellRoot?: THREE.Matrix4;
}

interface LightingModel {
  singleScatteringDielectric?: Node;
  multiScatteringDielectric?: Node;
  indirectDiffuse?(...given: unknown[]): void;
}

const LOBE = ' * ( 1.0 - singleScattering - multiScattering )';
/** three's mirrored light that facets send on. Its E knows no side. */
const SENT_ON = 'multiScattering * cosineWeightedIrradiance';

/** What is smooth takes the light of lightmaps and probes as three takes an environment map's: part of it
 * is mirrored. Where there is an environment map, too, as much of that is mirrored as each colour of
 * the light allows; the rest comes from everywhere. */
const MIRRORED = `#if defined( RE_IndirectSpecular )
vec3 lightwellParts = irradiance / max( iblIrradiance, vec3( 1e-30 ) );
float lightwellShare = iblIrradiance == vec3( 0.0 ) ? 0.0
  : min( min( lightwellParts.r, lightwellParts.g ), min( lightwellParts.b, 1.0 ) );
radiance = lightwellShare * radiance
  + max( irradiance - lightwellShare * iblIrradiance, 0.0 ) * RECIPROCAL_PI;
iblIrradiance = irradiance;
irradiance = vec3( 0.0 );
#endif
`;
/** MIRRORED's light, by where it comes from. */
const DIRECTED_MIRROR = `#ifdef LIGHTWELL_BY
radiance *= lightwellBy.y;
iblIrradiance += ( lightwellBy.x - 1.0 ) * lightMapIrradiance;
#endif
`;
/** three dims what is mirrored by an ambient occlusion map only with an environment map. */
const OCCLUDED = `
#if defined( USE_AOMAP ) && ! defined( USE_ENVMAP )
reflectedLight.indirectSpecular *= ambientOcclusion;
#endif
`;

/** Whether a material mirrors anything, as the server sees it: metalness 0 and roughness 1 is matt. */
function isSmooth(material: THREE.Material): boolean {
  const { isMeshStandardMaterial, isMeshPhysicalMaterial, roughness, metalness, roughnessMap } =
    material as Partial<THREE.MeshPhysicalMaterial>;
  if (!isMeshStandardMaterial) return false;
  return !!isMeshPhysicalMaterial || metalness! > 0 || roughness! < 1 || !!roughnessMap;
}

/** The prototype's method, which an own one of the same name hides. */
function inherited<K extends string>(material: object, name: K): (...given: unknown[]) => unknown {
  return (Object.getPrototypeOf(material) as Record<K, (...given: unknown[]) => unknown>)[name]!;
}

/** Whether a material shows which side light comes from. */
export function readsDirections(material: THREE.Material): boolean {
  const { normalMap, bumpMap } = material as Partial<THREE.MeshStandardMaterial>;
  return !!normalMap || !!bumpMap || isSmooth(material);
}

/** three's lines that read a lightmap, with finer levels over it. */
const finerMaps = (lines: string) =>
  lines.replace('lightMapTexel.rgb *', 'lightwellFinest( lightMapTexel.rgb, vLightMapUv ) *');

// r is of the server's world, normals are of the camera's space
const DIRECTED_SHADER = `
#define LIGHTWELL_DIRECTED
uniform highp sampler2D lightwellDirections;
uniform mat4 lightwellRoot;
${DIRECTED.replace(' directed(', ' lightwellDirected(').replace(' fromTexel(', ' lightwellFromTexel(')}`;

/** The same with factor and gain of light that comes from somewhere. */
const directedMaps = (lines: string, smooth: boolean, finer: boolean) =>
  lines.replace(
    'irradiance += lightMapIrradiance;',
    `#define LIGHTWELL_BY
vec3 lightwellFrom = lightwellFromTexel( texture2D( lightwellDirections, vLightMapUv ).rgb );${
      finer ? '\nlightwellFrom = lightwellFine.rgb + lightwellFine.a * lightwellFrom;' : ''
    }
lightwellFrom = mat3( lightwellRoot ) * lightwellFrom / length( lightwellRoot[ 0 ].xyz );
vec2 lightwellBy = lightwellDirected( mat3( viewMatrix ) * lightwellFrom, nonPerturbedNormal, normal,
  reflect( - geometryViewDir, normal ), ${smooth ? 'material.roughness * material.roughness' : '1.0'} );
irradiance += lightMapIrradiance${smooth ? '' : ' * lightwellBy.x'};`,
  );

/** A copy of a material that shows lightmaps and probes as the server does. probe: the copy gets its light,
 * too. finer, directions: of its lightmap, with WebGLRenderer, and by tsl with WebGPURenderer.
 * Own hooks of the original (onBeforeCompile) go on. */
export function withServersLight(
  original: THREE.Material,
  probe: THREE.LightProbe | null,
  finer: FinerUniforms | null = null,
  directions: DirectionUniforms | null = null,
  tsl: ShadingNodes | null = null,
): THREE.Material {
  const material = original.clone();
  const smooth = isSmooth(original);
  const before = Object.hasOwn(original, 'onBeforeCompile') ? original.onBeforeCompile : null;
  material.onBeforeCompile = (shader: Shader, renderer) => {
    before?.call(material, shader, renderer);
    const { fragmentShader } = shader;
    const physical = THREE.ShaderChunk.lights_physical_pars_fragment;
    const chunk = !smooth
      ? physical.replaceAll(LOBE, '')
      : directions
        ? physical.replace(SENT_ON, 'multiScattering * radiance')
        : physical;
    shader.fragmentShader = smooth
      ? fragmentShader
          .replace('#include <lights_physical_pars_fragment>', () => chunk)
          .replace('#include <lights_fragment_end>', `${MIRRORED}${directions ? DIRECTED_MIRROR : ''}$&`)
          .replace('#include <aomap_fragment>', `$&${OCCLUDED}`)
      : fragmentShader.replace('#include <lights_physical_pars_fragment>', () => chunk);
    if (finer || directions) {
      Object.assign(shader.uniforms, finer, directions);
      let lines = THREE.ShaderChunk.lights_fragment_maps;
      if (finer) lines = finerMaps(lines);
      if (directions) lines = directedMaps(lines, smooth, !!finer);
      const functions = `${directions ? DIRECTED_SHADER : ''}${finer ? FINER_SHADER : ''}`;
      shader.fragmentShader = shader.fragmentShader
        .replace('#include <lightmap_pars_fragment>', `$&\n${functions}`)
        .replace('#include <lights_fragment_maps>', () => lines);
    }
    if (!probe) return;
    shader.uniforms.lightwellProbe = { value: probe.sh.coefficients };
    shader.fragmentShader = shader.fragmentShader
      .replace('#include <lights_pars_begin>', '$&\nuniform vec3 lightwellProbe[ 9 ];')
      .replace(
        '#include <lights_fragment_begin>',
        '$&\n#if defined( RE_IndirectDiffuse )\n' +
          'irradiance += getLightProbeIrradiance( lightwellProbe, geometryNormal );\n#endif',
      );
  };
  // WebGLRenderer and WebGPURenderer keep programs by this. Nodes hold their probe and pool, uniforms do not:
  // WebGPURenderer looks at a material's own strings, too.
  const parts = [
    probe && 'probe',
    smooth && 'smooth',
    finer && 'finer',
    directions && 'directed',
    tsl && 'nodes',
  ];
  const kind = `lightwell ${before ?? ''} ${parts.filter(Boolean).join(' ')}`;
  const pool = tsl && (finer?.lightwellPool?.value as THREE.Texture | undefined);
  material.customProgramCacheKey = function (this: NodeMaterial) {
    return `${String(inherited(this, 'customProgramCacheKey').call(this))} ${kind}`;
  };
  Object.assign(material, { lightwellNodes: `${probe?.uuid ?? ''} ${pool?.uuid ?? ''}` });
  if (directions) exposeDirections(material as NodeMaterial, directions);
  if (finer && tsl) exposeFiner(material, finer);
  hookNodes(material as NodeMaterial, probe, smooth, { tsl, finer, directed: !!directions });
  return material;
}

/** Light from everywhere on its way to a surface: variables of the shader. */
interface IndirectLight {
  irradiance: Node;
  iblIrradiance: Node;
  radiance: Node;
}

/** Nodes read uniforms of each material as its properties. */
function exposeDirections(material: NodeMaterial, directions: DirectionUniforms): void {
  const get = () => directions.lightwellDirections.value;
  Object.defineProperty(material, 'lightwellDirections', { get, enumerable: true });
  material.lightwellRoot = directions.lightwellRoot.value;
}

/** What lightmapped materials read by nodes. tsl: null: nothing. */
interface ReadByNodes {
  tsl: ShadingNodes | null;
  finer: FinerUniforms | null;
  directed: boolean;
}

/** MIRRORED, and DIRECTED_MIRROR with tsl. e: of the lightmap. */
function mirror(
  { irradiance, iblIrradiance, radiance }: IndirectLight,
  tsl: ShadingNodes | null,
  e: Node | null,
  fine: FineNodes | null,
): void {
  const parts = irradiance.div(iblIrradiance.max(1e-30)).toVar();
  const share = parts.r.min(parts.g).min(parts.b).min(1).toVar();
  const rest = irradiance.sub(iblIrradiance.mul(share)).max(0).div(Math.PI);
  radiance.assign(radiance.mul(share).add(rest));
  iblIrradiance.assign(irradiance);
  irradiance.assign(irradiance.mul(0));
  if (!tsl || !e) return;
  const { factor, gain } = byDirection(tsl, true, fine);
  radiance.assign(radiance.mul(gain));
  // Facets send on light of iblIrradiance. Matt parts get both sums.
  const matt = iblIrradiance.add(factor.sub(1).mul(e)).toVar();
  iblIrradiance.assign(radiance.mul(Math.PI));
  irradiance.assign(matt.sub(iblIrradiance));
}

/** WebGPURenderer copies a material's own properties, these with them, onto a NodeMaterial. */
function hookNodes(
  material: NodeMaterial,
  probe: THREE.LightProbe | null,
  smooth: boolean,
  { tsl, finer, directed }: ReadByNodes,
): void {
  let e: Node | null = null; // of the lightmap, once it is set up
  let fine: FineNodes | null = null;
  material.setupLightingModel = function (builder) {
    const model = inherited(this, 'setupLightingModel').call(this, builder) as LightingModel;
    const { indirectDiffuse } = model;
    if (!indirectDiffuse) return model;
    if (smooth) {
      model.indirectDiffuse = function (...given) {
        const [from] = given as [Partial<IndirectLight> & { context?: IndirectLight }];
        mirror((from.context ?? from) as IndirectLight, directed ? tsl : null, e, fine);
        indirectDiffuse.apply(this, given);
      };
      return model;
    }
    model.indirectDiffuse = function (...given) {
      const { singleScatteringDielectric: single, multiScatteringDielectric: multi } = this;
      if (single?.mul) this.singleScatteringDielectric = single.mul(0);
      if (multi?.mul) this.multiScatteringDielectric = multi.mul(0);
      indirectDiffuse.apply(this, given);
      this.singleScatteringDielectric = single;
      this.multiScatteringDielectric = multi;
    };
    return model;
  };
  if (tsl && (finer || directed))
    material.setupLightMap = function (builder) {
      const own = inherited(this, 'setupLightMap').call(this, builder) as { node: Node } | null;
      if (!own) return own;
      fine = finer && finest(tsl, finer, own.node);
      e = fine?.light ?? own.node;
      own.node = directed && !smooth ? e.mul(byDirection(tsl, false, fine).factor) : e;
      return own;
    };
  if (!probe) return; // which lightmapped materials do not have
  material.setupLightMap = function (builder) {
    const own = inherited(this, 'setupLightMap').call(this, builder);
    const library = (builder.renderer as { library?: { getLightNodeClass(of: unknown): unknown } }).library;
    const Class = ((probe as { _lightNode?: unknown })._lightNode ??
      library?.getLightNodeClass(probe.constructor)) as (new (probe: THREE.LightProbe) => unknown) | null;
    return own ?? (Class ? new Class(probe) : null);
  };
}

/** Whether lights of three's light it. */
export function isLit(material: THREE.Material): boolean {
  const kinds = material as Partial<
    THREE.MeshStandardMaterial & THREE.MeshLambertMaterial & THREE.MeshPhongMaterial & THREE.MeshToonMaterial
  >;
  const { isMeshStandardMaterial, isMeshLambertMaterial, isMeshPhongMaterial, isMeshToonMaterial } = kinds;
  const nodes = material as { isNodeMaterial?: boolean; lights?: boolean };
  return !!(
    isMeshStandardMaterial ||
    isMeshLambertMaterial ||
    isMeshPhongMaterial ||
    isMeshToonMaterial ||
    (nodes.isNodeMaterial && nodes.lights)
  );
}

export function materialsOf(mesh: THREE.Mesh): THREE.Material[] {
  return Array.isArray(mesh.material) ? mesh.material : [mesh.material];
}
