// follow.ts: light probes of objects that only the client has, one at each one's centre.
// three lights all materials of a scene by its LightProbes, lightmapped ones, too, which would count light
// twice: so each probe belongs to copies of one object's materials (materials.ts).
import * as THREE from 'three';

import type { Gather } from './gather.ts';
import { isLit, materialsOf, withServersLight } from './materials.ts';
import { Changes } from './swap.ts';

const MOVED = 0.02; // of the object's radius

interface Followed {
  object: THREE.Object3D;
  probe: THREE.LightProbe; // in no scene
  changes: Changes;
  at: THREE.Vector3; // where it was gathered
  light: number; // that was gathered; -1: none
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
    const followed = { object, probe, changes, at: new THREE.Vector3(), light: -1 };
    this.followed.set(object, followed);
    if (gather) this.renew(followed, gather);
    return stop;
  }

  private remove(object: THREE.Object3D): void {
    this.followed.get(object)?.changes.restore();
    this.followed.delete(object);
  }

  restore(): void {
    for (const object of [...this.followed.keys()]) this.remove(object);
  }

  /** Renews one that has moved, or all of them in turn while light changes: one a call. */
  update(gather: Gather): void {
    const all = [...this.followed.values()];
    for (let i = 0; i < all.length; i++) {
      this.turn = (this.turn + 1) % all.length;
      if (this.renew(all[this.turn]!, gather)) return;
    }
  }

  private renew(followed: Followed, gather: Gather): boolean {
    const { object, probe, at } = followed;
    const { center, radius } = new THREE.Box3()
      .setFromObject(object)
      .getBoundingSphere(new THREE.Sphere(new THREE.Vector3()));
    if (radius < 0) object.getWorldPosition(center); // it has no mesh
    const moved = center.distanceTo(at) > MOVED * Math.max(radius, 0);
    if (followed.light === this.light && !moved) return false;
    at.copy(center);
    followed.light = this.light;
    gather.project(center, probe.sh);
    return true;
  }
}
