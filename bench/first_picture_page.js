// A three.js app that waits, all loaded, until it is told what to show. Each function tells the milliseconds to the first picture.
import { TilesRenderer } from '3d-tiles-renderer';
import { GLTFExtensionsPlugin } from '3d-tiles-renderer/plugins';
import { PerspectiveCamera, Points, PointsMaterial, Scene, Sphere, WebGLRenderer } from 'three';
import { DRACOLoader } from 'three/addons/loaders/DRACOLoader.js';
import { MeshoptDecoder } from 'three/addons/libs/meshopt_decoder.module.js';

const renderer = new WebGLRenderer();
renderer.setSize(innerWidth, innerHeight);
document.body.append(renderer.domElement);
const camera = new PerspectiveCamera(50, innerWidth / innerHeight, 1e-3, 1e4);
const draco = new DRACOLoader().setDecoderPath('/draco/').preload();
await MeshoptDecoder.ready;

/** Until the picture is really drawn. */
function drawn(scene) {
    renderer.render(scene, camera);
    renderer.getContext().readPixels(0, 0, 1, 1, renderer.getContext().RGBA, renderer.getContext().UNSIGNED_BYTE, new Uint8Array(4));
}

function lookAt({ center, radius }) {
    camera.position.copy(center).addScaledVector({ x: 0.3, y: 0.2, z: 0.93 }, 2.6 * radius);
    camera.lookAt(center);
    camera.updateMatrixWorld();
}

/** A tileset, and the milliseconds until nothing more comes. */
window.showTiles = async (url) => {
    const started = performance.now();
    const scene = new Scene();
    const tiles = new TilesRenderer(url);
    tiles.registerPlugin(new GLTFExtensionsPlugin({ meshoptDecoder: MeshoptDecoder }));
    tiles.setCamera(camera);
    tiles.setResolutionFromRenderer(camera, renderer);
    scene.add(tiles.group);
    const loaded = new Promise((resolve) => { tiles.addEventListener('load-root-tileset', resolve); });
    tiles.update();
    await loaded;
    const sphere = new Sphere();
    tiles.getBoundingSphere(sphere);
    lookAt(sphere);
    while (tiles.visibleTiles.size === 0) {
        tiles.update();
        await new Promise(requestAnimationFrame);
    }
    drawn(scene);
    const first = performance.now() - started;
    tiles.dispose();
    return first;
};

/** One Draco file. */
window.showDraco = async (url) => {
    const started = performance.now();
    const scene = new Scene();
    const geometry = await draco.loadAsync(url);
    geometry.computeBoundingSphere();
    lookAt(geometry.boundingSphere);
    scene.add(new Points(geometry, new PointsMaterial({ size: 1, sizeAttenuation: false })));
    drawn(scene);
    const first = performance.now() - started;
    geometry.dispose();
    return first;
};

window.drawn = true;
