// follow.ts: light probes of objects that only the client has, one at each one's centre.
// three lights all materials of a scene by its LightProbes, lightmapped ones, too, which would count light
// twice: so each probe belongs to copies of one object's materials (materials.ts).
import * as THREE from 'three';

import { type Gather, RAYS } from './gather.ts';
import { isLit, materialsOf, withServersLight } from './materials.ts';
import { Changes } from './swap.ts';

const MOVED = 0.02; // of the object's radius
const RAYS_PER_UPDATE = 64;

interface Followed {
  object: THREE.Object3D;
  probe: THREE.LightProbe; // in no scene
  changes: Changes;
  next: THREE.SphericalHarmonics3; // that is being gathered
  at: THREE.Vector3; // where
  light: number; // which; -1: none
  ray: number; // the next one; RAYS: it is done
}

export class Follower {
  private readonly followed = new Map<THREE.Object3D, Followed>();
  private light = 0; // grows with each change of it
  private turn = 0;

  lightChanged(): void {
    this.light++;
  }

  /** lit: what the server lights, which is left alone. Returns what ends it. */
  add(object: THREE.Object3D, lit: Set<THREE.Object3D>, gather: Gather | null): () => void {
    const stop = () => this.remove(object);
    if (this.followed.has(object)) return stop;
    const changes = new Changes();
    const probe = new THREE.LightProbe();
    const copies = new Map<THREE.Material, THREE.Material>();
    const copyOf = (material: THREE.Material) => {
      if (!isLit(material)) return material;
      if (!copies.has(material)) {
        const copy = withServersLight(material, probe);
        changes.add(() => copy.dispose());
        copies.set(material, copy);
      }
      return copies.get(material)!;
    };
    object.traverse((node) => {
      const mesh = node as THREE.Mesh;
      if (!mesh.isMesh || lit.has(mesh)) return;
      const made = materialsOf(mesh).map(copyOf);
      changes.set(mesh, { material: Array.isArray(mesh.material) ? made : made[0]! });
    });
    const followed = {
      object,
      probe,
      changes,
      next: new THREE.SphericalHarmonics3(),
      at: new THREE.Vector3(),
      light: -1,
      ray: RAYS,
    };
    this.followed.set(object, followed);
    if (gather) this.renew(followed, gather, RAYS);
    return stop;
  }

  private remove(object: THREE.Object3D): void {
    this.followed.get(object)?.changes.restore();
    this.followed.delete(object);
  }

  restore(): void {
    for (const object of [...this.followed.keys()]) this.remove(object);
  }

  /** Goes on with one that has moved, or with all of them in turn while light changes: 64 rays a call. */
  update(gather: Gather): void {
    const all = [...this.followed.values()];
    for (let i = 0; i < all.length; i++) {
      const at = (this.turn + i) % all.length;
      if (!this.renew(all[at]!, gather, RAYS_PER_UPDATE)) continue;
      this.turn = all[at]!.ray < RAYS ? at : (at + 1) % all.length;
      return;
    }
  }

  /** False: it is as it should be. */
  private renew(followed: Followed, gather: Gather, rays: number): boolean {
    const { object, probe, at, next } = followed;
    if (followed.ray >= RAYS) {
      const { center, radius } = new THREE.Box3()
        .setFromObject(object)
        .getBoundingSphere(new THREE.Sphere(new THREE.Vector3()));
      if (radius < 0) object.getWorldPosition(center); // it has no mesh
      const moved = center.distanceTo(at) > MOVED * Math.max(radius, 0);
      if (followed.light === this.light && !moved) return false;
      at.copy(center);
      next.zero();
      followed.light = this.light;
      followed.ray = 0;
    }
    const end = Math.min(followed.ray + rays, RAYS);
    gather.project(at, next, followed.ray, end);
    followed.ray = end;
    if (end === RAYS) probe.sh.copy(next);
    return true;
  }
}
