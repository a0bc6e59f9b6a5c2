// Shows public/scene.glb in the light of the lightwelld at ws://127.0.0.1:7781/ws, with a ball of the page's
// own. Parameters of the address: scene, server; assets, the folder of the package's files, for a bundler
// that does not find them.
import * as THREE from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { Lightwell } from 'lightwell-three';

const parameters = new URLSearchParams(location.search);
const state = document.getElementById('state') ?? document.body.appendChild(document.createElement('div'));

const renderer = new THREE.WebGLRenderer({ antialias: true });
renderer.setSize(innerWidth, innerHeight);
renderer.shadowMap.enabled = true;
renderer.toneMapping = THREE.ACESFilmicToneMapping;
document.body.append(renderer.domElement);
const camera = new THREE.PerspectiveCamera(60, innerWidth / innerHeight, 0.01, 1000);
camera.position.set(1.5, 1.7, 2.2);
const controls = new OrbitControls(camera, renderer.domElement);
controls.target.set(-0.2, 1, -1);

const { scene } = await new GLTFLoader().loadAsync(parameters.get('scene') ?? 'scene.glb');
const ball = new THREE.Mesh(new THREE.SphereGeometry(0.2), new THREE.MeshStandardMaterial({ roughness: 1 }));
scene.add(ball);

try {
  const light = await Lightwell.attach(scene, parameters.get('server') ?? 'ws://127.0.0.1:7781/ws', {
    assets: parameters.get('assets') ?? undefined,
    onState: (_, text) => (state.textContent = text),
  });
  light.follow(ball);
  renderer.setAnimationLoop((ms) => {
    ball.position.set(0.5 + 0.5 * Math.sin(ms / 1000), 1, 0.5);
    controls.update();
    light.update(camera, renderer.domElement.height);
    renderer.render(scene, camera);
    globalThis.example = { light, scene, camera, renderer };
  });
} catch (error) {
  state.textContent = error.message;
}
