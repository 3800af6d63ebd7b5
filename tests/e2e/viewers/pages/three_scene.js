import { PerspectiveCamera, Scene, Vector3, WebGLRenderer } from 'three';

import { view } from './asked.js';

const stage = document.getElementById('stage');

export const renderer = new WebGLRenderer({ preserveDrawingBuffer: true });
renderer.setSize(stage.clientWidth, stage.clientHeight);
stage.append(renderer.domElement);

export const scene = new Scene();

const distance = new Vector3(...view.eye).distanceTo(new Vector3(...view.target));
export const camera = new PerspectiveCamera(view.fov, 1, 0.01 * distance, 10 * distance);
camera.up.set(...view.up);
camera.position.set(...view.eye);
camera.lookAt(...view.target);
camera.updateMatrixWorld();
