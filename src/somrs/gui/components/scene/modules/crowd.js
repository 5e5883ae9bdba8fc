// Objects of the same form, size and colour, drawn in one call.
import { THREE } from "nicegui-scene";

const GONE = new THREE.Matrix4().makeScale(0, 0, 0);

export class Crowd {
  constructor(parent, geometry, material, shadow) {
    Object.assign(this, { parent, geometry, material, shadow, members: [] });
    this.grow(4);
  }

  grow(capacity) {
    const mesh = new THREE.InstancedMesh(this.geometry, this.material, capacity);
    mesh.castShadow = this.shadow;
    mesh.receiveShadow = true;
    mesh.frustumCulled = false; // the objects are everywhere
    mesh.userData.names = (instance) => this.members[instance]?.name ?? null;
    if (this.mesh) {
      mesh.instanceMatrix.array.set(this.mesh.instanceMatrix.array);
      this.parent.remove(this.mesh);
      this.mesh.dispose();
    }
    mesh.count = this.members.length;
    this.mesh = mesh;
    this.parent.add(mesh);
  }

  enter(name) {
    // Add one. The result is moved by its `position` and `rotation`, followed by `place()`.
    if (this.members.length === this.mesh.instanceMatrix.count) this.grow(4 * this.members.length);
    const member = new THREE.Object3D();
    member.name = name;
    member.rotation.order = "ZYX";
    member.place = () => {
      member.updateMatrix();
      this.mesh.setMatrixAt(member.number, member.visible ? member.matrix : GONE);
      this.changed();
    };
    member.number = this.members.push(member) - 1;
    this.mesh.count = this.members.length;
    return member;
  }

  leave(member) {
    // The last one takes its index.
    const last = this.members.pop();
    this.mesh.count = this.members.length;
    if (last !== member) {
      this.members[member.number] = last;
      last.number = member.number;
      last.place();
    }
    this.changed();
  }

  changed() {
    this.mesh.instanceMatrix.needsUpdate = true;
    this.mesh.boundingSphere = null;
  }

  get empty() {
    return !this.members.length;
  }

  dispose() {
    this.parent.remove(this.mesh);
    this.mesh.dispose();
    this.geometry.dispose();
  }
}
