import { show } from 'readme:three.js with 3d-tiles-renderer?tiles';

import { job, nextFrame, server, tell } from './asked.js';
import { camera, renderer, scene } from './three_scene.js';

const { tiles } = await show({ server, job, scene, camera, renderer });
tiles.errorTarget = 1;  // every level, down to the finest tiles

let settled = false;
tiles.addEventListener('tiles-load-end', () => { settled = true; });
while (!settled || tiles.stats.downloading + tiles.stats.parsing > 0) {
    await nextFrame();
    tiles.update();
    renderer.render(scene, camera);
}
let points = 0;
scene.traverseVisible((object) => { points += object.isPoints ? object.geometry.getAttribute('position').count : 0; });
tell({ points });
