// materials.ts: makes three's materials show light as the server does: albedo / pi x E.
// three's physical materials of r187 take what their specular lobe reflects out of the light of lightmaps and
// probes (RE_IndirectDiffuse_Physical), and put nothing in its place where there is no environment map. Against
// lightwell-view's picture of the tests' room FLIP is 0.058 so, and 0.010 with that share left in.
import * as THREE from 'three';

type Shader = THREE.WebGLProgramParametersWithUniforms;
type Node = { mul(factor: number): Node };

/** The fields of NodeMaterial that this module uses. */
interface NodeMaterial extends THREE.Material {
  isNodeMaterial?: boolean;
  setupLightingModel(builder: unknown): LightingModel;
  setupLightMap(builder: { renderer: unknown }): unknown;
}

interface LightingModel {
  singleScatteringDielectric?: Node;
  multiScatteringDielectric?: Node;
  indirectDiffuse?(...given: unknown[]): void;
}

const LOBE = ' * ( 1.0 - singleScattering - multiScattering )';

/** The prototype's method, which an own one of the same name hides. */
function inherited<K extends string>(material: object, name: K): (...given: unknown[]) => unknown {
  return (Object.getPrototypeOf(material) as Record<K, (...given: unknown[]) => unknown>)[name]!;
}

/** A copy of a material that shows lightmaps and probes as albedo / pi x E. probe: the copy gets its light,
 * too. Own hooks of the original (onBeforeCompile) go on. */
export function withServersLight(original: THREE.Material, probe: THREE.LightProbe | null): THREE.Material {
  const material = original.clone();
  const before = Object.hasOwn(original, 'onBeforeCompile') ? original.onBeforeCompile : null;
  material.onBeforeCompile = (shader: Shader, renderer) => {
    before?.call(material, shader, renderer);
    const { fragmentShader } = shader;
    const chunk = THREE.ShaderChunk.lights_physical_pars_fragment.replaceAll(LOBE, '');
    shader.fragmentShader = fragmentShader.replace('#include <lights_physical_pars_fragment>', () => chunk);
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
  // WebGLRenderer and WebGPURenderer keep programs by this. Nodes hold their probe, uniforms do not.
  const kind = `lightwell ${before ?? ''} ${probe ? 'probe' : ''}`;
  const uuid = probe?.uuid ?? '';
  material.customProgramCacheKey = function (this: NodeMaterial) {
    const key = String(inherited(this, 'customProgramCacheKey').call(this));
    return `${key} ${kind} ${this.isNodeMaterial ? uuid : ''}`;
  };
  hookNodes(material as NodeMaterial, probe);
  return material;
}

/** WebGPURenderer copies a material's own properties, these with them, onto a NodeMaterial. */
function hookNodes(material: NodeMaterial, probe: THREE.LightProbe | null): void {
  material.setupLightingModel = function (builder) {
    const model = inherited(this, 'setupLightingModel').call(this, builder) as LightingModel;
    const { indirectDiffuse } = model;
    if (!indirectDiffuse) return model;
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
  if (!probe) return;
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
