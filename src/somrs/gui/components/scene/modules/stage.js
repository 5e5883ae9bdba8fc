// The canvas: renderer, light, ground, and a loop that draws only after changes.
import { THREE } from "nicegui-scene";

const SHADOWS = 2048; // texels
const COARSE_SHADOWS = 512; // texels, without a graphics card, during motion
const COARSE = 0.7; // rendered pixels per screen pixel in each direction, likewise
const SLOW_FRAME = 80; // ms between two pictures without a graphics card, which leaves time for other programs
const REST = 250; // ms after which motion has ended
const FARTHEST = 30; // m around the target within which shadows are drawn in large buildings

function drawnByProcessor() {
  // Throws where no rendering is possible.
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) throw new Error("no WebGL");
  const about = gl.getExtension("WEBGL_debug_renderer_info");
  const name = about ? gl.getParameter(about.UNMASKED_RENDERER_WEBGL) : "";
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

export class Stage {
  // Throws without WebGL. `step(now)` is called before each frame and returns whether motion continues.
  constructor(canvas, step) {
    // Without a graphics card, each pixel costs time: fewer pixels during motion, more at rest.
    this.slow = drawnByProcessor();
    this.fine = Math.min(devicePixelRatio, 2);
    this.ratio = this.slow ? COARSE : this.fine;
    if (this.slow) this.fine = 2;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !this.slow, alpha: true, powerPreference: "low-power" });
    this.renderer.setPixelRatio(this.ratio);
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = this.slow ? THREE.BasicShadowMap : THREE.PCFSoftShadowMap;
    this.renderer.shadowMap.autoUpdate = false; // shadows do not depend on the camera
    this.renderer.setClearColor(0x000000, 0);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(38, 1, 0.05, 500);
    this.camera.up.set(0, 0, 1);
    this.step = step;
    this.frames = 0;
    this.began = 0;
    this.wanted = false;
    this.resting = false;
    this.light();
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => this.want());
  }

  light() {
    this.sky = new THREE.HemisphereLight(0xffffff, 0xd6d8db, 1.95);
    this.sky.position.set(0, 0, 1);
    this.sun = new THREE.DirectionalLight(0xfff8ec, 2.1);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(SHADOWS, SHADOWS);
    this.sun.shadow.bias = -0.0002;
    this.sun.shadow.normalBias = 0.012;
    this.sun.shadow.radius = 3;
    const shadow = new THREE.ShadowMaterial({ opacity: 0.16 });
    this.ground = new THREE.Mesh(new THREE.PlaneGeometry(1, 1), shadow);
    this.ground.receiveShadow = true;
    this.scene.add(this.sky, this.sun, this.sun.target, this.ground);
  }

  theme(dark) {
    this.sky.intensity = dark ? 1.1 : 1.95;
    this.sky.groundColor.set(dark ? 0x8d98a6 : 0xd6d8db);
    this.sun.intensity = dark ? 1.5 : 2.1;
    this.ground.material.opacity = dark ? 0.4 : 0.16;
    this.want();
  }

  moved() {
    // Update the shadows.
    this.renderer.shadowMap.needsUpdate = true;
    this.want();
  }

  enclose(box) {
    // The ground lies below everything; the light throws short shadows to the north-east.
    this.box = box.clone();
    const middle = box.getCenter(new THREE.Vector3());
    const size = box.getSize(new THREE.Vector3());
    const across = Math.hypot(size.x, size.y);
    this.ground.position.set(middle.x, middle.y, box.min.z - 0.01);
    this.ground.scale.set(20 * across + 50, 20 * across + 50, 1);
    this.camera.far = 12 * across + 100;
    this.camera.updateProjectionMatrix();
    this.shine(middle);
    this.moved();
  }

  shine(target) {
    // A smaller area has sharper shadows: the whole of a small building, or the area around the target in a large one.
    const middle = this.box.getCenter(new THREE.Vector3());
    const size = this.box.getSize(new THREE.Vector3());
    const whole = Math.hypot(size.x, size.y, size.z) / 2 + 0.5;
    const half = Math.min(whole, FARTHEST);
    const at = whole <= FARTHEST ? middle : target;
    if (this.shone && this.shone.at.distanceTo(at) < 0.15 * half && this.shone.half === half && this.shone.z === this.box.max.z) return;
    this.shone = { at: at.clone(), half, z: this.box.max.z };
    const { camera } = this.sun.shadow;
    const far = whole + half + 10;
    this.sun.target.position.copy(at);
    this.sun.position.copy(at).add(new THREE.Vector3(-0.42, -0.5, 0.95).normalize().multiplyScalar(far));
    Object.assign(camera, { left: -half, right: half, top: half, bottom: -half, near: 0.5, far: 2 * far + whole });
    camera.updateProjectionMatrix();
    this.renderer.shadowMap.needsUpdate = true;
    this.want();
  }

  resize(width, height) {
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.want();
  }

  ray(x, y) {
    // A ray from the eye through a point of the picture, coordinates from -1 to 1.
    const ray = new THREE.Raycaster();
    ray.setFromCamera(new THREE.Vector2(x, y), this.camera);
    return ray;
  }

  want() {
    // Request a redraw.
    if (this.wanted || this.resting) return;
    this.wanted = true;
    const soon = this.slow ? this.began + SLOW_FRAME - performance.now() : 0;
    if (soon > 0) this.pause = setTimeout(() => this.request(), soon);
    else this.request();
  }

  request() {
    this.requested = requestAnimationFrame(() => this.frame());
  }

  rest(resting) {
    // The canvas is not visible.
    this.resting = resting;
    if (!resting) this.want();
  }

  frame() {
    this.wanted = false;
    if (this.resting) return;
    this.began = performance.now();
    const goesOn = this.step(this.began / 1000);
    this.render(this.ratio);
    this.frames++;
    this.drawn?.();
    if (goesOn) this.want();
    else if (this.slow) {
      clearTimeout(this.refining);
      this.refining = setTimeout(() => !this.wanted && !this.resting && this.render(this.fine), REST);
    }
  }

  render(ratio) {
    this.refined = ratio === this.fine;
    if (this.renderer.getPixelRatio() !== ratio) this.renderer.setPixelRatio(ratio);
    this.shadows(this.refined ? SHADOWS : COARSE_SHADOWS);
    this.renderer.render(this.scene, this.camera);
  }

  shadows(texels) {
    if (this.sun.shadow.mapSize.x === texels) return;
    this.sun.shadow.mapSize.set(texels, texels);
    this.sun.shadow.map?.dispose();
    this.sun.shadow.map = null;
    this.renderer.shadowMap.needsUpdate = true;
  }

  dispose() {
    clearTimeout(this.refining);
    clearTimeout(this.pause);
    cancelAnimationFrame(this.requested);
    this.resting = true;
    this.ground.geometry.dispose();
    this.ground.material.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }
}
