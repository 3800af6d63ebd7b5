import { show } from 'readme:three.js alone?geometry';

import { job, server, tell } from './asked.js';
import { camera, renderer, scene } from './three_scene.js';

const { geometry } = await show({ server, job, scene, camera });
renderer.render(scene, camera);
tell({ points: geometry.getAttribute('position').count });
